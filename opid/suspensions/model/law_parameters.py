"""The parameters of a law in the form for an optimiser: positive ones as logarithms, scales within visible bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from opid.mechanics.laws.kinds import Kind, Parameter
from opid.mechanics.laws.law import LAWS, Law, Term
from opid.signals.recording import FloatArray
from opid.suspensions.settings import SearchSettings


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
        law: a law with the same terms.
        free: (n_parameters,) values as returned by `to_free`.

    >>> from opid.mechanics.laws.law import default_law
    >>> law = default_law("arctan_velocity")
    >>> from_free(law, to_free(law))[0].vector.round(6).tolist(), from_free(law, to_free(law))[1].round(6).tolist()
    ([400.0, 0.02], [1.0, 0.02])
    """
    is_positive = positive(law)
    # A scale that runs away gives a straight line or a step: it is kept finite and reported as indistinguishable.
    vector = np.where(is_positive, np.exp(np.clip(np.where(is_positive, free, 0.0), -60, 60)), free)
    return law.with_vector(vector), np.where(is_positive, vector, 1.0)


def free_bounds(
    law: Law, *, travel_rms: float, velocity_rms: float, rests_apart_m: float = 0.0, slide_beyond: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper bounds of `to_free`, (n_parameters,) each, infinite except for scales and exponents.

    Args:
        law: any law.
        travel_rms: rms of z, m.
        velocity_rms: rms of z', m/s.
        rests_apart_m: distance between the rest positions of the runs, m: springs are visited there, too. Scales of
            stops, gas and terms with memory depend on the motion only.
        slide_beyond: the travel after which a friction with memory slides may be this many times the longest one that
            can be seen.
    """
    lower = np.full(law.vector.size, -np.inf)
    upper = -lower
    kinds = [term.kind for term in law.terms for _ in term.values]
    for i, (kind, parameter) in enumerate(zip(kinds, law.parameter_list, strict=True)):
        if parameter.role == "scale":
            by_motion = kind.is_stop or kind.quasi_static or kind.memory is not None
            visited_m = travel_rms if by_motion else float(np.hypot(travel_rms, rests_apart_m))
            rms = reference(parameter, visited_m, velocity_rms)
            lower[i], upper[i] = np.log(np.multiply(parameter.over_rms, rms))
            upper[i] += np.log(slide_beyond) * (kind.slides and parameter.unit == "m")
        elif parameter.role == "exponent":
            with np.errstate(divide="ignore"):
                lower[i], upper[i] = np.log(parameter.within)
    return lower, upper


def reference(parameter: Parameter, travel_rms: float, velocity_rms: float) -> float:
    """Return the rms motion that an inner parameter is compared with: travel, velocity, or their ratio."""
    travel, velocity = max(travel_rms, 1e-12), max(velocity_rms, 1e-12)
    return {"m/s": velocity, "s": travel / velocity}.get(parameter.unit, travel)


def has_slope(kind: Kind) -> bool:
    """Return whether a kind has one unknown positive inner parameter, so that columns have a slope by its logarithm.

    Further inner parameters may follow if they are known approximately beforehand.

    Args:
        kind: any kind.

    >>> [has_slope(LAWS[name]) for name in ("arctan_velocity", "signed_power_damping", "arctan_mixed", "cubic_damping")]
    [True, True, False, False]
    """
    first, *others = (*kind.parameters[1:], None)
    is_positive = first is not None and first.role in ("scale", "exponent")
    return is_positive and all(other is None or other.known for other in others)


def faint_terms(
    kind: str,
    travel: FloatArray,
    velocity: FloatArray,
    *,
    travel_rms: float,
    velocity_rms: float,
    noise: float,
    settings: SearchSettings,
    rest_m: float = 0.0,
) -> list[Term]:
    """Return the terms of `list_terms` with amplitudes too weak to change the motion, without stops beyond the travel.

    Args:
        kind: name in `opid.laws.LAWS`.
        travel: (n,) z, m.
        velocity: (n,) z', m/s.
        travel_rms: rms travel that the scales are based on, m.
        velocity_rms: rms velocity that the scales are based on, m/s.
        noise: noise beside which the force is small, m/s^2.
        settings: settings of the search.
        rest_m: position on the terms from which the travel is measured, m.
    """
    found = []
    for term in list_terms(
        kind,
        travel_rms=travel_rms,
        velocity_rms=velocity_rms,
        n_scales=settings.n_scales,
        fractions=settings.scale_fractions,
        lags=settings.lags,
    ):
        every = 1 if term.kind.is_stop else settings.every_sample
        force = Law((term,), rest_m).force(travel[::every], velocity[::every])
        if term.kind.is_stop and not force.any():
            continue
        amplitude = settings.faint * noise / max(float(np.sqrt(np.mean(force**2))), 1e-300)
        found.append(Term(kind, (amplitude, *term.inner)))
    return found


def pulls_at_a_stop(law: Law) -> bool:
    """Return whether a stop of a law pulls instead of pushing: something else yields there, and it is no stop.

    Args:
        law: any law.
    """
    return any(term.kind.is_stop and term.amplitude < 0.0 for term in law.terms)


def describe_unreached_stop(distance_m: float) -> str:
    """Return the message about a stop that was not reached, a sentence that begins with the name of the stop.

    Args:
        distance_m: how far the motion went towards it, m.
    """
    return (
        f"was not reached, because the motion went only {1e3 * distance_m:.3g} mm towards it: its gap and its "
        "stiffness are withheld; leave it out, or record a motion that reaches it"
    )


def distance_to_stop(term: Term, travel: FloatArray) -> float:
    """Return how far a motion goes towards a stop, m.

    Args:
        term: the stop.
        travel: (n,) travel from the origin of the law, m.
    """
    is_compressed = float(term.evaluate(np.array(-1e3 * term.inner[0]), np.array(0.0))[1]) > 0.0
    return float(np.max(-travel if is_compressed else travel))


def list_terms(
    kind: str,
    *,
    travel_rms: float,
    velocity_rms: float,
    n_scales: int,
    fractions: tuple[float, float] = SearchSettings.scale_fractions,
    lags: Sequence[float] = SearchSettings.lags,
    exponents: Sequence[float] = (),
) -> list[Term]:
    """Return terms of unit amplitude of a kind, with inner parameters over the range in which this motion shows them.

    Args:
        kind: name in `opid.laws.LAWS`.
        travel_rms: rms of z, m.
        velocity_rms: rms of z', m/s.
        n_scales: number of scales, in logarithmic steps.
        fractions: fractions of that range, in its logarithm, between which the scales lie.
        lags: lags, over the ratio of the rms motions.
        exponents: exponents; that of the default law if there are none.

    >>> [term.inner for term in list_terms("cubic_stiffness", travel_rms=1e-3, velocity_rms=1e-2, n_scales=3)]
    [()]
    """
    inner = LAWS[kind].parameters[1:]
    roles, offered = {parameter.role for parameter in inner}, []
    # A parameter that is known beforehand begins at its known value.
    is_power = any(parameter.role == "exponent" and not parameter.known for parameter in inner)
    for lag in travel_rms / velocity_rms * np.array(lags) if "lag" in roles else np.zeros(1):
        for fraction in np.linspace(*fractions, n_scales) if "scale" in roles else np.zeros(1):
            for exponent in exponents if is_power and exponents else (None,):
                values = []
                for parameter in inner:
                    rms = reference(parameter, float(np.hypot(travel_rms, lag * velocity_rms)), velocity_rms)
                    low, high = np.log(np.multiply(parameter.over_rms, rms))
                    given = {"scale": float(np.exp(low + fraction * (high - low))), "lag": float(lag)}
                    given |= {} if exponent is None else {"exponent": exponent}
                    values.append(given.get(parameter.role, parameter.default))
                offered.append(Term(kind, (1.0, *values)))
    return offered
