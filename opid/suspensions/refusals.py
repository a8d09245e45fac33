"""What the runs do not tell: no number at all, no mass, or no inertia; and why, one sentence each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from opid.estimate import Estimate
from opid.suspensions.candidates import Choice, Fitted
from opid.suspensions.faults import GROUND
from opid.suspensions.fit import Fit, fits_of_each_run, runs_contradict_each_other
from opid.suspensions.residual import motion_over_noise, over_noise, sensor_ratio
from opid.suspensions.result import BodyParameters, BodyRatios, GearParameters, GearRatios
from opid.suspensions.settings import Verdicts
from opid.suspensions.study import Study, rigid_faults


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
    search = "let the law be searched, " * part.law_is_given
    return (
        f"the fitted model {unexplained}, so every number of it would be a guess: check the channels (swapped, upside "
        f"down, in another unit) and the mass changes, {search}or take another band; or this gear is not alone on its "
        "body, which rolls and pitches on others: then describe all of them in [[interfaces]]"
    )


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
        law = "the given law may not be the strut's (let it be searched)"
        return (
            f"what the model leaves, {100 * unexplained_fraction(part):.2g} % of the body's acceleration and "
            f"{over_noise(choice.ratio)} times the sensors' noise, goes with the motion and bends the parameters, and "
            f"no mass can be told: {law if part.law_is_given else 'the law may be outside the library'}, this gear may "
            "not be alone on its body, which rolls and pitches on others (then describe all of them in "
            "[[interfaces]]), or the channels or the mass changes are not as stated; the ratios to the mass are given, "
            "as equivalents over the motion of these runs"
        )
    if is_loose and choice.ratio > choice.verdicts.doubtful:
        return (
            f"the fitted model leaves {over_noise(choice.ratio)} times the sensors' noise, and no mass fits the runs: "
            "this gear may not be alone on its body, which rolls and pitches on others (then describe all of them in "
            "[[interfaces]]), or the channels, the law or the mass changes are not as stated"
        )
    if is_loose and part.repeatability.rules_mass:
        differ = 100 * (part.repeatability.estimated or 0.0)
        return (
            f"the runs differ by about {differ:.1g} % in stiffness, damping or friction, which hides what the mass "
            f"change of {largest:g} kg does: fly the masses in turn, each more than once, or use a larger mass change; "
            "if you know that springs, damping and friction are alike, state a smaller `repeatability`; the ratios to "
            "the mass are given"
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


def _is_loose(estimate: Estimate, verdicts: Verdicts) -> bool:
    value, std = estimate.value, estimate.std
    return value is None or std is None or std > verdicts.loosely_known * value


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
