"""Which law, by prediction: add, exchange or drop the term that most lowers the prediction error of the driven model.

All candidates are ranked by one simulation a scale: with every one of them in the law at amplitude zero, the
derivatives of the prediction errors by the amplitudes, made orthogonal to what the model can already do, say how far
the error would fall with a term added, exchanged or dropped (a score test, Rao 1948). Laws that could be better, or as
good, are fitted. A larger one must earn its place by the information criterion, by the error and by the prediction of a
run left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.kinds import BUILT_IN, LAWS
from opid.mechanics.laws import LINEAR, Law
from opid.suspensions.one_gear.driven_run import DrivenRun
from opid.suspensions.one_gear.law_dictionary import Proposal, dictionary_of
from opid.suspensions.one_gear.model_fit import ModelFit
from opid.suspensions.one_gear.refit import left_out_error, refit
from opid.suspensions.paper.joint_fit import LadderStep
from opid.suspensions.paper.law_search import BIC_MARGIN

# the fitted error must fall by this share: below, a term only mends what the sensors did
ERROR_MARGIN = 0.005
# laws that are fitted in a round at the most, and rounds at the most
N_REFITTED, N_ROUNDS = 3, 8
# rejected laws that are fitted for the reader
N_NEIGHBOURS = 2
# terms exchanged at once: each of two near relatives can hold the other in place
MOST_EXCHANGED = 2


def library() -> tuple[str, ...]:
    """Return the names of the kinds that a search may use: every registered one, and the built-in ones by their scales.

    Built-in kinds with an exponent or a lag contain others of the library as special cases.
    """
    built_in = {kind.name for kind in BUILT_IN}
    return tuple(
        name
        for name, kind in LAWS.items()
        if kind.searched and (name not in built_in or all(p.role in ("amplitude", "scale") for p in kind.parameters))
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


def with_neighbours(
    runs: Sequence[DrivenRun], ladder: tuple[LadderStep, ...], *, names: Sequence[str] | None = None
) -> tuple[LadderStep, ...]:
    """Add to a ladder what a reader asks next: the linear suspension, and the rejected laws that come closest.

    Args:
        runs: one `DrivenRun` a run.
        ladder: of `pursue_law`; the choice stays.
        names: kinds that may enter; those of `library` where left out.
    """
    best = next(step.fit for step in reversed(ladder) if step.kept)
    assert isinstance(best, ModelFit)  # the rungs of a pursuit are
    tried = {step.law_name for step in ladder}
    closest = [each.law for each in proposals(runs, best, library() if names is None else names)]
    laws = [law for law in (LINEAR, *closest) if law.name not in tried]
    fits = [_refitted(runs, best, law) for law in laws[: N_NEIGHBOURS + (LINEAR.name not in tried)]]
    rungs = [
        LadderStep(fit.law.name, fit, False, road="pursuit", left_out_m_per_s2=left_out_error(runs, fit))
        for fit in fits
        if fit is not None
    ]
    return (*rungs, *ladder)


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


def proposals(runs: Sequence[DrivenRun], fit: ModelFit, names: Sequence[str], *, most_terms: int = 3) -> list[Proposal]:
    """Return the laws near a fitted one - a term more or less, one or two exchanged - the most promising first.

    With b the errors less what the fitted law does to them and D the derivatives by the amplitudes, both orthogonal to
    the derivatives by everything else, the law of the terms S would leave min_a |b + D_S a|^2.

    Args:
        runs: one `DrivenRun` a run.
        fit: the model to depart from.
        names: kinds that may enter.
        most_terms: terms at the most.
    """
    try:
        dictionary = dictionary_of(runs, fit, names)
    except UnboundedResponseError:
        # a model so near its bounds has no neighbours to offer
        return []
    have, others = list(dictionary.fitted), list(dictionary.offered)
    moves = [tuple(kept) for kept in combinations(have, max(len(have) - 1, 0))] if have else []
    for n_exchanged in range(1, min(len(have), MOST_EXCHANGED) + 1):
        for kept in combinations(have, len(have) - n_exchanged):
            moves += [(*kept, *new) for new in combinations(others, n_exchanged)]
    moves += [(*have, new) for new in others] if len(have) < most_terms else []
    return sorted((dictionary.proposal(move) for move in moves), key=lambda proposal: proposal.bic)


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


def judged_by_left_out(runs: Sequence[DrivenRun], ladder: Sequence[LadderStep]) -> tuple[LadderStep, ...]:
    """Return the ladder with left-out errors: of the choice, its closest rivals and the best law with fewer terms.

    The smaller law is chosen instead where it predicts runs that were left out as well.

    Args:
        runs: one `DrivenRun` a run.
        ladder: fitted laws.
    """
    steps = list(ladder)
    choice = max(place for place, step in enumerate(steps) if step.kept)
    fit = steps[choice].fit
    smaller = [k for k, step in enumerate(steps) if len(step.fit.law.terms) < len(fit.law.terms)]
    below = min(smaller, key=lambda k: steps[k].fit.bic) if smaller else None
    rivals = [k for k, step in enumerate(steps) if step.fit.bic < fit.bic + BIC_MARGIN and k not in (choice, below)]
    for k in [choice, *([] if below is None else [below]), *rivals]:
        each = steps[k].fit
        if isinstance(each, ModelFit):
            steps[k] = replace(steps[k], left_out_m_per_s2=left_out_error(runs, each))
    if below is not None:
        with_it, without = steps[choice].left_out_m_per_s2, steps[below].left_out_m_per_s2
        if with_it is not None and without is not None and without <= with_it:
            # the last one that was kept is the choice
            steps.append(replace(steps.pop(below), kept=True))
    return tuple(steps)
