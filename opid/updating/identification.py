"""From an updating study to posteriors, the best law and what it predicts (Song et al. 2021), in two phases."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.updating.data.checks import overlaps
from opid.updating.data.measured import MeasuredBackbone
from opid.updating.data.noise_settings import UNMENDED_GROWTH, LeftOut
from opid.updating.doubts import doubts_of_choice, doubts_of_classes
from opid.updating.likelihood.backbones import BackboneData, backbone_data
from opid.updating.likelihood.linear_error import growth_of_linear_error
from opid.updating.linear_updating import update_linear
from opid.updating.posterior import update_class
from opid.updating.prediction import predict
from opid.updating.result import BackboneBand, ClassPosterior, LinearPosterior, Updating
from opid.updating.sampling.ensemble import require_emcee
from opid.updating.structure.reduction import reduce
from opid.updating.study import UpdatingStudy

logger = logging.getLogger(__name__)

Say = Callable[[str], None]


def update_study(study: UpdatingStudy, *, progress: Say | None = None) -> Updating:
    """Update the linear structure, then each class of laws; choose one and predict with it.

    Phase I takes the lowest points of the backbones; the structure with its best parameters is reduced to sensors,
    joints and some internal modes, and phase II updates the coefficients of every class with it. The class with the
    largest evidence predicts. Each part draws from a stream of its own, so that a class more changes no other.

    Args:
        study: structure, backbones, classes and settings.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: a structure, backbones or settings that cannot be used, or a sampler that is not installed.
        NotDeterminedError: the lowest points do not tell the linear parameters, or no class has a likelihood.
    """
    if not isinstance(study, UpdatingStudy):
        raise InputError(f"study is of type {type(study).__name__}: give an UpdatingStudy, as read_study makes one")
    if study.sampler == "ensemble":
        require_emcee()
    say = progress or (lambda step: None)
    linear, system = _linear(study, say)
    say("backbones")
    growth = _growth(study, linear)
    data = _data(study, system, growth)
    classes, lost = _classes(study, data, say)
    best = max(classes, key=lambda each: each.log_evidence)
    say("prediction")
    bands, gone = _prediction(study, data, best)
    of_classes = doubts_of_classes(classes)
    of_study = [*_unused(study), *overlaps(study.backbones)]
    of_linear = [f"linear structure: {doubt}" for doubt in linear.warnings] if linear else []
    return Updating(
        title=study.title,
        form=study.form,
        linear=linear,
        system=system,
        measured=study.backbones,
        classes=tuple(classes),
        best_class=best.model_class.name,
        prediction=bands,
        warnings=(*of_study, *of_linear, *lost, *of_classes, *doubts_of_choice(classes, bands), *gone),
        not_determined="",
        settings=_settings(study, data, growth),
    )


def _unused(study: UpdatingStudy) -> list[str]:
    """At most one sentence: settings that the form does not use."""
    stated = study.noise.stated_for_papers
    if study.form != "recommended" or not stated:
        return []
    return [f"the recommended form does not use {', '.join(stated)}: leave out what is stated, or take another form"]


def _linear(study: UpdatingStudy, say: Say) -> tuple[LinearPosterior | None, JointedModes]:
    """Phase I where there is something to update, and the structure by its modes."""
    if isinstance(study.structure, JointedModes):
        return None, study.structure
    linear, factors = None, {}
    if study.parameters:
        say("linear structure")
        rng = np.random.default_rng([study.seed, 1])
        linear = update_linear(
            study.structure,
            study.backbones,
            priors=study.parameters,
            rng=rng,
            progress=lambda share: say(f"linear structure {share:.0%}"),
            **_linear_noise(study),
        )
        factors = dict(zip(linear.names, (float(value) for value in linear.best), strict=True))
    say("reduction")
    return linear, reduce(study.structure, factors, n_modes=study.n_internal)


def _linear_noise(study: UpdatingStudy) -> dict[str, Any]:
    """How phase I weighs frequencies and shapes: by the scatter of the curves, inferred in the recommended form.

    Beside it stands an error that all curves of a mode share, but in the forms that are the paper's.
    """
    noise = study.noise
    given: dict[str, Any] = {} if study.form in ("paper", "literal") else {"common_error": noise.linear_error}
    modes = sorted({one.mode for one in study.backbones})
    if study.form != "recommended":
        weights = dict.fromkeys(modes, noise.weight)
        return given | {"cov": noise.cov or "scatter", "weights": weights, "shape_factor": noise.shape_factor}
    cov, shape_std = {}, {}
    for mode in modes:
        curves = [one for one in study.backbones if one.mode == mode]
        scatters = len({float(one.frequency_hz[0]) for one in curves}) > 1
        # one curve has no scatter, nor have curves that begin alike: its offset is what is expected of one
        cov[mode] = "inferred" if scatters else 2 * noise.curve_offset
        n_sensors = len(curves[0].sensors)
        if n_sensors < 2:
            continue  # one sensor has no shape
        # a shape that the factors can meet exactly tells nothing of its own error
        rest = len(curves) * (n_sensors - 1) - len(study.parameters)
        level = float(np.hypot(noise.shape_offset, noise.linear_shape_error))
        shape_std[mode] = "inferred" if len(curves) > 1 or rest > 0 else level
    return given | {"cov": cov, "shape_std": shape_std}


def _growth(study: UpdatingStudy, linear: LinearPosterior | None) -> dict[int, float]:
    """How far the linear error may grow along the backbones of each mode: as set, else by what phase I leaves."""
    growth = dict.fromkeys(sorted({one.mode for one in study.backbones}), study.noise.linear_error_growth)
    stated = not isinstance(study.noise.linear_error_growth, LeftOut)
    if linear is None or stated or study.form != "recommended" or isinstance(study.structure, JointedModes):
        return growth
    left = growth_of_linear_error(
        study.structure,
        dict(zip(linear.names, (float(value) for value in linear.best), strict=True)),
        linear.covariance,
        study.backbones,
        linear_error=study.noise.linear_error,
        n_modes=study.n_internal,
    )
    return growth | {mode: float(np.hypot(value, UNMENDED_GROWTH)) for mode, value in left.items()}


def _data(study: UpdatingStudy, system: JointedModes, growth: Mapping[int, float]) -> BackboneData:
    """The backbones, each mode with the growth of its own linear error."""
    of_modes = [
        backbone_data(
            system,
            [one for one in study.backbones if one.mode == mode],
            form=study.form,
            harmonics=study.harmonics,
            noise=replace(study.noise, linear_error_growth=value),
        )
        for mode, value in growth.items()
    ]
    return replace(of_modes[0], modes=tuple(mode for each in of_modes for mode in each.modes), noise=study.noise)


def _classes(study: UpdatingStudy, data: BackboneData, say: Say) -> tuple[list[ClassPosterior], list[str]]:
    classes, lost = [], []
    for number, model_class in enumerate(study.classes):
        say(model_class.name)

        def say_done(fraction: float, name: str = model_class.name) -> None:
            say(f"{name} {fraction:.0%}")

        rng = np.random.default_rng([study.seed, 2, number])
        try:
            found = update_class(
                data, model_class, rng=rng, sampler=study.sampler, n_samples=study.n_drawn, progress=say_done
            )
            told = "class %s: log evidence %.2f, %d evaluations"
            logger.info(told, model_class.name, found.log_evidence, found.diagnostics.n_evaluations)
            classes.append(found)
        except NotDeterminedError as error:
            lost.append(f"class {model_class.name!r} is left out: {error}")
    if not classes:
        raise NotDeterminedError("; ".join(lost))
    return classes, lost


def _prediction(
    study: UpdatingStudy, data: BackboneData, best: ClassPosterior
) -> tuple[tuple[BackboneBand, ...], list[str]]:
    try:
        return predict(data, best, study.backbones, rng=np.random.default_rng([study.seed, 3])), []
    except NotDeterminedError as error:
        return (), [f"there is no prediction: {error}"]


def _settings(study: UpdatingStudy, data: BackboneData, growth: Mapping[int, float]) -> Mapping[str, Any]:
    """What the result was made with, in plain values."""
    noise = dict(vars(study.noise))
    noise["cov"] = {str(mode.mode): mode.cov for mode in data.modes if mode.cov > 0}
    if study.form == "recommended":
        noise["linear_error_growth"] = {str(mode): value for mode, value in growth.items()}
    return {
        "form": study.form,
        "sampler": study.sampler,
        "samples": study.n_drawn,
        "seed": study.seed,
        "harmonics": list(study.harmonics),
        "internal_modes": study.n_internal,
        "noise": noise,
        "backbones": _names(study.backbones),
        "study": str(study.source or ""),
    }


def _names(backbones: Sequence[MeasuredBackbone]) -> list[str]:
    return [one.name for one in backbones]
