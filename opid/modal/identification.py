"""From a modal study to the nonlinear modal model (Pacini Fig. 4), with what it rests on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.estimate import Estimate
from opid.modal.coordinates import ModalTest
from opid.modal.equation import ModeLines, mode_lines
from opid.modal.free_decay import Decay
from opid.modal.level_shifts import LevelShift, level_shifts, nonlinear_modes
from opid.modal.mode_tests import band_of_mode, doubts_of_test, faults_of_test, tests_of_mode
from opid.modal.model import NonlinearModalModel
from opid.modal.modes import LARGEST_CONDITION, LinearModes, condition_number, modal_assurance
from opid.modal.order_search import linear_is_off, search_orders
from opid.modal.restoring_fit import (
    MOST_OF_CURVE,
    N_CURVE,
    Coefficients,
    fit_coefficients,
    linearised,
    modal_mass,
    power_curve,
)
from opid.modal.result import ForceCurve, ModalIdentification, ModeFit, OrderRung, TruthTest
from opid.modal.study import ModalStudy
from opid.modal.truth_test import truth_test
from opid.signals.recording import FloatArray
from opid.signals.tables import refuse

Say = Callable[[str], None]

MASS_RANGE = (0.5, 2.0)
"""Modal mass that tests may show: outside, shapes or force are in another unit and nothing fitted would hold."""

WARNED_MASS = 0.05
"""Departure of the modal mass from 1 that is told."""

BEYOND = 1.1
"""Times the largest amplitude fitted: a truth test that goes further asks the polynomials to extrapolate."""

UNITS_OF_FORCE = {
    "lbf taken for N": 0.2248,
    "kgf taken for N": 0.10197,
    "kN taken for N": 0.001,
    "N taken for lbf": 4.448,
}


def identify_modes(study: ModalStudy, *, progress: Say | None = None) -> ModalIdentification:
    """Identify the nonlinear modal model of a structure and try it on the truth tests.

    Each nonlinear mode is fitted by itself to the tests that move it, in its band (`fit_coefficients`); free decays give
    the law of a mode that no forced test moves. The modes together, with their laws, are the model.

    Args:
        study: linear modes, which are nonlinear, and the tests.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: shapes that cannot filter modes, or tests that cannot be used; everything is said at once.
        NotDeterminedError: no mode is named as nonlinear and the level tests show none.
    """
    say = progress or (lambda step: None)
    shifts = _shifts(study, say)
    nonlinear = study.nonlinear or nonlinear_modes(shifts)
    if not nonlinear:
        raise NotDeterminedError(_nothing_nonlinear(shifts))
    study = replace(study, nonlinear=nonlinear)
    decays, of_decays, doubts = _decays(study, say)
    fits, faults = [], []
    for mode in nonlinear:
        say(f"mode {mode}")
        tests = tests_of_mode(study.of_use("fit"), mode, nonlinear)
        if not tests and mode in of_decays:
            continue
        try:
            fits.append(fit_mode(tests, mode, **_settings(study)))
        except InputError as error:
            faults.append(f"mode {mode}: {error}")
    refuse(faults, study.source)
    model = _model(study.modes, fits, of_decays)
    truth_tests, unstable = _truth_tests(study, fits, of_decays, say)
    return ModalIdentification(
        title=study.title,
        modes=study.modes,
        drive_point=study.drive_point,
        tests=tuple(each.test for each in study.tests),
        fits=tuple(fits),
        model=model,
        truth_tests=truth_tests,
        decays=decays,
        shifts=shifts,
        condition_number=condition_number(study.modes),
        auto_mac=modal_assurance(study.modes.shapes),
        warnings=(*_doubts_of_modes(study.modes), *doubts, *_beyond(study, fits), *unstable),
        not_determined="",
        settings=_settings(study) | {"nonlinear": list(nonlinear), "study": str(study.source or "")},
    )


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
        band_hz: lines to fit, Hz; where the tests have energy, up to half-way to the neighbours, where None.
        taper_s: time over which the ends of every test are faded out, s: for records that do not begin and end at rest.

    Raises:
        InputError: no test, one that has not decayed or has no energy in the band, a modal mass that shapes and force
            cannot have, or orders too high for the tests.
    """
    if not tests:
        raise InputError(f"no test moves mode {mode}: give one that does, or name it with mode = {mode}")
    band = band_of_mode(tests, mode) if band_hz is None else band_hz
    lines = [mode_lines(test, mode, band, taper_s=taper_s) for test in tests]
    pairs = list(zip(tests, lines, strict=True))
    refuse([fault for test, own in pairs for fault in faults_of_test(test, own, mode, band, taper_s)], None)
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
    return _mode_fit(mode, tests, lines, band, found, (n_s, n_d), free, mass, rungs, doubts)


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
        warnings=(*doubts, *_doubts_of_fit(mode, mass, found, curve_k, curve_c)),
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
    unit = next((name for name, factor in UNITS_OF_FORCE.items() if abs(value / factor - 1) < 0.1), "")
    guess = f" (as {unit} would give)" if unit else ""
    raise InputError(
        f"the tests show a modal mass of {value:.3g} where mass-normalised shapes and a force in N give 1{guess}: check the "
        f"unit and scale of the force, or multiply the shape of mode {mode} by {abs(value) ** 0.5:.4g}"
    )


def _doubts_of_fit(
    mode: int, mass: Estimate, found: Coefficients, curve_k: ForceCurve, curve_c: ForceCurve
) -> Iterator[str]:
    value, std = float(mass.value or 0.0), float(mass.std or 0.0)
    if abs(value - 1) > max(WARNED_MASS, 4 * std):
        yield (
            f"mode {mode}: the tests show a modal mass of {value:.3f} +- {std:.3f} where 1 is expected: the scale of its shape "
            "or of the force is off, and with it the amplitudes"
        )
    for word, curve in (("stiffness", curve_k), ("damping", curve_c)):
        half = 0.5 * (curve.high[-1] - curve.low[-1])
        if curve.force.any() and half > MOST_OF_CURVE * np.abs(curve.force).max():
            yield (
                f"mode {mode}: the nonlinear {word} force is known to +-{100 * half / np.abs(curve.force).max():.0f} % at the "
                f"largest amplitude: the data cannot tell it, lower {word}_order or test at higher levels"
            )
    tangent = np.gradient(curve_k.linear + curve_k.force, curve_k.position)
    if (tangent <= 0).any():
        yield f"mode {mode}: the fitted spring has no positive stiffness at the largest amplitude: do not go beyond it"
    if found.residual_share > 0.5:
        yield (
            f"mode {mode}: the fit leaves {100 * found.residual_share:.0f} % of the modal force unexplained: the mode is not "
            "alone in its band, or its linear properties belong to another state of the structure"
        )


def _doubts_of_modes(modes: LinearModes) -> Iterator[str]:
    from opid.modal.modes_file import looks_unit_normalised

    condition = condition_number(modes)
    if condition > LARGEST_CONDITION:
        yield (
            f"the shapes have the condition number {condition:.0f} (9 is good): noise and errors of the shapes grow by as much "
            "in the modal filter; add sensors or leave out modes"
        )
    looks = looks_unit_normalised(modes)
    if looks:
        yield f"the shapes do not look mass-normalised: {looks}"


def _settings(study: ModalStudy) -> dict[str, Any]:
    return {
        "stiffness_order": study.stiffness_order,
        "damping_order": study.damping_order,
        "free_linear": study.free_linear,
    }


def _shifts(study: ModalStudy, say: Say) -> tuple[LevelShift, ...]:
    tests = [each.test for each in study.of_use("level")]
    if len(tests) < 2:
        return ()
    say("levels")
    return level_shifts(tests)


def _nothing_nonlinear(shifts: Sequence[LevelShift]) -> str:
    if not shifts:
        return 'no mode is named as nonlinear: name some (nonlinear = [7, 11]), or give two tests with use = "level"'
    return (
        f"none of {len(shifts)} modes shifts with the level beyond its thresholds: the structure is linear at these levels; "
        "excite it harder, or name the modes to fit (nonlinear = [7, 11])"
    )


def _decays(study: ModalStudy, say: Say) -> tuple[tuple[Decay, ...], Mapping[int, Decay], list[str]]:
    return (), {}, []


def _model(modes: LinearModes, fits: Sequence[ModeFit], of_decays: Mapping[int, Decay]) -> NonlinearModalModel:
    """The modes with their laws; corrections of k0 and c0 move frequency and damping of the mode."""
    frequency, damping = modes.frequency_hz.copy(), modes.damping_ratio.copy()
    laws = {fit.mode: fit.law for fit in fits}
    for fit in fits:
        k1, c1 = (float(each[1].value or 0.0) if 1 in each else 0.0 for each in (fit.stiffness, fit.damping))
        place = fit.mode - 1
        if not k1 and not c1:
            continue
        stiffness = modes.stiffness()[place] + k1
        omega = np.sqrt(max(stiffness, 0.0))
        frequency[place] = omega / (2 * np.pi)
        damping[place] = (modes.damping()[place] + c1) / (2 * omega)
    return NonlinearModalModel(replace(modes, frequency_hz=frequency, damping_ratio=damping), laws)


def _truth_tests(
    study: ModalStudy, fits: Sequence[ModeFit], of_decays: Mapping[int, Decay], say: Say
) -> tuple[tuple[TruthTest, ...], list[str]]:
    done, unstable = [], []
    for each in study.of_use("truth"):
        say(f"truth test {each.test.name}")
        try:
            done.append(truth_test(_model(each.test.modes, fits, of_decays), each.test))
        except InputError as error:
            unstable.append(str(error))
    return tuple(done), unstable


def _beyond(study: ModalStudy, fits: Sequence[ModeFit]) -> Iterator[str]:
    for each in study.of_use("truth"):
        for fit in fits:
            largest = mode_lines(each.test, fit.mode, fit.band_hz).largest_q
            fitted = fit.stiffness_curve.position[-1]
            if largest > BEYOND * fitted:
                yield (
                    f"truth test {each.test.name!r} moves mode {fit.mode} {largest / fitted:.2g} times as far as the tests it was "
                    "fitted to: there its force is an extrapolation"
                )
