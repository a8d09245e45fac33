"""How modes drive each other: products of modal coordinates in one potential, and of velocities in one dissipation.

    V = sum k_ij.. q_i q_j ..,   D = sum c_ij.. q_i' q_j' ..,   f_m = dV/dq_m + dD/dq_m'

A product k q_i^2 q_j pulls mode j with k q_i^2, at twice the frequency of mode i, and mode i with 2 k q_i q_j: both
follow from one number, so the springs give back what they take. The products of three coordinates are even (a joint
that is softer when it opens), those of four odd. A joint that the modes stretch by z = q_i + r q_j has V = k z^d, whose
products are not independent.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from itertools import combinations_with_replacement, groupby, product
from math import factorial
from typing import Any

import numpy as np

from opid.errors import InputError
from opid.estimate import Estimate
from opid.mechanics.laws.law import law
from opid.mechanics.structure import Joint
from opid.modal.power_laws import unit_of
from opid.result import SummaryRow
from opid.signals.recording import FloatArray

DEGREES = (3, 4)

_LAWS = {
    (False, 3): ("even_quadratic_stiffness", "stiffness_n_per_m2"),
    (False, 4): ("cubic_stiffness", "stiffness_n_per_m3"),
    (True, 4): ("cubic_damping", "damping_n_s3_per_m3"),
}
"""Kind and parameter of the law of a joint, by whether its force follows the velocity, and the degree of V or D."""


@dataclass(frozen=True, order=True)
class Product:
    """A product of modal coordinates in the potential, or of modal velocities in the dissipation.

    Args:
        modes: numbers of the modes, from 1, each as often as it is a factor: (10, 10, 18) is q10^2 q18.
        of_velocity: whether it is a product of velocities.

    Raises:
        InputError: fewer than three factors or more than four, or three velocities, whose product would as often put
            energy in as take it out.

    >>> Product((18, 10, 10)).name
    'k q10^2 q18'
    """

    modes: tuple[int, ...]
    of_velocity: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "modes", tuple(sorted(self.modes)))
        if (self.of_velocity, len(self.modes)) not in _LAWS:
            raise InputError(
                f"the coupling {list(self.modes)} has {len(self.modes)} factors: give three or four modes for a "
                "stiffness, [10, 10, 18] for q10^2 q18, and four for damping"
            )

    @property
    def name(self) -> str:
        """The product as a formula."""
        symbol, dot = ("c", "'") if self.of_velocity else ("k", "")
        counts = {mode: self.modes.count(mode) for mode in self.modes}
        factors = [f"q{mode}{dot}" + (f"^{n}" if n > 1 else "") for mode, n in counts.items()]
        return " ".join([symbol, *factors])

    @property
    def unit(self) -> str:
        """The unit of its coefficient, (N/kg^1/2) / (m kg^1/2)^(d-1) or with m/s, in short."""
        return unit_of("c" if self.of_velocity else "k", len(self.modes) - 1)


@dataclass(frozen=True)
class Coupling:
    """A product with its coefficient.

    Args:
        product: the product of modal coordinates.
        coefficient: its factor in the potential or the dissipation, in the unit of the product.
    """

    product: Product
    coefficient: Estimate

    def as_json(self) -> dict[str, Any]:
        """Return the coupling as result.json holds it."""
        return {"modes": self.product.modes, "of_velocity": self.product.of_velocity, "unit": self.product.unit} | {
            "coefficient": asdict(self.coefficient)
        }

    def row(self) -> SummaryRow:
        """Return the coupling as a row of a summary."""
        return SummaryRow.of(f"couplings.{self.product.name}", self.coefficient, self.product.unit)


def list_products(modes: Sequence[int], degree: int, *, of_velocity: bool = False) -> list[Product]:
    """Return all products of a degree that some modes can have.

    Args:
        modes: numbers of the modes, from 1.
        degree: number of factors.
        of_velocity: whether they are products of velocities.

    >>> [each.name for each in list_products([10, 18], 3)]
    ['k q10^3', 'k q10^2 q18', 'k q10 q18^2', 'k q18^3']
    """
    return [Product(each, of_velocity) for each in combinations_with_replacement(sorted(modes), degree)]


def expand_joint(
    direction: Mapping[int, float], coefficient: float, degree: int, *, of_velocity: bool = False
) -> dict[Product, float]:
    """Return the products of k z^d and their coefficients, for z = sum of direction_m q_m.

    Args:
        direction: stretch of the joint by a unit of each mode, by the number of the mode.
        coefficient: k.
        degree: d, 3 or 4.
        of_velocity: whether z is a velocity, and k z^d the power that is lost.

    >>> expand_joint({1: 1.0, 2: -1.0}, 3.0, 3)[Product((1, 1, 2))]
    -9.0
    """
    found = {}
    for each in list_products(list(direction), degree, of_velocity=of_velocity):
        ways, factor = float(factorial(degree)), coefficient
        for mode in set(each.modes):
            n = each.modes.count(mode)
            ways, factor = ways / factorial(n), factor * direction[mode] ** n
        found[each] = ways * factor
    return found


def make_joints(couplings: Mapping[Product, float], n_modes: int) -> tuple[Joint, ...]:
    """Return joints of a structure in modal coordinates whose forces together are those of the products.

    Any sum of products of one degree is a sum of powers of some z = direction . q, which a joint has.
    """
    ordered = sorted(couplings, key=_find_kind)
    return tuple(
        joint
        for kind, group in groupby(ordered, key=_find_kind)
        for joint in _join(kind, list(group), couplings, n_modes)
    )


def _find_kind(each: Product) -> tuple[bool, int]:
    return each.of_velocity, len(each.modes)


def _join(
    kind: tuple[bool, int], products: list[Product], couplings: Mapping[Product, float], n_modes: int
) -> Iterator[Joint]:
    of_velocity, degree = kind
    modes = sorted({mode for each in products for mode in each.modes})
    directions, weights = _find_powers(len(modes), degree)
    every = list_products(modes, degree, of_velocity=of_velocity)
    amounts = weights @ np.array([couplings.get(each, 0.0) for each in every])
    name, parameter = _LAWS[kind]
    for direction, amount in zip(directions, amounts, strict=True):
        if amount:
            of_all = np.zeros(n_modes)
            of_all[[mode - 1 for mode in modes]] = direction
            # The force is the derivative of amount z^d.
            yield Joint("coupling of modes", of_all, law=law(name, **{parameter: degree * amount}))


@lru_cache(maxsize=32)
def _find_powers(n_modes: int, degree: int) -> tuple[FloatArray, FloatArray]:
    """Return directions (n, n_modes), and the (n, n) matrix from the coefficients of products to those of powers z^d.

    The directions are found one by one: each new one must add a power that the others cannot make.
    """
    indices = list(combinations_with_replacement(range(n_modes), degree))
    chosen: list[FloatArray] = []
    rows: list[FloatArray] = []
    steps = sorted(product((0, 1, -1, 2, -2), repeat=n_modes), key=lambda each: (np.abs(each).sum(), each))
    for step in steps:
        direction = np.array(step, dtype=np.float64)
        numbers = {mode + 1: value for mode, value in enumerate(direction)}
        found = expand_joint(numbers, 1.0, degree)
        row = np.array([found[Product(tuple(index + 1 for index in each))] for each in indices])
        if np.linalg.matrix_rank(np.array([*rows, row])) > len(rows):
            chosen.append(direction)
            rows.append(row)
        if len(rows) == len(indices):
            break
    return np.array(chosen), np.asarray(np.linalg.inv(np.array(rows).T), dtype=np.float64)
