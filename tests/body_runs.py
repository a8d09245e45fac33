"""Short virtual runs of an aircraft as a study of a body: 12 s at 128 Hz, a reference and a loaded one."""

from dataclasses import replace
from functools import cache
from unittest import mock

import numpy as np

from opid.signals.recording import recording_from_arrays
from opid.suspensions.candidates import Task
from opid.suspensions.fitting.noise import KnownNoise
from opid.suspensions.fitting.search import Question
from opid.suspensions.settings import Settings
from opid.suspensions.study import MeasuredInterface, PointMass, Run, StructureSettings, Study
from opid.virtual.taxi_tests import taxiing
from opid.virtual.taxi_tests.aircraft import default_aircraft, with_bending
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.road import iso8608_tracks
from opid.virtual.taxi_tests.sensors import Sensor
from opid.virtual.taxi_tests.taxiing import taxi_run, taxi_test

NOISE = 5e-3
PLACES = {"nose": (5.3, 0.2), "left": (0.25, 1.4), "right": (0.25, -1.4)}
"""Of the sensors on the airframe."""
LOADS = (PointMass(500.0, 1.0, 0.2),)
SHORT = {"fs": 128.0, "lowest_step_rate_hz": 1024.0}


@cache
def aircraft(bending_hz=None, ground_n_per_m=0.0):
    """The default aircraft, with a bending mode if a frequency is given, and springs to the ground at every gear."""
    plain = default_aircraft()
    gears = tuple(replace(gear, ground_stiffness_n_per_m=ground_n_per_m) for gear in plain.gears)
    plain = replace(plain, gears=gears)
    return with_bending(plain, frequency_hz=bending_hz) if bending_hz else plain


@cache
def short_runs(
    bending_hz=None, seed=1, loads=LOADS, ground_n_per_m=0.0, pushed_fraction=0.0, duration_s=12.0, fs=SHORT["fs"]
):
    """The reference and the loaded run of the default aircraft on independent tracks."""
    test = taxi_test(
        aircraft(bending_hz, ground_n_per_m),
        rng=np.random.default_rng(seed),
        loadings=[loads],
        duration_s=duration_s,
        coherent_tracks=False,
        pushed_fraction=pushed_fraction,
        sprung_sensors=PLACES,
        lower_sensor=Sensor(noise_m_per_s2=NOISE),
        upper_sensor=Sensor(noise_m_per_s2=NOISE),
        **(SHORT | {"fs": fs}),
    )
    return tuple(
        Run(name, run.recording, loads)
        for name, run, loads in zip(("light", "heavy"), test.runs, test.loadings, strict=True)
    )


@cache
def one_track():
    """A reference and a loaded run in which left and right wheels roll over one track: nothing makes the body roll."""

    def same_on_both_sides(*, lateral_m, **settings):
        return iso8608_tracks(lateral_m=[abs(y) for y in lateral_m], **settings)

    with mock.patch.object(taxiing, "iso8608_tracks", same_on_both_sides):
        return short_runs(loads=(PointMass(500.0, 1.0, 0.0),), fs=256.0)


def interfaces(shift=(0.0, 0.0)):
    """The three gears, with the origin of coordinates elsewhere if so wished."""
    return tuple(
        MeasuredInterface(
            gear.name,
            f"{gear.name}_upper_z",
            f"{gear.name}_lower_z",
            gear.x_m + shift[0],
            gear.y_m + shift[1],
            PLACES[gear.name][0] + shift[0],
            PLACES[gear.name][1] + shift[1],
        )
        for gear in aircraft().gears
    )


def study(kind="rigid_body", *, runs=None, shift=(0.0, 0.0), **settings):
    """The study of the short runs."""
    runs = short_runs() if runs is None else runs
    told = StructureSettings(kind, **{"noise_m_per_s2": NOISE, **settings})
    return Study("short runs", interfaces(shift), runs, told, repeatability=0.0)


@cache
def gears_apart():
    """Three gears that have nothing to do with each other, each under a mass of its own, as if they were an aircraft.

    The loading stands on the gears: there statics and independence agree.
    """
    changes, recordings = (150.0, 200.0, 200.0), []
    for number in range(2):
        rng = np.random.default_rng(20 + number)
        columns = {}
        for gear, change in zip(aircraft().gears, changes, strict=True):
            alone = LandingGear(sprung_mass_kg=LandingGear().sprung_mass_kg + number * change)
            sensor = Sensor(noise_m_per_s2=NOISE)
            run = taxi_run(alone, rng=rng, duration_s=12.0, lower_sensor=sensor, upper_sensor=sensor, **SHORT)
            columns |= {f"{gear.name}_{side}_z": run.recording.channel(f"{side}_z") for side in ("lower", "upper")}
        recordings.append(recording_from_arrays([*columns.values()], [*columns], fs=SHORT["fs"]))
    loading = tuple(
        PointMass(change, gear.x_m, gear.y_m) for gear, change in zip(aircraft().gears, changes, strict=True)
    )
    return Run("light", recordings[0]), Run("heavy", recordings[1], loading)


def arrays_of(given):
    """Accelerations below, on and across the body of each run."""
    sides = [given.channels(side) for side in ("unsprung", "sprung")]
    return [
        (
            *(np.stack([run.recording.channel(name) for name in side], axis=1) for side in sides),
            np.empty((run.recording.n_samples, 0)),
        )
        for run in given.runs
    ]


def task_of(given, kind_of_law):
    """Fit a study of three gears without springs to the ground and faults; laws are searched where none is given."""
    question = Question(kind_of_law is not None, ground=False, faults=False)
    noise = KnownNoise((np.full(3, NOISE), np.full(3, NOISE)))
    return Task(
        study=given,
        arrays=arrays_of(given),
        sensors=given.sensor_facts(),
        noise=noise,
        law=kind_of_law,
        question=question,
        settings=Settings(),
        say=lambda step: None,
        run_names=tuple(run.name for run in given.runs),
        stated_repeatability=given.repeatability,
    )
