"""The figures of the report of a nonlinear modal model, in the order in which it is made."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from opid import plots
from opid.mechanics.truth import ModalTruth, ModeTruth
from opid.modal.decay.free_decay import Decay
from opid.modal.forced.mode_fit import ModeFit
from opid.modal.linear.frequency_response import ModeIndicator, cmif, measured_response, resynthesised
from opid.modal.linear.modes import ModalTest
from opid.modal.model import TruthTest
from opid.modal.result import ModalIdentification
from opid.modal.study import THRESHOLDS
from opid.report.document import Figure

N_SENSORS_SHOWN = 3
"""Sensors of a truth test with a row of their own."""

N_LINES = 4000
"""Of the mode indicator of the linear modes."""

ABOVE_MODES = 1.15
"""Times the highest natural frequency: so far the mode indicators are shown."""


def figures_of(result: ModalIdentification, truth: ModalTruth | None) -> Iterator[Figure]:
    """Yield the figures in the order in which the model is made, those that have something to show.

    Args:
        result: of an identification.
        truth: of a simulated structure, drawn beside it.
    """
    yield Figure(
        "auto_mac",
        "Are the shapes independent?",
        "Modal assurance criterion of the shapes against each other. What is high off the diagonal is told apart by "
        "few sensors only, and mixes in the modal filter.",
        lambda: plots.auto_mac(result),
    )
    if result.drive_point is not None:
        yield Figure(
            "mode_indicators",
            "What the linear modes explain",
            "Complex mode indicator function of the level tests (in colour, the lowest level first) and of the linear "
            "modes (dashed). They should agree at the lowest level; a peak that moves and widens with the level is a "
            "nonlinear mode."
            if result.shifts
            else "Complex mode indicator function of the linear modes.",
            lambda: _draw_indicators(result),
        )
    if result.shifts:
        yield Figure(
            "level_shifts",
            "Which modes are nonlinear",
            "Change of natural frequency and damping ratio from the lowest level to the highest, with 95 % intervals. "
            "Beyond the thresholds (dashed), by three standard errors, a mode counts as nonlinear.",
            lambda: plots.level_shift_figures(
                result.shifts, **{name: result.settings[name] for name in THRESHOLDS if name in result.settings}
            ),
        )
    for fit in result.fits:
        yield from _figures_of_mode(result, fit, truth)
    for number, decay in enumerate(result.decays, start=1):
        yield Figure(
            f"decay_{number}",
            f"Free decay {decay.name}",
            "The record with the amplitude that was followed, and natural frequency and damping ratio over it, beside "
            "those of the law that the decays of this mode give together. Wiggles are noise or a second mode.",
            _draw_decay(result, decay),
        )
    for number, test in enumerate(result.truth_tests, start=1):
        yield from _figures_of_truth_test(result, number, test)


def _figures_of_mode(result: ModalIdentification, fit: ModeFit, truth: ModalTruth | None) -> Iterator[Figure]:
    known = (
        " Green dots are the truth of the simulation: frequency and damping of this mode while all others are at rest."
        if _true_mode(fit, truth)
        else ""
    )

    yield Figure(
        f"mode_{fit.mode}_tests",
        f"Mode {fit.mode}: the tests it was fitted to",
        "Its modal acceleration in time and frequency. A good beat has its energy between the neighbouring modes "
        "(dashed) and has decayed at its end.",
        lambda: plots.sine_beats(result, fit.mode),
    )
    yield Figure(
        f"mode_{fit.mode}_force",
        f"Mode {fit.mode}: restoring force, frequency and damping",
        "Stiffness force over displacement and damping force over velocity, whole and nonlinear part alone with its "
        "95 % band, and what they make of natural frequency and damping ratio. Beyond the drawn range the law is an "
        f"extrapolation.{known}",
        lambda: plots.mode_restoring_force(fit, truth=_true_mode(fit, truth)),
    )
    if fit.orders:
        yield Figure(
            f"mode_{fit.mode}_orders",
            f"Mode {fit.mode}: how many powers",
            "Misfit on tests that were left out. The fewest powers are chosen that predict as well as the best.",
            lambda: plots.modal_orders(fit),
        )


def _figures_of_truth_test(result: ModalIdentification, number: int, test: TruthTest) -> Iterator[Figure]:
    yield Figure(
        f"truth_test_{number}",
        f"Truth test {test.name}",
        "No fit has seen this test. Measured (black, grey), nonlinear model (red), linear model (blue) under the "
        "measured force. Left: the whole record; where it has too many periods to draw, its upper and lower envelope, "
        "the measured one as a grey area. Middle: around the largest measured acceleration. Right: over frequency; "
        "where there are too many lines to draw, the largest of each group of neighbouring ones. Dashed lines are the "
        "nonlinear modes.",
        lambda: plots.truth_test(
            test,
            sensors=_choose_sensors(result, test),
            nonlinear_hz=[result.modes.frequency_hz[mode - 1] for mode in result.model.laws],
        ),
    )
    yield Figure(
        f"truth_test_{number}_errors",
        f"Truth test {test.name}: every sensor",
        "Rms error of both models over the rms of the measurement.",
        lambda: plots.truth_test_figures(test),
    )


def _draw_decay(result: ModalIdentification, decay: Decay) -> Callable[[], Any]:
    law = None if decay.mode is None else result.decay_laws.get(decay.mode)
    return lambda: plots.free_decay_figure(decay, law=law)


def _draw_indicators(result: ModalIdentification) -> Any:
    measured = _measured_indicators(result)
    top = ABOVE_MODES * float(result.modes.frequency_hz.max())
    elastic = result.modes.frequency_hz[result.modes.elastic]
    frequency = np.linspace(0.5 * float(elastic.min()), top, N_LINES)
    made = cmif([resynthesised(result.modes, np.union1d(frequency, elastic), str(result.drive_point))])
    marked = {mode: float(result.modes.frequency_hz[mode - 1]) for mode in sorted(result.model.laws)}
    zoomed = list(marked)[:5] if measured else []
    return plots.mode_indicators(measured, made, marked=marked, zoomed=zoomed)


def _measured_indicators(result: ModalIdentification) -> dict[str, ModeIndicator]:
    """Those of the tests that levels are compared by, from the lowest to the highest."""
    names = {name for shift in result.shifts for name in shift.levels}
    tests = sorted((test for test in result.tests if test.name in names), key=_largest_force)
    return {test.name: cmif([measured_response([test])]) for test in tests}


def _largest_force(test: ModalTest) -> float:
    return 0.0 if test.force is None else float(np.abs(test.force).max())


def _choose_sensors(result: ModalIdentification, test: TruthTest) -> list[str]:
    """The drive point, the sensor that the model moves most, and the one with the largest error; each once."""
    names = list(test.sensors)
    moves_most = max(names, key=lambda name: float(np.abs(test.nonlinear.channel(name)).max()))
    drive = [result.drive_point] if result.drive_point in names else []
    return list(dict.fromkeys([*drive, moves_most, test.worst_sensors[0]]))[:N_SENSORS_SHOWN]


def _true_mode(fit: ModeFit, truth: ModalTruth | None) -> ModeTruth | None:
    """Frequency and damping of a mode over its amplitude, as a simulation knows them."""
    known = truth.nonlinear.get(fit.mode) if truth else None
    return known if known and known.amplitude else None
