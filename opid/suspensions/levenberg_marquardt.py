"""Nonlinear least squares in as few evaluations as possible (Levenberg 1944, Marquardt 1963)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from opid.signals.recording import FloatArray


class Residual(Protocol):
    """Errors, (n,), and their derivatives, (n, n_unknowns)."""

    @property
    def stacked(self) -> FloatArray:
        """(n,) errors."""

    @property
    def jacobian(self) -> FloatArray:
        """(n, n_unknowns) derivatives."""


def least_squares(
    evaluate: Callable[[FloatArray], Residual | None],
    theta: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    caps: FloatArray,
    *,
    free: slice = slice(None),
    most_evaluations: int,
    least_promise: float,
    first_damping: float,
    least_damping: float,
    first: Callable[[FloatArray], Residual] | None = None,
) -> tuple[FloatArray, int]:
    """Return the vector of least squared error near `theta` and the evaluations spent.

    The last step is taken on its promise, without a look.

    Args:
        evaluate: errors at a vector; None where there are none.
        theta: (n_unknowns,) where to start.
        lower: (n_unknowns,) bounds.
        upper: (n_unknowns,) bounds.
        caps: (n_unknowns,) how far each entry may move in a step.
        free: the entries that may move.
        most_evaluations: at the most.
        least_promise: the search ends when the next step promises less of the squared error over its variance.
        first_damping: of the step after one that failed, over the squared size of each column.
        least_damping: a smaller one is none.
        first: takes the place of `evaluate` at the start, and may raise.
    """
    lower, upper, caps = lower[free], upper[free], caps[free]
    best = theta.copy()
    best[free] = np.clip(best[free], lower, upper)
    errors = (first or evaluate)(best)
    if errors is None:
        return best, 1
    cost, damping, n_data, failed = _cost(errors), 0.0, errors.stacked.size, False
    for spent in range(1, most_evaluations):
        step, promise = _step(errors, free, damping, best[free], lower, upper, caps)
        trial = best.copy()
        trial[free] = np.clip(best[free] + step, lower, upper)
        if promise * n_data < least_promise * cost:
            return trial, spent
        new = evaluate(trial)
        if new is not None and _cost(new) < cost:
            # where a longer step has just failed the next may as well
            eased = damping if failed else damping / 10 if damping > least_damping else 0.0
            best, errors, cost, damping, failed = trial, new, _cost(new), eased, False
        else:
            damping, failed = max(10 * damping, first_damping), True
    return best, most_evaluations


def _cost(errors: Residual) -> float:
    return float(errors.stacked @ errors.stacked)


def _step(
    errors: Residual,
    free: slice,
    damping: float,
    at: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    caps: FloatArray,
) -> tuple[FloatArray, float]:
    """Return the next step of the free entries and how far the linear model says it lowers the squared error."""
    jacobian, residual = errors.jacobian[:, free], errors.stacked
    gradient = jacobian.T @ residual
    # an entry at its bound that would go beyond stays there
    moving = ~(((at <= lower) & (gradient > 0)) | ((at >= upper) & (gradient < 0)))
    columns = jacobian[:, moving]
    size = np.maximum(np.sqrt(np.sum(columns**2, axis=0)), 1e-300)
    scaled = columns / size
    if damping:
        scaled = np.concatenate([scaled, np.sqrt(damping) * np.eye(size.size)])
        residual = np.concatenate([residual, np.zeros(size.size)])
    step = np.zeros(at.size)
    step[moving] = -np.linalg.lstsq(scaled, residual, rcond=1e-12)[0] / size
    step /= max(1.0, float(np.max(np.abs(step) / caps)))
    ahead = errors.stacked + jacobian @ step
    return step, _cost(errors) - float(ahead @ ahead)
