"""Predict what the sensors on a driven body read next, from all that they read before.

The measured acceleration below each suspension drives the body (`opid.mechanics.driven`), and it is noisy: simulated
freely, the model carries that noise along, more so where a law is stiff, a ground spring takes part or an AC coupling
was undone. Here every reading on the body corrects the simulated motion, by as much as the noise of the sensors allows
(a Kalman filter about the nonlinear trajectory). What is left, the innovation, is white for the true model whatever
the law: least squares over it is maximum likelihood (Ljung 1999, System Identification, sections 3.2 and 7.4).

No acceleration is integrated without a restoring force, and with exact sensors nothing is corrected at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.mechanics.driven import Interface, UnboundedResponseError, directions, joint_arrays
from opid.mechanics.kernels import predictor
from opid.mechanics.laws.law import FloatArray


@dataclass(frozen=True)
class Noise:
    """Noise of the sensors below and on the body, one number for all interfaces or one for each.

    Args:
        drive: rms of the white noise on the drive, m/s^2.
        measured: rms of the white noise on the readings of the body, m/s^2.
        drive_walk: what the offset of the drive walks in a sample, rms m/s^2.
        measured_walk: what the offset of the readings walks in a sample, rms m/s^2.
        motion: rms of a white noise on z'' alone, m/s^2: what moves the suspensions and neither the sensors below nor
            the ground.
        unmeasured: rms acceleration of the body by forces that nobody measured, m/s^2, a process of first order; 0 for
            none.
        unmeasured_corner_hz: above this frequency its spectral density falls, Hz.
    """

    drive: float | Sequence[float]
    measured: float | Sequence[float]
    drive_walk: float | Sequence[float] = 0.0
    measured_walk: float | Sequence[float] = 0.0
    motion: float | Sequence[float] = 0.0
    unmeasured: float | Sequence[float] = 0.0
    unmeasured_corner_hz: float | Sequence[float] = 10.0

    def table(self, n: int) -> FloatArray:
        """(7, n) the rows as the predictor takes them: the last is a rate, 1/s."""
        rate = 2 * np.pi * np.asarray(self.unmeasured_corner_hz, dtype=np.float64)
        rows = (
            self.drive,
            self.measured,
            self.drive_walk,
            self.measured_walk,
            self.motion,
            self.unmeasured,
            rate,
        )
        table = np.empty((len(rows), n))
        for number, row in enumerate(rows):
            table[number] = row
        return table


@dataclass(frozen=True, eq=False)
class Prediction:
    """What was predicted of each sample from the ones before it.

    Args:
        innovation: (n_interfaces, n) reading less prediction over its standard deviation: white of unit variance for
            the true model and noise.
        spread: (n_interfaces, n) that standard deviation, m/s^2.
        sensitivity: (n_interfaces, n_parameters, n) derivatives of `innovation`: by stiffness, damping, ground
            stiffness, rest and law of each interface in turn, by each direction of the accelerance, of the drive and of
            the readings, and by travel, velocity (and, with ground, place and velocity below the suspension) at the
            start, those by ground stiffness zero without ground; no parameters if not asked for.
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
        fs: samples a second, Hz.
        noise: of the sensors.
        start: (6 or 4, n_interfaces) rows z, z', [x1, x1'], offset of the drive and of the readings at the first
            sample; the two in brackets, place and velocity below the suspension, with `ground` only.
        start_covariance: (6 n_interfaces or 4 n_interfaces, the same) of these, row by row.
        accelerance_directions: (n_directions, n_interfaces, n_interfaces) changes of A to differentiate by.
        reading: (n_interfaces, n_interfaces) R, 1/kg: the sensor of a row reads -R F of the forces of the interfaces,
            for one that is not at its interface; A where left out.
        reading_directions: (n_directions, n_interfaces, n_interfaces) what the same changes do to R; those of A where
            left out.
        drive_directions: (2 n - 1, n_directions, n_interfaces) changes of the drive to differentiate by.
        measured_directions: (n, n_directions, n_interfaces) changes of the readings to differentiate by.
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
    by_accelerance = directions("accelerance_directions", accelerance_directions, (0, n, n))
    by_reading = (
        by_accelerance
        if reading_directions is None
        else directions("reading_directions", reading_directions, (0, n, n))
    )
    if seen.shape != (n, n) or by_reading.shape != by_accelerance.shape:
        raise InputError(
            f"reading and its directions have shapes {seen.shape} and {by_reading.shape}: give {(n, n)} and "
            f"{by_accelerance.shape}, as of the accelerance"
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
        by_accelerance,
        seen,
        by_reading,
        u,
        directions("drive_directions", drive_directions, (u.shape[0], 0, n)),
        y,
        directions("measured_directions", measured_directions, (y.shape[0], 0, n)),
        1.0 / fs,
        covariance,
        noise.table(n),
        ground,
        sensitivity,
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
    """Return minus twice the log likelihood of the readings of a gear for each of some starts, up to a constant.

    Args:
        interface: the suspension.
        accelerance: (1, 1) A, 1/kg.
        drive: (2 n - 1, 1) acceleration below it at half steps, m/s^2.
        measured: (n, 1) acceleration of the body, m/s^2.
        fs: samples a second, Hz.
        noise: of the sensors.
        starts: (6 or 4, 1) each, as of `predict`.
        start_covariance: of each of them.
        ground: whether a spring acts between body and ground.

    Returns:
        Infinite where the motion grows without bound.
    """
    none = np.zeros((0, 1, 1))
    predictions = predictor(
        joint_arrays([interface], ground=ground),
        accelerance,
        none,
        accelerance,
        none,
        np.ascontiguousarray(drive),
        np.zeros((len(drive), 0, 1)),
        np.ascontiguousarray(measured),
        np.zeros((len(measured), 0, 1)),
        1.0 / fs,
        start_covariance,
        noise.table(1),
        ground,
        False,
    )
    found = []
    for start in starts:
        innovation, spread, _, _ = predictions(start.ravel())
        misfit = float(np.sum(innovation**2) + 2 * np.sum(np.log(spread)))
        found.append(misfit if np.isfinite(misfit) else np.inf)
    return found
