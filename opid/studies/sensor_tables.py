"""Tables of the sensors of a study of suspensions, and the sensors of other quantities than an acceleration in them.

A sensor below or on the body may read a velocity or a displacement, and a travel may stand for the sensor below; a
strut may have a travel, a pressure, a force or a strain beside both.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any

from opid.errors import InputError
from opid.signals.quantities import Quantity, quantity_of, travel_of_gas
from opid.studies.quantities import convert_run, differentiated_noises, name_travel, with_channel
from opid.studies.run_files import ChannelTable
from opid.studies.schema import NO_KEY, prefix_errors, recast
from opid.suspensions.sensor_facts import IDEAL, IDEAL_PAIR, ForceSensor, SensorFacts, SensorPair, TravelSensor
from opid.suspensions.study import Axis, MeasuredInterface, Run

MOST_TILT_DEG = 30.0
"""The largest standard deviation of a vertical: with more of it nothing is known."""

OF_GAS = ("gas_length_m", "gas_exponent")
"""Keys of a pressure alone."""

FACTS = (*(each.name for each in fields(SensorFacts)), "quantity", "noise_m", *OF_GAS)
"""Keys of a sensor that say how well it reads, and what."""

STRUT_SENSORS = ("travel", "force")
"""Names of the channels of a gear that read its strut beside the sensors on either side."""

GAS_EXPONENT = 1.2
"""Usual polytropic exponent of the gas in a strut: between that of slow and that of quick motion."""

USUAL_OF_GAS: dict[str, Any] = {"gain_tolerance": 0.05, "gain_repeatability": 0.02}
"""What is known of a travel by a pressure: a drawing tells the length of the gas, and 6 K change it by 2 %."""

AS_TRAVEL: tuple[Quantity | None, ...] = (None, "travel", "pressure")
AS_FORCE: tuple[Quantity | None, ...] = (None, "force", "strain")
"""The quantities that a sensor of a travel, and of a force, may read; None where its table states none."""


@dataclass(frozen=True, kw_only=True)
class SensorTable(SensorFacts, ChannelTable):
    """A table of [channels]: a column of a log, and what is known of the sensor that wrote it.

    Args:
        quantity: what the sensor reads; an acceleration where it is left out.
        noise_m: rms of the white noise of a travel, m.
        gas_length_m: length of the gas of a pressure at rest, m.
        gas_exponent: polytropic exponent of that gas.
        axes: channels of a three-axis sensor, a right-handed system.
        gyroscope: channels of its rates about these axes.
        vertical: upward direction in its axes.
        tilt_tolerance_deg: standard deviation of its vertical, degrees.

    Raises:
        InputError: facts that do not go together, or of another quantity.
    """

    quantity: Quantity | None = None
    noise_m: float | None = None
    gas_length_m: float | None = None
    gas_exponent: float = GAS_EXPONENT
    axes: tuple[str, ...] = ()
    gyroscope: tuple[str, ...] = ()
    vertical: Annotated[tuple[float, ...], "a list of three numbers, the upward direction in the axes"] = ()
    tilt_tolerance_deg: float | None = None

    def __post_init__(self) -> None:
        SensorFacts.__post_init__(self)
        ChannelTable.__post_init__(self)
        if self.noise_m is not None and self.quantity not in (None, "travel"):
            raise InputError("noise_m is given, which belongs to a travel: give quantity = 'travel', or leave it out")
        if self.noise_m is not None and self.noise_m_per_s2 is not None:
            raise InputError("noise_m and noise_m_per_s2 are given: give the noise of a travel by noise_m alone")
        for name in OF_GAS:
            value = getattr(self, name)
            if name in self.given and self.quantity != "pressure":
                raise InputError(f"{name} is given, which belongs to quantity = 'pressure': leave it out")
            if value is not None and not 0.0 < value < math.inf:
                raise InputError(f"{name} is {value:g}: give a positive number")
        if self.quantity == "pressure" and self.gas_length_m is None:
            raise InputError(
                "quantity is 'pressure' and gas_length_m is missing: give the length of the gas at rest in m, its "
                "volume over the piston area"
            )
        for name in ("axes", "gyroscope"):
            given = getattr(self, name)
            if given and len(set(given)) != 3:
                raise InputError(f"{name} is {list(given)}: give three different channels, as in a right-handed system")
        if self.vertical and (len(self.vertical) != 3 or not 0 < math.hypot(*self.vertical) < math.inf):
            raise InputError(f"vertical is {list(self.vertical)}: give the upward direction in the axes, as [0, 0, 1]")
        if self.tilt_tolerance_deg is not None and not 0 < self.tilt_tolerance_deg <= MOST_TILT_DEG:
            raise InputError(
                f"tilt_tolerance_deg is {self.tilt_tolerance_deg:g}: give a positive angle up to {MOST_TILT_DEG:g}"
            )
        for name in ("channel", "sign", "offset", "quantity") if self.axes else ():
            if name in self.given:
                raise InputError(
                    f"{name!r} and axes are given: gravity tells which way is up, axes are accelerations, and an axis "
                    "with a scale, an offset or a sign of its own has a table [channels.NAME] of its own"
                )


@dataclass(frozen=True, kw_only=True)
class InterfaceTable(MeasuredInterface):
    """A suspension as a study file names its channels.

    Args:
        sprung: the channel on the body above it.
        unsprung: the channel below it.
        x_m: its place, forward, m.
        y_m: its place, to the left, m.
        facts: what is known of its sensors; no key of the table.
        travel: the channel that reads its travel; "" for none.
        force: the channel that reads the force in its strut; "" for none.
    """

    sprung: Annotated[str, "the channel on the body above the suspension, its name in quotes"]
    unsprung: Annotated[str, "the channel below the suspension, its name in quotes"]
    x_m: float
    y_m: float
    facts: Annotated[SensorPair, NO_KEY] = IDEAL_PAIR
    travel: Annotated[str, "the channel that reads its travel, its name in quotes"] = ""  # type: ignore[assignment]
    force: Annotated[str, "the channel that reads the force in its strut, its name in quotes"] = ""  # type: ignore[assignment]


def read_other_quantities(
    places: Sequence[InterfaceTable],
    tables: Mapping[str, SensorTable],
    runs: Sequence[Run],
    interfaces: tuple[MeasuredInterface, ...],
) -> tuple[list[Run], tuple[MeasuredInterface, ...]]:
    """Return runs whose sensors all read accelerations, and the interfaces with the sensors of their struts.

    Args:
        places: the interfaces as the study file names their channels.
        tables: the table of each sensor, by its channel.
        runs: the runs as they were recorded.
        interfaces: the interfaces without sensors of their struts.

    Raises:
        InputError: a sensor in the place of another one, or with facts of another one.
    """
    if not interfaces:
        return list(runs), interfaces  # The study says that there are none.
    of_struts = {channel for each in places for channel in (each.travel, each.force)}
    stated: dict[str, Quantity | None] = {
        channel: "travel" if table.quantity == "pressure" else table.quantity
        for channel, table in tables.items()
        if channel not in of_struts
    }
    _require_places(places, stated)
    for each in places:
        for channel in (each.unsprung, each.travel):
            if channel and tables[channel].quantity == "pressure":
                runs = _read_travel_of_gas(runs, channel, tables[channel], each.axis)
    alone = [each.unsprung for each in places if stated[each.unsprung] == "travel"]
    above = {each.travel: each.sprung for each in places if each.travel}
    above |= {each.unsprung: each.sprung for each in places if each.unsprung in alone}
    forces = [each.force for each in places if each.force]
    converted = [convert_run(run, stated, above=above, forces=forces) for run in runs]
    _require_one_clock(runs if alone else ())
    noises = differentiated_noises(runs, stated)
    found = []
    for each, interface in zip(places, interfaces, strict=True):
        changed = _with_noises(interface, noises)
        if each.unsprung in alone:
            travel = _find_travel(each.unsprung, tables[each.unsprung], is_alone=True)
            changed = replace(changed, travel=travel, facts=replace(changed.facts, unsprung=IDEAL))
        elif each.travel:
            changed = replace(changed, travel=_find_travel(each.travel, tables[each.travel], is_alone=False))
        if each.force:
            changed = replace(changed, force=_find_force(each.force, tables[each.force]))
        found.append(changed)
    return converted, tuple(found)


def _find_travel(channel: str, table: SensorTable, *, is_alone: bool) -> TravelSensor:
    """Return the sensor of a travel that a table describes."""
    shared = ("gain_tolerance", "gain_repeatability", "lag_tolerance_s")
    if table.quantity == "pressure":
        given = _read_facts(channel, table, AS_TRAVEL, (*shared, *OF_GAS))
        facts = USUAL_OF_GAS | {key: given[key] for key in shared if key in given}
    else:
        facts = _read_facts(channel, table, AS_TRAVEL, ("noise_m", *shared))
    return TravelSensor(name_travel(channel) if is_alone else channel, is_alone=is_alone, **facts)


def _find_force(channel: str, table: SensorTable) -> ForceSensor:
    """Return the sensor of a force that a table describes."""
    given = _read_facts(channel, table, AS_FORCE, ("gain_tolerance", "gain_repeatability", "lag_tolerance_s"))
    if table.quantity == "strain":
        if "gain_tolerance" in given:
            raise InputError(
                f"[channels.{channel}] is a strain, whose gain nobody knows, and has a gain_tolerance: leave it out, "
                "or give the force in N"
            )
        given["gain_tolerance"] = None
    return ForceSensor(channel, **given)


def _read_travel_of_gas(runs: Sequence[Run], channel: str, table: SensorTable, axis: Axis) -> list[Run]:
    """Return runs in which a channel of the gas's pressure has become the travel, which is zero at rest.

    It counts in the direction of the accelerations: where the axis is "down" it falls as the strut extends.

    Rest in a run is its mean pressure. The length of the gas is that in the first run without a loading; where another
    loading compresses the gas, it is shorter in proportion to the pressure, because that lasts.
    """
    reference = next((run for run in runs if not run.masses), runs[0])
    if channel not in reference.recording.names or table.gas_length_m is None:
        return list(runs)  # The study names the channel that is missing.
    known_pa, found = float(reference.recording.channel(channel).mean()), []
    for run in runs:
        with prefix_errors(f"run {run.name!r}, channel {channel!r}: "):
            quantity_of(run.recording.unit(channel), "pressure")
            pressure_pa = run.recording.channel(channel)
            rest_pa = float(pressure_pa.mean())
            length_m = table.gas_length_m * known_pa / rest_pa
            extension = travel_of_gas(pressure_pa, rest_pa=rest_pa, length_m=length_m, exponent=table.gas_exponent)
            travel = -extension if axis == "down" else extension
        words = f"{channel}: the travel by the pressure of {length_m:.4g} m of gas at {rest_pa:.4g} Pa"
        found.append(replace(run, recording=with_channel(run.recording, channel, travel, words, "m")))
    return found


def _require_places(places: Sequence[InterfaceTable], stated: Mapping[str, Quantity | None]) -> None:
    """Refuse sensors of struts in places of others.

    Raises:
        InputError: a travel or a force in the place of another sensor, one travel twice, or a travel in the place of
            some sensors below the suspensions, but not of all.
    """
    for channel, quantity in stated.items():
        if quantity in ("force", "strain"):
            raise InputError(
                f"[channels.{channel}] reads a force and stands for an acceleration: name it as the channel force, and "
                "give the accelerations on both sides"
            )
        if quantity == "travel" and channel not in [each.unsprung for each in places]:
            raise InputError(
                f"[channels.{channel}] reads a travel and stands for the sensor on the body: name it as the channel "
                "unsprung if it stands for a sensor below the suspension, and as travel if it is a further one"
            )
    alone = [each for each in places if stated[each.unsprung] == "travel"]
    if any(each.travel for each in alone):
        raise InputError("[channels.unsprung] and [channels.travel] both read the travel: leave one of them out")
    if alone and any(each.force for each in places):
        raise InputError(
            f"[channels.{alone[0].unsprung}] reads a travel in the place of the sensor below, and a force is read, "
            "too: the gain of the force is then told by nothing; leave the force out, or give a sensor below"
        )
    if alone and len(alone) < len(places):
        others = next(each.name for each in places if each not in alone)
        raise InputError(
            f"[channels.{alone[0].unsprung}] reads a travel in the place of the sensor below {alone[0].name!r}, and "
            f"{others!r} has a sensor there: give travels in the place of all of them, or of none"
        )


def _read_facts(
    name: str, facts: SensorTable, quantities: Sequence[Quantity | None], known: Sequence[str]
) -> dict[str, Any]:
    """Return what the table of a sensor of a strut states of the known facts.

    Raises:
        InputError: another quantity, or a fact of an accelerometer.
    """
    what, *_ = [each for each in quantities if each]
    if facts.quantity not in quantities:
        raise InputError(f"[channels.{name}] has the quantity {facts.quantity!r}: leave it out, or call it otherwise")
    for fact in FACTS:
        if fact in facts.given and fact not in (*known, "quantity"):
            raise InputError(
                f"[channels.{name}] reads a {what} and states {fact}, which is that of another sensor: give "
                f"{', '.join(known[:-1])} and {known[-1]} alone"
            )
    return {each: getattr(facts, each) for each in known if each in facts.given}


def _require_one_clock(runs: Sequence[Run]) -> None:
    """Refuse a travel in the place of a sensor below whose clock is known only by its motion."""
    for run in runs:
        if run.clocks:
            raise InputError(
                f"run {run.name!r}: the clock of the travel was matched by its motion, and what is left of its lag "
                "passes for damping: record both channels by one recorder, or state shift_s and shift_tolerance_s = 0"
            )


def _with_noises(interface: MeasuredInterface, noises: Mapping[str, float]) -> MeasuredInterface:
    """Return an interface with the noise of its channels that are differentiated, where none is stated."""

    def change(facts: SensorFacts, channel: str) -> SensorFacts:
        return replace(facts, noise_m_per_s2=facts.noise_m_per_s2 or noises.get(channel))

    facts = interface.facts
    below, above = change(facts.unsprung, interface.unsprung), change(facts.sprung, interface.sprung)
    return replace(interface, facts=replace(facts, unsprung=below, sprung=above))


def tabulate_struts(interface: MeasuredInterface) -> Iterator[tuple[str, SensorTable]]:
    """Yield the tables of the sensors of a strut, each with its place: "unsprung", "travel" or "force".

    All facts are written, also those of 0: where one is left out, its usual value is taken.

    Args:
        interface: the suspension.
    """
    travel, force, shared = interface.travel, interface.force, {"gain_repeatability", "lag_tolerance_s"}
    if travel is not None:
        stated = recast(SensorTable, travel.facts, noise_m_per_s2=None, noise_m=travel.noise_m)
        # Without a sensor below, the acceleration there is derived once more when the files are read.
        place, given = "unsprung" if travel.is_alone else "travel", frozenset({*shared, "gain_tolerance"})
        yield place, replace(stated, channel=travel.channel, quantity="travel", given=given)
    if force is None:
        return
    stated = recast(SensorTable, force.facts, gain_tolerance=force.gain_tolerance or 0.0)
    if force.gain_tolerance is None:
        yield "force", replace(stated, channel=force.channel, quantity="strain", given=frozenset(shared))
    else:
        given = frozenset({*shared, "gain_tolerance"})
        yield "force", replace(stated, channel=force.channel, quantity="force", given=given)
