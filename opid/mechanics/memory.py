"""The force of a law along a motion, with its memory, and the energy that it takes in a cycle."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from opid.estimate import Estimate, Estimates
from opid.mechanics.laws.kinds import LAWS
from opid.mechanics.laws.law import FloatArray, Law, Term, TermSet, WithCandidates

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator

# number of evaluations that a recorded motion keeps; a fit of three or four inner parameters repeats as many
_N_KEPT = 8

# Below this fraction of its first force the start of a memory is forgotten: no record is that exact.
_FORGOTTEN = 1e-6


@dataclass(frozen=True, eq=False)
class Motion:
    """Points at which laws are evaluated; there a term with memory has the force of a slow motion in one direction.

    Args:
        z: (n,) travel, m.
        v: (n,) velocity, m/s.
    """

    z: FloatArray
    v: FloatArray

    def force(self, law: Law) -> FloatArray:
        """Return the force of a law, N, (n,)."""
        return self.parameter_gradient(law)[:, _index_amplitudes(law)] @ law.vector[_index_amplitudes(law)]

    def parameter_gradient(self, law: Law) -> FloatArray:
        """Return the derivatives of the force by each entry of `law.vector`, (n, n_parameters)."""
        return law.parameter_gradient(self.z, self.v)

    def start_columns(self, law: Law) -> FloatArray:
        """Return the forces of memories that are not zero at the start, (n, n_memories), in any unit."""
        return np.empty((self.z.size, 0))


@dataclass(frozen=True, eq=False)
class RecordedPath:
    """The velocity of a whole record, along which terms with memory are followed.

    A fit evaluates the same term more than once, so the last evaluations are kept.

    Args:
        v: (n,) velocity, m/s: a straight line between samples.
        fs: sampling rate, Hz.
        is_thinned: whether it has fewer samples than the record; its start columns are then approximate.
    """

    v: FloatArray
    fs: float
    is_thinned: bool
    _followed: dict[Term, FloatArray] = field(init=False, repr=False, default_factory=dict)
    _starts: dict[Term, FloatArray] = field(init=False, repr=False, default_factory=dict)

    def follow(self, term: Term) -> FloatArray:
        """Return the derivatives by the values of a term for unit amplitude, followed by its start column.

        Returns:
            (n, n_values + 1).
        """
        unit = Term(term.name, (1.0, *term.inner))
        found = self._followed.pop(unit, None)
        if found is None:
            found = np.column_stack([_follow_memory((unit,), self.v, self.fs), self._find_start_column(unit)])
        _keep(self._followed, unit, found)
        return found

    def _find_start_column(self, unit: Term) -> FloatArray:
        """Return the start column; a thinned path takes that of a term with rounded parameters."""
        if not self.is_thinned:
            return _find_start_column(unit, self.v, self.fs)
        near = _round_parameters(unit)
        found = self._starts.pop(near, None)
        if found is None:
            found = _find_start_column(near, self.v, self.fs)
        _keep(self._starts, near, found)
        return found


@dataclass(frozen=True, eq=False)
class RecordedMotion(Motion):
    """Samples of a recorded motion: the memory of a law is followed through the whole record.

    The memory is unknown where a record begins. The force that it adds fades and is nearly proportional to it, exactly
    so for Dahl, LuGre and Maxwell.

    Args:
        z: (m,) travel of the samples, m.
        v: (m,) velocity of the samples, m/s.
        sample: (m,) positions of the samples on the path; between its samples where the path is thinned.
        path: path of the whole record.

    >>> from opid.mechanics.laws.law import default_law
    >>> v = np.full(1000, 0.01)
    >>> motion = recorded_motion(np.cumsum(v) / 1000.0, v, 1000.0).part(np.array([0, 50, 999]))
    >>> motion.force(default_law("dahl_friction")).round(1)
    array([  0. , 252.8, 400. ])
    """

    sample: NDArray[np.int64] | FloatArray
    path: RecordedPath

    def parameter_gradient(self, law: Law) -> FloatArray:
        """Return the derivatives of the force by each entry of `law.vector`, (m, n_parameters)."""
        gradient = super().parameter_gradient(law)
        first = 0
        for term in law.terms:
            last = first + len(term.values)
            if term.kind.memory is not None:
                gradient[:, first:last] = self._interpolate_at_samples(term)[:, :-1]
                gradient[:, first + 1 : last] *= term.amplitude
            first = last
        return gradient

    def start_columns(self, law: Law) -> FloatArray:
        """Return the forces of memories that are not zero at the start, (m, n_memories), in any unit.

        A start that is forgotten before the first of these samples has a column of zeros: the samples do not tell it.
        """
        columns = [self._find_start_column(term) for term in law.terms if term.kind.memory is not None]
        return np.stack(columns, axis=1) if columns else super().start_columns(law)

    def _find_start_column(self, term: Term) -> FloatArray:
        column = self._interpolate_at_samples(term)[:, -1]
        whole = np.abs(self.path.follow(term)[:, -1]).max()
        return column if np.abs(column).max(initial=0.0) > _FORGOTTEN * whole else np.zeros_like(column)

    def part(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> RecordedMotion:
        """Return some of the samples."""
        return RecordedMotion(self.z[chosen], self.v[chosen], self.sample[chosen], self.path)

    def _interpolate_at_samples(self, term: Term) -> FloatArray:
        """Return the columns of `RecordedPath.follow` at the samples."""
        along = self.path.follow(term)
        if not self.path.is_thinned:
            return along[self.sample]
        before = np.minimum(self.sample.astype(np.int64), len(along) - 2)
        after = (self.sample - before)[:, np.newaxis]
        return (1.0 - after) * along[before] + after * along[before + 1]


def _keep(kept: dict[Term, FloatArray], term: Term, found: FloatArray) -> None:
    """Keep an evaluation as the last one, and drop the oldest."""
    kept[term] = found
    while len(kept) > _N_KEPT:
        del kept[next(iter(kept))]


def _round_parameters(term: Term) -> Term:
    """Return the term with rounded inner parameters: positive ones to steps of about 20 %, others to 0.2."""
    values = [
        math.exp(0.2 * round(5.0 * math.log(value)))
        if value > 0 and parameter.role != "shape"
        else round(5 * value) / 5
        for value, parameter in zip(term.inner, term.kind.parameters[1:], strict=True)
    ]
    return Term(term.name, (1.0, *values))


def recorded_motion(z: FloatArray, v: FloatArray, fs: float, *, steps_per_rms: float | None = None) -> RecordedMotion:
    """Return all samples of a recorded motion.

    Args:
        z: (n,) travel, m.
        v: (n,) velocity, m/s: a straight line between samples.
        fs: sampling rate, Hz.
        steps_per_rms: number of steps in which the rms velocity covers the rms travel; memories are followed in these
            steps where the record has more samples; None for every sample.
    """
    every = 1 if steps_per_rms is None else int(fs * np.std(z) / max(float(np.std(v)), 1e-300) / steps_per_rms)
    every = min(every, z.size // 2)
    if every <= 1:
        return RecordedMotion(z, v, np.arange(z.size), RecordedPath(v, fs, is_thinned=False))
    # Means over a step keep the travel that is covered.
    ends = np.concatenate([v, np.full(every, v[-1])])
    sums = np.concatenate([[0.0], np.cumsum(ends)])
    nodes = np.arange(0, z.size + every - 1, every)
    low, high = np.maximum(nodes - every // 2, 0), np.minimum(nodes + every // 2 + 1, ends.size)
    path = RecordedPath((sums[high] - sums[low]) / (high - low), fs / every, is_thinned=True)
    return RecordedMotion(z, v, np.arange(z.size) / every, path)


def force_along(law: TermSet, z: FloatArray, v: FloatArray, fs: float) -> FloatArray:
    """Return f(z, v) along a motion, N, (n,).

    Args:
        law: any law; its memories are zero at the start.
        z: (n,) extension, m.
        v: (n,) rate of the extension, m/s: a straight line between samples.
        fs: sampling rate, Hz.

    >>> from opid.mechanics.laws.law import default_law
    >>> t = np.arange(1000) / 1000.0
    >>> friction = force_along(default_law("dahl_friction"), 0.01 * t, np.full(1000, 0.01), 1000.0)
    >>> friction[[0, 50, 999]].round(1)
    array([  0. , 252.8, 400. ])
    """
    amplitudes = _index_amplitudes(law)
    return gradient_along(law, z, v, fs)[:, amplitudes] @ law.vector[amplitudes]


def gradient_along(law: TermSet, z: FloatArray, v: FloatArray, fs: float) -> FloatArray:
    """Return the derivatives of the force along a motion by each entry of `law.vector`, (n, n_parameters).

    The column of an amplitude is the term for unit amplitude. `law`, `z`, `v` and `fs` are those of `force_along`.
    """
    gradient = law.parameter_gradient(z, v)
    remembers = np.array([term.kind.memory is not None for term in law.terms for _ in term.values], dtype=bool)
    if remembers.any():
        gradient[:, remembers] = _follow_memory(law.terms, v, fs)[:, remembers]
    return gradient


@dataclass(frozen=True)
class Loop(Estimates):
    """The loop that a force draws over travel, under a sine of the size and pace of a record.

    Args:
        travel_amplitude_m: amplitude of the sine, sqrt(2) times the rms travel.
        frequency_hz: frequency of the sine, whose rms velocity over rms travel is that of the record; None where time
            has no meaning.
        area_j: area of the loop, the energy that is taken per cycle (per kg if forces are per kg); empty where its
            interval is wider than the energy that a dry friction as strong as the rms force takes, for then it is
            unknown.
    """

    travel_amplitude_m: float
    frequency_hz: float | None
    area_j: Estimate

    @property
    def friction_n(self) -> Estimate:
        """Dry friction that takes the same energy in the cycle, N."""
        path_m, area = 4.0 * self.travel_amplitude_m, self.area_j
        value, std = (None if each is None else each / path_m for each in (area.value, area.std))
        ends = None if area.interval95 is None else (area.interval95[0] / path_m, area.interval95[1] / path_m)
        return Estimate(value, std, ends)

    def within(self, force_rms: float) -> Loop:
        """Return the loop as it is reported beside the rms of the whole force, N, or per kg.

        An energy is left out if its interval is as wide as that of any force of this size, or if it has none and says
        that the part feeds energy into the motion.

        >>> [Loop(0.01, 1.0, Estimate(area)).within(10.0).area_j.value for area in (0.2, -0.2)]
        [0.2, None]
        """
        ends = self.area_j.interval95
        if ends is None:
            is_told = (self.area_j.value or 0.0) >= 0.0
        else:
            is_told = ends[1] - ends[0] <= 8.0 * self.travel_amplitude_m * force_rms
        if is_told:
            return self
        return Loop(self.travel_amplitude_m, self.frequency_hz, Estimate())


# In the fourth cycle the start value of a memory is forgotten.
_N_CYCLES, _CYCLE_SAMPLES = 4, 2000


def sine_like(travel_rms: float, velocity_rms: float) -> tuple[FloatArray, FloatArray, float]:
    """Return travel (m), velocity (m/s) and rate (Hz) of some cycles of a sine of the size and pace of a motion.

    Args:
        travel_rms: rms travel of the motion, m.
        velocity_rms: rms velocity of the motion, m/s.

    >>> z, v, fs = sine_like(0.01, 0.01 * np.pi)
    >>> [round(float(value), 4) for value in (z.max(), v.max(), fs / 2000)]
    [0.0141, 0.0444, 0.5]
    """
    phase = 2 * np.pi * np.arange(_N_CYCLES * _CYCLE_SAMPLES) / _CYCLE_SAMPLES
    fs = _CYCLE_SAMPLES * velocity_rms / travel_rms / (2 * np.pi)
    return np.sqrt(2) * travel_rms * np.sin(phase), np.sqrt(2) * velocity_rms * np.cos(phase), fs


def taken_per_cycle(force: FloatArray, v: FloatArray, fs: float) -> FloatArray:
    """Return the energy that forces take in the last cycle of a motion from `sine_like`.

    Args:
        force: (n,) or (n, n_forces) forces along the motion, N.
        v: (n,) velocity, m/s.
        fs: sampling rate, Hz.
    """
    n = len(v) // _N_CYCLES
    return np.asarray(force[-n:].T @ v[-n:] / fs)


def loop_area(law: TermSet, z: FloatArray, v: FloatArray, fs: float) -> float:
    """Return the energy that the terms of a law with memory take in the last cycle of a motion, J.

    Args:
        law: any law.
        z: (n,) travel from `sine_like`, m.
        v: (n,) velocity, m/s.
        fs: sampling rate, Hz.

    >>> from opid.mechanics.laws.law import default_law
    >>> motion = sine_like(0.01 / np.sqrt(2), 0.1)
    >>> friction = default_law("dahl_friction")
    >>> amplitude_n, bending_m = friction.vector
    >>> float(round(loop_area(friction, *motion) / (4 * amplitude_n * (0.01 - bending_m)), 3))
    1.0
    """
    return float(taken_per_cycle(force_along(law.remembering, z, v, fs), v, fs))


def _follow_memory(terms: Sequence[Term], v: FloatArray, fs: float) -> FloatArray:
    """Return the derivatives along a motion by the values of terms with memory, (n, n_parameters)."""
    # numba takes long to load, and laws without memory do not need it.
    from opid.mechanics.driven import N_HEAD, Interface, joint_arrays
    from opid.mechanics.kernels import remembered_along

    faint = WithCandidates(tuple(terms), 0.0, len(terms))
    joints = joint_arrays([Interface(0.0, 0.0, law=faint)], ground=False)
    found: FloatArray = remembered_along(joints, np.ascontiguousarray(v, dtype=np.float64), 1.0 / fs)
    return found[:, N_HEAD:]


def _find_start_column(term: Term, v: FloatArray, fs: float) -> FloatArray:
    """Return half the difference of the forces after a motion forward and one back, (n,), for unit amplitude.

    It fades, so the record is only followed until it has faded.
    """
    n_before, scale = 20, term.inner[0]
    if is_of_travel := term.kind.parameters[1].unit == "m":
        covered = np.cumsum(np.abs(v)) / fs
    else:
        covered = np.arange(1, v.size + 1) / fs
    # After its scale a memory of travel is nearly full, and one without a bound is not driven far; a memory of time
    # takes any speed.
    speed = scale * fs / n_before if is_of_travel else 1.0
    column = np.zeros(v.size)
    # After fourteen times the scale exp(-14) of most memories is left; one that slips may keep more.
    n = max(256, int(np.searchsorted(covered, 14.0 * scale)))
    while True:
        part = v[:n]
        forward, back = (
            _follow_memory((term,), np.concatenate([np.full(n_before, sign * speed), part]), fs)[n_before:, 0]
            for sign in (1.0, -1.0)
        )
        column[:n] = 0.5 * (forward - back)
        if n >= v.size or np.abs(column[3 * n // 4 : n]).max() < 1e-4 * np.abs(column[:n]).max():
            return column
        n *= 4


def _index_amplitudes(law: TermSet) -> list[int]:
    """Return the indices of the amplitudes in `law.vector`."""
    return np.cumsum([0, *(len(term.values) for term in law.terms)])[:-1].tolist()


def force_at_turns(law: TermSet, extension: FloatArray) -> FloatArray:
    """Return the force where steady cycles turn, N, (n,), less that of the stiffness of memories while nothing slides.

    Without memory it is the force at rest there.

    Args:
        law: springs, dampers, and kinds with memory that have a cycle.
        extension: (n,) ends of the cycles, m.
    """
    at_rest, found = np.zeros_like(extension), np.zeros_like(extension)
    for term in law.terms:
        cycle = term.kind.cycle
        inner = (*term.inner, 1.0, 1.0, 1.0)[:3]
        # A cycle has its mean force where it turns, for both directions have the same there.
        unit = term.evaluate(extension, at_rest) if cycle is None else cycle(extension, np.abs(extension), *inner)
        found += term.amplitude * unit[0]
    return found


# Friction that bends depends on the travel since its last reversal alone, dh/dz = g(h) / s, so that its steady loop
# between -h1 and h1 follows from integrals over h, without time steps.
#
# -log(1 - h1) of the smallest and of the largest loop that is integrated: a smaller one is a power of the amplitude,
# and a larger one has the corners of this one and slides between them
_SIZES, _N_LOOPS, _N_POINTS, _N_FINE = (0.02, 27.0), 80, 201, 4001
# amplitudes of the larger loops over that of the largest one that is integrated
_SLIDING = np.geomspace(1.0, 1e3, 61)[1:]


@dataclass(frozen=True, eq=False)
class SteadyLoop:
    """The loops of a force of unit amplitude and unit travel scale, over the amplitude a of the travel.

    Args:
        stiffness: logarithm of the first harmonic in phase over a, as a function of log a.
        area: logarithm of the area, likewise.
        ends: log a of the smallest and the largest loop.
        travel: (m,) travel from h = 0 on, rising, of a motion in one direction.
        force: (m,) h after that travel.
    """

    stiffness: PchipInterpolator
    area: PchipInterpolator
    ends: tuple[float, float]
    travel: FloatArray
    force: FloatArray

    def find_stiffness(self, amplitude: FloatArray) -> FloatArray:
        """Return the secant stiffness, the first harmonic in phase over the amplitude."""
        return _continue(self.stiffness, self.ends, np.log(amplitude))

    def find_area(self, amplitude: FloatArray) -> FloatArray:
        """Return the area of the loop, the energy that is taken in a cycle."""
        return _continue(self.area, self.ends, np.log(amplitude))

    def find_place(self, force: FloatArray) -> FloatArray:
        """Return the travel from h = 0 to a force, of a motion in one direction."""
        return np.asarray(np.interp(force, self.force, self.travel))

    def find_force(self, travel: FloatArray) -> FloatArray:
        """Return the force after a travel from h = 0 on, of a motion in one direction."""
        return np.asarray(np.interp(travel, self.travel, self.force))

    def find_top(self, amplitude: FloatArray) -> FloatArray:
        """Return the force at the upper end of a steady loop."""
        middle = self.force.size // 2
        # The travel between -h and h grows with h.
        return np.asarray(
            np.interp(2.0 * amplitude, self.travel[middle:] - self.travel[middle::-1], self.force[middle:])
        )


@lru_cache(maxsize=64)
def find_steady_loop(name: str, *inner: float) -> SteadyLoop:
    """Return the loops of `dahl_friction`, or of `bouc_wen` of the shape 1/2, whose largest h is 1.

    Args:
        name: the name of the kind.
        inner: its parameters that follow the scale.

    >>> loop = find_steady_loop("dahl_friction")
    >>> float(round(loop.find_area(np.array([2.0]))[0] / (4.0 * (2.0 - np.tanh(2.0))), 5))
    1.0
    """
    from scipy.integrate import simpson
    from scipy.interpolate import PchipInterpolator

    kind = LAWS[name]
    assert kind.memory is not None
    b, c = (*inner, 0.0, 0.0)[:2]

    def rate(h: FloatArray) -> FloatArray:
        return np.asarray(kind.memory(h, 1.0, 1.0, b, c, 1.0)[0])  # type: ignore[misc]

    h, since, until, step, x = _follow_halves(rate, np.exp(-np.geomspace(*_SIZES, _N_LOOPS)), _N_POINTS)
    whole, below, above = (each[0] for each in _follow_halves(rate, np.exp(-np.array([_SIZES[1]])), _N_FINE)[:3])
    amplitude = 0.5 * (since[:, -1] + until[:, -1])
    area = 2.0 * simpson(step * h * (1.0 / rate(h) - 1.0 / rate(-h)), x=x, axis=1)
    in_phase = _sum_in_phase([since, until], step, x, amplitude[:, None])
    wide = amplitude[-1] * _SLIDING
    in_phase = np.append(
        in_phase, _sum_in_phase([since[-1], 2.0 * amplitude[-1] - until[-1]], step[-1], x[-1], wide[:, None])
    )
    area = np.append(area, area[-1] + 4.0 * (wide - amplitude[-1]))
    amplitude = np.append(amplitude, wide)
    logs = np.log(amplitude)
    return SteadyLoop(
        PchipInterpolator(logs, np.log(in_phase / amplitude)),
        PchipInterpolator(logs, np.log(np.maximum(area, 1e-18))),
        (float(logs[0]), float(logs[-1])),
        np.concatenate([below - below[-1], (above[-1] - above)[-2::-1]]),
        np.concatenate([-whole, whole[-2::-1]]),
    )


def _follow_halves(rate: Callable[[FloatArray], FloatArray], rest: FloatArray, n: int) -> tuple[FloatArray, ...]:
    """Return h, the travels from the lower and from the upper end, dh/dx and x from 1 - rest on to h = 0.

    In x the ends of the loops are as smooth as the rest is; each is (n_loops, n).
    """
    from scipy.integrate import cumulative_simpson

    rest = rest[:, None]
    top = 1.0 - rest
    # The distance of h from its end is top rest sinh^2 x.
    x = np.linspace(0.0, 1.0, n) * np.arcsinh(np.sqrt(1.0 / rest))
    step = 2.0 * top * rest * np.sinh(x) * np.cosh(x)
    h = top * (1.0 - rest * np.sinh(x) ** 2)
    h[:, -1] = 0.0
    start = np.zeros((rest.size, 1))
    since, until = (cumulative_simpson(step / rate(each), x=x, axis=1, initial=start) for each in (-h, h))
    return h, since, until, step, x


def _sum_in_phase(travels: list[FloatArray], step: FloatArray, x: FloatArray, amplitude: FloatArray) -> FloatArray:
    """Return the first harmonic in phase, the mean of |sin wt| over the changes of h, of two halves of a half cycle."""
    from scipy.integrate import simpson

    sines = [np.sqrt(np.maximum(y * (2.0 * amplitude - y), 0.0)) / amplitude for y in travels]
    return np.asarray(2.0 / np.pi * simpson(step * (sines[0] + sines[1]), x=x, axis=-1))


def _continue(curve: PchipInterpolator, ends: tuple[float, float], at: FloatArray) -> FloatArray:
    """Return the exponential of a curve, which is continued by straight lines."""
    inside = np.clip(at, *ends)
    return np.asarray(np.exp(curve(inside) + curve.derivative()(inside) * (at - inside)))
