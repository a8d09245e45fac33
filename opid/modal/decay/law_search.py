"""Which terms the law of a decay has: powers, dry friction and a joint with memory, by harmonic linearisation.

The squared natural frequency and the damping coefficient over the amplitude are linear in all coefficients but the
travels and exponents of the joint, so every form of the law is tried by linear least squares, with these on a grid. The
Bayesian criterion ranks the forms.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import NotDeterminedError
from opid.mechanics.backbones.harmonic_balance import first_harmonic_factor
from opid.modal.joint_terms import JointKind, JointTerms, read_memory
from opid.modal.power_laws import HIGHEST_ORDER
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray


@dataclass(frozen=True)
class LawForm:
    """The terms of a law, and where they stand in its vector k, c, friction and values of the joint with memory.

    Args:
        stiffness_order: highest power of the stiffness, 1 where it is linear.
        damping_order: highest power of the damping, 1 where it is linear.
        has_friction: whether there is dry friction.
        memory: the joint with memory; None where there is none.
    """

    stiffness_order: int
    damping_order: int
    has_friction: bool = False
    memory: JointKind | None = None

    @property
    def size(self) -> int:
        """The number of coefficients."""
        return self.stiffness_order + self.damping_order + self.has_friction + self.n_memory

    @property
    def n_memory(self) -> int:
        """The number of coefficients of the joint with memory, which are the last ones."""
        return 0 if self.memory is None else self.memory.n_fitted

    def split(self, vector: FloatArray) -> tuple[FloatArray, FloatArray, JointTerms]:
        """Return k, c and the terms of the joint of a vector; what follows them in the vector is ignored."""
        powers = self.stiffness_order + self.damping_order
        friction = float(vector[powers]) if self.has_friction else 0.0
        joint = JointTerms.of_kind(friction, self.memory, self.take_memory(vector))
        return vector[: self.stiffness_order], vector[self.stiffness_order : powers], joint

    @property
    def prior_score(self) -> float:
        """What the Bayesian criterion adds before any data."""
        powers = self.stiffness_order + self.damping_order - 2
        return MODAL.joint_evidence * (self.has_friction + (self.memory is not None)) + MODAL.power_evidence * powers

    def is_imitated_by_friction(self, n_windows: int) -> bool:
        """Whether so few windows cannot tell friction from the powers of damping, or the slip, beside it."""
        is_alone = self.damping_order == 1 and self.memory is None
        return self.has_friction and not is_alone and n_windows < MODAL.windows_per_term * self.n_damping

    @property
    def n_damping(self) -> int:
        """The number of terms of damping."""
        return self.damping_order + self.has_friction + self.n_memory

    def is_possible(self, vector: FloatArray) -> bool:
        """Whether joints take energy out, slip needs no endless force, and there is stiffness at rest."""
        is_alive = bool(vector[0] > 0.0 and self.split(vector)[2].friction >= 0.0)
        return is_alive and (self.memory is None or self.memory.is_possible(self.take_memory(vector)))

    def may_vibrate(self, vector: FloatArray) -> bool:
        """Whether the averages of the joint exist, so that a search may try this vector."""
        return self.memory is None or self.memory.may_vibrate(self.take_memory(vector))

    def is_determined(self, vector: FloatArray, std: FloatArray) -> bool:
        """Whether friction and slip stand out of their standard deviations, and the exponent is known."""
        first, last = self.stiffness_order + self.damping_order, self.size - self.n_memory
        stands_out = vector[first:last] > MODAL.joint_sigma * std[first:last]
        is_known = self.memory is None or self.memory.is_determined(vector[last : self.size], std[last : self.size])
        return bool(stands_out.all()) and is_known

    def slips_at(self, amplitude: float, vector: FloatArray) -> bool:
        """Whether something in the joint with memory still slips at an amplitude, in the units of the vector."""
        return self.memory is not None and self.memory.slips_at(amplitude, self.take_memory(vector))

    def is_sharp(self, vector: FloatArray) -> bool:
        """Whether the joint with memory yields so sharply that its exponent does not show."""
        return self.memory is not None and self.memory.is_sharp(self.take_memory(vector))

    def take_memory(self, vector: FloatArray) -> tuple[float, ...]:
        """Return the values of the joint with memory."""
        return tuple(vector[self.size - self.n_memory : self.size].tolist())


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
    memory: bool | str | JointKind | None,
    may_imitate: bool = False,
) -> list[tuple[LawForm, FloatArray]]:
    """Return the forms worth a closer look, the likeliest first, and the start values of each.

    Where an order, the friction or the memory is None, all are tried; the memory is one of those of `read_memory`.
    Friction beside terms that few windows cannot tell from it is left out, unless `may_imitate`.

    Raises:
        InputError: a memory that is no kind of joint.
        NotDeterminedError: fewer windows than coefficients of the smallest form.
    """
    orders = [range(1, HIGHEST_ORDER + 1) if each is None else (each,) for each in (stiffness_order, damping_order)]
    joints = ((False, True) if friction is None else (friction,), read_memory(memory))
    tries: list[_Try] = []
    for (n_k, n_c), (has_friction, own) in product(product(*orders), product(*joints)):
        form = LawForm(n_k, n_c, has_friction, own)
        if damping_order is None and not may_imitate and form.is_imitated_by_friction(seen.level.size):
            continue
        if max(form.stiffness_order, form.damping_order + form.has_friction) + form.n_memory < seen.level.size - 1:
            tries += [each for each in _try_form(form, seen) if form.is_possible(each.vector)]
    if not tries:
        raise NotDeterminedError(
            f"{seen.level.size} windows cannot determine {stiffness_order or 1} and {damping_order or 1} coefficients: "
            "lower the orders"
        )
    forms, n = [each.form for each in tries], seen.level.size
    scores = score_misfit([each.of_square for each in tries], n, [form.stiffness_order for form in forms])
    scores += score_misfit([each.of_damping for each in tries], n, [form.size - form.stiffness_order for form in forms])
    scores += [form.prior_score for form in forms]
    ranked = sorted(zip(scores.tolist(), forms, [each.vector for each in tries], strict=True), key=lambda each: each[0])
    # Of the exponents of a form the likeliest comes first; reversed, it is stored last.
    best_of = {form: (score, vector) for score, form, vector in reversed(ranked)}
    found = sorted(((score, form, vector) for form, (score, vector) in best_of.items()), key=lambda each: each[0])
    near = [each for each in found if each[0] < found[0][0] + MODAL.rival_score]
    # Rivals of other kinds come before further orders of the same kind, for they differ most at zero amplitude.
    kinds = {(form.has_friction, form.memory): (form, vector) for _, form, vector in reversed(near)}
    first = [(form, vector) for _, form, vector in near if kinds[form.has_friction, form.memory][0] == form]
    rest = [(form, vector) for _, form, vector in near if kinds[form.has_friction, form.memory][0] != form]
    return [*first, *rest][: MODAL.most_rivals]


def score_misfit(squares: ArrayLike, n_data: int, n_coefficients: ArrayLike) -> FloatArray:
    """Return the Bayesian criterion of forms by their squared errors over the variance; lower is better, (m,).

    The variance of the noise is known; where even the best form misses more than it, that of the best form counts.
    """
    missed, size = np.asarray(squares, dtype=np.float64), np.asarray(n_coefficients)
    variance = max(float(np.min(missed / np.maximum(n_data - size, 1))), 1.0)
    return np.asarray(missed / variance + size * np.log(n_data), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _Try:
    """A form, its coefficients, and the squared errors of squared frequency and of damping over their variance."""

    form: LawForm
    vector: FloatArray
    of_square: float
    of_damping: float


def _try_form(form: LawForm, seen: Linearisation) -> Iterator[_Try]:
    """Yield the coefficients of a form for every start of the exponent, or of the other values, of its joint."""
    size, level = seen.level.size, seen.level
    frequency = np.sqrt(np.maximum(seen.square, 1e-12))
    factors = first_harmonic_factor(np.arange(1, HIGHEST_ORDER + 1))
    for inner in form.memory.list_starts() if form.memory else ((),):
        columns = np.zeros((2 * size, form.size))
        for n in range(form.stiffness_order):
            columns[:size, n] = factors[n] * level**n
        for n in range(form.damping_order):
            columns[size:, form.stiffness_order + n] = factors[n] * seen.speed**n
        place = form.stiffness_order + form.damping_order
        if form.has_friction:
            columns[size:, place] = 4.0 / (np.pi * seen.speed)
            place += 1
        if form.memory:
            # The joint of unit force
            joint = LawForm(0, 0, memory=form.memory).split(np.array([1.0, *inner]))[2]
            columns[:size, place] = -joint.find_softening(level)
            columns[size:, place] = joint.find_damping(level) / frequency
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
        vector = np.append(values, inner)
        yield _Try(form, vector, float(errors[:size].sum()), float(errors[size:].sum()))
