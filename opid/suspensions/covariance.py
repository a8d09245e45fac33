"""The covariance of a least-squares estimate whose residual is not white."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from opid.signals.recording import FloatArray


def clustered_covariance(jacobian: FloatArray, residual: FloatArray, cells: NDArray[np.int64]) -> FloatArray:
    """Return the sandwich covariance with scores added up over cells (Liang & Zeger 1986, small-sample factor).

    Within a cell (a stretch of time, a few neighbouring lines) residuals may be correlated as they like.

    Args:
        jacobian: (n_data, n_parameters).
        residual: (n_data,).
        cells: (n_data,) the cell of each residual.

    >>> rng = np.random.default_rng(0)
    >>> covariance = clustered_covariance(np.ones((4000, 1)), rng.standard_normal(4000), np.arange(4000) // 4)
    >>> round(float(4000 * covariance[0, 0]), 1)
    1.0
    """
    scale = np.sqrt(np.sum(jacobian**2, axis=0))
    # what moves nothing is left as it is
    scale = np.where(scale > 0.0, scale, 1.0)
    scaled = jacobian / scale
    # of the columns, not of their products: what is told a million times less well is told all the same
    root = np.linalg.pinv(np.linalg.qr(scaled)[1], rcond=1e-13)
    inverse = root @ root.T
    factor, products = score_products(scaled, residual, cells)
    return factor * inverse @ products @ inverse / np.outer(scale, scale)


def score_products(jacobian: FloatArray, residual: FloatArray, cells: NDArray[np.int64]) -> tuple[float, FloatArray]:
    """Return the small-sample factor and the products of the scores added up over cells: the inside of the sandwich.

    Args:
        jacobian: (n_data, n_parameters).
        residual: (n_data,).
        cells: (n_data,) the cell of each residual.

    >>> score_products(np.ones((4, 1)), np.array([1.0, 1.0, 1.0, -1.0]), np.array([0, 0, 1, 1]))
    (2.0, array([[4.]]))
    """
    _, place = np.unique(cells, return_inverse=True)
    n_cells, n_parameters = int(place.max()) + 1, jacobian.shape[1]
    scores = np.zeros((n_cells, n_parameters))
    np.add.at(scores, place, jacobian * residual[:, np.newaxis])
    return n_cells / max(n_cells - n_parameters, 1), scores.T @ scores
