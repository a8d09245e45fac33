"""Joints with laws of their own: backbones, classes, study tables, and laws with inner parameters."""

from dataclasses import replace

import made_backbones as made
import numpy as np
import pytest
from made_chain import small_chain
from scipy import linalg

from opid.errors import InputError
from opid.mechanics.backbones.family import backbone, family_evaluator
from opid.mechanics.laws.law import Law, Term
from opid.studies.updating_study import ClassTable, LawTable, tabulate_class
from opid.updating.likelihood.backbones import backbone_data
from opid.updating.likelihood.curves import make_curves
from opid.updating.likelihood.error_growth import with_modal_errors
from opid.updating.likelihood.noise import NoiseSettings
from opid.updating.model_class import ModelClass, Prior, UncertainTerm, group_joints
from opid.updating.posterior import update_class
from opid.updating.study import UpdatingStudy
from opid.virtual.backbone_tests.measured import synthetic_backbones

LEFT = UncertainTerm("cubic_stiffness", (6.8e7,), (Prior(),), ("left",))
RIGHT = UncertainTerm("quadratic_stiffness", (2.16e5,), (Prior(),), ("right",))
APART = ModelClass("apart", (LEFT, RIGHT))
SWAPPED = ModelClass(
    "swapped",
    (
        UncertainTerm("cubic_stiffness", (6.8e7,), (Prior(),), ("right",)),
        UncertainTerm("quadratic_stiffness", (2.16e5,), (Prior(),), ("left",)),
    ),
)
SHARED = ModelClass(
    "shared",
    (
        UncertainTerm("cubic_stiffness", (6.8e7,), (Prior(),)),
        UncertainTerm("quadratic_stiffness", (2.16e5,), (Prior(),)),
    ),
)
TRUTH = (1.58, 0.9)


def test_backbones_of_joints_with_their_own_laws_are_those_of_one_law_for_each():
    system, amplitude = made.system(), np.linspace(2e-4, 2e-3, 7)
    joints = (("left",), ("right",), ())
    kinds = ("cubic_stiffness", "quadratic_stiffness", "quintic_stiffness")
    of_joints = ((6.8e7, 0.0), (0.0, 2e5), (1e12, 1e12))
    solve = family_evaluator(system, kinds, mode=2, sensor="left", amplitude=amplitude, harmonics=(1, 3), joints=joints)
    found = solve([[6.8e7, 2e5, 1e12], [3e7, 1e5, 0.0]])
    laws = [
        Law(tuple(Term(kind, (values[j],)) for kind, values in zip(kinds, of_joints, strict=True) if values[j]))
        for j in range(2)
    ]
    each = backbone(system, laws, mode=2, sensor="left", amplitude=amplitude, harmonics=(1, 3))
    np.testing.assert_allclose(found.frequency_hz[0], each.frequency_hz, rtol=1e-12)
    assert np.abs(found.frequency_hz[1] / found.frequency_hz[0] - 1).max() > 1e-3
    with pytest.raises(InputError, match="there is no joint 'middle'"):
        family_evaluator(system, kinds[:1], mode=2, sensor="left", amplitude=amplitude, joints=(("middle",),))


@pytest.mark.parametrize("harmonics", [(1,), (1, 3)])
@pytest.mark.parametrize(
    ("kinds", "joints", "values"),
    [
        (("cubic_stiffness",), ((),), (6.8e7,)),
        (("signed_power_stiffness",), ((),), (1e6, 2.5)),
        (
            ("cubic_stiffness", "quadratic_stiffness", "arctan_displacement"),
            (("left",), ("right",), ()),
            (6.8e7, 2e5, 0.3, 8e-4),
        ),
        (("cubic_stiffness", *("late_cubic_stiffness",) * 2), ((),) * 3, (6.8e8, -4e8, 3e-4, -2e8, 7e-4)),
    ],
)
def test_slopes_of_backbones_are_those_of_differences(kinds, joints, values, harmonics):
    """By each coefficient, and by factors of two parts of the stiffness."""
    own: dict = {"mode": 2, "sensor": "left", "amplitude": np.linspace(2e-4, 2e-3, 6)}
    own |= {"harmonics": harmonics, "joints": joints}
    _, *parts = made.parts()
    stiffness = sum(made.parts())
    _, shapes = linalg.eigh(stiffness, made.MASS)
    evaluate, given = family_evaluator(made.system(), kinds, **own), np.array([values])
    found = evaluate(given)
    by_eigenvalue, by_shapes = evaluate.find_slopes(given, found, [shapes.T @ part @ shapes for part in parts])
    for number, change in enumerate(np.eye(len(values) + len(parts))):
        law, factors = change[: len(values)], 1e-6 * change[len(values) :]
        step = 1e-6 * values[number] if number < len(values) else 1e-6
        up, down = (
            family_evaluator(made.system(*(1 + side * factors)), kinds, **own)(given + side * step * law)
            for side in (1, -1)
        )
        for slope, above, below in (
            (by_eigenvalue, up.eigenvalue, down.eigenvalue),
            (by_shapes, up.shapes, down.shapes),
        ):
            numeric = (above - below) / (2 * step)
            assert np.abs(slope[..., number] - numeric).max() < 1e-6 * np.abs(numeric).max()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_which_joint_has_which_law_is_found(seed):
    curves = synthetic_backbones(
        made.system(), APART, TRUTH, rng=np.random.default_rng(seed), modes=made.MODES, n_curves=(3, 3),
        amplitude_m=made.AMPLITUDE_M, controlled_sensor="left",
    )  # fmt: skip
    data = backbone_data(made.system(), curves)
    apart, *others = (
        update_class(data, each, rng=np.random.default_rng(seed), n_samples=2000) for each in (APART, SWAPPED, SHARED)
    )
    for estimate, true in zip(apart.estimates.values(), TRUTH, strict=True):
        assert abs(estimate.value - true) < 3 * estimate.std
    assert apart.log_evidence > max(each.log_evidence for each in others) + 2


def test_errors_of_the_modal_frequencies_bend_the_curves_of_unlike_joints():
    """Their patterns are the differences of backbones; a law that all joints share has next to none."""
    curves = synthetic_backbones(
        made.system(), APART, TRUTH, rng=np.random.default_rng(5), modes=made.MODES, n_curves=(3, 3),
        amplitude_m=made.AMPLITUDE_M, controlled_sensor="left",
    )  # fmt: skip
    data = backbone_data(made.system(), curves)
    apart = with_modal_errors(data, APART, np.array(TRUTH))
    (mode, _), (widened, _) = data.modes, apart.modes
    assert mode.errors.patterns is None
    patterns = widened.errors.patterns
    # the errors by differences, without a constant and what grows with h, are sums of the patterns
    step, found = 1e-4, []
    for number in made.MODES:
        eigenvalue = np.array(data.system.eigenvalue)
        eigenvalue[number - 1] *= 1 + step
        moved = replace(data, system=replace(data.system, eigenvalue=eigenvalue))
        values = [make_curves(each, mode, APART)(np.array([TRUTH]))[0][0] for each in (data, moved)]
        found.append(mode.between @ (values[1] - values[0]) / step / mode.linear)
    usual = np.column_stack([np.ones_like(mode.growth), mode.growth])
    basis = np.linalg.qr(np.column_stack([usual, patterns]))[0]
    errors = np.array(found).T
    assert np.abs(errors - basis @ (basis.T @ errors)).max() < 0.1 * np.abs(patterns).max()
    shared = with_modal_errors(data, made.CUBIC, np.array([1.58]))
    assert all(each.errors.patterns is None for each in shared.modes)
    stated = backbone_data(made.system(), curves, noise=NoiseSettings(linear_error_growth=0.3))
    assert with_modal_errors(stated, APART, np.array(TRUTH)) is stated


def test_an_inner_parameter_is_found_where_the_data_show_it():
    """A spring that softens beyond a travel: its force and that travel are both unknown."""
    softening = UncertainTerm("arctan_displacement", (0.4, 1e-3), (Prior(), Prior("lognormal", 1.0, 1.0)))
    law = ModelClass("softening", (softening,))
    curves = synthetic_backbones(
        made.system(), law, (0.6, 0.8), rng=np.random.default_rng(4), modes=made.MODES, n_curves=(3, 3),
        amplitude_m=made.AMPLITUDE_M, controlled_sensor="left", linear_error=0.0,
    )  # fmt: skip
    data = backbone_data(made.system(), curves)
    found = update_class(data, law, rng=np.random.default_rng(0), n_samples=4000)
    assert [each.key for each in found.coefficients] == ["arctan_displacement", "arctan_displacement.scale_m"]
    assert found.labels == ["θ1 (arctan displacement)", "θ2 (arctan displacement, scale)"]
    for estimate, true in zip(found.coefficients.values(), (0.24, 8e-4), strict=True):
        assert abs(estimate.value - true) < 3 * estimate.std
    known = ModelClass("known", (UncertainTerm("arctan_displacement", (40.0, 8e-4), (Prior(), None)),))
    assert known.coefficients([[0.6]]).tolist() == [[24.0, 8e-4]]
    assert known.n_parameters == 1


def test_tables_of_laws_are_read_as_they_are_written():
    table = ClassTable(
        name="pylons",
        laws=(
            LawTable(law="cubic", scale="0.068 N/mm^3", joints=("left",)),
            LawTable(law="arctan displacement", scale=(40, "2 mm"), prior=(("uniform", 0, 3), "known"), joints=("r",)),
        ),
    )
    own = table.model
    assert own.law_in_words == "cubic at left + arctan displacement at r"
    assert [each.words for each in own.parameters] == ["cubic at left", "arctan displacement at r"]
    np.testing.assert_allclose(own.coefficients([2.0, 0.5]), [1.36e8, 20.0, 2e-3])
    assert own.terms[1].priors == (Prior("uniform", 0, 3), None)
    assert tabulate_class(own).model == own
    assert ClassTable(law="cubic", scale="6.8e7").model.terms[0].scales == (6.8e7,)
    assert own.law("left", [1, 1]).name == "cubic_stiffness"
    assert own.law("elsewhere", [1, 1]).terms == ()
    assert group_joints([own], ["left", "x", "r", "y"]) == [("left",), ("x", "y"), ("r",)]


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"name": "a"}, "class 'a' has no law: give law and scale"),
        ({"law": "cubic"}, "class 'cubic' lacks 'scale': give both"),
        ({"law": "cubic", "scale": 1, "laws": (LawTable(law="cubic", scale=1),)}, "has law and laws"),
        ({"law": "signed power", "scale": (1, -2), "prior": ("uniform", 0, 1)}, "give a positive one"),
        ({"law": "signed power", "scale": (1, 2), "prior": ("normal", 0, 1)}, "its prior allows values below 0"),
        ({"law": "signed power", "scale": (1, 2), "prior": ("known", "known")}, "has no unknown parameter"),
        ({"law": "arctan displacement", "scale": (1, "2 N")}, "its unit is m"),
        ({"laws": (LawTable(law="cubic", scale=1, joints=("a", "a")),)}, "name each once"),
        (
            {
                "laws": (
                    LawTable(law="cubic", scale=1, joints=("a", "b")),
                    LawTable(law="cubic", scale=1, joints=("b",)),
                )
            },
            "names 'cubic_stiffness' twice at a joint",
        ),
        ({"laws": (LawTable(law="iwan", scale=1),)}, "there is no law 'iwan'"),
    ],
)
def test_laws_that_cannot_be_are_refused(table, words):
    with pytest.raises(InputError) as caught:
        ClassTable(**table)
    assert words in str(caught.value)


def test_a_law_at_no_joint_is_refused():
    from made_chain import curve_of

    with pytest.raises(InputError, match="class 'apart' has a law at 'left', which is no joint"):
        UpdatingStudy("x", small_chain(), (curve_of(),), (APART,))
