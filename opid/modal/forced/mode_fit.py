"""The restoring force of one mode, from the tests that move it, with force curves and warnings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np

from opid.errors import InputError, refuse
from opid.estimate import Estimate
from opid.mechanics.laws.law import Law
from opid.modal.forced.equation import ModeLines, find_line_noise, mode_lines
from opid.modal.forced.mode_tests import (
    Interaction,
    check_shapes,
    check_test,
    find_band,
    find_interactions,
    warn_of_rates,
)
from opid.modal.forced.restoring_fit import (
    Coefficients,
    OrderRung,
    add_delay_error,
    add_gain_error,
    add_model_error,
    add_scale_error,
    correct_delay,
    find_common_gain,
    fit_coefficients,
    fit_delay,
    fit_modal_mass,
    is_linear_part_off,
    linearised,
    search_orders,
)
from opid.modal.joint_terms import ABSENT, JointEstimates, ModalJoint
from opid.modal.linear.modes import ModalTest
from opid.modal.linear.modes_file import looks_unit_normalised
from opid.modal.power_laws import coefficients_json, make_fitted_law, withhold_negative
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray

N_CURVE = 101  # points of a force curve

UNITS = {
    "a force in lbf taken for N": 0.2248,
    "a force in kgf taken for N, or accelerations in m/s^2 taken for g,": 0.10197,
    "a force in kN taken for N": 0.001,
    "a force in N taken for lbf": 4.448,
    "accelerations in g taken for m/s^2": 9.80665,
    "a force in N taken for kN": 1000.0,
}
"""Mistakes of units, and the modal mass that each of them makes."""


@dataclass(frozen=True, eq=False)
class ForceCurve:
    """The nonlinear part of a modal restoring force over displacement or velocity, with its 95 % band.

    Args:
        position: (n,) q, m kg^1/2, or q', m/s kg^1/2, from 0 to the largest value of the tests.
        force: (n,) nonlinear part of the force, N/kg^1/2.
        low: (n,) lower end of the band, N/kg^1/2.
        high: (n,) upper end of the band, N/kg^1/2.
        linear: (n,) linear part of the force, k0 q or c0 q', N/kg^1/2.
    """

    position: FloatArray
    force: FloatArray
    low: FloatArray
    high: FloatArray
    linear: FloatArray

    def as_json(self, along: str) -> dict[str, Any]:
        """Return the curve as result.json holds it; `along` is the name of its positions."""
        return {along if each.name == "position" else each.name: getattr(self, each.name) for each in fields(self)}


@dataclass(frozen=True, eq=False)
class ModeFit:
    """The restoring force of one mode.

    Args:
        mode: number of the mode, from 1.
        frequency_hz: linear natural frequency as given, Hz.
        damping_ratio: linear damping ratio as given.
        stiffness_order: N_s.
        damping_order: N_d.
        free_linear: whether k0 and c0 were corrected (the powers 1).
        stiffness: k_n by its power n, (N/kg^1/2) / (m kg^1/2)^n; 1 is the correction of k0.
        damping: c_n by its power n, (N/kg^1/2) / (m/s kg^1/2)^n; 1 is the correction of c0.
        band_hz: band of the lines that were fitted, Hz.
        n_lines: number of these lines in all tests.
        tests: names of the tests.
        residual_fraction: rms of the misfit over that of the modal force, in the band; of the motion over the motion
            where the law was fitted by simulation.
        condition_raw: condition number of the columns as they are.
        condition_scaled: condition number of the columns scaled to unit norm, as they are solved.
        modal_mass: mass that the tests show for the mode, 1 where shapes and force are in order.
        stiffness_curve: nonlinear stiffness force over displacement.
        damping_curve: nonlinear damping force over velocity; slip and joints, whose force has a memory, count as the
            force of the velocity that loses as much (`JointTerms.find_loss_force`).
        frequency_at_hz: natural frequency at the amplitudes of `stiffness_curve`, Hz (harmonic linearisation).
        damping_at: damping ratio at the same amplitudes.
        orders: the orders that were tried, if they were searched.
        delay_s: time by which the accelerations come after the forces, s, which the fit corrects where the data show it
            (`correct_delay`); its interval also holds the phase of neighbours that leak through the modal filter.
        joint_estimates: friction and the joint with memory, found by simulation.
        interactions: modes that this one drives.
        misfit: rms of the misfit over what noise alone would leave, of the motion where the law was fitted by
            simulation; 1 where the law is the true one.
        warnings: one sentence for each warning about the fit.
    """

    mode: int
    frequency_hz: float
    damping_ratio: float
    stiffness_order: int
    damping_order: int
    free_linear: bool
    stiffness: Mapping[int, Estimate]
    damping: Mapping[int, Estimate]
    band_hz: tuple[float, float]
    n_lines: int
    tests: tuple[str, ...]
    residual_fraction: float
    condition_raw: float
    condition_scaled: float
    modal_mass: Estimate
    stiffness_curve: ForceCurve
    damping_curve: ForceCurve
    frequency_at_hz: FloatArray
    damping_at: FloatArray
    orders: tuple[OrderRung, ...]
    interactions: tuple[Interaction, ...]
    misfit: float
    warnings: tuple[str, ...]
    joint_estimates: JointEstimates = field(default_factory=JointEstimates)
    delay_s: Estimate = ABSENT

    @property
    def is_delayed(self) -> bool:
        """Whether the accelerations come before or after the forces beyond doubt."""
        return is_delay_sure(self.delay_s)

    @property
    def joint(self) -> ModalJoint:
        """The joint, ready to be simulated."""
        return self.joint_estimates.make(float(self.stiffness_curve.position[-1]))

    @property
    def law(self) -> Law:
        """The nonlinear restoring force, powers 2 and up."""
        return make_fitted_law(self.stiffness, self.damping)

    def as_json(self) -> dict[str, Any]:
        """Return the fit as result.json holds it; `k` and `c` by power, as the paper calls them."""
        arranged = (
            *("stiffness", "damping", "stiffness_curve", "damping_curve"),
            *("residual_fraction", "modal_mass", "orders", "interactions", "delay_s"),
            "joint_estimates",
        )
        return {
            **{each.name: getattr(self, each.name) for each in fields(self) if each.name not in arranged},
            "residual_share": self.residual_fraction,
            "known_by": "forced tests",
            **coefficients_json(self.stiffness, self.damping),
            **self.joint_estimates.as_json("joint_"),
            "modal_mass": asdict(self.modal_mass),
            "delay_s": asdict(self.delay_s),
            "force_curves": {
                "stiffness": self.stiffness_curve.as_json("displacement"),
                "damping": self.damping_curve.as_json("velocity"),
            },
            "orders": [asdict(rung) for rung in self.orders],
            "interactions": [asdict(each) for each in self.interactions],
        }


def fit_mode(
    tests: Sequence[ModalTest],
    mode: int,
    *,
    stiffness_order: int | None = None,
    damping_order: int | None = None,
    free_linear: bool | None = None,
    band_hz: tuple[float, float] | None = None,
    taper_s: float = 0.0,
    gain_tolerance: float = MODAL.gain_tolerance,
) -> ModeFit:
    """Fit the restoring force of one mode to the tests that move it.

    Args:
        tests: tests with forces, from rest until the motion has decayed.
        mode: number of the mode, from 1.
        stiffness_order: N_s, 1 to 5; chosen by cross-validation where None.
        damping_order: N_d, 1 to 5; chosen by cross-validation where None.
        free_linear: whether k0 and c0 are corrected; the data decide where None.
        band_hz: band of the lines to fit, Hz; where None, that in which the tests have energy, away from neighbours.
        taper_s: time over which the ends of every test are faded out, s: for records that do not begin and end at rest.
        gain_tolerance: standard deviation of the gains of force and accelerations by their calibration, as a fraction,
            which the intervals of the powers above 1 hold; 0 for exact ones.

    Raises:
        InputError: no test, one that has not decayed or has no energy in the band, a modal mass that shapes and force
            cannot have, or orders too high for the tests.
    """
    if not tests:
        raise InputError(
            f'no test with use = "fit" moves mode {mode} more than the other modes: give one, or free decays of it'
        )
    if idle := [test.name for test in tests if not test.modal_force(mode).any()]:
        raise InputError(
            f"no force of the test {idle[0]!r} drives mode {mode}: the force is zero, or the shape of the mode is zero "
            "at the drive point; drive the mode elsewhere, or leave the test out"
        )
    band = _choose_band(tests, mode, taper_s) if band_hz is None else band_hz
    lines = [mode_lines(test, mode, band, taper_s=taper_s) for test in tests]
    checks = [check_test(test, own, mode, band, taper_s) for test, own in zip(tests, lines, strict=True)]
    refuse([fault for faults, _ in checks for fault in faults], None)
    of_shapes = [check_shapes(test, mode, band, gain_tolerance=gain_tolerance) for test in tests]
    refuse([fault for each in of_shapes for fault in each.faults], None)
    delay = fit_delay(lines)
    lines, delay_left_s = correct_delay(lines, delay)
    mass = fit_modal_mass(lines)
    _require_mass(mass, mode, tests[0])

    given = {"stiffness_order": stiffness_order, "damping_order": damping_order}
    free = bool(free_linear)
    tried, chosen = _choose_orders(lines, given, free)
    if free_linear is None and is_linear_part_off(lines, **{name: max(order, 3) for name, order in chosen.items()}):
        free = True
        tried, chosen = _choose_orders(lines, given, free)
    found = fit_coefficients(lines, **chosen, free_linear=free)
    misfit = _find_misfit(lines, found)
    found = add_model_error(add_scale_error(found, lines, mass), lines, misfit)
    found = add_delay_error(found, lines, delay_left_s)
    found = add_gain_error(found, find_common_gain(gain_tolerance))
    fit = replace(
        _make_mode_fit(tests, mode, lines, band, found, mass, tried), delay_s=widen_delay(delay, lines[0].linear[0])
    )
    loudest = int(np.argmax([each.largest_q for each in lines]))
    warnings = [warning for _, of_test in checks for warning in of_test]
    warnings += warn_of_rates(tests, mode)
    warnings += of_shapes[loudest].warnings
    interactions = tuple(find_interactions(tests[loudest], mode, band))
    warnings += [each.sentence for each in interactions]
    return replace(fit, interactions=interactions, warnings=(*warnings, *warn_of_fit(fit)))


def is_delay_sure(delay: Estimate) -> bool:
    """Return whether a delay differs from zero beyond doubt."""
    return abs(delay.value or 0.0) > MODAL.delay_sigma * (delay.std or 0.0)


def widen_delay(delay: Estimate, stiffness: float) -> Estimate:
    """Return a delay whose interval holds the phase that neighbours make as they leak through the modal filter.

    Args:
        delay: the delay, s.
        stiffness: k0 of the mode, 1/s^2.
    """
    if delay.value is None:
        return delay
    leaks_s = MODAL.delay_phase_std / np.sqrt(stiffness)
    return Estimate.normal(delay.value, float(np.hypot(delay.std or 0.0, leaks_s)))


def _choose_orders(
    lines: Sequence[ModeLines], given: Mapping[str, int | None], free: bool
) -> tuple[tuple[OrderRung, ...], dict[str, int]]:
    """Return the pairs of orders that were tried, none where both are given, and the pair that was chosen."""
    chosen = {name: order for name, order in given.items() if order is not None}
    tried = () if len(chosen) == 2 else search_orders(lines, **chosen, free_linear=free)
    for rung in tried:
        if rung.chosen:
            chosen = {"stiffness_order": rung.stiffness_order, "damping_order": rung.damping_order}
    return tried, chosen


def _make_mode_fit(
    tests: Sequence[ModalTest],
    mode: int,
    lines: Sequence[ModeLines],
    band: tuple[float, float],
    found: Coefficients,
    mass: Estimate,
    tried: tuple[OrderRung, ...],
) -> ModeFit:
    modes, index = tests[0].modes, tests[0].modes.index(mode)
    (k0, c0), powers, n_k = lines[0].linear, found.powers, len(found.powers.k)
    value_k, value_c = found.value[:n_k], found.value[n_k:]
    largest_q, largest_v = max(each.largest_q for each in lines), max(each.largest_v for each in lines)
    curve_k = _make_curve(powers.k, value_k, found.covariance[:n_k, :n_k], largest_q, k0)
    curve_c = _make_curve(powers.c, value_c, found.covariance[n_k:, n_k:], largest_v, c0)
    omega, damping = _linearise_at(found, (k0, c0), curve_k.position, 0.0)
    return ModeFit(
        mode=mode,
        frequency_hz=float(modes.frequency_hz[index]),
        damping_ratio=float(modes.damping_ratio[index]),
        stiffness_order=powers.orders[0],
        damping_order=powers.orders[1],
        free_linear=1 in powers.k,
        stiffness=withhold_negative(found.stiffness(), k0),
        damping=withhold_negative(found.damping(), c0),
        band_hz=band,
        n_lines=sum(each.frequency_hz.size for each in lines),
        tests=tuple(test.name for test in tests),
        residual_fraction=found.residual_fraction,
        condition_raw=found.condition_raw,
        condition_scaled=found.condition_scaled,
        modal_mass=mass,
        stiffness_curve=curve_k,
        damping_curve=curve_c,
        frequency_at_hz=omega / (2 * np.pi),
        damping_at=damping / np.maximum(2 * omega, 1e-300),
        orders=tried,
        interactions=(),
        misfit=_find_misfit(lines, found),
        warnings=(),
    )


def _find_misfit(lines: Sequence[ModeLines], found: Coefficients) -> float:
    """Return the rms of the misfit over the noise of each line."""
    left = [found.powers.misfit(each, found.value) / find_line_noise(each, found.powers, found.value) for each in lines]
    return float(np.sqrt(np.mean(np.abs(np.concatenate(left)) ** 2)))


def _choose_band(tests: Sequence[ModalTest], mode: int, taper_s: float) -> tuple[float, float]:
    """Return the band in which the tests move the mode, with its frequency at their largest amplitude inside."""
    low, high = find_band(tests, mode)
    lines = [mode_lines(test, mode, (low, high), taper_s=taper_s) for test in tests]
    # Orders of 3 show how far the frequency of a mode moves.
    rough = fit_coefficients(lines, stiffness_order=3, damping_order=3)
    amplitude = np.array([max(each.largest_q for each in lines)])
    k0, c0 = lines[0].linear
    omega, damping = _linearise_at(rough, (k0, c0), amplitude, 0.25 * k0)
    width = np.abs(damping)
    begin, end = ((omega + sign * width).item() / (2 * np.pi) for sign in (-1, 1))
    natural = k0**0.5 / (2 * np.pi)
    return min(low, max(begin, MODAL.widest_band[0] * natural)), max(high, min(end, MODAL.widest_band[1] * natural))


def _linearise_at(
    found: Coefficients, linear: tuple[float, float], amplitude: FloatArray, least: float
) -> tuple[FloatArray, FloatArray]:
    """Return natural frequency, rad/s, and c = 2 zeta omega at displacement amplitudes; omega^2 is `least` or more."""
    powers, n_k = found.powers, len(found.powers.k)
    omega = np.sqrt(np.maximum(linear[0] + linearised(powers.k, found.value[:n_k], amplitude), least))
    return omega, linear[1] + linearised(powers.c, found.value[n_k:], omega * amplitude)


def _make_curve(
    powers: tuple[int, ...], value: FloatArray, covariance: FloatArray, largest: float, linear: float
) -> ForceCurve:
    """Return the nonlinear force; a correction of k0 or c0 changes the linear part only."""
    position = np.linspace(0.0, largest, N_CURVE)
    columns = np.stack([(n > 1) * position**n for n in powers], axis=1) if powers else np.zeros((N_CURVE, 0))
    force = columns @ value
    half = 1.96 * np.sqrt(np.einsum("ij,jk,ik->i", columns, covariance, columns))
    corrected = linear + (value[0] if powers[:1] == (1,) else 0.0)
    return ForceCurve(position, force, force - half, force + half, corrected * position)


def warn_of_fit(fit: ModeFit) -> Iterator[str]:
    """Yield warnings about the law of a mode: its modal mass, the width of its force curves, and what it leaves."""
    value, std = float(fit.modal_mass.value or 0.0), float(fit.modal_mass.std or 0.0)
    if abs(value - 1) > max(MODAL.warned_mass, 4 * std):
        yield (
            f"mode {fit.mode}: the tests show a modal mass of {value:.3g} (standard deviation {std:.1g}) where it must "
            "be 1: the amplitudes are wrong, too; check the scale of its shape and of the force, and the drive point"
        )
    if fit.is_delayed:
        late_s, std_s = float(fit.delay_s.value or 0.0), float(fit.delay_s.std or 0.0)
        side = "after" if late_s > 0 else "before"
        yield (
            f"mode {fit.mode}: the accelerations come {1e6 * abs(late_s):.3g} µs {side} the forces (standard deviation "
            f"{1e6 * std_s:.2g} µs), which the fit corrects: look for a filter in one of the channels, or for two "
            "recorders"
        )
    for word, curve in (("stiffness", fit.stiffness_curve), ("damping", fit.damping_curve)):
        largest = np.abs(curve.force).max()
        half = 0.5 * (curve.high[-1] - curve.low[-1]) / largest if largest else 0.0
        if half > MODAL.widest_force:
            yield (
                f"mode {fit.mode}: the nonlinear {word} force is {100 * half:.0f} % uncertain at the largest "
                f"amplitude (half of its 95 % interval): the data cannot determine it, lower {word}_order or test at "
                "higher levels"
            )
    spring = fit.stiffness_curve
    if (np.gradient(spring.linear + spring.force, spring.position) <= 0).any():
        yield (
            f"mode {fit.mode}: the fitted stiffness falls to zero or below at the largest amplitude: do not use the "
            "model beyond it"
        )
    damper = fit.damping_curve
    if (damper.linear + damper.high < 0)[1:].any():
        yield (
            f"mode {fit.mode}: the fitted damping is negative, which no structure without a source of energy has: do "
            "not use the model, and see whether force and accelerations have their signs and no delay"
        )
    if fit.misfit > MODAL.most_misfit:
        yield (
            f"mode {fit.mode}: the law misses the tests by {fit.misfit:.2g} standard deviations of their noise, so its "
            "intervals hold how far the answers differ that leave out a part of the tests: look for a sensor of "
            "another gain, sign or unit, for another mode near, and for a linear state that moved between the tests"
        )
    if fit.residual_fraction > MODAL.most_unexplained:
        yield (
            f"mode {fit.mode}: the fit leaves {100 * fit.residual_fraction:.0f} % of the modal force unexplained: the "
            "mode is not alone in its band, or its linear properties belong to another state of the structure; check "
            "both"
        )


def _require_mass(mass: Estimate, mode: int, test: ModalTest) -> None:
    value, std = float(mass.value or 0.0), float(mass.std or 0.0)
    if MODAL.mass_range[0] <= value <= MODAL.mass_range[1] or abs(value - 1) < 4 * std:
        return
    if value < 0:
        raise InputError(
            f"the tests show a modal mass of {value:.3g}: force and accelerations have opposite signs, or sensors are "
            "exchanged; give sign = -1 for the force, or for all accelerations, in [channels]"
        )
    unit = next((name for name, factor in UNITS.items() if abs(value / factor - 1) < 0.05), "")
    looks = looks_unit_normalised(test.modes)
    guess = (f" ({unit} would give this)" if unit else "") + (f" ({looks})" if looks else "")
    raise InputError(
        f"the tests show a modal mass of {value:.3g} where mass-normalised shapes and a force in N give 1{guess}: "
        "check units and scales of the force and of the sensors, or multiply the shape of mode "
        f"{mode} by {abs(value) ** -0.5:.4g}"
    )
