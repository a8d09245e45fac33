import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import linalg
from scipy.integrate import solve_ivp

from opid.errors import InputError
from opid.mechanics.laws.law import LINEAR, default_law, law
from opid.mechanics.response import advance, assemble, state_at, time_response
from opid.mechanics.structure import (
    Joint,
    Sliders,
    Structure,
    force_of,
    frequency_response,
    iwan,
    linear_matrices,
    natural_frequencies,
)
from opid.virtual.taxi_tests.airframe import LandingGear, airframe_structure
from opid.virtual.taxi_tests.road import SpeedProfile, iso8608_road
from opid.virtual.taxi_tests.taxiing import tyre_forces


def no_force(n_dof):
    return lambda time_s: np.zeros((time_s.size, n_dof))


def oscillator(mass_kg=2.0, stiffness_n_per_m=800.0, damping_n_s_per_m=0.0, law=LINEAR):
    joint = Joint("spring", [1.0], stiffness_n_per_m, damping_n_s_per_m, law)
    return Structure([[mass_kg]], [[0.0]], [[0.0]], (joint,))


def test_the_nominal_taxi_run_agrees_with_an_independent_integrator():
    airframe = LandingGear().airframe
    road = iso8608_road("B", length_m=400.0, rng=np.random.default_rng(3))
    speed = SpeedProfile(18.0, 0.5, 40.0)

    def force(time_s):
        return tyre_forces(airframe, [road], speed.position_m(time_s), speed.speed_m_per_s(time_s))

    structure = airframe_structure(airframe)
    motion = time_response(structure, force, fs=4096.0, duration_s=0.5, loads=np.array([[0.0], [1.0]]))

    def equations(time_s, state):
        x2, x1, v2, v1 = state
        place = 18.0 * time_s - 17.5 / 80.0 * time_s**2
        xb, xb_rate = float(road.elevation(place)), float(road.slope(place)) * (18.0 - 17.5 / 40.0 * time_s)
        strut = 3.9e5 * (x2 - x1) + 6e3 * (v2 - v1) + 400.0 * 2.0 / math.pi * math.atan((v2 - v1) / 0.02)
        return [v2, v1, -strut / 1850.0, (strut - 6.2e5 * (x1 - xb) - 1.5e3 * (v1 - xb_rate)) / 105.0]

    # the spline of the road has a knot each 16 mm: a short longest step keeps the reference from missing them
    reference = solve_ivp(
        equations, (0.0, 0.5), np.zeros(4), "DOP853", motion.time_s, rtol=1e-11, atol=1e-15, max_step=5e-3
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


@settings(max_examples=15)
@given(frequency_hz=st.floats(0.5, 30.0), damping=st.floats(2e3, 2e4))
def test_the_steady_state_of_a_linear_gear_is_its_frequency_response(frequency_hz, damping):
    structure = airframe_structure(LandingGear(suspension_damping_n_s_per_m=damping, law=LINEAR).airframe)
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


@settings(max_examples=10)
@given(first=st.floats(-50.0, 50.0), second=st.floats(-50.0, 50.0), seed=st.integers(0, 100))
def test_a_linear_structure_superposes(first, second, seed):
    structure = airframe_structure(LandingGear(law=LINEAR).airframe)
    forces = 1e3 * np.random.default_rng(seed).standard_normal((2, 2 * 512 - 1, 2))

    def displacement(force):
        return time_response(structure, force, fs=512.0, duration_s=1.0).displacement

    alone = first * displacement(forces[0]) + second * displacement(forces[1])
    together = displacement(first * forces[0] + second * forces[1])
    np.testing.assert_allclose(together, alone, atol=1e-9 * (np.abs(alone).max() + 1e-6))


def test_a_nonlinear_structure_does_not_superpose():
    structure = airframe_structure(LandingGear().airframe)
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
    structure = airframe_structure(gear.airframe)

    def force(time_s):
        return np.stack([np.zeros(time_s.size), 4e3 * np.sin(11.0 * time_s)], axis=1)

    motion = time_response(structure, force, fs=4096.0, duration_s=3.0)
    (x2, x1), (v2, v1) = motion.displacement.T, motion.velocity.T
    stored = 0.5 * (105.0 * v1**2 + 1850.0 * v2**2 + 6.2e5 * x1**2 + 3.9e5 * (x2 - x1) ** 2)
    friction = gear.law.force(x2 - x1, v2 - v1)
    power = force(motion.time_s)[:, 1] * v1 - 1.5e3 * v1**2 - 6e3 * (v2 - v1) ** 2 - friction * (v2 - v1)
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


def slipping(level=1.0):
    """Two masses, a bolted joint that slips between them and a cubic spring to the wall; and its force."""
    joints = (
        Joint("wall", [1.0, 0.0], 4e5, 20.0, law("cubic_stiffness", stiffness_n_per_m3=1e13)),
        Joint("bolts", [-1.0, 1.0], 2e5, 5.0, sliders=iwan(stiffness_n_per_m=2e6, slip_force_n=60.0)),
        Joint("rubbing", [0.0, 1.0], sliders=Sliders([1e5, 3e5], [2.0, 9.0])),
    )
    structure = Structure(np.diag([2.0, 1.0]), np.zeros((2, 2)), np.zeros((2, 2)), joints)
    return structure, lambda t: level * (np.sin(2 * np.pi * 75.0 * t) * np.exp(-(((t - 0.1) / 0.04) ** 2)))[:, None]


def test_sliders_act_as_their_history_of_extension_says():
    structure, force = slipping(100.0)
    load = np.array([[0.3], [1.0]])
    motion = time_response(structure, force, fs=2e4, duration_s=0.2, loads=load)
    x, v = motion.displacement, motion.velocity
    bolts, ends = force_of(structure.joints[1].sliders, x[:, 1] - x[:, 0])
    rubbing, _ = force_of(structure.joints[2].sliders, x[:, 1])
    bolts = bolts + 2e5 * (x[:, 1] - x[:, 0]) + 5.0 * (v[:, 1] - v[:, 0])
    wall = 4e5 * x[:, 0] + 20.0 * v[:, 0] + 1e13 * x[:, 0] ** 3
    expected = (force(motion.time_s) * load.T + np.stack([bolts - wall, -bolts - rubbing], axis=1)) / [2.0, 1.0]
    np.testing.assert_allclose(motion.acceleration, expected, atol=1e-9 * np.abs(expected).max())
    # it did slip, and the bolts did not all come back
    assert np.abs(force_of(structure.joints[1].sliders, x[:, 1] - x[:, 0])[0]).max() > 30.0
    assert np.abs(ends).max() > 1e-7


def test_sliders_agree_with_an_independent_integrator():
    structure, force = slipping(100.0)
    motion = time_response(structure, force, fs=4e4, duration_s=0.15, loads=[[0.3], [1.0]])
    bolts, rubbing = structure.joints[1].sliders, structure.joints[2].sliders
    stiffness = np.concatenate([bolts.stiffness_n_per_m, rubbing.stiffness_n_per_m])
    slip = np.concatenate([bolts.slip_force_n, rubbing.slip_force_n])

    def equations(time_s, state):
        x1, x2, v1, v2 = state[:4]
        # each element's force is a state of its own, that a slipping one keeps
        carried = np.clip(state[4:], -slip, slip)
        rate = np.where(np.arange(slip.size) < bolts.n, v2 - v1, v2)
        sticks = (np.abs(state[4:]) < slip) | (carried * rate < 0.0)
        joint = carried[: bolts.n].sum() + 2e5 * (x2 - x1) + 5.0 * (v2 - v1)
        drive = force(np.array([time_s]))[0, 0]
        a1 = (0.3 * drive + joint - 4e5 * x1 - 20.0 * v1 - 1e13 * x1**3) / 2.0
        return np.concatenate([[v1, v2, a1, drive - joint - carried[bolts.n :].sum()], stiffness * rate * sticks])

    # the corners hold the reference's steps up, so it is not asked for more than 1e-6
    reference = (
        solve_ivp(equations, (0.0, 0.15), np.zeros(4 + slip.size), "RK23", motion.time_s[::50], rtol=1e-6, atol=1e-8)
        .y[:2]
        .T
    )
    scale = np.abs(reference).max(axis=0)
    assert (np.abs(motion.displacement[::50] - reference) < 2e-3 * scale).all()


def test_the_error_of_sliders_falls_with_the_square_of_the_step():
    structure, force = slipping(100.0)
    fine, *coarser = (
        time_response(structure, force, fs=2e3, duration_s=0.2, loads=[[0.0], [1.0]], steps_per_sample=steps)
        for steps in (256, 4, 16)
    )
    once, four_times = (np.abs(each.displacement - fine.displacement).max() for each in coarser)
    assert 6.0 < once / four_times < 60.0
    assert once < 1e-2 * np.abs(fine.displacement).max()


def test_at_low_level_sliders_are_springs():
    structure, force = slipping(1e-4)
    springs = tuple(
        Joint(each.name, each.direction, each.stiffness_n_per_m + tangent, each.damping_n_s_per_m)
        for each, tangent in zip(structure.joints, (0.0, 2e6, 4e5), strict=True)
    )
    linear = Structure(structure.mass, structure.damping, structure.stiffness, springs)
    for found, expected in zip(linear_matrices(structure), linear_matrices(linear), strict=True):
        np.testing.assert_allclose(found, expected)
    found, expected = (
        time_response(each, force, fs=5e3, duration_s=0.3, loads=[[0.0], [1.0]]).displacement
        for each in (structure, linear)
    )
    # the first element gives way at once, but it is a small one
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


def test_several_inputs_agree_with_an_independent_integrator():
    mass = np.array([[2.0, 0.3, 0.0], [0.3, 1.0, 0.0], [0.0, 0.0, 1.5]])
    stiffness = np.array([[900.0, 0.0, -200.0], [0.0, 700.0, 0.0], [-200.0, 0.0, 400.0]])
    damping = np.diag([0.8, 0.0, 0.6])
    joint = Joint("joint", [0.0, 1.0, -1.0], 100.0, 0.4, law("cubic_stiffness", stiffness_n_per_m3=3e5))
    loads = np.array([[1.0, 0.0], [0.0, 0.0], [0.5, 2.0]])

    def force(time_s):
        return np.stack([9.0 * np.sin(20.0 * time_s), 5.0 * np.cos(31.0 * time_s**2)], axis=-1)

    motion = time_response(
        Structure(mass, damping, stiffness, (joint,)), force, fs=100.0, duration_s=2.0, loads=loads,
        steps_per_sample=20, initial_displacement=[0.01, 0.0, -0.02],
    )  # fmt: skip

    def equations(time_s, state):
        x, v = state[:3], state[3:]
        z, w = x[1] - x[2], v[1] - v[2]
        pull = joint.direction * (100.0 * z + 0.4 * w + 3e5 * z**3)
        return [*v, *np.linalg.solve(mass, loads @ force(time_s) - damping @ v - stiffness @ x - pull)]

    start = [0.01, 0.0, -0.02, 0.0, 0.0, 0.0]
    reference = solve_ivp(equations, (0.0, 2.0), start, "DOP853", motion.time_s, rtol=1e-10, atol=1e-12).y
    np.testing.assert_allclose(motion.displacement, reference[:3].T, atol=1e-8)
    np.testing.assert_allclose(motion.velocity, reference[3:].T, atol=1e-6)


def test_modal_coordinates_move_as_physical_ones():
    rng = np.random.default_rng(4)
    root = rng.standard_normal((6, 6))
    stiffness = 1e5 * (root @ root.T + np.eye(6))
    mass = np.diag(rng.uniform(1.0, 3.0, 6))
    direction, load = rng.standard_normal(6), rng.standard_normal((6, 1))
    bolted = law("cubic_stiffness", stiffness_n_per_m3=1e10), iwan(stiffness_n_per_m=1e5, slip_force_n=3.0)
    physical = Structure(mass, 1e-4 * stiffness, stiffness, (Joint("joint", direction, 0.0, 0.0, *bolted),))
    squares, shapes = linalg.eigh(stiffness, mass)
    modal = Structure(
        np.eye(6), np.diag(1e-4 * squares), np.diag(squares), (Joint("joint", shapes.T @ direction, 0.0, 0.0, *bolted),)
    )
    force = 50.0 * rng.standard_normal((2 * 999 + 1, 1))
    expected = time_response(physical, force, fs=5e3, duration_s=0.2, loads=load)
    found = time_response(modal, force, fs=5e3, duration_s=0.2, loads=shapes.T @ load)
    for one, other in ((found.displacement, expected.displacement), (found.acceleration, expected.acceleration)):
        np.testing.assert_allclose(one @ shapes.T, other, atol=1e-9 * np.abs(other).max())


def test_steps_between_samples_are_those_of_a_faster_rate():
    structure, force = slipping(100.0)
    fast = time_response(structure, force, fs=8e3, duration_s=0.2, loads=[[0.0], [1.0]])
    slow = time_response(structure, force, fs=2e3, duration_s=0.2, loads=[[0.0], [1.0]], steps_per_sample=4)
    assert slow.time_s.shape == (400,)
    for name in ("displacement", "velocity", "acceleration"):
        np.testing.assert_array_equal(getattr(slow, name), getattr(fast, name)[: 4 * 400 : 4])


def test_block_by_block_is_at_once():
    structure, force = slipping(100.0)
    loads = [[0.2], [1.0]]
    forces = force(np.arange(2 * 3 * 300 + 1) / (2.0 * 3 * 3e3))
    whole = time_response(
        structure, forces, fs=3e3, duration_s=301 / 3e3, loads=loads, steps_per_sample=3, initial_displacement=[1e-4, 0]
    )
    ready = assemble(structure, loads)
    state, begin = state_at(ready, [1e-4, 0.0]), 0
    for n in (1, 60, 7, 232):
        block = forces[6 * begin : 6 * (begin + n) + 1]
        before = state.slider_positions.copy()
        motion, after = advance(ready, state, block, fs=3e3, steps_per_sample=3)
        np.testing.assert_array_equal(state.slider_positions, before)
        for name in ("displacement", "velocity", "acceleration"):
            np.testing.assert_array_equal(getattr(motion, name), getattr(whole, name)[begin : begin + n + 1])
        state, begin = after, begin + n
    np.testing.assert_array_equal(state.displacement, whole.displacement[-1])


def test_a_structure_that_slips_loses_energy_and_one_that_sticks_keeps_it():
    sliders = Sliders([800.0], [1.0])
    slips = Structure([[2.0]], [[0.0]], [[100.0]], (Joint("bolts", [1.0], sliders=sliders),))
    for displacement, kept in ((1e-3, 1.0), (0.01, 0.25)):
        motion = time_response(slips, no_force(1), fs=1e3, duration_s=5.0, initial_displacement=[displacement])
        x = motion.displacement[:, 0]
        force, _ = force_of(sliders, x)
        stored = motion.velocity[:, 0] ** 2 + 50.0 * x**2 + 0.5 * force**2 / 800.0
        assert (np.diff(stored) < 1e-6 * stored[0]).all()
        if kept == 1.0:
            np.testing.assert_allclose(stored, stored[0], rtol=1e-6)
        else:
            assert stored[-1] < kept * stored[0]


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
        (lambda: time_response(UNSTABLE, no_force(1), fs=10.0, duration_s=1.0, loads=[1.0]), r"have shape \(1,\)"),
        (lambda: time_response(UNSTABLE, no_force(1), fs=10.0, duration_s=1.0, loads=[[1.0, 2.0]]), r"give \(19, 2\)"),
        (lambda: time_response(UNSTABLE, no_force(1), fs=10.0, duration_s=1.0, steps_per_sample=0),
         "steps_per_sample is 0"),
        (lambda: time_response(UNSTABLE, no_force(1), fs=10.0, duration_s=1.0, steps_per_sample=1.5),
         "steps_per_sample is 1.5"),
        (lambda: advance(assemble(UNSTABLE), state_at(assemble(UNSTABLE)), np.zeros((7, 1)), fs=1.0,
                         steps_per_sample=2), r"the forces have shape \(7, 1\)"),
        (lambda: advance(assemble(UNSTABLE), state_at(assemble(UNSTABLE)), np.zeros(7), fs=1.0), "forces have shape"),
        (lambda: advance(assemble(UNSTABLE), state_at(assemble(UNSTABLE)), np.full((3, 1), np.inf), fs=1.0),
         "not finite"),
        (lambda: advance(assemble(UNSTABLE), state_at(assemble(UNSTABLE), [1e300]), np.zeros((9, 1)), fs=1e-9,
                         steps_per_sample=2), "take steps_per_sample above 2"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()
