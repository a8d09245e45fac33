"""What a fit of all runs found, whatever method solved the equation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from opid.mechanics.laws.law import Law
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray


@dataclass(frozen=True, eq=False)
class JointFit:
    """A fit of one or several runs at once, per unit of the reference sprung mass.

    Args:
        names: parameter names in the order of `value`: "stiffness_per_mass" (1/s^2), "damping_per_mass" (1/s),
            "ground_stiffness_per_mass" (1/s^2), "law[i]" for entry i of `law.vector`, "inverse_mass" (1/kg).
        value: (n_parameters,).
        covariance: (n_parameters, n_parameters).
        law: the nonlinear law per unit of sprung mass.
        frequency_hz: one array (n_lines,) a run.
        residual: one complex array (n_lines,) a run, what the fit leaves over, as the white noise on each
            channel that would make it, m/s^2 (its mean square is `noise_m_per_s2` squared).
        noise_m_per_s2: white noise on each channel that would explain the residual, m/s^2.
        log_likelihood: up to a constant, with the noise at its estimate.
        n_data: real numbers fitted, end terms subtracted.
        n_evaluations: evaluations of the residual.
        band_hz: lowest and highest line, Hz.
    """

    names: tuple[str, ...]
    value: FloatArray
    covariance: FloatArray
    law: Law
    frequency_hz: tuple[FloatArray, ...]
    residual: tuple[ComplexArray, ...]
    noise_m_per_s2: float
    log_likelihood: float
    n_data: int
    n_evaluations: int
    band_hz: tuple[float, float]

    @property
    def std(self) -> FloatArray:
        """(n_parameters,) standard deviations."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0))

    @property
    def bic(self) -> float:
        """Bayesian information criterion (Schwarz 1978): smaller is better."""
        return float(len(self.value) * np.log(self.n_data) - 2 * self.log_likelihood)

    @property
    def error_rms(self) -> float:
        """What is left, as a search for laws takes it, m/s^2."""
        return self.noise_m_per_s2

    @property
    def laws(self) -> dict[str, Law]:
        """The law, as a search takes it."""
        return {"": self.law}

    @property
    def law_name(self) -> str:
        """Name of the law."""
        return self.law.name

    def __getitem__(self, name: str) -> float:
        """Value of the parameter called `name`; 0 where it was not fitted."""
        return float(self.value[self.names.index(name)]) if name in self.names else 0.0
