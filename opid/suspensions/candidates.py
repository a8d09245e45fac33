"""Candidate structures for the same data: each gear alone, symmetric pairs, one rigid body.

A gear alone, or the mean of a pair, is a body with heave alone and one interface. Predictor, search and noise are the
same as for the whole body, so that residuals can be compared.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from opid.errors import NotDeterminedError
from opid.mechanics.laws.law import LAWS, Law
from opid.mechanics.weight import GRAVITY_M_PER_S2, depends_on_travel
from opid.progress import Say
from opid.signals.recording import FloatArray
from opid.suspensions.answer.intervals import Parameters, known_parameters
from opid.suspensions.answer.model_error import (
    ModelError,
    follow_freely,
    measure_model_error,
    unknown_error,
    weigh_by_process_noise,
)
from opid.suspensions.fitting.faults import Demand, implausible_demands
from opid.suspensions.fitting.fit import (
    NO_FIT,
    Fit,
    balance_runs,
    carry_over,
    explains_nothing,
    fit_model,
    loading_changes,
    runs_contradict_each_other,
    unexplained,
)
from opid.suspensions.fitting.noise import (
    KnownNoise,
    is_noise,
    is_noise_above_stated,
    is_of_others,
    mean_level,
    measure_coherence,
    with_noise_of_errors,
    with_noise_of_the_band,
    with_own_noise,
)
from opid.suspensions.fitting.repeatability import (
    Repeatability,
    is_much_better,
    repeatability_of,
    with_departures,
    with_own_repeatability,
)
from opid.suspensions.fitting.search import (
    Ladder,
    Question,
    SearchResult,
    asks_for_law,
    find_from_reference,
    find_model,
    is_hopeless,
    is_likelier,
    is_start_useless,
    judge_search,
    leaves_noise,
    with_laws_of,
    with_simpler_laws,
)
from opid.suspensions.fitting.start import Start, start_values
from opid.suspensions.law_search.pursuit import chosen
from opid.suspensions.model.body import Body, Scale, rigid_body, vertical, with_strut_sensors
from opid.suspensions.model.driven_model import Model, noise_level
from opid.suspensions.model.run import DrivenRun, driven_run
from opid.suspensions.model.unknowns import Group
from opid.suspensions.sensor_facts import TRAVEL_PER_S2, USUAL_GAIN_TOLERANCE, Sensors, TravelSensor
from opid.suspensions.settings import Settings, Verdicts
from opid.suspensions.study import Axis, PointMass, Study
from opid.suspensions.weighing import PriorMass

Noise = tuple[FloatArray, FloatArray]
Arrays = Sequence[tuple[FloatArray, FloatArray, FloatArray]]
"""For each run the accelerations below, (n, n_interfaces), on the body, (n, n_sensors), and across, (n, n_leaks)."""

# a gear that carries less than this fraction of a loading carries none of it
_LEAST_FRACTION = 1e-3
# gears are on one line if they are less than this fraction of its length away from it
_ONE_LINE = 0.01


@dataclass(frozen=True, eq=False)
class Task:
    """The data and options that are common to all candidate structures.

    Args:
        study: the study; None for a user's own structure.
        arrays: accelerations of the runs, single spikes mended.
        sensors: facts known of the sensors.
        noise: the noise level known before the fit, m/s^2.
        law: the law to be fitted, with start values; None if laws are searched.
        question: what a search may try.
        settings: settings of the estimator.
        say: called with the name of each step as it begins.
        run_names: names of the runs.
        stated_repeatability: relative standard deviation of springs, damping and friction from run to run; None for the
            usual value.
        is_for_comparison: whether the answer is about another structure. This structure is then not searched again if
            its runs differ.
    """

    study: Study | None
    arrays: Arrays
    sensors: Sensors
    noise: KnownNoise
    law: Law | None
    question: Question
    settings: Settings
    say: Say
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
        """Prior standard deviation of the departures: the usual one if the study states that there are none."""
        return self.repeatability or self.settings.repeatability.usual


@dataclass(frozen=True)
class WrongForce:
    """A sensor of a force that reads something else than the other sensors say.

    Args:
        channel: its channel.
        reads_n: what it reads for 1 N, in the run in which it is furthest off.
        tolerance: standard deviation of that, as it is stated.
    """

    channel: str
    reads_n: float
    tolerance: float

    @property
    def words(self) -> str:
        """What it reads, in words."""
        return f"{self.channel!r} reads {self.reads_n:.3g} N for each N (stated to be right to {self.tolerance:.2g})"


@dataclass(frozen=True, eq=False)
class FittedStructure:
    """One structure fitted to the runs.

    Args:
        kind: "single", "pair" or "rigid_body".
        interfaces: indices of its interfaces in the study.
        found: the end of the search; None if there is no fit.
        noise: noise of each sensor below and on the body known beforehand, m/s^2.
        task: data and options of the fit.
        reason: why there is no fit; "" if there is one.
        error: what limits the answer if the residual exceeds the noise known beforehand; for a rigid body None if it is
            the model.
        wrong_forces: the sensors of forces that contradict each other; no stated gain of a force is then used.
    """

    kind: str
    interfaces: tuple[int, ...]
    found: SearchResult | None
    noise: Noise
    task: Task
    reason: str = ""
    error: ModelError | None = None
    wrong_forces: tuple[WrongForce, ...] = ()

    @property
    def settings(self) -> Settings:
        """Settings of the estimator."""
        return self.task.settings

    @property
    def has_fit(self) -> bool:
        """Whether there is a fit."""
        return self.found is not None

    @property
    def fit(self) -> Fit:
        """The fit; NotDeterminedError if there is none."""
        if self.found is None:
            raise NotDeterminedError(self.reason)
        return self.found.fit

    @property
    def ladder(self) -> Ladder:
        """Laws that were tried."""
        return () if self.found is None else self.found.ladder

    @property
    def demands(self) -> tuple[Demand, ...]:
        """Ground springs and sensor faults that were added to the model."""
        return () if self.found is None else self.found.demands

    @cached_property
    def implausible(self) -> tuple[Demand, ...]:
        """Sensor faults that the runs demand but that were not added, because they are larger than sensors have."""
        is_worth_it = self.task.question.faults and self.residual_over_noise > self.settings.verdicts.noted
        return implausible_demands(self.fit) if self.has_fit and is_worth_it else ()

    @property
    def is_noise_of_fit(self) -> bool:
        """Whether the noise is the residual of the fit because it is otherwise unknown."""
        return self.found is not None and self.task.noise.most > 1.0 and self.fit.model.most_noise == 1.0

    @property
    def level(self) -> float:
        """Noise known beforehand, as white noise of one level on all accelerometers, m/s^2."""
        below, above = self.noise
        n_strut = 0 if self.task.study is None else len(_list_struts(self.task.study, self.interfaces))
        return noise_level((below, above[: above.size - n_strut]))

    @property
    def law_is_given(self) -> bool:
        """Whether no law was searched."""
        return self.task.law is not None

    @property
    def runs(self) -> tuple[DrivenRun, ...]:
        """The fitted runs."""
        return self.fit.model.runs

    @property
    def residual_over_noise(self) -> float:
        """Noise that would explain the errors over the noise known beforehand, on the noisier side."""
        if self.found is None:
            return float("inf")
        sides = zip(self.fit.model.noise, self.noise, strict=True)
        return self.fit.ratio * max(mean_level(now.tolist()) / mean_level(known.tolist()) for now, known in sides)

    @property
    def left_out_over_noise(self) -> float | None:
        """The same ratio for runs that are predicted from the others; None if there is none."""
        if self.found is None or not self.ladder:
            return None
        left_out = chosen(self.ladder).left_out
        return None if left_out is None else left_out / self.level

    @property
    def lack(self) -> float:
        """The larger of the two ratios."""
        return max(self.residual_over_noise, self.left_out_over_noise or 0.0)

    @cached_property
    def unexplained(self) -> tuple[float, ...]:
        """For each run, the rms error of the model's free motion as a fraction of the rms of the readings."""
        return unexplained(self.fit)

    @property
    def explains(self) -> bool:
        """Whether the residual is noise, also in runs predicted from the others, or does not limit a rigid body."""
        return self.lack <= self.settings.verdicts.explained or (self.kind == "rigid_body" and self.error is not None)

    @property
    def is_pushed(self) -> bool:
        """Whether unmeasured forces move a rigid body and leave more than noise."""
        return self.kind == "rigid_body" and self.error is not None and self.error.limit == "unmeasured forces"

    @property
    def is_hopeless(self) -> bool:
        """Whether the residual is too large for any law to explain."""
        return self.found is not None and is_hopeless(self.fit)

    @cached_property
    def known(self) -> Parameters:
        """The parameters of the fit with their covariance."""
        # A model error of one gear widens the intervals, because no other structure is possible.
        more = 0.0 if self.error is None else self.error.spread
        return known_parameters(self.fit, self.task.prior_repeatability, more)

    @cached_property
    def repeatability(self) -> Repeatability:
        """Repeatability of the suspensions in the runs."""
        is_usual = self.task.stated_repeatability is None
        return repeatability_of(self.fit, self.known.levels, self.task.repeatability, is_usual=is_usual)


@dataclass(frozen=True, eq=False)
class Choice:
    """The structure that the answer is about.

    Args:
        study: the study.
        tried: all structures that were fitted.
        kind: kind of the chosen structure.
        why: reason of the choice, one sentence.
    """

    study: Study
    tried: Sequence[FittedStructure]
    kind: str
    why: str

    @cached_property
    def parts(self) -> list[FittedStructure]:
        """The fits that make up the answer."""
        return [part for part in parts_of(self.tried, self.kind) if part.has_fit]

    def names(self, parts: Sequence[FittedStructure]) -> str:
        """Return the names of the interfaces of some structures."""
        return ", ".join(self.study.names[k] for part in parts for k in part.interfaces)

    @property
    def ratio(self) -> float:
        """Largest residual over the noise of all parts."""
        return max(part.residual_over_noise for part in self.parts)

    @property
    def lack(self) -> float:
        """The same, or that of runs predicted from the others if it is larger."""
        return max(part.lack for part in self.parts)

    @property
    def explains(self) -> bool:
        """Whether all parts leave only noise, or the effect of unmeasured forces."""
        return all(part.explains for part in self.parts)

    @property
    def verdicts(self) -> Verdicts:
        """Thresholds of the whole package."""
        return self.parts[0].settings.verdicts


def parts_of(tried: Sequence[FittedStructure], kind: str) -> list[FittedStructure]:
    """Return the structures that make up an answer of a kind, those without a fit among them."""
    if kind == "rigid_body":
        return [each for each in tried if each.kind == "rigid_body"]
    pairs = [each for each in tried if each.kind == "pair"] if kind == "pair" else []
    paired = {k for each in pairs for k in each.interfaces}
    return [*pairs, *(each for each in tried if each.kind == "single" and each.interfaces[0] not in paired)]


def static_loads(study: Study, loading: PointMass) -> FloatArray:
    """Return how much of a mass rests on each interface, (n,) kg; the sum is the mass, wherever the origin is.

    Statics determine three loads; more than three are as equal as statics allow. Interfaces on one line follow the
    lever rule about the foot of the perpendicular from the mass.
    """
    positions = np.array([interface.place for interface in study.interfaces])
    middle = positions.mean(axis=0)
    lever = np.array([loading.x_m, loading.y_m]) - middle
    uneven = np.linalg.pinv((positions - middle).T, rcond=_ONE_LINE) @ lever
    return np.asarray(loading.mass_kg * (1 / len(positions) + uneven))


@dataclass(frozen=True, eq=False)
class StructureData:
    """Runs, body, groups and sensors of one structure, as its model takes them.

    Args:
        runs: the runs.
        body: the body.
        groups: the groups of interfaces, without laws.
        sensors: facts known of the sensors.
    """

    runs: tuple[DrivenRun, ...]
    body: Body
    groups: tuple[Group, ...]
    sensors: Sensors


def fit_alone(task: Task, interfaces: tuple[int, ...]) -> FittedStructure:
    """Fit the mean of some interfaces as one gear under its part of the mass."""
    assert task.study is not None  # a user's own structure has no gears to leave alone
    picked = list(interfaces)
    kind = "single" if len(picked) == 1 else "pair"
    noise = tuple(np.atleast_1d(np.sqrt(np.sum(side[picked] ** 2)) / len(picked)) for side in task.noise.levels)
    struts = _list_struts(task.study, picked)
    if struts:
        n_above = len(task.sensors.sprung) - len(task.study.strut_sensors)
        noise = noise[0], np.append(noise[1], task.noise.levels[1][[n_above + k for k in struts]])
    try:
        data = prepare_alone(task.study, task.arrays, task.sensors, interfaces, settings=task.settings)
    except NotDeterminedError as error:
        return FittedStructure(kind, interfaces, None, noise, task, str(error))  # type: ignore[arg-type]
    return fit_structure(task, kind, interfaces, data, noise)  # type: ignore[arg-type]


def prepare_alone(
    study: Study, arrays: Arrays, sensors: Sensors, interfaces: tuple[int, ...], *, settings: Settings
) -> StructureData:
    """Return the mean of some interfaces as one gear under its part of the mass.

    Raises:
        NotDeterminedError: sensors of one side with different AC couplings, or several gears with sensors of struts.
    """
    picked, runs = list(interfaces), []
    alone, leaking = sensors.mean_of(picked), sensors.leaks_into(picked)
    struts, n_above = _list_struts(study, picked), len(sensors.sprung) - len(study.strut_sensors)
    if struts and len(picked) > 1:
        raise NotDeterminedError("the mean of gears with sensors of a travel or a force is that of no gear")
    if struts:
        alone = replace(
            alone,
            sprung=(*alone.sprung, *(sensors.sprung[n_above + k] for k in struts)),
            names=(*alone.names, *(sensors.names[n_above + k] for k in struts)),
        )
    for number, (run, (below, above, across)) in enumerate(zip(study.runs, arrays, strict=True)):
        change = sum(float(static_loads(study, each)[picked].mean()) for each in run.masses)
        if abs(change) < _LEAST_FRACTION * sum(abs(each.mass_kg) for each in run.masses):
            change = 0.0
        runs.append(
            driven_run(
                below[:, picked].mean(axis=1),
                np.column_stack([above[:, picked].mean(axis=1), *(above[:, n_above + k] for k in struts)]),
                fs=study.fs,
                loading=change,
                leaks=across[:, leaking] / len(picked),
                number=number,
                settings=settings.runs,
                n_strut=len(struts),
                is_driven=study.is_driven,
            )
        )
    name = "" if study.is_one_gear else ", ".join(study.names[k] for k in picked)
    areas = [study.interfaces[k].piston_area_m2 or 0.0 for k in picked]
    body = gear_body(study.interfaces[picked[0]].axis)
    body = replace(body, piston_area_m2=min(areas) and float(np.mean(areas)))
    body = _with_struts(body, study, picked)
    return StructureData(tuple(runs), body, (Group(name, (0,)),), alone)


def gear_body(axis: Axis = "up") -> Body:
    """Return a gear alone: a mass that heaves on one interface."""
    one = np.ones((1, 1))
    body = Body(("heave",), one, (), np.zeros((0, 1, 1)), np.zeros((1, 1)), one, one)
    return replace(body, fall=_compute_fall(axis, body))


def _list_struts(study: Study, interfaces: Sequence[int]) -> list[int]:
    """Return the numbers of the strut sensors of some interfaces."""
    return [number for number, (k, _) in enumerate(study.strut_sensors) if k in interfaces]


def _with_struts(body: Body, study: Study, interfaces: Sequence[int]) -> Body:
    """Return a body on some interfaces with the strut sensors that they have."""
    struts = _list_struts(study, interfaces)
    if not struts:
        return body
    travels, forces, scales = dict[int, int](), dict[int, int](), list[Scale]()
    for channel, number in enumerate(struts, start=len(body.readings)):
        interface, sensor = study.strut_sensors[number]
        attachment = list(interfaces).index(interface)
        if isinstance(sensor, TravelSensor):
            travels[channel] = attachment
            continue
        forces[channel] = attachment
        if sensor.gain_tolerance is not None:
            # The mass is the force over the acceleration, whose gain is fitted where its tolerance is stated.
            beside = 0.0 if study.interfaces[interface].facts.sprung.gain_tolerance else USUAL_GAIN_TOLERANCE
            tolerance = math.hypot(sensor.gain_tolerance, beside)
            scales.append(Scale(channel, 1.0 / study.strut_scales[number], tolerance))
    n_sensors = len(body.readings) + len(struts)
    found = with_strut_sensors(body, n_sensors, travels, forces, travel_per_s2=TRAVEL_PER_S2)
    return replace(found, scales=tuple(scales))


def _compute_fall(axis: Axis, body: Body) -> FloatArray | None:
    """Return the acceleration of a body in free fall; heave is its first degree of freedom."""
    others: list[Axis] = ["horizontal"] * (len(body.dof) - 1)
    return fall_of([axis, *others])


def fall_of(axes: Sequence[Axis]) -> FloatArray | None:
    """Return the acceleration of a body in free fall, (n_dof,) m/s^2; None if no weight acts on it.

    Each axis says in which direction a degree of freedom counts positive; it is "horizontal" if no weight moves it.
    """
    signs = {"up": -1.0, "down": 1.0, "horizontal": 0.0}
    fall = GRAVITY_M_PER_S2 * np.array([signs[axis] for axis in axes])
    return fall if fall.any() else None


def fit_rigid(task: Task) -> FittedStructure:
    """Fit one rigid body on all interfaces."""
    assert task.study is not None  # a user's own structure is no rigid airframe
    data = prepare_rigid(task.study, task.arrays, task.sensors, settings=task.settings)
    every = tuple(range(len(task.study.interfaces)))
    return fit_structure(task, "rigid_body", every, data, task.noise.levels)


def prepare_rigid(study: Study, arrays: Arrays, sensors: Sensors, *, settings: Settings) -> StructureData:
    """Return one rigid body on all interfaces."""
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
            number=index,
            settings=settings.runs,
            n_strut=len(study.strut_sensors),
            is_driven=study.is_driven,
        )
        for index, (below, above, across) in enumerate(arrays)
    ]
    body = replace(body, fall=_compute_fall(study.interfaces[0].axis, body))
    body = _with_struts(body, study, range(len(study.interfaces)))
    return StructureData(tuple(runs), body, groups_of(study), sensors)


def loading_matrix(study: Study, index: int) -> FloatArray:
    """Return the mass matrix of a loading about the origin, (3, 3) kg, kg m, kg m^2."""
    total = np.zeros((3, 3))
    for each in study.runs[index].masses:
        row = vertical(each.x_m, each.y_m)
        total += each.mass_kg * np.outer(row, row)
    return total


def groups_of(study: Study) -> tuple[Group, ...]:
    """Return the groups of interfaces that share a suspension, in the order of the first of each group."""
    together = {name: group for group in study.structure.shared for name in group}
    found: dict[str, Group] = {}
    for name in study.names:
        members = together.get(name, (name,))
        attachments = tuple(k for k, each in enumerate(study.names) if each in members)
        label = ", ".join(study.names[k] for k in attachments)
        found.setdefault(label, Group(label, attachments))
    return tuple(found.values())


def fit_structure(
    task: Task,
    kind: str,
    interfaces: tuple[int, ...],
    data: StructureData,
    noise: Noise,
    *,
    start: Start | None = None,
) -> FittedStructure:
    """Fit a body: start values from its equation of motion, the model, laws, faults, and fits without one run."""
    runs, body, groups, sensors = data.runs, data.body, data.groups, data.sensors
    mass_free, settings = is_mass_free(runs, body), task.settings
    if task.law is not None:
        groups = tuple(replace(group, law=task.law) for group in groups)
    begin = partial(
        _begin_model,
        task,
        body=body,
        groups=groups,
        sensors=sensors,
        noise=noise,
        most_noise=task.noise.most,
        start=start,
    )
    try:
        model, start = begin(runs, mass_free=mass_free)
        found = _search_model(task, model, start, begin)
        found = replace(found, fit=with_noise_of_the_band(found.fit))
        noise, most = found.fit.model.noise, found.fit.model.most_noise
        model, begin = replace(model, noise=noise, most_noise=most), partial(begin, noise=noise, most_noise=most)
        if len(runs) > 1:
            found = _with_departures(task, found, model, start, begin)
            found = replace(found, fit=with_noise_of_the_band(found.fit))
        noise = found.fit.model.noise
        found = judge_search(found, task.question)
        # The noise of the two sides can be distinguished only if the model explains the runs.
        if found.fit.ratio < settings.faults.nearly_explained:
            found = replace(found, fit=with_own_noise(found.fit))
        if not is_hopeless(found.fit):
            found = replace(found, fit=with_own_repeatability(found.fit))
    except (*NO_FIT, NotDeterminedError) as error:
        return FittedStructure(kind, interfaces, None, noise, task, str(error))
    updated = tuple(demand.update(found.fit) for demand in found.demands)
    part = FittedStructure(kind, interfaces, replace(found, demands=updated), noise, task)
    if kind == "rigid_body" and part.residual_over_noise > settings.verdicts.explained:
        return _with_error_of_body(part)
    if task.study is None or not task.study.is_one_gear or part.residual_over_noise <= settings.verdicts.noted:
        return part
    return _with_error(part)


def _with_error_of_body(part: FittedStructure) -> FittedStructure:
    """Return a rigid body that leaves more than noise, with its model error if unmeasured forces are the limit.

    The residual of a wrong structure is coherent with the motion below the suspensions.
    """
    found, stated, known = part.found, part.task.repeatability, part.settings.process
    assert found is not None  # it leaves something
    try:
        if part.task.law is None and is_hopeless(found.fit) and measure_coherence(found.fit) < known.most_coherent:
            part.task.say("laws under process noise")
            found = with_laws_of(found, weigh_by_process_noise(found.fit), part.task.question, part.task.say)
        is_above_stated = is_noise_above_stated(found.fit, part.task.noise)
        if not (is_above_stated or is_of_others(found.fit)):
            return part
        if part.task.law is not None and asks_for_law(found.fit, part.task.question.kinds):
            return part
        if stated and not found.fit.model.repeatability and len(part.runs) > 1:
            # The search took the runs to be alike, because no number was expected to be reported.
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


def _with_error(part: FittedStructure) -> FittedStructure:
    """Return one gear that leaves more than noise, with what limits its answer."""
    found, stated = part.found, part.task.repeatability
    assert found is not None  # it leaves something
    try:
        if is_hopeless(found.fit) and len(part.runs) > 1:
            found = replace(found, fit=balance_runs(found.fit))
        if is_hopeless(found.fit) and explains_nothing(found.fit):
            fit, error = follow_freely(found.fit, unknown_error(found.fit))
            if explains_nothing(fit):
                # The fit is refused, whatever limits it.
                return replace(part, found=replace(found, fit=fit), error=error)
        # A wrong law can leave the same residual with either weighting, as an unmeasured force does, and still bias the
        # mass. Without a free mass there is none to bias.
        contradicts = _contradicts_a_fact(found.fit)
        is_wrong = contradicts or (
            part.task.law is not None
            and found.fit.model.mass_free
            and asks_for_law(found.fit, part.task.question.kinds)
        )
        error = measure_model_error(
            found.fit, is_wrong=is_wrong, is_noise=is_noise_above_stated(found.fit, part.task.noise)
        )
        if error.limit == "unmeasured forces" and stated and not found.fit.model.repeatability and len(part.runs) > 1:
            # The search took the runs to be alike, because no number was expected to be reported.
            found = replace(found, fit=with_own_repeatability(with_departures(found.fit, stated)))
            error = measure_model_error(found.fit)
        if error.limit == "model" and part.task.law is None:
            # A term that compensates for a model error biases the others; without it they may be right.
            for simpler in with_simpler_laws(found, part.task.question.kinds):
                of_simpler = measure_model_error(simpler.fit)
                if of_simpler.limit != "model":
                    found, error = simpler, of_simpler
                    break
        if error.limit == "model":
            fit, error = follow_freely(found.fit, replace(error, contradicts_a_fact=contradicts))
            found = replace(found, fit=fit)
    except NO_FIT as failed:
        return replace(part, found=None, reason=str(failed))
    return replace(part, found=found, error=error)


def _contradicts_a_fact(fit: Fit) -> bool:
    """Return whether a fit contradicts a known fact about a sensor, so that the model or the fact is wrong.

    At the bound of a fact the fit was stopped: it is at no minimum, and has no covariance. If only ratios to the mass
    are determined, a contradiction within the bounds counts, too: it widens their intervals and withholds nothing.
    """
    model, indices = fit.model, [fit.model.names.index(fault.name) for fault in fit.model.faults]
    (lower, upper), value = model.bounds(), fit.theta[indices]
    moves = ~model.held[indices]
    if np.any(moves & ((value <= lower[indices]) | (value >= upper[indices]))):
        return True
    off = [abs(own - fault.nominal) / fault.std for own, fault in zip(value, model.faults, strict=True)]
    return not model.mass_free and max(off, default=0.0) > model.settings.faults.contradicted_std


def _begin_model(
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
    """Return the model of some runs and its start values."""
    if start is None:
        is_by_force = mass_free and not is_mass_free(runs, replace(body, scales=()))
        start = start_values(
            runs,
            body,
            groups,
            mass_free=mass_free and not is_by_force,
            # An AC coupling removes slow motion, which has the same effect as a ground spring.
            ground=task.question.ground and not sensors.has_coupling,
            kinds=_list_kinds_of_start(task),
            lags=[fault for fault in sensors.faults if fault.kind == "lag"] if body.n_interfaces == 1 else (),
            settings=task.settings.start,
        )
        if is_by_force:
            start = replace(start, inverse_mass=float(np.mean([1.0 / scale.kg for scale in body.scales])))
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


def _list_kinds_of_start(task: Task) -> list[str]:
    """Return the kinds that a fit may begin with.

    A viscoelastic arm is left out, because it compensates for other errors and its fit takes long.
    """
    kinds = task.question.kinds if task.law is None else ()
    return [name for name in kinds if LAWS[name].memory is None or LAWS[name].is_friction]


def _search_model(task: Task, model: Model, start: Start, begin: Callable[..., tuple[Model, Start]]) -> SearchResult:
    """Search laws and faults; if all runs together end at a wrong minimum, begin with the runs without loading."""
    found: SearchResult | None = None
    failed: NotDeterminedError | None = None
    try:
        found = find_model(model, start, replace(task.question, repeatability=task.repeatability), progress=task.say)
    except NO_FIT as error:
        failed = error
    reference = [run for run in model.runs if not run.loading.any()]
    is_unclear = found is None or (not is_noise(found.fit) and not found.is_unlike)
    # Masses or springs inside a structure that are known in kg or N/m give the scale with any run.
    needs_loading = bool(reference) and model.mass_free and not is_mass_free(reference, model.body)
    if is_unclear and needs_loading and model.body.fall is not None:
        found = _search_from_reference(task, found, model, lambda: begin(reference, mass_free=False))
    if found is None:
        assert failed is not None  # no fit without an error
        raise failed
    return found


def _with_departures(
    task: Task, found: SearchResult, model: Model, start: Start, begin: Callable[..., tuple[Model, Start]]
) -> SearchResult:
    """Return the end of a search, fitted with departures of springs, damping and friction in each run.

    The search took the runs to be alike. If departures explain much more, and the residual was more than noise, laws
    and faults are searched again. Runs that are stated to be alike get departures only if these explain much more and
    leave no more than noise.
    """
    level = task.prior_repeatability
    if (is_hopeless(found.fit) and not found.is_unlike) or runs_contradict_each_other(found.fit):
        return found
    freed = with_departures(found.fit, level)
    now = replace(found, fit=freed, demands=tuple(demand.update(freed) for demand in found.demands))
    if not is_much_better(freed, found.fit):
        return now if task.repeatability else found
    if leaves_noise(found.fit) or task.is_for_comparison:
        # No law and no fault has compensated for the differences between the runs.
        return now
    try:
        other = partial(begin, repeatability=level)
        again = _search_model(task, replace(model, repeatability=level), start, other)
        now = again if is_likelier(again.fit, freed) else now
    except (*NO_FIT, NotDeterminedError):
        pass
    return now if task.repeatability or is_noise(now.fit) else found


def _search_from_reference(
    task: Task, found: SearchResult | None, model: Model, begin: Callable[[], tuple[Model, Start]]
) -> SearchResult | None:
    """Return the better of a fit and of one from the runs without loading, which rest where no mass matters."""
    try:
        alone, start = begin()
        laws = [group.law for group in start.groups] + ([] if found is None else [*found.fit.laws.values()])
        is_in_vain = found is not None and explains_nothing(found.fit)
        if not any(map(depends_on_travel if is_in_vain else _has_false_minima, laws)):
            return found
        if is_in_vain and is_start_useless(alone, start, task.question):
            # The runs without loading are not explained either, so the mass is not the reason.
            return found
        first = find_model(alone, start, replace(task.question, faults=False), progress=task.say).fit
        fraction = model.settings.faults.alone_fraction
        is_alike = found is not None and first.ratio > fraction * found.fit.ratio
        if is_alike or not any(map(_has_false_minima, first.laws.values())):
            return found
        again = find_from_reference(model, first, start, task.question, progress=task.say)
    except (*NO_FIT, NotDeterminedError):
        return found
    return again if again is not None and (found is None or is_likelier(again.fit, found.fit)) else found


def _has_false_minima(law: Law) -> bool:
    """Whether fits of a law easily end at a wrong minimum if the mass is fitted, too.

    The law depends on the rest position, or it has memory.
    """
    return depends_on_travel(law) or law.has_memory


def with_prior_mass(part: FittedStructure, prior: PriorMass) -> FittedStructure:
    """Fit a structure that carries the whole mass once more, with prior knowledge of this mass.

    Args:
        part: a fitted structure.
        prior: what is known of its reference mass.

    Returns:
        The structure with the new fit; unchanged if the fit fails.
    """
    fit, found = part.fit, part.found
    assert found is not None  # it has a fit
    body = replace(fit.model.body, prior_mass_kg=prior.kg, prior_tolerance_kg=prior.tolerance_kg)
    model = replace(fit.model, body=body, mass_free=True)
    try:
        again = fit_model(model, carry_over(fit, model, {} if fit.model.mass_free else {"inverse_mass": 1 / prior.kg}))
    except NO_FIT:
        return part
    return replace(part, found=replace(found, fit=again))


def is_mass_free(runs: Sequence[DrivenRun], body: Body) -> bool:
    """Return whether one over the reference mass is fitted: a mass, a spring or a force is known, or loads change."""
    springs = any(spring.stiffness_n_per_m or spring.damping_n_s_per_m for spring in body.inside)
    changes = loading_changes([run.loading for run in runs])
    return not body.absolute and (changes or springs or bool(body.known.any()) or bool(body.scales))
