"""An updating made by hand: six sensors and two joints, two modes, three classes, and what would be found of them."""

from dataclasses import replace
from functools import cache

import numpy as np

from opid.estimate import Estimate
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.laws.law import Law, Term
from opid.mechanics.truth import UpdatingTruth
from opid.updating.measured import MeasuredBackbone
from opid.updating.model_class import ModelClass, Prior, UncertainTerm
from opid.updating.result import (
    BackboneBand,
    ClassPosterior,
    ForcedResponse,
    HarmonicBand,
    LinearMode,
    LinearPosterior,
    SensorBand,
    Updating,
)
from opid.updating.sampling.chains import Chain, Diagnostics
from opid.updating.sampling.evidence import Evidence

SENSORS = ("9", "10", "11", "12", "13", "14")
CONTROLLED = "10"
CUBIC = 6.8e7 * 1.58
"""N/m^3: the true law."""
THETA = {"class 1": (1.2,), "class 2": (1.58,), "class 4": (1.71, 0.6)}
CLASSES = (
    ModelClass("class 1", (UncertainTerm("quadratic_stiffness", (2.16e5,), (Prior(),)),)),
    ModelClass("class 2", (UncertainTerm("cubic_stiffness", (6.8e7,), (Prior(),)),)),
    ModelClass(
        "class 4",
        (
            UncertainTerm("cubic_stiffness", (6.8e7,), (Prior(),)),
            UncertainTerm("quartic_stiffness", (-2.7e9,), (Prior("uniform", -9, 9),)),
        ),
    ),
)


INITIAL_SHAPES = np.array([[0.3, 0.1], [0.7, 0.7], [0.5, 0.9], [0.2, 0.1], [0.6, -0.9], [0.8, -0.6]])
"""Shapes of the structure before it was updated."""


def small_system():
    """Two modes of interest and a third one above, 14.65, 17.71 and 60 Hz."""
    eigenvalue = (2 * np.pi * np.array([14.65, 17.71, 60.0])) ** 2
    at_sensors = np.array([
        [0.04, 0.02, 0.9], [0.9, 0.8, -0.1], [0.8, 0.85, -0.1],
        [-0.04, 0.03, 0.9], [0.85, -0.8, 0.1], [0.9, -0.75, 0.1],
    ])  # fmt: skip
    at_joints = np.array([[0.9, 0.8, 0.5], [0.87, -0.78, 0.5]])
    return JointedModes(eigenvalue, at_sensors, at_joints, SENSORS, ("left", "right"))


def frequency_of(mode, amplitude, coefficient=CUBIC):
    """Frequency at an amplitude of the controlled sensor with the other modes at rest, Hz: harmonic linearisation."""
    system = small_system()
    place = mode - 1
    q = amplitude / np.abs(system.at_sensors[SENSORS.index(CONTROLLED), place])
    stiffening = 0.75 * coefficient * np.sum(system.at_joints[:, place] ** 4) * q**2
    return np.sqrt(system.eigenvalue[place] + stiffening) / (2 * np.pi)


def small_backbone(mode, seed, *, n=12):
    """One noisy measurement: its curve is off as a whole, its points scatter."""
    rng = np.random.default_rng(seed)
    amplitude = np.linspace(0.2e-3, (4.0e-3, 2.5e-3)[mode - 1], n)
    shape = small_system().at_sensors[:, mode - 1]
    motion = amplitude[:, None] * shape / shape[SENSORS.index(CONTROLLED)]
    motion = motion * (1 + 0.01 * rng.standard_normal((1, len(SENSORS))))
    frequency = frequency_of(mode, amplitude) * (1 + 0.002 * rng.standard_normal() + 2e-4 * rng.standard_normal(n))
    return MeasuredBackbone(f"mode{mode}_sensor{seed}", mode, CONTROLLED, frequency, motion, SENSORS)


@cache
def small_measured():
    """Five backbones of mode 1 and three of mode 2."""
    return tuple(small_backbone(1, seed) for seed in range(9, 14)) + tuple(
        small_backbone(2, seed) for seed in (9, 10, 13)
    )


def small_linear():
    """Phase I, with the figures of the paper."""
    rng = np.random.default_rng(1)
    mean, deviation = np.array([0.88, 0.31]), np.array([0.02, 0.002])
    correlation = np.array([[1.0, -0.6], [-0.6, 1.0]])
    covariance = correlation * np.outer(deviation, deviation)
    names = ("E_aluminium", "E_steel")
    samples = rng.multivariate_normal(mean, covariance, 3000)
    return LinearPosterior(
        names=names,
        best=mean,
        estimates={name: Estimate.normal(*each) for name, *each in zip(names, mean, deviation, strict=True)},
        covariance=covariance,
        samples=samples,
        modes=(
            LinearMode(1, 14.65, 22.78, 14.65, 0.81, 0.99, INITIAL_SHAPES[:, 0]),
            LinearMode(2, 17.71, 30.91, 17.72, 0.95, 0.98, INITIAL_SHAPES[:, 1]),
        ),
        diagnostics=Diagnostics("adaptive", 3000, 3500, 0.31, 412.0, 1.004),
        warnings=("the posterior of E_steel lies far from its nominal value",),
        chain=small_chain(samples),
    )


def small_chain(samples):
    """Samples as two chains of a density that nobody asks for."""
    halves = samples.reshape(2, len(samples) // 2, -1)
    return Chain(halves, np.zeros(halves.shape[:2]), 0.34, 5500, "adaptive", 0)


def small_class(model_class, log_evidence, *, seed=0):
    """The posterior of one class."""
    rng = np.random.default_rng(seed)
    best = np.array(THETA[model_class.name])
    deviation = np.array([0.04, 0.35])[: best.size]
    covariance = np.diag(deviation**2)
    if best.size == 2:
        covariance[0, 1] = covariance[1, 0] = 0.95 * deviation.prod()
    samples = rng.multivariate_normal(best, covariance, 2000)
    return ClassPosterior(
        model_class=model_class,
        evidences=(
            Evidence("laplace", log_evidence),
            Evidence("transitional", log_evidence - 0.1, 0.19),
            Evidence("quadrature", log_evidence + 0.01),
        ),
        best=best,
        estimates={f"theta_{k + 1}": Estimate.normal(value, deviation[k]) for k, value in enumerate(best)},
        covariance=covariance,
        samples=samples,
        calibration_std=0.02 * best,
        log_likelihood_at_best=log_evidence + 5,
        diagnostics=Diagnostics("adaptive", 5000, 5500, 0.34, 616.0, 1.01),
        prior_sensitivity={f"theta_{k + 1}": -0.693 for k in range(best.size)},
        warnings=("the chains of theta_2 have few effective samples",) if best.size == 2 else (),
        chain=small_chain(samples),
    )


def small_bands(modes=(1, 2), sensors=SENSORS):
    """What the cubic class predicts."""
    shapes = small_system().at_sensors
    bands = []
    for mode in modes:
        amplitude = np.linspace(0.2e-3, (4.0e-3, 2.5e-3)[mode - 1], 40)
        frequency = frequency_of(mode, amplitude)
        for sensor in sensors:
            ratio = np.abs(shapes[SENSORS.index(sensor), mode - 1] / shapes[SENSORS.index(CONTROLLED), mode - 1])
            bands.append(
                BackboneBand(mode, sensor, ratio * amplitude, frequency, 0.995 * frequency, 1.005 * frequency, 0.94)
            )
    return tuple(bands)


def small_motions(mode=1, **changes):
    """What the cubic class predicts of a mode over the controlled sensor, with the motion of the others."""
    (band,) = small_bands(modes=(mode,), sensors=(CONTROLLED,))
    shape = small_system().at_sensors[:, mode - 1]
    ratio = dict(zip(SENSORS, shape / shape[SENSORS.index(CONTROLLED)], strict=True))
    sensors = tuple(
        SensorBand(name, ratio[name] * band.amplitude, (ratio[name] - 0.05) * band.amplitude,
                   (ratio[name] + 0.05) * band.amplitude, 0.96, 0.93)
        for name in SENSORS if name != CONTROLLED
    )  # fmt: skip
    return replace(band, sensors=sensors, left_out=0.95, mode_left_out=0.9, **changes)


def small_responses():
    """What two forces make of the first mode, the second beyond the tests and without intervals."""
    phase = np.linspace(10.0, 170.0, 17)
    found = []
    for force_n, has_interval in ((0.5, True), (1.0, False)):
        amplitude = 2e-3 * force_n * np.sin(np.radians(phase))
        hz = 15.0 + 2e4 * amplitude**2 + 0.02 / np.tan(np.radians(phase))
        drawn = np.array([0.95, 1.0, 1.05])[:, None]
        peaks = Estimate.normal(hz[8], 0.05), Estimate.normal(amplitude[8], 0.05 * amplitude[8])
        if not has_interval:
            peaks = tuple(each.without_interval() for each in peaks)
        found.append(
            ForcedResponse(
                1, CONTROLLED, CONTROLLED, force_n, phase, hz, amplitude, tuple(hz + 0 * drawn),
                tuple(drawn * amplitude), *peaks, is_extrapolated=not has_interval,
            )
        )  # fmt: skip
    return tuple(found)


def small_harmonics():
    """The third harmonic of two sensors in the first mode, and of one in the second, which has no band at its end."""
    found = []
    for mode, sensor, share in ((1, "9", 0.01), (1, "10", -0.02), (2, "10", 0.01)):
        amplitude = np.linspace(0.2e-3, (4.0e-3, 2.5e-3)[mode - 1], 12)
        motion = share * amplitude**3 / amplitude[-1] ** 2
        low, high = np.sort([0.8 * motion, 1.2 * motion], axis=0)
        if mode == 2:
            low[-2:] = high[-2:] = np.nan
        seen = motion * np.where(np.arange(12) < 3, 1.5, 1.0)
        found.append(HarmonicBand(mode, 3, sensor, CONTROLLED, amplitude, seen, motion, low, high, 0.75, None))
    return tuple(found)


def small_updating(**changes):
    """The whole result, made by hand."""
    classes = tuple(
        small_class(each, log_evidence) for each, log_evidence in zip(CLASSES, (81.0, 360.2, 357.9), strict=True)
    )
    content = {
        "title": "A small wing",
        "form": "recommended",
        "linear": small_linear(),
        "system": small_system(),
        "measured": small_measured(),
        "classes": classes,
        "best_class": "class 2",
        "prediction": small_bands(),
        "warnings": ("the backbones of mode 1 differ by 0.4 % in frequency",),
        "not_determined": "",
        "settings": {"study": "study.toml", "sampler": "adaptive", "samples": 5000, "seed": 1},
    }
    return Updating(**{**content, **changes})


def small_truth():
    """As `opid simulate backbones` would write it."""
    law = Law((Term("cubic_stiffness", (CUBIC,)),))
    laws = dict.fromkeys(small_system().joints, law)
    return UpdatingTruth({"E_aluminium": 0.88, "E_steel": 0.31}, laws, "a small wing", {"seed": 1})
