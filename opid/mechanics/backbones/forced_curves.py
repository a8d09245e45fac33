"""Response curves of a damped structure under a force of one amplitude, by the phase of a sensor against the force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.backbones.quadrature_curves import HARMONICS, ContinuationLevel, begin_curve, sweep
from opid.mechanics.backbones.specimen import Specimen
from opid.mechanics.laws.law import FloatArray
from opid.mechanics.structure import ComplexArray

# the force grows in this many steps, so that each begins near its solution
_N_RISING = 8


@dataclass(frozen=True, eq=False)
class ForcedCurve:
    """What a force of one amplitude makes of a mode, by the phase of one sensor.

    Over the frequency the curve of a nonlinear mode may turn back, over the phase it does not.

    Args:
        mode: number of the mode, from 1.
        sensor: the sensor whose phase was prescribed.
        force_n: amplitude of the force, N.
        sensors: names of all sensors, in the order of the levels' rows.
        levels: the levels by growing lag of the sensor behind the force; those that were reached.
        reason: why some phases were not reached, "" if all were.
    """

    mode: int
    sensor: str
    force_n: float
    sensors: tuple[str, ...]
    levels: tuple[ContinuationLevel, ...]
    reason: str

    @property
    def phase_deg(self) -> FloatArray:
        """(n,) angle by which the sensor lags the force, degrees; 90 in quadrature."""
        return np.array([90.0 - np.degrees(level.phase_error_rad) for level in self.levels])

    @property
    def frequency_hz(self) -> FloatArray:
        """(n,) frequency, Hz."""
        return np.array([level.frequency_hz for level in self.levels])

    @property
    def amplitude(self) -> FloatArray:
        """(n,) amplitude of the first harmonic of the sensor, m."""
        return np.abs(self.harmonics[:, self.sensors.index(self.sensor), 0])

    @property
    def harmonics(self) -> ComplexArray:
        """(n, n_sensors, n_harmonics) harmonics of the displacements, m."""
        return np.stack([level.sensors for level in self.levels])

    @property
    def resonance(self) -> tuple[float, float] | None:
        """Frequency, Hz, and amplitude, m, of the largest response; None where it lies at an end of the curve.

        They are those of parabolas through the three levels about the largest.
        """
        phase, amplitude = self.phase_deg, self.amplitude
        top = int(np.argmax(amplitude))
        if not 0 < top < phase.size - 1:
            return None
        near = slice(top - 1, top + 2)
        curved = np.polyfit(phase[near] - phase[top], np.column_stack([amplitude, self.frequency_hz])[near], 2)
        at = -curved[1, 0] / (2 * curved[0, 0])
        return float(np.polyval(curved[:, 1], at)), float(np.polyval(curved[:, 0], at))


def forced_curve(
    specimen: Specimen,
    *,
    mode: int,
    sensor: str,
    force_n: float,
    phases: ArrayLike = tuple(range(5, 180, 5)),
    harmonics: Sequence[int] = HARMONICS,
    widest_fraction: float = 0.03,
) -> ForcedCurve:
    """Return the steady response to a force of one amplitude near a mode, by harmonic balance.

    The equations are those of `quadrature_curve`, with Re(X_s1 exp(-j e)) = 0 for a phase e off quadrature, and with
    f given in place of the amplitude. The force grows in quadrature, then the phase is swept both ways from there,
    through the turning points that the curve may have over the frequency. Whether a motion is stable is not found out.

    Args:
        specimen: the structure; its shaker is left out, and the force acts directly.
        mode: number of the mode, from 1.
        sensor: the sensor whose phase is prescribed; one that moves against the drive point counts as one that moves
            with it.
        force_n: amplitude of the force, N.
        phases: (n,) growing angles by which the sensor lags the force, degrees, between 0 and 180 and with some on both
            sides of 90; the curve has the quadrature, too.
        harmonics: harmonics that are balanced, 1 among them; 0 and the even ones, too, where a law is not odd.
        widest_fraction: fraction of the linear frequency within which the linear quadrature lies.

    Raises:
        InputError: no such mode or sensor, a force that is not positive, phases that do not grow between 0 and 180 or
            lie on one side of 90, harmonics without the first, or a mode in which the drive point or the sensor does
            not move.
        NotDeterminedError: the sensor does not reach quadrature at this force.
    """
    if not (np.isfinite(force_n) and force_n > 0.0):
        raise InputError(f"force_n is {force_n!r}: give the positive amplitude of the force, N")
    below, above = _split_phases(phases)
    balance, branch = begin_curve(specimen, mode, (sensor, sensor), harmonics, widest_fraction)
    if branch is None:
        raise NotDeterminedError(f"mode {mode}: {balance.say_miss(1.0, widest_fraction)}, without a force: "
                                 "take another sensor or drive point")  # fmt: skip
    rising = np.linspace(0.0, force_n, _N_RISING + 1)[1:]
    levels, branch = sweep(replace(balance, force_n=0.0), branch, "force_n", rising, np.inf)
    if levels[-1].reason:
        raise NotDeterminedError(f"mode {mode}: {levels[-1].reason}, at {abs(levels[-1].force[0]):.3g} of {force_n:g} "
                                 "N: give a smaller force, or take another sensor or drive point")  # fmt: skip
    sides, top = [], replace(branch, at=0.0, slope=0.0)
    for errors in (below, above):
        swept, _ = sweep(replace(balance, force_n=force_n), top, "phase_error_rad", errors, np.inf)
        sides.append(swept)
    missed = [side.pop().reason for side in sides if side and side[-1].reason]
    every = (*reversed(sides[0]), levels[-1], *sides[1])
    return ForcedCurve(mode, sensor, float(force_n), specimen.system.sensors, every, "; ".join(missed))


def _split_phases(phases: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the phases below and above resonance as errors from quadrature, radians, from there outwards."""
    given = np.atleast_1d(np.asarray(phases, dtype=np.float64))
    sound = given.ndim == 1 and (given > 0.0).all() and (given < 180.0).all() and (np.diff(given) > 0.0).all()
    if not (sound and given.min(initial=90.0) < 90.0 < given.max(initial=90.0)):
        raise InputError(
            f"the phases are {phases!r}: give growing angles between 0 and 180 degrees, on both sides of 90"
        )
    errors = np.radians(90.0 - given)
    return errors[errors > 1e-9][::-1], errors[errors < -1e-9]
