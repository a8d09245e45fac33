"""Structures tried on the same data: each gear alone, symmetric pairs, one rigid body.

A gear alone, or the mean of a pair, is a body with heave alone and one interface: the same predictor, search and noise
level as for the whole body, so that what they leave can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from opid.errors import NotDeterminedError
from opid.mechanics.laws.law import LAWS, Law
from opid.mechanics.weight import GRAVITY_M_PER_S2, depends_on_travel
from opid.signals.recording import FloatArray
from opid.suspensions.answer.intervals import Parameters, known_parameters
from opid.suspensions.answer.model_error import (
    ModelError,
    follow_freely,
    measure_model_error,
    unknown_error,
    weighed_by_process_noise,
)
from opid.suspensions.fitting.faults import Demand, implausible_demands
from opid.suspensions.fitting.fit import (
    NO_FIT,
    Fit,
    balanced,
    explains_nothing,
    loading_changes,
    runs_contradict_each_other,
    unexplained,
)
from opid.suspensions.fitting.noise import (
    KnownNoise,
    goes_with_drive,
    is_noise,
    is_noise_above_stated,
    is_of_others,
    mean_level,
    with_noise_of_errors,
    with_noise_of_the_band,
    with_own_noise,
)
from opid.suspensions.fitting.repeatability import (
    Repeatability,
    mends_much,
    repeatability_of,
    with_departures,
    with_own_repeatability,
)
from opid.suspensions.fitting.search import (
    Found,
    Ladder,
    Question,
    asks_for_law,
    begins_in_vain,
    find_from_reference,
    find_model,
    is_hopeless,
    is_likelier,
    judged,
    leaves_noise,
    with_laws_of,
    with_simpler_laws,
)
from opid.suspensions.fitting.start import Start, start_values
from opid.suspensions.law_search.pursuit import chosen
from opid.suspensions.model.body import Body, rigid_body, vertical
from opid.suspensions.model.driven_model import Model, noise_level
from opid.suspensions.model.run import DrivenRun, driven_run
from opid.suspensions.model.unknowns import Group
from opid.suspensions.sensor_facts import Sensors
from opid.suspensions.settings import Settings, Verdicts
from opid.suspensions.study import Axis, PointMass, Study

Noise = tuple[FloatArray, FloatArray]
Arrays = Sequence[tuple[FloatArray, FloatArray, FloatArray]]
"""Of each run (n, n_interfaces) below, (n, n_sensors) on the body and (n, n_leaks) across, m/s^2."""

# what rests on a gear of less than this fraction of a loading is nothing
_LEAST_FRACTION = 1e-3
# gears are on one line if they leave it by less than this fraction of its length
_ONE_LINE = 0.01


@dataclass(frozen=True, eq=False)
class Task:
    """What every structure is fitted to.

    Args:
        study: the study; None for a user's own structure.
        arrays: of the runs, single spikes mended.
        sensors: what is known of them.
        noise: what is known of it beforehand.
        law: to fit, per unit amplitudes as start; None where laws are searched.
        question: what a search may try.
        settings: of the estimator.
        say: called with the name of each step as it begins.
        run_names: names of the runs.
        stated_repeatability: of springs, damping and friction from run to run; None for what is usual.
        is_for_comparison: whether the answer is about another structure: this one is not searched anew where its runs
            may be unlike.
    """

    study: Study | None
    arrays: Arrays
    sensors: Sensors
    noise: KnownNoise
    law: Law | None
    question: Question
    settings: Settings
    say: Callable[[str], None]
    run_names: tuple[str, ...]
    stated_repeatability: float | None
    is_for_comparison: bool = False

    @property
    def repeatability(self) -> float:
        """Relative standard deviation of springs, damping and friction from run to run, as stated or as usual."""
        stated = self.stated_repeatability
        return self.settings.repeatability.usual if stated is None else stated

    @property
    def prior_repeatability(self) -> float:
        """What departures are known to be within: the usual one where the runs contradict that there are none."""
        return self.repeatability or self.settings.repeatability.usual


@dataclass(frozen=True, eq=False)
class Fitted:
    """One structure fitted to the runs.

    Args:
        kind: "single", "pair" or "rigid_body".
        interfaces: indices in the study of those that it is about.
        found: where the search ended; None where there is no fit.
        noise: known beforehand of each sensor below and on the body, m/s^2.
        task: what it was fitted to.
        reason: why there is no fit; "" if there is one.
        error: what limits the answer of one gear that leaves more than the noise known beforehand; of a rigid body
            that does None where it is the model.
    """

    kind: str
    interfaces: tuple[int, ...]
    found: Found | None
    noise: Noise
    task: Task
    reason: str = ""
    error: ModelError | None = None

    @property
    def settings(self) -> Settings:
        """Of the estimator."""
        return self.task.settings

    @property
    def has_fit(self) -> bool:
        """Whether there is a fit."""
        return self.found is not None

    @property
    def fit(self) -> Fit:
        """The fit; NotDeterminedError where there is none."""
        if self.found is None:
            raise NotDeterminedError(self.reason)
        return self.found.fit

    @property
    def ladder(self) -> Ladder:
        """Laws that were tried."""
        return () if self.found is None else self.found.ladder

    @property
    def demands(self) -> tuple[Demand, ...]:
        """What was let in beside the suspensions."""
        return () if self.found is None else self.found.demands

    @cached_property
    def implausible(self) -> tuple[Demand, ...]:
        """Faults of sensors that the runs demand and that were not let in, for they lie far beyond what sensors do."""
        is_worth_it = self.task.question.faults and self.residual_over_noise > self.settings.verdicts.noted
        return implausible_demands(self.fit) if self.has_fit and is_worth_it else ()

    @property
    def is_noise_of_fit(self) -> bool:
        """Whether the noise is what the fit leaves, for nothing else tells it."""
        return self.found is not None and self.task.noise.most > 1.0 and self.fit.model.most_noise == 1.0

    @property
    def level(self) -> float:
        """Noise known beforehand, as white noise of one level on all sensors, m/s^2."""
        return noise_level(self.noise)

    @property
    def law_is_given(self) -> bool:
        """Whether no law was searched."""
        return self.task.law is not None

    @property
    def runs(self) -> tuple[DrivenRun, ...]:
        """That were fitted."""
        return self.fit.model.runs

    @property
    def residual_over_noise(self) -> float:
        """Noise that would explain the errors over the noise known beforehand, on the side where that is more."""
        if self.found is None:
            return float("inf")
        sides = zip(self.fit.model.noise, self.noise, strict=True)
        return self.fit.ratio * max(mean_level(now.tolist()) / mean_level(known.tolist()) for now, known in sides)

    @property
    def left_out_over_noise(self) -> float | None:
        """Likewise of runs that the others predict; None where there is no such level."""
        if self.found is None or not self.ladder:
            return None
        left_out = chosen(self.ladder).left_out
        return None if left_out is None else left_out / self.level

    @property
    def lack(self) -> float:
        """The larger of both."""
        return max(self.residual_over_noise, self.left_out_over_noise or 0.0)

    @cached_property
    def unexplained(self) -> tuple[float, ...]:
        """Of each run what the free motion of the model leaves of the readings, as a fraction of their rms."""
        return unexplained(self.fit)

    @property
    def explains(self) -> bool:
        """Whether what is left is noise, also of runs that the others predict; or is nothing of a rigid body's own."""
        return self.lack <= self.settings.verdicts.explained or (self.kind == "rigid_body" and self.error is not None)

    @property
    def is_pushed(self) -> bool:
        """Whether forces that nobody measured move a rigid body, and leave more than noise."""
        return self.kind == "rigid_body" and self.error is not None and self.error.limit == "unmeasured forces"

    @property
    def is_hopeless(self) -> bool:
        """Whether it leaves what is beyond the mending of laws."""
        return self.found is not None and is_hopeless(self.fit)

    @cached_property
    def known(self) -> Parameters:
        """The parameters of the fit, and how well they are known."""
        # what the model of one gear lacks widens the intervals: it is no other structure that could be meant
        more = 0.0 if self.error is None else self.error.spread
        return known_parameters(self.fit, self.task.prior_repeatability, more)

    @cached_property
    def repeatability(self) -> Repeatability:
        """How much alike the runs are."""
        is_usual = self.task.stated_repeatability is None
        return repeatability_of(self.fit, self.known.levels, self.task.repeatability, is_usual=is_usual)


@dataclass(frozen=True, eq=False)
class Choice:
    """The structure that the answer is about.

    Args:
        study: the study.
        tried: all structures that were fitted.
        kind: of the structure that was chosen.
        why: one sentence.
    """

    study: Study
    tried: Sequence[Fitted]
    kind: str
    why: str

    @cached_property
    def parts(self) -> list[Fitted]:
        """The fits that make up the answer."""
        return [part for part in parts_of(self.tried, self.kind) if part.has_fit]

    def names(self, parts: Sequence[Fitted]) -> str:
        """Return the names of the interfaces of some structures."""
        return ", ".join(self.study.names[k] for part in parts for k in part.interfaces)

    @property
    def ratio(self) -> float:
        """Residual over noise of the worst part."""
        return max(part.residual_over_noise for part in self.parts)

    @property
    def lack(self) -> float:
        """The same, or of runs that the others predict, whichever is more."""
        return max(part.lack for part in self.parts)

    @property
    def explains(self) -> bool:
        """Whether all parts leave noise, or what forces do that nobody measured."""
        return all(part.explains for part in self.parts)

    @property
    def verdicts(self) -> Verdicts:
        """House-wide thresholds."""
        return self.parts[0].settings.verdicts


def parts_of(tried: Sequence[Fitted], kind: str) -> list[Fitted]:
    """Return the structures that make up an answer of a kind, those without a fit among them."""
    if kind == "rigid_body":
        return [each for each in tried if each.kind == "rigid_body"]
    pairs = [each for each in tried if each.kind == "pair"] if kind == "pair" else []
    paired = {k for each in pairs for k in each.interfaces}
    return [*pairs, *(each for each in tried if each.kind == "single" and each.interfaces[0] not in paired)]


def static_loads(study: Study, loading: PointMass) -> FloatArray:
    """Return how much of a mass rests on each interface, (n,) kg: together all of it, wherever the origin is.

    By statics where there are three, as even as statics allows where there are more. On one line the lever rule holds,
    about the foot of the perpendicular from the mass.
    """
    positions = np.array([interface.place for interface in study.interfaces])
    middle = positions.mean(axis=0)
    lever = np.array([loading.x_m, loading.y_m]) - middle
    uneven = np.linalg.pinv((positions - middle).T, rcond=_ONE_LINE) @ lever
    return np.asarray(loading.mass_kg * (1 / len(positions) + uneven))


def fit_alone(task: Task, interfaces: tuple[int, ...]) -> Fitted:
    """Fit the mean of some interfaces as one gear under its share of the mass."""
    study, picked, runs = task.study, list(interfaces), []
    assert study is not None  # a user's own structure has no gears to leave alone
    kind = "single" if len(picked) == 1 else "pair"
    noise = tuple(np.atleast_1d(np.sqrt(np.sum(side[picked] ** 2)) / len(picked)) for side in task.noise.levels)
    try:
        sensors = task.sensors.mean_of(picked)
    except NotDeterminedError as error:
        return Fitted(kind, interfaces, None, noise, task, str(error))  # type: ignore[arg-type]
    leaking = task.sensors.leaks_into(picked)
    for run, (below, above, across) in zip(study.runs, task.arrays, strict=True):
        change = sum(float(static_loads(study, each)[picked].mean()) for each in run.masses)
        if abs(change) < _LEAST_FRACTION * sum(abs(each.mass_kg) for each in run.masses):
            change = 0.0
        runs.append(
            driven_run(
                below[:, picked].mean(axis=1),
                above[:, picked].mean(axis=1),
                fs=study.fs,
                loading=change,
                leaks=across[:, leaking] / len(picked),
                settings=task.settings.runs,
            )
        )
    name = "" if study.is_one_gear else ", ".join(study.names[k] for k in picked)
    areas = [study.interfaces[k].piston_area_m2 or 0.0 for k in picked]
    body = replace(gear_body(study.interfaces[picked[0]].axis), piston_area_m2=min(areas) and float(np.mean(areas)))
    return fitted(task, kind, interfaces, runs, body, (Group(name, (0,)),), sensors, noise)  # type: ignore[arg-type]


def gear_body(axis: Axis = "up") -> Body:
    """Return a gear alone: a mass that heaves on one interface."""
    one = np.ones((1, 1))
    body = Body(("heave",), one, (), np.zeros((0, 1, 1)), np.zeros((1, 1)), one, one)
    return replace(body, fall=_fall(axis, body))


def _fall(axis: Axis, body: Body) -> FloatArray | None:
    """What a body in free fall accelerates by, of which heave is the first degree of freedom."""
    others: list[Axis] = ["horizontal"] * (len(body.dof) - 1)
    return fall_of([axis, *others])


def fall_of(axes: Sequence[Axis]) -> FloatArray | None:
    """Return what a body in free fall accelerates by, (n_dof,) m/s^2; None where no weight acts on it.

    Each axis says where its degree of freedom counts positive; "horizontal" where no weight moves it.
    """
    signs = {"up": -1.0, "down": 1.0, "horizontal": 0.0}
    fall = GRAVITY_M_PER_S2 * np.array([signs[axis] for axis in axes])
    return fall if fall.any() else None


def fit_rigid(task: Task) -> Fitted:
    """Fit one rigid body on all interfaces."""
    study = task.study
    assert study is not None  # a user's own structure is what it is
    body = rigid_body(
        [interface.place for interface in study.interfaces],
        [
            *(interface.sensor_place for interface in study.interfaces),
            *((sensor.x_m, sensor.y_m) for sensor in study.sensors),
        ],
        names=study.names,
        tolerance_m=study.structure.position_tolerance_m,
    )
    runs = [
        driven_run(
            below,
            above,
            fs=study.fs,
            loading=loading_matrix(study, index),
            leaks=across,
            settings=task.settings.runs,
        )
        for index, (below, above, across) in enumerate(task.arrays)
    ]
    body = replace(body, fall=_fall(study.interfaces[0].axis, body))
    every = tuple(range(len(study.interfaces)))
    return fitted(task, "rigid_body", every, runs, body, groups_of(study), task.sensors, task.noise.levels)


def loading_matrix(study: Study, index: int) -> FloatArray:
    """Return the mass matrix of a loading about the origin, (3, 3) kg, kg m, kg m^2."""
    total = np.zeros((3, 3))
    for each in study.runs[index].masses:
        row = vertical(each.x_m, each.y_m)
        total += each.mass_kg * np.outer(row, row)
    return total


def groups_of(study: Study) -> tuple[Group, ...]:
    """Return which interfaces share what, in the order of the first of each group."""
    together = {name: group for group in study.structure.shared for name in group}
    found: dict[str, Group] = {}
    for name in study.names:
        members = together.get(name, (name,))
        attachments = tuple(k for k, each in enumerate(study.names) if each in members)
        label = ", ".join(study.names[k] for k in attachments)
        found.setdefault(label, Group(label, attachments))
    return tuple(found.values())


def fitted(
    task: Task,
    kind: str,
    interfaces: tuple[int, ...],
    runs: Sequence[DrivenRun],
    body: Body,
    groups: tuple[Group, ...],
    sensors: Sensors,
    noise: Noise,
    *,
    start: Start | None = None,
) -> Fitted:
    """Fit a body: start values from its equation of motion, the model, laws, faults, and the runs that are left out."""
    mass_free, settings = is_mass_free(runs, body), task.settings
    if task.law is not None:
        groups = tuple(replace(group, law=task.law) for group in groups)
    begin = partial(
        _begun, task, body=body, groups=groups, sensors=sensors, noise=noise, most_noise=task.noise.most, start=start
    )
    try:
        model, start = begin(runs, mass_free=mass_free)
        found = _found(task, model, start, begin)
        found = replace(found, fit=with_noise_of_the_band(found.fit))
        noise, most = found.fit.model.noise, found.fit.model.most_noise
        model, begin = replace(model, noise=noise, most_noise=most), partial(begin, noise=noise, most_noise=most)
        if len(runs) > 1:
            found = _with_departures(task, found, model, start, begin)
            found = replace(found, fit=with_noise_of_the_band(found.fit))
        noise = found.fit.model.noise
        found = judged(found, task.question)
        # the noise of the two sides is told apart only where the model explains the runs
        if found.fit.ratio < settings.faults.nearly_explained:
            found = replace(found, fit=with_own_noise(found.fit))
        if not is_hopeless(found.fit):
            found = replace(found, fit=with_own_repeatability(found.fit))
    except (*NO_FIT, NotDeterminedError) as error:
        return Fitted(kind, interfaces, None, noise, task, str(error))
    updated = tuple(demand.updated(found.fit) for demand in found.demands)
    part = Fitted(kind, interfaces, replace(found, demands=updated), noise, task)
    if kind == "rigid_body" and part.residual_over_noise > settings.verdicts.explained:
        return _with_error_of_body(part)
    if task.study is None or not task.study.is_one_gear or part.residual_over_noise <= settings.verdicts.noted:
        return part
    return _with_error(part)


def _with_error_of_body(part: Fitted) -> Fitted:
    """A rigid body that leaves more than noise, with what limits its answer where forces that nobody measured do.

    What a wrong structure leaves goes along with the motion below the suspensions, which the runs tell at once.
    """
    found, stated, known = part.found, part.task.repeatability, part.settings.process
    assert found is not None  # it leaves something
    try:
        if part.task.law is None and is_hopeless(found.fit) and goes_with_drive(found.fit) < known.most_coherent:
            part.task.say("laws under process noise")
            found = with_laws_of(found, weighed_by_process_noise(found.fit), part.task.question, part.task.say)
        is_above_stated = is_noise_above_stated(found.fit, part.task.noise)
        if not (is_above_stated or is_of_others(found.fit)):
            return part
        if part.task.law is not None and asks_for_law(found.fit, part.task.question.kinds):
            return part
        if stated and not found.fit.model.repeatability and len(part.runs) > 1:
            # the search took the runs as alike, for there seemed to be no number to tell
            found = replace(found, fit=with_own_repeatability(with_departures(found.fit, stated)))
        of_sensors = found.fit.model.noise
        found = replace(found, fit=with_noise_of_errors(found.fit))
        error = measure_model_error(found.fit, is_noise=is_above_stated, noise=of_sensors)
    except NO_FIT:
        return part
    limited, more = replace(part, found=found, error=error), part.settings.warnings.left_out_more
    if error.limit == "noise":
        goes_together = (part.left_out_over_noise or 0.0) <= more * part.residual_over_noise
    else:
        left_out = [each.unexplained <= more * limited.unexplained[each.run] for each in error.left_out]
        goes_together = error.limit == "unmeasured forces" and all(left_out)
    return limited if goes_together else part


def _with_error(part: Fitted) -> Fitted:
    """One gear that leaves more than noise, with what limits its answer."""
    found, stated = part.found, part.task.repeatability
    assert found is not None  # it leaves something
    try:
        if is_hopeless(found.fit) and len(part.runs) > 1:
            found = replace(found, fit=balanced(found.fit))
        if is_hopeless(found.fit) and explains_nothing(found.fit):
            fit, error = follow_freely(found.fit, unknown_error(found.fit))
            if explains_nothing(fit):
                # it is refused, whatever limits it
                return replace(part, found=replace(found, fit=fit), error=error)
        # what both weights leave alike looks like a force, and moves the mass; of one weight there is none to move
        is_wrong = (
            part.task.law is not None
            and found.fit.model.mass_free
            and asks_for_law(found.fit, part.task.question.kinds)
        )
        error = measure_model_error(
            found.fit, is_wrong=is_wrong, is_noise=is_noise_above_stated(found.fit, part.task.noise)
        )
        if error.limit == "unmeasured forces" and stated and not found.fit.model.repeatability and len(part.runs) > 1:
            # the search took the runs as alike, for there seemed to be no number to tell
            found = replace(found, fit=with_own_repeatability(with_departures(found.fit, stated)))
            error = measure_model_error(found.fit)
        if error.limit == "model" and part.task.law is None:
            # a term that takes up what the model lacks bends the others; without it they may stand
            for simpler in with_simpler_laws(found, part.task.question.kinds):
                of_simpler = measure_model_error(simpler.fit)
                if of_simpler.limit != "model":
                    found, error = simpler, of_simpler
                    break
        if error.limit == "model":
            fit, error = follow_freely(found.fit, error)
            found = replace(found, fit=fit)
    except NO_FIT as failed:
        return replace(part, found=None, reason=str(failed))
    return replace(part, found=found, error=error)


def _begun(
    task: Task,
    runs: Sequence[DrivenRun],
    *,
    body: Body,
    groups: tuple[Group, ...],
    sensors: Sensors,
    noise: Noise,
    mass_free: bool,
    most_noise: float,
    start: Start | None = None,
    repeatability: float = 0.0,
) -> tuple[Model, Start]:
    """The model of some runs, and where its fit begins."""
    if start is None:
        start = start_values(
            runs,
            body,
            groups,
            mass_free=mass_free,
            # what an AC coupling takes from slow motion looks like such a spring
            ground=task.question.ground and not sensors.has_coupling,
            kinds=_kinds_of_start(task),
            lags=[fault for fault in sensors.faults if fault.kind == "lag"] if body.n_interfaces == 1 else (),
            settings=task.settings.start,
        )
    model = Model(
        tuple(runs),
        body,
        start.groups,
        sensors,
        mass_free,
        start.motion_rms,
        task.settings,
        noise=noise,
        most_noise=most_noise,
        repeatability=repeatability,
    )
    return model, start


def _kinds_of_start(task: Task) -> list[str]:
    """Kinds that a fit may begin with: an arm of rubber imitates whatever else is wrong, and takes long to follow."""
    kinds = task.question.kinds if task.law is None else ()
    return [name for name in kinds if LAWS[name].memory is None or LAWS[name].is_friction]


def _found(task: Task, model: Model, start: Start, begin: Callable[..., tuple[Model, Start]]) -> Found:
    """Where the search ends; it begins with the runs without loading where all runs together lead astray."""
    found: Found | None = None
    failed: Exception | None = None
    try:
        found = find_model(model, start, replace(task.question, repeatability=task.repeatability), progress=task.say)
    except NO_FIT as error:
        failed = error
    reference = [run for run in model.runs if not run.loading.any()]
    is_unclear = found is None or (not is_noise(found.fit) and not found.is_unlike)
    # what is known in kg or N inside of a structure gives the scale with any run
    needs_loading = model.mass_free and not is_mass_free(reference, model.body)
    if is_unclear and reference and needs_loading and model.body.fall is not None:
        found = _from_reference(task, found, model, lambda: begin(reference, mass_free=False))
    if found is None:
        assert failed is not None  # no fit without an error
        raise failed
    return found


def _with_departures(
    task: Task, found: Found, model: Model, start: Start, begin: Callable[..., tuple[Model, Start]]
) -> Found:
    """Where a search ended, with springs, damping and friction of each run let go.

    The search began with runs that are alike. Where letting them go mends much, and they left more than noise, laws and
    faults are searched again.
    Runs that are stated to be alike are let go where that mends much and leaves no more than noise.
    """
    level = task.prior_repeatability
    if (is_hopeless(found.fit) and not found.is_unlike) or runs_contradict_each_other(found.fit):
        return found
    freed = with_departures(found.fit, level)
    now = replace(found, fit=freed, demands=tuple(demand.updated(freed) for demand in found.demands))
    if not mends_much(freed, found.fit):
        return now if task.repeatability else found
    if leaves_noise(found.fit) or task.is_for_comparison:
        # no law and no fault was made up for what is not alike
        return now
    try:
        other = partial(begin, repeatability=level)
        again = _found(task, replace(model, repeatability=level), start, other)
        now = again if is_likelier(again.fit, freed) else now
    except (*NO_FIT, NotDeterminedError):
        pass
    return now if task.repeatability or is_noise(now.fit) else found


def _from_reference(
    task: Task, found: Found | None, model: Model, begin: Callable[[], tuple[Model, Start]]
) -> Found | None:
    """The better of a fit and of one that begins with the runs without loading: they need no mass to rest."""
    try:
        alone, start = begin()
        laws = [group.law for group in start.groups] + ([] if found is None else [*found.fit.laws.values()])
        is_in_vain = found is not None and explains_nothing(found.fit)
        if not any(map(depends_on_travel if is_in_vain else _leads_astray, laws)):
            return found
        if is_in_vain and begins_in_vain(alone, start, task.question):
            # no single run is explained either, so no mass is in the way
            return found
        first = find_model(alone, start, replace(task.question, faults=False), progress=task.say).fit
        fraction = model.settings.faults.alone_fraction
        is_alike = found is not None and first.ratio > fraction * found.fit.ratio
        if is_alike or not any(map(_leads_astray, first.laws.values())):
            return found
        again = find_from_reference(model, first, start, task.question, progress=task.say)
    except (*NO_FIT, NotDeterminedError):
        return found
    return again if again is not None and (found is None or is_likelier(again.fit, found.fit)) else found


def _leads_astray(law: Law) -> bool:
    """Whether fits of a law easily end in a wrong minimum where the mass is fitted, too.

    It needs to know where the suspension rests, or it remembers.
    """
    return depends_on_travel(law) or law.has_memory


def is_mass_free(runs: Sequence[DrivenRun], body: Body) -> bool:
    """Return whether one over the reference mass is fitted: something is known in kg or N, or the loading changes."""
    springs = any(spring.stiffness_n_per_m or spring.damping_n_s_per_m for spring in body.inside)
    changes = loading_changes([run.loading for run in runs])
    return not body.absolute and (changes or springs or bool(body.known.any()))
