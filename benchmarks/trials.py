"""One trial of the benchmarks: simulate a taxi test of known truth, identify it, compare."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from estimator import (
    GearIdentification,
    GearStudy,
    gear_study,
    identify,
    printed_mass_kg,
    residual_over_noise,
    stiffness_per_mass,
)
from plain_chain import PlainAnswer, least_squares, sparse_regression

from opid.suspensions.sensor_facts import IDEAL_PAIR, SensorPair
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import TaxiTest, taxi_test

SHORT = {
    "sprung_mass_kg": "M2",
    "suspension_stiffness_n_per_m": "K2",
    "suspension_damping_n_s_per_m": "C2",
    "ground_stiffness_n_per_m": "K3",
}
PLAIN = ("least squares", "pysindy")
METHODS = ("model", "classical", *PLAIN)
CRASHED = "crashed"


@dataclass(frozen=True)
class Case:
    """What is simulated: a gear, the mass taken away, the settings of `taxi_run`, the law given or searched.

    `sensors` is what the study says of the sensors.
    """

    gear: LandingGear
    mass_removed_kg: float = 220.0
    run: Mapping[str, Any] = field(default_factory=dict)
    law: str | None = None
    sensors: SensorPair = IDEAL_PAIR


@dataclass(frozen=True)
class Trial:
    """What came of one seed of a case.

    Args:
        seed: of the roads and the noise.
        error: {"M2": estimate - truth, ..., "law.parameter": ...}, SI; NaN where nothing was estimated.
        std: the stated standard deviations, likewise.
        holds: whether the 95 % interval holds the truth, likewise; None where no interval was given.
        truth: the true values, likewise.
        law_name: the law that was found.
        law_right: whether it is the true one.
        reason: why the mass is not determined, or None.
        unexplained: residual over the sensors' noise.
        seconds: that the identification took.
        busy_s: of it, of the processor.
        printed: mass by the paper's chain as printed less the truth, kg; NaN without a pair of peaks.
        two_ratios: mass by K2/M2 of each run from complex least squares less the truth, kg.
    """

    seed: int
    error: dict[str, float]
    std: dict[str, float]
    holds: dict[str, bool | None]
    truth: dict[str, float]
    law_name: str
    law_right: bool
    reason: str | None
    unexplained: float
    seconds: float
    busy_s: float = np.nan
    printed: float = np.nan
    two_ratios: float = np.nan

    def percent(self, name: str) -> float:
        """Error over truth, %; K3, whose truth may be 0, over K2."""
        return 100 * self.error[name] / self.truth["K2" if name == "K3" else name]

    @property
    def crashed(self) -> bool:
        """Whether a mistake in the program ended it, not the data."""
        return self.reason is not None and self.reason.startswith(CRASHED)

    def score(self, name: str) -> float:
        """Error over the stated standard deviation."""
        return self.error[name] / self.std[name]


class Clock(NamedTuple):
    """Two readings, or what passed between two: of the wall and of the processor, s."""

    wall_s: float
    busy_s: float

    @classmethod
    def now(cls) -> Clock:
        return cls(time.perf_counter(), time.process_time())

    def since(self, begun: Clock) -> Clock:
        return Clock(self.wall_s - begun.wall_s, self.busy_s - begun.busy_s)


def simulated(case: Case, seed: int) -> TaxiTest:
    """Return the taxi test of one seed of a case."""
    return taxi_test(case.gear, rng=np.random.default_rng(seed), mass_removed_kg=case.mass_removed_kg, **case.run)


def study_of(test: TaxiTest, sensors: SensorPair = IDEAL_PAIR) -> GearStudy:
    """Return the study of the two runs of a taxi test."""
    runs = (("heavy", test.heavy.recording, 0.0), ("light", test.light.recording, test.mass_change_kg))
    # what is simulated is the same strut twice; `unlike_flights.py` is about others
    return gear_study("taxi", runs, sensors=sensors, repeatability=0.0)


def trial(case: Case, seed: int, *, method: str = "classical") -> Trial:
    """Simulate one seed of a case and identify it by one of `METHODS`."""
    return compared(case, seed, study_of(simulated(case, seed), case.sensors), method)


def compared(case: Case, seed: int, study: GearStudy, method: str) -> Trial:
    """Identify the study of a case by one of `METHODS` and compare with the truth; a refusal is a result too.

    "least squares" is always given the law, "pysindy" always searches. A mistake in the program is a result as well,
    `CRASHED`: one seed must not end a long run.
    """
    truth = _truth(case.gear)
    begun = Clock.now()
    try:
        if method == "least squares":
            found: PlainAnswer | GearIdentification = least_squares(study, case.gear.law.name)
        elif method == "pysindy":
            found = sparse_regression(study)
        else:
            found = identify(study, method=method, law=case.law)
    # opid's own errors are among the first, and curve_fit's
    except (ValueError, RuntimeError, ArithmeticError) as error:
        return _refused(seed, truth, f"{type(error).__name__}: {error}", begun)
    except Exception as error:
        return _refused(seed, truth, f"{CRASHED}: {type(error).__name__}: {error}", begun)
    spent = Clock.now().since(begun)
    if isinstance(found, PlainAnswer):
        return _of_plain(case, seed, truth, found, spent)
    return _of_opid(case, seed, truth, found, spent)


def _refused(seed: int, truth: dict[str, float], reason: str, begun: Clock) -> Trial:
    nothing, spent = dict.fromkeys(truth, np.nan), Clock.now().since(begun)
    return Trial(seed, nothing, nothing, dict.fromkeys(truth), truth, "none", False, reason, np.nan, *spent)


def _of_plain(case: Case, seed: int, truth: dict[str, float], found: PlainAnswer, spent: Clock) -> Trial:
    value = {"M2": found.mass_kg, "K2": found.stiffness_n_per_m, "C2": found.damping_n_s_per_m}
    value |= _law_values(found.law.parameters)
    return Trial(
        seed=seed,
        error={name: value.get(name, np.nan) - true for name, true in truth.items()},
        std=dict.fromkeys(truth, np.nan),
        holds=dict.fromkeys(truth),
        truth=truth,
        law_name=found.law.name,
        law_right=found.law.name == case.gear.law.name,
        reason=None,
        unexplained=np.nan,
        seconds=spent.wall_s,
        busy_s=spent.busy_s,
    )


def _of_opid(case: Case, seed: int, truth: dict[str, float], found: GearIdentification, spent: Clock) -> Trial:
    estimates = {SHORT[name]: estimate for name, estimate in found.parameters.items()}
    if estimates["M2"].value is not None:
        estimates |= _law_values(found.law_estimates)

    def read(attribute: str) -> dict[str, float]:
        values = {name: getattr(estimates.get(name), attribute, None) for name in truth}
        return {name: np.nan if value is None else value for name, value in values.items()}

    value = read("value")
    given = {name: name in estimates and estimates[name].interval95 is not None for name in truth}
    return Trial(
        seed=seed,
        error={name: value[name] - truth[name] for name in truth},
        std=read("std"),
        holds={name: estimates[name].holds(truth[name]) if given[name] else None for name in truth},
        truth=truth,
        law_name=found.law.name,
        law_right=found.law.name == case.gear.law.name,
        reason=found.not_determined,
        unexplained=residual_over_noise(found),
        seconds=spent.wall_s,
        busy_s=spent.busy_s,
        printed=printed_mass_kg(found) - truth["M2"],
        two_ratios=_mass_from_two_ratios(found, case.mass_removed_kg) - truth["M2"],
    )


def _truth(gear: LandingGear) -> dict[str, float]:
    return {short: float(getattr(gear, name)) for name, short in SHORT.items()} | _law_values(gear.law.parameters)


def _law_values(law: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """{kind: {parameter: value}} as {"kind.parameter": value}; absent where another law was found."""
    return {f"{kind}.{key}": value for kind, values in law.items() for key, value in values.items()}


def _mass_from_two_ratios(found: GearIdentification, mass_removed_kg: float) -> float:
    """M2 = dM r/(r - 1) with r the ratio of K2/M2 of the light run to that of the heavy one."""
    heavy, light = stiffness_per_mass(found)
    return mass_removed_kg * light / (light - heavy)
