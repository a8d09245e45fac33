"""Demands of the runs: springs to the ground, and sensor faults that the study does not state.

All hypotheses are first ranked by score tests, in one simulation. Those with the highest scores are fitted, and the
best one is kept if the information criterion confirms it; then the others are tried again. Some hypotheses have nearly
the same effect (for example a gain error and a ground spring): all that explain the runs about as well as the one that
was added are reported. The faults that imitate a ground spring, and its stiffness, are reported in any case.

A fault far beyond those of such sensors may compensate for something else. AC coupling is added nevertheless if it
leaves little, because nothing else has the same effect then. Other such faults are reported and not added.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from opid.mechanics.driven import UnboundedResponseError
from opid.progress import Say
from opid.signals.recording import FloatArray
from opid.suspensions.fitting.fit import NO_FIT, Fit, carry_over, fit_model, rows_with_departures
from opid.suspensions.fitting.start import Start
from opid.suspensions.model.driven_model import Model
from opid.suspensions.model.run import DrivenRun
from opid.suspensions.model.unknowns import GROUND
from opid.suspensions.sensor_facts import SensorFacts, Sensors, Side
from opid.suspensions.settings import FaultSettings, IntervalSettings


@dataclass(frozen=True)
class Hypothesis:
    """A ground spring or sensor faults that the model may lack.

    Args:
        words: the hypothesis in words.
        ground: whether it is springs to the ground.
        changes: otherwise the changes that make faults of sensors free: side, number and facts of each sensor.
        is_stated: whether the study states another value without a tolerance.
    """

    words: str = field(compare=False)
    ground: bool = False
    changes: tuple[tuple[Side, int, tuple[tuple[str, float], ...]], ...] = ()
    is_stated: bool = False

    @property
    def is_coupling(self) -> bool:
        """Whether it is AC coupling."""
        return any(name.startswith("corner") for _, _, facts in self.changes for name, _ in facts)

    def add_to(self, model: Model) -> Model:
        """Return the model with the hypothesis."""
        if self.ground:
            return replace(model, groups=tuple(replace(group, ground=True) for group in model.groups))
        sensors = model.sensors
        for side, channel, facts in self.changes:
            sensors = sensors.changed(side, channel, **dict(facts))
        return replace(model, sensors=sensors)

    def remove_from(self, model: Model) -> Model:
        """Return the model without the hypothesis."""
        if self.ground:
            return replace(model, groups=tuple(replace(group, ground=False) for group in model.groups))
        sensors = model.sensors
        for side, channel, facts in self.changes:
            sensors = sensors.changed(side, channel, **dict.fromkeys(dict(facts), 0.0))
        return replace(model, sensors=sensors)

    def with_corners_of(self, fit: Fit) -> Hypothesis:
        """Return an AC coupling with the corners of a fit as nominal values, where they are above the usual one."""
        usual_hz = fit.model.settings.faults.corner_hz
        corners = [fault for fault in fit.model.faults if fault.kind == "corner"]
        corners_hz = {(each.side, each.channel): max(fit.value(each.name), usual_hz) for each in corners}
        changes = tuple(
            (side, channel, tuple({**dict(facts), "corner_hz": corners_hz[side, channel]}.items()))
            for side, channel, facts in self.changes
        )
        return replace(self, changes=changes)

    def names(self, model: Model) -> tuple[str, ...]:
        """Return the names of its parameters."""
        before, after = self.remove_from(model).names, self.add_to(model).names
        return tuple(name for name in after if name not in before)


@dataclass(frozen=True)
class Demand:
    """A parameter that was added to the model because the runs demand it.

    Args:
        name: name of the parameter, "ground_stiffness_per_mass" or a fault of the sensors.
        words: the parameter in words.
        value: its estimate.
        std: its standard deviation.
        error_before: error without it, m/s^2.
        error_after: error with it, m/s^2.
        alike: hypotheses that would explain the runs as well.
        hypothesis: the hypothesis that it belongs to.
    """

    name: str
    words: str
    value: float
    std: float
    error_before: float
    error_after: float
    alike: tuple[str, ...]
    hypothesis: Hypothesis

    def update(self, fit: Fit) -> Demand:
        """Return the demand with its value in a later fit."""
        std = float(fit.std[fit.model.names.index(self.name)])
        return replace(self, value=fit.value(self.name), std=std, error_after=fit.noise_m_per_s2)


@dataclass(frozen=True, eq=False)
class _Standing:
    fit: Fit
    demands: tuple[Demand, ...]


def add_faults(
    fit: Fit,
    before: tuple[Demand, ...] = (),
    *,
    ground: bool,
    start: Start | None = None,
    progress: Say | None = None,
) -> tuple[Fit, tuple[Demand, ...]]:
    """Return the fit with the ground springs and sensor faults that the runs demand, and these demands.

    Demands from before are removed if the runs no longer demand them. The start values are those of springs to the
    ground.
    """
    say, known = progress or (lambda step: None), fit.model.settings.faults
    runs = fit.model.runs
    standing = now = _Standing(fit, tuple(demand.update(fit) for demand in before))
    # Faults that explain the runs only together are added together: `standing` is the last state that explained more.
    for _ in range(known.most):
        promising, tried = _rank_hypotheses(now.fit, ground, start), []
        if not promising:
            break
        # Hypotheses are compared at a coarse rate, and the best one is confirmed with all samples.
        coarse = _fit_at_runs(now.fit, now.fit.model.coarse.runs)
        for hypothesis in promising:
            say(hypothesis.words)
            grown = _add_to_fit(coarse, hypothesis, start)
            if grown is None:
                continue
            explains = False
            if _is_plausible(grown, hypothesis):
                explains = grown.ratio < fit.model.settings.verdicts.noted
                tried.append((grown, hypothesis))
            if hypothesis.is_coupling and not explains:
                tried += _search_farther_corners(coarse, grown, hypothesis)
        if not tried:
            break
        best, hypothesis = min(tried, key=lambda entry: entry[0].bic)
        if not _is_better(best, coarse, known):
            break
        alike = tuple(h.words for other, h in tried if h is not hypothesis and other.bic < best.bic + known.alike_bic)
        best = _fit_at_runs(best, runs)
        if not _is_better(best, now.fit, known):
            break
        new = tuple(_make_demands(best, hypothesis, now.fit.noise_m_per_s2, alike))
        helps = now is standing and best.noise_m_per_s2 < (1 - known.helps_fraction) * now.fit.noise_m_per_s2
        now = _Standing(best, (*(demand for demand in now.demands if demand.name in best.model.names), *new))
        if helps or best.ratio < known.nearly_explained:
            standing = now
    standing = _remove_implausible(_remove_useless(standing, known))
    return standing.fit, tuple(demand.update(standing.fit) for demand in standing.demands)


def find_coupling(fit: Fit) -> Hypothesis | None:
    """Return an AC coupling that is not stated if it lowers the error before laws are searched, else None.

    Laws that are searched later compensate for a coupling, and its score is meaningless while laws are missing.

    Args:
        fit: a fit with its first laws.
    """
    known = fit.model.settings.faults
    new = [each for each in _list_hypotheses(fit.model, False, known) if each.is_coupling and not each.is_stated]
    try:
        # A coupling removes slow motion, which has the same effect as a ground spring.
        bare = _drop_ground(fit) if new else fit
    except NO_FIT:
        return None
    # A coupling must help more than a ground spring, which a gain error demands, too.
    most_left = min((1 - known.coupling_helps) * bare.noise_m_per_s2, fit.noise_m_per_s2)
    for hypothesis in new:
        grown = _add_to_fit(bare, hypothesis, None)
        if grown is not None and grown.noise_m_per_s2 < most_left:
            return hypothesis
    return None


def demands_of(fit: Fit, hypothesis: Hypothesis, error_before: float) -> tuple[Demand, ...]:
    """Return the parameters that a hypothesis made free in a fit.

    Args:
        fit: the fit with the hypothesis.
        hypothesis: the hypothesis that was added.
        error_before: error without it, m/s^2.
    """
    return tuple(_make_demands(fit, hypothesis, error_before, ()))


def implausible_demands(fit: Fit) -> tuple[Demand, ...]:
    """Return faults that would explain much of what a fit leaves, but are far beyond those of such sensors.

    They were not added, because they may compensate for something else. Each is fitted alone at a coarse rate, without
    springs to the ground, which may only compensate for a gain error.
    """
    known, found = fit.model.settings.faults, list[Demand]()
    try:
        coarse = _fit_at_runs(fit, fit.model.coarse.runs)
        first = _drop_ground(coarse)
    except NO_FIT:
        return ()
    for hypothesis in _rank_hypotheses(first, False, None):
        grown = _add_to_fit(first, hypothesis, None)
        if grown is None or _is_plausible(grown, hypothesis) or not _is_better(grown, coarse, known):
            continue
        if grown.noise_m_per_s2 < (1 - known.helps_fraction) * coarse.noise_m_per_s2:
            found += _make_demands(grown, hypothesis, coarse.noise_m_per_s2, ())
    return tuple(found)


def scores(fit: Fit, model: Model, groups: Sequence[Sequence[str]]) -> list[float]:
    """Return by how much further free parameters would lower the squared whitened error, to first order.

    The larger model has all of these parameters. The names of a group are free together; the gain of the group is the
    largest gain of one of them while the others of the group are fitted.
    """
    errors = model.evaluate(carry_over(fit, model))
    # Prior knowledge is left out, except that of the departures between runs.
    rows = rows_with_departures(fit, model)
    jacobian, stacked = errors.jacobian[rows], errors.stacked[rows]
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    gram, along = (jacobian / size).T @ (jacobian / size), (jacobian / size).T @ stacked
    index = {name: k for k, name in enumerate(model.names)}
    new = {index[name] for group in groups for name in group}
    fitted = [k for k in range(size.size) if k not in new]
    return [
        max(
            _compute_gain(gram, along, [*fitted, *(index[n] for n in group if n != name)], index[name])
            for name in group
        )
        for group in groups
    ]


def _fit_at_runs(fit: Fit, runs: tuple[DrivenRun, ...]) -> Fit:
    """Fit the model to other samples of the same runs."""
    if all(a is b for a, b in zip(fit.model.runs, runs, strict=True)):
        return fit
    promise = fit.model.settings.fit.least_promise
    return fit_model(replace(fit.model, runs=runs), fit.theta, least_promise=promise)


def _compute_gain(gram: FloatArray, along: FloatArray, others: list[int], new: int) -> float:
    """Return the gain of a step along one column when all other columns are fitted, too."""
    cross = gram[new, others] @ np.linalg.pinv(gram[np.ix_(others, others)], rcond=1e-13, hermitian=True)
    size = 1.0 - float(cross @ gram[others, new])
    return float(along[new] - cross @ along[others]) ** 2 / size if size > 1e-10 else 0.0


def _is_better(fit: Fit, than: Fit, known: FaultSettings) -> bool:
    falls = fit.noise_m_per_s2 < (1 - known.error_margin) * than.noise_m_per_s2
    return fit.bic < than.bic - known.bic_margin and falls


def _is_plausible(fit: Fit, hypothesis: Hypothesis) -> bool:
    """Whether a fault is neither far beyond those of such sensors nor an AC coupling with negligible corners."""
    if hypothesis.is_coupling and not hypothesis.is_stated:
        return _has_corners(fit, hypothesis) and _is_near(fit, hypothesis)
    return _is_near(fit, hypothesis)


def _has_corners(fit: Fit, hypothesis: Hypothesis) -> bool:
    """Whether one of the corners is above the negligible one."""
    least_hz = fit.model.settings.faults.least_corner_hz
    return any(fit.value(name) > least_hz for name in hypothesis.names(fit.model))


def _is_near(fit: Fit, hypothesis: Hypothesis) -> bool:
    """Whether a fault is no larger than those of such sensors."""
    farthest, names = fit.model.settings.faults.plausible_std, hypothesis.names(fit.model)
    new = [fault for fault in fit.model.faults if fault.name in names]
    return all(abs(fit.value(each.name) - each.nominal) < farthest * each.std for each in new)


def _search_farther_corners(fit: Fit, grown: Fit, hypothesis: Hypothesis) -> Iterator[tuple[Fit, Hypothesis]]:
    """Yield fits with AC couplings whose corners are far from the usual one, if little is left with them.

    A spring to the ground may compensate for a coupling, so the search also begins at the fit without one.
    """
    known = fit.model.settings
    starts = [grown] if not _is_plausible(grown, hypothesis) else []
    if fit.model.ground:
        try:
            again = _add_to_fit(_drop_ground(fit), hypothesis, None)
        except NO_FIT:
            again = None
        starts += [] if again is None else [again]
    for now in starts:
        about = hypothesis
        for _ in range(known.faults.n_farther):
            if _is_plausible(now, about) or hypothesis.is_stated:
                break
            about = about.with_corners_of(now)
            model = about.add_to(now.model)
            try:
                now = fit_model(model, carry_over(now, model))
            except NO_FIT:
                break
        if now.ratio < known.verdicts.noted and (about.is_stated or _has_corners(now, about)):
            yield now, about


def without_ground(model: Model) -> Model:
    """Return the model without springs to the ground.

    Args:
        model: a model with or without them.
    """
    return Hypothesis("springs to the ground", ground=True).remove_from(model)


def has_doubtful_ground(fit: Fit) -> bool:
    """Return whether springs to the ground that the fit began with may be unnecessary.

    A sensor fault or a wrong law at the start may have demanded them. They can then hold the fit at a worse minimum,
    where they are small.
    """
    return fit.model.ground and (bool(fit.model.faults) or not _has_sure_ground(fit))


def _has_sure_ground(fit: Fit) -> bool:
    """Whether a spring to the ground differs clearly from zero."""
    springs = [fit.model.names.index(group.name_of(GROUND)) for group in fit.model.groups if group.ground]
    return bool(np.any(np.abs(fit.theta[springs]) > fit.model.settings.faults.sure_ground_std * fit.std[springs]))


def _drop_ground(fit: Fit) -> Fit:
    """Return the fit without springs to the ground."""
    if not fit.model.ground:
        return fit
    bare = without_ground(fit.model)
    return fit_model(bare, carry_over(fit, bare))


def _make_demands(fit: Fit, hypothesis: Hypothesis, before: float, alike: tuple[str, ...]) -> Iterator[Demand]:
    for name in hypothesis.names(fit.model):
        yield Demand(name, hypothesis.words, 0.0, 0.0, before, 0.0, alike, hypothesis).update(fit)


def _remove_useless(standing: _Standing, known: FaultSettings) -> _Standing:
    """Remove demands that others have made useless, the ground springs first."""
    fit, demands = standing.fit, standing.demands
    demanded = dict.fromkeys(demand.hypothesis for demand in demands)
    is_ground_demanded = any(each.ground for each in demanded)
    if has_doubtful_ground(fit) and not is_ground_demanded:
        demanded |= {Hypothesis("springs to the ground", ground=True): None}
    for hypothesis in sorted(demanded, key=lambda each: not each.ground):
        smaller = hypothesis.remove_from(fit.model)
        try:
            without = fit_model(smaller, carry_over(fit, smaller))
        except NO_FIT:
            continue
        if hypothesis.ground and not is_ground_demanded and not fit.model.faults:
            # The start values demanded the ground spring, and it stays if it does no harm.
            is_useless = _is_less_likely(fit, without, known)
        else:
            is_useless = not _is_better(fit, without, known)
        if is_useless:
            gone = hypothesis.names(fit.model)
            fit, demands = without, tuple(demand for demand in demands if demand.name not in gone)
    return _Standing(fit, demands)


def _is_less_likely(fit: Fit, than: Fit, known: FaultSettings) -> bool:
    """Whether a fit explains the runs clearly less well than one with fewer parameters: it is at a worse minimum."""
    n_more = fit.model.n_shared - than.model.n_shared
    return fit.bic - than.bic > known.alike_bic + n_more * float(np.log(fit.n_data))


def _remove_implausible(standing: _Standing) -> _Standing:
    """Remove demands that were plausible only together with something that was removed."""
    fit, demands = standing.fit, standing.demands
    for hypothesis in dict.fromkeys(demand.hypothesis for demand in demands):
        # Corners far from the usual one were searched on purpose.
        is_real = hypothesis.is_stated or _has_corners(fit, hypothesis)
        if is_real if hypothesis.is_coupling else _is_near(fit, hypothesis):
            continue
        smaller, gone = hypothesis.remove_from(fit.model), hypothesis.names(fit.model)
        try:
            fit = fit_model(smaller, carry_over(fit, smaller))
        except NO_FIT:
            continue
        demands = tuple(demand for demand in demands if demand.name not in gone)
    return _Standing(fit, demands)


def _rank_hypotheses(fit: Fit, ground: bool, start: Start | None) -> list[Hypothesis]:
    """Return the hypotheses with significant scores, the best first.

    A score test does not hold for a stiff ground spring; its score comes from the equation of motion.
    """
    known = fit.model.settings.faults
    hypotheses = list(_list_hypotheses(fit.model, ground, known))
    if not hypotheses:
        return []
    model = fit.model
    for hypothesis in hypotheses:
        model = hypothesis.add_to(model)
    model = replace(model, sensors=_make_slight(fit.model.sensors, model.sensors, known))
    try:
        gains = scores(fit, model, [hypothesis.names(fit.model) for hypothesis in hypotheses])
    except NO_FIT:
        return []
    found, refused = [], fit.model.settings.verdicts.refused
    for gain, hypothesis in zip(gains, hypotheses, strict=True):
        score = gain / fit.variance
        # Scores are taken at a negligible fault, which says little of a corner far from there.
        if fit.ratio > refused and score < known.good_fraction * fit.n_data and not hypothesis.is_coupling:
            continue
        if hypothesis.ground and start is not None:
            is_large = np.abs(start.ground_stiffness) > known.ground_fraction * np.abs(start.stiffness_beside_ground)
            score = max(score, float(np.max(is_large * (start.ground_stiffness / start.ground_std) ** 2)))
        found.append((score, hypothesis))
    found = sorted((entry for entry in found if entry[0] > known.least_score), key=lambda entry: -entry[0])
    return [hypothesis for _, hypothesis in found[: known.looked_at]]


def _make_slight(before: Sensors, after: Sensors, known: FaultSettings) -> Sensors:
    """Return the sensors with a negligible corner for each new AC coupling, at which its score is taken."""
    for side in ("unsprung", "sprung"):
        for channel, (was, now) in enumerate(zip(before.facts(side), after.facts(side), strict=True)):
            if now.corner_hz and not was.corner_hz:
                after = after.changed(side, channel, corner_hz=known.slight_corner_hz)
    return after


def _list_hypotheses(model: Model, ground: bool, known: FaultSettings) -> Iterator[Hypothesis]:
    """Yield the hypotheses that the model does not contain yet, with what is known of such faults in general."""
    below, above, names = model.sensors.unsprung, model.sensors.sprung, model.sensors.names
    if ground and not model.ground:
        yield Hypothesis("a spring to the ground" if len(model.groups) == 1 else "springs to the ground", ground=True)
    gain = (("gain_tolerance", known.gain_tolerance),)
    lag = (("lag_tolerance_s", known.lag_samples * model.runs[0].finer / model.runs[0].recorded_fs),)
    if len(above) == 1:
        if not (below[0].gain_tolerance or above[0].gain_tolerance):
            yield Hypothesis("a gain error between the sensors", changes=(("sprung", 0, gain),))
        if not (below[0].lag_tolerance_s or above[0].lag_tolerance_s or model.sensors.clocks):
            yield Hypothesis("a lag between the channels", changes=(("sprung", 0, lag),))
    else:
        for side, facts in (("sprung", above), ("unsprung", below)):
            for channel, each in enumerate(facts):
                if not each.gain_tolerance:
                    words = f"a gain error of the {side} sensor of {names[channel]!r}"
                    yield Hypothesis(words, changes=((side, channel, gain),))  # type: ignore[arg-type]
        for channel, each in enumerate(above):
            is_free = each.lag_tolerance_s or (channel < len(below) and below[channel].lag_tolerance_s)
            if not (is_free or model.sensors.clocks):
                words = f"a lag of the sprung sensor of {names[channel]!r}"
                yield Hypothesis(words, changes=(("sprung", channel, lag),))
    is_stated = any(each.corner_hz for each in (*below, *above))
    # A corner that is stated without a tolerance may be wrong nevertheless.
    words = "AC coupling with another corner" if is_stated else "AC coupling of the sensors"
    free = (("corner_tolerance", known.corner_tolerance),)
    coupled = free if is_stated else (("corner_hz", known.corner_hz), *free)
    sides: tuple[tuple[Side, Sequence[SensorFacts]], ...] = (("unsprung", below), ("sprung", above))
    changes = tuple(
        (side, channel, coupled)
        for side, facts in sides
        for channel, each in enumerate(facts)
        if bool(each.corner_hz) == is_stated and not each.corner_tolerance
    )
    if changes:
        yield Hypothesis(words, changes=changes, is_stated=is_stated)


def _add_to_fit(fit: Fit, hypothesis: Hypothesis, start: Start | None) -> Fit | None:
    """Return the fit with a hypothesis added; None if its motion grows without bound."""
    model = hypothesis.add_to(fit.model)
    values: dict[str, float] = {}
    if hypothesis.ground and start is not None:
        # A ground spring changes the stiffness, too: both begin at the solution of the equation with such a spring.
        for group, ground, beside in zip(
            model.groups, start.ground_stiffness, start.stiffness_beside_ground, strict=True
        ):
            values |= {group.name_of(GROUND): float(ground), group.name_of("stiffness_per_mass"): float(beside)}
    theta = carry_over(fit, model, values)
    noisier = model.settings.fit.noisier[-1] if values else ()
    if values:
        # The initial states of a fit without the spring are as wrong as that fit.
        theta[model.n_shared :] = 0.0
    most = model.settings.fit.most_refit_evaluations if fit.ratio > model.settings.verdicts.refused else None
    try:
        return fit_model(model, theta, noisier=noisier, most_evaluations=most)
    except NO_FIT:
        return None


@dataclass(frozen=True)
class GroundImitations:
    """How well a spring to the ground is distinguished from zero and from faults of the sensors.

    Args:
        std_per_mass: standard deviation that K3/M2 has, or would have if it were free, 1/s^2, of each group; None if it
            is unknown.
        sentences: the faults that imitate a ground spring, one sentence each.
    """

    std_per_mass: tuple[float | None, ...]
    sentences: tuple[str, ...]


def ground_imitations(fit: Fit) -> GroundImitations:
    """Return how well springs to the ground are distinguished from zero and, for one gear, from faults of the sensors.

    The derivatives of the prediction errors by the spring and by a fault are compared after those by all other fitted
    parameters were projected out.
    """
    model = Hypothesis("springs to the ground", ground=True).add_to(fit.model)
    is_one = len(fit.model.sensors.sprung) == 1
    values: dict[str, float] = {}
    if is_one:
        model, values = _with_usual_faults(model, fit)
    try:
        errors = model.evaluate(carry_over(fit, model, values))
    except UnboundedResponseError:
        return GroundImitations((None,) * len(model.groups), ())
    jacobian = errors.jacobian[rows_with_departures(fit, model)]
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    gram = (jacobian / size).T @ (jacobian / size)
    names = list(model.names)
    springs = [names.index(group.name_of(GROUND)) for group in model.groups]
    kept = [names.index(name) for name in fit.model.names if name in names]
    fitted = [*kept, *range(len(names), size.size)]
    std = []
    for spring in springs:
        beside = [k for k in fitted if k != spring]
        alone = _project_out(gram, beside, [spring])[0, 0]
        std.append(float(np.sqrt(fit.variance / max(alone, 1e-300))) / float(size[spring]))
    sentences = tuple(_write_sentences(gram, size, names, springs[0], fit)) if is_one else ()
    return GroundImitations(tuple(std), sentences)


def _with_usual_faults(model: Model, fit: Fit) -> tuple[Model, dict[str, float]]:
    """Return the model of one gear with all usual faults free, and new values of parameters that need them."""
    settings, sensors, values = model.settings, model.sensors, dict[str, float]()
    for side in ("unsprung", "sprung"):
        corner_hz = sensors.facts(side)[0].corner_hz or settings.intervals.imitating_slight_hz
        tolerance = settings.faults.corner_tolerance
        sensors = sensors.changed(side, 0, corner_hz=corner_hz, corner_tolerance=tolerance)
    sensors = sensors.changed("unsprung", 0, gain_tolerance=0.0)
    gain, lag_s = settings.intervals.imitating_gain, settings.intervals.imitating_lag_s
    sensors = sensors.changed("sprung", 0, gain_tolerance=gain, lag_tolerance_s=lag_s)
    if "gain_unsprung" in fit.model.names:
        # Only the ratio of the gains is determined.
        values["gain_sprung"] = (fit.value("gain_sprung") or 1.0) / fit.value("gain_unsprung")
    return replace(model, sensors=sensors), values


def _project_out(gram: FloatArray, others: list[int], kept: list[int]) -> FloatArray:
    """Return the products of columns after the other columns were projected out (Schur complement)."""
    cross = gram[np.ix_(kept, others)]
    inverse = np.linalg.pinv(gram[np.ix_(others, others)], rcond=1e-13, hermitian=True)
    return np.asarray(gram[np.ix_(kept, kept)] - cross @ inverse @ cross.T)


def _list_usual_faults(settings: IntervalSettings) -> tuple[tuple[str, str, float], ...]:
    """Return faults of the sensors of the first interface: name, words, size."""
    gain, corner_hz, lag_s = settings.imitating_gain, settings.imitating_corner_hz, settings.imitating_lag_s
    return (
        ("gain_sprung", f"{100 * gain:g} % of gain error between the sensors", gain),
        ("corner_sprung_hz", f"an AC coupling at {corner_hz:g} Hz of the sprung sensor alone", corner_hz),
        ("corner_unsprung_hz", f"an AC coupling at {corner_hz:g} Hz of the unsprung sensor alone", corner_hz),
        ("lag_s", f"a lag of {1e3 * lag_s:g} ms between the channels", lag_s),
    )


def _write_sentences(gram: FloatArray, size: FloatArray, names: list[str], spring: int, fit: Fit) -> Iterator[str]:
    settings = fit.model.settings.intervals
    faults = _list_usual_faults(settings)
    indices = [spring, *(names.index(name) for name, _, _ in faults)]
    others = [k for k in range(size.size) if k not in indices]
    left = _project_out(gram, others, indices) * np.outer(size[indices], size[indices])
    stiffness = float(fit.theta[0])
    for k, (_, words, usual) in enumerate(faults, start=1):
        cosine = left[0, k] / max(float(np.sqrt(max(left[0, 0] * left[k, k], 0.0))), 1e-300)
        feigned = usual * left[0, k] / max(left[0, 0], 1e-300) / stiffness
        if abs(cosine) > settings.alike_cosine:
            yield f"{words} imitates a ground spring of {100 * feigned:.2g} % of K2 (cosine {abs(cosine):.2f})"
