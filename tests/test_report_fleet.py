"""What a reader is told of a campaign and of a fleet, and where the links of their pages lead."""

import json
import re
from dataclasses import replace
from urllib.parse import unquote

import numpy as np
import pytest
from made_fleet import REFUSED, draw_fleet, make_campaign, write_fleet
from made_flights import body_result, day, write_result

import opid
from opid.estimate import with_std
from opid.report.document import Table
from opid.report.writing import build_document
from opid.suspensions.flights.comparison import compare
from opid.suspensions.flights.dataset import read_dataset
from opid.suspensions.flights.fleet_comparison import compare_fleet
from opid.suspensions.flights.result_file import Quantity, StrutLaw
from opid.suspensions.flights.results import read_flights


def flat(text):
    return " ".join(text.split())


def charts_of(page):
    """Return the charts of a page by their names."""
    found = re.findall(r'data-chart="([^"]+)"[^>]*>\s*<script type="application/json">(.*?)</script>', page, re.DOTALL)
    return {name: json.loads(chart) for name, chart in found}


def links_of(chart):
    return [trace["link"] for trace in chart["data"] if "link" in trace]


# ---- a campaign --------------------------------------------------------------------------------------


def test_a_campaign_is_told_by_its_verdicts_and_reasons(tmp_path):
    said = flat(opid.text(make_campaign(tmp_path)))
    assert said.startswith("Four flights (4 flights of 2 aircraft) 2 identified, 1 not determined, 1 failed.")
    assert f"Reason: 1 flight: {REFUSED}" in said
    assert "Reason: 1 flight: there is no file B/f2/heavy.csv" in said


def test_equal_reasons_are_said_once_and_few_of_many(tmp_path):
    found = make_campaign(tmp_path)
    lost = found.outcomes[-1]
    many = [replace(lost, name=f"g{k}", reason=f"reason {k // 2}") for k in range(60)]
    said = flat(opid.text(replace(found, outcomes=tuple(many))))
    assert "Reason: 2 flights: reason 0" in said
    assert said.count("Reason: ") == 21
    assert "and 10 more, in the table of flights" in said


def test_the_index_has_a_row_for_each_flight_that_leads_to_its_files(tmp_path):
    found = make_campaign(tmp_path)
    (tmp_path / "flights" / "A" / "f1" / "report.html").touch()
    page = opid.write_report(found, tmp_path)
    assert page.name == "index.html"
    body = page.read_text(encoding="utf-8")
    rows = re.findall(r"<tr><td.*?</tr>", body)
    assert len(rows) == 4
    links = [re.findall(r'href="([^"]+)"', row) for row in rows]
    assert links == [
        ["flights/A/f1/report.html"],
        ["flights/A/f2/result.json"],
        ["flights/B/f1/result.json"],
        [],
    ]
    assert all((tmp_path / each).is_file() for several in links for each in several)
    assert "there is no file B/f2/heavy.csv" in rows[3]


def test_without_figures_no_flight_can_be_ticked(tmp_path):
    found = make_campaign(tmp_path)
    strut = {"gear": StrutLaw(4e5, 6e3, None, (-0.01, 0.01))}
    told = [
        each if each.flight is None else replace(each, flight=replace(each.flight, strut_laws=strut))
        for each in found.outcomes
    ]
    found = replace(found, outcomes=tuple(told))
    with_figures = opid.write_report(found, tmp_path).read_text(encoding="utf-8")
    assert 'data-curve="' in with_figures
    without = opid.write_report(found, tmp_path, figures=False).read_text(encoding="utf-8")
    assert 'data-curve="' not in without
    assert "data-overlay" not in without


def test_names_of_flights_cannot_be_markup(tmp_path):
    found = make_campaign(tmp_path)
    odd = replace(found.outcomes[-1], tail="<script>alert(1)</script>", reason="<img src=x onerror=alert(1)>")
    page = opid.write_report(replace(found, outcomes=(*found.outcomes, odd)), tmp_path).read_text(encoding="utf-8")
    assert "<script>alert(1)" not in page
    assert "<img src=x" not in page


# ---- a fleet -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    """A campaign in which one strut loses 6 % of its stiffness: its folder, the strut, and what is found."""
    folder = tmp_path_factory.mktemp("a campaign")
    tail, _ = write_fleet(folder, n_pages=3, harm=-0.06, quantities=2)
    return folder, tail, compare_fleet(read_dataset(folder))


def test_a_change_is_said_with_its_size_interval_date_and_limit(fleet):
    _, tail, found = fleet
    said = flat(opid.text(found))
    (change,) = found.changes
    low, high = (100 * each for each in change.fraction.interval95)
    assert said.startswith("Health of a fleet (72 flights of 6 aircraft over 0.5 years) 1 change flagged.")
    size = f"{100 * change.fraction.value:+.1f} % ({low:+.1f} to {high:+.1f} %)"
    assert f"Change: Stiffness of 'gear' of {tail}: {size} since '{change.flight}' ({change.date})" in said
    assert "0.1 false alarms a year are expected at most in the whole fleet" in said


def test_the_common_values_stand_in_a_table(fleet):
    _, _, found = fleet
    rows = [line for line in opid.text(found).splitlines() if line.startswith("gear ")]
    assert [row.split()[1] for row in rows] == ["stiffness", "damping"]
    for row, series in zip(rows, found.series, strict=True):
        assert row.split()[2:4] == ["6", f"{100 * series.scatter:.2f}"]


def test_an_unharmed_fleet_is_told_so():
    said = flat(opid.text(compare_fleet(draw_fleet(seed=3)[0])))
    assert "No change exceeds its uncertainty." in said
    assert "Change:" not in said


def test_the_points_of_a_strut_and_its_row_lead_to_the_reports_of_their_flights(fleet, tmp_path):
    folder, tail, found = fleet
    page = opid.write_report(found, folder / "health").read_text(encoding="utf-8")
    charts = charts_of(page)
    assert list(charts) == ["fleet_1", "fleet_2", "strut_1"]
    # the strut that changed is the first row of the map, whose rows have names to point at
    assert sorted(charts["fleet_1"]["data"][0]["rows"]) == [f"D-00{k}" for k in range(6)]
    assert charts["fleet_1"]["data"][0]["rows"][0] == tail
    links = links_of(charts["strut_1"])
    assert len(links) == 12
    # three flights of each aircraft have pages; the others lead to what they would have, their result
    assert [each.endswith("report.html") for each in links] == [False] * 9 + [True] * 3
    for each in links[-3:]:
        assert each.startswith(f"../flights/{tail}/")
        assert (folder / "health" / unquote(each)).is_file()
    of_rows = re.findall(r'<td[^>]*><a href="([^"]+)"', page)
    assert len(of_rows) == 12
    assert all((folder / "health" / unquote(each)).is_file() for each in of_rows)
    # the struts that changed stand first
    assert of_rows[0].startswith(f"../flights/{tail}/")


# ---- flights compared --------------------------------------------------------------------------------


def test_each_point_of_compared_flights_leads_to_the_report_of_its_flight(tmp_path):
    rng = np.random.default_rng(4)
    for number in range(4):
        folder = write_result(tmp_path / "all flights" / f"f{number}", body_result(rng, day=day(number)))
        if number != 2:
            (folder / "report.html").touch()
    found = compare(read_flights([tmp_path / "all flights"]))
    page = opid.write_report(found, tmp_path / "health").read_text(encoding="utf-8")
    expected = [f"../all%20flights/f{k}/{'result.json' if k == 2 else 'report.html'}" for k in range(4)]
    charts = charts_of(page)
    assert charts
    for chart in charts.values():
        assert set(links_of(chart)) == set(expected)
        # a reader who points at one is told its gear, and hides it with its bars
        names = {each["text"] for each in chart["legend"]}
        assert {trace["meta"] for trace in chart["data"] if "link" in trace} == names
    assert all((tmp_path / "health" / unquote(each)).is_file() for each in expected)


# ---- formulas ----------------------------------------------------------------------------------------


def test_the_formula_of_a_law_is_typeset_on_the_page_and_plain_in_the_text(identified, tmp_path):
    page = opid.write_report(identified.result, tmp_path, figures=False).read_text(encoding="utf-8")
    assert re.search(r"<math[ >].*arctan.*</math>", page)
    assert "f = A (2/pi) arctan(z' / s)" in flat(opid.text(identified.result))


def test_compared_flights_stand_in_a_table_with_their_values(tmp_path):
    rng = np.random.default_rng(4)
    folders = [write_result(tmp_path / f"f{number}", body_result(rng, day=day(number))) for number in range(4)]
    found = compare(read_flights(folders))
    table = next(block for block in build_document(found).details() if isinstance(block, Table))
    heads = [column.head for column in table.columns]
    assert heads[:3] == ["flight", "date", "method"]
    assert len(heads) == 3 + len(found.series)
    place = heads.index("left stiffness [N/m]")
    estimates = [each.values[Quantity("left", "stiffness", "N/m")] for each in found.flights]
    assert [row[place] for row in table.rows] == [with_std(each.value, each.std) for each in estimates]
    nothing = replace(found, flights=tuple(replace(each, values={}) for each in found.flights))
    table = next(block for block in build_document(nothing).details() if isinstance(block, Table))
    assert table.rows[0][3:] == ("-",) * len(found.series)
