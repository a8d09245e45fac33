"""The law of a mode from its free decays as a record."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import NotDeterminedError
from opid.estimate import Estimate
from opid.mechanics.laws.law import Law
from opid.modal.decay.slow_flow import CloseModes
from opid.modal.joint_terms import JointEstimates, ModalJoint
from opid.modal.power_laws import coefficients_json, make_fitted_law
from opid.signals.recording import FloatArray


class CloseModesError(NotDeterminedError):
    """Two close linear modes explain a decay, and no law of one mode does so as well."""

    def __init__(self, message: str, modes: CloseModes) -> None:
        super().__init__(message)
        self.modes = modes


@dataclass(frozen=True, eq=False)
class DecayLaw:
    """The restoring force of a mode from its free decays, without any measured force.

    The joint loses energy as `JointTerms` says. Where several decays were pooled, k0 and c0 belong to their mean, and
    `frequency_scatter_hz` and `damping_scatter` tell how far one repeat lies from it.

    Args:
        stiffness: k_n by its power n, where 1 is k0: force per unit mass (or modal force) over displacement^n.
        damping: c_n by its power n, where 1 is c0: force per unit mass (or modal force) over velocity^n.
        joint_estimates: friction and the joint with memory.
        frequency_low_hz: natural frequency at zero amplitude, Hz; empty where the decays do not reach so far.
        damping_low: damping ratio at zero amplitude; empty likewise, with dry friction, where it grows without end,
            and where the law is of another kind than the true one.
        frequency_scatter_hz: standard deviation of that frequency between repeats, Hz; 0 for one decay.
        damping_scatter: standard deviation of the damping ratio between repeats; 0 for one decay.
        amplitude: (n,) displacement amplitudes within those of the decays.
        frequency_hz: (n,) natural frequency at these amplitudes, Hz.
        damping_ratio: (n,) damping ratio at these amplitudes.
        frequency_std_hz: (n,) standard deviation of that frequency, Hz; nan where the law has no interval.
        damping_std: (n,) standard deviation of that damping ratio, likewise.
        covariance: covariance of k0, k_2 ..., c0, c_2 ..., F, R, chi or the values of the joint in this order.
        misfit: rms error of amplitude and phase over its standard deviation; noise alone gives 1.
        phase_error: rms error of phase, rad, and of relative amplitude.
        warnings: one sentence for each warning about the law.
        close_modes: two close linear modes that explain the decays as well, so that the law has no interval; None where
            it explains them better.
    """

    stiffness: dict[int, Estimate]
    damping: dict[int, Estimate]
    joint_estimates: JointEstimates
    frequency_low_hz: Estimate
    damping_low: Estimate
    frequency_scatter_hz: float
    damping_scatter: float
    amplitude: FloatArray
    frequency_hz: FloatArray
    damping_ratio: FloatArray
    frequency_std_hz: FloatArray
    damping_std: FloatArray
    covariance: FloatArray
    misfit: float
    phase_error: float
    warnings: tuple[str, ...]
    close_modes: CloseModes | None = None

    @property
    def law(self) -> Law:
        """The nonlinear restoring force of the powers 2 and up, per unit mass, without friction and slip."""
        return make_fitted_law(self.stiffness, self.damping)

    @property
    def joint(self) -> ModalJoint:
        """The joint, ready to be simulated."""
        return self.joint_estimates.make(float(self.amplitude.max()))

    def curves_at(self, amplitude: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return natural frequency, Hz, and damping ratio at displacement amplitudes, (n,) each.

        Beyond the amplitudes of the decays, where powers become unstable, the values at the nearest end are held.
        """
        at = np.asarray(amplitude, dtype=np.float64)
        return np.interp(at, self.amplitude, self.frequency_hz), np.interp(at, self.amplitude, self.damping_ratio)

    def joint_json(self) -> dict[str, Any]:
        """Return friction, slip, a named joint and scatter as result.json holds them."""
        return {
            **self.joint_estimates.as_json(),
            "frequency_scatter_hz": self.frequency_scatter_hz,
            "damping_scatter": self.damping_scatter,
        }

    def as_json(self) -> dict[str, Any]:
        """Return the law as result.json holds it."""
        return {
            **coefficients_json(self.stiffness, self.damping),
            "joint": self.joint_json(),
            "frequency_low_hz": asdict(self.frequency_low_hz),
            "damping_low": asdict(self.damping_low),
            **{name: getattr(self, name) for name in ("amplitude", "frequency_hz", "damping_ratio")},
            **{name: getattr(self, name) for name in ("frequency_std_hz", "damping_std", "misfit")},
            "warnings": self.warnings,
        }


def withhold_intervals(law: DecayLaw) -> DecayLaw:
    """Return a law without intervals."""
    unknown = np.full(law.amplitude.size, np.nan)
    return replace(
        law,
        joint_estimates=law.joint_estimates.with_estimates(Estimate.without_interval),
        frequency_low_hz=law.frequency_low_hz.without_interval(),
        damping_low=law.damping_low.without_interval(),
        stiffness={power: each.without_interval() for power, each in law.stiffness.items()},
        damping={power: each.without_interval() for power, each in law.damping.items()},
        frequency_std_hz=unknown,
        damping_std=unknown,
    )
