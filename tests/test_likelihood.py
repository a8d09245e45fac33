from dataclasses import replace

import made_backbones as made
import numpy as np
import pytest
from scipy.stats import invgamma, multivariate_normal

from opid.errors import InputError
from opid.mechanics.backbones.family import backbone
from opid.updating.likelihood import backbones
from opid.updating.likelihood.backbones import backbone_data, coefficient_of_variation
from opid.updating.likelihood.curves import slopes_function
from opid.updating.likelihood.noise import (
    OWN_WEIGHT,
    RATIOS,
    NoiseSettings,
    curve_noise,
    draw_errors,
    log_marginal,
)

THETA = np.array([[1.4], [1.58], [1.7]])


@pytest.fixture(scope="module")
def measured():
    return made.backbones(1)


def by_loops(measured, theta, form, cov, sigma_fraction=None):
    """Song eqs. (10) to (12) and (17), point by point, with backbones solved at every measured amplitude."""
    system, total = made.system(), 0.0
    for one in measured:
        solved = backbone(
            system, made.CUBIC.law("left", [theta]), mode=one.mode, sensor="left", amplitude=one.controlled_amplitude
        )
        model = (2 * np.pi * solved.frequency_hz) ** 2
        r_m = system.eigenvalue[one.mode - 1] - one.eigenvalue[0]
        sigma = cov[one.mode] * one.eigenvalue
        sigma_phi = np.sqrt(5) * cov[one.mode]
        score = (one.eigenvalue - model + r_m) / sigma
        one_less_mac = [
            1 - (a @ b) ** 2 / ((a @ a) * (b @ b)) for a, b in zip(one.amplitude, solved.shapes, strict=True)
        ]
        if form == "literal":
            misfit = np.mean(score) ** 2 + np.mean(one_less_mac) / sigma_phi**2
        elif form == "paper":
            misfit = np.mean(score**2) + np.mean(one_less_mac) / sigma_phi**2
        else:
            misfit = np.sum(score**2) + np.sum(one_less_mac) / sigma_phi**2
        # five sensors, and a shape of unit length has one entry less to choose
        n_free = 4 * sigma.size
        total -= 0.5 * misfit + np.log(sigma).sum() + n_free * np.log(sigma_phi)
        total -= 0.5 * (sigma.size + n_free) * np.log(2 * np.pi)
    return total


@pytest.mark.parametrize("form", ["paper", "literal", "independent"])
def test_papers_forms_are_their_equations(measured, form):
    cov = {2: 0.006, 3: 0.008}
    data = backbone_data(made.system(), measured, form=form, harmonics=(1,), noise=NoiseSettings(cov=cov))
    expected = [by_loops(measured, theta, form, cov) for theta in THETA[:, 0]]
    assert made.log_likelihood(data, made.CUBIC, THETA) == pytest.approx(expected, abs=1e-5)


def test_mean_of_squares_tells_classes_apart_and_the_square_of_the_mean_does_not():
    measured = made.backbones(1, offset_fraction=0.0005)
    grid = np.linspace(0.1, 5, 200)[:, None]
    gap = {}
    for form in ("paper", "literal"):
        data = backbone_data(made.system(), measured, form=form, harmonics=(1,), noise=NoiseSettings(shapes=False))
        best = [made.log_likelihood(data, each, grid).max() for each in (made.CUBIC, made.QUADRATIC)]
        gap[form] = best[0] - best[1]
    assert gap["paper"] > 5
    assert abs(gap["literal"]) < 1


def test_coefficient_of_variation_of_curves_that_differ_by_offsets(measured):
    first = measured[0]
    offsets = np.array([-0.01, 0.0, 0.01])
    curves = [replace(first, frequency_hz=first.frequency_hz * np.sqrt(1 + each)) for each in offsets]
    assert coefficient_of_variation(curves) == pytest.approx(0.01, rel=1e-9)
    assert np.isnan(coefficient_of_variation(curves[:1]))


def test_few_nodes_are_as_good_as_all_amplitudes(measured, monkeypatch):
    few = backbone_data(made.system(), measured, form="recommended", harmonics=(1,))
    monkeypatch.setattr(backbones, "N_NODES", 200)
    all_of_them = backbone_data(made.system(), measured, form="recommended", harmonics=(1,))
    assert all_of_them.modes[0].parts[0][1].size > 12
    both = [made.log_likelihood(data, made.CUBIC, THETA) for data in (few, all_of_them)]
    assert both[0] == pytest.approx(both[1], abs=1e-5)


def test_the_likelihood_is_the_same_to_the_last_digit_whatever_was_drawn_before(measured):
    """scipy takes the factors of interpolation weights in a random order, which rounds them differently."""
    values = []
    for seed in range(3):
        np.random.seed(seed)  # noqa: NPY002
        data = backbone_data(made.system(), measured, form="recommended", harmonics=(1,))
        values.append(made.log_likelihood(data, made.CUBIC, THETA).tolist())
    assert values[0] == values[1] == values[2]


@pytest.mark.parametrize("form", ["paper", "recommended"])
def test_units_and_order_of_curves_change_nothing(measured, form):
    in_turn = [
        made.log_likelihood(backbone_data(made.system(), each, form=form, harmonics=(1,)), made.CUBIC, THETA)
        for each in (measured, measured[::-1])
    ]
    assert in_turn[0] == pytest.approx(in_turn[1], abs=1e-6)
    (term,) = made.CUBIC.terms
    scaled = replace(made.CUBIC, terms=(replace(term, scales=(2 * term.scales[0],)),))
    data = backbone_data(made.system(), measured, form=form, harmonics=(1,))
    assert made.log_likelihood(data, scaled, THETA / 2) == pytest.approx(in_turn[0], abs=1e-6)


def test_the_largest_entry_of_a_unit_shape_tells_nothing_more(measured):
    data = backbone_data(made.system(), measured, harmonics=(1,))
    for mode in data.modes:
        largest = int(np.argmax(np.abs(mode.shapes).mean(axis=0)))
        (only,) = mode.shape_sets
        assert only.free.tolist() == [k for k in range(5) if k != largest]
        assert only.noise.data.shape[1] == 4
        rest = np.sqrt(1 - (mode.shapes[:, only.free] ** 2).sum(axis=1))
        assert np.abs(mode.shapes[:, largest]) == pytest.approx(rest, abs=1e-12)


def test_an_error_of_the_linear_frequency_costs_the_recommended_form_little():
    exact, off = made.backbones(3, linear_error=0.0), made.backbones(3, linear_error=0.004)
    grid = np.linspace(1.3, 1.9, 121)[:, None]
    means = []
    for each in (exact, off):
        value = made.log_likelihood(backbone_data(made.system(), each, harmonics=(1,)), made.CUBIC, grid)
        fraction = np.exp(value - value.max())
        means.append(fraction @ grid[:, 0] / fraction.sum())
    assert means[0] == pytest.approx(means[1], abs=0.03)


@pytest.mark.parametrize("day", [None, (0, 1, 1), (0, 0, 0), (0, 1, 2)])
def test_curve_noise_is_the_integral_over_all_levels(day):
    rng = np.random.default_rng(5)
    curve = np.repeat([0, 1, 2], 16)
    growth = np.tile(np.linspace(0, 0.2, 16), 3)
    between = np.stack([np.ones_like(growth), growth], axis=1)
    values = 1 + growth + 0.006 * rng.standard_normal(3)[curve] + 0.002 * rng.standard_normal(curve.size)
    settings = {"common_std": 0.008, "common_growth": 0.4, "own_growth": 3.0, "offset": 0.006, "expected": 0.002}
    if day is not None:
        settings |= {"day": np.array(day)[curve], "day_std": 0.003}
    noise = curve_noise(values[:, None], between, curve, growth, **settings)
    models = np.array([[1.0, 1.0], [1.0, 1.006], [1.003, 0.99]])
    offsets = np.eye(3)[curve]
    slopes = offsets * (growth - growth.mean())[:, None]
    common = 0.008**2 * (1 + 0.4**2 * np.outer(growth, growth))
    if day is not None:
        of_day = np.eye(3)[np.array(day)[curve]]
        common += 0.003**2 * of_day @ of_day.T
    prior = invgamma(OWN_WEIGHT, scale=OWN_WEIGHT * 0.002**2)
    exact = []
    for model in models:
        left = values - between @ model

        def density(log_sigma, left=left):
            sigma = np.exp(log_sigma)
            total = 0.0
            for ratio in RATIOS:
                own = ratio * sigma
                covariance = sigma**2 * np.eye(curve.size) + own**2 * offsets @ offsets.T
                covariance += (3 * sigma) ** 2 * slopes @ slopes.T + common
                scaled = own / (2 * 0.006)
                weight = np.log(RATIOS[1] / RATIOS[0]) * scaled * np.sqrt(2 / np.pi) * np.exp(-0.5 * scaled**2)
                total += weight * np.exp(multivariate_normal.logpdf(left, cov=covariance) - 200)
            return total * prior.pdf(sigma**2) * 2 * sigma**2

        nodes, weights = np.polynomial.legendre.leggauss(12)
        low, high = np.log(0.0012), np.log(0.0035)
        where = (low + high) / 2 + (high - low) / 2 * nodes
        total = sum(w * density(x) for w, x in zip(weights, where, strict=True)) * (high - low) / 2
        exact.append(np.log(total) + 200)
    found = log_marginal(noise, models[..., None])
    assert found == pytest.approx(exact, abs=0.1)
    assert np.diff(found) == pytest.approx(np.diff(exact), abs=0.03)


def test_drawn_errors_scatter_as_the_curves_do():
    rng = np.random.default_rng(6)
    curve = np.repeat(np.arange(40), 15)
    growth = np.tile(np.linspace(0, 0.2, 15), 40)
    values = 1 + 0.006 * rng.standard_normal(40)[curve] + 0.002 * rng.standard_normal(curve.size)
    noise = curve_noise(
        values[:, None], np.ones((curve.size, 1)), curve, growth,
        common_std=0.008, common_growth=0.0, own_growth=0.0, offset=0.006, expected=0.002,
    )  # fmt: skip
    drawn = draw_errors(noise, np.ones((4000, 1, 1)), np.tile(growth[:15], (4000, 1)), rng)[..., 0]
    assert drawn.std() == pytest.approx(np.hypot(0.006, 0.002), rel=0.15)
    assert (drawn - drawn.mean(axis=1, keepdims=True)).std() == pytest.approx(0.002, rel=0.1)


def with_sensors(one, names):
    """A curve of some of its sensors, in that order."""
    return replace(one, amplitude=one.amplitude[:, [one.sensors.index(name) for name in names]], sensors=tuple(names))


def test_the_order_of_the_sensors_does_not_matter(measured):
    turned = [
        with_sensors(one, one.sensors[::-1] if number % 2 else one.sensors) for number, one in enumerate(measured)
    ]
    for form in ("paper", "recommended"):
        noise = NoiseSettings(cov={2: 0.01, 3: 0.01})
        found = [
            made.log_likelihood(backbone_data(made.system(), own, form=form, noise=noise), made.CUBIC, THETA)
            for own in (measured, turned)
        ]
        assert found[0] == pytest.approx(found[1], rel=1e-12)


def test_curves_with_other_sensors_tell_more_than_those_they_share_and_less_than_all(measured):
    """Half of the curves lack the two sensors that tell most; the interval lies between."""
    theta = np.linspace(1.0, 2.2, 241)[:, None]
    shared = ("left", "right", "plate")
    few = [with_sensors(one, shared) for one in measured]
    mixed = [one if number % 2 else few[number] for number, one in enumerate(measured)]
    spread = []
    for own in (measured, mixed, few):
        data = backbone_data(made.system(), own, noise=NoiseSettings(linear_error=0.001))
        log_density = made.log_likelihood(data, made.CUBIC, theta)
        weight = np.exp(log_density - log_density.max())
        weight /= weight.sum()
        mean = weight @ theta[:, 0]
        spread.append(np.sqrt(weight @ (theta[:, 0] - mean) ** 2))
        assert abs(mean - made.TRUTH) < 2.5 * spread[-1]
    assert spread[0] < spread[1] * 1.02
    assert spread[1] < spread[2] * 1.02


def test_slopes_of_curves_with_other_sensors_are_those_of_differences(measured):
    mixed = [with_sensors(one, ("right", "left", "bend")) if number % 2 else one for number, one in enumerate(measured)]
    data = backbone_data(made.system(), mixed)
    _, slope = slopes_function(data, made.CUBIC)(np.array([[1.5]]))
    value = made.log_likelihood(data, made.CUBIC, np.array([[1.5 - 1e-4], [1.5 + 1e-4]]))
    assert slope[0, 0] == pytest.approx((value[1] - value[0]) / 2e-4, rel=1e-5)


def test_a_further_curve_is_of_a_further_day():
    rng = np.random.default_rng(7)
    curve = np.repeat(np.arange(40), 15)
    growth = np.tile(np.linspace(0, 0.2, 15), 40)
    day = curve // 4
    values = 1 + 0.004 * rng.standard_normal(10)[day] + 0.0005 * rng.standard_normal(curve.size)
    noise = curve_noise(
        values[:, None], np.ones((curve.size, 1)), curve, growth, common_std=0.008, common_growth=0.0, own_growth=0.0,
        offset=0.0005, expected=0.0005, day=day, day_std=0.004,
    )  # fmt: skip
    drawn = draw_errors(noise, np.ones((4000, 1, 1)), np.tile(growth[:15], (4000, 1)), rng)[..., 0]
    assert drawn.mean(axis=1).std() == pytest.approx(0.004, rel=0.15)


def test_days_that_differ_leave_the_law_as_well_known_if_they_are_named():
    """The lower half of the amplitudes is measured on the first day, the upper one on the second."""
    held, spread, theta = [], [], np.linspace(0.2, 3.2, 301)
    for seed in range(8):
        shifts = 1.0 + 0.02 * np.random.default_rng([8, seed]).standard_normal((2, 2))
        measured = []
        for number, one in enumerate(made.backbones(seed, offset_fraction=0.0005)):
            late = number % 2
            part = slice(6, None) if late else slice(0, 6)
            shifted = one.frequency_hz[part] * shifts[late, one.mode - 2]
            measured.append(replace(one, frequency_hz=shifted, amplitude=one.amplitude[part], day=f"day {late}"))
        noise = NoiseSettings(linear_error=0.0005, day_offset=0.02, curve_offset=0.0005)
        of_seed = []
        for own in (measured, [replace(one, day="") for one in measured]):
            data = backbone_data(made.system(), own, noise=noise)
            log_density = made.log_likelihood(data, made.CUBIC, theta[:, None])
            weight = np.exp(log_density - log_density.max())
            weight /= weight.sum()
            mean = weight @ theta
            of_seed.append((abs(mean - made.TRUTH), np.sqrt(weight @ (theta - mean) ** 2)))
        held.append(of_seed[0][0] < 2.2 * of_seed[0][1])
        spread.append([each[1] for each in of_seed])
    assert sum(held) >= 7
    named, unnamed = np.mean(spread, axis=0)
    assert named < 0.9 * unnamed


def test_bad_input(measured):
    system = made.system()
    with pytest.raises(InputError, match="there is no likelihood 'papers'"):
        backbone_data(system, measured, form="papers")
    with pytest.raises(InputError, match="no measured backbone"):
        backbone_data(system, [])
    with pytest.raises(InputError, match="the curves of mode 2 do not show how lambda varies"):
        backbone_data(system, measured[:1], form="paper")
    renamed = replace(measured[0], sensors=("elsewhere", *measured[0].sensors[1:]))
    with pytest.raises(InputError, match="there is no sensor 'elsewhere'"):
        backbone_data(system, [renamed])
    still = replace(system, at_joints=system.at_joints * np.where(np.arange(5) == 1, 1e-4, 1.0))
    with pytest.raises(InputError, match=r"mode 2 extends no joint .* take another mode, such as 1, 3, 4"):
        backbone_data(still, measured)
    with pytest.raises(InputError, match="point_noise is 0"):
        NoiseSettings(point_noise=0.0)
    with pytest.raises(InputError, match="cov of mode 2 is -1"):
        NoiseSettings(cov={2: -1.0})
    with pytest.raises(InputError, match="curve_growth is -1"):
        NoiseSettings(curve_growth=-1)
