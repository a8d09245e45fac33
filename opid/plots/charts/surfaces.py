"""A surface of quadrangles, and its triangles that a reader can turn."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from opid.plots.charts.artists import UnknownArtistError
from opid.plots.charts.looks import Json, encode_numbers, format_color, format_html
from opid.signals.recording import FloatArray

_LOOK = {"aspectmode": "manual", "aspectratio": {"x": 1.1, "y": 1.1, "z": 0.8}}
# far enough that the words at the axes are within the chart
_CAMERA = {"eye": {"x": 1.5, "y": -1.6, "z": 0.8}, "center": {"x": 0.0, "y": 0.0, "z": -0.17}}


class Surface(Poly3DCollection):
    """Quadrangles that are coloured by a value of each.

    matplotlib tells of a surface in three dimensions nothing but its projection, so this one keeps its corners.

    Args:
        faces: (n, 4, 3) corners, which go round.
        values: (n,) numbers that a colour map shows.
        looks: what `Poly3DCollection` takes.
    """

    def __init__(self, faces: FloatArray, values: FloatArray, **looks: Any) -> None:
        super().__init__(faces, **looks)
        self.set_array(values)
        self.faces = np.asarray(faces)


def add_surfaces(chart: Json, ax: Axes) -> None:
    """Add the surfaces of an Axes in three dimensions to a chart.

    Raises:
        UnknownArtistError: it holds something else.
    """
    labels = {
        f"{letter}axis": {"title": {"text": format_html(getattr(ax, f"get_{letter}label")())}} for letter in "xyz"
    }
    chart["layout"]["scene"] = labels | _LOOK | {"camera": _CAMERA}
    for artist in ax.collections:
        if not isinstance(artist, Surface):
            raise UnknownArtistError(artist)
        chart["data"].append(_build_mesh(artist))


def _build_mesh(surface: Surface) -> Json:
    points = surface.faces.reshape(-1, 3)
    firsts = 4 * np.arange(len(surface.faces))
    # each face is two triangles that begin at its first corner
    fans = np.stack([firsts, firsts + 1, firsts + 2, firsts, firsts + 2, firsts + 3], axis=1).reshape(-1, 3)
    colors = np.repeat(np.asarray(surface.to_rgba(surface.get_array())), 2, axis=0)
    return {
        "type": "mesh3d",
        **{letter: encode_numbers(points[:, k]) for k, letter in enumerate("xyz")},
        **{letter: fans[:, k].tolist() for k, letter in enumerate("ijk")},
        "facecolor": [format_color(color) for color in colors],
        "flatshading": True,
        "lighting": {"ambient": 0.9},
    }
