"""The law of a mode from its response curves, what speaks against it, and the curves that a law makes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from opid.errors import NotDeterminedError
from opid.estimate import Estimate
from opid.mechanics.structure import ComplexArray
from opid.modal.forced.mode_fit import UNITS
from opid.modal.linear.modes import LinearModes
from opid.modal.resonance.curves import ResponseCurve, read_curve_states
from opid.modal.resonance.driven_curve import CurveResonance, DrivenCurve, find_resonance
from opid.modal.resonance.law import (
    Equations,
    ResonanceLaw,
    explain_phase,
    find_columns,
    find_group_covariance,
    fit_states,
)
from opid.modal.resonance.settings import ResonanceSettings
from opid.modal.resonance.steady import SteadyState
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray

BEYOND = 1.5  # largest amplitude at which a law makes motions, over the largest that it was fitted to


@dataclass(frozen=True, eq=False)
class CurveFit:
    """A response curve beside the one that a law makes of the same forces.

    Args:
        curve: the measured curve.
        response: (n,) complex acceleration of the sensor by the law, m/s^2; of several motions that the law allows at a
            frequency the one nearest to the measured one; NaN where it has none up to 1.5 times its largest amplitude.
        is_prediction: whether the law is that of other measurements, without any of the curves.
        resonance: where the measured curve is at phase resonance; None where no point is near it, or there is no law.
    """

    curve: ResponseCurve
    response: ComplexArray
    is_prediction: bool
    resonance: CurveResonance | None = None

    @classmethod
    def without_law(cls, curve: ResponseCurve) -> CurveFit:
        """Return a curve for which there is no law."""
        return cls(curve, np.full(curve.frequency_hz.size, np.nan, dtype=np.complex128), False)

    @property
    def error(self) -> float:
        """Rms of the difference over the rms of the measured acceleration, where the law has a motion.

        Where a curve turns over, a small difference of frequency makes a large one of amplitude.
        """
        has = np.isfinite(self.response)
        if not has.any():
            return float("nan")
        left = np.abs(self.response - self.curve.acceleration)[has]
        return float(np.sqrt(np.mean(left**2) / np.mean(self.curve.amplitude[has] ** 2)))

    @property
    def peak_ratio(self) -> float:
        """Largest amplitude by the law over the largest measured one; NaN where the law has no motion."""
        has = np.isfinite(self.response)
        return float(np.abs(self.response[has]).max() / self.curve.amplitude.max()) if has.any() else float("nan")

    def as_json(self) -> dict[str, Any]:
        """Return the curve as result.json holds it."""
        return {
            "name": self.curve.name,
            "sensor": self.curve.sensor,
            "frequency_hz": self.curve.frequency_hz,
            "force_n": self.curve.force_n,
            "amplitude": self.curve.amplitude,
            "phase_deg": self.curve.phase_deg,
            "amplitude_by_law": np.abs(self.response),
            "phase_by_law_deg": np.degrees(np.angle(self.response)),
            "is_prediction": self.is_prediction,
            "error": self.error,
            "peak_ratio": self.peak_ratio,
            "resonance": None if self.resonance is None else asdict(self.resonance),
        }


@dataclass(frozen=True)
class StateCheck:
    """What motions at many frequencies show beside a law, if it is left free.

    Args:
        inertia: inertia of the mode, 1 where force, motion and shape have their right units.
        lag: rate of the frequency that would make the motions lag behind it, rad/s^2; 0 where each is steady.
    """

    inertia: Estimate
    lag: Estimate


@dataclass(frozen=True, eq=False)
class CurvesLaw:
    """What several response curves of one mode give together.

    Args:
        states: the motions that count.
        law: the law; None where the curves do not determine it.
        check: inertia and rate of the frequency that the curves show; None where there are too few motions.
        reason: why there is no law, "" if there is one.
    """

    states: tuple[SteadyState, ...]
    law: ResonanceLaw | None
    check: StateCheck | None
    reason: str


def fit_curves(
    curves: Sequence[ResponseCurve],
    *,
    modes: LinearModes,
    mode: int,
    drive_point: str,
    stiffness_order: int | None = None,
    damping_order: int | None = None,
    settings: ResonanceSettings | None = None,
) -> CurvesLaw:
    """Fit the law of a mode to its response curves at several levels, and look for what speaks against them.

    The inertia of the mode is 1 if force, motion and shape have the units that are stated, and a motion that is steady
    at each frequency does not lag behind it. Both are fitted once more beside the law; if one of them is off, the law
    is withheld.

    Args:
        curves: the curves.
        modes: linear modes of the structure.
        mode: number of the mode, from 1.
        drive_point: the sensor where the force acts.
        stiffness_order: N_s, 1 to 5; chosen where None.
        damping_order: N_d, 1 to 5; chosen where None.
        settings: which points count; the usual ones where left out.

    Raises:
        InputError: what `read_curve_states` refuses.
    """
    chosen = settings or ResonanceSettings()
    each = [
        read_curve_states(curve, modes=modes, mode=mode, drive_point=drive_point, settings=chosen) for curve in curves
    ]
    states = tuple(state for several in each for state in several)
    try:
        law = fit_states(
            states,
            chosen,
            stiffness_order=stiffness_order,
            damping_order=damping_order,
            measured_waves=False,
            is_grouped=True,
        )
    except NotDeterminedError as error:
        return CurvesLaw(states, None, None, str(error))
    slopes = np.concatenate([_find_slope(several, chosen) for several in each])
    check = check_states(states, slopes, law)
    reason = _find_contradiction(check, modes, mode, chosen) or explain_phase(law, chosen)
    return CurvesLaw(states, None if reason else law, check, reason)


def _find_slope(states: Sequence[SteadyState], settings: ResonanceSettings) -> ComplexArray:
    """Return the change of the complex amplitude over itself with the frequency, s/rad, along the drive."""
    omega = np.array([each.pole.imag for each in states])
    if omega.size < 2:
        return np.zeros(omega.size, dtype=np.complex128)
    q = np.array([each.displacement[0] / each.force for each in states])
    step, change = np.abs(np.diff(omega)), np.log(q[1:] / q[:-1])
    # A jump is no slope, and neither is the step to a part of the curve that was left out.
    smooth = (step > 0.0) & (np.abs(change) < settings.largest_jump)
    slope = np.where(smooth, change / np.where(step > 0.0, step, 1.0), 0.0)
    before, after = np.concatenate([[0.0], slope]), np.concatenate([slope, [0.0]])
    n = np.concatenate([[0], smooth.astype(int)]) + np.concatenate([smooth.astype(int), [0]])
    return np.asarray((before + after) / np.maximum(n, 1), dtype=np.complex128)


def _find_contradiction(check: StateCheck, modes: LinearModes, mode: int, settings: ResonanceSettings) -> str:
    """Return why curves do not give a law although their motions do, "" if nothing speaks against it."""
    inertia, std = float(check.inertia.value or 0.0), float(check.inertia.std or 0.0)
    rate, rate_std = float(check.lag.value or 0.0), float(check.lag.std or 0.0)
    bandwidth = 0.5 * float(modes.damping()[modes.index(mode)])
    is_off = abs(inertia - 1.0) > max(MODAL.warned_mass, settings.hidden_sigma * std)
    is_late = rate > max(settings.hidden_sigma * rate_std, settings.most_lag * bandwidth**2)
    # A motion never runs ahead of its drive. One that lags shows a wrong inertia, too, but none of another unit.
    if is_off and not (is_late and MODAL.mass_range[0] < inertia < MODAL.mass_range[1]):
        return describe_wrong_mass(inertia, "the response curves show", mode, settings)
    if is_late:
        return (
            "the motions of the response curves lag behind the frequency, as in a sweep of "
            f"{rate / (2.0 * np.pi):.2g} Hz/s: wait at each frequency until the amplitude stands still, some "
            f"{4.0 / bandwidth:.2g} s"
        )
    return ""


def describe_wrong_mass(inertia: float, who: str, mode: int, settings: ResonanceSettings) -> str:
    """Return a clause on a modal mass that is not 1, with the unit that would make it so where there is one.

    Args:
        inertia: the modal mass.
        who: what shows it, and the verb.
        mode: number of the mode, from 1.
        settings: how near to a unit it must be.
    """
    near = (name for name, factor in UNITS.items() if abs(inertia / factor - 1) < settings.near_unit)
    unit = next((f" ({name} would give this)" for name in near), "")
    return (
        f"{who} a modal mass of {inertia:.3g} where mass-normalised shapes and the stated units give 1{unit}: check "
        f"the units of amplitude and force, and the shape of mode {mode} at both"
    )


def make_curve(
    law: ResonanceLaw,
    curve: ResponseCurve,
    *,
    modes: LinearModes,
    mode: int,
    drive_point: str,
    is_prediction: bool = True,
) -> CurveFit:
    """Return what a law makes of the forces of a response curve, the other modes by their linear properties.

    At each amplitude a of the mode harmonic balance of its fundamental leaves (k(a) - omega^2)^2 + (omega c(a))^2 =
    (F / a)^2, from which a follows; a may have three values.

    Args:
        law: the law.
        curve: frequencies and forces, and the measured motion, which tells which of several motions is meant.
        modes: linear modes of the structure.
        mode: number of the mode, from 1.
        drive_point: the sensor where the force acts.
        is_prediction: whether the law is that of other measurements.

    Raises:
        InputError: no such mode or sensor.
    """
    driven = DrivenCurve.of(curve, modes, mode, drive_point)
    most = BEYOND * float(law.amplitude.max())
    settings = ResonanceSettings()
    states = read_curve_states(curve, modes=modes, mode=mode, drive_point=drive_point, settings=settings)
    shape = float(np.abs(driven.shape))
    resonance = find_resonance(states, law.candidates[0], curve.error_fraction, shape, settings)
    is_near = min(abs(each.phase_error_deg) for each in states) < settings.near_deg
    response = driven.find_response(law.candidates[0], most, driven.measured)
    return CurveFit(curve, response, is_prediction, resonance if is_near else None)


def warn_of_extrapolation(
    law: ResonanceLaw, curves: Sequence[ResponseCurve], *, modes: LinearModes, mode: int, drive_point: str
) -> Iterator[str]:
    """Warn of response curves that move a mode beyond the levels that its law was fitted to."""
    for curve in curves:
        reached = DrivenCurve.of(curve, modes, mode, drive_point).measured.max()
        times = float(reached / law.amplitude.max())
        if times > MODAL.extrapolated:
            yield (
                f"response curve {curve.name!r} moves mode {mode} {times:.2g} times as far as the levels that its law "
                "was fitted to: the curve by this law is an extrapolation there; hold a level of this motion"
            )


def scale_shapes(
    curves: Sequence[ResponseCurve],
    *,
    modes: LinearModes,
    mode: int,
    drive_point: str,
    settings: ResonanceSettings | None = None,
) -> tuple[LinearModes, Estimate]:
    """Return the modes with the shape of one scaled so that the curves show a modal mass of 1, and that mass before.

    For shapes whose scale nobody knows. The motions at many frequencies tell inertia from stiffness.

    Args:
        curves: the curves.
        modes: linear modes of the structure.
        mode: number of the mode, from 1.
        drive_point: the sensor where the force acts.
        settings: which points count; the usual ones where left out.

    Raises:
        InputError: what `read_curve_states` refuses.
        NotDeterminedError: the curves do not tell it.
    """
    chosen, index, mass = settings or ResonanceSettings(), modes.index(mode), 1.0
    for _ in range(chosen.most_mass_steps):
        each = [
            read_curve_states(curve, modes=modes, mode=mode, drive_point=drive_point, settings=chosen)
            for curve in curves
        ]
        states = [state for several in each for state in several]
        law = fit_states(states, chosen, measured_waves=False, is_grouped=True)
        slopes = np.concatenate([_find_slope(several, chosen) for several in each])
        check = check_states(states, slopes, law, is_grouped=True)
        value, std = float(check.inertia.value or 0.0), float(check.inertia.std or 0.0)
        if value < chosen.hidden_sigma * std:
            raise NotDeterminedError(
                f"the response curves do not tell the modal mass of mode {mode} ({value:.3g}, standard deviation "
                f"{std:.2g}): give curves over a wider range of frequencies, or mass-normalised shapes"
            )
        mass *= value
        shapes = modes.shapes.copy()
        shapes[:, index] /= np.sqrt(value)
        modes = replace(modes, shapes=shapes)
        if abs(value - 1.0) < chosen.mass_converged:
            break
    return modes, Estimate.normal(mass, mass * std)


# ---- what motions show beside a law -------------------------------------------------------------------------


def check_states(
    states: Sequence[SteadyState], slope: ComplexArray, law: ResonanceLaw, *, is_grouped: bool = False
) -> StateCheck:
    """Fit the powers of a law once more, with the inertia and the rate of the frequency free.

    In a sweep the motion Re A(omega) exp(j phi) has the velocity (A' rate + j omega A), so the equation of the mode
    gets the term 2 j omega rate A'/A beside p^2.

    Args:
        states: the motions.
        slope: (n,) change of the complex amplitude over itself with the frequency, s/rad, counted positive in the
            direction in which the frequency was driven; zero where it is not known.
        law: the law that they gave.
        is_grouped: whether motions of one source share errors, as the points of a response curve do.
    """
    equations, chosen = _list_columns(states, law, is_grouped=is_grouped)
    lagging = 2j * np.array([each.pole.imag for each in states]) * slope / equations.scale
    value, std = _solve_columns([*chosen, 1j * equations.force, equations.inertia, lagging], equations.left, equations)
    return StateCheck(Estimate.normal(1.0 + value[-2], std[-2]), Estimate.normal(value[-1], std[-1]))


def find_inertia_range(states: Sequence[SteadyState], law: ResonanceLaw) -> tuple[Estimate, Estimate]:
    """Return the least and the largest inertia of the mode that motions show beside a law.

    The frequency of a motion has an error, too. What it moves is mistaken for inertia, which draws the inertia to 0
    where the equation is solved for the force; solved for the frequency it is drawn to infinity by errors of the force.
    The truth lies between the two (Frisch 1934). Levels at quadrature alone leave that range open: a stiffness that
    depends on the amplitude explains all of their frequencies, whatever the inertia is.
    """
    equations, chosen = _list_columns(states, law)
    turned = 1j * equations.force
    value, std = _solve_columns([*chosen, turned, equations.inertia], equations.left, equations)
    inverse, of_inverse = _solve_columns([*chosen, turned, equations.force], equations.inertia, equations)
    least = Estimate.normal(1.0 + value[-1], std[-1])
    share = float(inverse[-1])
    return least, Estimate.normal(1.0 / share, float(of_inverse[-1]) / share**2) if share > 0.0 else Estimate()


def _list_columns(
    states: Sequence[SteadyState], law: ResonanceLaw, *, is_grouped: bool = False
) -> tuple[Equations, list[ComplexArray]]:
    """Return the equations of the motions, and the columns of the powers of a law over their scale."""
    equations = Equations.of(states, (0.0, 1.0, 0.0), is_grouped=is_grouped)
    columns = find_columns(states, [each.displacement[:1] for each in states])
    chosen = [columns[0][:, n - 1] for n in law.stiffness] + [columns[1][:, n - 1] for n in law.damping]
    return equations, [each / equations.scale for each in chosen]


def _solve_columns(
    columns: Sequence[ComplexArray], left_side: ComplexArray, equations: Equations
) -> tuple[FloatArray, FloatArray]:
    """Return the values of some columns by least squares, and their standard deviations by what they leave."""
    whole, weights = np.column_stack(columns), np.tile(equations.std[0], 2)
    rows = np.vstack([whole.real, whole.imag]) / weights[:, None]
    left = np.concatenate([left_side.real, left_side.imag]) / weights
    norms = np.maximum(np.linalg.norm(rows, axis=0), np.finfo(float).tiny)
    inverse = np.linalg.pinv(rows / norms, rcond=1e-12)
    value = inverse @ left / norms
    freedom = max(left.size - value.size, 1)
    ratio = max(float(np.sqrt(np.sum((left - rows @ value) ** 2) / freedom)), 1.0)
    std = ratio * np.sqrt(np.sum(inverse**2, axis=1)) / norms
    return value, np.hypot(std, np.sqrt(np.diag(find_group_covariance(rows, left, equations.groups))))
