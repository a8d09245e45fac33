"""Classes whose law is an odd cubic spline: their tables, backbones and warnings, and what they find in known truth."""

from dataclasses import replace

import made_backbones as made
import made_updating as updating
import numpy as np
import pytest
from shooting import shoot

from opid.errors import InputError
from opid.mechanics.backbones.family import backbone
from opid.mechanics.laws.law import Law, Term, TermSet
from opid.report.updating import find_true_theta
from opid.report.writing import text
from opid.studies.updating_study import ClassTable, LawTable, tabulate_class
from opid.updating.likelihood.backbones import backbone_data
from opid.updating.model_class import ModelClass, Prior, UncertainTerm, spline_terms
from opid.updating.posterior import update_class
from opid.virtual.backbone_tests.measured import synthetic_backbones

KNOTS_M = tuple(2e-4 * np.arange(1, 9))
REACH_M = 1.6e-3  # how far the curves of both modes extend the joints
STIFFNESS, TURN_M = 5000.0, 1e-3
SATURATING = ModelClass(
    "K z less an arctangent: the stiffness rises from 0 and ends at K",
    (
        UncertainTerm("signed_power_stiffness", (STIFFNESS, 1.0), (Prior(), None)),
        UncertainTerm("arctan_displacement", (-STIFFNESS * TURN_M * np.pi / 2, TURN_M), (Prior(), None)),
    ),
)
CUBIC = STIFFNESS / (3 * TURN_M**2)
"""N/m^3, its coefficient at small extensions."""
SPLINE = ModelClass("spline", spline_terms([CUBIC] * 9, KNOTS_M))


def make_power(name, *terms):
    """A class of springs with one coefficient each, about as large as that of the truth."""
    priors = (Prior(), Prior("uniform", -10.0, 10.0))
    return ModelClass(
        name,
        tuple(UncertainTerm(kind, (scale,), (prior,)) for (kind, scale), prior in zip(terms, priors, strict=False)),
    )


POWERS = (
    make_power("quadratic", ("quadratic_stiffness", 1e-3 * CUBIC)),
    make_power("cubic", ("cubic_stiffness", CUBIC)),
    make_power("cubic and quartic", ("cubic_stiffness", CUBIC), ("quartic_stiffness", 1e3 * CUBIC)),
    make_power("cubic and quintic", ("cubic_stiffness", CUBIC), ("quintic_stiffness", 1e6 * CUBIC)),
    ModelClass(
        "any power",
        (UncertainTerm("signed_power_stiffness", (1e5, 1.0), (Prior("lognormal", 1, 5), Prior("uniform", 1, 6))),),
    ),
)


def measure(law, theta, seed):
    """Three curves of each of two modes, as scattered as those of the paper."""
    return backbone_data(
        made.system(),
        synthetic_backbones(
            made.system(), law, theta, rng=np.random.default_rng(seed), modes=made.MODES, n_curves=(3, 3),
            amplitude_m=made.AMPLITUDE_M, controlled_sensor="left", linear_error=0.004, offset_fraction=0.003,
            point_noise=0.001,
        ),
    )  # fmt: skip


def find_force_band(found, extension):
    drawn = [found.model_class.law("left", theta).force(extension, 0.0) for theta in found.samples[::5]]
    return np.quantile(drawn, [0.025, 0.975], axis=0)


def test_the_terms_of_a_spline_have_continuous_second_derivatives():
    law = ModelClass("spline", spline_terms([2e9, 1e9, -4e9], [5e-4, 1e-3])).law("left", [1.0, 1.0, 0.5])
    z = np.array([-1.2e-3, -2e-4, 4e-4, 8e-4, 1.5e-3])
    size = np.abs(z)
    late = 1e9 * np.maximum(size - 5e-4, 0) ** 3 - 2e9 * np.maximum(size - 1e-3, 0) ** 3
    np.testing.assert_allclose(law.force(z, 0.0), np.sign(z) * (2e9 * size**3 + late), rtol=1e-12)
    step = 1e-9
    for knot in (5e-4, 1e-3):
        slope = law.gradient(knot + step * np.array([-2, -1, 0, 1, 2]), 0.0)[0]
        bend = np.diff(slope) / step
        assert np.ptp(slope) < 1e-4 * slope[0]
        assert np.ptp(bend) < 1e-4 * abs(bend[0])


def test_the_backbone_of_a_spline_is_that_of_shooting():
    law = SPLINE.law("left", [1.0, -0.5, -0.4, 0.3, -0.2, 0.1, 0.2, -0.3, 0.1])
    assert isinstance(law, TermSet)
    assert len(law.terms) == 9
    curve = backbone(made.system(), law, mode=2, sensor="left", amplitude=[1e-3, 2e-3], harmonics=(1, 3, 5, 7, 9))
    motion = shoot(made.system(), law, curve, point=1)
    assert abs(motion.frequency_hz / curve.frequency_hz[1] - 1) < 1e-6


def test_a_spline_is_read_and_written_with_its_knots():
    table = ClassTable(law="spline", scale="0.068 N/mm^3", knots=("0.5 mm", 1e-3))
    own = table.model
    assert own.terms == spline_terms([6.8e7] * 3, [5e-4, 1e-3])
    assert own.priors == (Prior(), Prior("normal", 0, 1), Prior("normal", 0, 1))
    assert own.law_in_words == "cubic + late cubic from 0.5 and 1 mm"
    keys = ["cubic_stiffness", "late_cubic_stiffness from 0.5 mm", "late_cubic_stiffness from 1 mm"]
    assert [each.key for each in own.parameters] == keys
    assert tabulate_class(own).model.terms == own.terms
    mixed = LawTable(
        law="dahl friction + spline", scale=(0.3, "1 mm", 2e7, 3e7), knots=("1 mm",), joints=("left",),
        prior=(("uniform", 0, 3), "known", ("uniform", 0, 5), ("normal", 0, 2)),
    ).terms  # fmt: skip
    assert [each.scales for each in mixed] == [(0.3, 1e-3), (2e7,), (3e7, 1e-3)]
    assert [each.priors[0].second for each in mixed] == [3, 5, 2]
    assert mixed[2].words == "late cubic from 1 mm at left"


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"law": "spline", "scale": 1}, "the law 'spline' has 0 knot(s): give 'knots' with the law 'spline'"),
        ({"law": "cubic", "scale": 1, "knots": (1e-3,)}, "and with no other"),
        ({"law": "spline", "scale": 1, "knots": ("1 mm", "0.5 mm")}, "are 1, 0.5 (mm): give at least one, positive"),
        ({"law": "spline", "scale": 1, "knots": (0.0, 1e-3)}, "positive and increasing"),
        ({"law": "spline", "scale": 1, "knots": ("1 N",)}, "its unit is m"),
        ({"law": "spline", "scale": (1, 1, 1), "knots": (1e-3,)}, "3 scale(s): give 2"),
        ({"law": "spline + cubic", "scale": 1, "knots": (1e-3,)}, "names 'cubic_stiffness' twice at a joint"),
        ({"law": "late cubic + late cubic", "scale": 1}, "name each once, or with different known gaps"),
    ],
)
def test_splines_that_cannot_be_are_refused(table, words):
    with pytest.raises(InputError) as caught:
        ClassTable(**table)
    assert words in str(caught.value)


def test_scales_and_priors_of_a_spline_are_counted():
    with pytest.raises(InputError, match=r"a spline with 1 knot\(s\) has 1 scale\(s\) and 2 prior\(s\): give 2"):
        spline_terms([1e7], [1e-3])
    with pytest.raises(InputError, match=r"the knots of a spline are none \(mm\)"):
        spline_terms([1e7], [])


def test_the_true_theta_of_a_term_is_that_of_a_term_which_begins_there():
    truth = updating.small_truth()
    own = ModelClass("spline", spline_terms([CUBIC, CUBIC], [1e-3]))
    posterior = replace(updating.small_class(updating.CLASSES[2], 0.0), model_class=own)
    assert find_true_theta(posterior, truth) == [pytest.approx(updating.CUBIC / CUBIC), 0.0]
    for gap_m, theta in ((1e-3, [0.0, 2.0]), (2e-3, [None, None])):
        laws = dict.fromkeys(truth.laws, Law((Term("late_cubic_stiffness", (2 * CUBIC, gap_m)),)))
        assert find_true_theta(posterior, replace(truth, laws=laws)) == theta


def test_the_report_tells_where_each_piece_of_a_spline_begins():
    own = ModelClass("class 4", spline_terms([CUBIC] * 3, [5e-4, 1e-3]))
    of_two = updating.small_class(updating.CLASSES[2], 0.0)
    estimates = {f"theta_{k}": of_two.estimates["theta_1"] for k in (1, 2, 3)}
    samples = of_two.samples[:, [0, 0, 1]]
    std = of_two.calibration_std[[0, 0, 1]]
    posterior = replace(
        of_two, model_class=own, estimates=estimates, samples=samples, best=samples[0], calibration_std=std
    )
    told = text(updating.small_updating(classes=(posterior,), best_class="class 4"))
    assert "k2 (|z| - s2)_+^3 sgn z + k3 (|z| - s3)_+^3 sgn z" in " ".join(told.split())
    assert "late cubic from 0.5 mm" in told


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_spline_holds_a_law_of_which_no_power_is(seed):
    """Its band holds the true force, and widens where no test was."""
    data = measure(SATURATING, (1.0, 1.0), seed)
    found = update_class(data, SPLINE, rng=np.random.default_rng(seed), n_samples=5500)
    others = [update_class(data, each, rng=np.random.default_rng(seed), n_samples=2000) for each in POWERS]
    assert found.log_evidence > max(each.log_evidence for each in others) + 5
    extension = np.linspace(0.0, REACH_M, 17)[1:]
    low, high = find_force_band(found, extension)
    true = SATURATING.law("left", (1.0, 1.0)).force(extension, 0.0)
    assert np.mean((low <= true) & (true <= high)) >= 0.8
    assert np.abs((low + high) / 2 - true).max() < 0.015 * true.max()
    ends = np.array([REACH_M, 1.5 * REACH_M])
    low, high = find_force_band(found, ends)
    at_ends = SATURATING.law("left", (1.0, 1.0)).force(ends, 0.0)
    near, far = (high - low) / at_ends
    assert far > 10 * near
    assert low[1] < at_ends[1] < high[1]
    assert not any("the data do not need the term" in each for each in found.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_spline_comes_behind_the_cubic_law_where_that_is_true(seed):
    data = measure(POWERS[1], (0.6,), seed)
    spline, cubic = (
        update_class(data, each, rng=np.random.default_rng(seed), n_samples=5500) for each in (SPLINE, POWERS[1])
    )
    assert cubic.log_evidence > spline.log_evidence + 3
    extension = np.linspace(0.0, REACH_M, 17)[1:]
    low, high = find_force_band(spline, extension)
    true = POWERS[1].law("left", [0.6]).force(extension, 0.0)
    assert np.mean((low <= true) & (true <= high)) >= 0.8


@pytest.mark.slow
def test_a_law_with_a_corner_is_told_not_to_be_a_spline():
    gap = ModelClass("gap", (UncertainTerm("dead_zone_stiffness", (STIFFNESS, 6e-4), (Prior(), None)),))
    data = measure(gap, (1.0,), 0)
    spline, found = (update_class(data, each, rng=np.random.default_rng(0), n_samples=3000) for each in (SPLINE, gap))
    assert any("no interval of it holds" in each for each in spline.warnings)
    assert found.log_evidence > spline.log_evidence + 10


@pytest.mark.slow
def test_knots_that_no_curve_reaches_are_told_in_one_sentence_and_cost_nothing():
    data = measure(POWERS[1], (0.6,), 0)
    wide = (Prior(), Prior("uniform", -10, 10))
    beyond, within, cubic = (
        update_class(data, ModelClass("own", terms), rng=np.random.default_rng(0), n_samples=5500)
        for terms in (spline_terms([CUBIC] * 2, [3e-3], wide), spline_terms([CUBIC] * 2, [1e-3]), POWERS[1].terms)
    )
    (warning,) = beyond.warnings
    assert warning.startswith("no data tell theta_2: terms begin at 3 mm, and in the curves their joints extend by at")
    assert abs(beyond.log_evidence - cubic.log_evidence) < 0.01
    assert beyond.estimates["theta_2"].std == pytest.approx(20 / 12**0.5, rel=0.1)
    assert not any("no data tell" in each for each in within.warnings)
