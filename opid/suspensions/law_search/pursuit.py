"""Which law: add, exchange or drop the term that lowers the error most, until nothing improves it enough.

One search for one gear, several interfaces and the test bench. What is searched on is a `LawProblem`: it gives the
columns of candidates beside a fit (`opid.suspensions.law_search.dictionary`), fits other laws, and predicts what was
left out. All candidates are ranked without a fit, the best few are fitted. A larger law must earn its place by the
information criterion, by the error and by the prediction of what was left out.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

import numpy as np

from opid.mechanics.laws.law import LAWS, LINEAR, Law, Term
from opid.mechanics.weight import depends_on_travel
from opid.suspensions.law_search.dictionary import LawDictionary, stand_together
from opid.suspensions.settings import SearchSettings

logger = logging.getLogger(__name__)

Say = Callable[[str], None]


class LawFit(Protocol):
    """A fit with laws, one for each group of suspensions."""

    @property
    def laws(self) -> Mapping[str, Law]:
        """By the name of the group."""

    @property
    def law_name(self) -> str:
        """The laws in words."""

    @property
    def bic(self) -> float:
        """Information criterion: smaller is better."""

    @property
    def n_data(self) -> int:
        """Real numbers fitted, independent ones."""

    @property
    def error_rms(self) -> float:
        """What is left, in the unit of the data."""


F = TypeVar("F", bound=LawFit)


class LawProblem(Protocol[F]):
    """What laws are searched on."""

    @property
    def settings(self) -> SearchSettings:
        """Of the search."""

    def dictionaries(self, fit: F, kinds: Sequence[str]) -> dict[str, LawDictionary]:
        """Return the candidates beside a fit by the name of the group; empty where there are none."""

    def refit(self, fit: F, laws: Mapping[str, Law]) -> F | None:
        """Fit other laws from where a fit stands; None where they cannot be fitted."""

    def left_out(self, fit: F) -> float | None:
        """Return what is left of data that the rest predicts, as `error_rms`; None where nothing is left out."""

    def confirms(self, fit: F, than: F) -> bool:
        """Return whether data left out confirm a law that is better than one of no more terms; True if not asked."""


@dataclass(frozen=True, eq=False)
class LawStep(Generic[F]):
    """One law that was tried.

    Args:
        fit: of it.
        kept: whether the search went on from here; the last step that was kept is the choice.
        method: what proposed it: "equation", "given", "pursuit", "origin" or "sparse regression".
        left_out: what is left of data that the rest predicts, as `error_rms` of the fit; None where it was not asked
            for.
    """

    fit: F
    kept: bool
    method: str
    left_out: float | None = None

    @property
    def law_name(self) -> str:
        """The laws in words."""
        return self.fit.law_name


@dataclass(frozen=True)
class _Move:
    """Other laws for some groups, and the criterion they would reach less that of the fit.

    Args:
        laws: of the groups that change, by their names.
        bic: the criterion, less that of the fit; to first order.
        n_more: terms more than the fit has.
        always: whether it is fitted besides the number of moves that a round allows.
    """

    laws: dict[str, Law]
    bic: float
    n_more: int
    always: bool = False

    def name(self, fit: LawFit) -> tuple[str, ...]:
        return tuple(self.laws.get(group, law).name for group, law in fit.laws.items())


def library() -> tuple[str, ...]:
    """Return the names of the kinds that a search for the law of a suspension tries, users' own among them."""
    return tuple(name for name, kind in LAWS.items() if kind.searched and not kind.bench_only)


def search_laws(
    problem: LawProblem[F],
    start: F,
    *,
    kinds: Sequence[str] | None = None,
    method: str = "equation",
    rejected: Collection[tuple[str, ...]] = (),
    progress: Say | None = None,
) -> tuple[LawStep[F], ...]:
    """Return the ladder of fitted laws; the last one with `kept` is the choice.

    Args:
        problem: what laws are searched on.
        start: a fit to grow from.
        kinds: that may enter; those of `library` where left out.
        method: what led to the start.
        rejected: names of the laws of all groups that are not tried again, see `far_behind`.
        progress: called with the name of each law before it is fitted.
    """
    say = progress or (lambda step: None)
    kinds = library() if kinds is None else tuple(kinds)
    ladder, current = [LawStep(start, True, method)], start
    tried = {_names(start)}
    for _ in range(problem.settings.n_rounds):
        fits = _fitted(problem, current, kinds, tried, rejected, say)
        best = current
        for fit in fits:
            best = fit if _replaces(problem, fit, best) else best
        ladder += [LawStep(fit, fit is best, "pursuit") for fit in fits]
        if best is current:
            break
        current = best
    return tuple(ladder)


def chosen(ladder: Sequence[LawStep[F]]) -> LawStep[F]:
    """Return the step that a search ended on.

    Args:
        ladder: of `search_laws`.
    """
    return [step for step in ladder if step.kept][-1]


def far_behind(ladder: Sequence[LawStep[F]], settings: SearchSettings) -> set[tuple[str, ...]]:
    """Return the names of laws, of all groups, that leave so much more than the choice that no other rate mends it.

    Args:
        ladder: of `search_laws`, of one rate.
        settings: what counts as so much more.
    """
    most = (1 + settings.far_fraction) * chosen(ladder).fit.error_rms
    least: dict[tuple[str, ...], float] = {}
    for step in ladder:
        least[_names(step.fit)] = min(step.fit.error_rms, least.get(_names(step.fit), math.inf))
    return {names for names, error_rms in least.items() if error_rms > most}


def surely_behind(ladder: Sequence[LawStep[F]], settings: SearchSettings) -> set[tuple[str, ...]]:
    """Return the names of laws, of all groups, so unlikely beside the choice that no other fit need confirm it.

    Args:
        ladder: of `search_laws`, of one rate.
        settings: what counts as so unlikely.
    """
    most = chosen(ladder).fit.bic + settings.surely_behind_bic
    least: dict[tuple[str, ...], float] = {}
    for step in ladder:
        least[_names(step.fit)] = min(step.fit.bic, least.get(_names(step.fit), math.inf))
    return {names for names, bic in least.items() if bic > most}


def is_better(fit: LawFit, than: LawFit, settings: SearchSettings) -> bool:
    """Return whether fitted laws take the place of others: of as many terms the likelier, more of them by a margin.

    Args:
        fit: the laws that may take the place.
        than: the others.
        settings: the margins.
    """
    more = n_terms(fit) - n_terms(than)
    if more < 0:
        return not is_better(than, fit, settings)
    if more == 0:
        return fit.bic + settings.inner_margin * (_n_inner(fit) - _n_inner(than)) < than.bic
    margin = settings.error_margin / len(fit.laws)
    return fit.bic < than.bic - settings.bic_margin and fit.error_rms < (1 - margin) * than.error_rms


def _n_inner(fit: LawFit) -> int:
    """Number of inner parameters of all laws."""
    return sum(law.vector.size - len(law.terms) for law in fit.laws.values())


def _replaces(problem: LawProblem[F], fit: F, than: F) -> bool:
    """Whether a fit is better by its criterion and by data left out, or a larger one is not."""
    if n_terms(fit) < n_terms(than):
        return not _replaces(problem, than, fit)
    return is_better(fit, than, problem.settings) and problem.confirms(fit, than)


def n_terms(fit: LawFit) -> int:
    """Return the number of terms of all laws, an origin that is not where a suspension rests among them.

    Args:
        fit: of the laws.
    """
    return sum(len(law.terms) + bool(law.terms and law.rest_m) for law in fit.laws.values())


def judge_by_left_out(problem: LawProblem[F], ladder: Sequence[LawStep[F]]) -> tuple[LawStep[F], ...]:
    """Return the ladder with left-out errors: of the choice, its closest rivals and, if near, the best of fewer terms.

    The smaller laws are chosen instead where they predict what was left out as well, and leave hardly more of all data:
    a law that was too large would mend little, and one that rests elsewhere in each run is not seen whole in any.
    """
    steps = list(ladder)
    choice = max(index for index, step in enumerate(steps) if step.kept)
    fit, close = steps[choice].fit, problem.settings.alike_bic
    smaller = [k for k, step in enumerate(steps) if n_terms(step.fit) < n_terms(fit)]
    below = min(smaller, key=lambda k: steps[k].fit.bic) if smaller else None
    # a law that is the choice and more besides is no rival
    rivals = [
        k
        for k, step in enumerate(steps)
        if step.fit.bic < fit.bic + close and n_terms(step.fit) <= n_terms(fit) and k not in (choice, below)
    ]
    most = (1 + problem.settings.overfit_fraction) * fit.error_rms
    if below is not None and steps[below].fit.error_rms >= most:
        # whatever it leaves of runs left out, a law that mends so much stays
        below = None
    for k in [choice, *([] if below is None else [below]), *rivals]:
        if steps[k].left_out is None:
            steps[k] = replace(steps[k], left_out=problem.left_out(steps[k].fit))
    if below is not None:
        with_it, without = steps[choice].left_out, steps[below].left_out
        if with_it is not None and without is not None and without <= with_it:
            # the last one that was kept is the choice
            steps.append(replace(steps.pop(below), kept=True))
    return tuple(steps)


def add_neighbours(
    problem: LawProblem[F],
    ladder: Sequence[LawStep[F]],
    *,
    kinds: Sequence[str] | None = None,
    known: Collection[tuple[str, ...]] = (),
) -> tuple[LawStep[F], ...]:
    """Return the ladder with what a reader asks next: linear suspensions, and the rejected laws that come closest.

    Args:
        problem: what was searched on.
        ladder: of `search_laws`; the choice stays.
        kinds: that may enter; those of `library` where left out.
        known: names of the laws of all groups that the reader is shown anyway; they count among the closest.
    """
    best = chosen(ladder).fit
    tried = {_names(step.fit) for step in ladder}
    linear = dict.fromkeys(best.laws, LINEAR)
    wanted = [] if ("linear",) * len(linear) in {*tried, *known} else [linear]
    moves = [move for move in _moves(problem, best, library() if kinds is None else kinds) if len(move.laws) == 1]
    nearest = [move for move in moves if move.name(best) not in tried][: problem.settings.n_neighbours]
    wanted += [move.laws for move in nearest if move.name(best) not in known]
    fits = [problem.refit(best, laws) for laws in wanted]
    return (*(LawStep(fit, False, "pursuit") for fit in fits if fit is not None), *ladder)


def alternatives(ladder: Sequence[LawStep[F]], settings: SearchSettings) -> tuple[str, ...]:
    """Say which other laws of a ladder explain the runs as well as the chosen one, a sentence each.

    A law that is the chosen one and more besides is no alternative.

    Args:
        ladder: of `search_laws`.
        settings: what counts as alike.
    """
    best = chosen(ladder).fit
    found: dict[str, str] = {}
    for step in ladder:
        behind = step.fit.bic - best.bic
        changed = [
            (group, mine, step.fit.laws[group])
            for group, mine in best.laws.items()
            if {term.name for term in mine.terms} != {term.name for term in step.fit.laws[group].terms}
        ]
        if behind > settings.alike_bic or step.law_name in found or len(changed) != 1:
            continue
        group, mine, theirs = changed[0]
        names = {term.name for term in mine.terms}, {term.name for term in theirs.terms}
        gone = [term for term in mine.terms if term.name not in names[1]]
        if not gone:
            continue
        new = [term for term in theirs.terms if term.name not in names[0]]
        motions = " and ".join(sorted({_moved_by(term) for term in (*gone, *new)}))
        what, lost = " and ".join(map(_words, new)), " and ".join(term.name for term in gone)
        where = f"at {group!r}: " if group else ""
        found[step.law_name] = where + (
            f"{what} in place of {lost} explains the runs as well (BIC {behind:+.0f}): the visited {motions} do not "
            "tell them apart"
            if new
            else f"the runs are explained as well without {lost} (BIC {behind:+.0f}): the visited {motions} do not "
            "show it"
        )
    return tuple(found.values())


def _names(fit: LawFit) -> tuple[str, ...]:
    return tuple(law.name for law in fit.laws.values())


def _moves(problem: LawProblem[F], fit: F, kinds: Sequence[str]) -> list[_Move]:
    """Laws near the fitted ones: each group by itself, and the best of every group at once."""
    dictionaries = problem.dictionaries(fit, kinds)
    every = {group: dictionary.proposals() for group, dictionary in dictionaries.items()}
    moves = [_Move({group: each.law}, each.bic, each.n_more) for group, row in every.items() for each in row]
    # what helps each group at once: those that drop a term, those that keep their number, and those that add one
    for wanted in ((-1, 0, 1), (-1, 0), (1,)):
        best = {group: next((each for each in row if each.n_more in wanted), None) for group, row in every.items()}
        joint = {
            group: each
            for group, each in best.items()
            if each is not None and each.bic < (0.0 if each.n_more < 0 else -problem.settings.bic_margin)
        }
        if len(joint) > 1:
            laws = {group: each.law for group, each in joint.items()}
            total = sum(each.bic for each in joint.values())
            moves.append(_Move(laws, total, sum(each.n_more for each in joint.values())))
    for group, law in fit.laws.items():
        moves += [_Move({group: other}, 0.0, 0) for other in _limits(law, kinds)]
        # no column tells what these promise
        moves += [_Move({group: other}, 0.0, 0, always=True) for other in relatives(law, kinds)]
        dictionary = dictionaries.get(group)
        moves += [] if dictionary is None else [_Move({group: other}, -math.inf, 0) for other in dictionary.further]
    possible = (move for move in moves if all(stand_together(law.parameters) for law in move.laws.values()))
    return sorted(possible, key=lambda move: move.bic)


def _limits(law: Law, kinds: Sequence[str]) -> Iterator[Law]:
    """Laws with a term's limits in its place: it imitates them so well that no derivative asks for the exchange."""
    for term in law.terms:
        others = tuple(each for each in law.terms if each is not term)
        if term.kind.quasi_static:
            # what is known of the weight holds straight springs at none beside it
            yield Law(others, law.rest_m)
        # of others that depend on the travel the origin stays where it is
        about = 0.0 if any(map(depends_on_travel, (Law((each,)) for each in others))) else law.rest_m
        for name, values in term.kind.limits(term.values, about):
            if name in kinds and name not in law.parameters:
                # what the term took from a friction that remembers was that of its limit
                alone = tuple(each for each in others if stand_together((each.name, name)))
                yield Law((*alone, Term(name, values)), law.rest_m - about * LAWS[name].is_about_rest)


def relatives(law: Law, kinds: Sequence[str]) -> Iterator[Law]:
    """Yield laws with another friction that remembers, of the same force and travel: their columns look much alike.

    Args:
        law: with or without memory.
        kinds: that may take its place.
    """
    for term in law.terms:
        if term.kind.memory is None or not term.kind.is_friction:
            continue
        others = tuple(each for each in law.terms if each is not term)
        for name in kinds:
            kind = LAWS[name]
            # many states are long to follow: sliders that slip one after the other are tried where a law fits that
            # bends as gradually, with as many parameters
            is_short = len(kind.elements) == 1 or len(term.values) == len(kind.parameters)
            if kind.memory is not None and kind.is_friction and is_short and name not in law.parameters:
                values = (*term.values[:2], *(parameter.default for parameter in kind.parameters[2:]))
                yield Law((*others, Term(name, values)), law.rest_m)


def _fitted(
    problem: LawProblem[F],
    current: F,
    kinds: Sequence[str],
    tried: set[tuple[str, ...]],
    rejected: Collection[tuple[str, ...]],
    say: Say,
) -> list[F]:
    """Fit the laws one step away that may be better, or no worse by a margin; larger ones if no other will do."""
    known, fits = problem.settings, list[F]()
    found = _moves(problem, current, kinds)
    # what the error margin asks of a larger law, so that a smaller one has its chance
    in_error = -2 * current.n_data * float(np.log1p(-known.error_margin / len(current.laws)))
    doubt = -2 * current.n_data * float(np.log1p(-known.first_order_error))
    for grow in (False, True):
        n_fitted = 0
        for move in found:
            bar = min(fit.bic for fit in (current, *fits)) - current.bic + doubt
            allowed = bar + (
                in_error if move.n_more < 0 else known.bic_margin if move.n_more == 0 else -known.bic_margin
            )
            name = move.name(current)
            # from afar a smaller law may have ended elsewhere
            is_tried = name in rejected or (name in tried and move.n_more >= 0)
            if (move.n_more > 0) != grow or is_tried or move.bic > allowed:
                continue
            if n_fitted == known.n_refitted and not move.always:
                continue
            tried.add(name)
            say("; ".join(dict.fromkeys(name)))
            fit = problem.refit(current, move.laws)
            logger.debug("law %s: %s", "; ".join(name), "no fit" if fit is None else f"BIC {fit.bic:.1f}")
            fits += [fit] if fit is not None else []
            n_fitted += not move.always
        if any(_replaces(problem, fit, current) for fit in fits):
            break
    return fits


def _moved_by(term: Term) -> str:
    """What the force of a term depends on, by its name in a sentence."""
    travel, velocity = np.linspace(-1e-2, 1e-2, 21), np.linspace(-0.1, 0.1, 21)
    by_travel, by_velocity = Law((Term(term.name, (1.0, *term.inner)),)).gradient(travel, velocity)
    if np.any(by_travel) and np.any(by_velocity):
        return "motions"
    return "velocities" if np.any(by_velocity) else "travels"


def _words(term: Term) -> str:
    inner = [f"{value:.3g} {p.unit}" for p, value in zip(term.kind.parameters[1:], term.inner, strict=True)]
    return f"{term.name} ({', '.join(inner)})" if inner else term.name
