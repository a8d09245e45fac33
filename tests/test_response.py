import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from opid.errors import InputError
from opid.mechanics.landing_gear import LandingGear, gear_structure, tyre_force
from opid.mechanics.laws import LINEAR, default_law, law
from opid.mechanics.response import time_response
from opid.mechanics.road import SpeedProfile, iso8608_road
from opid.mechanics.structure import Joint, Structure, frequency_response, natural_frequencies


def no_force(n_dof):
    return lambda time_s: np.zeros((time_s.size, n_dof))


def oscillator(mass_kg=2.0, stiffness_n_per_m=800.0, damping_n_s_per_m=0.0, law=LINEAR):
    joint = Joint("spring", [1.0], stiffness_n_per_m, damping_n_s_per_m, law)
    return Structure([[mass_kg]], [[0.0]], [[0.0]], (joint,))


def test_the_nominal_taxi_run_agrees_with_an_independent_integrator():
    gear = LandingGear()
    road = iso8608_road("B", length_m=400.0, rng=np.random.default_rng(3))
    speed = SpeedProfile(18.0, 0.5, 40.0)

    def force(time_s):
        return tyre_force(gear, road, speed.position_m(time_s), speed.speed_m_per_s(time_s))

    motion = time_response(gear_structure(gear), force, fs=4096.0, duration_s=1.0)

    def equations(time_s, state):
        x1, x2, v1, v2 = state
        place = 18.0 * time_s - 17.5 / 80.0 * time_s**2
        xb, xb_rate = float(road.elevation(place)), float(road.slope(place)) * (18.0 - 17.5 / 40.0 * time_s)
        strut = 3.9e5 * (x2 - x1) + 6e3 * (v2 - v1) + 400.0 * 2.0 / math.pi * math.atan((v2 - v1) / 0.02)
        return [v1, v2, (strut - 6.2e5 * (x1 - xb) - 1.5e3 * (v1 - xb_rate)) / 105.0, -strut / 1850.0]

    # the spline of the road has a knot each 16 mm: a short longest step keeps the reference from missing them
    reference = solve_ivp(
        equations, (0.0, 1.0), np.zeros(4), "DOP853", motion.time_s, rtol=1e-11, atol=1e-15, max_step=5e-3
    ).y.T
    state = np.hstack([motion.displacement, motion.velocity])
    rms = np.sqrt(np.mean(reference**2, axis=0))
    assert (np.abs(state - reference).max(axis=0) < 1e-6 * rms).all()
    accelerations = np.array([equations(*row)[2:] for row in zip(motion.time_s, state, strict=True)])
    np.testing.assert_allclose(motion.acceleration, accelerations, rtol=1e-9, atol=1e-9)


def test_a_free_decay_has_its_closed_form():
    structure = oscillator(damping_n_s_per_m=4.0)
    motion = time_response(
        structure, no_force(1), fs=2000.0, duration_s=2.0, initial_displacement=[0.01], initial_velocity=[0.3]
    )
    t, omega, zeta = motion.time_s, 20.0, 0.05
    damped = omega * math.sqrt(1.0 - zeta**2)
    sine = (0.3 + zeta * omega * 0.01) / damped
    expected = np.exp(-zeta * omega * t) * (0.01 * np.cos(damped * t) + sine * np.sin(damped * t))
    np.testing.assert_allclose(motion.displacement[:, 0], expected, atol=1e-10)


def test_the_error_falls_with_the_fourth_power_of_the_step():
    structure = oscillator(damping_n_s_per_m=4.0, law=law("cubic_stiffness", stiffness_n_per_m3=2e6))

    def last(fs):
        motion = time_response(
            structure,
            lambda t: np.sin(9.0 * t)[:, None],
            fs=fs,
            duration_s=1.0 + 1.0 / fs,
            initial_displacement=[0.02],
        )
        return motion.displacement[-1, 0]

    exact = last(16000.0)
    ratio = (last(250.0) - exact) / (last(500.0) - exact)
    assert 14.0 < ratio < 18.0


@settings(max_examples=15, deadline=None)
@given(frequency_hz=st.floats(0.5, 30.0), damping=st.floats(2e3, 2e4))
def test_the_steady_state_of_a_linear_gear_is_its_frequency_response(frequency_hz, damping):
    structure = gear_structure(LandingGear(suspension_damping_n_s_per_m=damping, law=LINEAR))
    omega = 2.0 * np.pi * frequency_hz
    receptance = frequency_response(structure, [frequency_hz])[0, :, 0]
    # begin in the steady state: only the closed form stays in it
    motion = time_response(
        structure,
        lambda t: np.stack([1e3 * np.cos(omega * t), np.zeros(t.size)], axis=1),
        fs=4096.0,
        duration_s=2.0,
        initial_displacement=1e3 * receptance.real,
        initial_velocity=1e3 * (1j * omega * receptance).real,
    )
    rotating = np.exp(1j * omega * motion.time_s)[:, None]
    for found, factor in (
        (motion.displacement, 1.0),
        (motion.velocity, 1j * omega),
        (motion.acceleration, -(omega**2)),
    ):
        expected = (1e3 * factor * receptance * rotating).real
        np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@settings(max_examples=10, deadline=None)
@given(first=st.floats(-50.0, 50.0), second=st.floats(-50.0, 50.0), seed=st.integers(0, 100))
def test_a_linear_structure_superposes(first, second, seed):
    structure = gear_structure(LandingGear(law=LINEAR))
    forces = 1e3 * np.random.default_rng(seed).standard_normal((2, 2 * 512 - 1, 2))

    def displacement(force):
        return time_response(structure, force, fs=512.0, duration_s=1.0).displacement

    alone = first * displacement(forces[0]) + second * displacement(forces[1])
    together = displacement(first * forces[0] + second * forces[1])
    np.testing.assert_allclose(together, alone, atol=1e-9 * (np.abs(alone).max() + 1e-6))


def test_a_nonlinear_structure_does_not_superpose():
    structure = gear_structure(LandingGear())
    force = 1e3 * np.random.default_rng(1).standard_normal((2 * 512 - 1, 2))
    once, twice = (time_response(structure, k * force, fs=512.0, duration_s=1.0).displacement for k in (1, 2))
    assert np.abs(twice - 2.0 * once).max() > 0.01 * np.abs(twice).max()


def test_a_conservative_law_keeps_the_energy():
    cubic = 2e6
    structure = oscillator(law=law("cubic_stiffness", stiffness_n_per_m3=cubic))
    motion = time_response(structure, no_force(1), fs=4000.0, duration_s=5.0, initial_displacement=[0.03])
    x, v = motion.displacement[:, 0], motion.velocity[:, 0]
    energy = 0.5 * 2.0 * v**2 + 0.5 * 800.0 * x**2 + 0.25 * cubic * x**4
    np.testing.assert_allclose(energy, energy[0], rtol=1e-7)
    # the hardening spring is what makes it: the linear energy alone is far from constant
    assert np.ptp(energy - 0.25 * cubic * x**4) > 0.1 * energy[0]


def test_the_work_of_the_force_is_stored_or_taken_by_the_dampers():
    gear = LandingGear()
    structure = gear_structure(gear)

    def force(time_s):
        return np.stack([4e3 * np.sin(11.0 * time_s), np.zeros(time_s.size)], axis=1)

    motion = time_response(structure, force, fs=4096.0, duration_s=3.0)
    (x1, x2), (v1, v2) = motion.displacement.T, motion.velocity.T
    stored = 0.5 * (105.0 * v1**2 + 1850.0 * v2**2 + 6.2e5 * x1**2 + 3.9e5 * (x2 - x1) ** 2)
    friction = gear.law.force(x2 - x1, v2 - v1)
    power = force(motion.time_s)[:, 0] * v1 - 1.5e3 * v1**2 - 6e3 * (v2 - v1) ** 2 - friction * (v2 - v1)
    received = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) / motion.fs])
    np.testing.assert_allclose(received, stored, atol=1e-4 * stored.max())


def test_two_joints_act_each_along_its_own_direction():
    # two equal springs with cubic laws, one to the wall and one between: against the equations written out
    joints = (
        Joint("wall", [1.0, 0.0], 100.0, 0.5, law("cubic_stiffness", stiffness_n_per_m3=3e4)),
        Joint("between", [-1.0, 1.0], 50.0, 0.2, default_law("quadratic_damping").scaled(1e-4)),
    )
    mass = np.array([[2.0, 0.3], [0.3, 1.0]])
    structure = Structure(mass, np.zeros((2, 2)), np.zeros((2, 2)), joints)
    motion = time_response(structure, no_force(2), fs=500.0, duration_s=4.0, initial_velocity=[0.5, -0.4])

    def equations(_, state):
        (x1, x2), (v1, v2) = state[:2], state[2:]
        wall = 100.0 * x1 + 0.5 * v1 + 3e4 * x1**3
        between = 50.0 * (x2 - x1) + 0.2 * (v2 - v1) + 4.0 * (v2 - v1) * abs(v2 - v1)
        return [v1, v2, *np.linalg.solve(mass, [between - wall, -between])]

    start = [0.0, 0.0, 0.5, -0.4]
    reference = solve_ivp(equations, (0.0, 4.0), start, "DOP853", motion.time_s, rtol=1e-10, atol=1e-12).y
    np.testing.assert_allclose(motion.displacement, reference[:2].T, atol=1e-8)


def test_an_array_of_half_steps_is_the_callable():
    structure = oscillator(law=default_law("arctan_velocity").scaled(1e-2))
    fs, duration_s = 200.0, 1.0
    half_steps = np.arange(2 * 200 - 1) / (2.0 * fs)
    by_array = time_response(structure, np.sin(30.0 * half_steps)[:, None], fs=fs, duration_s=duration_s)
    by_call = time_response(structure, lambda t: np.sin(30.0 * t)[:, None], fs=fs, duration_s=duration_s)
    np.testing.assert_array_equal(by_array.displacement, by_call.displacement)
    assert by_call.time_s.shape == (200,)
    assert by_call.time_s[1] == 1.0 / fs


def test_a_stiffening_law_raises_the_frequency_of_a_free_swing():
    linear_hz = natural_frequencies(oscillator()).frequency_hz[0]
    structure = oscillator(law=law("cubic_stiffness", stiffness_n_per_m3=2e6))
    for amplitude, stiffer in ((1e-4, False), (0.03, True)):
        motion = time_response(structure, no_force(1), fs=4000.0, duration_s=2.0, initial_displacement=[amplitude])
        x = motion.displacement[:, 0]
        rising = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
        found_hz = (rising.size - 1) / ((rising[-1] - rising[0]) / motion.fs)
        if stiffer:
            # harmonic balance: omega^2 = k/m + 3/4 k3/m A^2
            assert found_hz == pytest.approx(math.sqrt(400.0 + 0.75e6 * amplitude**2) / (2 * math.pi), rel=0.02)
        else:
            assert found_hz == pytest.approx(linear_hz, rel=2e-3)


UNSTABLE = oscillator(damping_n_s_per_m=-4e3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: time_response(UNSTABLE, no_force(1), fs=100.0, duration_s=9.0, initial_velocity=[1.0]),
         "grows without bound and overflows at"),
        (lambda: time_response(UNSTABLE, no_force(2), fs=100.0, duration_s=1.0), r"give \(199, 1\)"),
        (lambda: time_response(UNSTABLE, np.full((199, 1), np.nan), fs=100.0, duration_s=1.0), "not finite"),
        (lambda: time_response(UNSTABLE, no_force(1), fs=0.0, duration_s=1.0), "fs is 0.0 Hz"),
        (lambda: time_response(UNSTABLE, no_force(1), fs=10.0, duration_s=0.1), "at least two"),
        (lambda: time_response(UNSTABLE, no_force(1), fs=10.0, duration_s=1.0, initial_velocity=[1.0, 2.0]),
         "initial_velocity is"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()
