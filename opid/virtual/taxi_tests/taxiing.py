"""An aircraft taxiing over a rough runway on one gear or several: a field test, its truth and its owner's study."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from datetime import date
from functools import partial
from typing import Any

import numpy as np
from scipy import interpolate, signal

from opid.errors import InputError, nearest
from opid.mechanics.driven import Interface
from opid.mechanics.laws.law import FloatArray
from opid.mechanics.repeatability import Departure
from opid.mechanics.response import Response, time_response
from opid.mechanics.truth import BodyNumbers, BodyTruth, GearNumbers, GearTruth, SuspensionTruth, TaxiTruth
from opid.mechanics.weight import GRAVITY_M_PER_S2, laws_at_rest
from opid.signals.recording import Channel, Recording, recording_from_arrays
from opid.suspensions.study import BodySensor, MeasuredInterface, PointMass, Run, StructureSettings, Study
from opid.virtual.taxi_tests.airframe import (
    Airframe,
    LandingGear,
    airframe_mass,
    airframe_structure,
    loaded,
    place_directions,
)
from opid.virtual.taxi_tests.road import Road, SpeedProfile, iso8608_tracks
from opid.virtual.taxi_tests.sensors import DEFAULT_SENSOR, Mounting, Sensor, decimate, measure, measure_axes

Place = tuple[float, float]
# Before the record begins, the start from rest has decayed to exp(-8) in the bounce of a gear, and to exp(-2.5) in the
# least damped mode of a random aircraft; the filter needs the tail.
_LEAD_IN_S, _TAIL_S = 8.0, 0.25
_NOISE_BAND_HZ = (0.5, 40.0)
_PITCH_HZ = 1.5
_MOST_STEPS, _STEP_BYTES = 2e7, 250.0  # of a simulation: 80 minutes at 4096 Hz, which take 3 to 5 GB
_BODY_UNITS = {"heave": "m/s^2", "roll": "rad/s^2", "pitch": "rad/s^2", "bending": "m/s^2"}


@dataclass(frozen=True, eq=False)
class TaxiRun:
    """One taxi run of an aircraft: the record of the logger, and the truth behind it.

    Attributes:
        airframe: the aircraft that ran, loadings included.
        recording: channels <gear>_lower_z (wheel) of all gears, then <gear>_upper_z (airframe) of all gears, then the
            further channels, m/s^2; with fore_aft also <gear>_lower_x, ... Those of a gear alone are lower_z, ...
        truth: the same vertical channels at the same times without sensor faults; <gear>_travel z (m) and
            <gear>_travel_velocity z' (m/s) of each strut; heave (m/s^2), roll and pitch (rad/s^2) of the airframe about
            the origin, and bending (m/s^2) if it bends. A gear alone has no name before these, and only heaves.
        places_m: positions (x, y) of each vertical channel of `recording`, m.
        speed: the speed over the ground.
    """

    airframe: Airframe
    recording: Recording
    truth: Recording
    places_m: dict[str, Place]
    speed: SpeedProfile

    @property
    def gear(self) -> LandingGear:
        """The first gear with all of the mass; for a gear alone, the machine that ran."""
        return LandingGear(**vars(self.airframe.gears[0]), sprung_mass_kg=self.airframe.mass_kg)


@dataclass(frozen=True, eq=False)
class TaxiTest:
    """Taxi runs of one aircraft, the first without loadings, the others with loadings.

    Args:
        runs: the runs.
        loadings: masses put on the aircraft of the first run, one tuple for each run; the first is empty.
    """

    runs: tuple[TaxiRun, ...]
    loadings: tuple[tuple[PointMass, ...], ...]

    @property
    def heavy(self) -> TaxiRun:
        """The reference run of a gear."""
        return self.runs[0]

    @property
    def light(self) -> TaxiRun:
        """The run with less sprung mass."""
        return self.runs[1]

    @property
    def mass_change_kg(self) -> float:
        """Sprung mass of the second run less that of the first, kg: negative where mass was taken off."""
        return self.light.airframe.mass_kg - self.heavy.airframe.mass_kg


def tyre_forces(
    airframe: Airframe, tracks: Sequence[Road], travelled_m: FloatArray, speed_m_per_s: FloatArray
) -> FloatArray:
    """Return the force of the road through each tyre, K1 xb + C1 xb' on its wheel, (n, n_gears) N.

    Args:
        airframe: the airframe, with any origin.
        tracks: the road under each gear, xb = elevation and xb' = slope times speed.
        travelled_m: (n,) position of the rearmost gear on its track, m.
        speed_m_per_s: (n,) speed at these positions, m/s.

    Raises:
        InputError: another number of tracks than of gears.
    """
    if len(tracks) != len(airframe.gears):
        raise InputError(
            f"there are {len(tracks)} track(s) for {len(airframe.gears)} gear(s): give one road for each gear"
        )
    forces = np.empty((travelled_m.size, len(airframe.gears)))
    rearmost_m = min(gear.x_m for gear in airframe.gears)
    for column, (gear, road) in enumerate(zip(airframe.gears, tracks, strict=True)):
        position_m = travelled_m + (gear.x_m - rearmost_m)
        forces[:, column] = gear.tyre_stiffness_n_per_m * road.elevation(position_m)
        forces[:, column] += gear.tyre_damping_n_s_per_m * road.slope(position_m) * speed_m_per_s
    return forces


def taxi_run(
    aircraft: Airframe | LandingGear,
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
    lower_sensor: Sensor = DEFAULT_SENSOR,
    upper_sensor: Sensor = DEFAULT_SENSOR,
    sensors: Mapping[str, Sensor] | None = None,
    fore_aft: bool = False,
    fore_aft_ratio: float = 1.0,
    pushed_fraction: float = 0.0,
    mountings: Mapping[str, Mounting] | None = None,
    standstill_s: float = 0.0,
    pitch_rad_s2_per_m: float = 0.0,
    lowest_step_rate_hz: float = 4096.0,
) -> TaxiRun:
    """Return one run over a new runway, braking linearly, as a logger would record it.

    The aircraft rolls for 8 s at the first speed before the record begins, so that the start from rest is not in it.
    Gears with the same y run over the same track one after the other. The response is computed at a whole multiple of
    fs, low-passed, decimated to fs, and read by the sensors. The fore-aft motion at each sensor, which leaks in through
    its cross-axis sensitivity, is band-limited (0.5 to 40 Hz) Gaussian noise, independent of the vertical motion, with
    `fore_aft_ratio` times its rms.

    Args:
        aircraft: an aircraft on several gears, or a gear alone.
        rng: source of the runway, of the noise of each channel and of the fore-aft motion, each with a stream of its
            own: other sensors do not change the runway.
        duration_s: length of the record, s.
        fs: sampling rate of the record, Hz.
        speed_m_per_s: speed at the beginning and at the end of the record.
        road_class: ISO 8608 class, "A" to "H".
        footprint_m: length of the contact patch, m.
        coherent_tracks: whether the tracks lie on one isotropic surface; if not, they are independent.
        sprung_sensors: position (x, y) of the sensor on the airframe that belongs to a gear, m; at the strut where left
            out.
        further_sensors: names and positions (x, y) of further sensors on the airframe.
        lower_sensor: properties of every sensor on a wheel.
        upper_sensor: properties of every sensor on the airframe.
        sensors: properties of single sensors, by the name of the vertical channel.
        fore_aft: whether the fore-aft accelerations are recorded, too.
        fore_aft_ratio: rms of fore-aft over vertical acceleration.
        pushed_fraction: rms acceleration of the airframe by a random force and moments alone, over that by the road, in
            heave, roll and pitch alike; no sensor measures this force, of 0.5 to 40 Hz.
        mountings: how sensors with three axes are fastened, by the name of the vertical channel. They read gravity,
            the braking and a fore-aft motion, and record <gear>_lower_x, ..._y and ..._z in their own axes, then
            ..._rate_x, ... if they have a gyroscope.
        standstill_s: time at the beginning of the record at which the vehicle stands still, at most 8 s.
        pitch_rad_s2_per_m: pitch of the airframe, nose down, per deceleration below 1.5 Hz; sensors with `mountings`
            turn with it.
        lowest_step_rate_hz: least step rate; the step rate is the lowest multiple of fs that is not below it.

    Raises:
        InputError: a value that is out of range, or a gear or channel that does not exist.

    >>> run = taxi_run(LandingGear(), duration_s=4.0, rng=np.random.default_rng(1))
    >>> run.recording.names, run.recording.n_samples
    (('lower_z', 'upper_z'), 2048)
    >>> from opid.virtual.taxi_tests.aircraft import default_aircraft
    >>> run = taxi_run(default_aircraft(), duration_s=2.0, rng=np.random.default_rng(1),
    ...                further_sensors={"tail": (-5.0, 0.0)})
    >>> run.recording.names[:3], run.recording.names[-1], run.recording.n_samples
    (('nose_lower_z', 'left_lower_z', 'right_lower_z'), 'tail', 1024)
    """
    airframe = aircraft.airframe if isinstance(aircraft, LandingGear) else aircraft
    if not (0.0 < duration_s < np.inf and 0.0 < fs < np.inf and duration_s * fs >= 2.0):
        raise InputError(f"duration_s is {duration_s} s, fs {fs} Hz: give positive numbers, two samples or more")
    n_steps = (_LEAD_IN_S + duration_s + _TAIL_S) * max(fs, lowest_step_rate_hz)
    if n_steps > _MOST_STEPS:
        raise InputError(
            f"duration_s is {duration_s:g} s and fs {fs:g} Hz: with {_LEAD_IN_S + _TAIL_S:g} s around it the "
            f"simulation takes {n_steps:.2g} steps and {1e-9 * _STEP_BYTES * n_steps:.2g} GB; give at most "
            f"{_MOST_STEPS:g} steps"
        )
    if not 0.0 <= pushed_fraction < np.inf:
        raise InputError(f"pushed_fraction is {pushed_fraction}: give zero or a positive number")
    if not 0.0 <= standstill_s <= _LEAD_IN_S:
        raise InputError(f"standstill_s is {standstill_s} s: give zero to {_LEAD_IN_S:g} s")
    lower, upper = _find_places(airframe, sprung_sensors or {}, further_sensors or {})
    fitted = dict.fromkeys(lower, lower_sensor) | dict.fromkeys(upper, upper_sensor)
    for what, given in (("sensors", sensors), ("mountings", mountings)):
        for name in given or {}:
            if name not in fitted:
                raise InputError(f"{what} has a channel {name!r}: {nearest(name, fitted)}")
    fitted |= sensors or {}
    reading = place_directions(airframe, [*upper.values()])

    runway_rng, streams = _spawn_streams(rng, len(fitted), is_one_gear=airframe.is_one_gear)
    speed = SpeedProfile(*speed_m_per_s, duration_s)
    lead_in = round(_LEAD_IN_S * fs)
    still = round(standstill_s * fs)
    record = slice(lead_in - still, lead_in + round(duration_s * fs))
    track_settings = {"road_class": road_class, "footprint_m": footprint_m, "coherent": coherent_tracks}
    push = (pushed_fraction, rng.spawn(1)[0]) if pushed_fraction else None
    motion = _simulate_roll(airframe, speed, track_settings, runway_rng, lead_in / fs, fs, lowest_step_rate_hz, push)
    steps = round(motion.fs / fs)

    n_body = len(airframe.body_motions)
    acceleration = decimate(motion.acceleration, steps)
    body, wheels = acceleration[:, :n_body], acceleration[:, n_body:]
    moving = np.arange(len(acceleration)) >= (lead_in if still else 0)
    acceleration[~moving] = 0.0
    true = np.hstack([wheels, body @ reading.T])
    braking = moving * (speed_m_per_s[1] - speed_m_per_s[0]) / duration_s
    along: dict[str, FloatArray] = {}
    across: dict[str, FloatArray] = {}
    for (name, sensor), up, (z_rng, x_rng, motion_rng) in zip(fitted.items(), true.T, streams, strict=True):
        forward = _draw_band_noise(up, fore_aft_ratio, fs, motion_rng)
        if mountings and name in mountings:
            sideways = moving * _draw_band_noise(up, fore_aft_ratio, fs, x_rng)
            forward = moving * forward + braking
            # The airframe pitches, the wheel does not.
            pitch = -pitch_rad_s2_per_m * _pass_slow(forward, fs) * (name in upper)
            axes = measure_axes(
                np.stack([forward, sideways, up], axis=1),
                fs=fs,
                sensor=sensor,
                mounting=mountings[name],
                rng=z_rng,
                pitch_rad=pitch,
            )
            names = (f"{name.removesuffix('_z')}_{what}{axis}" for what in ("", "rate_") for axis in "xyz")
            along |= dict(zip(names, axes[record].T, strict=False))
            continue
        along[name] = measure(up, fs=fs, sensor=sensor, rng=z_rng, cross_axis_acceleration=forward)[record]
        x_name = f"{name.removesuffix('_z')}_x"
        across[x_name] = measure(forward, fs=fs, sensor=sensor, rng=x_rng, cross_axis_acceleration=up)[record]
    read = along | (across if fore_aft else {})

    z, rate = (moving[record, None] * state[::steps][record] for state in (motion.displacement, motion.velocity))
    travels = [each[:, :n_body] @ airframe.strut_directions.T - each[:, n_body:] for each in (z, rate)]
    channels = (
        *(Channel(name, "m/s^2") for name in fitted),
        *(Channel(f"{_make_prefix(gear.name)}travel", "m") for gear in airframe.gears),
        *(Channel(f"{_make_prefix(gear.name)}travel_velocity", "m/s") for gear in airframe.gears),
        *(Channel(name, _BODY_UNITS[name]) for name in airframe.body_motions),
    )
    truth = Recording(np.hstack([true[record], *travels, body[record]]), fs=fs, channels=channels)
    units = ["rad/s" if "_rate_" in name else "m/s^2" for name in read]
    recording = recording_from_arrays([*read.values()], [*read], fs=fs, unit=units)
    return TaxiRun(airframe, recording, truth, {**lower, **upper}, speed)


def taxi_test(
    aircraft: Airframe | LandingGear,
    *,
    rng: np.random.Generator,
    mass_removed_kg: float = 220.0,
    loadings: Iterable[Iterable[PointMass]] | None = None,
    departures: Sequence[Departure] | None = None,
    **settings: Any,
) -> TaxiTest:
    """Return a run of the aircraft without loadings and further ones with loadings, each over a runway of its own.

    In each run the aircraft rests at the travel that its weight gives on the laws of its struts.

    Args:
        aircraft: the aircraft of the first run, with its laws about the travel at which it then rests.
        rng: source of everything random.
        mass_removed_kg: sprung mass taken away before the second run, where no loadings are given.
        loadings: masses put on the aircraft of the first run, for each further run.
        departures: departures of the struts of each run from the given ones; None if there are none.
        settings: keyword arguments of `taxi_run`, for all runs.

    Raises:
        InputError: a removed mass that is negative or not below the sprung mass, or what `loaded` and `taxi_run`
            refuse.

    >>> test = taxi_test(LandingGear(), duration_s=2.0, rng=np.random.default_rng(1))
    >>> test.mass_change_kg
    -220.0
    >>> from opid.virtual.taxi_tests.aircraft import default_aircraft
    >>> test = taxi_test(default_aircraft(), loadings=[[PointMass(400.0, 2.0)]], duration_s=1.0,
    ...                  rng=np.random.default_rng(1))
    >>> [run.airframe.mass_kg for run in test.runs]
    [5400.0, 5800.0]
    """
    airframe = aircraft.airframe if isinstance(aircraft, LandingGear) else aircraft
    if loadings is None:
        if not 0.0 <= mass_removed_kg < airframe.mass_kg:
            raise InputError(
                f"mass_removed_kg is {mass_removed_kg}, the sprung mass {airframe.mass_kg} kg: "
                "give zero or more, and less than the sprung mass"
            )
        loadings = [[PointMass(-mass_removed_kg, airframe.x_cg_m, airframe.y_cg_m)]]
    every = ((), *(tuple(one) for one in loadings))
    departures = (Departure(),) * len(every) if departures is None else departures
    resting = [_put_to_rest(airframe, *each) for each in zip(every, departures, strict=True)]
    runs = (taxi_run(each, rng=stream, **settings) for each, stream in zip(resting, rng.spawn(len(every)), strict=True))
    return TaxiTest(tuple(runs), every)


def taxi_truth(test: TaxiTest, *, settings: Mapping[str, Any] | None = None) -> TaxiTruth:
    """Return the truth of a simulated taxi test: a `GearTruth` for a gear, a `BodyTruth` for an aircraft.

    Args:
        test: the field test; its first run is the reference.
        settings: the settings of the simulation, which are kept as they are.
    """
    airframe, given = test.runs[0].airframe, dict(settings or {})
    if airframe.is_one_gear:
        gear = test.heavy.gear
        numbers = GearNumbers(*(getattr(gear, each.name) for each in fields(GearNumbers)))
        return GearTruth(numbers, gear.law, test.mass_change_kg, given)
    assert airframe.ixx_kg_m2 is not None  # only a gear alone may lack it
    assert airframe.iyy_kg_m2 is not None
    return BodyTruth(
        BodyNumbers(airframe.mass_kg, airframe.ixx_kg_m2, airframe.iyy_kg_m2, airframe.x_cg_m, airframe.y_cg_m),
        {
            gear.name: SuspensionTruth(
                gear.x_m, gear.y_m, gear.suspension_stiffness_n_per_m, gear.suspension_damping_n_s_per_m, gear.law
            )
            for gear in airframe.gears
        },
        {
            name: tuple((each.mass_kg, each.x_m, each.y_m) for each in loading)
            for name, loading in zip(name_runs(test), test.loadings, strict=True)
        },
        given,
    )


def taxi_study(
    test: TaxiTest,
    *,
    title: str,
    shared: Sequence[Sequence[str]] = (),
    position_tolerance_m: float = 0.0,
    noise_m_per_s2: float | None = None,
    day: date | None = None,
) -> Study:
    """Return the study of a simulated taxi test, as the owner of the aircraft would write it.

    Args:
        test: the field test; its first run is the reference.
        title: the title of the study.
        shared: names of gears that have the same stiffness, damping and law.
        position_tolerance_m: tolerance that is stated for the coordinates of an aircraft.
        noise_m_per_s2: rms noise that is stated for the sensors of an aircraft; None if it is not known.
        day: day of the runs.
    """
    first = test.runs[0]
    is_one_gear = first.airframe.is_one_gear
    positions, n_gears = first.places_m, len(first.airframe.gears)
    channels, interfaces = [*positions], []
    for gear, unsprung, sprung in zip(
        first.airframe.gears, channels[:n_gears], channels[n_gears : 2 * n_gears], strict=True
    ):
        beside = () if positions[sprung] == (gear.x_m, gear.y_m) else positions[sprung]
        interfaces.append(MeasuredInterface(gear.name or "gear", sprung, unsprung, gear.x_m, gear.y_m, *beside))
    structure = StructureSettings(
        shared=tuple(tuple(group) for group in shared),
        position_tolerance_m=position_tolerance_m,
        noise_m_per_s2=noise_m_per_s2,
    )
    return Study(
        title=title,
        interfaces=tuple(interfaces),
        runs=tuple(
            Run(name, run.recording, loading)
            for name, run, loading in zip(name_runs(test), test.runs, test.loadings, strict=True)
        ),
        structure=StructureSettings() if is_one_gear else structure,
        sensors=tuple(BodySensor(name, *positions[name]) for name in channels[2 * n_gears :]),
        date=day,
    )


def name_runs(test: TaxiTest) -> list[str]:
    """Return the names of the runs: the reference, and those with loadings."""
    first, further = ("heavy", "light") if test.runs[0].airframe.is_one_gear else ("reference", "loaded")
    if len(test.runs) == 2:
        return [first, further]
    return [first, *(f"{further}_{number}" for number in range(1, len(test.runs)))]


def _put_to_rest(airframe: Airframe, loadings: Sequence[PointMass], departure: Departure) -> Airframe:
    """Return the airframe of one run, at rest under its weight; its bending by that weight is neglected."""
    struts = [
        departure.of(
            Interface(
                gear.suspension_stiffness_n_per_m,
                gear.suspension_damping_n_s_per_m,
                gear.ground_stiffness_n_per_m,
                gear.law,
            )
        )
        for gear in airframe.gears
    ]
    rigid = slice(0, 3)
    # Stiffer springs carry more at the same travel, so that the body is lifted.
    lifted_kg = departure.spring * airframe_mass(airframe)[0, rigid]
    for each in loadings:
        lifted_kg = lifted_kg - each.mass_kg * place_directions(airframe, [(each.x_m, each.y_m)])[0, rigid]
    laws = laws_at_rest(struts, airframe.strut_directions[:, rigid], GRAVITY_M_PER_S2 * lifted_kg)
    gears = (
        replace(gear, suspension_stiffness_n_per_m=strut.stiffness, suspension_damping_n_s_per_m=strut.damping, law=law)
        for gear, strut, law in zip(airframe.gears, struts, laws, strict=True)
    )
    return replace(loaded(airframe, loadings), gears=tuple(gears))


def _make_prefix(gear: str) -> str:
    """Return the prefix of the channels of a gear; a gear alone has none."""
    return f"{gear}_" if gear else ""


def _find_places(
    airframe: Airframe, sprung_sensors: Mapping[str, Place], further_sensors: Mapping[str, Place]
) -> tuple[dict[str, Place], dict[str, Place]]:
    """Return the positions of the sensors on the wheels, and of those on the airframe, by channel."""
    gears = {gear.name: (gear.x_m, gear.y_m) for gear in airframe.gears}
    for name in sprung_sensors:
        if name not in gears:
            raise InputError(f"sprung_sensors has a gear {name!r}: {nearest(name, gears)}")
    lower = {f"{_make_prefix(name)}lower_z": place for name, place in gears.items()}
    upper = {f"{_make_prefix(name)}upper_z": sprung_sensors.get(name, place) for name, place in gears.items()}
    for name in further_sensors:
        if name in lower or name in upper:
            raise InputError(f"further_sensors has {name!r}, a channel of a gear: give it another name")
    return lower, {**upper, **further_sensors}


def _spawn_streams(
    rng: np.random.Generator, n_channels: int, *, is_one_gear: bool
) -> tuple[np.random.Generator, list[Sequence[np.random.Generator]]]:
    """Return the generator of the runway, and those of each channel for its noise, fore-aft noise and motion.

    The order in which they are spawned must not change: it makes a seed the same run in every version.
    """
    if is_one_gear:
        runway, *others = rng.spawn(1 + 2 * n_channels)
        noise, motion = others[:n_channels], others[n_channels:]
        return runway, [(*one.spawn(2), other) for one, other in zip(noise, motion, strict=True)]
    runway, of_channels = rng.spawn(2)
    return runway, [*zip(*(of_channels.spawn(n_channels) for _ in range(3)), strict=True)]


def _simulate_roll(
    airframe: Airframe,
    speed: SpeedProfile,
    track_settings: dict[str, Any],
    rng: np.random.Generator,
    lead_in_s: float,
    fs: float,
    lowest_step_rate_hz: float,
    push: tuple[float, np.random.Generator] | None,
) -> Response:
    """Simulate the response from `lead_in_s` before the record to a little after it, at a multiple of fs."""
    gears = airframe.gears
    begin_m = float(speed.position_m(-lead_in_s))
    distance_m = float(speed.position_m(speed.duration_s + _TAIL_S)) - begin_m
    wheel_base_m = max(gear.x_m for gear in gears) - min(gear.x_m for gear in gears)
    lateral_m = [gear.y_m for gear in gears]
    tracks = iso8608_tracks(
        lateral_m=lateral_m, length_m=max(distance_m + wheel_base_m, 1.0), rng=rng, **track_settings
    )

    def press_tyres(time_s: FloatArray) -> FloatArray:
        time = time_s - lead_in_s
        return tyre_forces(airframe, tracks, speed.position_m(time) - begin_m, speed.speed_m_per_s(time))

    steps, structure = max(1, int(np.ceil(lowest_step_rate_hz / fs))), airframe_structure(airframe)
    respond = partial(time_response, structure, fs=steps * fs, duration_s=lead_in_s + speed.duration_s + _TAIL_S)
    wheels = np.eye(structure.n_dof)[:, -len(gears) :]
    motion = respond(press_tyres, loads=wheels)
    if push is None:
        return motion
    # The force M a gives the free airframe the acceleration a, which is a fraction of that by the road.
    rigid = slice(0, min(len(airframe.body_motions), 3))
    fraction, push_rng = push
    each = [
        _draw_band_noise(moved, fraction, fs, stream)
        for moved, stream in zip(motion.acceleration[::steps, rigid].T, push_rng.spawn(rigid.stop), strict=True)
    ]
    pushed = interpolate.make_interp_spline(motion.time_s[::steps], np.stack(each, axis=1))
    loads = np.hstack([wheels, structure.mass[:, rigid]])
    return respond(lambda time_s: np.hstack([press_tyres(time_s), pushed(time_s)]), loads=loads)


def _pass_slow(acceleration: FloatArray, fs: float) -> FloatArray:
    """Return the part of a motion that a body follows with its pitch."""
    return np.asarray(signal.sosfilt(signal.butter(2, _PITCH_HZ, fs=fs, output="sos"), acceleration))


def _draw_band_noise(motion: FloatArray, ratio: float, fs: float, rng: np.random.Generator) -> FloatArray:
    """Draw band-limited noise whose rms is `ratio` times that of a motion."""
    low, high = _NOISE_BAND_HZ
    band = signal.butter(2, (low, min(high, 0.4 * fs)), "bandpass", fs=fs, output="sos")
    noise = signal.sosfilt(band, rng.standard_normal(motion.size))
    return noise * ratio * np.std(motion) / np.std(noise)
