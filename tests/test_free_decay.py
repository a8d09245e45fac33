import numpy as np
import pytest
from made_decays import SENSED_FS, SENSED_K3, SENSED_OMEGA, decay_at_sensors, two_close_modes
from scipy.integrate import solve_ivp

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.response import time_response
from opid.mechanics.structure import Joint, Structure, iwan
from opid.modal.decay.free_decay import decay_of, free_decay, pool_decays
from opid.modal.forced.mode_tests import check_shapes
from opid.modal.linear.modes import LinearModes, modal_test
from opid.modal.settings import MODAL
from opid.signals.recording import recording_from_arrays

FS = 4096.0
QUIET = 2000
OMEGA = 2.0 * np.pi * 120.0
LEVEL = 1e-4
# -3 % of the frequency and twice the damping at the first amplitude
K0, C0 = OMEGA**2, 0.008 * OMEGA
K3, C2 = -0.08 * K0 / LEVEL**2, C0 / (8.0 / (3.0 * np.pi) * OMEGA * LEVEL)


def motion(duration_s=2.5, level=LEVEL):
    """Displacement, velocity and acceleration of a softening spring with quadratic damping after an impact."""

    def force(q, v):
        return C0 * v + C2 * v * np.abs(v) + K0 * q + K3 * q**3

    time = np.arange(round(duration_s * FS)) / FS
    solution = solve_ivp(
        lambda _, y: [y[1], -force(*y)], (0.0, time[-1]), [0.0, OMEGA * level], "DOP853", time, rtol=1e-8, atol=1e-14
    )
    q, v = solution.y
    return q, v, -force(q, v)


@pytest.fixture(scope="module")
def clean():
    return motion()


def frequency_of(amplitude):
    return np.sqrt(K0 + 0.75 * K3 * amplitude**2) / (2.0 * np.pi)


def damping_of(amplitude):
    omega = 2.0 * np.pi * frequency_of(amplitude)
    return (C0 + C2 * 8.0 / (3.0 * np.pi) * omega * amplitude) / (2.0 * omega)


def record(signal, noise=0.01, seed=0):
    """The signal after a quiet start, in white noise of a fraction of its rms."""
    whole = np.concatenate([np.zeros(QUIET), signal])
    return whole + noise * signal.std() * np.random.default_rng(seed).standard_normal(whole.size)


def ringing(size, frequency_hz, zeta, height):
    time = np.maximum((np.arange(size) - QUIET) / FS, 0.0)
    omega = 2.0 * np.pi * frequency_hz
    return height * np.exp(-zeta * omega * time) * np.sin(omega * time)


def errors(decay):
    """Relative errors of frequency and damping in the upper nine tenths of the amplitudes."""
    top = decay.amplitude > 0.1 * decay.amplitude.max()
    return (
        np.abs(decay.frequency_hz / frequency_of(decay.amplitude) - 1.0)[top],
        np.abs(decay.damping_ratio / damping_of(decay.amplitude) - 1.0)[top],
    )


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_frequency_and_damping_follow_the_amplitude_whatever_is_measured(clean, quantity):
    signal = dict(zip(("displacement", "velocity", "acceleration"), clean, strict=True))[quantity]
    decay = free_decay(record(signal), fs=FS, quantity=quantity)
    assert decay.start_s == pytest.approx(QUIET / FS, abs=2.0 / 120.0)
    assert decay.amplitude[0] > 0.85 * LEVEL
    by_frequency, by_damping = errors(decay)
    assert by_frequency.max() < 2e-4
    assert by_damping.max() < 0.03
    assert decay.warnings == ()
    assert decay.amplitude_unit == "m"
    used = np.isfinite(decay.envelope)
    assert np.abs(decay.signal[used]).max() < 1.15 * decay.envelope[used].max()


def test_neither_input_nor_scale_matters(clean):
    samples = record(clean[2])
    before = samples.copy()
    one, other = free_decay(samples, fs=FS), free_decay(-1e3 * samples, fs=FS)
    np.testing.assert_array_equal(samples, before)
    np.testing.assert_allclose(one.frequency_hz, other.frequency_hz, rtol=1e-7)
    np.testing.assert_allclose(1e3 * one.amplitude, other.amplitude, rtol=1e-6)


def spoilt(signal, how):
    x = record(signal)
    top, time = np.abs(signal).max(), np.arange(x.size) / FS
    return {
        "spike of the impact": x + 4.0 * top * np.exp(-0.5 * ((time - QUIET / FS - 5e-4) / 3e-4) ** 2),
        "hum": x + 0.5 * top * np.sin(2 * np.pi * 50.0 * time + 1.0),
        "offset and trend": x + top * (3.0 + 2.0 * time),
        "discharge": x + 2.0 * top * (time > QUIET / FS) * np.exp(-(time - QUIET / FS) / 0.3),
        "16 bits": np.round(x / top * 2**15) / 2**15 * top,
        "other modes": x + ringing(x.size, 310.0, 0.006, 0.8 * top) + ringing(x.size, 47.0, 0.01, 0.1 * top),
        "two impacts": np.concatenate([x, 0.8 * x]),
        "a dwell before": np.concatenate([top * np.sin(2 * np.pi * 116.4 * np.arange(-4000, 0) / FS), x[QUIET:]]),
        "the end cut off": x[: QUIET + round(0.5 * FS)],
    }[how]


@pytest.mark.slow
@pytest.mark.parametrize(
    "how",
    [
        "spike of the impact",
        "hum",
        "offset and trend",
        "discharge",
        "16 bits",
        "other modes",
        "two impacts",
        "a dwell before",
        "the end cut off",
    ],
)
def test_what_spoils_a_record_is_left_out(clean, how):
    decay = free_decay(spoilt(clean[2], how), fs=FS, near_hz=119.0)
    by_frequency, by_damping = errors(decay)
    assert by_frequency.max() < 3e-4
    assert by_damping.max() < 0.05
    assert decay.frequency_low_hz.value == pytest.approx(120.0, abs=0.02)


@pytest.mark.parametrize("apart", [1.05, 1.08, 1.2])
def test_a_neighbour_is_fitted_beside_the_mode(clean, apart):
    x = record(clean[2])
    neighbour = 120.0 * apart
    decay = free_decay(x + ringing(x.size, neighbour, 0.005, 0.5 * np.abs(clean[2]).max()), fs=FS)
    assert min(abs(f - neighbour) for f in decay.track.neighbours_hz) < 0.5
    by_frequency, _ = errors(decay)
    assert by_frequency.max() < 2e-3
    assert decay.frequency_low_hz.value == pytest.approx(120.0, abs=0.05)


def test_clipped_samples_are_left_out_and_told(clean):
    x = record(clean[2])
    limit = 0.4 * np.abs(clean[2]).max()
    decay = free_decay(np.clip(x, -limit, limit), fs=FS)
    assert "clipped" in decay.warnings[0]
    assert decay.amplitude[0] < 0.4 * LEVEL
    assert errors(decay)[0].max() < 2e-4


def test_modes_that_beat_are_told_or_refused(clean):
    x = record(clean[2])
    both = x + ringing(x.size, 121.0, 0.004, 0.7 * np.abs(clean[2]).max())
    try:
        warnings = free_decay(both, fs=FS).warnings
    except NotDeterminedError as why:
        warnings = (str(why),)
    assert "beat" in " ".join(warnings)


def test_the_standard_deviations_are_those_of_the_scatter(clean):
    scores = []
    for seed in range(5):
        decay = free_decay(record(clean[2], noise=0.03, seed=seed), fs=FS)
        top = decay.amplitude > 0.05 * LEVEL
        scores.append(((decay.frequency_hz - frequency_of(decay.amplitude)) / decay.frequency_std_hz)[top])
        scores.append(((decay.damping_ratio - damping_of(decay.amplitude)) / decay.damping_std)[top])
    assert 0.6 < np.sqrt(np.mean(np.concatenate(scores) ** 2)) < 1.4


def slipping(joint, amplitude, stiffness, damping):
    """Natural frequency (Hz) and damping ratio of Jenkins elements by harmonic linearisation, in closed form."""
    reach, k = joint.slip_force_n / joint.stiffness_n_per_m, joint.stiffness_n_per_m
    x = amplitude[:, None]
    angle = np.arccos(np.clip(1.0 - 2.0 * reach / x, -1.0, 1.0))
    omega = np.sqrt(stiffness + np.sum(k / np.pi * (angle - 0.5 * np.sin(2.0 * angle)), axis=1))
    energy = np.sum(np.where(x > reach, 4.0 * k * reach * (x - reach), 0.0), axis=1)
    return omega / (2.0 * np.pi), (damping + energy / (np.pi * omega * amplitude**2)) / (2.0 * omega)


def test_a_bolted_joint_shows_its_backbone():
    joint = iwan(stiffness_n_per_m=0.1 * K0, slip_force_n=0.12 * K0 * LEVEL, n=40)
    rest, damping = 0.9 * K0, 0.004 * OMEGA
    structure = Structure([[1.0]], [[damping]], [[rest]], (Joint("bolt", np.array([1.0]), sliders=joint),))
    ring = time_response(
        structure,
        lambda t: np.zeros((t.size, 1)),
        fs=FS,
        duration_s=2.5,
        initial_velocity=[OMEGA * LEVEL],
        steps_per_sample=4,
    )
    decay = free_decay(record(ring.acceleration[:, 0]), fs=FS)
    frequency, zeta = slipping(joint, decay.amplitude, rest, damping)
    top = decay.amplitude > 0.05 * LEVEL
    # the frequency falls by 1.2 %, the damping doubles
    assert np.abs(decay.frequency_hz / frequency - 1.0)[top].max() < 1.5e-4
    assert np.abs(decay.damping_ratio / zeta - 1.0)[top].max() < 0.04


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_curves_without_a_law_carry_their_scatter(seed):
    """A joint that stops to slip within the record, where the damping falls steeply, and that the law may not have."""
    joint = iwan(stiffness_n_per_m=0.05 * K0, slip_force_n=0.02 * K0 * LEVEL, n=40)
    rest, damping = 0.95 * K0, 0.004 * OMEGA
    structure = Structure([[1.0]], [[damping]], [[rest]], (Joint("bolt", np.array([1.0]), sliders=joint),))
    start = {"initial_velocity": [OMEGA * LEVEL], "steps_per_sample": 4}
    ring = time_response(structure, lambda t: np.zeros((t.size, 1)), fs=FS, duration_s=2.5, **start)
    samples = record(ring.acceleration[:, 0], noise=0.003, seed=seed)
    decay = free_decay(samples, fs=FS, memory=False)
    assert decay.law is None or decay.law_misfit > MODAL.most_misfit
    frequency, zeta = slipping(joint, decay.amplitude, rest, damping)
    assert (np.abs(decay.frequency_hz - frequency) < 2.5 * decay.frequency_std_hz).all()
    assert (np.abs(decay.damping_ratio - zeta) < 2.5 * decay.damping_std).all()
    # Asked for nothing, the search finds the joint: iwan() has the travel 0.6 LEVEL and a jump of 3.
    found = free_decay(samples, fs=FS).fitted
    truth = (0.02 * K0 * LEVEL, 0.6 * LEVEL, 2.0 / 3.0, 3.0)
    assert all(each.holds(value) for each, value in zip(found.joint_estimates.values, truth, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("noise", [0.003, 0.03])
def test_two_linear_modes_whose_beat_is_longer_than_the_decay_are_no_law(seed, noise):
    decay = free_decay(two_close_modes(seed, noise=noise), fs=1024.0, near_hz=60.0)
    assert decay.law is None
    assert any("two linear modes at" in each for each in decay.warnings)
    for truth in (60.0, 60.1):
        assert (np.abs(decay.frequency_hz - truth) < 1.96 * decay.frequency_std_hz).mean() > 0.9


@pytest.mark.slow
def test_repeats_of_two_linear_modes_are_no_law_either():
    orders = {"stiffness_order": 3, "damping_order": 2}
    decays = [free_decay(two_close_modes(seed), fs=1024.0, near_hz=60.0, **orders) for seed in range(2)]
    with pytest.raises(NotDeterminedError, match=r"two linear modes at .* Hz, whose beat is slow"):
        pool_decays(decays, **orders)


@pytest.mark.slow
@pytest.mark.parametrize("level", [0.1, 0.2, 1.0])
def test_a_weakly_nonlinear_mode_is_not_taken_for_two(level):
    signal = motion(level=level * LEVEL)[2]
    for seed in range(2):
        decay = free_decay(record(signal, seed=seed), fs=FS)
        assert decay.warnings == ()
        assert decay.stiffness[1].holds(K0)


def test_a_mode_of_a_test_is_in_modal_coordinates(clean):
    modes = LinearModes([120.0, 300.0], [0.004, 0.006], [[0.5, 0.3], [0.5, -0.3]], ("a", "b"))
    one = record(clean[2])
    other = ringing(one.size, 300.0, 0.006, np.abs(clean[2]).max())
    sensors = modes.shapes @ np.vstack([one, other])
    test = modal_test(recording_from_arrays(list(sensors), ["a", "b"], fs=FS, unit="m/s^2"), modes, name="tap")
    decay = decay_of(test, 1)
    assert (decay.mode, decay.name) == (1, "tap")
    assert (decay.amplitude_unit, decay.signal_unit) == ("m kg^1/2", "m/s^2 kg^1/2")
    assert errors(decay)[0].max() < 2e-4
    assert decay_of(test, 2).frequency_low_hz.value == pytest.approx(300.0, rel=1e-3)


def test_a_rigid_body_mode_does_not_ring():
    modes = LinearModes([0.0], [0.0], [[1.0]], ("a",))
    test = modal_test(recording_from_arrays([np.ones(100)], ["a"], fs=FS, unit="m/s^2"), modes, name="tap")
    with pytest.raises(InputError, match="rigid-body"):
        decay_of(test, 1)


@pytest.mark.parametrize(
    ("samples", "settings", "message"),
    [
        (np.ones((3, 100)), {}, "one series"),
        (["a"] * 20, {}, "not numbers"),
        (np.r_[np.ones(50), np.nan], {}, "not finite"),
        (np.ones(100), {"fs": 0.0}, "sampling rate"),
        (np.ones(100), {"quantity": "jerk"}, "there is no quantity"),
        (np.arange(100) % 7, {"start_s": 5.0}, "within the record"),
        (np.arange(100) % 7, {"near_hz": 4000.0}, "below half the sampling rate"),
        (1e170 * (np.arange(100) % 7), {}, r"reaches 6e\+170, .*check its unit and scale"),
        (1e-170 * (np.arange(100) % 7), {}, "reaches 6e-170, .*check its unit and scale"),
    ],
)
def test_bad_input_is_refused(samples, settings, message):
    with pytest.raises(InputError, match=message):
        free_decay(samples, **{"fs": FS, **settings})


def test_what_does_not_decay_is_refused(clean):
    rng = np.random.default_rng(3)
    x = record(clean[2])
    with pytest.raises(NotDeterminedError, match="constant"):
        free_decay(np.ones(1000), fs=FS)
    with pytest.raises(NotDeterminedError, match=r"cycles of .* are needed"):
        free_decay(x[: QUIET + round(9 * FS / 120)], fs=FS)
    with pytest.raises(NotDeterminedError, match="it grows"):
        free_decay(x[QUIET:][::-1], fs=FS)
    with pytest.raises(NotDeterminedError):
        free_decay(rng.standard_normal(8000), fs=FS)
    with pytest.raises(NotDeterminedError):
        free_decay(np.sin(np.arange(12000) * 0.15) + 0.01 * rng.standard_normal(12000), fs=FS)


def test_a_ramp_is_no_oscillation():
    """What is left of it at the start falls faster than a wave that is damped by half."""
    with pytest.raises(NotDeterminedError, match="no oscillation"):
        free_decay(np.arange(4096) / 1024, fs=1024.0, start_s=0.0)


@pytest.mark.slow
def test_a_mode_that_gains_energy_has_no_interval_of_its_damping():
    """A limit cycle that is approached from above: its damping is negative at small amplitude."""
    omega, fs = 2 * np.pi * 30, 1024.0

    def rate(_, state):
        q, v = state
        return v, -(omega**2 * q - 0.6 * v + 6 * v * abs(v))

    time = np.arange(0, 6, 1 / fs)
    found = solve_ivp(rate, (0, 6), (4e-3, 0.0), t_eval=time, rtol=1e-9, atol=1e-13).y[0]
    record = np.concatenate([np.zeros(300), found])
    noise = 1e-3 * record.std() * np.random.default_rng(0).standard_normal(record.size)
    decay = free_decay(record + noise, fs=fs, quantity="displacement")
    assert decay.damping[1].value < 0
    assert decay.damping[1].std is None
    assert decay.damping_low.value is None
    assert any("the damping at small amplitude is negative" in each for each in decay.warnings)
    # The law lies beside those that do not decay: finite differences across that edge are no derivatives.
    assert decay.stiffness[1].std is None
    assert any("no interval is given: the best law lies at the edge" in each for each in decay.warnings)


def rings(signs):
    """Return a decay of two modes at four sensors, each with a sign or a gain."""
    fs, time = 1024.0, np.arange(8192) / 1024.0
    shapes = np.array([[0.5, 0.4], [0.6, -0.3], [0.2, 0.7], [0.55, 0.1]])
    modes = LinearModes([40.0, 63.0], [0.004, 0.005], shapes, tuple("abcd"))
    omega, zeta = 2 * np.pi * modes.frequency_hz, modes.damping_ratio
    motion = np.exp(-np.outer(time, zeta * omega)) * np.cos(np.outer(time, omega)) @ shapes.T
    noise = 1e-4 * np.random.default_rng(0).standard_normal(motion.shape)
    columns = list(((motion + noise) * signs).T)
    return modal_test(recording_from_arrays(columns, list("abcd"), fs=fs, unit="m/s^2"), modes, name="ring")


def test_sensors_of_a_wrong_sign_are_found_in_a_decay():
    assert decay_of(rings([1, 1, 1, 1]), 1).warnings == ()
    (warning,) = decay_of(rings([1, 1, -1, 1]), 1).warnings
    assert "24 % of the motion of test 'ring' around mode 1 is no sum of the mode shapes: with the opposite" in warning
    with pytest.raises(InputError, match=r"73 % of the motion .* with the opposite sign of 'b' it would be 0 %"):
        decay_of(rings([1, -1, 1, 1]), 1)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("gain", [1.3, 0.7, 0.0])
def test_a_sensor_of_a_wrong_gain_widens_the_law(seed, gain):
    test, wrong = decay_at_sensors(seed, wrong_gain=gain)
    if check_shapes(test, 1, (32.0, 48.0)).faults:
        with pytest.raises(InputError, match="is no sum of the mode shapes"):
            decay_of(test, 1)
        return
    decay = decay_of(test, 1, stiffness_order=3, damping_order=1)
    assert decay.stiffness[3].holds(SENSED_K3)
    # The frequencies of a mode do not depend on the gain.
    assert decay.stiffness[1].value == pytest.approx(SENSED_OMEGA**2, rel=3e-5)
    named = [each for each in decay.warnings if "with a gain of" in each]
    assert all(f"with a gain of {gain:.2f} of {wrong!r} it would be 0 %" in each for each in named)


def test_a_sensor_of_a_wrong_gain_is_named():
    """Of some sensors another one makes nearly the same motion outside the shapes: then none is named."""
    made = [decay_at_sensors(seed, wrong_gain=1.3) for seed in range(12)]
    named = [(check_shapes(test, 1, (32.0, 48.0)).cause, wrong) for test, wrong in made]
    assert sum(f"with a gain of 1.30 of {wrong!r} it would be 0 %" in cause for cause, wrong in named) >= 5
    assert all(repr(wrong) in cause or not cause for cause, wrong in named)


@pytest.mark.parametrize("seed", range(4))
def test_right_gains_give_no_warning_and_keep_the_law(seed):
    decay = decay_of(decay_at_sensors(seed)[0], 1, stiffness_order=3, damping_order=1)
    assert decay.warnings == ()
    assert decay.stiffness[3].holds(SENSED_K3)
    assert 0.03 * SENSED_K3 < decay.stiffness[3].std < 0.035 * SENSED_K3  # twice the calibration of the sensors
    # Shapes with errors of 3 % are wrong gains, too, if no single sensor is to blame.
    wrong = decay_of(decay_at_sensors(seed, n_sensors=10, shape_error=0.03)[0], 1, stiffness_order=3, damping_order=1)
    assert wrong.stiffness[3].holds(SENSED_K3)
    assert not any("with a gain of" in each for each in wrong.warnings)


def test_the_gain_of_a_signal_widens_what_depends_on_the_amplitude():
    test = decay_at_sensors(0)[0]
    options = {"fs": SENSED_FS, "near_hz": 40.0, "stiffness_order": 3, "damping_order": 1, "mode": 1}
    given, loose = (free_decay(test.modal_acceleration(1), gain_tolerance=gain, **options) for gain in (0.0, 0.1))
    assert loose.stiffness[3].std == pytest.approx(0.2 * SENSED_K3, rel=0.01)
    assert loose.stiffness[1] == given.stiffness[1]
    assert loose.frequency_std_hz[0] > 5 * given.frequency_std_hz[0]
