"""The kinds of law with memory: friction that bends before it slides, joints that yield, arms of rubber.

Each has a state beside the motion; `opid.laws.Kind` describes the values of its functions.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from opid.mechanics.laws.kind import (
    TINY,
    CycleAndDerivatives,
    ForceAndDerivatives,
    Kind,
    Parameter,
    RateAndDerivatives,
)

# Each element carries the force of a joint between two of these fractions. Their ratios are nearly equal, because many
# small sliders slip first. With twenty such elements for joints of forty sliders the misfit is the noise of usual
# sensors; with ten it was larger, and a search found other terms that compensated for it.
_EDGES = (0.0, *np.geomspace(0.005, 1.0, 20).tolist())
ELEMENTS = tuple(0.5 * (low + high) for low, high in pairwise(_EDGES))
WEIGHTS = tuple(high - low for low, high in pairwise(_EDGES))
# Gauss nodes of an element, over its middle, and their weights
_HALF_SPAN = (_EDGES[-1] - _EDGES[-2]) / (_EDGES[-1] + _EDGES[-2])
_SPAN = tuple(
    (1.0 + _HALF_SPAN * node, weight / 2) for node, weight in zip(*np.polynomial.legendre.leggauss(4), strict=True)
)


def _sliding(z: Any, v: Any, _a: Any, _b: Any) -> ForceAndDerivatives:
    return np.sign(v), 0.0, 0.0, 0.0, 0.0


def _relaxed(z: Any, v: Any, a: Any, _: Any) -> ForceAndDerivatives:
    return a * v, 0.0, a, v, 0.0


def _dahl(h: Any, v: Any, s: Any, _b: Any, _c: Any, _u: Any) -> RateAndDerivatives:
    speed = np.abs(v)
    rate = (v - speed * h) / s
    return rate, -speed / s, (1.0 - np.sign(v) * h) / s, -rate / s, 0.0, 0.0


def _dahl_cycle(z: Any, reach: Any, s: Any, _b: Any, _c: Any) -> CycleAndDerivatives:
    # The loop is -1 + (1 + tanh X) exp(x - X) on its way back, and the mean of both ways sinh x / cosh X.
    x, top = z / s, reach / s
    fall, whole = np.exp(np.abs(x) - top), 1.0 + np.exp(-2.0 * top)
    rest = np.exp(-2.0 * np.abs(x))
    mean = np.sign(x) * fall * (1.0 - rest) / whole
    by_z = (fall * (1.0 + rest) / whole - 1.0) / s
    by_reach = -mean * np.tanh(top) / s
    return mean - x, by_z, by_reach, -(z * by_z + reach * by_reach) / s, 0.0, 0.0


def _dahl_loss(reach: Any, s: Any, _b: Any, _c: Any) -> Any:
    return 4.0 * (reach - s * np.tanh(reach / s))


def _bouc_wen(h: Any, v: Any, s: Any, n: Any, c: Any, _u: Any) -> RateAndDerivatives:
    size = np.maximum(np.abs(h), TINY)
    logarithm = np.log(size)
    # This is three times as fast as size**n.
    power = np.exp(n * logarithm)
    direction = 0.5 * np.sign(v) * np.sign(h) + c
    by_v = (1.0 - power * direction) / s
    by_h = -n * power / size * np.sign(h) * direction * v / s
    return by_v * v, by_h, by_v, -by_v * v / s, -logarithm * power * direction * v / s, -power * v / s


def _lugre(h: Any, v: Any, s: Any, b: Any, w: Any, _u: Any) -> RateAndDerivatives:
    speed, ratio = np.abs(v), v / w
    bell = np.exp(-ratio * ratio)
    sliding = 1.0 + (b - 1.0) * bell
    rate = (v - speed * h / sliding) / s
    by_sliding = speed * h / (sliding * sliding * s)
    of_bell = 2.0 * (b - 1.0) * bell * ratio / w
    by_v = (1.0 - np.sign(v) * h / sliding) / s - by_sliding * of_bell
    return rate, -speed / (sliding * s), by_v, -rate / s, by_sliding * bell, by_sliding * of_bell * ratio


def _slipping(h: Any, v: Any, s: Any, p: Any, c: Any, u: Any) -> RateAndDerivatives:
    # An element is as stiff as the sliders that it represents: with the slip travel of their middle alone, the force
    # would not depend on c below 0.2, and fits ended there.
    by_v, by_p, by_c = 0.0, 0.0, 0.0
    for node, weight in _SPAN:
        fraction = np.minimum(u * node * (1.0 + c), 1.0)
        stiffness = weight / (s * fraction**p)
        by_v += stiffness
        by_p -= stiffness * np.log(fraction)
        by_c -= stiffness * p / (1.0 + c) * np.sign(1.0 - fraction)
    return by_v * v, 0.0, by_v, -by_v * v / s, by_p * v, by_c * v


def _slipping_cycle(z: Any, reach: Any, s: Any, p: Any, c: Any) -> CycleAndDerivatives:
    # On first loading to x, in units of s, sliders lose L = f x^q, q = 1 / p, and all their stiffness beyond 1. The
    # loop is that curve twice as large (Masing), so that the mean of both ways loses L((X + x) / 2) - L((X - x) / 2).
    # With q < 1 the stiffness has no end, and the logarithm is nan.
    q, gradual = 1.0 / p, 1.0 / (1.0 + c)
    excess = np.exp(np.log(q - 1.0))
    f = gradual / excess
    stiffness = f * q + 1.0 - gradual
    force, by_z, by_reach, by_s, by_q, by_c = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for sign in (1.0, -1.0):
        x = np.maximum(0.5 * (reach + sign * z) / s, TINY)
        inside = np.minimum(x, 1.0)
        beyond = x - inside
        slides = np.sign(beyond)
        logarithm = np.log(inside)
        power = np.exp(q * logarithm)
        slope = sign * ((1.0 - slides) * f * q * power / inside + slides * stiffness)
        force = force - sign * (f * power + stiffness * beyond)
        by_z = by_z - 0.5 * sign * slope / s
        by_reach = by_reach - 0.5 * slope / s
        by_s = by_s + slope * x / s
        by_q = by_q - sign * f * (power * logarithm - (power + beyond) / excess)
        by_c = by_c + sign * gradual * (f * power + (f * q - gradual) * beyond)
    return force, by_z, by_reach, by_s, -q * q * by_q, by_c


def _slipping_loss(reach: Any, s: Any, p: Any, c: Any) -> Any:
    q, gradual = 1.0 / p, 1.0 / (1.0 + c)
    f = gradual / np.exp(np.log(q - 1.0))
    stiffness = f * q + 1.0 - gradual
    x = reach / s
    inside = np.minimum(x, 1.0)
    beyond, power = x - inside, inside**q
    lost = f * power + stiffness * beyond
    integral = f * power * inside / (q + 1.0) + f * beyond + 0.5 * stiffness * beyond**2
    return s * (4.0 * x * lost - 8.0 * integral)


def _maxwell(h: Any, v: Any, t: Any, _b: Any, _c: Any, _u: Any) -> RateAndDerivatives:
    return v - h / t, -1.0 / t, 1.0, h / (t * t), 0.0, 0.0


MEMORY_KINDS = (
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
        cycle=_dahl_cycle,
        cycle_loss=_dahl_loss,
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
            Parameter("spread", "1", "exponent", 0.5, within=(0.05, 3.0), stiff_below=1.0),
            Parameter("jump", "1", "exponent", 0.5, within=(0.01, 10.0)),
        ),
        _sliding,
        is_friction=True,
        memory=_slipping,
        elements=ELEMENTS,
        weights=WEIGHTS,
        limit=1.0,
        memory_start=0.5,
        cycle=_slipping_cycle,
        cycle_loss=_slipping_loss,
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
"""In the order in which a law names them, after the kinds without memory."""
