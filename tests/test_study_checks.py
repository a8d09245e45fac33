"""What is wrong with matrices and backbones of a study, told when it is read."""

import re
from dataclasses import replace

import made_backbones as made
import numpy as np
import pytest
from made_chain import DOFS, curve_of, small_chain
from scipy import linalg

from opid.errors import InputError
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.updating.checks import backbone_faults, day_faults, nominal_modes, warn_of_overlaps
from opid.updating.likelihood.noise import NoiseSettings
from opid.updating.model_class import ModelClass, Prior, UncertainTerm
from opid.updating.structure.affine import structure_faults
from opid.updating.study import UpdatingStudy
from opid.virtual.backbone_tests.wing_engine import wing_engine_structure


def test_sound_backbones_have_no_faults():
    assert list(backbone_faults(small_chain(), [curve_of(), curve_of(2, name="second")])) == []
    # an initial structure may be stiffer by far, as in the paper
    assert list(backbone_faults(small_chain(2.4 * 4e4), [curve_of()])) == []


def test_frequencies_far_from_any_mode_are_told_with_the_nearest():
    # radians a second
    (fault,) = backbone_faults(small_chain(), [curve_of(4, factor=2 * np.pi)])
    assert "begins at 265.8 Hz" in fault
    assert "nearest is mode 4 at 42.3" in fault
    assert "check the unit" in fault


def test_a_mode_with_another_number_is_told_by_its_shape():
    (fault,) = backbone_faults(small_chain(), [replace(curve_of(4), mode=1)])
    assert "shape and frequency are those of mode 4 at 42.3" in fault
    (fault,) = backbone_faults(small_chain(), [replace(curve_of(), mode=9)])
    assert "of mode 9 begins at 7.818 Hz, and the structure has 4 modes" in fault


def test_the_shape_of_another_mode_is_told_where_the_frequencies_are_near():
    (fault,) = backbone_faults(small_chain(), [replace(curve_of(2), mode=3)])
    assert "the shape is that of mode 2 of the structure at 22.5" in fault
    assert "not that of mode 3 at 34.4" in fault
    # two sensors are too few to tell
    curve = curve_of(2)
    few = replace(curve, mode=3, sensors=DOFS[2:], amplitude=curve.amplitude[:, 2:])
    assert list(backbone_faults(small_chain(), [few])) == []


def test_what_is_wrong_with_many_curves_is_told_once():
    curves = [curve_of(4, name=f"sensor {k}", factor=2 * np.pi * (1 + 1e-3 * k)) for k in range(14)]
    curves += [curve_of(3, name=f"other {k}", factor=2 * np.pi) for k in range(2)]
    first, second = backbone_faults(small_chain(), curves)
    assert "14 backbones of mode 4 ('sensor 0' and 13 others) begin at 265.8 to 269.3 Hz, far from any mode" in first
    assert "they may be in rad/s; check the unit" in first
    assert "2 backbones of mode 3 ('other 0' and 'other 1') begin at 216.7 Hz" in second


def test_frequencies_that_overlap_are_doubted():
    low, high = curve_of(1), curve_of(2, name="b")
    assert warn_of_overlaps([low, high]) == []
    assert warn_of_overlaps([]) == []
    growing = replace(low, frequency_hz=np.linspace(7.8, 23.0, 6))
    (doubt,) = warn_of_overlaps([growing, high])
    assert "mode 1 reach up to 23 Hz and those of mode 2 down to 22.5" in doubt
    # it is no fault: modes may do so at different amplitudes
    assert list(backbone_faults(small_chain(), [growing, high])) == []


def test_modes_that_cross_and_curves_that_stand_apart_are_told():
    crossing = [curve_of(1, factor=2.9), curve_of(2, name="second", factor=0.8)]
    (fault,) = backbone_faults(small_chain(), crossing)
    assert "they cross" in fault
    apart = [curve_of(), curve_of(name="b"), curve_of(name="c", factor=1.2)]
    (fault,) = backbone_faults(small_chain(), apart)
    assert "'c' begins at" in fault
    assert "belongs to another mode" in fault


def test_matrices_that_are_not_positive_are_told():
    chain = small_chain()
    assert list(structure_faults(chain)) == []
    free = np.diag([1.0, 2, 2, 1]) - np.eye(4, k=1) - np.eye(4, k=-1)
    assert list(structure_faults(replace(chain, stiffness=1e6 * free, parts={}))) == []  # it may float
    wrong = replace(chain, stiffness=-1.2 * chain.stiffness)
    assert "the stiffness matrix is not positive" in next(iter(structure_faults(wrong)))
    mass = 2 * np.eye(4) + 3 * np.eye(4, k=1) + 3 * np.eye(4, k=-1)
    assert "the mass matrix is not positive" in next(iter(structure_faults(replace(chain, mass=mass))))


@pytest.mark.parametrize(("place", "fraction"), [(100, 0.9), (1000, 0.9), (500, -1.0)])
def test_a_stiffness_that_is_hardly_not_positive_is_told_with_its_least_eigenvalue(place, fraction):
    wing = wing_engine_structure()
    stiffness = wing.stiffness_at({}).tolil()
    stiffness[place, place] *= fraction
    (fault,) = structure_faults(replace(wing, stiffness=stiffness.tocsr(), parts={}))
    least = float(re.search(r"eigenvalue (\S+) N/m", fault)[1])
    # of the whole matrix, not by factors of shifted ones
    exact = linalg.eigh(stiffness.toarray(), eigvals_only=True, subset_by_index=(0, 0))[0]
    assert least == pytest.approx(exact, rel=0.01)


def test_a_mode_that_extends_no_joint_is_told():
    modes = nominal_modes(small_chain(), 4)
    still = replace(modes, at_joints=modes.at_joints * np.array([1.0, 1e-5, 1.0, 1.0]))
    given = {"title": "x", "structure": still, "classes": (made.CUBIC,), "harmonics": (1,)}
    match = "mode 2 extends no joint .* so that the law .* does not change it: take another mode, such as 1, 3, 4"
    with pytest.raises(InputError, match=match):
        UpdatingStudy(backbones=(curve_of(2),), **given)
    UpdatingStudy(backbones=(curve_of(1),), **given)


def test_a_symmetric_structure_has_modes_without_its_joint():
    # two equal masses on equal springs, the joint between them: the first mode moves both alike
    one = JointedModes([1e4, 3e4], [[1.0, 1.0], [1.0, -1.0]], [[0.0, 2.0]], ("left", "right"), ("link",))
    level = np.array([1e-4, 2e-4, 3e-4])[:, None] * [1.0, 1.0]
    curve = replace(curve_of(), mode=1, sensors=("left", "right"), controlled_sensor="left", amplitude=level,
                    frequency_hz=np.array([15.9, 15.91, 15.92]))  # fmt: skip
    with pytest.raises(InputError, match="mode 1 extends no joint"):
        UpdatingStudy("x", one, (curve,), (made.CUBIC,))
    unseen = replace(one, at_sensors=[[1.0, 0.0], [1.0, -1.0]])
    with pytest.raises(InputError, match="mode 2 does not move the sensor 'left': prescribe the amplitude of 'right'"):
        UpdatingStudy("x", unseen, (replace(curve, mode=2),), (made.CUBIC,))
    with pytest.raises(InputError, match="backbone 'first' is of mode 5, and the structure has 2"):
        UpdatingStudy("x", one, (replace(curve, mode=5),), (made.CUBIC,))


def test_curves_of_a_mode_may_have_other_sensors_and_have_all_a_day_or_none():
    whole = curve_of()
    fewer = replace(whole, name="b", sensors=DOFS[1:], amplitude=whole.amplitude[:, 1:])
    UpdatingStudy("x", small_chain(), (whole, fewer), (made.CUBIC,))
    (fault,) = day_faults([replace(whole, day="1 May"), fewer, curve_of(2, name="c")])
    assert fault.startswith("backbone 'b' of mode 1 has no day, and others of this mode have one")
    with pytest.raises(InputError, match="name the day of each, or of none"):
        UpdatingStudy("x", small_chain(), (replace(whole, day="1 May"), fewer), (made.CUBIC,))


EVEN = ModelClass("uneven", (UncertainTerm("even_quadratic_stiffness", (1e5,), (Prior(),)),))
OF_MODE_2 = NoiseSettings(cov={2: 0.01})
TWICE = (curve_of(), curve_of(name="b"))
APART = (curve_of(), curve_of(name="b", factor=1.001))
# alike at first, and apart from then on
GROWING = (curve_of(), replace(TWICE[1], frequency_hz=TWICE[1].frequency_hz * np.linspace(1, 1.01, 6)))


@pytest.mark.parametrize(
    ("wrong", "match"),
    [
        ({"noise": OF_MODE_2}, r"cov names mode 2, which has no backbone, name some of \[1\]"),
        ({"classes": (EVEN,)}, "class 'uneven': even_quadratic_stiffness is not odd, .* give harmonics such as"),
        ({"form": "paper"}, "the curves of mode 1 do not show how lambda varies .*: give cov of mode 1"),
        ({"form": "paper", "backbones": TWICE}, "the curves of mode 1 do not show how lambda varies"),
        (
            {"form": "paper", "backbones": GROWING, "parameters": {"E": Prior()}},
            "the curves of mode 1 begin at one frequency .* give cov of mode 1",
        ),
        ({"parameters": {"E": Prior("uniform", -2.0, -1.0)}}, "the prior of 'E' allows nothing above 0"),
        ({"parameters": {"E": Prior("normal", -6.0, 1.0)}}, "the prior of 'E' allows nothing above 0"),
        ({"parameters": {"F": Prior()}}, "no parameter 'F': give some of E"),
    ],
)  # fmt: skip
def test_what_update_study_would_refuse_is_told_when_the_study_is_made(wrong, match):
    given = {"title": "x", "structure": small_chain(), "backbones": (curve_of(),), "classes": (made.CUBIC,)}
    with pytest.raises(InputError, match=match):
        UpdatingStudy(**(given | wrong))


def test_what_can_be_used_is_accepted():
    given = {"title": "x", "structure": small_chain(), "backbones": (curve_of(),), "classes": (made.CUBIC,)}
    UpdatingStudy(**given, parameters={"E": Prior("normal", 1.0, 0.5)})
    UpdatingStudy(**(given | {"classes": (EVEN,), "harmonics": (0, 1, 2, 3)}))
    UpdatingStudy(**given, form="paper", noise=NoiseSettings(cov={1: 0.01}), parameters={"E": Prior("uniform", 0.1, 2)})
    UpdatingStudy(**(given | {"backbones": APART}), form="paper", parameters={"E": Prior("lognormal", 1.0, 0.5)})
