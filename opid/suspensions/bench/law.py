"""A law from a test bench: measured force against motion, F = F0 + K z + C z' + f, f of the motion and its past.

The terms of f are searched on some thousand samples (`problem`), and the law that is found is fitted to all samples.
If parts of unknown mass move with the specimen, the force has an additional term m z'', and the law is refined by
simulation of the motion (`simulation`). The intervals also hold for a residual that is correlated over time.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from opid.errors import InputError
from opid.estimate import Estimate, Estimates
from opid.json_values import plain
from opid.mechanics.laws.law import LAWS, Law, Term, default_law, law_rows
from opid.mechanics.memory import Loop
from opid.progress import Say
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import FloatArray
from opid.suspensions.answer.numbers import warn_of_area
from opid.suspensions.answer.warnings import warn_of_sign
from opid.suspensions.bench.calibration import (
    CalibrationError,
    has_lag,
    warn_of_calibration,
    warn_of_imitated_lag,
)
from opid.suspensions.bench.intervals import (
    INSTEAD,
    cycle_of,
    estimate_parameters,
    fades_linearly,
    find_inseparable,
    find_spread,
    gas_of_bench,
    has_long_scale,
    is_of_travel,
    loop_of,
)
from opid.suspensions.bench.memory import Memory, measure_memory
from opid.suspensions.bench.problem import (
    BenchLaws,
    Ladder,
    all_points,
    end_on_defined,
    fit_law,
    search_record,
    thin_record,
)
from opid.suspensions.bench.record import Bench, BenchStudy
from opid.suspensions.bench.settings import DEFAULTS, BenchSettings
from opid.suspensions.bench.simulation import SimulatedFit, Simulation, refine_ladder
from opid.suspensions.fitting.least_squares import SeparableFit, independent_samples
from opid.suspensions.law_search.pursuit import chosen
from opid.suspensions.model.law_parameters import describe_unreached_stop, distance_to_stop
from opid.suspensions.result import GasColumn

logger = logging.getLogger(__name__)

SCHEMA = "opid.law/1"
UNITS = {"stiffness_n_per_m": "N/m", "damping_n_s_per_m": "N s/m", "offset_n": "N", "moving_mass_kg": "kg"}
"""Units of the linear parameters that a bench measures beside the nonlinear law."""


@dataclass(frozen=True)
class StraightPart(Estimates):
    """Linear parameters that a bench measures beside the nonlinear law.

    Args:
        stiffness_n_per_m: K.
        damping_n_s_per_m: C; without a value if the test was quasi-static.
        offset_n: F0.
        moving_mass_kg: mass of the parts that move with the specimen; None if there are none.
    """

    stiffness_n_per_m: Estimate
    damping_n_s_per_m: Estimate
    offset_n: Estimate
    moving_mass_kg: Estimate | None = None


@dataclass(frozen=True, eq=False, repr=False)
class BenchLaw(Result):
    """The law of a test bench.

    Args:
        bench: the record that it was fitted to.
        title: name of the record.
        parameters: stiffness, damping and offset beside the law.
        law: the nonlinear law f, N.
        law_estimates: {kind: {parameter: Estimate}}.
        residual: (n,) force minus fit, N.
        r2: fraction of the variance of the force that is explained.
        r2_left_out: the same on stretches of time that were left out of the fit.
        ladder: the laws that were tried, in order, each with its error on stretches that were left out.
        memory: the part of the force that no law of travel and velocity explains, and how much of it the past explains.
        loop: energy that the terms with memory take per cycle; None without memory.
        cycle: energy that the whole force takes per cycle.
        n_independent: number of independent samples in the residual.
        warnings: the warnings, one sentence each.
        not_determined: why there is no law, or None.
        settings: the tuned numbers.
        candidates: kinds that could be added.
        n_search_samples: number of samples in the search.
        interval_cell_s: length of the cells over which scores were added up for the intervals, s.
        simulation: the motion simulated from the force, by which the parameters were refined; None if the parameters
            are those of the fit to the force.
        gas: the gas of a strut where its travel is zero; None if no gas is found, or if it has no intervals.
        calibration: what is known of gains, lag and mass between force cell and specimen, which the intervals hold.
    """

    bench: Bench
    title: str
    parameters: StraightPart
    law: Law
    law_estimates: Mapping[str, Mapping[str, Estimate]]
    residual: FloatArray
    r2: float
    r2_left_out: float
    ladder: Ladder
    memory: Memory
    loop: Loop | None
    cycle: Loop
    n_independent: float
    warnings: tuple[str, ...]
    not_determined: str | None
    settings: BenchSettings
    candidates: tuple[str, ...]
    n_search_samples: int
    interval_cell_s: float
    simulation: Simulation | None = None
    gas: GasColumn | None = None
    calibration: tuple[CalibrationError, ...] = ()

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return stiffness, damping, offset, the law, and the energy that a cycle takes."""
        straight = (SummaryRow.of(name, each, UNITS[name]) for name, each in self.parameters.items())
        laws = law_rows(self.law, self.law_estimates, "law")
        return (*straight, *laws, SummaryRow.of("cycle.area_j", self.cycle.area_j, "J"))

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The log of the bench, as it was when it was read."""
        return self.bench.files

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, as `docs/schemas/law-1.schema.json` describes it."""
        simulation = self.simulation
        return plain(
            {
                "schema": SCHEMA,
                "title": self.title,
                "parameters": asdict(self.parameters),
                "law": {
                    "name": self.law.name,
                    "latex": self.law.latex,
                    "parameters": {
                        kind: {name: asdict(estimate) for name, estimate in estimates.items()}
                        for kind, estimates in self.law_estimates.items()
                    },
                },
                "r2": self.r2,
                "r2_left_out": self.r2_left_out,
                "residual_rms_n": self.residual_rms,
                "n_independent": self.n_independent,
                "ladder": [
                    {
                        "law": step.law_name,
                        "r2": step.fit.r2,
                        "r2_left_out": None if step.left_out is None else step.fit.r2_of(step.left_out),
                        "bic": step.fit.bic,
                        "kept": step.kept,
                        "chosen": step is chosen(self.ladder),
                    }
                    for step in self.ladder
                ],
                "memory": asdict(self.memory) | {"seen": self.memory.seen},
                "loop": None if self.loop is None else asdict(self.loop),
                "cycle": asdict(self.cycle),
                "simulation": None
                if simulation is None
                else {name: getattr(simulation, name) for name in ("error_rms_m", "r2", "steps_per_sample", "tried")},
                "gas": None if self.gas is None else asdict(self.gas),
                "calibration": [asdict(each) for each in self.calibration],
                "warnings": self.warnings,
                "not_determined": self.not_determined,
                "settings": self._collect_settings(),
            }
        )

    def _collect_settings(self) -> dict[str, Any]:
        """The record, the options and every tuned number that the answer was made with."""
        bench, search = self.bench, self.settings.search
        return {
            "columns": bench.channels,
            "n_samples": bench.force.size,
            "fs_hz": bench.fs,
            "velocity_from": bench.velocity_from,
            "quasi_static": bench.is_quasi_static,
            "moving_mass": bench.acceleration is not None,
            "mass_kg": bench.mass_kg,
            "piston_area_m2": bench.piston_area_m2,
            **asdict(bench.tolerances),
            "velocity_band_hz": bench.velocity_band_hz,
            "travel_zero_m": bench.travel_zero_m,
            "candidates": self.candidates,
            "most_terms": search.most_terms,
            "n_search_samples": self.n_search_samples,
            "n_left_out_stretches": self.settings.n_stretches,
            "bic_margin": search.bic_margin,
            "rms_margin": search.error_margin,
            "interval_cell_s": self.interval_cell_s,
            **asdict(self.settings),
        }

    def _write_headline(self) -> str:
        return f"{self.title or 'without a title'} (law {self.law.name}, {100 * self.r2_left_out:.4g} % explained)"

    @property
    def residual_rms(self) -> float:
        """Root mean square of the residual over the samples that count, N."""
        return float(np.sqrt(np.mean(self.residual[self.bench.samples] ** 2)))


def law_of_bench(
    bench: Bench | BenchStudy,
    *,
    title: str = "",
    candidates: Sequence[str] | None = None,
    most_terms: int | None = None,
    settings: BenchSettings = DEFAULTS,
    progress: Say | None = None,
) -> BenchLaw:
    """Find the law of a damper or spring from its measured force and motion.

    Args:
        bench: the record, from `bench_from_recording`; or a study, from `read_study`, whose title, candidates and
            most terms are used if they are left out here.
        title: name of the record.
        candidates: kinds that may be added; None for every kind in `LAWS` that is searched.
        most_terms: most terms of f; None for the value of the settings.
        settings: the tuned numbers.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: `bench` is no record, a candidate is unknown, or the number of terms is negative.

    >>> rng = np.random.default_rng(0)
    >>> z, v = 0.01 * rng.standard_normal(2000), 0.3 * rng.standard_normal(2000)
    >>> force = 2e4 * z + 500 * v + 800 * v * np.abs(v) + 5 * rng.standard_normal(2000)
    >>> names = {"force": "F", "travel": "z", "velocity": "v"}
    >>> bench = Bench(z, v, force, 500.0, 0.0, "recorded", None, names, ())
    >>> found = law_of_bench(bench, candidates=("quadratic_damping", "cubic_damping"))
    >>> found.law.name, found.law_estimates["quadratic_damping"]["damping_n_s2_per_m2"].holds(800)
    ('quadratic_damping', True)
    """
    if isinstance(bench, BenchStudy):
        title = title or bench.title
        candidates = bench.candidates if candidates is None else candidates
        most_terms = bench.most_terms if most_terms is None else most_terms
        bench = bench.bench
    if not isinstance(bench, Bench):
        raise InputError(
            f"bench is of type {type(bench).__name__}: give a BenchStudy, as read_study makes one, or a Bench"
        )
    kinds = _choose_kinds(bench, candidates)
    if most_terms is not None:
        settings = replace(settings, search=replace(settings.search, most_terms=most_terms))
    if settings.search.most_terms < 0:
        raise InputError(f"most_terms is {most_terms}: give 0 or more")
    say = progress or (lambda step: None)
    problem = BenchLaws(thin_record(bench, settings), kinds, settings)
    ladder, simulated = end_on_defined(bench, search_record(problem, kinds, say)), dict[str, SimulatedFit]()
    if bench.acceleration is not None:
        ladder, simulated = refine_ladder(bench, ladder, settings, say)
    found = chosen(ladder).fit
    logger.info("law %s: r2 %.4f, of %d laws that were tried", found.law_name, found.r2, len(ladder))
    if found.law_name in simulated:
        fit = _convert_to_fit_of_force(bench, simulated[found.law_name])
    else:
        say("the chosen law on all samples")
        bench = _drop_beginning(bench, found.law, settings)
        fit = fit_law(all_points(bench), found.law, found.n_independent, settings)
    say("memory")
    return _build_result(bench, title, problem, ladder, fit, simulated)


def _choose_kinds(bench: Bench, candidates: Sequence[str] | None) -> tuple[str, ...]:
    kinds = tuple(name for name, kind in LAWS.items() if kind.searched) if candidates is None else tuple(candidates)
    for name in kinds:
        default_law(name)  # refuses an unknown candidate
    return tuple(name for name in kinds if not bench.is_quasi_static or is_of_travel(name))


def _build_result(
    bench: Bench,
    title: str,
    problem: BenchLaws,
    ladder: Ladder,
    fit: SeparableFit,
    simulated: Mapping[str, SimulatedFit],
) -> BenchLaw:
    """Compose the result: intervals, memory, the energy of a cycle, and warnings."""
    settings, found = problem.known, chosen(ladder).fit
    refined = simulated.get(found.law_name)
    without_lag = _fit_without_lag(bench, fit, ladder, settings) if refined is None else None
    spread = find_spread(bench, fit, refined, settings, without_lag=without_lag)
    memory = _measure_memory(bench, problem, ladder)
    straight, of_law = estimate_parameters(fit, spread)
    index = np.r_[1, fit.weights.size : fit.weights.size + fit.law.vector.size]
    covariance, damping = spread.covariance[np.ix_(index, index)], float(fit.weights[1])
    if bench.is_quasi_static:
        # A quasi-static test does not determine the damping.
        straight.insert(1, Estimate())
        covariance, damping = np.pad(covariance[1:, 1:], (1, 0)), 0.0
    loop = loop_of(fit.law, covariance[1:, 1:], bench, spread.student)
    cycle = cycle_of(fit.law, damping, covariance, bench, student=spread.student)
    inseparable = find_inseparable(
        bench, float(fit.weights[0]), damping, fit.law, memory_is_testable=memory.testable, settings=settings
    )
    parameters = StraightPart(*straight)
    undetermined = [] if spread.reasons else _list_undetermined_scales(fit.law, of_law)
    if inseparable.of_travel:
        parameters = parameters.with_estimates(
            Estimate.without_interval, only=("stiffness_n_per_m", "offset_n", "moving_mass_kg")
        )
    if inseparable.of_velocity:
        parameters = parameters.with_estimates(Estimate.without_interval, only=("damping_n_s_per_m",))
    for term in filter(inseparable.holds, fit.law.terms):
        of_law[term.name] = {name: each.without_interval() for name, each in of_law[term.name].items()}
        loop = loop and replace(loop, area_j=loop.area_j.without_interval())
    for name in _measure_distances_to_stops(bench, fit.law):
        of_law[name] = dict.fromkeys(of_law[name], Estimate())
    result = BenchLaw(
        bench=bench,
        title=title,
        parameters=parameters,
        law=fit.law,
        law_estimates=of_law,
        residual=_compute_residual(bench, fit),
        r2=1 - float(np.mean(fit.residual**2) / np.var(bench.force[bench.samples])),
        r2_left_out=found.r2_left_out,
        ladder=ladder,
        memory=memory,
        loop=loop,
        cycle=replace(cycle, area_j=cycle.area_j.without_interval()) if inseparable.of_cycle else cycle,
        n_independent=independent_samples(fit.residual),
        warnings=(),
        not_determined=None,
        settings=settings,
        candidates=problem.kinds,
        n_search_samples=problem.points.sample.size,
        interval_cell_s=spread.cell_s,
        simulation=None if refined is None else _build_simulation(bench, refined, simulated),
        gas=gas_of_bench(fit, of_law, spread, bench.piston_area_m2),
        calibration=spread.calibration,
    )
    of_calibration = () if result.memory.seen else warn_of_calibration(spread.calibration, settings.calibration)
    of_lag = (
        without_lag and not spread.reasons and warn_of_imitated_lag(fit.law, without_lag.law, spread.imitated_lag_s)
    )
    warnings = (
        *_list_warnings(result, fit, undetermined),
        *(of_lag or ()),
        *inseparable.reasons,
        *of_calibration,
        *spread.reasons,
    )
    return replace(result, warnings=warnings, not_determined=_find_reason(result))


def _fit_without_lag(bench: Bench, fit: SeparableFit, ladder: Ladder, settings: BenchSettings) -> SeparableFit | None:
    """Return the fit of the best law that does not lag, if the chosen one does."""
    others = [step.fit for step in ladder if not has_lag(step.fit.law)]
    if not others or not has_lag(fit.law):
        return None
    best = min(others, key=lambda each: each.bic)
    return fit_law(all_points(bench), best.law, best.n_independent, settings)


def _measure_memory(bench: Bench, problem: BenchLaws, ladder: Ladder) -> Memory:
    """Measure the memory beside the best laws with and without memory, including those with too many terms."""
    settings, step = problem.known, chosen(ladder)
    asked = [each for each in ladder if each.left_out is not None]
    static = max((each for each in asked if not each.fit.law.has_memory), key=lambda each: each.fit.r2_left_out)
    best = max(asked, key=lambda each: each.fit.r2_left_out) if step.fit.law.has_memory else static
    return measure_memory(
        bench,
        problem.points,
        best.fit.left_out,
        static_rest=static.fit.left_out,
        law=best.fit.law,
        is_noise=step.fit.r2_left_out < settings.least_r2,
        settings=settings,
    )


def _drop_beginning(bench: Bench, law: Law, settings: BenchSettings) -> Bench:
    """Return the record without its beginning, in which a nonlinear memory depends on its unknown initial value.

    If that would remove more than half of the record, the whole record is kept.
    """
    first, motion = 0, bench.motion
    for term in law.terms:
        if term.kind.memory is not None and not fades_linearly(term):
            held = np.abs(motion.start_columns(Law((term,)))[:, 0])
            first = max(first, int(np.flatnonzero(held >= settings.forgotten * held.max())[-1]) + 1)
    samples = bench.samples
    if not first or np.sum(samples >= first) < 0.5 * samples.size:
        return bench
    counted = np.zeros(bench.force.size, dtype=bool)
    counted[samples[samples >= first]] = True
    return replace(bench, counted=counted)


def _compute_residual(bench: Bench, fit: SeparableFit) -> FloatArray:
    """Return force minus fit of every sample, also of those that do not count, N."""
    own = bench.motion.force(fit.law) + bench.motion.start_columns(fit.law) @ fit.start_weights
    return bench.force - bench.columns @ fit.weights - own


def _convert_to_fit_of_force(bench: Bench, simulated: SimulatedFit) -> SeparableFit:
    """Return a refined law as a fit of the force, with its residual."""
    part = simulated.part
    fit = SeparableFit(part.straight, np.zeros(part.begins.size - 2), part.law, np.empty(0), simulated.at_bound)
    return replace(fit, residual=_compute_residual(bench, fit))


def _build_simulation(bench: Bench, refined: SimulatedFit, tried: Mapping[str, SimulatedFit]) -> Simulation:
    errors = {name: fit.error_rms for name, fit in tried.items()}
    travel = bench.travel - refined.residual
    return Simulation(refined.part, travel, refined.error_rms, refined.r2, refined.steps_per_sample, errors)


def _measure_distances_to_stops(bench: Bench, law: Law) -> dict[str, float]:
    """Return the stops that the motion does not reach, and the distance that it goes towards them, m."""
    travel = bench.travel[bench.samples]
    stops = [term for term in law.terms if term.kind.is_stop]
    return {term.name: distance_to_stop(term, travel) for term in stops if not Law((term,)).force(travel, 0.0).any()}


def _find_reason(result: BenchLaw) -> str | None:
    if result.r2_left_out < result.settings.least_r2:
        return (
            "no law of travel and velocity predicts the force on stretches of time that were left out better than its "
            "mean does: the force is noise, or belongs to another motion"
        )
    if result.memory.seen and result.memory.r2_with_law < result.settings.least_static_r2:
        return f"{result.memory.statement}: there is no law"
    return None


def _list_undetermined_scales(law: Law, of_law: Mapping[str, Mapping[str, Estimate]]) -> list[Term]:
    """Return the terms whose scale is so long that the motion does not determine it."""
    return [
        term
        for term in law.terms
        if has_long_scale(term) and of_law[term.name][term.kind.parameters[1].name].interval95 is None
    ]


def _list_warnings(result: BenchLaw, fit: SeparableFit, undetermined: Sequence[Term]) -> tuple[str, ...]:
    """Return the warnings about the law, one sentence each; the scales of some terms are not determined."""
    memory, settings = result.memory, result.settings
    found = list(result.bench.warnings)
    if memory.seen:
        found.append(
            f"{memory.statement}. The law is the best one for this motion; another motion would give other values, "
            "which the intervals do not include"
        )
    elif not memory.testable:
        found.append(memory.statement)
    if memory.r2_with_time > memory.r2_with_law:
        found.append(
            f"stiffness or damping change with time within the record, which explains "
            f"{100 * (memory.r2_with_time - memory.r2_with_law):.2g} % of the force that no law of travel and velocity "
            "does: something that was not recorded acts on it (a valve that switches, temperature, air), so the values "
            "are means over this record; record what changes, or a stretch without a change"
        )
    unexplained = 1 - result.r2_left_out
    missing = memory.r2_with_law - result.r2_left_out
    if missing > max(settings.missing_of_rest * unexplained, settings.missing_r2):
        beside = "" if result.loop is None else " beside the memory of this one"
        found.append(
            f"a law of travel and velocity{beside} could explain {100 * memory.r2_with_law:.4g} % of the force, but "
            f"this one explains {100 * result.r2_left_out:.4g} %: no law of the library has this shape, and the "
            "intervals do not include that error"
        )
    for name, symbol in (("stiffness_n_per_m", "K"), ("damping_n_s_per_m", "C")):
        estimate: Estimate = getattr(result.parameters, name)
        ends = estimate.interval95
        if not fit.law.terms:
            found += warn_of_sign(name.partition("_")[0], estimate, is_spring=symbol == "K")
        elif ends is not None and ends[1] < 0:
            found.append(
                f"{symbol} is below zero: it is only the slope that remains beside the terms of the law and has no "
                f"meaning by itself; {INSTEAD}"
            )
    if result.cycle.area_j.value is None:
        found.append(
            "the energy that a cycle takes is not given: its interval exceeds the largest energy that the measured "
            "force could take; record a motion that turns round several times, at several speeds"
        )
    for name, others in _list_rivals(result).items():
        found.append(f"over the visited range {name} cannot be distinguished from {' or '.join(others)}")
    for term in undetermined:
        amplitude, *inner = term.kind.parameters
        found.append(
            f"the motion is too small in comparison with {inner[0].name} of {term.name} to distinguish it from "
            f"{amplitude.name}: only {amplitude.name} / {inner[0].name}^2 = "
            f"{term.amplitude / term.inner[0] ** 2:.3g} is determined, and neither has an interval; record larger "
            "strokes"
        )
    found += warn_of_area(result.gas, result.bench.piston_area_m2, settings.gas)
    unreached = _measure_distances_to_stops(result.bench, fit.law)
    found += [f"{name} {describe_unreached_stop(distance_m)}" for name, distance_m in unreached.items()]
    names = [(term, p.name) for term in fit.law.terms for p in term.kind.parameters]
    for (term, name), at_bound in zip(names, fit.at_bound, strict=True):
        if at_bound and not has_long_scale(term) and term.name not in unreached:
            found.append(f"{name} of {term.name} is at the limit of what this motion can show: it has no interval")
    return tuple(found)


def _list_rivals(result: BenchLaw) -> dict[str, list[str]]:
    """Return for each term the kinds that explain the record as well in its place, the most likely first."""
    best = chosen(result.ladder).fit
    mine, rivals = set(best.law.parameters), dict[str, list[str]]()
    for step in sorted(result.ladder, key=lambda step: step.fit.bic):
        theirs = set(step.fit.law.parameters)
        gone, new = mine - theirs, theirs - mine
        if len(gone) == len(new) == 1 and step.fit.bic < best.bic + result.settings.search.alike_bic:
            (name,), (other,) = gone, new
            if not _has_more_parameters(other, name) and other not in rivals.setdefault(name, []):
                rivals[name].append(other)
    return {name: others for name, others in rivals.items() if others}


def _has_more_parameters(kind: str, other: str) -> bool:
    """Whether a kind has an exponent or a lag that another lacks: it then contains the other and fits as well."""
    roles, plainer = ({parameter.role for parameter in LAWS[name].parameters} for name in (kind, other))
    return bool((roles - plainer) & {"exponent", "lag"})
