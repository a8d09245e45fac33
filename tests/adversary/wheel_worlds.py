"""Worlds of `opid wheel`: runs whose speed, sensors, tyre or road are not what the study says."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from identify_worlds import DURATION_S, FS, NAMES, REMOVED_KG
from judged_worlds import Answer, World
from law_runs import gear_study
from sensing_worlds import Edit, late, scaled

from opid.signals.recording import FloatArray, recording_from_arrays
from opid.suspensions.identification import identify
from opid.suspensions.result import Identification
from opid.suspensions.study import Run, Study
from opid.suspensions.wheel.identification import identify_wheel
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import TaxiTest, taxi_test

GEAR = LandingGear()
STEADY_M_PER_S = 12.0
UNSPRUNG_KG, TYRE_N_PER_M, TYRE_N_S_PER_M = 105.0, 6.2e5, 1.5e3
ROUGHNESS_B_M3 = 64e-6


@cache
def drive(seed: int, road_class: str, footprint_m: float) -> TaxiTest:
    """Return a sound test of the gear at one speed."""
    return taxi_test(
        GEAR,
        rng=np.random.default_rng(seed),
        mass_removed_kg=REMOVED_KG,
        duration_s=DURATION_S,
        fs=FS,
        speed_m_per_s=(STEADY_M_PER_S, STEADY_M_PER_S),
        road_class=road_class,
        footprint_m=footprint_m,
    )


def edit_runs(test: TaxiTest, edits: tuple[Edit, Edit], seed: int) -> Study:
    """Return the study of the runs, of which each is edited in its own way."""
    rng, runs = np.random.default_rng([seed, 19]), []
    for run, edit in zip(test.runs, edits, strict=True):
        samples = edit(*(run.recording.channel(each) for each in NAMES), rng)
        runs.append(recording_from_arrays(samples, NAMES, fs=FS))
    return gear_study(Run("heavy", runs[0]), Run("light", runs[1], -REMOVED_KG))


@cache
def identified(seed: int) -> tuple[Study, Identification]:
    """Return the study of a sound test of the gear, and what was found of its suspension."""
    study = edit_runs(drive(seed, "B", 0.3), (same, same), seed)
    return study, identify(study, law=GEAR.law.name)


def same(below: FloatArray, above: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return a record as it is."""
    return below, above


def wheel_world(
    fails: str,
    edit: Edit | None = None,
    *,
    edits: tuple[Edit, Edit] | None = None,
    told_m_per_s: float | tuple[float, float] = STEADY_M_PER_S,
    road_class: str = "B",
    footprint_m: float = 0.3,
    must_say: str = "",
    unseen: str = "",
) -> World:
    """Return the world of two runs at one speed, whose samples are edited and whose speeds are told.

    Unsprung mass, stiffness and damping of the tyre and, where the road is of class B, its roughness are compared.
    """

    def ask(seed: int) -> Answer:
        if edit is None and edits is None and road_class == "B" and footprint_m == 0.3:
            study, found = identified(seed)
        else:
            study = edit_runs(drive(seed, road_class, footprint_m), edits or (edit or same, edit or same), seed)
            found = identify(study, law=GEAR.law.name)
        speeds = told_m_per_s if isinstance(told_m_per_s, tuple) else (told_m_per_s, told_m_per_s)
        runs = tuple(replace(run, speed_m_per_s=each) for run, each in zip(study.runs, speeds, strict=True))
        wheel = identify_wheel(replace(study, runs=runs), found)
        own, roads = wheel.parameters, wheel.roads if road_class == "B" else ()
        pairs = [
            ("M1", own.unsprung_mass_kg, UNSPRUNG_KG),
            ("K1", own.tyre_stiffness_n_per_m, TYRE_N_PER_M),
            ("C1", own.tyre_damping_n_s_per_m, TYRE_N_S_PER_M),
            ("footprint", own.footprint_m, footprint_m),
            *((f"roughness of {each.run}", each.roughness_m3, ROUGHNESS_B_M3) for each in roads),
        ]
        said = (wheel.not_determined,) if wheel.not_determined else ()
        return Answer(tuple(pairs) if not wheel.per_mass else (), (*said, *wheel.warnings))

    return World("wheel", fails, ask, must_say, unseen, is_slow=True)


def add_bumps(below: FloatArray, above: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return a record of a wheel whose sensor is shaken by blows of 5 g, ten of one sample each."""
    below = below.copy()
    below[rng.integers(0, below.size, 10)] += 50.0 * rng.choice([-1.0, 1.0], 10)
    return below, above


def noisy(below: FloatArray, above: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return a record of sensors with noise of heavy tails, 1 % of the motion below."""
    size = 0.01 * below.std()
    return below + size * rng.standard_t(2.0, below.size), above + size * rng.standard_t(2.0, above.size)


WHEEL_WORLDS = [
    wheel_world("none"),
    wheel_world("speed 3 % off", told_m_per_s=1.03 * STEADY_M_PER_S),
    wheel_world(
        "speed 20 % off",
        told_m_per_s=1.2 * STEADY_M_PER_S,
        unseen="waves that are passed 20 % more quickly are those of a road whose roughness is 17 % less at its slope "
        "of 2, under a footprint that is 20 % longer",
    ),
    wheel_world("speed of one run 20 % off", told_m_per_s=(STEADY_M_PER_S, 1.2 * STEADY_M_PER_S)),
    wheel_world("gain of both sensors 2 % off", scaled(1.02, 1.02)),
    wheel_world("gain of the sensor above 2 % off", scaled(1.0, 1.02)),
    wheel_world("gain of the sensor below 2 % off", scaled(1.02, 1.0)),
    wheel_world("gain of the sensor below 5 % off", scaled(1.05, 1.0)),
    wheel_world("sensor above late by one sample", late),
    wheel_world("sensor above late by one sample in one run", edits=(same, late)),
    wheel_world("blows at the sensor below", add_bumps),
    wheel_world("noise of heavy tails", noisy),
    wheel_world("a longer footprint", footprint_m=0.6),
    wheel_world("a rough road", road_class="D"),
]
