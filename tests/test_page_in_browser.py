"""The page as a reader has it: Chromium opens the report of an identification, and zooms, points, reads and prints."""

import json
import os
import re

import numpy as np
import pytest
from chromium import Reader, needs_chromium, start_chromium
from made_body import small_body
from made_flights import body_result, day, write_result
from made_health import faulty_health
from made_modal import small_decay, small_result, small_shift
from made_updating import small_truth, small_updating

import opid
from opid.suspensions.bench.law import law_of_bench
from opid.suspensions.bench.record import Bench
from opid.suspensions.flights.comparison import compare
from opid.suspensions.flights.results import read_flights

pytestmark = needs_chromium


@pytest.fixture(scope="module")
def page_file(identified, tmp_path_factory):
    return opid.write_report(identified.result, tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="module")
def browser():
    yield from start_chromium()


@pytest.fixture(scope="module", params=["light", "dark"])
def reader(request, browser, page_file):
    shown = Reader(browser, page_file, color_scheme=request.param, viewport={"width": 1000, "height": 900})
    yield shown
    shown.close()


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
    reader.show("law_curves")
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
    narrow.close()


@pytest.mark.parametrize("width", [1000, 480])
def test_texts_of_charts_are_whole_apart_and_large_enough(browser, page_file, width):
    shown = Reader(browser, page_file, viewport={"width": width, "height": 900})
    names = [box.get_attribute("data-chart") for box in shown.boxes.all()]
    texts = shown.page.evaluate(
        """() => [...document.querySelectorAll("[data-chart]")].flatMap((box) => {
          const whole = box.querySelector("svg")?.getBoundingClientRect();
          const shown = [...box.querySelectorAll("svg text")].filter((text) => text.textContent.trim());
          return shown.map((text) => {
            const { left, right, top, bottom } = text.getBoundingClientRect();
            const parts = [text, ...text.querySelectorAll("tspan")].filter((part) => part.textContent.trim());
            const size = Math.min(...parts.map((part) => parseFloat(getComputedStyle(part).fontSize)));
            const isWhole = left >= whole.left - 1 && right <= whole.right + 1
              && top >= whole.top - 1 && bottom <= whole.bottom + 1;
            return { chart: box.dataset.chart, text: text.textContent, size, isWhole, left, right, top, bottom };
          });
        })"""
    )
    assert {each["chart"] for each in texts} >= set(names) - {"restoring_force_surface"}
    assert [each for each in texts if each["size"] < 10] == []
    assert [each for each in texts if not each["isWhole"]] == []
    for name in names:
        own = [each for each in texts if each["chart"] == name]
        assert [(a["text"], b["text"]) for k, a in enumerate(own) for b in own[:k] if are_on_each_other(a, b)] == []
    shown.close()


def are_on_each_other(a, b):
    """Whether two texts cover each other by more than their margins."""
    across = min(a["right"], b["right"]) - max(a["left"], b["left"])
    down = min(a["bottom"], b["bottom"]) - max(a["top"], b["top"])
    return across > 3 and down > 4


def test_accessibility_has_no_serious_fault(reader):
    assert reader.find_serious_faults() == []


def test_every_chart_is_drawn_on_paper(browser, page_file, tmp_path):
    page = browser.new_page(bypass_csp=True)
    page.goto(page_file.as_uri())
    page.wait_for_function("typeof Plotly !== 'undefined'")
    page.pdf(path=tmp_path / "report.pdf", format="A4")
    assert page.locator("[data-drawn]").count() == page.locator("[data-chart]").count()
    assert os.path.getsize(tmp_path / "report.pdf") > 50_000


def test_the_page_is_small(page_file):
    assert page_file.stat().st_size < 3e6
    assert json.loads((page_file.parent / "result.json").read_text(encoding="utf-8"))["title"]


# ---- every kind of result ----------------------------------------------------------------------------


def find_law(folder):
    rng = np.random.default_rng(0)
    z, v = 0.01 * rng.standard_normal(800), 0.3 * rng.standard_normal(800)
    force = 2e4 * z + 500 * v + 800 * v * np.abs(v) + 5 * rng.standard_normal(800)
    record = Bench(z, v, force, 500.0, 0.0, "recorded", None, {"force": "F", "travel": "z", "velocity": "v"}, ())
    return law_of_bench(record, title="damper.csv", candidates=("quadratic_damping", "cubic_damping"))


def compare_flights(folder):
    """Four flights of which the last has the softest left strut."""
    rng = np.random.default_rng(1)
    losses = [{("left", "stiffness"): 0.1 * number} for number in range(4)]
    results = [body_result(rng, day=day(number), loss=loss) for number, loss in enumerate(losses)]
    return compare(read_flights([write_result(folder / f"f{k}", each) for k, each in enumerate(results)]))


KINDS = {
    "body": lambda folder: small_body(),
    "modal": lambda folder: small_result(shifts=(small_shift(),), decays=(small_decay(),)),
    "decay": lambda folder: small_decay(),
    "law": find_law,
    "update": lambda folder: small_updating(),
    "inspect": lambda folder: faulty_health(),
    "compare": compare_flights,
}
HAS_SKETCH = {"body", "modal", "decay", "law", "update"}


@pytest.fixture(scope="module")
def files_of(tmp_path_factory):
    """Return the page of a kind of result, which is written once."""
    written = {}

    def write(kind):
        if kind not in written:
            folder = tmp_path_factory.mktemp(kind)
            truth = small_truth() if kind == "update" else None
            written[kind] = opid.write_report(KINDS[kind](folder), folder / "out", truth)
        return written[kind]

    return write


@pytest.mark.parametrize(("width", "scheme"), [(1000, "light"), (480, "dark")])
@pytest.mark.parametrize("kind", KINDS)
def test_the_page_of_every_kind_of_result_is_whole(browser, files_of, kind, width, scheme):
    """No error, no request, nothing beyond the page, no serious fault of accessibility, a sketch with all its words."""
    file = files_of(kind)
    shown = Reader(browser, file, color_scheme=scheme, viewport={"width": width, "height": 900})
    assert shown.errors == []
    assert shown.requests == [file.as_uri()]
    assert shown.boxes.count() > 0
    assert shown.find_overflow() <= 0
    if width == 480:  # where more scrolls, and with the colours that no other page is tested in
        assert shown.find_serious_faults() == []
    assert shown.page.locator(".sketch").count() == (kind in HAS_SKETCH)
    cut = shown.page.evaluate(
        """() => [...document.querySelectorAll(".sketch text")].filter((text) => {
             const box = text.getBBox(), { width, height } = text.ownerSVGElement.viewBox.baseVal;
             return box.x < 0 || box.y < 0 || box.x + box.width > width || box.y + box.height > height;
           }).map((text) => text.textContent)"""
    )
    assert cut == []
    shown.close()


@pytest.fixture
def update(browser, files_of):
    """The page of an updating as it opens, nothing unfolded."""
    page = browser.new_page(bypass_csp=True, viewport={"width": 1000, "height": 900})
    page.goto(files_of("update").as_uri())
    page.wait_for_function("typeof Plotly !== 'undefined'")
    yield page
    page.close()


def test_a_chart_that_is_folded_is_drawn_when_a_reader_opens_it(update):
    name = "[data-chart=class_3_running]"
    chart = update.locator(name)
    fold = update.locator("details.fold", has=chart)
    fold.scroll_into_view_if_needed()
    assert not chart.is_visible()
    assert chart.get_attribute("data-drawn") is None
    fold.locator("summary").focus()
    update.keyboard.press("Enter")
    chart.scroll_into_view_if_needed()
    update.wait_for_function(f"document.querySelector('{name}').dataset.drawn")
    assert chart.locator(".plot svg").first.bounding_box()["width"] > 500


def test_paper_has_all_parts_open_and_small_charts_beside_each_other(update):
    folds = "document.querySelectorAll('details.fold[open]').length"
    assert update.evaluate(folds) == 0
    update.evaluate("dispatchEvent(new Event('beforeprint'))")
    update.wait_for_function("document.querySelectorAll('[data-chart]:not([data-drawn])').length === 0")
    assert update.evaluate(folds) == update.locator("details.fold").count() == 6
    halves = update.locator("section.half")
    boxes = [each.bounding_box() for each in halves.all()]
    assert len(boxes) % 2 == 0
    for left, right in zip(boxes[::2], boxes[1::2], strict=True):
        assert left["y"] == pytest.approx(right["y"], abs=2)
        assert left["x"] + left["width"] <= right["x"] + 1
    wide = update.evaluate(
        "Math.max(...[...document.querySelectorAll('.plot')].map((e) => e.getBoundingClientRect().right))"
    )
    assert wide <= update.evaluate("document.body.getBoundingClientRect().right") + 1
    update.evaluate("dispatchEvent(new Event('afterprint'))")
    assert update.evaluate(folds) == halves.count() == 0


@pytest.mark.slow
def test_compared_flights_are_sorted_by_a_value(browser, files_of):
    page = browser.new_page(bypass_csp=True)
    page.goto(files_of("compare").as_uri())
    head = page.locator("table.sorted th", has_text="left stiffness")
    head.locator("button").click()
    assert head.get_attribute("aria-sort") == "ascending"
    assert page.locator("table.sorted tbody td:first-child").all_inner_texts() == ["f3", "f2", "f1", "f0"]
    page.close()
