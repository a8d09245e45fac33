"""The straight suspension that is told under a wrong law: how many of its intervals hold, as Markdown tables.

Run `python benchmarks/equivalents.py --seeds 20 --jobs 2`. Struts with friction that remembers and one with a bump
stop, those of `worlds.py`, are identified with `law = "linear"`. No mass is told then; what is told of each run is the
straight suspension that comes nearest to the strut over the motion of that run (`result.equivalents`): stiffness and
damping over the mass of that run, frequency and damping ratio.

It is compared with the same of the true strut. K and C are those of the least squares of the true force of spring,
damper and law on the true travel and its true rate, without a constant, over every step of the recorded 40 s (Roberts
& Spanos 1990, ch. 5). K/M, C/M, sqrt(K/M)/(2 pi) and C/(2 sqrt(K M)) follow with the true mass of the run. This is what
an answer says of itself, with the predicted motion and the identified force in place of the true ones. "In the band" is
the same with force, travel and rate band-passed to the lines that are fitted: how much the definition matters.

Two runs of a seed share one fit, so their intervals do not hold or fail independently. No seed is dropped.
"""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass

# before numpy is loaded, here and in every process that this one starts
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
import worlds
from estimator import identify
from harness import Answer, compare, read_names, run_all, seeds_parser, share, table_head, table_row
from worlds import Rolled, study_of_rolled, two_rolled

from opid.estimate import Estimate
from opid.mechanics.weight import GRAVITY_M_PER_S2
from opid.signals.recording import FloatArray

# the light run rests by so much farther from a stop in compression
HIGHER_M = worlds.REMOVED_KG * GRAVITY_M_PER_S2 / worlds.GEAR.suspension_stiffness_n_per_m
LIGHT_STOP = (worlds.STOP[0], worlds.STOP[1] + HIGHER_M)
# law, its parameters in the heavy and in the light run
STRUTS: dict[str, tuple[Callable, tuple[float, ...], tuple[float, ...]]] = {
    "Dahl": (worlds.dahl, worlds.DAHL, worlds.DAHL),
    "LuGre": (worlds.lugre, worlds.LUGRE, worlds.LUGRE),
    "Bouc-Wen": (worlds.bouc_wen, worlds.BOUC_WEN, worlds.BOUC_WEN),
    "bump stop": (worlds.bump_stop, worlds.STOP, LIGHT_STOP),
}
NAMES = ("stiffness_per_mass", "damping_per_mass", "natural_frequency_hz", "damping_ratio")
TITLES = ("K/M", "C/M", "frequency", "damping ratio")


@dataclass(frozen=True)
class Job:
    """One seed of a strut."""

    strut: str
    seed: int


@dataclass(frozen=True)
class Outcome:
    """What is told of the two runs of a seed.

    Args:
        job: strut and seed.
        limited_by: noise, unmeasured forces or the model; "-" if the fit explains nothing.
        departure: of two fits, in standard deviations; what decides that.
        unexplained: rms of what is left over that of the readings, the larger of both runs.
        mass_is_told: whether a mass is told with an interval.
        truth: (2, 4) of each run in the order of NAMES.
        in_band: likewise, in the band of the fit.
        answers: 4 of each of 2 runs, relative to the truth.
        busy_s: processor time, s.
    """

    job: Job
    limited_by: str
    departure: float
    unexplained: float
    mass_is_told: bool
    truth: FloatArray
    in_band: FloatArray
    answers: tuple[tuple[Answer, ...], ...]
    busy_s: float


def straight(run: Rolled, mass_kg: float, band_hz: tuple[float, float] | None = None) -> FloatArray:
    """Return what comes nearest to the true strut over a run, in the order of NAMES; of all of it, or of a band."""
    signals = np.stack([run.travel, run.velocity, run.force], axis=1)
    if band_hz is not None:
        lines = np.fft.rfft(signals * np.hanning(len(signals))[:, np.newaxis], axis=0)
        hz = np.fft.rfftfreq(len(signals), d=run.recording.duration_s / len(signals))
        lines = lines[(hz >= band_hz[0]) & (hz <= band_hz[1])]
        signals = np.concatenate([lines.real, lines.imag])
    stiffness, damping = np.linalg.lstsq(signals[:, :2], signals[:, 2], rcond=None)[0] / mass_kg
    omega = np.sqrt(stiffness)
    return np.array([stiffness, damping, omega / (2 * np.pi), damping / (2 * omega)])


def run(job: Job) -> Outcome:
    """Simulate and identify."""
    memory, parameters, lighter = STRUTS[job.strut]
    rolled = two_rolled(memory, parameters, job.seed, lighter=lighter)
    study = study_of_rolled(job.strut, rolled)
    begun = time.process_time()
    found = identify(study, law="linear")
    busy_s = time.process_time() - begun
    heavy_kg = worlds.GEAR.sprung_mass_kg
    masses, band_hz = (heavy_kg, heavy_kg - worlds.REMOVED_KG), found.settings.runs.band_hz
    truth = np.array([straight(*each) for each in zip(rolled, masses, strict=True)])
    in_band = np.array([straight(*each, band_hz) for each in zip(rolled, masses, strict=True)])
    told = [[getattr(each, name) for name in NAMES] for each in found.equivalents] or [[Estimate()] * 4] * 2
    answers = tuple(
        tuple(compare(each, true, unit=true) for each, true in zip(estimates, row.tolist(), strict=True))
        for estimates, row in zip(told, truth, strict=True)
    )
    errors = [each.error for each in found.evidence if each.error is not None]
    return Outcome(
        job,
        found.limited_by or "-",
        errors[0].departure if errors else np.nan,
        max(each.unexplained for each in found.runs),
        found.parameters.sprung_mass_kg.interval95 is not None,
        truth,
        in_band,
        answers,
        busy_s,
    )


def describe(each: Outcome) -> str:
    """Return a row for each run of a seed."""
    rows = []
    for name, truth, answers in zip(("heavy", "light"), each.truth, each.answers, strict=True):
        cells = [each.job.strut, each.job.seed, name, f"{each.limited_by} ({each.departure:.1f})"]
        cells += [f"{100 * each.unexplained:.0f}", "yes" if each.mass_is_told else "no"]
        for true, answer in zip(truth, answers, strict=True):
            holds = {None: "-", True: "holds", False: "NO"}[answer.holds]
            cells.append(f"{true:.4g}: {100 * answer.error:+.2f}, {100 * answer.half_width:.2f} %, {holds}")
        rows.append(table_row(*cells, f"{each.busy_s:.1f}"))
    return "\n".join(rows)


def print_table(outcomes: list[Outcome]) -> None:
    """Print a row for each strut."""
    titles = [f"{title}: hold; half width, %; error, worst, %; in the band, %" for title in TITLES]
    print(
        "\n" + table_head("strut, law linear", "limited by the model", "left, %", "mass told", *titles, "processor, s")
    )
    print(table_row("asked", "", "", "", *["92 to 98 % hold"] * 4, ""))
    for strut in STRUTS:
        own = [each for each in outcomes if each.job.strut == strut]
        if not own:
            continue
        cells = [
            strut,
            share(each.limited_by == "model" for each in own),
            f"{100 * np.median([each.unexplained for each in own]):.0f}",
            share(each.mass_is_told for each in own),
        ]
        for column in range(4):
            answers = [row[column] for each in own for row in each.answers]
            wide, off = (100 * np.abs([getattr(each, what) for each in answers]) for what in ("half_width", "error"))
            apart = np.concatenate([each.in_band[:, column] / each.truth[:, column] - 1 for each in own])
            cells.append(
                f"{share(each.holds for each in answers)}; {_median(wide):.2g}; {_median(off):.2g}, {_worst(off):.2g}; "
                f"{100 * np.median(apart):+.1g}"
            )
        print(table_row(*cells, f"{np.median([each.busy_s for each in own]):.1f}"))


def _median(values: FloatArray) -> float:
    return float(np.nanmedian(values)) if np.isfinite(values).any() else np.nan


def _worst(values: FloatArray) -> float:
    return float(np.nanmax(values)) if np.isfinite(values).any() else np.nan


def main() -> None:
    parser = seeds_parser(__doc__, seeds=20, what="of each strut")
    parser.add_argument("--struts", help=f"names joined by commas, of {', '.join(STRUTS)}; all where left out")
    options = parser.parse_args()
    struts = read_names(parser, options.struts, STRUTS, "strut")
    titles = [f"{title}: truth, error, half of the 95 % interval" for title in TITLES]
    head = ("strut", "seed", "run", "limited by (departure)", "left, %", "mass told")
    print(table_head(*head, *titles, "processor, s"))
    # every strut once before any a second time
    jobs = [Job(strut, seed) for seed in range(options.first, options.seeds) for strut in struts]
    print_table(run_all(run, jobs, describe, processes=options.jobs))


if __name__ == "__main__":
    main()
