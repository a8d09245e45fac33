"""A user's own kinds of law, beside the built-in ones, for as long as the process lives."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from opid.errors import InputError, nearest
from opid.mechanics.laws.kinds import BUILT_IN, KNOWN, Kind

# size of the motions of a gear at which a new kind is tried, and the largest relative error of its derivatives
TRAVEL_M, VELOCITY_M_PER_S, N_POINTS = 0.01, 0.2, 50
TOLERANCE = 1e-4


def register_kind(kind: Kind) -> None:
    """Add a kind of law: from now on it is simulated, fitted and reported like those of `opid.laws.LAWS`.

    Its derivatives are compared with differences at random motions of a landing gear, with inner parameters around
    their defaults. Its function is compiled once in each process that uses the kind; the kernels are not compiled anew.

    Args:
        kind: the kind; its function takes (z, v, a, b) and returns the force for unit amplitude and its derivatives
            by z, v, a and b, 0.0 where there is none.

    Raises:
        InputError: a name that is taken or not an identifier, a memory, parameters out of order, a function that numba
            cannot compile, that is not finite or not zero at rest, or a derivative that is wrong.

    >>> def softening(z, v, s, _):
    ...     by_ratio = np.exp(-((z / s) ** 2))
    ...     return z * by_ratio, (1 - 2 * (z / s) ** 2) * by_ratio, 0.0, 2 * (z / s) ** 3 * by_ratio, 0.0
    >>> from opid.mechanics.laws.kinds import Parameter
    >>> from opid.mechanics.laws.law import default_law
    >>> stiffness = Parameter("stiffness_n_per_m", "N/m", "amplitude", 1e5)
    >>> scale = Parameter("scale_m", "m", "scale", 0.005)
    >>> register_kind(Kind("softening", r"k z \\exp(-z^2 / s^2)", (stiffness, scale), softening))
    >>> default_law("softening+cubic_stiffness").name
    'cubic_stiffness+softening'
    >>> unregister_kind("softening")
    """
    # numba takes long to load, and only this function needs it here.
    from opid.mechanics.kernels import check_compiles

    _check_description(kind)
    check_compiles(kind)
    _check_derivatives(kind)
    KNOWN[kind.name] = kind


def unregister_kind(name: str) -> None:
    """Remove a registered kind.

    Args:
        name: the name of the kind.

    Raises:
        InputError: an unknown or a built-in kind.
    """
    own = [known for known in KNOWN if known not in {kind.name for kind in BUILT_IN}]
    if name not in own:
        raise InputError(f"there is no registered law {name!r}: {nearest(name, own) if own else 'none is registered'}")
    del KNOWN[name]


def _check_description(kind: Kind) -> None:
    if not kind.name.isidentifier() or kind.name == "linear":
        raise InputError(f"a law cannot be called {kind.name!r}: give letters, digits and underscores, not 'linear'")
    if kind.name in KNOWN:
        raise InputError(f"there is a law {kind.name!r} already: give another name, or unregister_kind it first")
    if kind.memory is not None:
        raise InputError(
            f"{kind.name} has a memory: only built-in laws may have one, give a force of travel and velocity alone"
        )
    roles = [parameter.role for parameter in kind.parameters]
    if not 1 <= len(roles) <= 3 or roles[0] != "amplitude" or "amplitude" in roles[1:]:
        raise InputError(
            f"{kind.name} has parameters of the roles {roles}: give one amplitude, then at most two others"
        )
    names = [parameter.name for parameter in kind.parameters]
    if len(set(names)) < len(names):
        raise InputError(f"{kind.name} has the parameters {names}: give each its own name")
    for parameter in kind.parameters:
        positive = parameter.role in ("scale", "exponent")
        if parameter.role not in ("amplitude", "scale", "exponent", "lag"):
            raise InputError(
                f"{parameter.name} of {kind.name} has the role {parameter.role!r}: give scale, exponent or lag"
            )
        if not math.isfinite(parameter.default) or (positive and parameter.default <= 0.0):
            needed = "positive" if positive else "finite"
            raise InputError(
                f"{parameter.name} of {kind.name} has the default {parameter.default:g}: give a {needed} one"
            )


def _check_derivatives(kind: Kind) -> None:
    rng = np.random.default_rng(0)
    defaults = np.array([*(parameter.default for parameter in kind.parameters[1:]), 1.0, 1.0])[:2]
    size = np.array([TRAVEL_M, VELOCITY_M_PER_S, *np.maximum(np.abs(defaults), 1e-12)])
    points = [scale * rng.uniform(-1.0, 1.0, N_POINTS) for scale in size[:2]]
    points += [value * rng.uniform(0.8, 1.25, N_POINTS) for value in defaults]
    found = kind.function(*points)
    shape = np.broadcast_to(found[0], (N_POINTS,))
    # Values that are not finite are reported below, without a warning of numpy.
    with np.errstate(all="ignore"):
        at_rest = np.concatenate([np.broadcast_to(part, 1) for part in kind.function(*np.zeros((2, 1)), *defaults)])
    if not np.isfinite(at_rest).all() or not all(np.isfinite(part).all() for part in found):
        raise InputError(
            f"{kind.name} or one of its derivatives is not finite at rest or at a motion of a gear: make it finite"
        )
    if at_rest[0] != 0.0:
        raise InputError(
            f"{kind.name} is {at_rest[0]:g} at rest: subtract this static force, for motions are about rest"
        )
    labels = ["z", "v", *(parameter.name for parameter in kind.parameters[1:])]
    absent = [*points[: len(labels)], *(10.0 * values for values in points[len(labels) :])]
    if np.any(kind.function(*absent)[0] != found[0]) or any(np.any(part != 0.0) for part in found[len(labels) + 1 :]):
        raise InputError(f"{kind.name} uses a parameter that it does not name: add it to the parameters of the kind")
    for index, given in enumerate(found[1 : len(labels) + 1]):
        step = 1e-6 * size[index]
        numeric = _differentiate(kind.function, points, index, step)
        rounding = 1e-14 * float(np.abs(shape).max()) / step
        allowed = TOLERANCE * float(np.abs(numeric).max()) + rounding
        # The chance of a corner within a step of a point is about one in ten thousand.
        wrong = np.abs(given - numeric) > allowed
        if wrong.any():
            worst = int(np.argmax(np.abs(given - numeric)))
            value = float(np.broadcast_to(given, numeric.shape)[worst])
            raise InputError(
                f"the derivative of {kind.name} by {labels[index]} is {value:g} and differences give "
                f"{numeric[worst]:g}, at z = {points[0][worst]:.3g} m, v = {points[1][worst]:.3g} m/s: correct it"
            )


def _differentiate(function: Callable[..., Any], points: list[Any], index: int, step: float) -> Any:
    up, down = list(points), list(points)
    up[index] = points[index] + step
    down[index] = points[index] - step
    difference = (function(*up)[0] - function(*down)[0]) / (2.0 * step)
    return np.broadcast_to(difference, points[index].shape)
