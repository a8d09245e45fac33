"""Charts of the page: they hold what the figures hold, and nothing of a figure is lost in silence."""

import base64

import numpy as np
import pytest
from matplotlib.colors import LogNorm, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.quiver import Quiver
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import offset_copy

from opid.plots.charts.artists import UnknownArtistError
from opid.plots.charts.figure import build_chart
from opid.plots.charts.looks import describe_handle, encode_numbers
from opid.plots.charts.surfaces import Surface
from opid.plots.style import plain_numbers

RNG = np.random.default_rng(1)


def axes(rows=1, columns=1, **settings):
    return Figure(figsize=(7, 3)).subplots(rows, columns, squeeze=False, **settings)


def decoded(values):
    """What the page makes of an array."""
    if isinstance(values, list):
        return np.array([np.nan if each is None else each for each in values])
    raw = base64.b64decode(values["bdata"])
    if values["dtype"] == "u2":
        return values["low"] + values["step"] * np.frombuffer(raw, "<u2")
    numbers = np.frombuffer(raw, "<f4").astype(float)
    return numbers.reshape([int(n) for n in values["shape"].split(",")]) if "shape" in values else numbers


@pytest.mark.parametrize(("n", "least_digits"), [(5, 1e-6), (500, 1e-6), (20_000, 1.6e-5)])
def test_numbers_are_kept_to_the_resolution_of_a_recorder(n, least_digits):
    values = 1e-3 * RNG.standard_normal(n)
    found = decoded(encode_numbers(values))
    assert np.abs(found - values).max() <= least_digits * np.ptp(values)
    values[n // 2] = np.nan
    assert np.isnan(decoded(encode_numbers(values))[n // 2])


def test_a_line_has_its_values_its_look_and_its_unit():
    ((ax,),) = axes()
    x, y = np.linspace(0, 40, 5000), RNG.standard_normal(5000)
    ax.plot(x, y, color="#0072B2", linestyle="--", linewidth=1.5, label="airframe")
    ax.set(xlabel="time [s]", ylabel="acceleration [m/s²]", xlim=(0, 40), ylim=(-5, 5))
    chart = build_chart(ax.figure)
    (trace,) = chart["data"]
    assert trace["x0"] + trace["dx"] * 4999 == pytest.approx(40)
    np.testing.assert_allclose(decoded(trace["y"]), y, atol=2e-4)
    assert trace["line"] == {"color": "#0072b2", "width": 2.0, "dash": "dash", "shape": "linear"}
    assert trace["hovertemplate"] == "%{x:.6~g} s, %{y:.6~g} m/s²<extra>airframe</extra>"
    assert chart["layout"]["xaxis"]["range"] == [0, 40]
    assert chart["layout"]["yaxis"]["title"]["text"] == "acceleration [m/s²]"


def test_logarithmic_axes_texts_on_them_and_plain_numbers():
    ((ax,),) = axes()
    ax.set(xscale="log", yscale="log", xlim=(1, 1000), ylim=(0.1, 10))
    ax.text(100, 1, "here", fontsize=6)
    plain_numbers(ax.xaxis)
    chart = build_chart(ax.figure)
    assert chart["layout"]["xaxis"]["range"] == pytest.approx([0, 3])
    # numbers with a format are of full size, those without one are small digits
    assert (chart["layout"]["xaxis"]["dtick"], chart["layout"]["xaxis"]["tickformat"]) == ("D2", "~r")
    assert chart["layout"]["yaxis"]["dtick"] == 1
    assert "tickformat" not in chart["layout"]["yaxis"]
    (note,) = chart["layout"]["annotations"]
    assert (note["x"], note["y"], note["text"]) == (pytest.approx(2), pytest.approx(0), "here")
    assert note["font"]["size"] == 10


def test_rules_and_bands_across_a_panel_are_shapes():
    ((ax,),) = axes()
    ax.set(xlim=(0, 1), ylim=(0, 1))
    ax.axvline(0.25, label="threshold")
    ax.axvspan(0.5, 0.75)
    line, band = build_chart(ax.figure)["layout"]["shapes"]
    if line["type"] == "rect":
        line, band = band, line
    assert (line["x0"], line["x1"], line["y0"], line["y1"]) == pytest.approx((0.25, 0.25, 0, 1))
    assert (line["xref"], line["yref"], line["name"]) == ("x", "y domain", "threshold")
    assert (band["x0"], band["x1"], band["yref"]) == (pytest.approx(0.5), pytest.approx(0.75), "y domain")


def test_bars_and_bands_of_data_are_filled_and_error_bars_are_lines():
    ((ax,),) = axes()
    ax.bar([1, 2], [3, 4], width=1)
    ax.fill_between([0, 1], [0, 0], [1, 2], color="red", label="band")
    ax.errorbar([1], [2], yerr=[0.5])
    data = build_chart(ax.figure)["data"]
    filled = [each for each in data if each.get("fill") == "toself"]
    assert len(filled) == 3
    bars = [each for each in filled if "name" not in each]
    assert {float(np.nanmax(decoded(each["y"]))) for each in bars} == {3.0, 4.0}
    (error,) = [each for each in data if each.get("mode") == "lines" and "fill" not in each and len(each["x"]) == 2]
    np.testing.assert_allclose(decoded(error["y"]), [1.5, 2.5])


def test_cells_have_their_values_also_where_colours_follow_the_logarithm():
    ((ax,),) = axes()
    values = np.array([[1.0, 10.0, 100.0], [np.nan, 1000.0, 2.0]])
    mesh = ax.pcolormesh([0, 1, 2, 3], [0, 1, 2], np.ma.masked_invalid(values), norm=LogNorm(1, 1000))
    ax.figure.colorbar(mesh, ax=ax, label="samples")
    chart = build_chart(ax.figure)
    (trace,) = chart["data"]
    np.testing.assert_allclose(decoded(trace["customdata"]), values)
    np.testing.assert_allclose(decoded(trace["z"]), np.log10(values), atol=1e-6)
    assert (trace["zmin"], trace["zmax"]) == (0, 3)
    assert trace["colorbar"]["title"]["text"] == "samples"
    assert len([key for key in chart["layout"] if key.startswith("xaxis")]) == 1  # the colour bar is no panel


def test_panels_of_one_time_are_linked_and_one_label_is_one_entry_of_the_legend():
    grid = axes(2, 2, sharex="col")
    for k, ax in enumerate(grid.ravel()):
        ax.plot([0, 1], [0, 1], color=f"C{k}", label="model")
        ax.legend()
        ax.set_title(f"run {k}", loc="left")
    chart = build_chart(grid[0, 0].figure)
    layout = chart["layout"]
    assert layout["xaxis3"]["matches"] == "x"
    assert layout["xaxis4"]["matches"] == "x2"
    (entry,) = chart["legend"]
    assert entry["text"] == "model"
    assert len(entry["looks"]) == 4
    # rows lie one above the other and do not touch
    assert layout["yaxis"]["domain"][0] > layout["yaxis3"]["domain"][1]
    assert layout["xaxis"]["domain"][1] < layout["xaxis2"]["domain"][0]
    assert [each["text"] for each in layout["annotations"]] == [f"<b>run {k}</b>" for k in range(4)]


def test_a_sketch_has_neither_axes_nor_numbers_and_one_scale():
    ax = Figure().subplots()
    ax.plot([0, 1], [0, 2])
    ax.set_aspect("equal")
    ax.set(xticks=[], yticks=[])
    ax.spines[:].set_visible(False)
    layout = build_chart(ax.get_figure())["layout"]
    for letter in "xy":
        axis = layout[f"{letter}axis"]
        assert (axis["showline"], axis["showticklabels"], axis["ticks"]) == (False, False, "")
        assert axis["constrain"] == "domain"
        assert "tickvals" not in axis
    assert layout["yaxis"]["scaleanchor"] == "x"


def test_an_axis_that_runs_down_does_so_on_the_page():
    ((ax,),) = axes()
    ax.set_ylim(3.5, -0.5)
    ax.set_yticks([0, 1, 2, 3], ["a", "b < c", "d", "e"])
    ax.get_yticklabels()[2].set(color="#D55E00", fontweight="bold")
    axis = build_chart(ax.figure)["layout"]["yaxis"]
    assert axis["range"] == [3.5, -0.5]
    chosen = '<span style="color:#d55e00"><b>d</b></span>'
    assert axis["ticktext"] == ["a", "b &lt; c", chosen, "e"]


def put_surface(columns, rows, height, **looks):
    """Return Axes with a surface over a grid whose faces are coloured by their height."""
    ax = Figure().add_subplot(projection="3d")
    x, y = np.meshgrid(np.arange(float(columns)), np.arange(float(rows)))
    corners = np.stack([x, y, height(x, y)], axis=-1)
    faces = np.stack([corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]], axis=2).reshape(-1, 4, 3)
    ax.add_collection3d(Surface(faces, faces[..., 2].mean(axis=1), **looks))
    return ax


def test_a_surface_is_made_of_triangles():
    ax = put_surface(4, 3, np.multiply)
    (mesh,) = build_chart(ax.figure)["data"]
    points = np.stack([decoded(mesh[letter]) for letter in "xyz"], axis=1)
    np.testing.assert_allclose(points[:, 2], points[:, 0] * points[:, 1], atol=1e-6)
    assert len(mesh["i"]) == len(mesh["facecolor"]) == 2 * 3 * 2
    # the triangles cover the grid once: seen from above their areas add up to it
    a, b, c = (points[np.array(mesh[letter])][:, :2] for letter in "ijk")
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    assert np.abs(ux * vy - uy * vx).sum() / 2 == pytest.approx(3 * 2)


def test_a_surface_that_keeps_no_corners_is_unknown():
    ax = Figure().add_subplot(projection="3d")
    x, y = np.meshgrid(np.arange(4.0), np.arange(3.0))
    ax.plot_surface(x, y, x * y)
    with pytest.raises(UnknownArtistError):
        build_chart(ax.figure)


def test_each_face_of_a_surface_has_its_own_colour_also_once_it_was_drawn():
    """matplotlib sorts the colours by depth when it draws; the faces keep their order."""
    ax = put_surface(12, 9, np.subtract, cmap="gray")
    ax.figure.draw_without_rendering()
    (mesh,) = build_chart(ax.figure)["data"]
    # the two triangles of a face begin at one corner, and all faces are alike
    height = decoded(mesh["z"])[np.array(mesh["i"])]
    brightness = [to_rgb(shade)[0] for shade in mesh["facecolor"]]
    assert np.corrcoef(height, brightness)[0, 1] == pytest.approx(1, abs=1e-3)


def test_the_legend_of_a_figure_is_that_of_its_chart():
    ((left, right),) = axes(1, 2)
    lines = [*left.plot([0, 1], [0, 1], label="measured"), *right.plot([0, 1], [1, 0], label="law")]
    left.figure.legend(handles=lines, loc="outside lower center")
    assert [entry["text"] for entry in build_chart(left.figure)["legend"]] == ["measured", "law"]


def test_a_mark_with_a_white_edge_has_its_own_colour_in_the_legend():
    full = Line2D([], [], marker="s", color="#D55E00", markeredgecolor="white", linestyle="none")
    hollow = Line2D([], [], marker="o", color="#0072B2", markerfacecolor="white", linestyle="none")
    assert describe_handle(full) == {"color": "#d55e00", "symbol": "square"}
    assert describe_handle(hollow) == {"color": "#0072b2", "symbol": "circle-open"}


def test_flights_that_are_counted_have_whole_numbers():
    ((ax,),) = axes()
    ax.plot([1, 2, 3], [0, 1, 0])
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    axis = build_chart(ax.figure)["layout"]["xaxis"]
    assert {1.0, 2.0, 3.0} <= set(axis["tickvals"])
    assert all(value == int(value) for value in axis["tickvals"])
    assert axis["ticktext"][axis["tickvals"].index(2.0)] == "2"


def test_what_has_no_counterpart_is_an_error():
    ((ax,),) = axes()
    ax.add_artist(Quiver(ax, [0.5], [0.5], [1], [1]))
    with pytest.raises(UnknownArtistError, match="Quiver has no counterpart in a chart"):
        build_chart(ax.figure)
    ((ax,),) = axes()
    ax.add_patch(Circle((0.5, 0.5), 0.2))
    (trace,) = build_chart(ax.figure)["data"]
    assert np.nanmax(decoded(trace["x"])) == pytest.approx(0.7, abs=0.01)


def test_points_beside_their_place_are_points_at_their_place():
    """A line across the panel knows only its ends; a point that stands some points beside its date is still a point."""
    ((ax,),) = axes()
    ax.set(xlim=(0, 10), ylim=(0, 5))
    for shift in (0.0, 3.0):
        ax.plot([4.0], [2.0], marker="o", transform=offset_copy(ax.transData, ax.figure, x=shift, units="points"))
    ax.vlines([4.0], [1.0], [3.0], transform=offset_copy(ax.transData, ax.figure, x=3.0, units="points"))
    ax.plot([0.2], [0.5], marker="o", transform=ax.transAxes)
    chart = build_chart(ax.figure)
    assert [trace["mode"].split("+")[-1] for trace in chart["data"]] == ["markers", "markers", "lines"]
    assert len(chart["layout"]["shapes"]) == 1
