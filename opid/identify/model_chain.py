"""The classical chain for the start, the driven model for the answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from opid.errors import NotDeterminedError
from opid.identify.added_mass import AddedMass, absolute_parameters
from opid.identify.classical import Evidence
from opid.identify.joint_fit import JointFit, LadderStep, chosen
from opid.identify.model_fit import driven_run, fit_model
from opid.identify.pursuit import pursue_law
from opid.identify.study import Study

# a ground spring is let in above this share of K2 and this many standard deviations: less is a sensor's doing
GROUND_SHARE, GROUND_STD = 0.03, 5.0


def model_chain(
    study: Study,
    evidence: Evidence,
    *,
    search: bool = True,
    ground: bool = True,
    progress: Callable[[str], None] | None = None,
) -> Evidence:
    """Refit what the classical chain found by the model that the measured spindle drives.

    Args:
        study: the runs.
        evidence: of `classical_chain` on the same study; its joint fit is the start.
        search: whether other laws may be tried (else the law of `evidence` is kept).
        ground: whether a ground spring may be let in, which happens only if the classical chain demands one.
        progress: called with the name of each step as it begins.

    Returns:
        The evidence with joint fit, ladder and absolute parameters of the model.
    """
    say = progress or (lambda step: None)
    say("model")
    start = evidence.joint
    runs = [driven_run(*study.accelerations(run), fs=study.fs, mass_change_kg=run.mass_change_kg) for run in study.runs]
    surfaces = [run.surface for run in evidence.runs]
    fit = fit_model(
        runs,
        start.law,
        stiffness_per_mass=start["stiffness_per_mass"],
        damping_per_mass=start["damping_per_mass"],
        ground=ground and _demands_ground(evidence),
        ground_stiffness_per_mass=start["ground_stiffness_per_mass"],
        inverse_mass=start["inverse_mass"] if "inverse_mass" in start.names else None,
        motion_rms=(
            max(float(surface.travel.std()) for surface in surfaces),
            max(float(surface.velocity.std()) for surface in surfaces),
        ),
    )
    ladder: tuple[LadderStep, ...] = (LadderStep(fit.law.name, fit, True),)
    if search:
        ladder = pursue_law(runs, fit, progress=progress)
    best = chosen(ladder).fit
    added, reason = _absolute(best, [run.mass_change_kg for run in runs], evidence)
    return replace(evidence, joint=best, ladder=ladder, added_mass=added, not_determined=reason)


def _demands_ground(evidence: Evidence) -> bool:
    fit = evidence.joint
    name = "ground_stiffness_per_mass"
    if name not in fit.names:
        return False
    value, std = fit[name], float(fit.std[fit.names.index(name)])
    return abs(value) > GROUND_STD * std and abs(value) > GROUND_SHARE * abs(fit["stiffness_per_mass"])


def _absolute(fit: JointFit, mass_changes_kg: list[float], evidence: Evidence) -> tuple[AddedMass | None, str | None]:
    if "inverse_mass" not in fit.names:
        return None, evidence.not_determined
    try:
        return absolute_parameters(fit, mass_changes_kg), None
    except NotDeterminedError as error:
        return None, str(error)
