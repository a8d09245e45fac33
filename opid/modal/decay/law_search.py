"""Which terms the law of a decay has: powers, dry friction and an Iwan joint, by harmonic linearisation.

The squared natural frequency and the damping coefficient over the amplitude are linear in all coefficients but the
exponent of the joint, so every form of the law is tried by linear least squares, with exponents of a grid. The Bayesian
criterion ranks the forms.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from opid.errors import NotDeterminedError
from opid.mechanics.backbones.harmonic_balance import first_harmonic_factor
from opid.modal.decay.slow_flow import JointTerms, slip_damping, slip_softening
from opid.modal.power_laws import HIGHEST_ORDER
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray

EXPONENTS = (-0.8, -0.65, -0.5, -0.35, -0.2, 0.0, 0.2)


@dataclass(frozen=True)
class LawForm:
    """The terms of a law, and where they stand in its vector k, c, friction, slip and exponent.

    Args:
        stiffness_order: highest power of the stiffness, 1 where it is linear.
        damping_order: highest power of the damping, 1 where it is linear.
        has_friction: whether there is dry friction.
        has_memory: whether there is an Iwan joint.
    """

    stiffness_order: int
    damping_order: int
    has_friction: bool = False
    has_memory: bool = False

    @property
    def size(self) -> int:
        """The number of coefficients."""
        return self.stiffness_order + self.damping_order + self.has_friction + 2 * self.has_memory

    def split(self, vector: FloatArray) -> tuple[FloatArray, FloatArray, JointTerms]:
        """Return k, c and the terms of the joint of a vector; what follows them in the vector is ignored."""
        powers = self.stiffness_order + self.damping_order
        friction = float(vector[powers]) if self.has_friction else 0.0
        slip, exponent = vector[powers + self.has_friction : self.size].tolist() if self.has_memory else (0.0, 0.0)
        return (
            vector[: self.stiffness_order],
            vector[self.stiffness_order : powers],
            JointTerms(friction, slip, exponent),
        )

    @property
    def prior_score(self) -> float:
        """What the Bayesian criterion adds before any data."""
        return MODAL.joint_evidence * (self.has_friction + self.has_memory)

    def is_possible(self, vector: FloatArray) -> bool:
        """Whether joints take energy out, slip needs no endless force, and there is stiffness at rest."""
        _, _, joint = self.split(vector)
        lowest, highest = MODAL.slip_exponents
        takes_energy = joint.friction >= 0.0 and joint.slip >= 0.0
        return bool(vector[0] > 0.0 and takes_energy and lowest < joint.exponent < highest)

    def is_determined(self, vector: FloatArray, std: FloatArray) -> bool:
        """Whether friction and slip stand out of their standard deviations, and the exponent is known."""
        first, last = self.stiffness_order + self.damping_order, self.size - self.has_memory
        stands_out = vector[first:last] > MODAL.joint_sigma * std[first:last]
        return bool(stands_out.all() and (not self.has_memory or std[-1] < MODAL.widest_exponent))


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Frequency and damping over amplitude in units in which all coefficients have similar sizes, (n,) each.

    `square` is the squared natural frequency at amplitude `level`, `damping` the coefficient of q' at the speed
    `speed`; the others are their standard deviations.
    """

    level: FloatArray
    square: FloatArray
    square_std: FloatArray
    speed: FloatArray
    damping: FloatArray
    damping_std: FloatArray


def search_forms(
    seen: Linearisation,
    *,
    stiffness_order: int | None,
    damping_order: int | None,
    friction: bool | None,
    memory: bool | None,
) -> list[tuple[LawForm, FloatArray]]:
    """Return the forms worth a closer look, the likeliest first, and the start values of each.

    Where an order, the friction or the memory is None, all are tried.

    Raises:
        NotDeterminedError: fewer windows than coefficients of the smallest form.
    """
    orders = [range(1, HIGHEST_ORDER + 1) if each is None else (each,) for each in (stiffness_order, damping_order)]
    joints = [(False, True) if each is None else (each,) for each in (friction, memory)]
    found: list[tuple[float, LawForm, FloatArray]] = []
    for form in (LawForm(*each) for each in product(*orders, *joints)):
        if (
            max(form.stiffness_order, form.damping_order + form.has_friction) + 2 * form.has_memory
            < seen.level.size - 1
        ):
            tried = [each for each in _try_form(form, seen) if form.is_possible(each[1])]
            found += [(score, form, vector) for score, vector in sorted(tried, key=lambda each: each[0])[:1]]
    if not found:
        raise NotDeterminedError(
            f"{seen.level.size} windows cannot determine {stiffness_order or 1} and {damping_order or 1} coefficients: "
            "lower the orders"
        )
    found.sort(key=lambda each: each[0])
    near = [each for each in found if each[0] < found[0][0] + MODAL.rival_score]
    # Rivals of other kinds come before further orders of the same kind, for they differ most at zero amplitude.
    kinds = {(form.has_friction, form.has_memory): (form, vector) for _, form, vector in reversed(near)}
    first = [(form, vector) for _, form, vector in near if kinds[form.has_friction, form.has_memory][0] == form]
    rest = [(form, vector) for _, form, vector in near if kinds[form.has_friction, form.has_memory][0] != form]
    return [*first, *rest][: MODAL.most_rivals]


def score_misfit(squares: float, n_data: int, n_coefficients: int) -> float:
    """Return the Bayesian criterion of a sum of squared errors over their variance; lower is better."""
    # Windows overlap by half, so three are worth about two.
    n = 0.67 * n_data
    return float(n * np.log(max(squares / n_data, 0.5)) + n_coefficients * np.log(n))


def _try_form(form: LawForm, seen: Linearisation) -> Iterator[tuple[float, FloatArray]]:
    """Yield criterion and coefficients of a form for every exponent of its joint."""
    size, level = seen.level.size, seen.level
    frequency = np.sqrt(np.maximum(seen.square, 1e-12))
    factors = first_harmonic_factor(np.arange(1, HIGHEST_ORDER + 1))
    for exponent in EXPONENTS if form.has_memory else (0.0,):
        columns = np.zeros((2 * size, form.size))
        for n in range(form.stiffness_order):
            columns[:size, n] = factors[n] * level**n
        for n in range(form.damping_order):
            columns[size:, form.stiffness_order + n] = factors[n] * seen.speed**n
        place = form.stiffness_order + form.damping_order
        if form.has_friction:
            columns[size:, place] = 4.0 / (np.pi * seen.speed)
            place += 1
        if form.has_memory:
            slipped = level ** (1.0 + exponent)
            columns[:size, place] = -slip_softening(exponent) * slipped
            columns[size:, place] = slip_damping(exponent) * slipped / frequency
            columns = columns[:, : place + 1]
        std = np.concatenate(
            [
                np.maximum(each, 1e-12 * float(np.median(np.abs(y))) + 1e-300)
                for y, each in ((seen.square, seen.square_std), (seen.damping, seen.damping_std))
            ]
        )
        y = np.concatenate([seen.square, seen.damping])
        values = np.asarray(np.linalg.lstsq(columns / std[:, None], y / std, rcond=1e-12)[0], dtype=np.float64)
        errors = ((y - columns @ values) / std) ** 2
        score = score_misfit(float(errors[:size].sum()), size, form.stiffness_order)
        score += score_misfit(float(errors[size:].sum()), size, form.size - form.stiffness_order)
        score += form.prior_score
        yield score, np.append(values, exponent) if form.has_memory else values
