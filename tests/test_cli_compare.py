"""`opid compare` as a user drives it: what it writes, what it says, and with which status it ends."""

import json
import re
from dataclasses import asdict

import numpy as np
import pytest
from cli_runs import opid, refused
from made_flights import body_result, day, gear_result, write_result

from opid.suspensions.flights.departures import FlightSettings


@pytest.fixture
def flights(tmp_path):
    """Eight flights; the left strut has lost 5 % in the last two."""
    rng = np.random.default_rng(4)
    for i in range(8):
        loss = {("left", "stiffness"): 0.05} if i >= 6 else None
        write_result(tmp_path / "flights" / f"flight{i}" / "out", body_result(rng, std=0.004, day=day(i), loss=loss))
    return tmp_path / "flights"


def test_a_loss_ends_with_status_3_and_a_report(flights, tmp_path):
    done = opid("compare", flights, "--out", tmp_path / "health")
    assert (done.exit_code, done.stderr) == (3, "")
    flat = " ".join(done.stdout.split())
    assert "8 flights, 2026-01-05 to 2026-02-23" in flat
    assert "Change: Stiffness of 'left': -4.9 % (-5.5 to -4.2 %)" in flat
    assert "flagged, confirmed by the next flight" in flat
    assert done.stdout.count("Change: ") == 1
    assert max(len(line) for line in done.stdout.splitlines() if "Report" not in line) <= 80
    names = sorted(path.name for path in (tmp_path / "health").iterdir())
    assert names == [
        "comparison.json",
        "report.html",
    ]
    document = json.loads((tmp_path / "health" / "comparison.json").read_text(encoding="utf-8"))
    assert document["schema"] == "opid.comparison/1"
    assert document["flagged"] is True
    assert document["settings"] == asdict(FlightSettings())
    assert [flight["date"] for flight in document["flights"]] == [day(i) for i in range(8)]
    (change,) = document["changes"]
    assert (change["gear"], change["quantity"], change["first"], change["last"]) == ("left", "stiffness", 6, 7)
    assert change["share"]["interval95"][0] < -0.05 < change["share"]["interval95"][1]
    points = next(s for s in document["series"] if (s["gear"], s["quantity"]) == ("left", "stiffness"))["points"]
    assert [point["status"] for point in points] == ["first"] + 5 * ["as expected"] + 2 * ["flagged"]
    assert {"flight", "value", "std", "interval95", "expected", "expected_std", "limits"} < set(points[1])
    page = (tmp_path / "health" / "report.html").read_text(encoding="utf-8")
    names = ["compared_1_stiffness", "compared_2_damping", "compared_3_friction_force", "compared_4_total_mass"]
    assert re.findall(r'data-chart="(\w+)"', page) == names
    assert f"opid compare {flights}" in page


def test_without_a_change_it_ends_with_status_0_and_writes_nothing(flights, tmp_path):
    before = sorted(flights.iterdir())[:6]
    done = opid("compare", *before)
    assert (done.exit_code, done.stderr) == (0, "")
    assert "No change exceeds its uncertainty." in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["flights"]


def test_json_is_printed_alone(flights):
    done = opid("compare", flights, "--json")
    assert done.exit_code == 3
    assert json.loads(done.stdout)["schema"] == "opid.comparison/1"


def test_nothing_to_judge_ends_with_status_1(tmp_path):
    rng = np.random.default_rng(0)
    for i in range(2):
        document = gear_result(rng, day=day(i), kind=None)
        for table in document["parameters"].values():
            table["std"] = table["interval95"] = None
        write_result(tmp_path / f"f{i}", document)
    refused(opid("compare", tmp_path), "no quantity has a value with an interval", status=1)


def test_a_flight_without_an_answer_is_named_and_the_rest_compared(flights, tmp_path):
    document = body_result(np.random.default_rng(1), day=day(9))
    document["structure"] |= {"recommended": None, "residual_over_noise": 7.7}
    odd = write_result(flights / "odd", document)
    (flights / "unfinished").mkdir()
    (flights / "unfinished" / "study.toml").touch()
    done = opid("compare", flights)
    assert (done.exit_code, done.stderr) == (3, "")
    flat = " ".join(done.stdout.split())
    assert "8 flights, 2026-01-05 to 2026-02-23" in flat
    assert "Warning: 'odd' is left out: no structure was recommended for it (7.7 times the noise)." in flat
    assert "unfinished' holds no result.json and is left out: run `opid identify` there." in flat
    done = opid("compare", flights / "flight0", odd)
    refused(done, "of 2 flights 'flight0' alone can be compared", "'odd' is left out: no structure", status=1)


def test_bad_input_ends_with_status_2(flights, tmp_path):
    one = flights / "flight0"
    refused(opid("compare", one), "1 result is given", "give two or more")
    refused(opid("compare", tmp_path / "none", one), "there is no file or folder")
    refused(opid("compare", flights, "--false-alarm", 0), "chance of a false alarm is 0")
    refused(opid("compare", flights, "--out", one / "out" / "result.json"), "is no directory")
    assert opid("compare").exit_code == 2
