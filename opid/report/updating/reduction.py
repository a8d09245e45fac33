"""What the reduction of a structure leaves out, in sentences: with sensors and joints held, and with free modes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from opid.report.document import counted
from opid.updating.result import Updating
from opid.updating.structure.reduction import ReductionErrors

KEPT = 0.01  # relative error of a frequency below which a mode counts as kept
MOST_NAMED = 4  # modes whose number has changed that are named one by one

_BASES = {"fixed": "modes with sensors and joints held", "free": "free modes (the paper's words)"}


def reduction_sentences(result: Updating) -> tuple[str, ...]:
    """Return how much of the whole structure each reduced one keeps (Song Fig. 7)."""
    tested = sorted({curve.mode for curve in result.measured})
    return tuple(_kept(each, tested) for each in result.reductions)


def order_sentences(reductions: Sequence[ReductionErrors]) -> tuple[str, ...]:
    """Return why the modal assurance criterion is small where it is: what is true of these reductions."""
    return tuple(reason for each in reductions for reason in _reasons(each))


def _kept(errors: ReductionErrors, tested: Sequence[int]) -> str:
    n = errors.relative.size
    parts = []
    compared = [mode for mode in tested if mode <= n]
    if compared:
        worst = float(np.abs(errors.relative[np.array(compared) - 1]).max())
        parts.append(f"frequency of {_modes(compared)} off by at most {100 * worst:.1g} %")
    beyond = np.flatnonzero(np.abs(errors.relative) >= KEPT)
    n_kept = int(beyond[0]) if beyond.size else n
    if n_kept:
        parts.append(f"{_modes(range(1, n_kept + 1))} by less than {100 * KEPT:g} %")
    cut = f" ({counted(errors.n_cut, 'direction')} cut off)" if errors.n_cut else ""
    return f"{counted(errors.n_dof, 'coordinate')}{cut}, {_BASES[errors.method]}: {', '.join(parts)}"


def _reasons(errors: ReductionErrors) -> Iterator[str]:
    """Why a modal assurance criterion is small: the order of the modes has changed, or a mode is like no single one."""
    number = np.arange(1, errors.nearest.size + 1)
    moved = np.flatnonzero((errors.nearest > 0) & (errors.nearest != number))
    lost = [int(mode) for mode in number[errors.nearest == 0]]
    of = "held" if errors.method == "fixed" else "free"
    if moved.size:
        pairs = [f"mode {number[k]} is the whole structure's mode {errors.nearest[k]}" for k in moved[:MOST_NAMED]]
        more = f" and {moved.size - MOST_NAMED} more" * (moved.size > MOST_NAMED)
        yield (
            f"with {of} modes the order changes: {', '.join(pairs)}{more} (crosses: MAC at least "
            f"{errors.nearest_mac[moved].min():.2f}), so that the MAC of equal numbers is small there"
        )
    if lost:
        yield f"with {of} modes the shape of {_modes(lost)} is like no single one of the {number.size} compared"


def _modes(numbers: Sequence[int]) -> str:
    """ "mode 3", "modes 1 to 9", "modes 7 and 8", "modes 2, 7 and 9"."""
    if len(numbers) == 1:
        return f"mode {numbers[0]}"
    if isinstance(numbers, range) or len(numbers) > MOST_NAMED:
        return f"modes {numbers[0]} to {numbers[-1]}"
    return f"modes {', '.join(map(str, numbers[:-1]))} and {numbers[-1]}"
