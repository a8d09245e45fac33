"""What the runs demand beside the suspension: a spring to the ground, or a fault of the sensors that nobody stated.

Each is first tried by a score test, one simulation each. What would lower the error most is fitted, and kept if the
information criterion agrees; then the rest is tried again. Several of them look alike (a gain error and a ground
spring, say): all that explain the runs about as well as the one that was let in are named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.identify.driven_run import DrivenRun
from opid.identify.joint_fit import JointFit
from opid.identify.model_fit import FROM_AFAR, ModelFit, fit_model, score_of_parameter
from opid.identify.sensor_facts import SIDES, SensorPair, nuisance_values
from opid.mechanics.driven import UnboundedResponseError

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
    names: tuple[str, ...]
    words: str
    sensors: SensorPair
    ground: bool


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
    for _ in range(MOST):
        tried = []
        for hypothesis in _promising(runs, fit, ground_start):
            say(hypothesis.words)
            changed = tuple(replace(run, sensors=hypothesis.sensors) for run in runs)
            grown = _refit(changed, fit, hypothesis, ground_start)
            if grown is not None and _plausible(grown, hypothesis.names):
                tried.append((grown, changed, hypothesis))
        if not tried:
            break
        best, changed, hypothesis = min(tried, key=lambda entry: entry[0].bic)
        if not (_better(best, fit) and _explains(best, fit)):
            break
        alike = tuple(h.words for other, _, h in tried if h is not hypothesis and other.bic < best.bic + ALIKE_BIC)
        demands += [_demand(best, name, hypothesis, fit.noise_m_per_s2, alike) for name in hypothesis.names]
        runs, fit = changed, best
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
        if what == "ground" or "ground_stiffness_per_mass" in names:
            if not fit.ground:
                continue
            hypothesis = _Hypothesis((), "", fit.sensors, False)
            names = ["ground_stiffness_per_mass"]
        else:
            hypothesis = _Hypothesis((), "", _without(fit.sensors, names[0]), fit.ground)
        changed = tuple(replace(run, sensors=hypothesis.sensors) for run in runs)
        without = _refit(changed, fit, hypothesis, None)
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


def _explains(fit: ModelFit, than: ModelFit) -> bool:
    """Whether the runs are explained with it, or far better: where much stays unexplained anything helps a little."""
    return fit.noise_m_per_s2 < max(EXPLAINED * fit.level, (1 - LARGE_SHARE) * than.noise_m_per_s2)


def _plausible(fit: ModelFit, names: Sequence[str]) -> bool:
    """A fault that lies far beyond what such sensors do stands in for something else."""
    new = [nuisance for nuisance in fit.sensors.nuisances if nuisance.name in names]
    return all(abs(fit[each.name] - each.nominal) < PLAUSIBLE_STD * each.std for each in new)


def _demand(fit: ModelFit, name: str, hypothesis: _Hypothesis, before: float, alike: tuple[str, ...]) -> Demand:
    value, std = fit[name], float(fit.std[fit.names.index(name)])
    return Demand(name, hypothesis.words, value, std, before, fit.noise_m_per_s2, alike)


def _promising(runs: tuple[DrivenRun, ...], fit: ModelFit, ground_start: JointFit | None) -> list[_Hypothesis]:
    """What a score test speaks for, the best first; a strong spring is beyond it, so the other fit speaks for that."""
    variance = (fit.noise_m_per_s2 / float(np.sqrt(np.mean(np.square(fit.noise))))) ** 2
    scored = []
    for hypothesis in _hypotheses(fit, ground_start is not None, runs[0].fs):
        scores = [
            score_of_parameter(runs, fit, name, sensors=_slight(hypothesis.sensors, fit), ground=hypothesis.ground)[0]
            for name in hypothesis.names
        ]
        score = max(scores) / variance
        if hypothesis.ground and not fit.ground and ground_start is not None:
            place = ground_start.names.index("ground_stiffness_per_mass")
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
    pair = fit.sensors
    if ground and not fit.ground:
        yield _Hypothesis(("ground_stiffness_per_mass",), "a spring to the ground", pair, True)
    if not (pair.unsprung.gain_tolerance or pair.sprung.gain_tolerance):
        sprung = replace(pair.sprung, gain_tolerance=GAIN_TOLERANCE)
        yield _Hypothesis(
            ("gain_sprung",), "a gain error between the sensors", replace(pair, sprung=sprung), fit.ground
        )
    if not (pair.unsprung.lag_tolerance_s or pair.sprung.lag_tolerance_s):
        sprung = replace(pair.sprung, lag_tolerance_s=LAG_SAMPLES / fs)
        yield _Hypothesis(("lag_s",), "a lag between the channels", replace(pair, sprung=sprung), fit.ground)
    if not (pair.unsprung.corner_hz or pair.sprung.corner_hz):
        coupled = {"corner_hz": CORNER_HZ, "corner_tolerance": CORNER_TOLERANCE}
        both = replace(pair, unsprung=replace(pair.unsprung, **coupled), sprung=replace(pair.sprung, **coupled))
        names = ("corner_unsprung_hz", "corner_sprung_hz")
        yield _Hypothesis(names, "AC coupling of the sensors", both, fit.ground)


def _refit(
    runs: Sequence[DrivenRun], fit: ModelFit, hypothesis: _Hypothesis, ground_start: JointFit | None
) -> ModelFit | None:
    """The fit with something more or less, or None where it grows without bound."""
    # a ground spring changes stiffness and damping too: all three start where it was free
    new_ground = hypothesis.ground and not fit.ground and ground_start is not None
    start: JointFit = ground_start if new_ground and ground_start is not None else fit
    try:
        return fit_model(
            runs,
            fit.law,
            stiffness_per_mass=start["stiffness_per_mass"],
            damping_per_mass=start["damping_per_mass"],
            ground_stiffness_per_mass=start["ground_stiffness_per_mass"] if hypothesis.ground else None,
            inverse_mass=fit["inverse_mass"] if fit.held_inverse_mass is None else fit.held_inverse_mass,
            hold_mass=fit.held_inverse_mass is not None,
            noise_m_per_s2=fit.noise,
            motion_rms=fit.motion_rms,
            # the starts of a fit without the spring are as wrong as it is
            start=None if new_ground else fit.start,
            noisier=FROM_AFAR if new_ground else (),
            nuisance=nuisance_values(fit.names, fit.value.tolist(), fit.sensors),
        )
    except UnboundedResponseError:
        return None
