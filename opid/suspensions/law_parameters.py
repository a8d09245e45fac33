"""The parameters of a law as an optimiser moves them: positive ones as logarithms, scales kept where they are seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from opid.mechanics.laws import LAWS, Law, Term
from opid.signals.recording import FloatArray


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
            lower[i], upper[i] = np.log(np.multiply(parameter.over_rms, rms))
    return lower, upper


def offered_terms(kind: str, *, travel_rms: float, velocity_rms: float, n_scales: int) -> list[Term]:
    """Return terms of unit amplitude of a kind, its inner parameters over the range in which this motion shows them.

    Args:
        kind: name in `opid.mechanics.laws.LAWS`.
        travel_rms: rms of z, m.
        velocity_rms: rms of z', m/s.
        n_scales: scales that are offered, evenly in their logarithm.

    >>> [term.inner for term in offered_terms("cubic_stiffness", travel_rms=1e-3, velocity_rms=1e-2, n_scales=3)]
    [()]
    """
    inner = LAWS[kind].parameters[1:]
    has_lag = any(parameter.role == "lag" for parameter in inner)
    lags = travel_rms / velocity_rms * np.array([0.3, 1.0, 3.0]) if has_lag else np.zeros(1)
    fractions = np.linspace(0.4, 0.98, n_scales) if any(p.role == "scale" for p in inner) else np.zeros(1)
    offered = []
    for lag in lags:
        for fraction in fractions:
            values = []
            for parameter in inner:
                rms = velocity_rms if parameter.unit == "m/s" else float(np.hypot(travel_rms, lag * velocity_rms))
                low, high = np.log(np.multiply(parameter.over_rms, rms))
                scale = float(np.exp(low + fraction * (high - low)))
                values.append({"scale": scale, "lag": float(lag)}.get(parameter.role, parameter.default))
            offered.append(Term(kind, (1.0, *values)))
    return offered
