"""Facts known of the sensors beforehand, and the faults that a fit has to estimate."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

from opid.errors import InputError, NotDeterminedError

Side = Literal["sprung", "unsprung"]
SIDES: tuple[Side, Side] = ("sprung", "unsprung")
UNKNOWN_GAIN = 1e6
"""Standard deviation of a gain of which nothing is known."""

# fraction of the motion across its axis that an accelerometer reads: data sheets say 1 to 5 %
LEAK_TOLERANCE = 0.05


@dataclass(frozen=True)
class SensorFacts:
    """Facts from the data sheet or the calibration of a sensor; by default an ideal sensor of unknown noise.

    A tolerance is a standard deviation; if it is 0, the property is not fitted.

    Args:
        noise_m_per_s2: rms of its white noise, m/s^2; None to estimate it.
        gain_tolerance: standard deviation of the gain, relative; `UNKNOWN_GAIN` if nothing is known of it.
        corner_hz: corner of its first-order AC coupling, Hz; 0 for a DC-coupled sensor.
        corner_tolerance: standard deviation of the corner, relative.
        lag_tolerance_s: standard deviation of its delay, s.
        gain_repeatability: standard deviation by which the gain differs from run to run, relative.

    Raises:
        InputError: a negative or infinite value, or a tolerance of a corner without a corner.
    """

    noise_m_per_s2: float | None = None
    gain_tolerance: float = 0.0
    corner_hz: float = 0.0
    corner_tolerance: float = 0.0
    lag_tolerance_s: float = 0.0
    gain_repeatability: float = 0.0

    def __post_init__(self) -> None:
        for name in ("gain_tolerance", "corner_hz", "corner_tolerance", "lag_tolerance_s", "gain_repeatability"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{name} is {value}: give zero or a positive number")
        if self.noise_m_per_s2 is not None and not (math.isfinite(self.noise_m_per_s2) and self.noise_m_per_s2 > 0.0):
            raise InputError(f"noise_m_per_s2 is {self.noise_m_per_s2}: give a positive number, or leave it out")
        for name in ("gain_tolerance", "corner_tolerance", "gain_repeatability"):
            if 0.5 < getattr(self, name) != UNKNOWN_GAIN:
                raise InputError(f"{name} is {getattr(self, name)}: it is relative, give at most 0.5 (50 %)")
        if self.corner_tolerance and not self.corner_hz:
            raise InputError("corner_tolerance is given without corner_hz: give the nominal corner of the AC coupling")


@dataclass(frozen=True)
class Leak:
    """A further recorded axis that leaks into a sensor on one side.

    Args:
        channel: name of the recorded channel, an acceleration.
        into: "sprung" or "unsprung", the side that it leaks into.
        tolerance: standard deviation of the fraction that leaks in.

    Raises:
        InputError: another side, or a tolerance that is not between 0 and 1.
    """

    channel: str
    into: Side
    tolerance: float = LEAK_TOLERANCE

    def __post_init__(self) -> None:
        if self.into not in SIDES:
            raise InputError(f"a leak goes into {self.into!r}: give 'sprung' or 'unsprung'")
        if not 0.0 < self.tolerance < 1.0:
            raise InputError(f"the tolerance of a leak is {self.tolerance}: give a fraction between 0 and 1")


IDEAL = SensorFacts()

TRAVEL_PER_S2 = 100.0
"""A travel of 1 m is read as so many m/s^2, so that usual noises of travel and acceleration are of one size."""


USUAL_GAIN_TOLERANCE = 0.01
"""Standard deviation of the gain of a travel or a force where nobody states it: both are good to a per cent."""

USUAL_GAIN_REPEATABILITY = 0.005
"""Standard deviation by which the gain of a force differs from run to run: 30 K move that of a strain gauge so far."""


USUAL_LAG_TOLERANCE_S = 5e-4
"""The same of its delay, s: the filters of two channels of one recorder differ by some tenths of a millisecond."""


@dataclass(frozen=True)
class TravelSensor:
    """A sensor of the travel of a suspension: a potentiometer, an encoder.

    Args:
        channel: its channel, m; it grows as the suspension extends.
        noise_m: rms of its white noise, m; None to estimate it.
        gain_tolerance: standard deviation of the gain, relative; 0 if the gain is exact.
        lag_tolerance_s: standard deviation of its delay behind the sensor on the body, s; 0 if there is none.
        gain_repeatability: standard deviation by which the gain differs from run to run, relative.
        is_alone: whether no sensor is below the suspension; the acceleration there is then derived from this sensor.

    Raises:
        InputError: a noise that is not positive, or an error of `SensorFacts`.
    """

    channel: str
    noise_m: float | None = None
    gain_tolerance: float = USUAL_GAIN_TOLERANCE
    lag_tolerance_s: float = USUAL_LAG_TOLERANCE_S
    gain_repeatability: float = 0.0
    is_alone: bool = False

    def __post_init__(self) -> None:
        if self.noise_m is not None and not (math.isfinite(self.noise_m) and self.noise_m > 0.0):
            raise InputError(f"noise_m is {self.noise_m}: give a positive number, or leave it out")
        _ = self.facts

    @property
    def facts(self) -> SensorFacts:
        """Facts of the sensor with its readings in m/s^2, see `TRAVEL_PER_S2`."""
        return SensorFacts(
            noise_m_per_s2=None if self.noise_m is None else TRAVEL_PER_S2 * self.noise_m,
            gain_tolerance=self.gain_tolerance,
            lag_tolerance_s=self.lag_tolerance_s,
            gain_repeatability=self.gain_repeatability,
        )


@dataclass(frozen=True)
class ForceSensor:
    """A sensor of the force in a strut: a load cell, or strain gauges.

    Args:
        channel: its channel, in N or, if nobody knows the gain, in any unit; it counts in the direction of the
            accelerations: where these count up, it grows with the load that the strut carries.
        gain_tolerance: standard deviation of the gain, relative; None for a gain that nobody knows, as of strain gauges
            that were not calibrated. A force whose gain is known gives the mass, together with the acceleration; where
            the gain of the accelerometer has no stated tolerance, it is taken to be as good as `USUAL_GAIN_TOLERANCE`.
        gain_repeatability: standard deviation by which the gain differs from run to run, relative.
        lag_tolerance_s: standard deviation of its delay behind the sensor on the body, s; 0 if there is none.

    Raises:
        InputError: an error of `SensorFacts`.
    """

    channel: str
    gain_tolerance: float | None = USUAL_GAIN_TOLERANCE
    gain_repeatability: float = USUAL_GAIN_REPEATABILITY
    lag_tolerance_s: float = USUAL_LAG_TOLERANCE_S

    def __post_init__(self) -> None:
        _ = SensorFacts(gain_tolerance=self.gain_tolerance or 0.0), self.facts

    @property
    def facts(self) -> SensorFacts:
        """Facts of the sensor with its readings in m/s^2: their scale follows from the runs, so its gain is free."""
        return SensorFacts(
            gain_tolerance=UNKNOWN_GAIN,
            gain_repeatability=self.gain_repeatability,
            lag_tolerance_s=self.lag_tolerance_s,
        )


@dataclass(frozen=True)
class SensorPair:
    """Both sensors of a suspension and the axes that leak into them.

    Args:
        unsprung: the sensor below the suspension.
        sprung: the sensor on the body.
        leaks: further axes that leak in.
    """

    unsprung: SensorFacts = IDEAL
    sprung: SensorFacts = IDEAL
    leaks: tuple[Leak, ...] = ()


IDEAL_PAIR = SensorPair()


@dataclass(frozen=True)
class Fault:
    """One property of a sensor that a fit estimates.

    Args:
        name: "gain_sprung", "corner_unsprung_hz", "lag_s", "leak[0]", ...; with the name of the interface or sensor in
            brackets if there are several.
        kind: kind of the property.
        side: the side that it acts on.
        channel: number of the channel on that side.
        nominal: value before the data.
        std: standard deviation before the data.
        leak: number of the leak.
        run: number of the only run that has it; None for a property of the sensor, which all runs share.
    """

    name: str
    kind: Literal["gain", "corner", "lag", "drift", "leak"]
    side: Side
    channel: int
    nominal: float
    std: float
    leak: int = 0
    run: int | None = None


@dataclass(frozen=True)
class ClockFacts:
    """How well the clock of one sensor in one run is known relative to that of the other sensors.

    The lag of the sensor is a straight line over time: its value in the middle of the run, and its drift.

    Args:
        run: number of the run.
        run_name: name of the run.
        side: side of the sensor.
        channel: number of the channel on that side.
        lag_std_s: standard deviation of the lag in the middle of the run, s.
        drift_std: standard deviation of the drift, s of lag per s.
    """

    run: int
    run_name: str
    side: Side
    channel: int
    lag_std_s: float
    drift_std: float


@dataclass(frozen=True)
class Sensors:
    """All sensors of a body, in the order of the channels of a run.

    Args:
        unsprung: sensors below each interface.
        sprung: sensors on the body: beside each interface, then further ones.
        names: names of interfaces and further sensors; all empty for one gear.
        leaks: side, number of the channel, and standard deviation of each leak.
        clocks: the clocks of sensors that were read from another recorder than the rest, run by run.
        runs: names of the runs, by number, for gains that differ from run to run.
    """

    unsprung: tuple[SensorFacts, ...]
    sprung: tuple[SensorFacts, ...]
    names: tuple[str, ...]
    leaks: tuple[tuple[Side, int, float], ...] = ()
    clocks: tuple[ClockFacts, ...] = ()
    runs: tuple[str, ...] = ()

    def facts(self, side: Side) -> tuple[SensorFacts, ...]:
        """Return the facts of the sensors of a side."""
        return self.unsprung if side == "unsprung" else self.sprung

    def mean_of(self, interfaces: Sequence[int]) -> Sensors:
        """Return the sensors of one gear whose readings are the means of those of some interfaces.

        The errors of the sensors are independent, so that the mean has smaller errors. Each leak into one of them is a
        leak into the mean of the axis divided by their number: they are those of `leaks_into`, in this order.

        Args:
            interfaces: one or several indices.

        Raises:
            NotDeterminedError: sensors of one side with different AC couplings, whose mean has no corner.
        """
        return Sensors(
            unsprung=(_mean([self.unsprung[k] for k in interfaces], "unsprung"),),
            sprung=(_mean([self.sprung[k] for k in interfaces], "sprung"),),
            names=("",),
            leaks=tuple((self.leaks[k][0], 0, self.leaks[k][2]) for k in self.leaks_into(interfaces)),
            clocks=_mean_clocks([each for each in self.clocks if each.channel in interfaces], len(interfaces)),
            runs=self.runs,
        )

    def leaks_into(self, interfaces: Sequence[int]) -> list[int]:
        """Return the numbers of the leaks into sensors of some interfaces."""
        return [number for number, (_, channel, _) in enumerate(self.leaks) if channel in interfaces]

    def changed(self, side: Side, channel: int, **facts: float) -> Sensors:
        """Return the sensors with other facts, fields of `SensorFacts`, of one of them."""
        row = list(self.facts(side))
        row[channel] = replace(row[channel], **facts)
        return replace(self, unsprung=tuple(row)) if side == "unsprung" else replace(self, sprung=tuple(row))

    @property
    def has_coupling(self) -> bool:
        """Whether any sensor is AC-coupled."""
        return any(each.corner_hz for each in (*self.unsprung, *self.sprung))

    @cached_property
    def faults(self) -> tuple[Fault, ...]:
        """Faults that are estimated together with the parameters of the body."""
        return tuple(self._list_faults())

    def _list_faults(self) -> Iterator[Fault]:
        for channel in range(len(self.sprung)):
            for side in SIDES[::-1] if channel < len(self.unsprung) else SIDES[:1]:
                facts, where = self.facts(side)[channel], self._name_place(channel)
                if facts.gain_tolerance:
                    yield Fault(f"gain_{side}{where}", "gain", side, channel, 1.0, facts.gain_tolerance)
                for run, name in enumerate(self.runs if facts.gain_repeatability else ()):
                    of_run = f"gain_{side}{where}[{name}]"
                    yield Fault(of_run, "gain", side, channel, 1.0, facts.gain_repeatability, run=run)
                if facts.corner_tolerance:
                    std = facts.corner_tolerance * facts.corner_hz
                    yield Fault(f"corner_{side}_hz{where}", "corner", side, channel, facts.corner_hz, std)
        # Only the delay between the two sensors of an interface is fitted.
        for channel, facts in enumerate(self.sprung):
            below = self.unsprung[channel].lag_tolerance_s if channel < len(self.unsprung) else 0.0
            lag_s = math.hypot(below, facts.lag_tolerance_s)
            if lag_s:
                yield Fault(f"lag_s{self._name_place(channel)}", "lag", "sprung", channel, 0.0, lag_s)
        for clock in self.clocks:
            where = f"{self._name_place(clock.channel)}[{clock.side}, {clock.run_name}]"
            place: tuple[Side, int] = (clock.side, clock.channel)
            yield Fault(f"lag_s{where}", "lag", *place, 0.0, clock.lag_std_s, run=clock.run)
            yield Fault(f"drift{where}", "drift", *place, 0.0, clock.drift_std, run=clock.run)
        for number, (side, channel, tolerance) in enumerate(self.leaks):
            yield Fault(f"leak[{number}]", "leak", side, channel, 0.0, tolerance, number)

    def _name_place(self, channel: int) -> str:
        return f"[{self.names[channel]}]" if self.names[channel] else ""


def _mean(facts: Sequence[SensorFacts], side: Side) -> SensorFacts:
    """Return the facts of the mean of some readings."""
    if len(facts) == 1:
        return facts[0]

    def combine(stds: Sequence[float]) -> float:
        return math.hypot(*stds) / len(stds)

    corners_hz = [each.corner_hz for each in facts]
    stds_hz = [each.corner_tolerance * each.corner_hz for each in facts]
    if max(corners_hz) - min(corners_hz) > math.hypot(*stds_hz):
        listed = " and ".join(f"{corner_hz:.3g}" if corner_hz else "none" for corner_hz in corners_hz)
        raise NotDeterminedError(
            f"the {side} sensors have different corners of their AC coupling ({listed}, in Hz), so their mean has no "
            "corner: take each gear alone, or one rigid body"
        )
    corner_hz, stated = sum(corners_hz) / len(facts), [each.noise_m_per_s2 for each in facts]
    return SensorFacts(
        noise_m_per_s2=combine([each for each in stated if each]) if all(stated) else None,
        gain_tolerance=combine([each.gain_tolerance for each in facts]),
        corner_hz=corner_hz,
        corner_tolerance=combine(stds_hz) / corner_hz if corner_hz else 0.0,
        lag_tolerance_s=combine([each.lag_tolerance_s for each in facts]),
        gain_repeatability=combine([each.gain_repeatability for each in facts]),
    )


def _mean_clocks(clocks: Sequence[ClockFacts], n_sensors: int) -> tuple[ClockFacts, ...]:
    """Return the clocks of the mean of some sensors, of which all or none have their own clock in a run and side."""
    found = {}
    for each in clocks:
        alike = [other for other in clocks if (other.run, other.side) == (each.run, each.side)]
        if len(alike) < n_sensors:
            raise NotDeterminedError(
                f"in run {each.run_name!r} the {each.side} sensors of these gears have different clocks, so their mean "
                "is that of no instant: take each gear alone, or one rigid body"
            )
        lag_std_s, drift_std = (max(getattr(a, name) for a in alike) for name in ("lag_std_s", "drift_std"))
        found[each.run, each.side] = replace(each, channel=0, lag_std_s=lag_std_s, drift_std=drift_std)
    return tuple(found.values())


def ideal_sensors(n_interfaces: int, n_sensors: int) -> Sensors:
    """Return sensors without any fault."""
    return Sensors((IDEAL,) * n_interfaces, (IDEAL,) * n_sensors, ("",) * max(n_interfaces, n_sensors))
