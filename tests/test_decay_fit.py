import numpy as np
import pytest
from scipy.integrate import solve_ivp

from opid.errors import InputError, NotDeterminedError
from opid.modal.decay.free_decay import free_decay, law_of_decays
from opid.modal.decay.slow_flow import predict_decay, solve_slow_flow

FS = 2048.0
OMEGA = 2.0 * np.pi * 60.0
LEVEL = 1e-3
K0, C0 = OMEGA**2, 0.01 * OMEGA
K3, C2 = -0.06 * K0 / LEVEL**2, C0 / (8.0 / (3.0 * np.pi) * OMEGA * LEVEL)


def acceleration(level=LEVEL, duration_s=2.0, *, k3=K3, c2=C2):
    def force(q, v):
        return C0 * v + c2 * v * np.abs(v) + K0 * q + k3 * q**3

    time = np.arange(round(duration_s * FS)) / FS
    solution = solve_ivp(
        lambda _, y: [y[1], -force(*y)], (0.0, time[-1]), [0.0, OMEGA * level], "DOP853", time, rtol=1e-8, atol=1e-14
    )
    return -force(*solution.y)


@pytest.fixture(scope="module")
def clean():
    return acceleration()


def noisy(signal, seed, fraction=0.01):
    return signal + fraction * signal.std() * np.random.default_rng(seed).standard_normal(signal.size)


def test_the_flow_of_a_linear_mode_is_its_closed_form():
    zeta = 0.02
    flow = solve_slow_flow(np.array([1.0]), np.array([2.0 * zeta]), -8.0, 0.5)
    time = np.linspace(0.0, 200.0, 50)
    log_level, phase = predict_decay(flow, time, 0.0, 0)
    np.testing.assert_allclose(log_level - log_level[0], -zeta * time, atol=1e-9)
    np.testing.assert_allclose(phase, np.sqrt(1.0 - zeta**2) * time, rtol=1e-7, atol=1e-7)


def test_the_flow_of_a_duffing_oscillator_has_its_frequency():
    # the series of omega/omega0 in eps = k3 a^2 / k0 with a the first harmonic: 1 + 3/8 eps + 3/256 eps^2 - 9/128 eps^2
    eps = -0.1
    flow = solve_slow_flow(np.array([1.0, 0.0, eps]), np.array([1e-6]), -0.01, 0.01)
    middle = np.interp(0.0, flow.log_amplitude, flow.natural)
    assert middle == pytest.approx(1.0 + 3 / 8 * eps + (3 / 256 - 9 / 128) * eps**2, abs=2e-4)


def test_a_law_without_decay_or_stiffness_has_no_flow():
    assert solve_slow_flow(np.array([1.0]), np.array([-0.01]), -3.0, 0.0) is None
    assert solve_slow_flow(np.array([1.0, 0.0, -5.0]), np.array([0.01]), -3.0, 0.0) is None


def test_the_law_of_a_decay_without_noise(clean):
    decay = free_decay(clean, fs=FS, stiffness_order=3, damping_order=2)
    assert decay.stiffness[1].value == pytest.approx(K0, rel=1e-5)
    assert decay.damping[1].value == pytest.approx(C0, rel=1e-3)
    assert decay.stiffness[3].value == pytest.approx(K3, rel=0.02)
    assert decay.damping[2].value == pytest.approx(C2, rel=0.005)
    assert decay.law is not None
    assert decay.law.name == "quadratic_damping+quadratic_stiffness+cubic_stiffness"


def test_the_intervals_hold_the_truth(clean):
    held, misses = [], []
    for seed in range(8):
        decay = free_decay(noisy(clean, seed), fs=FS, stiffness_order=3, damping_order=2)
        pairs = [
            (decay.stiffness[1], K0),
            (decay.stiffness[2], 0.0),
            (decay.stiffness[3], K3),
            (decay.damping[1], C0),
            (decay.damping[2], C2),
        ]
        held += [estimate.holds(truth) for estimate, truth in pairs]
        misses.append([decay.stiffness[3].value / K3 - 1.0, decay.damping[2].value / C2 - 1.0])
    # 40 intervals: 6 misses or more of true 95 % ones come once in 70 such tests
    assert np.sum(held) >= 34
    assert np.abs(np.mean(misses, axis=0)).max() < 0.012


def test_the_orders_are_found(clean):
    decay = free_decay(noisy(clean, 1), fs=FS)
    assert 3 in decay.stiffness
    assert 2 in decay.damping
    linear = free_decay(noisy(acceleration(k3=0.0, c2=0.0), 1), fs=FS)
    assert (len(linear.stiffness), len(linear.damping)) == (1, 1)
    assert linear.damping_low.value == pytest.approx(0.005, rel=0.01)
    assert linear.frequency_low_hz.holds(60.0)


def test_several_decays_tell_more_than_one(clean):
    low = acceleration(0.4 * LEVEL)
    decays = [
        free_decay(noisy(signal, seed), fs=FS, stiffness_order=3, damping_order=2)
        for seed, signal in enumerate((clean, clean, low))
    ]
    law = law_of_decays(decays, stiffness_order=3, damping_order=2)
    assert law.stiffness[3].value == pytest.approx(K3, rel=0.03)
    assert law.damping[2].value == pytest.approx(C2, rel=0.01)
    assert law.damping[2].std < decays[0].damping[2].std
    assert (np.diff(law.frequency_hz) < 0.0).all()
    assert law.frequency_hz[-1] == pytest.approx(np.sqrt(K0 + 0.75 * K3 * law.amplitude[-1] ** 2) / 2 / np.pi, rel=2e-4)


def test_bad_input_is_refused(clean):
    decay = free_decay(clean, fs=FS)
    with pytest.raises(InputError, match="at least one"):
        law_of_decays([])
    with pytest.raises(InputError, match="damping_order is 6"):
        law_of_decays([decay], damping_order=6)
    with pytest.raises(InputError, match="different modes"):
        law_of_decays([decay, free_decay(clean, fs=FS, mode=1)])
    short = free_decay(clean[: round(12.5 * FS / 60.0)], fs=FS)
    with pytest.raises(NotDeterminedError, match="lower the orders"):
        law_of_decays([short], stiffness_order=5, damping_order=5)
