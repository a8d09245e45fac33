"""Identification of a user's own structure on suspensions that are measured on both sides.

Examples are a machine on isolators, a car on its dampers, a building on its bearings: mass matrix and connections are
given, and laws, unknown joints and unknown masses are estimated from the runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, get_args

import numpy as np

from opid.errors import InputError, nearest, refuse
from opid.estimate import Estimate, Estimates
from opid.mechanics.laws.law import LINEAR, default_law
from opid.mechanics.structure import Structure
from opid.mechanics.weight import depends_on_travel
from opid.progress import Say
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.health.inspection import check_channels, findings_in_words, remove_spikes
from opid.signals.motion import integrate
from opid.signals.recording import FloatArray, Recording
from opid.suspensions.answer.intervals import Parameters, limits_of_mass
from opid.suspensions.answer.numbers import at_rest
from opid.suspensions.answer.warnings import WITHOUT_INTERVALS, run_differences, warn_of_exponents
from opid.suspensions.candidates import (
    Arrays,
    FittedStructure,
    StructureData,
    Task,
    fall_of,
    fit_structure,
    is_mass_free,
)
from opid.suspensions.fitting.fit import Fit, fastest_rate, first_vector
from opid.suspensions.fitting.noise import known_noise, measure_whiteness, sensor_ratio, thin_samples
from opid.suspensions.fitting.repeatability import Repeatability
from opid.suspensions.fitting.search import Question
from opid.suspensions.fitting.start import Start
from opid.suspensions.law_search.pursuit import library
from opid.suspensions.model.body import Body, own_body
from opid.suspensions.model.driven_model import Model
from opid.suspensions.model.run import DrivenRun, driven_run
from opid.suspensions.model.unknowns import Group
from opid.suspensions.result import AtRest, SpringEstimate, spring_rows
from opid.suspensions.sensor_facts import IDEAL, SensorFacts, Sensors, ideal_sensors
from opid.suspensions.settings import Settings, Verdicts
from opid.suspensions.study import SAME_RATE, Axis, repeatability_faults

SCHEMA = "opid.structure/1"
NEGATIVE = (
    "the mass of {} would be negative: check the signs of the loadings and of the stated masses, and whether two runs "
    "are exchanged"
)


@dataclass(frozen=True, eq=False, repr=False)
class StructureIdentification(Result, Estimates):
    """The result for a user's own structure.

    Args:
        masses: the unknown masses by degree of freedom, kg; over the first of them with `per_mass`.
        interfaces: the suspensions, by degree of freedom.
        joints: the unknown joints, by name.
        per_mass: whether only ratios to the first unknown mass are reported, because nothing gives the scale, or
            because that mass would have no upper bound or be negative.
        noise_m_per_s2: noise of the sensors that was known beforehand or estimated from the records.
        residual_over_noise: residual of the whole fit over the noise.
        residual_of: residual over the noise of the sensor at each degree of freedom.
        left_out_over_noise: residual over the noise of runs predicted from the others; None for a single run, or if the
            others cannot be fitted.
        repeatability: repeatability of the suspensions in the runs.
        limits: what limits the mass, one sentence each.
        warnings: the warnings, one sentence each.
        not_determined: what the runs do not determine; None if they determine all.
        fit: the fit that the numbers were read from.
        settings: every tuned number of the estimator.
        files: logs of the runs, as they were when they were read.
    """

    masses: Mapping[str, Estimate]
    interfaces: Mapping[str, SpringEstimate]
    joints: Mapping[str, SpringEstimate]
    per_mass: bool
    noise_m_per_s2: float
    residual_over_noise: float
    residual_of: Mapping[str, float]
    left_out_over_noise: float | None
    repeatability: Repeatability
    limits: tuple[str, ...]
    warnings: tuple[str, ...]
    not_determined: str | None
    fit: Fit
    settings: Settings = field(default_factory=Settings)
    files: tuple[ReadFile, ...] = ()

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the masses, the suspensions with their laws, and the joints."""
        masses = (
            SummaryRow.of(f"{name}.mass", each, "1" if self.per_mass else "kg") for name, each in self.masses.items()
        )
        springs = (*self.interfaces.values(), *self.joints.values())
        return (*masses, *(row for each in springs for row in spring_rows(each, per_mass=self.per_mass)))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, see `opid.suspensions.answer.as_json.structure_json`."""
        from opid.suspensions.answer.as_json import structure_json

        return structure_json(self)

    def _write_headline(self) -> str:
        names = [*self.interfaces, *self.joints]
        return f"{', '.join(names)}; the residual is {self.residual_over_noise:.3g} times the sensors' noise"


def identify_structure(
    structure: Structure,
    runs: Sequence[Recording],
    *,
    interfaces: Mapping[str, str],
    sensors: Mapping[str, str],
    unknown: Sequence[str] = (),
    unknown_mass: Sequence[str] = (),
    law: str | None = None,
    loadings: Sequence[Mapping[str, float]] | None = None,
    start: Mapping[str, tuple[float, float]] | None = None,
    noise_m_per_s2: float | None = None,
    axis: Axis | Mapping[str, Axis] | None = None,
    repeatability: float | None = None,
    settings: Settings | None = None,
    progress: Say | None = None,
) -> StructureIdentification:
    """Identify the suspensions of a structure, and its unknown joints and masses.

    Every sensor on the structure is predicted from all sensors below its suspensions. The values that the structure has
    for unknown joints and masses are start values if the sensors do not see all degrees of freedom, and unused
    otherwise.

    Args:
        structure: mass, damping and stiffness matrices, and linear joints, of what the suspensions carry.
        runs: recordings of accelerations, m/s^2, all at one rate.
        interfaces: channel below each suspension, by the degree of freedom that it carries.
        sensors: channel on the structure, by degree of freedom.
        unknown: names of joints with unknown stiffness and damping.
        unknown_mass: degrees of freedom with an unknown mass. The masses are found in kg if another mass or spring is
            known or the loading changes, otherwise as ratios to the first of them.
        law: law of every suspension (`opid.laws.LAWS`, sums joined by "+"); it is searched if left out.
        loadings: for each run the masses, kg, that it carries in addition to the structure, by degree of freedom.
        start: approximate stiffness (N/m) and damping (N s/m) of each suspension, by degree of freedom: needed if the
            sensors do not see all degrees of freedom.
        noise_m_per_s2: rms of the white noise of all sensors, m/s^2; it is estimated if left out.
        axis: direction in which the degrees of freedom count positive, "up" or "down", and "horizontal" for those that
            no weight moves, rotations among them: one for all, or {degree of freedom: axis}. If it is left out, no
            weight acts, and a warning says so if it would matter.
        repeatability: relative standard deviation by which springs, damping and friction of a suspension differ from
            run to run; 0 if they are known to be the same, the usual value if left out.
        settings: every tuned number of the estimator.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: unknown names, runs of different rates, not one loading for each run, an invalid axis or
            repeatability, or no start if one is needed.
        NotDeterminedError: the model cannot follow the runs.

    >>> carrier = Structure([[300.0]], [[0.0]], [[0.0]], names=("body",))
    >>> identify_structure(carrier, [], interfaces={"body": "hub"}, sensors={"body": "tower"})
    Traceback (most recent call last):
    opid.errors.InputError: there are no runs: give at least one recording
    """
    refuse(list(repeatability_faults(repeatability)), None)
    body = own_body(structure, tuple(interfaces), tuple(sensors), unknown=unknown, unknown_mass=unknown_mass)
    body = replace(body, fall=fall_of(axes_of(structure, axis)))
    arrays, settings = channel_arrays(runs, interfaces, sensors), settings or Settings()
    masses = loading_matrices(structure, loadings, len(runs))
    channel_warnings = warn_of_channels(runs, interfaces, sensors)
    fs = runs[0].fs
    facts = IDEAL if noise_m_per_s2 is None else SensorFacts(noise_m_per_s2=noise_m_per_s2)
    names = (*interfaces, *sensors)[: max(len(interfaces), len(sensors))]
    known = Sensors((facts,) * len(interfaces), (facts,) * len(sensors), names)
    noise = known_noise(known, arrays, fs=fs, settings=settings.runs)
    prepared = [
        driven_run(below, above, fs=fs, loading=loading, settings=settings.runs)
        for (below, above, _), loading in zip(arrays, masses, strict=True)
    ]
    kinds = None if law is None else default_law(law)
    groups = tuple(Group(name, (attachment,), kinds or LINEAR) for attachment, name in enumerate(interfaces))
    begun = None
    if np.linalg.matrix_rank(body.readings) < structure.n_dof:
        begun = make_stated_start(structure, prepared, body, groups, start or {}, unknown, unknown_mass, settings)
    # Joints of the structure may end at the ground, so a further ground spring is not searched.
    question = Question(kinds is not None, ground=False, faults=False, kinds=library())
    say, run_names = progress or (lambda step: None), tuple(names_of(runs))
    task = Task(None, arrays, known, noise, kinds, question, settings, say, run_names, repeatability)
    data = StructureData(tuple(prepared), body, groups, known)
    part = fit_structure(task, "own", tuple(range(len(groups))), data, noise.levels, start=begun)
    found = _make_answer(part, tuple(sensors), tuple(unknown), tuple(unknown_mass), knows_weight=axis is not None)
    found = replace(found, settings=settings, files=tuple(file for run in runs for file in run.files))
    return replace(found, warnings=(*channel_warnings, *found.warnings))


def _make_answer(
    part: FittedStructure,
    sensors: tuple[str, ...],
    unknown: tuple[str, ...],
    unknown_mass: tuple[str, ...],
    *,
    knows_weight: bool,
) -> StructureIdentification:
    fit, known, ratio, verdicts = part.fit, part.known, part.residual_over_noise, part.settings.verdicts
    scaled = fit.model.mass_free or fit.model.body.absolute
    masses = _estimate_masses(known, unknown_mass, per_mass=not scaled)
    # Without a finite reference mass no force is determined in N.
    per_mass = not scaled or (bool(unknown_mass) and masses[unknown_mass[0]].std is None)
    rests = at_rest(part, per_mass=per_mass)
    interfaces = {
        group.name: _estimate_suspension(part, number, per_mass, rests[number])
        for number, group in enumerate(fit.groups)
    }
    joints = {name: _estimate_joint(known, name, per_mass) for name in unknown}
    reason = _explain_refusal_or_no_scale(ratio, scaled, verdicts) or (
        NEGATIVE.format(unknown_mass[0])
        if known.has_negative_mass
        else _explain_not_determined(masses, interfaces, joints, part, _find_loose_joints(fit, unknown))
    )
    first = Estimate() if per_mass or reason or not unknown_mass else known.mass
    found = StructureIdentification(
        masses=_estimate_masses(known, unknown_mass, per_mass=per_mass),
        interfaces=interfaces,
        joints=joints,
        per_mass=per_mass,
        noise_m_per_s2=part.level,
        residual_over_noise=ratio,
        residual_of={
            name: sensor_ratio(fit, attachment) * fit.model.level / part.level
            for attachment, name in enumerate(sensors)
        },
        left_out_over_noise=part.left_out_over_noise,
        repeatability=part.repeatability,
        limits=tuple(limits_of_mass(part.repeatability, fit, first)),
        warnings=tuple(_list_warnings(part, interfaces, knows_weight=knows_weight)),
        not_determined=reason,
        fit=fit,
    )
    if part.explains:
        return found
    # A structure that does not explain the runs has no intervals; a refused one has no values.
    return found.with_estimates(Estimate.without_interval if ratio <= verdicts.refused else lambda each: Estimate())


def _estimate_masses(known: Parameters, unknown_mass: Sequence[str], *, per_mass: bool) -> dict[str, Estimate]:
    """Return the unknown masses, kg, or over the first of them, which is the reference."""
    model = known.fit.model
    found = {name: Estimate(1.0) if per_mass else known.mass for name in unknown_mass[:1]}
    for name, factor in zip(unknown_mass[1:], model.body.names, strict=True):
        found[name] = known.per_force(model.names.index(factor), per_mass=per_mass)
    return found


def _estimate_suspension(
    part: FittedStructure, number: int, per_mass: bool, rests: tuple[AtRest, ...]
) -> SpringEstimate:
    fit, known, group = part.fit, part.known, part.fit.groups[number]
    mu = 1.0 if per_mass else fit.model.inverse_mass(fit.theta)
    law = group.law.scaled(1 / mu) if group.law.terms else LINEAR
    stiffness, damping, estimates = known.suspension(number, per_mass=per_mass)
    travel, velocity = map(thin_samples, fit.motion(number))
    return SpringEstimate(group.name, stiffness, damping, law, estimates, travel, velocity, known.rest(number), rests)


def _estimate_joint(known: Parameters, name: str, per_mass: bool) -> SpringEstimate:
    fit, model = known.fit, known.fit.model
    first = model.names.index(f"stiffness_per_mass[{name}]", model.first_inside)
    stiffness, damping = (known.per_force(index, per_mass=per_mass) for index in (first, first + 1))
    attachment = model.body.n_interfaces + [spring.name for spring in model.body.inside].index(name)
    travel, velocity = map(thin_samples, fit.motion(attachment))
    return SpringEstimate(name, stiffness, damping, LINEAR, {}, travel, velocity, Estimate(0.0), ())


def _explain_refusal_or_no_scale(ratio: float, scaled: bool, verdicts: Verdicts) -> str | None:
    if ratio > verdicts.refused:
        return (
            f"the structure leaves {ratio:.0f} times the sensors' noise, so no number is reported: check channels, "
            "masses and loadings, and which joints there are"
        )
    if not scaled:
        return (
            "no mass is known and all runs have the same loading: only ratios to the first unknown mass are "
            "determined; give `loadings` to runs that carried more, or state a mass"
        )
    return None


def _explain_not_determined(
    masses: Mapping[str, Estimate],
    interfaces: Mapping[str, SpringEstimate],
    joints: Mapping[str, SpringEstimate],
    part: FittedStructure,
    not_held: Sequence[str],
) -> str | None:
    verdicts, too_fast = part.settings.verdicts, _describe_fast_motion(part.fit)
    known = [(f"the mass of {name}", each) for name, each in masses.items()]
    known += [(f"the stiffness of {name}", each.stiffness) for t in (interfaces, joints) for name, each in t.items()]
    loose = [
        name
        for name, each in known
        if each.std is None or each.value is None or each.std > verdicts.loosely_known * abs(each.value)
    ]
    loose += [f"the stiffness of {name}" for name in not_held if f"the stiffness of {name}" not in loose]
    # A joint that the runs do not determine can become too stiff for the steps of the model.
    if joints and too_fast:
        return f"these runs do not determine the stiffness of {', '.join(joints)}: {too_fast}"
    if loose and part.repeatability.rules_mass:
        remedy = ", or state a smaller `repeatability` if you know it" * bool(part.task.repeatability)
        return (
            f"these runs do not determine {', '.join(loose)}: springs, damping and friction may differ from run to run "
            f"by about {100 * part.task.prior_repeatability:.2g} %, which hides the effect of the loading; load more, "
            f"or repeat each loading{remedy}"
        )
    if loose:
        return f"these runs do not determine {', '.join(loose)}: measure at more places, or change the loading more"
    return None


def _find_loose_joints(fit: Fit, unknown: Sequence[str]) -> list[str]:
    """Return joints that might as well be soft: a free resonance always explains some of the noise."""
    found, n, known = [], fit.n_data, fit.model.settings.intervals
    cost = float(np.sum(fit.errors.stacked[:n] ** 2))
    behind_laws = fit.model.first_inside
    for name in unknown:
        theta = fit.theta.copy()
        for what in ("stiffness", "damping"):
            theta[fit.model.names.index(f"{what}_per_mass[{name}]", behind_laws)] *= known.softened
        softer = fit.model.evaluate(theta, sensitivity=False)
        if float(np.sum(softer.stacked[:n] ** 2)) - cost < known.least_hold * fit.variance:
            found.append(name)
    return found


def _list_warnings(
    part: FittedStructure, interfaces: Mapping[str, SpringEstimate], *, knows_weight: bool
) -> Iterator[str]:
    fit, ratio, left_out = part.fit, part.residual_over_noise, part.left_out_over_noise
    verdicts = part.settings.verdicts
    if ratio > verdicts.explained:
        yield (
            f"the structure leaves {ratio:.2f} times the sensors' noise: a joint, a mass, a law or a degree of "
            "freedom is not as described"
        )
        if ratio <= verdicts.refused:
            yield WITHOUT_INTERVALS
    elif left_out is not None and left_out > verdicts.explained:
        yield (
            f"runs that are predicted from the other runs leave {left_out:.3g} times the sensors' noise: the runs "
            f"contradict each other, check mass and position of each loading; {WITHOUT_INTERVALS}"
        )
    elif not measure_whiteness(fit).white:
        yield "the residual of the structure is not white: the intervals allow for it, a law may be missing"
    if ratio <= verdicts.refused:
        yield from run_differences(part)
        for name, each in interfaces.items():
            yield from (f"at {name!r}: {doubt}" for doubt in warn_of_exponents(each, part.settings.gas))
    loaded = any(run.loading.any() for run in fit.model.runs)
    if not knows_weight and loaded and any(map(depends_on_travel, fit.laws.values())):
        yield (
            "no `axis` is given, so no weight acts: if the degrees of freedom are vertical, each loading moves the "
            "suspensions along their laws, and masses and stiffness are wrong; give axis='up', 'down' or 'horizontal', "
            "or one for each degree of freedom"
        )
    if too_fast := _describe_fast_motion(fit):
        yield too_fast


def _describe_fast_motion(fit: Fit) -> str:
    rate, fs = fastest_rate(fit.model, fit.theta), fit.model.runs[0].fs
    if rate <= fit.model.settings.fit.fastest * fs:
        return ""
    return (
        f"the structure has a motion of {rate / (2 * np.pi):.3g} Hz, too fast for steps of {fs:.4g} Hz: record faster, "
        "or tie its degrees of freedom together"
    )


def channel_arrays(runs: Sequence[Recording], interfaces: Mapping[str, str], sensors: Mapping[str, str]) -> Arrays:
    """Return the accelerations below and on the structure of each run, single spikes mended.

    Returns:
        (n, n_interfaces), (n, n_sensors) and (n, 0) of each run, m/s^2.

    Raises:
        InputError: no runs or channels, a channel twice, one that is missing or no acceleration, different rates.
    """
    if not runs:
        raise InputError("there are no runs: give at least one recording")
    if not interfaces or not sensors:
        raise InputError(
            "give at least one interface and one sensor on the structure, each as degree of freedom: channel"
        )
    used = [*interfaces.values(), *sensors.values()]
    for name in used:
        if used.count(name) > 1:
            raise InputError(f"the channel {name!r} is named {used.count(name)} times: each sensor is one channel")
    for index, run in enumerate(runs, start=1):
        if abs(run.fs / runs[0].fs - 1) > SAME_RATE:
            raise InputError(f"run 1 has {runs[0].fs:.9g} Hz and run {index} has {run.fs:.9g} Hz: resample one of them")
        for name in used:
            if name not in run.names:
                raise InputError(f"run {index} has no channel {name!r}: {nearest(name, run.names)}")
            if run.unit(name) != "m/s^2":
                raise InputError(f"channel {name!r} of run {index} is in {run.unit(name)}: an acceleration is needed")

    def samples(run: Recording, names: Sequence[str]) -> FloatArray:
        return np.stack([remove_spikes(run.channel(name), fs=run.fs)[0] for name in names], axis=1)

    return [
        (samples(run, tuple(interfaces.values())), samples(run, tuple(sensors.values())), np.empty((run.n_samples, 0)))
        for run in runs
    ]


def names_of(runs: Sequence[Recording]) -> list[str]:
    """Return the names of the runs, which are their numbers."""
    return [str(number) for number in range(1, len(runs) + 1)]


def warn_of_channels(runs: Sequence[Recording], interfaces: Mapping[str, str], sensors: Mapping[str, str]) -> list[str]:
    """Return the warnings about the channels of all runs, one sentence each.

    Raises:
        InputError: two channels that make no pair.
    """
    pairs = [(below, sensors[name]) for name, below in interfaces.items() if name in sensors]
    used, found = [*interfaces.values(), *sensors.values()], list[str]()
    for run, name in zip(runs, names_of(runs), strict=True):
        found += findings_in_words(name, check_channels(run, pairs, used, run=name))
    return found


def loading_matrices(
    structure: Structure, loadings: Sequence[Mapping[str, float]] | None, n_runs: int
) -> list[FloatArray]:
    """Return the mass matrix of the loading of each run, (n_dof, n_dof) kg.

    Raises:
        InputError: not one loading for each run, an unknown degree of freedom, a mass that is no number.
    """
    given = [{}] * n_runs if loadings is None else list(loadings)
    if len(given) != n_runs:
        raise InputError(f"there are {len(given)} loadings for {n_runs} run(s): give one a run, {{}} for none")
    matrices = []
    for loading in given:
        diagonal = np.zeros(structure.n_dof)
        for name, mass_kg in loading.items():
            if not np.isfinite(mass_kg):
                raise InputError(f"the loading at {name!r} is {mass_kg}: give a mass in kg")
            diagonal[structure.index(name)] += mass_kg
        matrices.append(np.diag(diagonal))
    return matrices


def axes_of(structure: Structure, axis: Axis | Mapping[str, Axis] | None) -> list[Axis]:
    """Return the direction in which each degree of freedom counts positive, "horizontal" if none is given.

    Raises:
        InputError: an invalid axis, or an unknown degree of freedom.
    """
    allowed, found = get_args(Axis), list[Axis](["horizontal"] * structure.n_dof)
    if axis is None:
        return found
    named = axis if isinstance(axis, Mapping) else dict.fromkeys(structure.names, axis)
    for name, each in named.items():
        if each not in allowed:
            raise InputError(f"the axis of {name!r} is {each!r}: give one of {', '.join(map(repr, allowed))}")
        found[structure.index(name)] = each
    return found


def make_stated_start(
    structure: Structure,
    runs: Sequence[DrivenRun],
    body: Body,
    groups: tuple[Group, ...],
    start: Mapping[str, tuple[float, float]],
    unknown: Sequence[str],
    unknown_mass: Sequence[str],
    settings: Settings,
) -> Start:
    """Return start values from the user's values, for sensors that do not see all degrees of freedom.

    Raises:
        InputError: an unknown suspension in `start` or one that is missing, a joint without a stiffness.
    """
    hidden = f"the sensors see {np.linalg.matrix_rank(body.readings)} of {structure.n_dof} degrees of freedom"
    for name in start:
        if name not in [group.name for group in groups]:
            raise InputError(f"start has {name!r}, which is no interface: {nearest(name, [g.name for g in groups])}")
    missing = [group.name for group in groups if group.name not in start]
    if missing:
        raise InputError(
            f"{hidden}: give `start`, stiffness and damping roughly, of the suspension of {', '.join(missing)}"
        )
    joints = {joint.name: (joint.stiffness_n_per_m, joint.damping_n_s_per_m) for joint in structure.joints}
    for name in unknown:
        if joints[name][0] <= 0.0:
            raise InputError(f"{hidden}: give the joint {name!r} a stiffness from which to begin, N/m")
    indices = [structure.index(name) for name in unknown_mass]
    mass = np.diag(structure.mass)
    reference = float(mass[indices[0]]) if indices else 1.0
    # The springs have the order of the attachments, as in `body.inside`.
    springs = [start[group.name] for group in groups]
    springs += [joints[spring.name] for spring in body.inside if spring.stiffness_n_per_m is None]
    stiffness, damping = np.array(springs, dtype=np.float64).T / reference
    scaled = tuple(
        replace(group, law=group.law.scaled(1 / reference)) if group.law.terms else group for group in groups
    )
    mass_free = is_mass_free(runs, body)
    corner_hz = settings.start.high_pass_hz
    of_ground = [[integrate(u, fs=run.fs, high_pass_hz=corner_hz) for u in run.unsprung.T] for run in runs]
    rms = np.array([[[m.displacement.std(), m.velocity.std()] for m in motions] for motions in of_ground]).mean(axis=0)
    begun = Start(
        scaled,
        stiffness,
        damping,
        mass[indices[1:]] / reference,
        1 / reference if mass_free else None,
        rms,
        ground_stiffness=np.zeros(len(groups)),
        ground_std=np.ones(len(groups)),
        stiffness_beside_ground=stiffness[: len(groups)],
    )
    # The rms travel follows from a first prediction.
    sensors = ideal_sensors(body.n_interfaces, len(body.readings))
    noise = np.ones(body.n_interfaces), np.ones(len(body.readings))
    model = Model(tuple(runs), body, begun.groups, sensors, mass_free, rms, settings, noise=noise)
    predictions = model.evaluate(first_vector(model, begun), sensitivity=False).predictions
    moved = [[[p.travel[:, k].std(), p.velocity[:, k].std()] for k in range(len(groups))] for p in predictions]
    return replace(begun, motion_rms=np.mean(moved, axis=0))
