"""Watching a log: files that grow, break off and begin anew; the alarm, when it comes, and when its gap rose."""

import io
import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fuzzing import spoilt_table
from hypothesis import HealthCheck, given, settings
from rich.console import Console
from scipy.signal import lfilter
from scipy.stats import binomtest

import exodrake as exo
from exodrake.cli.main import cli
from exodrake.data.formats import write_log
from exodrake.data.formats.csv import write
from exodrake.data.import_log import read_mapping
from exodrake.data.log import Log
from exodrake.machines.position_servos import motor_machine
from exodrake.model.robot import drawn_robot
from exodrake.monitor.alarm import choose_limits, date_rise, draw_work, measure_noise, share_at_most
from exodrake.monitor.display import draw_screen
from exodrake.monitor.watcher import Grid, Monitor, Tail, follow
from studies.alarm_rates import first_alarm

NOMINAL = exo.load_robot()
LOOSENED = 30.0  # s
CALM = write(exo.simulate(NOMINAL, exo.Reference(np.ones((6, 3))))).decode()


@pytest.fixture(scope="module")
def log():
    return exo.simulate(NOMINAL, draw_work(NOMINAL, 5, 30.0), seed=5)


@pytest.fixture
def file(tmp_path, log):
    write_log(log, tmp_path / "log.csv")
    return tmp_path / "log.csv"


def tail_of(path):
    return Tail(path, NOMINAL.machine)


def rows_of(pieces):
    return np.concatenate([p.values for p in pieces])


def run(*arguments):
    return CliRunner().invoke(cli, ["watch", *(str(a) for a in arguments)])


def test_mapping_file_gives_the_rows_of_a_foreign_file(tmp_path, file, log):
    mapping, path = tmp_path / "map.yaml", tmp_path / "foreign.csv"
    names = [*log.columns]
    columns = "".join(f"  c{k}: {{name: {name}, unit: {log.units[name]}}}\n" for k, name in enumerate(names))
    first = f"  c0: {{name: {names[0]}, unit: mN, scale: 500, offset: -1000}}\n"
    mapping.write_text("separator: ';'\ntime: {column: t, unit: ms}\ncolumns:\n" + first + columns.partition("\n")[2])
    rows = np.column_stack([1e3 * log.time, *(log[name] for name in names)])
    rows[:, 1] = (1e3 * rows[:, 1] + 1000) / 500
    np.savetxt(
        path,
        rows,
        fmt="%.15g",
        delimiter=";",
        comments="",
        header=";".join(["t", *(f"c{k}" for k in range(len(names)))]),
    )
    (found,), (wanted,) = (
        list(Tail(p, NOMINAL.machine, m).poll()) for p, m in ((path, read_mapping(mapping)), (file, None))
    )
    assert found.values == pytest.approx(wanted.values, rel=1e-9, abs=1e-9, nan_ok=True)
    mapping.write_text(mapping.read_text().replace("offset: -1000", "filter: 5"))
    with pytest.raises(exo.InputError, match="exodrake import"):
        Tail(path, NOMINAL.machine, read_mapping(mapping))


def test_a_growing_file_has_where_each_joint_stands_at_first(tmp_path):
    """`take: first`, as in the mapping of `new-machine`, is the first sample that is there; a new log has its own."""
    machine, names = motor_machine("arm", ("base",), 0.02, 2), ("angle_ref_base", "angle_base")
    columns = ", ".join(f"{name}: {{name: {name}, unit: mrad}}" for name in names)
    first = "angle_start_base: {of: angle_base, take: first}"
    (tmp_path / "map.yaml").write_text(f"time: {{column: t, unit: s}}\ncolumns: {{{columns}}}\nderived: {{{first}}}\n")
    path, rows = tmp_path / "live.csv", ["t,angle_ref_base,angle_base,current", "0,5,,0", "0.001,5,7,0", "0.002,5,9,0"]
    path.write_text("\n".join([*rows, *rows[:1], "0,5,3,0", ""]))
    tail = Tail(path, machine, read_mapping(tmp_path / "map.yaml"))
    found = np.vstack([part.values for part in tail.poll()])[:, list(tail.wanted).index("angle_start_base")]
    np.testing.assert_allclose(found, [np.nan, 7e-3, 7e-3, 3e-3])


def test_half_lines_wait_and_units_are_converted(tmp_path, file, log):
    lines, path = file.read_bytes(), tmp_path / "grows.csv"
    tail, found = tail_of(path), []
    assert list(tail.poll()) == []
    for cut in range(0, len(lines), 7919):
        with open(path, "ab") as stream:
            stream.write(lines[cut : cut + 7919])
        found += list(tail.poll())
    rows = rows_of(found)
    assert [p.restart for p in found] == [True] + [False] * (len(found) - 1)
    np.testing.assert_array_equal(rows[:, 0], log.time)
    np.testing.assert_array_equal(rows[:, 1:4], log.array("tension_ref"))
    np.testing.assert_array_equal(rows[:, 13:], log.array("angle"))
    deg = file.read_text().replace("angle_MCP [rad]", "angle_MCP [deg]", 1)
    path.write_text(deg)
    np.testing.assert_allclose(rows_of(list(tail.poll()))[:, 13], np.deg2rad(log["angle_MCP"]), rtol=1e-12)


def test_truncated_rotated_and_repeated_headings_begin_anew(file):
    heading, *lines = file.read_text().splitlines(keepends=True)
    tail = tail_of(file)
    list(tail.poll())
    file.write_text(heading + lines[0] + lines[1])  # shorter: truncated
    assert [(p.restart, len(p.values)) for p in tail.poll()] == [(True, 2)]
    other = file.with_name("next.csv")
    with open(file, "a") as stream:
        stream.write(lines[2])
    other.write_text(heading + "".join(lines[:50]))
    os.replace(other, file)  # rotated: what the old file still holds comes first
    assert [(p.restart, len(p.values)) for p in tail.poll()] == [(False, 1), (True, 50)]
    with open(file, "a") as stream:
        stream.write(lines[50] + heading + lines[0])
    assert [(p.restart, len(p.values), p.numbers[0]) for p in tail.poll()] == [(False, 1, 51), (True, 1, 52)]


@pytest.mark.parametrize(
    "change, words",
    [
        (lambda t: t.replace("stroke_MF [m]", "stroke_XX [m]"), ["stroke_MF", "missing"]),
        (lambda t: t.replace("tension_AF [N]", "tension_AF [m]"), ["tension_AF", "[m]"]),
        (lambda t: t.replace("tension_AF [N]", "tension_AF"), ["tension_AF", "brackets"]),
        (lambda t: t.replace(t.splitlines()[3].split(",")[4], "loose", 1), ["row 3", "tension_AF", "loose"]),
        (lambda t: t.replace(t.splitlines()[3], "1,2,3", 1), ["row 3", "3 cells"]),
        (lambda t: t + t.splitlines()[5] + "\n", ["row 1501", "comes after"]),
        (lambda t: t.replace("\n", "\n\n", 3) + t.splitlines()[5] + "\n", ["row 1501", "comes after"]),
        (lambda t: t.replace(",", ";"), ["time [s];tension_ref_AF [N]", "brackets"]),
    ],
)
def test_bad_logs_are_named(file, change, words):
    file.write_text(change(file.read_text()))
    result = run(file, "--until-idle", 0)
    assert result.exit_code == 2 and "Traceback" not in result.output
    said = result.stderr.splitlines()[-1]
    assert said.startswith(f"error: {file}") and all(word in said for word in words)


@settings(max_examples=30, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(data=spoilt_table(CALM))
def test_spoilt_logs_are_refused_or_read(tmp_path, data):
    path = tmp_path / "log.csv"
    path.write_bytes(data)
    grid = Grid(str(path), 0.02)
    try:
        frames = [s for rows in tail_of(path).poll() for s in grid.push(rows)]
    except exo.InputError as error:
        assert str(path) in str(error)
    else:
        assert all(s.values.shape[1] == 16 and not np.isinf(s.values).any() for s in frames)


def test_a_file_that_never_comes_or_stays_empty(tmp_path):
    result = run(tmp_path / "none.csv", "--until-idle", 0.1)
    assert result.exit_code == 2 and "no such file" in result.stderr
    (tmp_path / "empty.csv").touch()
    assert "no rows" in run(tmp_path / "empty.csv", "--until-idle", 0).stderr


def test_short_gaps_are_bridged_and_long_ones_restart_the_model(file):
    heading, *lines = file.read_text().splitlines(keepends=True)
    keep = [*lines[:100], lines[99], *lines[103:200], *lines[600:]]
    file.write_text(heading + "".join(keep))
    grid, found = Grid("log", 0.02), []
    for rows in tail_of(file).poll():
        found += list(grid.push(rows))
    assert [len(s.values) for s in found] == [200, 900] and found[1].restart and "8.0 s" in found[1].note
    assert np.isnan(found[0].values[100:103]).all() and np.isfinite(found[0].values[103]).all()


def test_a_log_that_grows_gives_the_readings_of_the_whole(file, log):
    whole = [r for r in follow(Monitor(NOMINAL), file, 0.0) if r]
    grows = file.with_name("grows.csv")

    def write():
        data = file.read_bytes()
        for cut in range(0, len(data), 40_001):
            with open(grows, "ab") as stream:
                stream.write(data[cut : cut + 40_001])
            time.sleep(0.01)

    thread = threading.Thread(target=write)
    thread.start()
    grown = [r for r in follow(Monitor(NOMINAL), grows, 2.0) if r]
    thread.join()
    assert [r.second for r in grown] == [r.second for r in whole] == list(range(4, 31))
    for a, b in zip(grown, whole):
        np.testing.assert_array_equal(a.recent, b.recent)


def test_a_log_cut_out_of_a_motion_raises_nothing(tmp_path, log):
    write_log(log.between(7.3, 30.0), tmp_path / "cut.csv")
    monitor = Monitor(NOMINAL)
    assert [r for r in follow(monitor, tmp_path / "cut.csv", 0.0) if r] and not monitor.alarms


def test_injected_effects_raise_an_alarm_in_their_segment_and_healthy_robots_none():
    """Injected effects, and none: in 20 minutes some 2 % of healthy robots raise an alarm, in a minute fewer."""
    noise = measure_noise(NOMINAL)
    without_alarm = [
        first_alarm(NOMINAL, drawn_robot(NOMINAL, np.random.default_rng(k)), noise, k, 60.0) is None for k in range(8)
    ]
    assert sum(without_alarm) >= 7
    for effect, segment in [
        ("motor.dead_zone", "motor"),
        ("motor.current_limit", "motor"),
        ("tendon.slack", "tendon"),
        ("tendon.capstan_friction", "finger"),  # the sheath lies between cell and finger
    ]:
        alarm = first_alarm(NOMINAL, drawn_robot(NOMINAL, np.random.default_rng(9)).splice(effect), noise, 9, 60.0)
        assert alarm is not None and alarm.channel.segment == segment and alarm.gap > alarm.limit


def test_limits_have_the_stated_rate_of_false_alarms():
    """Limits from 2 x 59 draws: 95 % of them must leave out at most 5 % of the law (Wilks), whatever its shape."""
    rng = np.random.default_rng(3)
    shape, left_out = np.linspace(0.1, 0.8, 24), []
    for _ in range(200):
        draws = np.exp(rng.standard_normal((118, 24)) * shape + rng.standard_normal((118, 1)))
        limit = choose_limits(draws)
        others = np.exp(rng.standard_normal((400, 24)) * shape + rng.standard_normal((400, 1)))
        left_out.append((others > limit).any(axis=1).mean())
    assert share_at_most(118) == pytest.approx(0.05, abs=5e-4)
    assert np.mean(np.array(left_out) <= 0.05) > 0.85  # 400 others see the share to a per cent or so
    assert np.mean(left_out) == pytest.approx(1 / 60, abs=0.006)


def test_command_and_screen_summarise_and_the_status_tells_an_alarm(tmp_path, file, monkeypatch):
    result = run(file, "--until-idle", 0)
    assert result.exit_code == 0 and "30 s" in result.stdout and "no alarm" in result.stdout
    console = Console(record=True, width=110, file=io.StringIO())
    monitor = Monitor(NOMINAL)
    console.print(draw_screen(monitor, Path("not_yet.csv")))
    list(follow(monitor, file, 0.0))
    console.print(draw_screen(monitor, file))
    text = console.export_text()
    assert "waiting for the file" in text and "tendon" in text and "no alarm" in text

    def interrupt(seconds):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:  # ends with a summary
        patch.setattr("exodrake.monitor.watcher.time.sleep", interrupt)
        result = run(file)
    assert result.exit_code == 0 and "no alarm" in result.stdout and "1500 frames" in result.stdout
    loose = NOMINAL.splice("tendon.slack", channels=["MF"])
    write_log(exo.simulate(loose, draw_work(NOMINAL, 5, 30.0)), tmp_path / "slack.mcap")
    result = run(tmp_path / "slack.mcap", "--until-idle", 0)
    assert result.exit_code == 1 and "ALARM at" in result.stdout and "exodrake diagnose" in result.stdout
    assert "tendon" in result.stdout and "tension_MF" in result.stdout


@pytest.mark.parametrize(("duration", "said"), [(2.0, "are too few"), (6.0, "the log is too short")])
def test_a_log_too_short_for_an_alarm_is_no_clean_bill(tmp_path, duration, said):
    loose = NOMINAL.splice("tendon.slack", channels=["MF"])
    write_log(exo.simulate(loose, draw_work(NOMINAL, 5, duration)), tmp_path / "short.csv")
    result = run(tmp_path / "short.csv", "--until-idle", 0)
    assert result.exit_code == 0 and said in result.stdout and "an alarm 13 s" in result.stdout
    assert "at most" not in result.stdout
    assert ("the gap is large: " in result.stdout) == (duration > 3.0)


def test_other_machines_are_watched_without_an_alarm(tmp_path):
    robot = exo.load_robot("so101")
    reference = np.zeros((300, 12))
    reference[:, :6] = 0.3 * np.sin(np.arange(300) * 0.02)[:, None]
    write_log(exo.simulate(robot, exo.Reference(reference), seed=1), tmp_path / "arm.csv")
    result = run(tmp_path / "arm.csv", "--until-idle", 0, "--robot", "so101")
    assert result.exit_code == 0 and "300 frames" in result.stdout and "closed loop" in result.stdout
    assert "no limits are calibrated for so101" in result.stdout
    result = run(tmp_path / "arm.csv", "--until-idle", 0, "--robot", "emps")
    assert result.exit_code == 2 and "position_ref_carriage" in result.stderr


def draw_powers(rng, correlation):
    """Power of 60 s: of nine degrees of freedom a second, or that of a motion, a first-order autoregression of logs."""
    if not correlation:
        return rng.chisquare(9, 60) / 9
    return np.exp(lfilter([1.0], [1.0, -correlation], rng.standard_normal(160))[100:])


@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_steady_power_is_no_rise(correlation):
    rng = np.random.default_rng(1)
    dated = sum(date_rise(draw_powers(rng, correlation), 100) is not None for _ in range(40))
    assert binomtest(dated, 40, 0.02, alternative="greater").pvalue > 0.01
    assert not any(date_rise(powers, 60) for powers in (np.full(60, np.nan), np.ones(3), np.ones(60)))


@pytest.mark.parametrize("correlation, factor", [(0.0, 3.0), (0.5, np.exp(5.0))])
def test_a_rise_at_86_s_is_dated(correlation, factor):
    rng, dated = np.random.default_rng(2), 0
    for _ in range(25):
        found = date_rise(draw_powers(rng, correlation) * np.where(np.arange(60) < 46, 1.0, factor), 100)
        dated += found is not None and found[0] <= 86.0 <= found[1]
    assert binomtest(dated, 25, 0.9, alternative="less").pvalue > 0.01
    low, high = date_rise(np.where(np.arange(60) < 46, 1.0, 20.0) * draw_powers(rng, 0.0), 200, 2.0)  # readings of 2 s
    assert low <= 172.0 <= high and high - low <= 4.0


def test_a_tendon_that_loosens_on_the_way_raises_a_dated_alarm(tmp_path):
    """One motion, from 30 s on of a robot with a slack tendon."""
    motion = draw_work(NOMINAL, 5, 60.0)
    before, after = exo.simulate(NOMINAL, motion, seed=5), exo.simulate(NOMINAL.splice("tendon.slack"), motion, seed=5)
    columns = {n: np.where(before.time >= LOOSENED, after[n], before[n]) for n in before.columns}
    write_log(Log(before.time, columns, before.units), tmp_path / "log.csv")
    monitor = Monitor(NOMINAL)
    assert [r for r in follow(monitor, tmp_path / "log.csv", 0.0) if r]
    alarm = monitor.alarms[0]
    assert alarm.second > LOOSENED and alarm.rose is not None
    assert alarm.rose[1] >= LOOSENED - 2.0 and alarm.rose[0] <= alarm.second  # slack shows where the tendon lets go
    assert alarm.rose[0] >= LOOSENED - 5.0
