"""What is answered where the truth is no single gear of the model: a refusal, or an interval that holds.

Run `python benchmarks/refusals.py`; in parts `--worlds Dahl,pushed --seeds 3`. The worlds are those of `worlds.py`,
simulated without the estimator's predictor; the law is searched. Seeds count from 0 and none is dropped. The time is
that of the processor (`time.process_time`) for the identification alone, after a warm-up that has compiled what an
answer and a refusal need.
"""

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

# before numpy is loaded
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from estimator import identify, residual_over_noise
from harness import read_names, share, table_head, table_row
from worlds import WORLDS

# what is asked of unmeasured forces, an engine and a body that bends, and what is aimed at
ASKED = "| asked (aim) | at most the body that bends (none) | | 92 to 98 % (94 to 96 %) | | | |"


class Outcome(NamedTuple):
    """Of one seed of one world.

    Args:
        busy_s: processor time, s.
        residual: over the sensors' noise; NaN if there was no fit.
        answer: mass and interval, or the reason why there is none.
        refused: whether nothing is told.
        holds: whether the interval of the mass holds the truth; None without an interval or a truth.
        wide_percent: half the interval over the mass; NaN without an interval.
        law: that was found.
        limited_by: noise, unmeasured forces or the model; "-" if there was no fit, or one that explains nothing.
    """

    busy_s: float
    residual: float
    answer: str
    refused: bool
    holds: bool | None
    wide_percent: float
    law: str
    limited_by: str = "-"


def outcome(world: str, seed: int) -> Outcome:
    """Identify one seed of a world."""
    study, truth_kg = WORLDS[world].study(seed)
    begun = time.process_time()
    try:
        found = identify(study)
    except Exception as error:
        said = f"{type(error).__name__}: {error}"
        return Outcome(time.process_time() - begun, np.nan, said, True, None, np.nan, "-")
    busy_s = time.process_time() - begun
    mass, residual, law = found.parameters.sprung_mass_kg, residual_over_noise(found), found.law.name
    by = found.limited_by or "-"
    if mass.value is None:
        # of the reason the first words tell which one it is
        reason = (found.not_determined or "no mass").split(",")[0]
        frequency = found.ratios.natural_frequency_hz
        if frequency.value is not None:
            reason += f"; {frequency.value:.3f} +- {frequency.std or np.nan:.2g} Hz"
        return Outcome(busy_s, residual, reason, found.is_refused, None, np.nan, law, by)
    if mass.interval95 is None:
        return Outcome(busy_s, residual, f"{mass.value:.1f} kg, no interval", False, None, np.nan, law, by)
    low, high = mass.interval95
    holds = None if truth_kg is None else mass.holds(truth_kg)
    said = f"{mass.value:.1f} kg, {low:.1f} to {high:.1f}"
    said += "" if truth_kg is None else f" ({100 * (mass.value / truth_kg - 1):+.2f} %)"
    return Outcome(busy_s, residual, said, False, holds, 50 * (high - low) / mass.value, law, by)


def warm_up() -> None:
    """Compile: an answer, two refusals, and a law that remembers, which has a kernel of its own."""
    for world in ("nominal", "noise", "swapped", "Dahl"):
        outcome(world, 1_000_000)


def summary(outcomes: list[Outcome]) -> list[str]:
    """Cells of the second table."""
    busy = [each.busy_s for each in outcomes]
    wide = [each.wide_percent for each in outcomes if np.isfinite(each.wide_percent)]
    residual = [each.residual for each in outcomes if np.isfinite(each.residual)]
    return [
        share(each.refused for each in outcomes),
        share(np.isfinite(each.wide_percent) for each in outcomes),
        share(each.holds for each in outcomes),
        f"{np.median(wide):.2f}" if wide else "-",
        f"{np.median(residual):.2f} / {max(residual):.2f}" if residual else "-",
        f"{np.median(busy):.1f} / {max(busy):.1f}",
    ]


def main() -> None:
    """Print a line for each seed, then one for each world."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = ", ".join(WORLDS).replace("%", "%%")
    parser.add_argument("--worlds", help=f"names joined by commas, of {names}; all where left out")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    options = parser.parse_args()
    names = read_names(parser, options.worlds, WORLDS, "world")
    found: dict[str, list[Outcome]] = {}
    titles = ("world", "seed", "processor, s", "residual over noise", "limited by", "law", "answer or reason")
    print(table_head(*titles, "interval holds"))
    # every world once before any a second time: a run that is broken off has seen all of them
    cases = [(name, seed) for seed in range(options.seeds) for name in names]
    with ProcessPoolExecutor(options.jobs, initializer=warm_up) as pool:
        for (name, seed), each in zip(cases, pool.map(outcome, *zip(*cases, strict=True)), strict=True):
            found.setdefault(name, []).append(each)
            holds = "-" if each.holds is None else "yes" if each.holds else "NO"
            cells = (name, seed, f"{each.busy_s:.1f}", f"{each.residual:.2f}", each.limited_by, each.law, each.answer)
            print(table_row(*cells, holds), flush=True)
    titles = ("world", "refused", "mass told", "intervals that hold", "half interval, %")
    print("\n" + table_head(*titles, "residual over noise, median / worst", "processor, s, median / worst"))
    print(ASKED)
    for name, outcomes in found.items():
        print(table_row(f"{name}: {WORLDS[name].why}", *summary(outcomes)))


if __name__ == "__main__":
    main()
