"""The report of a nonlinear modal model: modes, level shifts, decays, coefficients and truth tests."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from opid.estimate import Estimate
from opid.mechanics.truth import ModalTruth
from opid.modal.forced.mode_fit import ModeFit
from opid.modal.model import TruthTest
from opid.modal.power_laws import unit_of
from opid.modal.result import ModalIdentification
from opid.modal.study import THRESHOLDS, ModalStudy
from opid.report.document import Block, Column, Document, Paragraph, Table, columns, counted, warnings
from opid.report.estimates import estimate_columns, estimate_row
from opid.report.modal.figures import figures_of

MOST_SENSORS = 8
"""Sensors of a truth test in the text, the worst first; all stand on the page."""

PACINI = "B. R. Pacini, Industrial applications of nonlinear modal modeling: two case studies."


def document_of(result: ModalIdentification, truth: ModalTruth | None = None) -> Document:
    """Return the report of a nonlinear modal model.

    Args:
        result: from `identify_modes`.
        truth: of a simulated test: shown beside each coefficient.
    """
    known = [str(fit.mode) for fit in result.fits]
    known += [f"{mode} (by free decays)" for mode in result.modes_by_decays_alone]
    worst = max((each.nrmse_nonlinear for test in result.truth_tests for each in test.sensors.values()), default=None)
    errors = "" if worst is None else f"; in the truth tests no sensor is farther off than {100 * worst:.2g} % (rms)"
    return Document(
        result.title or "Nonlinear modal model",
        counted(result.modes.n_modes, "mode"),
        f"Modelled as nonlinear: {', '.join(known) or 'none'}{errors}.",
        result.not_determined,
        (
            Paragraph(_basis(result)),
            *(table for table in (_mode_table(result), _shift_table(result), _decay_table(result)) if table.rows),
            *_coefficients(result, _with_coefficients(truth)),
            *(_truth_table(test, first=result.drive_point) for test in result.truth_tests),
            warnings(result.all_warnings),
        ),
        lambda: figures_of(result, truth),
        command_of(result),
        source="study",
        reference=f"The method is that of {PACINI}",
    )


def _basis(result: ModalIdentification) -> str:
    modes = result.modes
    rigid = modes.n_modes - int(np.count_nonzero(modes.elastic))
    at = f", force at {result.drive_point!r}" if result.drive_point else ", no force"
    return (
        f"{modes.n_modes} modes ({rigid} rigid), {len(modes.sensors)} sensors{at}; condition number of the shapes "
        f"{result.condition_number:.3g}."
    )


def _amplitude() -> Column:
    return Column("q", "m kg^1/2")


def _mode_table(result: ModalIdentification) -> Table:
    """Frequency and damping of each nonlinear mode at zero and at top amplitude, and how well it is fitted."""
    rows = []
    for fit in result.fits:
        of_fit = (
            f"{fit.stiffness_order}, {fit.damping_order}",
            f"{fit.band_hz[0]:.4g} .. {fit.band_hz[1]:.4g}",
            f"{100 * fit.residual_share:.2g} %",
        )
        top = f"top, {fit.stiffness_curve.position[-1]:.3g}"
        for index, label, more in ((0, "zero", of_fit), (-1, top, ("",) * len(of_fit))):
            frequency, damping = fit.frequency_at_hz[index], fit.damping_at[index]
            mode = str(fit.mode) if index == 0 else ""
            rows.append((mode, label, f"{frequency:.2f} Hz", f"{100 * damping:.3g} %", *more))
    return Table(
        (*columns("mode"), _amplitude(), *columns("frequency", "damping", "N_s, N_d", "band [Hz]", "misfit", left=())),
        tuple(rows),
        note="Natural frequency and damping ratio at zero amplitude, and at the top, the largest modal displacement q "
        "fitted.",
    )


def _shift_table(result: ModalIdentification) -> Table:
    """How frequency and damping of each mode move from the lowest level to the highest."""
    rows = []
    for shift in result.shifts:
        frequency, damping = _lowest(shift.frequency_hz), _lowest(shift.damping_ratio)
        rows.append(
            (
                str(shift.mode),
                "-" if frequency is None else f"{frequency:.2f} Hz",
                _percent(shift.frequency_shift, digits=2),
                "-" if damping is None else f"{100 * damping:.3g} %",
                _percent(shift.damping_shift, digits=0),
                ("yes" if shift.nonlinear else "no") if shift.determined else "cannot tell",
            )
        )
    return Table(
        columns("mode", "frequency", "frequency shift", "damping", "damping shift", "nonlinear"),
        tuple(rows),
        note="Frequency and damping are those at the lowest level, shifts those from there to the highest level."
        + _thresholds(result),
    )


def _thresholds(result: ModalIdentification) -> str:
    """From which shift on a mode counts as nonlinear."""
    frequency, damping = (result.settings.get(name) for name in ("frequency_threshold", "damping_threshold"))
    if frequency is None or damping is None:
        return ""
    return (
        f" A mode is nonlinear where its frequency shifts by more than {100 * frequency:.3g} % or its damping ratio by "
        f"more than {100 * damping:.3g} %, by three standard errors."
    )


def _decay_table(result: ModalIdentification) -> Table:
    """Frequency and damping of each free decay at zero amplitude, by its law, and at its largest."""
    rows: list[tuple[str, ...]] = []
    for decay in result.decays:
        low, damping = decay.frequency_low_hz.value, decay.damping_low.value
        zero = ("-" if low is None else f"{low:.2f} Hz", "-" if damping is None else f"{100 * damping:.3g} %")
        top = (f"{decay.frequency_hz[0]:.2f} Hz", f"{100 * decay.damping_ratio[0]:.3g} %")
        mode = "-" if decay.mode is None else str(decay.mode)
        rows.append((decay.name, mode, "zero", *zero, f"{100 * decay.residual_share:.2g} %"))
        rows.append(("", "", f"top, {decay.amplitude[0]:.3g}", *top, ""))
    heads = columns("frequency", "damping", "left over", left=())
    return Table(
        (*columns("free decay", "mode"), _amplitude(), *heads),
        tuple(rows),
        note="At zero amplitude by the law of the decay, and at the top, its largest amplitude, as measured.",
    )


def _coefficients(result: ModalIdentification, truth: ModalTruth | None) -> Iterator[Block]:
    """The coefficients with their intervals, mode by mode; nothing where there are none."""
    rows = [row for fit in result.fits for row in _rows_of(fit, truth)]
    rows += [row for mode in sorted(result.decay_laws) for row in _rows_of_decays(result, mode, truth)]
    decays = " Free decays give k₀ and c₀ themselves: there these are k1 and c1." if result.decay_laws else ""
    if truth:
        decays += " The tests were simulated: truth, error, and whether the interval held the truth, are known."
    if rows:
        yield Table(
            estimate_columns(truth),
            tuple(rows),
            "Coefficients",
            legend="q″ + c₀ q′ + k₀ q + Σ kₙ q |q|ⁿ⁻¹ + Σ cₙ q′ |q′|ⁿ⁻¹ = φᵀ f, mass-normalised shapes φ. The interval "
            "holds the value with 95 % if the model holds. Of several powers none means much alone; the force curve "
            f"below does.{decays}",
        )


def _with_coefficients(truth: ModalTruth | None) -> ModalTruth | None:
    """The truth if it has coefficients to compare with; joints that are no power laws have none."""
    return truth if truth and any(law.k or law.c for law in truth.nonlinear.values()) else None


def _rows_of(fit: ModeFit, truth: ModalTruth | None) -> Iterator[tuple[str, ...]]:
    free = "k0 and c0 corrected (k1, c1)" if fit.free_linear else "k0 and c0 as given"
    yield (f"Mode {fit.mode}, {fit.frequency_hz:.2f} Hz, {100 * fit.damping_ratio:.3g} % of critical damping: {free}",)
    yield from _powers(fit.mode, fit.stiffness, fit.damping, truth, lowest=1)


def _rows_of_decays(result: ModalIdentification, mode: int, truth: ModalTruth | None) -> Iterator[tuple[str, ...]]:
    """What the free decays of a mode give together; k1 and c1 are k0 and c0 themselves, of which no truth is known."""
    law = result.decay_laws[mode]
    names = [decay.name for decay in result.decays if decay.mode == mode]
    many = f"{len(names)} free decays together" if len(names) > 1 else f"free decay {names[0]!r}" if names else "decays"
    yield (f"Mode {mode} by {many}, {law.frequency_low_hz.value or 0:.2f} Hz: k1 and c1 are k0 and c0",)
    yield from _powers(mode, law.stiffness, law.damping, truth, lowest=2)


def _powers(
    mode: int,
    stiffness: Mapping[int, Estimate],
    damping: Mapping[int, Estimate],
    truth: ModalTruth | None,
    *,
    lowest: int,
) -> Iterator[tuple[str, ...]]:
    """A row for each power; the truth is known from the lowest on."""
    true = truth.nonlinear.get(mode) if truth else None
    for letter, estimates, known in (("k", stiffness, true and true.k), ("c", damping, true and true.c)):
        # what the truth's law lacks is zero; a joint that is no power law has no coefficients
        for power, estimate in sorted(estimates.items()):
            value = known.get(power, 0.0) if known and power >= lowest else None
            yield estimate_row(f"{letter}{power}", unit_of(letter, power), estimate, value, truth is not None)


def _truth_table(test: TruthTest, *, first: str | None) -> Table:
    """The figures of a truth test: the drive point, then the sensor with the largest error of the nonlinear model."""
    band = "" if test.band_hz is None else f", {test.band_hz[0]:.4g} to {test.band_hz[1]:.4g} Hz"
    rows = [
        (
            name,
            f"{each.peak_ratio_nonlinear:.3f}",
            f"{each.peak_ratio_linear:.3f}",
            f"{100 * each.nrmse_nonlinear:.3g} %",
            f"{100 * each.nrmse_linear:.3g} %",
        )
        for name, each in ((name, test.sensors[name]) for name in sorted(test.worst_sensors, key=lambda s: s != first))
    ]
    return Table(
        columns("sensor", "peak, nonlinear", "peak, linear", "error, nonlinear", "error, linear"),
        tuple(rows),
        f"Truth test {test.name!r}{band}",
        "Peak of the model over the measured peak, and rms error over the rms of the measurement, nonlinear and linear "
        "model.",
        most_in_text=MOST_SENSORS,
    )


def command_of(result: ModalIdentification, options: Mapping[str, Any] | None = None) -> list[str]:
    """Return the words of the command that gives this result.

    Args:
        result: the identification.
        options: settings that the command was given, by their names in `ModalStudy`; where None, the settings of the
            result that are not the defaults.
    """
    given = _beside_defaults(result) if options is None else options
    words = ["opid", "modal", str(result.settings.get("study") or "STUDY.toml")]
    for name, value in given.items():
        words += [] if name == "free_linear" else [f"--{name.replace('_', '-')}", f"{value:g}"]
    if given.get("free_linear") is not None:
        words.append("--free-linear" if given["free_linear"] else "--fixed-linear")
    return words


def _beside_defaults(result: ModalIdentification) -> dict[str, Any]:
    """The settings of a result that are not the defaults, whether its study file or the command has them."""
    names = ("stiffness_order", "damping_order", "free_linear", *THRESHOLDS)
    given = {name: result.settings[name] for name in names if result.settings.get(name) is not None}
    return {name: value for name, value in given.items() if value != getattr(ModalStudy, name)}


def _lowest(estimates: tuple[Estimate, ...]) -> float | None:
    """The value of the lowest level that has one."""
    return next((each.value for each in estimates if each.value is not None), None)


def _percent(shift: Estimate, *, digits: int) -> str:
    # no -0
    return "-" if shift.value is None else f"{round(100 * shift.value, digits) + 0.0:+.{digits}f} %"
