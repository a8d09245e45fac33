"""What the runs of a body do not tell, and what to doubt of what they tell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from opid.estimate import Estimate
from opid.signals.recording import FloatArray
from opid.suspensions.band_lines import BAND_HZ, HIGHEST_SHARE
from opid.suspensions.candidates import Fitted
from opid.suspensions.fit import EXPLAINS, BodyFit
from opid.suspensions.intervals import mass_of, negative_mass
from opid.suspensions.levels import FAR_OFF, LOOSELY_KNOWN, REFUSED, is_white, level_of, motion_over_noise, over_noise
from opid.suspensions.model import FARTHEST_STD
from opid.suspensions.study import BodyStudy, rigid_faults

# a scale that rests on less, or gives less, may be in another unit
LEAST_LOADING_KG, LEAST_MASS_KG = 5.0, 50.0
# a motion of less, over what the noise alone would make of it, does not tell its inertia
LEAST_MOTION = 2.0
WITHOUT_INTERVALS = "the intervals are withheld: what the structure leaves is no noise, and does not average out"
# a coordinate that moves by more standard deviations of its tolerance is named
FAR_STD = 3.5


def mass_doubt(
    study: BodyStudy, parts: Sequence[Fitted], covariances: Sequence[FloatArray], ratio: float
) -> str | None:
    """Return why the runs do not tell the mass of some part of the answer; None if they tell all.

    Args:
        study: the study.
        parts: fits that make up the answer.
        covariances: of their shared parameters.
        ratio: residual over noise of the worst of them.
    """
    untold = [part for part in parts if not part.found.model.mass_free]
    changes = ", ".join(f"{run.name!r} {run.mass_change_kg:+g} kg" for run in study.runs)
    if len(untold) == len(parts):
        if len(study.runs) == 1:
            return (
                "one run gives ratios to the mass alone: record a second one with a known mass more or less, and give "
                "its `loading`"
            )
        return (
            "all runs have the same loading: only ratios to the mass can be told; give `loading` to the runs that "
            "carried more or less"
        )
    if untold:
        return (
            f"the loading ({changes}) does not rest on {_names(study, untold)}: only ratios to the mass can be told; "
            "change it there, too"
        )
    pairs = list(zip(parts, covariances, strict=True))
    loose = [part for part, covariance in pairs if _loose(mass_of(part.found, covariance))]
    if not loose:
        return None
    if ratio > FAR_OFF:
        return (
            f"the structure leaves {over_noise(ratio)} times the sensors' noise, and no mass fits the runs"
            f"{worst_sensor(study, parts)}: check places, signs and masses of the loadings first"
        )
    negative = [part for part, covariance in pairs if negative_mass(part.found, covariance)]
    if negative:
        where = "" if len(parts) == 1 else f" on {_names(study, negative)}"
        return (
            f"the mass{where} would be negative: check the sign of the loading ({changes}), or whether two runs are "
            "exchanged"
        )
    return (
        f"the change of loading ({changes}) moves too little of what the sensors see to give the mass"
        f"{'' if len(parts) == 1 else ' on ' + _names(study, loose)}: change it more, or at a place that moves more"
    )


def refusal(study: BodyStudy, parts: Sequence[Fitted], ratio: float) -> str | None:
    """Return why there are no numbers at all; None if there are.

    Args:
        study: the study.
        parts: fits that make up the answer.
        ratio: residual over noise of the worst of them.
    """
    if ratio <= REFUSED:
        return None
    return (
        f"every number would be a guess, for the structure leaves {over_noise(ratio)} times the sensors' noise"
        f"{worst_sensor(study, parts)}: {_instead(study, parts)}"
    )


def _instead(study: BodyStudy, parts: Sequence[Fitted]) -> str:
    """What to do where a structure is refused."""
    faults = list(rigid_faults(study))
    if any(part.kind == "rigid_body" for part in parts):
        return (
            "check channels (exchanged, upside down, in another unit), coordinates and loadings, or describe the "
            "structure by its own matrices"
        )
    if faults:
        return f"these gears do not move alone, and one rigid body cannot be tried: {'; '.join(faults)}"
    if study.structure.kind == "auto":
        return "check channels (exchanged, upside down, in another unit), coordinates and loadings"
    return 'these gears do not move alone: try kind = "auto" or "rigid_body"'


def worst_sensor(study: BodyStudy, parts: Sequence[Fitted]) -> str:
    """Return which sensor on the body the answer leaves most of, as the end of a sentence; "" where there is one alone.

    Args:
        study: the study.
        parts: fits that make up the answer.
    """
    levels: list[tuple[float, str]] = []
    for part in parts:
        names = [interface.sprung for interface in study.interfaces]
        names += [sensor.channel for sensor in study.sensors]
        if part.kind != "rigid_body":
            names = [" and ".join(names[k] for k in part.interfaces)]
        levels += [(level_of(part.found, slot) / part.noise, name) for slot, name in enumerate(names)]
    if len(levels) < 2:
        return ""
    *others, (most, name) = sorted(levels)
    least, next_to_it = over_noise(others[0][0]), over_noise(others[-1][0])
    others_leave = least if least == next_to_it else f"{least} to {next_to_it}"
    return f"; most at {name!r}: {over_noise(most)}, the others {others_leave}"


def loose_motions(fit: BodyFit, parameters: Mapping[str, Estimate], ratios: Mapping[str, Estimate]) -> list[str]:
    """Return "roll", "pitch" or both: motions of a rigid body whose inertia the runs hardly tell.

    A motion that is noise alone gives an inertia that explains noise, with an interval as sharp as it is wrong.

    Args:
        fit: of the rigid body.
        parameters: of the body; empty where the mass is not determined.
        ratios: of the body, intervals included.
    """
    loose, moved = [], motion_over_noise(fit)
    for motion in ("roll", "pitch"):
        radius, inertia = ratios[f"{motion}_radius_m"], parameters[f"{motion}_inertia_kg_m2"]
        # of the square, as of the inertia
        square = Estimate(radius.value, None if radius.std is None else 2 * radius.std)
        if moved[motion] < LEAST_MOTION or _loose(square) or (inertia.value is not None and _loose(inertia)):
            loose.append(motion)
    return loose


def doubts(
    study: BodyStudy,
    tried: Sequence[Fitted],
    parts: Sequence[Fitted],
    *,
    why: str,
    ratio: float,
    mass: Estimate,
    loose: Sequence[str],
) -> Iterator[str]:
    """Yield what to doubt of an answer, one sentence each.

    Args:
        study: the study.
        tried: all fits.
        parts: those that make up the answer.
        why: sentence of the choice of the structure.
        ratio: residual over noise of the worst part.
        mass: that was found.
        loose: motions whose inertia is hardly told.
    """
    for run in study.runs:
        for finding in run.findings:
            if finding.severity != "note":
                channel = f", {finding.channel!r}" if finding.channel else ""
                yield f"run {run.name!r}{channel}: {finding.message}"
    yield from _of_the_record(study, parts)
    yield from _of_the_structure(study, parts, why, ratio)
    if study.structure.kind == "auto" and len(study.interfaces) > 1 and not any(p.kind == "rigid_body" for p in tried):
        yield f"one rigid body was not tried: {'; '.join(rigid_faults(study))}"
    for part in tried:
        if part.kind == "rigid_body" and part.fit is not None and not part.explains and part not in parts:
            yield (
                f"one rigid body leaves {over_noise(part.residual_over_noise)} times the noise"
                f"{worst_sensor(study, [part])}: look at that sensor first"
            )
    yield from _of_the_scale(study, mass)
    for motion in loose:
        yield _untold_motion(motion)
    # of a structure that is refused, places are no more than what the search came to
    for part in parts if ratio <= REFUSED else ():
        for coordinate, value, more in _far(part):
            yield (
                f"{coordinate} would have to be {100 * value:+.1f} cm{' or more' if more else ''} from where it is "
                "stated to be: check the drawing, and the places of the loadings"
            )


def _of_the_record(study: BodyStudy, parts: Sequence[Fitted]) -> Iterator[str]:
    """What neither a structure nor a law can mend."""
    if study.structure.noise_m_per_s2 is None:
        yield (
            f"the noise of the sensors, {1e3 * max(part.noise for part in parts):.2g} mm/s^2, is taken from their "
            "quietest spectra, a bound from above: state `noise_m_per_s2` if you know it"
        )
    if HIGHEST_SHARE * study.fs < BAND_HZ[1]:
        yield (
            f"the runs are sampled at {study.fs:g} Hz, and compared up to {HIGHEST_SHARE * study.fs:g} Hz: what moves "
            f"faster is not in them, or folded; record at {BAND_HZ[1] / HIGHEST_SHARE:g} Hz or more"
        )


def _of_the_structure(study: BodyStudy, parts: Sequence[Fitted], why: str, ratio: float) -> Iterator[str]:
    lack = max(part.lack for part in parts)
    if lack > EXPLAINS:
        yield why + (worst_sensor(study, parts) if EXPLAINS < ratio <= REFUSED else "")
        if ratio <= EXPLAINS or (lack > 1.1 * ratio and ratio <= REFUSED):
            yield (
                f"runs that the others predict leave {over_noise(lack)} times the noise: a loading may have another "
                "mass or stand elsewhere than stated, or something has changed between the runs"
            )
        if ratio <= REFUSED:
            yield WITHOUT_INTERVALS
    elif not all(is_white(part.found) for part in parts):
        yield (
            "what the structure leaves is not white, though little: a law or a coordinate may be missing; intervals "
            "allow for its colour"
        )
    if len(study.runs) > 1 and any(part.left_out is None for part in parts):
        yield (
            "the model cannot follow the runs without one of them: nothing is said of runs that the others predict; "
            "check the loading of each run"
        )


def _of_the_scale(study: BodyStudy, mass: Estimate) -> Iterator[str]:
    """A loading in tonnes scales everything, and is seen by nobody."""
    if mass.value is None:
        return
    largest = max((each for run in study.runs for each in run.loading), key=lambda each: abs(each.mass_kg))
    if abs(largest.mass_kg) < LEAST_LOADING_KG or mass.value < LEAST_MASS_KG:
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


def _loose(estimate: Estimate) -> bool:
    value, std = estimate.value, estimate.std
    return value is None or std is None or std > LOOSELY_KNOWN * value


def _names(study: BodyStudy, parts: Sequence[Fitted]) -> str:
    return ", ".join(study.names[k] for part in parts for k in part.interfaces)


def _far(part: Fitted) -> Iterator[tuple[str, float, bool]]:
    """Coordinates that moved far, how far, and whether as far as they are looked for."""
    model = part.found.model
    for coordinate in model.body.coordinates:
        value = float(part.found.theta[model.names.index(coordinate.name)])
        if abs(value) > FAR_STD * coordinate.std:
            yield coordinate.name, value, abs(value) > 0.999 * FARTHEST_STD * coordinate.std
