"""Unsprung mass, tyre and road of gears beside the truth, and worlds in which the assumptions fail.

    python benchmarks/whole_gear.py [--seeds 20] [--first 0] [--jobs 1] [--worlds NAME,...]

A gear is identified from runs of 40 s at 512 Hz, and then its wheel. No seed is dropped. In the first worlds the
assumptions hold: the virtual taxi test (`taxi`: default gear, braking from 18 to 0.5 m/s), the same at a steady 9 m/s
(`steady`), without friction (`linear`), random gears (`random`), eight runs in the place of two (`eight runs`), one run
(`one run`, ratios to the sprung mass), and a road whose waves have random amplitudes as well as random phases, of slope
2 and 2.5 (`gaussian`, `slope 2.5`): the waves of the virtual road all have the amplitude of its class, so that its
spectrum varies less than that of a Gaussian one.

In the others something is wrong: a bump of 30 mm (`bump`), a road of concrete slabs of 5 m (`slabs`), a tyre that is a
quarter stiffer or softer at 5 mm (`hard tyre`), a random force on the airframe that no sensor measures (`pushed`), a
speed that reads 10 % too much (`fast clock`), a braking run that is said to be steady (`hidden braking`), and a mass
change stated 10 % too large (`wrong mass`), which no check can see.

For M1, K1 and C1: error, median / worst, %; how many of the 95 % intervals hold; and the median of the Cramer-Rao
bound, %, and of the stated standard deviation, %.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from estimator import gear_study, identify
from harness import quantiles, read_names, run_all, seeds_parser, table_head, table_row
from scenarios import random_case
from trials import Case

from opid import InputError, NotDeterminedError
from opid.mechanics.laws.law import LINEAR
from opid.signals.recording import Channel, Recording, recording_from_arrays
from opid.suspensions.study import Study
from opid.suspensions.wheel.identification import identify_wheel
from opid.suspensions.wheel.result import WheelIdentification
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.sensors import decimate
from opid.virtual.taxi_tests.taxiing import taxi_test

NAMES = ("unsprung_mass_kg", "tyre_stiffness_n_per_m", "tyre_damping_n_s_per_m")
BRAKING, STEADY = (18.0, 0.5), (9.0, 9.0)
FS, DURATION_S, SUBSTEPS, LEAD_IN_S = 512.0, 40.0, 4, 4.0
FOOTPRINT_M, CLASS_B_M3 = 0.3, 64e-6


@dataclass(frozen=True)
class World:
    """What is recorded.

    Args:
        speed: speed at the beginning and at the end, m/s.
        n_runs: number of runs, heavy and light in turn.
        make: returns a run of a gear: two columns, wheel and airframe; None for the virtual taxi run.
        case: the gear by seed.
        push: rms acceleration of the airframe by an unmeasured force over that by the road.
        stated_speed: speed that is stated at each sample, by the true one.
        stated_change: stated over true mass change.
    """

    speed: tuple[float, float] = BRAKING
    n_runs: int = 2
    make: Callable[[LandingGear, tuple[float, float], np.random.Generator], np.ndarray] | None = None
    case: Callable[[int], Case] = lambda seed: Case(LandingGear())
    push: float = 0.0
    stated_speed: Callable[[np.ndarray], np.ndarray] = lambda speed: speed
    stated_change: float = 1.0


@dataclass(frozen=True)
class Score:
    """What came of one seed: errors, whether intervals hold, stated deviations and bounds of M1, K1 and C1, %."""

    world: str
    seed: int
    error: tuple[float, ...]
    holds: tuple[bool, ...]
    std: tuple[float, ...]
    bound: tuple[float, ...]
    rest: str
    refused: str = ""


# ---- a gear over any road, apart from opid's own simulation ----------------------------------------


def draw_profile(slope: float, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Return a Gaussian road of 2 km, averaged over the footprint, and the distance of its samples, m."""
    step_m, n = 0.02, 100_000
    waves = np.fft.rfftfreq(n, step_m)
    inside = (waves >= 0.02) & (waves <= 8.0)
    density = np.zeros(waves.size)
    density[inside] = CLASS_B_M3 * (waves[inside] / 0.1) ** -slope
    lines = rng.standard_normal((2, waves.size)) * np.sqrt(density / (4 * n * step_m)) * np.sinc(waves * FOOTPRINT_M)
    return np.fft.irfft(n * (lines[0] + 1j * lines[1]), n), step_m


def follow_road(
    gear: LandingGear, speed: tuple[float, float], profile: np.ndarray, step_m: float, stiffening_per_m2: float = 0.0
) -> np.ndarray:
    """Return the accelerations of wheel and airframe at FS, (n, 2): Runge-Kutta steps of the fourth order."""
    fs = FS * SUBSTEPS
    time = np.arange(round((DURATION_S + LEAD_IN_S) * 2 * fs) + 1) / (2 * fs) - LEAD_IN_S
    rolled = np.clip(time, 0.0, None)
    place = speed[0] * np.minimum(time, 0.0) + speed[0] * rolled + 0.5 * (speed[1] - speed[0]) / DURATION_S * rolled**2
    at = (place - place[0] + 1.0) / step_m
    first = at.astype(int)
    height = profile[first] + (at - first) * (profile[first + 1] - profile[first])
    rate = np.gradient(height, 0.5 / fs)
    k1, c1, m1 = gear.tyre_stiffness_n_per_m, gear.tyre_damping_n_s_per_m, gear.unsprung_mass_kg
    k2, c2, m2 = gear.suspension_stiffness_n_per_m, gear.suspension_damping_n_s_per_m, gear.sprung_mass_kg
    amplitude = scale = 0.0
    for values in gear.law.parameters.values():
        amplitude, scale = values["amplitude_n"], values["scale_m_per_s"]

    def accelerate(x1: float, v1: float, x2: float, v2: float, road: float, road_rate: float) -> tuple[float, float]:
        z, v, d = x2 - x1, v2 - v1, x1 - road
        strut = k2 * z + c2 * v + (amplitude * 2 / np.pi * float(np.arctan(v / scale)) if scale else 0.0)
        tyre = k1 * d * (1 + stiffening_per_m2 * d * d) + c1 * (v1 - road_rate)
        return (strut - tyre) / m1, -strut / m2

    x1 = x2 = float(height[0])
    v1 = v2 = 0.0
    dt, found = 1 / fs, np.empty((len(height) // 2, 2))
    roads, rates = height.tolist(), rate.tolist()
    for k in range(len(found)):
        n = 2 * k
        a1, b1 = accelerate(x1, v1, x2, v2, roads[n], rates[n])
        found[k] = a1, b1
        h = 0.5 * dt
        a2, b2 = accelerate(x1 + h * v1, v1 + h * a1, x2 + h * v2, v2 + h * b1, roads[n + 1], rates[n + 1])
        a3, b3 = accelerate(
            x1 + h * v1 + h * h * a1, v1 + h * a2, x2 + h * v2 + h * h * b1, v2 + h * b2, roads[n + 1], rates[n + 1]
        )
        a4, b4 = accelerate(
            x1 + dt * v1 + h * dt * a2,
            v1 + dt * a3,
            x2 + dt * v2 + h * dt * b2,
            v2 + dt * b3,
            roads[n + 2],
            rates[n + 2],
        )
        x1, x2 = x1 + dt * v1 + dt**2 / 6 * (a1 + a2 + a3), x2 + dt * v2 + dt**2 / 6 * (b1 + b2 + b3)
        v1, v2 = v1 + dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4), v2 + dt / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
    return decimate(found, SUBSTEPS)[round(LEAD_IN_S * FS) :]


def roll(
    *, slope: float = 2.0, bump_m: float = 0.0, slab_m: float = 0.0, stiffening_per_m2: float = 0.0
) -> Callable[[LandingGear, tuple[float, float], np.random.Generator], np.ndarray]:
    """Return what makes a run over a Gaussian road, with a bump or slabs if wanted."""

    def make(gear: LandingGear, speed: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
        profile, step_m = draw_profile(slope, rng)
        place = step_m * np.arange(profile.size)
        if bump_m:
            profile = profile + bump_m * np.exp(-(((place - 1.0 - speed[0] * (LEAD_IN_S + 8.0)) / 0.3) ** 2))
        if slab_m:
            profile = profile + 0.004 * ((place / slab_m) % 1.0 - 0.5)
            width = round(FOOTPRINT_M / step_m)
            profile = np.convolve(profile, np.full(width, 1 / width), mode="same")
        return follow_road(gear, speed, profile, step_m, stiffening_per_m2)

    return make


WORLDS: dict[str, World] = {
    "taxi": World(),
    "steady": World(speed=STEADY),
    "linear": World(case=lambda seed: Case(replace(LandingGear(), law=LINEAR))),
    "random": World(case=random_case),
    "eight runs": World(n_runs=8),
    "one run": World(n_runs=1),
    "gaussian": World(make=roll()),
    "slope 2.5": World(make=roll(slope=2.5)),
    "bump": World(speed=STEADY, make=roll(bump_m=0.03)),
    "slabs": World(speed=STEADY, make=roll(slab_m=5.0)),
    "hard tyre": World(make=roll(stiffening_per_m2=0.25 / 0.005**2)),
    "pushed": World(push=0.05),
    "fast clock": World(stated_speed=lambda speed: 1.1 * speed),
    "hidden braking": World(stated_speed=lambda speed: np.full(speed.size, speed.mean())),
    "wrong mass": World(stated_change=1.1),
}


def record(world: World, case: Case, seed: int) -> Study:
    """Return the study of a seed."""
    gear, runs = case.gear, []
    settings = {"speed_m_per_s": world.speed, "duration_s": DURATION_S, **case.run}
    pairs = np.random.default_rng([seed, 19]).spawn((world.n_runs + 1) // 2)
    for k in range(world.n_runs):
        change, rng = -case.mass_removed_kg * (k % 2), pairs[k // 2]
        if world.make is None:
            if k % 2 == 0:
                test = taxi_test(
                    gear, rng=rng, mass_removed_kg=case.mass_removed_kg, pushed_fraction=world.push, **settings
                )
            recording = (test.light if k % 2 else test.heavy).recording
        else:
            samples = world.make(replace(gear, sprung_mass_kg=gear.sprung_mass_kg + change), world.speed, rng)
            samples = samples + 0.005 * rng.standard_normal(samples.shape)
            recording = recording_from_arrays(samples.T, ["lower_z", "upper_z"], fs=FS)
        speed = np.linspace(*world.speed, recording.n_samples)
        runs.append((f"run_{k + 1}", add_speed(recording, world.stated_speed(speed)), world.stated_change * change))
    study = gear_study("wheel", runs, repeatability=0.0)
    return replace(study, runs=tuple(replace(run, speed_m_per_s="speed") for run in study.runs))


def add_speed(recording: Recording, speed: np.ndarray) -> Recording:
    """Return a recording with the channel of a GPS receiver."""
    samples = np.column_stack([recording.samples, speed])
    return replace(recording, samples=samples, channels=(*recording.channels, Channel("speed", "m/s")))


def try_seed(job: tuple[str, int]) -> Score:
    """Identify gear and wheel of a seed in a world."""
    name, seed = job
    world = WORLDS[name]
    case = world.case(seed)
    study, nothing = record(world, case, seed), (np.nan,) * 3
    try:
        found = identify_wheel(study, identify(study, law=case.gear.law.name))
    except (InputError, NotDeterminedError) as error:
        return Score(name, seed, nothing, (), nothing, nothing, "", str(error))
    if found.not_determined:
        return Score(name, seed, nothing, (), nothing, nothing, "", found.not_determined)
    return compare_with_truth(name, seed, found, case.gear)


def compare_with_truth(name: str, seed: int, found: WheelIdentification, gear: LandingGear) -> Score:
    """Return the score of an answer."""
    unit = gear.sprung_mass_kg if found.per_mass else 1.0
    truth: Mapping[str, float] = {each: getattr(gear, each) / unit for each in NAMES}
    given = {each: getattr(found.parameters, each) for each in NAMES}
    bounds = found.bounds or (np.nan,) * 3
    classes = ", ".join(road.road_class for road in found.roads)
    slope, unequal = (
        found.parameters.road_slope,
        [found.stiffer_by_load, found.stiffer_by_force],
    )
    scores = [f"{each.value / each.std:+.1f}" for each in unequal if each.value is not None and each.std]
    return Score(
        name,
        seed,
        tuple(100 * (given[each].value / truth[each] - 1) for each in NAMES),
        tuple(given[each].holds(truth[each]) for each in NAMES),
        tuple(100 * given[each].std / truth[each] for each in NAMES),
        tuple(100 * each for each in bounds),
        f"slope {slope.value:.2f} ({slope.std:.2f}), {classes}, K1 by load and force {' '.join(scores)} std, "
        f"unusual {found.unusual:.2g}",
    )


def describe(score: Score) -> str:
    """Return a line for one seed."""
    head = f"{score.seed:4d} {score.world:14s}"
    if score.refused:
        return f"{head} {score.refused[:200]}"
    cells = (
        f"{short_name} {error:+.1f} ({std:.1f}){'' if holds else '!'}"
        for short_name, error, std, holds in zip(("M1", "K1", "C1"), score.error, score.std, score.holds, strict=True)
    )
    return f"{head} {', '.join(cells)}; {score.rest}"


def main() -> None:
    """Print the table."""
    parser = seeds_parser(__doc__, seeds=20, what="gears")
    parser.add_argument("--worlds", help=f"joined by commas, of {', '.join(WORLDS)}; all where left out")
    given = parser.parse_args()
    worlds = read_names(parser, given.worlds, WORLDS, "world")
    jobs = [(world, given.first + k) for world in worlds for k in range(given.seeds)]
    scores = run_all(try_seed, jobs, describe, processes=given.jobs)
    print("\nerror, median / worst, %; intervals that hold; stated deviation and Cramer-Rao bound, medians, %\n")
    print(table_head("world", "given", *(f"{name} | holds | std | bound" for name in ("M1", "K1", "C1"))))
    for world in worlds:
        own = [each for each in scores if each.world == world]
        told = [each for each in own if not each.refused]
        cells = []
        for k in range(3):
            held = f"{sum(each.holds[k] for each in told)} of {len(told)}" if told else "-"
            medians = (quantiles((getattr(each, name)[k] for each in told), 0.5) for name in ("std", "bound"))
            cells += [quantiles((each.error[k] for each in told), 0.5, 1.0), held, *medians]
        print(table_row(world, f"{len(told)} of {len(own)}", *cells))


if __name__ == "__main__":
    main()
