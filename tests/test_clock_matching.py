"""Offset and drift between two recorders: found, refused where they cannot be, and fitted by the estimator."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from measured_data import DATA, needs_data
from scipy import interpolate, signal

from opid import plots
from opid.errors import InputError, NotDeterminedError
from opid.signals.clock_matching import match_clocks
from opid.signals.recording import recording_from_arrays
from opid.signals.resampling import on_common_clock
from opid.suspensions.identification import identify
from opid.suspensions.model.run import driven_run
from opid.suspensions.sensor_facts import IDEAL, ClockFacts, SensorFacts, SensorPair, Sensors
from opid.suspensions.study import Run, study_of_gear

FS = 200.0


def motion(seconds=40.0, seed=0):
    white = np.random.default_rng(seed).standard_normal(round(seconds * FS))
    return signal.sosfiltfilt(signal.butter(2, (1.0, 30.0), "bandpass", fs=FS, output="sos"), white)


def body_of(wheel, f0_hz=1.8, damping=0.2):
    """The body on a linear suspension above a wheel."""
    ratio = np.fft.rfftfreq(wheel.size, 1 / FS) / f0_hz
    transfer = (1 + 2j * damping * ratio) / (1 - ratio**2 + 2j * damping * ratio)
    return np.fft.irfft(np.fft.rfft(wheel) * transfer, wheel.size)


def logged(samples, *, offset_s=0.0, ppm=0.0, later_s=0.0, name="body"):
    """A recorder that began `offset_s` later, runs `ppm` slow, and delays each sample by `later_s`, over the time."""
    own_s = np.arange(round(samples.size - (offset_s + 1.0) * FS)) / FS
    true_s = offset_s + own_s * (1 + 1e-6 * ppm) - later_s
    spline = interpolate.make_interp_spline(np.arange(samples.size) / FS, samples, k=5)
    return recording_from_arrays([spline(np.clip(true_s, 0.0, (samples.size - 1) / FS))], [name], fs=FS)


WHEEL = motion()
HUB = recording_from_arrays([WHEEL], ["hub"], fs=FS)


@pytest.mark.parametrize(("offset_s", "ppm"), [(0.0, 0.0), (1.0, 100.0), (9.37, -80.0), (2.5, 4000.0)])
def test_offset_and_drift_are_found_through_a_suspension(offset_s, ppm):
    match = match_clocks(HUB, logged(body_of(WHEEL), offset_s=offset_s, ppm=ppm), drift_std_ppm=max(100.0, abs(ppm)))
    for stamp_s in (0.0, 12.0, 28.0):
        assert match.to_reference(stamp_s) == pytest.approx(offset_s + stamp_s * (1 + 1e-6 * ppm), abs=5e-4)
        assert match.from_reference(match.to_reference(stamp_s)) == pytest.approx(stamp_s, abs=1e-9)
    assert match.drift_ppm == pytest.approx(ppm, abs=20.0)
    assert match.coherence > 0.9
    assert "at a coherence of" in match.sentence


def test_recorders_that_share_no_motion_are_refused_with_their_coherence():
    with pytest.raises(InputError, match=r"'hub' and 'body' cannot be matched: .* coherence from 0.5 to 40 Hz is 0\.0"):
        match_clocks(HUB, logged(motion(seed=1)))


def test_a_periodic_motion_is_ambiguous():
    sine = np.sin(2 * np.pi * 1.5 * np.arange(8000) / FS)
    with pytest.raises(InputError, match=r"is ambiguous: .* because the motion is periodic"):
        match_clocks(recording_from_arrays([sine], ["hub"], fs=FS), logged(sine, offset_s=1.0))


def test_a_clock_that_jumps_is_refused_with_the_time():
    n = round(WHEEL.size - 2.0 * FS)
    late = 0.02 * (np.arange(n) > n / 2)
    with pytest.raises(InputError, match=r"jumps by about (1[789]|2[012]) ms near (18|19|20) s"):
        match_clocks(HUB, logged(body_of(WHEEL), offset_s=1.0, later_s=late))


def test_a_drift_that_changes_much_is_refused():
    later_s = 0.05 * np.linspace(-1, 1, round(WHEEL.size - 2.0 * FS)) ** 2
    with pytest.raises(InputError, match=r"drift apart in no straight line: the lags of windows stray by \d+ ms"):
        match_clocks(HUB, logged(body_of(WHEEL), offset_s=1.0, later_s=later_s))


@pytest.mark.parametrize("jump_s", [0.1, 1.0])
def test_a_long_jump_is_refused_with_the_part_of_the_record(jump_s):
    n = round(WHEEL.size - 2.0 * FS)
    late = jump_s * (np.arange(n) > n / 2)
    with pytest.raises(InputError, match=r"jumps: from \d+ s to \d+ s the offset between them differs by"):
        match_clocks(HUB, logged(body_of(WHEEL), offset_s=1.0, later_s=late))


def test_records_without_common_time_or_unit_are_refused():
    with pytest.raises(InputError, match="less than 10 s in common"):
        match_clocks(HUB, replace(logged(WHEEL), start_s=200.0), offset_std_s=1.0)
    with pytest.raises(InputError, match="no unit in common"):
        match_clocks(HUB, recording_from_arrays([WHEEL], ["speed"], fs=FS, unit="m/s"))


@pytest.mark.parametrize("side", ["sprung", "unsprung"])
@pytest.mark.parametrize("is_coarse", [False, True])
def test_the_derivatives_by_lag_and_drift_are_those_of_the_correction(side, is_coarse):
    sensors = Sensors((IDEAL,), (IDEAL,), ("",), clocks=(ClockFacts(1, "light", side, 0, 1e-3, 1e-4),))
    lag, drift = (fault.name for fault in sensors.faults)
    below, above = (signal.resample_poly(each, 5, 1) for each in (WHEEL, body_of(WHEEL)))
    run = driven_run(below, above, fs=5 * FS, number=1, band_hz=(0.5, 20.0))
    run = run.coarse if is_coarse else run
    assert (run.stride > 1) == is_coarse
    values = {lag: 3e-4, drift: 2e-5}
    corrected = run.correct(side, sensors, values)
    assert len(corrected.by) == 2
    for name, _, slope in corrected.by:
        step = 1e-7
        more = run.correct(side, sensors, {**values, name: values[name] + step}).value[:, 0]
        found = (more - corrected.value[:, 0]) / step
        np.testing.assert_allclose(found[50:-50], slope[50:-50], atol=5e-3 * np.abs(slope).max())


def test_a_piece_of_a_run_has_the_drift_of_the_whole():
    sensors = Sensors((IDEAL,), (IDEAL,), ("",), clocks=(ClockFacts(1, "light", "sprung", 0, 1e-3, 1e-4),))
    values = dict(zip((fault.name for fault in sensors.faults), (3e-4, 2e-5), strict=True))
    run = driven_run(WHEEL, body_of(WHEEL), fs=FS, number=1, band_hz=(0.5, 30.0))
    corrected = run.correct("sprung", sensors, values)
    # A piece of the run drifts about the middle of the run, not about its own.
    piece = run.split(2)[1].correct("sprung", sensors, values).value[:, 0]
    whole = corrected.value[len(run.sprung) // 2 :, 0][: piece.size]
    assert np.std((piece - whole)[50:-50]) < 1e-3 * np.std(whole)
    # Another run has another clock.
    other = driven_run(WHEEL, body_of(WHEEL), fs=FS, number=0, band_hz=(0.5, 30.0))
    assert other.correct("sprung", sensors, values).by == ()


def study_of_two_recorders(body):
    match = match_clocks(HUB, body)
    moved = replace(body, fs=FS / (1 + 1e-6 * match.drift_ppm), start_s=match.to_reference(body.start_s))
    run = Run("one", on_common_clock([HUB, moved], fs_hz=FS), 0.0, clocks=(match,))
    return study_of_gear("pair", sprung="body", unsprung="hub", runs=[run])


def test_lag_and_drift_of_a_recorder_are_unknowns_of_its_run():
    study = study_of_two_recorders(logged(body_of(WHEEL), offset_s=2.0, ppm=50.0))
    sensors, (match,) = study.sensor_facts(), study.runs[0].clocks
    assert [(fault.name, fault.kind, fault.run) for fault in sensors.faults] == [
        ("lag_s[sprung, one]", "lag", 0),
        ("drift[sprung, one]", "drift", 0),
    ]
    assert [fault.std for fault in sensors.faults] == [match.offset_std_s, 1e-6 * match.drift_std_ppm]


def test_the_mean_of_sensors_has_a_clock_only_if_all_have_the_same():
    alike = tuple(ClockFacts(0, "one", "sprung", k, 1e-3, 1e-4) for k in (0, 1))
    sensors = Sensors((IDEAL, IDEAL), (IDEAL, IDEAL), ("left", "right"), clocks=alike)
    assert sensors.mean_of([0, 1]).clocks == (alike[0],)
    with pytest.raises(NotDeterminedError, match="have different clocks"):
        replace(sensors, clocks=alike[:1]).mean_of([0, 1])


def test_the_lags_of_the_windows_are_drawn():
    result = SimpleNamespace(study=study_of_two_recorders(logged(body_of(WHEEL), offset_s=2.0)))
    ((ax,),) = plots.clock_lags(result)
    assert ax.get_ylabel() == "lag [ms]"
    assert ax.lines[0].get_xdata().size >= 15
    with pytest.raises(InputError, match="no clocks were matched"):
        plots.clock_lags(SimpleNamespace(study=SimpleNamespace(runs=[])))


@needs_data("shake_table_frame")
def test_the_lag_of_two_sensors_on_a_shake_table_is_the_same_in_three_records():
    lags_s = [
        measured_lag_s(name) for name in ("El_Centro_Trial_1", "El_Centro_Trial_2", "Sine_Wave_Trial_1_2.0cm_2.0Hz")
    ]
    np.testing.assert_allclose(lags_s, np.mean(lags_s), atol=2e-4)


def measured_lag_s(name):
    """The delay between ground and top of the stiff frame by their own stamps: matched, then fitted."""
    sides = []
    with np.load(DATA / "shake_table_frame" / f"Stiff_1_story_-_{name}.npz") as file:
        for sensor in ("ground_floor", "top_floor"):
            acceleration = file[f"{sensor}_acc"][1:].astype(float)
            acceleration *= 9.80665 / np.linalg.norm(acceleration.mean(axis=0))
            centred = acceleration - acceleration.mean(axis=0)
            sides.append((1e-6 * file[f"{sensor}_packet_time_us"][1:], centred))
    recordings = []
    for (stamps, acceleration), channel in zip(sides, ("ground", "top"), strict=True):
        fs = (stamps.size - 1) / (stamps[-1] - stamps[0])
        band = signal.sosfiltfilt(signal.butter(2, (0.5, 30.0), "bandpass", fs=fs, output="sos"), acceleration, axis=0)
        along = acceleration @ np.linalg.svd(band, full_matrices=False)[2][0]
        start_s = stamps[0] - sides[0][0][0]
        recordings.append(recording_from_arrays([along], [channel], fs=fs, start_s=start_s))
    ground, top = recordings
    slow = signal.butter(2, (0.5, 3.0), "bandpass", fs=120.0, output="sos")
    n = min(ground.n_samples, top.n_samples)
    below, above = (signal.sosfiltfilt(slow, each.samples[:n, 0]) for each in recordings)
    top = replace(top, samples=np.sign(below @ above) * top.samples)
    match = match_clocks(ground, top, offset_std_s=1.0)
    top = replace(top, fs=top.fs / (1 + 1e-6 * match.drift_ppm), start_s=match.to_reference(top.start_s))
    both = on_common_clock([ground, top], fs_hz=120.0)
    facts = SensorPair(sprung=SensorFacts(gain_tolerance=0.03))
    runs = [Run(name, both, 0.0, clocks=(match,))]
    study = study_of_gear("frame", sprung="top", unsprung="ground", axis="horizontal", sensors=facts, runs=runs)
    fit = identify(study, law="linear", band_hz=(0.5, 30.0)).evidence[0].fit
    (lag,) = (fit.value(fault.name) for fault in fit.model.faults if fault.kind == "lag")
    return match.offset_s - lag
