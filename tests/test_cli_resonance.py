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
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert result["schema"] == "opid.resonance/1"
    low, high = result["records_law"]["k"]["3"]["interval95"]
    assert low <= -1.8e11 <= high
    assert all(level["voltage_v"] > 0.0 for level in result["levels"])
    assert len(result["levels"][0]["sensors"][0]) == 5


def test_a_mode_that_no_test_holds_is_refused(simulated, tmp_path):
    done = opid("resonance", simulated / "study.toml", "--mode", 2, "--out", tmp_path / "out")
    refused(done, "no test holds mode 2: they hold 3")
