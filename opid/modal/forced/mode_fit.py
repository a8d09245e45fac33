"""One mode from the tests that move it to its restoring force, with what it rests on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from opid.errors import InputError, refuse
from opid.estimate import Estimate
from opid.modal.doubts import doubts_of_fit
from opid.modal.forced.equation import ModeLines, mode_lines
from opid.modal.forced.mode_tests import WIDEST, band_of_mode, doubts_of_rates, doubts_of_test, faults_of_test
from opid.modal.forced.order_search import linear_is_off, search_orders
from opid.modal.forced.other_modes import doubts_of_other_modes
from opid.modal.forced.restoring_fit import Coefficients, fit_coefficients, linearised, modal_mass, power_curve
from opid.modal.forced.span import doubts_of_shapes, faults_of_shapes
from opid.modal.linear.modes import ModalTest
from opid.modal.linear.modes_file import looks_unit_normalised
from opid.modal.result import ForceCurve, ModeFit, OrderRung
from opid.signals.recording import FloatArray

N_CURVE = 101
"""Points of a force curve."""

ROUGH_ORDER = 3
"""Of the fit that shows how far the frequency of a mode moves."""

MASS_RANGE = (0.5, 2.0)
"""Modal mass that tests may show: outside, shapes or force are in another unit and nothing fitted would hold."""

UNITS = {
    "a force in lbf taken for N": 0.2248,
    "a force in kgf taken for N, or accelerations in m/s^2 taken for g,": 0.10197,
    "a force in kN taken for N": 0.001,
    "a force in N taken for lbf": 4.448,
    "accelerations in g taken for m/s^2": 9.80665,
    "a force in N taken for kN": 1000.0,
}
"""Mistakes and the modal mass that they show."""


def fit_mode(
    tests: Sequence[ModalTest],
    mode: int,
    *,
    stiffness_order: int | None = None,
    damping_order: int | None = None,
    free_linear: bool | None = None,
    band_hz: tuple[float, float] | None = None,
    taper_s: float = 0.0,
) -> ModeFit:
    """Fit the restoring force of one mode to the tests that move it.

    Args:
        tests: with forces, from rest until they have decayed.
        mode: number of the mode, from 1.
        stiffness_order: N_s, 1 to 5; chosen by cross-validation where None.
        damping_order: N_d likewise.
        free_linear: whether k0 and c0 are corrected; decided by the data where None.
        band_hz: lines to fit, Hz; where the tests have energy, up to most of the way to the neighbours, where None.
        taper_s: time over which the ends of every test are faded out, s: for records that do not begin and end at rest.

    Raises:
        InputError: no test, one that has not decayed or has no energy in the band, a modal mass that shapes and force
            cannot have, or orders too high for the tests.
    """
    if not tests:
        raise InputError(f'no test with use = "fit" moves mode {mode} more than the others: give one, or free decays')
    band = _band(tests, mode, taper_s) if band_hz is None else band_hz
    lines = [mode_lines(test, mode, band, taper_s=taper_s) for test in tests]
    pairs = list(zip(tests, lines, strict=True))
    refuse([fault for test, own in pairs for fault in faults_of_test(test, own, mode, band, taper_s)], None)
    refuse([fault for test in tests for fault in faults_of_shapes(test, mode, band)], None)
    mass = modal_mass(lines)
    _require_mass(mass, mode, tests[0])
    free = bool(free_linear)
    rungs = _orders(lines, stiffness_order, damping_order, free)
    if free_linear is None:
        orders = _chosen(rungs, stiffness_order, damping_order)
        free = linear_is_off(lines, stiffness_order=max(orders[0], 3), damping_order=max(orders[1], 3))
        if free:
            rungs = _orders(lines, stiffness_order, damping_order, free)
    n_s, n_d = _chosen(rungs, stiffness_order, damping_order)
    found = fit_coefficients(lines, stiffness_order=n_s, damping_order=n_d, free_linear=free)
    doubts = [doubt for test, own in pairs for doubt in doubts_of_test(test, own, mode, band, taper_s)]
    loudest, _ = max(pairs, key=lambda pair: pair[1].largest_q)
    doubts += doubts_of_rates(tests, mode)
    doubts += doubts_of_shapes(loudest, mode, band)
    doubts += doubts_of_other_modes(loudest, mode, band)
    return _mode_fit(mode, tests, lines, band, found, (n_s, n_d), free, mass, rungs, doubts)


def _band(tests: Sequence[ModalTest], mode: int, taper_s: float) -> tuple[float, float]:
    """The band in which the tests move the mode, and where its frequency goes at their largest amplitude."""
    low, high = band_of_mode(tests, mode)
    lines = [mode_lines(test, mode, (low, high), taper_s=taper_s) for test in tests]
    rough = fit_coefficients(lines, stiffness_order=ROUGH_ORDER, damping_order=ROUGH_ORDER)
    amplitude = np.array([max(each.largest_q for each in lines)])
    k0, c0 = lines[0].linear
    n_k = len(rough.powers_k)
    omega = np.sqrt(np.maximum(k0 + linearised(rough.powers_k, rough.value[:n_k], amplitude), 0.25 * k0))
    width = np.abs(c0 + linearised(rough.powers_c, rough.value[n_k:], omega * amplitude))
    begin, end = ((omega + sign * width).item() / (2 * np.pi) for sign in (-1, 1))
    natural = k0**0.5 / (2 * np.pi)
    return min(low, max(begin, WIDEST[0] * natural)), max(high, min(end, WIDEST[1] * natural))


def _mode_fit(
    mode: int,
    tests: Sequence[ModalTest],
    lines: Sequence[ModeLines],
    band: tuple[float, float],
    found: Coefficients,
    orders: tuple[int, int],
    free: bool,
    mass: Estimate,
    rungs: tuple[OrderRung, ...],
    doubts: Sequence[str],
) -> ModeFit:
    modes, place = tests[0].modes, mode - 1
    k0, c0 = float(modes.stiffness()[place]), float(modes.damping()[place])
    largest_q, largest_v = max(each.largest_q for each in lines), max(each.largest_v for each in lines)
    n_k = len(found.powers_k)
    value_k, value_c = found.value[:n_k], found.value[n_k:]
    curve_k = _curve(found.powers_k, value_k, found.covariance[:n_k, :n_k], largest_q, k0)
    curve_c = _curve(found.powers_c, value_c, found.covariance[n_k:, n_k:], largest_v, c0)
    stiffness = k0 + linearised(found.powers_k, value_k, curve_k.position)
    omega = np.sqrt(np.maximum(stiffness, 0.0))
    damping = c0 + linearised(found.powers_c, value_c, omega * curve_k.position)
    return ModeFit(
        mode=mode,
        frequency_hz=float(modes.frequency_hz[place]),
        damping_ratio=float(modes.damping_ratio[place]),
        stiffness_order=orders[0],
        damping_order=orders[1],
        free_linear=free,
        stiffness=found.stiffness(),
        damping=found.damping(),
        band_hz=band,
        n_lines=sum(each.frequency_hz.size for each in lines),
        tests=tuple(test.name for test in tests),
        residual_share=found.residual_share,
        condition_raw=found.condition_raw,
        condition_scaled=found.condition_scaled,
        modal_mass=mass,
        stiffness_curve=curve_k,
        damping_curve=curve_c,
        frequency_at_hz=omega / (2 * np.pi),
        damping_at=damping / np.maximum(2 * omega, 1e-300),
        orders=rungs,
        warnings=(*doubts, *doubts_of_fit(mode, mass, found, curve_k, curve_c)),
    )


def _curve(
    powers: tuple[int, ...], value: FloatArray, covariance: FloatArray, largest: float, linear: float
) -> ForceCurve:
    position = np.linspace(0.0, largest, N_CURVE)
    if not powers:
        zero = np.zeros(N_CURVE)
        return ForceCurve(position, zero, zero, zero, linear * position)
    # a corrected k0 moves the linear part, not the curve beside it
    columns = power_curve(powers, position)
    force = columns @ value
    half = 1.96 * np.sqrt(np.einsum("ij,jk,ik->i", columns, covariance, columns))
    corrected = linear + (value[0] if powers[0] == 1 else 0.0)
    return ForceCurve(position, force, force - half, force + half, corrected * position)


def _orders(
    lines: Sequence[ModeLines], stiffness_order: int | None, damping_order: int | None, free: bool
) -> tuple[OrderRung, ...]:
    if stiffness_order is not None and damping_order is not None:
        return ()
    return search_orders(lines, stiffness_order=stiffness_order, damping_order=damping_order, free_linear=free)


def _chosen(rungs: Sequence[OrderRung], stiffness_order: int | None, damping_order: int | None) -> tuple[int, int]:
    for rung in rungs:
        if rung.chosen:
            return rung.stiffness_order, rung.damping_order
    return stiffness_order or 1, damping_order or 1


def _require_mass(mass: Estimate, mode: int, test: ModalTest) -> None:
    value, std = float(mass.value or 0.0), float(mass.std or 0.0)
    if MASS_RANGE[0] <= value <= MASS_RANGE[1] or abs(value - 1) < 4 * std:
        return
    if value < 0:
        raise InputError(
            f"the tests show a modal mass of {value:.3g}: force and accelerations have opposite signs, or sensors are "
            "exchanged; give sign = -1 for the force, or for all accelerations, in [channels]"
        )
    unit = next((name for name, factor in UNITS.items() if abs(value / factor - 1) < 0.05), "")
    looks = looks_unit_normalised(test.modes)
    guess = (f" (as {unit} would give)" if unit else "") + (f" ({looks})" if looks else "")
    raise InputError(
        f"the tests show a modal mass of {value:.3g} where mass-normalised shapes and a force in N give 1{guess}: "
        f"check the unit and scale of the force, or multiply the shape of mode {mode} by {abs(value) ** -0.5:.4g}"
    )
