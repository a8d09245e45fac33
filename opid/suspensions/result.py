"""Result of an identification: parameters with intervals, the laws, their evidence, and warnings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import date
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from opid.estimate import Estimate, Estimates
from opid.mechanics.laws.law import LINEAR, Law, law_rows
from opid.mechanics.memory import Loop
from opid.mechanics.weight import slopes_at_rest
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import FloatArray
from opid.suspensions.fitting.faults import Demand, GroundImitations
from opid.suspensions.fitting.fit import Fit
from opid.suspensions.fitting.noise import Whiteness
from opid.suspensions.fitting.repeatability import Repeatability
from opid.suspensions.law_search.force_surface import ForceSurface, VisitedForce, visited_force
from opid.suspensions.law_search.pursuit import LawStep
from opid.suspensions.settings import Settings
from opid.suspensions.study import Study
from opid.suspensions.weighing import WeighedMass

if TYPE_CHECKING:
    from opid.suspensions.answer.model_error import LeftOut, Limit, ModelError
    from opid.suspensions.paper.chain import PaperChain

FrequencyOf = Literal["linear part", "tangent at rest", "all but what the law remembers"]

SCHEMA = "opid.identification/1"
UNITS = {
    "sprung_mass_kg": "kg",
    "suspension_stiffness_n_per_m": "N/m",
    "suspension_damping_n_s_per_m": "N s/m",
    "ground_stiffness_n_per_m": "N/m",
    "roll_inertia_kg_m2": "kg m^2",
    "pitch_inertia_kg_m2": "kg m^2",
    "x_cg_m": "m",
    "y_cg_m": "m",
    "roll_radius_m": "m",
    "pitch_radius_m": "m",
    "stiffness_per_mass": "1/s^2",
    "damping_per_mass": "1/s",
    "ground_stiffness_per_mass": "1/s^2",
    "natural_frequency_hz": "Hz",
    "damping_ratio": "1",
}
"""Units of the parameters and ratios of gears and bodies."""
_NOTHING = Estimate()


@dataclass(frozen=True)
class GearParameters(Estimates):
    """Absolute values of one gear in the reference run; empty if they are not determined.

    Args:
        sprung_mass_kg: M2.
        suspension_stiffness_n_per_m: K2.
        suspension_damping_n_s_per_m: C2.
        ground_stiffness_n_per_m: K3, of a spring from the sprung mass to the ground.
    """

    sprung_mass_kg: Estimate = _NOTHING
    suspension_stiffness_n_per_m: Estimate = _NOTHING
    suspension_damping_n_s_per_m: Estimate = _NOTHING
    ground_stiffness_n_per_m: Estimate = _NOTHING


@dataclass(frozen=True)
class GearRatios(Estimates):
    """Ratios of one gear to its mass, and its motion on a still wheel.

    Args:
        stiffness_per_mass: K2/M2, 1/s^2.
        damping_per_mass: C2/M2, 1/s.
        ground_stiffness_per_mass: K3/M2, 1/s^2.
        natural_frequency_hz: natural frequency of the sprung mass in small motion, on the tangent stiffness at rest,
            which is K2 + K3 if the law has no slope there; see `Identification.frequency_of`.
        damping_ratio: damping ratio of C2 at that frequency.
    """

    stiffness_per_mass: Estimate = _NOTHING
    damping_per_mass: Estimate = _NOTHING
    ground_stiffness_per_mass: Estimate = _NOTHING
    natural_frequency_hz: Estimate = _NOTHING
    damping_ratio: Estimate = _NOTHING


@dataclass(frozen=True)
class BodyParameters(Estimates):
    """Absolute values of a body on several suspensions; empty if they are not determined.

    Args:
        sprung_mass_kg: mass of the body.
        roll_inertia_kg_m2: roll inertia about the centre of gravity.
        pitch_inertia_kg_m2: pitch inertia about the centre of gravity.
        x_cg_m: x of the centre of gravity.
        y_cg_m: y of the centre of gravity.
    """

    sprung_mass_kg: Estimate = _NOTHING
    roll_inertia_kg_m2: Estimate = _NOTHING
    pitch_inertia_kg_m2: Estimate = _NOTHING
    x_cg_m: Estimate = _NOTHING
    y_cg_m: Estimate = _NOTHING


@dataclass(frozen=True)
class BodyRatios(Estimates):
    """Values of a rigid body that need no known mass.

    Args:
        roll_radius_m: radius of gyration in roll about the centre of gravity.
        pitch_radius_m: radius of gyration in pitch about the centre of gravity.
        x_cg_m: x of the centre of gravity.
        y_cg_m: y of the centre of gravity.
    """

    roll_radius_m: Estimate = _NOTHING
    pitch_radius_m: Estimate = _NOTHING
    x_cg_m: Estimate = _NOTHING
    y_cg_m: Estimate = _NOTHING


@dataclass(frozen=True)
class AtRest(Estimates):
    """A suspension at its rest position in one run.

    Args:
        run: name of the run.
        travel_m: travel from the rest position in the reference run, extension positive; empty if no weight acts, or if
            the mass is not determined.
        stiffness: tangent stiffness of the whole spring force there, in the unit of the suspension's stiffness.
        damping: damping that would dissipate as much over the motion of this run, in the unit of the damping.
        travelled_m: lowest and highest travel of the run, from the rest position in the reference run.
        loop: hysteresis loop of the terms with memory, for a sine of the size and pace of the travel in this run; None
            without memory.
    """

    run: str
    travel_m: Estimate
    stiffness: Estimate
    damping: Estimate
    travelled_m: tuple[float, float]
    loop: Loop | None = None


@dataclass(frozen=True, eq=False)
class SpringEstimate(Estimates):
    """A suspension, or a joint inside of a structure.

    Args:
        name: name of the interface, of the degree of freedom that the suspension carries, or of the joint.
        stiffness: K, N/m; if the mass is not determined (`per_mass` of the identification) per kg of the body, or of
            the first unknown mass of a user's own structure.
        damping: C, N s/m, or per kg as the stiffness.
        law: f(z, z') beside them, N, or per kg as the stiffness; linear for a joint.
        law_estimates: {kind: {parameter: Estimate}} of the law.
        travel: (n,) z of all runs, thinned for figures, m.
        velocity: (n,) z', m/s.
        rest_m: rest position on its law in the reference run, from the origin of the law; 0 if it rests at the origin.
        at_rest: the suspension at rest in each run; empty for a joint.
    """

    name: str
    stiffness: Estimate
    damping: Estimate
    law: Law
    law_estimates: Mapping[str, Mapping[str, Estimate]]
    travel: FloatArray
    velocity: FloatArray
    rest_m: Estimate
    at_rest: tuple[AtRest, ...]


@dataclass(frozen=True)
class GasColumn(Estimates):
    """The gas that carries a suspension, in the reference run, or where the travel of a strut on the bench is zero.

    Args:
        content_n_m: absolute pressure times volume, which no loading changes: it falls if gas leaks, and rises if gas
            replaces oil.
        pressure_pa: gauge pressure there; empty if the area of the piston is not stated.
        volume_m3: volume there; empty if the area of the piston is not stated.
    """

    content_n_m: Estimate = _NOTHING
    pressure_pa: Estimate = _NOTHING
    volume_m3: Estimate = _NOTHING


@dataclass(frozen=True, eq=False)
class InterfaceEstimate(SpringEstimate):
    """One suspension of a body.

    Args:
        shared_with: interfaces with the same stiffness, damping and law.
        ground_stiffness: stiffness of a spring from the body to the ground, N/m, or per kg as the stiffness; 0 if the
            runs do not demand one.
        residual_over_noise: rms of the prediction errors of its sensor on the body, over the noise known beforehand.
        gas: the gas that carries it; None if no gas is found, or if the mass is not determined.
    """

    shared_with: tuple[str, ...]
    ground_stiffness: Estimate
    residual_over_noise: float
    gas: GasColumn | None = None


@dataclass(frozen=True)
class Candidate:
    """One structure that was tried on the same data.

    Args:
        kind: "single", "pair" or "rigid_body".
        interfaces: names of its interfaces; a pair is their mean.
        sprung_mass_kg: the mass found: of the whole body, or of the part that rests on one gear.
        residual_over_noise: rms of the prediction errors over the noise known beforehand.
        left_out_over_noise: the same for runs predicted from the others; None for a single run, or if the others cannot
            be fitted.
        law: name of the law found.
        explains: whether the residual is noise, also in runs predicted from the others.
        recommended: whether this structure is recommended.
        why: the reason, one sentence.
    """

    kind: str
    interfaces: tuple[str, ...]
    sprung_mass_kg: Estimate
    residual_over_noise: float
    left_out_over_noise: float | None
    law: str
    explains: bool
    recommended: bool
    why: str

    @property
    def label(self) -> str:
        """Name of the structure in tables and figures."""
        if self.kind == "rigid_body":
            return "rigid body"
        names = ", ".join(self.interfaces)
        return f"mean {names}" if self.kind == "pair" else f"{names} alone"


@dataclass(frozen=True, eq=False)
class RunResidual:
    """Residual of the model in one run.

    Args:
        name: name of the run.
        mass_change_kg: mass of its loading.
        frequency_hz: (n_lines,) lines that were compared.
        residual: (n_sensors, n_lines) magnitude of the whitened errors; the square has mean 1 if the noise is as
            assumed.
        time_s: (n,) time of the samples for figures.
        measured: (n_sensors, n) accelerations of the body, m/s^2.
        predicted: (n_sensors, n) predictions from all earlier readings, m/s^2.
        loading: rows (mass kg, x m, y m).
        unexplained: rms error of the model's free motion in the band, as a fraction of the rms of the readings; the
            largest of several fits.
    """

    name: str
    mass_change_kg: float
    frequency_hz: FloatArray
    residual: FloatArray
    time_s: FloatArray
    measured: FloatArray
    predicted: FloatArray
    loading: tuple[tuple[float, float, float], ...]
    unexplained: float


@dataclass(frozen=True)
class Equivalent(Estimates):
    """The linear suspension that is nearest to the suspension of one gear over the motion of a run.

    Args:
        run: name of the run.
        stiffness_per_mass: stiffness over the mass of that run, 1/s^2.
        damping_per_mass: damping over the mass of that run, 1/s.
        natural_frequency_hz: natural frequency of that mass on it, Hz.
        damping_ratio: damping ratio of that mass on it.
    """

    run: str
    stiffness_per_mass: Estimate = _NOTHING
    damping_per_mass: Estimate = _NOTHING
    natural_frequency_hz: Estimate = _NOTHING
    damping_ratio: Estimate = _NOTHING


@dataclass(frozen=True, eq=False)
class Evidence:
    """The evidence for the numbers of one fitted structure.

    Args:
        fit: the fitted model.
        noise: the noise level known before the fit, m/s^2.
        ladder: the laws that were tried; the last one that was kept is the chosen one.
        alternatives: laws that explain the runs as well, one sentence each.
        demands: ground springs and sensor faults that were added to the model.
        implausible: faults of sensors that would explain much of the residual, but were not added because they are far
            larger than sensors have; there are no intervals then.
        whiteness: whiteness of the residual, for the worst sensor and run.
        std_over_white: factor by which a coloured residual widens the interval of each shared parameter, by name.
        bootstrap_over_white: the same factor from resampled blocks of time.
        surfaces: force without a law compared with the law, cell by cell, for each group.
        ground: how well a spring to the ground is distinguished from zero and from faults of sensors.
        limits: what limits the precision, one sentence each.
        repeatability: repeatability of the suspensions in the runs.
        n_starts: number of attempts from start values.
        error: what limits the answer if the residual exceeds the noise; else None.
        interfaces: indices of its interfaces in the study; a pair has two and is their mean.
        covariance: (n_unknowns, n_unknowns) of the fitted vector, from which the intervals follow.
        gains_of_forces: what each sensor of a force reads for 1 N, by its channel; empty if the mass is not known.
    """

    fit: Fit
    noise: float
    ladder: tuple[LawStep[Fit], ...]
    alternatives: tuple[str, ...]
    demands: tuple[Demand, ...]
    implausible: tuple[Demand, ...]
    whiteness: Whiteness
    std_over_white: Mapping[str, float]
    bootstrap_over_white: Mapping[str, float]
    surfaces: Mapping[str, ForceSurface]
    ground: GroundImitations
    limits: tuple[str, ...]
    repeatability: Repeatability
    n_starts: int
    error: ModelError | None
    interfaces: tuple[int, ...]
    covariance: FloatArray
    gains_of_forces: Mapping[str, Estimate]


@dataclass(frozen=True)
class Options:
    """The options of the call.

    Args:
        law: name of the law that was given; None if it was searched.
        ground: whether springs to the ground were allowed.
        method_of_law: the method of the search for laws.
        kinds: the kinds of terms that were searched.
        seed: seed of the resampling that checks the intervals.
    """

    law: str | None
    ground: bool
    method_of_law: str
    kinds: tuple[str, ...]
    seed: int


class ResultOfStudy(Result):
    """A result that was made from the logs of a study alone."""

    study: Study

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The logs of the runs, as they were when they were read."""
        return self.study.files


@dataclass(frozen=True, eq=False, repr=False)
class Identification(ResultOfStudy):
    """The result for a body on suspensions that are measured on both sides, a gear alone among them.

    Args:
        study: the study that was identified.
        structure: kind of the structure that the numbers belong to.
        parameters: absolute values of one gear, or of a body on several suspensions.
        ratios: values of one gear, or of a body, that need no known mass.
        per_mass: whether stiffness, damping and laws are per kg of the body (for gears alone, of the mass on that
            gear), because the mass is not determined.
        interfaces: the suspensions, in the order of the study.
        place_corrections: {"x_m[left]": Estimate, ...}, corrections of coordinates that have a standard deviation.
        candidates: structures that were compared, with the recommended one marked.
        why: reason for this structure.
        runs: residual of the model in each run.
        noise_m_per_s2: noise of the sensors that was known beforehand or estimated from the records.
        residual_over_noise: residual of the whole fit over the noise.
        evidence: evidence of each fit that belongs to the answer.
        mended_spikes: number of single samples that were mended, below and on the body.
        warnings: the warnings, one sentence each.
        not_determined: why there are no absolute values, or no values at all; None if there are.
        options: the options of the call.
        settings: settings of the estimator.
        equivalents: equivalent linear suspension of one gear in each run.
        weighed: masses of runs by a scale, beside the identified ones.
    """

    study: Study
    structure: str
    parameters: GearParameters | BodyParameters
    ratios: GearRatios | BodyRatios
    per_mass: bool
    interfaces: tuple[InterfaceEstimate, ...]
    place_corrections: Mapping[str, Estimate]
    candidates: tuple[Candidate, ...]
    why: str
    runs: tuple[RunResidual, ...]
    noise_m_per_s2: float
    residual_over_noise: float
    evidence: tuple[Evidence, ...]
    mended_spikes: tuple[int, int]
    warnings: tuple[str, ...]
    not_determined: str | None
    options: Options
    settings: Settings
    equivalents: tuple[Equivalent, ...] = ()
    weighed: tuple[WeighedMass, ...] = ()

    @property
    def limited_by(self) -> Limit | None:
        """What limits the precision: "noise" of the sensors, "unmeasured forces", or the "model" itself.

        None if the answer is refused and the model explains nothing of the motion: such a fit does not show the reason.

        The residual of one gear is examined where it is worth a warning. A residual of a body on several suspensions
        above the noise counts as the model's, unless that of a rigid body is incoherent with the motion below it.
        """
        unexplained = float(np.sqrt(np.mean(np.square([run.unexplained for run in self.runs]))))
        if self.is_refused and not unexplained < 1.0:
            return None
        errors = [each.error for each in self.evidence if each.error is not None]
        if errors:
            return errors[0].limit
        is_noise = self.study.is_one_gear or self.residual_over_noise <= self.settings.verdicts.explained
        return "noise" if is_noise else "model"

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        """Prediction of each run from the others; empty if the residual is noise, or if a prediction fails."""
        return tuple(left for each in self.evidence if each.error is not None for left in each.error.left_out)

    @property
    def method(self) -> str:
        """Method of the identification."""
        return "model"

    @property
    def title(self) -> str:
        """Title of the study."""
        return self.study.title

    @property
    def date(self) -> date | None:
        """Date of the runs; None if it is not known."""
        return self.study.date

    @property
    def law(self) -> Law:
        """The law of the first suspension, N, or per unit of mass."""
        return self.interfaces[0].law if self.interfaces else LINEAR

    @property
    def law_estimates(self) -> Mapping[str, Mapping[str, Estimate]]:
        """Estimates of the law of the first suspension."""
        return self.interfaces[0].law_estimates if self.interfaces else {}

    @property
    def units(self) -> tuple[str, str]:
        """Units of stiffness and damping."""
        return units_of_suspensions(per_mass=self.per_mass)

    @property
    def recommended(self) -> Candidate | None:
        """The structure that is recommended, if one is."""
        return next((candidate for candidate in self.candidates if candidate.recommended), None)

    @property
    def reason(self) -> str:
        """Why the structure is recommended, compared with the others if there are any."""
        return self.why or ("" if self.recommended is None else self.recommended.why)

    @property
    def alternative_laws(self) -> tuple[str, ...]:
        """Other laws that explain the runs as well, one sentence each."""
        return tuple(sentence for part in self.evidence for sentence in part.alternatives)

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return parameters, suspensions with their laws, and the ratios that need no known mass."""
        rows = list(estimate_rows(self.parameters))
        if self.study.is_one_gear:
            rows += law_rows(self.law, self.law_estimates, "law", per_mass=self.per_mass)
        else:
            for interface in self.interfaces:
                rows += spring_rows(interface, per_mass=self.per_mass)
        shown = {row.name for row in rows}
        return (*rows, *(row for row in estimate_rows(self.ratios) if row.name not in shown))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, see `opid.suspensions.answer.as_json.result_json`."""
        from opid.suspensions.answer.as_json import result_json

        return result_json(self)

    def _write_headline(self) -> str:
        kind = f"one gear, law {self.law.name}" if self.study.is_one_gear else self.structure.replace("_", " ")
        return f"{self.title or 'without a title'} ({kind})"

    @property
    def frequency_of(self) -> FrequencyOf:
        """The part of the force that the natural frequency and the damping ratio of one gear belong to.

        The "linear part" of the force is K2 (and K3) with C2. It is the "tangent at rest" if the law has a slope there.
        If the law has memory, it is "all but what the law remembers": in small or quick motion such a suspension is
        stiffer, and the equivalents give its frequency in the motion of each run.
        """
        if not self.interfaces:
            return "linear part"
        if self.law.has_memory:
            return "all but what the law remembers"
        rest_m = self.interfaces[0].rest_m.value or 0.0
        return "tangent at rest" if slopes_at_rest(self.law.resting_at(rest_m)) else "linear part"

    @property
    def places(self) -> dict[str, tuple[float, float, float, float]]:
        """{interface: (x, y, sensor x, sensor y)}, m, as stated."""
        return {each.name: (*each.place, *each.sensor_place) for each in self.study.interfaces}

    @property
    def is_refused(self) -> bool:
        """Whether no number of the model is reported."""
        return self.interfaces[0].stiffness.value is None

    @cached_property
    def restoring_force(self) -> VisitedForce:
        """The force of the first suspension over the visited plane; empty if the answer is refused."""
        first, nothing = self.interfaces[0], np.empty(0)
        if first.stiffness.value is None or first.damping.value is None:
            return VisitedForce(nothing, nothing, nothing, nothing, per_mass=self.per_mass)
        return visited_force(
            first.travel,
            first.velocity,
            first.law,
            stiffness=first.stiffness.value,
            damping=first.damping.value,
            per_mass=self.per_mass,
        )

    @cached_property
    def paper_chain(self) -> PaperChain:
        """The steps of the paper on the runs of one gear, with the law that was found, for comparison in figures.

        Raises:
            InputError: channels that are no pair for the paper's chain, or runs that are too short for it.
        """
        from opid.suspensions.paper.chain import compute_chain

        fit = self.evidence[0].fit
        law, inverse_mass = fit.laws[fit.model.groups[0].name], fit.model.inverse_mass(fit.theta)
        if self.is_refused:  # a refused fit gives no force
            law, inverse_mass = LINEAR, 0.0
        return compute_chain(
            self.study,
            law_per_mass=law,
            inverse_mass=inverse_mass if fit.model.mass_free else 0.0,
            ground=self.options.ground,
            is_checked=True,
        )


def units_of_suspensions(*, per_mass: bool) -> tuple[str, str]:
    """Return the units of stiffness and damping.

    Args:
        per_mass: whether they are per kg.
    """
    return ("1/s^2", "1/s") if per_mass else ("N/m", "N s/m")


def estimate_rows(record: Estimates) -> Iterator[SummaryRow]:
    """Yield parameters or ratios as rows of a summary.

    Args:
        record: parameters or ratios of one gear, or of a body.
    """
    yield from (SummaryRow.of(name, estimate, UNITS[name]) for name, estimate in record.items())


def spring_rows(spring: SpringEstimate, *, per_mass: bool) -> Iterator[SummaryRow]:
    """Yield stiffness, damping and law of a suspension or joint as rows of a summary.

    Args:
        spring: the suspension.
        per_mass: whether its values are per kg.
    """
    stiffness, damping = units_of_suspensions(per_mass=per_mass)
    yield SummaryRow.of(f"{spring.name}.stiffness", spring.stiffness, stiffness)
    yield SummaryRow.of(f"{spring.name}.damping", spring.damping, damping)
    yield from law_rows(spring.law, spring.law_estimates, f"{spring.name}.law", per_mass=per_mass)
