"""Where a run of one gear begins: the travel and velocity that predict its first seconds best."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.prediction import predict
from opid.signals.recording import FloatArray
from opid.suspensions.model import Model
from opid.suspensions.priors import state_at_start


def look_for_start(model: Model, theta: FloatArray) -> FloatArray:
    """Return the vector with the travel and velocity that predict the first seconds of each run of one gear best.

    All cells of a grid are predicted for a short while, then the best of them for longer.
    """
    known, found = model.settings.fit, theta.copy()
    grid = np.linspace(-known.start_reach_rms, known.start_reach_rms, known.n_start_grid)
    rms = model.motion_rms[0]
    std = (grid[1] - grid[0]) / 2 * rms
    for place in range(len(model.runs)):
        cells = [np.array([z, v]) * rms for z in grid for v in grid]
        cost_of_start = _start_costs(model, theta, place, std)
        for seconds, n_kept in known.start_rounds:
            costs = [cost_of_start(cell, seconds) for cell in cells]
            cells = [cells[k] for k in np.argsort(costs, kind="stable")[:n_kept]]
        found[model.places_of_run(place)[0]] = cells[0]
    return found


def _start_costs(
    model: Model, theta: FloatArray, place: int, cell_std: FloatArray
) -> Callable[[FloatArray, float], float]:
    """What the first seconds of a run speak against a start: a function of the start and the seconds."""
    run, (below, above) = model.runs[place], model.corrected(theta, place)
    accelerance = model.mobility(theta, place).accelerance
    try:
        slots = model.resting_interfaces(theta, place)
    except UnboundedResponseError:
        return lambda cell, seconds: np.inf
    noise, (usual, covariance) = model.noise_in(theta, run), state_at_start(model, theta, place)
    np.fill_diagonal(covariance[:2, :2], cell_std**2)

    def cost(cell: FloatArray, seconds: float) -> float:
        n, start = min(run.n_samples, round(seconds * run.fs)), usual.copy()
        start[:2, 0] = cell
        try:
            begun = predict(
                slots,
                accelerance,
                below.value[: 2 * n - 1],
                above.value[:n],
                fs=run.fs,
                noise=noise,
                start=start,
                start_covariance=covariance,
                ground=model.ground,
                sensitivity=False,
            )
        except UnboundedResponseError:
            return np.inf
        return float(np.sum(begun.innovation**2) + 2 * np.sum(np.log(begun.spread)))

    return cost
