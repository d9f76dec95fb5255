"""Every format gives a log back to the last digit, or refuses to write it: never a log that reads back as another."""

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings, strategies as st

from exodrake.core.errors import InputError
from exodrake.data.formats import formats, read_log, write_log
from exodrake.data.log import Log
from exodrake.model.units import COMMON, KINDS, UNITS, si_unit

SI = sorted({si_unit(unit) for unit in (*UNITS, *COMMON)})
TENDONS = st.sampled_from(["AF", "MF", "ref_AF", "a_b", "0", "MCP", ""])
COLUMN = st.one_of(
    st.builds(lambda kind, wire: f"{kind}_{wire}".rstrip("_"), st.sampled_from(sorted(set(KINDS) - {"time"})), TENDONS),
    st.text(min_size=1, max_size=8),  # brackets, commas, quotes, line breaks, letters of any script
)
SAMPLE = st.one_of(
    st.floats(allow_infinity=False), st.sampled_from([-0.0, 0.1 + 0.2, 5e-324, 1.7976931348623157e308, np.nan])
)


@st.composite
def logs(draw) -> Log:
    """Up to six rows and four columns in any SI unit that suits the column."""
    rows = draw(st.integers(1, 6))
    start = draw(st.floats(-1e6, 1e9))
    steps = draw(st.lists(st.floats(1e-6, 1e3), min_size=rows - 1, max_size=rows - 1))
    signals, units = {}, {}
    for name in draw(st.lists(COLUMN, max_size=4, unique=True)):
        signals[name] = np.array(draw(st.lists(SAMPLE, min_size=rows, max_size=rows)))
        kind = next((k for k in sorted(KINDS, key=len, reverse=True) if name == k or name.startswith(k + "_")), None)
        units[name] = draw(st.sampled_from(KINDS[kind] if kind else SI))
    return Log(np.cumsum([start, *steps]), signals, units)


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    """Equal with the sign of zero; any NaN is NaN."""
    return np.array_equal(a, b, equal_nan=True) and np.array_equal(np.signbit(a[a == 0]), np.signbit(b[b == 0]))


@pytest.mark.parametrize("ending", formats())
@settings(max_examples=80, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(log=logs())
@example(log=Log(np.array([0.0, 3e10]), {"tension_AF": np.array([1.0, 2.0])}))  # beyond MCAP's nanoseconds
def test_back_to_the_last_digit_or_refused(tmp_path, ending, log):
    path = tmp_path / f"log{ending}"
    path.unlink(missing_ok=True)
    try:
        write_log(log, path)
    except InputError as error:
        assert "log" in str(error) and not list(tmp_path.iterdir())
        return
    back = read_log(path)
    assert back.columns == log.columns and back.units == log.units
    assert same_bits(back.time, log.time)
    assert all(same_bits(back[name], log[name]) for name in log.columns)


@pytest.mark.parametrize("ending", formats())
def test_ordinary_names_are_never_refused(tmp_path, ending):
    """The property above would hold for a writer that refuses all."""
    names = [f"{kind}_{wire}" for kind in sorted(set(KINDS) - {"time"}) for wire in ("AF", "index_PIP", "7")]
    draw = np.random.default_rng(4)
    log = Log(0.02 * np.arange(30), {name: draw.normal(size=30) * 10.0 ** draw.integers(-9, 9) for name in names})
    write_log(log, tmp_path / f"log{ending}")
    assert read_log(tmp_path / f"log{ending}").equals(log)
