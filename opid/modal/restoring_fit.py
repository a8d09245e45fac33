"""The restoring force of one mode from the tests that excite it (Pacini section 3.3), every test stacked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.errors import InputError
from opid.estimate import Estimate
from opid.modal.equation import ModeLines
from opid.modal.power_law import HIGHEST_ORDER, harmonic_share
from opid.signals.recording import FloatArray

N_CURVE = 101
LARGEST_CONDITION = 1e6
"""Of the scaled columns: beyond it they are copies of each other on these tests."""

MOST_OF_CURVE = 0.3
"""Half width of a force curve's band where it ends, as a share of the force: wider, the orders are too high."""


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
        model_error: (n_tests,) standard deviation of a line beyond the noise, by which its weight was lowered.
    """

    powers_k: tuple[int, ...]
    powers_c: tuple[int, ...]
    value: FloatArray
    covariance: FloatArray
    condition_raw: float
    condition_scaled: float
    residual_share: float
    model_error: FloatArray

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
    powers_k, powers_c = _powers(stiffness_order, free_linear), _powers(damping_order, free_linear)
    columns = [_columns(each, powers_k, powers_c) for each in lines]
    n_lines = sum(each.frequency_hz.size for each in lines)
    n = len(powers_k) + len(powers_c)
    if n_lines < 4 * n:
        raise InputError(
            f"{n} coefficients are to be fitted to {n_lines} lines: lower stiffness_order ({stiffness_order}) and "
            f"damping_order ({damping_order}), or give longer tests"
        )
    weights = [1 / each.noise for each in lines]
    first = _solved(columns, lines, weights)
    model_error = np.array([_beyond_noise(each, c, first) for each, c in zip(lines, columns, strict=True)])
    weights = [1 / np.hypot(each.noise, beyond) for each, beyond in zip(lines, model_error, strict=True)]
    return _answer(powers_k, powers_c, columns, lines, weights, model_error)


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
    powers_k, powers_c = _powers(stiffness_order, free_linear), _powers(damping_order, free_linear)
    columns = [_columns(each, powers_k, powers_c) for each in lines]
    weights = [np.ones(each.frequency_hz.size) for each in lines]
    return _answer(powers_k, powers_c, columns, lines, weights, np.zeros(len(lines)))


def modal_mass(lines: Sequence[ModeLines], *, stiffness_order: int = 3, damping_order: int = 3) -> Estimate:
    """Return the mass that the tests show for a mode whose shape is mass-normalised, where it should be 1.

    The inertia force gets a factor of its own beside free linear and nonlinear terms. A shape that is s times too large
    gives 1/s^2, a force that is g times too large g.

    Args:
        lines: one a test.
        stiffness_order: of the nonlinear terms beside it.
        damping_order: likewise.
    """
    powers_k, powers_c = _powers(stiffness_order, True), _powers(damping_order, True)
    columns = [np.column_stack([each.inertia, _columns(each, powers_k, powers_c)]) for each in lines]
    whole = [replace(each, rest=each.force) for each in lines]
    found = _answer((0, *powers_k), powers_c, columns, whole, [1 / each.noise for each in lines], np.zeros(len(lines)))
    return found.stiffness()[0]


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


def _powers(order: int, free_linear: bool) -> tuple[int, ...]:
    if not 1 <= order <= HIGHEST_ORDER:
        raise InputError(f"the order is {order}: give 1 (linear) to {HIGHEST_ORDER}")
    return tuple(range(1 if free_linear else 2, order + 1))


def _columns(lines: ModeLines, powers_k: Sequence[int], powers_c: Sequence[int]) -> np.ndarray:
    return np.column_stack([lines.stiffness[:, [n - 1 for n in powers_k]], lines.damping[:, [n - 1 for n in powers_c]]])


def _solved(columns: Sequence[np.ndarray], lines: Sequence[ModeLines], weights: Sequence[FloatArray]) -> FloatArray:
    if columns[0].shape[1] == 0:
        return np.zeros(0)
    matrix, rest = _stacked(columns, lines, weights)
    scale = np.linalg.norm(matrix, axis=0)
    return np.linalg.lstsq(matrix / scale, rest, rcond=None)[0] / scale


def _stacked(
    columns: Sequence[np.ndarray], lines: Sequence[ModeLines], weights: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    matrix = np.concatenate([w[:, None] * c for c, w in zip(columns, weights, strict=True)])
    rest = np.concatenate([w * each.rest for each, w in zip(lines, weights, strict=True)])
    return np.concatenate([matrix.real, matrix.imag]), np.concatenate([rest.real, rest.imag])


def _beyond_noise(lines: ModeLines, columns: np.ndarray, value: FloatArray) -> float:
    """What a line misses beyond its noise, standard deviation; 0 where the noise explains the misfit."""
    misfit = np.abs(lines.rest - columns @ value) ** 2
    excess = float(np.mean(misfit) - np.mean(lines.noise**2))
    return float(np.sqrt(max(excess, 0.0)))


def _answer(
    powers_k: tuple[int, ...],
    powers_c: tuple[int, ...],
    columns: Sequence[np.ndarray],
    lines: Sequence[ModeLines],
    weights: Sequence[FloatArray],
    model_error: FloatArray,
) -> Coefficients:
    matrix, rest = _stacked(columns, lines, weights)
    scale = np.linalg.norm(matrix, axis=0)
    if not scale.all():
        raise InputError("a column of the fit is zero: the tests do not move the mode in its band")
    value = _solved(columns, lines, weights)
    scaled = matrix / scale
    condition = float(np.linalg.cond(scaled)) if scale.size else 1.0
    if condition > LARGEST_CONDITION:
        raise InputError(
            f"the columns of orders {max(powers_k, default=1)} (stiffness) and {max(powers_c, default=1)} (damping) are "
            f"copies of each other on these tests (condition {condition:.1g}): lower the orders, or add other levels"
        )
    residual = rest - matrix @ value
    raw = np.concatenate([c for c in columns])
    misfit = np.concatenate([each.rest - c @ value for each, c in zip(lines, columns, strict=True)])
    force = np.concatenate([each.force for each in lines])
    return Coefficients(
        powers_k,
        powers_c,
        value,
        _covariance(scaled, residual, [each.frequency_hz.size for each in lines]) / np.outer(scale, scale),
        float(np.linalg.cond(np.concatenate([raw.real, raw.imag]))) if scale.size else 1.0,
        condition,
        float(np.sqrt(np.mean(np.abs(misfit) ** 2) / np.mean(np.abs(force) ** 2))),
        model_error,
    )


def _covariance(matrix: FloatArray, residual: FloatArray, counts: Sequence[int]) -> FloatArray:
    """Sandwich over neighbouring lines: a model that misses the truth leaves a residual that is smooth over frequency."""
    n = sum(counts)
    bread = np.linalg.inv(matrix.T @ matrix)
    scores = matrix * residual[:, None]
    scores = scores[:n] + scores[n:]  # real and imaginary part of a line together
    meat = np.zeros_like(bread)
    for begin, count in zip(np.cumsum([0, *counts[:-1]]), counts, strict=True):
        own = scores[begin : begin + count]
        reach = max(1, round(count ** (1 / 3)))
        for lag in range(reach + 1):
            share = (1 if lag else 0.5) * (1 - lag / (reach + 1))  # Bartlett
            product = own[lag:].T @ own[: count - lag]
            meat += share * (product + product.T)
    freedom = max(2 * n - matrix.shape[1], 1)
    plain = float(residual @ residual) / freedom * bread
    sandwich = bread @ meat @ bread * (2 * n / freedom)
    # never below what white errors would give
    grow = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(plain), 1.0)) if matrix.shape[1] else np.ones(0)
    return plain * np.outer(grow, grow)
