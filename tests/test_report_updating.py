"""An updating as text, JSON and page."""

import json
from dataclasses import replace

import numpy as np
import pytest
from made_updating import CUBIC, small_system, small_truth, small_updating

from opid.errors import InputError
from opid.report import read_updating_truth, updating_json, updating_text, write_updating_report
from opid.report.as_json import json_text
from opid.report.updating_pictures import reached_extension
from opid.report.updating_tables import best_sentence, class_table, coefficient_estimates, doubts_of, tables
from opid.updating.reduction import ReductionErrors
from opid.updating.result import Evidence


@pytest.fixture(scope="module")
def result():
    return small_updating()


def line_of(text, start):
    return next(line for line in text.splitlines() if line.startswith(start))


def test_the_text_holds_the_numbers_within_eighty_columns(result):
    for truth in (None, small_truth()):
        text = updating_text(result, truth)
        assert max(len(line) for line in text.splitlines()) <= 80
    assert "8 backbones (5 of mode 1, 3 of mode 2), 96 points, 6 sensors, 2 joints" in text
    assert line_of(text, "class 2").split() == ["class", "2", "cubic", "360.20", "-", "best", "365.20"]
    assert "-279.20" in line_of(text, "class 1")
    assert "ahead of class 4 by 2.30 (odds 9.97 to 1)" in text
    assert line_of(text, "1       14.65 Hz").split()[-2:] == ["0.810", "0.990"]
    assert "360.10 ± 0.19" in text
    assert "Warning: class 4: the chains of theta_2" in text


def test_coefficients_are_in_si_units_whatever_the_sign_of_the_scale(result):
    cubic, unit = coefficient_estimates(result.classes[1])["cubic_stiffness"]
    assert (cubic.value, cubic.std, unit) == (pytest.approx(CUBIC), pytest.approx(0.04 * 6.8e7), "N/m^3")
    quartic, unit = coefficient_estimates(result.classes[2])["quartic_stiffness"]
    assert unit == "N/m^4"
    assert quartic.value == pytest.approx(-2.7e9 * 0.6)
    assert quartic.std > 0
    assert quartic.interval95[0] < quartic.value < quartic.interval95[1]


def test_truth_stands_beside_the_classes_that_hold_the_true_law(result):
    text = updating_text(result, small_truth())
    rows = [line for line in text.splitlines() if line.startswith(("cubic", "quadratic", "quartic"))]
    assert rows[0].split()[-3:] == ["-", "-", "-"]  # no cubic term: there is no true value
    assert rows[1].split()[-3:] == ["1.0744e+08", "+0.00%", "yes"]
    assert rows[2].split()[-1] == "no"
    assert rows[3].split()[-3:] == ["0", "-", "yes"]
    assert line_of(text, "E_steel").split()[-3:] == ["0.31", "+0.00%", "yes"]


def test_one_class_one_method_and_no_linear_updating_are_told_too(result):
    alone = replace(result.classes[1], evidences=(Evidence("laplace", 360.2),), prior_sensitivity={})
    few = replace(result, linear=None, classes=(alone,), prediction=())
    text = updating_text(few)
    assert "Best: class 2, the only class" in text
    assert "Linear structure" not in text
    assert len(tables(few)) == 1
    assert updating_json(few)["linear"] is None


def test_a_class_that_explains_nothing_is_told(result):
    lost = replace(result.classes[0], evidences=(Evidence("laplace", -np.inf),))
    two = replace(result, classes=(lost, result.classes[1]))
    assert "no other class can explain the data" in best_sentence(two)
    assert class_table(two)[1][4] == "-inf"
    assert json.loads(json_text(updating_json(two)))["classes"][0]["log_evidence"] is None


def test_what_is_not_determined_is_said(result):
    text = updating_text(
        replace(result, not_determined="no class explains the backbones", best_class="", prediction=())
    )
    assert "Not determined: no class explains the backbones" in text


def test_json_has_the_schema_and_is_strict(result):
    document = json.loads(json_text(updating_json(result)))
    assert document["schema"] == "opid.updating/1"
    assert document["best_class"] == "class 2"
    second = document["classes"][1]
    assert (second["name"], second["law"], second["kinds"]) == ("class 2", "cubic", ["cubic_stiffness"])
    assert (second["log_evidence"], second["log_evidence_std"]) == (360.2, 0.0)
    assert [each["method"] for each in second["evidences"]] == ["laplace", "transitional", "quadrature"]
    assert second["parameters"]["theta_1"]["mean"] == 1.58
    assert second["parameters"]["theta_1"]["interval95"] == pytest.approx([1.5016, 1.6584])
    assert second["coefficients"]["cubic_stiffness"]["mean"] == pytest.approx(CUBIC)
    assert second["coefficients"]["cubic_stiffness"]["unit"] == "N/m^3"
    assert second["priors"] == [{"family": "uniform", "first": 0.0, "second": 10.0}]
    assert set(second["diagnostics"]) == {
        *("sampler", "n_samples", "n_evaluations", "acceptance", "effective_samples", "r_hat"),
    }
    assert document["classes"][2]["prior_sensitivity"] == {"theta_1": -0.693, "theta_2": -0.693}
    assert document["classes"][2]["warnings"]
    assert document["linear"]["best"] == {"E_aluminium": 0.88, "E_steel": 0.31}
    assert document["linear"]["modes"][0]["updated_mac"] == 0.99
    assert document["system"]["frequency_hz"] == pytest.approx([14.65, 17.71, 60.0])
    assert len(document["measured"]) == 8
    assert len(document["measured"][0]["amplitude"]["10"]) == 12
    band = document["prediction"][0]
    assert set(band) == {"mode", "sensor", "amplitude", "frequency_hz", "low_hz", "high_hz", "coverage"}
    assert {"warnings", "not_determined", "settings", "form", "title"} <= set(document)


def test_the_page_opens_offline_with_its_figures_inside(result, tmp_path, monkeypatch):
    monkeypatch.setattr("opid.plots.style.png", lambda figure: b"\x89PNG")  # figures are tested by themselves
    said = []
    page = write_updating_report(result, tmp_path / "out", small_truth(), progress=said.append)
    text = page.read_text(encoding="utf-8")
    names = {path.stem for path in (tmp_path / "out").glob("*.png")}
    assert names == {
        *("measured_mode_1", "measured_mode_2", "predicted_mode_1", "predicted_mode_2"),
        *("linear_updating", "linear_samples", "linear_running", "log_evidences", "joint_forces"),
        *(f"class_{number}_{what}" for number in (1, 2, 3) for what in ("samples", "running")),
    }
    assert text.count("data:image/png") == len(names) == len(said)
    assert "http" not in text
    assert "opid update study.toml --form recommended --sampler adaptive --samples 5000 --seed 1" in text
    assert json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))["schema"] == "opid.updating/1"


def test_what_the_reduction_leaves_out_is_drawn_and_kept_where_it_is_given(result, tmp_path, monkeypatch):
    monkeypatch.setattr("opid.plots.style.png", lambda figure: b"\x89PNG")
    errors = ReductionErrors(np.array([0.0, 14.65]), np.array([0.0, 14.66]), np.array([0.0, 7e-4]), np.ones(2))
    few = replace(result, linear=None, classes=(), measured=(), prediction=())
    write_updating_report(few, tmp_path, reduction=errors)
    assert [path.name for path in tmp_path.glob("*.png")] == ["reduction.png"]
    document = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert document["reduction"]["relative"] == [0.0, 7e-4]
    assert updating_json(result)["reduction"] is None


def test_a_warning_of_a_part_is_told_once(result):
    told = replace(result, warnings=("class 'class 4': the chains of theta_2 have few effective samples",))
    doubts = doubts_of(told)
    assert sum("theta_2" in doubt for doubt in doubts) == 1
    assert any("E_steel" in doubt for doubt in doubts)


def test_the_extension_that_was_reached_follows_the_shape_of_the_mode(result):
    system = small_system()
    ratio = np.abs(system.at_joints).max(axis=0) / np.abs(system.at_sensors[system.sensor("10")])
    largest = [
        max(curve.controlled_amplitude[-1] for curve in result.measured if curve.mode == mode) for mode in (1, 2)
    ]
    assert reached_extension(result) == pytest.approx({mode: ratio[mode - 1] * largest[mode - 1] for mode in (1, 2)})
    assert reached_extension(replace(result, measured=())) == {}


def test_a_truth_is_read_and_anything_else_refused(tmp_path):
    path = tmp_path / "truth.json"
    path.write_text(json.dumps(small_truth()), encoding="utf-8")
    assert read_updating_truth(path)["law"] == {"cubic_stiffness": CUBIC}
    for text, words in (
        ('{"schema": "opid.truth/1"}', "where 'opid.updating-truth/1' is needed"),
        ('{"schema": "opid.updating-truth/1", "linear": {}, "law": {"a": "x"}}', "no truth of simulated backbones"),
        ("[1]", "no truth of simulated backbones"),
        ("{", "no truth of simulated backbones"),
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=words):
            read_updating_truth(path)
    with pytest.raises(InputError, match="cannot read"):
        read_updating_truth(tmp_path / "none.json")
