"""From a figure to a chart: where its panels stand, their axes, and the entries of the legend."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from mpl_toolkits.mplot3d.axes3d import Axes3D

from opid.plots.charts.artists import Panel, add_artist
from opid.plots.charts.looks import Json, describe_handle, format_bold, format_color, format_html
from opid.plots.charts.surfaces import add_surfaces
from opid.plots.texts import NamedTicks, find_written_text

Domain = tuple[list[float], list[float]]
"""From where to where a panel reaches, as fractions of the width and of the height."""

# titles and labels need these pixels between two rows of panels, above the first one and below the last one
_BETWEEN_ROWS, _ABOVE, _BELOW = 74, 34, 56
# two columns are this fraction of the width apart
_BETWEEN_COLUMNS = 0.12
_LEAST_HEIGHT, _SURFACE_HEIGHT = 150, 460
# red, green and blue of a grey differ by less than this
_GREY = 0.1


def build_chart(figure: Figure) -> Json:
    """Return a figure as a chart: {"data", "layout"} for Plotly.js, and {"legend"} for the page.

    Args:
        figure: one of `opid.plots`.

    Raises:
        UnknownArtistError: the figure holds something that no chart can show.
    """
    panels = [ax for ax in figure.axes if not hasattr(ax, "_colorbar") and (ax.axison or isinstance(ax, Axes3D))]
    chart: Json = {"data": [], "layout": {"annotations": [], "shapes": []}, "legend": []}
    if any(isinstance(ax, Axes3D) for ax in panels):
        chart["layout"]["height"] = _SURFACE_HEIGHT
        for ax in panels:
            add_surfaces(chart, ax)
        return chart
    domains, chart["layout"]["height"] = _arrange_panels(figure, panels)
    for number, (ax, domain) in enumerate(zip(panels, domains, strict=True), start=1):
        _add_panel(chart, ax, number, domain, panels)
    for legend in (*(ax.get_legend() for ax in panels), *figure.legends):
        _add_legend(chart, legend)
    return chart


def _arrange_panels(figure: Figure, panels: Sequence[Axes]) -> tuple[list[Domain], int]:
    """The domain of each panel, in the rows and columns of its grid, and the height of the chart in pixels."""
    specs = [spec for ax in panels if (spec := ax.get_subplotspec()) is not None]
    n_rows = max(spec.get_gridspec().nrows for spec in specs)
    n_columns = max(spec.get_gridspec().ncols for spec in specs)
    height = max(figure.get_figheight() * 100, n_rows * _LEAST_HEIGHT) + (n_rows - 1) * 30
    between = _BETWEEN_ROWS / (height - _ABOVE - _BELOW)
    domains = []
    for spec in specs:
        grid = spec.get_gridspec()
        x = _find_span(grid.get_width_ratios(), n_columns, _BETWEEN_COLUMNS, spec.colspan)
        down = _find_span(grid.get_height_ratios(), n_rows, between, spec.rowspan)
        domains.append((x, [1 - down[1], 1 - down[0]]))
    return domains, round(height)


def _find_span(ratios: Any, n: int, gap: float, taken: range) -> list[float]:
    gap = min(gap, 0.6 / max(1, n - 1))
    sizes = np.asarray(ratios, dtype=float) / np.sum(ratios) * (1 - gap * (n - 1))
    edges = np.concatenate([[0.0], np.cumsum(sizes + gap)])
    return [float(edges[taken.start]), float(edges[taken.stop] - gap)]


def _add_panel(chart: Json, ax: Axes, number: int, domain: Domain, panels: Sequence[Axes]) -> None:
    panel = Panel(chart, ax, "" if number == 1 else str(number), domain)
    for letter, ends in zip("xy", domain, strict=True):
        chart["layout"][f"{letter}axis{panel.suffix}"] = _describe_axis(panel, letter, ends, panels)
    for artist in sorted(ax.get_children(), key=lambda each: each.get_zorder()):
        if artist.get_visible():
            add_artist(panel, artist)
    _add_title(panel)


def _describe_axis(panel: Panel, letter: str, domain: list[float], panels: Sequence[Axes]) -> Json:
    ax = panel.ax
    axis: Any = ax.xaxis if letter == "x" else ax.yaxis
    is_log = axis.get_scale() == "log"
    ends = np.array(ax.get_xlim() if letter == "x" else ax.get_ylim())
    ticks = axis.get_tick_params("major")
    found: Json = {
        "domain": domain,
        "anchor": panel.y if letter == "x" else panel.x,
        "type": "log" if is_log else "linear",
        "range": (np.log10(ends) if is_log else ends).tolist(),
        "title": {"text": format_html(find_written_text(axis.label))},
        "label": format_html(panel.find_label(letter)),
        "showgrid": bool(ticks.get("gridOn", True)),
    }
    shared = ax.get_shared_x_axes() if letter == "x" else ax.get_shared_y_axes()
    first = next(number for number, each in enumerate(panels, start=1) if each in shared.get_siblings(ax))
    if letter == "x" and panel.has_dates:
        found["days"] = True
    if ax.get_aspect() == 1.0:
        # The panel becomes narrower or lower, and shows as much as the figure.
        found |= {"constrain": "domain"} | ({"scaleanchor": panel.x} if letter == "y" else {})
    if not ax.spines["bottom" if letter == "x" else "left"].get_visible():
        found["showline"] = False
    if panels[first - 1] is not ax:
        found["matches"] = letter + ("" if first == 1 else str(first))
    locator, formatter = axis.get_major_locator(), axis.get_major_formatter()
    if not ticks.get("labelbottom" if letter == "x" else "labelleft", True) or isinstance(
        formatter, ticker.NullFormatter
    ):
        found["showticklabels"] = False
    # the page cannot be told to have whole numbers at an axis: these remain at any zoom
    counts = isinstance(locator, ticker.MaxNLocator) and getattr(locator, "_integer", False)
    if isinstance(locator, ticker.FixedLocator) and not len(locator()):
        found |= {"showticklabels": False, "ticks": ""}
    elif isinstance(locator, ticker.FixedLocator) or counts:
        found["tickvals"] = [float(each) for each in locator()]
        texts = formatter.written if isinstance(formatter, NamedTicks) else formatter.format_ticks(locator())
        found["ticktext"] = _color_labels(axis, texts)
    elif is_log:
        has_plain_numbers = isinstance(formatter, ticker.FuncFormatter)
        # with a format of its own each number at the axis is whole and of full size: "20", not a small "2"
        found |= {"dtick": "D2", "tickformat": "~r"} if has_plain_numbers else {"dtick": 1}
    return found


def _color_labels(axis: Any, texts: Sequence[str]) -> list[str]:
    """The numbers or names at an axis; those in a colour keep it, for it says which one is chosen."""
    # `get_ticklabels` would place every tick of the picture that nobody draws
    labels = [tick.label1 for tick in axis.get_major_ticks(len(texts))]
    found = []
    for text, label in zip(texts, labels, strict=True):
        words, color = format_bold(format_html(text), label), label.get_color()
        has_color = np.ptp(to_rgba(color)[:3]) > _GREY
        found.append(f'<span style="color:{format_color(color)}">{words}</span>' if has_color else words)
    return found


def _add_title(panel: Panel) -> None:
    ax, (across, up) = panel.ax, (f"{panel.x} domain", f"{panel.y} domain")
    all_titles: Any = ax
    titles = (all_titles._left_title, all_titles.title, all_titles._right_title)
    title = next(filter(None, map(find_written_text, titles)), "")
    if not title:
        return
    # a text that stands on the upper edge of the panel has the title above it
    notes = panel.chart["layout"]["annotations"]
    is_below = any(
        each["yref"] == up and each["xref"] in (panel.x, across) and each["y"] >= 0.99 and each["yanchor"] == "bottom"
        for each in notes
    )
    notes.append(
        {
            "x": 0, "y": 1, "xref": across, "yref": up, "xanchor": "left", "yanchor": "bottom", "align": "left",
            "yshift": 22 if is_below else 4, "showarrow": False, "text": f"<b>{format_html(title)}</b>",
        }
    )  # fmt: skip


def _add_legend(chart: Json, legend: Legend | None) -> None:
    """The entries of a legend; one text has one entry, whatever the colours of its lines in several panels."""
    known = {entry["text"]: entry["looks"] for entry in chart["legend"]}
    for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True) if legend else ():
        words, look = find_written_text(text), describe_handle(handle)
        if words not in known:
            known[words] = []
            chart["legend"].append({"text": words, "looks": known[words]})
        if look not in known[words]:
            known[words].append(look)
