"""Terms of a law that the runs do not tell from stiffness or damping, and stops that no run reaches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from opid.estimate import Estimate
from opid.mechanics.laws import Law, Term
from opid.signals.recording import FloatArray
from opid.suspensions.candidates import Fitted
from opid.suspensions.fit import Fit
from opid.suspensions.law_parameters import not_reached, way_to_stop


@dataclass(frozen=True)
class ConfoundedTerm:
    """A term of a law whose force may be stiffness or damping by another name: the intervals of both are withheld.

    Args:
        group: name of the group of interfaces; empty for one gear.
        kind: of the term.
        partner: what it is confounded with; None for a stop that was not reached, which has no values.
        reason: why, the middle of a sentence that begins with the kind; all of its rest without a partner.
        remedy: what to do, the end of that sentence; empty where nothing helps.
    """

    group: str
    kind: str
    partner: Literal["stiffness", "damping"] | None
    reason: str
    remedy: str = ""

    @property
    def confounded_with(self) -> tuple[str, ...]:
        """Names of the estimates of a gear, and of an interface, that have no interval beside the term."""
        if self.partner is None:
            return ()
        if self.partner == "damping":
            return "suspension_damping_n_s_per_m", "damping_per_mass", "damping_ratio", "damping"
        return (
            "suspension_stiffness_n_per_m",
            "stiffness_per_mass",
            "natural_frequency_hz",
            "damping_ratio",
            "stiffness",
        )

    def without_interval(self, laws: Mapping[str, Mapping[str, Estimate]]) -> dict[str, Mapping[str, Estimate]]:
        """Return the estimates of laws, the term's without intervals, a stop's that was not reached without values.

        Args:
            laws: estimates by kind and parameter.
        """
        mine = laws.get(self.kind, {})
        if self.partner is None:
            return {**laws, self.kind: dict.fromkeys(mine, Estimate())}
        return {**laws, self.kind: {name: estimate.without_interval() for name, estimate in mine.items()}}

    @property
    def warning(self) -> str:
        """What to doubt, one sentence."""
        if self.partner is None:
            return f"{self.kind}{f' at {self.group!r}' * bool(self.group)} {self.reason}"
        where, remedy = f" at {self.group!r}" * bool(self.group), f"; {self.remedy}" * bool(self.remedy)
        return f"{self.kind}{where} {self.reason}: the intervals of both are withheld{remedy}"


def straight_term(group: str, kind: str, unit: str, scale: float, motion_rms: float) -> ConfoundedTerm:
    """Return a term that the motion did not bend.

    Args:
        group: of interfaces.
        kind: of the term.
        unit: of its scale: "m/s" for a law of the velocity, else "m".
        scale: its inner scale.
        motion_rms: rms of the motion, in the same unit.
    """
    partner: Literal["stiffness", "damping"] = "damping" if unit == "m/s" else "stiffness"
    reason = (
        f"is nearly straight over the visited range (scale {scale:.3g} {unit}, motion {motion_rms:.3g} {unit} rms), so "
        f"that only amplitude over scale is determined and it cannot be told from {partner}"
    )
    return ConfoundedTerm(group, kind, partner, reason)


def find_confounded_terms(part: Fitted) -> list[ConfoundedTerm]:
    """Return the terms of a fit that may be stiffness or damping by another name.

    Args:
        part: a fitted structure.
    """
    found: list[ConfoundedTerm] = []
    for number, law in enumerate(part.fit.laws.values()):
        place = part.fit.model.law_places(number).start
        for term in law.terms:
            found += _confounded(part, number, term, part.known.std(place))
            place += len(term.values)
    return found


def _confounded(part: Fitted, number: int, term: Term, std: float) -> Iterator[ConfoundedTerm]:
    """What a term is confounded with, and why; `std` is that of its amplitude."""
    group, settings = part.fit.groups[number], part.settings.warnings
    is_loose = std > part.settings.verdicts.loosely_known * abs(term.amplitude)
    if term.kind.is_stop:
        travels = _travels(part.fit, number)
        if is_loose or not any(Law((term,)).force(travel, 0.0).any() for travel in travels):
            way_m = max(way_to_stop(term, travel) for travel in travels)
            yield ConfoundedTerm(group.name, term.name, None, not_reached(way_m))
        return
    if term.kind.memory is not None and part.residual_over_noise > settings.memory_left:
        reason = (
            f"leaves {part.residual_over_noise:.2g} times the noise, so the force that remembers is another one in "
            "part, which may show as damping"
        )
        yield ConfoundedTerm(group.name, term.name, "damping", reason)
        return
    travel, velocity = (np.concatenate(each) for each in zip(*map(part.fit.motion, group.slots), strict=True))
    for parameter, scale in zip(term.kind.parameters, term.values, strict=True):
        # a kind whose scale may be long by nature bends within it all the same
        if parameter.role != "scale" or parameter.over_rms[1] > settings.usual_reach_rms:
            continue
        rms = float((velocity if parameter.unit == "m/s" else travel).std())
        if scale > settings.straight_rms * rms and is_loose:
            yield straight_term(group.name, term.name, parameter.unit, scale, rms)
        sharpness = _turnover_over_rate(part, group.slots, term, parameter.unit, scale, velocity)
        if sharpness > settings.turnover_between_samples:
            reason = (
                f"turns over faster than the runs were sampled ({sharpness:.2g} times their rate), so its force "
                "between two samples is not known and may show as damping"
            )
            yield ConfoundedTerm(group.name, term.name, "damping", reason, "record at a higher rate")


def _travels(fit: Fit, number: int) -> list[FloatArray]:
    """Travel of a group from the origin of its law, m, of each slot in each run, wherever the run rests on the law."""
    slots, found = fit.model.groups[number].slots, []
    for place, prediction in enumerate(fit.errors.predictions):
        interfaces = fit.model.resting_interfaces(fit.theta, place)
        found += [prediction.travel[:, slot] + interfaces[slot].law.rest_m for slot in slots]
    return found


def _turnover_over_rate(
    part: Fitted, slots: Sequence[int], term: Term, unit: str, scale: float, velocity: FloatArray
) -> float:
    """The rate at which a friction stops a motion, over that of the record."""
    model = part.fit.model
    run, accelerance = model.runs[0], model.mobility(part.fit.theta, 0).accelerance
    if term.kind.memory is not None:
        # friction that has turned over within the travel from one sample to the next
        turns = float(velocity.std()) / scale if unit == "m" else 0.0
    else:
        steepest = abs(term.amplitude * float(term.evaluate(np.array(0.0), np.array(0.0))[2]))
        turns = steepest * max(accelerance[k, k] for k in slots) * (unit == "m/s")
    return turns * run.finer / run.recorded_fs
