"""A law from a test bench: measured force against motion, F = F0 + K z + C z' + f, f of the motion and its past.

The terms of f are searched on some thousand samples (`opid.suspensions.law_search.pursuit` on a `BenchLaws`), the law
that is found is fitted to all. Where parts of unknown mass move with the specimen the force is m z'' more, and the law
is refined by the motion that it makes (`opid.suspensions.bench.simulation`). The intervals take the residual as it is,
correlated over time or not.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from opid.errors import InputError
from opid.estimate import Estimate, Estimates
from opid.mechanics.laws.law import LAWS, Law, default_law
from opid.mechanics.laws.rows import law_rows
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import FloatArray
from opid.suspensions.bench.intervals import estimate_parameters, fades_linearly, find_spread, has_long_scale
from opid.suspensions.bench.loop import Loop, cycle_of, loop_of
from opid.suspensions.bench.memory import Memory, measure_memory
from opid.suspensions.bench.problem import BenchFit, BenchLaws, all_points, fit_law, thin_record
from opid.suspensions.bench.record import Bench
from opid.suspensions.bench.settings import DEFAULTS, BenchSettings
from opid.suspensions.bench.simulation import SimulatedFit, Simulation, fit_by_simulation
from opid.suspensions.bench.study import BenchStudy
from opid.suspensions.fitting.least_squares import SeparableFit, independent_samples
from opid.suspensions.law_search.pursuit import LawStep, add_neighbours, chosen, is_better, n_terms, search_laws
from opid.suspensions.model.law_parameters import not_reached, way_to_stop

logger = logging.getLogger(__name__)

SCHEMA = "opid.law/1"
UNITS = {"stiffness_n_per_m": "N/m", "damping_n_s_per_m": "N s/m", "offset_n": "N", "moving_mass_kg": "kg"}
"""Of what a bench measures beside the nonlinear law."""
Ladder = tuple[LawStep[BenchFit], ...]


@dataclass(frozen=True)
class StraightPart(Estimates):
    """What a bench measures beside the nonlinear law.

    Args:
        stiffness_n_per_m: K.
        damping_n_s_per_m: C; without a value where the test was quasi-static.
        offset_n: F0.
        moving_mass_kg: of the parts that move with the specimen; None where there are none.
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
        ladder: the laws that were tried, in order, each with what is left of stretches that were left out.
        memory: what no law of travel and velocity can explain, and what of it the law remembers.
        loop: energy that the part of the law that remembers takes per cycle; None where it remembers nothing.
        cycle: energy that the whole force takes per cycle.
        n_independent: independent samples that the residual amounts to.
        warnings: what to doubt, one sentence each.
        not_determined: why there is no law, or None.
        settings: numbers that were tuned.
        candidates: kinds that could be added.
        n_search_samples: samples that the search looked at.
        interval_cell_s: length of the cells over which scores were added up for the intervals, s.
        simulation: the motion that the law makes of the force alone, to which its parameters were refined; None where
            the parameters are those of the force.
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
        """Return the content of result.json, see `opid.suspensions.bench.as_json.bench_json`."""
        from opid.suspensions.bench.as_json import bench_json

        return bench_json(self)

    def _headline(self) -> str:
        return f"{self.title or 'without a title'} (law {self.law.name}, {100 * self.r2_left_out:.4g} % explained)"

    @property
    def residual_rms(self) -> float:
        """Root mean square of the residual, N, of the samples that count."""
        return float(np.sqrt(np.mean(self.residual[self.bench.samples] ** 2)))


def law_of_bench(
    bench: Bench | BenchStudy,
    *,
    title: str = "",
    candidates: Sequence[str] | None = None,
    most_terms: int | None = None,
    settings: BenchSettings = DEFAULTS,
    progress: Callable[[str], None] | None = None,
) -> BenchLaw:
    """Find the law of a damper or spring from its measured force and motion.

    Args:
        bench: the record, from `bench_from_recording`; or a study, from `read_study`, which says where it is left out
            here what title, candidates and most terms are.
        title: name of the record.
        candidates: kinds that may be added; None for every kind in `LAWS` that is searched.
        most_terms: terms of f at the most; None for as many as the settings say.
        settings: numbers that were tuned.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: what is no record, an unknown candidate, or a negative number of terms.

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
    kinds = tuple(name for name, kind in LAWS.items() if kind.searched) if candidates is None else tuple(candidates)
    for name in kinds:
        default_law(name)  # an unknown one is named here
    if bench.is_quasi_static:
        kinds = tuple(name for name in kinds if _is_of_travel(name))
    if most_terms is not None:
        settings = replace(settings, search=replace(settings.search, most_terms=most_terms))
    if settings.search.most_terms < 0:
        raise InputError(f"most_terms is {most_terms}: give 0 or more")
    say = progress or (lambda step: None)
    problem = BenchLaws(thin_record(bench, settings), kinds, settings)
    ladder, simulated = _defined(bench, _search(problem, kinds, say)), dict[str, SimulatedFit]()
    if bench.acceleration is not None:
        ladder, simulated = _simulated(bench, ladder, settings, say)
    step = chosen(ladder)
    refined = simulated.get(step.law_name)
    if refined is not None:
        fit = _as_fit_of_force(bench, refined)
    else:
        say("the chosen law on all samples")
        bench = _without_beginning(bench, step.fit.separable.law, settings)
        fit = fit_law(all_points(bench), step.fit.separable.law, step.fit.n_independent, settings)
    logger.info("law %s: r2 %.4f, of %d laws that were tried", step.law_name, step.fit.r2, len(ladder))
    say("memory")
    memory = _memory(bench, problem, ladder)
    spread = find_spread(bench, fit, refined, settings)
    straight, of_law = estimate_parameters(fit, spread)
    for name in _ways_to_stops(bench, fit.law):
        of_law[name] = dict.fromkeys(of_law[name], Estimate())
    index = np.r_[1, fit.weights.size : fit.weights.size + fit.law.vector.size]
    covariance, damping = spread.covariance[np.ix_(index, index)], float(fit.weights[1])
    if bench.is_quasi_static:
        # it tells no damping
        straight.insert(1, Estimate())
        covariance, damping = np.pad(covariance[1:, 1:], (1, 0)), 0.0
    result = BenchLaw(
        bench=bench,
        title=title,
        parameters=StraightPart(*straight),
        law=fit.law,
        law_estimates=of_law,
        residual=_residual(bench, fit),
        r2=1 - float(np.mean(fit.residual**2) / np.var(bench.force[bench.samples])),
        r2_left_out=_r2_left_out(step),
        ladder=ladder,
        memory=memory,
        loop=loop_of(fit.law, covariance[1:, 1:], bench, spread.student),
        cycle=cycle_of(fit.law, damping, covariance, bench, student=spread.student),
        n_independent=independent_samples(fit.residual),
        warnings=(),
        not_determined=None,
        settings=settings,
        candidates=kinds,
        n_search_samples=problem.points.sample.size,
        interval_cell_s=spread.cell_s,
        simulation=None if refined is None else _simulation(bench, refined, simulated),
    )
    warnings = (*_warnings(result, fit), *spread.why_untold)
    return replace(result, warnings=warnings, not_determined=_reason(result))


def _memory(bench: Bench, problem: BenchLaws, ladder: Ladder) -> Memory:
    """Measure the memory beside the best laws with and without one: also those that were too rich to keep."""
    settings, step = problem.known, chosen(ladder)
    asked = [each for each in ladder if each.left_out is not None]
    static = max((each for each in asked if not _has_memory(each)), key=_r2_left_out)
    best = max(asked, key=_r2_left_out) if _has_memory(step) else static
    return measure_memory(
        bench,
        problem.points,
        best.fit.left_out,
        static_rest=static.fit.left_out,
        law=best.fit.separable.law,
        is_noise=_r2_left_out(step) < settings.least_r2,
        settings=settings,
    )


def _is_of_travel(kind: str) -> bool:
    """Whether the force of a kind depends on where the travel is and has been, and not on how fast it passed."""
    if LAWS[kind].memory is not None:
        return all(parameter.unit in ("N", "m", "1") for parameter in LAWS[kind].parameters)
    _, by_velocity = default_law(kind).gradient(np.linspace(-0.01, 0.01, 21), np.linspace(-0.3, 0.3, 21))
    return not np.any(by_velocity)


def _search(problem: BenchLaws, kinds: tuple[str, ...], say: Callable[[str], None]) -> Ladder:
    """Return the laws that were tried and those that come closest to the chosen one, with stretches left out."""
    say("the linear law")
    ladder = search_laws(problem, problem.linear_fit(), kinds=kinds, progress=say)
    say("the laws that come closest")
    neighbours = add_neighbours(problem, ladder, kinds=kinds)[: -len(ladder)]
    best = chosen(ladder)
    for step in neighbours:
        # its columns promised nothing, its fit keeps more
        if is_better(step.fit, best.fit, problem.settings) and problem.confirms(step.fit, best.fit):
            best = step
    if _has_memory(best):
        best = replace(best, fit=problem.restarted(best.fit))
    tried = [step for step in (*ladder, *neighbours) if step.law_name != best.law_name]
    # the last one that was kept is the choice
    in_order = (*tried, replace(best, kept=True))
    asked = [step for step in in_order if step.kept]
    for has_memory in (False, True):
        alike = sorted((each for each in in_order if _has_memory(each) is has_memory), key=lambda each: each.fit.bic)
        asked += alike[: problem.known.n_left_out]
    return tuple(
        replace(step, left_out=problem.left_out(step.fit)) if any(step is each for each in asked) else step
        for step in in_order
    )


def _without_beginning(bench: Bench, law: Law, settings: BenchSettings) -> Bench:
    """Return the record without its beginning, where a memory that is not linear depends on what it held at first.

    Where that takes more than half of the record all of it stays.
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


def _residual(bench: Bench, fit: SeparableFit) -> FloatArray:
    """Return force minus fit of every sample, also of those that do not count, N."""
    own = bench.motion.force(fit.law) + bench.motion.start_columns(fit.law) @ fit.start_weights
    return bench.force - bench.columns @ fit.weights - own


def _simulated(
    bench: Bench, ladder: Ladder, settings: BenchSettings, say: Callable[[str], None]
) -> tuple[Ladder, dict[str, SimulatedFit]]:
    """Return the ladder that ends on the law which makes the recorded motion best, and the refined laws by their name.

    The chosen law is refined, and those that come closest to it by the force, until one leaves white noise of the
    travel. Where no simulation explains more of the travel than its law explains of the force, noise is in the force
    and not in the travel: nothing is refined.
    """
    others = sorted((step for step in ladder if step is not chosen(ladder)), key=lambda step: step.fit.bic)
    fits: dict[str, SimulatedFit] = {}
    best: LawStep[BenchFit] | None = None
    for step in (chosen(ladder), *others[: settings.simulation.n_laws - 1]):
        fit = fit_by_simulation(bench, step.fit.separable, settings.simulation, say=say)
        if fit is None or fit.r2 < step.fit.r2:
            continue
        fits[step.law_name] = fit
        if best is None or _is_better_simulated(fit, fits[best.law_name], settings):
            best = step
        if fit.n_independent > settings.simulation.white * bench.travel.size:
            break
    if best is None:
        return ladder, {}
    return _ending_on(ladder, best), fits


def _ending_on(ladder: Ladder, step: LawStep[BenchFit]) -> Ladder:
    """Return the ladder with another choice: the last step that was kept is the choice."""
    return (*(each for each in ladder if each is not step), replace(step, kept=True))


def _defined(bench: Bench, ladder: Ladder) -> Ladder:
    """Return the ladder that ends on the best law which is finite along every sample of the record.

    A memory that nothing bounds (Bouc-Wen with a shape below -1/2) may grow without end where the search, which follows
    it in longer steps, just saw it turn back.
    """
    motion, choice = bench.motion, chosen(ladder)
    for step in (choice, *sorted(ladder, key=lambda step: step.fit.bic)):
        law = step.fit.separable.law
        if not law.has_memory or all(
            np.isfinite(each).all() for each in (motion.parameter_gradient(law), motion.start_columns(law))
        ):
            return ladder if step is choice else _ending_on(ladder, step)
    return ladder


def _is_better_simulated(fit: SimulatedFit, than: SimulatedFit, settings: BenchSettings) -> bool:
    """Whether a law takes another's place by the motion that it makes; one of fewer terms if that one is no better."""
    if n_terms(fit) < n_terms(than):
        return not is_better(than, fit, settings.search)
    return is_better(fit, than, settings.search)


def _as_fit_of_force(bench: Bench, simulated: SimulatedFit) -> SeparableFit:
    """Return a refined law as a fit of the force, with what it leaves of it."""
    part = simulated.part
    fit = SeparableFit(part.straight, np.zeros(part.begins.size - 2), part.law, np.empty(0), simulated.at_bound)
    return replace(fit, residual=_residual(bench, fit))


def _simulation(bench: Bench, refined: SimulatedFit, tried: Mapping[str, SimulatedFit]) -> Simulation:
    errors = {name: fit.error_rms for name, fit in tried.items()}
    travel = bench.travel - refined.residual
    return Simulation(refined.part, travel, refined.error_rms, refined.r2, refined.steps_per_sample, errors)


def _r2_left_out(step: LawStep[BenchFit]) -> float:
    return step.fit.r2_of(float(np.sqrt(np.mean(step.fit.left_out**2))))


def _has_memory(step: LawStep[BenchFit]) -> bool:
    return step.fit.separable.law.has_memory


def _ways_to_stops(bench: Bench, law: Law) -> dict[str, float]:
    """Return the stops that the motion does not reach, and how far it goes towards them, m."""
    travel = bench.travel[bench.samples]
    stops = [term for term in law.terms if term.kind.is_stop]
    return {term.name: way_to_stop(term, travel) for term in stops if not Law((term,)).force(travel, 0.0).any()}


def _reason(result: BenchLaw) -> str | None:
    if result.r2_left_out < result.settings.least_r2:
        return (
            "on stretches of time that were left out no law of travel and velocity predicts the force better than its "
            "mean: the force is noise, or belongs to another motion"
        )
    if result.memory.seen and result.memory.r2_with_law < result.settings.least_static_r2:
        return f"{result.memory.statement}: there is no law"
    return None


def _warnings(result: BenchLaw, fit: SeparableFit) -> tuple[str, ...]:
    """Say what is to be doubted about the law."""
    memory, settings = result.memory, result.settings
    found = list(result.bench.warnings)
    if memory.seen:
        found.append(
            f"{memory.statement}. The law is the best one for this motion; another motion would give other values, "
            "which the intervals do not cover"
        )
    elif not memory.testable:
        found.append(memory.statement)
    unexplained = 1 - result.r2_left_out
    missing = memory.r2_with_law - result.r2_left_out
    if missing > max(settings.missing_of_rest * unexplained, settings.missing_r2):
        beside = "" if result.loop is None else " beside what this one remembers"
        found.append(
            f"a law of travel and velocity{beside} could explain {100 * memory.r2_with_law:.4g} % of the force, this "
            f"one explains {100 * result.r2_left_out:.4g} %: the library lacks its shape, which the intervals do not "
            "cover"
        )
    for name, symbol in (("stiffness_n_per_m", "K"), ("damping_n_s_per_m", "C")):
        ends = getattr(result.parameters, name).interval95
        if ends is not None and ends[1] < 0 and fit.law.terms:
            found.append(
                f"{symbol} is below zero: it is the slope that is left beside the terms of the law, no property of its "
                "own; what the whole force takes a cycle is"
            )
    if result.cycle.area_j.value is None:
        found.append(
            "the energy that a cycle takes is not told: its interval reaches farther than the force that was measured "
            "could take at all; record a motion that turns round several times, at several speeds"
        )
    for name, others in _rivals(result).items():
        found.append(f"over the visited range {name} cannot be told from {' or '.join(others)}")
    for term in fit.law.terms:
        amplitude, *inner = term.kind.parameters
        if has_long_scale(term) and result.law_estimates[term.name][inner[0].name].interval95 is None:
            found.append(
                f"the motion is too small beside {inner[0].name} of {term.name} to tell it from {amplitude.name}: only "
                f"{amplitude.name} / {inner[0].name}^2 = {term.amplitude / term.inner[0] ** 2:.3g} is determined, and "
                "neither has an interval; record larger strokes"
            )
    unreached = _ways_to_stops(result.bench, fit.law)
    found += [f"{name} {not_reached(way_m)}" for name, way_m in unreached.items()]
    names = [(term, p.name) for term in fit.law.terms for p in term.kind.parameters]
    for (term, name), at_bound in zip(names, fit.at_bound, strict=True):
        if at_bound and not has_long_scale(term) and term.name not in unreached:
            found.append(f"{name} of {term.name} stands at the end of what this motion can show: it has no interval")
    return tuple(found)


def _rivals(result: BenchLaw) -> dict[str, list[str]]:
    """Return for each term the kinds that explain the record as well in its place, the most likely first."""
    best = chosen(result.ladder).fit
    mine, rivals = set(best.separable.law.parameters), dict[str, list[str]]()
    for step in sorted(result.ladder, key=lambda step: step.fit.bic):
        theirs = set(step.fit.separable.law.parameters)
        gone, new = mine - theirs, theirs - mine
        if len(gone) == len(new) == 1 and step.fit.bic < best.bic + result.settings.search.alike_bic:
            (name,), (other,) = gone, new
            if not _contains(other, name) and other not in rivals.setdefault(name, []):
                rivals[name].append(other)
    return {name: others for name, others in rivals.items() if others}


def _contains(kind: str, other: str) -> bool:
    """Whether a kind has an exponent or a lag that another lacks: it holds that one, and of course fits as well."""
    roles, plainer = ({parameter.role for parameter in LAWS[name].parameters} for name in (kind, other))
    return bool((roles - plainer) & {"exponent", "lag"})
