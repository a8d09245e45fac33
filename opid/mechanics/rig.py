"""A virtual modal test: a structure with sensors, driven by a shaker or a hammer or left to decay.

The shaker is electrodynamic, has a voltage amplifier, and holds the structure by a stinger.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.mechanics.laws.law import FloatArray
from opid.mechanics.response import Assembled, State, advance, assemble, initial_values, require_steps, state_at
from opid.mechanics.structure import ComplexArray, Joint, Structure, natural_frequencies, read_only
from opid.signals.recording import Channel, Recording, recording_from_arrays
from opid.signals.resampling import resampled

ARMATURE, STINGER = "armature", "stinger"


@dataclass(frozen=True)
class Shaker:
    """A modal shaker with a voltage amplifier; by default one of 450 N (100 lbf).

    The coil's current (V - Bl v) / R makes the force (Bl/R) V - (Bl)^2/R v on the armature, v its velocity: seen from
    the structure the amplifier's voltage is a force, and the back-EMF a damper. The coil's inductance is left out (it
    matters above some kHz). The amplifier and the flux distort the voltage,

        F = (Bl/R) (V + 2 h V^2 / V_full),

    so that a sine of amplitude V_full has a second harmonic of h times its fundamental, and one of half the amplitude
    half that fraction: distortion grows with the amplitude, whatever the shaker drives.

    Args:
        armature_kg: moving mass, kg.
        suspension_n_per_m: stiffness that centres the armature, N/m.
        suspension_n_s_per_m: damping of the armature's suspension, N s/m.
        back_emf_n_s_per_m: damping by the back-EMF, (Bl)^2 / R, N s/m.
        force_per_volt_n: gain Bl / R, N/V.
        stinger_n_per_m: axial stiffness of the stinger with the force cell, N/m.
        stinger_n_s_per_m: axial damping of the stinger, N s/m.
        second_harmonic: h, fraction of the second harmonic at the full voltage; 0 for none.
        full_voltage_v: V_full, amplitude of the voltage at full force, V.

    Raises:
        InputError: a mass, stinger, gain or full voltage that is not positive, or another value below 0.
    """

    armature_kg: float = 0.45
    suspension_n_per_m: float = 6e3
    suspension_n_s_per_m: float = 10.0
    back_emf_n_s_per_m: float = 250.0
    force_per_volt_n: float = 16.0
    stinger_n_per_m: float = 1.5e7
    stinger_n_s_per_m: float = 50.0
    second_harmonic: float = 0.0
    full_voltage_v: float = 28.0

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            positive = each.name in ("armature_kg", "force_per_volt_n", "stinger_n_per_m", "full_voltage_v")
            if not (0.0 <= value < np.inf and (value > 0.0 or not positive)):
                needed = "a positive number" if positive else "0 or more"
                raise InputError(f"{each.name} of the shaker is {value}: give {needed}")


def armature_force(shaker: Shaker, voltage: ArrayLike) -> FloatArray:
    """Return the force on an armature that is held, N, of the shape of the voltage.

    >>> armature_force(Shaker(second_harmonic=0.05, full_voltage_v=10.0), [-10.0, 10.0])
    array([-144.,  176.])
    """
    volts = np.asarray(voltage, dtype=np.float64)
    distorted = volts + 2.0 * shaker.second_harmonic / shaker.full_voltage_v * volts**2
    return shaker.force_per_volt_n * distorted


def on_shaker(structure: Structure, shaker: Shaker, direction: ArrayLike) -> Structure:
    """Return a structure with the armature as one more degree of freedom, the last one, "armature".

    The stinger is the last joint, "stinger": the force cell reads its force, which acts on the structure along
    `direction`.

    Args:
        structure: the structure alone.
        shaker: the shaker; its body stands on the ground.
        direction: (n_dof,) direction; the drive point moves by direction . x; in modal coordinates its row of shapes.

    Raises:
        InputError: a direction of the wrong shape or without any motion, or a structure that is on a shaker already.

    >>> block = Structure([[20.0]], [[0.0]], [[0.0]])
    >>> on_shaker(block, Shaker(), [1.0]).names
    ('x1', 'armature')
    """
    point = np.asarray(direction, dtype=np.float64)
    if point.shape != (structure.n_dof,) or not np.isfinite(point).all() or not point.any():
        raise InputError(
            f"the drive point has the direction {direction!r}: give {structure.n_dof} finite number(s), not all zero"
        )
    if ARMATURE in structure.names or any(joint.name == STINGER for joint in structure.joints):
        raise InputError("the structure has an armature or a stinger already: give it without them, for one shaker")
    stinger = Joint(STINGER, np.append(-point, 1.0), shaker.stinger_n_per_m, shaker.stinger_n_s_per_m)
    return Structure(
        _add_border(structure.mass, shaker.armature_kg),
        _add_border(structure.damping, shaker.suspension_n_s_per_m + shaker.back_emf_n_s_per_m),
        _add_border(structure.stiffness, shaker.suspension_n_per_m),
        (*(replace(joint, direction=np.append(joint.direction, 0.0)) for joint in structure.joints), stinger),
        names=(*structure.names, ARMATURE),
    )


def _add_border(matrix: FloatArray, corner: float) -> FloatArray:
    bordered = np.zeros((matrix.shape[0] + 1, matrix.shape[0] + 1))
    bordered[:-1, :-1] = matrix
    bordered[-1, -1] = corner
    return bordered


FORCE = "force"

LARGEST_ANGLE = 0.2
"""Largest phase step of the highest natural frequency, rad: the frequency is then right to 1 part in 10^5."""

LARGEST_ANGLE_IN_BAND = 0.06
"""Largest phase step of a mode that a force may excite, rad. Its frequency is then right to 1 part in 10^7: an error of
1 part in 10^5 moves a k3 that is identified from the record by 0.1 %, more than noise of 1 % does."""

HIGHEST_EXCITED = 0.4
"""Highest frequency that a force should excite, over the sampling rate; a stinger's is mostly above it."""


@dataclass(frozen=True, eq=False)
class Rig:
    """A structure with its drive point and its accelerometers.

    Args:
        structure: the structure, in physical or in modal coordinates.
        drive_point: (n_dof,) direction; the drive point moves by drive_point . x; in modal coordinates its row of
            shapes.
        sensors: (n_sensors, n_dof) rows; a sensor reads its row . x''.
        sensor_names: one name for each sensor, none of them "force".
        shaker: the shaker on the drive point; None if the force is prescribed: a voltage is then a force, 1 N/V.

    Raises:
        InputError: shapes that do not match, or names that are missing or repeated.
    """

    structure: Structure
    drive_point: FloatArray
    sensors: FloatArray
    sensor_names: tuple[str, ...]
    shaker: Shaker | None = None

    def __post_init__(self) -> None:
        n_dof = self.structure.n_dof
        for name, n_axes in (("drive_point", 1), ("sensors", 2)):
            array = read_only(getattr(self, name))
            if array.ndim != n_axes or array.shape[-1] != n_dof or not array.size or not np.isfinite(array).all():
                needed = f"({n_dof},)" if n_axes == 1 else f"(n_sensors, {n_dof})"
                raise InputError(f"{name} of the rig has shape {array.shape}: give {needed} finite numbers")
            object.__setattr__(self, name, array)
        names = tuple(self.sensor_names)
        if len(names) != len(self.sensors) or len({*names, FORCE}) != len(names) + 1:
            raise InputError(
                f"sensor_names are {names}: give {len(self.sensors)} different names, one for each sensor, none of "
                f"them {FORCE!r}"
            )
        object.__setattr__(self, "sensor_names", names)


@dataclass(frozen=True, eq=False)
class RigRun:
    """The record of a virtual test.

    Attributes:
        recording: channels "force" (N), where there is one, and each sensor (m/s^2), with noise.
        clean: the same channels without noise.
        noise_fraction: rms of the noise over that of the clean signal, channel by channel.
        steps_per_sample: steps of the simulation from one sample to the next.
    """

    recording: Recording
    clean: Recording
    noise_fraction: float
    steps_per_sample: int


@dataclass(frozen=True, eq=False)
class OpenRig:
    """A rig that is ready for `drive`.

    Attributes:
        ready: the structure with its shaker.
        sensors: (n_sensors, n_dof) rows of the sensors, with the armature where there is one.
        stinger: direction (n_dof,), stiffness and damping of the stinger; None without a shaker.
        shaker: the shaker, or None.
        fs: sampling rate, Hz.
        steps_per_sample: steps from one sample to the next.
        start: the state at rest.
    """

    ready: Assembled
    sensors: FloatArray
    stinger: tuple[FloatArray, float, float] | None
    shaker: Shaker | None
    fs: float
    steps_per_sample: int
    start: State


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings of the force cell and of the sensors, without noise.

    Attributes:
        force: (n,) force on the drive point, N.
        acceleration: (n, n_sensors) accelerations, m/s^2.
    """

    force: FloatArray
    acceleration: FloatArray


def open_rig(
    rig: Rig,
    fs: float,
    *,
    steps_per_sample: int | None = None,
    largest_angle_rad: float | None = None,
    initial_displacement: ArrayLike | None = None,
    initial_velocity: ArrayLike | None = None,
) -> OpenRig:
    """Return a rig that is ready for `drive`, which a controller calls again and again.

    Args:
        rig: the rig.
        fs: sampling rate, Hz.
        steps_per_sample: steps from one sample to the next; where left out, they follow from the largest angle.
        largest_angle_rad: angle by which the highest natural frequency, that of shaker and stinger included, may turn
            in a step; where left out, 0.2 rad, and 0.06 rad for natural frequencies below 0.4 of the sampling rate.
        initial_displacement: (n_dof,) displacement of the structure at the start, m; zero where left out. The armature
            follows the drive point.
        initial_velocity: (n_dof,) velocity of the structure at the start, m/s; zero where left out.

    Raises:
        InputError: a rate that is not positive, a wrong number of steps or of initial values, or an unstable structure.
    """
    if not 0.0 < fs < np.inf:
        raise InputError(f"fs is {fs} Hz: give a positive rate")
    structure, sensors, stinger, load = rig.structure, rig.sensors, None, rig.drive_point
    start = [
        initial_values("initial_displacement", initial_displacement, structure.n_dof),
        initial_values("initial_velocity", initial_velocity, structure.n_dof),
    ]
    if rig.shaker is not None:
        structure = on_shaker(structure, rig.shaker, rig.drive_point)
        sensors = np.column_stack([sensors, np.zeros(len(sensors))])
        joint = structure.joints[-1]
        stinger = (joint.direction, joint.stiffness_n_per_m, joint.damping_n_s_per_m)
        load = np.eye(structure.n_dof)[-1]
        start = [np.append(each, rig.drive_point @ each) for each in start]
    ready = assemble(structure, load[:, np.newaxis])
    if steps_per_sample is None:
        steps_per_sample = _count_steps(structure, fs, largest_angle_rad)
    require_steps(steps_per_sample)
    return OpenRig(ready, sensors, stinger, rig.shaker, float(fs), int(steps_per_sample), state_at(ready, *start))


def _count_steps(structure: Structure, fs: float, largest_angle_rad: float | None) -> int:
    """Return the steps from one sample to the next with which no natural frequency turns by more than its angle."""
    turns = 2.0 * np.pi * natural_frequencies(structure).frequency_hz / fs
    angles = (
        np.where(turns < 2.0 * np.pi * HIGHEST_EXCITED, LARGEST_ANGLE_IN_BAND, LARGEST_ANGLE)
        if largest_angle_rad is None
        else np.full(turns.size, largest_angle_rad)
    )
    return max(1, int(np.ceil(np.max(turns / angles))))


def drive(rig: OpenRig, state: State, voltage: FloatArray, *, fs: float | None = None) -> tuple[Readings, State]:
    """Return the readings while a voltage drives a rig that begins at a state, and the state after it.

    The last sample is the first one of the next call, whose voltage begins with the last one of this call.

    Args:
        rig: the rig, see `open_rig`.
        state: the state at which the motion begins; `rig.start` at the beginning.
        voltage: (2 n steps_per_sample + 1,) voltage at half steps, for n + 1 samples, V; N without a shaker.
        fs: sampling rate in this call, Hz, for instance a whole number of samples in a period of the drive; that of
            `open_rig` where left out, and not below 0.8 of it, because the step grows.

    Raises:
        InputError: a voltage of another shape or not finite, a rate too low, or a motion without bound.

    >>> block = Rig(Structure([[2.0]], [[0.0]], [[0.0]]), [1.0], [[1.0]], ("block",))
    >>> rig = open_rig(block, 100.0)
    >>> readings, state = drive(rig, rig.start, np.full(21, 6.0))
    >>> readings.acceleration[-1], state.velocity.round(6)
    (array([3.]), array([0.3]))
    """
    rate = rig.fs if fs is None else fs
    if not rate >= 0.8 * rig.fs:
        raise InputError(f"fs is {rate} Hz, the rig was opened for {rig.fs:g} Hz: open it for the lowest rate in use")
    force = np.asarray(voltage, dtype=np.float64) if rig.shaker is None else armature_force(rig.shaker, voltage)
    if force.ndim != 1:
        raise InputError(f"the voltage has shape {force.shape}: give one voltage for each half step")
    motion, after = advance(rig.ready, state, force[:, np.newaxis], fs=rate, steps_per_sample=rig.steps_per_sample)
    if rig.stinger is None:
        measured = force[:: 2 * rig.steps_per_sample].copy()
    else:
        along, stiffness, damping = rig.stinger
        measured = motion.displacement @ (stiffness * along) + motion.velocity @ (damping * along)
    return Readings(measured, motion.acceleration @ rig.sensors.T), after


def find_harmonics(samples: FloatArray, n_harmonics: int, *, n_periods: int = 1) -> ComplexArray:
    """Return the complex amplitudes of whole periods, (n_harmonics + 1, n_channels), the mean first, by Fourier sums.

    `samples`, (n, n_channels), cover `n_periods` periods of the fundamental, x(t) = Re sum_h X_h exp(j h omega t).

    >>> phase = 2 * np.pi * np.arange(64) / 32
    >>> find_harmonics((3.0 + 2.0 * np.cos(phase) - np.sin(2 * phase))[:, None], 2, n_periods=2).round(9)[:, 0]
    array([3.+0.j, 2.-0.j, 0.+1.j])
    """
    found = np.fft.rfft(samples, axis=0)[n_periods * np.arange(n_harmonics + 1)] * (2.0 / samples.shape[0])
    found[0] *= 0.5
    return found


def rig_run(
    rig: Rig,
    voltage: ArrayLike,
    *,
    fs: float,
    rng: np.random.Generator,
    noise_fraction: float = 0.01,
    steps_per_sample: int | None = None,
    initial_displacement: ArrayLike | None = None,
    initial_velocity: ArrayLike | None = None,
) -> RigRun:
    """Return the record while a voltage drives a rig, with the channels "force" and the sensors.

    Between its samples the voltage is the band-limited signal through them: it should hold nothing above 0.45 fs, and
    begin and end near zero, because a sudden start is not band-limited. The readings are sampled without an anti-alias
    filter: take fs above 2.5 times the highest frequency that is excited.

    Args:
        rig: the rig.
        voltage: (n,) voltage, a sample each 1 / fs, V; N without a shaker.
        fs: sampling rate of the voltage and of the record, Hz.
        rng: source of the noise.
        noise_fraction: standard deviation of the white noise over the rms of the clean signal, for each channel.
        steps_per_sample: steps from one sample to the next, see `open_rig`.
        initial_displacement: (n_dof,) displacement at the start, m, see `open_rig`.
        initial_velocity: (n_dof,) velocity at the start, m/s, see `open_rig`.

    Raises:
        InputError: a voltage of the wrong shape or not finite, a negative noise, or what `open_rig` refuses.

    >>> block = Rig(Structure([[2.0]], [[0.0]], [[0.0]]), [1.0], [[1.0]], ("block",))
    >>> beat = np.hanning(200) * np.sin(0.3 * np.arange(200))
    >>> rig_run(block, beat, fs=500.0, rng=np.random.default_rng(1)).recording.names
    ('force', 'block')
    """
    volts = np.asarray(voltage, dtype=np.float64)
    if volts.ndim != 1:
        raise InputError(f"the voltage has shape {volts.shape}: give one voltage for each sample")
    ready = open_rig(
        rig, fs, steps_per_sample=steps_per_sample,
        initial_displacement=initial_displacement, initial_velocity=initial_velocity,
    )  # fmt: skip
    given = recording_from_arrays([volts], ["voltage"], fs=fs, unit="V")
    finer = 2 * ready.steps_per_sample
    between = resampled(given, finer * fs, n_samples=finer * (volts.size - 1) + 1).samples[:, 0]
    # At the samples themselves the spline may be off by rounding.
    between = between.copy()
    between[::finer] = volts
    return _record_run(rig, ready, between, noise_fraction, rng, FORCE)


def impact(
    rig: Rig,
    *,
    peak_n: float,
    pulse_s: float,
    fs: float,
    duration_s: float,
    rng: np.random.Generator,
    at_s: float = 0.02,
    noise_fraction: float = 0.01,
    steps_per_sample: int | None = None,
) -> RigRun:
    """Return the record of a hammer blow at the drive point, with the shaker taken off.

    Args:
        rig: the rig.
        peak_n: peak of the force, a half sine, N.
        pulse_s: length of the pulse, s.
        fs: sampling rate, Hz.
        duration_s: length of the record, s.
        rng: source of the noise.
        at_s: start of the pulse, s.
        noise_fraction: noise of each channel, see `rig_run`.
        steps_per_sample: steps from one sample to the next, see `open_rig`.

    Raises:
        InputError: a pulse shorter than four samples or outside the record, or what `rig_run` refuses.
    """
    if not (pulse_s * fs >= 4.0 and at_s >= 0.0 and at_s + pulse_s <= duration_s and np.isfinite(peak_n)):
        raise InputError(
            f"a pulse of {peak_n} N and {pulse_s} s at {at_s} s is wanted in {duration_s} s at {fs} Hz: give one of "
            "four samples or more inside the record"
        )
    ready = open_rig(replace(rig, shaker=None), fs, steps_per_sample=steps_per_sample)
    phase = (_list_half_steps(ready, duration_s) - at_s) / pulse_s
    force = np.where((phase > 0.0) & (phase < 1.0), peak_n * np.sin(np.pi * phase), 0.0)
    return _record_run(rig, ready, force, noise_fraction, rng, FORCE)


def free_decay(
    rig: Rig,
    *,
    fs: float,
    duration_s: float,
    rng: np.random.Generator,
    initial_displacement: ArrayLike | None = None,
    initial_velocity: ArrayLike | None = None,
    noise_fraction: float = 0.01,
    steps_per_sample: int | None = None,
) -> RigRun:
    """Return the record of a motion that no force drives, with the shaker taken off.

    Args:
        rig: the rig.
        fs: sampling rate, Hz.
        duration_s: length of the record, s.
        rng: source of the noise.
        initial_displacement: (n_dof,) displacement at the start, m; zero where left out. Sliders come to it from zero.
        initial_velocity: (n_dof,) velocity at the start, m/s; zero where left out.
        noise_fraction: noise of each channel, see `rig_run`.
        steps_per_sample: steps from one sample to the next, see `open_rig`.

    Raises:
        InputError: what `rig_run` refuses.
    """
    ready = open_rig(
        replace(rig, shaker=None), fs, steps_per_sample=steps_per_sample,
        initial_displacement=initial_displacement, initial_velocity=initial_velocity,
    )  # fmt: skip
    return _record_run(rig, ready, np.zeros(_list_half_steps(ready, duration_s).size), noise_fraction, rng)


def _record_run(
    rig: Rig, ready: OpenRig, voltage: FloatArray, noise_fraction: float, rng: np.random.Generator, *forces: str
) -> RigRun:
    if not 0.0 <= noise_fraction < np.inf:
        raise InputError(f"noise_fraction is {noise_fraction}: give 0 or more, 0.01 for 1 %")
    readings, _ = drive(ready, ready.start, voltage)
    columns = [*(readings.force for _ in forces), *readings.acceleration.T]
    channels = (*(Channel(name, "N") for name in forces), *(Channel(name, "m/s^2") for name in rig.sensor_names))
    clean = np.stack(columns, axis=1)
    # Each channel has a row of random numbers, so that a further sensor does not change the noise of the others.
    noise = rng.standard_normal(clean.T.shape).T * (noise_fraction * np.sqrt(np.mean(clean**2, axis=0)))
    made = (f"virtual test, {ready.steps_per_sample} steps a sample",)
    return RigRun(
        Recording(clean + noise, fs=ready.fs, channels=channels, history=(*made, f"noise of {noise_fraction:g} rms")),
        Recording(clean, fs=ready.fs, channels=channels, history=made),
        noise_fraction,
        ready.steps_per_sample,
    )


def _list_half_steps(ready: OpenRig, duration_s: float) -> FloatArray:
    n_samples = round(duration_s * ready.fs) if np.isfinite(duration_s) else 0
    if n_samples < 2:
        raise InputError(f"{duration_s} s at {ready.fs:g} Hz are {n_samples} sample(s): at least two are needed")
    finer = 2 * ready.steps_per_sample
    return np.arange(finer * (n_samples - 1) + 1) / (finer * ready.fs)
