"""Stepped-sine response curves: their points as motions of a mode at one frequency, from which its law follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from opid.errors import InputError
from opid.mechanics.structure import ComplexArray, read_only
from opid.modal.linear.modes import LinearModes
from opid.modal.resonance.settings import ResonanceSettings
from opid.modal.resonance.steady import SteadyState
from opid.provenance import ReadFile
from opid.signals.recording import LEAST_SIZE, FloatArray, has_usual_size


@dataclass(frozen=True, eq=False)
class ResponseCurve:
    """The fundamental of one sensor over the frequency of a stepped sine, at one level of the force.

    Args:
        name: the name of the curve.
        sensor: the sensor that was measured.
        frequency_hz: (n,) frequencies of the steps in the order in which they were driven, Hz.
        amplitude: (n,) amplitude of the acceleration at the sensor, m/s^2.
        phase_deg: (n,) phase of the acceleration over the force, degrees: 90 at resonance of the drive point.
        force_n: (n,) amplitude of the force, N; one number where it was the same at all points.
        mode: number of the mode that the curve shows, from 1; where None, the nearest one to its peak.
        error_fraction: standard deviation of force and acceleration, as a fraction.
        files: the file of the curve, and those of its study.

    Raises:
        InputError: arrays that do not match, or values that are not positive and finite.
    """

    name: str
    sensor: str
    frequency_hz: FloatArray
    amplitude: FloatArray
    phase_deg: FloatArray
    force_n: FloatArray
    mode: int | None = None
    error_fraction: float = 0.01
    files: tuple[ReadFile, ...] = ()

    def __post_init__(self) -> None:
        hz, height, phase = (
            np.atleast_1d(read_only(each)) for each in (self.frequency_hz, self.amplitude, self.phase_deg)
        )
        force = read_only(np.broadcast_to(self.force_n, hz.shape) if np.ndim(self.force_n) == 0 else self.force_n)
        if not hz.shape == height.shape == phase.shape == force.shape or hz.ndim != 1:
            raise InputError(
                f"{self.name!r} has {hz.size} frequencies, {height.size} amplitudes, {phase.size} phases and "
                f"{force.size} forces: give one of each for every point"
            )
        if not hz.size:
            raise InputError(f"{self.name!r} has no points: give those of a stepped sine past the resonance")
        sizes = np.concatenate([hz, height, force])
        if not (np.isfinite(phase).all() and np.isfinite(sizes).all() and (sizes > 0.0).all()):
            raise InputError(
                f"{self.name!r} has values that are not finite and positive: leave such points out, and give the sign "
                "of an amplitude as a phase"
            )
        if (sizes < LEAST_SIZE).any() or not all(map(has_usual_size, (hz, height, phase, force))):
            raise InputError(f"{self.name!r} has values of a size that nothing measures: correct its units")
        if not 0.0 < self.error_fraction < 1.0:
            raise InputError(f"error_fraction of {self.name!r} is {self.error_fraction}: give a fraction, 0.01 for 1 %")
        for key, array in (("frequency_hz", hz), ("amplitude", height), ("phase_deg", phase), ("force_n", force)):
            object.__setattr__(self, key, array)

    @property
    def acceleration(self) -> ComplexArray:
        """(n,) complex acceleration at the sensor for a force without phase, m/s^2."""
        return np.asarray(self.amplitude * np.exp(1j * np.radians(self.phase_deg)), dtype=np.complex128)


def find_curve_mode(curve: ResponseCurve, modes: LinearModes, candidates: Sequence[int]) -> int:
    """Return the mode of a curve: the one that it names, or the candidate nearest to the peak of its displacement."""
    peak = float(curve.frequency_hz[np.argmax(curve.amplitude / curve.frequency_hz**2)])
    return curve.mode or min(candidates, key=lambda mode: abs(modes.frequency_hz[modes.index(mode)] - peak))


def read_curve_states(
    curve: ResponseCurve,
    *,
    modes: LinearModes,
    mode: int,
    drive_point: str,
    settings: ResonanceSettings | None = None,
) -> tuple[SteadyState, ...]:
    """Return the motions of a mode along one response curve; those of several curves together go to `fit_states`.

    What the other modes add to the sensor is subtracted as their linear properties make it of the force. Points far
    below the peak, which say little of the law, are left out.

    Args:
        curve: the curve.
        modes: linear modes of the structure.
        mode: number of the mode, from 1.
        drive_point: the sensor where the force acts.
        settings: which points count; the usual ones where left out.

    Raises:
        InputError: no such mode or sensor, a mode that does not move sensor or drive point, or a force that takes power
            out of the mode at most points.
    """
    chosen = settings or ResonanceSettings()
    index = modes.index(mode)
    push = modes.row(drive_point)[index]
    if modes.row(curve.sensor)[index] == 0.0 or push == 0.0:
        raise InputError(f"mode {mode} does not move {curve.sensor!r} or {drive_point!r}: give a sensor that it moves")
    pole = 2j * np.pi * curve.frequency_hz
    others = add_other_modes(curve, modes, mode, drive_point)
    q = (curve.acceleration - others) / pole**2 / modes.row(curve.sensor)[index]
    kept = np.abs(q) > chosen.least_of_peak * np.abs(q).max()
    error = curve.error_fraction
    states = tuple(
        SteadyState(curve.name, p, complex(push * f), np.array([each]), error, error, 0.0)
        for p, f, each in zip(pole[kept], curve.force_n[kept], q[kept], strict=True)
    )
    if np.median([each.damping for each in states]) < 0.0:
        raise InputError(
            f"{curve.name!r} takes power out of mode {mode} at most points: its phase is counted the other way round, "
            "or that of another quantity; give the phase of the motion over the force, of an acceleration 90 degrees "
            "at resonance, with sign = -1 where a lag counts positive"
        )
    return states


def add_other_modes(curve: ResponseCurve, modes: LinearModes, mode: int, drive_point: str) -> ComplexArray:
    """Return what all modes but one add to the sensor at each point, by their linear properties, (n,) m/s^2."""
    pole = 2j * np.pi * curve.frequency_hz
    dynamic = modes.stiffness() + pole[:, None] ** 2 + pole[:, None] * modes.damping()
    each = modes.row(curve.sensor) * modes.row(drive_point) * curve.force_n[:, None] / dynamic
    each[:, modes.index(mode)] = 0.0
    return np.asarray(pole**2 * each.sum(axis=1), dtype=np.complex128)
