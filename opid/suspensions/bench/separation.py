"""Whether the record separates the parts of a law: stiffness and damping from terms that have a slope of their own.

A column of gas, an arctangent or an arm with a damper has a stiffness at rest, as the spring beside it has. If the
motion shows only their sum, a fit may make one huge and the other cancel it, and each alone means nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from opid.estimate import Estimate, format_number
from opid.mechanics.laws.law import Law, Term
from opid.suspensions.bench.record import Bench
from opid.suspensions.bench.settings import BenchSettings

INSTEAD = "use the energy that the whole force takes in a cycle"
"""What is determined where the parts are not."""


def explain_inseparable(
    bench: Bench,
    stiffness: float,
    damping: float,
    law: Law,
    *,
    memory_is_testable: bool,
    settings: BenchSettings,
) -> Iterator[str]:
    """Yield why no parameter of a law has an interval: its parts cancel, or its memory may be none.

    Args:
        bench: the record.
        stiffness: that beside the law, N/m.
        damping: that beside the law, N s/m.
        law: the law that was fitted.
        memory_is_testable: whether the motion distinguishes memory from a law of travel and velocity.
        settings: how far parts may cancel.
    """
    remembering = [term.name for term in law.terms if term.kind.memory is not None]
    if remembering and not memory_is_testable:
        yield (
            f"on a motion that repeats one cycle {' and '.join(remembering)} may stand for a law without memory: no "
            f"parameter has an interval; {INSTEAD}, or record several amplitudes or a random motion"
        )
    motion, samples = bench.motion, bench.samples
    straight = {"K": stiffness * bench.travel, "C": damping * bench.velocity}
    whole = float(np.std((straight["K"] + straight["C"] + motion.force(law))[samples]))
    cancelled, cancelling = dict[str, str](), dict[str, None]()
    for (symbol, force), sharing in zip(straight.items(), list_sharing(law), strict=True):
        times = float(np.std(force[samples])) / max(whole, 1e-300)
        if sharing and times > settings.most_cancelled:
            cancelled[symbol] = format_number(times, 2)
            cancelling |= dict.fromkeys(sharing)
    if cancelled:
        yield (
            f"{' and '.join(cancelled)} alone would make {' and '.join(cancelled.values())} times the force of the "
            f"whole law, which {' and '.join(cancelling)} cancel{'s' * (len(cancelling) == 1)}: the motion shows their "
            f"sum and not the parts, so no parameter has an interval; {INSTEAD}, or record larger strokes"
        )


def withhold_below_zero(straight: Sequence[Estimate], law: Law) -> tuple[list[Estimate], list[str]]:
    """Return stiffness and damping beside a law, and sentences where one lies below zero.

    Beside a term with a slope of its own it is no slope at rest, and has no interval.

    Args:
        straight: K, N/m, and C, N s/m.
        law: the law beside them; without terms nothing is withheld.
    """
    found, sentences = list(straight), list[str]()
    for k, (symbol, sharing) in enumerate(zip("KC", list_sharing(law), strict=True)):
        ends = straight[k].interval95
        if not law.terms or ends is None or ends[1] >= 0:
            continue
        if sharing:
            found[k] = straight[k].without_interval()
            sentences.append(
                f"{symbol} is below zero: it is only the slope that remains beside {' and '.join(sharing)}, has no "
                f"meaning by itself and therefore no interval; {INSTEAD}"
            )
        else:
            sentences.append(
                f"{symbol} is below zero: it is the slope of the law at rest, for which its terms make up in larger "
                f"motion; if that cannot be, {INSTEAD}"
            )
    return found, sentences


def list_sharing(law: Law) -> tuple[list[str], list[str]]:
    """Return the kinds of a law that have a stiffness at rest, and those that have a damping at rest.

    >>> from opid.mechanics.laws.law import default_law
    >>> list_sharing(Law((*default_law("cubic_stiffness").terms, *default_law("arctan_velocity").terms)))
    ([], ['arctan_velocity'])
    """
    slopes = {term.name: _has_slope_at_rest(term) for term in law.terms}
    by_z, by_v = ([name for name, each in slopes.items() if each[k]] for k in (0, 1))
    return by_z, by_v


def _has_slope_at_rest(term: Term) -> tuple[bool, bool]:
    """Return whether a term has a stiffness at rest, and whether it has a damping."""
    if term.kind.memory is not None:
        return True, True
    by_z, by_v = Law((term,)).gradient(0.0, 0.0)
    return bool(by_z), bool(by_v)
