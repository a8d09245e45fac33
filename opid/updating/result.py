"""The results of Bayesian updating as records, and their content in result.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from opid.estimate import Estimate
from opid.json_values import plain
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import FloatArray
from opid.updating.measured import (
    MeasuredBackbone,
    Place,
    by_mode,
    list_sensors,
    reached_extensions,
    spread_sensors,
)
from opid.updating.model_class import ModelClass, OneParameter
from opid.updating.sampling.chains import Chain, Diagnostics
from opid.updating.sampling.evidence import Evidence
from opid.updating.settings import UPDATING
from opid.updating.structure.reduction import ReductionErrors

SCHEMA = "opid.updating/1"


@dataclass(frozen=True, eq=False)
class ClassPosterior:
    """One model class given the data.

    Args:
        model_class: the class.
        evidences: evidence by every method that was run; classes are compared by the first.
        best: (n_parameters,) maximum a posteriori.
        estimates: mean, standard deviation and 95 % interval of each parameter, by "theta_1", "theta_2", ...
        covariance: (n_parameters, n_parameters) covariance of the samples.
        samples: (n_samples, n_parameters) samples of the posterior, with the calibration of the amplitudes.
        calibration_std: (n_parameters,) the part of their standard deviation that `motion_error` makes.
        log_likelihood_at_best: logarithm of the likelihood of the data at `best`.
        diagnostics: diagnostics of the sampling.
        prior_sensitivity: change of the logarithm of the evidence when a prior is twice as wide, by parameter.
        warnings: one sentence for each warning about the class.
        has_no_effect: whether the class moves the frequencies nowhere in its prior; that is then its only warning.
        is_pulled: whether interactions whose points are left out move theta by too much for an interval.
        chain: the samples chain by chain, as if the measured amplitudes were exact: the law in their unit.
    """

    model_class: ModelClass
    evidences: tuple[Evidence, ...]
    best: FloatArray
    estimates: Mapping[str, Estimate]
    covariance: FloatArray
    samples: FloatArray
    calibration_std: FloatArray
    log_likelihood_at_best: float
    diagnostics: Diagnostics
    prior_sensitivity: Mapping[str, float]
    warnings: tuple[str, ...]
    chain: Chain
    has_no_effect: bool = False
    is_pulled: bool = False

    def without_intervals(self) -> ClassPosterior:
        """Return it with the values of its estimates alone."""
        return replace(self, estimates={name: each.without_interval() for name, each in self.estimates.items()})

    @property
    def has_intervals(self) -> bool:
        """Whether any parameter has an interval."""
        return any(each.interval95 is not None for each in self.estimates.values())

    @property
    def known_covariance(self) -> FloatArray:
        """(n_parameters, n_parameters) the covariance; nan for parameters without an interval."""
        known = np.array([each.interval95 is not None for each in self.estimates.values()])
        return np.where(np.outer(known, known), self.covariance, np.nan)

    def draw(self, n: int, rng: np.random.Generator) -> FloatArray:
        """(n, n_parameters) samples, drawn with replacement."""
        return self.samples[rng.integers(len(self.samples), size=n)]

    @property
    def log_evidence(self) -> float:
        """Logarithm of the evidence by the first method."""
        return self.evidences[0].log_evidence

    @property
    def labels(self) -> list[str]:
        """Label of each parameter on an axis."""
        return [f"θ{number} ({each.words})" for number, each in enumerate(self.model_class.parameters, start=1)]

    @property
    def coefficients(self) -> dict[OneParameter, Estimate]:
        """Each unknown parameter in its unit, theta times its scale."""
        of_theta = zip(self.model_class.parameters, self.estimates.values(), strict=True)
        return {each: _scale_estimate(estimate, each.scale) for each, estimate in of_theta}


def _scale_estimate(estimate: Estimate, scale: float) -> Estimate:
    ends = None if estimate.interval95 is None else tuple(sorted(scale * end for end in estimate.interval95))
    return Estimate(
        None if estimate.value is None else scale * estimate.value,
        None if estimate.std is None else abs(scale) * estimate.std,
        None if ends is None else (ends[0], ends[1]),
    )


@dataclass(frozen=True, eq=False)
class ModeShape:
    """The shape of a mode at its sensors as it was measured, and those of the structure, scaled to it.

    Args:
        mode: number of the mode, from 1.
        sensors: names of the sensors.
        measured: (n_sensors,) mean over the curves of the shapes of unit length at their lowest points.
        structure: (n_sensors,) shape of the structure that the classes were compared with, that is with the updated
            parameters where there are any; its scale is that with the least difference from the measured one.
        initial: (n_sensors,) likewise, with the parameters as they were given; None where none was updated.
    """

    mode: int
    sensors: tuple[str, ...]
    measured: FloatArray
    structure: FloatArray
    initial: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class LinearMode:
    """A mode before and after linear updating (Song Table 2).

    Args:
        mode: number of the mode, from 1.
        identified_hz: mean frequency of the tests.
        initial_hz: frequency of the nominal structure.
        updated_hz: frequency with the updated parameters.
        initial_mac: MAC of the nominal shape with the measured ones, mean over the tests.
        updated_mac: MAC of the updated shape with the measured ones, mean over the tests.
        initial_shape: (n_sensors,) shape of the nominal structure at the sensors of the tests.
    """

    mode: int
    identified_hz: float
    initial_hz: float
    updated_hz: float
    initial_mac: float
    updated_mac: float
    initial_shape: FloatArray


@dataclass(frozen=True, eq=False)
class LinearPosterior:
    """Phase I: the parameters of the linear structure given the lowest points of the backbones (Song section 2.1.1).

    Args:
        names: names of the parameters.
        best: (n_parameters,) maximum a posteriori.
        estimates: mean, standard deviation and 95 % interval, by the name of the parameter.
        covariance: (n_parameters, n_parameters) covariance of the samples.
        samples: (n_samples, n_parameters) samples of the posterior.
        modes: frequencies and MAC before and after the updating.
        diagnostics: diagnostics of the sampling.
        warnings: one sentence for each warning about the parameters.
        chain: the samples chain by chain.
        name: name of this class of parameters, "" where there is no other.
        evidence: the evidence of these parameters; None where no method has one.
    """

    names: tuple[str, ...]
    best: FloatArray
    estimates: Mapping[str, Estimate]
    covariance: FloatArray
    samples: FloatArray
    modes: tuple[LinearMode, ...]
    diagnostics: Diagnostics
    warnings: tuple[str, ...]
    chain: Chain
    name: str = ""
    evidence: Evidence | None = None

    @property
    def log_evidence(self) -> float:
        """Logarithm of the evidence, -inf where there is none."""
        return -np.inf if self.evidence is None else self.evidence.log_evidence

    @property
    def factors(self) -> dict[str, float]:
        """The best parameters by name."""
        return dict(zip(self.names, (float(value) for value in self.best), strict=True))


@dataclass(frozen=True, eq=False)
class SensorBand:
    """Predicted motion of one sensor along the backbone of a mode, with its 95 % band.

    Args:
        sensor: name of the sensor.
        motion: (n,) median of its first-harmonic amplitude, m, at the amplitudes of the controlled sensor; negative
            where the two move against each other.
        low: (n,) lower end of the 95 % band, m.
        high: (n,) upper end of the 95 % band, m.
        coverage: fraction of the measured points that lie within the band; nan without any point.
        left_out: the same of points of curves that were left out in turn, within the band that the other curves give;
            None where the curves do not have this sensor, or the mode has a single curve.
    """

    sensor: str
    motion: FloatArray
    low: FloatArray
    high: FloatArray
    coverage: float
    left_out: float | None = None


@dataclass(frozen=True, eq=False)
class BackboneBand:
    """Predicted backbone of one mode over the amplitude of one sensor, with its 95 % band (Song eq. 18).

    The band of a measured mode is that of a further curve. A mode without curves has the band of the backbone itself,
    with the error of the linear structure that is stated, for no curve corrects it.

    Args:
        mode: number of the mode, from 1.
        sensor: name of that sensor.
        amplitude: (n,) amplitudes, m.
        frequency_hz: (n,) median of the frequency, Hz.
        low_hz: (n,) lower end of the 95 % band, Hz.
        high_hz: (n,) upper end of the 95 % band, Hz.
        coverage: fraction of the measured points of this mode that lie within the band; nan without any point.
        left_out: the same of points of curves that were left out in turn, within the band that the other curves give;
            None where the mode has a single curve, or the form of the likelihood has no errors that curves share.
        mode_left_out: the same of all its points, within the band that the other modes give alone, with the errors of
            the linear structure and of the curves that are stated; None where there is no other mode, or the others do
            not determine the parameters.
        is_measured: whether the mode has curves.
        sensors: bands of the motion of the other sensors of the structure, at the same amplitudes; none in the paper's
            forms, which have no errors of the shapes.
        loop: (n,) amplitudes, m, and (n,) frequencies, Hz, of the backbone without damping at the best parameters,
            through an interaction by arclength; None where interactions are left out or no harmonic meets a mode.
    """

    mode: int
    sensor: str
    amplitude: FloatArray
    frequency_hz: FloatArray
    low_hz: FloatArray
    high_hz: FloatArray
    coverage: float
    left_out: float | None = None
    mode_left_out: float | None = None
    is_measured: bool = True
    sensors: tuple[SensorBand, ...] = ()
    loop: tuple[FloatArray, FloatArray] | None = None

    def without_ends(self) -> BackboneBand:
        """Return the medians alone: the ends of the bands, of the frequency and of each sensor, are nan."""
        none = np.full(self.amplitude.shape, np.nan)
        sensors = tuple(replace(each, low=none, high=none) for each in self.sensors)
        return replace(self, low_hz=none, high_hz=none, sensors=sensors)

    @property
    def n_missing(self) -> int:
        """Number of amplitudes without a frequency."""
        return int((~np.isfinite(self.frequency_hz)).sum())


@dataclass(frozen=True, eq=False)
class DampingBand:
    """Effective damping ratio of one mode over the amplitude of one sensor by the best class, with its 95 % band.

    Args:
        mode: number of the mode, from 1.
        sensor: name of that sensor.
        amplitude: (n,) amplitudes, m.
        damping_ratio: (n,) median of the energy that is lost in a cycle over 4 pi times the kinetic energy.
        low: (n,) lower end of the 95 % band.
        high: (n,) upper end of the 95 % band.
        measured_amplitude: (n_points,) amplitude of each point of all curves, m.
        measured: (n_points,) the same ratio there, by the work of the measured force.
    """

    mode: int
    sensor: str
    amplitude: FloatArray
    damping_ratio: FloatArray
    low: FloatArray
    high: FloatArray
    measured_amplitude: FloatArray
    measured: FloatArray

    def without_ends(self) -> DampingBand:
        """Return the median alone: the ends of the band are nan."""
        none = np.full(self.amplitude.shape, np.nan)
        return replace(self, low=none, high=none)


@dataclass(frozen=True, eq=False)
class HarmonicBand:
    """A higher harmonic of one sensor at the measured points of one mode, and its 95 % band by the best class.

    Args:
        mode: number of the mode, from 1.
        order: number of the harmonic, from 2.
        sensor: name of the sensor.
        controlled_sensor: name of the sensor whose amplitude the points have.
        amplitude: (n_points,) this amplitude, m, of all curves, growing.
        measured: (n_points,) the harmonic as it was measured, m, with the sign of `SensorHarmonic`.
        predicted: (n_points,) median, m.
        low: (n_points,) lower end of the 95 % band of a measured point, m.
        high: (n_points,) upper end of the 95 % band, m.
        coverage: fraction of the points within the band; nan where it has none.
        met_mode: number of another mode that the harmonic comes near to, and that has a large part in it; None without.
    """

    mode: int
    order: int
    sensor: str
    controlled_sensor: str
    amplitude: FloatArray
    measured: FloatArray
    predicted: FloatArray
    low: FloatArray
    high: FloatArray
    coverage: float
    met_mode: int | None = None

    def without_ends(self) -> HarmonicBand:
        """Return the medians alone: the ends of the band are nan."""
        none = np.full(self.amplitude.shape, np.nan)
        return replace(self, low=none, high=none, coverage=np.nan)


@dataclass(frozen=True, eq=False)
class ForcedResponse:
    """What a shaker makes of one mode by the best class, over the phase of one sensor against its force.

    Over the frequency the curve of a nonlinear mode may turn back, over the phase it does not. The intervals hold the
    laws and damping ratios, the error of the linear structure, and the calibration of the force.

    Args:
        mode: number of the mode, from 1.
        drive: name of the sensor at which the force acts.
        sensor: name of the sensor whose response it is.
        force_n: amplitude of the force, N.
        phase_deg: (n,) angles by which the sensor lags the force, degrees.
        frequency_hz: (n,) median of the frequency at each of them, Hz; nan where most draws do not reach it.
        amplitude: (n,) median of the first harmonic of the sensor, m.
        drawn_hz: frequencies of a few draws, (n,) each, Hz.
        drawn_amplitude: their amplitudes, (n,) each, m.
        peak_hz: frequency at resonance, where the amplitude is largest, Hz; without an interval where laws or draws do
            not support one.
        peak_amplitude: that amplitude, m.
        is_extrapolated: whether a joint moves farther than it did in the tests.
    """

    mode: int
    drive: str
    sensor: str
    force_n: float
    phase_deg: FloatArray
    frequency_hz: FloatArray
    amplitude: FloatArray
    drawn_hz: tuple[FloatArray, ...]
    drawn_amplitude: tuple[FloatArray, ...]
    peak_hz: Estimate
    peak_amplitude: Estimate
    is_extrapolated: bool

    def without_intervals(self) -> ForcedResponse:
        """Return the medians alone, without draws around them."""
        peak_hz, peak_amplitude = (each.without_interval() for each in (self.peak_hz, self.peak_amplitude))
        return replace(self, peak_hz=peak_hz, peak_amplitude=peak_amplitude, drawn_hz=(), drawn_amplitude=())

    @property
    def words(self) -> str:
        """What it is the response of: "mode 7 under 2 N at 5, sensor 10"."""
        return f"mode {self.mode} under {self.force_n:g} N at {self.drive}, sensor {self.sensor}"


@dataclass(frozen=True, eq=False)
class Confusion:
    """How often each class would be chosen from such data, if one of them were true.

    Args:
        classes: names of the classes.
        chosen: (n_classes, n_classes) fraction of the sets in which the class of the column is chosen, if that of the
            row is true.
        n_sets: number of sets that were drawn for each row.
    """

    classes: tuple[str, ...]
    chosen: FloatArray
    n_sets: int


@dataclass(frozen=True, eq=False, repr=False)
class Updating(Result):
    """The whole updating: linear parameters, one posterior for each class, and the prediction of the best class.

    Args:
        title: the title of the study.
        form: form of the likelihood, "paper", "literal", "recommended" or "independent".
        linear: posterior of phase I, of the class with the largest evidence where there are several; None where the
            linear structure was taken as it is.
        system: the reduced structure by its modes, with the best linear parameters.
        measured: the measured backbones.
        classes: one posterior for each class, in the order of the study.
        best_class: name of the class with the largest evidence.
        prediction: backbones that the best class predicts, one for each measured mode, then those of the modes without
            curves that the study asks for.
        warnings: one sentence for each warning about the result.
        not_determined: the reason why there is no answer, "" if there is one.
        settings: the settings of the study.
        confusion: how often each class would be chosen if another one were true; None where it was not asked.
        linear_classes: posteriors of all classes of linear parameters, where there are several.
        reductions: differences of the reduced structure from the whole one, those of the reduction in use first; empty
            where the structure was not reduced or the comparison was not made.
        places: where the sensors are, by their names; empty where the study does not say it.
        damping: effective damping of each mode with a force, by the best class; empty where no force is used.
        responses: responses to a force that the best class predicts, those that the study asks for.
        harmonics: higher harmonics that were measured, beside what the best class predicts of them.
    """

    title: str
    form: str
    linear: LinearPosterior | None
    system: JointedModes
    measured: tuple[MeasuredBackbone, ...]
    classes: tuple[ClassPosterior, ...]
    best_class: str
    prediction: tuple[BackboneBand, ...]
    warnings: tuple[str, ...]
    not_determined: str
    settings: Mapping[str, Any]
    reductions: tuple[ReductionErrors, ...] = ()
    confusion: Confusion | None = None
    linear_classes: tuple[LinearPosterior, ...] = ()
    places: Mapping[str, Place] = field(default_factory=dict)
    damping: tuple[DampingBand, ...] = ()
    responses: tuple[ForcedResponse, ...] = ()
    harmonics: tuple[HarmonicBand, ...] = ()

    @property
    def mode_shapes(self) -> tuple[ModeShape, ...]:
        """The shape of each measured mode that at least two sensors saw, beside those of the structure."""
        initial = {} if self.linear is None else {each.mode: each.initial_shape for each in self.linear.modes}
        found = []
        for mode, curves in by_mode(self.measured).items():
            sensors = list_sensors(curves)
            if len(sensors) < 2 or mode > self.system.n_modes:
                continue
            rows = [self.system.sensor(sensor) for sensor in sensors]
            structure = self.system.at_sensors[rows, self.system.index(mode)]
            lowest = np.array([spread_sensors(curve.amplitude[0], curve.sensors, sensors) for curve in curves])
            seen = np.array([[name in curve.sensors for name in sensors] for curve in curves])
            # What a curve with fewer sensors sees is a part of the shape, as large as that of the structure.
            part = np.linalg.norm(seen * structure, axis=1) / np.linalg.norm(structure)
            shapes = (lowest.T / np.linalg.norm(lowest, axis=1) * part).T
            # The sign of a shape is arbitrary, but that of all sensors together.
            turn = np.sign(shapes @ structure)
            turned = (shapes * (turn * turn[0])[:, None]).sum(axis=0)
            measured = turned / seen.sum(axis=0)
            before = _scale_shape(initial[mode], measured) if mode in initial else None
            found.append(ModeShape(mode, sensors, measured, _scale_shape(structure, measured), before))
        return tuple(found)

    @property
    def best(self) -> ClassPosterior | None:
        """The class with the largest evidence; None where there is none."""
        return next((each for each in self.classes if each.model_class.name == self.best_class), None)

    @property
    def all_warnings(self) -> list[str]:
        """All warnings, those of phase I and of the classes last, each once."""
        of_linear = () if self.linear is None else self.linear.warnings
        # Each pair is the wording in `self.warnings`, and the wording of a warning that is not there.
        named = [(f"linear structure: {text}", f"linear structure: {text}") for text in of_linear]
        for each in self.classes:
            name = each.model_class.name
            named += [(f"class {name!r}: {text}", f"{name}: {text}") for text in each.warnings]
        others = [of_part for of_whole, of_part in named if of_whole not in self.warnings]
        return list(dict.fromkeys([*self.warnings, *others]))

    @property
    def rejected(self) -> tuple[ClassPosterior, ...]:
        """The classes that the data rule out: their log evidence is far below that of the best."""
        best = max((each.log_evidence for each in self.classes), default=0.0)
        return tuple(each for each in self.classes if best - each.log_evidence > UPDATING.ruled_out)

    @property
    def warnings_of_rejected(self) -> list[str]:
        """Those of all warnings that are about a class that the data rule out."""
        said = (f"class {each.model_class.name!r}: {text}" for each in self.rejected for text in each.warnings)
        return [text for text in dict.fromkeys(said) if text in self.warnings]

    @property
    def reached_extension(self) -> dict[int, float]:
        """The largest extension of a joint in the tests of each mode, m, by the linear shape of the mode."""
        return reached_extensions(self.system, self.measured)

    @property
    def harmonics_within(self) -> dict[tuple[int, int], float]:
        """The fraction of the points of all sensors within their bands, by mode and harmonic; nan without any band."""
        found: dict[tuple[int, int], list[NDArray[np.bool_]]] = {}
        for band in self.harmonics:
            inside = (band.measured >= band.low) & (band.measured <= band.high)
            found.setdefault((band.mode, band.order), []).append(inside[np.isfinite(band.low)])
        joined = {name: np.concatenate(each) for name, each in found.items()}
        return {name: float(each.mean()) if each.size else float("nan") for name, each in joined.items()}

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return linear parameters as factors of the nominal ones, coefficients, peaks of responses, and harmonics.

        The coefficients of the best class come first. Of harmonics it is the fraction of the points within their bands.
        """
        linear = {} if self.linear is None else self.linear.estimates
        rows = [SummaryRow.of(f"linear.{name}", estimate, "1") for name, estimate in linear.items()]
        for each in sorted(self.classes, key=lambda each: each.model_class.name != self.best_class):
            name = each.model_class.name
            coefficients = each.coefficients.items()
            rows += [SummaryRow.of(f"{name}.{own.key}", found, own.unit) for own, found in coefficients]
        for response in self.responses:
            rows.append(SummaryRow.of(f"{response.words}: frequency", response.peak_hz, "Hz"))
            rows.append(SummaryRow.of(f"{response.words}: amplitude", response.peak_amplitude, "m"))
        for (mode, order), fraction in self.harmonics_within.items():
            within = Estimate(fraction if np.isfinite(fraction) else None)
            rows.append(SummaryRow.of(f"mode {mode}, harmonic {order}: points within the band", within, "1"))
        return tuple(rows)

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The study, the matrices and the backbones, as they were when they were read."""
        return tuple(file for each in self.measured for file in each.files)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, which `docs/schemas/updating-1.schema.json` describes."""
        reduction, free = (*(asdict(each) for each in self.reductions), None, None)[:2]
        as_they_are = ("title", "form", "best_class", "warnings", "not_determined", "settings")
        return plain(
            {
                "schema": SCHEMA,
                **{name: getattr(self, name) for name in as_they_are},
                "classes": [_convert_class(each) for each in self.classes],
                "linear": None if self.linear is None else _convert_linear(self.linear),
                "linear_classes": [_convert_linear(each) for each in self.linear_classes],
                "shapes": [asdict(shape) for shape in self.mode_shapes],
                "system": {name: getattr(self.system, name) for name in ("frequency_hz", "sensors", "joints")},
                "reduction": reduction,
                "reduction_free": free,
                "measured": [_convert_curve(curve) for curve in self.measured],
                "prediction": [asdict(band) for band in self.prediction],
                "damping": [asdict(band) for band in self.damping],
                "responses": [asdict(response) for response in self.responses],
                "harmonics": [asdict(band) for band in self.harmonics],
                "confusion": None if self.confusion is None else asdict(self.confusion),
            }
        )

    def _write_headline(self) -> str:
        best = f"best: {self.best_class}" if self.best_class else "no class"
        return f"{self.title or 'without a title'} ({len(self.classes)} classes, {best})"


def _scale_shape(shape: FloatArray, like: FloatArray) -> FloatArray:
    """Return a shape with the scale and sign that bring it nearest to another one."""
    size = float(shape @ shape)
    return shape * (float(shape @ like) / size if size > 0 else 0.0)


def _convert_class(posterior: ClassPosterior) -> dict[str, Any]:
    own, first = posterior.model_class, posterior.evidences[0]
    as_they_are = ("best", "calibration_std", "log_likelihood_at_best", "prior_sensitivity", "warnings")
    return {
        "name": own.name,
        "law": own.law_in_words,
        "terms": [asdict(term) for term in own.terms],
        "factors": [asdict(factor) for factor in own.factors],
        "ratios": [asdict(ratio) for ratio in own.ratios],
        "log_evidence": first.log_evidence,
        "log_evidence_std": first.std,
        "evidences": [asdict(evidence) for evidence in posterior.evidences],
        "parameters": {name: _convert_estimate(estimate) for name, estimate in posterior.estimates.items()},
        "coefficients": {
            each.key: {**_convert_estimate(estimate), "unit": each.unit}
            for each, estimate in posterior.coefficients.items()
        },
        "diagnostics": asdict(posterior.diagnostics),
        "covariance": posterior.known_covariance,
        **{name: getattr(posterior, name) for name in as_they_are},
    }


def _convert_mode(mode: LinearMode) -> dict[str, Any]:
    """Return a mode without its shape, which stands among the shapes of the result."""
    return {name: value for name, value in asdict(mode).items() if name != "initial_shape"}


def _convert_linear(linear: LinearPosterior) -> dict[str, Any]:
    return {
        "name": linear.name,
        "evidence": None if linear.evidence is None else asdict(linear.evidence),
        "parameters": {name: _convert_estimate(estimate) for name, estimate in linear.estimates.items()},
        "best": linear.factors,
        "covariance": linear.covariance,
        "modes": [_convert_mode(mode) for mode in linear.modes],
        "diagnostics": asdict(linear.diagnostics),
        "warnings": linear.warnings,
    }


def _convert_curve(curve: MeasuredBackbone) -> dict[str, Any]:
    as_they_are = ("name", "mode", "controlled_sensor", "frequency_hz")
    amplitude = dict(zip(curve.sensors, curve.amplitude.T, strict=True))
    force = {"drive": curve.drive or None, "force_n": curve.force_n}
    higher = {"harmonics": [asdict(each) for each in curve.harmonics]}
    return {**{name: getattr(curve, name) for name in as_they_are}, "amplitude": amplitude, **force, **higher}


def _convert_estimate(estimate: Estimate) -> dict[str, Any]:
    """Return an estimate with the key "mean", for a posterior has a mean where other answers have a value."""
    return {"mean": estimate.value, "std": estimate.std, "interval95": estimate.interval95}
