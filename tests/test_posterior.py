from dataclasses import replace

import made_backbones as made
import numpy as np
import pytest
from scipy import stats

from opid.errors import InputError, NotDeterminedError
from opid.updating import posterior
from opid.updating.likelihood import curves as likelihood
from opid.updating.likelihood.backbones import backbone_data
from opid.updating.model_class import Prior
from opid.updating.posterior import density_of, update_class
from opid.updating.sampling.evidence import Evidence, maximum_a_posteriori
from opid.updating.warnings import warn_of_choice, warn_of_classes


@pytest.mark.parametrize(
    ("prior", "known"),
    [
        (Prior("uniform", -1.0, 5.0), stats.uniform(-1.0, 6.0)),
        (Prior("normal", 1.0, 2.0), stats.norm(1.0, 2.0)),
        (Prior("lognormal", 2.0, 0.5), stats.lognorm(0.5, 0.0, 2.0)),
    ],
)
def test_the_density_of_a_prior_is_that_of_its_distribution(prior, known):
    values = np.array([-3.0, -1.0, 0.0, 1e-9, 0.3, 1.0, 5.0, 11.0, np.inf, -np.inf])
    np.testing.assert_allclose(prior.log_density(values), known.logpdf(values), rtol=1e-12)


@pytest.fixture(scope="module")
def data():
    return backbone_data(made.system(), made.backbones(2), harmonics=(1,))


@pytest.fixture(scope="module")
def cubic(data):
    return update_class(data, made.CUBIC, rng=np.random.default_rng(0), n_samples=1650)


def test_truth_is_found_and_samples_agree_with_the_curvature(data, cubic):
    theta = cubic.estimates["theta_1"]
    assert abs(theta.value - made.TRUTH) < 4 * theta.std
    assert 0.001 < theta.std / made.TRUTH < 0.05
    assert cubic.samples.shape == (1500, 1)
    support = [prior.support for prior in made.CUBIC.priors]
    peak = maximum_a_posteriori(density_of(data, made.CUBIC).posterior, [1.5], support=support)
    assert cubic.best == pytest.approx(peak.theta, abs=1e-5)
    assert cubic.chain.pooled.std() == pytest.approx(float(np.sqrt(peak.covariance[0, 0])), rel=0.15)
    assert cubic.diagnostics.effective_samples > 200
    assert cubic.warnings == ()


def test_evidences_agree_and_the_first_is_the_integral(data, cubic):
    names = [each.method for each in cubic.evidences]
    assert names == ["quadrature", "laplace"]
    grid = np.linspace(1.2, 2.0, 401)
    value = density_of(data, made.CUBIC).posterior(grid[:, None])
    exact = np.log(np.trapezoid(np.exp(value - value.max()), grid)) + value.max()
    assert [each.log_evidence for each in cubic.evidences] == pytest.approx([exact, exact], abs=0.05)
    assert cubic.log_evidence == cubic.evidences[0].log_evidence


def test_same_seed_same_posterior(data, cubic):
    again = update_class(data, made.CUBIC, rng=np.random.default_rng(0), n_samples=1650)
    assert np.array_equal(again.samples, cubic.samples)
    assert again.evidences == cubic.evidences


def test_twice_the_prior_costs_the_logarithm_of_two(cubic):
    assert cubic.prior_sensitivity["theta_1"] == pytest.approx(-np.log(2), abs=1e-3)


@pytest.mark.parametrize(("low", "high", "side"), [(0.0, 1.2, "upper end 1.2"), (2.0, 10.0, "lower end 2")])
def test_a_prior_that_is_pressed_against_is_told_with_its_side(data, low, high, side):
    narrow = made.CUBIC.with_prior(0, Prior("uniform", low, high))
    found = update_class(data, narrow, rng=np.random.default_rng(0), n_samples=1100)
    assert any(side in each for each in found.warnings)
    # the wide prior lets the likelihood rise beyond the bound
    assert found.prior_sensitivity["theta_1"] > -np.log(2) + 0.01


def test_a_term_that_is_not_needed_is_told_and_costs_evidence(data, cubic):
    both = update_class(data, made.BOTH, rng=np.random.default_rng(0), n_samples=1650)
    assert both.estimates["theta_2"].holds(0.0)
    assert any("contains 0" in each and "quintic" in each for each in both.warnings)
    assert both.log_evidence < cubic.log_evidence
    assert both.covariance.shape == (2, 2)


def test_a_law_that_does_not_fit_has_less_evidence(data, cubic):
    other = update_class(data, made.QUADRATIC, rng=np.random.default_rng(0), n_samples=1100)
    assert other.log_evidence < cubic.log_evidence - 15


@pytest.mark.parametrize("sampler", [pytest.param("nuts", marks=pytest.mark.slow), "transitional"])
def test_every_sampler_finds_the_same(data, cubic, sampler):
    if sampler == "nuts":
        pytest.importorskip("nutpie")
    found = update_class(data, made.CUBIC, rng=np.random.default_rng(3), sampler=sampler, n_samples=1100)
    mine, other = found.estimates["theta_1"], cubic.estimates["theta_1"]
    assert mine.value == pytest.approx(other.value, abs=0.5 * other.std)
    assert mine.std == pytest.approx(other.std, rel=0.3)
    assert found.log_evidence == pytest.approx(cubic.log_evidence, abs=0.02)
    if sampler == "transitional":
        stages = found.evidences[-1]
        assert abs(stages.log_evidence - cubic.log_evidence) < 4 * stages.std


def test_the_transitional_sampler_tells_its_progress(data):
    fractions = []
    found = update_class(
        data, made.CUBIC, rng=np.random.default_rng(3), sampler="transitional", n_samples=1000, evidences=("laplace",),
        progress=fractions.append,
    )  # fmt: skip
    assert found.diagnostics.sampler == "transitional"
    assert fractions == sorted(fractions)
    assert len(fractions) > 2
    assert fractions[-1] == 1.0


def test_a_density_with_steps_still_has_a_peak(data, cubic, monkeypatch):
    smooth = likelihood.likelihood_function

    def stepped(*given):
        evaluate = smooth(*given)

        def with_step(theta):
            value, failed = evaluate(theta)
            return value + 0.3 * (np.atleast_2d(theta)[:, 0] > cubic.best[0] + 1e-4), failed

        return with_step

    monkeypatch.setattr(posterior, "likelihood_function", stepped)
    found = update_class(data, made.CUBIC, rng=np.random.default_rng(0), n_samples=1100, evidences=("laplace",))
    assert found.estimates["theta_1"].value == pytest.approx(cubic.best[0], abs=0.02)
    assert found.log_evidence == pytest.approx(cubic.log_evidence, abs=0.6)


def test_class_without_any_backbone(data, monkeypatch):
    def nothing(*_):
        return lambda theta: (np.full(len(theta), -np.inf), 3 * len(theta))

    monkeypatch.setattr(posterior, "likelihood_function", nothing)
    with pytest.raises(NotDeterminedError, match="class 'cubic' has no backbone anywhere in its prior"):
        update_class(data, made.CUBIC, rng=np.random.default_rng(0))


def test_amplitudes_a_thousand_times_too_small_are_one_sentence():
    small = tuple(replace(one, amplitude=1e-3 * one.amplitude) for one in made.backbones(2))
    data = backbone_data(made.system(), small, harmonics=(1,))
    found = [
        update_class(data, each, rng=np.random.default_rng(0), n_samples=1000, evidences=("laplace",))
        for each in (made.CUBIC, made.BOTH)
    ]
    (sentence,) = warn_of_classes(found)
    assert sentence.startswith("no class moves the frequencies by more than 5 % of their measured growth: check the")
    assert "unit of the amplitudes" in sentence
    assert list(warn_of_choice(found, ())) == []
    whole = replace(found[0], warnings=("one", "two"), has_no_effect=False)
    assert warn_of_classes([whole, found[1]])[:2] == ["class 'cubic': one", "class 'cubic': two"]
    assert warn_of_classes([whole, found[1]])[2].startswith("class 'cubic and quintic': no theta that its prior allows")


def test_the_prior_of_any_class_may_decide(cubic):
    def ranked(*given):
        names = ("first", "second", "third")
        return [
            replace(
                cubic,
                model_class=replace(made.CUBIC, name=name),
                evidences=(Evidence("laplace", value),),
                prior_sensitivity={"theta_1": change},
            )
            for name, (value, change) in zip(names, given, strict=True)
        ]

    assert list(warn_of_choice(ranked((50.0, -0.69), (47.0, -0.69), (40.0, 5.0)), ())) == []
    (own,) = warn_of_choice(ranked((50.0, -4.0), (47.0, -0.69), (40.0, 0.0)), ())
    assert own.startswith("with a prior of theta_1 twice as wide, 'second' would come before 'first' (-4.0 against 3.0")
    (third,) = warn_of_choice(ranked((50.0, -0.69), (47.0, -0.69), (40.0, 12.0)), ())
    assert third == (
        "with a prior of its theta_1 twice as wide, 'third' would come before 'first' (+12.0 against 10.0 in log "
        "evidence): the prior decides, so give reasons for its width"
    )


def test_bad_input(data):
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="there is no sampler 'gibbs'"):
        update_class(data, made.CUBIC, rng=rng, sampler="gibbs")
    with pytest.raises(InputError, match="there is no evidence 'laplacian': did you mean 'laplace'"):
        update_class(data, made.CUBIC, rng=rng, evidences=("laplacian",))
    with pytest.raises(InputError, match="no evidence is named"):
        update_class(data, made.CUBIC, rng=rng, evidences=())


def test_wider_priors_keep_their_centre():
    assert Prior("normal", 1.0, 0.5).widen() == Prior("normal", 1.0, 1.0)
    assert Prior("uniform", -1.0, 1.0).widen() == Prior("uniform", -2.0, 2.0)
