"""The restoring force of one mode from the tests that excite it (Pacini section 3.3), every test stacked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.errors import InputError
from opid.estimate import Estimate
from opid.modal.forced.equation import ModeLines
from opid.modal.forced.equation_noise import line_noise, noise_scores
from opid.modal.power_laws import HIGHEST_ORDER, harmonic_share
from opid.signals.recording import FloatArray

N_ROUNDS = 2
"""Of the weights, which depend on the tangents that the fit finds."""

LARGEST_CONDITION = 1e6
"""Of the scaled columns: beyond it they are copies of each other on these tests."""


@dataclass(frozen=True, eq=False)
class Coefficients:
    """The coefficients of one mode.

    Args:
        powers_k: powers of the displacement, 1 (if k0 is corrected) and 2 .. N_s.
        powers_c: powers of the velocity likewise.
        value: (n,) k_n, then c_n.
        covariance: (n, n).
        condition_raw: of the columns as they are.
        condition_scaled: of the columns scaled to unit norm.
        residual_share: rms of the misfit over that of the modal force, in the band.
        noise: for each test (m,), what each line was divided by: the noise, and what the model misses beyond it.
    """

    powers_k: tuple[int, ...]
    powers_c: tuple[int, ...]
    value: FloatArray
    covariance: FloatArray
    condition_raw: float
    condition_scaled: float
    residual_share: float
    noise: tuple[FloatArray, ...]

    def stiffness(self) -> dict[int, Estimate]:
        """k_n by its power."""
        return dict(zip(self.powers_k, self._estimates()[: len(self.powers_k)], strict=True))

    def damping(self) -> dict[int, Estimate]:
        """c_n by its power."""
        return dict(zip(self.powers_c, self._estimates()[len(self.powers_k) :], strict=True))

    def _estimates(self) -> list[Estimate]:
        return [Estimate.normal(v, s) for v, s in zip(self.value, np.sqrt(np.diag(self.covariance)), strict=True)]


def fit_coefficients(
    lines: Sequence[ModeLines], *, stiffness_order: int, damping_order: int, free_linear: bool = False
) -> Coefficients:
    """Fit k_n and c_n to the lines of all tests by least squares (Pacini eq. 12 with the columns of eq. 11).

    Every line is divided by the standard deviation that the sensors' noise gives it; where a test misses the model by
    more than that, by the two together. `fit_unweighted` is the printed least squares.

    Args:
        lines: one a test.
        stiffness_order: N_s, 1 to 5; 1 has no nonlinear stiffness.
        damping_order: N_d likewise.
        free_linear: whether the powers 1 are fitted, too: corrections of k0 and c0.

    Raises:
        InputError: an order outside 1 to 5, or more coefficients than the lines can tell.
    """
    powers_k, powers_c = powers(stiffness_order, free_linear), powers(damping_order, free_linear)
    columns = [_columns(each, powers_k, powers_c) for each in lines]
    value = solution(lines, powers_k, powers_c)
    misfits = [each.rest - c @ value for each, c in zip(lines, columns, strict=True)]
    noise = [line_noise(each, powers_k, powers_c, value) for each in lines]
    whole = [np.hypot(n, _beyond(misfit, n)) for misfit, n in zip(misfits, noise, strict=True)]
    return _answer(powers_k, powers_c, columns, lines, whole)


def solution(lines: Sequence[ModeLines], powers_k: tuple[int, ...], powers_c: tuple[int, ...]) -> FloatArray:
    """Return the coefficients k_n, then c_n, weighted by the sensors' noise alone, without what they are worth.

    Args:
        lines: one a test.
        powers_k: powers of the displacement.
        powers_c: powers of the velocity.

    Raises:
        InputError: more coefficients than the lines can tell.
    """
    columns = [_columns(each, powers_k, powers_c) for each in lines]
    n_lines, n = sum(each.frequency_hz.size for each in lines), len(powers_k) + len(powers_c)
    if n_lines < 4 * n:
        raise InputError(
            f"{n} coefficients are to be fitted to {n_lines} lines: lower stiffness_order ({max(powers_k, default=1)}) "
            f"and damping_order ({max(powers_c, default=1)}), or give longer tests"
        )
    value = np.zeros(n)
    for _ in range(N_ROUNDS):
        value = _solved(columns, lines, [line_noise(each, powers_k, powers_c, value) for each in lines])
    return value


def powers(order: int, free_linear: bool) -> tuple[int, ...]:
    """Return the powers that are fitted: 2 .. order, and 1 where the linear part is corrected.

    Args:
        order: N_s or N_d.
        free_linear: whether the linear part is corrected.

    Raises:
        InputError: an order outside 1 to 5.

    >>> powers(3, free_linear=False)
    (2, 3)
    """
    if not 1 <= order <= HIGHEST_ORDER:
        raise InputError(f"the order is {order}: give 1 (linear) to {HIGHEST_ORDER}")
    return tuple(range(1 if free_linear else 2, order + 1))


def fit_unweighted(
    lines: Sequence[ModeLines], *, stiffness_order: int, damping_order: int, free_linear: bool = False
) -> Coefficients:
    """Fit k_n and c_n as printed: every line of every test with the same weight (Pacini eq. 12).

    Args:
        lines: one a test.
        stiffness_order: N_s.
        damping_order: N_d.
        free_linear: whether the powers 1 are fitted, too.

    Raises:
        InputError: as `fit_coefficients`.
    """
    powers_k, powers_c = powers(stiffness_order, free_linear), powers(damping_order, free_linear)
    columns = [_columns(each, powers_k, powers_c) for each in lines]
    return _answer(powers_k, powers_c, columns, lines, [np.ones(each.frequency_hz.size) for each in lines])


def modal_mass(lines: Sequence[ModeLines], *, stiffness_order: int = 3, damping_order: int = 3) -> Estimate:
    """Return the mass that the tests show for a mode whose shape is mass-normalised, where it should be 1.

    The inertia force gets a factor of its own beside free linear and nonlinear terms. A shape that is s times too large
    gives s^2, a force that is g times too large g.

    Args:
        lines: one a test.
        stiffness_order: of the nonlinear terms beside it.
        damping_order: likewise.
    """
    powers_k, powers_c = powers(stiffness_order, True), powers(damping_order, True)
    columns = [np.column_stack([each.inertia, _columns(each, powers_k, powers_c)]) for each in lines]
    whole = [replace(each, rest=each.force, linear=(0.0, 0.0)) for each in lines]
    noise = [line_noise(each, (), (), np.zeros(0)) for each in lines]
    found = _solved(columns, whole, noise)
    residual = [(each.rest - c @ found) / n for each, c, n in zip(whole, columns, noise, strict=True)]
    # its uncertainty need not be exact: white residuals, as large as they are
    matrix, _ = _stacked(columns, whole, noise)
    scale = np.linalg.norm(matrix, axis=0)
    variance = float(np.mean(np.abs(np.concatenate(residual)) ** 2)) / 2
    of_mass = np.linalg.pinv((matrix / scale).T @ (matrix / scale))[0, 0] / scale[0] ** 2
    return Estimate.normal(found[0], float(np.sqrt(variance * of_mass)))


def power_curve(powers: Sequence[int], position: FloatArray) -> FloatArray:
    """Return the columns x^n, n >= 2, of a force curve over positive x, zero for the power 1: (n_points, n_powers).

    Args:
        powers: of the coefficients.
        position: (n_points,) displacement or velocity, from 0.
    """
    return np.stack([position**n if n > 1 else np.zeros_like(position) for n in powers], axis=1)


def linearised(powers: Sequence[int], value: FloatArray, amplitude: FloatArray) -> FloatArray:
    """Return sum value_n a_n A^(n-1): what a coefficient adds to k0 or c0 at an amplitude (harmonic linearisation).

    Args:
        powers: of the coefficients.
        value: (n_powers,) the coefficients.
        amplitude: (n_points,) of displacement or velocity.
    """
    total = np.zeros_like(amplitude)
    for n, each in zip(powers, value, strict=True):
        total += each * harmonic_share(n) * amplitude ** (n - 1)
    return total


def _columns(lines: ModeLines, powers_k: Sequence[int], powers_c: Sequence[int]) -> np.ndarray:
    return np.column_stack([lines.stiffness[:, [n - 1 for n in powers_k]], lines.damping[:, [n - 1 for n in powers_c]]])


def _solved(columns: Sequence[np.ndarray], lines: Sequence[ModeLines], noise: Sequence[FloatArray]) -> FloatArray:
    if columns[0].shape[1] == 0:
        return np.zeros(0)
    matrix, rest = _stacked(columns, lines, noise)
    scale = np.linalg.norm(matrix, axis=0)
    if not scale.all():
        raise InputError("a column of the fit is zero: the tests do not move the mode in its band")
    return np.linalg.lstsq(matrix / scale, rest, rcond=None)[0] / scale


def _stacked(
    columns: Sequence[np.ndarray], lines: Sequence[ModeLines], noise: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    matrix = np.concatenate([c / n[:, None] for c, n in zip(columns, noise, strict=True)])
    rest = np.concatenate([each.rest / n for each, n in zip(lines, noise, strict=True)])
    return np.concatenate([matrix.real, matrix.imag]), np.concatenate([rest.real, rest.imag])


def _beyond(misfit: np.ndarray, noise: FloatArray) -> float:
    """What a test misses beyond its noise, standard deviation of a line; 0 where the noise explains the misfit."""
    return float(np.sqrt(max(np.mean(np.abs(misfit) ** 2 - noise**2), 0.0)))


def _answer(
    powers_k: tuple[int, ...],
    powers_c: tuple[int, ...],
    columns: Sequence[np.ndarray],
    lines: Sequence[ModeLines],
    noise: Sequence[FloatArray],
) -> Coefficients:
    value = _solved(columns, lines, noise)
    matrix, _ = _stacked(columns, lines, noise)
    scale = np.linalg.norm(matrix, axis=0)
    condition = float(np.linalg.cond(matrix / scale)) if scale.size else 1.0
    if condition > LARGEST_CONDITION:
        raise InputError(
            f"the columns of orders {max(powers_k, default=1)} (stiffness) and {max(powers_c, default=1)} (damping) "
            f"are copies of each other on these tests (condition {condition:.1g}): lower the orders, or add levels"
        )
    raw = np.concatenate(columns)
    misfit = [each.rest - c @ value for each, c in zip(lines, columns, strict=True)]
    force = np.concatenate([each.force for each in lines])
    return Coefficients(
        powers_k,
        powers_c,
        value,
        _covariance(powers_k, powers_c, value, columns, lines, noise, misfit),
        float(np.linalg.cond(np.concatenate([raw.real, raw.imag]))) if scale.size else 1.0,
        condition,
        float(np.sqrt(np.mean(np.abs(np.concatenate(misfit)) ** 2) / np.mean(np.abs(force) ** 2))),
        tuple(noise),
    )


def _covariance(
    powers_k: tuple[int, ...],
    powers_c: tuple[int, ...],
    value: FloatArray,
    columns: Sequence[np.ndarray],
    lines: Sequence[ModeLines],
    noise: Sequence[FloatArray],
    misfit: Sequence[np.ndarray],
) -> FloatArray:
    """What the sensors' noise makes of the coefficients, and what the model misses beyond it."""
    if not value.size:
        return np.zeros((0, 0))
    matrix, _ = _stacked(columns, lines, noise)
    scale = np.linalg.norm(matrix, axis=0)
    bread = np.linalg.inv((matrix / scale).T @ (matrix / scale))
    meat = np.zeros_like(bread)
    for each, c, n, left in zip(lines, columns, noise, misfit, strict=True):
        gradient = c / n[:, None] ** 2 / scale
        meat += noise_scores(each, gradient, powers_k, powers_c, value)
        by_noise = line_noise(each, powers_k, powers_c, value)
        # the share of the misfit that the noise does not explain is smooth over frequency: neighbours go together
        share = max(0.0, 1.0 - float(np.sum(by_noise**2) / max(np.sum(np.abs(left) ** 2), 1e-300)))
        meat += share * _neighbours_together((gradient.conj() * left[:, None]).real, each)
    return bread @ meat @ bread / np.outer(scale, scale)


def _neighbours_together(scores: FloatArray, lines: ModeLines) -> FloatArray:
    """Sum of the products of scores of lines that are no further apart than what lasts as long as the motion has."""
    lasting = float(np.sum(lines.q**2) ** 2 / max(np.sum(lines.q**4), 1e-300))
    reach = int(np.ceil(2 * lines.q.size / max(lasting, 1.0)))
    total = scores.T @ scores
    for lag in range(1, min(reach, len(scores) - 1) + 1):
        product = (1 - lag / (reach + 1)) * scores[lag:].T @ scores[:-lag]  # Bartlett
        total += product + product.T
    return total
