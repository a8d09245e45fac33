"""Search for the law: add, exchange or drop the term that lowers the error most, until no change is large enough.

The same search serves one gear, several interfaces and the test bench. It works on a `LawProblem`, which gives the
columns of candidates beside a fit (`opid.suspensions.law_search.dictionary`), fits other laws, and predicts data that
were left out. All candidates are ranked without a fit, and the best few are fitted. A larger law must be better by the
information criterion, by the error and by the prediction of data that were left out.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

import numpy as np

from opid.mechanics.laws.law import LAWS, LINEAR, Law, Term
from opid.mechanics.weight import depends_on_travel
from opid.progress import Say
from opid.suspensions.law_search.dictionary import LawDictionary, may_stand_together
from opid.suspensions.settings import SearchSettings

logger = logging.getLogger(__name__)


class LawFit(Protocol):
    """A fit with laws, one for each group of suspensions."""

    @property
    def laws(self) -> Mapping[str, Law]:
        """The laws by the name of the group."""

    @property
    def law_name(self) -> str:
        """The laws in words."""

    @property
    def bic(self) -> float:
        """Information criterion: smaller is better."""

    @property
    def n_data(self) -> int:
        """Number of independent real numbers that were fitted."""

    @property
    def error_rms(self) -> float:
        """Rms of the residual, in the unit of the data."""


F = TypeVar("F", bound=LawFit)


class LawProblem(Protocol[F]):
    """The problem on which laws are searched."""

    @property
    def settings(self) -> SearchSettings:
        """Settings of the search."""

    def dictionaries(self, fit: F, kinds: Sequence[str]) -> dict[str, LawDictionary]:
        """Return the candidates beside a fit by the name of the group; empty if there are none."""

    def refit(self, fit: F, laws: Mapping[str, Law]) -> F | None:
        """Fit other laws, beginning at a fit; None if they cannot be fitted."""

    def left_out(self, fit: F) -> float | None:
        """Return the rms error of data predicted from the other data, as `error_rms`; None if nothing is left out."""

    def confirms(self, fit: F, than: F) -> bool:
        """Return whether data left out confirm that a law is better than one of no more terms; True without a test."""


@dataclass(frozen=True, eq=False)
class LawStep(Generic[F]):
    """One law that was tried.

    Args:
        fit: the fit of the law.
        kept: whether the search continued from here; the last step that was kept is the choice.
        method: the method that proposed it: "equation", "given", "pursuit", "origin" or "sparse regression".
        left_out: rms error of data predicted from the other data, as `error_rms` of the fit; None if it was not
            computed.
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
    """Other laws for some groups, and their information criterion minus that of the fit.

    Args:
        laws: the laws of the groups that change, by their names.
        bic: the criterion minus that of the fit, to first order.
        n_more: number of terms minus that of the fit.
        always: whether it is fitted in addition to the number of moves that a round allows.
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
        problem: the problem on which laws are searched.
        start: the fit to start from.
        kinds: the kinds that a law may have; those of `library` if left out.
        method: the method that led to the start.
        rejected: names of the laws of all groups that are not tried again, see `find_far_behind`.
        progress: called with the name of each law before it is fitted.
    """
    say = progress or (lambda step: None)
    kinds = library() if kinds is None else tuple(kinds)
    ladder, current = [LawStep(start, True, method)], start
    tried = {_list_names(start)}
    for _ in range(problem.settings.n_rounds):
        fits = _fit_moves(problem, current, kinds, tried, rejected, say)
        best = current
        for fit in fits:
            best = fit if _is_better(problem, fit, best) else best
        ladder += [LawStep(fit, fit is best, "pursuit") for fit in fits]
        if best is current:
            break
        current = best
    return tuple(ladder)


def chosen(ladder: Sequence[LawStep[F]]) -> LawStep[F]:
    """Return the step that a search ended on.

    Args:
        ladder: the result of `search_laws`.
    """
    return [step for step in ladder if step.kept][-1]


def find_far_behind(ladder: Sequence[LawStep[F]], settings: SearchSettings) -> set[tuple[str, ...]]:
    """Return the names of laws, of all groups, whose error is so much larger that no other rate can change the choice.

    Args:
        ladder: the result of `search_laws` at one rate.
        settings: the threshold of the error.
    """
    most = (1 + settings.far_fraction) * chosen(ladder).fit.error_rms
    least: dict[tuple[str, ...], float] = {}
    for step in ladder:
        least[_list_names(step.fit)] = min(step.fit.error_rms, least.get(_list_names(step.fit), math.inf))
    return {names for names, error_rms in least.items() if error_rms > most}


def find_surely_behind(ladder: Sequence[LawStep[F]], settings: SearchSettings) -> set[tuple[str, ...]]:
    """Return the names of laws, of all groups, that are so unlikely that no other fit has to confirm the choice.

    Args:
        ladder: the result of `search_laws` at one rate.
        settings: the threshold of the criterion.
    """
    most = chosen(ladder).fit.bic + settings.surely_behind_bic
    least: dict[tuple[str, ...], float] = {}
    for step in ladder:
        least[_list_names(step.fit)] = min(step.fit.bic, least.get(_list_names(step.fit), math.inf))
    return {names for names, bic in least.items() if bic > most}


def is_better(fit: LawFit, than: LawFit, settings: SearchSettings) -> bool:
    """Return whether fitted laws replace others: the likelier ones of as many terms, laws of more terms by a margin.

    Args:
        fit: the laws that may replace the others.
        than: the others.
        settings: the margins.
    """
    more = n_terms(fit) - n_terms(than)
    if more < 0:
        return not is_better(than, fit, settings)
    if more == 0:
        return fit.bic + settings.inner_margin * (_count_inner(fit) - _count_inner(than)) < than.bic
    margin = settings.error_margin / len(fit.laws)
    return fit.bic < than.bic - settings.bic_margin and fit.error_rms < (1 - margin) * than.error_rms


def _count_inner(fit: LawFit) -> int:
    """Return the number of inner parameters of all laws."""
    return sum(law.vector.size - len(law.terms) for law in fit.laws.values())


def _is_better(problem: LawProblem[F], fit: F, than: F) -> bool:
    """Whether a fit is better by its criterion and by data left out; a smaller one also if the larger is not better."""
    if n_terms(fit) < n_terms(than):
        return not _is_better(problem, than, fit)
    return is_better(fit, than, problem.settings) and problem.confirms(fit, than)


def n_terms(fit: LawFit) -> int:
    """Return the number of terms of all laws; an origin that is not the rest position counts as one.

    Args:
        fit: the fit of the laws.
    """
    return sum(len(law.terms) + bool(law.terms and law.rest_m) for law in fit.laws.values())


def judge_by_left_out(problem: LawProblem[F], ladder: Sequence[LawStep[F]]) -> tuple[LawStep[F], ...]:
    """Return the ladder with left-out errors of the choice, of its closest rivals, and of the best law of fewer terms.

    The law of fewer terms is considered only if its error is hardly larger, because an unnecessary term lowers the
    error little. It is chosen if it predicts the data that were left out as well. A law whose runs rest at different
    positions is not seen completely in any single run, so this prediction alone does not decide.
    """
    steps = list(ladder)
    choice = max(index for index, step in enumerate(steps) if step.kept)
    fit, close = steps[choice].fit, problem.settings.alike_bic
    smaller = [k for k, step in enumerate(steps) if n_terms(step.fit) < n_terms(fit)]
    below = min(smaller, key=lambda k: steps[k].fit.bic) if smaller else None
    # A law with all terms of the choice and further ones is no rival.
    rivals = [
        k
        for k, step in enumerate(steps)
        if step.fit.bic < fit.bic + close and n_terms(step.fit) <= n_terms(fit) and k not in (choice, below)
    ]
    most = (1 + problem.settings.overfit_fraction) * fit.error_rms
    if below is not None and steps[below].fit.error_rms >= most:
        # A law that lowers the error so much is kept, whatever its error on runs left out.
        below = None
    for k in [choice, *([] if below is None else [below]), *rivals]:
        if steps[k].left_out is None:
            steps[k] = replace(steps[k], left_out=problem.left_out(steps[k].fit))
    if below is not None:
        with_it, without = steps[choice].left_out, steps[below].left_out
        if with_it is not None and without is not None and without <= with_it:
            # The last step that was kept is the choice.
            steps.append(replace(steps.pop(below), kept=True))
    return tuple(steps)


def add_neighbours(
    problem: LawProblem[F],
    ladder: Sequence[LawStep[F]],
    *,
    kinds: Sequence[str] | None = None,
    known: Collection[tuple[str, ...]] = (),
) -> tuple[LawStep[F], ...]:
    """Return the ladder with linear suspensions and the closest rejected laws added, for comparison in the report.

    Args:
        problem: the problem on which laws were searched.
        ladder: the result of `search_laws`; the choice stays.
        kinds: the kinds that a law may have; those of `library` if left out.
        known: names of the laws of all groups that are reported anyway; they count among the closest.
    """
    best = chosen(ladder).fit
    tried = {_list_names(step.fit) for step in ladder}
    linear = dict.fromkeys(best.laws, LINEAR)
    wanted = [] if ("linear",) * len(linear) in {*tried, *known} else [linear]
    moves = [move for move in _list_moves(problem, best, library() if kinds is None else kinds) if len(move.laws) == 1]
    nearest = [move for move in moves if move.name(best) not in tried][: problem.settings.n_neighbours]
    wanted += [move.laws for move in nearest if move.name(best) not in known]
    fits = [problem.refit(best, laws) for laws in wanted]
    return (*(LawStep(fit, False, "pursuit") for fit in fits if fit is not None), *ladder)


def alternatives(ladder: Sequence[LawStep[F]], settings: SearchSettings) -> tuple[str, ...]:
    """Return the other laws of a ladder that explain the runs as well as the chosen one, one sentence each.

    A law with all terms of the chosen one and further ones is no alternative.

    Args:
        ladder: the result of `search_laws`.
        settings: the difference of criteria below which laws cannot be distinguished.
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
        motions = " and ".join(sorted({_describe_motion(term) for term in (*gone, *new)}))
        what, lost = " and ".join(map(_describe_term, new)), " and ".join(term.name for term in gone)
        where = f"at {group!r}: " if group else ""
        found[step.law_name] = where + (
            f"{what} in place of {lost} explains the runs as well (BIC {behind:+.0f}): the visited {motions} do not "
            "distinguish them"
            if new
            else f"the runs are explained as well without {lost} (BIC {behind:+.0f}): the visited {motions} do not "
            "show it"
        )
    return tuple(found.values())


def _list_names(fit: LawFit) -> tuple[str, ...]:
    return tuple(law.name for law in fit.laws.values())


def _list_moves(problem: LawProblem[F], fit: F, kinds: Sequence[str]) -> list[_Move]:
    """Return laws near the fitted ones: changes of one group, and the best changes of all groups together."""
    dictionaries = problem.dictionaries(fit, kinds)
    every = {group: dictionary.proposals() for group, dictionary in dictionaries.items()}
    moves = [_Move({group: each.law}, each.bic, each.n_more) for group, row in every.items() for each in row]
    # Joint moves of all groups: any change, only changes that add no term, and only changes that add one.
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
        moves += [_Move({group: other}, 0.0, 0) for other in _list_limits(law, kinds)]
        # No column shows the expected improvement of these laws.
        moves += [_Move({group: other}, 0.0, 0, always=True) for other in relatives(law, kinds)]
        dictionary = dictionaries.get(group)
        moves += [] if dictionary is None else [_Move({group: other}, -math.inf, 0) for other in dictionary.further]
    possible = (move for move in moves if all(may_stand_together(law.parameters) for law in move.laws.values()))
    return sorted(possible, key=lambda move: move.bic)


def _list_limits(law: Law, kinds: Sequence[str]) -> Iterator[Law]:
    """Yield laws in which the limits of a term replace it: it is so similar to them that no derivative shows this."""
    for term in law.terms:
        others = tuple(each for each in law.terms if each is not term)
        if term.kind.quasi_static:
            # Beside gas, the known weight holds linear springs at zero.
            yield Law(others, law.rest_m)
        # If other terms depend on the travel, the origin does not change.
        about = 0.0 if any(map(depends_on_travel, (Law((each,)) for each in others))) else law.rest_m
        for name, values in term.kind.limits(term.values, about):
            if name in kinds and name not in law.parameters:
                # Terms that may not stand beside the limit are dropped: their force belongs to the limit.
                alone = tuple(each for each in others if may_stand_together((each.name, name)))
                yield Law((*alone, Term(name, values)), law.rest_m - about * LAWS[name].is_about_rest)


def relatives(law: Law, kinds: Sequence[str]) -> Iterator[Law]:
    """Yield laws with another friction with memory, of the same force and travel: their columns are nearly the same.

    Args:
        law: a law with or without memory.
        kinds: the kinds that may replace its friction.
    """
    for term in law.terms:
        if term.kind.memory is None or not term.kind.is_friction:
            continue
        others = tuple(each for each in law.terms if each is not term)
        for name in kinds:
            kind = LAWS[name]
            # A simulation with many states takes long: joints of sliders are tried only in place of a term with as many
            # parameters, whose force bends as gradually.
            is_short = len(kind.elements) == 1 or len(term.values) == len(kind.parameters)
            if kind.memory is not None and kind.is_friction and is_short and name not in law.parameters:
                values = (*term.values[:2], *(parameter.default for parameter in kind.parameters[2:]))
                yield Law((*others, Term(name, values)), law.rest_m)


def _fit_moves(
    problem: LawProblem[F],
    current: F,
    kinds: Sequence[str],
    tried: set[tuple[str, ...]],
    rejected: Collection[tuple[str, ...]],
    say: Say,
) -> list[F]:
    """Fit the laws one step away that may be better, or no worse by a margin; larger ones if no other will do."""
    known, fits = problem.settings, list[F]()
    found = _list_moves(problem, current, kinds)
    # This is the reduction that the error margin requires of a larger law; a smaller law may be worse by as much.
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
            # A smaller law that was tried from another fit may have ended at another minimum.
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
        if any(_is_better(problem, fit, current) for fit in fits):
            break
    return fits


def _describe_motion(term: Term) -> str:
    """Return what the force of a term depends on, as a word of a sentence."""
    travel, velocity = np.linspace(-1e-2, 1e-2, 21), np.linspace(-0.1, 0.1, 21)
    by_travel, by_velocity = Law((Term(term.name, (1.0, *term.inner)),)).gradient(travel, velocity)
    if np.any(by_travel) and np.any(by_velocity):
        return "motions"
    return "velocities" if np.any(by_velocity) else "travels"


def _describe_term(term: Term) -> str:
    inner = [f"{value:.3g} {p.unit}" for p, value in zip(term.kind.parameters[1:], term.inner, strict=True)]
    return f"{term.name} ({', '.join(inner)})" if inner else term.name
