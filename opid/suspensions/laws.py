"""Which law each suspension has: terms that would explain more of the errors, scored before they are fitted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.kinds import LAWS
from opid.mechanics.laws import Law, Term
from opid.signals.recording import FloatArray
from opid.suspensions.fit import BodyFit, fit_body, typical_motion, with_laws
from opid.suspensions.levenberg_marquardt import MOST_EVALUATIONS
from opid.suspensions.model import Group
from opid.suspensions.one_gear.pursuit import library
from opid.suspensions.paper.joint_fit import BIC_MARGIN
from opid.suspensions.structure import ImpossibleBodyError

# inner scales at which terms are scored, over the rms motion
SCALES = (0.15, 0.5, 1.5)
# force of a term that is scored, over the noise
FAINT = 1e-5
# a term is fitted if it promises to lower the squared error over its variance by this
LEAST_PROMISE = 25.0
# a term whose amplitude is known to less than the root of this is tried without
LEAST_WALD = 25.0
MOST_ROUNDS = 4
# noise that would explain the errors over the one assumed: beyond, laws mend nothing unless they promise a good share
HOPELESS, GOOD_SHARE = 20.0, 0.05
# refits of one round at the most that may fail to help
MOST_FAILURES = 2
# terms whose forces, less what spring and damper make of them, correlate by more than this bend alike
ALIKE = 0.8
# a fit on the way ends when the next step promises less than this of the squared error over its variance
ENOUGH = 1.0


@dataclass(frozen=True)
class Promise:
    """What a further term would do, to first order.

    Args:
        gain: how far it would lower the squared error over its variance.
        group: name of the group.
        term: the term, too weak to move anything.
        amplitude: that it would have.
    """

    gain: float
    group: str
    term: Term
    amplitude: float


@dataclass(frozen=True)
class LawStep:
    """One law of all suspensions that was tried.

    Args:
        law: by the name of the group.
        bic: of the fit.
        level: noise that would explain its errors, m/s^2.
        kept: whether the search went on from here.
        fs: rate of the runs that it was fitted to, Hz: criteria at one rate compare.
    """

    law: dict[str, str]
    bic: float
    level: float
    kept: bool
    fs: float


def search_laws(
    fit: BodyFit, *, kinds: Sequence[str] | None = None, progress: Callable[[str], None] | None = None
) -> tuple[BodyFit, tuple[LawStep, ...]]:
    """Add terms to the laws as long as the criterion asks for them, and drop those that it does not.

    A round drops what is hardly there and adds to every suspension the term that promises most, all at once; where that
    does not help, one at a time.

    Args:
        fit: where to start.
        kinds: that are tried; those of `opid.suspensions.one_gear.pursuit.library` where left out.
        progress: called with the name of each step as it begins.
    """
    search = _Search(fit, progress or (lambda step: None))
    tried = tuple(kinds or library())
    for _ in range(MOST_ROUNDS):
        smaller = search.without_the_weak()
        if not search.with_more(tried) and not smaller:
            break
        # no law mends what a wrong structure leaves
        if is_hopeless(search.best):
            break
    return search.best, tuple(search.steps)


def is_hopeless(fit: BodyFit) -> bool:
    """Return whether a fit leaves what is beyond the mending of laws.

    Args:
        fit: of any laws.
    """
    return fit.variance > HOPELESS**2


class _Search:
    """Where a search stands."""

    def __init__(self, fit: BodyFit, say: Callable[[str], None]) -> None:
        self.best, self.say = fit, say
        self.steps = [_step(fit, kept=True)]
        self.failed: set[tuple[str, str]] = set()
        self.asked: BodyFit | None = None

    def without_the_weak(self) -> bool:
        """Drop terms whose amplitudes are hardly known; say whether any went."""
        weak = [] if is_hopeless(self.best) else _weak(self.best)
        if len(weak) > 1 and self._take(_without(self.best, weak), f"without {len(weak)} weak terms", BIC_MARGIN):
            return True
        return any(
            self._take(_without(self.best, [one]), f"without {one[1].name} at {one[0]}", BIC_MARGIN)
            for one in weak[:MOST_FAILURES]
        )

    def with_more(self, kinds: Sequence[str]) -> bool:
        """Add terms that promise to explain more; say whether any helped."""
        # asked before, in vain
        if self.best is self.asked:
            return False
        self.asked = self.best
        promises = [each for each in _promises(self.best, kinds) if (each.group, each.term.name) not in self.failed]
        promises = [each for each in promises if each.gain > LEAST_PROMISE]
        first: dict[str, Promise] = {}
        for each in promises:
            first.setdefault(each.group, each)
        if is_hopeless(self.best) and sum(each.gain for each in first.values()) < GOOD_SHARE * self.best.n_data:
            return False
        if any(_alike(self.best, each) for each in first.values()) and self._take(
            _in_place(self.best, first.values()), f"other terms at {', '.join(first)}", -BIC_MARGIN
        ):
            return True
        if len(first) > 1 and self._take(
            _with(self.best, first.values()), f"more terms at {', '.join(first)}", -BIC_MARGIN
        ):
            self.without_the_old(first.values())
            return True
        for each in promises[:MOST_FAILURES]:
            if self._take(_with(self.best, [each]), f"{each.term.name} at {each.group}", -BIC_MARGIN):
                self.without_the_old([each])
                return True
            self.failed.add((each.group, each.term.name))
        return False

    def without_the_old(self, new: Iterable[Promise]) -> None:
        """Drop terms that a new one stands for: two of a kind are each well known along the ridge between them."""
        old = [(each.group, term) for each in new for term in _alike(self.best, each)]
        if len(old) > 1 and self._take(_without(self.best, old), "without what the new terms stand for", BIC_MARGIN):
            return
        for name, term in old:
            self._take(_without(self.best, [(name, term)]), f"without {term.name} at {name}", BIC_MARGIN)

    def _take(self, groups: Sequence[Group], what: str, margin: float) -> bool:
        """Fit other laws, and keep them if the criterion rises by less than a margin."""
        self.say(what)
        try:
            trial = fit_body(
                *with_laws(self.best.model, self.best.theta, groups),
                most_evaluations=MOST_EVALUATIONS,
                least_promise=ENOUGH,
            )
        except (UnboundedResponseError, ImpossibleBodyError):
            return False
        kept = trial.bic < self.best.bic + margin
        self.steps.append(_step(trial, kept=kept))
        if kept:
            self.best = trial
        return kept


def _step(fit: BodyFit, *, kept: bool) -> LawStep:
    return LawStep(
        {group.name: group.law.name for group in fit.model.groups}, fit.bic, fit.level, kept, fit.model.runs[0].fs
    )


def _weak(fit: BodyFit) -> list[tuple[str, Term]]:
    """Terms whose amplitude is hardly known, with the name of their group, the weakest first."""
    std = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    found = []
    for number, group in enumerate(fit.groups()):
        place = fit.model.law_places(number).start
        for term in group.law.terms:
            wald = (fit.theta[place] / max(std[place], 1e-300)) ** 2
            place += len(term.values)
            if wald < LEAST_WALD:
                found.append((wald, group.name, term))
    return [(name, term) for _, name, term in sorted(found, key=lambda each: each[0])]


def _without(fit: BodyFit, weak: Sequence[tuple[str, Term]]) -> tuple[Group, ...]:
    gone = {(name, term.name) for name, term in weak}
    return tuple(
        replace(group, law=Law(tuple(term for term in group.law.terms if (group.name, term.name) not in gone)))
        for group in fit.groups()
    )


def _with(fit: BodyFit, promises: Iterable[Promise]) -> tuple[Group, ...]:
    grown = {each.group: Law((Term(each.term.name, (each.amplitude, *each.term.inner)),)) for each in promises}
    return tuple(
        replace(group, law=group.law + grown[group.name]) if group.name in grown else group for group in fit.groups()
    )


def _bent(term: Term, fit: BodyFit, group: Group) -> FloatArray:
    """What of the force of a term no spring and no damper make, over the motions of a group."""
    travel, velocity = typical_motion(fit.model, group)
    force = Law((term,)).force(travel, velocity)
    straight = np.stack([np.ones_like(travel), travel, velocity], axis=1)
    return np.asarray(force - straight @ np.linalg.lstsq(straight, force, rcond=None)[0])


def _alike(fit: BodyFit, promise: Promise) -> list[Term]:
    """Terms of the group of a promised one, of other kinds, that bend as it does, or against it."""
    group = next(each for each in fit.groups() if each.name == promise.group)
    new, found = _bent(promise.term, fit, group), []
    for term in group.law.terms:
        old = _bent(term, fit, group)
        size = float(np.linalg.norm(new) * np.linalg.norm(old))
        if term.name != promise.term.name and abs(float(old @ new)) > ALIKE * size:
            found.append(term)
    return found


def _in_place(fit: BodyFit, promises: Iterable[Promise]) -> tuple[Group, ...]:
    """Promised terms in place of those that bend alike, as large as these were; others beside what is there."""
    gone = {each.group: _alike(fit, each) for each in promises}
    groups = {group.name: group for group in _without(fit, [(name, term) for name in gone for term in gone[name]])}
    for each in promises:
        amplitude, group = each.amplitude, groups[each.group]
        if gone[each.group]:
            new = _bent(each.term, fit, group)
            old = np.sum([_bent(term, fit, group) for term in gone[each.group]], axis=0)
            amplitude = each.term.values[0] * float(new @ old) / float(new @ new)
        groups[each.group] = replace(group, law=group.law + Law((Term(each.term.name, (amplitude, *each.term.inner)),)))
    return tuple(groups.values())


def _promises(fit: BodyFit, kinds: Sequence[str]) -> list[Promise]:
    """What each further term promises, the most first."""
    groups, found, weight = fit.groups(), [], _weights(fit)
    basis = _orthonormal(fit.errors.jacobian * weight[:, np.newaxis])
    left = fit.errors.stacked * weight
    left = left - basis @ (basis.T @ left)
    for turn, share in enumerate(SCALES):
        offered = {
            group.name: [
                _faint(name, share, fit, group)
                for name in kinds
                if name not in group.law.parameters and (turn == 0 or len(LAWS[name].parameters) > 1)
            ]
            for group in groups
        }
        grown = tuple(replace(group, law=group.law + Law(tuple(offered[group.name]))) for group in groups)
        model, theta = with_laws(fit.model, fit.theta, grown)
        try:
            errors = model.evaluate(theta)
        except UnboundedResponseError:
            continue
        for number, group in enumerate(grown):
            place = model.law_places(number).start
            for term in group.law.terms:
                column = errors.jacobian[:, place] * weight
                place += len(term.values)
                if term.name in groups[number].law.parameters:
                    continue
                rest = column - basis @ (basis.T @ column)
                size = float(rest @ rest)
                if size > 1e-8 * float(column @ column):
                    along = float(rest @ left)
                    found.append(Promise(along**2 / size, group.name, term, -along / size))
    return sorted(found, key=lambda each: -each.gain)


def _weights(fit: BodyFit) -> FloatArray:
    n = fit.n_data
    return np.concatenate([np.full(n, 1 / np.sqrt(fit.variance)), np.ones(fit.errors.stacked.size - n)])


def _orthonormal(columns: FloatArray) -> FloatArray:
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return np.linalg.qr(columns / size)[0]


def _faint(name: str, share: float, fit: BodyFit, group: Group) -> Term:
    """A term too weak to move anything, its inner scale a share of the rms motion."""
    travel_rms, velocity_rms = np.sqrt(np.mean(fit.model.motion_rms[list(group.slots)] ** 2, axis=0))
    inner = [
        share * float(velocity_rms if parameter.unit == "m/s" else travel_rms)
        if parameter.role == "scale"
        else parameter.default
        for parameter in LAWS[name].parameters[1:]
    ]
    force = Law((Term(name, (1.0, *inner)),)).force(np.array([travel_rms]), np.array([velocity_rms]))
    return Term(name, (FAINT * fit.level / max(abs(float(force[0])), 1e-300), *inner))
