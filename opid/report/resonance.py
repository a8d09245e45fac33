"""The report of measured tests at phase resonance: levels, harmonics, the interaction of modes, and the law."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from opid import plots
from opid.estimate import format_number, format_percent
from opid.mechanics.truth import ModalTruth
from opid.modal.resonance.law import ResonanceLaw
from opid.modal.resonance.result import Resonance
from opid.report.document import (
    Block,
    Column,
    Document,
    Figure,
    Paragraph,
    Row,
    Table,
    build_columns,
    build_warnings,
    format_count,
    write_options,
)
from opid.report.estimates import tabulate_estimates
from opid.report.nonlinear_modes import PACINI, list_power_rows

MOST_LEVELS = 8  # the text shows so many levels, from the lowest to the highest; the page shows all


def build_document(result: Resonance, truth: ModalTruth | None = None) -> Document:
    """Return the report of measured tests at phase resonance."""
    order = np.argsort(result.amplitude)
    interaction = [] if result.interaction is None else [Paragraph(result.interaction.statement, "Interaction")]
    blocks: list[Block] = [
        Paragraph(_say_basis(result)),
        *([_tabulate_levels(result, _choose_levels(order))] if result.states else []),
        *_tabulate_laws(result, truth),
        *([_tabulate_law(result.law)] if result.law and not result.states else []),
        *([_tabulate_curves(result)] if result.curve_fits else []),
        *interaction,
        build_warnings(result.warnings),
    ]
    command = ["opid", "resonance", str(result.settings.get("study") or "STUDY.toml")]
    mode = result.settings.get("mode")
    return Document(
        result.title,
        f"mode {result.mode} at phase resonance" if result.states else f"response curves of mode {result.mode}",
        _say_range(result, order),
        result.not_determined,
        tuple(blocks),
        lambda: [*_list_figures(result), *_list_details(result, order)],
        [*command, *write_options({} if mode is None else {"mode": mode})],
        source="study",
        reference=f"The test is that of {PACINI}",
    )


def _say_range(result: Resonance, order: np.ndarray) -> str:
    """Return how frequency and damping move with the amplitude, by the levels or, without any, by the law."""
    if result.states:
        q, hz, zeta = result.amplitude[order], result.resonance_hz[order], result.damping_ratio[order]
    elif result.law is not None:
        q, hz, zeta = result.law.amplitude, result.law.frequency_hz, result.law.damping_ratio
    else:
        return f"{format_count(len(result.curve_fits), 'response curve')} of mode {result.mode}."
    return (
        f"While the amplitude of mode {result.mode} grows from {format_number(q[0], 3)} to {format_number(q[-1], 3)} "
        f"m kg^1/2, its resonance moves from {hz[0]:.2f} to {hz[-1]:.2f} Hz and its damping ratio from "
        f"{format_percent(zeta[0], 3)} to {format_percent(zeta[-1], 3)}."
    )


def _say_basis(result: Resonance) -> str:
    curves = (
        f"{format_count(len(result.curve_fits), 'response curve')} with "
        f"{format_count(len(result.curve_states), 'point')} near the peaks, force at {result.drive_point!r}."
    )
    levels = _say_levels(result) if result.states else ""
    return " ".join(filter(None, (levels, curves if result.curve_fits else "")))


def _say_levels(result: Resonance) -> str:
    n = len(result.states)
    errors = np.abs(result.phase_error_deg)
    return (
        f"{format_count(n, 'steady level')} in {format_count(len({*result.level_tests}), 'log')}, force at "
        f"{result.drive_point!r}; the mode is {errors.max():.1f} degrees off quadrature at most, which is corrected. "
        f"{format_count(len(result.left_out), 'level')} left out."
    )


def _choose_levels(order: np.ndarray) -> np.ndarray:
    return order[np.unique(np.linspace(0, order.size - 1, min(MOST_LEVELS, order.size)).round().astype(int))]


def _tabulate_levels(result: Resonance, chosen: np.ndarray, title: str = "Backbone") -> Table:
    assert result.appropriation is not None  # There are levels.
    levels, errors = result.appropriation.levels, result.phase_error_deg
    rows = tuple(
        (
            str(int(index) + 1),
            format_number(result.amplitude[index], 4),
            f"{result.resonance_hz[index]:.3f}",
            format_number(100 * result.damping_ratio[index], 3),
            format_number(float(np.abs(levels[index].force[0])), 3),
            f"{errors[index]:+.1f}",
        )
        for index in chosen
    )
    return Table(
        (
            Column("level", align="left"),
            Column("q", "m kg^1/2"),
            Column("resonance", "Hz"),
            Column("damping", "%"),
            Column("force", "N"),
            Column("phase", "deg", is_optional=True),
        ),
        rows,
        title,
        "Frequency at which the mode is at phase resonance with this amplitude, and its damping ratio by the force at "
        "quadrature; phase is how far the mode was off quadrature.",
    )


def _tabulate_laws(result: Resonance, truth: ModalTruth | None) -> Iterator[Table]:
    named = (
        ("records, transients and curves together", result.joint_law),
        ("records and transients", result.records_law),
        ("the backbone alone", result.backbone_law),
        ("the response curves alone", result.curves_law),
    )
    laws = [(name, law) for name, law in named if law is not None]
    if laws:
        known = truth if truth and truth.nonlinear.get(result.mode) else None
        yield tabulate_estimates(
            [row for name, law in laws for row in _list_law_rows(result, name, law, known)],
            known,
            "Law",
            "The interval holds the value with 95 % if the mode follows powers; it lacks errors of a sensor's gain.",
        )


def _list_law_rows(result: Resonance, name: str, law: ResonanceLaw, truth: ModalTruth | None) -> Iterator[Row]:
    yield (f"By {name} ({format_count(law.n_states, 'motion')}, misfit {law.misfit:.2g}): k1 and c1 are k0 and c0",)
    yield from list_power_rows(result.mode, law.stiffness, law.damping, truth, lowest=2)


def _tabulate_law(law: ResonanceLaw) -> Table:
    """Return frequency and damping by the law at some amplitudes, where no level shows them."""
    chosen = np.linspace(0, law.amplitude.size - 1, MOST_LEVELS).round().astype(int)
    rows = tuple(
        (
            format_number(law.amplitude[at], 4),
            f"{law.frequency_hz[at]:.3f}",
            f"{1.96 * law.frequency_std_hz[at]:.3f}",
            format_number(100 * law.damping_ratio[at], 3),
            format_number(196 * law.damping_std[at], 2),
        )
        for at in chosen
    )
    return Table(
        (
            Column("q", "m kg^1/2"),
            Column("resonance", "Hz"),
            Column("+-", "Hz"),
            Column("damping", "%"),
            Column("+-", "%"),
        ),
        rows,
        "Frequency and damping by the law",
        "With half of their 95 % intervals.",
    )


def _tabulate_curves(result: Resonance) -> Table:
    rows = tuple(
        (
            each.curve.name,
            each.curve.sensor,
            format_number(float(np.median(each.curve.force_n)), 3),
            format_number(float(each.curve.amplitude.max()), 4),
            f"{each.curve.frequency_hz[np.argmax(each.curve.amplitude)]:.2f}",
            format_number(each.peak_ratio, 4) if np.isfinite(each.peak_ratio) else "-",
            format_number(100 * each.error, 2) if np.isfinite(each.error) else "-",
        )
        for each in result.curve_fits
    )
    by = (
        "the records and transients, which have not seen the curves,"
        if any(each.is_prediction for each in result.curve_fits)
        else "the curves themselves"
    )
    return Table(
        (
            Column("curve", align="left"),
            Column("sensor", align="left"),
            Column("force", "N"),
            Column("peak", "m/s^2"),
            Column("at", "Hz"),
            Column("law's peak over it"),
            Column("law's error", "%"),
        ),
        rows,
        "Response curves",
        f"Beside what the law by {by} makes of the same forces; the error is rms over rms of the curve.",
    )


def _list_details(result: Resonance, order: np.ndarray) -> Iterator[Block]:
    if result.appropriation is None:
        return
    yield _tabulate_levels(result, order, "All levels")
    heights = np.abs(result.appropriation.modal[order]).max(axis=0)
    yield Table(
        build_columns("mode", *(f"harmonic {h}" for h in range(1, heights.shape[1] + 1))),
        tuple((str(mode), *(format_number(each, 3) for each in row)) for mode, row in enumerate(heights, start=1)),
        "Harmonics of the modes",
        "The largest amplitude of each modal acceleration at any level, m/s^2 kg^1/2.",
    )


def _list_figures(result: Resonance) -> Iterator[Figure]:
    done, found = result.appropriation, result.interaction
    if result.curve_fits:
        yield Figure(
            "response_curves",
            "Response curves",
            "Amplitude and phase of the sensor at each step of the frequency; the line is what the law makes of the "
            "same forces.",
            lambda: plots.response_curves(result.curve_fits),
        )
    if done is None:
        return
    yield Figure(
        "backbone",
        "Backbone",
        "Frequency at phase resonance and damping ratio over the amplitude of the mode; the line is the law by the "
        "records with its 95 % band.",
        lambda: plots.backbone(done, found=result),
    )
    if result.drive_point in done.modes.sensors:
        yield Figure(
            "sensor_harmonics",
            "Harmonics at the drive point",
            "Harmonics 1 to 5 of the drive-point acceleration at each level, the even ones dashed.",
            lambda: plots.sensor_harmonics(done, result.drive_point),
        )
    if found is not None:
        yield Figure(
            "modal_harmonics",
            "Does the mode drive another one?",
            "Harmonics of the modal accelerations that stand out most, over the fundamental of the mode under test.",
            lambda: plots.modal_harmonics(found),
        )
        yield Figure(
            "harmonic_shape",
            "The shape of that harmonic",
            "MAC of the deflection at this harmonic with the shape of the mode, and with those of all others.",
            lambda: plots.harmonic_shape(found),
        )
