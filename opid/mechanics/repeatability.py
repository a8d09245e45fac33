"""No two runs are alike: springs, damping and friction of one suspension differ a little from run to run.

A seal settles, gas and oil warm up. In one run stiffness and laws of the travel are 1 + e times those of the
suspension, damping and its laws 1 + e times with another e, and friction with a third.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

from opid.mechanics.driven import N_HEAD, Interface
from opid.mechanics.laws.kinds import Kind
from opid.mechanics.laws.law import Law, Term
from opid.mechanics.weight import depends_on_travel

PARTS = ("spring", "damper", "friction")
"""What may differ by itself."""


@dataclass(frozen=True)
class Departure:
    """By how much a suspension of one run is not what it is on average, relative.

    Args:
        spring: of stiffness and laws of the travel.
        damper: of damping and laws of the velocity.
        friction: of dry friction.

    >>> Departure(spring=0.01).of(Interface(2000.0, 30.0))
    Interface(stiffness=2020.0, damping=30.0, ground_stiffness=0.0, law=Law(terms=(), rest_m=0.0))
    """

    spring: float = 0.0
    damper: float = 0.0
    friction: float = 0.0

    @property
    def values(self) -> tuple[float, float, float]:
        """In the order of `PARTS`."""
        return self.spring, self.damper, self.friction

    def of(self, interface: Interface) -> Interface:
        """Return the suspension as it is in that run, without what that does to the position where it rests."""
        factor = [1.0 + each for each in self.values]
        terms = tuple(_scale(term, factor[_part(term)]) for term in interface.law.terms)
        law = replace(interface.law, terms=terms) if terms else interface.law
        return replace(
            interface, stiffness=factor[0] * interface.stiffness, damping=factor[1] * interface.damping, law=law
        )


def part_rows(interface: Interface) -> list[list[tuple[int, float]]]:
    """Return what each of `PARTS` multiplies: indices among what an interface has, as it orders them, and values."""
    rows: list[list[tuple[int, float]]] = [[(0, interface.stiffness)], [(1, interface.damping)], []]
    index = N_HEAD
    for term in interface.law.terms:
        rows[_part(term)].append((index, term.amplitude))
        index += len(term.values)
    return rows


def _scale(term: Term, factor: float) -> Term:
    return replace(term, values=(factor * term.amplitude, *term.inner))


def _part(term: Term) -> int:
    """Index of the part that a term belongs to."""
    return PARTS.index(part_of(term.kind))


@lru_cache
def part_of(kind: Kind) -> str:
    """Return which of `PARTS` a kind of law belongs to."""
    if kind.is_friction:
        return "friction"
    law = Law((Term(kind.name, tuple(parameter.default for parameter in kind.parameters)),))
    return "spring" if depends_on_travel(law) else "damper"
