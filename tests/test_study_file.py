"""Study files of one gear and of a body: what is read, what is written, and that everything wrong is said at once."""

import tomllib
from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from made_body import LOADING, PLACES, short_test

from opid.errors import InputError
from opid.provenance import read_file
from opid.signals.logs import write_log
from opid.signals.recording import recording_from_arrays
from opid.signals.spectra import TransmissibilitySettings
from opid.studies.study_file import read_study, write_study
from opid.studies.suspension_study import find_log_readings, read_loading, study_from_logs
from opid.suspensions.sensor_facts import IDEAL, IDEAL_PAIR, Leak, SensorFacts, SensorPair
from opid.suspensions.study import (
    BodySensor,
    MeasuredInterface,
    PointMass,
    Run,
    StructureSettings,
    Study,
    study_of_gear,
)

GEAR_NAMES = ("lower_z", "upper_z", "lower_x", "upper_x")
BODY_NAMES = ("n_low", "n_up", "l_low", "l_up", "r_low", "r_up", "tail")


def log(seed, names=GEAR_NAMES, fs=512.0):
    samples = np.random.default_rng(seed).standard_normal((len(names), 1024))
    return recording_from_arrays(samples, names, fs=fs, unit="m/s^2")


GEAR = """\
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
BODY = """\
title = "an aircraft"
date = 2026-03-01

[channels]
tail_z = {channel = "tail", unit = "g", gain_tolerance = 0.02}
l_up = {noise_m_per_s2 = 4e-3, corner_hz = 0.3, corner_tolerance = 0.1}

[[sensors.leak]]
channel = "tail_z"
into = "n_up"

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
log = "heavy.csv"

[[runs]]
name = "full"
log = "logs/light.csv"
loading = [[300, 1.0, 0.5], [-20.5, 1, -0.5]]
start_s = 0.5
stop_s = 1.5
"""
INLINE = "loading = [[300, 1.0, 0.5], [-20.5, 1, -0.5]]"


@pytest.fixture
def read(tmp_path):
    """Write a study beside two logs and read it."""
    (tmp_path / "logs").mkdir()
    names = (*GEAR_NAMES, *BODY_NAMES)
    write_log(log(0, names=names), tmp_path / "heavy.csv")
    write_log(log(1, names=names), tmp_path / "logs" / "light.csv")

    def write_and_read(text):
        (tmp_path / "study.toml").write_text(text, encoding="utf-8")
        return read_study(tmp_path / "study.toml")

    return write_and_read


def is_as_before(study, path):
    """Write a study, read it, and compare all that it knows."""
    write_study(study, path)
    again = read_study(path)
    for name in ("title", "interfaces", "structure", "sensors", "date"):
        assert getattr(again, name) == getattr(study, name)
    for run, before in zip(again.runs, study.runs, strict=True):
        assert (run.name, run.loading) == (before.name, before.loading)
        assert sorted(run.recording.names) == sorted(before.recording.names)
        for name in run.recording.names:
            np.testing.assert_array_equal(run.recording.channel(name), before.recording.channel(name))
    return path.read_text()


# ---- reading ---------------------------------------------------------------------------------------


def test_a_study_of_one_gear(read, tmp_path):
    taxi = read(GEAR)
    assert (taxi.title, taxi.sprung, taxi.unsprung, taxi.date) == ("a taxi test", "upper_z", "lower_z", None)
    assert taxi.source == tmp_path / "study.toml"
    assert taxi.is_one_gear
    assert taxi.fs == 512.0
    assert [(run.name, run.mass_change_kg) for run in taxi.runs] == [("heavy", 0.0), ("light", -220.5)]
    assert (taxi.runs[1].recording.start_s, taxi.runs[1].recording.n_samples) == (0.5, 512)
    whole = log(0, names=(*GEAR_NAMES, *BODY_NAMES))
    np.testing.assert_allclose(taxi.accelerations(taxi.runs[0])[0], whole.channel("lower_z"), atol=1e-6)
    assert read(GEAR.partition("\n")[2]).title == "study"


def test_a_study_of_a_body(read):
    study = read(BODY)
    assert (study.title, study.date) == ("an aircraft", date(2026, 3, 1))
    assert study.names == ("nose", "left", "right")
    assert study.interfaces[0].sensor_place == (5.3, 0.0)
    assert study.interfaces[1].sensor_place == study.interfaces[1].place == (0.0, 1.6)
    assert study.structure == StructureSettings("rigid_body", (("left", "right"),), 0.01)
    assert study.runs[1].masses == (PointMass(300.0, 1.0, 0.5), PointMass(-20.5, 1.0, -0.5))
    assert [run.mass_change_kg for run in study.runs] == [0.0, 279.5]
    # the channel is called as the study calls it, and means what the study says
    assert set(study.runs[0].recording.names) == {*BODY_NAMES[:6], "tail_z"}
    with pytest.raises(InputError, match=r"'tail_z': it is in m: give quantity = 'displacement' if"):
        read(BODY.replace('unit = "g"', 'unit = "mm"'))


def test_facts_of_the_sensors_of_a_body_stand_with_their_channels(read):
    facts = read(BODY).sensor_facts()
    assert facts.sprung == (IDEAL, SensorFacts(4e-3, 0.0, 0.3, 0.1), IDEAL, SensorFacts(gain_tolerance=0.02))
    assert facts.unsprung == (IDEAL,) * 3
    assert facts.names == ("nose", "left", "right", "tail_z")
    assert facts.leaks == (("sprung", 0, 0.05),)
    # a further sensor on the body may let in an axis, too
    into_tail = BODY.replace('channel = "tail_z"\ninto = "n_up"', 'channel = "n_low"\ninto = "tail_z"')
    assert read(into_tail).sensor_facts().leaks == (("sprung", 3, 0.05),)


def test_two_sections_of_one_log_are_two_runs(read):
    both = GEAR.replace("logs/light.csv", "heavy.csv")
    with pytest.raises(InputError, match=r"hold the same samples from 0\.5 to 1\.5 s, name two logs, or stretches"):
        read(both)
    taxi = read(
        both.replace('name = "heavy"', 'name = "heavy"\nstop_s = 1.0').replace("start_s = 0.5", "start_s = 1.0")
    )
    assert (taxi.runs[0].recording.n_samples, taxi.runs[1].recording.start_s) == (512, 1.0)
    assert not any("from one log" in finding.message for run in taxi.runs for finding in run.findings)


def test_two_stretches_of_one_log_at_one_mass_are_no_two_flights(read):
    both = GEAR.replace("logs/light.csv", "heavy.csv").replace("-220.5", "0")
    taxi = read(
        both.replace('name = "heavy"', 'name = "heavy"\nstop_s = 1.0').replace("start_s = 0.5", "start_s = 1.0")
    )
    told = [[each for each in run.findings if "from one log" in each.message] for run in taxi.runs]
    assert [len(each) for each in told] == [0, 1]
    assert told[1][0].severity == "warning"
    assert "with run 'heavy' and counts as another flight" in told[1][0].message


def test_a_run_may_have_other_channels(read, tmp_path):
    write_log(log(2, names=("N", *BODY_NAMES[1:])), tmp_path / "heavy.csv")
    own = '[[runs]]\nname = "empty"\nlog = "heavy.csv"\nstart_s = 0\nchannels = {n_low = "N"}\n'
    study = read(BODY.replace('[[runs]]\nname = "empty"\nlog = "heavy.csv"\n', own))
    expected = log(2, names=BODY_NAMES).channel("n_low")
    np.testing.assert_allclose(study.runs[0].recording.channel("n_low"), expected, atol=1e-6)


def test_a_log_is_read_as_the_study_of_a_body_says(read, tmp_path):
    read(BODY)
    (reading,) = find_log_readings(tmp_path / "study.toml", tmp_path / "logs" / "light.csv")
    assert reading.runs == ("full",)
    assert reading.channels["tail_z"].unit == "g"
    (tmp_path / "study.toml").write_text(BODY + "loadin = 3\n", encoding="utf-8")
    with pytest.raises(InputError, match="unknown key"):
        find_log_readings(tmp_path / "study.toml", tmp_path / "heavy.csv")


def test_a_loading_table_in_a_file(read, tmp_path):
    rows = (PointMass(300.0, 1.0, 0.5), PointMass(-20.5, 1.0, -0.5))
    tables = {
        "a.csv": "what,y_m,mass_kg,x_m\nfuel,0.5,300,1\n\ncrew, -0.5 ,-20.5,1\n",
        "b.csv": "\ufeffmass_kg;x_m;y_m\n300;1;0,5\n-20,5;1;-0,5\n",
    }
    for name, text in tables.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
        assert read_loading(tmp_path / name) == rows
    study = read(BODY.replace(INLINE, 'loading = "a.csv"'))
    assert study.runs[1].loading == rows
    read_too = {read_file(tmp_path / name) for name in ("study.toml", "a.csv")}
    assert read_too <= set(study.runs[1].recording.files)
    with pytest.raises(InputError, match=r"run 'full': cannot read the loading table .*none\.csv"):
        read(BODY.replace(INLINE, 'loading = "none.csv"'))


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


# ---- what is known of the sensors of one gear ------------------------------------------------------

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


def test_facts_of_the_sensors_of_a_gear_are_read(read):
    facts = read(GEAR + SENSORS).interfaces[0].facts
    assert facts.sprung == SensorFacts(5e-3, 0.02, 0.33, 0.1, 1e-3)
    assert facts.unsprung == SensorFacts(noise_m_per_s2=1)
    # a leak whose side is not said may go into either
    assert facts.leaks == (Leak("lower_x", "sprung", 0.1), Leak("upper_x", "unsprung"), Leak("upper_x", "sprung"))
    for text in (GEAR, GEAR + "[sensors.sprung]"):
        assert read(text).interfaces[0].facts == IDEAL_PAIR


@pytest.mark.parametrize("axis", ["up", "down", "horizontal"])
def test_the_axis_is_read(read, axis):
    assert [each.axis for each in read(GEAR).interfaces + read(BODY).interfaces] == ["up"] * 4
    assert read(f"axis = '{axis}'\n" + GEAR).interfaces[0].axis == axis
    body = read(
        BODY.replace("\ny_m = 0.0\nsensor", f"\ny_m = 0.0\naxis = '{axis}'\nsensor").replace(
            "1.6\n", f"1.6\naxis = '{axis}'\n"
        )
    )
    assert {each.axis for each in body.interfaces} == {axis}


# ---- writing ---------------------------------------------------------------------------------------


def gear_runs():
    return Run("heavy", log(0), 0.0), Run("light", log(1), -220.0)


@pytest.mark.parametrize(
    "sensors",
    [
        IDEAL_PAIR,
        SensorPair(SensorFacts(noise_m_per_s2=2e-3), SensorFacts(gain_tolerance=0.01)),
        SensorPair(SensorFacts(5e-3, 0.02, 0.33, 0.1, 1e-3), leaks=(Leak("lower_x", "unsprung", 0.02),)),
        SensorPair(leaks=(Leak("lower_x", "unsprung"), Leak("lower_x", "sprung", 0.01))),
    ],
)
def test_a_gear_that_is_written_reads_back(tmp_path, sensors):
    taxi = study_of_gear(
        "taxi", sprung="upper_z", unsprung="lower_z", runs=gear_runs(), sensors=sensors, date=date(2026, 3, 1)
    )
    text = is_as_before(taxi, tmp_path / "study.toml")
    assert ("sensors" in text) == (sensors != IDEAL_PAIR)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["heavy.csv", "light.csv", "study.toml"]
    document = tomllib.loads(text)
    # with the keys of today
    assert list(document["runs"][1]) == ["name", "log", "mass_change_kg", "start_s"]
    assert document["channels"]["sprung"] == "upper_z"
    assert "[[runs]]" in text


def test_weighed_masses_and_settings_of_the_transmissibility_are_written_and_read(tmp_path):
    heavy, light = gear_runs()
    runs = (replace(heavy, weighed_mass_kg=1851.5, weighed_tolerance_kg=3.0), replace(light, weighed_mass_kg=1630.0))
    stated = TransmissibilitySettings(window="flattop", overlap=0.3, estimator="H2", block_s=1.0)
    taxi = study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, transmissibility=stated)
    document = tomllib.loads(is_as_before(taxi, tmp_path / "study.toml"))
    assert document["transmissibility"] == vars(stated)
    assert (document["runs"][0]["weighed_mass_kg"], document["runs"][0]["weighed_tolerance_kg"]) == (1851.5, 3.0)
    again = read_study(tmp_path / "study.toml")
    assert again.transmissibility == stated
    assert [run.weighed_mass_kg for run in again.runs] == [1851.5, 1630.0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (GEAR + '[transmissibility]\nwindow = "flattopp"\n', "did you mean 'flattop'"),
        (GEAR + "[transmissibility]\noverlapp = 0.3\n", "did you mean 'overlap'"),
        (GEAR + "weighed_tolerance_kg = 3\n", "weighed_tolerance_kg is stated without weighed_mass_kg"),
        (GEAR + "weighed_mass = 3\n", "did you mean 'weighed_mass_kg'"),
        (BODY + "[transmissibility]\noverlap = 0.3\n", "'transmissibility', which belongs to the study of one gear"),
    ],
)
def test_wrong_weighings_and_spectra_are_named(read, text, words):
    with pytest.raises(InputError, match=words):
        read(text)


def test_a_body_that_is_written_reads_back(tmp_path):
    test = short_test()
    runs = [
        Run(f"run {k}", run.recording, loads)
        for k, (run, loads) in enumerate(zip(test.runs, ((), LOADING), strict=True))
    ]
    pair = SensorPair(SensorFacts(gain_tolerance=0.01), SensorFacts(5e-3), (Leak("tail", "sprung", 0.02),))
    interfaces = [
        MeasuredInterface(name, f"{name}_upper_z", f"{name}_lower_z", x, y, *PLACES[name], facts)
        for (name, x, y), facts in zip(
            (("nose", 5.0, 0.0), ("left", 0.0, 1.6), ("right", 0.0, -1.6)), (pair, IDEAL_PAIR, IDEAL_PAIR), strict=True
        )
    ]
    study = Study(
        "A short test",
        interfaces,
        runs,
        StructureSettings("rigid_body", (("left", "right"),), 0.02, 4e-3),
        (BodySensor("tail", -4.0, 0.0, SensorFacts(corner_hz=0.3)),),
        date(2026, 3, 1),
        repeatability=0.02,
    )
    is_as_before(study, tmp_path / "study.toml")
    with pytest.raises(InputError, match="call it by one plain word"):
        write_study(replace(study, runs=(replace(study.runs[0], name="a/b"),)), tmp_path / "study.toml")


def test_a_gear_somewhere_on_its_body_is_written_as_an_interface(tmp_path):
    taxi = study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=gear_runs())
    for changed in (
        replace(taxi, interfaces=(replace(taxi.interfaces[0], x_m=2.0, name="nose"),)),
        replace(taxi, structure=StructureSettings("single", noise_m_per_s2=5e-3)),
    ):
        assert "[[interfaces]]" in is_as_before(changed, tmp_path / "study.toml")


@pytest.mark.parametrize("axis", ["up", "down", "horizontal"])
def test_the_axis_is_written(tmp_path, axis):
    taxi = study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=gear_runs(), axis=axis, repeatability=0.03)
    document = tomllib.loads(is_as_before(taxi, tmp_path / "study.toml"))
    # with the keys of today where nothing else is said
    assert document.get("axis", "up") == axis
    assert ("axis" in document, "interfaces" in document) == (axis != "up", False)
    here = replace(taxi, interfaces=(replace(taxi.interfaces[0], x_m=2.0, name="nose"),))
    document = tomllib.loads(is_as_before(here, tmp_path / "study.toml"))
    assert "axis" not in document
    assert document["interfaces"][0].get("axis", "up") == axis
    assert ("axis" in document["interfaces"][0]) == (axis != "up")


@pytest.mark.parametrize("name", ["a/b", "..", ""])
def test_a_run_that_cannot_name_its_log_is_not_written(tmp_path, name):
    taxi = study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=(Run(name, log(0)),))
    with pytest.raises(InputError, match="cannot name its log"):
        write_study(taxi, tmp_path / "study.toml")
    assert list(tmp_path.iterdir()) == []


# ---- logs without a study file ---------------------------------------------------------------------


def test_logs_without_a_study_file(tmp_path):
    for name, seed in (("heavy", 0), ("light", 1), ("lighter", 2)):
        write_log(log(seed), tmp_path / f"{name}.csv")
    paths = [tmp_path / f"{name}.csv" for name in ("heavy", "light", "lighter")]
    sides = {"sprung": "upper_z", "unsprung": "lower_z"}
    taxi = study_from_logs(paths, mass_changes_kg=[-100, -220], title="three", **sides)
    assert [(run.name, run.mass_change_kg) for run in taxi.runs] == [("heavy", 0), ("light", -100), ("lighter", -220)]
    assert (taxi.title, taxi.source) == ("three", None)
    assert len(study_from_logs(paths[:1], mass_changes_kg=[], **sides).runs) == 1
    for logs, changes in ((paths, [-220]), (paths[:1], [0, -220]), ([], [])):
        with pytest.raises(InputError, match="one mass change for each log after it"):
            study_from_logs(logs, mass_changes_kg=changes, **sides)
    known = {"axis": "up", "piston_area_m2": 0.004, "repeatability": 0.0}
    told = study_from_logs(paths[:2], mass_changes_kg=[-220], **known, **sides)
    assert (told.interfaces[0].axis, told.interfaces[0].piston_area_m2, told.repeatability) == tuple(known.values())
    for wrong, words in (
        ({"axis": "sideways"}, "the axis is 'sideways', give one of 'up', 'down', 'horizontal'"),
        ({"repeatability": "1%"}, r"the repeatability is '1%', .* a number from 0 to 0.2 \(0.01 for 1 %\)"),
        ({"repeatability": True}, "the repeatability is True"),
        ({"repeatability": float("nan")}, "the repeatability is nan"),
        ({"piston_area_m2": "40 cm2"}, "the piston_area_m2 is '40 cm2', give the area"),
        ({"piston_area_m2": 0}, "the piston_area_m2 is 0, give the area"),
        ({"piston_area_m2": 4000}, r"at most 1 m\^2 \(4000 mm\^2 are 0.004 m\^2\)"),
        ({"axis": "Up"}, "the axis is 'Up', did you mean 'up'?"),
    ):
        with pytest.raises(InputError, match=words):
            study_from_logs(paths[:2], mass_changes_kg=[-220], **sides, **wrong)
    for logs, changes, words in (
        (paths[:2], -220, "mass_changes_kg is -220: give a list"),
        (paths[:2], "-220", "mass_changes_kg is '-220': give a list"),
        (paths[:2], [None], "a mass change is None: give a number, kg"),
        (str(paths[0]), [], "paths is .*: give a list"),
        ([paths[0], None], [-220], "a log is None: give the name of its file"),
        ([paths[0], paths[0]], [-220], "heavy.csv is given twice: each run has a log of its own"),
    ):
        with pytest.raises(InputError, match=words):
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


# ---- what is wrong ---------------------------------------------------------------------------------

GEAR_FAULTS = [
    ("title", "tittle", "the study has an unknown key 'tittle' .did you mean 'title'"),
    ("sprung =", "sprong =", r"\[channels\] lacks 'sprung', .*did you mean 'sprung' by 'sprong'"),
    ("sprung =", "sprnug =", r"\[channels\] lacks 'sprung', .*did you mean 'sprung' by 'sprnug'"),
    (
        '"upper_z"',
        '{ name = "upper_z" }',
        r"\[channels.sprung\] has 'name', write `channel`",
    ),
    ("start_s", "begin_s", r"\[\[runs\]\] 'light' has an unknown key 'begin_s'"),
    ("-220.5", '"-220"', r"'mass_change_kg' in \[\[runs\]\] 'light' is '-220', give a number"),
    ("-220.5", "true", "is True, give a number"),
    ("-220.5", "nan", r"'mass_change_kg' in .* is nan, give a number"),
    ('"a taxi test"', "7", "'title' in the study is 7, give text in quotes"),
    ("[channels]", "[chanels]", r"^[^;]*the study has an unknown key 'chanels' .did you mean 'channels'..$"),
    ("mass_change_kg = -220.5", "mas_change_kg = -220.5", r"^[^;]*'mas_change_kg' .did you mean 'mass_change_kg'..$"),
    ("[channels]", "[structure]\nkind = 'single'\n[channels]", r"the study has 'structure', which belongs to a body"),
    (
        "start_s",
        "loading = [[1, 2, 3]]\nstart_s",
        r"\[\[runs\]\] 'light' has 'loading', which belongs to a body on several",
    ),
    ('log = "heavy.csv"\n', "", "run 'heavy' has no 'log', and .channels.lower_z. no 'file'"),
    ('title = "a taxi test"', "title = ", r"is no TOML: .*line 1"),
    ("heavy.csv", "havy.csv", "run 'heavy': there is no file .*did you mean 'heavy.csv'"),
    ('"light"', '"heavy"', "2 runs are called 'heavy', rename"),
    ('sprung = "upper_z"', 'sprung = "lower_z"', "sprung and unsprung are both 'lower_z'"),
    ("upper_z", "uper_z", "there is no channel 'uper_z' in .*heavy.csv: did you mean 'upper_z'"),
    ("start_s = 0.5", "start_s = 5", r"run 'light': start_s is 5 and stop_s 1.5: give a stop after"),
    ("start_s = 0.5", "start_s = 1.4", r"run 'light': it has 51 samples .* 256 are needed"),
    (
        "[channels]",
        "[channels]\nx = {channel = 'upper_x', corner_hz = 1}",
        r"give it in .*unsprung\]",
    ),
    ("title", "date = '1 March'\ntitle", "'date' in the study is '1 March', give a date without quotes"),
    (
        "title",
        "date = 2026-03-01T10:00:00\ntitle",
        "is 2026-03-01 10:00:00, give a date without quotes and without a time",
    ),
    ("title", "axis = 'upwards'\ntitle", "'axis' in the study is 'upwards', give one of 'up', 'down', 'horizontal'$"),
    ("title", "axis = 1\ntitle", "'axis' in the study is 1, give one of 'up', 'down', 'horizontal'$"),
]
SENSOR_FAULTS = [
    ("[sensors.sprung]", "[sensors.sprong]", r"\[sensors\] has an unknown key 'sprong' .did you mean 'sprung'"),
    (
        "[sensors.sprung]",
        "[sensors.upper_z]",
        r"^[^;]*\[sensors\] has 'upper_z', call it by its side, \[sensors.sprung\] or",
    ),
    ("gain_tolerance", "gain_tolerence", r"\[sensors.sprung\] has an unknown key .* mean 'gain_tolerance'"),
    ("0.02", '"2 %"', r"'gain_tolerance' in \[sensors.sprung\] is '2 %', give a number"),
    ("into", "to", r"\[\[sensors.leak\]\] number 1 has an unknown key 'to'"),
    ('sprung = "upper_z"', 'sprung = ["upper_z"]', r"'sprung' in \[channels\] is \['upper_z'\], give the name of a"),
    ('channel = "upper_x"', "", r"\[\[sensors.leak\]\] number 2 lacks 'channel', give text in quotes"),
    ("[[sensors.leak]]", "[sensors.leak]", "is no TOML"),
    ("0.33", "-0.33", r"\[sensors.sprung\]: corner_hz is -0.33: give zero or a positive number"),
    ("corner_hz = 0.33\n", "", r"\[sensors.sprung\]: corner_tolerance is given without corner_hz"),
    ("= 1\n", "= 0\n", r"\[sensors.unsprung\]: noise_m_per_s2 is 0: give a positive number"),
    (
        '"sprung"\ntol',
        '"both"\ntol',
        r"'into' in \[\[sensors.leak\]\] number 1 is 'both', give one of 'sprung', 'unsprung'",
    ),
    ('channel = "lower_x"', 'channel = "lower_y"', "run 'heavy': there is no channel 'lower_y' in .*heavy.csv"),
]
BODY_FAULTS = [
    ("x_m = 5\n", "x_m = 5\nsensor_xm = 5.3\n", "key 'sensor_xm' \\(did you mean 'sensor_x_m'"),
    ("[structure]", "[structures]", "unknown key 'structures' \\(did you mean 'structure'"),
    ("[[sensors.leak]]", "[[sensrs.leak]]", "unknown key 'sensrs' .did you mean 'sensors'..$"),
    ('unsprung = "n_low"\n', "", "'nose' lacks 'unsprung', give the channel below"),
    ('sprung = "r_up"\nun', "un", "'right' lacks 'sprung', give the channel on the body"),
    ("start_s", "mass_change_kg = 280\nstart_s", "say where that mass is, too: loading = .*280, x_m, y_m"),
    ('[["left", "right"]]', '["left", "right"]', "'shared' in .structure. holds 'left', give a list of lists of names"),
    ('sprung = "r_up"\nunsprung = "r_low"\n', "", "'right' lacks 'sprung', .*'right' lacks 'unsprung'"),
    ('log = "heavy.csv"', 'log = "heavy.csv"\nmass_change_kg = 99', "loading = \\[\\[99, x_m, y_m\\]\\] in its place"),
    (
        "[[300, 1.0, 0.5], [-20.5, 1, -0.5]]",
        "[300, 1.0, 0.5]",
        "'loading' in .*'full' holds 300, give rows .*mass_kg, x_m, y_m",
    ),
    ("[-20.5, 1, -0.5]", "[-20.5, 1]", "'loading' in .* holds \\[-20.5, 1\\], give rows"),
    ('[["left", "right"]]', '[["left"]]', "give two names or more"),
    ("2026-03-01", "2026-03-01T12:00:00", "without a time, as 2026-03-01"),
    ("x_m = 5\n", 'x_m = "front"\n', "'x_m' in .* is 'front', give a number"),
    ('"rigid_body"', '"rigid"', "kind of structure is 'rigid': did you mean 'rigid_body'"),
    ('"r_up"', '"r_upp"', "there is no channel 'r_upp'"),
    ('channel = "tail", unit', 'chanel = "tail", unit', "did you mean 'channel'"),
    ('into = "n_up"', 'into = "n_uup"', r"leaks into 'n_uup', which is no sensor .* on the body: did you mean 'n_up'"),
    (
        "[structure]",
        "[sensors.sprung]\ngain_tolerance = 0.1\n[structure]",
        r"\[sensors\] has 'sprung', what is known of a sensor of a body stands in \[channels.NAME\]$",
    ),
    ("[[interfaces]]", "[[interfacs]]", r"key 'interfacs' .did you mean 'interfaces'..$"),
    ("[structure]", "[sensors.r_up]\ngain_tolerance = 0.1\n[structure]", r"'r_up', what is known of .* in \[channels"),
    ("[[sensors.leak]]", "[[sensors.leaks]]", r"\[sensors\] has an unknown key 'leaks' .did you mean 'leak'"),
    ('unsprung = "n_low"', 'unsprng = "n_low"', r"^[^;]*unknown key 'unsprng' .did you mean 'unsprung'..$"),
    ("[[body_sensors]]", "[[sensors]]", "TOML|call further sensors on the body"),
    (
        "l_up = {",
        "l_upp = {channel = 'l_up', ",
        r"'noise_m_per_s2' stands in \[channels.l_upp\], give it in .*of a sensor",
    ),
    ("corner_tolerance = 0.1", "corner_tolerance = 5", r"corner_tolerance is 5: it is relative"),
    ('log = "heavy.csv"\n', "", "run 'empty' has no 'log'"),
    ("[channels]", "fs_hz = 0\n[channels]", "give a positive rate"),
    ("x_m = 5\n", "x_m = 5\naxis = 'z'\n", "'axis' in .*'nose' is 'z', give one of 'up', 'down', 'horizontal'$"),
    (
        "x_m = 5\n",
        "x_m = 5\naxis = true\n",
        r"'axis' in \[\[interfaces\]\] 'nose' is True, give one of 'up', 'down', 'horizontal'$",
    ),
    (
        "x_m = 5\n",
        "x_m = 5\naxis = 'down'\n",
        "the interfaces of one body have the axes 'up' and 'down', give all of them the same$",
    ),
    ("[channels]", "axis = 'down'\n[channels]", r"'axis', which belongs to one gear: give it in each .*interfaces"),
]
FAULTS = [(GEAR, *each) for each in GEAR_FAULTS]
FAULTS += [(GEAR + SENSORS, *each) for each in SENSOR_FAULTS]
FAULTS += [(BODY, *each) for each in BODY_FAULTS]


@pytest.mark.parametrize(("study", "old", "new", "words"), FAULTS, ids=range(len(FAULTS)))
def test_what_is_wrong_with_a_study_file_is_named(read, tmp_path, study, old, new, words):
    assert old in study
    with pytest.raises(InputError, match=words) as caught:
        read(study.replace(old, new, 1) if study is BODY else study.replace(old, new))
    assert str(caught.value).startswith(str(tmp_path / "study.toml"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "lacks 'channels', .*lacks 'runs'"),
        ("runs = [3]\nchannels = 4", r"\[\[runs\]\] number 1 is 3 where a table .*'channels' in the study is 4"),
        ('runs = []\n[channels]\nsprung = "a"\nunsprung = "b"', "there are no runs"),
        ("interfaces = []\nruns = []", "there are no interfaces"),
    ],
)
def test_a_study_of_nothing(read, text, words):
    with pytest.raises(InputError, match=words):
        read(text)


def test_everything_wrong_is_said_at_once(read):
    with pytest.raises(InputError, match=r"3 faults: \(1\) .*'tittle'.*\(2\) .*'nme'.*\(3\) .*lacks 'name'"):
        read(GEAR.replace("title", "tittle").replace('name = "heavy"', 'nme = "heavy"').replace('name = "light"', ""))
    text = BODY
    for old, new, _ in (BODY_FAULTS[k] for k in (0, 2, 3, 4, 5)):
        text = text.replace(old, new, 1)
    with pytest.raises(InputError, match=r"5 faults: \(1\).*\(5\)"):
        read(text)


def test_a_missing_or_unreadable_study(tmp_path):
    with pytest.raises(InputError, match="there is no study file"):
        read_study(tmp_path / "study.toml")
    (tmp_path / "study.toml").write_bytes(b"title = '\xff'")
    with pytest.raises(InputError, match=r"there is no study file .*studdy.toml: did you mean 'study.toml'"):
        read_study(tmp_path / "studdy.toml")
    with pytest.raises(InputError, match="is not UTF-8 text"):
        read_study(tmp_path / "study.toml")


def test_a_speed_is_named_by_its_key_or_as_the_log_calls_it(tmp_path):
    samples = np.random.default_rng(0).standard_normal((3, 4096)) + np.array([[0.0], [0.0], [30.0]])
    units = ("m/s^2", "m/s^2", "m/s")
    write_log(recording_from_arrays(samples, ["low", "up", "GPS speed"], fs=128.0, unit=units), tmp_path / "run.csv")
    for name in ("speed", "GPS speed"):
        text = f'[[runs]]\nname = "run"\nlog = "run.csv"\nmass_change_kg = 0\nstart_s = 0\nspeed_m_per_s = "{name}"\n'
        channels = '[channels]\nunsprung = "low"\nsprung = "up"\nspeed = "GPS speed"\n'
        (tmp_path / "study.toml").write_text(channels + text)
        run = read_study(tmp_path / "study.toml").runs[0]
        assert run.recording.channel(run.speed_m_per_s).mean() == pytest.approx(30.0, abs=0.1)
