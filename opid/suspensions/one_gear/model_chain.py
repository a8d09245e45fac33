"""The classical chain for the start, the driven model for the answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.signals.health import without_spikes
from opid.suspensions.band_lines import BAND_HZ
from opid.suspensions.one_gear.demands import EXPLAINED, Demand, at_last, let_in
from opid.suspensions.one_gear.driven_run import DrivenRun, driven_run
from opid.suspensions.one_gear.first_fit import DOUBTFUL, first_fit
from opid.suspensions.one_gear.force_surface import force_surface
from opid.suspensions.one_gear.imitations import ground_imitations
from opid.suspensions.one_gear.model_evidence import ModelEvidence
from opid.suspensions.one_gear.model_fit import ModelFit
from opid.suspensions.one_gear.noise_levels import with_own_noise
from opid.suspensions.one_gear.pursuit import judged_by_left_out, with_neighbours
from opid.suspensions.one_gear.sparse_road import which_law
from opid.suspensions.one_gear.study import Study
from opid.suspensions.one_gear.whiteness import bootstrap_std, coloured_std, whiteness
from opid.suspensions.paper.classical import Evidence, Start, evidence_of
from opid.suspensions.paper.joint_fit import LadderStep, chosen
from opid.suspensions.paper.law_search import search_law


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
        roads: how a law is searched, see `opid.suspensions.one_gear.sparse_road.which_law`.
        seed: of the resampling that checks the intervals.
        progress: called with the name of each step as it begins.

    Returns:
        The evidence with joint fit, ladder and absolute parameters of the model; the paper's steps take its law.
    """
    say = progress or (lambda step: None)
    study = start.study
    say("model")
    runs = driven_runs(study, band_hz=band_hz)
    found = _found(start, runs, search=search, ground=ground, roads=roads, progress=progress)
    runs, ladder, demands = found.runs, found.ladder, found.demands
    ladder = with_neighbours(runs, ladder) if search else judged_by_left_out(runs, ladder)
    best = _model_fit(ladder)
    # the levels of the two sensors are told apart only where the model explains the runs
    if best.noise_m_per_s2 < EXPLAINED * best.level:
        best = with_own_noise(runs, best, study.sensors)
    ladder = _with_choice(ladder, best)
    say("intervals")
    model = ModelEvidence(
        fit=best,
        surface=force_surface(runs, best),
        whiteness=whiteness(best),
        coloured_std=coloured_std(best),
        bootstrap_std=bootstrap_std(runs, best, rng=np.random.default_rng(seed)),
        demands=tuple(at_last(demand, best) for demand in demands if demand.name in best.names),
        ground=ground_imitations(runs, best),
        mended_spikes=start.mended_spikes,
        n_starts=found.n_starts,
        limits=(),
    )
    return replace(evidence_of(start, best, ladder, progress=progress), model=model)


@dataclass(frozen=True, eq=False)
class _Found:
    """Where one way through laws and sensors' faults ended."""

    runs: tuple[DrivenRun, ...]
    ladder: tuple[LadderStep, ...]
    demands: tuple[Demand, ...]
    n_starts: int

    @property
    def fit(self) -> ModelFit:
        return _model_fit(self.ladder)

    @property
    def doubtful(self) -> bool:
        return self.fit.noise_m_per_s2 > DOUBTFUL * self.fit.level


def _found(
    start: Start,
    runs: tuple[DrivenRun, ...],
    *,
    search: bool,
    ground: bool,
    roads: Sequence[str] | None,
    progress: Callable[[str], None] | None,
) -> _Found:
    """Find law and sensors' faults; where that leaves a doubt, in another order and from another start too."""
    ground_start = start.joint if ground and "ground_stiffness_per_mass" in start.joint.names else None
    first, n_starts = first_fit(start, runs, ground=ground, searched=search)
    if not search:
        runs, fit, demands = let_in(runs, first, ground_start=ground_start, progress=progress)
        return _Found(runs, (LadderStep(fit.law.name, fit, True, road="given"),), demands, n_starts)

    def way(first: ModelFit, roads: Sequence[str] | None, *, faults_first: bool = False) -> _Found:
        own, fit = runs, first
        demands: tuple[Demand, ...] = ()
        if faults_first:
            own, fit, demands = let_in(own, fit, ground_start=ground_start, progress=progress)
        ladder = which_law(own, fit, roads=roads, progress=progress)
        own, fit, more = let_in(own, _model_fit(ladder), ground_start=ground_start, progress=progress)
        # what was wrong with the sensors may have been taken for a term of the law
        further = which_law(own, fit, roads=roads, progress=progress) if more else ()
        ladder = (*ladder, *further) if further else _with_choice(ladder, fit)
        return _Found(own, ladder, (*demands, *more), n_starts)

    # the second road takes long: only where nothing else helps, or where it is asked for
    quick = roads or ("pursuit",)
    best = way(first, quick)
    if best.doubtful:
        best = min(best, way(first, quick, faults_first=True), key=lambda found: found.fit.bic)
    if best.doubtful:
        fuller = replace(
            start,
            ladder=search_law(start.lines, start.surfaces, inverse_mass=start.inverse_mass, ground=start.ground),
        )
        again, more_starts = first_fit(fuller, runs, ground=ground)
        best = min(best, way(again, roads), key=lambda found: found.fit.bic)
        best = replace(best, n_starts=n_starts + more_starts)
    return best


def _model_fit(ladder: tuple[LadderStep, ...]) -> ModelFit:
    fit = chosen(ladder).fit
    assert isinstance(fit, ModelFit)  # every rung of this chain is one
    return fit


def _with_choice(ladder: tuple[LadderStep, ...], fit: ModelFit) -> tuple[LadderStep, ...]:
    """The ladder with its choice fitted once more: what led there stays."""
    choice = chosen(ladder)
    return tuple(replace(step, fit=fit) if step is choice else step for step in ladder)


def driven_runs(study: Study, *, band_hz: tuple[float, float] = BAND_HZ) -> tuple[DrivenRun, ...]:
    """Return the runs of a study as the model takes them, single spikes mended.

    Args:
        study: the study.
        band_hz: lines of the prediction errors that count, Hz.
    """
    runs = []
    for run in study.runs:
        unsprung, sprung = (without_spikes(samples, fs=study.fs)[0] for samples in study.accelerations(run))
        leaks = [run.recording.channel(leak.channel) for leak in study.sensors.leaks]
        runs.append(
            driven_run(
                unsprung,
                sprung,
                fs=study.fs,
                band_hz=band_hz,
                mass_change_kg=run.mass_change_kg,
                sensors=study.sensors,
                leaks=np.stack(leaks, axis=1) if leaks else None,
            )
        )
    return tuple(runs)
