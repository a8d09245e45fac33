"""Sensors that read velocities, displacements and travels, and the accelerations that follow from them.

A channel differentiated twice is blue with noise: white noise of 0.1 mm in a displacement is 1.6 m/s^2 for each root of
a bandwidth where it moves at 20 Hz. So a channel is differentiated only up to the frequency at which it sinks into its
noise, and is zero above.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.signals.recording import FloatArray
from opid.signals.spectra import coherent_fraction, noise_floor

Quantity = Literal["acceleration", "velocity", "displacement", "travel", "pressure", "force", "strain"]
"""What a sensor reads: motion against the ground, how far a suspension is extended, or the force in its strut.

The pressure of the gas in a strut tells how far it is extended. A strain is a force of unknown gain, in any unit.
"""

QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)

UNITS: dict[Quantity, str] = {
    "acceleration": "m/s^2",
    "velocity": "m/s",
    "displacement": "m",
    "travel": "m",
    "pressure": "Pa",
    "force": "N",
}
"""SI unit of each quantity that has one."""


@dataclass(frozen=True)
class QuantitySettings:
    """When a channel is differentiated, and when a travel is refused.

    Args:
        above_noise: a channel is differentiated up to the highest frequency at which its spectral density exceeds that
            of its noise by this factor: there, a fifth of its amplitude is noise.
        compared_fraction: lines above this fraction of that frequency are not compared: the low-pass begins there.
        least_hz: lowest such frequency that is of any use, Hz: a suspension moves at 1 to 3 Hz.
        steepness: exponent of the low-pass at that frequency: an ideal edge would ring, a gentle one would let noise
            through.
        least_hz_by_travel: lowest natural frequency that a body may have by its travel, Hz: below it the travel is in a
            wrong unit. A suspension has 0.7 to 8 Hz.
        most_hz_by_travel: highest such frequency, Hz: above it the travel is in a wrong unit, too.
        least_coherent: least fraction of the body's acceleration that must be coherent with the travel for its sign and
            size to be judged.
        slope_band_hz: band in which they are judged, Hz: there the springs of a suspension rule its force.
    """

    above_noise: float = 25.0
    compared_fraction: float = 0.6
    least_hz: float = 2.0
    steepness: int = 8
    least_hz_by_travel: float = 0.4
    most_hz_by_travel: float = 20.0
    least_coherent: float = 0.3
    slope_band_hz: tuple[float, float] = (0.5, 8.0)


DEFAULTS = QuantitySettings()


def quantity_of(unit: str, stated: Quantity | None) -> Quantity:
    """Return what a channel reads, from its unit and from what the user states of it.

    Args:
        unit: SI unit of the channel.
        stated: the quantity that the user states; None if nothing is stated.

    Raises:
        InputError: a unit that no quantity has, another unit than that of the stated quantity, or a length of which the
            user does not say whether it is a displacement or a travel.

    >>> quantity_of("m/s", None)
    'velocity'
    """
    if stated is not None:
        if UNITS.get(stated, unit) != unit:
            raise InputError(f"its quantity is {stated!r} and its unit is {unit}: give one in {UNITS[stated]}")
        return stated
    if unit == "m":
        raise InputError(
            "it is in m: give quantity = 'displacement' if it reads motion against the ground, or 'travel' if it reads "
            "how far the suspension is extended"
        )
    known: tuple[Quantity, ...] = ("acceleration", "velocity")
    for quantity in known:
        if UNITS[quantity] == unit:
            return quantity
    raise InputError(f"it is in {unit}: give an acceleration, a velocity, a displacement or a travel")


def highest_useful_hz(samples: ArrayLike, *, fs: float, settings: QuantitySettings = DEFAULTS) -> float:
    """Return the frequency up to which a channel exceeds its noise clearly, Hz.

    Args:
        samples: (n,) one channel.
        fs: sampling rate, Hz.
        settings: how far it has to exceed it.

    Raises:
        InputError: the channel sinks into its noise at a frequency that is too low for any use.

    >>> rng = np.random.default_rng(0)
    >>> walk = np.cumsum(rng.standard_normal(20000)) / 100
    >>> 2 < highest_useful_hz(walk + 0.01 * rng.standard_normal(20000), fs=100.0) < 20
    True
    """
    from scipy import signal

    channel = np.asarray(samples, dtype=np.float64)
    frequency_hz, density = signal.welch(channel, fs, nperseg=min(channel.size, round(2 * fs)))
    floor = 2 * noise_floor(channel, fs=fs) ** 2 / fs
    above = (density > settings.above_noise * floor) & (frequency_hz > 0)
    # A line far above the others, which stands alone in the noise, is no motion that a derivative may show.
    below = np.flatnonzero(~above[1:])
    highest_hz = float(frequency_hz[-1] if not below.size else frequency_hz[below[0]])
    if highest_hz < settings.least_hz:
        raise InputError(
            f"it sinks into its noise at {highest_hz:.2g} Hz, and at least {settings.least_hz:g} Hz are needed: give "
            "a sensor with less noise or finer steps, or a rougher run"
        )
    return highest_hz


def accelerate(
    samples: ArrayLike, *, fs: float, n_derivatives: int, highest_hz: float, settings: QuantitySettings = DEFAULTS
) -> FloatArray:
    """Return a channel differentiated once or twice under a zero-phase low-pass, without the mean of the result.

    Args:
        samples: (n,) samples.
        fs: sampling rate, Hz.
        n_derivatives: 0 for the low-pass alone, 1 for a velocity, 2 for a displacement.
        highest_hz: frequency at which the low-pass halves a motion, Hz.
        settings: steepness of the low-pass.

    >>> t = np.arange(4000) / 200
    >>> twice = accelerate(np.sin(9 * t), fs=200.0, n_derivatives=2, highest_hz=20.0)
    >>> bool(np.allclose(twice[400:-400], -81 * np.sin(9 * t)[400:-400], atol=2.0))
    True
    """
    from scipy import fft

    values = np.asarray(samples, dtype=np.float64)
    n = values.size
    # The signal minus the straight line through both ends is continued by its negative mirror image, without a step.
    line = np.linspace(values[0], values[-1], n)
    left = values - line
    odd = np.concatenate([left, -left[-2:0:-1]])
    frequency_hz = fft.rfftfreq(odd.size, 1 / fs)
    low_pass = 1.0 / (1.0 + (frequency_hz / highest_hz) ** settings.steepness)
    found = fft.irfft(fft.rfft(odd) * (2j * np.pi * frequency_hz) ** n_derivatives * low_pass, odd.size)[:n]
    found = found + line if n_derivatives == 0 else found  # The derivatives of a line have no motion.
    return np.asarray(found - found.mean())


def differentiated_noise(
    samples: ArrayLike, *, fs: float, n_derivatives: int, highest_hz: float, settings: QuantitySettings = DEFAULTS
) -> float:
    """Return the noise of a channel once it is differentiated, as white noise of the same power in the compared band.

    Args:
        samples: (n,) the channel, not yet differentiated.
        fs: sampling rate, Hz.
        n_derivatives: 1 for a velocity, 2 for a displacement.
        highest_hz: as for `accelerate`.
        settings: how much of the band is compared.

    Returns:
        Standard deviation, m/s^2.

    >>> noise = 1e-4 * np.random.default_rng(0).standard_normal(20000)
    >>> round(differentiated_noise(noise, fs=200.0, n_derivatives=2, highest_hz=20.0), 1)
    0.3
    """
    highest = 2 * np.pi * settings.compared_fraction * highest_hz
    # The mean of omega^(2 n) from zero to the highest line.
    return noise_floor(samples, fs=fs) * float(highest**n_derivatives / np.sqrt(2 * n_derivatives + 1))


def acceleration_below(travel: ArrayLike, sprung: ArrayLike, *, fs: float) -> FloatArray:
    """Return the acceleration below a suspension, from its travel and the acceleration above, up to a frequency.

    Above the frequency at which the travel sinks into its noise it is zero.

    Args:
        travel: (n,) travel, m; it grows as the suspension extends.
        sprung: (n,) acceleration of the body, m/s^2.
        fs: sampling rate, Hz.

    Raises:
        InputError: a travel that is noise.
    """
    highest_hz = highest_useful_hz(travel, fs=fs)
    above = accelerate(sprung, fs=fs, n_derivatives=0, highest_hz=highest_hz)
    return above - accelerate(travel, fs=fs, n_derivatives=2, highest_hz=highest_hz)


def travel_of_gas(pressure_pa: ArrayLike, *, rest_pa: float, length_m: float, exponent: float) -> FloatArray:
    """Return how far a strut is extended, from the pressure of its gas: L ((p0 / p)^(1/n) - 1).

    A polytropic process has p V^n constant, and the volume of the gas is its piston area times its length.

    Args:
        pressure_pa: (n,) absolute pressure, Pa.
        rest_pa: absolute pressure p0 where the travel is zero, Pa.
        length_m: length L of the gas there, its volume over the piston area, m.
        exponent: polytropic exponent n: 1 for slow motion, up to 1.4 for quick motion.

    Raises:
        InputError: a pressure that is not positive.

    >>> travel_of_gas([2e6, 1e6], rest_pa=2e6, length_m=0.25, exponent=1.0)
    array([0.  , 0.25])
    """
    pressure = np.asarray(pressure_pa, dtype=np.float64)
    if not (pressure.min() > 0.0 and rest_pa > 0.0):
        raise InputError(
            f"its lowest pressure is {pressure.min():.3g} Pa, and absolute pressures are positive: give offset = "
            "101325 if the sensor reads the difference from the air outside"
        )
    return np.asarray(length_m * ((rest_pa / pressure) ** (1.0 / exponent) - 1.0))


def check_travel(travel: ArrayLike, sprung: ArrayLike, *, fs: float, settings: QuantitySettings = DEFAULTS) -> None:
    """Refuse a travel that counts in the wrong direction, or that is in the wrong unit.

    A suspension that is extended pulls its body back: acceleration over travel is -(2 pi f)^2, f a natural frequency.

    Args:
        travel: (n,) travel, m, motion above less that below in the direction of the acceleration.
        sprung: (n,) acceleration of the body, m/s^2.
        fs: sampling rate, Hz.
        settings: what counts as wrong.

    Raises:
        InputError: a travel that grows as the suspension is compressed, or one of a size that no suspension has.
    """
    low_hz, high_hz = settings.slope_band_hz
    columns = [np.asarray(each, dtype=np.float64) for each in (travel, sprung)]
    block = min(round(4 * fs), columns[0].size)
    shared = coherent_fraction(
        columns[1][:, np.newaxis], columns[0][:, np.newaxis], fs=fs, band_hz=settings.slope_band_hz, nperseg=block
    )
    if not shared >= settings.least_coherent:
        raise InputError(
            f"{100 * max(shared, 0.0):.0f} % of the acceleration above is coherent with it from {low_hz:g} to "
            f"{high_hz:g} Hz, and at least {100 * settings.least_coherent:.0f} % are needed: check that it is the "
            "travel of this suspension, on the same clock"
        )
    z, a = (
        accelerate(each, fs=fs, n_derivatives=0, highest_hz=high_hz)
        - accelerate(each, fs=fs, n_derivatives=0, highest_hz=low_hz)
        for each in columns
    )
    slope = -float(z @ a) / float(z @ z)
    if slope < 0:
        raise InputError(
            "it grows where the acceleration above does, and a spring that is extended pulls its body back: give "
            "sign = -1 in the table of [channels] of the one that is turned round (a travel counts in the direction of "
            "the accelerations: extension if the axis is 'up', compression if it is 'down')"
        )
    frequency_hz = np.sqrt(slope) / (2 * np.pi)
    if not settings.least_hz_by_travel < frequency_hz < settings.most_hz_by_travel:
        raise InputError(
            f"with the acceleration above it gives a natural frequency of {frequency_hz:.2g} Hz, which no suspension "
            "has: check its unit and scale"
        )
