"""A body driven by measured accelerations: against an independent integrator; derivatives against differences."""

import numpy as np
import pytest
from driven_response import driven_response
from scipy.integrate import solve_ivp

from opid.errors import InputError
from opid.mechanics.driven import Interface, UnboundedResponseError, half_steps
from opid.mechanics.laws.law import LAWS, default_law
from opid.virtual.taxi_tests.airframe import DEFAULT_LAW, LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_run

FS = 512.0


def _drive(t):
    return 2.0 * np.sin(2 * np.pi * 1.7 * t) + 1.5 * np.sin(2 * np.pi * 6.1 * t + 1) + 0.5 * np.sin(2 * np.pi * 14 * t)


def _half(n):
    return np.arange(2 * n - 1) / (2 * FS)


def test_one_gear_agrees_with_an_independent_integrator():
    n, mass, k, c, g = 1024, 1850.0, 3.9e5, 6e3, 2e5
    law = DEFAULT_LAW + default_law("cubic_stiffness")
    start = np.array([[2e-3], [0.05], [1e-3], [-0.02]])
    response = driven_response([Interface(k, c, g, law)], [[1 / mass]], _drive(_half(n))[:, None], fs=FS, start=start)

    def rate(t, y):
        z, v, x1, w1 = y
        b = -(k * z + c * v + g * (z + x1) + float(law.force(z, v))) / mass
        return [v, b - _drive(t), w1, _drive(t)]

    t = np.arange(n) / FS
    exact = solve_ivp(rate, (0, t[-1]), start[:, 0], t_eval=t, method="DOP853", rtol=1e-10, atol=1e-12, max_step=1e-3)
    np.testing.assert_allclose(response.travel[:, 0], exact.y[0], atol=1e-5 * exact.y[0].std())
    np.testing.assert_allclose(response.velocity[:, 0], exact.y[1], atol=1e-4 * exact.y[1].std())


def test_two_coupled_interfaces_agree_with_an_independent_integrator():
    """A rigid beam on two suspensions: the airframe of a later day."""
    n = 512
    A = np.array([[1.0, 0.3], [0.3, 0.8]]) / 1000
    interfaces = [Interface(2e5, 3e3, law=DEFAULT_LAW), Interface(3e5, 2e3)]
    drive = np.stack([_drive(_half(n)), _drive(_half(n) + 0.3)], axis=1)
    response = driven_response(interfaces, A, drive, fs=FS)

    def rate(t, y):
        z, v = y[:2], y[2:]
        force = np.array(
            [i.stiffness * z[j] + i.damping * v[j] + i.law.force(z[j], v[j]) for j, i in enumerate(interfaces)]
        )
        return np.concatenate([v, -A @ force - [_drive(t), _drive(t + 0.3)]])

    t = np.arange(n) / FS
    exact = solve_ivp(rate, (0, t[-1]), np.zeros(4), t_eval=t, method="DOP853", rtol=1e-9, atol=1e-12, max_step=1e-3)
    np.testing.assert_allclose(response.travel.T, exact.y[:2], atol=1e-5 * exact.y[:2].std())


@pytest.mark.parametrize("name", ["linear", *LAWS])
def test_derivatives_are_those_of_the_steps(name):
    n = 400
    law = default_law(name)
    start = np.array([[1e-3], [0.02], [1e-3], [0.01]])
    drive = _drive(_half(n))[:, None]
    fraction = 1 / 1850.0
    base = np.array([3.9e5, 6e3, 1e5, 0.002, *law.vector, fraction, 0.0, *start[:, 0]])

    def answer(p):
        n_law = law.vector.size
        interface = Interface(p[0], p[1], p[2], law.with_vector(p[4 : 4 + n_law]).resting_at(p[3]))
        return driven_response(
            [interface],
            [[p[4 + n_law]]],
            drive + p[5 + n_law],
            fs=FS,
            accelerance_directions=[[[1.0]]],
            drive_directions=np.ones((2 * n - 1, 1, 1)),
            start=p[6 + n_law :, None],
        )

    exact = answer(base).sensitivity[:, 0]
    for i, value in enumerate(base):
        step = 1e-5 * max(abs(value), 1e-2 if i > 4 + law.vector.size else 0.0)
        up, down = base.copy(), base.copy()
        up[i] += step
        down[i] -= step
        difference = (answer(up).acceleration[:, 0] - answer(down).acceleration[:, 0]) / (2 * step)
        # a law with a corner (x|x|, |x|^n) is differentiated on either side of it by the difference
        np.testing.assert_allclose(exact[:, i], difference, atol=2e-4 * np.abs(difference).max() + 1e-12)


def _two_coupled(p, drive, n_law):
    first = default_law("arctan_mixed+cubic_stiffness").with_vector(p[6 : 6 + n_law])
    interfaces = [Interface(*p[:3], first), Interface(*p[3:6], default_law("gas_column"))]
    A = np.array([[1.0, 0.3], [0.3, 0.8]]) / 1000
    by_mass = np.array([[[1.0, 0.2], [0.2, 0.5]]]) / 1000
    by_drive = np.stack([_drive(_half(drive.shape[0] // 2 + 1) + 0.1), 0 * drive[:, 0] + 1], axis=1)[:, None]
    theta, offset, start = p[6 + n_law], p[7 + n_law], p[8 + n_law :].reshape(4, 2)
    return driven_response(
        interfaces,
        A + theta * by_mass[0],
        drive + offset * by_drive[:, 0],
        fs=FS,
        accelerance_directions=by_mass,
        drive_directions=by_drive,
        start=start,
    )


def test_derivatives_of_two_coupled_interfaces_are_those_of_the_steps():
    n, n_law = 300, 4
    drive = np.stack([_drive(_half(n)), _drive(_half(n) + 0.3)], axis=1)
    law = default_law("arctan_mixed+cubic_stiffness").vector
    start = [1e-3, -1e-3, 0.02, 0.01, 1e-3, 2e-3, 0.01, -0.03]
    base = np.array([2e5, 3e3, 1e5, 3e5, 2e3, 5e4, *law, 0.1, 0.2, *start])
    exact = _two_coupled(base, drive, n_law).sensitivity
    # in the order of the response: each interface with its rest and its law, the mass, the drive, the start
    second = 4 + n_law
    places = [*range(3), *range(second, second + 3), *range(4, second), *range(second + 7, exact.shape[2])]
    assert exact.shape == (n, 2, base.size + 2 + 3)
    for i, place in enumerate(places):
        step = np.zeros(base.size)
        step[i] = 1e-5 * max(abs(base[i]), 1e-3)
        up, down = (_two_coupled(base + sign * step, drive, n_law).acceleration for sign in (1, -1))
        difference = (up - down) / (2 * step[i])
        np.testing.assert_allclose(exact[:, :, place], difference, atol=1e-6 * np.abs(difference).max())


@pytest.mark.parametrize("ground_stiffness", [0.0, 1e5])
def test_one_interface_is_the_first_of_two_that_know_nothing_of_each_other(ground_stiffness):
    n = 500
    u = _drive(_half(n))[:, None]
    gear = Interface(3.9e5, 6e3, ground_stiffness, default_law("arctan_mixed+asymmetric_damping"))
    start = np.array([[1e-3], [0.02], [1e-3], [0.01]])
    alone = driven_response(
        [gear],
        [[5e-4]],
        u,
        fs=FS,
        accelerance_directions=[[[1.0]]],
        drive_directions=np.stack([u, u**2], axis=1),
        start=start,
    )
    both = driven_response(
        [gear, gear],
        np.eye(2) * 5e-4,
        np.repeat(u, 2, axis=1),
        fs=FS,
        accelerance_directions=[np.diag([1.0, 0.0])],
        drive_directions=np.stack([u, u**2], axis=1) * [1.0, 0.0],
        start=np.repeat(start, 2, axis=1),
    )
    n_own = gear.n_parameters
    own = [*range(n_own), *range(2 * n_own, 2 * n_own + 3), *range(2 * n_own + 3, 2 * n_own + 11, 2)]
    np.testing.assert_allclose(both.acceleration[:, 0], alone.acceleration[:, 0], rtol=1e-9, atol=1e-12)
    size = np.abs(alone.sensitivity).max(axis=0)
    off = np.abs(both.sensitivity[:, :1, own] - alone.sensitivity).max(axis=0)
    assert (off <= 1e-10 * size).all()


def test_what_nobody_asks_for_is_left_out():
    n = 400
    u = _drive(_half(n))[:, None]
    gear = Interface(3.9e5, 6e3, 0.0, DEFAULT_LAW)
    whole = driven_response([gear], [[5e-4]], u, fs=FS)
    free = driven_response([gear], [[5e-4]], u, fs=FS, ground=False)
    bare = driven_response([gear], [[5e-4]], u, fs=FS, ground=False, sensitivity=False)
    for other in (free, bare):
        np.testing.assert_array_equal(other.acceleration, whole.acceleration)
        np.testing.assert_array_equal(other.travel, whole.travel)
    assert whole.sensitivity[:, 0, 2].any()
    by_ground = [2, -2, -1]
    assert not free.sensitivity[:, 0, by_ground].any()
    np.testing.assert_array_equal(
        np.delete(free.sensitivity, by_ground, axis=2), np.delete(whole.sensitivity, by_ground, axis=2)
    )
    assert bare.sensitivity.shape == (n, 1, 0)
    # transforms run along time
    assert whole.sensitivity[:, 0, 0].flags.c_contiguous


def test_the_measured_spindle_drives_the_true_motion():
    run = taxi_run(LandingGear(), rng=np.random.default_rng(0), duration_s=12, fs=FS)
    gear = run.gear
    interface = Interface(gear.suspension_stiffness_n_per_m, gear.suspension_damping_n_s_per_m, law=gear.law)
    drive = half_steps(run.truth.channel("lower_z"))[:, None]
    response = driven_response([interface], [[1 / gear.sprung_mass_kg]], drive, fs=FS)
    forgotten = slice(4 * 512, -64)
    travel = run.truth.channel("travel")
    assert np.std((response.travel[:, 0] - travel)[forgotten]) < 2e-3 * travel.std()
    # the slow motion is there too, which no integration of the accelerations gives
    assert np.std((response.acceleration[:, 0] - run.truth.channel("upper_z"))[forgotten]) < 1e-3


def test_half_steps_keep_the_samples():
    x = np.random.default_rng(0).standard_normal((50, 2))
    doubled = half_steps(x)
    assert doubled.shape == (99, 2)
    np.testing.assert_array_equal(doubled[::2], x)


def test_bad_input_is_named():
    with pytest.raises(InputError, match="for 1 interface"):
        driven_response([Interface(1.0, 1.0)], np.eye(2), np.zeros((9, 1)), fs=1.0)
    with pytest.raises(InputError, match="ground is False"):
        driven_response([Interface(1.0, 1.0, 1.0)], [[1.0]], np.zeros((9, 1)), fs=1.0, ground=False)
    with pytest.raises(UnboundedResponseError, match="grows without bound"):
        driven_response([Interface(-4e6, 0.0)], [[1.0]], np.ones((20001, 1)), fs=100.0)
