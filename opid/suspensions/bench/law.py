"""A law from a test bench: measured force against motion, F = F0 + K z + C z' + f(z, z').

The terms of f are chosen on some thousand samples (`opid.suspensions.bench.ladder`), the chosen law is fitted to all.
The intervals take the residual as it is, correlated over time or not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.estimate import Estimate
from opid.mechanics.laws import LAWS, Law, default_law
from opid.signals.recording import FloatArray
from opid.suspensions.bench.ladder import (
    BIC_MARGIN,
    N_STRETCHES,
    RMS_MARGIN,
    Points,
    Rung,
    ladder_of,
    revised,
    searched,
    straight_columns,
    thinned,
)
from opid.suspensions.bench.memory import Memory, memory_of
from opid.suspensions.bench.record import Bench
from opid.suspensions.covariance import clustered_covariance
from opid.suspensions.separable import SeparableFit, independent_samples, separable_fit

SCHEMA = "opid.law/1"
STRAIGHT = ("stiffness_n_per_m", "damping_n_s_per_m", "offset_n")
# below these shares of the force there is no law: nothing is explained, or memory holds the greater part
LEAST_R2, LEAST_STATIC_R2 = 0.02, 0.5


@dataclass(frozen=True, eq=False)
class BenchLaw:
    """The law of a test bench.

    Args:
        bench: the record that it was fitted to.
        title: name of the record.
        parameters: stiffness_n_per_m K, damping_n_s_per_m C and offset_n F0, one `Estimate` each.
        law: the nonlinear law f, N.
        law_estimates: {kind: {parameter: Estimate}}.
        residual: (n,) force minus fit, N.
        r2: share of the variance of the force that is explained.
        r2_left_out: the same on stretches of time that were left out of the fit.
        ladder: the laws that were tried, in order.
        memory: what no law of travel and velocity can explain.
        n_independent: independent samples that the residual amounts to.
        warnings: what to doubt, one sentence each.
        not_determined: why there is no law, or None.
        settings: what the answer was made with, ready for JSON.
    """

    bench: Bench
    title: str
    parameters: Mapping[str, Estimate]
    law: Law
    law_estimates: Mapping[str, Mapping[str, Estimate]]
    residual: FloatArray
    r2: float
    r2_left_out: float
    ladder: tuple[Rung, ...]
    memory: Memory
    n_independent: float
    warnings: tuple[str, ...]
    not_determined: str | None
    settings: Mapping[str, Any]

    @property
    def residual_rms(self) -> float:
        """Root mean square of the residual, N."""
        return float(np.sqrt(np.mean(self.residual**2)))


def law_of_bench(
    bench: Bench,
    *,
    title: str = "",
    candidates: Sequence[str] | None = None,
    most_terms: int = 4,
    progress: Callable[[str], None] | None = None,
) -> BenchLaw:
    """Find the law of a damper or spring from its measured force and motion.

    Args:
        bench: the record, from `bench_from_recording`.
        title: name of the record.
        candidates: kinds that may be added; None for every kind in `LAWS` that is searched.
        most_terms: terms of f at the most.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: an unknown candidate, or a negative number of terms.
        NotDeterminedError: the chosen law has more parameters than the record has independent samples.

    >>> rng = np.random.default_rng(0)
    >>> z, v = 0.01 * rng.standard_normal(2000), 0.3 * rng.standard_normal(2000)
    >>> force = 2e4 * z + 500 * v + 800 * v * np.abs(v) + 5 * rng.standard_normal(2000)
    >>> names = {"force": "F", "travel": "z", "velocity": "v"}
    >>> bench = Bench(z, v, force, 500.0, 0.0, "recorded", None, names, ())
    >>> found = law_of_bench(bench, candidates=("quadratic_damping", "cubic_damping"))
    >>> found.law.name, found.law_estimates["quadratic_damping"]["damping_n_s2_per_m2"].holds(800)
    ('quadratic_damping', True)
    """
    kinds = tuple(name for name, kind in LAWS.items() if kind.searched) if candidates is None else tuple(candidates)
    for name in kinds:
        default_law(name)  # an unknown one is named here
    if most_terms < 0:
        raise InputError(f"most_terms is {most_terms}: give 0 or more")
    say = progress or (lambda step: None)
    points = thinned(bench)
    trials = searched(points, kinds, most_terms, say)
    steps, rivals = revised(points, [trial for trial in trials if trial.kept][-1], kinds, say)
    trials += steps
    answer = [trial for trial in trials if trial.kept][-1]
    say("the chosen law on all samples")
    fit = separable_fit(
        straight_columns(bench.travel, bench.velocity),
        answer.fit.law,
        bench.travel,
        bench.velocity,
        bench.force,
        starts=[answer.fit.law],
        free_exponents=True,
    )
    say("memory")
    r2_left_out = answer.r2_left_out(points)
    # a ceiling lies above every law that was tried, also above those that were too rich to keep
    least_left = min((trial.left_out for trial in trials), key=lambda left: float(left @ left))
    memory = memory_of(bench, points.sample, points.fold, least_left, noise_like=r2_left_out < LEAST_R2)
    n_independent = independent_samples(fit.residual)
    estimates, cell_s = _estimates(bench, fit, n_independent)
    amplitude = bench.force - bench.force.mean()
    result = BenchLaw(
        bench=bench,
        title=title,
        parameters=dict(zip(STRAIGHT, estimates, strict=False)),
        law=fit.law,
        law_estimates=_law_estimates(fit, estimates[len(STRAIGHT) :]),
        residual=fit.residual,
        r2=1 - float(fit.residual @ fit.residual) / float(amplitude @ amplitude),
        r2_left_out=r2_left_out,
        ladder=ladder_of(points, trials, answer),
        memory=memory,
        n_independent=n_independent,
        warnings=(),
        not_determined=None,
        settings=_settings(bench, kinds, most_terms, points, cell_s),
    )
    return replace(result, warnings=_warnings(result, fit, rivals), not_determined=_reason(result))


def _estimates(bench: Bench, fit: SeparableFit, n_independent: float) -> tuple[list[Estimate], float]:
    """Return value and interval of every parameter, from scores added up over cells longer than the correlation."""
    from scipy import special

    n = bench.force.size
    gradient = fit.law.parameter_gradient(bench.travel, bench.velocity)
    jacobian = np.concatenate([straight_columns(bench.travel, bench.velocity), gradient], axis=1)
    values = np.concatenate([fit.weights, fit.law.vector])
    if n_independent <= 2 * values.size:
        raise NotDeterminedError(
            f"the residual amounts to {n_independent:.0f} independent samples for {values.size} parameters: "
            "record longer"
        )
    length = int(np.clip(8 * n / n_independent, n / 200, n / 20))
    cells = np.arange(n) // length
    covariance = clustered_covariance(jacobian, fit.residual, cells)
    std = np.sqrt(np.maximum(np.diag(covariance), 0))
    # few cells: Student's interval instead of the normal one
    wide = float(special.stdtrit(max(int(cells[-1]) + 1 - values.size, 1), 0.975))
    bound = (*(False,) * len(STRAIGHT), *fit.at_bound)
    estimates = [
        Estimate(float(value))
        if at_bound or not np.isfinite(error)
        else Estimate(float(value), float(error), (float(value - wide * error), float(value + wide * error)))
        for value, error, at_bound in zip(values, std, bound, strict=True)
    ]
    first = len(STRAIGHT)
    for term in fit.law.terms:
        last = first + len(LAWS[term.name].parameters)
        if _has_long_scale(term.name):
            estimates[first:last] = _long_scaled(estimates[first:last])
        first = last
    return estimates, length / bench.fs


def _has_long_scale(kind: str) -> bool:
    """Whether the scale of a kind is longer than the motion, as the column of a gas spring is."""
    return any(p.role == "scale" and p.over_rms[0] > 1 for p in LAWS[kind].parameters)


def _long_scaled(estimates: list[Estimate]) -> list[Estimate]:
    """Return amplitude A and scale h of a force that is a parabola, A z^2 / h^2, unless the motion comes near h.

    What the motion shows are the parabola and, by 1/h, its skewness: the error of 1/h is nearly normal, that of h is
    not. The intervals are therefore symmetric in 1/h and in A^(-1/2). Where that of 1/h reaches zero, any longer h with
    a larger A fits as well, and neither has an interval.
    """
    intervals = []
    for estimate, power in zip(estimates, (2, 1), strict=True):
        value, ends = estimate.value, estimate.interval95
        if value is None or ends is None or not (part := (ends[1] - ends[0]) / (2 * power * abs(value))) < 1:
            return [Estimate(each.value) for each in estimates]
        low, high = sorted((value / (1 + part) ** power, value / (1 - part) ** power))
        intervals.append((low, high))
    return [Estimate(each.value, each.std, ends) for each, ends in zip(estimates, intervals, strict=True)]


def _law_estimates(fit: SeparableFit, estimates: list[Estimate]) -> dict[str, dict[str, Estimate]]:
    rest = iter(estimates)
    return {term.name: {p.name: next(rest) for p in LAWS[term.name].parameters} for term in fit.law.terms}


def _settings(bench: Bench, kinds: tuple[str, ...], most_terms: int, points: Points, cell_s: float) -> dict[str, Any]:
    return {
        "columns": bench.channels,
        "n_samples": bench.force.size,
        "fs_hz": bench.fs,
        "velocity_from": bench.velocity_from,
        "velocity_band_hz": bench.velocity_band_hz,
        "travel_zero_m": bench.travel_zero_m,
        "candidates": list(kinds),
        "most_terms": most_terms,
        "n_search_samples": points.sample.size,
        "n_left_out_stretches": N_STRETCHES,
        "bic_margin": BIC_MARGIN,
        "rms_margin": RMS_MARGIN,
        "interval_cell_s": cell_s,
    }


def _reason(result: BenchLaw) -> str | None:
    if result.r2_left_out < LEAST_R2:
        return (
            "on stretches of time that were left out no law of travel and velocity predicts the force better than its "
            "mean: the force is noise, or belongs to another motion"
        )
    if result.memory.seen and result.memory.r2_at_most < LEAST_STATIC_R2:
        return f"{result.memory.statement}: there is no law"
    return None


def _warnings(result: BenchLaw, fit: SeparableFit, rivals: list[tuple[str, str]]) -> tuple[str, ...]:
    """Say what is to be doubted about the law."""
    memory = result.memory
    found = list(result.bench.doubts)
    if memory.seen:
        found.append(
            f"{memory.statement}. The law is the best one for this motion; another motion would give other values, "
            "which the intervals do not cover"
        )
    elif not memory.testable:
        found.append(memory.statement)
    unexplained = 1 - result.r2_left_out
    missing = memory.r2_at_most - result.r2_left_out
    if missing > max(0.1 * unexplained, 0.002):
        found.append(
            f"a law of travel and velocity could explain {100 * memory.r2_at_most:.4g} % of the force, this one "
            f"explains {100 * result.r2_left_out:.4g} %: the library lacks its shape, which the intervals do not cover"
        )
    for name in dict.fromkeys(rival[0] for rival in rivals):
        alike = " or ".join(other for term, other in rivals if term == name and not _contains(other, name))
        if alike:
            found.append(f"over the visited range {name} cannot be told from {alike}")
    for term in fit.law.terms:
        amplitude, *inner = LAWS[term.name].parameters
        if _has_long_scale(term.name) and result.law_estimates[term.name][inner[0].name].interval95 is None:
            found.append(
                f"the motion is too small beside {inner[0].name} of {term.name} to tell it from {amplitude.name}: only "
                f"{amplitude.name} / {inner[0].name}^2 = {term.amplitude / term.inner[0] ** 2:.3g} is determined, and "
                "neither has an interval; record larger strokes"
            )
    names = [(term.name, p.name) for term in fit.law.terms for p in LAWS[term.name].parameters]
    for (kind, parameter), at_bound in zip(names, fit.at_bound, strict=True):
        if at_bound and not _has_long_scale(kind):
            found.append(f"{parameter} of {kind} stands at the end of what this motion can show: it has no interval")
    return tuple(found)


def _contains(kind: str, other: str) -> bool:
    """Whether a kind has an exponent or a lag that another lacks: it holds that one, and of course fits as well."""
    roles, plainer = ({parameter.role for parameter in LAWS[name].parameters} for name in (kind, other))
    return bool((roles - plainer) & {"exponent", "lag"})
