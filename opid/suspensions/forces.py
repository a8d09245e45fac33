"""Sensors of the force in a strut: what they read, and which of those that give the mass are contradicted."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

from opid.estimate import Estimate
from opid.suspensions.candidates import FittedStructure, WrongForce, is_mass_free
from opid.suspensions.fitting.fit import NO_FIT, Fit, carry_over, fit_model
from opid.suspensions.fitting.repeatability import with_departures, with_own_repeatability
from opid.suspensions.model.body import Scale
from opid.suspensions.sensor_facts import ForceSensor
from opid.suspensions.study import Study


def with_believed_forces(part: FittedStructure) -> FittedStructure:
    """Return a structure without the stated gains of the forces that the changes of mass, or the others, contradict.

    If no force is left, the mass follows from the changes of mass alone, and the gains from it; without such changes
    ratios to the mass are left.

    Args:
        part: a fitted structure.
    """
    if not part.has_fit or not part.fit.model.scales:
        return part
    fit, found, body = part.fit, part.found, replace(part.fit.model.body, scales=())
    assert found is not None  # it has a fit
    try:
        if not is_mass_free(fit.model.runs, body):
            wrong = tuple(find_wrong_forces(fit))
            return replace(part, found=replace(found, fit=_fit_with(part, ())), wrong_forces=wrong) if wrong else part
        alone = replace(part, found=replace(found, fit=_fit_with(part, ())))
        believed = tuple(scale for scale, gain in fit.model.scales if _agrees(alone, scale, gain))
        if not believed:
            return alone
        with_them = fit if len(believed) == len(fit.model.scales) else _fit_with(part, believed)
        return alone if any(find_wrong_forces(with_them)) else replace(part, found=replace(found, fit=with_them))
    except NO_FIT:
        return part


def find_wrong_forces(fit: Fit) -> Iterator[WrongForce]:
    """Yield the forces in N that contradict each other, or the changes of mass, in a fit with all of them.

    Args:
        fit: the fit.
    """
    model, theta, most = fit.model, fit.theta, fit.model.settings.weighing.used_within_std
    mu = model.inverse_mass(theta)
    for scale, _ in model.scales:
        facts = model.sensors.sprung[scale.channel]
        reads = [mu * scale.kg * float(model.gains(theta, run.number)[1][scale.channel]) for run in model.runs]
        furthest = max(reads, key=lambda each: abs(each - 1.0))
        tolerance = math.hypot(scale.tolerance, facts.gain_repeatability)
        if abs(furthest - 1.0) > most * tolerance:
            yield WrongForce(model.sensors.names[scale.channel], furthest, tolerance)


def _fit_with(part: FittedStructure, scales: tuple[Scale, ...]) -> Fit:
    """Fit a structure once more with the stated gains of some forces alone."""
    fit, body = part.fit, replace(part.fit.model.body, scales=scales)
    model = replace(fit.model, body=body, gains_differ=1.0, mass_free=is_mass_free(fit.model.runs, body))
    theta = carry_over(fit, model)
    theta[list(model.stds_of_run_gains)] = 1.0
    if not model.repeatability:
        return fit_model(model, theta)
    # How much the runs differ was estimated with the forces that may be wrong.
    return with_own_repeatability(with_departures(replace(fit, model=model, theta=theta), part.task.repeatability))


def _agrees(alone: FittedStructure, scale: Scale, gain: int) -> bool:
    """Whether a force agrees with the mass of a fit without any; its gain has an index in the vector."""
    theta, settings = alone.fit.theta, alone.settings.weighing
    mu, mass_kg = alone.fit.model.inverse_mass(theta), scale.kg * float(theta[gain])
    ratio = alone.known.estimate(mu * mass_kg, {"inverse_mass": mass_kg, gain: mu * scale.kg})
    return abs(mu * mass_kg - 1.0) <= settings.used_within_std * math.hypot(ratio.std or 0.0, scale.tolerance)


def estimate_gains(part: FittedStructure) -> dict[str, Estimate]:
    """Return what each sensor of a force reads for 1 N, by its channel; nothing without a mass.

    Args:
        part: a fitted structure.
    """
    found, model, study = dict[str, Estimate](), part.fit.model, part.task.study
    assert study is not None  # a user's own structure has no sensors of forces
    for scale, (_, sensor) in zip(study.strut_scales, study.strut_sensors, strict=True):
        name = f"gain_sprung[{sensor.channel}]"
        if isinstance(sensor, ForceSensor) and name in model.names and model.mass_free:
            mu, gain = model.inverse_mass(part.fit.theta), part.fit.value(name)
            by: dict[str | int, float] = {"inverse_mass": gain / scale, name: mu / scale}
            found[sensor.channel] = part.known.estimate(mu * gain / scale, by)
    return found


def warn_of_unused_forces(study: Study, part: FittedStructure, gains: Mapping[str, Estimate]) -> Iterator[str]:
    """Yield the forces, whose gains are stated, that the changes of mass contradict.

    Args:
        study: the study.
        part: the fitted structure.
        gains: what its sensors read for 1 N.
    """
    model = part.fit.model
    used = {model.sensors.names[scale.channel] for scale, _ in model.scales}
    for sensor in study.forces:
        gain = gains.get(sensor.channel)
        is_used = sensor.gain_tolerance is None or sensor.channel in used
        if is_used or gain is None or gain.value is None or gain.std is None:
            continue
        yield (
            f"the force (channel {sensor.channel!r}) contradicts the changes of mass, and is not used for the mass: "
            f"with the mass that follows from these it reads {gain.value:.3g} N for each N, with standard deviation "
            f"{gain.std:.2g}, and its gain is stated to be right to {100 * (sensor.gain_tolerance or 0.0):.2g} %: "
            "check its unit, its calibration and the changes of mass"
        )
