"""From an updating study to posteriors, the best law and what it predicts (Song et al. 2021), in two phases."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError, refuse
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.progress import Say, Step
from opid.signals.recording import FloatArray
from opid.updating.checks import warn_of_copies, warn_of_overlaps
from opid.updating.confusion import find_confusion
from opid.updating.forced_response import predict_damping, predict_responses
from opid.updating.harmonics import predict_harmonics, warn_of_harmonics
from opid.updating.likelihood.backbones import BackboneData, backbone_data
from opid.updating.likelihood.contradictions import Contradiction, find_contradictions
from opid.updating.likelihood.error_growth import growth_of_linear_error
from opid.updating.likelihood.force import force_data
from opid.updating.likelihood.interactions import adapt_to_class
from opid.updating.likelihood.linear import LinearErrors, OneCov, OneShapeStd
from opid.updating.likelihood.noise import UNMENDED_GROWTH
from opid.updating.linear_updating import update_linear
from opid.updating.measured import by_mode
from opid.updating.model_class import DampingRatio, ModelClass, Prior, StiffnessFactor
from opid.updating.posterior import update_class
from opid.updating.prediction import predict
from opid.updating.result import BackboneBand, ClassPosterior, ForcedResponse, HarmonicBand, LinearPosterior, Updating
from opid.updating.sampling.samplers import require_nutpie
from opid.updating.settings import UPDATING
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.factored_modes import factored_modes
from opid.updating.structure.reduction import reduce
from opid.updating.study import UpdatingStudy
from opid.updating.unmeasured_modes import predict_unmeasured, unseen_faults
from opid.updating.warnings import find_unfit_modes, warn_of_choice, warn_of_classes, warn_of_linear_choice

logger = logging.getLogger(__name__)

_SPOILED = (
    "the measurements contradict each other or the structure, as told above: neither intervals of theta nor bands are "
    "given; correct what is wrong, or state its error"
)


def update_study(study: UpdatingStudy, *, progress: Say | None = None) -> Updating:
    """Update the linear structure, then each class of laws; choose one and predict with it.

    Phase I fits the linear parameters to the lowest points of the backbones. The structure with the best ones is
    reduced to sensors, joints and some internal modes, and phase II updates the coefficients of every class with it.
    The class with the largest evidence predicts. Each part has a random stream of its own, so that another class in the
    study does not change the results of the others.

    Args:
        study: structure, backbones, classes and settings.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: a structure, backbones or settings that cannot be used, or a sampler that is not installed.
        NotDeterminedError: the lowest points do not determine the linear parameters, or no class has a likelihood.
    """
    if not isinstance(study, UpdatingStudy):
        raise InputError(f"study is of type {type(study).__name__}: give an UpdatingStudy, as read_study makes one")
    if study.sampler == "nuts":
        require_nutpie()
    say = progress or (lambda step: None)
    linear_classes = _update_linear(study, say)
    linear = max(linear_classes, key=lambda each: each.log_evidence) if linear_classes else None
    system = _reduce(study, linear, say)
    refuse(list(unseen_faults(study.prediction, system)), study.source)
    say("backbones")
    growth = _find_growth(study, linear)
    data = _prepare(study, system, growth)
    given = tuple(replace(each, ratios=_list_ratios(study)) for each in study.classes)
    if study.is_joint and linear is not None:
        data, given = _free_factors(study, linear, data, given)
    classes, lost = _update_classes(study, given, data, say)
    best = max(classes, key=lambda each: each.log_evidence)
    say("prediction")
    bands, gone = _predict(study, data, best, linear)
    adapted, unfit = adapt_to_class(data, best.model_class, best.best), set[int]()
    contradictions: list[Contradiction] = []
    if not best.has_no_effect:
        unfit = find_unfit_modes(adapted, best.model_class, best.best)
        contradictions += find_contradictions(adapted, best.model_class, best.best, study.backbones, unfit=unfit)
    responses, told = _predict_responses(study, data, best, linear, adapted, unfit)
    own = np.random.default_rng([study.seed, 6])
    damping = () if data.force is None else tuple(predict_damping(data, best, study.backbones, rng=own))
    harmonics = _predict_harmonics(study, data, best, linear)
    is_spoiled = any(each.spoils_theta for each in contradictions)
    if is_spoiled:
        classes = [each.without_intervals() for each in classes]
    if is_spoiled or best.is_pulled:
        bands = tuple(each.without_ends() for each in bands)
        responses = tuple(each.without_intervals() for each in responses)
        damping = tuple(each.without_ends() for each in damping)
        harmonics = tuple(each.without_ends() for each in harmonics)
    confusion = None
    if study.n_confused:
        say("confusion of classes")
        confusion = find_confusion(
            data,
            [each for each in classes if not each.has_no_effect],
            n_sets=study.n_confused,
            rng=np.random.default_rng([study.seed, 4]),
            progress=lambda fraction: say(Step("confusion of classes", fraction)),
        )
    stated = study.noise.stated_for_papers if study.form == "recommended" else ()
    unused = f"the recommended form does not use {', '.join(stated)}: leave these settings out, or take another form"
    return Updating(
        title=study.title,
        form=study.form,
        linear=linear,
        system=system,
        measured=study.backbones,
        classes=tuple(classes),
        best_class=best.model_class.name,
        prediction=bands,
        warnings=(
            *([unused] if stated else []),
            *warn_of_copies(study.backbones),
            *warn_of_overlaps(study.backbones),
            *(f"linear structure: {warning}" for warning in (linear.warnings if linear else ())),
            *warn_of_linear_choice(linear_classes),
            *lost,
            *warn_of_classes(classes),
            *warn_of_choice(classes, bands),
            *(each.sentence for each in contradictions),
            *([_SPOILED] if is_spoiled else []),
            *warn_of_harmonics(harmonics, data),
            *gone,
            *told,
        ),
        not_determined="",
        settings=_list_settings(study, data, growth),
        confusion=confusion,
        linear_classes=tuple(linear_classes) if len(linear_classes) > 1 else (),
        places=study.places,
        damping=damping,
        responses=responses,
        harmonics=harmonics,
    )


def _list_ratios(study: UpdatingStudy) -> tuple[DampingRatio, ...]:
    """Return the damping ratios that are not known, in the order of their modes."""
    unknown = {mode: prior for mode, prior in study.damping.items() if isinstance(prior, Prior)}
    return tuple(DampingRatio(mode, prior) for mode, prior in sorted(unknown.items()))


def _update_linear(study: UpdatingStudy, say: Say) -> list[LinearPosterior]:
    """Return the result of phase I for each class of linear parameters; none where there is nothing to update."""
    if isinstance(study.structure, JointedModes) or not study.parameters:
        return []
    found = []
    for number, (name, factors) in enumerate((study.linear_classes or {"": tuple(study.parameters)}).items()):
        step = f"linear structure {name}".strip()
        say(step)
        found.append(
            update_linear(
                study.structure,
                study.backbones,
                priors={each: study.parameters[each] for each in factors},
                rng=np.random.default_rng([study.seed, 1, *([number] if number else [])]),
                name=name,
                progress=lambda fraction, step=step: say(Step(step, fraction)),  # type: ignore[misc]
                **_choose_linear_errors(study),
            )
        )
    return found


def _reduce(study: UpdatingStudy, linear: LinearPosterior | None, say: Say) -> JointedModes:
    """Return the structure by its modes, with the best linear parameters."""
    if isinstance(study.structure, JointedModes):
        return study.structure
    say("reduction")
    return reduce(study.structure, linear.factors if linear else {}, n_modes=study.n_kept)


def _choose_linear_errors(study: UpdatingStudy) -> LinearErrors:
    """Return the errors of frequencies and shapes in phase I: the scatter of the curves, and a common error.

    The recommended form infers the scatter. All curves of a mode share the common error, which the forms of the paper
    do not have.
    """
    noise = study.noise
    common = 0.0 if study.form in ("paper", "literal") else noise.linear_error
    if study.form != "recommended":
        factor = noise.shape_factor
        return {"cov": noise.cov or "scatter", "weight": noise.weight, "shape_factor": factor, "common_error": common}
    cov: dict[int, OneCov] = {}
    shape_std: dict[int, OneShapeStd] = {}
    for mode, curves in by_mode(study.backbones).items():
        scatters = len({float(one.frequency_hz[0]) for one in curves}) > 1
        # One curve has no scatter, and curves with equal beginnings have none: the expected offset replaces it.
        cov[mode] = "inferred" if scatters else 2 * noise.curve_offset
        n_free = sum(len(one.sensors) - 1 for one in curves)
        if not n_free:
            continue  # one sensor has no shape
        # The error of a shape cannot be inferred if the factors can fit the shape exactly.
        freedom = n_free - len(study.parameters)
        expected = float(np.hypot(noise.shape_offset, noise.linear_shape_error))
        shape_std[mode] = "inferred" if len(curves) > 1 or freedom > 0 else expected
    return {"cov": cov, "shape_std": shape_std, "common_error": common}


def _find_growth(study: UpdatingStudy, linear: LinearPosterior | None) -> dict[int, float]:
    """Return the growth of the linear error along the backbones of each mode: as stated, or by errors of the parts.

    After phase I these are the errors that it leaves.
    """
    noise = study.noise
    growth = dict.fromkeys(by_mode(study.backbones), noise.growth_of_linear_error)
    stated = noise.linear_error_growth is not None
    if study.is_joint and not stated:
        return dict.fromkeys(growth, UNMENDED_GROWTH)  # The errors of the factors are parameters of the classes.
    if stated or study.form != "recommended" or isinstance(study.structure, JointedModes) or not study.structure.parts:
        return growth
    left = growth_of_linear_error(
        study.structure,
        linear.factors if linear else dict.fromkeys(study.structure.parts, 1.0),
        study.backbones,
        covariance=linear.covariance if linear else None,
        linear_error=noise.linear_error,
        n_modes=study.n_kept,
    )
    return growth | {mode: float(np.hypot(value, UNMENDED_GROWTH)) for mode, value in left.items()}


def _prepare(study: UpdatingStudy, system: JointedModes, growth: Mapping[int, float]) -> BackboneData:
    data = backbone_data(
        system,
        study.backbones,
        form=study.form,
        harmonics=study.harmonics,
        noise=study.noise,
        growth=growth,
        slips=any(each.slips for each in study.classes),
    )
    known = {mode: ratio for mode, ratio in study.damping.items() if not isinstance(ratio, Prior)}
    force = force_data(data.modes, study.backbones, study.noise, known) if study.damping else None
    return replace(data, force=force, met_damping=study.met_damping)


def _update_classes(
    study: UpdatingStudy, given: Sequence[ModelClass], data: BackboneData, say: Say
) -> tuple[list[ClassPosterior], list[str]]:
    classes, lost = [], []
    for number, model_class in enumerate(given):
        name = model_class.name
        say(name)
        try:
            found = update_class(
                data,
                model_class,
                rng=np.random.default_rng([study.seed, 2, number]),
                sampler=study.sampler,
                n_samples=study.n_samples,
                progress=lambda fraction, name=name: say(Step(name, fraction)),  # type: ignore[misc]
            )
            n_evaluations = found.diagnostics.n_evaluations
            logger.info("class %s: log evidence %.2f, %d evaluations", name, found.log_evidence, n_evaluations)
            classes.append(found)
        except NotDeterminedError as error:
            lost.append(f"class {name!r} has no posterior and is left out: {error}")
    if not classes:
        raise NotDeterminedError("; ".join(lost))
    return classes, lost


def _free_factors(
    study: UpdatingStudy, linear: LinearPosterior, data: BackboneData, given: Sequence[ModelClass]
) -> tuple[BackboneData, tuple[ModelClass, ...]]:
    """Return the backbones with the structure as a function of its factors, and classes with these as parameters."""
    assert isinstance(study.structure, AffineStructure)  # Otherwise it has no factors.
    factors = tuple(StiffnessFactor(name, study.parameters[name]) for name in linear.names)
    structure = factored_modes(study.structure, linear.factors, linear.covariance, n_modes=study.n_kept)
    return replace(data, structure=structure), tuple(replace(each, factors=factors) for each in given)


def _predict(
    study: UpdatingStudy, data: BackboneData, best: ClassPosterior, linear: LinearPosterior | None
) -> tuple[tuple[BackboneBand, ...], list[str]]:
    """Return the bands of measured modes, then those of other modes that the study asks for, with their sentences."""
    bands: tuple[BackboneBand, ...] = ()
    warnings: list[str] = []
    try:
        bands = predict(data, best, study.backbones, rng=np.random.default_rng([study.seed, 3]))
    except NotDeterminedError as error:
        warnings.append(f"there is no prediction: {error}")
    if study.prediction.modes:
        rng = np.random.default_rng([study.seed, 5])
        theta = best.draw(UPDATING.n_predicted, rng)
        drawn = _draw_with_factors(study, data, best.model_class, theta, linear, rng)
        others, extrapolated = predict_unmeasured(*drawn, study.prediction, study.backbones, rng=rng)
        bands, warnings = (*bands, *others), [*warnings, *extrapolated]
    return bands, warnings


def _predict_harmonics(
    study: UpdatingStudy, data: BackboneData, best: ClassPosterior, linear: LinearPosterior | None
) -> tuple[HarmonicBand, ...]:
    """Return the bands of the higher harmonics that were measured."""
    if best.has_no_effect or not any(one.harmonics for one in study.backbones):
        return ()
    rng = np.random.default_rng([study.seed, 8])
    # The harmonics are compared at measured amplitudes.
    theta = best.chain.draw(UPDATING.n_predicted, rng)
    drawn = _draw_with_factors(study, data, best.model_class, theta, linear, rng)
    return predict_harmonics(*drawn, study.backbones, rng=rng)


def _draw_with_factors(
    study: UpdatingStudy,
    data: BackboneData,
    model_class: ModelClass,
    theta: FloatArray,
    linear: LinearPosterior | None,
    rng: np.random.Generator,
) -> tuple[BackboneData, ModelClass, FloatArray]:
    """Return data, class and draws of its parameters, (n, n_parameters), with the factors of the structure beside them.

    No curve corrects the error of the factors in a mode without curves.
    """
    if linear is None or study.is_joint:
        return data, model_class, theta
    data, (model_class,) = _free_factors(study, linear, data, [model_class])
    return data, model_class, np.hstack([theta, linear.chain.draw(len(theta), rng)])


def _predict_responses(
    study: UpdatingStudy,
    data: BackboneData,
    best: ClassPosterior,
    linear: LinearPosterior | None,
    adapted: BackboneData,
    unfit: set[int],
) -> tuple[tuple[ForcedResponse, ...], list[str]]:
    """Return the responses to a force that the study asks for, those of measured modes first, with their sentences."""
    wanted, known, n = study.prediction.responses, by_mode(study.backbones), UPDATING.n_responses
    asked = [one for one in wanted if one.mode in known], [one for one in wanted if one.mode not in known]
    found: tuple[ForcedResponse, ...] = ()
    warnings: list[str] = []
    if not wanted:
        return found, warnings
    rng, model_class = np.random.default_rng([study.seed, 7]), best.model_class
    for own in filter(None, asked):
        theta = best.draw(n, rng)
        drawn = (adapted, model_class, theta)
        if own is asked[1]:
            drawn = _draw_with_factors(study, data, model_class, theta, linear, rng)
        responses, told = predict_responses(*drawn, own, study.backbones, unfit=unfit, rng=rng)
        found, warnings = (*found, *responses), [*warnings, *told]
    return found, warnings


def _list_settings(study: UpdatingStudy, data: BackboneData, growth: Mapping[int, float]) -> Mapping[str, Any]:
    noise = dict(vars(study.noise))
    if isinstance(study.noise.weight, Mapping):
        noise["weight"] = {str(mode): value for mode, value in study.noise.weight.items()}
    noise["cov"] = {str(mode.mode): mode.cov for mode in data.modes if mode.cov > 0}
    by_name = {str(mode): value for mode, value in growth.items()}
    noise["linear_error_growth"] = by_name if study.form == "recommended" else study.noise.growth_of_linear_error
    return {
        "form": study.form,
        "sampler": study.sampler,
        "samples": study.n_samples,
        "seed": study.seed,
        "joint": study.is_joint,
        "harmonics": list(study.harmonics),
        "interaction": study.interaction,
        "met_damping": study.met_damping,
        "internal_modes": study.n_internal,
        "noise": noise,
        "backbones": [one.name for one in study.backbones],
        "study": str(study.source or ""),
    }
