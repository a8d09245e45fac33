"""Points of stepped-sine response curves as motions of a mode at one frequency, from which its law follows."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.modal.linear.modes import LinearModes
from opid.modal.resonance.settings import ResonanceSettings
from opid.modal.resonance.steady import SteadyState


def read_curve_states(
    frequency_hz: ArrayLike,
    amplitude: ArrayLike,
    phase_deg: ArrayLike,
    *,
    force_n: ArrayLike,
    modes: LinearModes,
    mode: int,
    sensor: str,
    drive_point: str,
    error_fraction: float = 0.01,
    name: str = "response curve",
    settings: ResonanceSettings | None = None,
) -> tuple[SteadyState, ...]:
    """Return the motions of a mode along one response curve; those of several curves together go to `fit_states`.

    What the other modes add to the sensor is subtracted as their linear properties make it of the force. Points far
    below the peak, which say little of the law, are left out.

    Args:
        frequency_hz: (n,) frequencies of the steps, Hz.
        amplitude: (n,) amplitude of the acceleration at the sensor, m/s^2.
        phase_deg: (n,) phase of the acceleration over the force, degrees: 90 at resonance of the drive point.
        force_n: amplitude of the force, one for all points or (n,), N.
        modes: linear modes of the structure.
        mode: number of the mode, from 1.
        sensor: the sensor that was measured.
        drive_point: the sensor where the force acts.
        error_fraction: standard deviation of force and acceleration, as a fraction.
        name: the name of the curve.
        settings: which points count; the usual ones where left out.

    Raises:
        InputError: arrays that do not match, values that are not positive and finite, no such mode or sensor, a mode
            that does not move sensor or drive point, or a force that takes power out of the mode at most points.
    """
    chosen = settings or ResonanceSettings()
    hz, height, phase = (
        np.atleast_1d(np.asarray(each, dtype=np.float64)) for each in (frequency_hz, amplitude, phase_deg)
    )
    force = (
        np.broadcast_to(np.asarray(force_n, dtype=np.float64), hz.shape)
        if np.ndim(force_n) == 0
        else np.asarray(force_n)
    )
    if not hz.shape == height.shape == phase.shape == force.shape or hz.ndim != 1:
        raise InputError(
            f"{name!r} has {hz.size} frequencies, {height.size} amplitudes, {phase.size} phases and {force.size} "
            "forces: give one of each for every point"
        )
    sizes = np.concatenate([hz, height, force])
    if not (
        np.isfinite(phase).all() and np.isfinite(sizes).all() and (sizes > 0.0).all() and 0.0 < error_fraction < 1.0
    ):
        raise InputError(
            f"{name!r} has values that are not finite and positive, or an error of {error_fraction}: leave such points "
            "out, and give the error as a fraction, 0.01 for 1 %"
        )
    index = modes.index(mode)
    at_sensor, at_force = modes.row(sensor), modes.row(drive_point)
    if at_sensor[index] == 0.0 or at_force[index] == 0.0:
        raise InputError(f"mode {mode} does not move {sensor!r} or {drive_point!r}: give a sensor that it moves")
    pole = 2j * np.pi * hz
    displacement = height * np.exp(1j * np.radians(phase)) / pole**2
    dynamic = modes.stiffness() + pole[:, None] ** 2 + pole[:, None] * modes.damping()
    others = at_sensor * at_force * force[:, None] / dynamic
    others[:, index] = 0.0
    q = (displacement - others.sum(axis=1)) / at_sensor[index]
    kept = np.abs(q) > chosen.least_of_peak * np.abs(q).max()
    states = tuple(
        SteadyState(name, p, complex(at_force[index] * f), np.array([each]), error_fraction, error_fraction, 0.0)
        for p, f, each in zip(pole[kept], force[kept], q[kept], strict=True)
    )
    if np.median([each.damping for each in states]) < 0.0:
        raise InputError(
            f"{name!r} takes power out of mode {mode} at most points: its phase is counted the other way round, or "
            "that of a displacement; give the phase of the acceleration over the force, 90 degrees at resonance"
        )
    return states
