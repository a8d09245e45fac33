"""Backbones followed by arclength, through turning points of the amplitude and interactions with other modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from opid.errors import InputError
from opid.mechanics.backbones.family import Backbone, laws_of_joints, refuse_unseen, require_amplitudes
from opid.mechanics.backbones.harmonic_balance import (
    Balance,
    balance,
    linear_unknowns,
    modal_motion,
    residual,
    solve_at,
)
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.laws.law import FloatArray, TermSet

MOST_ITERATIONS = 8
"""Iterations of Newton's method in one step; where it needs more, the step is made smaller."""
EASY, HARD = 3, 5
"""Numbers of iterations up to which the next step is longer, and from which on it is shorter."""
SMALLEST_STEP = 1e-9
"""Fraction of the largest step below which the curve ends."""
LEAST_COSINE = 0.9
"""Least cosine between the directions of two steps; where a curve turns more, the step is made smaller."""


@dataclass(frozen=True, eq=False)
class ContinuedBackbone(Backbone):
    """A backbone as a curve: amplitude and frequency may both turn back, and the amplitude may pass zero.

    All points are solutions, and `reason` states why the curve ended before the last amplitude.

    Attributes:
        turning_points: (n_turns,) indices of the points at which the amplitude turns back.
        modal_motion: (n, n_harmonics, n_modes) cosine coefficients of the modal coordinates, m kg^1/2.
    """

    turning_points: NDArray[np.int64]
    modal_motion: FloatArray


def continued_backbone(
    system: JointedModes,
    law: TermSet | Sequence[TermSet],
    *,
    mode: int,
    sensor: str,
    first_amplitude_m: float,
    last_amplitude_m: float,
    harmonics: Sequence[int] = (1, 3, 5),
    largest_step: float = 0.05,
    most_points: int = 2000,
) -> ContinuedBackbone:
    """Return the backbone from a small amplitude to a large one by pseudo-arclength continuation.

    The equations are those of `backbone`, with the amplitude among the unknowns and each step held perpendicular to the
    direction of the curve, so that they are regular where the amplitude turns. Modes within an octave of a harmonic
    keep their coordinate, so that interactions such as 3:1 are passed. Branches that cross are not taken.

    Args:
        system: the linear structure by its modes.
        law: law of all joints, or one for each; springs only.
        mode: number of the mode, from 1.
        sensor: name of the sensor whose amplitude is followed.
        first_amplitude_m: amplitude at which the curve begins, near the linear mode, m.
        last_amplitude_m: amplitude, in absolute value, at which the curve ends, m.
        harmonics: harmonics of the motion, see `backbone`.
        largest_step: largest step of the curve, as a fraction of the last amplitude and of the coordinates there.
        most_points: number of points after which the curve ends.

    Raises:
        InputError: what `backbone` refuses; a last amplitude that is not larger; no solution at the first.

    >>> from opid.mechanics.laws.law import law
    >>> one = JointedModes([100.0], [[1.0]], [[1.0]], ("mass",), ("spring",))
    >>> curve = continued_backbone(one, law("cubic_stiffness", stiffness_n_per_m3=4e6), mode=1, sensor="mass",
    ...                            first_amplitude_m=1e-4, last_amplitude_m=2e-3, harmonics=(1,))
    >>> bool(np.allclose((2 * np.pi * curve.frequency_hz) ** 2, 100.0 + 3e6 * curve.amplitude**2, rtol=1e-9))
    True
    """
    amplitudes = require_amplitudes([first_amplitude_m, last_amplitude_m])
    if amplitudes[0] >= amplitudes[1]:
        raise InputError(
            f"the amplitudes go from {first_amplitude_m:g} to {last_amplitude_m:g} m: give the smaller one first"
        )
    if not (0.0 < largest_step <= 1.0 and most_points >= 2):
        raise InputError(f"largest_step is {largest_step} and most_points {most_points}: give up to 1, and 2 or more")
    refuse_unseen(system, system.index(mode), system.sensor(sensor))
    equations = balance(system, laws_of_joints(law, system), mode=mode, sensor=sensor, harmonics=harmonics)
    start = solve_at(equations, linear_unknowns(equations, amplitudes[0]), amplitudes[0])
    if start is None:
        raise InputError(
            f"there is no solution near the linear mode at the first amplitude, {first_amplitude_m:g} m at {sensor!r}: "
            "begin at a smaller one"
        )
    scales = _choose_scales(equations, linear_unknowns(equations, amplitudes[1]), amplitudes[1])
    points, turns, reason = _follow(equations, scales, start, amplitudes, largest_step, most_points)
    return _make_curve(equations, mode, sensor, points, turns, reason)


def _choose_scales(equations: Balance, linear: FloatArray, last_amplitude_m: float) -> FloatArray:
    """Return the size of each unknown at the last amplitude, and last the size of the amplitude."""
    n = equations.n_joint_unknowns
    coordinate = np.abs(linear[n:-1]).max()
    extension = max(np.abs(linear[:n]).max(initial=0.0), 1e-3 * last_amplitude_m)
    # A backbone may move by a tenth of the eigenvalue: with this scale its flat and steep parts are alike.
    return np.concatenate([
        np.full(n, extension), np.full(linear.size - n - 1, coordinate), [0.1 * linear[-1], last_amplitude_m]
    ])  # fmt: skip


def _make_bordered(
    equations: Balance, scales: FloatArray, point: FloatArray, direction: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return values of the equations and their scaled Jacobian with the amplitude, bordered by a direction."""
    actual = point * scales
    value, jacobian = residual(equations, actual[:-1], actual[-1])
    bordered = np.zeros((point.size, point.size))
    bordered[:-1, :-1] = jacobian
    bordered[-2, -1] = -1.0
    bordered[:-1] *= scales
    bordered[-1] = direction
    return value, bordered


def _find_direction(equations: Balance, scales: FloatArray, point: FloatArray, before: FloatArray) -> FloatArray:
    """Return the unit vector along the curve that continues the direction before."""
    _, bordered = _make_bordered(equations, scales, point, before)
    along = np.linalg.solve(bordered, np.eye(point.size)[-1])
    return along / np.linalg.norm(along)


def _correct(
    equations: Balance, scales: FloatArray, predicted: FloatArray, direction: FloatArray
) -> tuple[FloatArray, int] | None:
    """Return the point of the curve on the plane across the direction, and the iterations; None without one."""
    point = predicted.copy()
    for iteration in range(MOST_ITERATIONS):
        value, bordered = _make_bordered(equations, scales, point, direction)
        try:
            step = np.linalg.solve(bordered, np.append(value, direction @ (point - predicted)))
        except np.linalg.LinAlgError:
            return None
        point -= step
        if not np.isfinite(point).all() or point[-2] <= 0.0:
            return None
        if np.abs(step).max() <= 1e-10 * np.abs(point).max():
            return point, iteration + 1
    return None


def _follow(
    equations: Balance,
    scales: FloatArray,
    start: FloatArray,
    amplitudes: FloatArray,
    largest_step: float,
    most_points: int,
) -> tuple[FloatArray, list[int], str]:
    """Return the points of the curve, the indices of its turns, and why it ended early."""
    points = [np.append(start, amplitudes[0]) / scales]
    turns: list[int] = []
    along = _find_direction(equations, scales, points[0], np.eye(scales.size)[-1])
    step = largest_step / 10.0
    while abs(points[-1][-1]) < 1.0:
        if len(points) >= most_points:
            reason = _describe_end(points, scales, f"it has {most_points} points")
            return np.array(points) * scales, turns, reason
        found = _correct(equations, scales, points[-1] + step * along, along)
        turned = None if found is None else _find_direction(equations, scales, found[0], along)
        if found is None or turned is None or turned @ along < LEAST_COSINE:
            step /= 2.0
            if step < SMALLEST_STEP * largest_step:
                return np.array(points) * scales, turns, _describe_end(points, scales, "Newton's method fails")
            continue
        if along[-1] * turned[-1] < 0.0:
            points.append(_find_turn(equations, scales, points[-1], along, step, turned))
            turns.append(len(points) - 1)
        points.append(found[0])
        along = turned
        step = min(step * (1.5 if found[1] <= EASY else 0.7 if found[1] >= HARD else 1.0), largest_step)
    return np.array(_move_last(equations, scales, points)) * scales, turns, ""


def _find_turn(
    equations: Balance, scales: FloatArray, point: FloatArray, along: FloatArray, step: float, turned: FloatArray
) -> FloatArray:
    """Return the point within a step at which the amplitude turns, by regula falsi on the amplitude's direction."""
    low, high, at_low, at_high = 0.0, step, along[-1], turned[-1]
    best = point
    for _ in range(8):
        middle = low + (high - low) * np.clip(at_low / (at_low - at_high), 0.05, 0.95)
        found = _correct(equations, scales, point + middle * along, along)
        if found is None:
            break
        best = found[0]
        at_middle = _find_direction(equations, scales, best, along)[-1]
        if at_middle * at_low > 0.0:
            low, at_low = middle, at_middle
        else:
            high, at_high = middle, at_middle
    return best


def _move_last(equations: Balance, scales: FloatArray, points: list[FloatArray]) -> list[FloatArray]:
    """Return the points, of which the last one is moved back to the last amplitude."""
    before, beyond = points[-2], points[-1]
    target = np.sign(beyond[-1])
    fraction = (target - before[-1]) / (beyond[-1] - before[-1])
    guess = (before + fraction * (beyond - before)) * scales
    found = solve_at(equations, guess[:-1], float(target * scales[-1]))
    return points if found is None else [*points[:-1], np.append(found, target * scales[-1]) / scales]


def _describe_end(points: list[FloatArray], scales: FloatArray, why: str) -> str:
    at = points[-1] * scales
    return (
        f"the curve ends at {np.sqrt(at[-2]) / (2 * np.pi):.6g} Hz and {at[-1]:.4g} m, point {len(points)}: {why}; "
        "take other harmonics, a smaller largest_step or more points"
    )


def _make_curve(
    equations: Balance, mode: int, sensor: str, points: FloatArray, turns: list[int], reason: str
) -> ContinuedBackbone:
    motion = np.array([modal_motion(equations, point[:-1]) for point in points])
    n, first = equations.n_joint_unknowns, equations.harmonics.index(1)
    return ContinuedBackbone(
        mode=mode,
        sensor=sensor,
        amplitude=points[:, -1].copy(),
        frequency_hz=np.sqrt(points[:, -2]) / (2 * np.pi),
        shapes=motion[:, first] @ equations.system.at_sensors.T,
        harmonics=equations.harmonics,
        converged=np.ones(len(points), dtype=np.bool_),
        turning_points=np.array(turns, dtype=np.int64),
        reason=reason,
        extension=points[:, :n].reshape(len(points), len(equations.harmonics), len(equations.laws)),
        modal_motion=motion,
    )
