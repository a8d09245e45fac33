"""Time and memory of one identification of two 40 s runs at 512 Hz, beside two plain chains (`plain_chain.py`).

Run `python benchmarks/identification.py`. Each way has a process of its own: one call to import and compile, then
several calls on several studies, the median of which is printed; memory is the peak of the whole process, libraries
and compiler with it.
"""

import multiprocessing
import resource
import statistics
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm
from trials import Case, compared, simulated, study_of

from opid.mechanics.landing_gear import LandingGear
from opid.suspensions.one_gear.identification import identify_study

N_STUDIES, N_REPEATS = 3, 3
GEAR = LandingGear()
FORCE = f"{GEAR.law.name}.amplitude_n"
WAYS = (
    ("model", "given"),
    ("model", "searched"),
    ("classical", "given"),
    ("classical", "searched"),
    ("least squares", "given"),
    ("pysindy", "searched"),
)


@dataclass(frozen=True)
class Timing:
    """What one identification costs, and how far off it was.

    Args:
        method: one of `trials.METHODS`.
        law: "given" or "searched".
        seconds: median of all calls but the first of the process; NaN where one of them gave no answer.
        peak_mib: largest memory of the process, MiB.
        percent: median absolute error of M2, K2 and the friction force, %; NaN where there is none.
    """

    method: str
    law: str
    seconds: float
    peak_mib: float
    percent: tuple[float, float, float]


def measured(method: str, law: str) -> Timing:
    """Time one way in this process."""
    case = Case(GEAR, law=GEAR.law.name if law == "given" else None)
    studies = [study_of(simulated(case, seed)) for seed in range(N_STUDIES)]
    compared(case, 0, studies[0], method)
    trials = [compared(case, seed, study, method) for seed, study in enumerate(studies) for _ in range(N_REPEATS)]
    percents = np.abs([[each.percent(name) for name in ("M2", "K2", FORCE)] for each in trials])
    # kibibytes on Linux, bytes on macOS
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
    errors = tuple(np.median(percents, axis=0).tolist())
    # the time after which one gives up is no time of an identification
    gave_up = any(each.reason is not None for each in trials)
    seconds = np.nan if gave_up else statistics.median(each.seconds for each in trials)
    return Timing(method, law, seconds, peak_mib, errors)


def timings() -> Iterator[Timing]:
    """Yield the timing of each of `WAYS`, one after the other, each in a fresh process."""
    fresh = multiprocessing.get_context("spawn")
    for way in tqdm(WAYS, unit="way", disable=None):
        with ProcessPoolExecutor(1, mp_context=fresh) as pool:
            yield pool.submit(measured, *way).result()


def main() -> None:
    found = list(timings())
    plain_s = next(each.seconds for each in found if each.method == "least squares")
    print(f"Two 40 s runs at 512 Hz; medians of {N_REPEATS} calls on each of {N_STUDIES} studies\n")
    print("| | time, s | over plain least squares | peak memory, MiB | M2, % | K2, % | friction force, % |")
    print("|---|---|---|---|---|---|---|")
    for each in found:
        errors = " | ".join("-" if np.isnan(error) else f"{error:.2f}" for error in each.percent)
        over = each.seconds / plain_s
        print(f"| {each.method}, law {each.law} | {each.seconds:.2f} | {over:.1f} | {each.peak_mib:.0f} | {errors} |")

    study = study_of(simulated(Case(GEAR), 0))
    identify_study(study, method="model")
    steps: list[tuple[str, float]] = []
    identify_study(study, method="model", progress=lambda step: steps.append((step, time.perf_counter())))
    end = time.perf_counter()
    print("\nsteps of the search: ", end="")
    spans = zip(steps, [*steps[1:], ("", end)], strict=True)
    print(", ".join(f"{name} {after - begin:.2f} s" for (name, begin), (_, after) in spans))


if __name__ == "__main__":
    main()
