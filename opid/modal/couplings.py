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
from opid.mechanics.laws.law import LINEAR, Term, TermSet, law
from opid.mechanics.structure import Joint
from opid.modal.power_laws import unit_of
from opid.modal.settings import MODAL
from opid.result import SummaryRow
from opid.signals.recording import FloatArray

DEGREES = (3, 4)
N_TIMES = 32  # of a cycle at which a force is averaged

_LAWS = {
    (False, 3): ("even_quadratic_stiffness", "stiffness_n_per_m2"),
    (False, 4): ("cubic_stiffness", "stiffness_n_per_m3"),
    (True, 4): ("cubic_damping", "damping_n_s3_per_m3"),
}
"""Kind and parameter of the law of a joint, by whether its force follows the velocity, and the degree of V or D."""


_HELD_LAWS = {(False, 3): "held_even_stiffness", (False, 4): "held_stiffness", (True, 4): "held_damping"}
"""Kind of the law of a joint that is held, likewise."""


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


@dataclass(frozen=True)
class Reach:
    """How far the tests of some modes moved them; beyond that their couplings are held.

    Args:
        displacement: largest modal displacement by the number of the mode, m kg^1/2.
        velocity: largest modal velocity, m/s kg^1/2.
    """

    displacement: Mapping[int, float]
    velocity: Mapping[int, float]

    def holds(self, product: Product) -> bool:
        """Return whether all modes of a product are among those that were moved."""
        return {*product.modes} <= {*self.displacement}


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


def make_joints(couplings: Mapping[Product, float], n_modes: int, reach: Reach | None = None) -> tuple[Joint, ...]:
    """Return joints of a structure in modal coordinates whose forces together are those of the products.

    Any sum of products of one degree is a sum of powers of some z = direction . q, which a joint has. Products that are
    held keep their forces within the reach of their modes; beyond it the force of each joint continues along its
    secant, as those of powers that are held (`hold_unstable`), and still follows from a potential.

    Args:
        couplings: coefficients of the products.
        n_modes: number of modes of the structure.
        reach: how far modes were moved whose products are held; None where none are.
    """
    held = {each: value for each, value in couplings.items() if reach is not None and reach.holds(each)}
    free = {each: value for each, value in couplings.items() if each not in held}
    return tuple(
        joint
        for some, limits in ((free, None), (held, reach))
        for kind, group in groupby(sorted(some, key=_find_kind), key=_find_kind)
        for joint in _join(kind, list(group), some, n_modes, limits)
    )


def _find_kind(each: Product) -> tuple[bool, int]:
    return each.of_velocity, len(each.modes)


def _join(
    kind: tuple[bool, int],
    products: list[Product],
    couplings: Mapping[Product, float],
    n_modes: int,
    reach: Reach | None,
) -> Iterator[Joint]:
    of_velocity, degree = kind
    modes = sorted({mode for each in products for mode in each.modes})
    directions, weights = _find_powers(len(modes), degree)
    every = list_products(modes, degree, of_velocity=of_velocity)
    # Coordinates that are held are counted in the reach of their modes, so that all of them count alike.
    known = {} if reach is None else reach.velocity if of_velocity else reach.displacement
    size = {mode: float(known.get(mode, 1.0)) for mode in modes}
    values = [couplings.get(each, 0.0) * float(np.prod([size[mode] for mode in each.modes])) for each in every]
    amounts = weights @ np.array(values)
    for direction, amount in zip(directions, amounts, strict=True):
        if amount:
            of_all = np.zeros(n_modes)
            of_all[[mode - 1 for mode in modes]] = direction / [size[mode] for mode in modes]
            # The force is the derivative of amount z^d.
            own = _make_law(kind, degree * float(amount), None if reach is None else float(np.abs(direction).sum()))
            yield Joint("coupling of modes", of_all, law=own)


def _make_law(kind: tuple[bool, int], amplitude: float, most: float | None) -> TermSet:
    """Return the law of a joint, held beyond the stretch `most` unless that is None."""
    if most is None:
        name, parameter = _LAWS[kind]
        return law(name, **{parameter: amplitude})
    exponents = () if kind == (False, 3) else (float(kind[1] - 1),)
    return TermSet((Term(_HELD_LAWS[kind], (amplitude, most, *exponents)),))


def is_stable_beyond(
    couplings: Mapping[Product, float],
    linear: tuple[FloatArray, FloatArray],
    laws: Mapping[int, TermSet],
    reach: Reach,
) -> bool:
    """Return whether coupled modes stay stable between the reach of their tests and `MODAL.stable_up_to` times it.

    They are stable where every small motion about a displacement meets a positive stiffness, and every steady motion a
    positive damping (its first harmonic), in whatever proportion the modes move.

    Args:
        couplings: coefficients of the products, of modes in the reach.
        linear: (n_modes,) k0, 1/s^2, and c0, 1/s, of all modes.
        laws: the law of each mode by itself, by its number.
        reach: how far the tests moved the modes.
    """
    modes = sorted(reach.displacement)
    corners = np.array([each for each in product((-1.0, 0.0, 1.0), repeat=len(modes)) if any(each)])
    times = np.linspace(1.0, MODAL.stable_up_to, 11)
    points = (times[:, None, None] * corners).reshape(-1, len(modes))
    joints = make_joints(couplings, linear[0].size)
    for base, largest, find in (
        (linear[0], reach.displacement, _find_tangent),
        (linear[1], reach.velocity, _find_mean_damping),
    ):
        at = points * [largest[mode] for mode in modes]
        matrix = np.zeros((len(at), len(modes), len(modes)))
        for index, mode in enumerate(modes):
            matrix[:, index, index] = base[mode - 1] + find(laws.get(mode, LINEAR), at[:, index])
        for joint in joints:
            direction = joint.direction[[mode - 1 for mode in modes]]
            matrix += find(joint.law, at @ direction)[:, None, None] * np.outer(direction, direction)
        if np.linalg.eigvalsh(matrix).min() <= 0.0:
            return False
    return True


def _find_tangent(own: TermSet, at: FloatArray) -> FloatArray:
    """Return the slope of a force over the displacement, by differences."""
    if not own.terms:
        return np.zeros(at.size)
    step = 1e-5 * float(np.abs(at).max()) or 1.0
    return np.asarray((own.force(at + step, 0.0) - own.force(at - step, 0.0)) / (2.0 * step), dtype=np.float64)


def _find_mean_damping(own: TermSet, at: FloatArray) -> FloatArray:
    """Return the damping of a cycle with these amplitudes of the velocity, by its first harmonic."""
    if not own.terms:
        return np.zeros(at.size)
    wave = np.cos(2.0 * np.pi / N_TIMES * np.arange(N_TIMES))
    force = own.force(np.zeros((at.size, N_TIMES)), at[:, None] * wave)
    speed = np.where(at == 0.0, 1.0, at)
    return np.asarray(2.0 * np.mean(force * wave, axis=1) / speed, dtype=np.float64)


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
