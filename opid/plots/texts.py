"""Texts of a figure that hold names of the user: how long they may be, and what a font cannot draw."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.font_manager import FontProperties, findfont, fontManager, get_font
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter, FixedLocator, LogFormatterSciNotation, NullFormatter

from opid.errors import escape_invisible, shorten_middle
from opid.estimate import RAISED

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
    """Return a text for a figure, in which what is invisible stands as Python writes it.

    A line that is too long loses the middle of its longest word, which is a name, and where that is not enough, its
    own middle.

    >>> shorten("run 'a" + 1000 * "b" + "c', 5 kg", 30), len(shorten(1000 * "ab "))
    ("run 'abbbbbbbbbbb…bbbbc', 5 kg", 84)
    """
    lines = [escape_invisible(line.replace("\t", " ")) for line in re.split(r"\r\n|[\n\r]", text)]
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


def mend_texts(ax: Axes) -> None:
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
