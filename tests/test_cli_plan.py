"""`opid plan` as a user drives it: what it writes, what it says, and with which status it ends."""

import json
from itertools import pairwise

import pytest
from cli_runs import not_determined, opid, refused
from test_planning import FILE


@pytest.fixture
def guess(tmp_path):
    path = tmp_path / "guess.toml"
    path.write_text(FILE + "[sensors]\nfs_hz = 256.0\n", encoding="utf-8")
    return path


def test_a_plan_is_made_and_reported(guess, tmp_path):
    done = opid(
        "plan", guess, "--target", "sprung_mass=0.1%", "--target", "damping_ratio=1%", "--out", tmp_path / "out"
    )
    assert (done.exit_code, done.stderr) == (0, "")
    said = " ".join(done.stdout.split())
    assert "The cheapest plan that gives sprung_mass_kg to" in said
    assert "smallest sum of the costs" in said
    assert max(len(line) for line in done.stdout.splitlines() if "Report" not in line) <= 80
    result = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    assert result["schema"] == "opid.plan/1"
    assert [each["name"] for each in result["targets"]] == ["sprung_mass_kg", "damping_ratio"]
    assert result["provenance"]["files"][0]["name"] == str(guess)
    table = result["grid"]["std"][0]
    assert all(before > after for before, after in pairwise([row[0] for row in table]))
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count('data-chart="') == 1
    assert "--target sprung_mass=0.1%" in page


def test_a_target_out_of_reach_ends_with_status_1(guess, tmp_path):
    line = ("plan", guess, "--target", "sprung_mass=0.001%", "--duration", "40", "--mass-change", "-220")
    done = opid(*line, "--no-figures", "--out", tmp_path / "out")
    not_determined(done, "reaches sprung_mass=0.001%", "longer runs")
    assert json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))["cheapest"] is None


def test_what_cannot_be_planned_is_refused(guess, tmp_path):
    refused(opid("plan", guess, "--target", "sprung_mas=1%", "--out", tmp_path / "a"), "did you mean")
    refused(opid("plan", tmp_path / "no.toml", "--target", "sprung_mass=1%", "--out", tmp_path / "b"), "no study file")
    refused(opid("plan", guess, "--out", tmp_path / "c"), "--target")
