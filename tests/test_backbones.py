import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from jointed_systems import (
    ARCTAN,
    CUBIC,
    EVEN,
    GAS,
    QUADRATIC,
    QUARTIC,
    QUINTIC,
    ROOT,
    TIP_MODES,
    one_mass,
    pylon_matrices,
    spring,
    two_pylons,
)
from plain_backbones import plain_backbone

from opid.errors import InputError
from opid.mechanics.backbones.family import backbone, family_evaluator
from opid.mechanics.backbones.harmonic_balance import first_harmonic_factor
from opid.mechanics.backbones.jointed_modes import JointedModes, jointed_modes
from opid.mechanics.laws.law import LINEAR, Law, default_law

AMPLITUDE = np.linspace(0.2e-3, 2.5e-3, 12)
SYSTEM = two_pylons(0.05)


def eigenvalue(curve):
    return (2 * np.pi * curve.frequency_hz) ** 2


def plain(law, mode, amplitude=AMPLITUDE, harmonics=(1,), n_times=64):
    mass, stiffness, joint_rows = pylon_matrices(0.05)
    return plain_backbone(
        mass,
        stiffness,
        law,
        joint_rows=joint_rows,
        sensor_row=np.eye(10)[6],
        mode=mode,
        amplitude=amplitude,
        harmonics=harmonics,
        n_times=n_times,
    )


def test_a_duffing_oscillator_has_its_closed_form():
    curve = backbone(one_mass(100.0, 2.0), CUBIC, mode=1, sensor="mass", amplitude=AMPLITUDE)
    np.testing.assert_allclose(eigenvalue(curve), 100.0 / 2.0 + 0.75 * 6e7 * AMPLITUDE**2 / 2.0, rtol=1e-12)
    np.testing.assert_allclose(curve.shapes[:, 0], AMPLITUDE, rtol=1e-13)
    assert curve.converged.all()
    assert curve.reason == ""


@pytest.mark.parametrize(
    ("law", "power", "coefficient"),
    [(QUADRATIC, 2, 1.8e5), (QUARTIC, 4, 2e10), (QUINTIC, 5, 6e12), (ROOT, 1.5, 8e3)],
    ids=lambda each: getattr(each, "name", None),
)
def test_a_power_law_has_its_closed_form_and_the_quadrature_its_value(law, power, coefficient):
    theta = (np.arange(40_000) + 0.5) * 2 * np.pi / 40_000
    factor = 2 * np.mean(np.abs(np.cos(theta)) ** (power + 1))
    assert first_harmonic_factor(power) == pytest.approx(factor, rel=1e-8)
    curve = backbone(one_mass(), law, mode=1, sensor="mass", amplitude=AMPLITUDE)
    np.testing.assert_allclose(
        eigenvalue(curve),
        50.0 + first_harmonic_factor(power) * coefficient * AMPLITUDE ** (power - 1) / 2.0,
        rtol=1e-12,
    )


@pytest.mark.parametrize("mode", TIP_MODES)
@pytest.mark.parametrize(
    ("law", "n_times"),
    [(CUBIC, 16), (QUINTIC, 16), (CUBIC + QUINTIC, 16), (QUADRATIC, 6000), (QUADRATIC + CUBIC, 6000)],
)
def test_condensed_on_the_joints_nothing_changes(law, n_times, mode):
    curve = backbone(SYSTEM, law, mode=mode, sensor="tip 1", amplitude=AMPLITUDE)
    frequency_hz, motion = plain(law, mode, n_times=n_times)
    np.testing.assert_allclose(curve.frequency_hz, frequency_hz, rtol=1e-10)
    np.testing.assert_allclose(curve.shapes, motion[:, 0], rtol=1e-8, atol=1e-10 * AMPLITUDE[-1])


def test_condensed_with_three_harmonics_nothing_changes():
    curve = backbone(SYSTEM, CUBIC, mode=4, sensor="tip 1", amplitude=AMPLITUDE, harmonics=(5, 1, 3))
    frequency_hz, motion = plain(CUBIC, 4, harmonics=(1, 3, 5))
    assert curve.harmonics == (1, 3, 5)
    np.testing.assert_allclose(curve.frequency_hz, frequency_hz, rtol=1e-10)
    np.testing.assert_allclose(curve.shapes, motion[:, 0], rtol=1e-8, atol=1e-10 * AMPLITUDE[-1])
    joint_rows = pylon_matrices(0.05)[2]
    np.testing.assert_allclose(curve.extension, motion @ joint_rows.T, rtol=1e-7, atol=1e-10 * AMPLITUDE[-1])


def test_laws_that_are_not_odd_have_a_mean_and_even_harmonics():
    for law, n_times in ((EVEN, 32), (EVEN + CUBIC, 32), (GAS, 512)):
        curve = backbone(SYSTEM, law, mode=4, sensor="tip 1", amplitude=AMPLITUDE[:8], harmonics=(0, 1, 2, 3))
        frequency_hz, motion = plain(law, 4, AMPLITUDE[:8], (0, 1, 2, 3), n_times)
        np.testing.assert_allclose(curve.frequency_hz, frequency_hz, rtol=1e-10)
        np.testing.assert_allclose(curve.shapes, motion[:, 1], rtol=1e-8, atol=1e-10 * AMPLITUDE[-1])
        assert np.abs(curve.extension[:, 0]).max() > 1e-5


def test_the_closed_form_is_the_sum_over_times_of_a_period():
    # a law of three kinds, one with an amplitude of zero and no closed form, takes the other way
    by_times = CUBIC + QUADRATIC + spring("dead_zone_stiffness", 0.0, 1e-3)
    closed, summed = (
        backbone(SYSTEM, law, mode=3, sensor="tip 1", amplitude=AMPLITUDE) for law in (CUBIC + QUADRATIC, by_times)
    )
    np.testing.assert_allclose(summed.frequency_hz, closed.frequency_hz, rtol=1e-12)


def test_it_begins_in_the_linear_mode_and_stays_there_without_a_law():
    small = backbone(SYSTEM, CUBIC, mode=3, sensor="tip 1", amplitude=[1e-8, 1e-7, 1e-6], harmonics=(1, 3))
    np.testing.assert_allclose(small.frequency_hz, SYSTEM.frequency_hz[2], rtol=1e-6)
    for law in (LINEAR, spring("cubic_stiffness", 0.0)):
        curve = backbone(SYSTEM, law, mode=3, sensor="tip 1", amplitude=AMPLITUDE)
        np.testing.assert_allclose(curve.frequency_hz, SYSTEM.frequency_hz[2], rtol=1e-13)
        shape = SYSTEM.at_sensors[:, 2] / SYSTEM.at_sensors[6, 2]
        np.testing.assert_allclose(curve.shapes, np.outer(AMPLITUDE, shape), rtol=1e-12)
    without = JointedModes(SYSTEM.eigenvalue, SYSTEM.at_sensors, np.empty((0, 10)), SYSTEM.sensors, ())
    curve = backbone(without, CUBIC, mode=3, sensor="tip 1", amplitude=AMPLITUDE)
    np.testing.assert_allclose(curve.frequency_hz, SYSTEM.frequency_hz[2], rtol=1e-13)


def test_a_law_with_a_stiffness_at_rest_begins_in_the_mode_with_that_stiffness():
    mass, stiffness, joint_rows = pylon_matrices(0.05)
    stiffened = stiffness + joint_rows.T @ joint_rows * 4.0 * 2 / np.pi / 2e-3
    expected = np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffened)).real) / (2 * np.pi)
    curve = backbone(SYSTEM, ARCTAN, mode=4, sensor="tip 1", amplitude=[1e-6, 1e-3], harmonics=(1, 3))
    assert curve.converged.all()
    assert np.abs(expected - curve.frequency_hz[0]).min() < 1e-5
    assert curve.frequency_hz[1] < curve.frequency_hz[0] - 0.1


@settings(max_examples=20)
@given(factor=st.floats(0.2, 5.0), power=st.sampled_from([2, 3, 4, 5]))
def test_a_monomial_knows_only_its_coefficient_times_a_power_of_the_amplitude(factor, power):
    name = ["quadratic", "cubic", "quartic", "quintic"][power - 2]
    coefficient = [0, 0, 5e4, 2e7, 1e10, 4e12][power]
    amplitude = AMPLITUDE[:6]
    one = backbone(
        SYSTEM, spring(f"{name}_stiffness", coefficient), mode=4, sensor="tip 1", amplitude=amplitude, harmonics=(1, 3)
    )
    other = backbone(
        SYSTEM,
        spring(f"{name}_stiffness", coefficient * factor ** (1 - power)),
        mode=4,
        sensor="tip 1",
        amplitude=factor * amplitude,
        harmonics=(1, 3),
    )
    np.testing.assert_allclose(other.frequency_hz, one.frequency_hz, rtol=1e-11)
    np.testing.assert_allclose(other.shapes, factor * one.shapes, rtol=1e-9, atol=1e-15)


def test_two_equal_masses_keep_their_symmetric_motions():
    mass, stiffness = 1.5 * np.eye(2), np.array([[90.0, -20.0], [-20.0, 90.0]])
    rows = np.array([[1.0, 0.0], [0.0, 1.0]])
    pair = jointed_modes(
        mass, stiffness, sensor_rows=np.eye(2), joint_rows=rows, sensors=("a", "b"), joints=("left", "right")
    )
    for mode, sign, linear in ((1, 1.0, 70.0), (2, -1.0, 110.0)):
        curve = backbone(pair, spring("cubic_stiffness", 2e6), mode=mode, sensor="a", amplitude=AMPLITUDE)
        np.testing.assert_allclose(eigenvalue(curve), (linear + 0.75 * 2e6 * AMPLITUDE**2) / 1.5, rtol=1e-12)
        np.testing.assert_allclose(curve.shapes, np.outer(AMPLITUDE, [1.0, sign]), rtol=1e-10)


def test_a_free_structure_with_rigid_body_modes_and_a_system_of_few_modes():
    free = two_pylons(0.05, suspension=0.0)
    held = two_pylons(0.05, suspension=1e-3)
    one, other = (
        backbone(each, CUBIC + EVEN, mode=4, sensor="tip 1", amplitude=AMPLITUDE[:6], harmonics=(0, 1, 2, 3))
        for each in (free, held)
    )
    assert one.converged.all()
    np.testing.assert_allclose(one.frequency_hz, other.frequency_hz, rtol=1e-5)
    few = JointedModes(
        SYSTEM.eigenvalue[:6], SYSTEM.at_sensors[:, :6], SYSTEM.at_joints[:, :6], SYSTEM.sensors, SYSTEM.joints
    )
    cut, whole = (backbone(each, CUBIC, mode=3, sensor="tip 1", amplitude=AMPLITUDE[:6]) for each in (few, SYSTEM))
    np.testing.assert_allclose(cut.frequency_hz, whole.frequency_hz, rtol=2e-2)


def test_every_joint_may_have_its_own_law():
    laws = [CUBIC, QUADRATIC, LINEAR, CUBIC + QUINTIC]
    curve = backbone(SYSTEM, laws, mode=3, sensor="tip 1", amplitude=AMPLITUDE)
    same = backbone(SYSTEM, CUBIC, mode=3, sensor="tip 1", amplitude=AMPLITUDE)
    assert np.abs(curve.frequency_hz / same.frequency_hz - 1.0).max() > 1e-3
    again = backbone(SYSTEM, [CUBIC] * 4, mode=3, sensor="tip 1", amplitude=AMPLITUDE)
    np.testing.assert_array_equal(again.frequency_hz, same.frequency_hz)


def test_the_order_of_the_amplitudes_and_the_sensor_held_change_nothing():
    # beyond, tip 4 moves less while tip 1 moves more
    amplitude = AMPLITUDE[:8]
    curve = backbone(SYSTEM, CUBIC, mode=4, sensor="tip 1", amplitude=amplitude)
    shuffled = np.random.default_rng(5).permutation(amplitude.size)
    other = backbone(SYSTEM, CUBIC, mode=4, sensor="tip 1", amplitude=amplitude[shuffled])
    np.testing.assert_array_equal(other.frequency_hz, curve.frequency_hz[shuffled])
    np.testing.assert_array_equal(other.shapes, curve.shapes[shuffled])
    # tip 4 moves against tip 1, so its own amplitude has the other sign there
    place = SYSTEM.sensor("tip 4")
    held = backbone(SYSTEM, CUBIC, mode=4, sensor="tip 4", amplitude=np.abs(curve.shapes[:, place]))
    np.testing.assert_allclose(held.frequency_hz, curve.frequency_hz, rtol=1e-11)
    np.testing.assert_allclose(held.shapes, np.sign(curve.shapes[:, [place]]) * curve.shapes, rtol=1e-8, atol=1e-15)


@pytest.mark.parametrize("harmonics", [(1,), (1, 3)])
def test_a_family_is_its_backbones(harmonics):
    coefficients = np.array([[1e5, 0.0], [0.0, 5e7], [1.8e5, 3e7]])
    kinds = ("quadratic_stiffness", "cubic_stiffness")
    family = family_evaluator(SYSTEM, kinds, mode=4, sensor="tip 1", amplitude=AMPLITUDE, harmonics=harmonics)(
        coefficients
    )
    assert family.converged.all()
    for row, (quadratic, cubic) in enumerate(coefficients):
        law = spring("quadratic_stiffness", quadratic) + spring("cubic_stiffness", cubic)
        curve = backbone(SYSTEM, law, mode=4, sensor="tip 1", amplitude=AMPLITUDE, harmonics=harmonics)
        np.testing.assert_allclose(family.frequency_hz[row], curve.frequency_hz, rtol=1e-13)
        np.testing.assert_allclose(family.shapes[row], curve.shapes, rtol=1e-10, atol=1e-16)


def test_a_family_takes_the_inner_parameters_of_a_kind_as_columns():
    amplitude = AMPLITUDE[:3]
    solve = family_evaluator(one_mass(), ("signed_power_stiffness",), mode=1, sensor="mass", amplitude=amplitude)
    family = solve([[8e3, 1.5], [6e7, 3.0]])
    for row, law in enumerate((ROOT, CUBIC)):
        curve = backbone(one_mass(), law, mode=1, sensor="mass", amplitude=amplitude)
        np.testing.assert_allclose(family.frequency_hz[row], curve.frequency_hz, rtol=1e-12)


def test_points_without_a_solution_leave_the_rest_of_the_curve():
    # a softening spring whose force is gone at 1.8 mm
    amplitude = np.linspace(0.2e-3, 3e-3, 15)
    softening = spring("cubic_stiffness", -4e7)
    curve = backbone(one_mass(), softening, mode=1, sensor="mass", amplitude=amplitude)
    exists = 50.0 - 0.75 * 2e7 * amplitude**2 > 0
    np.testing.assert_array_equal(curve.converged, exists)
    assert np.isnan(curve.frequency_hz[~exists]).all()
    assert np.isnan(curve.shapes[~exists]).all()
    assert "10 (0.002 m at 'mass')" in curve.reason
    assert "smaller steps" in curve.reason
    solve = family_evaluator(one_mass(), ("cubic_stiffness",), mode=1, sensor="mass", amplitude=amplitude)
    family = solve([[-4e7], [4e7]])
    np.testing.assert_array_equal(family.converged, [exists, np.ones(15, dtype=bool)])


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"mode": 11}, "there is no mode 11: give a number from 1 to 10"),
        ({"sensor": "tip 9"}, "there is no sensor 'tip 9': did you mean"),
        ({"amplitude": []}, "give a list of positive numbers"),
        ({"amplitude": [1e-3, 0.0]}, "give a list of positive numbers"),
        ({"amplitude": [1e-3, np.nan]}, "give a list of positive numbers"),
        ({"harmonics": (3,)}, "1 among them"),
        ({"harmonics": (1, 1)}, "different whole numbers"),
        ({"harmonics": (1, 2.5)}, "different whole numbers"),
        ({"law": EVEN}, r"not odd.*harmonics such as \(0, 1, 2\)"),
        ({"law": [CUBIC, CUBIC]}, "2 laws for the 4 joints"),
        ({"law": CUBIC.resting_at(1e-3)}, "cubic_stiffness rests 0.001 m from its origin"),
        ({"law": default_law("quadratic_damping")}, "quadratic_damping depends on the rate"),
        ({"law": default_law("arctan_mixed")}, "arctan_mixed depends on the rate"),
    ],
)
def test_bad_input_is_refused(changed, message):
    given = {"law": CUBIC, "mode": 3, "sensor": "tip 1", "amplitude": AMPLITUDE, "harmonics": (1,)} | changed
    with pytest.raises(InputError, match=message):
        backbone(SYSTEM, given.pop("law"), **given)


def test_modes_that_cannot_be_held_are_refused():
    free = two_pylons(suspension=0.0)
    with pytest.raises(InputError, match="mode 1 is a rigid-body motion"):
        backbone(free, CUBIC, mode=1, sensor="tip 1", amplitude=AMPLITUDE)
    still = JointedModes([1.0, 4.0], [[0.0, 1.0], [1.0, 0.0]], [[1.0, 1.0]], ("a", "b"), ("joint",))
    with pytest.raises(InputError, match=r"mode 1 does not move the sensor 'a'.*'b'"):
        backbone(still, CUBIC, mode=1, sensor="a", amplitude=AMPLITUDE)
    grounded = JointedModes([0.0, 4.0], [[1.0, 1.0]], [[1.0, 1.0]], ("a",), ("joint",))
    with pytest.raises(InputError, match="give the joints some linear stiffness"):
        backbone(grounded, Law(EVEN.terms), mode=2, sensor="a", amplitude=AMPLITUDE, harmonics=(0, 1, 2))


def test_families_refuse_what_they_cannot_take():
    given = {"mode": 3, "sensor": "tip 1", "amplitude": AMPLITUDE}
    with pytest.raises(InputError, match="no law 'cubic'"):
        family_evaluator(SYSTEM, ("cubic",), **given)
    solve = family_evaluator(SYSTEM, ("cubic_stiffness",), **given)
    with pytest.raises(InputError, match=r"shape \(1, 2\): give \(n_samples, 1\)"):
        solve([[1.0, 2.0]])
