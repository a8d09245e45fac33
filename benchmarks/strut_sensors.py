"""Sensors of the strut itself beside or in the place of others: a potentiometer, a pressure, a load cell, a strain.

    python benchmarks/strut_sensors.py --seeds 20 --jobs 2
    python benchmarks/strut_sensors.py --worlds "travel alone,lag 0.5 ms" --seeds 10

Each seed draws a gear (`scenarios.random_case`) and its two runs. The potentiometer has white noise of 0.1 mm, the
force 0.5 % of its own rms, the pressure 1 kPa at 2 MPa; what the world does not state has the usual tolerances. Springs
do not differ from run to run, and this is stated, unless the world says otherwise. The law is searched. No seed is
dropped.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from estimator import identify
from harness import Answer, compare, quantiles, read_names, run_all, seeds_parser, share, short, table_head, table_row
from scenarios import random_case
from scipy import interpolate
from trials import Case, simulated

import opid
from opid.mechanics.repeatability import Departure
from opid.signals.logs import write_log
from opid.signals.recording import Channel, FloatArray, Recording
from opid.suspensions.study import PointMass
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import TaxiRun, TaxiTest, taxi_test

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


def compressed(travel: FloatArray, fs: float, *, exponent: float = 1.2, warmer: float = 1.0) -> FloatArray:
    """Return the absolute pressure of gas that is 0.3 m long and has 2 MPa where the travel is zero, Pa."""
    return np.asarray(2e6 * warmer * (1.0 + travel / 0.3) ** -exponent)


TRAVEL = 'channel = "strut"\nquantity = "travel"\n'
FORCE = 'channel = "strut"\nquantity = "force"\n'
STRAIN = 'channel = "strut"\nquantity = "strain"\n'
PRESSURE = 'channel = "strut"\nquantity = "pressure"\ngas_length_m = 0.3\n'


@dataclass(frozen=True)
class World:
    """What the sensor of a strut does, and what is stated of it.

    Args:
        table: keys of its table; empty if there is none.
        place: name of its table: "unsprung" in the place of the sensor below, or else "travel" or "force".
        spoil: travel and rate to what the sensor reads, before its noise; for a force its own readings.
        noise: rms of its white noise, in the unit of the channel; of a force, over its own rms.
        gains: of the sensor in both runs.
        n_runs: 1 for the heavy run alone.
        differ: standard deviation by which springs, damping and friction differ from run to run; None if they are the
            same, which is then stated.
        has_damper: whether a sensor of the force carries that of the damper, too.
    """

    table: str = ""
    place: str = "unsprung"
    spoil: Callable[[FloatArray, float], FloatArray] = untouched
    noise: float = NOISE_M
    gains: tuple[float, float] = (1.0, 1.0)
    n_runs: int = 2
    differ: float | None = None
    has_damper: bool = True

    @property
    def unit(self) -> str:
        """The unit of the channel."""
        return {TRAVEL: "m", PRESSURE: "Pa"}.get(self.kind, "N" if self.kind == FORCE else "V")

    @property
    def kind(self) -> str:
        """The table that its own begins with."""
        return next(kind for kind in (TRAVEL, PRESSURE, FORCE, STRAIN) if self.table.startswith(kind))


CELL = {"place": "force", "noise": 0.005}
WORLDS = {
    "accelerations alone": World(),
    "travel beside": World(TRAVEL, "travel"),
    "travel alone": World(TRAVEL),
    "travel alone 0.3 mm": World(TRAVEL, noise=3e-4),
    "exact": World(TRAVEL + "gain_tolerance = 0.0\nlag_tolerance_s = 0.0\n"),
    "gain 1 %": World(TRAVEL, spoil=lambda z, fs: 1.01 * z),
    "lag 0.5 ms": World(TRAVEL, spoil=delayed(5e-4)),
    "gain 2 % stated": World(TRAVEL + "gain_tolerance = 0.02\n", spoil=lambda z, fs: 1.02 * z),
    "lag 1 ms stated": World(TRAVEL + "lag_tolerance_s = 0.001\n", spoil=delayed(1e-3)),
    "steps of 0.5 mm": World(TRAVEL, spoil=lambda z, fs: 5e-4 * np.round(z / 5e-4), noise=1e-9),
    "bent by 3 %": World(TRAVEL, spoil=lambda z, fs: z * (1 + 0.03 * z / np.abs(z).max())),
    "pressure beside": World(PRESSURE, "travel", compressed, noise=1e3),
    "pressure: exponent 1.1": World(PRESSURE, "travel", partial(compressed, exponent=1.1), noise=1e3),
    "pressure alone": World(PRESSURE, spoil=compressed, noise=1e3),
    "accelerations: springs differ by 2 %": World(differ=0.02),
    "load cell: one run": World(FORCE, n_runs=1, **CELL),
    "load cell 2 % off: one run": World(FORCE + "gain_tolerance = 0.02\n", gains=(1.02, 1.02), n_runs=1, **CELL),
    "load cell: springs differ by 2 %": World(FORCE, differ=0.02, **CELL),
    "strain: springs differ by 2 %": World(STRAIN, gains=(3e-4, 3e-4), differ=0.02, **CELL),
    "strain: springs differ by 2 %: gain repeats to 0.1 %": World(
        STRAIN + "gain_repeatability = 0.001\n", gains=(3e-4, 3e-4), differ=0.02, **CELL
    ),
    "strain: gain differs by 0.3 %": World(STRAIN, gains=(3e-4, 3.009e-4), differ=0.02, **CELL),
    "strain: gain differs by 2 %": World(STRAIN, gains=(3e-4, 3.06e-4), differ=0.02, **CELL),
    "strain: gain differs by 2 %: springs the same": World(STRAIN, gains=(3e-4, 3.06e-4), differ=0.0, **CELL),
    "load cell: gain differs by 2 %": World(FORCE, gains=(1.0, 1.02), differ=0.02, **CELL),
    "load cell without the damper": World(FORCE, has_damper=False, **CELL),
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


def simulate(world: World, seed: int) -> tuple[Case, TaxiTest]:
    """Return a drawn gear and its two runs, whose springs differ where the world says so."""
    case = random_case(seed)
    if world.differ is None:
        return case, simulated(case, seed)
    drawn = world.differ * np.random.default_rng([seed, 24]).standard_normal((2, 3))
    airframe = case.gear.airframe
    off = [PointMass(-case.mass_removed_kg, airframe.x_cg_m, airframe.y_cg_m)]
    departures = [Departure(*each) for each in drawn.tolist()]
    rng = np.random.default_rng(seed)
    return case, taxi_test(case.gear, rng=rng, loadings=[off], departures=departures, **dict(case.run))


def read_strut(world: World, gear: LandingGear, run: TaxiRun, mass_kg: float) -> FloatArray:
    """Return what the sensor of the strut reads in a run, before its noise."""
    truth = run.truth
    if world.kind in (TRAVEL, PRESSURE):
        return world.spoil(truth.channel("travel"), truth.fs)
    # All that moves the body is the force in the strut.
    force = mass_kg * truth.channel("upper_z")
    if not world.has_damper:
        force = force + gear.suspension_damping_n_s_per_m * truth.channel("travel_velocity")
    return np.asarray(force)


def run(job: tuple[str, int]) -> Outcome:
    """Identify the runs of a drawn gear in one world."""
    world, seed = WORLDS[job[0]], job[1]
    (case, test), rng = simulate(world, seed), np.random.default_rng([seed, 23])
    gear, names, changes = case.gear, ("heavy", "light"), (0.0, test.mass_change_kg)
    below = "" if world.table and world.place == "unsprung" else 'unsprung = "lower_z"\n'
    study = "" if world.differ is not None else "repeatability = 0\n"
    study += f'[channels]\nsprung = "upper_z"\n{below}'
    study += f"[channels.{world.place}]\n{world.table}" if world.table else ""
    nothing = Answer(np.nan, np.nan, np.nan, None)
    with tempfile.TemporaryDirectory() as folder:
        several = [*zip(names, changes, test.runs, world.gains, strict=True)][: world.n_runs]
        for label, change, taxi, gain in several:
            study += f'[[runs]]\nname = "{label}"\nlog = "{label}.csv"\nmass_change_kg = {change}\nstart_s = 0\n'
            columns, channels = [*taxi.recording.samples.T], [*taxi.recording.channels]
            if world.table:
                read = read_strut(world, gear, taxi, gear.sprung_mass_kg + change)
                rms = world.noise * (read.std() if world.place == "force" else 1.0)
                columns.append(gain * (read + rms * rng.standard_normal(read.size)))
                channels.append(Channel("strut", world.unit))
            write_log(
                Recording(np.stack(columns, axis=1), taxi.recording.fs, tuple(channels)), Path(folder) / f"{label}.csv"
            )
        (Path(folder) / "study.toml").write_text(study)
        try:
            found = identify(opid.read_study(Path(folder) / "study.toml"), law=None)
        except ValueError as error:
            return Outcome(*job, nothing, nothing, nothing, np.nan, str(error))
    values = found.parameters
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
