"""What to doubt about a nonlinear modal model, one sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from opid.estimate import Estimate
from opid.modal.equation import mode_lines
from opid.modal.level_shifts import LevelShift
from opid.modal.modes import LARGEST_CONDITION, LinearModes, condition_number
from opid.modal.modes_file import looks_unit_normalised
from opid.modal.restoring_fit import Coefficients
from opid.modal.result import ForceCurve, ModeFit
from opid.modal.study import ModalStudy
from opid.signals.health import inspect

WARNED_MASS = 0.05
"""Departure of the modal mass from 1 that is told."""

MOST_OF_CURVE = 0.3
"""Half width of a force curve's band where it ends, as a share of the force: wider, the orders are too high."""

MOST_UNEXPLAINED = 0.5
"""Of the modal force: what a fit may leave before it is doubted."""

BEYOND = 1.1
"""Times the largest amplitude fitted: a truth test that goes further asks the polynomials to extrapolate."""


def doubts_of_fit(
    mode: int, mass: Estimate, found: Coefficients, curve_k: ForceCurve, curve_c: ForceCurve
) -> Iterator[str]:
    """Yield what to doubt about the fit of a mode.

    Args:
        mode: number of the mode, from 1.
        mass: that the tests show for it.
        found: its coefficients.
        curve_k: nonlinear stiffness force.
        curve_c: nonlinear damping force.
    """
    value, std = float(mass.value or 0.0), float(mass.std or 0.0)
    if abs(value - 1) > max(WARNED_MASS, 4 * std):
        yield (
            f"mode {mode}: the tests show a modal mass of {value:.3f} +- {std:.3f} where 1 is expected: the scale of "
            "its shape or of the force is off, and with it the amplitudes"
        )
    for word, curve in (("stiffness", curve_k), ("damping", curve_c)):
        if not curve.force.any():
            continue
        half = 0.5 * (curve.high[-1] - curve.low[-1]) / np.abs(curve.force).max()
        if half > MOST_OF_CURVE:
            yield (
                f"mode {mode}: the nonlinear {word} force is known to +-{100 * half:.0f} % at the largest amplitude: "
                f"the data cannot tell it, lower {word}_order or test at higher levels"
            )
    tangent = np.gradient(curve_k.linear + curve_k.force, curve_k.position)
    if (tangent <= 0).any():
        yield f"mode {mode}: the fitted spring has no positive stiffness at the largest amplitude: do not go beyond it"
    if found.residual_share > MOST_UNEXPLAINED:
        yield (
            f"mode {mode}: the fit leaves {100 * found.residual_share:.0f} % of the modal force unexplained: the mode "
            "is not alone in its band, or its linear properties belong to another state of the structure"
        )


def doubts_of_modes(modes: LinearModes) -> Iterator[str]:
    """Yield what to doubt about linear modes.

    Args:
        modes: the modes.
    """
    condition = condition_number(modes)
    if condition > LARGEST_CONDITION:
        yield (
            f"the shapes have the condition number {condition:.0f} (9 is good): noise and errors of the shapes grow by "
            "as much in the modal filter; add sensors or leave out modes"
        )
    looks = looks_unit_normalised(modes)
    if looks:
        yield f"the shapes do not look mass-normalised: {looks}"


def doubts_of_truth_tests(study: ModalStudy, fits: Sequence[ModeFit]) -> Iterator[str]:
    """Yield the truth tests that go beyond the amplitudes that were fitted.

    Args:
        study: with its tests.
        fits: of its nonlinear modes.
    """
    for each, fit in product(study.of_use("truth"), fits):
        times = mode_lines(each.test, fit.mode, fit.band_hz).largest_q / fit.stiffness_curve.position[-1]
        if times > BEYOND:
            yield (
                f"truth test {each.test.name!r} moves mode {fit.mode} {times:.2g} times as far as the tests it was "
                "fitted to: there its force is an extrapolation"
            )


def nothing_nonlinear(shifts: Sequence[LevelShift]) -> str:
    """Return why no mode is taken for nonlinear.

    Args:
        shifts: of the modes with the level; none without level tests.
    """
    if not shifts:
        return 'no mode is named as nonlinear: name some (nonlinear = [7, 11]), or give two tests with use = "level"'
    return (
        f"none of {len(shifts)} modes shifts with the level beyond its thresholds: the structure is linear at these "
        "levels; excite it harder, or name the modes to fit (nonlinear = [7, 11])"
    )


def doubts_of_records(study: ModalStudy) -> Iterator[str]:
    """Yield the channels that are clipped.

    Args:
        study: with its tests.
    """
    for each in study.tests:
        for channel in inspect(each.test.recording, thorough=False).channels:
            if channel.clipped_fraction > 0:
                yield (
                    f"{channel.clipped_fraction:.2g} of the samples of {channel.name!r} in test {each.test.name!r} are "
                    "clipped: measure again with a larger range"
                )


def doubts_of_other_shifts(shifts: Sequence[LevelShift], nonlinear: Sequence[int]) -> Iterator[str]:
    """Yield the modes that shift with the level and are modelled as linear.

    Args:
        shifts: of the modes with the level; none without level tests.
        nonlinear: numbers of the modes that are not.
    """
    for shift in shifts:
        if shift.nonlinear and shift.mode not in nonlinear:
            yield (
                f"mode {shift.mode} shifts with the level and is modelled as linear: name it in nonlinear, or judge "
                "the model by tests that hardly move it"
            )
