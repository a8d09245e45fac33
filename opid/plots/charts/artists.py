"""From the artists of a figure to the traces, shapes and annotations of a chart.

Every picture is drawn once, by `opid.plots`; a chart is another form of it. Only what these figures hold is known:
lines, markers, bands, bars, meshes, contours, images and texts. Anything else is an error, so that no chart silently
lacks a part of its figure.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import LineCollection, PathCollection, PolyCollection, QuadMesh
from matplotlib.colors import LogNorm
from matplotlib.contour import QuadContourSet
from matplotlib.dates import DateLocator
from matplotlib.image import AxesImage
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.spines import Spine
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Transform, blended_transform_factory

from opid.estimate import format_number
from opid.plots.charts.looks import (
    CLEAR,
    PX_PER_PT,
    Json,
    describe_colormap,
    describe_line,
    describe_marker,
    encode_abscissae,
    encode_matrix,
    encode_numbers,
    fill_masked,
    find_label,
    find_unit,
    format_bold,
    format_color,
    format_html,
    has_line,
    has_marker,
    is_clear,
    join_lines,
)
from opid.plots.texts import find_written_text, shorten

# no text of a chart is smaller
_LEAST_FONT_PX = 10.0
_STEPS = {"steps": "vh", "steps-pre": "vh", "steps-mid": "hvh", "steps-post": "hv"}


OPENS = "<br>click: open its report"
"""What a reader is told where a point leads to a page."""


class UnknownArtistError(TypeError):
    """A figure holds an artist that has no counterpart in a chart."""

    def __init__(self, artist: Artist) -> None:
        super().__init__(f"{type(artist).__name__} has no counterpart in a chart: add it to opid/plots/charts")


@dataclass(frozen=True, eq=False)
class Panel:
    """One pair of axes of a chart.

    Args:
        chart: to which it adds.
        ax: the Axes of the figure.
        suffix: of the names of its axes: "", "2", ...
        domain: from where to where it reaches, as fractions of width and height.
    """

    chart: Json
    ax: Axes
    suffix: str
    domain: tuple[list[float], list[float]]

    @property
    def x(self) -> str:
        """Name of the horizontal axis."""
        return f"x{self.suffix}"

    @property
    def y(self) -> str:
        """Name of the vertical axis."""
        return f"y{self.suffix}"

    @cached_property
    def units(self) -> tuple[str, str]:
        """Units of both axes, with a blank before each."""
        return find_unit(self.find_label("x")), find_unit(self.find_label("y"))

    @cached_property
    def has_dates(self) -> bool:
        """Whether the horizontal axis counts days, as matplotlib does, and shows dates."""
        return isinstance(self.ax.xaxis.get_major_locator(), DateLocator)

    @property
    def abscissa(self) -> str:
        """What is shown of the abscissa of a point."""
        return "%{x|%Y-%m-%d}" if self.has_dates else f"%{{x:.6~g}}{self.units[0]}"

    @cached_property
    def has_colored_cells(self) -> bool:
        """Whether texts and lines lie on coloured cells, which are the same in a dark scheme."""
        return any(isinstance(each, QuadMesh | AxesImage) for each in self.ax.get_children())

    def find_label(self, letter: str) -> str:
        """Return the label of an axis; that of a panel with the same axis where only the lowest panel has one."""
        ax = self.ax
        shared = ax.get_shared_x_axes() if letter == "x" else ax.get_shared_y_axes()
        labels = (find_written_text(getattr(each, f"{letter}axis").label) for each in (ax, *shared.get_siblings(ax)))
        return next(filter(None, labels), "")

    def is_in_data(self, transform: Transform) -> bool:
        """Whether coordinates behind a transform are those of the data, where points may stand beside their place.

        A chart draws such points at their place: the distance would not be the same at another zoom.
        """
        contained = transform.contains_branch_seperately(self.ax.transData)
        if any(contained):
            return all(contained)
        corners = self.ax.viewLim.get_points()
        shift = transform.transform(corners) - self.ax.transData.transform(corners)
        return bool(np.allclose(shift[0], shift[1], atol=1e-6))

    def describe_references(self, transform: Transform) -> Json:
        """Return what the coordinates behind a transform refer to: the data, or the panel from 0 to 1."""
        in_x, in_y = transform.contains_branch_seperately(self.ax.transData)
        return {"xref": self.x if in_x else f"{self.x} domain", "yref": self.y if in_y else f"{self.y} domain"}

    def find_coordinates(self, points: np.ndarray, transform: Transform) -> np.ndarray:
        """Return points (n, 2) in the coordinates that `describe_references` names."""
        in_x, in_y = transform.contains_branch_seperately(self.ax.transData)
        shown = transform.transform(points)
        data, panel = (each.inverted().transform(shown) for each in (self.ax.transData, self.ax.transAxes))
        return np.stack([(data if in_x else panel)[:, 0], (data if in_y else panel)[:, 1]], axis=1)

    def add_trace(self, artist: Artist, **trace: Any) -> None:
        """Add a trace with the label of its artist; without a label it is not pointed at."""
        name, alpha, link = find_label(artist), artist.get_alpha(), artist.get_url()
        where = {"xaxis": self.x, "yaxis": self.y, "opacity": 1.0 if alpha is None else float(alpha)}
        where["keep"] = self.has_colored_cells
        if link:
            where["link"] = link
        numbers = f"{self.abscissa}, %{{y:.6~g}}{self.units[1]}{OPENS if link else ''}"
        words = {
            "name": format_html(shorten(name)),
            "meta": name,
            "hovertemplate": f"{numbers}<extra>{format_html(shorten(name))}</extra>",
        }
        said = words if name or link else {"hoverinfo": "skip"}
        self.chart["data"].append(where | said | trace)

    def add_shape(self, artist: Artist, **shape: Any) -> None:
        """Add a shape, below the data or above them as in the figure."""
        alpha = artist.get_alpha()
        layer = "below" if artist.get_zorder() < 2 else "above"
        look = {"layer": layer, "opacity": 1.0 if alpha is None else float(alpha), "name": find_label(artist)}
        self.chart["layout"]["shapes"].append(look | shape)


def add_artist(panel: Panel, artist: Artist) -> None:
    """Add what an artist of a panel draws.

    Raises:
        UnknownArtistError: it is of another kind than those that figures of opid hold.
    """
    if artist is panel.ax.patch or isinstance(artist, Legend | Spine | Axis):
        return
    for kind, add in _KINDS:
        if isinstance(artist, kind):
            add(panel, artist)
            return
    raise UnknownArtistError(artist)


# ---- lines and markers -------------------------------------------------------------------------------


def _add_line(panel: Panel, line: Line2D) -> None:
    x, y = (fill_masked(each) for each in line.get_data(orig=False))
    transform = line.get_transform()
    if not x.size or not (has_line(line) or has_marker(line)):
        return
    if not panel.is_in_data(transform):
        # a line across the panel: of one axis it knows only the ends
        ends = panel.find_coordinates(np.stack([x, y], axis=1)[[0, -1]], transform)
        panel.add_shape(
            line, **_describe_segment(*ends), **panel.describe_references(transform), line=describe_line(line)
        )
        return
    mode = "+".join(["lines"] * has_line(line) + ["markers"] * has_marker(line))
    look: Json = {}
    if has_line(line):
        look["line"] = describe_line(line) | {"shape": _STEPS.get(str(line.get_drawstyle()), "linear")}
    if has_marker(line):
        look["marker"] = describe_marker(line)
    panel.add_trace(line, type="scatter", mode=mode, **encode_abscissae(x), y=encode_numbers(y), **look)


def _describe_segment(first: np.ndarray, last: np.ndarray) -> Json:
    (x0, y0), (x1, y1) = first.tolist(), last.tolist()
    return {"type": "line", "x0": x0, "x1": x1, "y0": y0, "y1": y1}


def _add_segments(panel: Panel, artist: LineCollection) -> None:
    parts = [np.asarray(each, dtype=float) for each in artist.get_segments()]
    shades, widths = np.atleast_2d(artist.get_edgecolor()), np.atleast_1d(artist.get_linewidth())
    transform = artist.get_transform()
    is_in_data = panel.is_in_data(transform)
    groups: dict[tuple[str, float], list[np.ndarray]] = {}
    for k, part in enumerate(parts):
        look = format_color(shades[k % len(shades)]), round(float(widths[k % len(widths)]) * PX_PER_PT, 2)
        groups.setdefault(look, []).append(part)
    for (color, width), members in groups.items():
        line = {"color": color, "width": width}
        if is_in_data:
            x, y = join_lines(members)
            panel.add_trace(artist, type="scatter", mode="lines", x=encode_numbers(x), y=encode_numbers(y), line=line)
            continue
        for part in members:
            ends = panel.find_coordinates(part[[0, -1]], transform)
            panel.add_shape(artist, **_describe_segment(*ends), **panel.describe_references(transform), line=line)


def _add_markers(panel: Panel, artist: PathCollection) -> None:
    points, faces = fill_masked(artist.get_offsets()), np.atleast_2d(artist.get_facecolor())
    shades = [format_color(each) for each in faces]
    size = round(float(np.sqrt(artist.get_sizes()[0])) * PX_PER_PT, 2)
    marker = {"size": size, "line": {"width": 0}, "color": shades if len(shades) > 1 else shades[0]}
    x, y = encode_numbers(points[:, 0]), encode_numbers(points[:, 1])
    panel.add_trace(artist, type="scatter", mode="markers", x=x, y=y, marker=marker)


# ---- areas -------------------------------------------------------------------------------------------


def _add_patch(panel: Panel, patch: Patch) -> None:
    outline, transform = patch.get_patch_transform().transform_path(patch.get_path()), patch.get_transform()
    face = patch.get_facecolor() if patch.get_fill() else CLEAR
    data = panel.ax.transData
    # the transform of a patch begins with its own, which `outline` has already
    own = transform if patch.get_data_transform() is None else patch.get_data_transform()
    if all(own.contains_branch_seperately(data)):
        _add_filled(
            panel, patch, outline.to_polygons(closed_only=False), face, patch.get_edgecolor(), patch.get_linewidth()
        )
        return
    box = outline.get_extents()
    ends = {"x0": box.x0, "x1": box.x1, "y0": box.y0, "y1": box.y1}
    panel.add_shape(
        patch, type="rect", **ends, **panel.describe_references(own), fillcolor=format_color(face), line={"width": 0}
    )


def _add_polygons(panel: Panel, artist: PolyCollection) -> None:
    if np.any(fill_masked(artist.get_offsets())):
        raise UnknownArtistError(artist)  # one small shape stands at many places, as arrows do
    faces, edges = np.atleast_2d(artist.get_facecolor()), np.atleast_2d(artist.get_edgecolor())
    width = float(np.max(artist.get_linewidth(), initial=0.0))
    polygons = [part for path in artist.get_paths() for part in path.to_polygons(closed_only=False)]
    edge = edges[0] if edges.size else CLEAR
    if len(faces) == 1:
        _add_filled(panel, artist, polygons, faces[0] if faces.size else CLEAR, edge, width)
        return
    for k, polygon in enumerate(polygons):
        _add_filled(panel, artist, [polygon], faces[k % len(faces)], CLEAR, 0.0)


def _add_filled(panel: Panel, artist: Artist, polygons: Sequence[Any], face: Any, edge: Any, width: float) -> None:
    if not len(polygons):
        return
    x, y = join_lines([np.concatenate([np.asarray(each), np.asarray(each)[:1]]) for each in polygons])
    has_edge = width > 0 and not is_clear(edge)
    panel.add_trace(
        artist,
        type="scatter",
        mode="lines",
        x=encode_numbers(x),
        y=encode_numbers(y),
        fill="none" if is_clear(face) else "toself",
        fillcolor=format_color(face),
        line={"width": round(width * PX_PER_PT, 2) if has_edge else 0, "color": format_color(edge)},
    )


def _add_contours(panel: Panel, artist: QuadContourSet) -> None:
    faces, edges = np.atleast_2d(artist.get_facecolor()), np.atleast_2d(artist.get_edgecolor())
    width = round(float(np.ravel(artist.get_linewidth())[0]) * PX_PER_PT, 2)
    for k, path in enumerate(artist.get_paths()):
        parts = path.to_polygons(closed_only=False)
        if artist.filled:
            _add_filled(panel, artist, parts, faces[k % len(faces)], CLEAR, 0.0)
        elif parts:
            x, y = join_lines([np.asarray(part) for part in parts])
            line = {"color": format_color(edges[k % len(edges)]), "width": width}
            panel.add_trace(artist, type="scatter", mode="lines", x=encode_numbers(x), y=encode_numbers(y), line=line)


# ---- cells -------------------------------------------------------------------------------------------


def _add_mesh(panel: Panel, mesh: QuadMesh) -> None:
    corners = np.asarray(mesh.get_coordinates())
    _add_cells(panel, mesh, corners[0, :, 0], corners[:, 0, 1])


def _add_image(panel: Panel, image: AxesImage) -> None:
    left, right, low, high = image.get_extent()
    rows, columns = np.asarray(image.get_array()).shape[:2]
    # the first row of an image may lie at the upper end of its extent
    ends = (high, low) if image.origin == "upper" else (low, high)
    _add_cells(panel, image, np.linspace(left, right, columns + 1), np.linspace(*ends, rows + 1))


def _add_cells(panel: Panel, artist: Any, x: np.ndarray, y: np.ndarray) -> None:
    values = fill_masked(artist.get_array()).reshape(y.size - 1, x.size - 1)
    limits = np.array([artist.norm.vmin, artist.norm.vmax], dtype=float)
    trace: Json = {}
    if isinstance(artist.norm, LogNorm):
        # colours follow the logarithm; the reader is shown the value itself
        trace = {"customdata": encode_matrix(values)}
        values, limits = np.log10(np.where(values > 0, values, np.nan)), np.log10(limits)
    ordinate = f"%{{y:.6~g}}{panel.units[1]}"
    name_row = panel.ax.fmt_ydata
    if name_row is not None:
        # rows have names: the page shows them where there is no room for them beside the cells
        trace["rows"] = [format_html(shorten(name_row(each))) for each in (y[:-1] + y[1:]) / 2]
        ordinate = "%{text}"
    shown = f"{panel.abscissa}, {ordinate}: %{{{'customdata' if 'customdata' in trace else 'z'}:.6~g}}"
    panel.add_trace(
        artist,
        type="heatmap",
        x=encode_numbers(x),
        y=encode_numbers(y),
        z=encode_matrix(values),
        zmin=float(limits[0]),
        zmax=float(limits[1]),
        colorscale=describe_colormap(artist.get_cmap()),
        hovertemplate=f"{shown}<extra></extra>",
        hoverinfo="all",
        **trace,
        **_describe_colorbar(panel, artist, limits),
    )


def _describe_colorbar(panel: Panel, artist: Any, limits: np.ndarray) -> Json:
    bar = artist.colorbar
    if bar is None:
        return {"showscale": False}
    (left, right), (low, high) = panel.domain
    label = find_written_text(bar.ax.yaxis.label) or find_written_text(bar.ax.xaxis.label)
    title = {"text": format_html(label), "font": {"size": 13}}
    look: Json = {"thickness": 12, "outlinewidth": 0}
    if bar.orientation == "horizontal":
        title["side"] = "bottom"
        look |= {
            "orientation": "h",
            "x": (left + right) / 2,
            "len": right - left,
            "y": low,
            "yanchor": "top",
            "ypad": 46,
        }
    else:
        title["side"] = "right"
        look |= {"x": right, "len": high - low, "y": (low + high) / 2}
    if isinstance(artist.norm, LogNorm):
        powers = np.arange(np.ceil(limits[0]), np.floor(limits[1]) + 1).astype(int).tolist()
        look |= {"tickvals": powers, "ticktext": [format_number(10.0**each) for each in powers]}
    return {"colorbar": look | {"title": title}}


# ---- texts -------------------------------------------------------------------------------------------


def _add_text(panel: Panel, text: Any) -> None:
    ax: Any = panel.ax
    if not text.get_text().strip() or text in (ax.title, ax._left_title, ax._right_title):
        return
    place, transform, shift = text.get_position(), text.get_transform(), (0.0, 0.0)
    if isinstance(text, Annotation):
        place, transform = text.xy, _find_transform(panel, text.xycoords)
        shift = text.xyann if text.anncoords == "offset points" else shift
    numbers = [[float(ax.convert_xunits(place[0])), float(ax.convert_yunits(place[1]))]]
    (at,), refs = panel.find_coordinates(np.array(numbers), transform), panel.describe_references(transform)
    if not np.isfinite(at).all():
        return
    # annotations on a logarithmic axis stand at the logarithm of their value
    for k, (ref, is_log) in enumerate(((refs["xref"], ax.get_xscale()), (refs["yref"], ax.get_yscale()))):
        if is_log == "log" and "domain" not in ref:
            at[k] = np.log10(at[k])
    box = text.get_bbox_patch()
    panel.chart["layout"]["annotations"].append(
        {
            "x": float(at[0]),
            "y": float(at[1]),
            **refs,
            "text": format_bold(format_html(find_written_text(text)), text),
            "showarrow": False,
            "keep": panel.has_colored_cells,
            "xshift": shift[0] * PX_PER_PT,
            "yshift": shift[1] * PX_PER_PT,
            "xanchor": text.get_ha(),
            "yanchor": {"top": "top", "bottom": "bottom", "baseline": "bottom"}.get(text.get_va(), "middle"),
            "align": text.get_ha(),
            "textangle": -float(text.get_rotation()),
            "font": {
                "color": format_color(text.get_color()),
                "size": round(max(_LEAST_FONT_PX, float(text.get_fontsize()) * PX_PER_PT), 1),
            },
            "bgcolor": "rgba(0,0,0,0)" if box is None else format_color(box.get_facecolor()),
        }
    )


def _find_transform(panel: Panel, coords: Any) -> Transform:
    if isinstance(coords, tuple):
        return blended_transform_factory(*(_find_transform(panel, each) for each in coords))
    known = {"data": panel.ax.transData, "axes fraction": panel.ax.transAxes}
    return known[coords] if isinstance(coords, str) else coords


_KINDS: tuple[tuple[type[Artist], Callable[[Panel, Any], None]], ...] = (
    (Line2D, _add_line),
    (Text, _add_text),
    (Patch, _add_patch),
    (QuadMesh, _add_mesh),
    (QuadContourSet, _add_contours),
    (AxesImage, _add_image),
    (LineCollection, _add_segments),
    (PolyCollection, _add_polygons),
    (PathCollection, _add_markers),
)
