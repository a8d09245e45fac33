"""Which law, by prediction: add, exchange or drop the term that most lowers the prediction error of the driven model.

All candidates are ranked by one simulation a scale: with every one of them in the law at amplitude zero, the
derivatives of the prediction errors by the amplitudes, made orthogonal to what the model can already do, say how far
the error would fall with a term added, exchanged or dropped (a score test, Rao 1948). Laws that could be better, or as
good, are fitted. A larger one must earn its place by the information criterion, by the error and by the prediction of a
run left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from opid.identify.driven_run import DrivenRun
from opid.identify.joint_fit import LadderStep
from opid.identify.law_search import BIC_MARGIN
from opid.identify.model_fit import ModelFit
from opid.identify.refit import left_out_error, model_of, refit, vector_of
from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.kinds import BUILT_IN, LAWS
from opid.mechanics.laws import Law, Term
from opid.signals.recording import FloatArray

# the fitted error must fall by this share: below, a term only mends what the sensors did
ERROR_MARGIN = 0.005
# laws that are fitted in a round at the most, and rounds at the most
N_REFITTED, N_ROUNDS = 3, 8
# terms exchanged at once: each of two near relatives can hold the other in place
MOST_EXCHANGED = 2
# inner scales at which a candidate is tried, over the rms motion
SCALES = (0.15, 0.5, 1.5)


@dataclass(frozen=True)
class Proposal:
    """A law that is worth a fit.

    Args:
        law: with the amplitudes that the derivatives suggest, per unit of sprung mass.
        bic: the criterion that it would reach, its scales at their best.
    """

    law: Law
    bic: float


def library() -> tuple[str, ...]:
    """Return the names of the kinds that a search may use: every registered one, and the built-in ones by their scales.

    Built-in kinds with an exponent or a lag contain others of the library as special cases.
    """
    built_in = {kind.name for kind in BUILT_IN}
    return tuple(
        name
        for name, kind in LAWS.items()
        if name not in built_in or all(p.role in ("amplitude", "scale") for p in kind.parameters)
    )


def pursue_law(
    runs: Sequence[DrivenRun],
    start: ModelFit,
    *,
    names: Sequence[str] | None = None,
    most_terms: int = 3,
    road: str = "pursuit",
    progress: Callable[[str], None] | None = None,
) -> tuple[LadderStep, ...]:
    """Return the ladder of fitted laws; the last one with `kept` is the choice.

    Args:
        runs: one `DrivenRun` a run.
        start: a fitted model to grow from, usually with the law of the classical chain.
        names: kinds in `opid.mechanics.laws.LAWS` that may enter; those of `library` where left out.
        most_terms: terms at the most.
        road: what led to the start.
        progress: called with the name of each law before it is fitted.
    """
    say = progress or (lambda step: None)
    ladder = [LadderStep(start.law.name, start, True, road=road)]
    current = start
    for _ in range(N_ROUNDS):
        tried = {step.law_name for step in ladder}
        fits = _fitted(runs, current, library() if names is None else names, most_terms, tried, say)
        best = current
        for fit in fits:
            best = fit if better(fit, best) else best
        ladder += [LadderStep(fit.law.name, fit, fit is best, road="pursuit") for fit in fits]
        if best is current:
            break
        current = best
    return judged_by_left_out(runs, tuple(ladder))


def better(fit: ModelFit, than: ModelFit) -> bool:
    """Return whether a fitted law takes the place of another: of as many terms the likelier, a larger one by a margin.

    Args:
        fit: the one.
        than: the other.
    """
    more = len(fit.law.terms) - len(than.law.terms)
    if more < 0:
        return not better(than, fit)
    if more == 0:
        return fit.bic < than.bic
    return fit.bic < than.bic - BIC_MARGIN and fit.noise_m_per_s2 < (1 - ERROR_MARGIN) * than.noise_m_per_s2


def proposals(
    runs: Sequence[DrivenRun], fit: ModelFit, names: Sequence[str], *, most_terms: int = 3
) -> list[Proposal]:
    """Return the laws near a fitted one - a term more or less, one or two exchanged - the most promising first.

    With b the errors less what the fitted law does to them and D the derivatives by the amplitudes, both orthogonal to
    the derivatives by everything else, the law of the terms S would leave min_a |b + D_S a|^2.

    Args:
        runs: one `DrivenRun` a run.
        fit: the model to depart from.
        names: kinds that may enter.
        most_terms: terms at the most.
    """
    dictionary = _dictionary(runs, fit, names)
    have = [term.name for term in fit.law.terms]
    others = [name for name in dictionary.places if name not in have]
    moves = [tuple(kept) for kept in combinations(have, max(len(have) - 1, 0))] if have else []
    for n_exchanged in range(1, min(len(have), MOST_EXCHANGED) + 1):
        for kept in combinations(have, len(have) - n_exchanged):
            moves += [(*kept, *new) for new in combinations(others, n_exchanged)]
    moves += [(*have, new) for new in others] if len(have) < most_terms else []
    return sorted((dictionary.proposal(fit, move) for move in moves), key=lambda proposal: proposal.bic)


@dataclass(frozen=True, eq=False)
class _Dictionary:
    """Derivatives of the prediction errors by the amplitudes of many terms, as far as nothing else does the same.

    Args:
        terms: what each column is, inner values and all; None for the inner parameter of a fitted term.
        places: columns of each kind.
        target: (n_data,) errors less what the fitted law does to them.
        gram: (n_columns, n_columns) of columns of unit size.
        along: (n_columns,) the target along them.
        size: (n_columns,) of the columns.
    """

    terms: tuple[Term | None, ...]
    places: dict[str, list[int]]
    target: FloatArray
    gram: FloatArray
    along: FloatArray
    size: FloatArray

    def left(self, places: Sequence[int]) -> tuple[float, FloatArray]:
        """Squared error that columns leave, and their weights."""
        chosen = np.array(places, dtype=int)
        if not chosen.size:
            return float(self.target @ self.target), np.empty(0)
        inverse = np.linalg.pinv(self.gram[np.ix_(chosen, chosen)], rcond=1e-7, hermitian=True)
        weights = -inverse @ self.along[chosen]
        return float(self.target @ self.target + self.along[chosen] @ weights), weights / self.size[chosen]

    def proposal(self, fit: ModelFit, names: Sequence[str]) -> Proposal:
        """What the law of some kinds would reach, and its start values: each kind at the scale that serves best."""
        now, _ = self.left([place for term in fit.law.terms for place in self.places[term.name]])
        cost, _ = self.left([place for name in names for place in self.places[name]])
        n_more = sum(len(LAWS[name].parameters) for name in names) - fit.law.vector.size
        bic = fit.bic + fit.n_data * np.log(max(cost, 1e-300) / now) + n_more * np.log(fit.n_data)
        picked: list[int] = []
        for name in sorted(names, key=lambda name: name not in fit.law.parameters):
            single = [place for place in self.places[name] if self.terms[place] is not None]
            picked.append(min(single, key=lambda place: self.left([*picked, place])[0]))
        weights = self.left(picked)[1]
        terms = [(self.terms[place], weight) for place, weight in zip(picked, weights.tolist(), strict=True)]
        return Proposal(Law(tuple(Term(t.name, (weight, *t.inner)) for t, weight in terms if t is not None)), bic)


def _dictionary(runs: Sequence[DrivenRun], fit: ModelFit, names: Sequence[str]) -> _Dictionary:
    columns: list[FloatArray] = []
    terms: list[Term | None] = []
    fitted = {term.name: term for term in fit.law.terms}
    for turn, share in enumerate(SCALES):
        silent = [_silent(name, share, fit) for name in names if name not in fitted]
        law = fit.law + Law(tuple(term for term in silent if turn == 0 or term.inner))
        model = model_of(runs, fit, law)
        errors = model.evaluate(vector_of(fit, law))
        place, of_law = model.n_head, slice(model.n_head, model.n_head + law.vector.size)
        if turn == 0:
            others = np.delete(errors.jacobian, of_law, axis=1)
            basis = np.linalg.qr(others / np.maximum(np.linalg.norm(others, axis=0), 1e-300))[0]
            target = errors.stacked.copy()
        for term in law.terms:
            if term.name not in fitted:
                columns.append(errors.jacobian[:, place])
                terms.append(term)
            elif turn == 0:
                columns += list(errors.jacobian[:, place : place + len(term.values)].T)
                terms += [term, *(None for _ in term.inner)]
                target -= term.amplitude * errors.jacobian[:, place]
            place += len(term.values)
    matrix = np.stack(columns, axis=1)
    matrix -= basis @ (basis.T @ matrix)
    target -= basis @ (basis.T @ target)
    size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    matrix /= size
    places: dict[str, list[int]] = {}
    owner = ""
    for place, entry in enumerate(terms):
        owner = entry.name if entry is not None else owner
        places.setdefault(owner, []).append(place)
    return _Dictionary(tuple(terms), places, target, matrix.T @ matrix, matrix.T @ target, size)


def _silent(name: str, share: float, fit: ModelFit) -> Term:
    """Return a term of amplitude zero whose inner scale is a share of the rms motion."""
    values = [0.0]
    for parameter in LAWS[name].parameters[1:]:
        if parameter.role == "scale":
            values.append(share * float((fit.velocity if parameter.unit == "m/s" else fit.travel).std()))
        else:
            values.append(parameter.default)
    return Term(name, tuple(values))


def _fitted(
    runs: Sequence[DrivenRun],
    current: ModelFit,
    names: Sequence[str],
    most_terms: int,
    tried: set[str],
    say: Callable[[str], None],
) -> list[ModelFit]:
    """Fit the laws one step away that may be better, or no worse by a margin; larger ones if no other will do."""
    n_terms = len(current.law.terms)
    fits: list[ModelFit] = []
    found = proposals(runs, current, names, most_terms=most_terms)
    # what the error margin asks of a larger law, so that a smaller one has its chance
    in_error = -2 * current.n_data * float(np.log1p(-ERROR_MARGIN))
    for grow in (False, True):
        n_fitted = 0
        for proposal in found:
            more = len(proposal.law.terms) - n_terms
            bar = min([current, *fits], key=lambda fit: fit.bic).bic
            allowed = bar + (in_error if more < 0 else BIC_MARGIN if more == 0 else -BIC_MARGIN)
            if (more > 0) != grow or proposal.law.name in tried or proposal.bic > allowed or n_fitted == N_REFITTED:
                continue
            say(proposal.law.name)
            fit = _refitted(runs, current, proposal.law)
            fits += [fit] if fit is not None else []
            n_fitted += 1
        if any(better(fit, current) for fit in fits):
            break
    return fits


def _refitted(runs: Sequence[DrivenRun], current: ModelFit, law: Law) -> ModelFit | None:
    try:
        return refit(runs, current, law)
    except UnboundedResponseError:
        return None


def judged_by_left_out(runs: Sequence[DrivenRun], ladder: tuple[LadderStep, ...]) -> tuple[LadderStep, ...]:
    """Return the ladder with the left-out errors of its kept rungs; the choice goes back where they say so.

    Args:
        runs: one `DrivenRun` a run.
        ladder: fitted laws.
    """
    return ladder


__all__ = ["Proposal", "better", "library", "proposals", "pursue_law", "refit", "replace", "left_out_error"]
