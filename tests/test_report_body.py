"""A body on several suspensions as text, JSON and page, and the truth of a simulated one."""

import json
import re
from dataclasses import fields, replace

import pytest
from body_runs import study
from made_body import LOADING, WHY, body_without_mass, short_test, small_body

import opid
from opid.errors import InputError
from opid.estimate import Estimate, with_std
from opid.json_values import json_text
from opid.mechanics.laws.law import law
from opid.mechanics.truth import BodyTruth
from opid.report.document import Table
from opid.report.sketch import sketch_suspensions
from opid.report.suspensions.figures import list_figures
from opid.report.writing import build_document
from opid.suspensions.identification import identify
from opid.suspensions.result import SCHEMA, BodyParameters, BodyRatios, Candidate, GearParameters, GearRatios
from opid.suspensions.study import StructureSettings
from opid.virtual.taxi_tests.aircraft import default_aircraft
from opid.virtual.taxi_tests.taxiing import taxi_truth
from opid.virtual.truth_file import read_truth, tabulate_truth


@pytest.fixture(scope="module")
def truth():
    return taxi_truth(short_test(duration_s=0.5), settings={"seed": 3})


def rows_of(result, truth=None):
    """Return the rows of the table of numbers: label and cells."""
    return next(block for block in build_document(result, truth).blocks if isinstance(block, Table)).rows


def lines(text):
    assert max(len(line) for line in text.splitlines()) <= 80
    return text.replace("\n", " ")


def test_the_text_holds_the_numbers_within_eighty_columns(truth):
    for result, per_mass in ((small_body(), ""), (body_without_mass(), "/M")):
        for known in (None, truth):
            text = lines(opid.text(result, known))
            assert "An aircraft made by hand (rigid body, from accelerations alone, runs of 2026-03-01)" in text
            assert f"Suspension left: arctan_velocity, f{per_mass} = A (2/pi) arctan(z' / s)" in text
            assert "Recommended: rigid body. Why: " + WHY in text
            assert "Warning: run 'loaded', 'tail': it has an offset" in text
    text = lines(opid.text(small_body()))
    assert "5393.5 .. 5412.7" in text
    assert (
        "4 sensors on the body predicted from the motion below 3 suspensions, 1.02 times the noise of 5 mm/s^2" in text
    )


def test_a_refused_answer_that_explains_nothing_tells_no_limit():
    whole = replace(small_body(), residual_over_noise=50.0)
    nothing = tuple(replace(each, stiffness=Estimate()) for each in whole.interfaces)
    for left, limit in ((0.6, "model"), (1.2, None), (float("inf"), None)):
        runs = tuple(replace(run, unexplained=left) for run in whole.runs)
        assert replace(whole, runs=runs).limited_by == "model"
        refused = replace(whole, runs=runs, interfaces=nothing)
        assert refused.limited_by == limit
        assert refused.to_dict()["structure"]["limited_by"] == limit


def test_truth_stands_beside_each_estimate(truth):
    table = {row[0]: row[1:] for row in rows_of(small_body(), truth)}
    assert table["sprung mass M"][3:] == ("5400", "+0.06%", "yes")
    assert table["c.g. y"][3:] == ("0", "-", "yes")
    assert table["roll radius"][3] == "1.72133"
    stiffness = [row[1:] for row in rows_of(small_body(), truth) if row[0] == "stiffness K"]
    assert [cells[3] for cells in stiffness] == ["150000", "470000", "470000"]
    # per kg of the body, the truth is, too; scales are not
    table = rows_of(body_without_mass(), truth)
    assert [row[4] for row in table if row[0] == "stiffness K/M"][1] == f"{4.7e5 / 5400:.6g}"
    assert next(row[4] for row in table if row[0] == "amplitude") == f"{160 / 5400:.6g}"
    assert {row[4] for row in table if row[0] == "scale"} == {"0.02"}
    nose = replace(truth.interfaces["nose"], law=law("linear"))
    other = replace(truth, interfaces={**truth.interfaces, "nose": nose})
    assert "Suspension nose: arctan_velocity" in opid.text(small_body(), other)
    assert "truth: linear" in opid.text(small_body(), other)


def test_one_loading_gives_ratios_and_nothing_absolute():
    result = body_without_mass()
    text = lines(opid.text(result))
    assert "Not determined: all runs have the same loading" in text
    rows = {row[0]: row[1:] for row in rows_of(result)}
    assert rows["sprung mass M"] == ("-", "-", "-", "kg")
    assert [label for label in rows if label.startswith("c.g.")] == ["c.g. x", "c.g. y"]
    assert rows["c.g. x"][0] == "0.6013"
    assert {cells[3] for label, cells in rows.items() if label.startswith("stiffness")} <= {"1/s^2"}


def test_suspensions_that_share_are_told_once():
    whole = small_body()
    nose, left, right = whole.interfaces
    shared = (nose, replace(left, shared_with=("right",)), replace(right, shared_with=("left",)))
    labels = [row[0] for row in rows_of(replace(whole, interfaces=shared))]
    assert "Suspension right: as left, shared" in labels
    assert labels.count("stiffness K") == 2
    assert labels.count("residual/noise") == 3


def test_candidates_are_a_table_with_a_verdict():
    structures = next(
        block for block in build_document(small_body()).blocks if getattr(block, "title", "").startswith("Structures")
    )
    table = structures.rows
    heads = [column.head for column in structures.columns]
    assert heads == ["structure", "fit", "left out", "mass ± std [kg]", "law", "verdict"]
    assert [row[-1] for row in table] == ["no fit", "rejected", "rejected", "rejected", "recommended"]
    assert table[0][1:4] == ("-", "-", "-")
    assert table[3][:4] == ("mean left, right", "14.2", "17.0", "2290 ± 120")
    none = replace(small_body(), candidates=tuple(replace(c, recommended=False) for c in small_body().candidates))
    assert "Recommended: none of them" in opid.text(none)
    assert "explains" in opid.text(none)


def test_result_json_keeps_the_schema_of_one_suspension():
    found = json.loads(json_text(small_body().to_dict()))
    assert (found["schema"], found["method"], found["date"]) == (SCHEMA, "model", "2026-03-01")
    assert set(found["parameters"]) == {each.name for each in (*fields(BodyParameters), *fields(GearParameters))}
    assert set(found["ratios"]) == {each.name for each in (*fields(BodyRatios), *fields(GearRatios))}
    none = {"value": None, "std": None, "interval95": None}
    assert found["parameters"]["suspension_stiffness_n_per_m"] == found["ratios"]["damping_ratio"] == none
    assert found["parameters"]["sprung_mass_kg"]["value"] == 5403.1
    assert found["law"]["name"] == "arctan_velocity"
    assert found["restoring_force"]["travel"] == []
    structure = found["structure"]
    assert (structure["kind"], structure["recommended"], structure["why"]) == ("rigid_body", "rigid_body", WHY)
    assert structure["places"]["left"] == {"x_m": 0.0, "y_m": 1.6, "sensor_x_m": 0.25, "sensor_y_m": 1.4}
    assert structure["place_corrections"]["sensor_x_m[left]"]["value"] == 0.006
    nose = found["interfaces"][0]
    assert (nose["name"], nose["x_m"], nose["stiffness"]["unit"], nose["damping"]["unit"]) == (
        "nose",
        5.0,
        "N/m",
        "N s/m",
    )
    assert set(nose["law"]["arctan_velocity"]) == {"amplitude_n", "scale_m_per_s"}
    assert [set(each) for each in found["candidates"]] == [{field.name for field in fields(Candidate)}] * 5
    assert found["candidates"][0]["residual_over_noise"] is None  # no fit
    told = {"unexplained": 0.01, "unexplained_left_out": None, "inside_left_out": None, "spectra_left_out": []}
    assert found["runs"][1] == {"name": "loaded", "mass_change_kg": 500.0, "loading": [[500.0, -1.0, 0.2]]} | told


def test_result_json_keeps_its_keys():
    found = small_body().to_dict()
    old = "schema method title date parameters ratios law restoring_force structure interfaces candidates runs"
    assert set(found) == {*old.split(), "fits", "equivalents", "weighed", "diagnostics", "warnings", "not_determined"}
    old = "kind recommended why residual_over_noise noise_m_per_s2 places place_corrections"
    assert set(old.split()) <= set(found["structure"])
    old = "name shared_with x_m y_m stiffness damping law law_name latex per_mass residual_over_noise"
    assert set(old.split()) <= set(found["interfaces"][0])
    old = "study body_sensors why kind_asked_for position_tolerance_m noise_stated runs n_data white laws_tried law"
    assert {*old.split(), "band_hz"} <= set(found["diagnostics"])
    assert found["diagnostics"]["body_sensors"] == {"tail": [-4.0, 0.0]}
    assert found["diagnostics"]["settings"]["estimator"]["verdicts"]["explained"] == 1.2


def test_a_body_that_was_fitted_tells_its_evidence(tmp_path, monkeypatch):
    result = identify(study(), law="arctan_velocity")
    assert not result.study.is_one_gear
    opid.write_report(result, tmp_path)
    found = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    (model,) = found["diagnostics"]["models"]
    assert set(model["surfaces"]) == {group.name for group in result.evidence[0].fit.model.groups}
    assert {"demanded", "sensors", "whiteness", "limits"} <= set(model)
    assert found["diagnostics"]["laws_tried"][0].keys() == {"law", "bic", "kept", "fs_hz"}
    assert found["diagnostics"]["n_data"] == result.evidence[0].fit.n_data
    lines(opid.text(result))


def test_result_json_without_mass_without_date_and_with_several_laws():
    result = body_without_mass()
    first = replace(result.interfaces[0], law=result.interfaces[0].law.scaled(0.0).__class__(), law_estimates={})
    found = replace(
        result, study=replace(result.study, date=None), interfaces=(first, *result.interfaces[1:])
    ).to_dict()
    assert found["date"] is None
    assert found["law"] == {"name": None, "latex": None, "per_mass": True, "parameters": {}}
    assert {each["stiffness"]["unit"] for each in found["interfaces"]} == {"1/s^2"}
    assert found["not_determined"].startswith("all runs")


def test_the_page_holds_tables_figures_and_the_command(tmp_path, truth):
    page = opid.write_report(small_body(), tmp_path / "report", truth).read_text(encoding="utf-8")
    names = [figure.name for figure in list_figures(small_body())]
    assert page.count('data-chart="') == len(names) == 6
    assert sorted(path.name for path in (tmp_path / "report").iterdir()) == sorted(["report.html", "result.json"])
    for words in (
        "Structures: residual over noise",
        "arctan_velocity + cubic_stiffness",
        "+0.06%",
        "runs of 2026-03-01",
        "opid identify &#39;my study.toml&#39; --band 0.3 40",
        "opid.read_study(&#34;my study.toml&#34;),\n    band_hz=(0.3, 40.0)",
    ):
        assert words in page
    assert "<strong>Warning</strong>" in page


def test_a_page_of_nothing_determined_is_written_all_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr("opid.report.suspensions.identification.list_figures", lambda result, truth: ())
    whole = body_without_mass()
    none = Estimate()
    interfaces = tuple(replace(each, stiffness=none, damping=none, law_estimates={}) for each in whole.interfaces)
    empty = replace(
        whole,
        interfaces=interfaces,
        ratios=BodyRatios(),
        candidates=(),
        why="",
        warnings=(),
        place_corrections={},
    )
    page = opid.write_report(empty, tmp_path).read_text(encoding="utf-8")
    assert "Not determined:" in page
    assert "Structures:" not in page
    assert [figure.name for figure in list_figures(empty)] == ["plan_view", "candidates"]
    lines(opid.text(empty))


def test_a_truth_is_read_back(tmp_path, truth):
    path = tmp_path / "truth.json"
    table = tabulate_truth(truth)
    path.write_text(json_text(table), encoding="utf-8")
    assert read_truth(path, BodyTruth) == truth
    airframe = default_aircraft()
    assert table["parameters"]["pitch_inertia_kg_m2"] == airframe.iyy_kg_m2
    assert table["interfaces"]["left"]["law"]["parameters"]["arctan_velocity"]["amplitude_n"] == 480.0
    assert table["loadings"] == {"reference": [], "loaded": [[each.mass_kg, each.x_m, each.y_m] for each in LOADING]}
    path.write_text(json.dumps({**table, "schema": "opid.truth/1"}), encoding="utf-8")
    with pytest.raises(InputError, match="body-truth/1' is needed"):
        read_truth(path, BodyTruth)
    path.write_text(json.dumps({**table, "parameters": {}}), encoding="utf-8")
    with pytest.raises(InputError, match=r"not the truth of a simulated aircraft, it has no .*: give the truth"):
        read_truth(path, BodyTruth)


def test_the_sketch_shows_each_suspension_from_above_with_its_numbers():
    sketch = sketch_suspensions(small_body())
    places = {
        name: tuple(
            map(float, re.search(rf'<circle cx="([^"]+)" cy="([^"]+)"[^>]*/>\n<text[^>]*>{name}<', sketch.svg).groups())
        )
        for name in ("nose", "left", "right")
    }
    # the front is above, and left is left
    assert places["nose"][1] < places["left"][1] == places["right"][1]
    assert places["left"][0] < places["nose"][0] < places["right"][0]
    for words in ("M = 5403.1 ± 4.9 kg", "Ixx = 15960 ± 41 kg m²", "c.g. x = 0.6013 ± 0.0011 m"):
        assert words in sketch.svg
        assert words in sketch.alt
    for each in small_body().interfaces:
        assert f"{each.name}: K = {with_std(each.stiffness.value, each.stiffness.std)} N/m, C = " in sketch.alt
    assert sketch.svg.count("N/m<") == sketch.svg.count("law: ") == 3


def test_the_sketch_of_one_loading_shows_ratios_and_that_of_a_refused_body_nothing():
    sketch = sketch_suspensions(body_without_mass())
    assert "M is not determined" in sketch.svg
    assert "K/M = " in sketch.svg
    nothing = tuple(replace(each, stiffness=Estimate()) for each in small_body().interfaces)
    assert sketch_suspensions(replace(small_body(), interfaces=nothing)) is None


def test_suspensions_on_one_line_are_sketched_on_both_sides():
    whole = small_body()
    places = [{"x_m": x, "y_m": 0.0, "sensor_x_m": x, "sensor_y_m": 0.0} for x in (2.0, 1.0, 0.0)]
    line = tuple(replace(each, **place) for each, place in zip(whole.study.interfaces, places, strict=True))
    study = replace(whole.study, interfaces=line, structure=StructureSettings("single", noise_m_per_s2=0.005))
    sketch = sketch_suspensions(replace(whole, study=study, structure="single"))
    assert {float(x) for x in re.findall(r'<circle cx="([^"]+)"', sketch.svg)} == {310}
    assert {"start", "end"} <= set(re.findall(r'text-anchor="(\w+)"', sketch.svg))
