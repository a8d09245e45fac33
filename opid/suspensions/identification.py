"""From a study of a body on several suspensions to an answer: structures compared, one recommended, its numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.estimate import Estimate
from opid.mechanics.laws import Law, default_law
from opid.signals.health import without_spikes
from opid.signals.recording import FloatArray
from opid.suspensions.band_lines import BAND_HZ
from opid.suspensions.candidates import Fitted, fitted_alone, fitted_rigid
from opid.suspensions.doubts import doubts, loose_motions, mass_doubt, refusal
from opid.suspensions.fit import EXPLAINS
from opid.suspensions.intervals import honest_covariance, mass_of, negative_mass
from opid.suspensions.levels import FAR_OFF, is_white, noise_levels, over_noise
from opid.suspensions.numbers import found_numbers
from opid.suspensions.result import BodyIdentification, Candidate, RunResidual
from opid.suspensions.study import BodyStudy, rigid_faults, symmetric_pairs

# three periods of the slowest motion that is compared
LEAST_S = 10.0
# of a run in a figure
SHOWN_S = 6.0

IN_WORDS = {"single": "each gear alone", "pair": "the mean of left and right", "rigid_body": "one rigid body"}

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
        InputError: an unknown law, a run of less than 10 s, or interfaces that make no rigid body where one is asked
            for.
        NotDeterminedError: no structure can be fitted at all.
    """
    say = progress or (lambda step: None)
    for run in study.runs:
        if run.recording.duration_s < LEAST_S:
            raise InputError(f"run {run.name!r} lasts {run.recording.duration_s:.3g} s: give at least {LEAST_S:g} s")
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
    lacks: dict[str, float] = {}
    ratios: dict[str, float] = {}
    leaves: dict[str, str] = {}
    for kind in ("single", "pair", "rigid_body"):
        parts = _parts(study, tried, kind)
        complete = sum(len(part.interfaces) for part in parts) == len(study.interfaces)
        if parts and complete and any(part.kind == kind for part in parts):
            lacks[kind] = max(part.lack for part in parts)
            ratios[kind] = max(part.residual_over_noise for part in parts)
            leaves[kind] = f"{IN_WORDS[kind]} {_leaves([part for part in parts if part.kind == kind])}"
    for kind, lack in lacks.items():
        if lack <= EXPLAINS:
            because = f"{IN_WORDS[kind]} leaves {ratios[kind]:.2f} times the sensors' noise"
            simpler = [leaves[other] for other in lacks if lacks[other] > EXPLAINS]
            return kind, f"{because}; {', '.join(simpler)}" if simpler else because
    best = min(ratios, key=lambda kind: ratios[kind])
    return best, (
        f"no structure explains these runs: {', '.join(leaves.values())}; something else moves (a bending airframe, a "
        "load that shifts, wrong coordinates or loadings)"
    )


def _leaves(parts: Sequence[Fitted]) -> str:
    """What the fits of a structure leave, in words."""
    ratio = max(part.residual_over_noise for part in parts)
    if not np.isfinite(ratio):
        return "cannot be fitted"
    left_out = max(part.left_out_over_noise or 0.0 for part in parts)
    least = over_noise(min(part.residual_over_noise for part in parts))
    most = over_noise(ratio)
    said = f"leaves {most if least == most else f'{least} to {most}'} times the noise"
    if ratio <= EXPLAINS < left_out:
        said += f", but {over_noise(left_out)} in runs that the others predict"
    return said


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
    covariances = [honest_covariance(part.found) for part in parts]
    unscaled = mass_doubt(study, parts, covariances, ratio)
    reason = refusal(study, parts, ratio) or _failure(study, _parts(study, tried, kind)) or unscaled
    numbers = found_numbers(study, kind, parts, covariances, per_mass=unscaled is not None)
    mass = numbers.parameters["sprung_mass_kg"]
    loose = []
    if kind == "rigid_body" and ratio <= FAR_OFF:
        loose = loose_motions(parts[0].found, numbers.parameters, numbers.ratios)
    numbers = numbers.told(ratio, max(part.lack for part in parts), reason, loose)
    believed = all(part.explains for part in parts) and not _any_negative(parts, covariances)
    return BodyIdentification(
        title=study.title,
        date=study.date,
        structure=kind,
        parameters=numbers.parameters,
        ratios=numbers.ratios,
        per_mass=unscaled is not None,
        interfaces=numbers.interfaces,
        places={each.name: (*each.place, *each.sensor_place) for each in study.interfaces},
        place_corrections=numbers.corrections,
        candidates=tuple(_candidate(study, each, recommended=believed and each.kind == kind) for each in tried),
        runs=_runs(study, parts, arrays),
        noise_m_per_s2=float(np.sqrt(np.mean(np.square(noises)))),
        residual_over_noise=ratio,
        diagnostics=_diagnostics(study, parts, why, settings),
        warnings=tuple(
            doubts(study, tried, parts, why=why, ratio=ratio, mass=Estimate() if reason else mass, loose=loose)
        ),
        not_determined=reason,
    )


def _failure(study: BodyStudy, parts: Sequence[Fitted]) -> str | None:
    """Why there is no mass of the whole though some gears are fitted."""
    failed = [part for part in parts if part.fit is None]
    if not failed:
        return None
    names = ", ".join(study.names[k] for part in failed for k in part.interfaces)
    return f"{names} cannot be fitted ({failed[0].reason}), so there is no mass of the whole"


def _any_negative(parts: Sequence[Fitted], covariances: Sequence[FloatArray]) -> bool:
    return any(negative_mass(part.found, each) for part, each in zip(parts, covariances, strict=True))


def _candidate(study: BodyStudy, part: Fitted, *, recommended: bool) -> Candidate:
    names = tuple(study.names[k] for k in part.interfaces)
    mass, negative = Estimate(), False
    if part.fit is not None and part.found.model.mass_free:
        covariance = honest_covariance(part.found)
        mass, negative = mass_of(part.found, covariance), negative_mass(part.found, covariance)
        # what a wrong structure says is shown, as what it is; a mass between nothing and infinity is none
        if mass.std is None or not part.explains:
            mass = Estimate() if part.explains else Estimate(mass.value)
    if part.fit is None:
        why = part.reason
    elif part.explains:
        why = "what it leaves is the sensors' noise" + (", but its mass would be negative" if negative else "")
    elif part.residual_over_noise <= EXPLAINS:
        why = (
            f"it leaves the sensors' noise, but {part.left_out_over_noise:.3g} times as much in runs that the others "
            "predict: the runs do not go together"
        )
    else:
        why = f"it leaves {part.residual_over_noise:.3g} times the sensors' noise: these gears do not move like that"
    return Candidate(
        kind=part.kind,
        interfaces=names,
        sprung_mass_kg=mass,
        residual_over_noise=part.residual_over_noise,
        left_out_over_noise=part.left_out_over_noise,
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
        "laws_tried": [
            {"law": step.law, "bic": step.bic, "kept": step.kept, "fs_hz": step.fs}
            for part in parts
            for step in part.steps
        ],
        **settings,
    }
