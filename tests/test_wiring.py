"""Bad wiring is refused with the name of the thing; good wiring is drawn."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import pytest
from click.testing import CliRunner

from exodrake.cli.main import cli
from exodrake.core.errors import InputError
from exodrake.diagrams.block_diagram import part_shares, stream_order, wiring_svg
from exodrake.machines.exo_index.machine import machine as exo_index
from exodrake.model.part import Output, Task


def part(name):
    return next(b for b in exo_index().parts if b.name == name)


FINGER = (part("finger").outputs[0], Output("output_tension", ("tension", "tension_spool"), reads=("cell",)))


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("bus", {"outputs": (Output("output", ("speed_aplied",)),)}, "bus writes unknown signal 'speed_aplied'"),
        ("controller", {"tasks": (Task("control", ("tension_red",), slots=(4,)),)},
         "controller reads signal 'tension_red', which nothing writes"),
        ("encoder", {"outputs": (Output("output", ("tension_read",)),)},
         "signal 'tension_read' is written by sensor and by encoder"),
        ("mocap", {"tasks": (Task("sample", ("angle", "noise_angle"), slots=(4,)),)},
         r"slot 4 holds both .*mocap\.sample.*controller\.control"),
        ("controller", {"tasks": (Task("control", ("tension_ref", "tension_read"), slots=(10,)),)},
         r"controller\.control runs in slot 10, but a frame has 10"),
        ("finger", {"outputs": FINGER}, "algebraic loop through finger, sensor"),
    ],
)  # fmt: skip
def test_bad_wiring_is_refused_with_the_name_of_the_thing(name, changes, said):
    machine = exo_index()
    with pytest.raises(InputError, match=said):
        replace(machine, parts=tuple(replace(b, **changes) if b.name == name else b for b in machine.parts))


def texts(svg):
    """All texts of a drawing that parses."""
    return ["".join(item.itertext()) for item in ElementTree.fromstring(svg).iter("{http://www.w3.org/2000/svg}text")]


def test_the_drawing_shows_every_part_and_task():
    machine = exo_index()
    found = texts(wiring_svg(machine))
    for part in machine.parts:
        assert part.name in found
    assert {"speed_applied m/s", "stroke_read m", "write AE", "control"} <= set(found)
    assert {"slot 0", "slot 7", "slots 8–9", "17–19 ms"} <= set(found), "neighbours without tasks are one"
    order = stream_order(machine)  # the signal runs down the diagonal
    assert order.index("controller") < order.index("bus") < order.index("motor") < order.index("finger")
    shares = texts(wiring_svg(machine, {"finger": 0.5, "tendon": 0.12, "motor": 0.2}))
    assert {"62 %", "20 %", "0 %"} <= set(shares)
    timing = part_shares(machine, {"timing": 0.3})
    assert timing["bus"] > 0 and sum(timing.values()) == pytest.approx(0.3)


def test_draw_writes_an_svg(tmp_path):
    out = tmp_path / "wiring.svg"
    assert CliRunner().invoke(cli, ["draw", "--out", str(out)]).exit_code == 0
    ElementTree.parse(out)
    assert CliRunner().invoke(cli, ["draw", "--out", str(tmp_path / "wiring.png")]).exit_code == 2
