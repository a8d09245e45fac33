"""Terms of a law that trade with stiffness or damping: straight, sharper than the samples tell, or not quite true."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from opid.estimate import Estimate


@dataclass(frozen=True)
class StraightTerm:
    """A term of a law that the motion did not bend, or that turns over between samples: it trades with a linear one.

    Args:
        group: name of the group of interfaces; empty for one gear.
        kind: of the term.
        unit: of its scale, "m/s" or "m".
        scale: its inner scale.
        motion_rms: rms of that motion, in the same unit.
        sharpness: of one that turns over between two samples, the rate at which it stops a motion over that of the
            record; else 0.
        left: of one that remembers and leaves more than the noise, how many times the noise; else 0.
    """

    group: str
    kind: str
    unit: str
    scale: float
    motion_rms: float
    sharpness: float = 0.0
    left: float = 0.0

    @property
    def is_damping(self) -> bool:
        """Whether it cannot be told from damping; else it cannot be told from stiffness."""
        return self.unit == "m/s" or bool(self.sharpness) or bool(self.left)

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
        if self.sharpness:
            return (
                f"{self.kind}{where} turns over faster than the runs were sampled ({self.sharpness:.2g} times their "
                f"rate), so what it does between two samples is not told and may show as {partner}: the intervals of "
                "both are withheld; record at a higher rate"
            )
        if self.left:
            return (
                f"{self.kind}{where} leaves {self.left:.2g} times the noise, so the force that remembers is another "
                "one in part, which may show as damping: the intervals of both are withheld"
            )
        return (
            f"{self.kind}{where} is nearly straight over the visited range (scale {self.scale:.3g} {self.unit}, "
            f"motion {self.motion_rms:.3g} {self.unit} rms) and cannot be told from {partner}: only amplitude over "
            "scale is determined, and the intervals of both are withheld"
        )
