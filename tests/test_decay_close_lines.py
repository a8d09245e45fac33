"""Lines so close to a mode that no window separates them, hum beside a short decay, and laws of the highest order."""

import numpy as np
import pytest
from made_decays import decay_with_friction, noisy_after_rest
from scipy.integrate import solve_ivp

from opid.modal.decay.free_decay import free_decay

OMEGA, LEVEL = 2.0 * np.pi * 60.0, 1e-3


def ring(frequency_hz, zeta, fs, duration_s=6.0):
    time = np.arange(round(duration_s * fs)) / fs
    return np.exp(-zeta * 2 * np.pi * frequency_hz * time) * np.cos(2 * np.pi * frequency_hz * time)


def simulate(*, viscous=0.003, drag=0.0, power=1.0, k3=0.0, fs=2048.0):
    """Return the acceleration of a mode at 60 Hz with viscous damping, a drag |q'|^power and a cubic spring k3."""
    time = np.arange(round(6.0 * fs)) / fs
    scale = 2.0 * drag * OMEGA * (OMEGA * LEVEL) ** (1.0 - power)

    def force(q, v):
        return 2.0 * viscous * OMEGA * v + scale * np.sign(v) * np.abs(v) ** power + OMEGA**2 * q + k3 * q**3

    found = solve_ivp(
        lambda _, y: [y[1], -force(*y)], (0.0, time[-1]), [LEVEL, 0.0], "DOP853", time, rtol=1e-8, atol=1e-12
    )
    return -force(*found.y)


def told_lines(decay):
    return [text for text in decay.warnings if text.startswith("a line at") and "too close" in text]


@pytest.mark.parametrize(("apart_hz", "seed"), [(0.25, 0), (-0.4, 1)])
def test_a_weak_mode_beside_a_linear_one_is_named_and_subtracted(apart_hz, seed):
    signal = ring(60.0, 0.004, 1024.0) + 0.05 * ring(60.0 + apart_hz, 0.005, 1024.0)
    decay = free_decay(noisy_after_rest(signal, np.random.default_rng(seed), 0.003), fs=1024.0)
    (told,) = told_lines(decay)
    assert float(told.split()[3]) == pytest.approx(60.0 + apart_hz, abs=0.03)
    assert decay.damping_low.value == pytest.approx(0.004, abs=3.0 * decay.damping_low.std)
    assert decay.damping_low.std < 0.01 * 0.004
    loud = decay.amplitude > 0.05 * decay.amplitude.max()
    assert np.abs((decay.damping_ratio - 0.004) / decay.damping_std)[loud].max() < 4.0


def test_a_weak_mode_beside_a_hardening_one_leaves_its_law():
    k3 = 0.06 * OMEGA**2 / LEVEL**2
    signal = simulate(viscous=0.004, k3=k3)
    signal = signal + 0.05 * np.abs(signal).max() * ring(60.3, 0.004, 2048.0)
    decay = free_decay(noisy_after_rest(signal, np.random.default_rng(0), 0.003), fs=2048.0)
    assert told_lines(decay)
    assert decay.stiffness[3].value == pytest.approx(k3, abs=3.0 * decay.stiffness[3].std)
    assert decay.frequency_low_hz.value == pytest.approx(60.0, abs=3.0 * decay.frequency_low_hz.std)
    assert decay.damping_low.value == pytest.approx(0.004, abs=3.0 * decay.damping_low.std)


def test_a_damping_that_is_no_power_is_not_taken_for_a_line():
    decay = free_decay(noisy_after_rest(simulate(drag=0.004, power=0.5), np.random.default_rng(0), 0.003), fs=2048.0)
    assert not told_lines(decay)


@pytest.mark.parametrize("seed", [1])
def test_values_at_zero_of_the_highest_order_allow_for_a_fractional_power(seed):
    decay = free_decay(noisy_after_rest(simulate(drag=0.004, power=1.5), np.random.default_rng(seed), 0.003), fs=2048.0)
    assert decay.damping_low.value == pytest.approx(0.003, abs=3.0 * decay.damping_low.std)


def test_hum_beside_a_mode_that_stops_soon_is_subtracted():
    fs, omega = 2048.0, 2.0 * np.pi * 51.2
    k0, level = omega**2, 1e-3
    signal = decay_with_friction(
        fs=fs, duration_s=6.0, k0=k0, c0=0.008 * omega, friction=0.0047 * k0 * level, amplitude=level
    )
    hum = 0.01 * k0 * level * np.sin(2 * np.pi * 49.98 * (np.arange(signal.size + 500) / fs) + 1.0)
    decay = free_decay(noisy_after_rest(signal, np.random.default_rng(1), 0.003) + hum, fs=fs)
    assert any("taken for hum" in text for text in decay.warnings)
    friction = decay.fitted.joint_estimates.friction
    assert friction.value == pytest.approx(0.0047 * k0 * level, abs=3.0 * friction.std)


def test_a_record_that_ends_within_a_decay_near_the_mains_says_that_hum_would_hide():
    signal = ring(60.3, 0.004, 1024.0, duration_s=2.0)
    decay = free_decay(noisy_after_rest(signal, np.random.default_rng(0), 0.003), fs=1024.0)
    assert any("hum would not show" in text for text in decay.warnings)
    whole = free_decay(noisy_after_rest(ring(60.3, 0.004, 1024.0), np.random.default_rng(0), 0.003), fs=1024.0)
    assert not any("hum would not show" in text for text in whole.warnings)
