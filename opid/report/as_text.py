"""Results as plain text for a terminal of 80 columns."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from opid.estimate import Estimate
from opid.suspensions.one_gear.result import Identification

WIDTH = 80
PARAMETER_LABELS = {
    "sprung_mass_kg": ("sprung mass M2", "kg"),
    "suspension_stiffness_n_per_m": ("stiffness K2", "N/m"),
    "suspension_damping_n_s_per_m": ("damping C2", "N s/m"),
    "ground_stiffness_n_per_m": ("ground K3", "N/m"),
}
RATIO_LABELS = {
    "stiffness_per_mass": ("K2/M2", "1/s^2"),
    "damping_per_mass": ("C2/M2", "1/s"),
    "ground_stiffness_per_mass": ("K3/M2", "1/s^2"),
    "natural_frequency_hz": ("natural freq.", "Hz"),
    "damping_ratio": ("damping ratio", "1"),
}
# what stands in the LaTeX of `opid.mechanics.laws`, in plain text
_PLAIN = (
    (r"\tfrac{2}{\pi}", "(2/pi)"),
    (r"\operatorname{sgn}", "sgn"),
    (r"\dot z", "z'"),
    (r"\arctan", "arctan"),
    (r"\tanh", "tanh"),
    (r"\,", ""),
)

# kinds of law that are named one by one
MOST_NAMED = 6


@dataclass(frozen=True)
class Row:
    """One line of the table of numbers; a heading has no cells.

    Args:
        label: what it is.
        cells: in the order of `columns`.
    """

    label: str
    cells: tuple[str, ...] = ()


def columns(truth: Mapping[str, Any] | None) -> tuple[str, ...]:
    """Return the heads of the columns of `rows`.

    Args:
        truth: as in truth.json, or None.

    >>> columns(None)
    ('', 'value', '±', '95 % interval', 'unit')
    """
    if truth is None:
        return ("", "value", "±", "95 % interval", "unit")
    # the interval tells the ± too, and 80 characters are few
    return ("", "value", "95 % interval", "unit", "truth", "error", "inside")


def rows(result: Identification, truth: Mapping[str, Any] | None = None) -> list[Row]:
    """Return the table of numbers: parameters, law, ratios to the mass.

    Args:
        result: the identification.
        truth: as in truth.json, or None.
    """
    true = truth["parameters"] if truth else {}
    table = [
        estimate_row(*PARAMETER_LABELS[name], estimate, true.get(name), truth is not None)
        for name, estimate in result.parameters.items()
    ]
    table += _law_rows(result, truth)
    table.append(Row("Ratios to the mass of the reference run"))
    table += [
        estimate_row(*RATIO_LABELS[name], estimate, _true_ratio(name, true), truth is not None)
        for name, estimate in result.ratios.items()
    ]
    return table


def result_text(result: Identification, truth: Mapping[str, Any] | None = None) -> str:
    """Return an identification as text: the numbers, what limits them, and what to doubt.

    Args:
        result: the identification.
        truth: of a simulated run, as in truth.json: shown beside each estimate.
    """
    parts = [f"{result.title or 'Identification'} ({result.method})", ""]
    if result.not_determined:
        parts += [*wrapped("Not determined: " + result.not_determined), ""]
    parts += [*table_lines(rows(result, truth), columns(truth)), "", *wrapped(limits(result))]
    sensors = (result.diagnostics["model"] or {}).get("sensors")
    if sensors:
        parts += ["", *wrapped(_sensors(sensors), "Sensors: ")]
    for sentence in result.diagnostics["law_alternatives"]:
        parts += ["", *wrapped(f"{sentence}.", "Law: ")]
    if result.warnings:
        parts += ["", *(line for warning in result.warnings for line in wrapped(warning, "Warning: "))]
    return "\n".join(parts) + "\n"


def _sensors(found: Mapping[str, Any]) -> str:
    """What was found out about the sensors, and what was known of it before."""
    told = []
    for name, each in found.items():
        nominal, tolerance = each["known_before"]
        told.append(f"{name} {each['value']:.5g} +- {each['std']:.1g} (before: {nominal:.3g} +- {tolerance:.1g})")
    return "; ".join(told) + "."


def limits(result: Identification) -> str:
    """Return the sentences that say what the answer rests on.

    Args:
        result: the identification.
    """
    known = result.diagnostics
    noise, floor = known["unexplained_noise_m_per_s2"], known["sensor_noise_floor_m_per_s2"]
    band = known["settings"]["band_hz"]
    n_runs = len(known["runs"])
    averages = min(run["n_averages"] for run in known["runs"])
    tried = known["law_candidates"]
    library = ", ".join(tried) if len(tried) <= MOST_NAMED else f"the {len(tried)} kinds of the library"
    chosen_among = (
        f" Stiffness and damping are the linear part beneath the law, which was chosen among {library} and "
        "their sums; another law would share the force out otherwise."
        if known["settings"]["law"] == "searched"
        else ""
    )
    from_runs = f"From {n_runs} run{'s' * (n_runs > 1)}, {band[0]:.3g} to {band[1]:.3g} Hz: "
    at_most = f"the noise floor of the airframe sensor is at most {_two_digits(1e3 * floor)} mm/s^2"
    if known["model"]:
        white = known["model"]["whiteness"]["white"]
        checked = known["model"]["bootstrap_std_over_white"].get("inverse_mass")
        check = f" (resampled blocks of time give {checked:.2f} times that of the mass)" if checked and white else ""
        given = any(estimate.interval95 for estimate in (*result.parameters.values(), *result.ratios.values()))
        if not given:
            return (
                f"{from_runs}the airframe acceleration is predicted to {_two_digits(1e3 * noise)} mm/s^2 rms, "
                f"{at_most}; the prediction errors are {'white' if white else 'not white'}."
            )
        return (
            f"{from_runs}the airframe acceleration is predicted to {_two_digits(1e3 * noise)} mm/s^2 rms, {at_most}; "
            f"the prediction errors are {'white' if white else 'not white'}. The intervals are those of "
            f"{'such noise' if white else 'errors so coloured'}{check}. "
            + " ".join(f"{sentence[0].upper()}{sentence[1:]}." for sentence in known["model"]["limits"])
            + chosen_among
        )
    return (
        f"{from_runs}the fitted equation leaves {_two_digits(1e3 * noise)} mm/s^2 rms unexplained, {at_most}. Each "
        f"transmissibility rests on {averages:.1f} independent averages (the parameters do not come from it)."
        f"{chosen_among}"
    )


def wrapped(text: str, head: str = "") -> list[str]:
    """Return a paragraph as lines of at most 80 characters, `head` before the first.

    Args:
        text: the paragraph.
        head: the lines after the first are indented by its length.

    >>> wrapped("a " * 50, "Note: ")[1][:8]
    '      a '
    """
    return textwrap.wrap(text, WIDTH, initial_indent=head, subsequent_indent=" " * len(head), break_on_hyphens=False)


def rounded(value: float | None, std: float | None = None) -> str:
    """Return a value with the digits that its standard deviation leaves, or four where there is none.

    Args:
        value: None gives a dash.
        std: two digits of it count.

    >>> rounded(390297.5, 358.4), rounded(0.019941, 5.1e-05), rounded(1234.56), rounded(None)
    ('390300', '0.019941', '1235', '-')
    """
    if value is None or not math.isfinite(value):
        return "-"
    if std is not None and std > 0 and math.isfinite(std):
        decimals = 1 - math.floor(math.log10(std))
    elif value:
        decimals = 3 - math.floor(math.log10(abs(value)))
    else:
        decimals = 0
    number = round(value, decimals) + 0.0  # no -0
    if abs(number) >= 1e8 or 0 < abs(number) < 1e-6:
        digits = max(0, decimals + math.floor(math.log10(abs(number))))
        return f"{number:.{digits}e}"
    return f"{number:.{max(0, decimals)}f}"


def estimate_row(label: str, unit: str, estimate: Estimate, true: float | None = None, with_truth: bool = False) -> Row:
    """Return an estimate as a line of the table.

    Args:
        label: what it is.
        unit: of the value.
        estimate: value and interval.
        true: of a simulated run.
        with_truth: whether the table has columns for the truth.
    """
    std = estimate.std
    interval = estimate.interval95
    between = f"{rounded(interval[0], std)} .. {rounded(interval[1], std)}" if interval else "-"
    value = rounded(estimate.value, std)
    if not with_truth:
        return Row(label, (value, rounded(std, std), between, unit))
    if true is None or estimate.value is None:
        return Row(label, (value, between, unit, "-" if true is None else f"{true:.6g}", "-", "-"))
    error = f"{round(100 * (estimate.value / true - 1), 2) + 0.0:+.2f}%" if true else "-"
    held = "-" if interval is None else "yes" if estimate.holds(true) else "no"
    return Row(label, (value, between, unit, f"{true:.6g}", error, held))


def _law_rows(result: Identification, truth: Mapping[str, Any] | None) -> Iterator[Row]:
    per_mass = result.restoring_force.per_mass
    terms = result.law.terms
    shown = f", {'f/M2' if per_mass else 'f'} = {formula(result.law.latex)}" if len(terms) == 1 else ""
    told = f"; truth: {truth['law']['name']}" if truth and truth["law"]["name"] != result.law.name else ""
    yield Row(f"Law: {result.law.name}{shown}{told}")
    for term in terms:
        if len(terms) > 1:
            yield Row(f"Term {term.name}: {formula(term.kind.latex)}")
        for parameter in term.kind.parameters if term.name in result.law_estimates else ():
            amplitude = parameter.role == "amplitude"
            true = truth["law"]["parameters"].get(term.name, {}).get(parameter.name) if truth else None
            if truth and true is not None and amplitude and per_mass:
                true /= truth["parameters"]["sprung_mass_kg"]
            yield estimate_row(
                # amplitude_n, damping_n_s2_per_m2, stiffness_n_per_m3: the word before the unit
                parameter.name.split("_n")[0] if amplitude else parameter.role,
                f"{parameter.unit}/kg" if amplitude and per_mass else parameter.unit,
                result.law_estimates[term.name][parameter.name],
                true,
                truth is not None,
            )


def formula(latex: str) -> str:
    """Return the LaTeX of a law as plain text.

    Args:
        latex: as in `opid.mechanics.laws`.
    """
    for written, plain in _PLAIN:
        latex = latex.replace(written, plain)
    return latex


def _true_ratio(name: str, true: Mapping[str, float]) -> float | None:
    if not true:
        return None
    mass = true["sprung_mass_kg"]
    stiffness, damping = true["suspension_stiffness_n_per_m"], true["suspension_damping_n_s_per_m"]
    ground = true["ground_stiffness_n_per_m"]
    omega = math.sqrt((stiffness + ground) / mass)
    return {
        "stiffness_per_mass": stiffness / mass,
        "damping_per_mass": damping / mass,
        "ground_stiffness_per_mass": ground / mass,
        "natural_frequency_hz": omega / (2 * math.pi),
        "damping_ratio": damping / (2 * mass * omega),
    }.get(name)


def table_lines(table: Sequence[Row], head: Sequence[str]) -> list[str]:
    """Align the rows that have cells; headings stand between them.

    Args:
        table: the rows.
        head: of the columns.
    """
    lines = iter(aligned([head, *((row.label, *row.cells) for row in table if row.cells)], n_left=1))
    text = [next(lines)]
    for row in table:
        text += [next(lines)] if row.cells else ["", row.label]
    return text


def aligned(table: Sequence[Sequence[str]], *, n_left: int) -> list[str]:
    """Return the rows of a table with aligned columns.

    Args:
        table: the rows, of as many cells each.
        n_left: so many columns to the left, the others to the right.

    >>> aligned([("name", "value"), ("mass", "1850")], n_left=1)
    ['name  value', 'mass   1850']
    """
    widths = [max(len(row[i]) for row in table) for i in range(len(table[0]))]
    return [
        "  ".join(
            cell.ljust(width) if i < n_left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in table
    ]


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"
