"""Laws whose origin is not where a suspension rests: a spring about its unloaded length is one.

What a fit found stands for a force over the travel, whatever its terms are called. Other terms about another origin
that make nearly the same force are fitted from there: the origin is then one more unknown.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from opid.mechanics.driven import Interface
from opid.mechanics.laws import LINEAR, Law, Term
from opid.mechanics.weight import depends_on_travel, find_rest
from opid.signals.recording import FloatArray
from opid.suspensions.fit import NO_FIT, Fit, refit
from opid.suspensions.law_parameters import offered_terms
from opid.suspensions.law_search import LawStep
from opid.suspensions.settings import OriginSettings
from opid.suspensions.unknowns import Group


def search_origins(fit: Fit, kinds: Sequence[str], *, least_promise: float | None = None) -> list[LawStep[Fit]]:
    """Return fits of laws about another origin that make nearly the force of a fit; none is kept yet.

    Args:
        fit: with laws of the travel, about wherever they rest.
        kinds: that may take their place.
        least_promise: of `fit_model`.
    """
    settings, steps = fit.model.settings.origin, list[LawStep[Fit]]()
    if not any(map(depends_on_travel, fit.laws.values())):
        return []
    try:
        travel = static_travel(fit)
    except NO_FIT:
        # springs that would not carry the body
        return []
    if travel is None:
        return []
    ranked: dict[str, list[Law]] = {}
    for group in fit.model.groups:
        if depends_on_travel(fit.laws[group.name]):
            ranked[group.name] = _imitations(fit, group, float(np.mean(travel[list(group.slots)])), kinds, settings)
    for place in range(min(settings.n_fitted, max(map(len, ranked.values()), default=0))):
        laws = {name: row[min(place, len(row) - 1)] for name, row in ranked.items() if row}
        if all(law == fit.laws[name] for name, law in laws.items()):
            continue
        again = refit(fit, laws, least_promise=least_promise)
        steps += [] if again is None else [LawStep(again, False, "origin")]
    return steps


def static_travel(fit: Fit) -> FloatArray | None:
    """Return how far straight springs of the tangent stiffness would give way under the body, (n_slots,) m.

    Args:
        fit: of any laws.

    Returns:
        Travel at rest, from the unloaded length; None where no weight acts.

    Raises:
        UnboundedResponseError: springs that cannot carry it.
    """
    model, body = fit.model, fit.model.body
    if body.fall is None:
        return None
    factors = fit.theta[model.first_factor :][: len(body.names)]
    mass = body.mass(factors, model.inverse_mass(fit.theta), np.zeros_like(body.unit))
    slots = [
        Interface(slot.stiffness + float(slot.law.gradient(0.0, 0.0)[0]), 0.0)
        for slot in model.interfaces(fit.theta)[0]
    ]
    return find_rest(slots, body.rows, mass @ body.fall).travel


def _imitations(fit: Fit, group: Group, distance_m: float, kinds: Sequence[str], settings: OriginSettings) -> list[Law]:
    """Laws of one kind of spring about another origin, those nearest to the fitted force first.

    Of two that are as near, the one is taken whose force about its origin balances the weight.
    """
    first, law = fit.model.first_of_group[fit.model.groups.index(group)], fit.laws[group.name]
    stiffness = float(fit.theta[first])
    travel = np.concatenate([fit.motion(slot)[0] for slot in group.slots])
    z = np.quantile(travel, np.linspace(0.001, 0.999, settings.n_travels))
    straight = np.stack([np.ones_like(z), z], axis=1)
    force = stiffness * z + law.force(z, 0.0)
    weight = distance_m * (stiffness + float(law.gradient(0.0, 0.0)[0]))
    bent = _without(straight, force)
    kept = tuple(term for term in law.terms if not depends_on_travel(Law((term,))))
    found: dict[tuple[str, bool], tuple[float, float, Law]] = {}

    def imitate(fraction: float, term: Term) -> None:
        """Keep the law of a term whose origin lies this fraction of the distance away, where none before is nearer."""
        rest_m = distance_m * fraction
        spring = Law((term,), rest_m)
        whole = spring.force(z, 0.0)
        shape = _without(straight, whole)
        size = float(shape @ shape)
        if size <= settings.least_bend**2 * float(whole @ whole):
            return
        amplitude = float(shape @ bent) / size
        # about where it rests a law says nothing of the weight
        beside = np.linalg.lstsq(straight, force - amplitude * whole, rcond=None)[0][1]
        carried = beside * rest_m + amplitude * float(Law((term,)).force(rest_m, 0.0))
        missing = (carried - weight) / (settings.balance_std * weight) if rest_m else 0.0
        cost, key = float(np.sum((bent - amplitude * shape) ** 2)) * (1 + missing**2), (term.name, bool(rest_m))
        if cost < found.get(key, (np.inf, 0.0, LINEAR))[0]:
            found[key] = cost, fraction, Law((*kept, Term(term.name, (amplitude, *term.inner))), rest_m)

    for fraction in (0.0, *settings.distances):
        for term in _springs(kinds, float(np.hypot(travel.std(), distance_m * fraction)), settings.n_scales):
            imitate(fraction, term)
    for (name, is_away), (_, best, law) in list(found.items()):
        if is_away:
            (near,) = (term for term in law.terms if term.name == name)
            for factor in np.geomspace(1 / settings.finer_reach, settings.finer_reach, settings.n_finer):
                imitate(best * float(factor), Term(name, (1.0, *near.inner)))
    return [each for _, _, each in sorted(found.values(), key=lambda entry: entry[0])]


def _without(columns: FloatArray, values: FloatArray) -> FloatArray:
    """What columns do not make of some values."""
    return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0])


def _springs(kinds: Sequence[str], travel_rms: float, n_scales: int) -> Iterator[Term]:
    """Terms of unit amplitude that depend on the travel and have no origin of their own."""
    for kind in kinds:
        for term in offered_terms(kind, travel_rms=travel_rms, velocity_rms=1.0, n_scales=n_scales):
            is_spring = not any(parameter.role == "lag" for parameter in term.kind.parameters)
            if is_spring and not term.kind.is_about_rest and depends_on_travel(Law((term,))):
                yield term
