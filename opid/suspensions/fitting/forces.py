"""Forces in struts that contradict each other in a fit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from opid.suspensions.fitting.fit import Fit


@dataclass(frozen=True)
class WrongForce:
    """A sensor of a force that reads something else than the other sensors say.

    Args:
        channel: its channel.
        reads_n: what it reads for 1 N, in the run in which it is furthest off.
        tolerance: standard deviation of that, as it is stated.
    """

    channel: str
    reads_n: float
    tolerance: float

    @property
    def words(self) -> str:
        """What it reads, in words."""
        return f"{self.channel!r} reads {self.reads_n:.3g} N for each N (stated to be right to {self.tolerance:.2g})"


def find_wrong_forces(fit: Fit) -> Iterator[WrongForce]:
    """Yield the forces in N that contradict each other, or the changes of mass, in a fit with all of them.

    Args:
        fit: the fit.
    """
    model, theta, most = fit.model, fit.theta, fit.model.settings.weighing.used_within_std
    mu = model.inverse_mass(theta)
    for scale, _ in model.scales:
        facts = model.sensors.sprung[scale.channel]
        reads = [mu * scale.kg * float(model.gains(theta, run.number)[1][scale.channel]) for run in model.runs]
        furthest = max(reads, key=lambda each: abs(each - 1.0))
        tolerance = math.hypot(scale.tolerance, facts.gain_repeatability)
        if abs(furthest - 1.0) > most * tolerance:
            yield WrongForce(model.sensors.names[scale.channel], furthest, tolerance)
