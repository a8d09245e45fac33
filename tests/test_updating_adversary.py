"""Bayesian updating where its assumptions fail: what is refused, told or withheld there."""

import re
from dataclasses import replace

import made_backbones
import made_dampers
import made_updating
import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy import stats

from opid.errors import NotDeterminedError
from opid.provenance import ReadFile
from opid.report.document import Figure
from opid.report.updating_bands import list_harmonic_figures
from opid.report.writing import build_document
from opid.updating import identification
from opid.updating.checks import warn_of_copies
from opid.updating.identification import update_study
from opid.updating.likelihood.backbones import backbone_data
from opid.updating.likelihood.force import force_data
from opid.updating.measured import MeasuredBackbone
from opid.updating.model_class import DampingRatio, ModelClass, Prior, UncertainTerm, spline_terms
from opid.updating.posterior import density_of, update_class
from opid.updating.sampling.chains import Chain
from opid.updating.sampling.evidence import importance, laplace_of_samples, quadrature
from opid.updating.settings import UPDATING
from opid.updating.study import UpdatingStudy
from opid.updating.unmeasured_modes import PredictionSettings, ResponseSettings

# ---- parameters of very different sizes ------------------------------------------------------------


def draw_chain(mean, covariance, rng):
    """Independent draws of a normal distribution, and its log density, drawn and evaluated without its scales."""
    deviation = np.sqrt(np.diag(covariance))
    root = np.linalg.cholesky(covariance / np.outer(deviation, deviation))
    scores = rng.standard_normal((4, 1000, mean.size)) @ root.T
    chain = Chain(mean + deviation * scores, np.zeros((4, 1000)), 1.0, 0, "exact", 0)

    def density(theta):
        whitened = np.linalg.solve(root, ((theta - mean) / deviation).T)
        constant = np.log(deviation).sum() + np.log(np.diag(root)).sum() + mean.size * np.log(2 * np.pi) / 2
        return -0.5 * np.sum(whitened**2, axis=0) - constant

    return chain, density


@pytest.mark.parametrize("sizes", [(1e12, 1e-6), (1e-6, 1.0, 1e12), (1e4, 1e-4), (1e-3, 1e-160), (1.0, 1.0)])
@pytest.mark.parametrize("correlation", [0.0, 0.95])
def test_the_evidence_does_not_depend_on_the_sizes_of_parameters(sizes, correlation):
    """The density is normalised, so that the logarithm of its integral is 0."""
    d = len(sizes)
    matrix = correlation * np.ones((d, d)) + (1 - correlation) * np.eye(d)
    rng = np.random.default_rng(0)
    chain, density = draw_chain(3.0 * np.array(sizes), matrix * np.outer(sizes, sizes), rng)
    found = importance(density, chain, rng=rng)
    assert abs(found.log_evidence) < 4 * found.std < 0.1
    at_mean = float(density(3.0 * np.array(sizes)[None])[0])
    by_samples = laplace_of_samples(at_mean, 3.0 * np.array(sizes), chain)
    assert abs(by_samples.log_evidence) < 4 * by_samples.std < 0.2


def test_the_evidence_of_a_density_with_wide_tails_is_that_of_an_integral():
    """The proposal and the density are no normal distributions: its own density must be right in its tails, too."""
    density = stats.multivariate_t(np.zeros(2), np.array([[4.0, 1.2], [1.2, 1.0]]), df=7)
    scale = np.array([1e4, 1e-5])
    rng = np.random.default_rng(1)
    chain = Chain(scale * density.rvs(4000, rng).reshape(4, 1000, 2), np.zeros((4, 1000)), 1.0, 0, "exact", 0)
    found = importance(lambda t: density.logpdf(t / scale) - np.log(scale).sum(), chain, rng=rng, n_draws=20000)
    assert abs(found.log_evidence) < 4 * found.std < 0.05


@pytest.mark.parametrize(
    ("samples", "words"),
    [
        (lambda x, y: np.stack([x, np.full_like(x, 10.0)], axis=-1), "do not scatter in theta_2: give a known value"),
        (lambda x, y: np.stack([1e12 + 1e-6 * x, y], axis=-1), "do not scatter in theta_1: give a known value"),
        (lambda x, y: np.stack([x, y, 3.0 - 2e6 * x], axis=-1), "theta_1 and theta_3 follow each other exactly"),
    ],
)
def test_samples_without_a_scatter_are_refused_in_a_sentence(samples, words):
    rng = np.random.default_rng(0)
    drawn = samples(*rng.standard_normal((2, 4, 500)))
    chain = Chain(drawn, np.zeros((4, 500)), 1.0, 0, "exact", 0)
    for method in (
        lambda: importance(lambda t: np.zeros(len(t)), chain, rng=rng),
        lambda: laplace_of_samples(0.0, drawn[0, 0], chain),
    ):
        with pytest.raises(NotDeterminedError, match=words):
            method()


def damped_data():
    """Backbones with the force of a friction, for classes with a damping ratio of each mode."""
    backbones = made_dampers.measured(made_dampers.FRICTION, 0)
    data = backbone_data(made_dampers.system(), backbones)
    return replace(data, force=force_data(data.modes, backbones, data.noise, {}))


def with_friction(scale_prior, scale=4e-3):
    friction = UncertainTerm("coulomb_friction", (4e-3, scale), (Prior(), scale_prior))
    ratios = tuple(DampingRatio(mode, Prior("lognormal", made_dampers.RATIO, 0.03)) for mode in (1, 2))
    return ModelClass("friction", (made_dampers.SPRING, friction), ratios=ratios)


def test_a_class_whose_scale_may_have_any_size_has_an_evidence():
    """Samples of the scale reach from 1e-40 to 1: their covariance is singular in its own units."""
    found = update_class(
        damped_data(), with_friction(Prior("lognormal", 1.0, 100.0)), rng=np.random.default_rng(0), n_samples=1000
    )
    assert np.isfinite(found.log_evidence)


# ---- floating-point overflow -----------------------------------------------------------------------


@pytest.mark.parametrize("score", [-1e200, -800.0, -40.0, 800.0, 1e200, np.inf, -np.inf])
def test_far_scores_of_priors_are_the_ends_of_their_supports(score):
    for prior in (Prior("uniform", -1.0, 5.0), Prior("lognormal", 2.0, 5.0), Prior("lognormal", 1e300, 0.5)):
        value, slope = prior.from_normal([score])
        exact = np.log(prior.first) + prior.second * score if prior.family == "lognormal" else np.nan
        if abs(exact) < 700.0:
            assert value[0] == pytest.approx(np.exp(exact), rel=1e-12)
        else:
            assert value[0] == prior.support[int(score > 0)]
            assert slope[0] in (0.0, np.inf)


def test_scores_are_those_of_scipy_and_go_back():
    scores = np.linspace(-6.0, 6.0, 25)
    for prior, known in (
        (Prior("uniform", -1.0, 5.0), stats.uniform(-1.0, 6.0)),
        (Prior("normal", 1.0, 2.0), stats.norm(1.0, 2.0)),
        (Prior("lognormal", 2.0, 3.0), stats.lognorm(3.0, 0.0, 2.0)),
    ):
        value, slope = prior.from_normal(scores)
        np.testing.assert_allclose(known.cdf(value), stats.norm.cdf(scores), rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(slope * known.pdf(value), stats.norm.pdf(scores), rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(prior.to_normal(value), scores, rtol=1e-6, atol=1e-9)
    assert Prior("lognormal", 2.0, 3.0).to_normal([0.0, 2.0]).tolist() == [-np.inf, 0.0]


@pytest.mark.parametrize("kind", ["coulomb_friction", "arctan_velocity"])
def test_a_friction_that_reverses_within_no_velocity_is_a_step(kind):
    """Its loss in a cycle is that of Coulomb's friction, 4 F X; a warning of numpy is an error here."""
    friction = UncertainTerm(kind, (4e-3, 4e-3), (Prior(), Prior()))
    own = ModelClass("friction", (made_dampers.SPRING, friction))
    for scale in (0.0, 1e-320, 1e-200):
        law = own.law("left", [1.0, 1.0, scale])
        rate = np.array([-1e-3, 0.0, 1e-3])
        spring = replace(law, terms=law.terms[:1])
        force = law.force(np.zeros(3), rate) - spring.force(np.zeros(3), rate)
        np.testing.assert_allclose(force, 4e-3 * np.sign(rate), atol=1e-12)
        assert np.isfinite(own.coefficients([[1.0, 1.0, scale]])).all()
    data = damped_data()
    model_class = replace(with_friction(Prior()), terms=(made_dampers.SPRING, friction))
    theta = np.tile([1.0, 1.0, 1.0, made_dampers.RATIO, made_dampers.RATIO], (3, 1))
    theta[:, 2] = 0.0, 1e-320, 1e-6
    likelihood = density_of(data, model_class).likelihood(theta)
    assert np.isfinite(likelihood).all()
    np.testing.assert_allclose(likelihood, likelihood[-1], rtol=1e-4)


# ---- advice where the transitional sampler ran -----------------------------------------------------


@pytest.fixture(scope="module")
def data():
    return backbone_data(made_backbones.system(), made_backbones.backbones(2), harmonics=(1,))


def refuse(*_, **__):
    raise NotDeterminedError("2000 draws about the samples are worth only 40")


def test_the_class_is_compared_by_the_transitional_evidence_where_another_method_gives_none(data, monkeypatch):
    monkeypatch.setattr("opid.updating.posterior.quadrature", refuse)
    found = update_class(
        data, made_backbones.CUBIC, rng=np.random.default_rng(0), sampler="transitional", n_samples=1000
    )
    assert [each.method for each in found.evidences] == ["transitional", "laplace"]
    assert any("the class is compared by its transitional evidence" in each for each in found.warnings)
    assert not any("take" in each for each in found.warnings)
    other = update_class(data, made_backbones.CUBIC, rng=np.random.default_rng(0), n_samples=1000)
    assert [each.method for each in other.evidences] == ["laplace"]
    assert not any("compared by its transitional" in each for each in other.warnings)


@pytest.mark.parametrize(
    ("sampler", "words"),
    [
        ("adaptive", "take the transitional sampler, which finds both"),
        ("transitional", "mean and interval are those of both together; if one is impossible, give a prior that"),
    ],
)
def test_a_second_maximum_is_told_by_what_the_sampler_made_of_it(data, sampler, words):
    """A quintic coefficient whose sign does not matter has two maxima, one at each sign."""
    from opid.updating import posterior

    even = posterior.Density(*[lambda t: -0.5 * ((np.abs(t[:, 0]) - 5.0) / 0.5) ** 2] * 3)
    symmetric = ModelClass("even", (replace(made_backbones.BOTH.springs[1], priors=(Prior("uniform", -9.0, 9.0),)),))
    _, warnings = posterior._find_peak(even, data, symmetric, np.random.default_rng(0), sampler == "transitional")
    (told,) = warnings
    assert told.startswith("there is a second maximum at theta = (")
    assert words in told


@pytest.mark.parametrize("method", [importance, quadrature])
def test_no_method_orders_a_sampler_that_may_have_run(method):
    rng = np.random.default_rng(0)
    chain = Chain(rng.standard_normal((4, 500, 1)), np.zeros((4, 500)), 1.0, 0, "exact", 0)
    narrow = lambda t: np.where(np.abs(t[:, 0] - 0.3) < 1e-3, 0.0, -1e3)  # noqa: E731
    given = (chain,) if method is importance else ([0.3], 1e-4)
    settings = {"rng": rng} if method is importance else {"tolerance": 1e-9, "max_evaluations": 500}
    with pytest.raises(NotDeterminedError, match="the transitional sampler does not mind") as caught:
        method(narrow, *given, **settings)
    assert "take" not in str(caught.value)


# ---- copies of curves ------------------------------------------------------------------------------


def rounded(curve, decimals, digits, name="copy"):
    amplitude = [[float(f"{value:.{digits}g}") for value in row] for row in curve.amplitude]
    return replace(curve, name=name, frequency_hz=np.round(curve.frequency_hz, decimals), amplitude=amplitude)


def rescaled(curve, sensor, factor, name="copy"):
    amplitude = curve.amplitude.copy()
    amplitude[:, curve.sensors.index(sensor)] *= factor
    return replace(curve, name=name, amplitude=amplitude)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("copy", "words"),
    [
        (lambda one: replace(one, name="copy"), "all digits, and"),
        (lambda one: rounded(one, 4, 5), "all digits, and"),
        (lambda one: rounded(one, 2, 3), "all digits, and"),
        (lambda one: rescaled(one, "twist", 1.07), "all digits but for a factor of 1.07 in sensor 'twist', and"),
        (lambda one: rescaled(one, "left", 0.5), "all digits but for a factor of 0.5 in sensor 'left', and"),
        (lambda one: rescaled(one, "right", -1.0), "all digits but for a factor of -1 in sensor 'right', and"),
        (lambda one: rounded(rescaled(one, "bend", 2.0), 3, 4), "all digits but for a factor of 2 in sensor 'bend'"),
    ],
)
def test_a_copy_is_told_whatever_was_done_to_its_digits(seed, copy, words):
    curves = made_backbones.backbones(seed)
    (told,) = warn_of_copies([*curves, copy(curves[7])])
    assert told.startswith(
        f"the curves {curves[7].name!r} and 'copy' of mode 3 are one measurement: they agree in {words}"
    )
    assert told.endswith("counts as a test of its own, which makes intervals too narrow; leave all but one out")


def test_three_copies_are_one_sentence_and_other_modes_have_their_own():
    curves = made_backbones.backbones(0)
    copies = [replace(curves[0], name="a"), rounded(curves[0], 3, 4, "b"), replace(curves[8], name="c")]
    first, second = warn_of_copies([*curves, *copies])
    assert first.startswith(f"the curves {curves[0].name!r}, 'a' and 'b' of mode 2 are one measurement")
    assert second.startswith(f"the curves {curves[8].name!r} and 'c' of mode 3 are one measurement")


@pytest.mark.parametrize("digits", [(12, 12), (4, 5), (3, 4), (2, 3)])
@pytest.mark.parametrize("noise", [{}, {"point_noise": 1e-5}, {"offset_fraction": 0.0}, {"linear_error": 0.0}])
def test_repeated_tests_with_noise_of_their_own_are_not_told(digits, noise):
    for seed in range(10):
        curves = [rounded(one, *digits, one.name) for one in made_backbones.backbones(seed, **noise)]
        assert warn_of_copies(curves) == []


def one_sensor(name, frequency_hz, **changes):
    return MeasuredBackbone(name, 1, "tip", frequency_hz, np.array([[2e-4], [1e-3], [2e-3]]), ("tip",), **changes)


def test_few_digits_tell_a_copy_by_its_file_alone():
    """Three frequencies in tenths of a hertz may be those of two tests."""
    hz = [14.6, 14.8, 15.1]
    assert warn_of_copies([one_sensor("a", hz), one_sensor("b", hz)]) == []
    files = {"files": (ReadFile("a.csv", "1" * 64),)}
    same = [one_sensor("a", hz, **files), one_sensor("b", hz, files=(ReadFile("b.csv", "1" * 64),))]
    assert len(warn_of_copies(same)) == 1
    others = [same[0], one_sensor("b", hz, files=(ReadFile("b.csv", "2" * 64),))]
    assert warn_of_copies(others) == []


def test_a_test_with_another_offset_is_no_copy():
    """A factor of all frequencies is the offset of a repeated test; curves of a simulation have no other noise."""
    one = made_backbones.backbones(0)[0]
    assert warn_of_copies([one, replace(one, name="other", frequency_hz=1.002 * one.frequency_hz)]) == []


def test_a_copy_is_told_in_the_result_and_makes_the_interval_narrower():
    curves = made_backbones.backbones(0, n_curves=(2, 1))
    copies = [replace(one, name=f"{one.name}, copy {number}") for one in curves for number in range(3)]

    def update(backbones):
        return update_study(
            UpdatingStudy(
                title="copies", structure=made_backbones.system(), backbones=backbones,
                classes=(made_backbones.CUBIC,), harmonics=(1,), n_samples=1000,
            )
        )  # fmt: skip

    alone, together = update(curves), update([*curves, *copies])
    assert not any("one measurement" in each for each in alone.warnings)
    assert sum("one measurement" in each for each in together.warnings) == 3
    narrow, wide = (float(each.classes[0].covariance[0, 0]) ** 0.5 for each in (together, alone))
    assert narrow < 0.9 * wide


# ---- responses to a force --------------------------------------------------------------------------


def bent(curve):
    """The curve of a structure with another law, whose frequency falls again at large amplitudes."""
    along = np.linspace(0.0, 1.0, curve.frequency_hz.size)
    return replace(curve, frequency_hz=curve.frequency_hz * (1.0 - 0.1 * along * (1.0 - along)))


@pytest.mark.slow
def test_no_response_has_an_interval_where_any_mode_misfits(monkeypatch):
    """Theta is that of all modes: mode 1 fits, and its response is wrong all the same."""
    monkeypatch.setattr(identification, "UPDATING", replace(UPDATING, n_responses=20))
    own = ModelClass("both", (made_dampers.SPRING, made_dampers.LINEAR_TERM, made_dampers.QUADRATIC_TERM))
    asked = PredictionSettings(responses=(ResponseSettings(mode=1, drive="tip", force_n=(0.4,)),))
    right = made_dampers.measured(made_dampers.BOTH, 0)
    for backbones, has_interval in ((right, True), ([bent(one) if one.mode == 2 else one for one in right], False)):
        found = update_study(made_dampers.study(backbones, classes=(own,), prediction=asked, n_samples=1000))
        (response,) = found.responses
        assert (response.peak_hz.interval95 is not None) == has_interval
        assert (response.peak_amplitude.interval95 is not None) == has_interval
        told = [each for each in found.warnings if "the response has no interval" in each]
        assert len(told) == (not has_interval)
    assert re.search(
        r"mode 1 under 0\.4 N: .* the laws of 'both' do not fit the tests of mode 2, and the same", told[0]
    )


# ---- words -----------------------------------------------------------------------------------------


def test_the_pieces_of_a_spline_are_grouped_in_the_words_of_a_law():
    pieces = spline_terms([7e7] * 4, [5e-4, 1e-3, 1.5e-3])
    assert ModelClass("spline", pieces).law_in_words == "cubic + late cubic from 0.5, 1 and 1.5 mm"
    turned = ModelClass("spline", (pieces[0], *pieces[:0:-1]))
    assert turned.law_in_words == "cubic + late cubic from 0.5, 1 and 1.5 mm"
    at_each = [each for place in ("left", "right") for each in spline_terms([7e7] * 3, [5e-4, 1e-3], joints=(place,))]
    assert ModelClass("two", tuple(at_each)).law_in_words == (
        "cubic at left + late cubic from 0.5 and 1 mm at left + cubic at right + late cubic from 0.5 and 1 mm at right"
    )
    gap = UncertainTerm("dead_zone_stiffness", (5e3, 6e-4), (Prior(), None))
    free = UncertainTerm("late_cubic_stiffness", (7e7, 6e-4), (Prior(), Prior()))
    assert ModelClass("gaps", (gap, free)).law_in_words == "dead zone from 0.6 mm + late cubic"


def test_the_caption_of_a_harmonic_says_what_points_line_and_band_are():
    result = made_updating.small_updating(harmonics=made_updating.small_harmonics())
    first, *_ = list_harmonic_figures(result)
    for words in ("Points are the measured", "The line is the median", "the band holds 95 %"):
        assert words in first.text


def list_ends(value, path=""):
    """Yield the path and value of every end of an interval or band and of every covariance in a document."""
    if isinstance(value, dict):
        for name, each in value.items():
            if name in ("interval95", "std", "low", "high", "low_hz", "high_hz", "covariance", "drawn_hz"):
                yield f"{path}.{name}", each
            else:
                yield from list_ends(each, f"{path}.{name}")
    elif isinstance(value, list):
        for number, each in enumerate(value):
            yield from list_ends(each, f"{path}[{number}]")


@pytest.mark.slow
def test_no_interval_and_no_band_stays_where_measurements_contradict_the_structure(monkeypatch):
    monkeypatch.setattr(identification, "UPDATING", replace(UPDATING, n_responses=20))
    own = ModelClass("both", (made_dampers.SPRING, made_dampers.LINEAR_TERM, made_dampers.QUADRATIC_TERM))
    asked = PredictionSettings(responses=(ResponseSettings(mode=1, drive="tip", force_n=(0.4,)),))
    right = list(made_dampers.measured(made_dampers.BOTH, 0))
    given = {"classes": (own,), "prediction": asked, "n_samples": 1000}
    wrong = [
        replace(b, amplitude=b.amplitude * np.where(np.array(b.sensors) == b.controlled_sensor, 1.3, 1.0))
        for b in right
    ]
    for curves, is_spoiled in ((right, False), (wrong, True)):
        result = update_study(made_dampers.study(curves, **given))
        document = result.to_dict()
        parts = {name: document[name] for name in ("prediction", "damping", "responses", "harmonics")}
        parts["classes"] = [
            {name: each[name] for name in ("parameters", "coefficients", "covariance")} for each in document["classes"]
        ]
        known = {path for path, ends in list_ends(parts) if np.isfinite(np.array(ends, dtype=float)).any()}
        assert {path.split("[")[0] for path in known} == (
            set() if is_spoiled else {".classes", ".prediction", ".damping", ".responses"}
        )
        assert any("neither intervals of theta nor bands are given" in each for each in result.warnings) == is_spoiled
        for figure in (each for each in build_document(result).details() if isinstance(each, Figure)):
            figure.draw()
            plt.close("all")
