"""Runs that the model cannot explain: nothing, or a wide interval that holds the truth, but never a confident error."""


import numpy as np

from opid.identify.study import Run, Study
from opid.mechanics.landing_gear import LandingGear, taxi_test
from opid.mechanics.response import time_response
from opid.mechanics.road import SpeedProfile, iso8608_road
from opid.mechanics.sensors import Sensor, decimate, measure
from opid.mechanics.structure import Joint, Structure
from opid.signals.recording import recording_from_arrays

FS, DURATION_S, LEAD_S = 256.0, 20.0, 6.0
SHORT = {"duration_s": DURATION_S, "fs": FS}
MASS_KG, CHANGE_KG = 1850.0, -220.0
GEAR = LandingGear()


def study_of(heavy, light, sides=("lower_z", "upper_z")):
    runs = (Run("heavy", heavy, 0.0), Run("light", light, CHANGE_KG))
    return Study("taxi", sprung=sides[1], unsprung=sides[0], runs=runs)


def taxi(seed, gear=GEAR, **settings):
    test = taxi_test(gear, rng=np.random.default_rng(seed), **SHORT, **settings)
    return study_of(test.heavy.recording, test.light.recording)


def readings(lower, upper, rng):
    """What two ordinary accelerometers make of accelerations at 8 FS, the lead-in left out."""
    first, n = round(LEAD_S * FS), round(DURATION_S * FS)
    columns = [
        measure(decimate(each, 8)[first : first + n], fs=FS, sensor=Sensor(), rng=own)
        for each, own in zip((lower, upper), rng.spawn(2), strict=True)
    ]
    return recording_from_arrays(columns, ["lower_z", "upper_z"], fs=FS)


def roads(rng, n, speed):
    length_m = float(speed.position_m(DURATION_S + 1.0) - speed.position_m(-LEAD_S))
    return [iso8608_road("B", length_m=length_m, footprint_m=0.3, rng=own) for own in rng.spawn(n)]


def tyre_forces(tracks, speed, time_s):
    time = time_s - LEAD_S
    place, velocity = speed.position_m(time) - speed.position_m(-LEAD_S), speed.speed_m_per_s(time)
    pushes = [
        GEAR.tyre_stiffness_n_per_m * road.elevation(place) + GEAR.tyre_damping_n_s_per_m * road.slope(place) * velocity
        for road in tracks
    ]
    return np.stack(pushes, axis=1)


# ---- an aircraft that rolls on two main gears ------------------------------------------------------

HALF_TRACK_M, ROLL_INERTIA_KG_M2 = 1.4, 3500.0


def rolling_run(mass_kg, inertia_kg_m2, rng, *, coherent):
    """One main gear of a body that heaves and rolls, either track over a road of its own or both over one."""
    struts = [
        Joint(
            name,
            np.array(direction),
            GEAR.suspension_stiffness_n_per_m,
            GEAR.suspension_damping_n_s_per_m,
            GEAR.law,
        )
        for name, direction in (
            ("left", [-1.0, 0.0, 1.0, HALF_TRACK_M]),
            ("right", [0.0, -1.0, 1.0, -HALF_TRACK_M]),
        )
    ]
    tyre, tyre_damping = GEAR.tyre_stiffness_n_per_m, GEAR.tyre_damping_n_s_per_m
    aircraft = Structure(
        mass=np.diag([GEAR.unsprung_mass_kg, GEAR.unsprung_mass_kg, mass_kg, inertia_kg_m2]),
        damping=np.diag([tyre_damping, tyre_damping, 0.0, 0.0]),
        stiffness=np.diag([tyre, tyre, 0.0, 0.0]),
        joints=tuple(struts),
        names=("left wheel", "right wheel", "heave", "roll"),
    )
    road_rng, noise_rng = rng.spawn(2)
    speed = SpeedProfile(18.0, 0.5, DURATION_S)
    left, right = roads(road_rng, 2, speed)
    tracks = (left, left if coherent else right)

    def force(time_s):
        return np.pad(tyre_forces(tracks, speed, time_s), ((0, 0), (0, 2)))

    motion = time_response(aircraft, force, fs=8 * FS, duration_s=LEAD_S + DURATION_S + 0.5).acceleration
    return readings(motion[:, 0], motion[:, 2] + HALF_TRACK_M * motion[:, 3], noise_rng)


def rolling(seed, *, coherent=False):
    """Half the mass rests on either gear, and half the mass change."""
    rngs = np.random.default_rng(seed).spawn(2)
    masses = (2 * MASS_KG, 2 * (MASS_KG + CHANGE_KG))
    inertias = (ROLL_INERTIA_KG_M2, 0.9 * ROLL_INERTIA_KG_M2)
    return study_of(
        *(rolling_run(*each, rng, coherent=coherent) for *each, rng in zip(masses, inertias, rngs, strict=True))
    )


# ---- a strut with memory --------------------------------------------------------------------------


def hysteretic_run(mass_kg, rng, amplitude_n=400.0, travel_m=0.5e-3):
    """A Bouc-Wen element beside the springs: F = a w, travel_m w' = z' - (0.5 |z'| w + 0.5 z' |w|), by Runge-Kutta."""
    road_rng, noise_rng = rng.spawn(2)
    speed = SpeedProfile(18.0, 0.5, DURATION_S)
    rate = 8 * FS
    n = round((LEAD_S + DURATION_S + 0.5) * rate)
    push = tyre_forces(roads(road_rng, 1, speed), speed, np.arange(2 * n) / (2 * rate))[:, 0].tolist()
    k1, c1, m1 = GEAR.tyre_stiffness_n_per_m, GEAR.tyre_damping_n_s_per_m, GEAR.unsprung_mass_kg
    k2, c2 = GEAR.suspension_stiffness_n_per_m, GEAR.suspension_damping_n_s_per_m

    def slope(state, force):
        x1, v1, x2, v2, w = state
        travel, velocity = x2 - x1, v2 - v1
        strut = k2 * travel + c2 * velocity + amplitude_n * w
        memory = (velocity - 0.5 * (abs(velocity) * w + velocity * abs(w))) / travel_m
        return v1, (strut - k1 * x1 - c1 * v1 + force) / m1, v2, -strut / mass_kg, memory

    def ahead(state, rates, step):
        return tuple(each + step * rate for each, rate in zip(state, rates, strict=True))

    state, step, acceleration = (0.0,) * 5, 1 / rate, np.empty((n, 2))
    for i in range(n):
        first = slope(state, push[2 * i])
        acceleration[i] = first[1], first[3]
        second = slope(ahead(state, first, step / 2), push[2 * i + 1])
        third = slope(ahead(state, second, step / 2), push[2 * i + 1])
        fourth = slope(ahead(state, third, step), push[min(2 * i + 2, 2 * n - 1)])
        mean = [(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(first, second, third, fourth, strict=True)]
        state = ahead(state, mean, step)
    return readings(acceleration[:, 0], acceleration[:, 1], noise_rng)


def hysteretic(seed, **settings):
    rngs = np.random.default_rng(seed).spawn(2)
    masses = (MASS_KG, MASS_KG + CHANGE_KG)
    return study_of(*(hysteretic_run(mass, rng, **settings) for mass, rng in zip(masses, rngs, strict=True)))
