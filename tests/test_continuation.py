import numpy as np
import pytest
from jointed_systems import CUBIC, EVEN, QUADRATIC, one_mass, spring, two_pylons
from shooting import shoot

from opid.errors import InputError
from opid.mechanics.backbones.continuation import continued_backbone
from opid.mechanics.backbones.family import backbone
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.laws.law import default_law
from opid.updating.structure.reduction import craig_bampton, modes_of
from opid.virtual.backbone_tests.wing_engine import UPDATED, WingEngine, wing_engine_structure

SYSTEM = two_pylons(0.05)
ENDS = {"first_amplitude_m": 0.2e-3, "last_amplitude_m": 4e-3}
# around the interaction of mode 3 alone
TONGUE = {"first_amplitude_m": 1e-3, "last_amplitude_m": 2e-3, "mode": 3, "sensor": "tip 1"}


@pytest.mark.parametrize(
    ("law", "mode", "harmonics"),
    [(CUBIC, 4, (1, 3, 5)), (QUADRATIC, 4, (1, 3)), (CUBIC, 3, (1,)), (EVEN, 3, (0, 1, 2, 3))],
    ids=lambda each: getattr(each, "name", None),
)
def test_away_from_other_modes_it_is_the_backbone_at_prescribed_amplitudes(law, mode, harmonics):
    curve = continued_backbone(SYSTEM, law, mode=mode, sensor="tip 1", harmonics=harmonics, **ENDS)
    assert curve.reason == ""
    assert curve.turning_points.size == 0
    assert curve.amplitude[[0, -1]] == pytest.approx([0.2e-3, 4e-3], rel=1e-12)
    assert (np.diff(curve.amplitude) > 0).all()
    same = backbone(SYSTEM, law, mode=mode, sensor="tip 1", amplitude=curve.amplitude, harmonics=harmonics)
    np.testing.assert_allclose(curve.frequency_hz, same.frequency_hz, rtol=1e-9)
    np.testing.assert_allclose(curve.shapes, same.shapes, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(curve.extension, same.extension, rtol=1e-6, atol=1e-12)


def test_it_passes_a_three_to_one_interaction():
    # three times the frequency of mode 3 meets mode 9
    curve = continued_backbone(SYSTEM, CUBIC, mode=3, sensor="tip 1", harmonics=(1, 3, 5), **ENDS)
    assert curve.reason == ""
    assert abs(curve.amplitude[-1]) == pytest.approx(4e-3, rel=1e-12)
    assert curve.turning_points.size >= 1
    turn = int(curve.turning_points[0])
    amplitude = curve.amplitude[turn - 3 : turn + 4]
    assert amplitude[3] == amplitude.max()
    assert 3 * curve.frequency_hz[turn] == pytest.approx(SYSTEM.frequency_hz[8], rel=1e-2)
    # mode 9 takes over at three times the frequency
    taken = np.abs(curve.modal_motion[:, 1, 8]) / np.abs(curve.modal_motion[:, 0, 2])
    assert taken[turn : turn + 30].max() > 20 * taken[0]
    # at prescribed amplitudes the curve beyond is found again, and the tongue is not
    amplitudes = np.linspace(0.2e-3, 4e-3, 20)
    prescribed = backbone(SYSTEM, CUBIC, mode=3, sensor="tip 1", amplitude=amplitudes, harmonics=(1, 3, 5))
    assert prescribed.frequency_hz[-1] == pytest.approx(curve.frequency_hz[-1], rel=1e-9)


def test_the_tongue_is_a_motion_in_time():
    curve = continued_backbone(SYSTEM, CUBIC, harmonics=(1, 3, 5, 7, 9), most_points=50, **TONGUE)
    turn = int(curve.turning_points[0])
    for point in (turn + 5, turn + 15):
        motion = shoot(SYSTEM, CUBIC, curve, point=point)
        assert curve.frequency_hz[point] == pytest.approx(motion.frequency_hz, rel=1e-8)


def test_unequal_leaves_give_the_wing_an_interaction_that_equal_ones_do_not_have():
    # three times the frequency of mode 7, near 15.2 Hz, meets a mode that unequal leaf springs let the joints move
    given = {"mode": 7, "sensor": "10", "first_amplitude_m": 1.5e-3, "last_amplitude_m": 2.6e-3, "harmonics": (1, 3, 5)}
    cubic = spring("cubic_stiffness", 1.58 * 6.8e7)
    found = []
    for fraction in (0.0, 0.05):
        system = modes_of(craig_bampton(wing_engine_structure(WingEngine(leaf_asymmetry=fraction)), UPDATED))
        found.append(continued_backbone(system, cubic, **given))
    equal, curve = found
    assert equal.turning_points.size == 0
    assert curve.turning_points.size >= 1
    turn = int(curve.turning_points[0])
    assert curve.frequency_hz[turn] == pytest.approx(15.2, abs=0.2)
    assert 3 * curve.frequency_hz[turn] == pytest.approx(system.frequency_hz[10], rel=1.5e-2)
    # modes 10 and 11 lie at one frequency and take over at three times that of mode 7
    taken = np.abs(curve.modal_motion[:, 1, 9:11]).max(axis=1) / np.abs(curve.modal_motion[:, 0, 6])
    assert taken[turn:].max() > 20 * taken[0]


def test_the_turning_point_is_where_the_amplitude_is_largest():
    coarse, fine = (
        continued_backbone(SYSTEM, CUBIC, harmonics=(1, 3), largest_step=step, most_points=50, **TONGUE)
        for step in (0.05, 0.02)
    )
    one, other = (curve.amplitude[curve.turning_points[0]] for curve in (coarse, fine))
    assert one == pytest.approx(other, rel=1e-4)
    assert fine.turning_points[0] > coarse.turning_points[0]


def test_a_softening_spring_with_a_largest_amplitude_of_the_sensor_ends_with_a_reason():
    # without stiffness left there is no motion: the frequency goes to zero at 1.83 mm
    curve = continued_backbone(
        one_mass(), spring("cubic_stiffness", -4e7), mode=1, sensor="mass", harmonics=(1,), **ENDS
    )
    assert curve.amplitude.max() < np.sqrt(50.0 / (0.75 * 2e7))
    assert "the curve ends at" in curve.reason
    np.testing.assert_allclose((2 * np.pi * curve.frequency_hz) ** 2, 50.0 - 0.75 * 2e7 * curve.amplitude**2, atol=1e-8)


def test_too_few_points_leave_the_beginning():
    curve = continued_backbone(SYSTEM, CUBIC, mode=4, sensor="tip 1", harmonics=(1,), most_points=5, **ENDS)
    assert curve.amplitude.size == 5
    assert "point 5: it has 5 points" in curve.reason


def test_free_modes_that_joints_hold_keep_their_mean_position():
    grounded = JointedModes([0.0, 4e3, 9e3], [[0.7, 1.0, 0.2]], [[0.3, 1.0, -0.5]], ("a",), ("joint",))
    law = spring("even_quadratic_stiffness", 2e4) + CUBIC
    curve = continued_backbone(
        grounded, law, mode=2, sensor="a", harmonics=(0, 1, 2), first_amplitude_m=5e-4, last_amplitude_m=1e-3
    )
    assert curve.reason == ""
    assert np.abs(curve.modal_motion[-1, 0, 0]) > 1e-6


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"first_amplitude_m": 5e-3}, "give the smaller one first"),
        ({"first_amplitude_m": 0.0}, "positive numbers"),
        ({"largest_step": 0.0}, "largest_step is 0"),
        ({"mode": 12}, "there is no mode 12"),
        ({"law": default_law("cubic_damping")}, "depends on the rate"),
    ],
)
def test_bad_input_is_refused(changed, message):
    given = {"law": CUBIC, "mode": 4, "sensor": "tip 1"} | ENDS | changed
    with pytest.raises(InputError, match=message):
        continued_backbone(SYSTEM, given.pop("law"), **given)


def test_a_first_amplitude_that_is_too_large_is_refused():
    softening = spring("cubic_stiffness", -4e7)
    with pytest.raises(InputError, match=r"no solution near the linear mode at the first amplitude, 0.003 m at 'mass'"):
        continued_backbone(
            one_mass(), softening, mode=1, sensor="mass", first_amplitude_m=3e-3, last_amplitude_m=4e-3, harmonics=(1,)
        )
