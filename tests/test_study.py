"""A study: what is read, what is written, and that everything wrong is said at once."""

import tomllib
from datetime import date

import numpy as np
import pytest

from opid.errors import InputError
from opid.signals.logs import write_log
from opid.signals.recording import Channel, Recording, recording_from_arrays
from opid.suspensions.one_gear.study import Run, Study
from opid.suspensions.one_gear.study_file import read_study, study_from_logs, write_study
from opid.suspensions.sensor_facts import IDEAL_PAIR, Leak, SensorFacts, SensorPair


def log(seed, fs=512.0, n_samples=1024, names=("lower_z", "upper_z"), unit="m/s^2"):
    samples = np.random.default_rng(seed).standard_normal((len(names), n_samples))
    return recording_from_arrays(samples, names, fs=fs, unit=unit)


def study(*runs, sprung="upper_z", unsprung="lower_z"):
    runs = runs or (Run("heavy", log(0), 0.0), Run("light", log(1), -220.0))
    return Study("taxi", sprung=sprung, unsprung=unsprung, runs=runs)


STUDY = """\
title = "a taxi test"

[channels]
sprung = "upper_z"
unsprung = "lower_z"

[[runs]]
name = "heavy"
log = "heavy.csv"
mass_change_kg = 0

[[runs]]
name = "light"
log = "logs/light.csv"
mass_change_kg = -220.5
start_s = 0.5
stop_s = 1.5
"""


@pytest.fixture
def read(tmp_path):
    """Write a study beside two logs and read it."""
    (tmp_path / "logs").mkdir()
    names = ("lower_z", "upper_z", "lower_x", "upper_x")
    write_log(log(0, names=names), tmp_path / "heavy.csv")
    write_log(log(1, names=names), tmp_path / "logs" / "light.csv")

    def write_and_read(text):
        (tmp_path / "study.toml").write_text(text)
        return read_study(tmp_path / "study.toml")

    return write_and_read


def test_a_study_file(read, tmp_path):
    taxi = read(STUDY)
    assert (taxi.title, taxi.sprung, taxi.unsprung) == ("a taxi test", "upper_z", "lower_z")
    assert taxi.source == tmp_path / "study.toml"
    assert taxi.fs == 512.0
    assert [(run.name, run.mass_change_kg) for run in taxi.runs] == [("heavy", 0.0), ("light", -220.5)]
    assert taxi.runs[1].recording.start_s == 0.5
    assert taxi.runs[1].recording.n_samples == 512
    unsprung, sprung = taxi.accelerations(taxi.runs[0])
    np.testing.assert_array_equal(unsprung, log(0).channel("lower_z"))
    np.testing.assert_array_equal(sprung, log(0).channel("upper_z"))


def test_the_title_may_be_left_out(read):
    assert read(STUDY.partition("\n")[2]).title == "study"


def test_what_is_written_reads_back(tmp_path):
    taxi = study()
    write_study(taxi, tmp_path / "study.toml")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["heavy.csv", "light.csv", "study.toml"]
    back = read_study(tmp_path / "study.toml")
    assert (back.title, back.sprung, back.unsprung) == (taxi.title, taxi.sprung, taxi.unsprung)
    for run, other in zip(taxi.runs, back.runs, strict=True):
        assert (run.name, run.mass_change_kg) == (other.name, other.mass_change_kg)
        np.testing.assert_array_equal(run.recording.samples, other.recording.samples)
    document = tomllib.loads((tmp_path / "study.toml").read_text())
    assert list(document["runs"][1]) == ["name", "log", "mass_change_kg", "start_s"]
    assert "[[runs]]" in (tmp_path / "study.toml").read_text()


@pytest.mark.parametrize("name", ["a/b", "..", ""])
def test_a_run_that_cannot_name_its_log_is_not_written(tmp_path, name):
    with pytest.raises(InputError, match="cannot name its log"):
        write_study(study(Run(name, log(0), 0.0)), tmp_path / "study.toml")
    assert list(tmp_path.iterdir()) == []


def test_logs_without_a_study_file(tmp_path):
    for name, seed in (("heavy", 0), ("light", 1), ("lighter", 2)):
        write_log(log(seed), tmp_path / f"{name}.csv")
    paths = [tmp_path / f"{name}.csv" for name in ("heavy", "light", "lighter")]
    sides = {"sprung": "upper_z", "unsprung": "lower_z"}
    taxi = study_from_logs(paths, mass_changes_kg=[-100, -220], title="three", **sides)
    assert [(run.name, run.mass_change_kg) for run in taxi.runs] == [
        ("heavy", 0),
        ("light", -100),
        ("lighter", -220),
    ]
    assert (taxi.title, taxi.source) == ("three", None)
    assert len(study_from_logs(paths[:1], mass_changes_kg=[], **sides).runs) == 1
    for logs, changes in ((paths, [-220]), (paths[:1], [0, -220]), ([], [])):
        with pytest.raises(InputError, match="one mass change for each log after it"):
            study_from_logs(logs, mass_changes_kg=changes, **sides)
    with pytest.raises(InputError, match=r"did you mean 'light\.csv'"):
        study_from_logs([paths[0], tmp_path / "ligth.csv"], mass_changes_kg=[-220], **sides)


def test_logs_of_one_name_in_two_directories(tmp_path):
    for directory, seed in (("a", 0), ("b", 1)):
        (tmp_path / directory).mkdir()
        write_log(log(seed), tmp_path / directory / "run.csv")
    paths = [tmp_path / "a" / "run.csv", tmp_path / "b" / "run.csv"]
    taxi = study_from_logs(paths, sprung="upper_z", unsprung="lower_z", mass_changes_kg=[-220])
    assert [run.name for run in taxi.runs] == [str(path) for path in paths]


def test_one_run_or_equal_masses_or_no_run_at_the_reference_are_no_input_error():
    assert len(study(Run("a", log(0), 0.0)).runs) == 1
    assert len(study(Run("a", log(0), 0.0), Run("b", log(1), 0.0)).runs) == 2
    assert len(study(Run("a", log(0), -50.0), Run("b", log(1), -100.0)).runs) == 2


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("title", "tittle", "the study has an unknown key 'tittle' .did you mean 'title'"),
        ("sprung =", "sprong =", r"\[channels\] lacks 'sprung', .*did you mean 'sprong'"),
        ("start_s", "begin_s", r"\[\[runs\]\] number 2 has an unknown key 'begin_s'"),
        ("-220.5", '"-220"', r"'mass_change_kg' in \[\[runs\]\] number 2 is '-220', give a number"),
        ("-220.5", "true", "is True, give a number"),
        ("-220.5", "nan", "the mass change is nan kg"),
        ('"a taxi test"', "7", "'title' in the study is 7, give text in quotes"),
        ("[channels]", "[chanels]", "lacks 'channels'"),
        ('log = "heavy.csv"\n', "", "run 'heavy' has no 'log', and .channels.upper_z. no 'file'"),
        ('title = "a taxi test"', "title = ", r"is no TOML: .*line 1"),
        ("heavy.csv", "havy.csv", "run 'heavy': there is no file .*did you mean 'heavy.csv'"),
        ('"light"', '"heavy"', "2 runs are called 'heavy', rename"),
        ('sprung = "upper_z"', 'sprung = "lower_z"', "sprung and unsprung are both 'lower_z'"),
        ("upper_z", "uper_z", "there is no channel 'uper_z' in .*heavy.csv: did you mean 'upper_z'"),
        ("start_s = 0.5", "start_s = 5", r"run 'light': start_s is 5 and stop_s 1.5: give a stop after"),
        ("start_s = 0.5", "start_s = 1.4", r"run 'light': it has 51 samples .* 256 are needed"),
    ],
)
def test_what_is_wrong_with_a_study_file_is_named(read, tmp_path, old, new, words):
    assert old in STUDY
    with pytest.raises(InputError, match=words) as caught:
        read(STUDY.replace(old, new))
    assert str(caught.value).startswith(str(tmp_path / "study.toml"))
    assert "\n" not in str(caught.value)


def test_two_sections_of_one_log_are_two_runs(read):
    taxi = read(STUDY.replace("logs/light.csv", "heavy.csv"))
    np.testing.assert_array_equal(taxi.runs[1].recording.samples, taxi.runs[0].recording.samples[256:768])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "lacks 'channels', .*lacks 'runs'"),
        (
            "runs = [3]\nchannels = 4",
            r"'channels' in the study is 4, .*\[\[runs\]\] number 1 is 3 where a table",
        ),
        ('runs = []\n[channels]\nsprung = "a"\nunsprung = "b"', "there are no runs"),
    ],
)
def test_a_study_of_nothing(read, text, words):
    with pytest.raises(InputError, match=words):
        read(text)


def test_everything_wrong_is_said_at_once(read):
    with pytest.raises(InputError, match=r"3 faults: \(1\) .*'tittle'.*\(2\) .*'nme'.*\(3\) .*lacks 'name'"):
        read(STUDY.replace("title", "tittle").replace('name = "heavy"', 'nme = "heavy"'))


def test_a_missing_or_unreadable_study(tmp_path):
    with pytest.raises(InputError, match="there is no study file"):
        read_study(tmp_path / "study.toml")
    (tmp_path / "study.toml").write_bytes(b"title = '\xff'")
    with pytest.raises(InputError, match="is not UTF-8 text"):
        read_study(tmp_path / "study.toml")


@pytest.mark.parametrize(
    ("second", "words"),
    [
        (log(1, fs=500.0), "run 'a' has 512 Hz and run 'b' has 500 Hz, resample"),
        (log(1, unit="m"), "run 'b': channel 'upper_z' is in m where an acceleration is needed"),
        (log(1, names=("lower_z", "uper_z")), "run 'b': there is no channel 'upper_z' in its log"),
        (log(1, n_samples=255), "run 'b': it has 255 samples"),
        (log(0), "runs 'a' and 'b' hold the same samples"),
    ],
)
def test_runs_that_do_not_belong_together(second, words):
    with pytest.raises(InputError, match=words):
        study(Run("a", log(0), 0.0), Run("b", second, -220.0))


def test_rates_that_differ_by_the_error_of_a_crystal_are_one():
    assert study(Run("a", log(0), 0.0), Run("b", log(1, fs=512.002), -220.0)).fs == 512.0


# ---- what is known of the sensors ----------------------------------------------------------------

SENSORS = """
[sensors.sprung]
noise_m_per_s2 = 5e-3
gain_tolerance = 0.02
corner_hz = 0.33
corner_tolerance = 0.1
lag_tolerance_s = 1e-3

[sensors.unsprung]
noise_m_per_s2 = 1

[[sensors.leak]]
channel = "lower_x"
into = "sprung"
tolerance = 0.1

[[sensors.leak]]
channel = "upper_x"
"""


def test_facts_of_the_sensors_are_read(read):
    taxi = read(STUDY + SENSORS)
    assert taxi.sensors.sprung == SensorFacts(5e-3, 0.02, 0.33, 0.1, 1e-3)
    assert taxi.sensors.unsprung == SensorFacts(noise_m_per_s2=1)
    # a leak whose side is not said may go into either
    assert taxi.sensors.leaks == (
        Leak("lower_x", "sprung", 0.1),
        Leak("upper_x", "unsprung"),
        Leak("upper_x", "sprung"),
    )


def test_without_facts_the_sensors_are_ideal(read):
    assert read(STUDY).sensors == IDEAL_PAIR
    assert read(STUDY + "[sensors.sprung]").sensors == IDEAL_PAIR


@pytest.mark.parametrize(
    "sensors",
    [
        SensorPair(),
        SensorPair(SensorFacts(noise_m_per_s2=2e-3), SensorFacts(gain_tolerance=0.01)),
        SensorPair(SensorFacts(5e-3, 0.02, 0.33, 0.1, 1e-3), leaks=(Leak("lower_x", "unsprung", 0.02),)),
        SensorPair(leaks=(Leak("lower_x", "unsprung"), Leak("lower_x", "sprung", 0.01))),
    ],
)
def test_facts_that_are_written_read_back(tmp_path, sensors):
    names = ("lower_z", "upper_z", "lower_x")
    runs = (Run("heavy", log(0, names=names), 0.0), Run("light", log(1, names=names), -220.0))
    taxi = Study("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, sensors=sensors)
    write_study(taxi, tmp_path / "study.toml")
    assert read_study(tmp_path / "study.toml").sensors == sensors
    assert ("sensors" in (tmp_path / "study.toml").read_text()) == (sensors != IDEAL_PAIR)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[sensors.sprung]", "[sensors.sprong]", r"\[sensors\] has an unknown key 'sprong' .did you mean 'sprung'"),
        ("gain_tolerance", "gain_tolerence", r"\[sensors.sprung\] has an unknown key .* mean 'gain_tolerance'"),
        ("0.02", '"2 %"', r"'gain_tolerance' in \[sensors.sprung\] is '2 %', give a number"),
        ("into", "to", r"\[\[sensors.leak\]\] number 1 has an unknown key 'to'"),
        ('channel = "upper_x"', "", r"\[\[sensors.leak\]\] number 2 lacks 'channel', give text in quotes"),
        ("[[sensors.leak]]", "[sensors.leak]", "is no TOML"),
        ("0.33", "-0.33", r"\[sensors\] corner_hz is -0.33: give zero or a positive number"),
        ("corner_hz = 0.33\n", "", r"\[sensors\] corner_tolerance is given without corner_hz"),
        ("= 1\n", "= 0\n", r"\[sensors\] noise_m_per_s2 is 0: give a positive number"),
        ('"sprung"\ntol', '"both"\ntol', r"\[sensors\] a leak goes into 'both': give 'sprung' or 'unsprung'"),
        ('channel = "lower_x"', 'channel = "lower_y"', "run 'heavy': there is no channel 'lower_y' in .*heavy.csv"),
    ],
)
def test_what_is_wrong_with_the_sensors_is_named(read, tmp_path, old, new, words):
    assert old in SENSORS
    with pytest.raises(InputError, match=words) as caught:
        read(STUDY + SENSORS.replace(old, new))
    assert str(caught.value).startswith(str(tmp_path / "study.toml"))


def test_a_leak_is_an_acceleration():
    samples = np.random.default_rng(0).standard_normal((3, 1024))
    with_travel = Recording(
        samples.T, fs=512.0, channels=[Channel(*each) for each in (("a", "m/s^2"), ("b", "m/s^2"), ("travel", "m"))]
    )
    sensors = SensorPair(leaks=(Leak("travel", "sprung"),))
    with pytest.raises(InputError, match="channel 'travel' is in m where an acceleration is needed"):
        Study("taxi", sprung="b", unsprung="a", runs=(Run("heavy", with_travel, 0.0),), sensors=sensors)


@pytest.mark.parametrize(
    ("leaks", "said"),
    [
        ((Leak("upper_z", "sprung"),), "the leak 'upper_z' is the sprung channel itself, name another axis"),
        ((Leak("lower_x", "sprung"), Leak("lower_x", "sprung", 0.01)), "stands twice, give it once"),
    ],
)
def test_a_leak_is_another_axis_and_stands_once(leaks, said):
    runs = (Run("heavy", log(0, names=("lower_z", "upper_z", "lower_x")), 0.0),)
    with pytest.raises(InputError, match=said):
        Study("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, sensors=SensorPair(leaks=leaks))


def test_the_date_of_the_runs(read, tmp_path):
    assert read(STUDY).date is None
    taxi = read("date = 2026-03-01\n" + STUDY)
    assert taxi.date == date(2026, 3, 1)
    write_study(taxi, tmp_path / "again.toml")
    assert read_study(tmp_path / "again.toml").date == date(2026, 3, 1)
    with pytest.raises(InputError, match="'date' in the study is '1 March', give a date without quotes"):
        read("date = '1 March'\n" + STUDY)
    with pytest.raises(InputError, match="give the day alone, as 2026-03-01"):
        read("date = 2026-03-01T10:00:00\n" + STUDY)
