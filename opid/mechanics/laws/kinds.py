"""The kinds of restoring-force law, one function for each.

A kind is a force for unit amplitude together with its derivatives. The comment above each entry states its meaning in a
suspension. Kinds with memory are in `memory_kinds`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from opid.mechanics.laws.kind import TINY, ForceAndDerivatives, Kind, Parameter, Values
from opid.mechanics.laws.memory_kinds import MEMORY_KINDS

__all__ = ["BUILT_IN", "KNOWN", "LAWS", "ForceAndDerivatives", "Kind", "Parameter"]

TWO_OVER_PI = 2.0 / math.pi
# fraction of the gas length by which a strut can be compressed; beyond it the force continues along its tangent
BOTTOM = 0.95
# width over which the stiffness of a stop grows, over its gap; beyond it the force is that of a sharp corner
ROUNDING = 0.1


def _arctan_velocity(z: Any, v: Any, s: Any, _: Any) -> ForceAndDerivatives:
    by_ratio = TWO_OVER_PI / (s**2 + v**2)
    return TWO_OVER_PI * np.arctan(v / s), 0.0, by_ratio * s, -by_ratio * v, 0.0


def _arctan_displacement(z: Any, v: Any, s: Any, _: Any) -> ForceAndDerivatives:
    by_ratio = TWO_OVER_PI / (s**2 + z**2)
    return TWO_OVER_PI * np.arctan(z / s), by_ratio * s, 0.0, -by_ratio * z, 0.0


def _arctan_mixed(z: Any, v: Any, s: Any, c: Any) -> ForceAndDerivatives:
    ahead = z + c * v
    by_ratio = TWO_OVER_PI / (s**2 + ahead**2)
    by_z = by_ratio * s
    return TWO_OVER_PI * np.arctan(ahead / s), by_z, c * by_z, -by_ratio * ahead, by_z * v


def _limits_of_arctan_mixed(values: Values, rest_m: float) -> tuple[tuple[str, Values], ...]:
    """Return the arctangents of the velocity alone and of the travel alone."""
    amplitude, scale_m, lag_s = values
    if lag_s == 0.0:
        return ()
    of_velocity = math.copysign(amplitude, amplitude * lag_s), scale_m / abs(lag_s)
    return ("arctan_velocity", of_velocity), ("arctan_displacement", (amplitude, scale_m))


def _coulomb_friction(z: Any, v: Any, s: Any, _: Any) -> ForceAndDerivatives:
    shape = np.tanh(v / s)
    by_v = (1.0 - shape**2) / s
    return shape, 0.0, by_v, -by_v * v / s, 0.0


def _loaded_friction(z: Any, v: Any, s: Any, d: Any) -> ForceAndDerivatives:
    load = np.maximum(1.0 - z / d, 0.0)
    is_loaded = np.sign(load)
    by_ratio, turned = TWO_OVER_PI / (s**2 + v**2), TWO_OVER_PI * np.arctan(v / s)
    by_z = -is_loaded * turned / d
    return load * turned, by_z, load * by_ratio * s, -load * by_ratio * v, -by_z * z / d


def _quadratic_damping(z: Any, v: Any, _a: Any, _b: Any) -> ForceAndDerivatives:
    speed = np.abs(v)
    return v * speed, 0.0, 2.0 * speed, 0.0, 0.0


def _orifice_damping(z: Any, v: Any, r: Any, _: Any) -> ForceAndDerivatives:
    speed = np.abs(v)
    rebound = 0.5 * (1.0 + np.sign(v))
    factor, square = 1.0 + (r - 1.0) * rebound, v * speed
    return factor * square, 0.0, 2.0 * factor * speed, rebound * square, 0.0


def _cubic_damping(z: Any, v: Any, _a: Any, _b: Any) -> ForceAndDerivatives:
    square = v**2
    return v * square, 0.0, 3.0 * square, 0.0, 0.0


def _quartic_damping(z: Any, v: Any, _a: Any, _b: Any) -> ForceAndDerivatives:
    third = np.abs(v) * v**2
    return v * third, 0.0, 4.0 * third, 0.0, 0.0


def _quintic_damping(z: Any, v: Any, _a: Any, _b: Any) -> ForceAndDerivatives:
    square = v**2
    fourth = square**2
    return v * fourth, 0.0, 5.0 * fourth, 0.0, 0.0


def _signed_power_damping(z: Any, v: Any, n: Any, _: Any) -> ForceAndDerivatives:
    speed = np.maximum(np.abs(v), TINY)
    power = speed ** (n - 1.0)
    return v * power, 0.0, n * power, v * power * np.log(speed), 0.0


def _asymmetric_damping(z: Any, v: Any, _a: Any, _b: Any) -> ForceAndDerivatives:
    return np.abs(v), 0.0, np.sign(v), 0.0, 0.0


def _blow_off_damping(z: Any, v: Any, s: Any, _: Any) -> ForceAndDerivatives:
    beyond = np.maximum(np.abs(v) - s, 0.0)
    open_side = np.sign(v) * np.sign(beyond)
    return np.sign(v) * beyond, 0.0, np.sign(beyond), -open_side, 0.0


def _quadratic_stiffness(z: Any, v: Any, _a: Any, _b: Any) -> ForceAndDerivatives:
    travel = np.abs(z)
    return z * travel, 2.0 * travel, 0.0, 0.0, 0.0


def _cubic_stiffness(z: Any, v: Any, _a: Any, _b: Any) -> ForceAndDerivatives:
    square = z**2
    return z * square, 3.0 * square, 0.0, 0.0, 0.0


def _quartic_stiffness(z: Any, v: Any, _a: Any, _b: Any) -> ForceAndDerivatives:
    third = np.abs(z) * z**2
    return z * third, 4.0 * third, 0.0, 0.0, 0.0


def _even_quadratic_stiffness(z: Any, v: Any, _a: Any, _b: Any) -> ForceAndDerivatives:
    return z**2, 2.0 * z, 0.0, 0.0, 0.0


def _quintic_stiffness(z: Any, v: Any, _a: Any, _b: Any) -> ForceAndDerivatives:
    square = z**2
    fourth = square**2
    return z * fourth, 5.0 * fourth, 0.0, 0.0, 0.0


def _signed_power_stiffness(z: Any, v: Any, n: Any, _: Any) -> ForceAndDerivatives:
    travel = np.maximum(np.abs(z), TINY)
    power = travel ** (n - 1.0)
    return z * power, n * power, 0.0, z * power * np.log(travel), 0.0


def _held_stiffness(z: Any, v: Any, s: Any, n: Any) -> ForceAndDerivatives:
    travel = np.abs(z)
    within = np.sign(np.maximum(s - travel, 0.0))
    held = np.maximum(np.minimum(travel, s), TINY)
    secant, more = held ** (n - 1.0), n - 1.0
    by_s = (1.0 - within) * more * z * secant / s
    return z * secant, secant * (1.0 + more * within), 0.0, by_s, z * secant * np.log(held)


def _held_even_stiffness(z: Any, v: Any, s: Any, _: Any) -> ForceAndDerivatives:
    travel = np.abs(z)
    within = np.sign(np.maximum(s - travel, 0.0))
    held = np.minimum(travel, s)
    return travel * held, np.sign(z) * held * (1.0 + within), 0.0, (1.0 - within) * travel, 0.0


def _held_damping(z: Any, v: Any, s: Any, n: Any) -> ForceAndDerivatives:
    speed = np.abs(v)
    within = np.sign(np.maximum(s - speed, 0.0))
    held = np.maximum(np.minimum(speed, s), TINY)
    secant, more = held ** (n - 1.0), n - 1.0
    by_s = (1.0 - within) * more * v * secant / s
    return v * secant, 0.0, secant * (1.0 + more * within), by_s, v * secant * np.log(held)


def _late_cubic_stiffness(z: Any, v: Any, s: Any, _: Any) -> ForceAndDerivatives:
    beyond, side = np.maximum(np.abs(z) - s, 0.0), np.sign(z)
    square = beyond**2
    return side * beyond * square, 3.0 * square, 0.0, -3.0 * side * square, 0.0


def _asymmetric_stiffness(z: Any, v: Any, _a: Any, _b: Any) -> ForceAndDerivatives:
    return np.abs(z), np.sign(z), 0.0, 0.0, 0.0


def _dead_zone_stiffness(z: Any, v: Any, s: Any, _: Any) -> ForceAndDerivatives:
    beyond = np.maximum(np.abs(z) - s, 0.0)
    touching_side = np.sign(z) * np.sign(beyond)
    return np.sign(z) * beyond, np.sign(beyond), 0.0, -touching_side, 0.0


def _limits_of_dead_zone(values: Values, rest_m: float) -> tuple[tuple[str, Values], ...]:
    """Return stops at each corner, for motions that never reach the other corner."""
    stiffness, gap_m = values
    # travel from rest at which it becomes stiffer, with the direction as sign
    corner = math.copysign(gap_m, stiffness)
    stops = (("rebound_stop", corner - rest_m), ("bump_stop", corner + rest_m))
    return tuple((name, (abs(stiffness), gap)) for name, gap in stops if gap > 0.0)


def _bump_stop(z: Any, v: Any, g: Any, _: Any) -> ForceAndDerivatives:
    width, beyond = ROUNDING * g, np.maximum((0.5 * ROUNDING - 1.0) * g - z, 0.0)
    bent = np.minimum(beyond, width)
    slope = bent / width
    by_gap = slope * (1.0 - 0.5 * ROUNDING * (1.0 - slope))
    return bent - beyond - 0.5 * bent * slope, slope, 0.0, by_gap, 0.0


def _rebound_stop(z: Any, v: Any, g: Any, _: Any) -> ForceAndDerivatives:
    width, beyond = ROUNDING * g, np.maximum((0.5 * ROUNDING - 1.0) * g + z, 0.0)
    bent = np.minimum(beyond, width)
    slope = bent / width
    by_gap = slope * (1.0 - 0.5 * ROUNDING * (1.0 - slope))
    return beyond - bent + 0.5 * bent * slope, slope, 0.0, -by_gap, 0.0


def _gas_column(z: Any, v: Any, h: Any, n: Any) -> ForceAndDerivatives:
    extension = z / h
    within = np.maximum(extension, -BOTTOM)
    beyond, volume = extension - within, 1.0 + within
    pressure, logarithm = volume**-n, np.log(volume)
    slope = pressure / volume
    by_extension = n * slope
    by_n = logarithm * pressure + beyond * slope * (1.0 - n * logarithm)
    return 1.0 - pressure + by_extension * beyond, by_extension / h, 0.0, -by_extension * extension / h, by_n


# parameters that several kinds of friction have in common
FORCE_N = Parameter("amplitude_n", "N", "amplitude", 400.0)
TURNING_M_PER_S = Parameter("scale_m_per_s", "m/s", "scale", 0.02)

BUILT_IN = (
    # dry friction that reverses within the velocity s
    Kind(
        "arctan_velocity",
        r"A \tfrac{2}{\pi} \arctan(\dot z / s)",
        (FORCE_N, TURNING_M_PER_S),
        _arctan_velocity,
        is_friction=True,
    ),
    # a spring that softens beyond the travel s
    Kind(
        "arctan_displacement",
        r"A \tfrac{2}{\pi} \arctan(z / s)",
        (FORCE_N, Parameter("scale_m", "m", "scale", 0.002)),
        _arctan_displacement,
    ),
    # Iwaniec & Uhl 2007, eq. (3), f/M2 = a z + arctan(d b (z + c v)): A = (pi/2) M2 (1 m/s^2), s = 1/(d b),
    # c = c; the term a z is linear, so it belongs to the stiffness of the joint (K2 grows by M2 a)
    Kind(
        "arctan_mixed",
        r"A \tfrac{2}{\pi} \arctan((z + c \dot z) / s)",
        (
            FORCE_N,
            # of z + c z', which is larger than z
            Parameter("scale_m", "m", "scale", 0.002, over_rms=(0.01, 10.0)),
            Parameter("lag_s", "s", "lag", 0.05),
        ),
        _arctan_mixed,
        limits=_limits_of_arctan_mixed,
    ),
    # dry friction that is full soon beyond the velocity s
    Kind(
        "coulomb_friction",
        r"A \tanh(\dot z / s)",
        (FORCE_N, TURNING_M_PER_S),
        _coulomb_friction,
        is_friction=True,
    ),
    # friction of seals and bearings that the spring force presses together: A at rest, elsewhere proportional to the
    # spring force, and zero when the spring has extended by d. For a straight spring d is the static deflection F0/K,
    # for a column of gas near its rest h/n. Suspensions of 1 to 4 Hz have deflections of 250 to 15 mm
    Kind(
        "loaded_friction",
        r"A (1 - z / d)_+ \tfrac{2}{\pi} \arctan(\dot z / s)",
        (
            FORCE_N,
            TURNING_M_PER_S,
            Parameter("deflection_m", "m", "exponent", 0.06, within=(0.015, 0.5), known=(0.06, 0.04)),
        ),
        _loaded_friction,
        searched=False,
        is_about_rest=True,
        is_friction=True,
        is_pressed=True,
    ),
    # oil pressed through an orifice
    Kind(
        "quadratic_damping",
        r"c\, \dot z |\dot z|",
        (Parameter("damping_n_s2_per_m2", "N s^2/m^2", "amplitude", 4e4),),
        _quadratic_damping,
    ),
    # oil pressed through another orifice in rebound than in compression, as in oleo struts: c while the strut shortens,
    # r c while it extends
    Kind(
        "orifice_damping",
        r"c\, \dot z |\dot z| (1 + (r - 1) [\dot z > 0])",
        (
            Parameter("damping_n_s2_per_m2", "N s^2/m^2", "amplitude", 4e4),
            Parameter("rebound_ratio", "1", "exponent", 2.0, within=(0.05, 20.0)),
        ),
        _orifice_damping,
    ),
    # the next odd term of any smooth damper
    Kind(
        "cubic_damping",
        r"c\, \dot z^3",
        (Parameter("damping_n_s3_per_m3", "N s^3/m^3", "amplitude", 5e5),),
        _cubic_damping,
    ),
    # powers that may describe a mode of a bolted structure
    Kind(
        "quartic_damping",
        r"c\, \dot z |\dot z|^3",
        (Parameter("damping_n_s4_per_m4", "N s^4/m^4", "amplitude", 2e7),),
        _quartic_damping,
        searched=False,
    ),
    Kind(
        "quintic_damping",
        r"c\, \dot z^5",
        (Parameter("damping_n_s5_per_m5", "N s^5/m^5", "amplitude", 1e9),),
        _quintic_damping,
        searched=False,
    ),
    # a damper between friction (n = 0) and orifice (n = 2)
    Kind(
        "signed_power_damping",
        r"c\, |\dot z|^n \operatorname{sgn} \dot z",
        (
            Parameter("damping_n_sn_per_mn", "N s^n/m^n", "amplitude", 2e4),
            Parameter("exponent", "1", "exponent", 1.5),
        ),
        _signed_power_damping,
        bench_only=True,
    ),
    # valves that differ in rebound and compression: damping C + c while the strut extends, C - c while it shortens
    Kind(
        "asymmetric_damping",
        r"c\, |\dot z|",
        (Parameter("damping_n_s_per_m", "N s/m", "amplitude", 1.5e3),),
        _asymmetric_damping,
    ),
    # damping that changes by c beyond the velocity s: a relief valve opens and c is negative
    Kind(
        "blow_off_damping",
        r"c\, (|\dot z| - s)_+ \operatorname{sgn} \dot z",
        (Parameter("damping_n_s_per_m", "N s/m", "amplitude", -3e3), Parameter("scale_m_per_s", "m/s", "scale", 0.05)),
        _blow_off_damping,
    ),
    # a spring whose stiffness grows with the travel, the same on both sides
    Kind(
        "quadratic_stiffness",
        r"k\, z |z|",
        (Parameter("stiffness_n_per_m2", "N/m^2", "amplitude", 3e7),),
        _quadratic_stiffness,
    ),
    # a spring that is stiffer in one direction, straighter than a gas; it gives a mode a force at twice its frequency
    Kind(
        "even_quadratic_stiffness",
        r"k\, z^2",
        (Parameter("stiffness_n_per_m2", "N/m^2", "amplitude", 5e6),),
        _even_quadratic_stiffness,
        is_about_rest=True,
        is_even=True,
    ),
    # the next odd term of any smooth spring
    Kind(
        "cubic_stiffness",
        r"k\, z^3",
        (Parameter("stiffness_n_per_m3", "N/m^3", "amplitude", 3e9),),
        _cubic_stiffness,
    ),
    # a power that may describe a mode of a bolted structure
    Kind(
        "quartic_stiffness",
        r"k\, z |z|^3",
        (Parameter("stiffness_n_per_m4", "N/m^4", "amplitude", 4e11),),
        _quartic_stiffness,
        searched=False,
    ),
    # the odd term after the cubic one: a spring that hardens late
    Kind(
        "quintic_stiffness",
        r"k\, z^5",
        (Parameter("stiffness_n_per_m5", "N/m^5", "amplitude", 5e13),),
        _quintic_stiffness,
    ),
    # a cubic that begins at the extension s: several of them, beside a cubic, make an odd cubic spline
    Kind(
        "late_cubic_stiffness",
        r"k\, (|z| - s)_+^3 \operatorname{sgn} z",
        (Parameter("stiffness_n_per_m3", "N/m^3", "amplitude", 3e9), Parameter("gap_m", "m", "scale", 0.004)),
        _late_cubic_stiffness,
        searched=False,
    ),
    # contact (n = 1.5 is Hertz) and rubber
    Kind(
        "signed_power_stiffness",
        r"k\, |z|^n \operatorname{sgn} z",
        (
            Parameter("stiffness_n_per_mn", "N/m^n", "amplitude", 1e6),
            Parameter("exponent", "1", "exponent", 1.5),
        ),
        _signed_power_stiffness,
        bench_only=True,
    ),
    # a helper spring or a preload that acts on one side: stiffness K + k in extension, K - k in compression
    Kind(
        "asymmetric_stiffness",
        r"k\, |z|",
        (Parameter("stiffness_n_per_m", "N/m", "amplitude", 5e4),),
        _asymmetric_stiffness,
    ),
    # bump stops on both sides (k > 0), or backlash taken from K (k > 0 with K small), beyond the gap s
    Kind(
        "dead_zone_stiffness",
        r"k\, (|z| - s)_+ \operatorname{sgn} z",
        (Parameter("stiffness_n_per_m", "N/m", "amplitude", 3e5), Parameter("gap_m", "m", "scale", 0.004)),
        _dead_zone_stiffness,
        limits=_limits_of_dead_zone,
    ),
    # the buffer that a strut meets at the end of its stroke in compression, a gap away from its position at rest ...
    Kind(
        "bump_stop",
        r"-k\, (-z - g)_+",
        (
            Parameter("stiffness_n_per_m", "N/m", "amplitude", 1e6),
            Parameter("gap_m", "m", "scale", 0.004, over_rms=(0.3, 5.0)),
        ),
        _bump_stop,
        is_about_rest=True,
        is_stop=True,
    ),
    # ... and one in extension
    Kind(
        "rebound_stop",
        r"k\, (z - g)_+",
        (
            Parameter("stiffness_n_per_m", "N/m", "amplitude", 1e6),
            Parameter("gap_m", "m", "scale", 0.004, over_rms=(0.3, 5.0)),
        ),
        _rebound_stop,
        is_about_rest=True,
        is_stop=True,
    ),
    # gas compressed in an oleo strut: F0 is the force at rest, h the gas volume over the piston area. In motion it is
    # polytropic, with an exponent from 1.1 where oil and gas mix to 1.35 where they are separated (Currey 1988,
    # Aircraft Landing Gear Design); loaded in a hangar it is isothermal
    Kind(
        "gas_column",
        r"F_0 (1 - (1 + z / h)^{-n})",
        (
            Parameter("static_force_n", "N", "amplitude", 1.8e4),
            # a column of gas is longer than the stroke
            Parameter("gas_length_m", "m", "scale", 0.1, over_rms=(3.0, 300.0)),
            Parameter("exponent", "1", "exponent", 1.225, within=(1.0, 1.7), known=(1.225, 0.07)),
        ),
        _gas_column,
        is_about_rest=True,
        quasi_static=(None, 1.0),
    ),
    *MEMORY_KINDS,
    # a power of a mode that would make it unstable beyond the motion s that its tests reach: from there on the force
    # continues along its secant
    Kind(
        "held_stiffness",
        r"k\, z \min(|z|, s)^{n-1}",
        (
            Parameter("stiffness_n_per_mn", "N/m^n", "amplitude", -3e9),
            Parameter("scale_m", "m", "scale", 0.004),
            Parameter("exponent", "1", "exponent", 3.0),
        ),
        _held_stiffness,
        searched=False,
    ),
    # the same of an even spring, by which modes drive each other
    Kind(
        "held_even_stiffness",
        r"k\, |z| \min(|z|, s)",
        (
            Parameter("stiffness_n_per_m2", "N/m^2", "amplitude", 5e6),
            Parameter("scale_m", "m", "scale", 0.004),
        ),
        _held_even_stiffness,
        is_about_rest=True,
        is_even=True,
        searched=False,
    ),
    Kind(
        "held_damping",
        r"c\, \dot z \min(|\dot z|, s)^{n-1}",
        (
            Parameter("damping_n_sn_per_mn", "N s^n/m^n", "amplitude", -5e5),
            Parameter("scale_m_per_s", "m/s", "scale", 0.05),
            Parameter("exponent", "1", "exponent", 3.0),
        ),
        _held_damping,
        searched=False,
    ),
)
"""The built-in kinds. A new one needs one function and one entry above."""

# the built-in kinds, and those that `opid.register_kind` added in this process
KNOWN = {kind.name: kind for kind in BUILT_IN}

LAWS: Mapping[str, Kind] = MappingProxyType(KNOWN)
"""Every kind of law by its name."""
