"""Warnings about an answer, one sentence each: records, residual, structure, demands, runs that differ, and gas."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from opid.estimate import Estimate
from opid.mechanics.laws.law import LAWS, Law
from opid.mechanics.repeatability import PARTS, part_of
from opid.signals.health.across_channels import find_unit_ratio
from opid.signals.health.inspection import findings_in_words
from opid.suspensions.answer.numbers import warn_of_area
from opid.suspensions.answer.refusals import ConfoundedTerm, describe_contact, worst_sensor
from opid.suspensions.candidates import Choice, FittedStructure
from opid.suspensions.fitting.noise import over_noise
from opid.suspensions.forces import warn_of_unused_forces
from opid.suspensions.model.unknowns import GROUND
from opid.suspensions.result import (
    Evidence,
    InterfaceEstimate,
    SpringEstimate,
)
from opid.suspensions.sensor_facts import SIDES
from opid.suspensions.settings import GasSettings, WarningSettings
from opid.suspensions.study import MeasuredInterface, Study, rigid_faults

WITHOUT_INTERVALS = "the intervals are withheld: the residual of the structure is not noise and does not average out"


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer that warnings are about.

    Args:
        choice: the structure that was chosen.
        evidence: the evidence of its parts.
        mass: the estimated mass.
        interfaces: the suspensions as they are reported.
        loose: motions whose inertia is hardly determined.
        confounded: terms of each part that may be stiffness or damping.
        per_mass: whether forces are reported per kg of the body.
        is_refused: whether no number is reported.
        mended_spikes: number of mended spikes below and on the body.
    """

    choice: Choice
    evidence: Sequence[Evidence]
    mass: Estimate
    interfaces: Sequence[InterfaceEstimate]
    loose: Sequence[str]
    confounded: Sequence[Sequence[ConfoundedTerm]]
    per_mass: bool
    is_refused: bool
    mended_spikes: tuple[int, int]


def collect_warnings(answer: Answer) -> Iterator[str]:
    """Yield the warnings about an answer, one sentence each."""
    choice = answer.choice
    for run in choice.study.runs:
        yield from findings_in_words(run.name, run.findings)
    if sum(answer.mended_spikes):
        below, above = answer.mended_spikes
        yield (
            f"{below + above} spike(s) of one sample were mended ({below} on the unsprung, {above} on the sprung "
            "channel)"
        )
    yield from _warn_of_record(choice)
    yield from _warn_of_levels(choice)
    yield from _warn_of_residual(answer) if choice.study.is_one_gear else _warn_of_structure(answer)
    # Faults and coordinates of a refused structure are not reported: they have no meaning.
    reported = [] if answer.is_refused else choice.parts
    for part in reported:
        yield from _warn_of_demands(part)
        yield from _warn_of_implausible_demands(part)
        yield from _warn_of_stated_facts(part)
        yield from run_differences(part)
    if reported:
        yield from _warn_of_ground(answer)
        yield from warn_of_signs(answer.interfaces)
        yield from warn_of_gas(answer.interfaces, choice.study.interfaces, choice.parts[0].settings.gas)
        yield from warn_of_stops(answer.interfaces)
        for part, evidence in zip(reported, answer.evidence, strict=True):
            yield from warn_of_unused_forces(choice.study, part, evidence.gains_of_forces)
    rules = any(each.repeatability.rules_mass for each in answer.evidence)
    if not any(part.fit.model.has_prior_mass for part in choice.parts):  # else the scale rests on what was weighed
        yield from _warn_of_scale(choice.study, answer.mass, choice.parts[0].settings.warnings, rules=rules)
    for motion in answer.loose:
        yield _describe_loose_motion(motion)
    for part in reported:
        yield from _warn_of_coordinates(part)
    for term in [term for terms in answer.confounded for term in terms] if reported else ():
        yield term.warning


def _warn_of_record(choice: Choice) -> Iterator[str]:
    """Yield warnings about the records, which no structure and no law changes."""
    study, settings = choice.study, choice.parts[0].settings.runs
    if study.structure.noise_m_per_s2 is None and not study.is_one_gear:
        yield (
            f"the noise of the sensors, {1e3 * max(part.level for part in choice.parts):.2g} mm/s^2, is estimated from "
            "their quietest spectra, which give an upper bound: state `noise_m_per_s2` if you know it"
        )
    if any(part.is_noise_of_fit for part in choice.parts):
        level = 1e3 * max(part.level for part in choice.parts if part.is_noise_of_fit)
        yield (
            "the noise of the sensors cannot be estimated from the spectra: where they are quietest they hold less "
            f"than {settings.least_noise_fraction:.1%} of the motion, as after a low-pass filter; the residual of the "
            f"model in the band, {level:.2g} mm/s^2, is taken as the noise; state `noise_m_per_s2` to check the model"
        )
    highest = settings.highest_fraction
    if highest * study.fs < settings.band_hz[1]:
        yield (
            f"the runs are sampled at {study.fs:g} Hz, and compared up to {highest * study.fs:.4g} Hz instead of "
            f"{settings.band_hz[1]:g} Hz, because the filters of loggers begin at {highest:g} of the rate: faster "
            f"motion is missing or aliased; record at {settings.band_hz[1] / highest:.4g} Hz or more, or give a band "
            "that ends below"
        )


def _warn_of_levels(choice: Choice) -> Iterator[str]:
    """Yield runs that are stronger than the first by the ratio of two units, if no model explains all runs."""
    study = choice.study
    if choice.lack <= choice.verdicts.explained:
        return
    names = (*study.channels("unsprung"), *study.channels("sprung"))
    first, *others = study.runs
    for run in others:
        ratios = [float(np.std(run.recording.channel(name)) / np.std(first.recording.channel(name))) for name in names]
        found = find_unit_ratio(ratios)
        if found:
            larger, smaller, apart = found
            mean = float(np.exp(np.mean(np.log(ratios))))
            yield (
                f"every channel of run {run.name!r} is {mean:.3g} times as strong as in run {first.name!r}, and "
                f"{larger} is {apart:.4g} {smaller}: unless road or speed differ as much, one of the two logs has "
                "another unit than stated; give the right `unit` in [runs.channels.NAME], or in the log's header"
            )


def _warn_of_residual(answer: Answer) -> Iterator[str]:
    """Yield the size of the residual of one gear, and the usual causes of such a residual."""
    (part,), (evidence,), verdicts = answer.choice.parts, answer.evidence, answer.choice.verdicts
    found, ratio = evidence.whiteness, part.residual_over_noise
    left_out, more = part.left_out_over_noise, part.settings.warnings.left_out_more
    if left_out is not None and ratio <= verdicts.noted and left_out > max(verdicts.noted, more * ratio):
        yield (
            f"runs that are predicted from the other runs leave {over_noise(left_out)} times the noise of the sensors: "
            "a mass change may not be as stated, or something has changed between the runs"
        )
    contradiction = _describe_noise_contradiction(part, is_white=found.white)
    if contradiction:
        yield contradiction
        return
    if found.white and ratio < verdicts.noted:
        return
    stands_out = (
        f"it is largest from {found.band_hz[0]:.2g} to {found.band_hz[1]:.2g} Hz ({found.excess:.1f} times its rms in "
        f"the whole band): {_explain_residual(part, found.band_hz)}"
    )
    if ratio > verdicts.noted:
        yield f"the residual is {ratio:.1f} times the noise of the sensors; {stands_out}"
        if part.error is not None and not part.implausible and not answer.is_refused:
            yield _describe_limit(part)
            contact = describe_contact(part)
            if contact:
                yield f"{contact}; the fitted law has this friction on the travel instead: take the frequency from here"
    else:
        size = "as small as" if ratio < verdicts.explained else f"{ratio:.1f} times"
        yield f"the residual is {size} the noise of the sensors and not white; {stands_out}; the intervals allow for it"


def _describe_noise_contradiction(part: FittedStructure, *, is_white: bool) -> str | None:
    """Return that sensors are noisier than stated, or much less noisy; None if the runs do not show this."""
    ratio, is_noisier = part.residual_over_noise, part.error is not None and part.error.limit == "noise"
    is_stated = all(each.noise_m_per_s2 for side in SIDES for each in part.task.sensors.facts(side))
    is_quieter = is_stated and is_white and ratio <= part.settings.warnings.least_of_stated_noise
    if not (is_noisier or is_quieter):
        return None
    stated, found = f"{1e3 * part.level:.2g} mm/s^2", f"{1e3 * ratio * part.level:.2g} mm/s^2"
    said = (
        f"the stated noise of the sensors, {stated}, contradicts the runs: the residual of the model is white, with "
        f"{found}"
    )
    if is_quieter:
        return f"{said}; sensor faults and terms of laws below the stated noise are missed: state {found}"
    return f"{said}, and no spectrum is quieter; the intervals allow for it: check the data sheet and the unit"


def _describe_limit(part: FittedStructure) -> str:
    """Return what limits an answer that leaves more than noise, in words."""
    assert part.error is not None  # more than noise is left
    least, most = (f"{100 * end(part.unexplained):.2g}" for end in (min, max))
    left = least if least == most else f"{least} to {most}"
    if part.error.limit == "model" and part.error.departure <= part.settings.process.same_std:
        if part.error.contradicts_a_fact:
            return (
                f"the answer is limited by the model, which leaves {left} % of the body's acceleration and contradicts "
                "what is known of a sensor: either is wrong, and the intervals are widened by the differences between "
                "pieces of the runs"
            )
        return (
            f"the answer is limited by the model, which leaves {left} % of the body's acceleration: another law of the "
            "library is expected to explain a part of that, so the given law is wrong; let the law be searched"
        )
    if part.error.limit == "model":
        return (
            f"the answer is limited by the model, which leaves {left} % of the body's acceleration: the parameters "
            "depend on how the errors are weighted by more than their intervals; the intervals are widened by this "
            "change, and by the differences between pieces of the runs"
        )
    return (
        f"the answer is limited by something that moves the body and that no sensor measured ({left} % of its "
        "acceleration): it does not bias the parameters, which do not depend on how the errors are weighted, and the "
        "intervals allow for it"
    )


def _explain_residual(part: FittedStructure, band_hz: tuple[float, float]) -> str:
    """Return the usual causes of a residual in a band."""
    fit, other = part.fit, "other than the given one" if part.law_is_given else "outside the library"
    square = fit.theta[0] + fit.value(fit.model.groups[0].name_of(GROUND))
    settings = fit.model.settings.warnings
    resonance_hz = float(np.sqrt(max(square, 0.0))) / (2 * np.pi)
    if band_hz[1] < settings.slow_fraction * resonance_hz:
        return f"AC coupling, a drifting sensor or a law of the travel {other} can cause such slow motion"
    if band_hz[0] > settings.fast_fraction * resonance_hz:
        return (
            "a second resonance (a roll, pitch or bending mode, a loose bracket) or a lag between the channels can "
            "cause this"
        )
    return (
        f"roll or pitch of a body on several gears, a law {other}, memory in the strut, or motion across the axis can "
        "cause this"
    )


def _warn_of_structure(answer: Answer) -> Iterator[str]:
    choice = answer.choice
    study, parts, ratio, lack, verdicts = choice.study, choice.parts, choice.ratio, choice.lack, choice.verdicts
    for part, evidence in zip(parts, answer.evidence, strict=True):
        contradiction = _describe_noise_contradiction(part, is_white=evidence.whiteness.white)
        if contradiction:
            yield contradiction
    if any(part.is_pushed for part in parts):
        yield choice.why
        yield from map(_describe_limit, parts)
    elif lack > verdicts.explained and not choice.explains:
        named = verdicts.explained < ratio <= verdicts.refused
        yield choice.why + (worst_sensor(study, parts) if named else "")
        more = parts[0].settings.warnings.left_out_more_of_body
        if ratio <= verdicts.explained or (lack > more * ratio and ratio <= verdicts.refused):
            yield (
                f"runs that are predicted from the other runs leave {over_noise(lack)} times the noise: the mass or "
                "the position of a loading may not be as stated, or something has changed between the runs"
            )
        if ratio <= verdicts.refused:
            yield WITHOUT_INTERVALS
    elif not all(each.whiteness.white for each in answer.evidence):
        yield (
            "the residual of the structure is small but not white: a law or a coordinate may be missing; the intervals "
            "allow for this"
        )
    untold = [part for part in parts if part.left_out_over_noise is None and not part.is_hopeless]
    if len(study.runs) > 1 and not all(part.error is not None and part.error.left_out for part in untold):
        yield (
            "the model cannot be fitted when one of the runs is left out, so the prediction of each run from the "
            "others is not tested; check the loading of each run"
        )
    rigid = [part for part in choice.tried if part.kind == "rigid_body"]
    if study.structure.kind == "auto" and len(study.interfaces) > 1 and not rigid:
        yield f"one rigid body was not tried: {'; '.join(rigid_faults(study))}"
    for part in rigid:
        if part.has_fit and not part.explains and part not in parts:
            yield (
                f"one rigid body leaves {over_noise(part.residual_over_noise)} times the noise"
                f"{worst_sensor(study, [part])}: look at that sensor first"
            )


def _warn_of_demands(part: FittedStructure) -> Iterator[str]:
    for hypothesis in dict.fromkeys(demand.hypothesis for demand in part.demands):
        mine = [demand for demand in part.demands if demand.hypothesis == hypothesis]
        values = ", ".join(f"{each.name} = {each.value:.4g} with standard deviation {each.std:.1g}" for each in mine)
        also = f"; {' and '.join(mine[0].alike)} would explain the runs as well" if mine[0].alike else ""
        stated = " that the study does not state"
        if hypothesis.is_stated:
            stated = " than the study states without a tolerance"
        yield (
            f"{hypothesis.words}{stated} was added to the model ({values}), because it reduces the error from "
            f"{1e3 * mine[0].error_before:.3g} to {1e3 * mine[0].error_after:.3g} mm/s^2{also}"
        )


def _warn_of_implausible_demands(part: FittedStructure) -> Iterator[str]:
    for hypothesis in dict.fromkeys(demand.hypothesis for demand in part.implausible):
        mine = [demand for demand in part.implausible if demand.hypothesis == hypothesis]
        values = ", ".join(f"{each.name} = {each.value:.3g}" for each in mine)
        less = 1e3 * mine[0].error_after, 1e3 * mine[0].error_before
        yield (
            f"{hypothesis.words} ({values}) would reduce the error from {less[1]:.3g} to {less[0]:.3g} mm/s^2, but was "
            "not added to the model: it is far larger than such sensors have, and may compensate for something else "
            "(a unit, a channel, a law); the intervals are withheld: check the sensors, and state their properties "
            "under [sensors]"
        )


def _warn_of_stated_facts(part: FittedStructure) -> Iterator[str]:
    """Yield stated facts of sensors that the fit contradicts: they are wrong, or compensate for something else."""
    demanded = {demand.name for demand in part.demands}
    what = {
        "gain": "gain",
        "corner": "corner of the AC coupling",
        "lag": "delay",
        "drift": "drift of the clock",
        "leak": "cross-axis leak",
    }
    units = {"corner": " Hz", "lag": " s", "drift": " s/s"}
    source = dict.fromkeys(what, "the data sheet") | {"leak": "the data sheet and how the sensor is fastened"}
    lower, upper = part.fit.model.bounds()
    for fault in part.fit.model.faults:
        value = part.fit.value(fault.name)
        off = abs(value - fault.nominal) / fault.std
        if fault.name in demanded or off <= part.settings.faults.contradicted_std:
            continue
        unit = units.get(fault.kind, "")
        index, model = part.fit.model.names.index(fault.name), part.fit.model
        where = model.describe_sensor(fault)
        if fault.run is not None:
            where += f" in run {model.sensors.runs[fault.run]!r}"
        # The value may lie beyond the bound of the fit.
        more = " or less" * bool(value <= lower[index]) + " or more" * bool(value >= upper[index])
        yield (
            f"the stated {what[fault.kind]} of the {where}, "
            f"{fault.nominal:.3g}{unit} with standard deviation {fault.std:.2g}{unit}, contradicts the runs, "
            f"which show {value:.3g}{unit}{more} ({off:.1f} standard deviations away): check {source[fault.kind]}, "
            "or state a larger standard deviation"
        )


def _warn_of_ground(answer: Answer) -> Iterator[str]:
    first = answer.interfaces[0]
    ground, stiffness = first.ground_stiffness.value, first.stiffness.value
    if (
        not answer.choice.study.is_one_gear
        or ground is None
        or stiffness is None
        or abs(ground) <= answer.choice.parts[0].settings.intervals.negligible_ground * abs(stiffness)
        or first.ground_stiffness.holds(0.0)
    ):
        return
    sentences = answer.evidence[0].ground.sentences
    imitations = "; ".join(sentences) or "none of the usual faults of the sensors has nearly the same effect"
    yield (
        f"the ground spring K3 = {ground:.3g} N/m{' per kg' * answer.per_mass} differs from zero, yet a free "
        "aircraft has none: faults of the sensors were tried beside it and explain the runs less well; for comparison, "
        f"{imitations}"
    )


def _warn_of_scale(study: Study, mass: Estimate, settings: WarningSettings, *, rules: bool) -> Iterator[str]:
    """Yield that a loading may have another unit: accelerations and weight determine only ratios to the mass."""
    if mass.value is None or not any(run.masses for run in study.runs):
        return
    largest = max((each for run in study.runs for each in run.masses), key=lambda each: abs(each.mass_kg))
    is_small = abs(largest.mass_kg) < settings.least_loading_kg or mass.value < settings.least_mass_kg
    is_large = mass.value > (settings.most_mass_of_gear_kg if study.is_one_gear else settings.most_mass_kg)
    if is_small or is_large:
        where = "" if study.is_one_gear else f" at ({largest.x_m:g}, {largest.y_m:g}) m"
        key = "mass_change_kg is" if study.is_one_gear else "loadings are"
        yield (
            f"the scale rests on {largest.mass_kg:+g} kg{where}, which makes the mass {mass.value:.3g} kg: {key} in "
            f"kg, and the runs cannot show that it was {'tonnes' if is_small else 'grams'}, which scale all masses and "
            "forces alike"
        )
    if study.is_one_gear:
        changes = [run.mass_change_kg for run in study.runs]
        fraction = (max(changes) - min(changes)) / mass.value
        # If differences between runs limit the mass, the limits of the answer say so.
        if mass.std is not None and mass.std / mass.value > settings.loose_mass and not rules:
            yield (
                f"the mass change is {100 * fraction:.0f} % of the mass, which multiplies every relative error by "
                f"about {1 / fraction:.0f}: doubling it would halve the interval of the mass"
            )


def _describe_loose_motion(motion: str) -> str:
    one, other, side = ("left", "right", "side") if motion == "roll" else ("front", "rear", "end")
    return (
        f"these runs do not determine the inertia in {motion}: this motion is too small, or coordinates are too "
        f"uncertain; let {one} and {other} run over different ground, load one {side}, or measure the coordinates "
        "better"
    )


def _warn_of_coordinates(part: FittedStructure) -> Iterator[str]:
    """Yield coordinates that the fit moved far from their stated values."""
    for coordinate in part.fit.model.body.coordinates:
        value, std = part.fit.value(coordinate.name), coordinate.std
        if abs(value) > part.settings.intervals.far_std * std:
            # The value may lie beyond the bound of the fit.
            more = " or more" * (abs(value) > 0.999 * part.settings.fit.farthest_std * std)
            yield (
                f"the fit moves {coordinate.name} by {100 * value:+.1f} cm{more} from its stated value: check the "
                "drawing, and the positions of the loadings"
            )


_PARTS_IN_WORDS = {"spring": "the stiffness", "damper": "the damping", "friction": "the friction"}


def run_differences(part: FittedStructure) -> Iterator[str]:
    """Yield parameters of runs that differ from the first run by more than their intervals, one sentence each."""
    fit, alike, study = part.fit, part.repeatability, part.task.study
    if part.known.levels is None:
        return
    if alike.exceeds and not alike.is_usual:
        yield (
            f"the runs differ by about {100 * (alike.estimated or 0.0):.1g} % in stiffness, damping or friction, more "
            f"than the stated repeatability of {100 * alike.stated:.2g} %: state a larger one, or look for what changed"
        )
    for number, group in enumerate(fit.model.groups):
        where = f" at {group.name!r}" * bool(group.name)
        changes = [_Change.of(part, number, run) for run in range(1, len(part.runs))]
        for change in changes:
            yield from _warn_of_unlike_run(part, change, where)
        is_alone = fit.model.body.is_one_gear and (study is None or study.is_one_gear)
        if is_alone and changes:
            yield from _warn_of_another_mass(part, max(changes, key=lambda change: abs(change.common[0])))


@dataclass(frozen=True)
class _Change:
    """Changes of a group in a run against the first run: values with their standard deviations.

    Args:
        run: index of the run.
        single: change of each part that the group has.
        unlike: change of one part minus that of another.
        common: mean change of all parts.
    """

    run: int
    single: Mapping[str, tuple[float, float]]
    unlike: Mapping[tuple[str, str], tuple[float, float]]
    common: tuple[float, float]

    @classmethod
    def of(cls, part: FittedStructure, number: int, run: int) -> _Change:
        """Return the change of a group of a run."""
        model = part.fit.model
        parts = ["spring", "damper", *{part_of(term.kind) for term in model.groups[number].law.terms} - set(PARTS[:2])]

        def change(weights: Mapping[str, float]) -> tuple[float, float]:
            slopes = np.zeros(part.fit.theta.size)
            for each, sign in ((run, 1.0), (0, -1.0)):
                first = model.indices_of_run(each)[1].start + number * len(PARTS)
                for name, weight in weights.items():
                    slopes[first + PARTS.index(name)] = sign * weight
            return float(slopes @ part.fit.theta), part.known.deviation(slopes)

        return cls(
            run,
            {name: change({name: 1.0}) for name in parts},
            {(a, b): change({a: 1.0, b: -1.0}) for a, b in combinations(parts, 2)},
            change({name: 1 / len(parts) for name in parts}),
        )

    @property
    def best_distinguished(self) -> tuple[str, str]:
        """The two parts whose changes differ most clearly."""
        return max(self.unlike, key=lambda pair: abs(self.unlike[pair][0]) / self.unlike[pair][1])


def _warn_of_unlike_run(part: FittedStructure, change: _Change, where: str) -> Iterator[str]:
    """Yield parts that changed by more than their intervals; if there are none, two parts whose changes differ."""
    names, known = part.task.run_names, part.settings.warnings
    named, than = f"{where} in run {names[change.run]!r}", f"in run {names[0]!r}"
    certain = [name for name, (value, std) in change.single.items() if abs(value) > known.unlike_std * std]
    for name in certain:
        value, std = change.single[name]
        yield (
            f"{_PARTS_IN_WORDS[name]}{named} is {100 * abs(value):.2g} % (standard deviation {100 * std:.1g} %) "
            f"{'more' if value > 0 else 'less'} than {than}"
        )
    value, std = change.unlike[change.best_distinguished]
    if not certain and abs(value) > known.unlike_std * std:
        first, second = (_PARTS_IN_WORDS[name] for name in change.best_distinguished)
        yield (
            f"{first} and {second}{named} are not those {than}: one of them changed by {100 * abs(value):.2g} % "
            f"(standard deviation {100 * std:.1g} %) against the other, and the runs do not show which; repeat the "
            "runs with the masses in turn"
        )


def _warn_of_another_mass(part: FittedStructure, change: _Change) -> Iterator[str]:
    """Yield that all forces of a run changed by one ratio, which is the effect of another mass."""
    (common, _), (differs, std), names = change.common, change.unlike[change.best_distinguished], part.task.run_names
    if abs(common) < part.settings.warnings.as_one * max(abs(differs), std):
        return
    model, wrong = part.fit.model, ""
    if model.mass_free:
        change_kg = float(model.runs[change.run].loading[0, 0])
        off_kg = abs(common) * (1 / model.inverse_mass(part.fit.theta) + change_kg)
        wrong = f", as if it carried {off_kg:.0f} kg {'less' if common > 0 else 'more'} than stated"
    key = "loadings" if part.task.study is None else "mass_change_kg"
    yield (
        f"stiffness, damping and friction in run {names[change.run]!r} are all {100 * abs(common):.2g} % "
        f"{'more' if common > 0 else 'less'} than in run {names[0]!r}{wrong}: check the {key} of all runs"
    )


def warn_of_gas(
    interfaces: Sequence[InterfaceEstimate], measured: Sequence[MeasuredInterface], settings: GasSettings
) -> Iterator[str]:
    """Yield warnings about the gas that carries suspensions, one sentence each, once for those that share a law.

    `interfaces` holds the suspensions that were fitted, `measured` all of them as stated.
    """
    done, by_name = set[str](), {stated.name: stated for stated in measured}
    for each in interfaces:
        if done.isdisjoint(each.shared_with):
            names = ", ".join((each.name, *each.shared_with))
            where = f"at {names!r}: " if len(measured) > 1 else ""
            for doubt in _warn_of_column(each, by_name[each.name], settings):
                yield where + doubt
        done.add(each.name)


def warn_of_signs(interfaces: Sequence[InterfaceEstimate]) -> Iterator[str]:
    """Yield which suspensions have a stiffness or a damping below zero that no law beside it makes up for."""
    for each in interfaces:
        parts = {part_of(term.kind) for term in each.law.terms}
        where = f" of {each.name!r}" if len(interfaces) > 1 else ""
        for part, name, estimate in (("spring", "stiffness", each.stiffness), ("damper", "damping", each.damping)):
            if part not in parts:
                yield from warn_of_sign(name + where, estimate, is_spring=part == "spring")


def warn_of_sign(name: str, estimate: Estimate, *, is_spring: bool) -> Iterator[str]:
    """Yield a sentence where the whole interval of a stiffness or damping is below zero.

    Args:
        name: how the sentence calls it.
        estimate: its value and interval.
        is_spring: whether it is a stiffness.
    """
    if estimate.interval95 is None or estimate.interval95[1] >= 0.0:
        return
    meaning = (
        "it carries no weight by itself: something else holds the body, as in an inverted pendulum or beyond the peak "
        "of a softening spring"
        if is_spring
        else "it would feed the motion: a force that nobody measured follows the motion"
    )
    yield (
        f"the {name} is negative, {abs(estimate.value or 0.0) / (estimate.std or 1.0):.0f} standard deviations below "
        f"zero, and {meaning}; if that cannot be, check the signs and clocks of the sensors"
    )


def warn_of_stops(interfaces: Sequence[InterfaceEstimate]) -> Iterator[str]:
    """Yield the runs whose weight puts a suspension on a stop, one sentence each."""
    for each in interfaces:
        reference = next((at_rest.run for at_rest in each.at_rest if not at_rest.travel_m.value), "the reference run")
        stops = [term for term in each.law.terms if term.kind.is_stop]
        for at_rest, stop in [(at_rest, stop) for at_rest in each.at_rest for stop in stops]:
            travel, stiffness = at_rest.travel_m.value, each.stiffness.value
            pressed_n = 0.0 if travel is None else float(Law((stop,), each.law.rest_m).static_force(travel)[0])
            if travel is None or stiffness is None or not pressed_n:
                continue
            change_n = stiffness * travel + float(each.law.static_force(travel)[0])
            where = f" at {each.name!r}" if len(interfaces) > 1 else ""
            yield (
                f"in run {at_rest.run!r} the suspension{where} rests on its {stop.name}: it carries "
                f"{abs(change_n):.4g} N {'less' if travel > 0 else 'more'} than in {reference!r}, of which the stop "
                f"takes {abs(pressed_n):.4g} N; if it did not rest on the stop, check mass_change_kg; if it did, use a "
                "smaller mass change, because a strut on its stop shows less of its spring"
            )


def _warn_of_column(interface: InterfaceEstimate, stated: MeasuredInterface, settings: GasSettings) -> Iterator[str]:
    columns = [term.name for term in interface.law.terms if term.kind.quasi_static]
    if columns and stated.axis == "horizontal":
        yield (
            f"the axis is 'horizontal' and the law has a {columns[0]}, which carries weight: no weight says how large "
            "its static force is, and it can hardly be told from a straight spring; give axis = 'up' or 'down' if the "
            "suspension carries weight, or another law"
        )
    yield from warn_of_area(interface.gas, stated.piston_area_m2, settings)
    yield from warn_of_exponents(interface, settings)


def warn_of_exponents(suspension: SpringEstimate, settings: GasSettings) -> Iterator[str]:
    """Yield the exponents of a suspension that gas in a strut does not have, one sentence each."""
    for kind, estimates in suspension.law_estimates.items():
        if not LAWS[kind].quasi_static:
            continue
        for parameter in LAWS[kind].parameters:
            value = estimates[parameter.name].value
            if parameter.known is None or value is None:
                continue
            mean, reach = parameter.known[0], settings.far_std * parameter.known[1]
            if abs(value - mean) > reach:
                yield (
                    f"the exponent {value:.3g} of {kind} is unusual for gas in a strut ({mean - reach:.3g} to "
                    f"{mean + reach:.3g}): another spring probably carries a part of the weight, so do not trust the "
                    "static force, length, pressure and volume of the gas; the mass does not depend on them"
                )
