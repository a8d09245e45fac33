"""What the identification of a nonlinear modal model found: records, nothing computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from opid.estimate import Estimate
from opid.mechanics.laws.law import Law
from opid.modal.decay.fit import DecayLaw
from opid.modal.decay.free_decay import Decay
from opid.modal.linear.level_shifts import LevelShift
from opid.modal.linear.modes import LinearModes, ModalTest
from opid.modal.model import NonlinearModalModel
from opid.modal.power_laws import coefficient_rows, fitted_power_law
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import FloatArray, Recording

SCHEMA = "opid.modal/1"


@dataclass(frozen=True, eq=False)
class ForceCurve:
    """The nonlinear part of a modal restoring force over displacement or velocity, with its 95 % band.

    Args:
        position: (n,) q, m kg^1/2, or q', m/s kg^1/2, from 0 to the largest of the tests.
        force: (n,) N/kg^1/2, without the linear part.
        low: (n,) lower end of the band.
        high: (n,) upper end.
        linear: (n,) k0 q or c0 q', what the nonlinear part stands beside.
    """

    position: FloatArray
    force: FloatArray
    low: FloatArray
    high: FloatArray
    linear: FloatArray


@dataclass(frozen=True)
class OrderRung:
    """One pair of orders that was tried.

    Args:
        stiffness_order: N_s.
        damping_order: N_d.
        error: misfit of the tests that were left out, share of the modal force (rms).
        error_std: standard error of that, from test to test.
        chosen: whether it is the one.
    """

    stiffness_order: int
    damping_order: int
    error: float
    error_std: float
    chosen: bool


@dataclass(frozen=True, eq=False)
class ModeFit:
    """The restoring force of one mode.

    Args:
        mode: number of the mode, from 1.
        frequency_hz: linear natural frequency as given, Hz.
        damping_ratio: linear damping ratio as given.
        stiffness_order: N_s.
        damping_order: N_d.
        free_linear: whether k0 and c0 were corrected (the powers 1).
        stiffness: k_n by its power n, (N/kg^1/2) / (m kg^1/2)^n; 1 is the correction of k0.
        damping: c_n by its power n, (N/kg^1/2) / (m/s kg^1/2)^n; 1 is the correction of c0.
        band_hz: lines that were fitted, Hz.
        n_lines: number of them in all tests.
        tests: names of the tests.
        residual_share: rms of the misfit over that of the modal force, in the band.
        condition_raw: condition number of the columns as they are.
        condition_scaled: and scaled to unit norm, as they are solved.
        modal_mass: mass that the tests show for the mode, 1 where shapes and force are in order.
        stiffness_curve: nonlinear stiffness force over displacement.
        damping_curve: nonlinear damping force over velocity.
        frequency_at_hz: natural frequency at the amplitudes of `stiffness_curve`, Hz (harmonic linearisation).
        damping_at: damping ratio at the same amplitudes.
        orders: the orders that were tried, if they were searched.
        warnings: what to doubt.
    """

    mode: int
    frequency_hz: float
    damping_ratio: float
    stiffness_order: int
    damping_order: int
    free_linear: bool
    stiffness: Mapping[int, Estimate]
    damping: Mapping[int, Estimate]
    band_hz: tuple[float, float]
    n_lines: int
    tests: tuple[str, ...]
    residual_share: float
    condition_raw: float
    condition_scaled: float
    modal_mass: Estimate
    stiffness_curve: ForceCurve
    damping_curve: ForceCurve
    frequency_at_hz: FloatArray
    damping_at: FloatArray
    orders: tuple[OrderRung, ...]
    warnings: tuple[str, ...]

    @property
    def law(self) -> Law:
        """The nonlinear restoring force, powers 2 and up."""
        return fitted_power_law(self.stiffness, self.damping)


@dataclass(frozen=True)
class Comparison:
    """One sensor of a truth test.

    Args:
        peak_ratio_nonlinear: largest acceleration of the nonlinear model over the measured one.
        peak_ratio_linear: likewise of the linear model.
        nrmse_nonlinear: rms of the error over the rms of the measurement.
        nrmse_linear: likewise of the linear model.
    """

    peak_ratio_nonlinear: float
    peak_ratio_linear: float
    nrmse_nonlinear: float
    nrmse_linear: float


@dataclass(frozen=True, eq=False)
class TruthTest:
    """A test that no fit has seen, beside what the models make of its force.

    Args:
        name: of the test.
        band_hz: what is compared, Hz; None for all of it.
        measured: accelerations at the sensors, m/s^2.
        nonlinear: those of the nonlinear modal model, the same channels.
        linear: those of the linear model.
        sensors: the figures, by the name of the sensor.
    """

    name: str
    band_hz: tuple[float, float] | None
    measured: Recording
    nonlinear: Recording
    linear: Recording
    sensors: Mapping[str, Comparison]


@dataclass(frozen=True, eq=False, repr=False)
class ModalIdentification(Result):
    """A nonlinear modal model with what it rests on.

    Args:
        title: of the study.
        modes: the linear modes.
        drive_point: the sensor at whose place the force acts; None where no test has a force.
        tests: all tests, in modal coordinates.
        fits: one a nonlinear mode.
        model: the nonlinear modal model.
        truth_tests: tests that no fit has seen.
        decays: free decays, with the amplitude-dependent frequency and damping they show.
        shifts: how frequency and damping of each mode move with the level, where tests were recorded for that.
        condition_number: of the shapes.
        auto_mac: (n_modes, n_modes) modal assurance criterion of the shapes against each other.
        warnings: what to doubt.
        not_determined: why there is no answer, "" if there is one.
        settings: what it was made with.
        decay_laws: the law that the free decays of a mode give together, by the number of the mode; the model has it
            where no forced test moves the mode.
    """

    title: str
    modes: LinearModes
    drive_point: str | None
    tests: tuple[ModalTest, ...]
    fits: tuple[ModeFit, ...]
    model: NonlinearModalModel
    truth_tests: tuple[TruthTest, ...]
    decays: tuple[Decay, ...]
    shifts: tuple[LevelShift, ...]
    condition_number: float
    auto_mac: FloatArray
    warnings: tuple[str, ...]
    not_determined: str
    settings: Mapping[str, Any]
    decay_laws: Mapping[int, DecayLaw] = field(default_factory=dict)

    @property
    def modes_by_decays_alone(self) -> list[int]:
        """The modes that no forced test moves and whose law comes from their free decays."""
        fitted = {fit.mode for fit in self.fits}
        return [mode for mode in sorted(self.decay_laws) if mode not in fitted]

    @property
    def all_warnings(self) -> list[str]:
        """All warnings, those of modes, decays and their laws last, each once."""
        of_fits = [text for fit in self.fits for text in fit.warnings]
        # worded as by `identify_modes`, which tells them too
        of_decays = [
            (f"free decay {decay.name!r} of mode {decay.mode}: ", decay.mode, text)
            for decay in self.decays
            for text in decay.warnings
        ]
        of_laws = [
            (f"the free decays of mode {mode} together: {text}", (mode, text) in [each[1:] for each in of_decays])
            for mode, law in sorted(self.decay_laws.items())
            for text in law.warnings
        ]
        # the law of a single decay has that decay's warnings
        of_laws_alone = {text for text, twice in of_laws if twice}
        every = [
            *self.warnings,
            *of_fits,
            *(head + text for head, _, text in of_decays),
            *(text for text, _ in of_laws),
        ]
        return [text for text in dict.fromkeys(every) if text not in of_laws_alone]

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the coefficients of each nonlinear mode; k1 and c1 of free decays are k0 and c0 themselves."""
        laws = [(f"mode_{fit.mode}.", fit.stiffness, fit.damping) for fit in self.fits]
        laws += [(f"mode_{n}.decays.", law.stiffness, law.damping) for n, law in sorted(self.decay_laws.items())]
        return tuple(row for name, k, c in laws for row in coefficient_rows(k, c, name))

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The logs of the tests, as they were when they were read."""
        return tuple(file for test in self.tests for file in test.recording.files)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, see `opid.modal.as_json.modal_json`."""
        from opid.modal.as_json import modal_json

        return modal_json(self)

    def _headline(self) -> str:
        nonlinear = ", ".join(str(fit.mode) for fit in self.fits) or "none"
        return f"{self.title or 'without a title'} ({self.modes.n_modes} modes, nonlinear by forced tests: {nonlinear})"
