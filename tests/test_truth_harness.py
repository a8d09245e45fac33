"""The truth harness: a table of laws times a table of identifiers; simulate, identify, compare with the truth.

A new method of identification is one more row of `IDENTIFIERS`, a new law one more of `LAW_NAMES`.
"""

from functools import cache

import numpy as np
import pytest
from law_runs import weightless_test

from opid.mechanics.laws.law import default_law
from opid.suspensions.identification import identify
from opid.suspensions.study import Run, study_of_gear
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_test

LAW_NAMES = (
    "linear",
    "arctan_velocity",
    "arctan_displacement",
    "quadratic_damping",
    "quadratic_stiffness",
    "cubic_stiffness",
    "coulomb_friction",
    "arctan_velocity+cubic_stiffness",
)
IDENTIFIERS = {
    "classical, law given": lambda study, law_name: identify(study, method="classical", law=law_name),
    "classical, law searched": lambda study, law_name: identify(study, method="classical"),
    "model, law searched": lambda study, law_name: identify(study),
}
# a normal error exceeds this once in 16 000 times
WITHIN_STD = 4.0
# wide intervals must not hide a bad answer
WITHIN_FRACTION = {"sprung_mass_kg": 0.02, "suspension_stiffness_n_per_m": 0.02, "suspension_damping_n_s_per_m": 0.03}


@cache
def taxi(law_name, *, weight):
    """Two 40 s runs of a gear with this law; the seed is its place in the table."""
    gear, seed = LandingGear(law=default_law(law_name)), LAW_NAMES.index(law_name)
    test = (
        taxi_test(gear, rng=np.random.default_rng(seed), fs=256.0) if weight else weightless_test(gear, seed, fs=256.0)
    )
    runs = (Run("heavy", test.heavy.recording, 0.0), Run("light", test.light.recording, test.mass_change_kg))
    return gear, study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, repeatability=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("identifier", IDENTIFIERS)
@pytest.mark.parametrize("law_name", LAW_NAMES)
def test_the_truth_is_found(law_name, identifier):
    # the paper's equation has one law about the rest of both runs
    gear, study = taxi(law_name, weight=identifier.startswith("model"))
    found = IDENTIFIERS[identifier](study, law_name)
    assert found.not_determined is None
    assert found.law.name == law_name
    estimates = {name: (estimate, getattr(gear, name)) for name, estimate in found.parameters.items()}
    for kind, values in gear.law.parameters.items():
        estimates |= {f"{kind}.{key}": (found.law_estimates[kind][key], true) for key, true in values.items()}
    for name, (estimate, true) in estimates.items():
        # a ground spring that was left out is zero, not uncertain
        assert abs(estimate.value - true) <= WITHIN_STD * (estimate.std or 0.0), name
    for name, fraction in WITHIN_FRACTION.items():
        estimate, true = estimates[name]
        assert abs(estimate.value - true) < fraction * true, name
        assert estimate.std < fraction * true, name
    # a wide interval of the ground spring or of the law would hold anything
    assert (estimates["ground_stiffness_n_per_m"][0].std or 0.0) < 0.01 * gear.suspension_stiffness_n_per_m
    for kind, values in gear.law.parameters.items():
        for key, true in values.items():
            assert found.law_estimates[kind][key].std < 0.1 * abs(true), (kind, key)
