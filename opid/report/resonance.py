"""The report of measured tests at phase resonance: levels, harmonics, the interaction of modes, and the law."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from opid import plots
from opid.errors import list_names
from opid.estimate import Estimate, format_number, format_percent
from opid.mechanics.truth import ModalTruth
from opid.modal.resonance.held_out import HeldOut
from opid.modal.resonance.law import ResonanceLaw
from opid.modal.resonance.result import Resonance, Resonances
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
from opid.report.estimates import format_estimate, tabulate_estimates
from opid.report.nonlinear_modes import PACINI, list_power_rows
from opid.signals.recording import FloatArray

MOST_LEVELS = 8  # the text shows so many levels, from the lowest to the highest; the page shows all


def build_document(result: Resonance | Resonances, truth: ModalTruth | None = None) -> Document:
    """Return the report of measured tests at phase resonance, of one mode or of several."""
    return _build_one(result, truth) if isinstance(result, Resonance) else _build_several(result, truth)


def _build_one(result: Resonance, truth: ModalTruth | None) -> Document:
    order = np.argsort(result.amplitude)
    return Document(
        result.title,
        f"mode {result.mode} at phase resonance" if result.states else f"response curves of mode {result.mode}",
        _say_range(result),
        result.not_determined,
        (*_list_blocks(result, truth), build_warnings(result.warnings)),
        lambda: [*_list_figures(result), *_list_details(result, order)],
        _write_command(result.settings),
        source="study",
        reference=f"The test is that of {PACINI}",
    )


def _build_several(result: Resonances, truth: ModalTruth | None) -> Document:
    blocks = [_name_mode(block, each.mode) for each in result.modes for block in _list_blocks(each, truth)]

    def list_details() -> Iterator[Block]:
        for each in result.modes:
            order = np.argsort(each.amplitude)
            yield from (_name_mode(block, each.mode) for block in (*_list_figures(each), *_list_details(each, order)))

    return Document(
        result.title,
        f"modes {list_names([each.mode for each in result.modes])} at phase resonance",
        f"{format_count(len(result.modes), 'mode')} of {len(result.modes) + len(result.faults)} could be read.",
        result.not_determined,
        (_tabulate_modes(result), *blocks, build_warnings(result.warnings)),
        list_details,
        _write_command(result.settings),
        source="study",
        reference=f"The test is that of {PACINI}",
    )


def _list_blocks(result: Resonance, truth: ModalTruth | None) -> Iterator[Block]:
    order = np.argsort(result.amplitude)
    yield Paragraph(_say_basis(result))
    if result.states:
        yield _tabulate_levels(result, _choose_levels(order))
    yield from _tabulate_laws(result, truth)
    if result.law and not result.states:
        yield _tabulate_law(result.law)
    if result.curve_fits:
        yield _tabulate_curves(result)
    if result.held_out:
        yield _tabulate_held_out(result.held_out)
    if result.interaction is not None:
        yield Paragraph(result.interaction.statement, "Interaction")


def _name_mode(block: Block, mode: int) -> Block:
    """Return a block of the report of one mode with the mode in its heading, beside those of other modes."""
    named = f"Mode {mode}"
    if isinstance(block, Table):
        return replace(block, title=f"{named}: {block.title}" if block.title else named)
    if isinstance(block, Figure):
        return replace(block, name=f"mode_{mode}_{block.name}", heading=f"{named}: {block.heading}")
    if isinstance(block, Paragraph):
        return replace(block, heading=f"{named}: {block.heading}" if block.heading else named)
    return block


def _tabulate_modes(result: Resonances) -> Table:
    """Return how frequency and damping of each mode move, by its levels or, without any, by its law."""
    rows = []
    for each in result.modes:
        moved = _find_range(each)
        cells = ("-", "-", "-") if moved is None else _write_range(*moved)
        rows.append((str(each.mode), str(len(each.states)), str(len(each.curve_fits)), *cells))
    rows += [(str(number), "-", "-", "-", "-", "-") for number in sorted(result.faults)]
    return Table(
        (
            Column("mode", align="left"),
            Column("levels"),
            Column("curves"),
            Column("q", "m kg^1/2"),
            Column("resonance", "Hz"),
            Column("damping", "%"),
        ),
        tuple(rows),
        "Modes",
        "How resonance and damping ratio move from the lowest amplitude to the highest.",
    )


def _write_range(q: FloatArray, hz: FloatArray, zeta: FloatArray) -> tuple[str, str, str]:
    return (
        f"{format_number(q[0], 3)} .. {format_number(q[-1], 3)}",
        f"{hz[0]:.2f} .. {hz[-1]:.2f}",
        f"{format_number(100 * zeta[0], 3)} .. {format_number(100 * zeta[-1], 3)}",
    )


def _write_command(settings: Mapping[str, Any]) -> list[str]:
    command = ["opid", "resonance", str(settings.get("study") or "STUDY.toml")]
    given = {name: settings[name] for name in ("mode", "hold_out") if settings.get(name) is not None}
    return [*command, *write_options(given), *(["--free-mass"] if settings.get("free_mass") else [])]


def _find_range(result: Resonance) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return amplitudes of a mode from the lowest up, with its frequency, Hz, and damping ratio there."""
    if result.states:
        order = np.argsort(result.amplitude)
        return result.amplitude[order], result.resonance_hz[order], result.damping_ratio[order]
    if result.law is not None:
        return result.law.amplitude, result.law.frequency_hz, result.law.damping_ratio
    return None


def _say_range(result: Resonance) -> str:
    """Return how frequency and damping move with the amplitude, by the levels or, without any, by the law."""
    moved = _find_range(result)
    if moved is None:
        return f"{format_count(len(result.curve_fits), 'response curve')} of mode {result.mode}."
    q, hz, zeta = moved
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
    return " ".join(filter(None, (levels, curves if result.curve_fits else "", _say_mass(result))))


def _say_mass(result: Resonance) -> str:
    if result.modal_mass.value is None:
        return ""
    value, std = format_estimate(result.modal_mass)
    return (
        f"The curves show a modal mass of {value} kg (standard deviation {std}) of the shape as it was given, which is "
        "scaled to 1; the intervals hold this standard deviation."
    )


def _say_levels(result: Resonance) -> str:
    n = len(result.states)
    assert result.appropriation is not None  # There are levels.
    errors = np.abs(result.phase_error_deg)
    at_point = max(abs(each.phase_error_deg) for each in result.appropriation.levels)
    return (
        f"{format_count(n, 'steady level')} in {format_count(len({*result.level_tests}), 'log')}, force at "
        f"{result.drive_point!r}, which the loop held within {at_point:.1f} degrees of quadrature. Other modes move "
        f"it, too, so that the mode itself is up to {errors.max():.1f} degrees off, which is corrected. "
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


def _tabulate_held_out(found: HeldOut) -> Table:
    """Return the prediction of the curve that no law has seen, beside what was measured."""
    rows = [
        ("resonance [Hz]", *_write_prediction(found.resonance_hz, ".3f"), _write_measured(found.measured_hz)),
        (
            "amplitude there [m kg^1/2]",
            *_write_prediction(found.amplitude, ".4g"),
            format_number(found.measured_amplitude, 4),
        ),
    ]
    low, high = found.range_hz
    error = found.error_fraction
    told = f" The prediction is off by {format_percent(abs(error), 2)} of that." if np.isfinite(error) else ""
    reason = f" There is no prediction: {found.reason}." if found.reason else ""
    return Table(
        (
            Column("", align="left"),
            Column("predicted"),
            Column("95 % interval"),
            Column("measured"),
        ),
        tuple(rows),
        f"Prediction of {found.fit.curve.name}",
        f"By the law of {list_names(found.fitted)}, which has not seen this curve; its motion is "
        f"{format_number(found.reach, 3)} times the largest one that was fitted. Over all curves the resonance moves "
        f"by {found.shift_hz:.3f} Hz, from {low:.3f} to {high:.3f} Hz.{told}{reason}",
    )


def _write_prediction(made: Estimate, form: str) -> tuple[str, str]:
    if made.value is None:
        return "-", "-"
    ends = "-" if made.interval95 is None else f"{made.interval95[0]:{form}} .. {made.interval95[1]:{form}}"
    return f"{made.value:{form}}", ends


def _write_measured(seen: Estimate) -> str:
    return "-" if seen.value is None else f"{seen.value:.3f}"


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
            "same forces, and has a gap where the law has no steady motion there.",
            lambda: plots.response_curves(result.curve_fits),
        )
    if (held_out := result.held_out) is not None:
        yield Figure(
            "held_out_curve",
            f"Prediction of {held_out.fit.curve.name}",
            "The curve that no law has seen, and what the law of the others makes of its forces, with a 95 % band.",
            lambda: plots.held_out_curve(held_out),
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
