"""The nonlinear modal model as a value that simulates itself: all modes, any force, accelerations at the sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.mechanics.laws.law import Law
from opid.mechanics.response import Response, time_response
from opid.mechanics.structure import Joint, Structure
from opid.modal.linear.modes import LinearModes, force_projection
from opid.signals.recording import Channel, Recording, recording_from_arrays
from opid.signals.resampling import resampled

LARGEST_ANGLE = 0.1
"""Of a time step at the highest natural frequency, rad: Runge-Kutta is then right to 1e-6 of the frequency."""


@dataclass(frozen=True, eq=False)
class NonlinearModalModel:
    """Modes, some with a restoring-force law: q_j'' + c0 q_j' + k0 q_j + f_j(q_j, q_j') = f_qj (Pacini eq. 13).

    Args:
        modes: the linear part of every mode.
        laws: nonlinear restoring force by the number of the mode, counted from 1; none for a linear model.

    Raises:
        InputError: a mode that is not there.

    >>> from opid.modal.power_laws import power_law
    >>> modes = LinearModes([100.0], [0.004], [[0.5]], ("a",))
    >>> NonlinearModalModel(modes, {1: power_law({3: -1e9}, {})}).structure().joints[0].law.name
    'cubic_stiffness'
    """

    modes: LinearModes
    laws: Mapping[int, Law] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for mode in self.laws:
            self.modes.index(mode)
        object.__setattr__(self, "laws", MappingProxyType(dict(self.laws)))

    @property
    def linear(self) -> NonlinearModalModel:
        """The same modes without their laws."""
        return replace(self, laws={})

    def structure(self) -> Structure:
        """The model as a structure whose degrees of freedom are the modal coordinates."""
        n = self.modes.n_modes
        joints = tuple(
            Joint(f"mode {mode}", np.eye(n)[mode - 1], law=law) for mode, law in sorted(self.laws.items()) if law.terms
        )
        names = tuple(f"mode {mode + 1}" for mode in range(n))
        return Structure(np.eye(n), np.diag(self.modes.damping()), np.diag(self.modes.stiffness()), joints, names)


def simulate(model: NonlinearModalModel, force: ArrayLike, *, fs: float, drive_point: str) -> Recording:
    """Return the accelerations at the sensors under a force on one of them.

    Args:
        model: the model.
        force: (n,) force, N, taken for band-limited between its samples; at rest before the first.
        fs: sampling rate, Hz.
        drive_point: name of the sensor at whose place and in whose direction the force acts.

    Returns:
        Channels named as the sensors, m/s^2.

    Raises:
        InputError: no such sensor, a force that is no series of finite numbers, or a response that grows without bound.

    >>> modes = LinearModes([100.0], [0.004], [[0.5]], ("a",))
    >>> response = simulate(NonlinearModalModel(modes), np.sin(np.arange(256) / 4), fs=1024.0, drive_point="a")
    >>> response.names, response.n_samples
    (('a',), 256)
    """
    motion = modal_response(model, force, fs=fs, drive_point=drive_point)
    accelerations = motion.acceleration @ model.modes.shapes.T
    channels = tuple(Channel(name, "m/s^2") for name in model.modes.sensors)
    return Recording(accelerations, fs=fs, channels=channels, history=("simulated by a modal model",))


def modal_response(model: NonlinearModalModel, force: ArrayLike, *, fs: float, drive_point: str) -> Response:
    """Return the motion of the modal coordinates, m kg^1/2, under a force on one of the sensors.

    Args:
        model: the model.
        force: (n,) force, N.
        fs: sampling rate, Hz.
        drive_point: name of the sensor at whose place and in whose direction the force acts.

    Raises:
        InputError: as `simulate`.
    """
    series = np.asarray(force, dtype=np.float64)
    if series.ndim != 1 or series.size < 2 or not np.isfinite(series).all():
        raise InputError(f"the force has shape {series.shape}: give one series of finite numbers, in N")
    loads = force_projection(model.modes, drive_point)[:, None]
    steps = steps_per_sample(model.modes.frequency_hz.max(), fs)
    between = resampled(recording_from_arrays([series], ["force"], fs=fs, unit="N"), 2 * steps * fs)
    n_half_steps = 2 * (series.size - 1) * steps + 1
    return time_response(
        model.structure(),
        between.samples[:n_half_steps],
        fs=fs,
        duration_s=series.size / fs,
        loads=loads,
        steps_per_sample=steps,
    )


def steps_per_sample(highest_hz: float, fs: float) -> int:
    """Return the number of time steps between two samples that the highest mode needs.

    Args:
        highest_hz: its natural frequency, Hz.
        fs: sampling rate, Hz.

    >>> steps_per_sample(100.0, 1000.0)
    7
    """
    return max(1, int(np.ceil(2 * np.pi * highest_hz / fs / LARGEST_ANGLE)))
