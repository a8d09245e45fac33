"""Colours, markers, texts and numbers of matplotlib in the notation of Plotly.js."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colors
from matplotlib.artist import Artist
from matplotlib.collections import Collection, PathCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text
from numpy.typing import ArrayLike

Json = dict[str, Any]
"""A part of a chart, ready for `json.dumps`."""

PX_PER_PT = 4 / 3
"""Pixels of the page per point of a figure."""

WHITE = "#ffffff"
"""The face of a hollow marker that hides what is below it."""

CLEAR = (0.0, 0.0, 0.0, 0.0)
"""No colour."""

# arrays up to this length are written as decimal numbers, and those above the second one in 16 bits
_SHORT, _LONG = 60, 3000
_DASHES = {"-": "solid", "--": "dash", ":": "dot", "-.": "dashdot"}
_MARKERS = {
    "o": "circle", ".": "circle", ",": "circle", "s": "square", "D": "diamond", "d": "diamond-tall", "^": "triangle-up",
    "v": "triangle-down", "<": "triangle-left", ">": "triangle-right", "+": "cross-thin", "x": "x-thin",
    "|": "line-ns", "_": "line-ew", "*": "star", "P": "cross", "X": "x",
}  # fmt: skip
_THIN = ("cross-thin", "x-thin", "line-ns", "line-ew")
_NOTHING = ("None", "", " ")


def format_color(color: Any) -> str:
    """Return a colour of matplotlib as "#rrggbb", or with its opacity.

    >>> format_color("white"), format_color((0, 0, 1, 0.5))
    ('#ffffff', 'rgba(0,0,255,0.5)')
    """
    red, green, blue, alpha = colors.to_rgba(color)
    if alpha == 1:
        return colors.to_hex((red, green, blue))
    return f"rgba({round(255 * red)},{round(255 * green)},{round(255 * blue)},{alpha:.3g})"


def is_clear(color: Any) -> bool:
    """Return whether a colour is fully transparent."""
    return colors.to_rgba(color)[3] == 0


def format_html(text: str) -> str:
    """Return a text as the few tags that Plotly.js knows; a "%{x}" in it stands for no number of a point.

    >>> format_html("a < b\\n%{x}")
    'a &lt; b<br>%&#123;x}'
    """
    text = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return text.replace("\n", "<br>").replace("%{", "%&#123;")


def format_bold(text: str, artist: Text) -> str:
    """Return a text in bold where its artist is bold."""
    return f"<b>{text}</b>" if str(artist.get_fontweight()) in ("bold", "700") else text


def find_unit(label: str) -> str:
    """Return the unit in brackets of a label with a blank before it; empty if there is none.

    >>> find_unit("travel z [mm]"), find_unit("coherence")
    (' mm', '')
    """
    found = re.search(r"\[([^\]]+)\]", label)
    return f" {format_html(found[1])}" if found else ""


def find_label(artist: Artist) -> str:
    """Return the label of an artist, or of the curve that its `gid` names; empty if it belongs to none."""
    text = str(artist.get_label() or "")
    return str(artist.get_gid() or "") if not text or text.startswith("_") else text


def has_line(artist: Line2D) -> bool:
    """Return whether a line is drawn between the points."""
    return str(artist.get_linestyle()) not in _NOTHING and artist.get_linewidth() > 0


def has_marker(artist: Line2D) -> bool:
    """Return whether a marker is drawn at each point."""
    return str(artist.get_marker()) not in _NOTHING and artist.get_markersize() > 0


def describe_line(artist: Line2D) -> Json:
    """Return colour, width and dashes of a line."""
    dash = _DASHES.get(str(artist.get_linestyle()), "dash")
    return {
        "color": format_color(artist.get_color()),
        "width": round(artist.get_linewidth() * PX_PER_PT, 2),
        "dash": dash,
    }


def describe_marker(artist: Line2D) -> Json:
    """Return symbol, size and colours of the markers of a line."""
    marker, size = str(artist.get_marker()), artist.get_markersize() * PX_PER_PT
    face, edge = artist.get_markerfacecolor(), artist.get_markeredgecolor()
    symbol = _MARKERS.get(marker, "circle")
    is_thin, is_open = symbol in _THIN, is_clear(face)
    has_edge = is_thin or is_open or format_color(face) != format_color(edge)
    return {
        "symbol": f"{symbol}-open" if is_open and not is_thin else symbol,
        "size": round(size / 2 if marker in (".", ",") else size, 1),
        "color": format_color(edge if is_thin or is_open else face),
        "line": {
            "width": round(artist.get_markeredgewidth() * PX_PER_PT, 1) if has_edge else 0,
            "color": format_color(edge),
        },
    }


def describe_handle(handle: Artist | None) -> Json:
    """Return how the handle of a legend looks: its colour, and a line or a symbol."""
    if isinstance(handle, Line2D):
        look: Json = {"color": format_color(handle.get_color())}
        if has_line(handle):
            look["dash"] = describe_line(handle)["dash"]
        if has_marker(handle):
            look["symbol"] = describe_marker(handle)["symbol"]
            if format_color(handle.get_markerfacecolor()) == WHITE:
                look["symbol"] += "-open"
        return look
    if isinstance(handle, Patch):
        return {"color": format_color(handle.get_facecolor()), "symbol": "patch"}
    assert isinstance(handle, Collection)
    if isinstance(handle, PathCollection):
        return {"color": format_color(np.atleast_2d(handle.get_facecolor())[0]), "symbol": "circle"}
    return {"color": format_color(np.atleast_2d(handle.get_edgecolor())[0]), "dash": "solid"}


def describe_colormap(cmap: Any) -> list[list[Any]]:
    """Return a colour map at 17 places from 0 to 1."""
    return [[float(at), format_color(cmap(float(at)))] for at in np.linspace(0, 1, 17)]


def encode_numbers(values: ArrayLike) -> Any:
    """Return (n,) numbers as the page decodes them: few as a list, more as bytes.

    Sixteen bits distinguish 65,000 steps between the least and the largest value, as many as most recorders do.
    """
    array = fill_masked(values)
    if array.size <= _SHORT:
        return [float(f"{each:.7g}") if np.isfinite(each) else None for each in array.tolist()]
    if array.size <= _LONG or not np.isfinite(array).all():
        return {"dtype": "f4", "bdata": _encode_bytes(array.astype("<f4"))}
    low, step = float(array.min()), float(np.ptp(array)) / 65535 or 1.0
    return {
        "dtype": "u2",
        "low": low,
        "step": step,
        "bdata": _encode_bytes(np.round((array - low) / step).astype("<u2")),
    }


def encode_abscissae(x: np.ndarray) -> Json:
    """Return the abscissae of a line: their first value and their step where they are evenly spaced, else all."""
    steps = np.diff(x)
    if x.size > _SHORT and np.isfinite(x).all() and np.ptp(steps) <= 1e-6 * abs(steps[0]):
        return {"x0": float(x[0]), "dx": float((x[-1] - x[0]) / (x.size - 1))}
    return {"x": encode_numbers(x)}


def encode_matrix(values: np.ndarray) -> Json:
    """Return a matrix (m, n) as bytes with its shape."""
    shape = f"{values.shape[0]}, {values.shape[1]}"
    return {"dtype": "f4", "bdata": _encode_bytes(np.ascontiguousarray(values, dtype="<f4")), "shape": shape}


def fill_masked(values: ArrayLike) -> np.ndarray:
    """Return values as floats, NaN where they are masked."""
    return np.asarray(np.ma.filled(np.ma.asarray(values, dtype=float), np.nan))


def join_lines(parts: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the coordinates of several polylines one after the other, with a gap of NaN between them."""
    gap = np.full((1, 2), np.nan)
    points = np.concatenate([part for each in parts for part in (np.asarray(each, dtype=float), gap)])[:-1]
    return points[:, 0], points[:, 1]


def _encode_bytes(array: np.ndarray) -> str:
    return base64.b64encode(array.tobytes()).decode()
