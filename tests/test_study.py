"""A study: everything wrong with it is said at once, whether of one gear or of a body, and which gears are mirrored."""

import math
from dataclasses import replace

import numpy as np
import pytest
from body_runs import interfaces

from opid.errors import InputError
from opid.signals.recording import Channel, Recording
from opid.suspensions.sensor_facts import Leak, SensorFacts, SensorPair
from opid.suspensions.study import (
    BodySensor,
    MeasuredInterface,
    PointMass,
    Run,
    StructureSettings,
    Study,
    study_of_gear,
    symmetric_pairs,
)

GEARS = [f"{gear}_{side}_z" for gear in ("nose", "left", "right") for side in ("lower", "upper")]


def log(seed=0, names=GEARS, n=300, fs=256.0, unit="m/s^2"):
    samples = np.random.default_rng(seed).standard_normal((n, len(names)))
    return Recording(samples, fs=fs, channels=tuple(Channel(name, unit) for name in names))


def gear(name, x_m, y_m, **more):
    given = {"sprung": f"{name}_upper_z", "unsprung": f"{name}_lower_z", **more}
    return MeasuredInterface(name, x_m=x_m, y_m=y_m, **given)


THREE = (gear("nose", 5.0, 0.0), gear("left", 0.0, 1.6), gear("right", 0.0, -1.6))


def made(**changes):
    given = {
        "title": "small",
        "interfaces": THREE,
        "runs": (Run("reference", log()),),
        "structure": StructureSettings("rigid_body"),
    }
    return Study(**{**given, **changes})


def with_left(**more):
    return {"interfaces": (THREE[0], gear("left", **{"x_m": 0.0, "y_m": 1.6, **more}), THREE[2])}


def with_structure(*kind, **settings):
    return {"structure": StructureSettings(*(kind or ("rigid_body",)), **settings)}


def with_runs(*runs):
    return {"runs": runs}


FAULTS = [
    ({"interfaces": ()}, r"there are no interfaces, give one table \[\[interfaces\]\] for each suspension"),
    ({"interfaces": (*THREE, gear("left", 2.0, 2.0, sprung="a", unsprung="b"))}, "2 interfaces are called 'left'"),
    (with_left(sprung="nose_upper_z"), "'nose_upper_z' is sprung of 'nose' and sprung of 'left': each sensor is one"),
    (with_left(sprung="left_lower_z"), "sprung and unsprung are both 'left_lower_z', name the channels of two sensors"),
    (with_left(x_m=math.nan), "interface 'left': x_m is nan, give a place within 200 m"),
    (with_left(y_m=1600.0), "interface 'left': y_m is 1600, give a place within 200 m"),
    (with_left(sensor_y_m=math.inf), "interface 'left': sensor_y_m is inf"),
    (with_left(x_m=0.0, y_m=-1.58), "'left' and 'right' are both at .* two suspensions cannot be at one position"),
    (
        with_left(sensor_x_m=9.0),
        r"sensor at \(9, 1.6\) m, more than 5 m apart: .*, the others in \[\[body_sensors\]\]",
    ),
    ({"sensors": (BodySensor("left_upper_z", 0.0, 0.0),)}, "'left_upper_z' is sprung of 'left' and a further sensor"),
    ({"sensors": (BodySensor("tail", math.nan, 0.0),)}, "the sensor 'tail' is at .* give a place in m"),
    ({"sensors": (BodySensor("tail", 0.0, 0.0),)}, "there is no channel 'tail' in its log"),
    (with_left(facts=SensorPair(leaks=(Leak("tail", "sprung"),))), "there is no channel 'tail' in its log"),
    (
        with_left(facts=SensorPair(leaks=(Leak("left_upper_z", "sprung"),))),
        "the leak 'left_upper_z' is the sprung channel itself, name another axis",
    ),
    (
        with_left(facts=SensorPair(leaks=(Leak("nose_upper_z", "sprung"), Leak("nose_upper_z", "sprung", 0.01)))),
        "the leak of 'nose_upper_z' into the sprung sensor stands twice, give it once",
    ),
    (
        {"sensors": (BodySensor("tail", 0.0, 0.0, leaks=(Leak("nose_upper_z", "unsprung"),)),)},
        "the leak of 'nose_upper_z' into 'tail' on the body is said to be unsprung: give 'sprung'",
    ),
    (
        {"sensors": (BodySensor("tail", 0.0, 0.0, leaks=(Leak("tail", "sprung"),)),)},
        "the leak 'tail' is the sprung channel itself, name another axis",
    ),
    (with_structure("rigid"), "the kind of structure is 'rigid': did you mean 'rigid_body'"),
    (with_structure(position_tolerance_m=-0.01), "position_tolerance_m is -0.01, give 0 to 1"),
    (with_structure(position_tolerance_m=10.0), "position_tolerance_m is 10.0, give 0 to 1, in m"),
    (with_structure(noise_m_per_s2=0.0), "noise_m_per_s2 is 0.0, give a positive number, or leave it out"),
    (
        with_structure(shared=(("left", "rigth"),)),
        "'shared' names 'rigth', which is no interface: did you mean 'right'",
    ),
    (with_structure(shared=(("left", "right"), ("left",))), "'shared' names 'left' twice"),
    (with_left(x_m=2.5, y_m=-0.8), "the interfaces are at .* all on one line: a rigid body in heave"),
    ({"interfaces": THREE[:2]}, "take kind = 'single' or 'pair', or correct the coordinates"),
    (
        {"interfaces": tuple(replace(each, sensor_y_m=0.0) for each in THREE)},
        "the sensors on the body are at .* all on one line",
    ),
    ({"interfaces": THREE[:2], **with_structure("pair")}, "kind is 'pair' and no two interfaces mirror each other"),
    (with_runs(), "there are no runs, give at least one"),
    (with_runs(*[Run("a", log(seed=k)) for k in (0, 1)]), "2 runs are called 'a'"),
    (with_runs(Run("a", log(), (PointMass(math.nan, 0, 0),))), r"run 'a': the loading \(nan, 0, 0\)"),
    (
        with_runs(Run("a", log(), (PointMass(50, 1200.0, 0),))),
        r"the loading of 50 kg is at \(1200, 0\) m, give its place in m",
    ),
    (with_runs(Run("a", log(n=255))), "it has 255 samples .* at least 256 are needed"),
    (with_runs(Run("a", log(names=["nose_lower_z"]))), "run 'a': there is no channel 'left_upper_z' in its"),
    (with_runs(Run("a", log(unit="m"))), "channel 'nose_upper_z' is in m where an acceleration"),
    (
        with_runs(Run("a", log()), Run("b", log(fs=512.0, seed=1))),
        "run 'a' has 256 Hz and run 'b' has 512 Hz, resample one to the rate of the other",
    ),
    (with_runs(Run("a", log()), Run("b", log(), (PointMass(9, 0, 0),))), "runs 'a' and 'b' hold the same samples"),
    (with_runs(Run("a", log()), Run("b", log())), "the same samples from 0 to .* s, name two logs"),
]


@pytest.mark.parametrize(("changes", "match"), FAULTS, ids=[str(k) for k in range(len(FAULTS))])
def test_what_is_wrong_with_a_study_is_said(changes, match):
    with pytest.raises(InputError, match=match):
        made(**changes)


def test_a_sound_study_is_taken_and_all_faults_are_said_at_once():
    assert made().names == ("nose", "left", "right")
    assert made().fs == 256.0
    assert interfaces()[0].sensor_place == (5.3, 0.2)
    with pytest.raises(InputError) as error:
        made(title="two", structure=StructureSettings("rigid", position_tolerance_m=9.0))
    assert "did you mean 'rigid_body'" in str(error.value)
    assert "position_tolerance_m is 9.0" in str(error.value)


# ---- one gear --------------------------------------------------------------------------------------


def of_gear(*runs, **settings):
    return study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, **settings)


def gear_log(seed=0, **settings):
    return log(seed, **({"names": ["lower_z", "upper_z"], "fs": 512.0} | settings))


def test_a_gear_is_a_body_with_one_interface_at_the_origin():
    pair = SensorPair(SensorFacts(noise_m_per_s2=2e-3), SensorFacts(gain_tolerance=0.01))
    taxi = of_gear(Run("heavy", gear_log()), Run("light", gear_log(1), -220.0), sensors=pair)
    assert taxi.is_one_gear
    assert (taxi.interfaces[0].place, taxi.interfaces[0].sensor_place) == ((0.0, 0.0), (0.0, 0.0))
    assert (taxi.sprung, taxi.unsprung) == ("upper_z", "lower_z")
    assert taxi.runs[1].masses == (PointMass(-220.0, 0.0, 0.0),)
    assert [run.mass_change_kg for run in taxi.runs] == [0.0, -220.0]
    title, heavy, light, gear = repr(taxi).splitlines()
    assert title == f"Study: {taxi.title}"
    recording = taxi.runs[0].recording
    assert heavy == f"  run heavy: {recording.duration_s:.4g} s at {recording.fs:g} Hz"
    assert light == f"{heavy.replace('heavy', 'light')}, -220 kg"
    assert gear == "  interface gear: upper_z above, lower_z below"
    facts = taxi.sensor_facts()
    assert (facts.unsprung, facts.sprung, facts.names) == ((pair.unsprung,), (pair.sprung,), ("",))
    unsprung, sprung = taxi.accelerations(taxi.runs[0])
    np.testing.assert_array_equal(unsprung, gear_log().channel("lower_z"))
    np.testing.assert_array_equal(sprung, gear_log().channel("upper_z"))
    # with a further sensor on it, it is a body
    more = replace(
        taxi,
        runs=(Run("heavy", gear_log(names=["lower_z", "upper_z", "tail"])),),
        sensors=(BodySensor("tail", -1.0, 0.0),),
    )
    assert not more.is_one_gear
    assert more.sensor_facts().names == ("gear", "tail")


def test_one_run_or_equal_masses_or_no_run_at_the_reference_are_no_input_error():
    for changes in ((0.0,), (0.0, 0.0), (-50.0, -100.0)):
        runs = [Run(str(k), gear_log(k), change) for k, change in enumerate(changes)]
        assert [run.mass_change_kg for run in of_gear(*runs).runs] == list(changes)


def test_rates_that_differ_by_the_error_of_a_crystal_are_one():
    assert of_gear(Run("a", gear_log()), Run("b", gear_log(1, fs=512.002), -220.0)).fs == 512.0


@pytest.mark.parametrize(
    ("change_kg", "words"),
    [
        (math.nan, "the mass change is nan kg, give a number"),
        # grams for kilograms
        (-220_000.0, "the mass change is -220000 kg, more than any gear carries"),
    ],
)
def test_a_mass_change_that_cannot_be_is_said(change_kg, words):
    with pytest.raises(InputError, match=f"run 'light': {words}"):
        of_gear(Run("heavy", gear_log()), Run("light", gear_log(1), change_kg))


# ---- pairs -----------------------------------------------------------------------------------------


def test_two_gears_of_each_side_are_paired_one_to_one():
    """A tandem 7 cm apart: every gear mirrors two."""
    four = (("front left", 0.07, 1.6), ("left", 0.0, 1.6), ("right", 0.01, -1.6), ("front right", 0.08, -1.6))
    tandem = tuple(gear(name, x, y) for name, x, y in four)
    recording = log(names=[f"{name}_{side}_z" for name, _, _ in four for side in ("upper", "lower")])
    given = made(interfaces=tandem, runs=(Run("reference", recording),), structure=StructureSettings("pair"))
    assert symmetric_pairs(given) == [(0, 3), (1, 2)]
    assert symmetric_pairs(replace(given, interfaces=tandem[:3])) == [(1, 2)]
    # gears on the middle have no mirror
    middle = (gear("front left", 2.0, 0.0), gear("left", -2.0, 0.0))
    assert symmetric_pairs(replace(given, interfaces=middle, structure=StructureSettings())) == []
