"""Slip, friction and powers that stand side by side in the law of a free decay."""

from functools import cache

import numpy as np
import pytest
from made_decays import RUNG_FS, RUNG_LEVEL, RUNG_OMEGA, noisy_after_rest
from scipy.integrate import solve_ivp

from opid.modal.decay.free_decay import free_decay
from opid.modal.decay.law_search import LawForm
from opid.modal.decay.slow_flow import solve_slow_flow
from opid.modal.joint_terms import SLIP, JointTerms, find_joint_curves, split_iwan

FS, OMEGA, LEVEL = RUNG_FS, RUNG_OMEGA, RUNG_LEVEL
K0, C0, C2 = OMEGA**2, 0.006 * OMEGA, 0.008 / LEVEL
DAHL = (0.02 * K0 * LEVEL, 0.1 * LEVEL)


@cache
def rub_and_drag(friction):
    """Return the acceleration of q'' + C0 q' + C2 q'|q'| + K0 q + F sgn q' = 0, from one reversal to the next."""
    time = np.arange(round(3.0 * FS)) / FS
    acceleration, start, place, sign = np.zeros(time.size), 0.0, LEVEL, -1.0

    def force(q, v, sign):
        return C0 * v + C2 * v * np.abs(v) + K0 * q + friction * sign

    def turns(_, y, __):
        return y[1]

    turns.terminal = True
    while abs(place) * K0 > friction and start < time[-1]:
        first = 1e-4 * np.pi / OMEGA
        # The speed is zero at the reversal itself, so the search for the next one begins a little later.
        fall = -force(place, 0.0, sign)
        begin = [place + 0.5 * fall * first**2, fall * first]
        turns.direction = -sign
        found = solve_ivp(
            lambda _, y, sign: [y[1], -force(*y, sign)],
            (start + first, start + 2.0 * np.pi / OMEGA),
            begin,
            "DOP853",
            events=turns,
            args=(sign,),
            dense_output=True,
            rtol=1e-9,
            atol=1e-15,
        )
        end = float(found.t_events[0][0])
        inside = (time >= start) & (time < end)
        acceleration[inside] = -force(*found.sol(time[inside]), sign)
        start, place, sign = end, float(found.y_events[0][0][0]), -sign
    return acceleration


@cache
def dahl_and_powers(c2, k3):
    """Return the acceleration of a mode whose joint is Dahl's, with C0, c2 and k3 beside it."""
    time, (force, travel) = np.arange(round(4.0 * FS)) / FS, DAHL
    beside = K0 - force / travel

    def load(q, v, h):
        return C0 * v + c2 * v * np.abs(v) + beside * q + k3 * q**3 + force * h

    found = solve_ivp(
        lambda _, y: [y[1], -load(*y), (y[1] - np.abs(y[1]) * y[2]) / travel],
        (0.0, time[-1]),
        [LEVEL, 0.0, 1.0],
        "LSODA",
        time,
        rtol=1e-8,
        atol=np.array([1e-12, 1e-10, 1e-9]),
        max_step=1.0 / FS,
    )
    return -load(*found.y)


@pytest.mark.parametrize("spread", [0.4, 0.5, 0.65])
def test_slip_has_the_flow_of_an_iwan_joint_that_nowhere_slides_as_a_whole(spread):
    values = (0.05, 2.0, spread, 0.0)
    slip, exponent, _ = split_iwan(values)
    own, joint = (
        solve_slow_flow(np.array([1.0]), np.array([0.004]), -3.0, 0.0, terms)
        for terms in (JointTerms(slip=slip, exponent=exponent), JointTerms(kind="iwan_friction", values=values))
    )
    # The changes of the joint are interpolated between amplitudes.
    np.testing.assert_allclose(own.rate, joint.rate, rtol=2e-3)
    np.testing.assert_allclose(own.omega, joint.omega, rtol=1e-6)


def test_slip_beside_friction_counts_as_terms_of_damping():
    assert LawForm(1, 1, True, SLIP).is_imitated_by_friction(10)
    assert not LawForm(1, 1, True).is_imitated_by_friction(10)
    assert not LawForm(1, 1, False, SLIP).is_imitated_by_friction(10)


@pytest.mark.parametrize("seed", range(2))
def test_a_power_beside_friction_is_found_where_nothing_else_explains_the_decay(seed):
    friction = 0.0047 * K0 * LEVEL
    decay = free_decay(noisy_after_rest(rub_and_drag(friction), np.random.default_rng(seed), 0.003), fs=FS)
    joint = decay.fitted.joint_estimates
    assert joint.terms == ["friction"]
    assert joint.friction.value == pytest.approx(friction, abs=3.0 * joint.friction.std)
    assert decay.damping[2].value == pytest.approx(C2, abs=3.0 * decay.damping[2].std)


@pytest.mark.parametrize("seed", range(2))
def test_a_power_of_damping_beside_a_joint_allows_for_what_is_off_in_its_loss(seed):
    signal = dahl_and_powers(C2, 0.05 * K0 / LEVEL**2)
    samples = noisy_after_rest(signal, np.random.default_rng(seed), 0.005)
    decay = free_decay(samples, fs=FS, memory="dahl_friction", stiffness_order=3, damping_order=2)
    assert decay.damping[2].value == pytest.approx(C2, abs=3.0 * decay.damping[2].std)


@pytest.mark.parametrize("seed", range(2))
def test_measured_damping_allows_for_that_of_steady_cycles_of_the_joint(seed):
    samples = noisy_after_rest(dahl_and_powers(0.0, 0.0), np.random.default_rng(seed), 0.005)
    decay = free_decay(samples, fs=FS, memory="dahl_friction")
    softening, loss = find_joint_curves("dahl_friction", DAHL, decay.amplitude)
    natural = np.sqrt(K0 - softening)
    damping = 0.5 * (C0 + loss / natural) / natural
    top = decay.amplitude > 0.2 * LEVEL
    assert np.abs((decay.damping_ratio - damping) / decay.damping_std)[top].max() < 3.0
