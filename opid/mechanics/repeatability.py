"""Repeatability: springs, damping and friction of one suspension differ a little from run to run.

A seal settles, gas and oil warm up. In each run stiffness and laws of the travel are multiplied by 1 + e, damping and
its laws by 1 + e with another e, and friction by 1 + e with a third.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

from opid.mechanics.driven import N_HEAD, Interface
from opid.mechanics.laws.kinds import Kind
from opid.mechanics.laws.law import Law, Term
from opid.mechanics.weight import depends_on_travel

PARTS = ("spring", "damper", "friction")
"""The parts of a suspension that differ independently of each other."""


@dataclass(frozen=True)
class Departure:
    """Relative differences of a suspension in one run from its average.

    Args:
        spring: relative difference of stiffness and laws of the travel.
        damper: relative difference of damping and laws of the velocity.
        friction: relative difference of dry friction.

    >>> Departure(spring=0.01).of(Interface(2000.0, 30.0))
    Interface(stiffness=2020.0, damping=30.0, ground_stiffness=0.0, law=Law(terms=(), rest_m=0.0))
    """

    spring: float = 0.0
    damper: float = 0.0
    friction: float = 0.0

    @property
    def values(self) -> tuple[float, float, float]:
        """The three differences in the order of `PARTS`."""
        return self.spring, self.damper, self.friction

    def of(self, interface: Interface) -> Interface:
        """Return the suspension of that run; its position at rest does not change."""
        factor = {part: 1.0 + each for part, each in zip(PARTS, self.values, strict=True)}
        terms = tuple(
            replace(term, values=(factor[part_of(term.kind)] * term.amplitude, *term.inner))
            for term in interface.law.terms
        )
        law = replace(interface.law, terms=terms) if terms else interface.law
        return replace(
            interface,
            stiffness=factor["spring"] * interface.stiffness,
            damping=factor["damper"] * interface.damping,
            law=law,
        )


def part_rows(interface: Interface) -> list[list[tuple[int, float]]]:
    """Return the parameters that each of `PARTS` multiplies: indices among those of an interface, and their values."""
    rows: list[list[tuple[int, float]]] = [[(0, interface.stiffness)], [(1, interface.damping)], []]
    index = N_HEAD
    for term in interface.law.terms:
        rows[PARTS.index(part_of(term.kind))].append((index, term.amplitude))
        index += len(term.values)
    return rows


@lru_cache
def part_of(kind: Kind) -> str:
    """Return the entry of `PARTS` to which a kind of law belongs."""
    if kind.is_friction:
        return "friction"
    law = Law((Term(kind.name, tuple(parameter.default for parameter in kind.parameters)),))
    return "spring" if depends_on_travel(law) else "damper"
