"""Frequency response from logs: against scipy's closed forms, bands that cover, and blocks told apart."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import run
from scipy import signal, stats

import exodrake as exo
from exodrake.analysis.log_response import HANN, block_responses, plot_responses

DT, FILTER = 0.02, signal.butter(2, 0.2)


def made(seed: int, noise: float, n: int = 4000) -> exo.Log:
    """White input through a Butterworth filter, white noise on the output."""
    u, e = np.random.default_rng(seed).standard_normal((2, n))
    return exo.Log(DT * np.arange(n), {"tension_AF": u, "angle_PIP": signal.lfilter(*FILTER, u) + noise * e})


def tones_at(t):
    """A tone on every line of a segment of 2 s from 2 to 20 Hz, with scattered phases."""
    lines = np.arange(2.0, 20.0, 0.5)[:, None]
    return np.sin(2.0 * np.pi * lines * t + lines**2)


def truth(frequency):
    return signal.freqz(*FILTER, worN=frequency, fs=1.0 / DT)[1]


def test_response_of_a_filter_is_the_closed_form():
    found = exo.frequency_response(made(1, 0.0, 40_000), "tension_AF", "angle_PIP", segment=10.0)
    low = found.frequency < 5.0
    assert np.abs(found.response - truth(found.frequency))[low].max() < 0.02
    assert found.coherence[low].min() > 0.995 and found.unit == "rad/N"


def test_estimate_coherence_and_radius_are_those_of_scipy():
    log, length = made(2, 0.5), 256
    found = exo.frequency_response(log, "tension_AF", "angle_PIP", segment=length * DT)
    u, y = log["tension_AF"], log["angle_PIP"]
    _, uu = signal.welch(u, 1 / DT, nperseg=length)
    _, yy = signal.welch(y, 1 / DT, nperseg=length)
    _, uy = signal.csd(u, y, 1 / DT, nperseg=length)
    f, coherence = signal.coherence(u, y, 1 / DT, nperseg=length)
    assert np.allclose(found.frequency, f[1:]) and np.allclose(found.response, (uy / uu)[1:])
    assert np.allclose(found.coherence, coherence[1:])
    n = 2.0 * HANN * ((len(log) - length // 2) // (length // 2))
    assert found.segments == pytest.approx(n / 2.0)
    square = 2.0 / (n - 2.0) * stats.f.ppf(0.9, 2, n - 2.0) * ((1.0 - coherence) * yy / uu)[1:]
    assert np.allclose(found.radius, np.sqrt(square))


def test_a_slow_swing_resolves_no_line_where_the_input_is_silent():
    """Its trend in each segment leaks everywhere, and a delay of a trend is but an offset: there is no phase in it."""
    time, rng, late = DT * np.arange(1000), np.random.default_rng(0), 0.065

    def respond(tones):
        u, y = (6.0 * np.sin(0.44 * t) + tones * tones_at(t).sum(axis=0) for t in (time, time - late))
        log = exo.Log(time, {"tension_AF": u, "angle_PIP": y + 1e-5 * rng.standard_normal(len(u))})
        found = exo.frequency_response(log, "tension_AF", "angle_PIP", segment=2.0)
        return found, (found.frequency > 2.0) & (found.frequency < 20.0)

    silent, fast = respond(0.0)
    assert not silent.resolved[fast].any()
    spoken, fast = respond(0.1)
    shown = spoken.resolved & fast
    phase = np.degrees(np.unwrap(np.angle(spoken.response[shown]))) + 360.0 * late * spoken.frequency[shown]
    assert shown.sum() > 10 and np.abs(phase - 360.0 * np.round(phase / 360.0)).max() < 3.0


def test_ninety_percent_regions_cover_ninety_percent():
    hits = []
    for seed in range(40):
        found = exo.frequency_response(made(seed, 0.3), "tension_AF", "angle_PIP", segment=4.0)
        inside = np.abs(found.response - truth(found.frequency)) <= found.radius
        hits.append(inside[2:40].mean())  # lines below 10 Hz, where leakage is small beside the noise
    assert np.mean(hits) == pytest.approx(0.9, abs=3.0 * np.std(hits) / np.sqrt(len(hits)) + 0.01)


def test_further_logs_narrow_the_band_and_two_clocks_are_refused():
    logs = [made(k, 0.5) for k in range(4)]
    one, four = (exo.frequency_response(x, "tension_AF", "angle_PIP", segment=4.0) for x in (logs[:1], logs))
    assert four.segments == pytest.approx(4.0 * one.segments)
    assert np.median(four.radius) < 0.6 * np.median(one.radius)
    system = four.to_control()
    assert system(2j * np.pi * four.frequency[7]) == pytest.approx(four.response[7])
    assert system.input_labels == ["tension_AF"] and system.output_labels == ["angle_PIP"]
    with pytest.raises(exo.InputError, match=r"a row every 0\.01 s, log has one every 0\.02 s"):
        exo.frequency_response([logs[0], exo.Log(0.5 * logs[0].time, logs[0].signals)], "tension_AF", "angle_PIP")


def test_missing_samples_are_bridged_and_many_refused():
    log = made(1, 0.0)
    holes = log["angle_PIP"].copy()
    holes[::50] = np.nan
    whole, mended = (
        exo.frequency_response(one, "tension_AF", "angle_PIP", segment=4.0)
        for one in (log, log.with_signals({"angle_PIP": holes}))
    )
    assert np.abs(whole.response - mended.response)[:20].max() < 0.03
    holes[::3] = np.nan
    with pytest.raises(exo.InputError, match="column 'angle_PIP': 35 % of the samples are missing"):
        exo.frequency_response(log.with_signals({"angle_PIP": holes}), "tension_AF", "angle_PIP")


def test_band_ends_where_resolved_lines_no_longer_prevail():
    """Of all bands that begin and end at a line the one with most resolved lines less the rest, and its lines only."""
    found, rng = exo.frequency_response(made(1, 0.1), "tension_AF", "angle_PIP", segment=4.0), np.random.default_rng(0)
    for share in (np.linspace(1.3, -0.1, 100), np.full(100, 0.3), np.full(100, 0.9), np.full(100, 0.0)):
        clear = rng.random(100) < share
        one = replace(found, response=np.ones(100, complex), high=np.where(clear, 1.2, 1.8))
        excess = {(i, j): 2 * clear[i:j].sum() - (j - i) for i in range(100) for j in range(i, 101)}
        band = slice(*min(ends for ends, value in excess.items() if value == max(excess.values())))
        inside = np.zeros(100, bool)
        inside[band] = clear[band]
        assert one.resolved.tolist() == inside.tolist()


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"input": "tension_XX"}, "no column 'tension_XX'"),
        ({"input": "tension"}, "'tension' is no column, but a kind of them; did you mean tension_AF or tension_MF?"),
        ({"input": "tension_MF"}, "column 'tension_MF' stands still"),
        ({"segment": 1e9}, "do not fit in logs of 80 s"),
        ({"segment": 0.02}, "two segments of four rows"),
        ({"robot": exo.load_robot()}, "no column 'tension_ref_AF'"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(given, reason):
    log = made(1, 0.1).with_signals({"tension_MF": np.ones(4000)})
    with pytest.raises(exo.InputError, match=reason):
        exo.frequency_response(log, **{"input": "tension_AF", "output": "angle_PIP", **given})


@pytest.fixture(scope="module")
def rubbing():
    """A robot with friction in its sheaths."""
    return exo.load_robot().splice("tendon.capstan_friction")


@pytest.fixture(scope="module")
def chirp(rubbing):
    return exo.simulate(rubbing, "chirp", seed=5)


@pytest.fixture(scope="module")
def blocks(rubbing, chirp):
    return block_responses(chirp, {"nominal": exo.load_robot(), "improved": rubbing})


def test_gap_lies_in_the_tendon_and_not_in_the_motor(blocks):
    assert [one.output for one in blocks[:3]] == ["stroke_AF", "stroke_MF", "stroke_AE"]
    for one in blocks[:3]:
        level, phase = (part[one.resolved] for part in one.gap())
        assert abs(np.average(level, weights=one.power[one.resolved])) < 0.7
        assert abs(np.average(phase, weights=one.power[one.resolved])) < 5.0
    angle = next(one for one in blocks if one.output == "angle_PIP")
    level, phase = (part[angle.resolved & (angle.frequency < 2.0)] for part in angle.gap())
    assert level.max() < -2.0 and phase.max() < -10.0


def test_robot_with_the_effect_closes_the_gap(blocks):
    for one in blocks:
        level, _ = one.gap("improved")
        assert np.median(np.abs(level[one.resolved])) < 0.7
    figure = plot_responses(blocks)
    assert len([axes for axes in figure.axes if axes.lines]) == 3 * len(blocks)
    assert {text.get_text() for text in figure.legends[0].get_texts()} == {"measured", "nominal", "improved"}
    answer = json.loads(json.dumps(blocks[0].to_dict()))
    assert [phase is not None for phase in answer["gap"]["nominal"]["deg"]] == answer["resolved"]
    assert complex(*answer["response"][3]) == blocks[0].response[3] and len(repr(blocks[0]).splitlines()) == 2


def test_command_writes_figure_and_numbers(chirp, tmp_path):
    exo.write_log(chirp, tmp_path / "log.csv")
    words = ("--from", "tension_AF", "--to", "angle_PIP")
    found = run("response", tmp_path / "log.csv", *words, "--json", "-", "--out", tmp_path / "out")
    assert found.exit_code == 0, found.output
    (answer,) = json.loads(found.stdout)
    assert answer["input"] == "tension_AF" and "nominal" in answer["gap"]
    assert (tmp_path / "out" / "response.png").read_bytes().startswith(b"\x89PNG")
    (tmp_path / "emps").mkdir()  # a folder of logs, at the frame of its machine
    wrong = exo.load_robot("emps").splice("scale.gain", {"gain": 0.1})
    exo.write_log(exo.simulate(wrong, "random-motion:duration=4", seed=1), tmp_path / "emps" / "a.csv")
    assert run("response", tmp_path / "emps", "--robot", "emps").exit_code == 0
    refused = run("response", tmp_path / "log.csv", "--from", "tension_AF")
    assert refused.exit_code == 2 and "--from and --to belong together" in refused.stderr


def test_command_estimates_a_log_without_references_alone(chirp, tmp_path):
    exo.write_log(chirp.only(["tension_AF", "angle_PIP"]), tmp_path / "log.csv")
    found = run("response", tmp_path / "log.csv", "--from", "tension_AF", "--to", "angle_PIP")
    assert found.exit_code == 0 and "no references of exo_index" in found.stderr and "nominal" not in found.stdout
