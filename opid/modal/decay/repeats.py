"""Repeats of a measurement with scatter between them: a hierarchical mean (random effects)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from opid.signals.recording import FloatArray


@dataclass(frozen=True, eq=False)
class Pooled:
    """The mean of several repeats.

    Args:
        vector: (p,) the mean.
        covariance: (p, p) its covariance.
        scatter: (p,) standard deviation between repeats; 0 for coefficients that do not scatter.
        misfit: rms difference of the repeats over what their covariances and the scatter explain, by which the
            covariance has grown where it is more than 1.
    """

    vector: FloatArray
    covariance: FloatArray
    scatter: FloatArray
    misfit: float


def pool_repeats(vectors: Sequence[FloatArray], covariances: Sequence[FloatArray], scattering: Sequence[int]) -> Pooled:
    """Return the mean of repeats whose coefficients `scattering` differ from one to the next.

    The repeat i is normal about the mean with the covariance S_i + diag(tau^2). The restricted likelihood gives tau
    (Patterson and Thompson 1971, Biometrika 58, 545). Where the repeats differ more than S_i and tau explain, the
    covariance grows by that ratio.

    Args:
        vectors: (p,) the coefficients of each repeat.
        covariances: (p, p) the covariance of each.
        scattering: indices of the coefficients that scatter.

    >>> pooled = pool_repeats([np.array([x]) for x in (1.0, 2.0, 3.0)], [np.array([[1e-6]])] * 3, [0])
    >>> round(float(pooled.vector[0]), 3), round(float(pooled.scatter[0]), 2)
    (2.0, 1.0)
    """
    from scipy.optimize import minimize

    many = np.array(vectors)
    size = np.sqrt(np.mean([np.diag(each) for each in covariances], axis=0)) + 1e-300
    scaled, spreads = many / size, [each / np.outer(size, size) for each in covariances]
    own = np.maximum(np.std(scaled[:, scattering], axis=0, ddof=1), 1e-3)

    def find_mean(tau: FloatArray) -> tuple[FloatArray, FloatArray, float, float]:
        between = np.zeros(many.shape[1])
        between[list(scattering)] = tau**2
        weights = [np.linalg.inv(each + np.diag(between)) for each in spreads]
        inverse = np.linalg.inv(np.sum(weights, axis=0))
        mean = inverse @ np.sum([weight @ each for weight, each in zip(weights, scaled, strict=True)], axis=0)
        squares = float(sum((each - mean) @ w @ (each - mean) for w, each in zip(weights, scaled, strict=True)))
        logs = -sum(float(np.linalg.slogdet(weight)[1]) for weight in weights)
        return mean, inverse, squares, logs - float(np.linalg.slogdet(inverse)[1])

    def lack(log_tau: FloatArray) -> float:
        _, _, squares, logs = find_mean(np.exp(log_tau))
        return squares + logs

    bounds = [(np.log(1e-3), float(np.log(10.0 * each + 1.0))) for each in own]
    best = minimize(lack, np.log(own), method="L-BFGS-B", bounds=bounds)
    tau = np.exp(best.x)
    mean, covariance, squares, _ = find_mean(tau)
    dof = (len(vectors) - 1) * many.shape[1]
    scatter = np.zeros(many.shape[1])
    scatter[list(scattering)] = tau
    ratio = squares / dof
    grown = max(ratio, 1.0) * covariance * np.outer(size, size)
    return Pooled(mean * size, grown, scatter * size, float(np.sqrt(ratio)))
