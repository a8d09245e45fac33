"""Fit again from where a fit stands, in few simulations: another law, or fewer runs to predict the ones left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.laws import Law
from opid.signals.recording import FloatArray
from opid.suspensions.law_parameters import positive, to_free
from opid.suspensions.levenberg_marquardt import MOST_EVALUATIONS, least_squares
from opid.suspensions.one_gear.driven_model import Errors, Model
from opid.suspensions.one_gear.driven_run import DrivenRun
from opid.suspensions.one_gear.model_fit import ModelFit, fit_at

# the logarithm of a scale moves by so much in a step at the most
LARGEST_LOG_STEP = 1.0


def refit(runs: Sequence[DrivenRun], fit: ModelFit, law: Law, *, most_evaluations: int = MOST_EVALUATIONS) -> ModelFit:
    """Fit another law, from everything else that a fit found.

    What a dropped term did on average goes to the start values of stiffness and damping.

    Args:
        runs: one `DrivenRun` a run.
        fit: where to start.
        law: the law per unit of sprung mass to start from.
        most_evaluations: simulations at the most.

    Raises:
        UnboundedResponseError: the law makes a suspension that grows without bound.
    """
    before = [float(np.mean(slope)) for slope in fit.law.gradient(fit.travel, fit.velocity)]
    now = [float(np.mean(slope)) for slope in law.gradient(fit.travel, fit.velocity)]
    model, theta = in_place_of(runs, fit, law)
    theta[:2] += np.subtract(before, now)
    theta, n_evaluations = settled(model, theta, most_evaluations=most_evaluations)
    return fit_at(model, theta, n_evaluations)


def in_place_of(runs: Sequence[DrivenRun], fit: ModelFit, law: Law) -> tuple[Model, FloatArray]:
    """Return the model of a fit with another law, and the vector at which everything else is as it was fitted.

    Args:
        runs: one `DrivenRun` a run.
        fit: the fit.
        law: takes the place of the fitted one, per unit of sprung mass.
    """
    model = replace(fit.model(runs), law=law)
    before, after = fit.vector[: model.n_head], fit.vector[model.n_head + fit.law.vector.size :]
    return model, np.concatenate([before, to_free(law), after])


def settled(
    model: Model,
    theta: FloatArray,
    *,
    free: slice = slice(None),
    most_evaluations: int = MOST_EVALUATIONS,
) -> tuple[FloatArray, int]:
    """Return the vector of least squared error near `theta` and the simulations spent.

    Args:
        model: the model.
        theta: where to start.
        free: the entries that may move.
        most_evaluations: simulations at the most.

    Raises:
        UnboundedResponseError: the start itself grows without bound.
    """
    lower, upper = model.bounds(float(theta[1]))

    def evaluate(vector: FloatArray) -> Errors | None:
        try:
            return model.evaluate(vector)
        except UnboundedResponseError:
            return None

    return least_squares(
        evaluate, theta, lower, upper, _caps(model), free=free, most_evaluations=most_evaluations, first=model.evaluate
    )


def left_out_error(runs: Sequence[DrivenRun], fit: ModelFit) -> float | None:
    """Return how well each run is predicted by a fit of the others, m/s^2; None for a single run or an unbounded one.

    The rms of the whitened prediction errors in the band, times the level of the sensors' noise, as
    `JointFit.noise_m_per_s2` is of the runs that were fitted. Of the run left out only its start is fitted. The mass
    stays that of all runs where the others have but one.

    Args:
        runs: one `DrivenRun` a run.
        fit: of all of them.
    """
    if len(runs) < 2:
        return None
    cost, n_data = 0.0, 0
    for place, run in enumerate(runs):
        try:
            errors = _predicted(runs, fit, place)
        except UnboundedResponseError:
            return None
        n = 2 * run.omega.size
        cost, n_data = cost + float(np.sum(errors.stacked[:n] ** 2)), n_data + n
    return fit.level * float(np.sqrt(cost / n_data))


def _predicted(runs: Sequence[DrivenRun], fit: ModelFit, place: int) -> Errors:
    """Errors of one run as the others predict it."""
    others = [run for i, run in enumerate(runs) if i != place]
    n_shared, model = len(fit.names), fit.model(others)
    shared = fit.vector[:n_shared]
    if model.mass_free and len({run.mass_change_kg for run in others}) < 2:
        model = replace(model, held_inverse_mass=fit["inverse_mass"])
        shared = np.delete(shared, fit.names.index("inverse_mass"))
    found, _ = settled(model, np.concatenate([shared, np.delete(fit.start, place, axis=0).ravel()]))
    alone = replace(model, runs=(runs[place],))
    begun = np.concatenate([found[: shared.size], fit.start[place]])
    theta, _ = settled(alone, begun, free=slice(shared.size, None))
    return alone.evaluate(theta, sensitivity=False)


def _caps(model: Model) -> FloatArray:
    """How far each entry may move in a step."""
    caps = np.full(len(model.names) + 2 * len(model.runs), np.inf)
    of_law = slice(model.n_head, model.n_head + model.law.vector.size)
    caps[of_law][positive(model.law)] = LARGEST_LOG_STEP
    return caps
