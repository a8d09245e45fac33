"""Plan runs before they are made: from a guessed gear, which is simulated, or from the study of runs that were made.

    from opid.planning import plan, read_guess
    plan(read_guess("guess.toml"), ["sprung_mass=0.5%"])

The estimator knows no virtual test and a virtual test knows no estimator, so they meet here: a guess becomes virtual
taxi runs, their identification gives the parameters and the motion below the suspension, and
`opid.suspensions.plan_runs` does the rest.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from opid.errors import InputError, NotDeterminedError, refuse
from opid.mechanics.laws.law import LINEAR, Law, law_from_parameters
from opid.progress import Say
from opid.provenance import read_file
from opid.studies.schema import NO_KEY, derive_record, load, name_source, read_tables, recast
from opid.suspensions.identification import identify
from opid.suspensions.model.law_parameters import to_free
from opid.suspensions.planning.result import Costs, PlannedRun, PlanResult
from opid.suspensions.planning.search import PlanSettings, SearchSpace, plan_runs
from opid.suspensions.result import Identification
from opid.suspensions.study import PointMass, Study
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.road import road_psd
from opid.virtual.taxi_tests.sensors import Sensor
from opid.virtual.taxi_tests.taxiing import taxi_study, taxi_test

_SIMULATED_S = 80.0
"""Duration of the simulated runs, s: the information of two such roads scatters by some per cent."""

_QUIET = Sensor(noise_m_per_s2=1e-3)
"""The simulated runs only find the guessed parameters again, with less noise than any planned sensor."""

_USUAL_CHANGE = -0.12
"""Mass change that is simulated if the guess plans none, as a fraction of the mass."""

_NOMINAL, _USUAL_SEARCH, _USUAL_COSTS = LandingGear(), SearchSpace(), Costs()


@dataclass(frozen=True, kw_only=True)
class GuessedGear:
    """A gear of which everything is guessed.

    Args:
        sprung_mass_kg: M2.
        suspension_stiffness_n_per_m: K2.
        suspension_damping_n_s_per_m: C2.
        law: {kind: {parameter: value}} of each term of the law; empty for a linear suspension.
        unsprung_mass_kg: M1; the usual fraction of the sprung mass if left out.
        tyre_stiffness_n_per_m: K1; the usual one for this mass if left out.
        tyre_damping_n_s_per_m: C1; the usual one for this mass if left out.

    Raises:
        InputError: a value that is not positive, or a law or parameter that does not exist.
    """

    sprung_mass_kg: float
    suspension_stiffness_n_per_m: float
    suspension_damping_n_s_per_m: float
    law: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    unsprung_mass_kg: float | None = None
    tyre_stiffness_n_per_m: float | None = None
    tyre_damping_n_s_per_m: float | None = None

    def __post_init__(self) -> None:
        _ = self.as_simulated

    @property
    def as_simulated(self) -> LandingGear:
        """The gear as a virtual test takes it."""
        # A file may hold whole numbers.
        mass_kg = float(self.sprung_mass_kg)
        if not 0.0 < mass_kg < 1e9:
            raise InputError(f"sprung_mass_kg is {mass_kg:g}: give a positive number, kg")
        heavier = mass_kg / _NOMINAL.sprung_mass_kg

        def usual(name: str) -> float:
            given = getattr(self, name)
            return heavier * float(getattr(_NOMINAL, name)) if given is None else float(given)

        law: Law = law_from_parameters("+".join(self.law), self.law) if self.law else LINEAR
        for term in law.terms:
            if term.kind.is_friction and not term.values[0] > 0:
                raise InputError(
                    f"the force of the friction {term.kind.name} is {term.values[0]:g} N, which would drive the gear: "
                    "give a positive one"
                )
        return LandingGear(
            sprung_mass_kg=mass_kg,
            suspension_stiffness_n_per_m=float(self.suspension_stiffness_n_per_m),
            suspension_damping_n_s_per_m=float(self.suspension_damping_n_s_per_m),
            law=law,
            unsprung_mass_kg=usual("unsprung_mass_kg"),
            tyre_stiffness_n_per_m=usual("tyre_stiffness_n_per_m"),
            tyre_damping_n_s_per_m=usual("tyre_damping_n_s_per_m"),
        )


@dataclass(frozen=True, kw_only=True)
class GuessedRoad:
    """The road of the planned runs.

    Args:
        road_class: ISO 8608 class, "A" to "H".
        speed_m_per_s: speed at the beginning and at the end of a run, m/s.

    Raises:
        InputError: a class that does not exist, or a speed that is not positive.
    """

    road_class: str = "B"
    speed_m_per_s: tuple[float, float] = (18.0, 0.5)

    def __post_init__(self) -> None:
        road_psd(self.road_class, 1.0)
        if not (min(self.speed_m_per_s) >= 0.0 and 0.0 < max(self.speed_m_per_s) <= 200.0):
            raise InputError(f"speed_m_per_s is {self.speed_m_per_s}: give two speeds from 0 to 200 m/s, one positive")


@dataclass(frozen=True, kw_only=True)
class GuessedSensors:
    """The sensors of the planned runs.

    Args:
        noise_m_per_s2: rms of the white noise of each sensor, m/s^2.
        fs_hz: sampling rate, Hz.

    Raises:
        InputError: noise that is not positive, or a rate at which the band of the estimator is not recorded.
    """

    noise_m_per_s2: float = 0.005
    fs_hz: float = 512.0

    def __post_init__(self) -> None:
        if not 0.0 < self.noise_m_per_s2 < 1e3:
            raise InputError(f"noise_m_per_s2 is {self.noise_m_per_s2}: give a positive number, m/s^2")
        if not 50.0 <= self.fs_hz <= 5000.0:
            raise InputError(f"fs_hz is {self.fs_hz}: give a rate from 50 to 5000 Hz")


@dataclass(frozen=True, kw_only=True)
class Guess:
    """A gear, a road and sensors that are guessed, and the runs that are planned.

    Args:
        gear: the gear.
        runs: the planned runs; the first ones without a mass change are the reference.
        road: the road.
        sensors: the sensors.
        repeatability: relative standard deviation of springs, damping and friction from run to run.
        search: the plans that are tried.
        costs: what a plan costs.
        title: title of the plan.
        source: the file that it was read from; None if it was made otherwise.

    Raises:
        InputError: no run, or a mass change that leaves no mass.
    """

    gear: GuessedGear
    runs: tuple[PlannedRun, ...]
    road: GuessedRoad = GuessedRoad()
    sensors: GuessedSensors = GuessedSensors()
    repeatability: float = 0.01
    search: SearchSpace = _USUAL_SEARCH
    costs: Costs = _USUAL_COSTS
    title: str = "Planned runs"
    source: Annotated[Path | None, NO_KEY] = None

    def __post_init__(self) -> None:
        if not self.runs:
            raise InputError("no run is planned: give one table [[runs]] for each, with duration_s and mass_change_kg")
        if not 0.0 <= self.repeatability <= 0.3:
            raise InputError(f"repeatability is {self.repeatability}: give a fraction from 0 to 0.3 (0.01 for 1 %)")
        for change_kg in (*(each.mass_change_kg for each in self.runs), *self.search.mass_changes_kg):
            if not abs(change_kg) < self.gear.sprung_mass_kg:
                raise InputError(
                    f"a mass change of {change_kg:g} kg is planned for a gear that carries "
                    f"{self.gear.sprung_mass_kg:g} kg: give less than that"
                )


def is_guess(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is a guess, which has a table `[gear]`, and not a study.

    Args:
        path: the file.

    Raises:
        InputError: it is missing, or no TOML.
    """
    return "gear" in load(Path(path))


def read_guess(path: str | os.PathLike[str]) -> Guess:
    """Return the guess of a file.

    It is TOML with the fields of `Guess`: tables `[gear]` (with `[gear.law.KIND]` for each term of the law), `[road]`,
    `[sensors]`, `[search]` and `[costs]`, and one table `[[runs]]` for each planned run.

    Args:
        path: the file.

    Raises:
        InputError: it is missing or no TOML; an unknown, missing or mistyped key, or a value that cannot be.
    """
    source = Path(path)
    tables, faults = read_tables(derive_record(Guess, "source"), load(source))
    refuse(faults, source)
    with name_source(source):
        return recast(Guess, tables, source=source)


def plan(
    source: Guess | Study,
    targets: Sequence[str],
    *,
    law: str | None = None,
    search: SearchSpace | None = None,
    costs: Costs | None = None,
    settings: PlanSettings | None = None,
    seed: int = 0,
    progress: Say | None = None,
) -> PlanResult:
    """Return what planned runs will determine, and the cheapest plan that reaches the targets.

    A guess is simulated: its gear runs over a random road of its class, once for each of its mass changes, and the
    motion of its wheel is that of all planned runs. A study is identified, and the plan adds runs to those that it has,
    whose measured motion below the suspensions is repeated.

    Args:
        source: a guess, or the study of runs that were made.
        targets: standard deviations to be reached, such as "sprung_mass=0.5%" (see `opid.suspensions.plan_runs`).
        law: law of a study that is fitted; searched if left out.
        search: the plans that are tried; those of the guess, or the usual ones, if left out.
        costs: what a plan costs; those of the guess, or the usual ones, if left out.
        settings: tuned numbers.
        seed: seed of the simulated road.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: something that is no guess and no study, or a target that cannot be.
        NotDeterminedError: what `plan_runs` does not plan from.
    """
    say = progress or (lambda step: None)
    if isinstance(source, Study):
        found = identify(source, law=law, progress=say)
        assert isinstance(found, Identification)  # the method is "model"
        return plan_runs(found, targets, search=search, costs=costs, settings=settings, progress=say)
    if not isinstance(source, Guess):
        raise InputError(
            f"source is of type {type(source).__name__}: give a Guess, as read_guess makes one, or a Study"
        )
    if law is not None:
        raise InputError(f"law is {law!r}, and a guess states its law in [gear.law]: leave it out")
    say("virtual runs")
    simulated = _simulate(source, np.random.default_rng(seed))
    say("their identification")
    try:
        found = identify(simulated, law=source.gear.as_simulated.law.name, ground=False)
    except NotDeterminedError as error:
        raise NotDeterminedError(f"the guessed gear cannot be identified from virtual runs: {error}") from error
    assert isinstance(found, Identification)  # the method is "model"
    first, last = source.road.speed_m_per_s
    planned = plan_runs(
        _put_at_guess(found, source.gear.as_simulated),
        targets,
        runs=source.runs,
        noise_m_per_s2=source.sensors.noise_m_per_s2,
        repeatability=source.repeatability,
        search=search or source.search,
        costs=costs or source.costs,
        settings=settings,
        title=source.title,
        road=f"ISO 8608 class {source.road.road_class}, {first:g} to {last:g} m/s",
        progress=say,
    )
    if source.source is None:
        return planned
    return replace(planned, source=str(source.source), read_files=(read_file(source.source),))


def _put_at_guess(found: Identification, gear: LandingGear) -> Identification:
    """Return an identification whose vector is the guess, also in directions that the virtual runs hardly determine.

    A law that the identification found about an origin of its own stays as it was found.
    """
    (evidence,) = found.evidence
    model, theta = evidence.fit.model, evidence.fit.theta.copy()
    group = model.groups[0]
    if (
        group.has_origin
        or not model.mass_free
        or [each.kind for each in group.law.terms] != [each.kind for each in gear.law.terms]
    ):
        return found
    theta[:2] = gear.suspension_stiffness_n_per_m, gear.suspension_damping_n_s_per_m
    theta[:2] /= gear.sprung_mass_kg
    theta[model.law_indices(0)] = to_free(gear.law.scaled(1.0 / gear.sprung_mass_kg))
    theta[model.names.index("inverse_mass")] = 1.0 / gear.sprung_mass_kg
    return replace(found, evidence=(replace(evidence, fit=replace(evidence.fit, theta=theta)),))


def _simulate(guess: Guess, rng: np.random.Generator) -> Study:
    """Return the study of virtual runs without and with each of the planned mass changes."""
    gear = guess.gear.as_simulated
    changes = {float(each.mass_change_kg) for each in guess.runs} - {0.0} or {_USUAL_CHANGE * gear.sprung_mass_kg}
    test = taxi_test(
        gear,
        rng=rng,
        loadings=[[PointMass(float(change_kg), 0.0)] for change_kg in sorted(changes)],
        duration_s=_SIMULATED_S,
        fs=guess.sensors.fs_hz,
        road_class=guess.road.road_class,
        speed_m_per_s=guess.road.speed_m_per_s,
        lower_sensor=_QUIET,
        upper_sensor=_QUIET,
    )
    return replace(taxi_study(test, title=guess.title), repeatability=0.0)
