"""An aircraft on several gears taxiing over a rough runway: a field test of the whole aircraft with known truth."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from opid.errors import InputError, nearest
from opid.mechanics.driven import Interface
from opid.mechanics.laws.law import FloatArray
from opid.mechanics.response import Response, time_response
from opid.mechanics.weight import GRAVITY_M_PER_S2, laws_at_rest
from opid.signals.recording import Channel, Recording, recording_from_arrays
from opid.virtual.taxi_tests.airframe import Airframe, Loading, airframe_structure, loaded, place_directions
from opid.virtual.taxi_tests.landing_gear import DEFAULT_SENSOR
from opid.virtual.taxi_tests.road import Road, SpeedProfile
from opid.virtual.taxi_tests.sensors import Sensor, decimate, measure
from opid.virtual.taxi_tests.wheel_tracks import iso8608_tracks

Place = tuple[float, float]
# as for a gear alone: most of the start from rest has decayed before the record begins, exp(-2.5) in the least damped
# mode of a random aircraft; the tail serves the filter
_LEAD_IN_S, _TAIL_S = 8.0, 0.25
_BODY_UNITS = {"heave": "m/s^2", "roll": "rad/s^2", "pitch": "rad/s^2", "bending": "m/s^2"}


@dataclass(frozen=True, eq=False)
class AircraftRun:
    """One taxi run of an aircraft: what the logger wrote, and the truth behind it.

    Attributes:
        airframe: the aircraft that ran, loadings included.
        recording: for each gear <gear>_lower_z (wheel) and <gear>_upper_z (airframe), then the further channels, m/s^2.
        truth: at the same times, the same channels without sensor faults; <gear>_travel z (m) and
            <gear>_travel_velocity z' (m/s) of each strut; heave (m/s^2), roll and pitch (rad/s^2) of the airframe about
            the origin, and bending (m/s^2) if it bends.
        places_m: (x, y) of each channel of `recording`, m.
        speed: the speed over the ground.
    """

    airframe: Airframe
    recording: Recording
    truth: Recording
    places_m: dict[str, Place]
    speed: SpeedProfile


@dataclass(frozen=True, eq=False)
class AircraftTest:
    """Taxi runs of one aircraft, the first as it stands, the others with loadings.

    Args:
        runs: the runs.
        loadings: what was put on the aircraft of the first run, one tuple a run; the first is empty.
    """

    runs: tuple[AircraftRun, ...]
    loadings: tuple[tuple[Loading, ...], ...]


def tyre_forces(
    airframe: Airframe, tracks: Sequence[Road], travelled_m: FloatArray, speed_m_per_s: FloatArray
) -> FloatArray:
    """Return the force of the road through each tyre, K1 xb + C1 xb' on its wheel, (n, n_gears) N.

    Args:
        airframe: the airframe; where its origin is does not matter.
        tracks: the road under each gear, xb = elevation and xb' = slope times speed.
        travelled_m: (n,) place of the rearmost gear on its track, m.
        speed_m_per_s: (n,) speed there, m/s.

    Raises:
        InputError: not one track a gear.
    """
    if len(tracks) != len(airframe.gears):
        raise InputError(f"there are {len(tracks)} track(s) for {len(airframe.gears)} gear(s): give one road a gear")
    forces = np.empty((travelled_m.size, len(airframe.gears)))
    rearmost_m = min(gear.x_m for gear in airframe.gears)
    for column, (gear, road) in enumerate(zip(airframe.gears, tracks, strict=True)):
        place_m = travelled_m + (gear.x_m - rearmost_m)
        forces[:, column] = gear.tyre_stiffness_n_per_m * road.elevation(place_m)
        forces[:, column] += gear.tyre_damping_n_s_per_m * road.slope(place_m) * speed_m_per_s
    return forces


def aircraft_run(
    airframe: Airframe,
    *,
    rng: np.random.Generator,
    duration_s: float = 40.0,
    fs: float = 512.0,
    speed_m_per_s: tuple[float, float] = (18.0, 0.5),
    road_class: str = "B",
    footprint_m: float = 0.3,
    coherent_tracks: bool = True,
    sprung_sensors: Mapping[str, Place] | None = None,
    further_sensors: Mapping[str, Place] | None = None,
    sensor: Sensor = DEFAULT_SENSOR,
    sensors: Mapping[str, Sensor] | None = None,
    lowest_step_rate_hz: float = 4096.0,
) -> AircraftRun:
    """Return one run over a fresh runway, braking linearly, recorded as a logger would.

    The aircraft rolls for 8 s at the first speed before the record begins. Gears with the same y run over the same
    track one after the other. The response is computed at a whole multiple of fs, low-passed, decimated to fs, and read
    by the sensors.

    Args:
        airframe: the aircraft.
        rng: source of the runway and of the noise of each channel, each with a stream of its own: other sensors do not
            change the runway.
        duration_s: length of the record, s.
        fs: sampling rate of the record, Hz.
        speed_m_per_s: speed at its begin and at its end.
        road_class: ISO 8608 class, "A" to "H".
        footprint_m: length of the contact patch, m.
        coherent_tracks: whether the tracks lie on one isotropic surface; if not, they are independent.
        sprung_sensors: (x, y) of the sensor on the airframe that belongs to a gear, m; at the strut where left out.
        further_sensors: name and (x, y) of further sensors on the airframe.
        sensor: what every sensor is like.
        sensors: other ones, by the name of the channel.
        lowest_step_rate_hz: the step rate is the lowest multiple of fs that is not below this.

    Raises:
        InputError: a value that is out of range, a gear or channel that is not there, a sensor that leaks across its
            axis (there is no motion across it here).

    >>> from opid.virtual.taxi_tests.aircraft import default_aircraft
    >>> run = aircraft_run(default_aircraft(), duration_s=2.0, rng=np.random.default_rng(1),
    ...                    further_sensors={"tail": (-5.0, 0.0)})
    >>> run.recording.names[:3], run.recording.names[-1], run.recording.n_samples
    (('nose_lower_z', 'left_lower_z', 'right_lower_z'), 'tail', 1024)
    """
    if not (0.0 < duration_s < np.inf and 0.0 < fs < np.inf and duration_s * fs >= 2.0):
        raise InputError(f"duration_s is {duration_s} s, fs {fs} Hz: give positive numbers, two samples or more")
    lower, upper = _places(airframe, sprung_sensors or {}, further_sensors or {})
    fitted = _fitted((*lower, *upper), sensor, sensors or {})
    reading = place_directions(airframe, [*upper.values()])

    runway_rng, noise_rng = rng.spawn(2)
    speed = SpeedProfile(*speed_m_per_s, duration_s)
    lead_in = round(_LEAD_IN_S * fs)
    record = slice(lead_in, lead_in + round(duration_s * fs))
    track_settings = {"road_class": road_class, "footprint_m": footprint_m, "coherent": coherent_tracks}
    motion = _roll(airframe, speed, track_settings, runway_rng, lead_in / fs, fs, lowest_step_rate_hz)
    steps = round(motion.fs / fs)

    n_body = len(airframe.body_motions)
    acceleration = decimate(motion.acceleration, steps)
    body, wheels = acceleration[:, :n_body], acceleration[:, n_body:]
    true = np.hstack([wheels, body @ reading.T])
    streams = noise_rng.spawn(true.shape[1])
    readings = [
        measure(column, fs=fs, sensor=fitted[name], rng=stream)[record]
        for name, column, stream in zip(fitted, true.T, streams, strict=True)
    ]
    travels = [_travels(airframe, state[::steps][record]) for state in (motion.displacement, motion.velocity)]
    gears = [gear.name for gear in airframe.gears]
    channels = (
        *(Channel(name, "m/s^2") for name in fitted),
        *(Channel(f"{gear}_travel", "m") for gear in gears),
        *(Channel(f"{gear}_travel_velocity", "m/s") for gear in gears),
        *(Channel(name, _BODY_UNITS[name]) for name in airframe.body_motions),
    )
    truth = Recording(np.hstack([true[record], *travels, body[record]]), fs=fs, channels=channels)
    return AircraftRun(airframe, recording_from_arrays(readings, [*fitted], fs=fs), truth, {**lower, **upper}, speed)


def aircraft_test(
    airframe: Airframe, *, rng: np.random.Generator, loadings: Iterable[Iterable[Loading]], **settings: Any
) -> AircraftTest:
    """Return a run of the aircraft as it stands and further ones with loadings, each over a runway of its own.

    Each rests where its weight puts it on the laws of its struts.

    Args:
        airframe: the aircraft of the first run.
        rng: source of everything random.
        loadings: for each further run, the masses put on the aircraft of the first.
        settings: keyword arguments of `aircraft_run`, for all runs.

    Raises:
        InputError: as `loaded` and `aircraft_run`.

    >>> from opid.virtual.taxi_tests.aircraft import default_aircraft
    >>> test = aircraft_test(default_aircraft(), loadings=[[Loading(400.0, 2.0)]], duration_s=1.0,
    ...                      rng=np.random.default_rng(1))
    >>> [run.airframe.mass_kg for run in test.runs]
    [5400.0, 5800.0]
    """
    every = ((), *(tuple(one) for one in loadings))
    streams = rng.spawn(len(every))
    runs = (
        aircraft_run(_resting(loaded(airframe, one), one), rng=rng, **settings)
        for one, rng in zip(every, streams, strict=True)
    )
    return AircraftTest(tuple(runs), every)


def _resting(airframe: Airframe, loadings: Sequence[Loading]) -> Airframe:
    """The airframe where it rests under loadings; it is stiff against its struts."""
    struts = [
        Interface(gear.suspension_stiffness_n_per_m, 0.0, gear.ground_stiffness_n_per_m, gear.law)
        for gear in airframe.gears
    ]
    rows = np.array([[1.0, gear.y_m, -gear.x_m] for gear in airframe.gears])
    load = np.zeros(3)
    for each in loadings:
        load -= each.mass_kg * GRAVITY_M_PER_S2 * np.array([1.0, each.y_m, -each.x_m])
    laws = laws_at_rest(struts, rows, load)
    return replace(airframe, gears=tuple(replace(g, law=law) for g, law in zip(airframe.gears, laws, strict=True)))


def _places(
    airframe: Airframe, sprung_sensors: Mapping[str, Place], further_sensors: Mapping[str, Place]
) -> tuple[dict[str, Place], dict[str, Place]]:
    """Return where the sensor of each channel is, on the wheels and on the airframe."""
    gears = {gear.name: (gear.x_m, gear.y_m) for gear in airframe.gears}
    for name in sprung_sensors:
        if name not in gears:
            raise InputError(f"sprung_sensors has a gear {name!r}: {nearest(name, gears)}")
    lower = {f"{name}_lower_z": place for name, place in gears.items()}
    upper = {f"{name}_upper_z": sprung_sensors.get(name, place) for name, place in gears.items()}
    for name in further_sensors:
        if name in lower or name in upper:
            raise InputError(f"further_sensors has {name!r}, a channel of a gear: give it another name")
    return lower, {**upper, **further_sensors}


def _fitted(channels: Sequence[str], sensor: Sensor, sensors: Mapping[str, Sensor]) -> dict[str, Sensor]:
    """Return the sensor of each channel."""
    for name in sensors:
        if name not in channels:
            raise InputError(f"sensors has a channel {name!r}: {nearest(name, channels)}")
    fitted = {name: sensors.get(name, sensor) for name in channels}
    for name, one in fitted.items():
        if one.cross_axis != 0.0:
            raise InputError(
                f"the sensor of {name!r} leaks across its axis by {one.cross_axis}: an aircraft run has "
                "vertical motion alone, set cross_axis to 0"
            )
    return fitted


def _roll(
    airframe: Airframe,
    speed: SpeedProfile,
    track_settings: dict[str, Any],
    rng: np.random.Generator,
    lead_in_s: float,
    fs: float,
    lowest_step_rate_hz: float,
) -> Response:
    """Return the response from `lead_in_s` before the record to a little after it, at a multiple of fs."""
    gears = airframe.gears
    begin_m = float(speed.position_m(-lead_in_s))
    way_m = float(speed.position_m(speed.duration_s + _TAIL_S)) - begin_m
    wheel_base_m = max(gear.x_m for gear in gears) - min(gear.x_m for gear in gears)
    lateral_m = [gear.y_m for gear in gears]
    tracks = iso8608_tracks(lateral_m=lateral_m, length_m=max(way_m + wheel_base_m, 1.0), rng=rng, **track_settings)

    def forces(time_s: FloatArray) -> FloatArray:
        time = time_s - lead_in_s
        return tyre_forces(airframe, tracks, speed.position_m(time) - begin_m, speed.speed_m_per_s(time))

    steps = max(1, int(np.ceil(lowest_step_rate_hz / fs)))
    structure = airframe_structure(airframe)
    return time_response(
        structure,
        forces,
        fs=steps * fs,
        duration_s=lead_in_s + speed.duration_s + _TAIL_S,
        loads=np.eye(structure.n_dof)[:, -len(gears) :],
    )


def _travels(airframe: Airframe, state: FloatArray) -> FloatArray:
    """Return z or z' of each strut, (n, n_gears), from displacement or velocity, (n, n_dof)."""
    at_struts = place_directions(airframe, [(gear.x_m, gear.y_m) for gear in airframe.gears])
    n_body = at_struts.shape[1]
    return state[:, :n_body] @ at_struts.T - state[:, n_body:]
