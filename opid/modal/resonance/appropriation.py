"""Nonlinear force appropriation: a phase-locked loop holds one mode of a rig at phase resonance, level after level.

The drive-point acceleration is kept 90 degrees ahead of the force, at the fundamental (Pacini, section 3.2 and Fig. 3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.rig import Rig
from opid.mechanics.structure import ComplexArray
from opid.modal.linear.modes import LinearModes, modal_filter
from opid.modal.resonance.phase_lock import (
    Controller,
    Locking,
    Loop,
    PhaseLock,
    at_rest,
    controller,
    harmonics,
    lock,
    periods,
    phase_error,
    with_noise,
)
from opid.signals.recording import FloatArray

UNSTEADY = 0.02
"""Of the fundamental: where it wanders more than this from period to period, the response is no longer periodic."""

_MOST_TRIALS = 25


@dataclass(frozen=True, eq=False)
class AppropriationLevel:
    """One voltage, held until the phase stands, and what was recorded then.

    Harmonics are complex amplitudes by the number of the harmonic less one, x(t) = Re sum_h X_h exp(j h omega t); the
    mean is left out.

    Args:
        voltage_v: amplitude of the voltage, V.
        frequency_hz: frequency at which it was recorded, Hz.
        locked: whether phase and amplitude stood still within the time allowed.
        lock_time_s: time until then, or the time allowed, s.
        phase_error_deg: phase of the drive-point acceleration over the force, less 90 degrees, in the record.
        unsteadiness: rms of what the fundamental at the drive point does from period to period, share of it.
        force: (5,) harmonics of the force, N.
        sensors: (n_sensors, 5) harmonics of the accelerations, m/s^2.
        modal: (n_modes, 5) harmonics of the modal accelerations, m/s^2 kg^1/2.
        text: what to know of this level; "" if nothing.
    """

    voltage_v: float
    frequency_hz: float
    locked: bool
    lock_time_s: float
    phase_error_deg: float
    unsteadiness: float
    force: ComplexArray
    sensors: ComplexArray
    modal: ComplexArray
    text: str


@dataclass(frozen=True, eq=False)
class Appropriation:
    """All levels of a force appropriation, in the order in which they were driven.

    Args:
        mode: number of the mode that was held at resonance, from 1.
        modes: the linear modes through which the sensors were filtered.
        drive_point: the sensor at whose place the force acts.
        levels: one a voltage.
        range_hz: lowest and highest frequency that the loop could take, Hz.
        settings: of the loop.
        noise_share: of the readings.
    """

    mode: int
    modes: LinearModes
    drive_point: str
    levels: tuple[AppropriationLevel, ...]
    range_hz: tuple[float, float]
    settings: PhaseLock
    noise_share: float

    @property
    def voltage_v(self) -> FloatArray:
        """(n,) amplitudes of the voltage, V."""
        return np.array([level.voltage_v for level in self.levels])

    @property
    def frequency_hz(self) -> FloatArray:
        """(n,) frequency of phase resonance, Hz."""
        return np.array([level.frequency_hz for level in self.levels])

    @property
    def locked(self) -> NDArray[np.bool_]:
        """(n,) whether the level locked."""
        return np.array([level.locked for level in self.levels])

    @property
    def lock_time_s(self) -> FloatArray:
        """(n,) time to lock, s."""
        return np.array([level.lock_time_s for level in self.levels])

    @property
    def phase_error_deg(self) -> FloatArray:
        """(n,) phase error in the record, degrees."""
        return np.array([level.phase_error_deg for level in self.levels])

    @property
    def force(self) -> ComplexArray:
        """(n, 5) harmonics of the force, N."""
        return np.stack([level.force for level in self.levels])

    @property
    def sensors(self) -> ComplexArray:
        """(n, n_sensors, 5) harmonics of the accelerations, m/s^2."""
        return np.stack([level.sensors for level in self.levels])

    @property
    def modal(self) -> ComplexArray:
        """(n, n_modes, 5) harmonics of the modal accelerations, m/s^2 kg^1/2."""
        return np.stack([level.modal for level in self.levels])

    @property
    def drive_point_acceleration(self) -> FloatArray:
        """(n,) amplitude of the fundamental at the drive point, m/s^2."""
        return np.abs(self.sensors[:, self.modes.sensors.index(self.drive_point), 0])

    @property
    def amplitude(self) -> FloatArray:
        """(n,) amplitude of the modal displacement of the mode, m kg^1/2: with `frequency_hz` its backbone."""
        return np.abs(self.modal[:, self.modes.index(self.mode), 0]) / (2.0 * np.pi * self.frequency_hz) ** 2

    @property
    def damping_ratio(self) -> FloatArray:
        """(n,) zeta of the mode: what the force feeds into it at the fundamental, over 2 omega |q'|^2."""
        place = self.modes.index(self.mode)
        omega = 2.0 * np.pi * self.frequency_hz
        velocity = self.modal[:, place, 0] / (1j * omega)
        fed = self.modes.row(self.drive_point)[place] * np.real(self.force[:, 0] * velocity.conj())
        return fed / (2.0 * omega * np.abs(velocity) ** 2)

    @property
    def text(self) -> str:
        """How it went, in one sentence."""
        n_locked, times = int(self.locked.sum()), self.lock_time_s[self.locked]
        done = f"{n_locked} of {len(self.levels)} levels of mode {self.mode} locked"
        if not n_locked:
            return f"{done} within {self.settings.longest_s:g} s."
        f = self.frequency_hz[self.locked]
        return (
            f"{done}, each within {times.max():.2g} s; the resonance moves from {f[0]:.2f} to {f[-1]:.2f} Hz, "
            f"the damping ratio from {self.damping_ratio[self.locked][0]:.2%} to "
            f"{self.damping_ratio[self.locked][-1]:.2%}."
        )


def appropriate_force(
    rig: Rig,
    modes: LinearModes,
    mode: int,
    *,
    levels_v: ArrayLike,
    rng: np.random.Generator,
    drive_point: str | None = None,
    noise_share: float = 0.01,
    settings: PhaseLock | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Appropriation:
    """Return one mode of a rig at phase resonance, at one voltage after the other (Pacini, section 3.2).

    A sine of constant amplitude drives the shaker. Force and drive-point acceleration are demodulated over each period
    of it, and the frequency of the next period comes from the phase error e, in radians:

        omega = omega_0 + p zeta omega_0 e + i (zeta omega_0)^2 integral of e dt.

    Below resonance the acceleration leads the force by more than 90 degrees, e > 0, and the frequency rises. As the
    rig is sampled in step with the drive, a period holds a whole number of samples, and neither the mean nor another
    harmonic leaks into the phase. A level has locked when the phase error has stayed within its tolerance, and the
    amplitude has stood, for the time constant of the mode. One that does not lock is kept, `locked` false, and the next
    one goes on from where it stands.

    Where other modes move the drive point, too, the frequency is that of its phase resonance, not quite the mode's.

    Args:
        rig: the structure with its sensors and its shaker, at rest at the begin.
        modes: linear modes at sensors of the rig.
        mode: the one to hold, counted from 1; the loop starts at its linear natural frequency.
        levels_v: (n,) amplitudes of the voltage, V (N without a shaker), see `levels_for`.
        rng: source of the noise.
        drive_point: the sensor at the drive point; where left out, the one that reads the same motion.
        noise_share: standard deviation of the white noise over the rms of the clean signal of each channel.
        settings: of the loop; the usual ones where left out.
        progress: called with the number of levels done and of all.

    Raises:
        InputError: no such mode, a rigid-body mode or one without damping, voltages that are not positive, sensors that
            the rig lacks, or no sensor at the drive point.
    """
    voltages = np.atleast_1d(np.asarray(levels_v, dtype=np.float64))
    if voltages.ndim != 1 or not voltages.size or not ((voltages > 0.0) & np.isfinite(voltages)).all():
        raise InputError(f"levels_v is {levels_v!r}: give positive voltages, one a level")
    chosen = settings or PhaseLock()
    point = drive_point or _sensor_at_drive_point(rig)
    control = controller(rig, modes, mode, drive_point=point, settings=chosen, noise_share=noise_share, rng=rng)
    loop, levels = at_rest(control), []
    for voltage in voltages:
        level, loop = _level(control, loop, float(voltage), modes)
        levels.append(level)
        if progress:
            progress(len(levels), voltages.size)
    return Appropriation(mode, modes, point, tuple(levels), control.range_hz, chosen, noise_share)


def levels_for(
    rig: Rig,
    modes: LinearModes,
    mode: int,
    *,
    top_m_per_s2: float,
    rng: np.random.Generator,
    n_levels: int = 70,
    lowest_share: float = 0.02,
    drive_point: str | None = None,
    noise_share: float = 0.01,
    settings: PhaseLock | None = None,
) -> FloatArray:
    """Return voltages (n_levels,), V, at equal ratios, the last of which brings the drive point to an amplitude.

    The structure is driven, from a low voltage up, until it is there to 1 %.

    Args:
        rig: as for `appropriate_force`.
        modes: likewise.
        mode: likewise.
        top_m_per_s2: amplitude of the fundamental at the drive point, m/s^2.
        rng: source of the noise.
        n_levels: number of voltages, two or more.
        lowest_share: the first voltage over the last.
        drive_point: as for `appropriate_force`.
        noise_share: likewise.
        settings: likewise.

    Raises:
        InputError: a value out of range, or as `appropriate_force`.
        NotDeterminedError: the amplitude is not reached: the loop does not lock below it.
    """
    if not 0.0 < top_m_per_s2 < np.inf or n_levels < 2 or not 0.0 < lowest_share < 1.0:
        raise InputError(
            f"{n_levels} levels up to {top_m_per_s2} m/s^2 from {lowest_share} of the last are wanted: give two or "
            "more levels, a positive amplitude and a share between 0 and 1"
        )
    point = drive_point or _sensor_at_drive_point(rig)
    chosen = settings or PhaseLock()
    control = controller(rig, modes, mode, drive_point=point, settings=chosen, noise_share=noise_share, rng=rng)
    loop = at_rest(control)
    # a force that is surely too low: at the linear damping, and with nothing lost in the shaker
    place = modes.index(mode)
    lowest_n = 2.0 * modes.damping_ratio[place] * top_m_per_s2 / modes.row(point)[place] ** 2
    voltage = lowest_share * lowest_n / (rig.shaker.force_per_volt_n if rig.shaker else 1.0)
    for _ in range(_MOST_TRIALS):
        level, loop = _level(control, loop, voltage, modes)
        reached = float(np.abs(level.sensors[modes.sensors.index(point), 0]))
        if level.locked and abs(reached / top_m_per_s2 - 1.0) < 0.01:
            return np.geomspace(lowest_share * voltage, voltage, n_levels)
        if not level.locked:
            break
        voltage *= float(np.clip(top_m_per_s2 / reached, 0.5, 2.5))
    raise NotDeterminedError(
        f"mode {mode} came to {reached:.3g} m/s^2 at {level.voltage_v:.3g} V where {top_m_per_s2:g} m/s^2 are wanted: "
        f"{level.text or 'the amplitude does not settle'}; ask for less, or give the voltages"
    )


def _sensor_at_drive_point(rig: Rig) -> str:
    same = np.flatnonzero(np.abs(rig.sensors - rig.drive_point).max(axis=1) <= 1e-9 * np.abs(rig.drive_point).max())
    if not same.size:
        raise InputError("no sensor of the rig reads the motion of the drive point: add one, or name it in drive_point")
    return rig.sensor_names[same[0]]


def _level(control: Controller, loop: Loop, voltage_v: float, modes: LinearModes) -> tuple[AppropriationLevel, Loop]:
    """Hold one voltage until the phase stands, and record."""
    settings = control.settings
    locking = lock(control, loop, voltage_v)
    loop = locking.loop
    readings, state = periods(control, loop, voltage_v, settings.record_periods)
    noisy = with_noise(control, np.column_stack([readings.force, readings.acceleration[:, list(control.columns)]]))
    at_point = 1 + control.columns.index(control.drive_column)
    found = harmonics(noisy, settings.record_periods)
    by_period = np.fft.rfft(noisy[:, at_point].reshape(-1, settings.samples_per_period), axis=1)[:, 1]
    unsteadiness = float(np.std(by_period) / np.abs(by_period.mean()))
    level = AppropriationLevel(
        voltage_v=voltage_v,
        frequency_hz=loop.frequency_hz,
        locked=locking.locked,
        lock_time_s=locking.time_s,
        phase_error_deg=float(np.degrees(phase_error(found[at_point, 0], found[0, 0]))),
        unsteadiness=unsteadiness,
        force=found[0],
        sensors=found[1:],
        modal=modal_filter(modes) @ found[1:],
        text=_text(control, locking, unsteadiness),
    )
    return level, replace(loop, state=state)


def _text(control: Controller, locking: Locking, unsteadiness: float) -> str:
    if locking.locked:
        wanders = f"the fundamental wanders by {unsteadiness:.1%} from period to period: the motion is not periodic"
        return wanders if unsteadiness > UNSTEADY else ""
    reached, errors = locking.loop.frequency_hz, locking.errors_deg
    text = (
        f"not locked within {control.settings.longest_s:g} s at {reached:.2f} Hz: the phase error still lies "
        f"between {errors.min():.1f} and {errors.max():.1f} degrees, the amplitude moves by {locking.drift:.1%}"
    )
    if reached in control.range_hz:
        text += (
            "; the loop has come to the end of its range, as where other modes move the drive point so much that its "
            "phase does not pass 90 degrees"
        )
    return text
