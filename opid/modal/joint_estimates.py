"""What was estimated of the joint of a mode, by free decays or by forced tests."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from opid.estimate import Estimate, Estimates
from opid.modal.joint_terms import JointKind, JointTerms, ModalJoint
from opid.modal.settings import MODAL
from opid.result import SummaryRow

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
