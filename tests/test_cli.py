"""The command as a user drives it: what it writes, what it says, and with which status it ends."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from opid import cli, plots
from opid.cli import logs as logs_command
from opid.identify import identification
from opid.mechanics import landing_gear
from opid.mechanics.landing_gear import LandingGear, taxi_run, taxi_test
from opid.mechanics.sensors import Sensor
from opid.report import page, read_truth
from opid.signals.logs import read_log, write_log
from opid.signals.recording import Channel, Recording

CHANNELS = ("--sprung", "upper_z", "--unsprung", "lower_z")


def shell(*arguments, cwd=None):
    """Run the command in a process of its own."""
    command = [sys.executable, "-W", "error", "-m", "opid.cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", cwd=cwd)


def opid(*arguments):
    """Run the command in this process; an exception that would be a traceback is raised here."""
    return CliRunner().invoke(cli.main, [str(argument) for argument in arguments], catch_exceptions=False)


def refused(done, *words, status=2):
    """Check that a command ended with one sentence on stderr that has these words, and return the sentence."""
    assert done.exit_code == status, done.output
    lines = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
    assert len(lines) == 1
    assert done.stderr.rstrip().endswith(lines[0])
    assert "Traceback" not in done.output
    for word in words:
        assert word in lines[0]
    return lines[0]


@pytest.fixture
def few_figures(monkeypatch):
    """Draw only one figure where the figures are not what a test is about."""
    monkeypatch.setattr(page, "pictures", lambda: PICTURES[5:6])


PICTURES = page.pictures()


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


# ---- the main paths, in a process of their own -----------------------------------------------------


def test_a_user_simulates_and_identifies(tmp_path):
    done = shell("simulate", "taxi", "runs", "--duration", 20, "--fs", 256, "--seed", 3, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    names = sorted(path.name for path in (tmp_path / "runs").iterdir())
    assert names == ["heavy.csv", "light.csv", "study.toml", "truth.json"]
    assert "opid identify runs/study.toml" in done.stdout.replace("\\", "/")

    done = shell("identify", "runs/study.toml", "--truth", "runs/truth.json", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    report = tmp_path / "runs_result"
    assert len(list(report.glob("*.png"))) == len(PICTURES)
    assert (report / "report.html").stat().st_size > 200_000
    result = json.loads((report / "result.json").read_text(encoding="utf-8"))
    mass = result["parameters"]["sprung_mass_kg"]
    assert mass["value"] == pytest.approx(1850, rel=0.02)
    assert "truth" in done.stdout
    assert "runs_result" in done.stdout


def test_help_comes_without_heavy_imports():
    code = "import sys, opid.cli; print({'numpy', 'scipy', 'matplotlib', 'numba', 'jinja2'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
    for command in ((), ("demo",), ("simulate", "taxi"), ("inspect",), ("identify",)):
        assert opid(*command, "--help").exit_code == 0
    assert "version 0" in opid("--version").output


def test_bad_input_in_a_process_of_its_own(tmp_path):
    done = shell("identify", tmp_path / "missing.toml")
    assert done.returncode == 2
    assert done.stderr == f"Error: there is no study file {tmp_path / 'missing.toml'}: check the name\n"


# ---- demo and simulate -----------------------------------------------------------------------------


@pytest.mark.usefixtures("few_figures")
def test_demo_shows_truth_beside_estimate(tmp_path, monkeypatch):
    short = {"duration_s": 20.0, "fs": 256.0}
    monkeypatch.setattr(landing_gear, "taxi_test", lambda gear, **settings: taxi_test(gear, **settings, **short))
    done = opid("demo", "--out", tmp_path / "demo", "--seed", 2)
    assert done.exit_code == 0
    row = next(line for line in done.output.splitlines() if line.startswith("sprung mass"))
    assert row.split()[-1] == "yes"
    assert "1850" in row
    assert str(tmp_path / "demo" / "report" / "report.html") in done.output
    assert (tmp_path / "demo" / "study.toml").exists()
    assert (tmp_path / "demo" / "report" / "result.json").exists()


def test_the_defaults_of_simulate_are_those_of_the_library():
    options = cli.taxi.make_context("taxi", ["out"]).params
    gear, sensor = LandingGear(), Sensor()
    assert options["sprung_mass"] == gear.sprung_mass_kg
    assert options["stiffness"] == gear.suspension_stiffness_n_per_m
    assert options["ground_stiffness"] == gear.ground_stiffness_n_per_m
    assert options["noise"] == sensor.noise_m_per_s2
    assert options["corner"] == sensor.corner_hz
    defaults = taxi_run.__kwdefaults__
    assert (options["speed_start"], options["speed_stop"]) == defaults["speed_m_per_s"]
    assert options["duration"] == defaults["duration_s"]
    assert options["fs"] == defaults["fs"]
    assert options["road_class"] == defaults["road_class"]
    assert options["mass_removed"] == taxi_test.__kwdefaults__["mass_removed_kg"]
    assert cli.virtual_tests._gear(options) == gear


def test_simulate_does_what_its_options_say(tmp_path):
    options = "--duration 3 --fs 256 --law arctan_velocity+cubic_stiffness --friction 900 --damping-ratio 0.3"
    sensors = "--gain-error 1 --corner 0.3 --corner-mismatch 10 --cross-axis 3 --bits 12 --range 80"
    done = opid("simulate", "taxi", tmp_path / "a", *options.split(), *sensors.split(), "--mass-removed", 300)
    assert done.exit_code == 0
    truth = read_truth(tmp_path / "a" / "truth.json")
    assert truth["law"]["parameters"]["arctan_velocity"]["amplitude_n"] == 900
    assert truth["law"]["parameters"]["cubic_stiffness"]["stiffness_n_per_m3"] == 3e9
    assert truth["parameters"]["suspension_damping_n_s_per_m"] == pytest.approx(2 * 0.3 * (3.9e5 * 1850) ** 0.5)
    assert truth["mass_change_kg"] == -300
    assert truth["settings"]["bits"] == 12
    run = read_log(tmp_path / "a" / "heavy.csv")
    assert (run.fs, run.duration_s) == (256, 3)
    steps = run.samples / (2 * 80 / 2**12)
    assert np.allclose(steps, np.round(steps), atol=1e-6)


def test_one_seed_gives_one_test_and_another_seed_another(tmp_path):
    texts = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        opid("simulate", "taxi", tmp_path / name, "--duration", 2, "--fs", 256, "--seed", seed)
        texts.append((tmp_path / name / "heavy.csv").read_text())
    assert texts[0] == texts[1] != texts[2]


def test_no_friction_is_no_term(tmp_path):
    opid("simulate", "taxi", tmp_path, "--duration", 2, "--friction", 0)
    assert read_truth(tmp_path / "truth.json")["law"] == {"name": "linear", "parameters": {}}


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ("--law cubc_stiffness", "did you mean 'cubic_stiffness'"),
        ("--law cubic_stiffness --friction 400", "--friction needs one friction term"),
        ("--duration -3", "duration_s is -3"),
        ("--mass-removed 5000", "mass_removed_kg is 5000"),
        ("--sprung-mass 0", "sprung_mass_kg"),
        ("--road-class Z", "road class"),
        ("--damping 1 --damping-ratio 1", "give one of them"),
        ("--bits 1", "bits is 1"),
        ("--noise -1", "negative"),
        ("--fs many", "'many' is not a valid float"),
        ("--seed -1", "--seed"),
    ],
)
def test_simulate_refuses(options, word, tmp_path):
    refused(opid("simulate", "taxi", tmp_path / "out", *options.split()), word)
    assert not (tmp_path / "out").exists()


# ---- inspect ---------------------------------------------------------------------------------------


def test_inspect_tells_and_draws(field_test, tmp_path):
    logs = (field_test / "heavy.csv", field_test / "light.csv")
    done = opid("inspect", *logs, "--out", tmp_path / "pictures")
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.output.count("256 Hz") == 2
    assert sorted(path.name for path in (tmp_path / "pictures").iterdir()) == ["heavy.png", "light.png"]
    assert (tmp_path / "pictures" / "heavy.png").read_bytes().startswith(b"\x89PNG")
    document = json.loads(opid("inspect", logs[0], "--json").stdout)
    assert document["schema"] == "opid.health/1"
    assert document["logs"][0]["looks_unsprung"] == "lower_z"


def test_inspect_names_the_pictures_of_two_logs_of_one_name_apart(field_test, tmp_path):
    log = field_test / "heavy.csv"
    other = tmp_path / "heavy.csv"
    other.write_bytes(log.read_bytes())
    done = opid("inspect", log, other, log, "--out", tmp_path / "pictures")
    assert done.exit_code == 0
    assert sorted(path.name for path in (tmp_path / "pictures").iterdir()) == ["heavy_1.png", "heavy_2.png"]


def test_inspect_draws_accelerations_first_where_there_are_too_many_channels(tmp_path, monkeypatch):
    monkeypatch.setattr(logs_command, "CHANNELS_A_PICTURE", 2)
    monkeypatch.setattr(logs_command, "MOST_PICTURES", 2)
    drawn = []
    picture = plots.health_picture

    def first_of(health, channels):
        drawn.append(channels)
        return picture(health, channels=channels[:1])

    monkeypatch.setattr(plots, "health_picture", first_of)
    channels = tuple(Channel(f"c{i}", "m/s^2" if i > 2 else "m") for i in range(8))
    samples = np.random.default_rng(0).standard_normal((400, 8))
    write_log(Recording(samples, fs=100.0, channels=channels), tmp_path / "many.csv")
    done = opid("inspect", tmp_path / "many.csv", "--out", tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["many_part1.png", "many_part2.png"]
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


def test_inspect_reads_a_file_in_each_way_that_the_study_does(two_recorders):
    study = two_recorders / "study.toml"
    study.write_text(TWO_RECORDERS.replace('file = "{run}_airframe.csv"\nchannel = 2', 'channel = "spare"\nunit = "g"'))
    done = opid("inspect", two_recorders / "heavy.csv", "--study", study, "--json", "--out", two_recorders / "out")
    logs = json.loads(done.stdout)["logs"]
    assert [each["log"] for each in logs] == [f"{two_recorders / 'heavy.csv'} ({name})" for name in ("below", "sprung")]
    assert [each["channels"][0]["number"] for each in logs] == [2, 1]
    assert sorted(path.name for path in (two_recorders / "out").iterdir()) == ["heavy_1.png", "heavy_2.png"]


def test_inspect_numbers_the_channels_as_a_study_may_name_them(field_test):
    said = opid("inspect", field_test / "heavy.csv").stdout.splitlines()
    head = next(line.split() for line in said if line.startswith("channel "))
    assert head[:3] == ["channel", "no.", "unit"]
    names = read_log(field_test / "heavy.csv").names
    rows = [line.split()[:2] for line in said if line.split()[:1] and line.split()[0] in names][: len(names)]
    assert rows == [[name, str(number)] for number, name in enumerate(names, 1)]


def test_inspect_tells_of_damaged_logs_and_inspects_the_others(field_test, tmp_path):
    damaged, empty = tmp_path / "damaged.csv", tmp_path / "empty.csv"
    damaged.write_text("time [s],upper_z [m/s^2]\n0,1\n0.1,x\n")
    empty.touch()
    done = opid("inspect", damaged, field_test / "heavy.csv", "--out", tmp_path / "pictures")
    refused(done, "damaged.csv")
    assert "heavy.csv: 20 s" in done.stdout
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["heavy.png"]
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
    # a long name of the directory breaks the line anywhere
    assert r"\udcff.csv: 20 s" in done.stdout.replace("\n", "")
    assert json.loads(opid("inspect", log, "--json").stdout)["logs"][0]["log"] == str(log)


def test_inspect_refuses(field_test, tmp_path):
    refused(opid("inspect", tmp_path / "none.csv"), "there is no file")
    refused(opid("inspect"), "Missing argument")
    (tmp_path / "file").touch()
    done = opid("inspect", field_test / "heavy.csv", "--out", tmp_path / "file")
    refused(done, "no directory")
    assert done.stdout == ""


# ---- identify --------------------------------------------------------------------------------------


@pytest.mark.usefixtures("few_figures")
def test_logs_without_a_study_give_the_same(field_test, identified, logs, tmp_path):
    done = logs.identify()
    assert done.exit_code == 0
    result = json.loads((tmp_path / "result" / "result.json").read_text(encoding="utf-8"))
    for name, estimate in identified.result.parameters.items():
        assert result["parameters"][name]["value"] == pytest.approx(estimate.value, rel=1e-9)


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
    assert result["diagnostics"]["settings"] == {
        "study": "study.toml",
        "sprung": "upper_z",
        "unsprung": "lower_z",
        "band_hz": [1.0, 10.0],
        "high_pass_hz": 0.4,
        "law": "arctan_velocity",
        "ground": False,
    }
    assert all(estimate["std"] is None for estimate in result["parameters"].values())
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "--band 1 10 --high-pass 0.4 --law arctan_velocity --no-ground" in html


@pytest.mark.usefixtures("few_figures")
def test_the_result_is_called_after_the_study(field_test, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.group.result_name(Path("runs/study.toml")) == "runs"
    assert cli.group.result_name(Path("study.toml")) == tmp_path.name
    assert cli.group.result_name(Path("runs/autumn.toml")) == "autumn"
    opid("identify", field_test / "study.toml")
    assert [path.name for path in tmp_path.iterdir()] == [f"{field_test.name}_result"]


@pytest.mark.usefixtures("few_figures")
def test_equal_masses_give_ratios_and_status_1(logs, tmp_path):
    done = logs.identify("--mass-change", "0")
    refused(done, "not determined: all runs", "same sprung mass", status=1)
    assert "K2/M2" in done.stdout
    result = json.loads((tmp_path / "result" / "result.json").read_text(encoding="utf-8"))
    assert result["parameters"]["sprung_mass_kg"]["value"] is None
    assert result["ratios"]["stiffness_per_mass"]["value"] == pytest.approx(3.9e5 / 1850, rel=0.1)


@pytest.mark.usefixtures("few_figures")
def test_a_mass_change_of_the_wrong_sign_is_not_determined(logs):
    refused(logs.identify("--mass-change", "220"), "not determined", "sign of the mass change", status=1)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("nothing.toml",), "there is no study file nothing.toml"),
        (("nothing.csv", *CHANNELS), "there is no file nothing.csv"),
        (("nothing.csv",), "name the channels"),
        (("a.toml", "b.csv"), "give one study file"),
        (("a.toml", *CHANNELS), "leave out --sprung"),
        (("a.csv", "b.csv", *CHANNELS), "one mass change for each log after it"),
        ((".",), "is a directory"),
        ((), "Missing argument"),
        (("a.toml", "--lwa", "linear"), "Did you mean"),
        (("a.csv", *CHANNELS, "--mass-change", "light"), "'light' is not a valid float"),
        (("a.toml", "--truth", "none.json"), "cannot read none.json"),
    ],
)
def test_usage_is_explained(arguments, word, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused(opid("identify", *arguments), word)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ("--method classic", "did you mean 'classical'"),
        ("--law arctan_velocty", "did you mean 'arctan_velocity'"),
        ("--band 12 1", "band_hz"),
        ("--band 1 1.1", "lines"),
        ("--high-pass 0.01", "high-pass"),
        ("--sprung upper --unsprung lower_z", "did you mean 'upper_z'"),
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
def test_a_fault_in_a_part_of_a_log_is_left_out_and_said(fault, logs, tmp_path):
    spoil, *words = PARTLY[fault]
    spoil(logs.light)
    done = logs.identify("--law", "arctan_velocity")
    assert done.exit_code == 0, done.stderr
    text = " ".join(done.stdout.split())
    for word in words:
        assert word in text
    findings = json.loads((tmp_path / "result" / "result.json").read_text())["diagnostics"]["runs"][1]["findings"]
    assert any("at fault" in finding["message"] for finding in findings)


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
    done = logs.identify("--sprung", "lower_z", "--unsprung", "upper_z")
    refused(done, "quieter", "exchange sprung and unsprung")


def test_an_unknown_key_of_a_study_names_the_nearest(field_test, tmp_path):
    text = (field_test / "study.toml").read_text().replace("title", "tittle")
    (tmp_path / "study.toml").write_text(text)
    refused(opid("identify", tmp_path / "study.toml"), "'tittle'", "did you mean 'title'")


# ---- places and interruptions ----------------------------------------------------------------------


@pytest.mark.parametrize("command", [("simulate", "taxi"), ("demo", "--out"), ("identify", "study.toml", "--out")])
def test_a_file_where_a_directory_is_needed(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("taken").write_text("mine")
    refused(opid(*command, "taken"), "taken is no directory")
    refused(opid(*command, "taken/deeper"), "taken is no directory")
    assert Path("taken").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def _raise(error):
    def raising(*_, **__):
        raise error

    return raising


@pytest.mark.parametrize(
    ("error", "status", "word"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (PermissionError(13, "Permission denied", "/somewhere"), 2, "/somewhere: Permission denied"),
    ],
)
def test_what_goes_wrong_outside_is_a_sentence(error, status, word, field_test, tmp_path, monkeypatch):
    monkeypatch.setattr(identification, "classical_start", _raise(error))
    done = opid("identify", field_test / "study.toml", "--out", tmp_path / "out")
    refused(done, word, status=status)
    assert not (tmp_path / "out").exists()


def test_a_failure_while_drawing_leaves_no_half_report(field_test, tmp_path, monkeypatch):
    failing = page.Picture("broken", "", "", _raise(RuntimeError("no figure")))
    monkeypatch.setattr(page, "pictures", lambda: (PICTURES[5], failing))
    with pytest.raises(RuntimeError, match="no figure"):
        opid("identify", field_test / "study.toml", "--out", tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
