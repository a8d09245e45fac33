"""Gears and runs that are not what the estimator takes them for, simulated without its predictor.

The gears with memory and those that something else pushes are integrated here, by a Runge-Kutta step of their own, over
the roads of the virtual taxi runs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from estimator import AnyStudy, gear_study
from numba import njit
from scipy import signal

from opid.mechanics.laws.law import FloatArray
from opid.mechanics.response import time_response
from opid.mechanics.structure import Joint, Structure
from opid.signals.recording import Recording, recording_from_arrays
from opid.suspensions.study import PointMass
from opid.virtual.taxi_tests.aircraft import default_aircraft
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.road import SpeedProfile, iso8608_road
from opid.virtual.taxi_tests.sensors import Sensor, decimate, measure
from opid.virtual.taxi_tests.taxiing import TaxiTest, taxi_run, taxi_test, tyre_forces

GEAR = LandingGear()
REMOVED_KG = 220.0
DURATION_S, LEAD_IN_S, TAIL_S = 40.0, 8.0, 0.25
FS, STEPS = 512.0, 16
# rms acceleration by a force that nobody measures, over that by the road
UNMEASURED_SHARE = 0.03
# two blades a turn at 1200 and 1180 rev/min, by run, and their share of the rms acceleration
ENGINE_HZ, ENGINE_SHARE = (20.0, 19.7), 0.1
# what bends with a third of the airframe's mass
BENDING_HZ, BENDING_DAMPING, BENDING_SHARE = 8.0, 0.02, 0.35
STIFFER = 1.02
# a force on the airframe over that of the road under the tyre: alone it would move the free mass by 10 % of its motion
FOLLOWING_SHARE = 0.037


@dataclass(frozen=True)
class World:
    """What is simulated, and why its answer is none or wide.

    Args:
        why: in words.
        study: of a seed, with the sprung mass that is true, kg; None if there is none.
    """

    why: str
    study: Callable[[int], tuple[AnyStudy, float | None]]


class Rolled(NamedTuple):
    """What two sensors recorded of a run, and what the strut did meanwhile.

    Args:
        recording: of the sensors below and above the strut.
        travel: (n,) of the strut at every step of the integration, m.
        velocity: (n,) likewise, m/s.
        force: (n,) of spring, damper and memory likewise, N.
    """

    recording: Recording
    travel: FloatArray
    velocity: FloatArray
    force: FloatArray


# Forces with memory: (state h, travel z, its rate z', parameters) -> (h', force)


@njit
def arctan_friction(h: float, z: float, v: float, p: Any) -> Any:
    """Friction without memory, A (2/pi) arctan(v/s): the estimator's own kind, to check this file by."""
    return 0.0, p[0] * 2.0 / np.pi * np.arctan(v / p[1])


@njit
def dahl(h: float, z: float, v: float, p: Any) -> Any:
    """Dahl (1968): dF/dz = sigma (1 - sgn(v) F/F_c)."""
    stiffness, slip = p[0], p[1]
    return stiffness * (v - np.abs(v) * h / slip), h


@njit
def bouc_wen(h: float, z: float, v: float, p: Any) -> Any:
    """Bouc (1967) and Wen (1976): F = k h, h' = v (1 - |h/h_y|^n (b + (1 - b) sgn(v h)))."""
    stiffness, yielding, power, share = p[0], p[1], p[2], p[3]
    bent = np.abs(h / yielding) ** power
    return v - bent * (share * v + (1.0 - share) * np.abs(v) * np.sign(h)), stiffness * h


@njit
def lugre(h: float, z: float, v: float, p: Any) -> Any:
    """Canudas de Wit et al. (1995): F = s0 h + s1 h', h' = v - s0 |v| h / g(v), g with the Stribeck effect."""
    stiffness, damping, slip, sticking, stribeck = p[0], p[1], p[2], p[3], p[4]
    g = slip + (sticking - slip) * np.exp(-((v / stribeck) ** 2))
    rate = v - stiffness * np.abs(v) * h / g
    return rate, stiffness * h + damping * rate


@njit
def bump_stop(h: float, z: float, v: float, p: Any) -> Any:
    """A stop that is met when the strut is compressed by more than the gap; it remembers nothing."""
    return 0.0, -p[0] * max(-z - p[1], 0.0)


# seals and bearings of a strut that carries 1.85 t: they slip at 400 N, as the nominal gear's friction does
FRICTION = (400.0, 0.02)
# stuck, they give by 0.5 mm
DAHL = (8e5, 400.0)
# a bushing that yields slowly: 3e5 N/m beside a strut of 3.9e5 N/m, 600 N at most
BOUC_WEN = (3e5, 2e-3, 2.0, 0.5)
# 0.3 mm until they slip, half as much again to break loose, Stribeck velocity 20 mm/s
LUGRE = (2e6, 1e3, 400.0, 600.0, 0.02)
# three times as stiff as the spring, met at half as much again as the rms travel
STOP = (1.2e6, 6e-3)


@njit
def _rates(x: Any, memory: Any, p: Any, gear: Any, under: float, aside: float) -> Any:
    m1, m2, k1, c1, k2, c2 = gear
    z, v = x[2] - x[0], x[3] - x[1]
    h_rate, force = memory(x[4], z, v, p)
    force += k2 * z + c2 * v
    rates = np.array([x[1], (force - k1 * x[0] - c1 * x[1] + under) / m1, x[3], (aside - force) / m2, h_rate])
    return rates, force


@njit
def _integrated(memory: Any, p: Any, gear: Any, under: FloatArray, aside: FloatArray, step_s: float) -> FloatArray:
    """Accelerations of both masses, travel, its rate and the strut's force at every step; forces at half steps."""
    n = (under.size + 1) // 2
    x, out = np.zeros(5), np.empty((n, 5))
    for k in range(n):
        one, force = _rates(x, memory, p, gear, under[2 * k], aside[2 * k])
        out[k, 0], out[k, 1], out[k, 2], out[k, 3], out[k, 4] = one[1], one[3], x[2] - x[0], x[3] - x[1], force
        if k == n - 1:
            break
        half, last = 2 * k + 1, 2 * k + 2
        two = _rates(x + 0.5 * step_s * one, memory, p, gear, under[half], aside[half])[0]
        three = _rates(x + 0.5 * step_s * two, memory, p, gear, under[half], aside[half])[0]
        four = _rates(x + step_s * three, memory, p, gear, under[last], aside[last])[0]
        x = x + step_s / 6.0 * (one + 2.0 * two + 2.0 * three + four)
    return out


def rolled(
    gear: LandingGear,
    memory: Callable,
    parameters: tuple[float, ...],
    *,
    rng: np.random.Generator,
    aside_n: Callable[[np.random.Generator, int, float], FloatArray] | None = None,
    following: float = 0.0,
    sensor: Sensor = Sensor(),  # noqa: B008
    steps: int = STEPS,
) -> Rolled:
    """Return one braked run of a gear whose strut has a force with memory in place of its law.

    Args:
        gear: the gear; its law does not count.
        memory: one of the functions above.
        parameters: of it.
        rng: source of road, noise and push.
        aside_n: (rng, number of half steps, their rate) -> force on the sprung mass, N; none where left out.
        following: force on the sprung mass over that of the road under the tyre.
        sensor: both of them.
        steps: of the integration to a sample.
    """
    road_rng, push_rng, *noise_rngs = rng.spawn(4)
    speed = SpeedProfile(18.0, 0.5, DURATION_S)
    begin_m = float(speed.position_m(-LEAD_IN_S))
    road = iso8608_road("B", length_m=float(speed.position_m(DURATION_S + TAIL_S)) - begin_m, rng=road_rng)
    step_rate_hz = FS * steps
    time = np.arange(2 * round((LEAD_IN_S + DURATION_S + TAIL_S) * step_rate_hz) + 1) / (2.0 * step_rate_hz) - LEAD_IN_S
    under = tyre_forces(gear.airframe, [road], speed.position_m(time) - begin_m, speed.speed_m_per_s(time))[:, 0]
    aside = following * under
    if aside_n is not None:
        aside = aside + aside_n(push_rng, time.size, 2.0 * step_rate_hz)
    numbers = (
        gear.unsprung_mass_kg,
        gear.sprung_mass_kg,
        gear.tyre_stiffness_n_per_m,
        gear.tyre_damping_n_s_per_m,
        gear.suspension_stiffness_n_per_m,
        gear.suspension_damping_n_s_per_m,
    )
    motion = _integrated(memory, parameters, numbers, under, aside, 1.0 / step_rate_hz)
    record = slice(round(LEAD_IN_S * FS), round((LEAD_IN_S + DURATION_S) * FS))
    columns = [
        measure(column, fs=FS, sensor=sensor, rng=noise)[record]
        for column, noise in zip(decimate(motion[:, :2], steps).T, noise_rngs, strict=True)
    ]
    recording = recording_from_arrays(columns, ["lower_z", "upper_z"], fs=FS)
    return Rolled(recording, *motion[record.start * steps : record.stop * steps, 2:].T)


def two_rolled(
    memory: Callable,
    parameters: tuple[float, ...],
    seed: int,
    *,
    lighter: tuple[float, ...] | None = None,
    **settings: Any,
) -> tuple[Rolled, Rolled]:
    """Return the run of the nominal gear and that of the lighter one.

    Args:
        memory: as of `rolled`.
        parameters: of it.
        seed: of both roads.
        lighter: parameters in the second run; the same where left out.
        settings: further ones of `rolled`.
    """
    light = replace(GEAR, sprung_mass_kg=GEAR.sprung_mass_kg - REMOVED_KG)
    first, second = np.random.default_rng(seed).spawn(2)
    heavy = rolled(GEAR, memory, parameters, rng=first, **settings)
    return heavy, rolled(light, memory, parameters if lighter is None else lighter, rng=second, **settings)


def study_of_rolled(title: str, runs: tuple[Rolled, Rolled]) -> AnyStudy:
    """Return the study of the two runs of `two_rolled`."""
    recordings = (each.recording for each in runs)
    return gear_study(title, zip(("heavy", "light"), recordings, (0.0, -REMOVED_KG), strict=True))


def _two_runs(
    title: str, memory: Callable, parameters: tuple[float, ...], seed: int, **settings: Any
) -> tuple[AnyStudy, float]:
    return study_of_rolled(title, two_rolled(memory, parameters, seed, **settings)), GEAR.sprung_mass_kg


def with_memory(title: str, memory: Callable, parameters: tuple[float, ...]) -> Callable[[int], Any]:
    return lambda seed: _two_runs(title, memory, parameters, seed)


def pushed(seed: int, share: float = UNMEASURED_SHARE) -> tuple[AnyStudy, float]:
    """A force on the airframe from 0.5 to 40 Hz: it alone would move the free mass by a share of what the road does."""
    plain, _ = _two_runs("not pushed", arctan_friction, FRICTION, seed)
    rms = float(np.std(plain.runs[0].recording.channel("upper_z")))

    def aside_n(rng: np.random.Generator, n: int, rate_hz: float) -> FloatArray:
        # drawn at 512 Hz, where such a band-pass is sound, and interpolated
        slow = round(rate_hz / FS)
        sections = signal.butter(2, (0.5, 40.0), "bandpass", fs=FS, output="sos")
        drawn = signal.sosfiltfilt(sections, rng.standard_normal(n // slow + 2))
        fine = np.interp(np.arange(n) / slow, np.arange(drawn.size), drawn)
        return GEAR.sprung_mass_kg * share * rms * fine / np.std(fine)

    return _two_runs("pushed", arctan_friction, FRICTION, seed, aside_n=aside_n)


def followed(seed: int, share: float = FOLLOWING_SHARE) -> tuple[AnyStudy, float]:
    """A force on the airframe in proportion to that of the road under the tyre: it goes with the drive."""
    return _two_runs("followed", arctan_friction, FRICTION, seed, following=share)


def with_engine(seed: int) -> tuple[AnyStudy, float]:
    """A propeller shakes the airframe at its blade rate, which another throttle sets in the second run."""
    plain, _ = _two_runs("without engine", arctan_friction, FRICTION, seed)
    rms = float(np.std(plain.runs[0].recording.channel("upper_z")))
    rates = iter(ENGINE_HZ)

    def aside_n(rng: np.random.Generator, n: int, rate_hz: float) -> FloatArray:
        phase = 2 * np.pi * (next(rates) * np.arange(n) / rate_hz + rng.random())
        return GEAR.sprung_mass_kg * ENGINE_SHARE * rms * np.sqrt(2) * np.sin(phase)

    return _two_runs("engine", arctan_friction, FRICTION, seed, aside_n=aside_n)


def bending(seed: int) -> tuple[AnyStudy, float]:
    """A body of two masses: the one that the sensor sits on, and what bends on it with the rest of the mass."""
    rngs = np.random.default_rng(seed).spawn(2)
    runs = []
    for name, change_kg, rng in zip(("heavy", "light"), (0.0, -REMOVED_KG), rngs, strict=True):
        runs.append((name, _bending_run(GEAR.sprung_mass_kg, change_kg, rng), change_kg))
    return gear_study("bending", runs), GEAR.sprung_mass_kg


def _bending_run(mass_kg: float, change_kg: float, rng: np.random.Generator) -> Recording:
    """One run; what is removed was taken from the part that does not bend."""
    road_rng, *noise_rngs = rng.spawn(3)
    speed = SpeedProfile(18.0, 0.5, DURATION_S)
    begin_m = float(speed.position_m(-LEAD_IN_S))
    road = iso8608_road("B", length_m=float(speed.position_m(DURATION_S + TAIL_S)) - begin_m, rng=road_rng)
    bends_kg = BENDING_SHARE * mass_kg
    omega = 2 * np.pi * BENDING_HZ
    between = Joint("airframe", (0.0, -1.0, 1.0), bends_kg * omega**2, 2 * BENDING_DAMPING * omega * bends_kg)
    strut = Joint(
        "strut",
        (-1.0, 1.0, 0.0),
        GEAR.suspension_stiffness_n_per_m,
        GEAR.suspension_damping_n_s_per_m,
        GEAR.law,
    )
    aircraft = Structure(
        mass=np.diag([GEAR.unsprung_mass_kg, mass_kg - bends_kg + change_kg, bends_kg]),
        damping=np.diag([GEAR.tyre_damping_n_s_per_m, 0.0, 0.0]),
        stiffness=np.diag([GEAR.tyre_stiffness_n_per_m, 0.0, 0.0]),
        joints=(strut, between),
        names=("wheel", "airframe", "what bends"),
    )

    def force(time_s: FloatArray) -> FloatArray:
        time = time_s - LEAD_IN_S
        under = tyre_forces(GEAR.airframe, [road], speed.position_m(time) - begin_m, speed.speed_m_per_s(time))
        return np.pad(under, ((0, 0), (0, 2)))

    duration_s = LEAD_IN_S + DURATION_S + TAIL_S
    motion = time_response(aircraft, force, fs=STEPS * FS, duration_s=duration_s).acceleration[:, :2]
    record = slice(round(LEAD_IN_S * FS), round((LEAD_IN_S + DURATION_S) * FS))
    columns = [
        measure(column, fs=FS, sensor=Sensor(), rng=noise)[record]
        for column, noise in zip(decimate(motion, STEPS).T, noise_rngs, strict=True)
    ]
    return recording_from_arrays(columns, ["lower_z", "upper_z"], fs=FS)


def _taxi(seed: int) -> TaxiTest:
    return taxi_test(GEAR, rng=np.random.default_rng(seed), mass_removed_kg=REMOVED_KG)


def nominal(seed: int) -> tuple[AnyStudy, float]:
    """Nothing is wrong: what an answer costs, to compare with a refusal."""
    test = _taxi(seed)
    runs = [("heavy", test.heavy.recording, 0.0), ("light", test.light.recording, test.mass_change_kg)]
    return gear_study("nominal", runs), GEAR.sprung_mass_kg


def filtered(seed: int, corner_hz: float = 100.0) -> tuple[AnyStudy, float]:
    """Both logs were low-pass filtered: above, there is no noise to read. The filter ran before the logs began."""
    study, truth_kg = nominal(seed)
    low_pass = signal.butter(4, corner_hz, fs=FS, output="sos")
    runs = []
    for run in study.runs:
        begun = round(0.5 * FS)
        samples = [signal.sosfilt(low_pass, run.recording.channel(name))[begun:] for name in ("lower_z", "upper_z")]
        runs.append(replace(run, recording=recording_from_arrays(samples, ["lower_z", "upper_z"], fs=FS)))
    return replace(study, title="filtered", runs=tuple(runs)), truth_kg


def stiffer(seed: int) -> tuple[AnyStudy, float]:
    heavy_rng, light_rng = np.random.default_rng(seed).spawn(2)
    light = replace(
        GEAR,
        sprung_mass_kg=GEAR.sprung_mass_kg - REMOVED_KG,
        suspension_stiffness_n_per_m=STIFFER * GEAR.suspension_stiffness_n_per_m,
    )
    recordings = (taxi_run(GEAR, rng=heavy_rng).recording, taxi_run(light, rng=light_rng).recording)
    return gear_study("stiffer", zip(("heavy", "light"), recordings, (0.0, -REMOVED_KG), strict=True)), 1850.0


def swapped(seed: int) -> tuple[AnyStudy, float]:
    test = _taxi(seed)
    runs = [("heavy", test.heavy.recording, 0.0), ("light", test.light.recording, test.mass_change_kg)]
    return gear_study("swapped", runs, sprung="lower_z", unsprung="upper_z"), GEAR.sprung_mass_kg


def exchanged(seed: int) -> tuple[AnyStudy, float]:
    test = _taxi(seed)
    runs = [("heavy", test.light.recording, 0.0), ("light", test.heavy.recording, test.mass_change_kg)]
    return gear_study("exchanged", runs), GEAR.sprung_mass_kg


def noise(seed: int) -> tuple[AnyStudy, None]:
    rng = np.random.default_rng(seed)
    samples = rng.standard_normal((2, 2, round(DURATION_S * FS)))
    recordings = [recording_from_arrays(each, ["lower_z", "upper_z"], fs=FS) for each in samples]
    return gear_study("noise", zip(("heavy", "light"), recordings, (0.0, -REMOVED_KG), strict=True)), None


def rolling(seed: int) -> tuple[AnyStudy, float]:
    """The left main gear under its static part of the mass, and of a load over the centre of gravity."""
    aircraft = default_aircraft()
    load = PointMass(500.0, aircraft.x_cg_m, aircraft.y_cg_m)
    rng = np.random.default_rng(seed)
    test = taxi_test(aircraft, rng=rng, loadings=[[load]], coherent_tracks=False)
    # of what is over the centre of gravity, the nose 5 m before the main gears carries x_cg / 5
    part = 0.5 * (1.0 - aircraft.x_cg_m / 5.0)
    runs = zip(("light", "heavy"), (run.recording for run in test.runs), (0.0, part * load.mass_kg), strict=True)
    return gear_study("left", runs, sprung="left_upper_z", unsprung="left_lower_z"), part * aircraft.mass_kg


WORLDS = {
    "nominal": World("nothing is wrong, for comparison", nominal),
    "own integrator": World(
        "nothing is wrong, integrated in worlds.py", with_memory("arctan", arctan_friction, FRICTION)
    ),
    "Dahl": World("friction that springs back", with_memory("Dahl", dahl, DAHL)),
    "Bouc-Wen": World("a bushing with hysteresis", with_memory("Bouc-Wen", bouc_wen, BOUC_WEN)),
    "LuGre": World("friction that sticks, breaks loose and slips", with_memory("LuGre", lugre, LUGRE)),
    "filtered": World("nothing is wrong, the logs low-pass filtered at 100 Hz", filtered),
    "filtered 60 Hz": World("the same at 60 Hz, near the band's end at 40 Hz", partial(filtered, corner_hz=60.0)),
    "stiffer": World("the second flight's strut is 2 % stiffer", stiffer),
    "pushed 1 %": World("an unmeasured force on the airframe, 1 % of its motion", partial(pushed, share=0.01)),
    "pushed": World("an unmeasured force on the airframe, 3 % of its motion", pushed),
    "pushed 10 %": World("an unmeasured force on the airframe, 10 % of its motion", partial(pushed, share=0.1)),
    "followed 10 %": World("a force on the airframe that follows the road, 10 % of its motion", followed),
    "engine": World("a propeller shakes the airframe, 10 % of its motion", with_engine),
    "bending": World("35 % of the airframe's mass bends at 8 Hz", bending),
    "rolling": World("one gear of a rolling aircraft, taken alone", rolling),
    "swapped": World("the two channels are swapped", swapped),
    "exchanged": World("the two runs are exchanged", exchanged),
    "noise": World("two channels of independent noise", noise),
}
