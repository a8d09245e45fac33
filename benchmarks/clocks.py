"""Two recorders with a clock each: what their clocks cost, and whether the intervals hold.

    python benchmarks/clocks.py --seeds 8 --jobs 2
    python benchmarks/clocks.py --worlds "walk,jump 10 ms" --seeds 3

Each seed draws a gear (`scenarios.random_case`) and its two runs. Wheel and airframe are logged by a recorder each, as
text with time stamps, and a study file names the two files; nothing else is stated. In every world the second recorder
was started up to 2 s later and runs up to 100 ppm fast or slow, anew in each run. The last worlds break an assumption:
there the answer must be withheld or hold. No seed is dropped.
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
from scipy import interpolate, signal
from trials import simulated

import opid
from opid.errors import NotDeterminedError
from opid.signals.recording import FloatArray

LATEST_S, FASTEST_PPM = 2.0, 100.0
EDGE_S = 2.5
FINER = 8


@dataclass(frozen=True)
class World:
    """How the samples of a recorder are taken and stamped.

    Args:
        scatter: of the sampling instants in periods, from their number and a source of chance; the stamps say it.
        late: of the stamps behind the samples in periods, likewise.
        wander_s: delay of the second recorder, which its stamps do not say, over the time from -1 to 1.
    """

    scatter: Callable[[int, np.random.Generator], FloatArray] = lambda n, rng: np.zeros(n)
    late: Callable[[int, np.random.Generator], FloatArray] = lambda n, rng: np.zeros(n)
    wander_s: Callable[[FloatArray], FloatArray] = np.zeros_like


def walk(n: int, rng: np.random.Generator) -> FloatArray:
    return np.asarray(np.cumsum(0.004 * rng.standard_normal(n)))


WORLDS = {
    "offset and drift": World(),
    "walk": World(scatter=walk),
    "white": World(scatter=lambda n, rng: 0.02 * rng.standard_normal(n)),
    "stamped late": World(late=lambda n, rng: 0.1 * rng.exponential(size=n)),
    "stamps walk": World(late=walk),
    "parabola 1 ms": World(wander_s=lambda u: 1e-3 * u**2),
    "parabola 5 ms": World(wander_s=lambda u: 5e-3 * u**2),
    "jump 1 ms": World(wander_s=lambda u: 1e-3 * (u > 0)),
    "jump 10 ms": World(wander_s=lambda u: 1e-2 * (u > 0)),
}


@dataclass(frozen=True)
class Outcome:
    """What came of one seed of a world; `said` is the reason or the first warning about clocks."""

    world: str
    seed: int
    mass: Answer
    stiffness: Answer
    residual: float
    said: str


def write_recorder(
    path: Path,
    name: str,
    motion: FloatArray,
    fs: float,
    noise: float,
    world: World,
    rng: np.random.Generator,
    second: bool,
) -> None:
    """Write the log of one recorder: its clock, its sampling instants, and its stamps."""
    fine = signal.resample_poly(motion, FINER, 1, padtype="line")
    spline = interpolate.make_interp_spline(np.arange(fine.size) / (FINER * fs), fine, k=5)
    offset_s = rng.uniform(0.0, LATEST_S) if second else 0.0
    drift = 1e-6 * FASTEST_PPM * rng.choice([-1.0, 1.0]) if second else 0.0
    n = round(len(motion) - (2 * EDGE_S + offset_s) * fs)
    own_s = (np.arange(n) + world.scatter(n, rng)) / fs
    true_s = EDGE_S + offset_s + own_s / (1 + drift)
    if second:
        true_s = true_s - world.wander_s(np.linspace(-1.0, 1.0, n))
    samples = spline(np.clip(true_s, 0.0, (len(motion) - 1) / fs)) + noise * rng.standard_normal(n)
    stamps = np.maximum.accumulate(own_s + world.late(n, rng) / fs)
    rows = "".join(f"{t:.7f},{x:.6f}\n" for t, x in zip(stamps, samples, strict=True))
    path.write_text(f"time [s],{name} [m/s^2]\n{rows}")


def run(job: tuple[str, int]) -> Outcome:
    world, seed = WORLDS[job[0]], job[1]
    case = random_case(seed)
    test, rng = simulated(case, seed), np.random.default_rng([seed, 19])
    changes = {"heavy": 0.0, "light": test.mass_change_kg}
    study = '[channels]\nunsprung = "lower"\nsprung = {file = "{run}_body.csv", channel = "upper"}\nrepeatability = 0\n'
    study = "repeatability = 0\n" + study.replace("repeatability = 0\n", "")
    nothing = Answer(np.nan, np.nan, np.nan, None)
    with tempfile.TemporaryDirectory() as folder:
        for (name, change), taxi in zip(changes.items(), test.runs, strict=True):
            study += f'[[runs]]\nname = "{name}"\nlog = "{name}.csv"\nmass_change_kg = {change}\n'
            for file, channel, sensor in ((name, "lower", "lower_sensor"), (f"{name}_body", "upper", "upper_sensor")):
                truth, noise = taxi.truth.channel(f"{channel}_z"), case.run[sensor].noise_m_per_s2
                path = Path(folder) / f"{file}.csv"
                write_recorder(path, channel, truth, taxi.truth.fs, noise, world, rng, channel == "upper")
        (Path(folder) / "study.toml").write_text(study)
        try:
            found = identify(opid.read_study(Path(folder) / "study.toml"), law=None)
        except (ValueError, NotDeterminedError) as error:
            return Outcome(*job, nothing, nothing, np.nan, str(error).partition("the clock")[2] or str(error))
    gear = case.gear
    said = found.not_determined or next((each for each in found.warnings if "clock" in each or "lag" in each), "")
    return Outcome(
        *job,
        compare(found.parameters.sprung_mass_kg, gear.sprung_mass_kg),
        compare(found.parameters.suspension_stiffness_n_per_m, gear.suspension_stiffness_n_per_m),
        found.residual_over_noise,
        said,
    )


def describe(one: Outcome) -> str:
    holds = {True: "holds", False: "MISSES", None: "no interval"}[one.mass.holds]
    return (
        f"{one.world} {one.seed}: mass {one.mass.error:+.3f} % +- {one.mass.std:.3f}, {holds}; residual "
        f"{one.residual:.2f} {one.said[:160]}"
    )


def main() -> None:
    parser = seeds_parser(__doc__, seeds=8, what="gears")
    parser.add_argument("--worlds", help="names joined by commas; all where left out")
    options = parser.parse_args()
    worlds = read_names(parser, options.worlds, WORLDS, "world")
    jobs = [(world, seed) for world in worlds for seed in range(options.first, options.first + options.seeds)]
    found = run_all(run, jobs, describe, processes=options.jobs)
    print(
        table_head(
            "world", "gears", "mass given", "mass, median / worst %", "intervals of M2 and K2 that hold", "half width %"
        )
    )
    for world in worlds:
        own = [each for each in found if each.world == world]
        given = [each for each in own if each.mass.holds is not None]
        flags = [each.holds for one in given for each in (one.mass, one.stiffness)]
        half = np.median([each.mass.half_width for each in given]) if given else np.nan
        error = quantiles([each.mass.error for each in given], 0.5, 1.0)
        print(table_row(world, len(own), len(given), error, share(flags), short(half) if given else "-"))


if __name__ == "__main__":
    main()
