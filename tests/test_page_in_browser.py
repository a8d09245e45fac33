"""The page as a reader has it: Chromium opens the report of an identification, and zooms, points, reads and prints."""

import json
import os
import re

import numpy as np
import pytest
from chromium import Reader, needs_chromium, start_chromium

import opid

pytestmark = needs_chromium


@pytest.fixture(scope="module")
def page_file(identified, tmp_path_factory):
    return opid.write_report(identified.result, tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="module")
def browser():
    yield from start_chromium()


@pytest.fixture(scope="module", params=["light", "dark"])
def reader(request, browser, page_file):
    return Reader(browser, page_file, color_scheme=request.param, viewport={"width": 1000, "height": 900})


def test_it_opens_offline_and_without_an_error(reader, page_file):
    assert reader.errors == []
    assert reader.requests == [page_file.as_uri()]
    assert reader.boxes.count() == len(re.findall("data-chart=", page_file.read_text(encoding="utf-8"))) > 5


def test_zoom_changes_all_axes_of_one_time_and_the_whole_comes_back(reader):
    whole = reader.ranges("accelerations")
    reader.press("accelerations", "Zoom in")
    low, high = reader.ranges("accelerations")
    assert high - low == pytest.approx((whole[1] - whole[0]) / 2)
    assert reader.ranges("accelerations", "xaxis2") == pytest.approx([low, high])
    reader.press("accelerations", "Reset")
    assert reader.ranges("accelerations") == pytest.approx(whole)


def test_a_zoom_shows_samples_that_the_whole_record_has_no_pixels_for(reader):
    shown = "document.querySelector('[data-chart=accelerations] .plot').data[0].x"
    thinned = reader.page.evaluate(f"[...{shown}]")
    reader.page.evaluate(
        "Plotly.relayout(document.querySelector('[data-chart=accelerations] .plot'), {'xaxis.range': [5, 6]})"
    )
    reader.page.wait_for_function(f"{shown}.length < 300")
    inside = [each for each in reader.page.evaluate(f"[...{shown}]") if 5 <= each <= 6]
    assert len(inside) == 257 > sum(5 <= each <= 6 for each in thinned)  # every sample of that second
    reader.press("accelerations", "Reset")


def test_pointing_shows_the_value_of_the_result(reader):
    """Where the mouse is, the page shows a point of the law, with its units."""
    reader.boxes.page.locator("[data-chart=law_curves]").scroll_into_view_if_needed()
    x, y, value = reader.page.evaluate(
        """() => { const plot = document.querySelector('[data-chart=law_curves] .plot');
             const trace = plot.data.find((each) => /nonlinear/.test(each.name) && each.xaxis === 'x');
             const k = Math.round(0.8 * trace.x.length), box = plot.getBoundingClientRect(), all = plot._fullLayout;
             return [box.left + all.xaxis._offset + all.xaxis.d2p(trace.x[k]),
                     box.top + all.yaxis._offset + all.yaxis.d2p(trace.y[k]), trace.x[k]]; }"""
    )
    reader.page.mouse.move(x - 3, y)
    reader.page.mouse.move(x, y)
    label = reader.page.locator("[data-chart=law_curves] .hoverlayer .hovertext").first
    label.wait_for(timeout=5000)
    velocity, force = re.search(
        r"(\S+) m/s, (\S+) N", label.locator("text.nums").text_content().replace("−", "-")
    ).groups()
    assert float(velocity) == pytest.approx(value, rel=0.1)  # the point or its neighbour
    terms = json.loads((reader.folder / "result.json").read_text(encoding="utf-8"))["law"]["parameters"]
    amplitude, scale = (each["value"] for each in terms["arctan_velocity"].values())
    assert float(force) == pytest.approx(amplitude * 2 / np.pi * np.arctan(float(velocity) / scale), rel=2e-3)


def test_a_curve_is_switched_off_and_on_by_the_keyboard(reader):
    button = reader.page.locator("[data-chart=equation_residual] .legend button:not([disabled])").first
    button.focus()
    reader.page.keyboard.press("Enter")
    data = "document.querySelector('[data-chart=equation_residual] .plot').data"
    hidden = f"{data}.filter((each) => each.visible === false).length"
    reader.page.wait_for_function(f"{hidden} > 0")
    assert button.get_attribute("aria-pressed") == "false"
    reader.page.keyboard.press("Enter")
    reader.page.wait_for_function(f"{hidden} === 0")


def test_a_chart_is_saved_as_a_table_and_as_a_picture(reader, tmp_path):
    with reader.page.expect_download() as download:
        reader.press("accelerations", "CSV")
    rows = (tmp_path / "saved.csv", download.value.save_as(tmp_path / "saved.csv"))[0].read_text().splitlines()
    assert rows[0] == '"curve","x is","y is","x","y"'
    assert '"time [s]"' in rows[1]
    assert len(rows) > 4 * 5000
    with reader.page.expect_download() as download:
        reader.press("law_ladder", "PNG")
    download.value.save_as(tmp_path / "saved.png")
    assert (tmp_path / "saved.png").read_bytes()[1:4] == b"PNG"


def test_nothing_reaches_beyond_the_page(reader):
    assert reader.find_overflow() <= 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_telephone_shows_it_without_scrolling_sideways(browser, page_file, scheme):
    narrow = Reader(browser, page_file, color_scheme=scheme, viewport={"width": 480, "height": 900})
    assert narrow.errors == []
    assert narrow.find_overflow() <= 0
    # panels that stand beside each other on a wide page stand one below the other
    domains = narrow.page.evaluate(
        "Object.entries(document.querySelector('[data-chart=slices] .plot').layout)"
        ".filter(([key]) => /^xaxis/.test(key)).map(([, axis]) => axis.domain)"
    )
    assert domains == [[0, 1]] * len(domains)


def test_accessibility_has_no_serious_fault(reader):
    assert reader.find_serious_faults() == []


def test_every_chart_is_drawn_on_paper(browser, page_file, tmp_path):
    page = browser.new_page()
    page.goto(page_file.as_uri())
    page.wait_for_function("typeof Plotly !== 'undefined'")
    page.pdf(path=tmp_path / "report.pdf", format="A4")
    assert page.locator("[data-drawn]").count() == page.locator("[data-chart]").count()
    assert os.path.getsize(tmp_path / "report.pdf") > 50_000


def test_the_page_is_small(page_file):
    assert page_file.stat().st_size < 3e6
    assert json.loads((page_file.parent / "result.json").read_text(encoding="utf-8"))["title"]
