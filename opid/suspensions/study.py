"""Study: interfaces that are measured on both sides, and runs with known loadings. A gear is a body with one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from itertools import combinations, product
from numbers import Real
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from opid.errors import nearest, refuse
from opid.provenance import ReadFile
from opid.result import first_lines
from opid.signals.clock_matching import ClockMatch
from opid.signals.health.result import Finding
from opid.signals.health.spikes import remove_spikes
from opid.signals.log import AS_WRITTEN, LogSettings
from opid.signals.orientation import Orientation
from opid.signals.quantities import DEFAULTS as QUANTITIES, accelerate
from opid.signals.recording import FloatArray, Recording
from opid.signals.spectra import BY_METHOD, TransmissibilitySettings
from opid.suspensions.sensor_facts import (
    IDEAL,
    IDEAL_PAIR,
    SIDES,
    TRAVEL_PER_S2,
    ClockFacts,
    ForceSensor,
    Leak,
    SensorFacts,
    SensorPair,
    Sensors,
    Side,
    TravelSensor,
)

KINDS = ("auto", "single", "pair", "rigid_body")
"""Structures that a study may ask for; "auto" compares the others."""

Axis = Literal["up", "down", "horizontal"]
"""Direction in which the channels of an interface count positive; "horizontal" for motion that no weight acts on."""

MINIMUM_SAMPLES = 256
"""The shortest run that is accepted: a spectrum of fewer samples does not separate a peak from its neighbours."""

LARGEST_CHANGE_KG = 1e5
"""The largest mass change: no single gear carries more than 50 t."""

SAME_RATE = 1e-5
"""Relative difference up to which two rates are the same: crystal clocks agree to some parts in a million."""

LARGEST_PISTON_M2 = 1.0
"""The largest piston area of a strut."""

FARTHEST_M = 200.0
"""The largest coordinate: no vehicle is larger."""

TAPE_M = 0.01
"""Default standard deviation of coordinates, from a tape or a drawing."""

SYMMETRIC_M = 0.1
"""Largest deviation of a symmetric pair from exact mirror positions."""

MOST_UNLIKE = 0.2
"""The largest repeatability: suspensions that differ more from run to run are not the same suspension."""

LARGEST_MASS_KG = 1e6
"""The largest mass that a run can be stated to have weighed: no aircraft has 1000 t."""

LARGEST_SPEED_M_PER_S = 150.0
"""The largest speed that a run can be stated to have: no vehicle rolls faster."""

LEAST_ALIKE = 0.3
"""Least correlation of the force in a strut with the acceleration of the body above it, which it moves."""

ONE_PLACE_M = 0.05
"""Interfaces that are nearer to each other than this are at the same position."""


@dataclass(frozen=True)
class MeasuredInterface:
    """A suspension with a sensor on either side.

    Args:
        name: "nose", "left", ...
        sprung: channel on the body.
        unsprung: channel below the suspension.
        x_m: x of the suspension, forward.
        y_m: y of the suspension, to the left.
        sensor_x_m: x of the sensor on the body; that of the suspension if left out.
        sensor_y_m: y of the sensor on the body; that of the suspension if left out.
        facts: facts known of its two sensors.
        axis: direction in which its channels count positive, "up" or "down"; "horizontal" for motion that no weight
            acts on.
        piston_area_m2: area that the gas of its strut pushes on; None if it is not known, or if no gas carries it.
        travel: sensor of its travel; None if it has none.
        force: sensor of the force in its strut, which counts like its accelerations; None if it has none.
    """

    name: str
    sprung: str
    unsprung: str
    x_m: float = 0.0
    y_m: float = 0.0
    sensor_x_m: float | None = None
    sensor_y_m: float | None = None
    facts: SensorPair = IDEAL_PAIR
    axis: Axis = "up"
    piston_area_m2: float | None = None
    travel: TravelSensor | None = None
    force: ForceSensor | None = None

    @property
    def strut_sensors(self) -> tuple[TravelSensor | ForceSensor, ...]:
        """Sensors that read the strut itself."""
        return tuple(each for each in (self.travel, self.force) if each is not None)

    @property
    def place(self) -> tuple[float, float]:
        """(x, y) of the suspension, m."""
        return self.x_m, self.y_m

    @property
    def sensor_place(self) -> tuple[float, float]:
        """(x, y) of the sensor on the body, m."""
        return (
            self.x_m if self.sensor_x_m is None else self.sensor_x_m,
            self.y_m if self.sensor_y_m is None else self.sensor_y_m,
        )


@dataclass(frozen=True)
class BodySensor:
    """A further sensor on the body.

    Args:
        channel: its channel, an acceleration upward.
        x_m: its x, forward.
        y_m: its y, to the left.
        facts: facts known of the sensor.
        leaks: further axes that leak into it, each with `into` "sprung".
    """

    channel: str
    x_m: float
    y_m: float
    facts: SensorFacts = IDEAL
    leaks: tuple[Leak, ...] = ()


@dataclass(frozen=True)
class PointMass:
    """A row of a loading table: a mass that a run carries in addition to the reference.

    Args:
        mass_kg: the mass; negative if it was removed.
        x_m: its x, forward.
        y_m: its y, to the left.
    """

    mass_kg: float
    x_m: float
    y_m: float = 0.0


@dataclass(frozen=True, eq=False)
class Run:
    """One recorded run with a known loading.

    Args:
        name: name of the run.
        recording: the recording.
        loading: masses that it carries in addition to the reference, empty for the reference; for one gear a number is
            enough, kg, negative if mass was removed.
        findings: findings about the logs that it was taken from; those about the recording itself are added later.
        orientations: how each three-axis sensor was mounted, by the name of its channel.
        log: the file that it was read from without a study file; None if it came otherwise.
        log_settings: settings with which that file was read.
        weighed_mass_kg: sprung mass of this run by a scale, kg, loading included: what the gear carries, or the whole
            body; None if it was not weighed. It is compared with the estimate, not fitted to.
        weighed_tolerance_kg: standard deviation of that mass, kg; the weighed mass is then prior knowledge of the
            method "model". None if it is only to be compared.
        clocks: how the clocks of further recorders were matched to that of the first; what is left of lag and drift is
            fitted.
        highest_hz: highest line that is compared, Hz, because a differentiated channel holds noise above; None where
            all channels read accelerations.
        speed_m_per_s: speed of the vehicle, a number or the name of a channel of the recording, as a GPS receiver gives
            it; None if it is not known. Only wheel and tyre need it.
    """

    name: str
    recording: Recording
    loading: tuple[PointMass, ...] | float = ()
    findings: tuple[Finding, ...] = ()
    orientations: Mapping[str, Orientation] = field(default_factory=dict)
    log: Path | None = None
    log_settings: LogSettings = AS_WRITTEN
    weighed_mass_kg: float | None = None
    weighed_tolerance_kg: float | None = None
    clocks: tuple[ClockMatch, ...] = ()
    highest_hz: float | None = None
    speed_m_per_s: float | str | None = None

    def __post_init__(self) -> None:
        if isinstance(self.loading, (int, float)):
            object.__setattr__(self, "loading", (PointMass(float(self.loading), 0.0, 0.0),) if self.loading else ())

    @property
    def masses(self) -> tuple[PointMass, ...]:
        """Masses that it carries in addition to the reference."""
        assert not isinstance(self.loading, (int, float))  # no longer
        return self.loading

    @property
    def mass_change_kg(self) -> float:
        """Mass of this run minus that of the reference, kg."""
        return sum(each.mass_kg for each in self.masses)


@dataclass(frozen=True)
class StructureSettings:
    """What is stated of the body.

    Args:
        kind: one of `KINDS`.
        shared: names of interfaces that share stiffness, damping and law; the others have their own.
        position_tolerance_m: standard deviation of all coordinates; 0 for exact ones, which makes intervals too narrow
            if they were measured by tape.
        noise_m_per_s2: rms of the white noise of all sensors; None to estimate it.
    """

    kind: str = "auto"
    shared: tuple[tuple[str, ...], ...] = ()
    position_tolerance_m: float = TAPE_M
    noise_m_per_s2: float | None = None


@dataclass(frozen=True, eq=False)
class Study:
    """Runs of one body on suspensions, checked when the study is made.

    The mass that is identified is the one without a loading, whether or not a run was made there.

    Args:
        title: title of the study.
        interfaces: the suspensions.
        runs: one or more runs.
        structure: what is stated of the body.
        sensors: further sensors on the body.
        date: date of the runs; None if it is not known.
        source: the study file, None if the study was made otherwise.
        repeatability: relative standard deviation by which springs, damping and friction of a suspension differ from
            run to run; 0 if they are known to be the same, None for the usual value.
        transmissibility: how the transmissibilities of one gear are estimated; the method chooses what is left out.
        strut_scales: factor by which the readings of each strut sensor are as large as accelerations. It is computed
            where left out: the force in a strut is divided by about the mass that it moves, its rms over that of the
            acceleration above it in the mean of the runs. A study with a run in the place of others keeps it.

    Raises:
        InputError: all errors of the study in one message: a missing channel, another unit than m/s^2, different rates,
            a run that is too short, a name that occurs twice.
    """

    title: str
    interfaces: tuple[MeasuredInterface, ...]
    runs: tuple[Run, ...]
    structure: StructureSettings = field(default_factory=StructureSettings)
    sensors: tuple[BodySensor, ...] = ()
    date: date | None = None
    source: Path | None = None
    repeatability: float | None = None
    transmissibility: TransmissibilitySettings = BY_METHOD
    strut_scales: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("interfaces", "runs", "sensors"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        refuse(list(_list_faults(self)), self.source)
        if len(self.strut_scales) != len(self.strut_sensors):
            object.__setattr__(self, "strut_scales", tuple(self._list_strut_scales()))

    def __repr__(self) -> str:
        runs = []
        for run in self.runs:
            change = f", {run.mass_change_kg:+g} kg" if run.masses else ""
            runs.append(f"run {run.name}: {run.recording.duration_s:.4g} s at {run.recording.fs:.6g} Hz{change}")
        interfaces = [f"interface {each.name}: {each.sprung} above, {each.unsprung} below" for each in self.interfaces]
        lines = [*first_lines(runs, "runs"), *first_lines(interfaces, "interfaces")]
        return "\n".join([f"Study: {self.title}", *lines])

    @property
    def fs(self) -> float:
        """Sampling rate of all runs, Hz."""
        return self.runs[0].recording.fs

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the interfaces."""
        return tuple(interface.name for interface in self.interfaces)

    @property
    def is_driven(self) -> bool:
        """Whether the motion below the suspensions was measured; otherwise it is derived from a travel."""
        return not any(each.is_alone for each in self.travels)

    @property
    def is_one_gear(self) -> bool:
        """Whether the study has one suspension and one sensor on the body."""
        return len(self.interfaces) == 1 and not self.sensors

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The study file, loading tables and logs of the runs, as they were when they were read."""
        return tuple(file for run in self.runs for file in run.recording.files)

    def channels(self, side: Side) -> tuple[str, ...]:
        """Return the channels of the sensors of a side, in the order of the model.

        Args:
            side: "unsprung" or "sprung".
        """
        if side == "unsprung":
            return tuple(interface.unsprung for interface in self.interfaces)
        of_struts = (each.channel for _, each in self.strut_sensors)
        above = (interface.sprung for interface in self.interfaces)
        return (*above, *(sensor.channel for sensor in self.sensors), *of_struts)

    @property
    def strut_sensors(self) -> tuple[tuple[int, TravelSensor | ForceSensor], ...]:
        """Sensors that read a strut itself, each with the index of its interface.

        In the order of the model they follow those of the accelerations on the body.
        """
        return tuple((k, each) for k, interface in enumerate(self.interfaces) for each in interface.strut_sensors)

    @property
    def travels(self) -> tuple[TravelSensor, ...]:
        """Sensors of the travel."""
        return tuple(each for _, each in self.strut_sensors if isinstance(each, TravelSensor))

    @property
    def forces(self) -> tuple[ForceSensor, ...]:
        """Sensors of the force in a strut."""
        return tuple(each for _, each in self.strut_sensors if isinstance(each, ForceSensor))

    def _list_strut_scales(self) -> Iterator[float]:
        for k, sensor in self.strut_sensors:
            if isinstance(sensor, TravelSensor):
                yield TRAVEL_PER_S2
                continue
            above, recordings = self.interfaces[k].sprung, [run.recording for run in self.runs]
            pairs = [[_read_motion(each, name) for name in (sensor.channel, above)] for each in recordings]
            yield 1.0 / float(np.mean([force.std() / acceleration.std() for force, acceleration in pairs]))

    def leaks(self) -> list[tuple[str, Side, int, float]]:
        """Return the leaks: channel, side and number of the sensor that it leaks into, and standard deviation."""
        each = [*(interface.facts.leaks for interface in self.interfaces), *(sensor.leaks for sensor in self.sensors)]
        return [(leak.channel, leak.into, k, leak.tolerance) for k, leaks in enumerate(each) for leak in leaks]

    def sensor_facts(self) -> Sensors:
        """Return the facts of all sensors, with the noise that is stated for each or for all."""
        names = [*self.names, *(sensor.channel for sensor in self.sensors)]
        above = (*(each.facts.sprung for each in self.interfaces), *(sensor.facts for sensor in self.sensors))
        of_struts = tuple(each.facts for _, each in self.strut_sensors)

        def known(facts: SensorFacts) -> SensorFacts:
            return replace(facts, noise_m_per_s2=facts.noise_m_per_s2 or self.structure.noise_m_per_s2)

        return Sensors(
            unsprung=tuple(known(interface.facts.unsprung) for interface in self.interfaces),
            sprung=(*map(known, above), *of_struts),
            names=(*(("",) if self.is_one_gear else names), *(each.channel for _, each in self.strut_sensors)),
            leaks=tuple((side, k, tolerance) for _, side, k, tolerance in self.leaks()),
            clocks=tuple(self._clock_facts()),
            runs=tuple(run.name for run in self.runs),
        )

    def _clock_facts(self) -> Iterator[ClockFacts]:
        """Yield what is known of the clocks of sensors that come from another recorder than the first, run by run."""
        for number, run in enumerate(self.runs):
            for match, side in product(run.clocks, SIDES):
                for k, channel in enumerate(self.channels(side)):
                    if channel in match.channels:
                        drift_std = 1e-6 * match.drift_std_ppm
                        yield ClockFacts(number, run.name, side, k, match.offset_std_s, drift_std)

    def accelerations(self, run: Run) -> tuple[FloatArray, FloatArray]:
        """Return unsprung and sprung acceleration of a run of one gear, each (n_samples,) m/s^2.

        Args:
            run: a run of this study.
        """
        return run.recording.channel(self.unsprung), run.recording.channel(self.sprung)

    @property
    def sprung(self) -> str:
        """Channel on the body of the first interface."""
        return self.interfaces[0].sprung

    @property
    def unsprung(self) -> str:
        """Channel below the first interface."""
        return self.interfaces[0].unsprung


def study_of_gear(
    title: str,
    *,
    sprung: str,
    unsprung: str,
    runs: Sequence[Run],
    sensors: SensorPair = IDEAL_PAIR,
    axis: Axis = "up",
    piston_area_m2: float | None = None,
    travel: TravelSensor | None = None,
    force: ForceSensor | None = None,
    repeatability: float | None = None,
    transmissibility: TransmissibilitySettings = BY_METHOD,
    date: date | None = None,
    source: Path | None = None,
) -> Study:
    """Return the study of one gear: a body with one interface.

    Args:
        title: title of the study.
        sprung: name of the channel on the airframe, an acceleration.
        unsprung: name of the channel on the spindle, an acceleration.
        runs: one or more runs.
        sensors: facts known of the two sensors.
        axis: direction in which the channels count positive, "up" or "down"; "horizontal" for motion that no weight
            acts on.
        piston_area_m2: area that the gas of the strut pushes on; None if it is not known, or if no gas carries the
            gear.
        travel: sensor of the travel; None if there is none.
        force: sensor of the force in the strut; None if there is none.
        repeatability: relative standard deviation by which springs, damping and friction differ from run to run; 0
            if they are known to be the same, None for the usual value.
        transmissibility: how the transmissibilities are estimated; the method chooses what is left out.
        date: date of the runs; None if it is not known.
        source: the study file, None if the study was made otherwise.

    Raises:
        InputError: as for `Study`.

    >>> from opid.signals.recording import recording_from_arrays
    >>> samples, names = np.random.default_rng(0).standard_normal((2, 2, 512)), ["lower_z", "upper_z"]
    >>> heavy, light = (recording_from_arrays(each, names, fs=512.0) for each in samples)
    >>> runs = (Run("heavy", heavy), Run("light", light, -220.0))
    >>> study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs).fs
    512.0
    """
    gear = MeasuredInterface(
        "gear",
        sprung,
        unsprung,
        facts=sensors,
        axis=axis,
        piston_area_m2=piston_area_m2,
        travel=travel,
        force=force,
    )
    return Study(
        title,
        (gear,),
        tuple(runs),
        repeatability=repeatability,
        transmissibility=transmissibility,
        date=date,
        source=source,
    )


def symmetric_pairs(study: Study) -> list[tuple[int, int]]:
    """Return index pairs of interfaces left and right of the middle, each with its nearest mirror image."""
    mirrored = []
    for (i, one), (k, other) in combinations(enumerate(study.interfaces), 2):
        along, across = abs(one.x_m - other.x_m), abs(one.y_m + other.y_m)
        if max(along, across) < SYMMETRIC_M < abs(one.y_m):
            mirrored.append((math.hypot(along, across), i, k))
    found: list[tuple[int, int]] = []
    for _, i, k in sorted(mirrored):
        if not {i, k} & {k for pair in found for k in pair}:
            found.append((i, k))
    return sorted(found)


def _list_faults(study: Study) -> Iterator[str]:
    yield from _list_interface_faults(study)
    yield from _list_structure_faults(study)
    if not study.runs:
        yield "there are no runs, give at least one"
    yield from _find_namesakes("runs", [run.name for run in study.runs])
    for run in study.runs:
        yield from (f"run {run.name!r}: {fault}" for fault in _run_faults(study, run))
        first = study.runs[0].recording
        if abs(run.recording.fs / first.fs - 1) > SAME_RATE:
            yield (
                f"run {study.runs[0].name!r} has {first.fs:.9g} Hz and run {run.name!r} has {run.recording.fs:.9g} Hz, "
                "resample one to the rate of the other"
            )
    for one, other in combinations(study.runs, 2):
        shared_s = _find_shared_s(one.recording, other.recording)
        if shared_s is not None:
            yield (
                f"runs {one.name!r} and {other.name!r} hold the same samples from {shared_s[0]:.4g} to "
                f"{shared_s[1]:.4g} s, name two logs, or stretches of one that do not overlap"
            )


def _find_shared_s(one: Recording, other: Recording) -> tuple[float, float] | None:
    """Return begin and end of the time in which two recordings have the same samples, s; None if there is none."""
    if one.names != other.names or abs(one.fs / other.fs - 1) > SAME_RATE:
        return None
    later = round((other.start_s - one.start_s) * one.fs)
    first, second = max(later, 0), max(-later, 0)
    n = min(one.n_samples - first, other.n_samples - second)
    if n < 2 or not np.array_equal(one.samples[first : first + n], other.samples[second : second + n]):
        return None
    begin_s = one.start_s + first / one.fs
    return begin_s, begin_s + n / one.fs


def _find_namesakes(what: str, names: Sequence[str]) -> Iterator[str]:
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield f"{names.count(name)} {what} are called {name!r}, rename all but one"


def _list_interface_faults(study: Study) -> Iterator[str]:
    names = study.names
    allowed = get_args(Axis)
    wrong = [each for each in study.interfaces if each.axis not in allowed]
    for each in wrong:
        close = next((axis for axis in allowed if axis == str(each.axis).lower()), None)
        remedy = f"did you mean {close!r}?" if close else f"give one of {', '.join(map(repr, allowed))}"
        yield f"the axis{_name_of_interface(study, each)} is {each.axis!r}, {remedy}"
    for each in study.interfaces:
        area = each.piston_area_m2
        yield from area_faults(area, _name_of_interface(study, each))
        if area is not None and each.axis in ("down", "horizontal"):
            turned = "give both channels sign = -1 and the axis 'up', or " * (each.axis == "down")
            yield (
                f"the piston_area_m2{_name_of_interface(study, each)} is stated and its axis is {each.axis!r}: gas is "
                f"reported only if it carries weight and the channels count up; {turned}leave the area out"
            )
    axes = [axis for axis in allowed if any(each.axis == axis for each in study.interfaces)]
    if len(axes) > 1 and not wrong:
        yield f"the interfaces of one body have the axes {' and '.join(map(repr, axes))}, give all of them the same"
    if not names:
        yield "there are no interfaces, give one table [[interfaces]] for each suspension"
    yield from _find_namesakes("interfaces", names)
    users: dict[str, str] = {}
    for interface in study.interfaces:
        for side, channel in (("sprung", interface.sprung), ("unsprung", interface.unsprung)):
            user = f"{side} of {interface.name!r}"
            if channel in users:
                yield (
                    f"sprung and unsprung are both {channel!r}, name the channels of two sensors"
                    if interface.sprung == interface.unsprung
                    else f"the channel {channel!r} is {users[channel]} and {user}: each sensor is one channel"
                )
            users.setdefault(channel, user)
        for axis in ("x_m", "y_m", "sensor_x_m", "sensor_y_m"):
            value = getattr(interface, axis)
            if value is not None and not (math.isfinite(value) and abs(value) <= FARTHEST_M):
                yield f"interface {interface.name!r}: {axis} is {value:g}, give a place within {FARTHEST_M:g} m, in m"
    for sensor in study.sensors:
        if sensor.channel in users:
            yield f"the channel {sensor.channel!r} is {users[sensor.channel]} and a further sensor: name it once"
        users.setdefault(sensor.channel, "a further sensor")
        if not all(math.isfinite(value) and abs(value) <= FARTHEST_M for value in (sensor.x_m, sensor.y_m)):
            yield f"the sensor {sensor.channel!r} is at ({sensor.x_m:g}, {sensor.y_m:g}) m, give a place in m"
    for interface in study.interfaces:
        yield from _list_leak_faults(
            interface.facts.leaks, {"sprung": interface.sprung, "unsprung": interface.unsprung}
        )
    for sensor in study.sensors:
        yield from _list_leak_faults(sensor.leaks, {"sprung": sensor.channel})
    for first, second in combinations(study.interfaces, 2):
        if math.dist(first.place, second.place) < ONE_PLACE_M and first.name != second.name:
            yield (
                f"the interfaces {first.name!r} and {second.name!r} are both at ({first.x_m:g}, {first.y_m:g}) m: "
                "two suspensions cannot be at one position, correct x_m and y_m"
            )
    for interface in study.interfaces:
        if math.dist(interface.place, interface.sensor_place) > 5.0:
            x, y = interface.sensor_place
            yield (
                f"interface {interface.name!r} is at ({interface.x_m:g}, {interface.y_m:g}) m and its sensor at "
                f"({x:g}, {y:g}) m, more than 5 m apart: name the sensor nearest to it, the others in [[body_sensors]]"
            )


def _name_of_interface(study: Study, interface: MeasuredInterface) -> str:
    """Return " of 'NAME'" of an interface if there are several; "" for one gear, which has no name of its own."""
    return "" if study.is_one_gear else f" of {interface.name!r}"


def _list_leak_faults(into: Sequence[Leak], channels: Mapping[str, str]) -> Iterator[str]:
    """Yield errors of the leaks into some sensors, whose channels are given by side."""
    leaks = [(leak.channel, leak.into) for leak in into]
    for channel, side in sorted({leak for leak in leaks if leaks.count(leak) > 1}):
        yield f"the leak of {channel!r} into the {side} sensor stands twice, give it once"
    for channel, side in leaks:
        if side not in channels:
            yield f"the leak of {channel!r} into {channels['sprung']!r} on the body is said to be {side}: give 'sprung'"
        elif channel == channels[side]:
            yield f"the leak {channel!r} is the {side} channel itself, name another axis"


def repeatability_faults(repeatability: object) -> Iterator[str]:
    """Yield the errors of a stated repeatability.

    Args:
        repeatability: the given value; None if it was left out.
    """
    if repeatability is not None and not _is_within(repeatability, 0.0, MOST_UNLIKE):
        yield (
            f"the repeatability is {repeatability!r}, give the relative standard deviation by which springs, damping "
            f"and friction differ from run to run, a number from 0 to {MOST_UNLIKE:g} (0.01 for 1 %)"
        )


def area_faults(area_m2: float | None, of: str = "") -> Iterator[str]:
    """Yield the errors of the stated `area_m2` of a piston; `of` says of which interface."""
    if area_m2 is not None and not (_is_within(area_m2, 0.0, LARGEST_PISTON_M2) and area_m2):
        is_small_unit = _is_within(area_m2, LARGEST_PISTON_M2, 1e6 * LARGEST_PISTON_M2)
        usual = (
            f"{float(area_m2):g} mm^2 are {1e-6 * area_m2:.3g} m^2"
            if is_small_unit
            else "a bore of 100 mm has 0.00785 m^2"
        )
        yield (
            f"the piston_area_m2{of} is {area_m2!r}, give the area that the gas pushes on, more than 0 "
            f"and at most {LARGEST_PISTON_M2:g} m^2 ({usual})"
        )


def _is_within(value: object, least: float, most: float) -> bool:
    """Whether a value is a number within a range."""
    return isinstance(value, Real) and not isinstance(value, bool) and least <= float(value) <= most


def _list_structure_faults(study: Study) -> Iterator[str]:
    settings, names = study.structure, study.names
    yield from repeatability_faults(study.repeatability)
    if study.transmissibility != BY_METHOD and not study.is_one_gear:
        yield "settings of the transmissibility are stated, and only one gear has one: leave them out"
    if settings.kind not in KINDS:
        yield f"the kind of structure is {settings.kind!r}: {nearest(settings.kind, KINDS)}"
    if not (math.isfinite(settings.position_tolerance_m) and 0 <= settings.position_tolerance_m <= 1.0):
        yield f"position_tolerance_m is {settings.position_tolerance_m}, give 0 to 1, in m"
    if settings.noise_m_per_s2 is not None and not (
        math.isfinite(settings.noise_m_per_s2) and settings.noise_m_per_s2 > 0
    ):
        yield f"noise_m_per_s2 is {settings.noise_m_per_s2}, give a positive number, or leave it out"
    for group in settings.shared:
        if len(group) < 2:
            yield f"'shared' has the group {list(group)}, give two names or more in each"
    shared = [name for group in settings.shared for name in group]
    for name in dict.fromkeys(shared):
        if name not in names:
            yield f"'shared' names {name!r}, which is no interface: {nearest(name, names)}"
        if shared.count(name) > 1:
            yield f"'shared' names {name!r} twice, give it once"
    if settings.kind == "pair" and study.interfaces and not symmetric_pairs(study):
        places = ", ".join(f"{each.name!r} ({each.x_m:g}, {each.y_m:g})" for each in study.interfaces)
        yield (
            f"kind is 'pair' and no two interfaces mirror each other (same x_m, opposite y_m, within {SYMMETRIC_M:g} "
            f"m): {places}; correct the coordinates (y = 0 is the middle), or take another kind"
        )
    if settings.kind == "rigid_body" and study.interfaces:
        yield from rigid_faults(study)


def _weighing_faults(study: Study, run: Run) -> Iterator[str]:
    """Yield the errors of the mass that a run is stated to have weighed."""
    weighed, tolerance = run.weighed_mass_kg, run.weighed_tolerance_kg
    whose = "this gear carries" if study.is_one_gear else "all suspensions carry"
    if weighed is None:
        if tolerance is not None:
            yield "weighed_tolerance_kg is stated without weighed_mass_kg, give the mass too, or leave it out"
        return
    if not (_is_within(weighed, 0.0, LARGEST_MASS_KG) and weighed):
        yield (
            f"weighed_mass_kg is {weighed!r}, give the mass that {whose} in this run, more than 0 and at most "
            f"{LARGEST_MASS_KG:g} kg"
        )
        return
    if weighed <= run.mass_change_kg:
        yield (
            f"weighed_mass_kg is {weighed:g} kg and its mass change {run.mass_change_kg:+g} kg, which leaves nothing "
            f"for the reference: give the whole mass that {whose} in this run, and the change from the reference"
        )
    if tolerance is not None and not (_is_within(tolerance, 0.0, weighed) and 0.0 < tolerance < weighed):
        yield (
            f"weighed_tolerance_kg is {tolerance!r}, give the standard deviation of the weighed mass, more than 0 and "
            f"less than {weighed:g} kg; leave it out if the mass is only to be compared"
        )


def _speed_faults(run: Run) -> Iterator[str]:
    """Yield the errors of the speed that is stated of a run."""
    speed, names = run.speed_m_per_s, run.recording.names
    if isinstance(speed, str):
        if speed not in names:
            yield f"speed_m_per_s names the channel {speed!r}, which is not in its log ({nearest(speed, names)})"
        elif run.recording.unit(speed) != "m/s":
            yield f"speed_m_per_s names {speed!r}, which is in {run.recording.unit(speed)}: name a channel with a speed"
        return
    if speed is not None and not (_is_within(speed, 0.0, LARGEST_SPEED_M_PER_S) and speed):
        yield (
            f"speed_m_per_s is {speed!r}, give the speed in m/s, more than 0 and at most {LARGEST_SPEED_M_PER_S:g}, or "
            "the name of a channel in quotes"
        )


def rigid_faults(study: Study) -> Iterator[str]:
    """Yield the reasons why interfaces or sensors cannot describe a rigid body in heave, roll and pitch."""
    for what, places in (
        ("interfaces", [interface.place for interface in study.interfaces]),
        (
            "sensors on the body",
            [*(i.sensor_place for i in study.interfaces), *((s.x_m, s.y_m) for s in study.sensors)],
        ),
    ):
        array = np.array(places)
        if not np.isfinite(array).all():
            continue
        spread = np.linalg.svd(array - array.mean(axis=0), compute_uv=False)
        if len(array) < 3 or spread[1] < 0.01 * max(spread[0], 1.0):
            listed = ", ".join(f"({x:g}, {y:g})" for x, y in places)
            yield (
                f"the {what} are at {listed} m, all on one line: a rigid body in heave, roll and pitch needs three "
                "that are not on one line; take kind = 'single' or 'pair', or correct the coordinates"
            )


def _run_faults(study: Study, run: Run) -> Iterator[str]:
    for each in run.masses:
        if not all(math.isfinite(value) for value in (each.mass_kg, each.x_m, each.y_m)):
            yield (
                f"the mass change is {each.mass_kg} kg, give a number"
                if study.is_one_gear
                else f"the loading ({each.mass_kg}, {each.x_m}, {each.y_m}) has a value that is no number: give kg, m"
            )
        elif study.is_one_gear and abs(each.mass_kg) > LARGEST_CHANGE_KG:
            yield (
                f"the mass change is {each.mass_kg:g} kg, more than any gear carries "
                f"({LARGEST_CHANGE_KG:g} kg): give it in kg, for this gear alone"
            )
        elif abs(each.x_m) > FARTHEST_M or abs(each.y_m) > FARTHEST_M:
            yield f"the loading of {each.mass_kg:g} kg is at ({each.x_m:g}, {each.y_m:g}) m, give its place in m"
    yield from _weighing_faults(study, run)
    yield from _speed_faults(run)
    if run.recording.n_samples < MINIMUM_SAMPLES:
        yield (
            f"it has {run.recording.n_samples} samples ({run.recording.duration_s:.3g} s) and at least "
            f"{MINIMUM_SAMPLES} are needed, give some tens of seconds"
        )
    wanted = [channel for i in study.interfaces for channel in (i.sprung, i.unsprung)]
    wanted += [*(sensor.channel for sensor in study.sensors), *(channel for channel, *_ in study.leaks())]
    for name in dict.fromkeys(wanted):
        if name not in run.recording.names:
            yield f"there is no channel {name!r} in its log ({nearest(name, run.recording.names)})"
        elif run.recording.unit(name) != "m/s^2":
            yield f"channel {name!r} is in {run.recording.unit(name)} where an acceleration is needed"
    for number, sensor in study.strut_sensors:
        channel, above = sensor.channel, study.interfaces[number].sprung
        if channel not in run.recording.names:
            yield f"there is no channel {channel!r} in its log ({nearest(channel, run.recording.names)})"
        elif isinstance(sensor, TravelSensor):
            if run.recording.unit(channel) != "m":
                yield f"channel {channel!r} is in {run.recording.unit(channel)} where a travel in m is needed"
        elif above in run.recording.names:
            yield from _list_force_faults(sensor, run.recording, above)


def _read_motion(recording: Recording, channel: str) -> FloatArray:
    """Return a channel without spikes in the band in which the springs of a suspension rule its force."""
    low_hz, high_hz = QUANTITIES.slope_band_hz
    samples, _ = remove_spikes(recording.channel(channel), fs=recording.fs)
    slow, all_of_it = (accelerate(samples, fs=recording.fs, n_derivatives=0, highest_hz=hz) for hz in (low_hz, high_hz))
    return np.asarray(all_of_it - slow)


def _list_force_faults(sensor: ForceSensor, recording: Recording, above: str) -> Iterator[str]:
    """Yield what speaks against a channel as the force in the strut below the sensor `above`."""
    channel, unit = sensor.channel, recording.unit(sensor.channel)
    force, acceleration = (_read_motion(recording, each) for each in (channel, above))
    alike = float(force @ acceleration) / max(float(np.linalg.norm(force) * np.linalg.norm(acceleration)), 1e-300)
    if sensor.gain_tolerance is not None and unit != "N":
        yield f"channel {channel!r} is in {unit}: give a force in N, or quantity = 'strain' if nobody knows the gain"
    elif alike < -LEAST_ALIKE:
        yield (
            f"channel {channel!r} falls as the body above is pushed in the direction in which {above!r} counts "
            f"(correlation {alike:.2f}): give it sign = -1"
        )
    elif alike < LEAST_ALIKE:
        yield (
            f"channel {channel!r} is hardly the force in this strut, which moves the body above it: its correlation "
            f"with {above!r} is {alike:.2f} and at least {LEAST_ALIKE:g} is needed"
        )
