"""From accelerations to velocities and displacements, and why the obvious recipe fails.

An accelerometer's offset, its noise below the first resonance and the unknown velocity at the first sample all grow
when they are integrated. Removing the mean before each integration (Iwaniec & Uhl 2007, section 3) does not stop
that: the mean of a velocity over a finite run is not its constant of integration. If the relative velocity differs
by dv between the ends of a run of T seconds, the recipe adds a parabola of height dv T/8 to the displacement, which
for 40 s and 0.06 m/s is 0.3 m beside a true travel of some millimetres. Every other method here therefore removes
the band in which nothing can be known (below `high_pass_hz`) and applies the *same* filter to the acceleration, so
that a linear equation between the signals still holds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError, nearest
from opid.signals.recording import FloatArray

IntegrationMethod = Literal["spectral", "zero_phase", "mean_removed"]
METHODS: tuple[IntegrationMethod, ...] = ("spectral", "zero_phase", "mean_removed")

DERIVATIVES = {"m": 0, "m/s": 1, "m/s^2": 2}
"""SI units of a motion, and the number of the derivative of the displacement that each belongs to."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Acceleration, velocity and displacement of one motion, all seen through the same filter.

    Args:
        acceleration: (n,) acceleration, m/s^2.
        velocity: (n,) velocity, m/s.
        displacement: (n,) displacement, m.
        fs: sampling rate, Hz.
        method: method of integration.
        high_pass_hz: corner below which nothing is kept, Hz; 0 for `mean_removed`.
        settle_s: time at each end of the run in which the filter has not settled, s.
    """

    acceleration: FloatArray
    velocity: FloatArray
    displacement: FloatArray
    fs: float
    method: IntegrationMethod
    high_pass_hz: float
    settle_s: float

    @property
    def interior(self) -> slice:
        """The samples that lie more than `settle_s` from both ends."""
        margin = round(self.settle_s * self.fs)
        return slice(margin, len(self.acceleration) - margin)


def integrate(
    acceleration: ArrayLike,
    *,
    fs: float,
    method: IntegrationMethod = "spectral",
    high_pass_hz: float = 0.3,
) -> Motion:
    """Integrate an acceleration twice.

    `spectral` divides the Fourier transform by j omega under a zero-phase high-pass H = u/(1 + u),
    u = (f/f_c)^4; `zero_phase` passes the trapezoidal integral forwards and backwards through a second-order
    Butterworth high-pass at each stage; `mean_removed` is the literal recipe of Iwaniec & Uhl (2007, section 3).

    Args:
        acceleration: (n,) samples, m/s^2.
        fs: sampling rate, Hz.
        method: "spectral", "zero_phase" or "mean_removed".
        high_pass_hz: corner of the high-pass, Hz; not used by "mean_removed".

    Raises:
        InputError: an unknown method, a corner outside (0, fs/2), or a run shorter than three periods of the corner.

    >>> fs, t = 256.0, np.arange(20 * 256) / 256.0
    >>> motion = integrate(np.sin(2 * np.pi * 2 * t), fs=fs)
    >>> bool(np.allclose(motion.velocity[motion.interior].std(), 0.5**0.5 / (2 * np.pi * 2), rtol=2e-3))
    True
    """
    samples = np.asarray(acceleration, dtype=np.float64)
    if samples.ndim != 1 or samples.size < 2:
        raise InputError(f"acceleration has shape {samples.shape}: give a one-dimensional array of samples")
    if method not in METHODS:
        raise InputError(f"there is no integration method {method!r}: {nearest(method, METHODS)}")
    if method == "mean_removed":
        return _integrate_mean_removed(samples, fs=fs)
    if not 0 < high_pass_hz < fs / 2:
        raise InputError(f"high_pass_hz is {high_pass_hz}: give a corner between 0 and fs/2 = {fs / 2:g} Hz")
    if samples.size < 3 * fs / high_pass_hz:
        raise InputError(
            f"the run lasts {samples.size / fs:.3g} s, less than three periods of the {high_pass_hz:g} Hz high-pass: "
            f"give a longer run or a corner above {3 * fs / samples.size:.2g} Hz"
        )
    if method == "spectral":
        return _integrate_spectral(samples, fs=fs, high_pass_hz=high_pass_hz)
    return _integrate_zero_phase(samples, fs=fs, high_pass_hz=high_pass_hz)


def differentiate(samples: ArrayLike, *, fs: float, times: Literal[1, 2] = 1) -> FloatArray:
    """Return the first or second time derivative of a signal, exact for all frequencies below half of the rate.

    The signal minus the straight line through both ends is a sine series over the record, whose derivative is a cosine
    series. The second derivative is again a sine series: if the first one were differentiated like a signal, its noise
    at both ends would become steps, which have low frequencies, too.

    Args:
        samples: (n,) samples, two or more.
        fs: sampling rate, Hz.
        times: 1 for the first derivative, 2 for the second.

    >>> t = np.arange(200) / 100
    >>> bool(np.allclose(differentiate(np.sin(9 * t), fs=100.0)[5:-5], 9 * np.cos(9 * t)[5:-5], atol=0.02))
    True
    """
    values = np.asarray(samples, dtype=np.float64)
    n = values.size
    slope = (values[-1] - values[0]) / (n - 1)
    left = values - values[0] - slope * np.arange(n)
    odd = np.concatenate([left, -left[-2:0:-1]])
    omega = 2j * np.pi * np.fft.rfftfreq(odd.size)
    if times == 2:
        return np.asarray(np.fft.irfft(np.fft.rfft(odd) * omega**2, odd.size)[:n]) * fs**2
    omega[-1] = 0.0  # at half of the rate the phase is not known
    return np.asarray(np.fft.irfft(np.fft.rfft(odd) * omega, odd.size)[:n] + slope) * fs


def relative_motion(
    unsprung: ArrayLike,
    sprung: ArrayLike,
    *,
    fs: float,
    method: IntegrationMethod = "spectral",
    high_pass_hz: float = 0.3,
) -> Motion:
    """Integrate z'' = x2'' - x1'', the motion of the sprung mass relative to the unsprung one.

    Args:
        unsprung: (n,) acceleration x1'' of the unsprung mass, m/s^2.
        sprung: (n,) acceleration x2'' of the sprung mass, m/s^2.
        fs: sampling rate, Hz.
        method: "spectral", "zero_phase" or "mean_removed", see `integrate`.
        high_pass_hz: corner of the high-pass, Hz; not used by "mean_removed".

    Raises:
        InputError: arrays of different lengths, or an error of `integrate`.

    >>> t = np.arange(20 * 256) / 256.0
    >>> motion = relative_motion(np.zeros(t.size), np.cos(2 * np.pi * 2 * t), fs=256.0)
    >>> round(float(np.abs(motion.displacement[motion.interior]).max()), 4)
    0.0063
    """
    lower, upper = np.asarray(unsprung, dtype=np.float64), np.asarray(sprung, dtype=np.float64)
    if lower.shape != upper.shape:
        raise InputError(f"unsprung has shape {lower.shape} and sprung {upper.shape}: give runs of one length")
    return integrate(upper - lower, fs=fs, method=method, high_pass_hz=high_pass_hz)


def filter_like(samples: ArrayLike, motion: Motion) -> FloatArray:
    """Return `samples` filtered as `motion.acceleration` was.

    A linear equation between signals still holds after filtering only if all of them go through the same filter.

    >>> t = np.arange(20 * 256) / 256.0
    >>> motion = integrate(np.sin(t), fs=256.0)
    >>> bool(np.allclose(filter_like(np.sin(t), motion), motion.acceleration))
    True
    """
    signal_in = np.asarray(samples, dtype=np.float64)
    if motion.method == "mean_removed":
        return signal_in - signal_in.mean()
    return integrate(signal_in, fs=motion.fs, method=motion.method, high_pass_hz=motion.high_pass_hz).acceleration


def _integrate_mean_removed(samples: FloatArray, *, fs: float) -> Motion:
    from scipy.integrate import cumulative_trapezoid

    acceleration = samples - samples.mean()
    velocity = cumulative_trapezoid(acceleration, dx=1 / fs, initial=0)
    velocity -= velocity.mean()
    displacement = cumulative_trapezoid(velocity, dx=1 / fs, initial=0)
    displacement -= displacement.mean()
    return Motion(acceleration, velocity, displacement, fs, "mean_removed", 0.0, 0.0)


def _integrate_spectral(samples: FloatArray, *, fs: float, high_pass_hz: float) -> Motion:
    from scipy import fft

    # the transform assumes a periodic run: a mirrored margin at each end avoids a step
    margin = min(samples.size - 1, round(4 * fs / high_pass_hz / 3))
    centred = samples - samples.mean()
    extended = np.concatenate([centred[margin:0:-1], centred, centred[-2 : -margin - 2 : -1]])
    n_fft = fft.next_fast_len(extended.size, real=True)
    omega = 2 * np.pi * fft.rfftfreq(n_fft, 1 / fs)
    ratio = (omega / (2 * np.pi * high_pass_hz)) ** 4
    spectrum = fft.rfft(extended, n_fft) * (ratio / (1 + ratio))
    omega[0] = 1.0  # the filter is zero there
    inside = slice(margin, margin + samples.size)

    def back(order: int) -> FloatArray:
        return fft.irfft(spectrum / (1j * omega) ** order, n_fft)[inside]

    return Motion(back(0), back(1), back(2), fs, "spectral", high_pass_hz, 0.9 / high_pass_hz)


def _integrate_zero_phase(samples: FloatArray, *, fs: float, high_pass_hz: float) -> Motion:
    from scipy import signal
    from scipy.integrate import cumulative_trapezoid

    sections = signal.butter(2, high_pass_hz, "highpass", fs=fs, output="sos")
    padding = min(samples.size - 1, round(3 * fs / high_pass_hz))

    def high_pass(values: FloatArray) -> FloatArray:
        return signal.sosfiltfilt(sections, values, padlen=padding)

    # each signal goes through three passes, before, between and after the integrations, so that all are filtered alike
    once = high_pass(samples)
    twice = high_pass(once)
    velocity = high_pass(cumulative_trapezoid(once, dx=1 / fs, initial=0))
    displacement = high_pass(cumulative_trapezoid(velocity, dx=1 / fs, initial=0))
    return Motion(
        high_pass(twice),
        high_pass(velocity),
        displacement,
        fs,
        "zero_phase",
        high_pass_hz,
        2.0 / high_pass_hz,
    )
