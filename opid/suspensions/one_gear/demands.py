"""What the runs demand beside the suspension: a spring to the ground, or a fault of the sensors that nobody stated.

All are first tried by score tests, one simulation together. What would lower the error most is fitted, and kept if the
information criterion agrees; then the rest is tried again. Several of them look alike (a gain error and a ground
spring, say): all that explain the runs about as well as the one that was let in are named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from opid.mechanics.driven import UnboundedResponseError
from opid.suspensions.one_gear.driven_run import DrivenRun
from opid.suspensions.one_gear.model_fit import FROM_AFAR, ModelFit, fit_model, scores_of_parameters
from opid.suspensions.paper.joint_fit import JointFit
from opid.suspensions.sensor_facts import SIDES, SensorPair, nuisance_values

GROUND = "ground_stiffness_per_mass"
# a score (chi-square of one degree of freedom under a sound model) below this is not looked at further
SCORE_LOOKED_AT = 30.0
# as for a term of the law: the criterion and the error must both fall
BIC_MARGIN, ERROR_MARGIN = 20.0, 0.002
# explanations whose criterion is this close to the best one cannot be told from it
ALIKE_BIC = 10.0
GAIN_TOLERANCE, LAG_SAMPLES = 0.03, 2.0
CORNER_HZ, CORNER_TOLERANCE, SLIGHT_CORNER_HZ = 0.25, 0.5, 2e-4
PLAUSIBLE_STD = 5.0
# error over the assumed noise below which the runs are explained; share by which it must fall otherwise
EXPLAINED, LARGE_SHARE = 2.0, 0.3
MOST = 3


@dataclass(frozen=True)
class Demand:
    """Something that was let into the model because the runs demand it.

    Args:
        name: the parameter, "ground_stiffness_per_mass" or a fault of the sensors.
        words: what it is.
        value: its estimate.
        std: its standard deviation.
        error_before: error without it, m/s^2.
        error_after: error with it, m/s^2.
        alike: what would explain the runs as well.
    """

    name: str
    words: str
    value: float
    std: float
    error_before: float
    error_after: float
    alike: tuple[str, ...]


@dataclass(frozen=True)
class _Hypothesis:
    """Something that the model may lack: its parameters, and what of the sensors' facts makes them free."""

    names: tuple[str, ...]
    words: str
    ground: bool = False
    unsprung: Mapping[str, float] = field(default_factory=dict)
    sprung: Mapping[str, float] = field(default_factory=dict)

    def sensors(self, pair: SensorPair) -> SensorPair:
        return replace(
            pair, unsprung=replace(pair.unsprung, **self.unsprung), sprung=replace(pair.sprung, **self.sprung)
        )


def let_in(
    runs: Sequence[DrivenRun],
    fit: ModelFit,
    *,
    ground_start: JointFit | None = None,
    progress: Callable[[str], None] | None = None,
) -> tuple[tuple[DrivenRun, ...], ModelFit, tuple[Demand, ...]]:
    """Let in what the runs demand, and return the runs with the sensors as they turned out.

    Args:
        runs: one `DrivenRun` a run.
        fit: the model without it.
        ground_start: a fit with a ground spring, to start from where one is tried; None: none may be let in.
        progress: called with the name of each step as it begins.
    """
    say = progress or (lambda step: None)
    runs, demands = tuple(runs), []
    # faults that explain the runs only together are let in together: what stands is the last that explains something
    standing: tuple[tuple[DrivenRun, ...], ModelFit, list[Demand]] = (runs, fit, [])
    for _ in range(MOST):
        tried = []
        for hypothesis in _promising(runs, fit, ground_start):
            say(hypothesis.words)
            changed = tuple(replace(run, sensors=hypothesis.sensors(fit.sensors)) for run in runs)
            new_spring = ground_start if hypothesis.ground else None
            grown = _refit(changed, fit, ground=fit.ground or hypothesis.ground, new_spring=new_spring)
            if grown is not None and _plausible(grown, hypothesis.names):
                tried.append((grown, changed, hypothesis))
        if not tried:
            break
        best, changed, hypothesis = min(tried, key=lambda entry: entry[0].bic)
        if not _better(best, fit):
            break
        alike = tuple(h.words for other, _, h in tried if h is not hypothesis and other.bic < best.bic + ALIKE_BIC)
        demands += [_demand(best, name, hypothesis, fit.noise_m_per_s2, alike) for name in hypothesis.names]
        helps = fit is standing[1] and best.noise_m_per_s2 < (1 - LARGE_SHARE) * fit.noise_m_per_s2
        runs, fit = changed, best
        if helps or fit.noise_m_per_s2 < EXPLAINED * fit.level:
            standing = (runs, fit, list(demands))
    runs, fit, demands = standing
    runs, fit, demands = _given_up(runs, fit, demands)
    return runs, fit, tuple(at_last(demand, fit) for demand in demands)


def _given_up(
    runs: tuple[DrivenRun, ...], fit: ModelFit, demands: list[Demand]
) -> tuple[tuple[DrivenRun, ...], ModelFit, list[Demand]]:
    """Take out again what the later ones made useless, the ground spring first."""
    words = dict.fromkeys(demand.words for demand in demands)
    for what in [*(["ground"] if fit.ground else []), *words]:
        names = [demand.name for demand in demands if demand.words == what]
        if what != "ground" and not names:
            # already taken out with the ground spring
            continue
        of_ground = what == "ground" or GROUND in names
        if of_ground and not fit.ground:
            continue
        names = [GROUND] if of_ground else names
        sensors = fit.sensors if of_ground else _without(fit.sensors, names[0])
        changed = tuple(replace(run, sensors=sensors) for run in runs)
        without = _refit(changed, fit, ground=fit.ground and not of_ground)
        if without is not None and not _better(fit, without):
            runs, fit, demands = changed, without, [each for each in demands if each.name not in names]
    return runs, fit, demands


def _without(pair: SensorPair, name: str) -> SensorPair:
    """The sensors without a fault that nobody stated."""
    zero: dict[str, float] = {"corner_hz": 0.0, "corner_tolerance": 0.0}
    if name.startswith("gain"):
        zero = {"gain_tolerance": 0.0}
    elif name.startswith("lag"):
        zero = {"lag_tolerance_s": 0.0}
    return replace(pair, unsprung=replace(pair.unsprung, **zero), sprung=replace(pair.sprung, **zero))


def at_last(demand: Demand, fit: ModelFit) -> Demand:
    """Return a demand with its value in a later fit.

    Args:
        demand: of `let_in`.
        fit: a fit that has it.
    """
    std = float(fit.std[fit.names.index(demand.name)])
    return replace(demand, value=fit[demand.name], std=std, error_after=fit.noise_m_per_s2)


def _better(fit: ModelFit, than: ModelFit) -> bool:
    return fit.bic < than.bic - BIC_MARGIN and fit.noise_m_per_s2 < (1 - ERROR_MARGIN) * than.noise_m_per_s2


def _plausible(fit: ModelFit, names: Sequence[str]) -> bool:
    """A fault that lies far beyond what such sensors do stands in for something else."""
    new = [nuisance for nuisance in fit.sensors.nuisances if nuisance.name in names]
    return all(abs(fit[each.name] - each.nominal) < PLAUSIBLE_STD * each.std for each in new)


def _demand(fit: ModelFit, name: str, hypothesis: _Hypothesis, before: float, alike: tuple[str, ...]) -> Demand:
    value, std = fit[name], float(fit.std[fit.names.index(name)])
    return Demand(name, hypothesis.words, value, std, before, fit.noise_m_per_s2, alike)


def _promising(runs: tuple[DrivenRun, ...], fit: ModelFit, ground_start: JointFit | None) -> list[_Hypothesis]:
    """What a score test speaks for, the best first; a strong spring is beyond it, so the other fit speaks for that."""
    hypotheses = list(_hypotheses(fit, ground_start is not None, runs[0].fs))
    if not hypotheses:
        return []
    sensors = fit.sensors
    for hypothesis in hypotheses:
        sensors = _slight(hypothesis.sensors(sensors), fit)
    groups = [hypothesis.names for hypothesis in hypotheses]
    gains = scores_of_parameters(runs, fit, groups, sensors=sensors, ground=any(h.ground for h in hypotheses))
    scored = []
    for gain, hypothesis in zip(gains, hypotheses, strict=True):
        score = gain / fit.variance
        if hypothesis.ground and ground_start is not None:
            place = ground_start.names.index(GROUND)
            score = max(score, float(ground_start.value[place] / ground_start.std[place]) ** 2)
        scored.append((score, hypothesis))
    scored.sort(key=lambda entry: -entry[0])
    return [hypothesis for score, hypothesis in scored if score > SCORE_LOOKED_AT]


def _slight(pair: SensorPair, fit: ModelFit) -> SensorPair:
    """The sensors with a new AC coupling next to none: a score is taken where the fault begins."""
    sides = {}
    for side in SIDES:
        facts, before = getattr(pair, side), getattr(fit.sensors, side)
        sides[side] = facts if before.corner_hz or not facts.corner_hz else replace(facts, corner_hz=SLIGHT_CORNER_HZ)
    return replace(pair, unsprung=sides["unsprung"], sprung=sides["sprung"])


def _hypotheses(fit: ModelFit, ground: bool, fs: float) -> Iterator[_Hypothesis]:
    """What is not in the model yet, with what is known of such faults in general."""
    unsprung, sprung = fit.sensors.unsprung, fit.sensors.sprung
    if ground and not fit.ground:
        yield _Hypothesis((GROUND,), "a spring to the ground", ground=True)
    if not (unsprung.gain_tolerance or sprung.gain_tolerance):
        yield _Hypothesis(
            ("gain_sprung",), "a gain error between the sensors", sprung={"gain_tolerance": GAIN_TOLERANCE}
        )
    if not (unsprung.lag_tolerance_s or sprung.lag_tolerance_s):
        lag = {"lag_tolerance_s": LAG_SAMPLES / fs}
        yield _Hypothesis(("lag_s",), "a lag between the channels", sprung=lag)
    if not (unsprung.corner_hz or sprung.corner_hz):
        coupled = {"corner_hz": CORNER_HZ, "corner_tolerance": CORNER_TOLERANCE}
        names = ("corner_unsprung_hz", "corner_sprung_hz")
        yield _Hypothesis(names, "AC coupling of the sensors", unsprung=coupled, sprung=coupled)


def _refit(
    runs: Sequence[DrivenRun], fit: ModelFit, *, ground: bool, new_spring: JointFit | None = None
) -> ModelFit | None:
    """The fit with something more or less, or None where it grows without bound."""
    # a ground spring changes stiffness and damping too: all three start where it was free
    start = new_spring or fit
    try:
        return fit_model(
            runs,
            fit.law,
            stiffness_per_mass=start["stiffness_per_mass"],
            damping_per_mass=start["damping_per_mass"],
            ground_stiffness_per_mass=start[GROUND] if ground else None,
            inverse_mass=fit["inverse_mass"] if fit.held_inverse_mass is None else fit.held_inverse_mass,
            hold_mass=fit.held_inverse_mass is not None,
            noise_m_per_s2=fit.noise,
            motion_rms=fit.motion_rms,
            # the starts of a fit without the spring are as wrong as it is
            start=None if new_spring else fit.start,
            noisier=FROM_AFAR if new_spring else (),
            nuisance=nuisance_values(fit.names, fit.value.tolist(), fit.sensors),
        )
    except UnboundedResponseError:
        return None
