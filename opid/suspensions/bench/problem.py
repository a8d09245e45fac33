"""The search problem for the law of a bench record: candidates beside a fit, other laws, stretches that are left out.

Everything except the inner parameters enters the force linearly, so the columns of candidates are their shapes, and
every fit is separable least squares. Memories are followed through the whole record. Neighbouring samples of the
residual are correlated, so the criteria count independent samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from opid.mechanics.laws.law import LAWS, LINEAR, FitOfOneLaw, Law
from opid.mechanics.memory import RecordedMotion, recorded_motion
from opid.progress import Say
from opid.signals.recording import FloatArray
from opid.suspensions.bench.record import Bench
from opid.suspensions.bench.settings import BenchSettings
from opid.suspensions.fitting.least_squares import SeparableFit, fit_separable, independent_samples
from opid.suspensions.law_search.dictionary import LawDictionary, Node, make_dictionary, orthonormal
from opid.suspensions.law_search.pursuit import LawStep, add_neighbours, chosen, is_better, search_laws
from opid.suspensions.model.law_parameters import has_slope, list_terms, pulls_at_a_stop
from opid.suspensions.settings import SearchSettings


@dataclass(frozen=True, eq=False)
class Points:
    """The samples of the search.

    Args:
        sample: (m,) their indices in the record, in the order of time.
        fold: (m,) the turn in which each is left out.
        motion: (m,) travel and velocity, and the record that they are taken from.
        y: (m,) force, N.
        columns: (m, n_straight) columns that enter linearly, see `Bench.columns`.
    """

    sample: NDArray[np.int64]
    fold: NDArray[np.int64]
    motion: RecordedMotion
    y: FloatArray
    columns: FloatArray

    @cached_property
    def force_rms(self) -> float:
        """Rms of the force about its mean, N."""
        return float(self.y.std())

    def part(self, chosen: NDArray[np.bool_]) -> Points:
        """Return some of the samples."""
        motion = self.motion.part(chosen)
        return Points(self.sample[chosen], self.fold[chosen], motion, self.y[chosen], self.columns[chosen])

    def slopes(self, law: Law) -> FloatArray:
        """Return the derivatives of the force by linear parameters, the law, and the initial values of memories."""
        return np.concatenate(
            [self.columns, self.motion.parameter_gradient(law), self.motion.start_columns(law)], axis=1
        )


@dataclass(frozen=True, eq=False)
class BenchFit(FitOfOneLaw):
    """A law fitted to a bench record, beside stiffness, damping and an offset.

    Args:
        points: samples that it was fitted to.
        separable: the fit.
        n_independent: number of independent samples in residuals of this record.
        settings: settings of the bench.
    """

    points: Points
    separable: SeparableFit
    n_independent: float
    settings: BenchSettings

    @property
    def law(self) -> Law:
        """The law with its fitted values."""
        return self.separable.law

    @property
    def n_data(self) -> int:
        """Number of independent samples."""
        return round(self.n_independent)

    @cached_property
    def error_rms(self) -> float:
        """Rms of the residual, N, not below the rounding error of the force."""
        return max(float(np.sqrt(np.mean(self.separable.residual**2))), 1e-9 * self.points.force_rms)

    @property
    def bic(self) -> float:
        """Bayesian information criterion (Schwarz 1978) with independent samples: smaller is better."""
        fit = self.separable
        n_parameters = fit.weights.size + fit.start_weights.size + fit.law.vector.size
        return float(2 * self.n_independent * np.log(self.error_rms) + n_parameters * np.log(self.n_independent))

    @property
    def r2(self) -> float:
        """Fraction of the variance of the force that the law explains."""
        return self.r2_of(self.error_rms)

    def r2_of(self, error_rms: float) -> float:
        """Return the fraction of the variance of the force that is explained with an error of this rms, N."""
        return 1 - (error_rms / self.points.force_rms) ** 2

    @property
    def error_left_out(self) -> float:
        """Rms of `left_out`, N."""
        return float(np.sqrt(np.mean(self.left_out**2)))

    @property
    def r2_left_out(self) -> float:
        """Fraction of the variance of the force that is explained on stretches that were left out."""
        return self.r2_of(self.error_left_out)

    @cached_property
    def left_out(self) -> FloatArray:
        """(m,) residual of each stretch of time in a fit to the others, N.

        No other stretch shows the initial value of a memory, so its force is that of the fit to all.
        """
        points, law = self.points, self.law
        start = points.motion.start_columns(law) @ self.separable.start_weights
        errors = np.empty_like(points.y)
        for turn in range(self.settings.n_folds):
            here = points.fold == turn
            tolerance = self.settings.left_out_tolerance
            part = fit_law(points.part(~here), law, self.n_independent, self.settings, tolerance)
            predicted = points.columns[here] @ part.weights + points.motion.part(here).force(part.law) + start[here]
            # If the law is not defined on the motion that was left out (beyond a stroke), it predicts zero.
            errors[here] = points.y[here] - np.where(np.isfinite(predicted), predicted, 0.0)
        return errors


Ladder = tuple[LawStep[BenchFit], ...]
"""The laws that were tried, in order; the last one that was kept is the choice."""


@dataclass(frozen=True, eq=False)
class BenchLaws:
    """A `LawProblem` of fits to a bench record.

    Args:
        points: samples of the record.
        kinds: the kinds that the law may consist of.
        known: settings of the bench.
    """

    points: Points
    kinds: tuple[str, ...]
    known: BenchSettings

    @property
    def settings(self) -> SearchSettings:
        """Settings of the search."""
        return self.known.search

    @cached_property
    def nodes(self) -> dict[str, list[Node]]:
        """Columns of each kind at a few inner parameters, without kinds that are not defined on this motion."""
        points, known = self.points, self.known
        motion = points.motion
        travel, velocity = (max(float(np.sqrt(np.mean(each**2))), 1e-12) for each in (motion.z, motion.v))
        nodes: dict[str, list[Node]] = {}
        for kind in self.kinds:
            for term in list_terms(
                kind,
                travel_rms=travel,
                velocity_rms=velocity,
                n_scales=known.search.n_scales,
                fractions=known.search.scale_fractions,
                lags=known.search.lags,
                # The exponent of a memory is no power of the motion.
                exponents=() if LAWS[kind].memory is not None else known.exponents,
            ):
                columns = -motion.parameter_gradient(Law((term,)))
                if np.abs(columns).max() < known.largest_column:  # which nan is not
                    slope = columns[:, 1] * term.inner[0] if has_slope(term.kind) else None
                    nodes.setdefault(kind, []).append(Node(term, columns[:, 0], slope))
        return nodes

    @cached_property
    def n_independent(self) -> float:
        """Number of independent samples in the residual of all candidates, common to all fits and their criteria."""
        shapes = [node.column for row in self.nodes.values() for node in row]
        # As many columns as samples would explain any record.
        most = self.points.y.size // 4
        basis = orthonormal(np.column_stack([self.points.columns, *shapes[:: -(-len(shapes) // most) or 1]]))
        return independent_samples(self.points.y - basis @ (basis.T @ self.points.y))

    def linear_fit(self) -> BenchFit:
        """Return the fit of stiffness, damping and offset alone."""
        return self._fit(LINEAR)

    def dictionaries(self, fit: BenchFit, kinds: Sequence[str]) -> dict[str, LawDictionary]:
        """Return the candidates beside a fit."""
        law, points = fit.law, self.points
        new = {kind: self.nodes[kind] for kind in kinds if kind in self.nodes and kind not in law.parameters}
        by_law = -points.motion.parameter_gradient(law)
        straight = np.concatenate([points.columns, points.motion.start_columns(law)], axis=1)
        dictionary = make_dictionary(
            law, fit.separable.residual, by_law, straight, new, self.settings, n_data=fit.n_data
        )
        return {"": dictionary}

    def refit(self, fit: BenchFit, laws: Mapping[str, Law]) -> BenchFit | None:
        """Fit another law, with its inner parameters searched from their present values.

        None if a memory would feed energy in, because together with a damping it would imitate an acceleration, or if a
        stop would pull.
        """
        found = self._fit(laws[""])
        return found if _is_mechanics(found) else None

    def restart(self, fit: BenchFit) -> BenchFit:
        """Return the best of a fit and of fits from near its scales, in which memories begin with their default shapes.

        The force of several sliders bends where one slider after the other begins to slip, and the squared error has a
        minimum on either side of each bend.
        """
        fits, law = [fit], fit.law
        remembers = [term.kind.memory is not None for term in law.terms for _ in term.values]
        for factor in self.known.restart_scales:
            vector = law.vector.copy()
            for k in np.flatnonzero(remembers):
                parameter = law.parameter_list[k]
                if parameter.role in ("exponent", "shape") and parameter.unit == "1":
                    vector[k] = parameter.default
                elif parameter.role == "scale":
                    vector[k] *= factor
            fits.append(self._fit(law.with_vector(vector)))
        return min((each for each in fits if _is_mechanics(each)), key=lambda each: each.error_rms, default=fit)

    def left_out(self, fit: BenchFit) -> float:
        """Return the rms error on stretches of time in fits to the others, N."""
        return fit.error_left_out

    def confirms(self, fit: BenchFit, than: BenchFit) -> bool:
        """Return whether the stretches that were left out confirm that a law is better.

        A law of more terms must predict them better by more than chance; a law of as many terms must not be worse by
        the error margin.
        """
        if len(fit.law.terms) == len(than.law.terms):
            return fit.error_left_out < (1 + self.settings.error_margin) * than.error_left_out
        falls = np.bincount(self.points.fold, than.left_out**2 - fit.left_out**2)
        with np.errstate(over="ignore"):  # the motion of a spoiled record may lie far beyond the fitted stretches
            return float(falls.sum()) > float(falls.std(ddof=1) * np.sqrt(falls.size))

    def _fit(self, law: Law) -> BenchFit:
        n_independent = self.n_independent
        return BenchFit(self.points, fit_law(self.points, law, n_independent, self.known), n_independent, self.known)


def _is_mechanics(fit: BenchFit) -> bool:
    law = fit.law
    remembers = [term for term in law.terms if term.kind.memory is not None]
    return all(term.amplitude >= 0 for term in remembers) and not pulls_at_a_stop(law)


def thin_record(bench: Bench, settings: BenchSettings) -> Points:
    """Return at most `n_search` samples of a record, at uneven steps that cannot be in phase with the motion."""
    counted = bench.samples
    n = counted.size
    step = -(-n // settings.n_search)
    first = np.arange(n // step) * step
    # Multiples of the golden section fill every step evenly.
    index = first + np.floor(step * ((np.arange(first.size) * (np.sqrt(5) - 1) / 2) % 1)).astype(np.int64)
    sample = counted[index]
    fold = (np.arange(sample.size) * settings.n_stretches) // sample.size % settings.n_folds
    whole = recorded_motion(bench.travel, bench.velocity, bench.fs, steps_per_rms=settings.steps_per_rms)
    return Points(sample, fold, whole.part(sample), bench.force[sample], bench.columns[sample])


def all_points(bench: Bench) -> Points:
    """Return every sample of a record that counts."""
    sample = bench.samples
    fold = np.zeros(sample.size, dtype=np.int64)
    return Points(sample, fold, bench.motion.part(sample), bench.force[sample], bench.columns[sample])


def fit_law(
    points: Points, law: Law, n_independent: float, settings: BenchSettings, tolerance: float = 1e-7
) -> SeparableFit:
    """Return the fit of a law and of the linear columns; prior knowledge of exponents counts as data."""
    fit = partial(
        fit_separable,
        points.columns,
        motion=points.motion,
        y=points.y,
        free_exponents=True,
        tolerance=tolerance,
        settings=settings.separable,
    )
    found = fit(law=law, starts=[law])
    if any(parameter.known for parameter in law.parameter_list):
        # The weight of prior knowledge follows from the residual of the first fit.
        noise = residual_worth(found.residual, n_independent)
        found = fit(law=law, starts=[found.law, law], noise=noise)
    return found


def residual_worth(residual: FloatArray, n_independent: float) -> float:
    """Return the standard deviation of an independent sample of a residual, N: correlated samples count less."""
    return float(np.sqrt(np.sum(residual**2) / n_independent))


def search_record(problem: BenchLaws, kinds: tuple[str, ...], say: Say) -> Ladder:
    """Return the laws that were tried and those closest to the choice, with their left-out errors."""
    say("the linear law")
    ladder = search_laws(problem, problem.linear_fit(), kinds=kinds, progress=say)
    say("the laws that come closest")
    neighbours = add_neighbours(problem, ladder, kinds=kinds)[: -len(ladder)]
    best = chosen(ladder)
    for step in neighbours:
        # A neighbour may fit better than its columns predict.
        if is_better(step.fit, best.fit, problem.settings) and problem.confirms(step.fit, best.fit):
            best = step
    if best.fit.law.has_memory:
        best = replace(best, fit=problem.restart(best.fit))
    tried = [step for step in (*ladder, *neighbours) if step.law_name != best.law_name]
    # The last step that was kept is the choice.
    in_order = (*tried, replace(best, kept=True))
    asked = [step for step in in_order if step.kept]
    for has_memory in (False, True):
        alike = [each for each in in_order if each.fit.law.has_memory is has_memory]
        asked += sorted(alike, key=lambda each: each.fit.bic)[: problem.known.n_left_out]
    return tuple(
        replace(step, left_out=problem.left_out(step.fit)) if any(step is each for each in asked) else step
        for step in in_order
    )


def end_on_defined(bench: Bench, ladder: Ladder) -> Ladder:
    """Return the ladder that ends on the best law which is finite at every sample of the record.

    A memory without a bound (Bouc-Wen with a shape below -1/2) may grow without end where the search, which follows it
    in longer steps, saw it turn back.
    """
    motion, choice = bench.motion, chosen(ladder)
    for step in (choice, *sorted(ladder, key=lambda step: step.fit.bic)):
        law = step.fit.law
        if not law.has_memory or all(
            np.isfinite(each).all() for each in (motion.parameter_gradient(law), motion.start_columns(law))
        ):
            return ladder if step is choice else end_on(ladder, step)
    return ladder


def end_on(ladder: Ladder, step: LawStep[BenchFit]) -> Ladder:
    """Return the ladder with another choice as its last step."""
    return (*(each for each in ladder if each is not step), replace(step, kept=True))
