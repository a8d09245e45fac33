"""The polynomials of a nonlinear mode as a `Law`: k_n q |q|^(n-1) and c_n q' |q'|^(n-1), n from 2 up.

As printed, eqs. (9) and (10) of Pacini are even, and constant at n = 1, which is no restoring force; the columns of
eq. (11) are right. n = 1 is the linear part: it corrects k0 and c0, and belongs to the mode, not to its law.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np

from opid.errors import InputError
from opid.estimate import Estimate
from opid.mechanics.backbones.harmonic_balance import first_harmonic_factor
from opid.mechanics.laws.law import Law, Term, TermSet
from opid.modal.settings import MODAL
from opid.result import SummaryRow

STIFFNESS_KINDS = {2: "quadratic_stiffness", 3: "cubic_stiffness", 4: "quartic_stiffness", 5: "quintic_stiffness"}
DAMPING_KINDS = {2: "quadratic_damping", 3: "cubic_damping", 4: "quartic_damping", 5: "quintic_damping"}
HELD_KINDS = {"stiffness": "held_stiffness", "damping": "held_damping"}
HIGHEST_ORDER = 5  # the paper's second case uses it; a higher order could not be distinguished from noise


def power_law(stiffness: Mapping[int, float], damping: Mapping[int, float]) -> Law:
    """Return sum k_n q |q|^(n-1) + sum c_n q' |q'|^(n-1) as a law.

    Args:
        stiffness: k_n by n, each (N/kg^1/2) / (m kg^1/2)^n.
        damping: c_n by n, each (N/kg^1/2) / (m/s kg^1/2)^n.

    Raises:
        InputError: a power outside 2 .. 5.

    >>> power_law({3: 2.0}, {2: 0.5}).name
    'quadratic_damping+cubic_stiffness'
    """
    terms = []
    for kinds, values, letter in ((STIFFNESS_KINDS, stiffness, "k"), (DAMPING_KINDS, damping, "c")):
        for power, value in values.items():
            if power not in kinds:
                raise InputError(f"a nonlinear mode has no term {letter}{power}: give powers 2 to {HIGHEST_ORDER}")
            terms.append(Term(kinds[power], (value,)))
    return Law(tuple(terms))


def make_fitted_law(stiffness: Mapping[int, Estimate], damping: Mapping[int, Estimate]) -> Law:
    """Return the law of fitted coefficients without the power 1, which is the linear part."""
    of_stiffness, of_damping = (
        {n: float(value.value or 0.0) for n, value in values.items() if n > 1} for values in (stiffness, damping)
    )
    return power_law(of_stiffness, of_damping)


def hold_unstable(law: Law, linear: tuple[float, float], largest: tuple[float, float]) -> TermSet:
    """Return a law whose powers are held beyond the motion of its tests if they become unstable there.

    The powers of stiffness are held where their tangent, and those of damping where what they take from a cycle (its
    first harmonic), falls to zero or below between that motion and `MODAL.stable_up_to` times it: a motion grows by the
    energy of whole cycles, not by the force at their fastest moment. The force of held powers continues along its
    secant, z sum k_n min(|z|, A)^(n-1). A law that stays stable is returned as it is.

    Args:
        law: the powers, as `power_law` makes them.
        linear: k0, 1/s^2, and c0, 1/s, beside them.
        largest: largest displacement, m kg^1/2, and velocity, m/s kg^1/2, of the tests.

    >>> softening = power_law({3: -0.5}, {2: 0.1})
    >>> hold_unstable(softening, (1.0, 0.1), (0.3, 0.3)) is softening
    True
    >>> float(hold_unstable(softening, (1.0, 0.1), (1.0, 1.0)).force(2.0, 0.0))
    -1.0
    """
    terms: list[Term] = []
    for name, kinds, base, reach in zip(HELD_KINDS, (STIFFNESS_KINDS, DAMPING_KINDS), linear, largest, strict=True):
        own = {n: term for n, kind in kinds.items() for term in law.terms if term.name == kind}
        at = reach * np.linspace(1.0, MODAL.stable_up_to, 101)
        weights = {n: n if name == "stiffness" else first_harmonic_factor(n) for n in own}
        left = base + sum(term.amplitude * weights[n] * at ** (n - 1) for n, term in own.items())
        is_stable = np.min(left) > 0.0
        terms += [term if is_stable else Term(HELD_KINDS[name], (term.amplitude, reach, n)) for n, term in own.items()]
    held = TermSet(tuple(terms))
    return held if list_held(held) else law


def list_held(law: TermSet) -> list[str]:
    """Return which powers of a law are held: "stiffness", "damping", both or none."""
    return [name for name, kind in HELD_KINDS.items() if any(term.name == kind for term in law.terms)]


def unit_of(letter: str, power: int) -> str:
    """Return the unit of a coefficient, (N/kg^1/2) / (m kg^1/2)^n or (N/kg^1/2) / (m/s kg^1/2)^n, in short.

    The letter is "k" or "c", and the power n.

    >>> unit_of("k", 3), unit_of("c", 2), unit_of("k", 1)
    ('N/(m^3 kg^2)', 'N s^2/(m^2 kg^1.5)', 'N/(m kg)')
    """
    seconds = f" {_raise_to('s', power)}" if letter == "c" else ""
    return f"N{seconds}/({_raise_to('m', power)} {_raise_to('kg', (power + 1) / 2)})"


def unit_per_mass(letter: str, power: int, length: str = "m") -> str:
    """Return the unit of a coefficient per unit mass, (m/s^2) / m^n or (m/s^2) / (m/s)^n, in short.

    The letter is "k" or "c", and the power n; with the length "rad" it is per unit of inertia, and a
    motion in "strain" has that unit in the place of "m".

    >>> unit_per_mass("k", 1), unit_per_mass("k", 3), unit_per_mass("c", 1), unit_per_mass("c", 3)
    ('1/s^2', '1/(s^2 m^2)', '1/s', 's/m^2')
    """
    seconds, metres = (-2 if letter == "k" else power - 2), 1 - power
    exponents = {"s": seconds, length: metres}
    above, below = ([_raise_to(name, abs(n)) for name, n in exponents.items() if n * sign > 0] for sign in (1, -1))
    under = f"({' '.join(below)})" if len(below) > 1 else "".join(below)
    return f"{' '.join(above) or '1'}/{under}"


def _raise_to(name: str, exponent: float) -> str:
    return name if exponent == 1 else f"{name}^{exponent:g}"


def read_linear(coefficients: Mapping[int, Estimate]) -> float:
    """Return the coefficient of the power 1, 0 where it was not fitted."""
    return float(coefficients.get(1, Estimate()).value or 0.0)


def withhold_negative(estimates: Mapping[int, Estimate], given: float = 0.0) -> dict[int, Estimate]:
    """Return coefficients, without the interval of the linear one where it is negative beyond chance.

    No structure at rest has a negative stiffness or damping: the data hold something else, whose error nobody knows.

    Args:
        estimates: coefficients by their power, of which 1 is the linear one.
        given: what the power 1 is a correction of.

    >>> withhold_negative({1: Estimate.normal(-3.0, 1.0)})[1], withhold_negative({1: Estimate.normal(-3.0, 2.0)})[1].std
    (Estimate(value=-3.0, std=None, interval95=None), 2.0)
    """
    linear = estimates.get(1, Estimate())
    if linear.value is not None and linear.std is not None and given + linear.value + 2.0 * linear.std < 0.0:
        return {**estimates, 1: linear.without_interval()}
    return dict(estimates)


def coefficient_rows(
    stiffness: Mapping[int, Estimate], damping: Mapping[int, Estimate], name: str = "", *, length: str = ""
) -> Iterator[SummaryRow]:
    """Yield the coefficients of a mode as rows of a summary: k1, k3, c1, ...

    With a length, "m", "rad" or "strain", they are those of a sensor's motion, per unit of mass or inertia.
    """
    unit = partial(unit_per_mass, length=length) if length else unit_of
    for letter, estimates in (("k", stiffness), ("c", damping)):
        for power, estimate in sorted(estimates.items()):
            yield SummaryRow.of(f"{name}{letter}{power}", estimate, unit(letter, power))


def coefficients_json(
    stiffness: Mapping[int, Estimate], damping: Mapping[int, Estimate], *, length: str = ""
) -> dict[str, Any]:
    """Return `k` and `c` by power, and their units, of a mode, or of a sensor's motion as in `coefficient_rows`."""
    unit, both = partial(unit_per_mass, length=length) if length else unit_of, {"k": stiffness, "c": damping}
    found = {name: {str(power): asdict(each) for power, each in estimates.items()} for name, estimates in both.items()}
    units = {f"{name}{power}": unit(name, power) for name, estimates in both.items() for power in estimates}
    return {**found, "units": units}
