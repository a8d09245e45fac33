"""The chain as `opid.suspensions.one_gear` takes it, around `preparation` and `chain`: deleted together with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from opid.suspensions.one_gear.study import Study
from opid.suspensions.paper.added_mass import AddedMass
from opid.suspensions.paper.chain import PaperChain, PeakPair, RunEvidence, chain_of
from opid.suspensions.paper.identification import _scaled, _tried_laws
from opid.suspensions.paper.joint_fit import JointFit, LadderStep, chosen
from opid.suspensions.paper.law_search import thinned
from opid.suspensions.paper.nonlinearity import fit_surface
from opid.suspensions.paper.preparation import PreparedRun, combined_noise, prepare_runs
from opid.suspensions.paper.restoring_force import RestoringForce
from opid.suspensions.paper.settings import PaperSettings
from opid.suspensions.paper.spectral_equation import EquationLines

__all__ = ["Evidence", "PeakPair", "RunEvidence", "Start", "classical_chain", "classical_start", "evidence_of"]

BAND_HZ = PaperSettings.band_hz
HIGH_PASS_HZ = PaperSettings.high_pass_hz
LEAST_NOISE = PaperSettings.least_noise


@dataclass(frozen=True, eq=False)
class Evidence:
    """Everything behind an answer of one gear.

    Args:
        chain: the steps of the paper.
        ladder: the laws that were tried.
        joint: the joint fit of all runs, per unit of the reference mass.
        added_mass: absolute parameters, or None where the mass is not determined.
        not_determined: why, or None.
        model: what was found out about the driven model (`ModelEvidence`), None for the classical chain alone.
    """

    chain: PaperChain
    ladder: tuple[LadderStep, ...]
    joint: JointFit
    added_mass: AddedMass | None
    not_determined: str | None
    model: Any = None

    @property
    def runs(self) -> tuple[RunEvidence, ...]:
        """One a run."""
        return self.chain.runs

    @property
    def pairs(self) -> tuple[PeakPair, ...]:
        """Matched peaks of the reference and each other run."""
        return self.chain.pairs

    @property
    def noise_floor(self) -> float:
        """Noise of the sprung channel, m/s^2."""
        return self.chain.noise_floor_m_per_s2

    @property
    def mean_static_transmissibility(self) -> float:
        """T(0) read from the lowest lines."""
        return self.chain.static_transmissibility


@dataclass(frozen=True, eq=False)
class Start:
    """The prepared runs and a first fit of the equation.

    Args:
        study: the runs.
        prepared: the same, checked and integrated.
        ladder: the laws that were tried on the equation.
        settings: of the chain.
    """

    study: Study
    prepared: tuple[PreparedRun, ...]
    ladder: tuple[LadderStep, ...]
    settings: PaperSettings

    @property
    def joint(self) -> JointFit:
        """The fit that the search of the equation ended on."""
        return chosen(self.ladder).fit

    @property
    def surfaces(self) -> tuple[RestoringForce, ...]:
        """Restoring-force points, one a run."""
        return tuple(run.surface for run in self.prepared)

    @property
    def lines(self) -> tuple[EquationLines, ...]:
        """Transforms, one a run."""
        return tuple(run.lines for run in self.prepared)

    @property
    def mended_spikes(self) -> tuple[int, int]:
        """How many, on the unsprung and the sprung channels."""
        return sum(run.mended_spikes[0] for run in self.prepared), sum(run.mended_spikes[1] for run in self.prepared)

    @property
    def inverse_mass(self) -> float | None:
        """A first guess of 1/M2, 1/kg; None where all runs have one mass."""
        changes = [run.mass_change_kg for run in self.prepared]
        return 1 / (8 * (max(changes) - min(changes))) if len(set(changes)) > 1 else None

    @property
    def ground(self) -> bool:
        """Whether the ground spring is free."""
        return self.settings.ground

    @property
    def noise_floor(self) -> float:
        """Noise of the sprung channel, m/s^2."""
        return combined_noise(self.prepared)


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
        study: the runs.
        law: a law to fit; searched when left out.
        likely: take the candidate that fits the restoring-force points best instead of searching.
        band_hz: lines of the equation, Hz.
        high_pass_hz: corner of the integration, Hz.
        ground: whether the ground spring is free (else it is 0).
        progress: called with the name of each step as it begins.
    """
    settings = PaperSettings(law=law, band_hz=band_hz, high_pass_hz=high_pass_hz, ground=ground)
    prepared = prepare_runs(study, settings=settings, progress=progress)
    if progress is not None:
        progress("law")
    if law is None and likely:
        settings = replace(settings, law=_likely_law(prepared[0].surface, settings))
    return Start(study, prepared, _tried_laws(prepared, settings), settings)


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
    chain = chain_of(
        start.prepared, joint.law, inverse_mass=joint["inverse_mass"], settings=start.settings, progress=progress
    )
    if progress is not None:
        progress("added mass")
    return Evidence(chain, ladder, joint, *_scaled(joint, chain, start.settings))


def classical_chain(study: Study, *, law: str | None = None) -> Evidence:
    """Run every step of the chain on every run of a study.

    Args:
        study: the runs; the first one with no mass change is the reference.
        law: a law to fit; searched when left out.
    """
    start = classical_start(study, law=law)
    return evidence_of(start, start.joint, start.ladder)


def _likely_law(surface: RestoringForce, settings: PaperSettings) -> str:
    """Return the candidate that fits the restoring-force points best, "linear" where none fits clearly better."""
    points = thinned(surface)
    left = {name: fit_surface(points, name).residual_rms for name in ("linear", *settings.candidates)}
    best = min(left, key=lambda name: left[name])
    return best if left[best] < (1 - settings.noise_margin) * left["linear"] else "linear"
