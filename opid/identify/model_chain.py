"""The classical chain for the start, the driven model for the answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from opid.identify.classical import Evidence, Start, evidence_of
from opid.identify.demands import at_last, let_in
from opid.identify.driven_run import BAND_HZ, DrivenRun, driven_run
from opid.identify.force_surface import force_surface
from opid.identify.imitations import ground_imitations
from opid.identify.joint_fit import JointFit, LadderStep, chosen
from opid.identify.limits import limits
from opid.identify.model_evidence import ModelEvidence
from opid.identify.model_fit import ModelFit, fit_model
from opid.identify.noise_levels import with_own_noise
from opid.identify.pursuit import judged_by_left_out, with_neighbours
from opid.identify.sparse_road import which_law
from opid.identify.study import Run, Study
from opid.identify.whiteness import bootstrap_std, coloured_std, whiteness
from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.laws import Law
from opid.signals.health import without_spikes
from opid.signals.recording import FloatArray

# a fit starts with a ground spring where the classical chain finds one above this share of K2 and this many standard
# deviations
GROUND_SHARE, GROUND_STD = 0.03, 5.0
# a first fit that leaves more than this over the noise of the sensors is tried from other starts
DOUBTFUL = 1.5
# the noise levels of the two sensors are told apart only where the model explains the runs this well
EXPLAINED = 2.0


def model_chain(
    start: Start,
    *,
    search: bool = True,
    ground: bool = True,
    band_hz: tuple[float, float] = BAND_HZ,
    roads: Sequence[str] | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Evidence:
    """Fit the model that the measured spindle drives, from what the classical equation found.

    Args:
        start: of `classical_start`; its joint fit is where the model begins.
        search: whether other laws may be tried (else the law of `start` is kept).
        ground: whether a ground spring may be let in, which happens only if the runs demand one.
        band_hz: lines of the prediction errors that count, Hz.
        roads: how a law is searched, see `opid.identify.sparse_road.which_law`.
        seed: of the resampling that checks the intervals.
        progress: called with the name of each step as it begins.

    Returns:
        The evidence with joint fit, ladder and absolute parameters of the model; the paper's steps take its law.
    """
    say = progress or (lambda step: None)
    study = start.study
    say("model")
    prepared = [driven_run_of(study, run, band_hz=band_hz) for run in study.runs]
    runs = tuple(run for run, _ in prepared)
    ground_start = start.joint if ground and "ground_stiffness_per_mass" in start.joint.names else None
    first, n_starts = _first_fit(start, runs, ground)
    runs, fit, demands = let_in(runs, first, ground_start=ground_start, progress=progress)
    ladder: tuple[LadderStep, ...] = (LadderStep(fit.law.name, fit, True, road="given"),)
    if search:
        ladder = which_law(runs, fit, roads=roads, progress=progress)
        runs, fit, more = let_in(runs, _model_fit(ladder), ground_start=ground_start, progress=progress)
        if more:
            # what was wrong with the sensors may have been taken for a term of the law
            ladder = (*ladder, *which_law(runs, fit, roads=roads, progress=progress))
        elif fit is not chosen(ladder).fit:
            ladder = (*ladder, LadderStep(fit.law.name, fit, True))
        demands = (*demands, *more)
    ladder = with_neighbours(runs, ladder) if search else judged_by_left_out(runs, ladder)
    best = _model_fit(ladder)
    if best.noise_m_per_s2 < EXPLAINED * best.level:
        best = with_own_noise(runs, best, study.sensors)
    if best is not chosen(ladder).fit:
        ladder = (*ladder, LadderStep(best.law.name, best, True))
    changes = [run.mass_change_kg for run in runs]
    say("intervals")
    model = ModelEvidence(
        fit=best,
        surface=force_surface(runs, best),
        whiteness=whiteness(best),
        coloured_std=coloured_std(best),
        bootstrap_std=bootstrap_std(runs, best, rng=np.random.default_rng(seed)),
        demands=tuple(at_last(demand, best) for demand in demands if demand.name in best.names),
        ground=ground_imitations(runs, best),
        mended_spikes=(sum(n[0] for _, n in prepared), sum(n[1] for _, n in prepared)),
        n_starts=n_starts,
        limits=tuple(limits(best, changes, sum(run.n_samples / run.fs for run in runs))),
    )
    return replace(evidence_of(start, best, ladder, progress=progress), model=model)


def _model_fit(ladder: tuple[LadderStep, ...]) -> ModelFit:
    fit = chosen(ladder).fit
    assert isinstance(fit, ModelFit)  # every rung of this chain is one
    return fit


def driven_run_of(
    study: Study, run: Run, *, band_hz: tuple[float, float] = BAND_HZ
) -> tuple[DrivenRun, tuple[int, int]]:
    """Return a run of a study as the model takes it, and how many single spikes were mended on either channel.

    Args:
        study: the study.
        run: one of its runs.
        band_hz: lines of the prediction errors that count, Hz.
    """
    mended = [without_spikes(samples, fs=study.fs) for samples in study.accelerations(run)]
    leaks = [run.recording.channel(leak.channel) for leak in study.sensors.leaks]
    driven = driven_run(
        mended[0][0],
        mended[1][0],
        fs=study.fs,
        band_hz=band_hz,
        mass_change_kg=run.mass_change_kg,
        sensors=study.sensors,
        leaks=np.stack(leaks, axis=1) if leaks else None,
    )
    return driven, (mended[0][1].size, mended[1][1].size)


def _first_fit(start: Start, runs: Sequence[DrivenRun], ground: bool) -> tuple[ModelFit, int]:
    """Fit the law of the classical chain from its values; where that is doubtful, from others too."""
    joint, surfaces, study = start.joint, start.surfaces, start.study
    facts = (study.sensors.unsprung, study.sensors.sprung)
    noise = (facts[0].noise_m_per_s2 or start.noise_floor, facts[1].noise_m_per_s2 or start.noise_floor)
    motion_rms = (
        max(float(surface.travel.std()) for surface in surfaces),
        max(float(surface.velocity.std()) for surface in surfaces),
    )

    def fitted(law: Law, near: JointFit, begun: FloatArray | None = None) -> ModelFit | None:
        try:
            return fit_model(
                runs,
                law,
                stiffness_per_mass=near["stiffness_per_mass"],
                damping_per_mass=near["damping_per_mass"],
                ground_stiffness_per_mass=(
                    joint["ground_stiffness_per_mass"] if ground and _demands_ground(joint) else None
                ),
                inverse_mass=near["inverse_mass"] if "inverse_mass" in joint.names else None,
                noise_m_per_s2=noise,
                motion_rms=motion_rms,
                start=begun,
            )
        except UnboundedResponseError:
            return None

    fits = [fitted(joint.law, joint)]
    if fits[0] is None or fits[0].noise_m_per_s2 > DOUBTFUL * fits[0].level:
        linear = next((step.fit for step in start.ladder if step.law_name == "linear"), joint)
        straight = fitted(Law(), linear)
        fits.append(fitted(joint.law, linear, None if straight is None else straight.start))
        fits.append(None if straight is None else fitted(joint.law, straight, straight.start))
    sound = [fit for fit in fits if fit is not None]
    if not sound:
        raise UnboundedResponseError(
            "the suspension that the classical chain finds grows without bound when the measured spindle drives it: "
            "check that the channels are those of one gear and not swapped, or use --method classical"
        )
    return min(sound, key=lambda fit: fit.bic), len(fits)


def _demands_ground(fit: JointFit) -> bool:
    name = "ground_stiffness_per_mass"
    if name not in fit.names:
        return False
    value, std = fit[name], float(fit.std[fit.names.index(name)])
    return abs(value) > GROUND_STD * std and abs(value) > GROUND_SHARE * abs(fit["stiffness_per_mass"])
