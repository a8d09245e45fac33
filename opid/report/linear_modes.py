"""The report of linear modes fitted to measured frequency responses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from opid.errors import list_names
from opid.estimate import format_number, format_percent, rounded
from opid.modal.linear.fitted_modes import FittedModes
from opid.modal.linear.frequency_response import cmif, weigh_response
from opid.modal.linear.modes import ACCELERATION
from opid.modal.linear.stages import ModeStages
from opid.report.document import (
    Block,
    Column,
    Document,
    Figure,
    Paragraph,
    Row,
    Table,
    build_warnings,
    format_count,
)
from opid.report.estimates import format_estimate
from opid.report.nonlinear_modes import PACINI

MODES_IN_A_TABLE = 5
"""Shapes beside each other, in 80 columns."""


def build_document(result: FittedModes | ModeStages) -> Document:
    """Return the report: frequency, damping, modal mass and shape of each mode, and the responses beside the fit.

    Of several stages it begins with what moved between them.
    """
    return _build_one(result) if isinstance(result, FittedModes) else _build_stages(result)


def _build_stages(result: ModeStages) -> Document:
    several = list(zip(result.stages, result.each_stage, strict=True))
    blocks = [_name_stage(block, name) for name, each in several for block in _list_blocks(each)]
    low_hz, high_hz = (format_number(each, 4) for each in result.each_stage[0].band_hz)
    return Document(
        f"Linear modes at {format_count(len(several), 'stage')}: {list_names(result.stages)}",
        "what moved between the stages of a campaign",
        f"Modes between {low_hz} and {high_hz} Hz, each stage by its own records.",
        None,
        (_tabulate_stages(result), *blocks, build_warnings(result.warnings)),
        lambda: [
            _build_stage_figure(result),
            *(_name_stage(_build_figure(each, f"_{number}"), name) for number, (name, each) in enumerate(several, 1)),
        ],
        _write_command(result.settings),
        source="record",
        reference=f"The comparison of stages is that of {PACINI}",
    )


def _name_stage(block: Block, name: str) -> Block:
    """Return a block of the report of one stage with the stage in its heading."""
    if isinstance(block, Table):
        return replace(block, title=f"{name}: {block.title or 'modes'}")
    if isinstance(block, Paragraph):
        return replace(block, heading=name)
    return replace(block, heading=f"{name}: {block.heading}") if isinstance(block, Figure) else block


def _tabulate_stages(result: ModeStages) -> Table:
    """Return how each mode of the first stage moved."""
    rows = []
    for stage, shifts in zip(result.stages[1:], result.shifts, strict=True):
        for each in shifts:
            mac = "-" if each.mac is None else f"{each.mac:.3f}"
            there = "-" if each.number is None else str(each.number)
            changes = (*format_estimate(each.frequency, 100.0), *format_estimate(each.damping, 100.0))
            rows.append((stage, str(each.mode), there, *changes, mac))
    return Table(
        (
            *(Column("stage", align="left"), Column("mode"), Column("there")),
            *(Column("frequency", "%"), Column("std. dev.")),
            *(Column("damping", "%"), Column("std. dev.")),
            Column("MAC"),
        ),
        tuple(rows),
        title=f"Changes since {result.stages[0]}",
        legend="Modes have the numbers of the first stage; in column there is the number of the like mode at the other "
        "stage, if it has one.",
    )


def _build_stage_figure(result: ModeStages) -> Figure:
    def draw() -> Any:
        from opid import plots

        drives = [{response.drive_point: response for response in each.responses} for each in result.each_stage]
        common = [name for name in drives[0] if all(name in each for each in drives)]
        shown = [each[common[0]] if common else next(iter(each.values())) for each in drives]
        first = result.each_stage[0]
        marked = {number: each.value or 0.0 for number, each in enumerate(first.frequency_hz, start=1)}
        return plots.stage_responses(dict(zip(result.stages, shown, strict=True)), marked)

    return Figure(
        "stages",
        "The drive point at every stage",
        "Size of the measured response at the drive point. A peak that moves is a structure that changed between the "
        "stages; lines are the modes of the first stage, by number.",
        draw,
    )


def _build_one(result: FittedModes) -> Document:
    low_hz, high_hz = (format_number(each, 4) for each in result.band_hz)
    drives = list_names([each.drive_point for each in result.responses])
    n = len(result.frequency_hz)
    return Document(
        f"Linear modes from responses to forces at {drives}",
        "natural frequencies, damping ratios, modal masses and shapes",
        f"{format_count(n, 'mode')} {'lies' if n == 1 else 'lie'} between {low_hz} and {high_hz} Hz.",
        None,
        (*_list_blocks(result), build_warnings(result.warnings)),
        lambda: [_build_figure(result)],
        _write_command(result.settings),
        source="record",
    )


def _list_blocks(result: FittedModes) -> Iterator[Block]:
    yield Paragraph(_say_basis(result))
    yield Table(
        (
            Column("mode"),
            *(Column("frequency", "Hz"), Column("std. dev.")),
            *(Column("damping", "%"), Column("std. dev.")),
            *(Column("modal mass", "kg"), Column("std. dev.")),
        ),
        tuple(_list_rows(result)),
        legend="The modal mass belongs to a shape that is 1 at the drive point; its standard deviation holds "
        "1.4 % for the calibrations of force and acceleration.",
    )
    yield from _tabulate_shapes(result)
    yield _tabulate_sensors(result)


def _say_basis(result: FittedModes) -> str:
    averages = [each.n_averages for each in result.responses]
    records = f"{', '.join(f'{each:g}' for each in averages)} record{'s' * (sum(averages) != 1)}"
    left = ", ".join(format_percent(each, 2) for each in result.unexplained)
    delay, std = format_estimate(result.delay_s, 1e6)
    return (
        f"From {records} and {format_count(len(result.sensors), 'sensor')}; the modes leave {left} of the responses "
        f"(rms) in the band. The delay of the accelerations after the force is {delay} µs (standard deviation {std} "
        f"µs); it is fitted. {_say_assumption(result)}"
    )


def _say_assumption(result: FittedModes) -> str:
    """Say what the scale of the shapes takes for granted, where one drive point alone cannot prove it."""
    if not result.has_scale:
        return "The shapes have no scale, and no modal masses are given, see the warnings."
    if len(result.responses) > 1:
        return "That each force acted at its drive point is shown by the responses to the others."
    name = result.responses[0].drive_point
    others = [each for each in result.drive_candidates[0] if each != name]
    same = (
        f"which {list_names(map(repr, others))} would show as well, so that this is not proved"
        if others
        else "and no other sensor shows that"
    )
    return (
        f"Masses and the scale of the shapes assume that the force acted at {name!r} and in its direction: the modes "
        f"have positive masses there, {same}."
    )


def _tabulate_shapes(result: FittedModes) -> Iterator[Table]:
    """Yield the shapes, some modes beside each other in a table."""
    n = len(result.frequency_hz)
    gauges = [name for name, unit in zip(result.sensors, result.units, strict=True) if unit != ACCELERATION]
    of_strains = f" (of the strains {list_names(map(repr, gauges))} 1/m kg^-1/2)" if gauges else ""
    title = (
        f"Mass-normalised shapes, kg^-1/2{of_strains}"
        if result.has_scale
        else "Shapes without a scale, 1 at the largest sensor"
    )
    for first in range(0, n, MODES_IN_A_TABLE):
        some = range(first, min(first + MODES_IN_A_TABLE, n))
        yield Table(
            (Column("sensor", align="left"), *(Column(f"mode {k + 1}") for k in some)),
            tuple(
                (name, *(_write_shape(float(result.shapes[row, k]), float(result.shape_std[row, k])) for k in some))
                for row, name in enumerate(result.sensors)
            ),
            title=title if first == 0 else "",
            legend=""
            if some.stop < n
            else "They are rounded by their standard deviations; where the records differ, or one mode was "
            "found as two, they have none, and are given with two digits.",
        )


def _write_shape(value: float, std: float) -> str:
    """Write a value of a shape with the digits that count."""
    return rounded(value, std) if math.isfinite(std) or not math.isfinite(value) else f"≈ {format_number(value, 2)}"


def _tabulate_sensors(result: FittedModes) -> Table:
    """Return what the modes leave of each sensor, and its delay."""
    return Table(
        (
            Column("sensor", align="left"),
            *(Column(name, "%") for name in ("unexplained", "by noise")),
            *(Column("delay", "µs"), Column("std. dev.")),
        ),
        tuple(
            (
                name,
                *(format_number(100 * each, 2) for each in (misfit.unexplained, misfit.noise)),
                *format_estimate(delay, 1e6),
            )
            for name, misfit, delay in zip(result.sensors, result.misfits, result.sensor_delay_s, strict=True)
        ),
        title="What the modes leave of the responses of each sensor (rms)",
        legend="The delay of a sensor is that after the others; it has none where the responses ask for none.",
    )


def _list_rows(result: FittedModes) -> Iterator[Row]:
    columns = zip(result.frequency_hz, result.damping_ratio, result.modal_mass_kg, strict=True)
    for number, (frequency, damping, mass) in enumerate(columns, start=1):
        yield (str(number), *format_estimate(frequency), *format_estimate(damping, 100.0), *format_estimate(mass))


def _build_figure(result: FittedModes, suffix: str = "") -> Figure:
    def draw() -> Any:
        from opid import plots

        responses, fitted = (
            [weigh_response(each, result.relative_modes) for each in several]
            for several in (result.responses, result.fitted)
        )
        measured = {"measured": cmif(responses)}
        marked = {number: each.value or 0.0 for number, each in enumerate(result.frequency_hz, start=1)}
        return plots.mode_indicators(measured, cmif(fitted), marked=marked, title="Modes by number")

    return Figure(
        f"mode_indicator{suffix}",
        "Measured responses and the modes",
        "Largest singular value of all responses at each line (complex mode indicator function), measured and of the "
        "fitted modes. A peak without a number is a mode that was left out, or no mode.",
        draw,
    )


def _write_command(settings: Mapping[str, Any]) -> list[str]:
    words = ["opid", "modes", *map(str, settings.get("logs", ["LOG"]))]
    for drive_point in settings.get("drive_points", ()):
        words += ["--drive-point", str(drive_point)]
    if "band" in settings:
        words += ["--band", *(f"{each:g}" for each in settings["band"])]
    words += [word for channel, unit in settings.get("units", ()) for word in ("--unit", f"{channel}={unit}")]
    words += [word for stage in settings.get("stages", ()) for word in ("--stage", str(stage))]
    if settings.get("time_unit") is not None:
        words += ["--time-unit", str(settings["time_unit"])]
    return words + (["--force-channel", str(settings["force_channel"])] if settings else [])
