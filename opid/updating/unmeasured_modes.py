"""What a study asks to be predicted beside its measured modes, and the bands of modes without curves."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from opid.errors import InputError, nearest
from opid.mechanics.backbones.family import BackboneFamily, refuse_unseen
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.signals.recording import FloatArray
from opid.updating.checks import joint_fault
from opid.updating.likelihood.backbones import BackboneData
from opid.updating.likelihood.curves import make_solver
from opid.updating.likelihood.noise import UNMENDED_GROWTH, draw_linear_errors
from opid.updating.measured import LARGEST_M, MeasuredBackbone, by_mode, reached_extensions
from opid.updating.model_class import ModelClass
from opid.updating.prediction import N_AMPLITUDES, draw_motions, fill_gaps, find_band, to_hz
from opid.updating.result import BackboneBand, SensorBand
from opid.updating.settings import UPDATING


@dataclass(frozen=True, kw_only=True)
class ResponseSettings:
    """A forced response that the best class predicts: what a shaker makes of a mode whose damping ratio is named.

    Args:
        mode: number of the mode, from 1.
        drive: name of the sensor at which the force acts.
        force_n: amplitude of the force, N; a response for each.
        sensor: name of the sensor whose response it is; the drive point where left out.

    Raises:
        InputError: a number below 1, no force, or one that is not positive.
    """

    mode: int
    drive: str
    force_n: tuple[float, ...]
    sensor: str | None = None

    def __post_init__(self) -> None:
        forces = tuple(float(each) for each in self.force_n)
        object.__setattr__(self, "force_n", forces)
        if self.mode < 1:
            raise InputError(f"the response of mode {self.mode} is to be predicted: modes are counted from 1")
        if not forces or not all(0 < each < np.inf for each in forces):
            raise InputError(
                f"the response of mode {self.mode} to the forces {list(forces)} is to be predicted: give positive "
                "amplitudes, N, at least one"
            )

    @property
    def seen_at(self) -> str:
        """The sensor whose response it is."""
        return self.drive if self.sensor is None else self.sensor


@dataclass(frozen=True, kw_only=True)
class PredictionSettings:
    """What the best class predicts beside the backbones of measured modes: modes without curves, forced responses.

    Args:
        modes: numbers of these modes, from 1.
        sensor: name of the sensor over whose amplitude they are predicted; where left out, that which moves most in
            each mode.
        amplitude_m: smallest and largest amplitude of that sensor, m; where left out, no joint extends farther at the
            largest one than in the tests, and it is no larger than that of any sensor there; the smallest is a
            twentieth of it.
        responses: responses to a force.

    Raises:
        InputError: numbers below 1 or given twice, or amplitudes that are not positive or do not grow.
    """

    modes: tuple[int, ...] = ()
    sensor: str | None = None
    amplitude_m: tuple[float, float] | None = None
    responses: tuple[ResponseSettings, ...] = ()

    def __post_init__(self) -> None:
        modes = tuple(self.modes)
        object.__setattr__(self, "responses", tuple(self.responses))
        object.__setattr__(self, "modes", modes)
        if len(set(modes)) < len(modes) or min(modes, default=1) < 1:
            raise InputError(f"the modes to predict are {list(modes)}: give each once, counted from 1")
        if self.amplitude_m is not None:
            low, high = self.amplitude_m
            if not 0 < low < high < np.inf:
                raise InputError(f"amplitude_m is {[low, high]}: give a smallest and a largest amplitude, m")
            if high > LARGEST_M:
                raise InputError(f"amplitude_m reaches {high:g} m, which no structure moves: give metres")


def prediction_faults(
    wanted: PredictionSettings,
    form: str,
    sensors: Sequence[str],
    measured: Sequence[MeasuredBackbone],
    ratios: Collection[int],
) -> Iterator[str]:
    """Yield what is wrong with the predictions, as far as it shows without the modes of the structure.

    Args:
        wanted: the predictions.
        form: form of the likelihood.
        sensors: sensors of the structure.
        measured: the backbones that were measured.
        ratios: numbers of the modes whose damping ratio is named.
    """
    if wanted.modes and form != "recommended":
        yield f"modes to predict are named in the form {form!r}, take the recommended form, which knows their errors"
    for mode in wanted.modes:
        if mode in by_mode(measured):
            yield f"mode {mode} is to be predicted and has backbones, leave it out: each measured mode has a band"
    if wanted.sensor is not None and wanted.sensor not in sensors:
        hint = nearest(wanted.sensor, sensors)
        yield f"the modes are to be predicted at {wanted.sensor!r}, which is no sensor: {hint}"
    for one in wanted.responses:
        if one.mode not in ratios:
            yield (
                f"the response of mode {one.mode} to a force is to be predicted and the mode has no damping ratio, "
                "name one: damping"
            )
        for what, name in (("to a force at", one.drive), ("at", one.seen_at)):
            if name not in sensors:
                hint = nearest(name, sensors)
                yield f"the response of mode {one.mode} {what} {name!r} is to be predicted, which is no sensor: {hint}"


def unseen_faults(wanted: PredictionSettings, system: JointedModes) -> Iterator[str]:
    """Yield which modes to predict the structure does not have, and which do not move the joints or the sensors."""
    needed: dict[int, list[str | None]] = {mode: [wanted.sensor] for mode in wanted.modes}
    for one in wanted.responses:
        needed.setdefault(one.mode, []).extend((one.drive, one.seen_at))
    for mode, sensors in needed.items():
        if mode > system.n_modes:
            yield f"mode {mode} is to be predicted, and the structure has {system.n_modes} modes: correct the number"
            continue
        yield from joint_fault(system, mode)
        for sensor in dict.fromkeys(sensors):
            try:
                refuse_unseen(system, mode - 1, system.sensor(_choose_sensor(sensor, system, mode)))
            except InputError as error:
                yield str(error)


def predict_unmeasured(
    data: BackboneData,
    model_class: ModelClass,
    theta: FloatArray,
    wanted: PredictionSettings,
    measured: Sequence[MeasuredBackbone],
    *,
    rng: np.random.Generator,
) -> tuple[tuple[BackboneBand, ...], list[str]]:
    """Return the 95 % bands of the backbones of modes without curves, and a sentence for each that extrapolates.

    They are bands of the backbone itself. No curve corrects the error of the linear structure there: it is drawn as
    large as it is stated, for lambda and for the motion of each sensor, beside the factors of the stiffness where these
    are parameters of the class. The bands are nan where the model converges for less than half of the draws.

    Args:
        data: the backbones, from `backbone_data`, in the recommended form; with a structure for its factors.
        model_class: the class that predicts, with these factors where there are any.
        theta: (n, n_parameters) draws of its parameters.
        wanted: the modes.
        measured: the backbones that were measured, which tell how far the tests reached.
        rng: source of chance.
    """
    system = data.system
    extended = max(reached_extensions(system, measured).values(), default=0.0)
    moved = max(float(np.abs(one.amplitude).max()) for one in measured)
    bands: list[BackboneBand] = []
    warnings: list[str] = []
    for mode in wanted.modes:
        sensor = _choose_sensor(wanted.sensor, system, mode)
        largest = min(moved, extended / system.extension_over(mode, sensor))
        ends = (UPDATING.least_amplitude * largest, largest) if wanted.amplitude_m is None else wanted.amplitude_m
        amplitude = np.linspace(*ends, N_AMPLITUDES)
        found = make_solver(data, model_class, mode, sensor, amplitude)(theta)
        errors, relative = draw_stated_errors(data, found, rng)
        low, middle, high = find_band(to_hz(found.eigenvalue + errors))
        sensors = []
        for row in np.delete(np.arange(len(system.sensors)), system.sensor(sensor)):
            below, motion, above = amplitude * find_band(relative[..., row])
            sensors.append(SensorBand(system.sensors[row], motion, below, above, float("nan")))
        nothing = float("nan")
        bands.append(
            BackboneBand(mode, sensor, amplitude, middle, low, high, nothing, is_measured=False, sensors=tuple(sensors))
        )
        extension = system.extension_over(mode, sensor) * float(amplitude[-1])
        warnings += warn_of_extrapolation(f"mode {mode}", extension, extended)
    return tuple(bands), warnings


def _choose_sensor(sensor: str | None, system: JointedModes, mode: int) -> str:
    most = system.sensors[int(np.argmax(np.abs(system.at_sensors[:, system.index(mode)])))]
    return most if sensor is None else sensor


def draw_stated_errors(
    data: BackboneData, found: BackboneFamily, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draw errors of lambda, 1/s^2, (n, n_points), and motions, (n, n_points, n_sensors), where nothing was measured.

    The errors are as large as they are stated, and the motions are those over that of the controlled sensor.
    """
    noise, system = data.noise, data.system
    growth_of_error = noise.growth_of_linear_error
    if data.structure is not None and noise.linear_error_growth is None:
        growth_of_error = UNMENDED_GROWTH  # The errors of the factors are drawn with theta.
    linear = float(system.eigenvalue[system.index(found.mode)])
    growth = fill_gaps(found.eigenvalue, linear) / linear - 1
    patterns = np.stack([np.ones_like(growth), growth_of_error * growth], axis=2)
    errors = linear * draw_linear_errors(patterns, 1, 2 * noise.linear_error, rng)[..., 0]
    controlled = system.sensor(found.sensor)
    return errors, draw_motions(found, controlled, growth, noise.linear_shape_error, growth_of_error, rng)


def warn_of_extrapolation(what: str, extension: float, reached: float) -> Iterator[str]:
    """Yield a sentence if a joint extends farther in `what` is predicted than it reached in the tests, m."""
    if extension > (1 + 1e-9) * reached:
        yield (
            f"{what}: a joint extends by up to {1e3 * extension:.3g} mm in its prediction, and by "
            f"{1e3 * reached:.3g} mm in the tests: the law is extrapolated beyond that, and the band may be too narrow "
            "there"
        )
