"""From an updating study to posteriors, the best law and what it predicts (Song et al. 2021), in two phases."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.progress import Say, Step
from opid.signals.recording import FloatArray
from opid.updating.checks import warn_of_overlaps
from opid.updating.confusion import find_confusion
from opid.updating.damping_prediction import predict_damping
from opid.updating.likelihood.backbones import (
    BackboneData,
    ModeData,
    backbone_data,
    without_curve,
)
from opid.updating.likelihood.curves import describe_points, make_curves, make_solver, weigh_as_recommended
from opid.updating.likelihood.error_growth import growth_of_linear_error, with_modal_errors
from opid.updating.likelihood.force import force_data
from opid.updating.likelihood.linear import LinearErrors, OneCov, OneShapeStd
from opid.updating.likelihood.noise import UNMENDED_GROWTH, draw_errors
from opid.updating.linear_updating import update_linear
from opid.updating.measured import MeasuredBackbone, by_mode
from opid.updating.model_class import DampingRatio, ModelClass, Prior, StiffnessFactor
from opid.updating.posterior import update_class
from opid.updating.result import BackboneBand, ClassPosterior, LinearPosterior, Updating
from opid.updating.sampling.samplers import require_nutpie
from opid.updating.settings import UPDATING
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.factored_modes import factored_modes
from opid.updating.structure.reduction import reduce
from opid.updating.study import UpdatingStudy
from opid.updating.warnings import warn_of_choice, warn_of_classes, warn_of_linear_choice

logger = logging.getLogger(__name__)


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
    say("backbones")
    growth = _find_growth(study, linear)
    data = _prepare(study, system, growth)
    unknown = {mode: prior for mode, prior in study.damping.items() if isinstance(prior, Prior)}
    ratios = tuple(DampingRatio(mode, prior) for mode, prior in sorted(unknown.items()))
    given = tuple(replace(each, ratios=ratios) for each in study.classes)
    if study.is_joint and linear is not None and isinstance(study.structure, AffineStructure):
        factors = tuple(StiffnessFactor(name, study.parameters[name]) for name in linear.names)
        given = tuple(replace(each, factors=factors) for each in given)
        structure = factored_modes(study.structure, linear.factors, linear.covariance, n_modes=study.n_internal)
        data = replace(data, structure=structure)
    classes, lost = _update_classes(study, given, data, say)
    best = max(classes, key=lambda each: each.log_evidence)
    say("prediction")
    bands, gone = _predict(study, data, best)
    chance = np.random.default_rng([study.seed, 5])
    damping = () if data.force is None else predict_damping(data, best, study.backbones, rng=chance)
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
            *warn_of_overlaps(study.backbones),
            *(f"linear structure: {warning}" for warning in (linear.warnings if linear else ())),
            *warn_of_linear_choice(linear_classes),
            *lost,
            *warn_of_classes(classes),
            *warn_of_choice(classes, bands),
            *gone,
        ),
        not_determined="",
        settings=_list_settings(study, data, growth),
        confusion=confusion,
        linear_classes=tuple(linear_classes) if len(linear_classes) > 1 else (),
        places=study.places,
        damping=damping,
    )


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
    return reduce(study.structure, linear.factors if linear else {}, n_modes=study.n_internal)


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
        n_sensors = len(curves[0].sensors)
        if n_sensors < 2:
            continue  # one sensor has no shape
        # The error of a shape cannot be inferred if the factors can fit the shape exactly.
        freedom = len(curves) * (n_sensors - 1) - len(study.parameters)
        expected = float(np.hypot(noise.shape_offset, noise.linear_shape_error))
        shape_std[mode] = "inferred" if len(curves) > 1 or freedom > 0 else expected
    return {"cov": cov, "shape_std": shape_std, "common_error": common}


def _find_growth(study: UpdatingStudy, linear: LinearPosterior | None) -> dict[int, float]:
    """Return the growth of the linear error along the backbones of each mode: as stated, or estimated by phase I."""
    noise = study.noise
    growth = dict.fromkeys(by_mode(study.backbones), noise.growth_of_linear_error)
    stated = noise.linear_error_growth is not None
    if study.is_joint and not stated:
        return dict.fromkeys(growth, UNMENDED_GROWTH)  # The errors of the factors are parameters of the classes.
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
    modes = tuple(mode for each in of_modes for mode in each.modes)
    known = {mode: ratio for mode, ratio in study.damping.items() if not isinstance(ratio, Prior)}
    force = force_data(modes, study.backbones, study.noise, known) if study.damping else None
    return replace(of_modes[0], modes=modes, noise=study.noise, force=force)


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


def _predict(
    study: UpdatingStudy, data: BackboneData, best: ClassPosterior
) -> tuple[tuple[BackboneBand, ...], list[str]]:
    try:
        return predict(data, best, study.backbones, rng=np.random.default_rng([study.seed, 3])), []
    except NotDeterminedError as error:
        return (), [f"there is no prediction: {error}"]


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
        "internal_modes": study.n_internal,
        "noise": noise,
        "backbones": [one.name for one in study.backbones],
        "study": str(study.source or ""),
    }


# ---- prediction ------------------------------------------------------------------------------------


N_AMPLITUDES = 40  # points of each band


def predict(
    data: BackboneData, posterior: ClassPosterior, measured: tuple[MeasuredBackbone, ...], *, rng: np.random.Generator
) -> tuple[BackboneBand, ...]:
    """Return the 95 % band of each mode for one more point of one more curve (Song eq. 18).

    lambda = lambda(theta) + e - r_m with theta drawn from the posterior. In the paper's forms e is drawn from
    N(0, sigma_lambda^2) and r_m is the mean of the curves. In the recommended form offset and noise of a further curve
    are drawn from their posterior given the measured ones. The band is nan where the model converges for less than half
    of the draws.

    Args:
        data: the backbones, from `backbone_data`.
        posterior: posterior of the class that predicts.
        measured: the same backbones, for the coverage.
        rng: source of chance.

    Raises:
        NotDeterminedError: no mode has a band anywhere.
    """
    theta = posterior.samples[rng.integers(len(posterior.samples), size=200)]
    data = with_modal_errors(data, posterior.model_class, posterior.best)
    bands = tuple(_make_band(data, mode, posterior, measured, theta, rng) for mode in data.modes)
    if not any(np.isfinite(band.frequency_hz).any() for band in bands):
        every = np.ones(N_AMPLITUDES, dtype=bool)
        where = " or ".join(f"mode {b.mode} at {describe_points(b.amplitude, every, b.sensor)}" for b in bands)
        raise NotDeterminedError(
            f"most draws of {posterior.model_class.name!r} have no backbone of {where}: take fewer harmonics, or "
            "smaller amplitudes"
        )
    return bands


def _make_band(
    data: BackboneData,
    mode: ModeData,
    posterior: ClassPosterior,
    measured: tuple[MeasuredBackbone, ...],
    theta: FloatArray,
    rng: np.random.Generator,
) -> BackboneBand:
    sensor = mode.parts[0][0]
    curves = [one for one in measured if one.mode == mode.mode and sensor in one.sensors]
    seen = [np.abs(one.amplitude[:, one.sensors.index(sensor)]) for one in curves]
    amplitude = np.linspace(min(each.min() for each in seen), max(each.max() for each in seen), N_AMPLITUDES)
    solve = make_solver(data, posterior.model_class, mode, sensor, amplitude)
    found = solve(theta)
    errors = _draw_errors(data, mode, posterior, theta, found.eigenvalue, rng)
    frequency = np.sqrt(np.maximum(found.eigenvalue + errors, 0.0)) / (2 * np.pi)
    there = np.isfinite(frequency)
    band = np.full((3, N_AMPLITUDES), np.nan)
    for index in np.flatnonzero(there.mean(axis=0) >= 0.5):
        band[:, index] = np.quantile(frequency[there[:, index], index], [0.025, 0.5, 0.975])
    low, middle, high = band
    hz = np.concatenate([one.frequency_hz for one in curves])
    ends = [np.interp(np.concatenate(seen), amplitude, end) for end in (low, high)]
    inside = ((hz >= ends[0]) & (hz <= ends[1]))[np.isfinite(ends[0])]
    coverage = float(inside.mean()) if inside.size else float("nan")
    left_out = _cover_left_out(data, mode, posterior, rng)
    return BackboneBand(mode.mode, sensor, amplitude, middle, low, high, coverage, left_out)


def _cover_left_out(
    data: BackboneData, mode: ModeData, posterior: ClassPosterior, rng: np.random.Generator
) -> float | None:
    """Return the fraction of the points of a mode within the bands that its other curves give; None where none is.

    Each curve is left out in turn: the samples of the posterior get the weight of the likelihood of all curves but that
    one over the likelihood of all.
    """
    n_curves = int(mode.curve[-1]) + 1
    if mode.frequency_noise is None or n_curves < 2:
        return None
    theta = posterior.samples[rng.integers(len(posterior.samples), size=UPDATING.n_left_out)]
    at_nodes, shapes, _, lost = make_curves(data, mode, posterior.model_class)(theta)
    if lost.all():
        return None
    at_nodes, shapes = at_nodes[~lost], shapes[~lost]
    whole, held = weigh_as_recommended(mode, at_nodes, shapes), []
    for curve in range(n_curves):
        rest, mine = without_curve(mode, curve, data.noise), mode.curve == curve
        chance = weigh_as_recommended(rest, at_nodes, shapes) - whole
        chosen = np.argmax(chance + rng.gumbel(size=(chance.size, chance.size)), axis=1)
        eigenvalue, model = at_nodes[chosen] @ mode.between[mine].T, at_nodes[chosen][..., None] / mode.linear
        assert rest.frequency_noise is not None
        errors = mode.linear * draw_errors(rest.frequency_noise, model, eigenvalue / mode.linear - 1, rng)
        low, high = np.quantile(eigenvalue + errors, [0.025, 0.975], axis=0)
        held.append((mode.eigenvalue[mine] >= low) & (mode.eigenvalue[mine] <= high))
    return float(np.concatenate(held).mean())


def _draw_errors(
    data: BackboneData,
    mode: ModeData,
    posterior: ClassPosterior,
    theta: FloatArray,
    eigenvalue: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """Draw errors of lambda for a further curve, (n, N_AMPLITUDES); nan without a curve of the model."""
    if mode.frequency_noise is not None:
        at_nodes, _, _, lost = make_curves(data, mode, posterior.model_class)(theta)
        growth = _fill_gaps(eigenvalue, mode.linear) / mode.linear - 1
        errors = mode.linear * draw_errors(mode.frequency_noise, at_nodes[..., None] / mode.linear, growth, rng)
        return np.where(lost[:, None], np.nan, errors)
    first = np.unique(mode.curve, return_index=True)[1]
    r_m = float(np.mean(mode.linear - mode.eigenvalue[first]))
    return data.noise.weight_of(mode.mode) * mode.cov * eigenvalue * rng.standard_normal(eigenvalue.shape) - r_m


def _fill_gaps(eigenvalue: FloatArray, otherwise: float) -> FloatArray:
    """Return rows with gaps interpolated, for the errors of a curve depend on all of it."""
    filled, index = eigenvalue.copy(), np.arange(eigenvalue.shape[1])
    for row in np.flatnonzero(np.isnan(eigenvalue).any(axis=1)):
        there = np.isfinite(eigenvalue[row])
        filled[row] = np.interp(index, index[there], eigenvalue[row, there]) if there.any() else otherwise
    return filled
