"""The truth test: what the nonlinear and the linear model make of a measured force, beside the measured motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import fft

from opid.errors import InputError
from opid.modal.linear.modes import ModalTest
from opid.modal.model import NonlinearModalModel, simulate
from opid.modal.result import Comparison, TruthTest
from opid.signals.recording import FloatArray, Recording

ABOVE_MODES = 1.25
"""Times the highest natural frequency: what is faster belongs to modes that the models do not have."""

BELOW_MODES = 0.3
"""Times the lowest elastic one: what is slower is offset and drift of the sensors."""


def truth_test(model: NonlinearModalModel, test: ModalTest) -> TruthTest:
    """Return measured, nonlinear and linear accelerations side by side, with peak ratio and NRMSE a sensor.

    Both models are driven by the measured force. All three are compared from 0.3 times
    the lowest to 1.25 times the highest natural frequency of elastic modes.
    NRMSE is the rms of the error over the rms of the measurement.

    Args:
        model: the nonlinear modal model; its linear twin has the modes of the test as they were given.
        test: with a force.

    Raises:
        InputError: a test without a force, or a nonlinear model that grows without bound under it.
    """
    if test.force is None or test.drive_point is None:
        raise InputError(
            f"test {test.name!r} has no force: a truth test needs the force that both models are driven by"
        )
    given = NonlinearModalModel(test.modes)
    sensors = [sensor for sensor in test.modes.sensors if sensor in test.recording.names]
    try:
        nonlinear = simulate(model, test.force, fs=test.fs, drive_point=test.drive_point)
    except InputError as error:
        raise InputError(
            f"under the force of test {test.name!r} the nonlinear model is unstable: its polynomials were fitted at "
            f"lower amplitudes; fit tests of this level, or lower the orders ({error})"
        ) from error
    linear = simulate(given, test.force, fs=test.fs, drive_point=test.drive_point)
    top = ABOVE_MODES * float(test.modes.frequency_hz.max())
    elastic = test.modes.frequency_hz[test.modes.elastic]
    low = BELOW_MODES * float(elastic.min()) if elastic.size else 0.0
    band = (low, min(top, 0.5 * test.fs))
    measured, nonlinear, linear = (_kept(each, sensors, band) for each in (test.recording, nonlinear, linear))
    dead = [sensor for sensor in sensors if not measured.channel(sensor).any()]
    if dead:
        raise InputError(f"sensor {dead[0]!r} of test {test.name!r} is zero throughout: leave its channel out")
    comparisons = {
        sensor: comparison(measured.channel(sensor), nonlinear.channel(sensor), linear.channel(sensor))
        for sensor in sensors
    }
    return TruthTest(test.name, band, measured, nonlinear, linear, comparisons)


def comparison(measured: FloatArray, nonlinear: FloatArray, linear: FloatArray) -> Comparison:
    """Return peak ratios and NRMSE of two models.

    Args:
        measured: (n,) m/s^2.
        nonlinear: (n,) of the nonlinear model.
        linear: (n,) of the linear model.

    >>> comparison(np.array([1.0, -2.0]), np.array([1.0, -2.0]), np.array([2.0, -4.0]))
    Comparison(peak_ratio_nonlinear=1.0, peak_ratio_linear=2.0, nrmse_nonlinear=0.0, nrmse_linear=1.0)
    """
    peak, rms = float(np.abs(measured).max()), float(np.sqrt(np.mean(measured**2)))
    return Comparison(
        *(float(np.abs(each).max()) / peak for each in (nonlinear, linear)),
        *(float(np.sqrt(np.mean((each - measured) ** 2))) / rms for each in (nonlinear, linear)),
    )


def _kept(recording: Recording, sensors: list[str], band_hz: tuple[float, float]) -> Recording:
    """Some channels within a band, without delay."""
    samples = recording.samples[:, [recording.index(sensor) for sensor in sensors]]
    spectrum = fft.rfft(samples, axis=0)
    frequency = fft.rfftfreq(len(samples), 1 / recording.fs)
    spectrum[(frequency < band_hz[0]) | (frequency > band_hz[1])] = 0.0
    samples = fft.irfft(spectrum, len(samples), axis=0)
    channels = tuple(recording.channels[recording.index(sensor)] for sensor in sensors)
    return replace(recording, samples=samples, channels=channels)
