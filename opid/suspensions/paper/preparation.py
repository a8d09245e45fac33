"""The runs of a study, checked and integrated: what every step of the chain begins with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from opid.signals.health.inspection import Finding, check_channels, without_spikes
from opid.signals.recording import FloatArray
from opid.signals.spectra import noise_floor
from opid.suspensions.paper.restoring_force import RestoringForce, restoring_force
from opid.suspensions.paper.settings import DEFAULTS, PaperSettings
from opid.suspensions.paper.spectral_equation import EquationLines, equation_lines
from opid.suspensions.study import Run, Study


@dataclass(frozen=True, eq=False)
class PreparedRun:
    """One run, ready for the chain.

    Args:
        name: of the run.
        mass_change_kg: against the reference, kg.
        fs: sampling rate, Hz.
        time_s: (n,) s.
        unsprung: (n,) x1'', single spikes mended, m/s^2.
        sprung: (n,) x2'', likewise.
        mended_spikes: how many, of the unsprung and the sprung channel.
        findings: what the health check says of the pair.
        noise_floor: of the unsprung and the sprung channel, m/s^2.
        surface: restoring-force points.
        lines: the run's transform.
    """

    name: str
    mass_change_kg: float
    fs: float
    time_s: FloatArray
    unsprung: FloatArray
    sprung: FloatArray
    mended_spikes: tuple[int, int]
    findings: tuple[Finding, ...]
    noise_floor: tuple[float, float]
    surface: RestoringForce
    lines: EquationLines


def prepare_runs(
    study: Study, *, settings: PaperSettings = DEFAULTS, progress: Callable[[str], None] | None = None
) -> tuple[PreparedRun, ...]:
    """Check, mend and integrate the runs of a study.

    Args:
        study: the runs.
        settings: `band_hz` and `high_pass_hz` count here.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: two channels that make no pair, or a run that is too short.
    """
    say = progress or (lambda step: None)
    pair = (study.unsprung, study.sprung)
    findings = [check_channels(run.recording, [pair], pair, run=run.name) for run in study.runs]
    say("restoring force")
    return tuple(
        _prepared(study, run, (*run.findings, *found), settings)
        for run, found in zip(study.runs, findings, strict=True)
    )


def _prepared(study: Study, run: Run, findings: tuple[Finding, ...], settings: PaperSettings) -> PreparedRun:
    fs, high_pass_hz = study.fs, settings.high_pass_hz
    (unsprung, at_unsprung), (sprung, at_sprung) = (
        without_spikes(samples, fs=fs) for samples in study.accelerations(run)
    )
    return PreparedRun(
        name=run.name,
        mass_change_kg=run.mass_change_kg,
        fs=run.recording.fs,
        time_s=run.recording.time_s,
        unsprung=unsprung,
        sprung=sprung,
        mended_spikes=(int(at_unsprung.size), int(at_sprung.size)),
        findings=findings,
        noise_floor=(noise_floor(unsprung, fs=fs), noise_floor(sprung, fs=fs)),
        surface=restoring_force(unsprung, sprung, fs=fs, high_pass_hz=high_pass_hz),
        lines=equation_lines(
            unsprung,
            sprung,
            fs=fs,
            band_hz=settings.band_at(fs),
            high_pass_hz=high_pass_hz,
            mass_change_kg=run.mass_change_kg,
        ),
    )


def combined_noise(runs: Sequence[PreparedRun], *, least_noise: float = PaperSettings.least_noise) -> float:
    """Return the noise of the sprung channel over all runs, m/s^2, which dominates the equation above resonance.

    Args:
        runs: the runs.
        least_noise: the noise of a run is never taken below this fraction of its rms.
    """
    noise = [max(run.noise_floor[1], least_noise * float(run.sprung.std())) for run in runs]
    return float(np.sqrt(np.mean(np.square(noise))))
