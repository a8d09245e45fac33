"""The report: valid JSON that says what the result says, text of 80 columns, a page that needs no network."""

import json
import math
import re
import shlex
import subprocess
import sys
from dataclasses import asdict, fields, replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from matplotlib.text import Text

import opid
from opid import plots
from opid.errors import InputError, NotDeterminedError
from opid.estimate import RAISED, Estimate, format_number, rounded, with_std
from opid.json_values import json_text, plain
from opid.mechanics.laws.law import default_law, law_from_parameters
from opid.mechanics.truth import BodyNumbers, BodyTruth, GearNumbers, GearTruth, SuspensionTruth
from opid.report.as_text import lay_out_text, wrap_text
from opid.report.document import Document, Table, build_columns
from opid.report.estimates import build_estimate_row
from opid.report.sketch import sketch_suspensions
from opid.report.suspensions import identification as report_module
from opid.report.suspensions.again import write_command, write_python
from opid.report.suspensions.figures import list_figures
from opid.report.writing import build_document
from opid.signals import files
from opid.signals.files import make_directory, require_directory, write_together
from opid.signals.health.inspection import inspect
from opid.signals.logs import read_log
from opid.studies.study_file import read_study
from opid.studies.suspension_study import study_from_logs
from opid.suspensions.identification import identify
from opid.suspensions.result import GearParameters, Identification
from opid.suspensions.sensor_facts import SensorFacts, SensorPair
from opid.suspensions.settings import Settings, Verdicts
from opid.suspensions.study import study_of_gear
from opid.virtual.truth_file import read_truth, tabulate_truth

OLD_KEYS = {
    "schema",
    "method",
    "title",
    "date",
    "parameters",
    "ratios",
    "law",
    "restoring_force",
    "diagnostics",
    "weighed",
    "warnings",
    "not_determined",
}
NEW_KEYS = {"structure", "interfaces", "candidates", "runs", "fits", "equivalents", "natural_frequency_of"}
"""Of the driven model."""
OLD_DIAGNOSTICS = {
    "": "settings unexplained_noise_m_per_s2 sensor_noise_floor_m_per_s2 unexplained_over_floor n_lines "
    "static_transmissibility_read_from_lines law_candidates law_ladder law_alternatives peak_pairs table_3 runs model",
    "settings": "study sprung unsprung high_pass_hz law ground band_hz",
    "law_ladder": "law bic unexplained_noise_m_per_s2 left_out_m_per_s2 road kept chosen",
    "peak_pairs": "run reference_hz reference_magnitude changed_hz changed_magnitude credible reason as_printed "
    "sign_restored",
    "runs": "name mass_change_kg duration_s fs n_averages n_blocks noise_floor_m_per_s2 travel_rms_m "
    "velocity_rms_m_per_s surface_coverage terms complex_least_squares errors_in_variables peaks_hz findings",
    "model": "noise_m_per_s2 whiteness std_over_white bootstrap_std_over_white sensors demanded "
    "imitates_ground_spring mended_spikes surface n_starts limits",
}
"""What result.json of one gear has always told."""
N_PICTURES = 13


def read_number(text):
    """The value of a number as every text and picture of opid writes it."""
    mantissa, _, power = text.partition("×10")
    return float(f"{mantissa}e{power.translate({raised: letter for letter, raised in RAISED.items()}) or 0}")


def one_picture(name):
    """Draw only this figure, or none."""
    return lambda result, truth: [each for each in list_figures(result, truth) if each.name == name]


def first_table(result, truth=None):
    return next(block for block in build_document(result, truth).blocks if isinstance(block, Table))


def rows_of(result, truth=None):
    """Return the cells of each row of the table of numbers by its label."""
    return {row[0]: row[1:] for row in first_table(result, truth).rows}


@pytest.fixture(scope="module")
def document(identified):
    return identified.result.to_dict()


@pytest.fixture(scope="module")
def one_run(field_test):
    study = read_study(field_test / "study.toml")
    return identify(study_of_gear("alone", sprung=study.sprung, unsprung=study.unsprung, runs=study.runs[:1]))


@pytest.fixture(scope="module")
def by_paper(field_test):
    return identify(read_study(field_test / "study.toml"), method="paper", law="arctan_velocity")


@pytest.fixture(scope="module")
def refused(field_test):
    """A result in which hardly anything may be left unexplained, so that no model explains the runs."""
    return replace_noise(read_study(field_test / "study.toml"))


NEXT_TO_NOTHING = Settings(verdicts=Verdicts(refused_fraction=1e-3))


def replace_noise(study):
    facts = SensorPair(SensorFacts(noise_m_per_s2=1e-4), SensorFacts(noise_m_per_s2=1e-4))
    louder = replace(study, interfaces=(replace(study.interfaces[0], facts=facts),))
    return identify(louder, law="linear", settings=NEXT_TO_NOTHING)


@pytest.fixture(scope="module")
def report(identified, tmp_path_factory):
    directory = tmp_path_factory.mktemp("report")
    opid.write_report(identified.result, directory, identified.truth)
    return directory


def titled(result, title):
    return replace(result, study=replace(result.study, title=title))


# ---- JSON ----------------------------------------------------------------------------------------


def test_json_has_the_promised_keys(document):
    assert set(document) == OLD_KEYS | NEW_KEYS
    assert document["schema"] == "opid.identification/1"
    assert set(document["parameters"]) == {each.name for each in fields(GearParameters)}
    for estimate in [*document["parameters"].values(), *document["ratios"].values()]:
        assert set(estimate) == {"value", "std", "interval95"}
        # a ground spring that the runs do not demand is zero, and has no interval
        if estimate["value"] != 0.0:
            assert estimate["interval95"][0] <= estimate["value"] <= estimate["interval95"][1]
    assert document["not_determined"] is None
    assert json.loads(json_text(document)) == document


def test_json_of_one_gear_keeps_the_keys_of_its_diagnostics(document):
    for part, names in OLD_DIAGNOSTICS.items():
        told = document["diagnostics"] if not part else document["diagnostics"][part]
        for each in told if isinstance(told, list) else [told]:
            assert set(names.split()) <= set(each), part
    model = document["diagnostics"]["model"]
    assert set(model["noise_m_per_s2"]) == set(model["mended_spikes"]) == {"unsprung", "sprung"}
    assert set(model["whiteness"]) == {"statistic", "white", "band_hz", "excess"}
    assert set(model["surface"]) == {
        "largest_departure_in_standard_errors",
        "expected_by_chance",
        "largest_departure_percent",
    }
    assert "inverse_mass" in model["std_over_white"]
    assert sum(step["chosen"] for step in document["diagnostics"]["law_ladder"]) == 1


def test_json_tells_every_setting(document):
    assert document["diagnostics"]["settings"]["estimator"] == plain(asdict(Settings()))
    assert document["diagnostics"]["settings"]["band_hz"] == [0.3, 40.0]


def test_json_of_the_paper_has_its_own_diagnostics(by_paper):
    document = by_paper.to_dict()
    assert set(document) == OLD_KEYS
    assert set(OLD_DIAGNOSTICS[""].split()) == set(document["diagnostics"])
    assert document["diagnostics"]["model"] is None
    assert json.loads(json_text(document)) == document


def test_the_law_of_json_gives_the_force_of_json(document):
    values = {
        kind: {name: estimate["value"] for name, estimate in parameters.items()}
        for kind, parameters in document["law"]["parameters"].items()
    }
    law = law_from_parameters(document["law"]["name"], values)
    force = document["restoring_force"]
    assert len({len(force[name]) for name in ("travel", "velocity", "force", "nonlinear_force")}) == 1
    travel, velocity = np.array(force["travel"]), np.array(force["velocity"])
    assert np.allclose(law.force(travel, velocity), force["nonlinear_force"])
    stiffness, damping = (
        document["parameters"][name]["value"]
        for name in ("suspension_stiffness_n_per_m", "suspension_damping_n_s_per_m")
    )
    linear = np.array(force["force"]) - np.array(force["nonlinear_force"])
    assert np.allclose(linear, stiffness * travel + damping * velocity)
    assert force["units"]["force"] == "N"


def test_without_a_mass_json_has_nulls_and_a_reason(one_run):
    document = one_run.to_dict()
    assert document["parameters"]["sprung_mass_kg"] == {"value": None, "std": None, "interval95": None}
    assert "ratios to the mass alone" in document["not_determined"]
    assert document["law"]["per_mass"] is True
    assert document["restoring_force"]["units"]["force"] == "m/s^2"
    assert document["ratios"]["stiffness_per_mass"]["value"] == pytest.approx(3.9e5 / 1850, rel=0.01)


def test_json_has_null_where_a_number_is_not_finite(identified):
    broken = replace(
        identified.result,
        parameters=GearParameters(Estimate(math.nan, math.inf, (-math.inf, 1.0))),
        mended_spikes=(np.int64(1), np.float64("nan")),
    )
    document = json.loads(json_text(broken.to_dict()))
    assert document["parameters"]["sprung_mass_kg"] == {"value": None, "std": None, "interval95": [None, 1.0]}
    assert document["diagnostics"]["model"]["mended_spikes"] == {"unsprung": 1, "sprung": None}


leaves = st.none() | st.booleans() | st.integers(-(10**9), 10**9) | st.floats() | st.text()


@given(st.recursive(leaves, lambda each: st.lists(each) | st.dictionaries(st.text(), each), max_leaves=20))
def test_json_text_reads_back(value):
    document = plain({"content": value})
    assert json.loads(json_text(document)) == document


def test_lists_of_numbers_stand_on_one_line(document):
    longest = max(json_text(document).splitlines(), key=len)
    assert longest.count(",") >= len(document["restoring_force"]["travel"]) - 1


# ---- text ----------------------------------------------------------------------------------------


def test_text_shows_each_parameter_within_80_columns(identified):
    text = opid.text(identified.result)
    for label in ("sprung mass M2", "stiffness K2", "damping C2", "ground K3", "amplitude", "scale"):
        assert label in text
    assert "arctan_velocity, f = A (2/pi) arctan(z' / s)" in text
    assert max(map(len, text.splitlines())) <= 80
    for warning in identified.result.warnings:
        assert warning.split(":")[0][:40] in " ".join(text.split())


LAW = "blow_off_damping + cubic_stiffness + coulomb_friction"
STRUCTURES = (
    ("rigid body", "1.0", "1.1", "5400 ± 3", LAW, "recommended"),
    ("each gear alone", "11", "12", "5390 ± 20", "linear", "rejected"),
)


def test_a_wide_table_breaks_the_names_of_laws_and_cuts_none():
    heads = ("structure", "fit", "left out", "mass ± std [kg]", "law", "verdict")
    table = Table(build_columns(*heads, left=(0, 4, 5), elastic=(4,)), STRUCTURES)
    lines = lay_out_text(Document("a car", "", "known", blocks=(table,))).splitlines()[4:]
    assert max(map(len, lines)) <= 80
    assert [line.split() for line in lines] == [
        " ".join(heads).split(),
        ["rigid", "body", "1.0", "1.1", "5400", "±", "3", "blow_off_damping", "+", "recommended"],
        ["cubic_stiffness", "+"],
        ["coulomb_friction"],
        ["each", "gear", "alone", "11", "12", "5390", "±", "20", "linear", "rejected"],
    ]
    words = ("law", "blow", "cubic", "coulomb", "linear")
    assert len({line.find(word) for line, word in zip(lines, words, strict=True)}) == 1


def test_text_compares_with_the_truth(identified):
    table = rows_of(identified.result, identified.truth)
    value, _, unit, true, error, inside = table["sprung mass M2"]
    assert (unit, true, inside) == ("kg", "1850", "yes")
    assert float(error.rstrip("%")) == pytest.approx(100 * (float(value) / 1850 - 1), abs=0.02)
    truth = identified.truth
    other = replace(truth, parameters=replace(truth.parameters, sprung_mass_kg=2000.0))
    table = rows_of(identified.result, other)
    assert table["sprung mass M2"][-1] == "no"
    assert max(map(len, opid.text(identified.result, identified.truth).splitlines())) <= 80


def test_text_says_another_true_law(identified):
    other = replace(identified.truth, law=opid.law("cubic_stiffness", stiffness_n_per_m3=3e9))
    assert "truth: cubic_stiffness" in opid.text(identified.result, other)


def test_text_without_a_mass_says_why_and_gives_ratios(one_run, identified):
    text = opid.text(one_run, identified.truth)
    assert "Not determined: one run gives ratios to the mass alone" in text
    table = rows_of(one_run, identified.truth)
    assert table["sprung mass M2"][0] == "-"
    assert table["amplitude"][2] == "N/kg"
    # the true law per unit of the true mass
    assert float(table["amplitude"][3]) == pytest.approx(400 / 1850, rel=1e-5)
    assert table["K2/M2"][-1] in ("yes", "no")


def test_what_is_found_of_a_sensor_stands_beside_what_was_known_of_it(field_test):
    study = read_study(field_test / "study.toml")
    facts = SensorPair(SensorFacts(), SensorFacts(lag_tolerance_s=0.002))
    found = identify(replace(study, interfaces=(replace(study.interfaces[0], facts=facts),)), law="arctan_velocity")
    table = next(
        block
        for block in build_document(found).blocks
        if getattr(block, "columns", None) and block.rows[0][0] == "lag_s"
    )
    assert [column.head for column in table.columns][1:] == ["found", "std. dev.", "known before", "std. dev."]
    ((_, lag_s, std, *before),) = table.rows
    assert before == ["0", "0.002"]
    # the simulated sensors have none
    assert abs(read_number(lag_s)) < 4 * read_number(std) < 0.002


@given(
    st.floats(-1e9, 1e9).filter(lambda x: x == 0 or abs(x) > 1e-9),
    st.floats(1e-9, 1e9),
)
def test_rounding_keeps_what_the_uncertainty_leaves(value, std):
    text = rounded(value, std)
    assert abs(read_number(text) - value) <= 0.051 * std + 1e-12 * abs(value)
    assert not text.startswith("-0") or read_number(text) != 0


@given(st.floats(-1e12, 1e12).filter(lambda x: x == 0 or abs(x) > 1e-12), st.integers(1, 9))
def test_a_number_has_one_style_and_the_digits_that_count(value, digits):
    text = format_number(value, digits)
    assert read_number(text) == pytest.approx(value, rel=0.51 * 10.0 ** (1 - digits))
    assert re.fullmatch(r"-?(\d{1,6}(\.\d*[1-9])?|[1-9](\.\d*[1-9])?×10⁻?[⁰¹²³⁴⁵⁶⁷⁸⁹]+)", text)
    assert format_number(value, digits, has_sign=True) == ("+" if read_number(text) > 0 else "") + text


def test_no_number_of_a_report_has_groups_or_a_power_of_ten_of_a_program(identified, by_paper, one_run):
    for result in (identified.result, by_paper, one_run):
        document = build_document(result)
        assert not re.findall(r"\d[eE][+-]?\d|\d,\d{3}\b", opid.text(result))
        for figure in document.figures:
            drawn = plots.figure_of(figure.draw())
            said = [text.get_text() for text in drawn.findobj(Text)]
            assert not [text for text in said if re.search(r"\de[+-]?\d|\d,\d{3}\b|\d \d{3}\b", text)], figure.name


def test_health_is_told_in_words_and_json(field_test):
    health = inspect(read_log(field_test / "heavy.csv"))
    text = opid.text(replace(health, log="heavy.csv"))
    assert "256 Hz" in text
    assert "'lower_z' looks like the unsprung channel" in text
    assert "Nothing is wrong." in text
    document = replace(health, log="heavy.csv").to_dict()
    assert document["logs"][0]["channels"][0]["name"] == "lower_z"
    assert json.loads(json_text(document)) == document


# ---- page ----------------------------------------------------------------------------------------


class Links(HTMLParser):
    """Collects whatever a page may load, its text and its open tags."""

    def __init__(self):
        super().__init__()
        self.sources, self.tags, self.open = [], set(), []

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.sources += [value for name, value in attrs if name in ("src", "href", "data", "srcset")]
        if tag not in ("meta", "link", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_page_is_self_contained_and_well_formed(report):
    html = (report / "report.html").read_text(encoding="utf-8")
    parser = Links()
    parser.feed(html)
    assert parser.open == []
    assert parser.sources
    assert all(source.startswith("#") and f'id="{source[1:]}"' in html for source in parser.sources)
    assert not parser.tags & {"img", "link", "iframe"}
    assert not re.search(r"url\(|@import|https?://", html)


def test_the_charts_of_the_page_are_the_figures(report, identified):
    html = (report / "report.html").read_text(encoding="utf-8")
    charts = dict(re.findall(r'data-chart="(\w+)">\s*<script type="application/json">(.*?)</script>', html, re.DOTALL))
    assert list(charts) == [figure.name for figure in list_figures(identified.result, identified.truth)]
    assert len(charts) == N_PICTURES
    for text in charts.values():
        assert {"data", "layout", "legend"} == json.loads(text).keys()
        assert "<" not in text  # whatever a channel is called, it ends no script


def test_the_page_tells_numbers_warnings_and_how_to_do_it_again(report, identified):
    html = (report / "report.html").read_text(encoding="utf-8")
    assert "sprung mass M2" in html
    assert ("<strong>Warning" in html) == bool(identified.result.warnings)
    assert f"opid identify {identified.result.study.source} --band 0.3 40" in html
    result = json.loads((report / "result.json").read_text(encoding="utf-8"))
    read = [Path(file["name"]).name for file in result.pop("provenance")["files"]]
    assert read == ["study.toml", "heavy.csv", "light.csv"]
    assert result == identified.result.to_dict()


def test_a_title_is_text_on_the_page_and_never_markup(identified, tmp_path, monkeypatch):
    monkeypatch.setattr(report_module, "list_figures", one_picture("accelerations"))
    opid.write_report(titled(identified.result, "<script>alert(1)</script>"), tmp_path)
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<script>alert" not in html
    assert "&lt;script&gt;alert" in html


def test_a_reason_and_missing_values_are_on_the_page(one_run, tmp_path, monkeypatch):
    monkeypatch.setattr(report_module, "list_figures", one_picture("estimates"))
    opid.write_report(one_run, tmp_path)
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Not determined:</strong>" in html
    assert "one run gives ratios to the mass alone" in html


def test_every_kind_of_result_has_text_page_and_json(identified, one_run, by_paper, refused, tmp_path, monkeypatch):
    for number, result in enumerate((identified.result, one_run, by_paper, refused)):
        assert max(map(len, opid.text(result).splitlines())) <= 80
        page = opid.write_report(result, tmp_path / str(number)).read_text(encoding="utf-8")
        assert page.count('data-chart="') == len(list(list_figures(result)))
        found = json.loads((tmp_path / str(number) / "result.json").read_text(encoding="utf-8"))
        assert found["method"] == result.method
        assert ("Not determined" in page) == bool(result.not_determined)


def test_no_figure_of_a_refused_answer_draws_its_fit(refused):
    assert refused.is_refused
    names = {figure.name for figure in list_figures(refused)}
    assert names >= {"accelerations", "restoring_force_surface", "law_ladder", "transmissibility"}
    assert not names & {"law_curves", "force_sections", "force_departures", "equation_residual"}
    for draw in (plots.law_curves, plots.equation_residual):
        with pytest.raises(NotDeterminedError, match="no fit to draw"):
            draw(refused)
    magnitude = plots.transmissibilities(refused)[0, 0]
    assert "fitted suspension" not in [line.get_label() for line in magnitude.lines]


def test_the_peak_formula_is_drawn_only_where_the_method_of_the_paper_is_asked_for(identified, by_paper):
    for result, expected in ((identified.result, False), (by_paper, True)):
        (figure,) = (each for each in list_figures(result) if each.name == "estimates")
        assert ("peak formula" in figure.text) is expected
        names = " ".join(label.get_text() for label in figure.draw()[0, 0].get_yticklabels())
        assert ("as printed" in names) is expected


def test_a_law_whose_errors_prevent_an_answer_is_not_drawn(identified, one_run):
    """The terms of a wrong law that was given may be thousands of times the force, and cancel."""

    def fail(result):
        evidence = replace(result.evidence[0], error=SimpleNamespace(limit="model", left_out=()))
        failed = replace(result, evidence=(evidence,), not_determined="an error of the model biases the parameters")
        return {figure.name for figure in list_figures(failed)}

    of_law = {"law_curves", "estimates"}
    assert of_law <= {figure.name for figure in list_figures(identified.result)}
    assert not of_law & fail(identified.result)
    assert {"law_ladder", "force_sections", "force_departures", "equation_residual"} <= fail(identified.result)
    # one run gives no mass whatever its law is
    assert of_law <= fail(one_run)


@pytest.mark.parametrize("method", ["classical", "paper"])
def test_no_figure_of_the_paper_draws_a_fit_that_ran_away(method, field_test):
    """Sensors are exchanged: the joint fit leaves 38 times the noise, and its force takes |T| to 1e6."""
    study = read_study(field_test / "study.toml")
    gear = study.interfaces[0]
    exchanged = replace(study, interfaces=(replace(gear, sprung=gear.unsprung, unsprung=gear.sprung),))
    found = identify(exchanged, method=method, law="cubic_stiffness")
    assert found.is_refused
    figures = list(list_figures(found))
    assert {"accelerations", "slices", "law_ladder", "transmissibility"} <= {each.name for each in figures}
    for figure in figures:
        axes = np.ravel(figure.draw())
        assert max(abs(end) for ax in axes for end in (*ax.get_xlim(), *ax.get_ylim())) < 1e5, figure.name
    with pytest.raises(NotDeterminedError, match="no fit to draw: "):
        plots.law_curves(found)


def test_a_refused_answer_names_no_law_and_draws_no_masses(refused):
    assert "Law: " not in opid.text(refused)
    assert isinstance(refused, Identification)
    assert "estimates" not in {each.name for each in list_figures(refused)}


@pytest.mark.parametrize("error", [InputError("mute"), NotDeterminedError("no peak")])
def test_a_report_without_the_steps_of_the_paper_is_written(error, identified, tmp_path, monkeypatch):
    def broken(self):
        raise error

    monkeypatch.setattr(Identification, "paper_chain", property(broken))
    page = opid.write_report(identified.result, tmp_path).read_text(encoding="utf-8")
    names = set(re.findall(r'data-chart="(\w+)"', page))
    assert names == {
        "accelerations",
        "law_ladder",
        "force_sections",
        "force_departures",
        "law_curves",
        "equation_residual",
    }
    assert '<td class="left">heavy</td>' in page
    found = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["diagnostics"]
    assert (found["peak_pairs"], found["static_transmissibility_read_from_lines"]) == ([], None)
    assert [run["name"] for run in found["runs"]] == ["heavy", "light"]


def test_an_identification_alone_does_not_take_the_steps_of_the_paper():
    code = (
        "import sys, opid, numpy as np\n"
        "from opid.virtual.taxi_tests.airframe import LandingGear\n"
        "from opid.virtual.taxi_tests.taxiing import taxi_test\n"
        "from opid.suspensions.study import Run, study_of_gear\n"
        "test = taxi_test(LandingGear(), rng=np.random.default_rng(1), duration_s=12.0, fs=256.0)\n"
        "runs = [Run('heavy', test.heavy.recording), Run('light', test.light.recording, test.mass_change_kg)]\n"
        "study = study_of_gear('s', sprung='upper_z', unsprung='lower_z', runs=runs)\n"
        "print(opid.identify(study, law='arctan_velocity').law.name)\n"
        "rooms = ('opid.suspensions.paper', 'opid.report', 'opid.plots')\n"
        "print([name for name in sys.modules if name.startswith(rooms)])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["arctan_velocity", "[]"]


# ---- to do it again ------------------------------------------------------------------------------


def test_the_lines_name_what_was_given(identified, one_run, by_paper):
    result, source = identified.result, identified.result.study.source
    assert shlex.join(write_command(result)) == f"opid identify {source} --band 0.3 40"
    assert f'opid.read_study("{source}")' in write_python(result)
    named = replace(result, study=replace(result.study, source=Path("my study.toml")))
    assert shlex.join(write_command(named)) == "opid identify 'my study.toml' --band 0.3 40"
    options = replace(result.options, law="linear", ground=False, method_of_law="both")
    assert shlex.join(write_command(replace(named, options=options))).endswith(
        "--method-of-law both --law linear --no-ground"
    )
    assert 'method_of_law="both",\n    law="linear",\n    ground=False,' in write_python(
        replace(named, options=options)
    )
    # what was made in Python has no command
    assert write_command(one_run) is None
    assert "    study,\n" in write_python(one_run)
    assert shlex.join(write_command(by_paper)) == (
        f"opid identify {source} --method paper --band 0.5 12 --high-pass 0.3 --law arctan_velocity"
    )


def test_settings_of_a_result_are_in_its_lines(identified):
    result = replace(identified.result, settings=Settings(verdicts=Verdicts(refused=10.0)))
    assert write_command(result) is None
    assert "from opid.suspensions import Settings, Verdicts" in write_python(result)
    assert "    settings=Settings(verdicts=Verdicts(refused=10.0)),\n" in write_python(result)


def test_logs_are_called_as_they_were(field_test, tmp_path, identified):
    paths = [tmp_path / "a run.csv", tmp_path / "b.csv"]
    for path, name in zip(paths, ("heavy", "light"), strict=True):
        path.write_bytes((field_test / f"{name}.csv").read_bytes())
    study = study_from_logs(paths, sprung="upper_z", unsprung="lower_z", mass_changes_kg=[-220.5])
    result = replace(identified.result, study=study)
    assert shlex.join(write_command(result)) == (
        f"opid identify '{paths[0]}' {paths[1]} --sprung upper_z --unsprung lower_z --mass-change -220.5 --band 0.3 40"
    )
    lines = write_python(result)
    compile(lines, "lines", "exec")
    assert f'["{paths[0]}", "{paths[1]}"],' in lines
    assert "mass_changes_kg=[-220.5]," in lines
    gear = replace(study.interfaces[0], axis="down")
    said = replace(result, study=replace(study, interfaces=(gear,), repeatability=0.02))
    assert "--mass-change -220.5 --axis down --repeatability 0.02 --band" in shlex.join(write_command(said))
    assert '        axis="down",\n        repeatability=0.02,\n' in write_python(said)


# ---- whole or not at all -------------------------------------------------------------------------


class _FullDisk:
    """A file that takes no more."""

    def __init__(self, file):
        self.file = file

    def write(self, content):
        self.file.write(content[: len(content) // 2])
        raise OSError(28, "No space left on device")

    def __getattr__(self, name):
        return getattr(self.file, name)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.file.close()


@pytest.fixture
def full_at_the_third_file(monkeypatch):
    opened = []

    def opening(path, *args, **kwargs):
        file = open(path, *args, **kwargs)  # noqa: SIM115
        opened.append(file)
        return _FullDisk(file) if len(opened) == 3 else file

    monkeypatch.setattr(files, "open", opening, raising=False)


@pytest.mark.usefixtures("full_at_the_third_file")
def test_a_full_disk_leaves_nothing(tmp_path):
    with pytest.raises(InputError, match="No space left"):
        write_together(tmp_path / "new" / "report", dict.fromkeys("abcd", b"content"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("full_at_the_third_file")
def test_a_full_disk_leaves_an_older_report_as_it_was(tmp_path):
    for name in "abcd":
        (tmp_path / name).write_bytes(b"old")
    with pytest.raises(InputError, match="No space left"):
        write_together(tmp_path, dict.fromkeys("abcd", b"new"))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == dict.fromkeys("abcd", b"old")


def test_a_figure_that_fails_leaves_nothing(identified, tmp_path, monkeypatch):
    def broken():
        raise RuntimeError("no figure")

    first, second, *_ = list_figures(identified.result)
    monkeypatch.setattr(report_module, "list_figures", lambda result, truth: (first, replace(second, draw=broken)))
    with pytest.raises(RuntimeError, match="no figure"):
        opid.write_report(identified.result, tmp_path / "report")
    assert list(tmp_path.iterdir()) == []


def test_a_second_report_replaces_the_first_and_nothing_else(identified, tmp_path, monkeypatch):
    monkeypatch.setattr(report_module, "list_figures", one_picture("law_ladder"))
    (tmp_path / "mine.txt").write_text("mine")
    for title in ("first", "second"):
        opid.write_report(titled(identified.result, title), tmp_path)
    assert json.loads((tmp_path / "result.json").read_text())["title"] == "second"
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "mine.txt",
        "report.html",
        "result.json",
    ]


@pytest.mark.parametrize("inside", ["", "deeper/still"])
def test_a_file_in_the_way_is_named(tmp_path, inside):
    (tmp_path / "taken").write_text("")
    for make in (require_directory, make_directory):
        with pytest.raises(InputError, match="taken is no directory: choose another place"):
            make(tmp_path / "taken" / inside)


# ---- truth ---------------------------------------------------------------------------------------


def test_truth_has_the_names_of_the_result(field_test):
    truth = read_truth(field_test / "truth.json", GearTruth)
    assert json.loads((field_test / "truth.json").read_text(encoding="utf-8"))["schema"] == "opid.truth/1"
    assert asdict(truth.parameters) == {
        "sprung_mass_kg": 1850.0,
        "suspension_stiffness_n_per_m": 3.9e5,
        "suspension_damping_n_s_per_m": 6e3,
        "ground_stiffness_n_per_m": 0.0,
    }
    assert truth.law.name == "arctan_velocity"
    assert truth.mass_change_kg == -220.0


@pytest.mark.parametrize("record", [GearTruth, BodyTruth])
def test_a_truth_keeps_where_its_laws_rest(record, tmp_path):
    """Files of before have no such place: their laws rest at their origins."""
    cubic = default_law("cubic_stiffness").resting_at(-0.03)
    if record is GearTruth:
        truth = GearTruth(GearNumbers(1850.0, 3.9e5, 6e3, 0.0), cubic)
    else:
        truth = BodyTruth(BodyNumbers(5400.0, 1e4, 2e4, 0.5, 0.0), {"nose": SuspensionTruth(5.0, 0.0, 1e5, 3e3, cubic)})
    table = tabulate_truth(truth)
    (tmp_path / "truth.json").write_text(json.dumps(table))
    assert read_truth(tmp_path / "truth.json", record) == truth
    for each in (table, *table.get("interfaces", {}).values()):
        each.get("law", {}).pop("rest_m", None)
    (tmp_path / "truth.json").write_text(json.dumps(table))
    before = read_truth(tmp_path / "truth.json", record)
    law = before.law if record is GearTruth else before.interfaces["nose"].law
    assert law == cubic.resting_at(0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}", "it has no 'schema'"),
        ("[1]", "one of its values is not of the kind that such a file holds"),
        ("not JSON", r"is not the truth of a simulated field test, it is not JSON .line 1: .*give the truth.json that"),
        (
            '{"schema": "opid.identification/1"}',
            "has the schema 'opid.identification/1' where 'opid.truth/1' is needed",
        ),
        ('{"schema": "opid.truth/1", "parameters": {}}', "it has no 'sprung_mass_kg'"),
        (
            '{"schema": "opid.truth/1", "parameters": {"sprung_mass_kg": 1, "suspension_stiffness_n_per_m": 1, '
            '"suspension_damping_n_s_per_m": 1, "ground_stiffness_n_per_m": 0}, "law": {"name": "cubc_stiffness", '
            '"parameters": {}}}',
            "did you mean 'cubic_stiffness'",
        ),
    ],
)
def test_a_file_that_is_no_truth_is_refused(tmp_path, text, message):
    path = tmp_path / "truth.json"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_truth(path, GearTruth)
    with pytest.raises(InputError, match=r"cannot read the truth .*missing.json: .*beside the study, or leave it"):
        read_truth(tmp_path / "missing.json", GearTruth)


def test_a_constant_is_printed_as_one():
    """As the samples of a chain that lies at a bound of its prior: their scatter is rounding."""
    samples = np.full(7, 0.1) + np.array([0, 0, 0, 0, 0, 0, 1e-17])
    estimate = Estimate(float(samples.mean()), 1.4e-17, (0.1 - 2.8e-17, 0.1))
    assert build_estimate_row("fraction", "1", estimate)[1:5] == ("0.1000", "-", "-", "1")
    assert build_estimate_row("fraction", "1", estimate, 0.1)[1:4] == ("0.1000", "-", "-")
    assert build_estimate_row("fraction", "1", Estimate.normal(0.1, 1e-6))[1:3] == ("0.1000000", "0.0000010")


@pytest.mark.parametrize(
    "path",
    ["/home/a user/logs of tuesday/run 1.csv", "./the logs/heavy.csv", r"C:\\My Logs\\heavy run.tdms", "~/a b/c.h5"],
)
@pytest.mark.parametrize("before", range(20, 81, 6))
def test_no_path_is_cut_in_two(path, before):
    text = f"{'x' * (before - 1)} {path} line 7: the cell is empty, m/s of run 2: mend the line, or cut the log there"
    lines = wrap_text(text, "Warning: ")
    assert any(path in line for line in lines)
    assert " ".join(line.strip() for line in lines).replace("  ", " ") == f"Warning: {text}"


def test_the_page_begins_with_a_sketch_that_holds_the_numbers(identified, report, refused):
    html = (report / "report.html").read_text(encoding="utf-8")
    sketch = re.search(r'<div class="sketch" role="img" aria-label="(.*?)">(.*?)</div>', html, re.DOTALL)
    mass, parameters = identified.result.parameters.sprung_mass_kg, identified.result.parameters
    stiffness = parameters.suspension_stiffness_n_per_m
    for words in (
        f"M₂ = {with_std(mass.value, mass.std)} kg",
        f"K₂ = {with_std(stiffness.value, stiffness.std)} N/m",
        "law: arctan velocity",
    ):
        assert words in sketch[1]
        assert words in sketch[2]
    assert "K₃" not in sketch[2]  # no spring to the ground was found
    assert html.index('class="sketch"') < html.index("<table>")
    assert sketch_suspensions(refused) is None


def test_a_spring_to_the_ground_is_drawn_where_there_is_one_and_ratios_where_no_mass_is(identified, one_run):
    found = identified.result
    changed = replace(found.parameters, ground_stiffness_n_per_m=Estimate.normal(5e4, 500.0))
    assert "K₃ = 50000 ± 500 N/m" in sketch_suspensions(replace(found, parameters=changed)).alt
    assert sketch_suspensions(one_run).alt.startswith("M₂ is not determined; K₂/M₂ = ")
