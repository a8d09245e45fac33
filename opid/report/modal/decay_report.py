"""A free decay as text and as a page with its figure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from opid.estimate import rounded
from opid.modal.decay.fit import DecayLaw
from opid.modal.decay.free_decay import Decay, law_of_decays
from opid.modal.power_laws import unit_of, unit_per_mass
from opid.report.as_text import Row, aligned, labelled, laid_out, table_lines, wrapped
from opid.report.modal.units import coefficient_columns, coefficient_row
from opid.report.page import Page, Picture

ENDS_NOTE = "± is half of the 95 % interval."


def text_of(decay: Decay) -> str:
    """Return a free decay as text: frequency and damping over amplitude, the law, and what to doubt.

    Args:
        decay: from `free_decay`.
    """
    rows = decay_rows(decay)
    return laid_out(
        [decay_title(decay)],
        wrapped(decay_basis(decay)),
        [*aligned(ends_table(decay)), ENDS_NOTE],
        table_lines(rows, coefficient_columns()) if rows else [],
        labelled("Warning: ", decay.warnings),
    )


def page_of(decay: Decay) -> Page:
    """Return what the page of a free decay shows.

    Args:
        decay: from `free_decay`.
    """
    return Page(
        "decay.html.jinja",
        decay_title(decay),
        (_picture(),),
        {
            "basis": decay_basis(decay),
            "table": ends_table(decay),
            "ends_note": ENDS_NOTE,
            "columns": coefficient_columns(),
            "rows": decay_rows(decay),
        },
        decay.warnings,
        command=_command(decay.settings),
    )


def _picture() -> Picture:
    from opid import plots

    return Picture(
        "decay",
        "Record, frequency and damping over amplitude",
        "The record with the amplitude that was followed; natural frequency and damping ratio over it, with 95 % "
        "bands, and what the law makes of them. Where the band is wide the record says little; wiggles beyond it are a "
        "second mode.",
        lambda decay, truth: plots.free_decay_figure(decay, law=_law(decay)),
    )


def _law(decay: Decay) -> DecayLaw | None:
    """The law over the amplitude, for the figure."""
    orders = {name: decay.settings.get(name) for name in ("stiffness_order", "damping_order")}
    return None if decay.law is None else law_of_decays([decay], **orders)


def decay_title(decay: Decay) -> str:
    """Return the headline: log and channel.

    Args:
        decay: the decay.
    """
    return f"Free decay: {decay.name!r} in {Path(str(decay.settings.get('log', 'a record'))).name}"


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
    what = "amplitude" if decay.mode is None else "q"
    head = ("", f"{what} [{decay.amplitude_unit}]", "frequency [Hz]", "±", "damping [%]", "±")
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


def _command(settings: Mapping[str, Any]) -> list[str]:
    """The command that gives this result."""
    given = {name: value for name, value in settings.items() if name != "log" and value is not None}
    options = [word for name, value in given.items() for word in (f"--{name.replace('_', '-')}", str(value))]
    return ["opid", "decay", str(settings.get("log", "LOG")), *options]
