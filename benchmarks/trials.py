"""One trial of the benchmarks: simulate a taxi test of known truth, identify it, compare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from opid.identify.identification import identify_study, strongest_pair
from opid.identify.result import PARAMETERS, Identification
from opid.identify.study import Run, Study
from opid.mechanics.landing_gear import LandingGear, TaxiTest, taxi_test

SHORT = dict(zip(PARAMETERS, ("M2", "K2", "C2", "K3"), strict=True))


@dataclass(frozen=True)
class Case:
    """What is simulated: a gear, the mass taken away, the settings of `taxi_run`, the law given or searched."""

    gear: LandingGear
    mass_removed_kg: float = 220.0
    run: Mapping[str, Any] = field(default_factory=dict)
    law: str | None = None


@dataclass(frozen=True)
class Trial:
    """What came of one seed of a case.

    Args:
        seed: of the roads and the noise.
        error: {"M2": estimate - truth, ..., "law.parameter": ...}, SI; NaN where nothing was estimated.
        std: the stated standard deviations, likewise.
        truth: the true values, likewise.
        law_name: the law that was found.
        law_right: whether it is the true one.
        reason: why the mass is not determined, or None.
        unexplained: residual over the sensors' noise.
        printed: mass by the printed peak formula less the truth, kg; NaN without a pair of peaks.
        two_ratios: mass by K2/M2 of each run from complex least squares less the truth, kg.
    """

    seed: int
    error: dict[str, float]
    std: dict[str, float]
    truth: dict[str, float]
    law_name: str
    law_right: bool
    reason: str | None
    unexplained: float
    printed: float
    two_ratios: float

    def percent(self, name: str) -> float:
        """Error over truth, %; K3, whose truth may be 0, over K2."""
        return 100 * self.error[name] / self.truth["K2" if name == "K3" else name]

    def score(self, name: str) -> float:
        """Error over the stated standard deviation."""
        return self.error[name] / self.std[name]


def study_of(test: TaxiTest) -> Study:
    """Return the study of the two runs of a taxi test."""
    runs = (Run("heavy", test.heavy.recording, 0.0), Run("light", test.light.recording, test.mass_change_kg))
    return Study("taxi", sprung="upper_z", unsprung="lower_z", runs=runs)


def trial(case: Case, seed: int, *, method: str = "classical") -> Trial:
    """Simulate one seed of a case and identify it by a method of `identify_study`."""
    test = taxi_test(case.gear, rng=np.random.default_rng(seed), mass_removed_kg=case.mass_removed_kg, **case.run)
    found = identify_study(study_of(test), method=method, law=case.law)
    truth = _truth(case.gear)
    value, std = _found(found, truth)
    mass = truth["M2"]
    pair = strongest_pair(found.evidence.pairs)
    return Trial(
        seed=seed,
        error={name: value[name] - truth[name] for name in truth},
        std=std,
        truth=truth,
        law_name=found.law.name,
        law_right=found.law.name == case.gear.law.name,
        reason=found.not_determined,
        unexplained=found.diagnostics["unexplained_over_floor"],
        printed=pair.as_printed.sprung_mass_kg - mass if pair and pair.as_printed else np.nan,
        two_ratios=_mass_from_two_ratios(found, case.mass_removed_kg) - mass,
    )


def _truth(gear: LandingGear) -> dict[str, float]:
    linear = {short: float(getattr(gear, name)) for name, short in SHORT.items()}
    law = {f"{kind}.{key}": v for kind, values in gear.law.parameters.items() for key, v in values.items()}
    return linear | law


def _found(found: Identification, truth: dict[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """Values and standard deviations of the true parameters; a law's are absent where another law was found."""
    estimates = {short: found.parameters[name] for name, short in SHORT.items()}
    if found.parameters["sprung_mass_kg"].value is not None:
        law = found.law_estimates
        estimates |= {f"{kind}.{key}": each for kind, values in law.items() for key, each in values.items()}

    def read(attribute: str) -> dict[str, float]:
        values = {name: getattr(estimates.get(name), attribute, None) for name in truth}
        return {name: np.nan if value is None else value for name, value in values.items()}

    return read("value"), read("std")


def _mass_from_two_ratios(found: Identification, mass_removed_kg: float) -> float:
    """M2 = dM r/(r - 1) with r the ratio of K2/M2 of the light run to that of the heavy one."""
    heavy, light = (run.complex_fit.value[0] for run in found.evidence.runs)
    return mass_removed_kg * light / (light - heavy)
