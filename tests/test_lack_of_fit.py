"""A law that does not fit is doubted, judged by the noise that the curves hold; the right one is not."""

from dataclasses import replace

import made_backbones as made
import numpy as np
import pytest

from opid.updating.likelihood.backbones import backbone_data
from opid.updating.settings import UPDATING
from opid.updating.warnings import LackOfFit, lack_of_fit, unexplained_fraction, warn_of_fit

GRID = np.linspace(0.3, 4.0, 371)[:, None]


def misfits_at_best(measured, model_class, **settings):
    data = backbone_data(made.system(), measured, harmonics=(1,), **settings)
    best = GRID[np.argmax(made.log_likelihood(data, model_class, GRID))]
    return data, best, lack_of_fit(data, model_class, best)


def told(misfits, unexplained=0.0):
    return list(warn_of_fit(misfits, unexplained))


@pytest.mark.parametrize("form", ["recommended", "paper"])
@pytest.mark.parametrize("noise", [1e-4, 1e-3])
def test_the_right_law_is_not_doubted_and_a_wrong_one_is(form, noise):
    for seed in range(4):
        measured = made.backbones(seed, point_noise=noise, n_curves=(6, 5))
        _, _, right = misfits_at_best(measured, made.CUBIC, form=form)
        assert [each.mode for each in right] == [2, 3]
        assert told(right) == []
        _, _, wrong = misfits_at_best(measured, made.QUADRATIC, form=form)
        assert max(each.fraction for each in wrong) > 0.1
        (sentence,) = told(wrong)
        assert "of the measured growth of the frequencies of mode" in sentence
        assert "unexplained, alike in all curves" in sentence
        assert "this law does not fit the backbones, and no interval of it holds" in sentence


def test_noise_that_hides_the_misfit_is_no_doubt():
    for seed in range(4):
        for law in (made.CUBIC, made.QUADRATIC):
            _, _, found = misfits_at_best(made.backbones(seed, point_noise=0.02, n_curves=(3, 2)), law)
            assert told(found) == []


def test_few_curves_are_judged_by_their_points():
    measured = made.backbones(3, n_curves=(1, 2), point_noise=2e-4)
    _, _, right = misfits_at_best(measured, made.CUBIC)
    assert told(right) == []
    _, _, wrong = misfits_at_best(measured, made.QUADRATIC)
    assert "alike in all curves" in told(wrong)[0]


@pytest.mark.parametrize("n_curves", [1, 3, 12])
def test_the_probability_is_one_of_chance(n_curves):
    """Errors of the points alone: it is as often below any level as it should be, or a little more seldom."""
    rng = np.random.default_rng(0)
    measured = made.backbones(0, n_curves=(n_curves, 1), offset_fraction=0.0, point_noise=0.0, linear_error=0.0)
    data = backbone_data(made.system(), measured[:n_curves], harmonics=(1,))
    mode, found = data.modes[0], []
    for _ in range(200):
        noisy = replace(mode, eigenvalue=mode.eigenvalue * (1 + 0.002 * rng.standard_normal(mode.eigenvalue.size)))
        found += lack_of_fit(replace(data, modes=(noisy,)), made.CUBIC, np.array([made.TRUTH]))
    probability = np.array([each.probability for each in found])
    assert 5 < np.sum(probability < 0.1) < 35  # 20 are expected, their deviation is 4
    assert 60 < np.sum(probability < 0.5) < 125  # 100 and 7: few curves are judged with care
    assert 160 < np.sum(probability < 0.9) < 195  # 180 and 4


def test_curves_without_noise_and_curves_too_short():
    still = {"offset_fraction": 0.0, "point_noise": 0.0, "linear_error": 0.0}
    data = backbone_data(made.system(), made.backbones(0, **still), harmonics=(1,))
    assert told(lack_of_fit(data, made.CUBIC, np.array([made.TRUTH]))) == []
    short = made.backbones(0, n_points=3, n_curves=(2, 1))
    data = backbone_data(made.system(), short, harmonics=(1,))
    assert lack_of_fit(data, made.CUBIC, np.array([made.TRUTH])) == ()
    assert unexplained_fraction(data, made.CUBIC, np.array([0.0])) == pytest.approx(1.0, abs=0.05)
    (sentence,) = told((), unexplained_fraction(data, made.CUBIC, np.array([0.5])))
    assert "% of the measured growth of the frequencies stay unexplained: this law does not fit" in sentence


def test_rare_and_large_is_doubted_but_neither_alone():
    rare, likely, small = UPDATING.rare / 10, 0.1, UPDATING.least_misfit / 2
    assert told([LackOfFit(7, small, rare), LackOfFit(8, 0.2, likely)]) == []
    (sentence,) = told([LackOfFit(7, 0.09, rare), LackOfFit(8, 0.12, rare)])
    assert "12 % of the measured growth of the frequencies of mode 8" in sentence
    assert "less than one of 1000 sets" in sentence
