"""From an updating study to posteriors, the best law and what it predicts (Song et al. 2021), in two phases."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.updating.checks import overlaps
from opid.updating.likelihood.curves import BackboneData, backbone_data
from opid.updating.likelihood.linear import LinearErrors, OneCov, OneShapeStd
from opid.updating.likelihood.noise import UNMENDED_GROWTH
from opid.updating.linear_updating import growth_of_linear_error, update_linear
from opid.updating.measured import by_mode
from opid.updating.posterior import update_class
from opid.updating.prediction import predict
from opid.updating.result import BackboneBand, ClassPosterior, LinearPosterior, Updating
from opid.updating.sampling.samplers import require_emcee
from opid.updating.structure.reduction import reduce
from opid.updating.study import UpdatingStudy
from opid.updating.warnings import warnings_of_choice, warnings_of_classes

logger = logging.getLogger(__name__)

Say = Callable[[str], None]


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
    if study.sampler == "ensemble":
        require_emcee()
    say = progress or (lambda step: None)
    linear, system = _update_linear(study, say)
    say("backbones")
    growth = _growth_by_mode(study, linear)
    data = _prepare(study, system, growth)
    classes, lost = _update_classes(study, data, say)
    best = max(classes, key=lambda each: each.log_evidence)
    say("prediction")
    bands, gone = _predict(study, data, best)
    stated = study.noise.stated_for_papers if study.form == "recommended" else ()
    unused = f"the recommended form does not use {', '.join(stated)}: leave out what is stated, or take another form"
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
            *overlaps(study.backbones),
            *(f"linear structure: {warning}" for warning in (linear.warnings if linear else ())),
            *lost,
            *warnings_of_classes(classes),
            *warnings_of_choice(classes, bands),
            *gone,
        ),
        not_determined="",
        settings=_settings(study, data, growth),
    )


def _update_linear(study: UpdatingStudy, say: Say) -> tuple[LinearPosterior | None, JointedModes]:
    """Return the result of phase I, None where there is nothing to update, and the structure by its modes."""
    if isinstance(study.structure, JointedModes):
        return None, study.structure
    linear = None
    if study.parameters:
        say("linear structure")
        linear = update_linear(
            study.structure,
            study.backbones,
            priors=study.parameters,
            rng=np.random.default_rng([study.seed, 1]),
            progress=lambda fraction: say(f"linear structure {fraction:.0%}"),
            **_linear_errors(study),
        )
    say("reduction")
    return linear, reduce(study.structure, linear.factors if linear else {}, n_modes=study.n_internal)


def _linear_errors(study: UpdatingStudy) -> LinearErrors:
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
        # one curve has no scatter, nor have curves with equal beginnings: the expected offset of a curve replaces it
        cov[mode] = "inferred" if scatters else 2 * noise.curve_offset
        n_sensors = len(curves[0].sensors)
        if n_sensors < 2:
            continue  # one sensor has no shape
        # the error of a shape cannot be inferred if the factors can fit the shape exactly
        rest = len(curves) * (n_sensors - 1) - len(study.parameters)
        expected = float(np.hypot(noise.shape_offset, noise.linear_shape_error))
        shape_std[mode] = "inferred" if len(curves) > 1 or rest > 0 else expected
    return {"cov": cov, "shape_std": shape_std, "common_error": common}


def _growth_by_mode(study: UpdatingStudy, linear: LinearPosterior | None) -> dict[int, float]:
    """Return how far the linear error may grow along the backbones of each mode: as set, else estimated by phase I."""
    noise = study.noise
    growth = dict.fromkeys(by_mode(study.backbones), noise.growth_of_linear_error)
    stated = noise.linear_error_growth is not None
    if linear is None or stated or study.form != "recommended" or isinstance(study.structure, JointedModes):
        return growth
    left = growth_of_linear_error(
        study.structure,
        linear.factors,
        linear.covariance,
        study.backbones,
        linear_error=noise.linear_error,
        n_modes=study.n_internal,
    )
    return growth | {mode: float(np.hypot(value, UNMENDED_GROWTH)) for mode, value in left.items()}


def _prepare(study: UpdatingStudy, system: JointedModes, growth: Mapping[int, float]) -> BackboneData:
    """Return the backbones, each mode with the growth of its own linear error."""
    of_modes = [
        backbone_data(
            system,
            curves,
            form=study.form,
            harmonics=study.harmonics,
            noise=replace(study.noise, linear_error_growth=growth[mode]),
        )
        for mode, curves in by_mode(study.backbones).items()
    ]
    return replace(of_modes[0], modes=tuple(mode for each in of_modes for mode in each.modes), noise=study.noise)


def _update_classes(study: UpdatingStudy, data: BackboneData, say: Say) -> tuple[list[ClassPosterior], list[str]]:
    """Return the posterior of each class that has a likelihood, and why others are left out."""
    classes, lost = [], []
    for number, model_class in enumerate(study.classes):
        name = model_class.name
        say(name)
        try:
            found = update_class(
                data,
                model_class,
                rng=np.random.default_rng([study.seed, 2, number]),
                sampler=study.sampler,
                n_samples=study.n_samples_of_class,
                progress=lambda fraction, name=name: say(f"{name} {fraction:.0%}"),  # type: ignore[misc]
            )
            n_evaluations = found.diagnostics.n_evaluations
            logger.info("class %s: log evidence %.2f, %d evaluations", name, found.log_evidence, n_evaluations)
            classes.append(found)
        except NotDeterminedError as error:
            lost.append(f"class {name!r} is left out: {error}")
    if not classes:
        raise NotDeterminedError("; ".join(lost))
    return classes, lost


def _predict(
    study: UpdatingStudy, data: BackboneData, best: ClassPosterior
) -> tuple[tuple[BackboneBand, ...], list[str]]:
    try:
        return predict(data, best, study.backbones, rng=np.random.default_rng([study.seed, 3])), []
    except NotDeterminedError as error:
        return (), [f"there is no prediction: {error}"]


def _settings(study: UpdatingStudy, data: BackboneData, growth: Mapping[int, float]) -> Mapping[str, Any]:
    """Return the settings of the result in plain values."""
    noise = dict(vars(study.noise))
    noise["cov"] = {str(mode.mode): mode.cov for mode in data.modes if mode.cov > 0}
    by_name = {str(mode): value for mode, value in growth.items()}
    noise["linear_error_growth"] = by_name if study.form == "recommended" else study.noise.growth_of_linear_error
    return {
        "form": study.form,
        "sampler": study.sampler,
        "samples": study.n_samples_of_class,
        "seed": study.seed,
        "harmonics": list(study.harmonics),
        "internal_modes": study.n_internal,
        "noise": noise,
        "backbones": [one.name for one in study.backbones],
        "study": str(study.source or ""),
    }
