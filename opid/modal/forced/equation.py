"""The equation of one mode on the lines of its band, integrated in the frequency domain, and the noise of each line.

It is eq. (11) of Pacini, line by line. The printed least squares gives every line the same weight, but noise of the
acceleration is multiplied by |1 + c0/jw + k0/(jw)^2|, which is 2 zeta at resonance and 0.4 some 20 % away from it. Here
each line is divided by its noise: the width of the band then hardly matters, and damping is about twice as precise.

The error of the equation is e = n_f - n_a - c(t) n_v - k(t) n_q: the acceleration's noise n_a, integrated once and
twice, is multiplied by the tangents c(t) and k(t) at the present amplitude. Regressors and left side share that noise;
to first order the tangents account for all of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.signal.windows import tukey

from opid.errors import InputError
from opid.mechanics.structure import ComplexArray
from opid.modal.linear.modes import LinearModes, ModalTest
from opid.modal.power_laws import HIGHEST_ORDER
from opid.signals.recording import FloatArray


@dataclass(frozen=True, eq=False)
class ModeLines:
    """The equation f_q - q'' - c0 q' - k0 q = sum k_n q|q|^(n-1) + sum c_n q'|q'|^(n-1) of one test."""

    test: str  # name of the test
    frequency_hz: FloatArray  # (m,) lines of the band
    stiffness: ComplexArray  # (m, 5) transforms of q|q|^(n-1), n = 1 .. 5
    damping: ComplexArray  # (m, 5) transforms of q'|q'|^(n-1)
    inertia: ComplexArray  # (m,) transform of q''
    force: ComplexArray  # (m,) transform of f_q
    left_side: ComplexArray  # (m,) transform of the left side
    noise_force: float  # standard deviation of a line of `force` (complex) by the sensor's noise
    noise_inertia: float  # standard deviation of a line of `inertia` by the sensors' noise
    indices: NDArray[np.int64]  # (m,) indices of the lines in the transform of the whole record
    q: FloatArray  # (n,) displacement, m kg^1/2
    v: FloatArray  # (n,) velocity, m/s kg^1/2
    fade: FloatArray  # (n,) the factor by which every term was multiplied
    linear: tuple[float, float]  # k0, 1/s^2, and c0, 1/s
    kept_hz: tuple[float, float]  # the band of q and v, Hz
    fs: float  # sampling rate, Hz

    @property
    def largest_q(self) -> float:
        """Largest |q|, m kg^1/2."""
        return float(np.abs(self.q).max())

    @property
    def largest_v(self) -> float:
        """Largest |q'|, m/s kg^1/2."""
        return float(np.abs(self.v).max())

    def only(self, kept: NDArray[np.bool_]) -> ModeLines:
        """Return the equation on some of its lines, those where `kept`, (m,), is True."""
        names = ("frequency_hz", "stiffness", "damping", "inertia", "force", "left_side", "indices")
        return replace(self, **{name: getattr(self, name)[kept] for name in names})


@dataclass(frozen=True)
class Powers:
    """The powers that are fitted; a vector of coefficients holds k_n, then c_n.

    Args:
        k: powers of the displacement: 2 .. N_s, and 1 where k0 is corrected.
        c: powers of the velocity: 2 .. N_d, and 1 where c0 is corrected.

    >>> Powers.of(3, 2, free_linear=False)
    Powers(k=(2, 3), c=(2,))
    """

    k: tuple[int, ...]
    c: tuple[int, ...]

    @classmethod
    def of(cls, stiffness_order: int, damping_order: int, *, free_linear: bool) -> Powers:
        """Return the powers up to two orders; InputError for an order outside 1 to 5."""
        for order in (stiffness_order, damping_order):
            if not 1 <= order <= HIGHEST_ORDER:
                raise InputError(f"the order is {order}: give 1 (linear) to {HIGHEST_ORDER}")
        first = 1 if free_linear else 2
        return cls(tuple(range(first, stiffness_order + 1)), tuple(range(first, damping_order + 1)))

    @property
    def orders(self) -> tuple[int, int]:
        """N_s and N_d."""
        return max(self.k, default=1), max(self.c, default=1)

    def columns(self, lines: ModeLines) -> ComplexArray:
        """Return the (m, n) regressors of the coefficients on the lines of a test."""
        return np.hstack([lines.stiffness[:, [n - 1 for n in self.k]], lines.damping[:, [n - 1 for n in self.c]]])

    def misfit(self, lines: ModeLines, value: FloatArray) -> ComplexArray:
        """Return the (m,) misfit of the equation for some coefficients."""
        return lines.left_side - self.columns(lines) @ value

    def tangents(self, lines: ModeLines, value: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return tangent stiffness, 1/s^2, and damping, 1/s, at each moment, (n,) each."""
        k, c = (np.full(lines.q.size, linear) for linear in lines.linear)
        for n, each in zip(self.k, value, strict=False):
            k += each * n * np.abs(lines.q) ** (n - 1)
        for n, each in zip(self.c, value[len(self.k) :], strict=True):
            c += each * n * np.abs(lines.v) ** (n - 1)
        return k, c


def mode_lines(test: ModalTest, mode: int, band_hz: tuple[float, float], *, taper_s: float = 0.0) -> ModeLines:
    """Return the equation of a mode on the lines of a band.

    Args:
        test: a test that starts from rest and has decayed at its end, if its ends are not tapered.
        mode: number of the mode, from 1.
        band_hz: lower and upper end, Hz.
        taper_s: time over which every term of the equation is faded in and out, s. The equation holds at each moment,
            so it stays true when all of its terms are faded alike, and the ends no longer spoil the integration.

    Raises:
        InputError: a band outside the record's frequencies or with fewer than eight lines.
    """
    index = test.modes.index(mode)
    acceleration, natural_hz = test.modal_acceleration(mode), float(test.modes.frequency_hz[index])
    low, high = band_hz
    frequency = fft.rfftfreq(acceleration.size, 1 / test.fs)
    inside = (frequency >= low) & (frequency <= high)
    if not 0 < low < high < test.fs / 2 or inside.sum() < 8:
        raise InputError(
            f"the band {low:g} to {high:g} Hz of mode {mode} has {inside.sum()} line(s) of test {test.name!r}, which "
            f"lasts {acceleration.size / test.fs:.3g} s at {test.fs:g} Hz: give a longer record or a wider band"
        )
    kept_hz = _choose_motion_band(natural_hz, band_hz)
    q, v = _integrate_band(acceleration, test.fs, kept_hz)
    fade = _make_fade(acceleration.size, taper_s * test.fs)
    of_acceleration, of_force = fft.rfft(fade * acceleration), fft.rfft(fade * test.modal_force(mode))
    k0, c0 = float(test.modes.stiffness()[index]), float(test.modes.damping()[index])
    finer = int(np.ceil(24 * natural_hz / test.fs))  # a period then has 24 samples or more
    stiffness, damping = (_transform_powers(motion, taper_s * test.fs, finer)[inside] for motion in (q, v))
    return ModeLines(
        test=test.name,
        frequency_hz=frequency[inside],
        stiffness=stiffness,
        damping=damping,
        inertia=of_acceleration[inside],
        force=of_force[inside],
        left_side=of_force[inside] - of_acceleration[inside] - (c0 * damping[:, 0] + k0 * stiffness[:, 0]),
        noise_force=_find_noise_std(of_force, of_force[find_quiet_lines(test.modes, frequency)]),
        noise_inertia=_find_noise_std(of_acceleration, transform_noise(test, mode, fade)),
        indices=np.flatnonzero(inside),
        q=q,
        v=v,
        fade=fade,
        linear=(k0, c0),
        kept_hz=kept_hz,
        fs=test.fs,
    )


def integrate_mode(test: ModalTest, mode: int, band_hz: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return q, m kg^1/2, and q', m/s kg^1/2, of a mode by division by j omega, near its band only."""
    kept_hz = _choose_motion_band(float(test.modes.frequency_hz[test.modes.index(mode)]), band_hz)
    return _integrate_band(test.modal_acceleration(mode), test.fs, kept_hz)


def find_quiet_lines(modes: LinearModes, frequency_hz: FloatArray) -> NDArray[np.bool_]:
    """Return the lines of a test that hold mainly noise: those above all modes, or all where these are few."""
    above = frequency_hz > 1.3 * modes.frequency_hz.max()
    return above if above.sum() >= 50 else frequency_hz > 0


def transform_noise(test: ModalTest, mode: int, fade: FloatArray | float = 1.0) -> ComplexArray:
    """Return the quiet lines of a modal acceleration, as if their noise were that at the natural frequency of the mode.

    The noise of a reading grows with the frequency where it was differentiated, once or twice.

    Args:
        test: a test.
        mode: number of the mode, from 1.
        fade: (n,) factor of the samples.
    """
    frequency = fft.rfftfreq(len(test.acceleration), 1 / test.fs)
    quiet = find_quiet_lines(test.modes, frequency)
    slope = test.modes.frequency_hz[test.modes.index(mode)] / frequency[quiet]
    parts = test.split_acceleration(mode).items()
    return np.sum([slope**times * fft.rfft(fade * part)[quiet] for times, part in parts], axis=0)


def find_noise_power(lines: ComplexArray) -> FloatArray:
    """Return the mean square of noise from lines, (n, ...), most of them noise: its median is ln 2 times its mean."""
    return np.median(np.abs(lines) ** 2, axis=0) / np.log(2)


def find_line_noise(lines: ModeLines, powers: Powers, value: FloatArray) -> FloatArray:
    """Return the standard deviation of the equation's error on each line, (m,), as an rms over time."""
    k, c = powers.tangents(lines, value)
    omega = 2 * np.pi * lines.frequency_hz
    mean = np.abs(1 + c.mean() / (1j * omega) + k.mean() / (1j * omega) ** 2) ** 2
    spread = c.var() / omega**2 + k.var() / omega**4
    return np.sqrt(lines.noise_force**2 + lines.noise_inertia**2 * (mean + spread))


def find_noise_scores(lines: ModeLines, gradient: ComplexArray, powers: Powers, value: FloatArray) -> FloatArray:
    """Return the covariance (p, p) of Re sum conj(gradient) E over the lines, E the transform of the error."""
    k, c = powers.tangents(lines, value)
    n = lines.q.size
    spectrum = np.zeros((n // 2 + 1, gradient.shape[1]), dtype=np.complex128)
    spectrum[lines.indices] = gradient
    # Each parameter has one signal, Re sum conj(G_l) e^(-j omega_l t), faded as the terms were.
    of_force = 0.5 * n * fft.irfft(spectrum, n, axis=0) * lines.fade[:, None]
    frequency = fft.rfftfreq(n, 1 / lines.fs)
    kept = ((frequency >= lines.kept_hz[0]) & (frequency <= lines.kept_hz[1]))[:, None]
    backward = np.where(kept, -2j * np.pi * frequency[:, None], 1.0)  # the adjoint of a division by j omega
    through = [fft.rfft(tangent[:, None] * of_force, axis=0) for tangent in (c, k)]
    integrated = np.where(kept, through[0] / backward + through[1] / backward**2, 0.0)
    of_inertia = of_force + fft.irfft(integrated, n, axis=0)
    noise = lines.noise_force**2 * of_force.T @ of_force + lines.noise_inertia**2 * of_inertia.T @ of_inertia
    # The noise was read from lines of the faded record.
    return noise / np.sum(lines.fade**2)


def _choose_motion_band(natural_hz: float, band_hz: tuple[float, float]) -> tuple[float, float]:
    """Return the band of the motion, which holds the third harmonic with all of its width.

    A short beat is wide: if it were cut off half-way to the neighbours, q^3 would lack a part, and k3 would be wrong by
    some percent.
    """
    return min(0.6 * natural_hz, band_hz[0]), max(3.5 * natural_hz, band_hz[1])


def _integrate_band(acceleration: FloatArray, fs: float, kept_hz: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    n = acceleration.size
    frequency = fft.rfftfreq(n, 1 / fs)
    kept = (frequency >= kept_hz[0]) & (frequency <= kept_hz[1])
    j_omega = np.where(kept, 2j * np.pi * frequency, 1.0)
    velocity = np.where(kept, fft.rfft(acceleration) / j_omega, 0.0)
    return fft.irfft(velocity / j_omega, n), fft.irfft(velocity, n)


def _make_fade(n: int, taper: float) -> FloatArray:
    return tukey(n, min(1.0, 2 * taper / n))


def _transform_powers(motion: FloatArray, taper: float, finer: int) -> ComplexArray:
    """Return transforms of the powers of a motion that is resampled, so that no harmonic folds back onto the mode.

    At four samples a period, the third harmonic of q^3 would.
    """
    n = motion.size
    spectrum = np.zeros(finer * n // 2 + 1, dtype=np.complex128)
    spectrum[: n // 2 + 1] = fft.rfft(motion)
    fine = finer * fft.irfft(spectrum, finer * n) if finer > 1 else motion
    size, fade = np.abs(fine), _make_fade(fine.size, finer * taper)
    powers = (fft.rfft(fade * fine * size ** (n_power - 1)) for n_power in range(1, HIGHEST_ORDER + 1))
    return np.stack([each[: n // 2 + 1] / finer for each in powers], axis=1)


def _find_noise_std(spectrum: ComplexArray, quiet: ComplexArray) -> float:
    # Simulated tests without noise need finite weights, too.
    least = 1e-7 * float(np.abs(spectrum).max())
    return max(float(np.sqrt(find_noise_power(quiet))), least, np.finfo(float).tiny)
