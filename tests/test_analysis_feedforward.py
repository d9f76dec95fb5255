"""Feed-forward control: the delay of a motion behind its reference."""

import numpy as np
import pytest

from exodrake.analysis.feedforward import LATEST, find_delay


@pytest.mark.parametrize("frames", [0, 3, LATEST])
def test_the_delay_of_a_shifted_motion_is_its_shift(frames):
    wanted = np.random.default_rng(0).standard_normal(400)
    assert find_delay(wanted, 0.2 + np.concatenate([np.zeros(frames), wanted])[:400]) == frames


@pytest.mark.parametrize("rows", [1, 2])
def test_motions_too_short_for_a_delay_have_none(rows):
    assert find_delay(np.ones(rows), np.ones(rows)) == 0
