"""Laws that the benchmarks draw: four kinds in fixed ranges, pairs of them, and every kind that should be found."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from opid.mechanics.laws.law import LINEAR, Law, law
from opid.mechanics.weight import GRAVITY_M_PER_S2
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_run

# kinds and ranges of their parameters, each drawn evenly on a logarithmic scale
RANGES = {
    "arctan_velocity": {"amplitude_n": (100, 2000), "scale_m_per_s": (0.005, 0.05)},
    "arctan_displacement": {"amplitude_n": (100, 2000), "scale_m": (5e-4, 5e-3)},
    "quadratic_damping": {"damping_n_s2_per_m2": (1e4, 1e5)},
    "cubic_stiffness": {"stiffness_n_per_m3": (1e9, 1e10)},
}
PAIRS = (
    ("arctan_velocity", "cubic_stiffness"),
    ("arctan_velocity", "quadratic_damping"),
    ("quadratic_damping", "cubic_stiffness"),
    ("arctan_displacement", "arctan_velocity"),
)
ALL_KINDS = (
    "arctan_velocity",
    "arctan_displacement",
    "arctan_mixed",
    "coulomb_friction",
    "quadratic_damping",
    "cubic_damping",
    "asymmetric_damping",
    "blow_off_damping",
    "quadratic_stiffness",
    "even_quadratic_stiffness",
    "cubic_stiffness",
    "quintic_stiffness",
    "asymmetric_stiffness",
    "dead_zone_stiffness",
    "bump_stop",
    "rebound_stop",
    "gas_column",
)
"""The built-in kinds that are searched by their scales, and the paper's own equation (3)."""

# of `typical_motion`: long enough for a rms to a few per cent
TYPICAL_S = 20.0


@dataclass(frozen=True)
class Motion:
    """The rms travel (m) and rate (m/s) of a gear without a law on a road of a class."""

    travel_m: float
    rate_m_per_s: float


def drawn_term(kind: str, rng: np.random.Generator) -> Law:
    """Return a law of one term with parameters drawn from `RANGES`."""
    return law(kind, **{name: log_uniform(rng, *limits) for name, limits in RANGES[kind].items()})


def random_law(rng: np.random.Generator) -> Law:
    return drawn_term(list(RANGES)[rng.integers(len(RANGES))], rng)


def random_pair(rng: np.random.Generator) -> Law:
    first, second = PAIRS[rng.integers(len(PAIRS))]
    return drawn_term(first, rng) + drawn_term(second, rng)


def typical_motion(gear: LandingGear, *, road_class: str) -> Motion:
    """Return how far a gear would move without its law; the same road for every gear, so nothing is drawn here."""
    linear = replace(gear, law=LINEAR)
    run = taxi_run(linear, rng=np.random.default_rng(0), duration_s=TYPICAL_S, road_class=road_class)
    return Motion(run.truth.rms["travel"], run.truth.rms["travel_velocity"])


def law_of_kind(kind: str, gear: LandingGear, motion: Motion, rng: np.random.Generator) -> Law:
    """Draw a law of one of `ALL_KINDS` for a gear: what a strut of its size can have, on the motion that it makes.

    Each size is drawn evenly on a logarithmic scale over about a decade around the default of its kind; each choice of
    a side is drawn evenly.
    """
    if kind in RANGES:
        return drawn_term(kind, rng)
    k2, c2 = gear.suspension_stiffness_n_per_m, gear.suspension_damping_n_s_per_m
    if kind == "arctan_mixed":
        # force and scale as the two arctangents that it lies between; at 2 Hz z' is 13 times z, so that a lag of 0.02 s
        # is a spring that gives way with some friction, and one of 0.1 s is friction for the most part
        return law(
            kind,
            amplitude_n=log_uniform(rng, 100, 2000),
            scale_m=log_uniform(rng, 5e-4, 5e-3),
            lag_s=log_uniform(rng, 0.02, 0.1),
        )
    if kind == "coulomb_friction":
        # the same friction as `arctan_velocity`, only sooner full
        return law(kind, amplitude_n=log_uniform(rng, 100, 2000), scale_m_per_s=log_uniform(rng, 0.005, 0.05))
    if kind == "cubic_damping":
        # a decade about the default: at a rms rate of 0.06 m/s (road B) its rms force is 0.1 to 1.3 kN, that of the
        # linear damper 0.4 kN
        return law(kind, damping_n_s3_per_m3=log_uniform(rng, 1.5e5, 1.5e6))
    if kind == "quadratic_stiffness":
        # a decade about the default: at 4 mm (road B) it adds 0.04 to 0.4 MN/m to a spring of 0.15 to 1 MN/m
        return law(kind, stiffness_n_per_m2=log_uniform(rng, 1e7, 1e8))
    if kind == "even_quadratic_stiffness":
        # a spring that hardens as it is compressed, as a curve about another point than the rest does: at three times
        # the rms travel its tangent has changed by 5 to 35 %, so that it stays positive at seven
        return law(
            kind, stiffness_n_per_m2=either_side(rng) * k2 * log_uniform(rng, 0.05, 0.35) / (6.0 * motion.travel_m)
        )
    if kind == "asymmetric_damping":
        # rebound over compression damping (C + c) / (C - c) of 1.2 to 4, as valves have it, or the inverse; |c| < C
        return law(kind, damping_n_s_per_m=either_side(rng) * c2 * log_uniform(rng, 0.1, 0.6))
    if kind == "blow_off_damping":
        # a relief valve takes away 30 to 90 % of the damping, so that the damper always damps; it opens at a rate which
        # the motion passes often (0.3 of its rms) or now and then (1.5)
        return law(
            kind,
            damping_n_s_per_m=-c2 * log_uniform(rng, 0.3, 0.9),
            scale_m_per_s=motion.rate_m_per_s * log_uniform(rng, 0.3, 1.5),
        )
    if kind == "quintic_stiffness":
        # it hardens late: at three times the rms travel, near the largest of a run, its force is 10 to 100 % of the
        # spring's. A decade of absolute values would not do: between roads A and C the force changes by 4^5 = 1000
        return law(kind, stiffness_n_per_m5=k2 * log_uniform(rng, 0.1, 1.0) / (3.0 * motion.travel_m) ** 4)
    if kind == "asymmetric_stiffness":
        # a helper spring or a preload on either side, 10 to 50 % of the spring
        return law(kind, stiffness_n_per_m=either_side(rng) * k2 * log_uniform(rng, 0.1, 0.5))
    if kind == "dead_zone_stiffness":
        # a decade of bump stops, 0.25 to 2.5 times the spring, at a gap that the motion passes often or now and then
        return law(
            kind,
            stiffness_n_per_m=k2 * log_uniform(rng, 0.25, 2.5),
            gap_m=motion.travel_m * log_uniform(rng, 0.3, 1.5),
        )
    if kind in ("bump_stop", "rebound_stop"):
        # a rubber as stiff as the spring to ten times as stiff, which the motion meets now and then
        return law(
            kind,
            stiffness_n_per_m=k2 * log_uniform(rng, 1.0, 10.0),
            gap_m=motion.travel_m * log_uniform(rng, 0.7, 2.0),
        )
    if kind == "gas_column":
        # the gas carries the weight, and its tangent n F0 / h is the spring's: there is none beside it
        static_n, exponent = gear.sprung_mass_kg * GRAVITY_M_PER_S2, rng.uniform(1.1, 1.35)
        return law(kind, static_force_n=static_n, gas_length_m=exponent * static_n / k2, exponent=exponent)
    raise ValueError(f"no range is given for the kind {kind!r}")


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def either_side(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))
