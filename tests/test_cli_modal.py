"""`opid simulate sine-beats` and `opid modal` as a user drives them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from cli_runs import not_determined, opid, refused
from made_modal import SOFT, small_result, small_study

from opid.modal import identification
from opid.signals.units import STANDARD_GRAVITY
from opid.studies.study_file import read_study, write_study

PAGE = Path(__file__).parents[1] / "docs" / "nonlinear_modal_models.md"
LBF = 4.4482216152605


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """A directory that `opid simulate sine-beats` wrote; not to be changed."""
    place = tmp_path_factory.mktemp("beats") / "cubic"
    done = opid("simulate", "sine-beats", place, "--seed", 3)
    assert (done.exit_code, done.stderr) == (0, "")
    assert f"Next: opid modal {place / 'study.toml'} --truth {place / 'truth.json'}" in done.stdout
    return place


def test_a_simulation_writes_a_study_and_its_truth(simulated):
    study = read_study(simulated / "study.toml")
    assert [each.use for each in study.tests] == ["level"] * 3 + ["fit"] * 4 + ["truth"]
    assert study.nonlinear == (3,)
    levels = [np.abs(each.test.force).max() for each in study.of_use("fit")]
    np.testing.assert_allclose(np.array(levels) / levels[-1], [0.1, 0.3, 0.6, 1.0], rtol=0.05)
    truth = json.loads((simulated / "truth.json").read_text(encoding="utf-8"))
    assert truth["schema"] == "opid.modal-truth/1"
    mode = truth["nonlinear"]["3"]
    assert (mode["k"], mode["c"]) == ({"3": -1.8e11}, {"2": 20.0})
    # harmonic linearisation in closed form
    amplitude, omega = np.array(mode["amplitude"]), 2 * np.pi * 120.0
    expected = np.sqrt(omega**2 + 0.75 * -1.8e11 * amplitude**2) / (2 * np.pi)
    np.testing.assert_allclose(mode["frequency_hz"], expected, rtol=1e-6)
    assert truth["settings"]["seed"] == 3


def test_the_study_of_a_simulation_is_identified(simulated, tmp_path, monkeypatch):
    out = tmp_path / "out"
    done = opid("modal", simulated / "study.toml", "--truth", simulated / "truth.json", "--out", out,
                "--stiffness-order", 3, "--damping-order", 2, "--fixed-linear")  # fmt: skip
    assert (done.exit_code, done.stderr) == (0, "")
    assert "k3" in done.stdout
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    mode = result["modes"][0]
    assert (mode["stiffness_order"], mode["damping_order"], mode["free_linear"]) == (3, 2, False)
    assert mode["k"]["3"]["value"] == pytest.approx(-1.8e11, rel=0.02)
    assert mode["c"]["2"]["value"] == pytest.approx(20.0, rel=0.05)
    sensors = result["truth_tests"][0]["sensors"].values()
    assert max(abs(each["peak_ratio_nonlinear"] - 1) for each in sensors) < 0.03
    assert max(each["peak_ratio_linear"] for each in sensors) > 1.3
    assert (out / "report.html").is_file()
    assert {"frequency_threshold": 0.002, "damping_threshold": 0.15}.items() <= result["settings"].items()
    assert "frequency shifts by more than 0.2 %" in done.stdout.replace("\n", " ")


def test_the_same_seed_gives_the_same_files(simulated, tmp_path):
    opid("simulate", "sine-beats", tmp_path, "--seed", 3)
    for name in ("study.toml", "sweep.csv", "truth.json"):
        assert (tmp_path / name).read_bytes() == (simulated / name).read_bytes()


def test_stated_modes_may_be_wrong_by_a_fraction(tmp_path, monkeypatch):
    seen = {}
    monkeypatch.setattr(
        "opid.virtual.modal_tests.series.virtual_study", lambda series, **given: seen.update(given) or 1 / 0
    )
    done = opid("simulate", "sine-beats", tmp_path, "--frequency-error", 0.1, "--damping-error", 5)
    assert done.exit_code == 70
    assert seen["given"].frequency_hz[2] == pytest.approx(120.0 * 1.001)
    assert seen["given"].damping_ratio[2] == pytest.approx(0.004 * 1.05)


@pytest.fixture
def quick(monkeypatch):
    """Nothing is identified: what the command makes of study and result is tested. Returns the studies it was given."""
    given = []

    def identify_modes(study, *, progress=None):
        given.append(study)
        return small_result(study)

    monkeypatch.setattr(identification, "identify_modes", identify_modes)
    return given


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    path = tmp_path_factory.mktemp("small") / "study.toml"
    write_study(small_study(), path)
    return path


def test_options_go_before_the_study_and_the_report_is_named_after_it(study, quick, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("opid.report.write_report", lambda result, target, *_, **__: target / "report.html")
    done = opid("modal", study, "--damping-order", 2, "--free-linear", "--frequency-threshold", 0.01)
    assert done.exit_code == 0
    assert (quick[0].frequency_threshold, quick[0].damping_threshold) == (0.01, 0.15)
    assert (quick[0].stiffness_order, quick[0].damping_order, quick[0].free_linear) == (3, 2, True)
    assert quick[0].nonlinear == (SOFT,)
    assert f"Report: {study.parent.name}_result" in done.stdout.replace("\n", "")


def blocks(language):
    """The blocks of the first section of the page."""
    section = PAGE.read_text(encoding="utf-8").split("## Your first study")[1].split("\n## ")[0]
    return re.findall(f"```{language}\n(.*?)```", section, re.DOTALL)


def test_the_first_study_of_the_page_runs_from_python_and_from_files(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    space = {}
    exec(compile(blocks("python")[0], PAGE.name, "exec"), space)
    in_memory = space["result"].fits[0].stiffness[3]
    assert in_memory.value == pytest.approx(-4e8, rel=0.01)
    assert repr(in_memory) in capsys.readouterr().out
    assert (tmp_path / "beam_result" / "report.html").is_file()
    header, modes = blocks("text")
    Path("modes.csv").write_text(modes, encoding="utf-8")
    Path("study.toml").write_text(blocks("toml")[0], encoding="utf-8")
    for each in space["study"].tests:
        recording = each.test.recording
        table = recording.samples / [*[STANDARD_GRAVITY] * 3, LBF]
        written = np.column_stack([recording.time_s, table])
        np.savetxt(f"{each.test.name}.csv", written, "%.9g", ",", header=header.strip(), comments="")
    done = opid("modal", "study.toml", "--out", "out", "--json")
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.stdout == Path("out", "result.json").read_text(encoding="utf-8")
    result = json.loads(done.stdout)
    assert result["modes"][0]["k"]["3"]["value"] == pytest.approx(in_memory.value, rel=1e-4)
    assert result["warnings"] == []
    assert max(each["nrmse_nonlinear"] for each in result["truth_tests"][0]["sensors"].values()) < 0.01
    assert '<pre tabindex="0">opid modal study.toml</pre>' in Path("out", "report.html").read_text(encoding="utf-8")


def test_help_says_where_to_begin():
    told = " ".join(opid("modal", "--help").output.split())
    for words in ("docs/nonlinear_modal_models.md", "opid simulate sine-beats", "STUDY_result"):
        assert words in told
    assert "modal     modes whose stiffness" in opid("--help").output


def test_what_is_not_determined_ends_with_status_1(study, monkeypatch, tmp_path):
    from dataclasses import replace

    found = replace(small_result(), not_determined="the tests say nothing of mode 3", truth_tests=())
    monkeypatch.setattr(identification, "identify_modes", lambda study, *, progress=None: found)
    monkeypatch.setattr("opid.report.write_report", lambda result, target, *_, **__: target / "report.html")
    done = opid("modal", study, "--out", tmp_path / "out")
    not_determined(done, "the tests say nothing of mode 3")


def test_bad_usage_ends_with_status_2_before_the_work(study, quick, tmp_path):
    refused(opid("modal", tmp_path / "none.toml", "--out", tmp_path / "out"), "there is no study file")
    refused(opid("modal", study, "--out", study), "is no directory")
    refused(opid("modal", study, "--stiffness-order", 9, "--out", tmp_path / "out"), "--stiffness-order")
    refused(opid("modal", study, "--damping-threshold", 0, "--out", tmp_path / "out"), "--damping-threshold")
    refused(opid("modal", study, "--frequency-threshold", 5, "--out", tmp_path / "out"), "--frequency-threshold", "<=1")
    refused(
        opid("modal", study, "--truth", study, "--out", tmp_path / "out"), "not the truth of a simulated modal test"
    )
    refused(opid("simulate", "sine-beats", tmp_path, "--case", "9"), "--case")
    refused(opid("simulate", "sine-beats", study), "is no directory")
    assert quick == []
    assert list(tmp_path.iterdir()) == []
