"""One run as the model takes it: faults of any sensor are undone as they were made, and differentiated; coarse runs."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy import interpolate

from opid.errors import InputError
from opid.mechanics.driven import half_steps
from opid.suspensions.model.run import driven_run
from opid.suspensions.sensor_facts import IDEAL, SensorFacts, Sensors, ideal_sensors
from opid.suspensions.settings import RunSettings
from opid.virtual.taxi_tests.sensors import Sensor, measure

FS, N = 256.0, 4000
LOOSE = SensorFacts(gain_tolerance=0.03, corner_hz=0.4, corner_tolerance=0.3)
LATE = replace(LOOSE, lag_tolerance_s=0.01)
ALL = Sensors(
    (LOOSE, IDEAL, LOOSE),
    (LATE, LOOSE, IDEAL, LATE),
    ("nose", "left", "right", "tail"),
    (("unsprung", 0, 0.05), ("unsprung", 0, 0.05), ("sprung", 1, 0.05), ("unsprung", 1, 0.05), ("sprung", 3, 0.05)),
)
"""Three interfaces and a further sensor, with every kind of fault on either side, alone and together."""
RNG = np.random.default_rng(3)
AWAY = {
    fault.name: fault.nominal + fault.std * float(RNG.uniform(0.3, 0.9)) * (1 - 2 * (k % 2))
    for k, fault in enumerate(ALL.faults)
}


def band_limited(seed, *, low_hz=0.3, high_hz=40.0):
    """Return noise of rms 1 in a band, periodic, so that every operation on it has a closed form by its lines."""
    rng = np.random.default_rng(seed)
    frequency_hz = np.fft.rfftfreq(N, 1 / FS)
    lines = rng.standard_normal((2, frequency_hz.size)).T @ [1, 1j]
    lines[(frequency_hz < low_hz) | (frequency_hz > high_hz)] = 0.0
    samples = np.fft.irfft(lines, N)
    return samples / samples.std()


SIGNALS = np.stack([band_limited(seed) for seed in range(12)], axis=1)


def run_of(unsprung=SIGNALS[:, :3], sprung=SIGNALS[:, 3:7], leaks=SIGNALS[:, 7:12]):
    return driven_run(unsprung, sprung, fs=FS, leaks=leaks)


@pytest.mark.parametrize("side", ["unsprung", "sprung"])
@pytest.mark.parametrize("fault", ALL.faults, ids=lambda fault: fault.name)
@pytest.mark.parametrize("coarse", [False, True])
def test_derivatives_are_the_limits_of_differences(side, fault, coarse):
    run = replace(run_of(), stride=2) if coarse else run_of()
    corrected = partial(run.correct, side)
    by = {name: (channel, column) for name, channel, column in corrected(ALL, AWAY).by}
    step = 1e-6 * max(abs(AWAY[fault.name]), 0.01)
    ahead, behind = (corrected(ALL, AWAY | {fault.name: AWAY[fault.name] + sign * step}).value for sign in (1, -1))
    differences = (ahead - behind) / (2 * step)
    # every fault acts on one channel of one side
    acts = fault.side == side
    assert (fault.name in by) == acts
    others = np.delete(differences, fault.channel, axis=1) if acts else differences
    assert not others.any()
    if acts:
        channel, column = by[fault.name]
        assert channel == fault.channel
        expected = differences[:, channel]
        assert np.abs(expected).max() > 0
        np.testing.assert_allclose(column, expected, atol=2e-6 * np.abs(expected).max())


def test_derivatives_stand_where_the_predictor_takes_them():
    corrected = run_of().correct("sprung", ALL, AWAY)
    directions = corrected.directions(4)
    assert directions.shape == (N, len(corrected.by), 4)
    for place, (_, channel, column) in enumerate(corrected.by):
        np.testing.assert_array_equal(directions[:, place, channel], column)
        assert not np.delete(directions[:, place], channel, axis=1).any()
    assert run_of().correct("sprung", ideal_sensors(3, 4), {}).directions(4) is None


def test_ideal_sensors_change_nothing_but_the_mean():
    run = run_of(SIGNALS[:, :3] + 9.8, SIGNALS[:, 3:7] - 3.0, None)
    sensors = ideal_sensors(3, 4)
    drive, readings = run.correct("unsprung", sensors, {}), run.correct("sprung", sensors, {})
    assert drive.by == readings.by == ()
    below, above = (samples - samples.mean(axis=0) for samples in (SIGNALS[:, :3], SIGNALS[:, 3:7]))
    np.testing.assert_allclose(drive.value, half_steps(below), atol=1e-12)
    np.testing.assert_allclose(readings.value, above, atol=1e-12)


# ---- each fault undone as the virtual sensor makes it ----------------------------------------------


def read(samples, seed=9, across=None, **faults):
    sensor = Sensor(noise_m_per_s2=0.0, **faults)
    return measure(samples, fs=FS, sensor=sensor, rng=np.random.default_rng(seed), cross_axis_acceleration=across)


def one(below=IDEAL, above=IDEAL, leaks=()):
    return Sensors((below,), (above,), ("",), leaks)


# the ends of the record have no neighbours to interpolate by
INTERIOR = slice(50, -50)


@pytest.mark.parametrize("corner_hz", [0.1, 0.33, 0.462])
def test_an_ac_coupling_is_undone(corner_hz):
    """The sensor's filter is the bilinear transform of the coupling, and the trapezoidal rule inverts just that."""
    facts = SensorFacts(corner_hz=corner_hz)
    # behind the coupling an amplifier adds an offset
    reading = read(SIGNALS[:, 0], corner_hz=corner_hz) + 0.05
    run = run_of(reading, reading, None)
    time = np.arange(N) / FS
    for found in (
        run.correct("unsprung", one(facts, facts), {}).value[::2, 0],
        run.correct("sprung", one(facts, facts), {}).value[:, 0],
    ):
        # a straight line is left; with the mean alone taken off it would grow to 0.5 to 2 m/s^2
        slope, constant = np.polyfit(time, found - SIGNALS[:, 0], 1)
        np.testing.assert_allclose(found - SIGNALS[:, 0], slope * time + constant, atol=1e-5)
        assert abs(slope) * time[-1] < 5e-3
    assert np.std((reading - SIGNALS[:, 0])[INTERIOR]) > 0.01


LATE_ABOVE = one(above=SensorFacts(lag_tolerance_s=0.01))


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("samples", [0.2, 0.5, 1.0])
def test_a_lag_is_undone(samples, stride):
    lag_s = samples / FS
    reading = read(SIGNALS[:, 1], lag_s=lag_s)
    run = replace(run_of(SIGNALS[:, 0], reading, None), stride=stride)
    found = run.correct("sprung", LATE_ABOVE, {"lag_s": lag_s}).value[:, 0]
    assert np.std((found - SIGNALS[::stride, 1])[INTERIOR]) < 3e-3
    assert np.std((reading - SIGNALS[:, 1])[INTERIOR]) > 0.1 * samples


def test_at_a_coarse_rate_a_lag_averages_no_noise():
    """Half a sample of lag is a mean of neighbours, and without a filter noise of every frequency is in the band."""
    fs = 4 * FS
    noise = np.random.default_rng(4).standard_normal((2, 40000))
    run = driven_run(noise[0], noise[1], fs=fs).coarse
    assert (run.fs, run.stride) == (FS, 4)

    def power(samples):
        return np.abs(run.transform(samples)) ** 2

    found = [run.correct("sprung", LATE_ABOVE, {"lag_s": lag_s}) for lag_s in (0.0, 0.25 / fs, 0.5 / fs)]
    one_of, *others = (power(each.value[:, 0]).mean() for each in found)
    assert others == pytest.approx([one_of] * 2, rel=0.01)
    # What the lag moves is the noise of the band alone, a quarter of the power of the thinned noise.
    moved = np.mean(run.omega**2) * 2 / run.stride
    assert power(found[2].by[0][2]).mean() == pytest.approx(moved, rel=0.15)


@pytest.mark.parametrize(
    ("fs", "steps", "coarse"), [(256.0, 512.0, 512.0), (512.0, 512.0, 512.0), (1024.0, 1024.0, 512.0)]
)
def test_a_drive_that_was_not_measured_takes_twice_as_many_steps(fs, steps, coarse):
    run = driven_run(SIGNALS[:, 0], SIGNALS[:, :2], fs=fs, n_strut=1, is_driven=False)
    assert (run.fs, run.coarse.fs) == (steps, coarse)
    assert driven_run(SIGNALS[:, 0], SIGNALS[:, 1], fs=fs).coarse.fs == FS


def test_gains_are_divided_out_and_leaks_taken_out_of_the_side_that_they_went_into():
    loose = SensorFacts(gain_tolerance=0.03)
    sensors = one(loose, loose, (("unsprung", 0, 0.05), ("sprung", 0, 0.05)))
    lower = read(SIGNALS[:, 0], gain=1.03, cross_axis=0.03, across=SIGNALS[:, 2])
    upper = read(SIGNALS[:, 1], gain=0.97, cross_axis=-0.02, across=SIGNALS[:, 3])
    run = run_of(lower, upper, SIGNALS[:, 2:4])
    # a leak is a fraction of the reading: this one came in before the gain
    faults = {"gain_unsprung": 1.03, "gain_sprung": 0.97, "leak[0]": 0.03 * 1.03, "leak[1]": -0.02 * 0.97}
    np.testing.assert_allclose(run.correct("unsprung", sensors, faults).value[::2, 0], SIGNALS[:, 0], atol=1e-12)
    np.testing.assert_allclose(run.correct("sprung", sensors, faults).value[:, 0], SIGNALS[:, 1], atol=1e-12)


# ---- lines, rates ----------------------------------------------------------------------------------


def test_the_lines_are_those_of_the_band_and_of_unit_noise():
    run = driven_run(SIGNALS[:, 0], SIGNALS[:, 1], fs=FS, band_hz=(0.5, 20.0))
    frequency_hz = run.omega / (2 * np.pi)
    assert (frequency_hz[0], frequency_hz[-1]) == pytest.approx((0.5, 20.0), abs=FS / N)
    np.testing.assert_allclose(frequency_hz, np.fft.rfftfreq(run.n_samples, 1 / FS)[run.lines])
    noise = np.random.default_rng(0).standard_normal((20, run.n_samples))
    lines = run.transform(noise)
    assert lines.shape == (20, run.omega.size)
    np.testing.assert_allclose([lines.real.std(), lines.imag.std()], 1.0, rtol=0.03)
    # no sensor says anything near half the sampling rate
    assert driven_run(SIGNALS[:, 0], SIGNALS[:, 1], fs=FS, band_hz=(0.5, 500.0)).omega[-1] <= 0.4 * FS * 2 * np.pi


def test_a_slow_log_is_sampled_finer():
    run = driven_run(SIGNALS[:, :3], SIGNALS[:, 3:6], fs=100.0)
    assert (run.finer, run.fs, run.n_samples) == (3, 300.0, 3 * N)
    np.testing.assert_allclose(run.sprung[::3], SIGNALS[:, 3:6] - SIGNALS[:, 3:6].mean(axis=0), atol=4e-3)
    assert run.omega[-1] <= 2 * np.pi * 40.0
    with_settings = driven_run(SIGNALS[:, :3], SIGNALS[:, 3:6], fs=100.0, settings=RunSettings(lowest_rate_hz=90.0))
    assert with_settings.finer == 1


@pytest.mark.parametrize(
    ("fs", "band_hz", "stride"),
    [(256.0, (0.3, 40.0), 1), (512.0, (0.3, 150.0), 1), (512.0, (0.3, 100.0), 2), (2000.0, (0.3, 40.0), 8)],
)
def test_a_run_is_thinned_as_far_as_its_steps_and_its_band_allow(fs, band_hz, stride):
    noise = np.random.default_rng(0).standard_normal((round(10 * fs), 2))
    run = driven_run(noise[:, :1], noise[:, 1:], fs=fs, band_hz=band_hz)
    coarse = run.coarse
    assert (coarse is run) == (stride == 1)
    assert (coarse.stride, coarse.fs) == (stride, fs / stride)
    drive = coarse.correct("unsprung", ideal_sensors(1, 1), {}).value
    assert drive.shape == (2 * coarse.n_samples - 1, 1)
    assert coarse.n_samples * stride <= len(noise)
    # readings are compared as they are, at the instants of the steps
    readings = coarse.correct("sprung", ideal_sensors(1, 1), {}).value
    np.testing.assert_array_equal(readings, run.sprung[::stride][: coarse.n_samples])
    # the same band, but for the few samples that make no even number of steps
    assert coarse.omega[-1] == pytest.approx(run.omega[-1], rel=0.01)


def test_a_slow_drive_is_the_same_at_a_coarse_rate_and_what_would_fold_is_gone():
    def at_a_coarse_rate(hz, fs, n):
        wave = np.sin(2 * np.pi * hz * np.arange(n) / fs)[:, np.newaxis]
        coarse = driven_run(wave, wave, fs=fs).coarse
        # a filter needs some samples at either end
        return coarse, coarse.correct("unsprung", ideal_sensors(1, 1), {}).value[200:-200, 0]

    coarse, drive = at_a_coarse_rate(10.0, 2000.0, 20_000)
    time = np.arange(200, 200 + drive.size) / (2 * coarse.fs)
    assert np.abs(drive - np.sin(2 * np.pi * 10 * time)).max() < 2e-3
    assert np.abs(at_a_coarse_rate(240.0, 512.0, 5120)[1]).max() < 2e-3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"unsprung": SIGNALS[:-1, 0]}, r"unsprung has shape \(3999, 1\), .*: give runs of one length"),
        ({"leaks": SIGNALS[:-1, 2:4]}, r"leaks \(3999, 2\): give runs of one length"),
        ({"band_hz": (5, 6)}, r"the band 5 to 6 Hz holds 15 lines of a run of 15.6 s: give a longer run or a wider"),
        ({"band_hz": (6, 5)}, "band"),
    ],
)
def test_what_makes_no_run_is_refused(arguments, words):
    given = {"unsprung": SIGNALS[:, 0], "sprung": SIGNALS[:, 1], "leaks": None, **arguments}
    with pytest.raises(InputError, match=words):
        driven_run(given.pop("unsprung"), given.pop("sprung"), fs=FS, **given)


def test_the_ground_is_integrated_from_where_it_stays_near_its_mean_height():
    """A known path under an offset accelerometer: start values are those of the path, and well within their spread."""
    t, offset = np.arange(20 * int(FS)) / FS, 0.02
    heights = np.stack([0.01 * np.sin(2 * np.pi * 0.4 * t + 1), 0.03 * np.cos(2 * np.pi * 0.7 * t)], axis=1)
    rates = np.array([2 * np.pi * 0.4, 2 * np.pi * 0.7])
    run = driven_run(offset - rates**2 * heights, 0 * heights, fs=FS)
    start, covariance = run.ground_at_start
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)).T
    speeds = rates * np.array([0.01 * np.cos(1), 0.0])
    truth = np.stack([heights[0], speeds, np.full(2, -(run.unsprung + rates**2 * heights).mean())])
    assert np.all(np.abs(start - truth) < 0.5 * std)
    # the rougher path may hide more
    assert np.all(std[:, 1] > 1.5 * std[:, 0])
    assert np.all(std[0] < 0.5)


def test_pieces_of_a_run_are_its_samples_with_its_lines():
    run = driven_run(SIGNALS[:, :1], SIGNALS[:, 1:2], fs=100.0, band_hz=(1.0, 20.0))
    first, second = run.split(2)
    half = len(run.sprung) // 2
    for piece, begin in ((first, 0), (second, half)):
        own = run.sprung[begin : begin + len(piece.sprung)]
        np.testing.assert_allclose(piece.sprung, own - own.mean(axis=0))
        assert 0.9 * half < len(piece.sprung) <= half
        assert run.omega[0] <= piece.omega[0] <= piece.omega[-1] <= run.omega[-1] * (1 + 1e-6)


def test_the_strongest_piece_is_the_one_in_which_the_body_moves_most():
    quiet_then_strong = np.where(np.arange(len(SIGNALS)) < 0.6 * len(SIGNALS), 1.0, 3.0)[:, np.newaxis] * SIGNALS
    run = driven_run(quiet_then_strong[:, :1], quiet_then_strong[:, 1:2], fs=100.0, band_hz=(1.0, 20.0))
    length_s = run.n_samples / run.fs
    piece = run.strongest_piece(0.24 * length_s)
    assert piece.n_samples / piece.fs == pytest.approx(length_s / 4, rel=0.1)
    assert piece.sprung.std() == max(each.sprung.std() for each in run.split(4))
    assert run.strongest_piece(0.6 * length_s) is run
    narrow = driven_run(SIGNALS[:, :1], SIGNALS[:, 1:2], fs=100.0, band_hz=(1.0, 1.0 + 25 / length_s))
    assert narrow.strongest_piece(0.24 * length_s) is narrow
    slow = driven_run(SIGNALS[:, :1], SIGNALS[:, 1:2], fs=100.0, band_hz=(6 / length_s, 20.0))
    assert slow.strongest_piece(0.24 * length_s) is slow


def test_a_band_that_ends_low_needs_few_steps():
    """Ten samples of the highest line are followed, not those of a gear."""
    usual = driven_run(SIGNALS[:, :1], SIGNALS[:, 1:2], fs=100.0)
    low = RunSettings(band_hz=(0.1, 8.0))
    assert usual.finer == 3
    slow = driven_run(SIGNALS[:, :1], SIGNALS[:, 1:2], fs=100.0, settings=low)
    assert slow.finer == 1
    assert slow.recorded_fs == 100.0


@pytest.mark.parametrize("steps", [0.3, -0.4, 2.6, -3.2])
def test_a_delay_is_that_of_a_quintic_spline_and_is_held_beyond_the_ends(steps):
    """Beside scipy's spline through the same samples, whose ends are made in another way."""
    late = ideal_sensors(1, 1).changed("sprung", 0, lag_tolerance_s=0.1)
    samples = SIGNALS[:, 3]
    run = driven_run(SIGNALS[:, 0], samples, fs=FS)
    corrected = run.correct("sprung", late, {late.faults[0].name: steps / FS})
    spline = interpolate.make_interp_spline(np.arange(N), samples, k=5)
    place = np.arange(N) + steps
    inner = slice(40, -40)
    np.testing.assert_allclose(corrected.value[inner, 0], spline(place)[inner], atol=1e-7)
    np.testing.assert_allclose(corrected.by[0][2][inner], FS * spline(place, 1)[inner], atol=1e-5)
    outside = (place < 0) | (place > N - 1)
    assert outside.any()
    np.testing.assert_allclose(corrected.value[outside, 0], samples[0 if steps < 0 else -1], atol=1e-9)
    np.testing.assert_array_equal(corrected.by[0][2][outside], 0.0)
