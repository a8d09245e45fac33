"""The equation of one mode on the lines of its band: integrated in the frequency domain, with the noise of each line.

Eq. (11) of Pacini, line by line. The printed least squares weighs every line alike; away from resonance the
acceleration's noise is multiplied by |1 + c0/jw + k0/(jw)^2|, 2 zeta at resonance and 0.4 some 20 % away from it, so
each line is divided by what noise does to it. The band then hardly matters, and damping comes out about twice as sharp.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.signal.windows import tukey

from opid.errors import InputError
from opid.modal.linear.modes import ModalTest
from opid.modal.power_laws import HIGHEST_ORDER
from opid.signals.recording import FloatArray

ComplexArray = NDArray[np.complex128]

LOWEST, HARMONICS = 0.6, 3.5
"""The motion is kept between these multiples of the natural frequency, the third harmonic with all of its width. A
short beat is wide: what is cut off at half-way to the neighbours would be missing in q^3, and k3 wrong by percents."""

SAMPLES_A_PERIOD = 24
"""Of the mode, at which powers are taken: of a record at four a period the third harmonic of q^3 folds onto it."""

QUIETEST = 1e-7
"""Of the largest line: no noise is taken for lower, so that simulated tests without noise have weights, too."""


@dataclass(frozen=True, eq=False)
class ModeLines:
    """The equation f_q - q'' - c0 q' - k0 q = sum k_n q|q|^(n-1) + sum c_n q'|q'|^(n-1) of one test.

    Args:
        test: name of the test.
        frequency_hz: (m,) lines of the band.
        stiffness: (m, 5) transforms of q|q|^(n-1), n = 1 .. 5.
        damping: (m, 5) transforms of q'|q'|^(n-1).
        inertia: (m,) transform of q''.
        force: (m,) transform of f_q.
        rest: (m,) the left side.
        noise_force: standard deviation of a line of `force` (complex) that the sensor's noise makes.
        noise_inertia: likewise of a line of `inertia`.
        places: (m,) of the lines in the transform of the whole record.
        q: (n,) displacement, m kg^1/2.
        v: (n,) velocity, m/s kg^1/2.
        fade: (n,) what every term was multiplied by.
        linear: k0, 1/s^2, and c0, 1/s.
        kept_hz: what q and v hold, Hz.
        fs: sampling rate, Hz.
    """

    test: str
    frequency_hz: FloatArray
    stiffness: ComplexArray
    damping: ComplexArray
    inertia: ComplexArray
    force: ComplexArray
    rest: ComplexArray
    noise_force: float
    noise_inertia: float
    places: NDArray[np.int64]
    q: FloatArray
    v: FloatArray
    fade: FloatArray
    linear: tuple[float, float]
    kept_hz: tuple[float, float]
    fs: float

    @property
    def largest_q(self) -> float:
        """Largest |q|, m kg^1/2."""
        return float(np.abs(self.q).max())

    @property
    def largest_v(self) -> float:
        """Largest |q'|, m/s kg^1/2."""
        return float(np.abs(self.v).max())

    def only(self, kept: NDArray[np.bool_]) -> ModeLines:
        """The equation on some of its lines, (m,) True for those."""
        names = ("frequency_hz", "stiffness", "damping", "inertia", "force", "rest", "places")
        return replace(self, **{name: getattr(self, name)[kept] for name in names})


def mode_lines(test: ModalTest, mode: int, band_hz: tuple[float, float], *, taper_s: float = 0.0) -> ModeLines:
    """Return the equation of a mode on the lines of a band.

    Args:
        test: starting from rest and decayed to rest at its end, if its ends are not tapered.
        mode: number of the mode, from 1.
        band_hz: lower and upper end, Hz.
        taper_s: time over which every term of the equation is faded in and out, s. It holds at each moment, so that
            fading all of its terms alike leaves it true; the integration needs some time from the ends.

    Raises:
        InputError: a band outside the record's frequencies or with fewer than eight lines.
    """
    place = test.modes.index(mode)
    acceleration, force = test.acceleration[:, place], test.modal_force(mode)
    low, high = band_hz
    frequency = fft.rfftfreq(acceleration.size, 1 / test.fs)
    inside = (frequency >= low) & (frequency <= high)
    if not 0 < low < high < test.fs / 2 or inside.sum() < 8:
        raise InputError(
            f"the band {low:g} to {high:g} Hz of mode {mode} has {inside.sum()} line(s) of test {test.name!r}, which "
            f"lasts {acceleration.size / test.fs:.3g} s at {test.fs:g} Hz: give a longer record or a wider band"
        )
    kept_hz = _kept(float(test.modes.frequency_hz[place]), band_hz)
    q, v = _motion(fft.rfft(acceleration), frequency, kept_hz, acceleration.size)
    fade = _fade(acceleration.size, taper_s * test.fs)
    of_acceleration, of_force = fft.rfft(fade * acceleration), fft.rfft(fade * force)
    k0, c0 = float(test.modes.stiffness()[place]), float(test.modes.damping()[place])
    finer = int(np.ceil(SAMPLES_A_PERIOD * test.modes.frequency_hz[place] / test.fs))
    stiffness, damping = (_powers(motion, taper_s * test.fs, finer)[inside] for motion in (q, v))
    linear = c0 * damping[:, 0] + k0 * stiffness[:, 0]
    noise_a, noise_f = (_noise_level(each, frequency, test) for each in (of_acceleration, of_force))
    return ModeLines(
        test=test.name,
        frequency_hz=frequency[inside],
        stiffness=stiffness,
        damping=damping,
        inertia=of_acceleration[inside],
        force=of_force[inside],
        rest=of_force[inside] - of_acceleration[inside] - linear,
        noise_force=noise_f,
        noise_inertia=noise_a,
        places=np.flatnonzero(inside),
        q=q,
        v=v,
        fade=fade,
        linear=(k0, c0),
        kept_hz=kept_hz,
        fs=test.fs,
    )


def modal_motion(test: ModalTest, mode: int, band_hz: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return q, m kg^1/2, and q', m/s kg^1/2, of a mode: divided by j omega, nothing far below the mode.

    Args:
        test: the test.
        mode: number of the mode, from 1.
        band_hz: its band, Hz, and what is kept at least.
    """
    acceleration = test.acceleration[:, test.modes.index(mode)]
    frequency = fft.rfftfreq(acceleration.size, 1 / test.fs)
    natural = float(test.modes.frequency_hz[test.modes.index(mode)])
    return _motion(fft.rfft(acceleration), frequency, _kept(natural, band_hz), acceleration.size)


def _kept(natural_hz: float, band_hz: tuple[float, float]) -> tuple[float, float]:
    return min(LOWEST * natural_hz, band_hz[0]), max(HARMONICS * natural_hz, band_hz[1])


def _motion(
    of_acceleration: ComplexArray, frequency: FloatArray, kept_hz: tuple[float, float], n: int
) -> tuple[FloatArray, FloatArray]:
    kept = (frequency >= kept_hz[0]) & (frequency <= kept_hz[1])
    j_omega = np.where(kept, 2j * np.pi * frequency, 1.0)
    velocity = np.where(kept, of_acceleration / j_omega, 0.0)
    return fft.irfft(velocity / j_omega, n), fft.irfft(velocity, n)


def _fade(n: int, taper: float) -> FloatArray:
    return tukey(n, min(1.0, 2 * taper / n))


def _powers(motion: FloatArray, taper: float, finer: int) -> ComplexArray:
    """Transforms of the powers, taken of a motion made finer: their harmonics must not fold back onto the mode."""
    n = motion.size
    spectrum = np.zeros(finer * n // 2 + 1, dtype=np.complex128)
    spectrum[: n // 2 + 1] = fft.rfft(motion)
    fine = finer * fft.irfft(spectrum, finer * n) if finer > 1 else motion
    size, fade = np.abs(fine), _fade(fine.size, finer * taper)
    powers = (fft.rfft(fade * fine * size ** (n_power - 1)) for n_power in range(1, HIGHEST_ORDER + 1))
    return np.stack([each[: n // 2 + 1] / finer for each in powers], axis=1)


def _noise_level(spectrum: ComplexArray, frequency: FloatArray, test: ModalTest) -> float:
    """Standard deviation of a line by the sensor's noise: from the lines above all modes, where there is only noise."""
    above = frequency > 1.3 * test.modes.frequency_hz.max()
    lines = np.abs(spectrum[above if above.sum() >= 50 else slice(1, None)])
    # the median of |line|^2 of complex noise is ln 2 of its mean
    level = float(np.sqrt(np.median(lines**2) / np.log(2)))
    return max(level, QUIETEST * float(np.abs(spectrum).max()), np.finfo(float).tiny)
