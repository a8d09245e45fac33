"""Two chains as one would write them today, without opid: to stand beside it on the same runs.

`least_squares`: each run's z'' is integrated twice, and the law, known to it, is fitted to -x2'' over (z, z') by
scipy's `curve_fit`. `sparse_regression`: pysindy's STLSQ on the same signals, which chooses among the laws that the
scenarios draw. Either way the mass follows from K2/M2 of two runs.

The integration is that of `endaq.calc.integrate`, trapezoidal rule after a zero-phase Butterworth high-pass of half
order 2, as one comes to use it once z is looked at: its single pass leaves so much slow drift here that the masses are
100 % off, so the high-pass is repeated after each integration, and x2'' passes it as often. A corner of 0.5 Hz was the
best of 0.3, 0.5, 0.7 and 1 Hz for both chains.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from estimator import GearRun, GearStudy
from scipy import integrate, optimize, signal

from opid.mechanics.laws.law import LAWS, Law, Term, default_law
from opid.signals.recording import FloatArray

HIGH_PASS_HZ, MARGIN_S = 0.5, 4.0
# a gear of 1.85 t at 2 Hz: where `curve_fit` begins
START_MASS_KG, START_PER_MASS = 1850.0, (200.0, 3.0)
OFFERED = ("arctan_velocity", "arctan_displacement", "quadratic_damping", "cubic_stiffness")
# share of the rms force below which STLSQ drops a term, and inner scales as a share of the rms motion
THRESHOLD, INNER_SHARE = 0.02, 0.5


@dataclass(frozen=True)
class PlainAnswer:
    """What a plain chain found; it has no intervals."""

    mass_kg: float
    stiffness_n_per_m: float
    damping_n_s_per_m: float
    law: Law


def integrated(study: GearStudy, run: GearRun) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return travel z (m), velocity z' (m/s) and force per mass -x2'' (m/s^2) of a run, its ends cut off."""
    sections = signal.butter(2, HIGH_PASS_HZ, "highpass", fs=study.fs, output="sos")
    lower, upper = study.accelerations(run)
    margin = round(MARGIN_S * study.fs)

    def high_passed(samples: FloatArray, times: int = 1) -> FloatArray:
        for _ in range(times):
            samples = signal.sosfiltfilt(sections, samples)
        return samples

    def integral(samples: FloatArray) -> FloatArray:
        return high_passed(integrate.cumulative_trapezoid(samples, dx=1 / study.fs, initial=0))

    velocity = integral(high_passed(upper - lower))
    signals = integral(velocity), high_passed(velocity), -high_passed(upper, times=3)
    travel, velocity, force_per_mass = (each[margin:-margin] for each in signals)
    return travel, velocity, force_per_mass


def least_squares(study: GearStudy, law_name: str) -> PlainAnswer:
    """Fit a known law to each run; raises RuntimeError where `curve_fit` finds no end."""
    start = default_law(law_name)
    kinds = [(term.kind, len(term.values)) for term in start.terms]

    def force_per_mass(motion: FloatArray, k: float, c: float, *values: float) -> FloatArray:
        z, v = motion
        force, rest = k * z + c * v, list(values)
        for kind, n in kinds:
            amplitude, *inner = rest[:n]
            rest = rest[n:]
            force = force + amplitude * kind.function(z, v, *np.abs(inner), *[1.0] * (3 - n))[0]
        return force

    fits = []
    for run in study.runs:
        travel, velocity, target = integrated(study, run)
        p0 = (*START_PER_MASS, *start.scaled(1 / START_MASS_KG).vector)
        fits.append(optimize.curve_fit(force_per_mass, np.stack([travel, velocity]), target, p0=p0)[0])
    values, terms = list(fits[0][2:]), []
    for kind, n in kinds:
        terms.append(Term(kind.name, (values[0], *np.abs(values[1:n]))))
        values = values[n:]
    return _answer(study, fits, Law(tuple(terms)))


def sparse_regression(study: GearStudy) -> PlainAnswer:
    """Let pysindy choose the terms for each run; the law is that of the first."""
    import pysindy

    fits, laws = [], []
    for run in study.runs:
        travel, velocity, target = integrated(study, run)
        scale = np.array([travel.std(), velocity.std()])
        moved = np.stack([travel, velocity], axis=1) / scale
        terms = [_unit_term(name, INNER_SHARE) for name in OFFERED]
        library = pysindy.CustomLibrary([lambda x, y: x, lambda x, y: y, *map(_force, terms)])
        optimizer = pysindy.STLSQ(threshold=THRESHOLD, alpha=1e-8)
        model = pysindy.SINDy(optimizer=optimizer, feature_library=library)
        # only the second equation is read: the force over the library
        rate = np.stack([moved[:, 1], target / target.std()], axis=1)
        model.fit(moved, t=1 / study.fs, x_dot=rate)
        weights = np.asarray(model.coefficients())[1] * target.std()
        fits.append(weights[:2] / scale)
        laws.append(Law(tuple(_in_units(t, w, scale) for t, w in zip(terms, weights[2:], strict=True) if w)))
    return _answer(study, fits, laws[0])


def _unit_term(name: str, inner: float) -> Term:
    return Term(name, (1.0, *[inner] * (len(LAWS[name].parameters) - 1)))


def _force(term: Term) -> Callable[[FloatArray, FloatArray], FloatArray]:
    # pysindy counts the arguments of a function of its library
    return lambda x, y: term.evaluate(x, y)[0]


def _in_units(term: Term, weight: float, scale: FloatArray) -> Term:
    """A term of motion over its rms as a term of motion."""
    own = float(scale[0] if term.name in ("arctan_displacement", "cubic_stiffness") else scale[1])
    power = {"quadratic_damping": 2, "cubic_stiffness": 3}.get(term.name, 0)
    return Term(term.name, (float(weight) / own**power, *(own * each for each in term.inner)))


def _answer(study: GearStudy, fits: list[FloatArray], law_per_mass: Law) -> PlainAnswer:
    """K2/M2 of the first run, where nothing was changed, and of the second: K2 = k (M2 + dM) in both."""
    (first, second), change = fits, study.runs[1].mass_change_kg
    mass = float(change * second[0] / (first[0] - second[0]))
    return PlainAnswer(mass, float(first[0]) * mass, float(first[1]) * mass, law_per_mass.scaled(mass))
