"""What the runs do not tell, and why: no number at all, no mass, no inertia, or no interval of a term of a law.

A term may be stiffness or damping by another name, and a stop may be one that no run reaches.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from opid.estimate import Estimate
from opid.mechanics.laws.law import Law, Term
from opid.signals.recording import FloatArray
from opid.suspensions.candidates import Choice, Fitted
from opid.suspensions.fitting.fit import Fit, fits_of_each_run, loading_changes, runs_contradict_each_other
from opid.suspensions.fitting.noise import motion_over_noise, over_noise, sensor_ratio
from opid.suspensions.model.driven_model import straight_equivalent
from opid.suspensions.model.law_parameters import not_reached, way_to_stop
from opid.suspensions.model.unknowns import GROUND
from opid.suspensions.result import BodyParameters, BodyRatios, GearParameters, GearRatios
from opid.suspensions.settings import Verdicts
from opid.suspensions.study import Study, rigid_faults


def why_refused(choice: Choice) -> str | None:
    """Return why there are no numbers at all; None if there are."""
    study, parts, ratio, verdicts = choice.study, choice.parts, choice.ratio, choice.verdicts
    if study.is_one_gear:
        return _why_gear_refused(study, parts[0])
    if ratio <= verdicts.refused or choice.explains:
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
    if any(negative_ground(part) for part in parts):
        return _why_no_spring(choice)
    if any(is_loaded_by_gas(part) for part in parts):
        return (
            "loaded_friction takes the load of the seals in a run of another mass from the quick curve of the gas, and "
            "a strut is loaded slowly: the friction of that run is some per cent off, and the mass by more; no mass "
            "can be told, and the ratios to the mass stand without intervals; state no `repeatability` of 0, so that "
            "friction may differ"
        )
    if study.is_one_gear:
        return _why_no_mass_of_gear(choice)
    loose = [part for part in parts if _is_loose(part.known.mass, choice.verdicts)]
    if not loose:
        return None
    if choice.explains and choice.lack > choice.verdicts.explained:
        return (
            f"forces that nobody measured make {100 * unexplained_fraction(parts[0]):.2g} % of the body's acceleration "
            f"and hide what the change of loading ({changes}) does, and no mass is told: change it more, or run longer"
        )
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


def negative_ground(part: Fitted) -> tuple[float, float] | None:
    """Return the spring to the ground that is surely below zero; None where there is none.

    Returns:
        It as a fraction of the stiffness of its suspension, and how many of its standard deviations it is below zero.
    """
    known, model = part.settings.intervals, part.fit.model
    for number, group in enumerate(model.groups):
        spring, stiffness = (
            part.known.ground(number, None, per_mass=True),
            part.known.suspension(number, per_mass=True)[0],
        )
        if not group.ground or spring.value is None or not spring.std or not stiffness.value:
            continue
        fraction, n_std = spring.value / abs(stiffness.value), -spring.value / spring.std
        if n_std > known.impossible_ground_std and -fraction > known.negligible_ground:
            return fraction, n_std
    return None


def is_loaded_by_gas(part: Fitted) -> bool:
    """Return whether friction of runs said to be alike is loaded by gas, and those runs carry different masses.

    What presses on the seals after a slow loading is the weight. `loaded_friction` knows no more than the tangent of
    the quick curve: n times as much change of the load, with the exponent n of the gas.
    """
    laws = part.fit.laws.values()
    is_loaded = any(
        any(term.kind.is_pressed for term in law.terms) and any(term.kind.quasi_static for term in law.terms)
        for law in laws
    )
    return is_loaded and not part.task.repeatability and loading_changes([run.loading for run in part.runs])


def is_bent(part: Fitted) -> bool:
    """Return whether the numbers of a fit are bent by more than any interval holds: none is told."""
    return bool(negative_ground(part) or part.implausible) or is_loaded_by_gas(part)


def _why_no_spring(choice: Choice) -> str:
    """A spring that pushes the body on is a force that the model does not have."""
    found = {part: negative for part in choice.parts if (negative := negative_ground(part))}
    fraction, n_std = next(iter(found.values()))
    where = "" if len(choice.parts) == 1 else f" at {choice.names(list(found))}"
    return (
        f"the runs ask for a spring to the ground{where} of {100 * fraction:.2g} % of the suspension's stiffness, and "
        f"no spring is below zero ({n_std:.0f} standard deviations): a force that goes with the motion or the road "
        "acts on the body, a sensor has a gain or an AC coupling that the study does not state, or the law is outside "
        "the library; no mass can be told, and the ratios to the mass stand without intervals"
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
            "[[interfaces]]), a mass change may have put the strut on a stop that the law lacks, or the channels or "
            "the mass changes are not as stated; the ratios to the mass are given, as equivalents over the motion of "
            "these runs"
        )
    if is_loose and choice.ratio > choice.verdicts.doubtful:
        return (
            f"the fitted model leaves {over_noise(choice.ratio)} times the sensors' noise, and no mass fits the runs: "
            "this gear may not be alone on its body, which rolls and pitches on others (then describe all of them in "
            "[[interfaces]]), or the channels, the law or the mass changes are not as stated"
        )
    if is_loose and part.repeatability.rules_mass:
        differ = 100 * (part.repeatability.estimated or 0.0)
        remedy = "if you know that springs, damping and friction are alike, state a smaller `repeatability`; "
        return (
            f"the runs differ by about {differ:.1g} % in stiffness, damping or friction, which hides what the mass "
            f"change of {largest:g} kg does: fly the masses in turn, each more than once, or use a larger mass change; "
            f"{remedy * (part.repeatability.stated > 0)}the ratios to the mass are given"
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
    if choice.kind != "rigid_body" or (choice.ratio > verdicts.doubtful and not choice.explains):
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
    """Return the natural frequency of one gear in each run, fitted to that run alone, Hz, law included."""
    found, mu = [], fit.model.inverse_mass(fit.theta)
    for one in fits_of_each_run(fit):
        square = straight_equivalent(one.model, 0, one.errors.predictions[0])(one.theta)[0]
        square += one.value(fit.model.groups[0].called(GROUND)) / (1 + mu * float(one.model.runs[0].loading[0, 0]))
        found.append(float(np.sqrt(max(square, 0.0))) / (2 * np.pi))
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


@dataclass(frozen=True)
class ConfoundedTerm:
    """A term of a law whose force may be stiffness or damping by another name: the intervals of both are withheld.

    Args:
        group: name of the group of interfaces; empty for one gear.
        kind: of the term.
        partner: what it is confounded with; None for a stop that was not reached, which has no values.
        reason: why, the middle of a sentence that begins with the kind; all of its rest without a partner.
        remedy: what to do, the end of that sentence; empty where nothing helps.
    """

    group: str
    kind: str
    partner: Literal["stiffness", "damping"] | None
    reason: str
    remedy: str = ""

    @property
    def confounded_with(self) -> tuple[str, ...]:
        """Names of the estimates of a gear, and of an interface, that have no interval beside the term."""
        if self.partner is None:
            return ()
        if self.partner == "damping":
            return "suspension_damping_n_s_per_m", "damping_per_mass", "damping_ratio", "damping"
        return (
            "suspension_stiffness_n_per_m",
            "stiffness_per_mass",
            "natural_frequency_hz",
            "damping_ratio",
            "stiffness",
        )

    @property
    def confounded_at_rest(self) -> tuple[str, ...]:
        """Names of the estimates of a run that have no interval beside the term.

        The energy that a friction takes in a cycle is known beside a stiffness, however far the two trade with each
        other, and what it takes together with a damper is known beside that.
        """
        return {None: (), "stiffness": ("stiffness",), "damping": ("loop",)}[self.partner]

    def without_interval(self, laws: Mapping[str, Mapping[str, Estimate]]) -> dict[str, Mapping[str, Estimate]]:
        """Return the estimates of laws, the term's without intervals, a stop's that was not reached without values."""
        mine = laws.get(self.kind, {})
        if self.partner is None:
            return {**laws, self.kind: dict.fromkeys(mine, Estimate())}
        return {**laws, self.kind: {name: estimate.without_interval() for name, estimate in mine.items()}}

    @property
    def warning(self) -> str:
        """What to doubt, one sentence."""
        if self.partner is None:
            return f"{self.kind}{f' at {self.group!r}' * bool(self.group)} {self.reason}"
        where, remedy = f" at {self.group!r}" * bool(self.group), f"; {self.remedy}" * bool(self.remedy)
        return f"{self.kind}{where} {self.reason}: the intervals of both are withheld{remedy}"


def straight_term(group: str, kind: str, unit: str, scale: float, motion_rms: float) -> ConfoundedTerm:
    """Return a term that the motion did not bend.

    Args:
        group: of interfaces.
        kind: of the term.
        unit: of its scale: "m/s" for a law of the velocity, else "m".
        scale: its inner scale.
        motion_rms: rms of the motion, in the same unit.
    """
    partner: Literal["stiffness", "damping"] = "damping" if unit == "m/s" else "stiffness"
    reason = (
        f"is nearly straight over the visited range (scale {scale:.3g} {unit}, motion {motion_rms:.3g} {unit} rms), so "
        f"that only amplitude over scale is determined and it cannot be told from {partner}"
    )
    return ConfoundedTerm(group, kind, partner, reason)


def find_confounded_terms(part: Fitted) -> list[ConfoundedTerm]:
    """Return the terms of a fit that may be stiffness or damping by another name."""
    found: list[ConfoundedTerm] = []
    for number, law in enumerate(part.fit.laws.values()):
        index = part.fit.model.law_indices(number).start
        for term in law.terms:
            found += _confounded(part, number, term, part.known.std(index))
            index += len(term.values)
    return found


def _confounded(part: Fitted, number: int, term: Term, std: float) -> Iterator[ConfoundedTerm]:
    """What a term is confounded with, and why; `std` is that of its amplitude."""
    group, settings = part.fit.groups[number], part.settings.warnings
    is_loose = std > part.settings.verdicts.loosely_known * abs(term.amplitude)
    if term.kind.is_stop:
        travels = _travels(part.fit, number)
        if is_loose or not any(Law((term,)).force(travel, 0.0).any() for travel in travels):
            way_m = max(way_to_stop(term, travel) for travel in travels)
            yield ConfoundedTerm(group.name, term.name, None, not_reached(way_m))
        return
    if term.kind.memory is not None and part.residual_over_noise > settings.memory_left:
        reason = (
            f"leaves {part.residual_over_noise:.2g} times the noise, so the force that remembers is another one in "
            "part, which may show as damping"
        )
        yield ConfoundedTerm(group.name, term.name, "damping", reason)
        return
    if term.kind.slides:
        way_m, scale_m = max(float(np.ptp(travel)) for travel in _travels(part.fit, number)), term.values[1]
        if way_m < settings.least_way_to_slide * scale_m:
            reason = (
                f"slides after {1e3 * scale_m:.3g} mm, and the motion went over {1e3 * way_m:.3g} mm from end to end, "
                f"where {settings.least_way_to_slide:g} times that travel would tell it from stiffness"
            )
            yield ConfoundedTerm(group.name, term.name, "stiffness", reason, "record a larger motion")
            return
    travel, velocity = (np.concatenate(each) for each in zip(*map(part.fit.motion, group.members), strict=True))
    for parameter, scale in zip(term.kind.parameters, term.values, strict=True):
        # a kind whose scale may be long by nature bends within it all the same
        if parameter.role != "scale" or parameter.over_rms[1] > settings.usual_reach_rms:
            continue
        rms = float((velocity if parameter.unit == "m/s" else travel).std())
        if scale > settings.straight_rms * rms and is_loose:
            yield straight_term(group.name, term.name, parameter.unit, scale, rms)
        sharpness = _turnover_over_rate(part, group.members, term, parameter.unit, scale, velocity)
        if sharpness > settings.turnover_between_samples:
            reason = (
                f"turns over faster than the runs were sampled ({sharpness:.2g} times their rate), so its force "
                "between two samples is not known and may show as damping"
            )
            yield ConfoundedTerm(group.name, term.name, "damping", reason, "record at a higher rate")


def _travels(fit: Fit, number: int) -> list[FloatArray]:
    """Travel of a group from the origin of its law, m, of each interface in each run, wherever the run rests on it."""
    members, found = fit.model.groups[number].members, []
    for index, prediction in enumerate(fit.errors.predictions):
        interfaces = fit.model.resting_interfaces(fit.theta, index)
        found += [prediction.travel[:, member] + interfaces[member].law.rest_m for member in members]
    return found


def _turnover_over_rate(
    part: Fitted, members: Sequence[int], term: Term, unit: str, scale: float, velocity: FloatArray
) -> float:
    """The rate at which a friction stops a motion, over that of the record."""
    model = part.fit.model
    run, accelerance = model.runs[0], model.mobility(part.fit.theta, 0).accelerance
    if term.kind.memory is not None:
        # friction that has turned over within the travel from one sample to the next
        turns = float(velocity.std()) / scale if unit == "m" else 0.0
    else:
        steepest = abs(term.amplitude * float(term.evaluate(np.array(0.0), np.array(0.0))[2]))
        turns = steepest * max(accelerance[k, k] for k in members) * (unit == "m/s")
    return turns * run.finer / run.recorded_fs
