"""What the benchmarks share: seeds on several processes, answers compared with the truth, and Markdown tables.

A script draws what it simulates and says what it asks for; the rest is here. Times are no part of it, because each
script decides what it takes the time of.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple, TypeVar

import numpy as np

from opid import Estimate

Job = TypeVar("Job")
Outcome = TypeVar("Outcome")


# ---- seeds -----------------------------------------------------------------------------------------


def seeds_parser(doc: str | None, *, seeds: int, what: str) -> argparse.ArgumentParser:
    """Return the parser of a script that runs seeds: --seeds, --first and --jobs.

    Args:
        doc: docstring of the script.
        seeds: how many are run where none are named.
        what: what a seed draws, in the plural.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=seeds, help=f"{what}, counted from 0")
    parser.add_argument("--first", type=int, default=0, help="the first of them")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    return parser


def read_names(parser: argparse.ArgumentParser, given: str | None, known: Iterable[str], word: str) -> list[str]:
    """Return names that are joined by commas, all where none are given; an unknown one ends the script.

    Args:
        parser: that the option belongs to.
        given: the names.
        known: those that there are.
        word: what a name stands for, in the singular.
    """
    every = list(known)
    names = [name for name in given.split(",") if name] if given is not None else every
    unknown = sorted(set(names) - set(every))
    if unknown:
        parser.error(f"there is no {word} {', '.join(unknown)}: give some of {', '.join(every)}")
    return names


def run_all(
    run: Callable[[Job], Outcome], jobs: Sequence[Job], describe: Callable[[Outcome], str], *, processes: int
) -> list[Outcome]:
    """Run jobs on several processes and print what is said of each outcome as soon as it is there."""
    outcomes = []
    with ProcessPoolExecutor(processes) as pool:
        for each in pool.map(run, jobs):
            outcomes.append(each)
            print(describe(each), flush=True)
    return outcomes


# ---- answers ---------------------------------------------------------------------------------------


class Answer(NamedTuple):
    """An estimate beside the truth; the first three are NaN where they are not told.

    Args:
        error: the value less the truth.
        std: its standard deviation.
        half_width: half of its 95 % interval.
        holds: whether the interval holds the truth; None where there is none.
    """

    error: float
    std: float
    half_width: float
    holds: bool | None


def compare(estimate: Estimate | None, true: float, *, unit: float | None = None) -> Answer:
    """Compare an estimate with the truth, in % of it, or in a unit of its own."""
    if estimate is None or estimate.value is None:
        return Answer(np.nan, np.nan, np.nan, None)
    one, ends = 0.01 * true if unit is None else unit, estimate.interval95
    return Answer(
        (estimate.value - true) / one,
        np.nan if estimate.std is None else estimate.std / one,
        np.nan if ends is None else 0.5 * (ends[1] - ends[0]) / one,
        None if ends is None else estimate.holds(true),
    )


# ---- tables ----------------------------------------------------------------------------------------


def table_row(*cells: object) -> str:
    """Return a row of a Markdown table; a cell may hold several, joined by " | ".

    >>> table_row("mass", "", 0.5)
    '| mass | | 0.5 |'
    """
    return "|" + "".join(f" {cell} |" if str(cell) else " |" for cell in cells)


def table_head(*titles: str) -> str:
    """Return the head of a Markdown table and the line below it.

    >>> print(table_head("seed", "mass | stiffness"))
    | seed | mass | stiffness |
    |---|---|---|
    """
    head = table_row(*titles)
    return f"{head}\n{'|---' * (head.count('|') - 1)}|"


def short(percent: float) -> str:
    """Return a number with about two digits."""
    if percent < 0.995:
        return f"{percent:.3f}" if percent < 0.0995 else f"{percent:.2f}"
    return f"{percent:.1f}" if percent < 9.95 else f"{percent:.0f}"


def quantiles(values: Iterable[float], *fractions: float) -> str:
    """Return quantiles of the absolute values that are told, "median / worst" for 0.5 and 1; "-" of none."""
    told = np.abs([each for each in values if np.isfinite(each)])
    return " / ".join(short(float(np.quantile(told, each))) for each in fractions) if told.size else "-"


def share(flags: Iterable[bool | None]) -> str:
    """Return "2 of 3", of the flags that are not None; "-" of none."""
    told = [each for each in flags if each is not None]
    return f"{sum(told)} of {len(told)}" if told else "-"
