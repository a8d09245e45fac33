"""The way from start values to a fit: from afar, among laws, and at last with all readings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from opid.identify.body.fit import EXPLAINS, FASTEST, ON_THE_WAY, BodyFit, fastest_rate, fit_body
from opid.identify.body.laws import ENOUGH, LawStep, is_hopeless, search_laws
from opid.identify.body.model import BodyModel
from opid.identify.body.structure import ImpossibleBodyError
from opid.mechanics.driven import UnboundedResponseError
from opid.signals.recording import FloatArray

# the noise below the suspensions is taken for so many times larger on the way to a fit from afar
FROM_AFAR, FROM_NEARER = (100.0, 20.0, 4.0), (30.0, 5.0)


def way_to_fit(
    model: BodyModel,
    theta: FloatArray,
    *,
    several: bool,
    searched: bool,
    progress: Callable[[str], None] | None = None,
) -> tuple[BodyFit, tuple[LawStep, ...]]:
    """Fit a body from start values; return the fit and the laws that were tried.

    Until laws are found runs are taken at a coarse rate, where the body moves slowly enough for its steps.

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
    coarse = model.coarse if fastest_rate(model, theta) <= FASTEST * model.coarse.runs[0].fs else model
    fit, steps = _way(coarse, theta, FROM_AFAR, searched, progress)
    if several and fit.variance > EXPLAINS**2:
        try:
            again = _way(coarse, theta, FROM_NEARER, searched, progress, hold_places=False)
            fit, steps = min((fit, steps), again, key=lambda way: way[0].bic)
        except (UnboundedResponseError, ImpossibleBodyError):
            pass
    return _with_all_readings(model, fit, steps, searched and coarse is not model, progress)


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
        steps += more[1:]
        fit = fit if better is fit else fit_body(better.model, better.theta)
    return fit, steps
