"""Terms of a law that the motion does not bend: they are stiffness or damping by another name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from opid.estimate import Estimate


@dataclass(frozen=True)
class StraightTerm:
    """A term of a law that the motion did not bend: it trades with a linear one.

    Args:
        group: name of the group of interfaces; empty for one gear.
        kind: of the term.
        unit: of its scale, "m/s" or "m".
        scale: its inner scale.
        motion_rms: rms of that motion, in the same unit.
    """

    group: str
    kind: str
    unit: str
    scale: float
    motion_rms: float

    @property
    def is_damping(self) -> bool:
        """Whether it cannot be told from damping; else it cannot be told from stiffness."""
        return self.unit == "m/s"

    @property
    def trades_with(self) -> tuple[str, ...]:
        """Names of the estimates of a gear, and of an interface, that the term cannot be told from."""
        if self.is_damping:
            return "suspension_damping_n_s_per_m", "damping_per_mass", "damping_ratio", "damping"
        return (
            "suspension_stiffness_n_per_m",
            "stiffness_per_mass",
            "natural_frequency_hz",
            "damping_ratio",
            "stiffness",
        )

    def without_interval(self, laws: Mapping[str, Mapping[str, Estimate]]) -> dict[str, Mapping[str, Estimate]]:
        """Return the estimates of laws, those of the term without their intervals."""
        mine = laws.get(self.kind, {})
        return {**laws, self.kind: {name: estimate.without_interval() for name, estimate in mine.items()}}

    @property
    def warning(self) -> str:
        """What to doubt, one sentence."""
        partner, where = "damping" if self.is_damping else "stiffness", f" at {self.group!r}" * bool(self.group)
        return (
            f"{self.kind}{where} is nearly straight over the visited range (scale {self.scale:.3g} {self.unit}, "
            f"motion {self.motion_rms:.3g} {self.unit} rms) and cannot be told from {partner}: only amplitude over "
            "scale is determined, and the intervals of both are withheld"
        )
