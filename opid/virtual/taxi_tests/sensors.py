"""The reading of an acceleration by a sensor and a logger, with their faults."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage, signal
from scipy.spatial.transform import Rotation

from opid.errors import InputError
from opid.mechanics.laws.law import FloatArray
from opid.mechanics.weight import GRAVITY_M_PER_S2

ANTI_ALIAS_PASS = 0.8
ANTI_ALIAS_STOP_DB = 90.0


@dataclass(frozen=True)
class Sensor:
    """An accelerometer with its amplifier and converter; by default its only fault is 5 mm/s^2 of white noise.

    Args:
        noise_m_per_s2: rms of the white noise, m/s^2.
        gain: reading over truth, 1 for a perfect calibration.
        corner_hz: corner of the first-order AC coupling, Hz; 0 for DC coupling.
        cross_axis: fraction of the motion across the axis that leaks in.
        lag_s: delay of this channel, s.
        bits: resolution of the converter from -range to +range; None for a fine one.
        range_m_per_s2: largest magnitude of a reading, m/s^2, at which larger ones are clipped; None for no limit.

    Raises:
        InputError: a negative value where it makes no sense, or bits without a range.
    """

    noise_m_per_s2: float = 0.005
    gain: float = 1.0
    corner_hz: float = 0.0
    cross_axis: float = 0.0
    lag_s: float = 0.0
    bits: int | None = None
    range_m_per_s2: float | None = None

    def __post_init__(self) -> None:
        if not (self.noise_m_per_s2 >= 0.0 and self.corner_hz >= 0.0):
            raise InputError(
                f"noise is {self.noise_m_per_s2} m/s^2, corner {self.corner_hz} Hz: neither can be negative"
            )
        if self.range_m_per_s2 is not None and not self.range_m_per_s2 > 0.0:
            raise InputError(f"range is {self.range_m_per_s2} m/s^2: give a positive number")
        if self.bits is not None and (self.bits < 2 or self.range_m_per_s2 is None):
            raise InputError(f"bits is {self.bits}, range {self.range_m_per_s2}: give two bits or more and the range")


DEFAULT_SENSOR = Sensor()


@dataclass(frozen=True)
class Mounting:
    """How a three-axis sensor is fastened, and the errors that its axes do not share.

    Args:
        turn_rad: rotation vector from the axes of the vehicle (forward, left, up) to those of the sensor, rad.
        zeros_m_per_s2: zero of each axis, m/s^2.
        gains: gain of each axis.
        slip_rad: rotation vector, in the axes of the vehicle, by which it slips in the middle of the record, rad.
        gyroscope_rad_per_s: rms of the noise of its gyroscope, rad/s; None if it has none.
    """

    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    zeros_m_per_s2: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gains: tuple[float, float, float] = (1.0, 1.0, 1.0)
    slip_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyroscope_rad_per_s: float | None = None

    @property
    def vertical(self) -> FloatArray:
        """(3,) upward direction in the axes of the sensor."""
        return np.asarray(Rotation.from_rotvec(self.turn_rad).inv().apply([0.0, 0.0, 1.0]))


def measure_axes(
    acceleration: ArrayLike,
    *,
    fs: float,
    sensor: Sensor,
    mounting: Mounting,
    rng: np.random.Generator,
    pitch_rad: ArrayLike,
) -> FloatArray:
    """Return the readings of a three-axis sensor, gravity included, and of its gyroscope if it has one.

    Args:
        acceleration: (n, 3) true acceleration forward, to the left and up, m/s^2.
        fs: sampling rate, Hz.
        sensor: properties of each axis.
        mounting: how it is fastened.
        rng: source of the noise of all axes.
        pitch_rad: (n,) pitch of the body that carries it, nose down, rad.

    Returns:
        (n, 3) readings, m/s^2; (n, 6) with the angular rates, rad/s.

    >>> on_its_side = Mounting(turn_rad=(np.pi / 2, 0.0, 0.0))
    >>> still, quiet = np.zeros((4, 3)), Sensor(noise_m_per_s2=0.0)
    >>> rng = np.random.default_rng(1)
    >>> read = measure_axes(still, fs=100.0, sensor=quiet, mounting=on_its_side, rng=rng, pitch_rad=np.zeros(4))
    >>> read[0].round(2).tolist()
    [0.0, 9.81, 0.0]
    """
    pitch = np.asarray(pitch_rad, dtype=np.float64)
    pushed = np.asarray(acceleration, dtype=np.float64) + GRAVITY_M_PER_S2 * np.array([0.0, 0.0, 1.0])
    left = np.array([0.0, 1.0, 0.0])
    in_body = Rotation.from_rotvec(np.outer(pitch, left)).inv().apply(pushed)
    rates = np.outer(np.gradient(pitch, 1 / fs), left)
    slipped = (np.arange(pitch.size) >= pitch.size // 2)[:, np.newaxis] * np.asarray(mounting.slip_rad)
    into = (Rotation.from_rotvec(slipped) * Rotation.from_rotvec(mounting.turn_rad)).inv()
    true = into.apply(in_body) * mounting.gains + mounting.zeros_m_per_s2
    columns = [
        measure(each, fs=fs, sensor=sensor, rng=stream) for each, stream in zip(true.T, rng.spawn(3), strict=True)
    ]
    if mounting.gyroscope_rad_per_s is not None:
        noise = mounting.gyroscope_rad_per_s * rng.standard_normal((pitch.size, 3))
        columns += [*(into.apply(rates) + noise).T]
    return np.stack(columns, axis=1)


def measure(
    acceleration: ArrayLike,
    *,
    fs: float,
    sensor: Sensor,
    rng: np.random.Generator,
    cross_axis_acceleration: ArrayLike | None = None,
) -> FloatArray:
    """Return the reading of a sensor: leak, gain, lag, AC coupling, noise, converter steps and clipping, in this order.

    Args:
        acceleration: (n,) true acceleration along the axis, m/s^2, already without content above fs/2.
        fs: sampling rate, Hz.
        sensor: the sensor.
        rng: source of the noise; it makes one draw for each sample, whatever the rms of the noise.
        cross_axis_acceleration: (n,) true acceleration across the axis; needed where the sensor leaks.

    Raises:
        InputError: a leaking sensor without the motion across it, arrays of different length, or an AC
            coupling above fs/2.

    >>> quiet = Sensor(noise_m_per_s2=0.0, gain=1.01)
    >>> measure([0.0, 1.0, -1.0], fs=512.0, sensor=quiet, rng=np.random.default_rng(1))
    array([ 0.  ,  1.01, -1.01])
    """
    reading = np.array(acceleration, dtype=np.float64)
    noise = rng.standard_normal(reading.size)
    if sensor.cross_axis != 0.0:
        if cross_axis_acceleration is None or np.shape(cross_axis_acceleration) != reading.shape:
            raise InputError(
                "the sensor has a cross-axis leak: give the acceleration across its axis, as long as that along it"
            )
        reading = reading + sensor.cross_axis * np.asarray(cross_axis_acceleration)
    reading = sensor.gain * reading
    if sensor.lag_s != 0.0:
        reading = ndimage.shift(reading, sensor.lag_s * fs, order=5, mode="nearest")
    if sensor.corner_hz >= 0.5 * fs:
        raise InputError(f"the corner of the AC coupling is {sensor.corner_hz} Hz: give one below fs/2 = {0.5 * fs} Hz")
    if sensor.corner_hz > 0.0:
        reading = signal.lfilter(*signal.butter(1, sensor.corner_hz, "highpass", fs=fs), reading)
    reading = reading + sensor.noise_m_per_s2 * noise
    if sensor.bits is not None and sensor.range_m_per_s2 is not None:
        step = 2.0 * sensor.range_m_per_s2 / 2**sensor.bits
        reading = step * np.round(reading / step)
    if sensor.range_m_per_s2 is not None:
        reading = np.clip(reading, -sensor.range_m_per_s2, sensor.range_m_per_s2)
    return reading


def decimate(samples: ArrayLike, factor: int) -> FloatArray:
    """Return every factor-th sample after a sharp zero-phase low-pass, the logger's anti-alias filter.

    The filter is flat up to 0.8 of the new Nyquist frequency and 90 dB down from that frequency on (Kaiser window).

    Args:
        samples: (n, ...) samples, time along the first axis.
        factor: number of samples of which one is kept.

    Returns:
        (ceil(n / factor), ...) samples; the first one keeps its time.

    Raises:
        InputError: a factor below one.

    >>> decimate(np.ones(4000), 8).shape
    (500,)
    """
    array = np.asarray(samples, dtype=np.float64)
    if factor < 1:
        raise InputError(f"the decimation factor is {factor}: give a whole number from 1 on")
    if factor == 1:
        return array.copy()
    n_taps, beta = signal.kaiserord(ANTI_ALIAS_STOP_DB, (1.0 - ANTI_ALIAS_PASS) / factor)
    # the middle of the transition, and an odd length so that the delay is a whole number of samples
    cutoff = 0.5 * (1.0 + ANTI_ALIAS_PASS) / factor
    taps = signal.firwin(n_taps | 1, cutoff, window=("kaiser", beta))
    return signal.resample_poly(array, 1, factor, axis=0, window=taps, padtype="line")
