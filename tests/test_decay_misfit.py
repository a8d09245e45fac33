"""Laws that miss a decay beyond its noise: the true curves lie in their bands, and nothing at zero is told too well."""

import numpy as np
import pytest
from measured_data import measured
from scipy.integrate import solve_ivp

import opid
from opid.modal.decay import fit, forms
from opid.modal.decay.free_decay import free_decay

FS, LEVEL = 1024.0, 1e-3
OMEGA = 2.0 * np.pi * 40.0
ANGLE = 2.0 * np.pi * (np.arange(2000) + 0.5) / 2000
MISSED = "standard deviations of their noise"


def backlash(q):
    return OMEGA**2 * (q + 0.3 * np.sign(q) * np.maximum(np.abs(q) - 0.3 * LEVEL, 0.0))


def magnet(q):
    return OMEGA**2 * (q - 0.15 * q / (1.0 + (q / (0.4 * LEVEL)) ** 2) ** 2)


def linear_spring(q):
    return OMEGA**2 * q


def linear_damper(v):
    return 0.008 * OMEGA * v


def root_damper(v):
    speed = OMEGA * LEVEL
    return 0.004 * OMEGA * (v + speed * np.sign(v) * np.abs(v / speed) ** 0.7)


WORLDS = {
    "magnet": (magnet, linear_damper),
    "backlash": (backlash, linear_damper),
    "root": (linear_spring, root_damper),
    "linear": (linear_spring, linear_damper),
}


@pytest.fixture(scope="module")
def decays():
    """The accelerations of all worlds."""
    time = np.arange(round(3.0 * FS)) / FS

    def ring(spring, damper):
        found = solve_ivp(
            lambda _, y: [y[1], -spring(y[0]) - damper(y[1])],
            (0.0, time[-1]),
            [LEVEL, 0.0],
            "DOP853",
            time,
            rtol=1e-8,
            atol=1e-13,
            max_step=1 / 400,
        )
        return -spring(found.y[0]) - damper(found.y[1])

    return {name: ring(*forces) for name, forces in WORLDS.items()}


def true_curves(name, amplitude):
    """Frequency and damping ratio of a world by its slow flow."""
    spring, damper = WORLDS[name]
    omega = np.sqrt(2.0 * np.mean(spring(amplitude[:, None] * np.cos(ANGLE)) * np.cos(ANGLE), axis=1) / amplitude)
    speed = -(omega * amplitude)[:, None] * np.sin(ANGLE)
    damping = -2.0 * np.mean(damper(speed) * np.sin(ANGLE), axis=1) / (omega * amplitude)
    return omega / (2.0 * np.pi), damping / (2.0 * omega)


def record(signal, seed, noise):
    whole = np.concatenate([np.zeros(400), signal])
    return whole + noise * signal.std() * np.random.default_rng(seed).standard_normal(whole.size)


def fraction_held(values, stds, truth):
    # The slow flow is right to 1e-5.
    return np.mean(np.abs(values - truth) < 1.96 * stds + 1e-5 * truth)


def assert_curves_hold(law, true_hz, true_damping):
    assert fraction_held(law.frequency_hz, law.frequency_std_hz, true_hz) >= 0.9
    assert fraction_held(law.damping_ratio, law.damping_std, true_damping) >= 0.9


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["magnet", "backlash", "root"])
def test_the_bands_of_a_law_of_another_kind_hold_the_true_curves(decays, name, seed):
    decay = free_decay(record(decays[name], seed, 0.001), fs=FS)
    law = decay.fitted
    assert any(MISSED in each for each in decay.warnings)
    assert_curves_hold(law, *true_curves(name, law.amplitude))
    # The damping of the root grows without end towards zero, so that it is not told there.
    low_hz, low_damping = (float(each[0]) for each in true_curves(name, np.array([1e-3 * LEVEL])))
    assert law.frequency_low_hz.holds(low_hz)
    assert law.damping_low.holds(low_damping) if name != "root" else law.damping_low.value is None
    # The bands still tell something.
    assert np.median(law.frequency_std_hz) < 0.01 * low_hz


@pytest.mark.parametrize("seed", range(3))
def test_a_joint_whose_slip_saturates_stays_within_the_bands(seed):
    """The motion is that of a slow flow with a softening and a loss that no power has."""

    def flow(amplitude):
        slipped = amplitude**2 / (amplitude**2 + (0.15 * LEVEL) ** 2)
        return 40.0 * (1.0 - 0.05 * slipped), 0.003 + 0.004 * slipped

    def rates(_, y):
        hz, damping = flow(np.exp(y[0]))
        return [-2.0 * np.pi * hz * damping, 2.0 * np.pi * hz]

    time = np.arange(round(4.0 * FS)) / FS
    log_amplitude, phase = solve_ivp(rates, (0.0, 4.0), [np.log(LEVEL), 0.0], "DOP853", time, rtol=1e-9).y
    decay = free_decay(record(np.exp(log_amplitude) * np.cos(phase), seed, 0.001), fs=FS, quantity="displacement")
    law = decay.fitted
    assert any(MISSED in each for each in decay.warnings)
    assert_curves_hold(law, *flow(law.amplitude))
    assert law.frequency_low_hz.value is None or law.frequency_low_hz.holds(40.0)


@pytest.mark.parametrize("noise", [0.001, 0.01])
def test_a_law_that_explains_its_decay_keeps_its_intervals_to_the_digit(decays, noise, monkeypatch):
    for seed in range(5):
        signal = record(decays["linear"], seed, noise)
        found = free_decay(signal, fs=FS).fitted
        assert found.warnings == ()
        assert_curves_hold(found, *true_curves("linear", found.amplitude))
        with monkeypatch.context() as without:
            without.setattr(fit, "_add_model_error", lambda problem, fitted: fitted)
            plain = free_decay(signal, fs=FS).fitted
        assert np.array_equal(found.covariance, plain.covariance)
        assert found.frequency_low_hz == plain.frequency_low_hz
        assert found.damping_low == plain.damping_low


def test_a_law_that_cannot_be_fitted_without_a_stretch_has_no_interval(decays, monkeypatch):
    fit_form, signal = forms.fit_form, record(decays["magnet"], 0, 0.001)
    n_windows = free_decay(signal, fs=FS).amplitude.size

    def refuse_short(decays, form, guess, **how):
        if decays[0].time.size < n_windows:
            raise opid.NotDeterminedError("no law")
        return fit_form(decays, form, guess, **how)

    monkeypatch.setattr(forms, "fit_form", refuse_short)
    law = free_decay(signal, fs=FS).fitted
    assert fit.UNTOLD in law.warnings
    assert law.stiffness[1].value is not None
    assert law.stiffness[1].std is None
    assert np.isnan(law.frequency_std_hz).all()


def test_a_measured_beam_between_magnets_has_one_frequency_at_zero_from_any_start():
    log = measured("magnet_beam/decay_f_42p05_ampl_2p0_0.lvm.gz")
    recording = opid.read_log(log, channels=["Strain_0"])
    found = [
        free_decay(recording.channel("Strain_0"), fs=recording.fs, quantity="displacement", start_s=start)
        for start in (12.3, 12.8)
    ]
    first, second = (each.frequency_low_hz for each in found)
    assert first.holds(second.value)
    assert second.holds(first.value)
    assert max(first.std, second.std) < 0.2
    assert all(any(MISSED in text for text in each.warnings) for each in found)
