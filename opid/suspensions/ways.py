"""The way from start values to a fit: from afar, among laws, and at last with all readings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy import fft

from opid.mechanics.driven import UnboundedResponseError
from opid.signals.recording import FloatArray
from opid.suspensions.fit import EXPLAINS, FASTEST, ON_THE_WAY, BodyFit, fastest_rate, fit_body
from opid.suspensions.laws import ENOUGH, LawStep, is_hopeless, search_laws
from opid.suspensions.model import BodyModel
from opid.suspensions.run import BodyRun
from opid.suspensions.structure import ImpossibleBodyError

# the noise below the suspensions is taken for so many times larger on the way to a fit from afar
FROM_AFAR, FROM_NEARER = (100.0, 20.0, 4.0), (30.0, 5.0)
# power over that of the noise, on average over the lines of a sensor that thinning folds into the band
MOST_FOLDED = 2.0


def way_to_fit(
    model: BodyModel,
    theta: FloatArray,
    *,
    several: bool,
    searched: bool,
    progress: Callable[[str], None] | None = None,
) -> tuple[BodyFit, tuple[LawStep, ...]]:
    """Fit a body from start values; return the fit and the laws that were tried.

    Until laws are found runs are taken at a coarse rate, where its steps follow the body and nothing that the model
    does not predict would fold into the band; then all readings are fitted, and searched once more. Where no law
    promises to mend what is left, laws are not searched, and the fit ends early.

    Args:
        model: the body, its runs and first laws.
        theta: start values.
        several: whether a second way is tried where the first leaves more than noise: several suspensions have minima
            beside the right one, others on each way.
        searched: whether laws are searched.
        progress: called with the name of each step as it begins.

    Raises:
        UnboundedResponseError: the start values make a suspension that grows without bound.
        ImpossibleBodyError: the start values make a mass matrix that is not positive definite.
    """
    coarse = _at_coarse_rate(model, theta)
    try:
        fit, steps = _ways(coarse, theta, several, searched, progress)
        lost = fastest_rate(fit.model, fit.theta) > FASTEST * coarse.runs[0].fs
    except (UnboundedResponseError, ImpossibleBodyError):
        if coarse is model:
            raise
        lost = True
    if lost and coarse is not model:
        # the way leads where long steps do not
        coarse = model
        fit, steps = _ways(model, theta, several, searched, progress)
    return _with_all_readings(model, fit, steps, searched and coarse is not model, progress)


def _at_coarse_rate(model: BodyModel, theta: FloatArray) -> BodyModel:
    """The model at a coarse rate; as it is where that would mislead."""
    coarse = model.coarse
    if coarse is model or fastest_rate(model, theta) > FASTEST * coarse.runs[0].fs:
        return model
    predictions = model.evaluate(theta, sensitivity=False).predictions
    folded = [
        folded_power(prediction.innovation[: run.sprung.shape[1]], run, thinned)
        for prediction, run, thinned in zip(predictions, model.runs, coarse.runs, strict=True)
    ]
    return coarse if max(folded) < MOST_FOLDED else model


def folded_power(innovation: FloatArray, run: BodyRun, thinned: BodyRun) -> float:
    """Return what a thinned run folds into its band of what the model does not predict, over the noise.

    Args:
        innovation: (n_sensors, n) white errors of the run.
        run: the run.
        thinned: the same at a coarse rate.
    """
    frequency_hz = fft.rfftfreq(run.n_samples, 1 / run.fs)
    into_hz = np.abs(frequency_hz - thinned.fs * np.round(frequency_hz / thinned.fs))
    folds = (frequency_hz > thinned.fs / 2) & (into_hz <= thinned.omega[-1] / (2 * np.pi))
    power = np.abs(fft.rfft(innovation)[:, folds]) ** 2 / run.n_samples
    return float(power.mean(axis=1).max())


def _ways(
    model: BodyModel,
    theta: FloatArray,
    several: bool,
    searched: bool,
    progress: Callable[[str], None] | None,
) -> tuple[BodyFit, tuple[LawStep, ...]]:
    """The first way, and a second one where it leaves more than noise."""
    fit, steps = _way(model, theta, FROM_AFAR, searched, progress)
    if several and fit.variance > EXPLAINS**2:
        try:
            again = _way(model, theta, FROM_NEARER, searched, progress, hold_places=False)
            fit, steps = min((fit, steps), again, key=lambda way: way[0].bic)
        except (UnboundedResponseError, ImpossibleBodyError):
            pass
    return fit, steps


def _way(
    model: BodyModel,
    theta: FloatArray,
    noisier: Sequence[float],
    searched: bool,
    progress: Callable[[str], None] | None,
    *,
    hold_places: bool = True,
) -> tuple[BodyFit, tuple[LawStep, ...]]:
    """One way from the start values to a fit, and the laws that were tried on it."""
    fit = fit_body(model, theta, noisier=noisier, hold_places=hold_places, least_promise=ENOUGH)
    return search_laws(fit, progress=progress) if searched else (fit, ())


def _with_all_readings(
    model: BodyModel,
    fit: BodyFit,
    steps: tuple[LawStep, ...],
    search_again: bool,
    progress: Callable[[str], None] | None,
) -> tuple[BodyFit, tuple[LawStep, ...]]:
    """A fit at a coarse rate, and the laws that were tried, with all readings."""
    whole = replace(fit.model, runs=model.runs)
    if is_hopeless(fit):
        return fit_body(whole, fit.theta, least_promise=ON_THE_WAY), steps
    fit = fit_body(whole, fit.theta)
    if search_again:
        # what only all readings together show
        better, more = search_laws(fit, progress=progress)
        steps += more
        fit = fit if better is fit else fit_body(better.model, better.theta)
    return fit, steps
