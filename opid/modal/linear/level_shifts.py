"""Which modes are nonlinear: natural frequency and damping of every mode at several levels (Pacini section 3.3).

At each level a mode is modelled as linear, m q'' + c q' + k q = f_q on the lines around its peak. Noise of f_q and of
q'' biases plain least squares; each line is weighted by both, and their levels are found from the misfit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from opid.errors import InputError
from opid.estimate import Estimate
from opid.mechanics.structure import ComplexArray
from opid.modal.linear.modes import ModalTest
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray


@dataclass(frozen=True)
class LevelShift:
    """How natural frequency and damping of a mode move with the level.

    Args:
        mode: number of the mode, from 1.
        levels: names of the tests, from the smallest amplitude of this mode to the largest.
        amplitude: peak |q''| of each in the band of the mode, m/s^2 kg^1/2.
        frequency_hz: natural frequency in each, Hz; without a value where none was found.
        damping_ratio: damping ratio in each.
        frequency_shift: relative change from the lowest to the highest level that is sharp enough to compare.
        damping_shift: relative change of the damping ratio, between the same levels.
        nonlinear: whether a shift exceeds its threshold by more than chance explains.
        determined: whether the mode was excited well enough to decide that.
        reason: the reason for both decisions, in one sentence.
    """

    mode: int
    levels: tuple[str, ...]
    amplitude: tuple[float, ...]
    frequency_hz: tuple[Estimate, ...]
    damping_ratio: tuple[Estimate, ...]
    frequency_shift: Estimate
    damping_shift: Estimate
    nonlinear: bool
    determined: bool
    reason: str


@dataclass(frozen=True)
class LinearFit:
    """The linear oscillator that one test shows for a mode."""

    frequency_hz: Estimate  # natural frequency, Hz; without a value where none was found
    damping_ratio: Estimate  # damping ratio
    amplitude: float  # peak |q''| in the band, m/s^2 kg^1/2
    band_hz: tuple[float, float]  # lines that were fitted, Hz
    modal_mass: float | None = None  # m, 1 where shapes and force are right; None where no mode was found
    explained: bool = True  # whether noise explains the misfit of the linear mode


def level_shifts(
    tests: Sequence[ModalTest], *, frequency_threshold: float = 0.002, damping_threshold: float = 0.15
) -> tuple[LevelShift, ...]:
    """Return how each elastic mode moves with the level, and whether that makes it nonlinear.

    Which shift is significant "is a subjective measure" (the paper), so there are thresholds. A mode is nonlinear if a
    shift exceeds its threshold by three standard errors or more. The data decide it if they would show a shift of twice
    the threshold; levels too weak for that are left out of the comparison.

    Args:
        tests: tests of one structure with the same modes, each with a force, at two levels or more.
        frequency_threshold: relative shift of the natural frequency from which a mode counts as nonlinear.
        damping_threshold: relative shift of the damping ratio from which a mode counts as nonlinear.

    Raises:
        InputError: fewer than two tests, one without a force, different numbers of modes, or thresholds that are not
            positive.

    >>> from opid.modal.linear.modes import LinearModes, modal_test
    >>> from opid.modal.model import NonlinearModalModel, simulate
    >>> from opid.signals.recording import Channel, Recording
    >>> modes = LinearModes([50.0], [0.01], [[0.5]], ("a",))
    >>> channels = (Channel("a", "m/s^2"), Channel("force", "N"))
    >>> def hit(newton):
    ...     force = newton * np.exp(-((np.arange(4096) - 20) ** 2) / 8)
    ...     samples = simulate(NonlinearModalModel(modes), force, fs=1024.0, drive_point="a").samples
    ...     both = Recording(np.column_stack([samples, force]), fs=1024.0, channels=channels)
    ...     return modal_test(both, modes, name=f"{newton} N", force="force", drive_point="a")
    >>> shift = level_shifts([hit(1), hit(10)])[0]
    >>> shift.nonlinear, shift.determined, shift.levels
    (False, True, ('1 N', '10 N'))
    """
    for name, value in (("frequency_threshold", frequency_threshold), ("damping_threshold", damping_threshold)):
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{name} is {value}: give a positive fraction, e.g. 0.002 for 0.2 %")
    if len(tests) < 2:
        raise InputError(f"{len(tests)} test(s) cannot show a shift: give tests at two levels or more")
    for test in tests:
        if test.modes.n_modes != tests[0].modes.n_modes:
            raise InputError(
                f"test {test.name!r} has {test.modes.n_modes} modes and {tests[0].name!r} {tests[0].modes.n_modes}: "
                "give all tests the same modes"
            )
    elastic = np.flatnonzero(np.all([test.modes.elastic for test in tests], axis=0)) + 1
    return tuple(_compare_levels(tests, int(mode), (frequency_threshold, damping_threshold)) for mode in elastic)


def nonlinear_modes(shifts: Sequence[LevelShift]) -> tuple[int, ...]:
    """Return the numbers of the modes that the `shifts` from `level_shifts` show to be nonlinear."""
    return tuple(shift.mode for shift in shifts if shift.nonlinear)


def fit_linear_mode(test: ModalTest, mode: int, *, modal_mass: float | None = None) -> LinearFit:
    """Return natural frequency and damping ratio that one test shows for a mode.

    The equation is fitted on the lines of a band around the peak, with q'' / j omega for q'; the mass m takes up the
    scale of shapes and force. In a record that has not decayed, the unknown end state has two terms of its own. The
    intervals hold the effect of noise. A clearly nonlinear mode has no single frequency: that of the linear mode with
    the nearest force is returned. Over a narrow band m and k of such a mode cannot be distinguished; `modal_mass` is
    then the m that another test shows.
    """
    if not test.forces:
        raise InputError(
            f"test {test.name!r} has no force: levels are compared by response over force, so name the force channel"
        )
    index = test.modes.index(mode)
    given_hz, given_zeta = float(test.modes.frequency_hz[index]), float(test.modes.damping_ratio[index])
    if given_hz == 0:
        raise InputError(f"mode {mode} is a rigid-body mode (0 Hz): it has no resonance that could shift")
    acceleration = test.modal_acceleration(mode)
    lines = _Lines(
        fft.rfftfreq(acceleration.size, 1 / test.fs),
        fft.rfft(acceleration),
        fft.rfft(test.modal_force(mode)),
        given_hz,
        acceleration.size,
    )
    # The peak lies within a tenth to either side, and no farther than the middle between two modes.
    below, above = test.modes.neighbours_hz(mode)
    low = max((1 - MODAL.searched) * given_hz, (given_hz + below) / 2)
    high = max(min((1 + MODAL.searched) * given_hz, 0.49 * test.fs, (given_hz + above) / 2), given_hz)
    searched = lines.around(given_hz, min(given_hz - low, high - given_hz))
    nothing = LinearFit(Estimate(), Estimate(), lines.peak(searched), (low, high))
    if not lines.force.any() or searched.sum() < MODAL.fewest_lines:
        return nothing
    ratio, zeta = _find_oscillator(lines.equation(searched).least_squares(modal_mass)) or (0.0, 0.0)
    centre = ratio * given_hz
    if not low < centre < high:  # where noise hides the mode, the search finds one elsewhere or none
        centre, zeta = given_hz, max(given_zeta, 1e-3)
    near = lines.around(centre, min(MODAL.level_half_widths * zeta, MODAL.searched) * centre)
    nothing = replace(nothing, amplitude=lines.peak(near), band_hz=lines.ends(near))
    if not lines.is_seen(near):
        return nothing
    # A strongly nonlinear mode may move out of the narrow band.
    for band in (near, searched):
        found = _fit_band(lines, band, (centre / given_hz, zeta), modal_mass, nothing)
        if found is not None and low < (found.frequency_hz.value or 0.0) < high:
            return found
    return replace(nothing, band_hz=lines.ends(searched), explained=False)


@dataclass(frozen=True, eq=False)
class _Lines:
    """Spectra of a mode, and the frequency by which the equation is scaled."""

    frequency_hz: FloatArray
    acceleration: ComplexArray
    force: ComplexArray
    scale_hz: float
    n_samples: int

    def around(self, centre: float, half: float) -> NDArray[np.bool_]:
        half = max(half, 0.5 * (MODAL.fewest_lines + 1) * float(self.frequency_hz[1]))
        return (np.abs(self.frequency_hz - centre) <= half) & (self.frequency_hz > 0)

    def ends(self, band: NDArray[np.bool_]) -> tuple[float, float]:
        return float(self.frequency_hz[band][0]), float(self.frequency_hz[band][-1])

    def motion(self, band: NDArray[np.bool_]) -> FloatArray:
        return fft.irfft(np.where(band, self.acceleration, 0), self.n_samples)

    def peak(self, band: NDArray[np.bool_]) -> float:
        return float(np.abs(self.motion(band)).max())

    def is_seen(self, band: NDArray[np.bool_]) -> bool:
        """Return whether the mode stands out of the noise; most lines of the record are noise or less."""
        power = np.abs(self.acceleration) ** 2
        # For complex noise the median of |line|^2 is ln 2 times its mean.
        return bool(np.sort(power[band])[-3] > MODAL.least_peak**2 * np.median(power) / np.log(2))

    def has_decayed(self, band: NDArray[np.bool_]) -> bool:
        motion = np.abs(self.motion(band))
        return bool(motion[-max(2, self.n_samples // 50) :].max() <= MODAL.not_decayed * motion.max())

    def equation(self, band: NDArray[np.bool_], *, open_end: bool = False) -> _Equation:
        j_omega = 1j * self.frequency_hz[band] / self.scale_hz
        columns = np.stack([np.ones_like(j_omega), 1 / j_omega, 1 / j_omega**2], axis=1)
        ends = columns[:, 1:] * np.abs(self.force[band]).max() if open_end else columns[:, :0]
        return _Equation(columns, self.acceleration[band], self.force[band], ends)


@dataclass(frozen=True, eq=False)
class _Equation:
    """F = D Q + ends theta_e on the lines of a band, D = m + c/jw + k/(jw)^2, omega in units of the given frequency.

    The unknowns are theta = (m, c, k, theta_e); `columns` are 1, 1/jw, 1/(jw)^2, Q the response and F the force.
    """

    columns: ComplexArray
    response: ComplexArray
    force: ComplexArray
    ends: ComplexArray

    def least_squares(self, mass: float | None = None) -> FloatArray:
        """Return theta by plain least squares: noise biases it; for a nonlinear mode it is the nearest linear force."""
        if mass is not None:
            remainder = replace(self, columns=self.columns[:, 1:], force=self.force - mass * self.response)
            return np.concatenate([[mass], remainder.least_squares()])
        columns = np.hstack([self.columns * self.response[:, None], self.ends])
        return _solve(_stack_parts(columns), _stack_parts(self.force))

    def residual(self, theta: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Return r = F - D Q - ends theta_e, and D."""
        dynamic = self.columns @ theta[:3]
        return self.force - dynamic * self.response - self.ends @ theta[3:], dynamic

    def weighted(self, theta: FloatArray, noise: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return r / sqrt(v) as real numbers, and its derivatives; v = a + b |D|^2 is the noise of force and q''."""
        residual, dynamic = self.residual(theta)
        v = noise[0] + noise[1] * np.abs(dynamic) ** 2
        jacobian = -np.hstack([self.columns * self.response[:, None], self.ends]) / np.sqrt(v)[:, None]
        of_v = 2 * noise[1] * (dynamic.conj()[:, None] * self.columns).real
        jacobian[:, :3] -= (residual / (2 * v**1.5))[:, None] * of_v
        return _stack_parts(residual / np.sqrt(v)), _stack_parts(jacobian)

    def maximum_likelihood(self, ratio: float, zeta: float) -> tuple[FloatArray, FloatArray]:
        """Return theta with the least sum |r|^2 / v, and a, b; with a v that ignores theta it would be biased."""
        from scipy import optimize

        theta = np.concatenate([[1.0, 2 * zeta * ratio, ratio**2], np.zeros(self.ends.shape[1])])
        noise = np.array([np.median(np.abs(self.columns @ theta[:3]) ** 2), 1.0])
        for _ in range(4):  # theta and the noise are found in turns
            theta = optimize.least_squares(
                lambda x, noise: self.weighted(x, noise)[0],
                theta,
                lambda x, noise: self.weighted(x, noise)[1],
                x_scale="jac",
                max_nfev=30,
                args=(noise,),
            ).x
            noise = self._fit_noise(theta)
        return theta, noise

    def _fit_noise(self, theta: FloatArray) -> FloatArray:
        """Return the noise a and b that fit the misfit, |r|^2 = a + b |D|^2 on average, neither below zero."""
        from scipy import optimize

        residual, dynamic = self.residual(theta)
        size, power = np.abs(dynamic) ** 2, np.abs(residual) ** 2
        power = power * (2 * power.size / (2 * power.size - theta.size))
        # Simulated tests without noise need finite weights, too.
        largest = np.array([np.max(np.abs(each) ** 2) for each in (self.force, self.response)])
        least = 1e-14 * largest + np.finfo(float).tiny
        noise = np.array([power.mean() / 2, power.mean() / 2 / size.mean()])
        for _ in range(4):
            v = np.maximum(noise, least) @ np.stack([np.ones_like(size), size])
            scale = np.array([1.0, 1 / size.mean()])
            noise = optimize.nnls(np.stack([1 / v, size / v], axis=1) * scale, power / v)[0] * scale
        return np.maximum(noise, least)

    def covariance(self, theta: FloatArray, noise: FloatArray, *, fixed: int) -> FloatArray:
        """Return the covariance of theta, whose first `fixed` entries are known."""
        residual, jacobian = self.weighted(theta, noise)
        jacobian = jacobian[:, fixed:]
        norms = np.linalg.norm(jacobian, axis=0)
        scaled = jacobian / norms
        # Two noise levels were fitted, too.
        variance = residual @ residual / (residual.size - theta.size - 2)
        free = variance * np.linalg.pinv(scaled.T @ scaled, rcond=1e-14, hermitian=True) / np.outer(norms, norms)
        return np.pad(free, (fixed, 0))


def _stack_parts(lines: ComplexArray) -> FloatArray:
    return np.concatenate([lines.real, lines.imag])


def _solve(jacobian: FloatArray, residual: FloatArray) -> FloatArray:
    norms = np.linalg.norm(jacobian, axis=0)
    return np.linalg.lstsq(jacobian / norms, residual, rcond=1e-9)[0] / norms


def _find_oscillator(mck: FloatArray) -> tuple[float, float] | None:
    """Return natural frequency, in units of the scale, and damping ratio of m, c, k; None if they do not oscillate."""
    m, c, k = mck[:3]
    if not k * m > 0:
        return None
    zeta = c / (2 * m * np.sqrt(k / m))
    return (float(np.sqrt(k / m)), float(zeta)) if 0 < zeta < 1 else None


def _fit_band(
    lines: _Lines, band: NDArray[np.bool_], start: tuple[float, float], mass: float | None, nothing: LinearFit
) -> LinearFit | None:
    """Return the oscillator that fits the lines of a band; None if the fit does not oscillate."""
    equation = lines.equation(band, open_end=not lines.has_decayed(band))
    theta, noise, fixed = equation.least_squares(), np.array([1.0, 0.0]), 0
    quiet = _find_quiet_fraction(equation.residual(theta)[0], band, lines.n_samples)
    is_noise = quiet >= MODAL.quiet_fraction
    if is_noise:
        likely, its_noise = equation.maximum_likelihood(*start)
        if _find_oscillator(likely) is not None:
            theta, noise = likely, its_noise
    elif mass is not None:
        theta, fixed = equation.least_squares(mass), 1
    oscillator = _find_oscillator(theta)
    if oscillator is None:
        return None
    covariance = (1.0 if is_noise else quiet) * equation.covariance(theta, noise, fixed=fixed)
    m, c, k = theta[:3]
    of_frequency, of_damping = np.zeros(theta.size), np.zeros(theta.size)
    of_frequency[:3] = -0.5 / m, 0.0, 0.5 / k
    of_damping[:3] = -0.5 / m, 1 / c, -0.5 / k
    std = [float(np.sqrt(gradient @ covariance @ gradient)) for gradient in (of_frequency, of_damping)]
    frequency_hz, zeta = oscillator[0] * lines.scale_hz, oscillator[1]
    return replace(
        nothing,
        frequency_hz=Estimate.normal(frequency_hz, frequency_hz * std[0]),
        damping_ratio=Estimate.normal(zeta, zeta * std[1]),
        band_hz=lines.ends(band),
        modal_mass=float(m),
        explained=is_noise,
    )


def _find_quiet_fraction(residual: ComplexArray, band: NDArray[np.bool_], n_samples: int) -> float:
    """Return the power of the misfit in the quietest quarter of the record over its mean.

    Noise is stationary; the misfit of a linear mode to a nonlinear one is largest where the motion is.
    """
    spectrum = np.zeros(band.size, dtype=np.complex128)
    spectrum[band] = residual
    power = [float(np.mean(part**2)) for part in np.array_split(fft.irfft(spectrum, n_samples), 4)]
    return float(min(power) / max(np.mean(power), np.finfo(float).tiny))


def _compare_levels(tests: Sequence[ModalTest], mode: int, thresholds: tuple[float, float]) -> LevelShift:
    names, fits = _sort_by_amplitude(tests, mode)
    known = [index for index, fit in enumerate(fits) if fit.frequency_hz.value is not None]
    sharp = [index for index in known if _is_sharp(fits[index], thresholds)]
    pairs = [(each[0], each[-1]) for each in (sharp, known) if len(each) > 1] or [(0, len(fits) - 1)]
    # Levels that are not sharp may still show a strong shift.
    found = [_judge(mode, fits[low], fits[high], thresholds) for low, high in pairs]
    best = max((index for index, (_, nonlinear, _, _) in enumerate(found) if nonlinear), default=0)
    (low, high), (shifts, nonlinear, determined, reason) = pairs[best], found[best]
    ratio = fits[high].amplitude / fits[low].amplitude if fits[low].amplitude > 0 else np.inf
    between = f"{names[low]!r} and {names[high]!r}"
    if determined and not nonlinear and ratio < MODAL.least_level_ratio:
        determined = False
        reason = (
            f"the data cannot decide: the amplitudes of mode {mode} in {between} differ only by a factor of "
            f"{ratio:.2g}, drive it harder in one of the tests"
        )
    elif determined:
        reason = f"{reason} between {between}, whose amplitudes differ by a factor of {ratio:.3g}"
    return LevelShift(
        mode=mode,
        levels=tuple(names),
        amplitude=tuple(fit.amplitude for fit in fits),
        frequency_hz=tuple(fit.frequency_hz for fit in fits),
        damping_ratio=tuple(fit.damping_ratio for fit in fits),
        frequency_shift=shifts[0],
        damping_shift=shifts[1],
        nonlinear=nonlinear,
        determined=determined,
        reason=reason,
    )


def _sort_by_amplitude(tests: Sequence[ModalTest], mode: int) -> tuple[list[str], list[LinearFit]]:
    """Return names and fits from the smallest amplitude up; nonlinear fits take the mass that a linear one shows."""
    found = [(fit_linear_mode(test, mode), test) for test in tests]
    found.sort(key=lambda pair: pair[0].amplitude)
    weighed = [fit for fit, _ in found if fit.modal_mass is not None]
    # The strongest linear test shows the mass best; if none is linear, the weakest is nearest to linear.
    known = next((fit for fit in reversed(weighed) if fit.explained), weighed[0] if weighed else None)
    mass = known.modal_mass if known else None
    fits = [
        fit if fit.explained or fit is known else fit_linear_mode(test, mode, modal_mass=mass) for fit, test in found
    ]
    return [test.name for _, test in found], fits


def _is_sharp(fit: LinearFit, thresholds: tuple[float, float]) -> bool:
    pairs = zip((fit.frequency_hz, fit.damping_ratio), thresholds, strict=True)
    return all(
        each.value is not None and each.std is not None and 1.96 * each.std <= np.sqrt(0.5) * threshold * each.value
        for each, threshold in pairs
    )


def _compare(high: Estimate, low: Estimate) -> Estimate:
    if high.value is None or low.value is None:
        return Estimate()
    ratio = high.value / low.value
    if high.std is None or low.std is None:
        return Estimate(ratio - 1)
    # A ratio near 0 would hide the uncertainty of the lower value.
    return Estimate.normal(ratio - 1, max(1.0, ratio) * float(np.hypot(high.std / high.value, low.std / low.value)))


def _judge(
    mode: int, low: LinearFit, high: LinearFit, thresholds: tuple[float, float]
) -> tuple[tuple[Estimate, Estimate], bool, bool, str]:
    """Return shifts of frequency and damping, whether the mode is nonlinear, whether the data decide it, and why."""
    shifts = _compare(high.frequency_hz, low.frequency_hz), _compare(high.damping_ratio, low.damping_ratio)
    shifted, wide, percents = [], [], []
    for word, shift, threshold in zip(("frequency", "damping"), shifts, thresholds, strict=True):
        if shift.value is None or shift.std is None:
            hardly = f"the data cannot decide: mode {mode} hardly moves at one of the levels, drive it harder"
            return shifts, False, False, hardly
        percents.append(f"{100 * shift.value:+.3g} %")
        if abs(shift.value) - MODAL.shift_sigma * shift.std > threshold:
            shifted.append(f"{word} by {percents[-1]} (threshold {100 * threshold:.3g} %)")
        if 1.96 * shift.std > threshold:
            lowest, highest = (100 * (shift.value + sign * 1.96 * shift.std) for sign in (-1, 1))
            wide.append(f"{word} shifts by {lowest:+.2g} to {highest:+.2g} % (95 % interval)")
    if shifted:
        return shifts, True, True, f"mode {mode} shifts in {' and in '.join(shifted)}"
    if wide:
        return shifts, False, False, f"the data cannot decide: the {' and the '.join(wide)}, drive mode {mode} harder"
    both = f"{percents[0]} in frequency, {percents[1]} in damping"
    return shifts, False, True, f"mode {mode} shifts no further than its thresholds and chance allow ({both})"
