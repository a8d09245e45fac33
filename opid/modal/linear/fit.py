"""Natural frequency and damping of a mode as one test shows them, with noise on force and acceleration.

The mode is taken for linear, m q'' + c q' + k q = f_q on the lines around its peak. Noise on either side makes plain
least squares biased: each line is weighted by the noise of f_q and of q'', which the misfit itself shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from opid.errors import InputError
from opid.estimate import Estimate
from opid.modal.linear.coordinates import ModalTest
from opid.modal.linear.modes import force_projection
from opid.signals.recording import FloatArray

ComplexArray = NDArray[np.complex128]

SEARCHED = 0.1
"""Of the natural frequency: how far to either side a mode is looked for (the paper's shifted by 7 %)."""

HALF_WIDTHS = 8.0
"""The band ends so many zeta f from the peak: beyond it are noise and what other modes leave."""

FEWEST_LINES = 16
"""Of a band, for three numbers and two levels of noise."""

LEAST_SIGNAL = 4.0
"""Of the third strongest line of a band, over what most lines of the record are: with less a mode is not seen."""

ROUNDS, STEPS = 4, 30
"""How often noise and oscillator are found in turns, and the steps of either search at the most."""

QUIET_SHARE = 0.15
"""Of the mean power of a misfit, in its quietest quarter: noise alone falls below it once in 80 times at the most."""

NOT_DECAYED = 0.02
"""Of the peak, at the end of a record: above it the equation has terms of the unknown state at the end."""


@dataclass(frozen=True)
class LinearFit:
    """The linear oscillator that one test shows for a mode.

    Args:
        frequency_hz: natural frequency, Hz; without a value where none was found.
        damping_ratio: damping ratio.
        amplitude: peak |q''| in the band, m/s^2 kg^1/2.
        band_hz: lines that were fitted, Hz.
        modal_mass: m, 1 where shapes and force are in order; None where nothing was found.
        explained: whether noise explains what a linear mode leaves.
    """

    frequency_hz: Estimate
    damping_ratio: Estimate
    amplitude: float
    band_hz: tuple[float, float]
    modal_mass: float | None = None
    explained: bool = True


def linear_fit(test: ModalTest, mode: int, *, modal_mass: float | None = None) -> LinearFit:
    """Return natural frequency and damping ratio that one test shows for a mode.

    m q'' + c q' + k q = f_q on the lines of a band around the peak, with q'' / j omega for q'; the mass m takes up the
    scale of shapes and force. In a record that has not decayed the unknown end state has two terms of its own. The
    intervals say what noise does; a mode that is clearly nonlinear has no one frequency, and that of the linear mode
    with the nearest force is returned.

    Args:
        test: with a force.
        mode: number of the mode, from 1; its given frequency and damping are where the search begins.
        modal_mass: m where it is known from another test, for a mode that is clearly nonlinear in this one: over a
            narrow band m and k change places; fitted where left out.

    Raises:
        InputError: a test without a force, or a rigid-body mode.
    """
    require_force(test)
    place = test.modes.place(mode)
    given_hz, given_zeta = float(test.modes.frequency_hz[place]), float(test.modes.damping_ratio[place])
    if given_hz == 0:
        raise InputError(f"mode {mode} is a rigid-body mode (0 Hz): it has no resonance that could shift")
    acceleration, force = test.acceleration[:, place], test.modal_force(mode)
    lines = _Lines(
        np.asarray(np.fft.rfftfreq(acceleration.size, 1 / test.fs), dtype=np.float64),
        np.fft.rfft(acceleration),
        np.fft.rfft(force),
        given_hz,
    )
    low, high = _room(test, place)
    spacing = test.fs / acceleration.size
    inside = searched = _around(lines.frequency_hz, given_hz, min(given_hz - low, high - given_hz), spacing)
    nothing = LinearFit(Estimate(), Estimate(), _peak(lines, inside, acceleration.size), (low, high))
    if force_projection(test.modes, str(test.drive_point))[place] == 0 or inside.sum() < FEWEST_LINES:
        return nothing
    nowhere = np.empty((int(inside.sum()), 0), dtype=np.complex128)
    columns, response, drive = _columns(lines, inside), lines.acceleration[inside], lines.force[inside]
    guess = _nearest_linear(columns, response, drive, nowhere, modal_mass)
    ratio, zeta = _oscillator(guess) or (0.0, 0.0)
    centre = ratio * given_hz
    if not low < centre < high:  # where noise hides the mode, the search finds one elsewhere or none
        centre, zeta = given_hz, max(given_zeta, 1e-3)
    half = min(HALF_WIDTHS * zeta * centre, SEARCHED * centre)
    inside = _around(lines.frequency_hz, centre, half, spacing)
    peak = _peak(lines, inside, acceleration.size)
    if not _seen(lines, inside):
        return LinearFit(Estimate(), Estimate(), peak, _ends(lines, inside))
    found = None
    # a strongly nonlinear mode may be too far from its peak for the narrow band
    for band in (inside, searched):
        found = _fitted(lines, band, acceleration.size, (centre, zeta), modal_mass)
        if found is not None and low < (found[0].value or 0.0) < high:
            break
    band_hz = _ends(lines, band)
    if found is None or not low < (found[0].value or 0.0) < high:
        return LinearFit(Estimate(), Estimate(), peak, band_hz, explained=False)
    return LinearFit(found[0], found[1], peak, band_hz, found[2], found[3])


@dataclass(frozen=True, eq=False)
class _Lines:
    """Spectra of a mode, and the frequency by which the equation is scaled."""

    frequency_hz: FloatArray
    acceleration: ComplexArray
    force: ComplexArray
    scale_hz: float


def _room(test: ModalTest, place: int) -> tuple[float, float]:
    """Where the peak of a mode may lie: a tenth to either side, half way to its neighbours at the most."""
    own = float(test.modes.frequency_hz[place])
    others = test.modes.frequency_hz[test.modes.elastic & (test.modes.frequency_hz != own)]
    low = max([(1 - SEARCHED) * own, *((own + others[others < own]) / 2)])
    high = min([(1 + SEARCHED) * own, 0.49 * test.fs, *((own + others[others > own]) / 2)])
    return float(low), float(max(high, own))


def _around(frequency: FloatArray, centre: float, half: float, spacing: float) -> NDArray[np.bool_]:
    half = max(half, 0.5 * (FEWEST_LINES + 1) * spacing)
    return (np.abs(frequency - centre) <= half) & (frequency > 0)


def _ends(lines: _Lines, inside: NDArray[np.bool_]) -> tuple[float, float]:
    band = lines.frequency_hz[inside]
    return float(band[0]), float(band[-1])


def _peak(lines: _Lines, inside: NDArray[np.bool_], n_samples: int) -> float:
    return float(np.abs(_in_band(lines, inside, n_samples)).max())


def _in_band(lines: _Lines, inside: NDArray[np.bool_], n_samples: int) -> FloatArray:
    return np.fft.irfft(np.where(inside, lines.acceleration, 0), n_samples)


def _open_end(lines: _Lines, inside: NDArray[np.bool_], n_samples: int) -> bool:
    motion = _in_band(lines, inside, n_samples)
    end = motion[-max(2, n_samples // 50) :]
    return bool(np.abs(end).max() > NOT_DECAYED * np.abs(motion).max())


def _columns(lines: _Lines, inside: NDArray[np.bool_]) -> ComplexArray:
    """1, 1/jw, 1/(jw)^2 on the lines, (n, 3); the frequency in units of the given one."""
    j_omega = 1j * lines.frequency_hz[inside] / lines.scale_hz
    return np.stack([np.ones_like(j_omega), 1 / j_omega, 1 / j_omega**2], axis=1)


def _oscillator(mck: FloatArray) -> tuple[float, float] | None:
    """Natural frequency, in units of the scale, and damping ratio of m, c, k; None if it is no oscillator."""
    m, c, k = mck[:3]
    if not k * m > 0:
        return None
    zeta = c / (2 * m * np.sqrt(k / m))
    return (float(np.sqrt(k / m)), float(zeta)) if 0 < zeta < 1 else None


def _fitted(
    lines: _Lines, inside: NDArray[np.bool_], n_samples: int, start: tuple[float, float], mass: float | None
) -> tuple[Estimate, Estimate, float, bool] | None:
    """Frequency, damping ratio, mass and whether noise explains the rest; None if nothing oscillates."""
    columns = _columns(lines, inside)
    response, force = lines.acceleration[inside], lines.force[inside]
    open_end = _open_end(lines, inside, n_samples)
    ends = columns[:, 1:] * np.abs(force).max() if open_end else np.empty((force.size, 0), dtype=np.complex128)
    equation = (columns, response, force, ends)
    theta, noise = _equation_error(*equation), np.array([1.0, 0.0])
    quiet = _quiet_share(_residual(theta, *equation)[0], inside, n_samples)
    if quiet == 1:  # the misfit is noise
        likely, its_noise = _maximum_likelihood(start[0] / lines.scale_hz, start[1], *equation)
        if _oscillator(likely) is not None:
            theta, noise = likely, its_noise
    elif mass is not None:
        theta = _nearest_linear(*equation, mass)
    oscillator = _oscillator(theta)
    if oscillator is None:
        return None
    covariance = quiet * _covariance(theta, *equation, noise)
    m, c, k = theta[:3]
    of_frequency, of_damping = np.zeros(theta.size), np.zeros(theta.size)
    of_frequency[:3] = -0.5 / m, 0.0, 0.5 / k
    of_damping[:3] = -0.5 / m, 1 / c, -0.5 / k
    if quiet < 1 and mass is not None:
        known = np.delete(np.arange(theta.size), 0)
        covariance = np.zeros_like(covariance)
        covariance[np.ix_(known, known)] = quiet * _covariance(theta, *equation, noise, fixed=1)
    std = [float(np.sqrt(gradient @ covariance @ gradient)) for gradient in (of_frequency, of_damping)]
    frequency_hz, zeta = oscillator[0] * lines.scale_hz, oscillator[1]
    found = Estimate.normal(frequency_hz, frequency_hz * std[0]), Estimate.normal(zeta, zeta * std[1])
    return *found, float(m), quiet == 1


def _equation_error(
    columns: ComplexArray, response: ComplexArray, force: ComplexArray, ends: ComplexArray
) -> FloatArray:
    """m, c, k by plain least squares: biased by noise; of a nonlinear mode the linear force nearest to its own."""
    matrix = np.hstack([columns * response[:, None], ends])
    return _solved(np.vstack([matrix.real, matrix.imag]), np.concatenate([force.real, force.imag]))


def _nearest_linear(
    columns: ComplexArray, response: ComplexArray, force: ComplexArray, ends: ComplexArray, mass: float | None
) -> FloatArray:
    if mass is None:
        return _equation_error(columns, response, force, ends)
    return np.concatenate([[mass], _equation_error(columns[:, 1:], response, force - mass * response, ends)])


def _quiet_share(residual: ComplexArray, inside: NDArray[np.bool_], n_samples: int) -> float:
    """Power of the misfit in its quietest quarter of the record over its mean; 1 where they hardly differ.

    Noise is stationary; what a linear mode cannot explain of a nonlinear one is where the motion is large.
    """
    spectrum = np.zeros(inside.size, dtype=np.complex128)
    spectrum[inside] = residual
    power = [float(np.mean(part**2)) for part in np.array_split(np.fft.irfft(spectrum, n_samples), 4)]
    share = min(power) / max(np.mean(power), np.finfo(float).tiny)
    return float(share) if share < QUIET_SHARE else 1.0


def _maximum_likelihood(
    ratio: float, zeta: float, columns: ComplexArray, response: ComplexArray, force: ComplexArray, ends: ComplexArray
) -> tuple[FloatArray, FloatArray]:
    """m, c, k with noise on force and acceleration, the least sum |r|^2 / v, v = a + b |D|^2; and a, b.

    r = F - D Q is what the equation leaves, D = m + c/jw + k/(jw)^2 what multiplies the acceleration's noise, a and b
    the noise of force and acceleration on one line. v moves with m, c and k, else the least sum is not at the truth.
    """
    theta = np.concatenate([[1.0, 2 * zeta * ratio, ratio**2], np.zeros(ends.shape[1])])
    noise = np.array([np.median(np.abs(columns @ theta[:3]) ** 2), 1.0])
    for _ in range(ROUNDS):
        theta = _least(theta, columns, response, force, ends, noise)
        noise = _noise_of(theta, columns, response, force, ends)
    return theta, noise


def _residual(
    theta: FloatArray, columns: ComplexArray, response: ComplexArray, force: ComplexArray, ends: ComplexArray
) -> tuple[ComplexArray, ComplexArray]:
    dynamic = columns @ theta[:3]
    return force - dynamic * response - ends @ theta[3:], dynamic


def _weighted(
    theta: FloatArray,
    columns: ComplexArray,
    response: ComplexArray,
    force: ComplexArray,
    ends: ComplexArray,
    noise: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """r / sqrt(v) as real numbers, and its derivatives."""
    residual, dynamic = _residual(theta, columns, response, force, ends)
    v = noise[0] + noise[1] * np.abs(dynamic) ** 2
    jacobian = -np.hstack([columns * response[:, None], ends]) / np.sqrt(v)[:, None]
    of_v = 2 * noise[1] * (dynamic.conj()[:, None] * columns).real
    jacobian[:, :3] -= (residual / (2 * v**1.5))[:, None] * of_v
    residual = residual / np.sqrt(v)
    return np.concatenate([residual.real, residual.imag]), np.vstack([jacobian.real, jacobian.imag])


def _least(theta: FloatArray, *equation: ComplexArray | FloatArray) -> FloatArray:
    """Gauss-Newton with halved steps; the smallest step where the scale of shapes and force is not determined."""
    residual, jacobian = _weighted(theta, *equation)  # type: ignore[arg-type]
    cost = residual @ residual
    for _ in range(STEPS):
        step = _solved(jacobian, residual)
        for _ in range(8):
            trial_residual, trial_jacobian = _weighted(theta - step, *equation)  # type: ignore[arg-type]
            if trial_residual @ trial_residual <= cost:
                break
            step = step / 2
        else:
            return theta
        theta, residual, jacobian = theta - step, trial_residual, trial_jacobian
        before, cost = cost, residual @ residual
        if before - cost <= 1e-9 * before:
            return theta
    return theta


def _solved(jacobian: FloatArray, residual: FloatArray) -> FloatArray:
    norms = np.linalg.norm(jacobian, axis=0)
    return np.linalg.lstsq(jacobian / norms, residual, rcond=1e-9)[0] / norms


def _noise_of(
    theta: FloatArray, columns: ComplexArray, response: ComplexArray, force: ComplexArray, ends: ComplexArray
) -> FloatArray:
    """Noise a and b from the misfit, |r|^2 = a + b |D|^2 on average, neither below zero."""
    from scipy import optimize

    residual, dynamic = _residual(theta, columns, response, force, ends)
    size, power = np.abs(dynamic) ** 2, np.abs(residual) ** 2
    power = power * (2 * power.size / (2 * power.size - theta.size))
    # simulated tests without noise have weights, too
    least = 1e-14 * np.array([np.max(np.abs(force) ** 2), np.max(np.abs(response) ** 2)]) + np.finfo(float).tiny
    noise = np.array([power.mean() / 2, power.mean() / 2 / size.mean()])
    for _ in range(4):
        v = np.maximum(noise, least) @ np.stack([np.ones_like(size), size])
        scale = np.array([1.0, 1 / size.mean()])
        noise = optimize.nnls(np.stack([1 / v, size / v], axis=1) * scale, power / v)[0] * scale
    return np.maximum(noise, least)


def _seen(lines: _Lines, inside: NDArray[np.bool_]) -> bool:
    """Whether the mode stands out of what most lines are, noise or less."""
    power = np.abs(lines.acceleration) ** 2
    # the median of |line|^2 of complex noise is ln 2 of its mean
    return bool(np.sort(power[inside])[-3] > LEAST_SIGNAL**2 * np.median(power) / np.log(2))


def _covariance(theta: FloatArray, *equation: ComplexArray | FloatArray, fixed: int = 0) -> FloatArray:
    residual, jacobian = _weighted(theta, *equation)  # type: ignore[arg-type]
    jacobian = jacobian[:, fixed:]
    norms = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / norms
    # two levels of noise were fitted, too
    variance = residual @ residual / (residual.size - theta.size - 2)
    return variance * np.linalg.pinv(scaled.T @ scaled, rcond=1e-14, hermitian=True) / np.outer(norms, norms)


def require_force(test: ModalTest) -> None:
    """Refuse a test without a force.

    Args:
        test: the test.

    Raises:
        InputError: it has none.
    """
    if test.force is None or test.drive_point is None:
        raise InputError(
            f"test {test.name!r} has no force: levels are compared by response over force, name its channel"
        )
