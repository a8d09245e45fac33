"""The result of measured resonance tests: its backbone, its harmonics, the interaction of modes, and the law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from opid.errors import list_names
from opid.estimate import Estimate
from opid.json_values import plain
from opid.modal.linear.modes import LinearModes
from opid.modal.power_laws import coefficient_rows
from opid.modal.resonance.appropriation import Appropriation, Interaction
from opid.modal.resonance.curve_fit import CurveFit, StateCheck
from opid.modal.resonance.held_out import HeldOut
from opid.modal.resonance.law import ResonanceLaw
from opid.modal.resonance.steady import SteadyState
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import FloatArray

SCHEMA = "opid.resonance/1"
OF_SEVERAL = "opid.resonances/1"

OF_INTERACTION = ("target", "mode", "harmonic", "flagged", "first_level", "fraction", "driven_fraction", "statement")
"""What result.json holds of the interaction."""


@dataclass(frozen=True, eq=False, repr=False)
class Resonance(Result):
    """One mode in measured tests at phase resonance, and in response curves.

    Args:
        title: the title of the study.
        mode: number of the mode that was held, from 1.
        modes: linear modes of the structure.
        drive_point: the sensor where the force acts.
        appropriation: the steady levels that count, in the order in which they were driven; None without such tests.
        states: the motion of the mode at each of these levels.
        level_tests: the name of the test of each level.
        level_start_s: where each level begins in its log, s.
        level_stop_s: where it ends, s.
        left_out: one sentence for each steady level that does not count.
        backbone_law: the law by frequency, force and amplitude of the levels, with the harmonics that it makes itself.
        records_law: the law by the steady records with their measured harmonics and by the transients between them.
        curves_law: the law by the points of the response curves; None without curves, or where they are withheld.
        joint_law: the law by records, transients and curves together; None where there are not both, or they disagree.
        curve_states: the motions of the response curves that count.
        curve_fits: each response curve beside that of a law: of the records, which have not seen the curves, and of the
            curves themselves where there are no records.
        held_out: the response curve that no law has seen, and what the law makes of its forces; None where all count.
        modal_mass: the modal mass that the curves showed of the shape as it was given, before it was scaled to 1; empty
            where the scale was known.
        curve_check: inertia of the mode and rate of the frequency that the curves show; None without curves.
        interaction: the harmonic of another mode that stands out most; None where there is no other elastic mode, or no
            level.
        warnings: one sentence for each warning.
        not_determined: why there is no law, "" if there is one.
        settings: the settings of the study.
        read_files: the files that were read.
    """

    title: str
    mode: int
    modes: LinearModes
    drive_point: str
    appropriation: Appropriation | None
    states: tuple[SteadyState, ...]
    level_tests: tuple[str, ...]
    level_start_s: FloatArray
    level_stop_s: FloatArray
    left_out: tuple[str, ...]
    backbone_law: ResonanceLaw | None
    records_law: ResonanceLaw | None
    curves_law: ResonanceLaw | None
    joint_law: ResonanceLaw | None
    curve_states: tuple[SteadyState, ...]
    curve_fits: tuple[CurveFit, ...]
    curve_check: StateCheck | None
    held_out: HeldOut | None
    modal_mass: Estimate
    interaction: Interaction | None
    warnings: tuple[str, ...]
    not_determined: str
    settings: Mapping[str, Any]
    read_files: tuple[ReadFile, ...] = ()

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The study, the modes, the logs and the curves, as they were when they were read."""
        return self.read_files

    @property
    def law(self) -> ResonanceLaw | None:
        """The law by most of the measurements: by all of them together, by the records, or by the curves."""
        return self.joint_law or self.records_law or self.curves_law

    @property
    def amplitude(self) -> FloatArray:
        """(n,) amplitude of the modal displacement of each level, m kg^1/2."""
        return np.array([each.amplitude for each in self.states])

    @property
    def resonance_hz(self) -> FloatArray:
        """(n,) frequency at which the mode is at phase resonance with this amplitude, Hz: corrected to quadrature."""
        return np.sqrt(np.maximum([each.stiffness for each in self.states], 0.0)) / (2.0 * np.pi)

    @property
    def damping_ratio(self) -> FloatArray:
        """(n,) effective damping ratio by the force at quadrature."""
        return np.array([each.damping for each in self.states]) / (4.0 * np.pi * self.resonance_hz)

    @property
    def phase_error_deg(self) -> FloatArray:
        """(n,) phase of the modal acceleration over the force, less 90 degrees."""
        return np.array([each.phase_error_deg for each in self.states])

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the coefficients by most of the measurements, then those by a part of them."""
        parts = (("records.", self.records_law), ("backbone.", self.backbone_law), ("curves.", self.curves_law))
        laws = (("", self.law), *((name, law) for name, law in parts if law is not self.law))
        return tuple(row for name, law in laws if law for row in coefficient_rows(law.stiffness, law.damping, name))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, which docs/schemas/resonance-1.schema.json describes."""
        done, found = self.appropriation, self.interaction
        return plain(
            {
                "schema": SCHEMA,
                **{
                    name: getattr(self, name) for name in ("title", "mode", "drive_point", "not_determined", "settings")
                },
                "levels": [
                    {
                        "test": test,
                        "start_s": start,
                        "stop_s": stop,
                        "voltage_v": level.voltage_v,
                        "driven_hz": level.frequency_hz,
                        "phase_error_deg": state.phase_error_deg,
                        "amplitude": state.amplitude,
                        "resonance_hz": hz,
                        "damping_ratio": zeta,
                        "force_n": np.abs(level.force),
                        "sensors": np.abs(level.sensors),
                        "modal": np.abs(level.modal),
                    }
                    for test, start, stop, level, state, hz, zeta in zip(
                        self.level_tests,
                        self.level_start_s,
                        self.level_stop_s,
                        done.levels if done else (),
                        self.states,
                        self.resonance_hz,
                        self.damping_ratio,
                        strict=True,
                    )
                ],
                "sensors": list(done.modes.sensors) if done else [],
                "left_out": self.left_out,
                **{
                    name: None if law is None else law.as_json()
                    for name, law in (
                        ("records_law", self.records_law),
                        ("backbone_law", self.backbone_law),
                        ("curves_law", self.curves_law),
                        ("joint_law", self.joint_law),
                    )
                },
                "curves": [each.as_json() for each in self.curve_fits],
                "curve_check": None if self.curve_check is None else asdict(self.curve_check),
                "held_out": None if self.held_out is None else self.held_out.as_json(),
                "modal_mass": asdict(self.modal_mass),
                "interaction": None if found is None else {name: getattr(found, name) for name in OF_INTERACTION},
                "linear_modes": {name: getattr(self.modes, name) for name in ("frequency_hz", "damping_ratio")},
                "warnings": self.warnings,
            }
        )

    def _write_headline(self) -> str:
        curves = f" and in {len(self.curve_fits)} response curves" if self.curve_fits else ""
        return f"{self.title}, mode {self.mode} at {len(self.states)} levels of phase resonance{curves}"


@dataclass(frozen=True, eq=False, repr=False)
class Resonances(Result):
    """Several modes in measured tests at phase resonance, and in response curves.

    Args:
        title: the title of the study.
        modes: the modes that could be read, by their number.
        faults: why each of the other modes could not be read, by its number.
        settings: what was asked for.
    """

    title: str
    modes: tuple[Resonance, ...]
    faults: Mapping[int, str]
    settings: Mapping[str, Any]

    @property
    def only(self) -> Resonance | None:
        """The only mode of the study; None where there are several."""
        return self.modes[0] if len(self.modes) == 1 and not self.faults else None

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The files of all modes, each once."""
        return tuple(dict.fromkeys(file for each in self.modes for file in each.files))

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings of all modes, each with its mode."""
        return tuple(f"mode {each.mode}: {text}" for each in self.modes for text in each.warnings)

    @property
    def not_determined(self) -> str:
        """Which modes have no law, and why; "" if all have one."""
        without = [(each.mode, each.not_determined) for each in self.modes if each.not_determined]
        return "; ".join(f"mode {number}: {reason}" for number, reason in sorted([*without, *self.faults.items()]))

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the numbers of each mode, with its number before their names."""
        return tuple(replace(row, name=f"mode_{each.mode}.{row.name}") for each in self.modes for row in each.summary())

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json: each mode as in docs/schemas/resonance-1.schema.json."""
        return plain(
            {
                "schema": OF_SEVERAL,
                "title": self.title,
                "modes": [each.to_dict() for each in self.modes],
                "faults": {str(number): reason for number, reason in self.faults.items()},
                "not_determined": self.not_determined,
                "warnings": self.warnings,
                "settings": self.settings,
            }
        )

    def _write_headline(self) -> str:
        return f"{self.title}, modes {list_names([str(each.mode) for each in self.modes])} at phase resonance"
