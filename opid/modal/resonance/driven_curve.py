"""Where a response curve is at phase resonance, and the motion that a law makes of its forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.mechanics.backbones.harmonic_balance import first_harmonic_factor
from opid.mechanics.structure import ComplexArray
from opid.modal.linear.modes import LinearModes
from opid.modal.resonance.curves import ResponseCurve, add_other_modes
from opid.modal.resonance.law import LawCandidate
from opid.modal.resonance.settings import ResonanceSettings
from opid.modal.resonance.steady import SteadyState
from opid.signals.recording import FloatArray

N_AMPLITUDES = 2000  # at which the equation of the mode is solved; a root between two of them is interpolated
FEWEST_NEAR = 3  # points of a curve near quadrature through which a line is drawn


@dataclass(frozen=True)
class CurveResonance:
    """Where a measured curve is at phase resonance.

    Args:
        hz: frequency, Hz.
        hz_std: standard deviation of it by the noise of the point nearest to quadrature, Hz.
        amplitude: amplitude of the mode, m kg^1/2.
        force: modal force there, N/kg^1/2.
        motion: amplitude of the displacement of the sensor by the shape of the mode, m.
        hz_std_at_motion: standard deviation of the frequency as one of this motion, Hz: the noise of the amplitude
            counts, too, by the slope of the law.
    """

    hz: float
    hz_std: float
    amplitude: float
    force: float
    motion: float
    hz_std_at_motion: float


@dataclass(frozen=True, eq=False)
class DrivenCurve:
    """The forces of a response curve on one mode, and what all other modes add to its sensor."""

    omega: FloatArray  # (n,) rad/s
    shape: float  # of the mode at the sensor
    force: FloatArray  # (n,) modal force, N/kg^1/2
    others: ComplexArray  # (n,) m/s^2
    measured: FloatArray  # (n,) amplitude of the mode, m kg^1/2

    @classmethod
    def of(cls, curve: ResponseCurve, modes: LinearModes, mode: int, drive_point: str) -> DrivenCurve:
        """Return the force of `curve` on a mode, by its number from 1, and what the other modes add to its sensor."""
        index, omega = modes.index(mode), 2.0 * np.pi * curve.frequency_hz
        shape, push = float(modes.row(curve.sensor)[index]), float(modes.row(drive_point)[index])
        others = add_other_modes(curve, modes, mode, drive_point)
        measured = np.abs((curve.acceleration - others) / (omega**2 * shape))
        return cls(omega, shape, push * curve.force_n, others, measured)

    def find_response(self, law: LawCandidate, most: float, near: FloatArray) -> ComplexArray:
        """Return the acceleration of the sensor by a law, of several motions that nearest to an amplitude, (n,).

        Args:
            law: the law.
            most: the largest amplitude of the mode that is searched; where there is no motion up to it, NaN.
            near: (n,) the amplitude of the mode that is meant.
        """
        # The measured force is turned against what moves the mode.
        force = self.force * np.exp(-1j * law.phase_rad)
        a = np.linspace(0.0, most, N_AMPLITUDES + 1)[1:]
        response = np.full(self.omega.size, np.nan, dtype=np.complex128)
        for at, omega in enumerate(self.omega.tolist()):
            excess = a * np.abs(law.find_dynamic_stiffness(a, omega)) - abs(force[at])
            left = np.flatnonzero((excess[:-1] < 0.0) != (excess[1:] < 0.0))
            if left.size:
                part = excess[left] / (excess[left] - excess[left + 1])
                roots = a[left] + part * (a[left + 1] - a[left])
                root = roots[[np.argmin(np.abs(roots - near[at]))]]
                q = force[at] / law.find_dynamic_stiffness(root, omega)[0]
                response[at] = -(omega**2) * self.shape * q + self.others[at]
        return response


def find_resonance(
    states: Sequence[SteadyState], law: LawCandidate, error: float, shape: float, settings: ResonanceSettings
) -> CurveResonance | None:
    """Return the resonance of a curve by its points near quadrature; None where they show no stiffness.

    Each of them gives the frequency at its own amplitude, which is a little below that at resonance: a line over the
    square of the amplitude leads there. Where the amplitudes are too few or too alike, the nearest point stands alone.
    """
    turned = [replace(each, force=each.force * np.exp(-1j * law.phase_rad)) for each in states]
    near = min(turned, key=lambda each: abs(each.phase_error_deg))
    if near.stiffness <= 0.0:
        return None
    omega = float(np.sqrt(near.stiffness))
    std = error * abs(near.receptance_inverse) / (4.0 * np.pi * omega)
    pull = omega * near.damping
    amplitude = abs(near.force) / pull if pull > 0.0 else near.amplitude
    close = [each for each in turned if abs(each.phase_error_deg) < settings.near_deg]
    square = np.array([each.amplitude**2 for each in close])
    hz = omega / (2.0 * np.pi)
    if square.size >= FEWEST_NEAR and square.max() > settings.least_line * square.min():
        of_points = np.sqrt(np.maximum([each.stiffness for each in close], 0.0)) / (2.0 * np.pi)
        hz = float(np.polyfit(square / amplitude**2 - 1.0, of_points, 1)[1])
    ends = law.find_dynamic_stiffness(amplitude * np.array([1.0, 1.0 + error]), 0.0).real
    change = float(np.diff(np.sqrt(np.maximum(ends, 0.0)))[0]) / (2.0 * np.pi)
    return CurveResonance(
        hz=hz,
        hz_std=std,
        amplitude=float(amplitude),
        force=float(abs(near.force)),
        motion=float(amplitude * shape),
        hz_std_at_motion=float(np.hypot(std, change)),
    )


def find_law_resonance(law: LawCandidate, force: float, most: float) -> tuple[float, float]:
    """Return frequency, Hz, and amplitude at which a law is at phase resonance under a modal force.

    Both are NaN where there is none up to the amplitude `most`.
    """
    a = np.linspace(0.0, most, N_AMPLITUDES + 1)[1:]
    square = law.find_dynamic_stiffness(a, 0.0).real
    omega = np.sqrt(np.maximum(square, np.finfo(float).tiny))
    c = sum(value * first_harmonic_factor(n) * (omega * a) ** (n - 1) for n, value in law.damping.items())
    pull = omega * c * a
    reached = np.flatnonzero((pull >= force) & (square > 0.0))
    if not reached.size or (square[: reached[0] + 1] <= 0.0).any():
        return float("nan"), float("nan")
    at = slice(max(reached[0] - 1, 0), reached[0] + 1)
    amplitude = float(np.interp(force, pull[at], a[at]))
    return float(np.interp(amplitude, a, omega)) / (2.0 * np.pi), amplitude
