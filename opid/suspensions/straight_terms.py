"""Terms of a law that trade with stiffness or damping: straight, sharper than the samples tell, or not quite true."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from opid.estimate import Estimate
from opid.mechanics.laws import LAWS
from opid.suspensions.candidates import Fitted


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


def find_straight_terms(part: Fitted) -> list[StraightTerm]:
    """Return the terms that are stiffness or damping by another name.

    Their scale lies far beyond the rms motion, or they turn over between two samples.
    """
    fit, loosely_known, settings = part.fit, part.settings.verdicts.loosely_known, part.settings.warnings
    found, run, accelerance = [], fit.model.runs[0], fit.model.mobility(fit.theta, 0).accelerance
    for number, (group, law) in enumerate(zip(fit.groups, fit.laws.values(), strict=True)):
        place = fit.model.law_places(number).start
        travel, velocity = (np.concatenate(part) for part in zip(*map(fit.motion, group.slots), strict=True))
        for term in law.terms:
            std = part.known.std(place)
            place += len(term.values)
            if term.kind.memory is not None and part.residual_over_noise > settings.memory_left:
                first, rms = term.kind.parameters[1], float(travel.std())
                left = part.residual_over_noise
                found.append(StraightTerm(group.name, term.name, first.unit, term.values[1], rms, left=left))
                continue
            for parameter, value in zip(LAWS[term.name].parameters, term.values, strict=True):
                # a kind whose scale may be long by nature bends within it all the same
                if parameter.role != "scale" or parameter.over_rms[1] > settings.usual_reach_rms:
                    continue
                rms = float((velocity if parameter.unit == "m/s" else travel).std())
                if value > settings.straight_rms * rms and std > loosely_known * abs(term.amplitude):
                    found.append(StraightTerm(group.name, term.name, parameter.unit, value, rms))
                if term.kind.memory is not None:
                    # friction that has turned over within the travel from one sample to the next
                    turns = float(velocity.std()) / value if parameter.unit == "m" else 0.0
                else:
                    steepest = abs(term.amplitude * float(term.evaluate(np.array(0.0), np.array(0.0))[2]))
                    turns = steepest * max(accelerance[k, k] for k in group.slots) * (parameter.unit == "m/s")
                sharpness = turns * run.finer / run.recorded_fs
                if sharpness > settings.turnover_between_samples:
                    found.append(StraightTerm(group.name, term.name, parameter.unit, value, rms, sharpness))
    return found
