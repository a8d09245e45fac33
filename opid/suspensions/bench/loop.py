"""The energy that a law takes in a cycle, all of it and its part that remembers: known better than its parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from opid.estimate import Estimate, Estimates
from opid.mechanics.laws.law import FloatArray, Law
from opid.mechanics.memory import gradient_along
from opid.suspensions.bench.record import Bench


@dataclass(frozen=True)
class Loop(Estimates):
    """The loop that a force draws over travel, under a sine of the size and pace of the record.

    Args:
        travel_amplitude_m: of the sine, sqrt(2) times the rms travel.
        frequency_hz: of the sine, its rms velocity over its rms travel that of the record; None where time means
            nothing.
        area_j: what the loop encloses, the energy that is taken per cycle; empty where its interval reaches farther
            than the energy of a dry friction as strong as the rms force, which says nothing about it.
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


def loop_of(law: Law, covariance: FloatArray, bench: Bench, student: float) -> Loop | None:
    """Return the loop of the terms of a law that remember, by the covariance of its vector; None where there is none.

    `student` is the half width of a 95 % interval over the standard deviation.
    """
    remembers = np.array([term.kind.memory is not None for term in law.terms for _ in term.values], dtype=bool)
    if not remembers.any():
        return None
    part = Law(tuple(term for term in law.terms if term.kind.memory is not None))
    return cycle_of(part, 0.0, np.pad(covariance[np.ix_(remembers, remembers)], (1, 0)), bench, student=student)


def cycle_of(law: Law, damping: float, covariance: FloatArray, bench: Bench, *, student: float) -> Loop:
    """Return the loop of a law beside a damping, N s/m, by the covariance of the damping and the vector of the law."""
    z, v, fs = sine_of(bench)
    # by the end of the fourth cycle the first is forgotten
    n = z.size // 4
    slopes = np.column_stack([v, gradient_along(law, z, v, fs)])[-n:].T @ v[-n:] / fs
    # the force is a sum of terms that are proportional to their amplitudes
    linear = np.array([True, *(parameter.role == "amplitude" for parameter in law.parameter_list)])
    area = float(slopes[linear] @ np.append(damping, law.vector)[linear])
    std = float(np.sqrt(max(float(slopes @ covariance @ slopes), 0.0)))
    frequency_hz = None if bench.is_quasi_static else fs / n
    amplitude_m, wide = float(z.max()), student * std
    told = Estimate(area, std, (area - wide, area + wide)) if np.isfinite(std) else Estimate(area)
    if wide > 4.0 * amplitude_m * float(bench.force[bench.samples].std()):
        told = Estimate()
    return Loop(amplitude_m, frequency_hz, told)


def sine_of(bench: Bench) -> tuple[FloatArray, FloatArray, float]:
    """Return travel (m), velocity (m/s) and rate (Hz) of four cycles of a sine of the size and pace of a record.

    Along the path of a quasi-static test it passes at 1 m/s.

    Args:
        bench: the record.

    >>> t = np.arange(5000) / 500.0
    >>> travel, velocity = 0.01 * np.sin(np.pi * t), 0.01 * np.pi * np.cos(np.pi * t)
    >>> bench = Bench(travel, velocity, t, 500.0, 0.0, "recorded", None, {}, ())
    >>> z, v, fs = sine_of(bench)
    >>> [round(float(value), 4) for value in (z.max(), v.max(), fs / (z.size / 4))]
    [0.01, 0.0314, 0.5]
    """
    travel, velocity = float(bench.travel.std()), float(bench.velocity.std())
    n = 2000
    phase = 2 * np.pi * np.arange(4 * n) / n
    if bench.is_quasi_static:
        quarter = (phase + 0.5 * np.pi / n) * 2 / np.pi % 4
        saw = np.where(quarter < 1, quarter, np.where(quarter < 3, 2 - quarter, quarter - 4))
        rising = np.where((quarter < 1) | (quarter > 3), 1.0, -1.0)
        return np.sqrt(2) * travel * saw, rising, n / (4 * np.sqrt(2) * travel)
    fs = n * velocity / travel / (2 * np.pi)
    return np.sqrt(2) * travel * np.sin(phase), np.sqrt(2) * velocity * np.cos(phase), fs
