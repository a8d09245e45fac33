"""The figures of an updating: which there are, what each shows, and what is worked out for it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from opid import plots
from opid.mechanics.laws.law import FloatArray
from opid.mechanics.truth import UpdatingTruth
from opid.report.document import Figure
from opid.report.updating.reduction import order_sentences, reduction_sentences
from opid.updating.result import ClassPosterior, LinearPosterior, Updating

N_SENSORS_SHOWN = 6  # sensors of a figure of backbones, those that move most
N_DRAWS = 200  # of the samples, for the band of a force
N_EXTENSIONS = 200  # at which a force is drawn


def figures_of(result: Updating, truth: UpdatingTruth | None) -> Iterator[Figure]:
    """Yield the figures in the order of the work, those that have something to show.

    Args:
        result: of an updating.
        truth: of simulated backbones, drawn beside it.
    """
    for mode in sorted({curve.mode for curve in result.measured}):
        yield _measured_figure(result, mode)
    if result.linear is not None:
        yield from _linear_figures(result.linear, truth)
    if result.reductions:
        yield _reduction_figure(result)
    if result.classes:
        yield from _class_figures(result, truth)
    for mode in sorted({band.mode for band in result.prediction}):
        yield _predicted_figure(result, mode)


def _measured_figure(result: Updating, mode: int) -> Figure:
    return Figure(
        f"measured_mode_{mode}",
        f"Mode {mode}: what was measured",
        "Amplitude of the first harmonic over the frequency of phase resonance, one curve a test. They should lie on "
        "each other: how far they do not is what the likelihood takes for errors. A loop or a peak is a modal "
        "interaction, of which one harmonic knows nothing.",
        lambda: plots.measured_backbones(result.measured, mode, sensors=_moving(result, mode)),
    )


def _linear_figures(linear: LinearPosterior, truth: UpdatingTruth | None) -> Iterator[Figure]:
    yield Figure(
        "linear_updating",
        "The linear structure, before and after",
        "Frequencies and shapes of the lowest points of the backbones against the structure as it was given and with "
        "its updated parameters.",
        lambda: plots.linear_updating(linear),
    )
    yield Figure(
        "linear_samples",
        "Linear parameters",
        "Samples of the posterior of the factors as densities, with the contours of 50, 90 and 99 % of a Gaussian of "
        "the same mean and covariance. Green, if any, is the truth of a simulation.",
        lambda: plots.parameter_samples(
            linear.samples,
            [f"{name} [of nominal]" for name in linear.names],
            truth=[truth.linear.get(name) for name in linear.names] if truth else None,
        ),
    )
    yield Figure(
        "linear_running",
        "Linear parameters: have they converged?",
        "Mean and standard deviation of the samples so far. Lines that still drift at the end ask for more samples.",
        lambda: plots.running_moments(linear.samples, linear.names),
    )


def _reduction_figure(result: Updating) -> Figure:
    sentences = (*reduction_sentences(result), *order_sentences(result.reductions))
    used, *others = result.reductions
    caption = " ".join(f"{each[0].upper()}{each[1:]}." for each in sentences)
    return Figure(
        "reduction",
        "What the reduction leaves out",
        "Frequencies and shapes of the reduced structure against those of the whole one, mode by mode. The modes that "
        f"are tested and those near their multiples should be exact; higher ones need not. {caption}",
        lambda: plots.reduction_figure(used, free=others[0] if others else None),
    )


def _class_figures(result: Updating, truth: UpdatingTruth | None) -> Iterator[Figure]:
    yield Figure(
        "log_evidences",
        "Which class",
        "Log evidence less that of the best class (in red), by every method that was run. Three is strong, five is "
        "decisive, and one is nothing; a class with a further term pays for the width of its prior.",
        lambda: plots.log_evidences(result),
    )
    yield Figure(
        "joint_forces",
        "What the classes make of the joints",
        "Nonlinear force of every class up to the extension that the tests reached; beyond, each law is an "
        "extrapolation. Classes whose curves lie on each other, drawn in turns, cannot be told apart by these data.",
        lambda: _draw_forces(result, truth),
    )
    for number, posterior in enumerate(result.classes, start=1):
        yield from _figures_of_class(number, posterior, truth)


def _figures_of_class(number: int, posterior: ClassPosterior, truth: UpdatingTruth | None) -> Iterator[Figure]:
    name = posterior.model_class.name
    labels = posterior.labels
    yield Figure(
        f"class_{number}_samples",
        f"{name}, {posterior.model_class.law_in_words}: parameters",
        "Samples of the posterior as densities, and the Gaussian of the same mean and covariance. A narrow slanting "
        "cloud says that two terms stand in for each other; a cut edge, that the prior ends where the data do not.",
        lambda: plots.parameter_samples(
            posterior.samples, labels, truth=true_theta(posterior, truth) if truth else None
        ),
    )
    yield Figure(
        f"class_{number}_running",
        f"{name}, {posterior.model_class.law_in_words}: have they converged?",
        "Mean and standard deviation of the samples so far.",
        lambda: plots.running_moments(posterior.samples, labels),
    )


def _predicted_figure(result: Updating, mode: int) -> Figure:
    n_missing = sum(band.n_missing for band in result.prediction if band.mode == mode)
    gap = " Where it breaks off, most draws of the parameters have no backbone." if n_missing else ""
    return Figure(
        f"predicted_mode_{mode}",
        f"Mode {mode}: what the best class predicts",
        "Backbone of the best class with its 95 % band over the measured points. The class was fitted to these points: "
        "the fraction within the band is no test on new data. Points that leave the band on one side, and more of them "
        f"with the amplitude, ask for another law.{gap}",
        lambda: plots.predicted_backbones(_bands_shown(result, mode), result.measured, mode),
    )


def true_theta(posterior: ClassPosterior, truth: UpdatingTruth | None) -> list[float | None]:
    """Return the true value of each parameter of a class; None for each where the class lacks a part of the true law.

    Args:
        posterior: of the class.
        truth: of a simulated test, or None.
    """
    own = posterior.model_class
    law = {term.name: term.amplitude for term in truth.law.terms} if truth else None
    if law is None or not set(law) <= set(own.kinds):
        return [None] * own.n_parameters
    return [law.get(kind, 0.0) / scale + 0.0 for kind, scale in zip(own.kinds, own.scales, strict=True)]


def _draw_forces(result: Updating, truth: UpdatingTruth | None) -> Any:
    reached = result.reached_extension
    # joints that the tests do not extend have laws all the same
    extension = np.linspace(0, 1.1 * max(reached.values(), default=0.0) or 1e-3, N_EXTENSIONS)
    return plots.joint_forces(
        extension,
        [_force_band(each, extension) for each in result.classes],
        best=result.best_class,
        truth=truth.law.force(extension, 0.0) if truth else None,
        reached=reached,
    )


def _force_band(posterior: ClassPosterior, extension: FloatArray) -> Any:
    own = posterior.model_class
    thinned = posterior.samples[:: max(1, len(posterior.samples) // N_DRAWS)]
    draws = np.array([own.law(theta).force(extension, 0.0) for theta in thinned])
    low, high = np.quantile(draws, [0.025, 0.975], axis=0)
    return plots.ForceBand(own.name, draws.mean(axis=0), low, high)


def _moving(result: Updating, mode: int) -> list[str]:
    """The sensors that move most in a mode, in the order of the data."""
    curves = [curve for curve in result.measured if curve.mode == mode]
    largest: dict[str, float] = {}
    for curve in curves:
        for sensor, values in zip(curve.sensors, np.abs(curve.amplitude).max(axis=0), strict=True):
            largest[sensor] = max(largest.get(sensor, 0.0), float(values))
    chosen = sorted(largest, key=lambda sensor: -largest[sensor])[:N_SENSORS_SHOWN]
    return [sensor for sensor in largest if sensor in chosen]


def _bands_shown(result: Updating, mode: int) -> list[Any]:
    shown = set(_moving(result, mode)) if any(curve.mode == mode for curve in result.measured) else set()
    own = [band for band in result.prediction if band.mode == mode]
    return ([band for band in own if band.sensor in shown] or own)[:N_SENSORS_SHOWN]
