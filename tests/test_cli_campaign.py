"""`opid campaign`, and `opid compare` of what it leaves, as a user drives them."""

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from cli_runs import lines_drawn, opid, refused, run_on_terminal
from made_fleet import write_fleet
from made_flights import body_result, day, write_result

from opid.studies.study_file import write_study
from opid.suspensions.flights.fleet_model import FleetSettings
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_study, taxi_test

pytest.importorskip("distributed")
pytest.importorskip("pyarrow")

CAMPAIGN = 'flights = "flights.csv"\n[identify]\nlaw = "arctan_velocity"\n'
TABLE = "tail,flight,date,study,temperature_c\nA,f1,2026-01-12,f1/study.toml,-3\nA,f2,2026-02-09,f2/study.toml,2\n"


# ---- opid campaign -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A folder with two short flights, each with its study, and the campaign file."""
    folder = tmp_path_factory.mktemp("fleet")
    for number in (1, 2):
        test = taxi_test(LandingGear(), rng=np.random.default_rng(number), duration_s=15.0, fs=256.0)
        (folder / f"f{number}").mkdir()
        write_study(taxi_study(test, title=f"f{number}"), folder / f"f{number}" / "study.toml")
    (folder / "fleet.toml").write_text(CAMPAIGN)
    (folder / "flights.csv").write_text(TABLE)
    return folder


@pytest.fixture(scope="module")
def ran(logs, tmp_path_factory):
    """The first run of a campaign with pages, and its folder."""
    out = tmp_path_factory.mktemp("out")
    return opid("campaign", logs / "fleet.toml", "--out", out, "--workers", 1, "--pages"), out


def test_the_help_ends_with_an_example():
    said = opid("campaign", "--help").stdout
    assert said.rstrip().endswith("opid campaign fleet.toml --out fleet_2026 --workers 8")


def test_a_campaign_writes_an_index_a_dataset_and_a_folder_for_each_flight(ran):
    done, out = ran
    assert done.exit_code == 0
    assert re.fullmatch(r"Dashboard: http\S+\n", done.stderr)
    assert "2 identified." in done.stdout
    assert max(len(line) for line in done.stdout.splitlines() if "Report" not in line) <= 80
    assert f"Report: {out / 'index.html'}" in done.stdout
    assert sorted(path.name for path in out.iterdir()) == ["campaign.json", "dataset", "flights", "index.html"]
    for name in ("f1", "f2"):
        files = {path.name for path in (out / "flights" / "A" / name).iterdir()}
        assert files == {"outcome.json", "report.html", "result.json"}
    document = json.loads((out / "campaign.json").read_text(encoding="utf-8"))
    assert document["counts"] == {"identified": 2, "not determined": 0, "failed": 0}


def test_the_index_leads_to_the_page_of_each_flight(ran):
    _, out = ran
    page = (out / "index.html").read_text(encoding="utf-8")
    assert re.findall(r'href="(flights[^"]+)"', page) == [f"flights/A/f{k}/report.html" for k in (1, 2)]


def test_a_second_run_says_how_many_were_done_before(ran, logs):
    done, out = ran
    again = opid("campaign", logs / "fleet.toml", "--out", out, "--workers", 1, "--pages")
    assert again.exit_code == 0
    assert "by an earlier run" not in done.stdout
    assert "2 of 2 flights were done by an earlier run." in again.stdout


def test_a_campaign_is_shown_as_asked(ran, logs):
    _, out = ran
    command = ("campaign", logs / "fleet.toml", "--out", out, "--workers", 1)
    as_json = opid(*command, "--json", "--quiet", "--no-figures")
    assert (as_json.exit_code, as_json.stderr) == (0, "")
    assert as_json.stdout == (out / "campaign.json").read_text(encoding="utf-8")
    page = (out / "index.html").read_text(encoding="utf-8")
    assert "data-chart" not in page
    assert "checkbox" not in page
    told = opid(*command, "--verbose")
    assert told.exit_code == 0
    assert re.search(r"(?m)^ *\d+\.\d s  2 of 2 flights, 2 by an earlier run", told.stderr)
    assert "2 identified." in told.stdout
    assert "data-chart" in (out / "index.html").read_text(encoding="utf-8")


def test_the_pages_of_flights_have_no_figures_where_none_are_wanted(logs, tmp_path):
    done = opid("campaign", logs / "fleet.toml", "--out", tmp_path, "--workers", 1, "--pages", "--no-figures")
    assert done.exit_code == 0
    page = (tmp_path / "flights" / "A" / "f1" / "report.html").read_text(encoding="utf-8")
    assert "sprung mass" in page
    assert "data-chart" not in page


def test_on_a_terminal_the_flights_are_counted_below_the_address_of_the_dashboard(ran, logs):
    _, out = ran
    command = ("-m", "opid", "campaign", logs / "fleet.toml", "--out", out, "--workers", 1, "--pages")
    shown, told = run_on_terminal(*command)
    lines = lines_drawn(shown)
    assert sum(bool(re.fullmatch(r"Dashboard: http\S+", line)) for line in lines) == 1
    assert any(line.endswith("| ? left: 2 of 2 flights, 2 by an earlier run") for line in lines)
    assert shown.count("\n") == 1
    assert "2 identified." in told


def test_a_flight_that_fails_is_a_row_with_its_reason(ran, logs, tmp_path):
    _, before = ran
    shutil.copytree(logs, tmp_path / "fleet")
    shutil.copytree(before, tmp_path / "out")
    table = tmp_path / "fleet" / "flights.csv"
    table.write_text(TABLE + "B,f3,2026-02-10,f3/study.toml,4\n")
    # a study that is not there is a fault of the table, before any work
    refused(opid("campaign", tmp_path / "fleet" / "fleet.toml", "--workers", 1), "f3")
    shutil.copytree(tmp_path / "fleet" / "f1", tmp_path / "fleet" / "f3")
    (tmp_path / "fleet" / "f3" / "light.csv").unlink()
    done = opid("campaign", tmp_path / "fleet" / "fleet.toml", "--out", tmp_path / "out", "--workers", 1)
    assert done.exit_code == 0
    flat = " ".join(done.stdout.split())
    assert "2 identified, 1 failed." in flat
    assert "Reason: 1 flight: " in flat
    assert "light.csv" in flat


def test_a_campaign_without_any_answer_ends_with_status_1(logs, tmp_path):
    shutil.copytree(logs, tmp_path / "fleet")
    for log in (tmp_path / "fleet").glob("*/*.csv"):
        log.unlink()
    done = opid("campaign", tmp_path / "fleet" / "fleet.toml", "--out", tmp_path / "out", "--workers", 1)
    refused(done, "no flight has an answer", status=1)
    assert "2 failed." in done.stdout
    done = opid("campaign", tmp_path / "fleet" / "fleet.toml", "--out", tmp_path / "out", "--workers", 1, "--json")
    refused(done, f"the reasons stand in {tmp_path / 'out' / 'campaign.json'}", status=1)
    assert json.loads(done.stdout)["counts"]["failed"] == 2


def test_quiet_prints_nothing(ran, logs):
    _, out = ran
    done = opid("campaign", logs / "fleet.toml", "--out", out, "--workers", 1, "--pages", "--quiet")
    assert (done.exit_code, done.output) == (0, "")


def test_bad_calls_end_with_status_2_before_any_work(logs, tmp_path):
    file = logs / "fleet.toml"
    done = opid("campaign", file, "--workers", 2, "--scheduler", "tcp://127.0.0.1:1", "--out", tmp_path / "out")
    refused(done, "--workers and --scheduler are both given: give one of them")
    refused(opid("campaign", file, "--time-limit", 0, "--out", tmp_path / "out"), "--time-limit is 0")
    refused(opid("campaign", file, "--workers", 0, "--out", tmp_path / "out"), "--workers")
    (tmp_path / "empty").mkdir()
    done = opid("campaign", tmp_path / "empty", "--out", tmp_path / "out")
    refused(done, "there is no study of suspensions in the folder", "give a folder with a study.toml for each flight")
    refused(
        opid("campaign", logs / "fleat.toml", "--out", tmp_path / "out"),
        "there is no campaign file or folder",
        "did you mean 'fleet.toml'?",
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(os.name == "nt", reason="the blocks are for a shell")
def test_the_page_on_fleets_runs_as_written(tmp_path):
    page = (Path(__file__).parent.parent / "docs" / "fleets.md").read_text(encoding="utf-8")
    shown = re.findall(r"```(\w+)\n(.*?)```", page, re.DOTALL)
    names = re.findall(r"`([\w.]+\.(?:toml|csv))`[^`]*```(?:toml|csv)\n", re.sub(r"`\{\w+\}`", "", page))
    assert names == ["gear.toml", "flights.csv", "fleet.toml"]
    files = [text for language, text in shown if language in ("toml", "csv")]
    for name, text in zip(names, files, strict=True):
        (tmp_path / name).write_text(text)
    shim = f'opid() {{ "{sys.executable}" -m opid "$@"; }}\n'
    run = {"sh": "{}", "python": f"\"{sys.executable}\" - <<'END'\n{{}}END\n"}
    script = "set -eu\n" + shim + "".join(run[language].format(text) for language, text in shown if language in run)
    done = subprocess.run(["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"Dashboard: http\S+\n", done.stderr)
    assert "6 identified, 1 failed." in done.stdout
    assert done.stdout.count("No change exceeds its uncertainty.") == 2
    assert (tmp_path / "health" / "fleet.json").is_file()
    written = {line.split()[1] for line in re.findall(r"├── \S+|└── \S+", page)}
    assert {each.rstrip("/") for each in written} == {path.name for path in (tmp_path / "fleet_2026").iterdir()}
    rows = pytest.importorskip("pandas").read_parquet(tmp_path / "fleet_2026" / "dataset")
    told = set(re.findall(r"`(\w+)`", "".join(re.findall(r"(?m)^(\| `tail`.*(?:\n\|.*)+)", page))))
    assert set(rows.columns) == told | {"change_kg", "temperature_c"}


# ---- opid compare CAMPAIGN ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def harmed(tmp_path_factory):
    """The folder of a campaign, in which one strut loses 6 % of its stiffness, and what is known of it."""
    folder = tmp_path_factory.mktemp("campaign")
    return folder, write_fleet(folder, harm=-0.06)


def test_a_change_of_a_strut_ends_with_status_3_and_a_report(harmed, tmp_path):
    folder, (tail, _) = harmed
    done = opid("compare", folder, "--out", tmp_path / "health")
    assert (done.exit_code, done.stderr) == (3, "")
    flat = " ".join(done.stdout.split())
    assert "72 flights of 6 aircraft" in flat
    assert f"Change: Stiffness of 'gear' of {tail}: -" in flat
    assert flat.count("Change: ") == 1
    assert max(len(line) for line in done.stdout.splitlines() if "Report" not in line) <= 80
    assert sorted(path.name for path in (tmp_path / "health").iterdir()) == ["fleet.json", "report.html"]
    document = json.loads((tmp_path / "health" / "fleet.json").read_text(encoding="utf-8"))
    assert (document["schema"], document["flagged"], document["alarms_per_year"]) == ("opid.fleet/1", True, 0.1)
    assert document["settings"] == json.loads(json.dumps(asdict(FleetSettings())))
    (change,) = document["changes"]
    assert change["fraction"]["interval95"][0] < -0.06 < change["fraction"]["interval95"][1]
    assert len(document["provenance"]["files"]) == 6
    assert f"opid compare {folder}" in (tmp_path / "health" / "report.html").read_text(encoding="utf-8")


def test_the_dataset_itself_can_be_given(harmed):
    folder, _ = harmed
    one, other = (json.loads(opid("compare", path, "--json").stdout) for path in (folder, folder / "dataset"))
    assert one["series"] == other["series"]


def test_fewer_false_alarms_need_a_larger_departure(harmed):
    folder, _ = harmed
    limits = [
        json.loads(opid("compare", folder, "--json", "--alarms-per-year", n).stdout)["series"][0]["threshold"]
        for n in (0.001, 1)
    ]
    assert limits[0] > limits[1] + 1


def test_an_unharmed_fleet_ends_with_status_0(tmp_path):
    write_fleet(tmp_path / "campaign", seed=3, n_pages=0)
    done = opid("compare", tmp_path / "campaign")
    assert (done.exit_code, done.stderr) == (0, "")
    assert "No change exceeds its uncertainty." in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["campaign"]


def test_options_of_the_other_kind_are_refused(harmed, tmp_path):
    folder, _ = harmed
    flights = [write_result(tmp_path / f"f{k}", body_result(np.random.default_rng(k), day=day(k))) for k in range(2)]
    refused(opid("compare", folder, "--false-alarm", 0.01), "give --alarms-per-year in the place of --false-alarm")
    refused(opid("compare", *flights, "--alarms-per-year", 1), "give --false-alarm for results")
    refused(opid("compare", folder, flights[0]), "is a campaign: give it alone, or results only")
    refused(opid("compare", folder, "--alarms-per-year", 0), "alarms per year are 0")


def test_too_few_flights_end_with_status_1(tmp_path):
    write_fleet(tmp_path / "campaign", n_struts=1, n_flights=2, n_pages=0)
    refused(opid("compare", tmp_path / "campaign"), "enough flights to be compared with its own past", status=1)
    write_fleet(tmp_path / "single", n_flights=1, n_pages=0)
    refused(opid("compare", tmp_path / "single"), "at two dated flights: give flights dates", status=1)


def test_a_report_is_not_overwritten_without_force(harmed, tmp_path):
    folder, _ = harmed
    opid("compare", folder, "--out", tmp_path / "health", "--quiet")
    refused(opid("compare", folder, "--out", tmp_path / "health"), "fleet.json, report.html already")
    assert opid("compare", folder, "--out", tmp_path / "health", "--force").exit_code == 3
