"""What an identification of a body on several suspensions found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from typing import Any

from opid.estimate import Estimate
from opid.mechanics.laws import Law
from opid.signals.recording import FloatArray

BODY_PARAMETERS = ("sprung_mass_kg", "roll_inertia_kg_m2", "pitch_inertia_kg_m2", "x_cg_m", "y_cg_m")
"""Of a rigid body: inertias about the centre of gravity."""

BODY_RATIOS = ("roll_radius_m", "pitch_radius_m", "x_cg_m", "y_cg_m")
"""What one loading alone gives: radii of gyration, and the centre of gravity."""


@dataclass(frozen=True, eq=False)
class InterfaceEstimate:
    """One suspension.

    Args:
        name: of the interface.
        shared_with: interfaces with the same stiffness, damping and law.
        stiffness: K, N/m; per kg of the body where the mass is not determined (`per_mass` of the identification).
        damping: C, N s/m, likewise.
        law: f(z, z') beside them, N, likewise.
        law_estimates: {kind: {parameter: Estimate}} of it.
        travel: (n,) z of all runs, thinned for figures, m.
        velocity: (n,) z', m/s.
        residual_over_noise: of its sensor on the body: rms of the prediction errors over the noise known beforehand.
    """

    name: str
    shared_with: tuple[str, ...]
    stiffness: Estimate
    damping: Estimate
    law: Law
    law_estimates: Mapping[str, Mapping[str, Estimate]]
    travel: FloatArray
    velocity: FloatArray
    residual_over_noise: float


@dataclass(frozen=True)
class Candidate:
    """One structure that was tried on the same data.

    Args:
        kind: "single", "pair" or "rigid_body".
        interfaces: names of those that it is about; a pair is their mean.
        sprung_mass_kg: mass found: of all that is sprung, or of what rests on one gear.
        residual_over_noise: rms of the prediction errors over the noise known beforehand.
        left_out_over_noise: likewise of runs that the others predict; None for a single run, or where the others cannot
            be fitted.
        law: name of the law found.
        explains: whether the residual is noise, also in runs that the others predict.
        recommended: whether this is the structure to take.
        why: one sentence.
    """

    kind: str
    interfaces: tuple[str, ...]
    sprung_mass_kg: Estimate
    residual_over_noise: float
    left_out_over_noise: float | None
    law: str
    explains: bool
    recommended: bool
    why: str


@dataclass(frozen=True, eq=False)
class RunResidual:
    """What the model leaves of one run.

    Args:
        name: of the run.
        mass_change_kg: of its loading.
        frequency_hz: (n_lines,) lines that were compared.
        residual: (n_sensors, n_lines) magnitude of the whitened errors; the square has mean 1 where the noise is as
            assumed.
        time_s: (n,) thinned, for figures.
        measured: (n_sensors, n) accelerations of the body, m/s^2.
        predicted: (n_sensors, n) from all that was read before, m/s^2.
        loading: rows (mass kg, x m, y m).
    """

    name: str
    mass_change_kg: float
    frequency_hz: FloatArray
    residual: FloatArray
    time_s: FloatArray
    measured: FloatArray
    predicted: FloatArray
    loading: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, eq=False)
class BodyIdentification:
    """The result for a body on several suspensions.

    Args:
        title: of the study.
        date: of the runs; None if it is not known.
        structure: kind of the structure that the numbers belong to.
        parameters: one `Estimate` for each name in `BODY_PARAMETERS`, of the reference loading.
        ratios: one `Estimate` for each name in `BODY_RATIOS`.
        per_mass: whether stiffness, damping and laws are per kg of the body (of what rests on that gear, for gears
            alone): the mass is not determined.
        interfaces: the suspensions, in the order of the study.
        places: {interface: (x, y, sensor x, sensor y)}, m, as stated.
        place_corrections: {"x_m[left]": Estimate, ...} of coordinates that were stated with a tolerance.
        candidates: structures that were compared; the recommended one says so.
        runs: what the model leaves of each run.
        noise_m_per_s2: level of the sensors that was known beforehand or estimated from the records.
        residual_over_noise: of the whole fit.
        diagnostics: what the answer rests on, ready for JSON.
        warnings: what to doubt, one sentence each.
        not_determined: why there are no absolute values, or no values at all; None if there are.
    """

    title: str
    date: date | None
    structure: str
    parameters: Mapping[str, Estimate]
    ratios: Mapping[str, Estimate]
    per_mass: bool
    interfaces: tuple[InterfaceEstimate, ...]
    places: Mapping[str, tuple[float, float, float, float]]
    place_corrections: Mapping[str, Estimate]
    candidates: tuple[Candidate, ...]
    runs: tuple[RunResidual, ...]
    noise_m_per_s2: float
    residual_over_noise: float
    diagnostics: Mapping[str, Any]
    warnings: tuple[str, ...]
    not_determined: str | None
