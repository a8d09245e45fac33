"""The parameters of a law as an optimiser moves them: positive ones as logarithms, scales kept where they are seen."""

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
        law: says which terms.
        free: (n_parameters,) as of `to_free`.

    >>> from opid.mechanics.laws.law import default_law
    >>> law = default_law("arctan_velocity")
    >>> from_free(law, to_free(law))[0].vector.round(6).tolist(), from_free(law, to_free(law))[1].round(6).tolist()
    ([400.0, 0.02], [1.0, 0.02])
    """
    is_positive = positive(law)
    # a runaway scale is a straight line or a step: kept finite, reported as indistinguishable
    vector = np.where(is_positive, np.exp(np.clip(np.where(is_positive, free, 0.0), -60, 60)), free)
    return law.with_vector(vector), np.where(is_positive, vector, 1.0)


def free_bounds(
    law: Law, *, travel_rms: float, velocity_rms: float, rests_apart_m: float = 0.0, slide_beyond: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper bounds of `to_free`, (n_parameters,) each, infinite but for scales and exponents.

    Args:
        law: any law.
        travel_rms: rms of z, m.
        velocity_rms: rms of z', m/s.
        rests_apart_m: how far runs rest from each other: springs are visited there, too. Stops, gas and what remembers
            tell their scale by the motion.
        slide_beyond: the travel after which a friction that remembers slides may be this many times the longest that
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
    """Return the rms motion that an inner parameter is compared with: of travel, of velocity, or their ratio."""
    travel, velocity = max(travel_rms, 1e-12), max(velocity_rms, 1e-12)
    return {"m/s": velocity, "s": travel / velocity}.get(parameter.unit, travel)


def has_slope(kind: Kind) -> bool:
    """Return whether a kind has one positive inner parameter to be found: its columns are moved along its logarithm.

    Others may follow that are known roughly beforehand.

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
    """Return the terms of `offered_terms` with amplitudes too weak to move anything, without stops beyond the travel.

    Args:
        kind: name in `opid.laws.LAWS`.
        travel: (n,) z, m.
        velocity: (n,) z', m/s.
        travel_rms: over which scales are laid out, m.
        velocity_rms: the same of the velocity, m/s.
        noise: what the force is faint beside, m/s^2.
        settings: of the search.
        rest_m: from where on the terms the travel is measured, m.
    """
    found = []
    for term in offered_terms(
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
    """Return whether a stop of a law pulls where it should push: something else gives way, and no stop is there.

    Args:
        law: any law.
    """
    return any(term.kind.is_stop and term.amplitude < 0.0 for term in law.terms)


def not_reached(way_m: float) -> str:
    """Return what is said of a stop that was not reached, the sentence that begins with its name.

    Args:
        way_m: how far the motion went towards it, m.
    """
    return (
        f"was not reached, for the motion went only {1e3 * way_m:.3g} mm towards it: its gap and its stiffness are "
        "withheld; leave it out, or record a motion that runs into it"
    )


def way_to_stop(term: Term, travel: FloatArray) -> float:
    """Return how far a motion goes towards a stop, m.

    Args:
        term: the stop.
        travel: (n,) from the origin of the law, m.
    """
    is_compressed = float(term.evaluate(np.array(-1e3 * term.inner[0]), np.array(0.0))[1]) > 0.0
    return float(np.max(-travel if is_compressed else travel))


def offered_terms(
    kind: str,
    *,
    travel_rms: float,
    velocity_rms: float,
    n_scales: int,
    fractions: tuple[float, float] = SearchSettings.scale_fractions,
    lags: Sequence[float] = SearchSettings.lags,
    exponents: Sequence[float] = (),
) -> list[Term]:
    """Return terms of unit amplitude of a kind, its inner parameters over the range in which this motion shows them.

    Args:
        kind: name in `opid.laws.LAWS`.
        travel_rms: rms of z, m.
        velocity_rms: rms of z', m/s.
        n_scales: scales that are offered, evenly in their logarithm.
        fractions: between which of that range the scales lie, in its logarithm.
        lags: that are offered, over the ratio of the rms motions.
        exponents: that are offered; that of the default law where there are none.

    >>> [term.inner for term in offered_terms("cubic_stiffness", travel_rms=1e-3, velocity_rms=1e-2, n_scales=3)]
    [()]
    """
    inner = LAWS[kind].parameters[1:]
    roles, offered = {parameter.role for parameter in inner}, []
    # what is known beforehand is begun with
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
