"""Refinement of a law until the motion simulated from the measured force is the recorded one.

If parts of unknown mass move with the specimen, the force is F = m z'' + C z' + K z + F0 + f, and z'' comes from a
travel that was differentiated twice, whose noise biases every parameter (Söderström 2018, Errors-in-Variables Methods
in System Identification). A motion that is simulated from the force does not contain that noise. Its difference from
the recorded travel is the noise of the travel, and least squares on it are not biased (output error; Ljung 1999,
System Identification, chapter 4).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from opid.errors import InputError
from opid.mechanics.laws.law import Law
from opid.mechanics.response import State, advance, assemble
from opid.mechanics.structure import Joint, Structure
from opid.progress import Say
from opid.signals.recording import Channel, FloatArray, Recording
from opid.signals.resampling import resampled
from opid.suspensions.bench.problem import BenchFit, Ladder, end_on
from opid.suspensions.bench.record import Bench
from opid.suspensions.bench.settings import BenchSettings, SimulationSettings
from opid.suspensions.fitting.least_squares import SeparableFit, independent_samples
from opid.suspensions.law_search.pursuit import LawStep, chosen, is_better, n_terms
from opid.suspensions.model.law_parameters import from_free, positive, to_free


@dataclass(frozen=True, eq=False)
class MovingPart:
    """A part that a force moves on a specimen: m z'' + C z' + K z + F0 + f = F.

    Args:
        straight: (4,) K in N/m, C in N s/m, F0 in N and m in kg.
        law: f.
        begins: (2 + n_memories,) initial travel in m, velocity in m/s and value of each term with memory.
    """

    straight: FloatArray
    law: Law
    begins: FloatArray

    def travel(self, force: FloatArray, *, fs: float, steps_per_sample: int) -> FloatArray:
        """Return the travel that a force makes, m, (n,): Runge-Kutta steps, the force band-limited between its samples.

        Args:
            force: (n,) N.
            fs: sampling rate, Hz.
            steps_per_sample: number of steps from one sample to the next.

        Raises:
            InputError: a motion that grows without bound, or a memory that turns over within a step.

        >>> part = MovingPart(np.array([1e4, 100.0, 0.0, 2.0]), Law(()), np.zeros(2))
        >>> travel = part.travel(np.full(2000, 50.0), fs=500.0, steps_per_sample=2)
        >>> round(float(travel[-1]), 6)
        0.005
        """
        return self.travel_of_half_steps(_interpolate_half_steps(force, fs, steps_per_sample), fs, steps_per_sample)

    def at_rest(self) -> MovingPart:
        """Return the part that begins at rest, with all memories zero."""
        return replace(self, begins=np.zeros_like(self.begins))

    def travel_of_half_steps(self, force: FloatArray, fs: float, steps_per_sample: int) -> FloatArray:
        """Return the travel that a force at half steps, (2 (n - 1) steps_per_sample + 1, 1) N, makes, m, (n,)."""
        stiffness, damping, offset, mass = self.straight.tolist()
        joint = Joint("specimen", np.ones(1), stiffness, damping, self.law)
        free = np.zeros((1, 1))
        ready = assemble(Structure(np.full((1, 1), mass), free, free, joints=(joint,)))
        # All elements of one term begin with the same value.
        counts = [len(term.kind.elements) for term in self.law.terms if term.kind.memory is not None]
        held = np.repeat(self.begins[2:], counts)
        start = State(self.begins[:1].copy(), self.begins[1:2].copy(), np.empty(0), held)
        motion, _ = advance(ready, start, force - offset, fs=fs, steps_per_sample=steps_per_sample)
        return motion.displacement[:, 0]


@dataclass(frozen=True, eq=False)
class Simulation:
    """The motion that is simulated from the measured force, compared with the recorded one.

    Args:
        part: the simulated part; from rest, it simulates any other force.
        travel: (n,) simulated travel, m.
        error_rms_m: rms of the recorded minus the simulated travel, m.
        r2: fraction of the variance of the travel that the simulation explains.
        steps_per_sample: number of steps of the simulation for each sample.
        tried: the laws that were refined by simulation, with the rms error of each, m.
    """

    part: MovingPart
    travel: FloatArray
    error_rms_m: float
    r2: float
    steps_per_sample: int
    tried: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class SimulatedFit:
    """A part and a law fitted to a recorded travel, in the form in which a search compares laws.

    Args:
        part: the fitted part.
        residual: (n,) recorded minus simulated travel, m.
        slopes: (n, n_parameters) derivatives of the simulated travel by `part.straight`, the values of the law and
            `part.begins`.
        steps_per_sample: number of steps of the simulation for each sample.
        at_bound: for each entry of the law's vector, whether its search ended at a bound.
        travel_rms: rms of the recorded travel about its mean, m.
    """

    part: MovingPart
    residual: FloatArray
    slopes: FloatArray
    steps_per_sample: int
    at_bound: tuple[bool, ...]
    travel_rms: float

    @property
    def laws(self) -> dict[str, Law]:
        """The law, in the form for a search."""
        return {"": self.part.law}

    @property
    def law_name(self) -> str:
        """Name of the law."""
        return self.part.law.name

    @cached_property
    def n_independent(self) -> float:
        """Number of independent samples of the residual."""
        return independent_samples(self.residual)

    @property
    def n_data(self) -> int:
        """Number of independent samples."""
        return round(self.n_independent)

    @cached_property
    def error_rms(self) -> float:
        """Rms error of the travel, m, not below the rounding error."""
        return max(float(np.sqrt(np.mean(self.residual**2))), 1e-9 * self.travel_rms)

    @property
    def r2(self) -> float:
        """Fraction of the variance of the travel that the simulation explains."""
        return 1 - (self.error_rms / self.travel_rms) ** 2

    @property
    def bic(self) -> float:
        """Bayesian information criterion (Schwarz 1978) with all samples: smaller is better."""
        n = self.residual.size
        return float(2 * n * np.log(self.error_rms) + self.slopes.shape[1] * np.log(n))


def fit_by_simulation(
    bench: Bench, fit: SeparableFit, settings: SimulationSettings, *, say: Say
) -> SimulatedFit | None:
    """Fit the parameters of a law until the travel simulated from the force is the recorded one.

    The search begins at the fit to the force. It is None if that law cannot be simulated.
    """
    from scipy import optimize

    say(f"the simulated motion of {fit.law.name}")
    n_memories = sum(term.kind.memory is not None for term in fit.law.terms)
    begins = np.concatenate([[bench.travel[0], bench.velocity[0]], np.zeros(n_memories)])
    part = MovingPart(fit.weights, fit.law, begins)
    search = _find_search(part, bench, settings) if part.straight[3] > 0.0 else None
    if search is None:
        return None
    lower, upper = search.bounds
    theta = np.clip(search.encode(part), lower, upper)
    solution = optimize.least_squares(
        search.residual,
        theta,
        jac=search.slopes,
        bounds=(lower, upper),
        x_scale="jac",
        xtol=1e-9,
        ftol=settings.tolerance,
        max_nfev=settings.most_evaluations,
    )
    found = solution.x
    best = search.decode(found)
    # These are the derivatives by the values themselves and not by their logarithms.
    slopes = -search.slopes(found) / search.stretch(found)
    ends = np.isclose(found, lower, atol=1e-3) | np.isclose(found, upper, atol=1e-3)
    at_bound = (ends & np.isfinite(lower))[4 : 4 + best.law.vector.size]
    rms = float(bench.travel.std())
    return SimulatedFit(best, search.residual(found), slopes, search.steps, tuple(at_bound.tolist()), rms)


def _interpolate_half_steps(force: FloatArray, fs: float, steps_per_sample: int) -> FloatArray:
    """Return a force at half steps, (2 (n - 1) steps_per_sample + 1, 1) N, band-limited between its samples."""
    finer = 2 * steps_per_sample
    record = Recording(force[:, np.newaxis], fs=fs, channels=(Channel("force", "N"),))
    return resampled(record, finer * fs, n_samples=(force.size - 1) * finer + 1).samples


def _find_search(part: MovingPart, bench: Bench, settings: SimulationSettings) -> _Search | None:
    """Return the search with the fewest steps that can simulate a part; None where no allowed number is enough."""
    steps = settings.steps_per_sample[0]
    while steps <= settings.steps_per_sample[1]:
        search = _Search(part, bench, _interpolate_half_steps(bench.force, bench.fs, steps), steps, settings)
        # Otherwise the step is too long for a quick memory, or the motion is unbounded.
        if np.isfinite(search.travel(part)).all():
            return search
        steps *= 2
    return None


@dataclass(frozen=True, eq=False)
class _Search:
    """The unknowns of a moving part in the form of the search: positive ones as logarithms."""

    part: MovingPart
    bench: Bench
    force: FloatArray
    steps: int
    settings: SimulationSettings

    def encode(self, part: MovingPart) -> FloatArray:
        """Return the unknowns of a part."""
        straight = part.straight.copy()
        straight[3] = np.log(straight[3])
        return np.concatenate([straight, to_free(part.law), part.begins])

    def decode(self, theta: FloatArray) -> MovingPart:
        """Return the part with these unknowns."""
        straight = theta[:4].copy()
        straight[3] = np.exp(straight[3])
        law, _ = from_free(self.part.law, theta[4 : 4 + self.part.law.vector.size])
        return MovingPart(straight, law, theta[4 + law.vector.size :])

    def stretch(self, theta: FloatArray) -> FloatArray:
        """Return the derivatives of the values by the unknowns."""
        part = self.decode(theta)
        _, of_law = from_free(part.law, to_free(part.law))
        return np.concatenate([np.ones(3), part.straight[3:], of_law, np.ones(part.begins.size)])

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Exponents and memories have bounds; scales and the mass stay within `farthest` of their start values."""
        law, begins = self.part.law, self.part.begins
        upper = np.full(4 + law.vector.size + begins.size, np.inf)
        lower = -upper
        decades = np.log(self.settings.farthest)
        lower[3], upper[3] = np.log(self.part.straight[3]) + np.array([-decades, decades])
        for k, (parameter, value) in enumerate(zip(law.parameter_list, to_free(law).tolist(), strict=True), start=4):
            if parameter.role == "scale":
                lower[k], upper[k] = value - decades, value + decades
            elif parameter.role == "exponent":
                within = np.clip(parameter.within, 1 / self.settings.farthest, self.settings.farthest)
                lower[k], upper[k] = np.log(within)
        if begins.size > 2:
            lower[-(begins.size - 2) :], upper[-(begins.size - 2) :] = -1.0, 1.0
        return lower, upper

    def residual(self, theta: FloatArray) -> FloatArray:
        """Return recorded minus simulated travel, m; infinite where the motion grows without bound."""
        return self.bench.travel - self.travel(self.decode(theta))

    def travel(self, part: MovingPart) -> FloatArray:
        """Return the simulated travel, m; infinite where the motion grows without bound."""
        try:
            travel = part.travel_of_half_steps(self.force, self.bench.fs, self.steps)
        except InputError:
            return np.full(self.bench.travel.size, -np.inf)
        is_bound = np.abs(travel).max() <= self.settings.runaway * np.abs(self.bench.travel).max()
        return travel if is_bound else np.full(travel.size, -np.inf)

    def slopes(self, theta: FloatArray) -> FloatArray:
        """Return the derivatives of `residual`, by differences."""
        at = self.residual(theta)
        _, upper = self.bounds
        columns = []
        for k, width in enumerate(self._widths):
            ahead = theta.copy()
            ahead[k] += width if theta[k] + width <= upper[k] else -width
            with np.errstate(invalid="ignore"):
                column = (self.residual(ahead) - at) / (ahead[k] - theta[k])
            # A motion that becomes unbounded has no derivative.
            columns.append(column if np.isfinite(column).all() else np.zeros_like(column))
        return np.stack(columns, axis=1)

    @cached_property
    def _widths(self) -> FloatArray:
        """Steps of the differences, small in comparison with changes that are visible in the travel."""
        bench, law = self.bench, self.part.law
        z, v, f = (float(each.std()) for each in (bench.travel, bench.velocity, bench.force))
        straight = [f / z, f / v, f, 1.0]
        of_law = np.where(positive(law), 1.0, np.maximum(np.abs(law.vector), 1e-12))
        memories = np.ones(self.part.begins.size - 2)
        return self.settings.difference * np.concatenate([straight, of_law, [z, v], memories])


def refine_ladder(
    bench: Bench, ladder: Ladder, settings: BenchSettings, say: Say
) -> tuple[Ladder, dict[str, SimulatedFit]]:
    """Return the ladder that ends on the law with the best simulation, and the refined laws by their name.

    The chosen law and those closest to it by the force are refined, until one leaves white noise of the travel. If no
    simulation explains more of the travel than its law explains of the force, the noise is in the force and not in the
    travel, and nothing is refined.
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
    return end_on(ladder, best), fits


def _is_better_simulated(fit: SimulatedFit, than: SimulatedFit, settings: BenchSettings) -> bool:
    """Whether a law replaces another by its simulated motion; one of fewer terms does if the other is no better."""
    if n_terms(fit) < n_terms(than):
        return not is_better(than, fit, settings.search)
    return is_better(fit, than, settings.search)
