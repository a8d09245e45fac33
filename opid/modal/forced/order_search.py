"""How many powers a mode needs: cross-validation over tests, or over lines where there are few tests."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from opid.errors import InputError
from opid.modal.forced.equation import ComplexArray, ModeLines
from opid.modal.forced.equation_noise import line_noise
from opid.modal.forced.restoring_fit import fit_coefficients, powers, solution
from opid.modal.power_laws import HIGHEST_ORDER
from opid.modal.result import OrderRung
from opid.signals.recording import FloatArray

PARSIMONY = 0.01
"""Of the error: what a further power must win on tests that were left out."""

N_BLOCKS = 5
"""Parts of a band that are left out in turn where there are fewer than three tests."""


def search_orders(
    lines: Sequence[ModeLines],
    *,
    stiffness_order: int | None = None,
    damping_order: int | None = None,
    free_linear: bool = False,
) -> tuple[OrderRung, ...]:
    """Return every pair of orders with its error on what was left out; one is chosen.

    With three tests and more each is left out in turn, except that with the largest motion: beyond it no polynomial
    can be asked. With fewer, interleaved blocks of lines are left out. The fewest powers are chosen whose
    error is within one standard error and 1 % of the least one.

    Args:
        lines: one a test.
        stiffness_order: N_s, if it is given.
        damping_order: N_d, if it is given.
        free_linear: whether k0 and c0 are corrected.

    Raises:
        InputError: no pair of orders can be fitted.
    """
    folds = _folds(lines)
    errors: dict[tuple[int, int], np.ndarray] = {}
    for n_s in _orders(stiffness_order):
        for n_d in _orders(damping_order):
            try:
                errors[n_s, n_d] = np.array([_left_out(kept, out, n_s, n_d, free_linear) for kept, out in folds])
            except InputError:
                continue  # too many for what is kept
    if not errors:
        raise InputError("no order can be fitted to so few lines: give longer or more tests")
    mean = {orders: float(np.sqrt(np.mean(each**2))) for orders, each in errors.items()}
    best = min(mean, key=lambda orders: (mean[orders], sum(orders)))
    root = len(folds) ** 0.5
    # from fold to fold, against the best: what all folds share does not count
    within = {
        orders: mean[orders] <= (1 + PARSIMONY) * mean[best] + float(np.std(each - errors[best], ddof=1)) / root
        for orders, each in errors.items()
    }
    chosen = min((orders for orders, near in within.items() if near), key=lambda o: (sum(o), mean[o]))
    return tuple(
        OrderRung(*orders, mean[orders], float(np.std(each, ddof=1)) / root, orders == chosen)
        for orders, each in errors.items()
    )


def linear_is_off(lines: Sequence[ModeLines], *, stiffness_order: int, damping_order: int) -> bool:
    """Whether the tests demand that k0 and c0 be corrected (Bayesian information criterion, two parameters).

    Args:
        lines: one a test.
        stiffness_order: N_s.
        damping_order: N_d.
    """
    orders = {"stiffness_order": stiffness_order, "damping_order": damping_order}
    fixed, free = (fit_coefficients(lines, **orders, free_linear=word) for word in (False, True))
    # both judged by the weights of the freer one
    noise = list(free.noise)
    chi2 = [
        sum(
            float(np.sum(np.abs(misfit(each, fit.powers_k, fit.powers_c, fit.value) / n) ** 2))
            for each, n in zip(lines, noise, strict=True)
        )
        for fit in (fixed, free)
    ]
    n_lines = sum(each.frequency_hz.size for each in lines)
    gain = 2 * (chi2[0] - chi2[1]) / max(chi2[1] / n_lines, 1e-300)
    return gain > 2 * np.log(2 * n_lines)


def misfit(lines: ModeLines, powers_k: Sequence[int], powers_c: Sequence[int], value: FloatArray) -> ComplexArray:
    """Return what coefficients leave of the equation, (m,) complex.

    Args:
        lines: of one test.
        powers_k: powers of the displacement.
        powers_c: powers of the velocity.
        value: the coefficients k_n, then c_n.
    """
    n_k = len(powers_k)
    of_k = lines.stiffness[:, [n - 1 for n in powers_k]] @ value[:n_k]
    return lines.rest - of_k - lines.damping[:, [n - 1 for n in powers_c]] @ value[n_k:]


def _orders(given: int | None) -> Sequence[int]:
    return range(1, HIGHEST_ORDER + 1) if given is None else (given,)


def _folds(lines: Sequence[ModeLines]) -> list[tuple[list[ModeLines], list[ModeLines]]]:
    if len(lines) >= 3:
        top = max(lines, key=lambda each: each.largest_q)
        return [([o for o in lines if o is not each], [each]) for each in lines if each is not top]
    folds = []
    for block in range(N_BLOCKS):
        out = [np.arange(each.frequency_hz.size) // 3 % N_BLOCKS == block for each in lines]
        folds.append(
            (
                [each.only(~taken) for each, taken in zip(lines, out, strict=True)],
                [each.only(taken) for each, taken in zip(lines, out, strict=True)],
            )
        )
    return folds


def _left_out(kept: Sequence[ModeLines], out: Sequence[ModeLines], n_s: int, n_d: int, free_linear: bool) -> float:
    """Misfit of what was left out over its modal force, in lines weighted by their noise."""
    powers_k, powers_c = powers(n_s, free_linear), powers(n_d, free_linear)
    value = solution(kept, powers_k, powers_c)
    noise = [line_noise(each, powers_k, powers_c, value) for each in out]
    left = [misfit(each, powers_k, powers_c, value) for each in out]
    above = sum(float(np.sum(np.abs(each / n) ** 2)) for each, n in zip(left, noise, strict=True))
    below = sum(float(np.sum(np.abs(each.force / n) ** 2)) for each, n in zip(out, noise, strict=True))
    return float(np.sqrt(above / below))
