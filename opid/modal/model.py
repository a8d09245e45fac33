"""The nonlinear modal model: it can be simulated under any force, and compared with tests that no fit has seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from opid.errors import InputError
from opid.mechanics.laws.law import LINEAR, TermSet
from opid.mechanics.response import Response, time_response
from opid.mechanics.structure import Joint, Structure
from opid.modal.couplings import Product, Reach, make_joints
from opid.modal.joint_terms import ModalJoint
from opid.modal.linear.modes import LinearModes, ModalTest, force_projection
from opid.modal.settings import MODAL, SIMULATED
from opid.signals.recording import Channel, FloatArray, Recording, recording_from_arrays
from opid.signals.resampling import resampled


@dataclass(frozen=True, eq=False)
class NonlinearModalModel:
    """Modes, some with a restoring-force law: q_j'' + c0 q_j' + k0 q_j + f_j(q_j, q_j') = f_qj (Pacini eq. 13).

    Joints that slip are added to f_j, and what the couplings of the modes give: f_j then depends on other modes, too.

    Args:
        modes: the linear part of every mode.
        laws: nonlinear restoring force by the number of the mode, counted from 1; empty for a linear model. Those of
            fits may be held beyond the tests (`hold_unstable`).
        joints: friction and slip by the number of the mode, beside its law.
        couplings: coefficients of the products by which modes drive each other.
        reach: how far the tests moved the modes whose couplings are held beyond that; None where none are.

    Raises:
        InputError: a mode that is not there.

    >>> from opid.modal.power_laws import power_law
    >>> modes = LinearModes([100.0], [0.004], [[0.5]], ("a",))
    >>> NonlinearModalModel(modes, {1: power_law({3: -1e9}, {})}).structure().joints[0].law.name
    'cubic_stiffness'
    """

    modes: LinearModes
    laws: Mapping[int, TermSet] = field(default_factory=dict)
    joints: Mapping[int, ModalJoint] = field(default_factory=dict)
    couplings: Mapping[Product, float] = field(default_factory=dict)
    reach: Reach | None = None

    def __post_init__(self) -> None:
        for mode in (*self.laws, *self.joints, *(mode for product in self.couplings for mode in product.modes)):
            self.modes.index(mode)
        for name in ("laws", "joints", "couplings"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    @property
    def linear(self) -> NonlinearModalModel:
        """The same modes without their laws."""
        return NonlinearModalModel(self.modes)

    def count_steps(self, fs: float, step_rad: float) -> int:
        """Return how many steps a simulation takes from one sample to the next.

        Args:
            fs: sampling rate, Hz.
            step_rad: largest step, in rad of the fastest mode; the steps of joints with a memory are shorter, so that
                it changes by `SIMULATED.memory_step` at most while the mode moves as far as in its tests.
        """
        omega = 2 * np.pi * self.modes.frequency_hz
        of_joints = [omega[mode - 1] * each.largest * each.quickness for mode, each in self.joints.items()]
        return max(
            1, int(np.ceil(max(omega.max() / step_rad, max(of_joints, default=0.0) / SIMULATED.memory_step) / fs))
        )

    def structure(self) -> Structure:
        """Return the model as a structure whose degrees of freedom are the modal coordinates."""
        n, stiffness = self.modes.n_modes, self.modes.stiffness()
        joints = []
        for mode in sorted({*self.laws, *self.joints}):
            law, joint = self.laws.get(mode, LINEAR), self.joints.get(mode)
            sliders = joint.sliders if joint else None
            if joint:
                stiffness[mode - 1] -= joint.stuck_stiffness
                law = TermSet((*law.terms, *joint.law.terms), law.rest_m)
            if law.terms or sliders:
                joints.append(Joint(f"mode {mode}", np.eye(n)[mode - 1], law=law, sliders=sliders))
        names = tuple(f"mode {mode + 1}" for mode in range(n))
        joints += make_joints(self.couplings, n, self.reach)
        return Structure(np.eye(n), np.diag(self.modes.damping()), np.diag(stiffness), tuple(joints), names)


@dataclass(frozen=True)
class Comparison:
    """One sensor of a truth test.

    Args:
        peak_ratio_nonlinear: largest acceleration of the nonlinear model over the measured one.
        peak_ratio_linear: largest acceleration of the linear model over the measured one.
        nrmse_nonlinear: rms of the error of the nonlinear model over the rms of the measurement.
        nrmse_linear: rms of the error of the linear model over the rms of the measurement.
    """

    peak_ratio_nonlinear: float
    peak_ratio_linear: float
    nrmse_nonlinear: float
    nrmse_linear: float


@dataclass(frozen=True, eq=False)
class TruthTest:
    """A test that no fit has seen, and the responses of the models to its force.

    Args:
        name: the name of the test.
        band_hz: the band that is compared, Hz; None for all frequencies.
        measured: measured accelerations at the sensors, m/s^2, and second derivatives of strains, strain/s^2.
        nonlinear: accelerations of the nonlinear modal model, with the same channels, in the same units.
        linear: accelerations of the linear model, with the same channels, in the same units.
        sensors: the comparison at each sensor, by its name.
    """

    name: str
    band_hz: tuple[float, float] | None
    measured: Recording
    nonlinear: Recording
    linear: Recording
    sensors: Mapping[str, Comparison]

    @property
    def worst_sensors(self) -> list[str]:
        """The sensors that were compared, the one with the largest error of the nonlinear model first."""
        return sorted(self.sensors, key=lambda name: -self.sensors[name].nrmse_nonlinear)

    def as_json(self) -> dict[str, Any]:
        """Return the comparison as result.json holds it."""
        sensors = {name: asdict(each) for name, each in self.sensors.items()}
        return {"name": self.name, "band_hz": self.band_hz, "sensors": sensors}


def simulate(
    model: NonlinearModalModel,
    force: ArrayLike,
    *,
    fs: float,
    drive_point: str | Sequence[str],
    displacement: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
) -> Recording:
    """Return the accelerations at the sensors under a force on one of them, or under several forces.

    Args:
        model: the model.
        force: (n,) force, N, taken as band-limited between its samples; of several drive points (n, n_forces), one
            column for each.
        fs: sampling rate, Hz.
        drive_point: name of the sensor where and in whose direction the force acts; one name for each of several.
        displacement: (n_modes,) modal displacement at the first sample, m kg^1/2; zero where left out.
        velocity: (n_modes,) modal velocity at the first sample, m/s kg^1/2; zero where left out.

    Returns:
        Channels with the names and the units of the sensors, m/s^2, or strain/s^2 at strain gauges.

    Raises:
        InputError: no such sensor or a strain gauge as drive point, a force that is not a series of finite numbers or
            has not one column for each drive point, an initial condition that has not one number for each mode, or a
            response that grows without bound.

    >>> modes = LinearModes([100.0], [0.004], [[0.5]], ("a",))
    >>> response = simulate(NonlinearModalModel(modes), np.sin(np.arange(256) / 4), fs=1024.0, drive_point="a")
    >>> response.names, response.n_samples
    (('a',), 256)
    """
    motion = modal_response(model, force, fs=fs, drive_point=drive_point, displacement=displacement, velocity=velocity)
    accelerations = motion.acceleration @ model.modes.shapes.T
    channels = tuple(map(Channel, model.modes.sensors, model.modes.units))
    return Recording(accelerations, fs=fs, channels=channels, history=("simulated by a modal model",))


def modal_response(
    model: NonlinearModalModel,
    force: ArrayLike,
    *,
    fs: float,
    drive_point: str | Sequence[str],
    displacement: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
) -> Response:
    """Return the motion of the modal coordinates, m kg^1/2, under forces on some of the sensors.

    Arguments and errors are those of `simulate`: `model`, `force`, `fs`, `drive_point`, `displacement`, `velocity`.
    """
    points = (drive_point,) if isinstance(drive_point, str) else tuple(drive_point)
    series = np.asarray(force, dtype=np.float64)
    if isinstance(drive_point, str) and series.ndim == 1:
        series = series[:, None]
    if series.ndim != 2 or series.shape[1] != len(points) or len(series) < 2 or not np.isfinite(series).all():
        needed = "one series" if len(points) == 1 else f"one column for each of {len(points)} drive points, a series"
        raise InputError(f"the force has shape {np.shape(force)}: give {needed} of finite numbers, in N")
    loads = np.stack([force_projection(model.modes, point) for point in points], axis=1)
    # With steps of at most 0.1 rad of the fastest mode, Runge-Kutta keeps its frequency to 1e-6.
    steps = model.count_steps(fs, 0.1)
    names = [f"force {number + 1}" for number in range(len(points))]
    between = resampled(recording_from_arrays(list(series.T), names, fs=fs, unit="N"), 2 * steps * fs)
    n_half_steps = 2 * (len(series) - 1) * steps + 1
    return time_response(
        model.structure(),
        between.samples[:n_half_steps],
        fs=fs,
        duration_s=len(series) / fs,
        initial_displacement=displacement,
        initial_velocity=velocity,
        loads=loads,
        steps_per_sample=steps,
    )


def truth_test(
    model: NonlinearModalModel,
    test: ModalTest,
    *,
    displacement: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
) -> TruthTest:
    """Return measured, nonlinear and linear accelerations side by side, with peak ratio and NRMSE for each sensor.

    The measured forces drive both models. All three are compared from 0.3 times the lowest to 1.25 times the highest
    natural frequency of elastic modes. NRMSE is the rms of the error over the rms of the measurement.

    Args:
        model: the nonlinear modal model; the linear model has the modes of the test as they were given.
        test: a test with one force or several.
        displacement: (n_modes,) modal displacement at the first sample, m kg^1/2; zero where left out.
        velocity: (n_modes,) modal velocity at the first sample, m/s kg^1/2; zero where left out.

    Raises:
        InputError: a test without a force, an initial condition that has not one number for each mode, or a nonlinear
            model that grows without bound under the force.
    """
    if not test.forces:
        raise InputError(
            f"test {test.name!r} has no force: a truth test needs the force that drives both models, name its channel"
        )
    given = NonlinearModalModel(test.modes)
    sensors = list(test.sensors)
    forces = np.stack([each.samples for each in test.forces], axis=1)
    drive: Any = {
        "fs": test.fs,
        "drive_point": test.drive_points,
        "displacement": displacement,
        "velocity": velocity,
    }
    linear = simulate(given, forces, **drive)
    try:
        nonlinear = simulate(model, forces, **drive)
    except InputError as error:
        raise InputError(
            f"under the force of test {test.name!r} the nonlinear model is unstable: its polynomials were fitted at "
            f"lower amplitudes; fit tests of this level, or lower the orders ({error})"
        ) from error
    # Above the band modes move that the models lack; below it sensors have offset and drift.
    top = MODAL.above_modes * float(test.modes.frequency_hz.max())
    elastic = test.modes.frequency_hz[test.modes.elastic]
    low = MODAL.below_modes * float(elastic.min()) if elastic.size else 0.0
    band = (low, min(top, 0.5 * test.fs))
    measured, nonlinear, linear = (_filter(each, sensors, band) for each in (test.recording, nonlinear, linear))
    dead = [sensor for sensor in sensors if not measured.channel(sensor).any()]
    if dead:
        raise InputError(f"sensor {dead[0]!r} of test {test.name!r} is zero throughout: leave its channel out")
    comparisons = {
        sensor: compare_models(measured.channel(sensor), nonlinear.channel(sensor), linear.channel(sensor))
        for sensor in sensors
    }
    return TruthTest(test.name, band, measured, nonlinear, linear, comparisons)


def compare_models(measured: FloatArray, nonlinear: FloatArray, linear: FloatArray) -> Comparison:
    """Return peak ratios and NRMSE of two models.

    >>> compare_models(np.array([1.0, -2.0]), np.array([1.0, -2.0]), np.array([2.0, -4.0]))
    Comparison(peak_ratio_nonlinear=1.0, peak_ratio_linear=2.0, nrmse_nonlinear=0.0, nrmse_linear=1.0)
    """
    peak, rms = float(np.abs(measured).max()), float(np.sqrt(np.mean(measured**2)))
    return Comparison(
        *(float(np.abs(each).max()) / peak for each in (nonlinear, linear)),
        *(float(np.sqrt(np.mean((each - measured) ** 2))) / rms for each in (nonlinear, linear)),
    )


def _filter(recording: Recording, sensors: list[str], band_hz: tuple[float, float]) -> Recording:
    samples = recording.samples[:, [recording.index(sensor) for sensor in sensors]]
    spectrum = fft.rfft(samples, axis=0)
    frequency = fft.rfftfreq(len(samples), 1 / recording.fs)
    spectrum[(frequency < band_hz[0]) | (frequency > band_hz[1])] = 0.0
    samples = fft.irfft(spectrum, len(samples), axis=0)
    channels = tuple(recording.channels[recording.index(sensor)] for sensor in sensors)
    return replace(recording, samples=samples, channels=channels)
