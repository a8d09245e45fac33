"""`opid simulate resonance` and `opid resonance`: from the command line to the page."""

import json

import pytest
from cli_runs import opid, refused


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("resonance") / "bracket"
    done = opid("simulate", "resonance", folder, "--levels", 10)
    assert done.exit_code == 0, done.output
    assert "opid resonance" in done.stdout
    return folder


def test_the_command_reads_what_the_simulation_writes(simulated, tmp_path):
    out = tmp_path / "out"
    done = opid(
        "resonance", simulated / "study.toml", "--truth", simulated / "truth.json", "--out", out, "--no-figures"
    )
    assert done.exit_code == 0, done.output
    for words in ("Backbone", "Law", "No interaction is seen", "misfit"):
        assert words in done.stdout
    assert " ".join(done.stdout.split()).count("mode 3 at phase resonance") == 1
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert result["schema"] == "opid.resonance/1"
    low, high = result["records_law"]["k"]["3"]["interval95"]
    assert low <= -1.8e11 <= high
    assert all(level["voltage_v"] > 0.0 for level in result["levels"])
    assert len(result["levels"][0]["sensors"][0]) == 5


def test_a_mode_that_no_test_holds_is_refused(simulated, tmp_path):
    done = opid("resonance", simulated / "study.toml", "--mode", 2, "--out", tmp_path / "out")
    refused(done, "no test holds mode 2: they hold 3")


def test_one_command_predicts_the_highest_curve(tmp_path):
    folder, out = tmp_path / "bracket", tmp_path / "out"
    assert opid("simulate", "resonance", folder, "--levels", 8, "--curves", 5).exit_code == 0
    done = opid("resonance", folder / "study.toml", "--hold-out", "highest", "--out", out, "--png")
    assert done.exit_code == 0, done.output
    assert "Prediction of curve_5" in done.stdout
    assert "The prediction is off by" in " ".join(done.stdout.split())
    found = json.loads((out / "result.json").read_text(encoding="utf-8"))["held_out"]
    low, high = found["resonance_hz"]["interval95"]
    assert low < found["measured_hz"]["value"] < high
    assert abs(found["error_fraction"]) < 0.05
    assert (out / "held_out_curve.png").is_file()
    refused(
        opid("resonance", folder / "study.toml", "--hold-out", "curve_9", "--out", tmp_path / "no"), "there is no curve"
    )
