"""Identification of a study: structures are compared, one is recommended, its numbers and warnings are reported."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from opid.errors import InputError, NotDeterminedError, nearest
from opid.estimate import Estimate
from opid.mechanics.laws.law import default_law
from opid.progress import Say
from opid.signals.health.inspection import check_channels, remove_spikes
from opid.signals.recording import FloatArray
from opid.suspensions.answer.intervals import bootstrap_over_white, limits, std_over_white, withhold_frequency
from opid.suspensions.answer.numbers import collect_numbers
from opid.suspensions.answer.refusals import find_confounded_terms, is_biased, loose_motions, why_no_mass, why_refused
from opid.suspensions.answer.warnings import Answer, collect_warnings
from opid.suspensions.candidates import (
    Arrays,
    Choice,
    FittedStructure,
    Task,
    fit_alone,
    fit_rigid,
    parts_of,
    with_prior_mass,
)
from opid.suspensions.fitting.faults import ground_imitations
from opid.suspensions.fitting.noise import known_noise, measure_whiteness, over_noise
from opid.suspensions.fitting.search import Question
from opid.suspensions.forces import estimate_gains, with_believed_forces
from opid.suspensions.law_search.force_surface import force_surface
from opid.suspensions.law_search.pursuit import alternatives, library
from opid.suspensions.model.driven_model import noise_level
from opid.suspensions.result import Candidate, Equivalent, Evidence, Identification, Options, RunResidual
from opid.suspensions.settings import METHODS, METHODS_OF_LAW, Settings
from opid.suspensions.study import Study, rigid_faults, symmetric_pairs
from opid.suspensions.weighing import InverseMass, compare_with_weighed, find_prior_mass, warn_of_weighed

if TYPE_CHECKING:
    from opid.suspensions.paper.result import PaperIdentification

logger = logging.getLogger(__name__)

IN_WORDS = {"single": "each gear alone", "pair": "the mean of left and right", "rigid_body": "one rigid body"}

# a figure shows this many seconds of a run
_SHOWN_S = 6.0


def identify(
    study: Study,
    *,
    method: str = "model",
    law: str | None = None,
    band_hz: tuple[float, float] | None = None,
    high_pass_hz: float | None = None,
    ground: bool = True,
    method_of_law: str = "pursuit",
    settings: Settings | None = None,
    seed: int = 0,
    progress: Say | None = None,
) -> Identification | PaperIdentification:
    """Identify masses, springs, damping and laws of a body on suspensions from runs at known loadings.

    Every sensor on the body is predicted from all sensors below its suspensions; nothing is integrated by itself, so a
    law keeps its slow motion. A gear is a body with one suspension. For several suspensions with `kind = "auto"`, each
    gear alone under its static part of the mass, the mean of symmetric pairs, and one rigid body are fitted to the same
    data; the simplest structure that leaves no more than the sensors' noise is recommended.

    Args:
        study: interfaces, runs, and what is stated of the structure and the sensors.
        method: "model"; for one gear also "classical", the chain of Iwaniec & Uhl (2007) with every step mended, or
            "paper", that chain as printed.
        law: the law to be fitted at every interface (`opid.laws.LAWS`, sums joined by "+"); it is searched if left out.
        band_hz: lines that are compared, Hz; those of the settings if left out (classical chain: 0.5 to 12 Hz).
        high_pass_hz: corner of the integration of the classical chain, Hz.
        ground: whether springs from the body to the ground may be added, which happens only if the runs demand them;
            horizontal suspensions have none.
        method_of_law: "pursuit", "sparse regression" (pysindy on the predicted motion), or "both", one after the other.
        settings: every tuned number of the estimator.
        seed: seed of the resampling that checks the intervals.
        progress: called with the name of each step as it begins.

    Returns:
        The identification; `not_determined` says why the data do not give absolute values, if they do not. A
        `PaperIdentification` for the methods "classical" and "paper".

    Raises:
        InputError: an unknown method or law, an argument that the method does not know, channels that are no pair, a
            run of less than 10 s, or interfaces that make no rigid body where one is asked for.
        NotDeterminedError: no structure can be fitted at all.
    """
    if not isinstance(study, Study):
        raise InputError(
            f"study is of type {type(study).__name__}: give a Study, as read_study or study_of_gear makes one"
        )
    if band_hz is not None and len(band_hz) != 2:
        raise InputError(f"band_hz is {band_hz!r}: give two numbers, the lowest and the highest line in Hz")
    if method not in METHODS:
        raise InputError(f"there is no method {method!r}: {nearest(method, METHODS)}")
    if method_of_law not in METHODS_OF_LAW:
        raise InputError(f"laws cannot be searched by {method_of_law!r}: {nearest(method_of_law, METHODS_OF_LAW)}")
    if method != "model":
        if not study.is_driven:
            raise InputError(
                f"the method {method!r} needs the acceleration below the suspension as a sensor reads it, and here it "
                "follows from the travel: leave the method out"
            )
        if not study.is_one_gear:
            raise InputError(f"the method {method!r} is for one gear: leave it out for a body on several suspensions")
        for name, value, usual in (
            ("method_of_law", method_of_law, "pursuit"),
            ("seed", seed, 0),
            ("settings", settings, None),
        ):
            if value != usual:
                raise InputError(_explain_only_for_model(name, value, method))
        from opid.suspensions.paper.identification import identify_by_paper

        given = {"band_hz": band_hz, "high_pass_hz": high_pass_hz}
        known = {name: value for name, value in given.items() if value is not None}
        return identify_by_paper(study, method=method, law=law, ground=ground, progress=progress, **known)  # type: ignore[arg-type]
    if high_pass_hz is not None:
        raise InputError(
            f"high_pass_hz is {high_pass_hz:g}, and the method 'model' integrates nothing by itself: leave it out, or "
            "give method='classical'"
        )
    settings = settings or Settings()
    if band_hz is not None:
        settings = replace(settings, runs=replace(settings.runs, band_hz=(float(band_hz[0]), float(band_hz[1]))))
    settings = _limit_band(study, settings)
    kind_of_law = None if law is None else default_law(law)
    say = progress or (lambda step: None)
    study = check_study(study, settings)
    arrays, mended = collect_arrays(study)
    sensors = study.sensor_facts()
    noise = known_noise(
        sensors,
        arrays,
        fs=study.fs,
        settings=settings.runs,
        n_strut=len(study.strut_sensors),
        is_driven=study.is_driven,
    )
    options = Options(law, ground, method_of_law, library(), seed)
    # A horizontal suspension has no spring to the ground, and the force in a strut does not hold that of such a spring.
    grounded = ground and not study.forces and any(each.axis != "horizontal" for each in study.interfaces)
    # Faults that nobody states are searched among accelerometers: a gain or a lag of a travel passes for a suspension.
    question = Question(kind_of_law is not None, grounded, not study.strut_sensors, method_of_law, options.kinds)
    names = tuple(run.name for run in study.runs)
    task = Task(study, arrays, sensors, noise, kind_of_law, question, settings, say, names, study.repeatability)
    tried = _fit_structures(task)
    if not any(each.has_fit for each in tried):
        raise NotDeterminedError("no structure can be fitted to these runs: " + "; ".join(e.reason for e in tried))
    for each in tried:
        _log_structure(study, each)
    choice = _choose_structure(study, tried)
    logger.info("%s", choice.why)
    choice = replace(choice, tried=[with_believed_forces(each) if each in choice.parts else each for each in tried])
    say("intervals")
    by_runs = _mass_by_runs(choice)
    return _make_answer(task, _with_weighed_mass(choice, by_runs), by_runs, options, mended)


def _limit_band(study: Study, settings: Settings) -> Settings:
    """Return settings that compare no line above the frequency up to which differentiated channels are useful."""
    (low_hz, high_hz), limits = settings.runs.band_hz, [run.highest_hz for run in study.runs if run.highest_hz]
    if not limits or min(limits) >= high_hz:
        return settings
    return replace(settings, runs=replace(settings.runs, band_hz=(low_hz, min(limits))))


def _mass_by_runs(choice: Choice) -> InverseMass | None:
    """Return what the runs alone say of the mass, if one fit has it."""
    if len(choice.parts) != 1 or not choice.parts[0].fit.model.mass_free:
        return None
    return InverseMass(*choice.parts[0].known.inverse_mass)


def _with_weighed_mass(choice: Choice, by_runs: InverseMass | None) -> Choice:
    """Return the choice with the weighed mass in its fit, if it has a tolerance and agrees with the runs."""
    prior, parts = find_prior_mass(choice.study), choice.parts
    carries_all = choice.study.is_one_gear or choice.kind == "rigid_body"
    if prior is None or len(parts) != 1 or not carries_all or why_refused(choice) is not None:
        return choice
    if by_runs is not None and abs(by_runs.compare(prior)) > parts[0].settings.weighing.used_within_std:
        return choice
    return replace(choice, tried=[with_prior_mass(each, prior) if each is parts[0] else each for each in choice.tried])


def _log_structure(study: Study, fitted: FittedStructure) -> None:
    """Log which structure was fitted, with which laws, and how well."""
    names = ", ".join(study.names[k] for k in fitted.interfaces)
    if not fitted.has_fit:
        logger.info("%s (%s) has no fit: %s", IN_WORDS[fitted.kind], names, fitted.reason)
        return
    laws = ", ".join(dict.fromkeys(law.name for law in fitted.fit.laws.values()))
    over, n = fitted.residual_over_noise, fitted.fit.n_evaluations
    message = "%s (%s): law %s, %.2f times the sensors' noise, %d evaluations in the last fit"
    logger.info(message, IN_WORDS[fitted.kind], names, laws, over, n)


def _explain_only_for_model(name: str, value: object, method: str) -> str:
    """Return why an argument cannot be used by the paper's chain."""
    if isinstance(value, Settings):
        return (
            f"settings are those of the method 'model', and the method is {method!r}: leave them out, or give "
            "PaperSettings to opid.suspensions.paper.identification.identify_by_paper"
        )
    return f"{name} is {value!r}, which the method {method!r} does not know: leave it out, or give method='model'"


def check_study(study: Study, settings: Settings) -> Study:
    """Return the study with lesser findings about its channels in the runs, as warnings.

    Args:
        study: the study.
        settings: settings of the estimator.

    Raises:
        InputError: channels that cannot be a pair, or a run of a body that is too short.
    """
    runs = []
    for run in study.runs:
        if not study.is_one_gear and run.recording.duration_s < settings.runs.least_s:
            raise InputError(
                f"run {run.name!r} lasts {run.recording.duration_s:.3g} s: give at least {settings.runs.least_s:g} s"
            )
        pairs = [(interface.unsprung, interface.sprung) for interface in study.interfaces]
        used = {*study.channels("unsprung"), *study.channels("sprung")}
        found = check_channels(run.recording, pairs, sorted(used), run=run.name)
        runs.append(replace(run, findings=(*run.findings, *found)))
    return replace(study, runs=tuple(runs))


def collect_arrays(study: Study) -> tuple[Arrays, tuple[int, int]]:
    """Return the accelerations of each run below, on and across the body, and the number of mended spikes per side.

    Those on the body end with the readings of strut sensors, scaled to the size of accelerations.

    Args:
        study: the study.
    """
    mended = {"unsprung": 0, "sprung": 0}
    of_struts = (each.channel for _, each in study.strut_sensors)
    scales = dict(zip(of_struts, study.strut_scales, strict=True))
    found = []
    for run in study.runs:
        sides: list[FloatArray] = []
        for side in ("unsprung", "sprung"):
            columns = []
            for name in study.channels(side):
                samples, indices = remove_spikes(run.recording.channel(name), fs=study.fs)
                columns.append(scales.get(name, 1.0) * samples)
                mended[side] += indices.size
            sides.append(np.stack(columns, axis=1))
        across = [run.recording.channel(channel) for channel, *_ in study.leaks()]
        none = np.empty((len(sides[0]), 0))
        found.append((sides[0], sides[1], np.stack(across, axis=1) if across else none))
    return found, (mended["unsprung"], mended["sprung"])


def _fit_structures(task: Task) -> list[FittedStructure]:
    study, found, quiet = task.study, [], replace(task, say=lambda step: None)
    assert study is not None
    wanted = study.structure.kind
    if wanted in ("auto", "single"):
        for k, name in enumerate(study.names):
            task.say(f"{name} alone" if len(study.names) > 1 else "model")
            found.append(fit_alone(task if study.names == (name,) else quiet, (k,)))
    if wanted in ("auto", "pair"):
        pairs = symmetric_pairs(study)
        for pair in pairs:
            task.say(f"mean of {' and '.join(study.names[k] for k in pair)}")
            found.append(fit_alone(quiet, pair))
        if wanted == "pair":
            paired = {k for pair in pairs for k in pair}
            found += [fit_alone(quiet, (k,)) for k in range(len(study.names)) if k not in paired]
    if wanted == "rigid_body" or (wanted == "auto" and not list(rigid_faults(study))):
        task.say("rigid body")
        of_body = replace(task, say=lambda step: task.say(f"rigid body, {step}"))
        if found and all(part.explains for part in found if part.kind == "single"):
            # The answer is about the gears, so no sensor faults that would make one body of them are searched.
            question = replace(task.question, faults=False)
            of_body = replace(of_body, question=question, is_for_comparison=True)
        found.append(fit_rigid(of_body))
    return found


def _choose_structure(study: Study, tried: Sequence[FittedStructure]) -> Choice:
    """Return the simplest structure that explains the runs."""
    explains: dict[str, bool] = {}
    ratios: dict[str, float] = {}
    leaves: dict[str, str] = {}
    for kind in ("single", "pair", "rigid_body"):
        parts = parts_of(tried, kind)
        complete = sum(len(part.interfaces) for part in parts) == len(study.interfaces)
        if parts and complete and any(part.kind == kind for part in parts):
            explains[kind] = all(part.explains for part in parts)
            ratios[kind] = max(part.residual_over_noise for part in parts)
            leaves[kind] = f"{IN_WORDS[kind]} {_describe_residual([part for part in parts if part.kind == kind])}"
    for kind in explains:
        if explains[kind]:
            because = f"{IN_WORDS[kind]} leaves {ratios[kind]:.2f} times the sensors' noise"
            if any(part.is_pushed for part in parts_of(tried, kind)):
                because += ", which is incoherent with every motion measured below it"
            elif ratios[kind] > parts_of(tried, kind)[0].settings.verdicts.explained:
                because += ", and is white as noise is"
            simpler = [leaves[other] for other in explains if not explains[other]]
            return Choice(study, tried, kind, f"{because}; {', '.join(simpler)}" if simpler else because)
    why = (
        f"no structure explains these runs: {', '.join(leaves.values())}; something else moves (a bending airframe, a "
        "load that shifts, wrong coordinates or loadings)"
    )
    return Choice(study, tried, min(ratios, key=lambda kind: ratios[kind]), why)


def _describe_residual(parts: Sequence[FittedStructure]) -> str:
    """Return the residual of the fits of a structure, in words."""
    ratio, explained = max(part.residual_over_noise for part in parts), parts[0].settings.verdicts.explained
    if not np.isfinite(ratio):
        return "cannot be fitted"
    left_out = max(part.left_out_over_noise or 0.0 for part in parts)
    least = over_noise(min(part.residual_over_noise for part in parts))
    most = over_noise(ratio)
    said = f"leaves {most if least == most else f'{least} to {most}'} times the noise"
    if ratio <= explained < left_out:
        said += f", but {over_noise(left_out)} in runs that the others predict"
    return said


def _make_answer(
    task: Task, choice: Choice, by_runs: InverseMass | None, options: Options, mended: tuple[int, int]
) -> Identification:
    study, parts, tried = choice.study, choice.parts, choice.tried
    refused, unscaled = why_refused(choice), why_no_mass(choice)
    reason = refused or _explain_failure(choice) or unscaled
    has_mass = reason is None and len(parts) == 1
    evidence = tuple(
        _collect_evidence(part, options, is_refused=refused is not None, has_mass=has_mass) for part in parts
    )
    per_mass = unscaled is not None or (study.is_one_gear and refused is not None)
    numbers = collect_numbers(choice, evidence, per_mass=per_mass, ground=options.ground and not study.forces)
    loose = loose_motions(choice, numbers.parameters, numbers.ratios)
    confounded = [find_confounded_terms(part) for part in parts]
    reported = numbers.without_motions(loose)
    if not choice.explains and not study.is_one_gear:
        # The error of a structure is not noise and does not average out.
        reported = reported.without_intervals()
    if refused is None and any(is_biased(part) for part in parts):
        reported = reported.without_intervals()
    mass = Estimate() if reason else numbers.parameters.sprung_mass_kg
    has_prior = any(part.fit.model.has_prior_mass for part in parts)
    weighed = compare_with_weighed(
        study, mass, settings=task.settings.weighing, by_runs=by_runs if mass.value else None, has_prior=has_prior
    )
    for part, terms in zip(parts, confounded, strict=True):
        reported = reported.without_intervals_of(terms, _list_members(study, part))
    if reason:
        reported = reported.without_scale()
    if refused:
        reported = reported.without_values()
    answer = Answer(
        choice=choice,
        evidence=evidence,
        mass=mass,
        interfaces=reported.interfaces,
        loose=loose,
        confounded=confounded,
        per_mass=per_mass,
        is_refused=refused is not None,
        mended_spikes=mended,
    )
    believed = all(part.explains and not part.known.has_negative_mass for part in parts)
    return Identification(
        study=study,
        structure=choice.kind,
        parameters=reported.parameters,
        ratios=reported.ratios,
        per_mass=per_mass,
        interfaces=reported.interfaces,
        place_corrections=reported.corrections,
        candidates=tuple(
            _build_candidate(study, each, recommended=believed and each.kind == choice.kind) for each in tried
        ),
        why=choice.why,
        runs=_build_runs(study, parts, task.arrays),
        noise_m_per_s2=parts[0].level if len(parts) == 1 else noise_level(task.noise.levels),
        residual_over_noise=choice.ratio,
        evidence=evidence,
        mended_spikes=mended,
        warnings=(*collect_warnings(answer), *warn_of_weighed(study, weighed, task.settings.weighing)),
        not_determined=reason,
        options=options,
        settings=task.settings,
        equivalents=_compute_equivalents(study, parts) if study.is_one_gear and not refused else (),
        weighed=weighed,
    )


def _compute_equivalents(study: Study, parts: Sequence[FittedStructure]) -> tuple[Equivalent, ...]:
    """Return the equivalent linear suspension of one gear in each run."""
    (part,), found = parts, []
    lacking = part.error.of_equivalents.tolist() if part.error is not None and part.error.limit == "model" else None
    # A model error changes the equivalents of each run by its own fractions, besides the noise.
    known = part.known if lacking is None else replace(part, error=None).known
    for index, run in enumerate(study.runs):
        estimates = known.equivalent(index)
        if lacking is not None:
            estimates = [
                each if each.value is None else _widen(each, std_fraction)
                for each, std_fraction in zip(estimates, lacking[index], strict=True)
            ]
        estimates[2:] = withhold_frequency(*estimates[2:])
        if is_biased(part):
            estimates = [each.without_interval() for each in estimates]
        found.append(Equivalent(run.name, *estimates))
    return tuple(found)


def _widen(estimate: Estimate, std_fraction: float) -> Estimate:
    """Return an estimate with a further relative standard deviation; without an interval if that is unknown."""
    value = estimate.value or 0.0
    if estimate.std is None or not np.isfinite(std_fraction):
        return Estimate(estimate.value)
    return Estimate.normal(value, float(np.hypot(estimate.std, std_fraction * value)))


def _list_members(study: Study, part: FittedStructure) -> dict[str, list[str]]:
    """Return the names of the interfaces of each group of a fit."""
    groups = part.fit.model.groups
    if part.kind == "rigid_body":
        return {group.name: [study.names[attachment] for attachment in group.members] for group in groups}
    return {group.name: [study.names[k] for k in part.interfaces] for group in groups}


def _collect_evidence(part: FittedStructure, options: Options, *, is_refused: bool, has_mass: bool) -> Evidence:
    fit, found = part.fit, part.found
    assert found is not None  # parts have fits
    rng, mass = np.random.default_rng(options.seed), part.known.mass if has_mass else Estimate()
    is_pushed = part.error is not None and part.error.limit == "unmeasured forces"
    resampled = [] if is_refused else bootstrap_over_white(fit, rng).tolist()
    return Evidence(
        fit=fit,
        noise=part.level,
        ladder=part.ladder,
        alternatives=alternatives(part.ladder, part.settings.search),
        demands=part.demands,
        implausible=() if is_refused else part.implausible,
        whiteness=measure_whiteness(fit),
        std_over_white=dict(zip(fit.model.names, std_over_white(fit).tolist(), strict=False)),
        bootstrap_over_white=dict(zip(fit.model.names, resampled, strict=False)),
        surfaces={group.name: force_surface(fit, group.members[0]) for group in fit.model.groups},
        ground=ground_imitations(fit),
        limits=tuple(limits(part.known, part.repeatability, mass, is_pushed=is_pushed)),
        repeatability=part.repeatability,
        n_starts=found.n_starts,
        error=part.error,
        interfaces=part.interfaces,
        covariance=part.known.covariance,
        gains_of_forces=estimate_gains(part) if has_mass else {},
    )


def _explain_failure(choice: Choice) -> str | None:
    """Return why there is no total mass although some gears are fitted."""
    failed = [part for part in parts_of(choice.tried, choice.kind) if not part.has_fit]
    if not failed:
        return None
    return f"{choice.names(failed)} cannot be fitted ({failed[0].reason}), so there is no mass of the whole"


def _build_candidate(study: Study, part: FittedStructure, *, recommended: bool) -> Candidate:
    names = tuple(study.names[k] for k in part.interfaces)
    mass, negative = Estimate(), False
    if part.has_fit and part.fit.model.mass_free:
        mass, negative = part.known.mass, part.known.has_negative_mass
        # A wrong structure shows its mass without an interval; a right one shows no mass if it has no interval.
        if mass.std is None or not part.explains:
            mass = Estimate() if part.explains else Estimate(mass.value)
    if not part.has_fit:
        why = part.reason
    elif part.explains:
        what = "due to unmeasured forces" if part.is_pushed else "the sensors' noise"
        why = f"its residual is {what}" + (", but its mass would be negative" if negative else "")
    elif part.residual_over_noise <= part.settings.verdicts.explained:
        why = (
            f"it leaves the sensors' noise, but {part.left_out_over_noise:.3g} times as much in runs that the others "
            "predict: the runs contradict each other"
        )
    else:
        why = (
            f"it leaves {part.residual_over_noise:.3g} times the sensors' noise: this structure does not fit these "
            "gears"
        )
    laws = part.fit.laws.values() if part.has_fit else ()
    return Candidate(
        kind=part.kind,
        interfaces=names,
        sprung_mass_kg=mass,
        residual_over_noise=part.residual_over_noise,
        left_out_over_noise=part.left_out_over_noise,
        law="; ".join(dict.fromkeys(law.name for law in laws)),
        explains=part.explains,
        recommended=recommended,
        why=why,
    )


def _build_runs(study: Study, parts: Sequence[FittedStructure], arrays: Arrays) -> tuple[RunResidual, ...]:
    found = []
    for index, run in enumerate(study.runs):
        residual, measured, predicted = [], [], []
        first = len(arrays[index][1]) // 4
        shown = slice(first, first + round(_SHOWN_S * study.fs))
        for part in parts:
            fit = part.fit
            used, line = fit.model.runs[index], fit.errors.lines[index]
            read = fit.model.correct(fit.theta, index)[1].value
            n_sensors = read.shape[1] - used.n_strut
            residual += list(np.abs(line.reshape(-1, used.omega.size)) / np.sqrt(2))
            steps = slice(shown.start * used.finer, shown.stop * used.finer, used.finer)
            measured += list(read[steps, :n_sensors].T)
            predicted += list(fit.errors.predictions[index].acceleration[steps, :n_sensors].T)
        used = parts[0].fit.model.runs[index]
        n = min(len(each) for each in measured)
        found.append(
            RunResidual(
                name=run.name,
                mass_change_kg=run.mass_change_kg,
                frequency_hz=used.omega / (2 * np.pi),
                residual=np.array(residual),
                time_s=(shown.start + np.arange(n)) / study.fs,
                measured=np.array(measured),
                predicted=np.array(predicted),
                loading=tuple((each.mass_kg, each.x_m, each.y_m) for each in run.masses),
                unexplained=max(part.unexplained[index] for part in parts),
            )
        )
    return tuple(found)
