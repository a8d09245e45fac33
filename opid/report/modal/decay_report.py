"""A free decay as text, JSON and a page with its figure."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from opid.estimate import Estimate
from opid.json_values import json_text, plain
from opid.modal.decay.fit import DecayLaw
from opid.modal.decay.free_decay import Decay
from opid.report.as_text import Row, aligned, rounded, table_lines, wrapped
from opid.report.modal.units import coefficient_columns, coefficient_row, unit_of, unit_per_mass
from opid.report.page import rendered
from opid.signals.directory import write_together

SCHEMA = "opid.decay/1"
ENDS_NOTE = "± is half of the 95 % interval."

Settings = Mapping[str, Any]


def decay_text(decay: Decay, settings: Settings) -> str:
    """Return a free decay as text: frequency and damping over amplitude, the law, and what to doubt.

    Args:
        decay: from `free_decay`.
        settings: what it was made with, by the names of the options of `opid decay`, and `log`.
    """
    parts = [decay_title(decay, settings), "", *wrapped(decay_basis(decay)), ""]
    parts += [*aligned(ends_table(decay), n_left=1), ENDS_NOTE]
    rows = decay_rows(decay)
    if rows:
        parts += ["", *table_lines(rows, coefficient_columns())]
    if decay.warnings:
        parts += ["", *(line for doubt in decay.warnings for line in wrapped(doubt, "Warning: "))]
    return "\n".join(parts) + "\n"


def decay_json(decay: Decay, settings: Settings) -> dict[str, Any]:
    """Return a free decay as the content of result.json.

    Args:
        decay: from `free_decay`.
        settings: as in `decay_text`.

    Returns:
        `schema`, the fields of `decay_fields` (`amplitude`, `frequency_hz`, `damping_ratio` with their standard
        deviations, largest amplitude first; `k`, `c`, `warnings`, ...), `settings`.
    """
    return plain({"schema": SCHEMA, **decay_fields(decay), "settings": settings})


def write_decay_report(
    decay: Decay,
    directory: str | os.PathLike[str],
    settings: Settings,
    *,
    law: DecayLaw | None = None,
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Write result.json, report.html and the figure as PNG, and return the path of the page.

    Args:
        decay: from `free_decay`.
        directory: made if it is not there; all files appear together, any other file in it stays.
        settings: as in `decay_text`.
        law: its law over amplitude, to be drawn (`law_of_decays`).
        progress: called with the name of each step as it begins.

    Raises:
        InputError: a place that cannot be written to.
    """
    from opid import plots
    from opid.plots.style import figure_of, png

    (progress or (lambda step: None))("figure decay")
    images = {"decay": png(figure_of(plots.free_decay_figure(decay, law=law)))}
    page = rendered(
        "decay.html.jinja",
        images,
        title=decay_title(decay, settings),
        basis=decay_basis(decay),
        table=ends_table(decay),
        ends_note=ENDS_NOTE,
        columns=coefficient_columns(),
        rows=decay_rows(decay),
        warnings=decay.warnings,
        command=_command(settings),
    )
    contents = {"decay.png": images["decay"], "report.html": page.encode()}
    # last, so that a result.json is never there without its report
    contents["result.json"] = json_text(decay_json(decay, settings)).encode()
    write_together(directory, contents)
    return Path(directory) / "report.html"


def decay_fields(decay: Decay) -> dict[str, Any]:
    """Return the fields of a free decay for JSON, without its record; `k` and `c` by power, 1 is k0 and c0.

    Args:
        decay: the decay.
    """
    kept = (
        *("name", "mode", "amplitude", "amplitude_unit", "frequency_hz", "frequency_std_hz", "damping_ratio"),
        *("damping_std", "start_s", "stop_s", "residual_share", "law_misfit", "warnings"),
    )
    return {
        **{name: getattr(decay, name) for name in kept},
        "frequency_low_hz": asdict(decay.frequency_low_hz),
        "damping_low": asdict(decay.damping_low),
        **coefficients(decay.stiffness, decay.damping, per_mass=decay.mode is None),
    }


def coefficients(
    stiffness: Mapping[int, Estimate], damping: Mapping[int, Estimate], *, per_mass: bool = False
) -> dict[str, Any]:
    """Return `k` and `c` by power, and their units, for JSON.

    Args:
        stiffness: k_n by its power n.
        damping: c_n by its power n.
        per_mass: whether they are of a sensor's motion, per unit mass, instead of a modal coordinate.
    """
    unit = unit_per_mass if per_mass else unit_of
    return {
        "k": {str(power): asdict(estimate) for power, estimate in stiffness.items()},
        "c": {str(power): asdict(estimate) for power, estimate in damping.items()},
        "units": {f"k{power}": unit("k", power) for power in stiffness}
        | {f"c{power}": unit("c", power) for power in damping},
    }


def decay_title(decay: Decay, settings: Settings) -> str:
    """Return the headline: log and channel.

    Args:
        decay: the decay.
        settings: as in `decay_text`.
    """
    return f"Free decay: {decay.name!r} in {Path(str(settings.get('log', 'a record'))).name}"


def decay_basis(decay: Decay) -> str:
    """Return the sentence that says what was used.

    Args:
        decay: the decay.
    """
    return (
        f"From {decay.start_s:.4g} to {decay.stop_s:.4g} s; amplitudes are of displacement. "
        f"{100 * decay.residual_share:.2g} % of the record (rms) is neither this mode nor what was found beside it."
    )


def ends_table(decay: Decay) -> list[tuple[str, ...]]:
    """Return frequency and damping at the largest and the smallest amplitude, and in the limit that the law gives.

    Args:
        decay: the decay.

    Returns:
        Rows of as many cells each, the heads first; ± is half of the 95 % interval.
    """
    head = ("", f"amplitude [{decay.amplitude_unit}]", "frequency [Hz]", "±", "damping [%]", "±")
    table: list[tuple[str, ...]] = [head]
    for label, place in (("largest", 0), ("smallest", -1)):
        table.append(
            (
                label,
                f"{decay.amplitude[place]:.4g}",
                *_value(decay.frequency_hz[place], decay.frequency_std_hz[place]),
                *_value(100 * decay.damping_ratio[place], 100 * decay.damping_std[place]),
            )
        )
    low, damping = decay.frequency_low_hz, decay.damping_low
    if low.value is not None and damping.value is not None:
        percent = _value(100 * damping.value, 100 * (damping.std or 0.0))
        table.append(("law, at zero", "0", *_value(low.value, low.std or 0.0), *percent))
    return table


def decay_rows(decay: Decay) -> list[Row]:
    """Return the table of the coefficients with their intervals; empty without a law.

    Args:
        decay: the decay.
    """
    return list(_rows(decay))


def _rows(decay: Decay) -> Iterator[Row]:
    if decay.law is None:
        return
    unit, per = (unit_per_mass, ", per unit mass") if decay.mode is None else (unit_of, "")
    yield Row(f"Law{per}: x'' + sum of k_n x|x|^(n-1) + sum of c_n x'|x'|^(n-1) = 0")
    for letter, estimates in (("k", decay.stiffness), ("c", decay.damping)):
        for power, estimate in sorted(estimates.items()):
            yield coefficient_row(f"{letter}{power}", unit(letter, power), estimate)


def _value(value: float, std: float) -> tuple[str, str]:
    """A value with the digits that its standard deviation leaves, and half of its interval with as many decimals."""
    shown = rounded(float(value), float(std))
    return shown, f"{1.96 * float(std):.{len(shown.partition('.')[2])}f}"


def _command(settings: Settings) -> str:
    """The command that gives this result."""
    given = {name: value for name, value in settings.items() if name != "log" and value is not None}
    options = " ".join(f"--{name.replace('_', '-')} {shlex.quote(str(value))}" for name, value in given.items())
    return f"opid decay {shlex.quote(str(settings.get('log', 'LOG')))} {options}"
