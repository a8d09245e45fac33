"""The classical chain for the start, the driven model for the answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from opid.errors import NotDeterminedError
from opid.identify.added_mass import AddedMass, absolute_parameters
from opid.identify.classical import Evidence
from opid.identify.driven_run import DrivenRun, driven_run
from opid.identify.joint_fit import JointFit, LadderStep, chosen
from opid.identify.model_fit import ModelFit, fit_model
from opid.identify.pursuit import pursue_law, refit
from opid.identify.study import Run, Study
from opid.mechanics.laws import Law
from opid.signals.health import without_spikes

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
    runs = [driven_run_of(study, run) for run in study.runs]
    fit = _first_fit(study, runs, evidence, ground)
    ladder: tuple[LadderStep, ...] = (LadderStep(fit.law.name, fit, True),)
    if search:
        ladder = pursue_law(runs, fit, progress=progress)
    best = chosen(ladder).fit
    added, reason = _absolute(best, [run.mass_change_kg for run in runs], evidence)
    return replace(evidence, joint=best, ladder=ladder, added_mass=added, not_determined=reason)


def driven_run_of(study: Study, run: Run) -> DrivenRun:
    """Return a run of a study as the model takes it, single spikes mended.

    Args:
        study: the study.
        run: one of its runs.
    """
    unsprung, sprung = (without_spikes(samples, fs=study.fs)[0] for samples in study.accelerations(run))
    leaks = [run.recording.channel(leak.channel) for leak in study.sensors.leaks]
    return driven_run(
        unsprung,
        sprung,
        fs=study.fs,
        mass_change_kg=run.mass_change_kg,
        sensors=study.sensors,
        leaks=np.stack(leaks, axis=1) if leaks else None,
    )


def _first_fit(study: Study, runs: Sequence[DrivenRun], evidence: Evidence, ground: bool) -> ModelFit:
    start = evidence.joint
    surfaces = [run.surface for run in evidence.runs]
    noise = tuple(
        facts.noise_m_per_s2 or evidence.noise_floor for facts in (study.sensors.unsprung, study.sensors.sprung)
    )
    return fit_model(
        runs,
        start.law,
        stiffness_per_mass=start["stiffness_per_mass"],
        damping_per_mass=start["damping_per_mass"],
        ground_stiffness_per_mass=(
            start["ground_stiffness_per_mass"] if ground and _demands_ground(evidence) else None
        ),
        inverse_mass=start["inverse_mass"] if "inverse_mass" in start.names else None,
        noise_m_per_s2=noise,
        motion_rms=(
            max(float(surface.travel.std()) for surface in surfaces),
            max(float(surface.velocity.std()) for surface in surfaces),
        ),
    )


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
