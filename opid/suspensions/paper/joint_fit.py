"""What a fit of all runs found, whatever method solved the equation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from opid.mechanics.laws import Law, Term
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.paper.settings import PaperSettings

# for opid.suspensions.laws, until it has settings of its own
BIC_MARGIN = PaperSettings.bic_margin


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

    def __getitem__(self, name: str) -> float:
        """Value of the parameter called `name`; 0 where it was not fitted."""
        return float(self.value[self.names.index(name)]) if name in self.names else 0.0


@dataclass(frozen=True, eq=False)
class LadderStep:
    """One law that was tried.

    Args:
        law_name: its name.
        fit: the joint fit of all runs.
        kept: whether the search went on from here.
        road: what proposed it: "pursuit", "sparse regression", "given" or "classical"; goes with `one_gear`.
        left_out_m_per_s2: what is left of a run that the others predict, as `JointFit.noise_m_per_s2`; None where it
            was not asked for; goes with `one_gear`.
    """

    law_name: str
    fit: JointFit
    kept: bool
    road: str = "classical"
    left_out_m_per_s2: float | None = None


def chosen(ladder: tuple[LadderStep, ...]) -> LadderStep:
    """Return the step that a search ended on.

    Args:
        ladder: of `search_law` or `pursue_law`.
    """
    return [step for step in ladder if step.kept][-1]


def alternatives(ladder: tuple[LadderStep, ...], *, bic_margin: float = PaperSettings.bic_margin) -> tuple[str, ...]:
    """Say which other laws of a ladder explain the runs as well as the chosen one, a sentence each.

    A law that is the chosen one and more besides is no alternative.

    Args:
        ladder: of `search_law` or `pursue_law`.
        bic_margin: criteria closer than this do not tell two laws apart.
    """
    best = chosen(ladder)
    mine = {term.name: term for term in best.fit.law.terms}
    found: dict[str, str] = {}
    for step in ladder:
        behind = step.fit.bic - best.fit.bic
        theirs = {term.name: term for term in step.fit.law.terms}
        gone = [term for name, term in mine.items() if name not in theirs]
        if behind > bic_margin or not gone or step.law_name in found:
            continue
        new = [term for name, term in theirs.items() if name not in mine]
        motions = sorted({_moved_by(term) for term in (*gone, *new)})
        what = " and ".join(_words(term) for term in new)
        found[step.law_name] = (
            f"{what} in place of {' and '.join(term.name for term in gone)} explains the runs as well (BIC "
            f"{behind:+.0f}): the visited {' and '.join(motions)} do not tell them apart"
            if new
            else f"the runs are explained as well without {' and '.join(term.name for term in gone)} (BIC "
            f"{behind:+.0f}): the visited {' and '.join(motions)} do not show it"
        )
    return tuple(found.values())


def _moved_by(term: Term) -> str:
    """What the force of a term depends on, by its name in a sentence."""
    travel, velocity = np.linspace(-1e-2, 1e-2, 21), np.linspace(-0.1, 0.1, 21)
    by_travel, by_velocity = Law((Term(term.name, (1.0, *term.inner)),)).gradient(travel, velocity)
    if np.any(by_travel) and np.any(by_velocity):
        return "motions"
    return "velocities" if np.any(by_velocity) else "travels"


def _words(term: Term) -> str:
    inner = [f"{value:.3g} {p.unit}" for p, value in zip(term.kind.parameters[1:], term.inner, strict=True)]
    return f"{term.name} ({', '.join(inner)})" if inner else term.name
