"""Three-axis sensors mounted at any angle: the angle that gravity tells, the mass, and where the assumptions fail.

Both sensors of a random gear are turned by any angle up to 180 degrees; a fore-aft and a sideways motion of 0.3 of the
vertical one leak in. The log begins with 6 s of rest unless the world says otherwise; the zeros of the axes are drawn
with 0.02 m/s^2. Logs and a study file are written and read, as a user does; no key states how the sensors are mounted.

`python benchmarks/orientation.py --seeds 10` runs the world "any angle", `--worlds all` also those in which an
assumption fails. The law is given; `--search` searches it. A seed of 20 s takes about half a minute.
"""

import argparse
import os
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

# before numpy is loaded
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from harness import Answer, compare, quantiles, read_names, run_all, seeds_parser, share, short, table_head, table_row
from scenarios import random_case
from scipy.spatial.transform import Rotation
from trials import Case

import opid
from opid.signals.logs import write_log
from opid.virtual.taxi_tests.sensors import Mounting
from opid.virtual.taxi_tests.taxiing import TaxiTest, taxi_test

ZERO_M_PER_S2, REST_S, PITCH_RAD_S2_PER_M = 0.02, 6.0, 0.017
SIDES = {"unsprung": "lower", "sprung": "upper"}
Mountings = Mapping[str, Mounting]


@dataclass(frozen=True)
class World:
    """What differs from two sensors that are fastened once and at rest before each run.

    Args:
        standstill_s: rest at the beginning of each log, s.
        later: mountings of the second run, from those of the first.
        first: mountings of both runs, from those that were drawn.
        pitch_rad_s2_per_m: pitch of the airframe per deceleration.
        keys: lines of the table of a channel, by its side.
        corner_hz: corner of an AC coupling, Hz.
        fore_aft: rms of the motion in each direction across, over the vertical one.
    """

    standstill_s: float = REST_S
    later: Callable[[Mountings], Mountings] = dict
    first: Callable[[Mountings], Mountings] = dict
    pitch_rad_s2_per_m: float = 0.0
    keys: Callable[[Mounting, np.random.Generator], str] = lambda mounting, rng: ""
    corner_hz: float = 0.0
    fore_aft: float = 0.3


def change_all(**fields: object) -> Callable[[Mountings], Mountings]:
    return lambda mountings: {name: replace(each, **fields) for name, each in mountings.items()}


def bend(mountings: Mountings) -> Mountings:
    """Bend the brackets by 1 degree, in different directions."""
    bends = Rotation.from_rotvec(np.radians([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    return {
        name: replace(each, turn_rad=tuple((one * Rotation.from_rotvec(each.turn_rad)).as_rotvec()))
        for (name, each), one in zip(mountings.items(), bends, strict=True)
    }


def state_coupling(mounting: Mounting, rng: np.random.Generator) -> str:
    """State corner and vertical of an AC-coupled sensor, the latter as it is seen by eye, 2 degrees off."""
    seen = Rotation.from_rotvec(np.radians(2.0) * rng.standard_normal(3)).apply(mounting.vertical)
    return f"vertical = {seen.tolist()}\ncorner_hz = 0.33\ncorner_tolerance = 0.2\n"


GYROSCOPE_RAD_PER_S = 0.002
WORLDS = {
    "any angle": World(),
    "upright, no motion across": World(first=change_all(turn_rad=(0.0, 0.0, 0.0)), fore_aft=0.0),
    "no rest": World(standstill_s=0.0),
    "bent by 1 degree between the runs": World(later=bend),
    "AC-coupled, vertical seen by eye": World(corner_hz=0.33, keys=state_coupling),
    "gain of one axis 2 % off": World(first=change_all(gains=(1.02, 1.0, 1.0))),
    "slips by 2 degrees in each run": World(first=change_all(slip_rad=(np.radians(2.0), 0.0, 0.0))),
    "pitches with a gyroscope": World(
        pitch_rad_s2_per_m=PITCH_RAD_S2_PER_M, first=change_all(gyroscope_rad_per_s=GYROSCOPE_RAD_PER_S)
    ),
    "pitches without a gyroscope": World(pitch_rad_s2_per_m=PITCH_RAD_S2_PER_M),
}


class Job(NamedTuple):
    """One seed of a world."""

    world: str
    seed: int
    duration_s: float
    fs: float
    search: bool


class Outcome(NamedTuple):
    """What came of it: angles between the vertical and what was found, degrees, and the mass in %.

    Args:
        job: the seed.
        angles_deg: by gravity, of each sensor and run.
        fitted_deg: with what the fit says leaks in, of each sensor; empty where each run has leaks of its own.
        within: whether those by gravity are within their intervals.
        mass: the mass beside its truth.
        words: a refusal, or the number of warnings.
    """

    job: Job
    angles_deg: tuple[float, ...]
    fitted_deg: tuple[float, ...]
    within: tuple[bool, ...]
    mass: Answer
    words: str


def draw_mountings(rng: np.random.Generator) -> Mountings:
    """Draw how both sensors are mounted: any rotation, and the zeros of the axes."""
    return {
        f"{stem}_z": Mounting(
            tuple(Rotation.from_quat(rng.standard_normal(4)).as_rotvec()), tuple(rng.normal(0.0, ZERO_M_PER_S2, 3))
        )
        for stem in SIDES.values()
    }


def simulate(case: Case, job: Job, mountings: Mountings, world: World) -> TaxiTest:
    """Return the test with the same mountings in both runs."""
    sensors = {key: replace(case.run[key], corner_hz=world.corner_hz) for key in ("lower_sensor", "upper_sensor")}
    return taxi_test(
        case.gear,
        rng=np.random.default_rng(job.seed),
        mass_removed_kg=case.mass_removed_kg,
        road_class=case.run["road_class"],
        duration_s=job.duration_s,
        fs=job.fs,
        fore_aft_ratio=world.fore_aft,
        mountings=mountings,
        standstill_s=world.standstill_s,
        pitch_rad_s2_per_m=world.pitch_rad_s2_per_m,
        **sensors,
    )


def write_study(folder: Path, test: TaxiTest, mountings: Mountings, world: World, rng: np.random.Generator) -> Path:
    """Write the logs and the study file of a user who knows nothing of how the sensors are mounted."""
    text = "repeatability = 0.0\n"  # what is simulated is the same strut twice
    for side, stem in SIDES.items():
        text += f"\n[channels.{side}]\naxes = {[f'{stem}_{axis}' for axis in 'xyz']}\n"
        mounting = mountings[f"{stem}_z"]
        if mounting.gyroscope_rad_per_s:
            text += f"gyroscope = {[f'{stem}_rate_{axis}' for axis in 'xyz']}\n"
        text += world.keys(mounting, rng)
    for name, run, change_kg in (("heavy", test.heavy, 0.0), ("light", test.light, test.mass_change_kg)):
        write_log(run.recording, folder / f"{name}.csv")
        text += f'\n[[runs]]\nname = "{name}"\nlog = "{name}.csv"\nmass_change_kg = {change_kg}\n'
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


def run(job: Job) -> Outcome:
    """Simulate, write, read and identify one seed."""
    world, case, rng = WORLDS[job.world], random_case(job.seed), np.random.default_rng([job.seed, 7])
    mountings = world.first(draw_mountings(rng))
    test, later = simulate(case, job, mountings, world), world.later(mountings)
    if later != mountings:
        test = replace(test, runs=(test.heavy, simulate(case, job, later, world).light))
    with tempfile.TemporaryDirectory() as folder:
        study = opid.read_study(write_study(Path(folder), test, mountings, world, rng))
        angles, within = [], []
        for one, own in zip(study.runs, (mountings, later), strict=True):
            for side, stem in SIDES.items():
                found, true = one.orientations[side], own[f"{stem}_z"].vertical
                angle = np.arccos(np.clip(np.dot(found.vertical, true), -1.0, 1.0))
                angles.append(float(np.degrees(angle)))
                # 95 % of the angles in two directions lie within 2.45 standard deviations.
                within.append(bool(angle < 2.45 * found.std_rad))
        moved = sum(finding.code == "sensor_moved" for one in study.runs for finding in one.findings)
        try:
            result = opid.identify(study, law=None if job.search else case.gear.law.name)
        except (opid.NotDeterminedError, opid.InputError) as error:
            return Outcome(job, tuple(angles), (), tuple(within), compare(None, 1.0), f"refused: {error}")
    words = f"{len(result.warnings)} warnings, {moved} of a slip"
    mass = compare(result.parameters.sprung_mass_kg, case.gear.sprung_mass_kg)
    return Outcome(job, tuple(angles), find_fitted_angles(result, mountings), tuple(within), mass, words)


def find_fitted_angles(result: opid.suspensions.Identification, mountings: Mountings) -> tuple[float, ...]:
    """Return the angle of each sensor between the vertical and the found one, corrected by the leaks of the fit."""
    study, fit = result.study, result.evidence[0].fit
    if len(study.leaks()) != 2 * len(SIDES):
        return ()
    found = []
    for number, (side, stem) in enumerate(SIDES.items()):
        up, *across = study.runs[0].orientations[side].directions
        for k, one in enumerate(across):
            up = up - fit.value(f"leak[{2 * number + k}]") * one
        cosine = up @ mountings[f"{stem}_z"].vertical / np.linalg.norm(up)
        found.append(float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))))
    return tuple(found)


def describe(outcome: Outcome) -> str:
    """Return the row of a seed."""
    mass = outcome.mass
    numbers = (f"{mass.error:+.3f}", short(mass.half_width)) if np.isfinite(mass.error) else ("-", "-")
    worst = f"{max(outcome.angles_deg):.3f}"
    return table_row(outcome.job.world, outcome.job.seed, worst, *numbers, mass.holds, outcome.words)


def main() -> None:
    """Run the seeds of the worlds and print both tables."""
    parser = seeds_parser(__doc__, seeds=4, what="gears")
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument(
        "--worlds", help=f"'all', or some of {', '.join(WORLDS)}, joined by commas", default="any angle"
    )
    parser.add_argument("--duration", type=float, default=20.0, help="length of a run, s")
    parser.add_argument("--fs", type=float, default=256.0, help="rate, Hz")
    parser.add_argument("--search", action="store_true", help="search the law")
    given = parser.parse_args()
    names = list(WORLDS)
    if given.worlds != "all":
        # A name of a world may hold a comma.
        names = [name for name in names if name in given.worlds] or read_names(parser, given.worlds, names, "world")
    seeds = range(given.first, given.first + given.seeds)
    jobs = [Job(name, seed, given.duration, given.fs, given.search) for name in names for seed in seeds]
    print(table_head("world", "seed", "largest angle [deg]", "mass error [%]", "half width [%]", "holds", "answer"))
    outcomes = run_all(run, jobs, describe, processes=given.jobs)
    print()
    print(
        table_head("world", "angle, median / worst [deg]", "angle within", "mass, median / worst [%]", "holds", "given")
    )
    for name in names:
        own = [each for each in outcomes if each.job.world == name]
        print(
            table_row(
                name,
                quantiles([angle for each in own for angle in each.angles_deg], 0.5, 1.0),
                share([flag for each in own for flag in each.within]),
                quantiles([angle for each in own for angle in each.fitted_deg], 0.5, 1.0),
                quantiles([each.mass.error for each in own], 0.5, 1.0),
                share([each.mass.holds for each in own]),
                f"{sum(np.isfinite(each.mass.error) for each in own)} of {len(own)}",
            )
        )


if __name__ == "__main__":
    main()
