"""Figures of health over time: every quantity is drawn, what is flagged is named, and nothing is left in matplotlib."""

import numpy as np
import pytest
from made_flights import body_result, day, gear_result, write_result
from matplotlib.dates import date2num

from opid import plots
from opid.suspensions.flights.comparison import compare
from opid.suspensions.flights.results import read_flights


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    folder, rng = tmp_path_factory.mktemp("flights"), np.random.default_rng(4)
    for i in range(7):
        loss = {("left", "stiffness"): 0.05} if i >= 5 else None
        write_result(folder / f"flight{i}", body_result(rng, std=0.004, day=day(i), loss=loss))
    return compare(read_flights([folder]))


@pytest.mark.parametrize("label", ["stiffness", "total mass"])
def test_every_quantity_is_drawn_over_date(compared, label):
    ax = plots.compared_quantity(compared, label)
    assert ax.get_xlabel() == "date of the flight"
    assert "% of what was expected" in ax.get_ylabel()
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    gears = ["all of the body"] if label == "total mass" else ["nose", "left", "right"]
    assert [name.split(":")[0] for name in names] == gears
    # bars of each, and the band of one that is alone: several would mix
    assert len(ax.collections) == (2 if label == "total mass" else len(gears))
    assert plots.png(plots.figure_of(ax), dpi=50)[1:4] == b"PNG"


def test_what_is_flagged_is_ringed_and_named_once(compared):
    ax = plots.compared_quantity(compared, "stiffness")
    assert ax.get_title(loc="left") == "Stiffness: left flagged"
    (note,) = ax.texts
    assert note.get_text().startswith("left: −")
    assert note.get_text().endswith("std, confirmed")
    assert sum(line.get_markersize() == 10 for line in ax.lines) == 2
    calm = plots.compared_quantity(compared, "damping")
    assert calm.get_title(loc="left") == "Damping: nothing flagged"
    assert len(calm.texts) == 0


def test_no_name_of_the_legend_hides_a_point(compared):
    ax = plots.compared_quantity(compared, "stiffness")
    plots.png(plots.figure_of(ax), dpi=50)
    legend, inside = ax.get_legend().get_window_extent(), ax.get_window_extent()
    title = ax._left_title.get_window_extent()
    # between the axes and the title
    assert inside.y1 <= legend.y0 < legend.y1 <= title.y0
    rows = {round(text.get_window_extent().y0) for text in ax.get_legend().get_texts()}
    assert len(rows) == 1


def test_every_band_has_two_edges_even_where_one_flight_is_judged(compared, tmp_path):
    ax = plots.compared_quantity(compared, "stiffness")
    edges = [line for line in ax.lines if line.get_linewidth() == 0.8]
    assert len(edges) == 2 * 3
    rng = np.random.default_rng(0)
    for i in range(2):
        write_result(tmp_path / f"f{i}", body_result(rng, day=day(i)))
    few = plots.compared_quantity(compare(read_flights([tmp_path])), "damping")
    edges = [line for line in few.lines if line.get_linewidth() == 0.8]
    assert [(len(line.get_xdata()), line.get_marker()) for line in edges] == 6 * [(1, "_")]


def test_gears_stand_beside_each_other_on_paper_at_one_date(compared):
    ax = plots.compared_quantity(compared, "damping")
    days = [flight.date for flight in compared.flights]
    markers = [line for line in ax.lines if line.get_marker() == "o"]
    assert {float(line.get_xdata()[0]) for line in markers} == {float(x) for x in date2num(days)}
    plots.png(plots.figure_of(ax), dpi=50)
    first = [line for line in markers if line.get_xdata()[0] == date2num(days[0])]
    seen = sorted(line.get_transform().transform(line.get_xydata())[0, 0] for line in first)
    assert len(first) == 3
    assert np.allclose(np.diff(seen), 3.0 * plots.figure_of(ax).dpi / 72)
    assert ax.get_xlim()[0] == pytest.approx(date2num(days[0]), abs=3)


def test_without_dates_the_flights_are_counted_and_hollow_values_have_no_bar(tmp_path):
    rng = np.random.default_rng(0)
    for i in range(3):
        document = gear_result(rng, kind=None)
        if i == 1:
            stiffness = document["parameters"]["suspension_stiffness_n_per_m"]
            stiffness["std"] = stiffness["interval95"] = None
        write_result(tmp_path / f"f{i}", document)
    result = compare(read_flights([tmp_path]))
    ax = plots.compared_quantity(result, "stiffness")
    assert ax.get_xlabel() == "flight, in the order given"
    hollow = [line for line in ax.lines if line.get_markerfacecolor() == "white"]
    assert len(hollow) == 1
    with pytest.raises(ValueError, match="no quantity is called 'inertia'"):
        plots.compared_quantity(result, "inertia")


def test_axes_of_the_user_are_drawn_on(compared):
    own = plots.figure_of(plots.compared_quantity(compared, "damping")).subplots()
    assert plots.compared_quantity(compared, "damping", own) is own
