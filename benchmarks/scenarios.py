"""What the benchmarks simulate: gears, laws, roads and sensors, nominal or drawn by seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi, sqrt
from typing import Literal

import numpy as np
from drawn_laws import ALL_KINDS, law_of_kind, random_law, random_pair, typical_motion
from trials import Case

from opid.mechanics.laws.law import LINEAR, Law, default_law
from opid.suspensions.sensor_facts import Leak, SensorFacts, SensorPair
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.sensors import Sensor

LawMode = Literal["given", "searched"]
PAPER_GROUND_N_PER_M = 1.67e5
FS = 512.0


@dataclass(frozen=True)
class Scenario:
    """A question asked of many seeds.

    Args:
        case: what is simulated, by seed.
        n_seeds: how many the table asks for; they count from 0 and none is dropped.
        law: whether the law is given to opid or searched.
    """

    case: Callable[[int], Case]
    n_seeds: int
    law: LawMode = "searched"


def random_case(seed: int, *, draw_law: Callable[[np.random.Generator], Law] = random_law, stream: int = 1) -> Case:
    """Draw a gear (1.0 to 2.8 t, 1.4 to 3 Hz, zeta 0.05 to 0.3), its law, road, rate, noise and mass change."""
    rng = np.random.default_rng([seed, stream])
    mass = rng.uniform(1000.0, 2800.0)
    stiffness = mass * (2 * pi * rng.uniform(1.4, 3.0)) ** 2
    damping = 2 * rng.uniform(0.05, 0.3) * sqrt(stiffness * mass)
    heavier = mass / 1850.0
    gear = LandingGear(
        sprung_mass_kg=mass,
        unsprung_mass_kg=105.0 * heavier,
        suspension_stiffness_n_per_m=stiffness,
        suspension_damping_n_s_per_m=damping,
        tyre_stiffness_n_per_m=6.2e5 * heavier,
        law=draw_law(rng),
    )
    sensor = Sensor(noise_m_per_s2=1e-3 * rng.uniform(2.0, 10.0))
    road, fs = str(rng.choice(["A", "B", "C"])), float(rng.choice([256.0, 512.0, 1000.0]))
    settings = {"road_class": road, "fs": fs, "lower_sensor": sensor, "upper_sensor": sensor}
    return Case(gear, mass_removed_kg=mass * rng.uniform(0.08, 0.2), run=settings)


def all_kinds_case(seed: int) -> Case:
    """A gear of `random_case` with a law of any kind: one kind after the other, so that each has its share of seeds."""
    case = random_case(seed, draw_law=lambda rng: LINEAR, stream=3)
    motion = typical_motion(case.gear, road_class=case.run["road_class"])
    drawn = law_of_kind(ALL_KINDS[seed % len(ALL_KINDS)], case.gear, motion, np.random.default_rng([seed, 4]))
    stiffness = 0.0 if drawn.name == "gas_column" else case.gear.suspension_stiffness_n_per_m
    return replace(case, gear=replace(case.gear, law=drawn, suspension_stiffness_n_per_m=stiffness))


def linear_case() -> Case:
    """The nominal gear without friction, both noise levels written out for its Cramer-Rao bound."""
    sensor = Sensor()
    return Case(replace(LandingGear(), law=LINEAR), run={"lower_sensor": sensor, "upper_sensor": sensor})


# what is wrong with the lower and the upper sensor, and what their data sheets say: both the same, with a tolerance
# that holds the fault within one or one and a half standard deviations; the stated corner is 20 % above the lower one
# and 14 % below the upper one
FAULTS = {
    "gain 3 %": ({}, {"gain": 1.03}, {"gain_tolerance": 0.03}),
    "corners 0.33 and 0.462 Hz": (
        {"corner_hz": 0.33},
        {"corner_hz": 0.462},
        {"corner_hz": 0.396, "corner_tolerance": 0.3},
    ),
    "lag 1 sample": ({}, {"lag_s": 1 / FS}, {"lag_tolerance_s": 1 / FS}),
}
FAULTS["all three"] = tuple(
    {key: value for fault in FAULTS.values() for key, value in fault[part].items()} for part in range(3)
)


def sensor_case(fault: str, *, stated: bool) -> Case:
    """The nominal gear with a fault of `FAULTS`, with or without its data sheet in the study."""
    lower, upper, facts = FAULTS[fault]
    run = {"fs": FS, "lower_sensor": Sensor(**lower), "upper_sensor": Sensor(**upper)}
    sensors = SensorPair(SensorFacts(**facts), SensorFacts(**facts)) if stated else SensorPair()
    return Case(LandingGear(), run=run, sensors=sensors)


def leak_case(*, recorded: bool) -> Case:
    """The nominal gear whose sensors let in 3 % of a fore-aft motion as strong as the vertical one."""
    leaking = Sensor(cross_axis=0.03)
    run = {"lower_sensor": leaking, "upper_sensor": leaking, "fore_aft": recorded}
    leaks = (Leak("lower_x", "unsprung"), Leak("upper_x", "sprung")) if recorded else ()
    return Case(LandingGear(), run=run, sensors=SensorPair(leaks=leaks))


def always(case: Case) -> Callable[[int], Case]:
    return lambda seed: case


def _paper(law_of_strut: Law) -> Case:
    return Case(LandingGear(ground_stiffness_n_per_m=PAPER_GROUND_N_PER_M, law=law_of_strut))


SCENARIOS = {
    "nominal": Scenario(always(Case(LandingGear())), 200),
    "linear": Scenario(always(linear_case()), 100, "given"),
    "random": Scenario(random_case, 200),
    "two laws": Scenario(lambda seed: random_case(seed, draw_law=random_pair, stream=2), 40),
    "all kinds": Scenario(all_kinds_case, 100),
    "paper, friction": Scenario(always(_paper(default_law("arctan_velocity"))), 20),
    "paper, travel": Scenario(always(_paper(default_law("arctan_displacement"))), 20),
    **{
        f"{fault}, {'stated' if stated else 'not stated'}": Scenario(always(sensor_case(fault, stated=stated)), 10)
        for fault in FAULTS
        for stated in (True, False)
    },
    "leak, recorded": Scenario(always(leak_case(recorded=True)), 10),
    "leak, not recorded": Scenario(always(leak_case(recorded=False)), 10),
}
