"""What a class says of tests with a force: the effective damping along backbones, and responses with their peaks."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from opid.errors import NotDeterminedError
from opid.estimate import Estimate
from opid.mechanics.backbones.forced_curves import ForcedCurve, forced_curve
from opid.mechanics.backbones.specimen import Specimen
from opid.signals.recording import FloatArray
from opid.updating.likelihood.backbones import BackboneData, ModeData
from opid.updating.likelihood.curves import ClassSolver, find_met_modes, make_curves, make_solver
from opid.updating.likelihood.force import find_stiffness
from opid.updating.measured import LARGEST_M, MeasuredBackbone, reached_extensions
from opid.updating.model_class import ModelClass
from opid.updating.prediction import (
    N_AMPLITUDES,
    draw_frequency_errors,
    draw_relative_motions,
    fill_gaps,
    find_band,
    to_hz,
)
from opid.updating.result import ClassPosterior, DampingBand, ForcedResponse
from opid.updating.settings import UPDATING
from opid.updating.unmeasured_modes import ResponseSettings, draw_stated_errors, warn_of_extrapolation

# The phases end where other modes begin to move a sensor as far as its own one does.
_PHASES = np.arange(UPDATING.phase_step, 180, UPDATING.phase_step)


def predict_responses(
    data: BackboneData,
    model_class: ModelClass,
    theta: FloatArray,
    wanted: Sequence[ResponseSettings],
    measured: Sequence[MeasuredBackbone],
    *,
    unfit: Collection[int],
    rng: np.random.Generator,
) -> tuple[tuple[ForcedResponse, ...], list[str]]:
    """Return responses to a force, and a sentence for each that is extrapolated, has no interval, or is none.

    Each draw of theta has a response curve of the damped, forced structure by harmonic balance. Its force has the
    calibration error of a further test and the error of the energy that the model loses; its frequency and its motions
    have the errors of the linear structure: those of a further curve of a measured mode, which its curves tell, and the
    stated ones of a mode without curves. All modes of the structure have the damping ratio of the one that is followed.

    Args:
        data: the backbones with their force.
        model_class: the class that predicts.
        theta: (n, n_parameters) draws of its parameters.
        wanted: the responses.
        measured: the backbones that were measured, which tell how far the tests reached.
        unfit: numbers of the measured modes that the class does not fit. If there is any, no response has an interval,
            for the same theta predicts all modes.
        rng: source of chance.
    """
    extended = max(reached_extensions(data.system, measured).values(), default=0.0)
    found: list[ForcedResponse] = []
    sentences: list[str] = []
    for one in wanted:
        for force_n in one.force_n:
            shaken = _Shaken(data, model_class, one, force_n)
            response, told = _predict_response(shaken, theta, extended, unfit, rng)
            found += [response] if response is not None else []
            sentences += told
    return tuple(found), sentences


@dataclass(frozen=True, eq=False)
class _Shaken:
    """A response that is asked for, with the structure and the class that give it."""

    data: BackboneData
    model_class: ModelClass
    wanted: ResponseSettings
    force_n: float

    @property
    def words(self) -> str:
        return f"mode {self.wanted.mode} under {self.force_n:g} N"

    @property
    def curves(self) -> ModeData | None:
        """The curves of the mode; None without any."""
        return next((mode for mode in self.data.modes if mode.mode == self.wanted.mode), None)

    @property
    def controlled(self) -> str:
        """The sensor over whose amplitude errors of the structure are drawn."""
        return self.wanted.seen_at if self.curves is None else self.curves.parts[0][0]

    def make_solver(self, amplitude: FloatArray) -> ClassSolver:
        """Return the solver of the backbones at amplitudes of the controlled sensor, m."""
        mode = self.wanted.mode if self.curves is None else self.curves
        return make_solver(self.data, self.model_class, mode, self.controlled, amplitude)

    def solve(self, theta: FloatArray, ratio: float, force_n: float) -> ForcedCurve | None:
        """Return the response for one theta, (n_parameters,); None where there is none."""
        data, wanted = self.data, self.wanted
        system = data.system
        if data.structure is not None:
            system = data.structure.at(theta[theta.size - len(self.model_class.factors) :])[0]
        if self.curves is not None:
            # The likelihood leaves out the same modes.
            system = find_met_modes(data, self.curves).remove_from(system)
        laws = tuple(self.model_class.laws(system.joints, theta).values())
        try:
            return forced_curve(
                Specimen(system, laws, ratio, wanted.drive), mode=wanted.mode, sensor=wanted.seen_at, force_n=force_n,
                phases=_PHASES, harmonics=data.harmonics,
            )  # fmt: skip
        except NotDeterminedError:
            return None


def _predict_response(
    shaken: _Shaken, theta: FloatArray, extended: float, unfit: Collection[int], rng: np.random.Generator
) -> tuple[ForcedResponse | None, list[str]]:
    """Return a response, or None, and the sentences about it; joints extended by `extended`, m, in the tests."""
    noise, system, wanted = shaken.data.noise, shaken.data.system, shaken.wanted
    ratios = shaken.make_solver(np.ones(1)).find_ratio(theta)
    middle = shaken.solve(np.median(theta, axis=0), float(np.median(ratios)), shaken.force_n)
    if middle is None or middle.resonance is None:
        return None, [
            f"{shaken.words}: the class has no resonance there, and the response is left out: give less force"
        ]
    top = int(np.argmax(middle.amplitude))
    if middle.amplitude[top] > LARGEST_M:
        return None, [
            f"{shaken.words}: sensor {wanted.seen_at!r} would move by {middle.amplitude[top]:.3g} m, which no "
            "structure does, and the response is left out: give the force in N"
        ]
    held = float(np.abs(middle.harmonics[top, system.sensor(shaken.controlled), 0]))
    errors, moved = _draw_errors(shaken, theta, held, rng)
    # The force is read with the calibration of another test, and the energy has an error, too.
    gain = np.exp(np.hypot(noise.force_error, noise.energy_error) * rng.standard_normal(len(theta)))
    pushed = shaken.force_n * gain * moved[:, system.sensor(wanted.drive)]
    hz, amplitude = np.full((2, len(theta), _PHASES.size), np.nan)
    peaks = np.full((2, len(theta)), np.nan)
    for row, (own, ratio, force_n) in enumerate(zip(theta, ratios, pushed, strict=True)):
        curve = shaken.solve(own, float(ratio), float(force_n)) if np.isfinite(force_n) else None
        if curve is None or curve.resonance is None:
            continue
        reached = np.searchsorted(_PHASES, curve.phase_deg - 0.5)
        hz[row, reached], amplitude[row, reached], peaks[:, row] = curve.frequency_hz, curve.amplitude, curve.resonance
    hz, peaks[0] = (to_hz((2 * np.pi * each) ** 2 + own) for each, own in ((hz, errors[:, None]), (peaks[0], errors)))
    seen = moved[:, system.sensor(wanted.seen_at)]
    amplitude, peaks[1] = amplitude * seen[:, None], peaks[1] * seen
    told = list(_warn(shaken, peaks, unfit))
    extension = system.extension_over(wanted.mode, shaken.controlled) * held
    beyond = list(warn_of_extrapolation(shaken.words, extension, extended))
    peak_hz, peak_amplitude = (_estimate(each, has_interval=not told) for each in peaks)
    drawn = np.flatnonzero(np.isfinite(peaks[0]))[: UPDATING.n_drawn]
    response = ForcedResponse(
        wanted.mode, wanted.drive, wanted.seen_at, shaken.force_n, _PHASES.astype(np.float64), find_band(hz)[1],
        find_band(amplitude)[1], tuple(hz[drawn]), tuple(amplitude[drawn]), peak_hz, peak_amplitude, bool(beyond),
    )  # fmt: skip
    return response, [*told, *beyond]


def _draw_errors(
    shaken: _Shaken, theta: FloatArray, held: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draw errors of lambda, 1/s^2, (n,), and of the motion of each sensor, as factors, (n, n_sensors).

    They are those at the end of a further curve, without noise, up to the amplitude `held` of the controlled sensor, m.
    """
    data, mode = shaken.data, shaken.curves
    amplitude = np.linspace(UPDATING.least_amplitude * held, held, N_AMPLITUDES)
    found = shaken.make_solver(amplitude)(theta)
    if mode is None:
        errors, relative = draw_stated_errors(data, found, rng)
    else:
        growth = fill_gaps(found.eigenvalue, mode.linear) / mode.linear - 1
        at_nodes = make_curves(data, mode, shaken.model_class)(theta)
        errors = draw_frequency_errors(data, mode, at_nodes, found.eigenvalue, growth, rng, has_noise=False)
        relative = draw_relative_motions(data, mode, found, growth, at_nodes, rng, has_noise=False)
    shapes, controlled = found.shapes[:, -1], data.system.sensor(shaken.controlled)
    moved = np.abs(relative[:, -1] * shapes[:, [controlled]] / shapes)
    moved[:, controlled] = 1.0  # Its amplitude is what the motions are related to.
    return errors[:, -1], moved


def _warn(shaken: _Shaken, peaks: FloatArray, unfit: Collection[int]) -> Iterator[str]:
    """Yield why the peaks, (2, n_draws), have no interval."""
    lost = float(np.isnan(peaks[0]).mean())
    if lost > UPDATING.most_lost:
        yield (
            f"{shaken.words}: {100 * lost:.0f} % of the draws have no resonance, and the response has no interval: "
            "give less force"
        )
    if unfit:
        modes = " and ".join(f"mode {mode}" for mode in sorted(unfit))
        yield (
            f"{shaken.words}: the response has no interval, for the laws of {shaken.model_class.name!r} do not fit the "
            f"tests of {modes}, and the same parameters predict all modes: try another class"
        )


def _estimate(values: FloatArray, *, has_interval: bool) -> Estimate:
    """Return the median of draws, some of which are nan, with its deviation and interval."""
    there = values[np.isfinite(values)]
    if not there.size:
        return Estimate()
    low, middle, high = (float(each) for each in np.quantile(there, [0.025, 0.5, 0.975]))
    return Estimate(middle, float(there.std()), (low, high)) if has_interval else Estimate(middle)


# ---- effective damping -----------------------------------------------------------------------------


def predict_damping(
    data: BackboneData, posterior: ClassPosterior, measured: tuple[MeasuredBackbone, ...], *, rng: np.random.Generator
) -> Iterator[DampingBand]:
    """Yield the effective damping ratio of each mode whose force is known, with its 95 % band.

    The band is that of the laws and damping ratios; the errors of the force and of the energy of the model widen it as
    far as they leave these open. It is nan where the model converges for less than half of the draws, and a mode in
    which it converges nowhere has none.

    Args:
        data: the backbones with their force.
        posterior: posterior of the class that predicts.
        measured: the same backbones.
        rng: source of chance.
    """
    theta = posterior.chain.draw(UPDATING.n_predicted, rng)
    for mode in data.modes:
        driven = [one for one in measured if one.mode == mode.mode and one.force_n is not None]
        band = _make_damping_band(data, mode, posterior, driven, theta) if driven else None
        if band is not None:
            yield band


def _make_damping_band(
    data: BackboneData, mode: ModeData, posterior: ClassPosterior, driven: list[MeasuredBackbone], theta: FloatArray
) -> DampingBand | None:
    sensor = driven[0].controlled_sensor
    seen = np.concatenate([np.abs(one.amplitude[:, one.sensors.index(sensor)]) for one in driven])
    amplitude = np.linspace(seen.min(), seen.max(), N_AMPLITUDES)
    solve = make_solver(data, posterior.model_class, mode, sensor, amplitude)
    lost, energy = solve.find_loss(theta, solve(theta))
    band = find_band(lost / (4 * np.pi * energy))
    # The kinetic energy over A^2 is smooth, so that it can be interpolated to the measured points.
    smooth = find_band(energy)[1] / amplitude**2
    there = np.isfinite(smooth)
    if not there.any():
        return None
    work = np.pi * np.concatenate([find_stiffness(one, sensor) for one in driven])
    ratio = work / (4 * np.pi * np.interp(seen, amplitude[there], smooth[there]))
    return DampingBand(mode.mode, sensor, amplitude, band[1], band[0], band[2], seen, ratio)
