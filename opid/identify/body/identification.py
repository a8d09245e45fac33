"""From a study of a body on several suspensions to an answer: structures compared, one recommended, its numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from opid.errors import NotDeterminedError
from opid.estimate import Estimate
from opid.identify.band_lines import BAND_HZ
from opid.identify.body.candidates import EXPLAINS, Fitted, fitted_alone, fitted_rigid
from opid.identify.body.intervals import body_estimates, mass_of, suspension_estimates
from opid.identify.body.levels import (
    LOOSELY_KNOWN,
    REFUSED,
    WITHHELD,
    is_white,
    level_of,
    noise_levels,
    thinned,
    widened,
)
from opid.identify.body.result import (
    BODY_PARAMETERS,
    BODY_RATIOS,
    BodyIdentification,
    Candidate,
    InterfaceEstimate,
    RunResidual,
)
from opid.identify.body.study import BodyStudy, rigid_faults, symmetric_pairs
from opid.mechanics.laws import Law, default_law
from opid.signals.health import without_spikes
from opid.signals.recording import FloatArray

# of a run in a figure
SHOWN_S = 6.0

Say = Callable[[str], None]


def identify_body(
    study: BodyStudy,
    *,
    law: str | None = None,
    band_hz: tuple[float, float] = BAND_HZ,
    progress: Say | None = None,
) -> BodyIdentification:
    """Identify a body on several suspensions from the motion measured on either side of each.

    Every sensor on the body is predicted from all sensors below its suspensions. With `kind = "auto"` each gear alone
    under its static share of the mass, the mean of symmetric pairs, and one rigid body are fitted to the same data; the
    simplest that leaves no more than the sensors' noise is recommended.

    Args:
        study: interfaces, runs, and what is said of the structure.
        law: to fit at every interface (`opid.mechanics.laws.LAWS`, sums joined by "+"); searched where left out.
        band_hz: lines of the prediction errors that count, Hz.
        progress: called with the name of each step as it begins.

    Returns:
        The identification; `not_determined` says why where the data do not give absolute values.

    Raises:
        InputError: an unknown law, or interfaces that make no rigid body where one is asked for.
        NotDeterminedError: no structure can be fitted at all.
    """
    say = progress or (lambda step: None)
    arrays = _arrays(study)
    noises = noise_levels(study.structure.noise_m_per_s2, arrays, fs=study.fs)
    tried = _tried(study, arrays, noises, None if law is None else default_law(law), band_hz, say)
    if all(each.fit is None for each in tried):
        raise NotDeterminedError("no structure can be fitted to these runs: " + "; ".join(e.reason for e in tried))
    kind, why = _chosen(study, tried)
    say("intervals")
    return _answer(study, tried, kind, why, noises, arrays, {"law": law or "searched", "band_hz": list(band_hz)})


def _arrays(study: BodyStudy) -> list[tuple[FloatArray, FloatArray]]:
    """Accelerations below and on the body of each run, single spikes mended."""
    below = [interface.unsprung for interface in study.interfaces]
    above = [*(interface.sprung for interface in study.interfaces), *(sensor.channel for sensor in study.sensors)]

    def samples(place: int, names: Sequence[str]) -> FloatArray:
        recording = study.runs[place].recording
        return np.stack([without_spikes(recording.channel(name), fs=study.fs)[0] for name in names], axis=1)

    return [(samples(place, below), samples(place, above)) for place in range(len(study.runs))]


def _tried(
    study: BodyStudy,
    arrays: Sequence[tuple[FloatArray, FloatArray]],
    noises: FloatArray,
    law: Law | None,
    band_hz: tuple[float, float],
    say: Say,
) -> list[Fitted]:
    wanted, found = study.structure.kind, []
    if wanted in ("auto", "single"):
        for k, name in enumerate(study.names):
            say(f"{name} alone")
            found.append(fitted_alone(study, arrays, noises, (k,), law=law, band_hz=band_hz))
    if wanted in ("auto", "pair"):
        pairs = symmetric_pairs(study)
        for pair in pairs:
            say(f"mean of {' and '.join(study.names[k] for k in pair)}")
            found.append(fitted_alone(study, arrays, noises, pair, law=law, band_hz=band_hz))
        if wanted == "pair":
            paired = {k for pair in pairs for k in pair}
            for k in sorted(set(range(len(study.names))) - paired):
                found.append(fitted_alone(study, arrays, noises, (k,), law=law, band_hz=band_hz))
    if wanted == "rigid_body" or (wanted == "auto" and not list(rigid_faults(study))):
        say("rigid body")

        def told(step: str) -> None:
            say(f"rigid body, {step}")

        found.append(fitted_rigid(study, arrays, noises, law=law, band_hz=band_hz, progress=told))
    return found


def _parts(study: BodyStudy, tried: Sequence[Fitted], kind: str) -> list[Fitted]:
    """The fits that make up the answer of a structure."""
    if kind == "rigid_body":
        return [each for each in tried if each.kind == "rigid_body"]
    pairs = [each for each in tried if each.kind == "pair"] if kind == "pair" else []
    paired = {k for each in pairs for k in each.interfaces}
    return [*pairs, *(each for each in tried if each.kind == "single" and each.interfaces[0] not in paired)]


def _chosen(study: BodyStudy, tried: Sequence[Fitted]) -> tuple[str, str]:
    """The simplest structure that explains the runs, and why."""
    worst, own = {}, {}
    for kind in ("single", "pair", "rigid_body"):
        parts = _parts(study, tried, kind)
        complete = sum(len(part.interfaces) for part in parts) == len(study.interfaces)
        if parts and complete and any(part.kind == kind for part in parts):
            worst[kind] = max(part.residual_over_noise for part in parts)
            own[kind] = max(part.residual_over_noise for part in parts if part.kind == kind)
    said = {"single": "each gear alone", "pair": "the mean of left and right", "rigid_body": "one rigid body"}
    for kind, ratio in worst.items():
        if ratio <= EXPLAINS:
            simpler = [f"{said[other]} {_leaves(own[other])}" for other in worst if worst[other] > EXPLAINS]
            because = f"{said[kind]} leaves {ratio:.2f} times the sensors' noise"
            return kind, f"{because}; {', '.join(simpler)}" if simpler else because
    best = min(worst, key=lambda kind: worst[kind])
    listed = ", ".join(f"{said[kind]} {_leaves(own[kind])}" for kind in worst)
    return best, (
        f"no structure explains these runs: {listed}; something else moves (a bending airframe, a load that shifts, "
        "wrong coordinates or loadings)"
    )


def _leaves(ratio: float) -> str:
    return f"leaves {ratio:.3g} times the noise" if np.isfinite(ratio) else "cannot be fitted"


def _answer(
    study: BodyStudy,
    tried: Sequence[Fitted],
    kind: str,
    why: str,
    noises: FloatArray,
    arrays: Sequence[tuple[FloatArray, FloatArray]],
    settings: dict[str, Any],
) -> BodyIdentification:
    parts = [part for part in _parts(study, tried, kind) if part.fit is not None]
    ratio = max(part.residual_over_noise for part in parts)
    explained = ratio <= EXPLAINS
    covariances = [widened(part) for part in parts]
    parameters, ratios = dict.fromkeys(BODY_PARAMETERS, Estimate()), dict.fromkeys(BODY_RATIOS, Estimate())
    if kind == "rigid_body":
        parameters, ratios = body_estimates(parts[0].found, covariances[0])
    else:
        parameters["sprung_mass_kg"] = _total(parts, covariances)
    reason = _not_determined(study, parts, parameters["sprung_mass_kg"], ratio)
    failed = [part for part in _parts(study, tried, kind) if part.fit is None]
    if failed:
        names = ", ".join(study.names[k] for part in failed for k in part.interfaces)
        reason = f"{names} cannot be fitted ({failed[0].reason}), so there is no mass of the whole"
        parameters = dict.fromkeys(BODY_PARAMETERS, Estimate())
    interfaces = _interfaces(study, parts, covariances, noises)
    corrections = _corrections(parts, covariances)
    if ratio > WITHHELD:
        parameters, ratios, corrections = (
            {name: Estimate(each.value) for name, each in table.items()} for table in (parameters, ratios, corrections)
        )
        interfaces = tuple(_without_intervals(each) for each in interfaces)
    if ratio > REFUSED or reason:
        parameters = dict.fromkeys(BODY_PARAMETERS, Estimate())
    if ratio > REFUSED:
        ratios = dict.fromkeys(BODY_RATIOS, Estimate())
        interfaces = tuple(
            replace(each, stiffness=Estimate(), damping=Estimate(), law_estimates={}) for each in interfaces
        )
    return BodyIdentification(
        title=study.title,
        date=study.date,
        structure=kind,
        parameters=parameters,
        ratios=ratios,
        per_mass=not parts[0].found.model.mass_free,
        interfaces=interfaces,
        places={each.name: (*each.place, *each.sensor_place) for each in study.interfaces},
        place_corrections=corrections,
        candidates=tuple(_candidate(study, each, kind, explained) for each in tried),
        runs=_runs(study, parts, arrays),
        noise_m_per_s2=float(np.sqrt(np.mean(np.square(noises)))),
        residual_over_noise=ratio,
        diagnostics=_diagnostics(study, parts, why, settings),
        warnings=tuple(_warnings(study, tried, parts, why, ratio)),
        not_determined=reason,
    )


def _total(parts: Sequence[Fitted], covariances: Sequence[FloatArray]) -> Estimate:
    """Mass of all gears together, where each is known."""
    if not all(part.found.model.mass_free for part in parts):
        return Estimate()
    value = variance = 0.0
    for part, covariance in zip(parts, covariances, strict=True):
        mass, count = mass_of(part.found, covariance), len(part.interfaces)
        if mass.value is None or mass.std is None:
            return Estimate()
        value, variance = value + count * mass.value, variance + (count * mass.std) ** 2
    return Estimate.normal(value, float(np.sqrt(variance)))


def _not_determined(study: BodyStudy, parts: Sequence[Fitted], mass: Estimate, ratio: float) -> str | None:
    if ratio > REFUSED:
        return (
            f"the structure leaves {ratio:.0f} times the sensors' noise, so every number of it would be a guess: check "
            "channels (exchanged, upside down, in another unit), coordinates and loadings, or describe the structure "
            "by its own matrices"
        )
    if not parts[0].found.model.mass_free:
        return (
            "all runs have the same loading: only ratios to the mass can be told; give `loading` to the runs that "
            "carried more or less"
        )
    if mass.value is None or mass.std is None or mass.std > LOOSELY_KNOWN * mass.value:
        if ratio > WITHHELD:
            return (
                f"the structure leaves {ratio:.1f} times the sensors' noise, and the mass that would explain most of "
                "it is no mass: check places, signs and masses of the loadings first"
            )
        changes = ", ".join(f"{run.name!r} {run.mass_change_kg:+g} kg" for run in study.runs)
        return (
            f"the change of loading ({changes}) moves too little of what the sensors see to give the mass: change it "
            "more, or at a place that moves more"
        )
    return None


def _interfaces(
    study: BodyStudy, parts: Sequence[Fitted], covariances: Sequence[FloatArray], noises: FloatArray
) -> tuple[InterfaceEstimate, ...]:
    found: dict[int, InterfaceEstimate] = {}
    noise = float(np.sqrt(np.mean(np.square(noises))))
    for part, covariance in zip(parts, covariances, strict=True):
        fit = part.found
        mu = fit.model.inverse_mass(fit.theta) if fit.model.mass_free else 1.0
        for number, group in enumerate(fit.groups()):
            stiffness, damping, law = suspension_estimates(fit, covariance, number)
            members = [part.interfaces[slot] for slot in group.slots] if part.kind == "rigid_body" else part.interfaces
            for k, member in enumerate(members):
                slot = group.slots[k] if part.kind == "rigid_body" else 0
                found[member] = InterfaceEstimate(
                    name=study.names[member],
                    shared_with=tuple(study.names[other] for other in members if other != member),
                    stiffness=stiffness,
                    damping=damping,
                    law=group.law.scaled(1 / mu) if group.law.terms else group.law,
                    law_estimates=law,
                    travel=thinned([p.travel[:, slot] for p in fit.errors.predictions]),
                    velocity=thinned([p.velocity[:, slot] for p in fit.errors.predictions]),
                    residual_over_noise=level_of(fit, slot) / (noise if part.kind == "rigid_body" else part.noise),
                )
    return tuple(found[k] for k in sorted(found))


def _without_intervals(each: InterfaceEstimate) -> InterfaceEstimate:
    law = {kind: {name: Estimate(e.value) for name, e in table.items()} for kind, table in each.law_estimates.items()}
    return replace(
        each, stiffness=Estimate(each.stiffness.value), damping=Estimate(each.damping.value), law_estimates=law
    )


def _corrections(parts: Sequence[Fitted], covariances: Sequence[FloatArray]) -> dict[str, Estimate]:
    found = {}
    for part, covariance in zip(parts, covariances, strict=True):
        for coordinate in part.found.model.body.coordinates:
            k = part.found.model.names.index(coordinate.name)
            found[coordinate.name] = Estimate.normal(float(part.found.theta[k]), float(np.sqrt(covariance[k, k])))
    return found


def _candidate(study: BodyStudy, part: Fitted, kind: str, explained: bool) -> Candidate:
    names = tuple(study.names[k] for k in part.interfaces)
    mass = Estimate()
    if part.fit is not None and part.found.model.mass_free:
        mass = mass_of(part.found, widened(part))
        # what a wrong structure says is shown, as what it is
        mass = mass if part.residual_over_noise <= WITHHELD else Estimate(mass.value)
    recommended = explained and part.kind == kind and part.explains
    if part.fit is None:
        why = part.reason
    elif part.explains:
        why = "what it leaves is the sensors' noise"
    else:
        why = f"it leaves {part.residual_over_noise:.3g} times the sensors' noise: these gears do not move like that"
    return Candidate(
        kind=part.kind,
        interfaces=names,
        sprung_mass_kg=mass,
        residual_over_noise=part.residual_over_noise,
        left_out_over_noise=None if part.left_out is None else part.left_out / part.noise,
        law="; ".join(
            dict.fromkeys(group.law.name for group in part.found.model.groups) if part.fit is not None else ("",)
        ),
        explains=part.explains,
        recommended=recommended,
        why=why,
    )


def _runs(
    study: BodyStudy, parts: Sequence[Fitted], arrays: Sequence[tuple[FloatArray, FloatArray]]
) -> tuple[RunResidual, ...]:
    found = []
    for place, run in enumerate(study.runs):
        residual, measured, predicted = [], [], []
        first = arrays[place][1].shape[0] // 4
        shown = slice(first, first + round(SHOWN_S * study.fs))
        for part in parts:
            fit = part.found
            used, line = fit.model.runs[place], fit.errors.lines[place]
            n_sensors = used.sprung.shape[1]
            residual += list(np.abs(line.reshape(n_sensors, -1)) / np.sqrt(2))
            steps = slice(shown.start * used.finer, shown.stop * used.finer, used.finer)
            measured += list(used.sprung[steps].T)
            predicted += list(fit.errors.predictions[place].acceleration[steps, :n_sensors].T)
        used = parts[0].found.model.runs[place]
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
                loading=tuple((each.mass_kg, each.x_m, each.y_m) for each in run.loading),
            )
        )
    return tuple(found)


def _diagnostics(study: BodyStudy, parts: Sequence[Fitted], why: str, settings: dict[str, Any]) -> dict[str, Any]:
    return {
        "study": None if study.source is None else str(study.source),
        "body_sensors": {sensor.channel: [sensor.x_m, sensor.y_m] for sensor in study.sensors},
        "why": why,
        "kind_asked_for": study.structure.kind,
        "position_tolerance_m": study.structure.position_tolerance_m,
        "noise_stated": study.structure.noise_m_per_s2 is not None,
        "runs": [{"name": run.name, "mass_change_kg": run.mass_change_kg} for run in study.runs],
        "n_data": sum(part.found.n_data for part in parts),
        "white": [is_white(part.found) for part in parts],
        "laws_tried": [{"law": step.law, "bic": step.bic, "kept": step.kept} for part in parts for step in part.steps],
        **settings,
    }


def _warnings(
    study: BodyStudy, tried: Sequence[Fitted], parts: Sequence[Fitted], why: str, ratio: float
) -> Iterator[str]:
    for run in study.runs:
        for finding in run.findings:
            if finding.severity != "note":
                channel = f", {finding.channel!r}" if finding.channel else ""
                yield f"run {run.name!r}{channel}: {finding.message}"
    if ratio > EXPLAINS:
        yield why
        if ratio <= WITHHELD:
            yield f"all intervals are widened {ratio / EXPLAINS:.2g} times for what the structure leaves"
        elif ratio <= REFUSED:
            yield "the intervals are withheld: what the structure leaves is no noise"
    white = all(is_white(part.found) for part in parts)
    if ratio <= EXPLAINS and not white:
        yield (
            "what the structure leaves is not white, though little: a law or a coordinate may be missing; intervals "
            "allow for its colour"
        )
    if study.structure.kind == "auto" and len(study.interfaces) > 1 and not any(p.kind == "rigid_body" for p in tried):
        yield f"one rigid body was not tried: {'; '.join(rigid_faults(study))}"
    for part in parts:
        for coordinate, value in _far(part):
            yield (
                f"{coordinate} would have to be {100 * value:+.1f} cm from where it is stated to be: check the drawing"
            )


def _far(part: Fitted) -> Iterator[tuple[str, float]]:
    model = part.found.model
    for coordinate in model.body.coordinates:
        value = float(part.found.theta[model.names.index(coordinate.name)])
        if abs(value) > 3.5 * coordinate.std:
            yield coordinate.name, value
