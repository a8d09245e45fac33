"""The style of all figures, and what several of them draw alike."""

from __future__ import annotations

import io
import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, fontManager, get_font
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import (
    FixedFormatter,
    FixedLocator,
    FuncFormatter,
    LogFormatterSciNotation,
    LogLocator,
    NullFormatter,
)

from opid.errors import INVISIBLE, NotDeterminedError, shorten_middle
from opid.estimate import RAISED, format_number
from opid.mechanics.truth import TaxiTruth
from opid.suspensions.paper.chain import RunEvidence
from opid.suspensions.paper.result import AnyIdentification
from opid.suspensions.study import Run

# the palette of Okabe & Ito (2008) is distinct for colour-blind readers
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
INK, GREY, PALE = "#222222", "#7A7A7A", "#C4C4C4"
RUN_COLORS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
SURFACE_MAP, COUNT_MAP = "RdBu_r", "cividis"
# a number that would cross a line has this box behind it
BEHIND = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
# the range in which most of the motion lies has this colour
SHADED = "#F1F1F1"
TRAVEL, VELOCITY = "travel z [mm]", "velocity z′ [m/s]"
WIDTH_IN, DPI = 7.4, 150
# this many points at most, about, are drawn in a scatter: more would only make a blot
N_POINTS = 4000

STYLE: Any = {
    "font.family": "sans-serif",
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.5,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "axes.formatter.use_mathtext": False,
    # a "$" in the name of a run is a dollar
    "text.parse_math": False,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.7,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "text.color": INK,
    "lines.linewidth": 1.5,
    "legend.fontsize": 8.5,
    "legend.frameon": True,
    "legend.framealpha": 0.85,
    "legend.edgecolor": "none",
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "agg.path.chunksize": 20000,
}


_DRAWN: ContextVar[list[Axes]] = ContextVar("drawn")


@contextmanager
def house_style() -> Iterator[None]:
    """Draw in the house style within the block; the settings of the user hold again after it.

    When the block ends, every text of the Axes that `panels` or `take_axes` gave is made fit for a figure: names of the
    user are shortened, and lose what no font can draw. Before it only names with less room than a line are (`shorten`).
    """
    drawn: list[Axes] = []
    token = _DRAWN.set(drawn)
    try:
        with rc_context(STYLE):
            yield
            for ax in dict.fromkeys(drawn):
                _mend_texts(ax)
    finally:
        _DRAWN.reset(token)


def take_axes(axes: Iterable[Axes]) -> None:
    """Let the house style mend the texts of these Axes when its block ends."""
    if (drawn := _DRAWN.get(None)) is not None:
        drawn.extend(axes)


def panels(
    axes: Any, rows: int, columns: int = 1, *, height_in: float, width_in: float = WIDTH_IN, **settings: Any
) -> np.ndarray:
    """Return a (rows, columns) array of the given Axes, or of those of a new figure that no backend holds.

    Args:
        axes: an Axes, or Axes in any shape, or None for a new figure.
        rows: of panels.
        columns: of panels.
        height_in: of a new figure, inches.
        width_in: likewise.
        settings: keyword arguments of `matplotlib.figure.Figure.subplots`.

    Raises:
        ValueError: another number of Axes.

    >>> panels(None, 2, 1, height_in=3).shape
    (2, 1)
    """
    if axes is None:
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        made: np.ndarray = figure.subplots(rows, columns, squeeze=False, **settings)
        take_axes(made.ravel())
        return made
    given = np.atleast_1d(np.asarray(axes, dtype=object)).ravel()
    if given.size != rows * columns:
        raise ValueError(f"{given.size} Axes are given and the figure has {rows} x {columns}")
    take_axes(given)
    return given.reshape(rows, columns)


def png(figure: Figure, *, dpi: int = DPI) -> bytes:
    """Return a figure as the bytes of a PNG file.

    Args:
        figure: any figure.
        dpi: dots per inch.

    >>> png(Figure(figsize=(1, 1)))[1:4]
    b'PNG'
    """
    buffer = io.BytesIO()
    # some parts, such as ticks, are made only when a figure is drawn
    with house_style():
        figure.savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()


def figure_of(axes: Axes | np.ndarray) -> Figure:
    """Return the figure that holds the Axes of a plot function.

    Args:
        axes: what a plot function returned.

    >>> float(figure_of(panels(None, 1, height_in=2)).get_figheight())
    2.0
    """
    figure = np.atleast_1d(np.asarray(axes, dtype=object)).ravel()[0].get_figure(root=True)
    assert isinstance(figure, Figure)
    return figure


def thin_samples(n_samples: int, n_points: int = N_POINTS) -> slice:
    """Return the slice that thins `n_samples` to fewer than twice `n_points`.

    >>> len(range(10000)[thin_samples(10000, 4000)])
    5000
    """
    return slice(None, None, max(1, n_samples // n_points))


def panels_in_rows(axes: Any, n_panels: int, columns: int, **settings: Any) -> np.ndarray:
    """Return panels in rows of so many `columns`, as `panels` does; those after the last one that is needed are off."""
    grid = panels(axes, -(-n_panels // columns), columns, **settings)
    for ax in grid.ravel()[n_panels:]:
        ax.set_axis_off()
    return grid


def write_note(ax: Axes, text: str, at: tuple[float, float], shift: tuple[float, float], **style: Any) -> None:
    """Write a text that is shifted by some points on paper from a position in the data."""
    ax.annotate(text, at, shift, textcoords="offset points", **{"fontsize": 8.5, **style})


def name_rows(ax: Axes, names: Sequence[str], colors: Sequence[str], *, chosen: Sequence[bool], **style: Any) -> None:
    """Write names in their colours at the rows of an Axes, which are counted from the top; those chosen are bold."""
    ax.set_yticks(range(len(names)), names, **style)
    for label, color, is_chosen in zip(ax.get_yticklabels(), colors, chosen, strict=True):
        label.set_color(color)
        label.set_fontweight("bold" if is_chosen else "normal")
    ax.set_ylim(len(names) - 0.5, -0.5)
    ax.grid(False, axis="y")


def smooth_lines(frequency_hz: np.ndarray, residual: np.ndarray, width_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the rms of complex lines over a width in Hz, and the frequency in the middle of each, Hz."""
    n = max(1, min(frequency_hz.size, round(width_hz / float(frequency_hz[1] - frequency_hz[0]))))
    power = np.convolve(np.abs(residual) ** 2, np.ones(n), "valid") / n
    return np.convolve(frequency_hz, np.ones(n), "valid") / n, np.sqrt(power)


def build_motion(position: np.ndarray, along: str) -> tuple[np.ndarray, np.ndarray]:
    """Return travel and velocity along "travel" or "velocity", the other one zero: the arguments of a force.

    >>> build_motion(np.ones(1), "velocity")
    (array([0.]), array([1.]))
    """
    zero = np.zeros_like(position)
    return (position, zero) if along == "travel" else (zero, position)


def find_true_scale(truth: TaxiTruth | None, *, per_mass: bool) -> float:
    """Return the factor of true forces, which must be per kg of the sprung mass where those of the result are."""
    return 1.0 / truth.parameters.sprung_mass_kg if truth is not None and per_mass else 1.0


def format_law(name: str) -> str:
    """Return the name of a law with blanks, as it is written in a figure."""
    return name.replace("_", " ").replace("+", " + ")


def format_minus(text: str) -> str:
    """Return a text with the sign minus in the place of each hyphen."""
    return text.replace("-", "−")


def require_answer(result: AnyIdentification) -> None:
    """Refuse to draw a fit of which the identification gives no number.

    Raises:
        NotDeterminedError: it was refused.
    """
    if result.is_refused:
        reason = result.not_determined or f"it leaves {result.residual_over_noise:.0f} times the sensors' noise"
        raise NotDeterminedError(f"there is no fit to draw: {reason}")


def choose_run_colors(n_runs: int) -> list[str]:
    """Return one colour a run, from the palette over and over.

    >>> choose_run_colors(2) == [BLUE, VERMILION]
    True
    """
    return [RUN_COLORS[i % len(RUN_COLORS)] for i in range(n_runs)]


def format_run(run: RunEvidence | Run) -> str:
    """Return the name of a run with its mass against the reference."""
    change = (
        "reference mass"
        if run.mass_change_kg == 0
        else format_minus(f"{format_number(run.mass_change_kg, has_sign=True)} kg")
    )
    return f"run {run.name!r}, {change}"


def thicken(legend: Legend) -> None:
    """Show the colours of thin lines and small dots in a legend."""
    for handle in legend.legend_handles:
        if isinstance(handle, Line2D):
            handle.set_linewidth(max(handle.get_linewidth(), 2.0))
            handle.set_markersize(max(handle.get_markersize(), 5.0))
            handle.set_alpha(1)


_UNIT = r"(?<![^\W\d_])(?:[kMGmµucdn]?(?:m|s|g|N|Hz|Pa|V|J|W|A|rad)|in|ft|lbf|K)"


def format_units(unit: str, *, only: bool = False) -> str:
    """Return a unit, or a text with units, in print.

    Args:
        unit: the text.
        only: whether nothing but a power or a product of known units is changed, because the text may be a name.

    >>> format_units("N s^2/m^2"), format_units("a*b^2, kg*m^2", only=True)
    ('N s²/m²', 'a*b^2, kg·m²')
    """
    if only:
        powers = rf"{_UNIT}\^(?:\d+(?:\.\d+)?(?:/2)?|n)(?!\w)|{_UNIT}\*(?={_UNIT}(?!\w))"
        return re.sub(powers, lambda found: format_units(found[0]), unit)
    # exponents like "^2.5" and "^n" count, too: a raised point does not exist, so that a dot above stands for it
    raised = re.sub(r"\^(\d+(?:\.\d+)?|n)", lambda power: power[1].translate(RAISED), unit.replace("kg^1/2", "√kg"))
    return raised.replace("*", "·")


def plain_numbers(axis: Axis) -> None:
    """Write the numbers at a logarithmic axis without powers of ten, at 1, 2 and 5 of each decade."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: format_number(value)))
    axis.set_minor_formatter(NullFormatter())


# ---- texts that hold names of the user ---------------------------------------------------------------

LONGEST_LINE, MOST_LINES, LEAST_WORD = 84, 8, 12
"""Letters of a line of a figure, and its lines, more would leave no room for the curves; letters that a word keeps."""

LONGEST_ENTRY, LONGEST_NOTE = 48, 64
"""Letters of an entry of a legend, and of a note at a point: both lie over the curves, or beside others."""

LONGEST_NAMES = (56, 30, 20)
"""Letters of a name at a row where one, two, or more panels stand beside each other: it takes its room from them."""

LETTER_IN, LEAST_TITLE = 0.08, 34
"""Mean width of a bold letter of 10 points, inches, and the letters of a title that a panel has room for
in any case: a title may be as long as its panel is wide."""

LACKING = "□"
"""What is drawn in the place of a character that no font has."""

# Families with the scripts that the font of matplotlib lacks, on the usual systems. Fonts of coloured emoji are not
# among them: matplotlib cannot draw those.
_OTHER_FAMILIES = (
    "Noto Sans CJK SC", "Noto Sans CJK JP", "Noto Sans CJK KR", "Noto Sans SC", "Noto Sans JP", "Noto Sans KR",
    "Source Han Sans SC", "WenQuanYi Zen Hei", "WenQuanYi Micro Hei", "IPAGothic", "NanumGothic", "Droid Sans Fallback",
    "Microsoft YaHei", "Yu Gothic", "Malgun Gothic", "PingFang SC", "Hiragino Sans", "Apple SD Gothic Neo",
    "Arial Unicode MS", "Noto Sans Devanagari", "Noto Sans Thai", "Noto Sans Hebrew", "Noto Sans Arabic", "Noto Emoji",
    "Segoe UI Symbol", "Symbola", "FreeSans", "FreeSerif", "Unifont",
)  # fmt: skip


class PlainPowers(LogFormatterSciNotation):
    """Powers of ten at a logarithmic axis with raised digits, which need no mathematics of matplotlib."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Return the text of a tick."""
        found = re.search(r"(?:(-?[\d.]+)\s*\\times\s*)?10\^\{(-?\d+)\}", text := super().__call__(x, pos))
        if not found:
            return re.sub(r"\$|\\mathdefault\{([^}]*)\}", r"\1", text)
        factor = f"{found[1]}×" if found[1] else ""
        return f"{factor}10{found[2].translate(RAISED)}"


class NamedTicks(FixedFormatter):
    """Names at an axis as a figure shows them, which remembers them as a page can show them."""

    def __init__(self, names: Sequence[str], written: Sequence[str]) -> None:
        super().__init__(names)
        self.written = list(written)


def shorten(text: str, most: int = LONGEST_LINE) -> str:
    """Return a text for a figure, without what is invisible.

    A line that is too long loses the middle of its longest word, which is a name, and where that is not enough, its
    own middle.

    >>> shorten("run 'a" + 1000 * "b" + "c', 5 kg", 30), len(shorten(1000 * "ab "))
    ("run 'abbbbbbbbbbb…bbbbc', 5 kg", 84)
    """
    lines = [INVISIBLE.sub("", line.replace("\t", " ")) for line in re.split(r"\r\n|[\n\r]", text)]
    kept = lines[:MOST_LINES] if len(lines) <= MOST_LINES else [*lines[: MOST_LINES - 1], "…"]
    return "\n".join(_cut_line(line, most) for line in kept)


def _cut_line(line: str, most: int) -> str:
    if len(line) > most:
        longest = max(line.split(" "), key=len)
        line = line.replace(longest, shorten_middle(longest, max(LEAST_WORD, len(longest) + most - len(line))), 1)
    return shorten_middle(line, most)


def find_written_text(text: Text) -> str:
    """Return a text of a figure as a page can show it, which has fonts for every script."""
    return str(text.get_gid() or text.get_text())


def _mend_texts(ax: Axes) -> None:
    """Shorten the texts of an Axes, of its legend and colour bars, and draw those characters that a font has."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    bars = [each for each in figure.axes if getattr(each, "_colorbar", None) is not None]
    spec = ax.get_subplotspec()
    beside = 1 if spec is None else spec.get_gridspec().ncols
    widths = np.ones(1) if spec is None else np.array(spec.get_gridspec().get_width_ratios(), dtype=float)
    part = 1.0 if spec is None else float(widths[spec.colspan.start : spec.colspan.stop].sum() / widths.sum())
    room_in = figure.get_figwidth() * part - 0.4
    title = min(LONGEST_LINE, max(int(room_in / LETTER_IN), LEAST_TITLE))
    for artist in ax.get_children():
        label = artist.get_label()
        if isinstance(label, str) and not label.startswith("_") and label != (short := shorten(label, LONGEST_ENTRY)):
            artist.set_label(short)
    for legend in (ax.get_legend(), *figure.legends):
        for each in () if legend is None else legend.get_texts():
            _mend_text(each, LONGEST_ENTRY)
    any_axes: Any
    for any_axes in (ax, *bars):
        for text in (any_axes.title, any_axes._left_title, any_axes._right_title):
            _mend_text(text, title)
        for text in any_axes.texts:
            _mend_text(text, LONGEST_NOTE)
        for axis in any_axes._axis_map.values():
            _mend_text(axis.label, max(title, LONGEST_ENTRY))
            _mend_ticks(axis, LONGEST_NAMES[min(beside, 3) - 1])


def _mend_text(text: Text, most: int) -> None:
    written = shorten(text.get_text(), most)
    shown, families = _find_glyphs(written, text.get_fontproperties())
    if families:
        text.set_fontfamily(families)
    if shown != text.get_text():
        text.set_text(shown)
    if shown != written:
        text.set_gid(written)


def _mend_ticks(axis: Any, most: int) -> None:
    """Mend the names at an axis, and write its powers of ten without mathematics."""
    for is_minor, formatter in ((False, axis.get_major_formatter()), (True, axis.get_minor_formatter())):
        if type(formatter) is LogFormatterSciNotation:
            same: Any = formatter
            plain = PlainPowers(same._base, same.labelOnlyBase, same.minor_thresholds, same._linthresh)
            (axis.set_minor_formatter if is_minor else axis.set_major_formatter)(plain)
    locator, formatter = axis.get_major_locator(), axis.get_major_formatter()
    if not isinstance(locator, FixedLocator) or isinstance(formatter, NamedTicks | NullFormatter):
        return
    texts = formatter.format_ticks(locator())
    written = [shorten(each, most if axis.axis_name == "y" else min(most, LONGEST_NAMES[1])) for each in texts]
    found = [_find_glyphs(each, axis.label.get_fontproperties()) for each in written]
    shown = [each for each, _ in found]
    if shown != list(texts):
        axis.set_major_formatter(NamedTicks(shown, written))
    families = next((each for _, each in found if each), None)
    for tick, name in zip(axis.get_major_ticks(len(shown)), shown, strict=False) if shown != list(texts) else ():
        tick.label1.set_text(name)
    if families:
        axis.set_tick_params(labelfontfamily=families)


def _find_glyphs(text: str, font: FontProperties) -> tuple[str, list[str]]:
    """Return a text without the characters that no font has, and the families that it needs beside the usual one."""
    if text.isascii():
        return text, []
    known = _list_glyphs(findfont(font))
    if not (lacking := {ord(each) for each in text} - known - {10}):
        return text, []
    families = []
    for family in _find_families():
        if found := lacking & _list_glyphs(findfont(family)):
            lacking -= found
            families.append(family)
    composed = dict.fromkeys(lacking, LACKING) | {
        each: None for each in lacking if unicodedata.category(chr(each)) in ("Mn", "Me", "Cf")
    }
    return text.translate(composed), [*font.get_family(), *families] if families else []


@cache
def _list_glyphs(path: str) -> frozenset[int]:
    return frozenset(get_font(path).get_charmap())


@cache
def _find_families() -> tuple[str, ...]:
    there = {each.name for each in fontManager.ttflist}
    return tuple(each for each in _OTHER_FAMILIES if each in there)
