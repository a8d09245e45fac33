import numpy as np
import pytest
from jointed_systems import CUBIC, EVEN, GAS, QUADRATIC, QUARTIC, QUINTIC, ROOT, one_mass, pylon_matrices, two_pylons
from scipy.integrate import quad
from shooting import shoot

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.backbones.family import backbone
from opid.mechanics.backbones.harmonic_balance import (
    balance,
    harmonics_of,
    joint_harmonics,
    linear_unknowns,
    modal_motion,
    period_transform,
    residual,
    solve_at,
)
from opid.mechanics.laws.law import default_law

SYSTEM = two_pylons(0.05)
EVEN_LAWS = [EVEN, EVEN + CUBIC, GAS]
ODD_LAWS = [CUBIC, QUINTIC, QUADRATIC, QUARTIC, CUBIC + QUADRATIC]


def used(law):
    return (0, 1, 2, 3) if law in EVEN_LAWS else (1, 3, 5)


@pytest.mark.parametrize("law", [*ODD_LAWS, *EVEN_LAWS, ROOT], ids=lambda law: law.name)
def test_harmonics_of_a_force_are_its_fourier_integrals(law):
    harmonics = used(law)
    coefficients = np.array([2e-3, -3e-4, 1e-4, 5e-5][: len(harmonics)])
    if 0 in harmonics:
        coefficients = np.array([1e-4, 2e-3, -3e-4, 5e-5])
    transform = period_transform(law.terms, harmonics)
    force, slopes = joint_harmonics((law,), transform, coefficients[:, np.newaxis])

    def motion(theta):
        return coefficients @ np.cos(np.multiply.outer(harmonics, theta))

    # the integrals are cut at the corners of the laws, where the motion passes zero
    theta = np.linspace(0.0, np.pi, 20001)
    z = motion(theta)
    corners = theta[:-1][z[:-1] * z[1:] < 0.0] + np.pi / 40000
    scale = np.abs(force).max()
    tolerance = 1e-6 if law is ROOT else 1e-10
    for k, h in enumerate(harmonics):
        whole, _ = quad(
            lambda t, h=h: float(law.force(motion(t), 0.0)) * np.cos(h * t),
            0,
            np.pi,
            points=corners,
            epsabs=1e-13 * scale,
        )
        assert force[k, 0] == pytest.approx(whole * (1 if h == 0 else 2) / np.pi, abs=tolerance * scale)
    for g in range(len(harmonics)):
        step = 1e-6 * np.abs(coefficients).max() * np.eye(len(harmonics))[g]
        up, down = (joint_harmonics((law,), transform, (coefficients + s)[:, np.newaxis])[0] for s in (step, -step))
        numeric = (up - down)[:, 0] / (2 * step[g])
        np.testing.assert_allclose(slopes[0, :, g], numeric, rtol=1e-5, atol=1e-6 * np.abs(slopes).max())


@pytest.mark.parametrize("law", [CUBIC, QUADRATIC, EVEN + CUBIC], ids=lambda law: law.name)
def test_the_jacobian_is_the_derivative_of_the_equations(law):
    equations = balance(SYSTEM, (law,) * 4, mode=3, sensor="tip 1", harmonics=used(law))
    rng = np.random.default_rng(7)
    start = linear_unknowns(equations, 1e-3)
    scale = np.append(np.full(start.size - 1, 1e-3), start[-1])
    point = start + 0.05 * scale * rng.standard_normal(start.size)
    _, jacobian = residual(equations, point, 1e-3)
    for _ in range(3):
        along = 1e-6 * scale * rng.standard_normal(start.size)
        numeric = (residual(equations, point + along, 1e-3)[0] - residual(equations, point - along, 1e-3)[0]) / 2
        exact = jacobian @ along
        np.testing.assert_allclose(numeric, exact, rtol=0, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize("law", [CUBIC, QUADRATIC, EVEN, GAS], ids=lambda law: law.name)
def test_the_compiled_way_and_the_one_in_numpy_are_one(law):
    amplitudes = np.linspace(0.2e-3, 1.5e-3, 6)
    curve = backbone(SYSTEM, law, mode=4, sensor="tip 1", amplitude=amplitudes, harmonics=used(law))
    equations = balance(SYSTEM, (law,) * 4, mode=4, sensor="tip 1", harmonics=used(law))
    unknowns = linear_unknowns(equations, amplitudes[0])
    for point, amplitude in enumerate(amplitudes):
        unknowns = solve_at(equations, unknowns, amplitude)
        assert np.sqrt(unknowns[-1]) / (2 * np.pi) == pytest.approx(curve.frequency_hz[point], rel=1e-12)
        motion = modal_motion(equations, unknowns)
        first = equations.harmonics.index(1)
        np.testing.assert_allclose(SYSTEM.at_sensors @ motion[first], curve.shapes[point], rtol=1e-9, atol=1e-14)
        np.testing.assert_allclose(motion @ SYSTEM.at_joints.T, curve.extension[point], rtol=1e-8, atol=1e-13)


def test_only_laws_that_are_not_odd_keep_even_harmonics():
    assert harmonics_of(CUBIC.terms, (3, 2, 1, 0)) == (1, 3)
    assert harmonics_of((CUBIC + EVEN).terms, (3, 2, 1, 0)) == (0, 1, 2, 3)
    assert harmonics_of(default_law("dead_zone_stiffness").terms, (0, 1)) == (1,)
    with pytest.raises(InputError, match="asymmetric_stiffness is not odd"):
        harmonics_of(default_law("asymmetric_stiffness").terms, (1, 2, 3))


NINE = (1, 3, 5, 7, 9)


@pytest.mark.parametrize(
    ("law", "mode", "harmonics", "tolerance"),
    [
        (CUBIC, 4, NINE, 1e-8),
        (QUINTIC, 4, NINE, 1e-8),
        (CUBIC + QUINTIC, 3, NINE, 1e-8),
        (QUADRATIC, 4, NINE, 1e-6),
        (EVEN, 3, tuple(range(8)), 1e-8),
        (GAS, 4, tuple(range(8)), 1e-8),
    ],
    ids=lambda each: getattr(each, "name", None),
)
def test_harmonic_balance_is_the_motion_in_time(law, mode, harmonics, tolerance):
    curve = backbone(SYSTEM, law, mode=mode, sensor="tip 1", amplitude=[0.5e-3, 1e-3, 2e-3], harmonics=harmonics)
    motion = shoot(SYSTEM, law, curve, point=2)
    assert abs(curve.frequency_hz[2] / motion.frequency_hz - 1.0) < tolerance
    assert motion.amplitude == pytest.approx(2e-3, rel=1e-9)
    assert motion.mismatch < 1e-8
    # the nonlinear force is no trifle there
    assert abs(curve.frequency_hz[2] / SYSTEM.frequency_hz[mode - 1] - 1.0) > 1e-3


def test_more_harmonics_come_nearer_to_the_motion_in_time():
    curves = [
        backbone(SYSTEM, CUBIC, mode=4, sensor="tip 1", amplitude=[1e-3, 2e-3], harmonics=NINE[:n]) for n in (1, 2, 4)
    ]
    motion = shoot(SYSTEM, CUBIC, curves[-1], point=1)
    errors = [abs(curve.frequency_hz[1] / motion.frequency_hz - 1.0) for curve in curves]
    assert errors[0] > 30 * errors[1]
    assert errors[1] > 30 * errors[2]


def test_a_free_spring_mass_of_a_cubic_has_the_period_of_an_elliptic_integral():
    # x'' + w x + c x^3 = 0 from rest at X: T = 4 sqrt(2) / X int_0^1 ds / sqrt((1 - s^2) (c (1 + s^2) + 2 w / X^2))
    curve = backbone(one_mass(100.0, 2.0), CUBIC, mode=1, sensor="mass", amplitude=[2e-3], harmonics=(*NINE, 11, 13))
    start = curve.extension[0].sum()

    def inverse_speed(angle):
        s = np.sin(angle)
        return 1.0 / np.sqrt(0.5 * 3e7 * (1.0 + s**2) * start**2 + 50.0)

    period, _ = quad(inverse_speed, 0.0, np.pi / 2, epsabs=0.0, epsrel=1e-13)
    assert curve.frequency_hz[0] == pytest.approx(1.0 / (4.0 * period), rel=1e-8)
    assert shoot(one_mass(100.0, 2.0), CUBIC, curve, point=0).frequency_hz == pytest.approx(
        curve.frequency_hz[0], rel=1e-8
    )


def test_the_system_of_the_tests_is_its_matrices():
    mass, stiffness, _ = pylon_matrices(0.05)
    expected = np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)
    np.testing.assert_allclose(SYSTEM.eigenvalue, expected, rtol=1e-9)


def test_shooting_says_what_it_cannot_do():
    curve = backbone(one_mass(), CUBIC, mode=1, sensor="mass", amplitude=[1e-3])
    with pytest.raises(InputError, match="point 1 is not among the converged"):
        shoot(one_mass(), CUBIC, curve, point=1)
    # one harmonic says nothing of a mass that hangs on stops
    wrong = backbone(SYSTEM, CUBIC, mode=3, sensor="tip 1", amplitude=[1e-3, 2e-3, 4e-3])
    stops = default_law("dead_zone_stiffness").scaled(1e3)
    with pytest.raises((NotDeterminedError, InputError)):
        shoot(SYSTEM, stops + CUBIC, wrong, point=5)
