"""A surface of polygons as triangles that a reader can turn."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from opid.plots.charts.artists import UnknownArtistError
from opid.plots.charts.looks import Json, encode_numbers, format_color, format_html

_LOOK = {"aspectmode": "manual", "aspectratio": {"x": 1.1, "y": 1.1, "z": 0.8}}
# far enough that the words at the axes are within the chart
_CAMERA = {"eye": {"x": 1.5, "y": -1.6, "z": 0.8}, "center": {"x": 0.0, "y": 0.0, "z": -0.17}}


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
        if not isinstance(artist, Poly3DCollection):
            raise UnknownArtistError(artist)
        chart["data"].append(_build_mesh(artist))


def _build_mesh(artist: Poly3DCollection) -> Json:
    polygons = _list_polygons(artist)
    points = np.concatenate(polygons)
    firsts = np.cumsum([0, *map(len, polygons)])[:-1].tolist()
    # each polygon is a fan of triangles about its first corner
    fans = [(k, k + j, k + j + 1) for k, each in zip(firsts, polygons, strict=True) for j in range(1, len(each) - 1)]
    colors = _list_colors(artist)
    shades = [format_color(colors[k % len(colors)]) for k, each in enumerate(polygons) for _ in range(len(each) - 2)]
    corners = zip("ijk", zip(*fans, strict=True), strict=True)
    return {
        "type": "mesh3d",
        **{letter: encode_numbers(points[:, k]) for k, letter in enumerate("xyz")},
        **{letter: list(column) for letter, column in corners},
        "facecolor": shades,
        "flatshading": True,
        "lighting": {"ambient": 0.9},
    }


def _list_colors(artist: Any) -> np.ndarray:
    """The colours of the polygons in their own order, in which `get_facecolor` no longer has them once one is drawn."""
    if artist.get_array() is not None:
        return np.asarray(artist.to_rgba(artist.get_array()))
    return np.atleast_2d(artist._facecolor3d)


def _list_polygons(artist: Any) -> list[np.ndarray]:
    """The corners of each polygon; matplotlib keeps them as one array with a mask for those that have fewer."""
    faces, is_invalid = np.asarray(artist._faces), artist._invalid_vertices
    if np.ndim(is_invalid) == 0:
        return list(faces)
    return [face[~bad] for face, bad in zip(faces, is_invalid, strict=True)]
