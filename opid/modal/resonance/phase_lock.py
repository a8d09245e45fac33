"""A phase-locked loop on a virtual rig: the frequency of a sine is moved until the response is at phase resonance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from opid.errors import InputError, nearest, require_positive
from opid.mechanics.response import State
from opid.mechanics.rig import OpenRig, Readings, Rig, drive, find_harmonics, open_rig
from opid.modal.linear.modes import LinearModes
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray

LARGEST_ANGLE = 0.4  # turn of the highest natural frequency in a time step, rad
N_HARMONICS = 5  # harmonics of the drive frequency that are recorded, the fundamental included


@dataclass(frozen=True)
class PhaseLock:
    """Settings of the phase-locked loop.

    Args:
        tolerance_deg: largest phase error of a level that has locked, degrees.
        hold_periods: periods for which the error must stay within it; at least the time constant 1 / (zeta omega).
        steady_fraction: largest change of the amplitude at the drive point over these periods, as a fraction of it; the
            phase may settle long before the amplitude does.
        longest_s: time in which a level must lock, s.
        record_periods: whole periods that are recorded after that, at a constant frequency.
        samples_per_period: samples in a period, as the rig is sampled in step with its drive; 16 or more.
        proportional: proportional gain, in zeta omega per radian of phase error.
        integral: integral gain, in (zeta omega)^2 per radian and second.
        range_hz: lowest and highest frequency, Hz; where left out, half-way to the neighbouring modes, where the phase
            passes 90 degrees, too, and at most 15 % away.

    Raises:
        InputError: a value out of range.
    """

    tolerance_deg: float = 1.0
    hold_periods: int = 30
    steady_fraction: float = 0.005
    longest_s: float = 10.0
    record_periods: int = 50
    samples_per_period: int = 64
    proportional: float = 1.0
    integral: float = 2.0
    range_hz: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        counts = {"hold_periods": 1, "record_periods": 4, "samples_per_period": 16}
        for name, least in counts.items():
            value = getattr(self, name)
            if value != int(value) or value < least:
                raise InputError(f"{name} of the phase lock is {value}: give a whole number, {least} or more")
        for name in ("tolerance_deg", "steady_fraction", "longest_s", "proportional", "integral"):
            require_positive(f"{name} of the phase lock", getattr(self, name))


@dataclass(frozen=True, eq=False)
class Loop:
    """The state of the structure and of the controller between two periods."""

    state: State  # state of the structure at phase zero of the drive
    frequency_hz: float  # frequency of the next period, Hz
    integral_hz: float  # part of the frequency that the integral of the phase error has added, Hz
    started: bool  # whether the transient of the sudden start has decayed


@dataclass(frozen=True, eq=False)
class Locking:
    """The end of the search for resonance at one voltage."""

    loop: Loop  # the loop at the end
    locked: bool  # whether phase and amplitude settled within the time allowed
    time_s: float  # time until they settled, or the time allowed, s
    errors_deg: FloatArray  # phase errors of the last periods, degrees
    drift: float  # relative change of the amplitude at the drive point over these periods


@dataclass(frozen=True, eq=False)
class Controller:
    """A phase-locked loop on a rig; nothing in it changes from level to level."""

    rig: OpenRig  # the rig, opened for the lowest frequency of the range
    modes: LinearModes  # linear modes at sensors of the rig
    mode: int  # number of the mode that is held, from 1
    drive_point: str  # the sensor at the drive point
    columns: tuple[int, ...]  # columns of the readings, one for each sensor of the modes
    range_hz: tuple[float, float]  # lowest and highest frequency, Hz
    settings: PhaseLock  # settings of the loop
    noise_fraction: float  # standard deviation of the noise over the rms of the clean signal of each channel
    rng: np.random.Generator  # source of the noise

    @property
    def natural_hz(self) -> float:
        """Linear natural frequency of the mode, Hz."""
        return float(self.modes.frequency_hz[self.modes.index(self.mode)])

    @property
    def rate_rad_s(self) -> float:
        """zeta omega of the mode, rad/s."""
        return float(self.modes.damping_ratio[self.modes.index(self.mode)]) * 2.0 * np.pi * self.natural_hz

    @property
    def drive_column(self) -> int:
        """Column of the sensor at the drive point in the readings."""
        return self.columns[self.modes.sensors.index(self.drive_point)]

    def start(self) -> Loop:
        """Return the loop before the first level, with the structure at rest."""
        return Loop(self.rig.start, self.natural_hz, 0.0, False)

    def lock(self, loop: Loop, voltage_v: float) -> Locking:
        """Run the loop at a voltage, one step for each period of the drive, until phase and amplitude settle."""
        settings, time_s, errors, amplitudes = self.settings, 0.0, [0.0], [0.0]
        # In fewer periods than the time constant of the mode the phase would only pass through its tolerance.
        time_constant = self.natural_hz / self.rate_rad_s
        hold = max(settings.hold_periods, int(np.ceil(time_constant)))
        if not loop.started:
            n_periods = max(1, int(min(MODAL.settling * time_constant, 0.5 * settings.longest_s * self.natural_hz)))
            loop = replace(loop, state=self._drive_periods(loop, voltage_v, n_periods)[1], started=True)
            time_s = n_periods / loop.frequency_hz
        within, locked = 0, False
        while not locked and time_s < settings.longest_s:
            readings, state = self.measure(loop, voltage_v, 1, (self.drive_column,))
            force, acceleration = find_harmonics(readings, N_HARMONICS)[1]
            errors.append(find_resonance_error(acceleration, force))
            amplitudes.append(abs(acceleration))
            within = within + 1 if abs(errors[-1]) <= np.radians(settings.tolerance_deg) else 0
            locked = within >= hold and _find_drift(amplitudes[-hold:]) <= settings.steady_fraction
            time_s += 1.0 / loop.frequency_hz
            loop = self._set_next_frequency(replace(loop, state=state), errors[-1])
        return Locking(loop, locked, time_s, np.degrees(errors[-hold:]), _find_drift(amplitudes[-hold:]))

    def measure(
        self, loop: Loop, voltage_v: float, n_periods: int, columns: tuple[int, ...]
    ) -> tuple[FloatArray, State]:
        """Return noisy force and accelerations (n, 1 + n_columns) over whole periods, and the state after them."""
        readings, state = self._drive_periods(loop, voltage_v, n_periods)
        clean = np.column_stack([readings.force, readings.acceleration[:, list(columns)]])[:-1]
        rms = np.sqrt(np.mean(clean**2, axis=0))
        return clean + self.rng.standard_normal(clean.shape) * (self.noise_fraction * rms), state

    def _drive_periods(self, loop: Loop, voltage_v: float, n_periods: int) -> tuple[Readings, State]:
        """Return clean readings of whole periods from phase zero; the last sample is the first of the next call."""
        n = self.settings.samples_per_period
        half_steps = np.arange(2 * n * n_periods * self.rig.steps_per_sample + 1)
        voltage = voltage_v * np.sin(np.pi / (n * self.rig.steps_per_sample) * half_steps)
        return drive(self.rig, loop.state, voltage, fs=n * loop.frequency_hz)

    def _set_next_frequency(self, loop: Loop, error: float) -> Loop:
        """Return the loop with the frequency of its next period; the limited integral does not wind up."""
        settings, rate, (lowest, highest) = self.settings, self.rate_rad_s, self.range_hz
        gain = settings.integral * rate**2 / (2.0 * np.pi)
        grown = loop.integral_hz + gain * error / loop.frequency_hz
        integral = float(np.clip(grown, lowest - self.natural_hz, highest - self.natural_hz))
        wanted = self.natural_hz + integral + settings.proportional * rate * error / (2.0 * np.pi)
        return replace(loop, frequency_hz=float(np.clip(wanted, lowest, highest)), integral_hz=integral)


def make_controller(
    rig: Rig,
    modes: LinearModes,
    mode: int,
    *,
    drive_point: str | None,
    settings: PhaseLock | None,
    noise_fraction: float,
    rng: np.random.Generator,
) -> Controller:
    """Return a loop ready to hold one mode of a rig at phase resonance.

    Raises:
        InputError: no such mode, a rigid-body mode, one without damping or one that the drive point does not move,
            sensors that the rig lacks, no sensor at the drive point, a negative noise, or a range without the natural
            frequency.
    """
    chosen, point, index = settings or PhaseLock(), drive_point or _find_sensor_at_drive_point(rig), modes.index(mode)
    natural_hz, zeta = float(modes.frequency_hz[index]), float(modes.damping_ratio[index])
    if natural_hz == 0.0 or zeta == 0.0:
        raise InputError(
            f"mode {mode} has {natural_hz:g} Hz and a damping ratio of {zeta:g}: give the number of a damped elastic "
            "mode"
        )
    for name in modes.sensors:
        if name not in rig.sensor_names:
            raise InputError(f"the rig has no sensor {name!r} of the modes: {nearest(name, rig.sensor_names)}")
    if modes.row(point)[index] == 0.0:
        raise InputError(f"the drive point {point!r} does not move in mode {mode}: choose a drive point that moves")
    if not 0.0 <= noise_fraction < np.inf:
        raise InputError(f"noise_fraction is {noise_fraction}: give 0 or more, 0.01 for 1 %")
    below, above = modes.neighbours_hz(mode)
    range_hz = chosen.range_hz or (
        max((1 - MODAL.widest_range) * natural_hz, (below + natural_hz) / 2.0),
        min((1 + MODAL.widest_range) * natural_hz, (above + natural_hz) / 2.0),
    )
    if not 0.0 < range_hz[0] < natural_hz < range_hz[1] < np.inf:
        raise InputError(
            f"the loop may move from {range_hz[0]:g} to {range_hz[1]:g} Hz: give a range with {natural_hz:g} Hz in it"
        )
    # The time steps are longest at the lowest rate. The highest natural frequency is often the stinger's, which nothing
    # excites here.
    fs = chosen.samples_per_period * range_hz[0]
    columns = tuple(rig.sensor_names.index(name) for name in modes.sensors)
    opened = open_rig(rig, fs, largest_angle_rad=LARGEST_ANGLE)
    return Controller(opened, modes, mode, point, columns, range_hz, chosen, noise_fraction, rng)


def find_resonance_error(acceleration: complex, force: complex) -> float:
    """Return the phase of the acceleration over the force less 90 degrees, rad, from -pi to pi.

    >>> find_resonance_error(-1.0, 1.0) > 0
    True
    """
    return float(np.angle(acceleration * np.conj(force) * -1j))


def _find_sensor_at_drive_point(rig: Rig) -> str:
    same = np.flatnonzero(np.abs(rig.sensors - rig.drive_point).max(axis=1) <= 1e-9 * np.abs(rig.drive_point).max())
    if not same.size:
        raise InputError("no sensor of the rig reads the motion of the drive point: add one, or name it in drive_point")
    return rig.sensor_names[same[0]]


def _find_drift(amplitudes: list[float]) -> float:
    """Return the change of the amplitude from the first quarter to the last, over that of the last."""
    quarter = -(-len(amplitudes) // 4)
    last = float(np.mean(amplitudes[-quarter:]))
    return abs(last - float(np.mean(amplitudes[:quarter]))) / last if last else np.inf
