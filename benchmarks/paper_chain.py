"""The paper's chain beside opid on the same runs: the mass that it finds, for a column of the tables of benchmarks.

"Mended" is the method "classical", the chain of Iwaniec & Uhl (2007) with every step sound; "printed" is that chain to
the letter, on the strongest matched peaks. The chain knows no weight, no gas and nothing that remembers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from estimator import GearStudy
from harness import short
from trials import Case, compared

from opid.virtual.taxi_tests.airframe import LandingGear

CHAIN_HEAD = "the paper's chain mended: mass, median / worst, % | as printed"


class ChainErrors(NamedTuple):
    """Errors of the mass of one study in %, NaN where none is told.

    Args:
        mended: of the method "classical".
        printed: of the chain as printed.
    """

    mended: float
    printed: float


def chain_errors(gear: LandingGear, study: GearStudy, *, law: str | None = None) -> ChainErrors:
    """Identify a study by the paper's chain and compare with the gear of its first run.

    Args:
        gear: that is true.
        study: of its runs.
        law: that is given; searched where left out.
    """
    found = compared(Case(gear, law=law), 0, study, "classical")
    if found.crashed:
        # a mistake in the program is no answer that was withheld
        raise RuntimeError(found.reason)
    return ChainErrors(found.percent("M2"), 100 * found.printed / gear.sprung_mass_kg)


def chain_cells(errors: Sequence[ChainErrors]) -> str:
    """Return two cells of a table, as `CHAIN_HEAD` names them."""
    return " | ".join(_told([getattr(each, name) for each in errors]) for name in ChainErrors._fields)


def chain_quantiles(errors: Sequence[float]) -> tuple[int, list[float]]:
    """Return how many are told, and median, 95th percentile and worst of their absolute values; NaN of none."""
    given = np.abs([each for each in errors if np.isfinite(each)])
    return given.size, [float(np.quantile(given, q)) if given.size else np.nan for q in (0.5, 0.95, 1.0)]


def _told(errors: Sequence[float]) -> str:
    n_told, (median, _, worst) = chain_quantiles(errors)
    figures = f"{short(median)} / {short(worst)}" if n_told else "-"
    return f"{figures} ({n_told} of {len(errors)} answered)"
