"""What the runs do not tell, and what to doubt of what they tell: one sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from opid.estimate import Estimate
from opid.mechanics.laws import LAWS
from opid.signals.across_channels import units_apart
from opid.suspensions.candidates import Choice, Fitted
from opid.suspensions.faults import GROUND
from opid.suspensions.fit import Fit, fits_of_each_run, runs_contradict_each_other
from opid.suspensions.gas import doubts_of_gas
from opid.suspensions.limits import repeatability_rules
from opid.suspensions.repeatability import repeatability_of
from opid.suspensions.residual import motion_over_noise, over_noise, sensor_ratio
from opid.suspensions.result import (
    BodyParameters,
    BodyRatios,
    Evidence,
    GearParameters,
    GearRatios,
    InterfaceEstimate,
)
from opid.suspensions.run_differences import run_differences
from opid.suspensions.settings import Verdicts, WarningSettings
from opid.suspensions.straight_terms import StraightTerm
from opid.suspensions.study import Run, Study, rigid_faults

WITHOUT_INTERVALS = "the intervals are withheld: what the structure leaves is no noise, and does not average out"


def straight_terms(part: Fitted) -> list[StraightTerm]:
    """Return the terms that are stiffness or damping by another name.

    Their scale lies far beyond the rms motion, or they turn over between two samples.
    """
    fit, loosely_known, settings = part.fit, part.settings.verdicts.loosely_known, part.settings.warnings
    found, run, accelerance = [], fit.model.runs[0], fit.model.mobility(fit.theta, 0).accelerance
    for number, (group, law) in enumerate(zip(fit.groups, fit.laws.values(), strict=True)):
        place = fit.model.law_places(number).start
        travel, velocity = (np.concatenate(part) for part in zip(*map(fit.motion, group.slots), strict=True))
        for term in law.terms:
            std = part.known.std(place)
            place += len(term.values)
            if term.kind.memory is not None and part.residual_over_noise > settings.memory_left:
                first, rms = term.kind.parameters[1], float(travel.std())
                left = part.residual_over_noise
                found.append(StraightTerm(group.name, term.name, first.unit, term.values[1], rms, left=left))
                continue
            for parameter, value in zip(LAWS[term.name].parameters, term.values, strict=True):
                # a kind whose scale may be long by nature bends within it all the same
                if parameter.role != "scale" or parameter.over_rms[1] > settings.usual_reach_rms:
                    continue
                rms = float((velocity if parameter.unit == "m/s" else travel).std())
                if value > settings.straight_rms * rms and std > loosely_known * abs(term.amplitude):
                    found.append(StraightTerm(group.name, term.name, parameter.unit, value, rms))
                if term.kind.memory is not None:
                    # friction that has turned over within the travel from one sample to the next
                    turns = float(velocity.std()) / value if parameter.unit == "m" else 0.0
                else:
                    steepest = abs(term.amplitude * float(term.evaluate(np.array(0.0), np.array(0.0))[2]))
                    turns = steepest * max(accelerance[k, k] for k in group.slots) * (parameter.unit == "m/s")
                sharpness = turns * run.finer / run.recorded_fs
                if sharpness > settings.turnover_between_samples:
                    found.append(StraightTerm(group.name, term.name, parameter.unit, value, rms, sharpness))
    return found


def why_no_mass(choice: Choice) -> str | None:
    """Return why the runs do not tell the mass of some part of the answer; None if they tell all."""
    study, parts = choice.study, choice.parts
    untold = [part for part in parts if not part.fit.model.mass_free]
    changes = ", ".join(f"{run.name!r} {run.mass_change_kg:+g} kg" for run in study.runs)
    if len(untold) == len(parts):
        return _why_no_scale(study)
    if untold:
        return (
            f"the loading ({changes}) does not rest on {choice.names(untold)}: only ratios to the mass can be told; "
            "change it there, too"
        )
    if study.is_one_gear:
        return _why_no_mass_of_gear(choice)
    loose = [part for part in parts if _is_loose(part.known.mass, choice.verdicts)]
    if not loose:
        return None
    if choice.ratio > choice.verdicts.doubtful:
        return (
            f"the structure leaves {over_noise(choice.ratio)} times the sensors' noise, and no mass fits the runs"
            f"{worst_sensor(study, parts)}: check places, signs and masses of the loadings first"
        )
    negative = [part for part in parts if part.known.has_negative_mass]
    if negative:
        where = "" if len(parts) == 1 else f" on {choice.names(negative)}"
        return (
            f"the mass{where} would be negative: check the sign of the loading ({changes}), or whether two runs are "
            "exchanged"
        )
    return (
        f"the change of loading ({changes}) moves too little of what the sensors see to give the mass"
        f"{'' if len(parts) == 1 else ' on ' + choice.names(loose)}: change it more, or at a place that moves more"
    )


def _why_no_scale(study: Study) -> str:
    if len(study.runs) == 1:
        key = "mass_change_kg" if study.is_one_gear else "loading"
        return (
            "one run gives ratios to the mass alone: record a second one with a known mass more or less, and give its "
            f"`{key}`"
        )
    if study.is_one_gear:
        return (
            "all runs have the same sprung mass (mass_change_kg), so only ratios to the mass are determined: add a run "
            "at another mass"
        )
    return (
        "all runs have the same loading: only ratios to the mass can be told; give `loading` to the runs that carried "
        "more or less"
    )


def _why_no_mass_of_gear(choice: Choice) -> str | None:
    (part,), changes = choice.parts, [run.mass_change_kg for run in choice.study.runs]
    (mu, std), largest = part.known.inverse_mass, max(changes) - min(changes)
    is_loose = _is_loose(part.known.mass, choice.verdicts)
    if part.known.has_negative_mass and is_loose:
        return (
            f"the runs respond as if the sign of the mass change ({largest:g} kg) were opposite: check mass_change_kg "
            "(negative where mass was removed) and the order of the logs; the ratios to the mass are given"
        )
    if part.error is not None and part.error.limit == "model":
        return (
            f"what the model leaves, {100 * unexplained_fraction(part):.2g} % of the body's acceleration and "
            f"{over_noise(choice.ratio)} times the sensors' noise, goes with the motion and bends the parameters, and "
            "no mass can be told: the law may be outside the library, this gear may not be alone on its body, which "
            "rolls and pitches on others (then describe all of them in [[interfaces]]), or the channels or the mass "
            "changes are not as stated; the ratios to the mass are given, as equivalents over the motion of these runs"
        )
    if is_loose and choice.ratio > choice.verdicts.doubtful:
        return (
            f"the fitted model leaves {over_noise(choice.ratio)} times the sensors' noise, and no mass fits the runs: "
            "this gear may not be alone on its body, which rolls and pitches on others (then describe all of them in "
            "[[interfaces]]), or the channels, the law or the mass changes are not as stated"
        )
    if is_loose and part.known.levels is not None:
        alike = repeatability_of(part.fit, part.known.levels, part.task.repeatability, is_usual=False)
        if repeatability_rules(alike, part.fit):
            return (
                f"the runs differ by about {100 * (alike.estimated or 0.0):.1g} % in stiffness, damping or friction, "
                f"which hides what the mass change of {largest:g} kg does: fly the masses in turn, each more than "
                "once, or use a larger mass change; if you know that springs, damping and friction are alike, state a "
                "smaller `repeatability`; the ratios to the mass are given"
            )
    if is_loose:
        upper = mu + 1.96 * std
        bound = f"it is above {1 / upper:.0f} kg" if upper > 0 else "the change even acts in the opposite sense"
        return (
            f"the mass change of {largest:g} kg does not show in the runs, so the sprung mass is not determined "
            f"({bound}, 95 %): use a larger mass change or longer runs; the ratios to the mass are given"
        )
    if 1 + mu * min(changes) < part.settings.intervals.least_remainder:
        return (
            f"the fit gives a sprung mass of {1 / mu:.0f} kg and a run is said to be {-min(changes):g} kg lighter, "
            "which would leave next to nothing: check mass_change_kg (kg, of the mass on this gear)"
        )
    return None


def why_refused(choice: Choice) -> str | None:
    """Return why there are no numbers at all; None if there are."""
    study, parts, ratio, verdicts = choice.study, choice.parts, choice.ratio, choice.verdicts
    if study.is_one_gear:
        return _why_gear_refused(study, parts[0])
    if ratio <= verdicts.refused:
        return None
    return (
        f"every number would be a guess, for the structure leaves {over_noise(ratio)} times the sensors' noise"
        f"{worst_sensor(study, parts)}: {_instead(choice)}"
    )


def _why_gear_refused(study: Study, part: Fitted) -> str | None:
    fit, verdicts, ratio = part.fit, part.settings.verdicts, part.residual_over_noise
    frequencies = natural_frequencies(fit) if ratio > verdicts.doubtful else [0.0]
    differ = max(frequencies) > (1 + part.settings.intervals.same_frequency) * min(frequencies)
    if differ and runs_contradict_each_other(fit):
        return (
            "all runs are said to have the same sprung mass, so only ratios to it could be determined, and they do not "
            f"even behave alike (natural frequencies {min(frequencies):.3f} to {max(frequencies):.3f} Hz): check "
            "mass_change_kg"
        )
    left = unexplained_fraction(part)
    if left <= verdicts.refused_fraction:
        return None
    if not np.isfinite(left):
        unexplained = "moves without bound where the readings do not hold it"
    elif left < 1.0:
        unexplained = (
            f"leaves {100 * left:.0f} % of the body's rms acceleration unexplained ({ratio:.0f} times the sensor noise)"
        )
    else:
        unexplained = "explains nothing of the body's acceleration"
    return (
        f"the fitted model {unexplained}, so every number of it would be a guess: check the channels (swapped, upside "
        "down, in another unit) and the mass changes, let the law be searched, or take another band; or this gear is "
        "not alone on its body, which rolls and pitches on others: then describe all of them in [[interfaces]]"
    )


def unexplained_fraction(part: Fitted) -> float:
    """Return what the free motion leaves of the body's rms acceleration over all runs."""
    return float(np.sqrt(np.mean(np.square(part.unexplained))))


def natural_frequencies(fit: Fit) -> list[float]:
    """Return the natural frequency of one gear in each run, fitted to that run alone, Hz."""
    found, mu = [], fit.model.inverse_mass(fit.theta)
    for one in fits_of_each_run(fit):
        square = one.theta[0] + one.value(fit.model.groups[0].called(GROUND))
        fraction = 1 + mu * float(one.model.runs[0].loading[0, 0])
        found.append(float(np.sqrt(max(square / fraction, 0.0))) / (2 * np.pi))
    return found or [0.0]


def _instead(choice: Choice) -> str:
    """What to do where a structure is refused."""
    faults = list(rigid_faults(choice.study))
    check = "check channels (exchanged, upside down, in another unit), coordinates and loadings"
    if choice.kind == "rigid_body":
        return f"{check}, or describe the structure by its own matrices"
    if faults:
        return f"these gears do not move alone, and one rigid body cannot be tried: {'; '.join(faults)}"
    if choice.study.structure.kind == "auto":
        return check
    return 'these gears do not move alone: try kind = "auto" or "rigid_body"'


def worst_sensor(study: Study, parts: Sequence[Fitted]) -> str:
    """Return which sensor the answer leaves most of, as the end of a sentence; "" where there is one alone."""
    levels: list[tuple[float, str]] = []
    for part in parts:
        names = list(study.channels("sprung"))
        if part.kind != "rigid_body":
            names = [" and ".join(names[k] for k in part.interfaces)]
        levels += [(sensor_ratio(part.fit, channel), name) for channel, name in enumerate(names)]
    if len(levels) < 2:
        return ""
    *others, (most, name) = sorted(levels)
    least, next_to_it = over_noise(others[0][0]), over_noise(others[-1][0])
    others_leave = least if least == next_to_it else f"{least} to {next_to_it}"
    return f"; most at {name!r}: {over_noise(most)}, the others {others_leave}"


def loose_motions(
    choice: Choice, parameters: GearParameters | BodyParameters, ratios: GearRatios | BodyRatios
) -> list[str]:
    """Return "roll", "pitch" or both: motions of a rigid body whose inertia the runs hardly tell.

    A motion that is noise alone gives an inertia that explains noise, with an interval as sharp as it is wrong.
    """
    verdicts = choice.verdicts
    if choice.kind != "rigid_body" or choice.ratio > verdicts.doubtful:
        return []
    assert isinstance(parameters, BodyParameters)
    assert isinstance(ratios, BodyRatios)
    (part,) = choice.parts
    loose, moved = [], motion_over_noise(part.fit)
    for motion, radius, inertia in (
        ("roll", ratios.roll_radius_m, parameters.roll_inertia_kg_m2),
        ("pitch", ratios.pitch_radius_m, parameters.pitch_inertia_kg_m2),
    ):
        # of the square, as of the inertia
        square = Estimate(radius.value, None if radius.std is None else 2 * radius.std)
        if (
            moved[motion] < part.settings.intervals.least_motion
            or _is_loose(square, verdicts)
            or (inertia.value is not None and _is_loose(inertia, verdicts))
        ):
            loose.append(motion)
    return loose


@dataclass(frozen=True, eq=False)
class Answer:
    """What warnings are about.

    Args:
        choice: the structure that was chosen.
        evidence: of its parts.
        mass: that was found.
        first: the first interface, as it is told.
        loose: motions whose inertia is hardly told.
        straight: terms of each part that the motion did not bend.
        per_mass: whether forces are told per kg of the body.
        is_refused: whether no number is told.
        mended_spikes: below and on the body.
    """

    choice: Choice
    evidence: Sequence[Evidence]
    mass: Estimate
    first: InterfaceEstimate
    loose: Sequence[str]
    straight: Sequence[Sequence[StraightTerm]]
    per_mass: bool
    is_refused: bool
    mended_spikes: tuple[int, int]


def collect_warnings(answer: Answer) -> Iterator[str]:
    """Yield what to doubt of an answer, one sentence each."""
    choice = answer.choice
    for run in choice.study.runs:
        yield from _of_the_log(run)
    if sum(answer.mended_spikes):
        below, above = answer.mended_spikes
        yield (
            f"{below + above} spike(s) of one sample were mended ({below} on the unsprung, {above} on the sprung "
            "channel)"
        )
    yield from _of_the_record(choice)
    yield from _of_the_levels(choice)
    yield from _of_the_residual(answer) if choice.study.is_one_gear else _of_the_structure(answer)
    # of a structure that is refused, faults and places are no more than what the search came to
    told = [] if answer.is_refused else choice.parts
    for part in told:
        yield from _of_the_demands(part)
        yield from _of_stated_facts(part)
        yield from run_differences(choice.study, part)
    if told:
        yield from _of_the_ground(answer)
        area = choice.study.interfaces[0].piston_area_m2
        yield from doubts_of_gas(answer.first, area, choice.parts[0].settings.gas)
    rules = any(repeatability_rules(each.repeatability, each.fit) for each in answer.evidence)
    yield from _of_the_scale(choice.study, answer.mass, choice.parts[0].settings.warnings, rules=rules)
    for motion in answer.loose:
        yield _untold_motion(motion)
    for part in told:
        yield from _of_places(part)
    for term in [term for terms in answer.straight for term in terms] if told else ():
        yield term.warning


def _of_the_log(run: Run) -> Iterator[str]:
    for finding in run.findings:
        if finding.severity != "note":
            channel = f", {finding.channel!r}" if finding.channel else ""
            yield f"run {run.name!r}{channel}: {finding.message}"


def _of_the_record(choice: Choice) -> Iterator[str]:
    """What neither a structure nor a law can mend."""
    study, settings = choice.study, choice.parts[0].settings.runs
    if study.structure.noise_m_per_s2 is None and not study.is_one_gear:
        yield (
            f"the noise of the sensors, {1e3 * max(part.level for part in choice.parts):.2g} mm/s^2, is taken from "
            "their quietest spectra, a bound from above: state `noise_m_per_s2` if you know it"
        )
    highest = settings.highest_fraction
    if highest * study.fs < settings.band_hz[1]:
        yield (
            f"the runs are sampled at {study.fs:g} Hz, and compared up to {highest * study.fs:.4g} Hz instead of "
            f"{settings.band_hz[1]:g} Hz, for the filters of loggers begin at {highest:g} of the rate: what moves "
            f"faster is not in them, or folded; record at {settings.band_hz[1] / highest:.4g} Hz or more, or give a "
            "band that ends below"
        )


def _of_the_levels(choice: Choice) -> Iterator[str]:
    """Runs that no model explains together, and one of which is as much stronger than the first as units are apart."""
    study = choice.study
    if choice.lack <= choice.verdicts.explained:
        return
    names = (*study.channels("unsprung"), *study.channels("sprung"))
    first, *others = study.runs
    for run in others:
        ratios = [float(np.std(run.recording.channel(name)) / np.std(first.recording.channel(name))) for name in names]
        found = units_apart(ratios)
        if found:
            larger, smaller, apart = found
            mean = float(np.exp(np.mean(np.log(ratios))))
            yield (
                f"every channel of run {run.name!r} is {mean:.3g} times as strong as in run {first.name!r}, and "
                f"{larger} is {apart:.4g} {smaller}: unless road or speed differ as much, one of the two logs is in "
                "another unit than stated; give the right `unit` in [runs.channels.NAME], or in the log's header"
            )


def _of_the_residual(answer: Answer) -> Iterator[str]:
    """Of one gear: how large, and what usually leaves such a residual."""
    (part,), (evidence,), verdicts = answer.choice.parts, answer.evidence, answer.choice.verdicts
    found, ratio = evidence.whiteness, part.residual_over_noise
    left_out, more = part.left_out_over_noise, part.settings.warnings.left_out_more
    if left_out is not None and ratio <= verdicts.noted and left_out > max(verdicts.noted, more * ratio):
        yield (
            f"runs that the others predict leave {over_noise(left_out)} times the noise of the sensors: a mass change "
            "may not be as stated, or something has changed between the runs"
        )
    if found.white and ratio < verdicts.noted:
        return
    stands_out = (
        f"it stands out most from {found.band_hz[0]:.2g} to {found.band_hz[1]:.2g} Hz ({found.excess:.1f} times its "
        f"mean level): {_reason(part.fit, found.band_hz)}"
    )
    if ratio > verdicts.noted:
        yield f"the residual is {ratio:.1f} times the noise of the sensors; {stands_out}"
        if part.error is not None and not answer.is_refused:
            yield _limited_by(part)
    else:
        size = "as small as" if ratio < verdicts.explained else f"{ratio:.1f} times"
        yield f"the residual is {size} the noise of the sensors and not white; {stands_out}; the intervals allow for it"


def _limited_by(part: Fitted) -> str:
    """What limits an answer that leaves more than noise, in words."""
    assert part.error is not None  # more than noise is left
    least, most = (f"{100 * end(part.unexplained):.2g}" for end in (min, max))
    left = least if least == most else f"{least} to {most}"
    if part.error.limit == "model":
        return (
            f"the answer is limited by the model, which leaves {left} % of the body's acceleration: how the errors are "
            "weighed moves the parameters by more than their intervals, which are widened by that, and by how they "
            "differ from one piece of the runs to the other"
        )
    return (
        f"the answer is limited by something that moves the body and that no sensor measured ({left} % of its "
        "acceleration): it does not bend the parameters, which are the same however the errors are weighed, and the "
        "intervals allow for it"
    )


def _reason(fit: Fit, band_hz: tuple[float, float]) -> str:
    """What usually leaves a residual in such a band."""
    square = fit.theta[0] + fit.value(fit.model.groups[0].called(GROUND))
    settings = fit.model.settings.warnings
    resonance_hz = float(np.sqrt(max(square, 0.0))) / (2 * np.pi)
    if band_hz[1] < settings.slow_fraction * resonance_hz:
        return "AC coupling, a drifting sensor or a law of the travel outside the library make such slow motion"
    if band_hz[0] > settings.fast_fraction * resonance_hz:
        return "a second resonance (a roll, pitch or bending mode, a loose bracket) or a lag between the channels"
    return (
        "a gear on a body that rolls or pitches is no gear alone, a law outside the library, memory in the strut or "
        "motion across the axis leave such a residual"
    )


def _of_the_structure(answer: Answer) -> Iterator[str]:
    choice = answer.choice
    study, parts, ratio, lack, verdicts = choice.study, choice.parts, choice.ratio, choice.lack, choice.verdicts
    if lack > verdicts.explained:
        named = verdicts.explained < ratio <= verdicts.refused
        yield choice.why + (worst_sensor(study, parts) if named else "")
        more = parts[0].settings.warnings.left_out_more_of_body
        if ratio <= verdicts.explained or (lack > more * ratio and ratio <= verdicts.refused):
            yield (
                f"runs that the others predict leave {over_noise(lack)} times the noise: a loading may have another "
                "mass or stand elsewhere than stated, or something has changed between the runs"
            )
        if ratio <= verdicts.refused:
            yield WITHOUT_INTERVALS
    elif not all(each.whiteness.white for each in answer.evidence):
        yield (
            "what the structure leaves is not white, though little: a law or a coordinate may be missing; intervals "
            "allow for its colour"
        )
    if len(study.runs) > 1 and any(part.left_out_over_noise is None and not part.is_hopeless for part in parts):
        yield (
            "the model cannot follow the runs without one of them: nothing is said of runs that the others predict; "
            "check the loading of each run"
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


def _of_the_demands(part: Fitted) -> Iterator[str]:
    for words in dict.fromkeys(demand.words for demand in part.demands):
        mine = [demand for demand in part.demands if demand.words == words]
        values = ", ".join(f"{each.name} = {each.value:.4g} +- {each.std:.1g}" for each in mine)
        also = f"; {' and '.join(mine[0].alike)} would explain the runs as well" if mine[0].alike else ""
        stated = ", which nobody stated"
        if mine[0].hypothesis.is_stated:
            stated = " than the study states without a tolerance"
        yield (
            f"the runs demand {words}{stated} ({values}): without it the error is "
            f"{1e3 * mine[0].error_before:.3g} instead of {1e3 * mine[0].error_after:.3g} mm/s^2{also}"
        )


def _of_stated_facts(part: Fitted) -> Iterator[str]:
    """A fact of a sensor that the fit contradicts: it is wrong, or stands in for something else."""
    demanded = {demand.name for demand in part.demands}
    what = {"gain": "gain", "corner": "corner of the AC coupling", "lag": "delay", "leak": "cross-axis leak"}
    units = {"corner": " Hz", "lag": " s"}
    lower, upper = part.fit.model.bounds()
    for fault in part.fit.model.faults:
        value = part.fit.value(fault.name)
        off = abs(value - fault.nominal) / fault.std
        if fault.name in demanded or off <= part.settings.faults.contradicted_std:
            continue
        unit = units.get(fault.kind, "")
        # a gear alone has one group, and its sensors need no names
        name = part.fit.model.sensors.names[fault.channel] or part.fit.model.groups[0].name
        place = part.fit.model.names.index(fault.name)
        # as far as it is looked for
        more = " or less" * bool(value <= lower[place]) + " or more" * bool(value >= upper[place])
        yield (
            f"the stated {what[fault.kind]} of the {fault.side} sensor{f' at {name!r}' if name else ''}, "
            f"{fault.nominal:.3g} +- {fault.std:.2g}{unit}, contradicts the runs, which show {value:.3g}{unit}{more} "
            f"({off:.1f} standard deviations off): check the data sheet, or state a wider tolerance"
        )


def _of_the_ground(answer: Answer) -> Iterator[str]:
    ground, stiffness = answer.first.ground_stiffness.value, answer.first.stiffness.value
    if (
        not answer.choice.study.is_one_gear
        or ground is None
        or stiffness is None
        or abs(ground) <= answer.choice.parts[0].settings.intervals.negligible_ground * abs(stiffness)
        or answer.first.ground_stiffness.holds(0.0)
    ):
        return
    sentences = answer.evidence[0].ground.sentences
    imitations = "; ".join(sentences) or "none of the usual faults of the sensors looks much like it"
    yield (
        f"the ground spring K3 = {ground:.3g} N/m{' per kg' * answer.per_mass} differs from zero, yet a free "
        "aircraft has none: faults of the sensors were tried beside it and explain the runs less well; for comparison, "
        f"{imitations}"
    )


def _of_the_scale(study: Study, mass: Estimate, settings: WarningSettings, *, rules: bool) -> Iterator[str]:
    """A loading in tonnes scales everything, and is seen by nobody."""
    if mass.value is None:
        return
    if study.is_one_gear:
        changes = [run.mass_change_kg for run in study.runs]
        fraction = (max(changes) - min(changes)) / mass.value
        # where runs that are not alike rule, the limits say so
        if mass.std is not None and mass.std / mass.value > settings.loose_mass and not rules:
            yield (
                f"the mass change is {100 * fraction:.0f} % of the mass, which multiplies every relative error by "
                f"about {1 / fraction:.0f}: doubling it would halve the interval of the mass"
            )
        return
    largest = max((each for run in study.runs for each in run.masses), key=lambda each: abs(each.mass_kg))
    if abs(largest.mass_kg) < settings.least_loading_kg or mass.value < settings.least_mass_kg:
        yield (
            f"the scale rests on {largest.mass_kg:+g} kg at ({largest.x_m:g}, {largest.y_m:g}) m, which makes the mass "
            f"{mass.value:.3g} kg: loadings are in kg"
        )


def _untold_motion(motion: str) -> str:
    one, other, side = ("left", "right", "side") if motion == "roll" else ("front", "rear", "end")
    return (
        f"these runs do not tell the inertia in {motion}: the body hardly moves in it, or places are too roughly "
        f"known; let {one} and {other} run over different ground, load one {side}, or measure the coordinates better"
    )


def _is_loose(estimate: Estimate, verdicts: Verdicts) -> bool:
    value, std = estimate.value, estimate.std
    return value is None or std is None or std > verdicts.loosely_known * value


def _of_places(part: Fitted) -> Iterator[str]:
    """Coordinates that moved far from where they are stated to be."""
    for coordinate in part.fit.model.body.coordinates:
        value, std = part.fit.value(coordinate.name), coordinate.std
        if abs(value) > part.settings.intervals.far_std * std:
            # as far as they are looked for
            more = " or more" * (abs(value) > 0.999 * part.settings.fit.farthest_std * std)
            yield (
                f"{coordinate.name} would have to be {100 * value:+.1f} cm{more} from where it is stated to be: check "
                "the drawing, and the places of the loadings"
            )
