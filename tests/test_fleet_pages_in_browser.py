"""The index page of a campaign and the page of a fleet as a reader has them, in Chromium."""

import csv
import re
from urllib.parse import unquote

import numpy as np
import pytest
from chromium import Reader, needs_chromium, start_chromium
from made_fleet import make_campaign, write_fleet

import opid
from opid.provenance import traced
from opid.suspensions.flights.dataset import read_dataset
from opid.suspensions.flights.fleet_comparison import compare_fleet

pytestmark = needs_chromium

DATE = r"\d{4}-\d\d-\d\d"


@pytest.fixture(scope="module")
def browser():
    yield from start_chromium()


@pytest.fixture(scope="module")
def index_file(identified, tmp_path_factory):
    """The index page of four flights of a gear, two of which are determined."""
    folder = tmp_path_factory.mktemp("fleet of 2026")
    found = make_campaign(folder, traced(identified.result.to_dict(), identified.result.files))
    (folder / "flights" / "A" / "f1" / "report.html").write_text("<!DOCTYPE html><title>the flight</title>")
    return opid.write_report(found, folder)


@pytest.fixture(scope="module")
def fleet_file(tmp_path_factory):
    """The page of a fleet of which one strut is harmed."""
    pytest.importorskip("pyarrow")
    folder = tmp_path_factory.mktemp("fleet of 2026")
    write_fleet(folder, n_pages=12, harm=-0.06)
    return opid.write_report(compare_fleet(read_dataset(folder)), folder / "health")


@pytest.fixture(scope="module", params=["light", "dark"])
def index(request, browser, index_file):
    shown = Reader(browser, index_file, color_scheme=request.param, viewport={"width": 1000, "height": 900})
    yield shown
    shown.close()


@pytest.fixture(scope="module", params=["light", "dark"])
def fleet(request, browser, fleet_file):
    shown = Reader(browser, fleet_file, color_scheme=request.param, viewport={"width": 1000, "height": 900})
    yield shown
    shown.close()


# ---- the index ---------------------------------------------------------------------------------------


def names_shown(index):
    rows = index.page.locator("table.sorted tbody tr:visible")
    return [" ".join(row.locator("td").nth(k).inner_text().strip() for k in (1, 0)) for row in rows.all()]


def choose(index, name):
    index.page.get_by_label(f"overlay {name}").click()


def curves_shown(index):
    """Return the names of the visible curves of the overlay, with their panels."""
    return index.page.evaluate(
        "document.querySelector('[data-chart=laws] .plot').data.filter((each) => each.visible !== false)"
        ".map((each) => [each.meta, each.xaxis])"
    )


def test_the_index_opens_offline_and_without_an_error(index, index_file):
    assert index.errors == []
    assert index.requests == [index_file.as_uri()]


def test_the_field_shows_the_rows_with_all_its_words(index):
    field, said = index.page.locator(".filter input"), index.page.locator(".filter output")
    assert names_shown(index) == ["A f1", "A f2", "B f1", "B f2"]
    for words, names in (("failed", ["B f2"]), ("B 2026-01", ["B f1"]), ("IDENTIFIED", ["A f1", "A f2"]), ("x", [])):
        field.fill(words)
        assert names_shown(index) == names
        assert said.inner_text() == f"{len(names)} of 4 rows"
    field.fill("")
    assert len(names_shown(index)) == 4


def test_a_head_sorts_by_its_column_and_back(index):
    head = index.page.locator("table.sorted th", has_text="stiffness").first
    column = index.page.evaluate("(head) => head.cellIndex", head.element_handle())
    for order in ("ascending", "descending"):
        head.locator("button").focus()
        index.page.keyboard.press("Enter")
        assert head.get_attribute("aria-sort") == order
        cells = index.page.locator(f"table.sorted tbody tr:visible td:nth-child({column + 1})").all_inner_texts()
        values = [float(each.replace("−", "-").replace(",", "")) for each in cells if each != "-"]
        assert len(values) == 3
        assert values == sorted(values, reverse=order == "descending")
    index.page.locator("table.sorted th button", has_text="date").click()
    assert names_shown(index)[-3:] == ["A f1", "A f2", "B f1"] or names_shown(index)[:3] == ["A f1", "A f2", "B f1"]


def test_flights_that_are_ticked_are_overlaid(index):
    assert curves_shown(index) == []
    for name in ("A f1", "A f2"):
        choose(index, name)
    index.page.wait_for_function(
        "document.querySelector('[data-chart=laws] .plot').data.filter((each) => each.visible !== false).length === 4"
    )
    assert sorted(map(tuple, curves_shown(index))) == [(f"A f{k}", axis) for k in (1, 2) for axis in ("x", "x2")]
    assert index.page.locator("[data-chart=laws] .legend button:visible").all_inner_texts() == ["A f1", "A f2"]
    choose(index, "A f1")
    index.page.wait_for_function(
        "document.querySelector('[data-chart=laws] .plot').data.filter((each) => each.visible !== false).length === 2"
    )
    assert {name for name, _ in curves_shown(index)} == {"A f2"}
    assert index.page.get_by_label("overlay B f2").count() == 0
    choose(index, "A f2")


def test_the_name_of_a_flight_opens_its_page(index):
    index.page.locator("table.sorted a").filter(has_text="f1").first.click()
    assert index.page.title() == "the flight"
    index.page.go_back()
    assert index.page.locator("h1").inner_text() == "Four flights"


# ---- the fleet ---------------------------------------------------------------------------------------


def test_the_fleet_opens_offline_and_without_an_error(fleet, fleet_file):
    assert fleet.errors == []
    assert fleet.requests == [fleet_file.as_uri()]
    assert [box.get_attribute("data-chart") for box in fleet.boxes.all()] == ["fleet_1", "strut_1"]


@pytest.mark.parametrize("name", ["fleet_1", "strut_1"])
def test_dates_stand_at_the_axis(fleet, name):
    kind = fleet.page.evaluate(
        "(name) => document.querySelector(`[data-chart=${name}] .plot`)._fullLayout.xaxis.type", name
    )
    assert kind == "date"
    words = " ".join(fleet.page.locator(f"[data-chart={name}] .xtick text").all_text_contents())
    assert re.search(r"(Jan|Feb|Mar|Apr|May|Jun)\b", words)
    assert "1970" in words


def find_point(fleet, name, which):
    """Return where a point of a chart with a link is in the window, its link and its date."""
    fleet.page.locator(f"[data-chart={name}]").scroll_into_view_if_needed()
    return fleet.page.evaluate(
        """([name, which]) => { const plot = document.querySelector(`[data-chart=${name}] .plot`);
             const trace = plot.data.filter((each) => each.link).at(which), box = plot.getBoundingClientRect();
             const { xaxis, yaxis } = plot._fullLayout;
             return [box.left + xaxis._offset + xaxis.d2p(trace.x[0]), box.top + yaxis._offset + yaxis.d2p(trace.y[0]),
                     trace.link, new Date(trace.x[0]).toISOString().slice(0, 10)]; }""",
        [name, which],
    )


def test_pointing_shows_the_date_and_a_click_opens_the_report_of_the_flight(fleet, fleet_file):
    x, y, link, date = find_point(fleet, "strut_1", -2)
    target = (fleet_file.parent / unquote(link)).resolve()
    assert target.is_file()
    fleet.page.mouse.move(x - 4, y)
    fleet.page.mouse.move(x, y)
    label = fleet.page.locator("[data-chart=strut_1] .hoverlayer .hovertext").first
    label.wait_for(timeout=5000)
    said = label.text_content()
    assert date in said
    assert "click: open its report" in said
    assert "value, 95 % interval" in said
    with fleet.page.context.expect_page() as opened:
        fleet.page.mouse.click(x, y)
    opened.value.wait_for_load_state()
    assert opened.value.url == target.as_uri()
    opened.value.close()
    fleet.page.mouse.move(1, 1)


def test_pointing_at_the_map_names_the_strut(fleet):
    """There is no room for the names of 500 struts beside it."""
    fleet.page.locator("[data-chart=fleet_1]").scroll_into_view_if_needed()
    x, y, name = fleet.page.evaluate(
        """() => { const plot = document.querySelector('[data-chart=fleet_1] .plot'), trace = plot.data[0];
             const { xaxis, yaxis } = plot._fullLayout, box = plot.getBoundingClientRect();
             const k = trace.z[2].findIndex(Number.isFinite), middle = (trace.x[k] + trace.x[k + 1]) / 2;
             return [box.left + xaxis._offset + xaxis.d2p(middle), box.top + yaxis._offset + yaxis.d2p(2),
                     plot._fullLayout.yaxis.ticktext[2]]; }"""
    )
    fleet.page.mouse.move(x - 2, y)
    fleet.page.mouse.move(x, y)
    label = fleet.page.locator("[data-chart=fleet_1] .hoverlayer .hovertext").first
    label.wait_for(timeout=5000)
    assert re.match(rf"{DATE}, {name}: ", label.text_content())
    fleet.page.mouse.move(1, 1)


def test_zoom_halves_the_time_that_is_shown_and_the_whole_comes_back(fleet):
    def days():
        ends = fleet.page.evaluate(
            "document.querySelector('[data-chart=strut_1] .plot')._fullLayout.xaxis.range.map((end) =>"
            " typeof end === 'number' ? end : Date.parse(end.replace(' ', 'T') + (end.includes(' ') ? 'Z' : '')))"
        )
        return (ends[1] - ends[0]) / 864e5

    whole = days()
    assert 100 < whole < 250
    fleet.press("strut_1", "Zoom in")
    assert days() == pytest.approx(whole / 2, rel=1e-3)
    fleet.press("strut_1", "Zoom out")
    assert days() == pytest.approx(whole, rel=1e-3)
    fleet.press("strut_1", "Zoom in")
    fleet.press("strut_1", "Reset")
    assert days() == pytest.approx(whole, rel=1e-6)


@pytest.mark.parametrize("name", ["fleet_1", "strut_1"])
def test_saved_tables_have_dates_as_iso_8601_says(fleet, name, tmp_path):
    with fleet.page.expect_download() as download:
        fleet.press(name, "CSV")
    download.value.save_as(tmp_path / "saved.csv")
    head, *rows = csv.reader((tmp_path / "saved.csv").read_text().splitlines())
    assert head == ["curve", "x is", "y is", "x", "y", "value"][: 6 if name == "fleet_1" else 5]
    assert len(rows) >= 12
    assert all(re.fullmatch(DATE, row[3]) and len(row) == len(head) for row in rows)
    if name == "fleet_1":
        assert {row[4] for row in rows} == {f"D-00{k}" for k in range(6)}


def test_a_curve_of_a_strut_is_hidden_whole(fleet):
    button = fleet.page.locator("[data-chart=strut_1] .legend button", has_text="value").first
    button.click()
    data = "document.querySelector('[data-chart=strut_1] .plot').data"
    left = f"{data}.filter((each) => each.link && each.visible !== false)"
    fleet.page.wait_for_function(f"{left}.length === 0")
    button.click()
    fleet.page.wait_for_function(f"{left}.length === 12")


def test_the_caption_of_the_map_says_what_an_empty_cell_is(fleet):
    said = fleet.page.locator("section", has=fleet.page.locator("[data-chart=fleet_1]")).inner_text()
    days = int(re.search(r"stands for about (\d+) days; it is empty where the strut did not fly", said)[1])
    edges, cells = fleet.page.evaluate(
        """() => { const [{ x, z }] = document.querySelector("[data-chart=fleet_1] .plot").data;
             return [[...x], z.map((row) => [...row])]; }"""
    )
    assert days == pytest.approx((edges[1] - edges[0]) / 864e5, abs=0.5)
    assert np.isnan(cells).any()
    assert fleet.page.locator("[data-chart=fleet_1] .gridlayer path").count() == 0


# ---- both --------------------------------------------------------------------------------------------


def test_the_index_has_no_overflow_and_no_serious_fault_of_accessibility(index):
    assert index.find_overflow() <= 0
    assert index.find_serious_faults() == []


def test_the_fleet_has_no_overflow_and_no_serious_fault_of_accessibility(fleet):
    assert fleet.find_overflow() <= 0
    assert fleet.find_serious_faults() == []


@pytest.mark.parametrize("name", ["index_file", "fleet_file"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_telephone_shows_it_without_scrolling_sideways(browser, name, scheme, request):
    narrow = Reader(browser, request.getfixturevalue(name), color_scheme=scheme, viewport={"width": 480, "height": 900})
    assert narrow.errors == []
    assert narrow.find_overflow() <= 0
    narrow.close()


def find_cut(reader, name):
    """Return by how many pixels the table below a heading is wider than its place."""
    return reader.page.evaluate(
        """(name) => { const head = [...document.querySelectorAll("h2")].find((each) => each.textContent === name);
             let box = head; while (!box.matches(".scroll")) box = box.nextElementSibling;
             return box.scrollWidth - box.clientWidth; }""",
        name,
    )


def test_the_tables_fit_into_the_window(index, fleet):
    assert find_cut(index, "Flights") <= 0
    assert find_cut(fleet, "Struts") <= 0


@pytest.fixture(scope="module")
def narrow_index(browser, index_file):
    shown = Reader(browser, index_file, viewport={"width": 480, "height": 900})
    yield shown
    shown.close()


def test_a_telephone_shows_the_whole_table_with_the_reasons(narrow_index):
    assert find_cut(narrow_index, "Flights") <= 0
    cell = narrow_index.page.locator("table.sorted td", has_text="failed: there is no file")
    box = cell.bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 480


@pytest.mark.slow
def test_stacked_panels_have_their_labels_and_no_gap_below(narrow_index):
    choose(narrow_index, "A f1")
    chart = narrow_index.page.locator("[data-chart=laws]")
    chart.locator(".x2title").wait_for()
    assert chart.locator(".xtitle, .x2title").all_text_contents() == ["travel [mm]", "rate [m/s]"]
    last = chart.locator(".x2title").bounding_box()
    tools = chart.locator(".tools").bounding_box()
    assert tools["y"] - (last["y"] + last["height"]) < 40
