"""The search problem for laws of a driven model: candidates beside a fit, fits of other laws, runs that are left out.

Different terms can describe nearly the same force over the travel. The origin of a spring about its unloaded length is
not where the suspension rests: terms about another origin that make nearly the same force are also fitted, with the
origin as one more unknown.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from opid.mechanics.driven import Interface, UnboundedResponseError
from opid.mechanics.laws.law import LAWS, LINEAR, Law, Term
from opid.mechanics.repeatability import part_of
from opid.mechanics.weight import depends_on_travel, find_rest
from opid.signals.recording import FloatArray
from opid.suspensions.fitting.fit import (
    NO_FIT,
    Fit,
    is_same_minimum,
    law_key,
    left_out_ratio,
    make_carrying_column,
    refit,
)
from opid.suspensions.fitting.noise import is_noise, measure_whiteness
from opid.suspensions.law_search.dictionary import LawDictionary, Node, make_dictionary
from opid.suspensions.law_search.pursuit import LawStep
from opid.suspensions.model.law_parameters import faint_terms, has_slope, list_terms, pulls_at_a_stop
from opid.suspensions.model.unknowns import Group
from opid.suspensions.settings import OriginSettings, SearchSettings


@dataclass(frozen=True, eq=False)
class _Answers:
    """Stored answers about the laws near a fit, because several attempts lead to the same fit.

    Args:
        fit: a fitted model.
        dictionaries: the dictionaries, by the kinds that a law may have.
        refits: fits of other laws, by the key of the laws of all groups, see `law_key`.
    """

    fit: Fit
    dictionaries: dict[tuple[str, ...], dict[str, LawDictionary]] = field(default_factory=dict)
    refits: dict[tuple[tuple[str, bool], ...], Fit | None] = field(default_factory=dict)


@dataclass(frozen=True)
class DrivenLaws:
    """A `LawProblem` of fits of a driven model.

    Args:
        settings: settings of the search.
        least_promise: as in `fit_model`; None for the value of the settings.
        asked: stored answers, which are not simulated or fitted again.
    """

    settings: SearchSettings
    least_promise: float | None = None
    asked: list[_Answers] = field(default_factory=list, compare=False)

    def _find_answers(self, fit: Fit, *, of_one_model: bool) -> _Answers:
        """Return the stored answers at the minimum of a fit; with `of_one_model` only those of the same model."""
        for each in reversed(self.asked):
            if is_same_minimum(fit, each.fit) and (not of_one_model or _is_of_one_model(fit, each.fit)):
                return each
        self.asked.append(_Answers(fit))
        return self.asked[-1]

    def dictionaries(self, fit: Fit, kinds: Sequence[str]) -> dict[str, LawDictionary]:
        """Return the candidates beside a fit, all of them simulated at once."""
        known, kinds = self._find_answers(fit, of_one_model=False).dictionaries, tuple(kinds)
        if kinds not in known:
            known[kinds] = self._build_dictionaries(fit, kinds)
        return known[kinds]

    def rank_as(self, fit: Fit, other: Fit) -> None:
        """Rank the candidates beside a fit as they were ranked with fewer samples of the same runs.

        They are not simulated again: the squared error and its reductions grow in proportion to the number of samples.

        Args:
            fit: the fit with all samples.
            other: the fit of the same laws with fewer samples.
        """
        if fit.model.runs is other.model.runs:
            return
        more = sum(run.n_samples for run in fit.model.runs) / sum(run.n_samples for run in other.model.runs)
        for kinds, known in self._find_answers(other, of_one_model=False).dictionaries.items():
            scaled = {group: replace(each, n_data=round(more * each.n_data)) for group, each in known.items()}
            self._find_answers(fit, of_one_model=False).dictionaries.setdefault(kinds, scaled)

    def _build_dictionaries(self, fit: Fit, kinds: Sequence[str]) -> dict[str, LawDictionary]:
        model, offered = fit.model, {}
        for number, (group, law) in enumerate(zip(model.groups, fit.laws.values(), strict=True)):
            new = [kind for kind in kinds if kind not in law.parameters]
            if group.has_origin:
                new = [kind for kind in new if not LAWS[kind].is_about_rest]
            elif model.is_carried:
                # A column of gas carries the known weight and replaces all springs, see `_list_carriers`.
                new = [kind for kind in new if not LAWS[kind].quasi_static]
            offered[number] = [term for kind in new for term in self._list_faint_terms(kind, fit, group, law.rest_m)]
        try:
            errors = model.evaluate(fit.theta, candidates=offered)
        except UnboundedResponseError:
            # The model is too near its bounds to be simulated with candidates.
            return {}
        no_prior = np.zeros((errors.stacked.size - fit.n_data, errors.candidates.shape[1]))
        columns, index, found = np.concatenate([errors.candidates, no_prior]), 0, {}
        for number, (name, law) in enumerate(fit.laws.items()):
            nodes: dict[str, list[Node]] = {}
            for term in offered[number]:
                nodes.setdefault(term.name, []).append(_build_node(term, columns[:, index : index + len(term.values)]))
                index += len(term.values)
            own = np.arange(errors.jacobian.shape[1])[model.law_indices(number)]
            by_law, others = errors.jacobian[:, own], np.delete(errors.jacobian, own, axis=1)
            dictionary = make_dictionary(law, errors.stacked, by_law, others, nodes, self.settings)
            found[name] = replace(dictionary, further=tuple(_list_carriers(fit, number, law, kinds)))
        if fit.ratio > fit.model.settings.verdicts.refused:
            # No law explains the residual of a wrong structure.
            expected = sum(each.largest_expected_gain() for each in found.values())
            return found if expected > self.settings.good_fraction else {}
        return found

    def refit(self, fit: Fit, laws: Mapping[str, Law]) -> Fit | None:
        """Fit other laws, beginning at a fit; None if they are impossible or cannot be fitted."""
        known = self._find_answers(fit, of_one_model=True).refits
        key = law_key({**fit.laws, **laws})
        if key not in known:
            found = refit(fit, dict(laws), least_promise=self.least_promise)
            known[key] = None if found is None or is_impossible(found) else found
        return known[key]

    def left_out(self, fit: Fit) -> float | None:
        """Return the rms error of each run in its prediction by a fit of the others, m/s^2."""
        ratio = left_out_ratio(fit)
        return None if ratio is None else fit.model.level * ratio

    def confirms(self, fit: Fit, than: Fit) -> bool:
        """Return True: fits without one run take as long as a search, so they are made once, after the search."""
        return True

    def _list_faint_terms(self, kind: str, fit: Fit, group: Group, rest_m: float) -> list[Term]:
        """Return terms that are too weak to change the motion."""
        attachments = group.members
        travel, velocity = (np.concatenate(part) for part in zip(*map(fit.motion, attachments), strict=True))
        # While a model is wrong, its slow travel may be far off; the measured travel is not.
        rms = np.sqrt(np.mean(fit.model.motion_rms[list(attachments)] ** 2, axis=0))
        rms *= self.settings.most_measured_rms
        return faint_terms(
            kind,
            travel,
            velocity,
            rest_m=rest_m,
            travel_rms=float(np.hypot(min(float(travel.std()), float(rms[0])), rest_m)),
            velocity_rms=min(float(velocity.std()), float(rms[1])),
            noise=fit.model.level,
            settings=self.settings,
        )


def _is_of_one_model(fit: Fit, other: Fit) -> bool:
    """Whether two fits of the same runs and parameters have the same noise and repeatability."""
    mine, theirs = fit.model, other.model
    return (
        all(np.array_equal(a, b) for a, b in zip(mine.noise, theirs.noise, strict=True))
        and (mine.most_noise, mine.louder, mine.repeatability, mine.mass_free)
        == (theirs.most_noise, theirs.louder, theirs.repeatability, theirs.mass_free)
        and mine.process is theirs.process
    )


def _list_carriers(fit: Fit, number: int, law: Law, kinds: Sequence[str]) -> Iterator[Law]:
    """Yield laws in which a column of gas of the same stiffness replaces all springs and carries the weight."""
    model = fit.model
    if not model.is_carried or any(term.kind.quasi_static for term in law.terms):
        return
    if is_noise(fit) and measure_whiteness(fit).white:
        # A fit of a column of gas takes long, and nothing is left to be explained.
        return
    springs = tuple(term for term in law.terms if part_of(term.kind) == "spring" and not term.kind.is_stop)
    travel, velocity = (
        np.concatenate(part) for part in zip(*map(fit.motion, model.groups[number].members), strict=True)
    )
    stiffness = float(fit.theta[model.first_of_group[number]])
    stiffness += float(np.mean(Law(springs, law.rest_m).gradient(travel, velocity)[0]))
    for kind in kinds:
        if LAWS[kind].quasi_static and stiffness > 0.0:
            column = make_carrying_column(kind, model.weight, stiffness)
            yield Law((column, *(term for term in law.terms if term not in springs)))


def _build_node(term: Term, columns: FloatArray) -> Node:
    # The slope is the derivative by the logarithm of the inner parameter, for unit amplitude.
    slope = columns[:, 1] * term.inner[0] / term.amplitude if has_slope(term.kind) else None
    return Node(Term(term.name, (1.0, *term.inner)), columns[:, 0], slope)


def is_impossible(fit: Fit) -> bool:
    """Return whether the laws of a fit are physically impossible.

    They feed energy in, pull at a stop, have no stable rest position, or have one that no run comes near.
    """
    no_strut = feeds_energy(fit) or any(map(pulls_at_a_stop, fit.laws.values())) or gives_way_at_rest(fit)
    return no_strut or is_far_from_rest(fit)


def is_far_from_rest(fit: Fit) -> bool:
    """Return whether a spring to the ground holds a suspension far from its rest position in all runs.

    Accelerometers do not measure the height of the ground. A law can therefore be about any travel, with other terms
    and another stiffness at rest: a cubic term about one travel is a cubic and a quadratic term about another.
    """
    farthest = fit.model.settings.search.farthest_mean_rms
    for group, law in zip(fit.model.groups, fit.laws.values(), strict=True):
        if group.ground and any(part_of(term.kind) == "spring" for term in law.terms):
            for attachment in group.members:
                travels = [each.travel[:, attachment] for each in fit.errors.predictions]
                if all(abs(travel.mean()) > farthest * travel.std() for travel in travels):
                    return True
    return False


def gives_way_at_rest(fit: Fit) -> bool:
    """Return whether the tangent stiffness of the suspensions at rest is negative, so that the rest is not stable.

    It is that of all suspensions at rest in the first run, compared with the mean over the motion of the runs: in a gap
    it may be near zero, with either sign. If the mean is negative, too, the noise exceeds the springs and the result is
    False.
    """
    at_rest, over_motion = 0.0, 0.0
    for attachment, each in enumerate(fit.model.resting_interfaces(fit.theta, 0)):
        travel, velocity = fit.motion(attachment)
        straight = each.stiffness + each.ground_stiffness
        at_rest += straight + float(each.law.gradient(0.0, 0.0)[0])
        over_motion += straight + float(np.mean(each.law.gradient(travel, velocity)[0]))
    return over_motion > 0.0 and at_rest < -fit.model.settings.search.rest_fraction * over_motion


def feeds_energy(fit: Fit) -> bool:
    """Return whether a damper beside a law with memory is negative: both compensate for a delay between sensors."""
    least_std = fit.model.settings.search.least_damping_std
    for group, first in zip(fit.model.groups, fit.model.first_of_group, strict=True):
        remembers = any(term.kind.memory is not None for term in group.law.terms)
        if remembers and fit.theta[first + 1] < -least_std * fit.std[first + 1]:
            return True
    return False


def search_origins(fit: Fit, kinds: Sequence[str], *, least_promise: float | None = None) -> list[LawStep[Fit]]:
    """Return fits of laws about another origin with nearly the same force as a fit; none is kept yet.

    Terms of the given kinds may replace those that depend on the travel.
    """
    settings, steps = fit.model.settings.origin, list[LawStep[Fit]]()
    if not any(map(depends_on_travel, fit.laws.values())):
        return []
    try:
        travel = static_travel(fit)
    except NO_FIT:
        # The springs cannot carry the body.
        return []
    if travel is None:
        return []
    ranked: dict[str, list[Law]] = {}
    for group in fit.model.groups:
        if depends_on_travel(fit.laws[group.name]):
            ranked[group.name] = _find_imitations(
                fit, group, float(np.mean(travel[list(group.members)])), kinds, settings
            )
    for index in range(min(settings.n_fitted, max(map(len, ranked.values()), default=0))):
        laws = {name: row[min(index, len(row) - 1)] for name, row in ranked.items() if row}
        if all(law == fit.laws[name] for name, law in laws.items()):
            continue
        again = refit(fit, laws, least_promise=least_promise)
        steps += [] if again is None else [LawStep(again, False, "origin")]
    return steps


def static_travel(fit: Fit) -> FloatArray | None:
    """Return the static travel of linear springs of the tangent stiffness under the body, (n_attachments,) m.

    It is measured from the unloaded length; None if no weight acts.

    Raises:
        UnboundedResponseError: springs that cannot carry the body.
    """
    model, body = fit.model, fit.model.body
    if body.fall is None:
        return None
    factors = fit.theta[model.first_factor :][: len(body.names)]
    mass = body.mass(factors, model.inverse_mass(fit.theta), np.zeros_like(body.unit))
    suspensions = [
        Interface(suspension.stiffness + float(suspension.law.gradient(0.0, 0.0)[0]), 0.0)
        for suspension in model.interfaces(fit.theta)[0]
    ]
    return find_rest(suspensions, body.rows, mass @ body.fall).travel


def _find_imitations(
    fit: Fit, group: Group, distance_m: float, kinds: Sequence[str], settings: OriginSettings
) -> list[Law]:
    """Return laws of one kind of spring about another origin, those nearest to the fitted force first.

    Of two that are equally near, the one whose force about its origin balances the weight comes first.
    """
    first, law = fit.model.first_of_group[fit.model.groups.index(group)], fit.laws[group.name]
    stiffness = float(fit.theta[first])
    travel = np.concatenate([fit.motion(attachment)[0] for attachment in group.members])
    z = np.quantile(travel, np.linspace(0.001, 0.999, settings.n_travels))
    straight = np.stack([np.ones_like(z), z], axis=1)
    force = stiffness * z + law.force(z, 0.0)
    weight = distance_m * (stiffness + float(law.gradient(0.0, 0.0)[0]))
    bent = _remove_columns(straight, force)
    kept = tuple(term for term in law.terms if not depends_on_travel(Law((term,))))
    found: dict[tuple[str, bool], tuple[float, float, Law]] = {}

    def imitate(fraction: float, term: Term) -> None:
        """Keep the law of a term with its origin at this fraction of the distance if it is nearer than those before."""
        rest_m = distance_m * fraction
        spring = Law((term,), rest_m)
        whole = spring.force(z, 0.0)
        shape = _remove_columns(straight, whole)
        size = float(shape @ shape)
        if size <= settings.least_bend**2 * float(whole @ whole):
            return
        amplitude = float(shape @ bent) / size
        # A law about its rest position does not depend on the weight.
        beside = np.linalg.lstsq(straight, force - amplitude * whole, rcond=None)[0][1]
        carried = beside * rest_m + amplitude * float(Law((term,)).force(rest_m, 0.0))
        missing = (carried - weight) / (settings.balance_std * weight) if rest_m else 0.0
        cost, key = float(np.sum((bent - amplitude * shape) ** 2)) * (1 + missing**2), (term.name, bool(rest_m))
        if cost < found.get(key, (np.inf, 0.0, LINEAR))[0]:
            found[key] = cost, fraction, Law((*kept, Term(term.name, (amplitude, *term.inner))), rest_m)

    for fraction in (0.0, *settings.distances):
        for term in _list_springs(kinds, float(np.hypot(travel.std(), distance_m * fraction)), settings.n_scales):
            imitate(fraction, term)
    for (name, is_away), (_, best, law) in list(found.items()):
        if is_away:
            (near,) = (term for term in law.terms if term.name == name)
            for factor in np.geomspace(1 / settings.finer_reach, settings.finer_reach, settings.n_finer):
                imitate(best * float(factor), Term(name, (1.0, *near.inner)))
    return [each for _, _, each in sorted(found.values(), key=lambda entry: entry[0])]


def _remove_columns(columns: FloatArray, values: FloatArray) -> FloatArray:
    """Return the residual of values after a least-squares fit of the columns."""
    return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0])


def _list_springs(kinds: Sequence[str], travel_rms: float, n_scales: int) -> Iterator[Term]:
    """Yield terms of unit amplitude that depend on the travel and have no origin of their own."""
    for kind in kinds:
        for term in list_terms(kind, travel_rms=travel_rms, velocity_rms=1.0, n_scales=n_scales):
            is_spring = not any(parameter.role == "lag" for parameter in term.kind.parameters)
            if is_spring and not term.kind.is_about_rest and depends_on_travel(Law((term,))):
                yield term
