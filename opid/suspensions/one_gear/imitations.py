"""Which faults of the sensors look like a spring to the ground in these runs, and how large a spring they feign."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.signals.recording import FloatArray
from opid.suspensions.law_parameters import to_free
from opid.suspensions.one_gear.driven_run import DrivenRun
from opid.suspensions.one_gear.model_fit import ModelFit, orthonormal
from opid.suspensions.sensor_facts import SensorFacts

# cosine between what the two do to the prediction errors above which one passes for the other
ALIKE = 0.7
# an AC coupling next to none, about which to differentiate
SLIGHT_CORNER_HZ = 1e-3
# fault, how it is said, its usual size
FAULTS = (
    ("gain_sprung", "1 % of gain error between the sensors", 0.01),
    ("corner_sprung_hz", "an AC coupling at 0.1 Hz of the sprung sensor alone", 0.1),
    ("corner_unsprung_hz", "an AC coupling at 0.1 Hz of the unsprung sensor alone", 0.1),
    ("lag_s", "a lag of 1 ms between the channels", 1e-3),
)
GROUND = "ground_stiffness_per_mass"


@dataclass(frozen=True)
class GroundImitations:
    """How well a spring to the ground is told from nothing, and from faults of the sensors.

    Args:
        std_per_mass: standard deviation that K3/M2 has, or would have if it were free, 1/s^2.
        sentences: the faults that pass for a ground spring, one sentence each.
    """

    std_per_mass: float
    sentences: tuple[str, ...]


def ground_imitations(runs: Sequence[DrivenRun], fit: ModelFit) -> GroundImitations:
    """Return how well a ground spring is told from nothing and from faults of the sensors.

    The derivatives of the prediction errors by the spring and by a fault are compared once everything else that is
    fitted is taken out of both.

    Args:
        runs: those that were fitted.
        fit: of them.
    """
    facts = fit.sensors
    free = SensorFacts(
        noise_m_per_s2=facts.sprung.noise_m_per_s2,
        gain_tolerance=0.01,
        corner_hz=facts.sprung.corner_hz or SLIGHT_CORNER_HZ,
        corner_tolerance=0.5,
        lag_tolerance_s=1e-3,
    )
    unsprung = replace(
        facts.unsprung, corner_hz=facts.unsprung.corner_hz or SLIGHT_CORNER_HZ, corner_tolerance=0.5, gain_tolerance=0.0
    )
    sensors = replace(facts, sprung=free, unsprung=unsprung)
    changed = tuple(replace(run, sensors=sensors) for run in runs)
    model = replace(fit.model(runs), runs=changed, ground=True)
    known = {nuisance.name: nuisance.nominal for nuisance in model.nuisances} | {GROUND: 0.0}
    known |= dict(zip(fit.names, fit.value, strict=True))
    if "gain_unsprung" in known:
        # only the ratio of the gains is seen
        known["gain_sprung"] = known.get("gain_sprung", 1.0) / known["gain_unsprung"]
    known |= {f"law[{i}]": value for i, value in enumerate(to_free(fit.law))}
    theta = np.array([*(known[name] for name in model.names), *fit.start.ravel()])
    errors = model.evaluate(theta)
    jacobian = errors.jacobian[: 2 * sum(line.size for line in errors.lines)]
    names = list(model.names)
    looked_at = [GROUND, *(name for name, _, _ in FAULTS)]
    others = np.delete(jacobian, [names.index(name) for name in looked_at], axis=1)
    basis = orthonormal(others)
    left = {name: jacobian[:, names.index(name)] for name in looked_at}
    left = {name: column - basis @ (basis.T @ column) for name, column in left.items()}
    spring = left[GROUND]
    sentences = tuple(_sentences(left, spring, fit["stiffness_per_mass"]))
    return GroundImitations(_std(jacobian, names, fit), sentences)


def _std(jacobian: FloatArray, names: list[str], fit: ModelFit) -> float:
    """Standard deviation of the spring with all that is fitted, and nothing else."""
    own = [k for k, name in enumerate(names) if name in fit.names and name != GROUND]
    others = np.column_stack([jacobian[:, own], jacobian[:, len(names) :]])
    basis, spring = orthonormal(others), jacobian[:, names.index(GROUND)]
    alone = spring - basis @ (basis.T @ spring)
    return float(np.sqrt(fit.variance / max(float(alone @ alone), 1e-300)))


def _sentences(left: dict[str, FloatArray], spring: FloatArray, stiffness: float) -> Iterator[str]:
    for name, words, size in FAULTS:
        fault = left[name]
        cosine = float(spring @ fault / max(float(np.linalg.norm(spring)) * float(np.linalg.norm(fault)), 1e-300))
        feigned = size * float(spring @ fault / (spring @ spring)) / stiffness
        if abs(cosine) > ALIKE:
            yield f"{words} passes for a ground spring of {100 * feigned:.2g} % of K2 (alike to {abs(cosine):.2f})"
