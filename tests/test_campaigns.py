"""Campaigns: the flights of a table, one flight as a task, a whole campaign on Dask, and its dataset."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from small_logs import ended_after

from opid.campaigns import flight_task
from opid.campaigns.campaign_file import IdentifyOptions, PlannedFlight, read_campaign, read_rows
from opid.campaigns.flight_task import FlightTask, TaskSettings, run_task
from opid.errors import InputError
from opid.studies.study_file import write_study
from opid.suspensions.flights.campaign import Verdict
from opid.suspensions.flights.dataset import read_dataset
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_study, taxi_test

TEMPLATE = """
[channels]
unsprung = "lower_z"
sprung = "upper_z"

[[runs]]
name = "heavy"
log = "{flight}/heavy.csv"
mass_change_kg = 0

[[runs]]
name = "light"
log = "{flight}/light.csv"
mass_change_kg = "{change_kg}"
"""

TABLE = """flight,tail,date,change_kg,temperature_c
f1,D-1,2026-01-01,-220,12.5
f2,D-1,2026-02-01,-220,3.5
lost,D-2,2026-02-01,-220,7
"""

CAMPAIGN = """
title = "Three flights"
study = "template.toml"
flights = "flights.csv"

[identify]
law = "arctan_velocity"
"""


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A folder with the logs of two flights, a template, a table of three, and the campaign file."""
    folder = tmp_path_factory.mktemp("fleet")
    for number in (1, 2):
        study = taxi_study(
            taxi_test(LandingGear(), rng=np.random.default_rng(number), duration_s=16.0, fs=256.0), title=f"f{number}"
        )
        (folder / f"f{number}").mkdir()
        write_study(study, folder / f"f{number}" / "study.toml")
    for name, text in (("template.toml", TEMPLATE), ("flights.csv", TABLE), ("fleet.toml", CAMPAIGN)):
        (folder / name).write_text(text)
    return folder


@pytest.fixture
def fleet(logs, tmp_path):
    """A copy of that folder that a test may change."""
    shutil.copytree(logs, tmp_path / "fleet")
    return tmp_path / "fleet"


# ---- the plan --------------------------------------------------------------------------------------


def test_cells_fill_the_template(logs):
    plan = read_campaign(logs / "fleet.toml")
    first = plan.flights[0]
    assert (plan.title, len(plan.flights), plan.options.law) == ("Three flights", 3, "arctan_velocity")
    assert (first.name, first.tail, first.date) == ("f1", "D-1", date(2026, 1, 1))
    assert first.covariates == {"change_kg": -220.0, "temperature_c": 12.5}
    assert [run["log"] for run in first.document["runs"]] == ["f1/heavy.csv", "f1/light.csv"]
    assert first.document["runs"][1]["mass_change_kg"] == -220
    assert first.document["date"] == date(2026, 1, 1)


def test_a_folder_of_studies_is_a_campaign(logs):
    plan = read_campaign(logs)
    # the template is a study, too, whose logs no worker will find
    assert [flight.name for flight in plan.flights] == ["f1", "f2", "template"]
    assert {flight.tail for flight in plan.flights} == {""}


def test_the_folder_above_a_flight_is_its_tail(fleet, tmp_path):
    (tmp_path / "all" / "D-7").mkdir(parents=True)
    shutil.move(fleet / "f1", tmp_path / "all" / "D-7" / "f1")
    (flight,) = read_campaign(tmp_path / "all").flights
    assert (flight.tail, flight.name, flight.folder) == ("D-7", "f1", "D-7/f1")


def test_all_faults_of_a_table_are_told_at_once(fleet):
    rows = ["flight,tail,date,change_kg", "a/b,D-1,,-220", ",D-1,,-220", "f1,D-1,yesterday,-220", "f2,D-1,2026-02-01,"]
    (fleet / "flights.csv").write_text("\n".join([*rows, "f3,,,-220", "f3,,,-220"]) + "\n")
    with pytest.raises(InputError) as error:
        read_campaign(fleet / "fleet.toml")
    said = str(error.value)
    for part in (
        "'a/b' cannot name its log",
        "row 2 of the flights has no 'flight'",
        "flight 'f1' has the date 'yesterday'",
        "flight 'f2' has no cell for {change_kg}",
        "flight 'f3' stands in the table twice",
    ):
        assert part in said


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('flights = "none.csv"\nstudy = "template.toml"', "cannot read the table of flights"),
        ('flights = "flights.csv"', "has no study: give a template"),
        ('flights = "flights.csv"\nstudy = "template.toml"\n[identify]\nlow = "linear"', "did you mean 'law'?"),
        ('study = "template.toml"', "lacks 'flights'"),
        ('flights = "flights.csv"\nstudy = "fleet.toml"', "is no study"),
    ],
)
def test_a_faulty_campaign_file_is_refused_in_a_sentence(fleet, text, said):
    (fleet / "fleet.toml").write_text(text)
    with pytest.raises(InputError, match=said.replace("?", r"\?").replace("[", r"\[")):
        read_campaign(fleet / "fleet.toml")


def test_a_study_in_the_place_of_a_campaign_is_told_so(fleet):
    with pytest.raises(InputError, match="is a study, which `opid identify` takes: name it as the template"):
        read_campaign(fleet / "template.toml")


def test_a_missing_template_is_told_once_and_few_of_many_faults_are_listed(fleet):
    (fleet / "fleet.toml").write_text('flights = "flights.csv"\nstudy = "templat.toml"\n')
    with pytest.raises(InputError) as error:
        read_campaign(fleet / "fleet.toml")
    assert str(error.value).count("did you mean 'template.toml'?") == 1
    (fleet / "fleet.toml").write_text(CAMPAIGN)
    (fleet / "flights.csv").write_text("flight,tail\n" + "".join(f"f{k},D\n" for k in range(900)))
    with pytest.raises(InputError, match="and 894 more"):
        read_campaign(fleet / "fleet.toml")


def test_a_missing_campaign_and_an_empty_folder_are_refused(tmp_path):
    with pytest.raises(InputError, match="there is no campaign file or folder"):
        read_campaign(tmp_path / "none.toml")
    with pytest.raises(InputError, match="there is no study of suspensions in the folder"):
        read_campaign(tmp_path)


def test_semicolons_come_with_decimal_commas_and_names_stay_text(fleet):
    table = "flight;tail;change_kg;temperature_c\nf1;007;-220,5;12,5\n"
    (fleet / "flights.csv").write_text(table)
    (flight,) = read_campaign(fleet / "fleet.toml").flights
    assert (flight.tail, flight.covariates) == ("007", {"change_kg": -220.5, "temperature_c": 12.5})


def test_only_what_is_written_as_a_date_is_one(fleet):
    """A serial number like 20260101, which date.fromisoformat takes, stays what it is."""
    (fleet / "template.toml").write_text(TEMPLATE.replace("{flight}", "{log}"))
    (fleet / "flights.csv").write_text("flight,tail,log,change_kg,serial\n20260101,2026-W01,f1,-220,20260101\n")
    (flight,) = read_campaign(fleet / "fleet.toml").flights
    assert (flight.name, flight.tail, flight.covariates["serial"]) == ("20260101", "2026-W01", 20260101.0)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("flight,change_kg\nf1,-220,5", "3 cells in row 1 where the head has 2"),
        ('flight,change_kg\nf1,"-220\nf2,-220', "line 3"),
        ("flight,change_kg,change_kg\nf1,-220,-220", "the column 'change_kg' 2 times"),
        ("flight,change_kg,\nf1,-220,1", "a column without a name"),
        ("flight,change_kg\nf1," + "9" * 400, "give a finite one"),
        ("flight,change_kg\nf1,inf", "give a finite one"),
        ("flight,change_kg\nf1," + "x" * 200_000, "field larger than field limit"),
        ("flight,change_kg\n" + "f" * 300 + ",-220", "cannot name its log"),
    ],
)
def test_a_table_that_would_be_misread_is_refused(fleet, rows, said):
    (fleet / "flights.csv").write_text(rows + "\n")
    with pytest.raises(InputError) as error:
        read_campaign(fleet / "fleet.toml")
    assert said in str(error.value)


# ---- one flight --------------------------------------------------------------------------------------


def build_task(folder, out, number=0, **others):
    flight = read_campaign(folder / "fleet.toml").flights[number]
    return FlightTask(flight, IdentifyOptions(law="arctan_velocity"), out, run="one", **others)


def test_a_flight_leaves_its_result_and_is_not_identified_again(fleet, tmp_path):
    task = build_task(fleet, tmp_path)
    done = run_task(task)
    assert (done.outcome.verdict, done.is_new) == (Verdict.IDENTIFIED, True)
    assert done.outcome.flight.name == "f1"
    mass = next(each for what, each in done.outcome.flight.values.items() if what.name == "mass")
    assert mass.interval95[0] < 1850 < mass.interval95[1]
    assert sorted(each.name for each in task.folder.iterdir()) == ["outcome.json", "result.json"]
    again = run_task(replace(task, run="two"))
    assert not again.is_new
    assert again.outcome.flight.values == done.outcome.flight.values
    assert run_task(replace(task, is_forced=True)).is_new


def test_a_flight_is_identified_again_after_a_change_of_its_log_or_of_the_options(fleet, tmp_path):
    task = build_task(fleet, tmp_path)
    run_task(task)
    assert run_task(replace(task, options=IdentifyOptions(law="linear"))).is_new
    run_task(task)
    log = fleet / "f1" / "heavy.csv"
    lines = log.read_text().splitlines()
    log.write_text("\n".join(lines[:-1]) + "\n")
    assert run_task(task).is_new


def test_a_result_outlives_its_logs_and_is_made_again_where_it_was_edited(fleet, tmp_path):
    task = build_task(fleet, tmp_path)
    first = run_task(task).outcome
    shutil.move(fleet / "f1", fleet / "archive")
    kept = run_task(task)
    assert (kept.is_new, kept.outcome.flight.values) == (False, first.flight.values)
    shutil.move(fleet / "archive", fleet / "f1")
    result = task.folder / "result.json"
    result.write_text(result.read_text().replace('"value": 1', '"value": 2'))
    again = run_task(task)
    assert (again.is_new, again.outcome.flight.values) == (True, first.flight.values)


def test_a_flight_without_its_logs_has_failed_and_is_tried_again(fleet, tmp_path):
    task = build_task(fleet, tmp_path, 2)
    done = run_task(task)
    assert done.outcome.verdict is Verdict.FAILED
    assert "there is no file" in done.outcome.reason
    shutil.copytree(fleet / "f1", fleet / "lost")
    assert run_task(task).outcome.verdict is Verdict.IDENTIFIED


def test_a_refused_flight_is_not_determined_and_keeps_its_result(fleet, tmp_path):
    # both runs have one mass, so that no absolute value follows
    text = (fleet / "flights.csv").read_text().replace("-220", "0")
    (fleet / "flights.csv").write_text(text)
    done = run_task(build_task(fleet, tmp_path))
    assert done.outcome.verdict is Verdict.NOT_DETERMINED
    assert done.outcome.reason
    assert json.loads((tmp_path / done.outcome.folder / "result.json").read_text())["not_determined"]
    assert not run_task(build_task(fleet, tmp_path)).is_new


def test_an_error_in_opid_is_a_reason_and_ends_nothing(fleet, tmp_path, monkeypatch):
    def fail(*_):
        raise ZeroDivisionError("no such thing")

    monkeypatch.setattr(flight_task, "_read_logs", fail)
    done = run_task(build_task(fleet, tmp_path))
    assert done.outcome.verdict is Verdict.FAILED
    assert "an error in opid itself, ZeroDivisionError: no such thing" in done.outcome.reason
    assert "ZeroDivisionError" in (tmp_path / done.outcome.folder / "error.txt").read_text()


HANG = """
import sys, time
from pathlib import Path
sys.path.insert(0, {tests!r})
from opid.campaigns import flight_task
from test_campaigns import build_task

def hang(flight):
    {how}

flight_task._read_logs = hang
flight_task.run_task(build_task(Path({folder!r}), Path({out!r}), settings=flight_task.TaskSettings(time_limit_s=1.0)))
"""


def die(folder, out, how):
    script = HANG.format(tests=str(Path(__file__).parent), folder=str(folder), out=str(out), how=how)
    return subprocess.run([sys.executable, "-c", script], capture_output=True, timeout=120).returncode


def test_a_flight_that_hangs_ends_its_worker_and_is_reported_by_the_next(fleet, tmp_path):
    # compiled code that never returns and holds the interpreter's lock listens to no signal
    assert die(fleet, tmp_path, "__import__('re').match(r'(a+)+$', 'a' * 64 + 'b')") == 1
    settings = TaskSettings(time_limit_s=1.0)
    done = run_task(build_task(fleet, tmp_path, settings=settings))
    assert done.outcome.verdict is Verdict.FAILED
    assert "it did not end within 1 s" in done.outcome.reason
    # with the same time it is not tried again, with more it is
    assert not run_task(build_task(fleet, tmp_path, settings=settings)).is_new
    assert run_task(build_task(fleet, tmp_path)).outcome.verdict is Verdict.IDENTIFIED


def test_a_flight_whose_worker_dies_again_and_again_is_given_up(fleet, tmp_path):
    for _ in range(2):
        assert die(fleet, tmp_path, "__import__('os')._exit(9)") == 9
    tried = build_task(fleet, tmp_path, settings=TaskSettings(most_attempts=2))
    assert "its worker died 2 times" in run_task(tried).outcome.reason
    # attempts of another run do not count: somebody may have stopped it
    assert die(fleet, tmp_path / "b", "__import__('os')._exit(9)") == 9
    other = replace(build_task(fleet, tmp_path / "b", settings=TaskSettings(most_attempts=1)), run="two")
    assert run_task(other).outcome.verdict is Verdict.IDENTIFIED


# ---- a whole campaign --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ran(logs, tmp_path_factory):
    """A campaign of three flights on one worker: its result, its folder, and what the user was told."""
    pytest.importorskip("distributed")
    from opid.campaigns.engine import run_campaign

    out, said = tmp_path_factory.mktemp("out"), []
    plan = read_campaign(logs / "fleet.toml")
    found = run_campaign(plan, out, workers=1, announce=said.append, progress=said.append)
    return found, out, said


def test_a_campaign_identifies_what_can_be_identified(ran):
    found, out, said = ran
    assert found.counts == {Verdict.IDENTIFIED: 2, Verdict.NOT_DETERMINED: 0, Verdict.FAILED: 1}
    assert said[0].startswith("http")
    assert [(step.name, step.fraction) for step in said[1:]] == [(f"{n} of 3 flights", n / 3) for n in range(4)]
    assert (out / "flights" / "D-1" / "f2" / "result.json").is_file()
    assert found.to_dict()["flights"][2]["reason"]


def test_the_dataset_holds_each_value_with_its_traces(ran):
    pytest.importorskip("pyarrow")
    found, out, _ = ran
    dataset = read_dataset(out)
    assert dataset.n_flights == 3
    (reason,) = dataset.without_values
    assert "there is no file" in reason
    mass = next(table for table in dataset.tables if table.quantity.name == "mass")
    estimates = [
        next(e for what, e in each.flight.values.items() if what.name == "mass") for each in found.outcomes[:2]
    ]
    assert list(mass.value) == [each.value for each in estimates]
    assert list(mass.std) == [each.std for each in estimates]
    assert list(mass.covariates["temperature_c"]) == [12.5, 3.5]
    assert list(mass.day) == [(date(2026, month, 1) - date(1970, 1, 1)).days for month in (1, 2)]


def test_any_reader_of_parquet_sees_tails_dates_hashes_and_the_version(ran):
    dataset = pytest.importorskip("pyarrow.dataset")
    from opid import __version__

    found, out, _ = ran
    rows = dataset.dataset(out / "dataset", partitioning="hive").to_table().to_pylist()
    assert {row["tail"] for row in rows} == {"D-1", "D-2"}
    assert {row["opid"] for row in rows} == {__version__}
    first = found.outcomes[0]
    row = next(row for row in rows if row["flight"] == "f1" and row["quantity"] == "mass")
    assert (row["task_sha256"], row["files_sha256"]) == (first.task_sha256, [each.sha256 for each in first.files])
    assert row["low"] < row["value"] < row["high"]
    (lost,) = [row for row in rows if row["flight"] == "lost"]
    assert (lost["verdict"], lost["value"]) == ("failed", None)


def test_a_second_run_does_nothing_again_and_gives_the_same_dataset(ran, logs):
    from opid.campaigns.engine import run_campaign

    _, out, _ = ran
    before = {path: path.read_bytes() for path in (out / "dataset").rglob("*.parquet")}
    again = run_campaign(read_campaign(logs / "fleet.toml"), out, workers=1)
    assert again.n_done_before == 2  # the flight without logs is tried again
    assert {path: path.read_bytes() for path in (out / "dataset").rglob("*.parquet")} == before


def test_a_flight_that_leaves_the_table_leaves_the_dataset(ran, logs, tmp_path):
    from opid.campaigns.engine import run_campaign

    _, out, _ = ran
    shutil.copytree(out, tmp_path / "out")
    plan = read_campaign(logs / "fleet.toml")
    run_campaign(replace(plan, flights=plan.flights[:2]), tmp_path / "out", workers=1)
    assert [path.name for path in (tmp_path / "out" / "dataset").iterdir()] == ["tail=D-1"]


def test_bad_campaigns_are_refused_before_any_work(logs, tmp_path):
    pytest.importorskip("distributed")
    from opid.campaigns.engine import EngineSettings, run_campaign

    plan = read_campaign(logs / "fleet.toml")
    with pytest.raises(InputError, match="has no flight"):
        run_campaign(replace(plan, flights=()), tmp_path)
    with pytest.raises(InputError, match="0 workers are given"):
        run_campaign(plan, tmp_path, workers=0)
    named = replace(plan.flights[0], covariates={"value": 1.0})
    with pytest.raises(InputError, match="a column 'value', which is one of the dataset"):
        run_campaign(replace(plan, flights=(named,)), tmp_path)
    with pytest.raises(InputError, match="2 flights would write into flights/D-1/f1"):
        run_campaign(replace(plan, flights=plan.flights[:1] * 2), tmp_path)
    beside = replace(plan.flights[0], name="D-1", tail="")
    with pytest.raises(InputError, match="'D-1' is the name of a flight without a tail number, and a tail number"):
        run_campaign(replace(plan, flights=(plan.flights[0], beside)), tmp_path)
    none = replace(plan.flights[0], tail="__HIVE_DEFAULT_PARTITION__")
    with pytest.raises(InputError, match="cannot be a tail number"):
        run_campaign(replace(plan, flights=(none,)), tmp_path)
    with pytest.raises(InputError, match=r"there is no scheduler at 'tcp://127.0.0.1:1'"):
        run_campaign(plan, tmp_path, scheduler="tcp://127.0.0.1:1", engine=EngineSettings(connection_s=1.0))


def test_a_scheduler_without_workers_is_refused(logs, tmp_path):
    distributed = pytest.importorskip("distributed")
    from opid.campaigns.engine import EngineSettings, run_campaign

    with distributed.LocalCluster(n_workers=0, dashboard_address=":0") as cluster:
        address = cluster.scheduler_address
        with pytest.raises(InputError, match="has no worker: start some with `dask worker"):
            run_campaign(
                read_campaign(logs / "fleet.toml"), tmp_path, scheduler=address, engine=EngineSettings(connection_s=1.0)
            )


def test_the_folder_of_another_campaign_is_not_replaced(tmp_path):
    from opid.campaigns.engine import refuse_another

    (tmp_path / "campaign.json").write_text('{"title": "Other flights"}')
    with pytest.raises(InputError, match="holds the campaign 'Other flights', and this one is 'Three flights'"):
        refuse_another("Three flights", tmp_path)
    refuse_another("Other flights", tmp_path)


def put_pipe(path):
    path.unlink(missing_ok=True)
    os.mkfifo(path)


def put_depth(path):
    path.write_text("[" * 100_000)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
@pytest.mark.parametrize("put", [put_pipe, put_depth])
def test_what_an_earlier_run_has_not_left_is_not_read(put, fleet, tmp_path):
    """A pipe has no end, and a list that nests 100,000 deep was a RecursionError in the worker."""
    from opid.campaigns.engine import refuse_another

    put(tmp_path / "campaign.json")
    task = build_task(fleet, tmp_path)
    task.folder.mkdir(parents=True)
    put(task.folder / "outcome.json")
    put(task.folder / "begun.json")
    with ended_after(30):
        refuse_another("Three flights", tmp_path)
        assert flight_task._find_outcome(task) is None
        if put is put_depth:
            assert flight_task._count_attempt(task) == ""


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
def test_a_log_that_has_become_a_pipe_has_changed(fleet, tmp_path):
    task = build_task(fleet, tmp_path)
    run_task(task)
    put_pipe(fleet / "f1" / "heavy.csv")
    with ended_after(30):
        assert flight_task._find_outcome(task) is None


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (PermissionError(13, "Permission denied"), r"flights\.csv: Permission denied: check its permissions$"),
        (FileNotFoundError(2, "No such file or directory"), r"No such file or directory: did you mean 'flights2\.csv'"),
    ],
)
def test_another_name_is_suggested_only_for_a_table_that_is_not_there(error, said, tmp_path, monkeypatch):
    """It was: Permission denied, but a directory, a pipe, a device or a link that leads nowhere."""

    def fail(_):
        raise error

    (tmp_path / "flights2.csv").write_text("flight\nf1\n")
    if isinstance(error, PermissionError):
        (tmp_path / "flights.csv").write_text("flight\nf1\n")
    monkeypatch.setattr("opid.signals.files.read_content", fail)
    with pytest.raises(InputError, match=said):
        read_rows(tmp_path / "flights.csv")


def test_a_dataset_that_is_none_is_refused(tmp_path):
    pytest.importorskip("pyarrow")
    with pytest.raises(InputError, match="there is no dataset of flights in"):
        read_dataset(tmp_path)
    (tmp_path / "tail=D-1").mkdir()
    (tmp_path / "tail=D-1" / "part-00000.parquet").write_bytes(b"no parquet")
    with pytest.raises(InputError, match="is no sound Parquet file"):
        read_dataset(tmp_path)


def test_a_flight_knows_its_folder():
    flight = PlannedFlight(name="f", tail="", document={}, source=Path("study.toml"))
    assert flight.folder == "f"
