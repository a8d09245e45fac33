"""Aircraft to simulate: one by default, any number of random ones, and the bending of a fuselage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from opid.errors import InputError
from opid.mechanics.laws.law import Law, law
from opid.virtual.taxi_tests.airframe import Airframe, BendingMode, Gear

# first bending mode of a free uniform beam: wave number times length, and the ratio in its shape
_BEAM_WAVE, _BEAM_RATIO = 4.730040744862704, 0.9825022145762380


def default_aircraft() -> Airframe:
    """Return an aircraft of 5.4 t on the gears "nose", "left" and "right", with friction in each strut.

    The origin is in the middle between the main gears, and the nose gear is 5 m in front of it. The nose carries 12 %
    of the weight, and each main gear about as much as the paper's gear.

    >>> aircraft = default_aircraft()
    >>> aircraft.mass_kg, [gear.name for gear in aircraft.gears]
    (5400.0, ['nose', 'left', 'right'])
    """
    nose = Gear("nose", 5.0, 0.0, 45.0, 1.5e5, 2.4e3, 2.4e5, 0.6e3, _make_friction(160.0, 0.02))
    left = Gear("left", 0.0, 1.6, 120.0, 4.7e5, 7.2e3, 7.4e5, 1.8e3, _make_friction(480.0, 0.02))
    return Airframe(
        mass_kg=5400.0,
        ixx_kg_m2=1.6e4,
        iyy_kg_m2=2.7e4,
        x_cg_m=0.6,
        y_cg_m=0.0,
        gears=(nose, left, replace(left, name="right", y_m=-1.6)),
    )


def random_aircraft(rng: np.random.Generator) -> Airframe:
    """Return a random aircraft of 4 to 8 t on the gears "nose", "left" and "right".

    The wheel base is 4 to 7 m, the track 2.4 to 4 m, the nose carries 8 to 15 % of the weight, and the origin lies
    between the main gears. Every strut has friction, arctan in its velocity; in one aircraft out of three the struts of
    the main gears harden, too. Stiffness, damping and law of left and right each differ by up to 5 % from a common
    value.

    Args:
        rng: source of everything random.

    >>> random_aircraft(np.random.default_rng(2)).gears[1].law.name
    'arctan_velocity'
    """
    mass_kg = rng.uniform(4e3, 8e3)
    wheel_base_m, track_m, nose_fraction = rng.uniform(4.0, 7.0), rng.uniform(2.4, 4.0), rng.uniform(0.08, 0.15)
    hardening = rng.uniform(0.3, 1.0) if rng.random() < 1.0 / 3.0 else 0.0
    nose = _draw_gear("nose", wheel_base_m, nose_fraction * mass_kg, 0.0, rng)
    main = _draw_gear("main", 0.0, 0.5 * (1.0 - nose_fraction) * mass_kg, hardening, rng)
    left, right = (
        replace(
            main,
            name=name,
            y_m=0.5 * side * track_m,
            suspension_stiffness_n_per_m=main.suspension_stiffness_n_per_m * rng.uniform(0.95, 1.05),
            suspension_damping_n_s_per_m=main.suspension_damping_n_s_per_m * rng.uniform(0.95, 1.05),
            law=main.law.scaled(rng.uniform(0.95, 1.05)),
        )
        for name, side in (("left", 1.0), ("right", -1.0))
    )
    return Airframe(
        mass_kg=mass_kg,
        ixx_kg_m2=mass_kg * (rng.uniform(0.5, 0.75) * track_m) ** 2,
        iyy_kg_m2=mass_kg * (rng.uniform(0.36, 0.5) * wheel_base_m) ** 2,
        x_cg_m=nose_fraction * wheel_base_m,
        y_cg_m=0.0,
        gears=(nose, left, right),
    )


def with_bending(
    airframe: Airframe,
    *,
    frequency_hz: float = 8.0,
    damping_ratio: float = 0.02,
    length_m: float | None = None,
    beam_mass_fraction: float = 0.6,
) -> Airframe:
    """Return the airframe with the first bending mode of a free uniform beam whose middle is the centre of gravity.

    The shape is 1 at both ends and -0.61 in the middle; the modal mass is a quarter of that of the beam.

    Args:
        airframe: the airframe; its bending mode is replaced if it has one.
        frequency_hz: natural frequency of the mode.
        damping_ratio: damping ratio of the mode.
        length_m: length of the beam; where left out, 2.5 times the distance from the centre of gravity to the farthest
            gear.
        beam_mass_fraction: mass of the beam over that of the airframe.

    Raises:
        InputError: a value that is not positive, a beam that does not reach every gear.

    >>> with_bending(default_aircraft()).bending.deflection([0.6, 6.1]).round(3)
    array([-0.608,  1.   ])
    """
    reach_m = max(abs(gear.x_m - airframe.x_cg_m) for gear in airframe.gears)
    length = 2.5 * max(reach_m, 1.0) if length_m is None else length_m
    if not (0.0 < length < np.inf and 0.0 < beam_mass_fraction < np.inf):
        raise InputError(
            f"the beam is {length} m long and has {beam_mass_fraction} times the mass of the airframe: give positive "
            "numbers"
        )
    position = np.linspace(0.0, 1.0, 101)
    arc = _BEAM_WAVE * position
    shape = np.cosh(arc) + np.cos(arc) - _BEAM_RATIO * (np.sinh(arc) + np.sin(arc))
    bending = BendingMode(
        frequency_hz=frequency_hz,
        damping_ratio=damping_ratio,
        modal_mass_kg=0.25 * beam_mass_fraction * airframe.mass_kg,
        stations_m=tuple((airframe.x_cg_m + (position - 0.5) * length).tolist()),
        shape=tuple((0.5 * shape).tolist()),
    )
    return replace(airframe, bending=bending)


def _draw_gear(name: str, x_m: float, load_kg: float, hardening: float, rng: np.random.Generator) -> Gear:
    """Draw a gear under `load_kg` of the airframe; hardening is cubic over linear force at 10 mm of travel."""
    omega = 2.0 * np.pi * rng.uniform(2.0, 2.6)
    stiffness = load_kg * omega**2
    damping = 2.0 * rng.uniform(0.07, 0.2) * load_kg * omega
    strut = _make_friction(load_kg * rng.uniform(0.1, 0.35), rng.uniform(0.008, 0.022))
    if hardening:
        strut = strut + law("cubic_stiffness", stiffness_n_per_m3=hardening * stiffness / 0.01**2)
    return Gear(
        name,
        x_m,
        y_m=0.0,
        unsprung_mass_kg=load_kg * rng.uniform(0.045, 0.075),
        suspension_stiffness_n_per_m=stiffness,
        suspension_damping_n_s_per_m=damping,
        tyre_stiffness_n_per_m=stiffness * rng.uniform(1.3, 2.0),
        tyre_damping_n_s_per_m=damping * rng.uniform(0.15, 0.35),
        law=strut,
    )


def _make_friction(amplitude_n: float, scale_m_per_s: float) -> Law:
    return law("arctan_velocity", amplitude_n=amplitude_n, scale_m_per_s=scale_m_per_s)
