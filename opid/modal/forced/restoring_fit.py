"""The restoring force of one mode from the tests that excite it (Pacini section 3.3): its coefficients and orders.

All tests are stacked. Cross-validation over tests, or over lines where there are few tests, shows how many powers a
mode needs.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from opid.errors import InputError
from opid.estimate import Estimate
from opid.mechanics.backbones.harmonic_balance import first_harmonic_factor
from opid.mechanics.structure import ComplexArray
from opid.modal.forced.equation import ModeLines, Powers, find_line_noise, find_noise_scores
from opid.modal.power_laws import HIGHEST_ORDER
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray

K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True, eq=False)
class Coefficients:
    """The coefficients of one mode.

    Args:
        powers: powers of displacement and velocity.
        value: (n,) coefficients k_n, then c_n.
        covariance: (n, n) covariance of the coefficients.
        condition_raw: condition number of the columns as they are.
        condition_scaled: condition number of the columns scaled to unit norm.
        residual_fraction: rms of the misfit over that of the modal force, in the band.
        noise: (m,) divisor of each line, for each test: its noise together with the misfit of the model beyond it.
    """

    powers: Powers
    value: FloatArray
    covariance: FloatArray
    condition_raw: float
    condition_scaled: float
    residual_fraction: float
    noise: tuple[FloatArray, ...]

    def stiffness(self) -> dict[int, Estimate]:
        """k_n by its power."""
        return dict(zip(self.powers.k, self._make_estimates(), strict=False))

    def damping(self) -> dict[int, Estimate]:
        """c_n by its power."""
        return dict(zip(self.powers.c, self._make_estimates()[len(self.powers.k) :], strict=True))

    def _make_estimates(self) -> list[Estimate]:
        return [Estimate.normal(v, s) for v, s in zip(self.value, np.sqrt(np.diag(self.covariance)), strict=True)]


@dataclass(frozen=True)
class OrderRung:
    """One pair of orders that was tried."""

    stiffness_order: int  # N_s
    damping_order: int  # N_d
    error: float  # misfit of the tests that were left out, over the modal force (rms)
    error_std: float  # standard error of that misfit, from test to test
    chosen: bool  # whether this pair was chosen


def fit_coefficients(
    lines: Sequence[ModeLines], *, stiffness_order: int, damping_order: int, free_linear: bool = False
) -> Coefficients:
    """Fit k_n and c_n to the lines of all tests by least squares (Pacini eq. 12 with the columns of eq. 11).

    Every line is divided by its standard deviation due to the sensors' noise, and where the misfit of a test is larger
    than that, by the two together. `fit_unweighted` is the printed least squares.

    Args:
        lines: the equation of the mode on the lines of each test.
        stiffness_order: N_s, 1 to 5; 1 has no nonlinear stiffness.
        damping_order: N_d, 1 to 5; 1 has no nonlinear damping.
        free_linear: whether the powers 1 are fitted, too: corrections of k0 and c0.

    Raises:
        InputError: an order outside 1 to 5, or more coefficients than the lines can determine.
    """
    powers = Powers.of(stiffness_order, damping_order, free_linear=free_linear)
    value = _solve_by_noise(lines, powers)
    whole = []
    for each in lines:
        whole.append(_add_misfit(find_line_noise(each, powers, value), powers.misfit(each, value)))
    return _finish(powers, lines, whole)


def fit_unweighted(
    lines: Sequence[ModeLines], *, stiffness_order: int, damping_order: int, free_linear: bool = False
) -> Coefficients:
    """Fit k_n and c_n as printed: every line of every test with the same weight (Pacini eq. 12).

    Arguments and errors are those of `fit_coefficients`: `lines`, `stiffness_order`, `damping_order`, `free_linear`.
    """
    powers = Powers.of(stiffness_order, damping_order, free_linear=free_linear)
    return _finish(powers, lines, [np.ones(each.frequency_hz.size) for each in lines])


def fit_modal_mass(lines: Sequence[ModeLines]) -> Estimate:
    """Return the mass that the tests show for a mode whose shape is mass-normalised, where it should be 1.

    The inertia force gets a factor of its own beside free linear and nonlinear terms up to the third power. The factor
    is s^2 for a shape that is s times too large, and g for a force that is g times too large.
    """
    powers = Powers.of(3, 3, free_linear=True)
    columns = [np.column_stack([each.inertia, powers.columns(each)]) for each in lines]
    forces = [each.force for each in lines]
    noise = [find_line_noise(each, Powers((), ()), np.zeros(0)) for each in lines]
    found = _solve(columns, forces, noise)
    # A rough standard deviation is enough, so the residuals are taken as white.
    matrix = _stack(columns, noise)
    scale = np.linalg.norm(matrix, axis=0)
    residual = _stack(forces, noise) - matrix @ found
    of_mass = np.linalg.pinv((matrix / scale).T @ (matrix / scale))[0, 0] / scale[0] ** 2
    return Estimate.normal(found[0], float(np.sqrt(np.mean(residual**2) * of_mass)))


def fit_delay(lines: Sequence[ModeLines]) -> Estimate:
    """Return the time by which the accelerations come after the forces, s; it is zero where both share one clock.

    With accelerations that are tau late, f_q exp(-j omega tau) takes the place of f_q, and the equation gets the column
    j omega f_q. It is fitted with a free modal mass and free terms up to the third power. At resonance the phase of a
    force is also that of its damping: the two differ by how they depend on the frequency, so a delay is known as well
    as the band has lines beside the resonance. The standard deviation is at least what the answers without each test
    show (the jackknife of Tukey 1958): a law that is no polynomial bends the phase of each level in another way, which
    with fewer than three tests looks like a delay. Then, and where the steps do not converge, nothing is stated.
    """
    if len(lines) < 3:
        return Estimate()
    delay_s, std = _fit_delay(lines)
    without = [_fit_delay([other for other in lines if other is not each])[0] for each in lines]
    std = max(std, float(np.sqrt((len(lines) - 1) * np.var(without))))
    return Estimate.normal(delay_s, std) if np.isfinite([delay_s, std]).all() else Estimate()


def correct_delay(lines: Sequence[ModeLines], delay: Estimate) -> tuple[list[ModeLines], float]:
    """Return the lines with forces that come later by a significant delay, and the error of the delay that is left, s.

    Smaller delays stay; the error is then what their estimate has beyond its standard deviation.
    """
    value, std = float(delay.value or 0.0), float(delay.std or 0.0)
    if abs(value) > MODAL.delay_sigma * std:
        return [delay_force(each, value) for each in lines], std
    return list(lines), float(np.sqrt(max(value**2 - std**2, 0.0)))


def delay_force(lines: ModeLines, delay_s: float) -> ModeLines:
    """Return the equation on the same lines with a force that comes later by a time, s."""
    force = lines.force * np.exp(-2j * np.pi * lines.frequency_hz * delay_s)
    return replace(lines, force=force, left_side=lines.left_side + force - lines.force)


def add_delay_error(found: Coefficients, lines: Sequence[ModeLines], delay_std_s: float) -> Coefficients:
    """Return coefficients whose covariance holds the error of the delay between forces and accelerations of `lines`."""
    orders = dict(zip(("stiffness_order", "damping_order"), found.powers.orders, strict=True))
    late = [delay_force(each, delay_std_s) for each in lines]
    step = fit_coefficients(late, **orders, free_linear=1 in found.powers.k).value - found.value
    return replace(found, covariance=found.covariance + np.outer(step, step))


def find_shown_mass(mass: Estimate) -> float:
    """Return the modal mass without what its standard deviation explains of its distance from 1."""
    value, std = float(mass.value or 1.0), float(mass.std or 0.0)
    return 1.0 + float(np.sign(value - 1.0) * np.sqrt(max((value - 1.0) ** 2 - std**2, 0.0)))


def add_scale_error(found: Coefficients, lines: Sequence[ModeLines], mass: Estimate) -> Coefficients:
    """Return coefficients whose covariance holds a wrong scale of the force or of the motion.

    A modal mass m that is not 1 beyond its standard deviation shows that one of them is off; which, it does not show.
    If it is the force, the force over m gives the coefficients; if it is the motion, these over m^(n-1).
    """
    shown = find_shown_mass(mass)
    if shown == 1.0 or not found.value.size:
        return found
    orders = dict(zip(("stiffness_order", "damping_order"), found.powers.orders, strict=True))
    scaled = [
        replace(each, force=each.force / shown, left_side=each.left_side + each.force * (1 / shown - 1))
        for each in lines
    ]
    by_force = fit_coefficients(scaled, **orders, free_linear=1 in found.powers.k).value
    by_motion = by_force / shown ** (np.array([*found.powers.k, *found.powers.c]) - 1.0)
    steps = np.stack([by_force, by_motion]) - found.value
    return replace(found, covariance=found.covariance + steps.T @ steps)


def add_gain_error(found: Coefficients, gain_std: float) -> Coefficients:
    """Return coefficients whose covariance holds an error of calibration that no modal mass shows.

    Where force and motion of a mode are both s times too large, the modal mass is 1, and a coefficient of the power n
    is s^(1 - n) times its value; the correction of a linear coefficient does not change.

    Args:
        found: the coefficients.
        gain_std: standard deviation of s, see `find_common_gain`.
    """
    step = gain_std * (1.0 - np.array([*found.powers.k, *found.powers.c])) * found.value
    return replace(found, covariance=found.covariance + np.outer(step, step))


def find_common_gain(gain_tolerance: float) -> float:
    """Return the standard deviation of the gain that force and motion of a mode have in common, as a fraction.

    The gains of force and accelerations have independent errors of the standard deviation `gain_tolerance`. Shapes that
    the same sensors showed, or a modal mass that is 1, leave their geometric mean unknown.
    """
    return gain_tolerance / float(np.sqrt(2.0))


def add_model_error(found: Coefficients, lines: Sequence[ModeLines], misfit: float) -> Coefficients:
    """Return coefficients whose covariance holds what a law that misses the tests does to them.

    A true law is the same in each test and in each part of the band. So each test is left out in turn, and each part of
    the band, and the scatter of the answers (`find_jackknife`) counts as far as noise does not explain the
    misfit.

    Args:
        found: the coefficients.
        lines: the equation of the mode on the lines of each test.
        misfit: rms of the misfit over what noise alone would leave.
    """
    part = max(0.0, 1.0 - 1.0 / max(misfit, 1.0) ** 2)
    if not (part and found.value.size):
        return found
    columns = [found.powers.columns(each) for each in lines]
    covariance = found.covariance
    for groups in (_number_tests(lines), _number_parts(lines, found.noise)):
        numbers = range(max(int(each.max()) for each in groups) + 1)
        if len(numbers) < 2:
            continue
        without = np.stack([_solve_without(number, groups, lines, columns, found.noise) for number in numbers])
        covariance = covariance + part * find_jackknife(without - found.value)
    return replace(found, covariance=covariance)


def find_jackknife(steps: FloatArray) -> FloatArray:
    """Return the covariance of coefficients from what changes while each part of the data is left out in turn.

    The scatter is that of the jackknife (Tukey 1958), wider as Student's t is for so few parts.

    Args:
        steps: (n, p) coefficients without each part less those of all data.
    """
    n = len(steps)
    widened = (float(stats.t.ppf(0.975, n - 1)) / 1.96) ** 2
    return np.asarray(widened * (n - 1) / n * steps.T @ steps, dtype=np.float64)


def _number_tests(lines: Sequence[ModeLines]) -> list[NDArray[np.int64]]:
    """Return the number of its test for each line."""
    return [np.full(each.frequency_hz.size, number) for number, each in enumerate(lines)]


def _number_parts(lines: Sequence[ModeLines], noise: Sequence[FloatArray]) -> list[NDArray[np.int64]]:
    """Return the number of the part of the band for each line; each part has the same power of the force over noise."""
    frequency = np.concatenate([each.frequency_hz for each in lines])
    power = np.concatenate([np.abs(each.force / own) ** 2 for each, own in zip(lines, noise, strict=True)])
    order = np.argsort(frequency)
    below = np.cumsum(power[order]) / power.sum()
    ends = [float(frequency[order][np.searchsorted(below, k / MODAL.n_blocks)]) for k in range(1, MODAL.n_blocks)]
    return [np.searchsorted(ends, each.frequency_hz) for each in lines]


def _solve_without(
    number: int,
    groups: Sequence[NDArray[np.int64]],
    lines: Sequence[ModeLines],
    columns: Sequence[ComplexArray],
    noise: Sequence[FloatArray],
) -> FloatArray:
    """Return the coefficients without the lines of one group."""
    kept = [each != number for each in groups]
    return _solve(
        [own[keep] for own, keep in zip(columns, kept, strict=True)],
        [each.left_side[keep] for each, keep in zip(lines, kept, strict=True)],
        [own[keep] for own, keep in zip(noise, kept, strict=True)],
    )


def linearised(powers: Iterable[int], value: Iterable[float], amplitude: FloatArray) -> FloatArray:
    """Return sum value_n a_n A^(n-1), which is added to k0 or c0 at an amplitude (harmonic linearisation).

    Args:
        powers: powers of the coefficients.
        value: (n_powers,) the coefficients.
        amplitude: (n_points,) amplitudes of displacement or velocity.
    """
    total = np.zeros_like(amplitude)
    for n, each in zip(powers, value, strict=True):
        total += each * first_harmonic_factor(n) * amplitude ** (n - 1)
    return total


def search_orders(
    lines: Sequence[ModeLines],
    *,
    stiffness_order: int | None = None,
    damping_order: int | None = None,
    free_linear: bool = False,
) -> tuple[OrderRung, ...]:
    """Return every pair of orders with its error on data that were left out; one of them is chosen.

    With three tests or more each is left out in turn, except the one with the largest motion, to which a polynomial
    would have to be extrapolated. With fewer, interleaved blocks of lines are left out. The fewest powers are chosen
    whose error is within one standard error and 1 % of the least one.
    """
    folds = _make_folds(lines)
    errors: dict[tuple[int, int], np.ndarray] = {}
    every = range(1, HIGHEST_ORDER + 1)
    for n_s in every if stiffness_order is None else (stiffness_order,):
        for n_d in every if damping_order is None else (damping_order,):
            try:
                powers = Powers.of(n_s, n_d, free_linear=free_linear)
                errors[n_s, n_d] = np.array([_cross_validate(kept, out, powers) for kept, out in folds])
            except InputError:
                continue  # too many coefficients for the lines that are left
    if not errors:
        raise InputError("no order can be fitted to so few lines: give longer or more tests")
    chosen = choose_simplest(errors, {orders: sum(orders) for orders in errors})
    return tuple(
        OrderRung(*orders, find_rms(each), float(np.std(each, ddof=1)) / len(folds) ** 0.5, orders == chosen)
        for orders, each in errors.items()
    )


def choose_simplest(errors: Mapping[K, FloatArray], sizes: Mapping[K, int]) -> K:
    """Return the smallest of some forms of a law whose error is within one standard error and 1 % of the least one.

    Args:
        errors: (n_folds,) errors of each form on what was left out in turn.
        sizes: the number of coefficients of each form.
    """
    return min(list_near(errors, sizes), key=lambda form: (sizes[form], find_rms(errors[form])))


def list_near(errors: Mapping[K, FloatArray], sizes: Mapping[K, int]) -> list[K]:
    """Return the forms of a law whose error is within one standard error and 1 % of the least one; see above."""
    mean = {form: find_rms(each) for form, each in errors.items()}
    best = min(mean, key=lambda form: (mean[form], sizes[form]))
    # Differences from the best are taken fold by fold, so that errors common to all forms do not count.
    return [
        form
        for form, each in errors.items()
        if mean[form]
        <= (1 + MODAL.parsimony) * mean[best] + float(np.std(each - errors[best], ddof=1)) / each.size**0.5
    ]


def find_rms(errors: FloatArray) -> float:
    """Return the rms of errors."""
    return float(np.sqrt(np.mean(errors**2)))


def is_linear_part_off(lines: Sequence[ModeLines], *, stiffness_order: int, damping_order: int) -> bool:
    """Return whether the tests need corrections of k0 and c0 (Bayesian information criterion, two parameters)."""
    orders = {"stiffness_order": stiffness_order, "damping_order": damping_order}
    fixed, free = (fit_coefficients(lines, **orders, free_linear=is_free) for is_free in (False, True))
    # Both fits are judged with the weights of the freer one.
    chi2 = [
        sum(
            float(np.sum(np.abs(fit.powers.misfit(each, fit.value) / noise) ** 2))
            for each, noise in zip(lines, free.noise, strict=True)
        )
        for fit in (fixed, free)
    ]
    n_lines = sum(each.frequency_hz.size for each in lines)
    gain = 2 * (chi2[0] - chi2[1]) / max(chi2[1] / n_lines, 1e-300)
    return gain > 2 * np.log(2 * n_lines)


def sum_lagged_products(scores: FloatArray, reach: int) -> FloatArray:
    """Return the covariance of the sum of scores, (n, p), that are correlated up to a lag, with Bartlett's weights.

    Newey and West 1987, Econometrica 55, 703-708.
    """
    total = scores.T @ scores
    for lag in range(1, min(reach, len(scores) - 1) + 1):
        product = (1 - lag / (reach + 1)) * scores[lag:].T @ scores[:-lag]
        total += product + product.T
    return total


def _add_misfit(noise: FloatArray, misfit: ComplexArray) -> FloatArray:
    """Return the standard deviation of the lines of a test by its noise and by what the misfit has beyond it."""
    beyond = np.sqrt(max(float(np.mean(np.abs(misfit) ** 2 - noise**2)), 0.0))
    return np.hypot(noise, beyond)


def _fit_delay(lines: Sequence[ModeLines]) -> tuple[float, float]:
    """Return the delay of the accelerations and its standard deviation, s; both nan where the steps do not converge."""
    powers, delay_s, coefficients = Powers.of(3, 3, free_linear=True), 0.0, np.zeros(6)
    noise = [find_line_noise(each, powers, coefficients) for each in lines]
    for step in range(MODAL.most_delay_steps):
        late = [delay_force(each, delay_s) for each in lines]
        columns = [
            np.column_stack([2j * np.pi * each.frequency_hz * each.force, each.inertia, powers.columns(each)])
            for each in late
        ]
        value = _solve(columns, [each.left_side for each in late], noise)
        delay_s, coefficients = delay_s + float(value[0]), value[2:]
        misfit = [each.left_side - own @ value for each, own in zip(late, columns, strict=True)]
        if step < MODAL.weighted_delay_steps:  # weights that went on changing would keep the steps from settling
            noise = [
                _add_misfit(find_line_noise(each, powers, coefficients), own)
                for each, own in zip(late, misfit, strict=True)
            ]
            continue
        std = float(np.sqrt(_find_covariance(late, columns, noise, misfit, powers, coefficients)[0, 0]))
        if abs(value[0]) < 0.01 * std:
            return delay_s, std
    return float("nan"), float("nan")


def _solve_by_noise(lines: Sequence[ModeLines], powers: Powers) -> FloatArray:
    """Return the coefficients, every line weighted by the sensors' noise alone."""
    n_lines, n = sum(each.frequency_hz.size for each in lines), len(powers.k) + len(powers.c)
    if n_lines < 4 * n:
        raise InputError(
            f"{n} coefficients are to be fitted to {n_lines} lines: lower stiffness_order ({powers.orders[0]}) "
            f"and damping_order ({powers.orders[1]}), or give longer tests"
        )
    columns, value = [powers.columns(each) for each in lines], np.zeros(n)
    left_sides = [each.left_side for each in lines]
    for _ in range(2):  # the weights depend on the tangents, which the fit finds
        value = _solve(columns, left_sides, [find_line_noise(each, powers, value) for each in lines])
    return value


def _make_folds(lines: Sequence[ModeLines]) -> list[tuple[list[ModeLines], list[ModeLines]]]:
    if len(lines) >= 3:
        top = max(lines, key=lambda each: each.largest_q)
        return [([other for other in lines if other is not each], [each]) for each in lines if each is not top]
    blocks = [np.arange(each.frequency_hz.size) // 3 % MODAL.n_blocks for each in lines]
    return [
        (
            [each.only(own != block) for each, own in zip(lines, blocks, strict=True)],
            [each.only(own == block) for each, own in zip(lines, blocks, strict=True)],
        )
        for block in range(MODAL.n_blocks)
    ]


def _cross_validate(kept: Sequence[ModeLines], out: Sequence[ModeLines], powers: Powers) -> float:
    """Return the misfit of the lines that were left out over their modal force, all weighted by their noise."""
    value = _solve_by_noise(kept, powers)
    noise = [find_line_noise(each, powers, value) for each in out]
    left = _stack([powers.misfit(each, value) for each in out], noise)
    return float(np.linalg.norm(left) / np.linalg.norm(_stack([each.force for each in out], noise)))


def _stack(parts: Sequence[ComplexArray], noise: Sequence[FloatArray]) -> FloatArray:
    """Return the lines (m, ...) of all tests over their noise, real parts above the imaginary ones."""
    weighted = np.concatenate([(part.T / n).T for part, n in zip(parts, noise, strict=True)])
    return np.concatenate([weighted.real, weighted.imag])


def _solve(
    columns: Sequence[ComplexArray], left_sides: Sequence[ComplexArray], noise: Sequence[FloatArray]
) -> FloatArray:
    matrix = _stack(columns, noise)
    scale = np.linalg.norm(matrix, axis=0)
    if not scale.all():
        raise InputError("a column of the fit is zero, for the tests do not move the mode in its band: excite the mode")
    return np.linalg.lstsq(matrix / scale, _stack(left_sides, noise), rcond=None)[0] / scale if scale.size else scale


def _finish(powers: Powers, lines: Sequence[ModeLines], noise: Sequence[FloatArray]) -> Coefficients:
    """Return the coefficients with their covariance, by the sensors' noise and by the misfit beyond it."""
    columns = [powers.columns(each) for each in lines]
    value = _solve(columns, [each.left_side for each in lines], noise)
    misfit = [powers.misfit(each, value) for each in lines]
    force = np.concatenate([each.force for each in lines])
    missed = float(np.sqrt(np.mean(np.abs(np.concatenate(misfit)) ** 2) / np.mean(np.abs(force) ** 2)))
    if not value.size:
        return Coefficients(powers, value, np.zeros((0, 0)), 1.0, 1.0, missed, tuple(noise))
    matrix = _stack(columns, noise)
    scale = np.linalg.norm(matrix, axis=0)
    condition = float(np.linalg.cond(matrix / scale))
    if condition > MODAL.most_column_condition:
        raise InputError(
            f"the columns of orders {powers.orders[0]} (stiffness) and {powers.orders[1]} (damping) are copies of "
            f"each other on these tests (condition {condition:.1g}): lower the orders, or add levels"
        )
    covariance = _find_covariance(lines, columns, noise, misfit, powers, value)
    raw = float(np.linalg.cond(_stack(columns, [np.ones(each.size) for each in noise])))
    return Coefficients(powers, value, covariance, raw, condition, missed, tuple(noise))


def _find_covariance(
    lines: Sequence[ModeLines],
    columns: Sequence[ComplexArray],
    noise: Sequence[FloatArray],
    misfit: Sequence[ComplexArray],
    powers: Powers,
    value: FloatArray,
) -> FloatArray:
    """Return the covariance of the coefficients of columns; `value`, of `powers`, gives the tangents of the noise."""
    matrix = _stack(columns, noise)
    scale = np.linalg.norm(matrix, axis=0)
    bread = np.linalg.inv((matrix / scale).T @ (matrix / scale))
    meat = np.zeros_like(bread)
    for each, c, n, left in zip(lines, columns, noise, misfit, strict=True):
        gradient = c / n[:, None] ** 2 / scale
        meat += find_noise_scores(each, gradient, powers, value)
        by_noise = find_line_noise(each, powers, value)
        # The misfit that noise does not explain is smooth over frequency: the shorter the motion lasts, the more
        # neighbouring lines are correlated.
        part = max(0.0, 1.0 - float(np.sum(by_noise**2) / max(np.sum(np.abs(left) ** 2), 1e-300)))
        lasting = float(np.sum(each.q**2) ** 2 / max(np.sum(each.q**4), 1e-300))
        reach = int(np.ceil(2 * each.q.size / max(lasting, 1.0)))
        meat += part * sum_lagged_products((gradient.conj() * left[:, None]).real, reach)
    return bread @ meat @ bread / np.outer(scale, scale)
