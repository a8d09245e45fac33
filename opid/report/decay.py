"""The report of a free decay."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from opid.estimate import Estimate, format_number, format_percent, rounded
from opid.modal.decay.free_decay import Decay
from opid.modal.decay.law import DecayLaw
from opid.modal.decay.stretch import Beginning
from opid.modal.power_laws import unit_of, unit_per_mass
from opid.report.document import Block, Column, Document, Figure, Paragraph, Row, Table, build_warnings, write_options
from opid.report.estimates import build_estimate_row, format_estimate, tabulate_estimates
from opid.report.sketch import sketch_decay

PER = {"": "", "m": ", per unit mass", "rad": ", per unit of inertia", "strain": ", per unit mass"}
"""What the force of the law is divided by, by the unit of the displacement."""

AMPLITUDES = {"": "displacement", "m": "displacement", "rad": "angle", "strain": "strain"}
"""What the amplitudes are of, likewise."""

KNOWN = 0.5
"""The first sentence tells the damping at amplitudes at which half of its 95 % interval is below this fraction of it:
the last windows before the noise often show a damping of any size and sign."""


BEGINNINGS: Mapping[Beginning, str] = {
    "given": "",
    "impact": "",
    "drive": "The decay begins after a steady motion, which something drove and which is left out. ",
    "force": "The decay begins after the end of the measured force. ",
}


def build_document(decay: Decay) -> Document:
    """Return the report of a free decay: frequency and damping over amplitude, and the law."""
    blocks: list[Block] = [Paragraph(_say_basis(decay)), _tabulate_ends(decay)]
    if decay.repeats and decay.fitted is not None:
        blocks.append(_tabulate_repeats(decay, decay.fitted))
    if decay.law is not None:
        blocks.append(
            tabulate_estimates(
                _list_law_rows(decay),
                legend="The interval holds the value with 95 % if the law holds; beyond the amplitudes of the record "
                "it is an extrapolation.",
            )
        )
    return Document(
        f"Free decay: {decay.name!r} in {_name_source(decay)}",
        "frequency and damping over amplitude",
        _say_change(decay),
        None,
        (*blocks, build_warnings(decay.warnings)),
        lambda: [_build_figure(decay)],
        _write_command(decay.settings),
        source="record",
        sketch=sketch_decay(decay),
    )


def _name_source(decay: Decay) -> str:
    if decay.repeats:
        return f"{len(decay.repeats)} records"
    return Path(str(decay.settings.get("log", "a record"))).name


def _build_figure(decay: Decay) -> Figure:
    def draw() -> Any:
        from opid import plots

        return plots.free_decay_figure(decay, law=decay.fitted)

    return Figure(
        "decay",
        "Record, frequency and damping over amplitude",
        "The record with the amplitude that was followed; natural frequency and damping ratio over it, with 95 % "
        "bands, and what the law makes of them. Where the band is wide the record says little; wiggles beyond it are a "
        "second mode.",
        draw,
    )


def _say_change(decay: Decay) -> str:
    """Return how frequency and damping change over the amplitudes at which the damping is known."""
    amplitude, hz, damping = decay.amplitude, decay.frequency_hz, 100 * decay.damping_ratio
    known = np.flatnonzero(1.96 * decay.damping_std < KNOWN * np.abs(decay.damping_ratio))
    first, last = (known[0], known[-1]) if known.size else (0, -1)
    falls = (
        f"While the amplitude falls from {format_number(amplitude[first], 3)} to {format_number(amplitude[last], 3)} "
        f"{decay.amplitude_unit}"
    )
    if not known.size:
        return f"{falls}, the frequency goes from {rounded(hz[0])} to {rounded(hz[-1])} Hz; the damping is not known."
    hides = "; noise hides the damping at other amplitudes" if last - first < amplitude.size - 1 else ""
    return (
        f"{falls}, frequency and damping go from {rounded(hz[first])} Hz and {format_number(damping[first], 2)} % to "
        f"{rounded(hz[last])} Hz and {format_number(damping[last], 2)} %{hides}."
    )


def _say_basis(decay: Decay) -> str:
    return (
        f"{BEGINNINGS[decay.beginning]}From {format_number(decay.start_s, 4)} to {format_number(decay.stop_s, 4)} s; "
        f"amplitudes are of {AMPLITUDES[decay.length]}. {format_percent(decay.residual_fraction, 2)} of the record "
        "(rms) is neither this mode nor what was found beside it."
    )


def _tabulate_repeats(decay: Decay, law: DecayLaw) -> Table:
    """Frequency and damping at zero amplitude of each repeat, and their scatter."""
    rows = []
    for each in decay.repeats:
        at_zero = ((each.frequency_low_hz, 1.0), (each.damping_low, 100.0))
        rows.append((each.name, *(format_estimate(*low)[0] for low in at_zero)))
    rows.append(("scatter", format_number(law.frequency_scatter_hz, 2), format_number(100 * law.damping_scatter, 2)))
    return Table(
        (Column("repeat", align="left"), Column("frequency at zero", "Hz"), Column("damping at zero", "%")),
        tuple(rows),
        note="Each by its own law; the scatter is the standard deviation between the repeats by their common law. As "
        f"{len(decay.repeats)} repeats alone tell it, the 95 % intervals of k1, c1 and of the values at zero are those "
        f"of Student's t for {len(decay.repeats) - 1} degrees of freedom, wider than 1.96 standard deviations.",
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
            *format_estimate(Estimate.normal(decay.frequency_hz[index], decay.frequency_std_hz[index])),
            *format_estimate(Estimate.normal(decay.damping_ratio[index], decay.damping_std[index]), 100.0),
        )
        for label, index in (("largest", 0), ("smallest", -1))
    ]
    low, damping = decay.frequency_low_hz, decay.damping_low
    if low.value is not None:
        rows.append(("law, at zero", "0", *format_estimate(low), *format_estimate(damping, 100.0)))
    return Table(columns, tuple(rows))


def _list_law_rows(decay: Decay) -> Iterator[Row]:
    unit = partial(unit_per_mass, length=decay.length) if decay.length else unit_of
    yield (f"Law{PER[decay.length]}: x'' + sum of k_n x|x|^(n-1) + sum of c_n x'|x'|^(n-1){_name_joint(decay)} = 0",)
    for letter, estimates in (("k", decay.stiffness), ("c", decay.damping)):
        for power, estimate in sorted(estimates.items()):
            yield build_estimate_row(f"{letter}{power}", unit(letter, power), estimate)
    for name, estimate, per_force in decay.list_joint():
        yield build_estimate_row(name.split(".")[-1].replace("_", " "), per_force, estimate)


def _name_joint(decay: Decay) -> str:
    terms = {"friction": " + friction sgn(x')", "slip": " + slip of an Iwan joint"}
    found = "".join(terms.get(name, "") for name, _, _ in decay.list_joint())
    kind = None if decay.fitted is None else decay.fitted.joint_estimates.named
    return found if kind is None else f"{found} + {kind.words}, whose stiffness before it slides is in k1,"


def _write_command(settings: Mapping[str, Any]) -> list[str]:
    given = {name: value for name, value in settings.items() if name not in ("log", "logs") and value is not None}
    logs = settings.get("logs") or [settings.get("log", "LOG")]
    return ["opid", "decay", *map(str, logs), *write_options(given)]
