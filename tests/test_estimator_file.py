"""An estimator as a file: the same predictions back, no pickle, and clear refusals."""

import json

import numpy as np
import pytest
from estimator_sweeps import trained

from exodrake.core.errors import InputError
from exodrake.estimator.gp import estimator_bytes, load


def test_a_saved_estimator_predicts_the_same_bits(tmp_path):
    _, estimator, sweeps = trained()
    (tmp_path / "e.npz").write_bytes(estimator_bytes(estimator, {"held-out": [0.02]}))
    back = load(tmp_path / "e.npz")
    for one, other in zip(
        estimator.predict(sweeps.tension[:9], sweeps.stroke[:9]), back.predict(sweeps.tension[:9], sweeps.stroke[:9])
    ):
        assert np.array_equal(one, other)
    assert (back.wires, back.joints, back.logs, back.sweeps) == (estimator.wires, estimator.joints, ("worn",), 48)
    assert np.array_equal(back.zeros(sweeps).shift, estimator.zeros(sweeps).shift)
    with np.load(tmp_path / "e.npz", allow_pickle=False) as archive:
        record = json.loads(str(archive["record"]))
    assert record["units"]["stroke"] == "m" and record["notes"] == {"held-out": [0.02]}


def test_what_is_no_estimator_is_refused(tmp_path):
    _, estimator, _ = trained()
    (tmp_path / "text.npz").write_text("hello")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    np.savez(tmp_path / "pickled.npz", record=np.array([{}], dtype=object))
    for name in ("text.npz", "other.npz", "pickled.npz"):
        with pytest.raises(InputError, match=f"{name}: not a"):
            load(tmp_path / name)
    (tmp_path / "e.npz").write_bytes(estimator_bytes(estimator))
    with pytest.raises(InputError, match="another robot"):
        load(tmp_path / "e.npz", robot="0" * 64)
    data = dict(np.load(tmp_path / "e.npz"))
    np.savez(tmp_path / "short.npz", **{**data, "factor": data["factor"][:-1]})
    with pytest.raises(InputError, match="damaged"):
        load(tmp_path / "short.npz")
    np.savez(tmp_path / "odd.npz", **{**data, "strokes_time": data["strokes_time"][:-1]})
    with pytest.raises(InputError, match="damaged"):
        load(tmp_path / "odd.npz")
    with pytest.raises(InputError, match="no such file"):
        load(tmp_path / "absent.npz")
