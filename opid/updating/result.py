"""What Bayesian updating found: records, nothing computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from opid.estimate import Estimate
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.laws.kinds import LAWS
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import FloatArray
from opid.updating.data.measured import MeasuredBackbone
from opid.updating.model_class import ModelClass
from opid.updating.sampling.chains import Chain
from opid.updating.structure.reduction import ReductionErrors

SCHEMA = "opid.updating/1"


@dataclass(frozen=True)
class Evidence:
    """Logarithm of the evidence p(D | M) by one method.

    Args:
        method: "laplace", "transitional" or "quadrature".
        log_evidence: its natural logarithm.
        std: standard deviation of that, 0 where the method gives none.
    """

    method: str
    log_evidence: float
    std: float = 0.0


@dataclass(frozen=True)
class Diagnostics:
    """How well a posterior was sampled.

    Args:
        sampler: name of the method.
        n_samples: kept, of all chains.
        n_evaluations: of the posterior.
        acceptance: share of proposals.
        effective_samples: the least of all parameters.
        r_hat: the largest of all parameters (1 is converged); nan of a single chain.
    """

    sampler: str
    n_samples: int
    n_evaluations: int
    acceptance: float
    effective_samples: float
    r_hat: float


@dataclass(frozen=True, eq=False)
class ClassPosterior:
    """One model class given the data.

    Args:
        model_class: the class.
        evidences: by every method that was run; the first is the one that classes are compared by.
        best: (n_parameters,) maximum a posteriori.
        estimates: mean, standard deviation and 95 % interval of each parameter, by "theta_1", "theta_2", ...
        covariance: (n_parameters, n_parameters) of the samples.
        samples: (n_samples, n_parameters).
        log_likelihood_at_best: of the data at `best`.
        diagnostics: of the sampling.
        prior_sensitivity: how the logarithm of the evidence changes when each prior is twice as wide, by parameter.
        warnings: what to doubt.
        chain: as sampled, chain by chain; None where it was not kept.
    """

    model_class: ModelClass
    evidences: tuple[Evidence, ...]
    best: FloatArray
    estimates: Mapping[str, Estimate]
    covariance: FloatArray
    samples: FloatArray
    log_likelihood_at_best: float
    diagnostics: Diagnostics
    prior_sensitivity: Mapping[str, float]
    warnings: tuple[str, ...]
    chain: Chain | None = None

    @property
    def log_evidence(self) -> float:
        """That of the first method."""
        return self.evidences[0].log_evidence

    @property
    def coefficients(self) -> dict[str, tuple[Estimate, str]]:
        """The coefficient of each kind in SI units, theta times its scale, with its unit."""
        own = self.model_class
        found = {}
        for kind, scale, estimate in zip(own.kinds, own.scales, self.estimates.values(), strict=True):
            ends = None if estimate.interval95 is None else tuple(sorted(scale * end for end in estimate.interval95))
            found[kind] = (
                Estimate(
                    None if estimate.value is None else scale * estimate.value,
                    None if estimate.std is None else abs(scale) * estimate.std,
                    None if ends is None else (ends[0], ends[1]),
                ),
                LAWS[kind].parameters[0].unit,
            )
        return found


@dataclass(frozen=True)
class LinearMode:
    """A mode before and after linear updating (Song Table 2).

    Args:
        mode: number of the mode, from 1.
        identified_hz: mean of the tests.
        initial_hz: of the nominal structure.
        updated_hz: with the updated parameters.
        initial_mac: mean over the tests.
        updated_mac: likewise.
    """

    mode: int
    identified_hz: float
    initial_hz: float
    updated_hz: float
    initial_mac: float
    updated_mac: float


@dataclass(frozen=True, eq=False)
class LinearPosterior:
    """Phase I: the parameters of the linear structure given the lowest points of the backbones (Song section 2.1.1).

    Args:
        names: of the parameters.
        best: (n_parameters,) maximum a posteriori.
        estimates: by the name of the parameter.
        covariance: (n_parameters, n_parameters).
        samples: (n_samples, n_parameters).
        modes: frequencies and MAC before and after.
        diagnostics: of the sampling.
        warnings: what to doubt.
        chain: as sampled, chain by chain; None where it was not kept.
    """

    names: tuple[str, ...]
    best: FloatArray
    estimates: Mapping[str, Estimate]
    covariance: FloatArray
    samples: FloatArray
    modes: tuple[LinearMode, ...]
    diagnostics: Diagnostics
    warnings: tuple[str, ...]
    chain: Chain | None = None


@dataclass(frozen=True, eq=False)
class BackboneBand:
    """Predicted backbone of one mode over the amplitude of one sensor, with its 95 % band (Song eq. 18).

    Args:
        mode: number of the mode, from 1.
        sensor: whose amplitude it is drawn over.
        amplitude: (n,) m.
        frequency_hz: (n,) median, Hz.
        low_hz: (n,) lower end of the 95 % band.
        high_hz: (n,) upper end.
        coverage: share of the measured points of this mode that lie within; nan without any.
    """

    mode: int
    sensor: str
    amplitude: FloatArray
    frequency_hz: FloatArray
    low_hz: FloatArray
    high_hz: FloatArray
    coverage: float


@dataclass(frozen=True, eq=False, repr=False)
class Updating(Result):
    """The whole: linear parameters, one posterior a class, and what the best class predicts.

    Args:
        title: of the study.
        form: of the likelihood, "paper", "literal" or "recommended".
        linear: phase I; None where the linear structure was taken as it is.
        system: the reduced structure by its modes, linear parameters at their best.
        measured: the backbones.
        classes: one posterior a class, in the order of the study.
        best_class: name of the class with the largest evidence.
        prediction: of the best class.
        warnings: what to doubt.
        not_determined: why there is no answer, "" if there is one.
        settings: what it was made with.
        reductions: how the reduced structure differs from the whole one, that of the reduction that was used first;
            none where nothing was reduced or nobody asked.
    """

    title: str
    form: str
    linear: LinearPosterior | None
    system: JointedModes
    measured: tuple[MeasuredBackbone, ...]
    classes: tuple[ClassPosterior, ...]
    best_class: str
    prediction: tuple[BackboneBand, ...]
    warnings: tuple[str, ...]
    not_determined: str
    settings: Mapping[str, Any]
    reductions: tuple[ReductionErrors, ...] = ()

    @property
    def all_warnings(self) -> list[str]:
        """All warnings, those of phase I and of the classes last, each once."""
        of_linear = () if self.linear is None else self.linear.warnings
        # as the whole says it, and as it is said where the whole does not
        named = [(f"linear structure: {text}", f"linear structure: {text}") for text in of_linear]
        for each in self.classes:
            name = each.model_class.name
            named += [(f"class {name!r}: {text}", f"{name}: {text}") for text in each.warnings]
        others = [of_part for of_whole, of_part in named if of_whole not in self.warnings]
        return list(dict.fromkeys([*self.warnings, *others]))

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the linear parameters as factors of the nominal ones, and the coefficients, the best class first."""
        linear = {} if self.linear is None else self.linear.estimates
        rows = [SummaryRow.of(f"linear.{name}", estimate, "1") for name, estimate in linear.items()]
        for each in sorted(self.classes, key=lambda each: each.model_class.name != self.best_class):
            coefficients = each.coefficients.items()
            rows += [SummaryRow.of(f"{each.model_class.name}.{kind}", *found) for kind, found in coefficients]
        return tuple(rows)

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The files of the backbones, as they were when they were read."""
        return tuple(each.file for each in self.measured if each.file is not None)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, see `opid.updating.as_json.updating_json`."""
        from opid.updating.as_json import updating_json

        return updating_json(self)

    def _headline(self) -> str:
        best = f"best: {self.best_class}" if self.best_class else "no class"
        return f"{self.title or 'without a title'} ({len(self.classes)} classes, {best})"
