"""Cutting logs into sweeps, and refusing what cannot be trained on."""

import numpy as np
import pytest
from estimator_sweeps import as_log, reference, worn_sweeps

from exodrake.core.errors import InputError
from exodrake.estimator.dataset import cut, read_session, sweeps_from_logs


def test_ramps_up_and_down_are_cut_where_they_were_joined():
    data = worn_sweeps(24, seed=0, rows=100)
    label = cut(data["tension_ref"], 0.02)
    assert label[-1] == 23
    assert np.mean(label != data["sweep"]) < 0.02
    loading = worn_sweeps(12, seed=0, rows=100, up_only=True)  # cut at the drop
    assert np.mean(cut(loading["tension_ref"], 0.02) != loading["sweep"]) < 0.02


def test_a_staircase_and_a_log_without_ramps_are_one_sweep():
    stairs = np.repeat(reference(0, (0.0, 0.0), 100, up_only=True)[::20], 30, axis=0)
    slow = np.concatenate([np.linspace(0.3, 4, 50), np.full(50, 4.0), np.linspace(4, 8, 50)])
    assert cut(stairs, 0.02).max() == 0
    assert cut(np.column_stack([slow, slow * 0, slow * 0]), 0.02).max() == 0


def test_logs_join_with_their_own_labels_and_may_stay_whole():
    first, second = as_log(worn_sweeps(6, seed=0, rows=60)), as_log(worn_sweeps(6, seed=1, rows=60), "other.csv")
    assert sweeps_from_logs([first, second]).count == 12
    joined = sweeps_from_logs([first, second], one_per_log=["other.csv"])
    assert joined.count == 7
    assert joined.logs == ("worn.csv", "other.csv")


def test_bad_logs_are_refused_by_name():
    data = worn_sweeps(6, seed=0, rows=60)
    log = as_log(data)
    blind = log.only([name for name in log.columns if not name.startswith("angle_")])
    broken = log.with_signals({"stroke_MF": np.where(np.arange(len(log)) == 7, np.nan, log["stroke_MF"])})
    with pytest.raises(InputError, match="of none, the estimator needs some"):
        sweeps_from_logs([blind])
    with pytest.raises(InputError, match="stroke_MF', row 8"):
        sweeps_from_logs([broken])
    with pytest.raises(InputError, match="too few sweeps: 2"):
        sweeps_from_logs([log.between(0.0, 2.0)])
    with pytest.raises(InputError, match="no logs"):
        sweeps_from_logs([])
    with pytest.raises(InputError, match="of AF, MF, AE, the estimator needs AF, XF"):
        read_session(log, ("AF", "XF"), ())
