"""`opid identify` as a user drives it: what it writes, what it says, and with which status it ends."""

import json
from pathlib import Path

import pytest
from cli_runs import CHANNELS, not_determined, opid, parsed, refused

from opid import cli


@pytest.fixture
def logs(field_test, tmp_path):
    """Copies of both logs that a test may spoil, as lists of lines, with a function that identifies them."""

    class Logs:
        heavy = (field_test / "heavy.csv").read_text().splitlines()
        light = (field_test / "light.csv").read_text().splitlines()

        def identify(self, *arguments):
            for name in ("heavy", "light"):
                (tmp_path / f"{name}.csv").write_text("\n".join(getattr(self, name)) + "\n")
            paths = (tmp_path / "heavy.csv", tmp_path / "light.csv")
            change = () if "--mass-change" in arguments else ("--mass-change", "-220")
            names = () if "--sprung" in arguments else CHANNELS
            done = opid("identify", *paths, *names, *change, "--out", tmp_path / "result", *arguments)
            if done.exit_code == 2:
                assert not (tmp_path / "result").exists()
            return done

    each = Logs()
    each.heavy, each.light = list(Logs.heavy), list(Logs.light)
    return each


@pytest.mark.usefixtures("few_figures")
def test_logs_without_a_study_give_the_same(field_test, identified, logs, tmp_path):
    done = logs.identify()
    assert done.exit_code == 0
    result = json.loads((tmp_path / "result" / "result.json").read_text(encoding="utf-8"))
    for name, estimate in identified.result.parameters.items():
        assert result["parameters"][name]["value"] == pytest.approx(estimate.value, rel=1e-9)


@pytest.mark.usefixtures("few_figures")
def test_what_is_known_of_the_gear_is_said_beside_logs(logs, tmp_path):
    told = ("--axis", "horizontal", "--repeatability", "0")
    done = logs.identify("--law", "arctan_velocity", *told)
    assert done.exit_code == 0
    assert "stated to be the same in all runs (`repeatability = 0`)" in " ".join(done.stdout.split())
    assert " ".join(told) in (tmp_path / "result" / "report.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("few_figures")
def test_settings_of_the_transmissibility_are_said_beside_logs(logs, tmp_path):
    told = ("--window", "flattop", "--overlap", "0.3", "--estimator", "H2", "--block", "4")
    done = logs.identify("--method", "classical", "--law", "arctan_velocity", *told)
    assert done.exit_code == 0
    (run, _) = json.loads((tmp_path / "result" / "result.json").read_text(encoding="utf-8"))["diagnostics"]["runs"]
    taken = run["transmissibility"]
    assert (taken["window"], round(taken["overlap"], 2), taken["estimator"]) == ("flattop", 0.3, "H2")
    html = (tmp_path / "result" / "report.html").read_text(encoding="utf-8")
    assert " ".join(told) in html
    assert "Transmissibilities (Table 2 of the paper)" in html


@pytest.mark.parametrize("written", ["sparse-regression", "sparse regression"])
def test_the_second_method_of_the_law_needs_no_quotes(written):
    assert (
        parsed(f"opid identify study.toml --method-of-law '{written}'").params["method_of_law"] == "sparse regression"
    )


@pytest.mark.usefixtures("few_figures")
def test_the_options_of_identify_reach_the_result(field_test, tmp_path):
    options = [
        "--method",
        "paper",
        "--law",
        "arctan_velocity",
        "--band",
        "1",
        "10",
        "--high-pass",
        "0.4",
        "--no-ground",
    ]
    done = opid("identify", field_test / "study.toml", *options, "--out", tmp_path)
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert done.exit_code == (1 if result["not_determined"] else 0)
    assert result["method"] == "paper"
    settings = result["diagnostics"]["settings"]
    assert settings.pop("estimator")["seen_above"] == 13.8
    assert settings == {
        "study": str(field_test / "study.toml"),
        "sprung": "upper_z",
        "unsprung": "lower_z",
        "band_hz": [1.0, 10.0],
        "high_pass_hz": 0.4,
        "law": "arctan_velocity",
        "ground": False,
    }
    assert all(estimate["std"] is None for estimate in result["parameters"].values())
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "--method paper --band 1 10 --high-pass 0.4 --law arctan_velocity --no-ground" in html


@pytest.mark.usefixtures("few_figures")
def test_the_result_is_called_after_the_study(field_test, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.output.result_name(Path("runs/study.toml")) == "runs"
    assert cli.output.result_name(Path("study.toml")) == tmp_path.name
    assert cli.output.result_name(Path("runs/autumn.toml")) == "autumn"
    opid("identify", field_test / "study.toml")
    assert [path.name for path in tmp_path.iterdir()] == [f"{field_test.name}_result"]


def test_a_directory_stands_for_the_study_in_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("runs").mkdir()
    Path("runs/study.toml").write_text('tittle = "x"\nruns = []\n')
    refused(opid("identify", "runs"), str(Path("runs/study.toml")), "did you mean 'title'")
    refused(
        opid("identify", "runs", *CHANNELS),
        f"{Path('runs/study.toml')} is a study, which states this itself: leave out --sprung and --unsprung",
    )


@pytest.mark.usefixtures("few_figures")
def test_equal_masses_that_cannot_be_end_with_status_1(logs, tmp_path):
    done = logs.identify("--mass-change", "0", "--law", "arctan_velocity")
    not_determined(done, "all runs", "same sprung mass")
    assert "K2/M2" in done.stdout
    result = json.loads((tmp_path / "result" / "result.json").read_text(encoding="utf-8"))
    assert result["parameters"]["sprung_mass_kg"]["value"] is None
    # the runs do not even behave alike
    assert "natural frequencies" in result["not_determined"]
    assert result["ratios"]["stiffness_per_mass"]["value"] is None


@pytest.mark.usefixtures("few_figures")
def test_a_mass_change_of_the_wrong_sign_is_not_determined(logs):
    not_determined(logs.identify("--mass-change", "220"), "sign of the mass change")


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("nothing.toml",), "there is no study file nothing.toml"),
        (("nothing.csv", *CHANNELS), "there is no file nothing.csv"),
        (("nothing",), "there is no file or directory nothing: check the name"),
        (("pathz/nothing.csv",), "there is no file or directory pathz/nothing.csv, nor a directory pathz"),
        (("a.toml", "b.csv"), "give one study file"),
        (("a.toml", *CHANNELS), "leave out --sprung"),
        (("a.toml", "--repeatability", 0), "leave out --repeatability"),
        (("a.csv", "--repeatability", "1%"), "'1%' is no number: give a fraction, 0.01 for 1 %"),
        (("a.csv", *CHANNELS, "--window", "flattopp"), "did you mean 'flattop'"),
        (("a.csv", *CHANNELS, "--block", "long"), "'long' is no number: give s"),
        (("a.toml", "--window", "hann"), "leave out --window"),
        (("a.csv", "b.csv", *CHANNELS), "one mass change for each log after it"),
        ((".",), ". is a directory without a study.toml: name a study file, or logs"),
        ((), "Missing argument"),
        (("a.toml", "--lwa", "linear"), "Did you mean"),
        (("a.csv", *CHANNELS, "--mass-change", "light"), "'light' is no number: give kg"),
        (("a.toml", "--truth", "none.json"), "cannot read the truth none.json"),
    ],
)
def test_usage_is_explained(arguments, word, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused(opid("identify", *arguments), word)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ("--method classic", "'classic' is not one of 'model', 'classical', 'paper'"),
        ("--law arctan_velocty", "did you mean 'arctan_velocity'?"),
        ("--law arctan", "'arctan_velocity'"),
        ("--law cubic", "did you mean 'cubic_"),
        ("--band 12 1", "band_hz"),
        ("--band 1 1.1", "lines"),
        ("--high-pass 0.01", "the model integrates nothing"),
        ("--method classical --high-pass 0.01", "high-pass"),
        ("--method-of-law guess", "'guess' is not one of 'pursuit', 'sparse-regression', 'both'"),
        ("--method paper --method-of-law both", "leave --method-of-law out"),
        ("--sprung upper --unsprung lower_z", "did you mean 'upper_z'"),
        ("--axis sideways", "'sideways' is not one of 'up', 'down', 'horizontal'"),
        ("--repeatability 2", "the repeatability is 2.0"),
    ],
)
def test_settings_that_cannot_be_are_refused(options, word, logs):
    refused(logs.identify(*options.split()), word)


def _replace(lines, number, text):
    lines[number - 1] = text


def _cell(lines, number, column, text):
    cells = lines[number - 1].split(",")
    cells[column] = text
    lines[number - 1] = ",".join(cells)


def _column(lines, column, text):
    for number in range(2, len(lines) + 1):
        _cell(lines, number, column, text)


# each fault of the list, made in the light log
FAULTS = {
    "an unknown unit": (lambda rows: _replace(rows, 1, "time [s],lower_z [furlong],upper_z [g]"), "furlong"),
    "no unit": (lambda rows: _replace(rows, 1, "time [s],lower_z,upper_z [g]"), "channel 'lower_z' states no unit"),
    "a missing column": (lambda rows: _replace(rows, 1, "time [s],lower_z [g],other [g]"), "'upper_z'"),
    "text in a number column": (lambda rows: _cell(rows, 30, 1, "spike"), "line 30, column 'lower_z'"),
    "one sample": (lambda rows: rows.__delitem__(slice(2, None)), "holds one sample"),
    "no samples": (lambda rows: rows.__delitem__(slice(1, None)), "no samples"),
    "too few samples": (lambda rows: rows.__delitem__(slice(100, None)), "99 samples"),
    "a mute channel": (lambda rows: _column(rows, 2, "0.5"), "'upper_z' is mute"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bad_log_gets_one_sentence(fault, logs):
    spoil, word = FAULTS[fault]
    spoil(logs.light)
    sentence = refused(logs.identify(), word)
    assert "light" in sentence


# what is wrong with a part of the light log is left out, and said
PARTLY = {
    "NaN": (lambda rows: _cell(rows, 40, 2, "nan"), "1 value(s) are missing", "at fault"),
    "an empty cell": (lambda rows: _cell(rows, 50, 2, ""), "1 value(s) are missing", "at fault"),
    "a repeated time stamp": (lambda rows: _cell(rows, 61, 0, rows[59].split(",")[0]), "stand twice", "at fault"),
    "a gap": (lambda rows: rows.__delitem__(slice(100, 140)), "40 sample(s) lost", "at fault"),
}


@pytest.mark.parametrize("fault", PARTLY)
def test_a_fault_in_a_part_of_a_log_is_left_out_and_said(fault, logs, tmp_path, request):
    if fault != "a gap":  # of one such study the whole report is drawn
        request.getfixturevalue("few_figures")
    spoil, *words = PARTLY[fault]
    spoil(logs.light)
    done = logs.identify("--law", "arctan_velocity")
    assert done.exit_code == 0, done.stderr
    text = " ".join(done.stdout.split())
    for word in words:
        assert word in text
    findings = json.loads((tmp_path / "result" / "result.json").read_text())["diagnostics"]["runs"][1]["findings"]
    assert any("at fault" in finding["message"] for finding in findings)


@pytest.mark.usefixtures("few_figures")
def test_runs_of_two_rates_are_put_at_the_lower_one(logs, tmp_path):
    del logs.light[1::2]
    done = logs.identify("--law", "arctan_velocity")
    assert done.exit_code == 0, done.stderr
    assert {
        run["fs"] for run in json.loads((tmp_path / "result" / "result.json").read_text())["diagnostics"]["runs"]
    } == {128.0}


def test_an_empty_file_is_named(field_test, tmp_path):
    (tmp_path / "light.csv").write_text("")
    done = opid("identify", field_test / "heavy.csv", tmp_path / "light.csv", *CHANNELS, "--mass-change", -220)
    refused(done, "light.csv is empty")


def test_swapped_sensors_are_said(logs):
    """The warning says it, and the data do: no model follows them."""
    done = logs.identify("--sprung", "lower_z", "--unsprung", "upper_z", "--law", "linear")
    not_determined(done, "check the channels (swapped", "exchange sprung and unsprung, sprung = 'upper_z' and")


def test_an_unknown_key_of_a_study_names_the_nearest(field_test, tmp_path):
    text = (field_test / "study.toml").read_text().replace("title", "tittle")
    (tmp_path / "study.toml").write_text(text)
    refused(opid("identify", tmp_path / "study.toml"), "'tittle'", "did you mean 'title'")
