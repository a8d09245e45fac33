"""A nonlinear modal model as text and as tables: coefficients, frequencies over level, and the truth tests."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from opid.estimate import Estimate
from opid.modal.power_laws import unit_of
from opid.modal.result import ModalIdentification, ModeFit, TruthTest
from opid.report.as_text import Row
from opid.report.modal.units import coefficient_row

MOST_SENSORS = 8
"""Sensors of a truth test in the text, the worst first; all stand in result.json."""

AMPLITUDE = "q [m kg^1/2]"
MODES_NOTE = (
    "Natural frequency and damping ratio at zero amplitude, and at the top, the largest modal displacement q fitted."
)
SHIFTS_NOTE = "Frequency and damping are those at the lowest level, shifts those from there to the highest level."
DECAYS_NOTE = "At zero amplitude by the law of the decay, and at the top, its largest amplitude, as measured."

Truth = Mapping[str, Any]


def basis(result: ModalIdentification) -> str:
    """Return the sentence that says what the model is made of.

    Args:
        result: the identification.
    """
    modes = result.modes
    rigid = modes.n_modes - int(np.count_nonzero(modes.elastic))
    known = [str(fit.mode) for fit in result.fits] + [
        f"{mode} (by free decays)" for mode in result.modes_by_decays_alone
    ]
    at = f", force at {result.drive_point!r}" if result.drive_point else ", no force"
    return (
        f"{modes.n_modes} modes ({rigid} rigid), {len(modes.sensors)} sensors{at}; condition number of the shapes "
        f"{result.condition_number:.3g}; modelled as nonlinear: {', '.join(known) or 'none'}."
    )


def tables(result: ModalIdentification) -> list[tuple[list[tuple[str, ...]], str]]:
    """Return the tables of modes, level shifts and free decays that have something in them, each with a note below.

    Args:
        result: the identification.
    """
    noted = (
        (mode_table(result), MODES_NOTE),
        (shift_table(result), f"{SHIFTS_NOTE} {thresholds(result)}".rstrip()),
        (decay_table(result), DECAYS_NOTE),
    )
    return [(table, note) for table, note in noted if len(table) > 1]


def thresholds(result: ModalIdentification) -> str:
    """Return the sentence that says from which shift on a mode counts as nonlinear.

    Args:
        result: the identification.
    """
    frequency, damping = (result.settings.get(name) for name in ("frequency_threshold", "damping_threshold"))
    if frequency is None or damping is None:
        return ""
    return (
        f"A mode is nonlinear where its frequency shifts by more than {100 * frequency:.3g} % or its damping ratio by "
        f"more than {100 * damping:.3g} %, by three standard errors."
    )


def mode_table(result: ModalIdentification) -> list[tuple[str, ...]]:
    """Return frequency and damping of each nonlinear mode at zero and at top amplitude, and how well it is fitted.

    Args:
        result: the identification.

    Returns:
        Rows of as many cells each, the heads first; two rows a mode.
    """
    table: list[tuple[str, ...]] = [("mode", AMPLITUDE, "frequency", "damping", "N_s, N_d", "band [Hz]", "misfit")]
    for fit in result.fits:
        of_fit = (
            f"{fit.stiffness_order}, {fit.damping_order}",
            f"{fit.band_hz[0]:.4g} .. {fit.band_hz[1]:.4g}",
            f"{100 * fit.residual_share:.2g} %",
        )
        top = f"top, {fit.stiffness_curve.position[-1]:.3g}"
        for place, label, more in ((0, "zero", of_fit), (-1, top, ("",) * len(of_fit))):
            frequency, damping = fit.frequency_at_hz[place], fit.damping_at[place]
            mode = str(fit.mode) if place == 0 else ""
            table.append((mode, label, f"{frequency:.2f} Hz", f"{100 * damping:.3g} %", *more))
    return table


def shift_table(result: ModalIdentification) -> list[tuple[str, ...]]:
    """Return how frequency and damping of each mode move from the lowest level to the highest.

    Args:
        result: the identification.

    Returns:
        Rows of as many cells each, the heads first; the heads alone without level tests.
    """
    table: list[tuple[str, ...]] = [("mode", "frequency", "frequency shift", "damping", "damping shift", "nonlinear")]
    for shift in result.shifts:
        frequency, damping = _lowest(shift.frequency_hz), _lowest(shift.damping_ratio)
        table.append(
            (
                str(shift.mode),
                "-" if frequency is None else f"{frequency:.2f} Hz",
                _percent(shift.frequency_shift, digits=2),
                "-" if damping is None else f"{100 * damping:.3g} %",
                _percent(shift.damping_shift, digits=0),
                ("yes" if shift.nonlinear else "no") if shift.determined else "cannot tell",
            )
        )
    return table


def decay_table(result: ModalIdentification) -> list[tuple[str, ...]]:
    """Return frequency and damping of each free decay at zero amplitude, by its law, and at its largest.

    Args:
        result: the identification.

    Returns:
        Rows of as many cells each, the heads first, two rows a decay; the heads alone without free decays.
    """
    table: list[tuple[str, ...]] = [("free decay", "mode", AMPLITUDE, "frequency", "damping", "left over")]
    for decay in result.decays:
        low, damping = decay.frequency_low_hz.value, decay.damping_low.value
        table += [
            (
                decay.name,
                "-" if decay.mode is None else str(decay.mode),
                "zero",
                "-" if low is None else f"{low:.2f} Hz",
                "-" if damping is None else f"{100 * damping:.3g} %",
                f"{100 * decay.residual_share:.2g} %",
            ),
            (
                *("", ""),
                f"top, {decay.amplitude[0]:.3g}",
                f"{decay.frequency_hz[0]:.2f} Hz",
                f"{100 * decay.damping_ratio[0]:.3g} %",
                "",
            ),
        ]
    return table


def coefficient_rows(result: ModalIdentification, truth: Truth | None = None) -> list[Row]:
    """Return the table of the coefficients with their intervals, mode by mode.

    Args:
        result: the identification.
        truth: as in truth.json, or None.
    """
    of_fits = [row for fit in result.fits for row in _rows_of(fit, truth)]
    of_decays = [row for mode in sorted(result.decay_laws) for row in _rows_of_decays(result, mode, truth)]
    return of_fits + of_decays


def with_coefficients(truth: Truth | None) -> Truth | None:
    """Return the truth if it has coefficients to compare with; joints that are no power laws have none.

    Args:
        truth: as in truth.json, or None.
    """
    return truth if truth and any(law["k"] or law["c"] for law in truth["nonlinear"].values()) else None


def truth_test_head(test: TruthTest) -> str:
    """Return what a truth test compares, in one sentence.

    Args:
        test: the truth test.
    """
    band = "" if test.band_hz is None else f", {test.band_hz[0]:.4g} to {test.band_hz[1]:.4g} Hz"
    return (
        f"Truth test {test.name!r}{band}: peak of the model over the measured peak, and rms error over the rms of the "
        "measurement, nonlinear and linear model."
    )


def truth_table(test: TruthTest, *, most: int | None = None, first: str | None = None) -> list[tuple[str, ...]]:
    """Return the figures of a truth test, the sensor with the largest error of the nonlinear model first.

    Args:
        test: the truth test.
        most: sensors at most; all where left out.
        first: a sensor that stands before all others.

    Returns:
        Rows of as many cells each, the heads first.
    """
    names = sorted(worst_sensors(test), key=lambda name: name != first)
    table: list[tuple[str, ...]] = [("sensor", "peak, nonlinear", "peak, linear", "error, nonlinear", "error, linear")]
    table += [
        (
            name,
            f"{each.peak_ratio_nonlinear:.3f}",
            f"{each.peak_ratio_linear:.3f}",
            f"{100 * each.nrmse_nonlinear:.3g} %",
            f"{100 * each.nrmse_linear:.3g} %",
        )
        for name, each in ((name, test.sensors[name]) for name in names[:most])
    ]
    return table


def worst_sensors(test: TruthTest) -> list[str]:
    """Return the sensors of a truth test, the one with the largest error of the nonlinear model first.

    Args:
        test: the truth test.
    """
    return sorted(test.sensors, key=lambda name: -test.sensors[name].nrmse_nonlinear)


def _rows_of(fit: ModeFit, truth: Truth | None) -> Iterator[Row]:
    free = "k0 and c0 corrected (k1, c1)" if fit.free_linear else "k0 and c0 as given"
    yield Row(
        f"Mode {fit.mode}, {fit.frequency_hz:.2f} Hz, {100 * fit.damping_ratio:.3g} % of critical damping: {free}"
    )
    true = truth["nonlinear"].get(str(fit.mode), {}) if truth else {}
    for letter, estimates in (("k", fit.stiffness), ("c", fit.damping)):
        for power, estimate in sorted(estimates.items()):
            known = true.get(letter)
            # what the truth's law lacks is zero; a joint that is no power law has no coefficients
            value = float(known.get(str(power), 0.0)) if known else None
            yield coefficient_row(f"{letter}{power}", unit_of(letter, power), estimate, value, truth is not None)


def _rows_of_decays(result: ModalIdentification, mode: int, truth: Truth | None) -> Iterator[Row]:
    """What the free decays of a mode give together; k1 and c1 are k0 and c0 themselves."""
    law = result.decay_laws[mode]
    names = [decay.name for decay in result.decays if decay.mode == mode]
    many = f"{len(names)} free decays together" if len(names) > 1 else f"free decay {names[0]!r}" if names else "decays"
    yield Row(f"Mode {mode} by {many}, {law.frequency_low_hz.value or 0:.2f} Hz: k1 and c1 are k0 and c0")
    true = truth["nonlinear"].get(str(mode), {}) if truth else {}
    for letter, estimates in (("k", law.stiffness), ("c", law.damping)):
        for power, estimate in sorted(estimates.items()):
            known = true.get(letter)
            value = float(known.get(str(power), 0.0)) if known and power > 1 else None
            yield coefficient_row(f"{letter}{power}", unit_of(letter, power), estimate, value, truth is not None)


def _lowest(estimates: tuple[Estimate, ...]) -> float | None:
    """The value of the lowest level that has one."""
    return next((each.value for each in estimates if each.value is not None), None)


def _percent(shift: Estimate, *, digits: int) -> str:
    # no -0
    return "-" if shift.value is None else f"{round(100 * shift.value, digits) + 0.0:+.{digits}f} %"
