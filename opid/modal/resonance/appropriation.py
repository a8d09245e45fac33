"""Nonlinear force appropriation: a phase-locked loop holds one mode of a rig at phase resonance, level after level.

The drive-point acceleration is kept 90 degrees ahead of the force, at the fundamental (Pacini, section 3.2 and Fig. 3).
The harmonics in the other modes show whether the mode under test drives another one (section 4.2.2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opid.errors import InputError, NotDeterminedError
from opid.estimate import format_percent
from opid.mechanics.rig import Rig, find_harmonics
from opid.mechanics.structure import ComplexArray, modal_assurance
from opid.modal.linear.frequency_response import accelerance
from opid.modal.linear.modes import LinearModes, modal_filter, weigh_sensors, weighted_shapes
from opid.modal.resonance.phase_lock import (
    N_HARMONICS,
    Controller,
    Locking,
    Loop,
    PhaseLock,
    find_resonance_error,
    make_controller,
)
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray


@dataclass(frozen=True, eq=False)
class AppropriationLevel:
    """The record at one voltage, taken when the phase had settled.

    Harmonics are complex amplitudes by the number of the harmonic less one, x(t) = Re sum_h X_h exp(j h omega t); the
    mean is left out.

    Args:
        voltage_v: amplitude of the voltage, V; NaN where a measured test has no channel of it.
        frequency_hz: frequency at which it was recorded, Hz.
        locked: whether phase and amplitude settled within the time allowed.
        lock_time_s: time until they settled, or the time allowed, s.
        phase_error_deg: phase of the drive-point acceleration over the force, less 90 degrees, in the record.
        unsteadiness: standard deviation of the fundamental at the drive point from period to period, over its mean.
        force: (5,) harmonics of the force, N.
        sensors: (n_sensors, 5) harmonics of the accelerations, m/s^2, and of second derivatives of strains, strain/s^2.
        modal: (n_modes, 5) harmonics of the modal accelerations, m/s^2 kg^1/2.
        text: a warning about this level, "" if there is none.
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
        drive_point: the sensor where the force acts.
        levels: one level for each voltage.
        range_hz: lowest and highest frequency that the loop could take, Hz; of a measured test, that it took.
        settings: settings of the loop; None of a measured test, whose loop is not known.
        noise_fraction: standard deviation of the noise of the readings over the rms of their clean signal.
    """

    mode: int
    modes: LinearModes
    drive_point: str
    levels: tuple[AppropriationLevel, ...]
    range_hz: tuple[float, float]
    settings: PhaseLock | None
    noise_fraction: float

    @property
    def voltage_v(self) -> FloatArray:
        """(n,) amplitudes of the voltage, V."""
        return np.array([level.voltage_v for level in self.levels])

    @property
    def frequency_hz(self) -> FloatArray:
        """(n,) frequency of phase resonance, Hz."""
        return np.array([level.frequency_hz for level in self.levels])

    @property
    def held_word(self) -> str:
        """What a level is called that counts: the loop of a virtual rig locks, a level of a measured log is steady."""
        return "steady" if self.settings is None else "locked"

    @property
    def locked(self) -> NDArray[np.bool_]:
        """(n,) whether the level locked."""
        return np.array([level.locked for level in self.levels])

    @property
    def lock_time_s(self) -> FloatArray:
        """(n,) time to lock, s."""
        return np.array([level.lock_time_s for level in self.levels])

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
    def amplitude(self) -> FloatArray:
        """(n,) amplitude of the modal displacement of the mode, m kg^1/2: with `frequency_hz` its backbone."""
        return np.abs(self.modal[:, self.modes.index(self.mode), 0]) / (2.0 * np.pi * self.frequency_hz) ** 2

    @property
    def damping_ratio(self) -> FloatArray:
        """(n,) zeta of the mode: the power that the force feeds into it at the fundamental, over 2 omega |q'|^2."""
        index = self.modes.index(self.mode)
        omega = 2.0 * np.pi * self.frequency_hz
        velocity = self.modal[:, index, 0] / (1j * omega)
        fed = self.modes.row(self.drive_point)[index] * np.real(self.force[:, 0] * velocity.conj())
        return fed / (2.0 * omega * np.abs(velocity) ** 2)

    @property
    def text(self) -> str:
        """One sentence on how many levels locked, and how frequency and damping moved."""
        n_locked, times = int(self.locked.sum()), self.lock_time_s[self.locked]
        done = f"{n_locked} of {len(self.levels)} levels of mode {self.mode} locked"
        if not n_locked:
            return f"{done}{f' within {self.settings.longest_s:g} s' if self.settings else ''}."
        f = self.frequency_hz[self.locked]
        return (
            f"{done}, each within {times.max():.2g} s; the resonance moves from {f[0]:.2f} to {f[-1]:.2f} Hz, "
            f"the damping ratio from {format_percent(self.damping_ratio[self.locked][0], 3)} to "
            f"{format_percent(self.damping_ratio[self.locked][-1], 3)}."
        )


@dataclass(frozen=True, eq=False)
class Interaction:
    """The harmonic of another mode that stands out most in a force appropriation, and whether it is an interaction.

    Args:
        target: mode that was held at resonance, from 1.
        mode: the other mode, from 1.
        harmonic: harmonic of the drive frequency, 2 to 5.
        voltage_v: (n,) voltages of the levels, V.
        fractions: (n, n_modes, 5) amplitude of each harmonic of each modal acceleration over the fundamental of the
            target's.
        fraction: (n,) fraction of this harmonic of this mode.
        assurance: (n, n_modes) MAC of each mode's shape with the deflection shape of this harmonic at the sensors.
        driven_fraction: (n,) motion of the mode at this harmonic by the measured force alone, over the observed one.
        holds: (n,) levels that locked and at which all conditions hold.
        flagged: whether they hold at enough levels.
        first_level: the first of these levels, counted from 1; None where there is none.
        least_fraction: least `fraction` that counts.
        least_assurance: least MAC that counts.
        most_driven: largest `driven_fraction` that counts.
        statement: the interaction, or what was examined, in plain words.
    """

    target: int
    mode: int
    harmonic: int
    voltage_v: FloatArray
    fractions: FloatArray
    fraction: FloatArray
    assurance: FloatArray
    driven_fraction: FloatArray
    holds: NDArray[np.bool_]
    flagged: bool
    first_level: int | None
    least_fraction: float
    least_assurance: float
    most_driven: float
    statement: str

    @property
    def mac(self) -> FloatArray:
        """(n,) MAC of the deflection shape with the mode's own shape."""
        return self.assurance[:, self.mode - 1]

    @property
    def mac_of_others(self) -> FloatArray:
        """(n,) the largest MAC of the deflection shape with the shape of any other mode."""
        return np.delete(self.assurance, self.mode - 1, axis=1).max(axis=1)


def appropriate_force(
    rig: Rig,
    modes: LinearModes,
    mode: int,
    *,
    levels_v: ArrayLike,
    rng: np.random.Generator,
    drive_point: str | None = None,
    noise_fraction: float = 0.01,
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
    amplitude has been steady, for the time constant of the mode. A level that does not lock is kept with `locked`
    false, and the next one starts from its state.

    Where other modes move the drive point, too, its phase resonance lies a little off the frequency of the mode.

    Args:
        rig: the structure with its sensors and its shaker, at rest at the beginning.
        modes: linear modes at sensors of the rig.
        mode: number of the mode to hold, from 1; the loop starts at its linear natural frequency.
        levels_v: (n,) amplitudes of the voltage, V (N without a shaker), see `levels_for`.
        rng: source of the noise.
        drive_point: the sensor at the drive point; where left out, the one that reads the same motion.
        noise_fraction: standard deviation of the white noise over the rms of the clean signal of each channel.
        settings: settings of the loop; the usual ones where left out.
        progress: a function that is called with the number of levels done and the number of all.

    Raises:
        InputError: no such mode, a rigid-body mode or one without damping, voltages that are not positive, sensors that
            the rig lacks, or no sensor at the drive point.
    """
    voltages = np.atleast_1d(np.asarray(levels_v, dtype=np.float64))
    if voltages.ndim != 1 or not voltages.size or not ((voltages > 0.0) & np.isfinite(voltages)).all():
        raise InputError(f"levels_v is {levels_v!r}: give positive voltages, one a level")
    control = make_controller(
        rig, modes, mode, drive_point=drive_point, settings=settings, noise_fraction=noise_fraction, rng=rng
    )
    loop, levels = control.start(), []
    for voltage in voltages:
        level, loop = _drive_level(control, loop, float(voltage))
        levels.append(level)
        if progress:
            progress(len(levels), voltages.size)
    point, range_hz = control.drive_point, control.range_hz
    return Appropriation(mode, modes, point, tuple(levels), range_hz, control.settings, noise_fraction)


def levels_for(
    rig: Rig,
    modes: LinearModes,
    mode: int,
    *,
    top_m_per_s2: float,
    rng: np.random.Generator,
    n_levels: int = 70,
    lowest_fraction: float = 0.02,
    drive_point: str | None = None,
    noise_fraction: float = 0.01,
    settings: PhaseLock | None = None,
) -> FloatArray:
    """Return voltages (n_levels,), V, at equal ratios, the last of which brings the drive point to an amplitude.

    The structure is driven from a low voltage up until the amplitude is right to 1 %.

    Args:
        rig: the structure with its sensors and its shaker; it and `modes`, `mode`, `drive_point`, `noise_fraction` and
            `settings` are those of `appropriate_force`.
        top_m_per_s2: amplitude of the fundamental at the drive point, m/s^2.
        rng: source of the noise.
        n_levels: number of voltages, two or more.
        lowest_fraction: the first voltage over the last.

    Raises:
        InputError: a value out of range, or what `appropriate_force` refuses.
        NotDeterminedError: the amplitude is not reached: the loop does not lock below it.
    """
    if not 0.0 < top_m_per_s2 < np.inf or n_levels < 2 or not 0.0 < lowest_fraction < 1.0:
        raise InputError(
            f"{n_levels} levels up to {top_m_per_s2} m/s^2 from {lowest_fraction} of the last are wanted: give two or "
            "more levels, a positive amplitude and a fraction between 0 and 1"
        )
    control = make_controller(
        rig, modes, mode, drive_point=drive_point, settings=settings, noise_fraction=noise_fraction, rng=rng
    )
    loop, index, point = control.start(), modes.index(mode), modes.sensors.index(control.drive_point)
    # This force is surely too low: it assumes linear damping, and nothing lost in the shaker.
    lowest_n = 2.0 * modes.damping_ratio[index] * top_m_per_s2 / modes.shapes[point, index] ** 2
    voltage = lowest_fraction * lowest_n / (rig.shaker.force_per_volt_n if rig.shaker else 1.0)
    for _ in range(25):
        level, loop = _drive_level(control, loop, voltage)
        reached = float(np.abs(level.sensors[point, 0]))
        if level.locked and abs(reached / top_m_per_s2 - 1.0) < 0.01:
            return np.geomspace(lowest_fraction * voltage, voltage, n_levels)
        if not level.locked:
            break
        voltage *= float(np.clip(top_m_per_s2 / reached, 0.5, 2.5))
    raise NotDeterminedError(
        f"mode {mode} came to {reached:.3g} m/s^2 at {level.voltage_v:.3g} V where {top_m_per_s2:g} m/s^2 are wanted: "
        f"{level.text or 'the amplitude does not settle'}; ask for less, or give the voltages"
    )


def modal_interaction(
    appropriation: Appropriation,
    modes: LinearModes | None = None,
    *,
    least_fraction: float = 0.5,
    least_assurance: float = 0.9,
    most_driven: float = 0.2,
    least_levels: int = 3,
) -> Interaction:
    """Return whether a harmonic of the mode under test drives another mode, judged by three conditions (section 4.2.2).

    At a level that locked: the harmonic of the other mode exceeds a fraction of the target's fundamental; the sensors
    deflect at this harmonic in the shape of that mode; and the force cannot have driven it. At harmonic h the measured
    force F_h would move the mode alone by only phi_d F_h times its accelerance,
    -(h omega)^2 / (omega_0^2 - (h omega)^2 + 2 j zeta omega_0 h omega). Of all modes and harmonics, the one for which
    the conditions hold most often is returned, and among equals the one with the largest fraction.

    Args:
        appropriation: see `opid.modal.appropriate_force`.
        modes: linear modes with shapes, frequencies and damping; those of the appropriation where left out.
        least_fraction: least fraction of the target's fundamental; in the paper 0.5.
        least_assurance: least MAC of the deflection shape with the mode's shape; in the paper 0.9.
        most_driven: largest fraction of the observed motion that the force may have driven.
        least_levels: number of levels at which all conditions must hold.

    Raises:
        InputError: a threshold out of range, or modes that do not match those of the appropriation.
    """
    _require_thresholds(least_fraction, least_assurance, most_driven, least_levels)
    known = modes or appropriation.modes
    if known.sensors != appropriation.modes.sensors or known.n_modes != appropriation.modes.n_modes:
        raise InputError("the modes have other sensors or another number of modes than those of the appropriation")

    target, locked = known.index(appropriation.mode), appropriation.locked
    amplitude = np.abs(appropriation.modal)
    fractions = amplitude / amplitude[:, target, :1, np.newaxis]
    driven = _drive_modes(appropriation, known) / np.maximum(amplitude, np.finfo(float).tiny)
    shapes, weights = weighted_shapes(known), weigh_sensors(known)[:, np.newaxis]
    assurance = np.stack([modal_assurance(shapes, weights * of_level) for of_level in appropriation.sensors])
    holds = (fractions > least_fraction) & (assurance >= least_assurance) & (driven <= most_driven)
    holds &= locked[:, np.newaxis, np.newaxis]
    # Harmonics begin at 2, and a rigid-body mode has no resonance that a harmonic could meet.
    others = np.ones(fractions.shape[1:], dtype=bool) & known.elastic[:, np.newaxis]
    others[target], others[:, 0] = False, False
    if not others.any():
        raise InputError("there is no other elastic mode: an interaction needs two, give more modes")
    index, line = _choose_harmonic(holds, fractions, locked, others)
    held = holds[:, index, line]
    found = Interaction(
        target=appropriation.mode,
        mode=index + 1,
        harmonic=line + 1,
        voltage_v=appropriation.voltage_v,
        fractions=fractions,
        fraction=fractions[:, index, line],
        assurance=assurance[:, :, line],
        driven_fraction=driven[:, index, line],
        holds=held,
        flagged=bool(held.sum() >= least_levels),
        first_level=int(np.argmax(held)) + 1 if held.any() else None,
        least_fraction=least_fraction,
        least_assurance=least_assurance,
        most_driven=most_driven,
        statement="",
    )
    return replace(found, statement=_describe_interaction(found, locked, least_levels, appropriation.held_word))


def _require_thresholds(least_fraction: float, least_assurance: float, most_driven: float, least_levels: int) -> None:
    if not (0.0 < least_fraction < np.inf and 0.0 < least_assurance < 1.0 and 0.0 < most_driven < np.inf):
        raise InputError(
            f"least_fraction is {least_fraction}, least_assurance {least_assurance}, most_driven {most_driven}: give "
            "positive numbers, and a MAC below 1"
        )
    if least_levels != int(least_levels) or least_levels < 1:
        raise InputError(f"least_levels is {least_levels}: give a whole number, 1 or more")


def _choose_harmonic(
    holds: NDArray[np.bool_], fractions: FloatArray, locked: NDArray[np.bool_], others: NDArray[np.bool_]
) -> tuple[int, int]:
    """Return the indices of mode and harmonic that fulfil the conditions at the most levels, the largest of equals."""
    times = np.where(others, holds.sum(axis=0), -1)
    largest = np.where(times == times.max(), (fractions[locked] if locked.any() else fractions).max(axis=0), -1.0)
    index, line = np.unravel_index(np.argmax(np.where(others, largest, -1.0)), largest.shape)
    return int(index), int(line)


def _drive_modes(appropriation: Appropriation, modes: LinearModes) -> FloatArray:
    """Return the (n, n_modes, 5) accelerations of each mode by the measured force alone, m/s^2 kg^1/2."""
    frequency = np.outer(appropriation.frequency_hz, np.arange(1, N_HARMONICS + 1))
    single = np.abs(accelerance(modes, frequency.ravel())).reshape(*frequency.shape, modes.n_modes)
    by_force = np.abs(appropriation.force)[:, :, np.newaxis] * np.abs(modes.row(appropriation.drive_point)) * single
    return by_force.swapaxes(1, 2)


def _describe_interaction(found: Interaction, locked: NDArray[np.bool_], least_levels: int, held_word: str) -> str:
    held, n, name = found.holds, locked.size, f"harmonic {found.harmonic} of mode {found.mode}"
    if not locked.any():
        return f"No level of mode {found.target} locked: nothing can be said of interactions."
    if found.flagged:
        # The MAC is rounded down, for 0.998 is not 1.
        least_mac = np.floor(100.0 * found.mac[held].min()) / 100.0
        return (
            f"Mode {found.target} drives mode {found.mode}: from level {found.first_level} on, at "
            f"{int(held.sum())} of {n} levels, {name} exceeds {format_percent(found.least_fraction, 2)} of the "
            f"fundamental of mode {found.target} (up to {format_percent(found.fraction[held].max(), 2)}), the "
            f"deflection has its shape (MAC of {least_mac:.2f} or more, with other modes "
            f"{found.mac_of_others[held].max():.2f} at most), and the force can have driven "
            f"{format_percent(found.driven_fraction[held].max(), 2)} of it at most."
        )
    at = int(np.argmax(np.where(locked, found.fraction, -1.0)))
    return (
        f"No interaction is seen: of all harmonics 2 to {N_HARMONICS} of the other modes at {int(locked.sum())} "
        f"{held_word} levels, {name} comes to {format_percent(found.fraction[at], 2)} of the fundamental of mode "
        f"{found.target} at level {at + 1}, its shape has a MAC of {found.mac[at]:.2f} with the deflection, and the "
        f"force can have driven {format_percent(found.driven_fraction[at], 2)} of it; needed are more than "
        f"{format_percent(found.least_fraction, 2)}, a MAC of {found.least_assurance:g} and at most "
        f"{format_percent(found.most_driven, 2)}, at {least_levels} levels."
    )


def _drive_level(control: Controller, loop: Loop, voltage_v: float) -> tuple[AppropriationLevel, Loop]:
    settings, locking = control.settings, control.lock(loop, voltage_v)
    loop = locking.loop
    readings, state = control.measure(loop, voltage_v, settings.record_periods, control.columns)
    at_point = 1 + control.columns.index(control.drive_column)
    found = find_harmonics(readings, N_HARMONICS, n_periods=settings.record_periods)[1:].T
    by_period = np.fft.rfft(readings[:, at_point].reshape(-1, settings.samples_per_period), axis=1)[:, 1]
    unsteadiness = float(np.std(by_period) / np.abs(by_period.mean()))
    level = AppropriationLevel(
        voltage_v=voltage_v,
        frequency_hz=loop.frequency_hz,
        locked=locking.locked,
        lock_time_s=locking.time_s,
        phase_error_deg=float(np.degrees(find_resonance_error(found[at_point, 0], found[0, 0]))),
        unsteadiness=unsteadiness,
        force=found[0],
        sensors=found[1:],
        modal=modal_filter(control.modes) @ found[1:],
        text=_describe_level(control, locking, unsteadiness),
    )
    return level, replace(loop, state=state)


def _describe_level(control: Controller, locking: Locking, unsteadiness: float) -> str:
    if locking.locked:
        varies = f"the fundamental varies by {format_percent(unsteadiness, 2)} from period to period"
        return f"{varies}: the motion is not periodic" if unsteadiness > MODAL.unsteady else ""
    reached, errors = locking.loop.frequency_hz, locking.errors_deg
    text = (
        f"not locked within {control.settings.longest_s:g} s at {reached:.2f} Hz: the phase error still lies "
        f"between {errors.min():.1f} and {errors.max():.1f} degrees, and the amplitude changes by "
        f"{format_percent(locking.drift, 2)}"
    )
    if reached in control.range_hz:
        text += (
            "; the loop has come to the end of its range: other modes may move the drive point so much that its phase "
            "does not pass 90 degrees"
        )
    return text
