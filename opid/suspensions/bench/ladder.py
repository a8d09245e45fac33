"""Which law a bench record holds: forward selection, a look back, and the ladder of all that was tried.

Every law is fitted by separable least squares (inner scales and exponents are estimated) and judged twice: by the
Bayesian information criterion with the independent samples of the residual in place of their number (Schwarz 1978),
and by the force on stretches of time that were left out. A term enters only if both agree; then each term is taken out
again, and exchanged for every other kind, on trial.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from opid.mechanics.laws import LINEAR, Law, default_law
from opid.signals.recording import FloatArray
from opid.suspensions.bench.record import Bench
from opid.suspensions.separable import START_SHARES, SeparableFit, independent_samples, separable_fit, started

# samples that the search looks at; the chosen law is fitted to all
N_SEARCH = 5000
# stretches of time that are left out by turns, so many of them at once
N_STRETCHES, N_FOLDS = 30, 10
BIC_MARGIN = 10.0
# a term that lowers the unexplained rms by less corrects the shape of another one
RMS_MARGIN = 0.01
# a residual this far below the force is rounding
ROUNDING = 1e-9


@dataclass(frozen=True)
class Rung:
    """One law that was tried on a bench record.

    Args:
        law_name: its name.
        r2: share of the variance of the force that it explains.
        r2_left_out: the same on stretches of time that were left out of the fit.
        bic: criterion, with the independent samples of the chosen law's residual for every rung; smaller is better.
        kept: whether the search went on from here.
        chosen: whether it is the answer.
    """

    law_name: str
    r2: float
    r2_left_out: float
    bic: float
    kept: bool
    chosen: bool


@dataclass(frozen=True, eq=False)
class Points:
    """The samples that the search looks at.

    Args:
        sample: (m,) their places in the record, in order of time.
        fold: (m,) the turn in which each is left out.
        z: (m,) travel, m.
        v: (m,) velocity, m/s.
        y: (m,) force, N.
        columns: (m, 3) what enters linearly: travel, velocity, one.
    """

    sample: np.ndarray
    fold: np.ndarray
    z: FloatArray
    v: FloatArray
    y: FloatArray
    columns: FloatArray

    @property
    def total(self) -> float:
        """Sum of squares of the force about its mean."""
        return float(np.sum((self.y - self.y.mean()) ** 2))

    def part(self, chosen: np.ndarray) -> Points:
        """Return some of the samples."""
        names = ("sample", "fold", "z", "v", "y", "columns")
        return Points(*(getattr(self, name)[chosen] for name in names))


@dataclass(frozen=True, eq=False)
class Trial:
    """One fitted law of the search.

    Args:
        fit: of all the samples.
        left_out: (m,) what it leaves of each stretch of time when fitted to the others, N.
        n_independent: independent samples of the residual.
        kept: whether the search went on from here.
    """

    fit: SeparableFit
    left_out: FloatArray
    n_independent: float
    kept: bool = False

    @property
    def names(self) -> list[str]:
        """Kinds of the law."""
        return [term.name for term in self.fit.law.terms]

    def r2_left_out(self, points: Points) -> float:
        """Share of the variance of the force that is explained where it was left out."""
        return 1 - float(self.left_out @ self.left_out) / points.total


def straight_columns(z: FloatArray, v: FloatArray) -> FloatArray:
    """Return what enters linearly: travel, velocity and one.

    Args:
        z: (n,) travel, m.
        v: (n,) velocity, m/s.

    Returns:
        (n, 3).
    """
    return np.stack([z, v, np.ones_like(z)], axis=1)


def thinned(bench: Bench) -> Points:
    """Take at most `N_SEARCH` samples, unevenly: an even step could keep time with a periodic motion.

    Args:
        bench: the record.
    """
    n = bench.force.size
    step = -(-n // N_SEARCH)
    first = np.arange(n // step) * step
    # multiples of the golden section fill every step evenly
    sample = first + np.floor(step * ((np.arange(first.size) * (np.sqrt(5) - 1) / 2) % 1)).astype(np.int64)
    # several stretches to a fold: one strong event does not fall into one fold
    fold = (np.arange(sample.size) * N_STRETCHES) // sample.size % N_FOLDS
    z, v = bench.travel[sample], bench.velocity[sample]
    return Points(sample, fold, z, v, bench.force[sample], straight_columns(z, v))


def _fitted(points: Points, starts: list[Law]) -> SeparableFit:
    return separable_fit(points.columns, starts[0], points.z, points.v, points.y, starts=starts, free_exponents=True)


def _judged(points: Points, fit: SeparableFit) -> Trial:
    """Fit the law again to all but each stretch of time, and predict that."""
    left_out = np.empty_like(points.y)
    for each in range(N_FOLDS):
        here = points.fold == each
        part = _fitted(points.part(~here), [fit.law])
        predicted = points.columns[here] @ part.weights + part.law.force(points.z[here], points.v[here])
        # where the law is not defined on the left-out motion (beyond a stroke) it predicts nothing
        left_out[here] = points.y[here] - np.where(np.isfinite(predicted), predicted, 0.0)
    return Trial(fit, left_out, independent_samples(fit.residual))


def _grown(points: Points, law: Law, name: str) -> SeparableFit:
    """Fit a law with one more kind, its scales begun at several places."""
    additions = [started(default_law(name), points.z, points.v, share) for share in START_SHARES]
    return _fitted(points, [law + addition for addition in dict.fromkeys(additions)])


def _shrunk(points: Points, law: Law, name: str) -> SeparableFit:
    return _fitted(points, [Law(tuple(term for term in law.terms if term.name != name))])


def _bic(fit: SeparableFit, n: float) -> float:
    n_parameters = fit.weights.size + fit.law.vector.size
    return n * float(np.log(max(_squares(fit), 1e-300) / fit.residual.size)) + n_parameters * float(np.log(n))


def _cost(fit: SeparableFit, n: float) -> float:
    """Return the criterion with the margin for every inner parameter: of laws that fit alike the plainer is taken."""
    return _bic(fit, n) + BIC_MARGIN * (fit.law.vector.size - len(fit.law.terms))


def _squares(fit: SeparableFit) -> float:
    return float(fit.residual @ fit.residual)


def _enters(points: Points, smaller: Trial, larger: Trial) -> bool:
    """Whether criterion and prediction agree that the larger law is better."""
    falls = np.bincount(points.fold, smaller.left_out**2) - np.bincount(points.fold, larger.left_out**2)
    error = float(falls.std(ddof=1) * np.sqrt(N_FOLDS))
    n = larger.n_independent
    return (
        _bic(smaller.fit, n) - _bic(larger.fit, n) > BIC_MARGIN
        and _squares(larger.fit) < (1 - RMS_MARGIN) ** 2 * _squares(smaller.fit)
        and float(falls.sum()) > error
        and _squares(smaller.fit) > ROUNDING**2 * points.total
    )


def searched(points: Points, kinds: tuple[str, ...], most_terms: int, say: Callable[[str], None]) -> list[Trial]:
    """Add terms while criterion and prediction agree; return every trial in order, each rung's from the best on.

    Args:
        points: the samples.
        kinds: that may be added.
        most_terms: at the most.
        say: called with the name of each step as it begins.
    """
    say("the straight law")
    current = replace(_judged(points, _fitted(points, [LINEAR])), kept=True)
    trials = [current]
    while len(current.names) < most_terms:
        tried = []
        for name in kinds:
            if name not in current.names:
                say(f"{current.fit.law.name} and {name}")
                tried.append(_judged(points, _grown(points, current.fit.law, name)))
        n = max((trial.n_independent for trial in tried), default=1.0)
        tried.sort(key=lambda trial: _cost(trial.fit, n))
        best = next((i for i, trial in enumerate(tried) if _enters(points, current, trial)), None)
        trials += [replace(trial, kept=i == best) for i, trial in enumerate(tried)]
        if best is None:
            break
        current = replace(tried[best], kept=True)
    return trials


def revised(
    points: Points, current: Trial, kinds: tuple[str, ...], say: Callable[[str], None]
) -> tuple[list[Trial], list[tuple[str, str]]]:
    """Take terms out again and exchange them, until nothing improves.

    Args:
        points: the samples.
        current: the trial that the search ended on.
        kinds: that may stand in for a term.
        say: called with the name of each step as it begins.

    Returns:
        The further trials that were kept, and the pairs (term, other kind) that the record cannot tell apart.
    """
    steps: list[Trial] = []
    for _ in range(2 * len(current.names)):
        say(f"each term of {current.fit.law.name} on trial")
        without = {name: _judged(points, _shrunk(points, current.fit.law, name)) for name in current.names}
        idle = [trial for trial in without.values() if not _enters(points, trial, current)]
        if idle:
            current = replace(min(idle, key=lambda trial: _squares(trial.fit)), kept=True)
            steps.append(current)
            continue
        n = current.n_independent
        others = [name for name in kinds if name not in current.names]
        exchanged = {
            (name, other): _grown(points, rest.fit.law, other) for name, rest in without.items() for other in others
        }
        best = min(exchanged.values(), key=lambda fit: _cost(fit, n), default=current.fit)
        trial = _judged(points, best) if _cost(best, n) < _cost(current.fit, n) else current
        if trial is current or np.sum(trial.left_out**2) > (1 + RMS_MARGIN) * np.sum(current.left_out**2):
            alike = [pair for pair, fit in exchanged.items() if _bic(fit, n) < _bic(current.fit, n) + BIC_MARGIN]
            return steps, alike
        current = replace(trial, kept=True)
        steps.append(current)
    return steps, []


def ladder_of(points: Points, trials: list[Trial], answer: Trial) -> tuple[Rung, ...]:
    """Return what is worth telling of the trials.

    Args:
        points: the samples.
        trials: in order.
        answer: the chosen one of them.
    """
    n = answer.n_independent
    return tuple(
        Rung(
            trial.fit.law.name,
            1 - _squares(trial.fit) / points.total,
            trial.r2_left_out(points),
            _bic(trial.fit, n),
            trial.kept,
            trial is answer,
        )
        for trial in trials
    )
