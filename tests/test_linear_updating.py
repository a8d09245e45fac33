from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import integrate, sparse, stats

from opid.errors import InputError
from opid.mechanics.structure import modal_assurance
from opid.updating.likelihood.linear import linear_data, log_likelihood, log_posterior
from opid.updating.linear_updating import _find_peak, update_linear
from opid.updating.measured import MeasuredBackbone
from opid.updating.model_class import Prior
from opid.updating.sampling.evidence import maximum_a_posteriori
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.reduction import lowest_modes, ritz_model, ritz_modes
from opid.virtual.backbone_tests.wing_engine import UPDATED, wing_engine_structure

TRUTH = np.array(list(UPDATED.values()))
COV = {7: 4e-3, 8: 6e-3}
PRIORS = {name: Prior("uniform", 0.1, 2.0) for name in UPDATED}
COUNTS = {7: 14, 8: 5}


@cache
def wing():
    return wing_engine_structure()


@cache
def wing_model():
    return ritz_model(wing(), box=dict.fromkeys(UPDATED, (0.1, 2.0)), modes=(7, 8))


@cache
def true_modes():
    eigenvalue, shapes = lowest_modes(wing().mass, wing().stiffness_at(UPDATED), 8)
    return eigenvalue, shapes[wing().sensor_indices]


def measured(rng, *, counts=COUNTS, cov=COV, shape_std=0.01, hardening=1e-4, linear_error=0.0):
    """Curves of the wing with offsets of their own in eigenvalue and shape, hardening with the square of amplitude.

    All those of a mode have one more relative error of the frequency in common.
    """
    eigenvalue, shapes = true_modes()
    curves = []
    for mode, n_sets in counts.items():
        level = np.linspace(1.0, 20.0, 12)
        true = eigenvalue[mode - 1] * (1 + (linear_error * rng.standard_normal() if linear_error else 0.0)) ** 2
        for k in range(n_sets):
            shape = shapes[:, mode - 1] / np.linalg.norm(shapes[:, mode - 1])
            shape = shape + shape_std * rng.standard_normal(shape.size)
            value = true * (1 + cov[mode] * rng.standard_normal()) * (1 + hardening * level**2)
            amplitude = 2e-4 * level[:, None] * shape
            name = f"mode {mode}, {k}"
            curves.append(MeasuredBackbone(name, mode, "10", np.sqrt(value) / (2 * np.pi), amplitude, wing().sensors))
    return curves


def two_springs(sensors=("a", "b")):
    """Two masses, two springs to a wall and between: closed form modes."""
    wall, between = np.diag([400.0, 400.0]), 300.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    none = sparse.csr_matrix((2, 2))
    return AffineStructure(np.eye(2), none, {"wall": wall, "between": between}, ("a", "b"), sensors, {})


def curve(mode, frequency_hz, shape, *, name="one", sensors=("a", "b")):
    level = np.array([1.0, 2.0, 3.0])
    return MeasuredBackbone(name, mode, sensors[0], np.full(3, frequency_hz), 1e-3 * np.outer(level, shape), sensors)


def test_ritz_vectors_give_the_modes_of_the_full_structure():
    model = wing_model()
    assert len(model.stiffness) < 30
    assert model.worst < 1e-8
    theta = np.exp(np.random.default_rng(3).uniform(np.log(0.1), np.log(2.0), (5, 2)))
    eigenvalue, shapes = ritz_modes(model, theta)
    assert eigenvalue.shape == (5, 8)
    assert shapes.shape == (5, 14, 8)
    for row, factors in enumerate(theta):
        exact, full = lowest_modes(wing().mass, wing().stiffness_at(dict(zip(model.names, factors, strict=True))), 8)
        np.testing.assert_allclose(eigenvalue[row, 6:], exact[6:], rtol=2e-8)
        assert (eigenvalue[row, 6:] >= exact[6:] * (1 - 1e-9)).all()
        for mode in (6, 7):
            assert modal_assurance(full[wing().sensor_indices, mode], shapes[row, :, mode]).item() > 1 - 1e-8


def test_ritz_vectors_of_a_small_structure_are_exact():
    model = ritz_model(two_springs(), box={"between": (0.5, 2.0)}, modes=[2])
    assert model.names == ("between",)
    eigenvalue, shapes = ritz_modes(model, [[0.5], [1.0], [5.0]])
    np.testing.assert_allclose(eigenvalue, [[400, 700], [400, 1000], [400, 3400]], rtol=1e-12)
    np.testing.assert_allclose(np.abs(shapes), np.sqrt(0.5), rtol=1e-12)


def test_the_error_of_a_shape_is_one_less_the_mac():
    rng = np.random.default_rng(5)
    for _ in range(5):
        one, other = rng.standard_normal((2, 14))
        unit, model = one / np.linalg.norm(one), other / np.linalg.norm(other)
        error = unit - (unit @ model) * model  # eq. (4) with its a_m
        assert error @ error == pytest.approx(1 - modal_assurance(one, other).item(), abs=1e-14)


def test_the_likelihood_is_that_of_normal_errors():
    curves = [curve(2, 5.0, [1.0, -1.1]), curve(2, 5.1, [1.0, -0.8], name="two"), curve(1, 3.2, [1.0, 0.9])]
    data = linear_data(two_springs(), curves, cov={1: 0.1, 2: 0.05})
    model = ritz_model(two_springs(), box={"wall": (0.5, 2.0), "between": (0.5, 2.0)}, modes=[1, 2])
    theta = np.array([[1.0, 1.0], [0.9, 1.2]])
    found = log_likelihood(data, model, theta)
    for row, (wall, between) in enumerate(theta):
        truth = {1: (400 * wall, np.array([1, 1])), 2: (400 * wall + 600 * between, np.array([1, -1]))}
        expected = 0.0
        for each in curves:
            weight = 2.0 if each.mode == 1 else 1.0
            value, shape = truth[each.mode]
            expected += stats.norm.logpdf(each.eigenvalue[0], value, weight * 0.05 * each.eigenvalue[0])
            angle = np.sqrt(1 - modal_assurance(each.amplitude[0], shape).item())
            expected += stats.norm.logpdf(angle, 0, weight * np.sqrt(2) * 0.05)  # eq. (6); one free entry of two
        assert found[row] == pytest.approx(expected, rel=1e-9)


def test_an_unknown_scatter_is_integrated_out():
    values = [5.0, 5.1, 4.95, 5.02]
    curves = [curve(2, hz, [1.0, -1.0 - 0.02 * k], name=str(k)) for k, hz in enumerate(values)]
    model = ritz_model(two_springs(), box={"wall": (0.5, 2.0)}, modes=[2])
    theta = np.array([[0.95], [1.05]])
    found = log_likelihood(linear_data(two_springs(), curves, cov="inferred", shape_std=0.05), model, theta)

    def at(cov):
        return log_likelihood(linear_data(two_springs(), curves, cov=cov, shape_std=0.05), model, theta)

    for row in range(2):
        total = integrate.quad(lambda log_cov, row=row: np.exp(at(np.exp(log_cov))[row]), np.log(1e-3), np.log(20.0))[0]
        assert found[row] == pytest.approx(np.log(total), abs=1e-3)


SETS = [
    curve(2, hz, [1.0, -1.0 - 0.02 * k, 0.3 + 0.01 * k**2], name=str(k), sensors=("a", "b", "c"))
    for k, hz in enumerate([5.0, 5.1, 4.95, 5.02])
]


def three_springs():
    stiffness = 400.0 * np.eye(3) + 300.0 * np.array([[1, -1, 0], [-1, 2, -1], [0, -1, 1]])
    between = sparse.csr_matrix(50.0 * np.diag([1.0, 0.0, 0.0]))
    return AffineStructure(np.eye(3), stiffness, {"between": between}, ("a", "b", "c"), ("a", "b", "c"), {})


@cache
def three_springs_model():
    return ritz_model(three_springs(), box={"between": (0.5, 2.0)}, modes=[2])


def with_common_errors(cov, shape_std, theta):
    data = linear_data(three_springs(), SETS, cov=cov, shape_std=shape_std, common_error=0.01)
    return log_likelihood(data, three_springs_model(), theta)


def test_an_error_that_all_curves_share_stands_in_every_entry_of_their_covariance():
    theta = np.array([[0.6], [1.0], [1.7]])
    found = with_common_errors(0.02, 0.03, theta)
    values = np.array([one.eigenvalue[0] for one in SETS])
    shapes = np.array([one.amplitude[0] / np.linalg.norm(one.amplitude[0]) for one in SETS])
    shared = np.ones((4, 4))
    for row, (between,) in enumerate(theta):
        eigenvalue, modes = lowest_modes(np.eye(3), three_springs().stiffness_at({"between": between}), 3)
        covariance = np.diag((0.02 * values) ** 2) + (0.02 * values.mean()) ** 2 * shared
        expected = stats.multivariate_normal.logpdf(values, np.full(4, eigenvalue[1]), covariance)
        # the part of the shapes across that of the model, in two directions at right angles to it
        across = np.linalg.svd(modes[:, [1]])[0][:, 1:].T @ (shapes * np.sign(shapes @ modes[:, [1]])).T
        covariance = 0.03**2 * np.eye(4)
        expected += stats.multivariate_normal.logpdf(across, np.zeros(4), covariance).sum()
        assert found[row] == pytest.approx(expected, rel=1e-9)


def test_an_unknown_scatter_beside_a_common_error_is_integrated_out():
    theta = np.array([[0.6], [1.7]])
    logs = np.linspace(np.log(1e-3), np.log(20.0), 80)
    for place in (0, 1):

        def at(level, place=place):
            return with_common_errors(*((level, 0.03) if place == 0 else (0.02, level)), theta)

        density = np.array([at(float(np.exp(each))) for each in logs])
        top = density.max(axis=0)
        total = top + np.log(integrate.trapezoid(np.exp(density - top), logs, axis=0))
        np.testing.assert_allclose(at("inferred"), total, atol=1e-3)


def test_each_mode_may_have_its_own_settings():
    curves = [*SETS, curve(1, 3.0, [1.0, 1.1, 0.9], sensors=("a", "b", "c"))]
    given = {"cov": {1: 0.01, 2: "inferred"}, "shape_std": {1: "inferred"}, "common_error": 0.004}
    one, two = linear_data(three_springs(), curves, **given)
    assert one.eigenvalue_std == pytest.approx(0.01 * one.eigenvalue)
    assert (one.infer_eigenvalue_std, two.infer_eigenvalue_std) == (False, True)
    assert (one.infer_shape_std, two.infer_shape_std) == (True, False)
    paper, other = (
        linear_data(three_springs(), curves, cov={1: 0.01, 2: 0.02}, shape_factor=f)[1] for f in (None, 0.5)
    )
    assert (paper.shape_std, other.shape_std) == pytest.approx((np.sqrt(3) * 0.02, 0.5 * 0.02))


def test_the_likelihood_of_an_unknown_scatter_of_shapes_does_not_depend_on_the_guess():
    theta = np.array([[0.6], [1.7]])
    data = linear_data(three_springs(), SETS, cov=0.02, shape_std="inferred")
    other = [replace(each, shape_std=0.03) for each in data]
    found, again = (log_likelihood(each, three_springs_model(), theta) for each in (data, other))
    np.testing.assert_allclose(found, again, rtol=1e-12)


def test_more_curves_do_not_reduce_a_common_error():
    widths = []
    for factor in (1, 9):
        counts = {mode: factor * n for mode, n in COUNTS.items()}
        curves = measured(np.random.default_rng(4), counts=counts)
        data = linear_data(wing(), curves, cov=COV, shape_std=10.0, common_error=0.004)
        peak = maximum_a_posteriori(log_posterior(data, wing_model(), PRIORS), TRUTH, tolerance=1e-6)
        widths.append(np.sqrt(np.diag(peak.covariance)) / TRUTH)
    assert (widths[1] > 0.9 * widths[0]).all()
    # lambda of both modes follows the steel by 0.87 and 0.98, with the errors of both
    assert widths[1][1] == pytest.approx(0.0085, rel=0.3)


def test_scatter_is_that_of_the_curves():
    rng = np.random.default_rng(8)
    curves = measured(rng, counts={7: 400}, shape_std=0.003)
    (paper,) = linear_data(wing(), curves)
    np.testing.assert_allclose(paper.eigenvalue_std / paper.eigenvalue, COV[7], rtol=0.15)
    assert paper.shape_std == pytest.approx(np.sqrt(14) * paper.eigenvalue_std[0] / paper.eigenvalue[0], rel=1e-12)


def test_sensors_may_be_some_of_the_structure_in_any_order():
    rng = np.random.default_rng(2)
    full = measured(rng, counts={7: 6})
    pick = [9, 2, 12]
    some = [
        MeasuredBackbone(c.name, 7, "10", c.frequency_hz, c.amplitude[:, pick], tuple(c.sensors[k] for k in pick))
        for c in full
    ]
    (data,) = linear_data(wing(), some, cov=0.01)
    np.testing.assert_array_equal(data.rows, pick)
    assert np.isfinite(log_likelihood([data], wing_model(), TRUTH)).all()


@pytest.mark.parametrize("seed", [1, 2])
def test_known_parameters_are_recovered(seed):
    rng = np.random.default_rng(seed)
    found = update_linear(wing(), measured(rng), priors=PRIORS, rng=rng, n_samples=250, n_warm_up=50)
    std = np.array([found.estimates[name].std for name in found.names])
    # the scatter of five curves is known poorly
    assert (np.abs(found.best - TRUTH) < 4 * std).all()
    assert 0.003 < std[0] < 0.03
    assert 1e-4 < std[1] < 2e-3
    for row, hz in zip(found.modes, (14.65, 17.71), strict=True):
        assert row.updated_hz == pytest.approx(hz, rel=5e-3)
        assert row.updated_mac > max(row.initial_mac, 0.997)
    first = found.modes[0]
    assert first.initial_hz == pytest.approx(22.5, abs=0.05)
    assert 0.7 < first.initial_mac < 0.9
    assert found.samples.shape == (1000, 2)
    assert found.diagnostics.r_hat < 1.2
    assert found.estimates["E_steel"].interval95[0] < found.best[1] < found.estimates["E_steel"].interval95[1]


def test_the_same_seed_gives_the_same_posterior():
    once, again = (
        update_linear(
            two_springs(),
            [curve(1, 3.2, [1, 1]), curve(2, 5.0, [1, -1])],
            priors={"wall": Prior("lognormal", 1.0, 0.3), "between": Prior("normal", 1.0, 0.3)},
            cov=0.02,
            rng=np.random.default_rng(7),
        )
        for _ in range(2)
    )
    np.testing.assert_array_equal(once.samples, again.samples)
    assert not once.warnings


def covered(cov, shape_std, n_seeds, *, counts=COUNTS, linear_error=0.0, common_error=0.0):
    """Share of seeds whose standardised errors lie within 1.96, by parameter, with the curvature at the maximum."""
    hits = []
    for seed in range(n_seeds):
        rng = np.random.default_rng(seed)
        curves = measured(rng, counts=counts, hardening=1e-6, linear_error=linear_error)
        data = linear_data(wing(), curves, cov=cov, shape_std=shape_std, common_error=common_error)
        density = log_posterior(data, wing_model(), PRIORS)
        peak = maximum_a_posteriori(density, TRUTH, support=[(0.1, 2.0)] * 2, tolerance=1e-6)
        hits.append(np.abs(peak.theta - TRUTH) < 1.96 * np.sqrt(np.diag(peak.covariance)))
    return np.mean(hits, axis=0)


def test_intervals_hold_an_error_that_all_curves_share():
    assert (covered("inferred", "inferred", 16, linear_error=0.004) < 0.8).any()
    fraction = covered("inferred", "inferred", 16, linear_error=0.004, common_error=0.004)
    assert (fraction > 0.78).all()  # three standard deviations below 0.95


def test_intervals_of_known_noise_cover_the_truth():
    fraction = covered(COV, 0.01, 40)
    assert (fraction > 0.84).all()  # three standard deviations below 0.95


def test_more_curves_make_the_posterior_narrower():
    widths = []
    for factor in (1, 4):
        counts = {mode: factor * n for mode, n in COUNTS.items()}
        data = linear_data(wing(), measured(np.random.default_rng(4), counts=counts), cov=COV)
        peak = maximum_a_posteriori(log_posterior(data, wing_model(), PRIORS), TRUTH, tolerance=1e-6)
        widths.append(np.sqrt(np.diag(peak.covariance)))
    np.testing.assert_allclose(widths[0] / widths[1], 2.0, rtol=0.2)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_to_be_doubted_is_told(seed):
    curves = [curve(2, 5.0, [1, -1]), curve(2, 5.02, [1, -1.02], name="two"), curve(2, 5.01, [1, -1], name="three")]
    priors = {"wall": Prior("uniform", 0.2, 0.5), "between": Prior("uniform", 0.2, 0.6)}
    found = update_linear(two_springs(), curves, priors=priors, rng=np.random.default_rng(seed))
    told = " | ".join(found.warnings)
    assert "wall presses against the upper end 0.5" in told
    assert "not mixed" not in told
    assert "between presses against the upper end 0.6" in told
    assert "scatter of mode 2 is estimated from only 3 curves: measure more, give cov, or take the recommended" in told
    assert "the updated mode 2 lies at" in told
    assert "error that its parameters cannot correct" in told


def test_curves_with_other_sensors_are_independent_data():
    whole = curve(2, 4.2, [1.0, 0.1, -0.9], sensors=("a", "b", "c"))
    fewer = curve(2, 4.22, [-0.9, 1.0], name="fewer", sensors=("c", "a"))
    given = {"cov": 0.01, "shape_std": 0.05}
    theta = np.array([[0.8], [1.0], [1.3]])
    model = ritz_model(three_springs(), box={"between": (0.5, 2.0)}, modes=[2])

    def density(*curves):
        return log_likelihood(linear_data(three_springs(), curves, **given), model, theta)

    assert density(whole, fewer) == pytest.approx(density(whole) + density(fewer), rel=1e-12)


def test_an_updated_shape_that_is_not_the_measured_one_is_doubted():
    curves = [curve(2, hz, [1.0, 0.1, -0.9], name=str(hz), sensors=("a", "b", "c")) for hz in (4.2, 4.21, 4.22, 4.23)]
    priors = {"between": Prior("uniform", 0.5, 2.0)}
    told = []
    for turned in (1.0, -1.0):
        # the third sensor upside down
        signed = [replace(each, amplitude=each.amplitude * [1.0, 1.0, turned]) for each in curves]
        found = update_linear(three_springs(), signed, priors=priors, rng=np.random.default_rng(1), n_samples=100)
        told.append([each for each in found.warnings if "is not the measured one (MAC 0." in each])
    assert not told[0]
    assert "check whether the curves are of another mode, and check the names and signs of the sensors" in told[1][0]


def test_a_mode_that_is_missed_by_no_more_than_the_common_error_is_not_doubted():
    curves = [curve(2, hz, [1, -1], name=str(hz)) for hz in (5.0, 5.001, 5.002)]
    given = {"priors": {"wall": Prior("uniform", 0.97, 1.0)}, "cov": 2e-4, "n_samples": 100, "shape_std": 0.01}
    structure, told = two_springs(), []
    between = {"wall": structure.parts["wall"]}
    one = AffineStructure(structure.mass, 0.97 * structure.parts["between"], between, ("a", "b"), ("a", "b"), {})
    for error in (0.0, 0.01):
        found = update_linear(one, curves, rng=np.random.default_rng(1), common_error=error, **given)
        told.append(any("error that its parameters cannot correct" in warning for warning in found.warnings))
    assert told == [True, False]


def test_lowest_points_that_are_nonlinear_are_told():
    rng = np.random.default_rng(1)
    found = update_linear(
        wing(), measured(rng, hardening=0.02), priors=PRIORS, rng=rng, n_samples=50, n_warm_up=10, n_chains=2
    )
    assert any("lowest points of mode 7 lie" in warning for warning in found.warnings)


@pytest.mark.parametrize(
    ("curves", "settings", "message"),
    [
        ([], {}, "no backbone is given"),
        ([curve(1, 3.0, [1, 1])], {}, "mode 1 has one backbone, which has no scatter: give cov"),
        ([curve(1, 3.0, [1, 1]), curve(1, 3.0, [1, 1.1], name="b")], {}, "begin at the same frequency: give cov"),
        ([curve(1, 3.0, [1, 1])], {"cov": 0.0}, "cov of mode 1 is 0.0: give a positive number"),
        ([curve(1, 3.0, [1, 1])], {"cov": {3: 0.1}}, "cov names mode 3, which has no backbone"),
        ([curve(1, 3.0, [1, 1])], {"cov": "guess"}, "cov is 'guess'"),
        ([curve(1, 3.0, [1, 1])], {"cov": 0.1, "weight": -1.0}, "weight of mode 1 is -1.0: give a positive number"),
        ([curve(1, 3.0, [1, 1])], {"cov": 0.1, "common_error": -0.1}, "common_error is -0.1: give 0 or more"),
        ([curve(1, 3.0, [1, 1])], {"cov": {1: "guess"}}, "cov is 'guess': give 'scatter', 'inferred' or a number"),
        ([curve(1, 3.0, [1, 1])], {"cov": 0.1, "shape_std": {2: 0.1}}, "shape_std names mode 2, which has no backbone"),
        ([curve(1, 3.0, [1, 1])], {"cov": 0.1, "shape_factor": 0.0}, "shape_factor is 0.0: give a positive number"),
        ([curve(1, 3.0, [1, 1])], {"cov": 0.1, "shape_std": "paper?"}, "shape_std is 'paper"),
        ([curve(1, 3.0, [1, 1], sensors=("a", "c"))], {"cov": 0.1}, "has the sensor 'c', which the structure does not"),
        ([curve(1, 3.0, [1], sensors=("a",))], {"cov": 0.1, "shape_std": 0.1}, "one sensor has no shape"),
    ],
)
def test_bad_data_are_told(curves, settings, message):
    with pytest.raises(InputError, match=message):
        linear_data(two_springs(), curves, **settings)


@pytest.mark.parametrize(
    ("priors", "message"),
    [
        ({"wall": Prior("lognormal", 1.0, 3e11)}, "standard deviation of 3e[+]11 of the logarithm: give at most 20"),
        ({"wal": Prior()}, "there is a prior for 'wal', which is not a parameter: did you mean 'wall'"),
        ({"wall": Prior("uniform", -2.0, -1.0)}, "prior of 'wall' allows nothing above 0"),
        ({}, "no parameter varies"),
    ],
)
def test_bad_priors_are_told(priors, message):
    with pytest.raises(InputError, match=message):
        update_linear(two_springs(), [curve(1, 3.0, [1, 1])], priors=priors, cov=0.1, rng=np.random.default_rng(1))


def test_modes_and_boxes_that_cannot_be_are_told():
    with pytest.raises(InputError, match=r"modes are \[3\]: give numbers from 1 to 2"):
        ritz_model(two_springs(), box={"wall": (0.5, 2.0)}, modes=[3])
    with pytest.raises(InputError, match="varies from 0 to 2: give positive ends"):
        ritz_model(two_springs(), box={"wall": (0.0, 2.0)}, modes=[1])
    model = ritz_model(two_springs(), box={"wall": (0.5, 2.0)}, modes=[1])
    with pytest.raises(InputError, match="give one column for each of 1 parameters"):
        ritz_modes(model, np.ones((3, 2)))


def test_a_start_that_leads_nowhere_is_not_the_end():
    """The best draw lies on a plateau; the others have a maximum."""

    def density(theta):
        return np.where(theta[:, 0] < 1, 5.0, -0.5 * (theta[:, 0] - 3.0) ** 2)

    draws = np.array([[0.5], [2.0], [3.5], [4.0], [4.5], [5.0]])
    peak = _find_peak(density, draws, [(0.0, 10.0)])
    assert peak.theta == pytest.approx([3.0], abs=1e-3)
