"""What a joint adds to the powers of a mode: dry friction, slip of an Iwan joint, and kinds of law with memory.

What was estimated of such a joint, by free decays or by forced tests, is one record.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

import numpy as np
from scipy.special import beta, betainc

from opid.errors import InputError, nearest
from opid.estimate import Estimate, Estimates
from opid.mechanics.backbones.harmonic_balance import first_harmonic_factor
from opid.mechanics.laws.kind import Parameter
from opid.mechanics.laws.kinds import LAWS
from opid.mechanics.laws.law import LINEAR, Law, Term
from opid.mechanics.memory import find_steady_loop
from opid.mechanics.structure import Sliders
from opid.modal.settings import MODAL, SIMULATED
from opid.result import SummaryRow
from opid.signals.recording import FloatArray

Values = tuple[float, ...]
IWAN = "iwan_friction"
_ANGLES = 64  # of a quarter of a cycle, over which a loss is averaged


@dataclass(frozen=True)
class JointKind:
    """A joint with memory as a part of a law, and which of its parameters are fitted.

    Args:
        name: "slip" for the slip of an Iwan joint that has no end (`JointTerms`), or the name of a kind of law, whose
            forces are per unit mass.
        n_fitted: how many of its parameters are fitted, the first ones.
        held: the values of the others. An Iwan joint whose `jump` is infinite is one slider, a Jenkins element.
        words: what the joint is called.
    """

    name: str
    n_fitted: int
    held: Values
    words: str

    @property
    def is_slip(self) -> bool:
        """Whether it is slip without an end."""
        return self.name == "slip"

    @property
    def has_jump(self) -> bool:
        """Whether it is an Iwan joint of which a part slides at once, at the end, and that part is fitted."""
        return self.name == IWAN and not self.held

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of the kind of law that are fitted; none of slip without an end."""
        return () if self.is_slip else LAWS[self.name].parameters[: self.n_fitted]

    def complete(self, fitted: Values) -> Values:
        """Return all parameters of the kind, the amplitude and the travel first."""
        return (*fitted, *self.held)

    def find_factors(self, values: Values, force: float, length: float) -> Values:
        """Return what leads from values that are counted in a force and a length to SI units."""
        if self.is_slip:
            return force / length ** (2.0 + values[1]), 1.0
        return (force, length, 1.0, 1.0)[: self.n_fitted]

    def count_powers(self, values: Values) -> Values:
        """Return the power of the motion whose force each value makes, 0 of a travel; 1 of a value without a unit."""
        return (2.0 + values[1], 1.0) if self.is_slip else (0.0, 0.0, 1.0, 1.0)[: self.n_fitted]

    def may_vibrate(self, values: Values) -> bool:
        """Whether the averages of a joint of these values over a cycle exist."""
        if self.is_slip:
            return values[1] > -1.0
        _, travel, *inner = self.complete(values)
        if not _is_within(travel, MODAL.searched_travels):
            return False
        if self.name == IWAN:
            return _is_within(inner[0], MODAL.searched_spreads) and inner[1] > MODAL.least_jump
        return not inner or _is_within(inner[0], MODAL.searched_sharpness)

    @property
    def ranges(self) -> tuple[tuple[float, float], ...]:
        """The range of each value that a joint may have: it takes energy out and needs no endless force."""
        force, (lowest, highest) = (0.0, math.inf), MODAL.slip_exponents
        if self.is_slip:
            return force, (lowest, highest)
        spread, sharpness = (1.0 / (2.0 + highest), 1.0 / (2.0 + lowest)), (1.0, MODAL.searched_sharpness[1])
        inner = (spread, (0.0, math.inf)) if self.name == IWAN else (sharpness,)
        return (force, MODAL.searched_travels, *inner)[: self.n_fitted]

    def is_possible(self, values: Values) -> bool:
        """Whether a joint may have these values."""
        is_inside = all(low <= value <= high for value, (low, high) in zip(values, self.ranges, strict=True))
        return is_inside and self.may_vibrate(values)

    def is_determined(self, values: FloatArray, std: FloatArray) -> bool:
        """Whether all values stand out of their standard deviations, and the largest motion, 1, makes all slide."""
        if self.is_slip:
            return bool(values[0] > MODAL.joint_sigma * std[0] and std[1] < MODAL.widest_exponent)
        # A jump may be none.
        stands_out = (values > MODAL.joint_sigma * std)[: 3 if self.has_jump else None]
        has_spread = self.name == IWAN and self.n_fitted > 2
        # The exponent of the slip is 1 / spread - 2.
        knows_spread = not has_spread or std[2] < MODAL.widest_exponent * values[2] ** 2
        return bool(stands_out.all() and knows_spread and values[1] < 1.0)

    def is_sharp(self, values: Values) -> bool:
        """Whether it is a joint of Bouc and Wen that yields almost as one slider does."""
        return self.name == "bouc_wen" and values[2] > MODAL.sharp_exponent

    def slips_at(self, amplitude: float, values: Values) -> bool:
        """Whether something still slips at an amplitude, so that the law at rest is an extrapolation."""
        return self.is_slip or (self.name == IWAN and self.n_fitted > 2) or amplitude > values[1]

    def list_starts(self) -> Iterator[Values]:
        """Yield the values after the first with which a search begins, for a largest displacement of 1."""
        grids = (MODAL.first_spreads, MODAL.first_jumps) if self.name == IWAN else (MODAL.first_sharpness,)
        first = (MODAL.first_exponents,) if self.is_slip else (MODAL.first_travels, *grids)
        yield from product(*first[: self.n_fitted - 1])


def _is_within(value: float, ends: tuple[float, float]) -> bool:
    return ends[0] < value < ends[1]


JOINT_KINDS: Mapping[str, tuple[JointKind, ...]] = {
    IWAN: (
        JointKind(IWAN, 4, (), "an Iwan joint that slides as a whole"),
        JointKind(IWAN, 3, (0.0,), "an Iwan joint that slides as a whole, without a jump"),
        JointKind(IWAN, 2, (0.5, math.inf), "one slider with a spring (Jenkins)"),
    ),
    "dahl_friction": (JointKind("dahl_friction", 2, (), "friction that bends before it slides (Dahl)"),),
    # The shape 1/2 unloads along a straight line; loops of other shapes differ too little in one cycle.
    "bouc_wen": (JointKind("bouc_wen", 3, (0.5,), "a joint that yields (Bouc and Wen, shape 1/2)"),),
}
"""By the name of the kind of law: a joint, and what it becomes at its limits."""
SLIP = JointKind("slip", 2, (), "slip of an Iwan joint")
TOO_SHARP = (
    f"the joint yields so sharply (an exponent above {MODAL.sharp_exponent:g}) that it is hardly told from one slider "
    "with a spring (Jenkins), whose exponent has no end: the exponent has no interval"
)


def read_memory(memory: bool | str | JointKind | None) -> tuple[JointKind | None, ...]:
    """Return the joints with memory of which a law may have one.

    Args:
        memory: False for none, True for slip without an end, None for both choices, a kind, or the name of kinds.

    Raises:
        InputError: a name that is no such kind, or of a kind that decays cannot show.
    """
    if isinstance(memory, JointKind):
        return (memory,)
    if not isinstance(memory, str):
        return (None, SLIP) if memory is None else (SLIP if memory else None,)
    if memory == "maxwell_arm":
        raise InputError(
            "memory is 'maxwell_arm', which is linear: a decay at one frequency shows only its sum with k0 and c0; "
            "leave memory out"
        )
    if memory not in JOINT_KINDS:
        raise InputError(f"memory is {memory!r}, which is no joint of a mode: {nearest(memory, JOINT_KINDS)}")
    return JOINT_KINDS[memory]


def find_joint_curves(name: str, values: Values, amplitude: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return by how much a joint lowers the secant stiffness from that at rest, and omega times the damping it adds.

    Both are averages over a steady cycle, the stiffness per unit mass, for amplitudes (n,) or (n, 1).

    Args:
        name: a kind of `JOINT_KINDS`.
        values: all its parameters.
        amplitude: amplitudes of the displacement, 0 or more.
    """
    force, travel, *inner = values
    amplitude = np.maximum(amplitude, 1e-9 * travel)
    if name == IWAN:
        slip, exponent, jump = split_iwan(values)
        m = np.minimum(amplitude, travel)
        softening = slip * amplitude ** (1.0 + exponent) * slip_softening(exponent, m / amplitude)
        energy = slip * (
            amplitude * m ** (2.0 + exponent) / (2.0 + exponent) - m ** (3.0 + exponent) / (3.0 + exponent)
        )
        softening = softening + jump * lose_stiffness(m / amplitude) * (amplitude > travel)
        energy = 4.0 * (energy + jump * travel * np.maximum(amplitude - travel, 0.0))
    else:
        loop, over = find_steady_loop(name, *inner), amplitude / travel
        softening = force / travel * (1.0 - loop.find_stiffness(over))
        energy = force * travel * loop.find_area(over)
    return softening, energy / (np.pi * amplitude**2)


def split_iwan(values: Values) -> tuple[float, float, float]:
    """Return R and chi of the slip of `iwan_friction` up to its end, and the stiffness that slides there at once.

    >>> [round(each, 6) for each in split_iwan((2.0, 0.5, 0.5, 1.0))]
    [8.0, 0.0, 2.0]
    """
    force, travel, spread, jump = values
    exponent, gradual = 1.0 / spread - 2.0, 1.0 / (1.0 + jump)
    return (
        force * gradual / (spread * travel ** (2.0 + exponent)),
        exponent,
        force * (1.0 - gradual) / travel,
    )


def find_rest_stiffness(name: str, values: Values) -> float:
    """Return the stiffness of a joint while nothing slides, per unit mass."""
    if name != IWAN:
        return values[0] / values[1]
    slip, exponent, jump = split_iwan(values)
    return slip * values[1] ** (1.0 + exponent) / (1.0 + exponent) + jump


def load_joint(name: str, values: Values, displacement: FloatArray) -> FloatArray:
    """Return the force of a joint on first loading, per unit mass, at displacements of 0 or more.

    Args:
        name: a kind of `JOINT_KINDS`.
        values: all its parameters.
        displacement: from the position in which nothing has slid.
    """
    force, travel, *inner = values
    if name != IWAN:
        return force * find_steady_loop(name, *inner).find_force(displacement / travel)
    slip, exponent, _ = split_iwan(values)
    reached = np.minimum(displacement, travel)
    lost = slip * reached ** (2.0 + exponent) / ((1.0 + exponent) * (2.0 + exponent))
    return find_rest_stiffness(name, values) * reached - lost


def lose_stiffness(travel: FloatArray) -> FloatArray:
    """Return the fraction of its stiffness that a slider loses, by its slip travel over the amplitude, 0 to 1."""
    angle = np.arccos(1.0 - 2.0 * travel)
    return np.asarray(1.0 - (angle - 0.5 * np.sin(2.0 * angle)) / np.pi)


def slip_softening(exponent: float, reach: float | FloatArray = 1.0) -> FloatArray:
    """Return what slip takes from the secant stiffness, over R A^(1 + chi).

    It is the mean over the sliders of the first harmonic of a Jenkins element.

    Args:
        exponent: chi.
        reach: largest slip travel over the amplitude, at most 1.

    >>> float(np.round(slip_softening(0.0), 4))  # evenly spread sliders lose half of their fraction that slips
    0.5
    """
    a, b, power = exponent + 2.5, 1.5, 1.0 + exponent
    lost = 8.0 / np.pi * beta(a, b) * betainc(a, b, reach)
    return np.asarray((lost + np.power(reach, power) * lose_stiffness(np.asarray(reach))) / power)


def slip_damping(exponent: float) -> float:
    """Return omega times the damping that slip adds, over R A^(1 + chi).

    >>> round(slip_damping(0.0), 4)
    0.2122
    """
    return float(4.0 / (np.pi * (2.0 + exponent) * (3.0 + exponent)))


@dataclass(frozen=True)
class JointTerms:
    """What a joint adds to the powers: dry friction, and the slip of an Iwan joint.

    Dry friction is F sgn(q'). The Iwan joint has sliders whose slip travels x are spread as R x^chi (Segalman 2005, J.
    Appl. Mech. 72, 752): they carry K q - R |q|^(2 + chi) / ((1 + chi) (2 + chi)) on first loading, where K belongs to
    k0, and lose 4 R A^(3 + chi) / ((2 + chi) (3 + chi)) in a cycle.

    Args:
        friction: F, force per unit mass.
        slip: R, force per unit mass over displacement^(2 + chi).
        exponent: chi, above -1; 0 spreads the sliders evenly.
        kind: name of a kind of `JOINT_KINDS` that stands in the place of slip without an end, "" for none; its
            stiffness while nothing slides belongs to k0.
        values: all parameters of that kind, with forces per unit mass.
    """

    friction: float = 0.0
    slip: float = 0.0
    exponent: float = 0.0
    kind: str = ""
    values: Values = ()

    @classmethod
    def of_kind(cls, friction: float, kind: JointKind | None, values: Values) -> JointTerms:
        """Return friction beside a joint of a kind, of which `values` are those that are fitted."""
        if kind is None:
            return cls(friction)
        if kind.is_slip:
            return cls(friction, values[0], values[1])
        return cls(friction, kind=kind.name, values=kind.complete(values))

    def find_softening(self, amplitude: FloatArray) -> FloatArray:
        """Return by how much joints lower the secant stiffness at amplitudes, force per unit mass over displacement."""
        slipped = self.slip * slip_softening(self.exponent) * amplitude ** (1.0 + self.exponent)
        return slipped + find_joint_curves(self.kind, self.values, amplitude)[0] if self.kind else slipped

    def find_slip_force(self, displacement: FloatArray) -> FloatArray:
        """Return what slip takes from the force K q on first loading at displacements, force per unit mass."""
        taken = self.slip * displacement ** (2.0 + self.exponent) / ((1.0 + self.exponent) * (2.0 + self.exponent))
        if not self.kind:
            return taken
        rest = find_rest_stiffness(self.kind, self.values)
        return taken + rest * displacement - load_joint(self.kind, self.values, displacement)

    def find_damping(self, amplitude: FloatArray) -> FloatArray:
        """Return what friction and joints add to omega c(A) at amplitudes, where c is the coefficient of q'."""
        slipped = self.slip * slip_damping(self.exponent) * amplitude ** (1.0 + self.exponent)
        lost = 4.0 * self.friction / (np.pi * amplitude) + slipped
        return lost + find_joint_curves(self.kind, self.values, amplitude)[1] if self.kind else lost

    def find_loss_force(self, displacement: FloatArray) -> FloatArray:
        """Return a force of the velocity alone that loses what friction and joints lose, force per unit mass.

        Friction is such a force by itself. Slip loses as much as a power 2 + chi of the velocity. Where a joint loses
        E(A) in a cycle, the force at the speed of a displacement x is the mean of E'(x cos t) / 4, t from 0 to pi/2.

        Args:
            displacement: the amplitudes of the cycles that have these velocities, q'/omega; 0 or more.
        """
        power = 2.0 + self.exponent
        slipped = self.slip * slip_damping(self.exponent) / first_harmonic_factor(power) * displacement**power
        lost = self.friction * np.sign(displacement) + slipped
        if not self.kind:
            return lost
        angle = 0.5 * np.pi * (np.arange(_ANGLES) + 0.5) / _ANGLES
        amplitude = np.maximum(displacement[..., None] * np.cos(angle), 1e-6 * self.values[1])
        below, above = (
            near**2 * find_joint_curves(self.kind, self.values, near)[1]
            for near in (0.999 * amplitude, 1.001 * amplitude)
        )
        return lost + 0.25 * np.pi * np.mean((above - below) / (0.002 * amplitude), axis=-1)


@dataclass(frozen=True)
class ModalJoint:
    """The joint of a mode in a model that can be simulated.

    Args:
        terms: friction and slip.
        largest: largest displacement of the tests that show them; what slips only beyond twice that stays stuck.
    """

    terms: JointTerms
    largest: float

    @property
    def law(self) -> Law:
        """The force of a named joint that is no set of sliders, per unit mass, as a law; linear where there is none."""
        if self.terms.kind in ("", IWAN):
            return LINEAR
        return Law((Term(self.terms.kind, self.terms.values),))

    @property
    def sliders(self) -> Sliders | None:
        """The joint as Jenkins elements; None without any. `stuck_stiffness` of k0 is theirs and that of `law`."""
        stiffness, slip_force = self._spread()
        if self.terms.friction > 0.0:
            stiffness = np.append(stiffness, self.terms.friction / (SIMULATED.friction_travel * self.largest))
            slip_force = np.append(slip_force, self.terms.friction)
        return Sliders(stiffness, slip_force) if stiffness.size else None

    @property
    def stuck_stiffness(self) -> float:
        """The part of k0 that the joint carries while nothing slides, up to twice the largest displacement."""
        of_law = find_rest_stiffness(self.terms.kind, self.terms.values) if self.law.terms else 0.0
        return float(self._spread()[0].sum()) + of_law

    @property
    def quickness(self) -> float:
        """By how much the memory of its law may change over a displacement, 1 / displacement; 0 without one."""
        _, travel, *inner = self.terms.values if self.law.terms else (0.0, math.inf)
        return max(1.0, *inner[:1], 0.0) / travel

    def _spread(self) -> tuple[FloatArray, FloatArray]:
        """Return stiffness and slip force of the elements, (n,) each; both are exact in each range of travels."""
        slip, exponent, jump, end = self.terms.slip, self.terms.exponent, 0.0, np.inf
        if self.terms.kind == IWAN:
            (slip, exponent, jump), end = split_iwan(self.terms.values), self.terms.values[1]
        stiffness, slip_force = np.zeros(0), np.zeros(0)
        if slip > 0.0:
            edges = self.largest * np.concatenate([[0.0], np.geomspace(*SIMULATED.slip_travels, SIMULATED.sliders)])
            edges = np.unique(np.minimum(edges, end))
            first, second = exponent + 1.0, exponent + 2.0
            stiffness, slip_force = (slip / power * np.diff(edges**power) for power in (first, second))
        if jump > 0.0:
            stiffness, slip_force = np.append(stiffness, jump), np.append(slip_force, jump * end)
        return stiffness, slip_force


ABSENT = Estimate()


@dataclass(frozen=True)
class JointEstimates(Estimates):
    """What was estimated of a joint; forces are per unit mass, or modal forces.

    Args:
        friction: dry friction F; empty where there is none.
        kind: the joint with memory; None for none.
        values: its values: R, force over displacement^(2 + chi), and chi of slip without an end, or those of a named
            kind in the order of its parameters, the largest force and the travel at which it slides first. The
            stiffness that a joint has while nothing slides belongs to k0.
    """

    friction: Estimate = ABSENT
    kind: JointKind | None = None
    values: tuple[Estimate, ...] = ()

    @property
    def slip(self) -> Estimate:
        """R of an Iwan joint whose slip has no end; empty without one."""
        return self.values[0] if self.kind and self.kind.is_slip else ABSENT

    @property
    def slip_exponent(self) -> Estimate:
        """The exponent chi of that joint; empty without one."""
        return self.values[1] if self.kind and self.kind.is_slip else ABSENT

    @property
    def named(self) -> JointKind | None:
        """The joint of a named kind, in the place of slip without an end; None for none."""
        return None if self.kind is None or self.kind.is_slip else self.kind

    @property
    def stands_out(self) -> bool:
        """Whether force and travel of a named kind, if there is one, stand out of their standard deviations."""
        first = self.values[:2] if self.named else ()
        return all(float(each.value or 0.0) > MODAL.joint_sigma * float(each.std or 0.0) for each in first)

    @property
    def terms(self) -> list[str]:
        """The names of what the joint adds to the powers."""
        of_friction = [] if self.friction.value is None else ["friction"]
        return of_friction + ([] if self.kind is None else [self.kind.name])

    def make(self, largest: float) -> ModalJoint:
        """Return the joint, ready to be simulated, of a mode whose tests have this largest displacement."""
        values = tuple(float(each.value or 0.0) for each in self.values)
        return ModalJoint(JointTerms.of_kind(float(self.friction.value or 0.0), self.kind, values), largest)

    def list_values(self, force: str, length: str) -> Iterator[tuple[str, Estimate, str]]:
        """Yield name, estimate and unit of friction and of the values of the joint, where there are any.

        Args:
            force: the unit of force.
            length: the unit of displacement.
        """
        if self.friction.value is not None:
            yield "friction", self.friction, force
        if self.slip.value is not None:
            power = 2.0 + float(self.slip_exponent.value or 0.0)
            yield "slip", self.slip, f"{force} / {length.replace(' ', '*')}^{power:.3g}"
            yield "slip_exponent", self.slip_exponent, "1"
        for name, unit, estimate in self._list_named():
            yield f"{self.kind.name if self.kind else ''}.{name}", estimate, {"N": force, "m": length}.get(unit, unit)

    def list_rows(self, name: str = "") -> Iterator[SummaryRow]:
        """Yield the joint of a mode as rows of a summary; `name` stands before their names."""
        for label, estimate, unit in self.list_values("N/kg^1/2", "m kg^1/2"):
            yield SummaryRow.of(f"{name}{label}", estimate, unit)

    def as_json(self, prefix: str = "") -> dict[str, Any]:
        """Return the joint as result.json holds it; `prefix` stands before the keys of a named kind."""
        return {
            **{name: asdict(getattr(self, name)) for name in ("friction", "slip", "slip_exponent")},
            f"{prefix}kind": None if self.named is None else self.named.name,
            f"{prefix}values": {name: asdict(estimate) for name, _, estimate in self._list_named()},
        }

    def _list_named(self) -> Iterator[tuple[str, str, Estimate]]:
        """Yield name, unit and estimate of each value of a named kind."""
        if self.named is not None:
            for parameter, estimate in zip(self.named.parameters, self.values, strict=True):
                yield parameter.words, parameter.unit, estimate
