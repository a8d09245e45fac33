"""What is known of the two sensors beforehand, and what of it a fit has to find out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from opid.errors import InputError

SIDES = ("sprung", "unsprung")
# share of the motion across its axis that an accelerometer lets in: data sheets say 1 to 5 %
LEAK_TOLERANCE = 0.05


@dataclass(frozen=True)
class SensorFacts:
    """What the data sheet or the calibration of a sensor says; by default an ideal one of unknown noise.

    A tolerance is the standard deviation of what may be wrong; where it is 0 nothing is fitted.

    Args:
        noise_m_per_s2: rms of its white noise, m/s^2; None to estimate it.
        gain_tolerance: of the gain, relative.
        corner_hz: corner of its first-order AC coupling, Hz; 0 for a DC-coupled sensor.
        corner_tolerance: of the corner, relative.
        lag_tolerance_s: of its delay, s.

    Raises:
        InputError: a negative or infinite value, or a tolerance of a corner that is not there.
    """

    noise_m_per_s2: float | None = None
    gain_tolerance: float = 0.0
    corner_hz: float = 0.0
    corner_tolerance: float = 0.0
    lag_tolerance_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("gain_tolerance", "corner_hz", "corner_tolerance", "lag_tolerance_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{name} is {value}: give zero or a positive number")
        if self.noise_m_per_s2 is not None and not (math.isfinite(self.noise_m_per_s2) and self.noise_m_per_s2 > 0.0):
            raise InputError(f"noise_m_per_s2 is {self.noise_m_per_s2}: give a positive number, or leave it out")
        for name in ("gain_tolerance", "corner_tolerance"):
            if getattr(self, name) > 0.5:
                raise InputError(f"{name} is {getattr(self, name)}: it is relative, give at most 0.5 (50 %)")
        if self.corner_tolerance and not self.corner_hz:
            raise InputError("corner_tolerance is given without corner_hz: give the nominal corner of the AC coupling")


@dataclass(frozen=True)
class Leak:
    """A further recorded axis that a sensor on one side lets in.

    Args:
        channel: name of the recorded channel, an acceleration.
        into: "sprung" or "unsprung", the side that it leaks into.
        tolerance: standard deviation of the share that leaks in.

    Raises:
        InputError: another side, or a tolerance that is not between 0 and 1.
    """

    channel: str
    into: str
    tolerance: float = LEAK_TOLERANCE

    def __post_init__(self) -> None:
        if self.into not in SIDES:
            raise InputError(f"a leak goes into {self.into!r}: give 'sprung' or 'unsprung'")
        if not 0.0 < self.tolerance < 1.0:
            raise InputError(f"the tolerance of a leak is {self.tolerance}: give a share between 0 and 1")


IDEAL = SensorFacts()


@dataclass(frozen=True)
class SensorPair:
    """Both sensors of a suspension and what leaks into them.

    Args:
        unsprung: of the spindle.
        sprung: of the airframe.
        leaks: further axes that leak in.
    """

    unsprung: SensorFacts = IDEAL
    sprung: SensorFacts = IDEAL
    leaks: tuple[Leak, ...] = ()

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """What has to be found out beside the parameters of the suspension."""
        return tuple(_nuisances(self))


IDEAL_PAIR = SensorPair()


@dataclass(frozen=True)
class Nuisance:
    """One property of the sensors that a fit moves.

    Args:
        name: "gain_sprung", "corner_unsprung_hz", "lag_s", "leak[0]", ...
        kind: what it is.
        side: the side that it acts on.
        nominal: value before the data.
        std: standard deviation before the data.
        place: number of the leak.
    """

    name: str
    kind: Literal["gain", "corner", "lag", "leak"]
    side: str
    nominal: float
    std: float
    place: int = 0


def _nuisances(pair: SensorPair) -> Iterator[Nuisance]:
    for side, facts in (("unsprung", pair.unsprung), ("sprung", pair.sprung)):
        if facts.gain_tolerance:
            yield Nuisance(f"gain_{side}", "gain", side, 1.0, facts.gain_tolerance)
        if facts.corner_tolerance:
            std = facts.corner_tolerance * facts.corner_hz
            yield Nuisance(f"corner_{side}_hz", "corner", side, facts.corner_hz, std)
    # only the delay of one channel against the other can be seen
    lag_s = math.hypot(pair.unsprung.lag_tolerance_s, pair.sprung.lag_tolerance_s)
    if lag_s:
        yield Nuisance("lag_s", "lag", "sprung", 0.0, lag_s)
    for place, leak in enumerate(pair.leaks):
        yield Nuisance(f"leak[{place}]", "leak", leak.into, 0.0, leak.tolerance, place)


def nuisance_values(names: Sequence[str], values: Iterable[float], pair: SensorPair) -> dict[str, float]:
    """Return every nuisance of a pair of sensors by name: fitted where it was, else nominal.

    Args:
        names: of the fitted parameters.
        values: of the fitted parameters, likewise.
        pair: the sensors.
    """
    fitted = dict(zip(names, values, strict=True))
    return {nuisance.name: float(fitted.get(nuisance.name, nuisance.nominal)) for nuisance in pair.nuisances}
