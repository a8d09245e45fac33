"""The figures of merit of Bayesian updating from backbones, as a Markdown table.

Run `python benchmarks/updating_figures.py`; in parts `--rows classes,coverage --seeds 30 --jobs 2`. Seeds count from 0
and none is dropped. The synthetic sets are those of `synthetic_backbones` on the wing-engine structure, 14 curves of
its first bending mode and 5 of its second, class 2 with theta = 1.58: "large" errors have offsets of 0.35 % a curve and
0.1 % a point, "small" ones those of a virtual measurement (0.05 and 0.15 % a curve, 0.01 % a point). The linear error
of 0.4 % is one of each modal frequency ("mode") or of both moduli, 0.8 % each ("moduli"). In rows "pylons" one pylon is
cubic and the other quadratic; in rows "slip" both have an Iwan joint beside the cubic spring. In "spline saturating"
the stiffness of the pylons rises and saturates, as that of no power does, and in "spline cubic" they are cubic; the
classes are five of powers and a spline with eight knots. Rows "coverage study" run both phases from nominal moduli; the
other ones of coverage take the structure with its linear error as it is. Row "damping" has curves of damped pylons
under a force, whose modes have damping ratios that are known within 3 %; rows "forced" predict the response to 1.3
times the largest force of these curves, with the class that has both dampers, and with one that lacks the quadratic
damper. Rows "every sensor" predict motions, and mode 10, of which no curve is made; "wrong law" fits class 1, and in
"wrong structure" the linear error is 2 % where 0.4 % are stated. Rows "joint" update both moduli together with two
coefficients of each pylon by the no-U-turn sampler, in one core; "joint evidence" compares the evidence with nested
sampling (`pip install dynesty`). Rows "interaction" have curves of a damped structure under one force, whose points are
kept, paired with the loop or not, or left out where the third harmonic is within 1 % of a mode that it meets. In "wing"
the leaf springs are 5 % apart, so that three times the frequency of the first bending mode meets modes 10 and 11, and
that of the second comes near mode 13; "coupled" is the small structure of the tests, which an interaction moves much
more. In "elsewhere" the modes that are met lie 5 % higher in the model. The sensors of all rows are calibrated
exactly, and the studies say so, except in "gains": there every sensor has a gain that is 1 % off, and in "gains apart"
the two modes are held at different sensors.
"""

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

# before numpy is loaded, here and in every process that this one starts
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from harness import table_head, table_row
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from jointed_systems import CUBIC, two_pylons

from opid.estimate import Estimate
from opid.mechanics.backbones.family import backbone
from opid.mechanics.backbones.forced_curves import forced_curve
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.backbones.quadrature_curves import MeasuredCurve, quadrature_curve
from opid.mechanics.backbones.specimen import Specimen
from opid.mechanics.laws.law import Law, Term
from opid.updating.identification import update_study
from opid.updating.likelihood.backbones import BackboneData, backbone_data
from opid.updating.likelihood.curves import likelihood_function
from opid.updating.likelihood.error_growth import growth_of_linear_error
from opid.updating.likelihood.interactions import find_omitted_pull
from opid.updating.likelihood.noise import UNMENDED_GROWTH, NoiseSettings
from opid.updating.measured import MeasuredBackbone, reached_extensions
from opid.updating.model_class import PAPER_CLASSES, ModelClass, Prior, StiffnessFactor, UncertainTerm, spline_terms
from opid.updating.posterior import update_class
from opid.updating.prediction import predict
from opid.updating.settings import UPDATING
from opid.updating.structure.factored_modes import factored_modes
from opid.updating.structure.reduction import reduce
from opid.updating.study import UpdatingStudy
from opid.updating.unmeasured_modes import PredictionSettings, ResponseSettings, predict_unmeasured
from opid.virtual.backbone_tests.measured import (
    AMPLITUDE_M,
    BENDING_MODES,
    CONTROLLED,
    convert_curve,
    synthetic_backbones,
)
from opid.virtual.backbone_tests.wing_engine import UPDATED, WingEngine, laws_of_pylons, wing_engine_structure

FACTORS = tuple(UPDATED.values())
CLASSES, TRUTH, THETA = PAPER_CLASSES, PAPER_CLASSES[1], 1.58
UNUSED = 10  # a mode in which the pylons bend, and of which no curve is made
PYLONS = (1.58, 1.2)  # theta of a cubic and of a quadratic pylon
COUPLED, COUPLED_RATIO = (
    ModelClass("cubic", (UncertainTerm("cubic_stiffness", (6e7,), (Prior("uniform", 0, 3),)),)),
    0.003,
)
DAMPERS, RATIO, DRIVE = (0.1, 0.5), 0.001, "5"  # N s/m, N s^2/m^2; of the modes; where the force acts
SLIDERS = (0.3, 1e-3, 0.5, 0.5)  # force, N, and travel, m, at which all sliders of a joint slip, spread, jump
SLIP_SAMPLES = 2200  # a class of five parameters mixes slowly
SATURATED, TURN_M = 6000.0, 2.5e-3  # N/m at large extensions, and where half of it is reached
KNOTS_M = tuple(4e-4 * np.arange(1, 9))  # of a spline, up to nine tenths of the largest extension
SPLINE_SAMPLES = 20_000  # of nine parameters
BEYOND = 1.3  # force of a predicted response over the largest of the tests
ERRORS = {
    "large": {"offset_fraction": 0.0035, "point_noise": 0.001},
    "small": {},
}
EXACT = NoiseSettings(motion_error=0.0)
HARMONICS = {"paper": (1,), "literal": (1,), "independent": (1, 3), "recommended": (1, 3)}

Figures = dict[str, float]


def judge(of: str, estimate: Estimate, true: float) -> Figures:
    """Whether an estimate has an interval and this holds the truth, and how far it is off."""
    figures = {
        f"95 % interval of {of} is given": float(estimate.interval95 is not None),
        f"error of {of}, %": 100 * (estimate.value / true - 1),
    }
    if estimate.interval95 is not None:
        figures[f"95 % interval of {of} holds"] = float(estimate.holds(true))
        figures[f"standard deviation of {of}, %"] = 100 * estimate.std / true
    return figures


SYSTEMS: dict[tuple[float, ...], JointedModes] = {}


def system(aluminium: float = FACTORS[0], steel: float = FACTORS[1]) -> JointedModes:
    """The reduced wing-engine structure, made once in a process for the nominal factors."""
    key = (aluminium, steel)
    if key == FACTORS and key in SYSTEMS:
        return SYSTEMS[key]
    structure = wing_engine_structure()
    made = reduce(structure, dict(zip(structure.parts, key, strict=True)))
    if key == FACTORS:
        SYSTEMS[key] = made
    return made


def drawn(seed: int, linear: str) -> tuple[np.random.Generator, dict[str, float]]:
    """The source of all errors of a set, and its true moduli."""
    rng, structure = np.random.default_rng(seed), wing_engine_structure()
    # 0.8 % of a modulus is 0.4 % of a frequency
    shares = [1 + 0.008 * rng.standard_normal() if linear == "moduli" else 1.0 for _ in FACTORS]
    return rng, {name: float(f * share) for name, f, share in zip(structure.parts, FACTORS, shares, strict=True)}


def backbones(seed: int, errors: str, linear: str = "mode") -> tuple[MeasuredBackbone, ...]:
    """A synthetic set; the linear error is one of each modal frequency, of both moduli, or none."""
    rng, factors = drawn(seed, linear)
    true, share = system(*factors.values()), 0.004 if linear == "mode" else 0.0
    return synthetic_backbones(true, TRUTH, (THETA,), rng=rng, linear_error=share, **ERRORS[errors])


def prepared(measured: tuple[MeasuredBackbone, ...], form: str, **settings: Any) -> BackboneData:
    given = {"harmonics": HARMONICS[form], "noise": EXACT, **settings}
    return backbone_data(system(), measured, form=form, **given)  # type: ignore[arg-type]


def growth_of_parts(measured: tuple[MeasuredBackbone, ...]) -> dict[int, float]:
    """The growth of the linear error of each mode as a study of phase II alone has it (`opid.updating`)."""
    structure = wing_engine_structure()
    found = growth_of_linear_error(
        structure,
        dict(zip(structure.parts, FACTORS, strict=True)),
        measured,
        covariance=None,
        linear_error=EXACT.linear_error,
        n_modes=UpdatingStudy.n_internal,
    )
    return {mode: float(np.hypot(value, UNMENDED_GROWTH)) for mode, value in found.items()}


def classes(seed: int, form: str, errors: str) -> Figures:
    data = prepared(backbones(seed, errors), form)
    found = [update_class(data, each, rng=np.random.default_rng(seed), n_samples=2200) for each in CLASSES]
    evidence = np.array([each.log_evidence for each in found])
    figures = {"class 2 first": float(np.argmax(evidence) == 1)}
    figures |= {f"log evidence of class {k + 1} less class 2": evidence[k] - evidence[1] for k in (0, 2, 3, 4)}
    return figures


def grid_posterior(data: BackboneData) -> tuple[np.ndarray, np.ndarray]:
    """theta of class 2 and its posterior, by evaluation on ever narrower grids: no chance in it."""
    centre, half = THETA, 0.5
    for _ in range(4):
        theta = np.linspace(max(centre - half, 0.0), centre + half, 81)
        value, _ = likelihood_function(data, TRUTH)(theta[:, None])
        share = np.exp(value - value.max())
        share /= share.sum()
        centre = float(share @ theta)
        half = 6 * max(float(np.sqrt(share @ (theta - centre) ** 2)), half / 60)
    return theta, share


def coverage(seed: int, form: str, errors: str, linear: str) -> Figures:
    measured = backbones(seed, errors, linear)
    data = prepared(measured, form, growth=growth_of_parts(measured) if form == "recommended" else None)
    theta, share = grid_posterior(data)
    mean = float(share @ theta)
    level = float(np.interp(THETA, theta, np.cumsum(share) - share / 2))
    return {
        "95 % interval holds": float(0.025 <= level <= 0.975),
        "error of theta, %": 100 * (mean / THETA - 1),
        "standard deviation of theta, %": 100 * float(np.sqrt(share @ (theta - mean) ** 2)) / THETA,
    }


def gains(seed: int, errors: str, second: str) -> Figures:
    """Sensors whose gains are 1 % off, each by itself; the second mode is held at the sensor `second`."""
    rng = np.random.default_rng([seed, 1])
    gain = 1 + 0.01 * rng.standard_normal(len(system().sensors))
    measured = []
    for one in backbones(seed, errors):
        if one.mode == BENDING_MODES[1] and second != CONTROLLED:
            # the sensor that is held has no noise of its own
            held, other = one.sensors.index(CONTROLLED), one.sensors.index(second)
            amplitude = one.amplitude.copy()
            amplitude[:, other] = amplitude[:, held] * np.mean(amplitude[:, other] / amplitude[:, held])
            one = replace(one, amplitude=amplitude, controlled_sensor=second)
        measured.append(replace(one, amplitude=gain * one.amplitude))
    data = prepared(tuple(measured), "recommended", noise=NoiseSettings())
    found = update_class(data, TRUTH, rng=np.random.default_rng(seed), n_samples=2200)
    (estimate,) = found.estimates.values()
    mean, alone = found.chain.pooled.mean(), found.chain.pooled.std()
    return {
        **judge("theta", estimate, THETA),
        "it would hold without the calibration": float(abs(mean - THETA) < 1.96 * alone),
    }


def coverage_study(seed: int, form: str, errors: str, linear: str) -> Figures:
    """Both phases, from the matrices with nominal moduli: the linear error is one that phase I meets."""
    structure = wing_engine_structure()
    study = UpdatingStudy(
        title="coverage",
        structure=structure,
        backbones=backbones(seed, errors, linear),
        classes=(TRUTH,),
        parameters=dict.fromkeys(structure.parts, Prior("uniform", 0.05, 5.0)),
        form=form,  # type: ignore[arg-type]
        harmonics=HARMONICS[form],
        noise=EXACT,
        n_samples=1000,
        seed=seed,
    )
    found = update_study(study)
    true = {**drawn(seed, linear)[1], "theta": THETA}
    figures = {}
    for name, estimate in {**found.linear.estimates, "theta": found.classes[0].estimates["theta_1"]}.items():
        figures |= judge(name, estimate, true[name])
    return figures


def pylons(seed: int, errors: str) -> Figures:
    """One pylon is cubic and the other quadratic; seven classes, in which they share a law or do not."""
    quadratic, cubic = CLASSES[:2]
    apart = laws_of_pylons(cubic, quadratic)
    others = (
        *CLASSES[:2],
        ModelClass("the same sum of both", (*cubic.terms, *quadratic.terms)),
        *(laws_of_pylons(*pair) for pair in ((quadratic, cubic), (cubic, cubic), (quadratic, quadratic))),
    )
    rng = np.random.default_rng(seed)
    measured = synthetic_backbones(system(), apart, PYLONS, rng=rng, linear_error=0.004, **ERRORS[errors])
    data = prepared(measured, "recommended")
    found = [update_class(data, each, rng=np.random.default_rng(seed), n_samples=2200) for each in (apart, *others)]
    best = max(found, key=lambda each: each.log_evidence)
    second = max(each.log_evidence for each in found[1:])
    figures = {
        "true class first": float(best is found[0]),
        "log evidence above the next": found[0].log_evidence - second,
    }
    for name, estimate, true in zip(("cubic", "quadratic"), found[0].estimates.values(), PYLONS, strict=True):
        figures |= judge(f"the {name} one", estimate, true)
    return figures


def slip(seed: int, errors: str) -> Figures:
    """Both pylons have a cubic spring and an Iwan joint; four classes, curves of two modes without a force."""
    wide, (cubic,) = Prior("lognormal", 1.0, 1.0), TRUTH.terms
    iwan = UncertainTerm("iwan_friction", (*SLIDERS[:2], 1.0, 1.0), (Prior(), wide, Prior("uniform", 0.2, 0.9), wide))
    dahl = UncertainTerm("dahl_friction", SLIDERS[:2], (Prior(), wide))
    sets = {"iwan": (iwan,), "cubic": (), "dahl": (dahl,)}
    apart = [ModelClass(name, (cubic, *terms)) for name, terms in sets.items()]
    true = ModelClass("true", (cubic, replace(iwan, scales=SLIDERS, priors=(Prior(), None, None, None))))
    rng = np.random.default_rng(seed)
    measured = synthetic_backbones(system(), true, (THETA, 1.0), rng=rng, linear_error=0.004, **ERRORS[errors])
    data = backbone_data(system(), measured, noise=EXACT, slips=True)
    found = [
        update_class(data, each, rng=np.random.default_rng(seed), n_samples=SLIP_SAMPLES)
        for each in (*apart, ModelClass("iwan alone", (iwan,)))
    ]
    own, *others = found
    figures = {
        "true class first": float(own.log_evidence > max(each.log_evidence for each in others)),
        "effective samples": own.diagnostics.effective_samples,
    }
    values = {"cubic spring": THETA, "slip force": 1.0, "travel": 1.0, "spread": SLIDERS[2], "jump": SLIDERS[3]}
    for (name, value), estimate in zip(values.items(), own.estimates.values(), strict=True):
        figures |= judge(f"the {name}", estimate, value)
    return figures


def spline_classes() -> tuple[ModelClass, ...]:
    """Five classes of powers, and last a spline with a knot every 0.4 mm."""
    scale, wide = SATURATED / (3 * TURN_M**2), Prior("uniform", -10.0, 10.0)
    cubic = UncertainTerm("cubic_stiffness", (scale,), (Prior(),))
    any_power = UncertainTerm(
        "signed_power_stiffness", (1e6, 1.0), (Prior("lognormal", 1.0, 5.0), Prior("uniform", 1.0, 6.0))
    )
    sets = {
        "quadratic": (UncertainTerm("quadratic_stiffness", (1e-3 * scale,), (Prior(),)),),
        "cubic": (cubic,),
        "cubic + quartic": (cubic, UncertainTerm("quartic_stiffness", (1e2 * scale,), (wide,))),
        "cubic + quintic": (cubic, UncertainTerm("quintic_stiffness", (1e5 * scale,), (wide,))),
        "any power": (any_power,),
        "spline": spline_terms([scale] * (len(KNOTS_M) + 1), KNOTS_M),
    }
    return tuple(ModelClass(name, terms) for name, terms in sets.items())


def spline(seed: int, truth: str) -> Figures:
    """A law of unknown form against classes of powers, and the band of its force against the true one."""
    saturating = (
        UncertainTerm("signed_power_stiffness", (SATURATED, 1.0), (Prior(), None)),
        UncertainTerm("arctan_displacement", (-SATURATED * TURN_M * np.pi / 2, TURN_M), (Prior(), None)),
    )
    true, theta = (TRUTH, (THETA,)) if truth == "cubic" else (ModelClass("saturating", saturating), (1.0, 1.0))
    rng = np.random.default_rng(seed)
    measured = synthetic_backbones(system(), true, theta, rng=rng, linear_error=0.004, **ERRORS["large"])
    data = prepared(measured, "recommended")
    *powers, own = (
        update_class(
            data, each, rng=np.random.default_rng(seed), n_samples=SPLINE_SAMPLES if each.name == "spline" else 2200
        )
        for each in spline_classes()
    )
    best = max(powers, key=lambda each: each.log_evidence)
    reach = max(reached_extensions(data.system, measured).values())
    extension = np.append(np.linspace(0.0, reach, 41)[1:], 1.5 * reach)
    drawn = [own.model_class.law("9-10", theta).force(extension, 0.0) for theta in own.samples[::5]]
    low, high = np.quantile(drawn, [0.025, 0.975], axis=0)
    force = true.law("9-10", theta).force(extension, 0.0)
    holds, half = (low <= force) & (force <= high), 50 * (high - low) / force
    return {
        "spline first": float(own.log_evidence > best.log_evidence),
        "cubic first": float(own.log_evidence < best.log_evidence and best.model_class.name == "cubic"),
        "log evidence of the spline less the best power": own.log_evidence - best.log_evidence,
        "true force within the band, extensions of the tests": float(holds[:-1].mean()),
        "true force within the band, 1.5 times the largest": float(holds[-1]),
        "half width of the band at the largest extension, %": float(half[-2]),
        "half width at 1.5 times the largest, %": float(half[-1]),
        "effective samples of the spline": own.diagnostics.effective_samples,
    }


def joint_study(seed: int, errors: str, linear: str) -> tuple[UpdatingStudy, dict[str, float]]:
    """Both pylons are cubic and quintic; the moduli and all four coefficients are unknown. With the truth."""
    structure, both = wing_engine_structure(), CLASSES[4]
    apart = laws_of_pylons(both, both)
    rng, factors = drawn(seed, linear)
    theta = (1.49, 0.51, 1.3, 0.6)
    share = 0.004 if linear == "mode" else 0.0
    measured = synthetic_backbones(
        system(*factors.values()), apart, theta, rng=rng, linear_error=share, **ERRORS[errors]
    )
    study = UpdatingStudy(
        title="joint", structure=structure, backbones=measured, classes=(apart,), is_joint=True, sampler="nuts",
        parameters=dict.fromkeys(structure.parts, Prior("uniform", 0.05, 5.0)), noise=EXACT, seed=seed,
    )  # fmt: skip
    return study, dict(zip([f"theta_{k}" for k in range(1, 7)], [*theta, *factors.values()], strict=True))


def joint(seed: int, errors: str, linear: str) -> Figures:
    study, true = joint_study(seed, errors, linear)
    cpu, wall = process_time(), perf_counter()
    found = update_study(study).classes[0]
    figures = {
        "CPU s": process_time() - cpu,
        "wall s": perf_counter() - wall,
        "effective samples, least": found.diagnostics.effective_samples,
        "standard deviation of the log evidence": found.evidences[0].std,
    }
    for name, each, estimate in zip(true, found.model_class.parameters, found.estimates.values(), strict=True):
        figures |= judge(each.key, estimate, true[name])
    return figures


def joint_evidence(seed: int, errors: str, linear: str) -> Figures:
    """The evidence of six parameters against dynesty, which walks from the prior to the posterior by itself."""
    from dynesty import NestedSampler

    study, _ = joint_study(seed, errors, linear)
    rng = np.random.default_rng(seed)
    noise = replace(EXACT, linear_error_growth=0.22)  # stated, so that both methods have the same density
    parts = study.structure.parts
    structure = factored_modes(study.structure, dict(zip(parts, FACTORS, strict=True)), 1e-4 * np.eye(2))
    data = replace(backbone_data(system(), study.backbones, noise=noise), structure=structure)
    factors = tuple(StiffnessFactor(name, Prior("uniform", 0.05, 5.0)) for name in parts)
    model_class = replace(study.classes[0], factors=factors)
    found = update_class(data, model_class, rng=rng, sampler="nuts")
    likelihood = likelihood_function(data, model_class)

    def evaluate(theta: np.ndarray) -> float:
        return max(float(likelihood(theta[None])[0][0]), -1e300)

    def place(cube: np.ndarray) -> np.ndarray:
        return np.array([p.support[0] + c * np.ptp(p.support) for p, c in zip(model_class.priors, cube, strict=True)])

    nested = NestedSampler(evaluate, place, 6, nlive=300, sample="rwalk", rstate=rng)
    nested.run_nested(print_progress=False)
    reference, error = float(nested.results.logz[-1]), float(nested.results.logzerr[-1])
    importance, laplace = found.evidences
    apart = importance.log_evidence - reference
    return {
        "importance sampling less nested sampling": apart,
        "stated error of the first": importance.std,
        "stated error of the second": error,
        "within two of both errors": float(abs(apart) <= 2 * np.hypot(importance.std, error)),
        "Laplace less nested sampling": laplace.log_evidence - reference,
    }


def bands(seed: int, form: str, errors: str) -> Figures:
    measured = backbones(seed, errors)
    data = prepared(measured, form)
    found = update_class(data, TRUTH, rng=np.random.default_rng(seed), n_samples=2200)
    both = predict(data, found, measured, rng=np.random.default_rng(seed))
    figures = {f"measured points within the 95 % band, mode {band.mode}": band.coverage for band in both}
    return figures | {f"points of curves left out, mode {band.mode}": band.left_out for band in both}


def whole_curves(specimen: Specimen) -> tuple[MeasuredCurve, ...]:
    """Curves of a damped wing under a force by harmonic balance, those that reach quadrature everywhere."""
    curves = [
        quadrature_curve(
            specimen, mode=mode, sensor=sensor, controlled_sensor=CONTROLLED,
            amplitude=np.linspace(least, most, 20), harmonics=(1, 3),
        )
        for mode, (least, most) in zip(BENDING_MODES, AMPLITUDE_M, strict=True)
        for sensor in specimen.system.sensors
    ]  # fmt: skip
    return tuple(curve for curve in curves if len(curve.levels) == 20 and curve.converged.all())


def damped_specimen() -> Specimen:
    """The damped pylons with a force at sensor 5."""
    (cubic,) = TRUTH.law("", (THETA,)).terms
    law = Law((cubic, Term("signed_power_damping", (DAMPERS[0], 1.0)), Term("quadratic_damping", (DAMPERS[1],))))
    return Specimen(system(), law, RATIO, DRIVE)


@cache
def damped_curves() -> tuple[MeasuredCurve, ...]:
    """Curves of damped pylons under a force at sensor 5."""
    return whole_curves(damped_specimen())


def damped_backbones(
    true_system: JointedModes, curves: tuple[MeasuredCurve, ...], drive: str, rng: np.random.Generator
) -> tuple[tuple[MeasuredBackbone, ...], dict[int, float]]:
    """Such curves with errors: 2 % of calibration, 0.5 % of each force, 0.4 % of each linear frequency, shapes.

    With the error of lambda of each mode, 1/s^2.
    """
    gain, found = 1 + 0.02 * rng.standard_normal(), []
    # an error of the modal eigenvalue, which does not grow along the backbone
    modes = sorted({curve.mode for curve in curves})
    shift = {mode: 0.008 * rng.standard_normal() * true_system.eigenvalue[mode - 1] for mode in modes}
    for curve in curves:
        true = convert_curve(curve, drive)
        shapes = true.amplitude + 0.005 * np.linalg.norm(true.amplitude, axis=1, keepdims=True) * rng.standard_normal(
            true.amplitude.shape
        )
        shapes[:, true.sensors.index(true.controlled_sensor)] = true.controlled_amplitude
        n = true.frequency_hz.size
        hz = np.sqrt(true.eigenvalue + shift[true.mode]) / (2 * np.pi) * (1 + 1e-4 * rng.standard_normal(n))
        force = gain * true.force_n * (1 + 0.005 * rng.standard_normal(n))
        found.append(replace(true, frequency_hz=hz, amplitude=shapes, force_n=force))
    return tuple(found), shift


def damped_study(seed: int, names: tuple[str, ...]) -> tuple[UpdatingStudy, dict[int, float], np.random.Generator]:
    """A study of these curves with classes of linear and quadratic dampers, the error of lambda, and more chance."""
    rng = np.random.default_rng(seed)
    linear = UncertainTerm("signed_power_damping", (DAMPERS[0], 1.0), (Prior(), None))
    quadratic = UncertainTerm("quadratic_damping", (DAMPERS[1],), (Prior(),))
    sets = {"both": (linear, quadratic), "linear": (linear,), "quadratic": (quadratic,)}
    known = {mode: RATIO * np.exp(0.03 * rng.standard_normal()) for mode in BENDING_MODES}
    measured, shift = damped_backbones(system(), damped_curves(), DRIVE, rng)
    study = UpdatingStudy(
        title="damping", structure=system(), backbones=measured, seed=seed, noise=EXACT,
        classes=tuple(ModelClass(name, (*TRUTH.terms, *sets[name])) for name in names),
        damping={mode: Prior("lognormal", ratio, 0.03) for mode, ratio in known.items()},
    )  # fmt: skip
    return study, shift, rng


def damping(seed: int) -> Figures:
    """Linear and quadratic dampers beside the cubic spring; three classes, two of which lack one of the dampers."""
    found = update_study(damped_study(seed, ("both", "linear", "quadratic"))[0])
    figures = {"both dampers chosen": float(found.best_class == "both")}
    true = (THETA, 1.0, 1.0, RATIO, RATIO)
    for each, (parameter, estimate), value in zip(
        ("cubic spring", "linear damper", "quadratic damper", "damping ratio of mode 7", "damping ratio of mode 8"),
        found.classes[0].coefficients.items(), true, strict=True,
    ):  # fmt: skip
        figures |= judge(f"the {each}", estimate, value * parameter.scale)
    return figures


@cache
def uneven_curves() -> tuple[JointedModes, tuple[MeasuredCurve, ...]]:
    """The wing whose leaf springs differ, and its curves under a force at sensor 7."""
    uneven = reduce(wing_engine_structure(WingEngine(leaf_asymmetry=0.05)), UPDATED)
    return uneven, whole_curves(Specimen(uneven, TRUTH.law("", (THETA,)), RATIO, "7"))


@cache
def coupled_curves() -> tuple[JointedModes, tuple[MeasuredCurve, ...]]:
    """The small structure of the tests, whose third harmonic moves its joints much, and its curves."""
    coupled = two_pylons(0.05)
    curves = [
        quadrature_curve(
            Specimen(coupled, CUBIC, COUPLED_RATIO, "plate 2"), mode=3, sensor=sensor, controlled_sensor="tip 1",
            amplitude=np.linspace(2e-4, 2.5e-3, 60), harmonics=(1, 3),
        )
        for sensor in ("tip 1", "tip 2", "tip 3", "plate 2")
    ]  # fmt: skip
    return coupled, tuple(curves)


def interaction(seed: int, structure: str, elsewhere: float = 0.0) -> Figures:
    """Points in an interaction paired with it, taken as points of the smooth curve, and left out.

    The frequencies of the modes that are met have an error of 0.4 %, or lie elsewhere by a fraction.
    """
    is_wing = structure == "wing"
    true_system, curves = uneven_curves() if is_wing else coupled_curves()
    drive, model_class, theta, ratio = (
        ("7", TRUTH, THETA, RATIO) if is_wing else ("plate 2", COUPLED, 1.0, COUPLED_RATIO)
    )
    met = np.array([9, 10, 12] if is_wing else [8])
    rng = np.random.default_rng(seed)
    driven, _ = damped_backbones(true_system, curves, drive, rng)
    measured = tuple(replace(one, drive="", force_n=None) for one in driven)
    eigenvalue = true_system.eigenvalue.copy()
    eigenvalue[met] *= (1 + (elsewhere or 0.004 * rng.standard_normal())) ** 2
    known = replace(true_system, eigenvalue=eigenvalue)
    apart = [np.abs(3 * one.frequency_hz[:, None] / known.frequency_hz[met] - 1).min(axis=1) > 0.01 for one in measured]
    fewer = tuple(
        replace(one, frequency_hz=one.frequency_hz[kept], amplitude=one.amplitude[kept])
        for one, kept in zip(measured, apart, strict=True)
    )
    whole = backbone_data(known, measured, noise=EXACT)
    sets = {
        "paired": replace(whole, met_damping=ratio),
        "smooth": whole,
        "left out": backbone_data(known, fewer, noise=EXACT),
    }
    if is_wing:
        # what is left of the interval where no error of the linear structure grows with the motion
        steady = backbone_data(known, measured, noise=replace(EXACT, linear_error_growth=0.0))
        sets["paired, no error grows"] = replace(steady, met_damping=ratio)
    figures, width = {"points left out, %": 100 * float(1 - np.concatenate(apart).mean())}, {}
    for name, data in sets.items():
        found = update_class(data, model_class, rng=np.random.default_rng(seed), n_samples=2200)
        (estimate,) = found.estimates.values()
        width[name] = estimate.std or np.nan
        pull = (
            abs(find_omitted_pull(data, model_class, found.best, found.covariance)[0]) / found.covariance[0, 0] ** 0.5
        )
        figures[f"standard deviations by which pairing would move theta, {name}"] = float(pull)
        told = any("no interval" in each or "leave those points out" in each for each in found.warnings)
        figures |= judge(f"theta, {name}", estimate, theta)
        figures[f"it holds or the points are told, {name}"] = float(told or estimate.holds(theta))
    return figures | {"width of the interval, paired over left out": width["paired"] / width["left out"]}


def forced(seed: int, name: str) -> Figures:
    """The response at the controlled sensor to 1.3 times the largest force of the tests, read in another test."""
    study, shift, rng = damped_study(seed, (name,))
    largest = {mode: max(one.force_n.max() for one in study.backbones if one.mode == mode) for mode in BENDING_MODES}
    asked = tuple(
        ResponseSettings(mode=mode, drive=DRIVE, sensor=CONTROLLED, force_n=(BEYOND * force,))
        for mode, force in largest.items()
    )
    found = update_study(replace(study, n_samples=2200, prediction=PredictionSettings(responses=asked)))
    figures = {
        f"the response of mode {mode} is given": float(any(each.mode == mode for each in found.responses))
        for mode in BENDING_MODES
    }
    for each in found.responses:
        force_n = each.force_n * (1 + 0.02 * rng.standard_normal())
        curve = forced_curve(damped_specimen(), mode=each.mode, sensor=CONTROLLED, force_n=force_n, harmonics=(1, 3))
        hz, amplitude = curve.resonance
        hz = np.sqrt(hz**2 + shift[each.mode] / (4 * np.pi**2))
        for what, true, estimate in (("frequency", hz, each.peak_hz), ("amplitude", amplitude, each.peak_amplitude)):
            figures |= judge(f"the {what} of mode {each.mode}", estimate, true)
        figures[f"mode {each.mode} is told to be extrapolated"] = float(each.is_extrapolated)
    return figures


def every_sensor(seed: int, errors: str, fault: str = "") -> Figures:
    """Bands of every sensor, of curves and modes left out, and of a mode that was not used.

    With a fault the law is a wrong one (class 1), or the linear error is 2 % where 0.4 % are stated.
    """
    model_class, share = CLASSES[0] if fault == "law" else TRUTH, 0.02 if fault == "structure" else 0.004
    rng = np.random.default_rng(seed)
    measured = synthetic_backbones(system(), TRUTH, (THETA,), rng=rng, linear_error=share, **ERRORS[errors])
    data = prepared(measured, "recommended")
    found = update_class(data, model_class, rng=rng, n_samples=2200)
    figures = {}
    for band in predict(data, found, measured, rng=rng):
        figures[f"motions of curves left out within their bands, mode {band.mode}"] = float(
            np.mean([own.left_out for own in band.sensors])
        )
        figures[f"the sensor with the fewest, mode {band.mode}"] = min(own.left_out for own in band.sensors)
        figures[f"points of a whole mode left out, mode {band.mode}"] = (
            np.nan if band.mode_left_out is None else band.mode_left_out
        )
    theta = found.samples[rng.integers(len(found.samples), size=UPDATING.n_predicted)]
    wanted = PredictionSettings(modes=(UNUSED,))
    (band,), _ = predict_unmeasured(data, model_class, theta, wanted, measured, rng=rng)
    # The frequency of this mode has an error of its own, as that of those that were measured.
    eigenvalue = system().eigenvalue.copy()
    eigenvalue[UNUSED - 1] *= (1 + share * np.random.default_rng([seed, 1]).standard_normal()) ** 2
    true_system, law = replace(system(), eigenvalue=eigenvalue), TRUTH.law("9-10", (THETA,))
    true = backbone(true_system, law, mode=UNUSED, sensor=band.sensor, amplitude=band.amplitude, harmonics=(1, 3, 5, 7))
    held = [
        np.mean((own.low <= motion) & (motion <= own.high))
        for own in band.sensors
        for motion in [true.shapes[:, true_system.sensor(own.sensor)]]
    ]
    return figures | {
        f"true frequency of mode {UNUSED}, not used, within its band": float(
            np.mean((band.low_hz <= true.frequency_hz) & (true.frequency_hz <= band.high_hz))
        ),
        f"true motions of mode {UNUSED} within their bands": float(np.mean(held)),
        "half width of its band, %": 50 * float(np.mean((band.high_hz - band.low_hz) / band.frequency_hz)),
    }


def evidence(seed: int, form: str, errors: str) -> Figures:
    data = prepared(backbones(seed, errors), form)
    figures = {}
    for each in CLASSES:
        found = update_class(
            data, each, rng=np.random.default_rng(seed), evidences=("quadrature", "laplace", "transitional")
        )
        exact, laplace, stages = found.evidences
        score = (stages.log_evidence - exact.log_evidence) / stages.std
        figures[f"{each.name}: Laplace less quadrature"] = laplace.log_evidence - exact.log_evidence
        figures[f"{each.name}: transitional less quadrature"] = stages.log_evidence - exact.log_evidence
        figures[f"{each.name}: transitional within two of its standard deviations"] = float(abs(score) <= 2)
    return figures


def times(seed: int, form: str) -> Figures:
    data = prepared(backbones(seed, "large"), form)
    update_class(data, CLASSES[1], rng=np.random.default_rng(0), n_samples=1000)  # compiles
    cpu, wall = process_time(), perf_counter()
    found = [update_class(data, each, rng=np.random.default_rng(seed)) for each in CLASSES]
    return {
        "five classes x 5500 samples with evidence, CPU s": process_time() - cpu,
        "the same, wall s": perf_counter() - wall,
        "effective samples, least": min(each.diagnostics.effective_samples for each in found),
    }


Row = tuple[Callable[..., Figures], tuple[object, ...], int]
FORMS = ("recommended", "paper", "independent")
ROWS: dict[str, Row] = {
    **{f"classes {form} {errors}": (classes, (form, errors), 30)
       for form in ("paper", "literal", "recommended") for errors in ERRORS},
    **{f"coverage {form} {errors} {linear}": (coverage, (form, errors, linear), 200)
       for form in FORMS for errors in ERRORS for linear in ("mode", "moduli", "none")},
    **{f"coverage study {form} {errors} {linear}": (coverage_study, (form, errors, linear), 200)
       for form in ("recommended", "paper") for errors in ERRORS for linear in ("mode", "moduli")},
    **{f"gains {errors}": (gains, (errors, CONTROLLED), 60) for errors in ERRORS},
    **{f"gains apart {errors}": (gains, (errors, "14"), 60) for errors in ERRORS},
    **{f"pylons {errors}": (pylons, (errors,), 60) for errors in ERRORS},
    **{f"slip {errors}": (slip, (errors,), 20) for errors in ERRORS},
    **{f"spline {truth}": (spline, (truth,), 20) for truth in ("saturating", "cubic")},
    **{f"joint {errors} {linear}": (joint, (errors, linear), 60) for errors in ERRORS for linear in ("mode", "moduli")},
    "joint evidence": (joint_evidence, ("small", "mode"), 3),
    **{f"bands {form} {errors}": (bands, (form, errors), 30) for form in FORMS[:2] for errors in ERRORS},
    "damping": (damping, (), 60),
    **{f"interaction {structure}": (interaction, (structure,), 30) for structure in ("wing", "coupled")},
    **{f"interaction elsewhere {structure}": (interaction, (structure, 0.05), 10) for structure in ("wing", "coupled")},
    **{f"forced {name}": (forced, (name,), 20) for name in ("both", "linear")},
    **{f"every sensor {errors}": (every_sensor, (errors,), 30) for errors in ERRORS},
    **{f"every sensor wrong {fault}": (every_sensor, ("small", fault), 10) for fault in ("law", "structure")},
    **{f"evidence {form} large": (evidence, (form, "large"), 10) for form in FORMS[:2]},
    **{f"times {form}": (times, (form,), 3) for form in FORMS[:2]},
}  # fmt: skip


def one(job: tuple[str, int]) -> tuple[str, Figures | str]:
    name, seed = job
    make, given, _ = ROWS[name]
    try:
        return name, make(seed, *given)
    except Exception as error:
        return name, f"seed {seed}: {type(error).__name__}: {error}"


def lines(name: str, found: list[Figures]) -> Iterator[str]:
    for key in dict.fromkeys(key for each in found for key in each):
        values = np.array([each[key] for each in found if np.isfinite(each.get(key, np.nan))])  # a set may lack one
        if not values.size:
            continue
        spread = f"{np.mean(values):.4g}", f"{np.std(values):.3g}", f"{values.min():.4g}", f"{values.max():.4g}"
        yield table_row(name, key, *spread, values.size)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", default="", help="beginnings of the names of rows, with commas; all where left out")
    parser.add_argument("--seeds", type=int, help="how many, whatever the row asks for")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    wanted = tuple(part for part in args.rows.split(",") if part)
    names = [name for name in ROWS if not wanted or name.startswith(wanted)]
    system()
    failures = []
    print(table_head("row", "figure", "mean", "std", "least", "most", "sets"), flush=True)
    with get_context("fork").Pool(args.jobs) as pool:
        for name in names:
            jobs = [(name, seed) for seed in range(args.first, args.first + (args.seeds or ROWS[name][2]))]
            ran = tqdm(pool.imap_unordered(one, jobs), name, len(jobs), disable=not sys.stderr.isatty())
            results = [found for _, found in ran]
            failures += [f"{name}, {found}" for found in results if isinstance(found, str)]
            good = [found for found in results if not isinstance(found, str)]
            for line in lines(name, good) if good else ():
                print(line, flush=True)
    print("\n".join(failures))


if __name__ == "__main__":
    main()
