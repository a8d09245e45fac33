"""The polynomials of a nonlinear mode as a `Law`: k_n q |q|^(n-1) and c_n q' |q'|^(n-1), n from 2 up.

Eqs. (9) and (10) of Pacini as printed are even and constant at n = 1, which is no restoring force; eq. (11) has the
columns meant. n = 1 is the linear part: it corrects k0 and c0 and belongs to the mode, not to its law.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from opid.errors import InputError
from opid.estimate import Estimate
from opid.mechanics.laws.law import Law, Term

STIFFNESS_KINDS = {2: "quadratic_stiffness", 3: "cubic_stiffness", 4: "quartic_stiffness", 5: "quintic_stiffness"}
DAMPING_KINDS = {2: "quadratic_damping", 3: "cubic_damping", 4: "quartic_damping", 5: "quintic_damping"}
HIGHEST_ORDER = 5
"""That of the paper's second case; nothing higher was ever told apart from noise."""


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
                raise InputError(f"{letter}{power} is no term of a nonlinear mode: give powers 2 to {HIGHEST_ORDER}")
            terms.append(Term(kinds[power], (value,)))
    return Law(tuple(terms))


def fitted_power_law(stiffness: Mapping[int, Estimate], damping: Mapping[int, Estimate]) -> Law:
    """Return the law of the powers 2 and up among fitted coefficients.

    Args:
        stiffness: k_n by n; 1 is linear.
        damping: c_n by n; 1 is linear.
    """
    of_stiffness, of_damping = (
        {n: float(value.value or 0.0) for n, value in values.items() if n > 1} for values in (stiffness, damping)
    )
    return power_law(of_stiffness, of_damping)


def harmonic_share(power: float) -> float:
    """Return a_n: the fundamental of A^n cos|cos|^(n-1) is a_n A^n cos (harmonic linearisation).

    a_n = (2/sqrt(pi)) Gamma(n/2 + 1) / Gamma(n/2 + 3/2), so that omega^2(A) = sum k_n a_n A^(n-1).

    Args:
        power: n, from 1.

    >>> harmonic_share(1), harmonic_share(3), round(harmonic_share(2) * 3 * math.pi, 12)
    (1.0, 0.75, 8.0)
    """
    share = 2 / math.sqrt(math.pi) * math.gamma(power / 2 + 1) / math.gamma(power / 2 + 1.5)
    return round(share, 15)
