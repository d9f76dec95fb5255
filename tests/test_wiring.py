"""Bad wiring is refused with the name of the thing; good wiring is drawn."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import pytest
from click.testing import CliRunner

from exodrake.cli.main import cli
from exodrake.core.errors import InputError
from exodrake.core.part import Output, Task
from exodrake.diagrams.block_diagram import part_shares, stream_order, wiring_svg
from exodrake.machines.exo_index.machine import machine as exo_index


def with_block(name, **changes):
    """The Exo-Index machine with one part's declaration changed."""
    machine = exo_index()
    return replace(machine, parts=tuple(replace(b, **changes) if b.name == name else b for b in machine.parts))


def block(name):
    return next(b for b in exo_index().parts if b.name == name)


def test_signal_unknown_to_the_machine_is_refused():
    with pytest.raises(InputError, match=r"bus writes unknown signal 'speed_aplied'"):
        with_block("bus", outputs=(Output("output", ("speed_aplied",)),))


def test_signal_without_writer_is_refused():
    with pytest.raises(InputError, match=r"controller reads signal 'tension_red', which nothing writes"):
        with_block("controller", tasks=(Task("control", ("tension_ref", "tension_red"), slots=(4,)),))


def test_signal_with_two_writers_is_refused():
    with pytest.raises(InputError, match=r"signal 'tension_read' is written by sensor and by encoder"):
        with_block("encoder", outputs=(Output("output", ("tension_read",)),))


def test_two_tasks_in_a_slot():
    with pytest.raises(InputError, match=r"slot 4 holds both .*mocap\.sample.*controller\.control"):
        with_block("mocap", tasks=(Task("sample", ("angle", "noise_angle"), slots=(4,)),))


def test_slot_beyond_the_frame():
    with pytest.raises(InputError, match=r"controller\.control runs in slot 10, but a frame has 10"):
        with_block("controller", tasks=(Task("control", ("tension_ref", "tension_read"), slots=(10,)),))


def test_algebraic_loop():
    first = block("finger").outputs[0]
    with pytest.raises(InputError, match=r"algebraic loop through finger, sensor"):
        with_block("finger", outputs=(first, Output("output_tension", ("tension", "tension_spool"), reads=("cell",))))


def texts(svg):
    """All texts of a drawing that parses."""
    return ["".join(item.itertext()) for item in ElementTree.fromstring(svg).iter("{http://www.w3.org/2000/svg}text")]


def test_the_drawing_shows_every_part_and_task():
    machine = exo_index()
    found = texts(wiring_svg(machine))
    for part in machine.parts:
        assert part.name in found
    assert {"speed_applied m/s", "stroke_read m", "write AE", "control"} <= set(found)
    assert sum(text.startswith("slot ") for text in found) >= machine.slots


def test_the_signal_runs_down_the_diagonal():
    order = stream_order(exo_index())
    assert order.index("controller") < order.index("bus") < order.index("motor") < order.index("finger")


def test_shares_colour_the_parts():
    svg = wiring_svg(exo_index(), {"finger": 0.5, "tendon": 0.12, "motor": 0.2})
    assert {"62 %", "20 %", "0 %"} <= set(texts(svg))
    timing = part_shares(exo_index(), {"timing": 0.3})
    assert timing["bus"] > 0 and sum(timing.values()) == pytest.approx(0.3)


def test_draw_writes_an_svg(tmp_path):
    out = tmp_path / "wiring.svg"
    assert CliRunner().invoke(cli, ["draw", "--out", str(out)]).exit_code == 0
    ElementTree.parse(out)
    assert CliRunner().invoke(cli, ["draw", "--out", str(tmp_path / "wiring.png")]).exit_code == 2
