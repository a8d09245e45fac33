"""Virtual sensors beside the truth: random gears of each kind of law, and worlds in which their assumptions fail.

    python benchmarks/virtual_sensors.py [--seeds 34] [--first 0] [--jobs 1] [--worlds NAME,...] [--law searched]

A gear is identified from two runs of 40 s, and its virtual sensors run along a third one over another runway
(`third`) and along the first run of the study (`run`). No seed is dropped. The other worlds are records in which
something is wrong: a random force on the body that no sensor measures (`pushed`), another strut (`stiffer`, 30 %, and
`slightly stiffer`, 5 %), another mass than stated (`heavier`, 10 %), a recorder that clips the largest 0.5 % of the
readings of the body (`clipped`), and a sensor on the body that reads 5 % too much (`gain`). The seeds of `--scenario`
draw one kind of law after the other.

For each quantity: rms error over rms truth, %, and the fraction of samples that the 95 % band holds, %.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from estimator import identify
from harness import read_names, run_all, seeds_parser, table_head, table_row
from scenarios import SCENARIOS
from trials import Case, simulated, study_of

from opid import Estimate, InputError, NotDeterminedError
from opid.mechanics.memory import force_along
from opid.signals.recording import Recording
from opid.suspensions.sensing.result import Sensing
from opid.suspensions.sensing.settings import SensingSettings
from opid.suspensions.sensing.virtual_sensors import sense
from opid.suspensions.study import Run
from opid.virtual.taxi_tests.sensors import Sensor
from opid.virtual.taxi_tests.taxiing import TaxiRun, taxi_run

EXACT = SensingSettings(gain_tolerance=0.0)
"""The sensors are calibrated exactly but in the world `gain`."""

QUANTITIES = ("strut_force", "tyre_force", "travel", "acceleration")
BAND_STD = 1.96


@dataclass(frozen=True)
class Score:
    """What came of one record.

    Args:
        world: what was recorded.
        seed: of gear, runways and noise.
        law: kinds of the true law.
        error: rms error of each quantity over its rms, %; NaN where nothing is given.
        held: samples that the band holds, %.
        width: mean half width of the band over the rms, %.
        refused: why nothing is given; empty if something is.
    """

    world: str
    seed: int
    law: str
    error: tuple[float, ...]
    held: tuple[float, ...]
    width: tuple[float, ...]
    refused: str = ""


def drive_again(case: Case, seed: int, *, push: float = 0.0, stiffer: float = 1.0, heavier: float = 1.0) -> TaxiRun:
    """Return a third run of a gear, over a runway of its own."""
    gear = case.gear
    law = replace(gear.law, terms=tuple(replace(each) for each in gear.law.terms)).scaled(stiffer)
    changed = replace(
        gear,
        suspension_stiffness_n_per_m=stiffer * gear.suspension_stiffness_n_per_m,
        sprung_mass_kg=heavier * gear.sprung_mass_kg,
        law=law,
    )
    return taxi_run(changed, rng=np.random.default_rng([seed, 77]), pushed_fraction=push, **case.run)


def clip(run: TaxiRun) -> TaxiRun:
    """Return a run whose recorder clips the largest 0.5 % of the readings of the body."""
    samples = run.recording.samples.copy()
    column = run.recording.index("upper_z")
    limit = float(np.quantile(np.abs(samples[:, column]), 0.995))
    samples[:, column] = np.clip(samples[:, column], -limit, limit)
    return replace(run, recording=replace(run.recording, samples=samples))


def misread(case: Case, seed: int) -> TaxiRun:
    """Return a run whose sensor on the body reads 5 % too much."""
    faulty = replace(case, run=case.run | {"upper_sensor": replace(case.run.get("upper_sensor", Sensor()), gain=1.05)})
    return drive_again(faulty, seed)


WORLDS: dict[str, Callable[[Case, int], TaxiRun] | None] = {
    "run": None,
    "third": drive_again,
    "pushed": lambda case, seed: drive_again(case, seed, push=0.05),
    "stiffer": lambda case, seed: drive_again(case, seed, stiffer=1.3),
    "slightly stiffer": lambda case, seed: drive_again(case, seed, stiffer=1.05),
    "heavier": lambda case, seed: drive_again(case, seed, heavier=1.1),
    "clipped": lambda case, seed: clip(drive_again(case, seed)),
    "gain": misread,
}


def find_truth(run: TaxiRun, n: int) -> dict[str, np.ndarray]:
    """Return the true values of the first n samples."""
    gear = run.airframe.gears[0]
    z, v = run.truth.channel("travel"), run.truth.channel("travel_velocity")
    force = -gear.suspension_stiffness_n_per_m * z - gear.suspension_damping_n_s_per_m * v
    force = force - force_along(gear.law, z, v, run.recording.fs)
    weight = 9.80665 * (run.airframe.mass_kg + gear.unsprung_mass_kg)
    tyre = force + weight + gear.unsprung_mass_kg * run.truth.channel("lower_z")
    every = {"strut_force": force, "tyre_force": tyre, "travel": z, "acceleration": run.truth.channel("upper_z")}
    return {name: values[:n] for name, values in every.items()}


def compare_with_truth(found: Sensing, run: TaxiRun) -> tuple[list[float], list[float], list[float]]:
    """Return error, samples held and width of the band of each quantity, %."""
    truth = find_truth(run, len(found.sensors[0].value))
    rows: tuple[list[float], list[float], list[float]] = ([], [], [])
    for name in QUANTITIES:
        sensor, true = found.sensor(name), truth[name]
        if name == "tyre_force" and "strut_load" not in found.to_recording().names:
            true = true - 9.80665 * (run.airframe.mass_kg + run.airframe.gears[0].unsprung_mass_kg)
        # The force of a tyre is that with the weight.
        size, error = float(np.sqrt(np.mean(true**2))), sensor.value - true
        rows[0].append(100 * float(np.sqrt(np.mean(error**2))) / size)
        rows[1].append(100 * float(np.mean(np.abs(error) <= BAND_STD * sensor.std)))
        rows[2].append(100 * BAND_STD * float(np.mean(sensor.std)) / size)
    return rows


def try_seed(job: tuple[str, int, tuple[str, ...], bool]) -> list[Score]:
    """Identify the gear of a seed, and run its virtual sensors along the record of each world."""
    scenario, seed, worlds, is_searched = job
    case = SCENARIOS[scenario].case(seed)
    test, scores = simulated(case, seed), []
    study = study_of(test, case.sensors)
    nothing = (np.nan,) * len(QUANTITIES)
    try:
        result = identify(study, law=None if is_searched else case.gear.law.name)
    except (InputError, NotDeterminedError) as error:
        return [Score(world, seed, case.gear.law.name, nothing, nothing, nothing, str(error)) for world in worlds]
    for world in worlds:
        make = WORLDS[world]
        run = test.heavy if make is None else make(case, seed)
        unsprung = Estimate.normal(case.gear.unsprung_mass_kg, 0.0)
        record: Recording = run.recording
        try:
            found = sense(
                study,
                result,
                study.runs[0].name if make is None else Run(world, record),
                unsprung_mass_kg=unsprung,
                settings=EXACT,
            )
        except (InputError, NotDeterminedError) as error:
            scores.append(Score(world, seed, case.gear.law.name, nothing, nothing, nothing, str(error)))
            continue
        if found.per_mass:
            why = "forces are per unit of mass"
            scores.append(Score(world, seed, case.gear.law.name, nothing, nothing, nothing, why))
            continue
        scores.append(Score(world, seed, case.gear.law.name, *map(tuple, compare_with_truth(found, run))))
    return scores


def describe(scores: list[Score]) -> str:
    """Return a line for each record."""
    lines = []
    for each in scores:
        if each.refused:
            lines.append(f"{each.seed:4d} {each.world:17s} {each.law}: {each.refused[:110]}")
            continue
        cells = (
            f"{name} {error:.2f} ({width:.2f}) {held:.0f}"
            for name, error, width, held in zip(QUANTITIES, each.error, each.width, each.held, strict=True)
        )
        lines.append(f"{each.seed:4d} {each.world:17s} {each.law}: {', '.join(cells)}")
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    parser = seeds_parser(__doc__, seeds=34, what="gears")
    parser.add_argument("--scenario", default="all kinds", choices=sorted(SCENARIOS), help="what is drawn")
    parser.add_argument("--worlds", help=f"joined by commas, of {', '.join(WORLDS)}; all where left out")
    parser.add_argument("--law", choices=("given", "searched"), default="given")
    given = parser.parse_args()
    worlds = tuple(read_names(parser, given.worlds, WORLDS, "world"))
    jobs = [(given.scenario, given.first + k, worlds, given.law == "searched") for k in range(given.seeds)]
    scores = [each for one in run_all(try_seed, jobs, describe, processes=given.jobs) for each in one]
    print("\nrms error, median / worst, % | samples held, median (5th, 95th percentile), % | all samples held, %\n")
    print(table_head("record", "given", *QUANTITIES))
    for world in worlds:
        own = [each for each in scores if each.world == world]
        told = [each for each in own if not each.refused]
        cells = []
        for k in range(len(QUANTITIES)):
            error, held = ([getattr(each, name)[k] for each in told] for name in ("error", "held"))
            if told:
                low, middle, high = np.quantile(held, (0.05, 0.5, 0.95))
                size = f"{np.median(error):.2f} / {max(error):.2f}"
                cells.append(f"{size}, {middle:.0f} ({low:.0f}, {high:.0f}), {np.mean(held):.0f}")
        print(table_row(world, f"{len(told)} of {len(own)}", *(cells or ["-"] * len(QUANTITIES))))
    print()
    print(table_head("law", "gears", "strut force, rms error, median / worst, %", "samples held, %"))
    for law in sorted({each.law for each in scores}):
        own = [each for each in scores if each.law == law and each.world in ("run", "third") and not each.refused]
        if own:
            error = [each.error[0] for each in own]
            held = np.mean([each.held[0] for each in own])
            print(table_row(law, len(own), f"{np.median(error):.2f} / {max(error):.2f}", f"{held:.0f}"))


if __name__ == "__main__":
    main()
