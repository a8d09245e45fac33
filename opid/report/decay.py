"""The report of a free decay."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from opid.estimate import format_number, format_percent, rounded
from opid.modal.decay.fit import DecayLaw
from opid.modal.decay.free_decay import Decay, law_of_decays
from opid.modal.power_laws import unit_of, unit_per_mass
from opid.report.document import Block, Column, Document, Figure, Paragraph, Row, Table, build_warnings, write_options
from opid.report.estimates import build_estimate_row, tabulate_estimates
from opid.report.sketch import sketch_decay


def build_document(decay: Decay) -> Document:
    """Return the report of a free decay: frequency and damping over amplitude, and the law."""
    amplitude, hz, damping = decay.amplitude, decay.frequency_hz, 100 * decay.damping_ratio
    blocks: list[Block] = [Paragraph(_say_basis(decay)), _tabulate_ends(decay)]
    if decay.law is not None:
        blocks.append(
            tabulate_estimates(
                _list_law_rows(decay),
                legend="The interval holds the value with 95 % if the law holds; beyond the amplitudes of the record "
                "it is an extrapolation.",
            )
        )
    return Document(
        f"Free decay: {decay.name!r} in {Path(str(decay.settings.get('log', 'a record'))).name}",
        "frequency and damping over amplitude",
        f"While the amplitude falls from {format_number(amplitude[0], 3)} to {format_number(amplitude[-1], 3)} "
        f"{decay.amplitude_unit}, frequency and damping go from {rounded(hz[0])} Hz and "
        f"{format_number(damping[0], 2)} % to {rounded(hz[-1])} Hz and {format_number(damping[-1], 2)} %.",
        None,
        (*blocks, build_warnings(decay.warnings)),
        lambda: [_build_figure(decay)],
        _write_command(decay.settings),
        source="record",
        sketch=sketch_decay(decay),
    )


def _build_figure(decay: Decay) -> Figure:
    def draw() -> Any:
        from opid import plots

        return plots.free_decay_figure(decay, law=_find_law(decay))

    return Figure(
        "decay",
        "Record, frequency and damping over amplitude",
        "The record with the amplitude that was followed; natural frequency and damping ratio over it, with 95 % "
        "bands, and what the law makes of them. Where the band is wide the record says little; wiggles beyond it are a "
        "second mode.",
        draw,
    )


def _find_law(decay: Decay) -> DecayLaw | None:
    orders = {name: decay.settings.get(name) for name in ("stiffness_order", "damping_order")}
    return None if decay.law is None else law_of_decays([decay], **orders)


def _say_basis(decay: Decay) -> str:
    return (
        f"From {format_number(decay.start_s, 4)} to {format_number(decay.stop_s, 4)} s; amplitudes are of "
        f"displacement. {format_percent(decay.residual_fraction, 2)} of the record (rms) is neither this mode nor what "
        "was found beside it."
    )


def _tabulate_ends(decay: Decay) -> Table:
    """Frequency and damping at the largest and the smallest amplitude, and the limit at zero by the law."""
    std = Column("std. dev.")
    columns = (
        Column("", align="left"),
        Column("amplitude" if decay.mode is None else "q", decay.amplitude_unit),
        *(Column("frequency", "Hz"), std),
        *(Column("damping", "%"), std),
    )
    rows = [
        (
            label,
            format_number(decay.amplitude[index], 4),
            *_format_value(decay.frequency_hz[index], decay.frequency_std_hz[index]),
            *_format_value(100 * decay.damping_ratio[index], 100 * decay.damping_std[index]),
        )
        for label, index in (("largest", 0), ("smallest", -1))
    ]
    low, damping = decay.frequency_low_hz, decay.damping_low
    if low.value is not None and damping.value is not None:
        percent = _format_value(100 * damping.value, 100 * (damping.std or 0.0))
        rows.append(("law, at zero", "0", *_format_value(low.value, low.std or 0.0), *percent))
    return Table(columns, tuple(rows))


def _list_law_rows(decay: Decay) -> Iterator[Row]:
    unit, per = (unit_per_mass, ", per unit mass") if decay.mode is None else (unit_of, "")
    yield (f"Law{per}: x'' + sum of k_n x|x|^(n-1) + sum of c_n x'|x'|^(n-1) = 0",)
    for letter, estimates in (("k", decay.stiffness), ("c", decay.damping)):
        for power, estimate in sorted(estimates.items()):
            yield build_estimate_row(f"{letter}{power}", unit(letter, power), estimate)


def _format_value(value: float, std: float) -> tuple[str, str]:
    """A value and its standard deviation, with as many decimals as that leaves."""
    return rounded(float(value), float(std)), rounded(float(std), float(std))


def _write_command(settings: Mapping[str, Any]) -> list[str]:
    given = {name: value for name, value in settings.items() if name != "log" and value is not None}
    return ["opid", "decay", str(settings.get("log", "LOG")), *write_options(given)]
