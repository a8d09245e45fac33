"""The kinds of restoring-force law: what a term of a law can be, one function each.

A kind is a force for unit amplitude together with its derivatives. The first entry of every kind says what the force
is, the comment above it what it stands for in a suspension.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

ForceAndDerivatives = tuple[Any, Any, Any, Any, Any]
RateAndDerivatives = tuple[Any, Any, Any, Any, Any, Any]

TWO_OVER_PI = 2.0 / math.pi
# keeps log(|z|) and |z|^(n-1) finite at z = 0
TINY = 1e-30
# share of the gas length that a strut can be compressed by: beyond, the force goes on along its tangent
BOTTOM = 0.95
# width over which the stiffness of a stop grows, over its gap: beyond, the force is that of a stop that begins at once
ROUNDING = 0.1
# fractions of the force of a joint, each in the middle of what one of its elements carries
ELEMENTS = tuple((k + 0.5) / 6 for k in range(6))


@dataclass(frozen=True)
class Parameter:
    """One parameter of a kind of law: its name with the unit in it, unit, role and a gear-sized default.

    The force is proportional to an `amplitude`; a `scale` or an `exponent` is positive, a `lag` or a `shape` any
    number; a search tries several lags, and a shape from its default on. Outside of `over_rms`, in rms motions, a scale
    cannot be seen: below, friction is a step, above, a straight line. A scale in seconds is compared with the ratio of
    rms travel and velocity. `within` is where an exponent is searched; `known` are the value and the standard deviation
    that are known of an exponent before any measurement.
    """

    name: str
    unit: str
    role: Literal["amplitude", "scale", "exponent", "lag", "shape"]
    default: float
    over_rms: tuple[float, float] = (0.01, 3.0)
    within: tuple[float, float] = (0.0, math.inf)
    known: tuple[float, float] | None = None


@dataclass(frozen=True)
class Kind:
    """One kind of law: an amplitude times a force of unit amplitude.

    Args:
        name: the name in files, options and results.
        latex: the force as a formula, with r"\\dot z" for the rate.
        parameters: the amplitude first, then at most two inner ones, a and b; four with a memory.
        function: (z, v, a, b) -> the force for unit amplitude and its derivatives by z, v, a and b. It is pure and
            written with numpy, works on arrays and, compiled by numba, on numbers; a parameter that the kind does not
            have is passed all the same, and its derivative is 0.0. Squares and products are twenty times faster than
            z**3.
        searched: whether a search for the law of a suspension tries it; the others are terms of a series, for which
            their neighbours would be taken, and only laws that are asked for have them.
        bench_only: whether only the search on a test bench tries it, where the force is measured. From runs a free
            power is not told from the kinds that it contains as special cases.
        is_about_rest: whether it is written about the position at rest, wherever that is on the spring's curve: the
            same curve about another position is the same kind with other parameters, and needs no origin.
        quasi_static: inner values with which it is loaded slowly, None for those that are as in quick motion; empty
            where all are. The amplitude of such a kind is the force that it carries at its origin, and 1 less its force
            for unit amplitude the fraction that is left elsewhere. Loaded slowly it comes to rest on one curve, and
            moves from there on another.
        is_stop: whether it is a stop: there is no force on the way to it, and it never pulls.
        is_friction: whether it is friction or yielding, whose force grows and falls by itself from run to run.
        memory: None for a force of travel and velocity alone. A kind with memory has a state h of its own:
            (h, v, a, b, c, u) -> h' and its derivatives by h, v, a, b and c. Its force for unit amplitude is h + d h',
            its inner parameters are a, b, c and d in this order, d = 0 where there is none, and `function` is the force
            of a slow motion that goes on in one direction.
        elements: values of u, one for each of several memories that stand side by side: the force is their mean.
        limit: what |h| does not pass: where it would, something slips.
        memory_start: standard deviation of h where a record begins, in the unit of h.
    """

    name: str
    latex: str
    parameters: tuple[Parameter, ...]
    function: Callable[..., ForceAndDerivatives] = field(repr=False)
    searched: bool = True
    bench_only: bool = False
    is_about_rest: bool = False
    quasi_static: tuple[float | None, ...] = ()
    is_stop: bool = False
    is_friction: bool = False
    memory: Callable[..., RateAndDerivatives] | None = field(default=None, repr=False)
    elements: tuple[float, ...] = (1.0,)
    limit: float = math.inf
    memory_start: float = 0.0


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


def _coulomb_friction(z: Any, v: Any, s: Any, _: Any) -> ForceAndDerivatives:
    shape = np.tanh(v / s)
    by_v = (1.0 - shape**2) / s
    return shape, 0.0, by_v, -by_v * v / s, 0.0


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


def _asymmetric_stiffness(z: Any, v: Any, _a: Any, _b: Any) -> ForceAndDerivatives:
    return np.abs(z), np.sign(z), 0.0, 0.0, 0.0


def _dead_zone_stiffness(z: Any, v: Any, s: Any, _: Any) -> ForceAndDerivatives:
    beyond = np.maximum(np.abs(z) - s, 0.0)
    touching_side = np.sign(z) * np.sign(beyond)
    return np.sign(z) * beyond, np.sign(beyond), 0.0, -touching_side, 0.0


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


def _sliding(z: Any, v: Any, _a: Any, _b: Any) -> ForceAndDerivatives:
    return np.sign(v), 0.0, 0.0, 0.0, 0.0


def _relaxed(z: Any, v: Any, a: Any, _: Any) -> ForceAndDerivatives:
    return a * v, 0.0, a, v, 0.0


def _dahl(h: Any, v: Any, s: Any, _b: Any, _c: Any, _u: Any) -> RateAndDerivatives:
    speed = np.abs(v)
    rate = (v - speed * h) / s
    return rate, -speed / s, (1.0 - np.sign(v) * h) / s, -rate / s, 0.0, 0.0


def _bouc_wen(h: Any, v: Any, s: Any, n: Any, c: Any, _u: Any) -> RateAndDerivatives:
    size = np.maximum(np.abs(h), TINY)
    power = size**n
    direction = 0.5 * np.sign(v) * np.sign(h) + c
    by_v = (1.0 - power * direction) / s
    by_h = -n * power / size * np.sign(h) * direction * v / s
    return by_v * v, by_h, by_v, -by_v * v / s, -np.log(size) * power * direction * v / s, -power * v / s


def _lugre(h: Any, v: Any, s: Any, b: Any, w: Any, _u: Any) -> RateAndDerivatives:
    speed, ratio = np.abs(v), v / w
    bell = np.exp(-ratio * ratio)
    level = 1.0 + (b - 1.0) * bell
    rate = (v - speed * h / level) / s
    by_level = speed * h / (level * level * s)
    of_bell = 2.0 * (b - 1.0) * bell * ratio / w
    by_v = (1.0 - np.sign(v) * h / level) / s - by_level * of_bell
    return rate, -speed / (level * s), by_v, -rate / s, by_level * bell, by_level * of_bell * ratio


def _slipping(h: Any, v: Any, s: Any, p: Any, c: Any, u: Any) -> RateAndDerivatives:
    fraction = np.minimum(u * (1.0 + c), 1.0)
    by_v = 1.0 / (s * fraction**p)
    rate = by_v * v
    by_c = -p * rate / (1.0 + c) * np.sign(1.0 - fraction)
    return rate, 0.0, by_v, -rate / s, -rate * np.log(fraction), by_c


def _maxwell(h: Any, v: Any, t: Any, _b: Any, _c: Any, _u: Any) -> RateAndDerivatives:
    return v - h / t, -1.0 / t, 1.0, h / (t * t), 0.0, 0.0


BUILT_IN = (
    # dry friction that turns over within the velocity s
    Kind(
        "arctan_velocity",
        r"A \tfrac{2}{\pi} \arctan(\dot z / s)",
        (Parameter("amplitude_n", "N", "amplitude", 400.0), Parameter("scale_m_per_s", "m/s", "scale", 0.02)),
        _arctan_velocity,
        is_friction=True,
    ),
    # a spring that gives way beyond the travel s
    Kind(
        "arctan_displacement",
        r"A \tfrac{2}{\pi} \arctan(z / s)",
        (Parameter("amplitude_n", "N", "amplitude", 400.0), Parameter("scale_m", "m", "scale", 0.002)),
        _arctan_displacement,
    ),
    # Iwaniec & Uhl 2007, eq. (3), f/M2 = a z + arctan(d b (z + c v)): A = (pi/2) M2 (1 m/s^2), s = 1/(d b),
    # c = c; the term a z is linear, so it belongs to the stiffness of the joint (K2 grows by M2 a)
    Kind(
        "arctan_mixed",
        r"A \tfrac{2}{\pi} \arctan((z + c \dot z) / s)",
        (
            Parameter("amplitude_n", "N", "amplitude", 400.0),
            # of z + c z', which is larger than z
            Parameter("scale_m", "m", "scale", 0.002, over_rms=(0.01, 10.0)),
            Parameter("lag_s", "s", "lag", 0.05),
        ),
        _arctan_mixed,
    ),
    # dry friction that is full soon beyond the velocity s
    Kind(
        "coulomb_friction",
        r"A \tanh(\dot z / s)",
        (Parameter("amplitude_n", "N", "amplitude", 400.0), Parameter("scale_m_per_s", "m/s", "scale", 0.02)),
        _coulomb_friction,
        is_friction=True,
    ),
    # oil pressed through an orifice
    Kind(
        "quadratic_damping",
        r"c\, \dot z |\dot z|",
        (Parameter("damping_n_s2_per_m2", "N s^2/m^2", "amplitude", 4e4),),
        _quadratic_damping,
    ),
    # the same with another orifice in rebound than in compression, as oleo struts have it: c while it shortens, r c
    # while it extends
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
    # powers that a mode of a bolted structure may be described by
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
    # other valves in rebound than in compression: damping C + c while it extends, C - c while it shortens
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
    # a spring that is stiffer in one direction, straighter than a gas: of a mode the force at twice its frequency
    Kind(
        "even_quadratic_stiffness",
        r"k\, z^2",
        (Parameter("stiffness_n_per_m2", "N/m^2", "amplitude", 5e6),),
        _even_quadratic_stiffness,
        is_about_rest=True,
    ),
    # the next odd term of any smooth spring
    Kind(
        "cubic_stiffness",
        r"k\, z^3",
        (Parameter("stiffness_n_per_m3", "N/m^3", "amplitude", 3e9),),
        _cubic_stiffness,
    ),
    # a power that a mode of a bolted structure may be described by
    Kind(
        "quartic_stiffness",
        r"k\, z |z|^3",
        (Parameter("stiffness_n_per_m4", "N/m^4", "amplitude", 4e11),),
        _quartic_stiffness,
        searched=False,
    ),
    # and the one after that: a spring that hardens late
    Kind(
        "quintic_stiffness",
        r"k\, z^5",
        (Parameter("stiffness_n_per_m5", "N/m^5", "amplitude", 5e13),),
        _quintic_stiffness,
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
    ),
    # what a strut runs into at the end of its stroke, a gap away from where it rests: a buffer in compression ...
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
    # gas compressed in an oleo strut, F0 carried at rest, h its volume over the piston area. Moving it is polytropic,
    # with an exponent of 1.1 where oil and gas mix to 1.35 where they are apart (Currey 1988, Aircraft Landing Gear
    # Design); loaded in a hangar it is isothermal
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
    # dry friction that bends before it slides: A/s is its stiffness, s the travel after which it slides (Dahl 1968)
    Kind(
        "dahl_friction",
        r"A h,\ \dot h = (\dot z - |\dot z| h) / s",
        (
            Parameter("amplitude_n", "N", "amplitude", 400.0),
            Parameter("scale_m", "m", "scale", 5e-4, over_rms=(0.003, 3.0)),
        ),
        _sliding,
        is_friction=True,
        memory=_dahl,
        memory_start=0.5,
    ),
    # a joint or an isolator that yields (Bouc 1967, Wen 1976): stiffness K + A/s before, K after, sharper with n; with
    # c = 1/2 it yields at the force A and the travel s, in general at both times (1/2 + c)^(-1/n)
    Kind(
        "bouc_wen",
        r"A h,\ \dot h = \dot z (1 - |h|^n (c + \tfrac12 \operatorname{sgn} \dot z h)) / s",
        (
            Parameter("amplitude_n", "N", "amplitude", 400.0),
            Parameter("scale_m", "m", "scale", 2e-3, over_rms=(0.01, 3.0)),
            Parameter("exponent", "1", "exponent", 2.0, within=(1.0, 10.0)),
            Parameter("shape", "1", "shape", 0.5),
        ),
        _sliding,
        is_friction=True,
        memory=_bouc_wen,
        memory_start=0.5,
    ),
    # friction of bristles that breaks away at b A and falls to A beyond the velocity w (Canudas de Wit et al. 1995)
    Kind(
        "lugre_friction",
        r"A (h + \tau \dot h),\ \dot h = (\dot z - |\dot z| h / (1 + (b - 1) e^{-(\dot z / w)^2})) / s",
        (
            Parameter("amplitude_n", "N", "amplitude", 400.0),
            Parameter("scale_m", "m", "scale", 5e-4, over_rms=(0.003, 3.0)),
            Parameter("breakaway_ratio", "1", "exponent", 1.4, within=(0.3, 5.0)),
            Parameter("stribeck_m_per_s", "m/s", "scale", 0.05),
            Parameter("bristle_lag_s", "s", "shape", 1e-3),
        ),
        _sliding,
        is_friction=True,
        memory=_lugre,
        memory_start=0.5,
    ),
    # a joint of springs in series with sliders, which slip one after the other until all have at the travel s (Iwan
    # 1966): what carries the fraction u of the force slips at s ((1 + c) u)^p, or at s; p = 1/2 where the stiffness of
    # the elements is spread evenly over their travels (Segalman's chi is 1/p - 2), c > 0 where many slip last, at once
    Kind(
        "iwan_friction",
        r"A \overline{h_u},\ \dot h_u = \dot z / (s \min(1, u + c u)^p),\ |h_u| \le 1",
        (
            Parameter("amplitude_n", "N", "amplitude", 400.0),
            Parameter("scale_m", "m", "scale", 2e-3, over_rms=(0.01, 5.0)),
            Parameter("spread", "1", "exponent", 0.5, within=(0.05, 3.0)),
            Parameter("jump", "1", "exponent", 0.5, within=(0.01, 10.0)),
        ),
        _sliding,
        is_friction=True,
        memory=_slipping,
        elements=ELEMENTS,
        limit=1.0,
        memory_start=0.5,
    ),
    # a spring and a damper in series, an arm of rubber: stiffness k in quick motion, damping k T in slow motion
    Kind(
        "maxwell_arm",
        r"k h,\ \dot h = \dot z - h / T",
        (
            Parameter("stiffness_n_per_m", "N/m", "amplitude", 5e4),
            Parameter("relaxation_s", "s", "scale", 0.02, over_rms=(0.03, 10.0)),
        ),
        _relaxed,
        memory=_maxwell,
    ),
)
"""The kinds that are always there. A new one is one function and one entry above; nothing else changes."""

# what the process knows: the built-in kinds and those registered by `opid.mechanics.own_kinds.register_kind`
KNOWN = {kind.name: kind for kind in BUILT_IN}

LAWS: Mapping[str, Kind] = MappingProxyType(KNOWN)
"""Every kind of law by its name."""
