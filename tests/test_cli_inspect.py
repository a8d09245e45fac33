"""`opid inspect` as a user drives it: what it tells, draws and refuses."""

import json
import os
import re
import sys

import numpy as np
import pytest
from cli_runs import opid, refused
from matplotlib.figure import Figure

from opid import plots
from opid.report import health
from opid.signals.health.settings import HEALTH
from opid.signals.logs import read_log, write_log
from opid.signals.recording import Channel, Recording


@pytest.fixture
def empty_pictures(monkeypatch):
    """Draw nothing where a test is about which pictures there are."""
    monkeypatch.setattr(plots, "health_picture", lambda health, channels: Figure().subplots())


def test_a_relative_path_with_blanks_is_printed_whole(field_test, tmp_path, monkeypatch):
    folder = tmp_path / "a very long folder name-with-hyphens and many blanks"
    folder.mkdir()
    (folder / "run of tuesday.csv").write_bytes((field_test / "heavy.csv").read_bytes())
    monkeypatch.chdir(tmp_path)
    path = f"{folder.name}/run of tuesday.csv"
    assert path in opid("inspect", path).stdout


def test_inspect_tells_and_draws(field_test, tmp_path):
    logs = (field_test / "heavy.csv", field_test / "light.csv")
    done = opid("inspect", *logs, "--out", tmp_path / "pictures")
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.output.count("256 Hz") == 2
    assert sorted(path.name for path in (tmp_path / "pictures").iterdir()) == [
        "report.html",
        "result.json",
    ]
    page = (tmp_path / "pictures" / "report.html").read_text(encoding="utf-8")
    assert page.count('data-chart="') == page.count("lower_z&#39; looks like the unsprung channel") == 2
    assert re.findall(r'data-chart="(\w+)"', page) == ["heavy", "light"]
    document = json.loads(opid("inspect", logs[0], "--json").stdout)
    assert document["schema"] == "opid.health/1"
    assert document["settings"]["clip_run"] == HEALTH.clip_run
    assert document["logs"][0]["looks_unsprung"] == "lower_z"


@pytest.mark.usefixtures("empty_pictures")
def test_inspect_names_the_pictures_of_two_logs_of_one_name_apart(field_test, tmp_path):
    log = field_test / "heavy.csv"
    other = tmp_path / "heavy.csv"
    other.write_bytes(log.read_bytes())
    done = opid("inspect", log, other, log, "--png", "--out", tmp_path / "pictures")
    assert done.exit_code == 0
    assert sorted(path.name for path in (tmp_path / "pictures").iterdir()) == [
        "heavy_1.png",
        "heavy_2.png",
        "report.html",
        "result.json",
    ]


def test_inspect_draws_accelerations_first_where_there_are_too_many_channels(tmp_path, monkeypatch):
    monkeypatch.setattr(health, "CHANNELS_A_FIGURE", 2)
    monkeypatch.setattr(health, "MOST_FIGURES", 2)
    drawn = []
    picture = plots.health_picture

    def first_of(health, channels):
        drawn.append(channels)
        return picture(health, channels=channels[:1])

    monkeypatch.setattr(plots, "health_picture", first_of)
    channels = tuple(Channel(f"c{i}", "m/s^2" if i > 2 else "m") for i in range(8))
    samples = np.random.default_rng(0).standard_normal((400, 8))
    write_log(Recording(samples, fs=100.0, channels=channels), tmp_path / "many.csv")
    done = opid("inspect", tmp_path / "many.csv", "--png", "--out", tmp_path / "out")
    pictures = sorted(path.name for path in (tmp_path / "out").glob("*.png"))
    assert pictures == ["many_part1.png", "many_part2.png"]
    assert drawn == [["c3", "c4"], ["c5", "c6"]]
    assert "4 of the 8 channels of" in done.output


def test_inspect_reads_a_log_as_the_study_says(tmp_path):
    counts = np.random.default_rng(0).integers(-300, 300, (400, 3))
    lines = "\n".join(",".join(map(str, (k / 100, *row))) for k, row in enumerate(counts.tolist()))
    (tmp_path / "raw.txt").write_text(lines + "\n")
    study = tmp_path / "study.toml"
    study.write_text(
        '[log]\nnames = ["time", "below", "above", "other"]\ntime_unit = "s"\n'
        '[channels.unsprung]\nchannel = "below"\nunit = "g"\nscale = 0.01\n'
        '[channels.sprung]\nchannel = "above"\nunit = "g"\nscale = 0.01\nsign = -1\n'
        '[[runs]]\nname = "raw"\nlog = "raw.txt"\nmass_change_kg = 0\n'
    )
    document = json.loads(opid("inspect", tmp_path / "raw.txt", "--study", study, "--json").stdout)
    channels = {each["name"]: each for each in document["logs"][0]["channels"]}
    assert set(channels) == {"unsprung", "sprung"}
    assert {each["unit"] for each in channels.values()} == {"m/s^2"}
    assert channels["unsprung"]["mean"] == pytest.approx(0.01 * 9.80665 * counts[:, 0].mean())
    assert channels["sprung"]["mean"] == pytest.approx(-0.01 * 9.80665 * counts[:, 1].mean())
    refused(opid("inspect", tmp_path / "raw.txt", "--study", tmp_path / "none.toml"), "there is no study file")


TWO_RECORDERS = """\
[channels]
unsprung = "below"

[channels.sprung]
file = "{run}_airframe.csv"
channel = 2
log = { unit = "g" }

[[runs]]
name = "heavy"
log = "heavy.csv"
mass_change_kg = 0

[[runs]]
name = "light"
log = "light.csv"
mass_change_kg = -220

[runs.channels.sprung]
offset = 5.0
"""


@pytest.fixture
def two_recorders(tmp_path):
    """A study whose airframe has a recorder of its own, in g as only a `log` table says, offset in the second run."""
    samples = np.random.default_rng(0).standard_normal((400, 2))
    samples[:, 1] -= samples[:, 1].mean()
    rows = "".join(f"{k / 100:.2f},{a:.9f},{b:.9f}\n" for k, (a, b) in enumerate(samples.tolist()))
    for run in ("heavy", "light"):
        (tmp_path / f"{run}.csv").write_text("time [s],spare [m],below [m/s^2]\n" + rows)
        (tmp_path / f"{run}_airframe.csv").write_text("time [s],ax,az\n" + rows)
    (tmp_path / "study.toml").write_text(TWO_RECORDERS)
    return tmp_path


def test_inspect_shows_what_the_study_makes_of_each_recorder_and_run(two_recorders):
    logs = [two_recorders / f"{name}.csv" for name in ("heavy", "heavy_airframe", "light_airframe")]
    done = opid("inspect", *logs, "--study", two_recorders / "study.toml", "--json")
    assert (done.exit_code, done.stderr) == (0, "")
    found = [each["channels"] for each in json.loads(done.stdout)["logs"]]
    assert [[channel["name"] for channel in channels] for channels in found] == [["below"], ["sprung"], ["sprung"]]
    assert [channels[0]["unit"] for channels in found] == ["m/s^2"] * 3
    # the number is that in the file, not in the study
    assert [channels[0]["number"] for channels in found] == [2, 2, 2]
    assert found[1][0]["mean"] == pytest.approx(0.0, abs=1e-6)
    assert found[2][0]["mean"] == pytest.approx(5.0 * 9.80665)


def test_inspect_says_which_run_a_log_is_read_for(two_recorders):
    study = two_recorders / "study.toml"
    study.write_text(TWO_RECORDERS.replace('"light.csv"', '"heavy.csv"'))
    done = opid("inspect", two_recorders / "heavy.csv", "--study", study)
    assert "Note: read as run 'heavy' says; 'light' uses this log, too" in done.stdout
    done = opid("inspect", two_recorders / "light.csv", "--study", study, "--json")
    (log,) = json.loads(done.stdout)["logs"]
    assert [channel["name"] for channel in log["channels"]] == ["spare", "below"]
    assert log["findings"][-1]["message"].startswith("no run of the study takes a channel from this log")


@pytest.mark.usefixtures("empty_pictures")
def test_inspect_reads_a_file_in_each_way_that_the_study_does(two_recorders):
    study = two_recorders / "study.toml"
    study.write_text(TWO_RECORDERS.replace('file = "{run}_airframe.csv"\nchannel = 2', 'channel = "spare"\nunit = "g"'))
    done = opid(
        "inspect", two_recorders / "heavy.csv", "--study", study, "--json", "--png", "--out", two_recorders / "out"
    )
    logs = json.loads(done.stdout)["logs"]
    assert [each["log"] for each in logs] == [f"{two_recorders / 'heavy.csv'} ({name})" for name in ("below", "sprung")]
    assert [each["channels"][0]["number"] for each in logs] == [2, 1]
    assert sorted(path.name for path in (two_recorders / "out").iterdir()) == [
        "heavy_1.png",
        "heavy_2.png",
        "report.html",
        "result.json",
    ]


def test_inspect_numbers_the_channels_as_a_study_may_name_them(field_test):
    said = opid("inspect", field_test / "heavy.csv").stdout.splitlines()
    head = next(line.split() for line in said if line.startswith("channel "))
    assert head[:3] == ["channel", "no.", "unit"]
    names = read_log(field_test / "heavy.csv").names
    rows = [line.split()[:2] for line in said if line.split()[:1] and line.split()[0] in names][: len(names)]
    assert rows == [[name, str(number)] for number, name in enumerate(names, 1)]


@pytest.mark.usefixtures("empty_pictures")
def test_inspect_tells_of_damaged_logs_and_inspects_the_others(field_test, tmp_path):
    damaged, empty = tmp_path / "damaged.csv", tmp_path / "empty.csv"
    damaged.write_text("time [s],upper_z [m/s^2]\n0,1\n0.1,x\n")
    empty.touch()
    done = opid("inspect", damaged, field_test / "heavy.csv", "--png", "--out", tmp_path / "pictures")
    refused(done, "damaged.csv")
    assert "heavy.csv (what is in the log" in " ".join(done.stdout.split())
    assert "20 s from 0 s on" in done.stdout
    assert [path.name for path in (tmp_path / "pictures").glob("*.png")] == ["heavy.png"]
    done = opid("inspect", damaged, empty, field_test / "heavy.csv", "--json")
    assert done.exit_code == 2
    assert [line.split(":")[0] for line in done.stderr.splitlines()] == ["Error", "Error"]
    assert [each["log"] for each in json.loads(done.stdout)["logs"]] == [str(field_test / "heavy.csv")]


@pytest.mark.skipif(sys.platform != "linux", reason="file names are text here")
def test_inspect_takes_a_log_whose_name_is_no_utf_8(field_test, tmp_path):
    log = tmp_path / os.fsdecode(b"\xff.csv")
    log.write_bytes((field_test / "heavy.csv").read_bytes())
    done = opid("inspect", log)
    assert (done.exit_code, done.stderr) == (0, "")
    # a long name of the directory breaks the line behind it
    assert r"\udcff.csv (what is" in done.stdout.replace("\n", " ")
    assert json.loads(opid("inspect", log, "--json").stdout)["logs"][0]["log"] == str(log)


@pytest.mark.usefixtures("empty_pictures")
def test_inspect_writes_what_it_prints(field_test, tmp_path):
    logs = (field_test / "heavy.csv", field_test / "light.csv")
    done = opid("inspect", *logs, "--json", "--no-figures", "--out", tmp_path / "out")
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.stdout == (tmp_path / "out" / "result.json").read_text(encoding="utf-8")
    assert [each["name"] for each in json.loads(done.stdout)["provenance"]["files"]] == list(map(str, logs))
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"report.html", "result.json"}
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    for log in logs:
        assert re.search(rf"<h2 id=.*>{log}</h2>", page)
    assert f'<pre tabindex="0">opid inspect {logs[0]} {logs[1]}</pre>' in page
    assert opid("inspect", *logs, "--quiet").output == ""
    assert f"opened {logs[0]}: CSV with 2 channels" in opid("inspect", *logs, "--verbose").stderr


def test_inspect_refuses(field_test, tmp_path):
    refused(opid("inspect", tmp_path / "none.csv"), "there is no file")
    refused(opid("inspect"), "Missing argument")
    (tmp_path / "file").touch()
    done = opid("inspect", field_test / "heavy.csv", "--out", tmp_path / "file")
    refused(done, "no directory")
    assert done.stdout == ""
