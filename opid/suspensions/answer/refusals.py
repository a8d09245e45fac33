"""What the runs do not determine, and why: no number at all, no mass, no inertia, or no interval of a term of a law.

A term of a law may not be distinguishable from stiffness or damping, and a stop may not be reached in any run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from opid.errors import InputError
from opid.estimate import Estimate, with_std
from opid.mechanics.laws.law import Law, Term
from opid.signals.recording import FloatArray
from opid.suspensions.candidates import Choice, FittedStructure
from opid.suspensions.fitting.fit import (
    Fit,
    fit_each_run,
    follows_readings,
    loading_changes,
    runs_contradict_each_other,
)
from opid.suspensions.fitting.noise import motion_over_noise, over_noise, sensor_ratio
from opid.suspensions.fitting.start import measure_contact
from opid.suspensions.model.driven_model import straight_equivalent
from opid.suspensions.model.law_parameters import describe_unreached_stop, distance_to_stop
from opid.suspensions.model.unknowns import GROUND
from opid.suspensions.result import BodyParameters, BodyRatios, GearParameters, GearRatios
from opid.suspensions.settings import Verdicts
from opid.suspensions.study import Study, rigid_faults


def why_refused(choice: Choice) -> str | None:
    """Return why there are no numbers at all; None if there are."""
    study, parts, ratio, verdicts = choice.study, choice.parts, choice.ratio, choice.verdicts
    if study.is_one_gear:
        return _explain_refused_gear(parts[0])
    if ratio <= verdicts.refused or choice.explains:
        return None
    return (
        f"no number is reported, because the structure does not explain the runs: it leaves {over_noise(ratio)} times "
        f"the sensors' noise{worst_sensor(study, parts)}; {_advise_instead(choice)}"
    )


def _explain_refused_gear(part: FittedStructure) -> str | None:
    fit, verdicts, ratio = part.fit, part.settings.verdicts, part.residual_over_noise
    is_hopeless = unexplained_fraction(part) > verdicts.refused_fraction and not follows_readings(fit)
    contact = describe_contact(part) if is_hopeless else ""
    if contact:
        return (
            f"{contact}; no law of a suspension describes such a friction, so no other number is given: record the "
            "motion without this contact"
        )
    frequencies = natural_frequencies(fit) if ratio > verdicts.doubtful else [0.0]
    differ = max(frequencies) > (1 + part.settings.intervals.same_frequency) * min(frequencies)
    if differ and runs_contradict_each_other(fit):
        return (
            "all runs are stated to have the same sprung mass, but they have different natural frequencies "
            f"({min(frequencies):.3f} to {max(frequencies):.3f} Hz), so not even ratios to the mass are determined: "
            "check mass_change_kg"
        )
    left = unexplained_fraction(part)
    if not is_hopeless:
        return None
    if not np.isfinite(left):
        unexplained = "has a free motion that grows without bound"
    elif left < 1.0:
        unexplained = (
            f"leaves {100 * left:.0f} % of the body's rms acceleration unexplained ({ratio:.0f} times the sensor noise)"
        )
    else:
        unexplained = "does not explain the body's acceleration"
    search = "let the law be searched, " * part.law_is_given
    return (
        f"the fitted model {unexplained}, so no number is reported: check the channels (swapped, upside down, in "
        f"another unit) and the mass changes, {search}or take another band; if the body also rolls and pitches on "
        "other gears, describe all of them in [[interfaces]]"
    )


def describe_contact(part: FittedStructure) -> str:
    """Return that a gear rubs on something that stands still, with what that tells; "" if it does not.

    Args:
        part: the gear.
    """
    model, verdicts = part.fit.model, part.settings.verdicts
    if not model.body.is_one_gear or model.runs[0].n_strut:
        return ""
    try:
        found = measure_contact(model.runs, model.body, part.settings.start)
    except InputError:
        return ""  # The runs are too short to be integrated.
    if not (min(found.friction_n_per_kg) > 0.0 < found.frequency_hz and found.explained > verdicts.contact_fraction):
        return ""
    frictions = ", ".join(f"{each:.2g}" for each in found.friction_n_per_kg)
    return (
        f"the body rubs on something that stands still: while it slides, {100 * found.sliding:.0f} % of the time, a "
        f"friction of {frictions} N per kg on its velocity against the ground explains {100 * found.explained:.0f} % "
        "of the power that the suspension leaves, beside a natural frequency of "
        f"{with_std(found.frequency_hz, found.frequency_std_hz)} Hz (one standard deviation)"
    )


def _advise_instead(choice: Choice) -> str:
    """Return what to do if a structure is refused."""
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
    """Return why the runs do not determine the mass of some part of the answer; None if they determine all."""
    study, parts = choice.study, choice.parts
    untold = [part for part in parts if not part.fit.model.mass_free]
    changes = ", ".join(f"{run.name!r} {run.mass_change_kg:+g} kg" for run in study.runs)
    wrong = [each for part in parts for each in part.wrong_forces]
    if wrong:
        listed = ", ".join(each.words for each in wrong)
        return (
            f"the forces in the struts contradict each other: with the mass that fits all of them best {listed}; check "
            "their units and calibrations, or state the tolerances that they have; the ratios to the mass are given"
        )
    if len(untold) == len(parts):
        return _explain_no_scale(study)
    if untold:
        return (
            f"the loading ({changes}) does not rest on {choice.names(untold)}: only ratios to the mass are determined "
            "there; change the loading there, too"
        )
    if any(negative_ground(part) for part in parts):
        return _explain_no_spring(choice)
    if any(is_loaded_by_gas(part) for part in parts):
        return (
            "loaded_friction takes the load of the seals in a run of another mass from the gas curve of quick motion, "
            "but a strut is loaded slowly: the friction of that run is wrong by some per cent, and the mass by more; "
            "no mass is reported, and the ratios to the mass have no intervals; do not state a `repeatability` of 0, "
            "so that friction may differ between runs"
        )
    if study.is_one_gear:
        return _explain_no_mass_of_gear(choice)
    loose = [part for part in parts if _is_loose(part.known.mass, choice.verdicts)]
    if not loose:
        return None
    if choice.explains and choice.lack > choice.verdicts.explained:
        return (
            f"unmeasured forces cause {100 * unexplained_fraction(parts[0]):.2g} % of the body's acceleration and hide "
            f"the effect of the change of loading ({changes}), so no mass is determined: change it more, or run longer"
        )
    if choice.ratio > choice.verdicts.doubtful:
        return (
            f"the structure leaves {over_noise(choice.ratio)} times the sensors' noise, and no mass fits the runs"
            f"{worst_sensor(study, parts)}: check positions, signs and masses of the loadings first"
        )
    negative = [part for part in parts if part.known.has_negative_mass]
    if negative:
        where = "" if len(parts) == 1 else f" on {choice.names(negative)}"
        return (
            f"the mass{where} would be negative: check the sign of the loading ({changes}), or whether two runs are "
            "exchanged"
        )
    return (
        f"the change of loading ({changes}) has too small an effect on the readings to give the mass"
        f"{'' if len(parts) == 1 else ' on ' + choice.names(loose)}: change it more, or at a place that moves more"
    )


def negative_ground(part: FittedStructure) -> tuple[float, float] | None:
    """Return a spring to the ground with clearly negative stiffness; None if there is none.

    Returns:
        The stiffness as a fraction of that of its suspension, and by how many standard deviations it is below zero.
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


def is_loaded_by_gas(part: FittedStructure) -> bool:
    """Return whether gas loads the friction of runs that are stated to be alike but carry different masses.

    After a slow loading the weight presses on the seals. `loaded_friction` uses the tangent of the gas curve of quick
    motion, by which the load changes n times as much, with the exponent n of the gas.
    """
    laws = part.fit.laws.values()
    is_loaded = any(
        any(term.kind.is_pressed for term in law.terms) and any(term.kind.quasi_static for term in law.terms)
        for law in laws
    )
    return is_loaded and not part.task.repeatability and loading_changes([run.loading for run in part.runs])


def is_biased(part: FittedStructure) -> bool:
    """Return whether the numbers of a fit are biased by more than their intervals, which are withheld then."""
    return bool(negative_ground(part) or part.implausible) or is_loaded_by_gas(part)


def _explain_no_spring(choice: Choice) -> str:
    """Return why a ground spring with negative stiffness prevents an answer: the model lacks some force."""
    found = {part: negative for part in choice.parts if (negative := negative_ground(part))}
    fraction, n_std = next(iter(found.values()))
    where = "" if len(choice.parts) == 1 else f" at {choice.names(list(found))}"
    return (
        f"the fitted spring to the ground{where} has {100 * fraction:.2g} % of the suspension's stiffness, but a "
        f"stiffness cannot be negative (it is {n_std:.0f} standard deviations below zero): an unmeasured force follows "
        "the motion or the road, a sensor has a gain or an AC coupling that the study does not state, or the law is "
        "outside the library; no mass is reported, and the ratios to the mass have no intervals"
    )


def _explain_no_scale(study: Study) -> str:
    if len(study.runs) == 1:
        key = "mass_change_kg" if study.is_one_gear else "loading"
        return (
            "one run gives ratios to the mass alone: record a second one with a known mass more or less, and give its "
            f"`{key}`, or the force in the strut in N"
        )
    if study.is_one_gear:
        return (
            "all runs have the same sprung mass (mass_change_kg), so only ratios to the mass are determined: add a run "
            "at another mass"
        )
    return (
        "all runs have the same loading: only ratios to the mass are determined; give `loading` to the runs that "
        "carried more or less"
    )


def _explain_no_mass_of_gear(choice: Choice) -> str | None:
    (part,), changes = choice.parts, [run.mass_change_kg for run in choice.study.runs]
    (mu, std), largest = part.known.inverse_mass, max(changes) - min(changes)
    is_loose = _is_loose(part.known.mass, choice.verdicts)
    if is_loose and not largest:
        tolerance = min((scale.tolerance for scale, _ in part.fit.model.scales), default=0.0)
        if tolerance > part.settings.weighing.rules_above * std / max(mu, 1e-300):
            return (
                "the gain of the force in the strut is not known well enough for a mass: calibrate it, or add a run "
                "with a known mass more or less; the ratios to the mass are given"
            )
        return (
            "one over the sprung mass is not told clearly from zero, whatever is known of scales and springs: record "
            "longer runs, or add one with a known mass more or less; the ratios to the mass are given"
        )
    if part.known.has_negative_mass and is_loose:
        return (
            f"the runs respond as if the sign of the mass change ({largest:g} kg) were opposite: check mass_change_kg "
            "(negative where mass was removed) and the order of the logs; the ratios to the mass are given"
        )
    if part.error is not None and part.error.limit == "model":
        law = "the given law is wrong (let it be searched)"
        return (
            f"no mass is reported, because an error of the model biases the parameters: it leaves "
            f"{100 * unexplained_fraction(part):.2g} % of the body's acceleration, {over_noise(choice.ratio)} times "
            "the sensors' noise; the ratios to the mass are equivalents over the motion of these runs. Check whether: "
            f"(1) {law if part.law_is_given else 'the law is outside the library'}; (2) the body also rolls and "
            "pitches on other gears (then describe all of them in [[interfaces]]); (3) a mass change put the strut on "
            "a stop that the law lacks; (4) channels or mass changes are not as stated"
        )
    if is_loose and choice.ratio > choice.verdicts.doubtful:
        return (
            f"the fitted model leaves {over_noise(choice.ratio)} times the sensors' noise, and no mass fits the runs: "
            "the body may also roll and pitch on other gears (then describe all of them in [[interfaces]]), or the "
            "channels, the law or the mass changes are not as stated"
        )
    if is_loose and part.repeatability.rules_mass:
        differ = 100 * (part.repeatability.estimated or 0.0)
        remedy = "if you know that springs, damping and friction are alike, state a smaller `repeatability`; "
        return (
            f"the runs differ by about {differ:.1g} % in stiffness, damping or friction, which hides the effect of the "
            f"mass change of {largest:g} kg: fly the masses in turn, each more than once, or use a larger mass change; "
            f"{remedy * (part.repeatability.stated > 0)}the ratios to the mass are given"
        )
    if is_loose:
        upper = mu + 1.96 * std
        bound = f"it is above {1 / upper:.0f} kg" if upper > 0 else "the effect even has the opposite sign"
        return (
            f"the mass change of {largest:g} kg does not show in the runs, so the sprung mass is not determined "
            f"({bound}, 95 %): use a larger mass change or longer runs; the ratios to the mass are given"
        )
    if 1 + mu * min(changes) < part.settings.intervals.least_remainder:
        return (
            f"the fit gives a sprung mass of {1 / mu:.0f} kg, but a run is stated to be {-min(changes):g} kg lighter, "
            "which would leave almost no mass: check mass_change_kg (kg, of the mass on this gear)"
        )
    return None


def loose_motions(
    choice: Choice, parameters: GearParameters | BodyParameters, ratios: GearRatios | BodyRatios
) -> list[str]:
    """Return "roll", "pitch" or both: motions of a rigid body whose inertia the runs hardly determine.

    A motion that consists of noise gives a wrong inertia with a narrow interval.
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
        # The relative deviation is that of the square, as for the inertia.
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


def unexplained_fraction(part: FittedStructure) -> float:
    """Return the fraction of the body's rms acceleration that the free motion leaves, over all runs."""
    return float(np.sqrt(np.mean(np.square(part.unexplained))))


def natural_frequencies(fit: Fit) -> list[float]:
    """Return the natural frequency of one gear in each run, fitted to that run alone, Hz, law included."""
    found, mu = [], fit.model.inverse_mass(fit.theta)
    for one in fit_each_run(fit):
        square = straight_equivalent(one.model, 0, one.errors.predictions[0])(one.theta)[0]
        square += one.value(fit.model.groups[0].name_of(GROUND)) / (1 + mu * float(one.model.runs[0].loading[0, 0]))
        found.append(float(np.sqrt(max(square, 0.0))) / (2 * np.pi))
    return found or [0.0]


def worst_sensor(study: Study, parts: Sequence[FittedStructure]) -> str:
    """Return the sensor with the largest residual, as the end of a sentence; "" if there is only one sensor."""
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
    """A term of a law that cannot be distinguished from stiffness or damping: the intervals of both are withheld.

    Args:
        group: name of the group of interfaces; empty for one gear.
        kind: kind of the term.
        partner: the parameter that it is confounded with; None for a stop that was not reached, which has no values.
        reason: the reason, the middle of a sentence that begins with the kind; without a partner also its end.
        remedy: what to do, the end of that sentence; empty if nothing helps.
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

        The energy that a friction takes in a cycle is determined although the friction cannot be distinguished from a
        stiffness, and the energy that it takes together with a damper although it cannot be distinguished from that.
        """
        return {None: (), "stiffness": ("stiffness",), "damping": ("loop",)}[self.partner]

    def without_interval(self, laws: Mapping[str, Mapping[str, Estimate]]) -> dict[str, Mapping[str, Estimate]]:
        """Return the estimates of laws, those of the term without intervals; an unreached stop has no values."""
        mine = laws.get(self.kind, {})
        if self.partner is None:
            return {**laws, self.kind: dict.fromkeys(mine, Estimate())}
        return {**laws, self.kind: {name: estimate.without_interval() for name, estimate in mine.items()}}

    @property
    def warning(self) -> str:
        """The warning, one sentence."""
        if self.partner is None:
            return f"{self.kind}{f' at {self.group!r}' * bool(self.group)} {self.reason}"
        where, remedy = f" at {self.group!r}" * bool(self.group), f"; {self.remedy}" * bool(self.remedy)
        return f"{self.kind}{where} {self.reason}: the intervals of both are withheld{remedy}"


def straight_term(group: str, kind: str, unit: str, scale: float, motion_rms: float) -> ConfoundedTerm:
    """Return a term that is nearly straight over the motion.

    Args:
        group: name of the group of interfaces.
        kind: kind of the term.
        unit: unit of its scale: "m/s" for a law of the velocity, else "m".
        scale: its inner scale.
        motion_rms: rms of the motion, in the same unit.
    """
    partner: Literal["stiffness", "damping"] = "damping" if unit == "m/s" else "stiffness"
    reason = (
        f"is nearly straight over the visited range (scale {scale:.3g} {unit}, motion {motion_rms:.3g} {unit} rms), so "
        f"that only amplitude over scale is determined and it cannot be distinguished from {partner}"
    )
    return ConfoundedTerm(group, kind, partner, reason)


def find_confounded_terms(part: FittedStructure) -> list[ConfoundedTerm]:
    """Return the terms of a fit that cannot be distinguished from stiffness or damping."""
    found: list[ConfoundedTerm] = []
    for number, law in enumerate(part.fit.laws.values()):
        index = part.fit.model.law_indices(number).start
        for term in law.terms:
            found += _find_partners(part, number, term, part.known.std(index))
            index += len(term.values)
    return found


def _find_partners(part: FittedStructure, number: int, term: Term, std: float) -> Iterator[ConfoundedTerm]:
    """Yield what a term is confounded with, and why; `std` is that of its amplitude."""
    group, settings = part.fit.groups[number], part.settings.warnings
    is_loose = std > part.settings.verdicts.loosely_known * abs(term.amplitude)
    if term.kind.is_stop:
        travels = _list_travels(part.fit, number)
        if is_loose or not any(Law((term,)).force(travel, 0.0).any() for travel in travels):
            distance_m = max(distance_to_stop(term, travel) for travel in travels)
            yield ConfoundedTerm(group.name, term.name, None, describe_unreached_stop(distance_m))
        return
    if term.kind.memory is not None and part.residual_over_noise > settings.memory_left:
        reason = (
            f"leaves {part.residual_over_noise:.2g} times the noise, so the force with memory is only partly this one, "
            "and the difference may appear as damping"
        )
        yield ConfoundedTerm(group.name, term.name, "damping", reason)
        return
    if term.kind.slides:
        range_m, scale_m = max(float(np.ptp(travel)) for travel in _list_travels(part.fit, number)), term.values[1]
        if range_m < settings.least_way_to_slide * scale_m:
            reason = (
                f"slides after {1e3 * scale_m:.3g} mm, but the motion covers only {1e3 * range_m:.3g} mm from end to "
                f"end: it takes {settings.least_way_to_slide:g} times that travel to distinguish it from stiffness"
            )
            yield ConfoundedTerm(group.name, term.name, "stiffness", reason, "record a larger motion")
            return
    travel, velocity = (np.concatenate(each) for each in zip(*map(part.fit.motion, group.members), strict=True))
    for parameter, scale in zip(term.kind.parameters, term.values, strict=True):
        # A kind with long scales bends even within them.
        if parameter.role != "scale" or parameter.over_rms[1] > settings.usual_reach_rms:
            continue
        rms = float((velocity if parameter.unit == "m/s" else travel).std())
        if scale > settings.straight_rms * rms and is_loose:
            yield straight_term(group.name, term.name, parameter.unit, scale, rms)
        sharpness = _compute_turnover_over_rate(part, group.members, term, parameter.unit, scale, velocity)
        if sharpness > settings.turnover_between_samples:
            reason = (
                f"turns over faster than the runs were sampled ({sharpness:.2g} times their rate), so its force "
                "between two samples is not known and may appear as damping"
            )
            yield ConfoundedTerm(group.name, term.name, "damping", reason, "record at a higher rate")


def _list_travels(fit: Fit, number: int) -> list[FloatArray]:
    """Return the travel of each interface of a group in each run, m, measured from the origin of its law."""
    members, found = fit.model.groups[number].members, []
    for index, prediction in enumerate(fit.errors.predictions):
        interfaces = fit.model.resting_interfaces(fit.theta, index)
        found += [prediction.travel[:, member] + interfaces[member].law.rest_m for member in members]
    return found


def _compute_turnover_over_rate(
    part: FittedStructure, members: Sequence[int], term: Term, unit: str, scale: float, velocity: FloatArray
) -> float:
    """Return the rate at which a friction stops a motion, over the sampling rate."""
    model = part.fit.model
    run, accelerance = model.runs[0], model.mobility(part.fit.theta, 0).accelerance
    if term.kind.memory is not None:
        # This friction turns over within the travel from one sample to the next.
        turns = float(velocity.std()) / scale if unit == "m" else 0.0
    else:
        steepest = abs(term.amplitude * float(term.evaluate(np.array(0.0), np.array(0.0))[2]))
        turns = steepest * max(accelerance[k, k] for k in members) * (unit == "m/s")
    return turns * run.finer / run.recorded_fs
