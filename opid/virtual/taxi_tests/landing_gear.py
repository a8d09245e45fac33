"""A landing gear taxiing over a rough apron: a field test with known truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import signal

from opid.errors import InputError
from opid.mechanics.driven import Interface
from opid.mechanics.hysteresis import Sliders
from opid.mechanics.laws.law import FloatArray, Law, law
from opid.mechanics.repeatability import Departure
from opid.mechanics.response import Response, time_response
from opid.mechanics.structure import Joint, Structure
from opid.mechanics.weight import GRAVITY_M_PER_S2, laws_at_rest
from opid.signals.recording import Channel, Recording, recording_from_arrays
from opid.virtual.taxi_tests.road import Road, SpeedProfile, iso8608_road
from opid.virtual.taxi_tests.sensors import Sensor, decimate, measure

DEFAULT_LAW = law("arctan_velocity", amplitude_n=400.0, scale_m_per_s=0.02)
DEFAULT_SENSOR = Sensor()
# the start from rest decays as exp(-zeta omega t), about exp(-8) for the bounce; the tail serves the filter
_LEAD_IN_S, _TAIL_S = 8.0, 0.25
_FORE_AFT_BAND_HZ = (0.5, 40.0)


@dataclass(frozen=True)
class LandingGear:
    """A main gear and its share of the airframe: two masses, a strut and a tyre, Iwaniec & Uhl 2007, Fig. 5.

        M2 x2'' = -C2 z' - K2 z - K3 x2 - f(z, z'),   z = x2 - x1
        M1 x1'' = +C2 z' + K2 z + f(z, z') - K1 (x1 - xb) - C1 (x1' - xb')

    Displacements are upward from static equilibrium; xb is the road under the tyre.

    Args:
        sprung_mass_kg: M2.
        unsprung_mass_kg: M1, wheel and rocker.
        suspension_stiffness_n_per_m: K2.
        suspension_damping_n_s_per_m: C2.
        tyre_stiffness_n_per_m: K1.
        tyre_damping_n_s_per_m: C1.
        ground_stiffness_n_per_m: K3, from the sprung mass to the ground; 0 for a free aircraft.
        law: f(z, z') of the strut.
        sliders: of the strut, beside the law; None for none.

    Raises:
        InputError: a mass or tyre stiffness that is not positive, a suspension without any spring, another value that
            is negative.
    """

    sprung_mass_kg: float = 1850.0
    unsprung_mass_kg: float = 105.0
    suspension_stiffness_n_per_m: float = 3.9e5
    suspension_damping_n_s_per_m: float = 6e3
    tyre_stiffness_n_per_m: float = 6.2e5
    tyre_damping_n_s_per_m: float = 1.5e3
    ground_stiffness_n_per_m: float = 0.0
    law: Law = DEFAULT_LAW
    sliders: Sliders | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name in ("law", "sliders"):
                continue
            may_be_zero = "damping" in name or name == "ground_stiffness_n_per_m"
            # gas may carry all of the weight
            may_be_zero |= name == "suspension_stiffness_n_per_m" and float(self.law.gradient(0.0, 0.0)[0]) > 0.0
            if not (0.0 <= value < np.inf) or (value == 0.0 and not may_be_zero):
                needed = "zero or more" if may_be_zero else "a positive number"
                raise InputError(f"{name} of the landing gear is {value}: give {needed}")


@dataclass(frozen=True, eq=False)
class TaxiRun:
    """One taxi run: what the logger wrote, and the truth behind it.

    Attributes:
        gear: the gear that ran.
        recording: lower_z (spindle) and upper_z (airframe), m/s^2; with fore_aft also lower_x and upper_x.
        truth: at the same times, lower_z, upper_z (m/s^2, without sensor faults), travel z (m) and
            travel_velocity z' (m/s).
        speed: the speed over the ground.
    """

    gear: LandingGear
    recording: Recording
    truth: Recording
    speed: SpeedProfile


@dataclass(frozen=True, eq=False)
class TaxiTest:
    """Two taxi runs of one aircraft at two masses.

    Args:
        heavy: the reference run.
        light: the run with less sprung mass.
    """

    heavy: TaxiRun
    light: TaxiRun

    @property
    def mass_change_kg(self) -> float:
        """Sprung mass of the light run less that of the heavy one, kg: negative."""
        return self.light.gear.sprung_mass_kg - self.heavy.gear.sprung_mass_kg


def gear_structure(gear: LandingGear) -> Structure:
    """Return the structure of a gear, degrees of freedom "unsprung" x1 and "sprung" x2.

    The road acts through a force, see `tyre_force`.

    >>> from opid.mechanics.structure import natural_frequencies
    >>> natural_frequencies(gear_structure(LandingGear())).frequency_hz.round(2)
    array([ 1.8 , 15.68])
    """
    return Structure(
        mass=np.diag([gear.unsprung_mass_kg, gear.sprung_mass_kg]),
        damping=np.diag([gear.tyre_damping_n_s_per_m, 0.0]),
        stiffness=np.diag([gear.tyre_stiffness_n_per_m, gear.ground_stiffness_n_per_m]),
        joints=(
            Joint(
                "strut",
                np.array([-1.0, 1.0]),
                gear.suspension_stiffness_n_per_m,
                gear.suspension_damping_n_s_per_m,
                gear.law,
                gear.sliders,
            ),
        ),
        names=("unsprung", "sprung"),
    )


def tyre_force(gear: LandingGear, road: Road, place_m: FloatArray, speed_m_per_s: FloatArray) -> FloatArray:
    """Return the force of the road through the tyre, K1 xb + C1 xb' on the unsprung mass, (n, 2) N.

    Args:
        gear: the gear.
        road: the road, xb = elevation and xb' = slope times speed.
        place_m: (n,) place on the road, m.
        speed_m_per_s: (n,) speed there, m/s.
    """
    force = np.zeros((place_m.size, 2))
    force[:, 0] = gear.tyre_stiffness_n_per_m * road.elevation(place_m)
    force[:, 0] += gear.tyre_damping_n_s_per_m * road.slope(place_m) * speed_m_per_s
    return force


def taxi_run(
    gear: LandingGear,
    *,
    rng: np.random.Generator,
    duration_s: float = 40.0,
    fs: float = 512.0,
    speed_m_per_s: tuple[float, float] = (18.0, 0.5),
    road_class: str = "B",
    footprint_m: float = 0.3,
    lower_sensor: Sensor = DEFAULT_SENSOR,
    upper_sensor: Sensor = DEFAULT_SENSOR,
    fore_aft: bool = False,
    fore_aft_ratio: float = 1.0,
    lowest_step_rate_hz: float = 4096.0,
) -> TaxiRun:
    """Return one run over a fresh road, braking linearly, recorded as a logger would.

    The gear rolls for 8 s at the first speed before the record begins: nothing starts from rest in it. The
    response is computed at a whole multiple of fs, low-passed, decimated to fs, and read by the sensors. The
    fore-aft motion of each station, which leaks in through a sensor's cross-axis sensitivity, is band-limited
    (0.5 to 40 Hz) Gaussian noise, independent of the vertical motion, with `fore_aft_ratio` times its rms.

    Args:
        gear: the gear.
        rng: source of the road, of the noise of each sensor and of the fore-aft motion, each with a stream of
            its own: another sensor does not change the road.
        duration_s: length of the record, s.
        fs: sampling rate of the record, Hz.
        speed_m_per_s: speed at its begin and at its end.
        road_class: ISO 8608 class, "A" to "H".
        footprint_m: length of the contact patch, m.
        lower_sensor: the sensor on the spindle.
        upper_sensor: the sensor on the airframe.
        fore_aft: whether the fore-aft accelerations are recorded too.
        fore_aft_ratio: rms of fore-aft over vertical acceleration.
        lowest_step_rate_hz: the step rate is the lowest multiple of fs that is not below this.

    Raises:
        InputError: a value that is out of range.

    >>> run = taxi_run(LandingGear(), duration_s=4.0, rng=np.random.default_rng(1))
    >>> run.recording.names, run.recording.n_samples
    (('lower_z', 'upper_z'), 2048)
    """
    if not (0.0 < duration_s < np.inf and 0.0 < fs < np.inf and duration_s * fs >= 2.0):
        raise InputError(f"duration_s is {duration_s} s, fs {fs} Hz: give positive numbers, two samples or more")
    road_rng, lower_rng, upper_rng, lower_x_rng, upper_x_rng = rng.spawn(5)
    speed = SpeedProfile(*speed_m_per_s, duration_s)
    lead_in = round(_LEAD_IN_S * fs)
    n_samples = round(duration_s * fs)
    motion = _roll(gear, speed, road_class, footprint_m, road_rng, lead_in / fs, fs, lowest_step_rate_hz)
    steps = round(motion.fs / fs)
    record = slice(lead_in, lead_in + n_samples)

    lower_z, upper_z = decimate(motion.acceleration, steps).T
    lower_x = _fore_aft_noise(lower_z, fore_aft_ratio, fs, lower_x_rng)
    upper_x = _fore_aft_noise(upper_z, fore_aft_ratio, fs, upper_x_rng)
    columns = {}
    for name, sensor, along, across, noise_rng in (
        ("lower", lower_sensor, lower_z, lower_x, lower_rng),
        ("upper", upper_sensor, upper_z, upper_x, upper_rng),
    ):
        z_rng, x_rng = noise_rng.spawn(2)
        columns[f"{name}_z"] = measure(along, fs=fs, sensor=sensor, rng=z_rng, cross_axis_acceleration=across)
        columns[f"{name}_x"] = measure(across, fs=fs, sensor=sensor, rng=x_rng, cross_axis_acceleration=along)
    names = ["lower_z", "upper_z", *(["lower_x", "upper_x"] if fore_aft else [])]
    recording = recording_from_arrays([columns[name][record] for name in names], names, fs=fs)

    travel, travel_velocity = (
        (state[::steps, 1] - state[::steps, 0])[record] for state in (motion.displacement, motion.velocity)
    )
    truth = Recording(
        np.stack([lower_z[record], upper_z[record], travel, travel_velocity], axis=1),
        fs=fs,
        channels=(
            Channel("lower_z", "m/s^2"),
            Channel("upper_z", "m/s^2"),
            Channel("travel", "m"),
            Channel("travel_velocity", "m/s"),
        ),
    )
    return TaxiRun(gear, recording, truth, speed)


def taxi_test(
    gear: LandingGear,
    *,
    rng: np.random.Generator,
    mass_removed_kg: float = 220.0,
    departures: tuple[Departure, Departure] = (Departure(), Departure()),
    **settings: Any,
) -> TaxiTest:
    """Return a heavy run of the gear and a light one with less sprung mass, each over a road of its own.

    Each rests where its weight puts it on the law of its strut.

    Args:
        gear: the gear at its heavy mass, its law where it rests then.
        rng: source of everything random.
        mass_removed_kg: sprung mass taken away before the light run.
        departures: by how much the strut of each run is not the one given.
        settings: keyword arguments of `taxi_run`, for both runs.

    Raises:
        InputError: as much mass removed as there is, or more, or less than none; as `taxi_run`.

    >>> test = taxi_test(LandingGear(), duration_s=2.0, rng=np.random.default_rng(1))
    >>> test.mass_change_kg
    -220.0
    """
    if not 0.0 <= mass_removed_kg < gear.sprung_mass_kg:
        raise InputError(
            f"mass_removed_kg is {mass_removed_kg}, the sprung mass {gear.sprung_mass_kg} kg: "
            "give zero or more, and less than the sprung mass"
        )
    heavy, light = (
        _flown(gear, removed_kg, departure)
        for removed_kg, departure in zip((0.0, mass_removed_kg), departures, strict=True)
    )
    heavy_rng, light_rng = rng.spawn(2)
    return TaxiTest(taxi_run(heavy, rng=heavy_rng, **settings), taxi_run(light, rng=light_rng, **settings))


def _flown(gear: LandingGear, removed_kg: float, departure: Departure) -> LandingGear:
    """The gear as it is in one run, where it rests in it."""
    strut = departure.of(
        Interface(
            gear.suspension_stiffness_n_per_m,
            gear.suspension_damping_n_s_per_m,
            gear.ground_stiffness_n_per_m,
            gear.law,
        )
    )
    # springs that are stiffer carry more where they were: the body is lifted
    lifted_kg = removed_kg + departure.spring * gear.sprung_mass_kg
    (law,) = laws_at_rest([strut], np.ones((1, 1)), np.array([lifted_kg * GRAVITY_M_PER_S2]))
    return replace(
        gear,
        sprung_mass_kg=gear.sprung_mass_kg - removed_kg,
        suspension_stiffness_n_per_m=strut.stiffness,
        suspension_damping_n_s_per_m=strut.damping,
        law=law,
    )


def _roll(
    gear: LandingGear,
    speed: SpeedProfile,
    road_class: str,
    footprint_m: float,
    rng: np.random.Generator,
    lead_in_s: float,
    fs: float,
    lowest_step_rate_hz: float,
) -> Response:
    """Return the response from `lead_in_s` before the record to a little after it, at a multiple of fs."""
    length_m = float(speed.position_m(speed.duration_s + _TAIL_S) - speed.position_m(-lead_in_s))
    road = iso8608_road(road_class, length_m=max(length_m, 1.0), footprint_m=footprint_m, rng=rng)

    def force(time_s: FloatArray) -> FloatArray:
        time = time_s - lead_in_s
        place_m = speed.position_m(time) - speed.position_m(-lead_in_s)
        return tyre_force(gear, road, place_m, speed.speed_m_per_s(time))

    steps = max(1, int(np.ceil(lowest_step_rate_hz / fs)))
    return time_response(gear_structure(gear), force, fs=steps * fs, duration_s=lead_in_s + speed.duration_s + _TAIL_S)


def _fore_aft_noise(vertical: FloatArray, ratio: float, fs: float, rng: np.random.Generator) -> FloatArray:
    low, high = _FORE_AFT_BAND_HZ
    band = signal.butter(2, (low, min(high, 0.4 * fs)), "bandpass", fs=fs, output="sos")
    noise = signal.sosfilt(band, rng.standard_normal(vertical.size))
    return noise * ratio * np.std(vertical) / np.std(noise)
