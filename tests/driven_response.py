"""The response of a driven body to an exact drive: `predict` with sensors without noise, which correct nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.mechanics.driven import Interface, Noise, predict
from opid.mechanics.laws.law import FloatArray


@dataclass(frozen=True, eq=False)
class DrivenResponse:
    """The response of a driven body and its derivatives.

    Args:
        travel: (n, n_interfaces) z, m.
        velocity: (n, n_interfaces) z', m/s.
        acceleration: (n, n_interfaces) x2'' of the body at the interfaces, m/s^2.
        sensitivity: (n, n_interfaces, n_parameters) derivatives of `acceleration`: by stiffness, damping, ground
            stiffness, rest position and law of each interface in turn, by each direction of the accelerance, by each
            direction of the drive, and by travel and velocity, position and velocity below the suspension at the start.
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

    The method is classical Runge-Kutta, one step for each sample; the derivatives are those of the steps themselves, to
    the last digit.

    Args:
        interfaces: the suspensions.
        accelerance: (n_interfaces, n_interfaces) A, 1/kg.
        drive: (2 n - 1, n_interfaces) u at half steps, m/s^2, see `half_steps`.
        fs: sampling rate, Hz.
        accelerance_directions: (n_directions, n_interfaces, n_interfaces) changes of A, directions of differentiation.
        drive_directions: (2 n - 1, n_directions, n_interfaces) changes of u, directions of differentiation.
        start: (4, n_interfaces) z, z', x1 and x1' at the first sample; zero where left out.
        ground: whether x1 is followed; if not, derivatives by ground stiffness, x1 and x1' at the start are zero.
        sensitivity: whether derivatives are wanted; if not, `sensitivity` of the response has no parameter.

    Raises:
        InputError: shapes that do not match, or a ground stiffness with ground=False.
        UnboundedResponseError: a response that grows without bound.
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
    # Exact sensors correct nothing, and for readings of zero the innovation is the negative acceleration of the body.
    states = np.concatenate([first if ground else first[:2], np.zeros((2, n))])
    found = predict(
        interfaces,
        matrix,
        u,
        np.zeros((u.shape[0] // 2 + 1, n)),
        fs=fs,
        noise=Noise(drive=0.0, measured=1.0),
        start=states,
        start_covariance=np.zeros((states.size, states.size)),
        accelerance_directions=accelerance_directions,
        drive_directions=drive_directions,
        ground=ground,
        sensitivity=sensitivity,
    )
    n_known = found.sensitivity.shape[1]
    by_answer = np.zeros((n, n_known + (2 * n if sensitivity and not ground else 0), len(found.acceleration)))
    np.negative(found.sensitivity, out=by_answer[:, :n_known])
    # The signals lie one after the other in memory, for transforms along time.
    return DrivenResponse(found.travel, found.velocity, found.acceleration, by_answer.transpose(2, 0, 1))
