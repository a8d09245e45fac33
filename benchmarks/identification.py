"""Time and memory of one identification of two 40 s runs at 512 Hz, beside two plain chains (`plain_chain.py`).

Run `python benchmarks/identification.py`; in parts `--ways model`. Each way has a process of its own: one call to
import and compile, then several calls on several studies, the median of which is printed: time by the clock on the wall
and of the processor (`time.process_time`). Memory is the peak of the whole process, libraries and compiler with it. The
way "model, law searched, refusal" identifies two runs whose channels are swapped (`worlds.py`), the longest of the
refusals that `refusals.py` prints one by one.
"""

import argparse
import multiprocessing
import os
import resource
import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

# before numpy is loaded, here and in every process that this one starts
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from estimator import identify
from harness import table_head, table_row
from tqdm import tqdm
from trials import Case, Trial, compared, simulated, study_of
from worlds import WORLDS

from opid.virtual.taxi_tests.airframe import LandingGear

N_STUDIES, N_REPEATS = 3, 3
GEAR = LandingGear()
FORCE = f"{GEAR.law.name}.amplitude_n"
REFUSAL = "searched, refusal"
WAYS = (
    ("model", "given"),
    ("model", "searched"),
    ("model", REFUSAL),
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
        law: "given", "searched" or `REFUSAL`.
        seconds: median of all calls but the first of the process; NaN where one of them gave no answer and should.
        busy_s: likewise, of the processor.
        peak_mib: largest memory of the process, MiB.
        percent: median absolute error of M2, K2 and the friction force, %; NaN where there is none.
        n_refused: calls that gave no mass, of `N_STUDIES * N_REPEATS`.
    """

    method: str
    law: str
    seconds: float
    peak_mib: float
    percent: tuple[float, float, float]
    busy_s: float = np.nan
    n_refused: int = 0


def measured(method: str, law: str) -> Timing:
    """Time one way in this process."""
    trials = _trials(method, law)
    percents = np.abs([[each.percent(name) for name in ("M2", "K2", FORCE)] for each in trials])
    # kibibytes on Linux, bytes on macOS
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
    errors = tuple(np.median(percents, axis=0).tolist())
    n_refused = sum(each.reason is not None for each in trials)
    # the time after which one gives up is no time of an identification
    is_as_asked = law == REFUSAL or n_refused == 0
    seconds, busy_s = (
        statistics.median(getattr(each, name) for each in trials) if is_as_asked else np.nan
        for name in ("seconds", "busy_s")
    )
    return Timing(method, law, seconds, peak_mib, errors, busy_s, n_refused)


def _trials(method: str, law: str) -> list[Trial]:
    """All calls but the first, which imports and compiles."""
    case = Case(GEAR, law=GEAR.law.name if law == "given" else None)
    if law == REFUSAL:
        studies = [WORLDS["swapped"].study(seed)[0] for seed in range(N_STUDIES)]
    else:
        studies = [study_of(simulated(case, seed)) for seed in range(N_STUDIES)]
    n_repeats = 1 if law == REFUSAL else N_REPEATS
    compared(case, 0, studies[0], method)
    return [compared(case, seed, study, method) for seed, study in enumerate(studies) for _ in range(n_repeats)]


def timings(ways: Sequence[tuple[str, str]] = WAYS) -> Iterator[Timing]:
    """Yield the timing of each of `ways`, one after the other, each in a fresh process."""
    fresh = multiprocessing.get_context("spawn")
    for way in tqdm(ways, unit="way", disable=None):
        with ProcessPoolExecutor(1, mp_context=fresh) as pool:
            yield pool.submit(measured, *way).result()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    methods = list(dict.fromkeys(method for method, _ in WAYS))
    parser.add_argument("--ways", help=f"methods joined by commas, of {', '.join(methods)}; all where left out")
    wanted = parser.parse_args().ways
    ways = [way for way in WAYS if wanted is None or way[0] in wanted.split(",")]
    found = list(timings(ways))
    plain_s = next((each.busy_s for each in found if each.method == "least squares"), np.nan)
    print(f"Two 40 s runs at 512 Hz; medians of {N_REPEATS} calls on each of {N_STUDIES} studies (refusal: one)\n")
    titles = ("", "processor, s", "wall, s", "over plain least squares", "peak memory, MiB")
    print(table_head(*titles, "M2, %", "K2, %", "friction force, %"))
    for each in found:
        errors = ["-" if np.isnan(error) else f"{error:.2f}" for error in each.percent]
        times = (f"{seconds:.2f}" for seconds in (each.busy_s, each.seconds))
        name = f"{each.method}, law {each.law}" + (f" ({each.n_refused} refused)" if each.n_refused else "")
        print(table_row(name, *times, f"{each.busy_s / plain_s:.1f}", f"{each.peak_mib:.0f}", *errors))

    study = study_of(simulated(Case(GEAR), 0))
    identify(study)
    steps: list[tuple[str, float]] = []
    identify(study, progress=lambda step: steps.append((step, time.process_time())))
    end = time.process_time()
    print("\nsteps of the search, processor time: ", end="")
    spans = zip(steps, [*steps[1:], ("", end)], strict=True)
    print(", ".join(f"{name} {after - begin:.2f} s" for (name, begin), (_, after) in spans))


if __name__ == "__main__":
    main()
