"""The study file of a body: what is read, what is written, and that everything wrong is said at once."""

from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from made_body import LOADING, PLACES, short_test

from opid.errors import InputError
from opid.report.body_field_test import study_of_aircraft
from opid.signals.logs import write_log
from opid.signals.recording import recording_from_arrays
from opid.suspensions.one_gear.study_file import read_study
from opid.suspensions.study import PointMass
from opid.suspensions.study_file import body_log_readings, read_body_study, write_body_study
from opid.suspensions.study_tables import read_loading

NAMES = ("n_low", "n_up", "l_low", "l_up", "r_low", "r_up", "tail")
STUDY = """\
title = "an aircraft"
date = 2026-03-01

[channels]
tail_z = {channel = "tail", unit = "g"}

[[interfaces]]
name = "nose"
sprung = "n_up"
unsprung = "n_low"
x_m = 5
y_m = 0.0
sensor_x_m = 5.3

[[interfaces]]
name = "left"
sprung = "l_up"
unsprung = "l_low"
x_m = 0.0
y_m = 1.6

[[interfaces]]
name = "right"
sprung = "r_up"
unsprung = "r_low"
x_m = 0.0
y_m = -1.6

[[body_sensors]]
channel = "tail_z"
x_m = -4.0
y_m = 0.0

[structure]
kind = "rigid_body"
shared = [["left", "right"]]
position_tolerance_m = 0.01

[[runs]]
name = "empty"
log = "empty.csv"

[[runs]]
name = "full"
log = "logs/full.csv"
loading = [[300, 1.0, 0.5], [-20.5, 1, -0.5]]
start_s = 0.5
stop_s = 2.5
"""


def log(seed, names=NAMES):
    samples = np.random.default_rng(seed).standard_normal((len(names), 1024))
    return recording_from_arrays(samples, names, fs=256.0, unit="m/s^2")


@pytest.fixture
def read(tmp_path):
    """Write a study beside two logs and read it."""
    (tmp_path / "logs").mkdir()
    write_log(log(0), tmp_path / "empty.csv")
    write_log(log(1), tmp_path / "logs" / "full.csv")

    def write_and_read(text, reader=read_body_study):
        (tmp_path / "study.toml").write_text(text, encoding="utf-8")
        return reader(tmp_path / "study.toml")

    return write_and_read


def test_a_study_file(read, tmp_path):
    study = read(STUDY)
    assert (study.title, study.date, study.source) == ("an aircraft", date(2026, 3, 1), tmp_path / "study.toml")
    assert study.names == ("nose", "left", "right")
    assert study.interfaces[0].sensor_place == (5.3, 0.0)
    assert study.interfaces[1].sensor_place == study.interfaces[1].place == (0.0, 1.6)
    assert (study.structure.kind, study.structure.shared) == ("rigid_body", (("left", "right"),))
    assert (study.structure.position_tolerance_m, study.structure.noise_m_per_s2) == (0.01, None)
    assert [run.mass_change_kg for run in study.runs] == [0.0, 279.5]
    assert study.runs[1].loading == (PointMass(300.0, 1.0, 0.5), PointMass(-20.5, 1.0, -0.5))
    assert (study.runs[1].recording.start_s, study.runs[1].recording.n_samples) == (0.5, 512)
    # the channel is called as the study calls it, and means what the study says
    recording = study.runs[0].recording
    assert set(recording.names) == {*NAMES[:6], "tail_z"}
    with pytest.raises(InputError, match="'tail_z' is in m where an acceleration is needed"):
        read(STUDY.replace('unit = "g"', 'unit = "mm"'))


def test_a_loading_table_in_a_file(read, tmp_path):
    rows = (PointMass(300.0, 1.0, 0.5), PointMass(-20.5, 1.0, -0.5))
    tables = {
        "a.csv": "what,y_m,mass_kg,x_m\nfuel,0.5,300,1\n\ncrew, -0.5 ,-20.5,1\n",
        "b.csv": "\ufeffmass_kg;x_m;y_m\n300;1;0,5\n-20,5;1;-0,5\n",
    }
    for name, text in tables.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
        assert read_loading(tmp_path / name) == rows
    inline = "loading = [[300, 1.0, 0.5], [-20.5, 1, -0.5]]"
    assert read(STUDY.replace(inline, 'loading = "a.csv"')).runs[1].loading == rows


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mass_kg,x,y_m\n1,2,3\n", "lacks the column 'x_m' \\(did you mean"),
        ("mass_kg,x_m,y_m\n1,,3\n4,5,six\n", "'' for x_m in row 2, give a number; it has 'six' for y_m in row 3"),
        ("mass_kg,x_m,y_m\n", "no row below its head"),
        ("", "lacks the column 'mass_kg'"),
        ("mass_kg,x_m,y_m\nnan,1,2\n", "'nan' for mass_kg"),
    ],
)
def test_a_loading_table_at_fault(tmp_path, text, words):
    (tmp_path / "loading.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        read_loading(tmp_path / "loading.csv")


def test_a_loading_table_that_is_not_there(read):
    with pytest.raises(InputError, match=r"run 'full': cannot read the loading table .*none\.csv"):
        read(STUDY.replace("loading = [[300, 1.0, 0.5], [-20.5, 1, -0.5]]", 'loading = "none.csv"'))


FAULTS = {
    "an unknown key": (
        "x_m = 5\n",
        "x_m = 5\nsensor_xm = 5.3\n",
        "key 'sensor_xm' \\(did you mean 'sensor_x_m'",
    ),
    "an unknown table": ("[structure]", "[structures]", "unknown key 'structures' \\(did you mean 'structure'"),
    "no unsprung side": ('unsprung = "n_low"\n', "", "'nose' has 'sprung' without 'unsprung', give the channel below"),
    "no sprung side": (
        'sprung = "l_up"\nun',
        "un",
        "'left' has 'unsprung' without 'sprung', give the",
    ),
    "neither side": ('sprung = "r_up"\nunsprung = "r_low"\n', "", "'right' has neither"),
    "loading and mass change": ("start_s", "mass_change_kg = 280\nstart_s", "leave out 'mass_change_kg'"),
    "a mass without a place": (
        'log = "empty.csv"',
        'log = "empty.csv"\nmass_change_kg = 99',
        "loading = \\[\\[99, x_m, y_m\\]\\] in its place",
    ),
    "a flat loading": (
        "[[300, 1.0, 0.5], [-20.5, 1, -0.5]]",
        "[300, 1.0, 0.5]",
        "a list of rows: \\[\\[300, 1, 0.5",
    ),
    "a short row": (
        "[-20.5, 1, -0.5]",
        "[-20.5, 1]",
        "row 2 of 'loading' in .* is \\[-20.5, 1\\]",
    ),
    "a flat group": ('[["left", "right"]]', '["left", "right"]', 'give a list of groups: \\[\\["left", "right"\\]\\]'),
    "a group of one": ('[["left", "right"]]', '[["left"]]', "give two names or more"),
    "a date in quotes": ("2026-03-01", '"1 March"', "a date without quotes"),
    "a date with a time": ("2026-03-01", "2026-03-01T12:00:00", "give the day alone, as 2026-03-01"),
    "a place in words": ("x_m = 5\n", 'x_m = "front"\n', "'x_m' in .* is 'front', give a number"),
    "an unknown kind": ('"rigid_body"', '"rigid"', "kind of structure is 'rigid': did you mean 'rigid_body'"),
    "an unknown name": ('[["left", "right"]]', '[["left", "rigth"]]', "names 'rigth', which is no interface"),
    "no such channel": ('"l_up"', '"l_upp"', "there is no channel 'l_upp'"),
    "a bad channel": ('tail_z = {channel = "tail", unit = "g"}', "tail_z = {chanel = 1}", "did you mean 'channel'"),
    "one line": ("x_m = 5\n", "x_m = 0\n", "one line or less"),
    "sensors of the study of one gear": (
        "[structure]",
        "[sensors.sprung]\nnoise_m_per_s2 = 0.01\n[structure]",
        r"\[sensors\] belongs to the study of one gear, state the noise .* as noise_m_per_s2 in \[structure\]",
    ),
    "sensors without body": ("[[body_sensors]]", "[[sensors]]", r"call further sensors on the body \[\[body_sensors"),
    "no log": ('log = "empty.csv"\n', "", "run 'empty' has no 'log'"),
    "a rate of nothing": ("[channels]", "fs_hz = 0\n[channels]", "give a positive rate"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_sentences(read, fault):
    old, new, words = FAULTS[fault]
    assert old in STUDY
    with pytest.raises(InputError, match=words):
        read(STUDY.replace(old, new, 1))


def test_everything_wrong_is_said_at_once(read):
    text = STUDY
    for fault in ("an unknown key", "no unsprung side", "no sprung side", "loading and mass change", "a flat group"):
        old, new, _ = FAULTS[fault]
        text = text.replace(old, new, 1)
    with pytest.raises(InputError, match=r"5 faults: \(1\).*\(5\)"):
        read(text)


def test_a_run_may_have_other_channels(read, tmp_path):
    write_log(log(2, names=("N", *NAMES[1:])), tmp_path / "empty.csv")
    own = '[[runs]]\nname = "empty"\nlog = "empty.csv"\nstart_s = 0\nchannels = {n_low = "N"}\n'
    study = read(STUDY.replace('[[runs]]\nname = "empty"\nlog = "empty.csv"\n', own))
    expected = log(2).channel("n_low")
    np.testing.assert_allclose(study.runs[0].recording.channel("n_low"), expected, atol=1e-6)


def test_the_other_reader_says_which_one_to_take(read):
    with pytest.raises(InputError, match="read it with read_body_study"):
        read(STUDY, reader=read_study)


def test_a_log_is_read_as_the_study_of_a_body_says(read, tmp_path):
    read(STUDY)
    (reading,) = body_log_readings(tmp_path / "study.toml", tmp_path / "logs" / "full.csv")
    assert reading.runs == ("full",)
    assert reading.channels["tail_z"].unit == "g"
    (tmp_path / "study.toml").write_text(STUDY + "loadin = 3\n", encoding="utf-8")
    with pytest.raises(InputError, match="unknown key"):
        body_log_readings(tmp_path / "study.toml", tmp_path / "empty.csv")


def test_what_is_written_is_read_back(tmp_path):
    study = study_of_aircraft(
        short_test(), title="A short test", shared=[("left", "right")], position_tolerance_m=0.01, day=date(2026, 3, 1)
    )
    assert [sensor.channel for sensor in study.sensors] == ["tail"]
    assert [interface.sensor_place for interface in study.interfaces] == list(PLACES.values())
    write_body_study(study, tmp_path / "study.toml")
    again = read_body_study(tmp_path / "study.toml")
    for name in ("title", "interfaces", "structure", "sensors", "date"):
        assert getattr(again, name) == getattr(study, name)
    for run, before in zip(again.runs, study.runs, strict=True):
        assert (run.name, run.loading) == (before.name, before.loading)
        assert sorted(run.recording.names) == sorted(before.recording.names)
        for name in run.recording.names:
            np.testing.assert_allclose(run.recording.channel(name), before.recording.channel(name), atol=1e-8)
    assert again.runs[1].loading == tuple(PointMass(each.mass_kg, each.x_m, each.y_m) for each in LOADING)
    with pytest.raises(InputError, match="call it by one plain word"):
        write_body_study(replace(study, runs=(replace(study.runs[0], name="a/b"),)), tmp_path / "study.toml")
