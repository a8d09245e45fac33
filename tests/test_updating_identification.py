from dataclasses import replace
from types import SimpleNamespace

import made_backbones as made
import numpy as np
import pytest

from opid.errors import InputError, NotDeterminedError
from opid.progress import Step
from opid.updating import identification, posterior
from opid.updating.identification import update_study
from opid.updating.likelihood.noise import LINEAR_ERROR_GROWTH, UNMENDED_GROWTH, NoiseSettings
from opid.updating.model_class import ModelClass, Prior
from opid.updating.study import UpdatingStudy

BOUNDS = Prior("uniform", 0.3, 3.0)


def study(**settings):
    given = {
        "title": "two arms",
        "structure": made.system(),
        "backbones": made.backbones(5),
        "classes": (made.CUBIC, made.QUADRATIC),
        "harmonics": (1,),
        "n_samples": 1000,
    }
    return UpdatingStudy(**(given | settings))


@pytest.fixture(scope="module")
def found():
    return update_study(study())


def test_the_best_law_and_its_parameter(found):
    assert found.best_class == "cubic"
    assert found.linear is None
    assert found.not_determined == ""
    best = next(each for each in found.classes if each.model_class.name == found.best_class)
    assert abs(best.estimates["theta_1"].value - made.TRUTH) < 4 * best.estimates["theta_1"].std
    assert [band.mode for band in found.prediction] == [2, 3]
    assert found.settings["sampler"] == "adaptive"
    assert found.settings["seed"] == 0


def test_a_class_more_changes_no_other_and_steps_are_told(found):
    steps = []
    again = update_study(study(classes=(made.CUBIC,)), progress=steps.append)
    assert again.classes[0].samples == pytest.approx(found.classes[0].samples, rel=1e-6)
    counted = [step for step in steps if isinstance(step, Step)]
    assert [step for step in steps if step not in counted] == ["backbones", "cubic", "prediction"]
    assert {step.name for step in counted} == {"cubic"}
    fractions = [step.fraction for step in counted]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1
    assert len(fractions) > 2


def test_both_phases_from_matrices():
    true = made.system(1.0, 1.02)
    given = study(
        structure=made.structure(),
        backbones=made.backbones(6, true=true, linear_error=0.0),
        parameters={"plate": BOUNDS, "leaves": BOUNDS},
        classes=(made.CUBIC,),
        n_internal=0,
    )
    steps = []
    found = update_study(given, progress=steps.append)
    assert [step for step in steps if "%" not in step][:2] == ["linear structure", "reduction"]
    assert found.linear.best == pytest.approx([1.0, 1.02], abs=0.03)
    assert found.system.frequency_hz[1:3] == pytest.approx(true.frequency_hz[1:3], rel=0.006)
    assert found.classes[0].estimates["theta_1"].value == pytest.approx(made.TRUTH, rel=0.05)
    # an error of 0.4 % of all frequencies is one of 0.8 % of the stiffness, whatever the curves say
    assert all(estimate.std > 0.004 for estimate in found.linear.estimates.values())
    growth = found.settings["noise"]["linear_error_growth"]
    assert set(growth) == {"2", "3"}
    assert all(0 < value != LINEAR_ERROR_GROWTH for value in growth.values())


@pytest.mark.parametrize(
    ("settings", "shared"),
    [
        ({}, 0.004),
        ({"noise": NoiseSettings(linear_error=0.01)}, 0.01),
        ({"noise": NoiseSettings(cov={2: 0.01, 3: 0.01})}, 0.004),
        ({"form": "independent"}, 0.004),
        ({"form": "paper"}, 0.0),
        ({"form": "literal"}, 0.0),
    ],
)
def test_the_error_that_all_curves_share_is_part_of_phase_i_but_in_the_papers_forms(monkeypatch, settings, shared):
    def told(*_, common_error=0.0, **others):
        raise NotDeterminedError(f"common error {common_error}")

    monkeypatch.setattr(identification, "update_linear", told)
    given = study(structure=made.structure(), parameters={"plate": BOUNDS}, n_internal=0, **settings)
    with pytest.raises(NotDeterminedError, match=f"common error {shared}"):
        update_study(given)


def settings_of_phase_i(monkeypatch, **changes):
    """What `update_linear` is called with."""
    told = {}

    def note(*_, **others):
        told.update(others)
        raise NotDeterminedError("noted")

    monkeypatch.setattr(identification, "update_linear", note)
    with pytest.raises(NotDeterminedError, match="noted"):
        update_study(study(structure=made.structure(), parameters={"plate": BOUNDS}, n_internal=0, **changes))
    return {name: told.get(name) for name in ("cov", "weight", "shape_std", "shape_factor")}


def test_a_mode_with_one_curve_leaves_the_others_inferred(monkeypatch):
    all_of_two, one = made.MODES[0], made.MODES[1]
    curves = made.backbones(5)
    whole = settings_of_phase_i(monkeypatch, backbones=curves)
    assert whole["cov"] == dict.fromkeys(made.MODES, "inferred")
    first = next(each for each in curves if each.mode == one)
    few = (*(each for each in curves if each.mode == all_of_two), first)
    found = settings_of_phase_i(monkeypatch, backbones=few)
    assert found["cov"] == {all_of_two: "inferred", one: 0.006}
    assert found["shape_std"] == dict.fromkeys(made.MODES, "inferred")
    # two sensors and two factors: one shape may be met exactly, which tells no error of it
    sparse = replace(first, sensors=first.sensors[3:], amplitude=first.amplitude[:, 3:])
    single = settings_of_phase_i(monkeypatch, backbones=(*few[:-1], sparse))
    assert single["shape_std"] == {all_of_two: "inferred", one: pytest.approx(np.hypot(0.02, 0.003))}
    alone = replace(first, sensors=first.sensors[3:4], amplitude=first.amplitude[:, 3:4])
    assert set(settings_of_phase_i(monkeypatch, backbones=(*few[:-1], alone))["shape_std"]) == {all_of_two}


def test_settings_of_the_papers_forms_are_for_both_phases_of_these(monkeypatch):
    noise = NoiseSettings(weight=2.0, cov={2: 0.01, 3: 0.02}, shape_factor=3.0)
    for form in ("paper", "independent"):
        found = settings_of_phase_i(monkeypatch, form=form, noise=noise)
        assert found == {"cov": noise.cov, "weight": 2.0, "shape_std": None, "shape_factor": 3.0}
    assert settings_of_phase_i(monkeypatch, noise=noise) == settings_of_phase_i(monkeypatch)
    told = update_study(study(noise=noise, classes=(made.CUBIC,))).warnings
    assert any("does not use weight, cov, shape_factor: leave these settings out" in each for each in told)


def test_a_growth_of_the_linear_error_that_is_given_is_kept_else_it_follows_from_phase_i(monkeypatch):
    factors = {"plate": 1.0, "leaves": 1.0}
    given = {"structure": made.structure(), "parameters": dict.fromkeys(factors, BOUNDS), "n_internal": 0}
    given["classes"] = (made.CUBIC,)
    growths = []
    for noise, std in (
        # as large as where nothing is known, and yet stated
        (NoiseSettings(linear_error_growth=0.3), 0.01),
        (NoiseSettings(), 0.01),
        (NoiseSettings(), 0.02),
    ):
        linear = SimpleNamespace(factors=factors, covariance=std**2 * np.eye(2), warnings=(), log_evidence=0.0)
        monkeypatch.setattr(identification, "update_linear", lambda *_, linear=linear, **__: linear)
        found = update_study(study(noise=noise, **given))
        growths.append(np.array(list(found.settings["noise"]["linear_error_growth"].values())))
    np.testing.assert_array_equal(growths[0], 0.3)
    first, second = (growth**2 - UNMENDED_GROWTH**2 for growth in growths[1:])
    np.testing.assert_allclose(second, 4 * first)


def test_without_phase_i_the_growth_of_the_linear_error_is_that_of_errors_of_the_parts():
    alone = update_study(study(structure=made.structure(), parameters={}, n_internal=0, classes=(made.CUBIC,)))
    told = alone.settings["noise"]["linear_error_growth"]
    assert len(told) == len(made.MODES)
    assert all(UNMENDED_GROWTH < value != LINEAR_ERROR_GROWTH for value in told.values())
    # A structure that is only known by its modes has no parts.
    modes = update_study(study(structure=made.system(), parameters={}, classes=(made.CUBIC,)))
    assert set(modes.settings["noise"]["linear_error_growth"].values()) == {LINEAR_ERROR_GROWTH}


def test_a_class_without_backbones_is_left_out_with_a_reason(monkeypatch):
    real = posterior.likelihood_function

    def some(data, model_class):
        if model_class.name == "cubic":
            return real(data, model_class)
        return lambda theta: (np.full(len(theta), -np.inf), len(theta))

    monkeypatch.setattr(posterior, "likelihood_function", some)
    found = update_study(study(n_samples=1000))
    assert [each.model_class.name for each in found.classes] == ["cubic"]
    assert any("'quadratic' has no posterior and is left out" in each for each in found.warnings)
    with pytest.raises(NotDeterminedError, match="'quadratic' has no posterior and is left out"):
        update_study(study(classes=(made.QUADRATIC,)))


@pytest.mark.parametrize(
    ("wrong", "match"),
    [
        ({"backbones": ()}, "there is no measured backbone"),
        ({"classes": ()}, "there is no model class"),
        ({"classes": (made.CUBIC, made.CUBIC)}, "2 classes are called 'cubic'"),
        ({"form": "best"}, "form is 'best'"),
        ({"sampler": "gibbs"}, "sampler is 'gibbs'"),
        ({"n_samples": 10}, "n_samples is 10"),
        ({"seed": -1}, "seed is -1"),
        ({"harmonics": (3,)}, r"harmonics are \[3\]"),
        ({"n_internal": -1}, "n_internal is -1"),
        ({"parameters": {"plate": BOUNDS}}, "give its matrices or name no parameter"),
        ({"structure": made.structure(), "parameters": {"steel": BOUNDS}}, "no parameter 'steel'"),
        ({"structure": replace(made.structure(), joints={})}, "has no joint"),
        ({"structure": replace(made.system(), sensors=("a", "b", "c", "d", "e"))}, "sensors plate"),
    ],
)
def test_bad_studies(wrong, match):
    with pytest.raises(InputError, match=match):
        study(**wrong)


def test_everything_wrong_is_said_at_once():
    with pytest.raises(InputError) as caught:
        study(form="best", seed=-1)
    assert "form is" in str(caught.value)
    assert "seed is" in str(caught.value)


def test_curves_with_other_sensors_on_other_days_give_one_answer():
    curves = []
    for number, one in enumerate(made.backbones(5)):
        kept = ("left", "twist", "right") if number % 3 == 0 else one.sensors
        amplitude = one.amplitude[:, [one.sensors.index(name) for name in kept]]
        curves.append(replace(one, sensors=kept, amplitude=amplitude, day=f"day {number % 2}"))
    both = update_study(study(backbones=tuple(curves), n_confused=2))
    assert both.best_class == "cubic"
    assert both.classes[0].estimates["theta_1"].holds(made.TRUTH)
    for band in both.prediction:
        assert 0.8 < band.left_out <= 1.0
        told = {each.sensor: each.left_out for each in band.sensors}
        assert all(0.7 < told[name] <= 1.0 for name in ("plate", "bend", "twist", "right"))
    for shape in both.mode_shapes:
        truth = both.system.at_sensors[[both.system.sensor(name) for name in shape.sensors], shape.mode - 1]
        measured = np.array(shape.measured) / np.linalg.norm(shape.measured)
        assert abs(measured @ truth) / np.linalg.norm(truth) > 0.999
    in_paper = update_study(study(backbones=tuple(curves), form="paper", classes=(made.CUBIC,)))
    assert abs(in_paper.classes[0].estimates["theta_1"].value - made.TRUTH) < 0.1


def test_curves_that_are_left_out_lie_in_the_band_of_the_others():
    found = update_study(study(classes=(made.CUBIC,)))
    for band in found.prediction:
        assert 0.8 < band.left_out <= 1.0
    # a curve of its own, 2 % beside the others, is none of theirs
    first, *others = made.backbones(3)
    odd = replace(first, frequency_hz=1.02 * first.frequency_hz)
    apart = update_study(study(backbones=(odd, *others), classes=(made.CUBIC,)))
    (own,) = (band for band in apart.prediction if band.mode == odd.mode)
    n_curves = sum(each.mode == odd.mode for each in others) + 1
    assert own.left_out < 1.0 - 0.9 / n_curves
    alone = update_study(study(backbones=(others[0],), classes=(made.CUBIC,)))
    assert alone.prediction[0].left_out is None


def test_classes_that_cannot_be_told_apart_are_doubted():
    twin = ModelClass("the same", made.CUBIC.terms)
    found = update_study(study(classes=(made.CUBIC, twin)))
    assert any("cannot distinguish them" in each for each in found.warnings)


def test_a_small_structure_keeps_all_inner_modes_that_it_has():
    given = {"structure": made.structure(), "parameters": dict.fromkeys(("plate", "leaves"), BOUNDS)}
    few = study(**given, n_internal=0, classes=(made.CUBIC,))
    usual = study(**given, n_internal=15, classes=(made.CUBIC,))
    # All five degrees of freedom are sensors.
    assert (few.n_kept, usual.n_kept) == (0, 0)
    np.testing.assert_array_equal(update_study(few).classes[0].best, update_study(usual).classes[0].best)
