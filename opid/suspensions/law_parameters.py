"""The parameters of a law as an optimiser moves them: positive ones as logarithms, scales kept where they are seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from opid.mechanics.laws import Law
from opid.signals.recording import FloatArray

# a scale below this share of the rms motion is a step, one above that multiple a straight line
SMALLEST_SCALE, LARGEST_SCALE = 0.01, 3.0


def positive(law: Law) -> NDArray[np.bool_]:
    """Return which entries of `law.vector` are positive by their role.

    Args:
        law: any law.
    """
    return np.array([parameter.role in ("scale", "exponent") for parameter in law.parameter_list], dtype=bool)


def to_free(law: Law) -> FloatArray:
    """Return `law.vector` with the logarithms of its positive entries.

    Args:
        law: any law.
    """
    is_positive = positive(law)
    return np.where(is_positive, np.log(np.where(is_positive, law.vector, 1.0)), law.vector)


def from_free(law: Law, free: FloatArray) -> tuple[Law, FloatArray]:
    """Return the law of the same terms with these free values, and the derivatives of its vector by them.

    Args:
        law: says which terms.
        free: (n_parameters,) as of `to_free`.

    >>> from opid.mechanics.laws import default_law
    >>> law = default_law("arctan_velocity")
    >>> from_free(law, to_free(law))[0].vector.round(6).tolist(), from_free(law, to_free(law))[1].round(6).tolist()
    ([400.0, 0.02], [1.0, 0.02])
    """
    is_positive = positive(law)
    # a runaway scale is a straight line or a step: kept finite, reported as indistinguishable
    vector = np.where(is_positive, np.exp(np.clip(np.where(is_positive, free, 0.0), -60, 60)), free)
    return law.with_vector(vector), np.where(is_positive, vector, 1.0)


def free_bounds(law: Law, *, travel_rms: float, velocity_rms: float) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper bounds of `to_free`, (n_parameters,) each, infinite but for scales.

    Args:
        law: any law.
        travel_rms: rms of z, m.
        velocity_rms: rms of z', m/s.
    """
    lower = np.full(law.vector.size, -np.inf)
    upper = -lower
    for i, parameter in enumerate(law.parameter_list):
        if parameter.role == "scale":
            rms = max(velocity_rms if parameter.unit == "m/s" else travel_rms, 1e-12)
            lower[i], upper[i] = np.log(SMALLEST_SCALE * rms), np.log(LARGEST_SCALE * rms)
    return lower, upper
