"""A body on suspensions whose unsprung sides are measured: what moves is driven by what was recorded.

Nothing is known of the ground. Below each suspension (interface) an accelerometer gives u = x1''; the relative motion
z = x2 - x1 of each interface then obeys

    z'' = -A F - u,    F_i = K_i z_i + C_i z_i' + f_i(z_i, z_i') + G_i x2_i,    x2'' = -A F,

A = J M^-1 J^T the accelerance of the free body at the interfaces. A gear alone is the smallest case, A = 1/M2. The
measured acceleration is never integrated: it drives a damped system, so nothing drifts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.kernels import law_arrays, predictor
from opid.mechanics.laws.law import LINEAR, FloatArray, TermSet

# half width of the interpolating kernel in samples; under a Kaiser window of 8.6 a longer one gains nothing
_HALF_WIDTH = 32


# parameters of an interface before those of its law: stiffness, damping, ground stiffness, where the law rests
N_HEAD = 4


class UnboundedResponseError(NotDeterminedError):
    """A driven body whose motion grows without bound: no such suspension was recorded."""


@dataclass(frozen=True)
class Interface:
    """One suspension between a measured unsprung side and the body.

    Args:
        stiffness: K, N/m.
        damping: C, N s/m.
        ground_stiffness: G, from the body to the ground at this place, N/m.
        law: f(z, z'), N, and where it rests.
    """

    stiffness: float
    damping: float
    ground_stiffness: float = 0.0
    law: TermSet = LINEAR

    @property
    def n_parameters(self) -> int:
        """Stiffness, damping, ground stiffness, where the law rests, and the parameters of the law."""
        return N_HEAD + self.law.vector.size


@dataclass(frozen=True, eq=False)
class DrivenResponse:
    """What a driven body answers.

    Args:
        travel: (n, n_interfaces) z, m.
        velocity: (n, n_interfaces) z', m/s.
        acceleration: (n, n_interfaces) x2'' of the body at the interfaces, m/s^2.
        sensitivity: (n, n_interfaces, n_parameters) derivatives of `acceleration`: by stiffness, damping, ground
            stiffness, rest and law of each interface in turn, by each direction of the accelerance, by each direction
            of the drive, and by travel, velocity, place and velocity below the suspension at the start.
    """

    travel: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    sensitivity: FloatArray


def driven_response(
    interfaces: Sequence[Interface],
    accelerance: ArrayLike,
    drive: ArrayLike,
    *,
    fs: float,
    accelerance_directions: ArrayLike | None = None,
    drive_directions: ArrayLike | None = None,
    start: ArrayLike | None = None,
    ground: bool = True,
    sensitivity: bool = True,
) -> DrivenResponse:
    """Return the response of a body to the accelerations measured below its suspensions, and its derivatives.

    Classical Runge-Kutta, one step a sample; the derivatives are those of the steps themselves, to the last digit.

    Args:
        interfaces: the suspensions.
        accelerance: (n_interfaces, n_interfaces) A, 1/kg.
        drive: (2 n - 1, n_interfaces) u at half steps, m/s^2, see `half_steps`.
        fs: samples a second, Hz.
        accelerance_directions: (n_directions, n_interfaces, n_interfaces) changes of A to differentiate by.
        drive_directions: (2 n - 1, n_directions, n_interfaces) changes of u to differentiate by.
        start: (4, n_interfaces) z, z', x1 and x1' at the first sample; zero where left out.
        ground: whether x1 is followed; if not, derivatives by ground stiffness, x1 and x1' at the start are zero.
        sensitivity: whether derivatives are wanted; if not, `sensitivity` of the response has no parameter.

    Raises:
        InputError: shapes that do not match, or a ground stiffness with ground=False.
        UnboundedResponseError: a response that grows without bound.

    >>> t = np.arange(2 * 500 - 1) / (2 * 100.0)
    >>> response = driven_response([Interface(400.0, 4.0)], [[1.0]], np.sin(t)[:, np.newaxis], fs=100.0)
    >>> response.acceleration.shape, response.sensitivity.shape
    ((500, 1), (500, 1, 8))
    """
    n = len(interfaces)
    matrix = np.ascontiguousarray(accelerance, dtype=np.float64)
    u = np.ascontiguousarray(drive, dtype=np.float64)
    first = np.zeros((4, n)) if start is None else np.ascontiguousarray(start, dtype=np.float64)
    if matrix.shape != (n, n) or u.ndim != 2 or u.shape[1] != n or u.shape[0] % 2 == 0 or first.shape != (4, n):
        raise InputError(
            f"accelerance, drive and start have shapes {matrix.shape}, {u.shape} and {first.shape}: give ({n}, {n}), "
            f"(2 n_samples - 1, {n}) and (4, {n}) for {n} interface(s)"
        )
    n_samples = u.shape[0] // 2 + 1
    # readings of zero: the innovation is what the body does, with the other sign
    nothing, exact = np.zeros((n_samples, n)), np.eye(7)[:, [1]].repeat(n, axis=1)
    states = np.concatenate([first if ground else first[:2], np.zeros((2, n))]).ravel()
    by_accelerance = directions("accelerance_directions", accelerance_directions, (0, n, n))
    _, _, changes, motion = predictor(
        joint_arrays(interfaces, ground=ground),
        matrix,
        by_accelerance,
        matrix,
        by_accelerance,
        u,
        directions("drive_directions", drive_directions, (u.shape[0], 0, n)),
        nothing,
        nothing[:, :0, np.newaxis].repeat(n, axis=2),
        1.0 / fs,
        np.zeros((states.size, states.size)),
        exact,
        ground,
        sensitivity,
    )(states)
    n_absent = 2 * n if sensitivity and not ground else 0
    by_answer = np.zeros((n, changes.shape[1] + n_absent, n_samples))
    np.negative(changes, out=by_answer[:, : changes.shape[1]])
    if not np.isfinite(motion[2, :, -1]).all() or not np.isfinite(by_answer[..., -1]).all():
        raise UnboundedResponseError("the driven response grows without bound: check stiffness and damping, and fs")
    # one signal after the other in memory, for transforms along time
    return DrivenResponse(motion[0].T, motion[1].T, motion[2].T, by_answer.transpose(2, 0, 1))


def half_steps(samples: ArrayLike) -> FloatArray:
    """Interpolate a band-limited signal at the middle between its samples (Kaiser-windowed sinc).

    Args:
        samples: (n, ...) one signal a column.

    Returns:
        (2 n - 1, ...) the samples and what lies between them.

    >>> t = np.arange(400) / 100.0
    >>> middle = half_steps(np.sin(2 * np.pi * 20 * t))[201:-201:2]
    >>> bool(np.abs(middle - np.sin(2 * np.pi * 20 * (t[100:299] + 0.005))).max() < 1e-4)
    True
    """
    from scipy import ndimage

    values = np.asarray(samples, dtype=np.float64)
    offset = np.arange(-_HALF_WIDTH, _HALF_WIDTH) + 0.5
    kernel = np.sinc(offset) * np.kaiser(offset.size, 8.6)
    doubled = np.empty((2 * values.shape[0] - 1, *values.shape[1:]))
    doubled[::2] = values
    # with an even length entry i lies between samples i and i + 1
    doubled[1::2] = ndimage.convolve1d(values, kernel / kernel.sum(), axis=0, mode="mirror")[:-1]
    return doubled


def joint_arrays(interfaces: Sequence[Interface], *, ground: bool) -> tuple[np.ndarray, ...]:
    """Return interfaces as the compiled functions take them.

    Returns:
        Stiffness, damping, ground stiffness and, with ground, stiffness at rest with that of the law,
        (n_interfaces, 4); rows, codes, number of inner values, and the rest of `opid.mechanics.kernels.LawArrays`.

    Raises:
        InputError: a ground stiffness with ground=False.
    """
    linear = np.array([[i.stiffness, i.damping, i.ground_stiffness, 0.0] for i in interfaces], dtype=np.float64)
    if not ground and linear[:, 2].any():
        raise InputError("an interface has a ground stiffness, but ground is False: set it to 0, or leave ground out")
    if ground:
        # a kind may divide zero by zero at rest before it replaces the result
        with np.errstate(all="ignore"):
            linear[:, 3] = [i.stiffness + float(i.law.gradient(0.0, 0.0)[0]) for i in interfaces]
    firsts, codes, *others = law_arrays(*(interface.law for interface in interfaces))
    n_inner = np.array([len(term.inner) for i in interfaces for term in i.law.terms], dtype=np.int64)
    return linear, firsts, codes, n_inner, *others


def directions(name: str, given: ArrayLike | None, empty: tuple[int, ...]) -> FloatArray:
    """Return changes to differentiate by as an array of the right shape.

    Args:
        name: of the argument, for the error.
        given: as many as one likes, or None.
        empty: the shape of none of them: the number 0 is that of the directions.

    Raises:
        InputError: another shape.
    """
    if given is None:
        return np.zeros(empty)
    array = np.ascontiguousarray(given, dtype=np.float64)
    if array.ndim != len(empty) or any(wanted not in (0, got) for got, wanted in zip(array.shape, empty, strict=True)):
        shape = ", ".join("n_directions" if size == 0 else str(size) for size in empty)
        raise InputError(f"{name} has shape {array.shape}: give ({shape})")
    return array
