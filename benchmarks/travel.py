"""A potentiometer in the place of a sensor below the suspension, or beside it: masses, stiffness, and their intervals.

    python benchmarks/travel.py --seeds 20 --jobs 2
    python benchmarks/travel.py --worlds "alone,lag 0.5 ms" --seeds 10

Each seed draws a gear (`scenarios.random_case`) and its two runs. The potentiometer has white noise of 0.1 mm, and its
gain and lag have the usual tolerances where the world states none. The law is searched. No seed is dropped.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from estimator import identify
from harness import Answer, compare, quantiles, read_names, run_all, seeds_parser, share, short, table_head, table_row
from scenarios import random_case
from scipy import interpolate
from trials import simulated

import opid
from opid.signals.logs import write_log
from opid.signals.recording import Channel, FloatArray, Recording

NOISE_M = 1e-4


def untouched(travel: FloatArray, fs: float) -> FloatArray:
    """Return the travel as it is."""
    return travel


def delayed(seconds: float) -> Callable[[FloatArray, float], FloatArray]:
    """Return a function that delays a travel."""

    def delay(travel: FloatArray, fs: float) -> FloatArray:
        time_s = np.arange(travel.size) / fs
        return np.asarray(interpolate.make_interp_spline(time_s, travel, k=5)(np.maximum(time_s - seconds, 0.0)))

    return delay


@dataclass(frozen=True)
class World:
    """What a potentiometer does, and what is stated of it.

    Args:
        spoil: travel and rate to what the potentiometer reads, before its noise.
        noise_m: rms of its white noise, m.
        stated: keys of its table.
        is_beside: whether there is a sensor below the suspension, too.
        has_travel: whether the potentiometer is used at all.
    """

    spoil: Callable[[FloatArray, float], FloatArray] = untouched
    noise_m: float = NOISE_M
    stated: str = ""
    is_beside: bool = False
    has_travel: bool = True


WORLDS = {
    "accelerations alone": World(is_beside=True, has_travel=False),
    "beside": World(is_beside=True),
    "alone": World(),
    "alone 0.3 mm": World(noise_m=3e-4),
    "exact": World(stated="gain_tolerance = 0.0\nlag_tolerance_s = 0.0\n"),
    "gain 1 %": World(spoil=lambda z, fs: 1.01 * z),
    "lag 0.5 ms": World(spoil=delayed(5e-4)),
    "gain 2 % stated": World(spoil=lambda z, fs: 1.02 * z, stated="gain_tolerance = 0.02\n"),
    "lag 1 ms stated": World(spoil=delayed(1e-3), stated="lag_tolerance_s = 0.001\n"),
    "steps of 0.5 mm": World(spoil=lambda z, fs: 5e-4 * np.round(z / 5e-4), noise_m=1e-9),
    "bent by 3 %": World(spoil=lambda z, fs: z * (1 + 0.03 * z / np.abs(z).max())),
}


@dataclass(frozen=True)
class Outcome:
    """What came of one seed of a world; `said` is the reason of a withheld mass."""

    world: str
    seed: int
    mass: Answer
    stiffness: Answer
    damping: Answer
    residual: float
    said: str


def run(job: tuple[str, int]) -> Outcome:
    """Identify the two runs of a drawn gear in one world."""
    world, seed = WORLDS[job[0]], job[1]
    case = random_case(seed)
    test, rng = simulated(case, seed), np.random.default_rng([seed, 23])
    changes = {"heavy": 0.0, "light": test.mass_change_kg}
    table = f'channel = "pot"\nquantity = "travel"\n{world.stated}'
    below = 'unsprung = "lower_z"\n' if world.is_beside else ""
    name = "travel" if world.is_beside else "unsprung"
    study = f'repeatability = 0\n[channels]\nsprung = "upper_z"\n{below}'
    study += f"[channels.{name}]\n{table}" if world.has_travel else ""
    nothing = Answer(np.nan, np.nan, np.nan, None)
    units = {"lower_z": "m/s^2", "upper_z": "m/s^2", "pot": "m"}
    with tempfile.TemporaryDirectory() as folder:
        for (label, change), taxi in zip(changes.items(), test.runs, strict=True):
            study += f'[[runs]]\nname = "{label}"\nlog = "{label}.csv"\nmass_change_kg = {change}\nstart_s = 0\n'
            fs, travel = taxi.truth.fs, taxi.truth.channel("travel")
            read = world.spoil(travel, fs) + world.noise_m * rng.standard_normal(travel.size)
            columns = [taxi.recording.channel("lower_z"), taxi.recording.channel("upper_z"), read]
            whole = Recording(np.stack(columns, axis=1), fs, tuple(Channel(*each) for each in units.items()))
            write_log(whole, Path(folder) / f"{label}.csv")
        (Path(folder) / "study.toml").write_text(study)
        try:
            found = identify(opid.read_study(Path(folder) / "study.toml"), law=None)
        except ValueError as error:
            return Outcome(*job, nothing, nothing, nothing, np.nan, str(error))
    gear, values = case.gear, found.parameters
    return Outcome(
        *job,
        compare(values.sprung_mass_kg, gear.sprung_mass_kg),
        compare(values.suspension_stiffness_n_per_m, gear.suspension_stiffness_n_per_m),
        compare(values.suspension_damping_n_s_per_m, gear.suspension_damping_n_s_per_m),
        found.residual_over_noise,
        found.not_determined or "",
    )


def describe(one: Outcome) -> str:
    """Return the line of one seed."""
    holds = {True: "holds", False: "MISSES", None: "no interval"}
    answers = ("mass", one.mass), ("K2", one.stiffness), ("C2", one.damping)
    words = ", ".join(f"{name} {each.error:+.3f} % +- {each.std:.3f}, {holds[each.holds]}" for name, each in answers)
    return f"{one.world} {one.seed}: {words}; residual {one.residual:.2f} {one.said[:160]}"


def main() -> None:
    """Print a line for each seed, and the table of the worlds."""
    parser = seeds_parser(__doc__, seeds=8, what="gears")
    parser.add_argument("--worlds", help="names joined by commas; all where left out")
    options = parser.parse_args()
    worlds = read_names(parser, options.worlds, WORLDS, "world")
    jobs = [(world, seed) for world in worlds for seed in range(options.first, options.first + options.seeds)]
    found = run_all(run, jobs, describe, processes=options.jobs)
    hold = "intervals that hold: "
    print(
        table_head(
            "world",
            "gears",
            "given",
            "mass, median / worst %",
            "half width %",
            f"{hold}M2",
            "K2",
            "C2",
            "K2, worst %",
            "C2, worst %",
        )
    )
    for world in worlds:
        own = [each for each in found if each.world == world]
        given = [each for each in own if each.mass.holds is not None]
        half = np.median([each.mass.half_width for each in given]) if given else np.nan
        error = quantiles([each.mass.error for each in given], 0.5, 1.0)
        held = [share([getattr(one, name).holds for one in given]) for name in ("mass", "stiffness", "damping")]
        worst = [quantiles([getattr(one, name).error for one in given], 1.0) for name in ("stiffness", "damping")]
        print(table_row(world, len(own), len(given), error, short(half) if given else "-", *held, *worst))


if __name__ == "__main__":
    main()
