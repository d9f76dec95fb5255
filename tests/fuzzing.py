"""Ways to spoil a file, and what a command must do with it: status 0, or status 2 and one line."""

import gzip
import json
import os
import signal
from contextlib import contextmanager

import yaml
from click.testing import CliRunner
from hypothesis import HealthCheck, settings, strategies as st

from exodrake.cli.main import cli

JUNK = ["", "nan", "inf", "1e400", "-1e308", "abc", "1_0", "0x1", "1,5", '"', "\x00", "½", "true", "2020-01-01", " "]
UNITS = ["m", "mN", "deg", "lbf", "s", "", "N] x [N", "µm"]
SCRAP = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 3),
    st.sampled_from([10**400, 1e308, -1e308, 5e-324, float("nan"), float("inf"), "1e-3", "AF", "é\n", [], [1, 2], {}]),
    st.dictionaries(st.sampled_from(["value", "unit", "range", "AF", "MCP", "file", 3]), st.integers(0, 2), max_size=2),
)

FEW = 500  # in seconds, so that each change of the code meets them
INPUTS = int(os.environ.get("FUZZ", "0"))  # of the whole suite; 0: few, the same ones each time
HANG = 10 if INPUTS else 100  # s of processor time for one command, which in a few tests compiles
WAIT = 300  # s of the clock, on a busy machine


def bounded(share: float):
    """Settings of a test that takes a share [%] of the suite's inputs."""
    suppressed = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large]
    return settings(
        max_examples=round(share / 100 * (INPUTS or FEW)), derandomize=not INPUTS, print_blob=True, deadline=None,
        database=None, suppress_health_check=suppressed,
    )  # fmt: skip


@contextmanager
def in_time():
    """Fails what takes longer than HANG or WAIT."""

    def hang(number, _):
        raise AssertionError(f"no end after {WAIT if number == signal.SIGALRM else HANG} s")

    timers = {signal.ITIMER_REAL: (signal.SIGALRM, WAIT), signal.ITIMER_PROF: (signal.SIGPROF, HANG)}
    before = {number: signal.signal(number, hang) for number, _ in timers.values()}
    for timer, (_, seconds) in timers.items():
        signal.setitimer(timer, seconds)
    try:
        yield
    finally:
        for timer in timers:
            signal.setitimer(timer, 0)
        for number, handler in before.items():
            signal.signal(number, handler)


def run(*words) -> str:
    """Runs a command in this process and returns its output; fails on a traceback, and on a refusal of two lines."""
    with in_time():
        result = CliRunner().invoke(cli, [str(word) for word in words])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise AssertionError(f"exodrake {' '.join(map(str, words))}") from result.exception
    assert result.exit_code in (0, 2), result.output
    if result.exit_code == 2:
        lines = result.stderr.strip().splitlines()
        assert lines[-1].lower().startswith("error: ") and (len(lines) == 1 or lines[0].startswith("Usage")), lines
    return result.output


@st.composite
def spoilt_table(draw, text: str) -> bytes:
    """CSV text with rows, columns, headings, cells, encoding or bytes spoilt, several at once."""
    rows = [line.split(",") for line in text.strip().splitlines()]
    for _ in range(draw(st.integers(0, 3))):
        rows = _faulty_table(draw, rows)
    data = "\n".join(",".join(row) for row in rows).encode(draw(st.sampled_from(ENCODINGS)), "replace")
    return draw(spoilt_bytes(data)) if draw(st.booleans()) else data


ENCODINGS = ["utf-8", "utf-8", "utf-8-sig", "utf-16", "latin-1", "utf-32"]


@st.composite
def spoilt_bytes(draw, data: bytes) -> bytes:
    """Bytes cut short, with noise in them or over them, or a piece moved to the end."""
    at = draw(st.integers(0, len(data)))
    noise = draw(st.binary(max_size=12))
    over = data[:at] + noise + data[at + len(noise) :]
    again = over[: at // 2] + noise + over[at // 2 + len(noise) :]
    whole = [data[:at], data[:at] + noise + data[at:], data[at:] + data[:at], noise, b"", over, over, over, again]
    return draw(st.sampled_from(whole))


def _faulty_table(draw, rows):
    """Rows, columns, a heading's unit or a cell spoilt."""
    (heading, *body), width = rows, len(rows[0])
    at, row = draw(st.integers(0, width - 1)), draw(st.integers(0, len(rows) - 1))
    order = draw(st.permutations(range(width)))
    unit = f"{heading[at].split('[')[0]}[{draw(st.sampled_from(UNITS))}]"
    cell = [*rows[row][:at], draw(st.sampled_from(JUNK)), *rows[row][at + 1 :]]
    return draw(
        st.sampled_from([
            lambda: [heading, *draw(st.permutations(body))],
            lambda: [[one[i] for i in order] if len(one) == width else one for one in rows],
            lambda: [one[:at] + one[at + 1 :] or [""] for one in rows],
            lambda: [one + one[at : at + 1] for one in rows],
            lambda: [heading, *([*one[:at], "", *one[at + 1 :]] for one in body)],
            lambda: [[*heading[:at], unit, *heading[at + 1 :]], *body],
            lambda: [*rows[:row], cell, *rows[row + 1 :]],
            lambda: [*rows[:row], rows[row] + ["1"], *rows[row + 1 :]],
            lambda: rows[: draw(st.integers(1, 4))],
        ])
    )()  # fmt: skip


def yaml_bytes(page) -> bytes:
    """A YAML file."""
    return yaml.safe_dump(page, allow_unicode=True).encode()


def json_bytes(page) -> bytes:
    """JSON with NaN and numbers of any length, keys as text."""
    return json.dumps(page, skipkeys=True, default=str).encode()


@st.composite
def spoilt_page(draw, page, dump=yaml_bytes) -> bytes:
    """A YAML page with a value replaced, a key renamed, removed or added, or its bytes spoilt; `dump` for others."""
    for _ in range(draw(st.integers(1, 3))):
        page = _spoilt_node(draw, page)
    data = dump(page)
    return draw(spoilt_bytes(data)) if draw(st.integers(0, 3)) == 0 else data


def _spoilt_node(draw, node):
    if isinstance(node, list) and node and draw(st.booleans()):
        at = draw(st.integers(0, len(node) - 1))
        return [*node[:at], _spoilt_node(draw, node[at]), *node[at + 1 :]]
    if not isinstance(node, dict) or not node or draw(st.integers(0, 4)) == 0:
        return draw(SCRAP)
    key = draw(st.sampled_from(list(node)))
    rest = {k: v for k, v in node.items() if k != key}
    way = draw(st.integers(0, 5))
    if way == 0:
        return rest
    if way == 1:
        return rest | {draw(st.sampled_from(["x", 3, None, True, f"{key}_"])): node[key]}
    return node | {key: _spoilt_node(draw, node[key])}


def packed(data: bytes) -> bytes:
    """Gzipped, always to the same bytes."""
    return gzip.compress(data, mtime=0)
