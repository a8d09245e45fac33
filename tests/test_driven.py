"""A body driven by measured accelerations: against an independent integrator; derivatives against differences."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from opid.errors import InputError
from opid.mechanics.driven import Interface, UnboundedResponseError, driven_response, half_steps
from opid.mechanics.landing_gear import DEFAULT_LAW, LandingGear, taxi_run
from opid.mechanics.laws import LAWS, default_law

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
        z, v, x, w = y
        b = -(k * z + c * v + g * x + float(law.force(z, v))) / mass
        return [v, b - _drive(t), w, b]

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
    share = 1 / 1850.0
    base = np.array([3.9e5, 6e3, 1e5, *law.vector, share, 0.0, *start[:, 0]])

    def answer(p):
        n_law = law.vector.size
        interface = Interface(p[0], p[1], p[2], law.with_vector(p[3 : 3 + n_law]))
        return driven_response(
            [interface],
            [[p[3 + n_law]]],
            drive + p[4 + n_law],
            fs=FS,
            accelerance_directions=[[[1.0]]],
            drive_directions=np.ones((2 * n - 1, 1, 1)),
            start=p[5 + n_law :, None],
        )

    exact = answer(base).sensitivity[:, 0]
    for i, value in enumerate(base):
        step = 1e-5 * max(abs(value), 1e-2 if i > 3 + law.vector.size else 0.0)
        up, down = base.copy(), base.copy()
        up[i] += step
        down[i] -= step
        difference = (answer(up).acceleration[:, 0] - answer(down).acceleration[:, 0]) / (2 * step)
        # a law with a corner (x|x|, |x|^n) is differentiated on either side of it by the difference
        np.testing.assert_allclose(exact[:, i], difference, atol=2e-4 * np.abs(difference).max() + 1e-12)


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
    with pytest.raises(UnboundedResponseError, match="grows without bound"):
        driven_response([Interface(-4e6, 0.0)], [[1.0]], np.ones((20001, 1)), fs=100.0)
