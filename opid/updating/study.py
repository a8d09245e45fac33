"""An updating study: the structure, its measured backbones, the laws that are compared, and the settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np

from opid.errors import InputError, count_repeats, nearest, refuse
from opid.mechanics.backbones.harmonic_balance import harmonics_of
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.laws.law import Term
from opid.result import first_lines
from opid.updating.checks import day_faults, mode_faults, shortened
from opid.updating.likelihood.backbones import FORMS, Form, coefficient_of_variation, scatter_fault
from opid.updating.likelihood.noise import NoiseSettings
from opid.updating.measured import MeasuredBackbone, Place, by_mode
from opid.updating.model_class import ModelClass, Prior
from opid.updating.settings import UPDATING
from opid.updating.structure.affine import AffineStructure
from opid.updating.unmeasured_modes import PredictionSettings, prediction_faults, unseen_faults

Interaction = Literal["omit", "keep"]
INTERACTIONS: tuple[Interaction, ...] = get_args(Interaction)

Sampler = Literal["adaptive", "nuts", "transitional"]
SAMPLERS: tuple[Sampler, ...] = get_args(Sampler)

FEWEST_SAMPLES = 1000  # samples of all chains, the warm-up included: fewer give no reliable 95 % interval
MOST_SAMPLES = 100_000_000  # ... and more do not fit into the memory of usual machines


@dataclass(frozen=True, kw_only=True, eq=False)
class UpdatingSettings:
    """The settings of an updating.

    Args:
        form: form of the likelihood, see `opid.updating.backbone_data`.
        sampler: "adaptive" Metropolis, "nuts", which follows the slope of the posterior, or "transitional" Markov chain
            Monte Carlo.
        n_samples: number of samples of each class, in all chains, of which an eleventh is dropped, as in the paper.
        seed: seed of all random numbers; the same seed gives the same result.
        harmonics: harmonics of the model.
        n_internal: internal modes that the reduction keeps beside sensors and joints; all where there are fewer.
        n_confused: number of sets that are drawn with each class as the truth, to tell how often another class would be
            chosen; none where 0.
        is_joint: whether the factors of the linear stiffness are updated once more with the laws of each class, which
            the paper takes as known in its second phase.
        interaction: "omit" where the model runs smoothly past interactions with other modes, whose points are to be
            left out; "keep" where it pairs them with its loop.
        met_damping: damping ratio of the modes that a harmonic meets, which decides how far a test follows the loop;
            for "keep".
    """

    form: Form = "recommended"
    sampler: Sampler = "adaptive"
    n_samples: int = 5500
    seed: int = 0
    harmonics: tuple[int, ...] = (1, 3)
    n_internal: int = 15
    n_confused: int = 0
    is_joint: bool = False
    interaction: Interaction = "omit"
    met_damping: float | None = None

    @property
    def setting_faults(self) -> list[str]:
        """One clause for each setting that is wrong."""
        found = []
        for name, known in (("form", FORMS), ("sampler", SAMPLERS), ("interaction", INTERACTIONS)):
            if getattr(self, name) not in known:
                found.append(f"{name} is {getattr(self, name)!r}, give one of {', '.join(known)}")
        for name, least in (("n_samples", FEWEST_SAMPLES), ("seed", 0), ("n_internal", 0), ("n_confused", 0)):
            value = getattr(self, name)
            if value < least:
                found.append(f"{name} is {value}, give {f'at least {least}' if least else '0 or more'}")
        if self.n_samples > MOST_SAMPLES:
            found.append(f"n_samples is {self.n_samples}, give at most {MOST_SAMPLES}")
        if self.sampler == "nuts" and self.form != "recommended":
            found.append(f"sampler is 'nuts' in the form {self.form!r}, which has no slopes, take the recommended form")
        if self.n_confused and self.form != "recommended":
            found.append(f"n_confused is {self.n_confused} in the form {self.form!r}, take the recommended form")
        found += _list_interaction_faults(self)
        whole = all(isinstance(each, int | np.integer) and each >= 0 for each in self.harmonics)
        if 1 not in self.harmonics or not whole:
            found.append(f"harmonics are {list(self.harmonics)}, give 1 and others beside it, for example [1, 3]")
        return found


def _list_interaction_faults(settings: UpdatingSettings) -> list[str]:
    keeps, damping = settings.interaction == "keep", settings.met_damping
    if not keeps:
        unused = f"met_damping is {damping} and interaction {settings.interaction!r}, take interaction = 'keep'"
        return [] if damping is None else [f"{unused}, or leave it out"]
    found = []
    if damping is None or not 0.0 < damping < 1.0:
        given = "missing" if damping is None else damping
        found.append(
            f"met_damping is {given} and interaction 'keep', give the damping ratio of the modes that a harmonic "
            "meets, such as 0.002"
        )
    if settings.form != "recommended":
        found.append(f"interaction is 'keep' in the form {settings.form!r}, take the recommended form")
    if not any(h > 1 for h in settings.harmonics):
        found.append(f"interaction is 'keep' and harmonics are {list(settings.harmonics)}, give higher ones, too")
    return found


@dataclass(frozen=True, eq=False)
class UpdatingStudy(UpdatingSettings):
    """The data of a Bayesian updating and its settings, which `UpdatingSettings` explains.

    Args:
        title: the title of the study.
        structure: a finite-element structure, which will be reduced; or its modes, which are taken as they are.
        backbones: the measured backbones.
        classes: the laws that are compared; at least one.
        parameters: prior of each stiffness factor that phase I updates, by its name in the structure; without any the
            structure stays as it is.
        linear_classes: sets of these factors by a name, of which phase I chooses one by its evidence; a factor that a
            set leaves out stays at 1. All factors are updated where there is no set.
        noise: settings for the errors of the backbones.
        damping: damping ratio of each measured mode of the structure without its joints, and of other modes whose
            response is predicted, by its number: a number where it is known, else its prior. With it, the force of the
            backbones tells the damping; without any it is not used.
        places: where the sensors are, by their names, for the figures of shapes; all of them, or none.
        source: the study file, if there is one.
        prediction: modes without curves whose backbones are predicted, too, and responses to a force.

    Raises:
        InputError: everything that is wrong with it, at once.
    """

    title: str
    structure: AffineStructure | JointedModes
    backbones: tuple[MeasuredBackbone, ...]
    classes: tuple[ModelClass, ...]
    parameters: Mapping[str, Prior] = field(default_factory=dict)
    linear_classes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    noise: NoiseSettings = field(default_factory=NoiseSettings)
    source: Path | None = None
    places: Mapping[str, Place] = field(default_factory=dict)
    damping: Mapping[int, float | Prior] = field(default_factory=dict)
    prediction: PredictionSettings = field(default_factory=PredictionSettings)

    def __post_init__(self) -> None:
        for name in ("backbones", "classes", "harmonics"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for name in ("parameters", "places", "damping"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        sets = {name: tuple(factors) for name, factors in self.linear_classes.items()}
        object.__setattr__(self, "linear_classes", MappingProxyType(sets))
        refuse(list(_find_faults(self)), self.source)

    @property
    def n_kept(self) -> int:
        """Number of internal modes that the reduction keeps: those that are asked for, or all that there are."""
        if isinstance(self.structure, JointedModes):
            return self.n_internal
        held = {*self.structure.sensors, *chain(*self.structure.joints.values())}
        return min(self.n_internal, self.structure.n_dof - len(held))

    def __repr__(self) -> str:
        backbones = [f"backbone {each.name}: mode {each.mode}" for each in self.backbones]
        classes = [f"class {each.name}" for each in self.classes]
        lines = [*first_lines(backbones, "backbones"), *first_lines(classes, "classes")]
        return "\n".join([f"UpdatingStudy: {self.title}", *lines])


def _find_faults(study: UpdatingStudy) -> Iterator[str]:
    if not study.backbones:
        yield "there is no measured backbone, give at least one"
    if not study.classes:
        yield "there is no model class, give at least one law to try"
    for what, names in (
        ("backbones", [one.name for one in study.backbones]),
        ("classes", [one.name for one in study.classes]),
    ):
        for name, n in count_repeats(names).items():
            yield f"{n} {what} are called {name!r}, rename them"
    yield from study.setting_faults
    if study.is_joint and not study.parameters:
        yield "joint is true and no parameter of the structure is named, name those to update with the laws"
    elif study.is_joint and study.form != "recommended":
        yield f"joint is true in the form {study.form!r}, take the recommended form, which knows the errors it needs"
    yield from _find_damping_faults(study)
    known_joints = tuple(study.structure.joints)
    for each in study.classes:
        for joint in dict.fromkeys(joint for term in each.terms for joint in term.joints):
            if known_joints and joint not in known_joints:
                yield f"class {each.name!r} has a law at {joint!r}, which is no joint: {nearest(joint, known_joints)}"
    if not study.structure.joints:
        yield (
            "the structure has no joint, name the two degrees of freedom between which the nonlinear law acts, or the "
            "one of a joint to the ground"
        )
    if study.parameters and isinstance(study.structure, JointedModes):
        yield "parameters are named and the structure is given by its modes, give its matrices or name no parameter"
    elif isinstance(study.structure, AffineStructure):
        for name in study.parameters:
            if name not in study.structure.parts:
                known = ", ".join(study.structure.parts)
                hint = f"give some of {known}" if known else "it has no part to update"
                yield f"the structure has no parameter {name!r}: {hint}"
    for name, factors in study.linear_classes.items():
        for factor in (each for each in factors if each not in study.parameters):
            hint = nearest(factor, study.parameters) if study.parameters else "the study updates none"
            yield f"the linear class {name!r} has {factor!r}, which is no parameter to update: {hint}"
        if not factors or len(set(factors)) < len(factors):
            yield f"the linear class {name!r} has the parameters {list(factors)}, name at least one, and each once"
    alike: dict[tuple[str, ...], list[str]] = {}
    for one in study.backbones:
        unknown = tuple(name for name in one.sensors if name not in study.structure.sensors)
        alike.setdefault(unknown, []).append(one.name)
    for unknown, names in alike.items():
        if unknown:
            several = f"{len(names)} backbones ({shortened(names)}) have" if len(names) > 1 else ""
            subject = several or f"backbone {names[0]!r} has"
            yield f"{subject} the sensors {', '.join(unknown)}, which the structure does not have"
    yield from day_faults(study.backbones)
    yield from _find_place_faults(study)
    sensors = study.structure.sensors
    yield from prediction_faults(study.prediction, study.form, sensors, study.backbones, study.damping)
    if isinstance(study.structure, JointedModes):
        yield from mode_faults(study.structure, study.backbones)
        asked = [each for one in study.prediction.responses for each in (one.drive, one.seen_at)]
        if {*asked, study.prediction.sensor} <= {*sensors, None}:
            yield from unseen_faults(study.prediction, study.structure)
    for name, prior in study.parameters.items():
        high = prior.first + UPDATING.prior_reach * prior.second if prior.family == "normal" else prior.support[1]
        if high <= 0:
            yield f"the prior of {name!r} allows nothing above 0, a factor of stiffness is positive"
    if not study.setting_faults:  # a wrong list of harmonics is among these
        yield from _find_harmonic_faults(study)
    yield from _find_scatter_faults(study)
    yield from _find_memory_faults(study)


def _find_damping_faults(study: UpdatingStudy) -> Iterator[str]:
    """Yield what is missing for the damping, or does not belong together."""
    driven = sorted({one.mode for one in study.backbones if one.force_n is not None})
    dampers = [each.name for each in study.classes if each.dampers]
    if dampers and not study.damping:
        yield f"class {dampers[0]!r} has a damper, name the damping ratio of each mode with a force: damping"
    if not study.damping:
        return
    if study.form != "recommended":
        yield f"damping ratios are named in the form {study.form!r}, take the recommended form"
    if not driven:
        yield "damping ratios are named and no backbone has a force, name the drive point of those that have one"
    used = {*driven, *(one.mode for one in study.prediction.responses)}
    for mode in study.damping:
        if driven and mode not in used:
            yield f"the damping ratio of mode {mode} is named, and a force is known of {driven}, name these"
    for mode in driven:
        if mode not in study.damping:
            yield f"backbones of mode {mode} have a force and it has no damping ratio, name one, or leave 'drive' out"
    for mode, ratio in study.damping.items():
        middle = float(ratio.from_normal(0.0)[0]) if isinstance(ratio, Prior) else ratio
        if not 0.0 < middle <= 1.0:
            yield f"the damping ratio of mode {mode} is {ratio}, give a number between 0 and 1, or a prior of one"


def _find_memory_faults(study: UpdatingStudy) -> Iterator[str]:
    """Yield what needs the motion of joints with memory beyond their steady cycles at phase resonance."""
    names = [each.name for each in study.classes if each.slips]
    if not names:
        return
    if study.interaction == "keep":
        yield f"class {names[0]!r} has a joint with memory and interaction is 'keep', take 'omit'"
    if study.prediction.responses:
        yield f"class {names[0]!r} has a joint with memory, whose response to a force is not modelled, leave it out"


def _find_place_faults(study: UpdatingStudy) -> Iterator[str]:
    """Yield which places are those of no sensor, and which sensors have none though others have."""
    sensors = study.structure.sensors
    for name in study.places:
        if name not in sensors:
            yield f"the coordinates name the sensor {name!r}, which does not exist: {nearest(name, sensors)}"
    missing = [name for name in sensors if name not in study.places]
    if study.places and missing:
        yield f"there are no coordinates of the sensors {shortened(missing)}: give those of all sensors, or of none"


def _find_harmonic_faults(study: UpdatingStudy) -> Iterator[str]:
    """Yield which laws need a mean that the harmonics do not have, for they are not odd."""
    for each in study.classes:
        try:
            harmonics_of([Term(term.kind, term.scales) for term in each.terms], study.harmonics)
        except InputError as error:
            yield f"class {each.name!r}: {error}"


def _find_scatter_faults(study: UpdatingStudy) -> Iterator[str]:
    """Yield which modes have curves that do not show how lambda scatters, and which `cov` belongs to no mode."""
    curves_of, given = by_mode(study.backbones), study.noise.cov or {}
    weights = study.noise.weight if isinstance(study.noise.weight, Mapping) else {}
    for what, modes in (("cov", given), ("weight", weights)):
        for mode in modes:
            if mode not in curves_of:
                yield f"{what} names mode {mode}, which has no backbone, name some of {[*curves_of]}"
    for mode, curves in curves_of.items() if study.form != "recommended" else ():
        if mode in given:
            continue
        if not coefficient_of_variation(curves) > 0:
            yield scatter_fault(mode)
        elif study.parameters and len({float(one.frequency_hz[0]) for one in curves}) < 2:
            yield (
                f"the curves of mode {mode} begin at one frequency and show no scatter for the linear parameters, "
                f"give cov of mode {mode}"
            )
