"""Bad wiring is refused with the name of the thing; good wiring is drawn."""

from dataclasses import replace

import pytest

from exodrake.block import Output, Task
from exodrake.diagrams.exo_index import exo_index
from exodrake.errors import InputError


def with_block(name, **changes):
    """The Exo-Index machine with one part's declaration changed."""
    machine = exo_index()
    return replace(machine, blocks=tuple(replace(b, **changes) if b.name == name else b for b in machine.blocks))


def block(name):
    return next(b for b in exo_index().blocks if b.name == name)


def test_unknown_wire_written():
    with pytest.raises(InputError, match=r"bus writes unknown wire 'speed_aplied'"):
        with_block("bus", outputs=(Output("output", ("speed_aplied",)),))


def test_wire_that_nothing_writes():
    with pytest.raises(InputError, match=r"controller reads wire 'tension_red', which nothing writes"):
        with_block("controller", tasks=(Task("control", ("tension_ref", "tension_red"), slots=(4,)),))


def test_wire_written_twice():
    with pytest.raises(InputError, match=r"wire 'tension_read' is written by sensor and by encoder"):
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
        with_block("finger", outputs=(first, Output("output_tension", ("tension",), reads=("cell",))))
