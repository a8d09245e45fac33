"""Plain text for a terminal of 80 columns: tables, rounded numbers, paragraphs."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from opid.estimate import Estimate, rounded
from opid.mechanics.laws.kinds import Parameter

WIDTH = 80
ROUNDING = 1e-12
"""A standard deviation that is a smaller part of its value is the rounding of numbers: the value is a constant."""

# a path to a file, blanks in it: from a root, a drive, the home or this folder to its ending
_PATH = re.compile(r"(?<!\S)(?:~|\.{1,2}|[A-Za-z]:)?[/\\][^\n:;,'\"]*?\.\w{1,8}(?!\w)")
_NO_BREAK = "\ue000"  # of no text
# what stands in the LaTeX of `opid.mechanics.laws.law`, in plain text
_PLAIN = (
    (r"\tfrac{2}{\pi}", "(2/pi)"),
    (r"\operatorname{sgn}", "sgn"),
    (r"\tfrac12", "1/2"),
    (r"\dot z", "z'"),
    (r"\dot h_u", "h_u'"),
    (r"\dot h", "h'"),
    (r"\overline{h_u}", "mean(h_u)"),
    (r"e^{-(z' / w)^2}", "exp(-(z' / w)^2)"),
    (r"\tau", "tau"),
    (r"\min", "min"),
    (r"\le", "<="),
    ("\\ ", " "),
    (r"\arctan", "arctan"),
    (r"\tanh", "tanh"),
    (r"\,", ""),
)


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
    """Return the heads of the columns of a table of estimates.

    Args:
        truth: as in truth.json, or None.

    >>> columns(None)
    ('', 'value', '±', '95 % interval', 'unit')
    """
    if truth is None:
        return ("", "value", "±", "95 % interval", "unit")
    # the interval tells the ± too, and 80 characters are few
    return ("", "value", "95 % interval", "unit", "truth", "error", "inside")


def wrapped(text: str, head: str = "") -> list[str]:
    """Return a paragraph as lines of at most 80 characters but for longer words (paths), `head` before the first.

    Args:
        text: the paragraph.
        head: the lines after the first are indented by its length.

    >>> wrapped("a " * 50, "Note: ")[1][:8]
    '      a '
    """
    kept = _PATH.sub(lambda path: path[0].replace(" ", _NO_BREAK), text)
    lines = textwrap.wrap(
        kept,
        WIDTH,
        initial_indent=head,
        subsequent_indent=" " * len(head),
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace(_NO_BREAK, " ") for line in lines]


def laid_out(*blocks: Sequence[str]) -> str:
    """Return a text of blocks of lines, with an empty line between them; empty blocks are left out.

    Args:
        blocks: lines of each.

    >>> laid_out(["a gear"], [], ["mass  1850", "K2    4e5"])
    'a gear\\n\\nmass  1850\\nK2    4e5\\n'
    """
    return "\n\n".join("\n".join(block) for block in blocks if block) + "\n"


def labelled(head: str, sentences: Iterable[str]) -> list[str]:
    """Return the lines of some sentences, each behind the same words.

    Args:
        head: before each, "Warning: " say.
        sentences: one or more.

    >>> labelled("Law: ", ["linear.", "cubic."])
    ['Law: linear.', 'Law: cubic.']
    """
    return [line for sentence in sentences for line in wrapped(sentence, head)]


def refusal(reason: str | None) -> list[str]:
    """Return why there is no answer, as lines; none where there is one.

    Args:
        reason: `not_determined` of a result.
    """
    return wrapped(f"Not determined: {reason}") if reason else []


def estimate_row(label: str, unit: str, estimate: Estimate, true: float | None = None, with_truth: bool = False) -> Row:
    """Return an estimate as a line of the table; a constant has neither ± nor interval.

    Args:
        label: what it is.
        unit: of the value.
        estimate: value and interval.
        true: of a simulated run.
        with_truth: whether the table has columns for the truth.
    """
    std, interval = estimate.std, estimate.interval95
    if std is not None and estimate.value is not None and std <= ROUNDING * abs(estimate.value):
        std, interval = None, None  # a constant: it stayed at a bound, or was given
    between = f"{rounded(interval[0], std)} .. {rounded(interval[1], std)}" if interval else "-"
    value = rounded(estimate.value, std)
    if not with_truth:
        return Row(label, (value, rounded(std, std), between, unit))
    if true is None or estimate.value is None:
        return Row(label, (value, between, unit, "-" if true is None else f"{true:.6g}", "-", "-"))
    error = f"{round(100 * (estimate.value / true - 1), 2) + 0.0:+.2f}%" if true else "-"
    held = "-" if interval is None else "yes" if estimate.holds(true) else "no"
    return Row(label, (value, between, unit, f"{true:.6g}", error, held))


def parameter_label(parameter: Parameter) -> str:
    """Return the name of a parameter of a law in words, without its unit.

    Args:
        parameter: of a kind of law.

    >>> from opid.mechanics.laws.law import LAWS
    >>> [parameter_label(each) for each in LAWS["gas_column"].parameters]
    ['static force', 'gas length', 'exponent']
    """
    name = parameter.name
    if parameter.role == "amplitude":
        # amplitude_n, damping_n_s2_per_m2, stiffness_n_per_m3: the word before the unit
        name = name.split("_n")[0]
    return name.removesuffix("_m").removesuffix("_s").removesuffix("_m_per").replace("_", " ")


def formula(latex: str) -> str:
    """Return the LaTeX of a law as plain text.

    Args:
        latex: as in `opid.mechanics.laws.law`.
    """
    for written, plain in _PLAIN:
        latex = latex.replace(written, plain)
    return latex


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
