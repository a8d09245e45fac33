"""Which law, by prediction: known laws are found, from near and from far, and the ladder says how surely."""

from dataclasses import replace

import numpy as np
import pytest
from law_runs import fitted, runs_of

from opid.mechanics.kinds import Kind, Parameter
from opid.mechanics.landing_gear import DEFAULT_LAW
from opid.mechanics.laws import LAWS, LINEAR, Law, default_law
from opid.mechanics.own_kinds import register_kind, unregister_kind
from opid.suspensions.one_gear import pursuit
from opid.suspensions.one_gear.law_dictionary import dictionary_of
from opid.suspensions.one_gear.pursuit import better, judged_by_left_out, library, proposals, pursue_law
from opid.suspensions.one_gear.refit import left_out_error, refit
from opid.suspensions.paper.joint_fit import LadderStep, alternatives, chosen


@pytest.fixture(scope="module")
def friction():
    runs = runs_of(DEFAULT_LAW)
    return runs, fitted(runs, DEFAULT_LAW)


FROM_TO = [
    ("arctan_velocity", "coulomb_friction"),
    ("coulomb_friction", "arctan_velocity"),
    ("cubic_damping", "quadratic_damping"),
    ("coulomb_friction+quadratic_damping", "arctan_velocity+cubic_damping"),
    ("arctan_velocity", "arctan_velocity+cubic_stiffness"),
    ("arctan_velocity+cubic_stiffness", "cubic_stiffness"),
    ("linear", "linear"),
]


@pytest.mark.parametrize(("start", "truth"), FROM_TO, ids=lambda name: name)
def test_the_true_law_is_found_from_a_near_one(start, truth):
    law = default_law(truth)
    runs = runs_of(law)
    best = chosen(pursue_law(runs, fitted(runs, default_law(start)))).fit
    assert best.law.name == truth
    of_law = slice(2, 2 + law.vector.size)
    np.testing.assert_array_less(np.abs(best.value[of_law] - law.scaled(1 / 1850).vector), 4.5 * best.std[of_law])
    np.testing.assert_allclose(1 / best["inverse_mass"], 1850, rtol=0.01)


def test_two_terms_are_found_from_none():
    truth = default_law("arctan_velocity+quadratic_damping")
    runs = runs_of(truth)
    ladder = pursue_law(runs, fitted(runs))
    assert chosen(ladder).law_name == truth.name
    assert ladder[0].law_name == "linear"
    assert chosen(ladder).road == "pursuit"
    assert chosen(ladder).left_out_m_per_s2 == pytest.approx(5e-3, rel=0.1)


def test_the_dictionary_foretells_the_fit(friction):
    """The criterion of a near relative, and of one term more, against those of the fits."""
    runs, fit = friction
    found = {proposal.law.name: proposal for proposal in proposals(runs, fit, library())}
    for name, rtol in (("coulomb_friction", 0.3), ("arctan_velocity+cubic_stiffness", 0.01)):
        foretold, reached = found[name].bic - fit.bic, refit(runs, fit, found[name].law).bic - fit.bic
        np.testing.assert_allclose(foretold, reached, rtol=rtol, atol=0.5)


def test_scales_between_the_simulated_ones_are_right(friction):
    """A law at any scale: the interpolated column against the difference of two simulations."""
    runs, fit = friction
    dictionary = dictionary_of(runs, fit, ["cubic_stiffness", "dead_zone_stiffness", "coulomb_friction"])
    assert list(dictionary.fitted) == ["arctan_velocity"]
    now, weights = dictionary.left(dictionary.fitted["arctan_velocity"])
    np.testing.assert_allclose(weights[0], fit.law.terms[0].amplitude, rtol=1e-3)
    np.testing.assert_allclose(now, np.sum(fit.errors**2), rtol=1e-3)
    scales = [dictionary.terms[place].inner[0] for place in dictionary.offered["coulomb_friction"]]
    np.testing.assert_allclose(np.diff(np.log(scales)), np.log(3) / 4)
    # the column of a straight line is what stiffness and damping can do
    proposal = dictionary.proposal(["arctan_velocity", "cubic_stiffness"])
    assert abs(proposal.bic - fit.bic - np.log(fit.n_data)) < 12


def test_what_a_run_left_out_says(friction):
    runs, fit = friction
    linear = refit(runs, fit, LINEAR)
    held = left_out_error(runs, fit)
    assert held == pytest.approx(fit.noise_m_per_s2, rel=0.02)
    assert left_out_error(runs, linear) > 3 * held
    assert left_out_error(runs[:1], fit) is None


@pytest.mark.parametrize(("left_out", "winner"), [(4.9e-3, "more"), (5e-3, "fewer"), (5.1e-3, "fewer")])
def test_a_law_that_predicts_no_better_gives_way(friction, monkeypatch, left_out, winner):
    """Of two laws the larger one must predict a run that was left out better."""
    runs, fit = friction
    more = replace(fit, law=fit.law + default_law("cubic_stiffness"))
    monkeypatch.setattr(pursuit, "left_out_error", lambda runs, each: 5e-3 if each is fit else left_out)
    ladder = (LadderStep("fewer", fit, True), LadderStep("more", more, True))
    judged = judged_by_left_out(runs, ladder)
    assert chosen(judged).law_name == winner
    assert {step.law_name: step.left_out_m_per_s2 for step in judged} == {"fewer": 5e-3, "more": left_out}


def test_a_larger_law_needs_a_margin(friction):
    _, fit = friction
    more = replace(fit, law=fit.law + default_law("cubic_stiffness"))
    assert not better(replace(more, log_likelihood=fit.log_likelihood + 3), fit)
    assert not better(replace(more, log_likelihood=fit.log_likelihood + 20), fit)
    lower = replace(more, log_likelihood=fit.log_likelihood + 20, noise_m_per_s2=0.99 * fit.noise_m_per_s2)
    assert better(lower, fit)
    assert not better(fit, lower)


def test_a_law_that_cannot_be_told_apart_is_named(friction):
    _, fit = friction
    rival = replace(fit, law=Law(default_law("coulomb_friction").terms), log_likelihood=fit.log_likelihood - 1.5)
    steps = (LadderStep("coulomb_friction", rival, False), LadderStep(fit.law.name, fit, True))
    (sentence,) = alternatives(steps)
    assert sentence.startswith("coulomb_friction (0.02 m/s) in place of arctan_velocity")
    assert "BIC +3" in sentence
    assert "velocities" in sentence
    far = replace(rival, log_likelihood=fit.log_likelihood - 10)
    assert alternatives((LadderStep("coulomb_friction", far, False), steps[1])) == ()


def test_the_library_follows_the_registered_kinds():
    names = library()
    assert {"arctan_velocity", "cubic_stiffness", "blow_off_damping"} <= set(names) <= set(LAWS)
    assert not {"arctan_mixed", "signed_power_damping"} & set(names)

    def softening(z, v, s, _):
        bell = np.exp(-((z / s) ** 2))
        return z * bell, (1 - 2 * (z / s) ** 2) * bell, 0.0, 2 * (z / s) ** 3 * bell, 0.0

    stiffness = Parameter("stiffness_n_per_m", "N/m", "amplitude", 1e5)
    register_kind(Kind("softening", r"k z", (stiffness, Parameter("scale_m", "m", "scale", 0.005)), softening))
    try:
        assert "softening" in library()
    finally:
        unregister_kind("softening")
