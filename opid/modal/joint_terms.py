"""What a joint adds to the powers of a mode: dry friction, and the slip of an Iwan joint, as terms with a memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import beta

from opid.estimate import Estimate
from opid.mechanics.backbones.harmonic_balance import first_harmonic_factor
from opid.mechanics.structure import Sliders
from opid.modal.settings import SIMULATED
from opid.result import SummaryRow
from opid.signals.recording import FloatArray


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
    """

    friction: float = 0.0
    slip: float = 0.0
    exponent: float = 0.0

    def find_softening(self, amplitude: FloatArray) -> FloatArray:
        """Return by how much slip lowers the secant stiffness at amplitudes, force per unit mass over displacement."""
        return self.slip * slip_softening(self.exponent) * amplitude ** (1.0 + self.exponent)

    def find_slip_force(self, displacement: FloatArray) -> FloatArray:
        """Return what slip takes from the force K q on first loading at displacements, force per unit mass."""
        return self.slip * displacement ** (2.0 + self.exponent) / ((1.0 + self.exponent) * (2.0 + self.exponent))

    def find_damping(self, amplitude: FloatArray) -> FloatArray:
        """Return what friction and slip add to omega c(A) at amplitudes, where c is the coefficient of q'."""
        slipped = self.slip * slip_damping(self.exponent) * amplitude ** (1.0 + self.exponent)
        return 4.0 * self.friction / (np.pi * amplitude) + slipped

    def find_loss_force(self, displacement: FloatArray) -> FloatArray:
        """Return a force of the velocity alone that loses what friction and slip lose, force per unit mass.

        Friction is such a force by itself. Slip loses as much as a power 2 + chi of the velocity.

        Args:
            displacement: the amplitudes of the cycles that have these velocities, q'/omega; 0 or more.
        """
        power = 2.0 + self.exponent
        slipped = self.slip * slip_damping(self.exponent) / first_harmonic_factor(power) * displacement**power
        return self.friction * np.sign(displacement) + slipped


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
    def sliders(self) -> Sliders | None:
        """The joint as Jenkins elements; None without any term. `stuck_stiffness` of k0 is theirs."""
        stiffness, slip_force = self._spread()
        if self.terms.friction > 0.0:
            stiffness = np.append(stiffness, self.terms.friction / (SIMULATED.friction_travel * self.largest))
            slip_force = np.append(slip_force, self.terms.friction)
        return Sliders(stiffness, slip_force) if stiffness.size else None

    @property
    def stuck_stiffness(self) -> float:
        """The part of k0 that the elements of slip carry while they are stuck."""
        return float(self._spread()[0].sum())

    def _spread(self) -> tuple[FloatArray, FloatArray]:
        """Return stiffness and slip force of the elements, (n,) each; both are exact in each range of travels."""
        if not self.terms.slip > 0.0:
            return np.zeros(0), np.zeros(0)
        edges = self.largest * np.concatenate([[0.0], np.geomspace(*SIMULATED.slip_travels, SIMULATED.sliders)])
        first, second = self.terms.exponent + 1.0, self.terms.exponent + 2.0
        return self.terms.slip / first * np.diff(edges**first), self.terms.slip / second * np.diff(edges**second)


def make_joint(friction: Estimate, slip: Estimate, exponent: Estimate, largest: float) -> ModalJoint:
    """Return the joint of estimates, of which those without a value are absent."""
    return ModalJoint(JointTerms(*(float(each.value or 0.0) for each in (friction, slip, exponent))), largest)


def joint_rows(friction: Estimate, slip: Estimate, exponent: Estimate, name: str = "") -> Iterator[SummaryRow]:
    """Yield friction, slip and its exponent as rows of a summary, those that have a value.

    Args:
        friction: dry friction, N/kg^1/2.
        slip: R of an Iwan joint, in SI.
        exponent: chi of that joint.
        name: what stands before their names.
    """
    for label, estimate, unit in (
        ("friction", friction, "N/kg^1/2"),
        ("slip", slip, "SI"),
        ("slip_exponent", exponent, "1"),
    ):
        if estimate.value is not None:
            yield SummaryRow.of(f"{name}{label}", estimate, unit)


def slip_softening(exponent: float) -> float:
    """Return what slip takes from the secant stiffness, over R A^(1 + chi).

    It is the mean over the sliders of the first harmonic of a Jenkins element.

    >>> round(slip_softening(0.0), 4)  # evenly spread sliders lose half of their fraction that slips
    0.5
    """
    return float(8.0 / (np.pi * (1.0 + exponent)) * beta(exponent + 2.5, 1.5))


def slip_damping(exponent: float) -> float:
    """Return omega times the damping that slip adds, over R A^(1 + chi).

    >>> round(slip_damping(0.0), 4)
    0.2122
    """
    return float(4.0 / (np.pi * (2.0 + exponent) * (3.0 + exponent)))
