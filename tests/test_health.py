"""What is wrong with a recording: seeded faults are found, sound signals are left in peace."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from opid.errors import InputError
from opid.signals.health.across_channels import check_magnitudes, check_pair
from opid.signals.health.inspection import inspect
from opid.signals.health.spikes import remove_spikes
from opid.signals.log import Log, LoggedChannel, Track, rows_of_array
from opid.signals.recording import Channel, Recording, recording_from_arrays
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.sensors import Sensor
from opid.virtual.taxi_tests.taxiing import taxi_run

FS = 512.0
N = 10240
NAMES = ("lower_z", "upper_z")


def vibration(seed=0, n_samples=N):
    """Return a resonance at 15 Hz with rms 1 under noise whose level falls to a tenth, like a braking run."""
    drive = np.random.default_rng(seed).standard_normal(n_samples + 512)
    motion = np.zeros(drive.size)
    pole = np.exp((-0.1 + 1j) * 2 * np.pi * 15.0 / FS)
    for k in range(2, drive.size):
        motion[k] = 2 * pole.real * motion[k - 1] - abs(pole) ** 2 * motion[k - 2] + drive[k]
    motion = motion[512:] / motion[512:].std() * np.linspace(1.0, 0.1, n_samples)
    return motion / motion.std()


SOUND = vibration()


def health_of(samples, unit="m/s^2", start_s=0.0):
    return inspect(Recording(samples[:, None], fs=FS, channels=(Channel("upper_z", unit),), start_s=start_s))


def messages(health):
    return [finding.message for finding in health.findings]


def test_figures_in_closed_form():
    phase = 2 * np.pi * 16.0 * np.arange(N) / FS
    health = health_of(0.25 + 2.0 * np.sin(phase))
    (channel,) = health.channels
    assert (health.fs, health.n_samples, health.duration_s) == (FS, N, 20.0)
    assert channel.mean == pytest.approx(0.25)
    assert channel.rms == pytest.approx(np.sqrt(2))
    assert channel.peak == pytest.approx(2.0)
    assert channel.crest_factor == pytest.approx(np.sqrt(2))
    assert channel.high_frequency_rms == pytest.approx(np.sqrt(2), rel=1e-6)
    assert (channel.clipped_fraction, channel.spikes, channel.mute) == (0.0, 0, False)


def test_the_high_frequency_rms_leaves_out_what_lies_below_5_hz():
    time_s = np.arange(N) / FS
    slow, fast = 3.0 * np.sin(2 * np.pi * 2.0 * time_s), 0.1 * np.sin(2 * np.pi * 20.0 * time_s)
    assert health_of(slow + fast).channels[0].high_frequency_rms == pytest.approx(0.1 / np.sqrt(2), rel=1e-3)


@pytest.mark.parametrize("bits", [None, 24, 16, 12, 10])
@pytest.mark.parametrize("seed", range(4))
def test_a_sound_signal_of_any_resolution_has_no_findings(bits, seed):
    samples = vibration(seed)
    if bits is not None:
        step = 40.0 / 2**bits
        samples = step * np.round(samples / step)
    assert messages(health_of(samples)) == []


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
@pytest.mark.parametrize("gain", [1.0, 9.80665])
def test_the_quantisation_step_is_found(bits, gain):
    step = 40.0 / 2**bits
    channel = health_of(gain * (step * np.round(SOUND / step))).channels[0]
    assert channel.quantisation_step == pytest.approx(gain * step, rel=1e-6)


def test_no_quantisation_step_is_invented():
    assert health_of(SOUND).channels[0].quantisation_step is None


def test_a_coarse_resolution_is_reported():
    health = health_of(0.5 * np.round(SOUND / 0.5))
    assert any("steps of the resolution (0.5 m/s^2)" in message for message in messages(health))


@pytest.mark.parametrize("step", [None, 40 / 2**12, 40 / 2**16])
@pytest.mark.parametrize("limits", [(-2.0, 2.0), (-100.0, 1.5)])
def test_clipping_is_found_and_measured(limits, step):
    clipped = np.clip(SOUND if step is None else step * np.round(SOUND / step), *limits)
    health = health_of(clipped)
    beyond = np.mean((clipped == limits[0]) | (clipped == limits[1]))
    # peaks that were cut for one or two samples are not counted
    assert 0.5 * beyond < health.channels[0].clipped_fraction <= beyond
    assert "clipped" in messages(health)[0]
    assert health.findings[0].severity == "warning"


def test_the_rounded_tops_of_a_coarse_sine_are_not_clipping():
    sine = np.round(50 * np.sin(2 * np.pi * 2.0 * np.arange(N) / FS + 0.1))
    assert health_of(sine, unit="m").channels[0].clipped_fraction == 0.0


def test_spikes_are_counted_and_placed():
    samples = SOUND.copy()
    samples[[1000, 5000, 9000]] += [20.0, -20.0, 5.0]
    health = health_of(samples, start_s=10.0)
    assert health.channels[0].spikes == 3
    assert f"3 spike(s) of one sample, the first at {10 + 1000 / FS:.4f} s" in messages(health)[0]


@pytest.mark.parametrize("height", [5.0, 20.0, -100.0])
def test_spikes_are_mended_and_nothing_else_is_touched(height):
    samples, places = SOUND.copy(), [1000, 5000, 9000]
    samples[places] += height
    before = samples.copy()
    mended, found = remove_spikes(samples, fs=FS)
    assert found.tolist() == places
    np.testing.assert_array_equal(samples, before)
    np.testing.assert_array_equal(np.delete(mended, places), np.delete(SOUND, places))
    between = [(4 * (SOUND[k - 1] + SOUND[k + 1]) - SOUND[k - 2] - SOUND[k + 2]) / 6 for k in places]
    np.testing.assert_allclose(mended[places], between, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_a_sound_signal_is_left_as_it_is(seed):
    mended, found = remove_spikes(vibration(seed), fs=FS)
    assert found.size == 0
    np.testing.assert_array_equal(mended, vibration(seed))


@pytest.mark.parametrize("start", [2048, 2200, 2400, 2530])
@pytest.mark.parametrize("kind", ["held", "quiet"])
def test_good_samples_beside_a_long_dropout_are_no_spikes(start, kind):
    samples = np.random.default_rng(0).standard_normal(N)
    samples[start : start + 500] = samples[start] if kind == "held" else 1e-6 * samples[start : start + 500]
    assert remove_spikes(samples, fs=FS)[1].size == 0
    assert health_of(samples).channels[0].spikes == 0
    samples[[start - 40, start + 540]] += 30.0
    assert remove_spikes(samples, fs=FS)[1].tolist() == [start - 40, start + 540]
    assert health_of(samples).channels[0].spikes == 2


@pytest.mark.parametrize("noise", [0.0, 1e-4, 0.02, 0.1])
@pytest.mark.parametrize("limit", [0.3, 0.7, 0.95])
def test_a_clipped_sine_has_no_spikes_and_a_spike_does_not_hide_the_clipping(noise, limit):
    sine = np.sin(2 * np.pi * 3 * np.arange(N) / FS + 0.2) + noise * np.random.default_rng(0).standard_normal(N)
    clipped = np.clip(sine, -limit, limit)
    health = health_of(clipped)
    part = health.channels[0].clipped_fraction
    assert health.channels[0].spikes == remove_spikes(clipped, fs=FS)[1].size == 0
    assert part > 0.05
    clipped[[3000, 6000]] = [50.0, -40.0]
    spiky = health_of(clipped)
    assert spiky.channels[0].clipped_fraction == pytest.approx(part, abs=0.001)
    # inside a value that is held for long a spike is not told from its end
    assert spiky.channels[0].spikes == (2 if limit > 0.5 else 1)
    assert f"clipped at -{limit:g} or {limit:g} m/s^2" in messages(spiky)[0]


@pytest.mark.parametrize("bits", [8, 10, 16])
def test_levels_near_the_largest_of_a_sound_signal_are_not_clipping(bits):
    step = 12.0 / 2**bits
    for seed in range(4):
        slow = np.convolve(np.random.default_rng(seed).standard_normal(N + 199), np.ones(200) / 14, mode="valid")
        samples = step * np.round(slow / step)
        samples[[500, 700]] = [80.0 * step, -90.0 * step]
        assert health_of(samples).channels[0].clipped_fraction == 0.0


def test_an_unknown_unit_is_not_written_as_one():
    track = LoggedChannel("raw", None)
    clipped = np.clip(SOUND, -1.0, 1.0)[:, None]
    log = Log(Path("x"), "made", (Track((track,), rows_of_array(clipped), FS, n_samples=N),))
    (message,) = [each for each in messages(inspect(log)) if "clipped" in each]
    assert "clipped at -1 or 1, the first at" in message


def test_a_record_of_less_than_a_block_is_left_as_it_is():
    samples = np.zeros(100)
    samples[50] = 100.0
    assert remove_spikes(samples, fs=FS)[1].size == 0


def test_an_impact_that_rings_is_no_spike():
    samples = SOUND.copy()
    time_s = np.arange(N - 5000) / FS
    samples[5000:] += 30 * np.exp(-20 * time_s) * np.sin(2 * np.pi * 15 * time_s)
    assert health_of(samples).channels[0].spikes == 0


def test_a_dropout_is_found_and_placed():
    samples = SOUND.copy()
    samples[2048:2304] = samples[2048]
    health = health_of(samples)
    assert health.channels[0].longest_flat_s == pytest.approx(255 / FS)
    assert "one value is held for 0.498 s from 4.000 s" in messages(health)[0]


def test_a_channel_that_dies_during_the_run_is_found():
    samples = SOUND.copy()
    samples[N // 2 :] = 0.0
    assert f"one value is held for {(N // 2 - 1) / FS:.3g} s from 10.000 s" in messages(health_of(samples))[0]


def test_a_standstill_below_the_resolution_is_no_dropout():
    step = 40 / 2**12
    samples = SOUND * np.exp(-np.arange(N) / (2 * FS))
    assert health_of(step * np.round(samples / step)).channels[0].longest_flat_s > 1.0
    assert messages(health_of(step * np.round(samples / step))) == []


@pytest.mark.parametrize("samples", [np.zeros(N), np.full(N, 9.81), np.arange(N) % 2 * 1e-3])
def test_a_mute_channel_is_a_fault(samples):
    health = health_of(samples)
    assert health.channels[0].mute
    assert [finding.severity for finding in health.findings] == ["fault"]
    assert messages(health)[0].startswith("mute")


@pytest.mark.parametrize(
    ("offset", "words"),
    [(9.79, "is gravity"), (-9.85, "is gravity"), (1.01, "in g: check the unit"), (3.0, "offset")],
)
def test_offsets_are_noted(offset, words):
    health = health_of(SOUND + offset)
    assert words in messages(health)[0]
    assert health.findings[0].severity == "note"
    assert messages(health_of(SOUND + offset, unit="m")) == []


def test_faults_stand_first_and_two_samples_are_enough():
    run = recording_from_arrays([SOUND + 9.8, np.zeros(N)], ["a", "b"], fs=FS)
    assert [finding.severity for finding in inspect(run).findings] == ["fault", "note"]
    assert health_of(np.array([0.0, 1.0])).n_samples == 2


def test_what_is_no_log_is_refused_in_a_sentence():
    with pytest.raises(InputError, match="what is of type str: give a Log, as open_log makes one, or a Recording"):
        inspect("heavy.csv")


# ---- which side is which -------------------------------------------------------------------------


def airframe(wheel):
    """Return what a suspension at 2 Hz lets through: the mean over a tenth of a second."""
    return np.convolve(wheel, np.ones(51) / 51, mode="same")


def test_the_wheel_side_is_recognised():
    run = recording_from_arrays([airframe(SOUND), SOUND], ["a", "b"], fs=FS)
    assert inspect(run).looks_unsprung == "b"
    unrelated = recording_from_arrays([airframe(SOUND[::-1]), SOUND], ["a", "b"], fs=FS)
    assert inspect(unrelated).looks_unsprung is None
    three = recording_from_arrays([airframe(SOUND), SOUND, SOUND], ["a", "b", "c"], fs=FS)
    assert inspect(three).looks_unsprung is None
    assert inspect(recording_from_arrays([SOUND], ["a"], fs=FS)).looks_unsprung is None
    assert inspect(recording_from_arrays([SOUND, SOUND], ["a", "b"], fs=FS, unit="m")).looks_unsprung is None


@pytest.mark.parametrize("channel", [0, 1])
def test_values_that_no_sensor_measures_are_refused_before_they_overflow(channel):
    pair = [SOUND, airframe(SOUND)]
    pair[channel] = 1e160 * pair[channel]
    with pytest.raises(InputError, match=rf"'{NAMES[channel]}' reaches \S+e\+16\d m/s\^2: check its unit and scale"):
        check_pair(*pair, fs=FS, names=NAMES)


def test_a_sound_pair_passes_and_a_swapped_one_is_told():
    assert check_pair(SOUND, airframe(SOUND), fs=FS, names=NAMES) == ()
    (finding,) = check_pair(airframe(SOUND), SOUND, fs=FS, names=NAMES)
    assert finding.severity == "warning"
    assert "'lower_z'" in finding.message
    assert "exchange sprung and unsprung" in finding.message


@pytest.mark.parametrize("natural_hz", [3.0, 10.0, 16.0])
@pytest.mark.parametrize("zeta", [0.02, 0.1, 0.3])
def test_a_body_that_moves_more_than_its_ground_is_not_called_swapped(natural_hz, zeta):
    """Above 5 Hz a stiff suspension, and a frame that is hardly damped, amplify; the phase says which side drives."""
    omega, ground = 2 * np.pi * natural_hz, np.random.default_rng(3).standard_normal(8 * N)
    suspension = signal.lti([2 * zeta * omega, omega**2], [1, 2 * zeta * omega, omega**2])
    body = signal.lsim(suspension, ground, np.arange(8 * N) / FS)[1]
    assert check_pair(ground, body, fs=FS, names=NAMES) == ()


def test_a_soft_suspension_whose_channels_are_exchanged_is_told(taxi):
    (finding,) = check_pair(*taxi[::-1], fs=128.0, names=NAMES)
    assert finding.severity == "warning"
    assert "exchange sprung and unsprung" in finding.message


def test_a_strut_locked_by_friction_is_not_called_swapped():
    noise = 0.005 * np.random.default_rng(1).standard_normal((2, N))
    assert check_pair(SOUND + noise[0], SOUND + noise[1], fs=FS, names=NAMES) == ()


@pytest.mark.parametrize("dead", [np.zeros(N), np.full(N, 0.3), 1e-4 * np.random.default_rng(2).standard_normal(N)])
@pytest.mark.parametrize("side", [0, 1])
def test_a_mute_side_is_refused(dead, side):
    pair = [dead, SOUND] if side == 0 else [SOUND, dead]
    with pytest.raises(InputError, match=f"the channel '{NAMES[side]}' is mute"):
        check_pair(*pair, fs=FS, names=NAMES)


def test_a_nearly_mute_side_is_told():
    hiss = 0.005 * np.random.default_rng(2).standard_normal(N)
    (finding,) = check_pair(SOUND, hiss, fs=FS, names=NAMES)
    assert finding.channel == "upper_z"
    assert "noise alone" in finding.message


@pytest.fixture(scope="module")
def taxi():
    """The accelerations of a gear and of its airframe over 25 s."""
    log = taxi_run(LandingGear(), rng=np.random.default_rng(0), duration_s=25, fs=128).recording
    return log.channel("lower_z"), log.channel("upper_z")


@pytest.mark.parametrize(
    ("apart", "larger", "smaller"), [(9.80665, "g", "m/s^2"), (1e3, "m/s^2", "mm/s^2"), (9806.65, "g", "mm/s^2")]
)
@pytest.mark.parametrize("side", [0, 1])
def test_a_side_in_another_unit_is_refused_and_the_units_are_named(taxi, side, apart, larger, smaller):
    large, small = NAMES[side], NAMES[1 - side]
    words = (
        f"^{large!r} moves .* times as much as {small!r} from 0.3 to 0.8 Hz.*: either {large!r} is written in "
        rf"{re.escape(smaller)} and was read as {re.escape(larger)}, or {small!r} is written in {re.escape(larger)} "
    )
    pair = [samples * (apart if k == side else 1.0) for k, samples in enumerate(taxi)]
    with pytest.raises(InputError, match=words):
        check_pair(*pair, fs=128.0, names=NAMES)
    # whichever of the two it is that is wrong
    pair = [samples / (1.0 if k == side else apart) for k, samples in enumerate(taxi)]
    with pytest.raises(InputError, match=words):
        check_pair(*pair, fs=128.0, names=NAMES)


@pytest.mark.parametrize("corners_hz", [(0.0, 0.0), (0.33, 0.33), (0.33, 0.0), (0.0, 0.5), (3.0, 0.0), (0.0, 3.0)])
@pytest.mark.parametrize("gain", [0.3, 1.0, 3.0])
def test_no_suspension_coupling_or_false_gain_is_taken_for_a_unit(corners_hz, gain):
    below, above = (Sensor(corner_hz=corner) for corner in corners_hz)
    for seed, stiffness in enumerate((1.5e5, 6e5)):
        gear = LandingGear(suspension_stiffness_n_per_m=stiffness)
        rng = np.random.default_rng(seed)
        log = taxi_run(gear, rng=rng, duration_s=20, fs=128, lower_sensor=below, upper_sensor=above).recording
        found = check_pair(log.channel("lower_z"), gain * log.channel("upper_z"), fs=128.0, names=NAMES)
        assert all("exchange sprung and unsprung" in each.message for each in found)


def test_unrelated_signals_and_short_ones_tell_nothing_of_units(taxi):
    noise = np.random.default_rng(0).standard_normal((2, 12800))
    assert check_pair(9.8 * noise[0], noise[1], fs=128.0, names=NAMES) == ()
    lower, upper = (samples[:1280] for samples in taxi)
    assert check_pair(9.80665 * lower, upper, fs=128.0, names=NAMES) == ()


@pytest.mark.parametrize(
    ("factor", "mean", "words"),
    [(1.0, 0.0, None), (1e3, 0.0, "are they written in mm/s"), (0.1, 1.01, "gravity in g"), (1.0, 9.81, None)],
)
def test_levels_that_no_vehicle_has_are_asked_about(taxi, factor, mean, words):
    log = recording_from_arrays([factor * samples + mean for samples in taxi], NAMES, fs=128.0)
    found = [finding.message for finding in check_magnitudes(log, NAMES)]
    assert len(found) == (words is not None)
    assert all(words in message for message in found)


def test_one_signal_twice_is_refused():
    with pytest.raises(InputError, match="the same signal"):
        check_pair(SOUND, SOUND, fs=FS, names=NAMES)


def test_a_thermometer_at_rest_is_not_mute_but_an_accelerometer_is():
    rng = np.random.default_rng(0)
    two = 27.2 + 0.1 * (rng.random(2000) < 0.5)
    for unit, values, severities in (
        ("degC", two, []),
        ("degC", np.full(2000, 27.2), ["note"]),
        ("m/s^2", two, ["fault"]),
        ("m/s^2", np.zeros(2000), ["fault"]),
    ):
        run = recording_from_arrays([values], ["a"], fs=FS, unit=unit)
        assert [finding.severity for finding in inspect(run).findings] == severities, (unit, values[:3])


def test_stamps_that_never_move_are_no_clock():
    channels = (LoggedChannel("a", "m/s^2"),)
    track = Track(channels, rows_of_array(np.random.default_rng(0).standard_normal((500, 1)), np.zeros(500)))
    (finding,) = [
        f for f in inspect(Log(Path("a.x"), "X", (track,))).findings if not f.channel and f.severity == "fault"
    ]
    assert finding.message == "all 500 time stamps are 0 s, which is no clock: state the rate (fs_hz in [log])"
