"""Worlds of `opid sense`: a further record of a gear that is another one, loaded or recorded otherwise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
from identify_worlds import DURATION_S, FS, NAMES, REMOVED_KG, jitter
from judged_worlds import Answer, World
from law_runs import gear_study

from opid.estimate import Estimate
from opid.mechanics.memory import force_along
from opid.signals.recording import FloatArray, Recording, recording_from_arrays
from opid.suspensions.identification import identify
from opid.suspensions.result import Identification
from opid.suspensions.sensing.result import Sensing
from opid.suspensions.sensing.virtual_sensors import sense
from opid.suspensions.study import Run, Study
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import TaxiRun, taxi_run, taxi_test

GEAR = LandingGear()
DAMPING = GEAR.suspension_damping_n_s_per_m
Edit = Callable[[FloatArray, FloatArray, np.random.Generator], tuple[FloatArray, FloatArray]]


@cache
def identified(seed: int) -> tuple[Study, Identification]:
    """Return the study of a sound test of the gear, and what was found."""
    test = taxi_test(GEAR, rng=np.random.default_rng(seed), mass_removed_kg=REMOVED_KG, duration_s=DURATION_S, fs=FS)
    study = gear_study(Run("heavy", test.heavy.recording), Run("light", test.light.recording, -REMOVED_KG))
    return study, identify(study, law=GEAR.law.name)


def sensing_world(
    fails: str,
    edit: Edit = lambda below, above, rng: (below, above),
    *,
    gear: LandingGear = GEAR,
    pushed: float = 0.0,
    must_say: str = "",
    unseen: str = "",
) -> World:
    """Return the world of a further record, of `gear`, whose samples are edited; `pushed` is that of `taxi_run`.

    The strut force, the travel and the acceleration of the body are compared where the true ones are largest.
    """

    def ask(seed: int) -> Answer:
        study, found = identified(seed)
        rng = np.random.default_rng([seed, 13])
        run = taxi_run(gear, rng=rng, duration_s=DURATION_S, fs=FS, pushed_fraction=pushed)
        samples = edit(*(run.recording.channel(each) for each in NAMES), rng)
        record: Recording = recording_from_arrays(samples, NAMES, fs=FS)
        return compare(sense(study, found, Run("further", record)), run)

    return World("sense", fails, ask, must_say, unseen)


def compare(found: Sensing, run: TaxiRun) -> Answer:
    """Return what is told at the largest true values."""
    gear = run.airframe.gears[0]
    travel, velocity = run.truth.channel("travel"), run.truth.channel("travel_velocity")
    force = -gear.suspension_stiffness_n_per_m * travel - gear.suspension_damping_n_s_per_m * velocity
    force = force - force_along(gear.law, travel, velocity, run.recording.fs)
    pairs = []
    for name, true in (("strut_force", force), ("travel", travel), ("acceleration", run.truth.channel("upper_z"))):
        sensor = found.sensor(name)
        at = int(np.argmax(np.abs(true[: sensor.value.size])))
        pairs.append((name, Estimate.normal(float(sensor.value[at]), float(sensor.std[at])), float(true[at])))
    return Answer(tuple(pairs), found.warnings)


def scaled(below: float, above: float) -> Edit:
    """Return the edit that multiplies the readings."""
    return lambda lower, upper, rng: (below * lower, above * upper)


def stiffened(factor: float) -> LandingGear:
    """Return the gear with a stiffer spring."""
    return replace(GEAR, suspension_stiffness_n_per_m=factor * GEAR.suspension_stiffness_n_per_m)


def late(below: FloatArray, above: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return a record whose sensor above is late by one sample."""
    return below, np.concatenate([above[:1], above[:-1]])


SENSING_WORLDS = [
    sensing_world("none"),
    sensing_world("spring 10 % stiffer", gear=stiffened(1.1)),
    sensing_world("spring 30 % stiffer", gear=stiffened(1.3)),
    sensing_world("mass 10 % larger than stated", gear=replace(GEAR, sprung_mass_kg=1.1 * GEAR.sprung_mass_kg)),
    sensing_world(
        "a tenth of the damping",
        gear=replace(GEAR, suspension_damping_n_s_per_m=0.1 * DAMPING),
    ),
    sensing_world("an unmeasured force on the body", pushed=0.05),
    sensing_world("gain of the sensor above 5 % off", scaled(1.0, 1.05)),
    sensing_world("gain of the sensor below 5 % off", scaled(1.05, 1.0)),
    sensing_world("gain of both 2 % off", scaled(1.02, 1.02)),
    sensing_world("gain of both 5 % off", scaled(1.05, 1.05), must_say="moves the parameters"),
    sensing_world("sign of the sensor above", scaled(1.0, -1.0), must_say="check it"),
    sensing_world(
        "sign of both sensors",
        scaled(-1.0, -1.0),
        unseen="a gear whose law is odd answers the motion in the other direction by the force in the other direction",
    ),
    sensing_world("sensors above and below exchanged", lambda below, above, rng: (above, below), must_say="check it"),
    sensing_world("sensor above late by one sample", late),
    sensing_world("jittered samples", jitter),
]
