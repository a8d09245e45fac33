"""A body on suspensions whose unsprung sides are measured: its response, and the prediction of its sensors.

The ground is unknown. Below each suspension (interface) an accelerometer gives u = x1''; the relative motion
z = x2 - x1 of each interface then obeys

    z'' = -A F - u,    F_i = K_i z_i + C_i z_i' + f_i(z_i, z_i') + G_i x2_i,    x2'' = -A F,

A = J M^-1 J^T the accelerance of the free body at the interfaces. A gear alone is the smallest case, A = 1/M2. The
measured acceleration is never integrated: it drives a damped system, so nothing drifts.

The measured acceleration is noisy. A free simulation carries that noise along, more so where a law is stiff, where a
ground spring takes part, or where an AC coupling was undone. `predict` therefore corrects the motion
by every reading on the body, by as much as the noise of the sensors allows: it is a Kalman filter about the nonlinear
trajectory. The remainder, the innovation, is white for the true model, whatever the law is, and least squares over it
are maximum likelihood (Ljung 1999, System Identification, sections 3.2 and 7.4). With an exact drive and a
known start there is no correction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.kernels import law_arrays, predictor
from opid.mechanics.laws.law import LINEAR, FloatArray, TermSet

N_HEAD = 4
"""Number of parameters of an interface before those of its law: stiffness, damping, ground stiffness, rest position."""


class UnboundedResponseError(NotDeterminedError):
    """A driven body whose motion grows without bound, which no recorded suspension does."""


@dataclass(frozen=True)
class Interface:
    """One suspension between a measured unsprung side and the body.

    Args:
        stiffness: stiffness K, N/m.
        damping: damping C, N s/m.
        ground_stiffness: stiffness G of a spring from the body to the ground at this interface, N/m.
        law: law f(z, z'), N, with its position at rest.
    """

    stiffness: float
    damping: float
    ground_stiffness: float = 0.0
    law: TermSet = LINEAR

    @property
    def n_parameters(self) -> int:
        """Number of parameters: stiffness, damping, ground stiffness, rest position, and those of the law."""
        return N_HEAD + self.law.vector.size


def half_steps(samples: ArrayLike) -> FloatArray:
    """Interpolate a band-limited signal at the middle between its samples (Kaiser-windowed sinc).

    Args:
        samples: (n, ...) signals, one for each column.

    Returns:
        (2 n - 1, ...) the samples and the values between them.

    >>> t = np.arange(400) / 100.0
    >>> middle = half_steps(np.sin(2 * np.pi * 20 * t))[201:-201:2]
    >>> bool(np.abs(middle - np.sin(2 * np.pi * 20 * (t[100:299] + 0.005))).max() < 1e-4)
    True
    """
    from scipy import ndimage

    values = np.asarray(samples, dtype=np.float64)
    # With a Kaiser window of 8.6 a kernel longer than 32 samples on each side has no advantage.
    offset = np.arange(-32, 32) + 0.5
    kernel = np.sinc(offset) * np.kaiser(offset.size, 8.6)
    doubled = np.empty((2 * values.shape[0] - 1, *values.shape[1:]))
    doubled[::2] = values
    # With an even length entry i lies between samples i and i + 1.
    doubled[1::2] = ndimage.convolve1d(values, kernel / kernel.sum(), axis=0, mode="mirror")[:-1]
    return doubled


def joint_arrays(interfaces: Sequence[Interface], *, ground: bool) -> tuple[np.ndarray, ...]:
    """Return interfaces in the form that the compiled functions take.

    First come stiffness, damping, ground stiffness and, with ground, stiffness at rest including that of the law,
    (n_interfaces, 4); then rows, codes, number of inner values, and the other fields of `LawArrays`.

    Raises:
        InputError: a ground stiffness with ground=False.
    """
    linear = np.array([[i.stiffness, i.damping, i.ground_stiffness, 0.0] for i in interfaces], dtype=np.float64)
    if not ground and linear[:, 2].any():
        raise InputError("an interface has a ground stiffness, but ground is False: set it to 0, or leave ground out")
    if ground:
        # A kind may divide zero by zero at rest before it replaces the result.
        with np.errstate(all="ignore"):
            linear[:, 3] = [i.stiffness + float(i.law.gradient(0.0, 0.0)[0]) for i in interfaces]
    firsts, codes, *others = law_arrays(*(interface.law for interface in interfaces))
    n_inner = np.array([len(term.inner) for i in interfaces for term in i.law.terms], dtype=np.int64)
    return linear, firsts, codes, n_inner, *others


def read_directions(name: str, given: ArrayLike | None, empty: tuple[int, ...]) -> FloatArray:
    """Return directions of differentiation as an array; `empty` is its shape without any, 0 for their number.

    Raises:
        InputError: the argument called `name` has another shape.
    """
    if given is None:
        return np.zeros(empty)
    array = np.ascontiguousarray(given, dtype=np.float64)
    if array.ndim != len(empty) or any(wanted not in (0, got) for got, wanted in zip(array.shape, empty, strict=True)):
        shape = ", ".join("n_directions" if size == 0 else str(size) for size in empty)
        raise InputError(f"{name} has shape {array.shape}: give ({shape})")
    return array


@dataclass(frozen=True)
class Noise:
    """Noise of the sensors below and on the body, one number for all interfaces or one for each.

    Args:
        drive: rms of the white noise on the drive, m/s^2.
        measured: rms of the white noise on the readings of the body, m/s^2.
        drive_walk: rms step of the drive's offset, a random walk, from sample to sample, m/s^2.
        measured_walk: rms step of the readings' offset, a random walk, from sample to sample, m/s^2.
        motion: rms of a white noise on z'' alone, m/s^2, which neither the sensors below nor the ground show.
        unmeasured: rms acceleration of the body by forces that no sensor measured, m/s^2, a process of first order; 0
            if there are none.
        unmeasured_corner_hz: frequency above which its spectral density falls, Hz.
    """

    drive: float | Sequence[float]
    measured: float | Sequence[float]
    drive_walk: float | Sequence[float] = 0.0
    measured_walk: float | Sequence[float] = 0.0
    motion: float | Sequence[float] = 0.0
    unmeasured: float | Sequence[float] = 0.0
    unmeasured_corner_hz: float | Sequence[float] = 10.0

    def table(self, n: int) -> FloatArray:
        """(7, n) rows in the form that the predictor takes; the last is a rate, 1/s."""
        rows = (self.drive, self.measured, self.drive_walk, self.measured_walk, self.motion, self.unmeasured)
        rate = 2 * np.pi * np.asarray(self.unmeasured_corner_hz, dtype=np.float64)
        return np.stack([np.broadcast_to(row, n) for row in (*rows, rate)]).astype(np.float64)


@dataclass(frozen=True, eq=False)
class Prediction:
    """The prediction of each sample from the ones before it.

    Args:
        innovation: (n_interfaces, n) reading less prediction, over its standard deviation; it is white with unit
            variance for the true model and noise.
        spread: (n_interfaces, n) standard deviation of reading less prediction, m/s^2.
        sensitivity: (n_interfaces, n_parameters, n) derivatives of `innovation`: by stiffness, damping, ground
            stiffness, rest position and law of each interface in turn, by each direction of the accelerance, of the
            drive and of the readings, and by travel, velocity (and, with ground, position and velocity below the
            suspension) at the start. Without ground those by ground stiffness are zero. There are no parameters if no
            derivatives are wanted.
        travel: (n, n_interfaces) z, m.
        velocity: (n, n_interfaces) z', m/s.
        acceleration: (n, n_interfaces) predicted x2'' of the body at its sensors, m/s^2.
    """

    innovation: FloatArray
    spread: FloatArray
    sensitivity: FloatArray
    travel: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


def predict(
    interfaces: Sequence[Interface],
    accelerance: ArrayLike,
    drive: ArrayLike,
    measured: ArrayLike,
    *,
    fs: float,
    noise: Noise,
    start: ArrayLike,
    start_covariance: ArrayLike,
    accelerance_directions: ArrayLike | None = None,
    reading: ArrayLike | None = None,
    reading_directions: ArrayLike | None = None,
    reading_of_travel: ArrayLike | None = None,
    drive_directions: ArrayLike | None = None,
    measured_directions: ArrayLike | None = None,
    ground: bool = False,
    sensitivity: bool = True,
) -> Prediction:
    """Return the innovations of a body driven by the accelerations measured below its suspensions.

    Args:
        interfaces: the suspensions.
        accelerance: (n_interfaces, n_interfaces) A, 1/kg.
        drive: (2 n - 1, n_interfaces) acceleration below each suspension at half steps, m/s^2.
        measured: (n, n_interfaces) acceleration of the body as the sensor of each interface reads it, m/s^2.
        fs: sampling rate, Hz.
        noise: noise of the sensors.
        start: (6 or 4, n_interfaces) rows z, z', [x1, x1'], offset of the drive and of the readings at the first
            sample; the two in brackets, position and velocity below the suspension, with `ground` only.
        start_covariance: (6 n_interfaces or 4 n_interfaces, the same) covariance of these, row by row.
        accelerance_directions: (n_directions, n_interfaces, n_interfaces) changes of A, directions of differentiation.
        reading: (n_interfaces, n_interfaces) R, 1/kg, for sensors that are not at their interfaces: the forces F of the
            interfaces make them read -R F; A where left out.
        reading_directions: (n_directions, n_interfaces, n_interfaces) changes of R that go with those of A; those of A
            where left out.
        reading_of_travel: (n_interfaces, n_interfaces) S, 1/s^2, for sensors of the travel, which read S z; zero where
            left out.
        drive_directions: (2 n - 1, n_directions, n_interfaces) changes of the drive, directions of differentiation.
        measured_directions: (n, n_directions, n_interfaces) changes of the readings, directions of differentiation.
        ground: whether a spring acts between body and ground, which needs the body's own displacement.
        sensitivity: whether derivatives are wanted.

    Raises:
        InputError: shapes that do not match, or a ground stiffness with ground=False.
        UnboundedResponseError: a motion that grows without bound.

    >>> rng = np.random.default_rng(0)
    >>> readings = 0.01 * rng.standard_normal((500, 1))
    >>> still = predict([Interface(400.0, 4.0)], [[1.0]], np.zeros((999, 1)), readings, fs=100.0,
    ...                 noise=Noise(0.0, 0.01), start=np.zeros((4, 1)), start_covariance=np.zeros((4, 4)))
    >>> bool(np.allclose(still.innovation[0], readings[:, 0] / 0.01)), still.sensitivity.shape
    (True, (1, 6, 500))
    """
    n = len(interfaces)
    matrix, u, y, first, covariance = (
        np.array(array, dtype=np.float64, order="C")
        for array in (accelerance, drive, measured, start, start_covariance)
    )
    rows = 6 if ground else 4
    seen = matrix if reading is None else np.ascontiguousarray(reading, dtype=np.float64)
    by_accelerance = read_directions("accelerance_directions", accelerance_directions, (0, n, n))
    by_reading = (
        by_accelerance
        if reading_directions is None
        else read_directions("reading_directions", reading_directions, (0, n, n))
    )
    if seen.shape != (n, n) or by_reading.shape != by_accelerance.shape:
        raise InputError(
            f"reading and its directions have shapes {seen.shape} and {by_reading.shape}: give {(n, n)} and "
            f"{by_accelerance.shape}, as for the accelerance"
        )
    shapes = (matrix.shape, u.shape, y.shape, first.shape, covariance.shape)
    needed = ((n, n), (2 * y.shape[0] - 1, n), (y.shape[0], n), (rows, n), (rows * n, rows * n))
    if shapes != needed:
        raise InputError(
            f"accelerance, drive, measured, start and start_covariance have shapes {', '.join(map(str, shapes))}: give "
            f"{', '.join(map(str, needed))} for {n} interface(s)"
        )
    innovation, spread, changes, motion = predictor(
        joint_arrays(interfaces, ground=ground),
        matrix,
        u,
        y,
        step_s=1.0 / fs,
        covariance_start=covariance,
        noise=noise.table(n),
        ground=ground,
        sensitivity=sensitivity,
        reading=seen,
        by_mass=by_accelerance,
        by_reading=by_reading,
        of_travel=np.zeros((n, n))
        if reading_of_travel is None
        else np.ascontiguousarray(reading_of_travel, dtype=float),
        by_drive=read_directions("drive_directions", drive_directions, (u.shape[0], 0, n)),
        by_measured=read_directions("measured_directions", measured_directions, (y.shape[0], 0, n)),
    )(first.ravel())
    if not (np.isfinite(innovation[:, -1]).all() and np.isfinite(changes[..., -1]).all()):
        raise UnboundedResponseError("the driven response grows without bound: check stiffness and damping, and fs")
    return Prediction(innovation, spread, changes, motion[0].T, motion[1].T, motion[2].T)


def misfits_of_starts(
    interface: Interface,
    accelerance: FloatArray,
    drive: FloatArray,
    measured: FloatArray,
    *,
    fs: float,
    noise: Noise,
    starts: Sequence[FloatArray],
    start_covariance: FloatArray,
    ground: bool,
) -> list[float]:
    """Return minus twice the log likelihood of the readings of a gear for each of several starts, up to a constant.

    It is infinite where the motion grows without bound. `accelerance`, `drive`, `measured`, `fs`, `noise`, `ground`,
    each of the `starts` and its `start_covariance` are those of `predict` for one interface.
    """
    predictions = predictor(
        joint_arrays([interface], ground=ground),
        accelerance,
        np.ascontiguousarray(drive),
        np.ascontiguousarray(measured),
        step_s=1.0 / fs,
        covariance_start=start_covariance,
        noise=noise.table(1),
        ground=ground,
        sensitivity=False,
    )
    found = []
    for start in starts:
        innovation, spread, _, _ = predictions(start.ravel())
        misfit = float(np.sum(innovation**2) + 2 * np.sum(np.log(spread)))
        found.append(misfit if np.isfinite(misfit) else np.inf)
    return found
