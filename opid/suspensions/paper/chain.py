"""The steps of the paper (Iwaniec & Uhl 2007), each of them mended, and as printed, on every run of a study.

restoring force -> arctangent -> transmissibility -> direct parameters -> matched peaks

The mended steps take any law, that of `identify_by_paper` or that of another fit. The printed ones (`run_as_printed`)
find their own; the matched peaks are theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from opid.mechanics.laws.law import Law
from opid.progress import Say
from opid.signals.health.inspection import Finding, check_channels, remove_spikes
from opid.signals.motion import Motion, relative_motion
from opid.signals.recording import FloatArray
from opid.signals.spectra import Transmissibility, TransmissibilitySettings, noise_floor
from opid.suspensions.paper.added_mass import PeakMatch, TwoPeakMass, match_peaks, two_peak_mass
from opid.suspensions.paper.printed import PrintedRun, run_as_printed
from opid.suspensions.paper.restoring_force import (
    BinnedSurface,
    LawFit,
    RestoringForce,
    SliceCurve,
    binned_surface,
    fit_slice,
    fit_surface,
    restoring_force,
    slice_curve,
)
from opid.suspensions.paper.settings import DEFAULTS, PaperSettings
from opid.suspensions.paper.spectral_equation import EquationLines, equation_lines
from opid.suspensions.paper.transmissibility import (
    DirectParameters,
    Peak,
    block_of,
    complex_least_squares,
    errors_in_variables,
    estimate_transmissibility,
    read_static_transmissibility,
    transmissibility_peaks,
    transmissibility_without_force,
)
from opid.suspensions.study import Run, Study


@dataclass(frozen=True, eq=False)
class PreparedRun:
    """One run, checked, mended and integrated, with which every step of the chain begins.

    Args:
        name: name of the run.
        mass_change_kg: mass minus that of the reference, kg.
        fs: sampling rate, Hz.
        time_s: (n,) time, s.
        unsprung: (n,) x1'', single spikes mended, m/s^2.
        sprung: (n,) x2'', single spikes mended, m/s^2.
        findings: findings of the health check of the pair.
        noise_floor: noise of the unsprung and of the sprung channel, m/s^2.
        surface: restoring-force points.
        lines: the run's transform.
    """

    name: str
    mass_change_kg: float
    fs: float
    time_s: FloatArray
    unsprung: FloatArray
    sprung: FloatArray
    findings: tuple[Finding, ...]
    noise_floor: tuple[float, float]
    surface: RestoringForce
    lines: EquationLines


@dataclass(frozen=True, eq=False)
class RunEvidence(PreparedRun):
    """Results of all steps of the chain for one run, in their order.

    Args:
        motion: relative motion, integrated with a high-pass filter.
        binned: the restoring-force points, averaged over cells.
        slices: stiffness curve and damping curve.
        surface_fit: stiffness and damping arctangents on all points.
        T: transmissibility as measured.
        T_without_force: transmissibility of the linear suspension without the law (conditioned).
        T_subtracted: transmissibility with the force of the law subtracted from the acceleration (eq. 4).
        peaks: peaks of |T| as measured.
        complex_fit: complex least squares on `T_without_force`.
        spectral_fit: errors in variables on the run's transform.
        printed: the printed steps.
        settings: of the chain.
    """

    motion: Motion
    binned: BinnedSurface
    slices: tuple[SliceCurve, ...]
    surface_fit: LawFit
    T: Transmissibility
    T_without_force: Transmissibility
    T_subtracted: Transmissibility
    peaks: tuple[Peak, ...]
    complex_fit: DirectParameters
    spectral_fit: DirectParameters
    printed: PrintedRun
    settings: PaperSettings

    @cached_property
    def slice_fits(self) -> tuple[LawFit, ...]:
        """An arctangent on each slice; only figures show them, so they are fitted when one is drawn."""
        return tuple(fit_slice(curve, settings=self.settings) for curve in self.slices)


@dataclass(frozen=True)
class PeakPair:
    """A matched pair of peaks of the printed T, with the masses that the paper's formula gives for it.

    Args:
        run_name: the run with the changed mass.
        match: the pair and whether it is credible.
        as_printed: the result from magnitudes.
        sign_restored: the result from T = -|T|.
    """

    run_name: str
    match: PeakMatch
    as_printed: TwoPeakMass
    sign_restored: TwoPeakMass


@dataclass(frozen=True, eq=False)
class PaperChain:
    """Results of the steps of the paper.

    Args:
        runs: one for each run.
        pairs: matched peaks of the printed T of the reference and of each other run.
        static_transmissibility: T(0) of the reference as printed, read from the lowest lines.
        noise_floor_m_per_s2: noise of the sprung channel, which dominates the equation above resonance.
        high_pass_hz: corner of the integration, Hz.
        band_hz: lines that were used, Hz.
        n_pairs: number of pairs in Table 3.
    """

    runs: tuple[RunEvidence, ...]
    pairs: tuple[PeakPair, ...]
    static_transmissibility: float
    noise_floor_m_per_s2: float
    high_pass_hz: float
    band_hz: tuple[float, float]
    n_pairs: int

    @property
    def reference(self) -> RunEvidence:
        """The first run without a mass change, or the first run."""
        return next((run for run in self.runs if run.mass_change_kg == 0), self.runs[0])

    @property
    def ranked_pairs(self) -> tuple[PeakPair, ...]:
        """All pairs, credible ones first, then by |T|: few averages give dozens of pairs by chance."""
        return tuple(
            sorted(self.pairs, key=lambda pair: (pair.match.credible, pair.match.reference.magnitude), reverse=True)
        )

    @property
    def strongest_pair(self) -> PeakPair | None:
        """The credible pair with the largest |T|, or the pair with the largest |T|; None without a pair."""
        return self.ranked_pairs[0] if self.pairs else None

    @property
    def table_3(self) -> tuple[PeakPair, ...]:
        """The first pairs, as many as the paper has, by frequency; their numbers are those of the peaks in Fig. 9."""
        first = self.ranked_pairs[: self.n_pairs]
        return tuple(sorted(first, key=lambda pair: pair.match.reference.frequency_hz))


def compute_chain(
    study: Study,
    *,
    law_per_mass: Law,
    inverse_mass: float = 0.0,
    ground: bool = True,
    band_hz: tuple[float, float] = PaperSettings.band_hz,
    settings: PaperSettings = DEFAULTS,
    is_checked: bool = False,
    progress: Say | None = None,
) -> PaperChain:
    """Run the steps of the paper on every run of a study, with the law of any fit.

    Args:
        study: the runs; the first one with no mass change is the reference.
        law_per_mass: the nonlinear law per unit of the reference mass, m/s^2.
        inverse_mass: 1/M2 of the reference, 1/kg; 0 where the mass is not determined.
        ground: whether the ground spring is free (else it is 0).
        band_hz: lines that are used, Hz; cut at `highest_fraction_of_rate` of the sampling rate.
        settings: all other settings.
        is_checked: whether the runs hold what a check of their channels found, as those of `opid.identify` do.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: two channels that make no pair, or a run that is too short.
    """
    settings = replace(settings, ground=ground, band_hz=band_hz).stated_by(study.transmissibility)
    say = progress or (lambda step: None)
    runs = prepare_runs(study if is_checked else check_runs(study), settings, say)
    return chain_of(runs, law_per_mass, inverse_mass, settings, say)


def prepare_runs(study: Study, settings: PaperSettings, say: Say) -> tuple[PreparedRun, ...]:
    """Mend and integrate the runs of a study whose channels are checked."""
    say("restoring force")
    return tuple(_prepare_run(study, run, settings) for run in study.runs)


def check_runs(study: Study) -> Study:
    """Return the study with what the health check of the pair finds in each run."""
    pair = (study.unsprung, study.sprung)
    found = [tuple(check_channels(run.recording, [pair], pair, run=run.name)) for run in study.runs]
    runs = [replace(run, findings=(*run.findings, *each)) for run, each in zip(study.runs, found, strict=True)]
    return replace(study, runs=tuple(runs))


def _prepare_run(study: Study, run: Run, settings: PaperSettings) -> PreparedRun:
    fs, high_pass_hz = study.fs, settings.high_pass_hz
    pair = [remove_spikes(samples, fs=fs)[0] for samples in study.accelerations(run)]
    band_hz, change_kg = settings.band_at(fs), run.mass_change_kg
    return PreparedRun(
        name=run.name,
        mass_change_kg=change_kg,
        fs=run.recording.fs,
        time_s=run.recording.time_s,
        unsprung=pair[0],
        sprung=pair[1],
        findings=run.findings,
        noise_floor=(noise_floor(pair[0], fs=fs), noise_floor(pair[1], fs=fs)),
        surface=restoring_force(*pair, fs=fs, high_pass_hz=high_pass_hz),
        lines=equation_lines(*pair, fs=fs, band_hz=band_hz, high_pass_hz=high_pass_hz, mass_change_kg=change_kg),
    )


def chain_of(
    runs: Sequence[PreparedRun],
    law_per_mass: Law,
    inverse_mass: float,
    settings: PaperSettings,
    say: Say,
) -> PaperChain:
    """Run the steps of the paper on prepared runs, see `compute_chain`."""
    say("runs")
    # A run of another mass has another force per unit of its own mass.
    found = tuple(
        _run_evidence(run, law_per_mass.scaled(1 / (1 + inverse_mass * run.mass_change_kg)), settings) for run in runs
    )
    reference = next((run for run in found if run.mass_change_kg == 0), found[0])
    static = read_static_transmissibility(reference.printed.T, up_to_hz=settings.static_hz)
    # The noise of the sprung channel dominates the equation above resonance.
    noise = [max(run.noise_floor[1], settings.least_noise * float(run.sprung.std())) for run in runs]
    return PaperChain(
        runs=found,
        pairs=_pair_peaks(found, reference, static, settings.largest_mass_fraction),
        static_transmissibility=static,
        noise_floor_m_per_s2=float(np.sqrt(np.mean(np.square(noise)))),
        high_pass_hz=settings.high_pass_hz,
        band_hz=runs[0].lines.band_hz,
        n_pairs=settings.printed.n_pairs,
    )


def _run_evidence(run: PreparedRun, law: Law, settings: PaperSettings) -> RunEvidence:
    fs = run.fs
    motion = relative_motion(run.unsprung, run.sprung, fs=fs, high_pass_hz=settings.high_pass_hz)
    measured, conditioned, subtracted = _estimate_transmissibilities(run, motion, law, settings.transmissibility)
    low, high = run.lines.band_hz
    # A block does not resolve lines below two of its own.
    lowest = max(low, 2 / (settings.transmissibility.block_s or np.inf))
    complex_fit = complex_least_squares(conditioned, band_hz=(lowest, high), ground=settings.ground)
    width, n, least = settings.slice_half_width, settings.n_cells, settings.least_points_of_cell
    slices = tuple(slice_curve(run.surface, along=along, half_width_std=width) for along in ("travel", "velocity"))
    return RunEvidence(
        **vars(run),
        motion=motion,
        binned=binned_surface(run.surface, n_travel=n, n_velocity=n, min_count=least),
        slices=slices,
        surface_fit=fit_surface(run.surface.thinned(settings.start_points), settings=settings),
        T=measured,
        T_without_force=conditioned,
        T_subtracted=subtracted,
        peaks=transmissibility_peaks(
            measured,
            band_hz=(low, min(settings.highest_peak_hz, settings.highest_fraction_of_rate * fs)),
            prominence_std=settings.peak_prominence_std,
            prominence_ratio=settings.peak_prominence_ratio,
        ),
        complex_fit=complex_fit,
        spectral_fit=errors_in_variables(
            run.lines, law, start=complex_fit, ground=settings.ground, cluster_hz=settings.cluster_hz
        ),
        printed=run_as_printed(run.unsprung, run.sprung, fs=fs, settings=settings),
        settings=settings,
    )


def _estimate_transmissibilities(
    run: PreparedRun, motion: Motion, law: Law, settings: TransmissibilitySettings
) -> tuple[Transmissibility, Transmissibility, Transmissibility]:
    """Return the transmissibility as measured, conditioned on the force of the law, and with it subtracted."""
    inside, fs = motion.interior, run.fs
    unsprung, sprung = run.unsprung[inside], run.sprung[inside]
    force = law.force(motion.displacement, motion.velocity)[inside]
    # Fewer than about five overlapping blocks do not distinguish the force from the motion.
    known: dict[str, Any] = {"fs": fs, "settings": settings, "shortened": 3}
    taken = block_of(settings, unsprung.size, fs, 3)
    return (
        estimate_transmissibility(unsprung, sprung, **known),
        transmissibility_without_force(unsprung, sprung, force, fs=fs, method="conditioned", **taken),
        estimate_transmissibility(unsprung, sprung + force, **known),
    )


def _pair_peaks(
    runs: Sequence[RunEvidence], reference: RunEvidence, static: float, largest_mass_fraction: float
) -> tuple[PeakPair, ...]:
    pairs = []
    for run in runs:
        change = run.mass_change_kg - reference.mass_change_kg
        if run is reference or change == 0:
            continue
        for match in match_peaks(
            reference.printed.peaks,
            run.printed.peaks,
            mass_change_kg=change,
            largest_mass_fraction=largest_mass_fraction,
        ):
            printed, restored = (
                two_peak_mass(
                    match.reference,
                    match.changed,
                    mass_change_kg=change,
                    static_transmissibility=static,
                    restore_sign=sign,
                )
                for sign in (False, True)
            )
            pairs.append(PeakPair(run.name, match, printed, restored))
    return tuple(pairs)
