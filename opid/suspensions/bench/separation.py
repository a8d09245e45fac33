"""Whether the record separates the parts of a law: stiffness and damping from the terms beside them.

A column of gas, an arctangent or an arm has a stiffness of its own, as the spring beside it has. If the motion shows
only their sum, a fit may make one huge and the other cancel it, and each alone means nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from opid.estimate import format_number
from opid.mechanics.laws.law import LAWS, Law, Term, default_law
from opid.mechanics.weight import depends_on_travel
from opid.signals.recording import FloatArray
from opid.suspensions.bench.record import Bench
from opid.suspensions.bench.settings import BenchSettings

INSTEAD = "use the energy that the whole force takes in a cycle"
"""What is determined where the parts are not."""


@dataclass(frozen=True)
class Inseparable:
    """What the record does not separate.

    Args:
        of_travel: whether stiffness, offset, mass and the terms that depend on the travel have no interval.
        of_velocity: whether the damping and the terms that depend on the velocity have none.
        reasons: why, one sentence each.
    """

    of_travel: bool = False
    of_velocity: bool = False
    reasons: tuple[str, ...] = ()

    def holds(self, term: Term) -> bool:
        """Return whether a term has no interval."""
        return (self.of_travel and not is_of_velocity(term)) or (self.of_velocity and not is_of_travel(term.name))


def find_inseparable(
    bench: Bench, stiffness: float, damping: float, law: Law, *, memory_is_testable: bool, settings: BenchSettings
) -> Inseparable:
    """Return what the record does not separate: parts that cancel, and a memory that may be none.

    Args:
        bench: the record.
        stiffness: that beside the law, N/m.
        damping: that beside the law, N s/m.
        law: the law that was fitted.
        memory_is_testable: whether the motion distinguishes memory from a law of travel and velocity.
        settings: how far parts may cancel.
    """
    remembering = [term.name for term in law.terms if term.kind.memory is not None]
    is_untestable = bool(remembering) and not memory_is_testable
    reasons, sizes, cancelling = list[str](), list[str](), dict[str, Term]()
    if is_untestable:
        reasons.append(
            f"on a motion that repeats one cycle {' and '.join(remembering)} may stand for a law without memory: no "
            f"parameter has an interval; {INSTEAD}, or record several amplitudes or a random motion"
        )
    samples, symbols = bench.samples, list[str]()
    straight = {"K": (stiffness * bench.travel)[samples], "C": (damping * bench.velocity)[samples]}
    forces = {term: bench.motion.force(Law((term,), law.rest_m))[samples] for term in law.terms}
    whole = float(np.std(straight["K"] + straight["C"] + sum(forces.values())))
    for symbol, part in straight.items():
        times = float(np.std(part)) / max(whole, 1e-300)
        if times <= settings.most_cancelled:
            continue
        against = [term for term, force in forces.items() if _project(force, part) < -1.0 / settings.most_cancelled]
        if against:
            symbols.append(symbol)
            sizes.append(format_number(times, 2))
            cancelling |= {term.name: term for term in against}
    if cancelling:
        reasons.append(
            f"{' and '.join(symbols)} alone would make {' and '.join(sizes)} times the force of the whole law, which "
            f"{' and '.join(cancelling)} cancel{'s' * (len(cancelling) == 1)}: the motion shows their sum and not the "
            f"parts, which have no interval; {INSTEAD}, or record larger strokes"
        )
    return Inseparable(
        is_untestable or any(not is_of_velocity(term) for term in cancelling.values()),
        is_untestable or any(not is_of_travel(name) for name in cancelling),
        tuple(reasons),
    )


def _project(force: FloatArray, onto: FloatArray) -> float:
    """Return the multiple of a part that a force contains on average."""
    centred = onto - onto.mean()
    return float(force @ centred / (centred @ centred))


def is_of_travel(kind: str) -> bool:
    """Return whether the force of a kind depends on present and past travel, and not on the velocity."""
    if LAWS[kind].memory is not None:
        return all(parameter.unit in ("N", "m", "1") for parameter in LAWS[kind].parameters)
    _, by_velocity = default_law(kind).gradient(np.linspace(-0.01, 0.01, 21), np.linspace(-0.3, 0.3, 21))
    return not np.any(by_velocity)


def is_of_velocity(term: Term) -> bool:
    """Return whether the force of a term depends on the velocity alone."""
    return term.kind.memory is None and not depends_on_travel(Law((term,)))
