"""The paper's chain from accelerations to mass (Iwaniec & Uhl 2007), with every step mended, and as printed.

restoring force -> arctangent -> transmissibility -> direct parameters -> added mass
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.signals.health import Finding, check_pair, inspect, without_spikes
from opid.signals.motion import Motion, relative_motion
from opid.signals.recording import FloatArray
from opid.signals.spectra import Transmissibility, noise_floor, transmissibility
from opid.suspensions.one_gear.study import Run, Study
from opid.suspensions.paper.added_mass import (
    AddedMass,
    PeakMatch,
    TwoPeakMass,
    absolute_parameters,
    match_peaks,
    two_peak_mass,
)
from opid.suspensions.paper.direct_parameters import DirectParameters, complex_least_squares, errors_in_variables
from opid.suspensions.paper.joint_fit import JointFit, LadderStep, chosen
from opid.suspensions.paper.law_search import CANDIDATES, fit_law, likely_law, search_law, thinned
from opid.suspensions.paper.nonlinearity import LawFit, fit_slice, fit_surface
from opid.suspensions.paper.restoring_force import (
    BinnedSurface,
    RestoringForce,
    SliceCurve,
    binned_surface,
    restoring_force,
    slice_curve,
)
from opid.suspensions.paper.spectral_equation import EquationLines, equation_lines
from opid.suspensions.paper.transmissibility import WAYS, Peak, transmissibility_peaks, transmissibility_without_force

BAND_HZ = (0.5, 12.0)
HIGH_PASS_HZ = 0.3
BLOCK_S = 8.0
# no model of a strut is better than this share of the motion, however quiet the sensor
LEAST_NOISE = 0.003


@dataclass(frozen=True, eq=False)
class RunEvidence:
    """All that the chain made of one run, in the order in which it was made.

    Args:
        name: of the run.
        mass_change_kg: against the reference, kg.
        fs: sampling rate, Hz.
        time_s: (n,) s.
        unsprung: (n,) x1'', m/s^2.
        sprung: (n,) x2'', m/s^2.
        findings: what the health check said of the pair.
        noise_floor: of the unsprung and the sprung channel, m/s^2.
        motion: relative motion, soundly integrated.
        motion_mean_removed: relative motion by the paper's literal recipe.
        surface: restoring-force points.
        binned: the same, averaged over cells.
        slices: stiffness curve and damping curve.
        slice_fits: an arctangent on each.
        surface_fit: stiffness and damping arctangents on all points.
        T: transmissibility as measured.
        T_without_force: that of the linear suspension beneath the fitted law (conditioned).
        T_subtracted: the paper's, the fitted force subtracted from the acceleration.
        peaks: of |T|.
        complex_fit: complex least squares on `T_without_force`.
        spectral_fit: errors in variables on the run's transform.
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
    motion: Motion
    motion_mean_removed: Motion
    surface: RestoringForce
    binned: BinnedSurface
    slices: tuple[SliceCurve, SliceCurve]
    slice_fits: tuple[LawFit, LawFit]
    surface_fit: LawFit
    T: Transmissibility
    T_without_force: Transmissibility
    T_subtracted: Transmissibility
    peaks: tuple[Peak, ...]
    complex_fit: DirectParameters
    spectral_fit: DirectParameters
    lines: EquationLines


@dataclass(frozen=True, eq=False)
class PeakPair:
    """A matched pair of peaks with the masses that the paper's formula makes of it.

    Args:
        run_name: the run with the changed mass.
        match: the pair and whether it is credible.
        as_printed: from magnitudes; None for equal masses.
        sign_restored: from T = -|T|; None likewise.
    """

    run_name: str
    match: PeakMatch
    as_printed: TwoPeakMass | None
    sign_restored: TwoPeakMass | None


@dataclass(frozen=True, eq=False)
class Evidence:
    """Everything behind the answer.

    Args:
        runs: one a run.
        pairs: matched peaks of the reference and each other run.
        ladder: the laws that were tried.
        joint: the joint fit of all runs, per unit of the reference mass.
        added_mass: absolute parameters, or None where the mass is not determined.
        not_determined: why, or None.
        noise_floor: noise of the sprung channel, m/s^2, which dominates the equation above resonance; never taken
            below `LEAST_NOISE` of its rms.
        mean_static_transmissibility: T(0) read from the lowest lines, for the peak formula.
        model: what was found out about the driven model (`ModelEvidence`), None for the classical chain alone.
    """

    runs: tuple[RunEvidence, ...]
    pairs: tuple[PeakPair, ...]
    ladder: tuple[LadderStep, ...]
    joint: JointFit
    added_mass: AddedMass | None
    not_determined: str | None
    noise_floor: float
    mean_static_transmissibility: float
    model: Any = None


@dataclass(frozen=True, eq=False)
class Start:
    """What every method starts from: the prepared runs and a first fit of the equation.

    Args:
        study: the runs.
        arrays: unsprung and sprung acceleration of each run, single spikes mended, m/s^2.
        mended_spikes: how many, on the unsprung and the sprung channels.
        findings: of the health check, one tuple a run.
        surfaces: restoring-force points, one a run.
        lines: transforms, one a run.
        ladder: the laws that were tried on the equation.
        noise_floors: (n_runs, 2) of the unsprung and the sprung channel, m/s^2.
        inverse_mass: a first guess of 1/M2, 1/kg; None where all runs have one mass.
        band_hz: lines of the equation, Hz.
        high_pass_hz: corner of the integration, Hz.
        ground: whether the ground spring is free.
    """

    study: Study
    arrays: tuple[tuple[FloatArray, FloatArray], ...]
    mended_spikes: tuple[int, int]
    findings: tuple[tuple[Finding, ...], ...]
    surfaces: tuple[RestoringForce, ...]
    lines: tuple[EquationLines, ...]
    ladder: tuple[LadderStep, ...]
    noise_floors: FloatArray
    inverse_mass: float | None
    band_hz: tuple[float, float]
    high_pass_hz: float
    ground: bool

    @property
    def joint(self) -> JointFit:
        """The fit that the search of the equation ended on."""
        return chosen(self.ladder).fit

    @property
    def noise_floor(self) -> float:
        """Noise of the sprung channel, m/s^2, never below `LEAST_NOISE` of its rms."""
        noise = [
            max(float(floor), LEAST_NOISE * float(sprung.std()))
            for floor, (_, sprung) in zip(self.noise_floors[:, 1], self.arrays, strict=True)
        ]
        return float(np.sqrt(np.mean(np.square(noise))))


def classical_start(
    study: Study,
    *,
    law: str | None = None,
    likely: bool = False,
    band_hz: tuple[float, float] = BAND_HZ,
    high_pass_hz: float = HIGH_PASS_HZ,
    ground: bool = True,
    progress: Callable[[str], None] | None = None,
) -> Start:
    """Check and integrate the runs, and fit the equation of the sprung mass to all of them.

    Args:
        study: the runs; the first one with no mass change is the reference.
        law: a law to fit; searched among `law_search.CANDIDATES` when left out.
        likely: take the candidate that fits the restoring-force points best instead of searching.
        band_hz: lines used by direct parameters and added mass, Hz; cut at 0.4 fs.
        high_pass_hz: corner of the integration, Hz.
        ground: whether the ground spring is free (else it is 0).
        progress: called with the name of each step as it begins.

    Raises:
        InputError: a pair of channels that is mute or swapped, runs too short, an unknown law.
    """
    say = progress or (lambda step: None)
    fs = study.fs
    band = (float(band_hz[0]), min(float(band_hz[1]), 0.4 * fs))
    recorded = [study.accelerations(run) for run in study.runs]
    findings = tuple(_checked(study, run, *pair) for run, pair in zip(study.runs, recorded, strict=True))
    mended = [[without_spikes(samples, fs=fs) for samples in pair] for pair in recorded]
    arrays = tuple((lower[0], upper[0]) for lower, upper in mended)
    n_mended = (sum(lower[1].size for lower, _ in mended), sum(upper[1].size for _, upper in mended))
    say("restoring force")
    surfaces = tuple(restoring_force(*pair, fs=fs, high_pass_hz=high_pass_hz) for pair in arrays)
    lines = tuple(
        equation_lines(*pair, fs=fs, band_hz=band, high_pass_hz=high_pass_hz, mass_change_kg=run.mass_change_kg)
        for run, pair in zip(study.runs, arrays, strict=True)
    )
    say("law")
    changes = [run.mass_change_kg for run in study.runs]
    mu = 1 / (8 * (max(changes) - min(changes))) if len(set(changes)) > 1 else None
    if law is None and likely:
        law = likely_law(surfaces[0])
    if law is None:
        ladder = search_law(lines, surfaces, inverse_mass=mu, ground=ground, candidates=CANDIDATES)
    else:
        names = dict.fromkeys(["linear", law])
        ladder = tuple(
            LadderStep(name, fit_law(lines, surfaces, name, inverse_mass=mu, ground=ground), name == law)
            for name in names
        )
    floors = np.array([[noise_floor(samples, fs=fs) for samples in pair] for pair in arrays])
    return Start(
        study, arrays, n_mended, findings, surfaces, lines, ladder, floors, mu, band, float(high_pass_hz), ground
    )


def evidence_of(
    start: Start, joint: JointFit, ladder: tuple[LadderStep, ...], *, progress: Callable[[str], None] | None = None
) -> Evidence:
    """Run the steps of the paper on every run, with the law of a joint fit.

    Args:
        start: the prepared runs.
        joint: the fit whose law and mass are taken.
        ladder: the laws that were tried on the way to it.
        progress: called with the name of each step as it begins.
    """
    say = progress or (lambda step: None)
    say("runs")
    runs = tuple(_run_evidence(start, place, joint) for place in range(len(start.arrays)))
    say("added mass")
    static = float(np.mean([_static_transmissibility(run.T) for run in runs]))
    added, reason = _added_mass(start.lines, joint)
    return Evidence(
        runs=runs,
        pairs=_peak_pairs(runs, static),
        ladder=ladder,
        joint=joint,
        added_mass=added,
        not_determined=reason,
        noise_floor=start.noise_floor,
        mean_static_transmissibility=static,
    )


def classical_chain(
    study: Study,
    *,
    law: str | None = None,
    band_hz: tuple[float, float] = BAND_HZ,
    high_pass_hz: float = HIGH_PASS_HZ,
    ground: bool = True,
    progress: Callable[[str], None] | None = None,
) -> Evidence:
    """Run every step of the chain on every run of a study.

    Args:
        study: the runs; the first one with no mass change is the reference.
        law: a law to fit; searched among `law_search.CANDIDATES` when left out.
        band_hz: lines used by direct parameters and added mass, Hz; cut at 0.4 fs.
        high_pass_hz: corner of the integration, Hz.
        ground: whether the ground spring is free (else it is 0).
        progress: called with the name of each step as it begins.

    Raises:
        InputError: a pair of channels that is mute or swapped, runs too short, an unknown law.
    """
    start = classical_start(
        study, law=law, band_hz=band_hz, high_pass_hz=high_pass_hz, ground=ground, progress=progress
    )
    return evidence_of(start, start.joint, start.ladder, progress=progress)


def _checked(study: Study, run: Run, unsprung: FloatArray, sprung: FloatArray) -> tuple[Finding, ...]:
    """Refuse what makes the two channels no pair; pass on what merely deserves a word."""
    try:
        findings = check_pair(unsprung, sprung, fs=study.fs, names=(study.unsprung, study.sprung))
    except InputError as error:
        raise InputError(f"run {run.name!r}: {error}") from None
    for finding in findings:
        if finding.severity == "fault":
            raise InputError(f"run {run.name!r}: {finding.message}")
    health = inspect(run.recording, thorough=False)
    pair = (study.unsprung, study.sprung)
    # a note (gravity on a channel, say) needs no word here: the mean is taken off anyway
    return run.findings + findings + tuple(f for f in health.findings if f.severity != "note" and f.channel in pair)


def _run_evidence(start: Start, place: int, joint: JointFit) -> RunEvidence:
    run, (unsprung, sprung) = start.study.runs[place], start.arrays[place]
    surface, lines, high_pass_hz = start.surfaces[place], start.lines[place], start.high_pass_hz
    fs = run.recording.fs
    band = start.band_hz
    motion = relative_motion(unsprung, sprung, fs=fs, high_pass_hz=high_pass_hz)
    slices = (slice_curve(surface, along="travel"), slice_curve(surface, along="velocity"))
    # force per unit of this run's own mass
    share = 1 / (1 + joint["inverse_mass"] * run.mass_change_kg)
    law = joint.law.scaled(share)
    inside = motion.settled
    # with fewer than some five overlapping blocks the force cannot be told from the motion
    nperseg = min(round(BLOCK_S * fs), unsprung[inside].size // 3)
    force = law.force(motion.displacement, motion.velocity)[inside]
    T = transmissibility(unsprung[inside], sprung[inside], fs=fs, nperseg=nperseg)
    conditioned, subtracted = (
        transmissibility_without_force(unsprung[inside], sprung[inside], force, fs=fs, way=way, nperseg=nperseg)
        for way in WAYS
    )
    complex_fit = complex_least_squares(conditioned, band_hz=(max(band[0], 2 / BLOCK_S), band[1]), ground=start.ground)
    return RunEvidence(
        name=run.name,
        mass_change_kg=run.mass_change_kg,
        fs=fs,
        time_s=run.recording.time_s,
        unsprung=unsprung,
        sprung=sprung,
        findings=start.findings[place],
        noise_floor=(float(start.noise_floors[place, 0]), float(start.noise_floors[place, 1])),
        motion=motion,
        motion_mean_removed=relative_motion(unsprung, sprung, fs=fs, method="mean_removed"),
        surface=surface,
        binned=binned_surface(surface),
        slices=slices,
        slice_fits=(fit_slice(slices[0]), fit_slice(slices[1])),
        surface_fit=fit_surface(thinned(surface)),
        T=T,
        T_without_force=conditioned,
        T_subtracted=subtracted,
        peaks=transmissibility_peaks(T, band_hz=(band[0], min(25.0, 0.4 * fs))),
        complex_fit=complex_fit,
        spectral_fit=errors_in_variables(lines, law, start=complex_fit, ground=start.ground),
        lines=lines,
    )


def _static_transmissibility(T: Transmissibility) -> float:
    """Read |T| at the lowest lines, as the paper read 0.7."""
    low = (T.frequency_hz > 0) & (T.frequency_hz <= max(0.5, 2.5 * T.frequency_hz[1]))
    return float(np.median(np.abs(T.value[low])))


def _peak_pairs(runs: Sequence[RunEvidence], static: float) -> tuple[PeakPair, ...]:
    reference = next((run for run in runs if run.mass_change_kg == 0), runs[0])
    pairs = []
    for run in runs:
        change = run.mass_change_kg - reference.mass_change_kg
        if run is reference or change == 0:
            continue
        for match in match_peaks(reference.peaks, run.peaks, mass_change_kg=change):
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


def _added_mass(lines: Sequence[EquationLines], joint: JointFit) -> tuple[AddedMass | None, str | None]:
    if "inverse_mass" not in joint.names:
        return None, (
            "all runs have the same sprung mass (mass_change_kg), so only ratios to the mass are determined: "
            "add a run at another mass"
        )
    try:
        return absolute_parameters(joint, [line.mass_change_kg for line in lines]), None
    except NotDeterminedError as error:
        return None, str(error)
