"""Bands of the motion of every sensor and of modes without curves: they hold a known truth, or say that they do not."""

from dataclasses import replace

import made_backbones as made
import numpy as np
import pytest

from opid.errors import InputError
from opid.mechanics.backbones.family import backbone
from opid.updating import unmeasured_modes
from opid.updating.identification import update_study
from opid.updating.likelihood.backbones import backbone_data
from opid.updating.likelihood.noise import NoiseSettings
from opid.updating.model_class import PAPER_CLASSES, Prior
from opid.updating.posterior import update_class
from opid.updating.prediction import predict
from opid.updating.structure.reduction import reduce
from opid.updating.study import UpdatingStudy
from opid.updating.unmeasured_modes import PredictionSettings, predict_unmeasured
from opid.updating.warnings import warn_of_choice
from opid.virtual.backbone_tests.measured import synthetic_backbones
from opid.virtual.backbone_tests.wing_engine import UPDATED, wing_engine_structure

N_SETS = 12
ONE_MODE = {"modes": made.MODES[:1], "n_curves": (6,), "amplitude_m": made.AMPLITUDE_M[:1]}


def update(measured, model_class=made.CUBIC, system=None, **settings):
    """The posterior of a class, with the data."""
    data = backbone_data(system or made.system(), measured, **({"harmonics": (1,)} | settings))
    rng = np.random.default_rng(0)
    return data, update_class(data, model_class, rng=rng, n_samples=1100, evidences=("laplace",))


def bands_of(measured, model_class=made.CUBIC, **settings):
    data, found = update(measured, model_class, **settings)
    return found, predict(data, found, measured, rng=np.random.default_rng(0))


def one_mode(seed, **errors):
    """Six curves of the second mode alone."""
    return synthetic_backbones(
        made.system(), made.CUBIC, (made.TRUTH,), rng=np.random.default_rng(seed), controlled_sensor="left",
        harmonics=(1,), n_points=12, offset_fraction=0.003, point_noise=0.001, shape_noise=0.005, **(ONE_MODE | errors),
    )  # fmt: skip


# ---- motion of every sensor ------------------------------------------------------------------------


def test_motions_of_curves_left_out_lie_in_their_bands_at_the_stated_rate():
    held = []
    for seed in range(4):
        for band in bands_of(made.backbones(seed))[1]:
            assert [own.sensor for own in band.sensors] == [name for name in made.SENSORS if name != band.sensor]
            held += [own.left_out for own in band.sensors]
    assert 0.92 < np.mean(held) < 0.98


def test_bands_hold_the_true_motions():
    law = made.CUBIC.law("left", [made.TRUTH])
    for band in bands_of(made.backbones(4))[1]:
        true = backbone(made.system(), law, mode=band.mode, sensor="left", amplitude=band.amplitude).shapes
        for own in band.sensors:
            motion = true[:, made.SENSORS.index(own.sensor)]
            assert ((own.low < motion) & (motion < own.high)).all()
            assert own.motion == pytest.approx(motion, abs=0.02 * float(np.abs(true).max()))


def test_errors_of_the_controlled_sensor_stay_in_the_other_motions():
    """It has a gain of its own in each curve; with two sensors, the shapes of unit length then have one free entry."""
    rng, held = np.random.default_rng(1), []
    columns = [made.SENSORS.index(name) for name in ("left", "right")]
    for seed in range(3):
        curves = []
        for one in made.backbones(seed):
            gain = np.array([1.0 + 0.03 * rng.standard_normal(), 1.0])
            curves.append(replace(one, sensors=("left", "right"), amplitude=one.amplitude[:, columns] * gain))
        held += [own.left_out for band in bands_of(curves)[1] for own in band.sensors if own.sensor == "right"]
    assert len(held) == 6
    assert 0.85 < np.mean(held) < 0.99


def test_sensors_that_the_curves_lack_have_the_stated_error_of_a_shape():
    columns = [made.SENSORS.index(name) for name in ("left", "right")]
    few = [replace(one, sensors=("left", "right"), amplitude=one.amplitude[:, columns]) for one in made.backbones(3)]
    _, bands = bands_of(few)
    law = made.CUBIC.law("left", [made.TRUTH])
    for band in bands:
        true = backbone(made.system(), law, mode=band.mode, sensor="left", amplitude=band.amplitude).shapes
        for own in (each for each in band.sensors if each.sensor != "right"):
            motion = true[:, made.SENSORS.index(own.sensor)]
            assert (own.left_out, np.isnan(own.coverage)) == (None, True)
            assert ((own.low < motion) & (motion < own.high)).all()
    wider = bands_of(few, noise=NoiseSettings(linear_shape_error=0.04))[1]
    ratio = [
        np.mean((two.high - two.low) / (one.high - one.low))
        for one, two in zip(bands[0].sensors, wider[0].sensors, strict=True)
    ]
    lacking = [own.sensor != "right" for own in bands[0].sensors]
    assert np.array(ratio)[lacking] == pytest.approx(2.0, rel=0.3)
    assert np.array(ratio)[~np.array(lacking)] == pytest.approx(1.0, rel=0.3)


def test_a_curve_with_another_motion_of_one_sensor_is_told():
    first, *others = one_mode(2, n_curves=(3,))
    turned = first.amplitude * np.where(np.array(first.sensors) == "right", -1.0, 1.0)
    found, bands = bands_of([replace(first, amplitude=turned), *others])
    (own,) = (each for each in bands[0].sensors if each.sensor == "right")
    assert own.left_out < 0.7
    assert any("of the motions of sensor 'right' in curves that were left out" in text
               for text in warn_of_choice([found], bands))  # fmt: skip


def test_the_papers_forms_have_no_bands_of_sensors():
    assert all(band.sensors == () for band in bands_of(made.backbones(4), form="paper")[1])


# ---- a mode that is left out -----------------------------------------------------------------------


def test_a_mode_that_is_left_out_lies_in_the_band_of_the_others():
    held = [band.mode_left_out for seed in range(3) for band in bands_of(made.backbones(seed))[1]]
    assert np.mean(held) > 0.92
    assert bands_of(one_mode(0))[1][0].mode_left_out is None


def test_a_larger_error_of_the_structure_than_stated_is_told():
    """Curves that are left out do not show it, for the offsets of the others grow by it; a whole mode does."""
    found, bands = bands_of(made.backbones(1, linear_error=0.03))
    assert bands[1].left_out > 0.9
    assert bands[1].mode_left_out < 0.2
    told = list(warn_of_choice([found], bands))
    assert any("or the errors of the linear structure or of the curves are larger than stated" in text for text in told)
    right, bands = bands_of(made.backbones(1, linear_error=0.03), noise=NoiseSettings(linear_error=0.03))
    assert bands[1].mode_left_out > 0.9
    assert not any("the band that the other modes give" in text for text in warn_of_choice([right], bands))


def test_a_wrong_law_is_told():
    system = reduce(wing_engine_structure(), UPDATED)
    quadratic, cubic, *_ = PAPER_CLASSES
    measured = synthetic_backbones(system, cubic, (1.58,), rng=np.random.default_rng(0), n_curves=(4, 4))
    found, bands = bands_of(measured, quadratic, system=system)
    assert min(band.mode_left_out for band in bands) < 0.5
    assert any("the law is wrong, or the errors" in text for text in warn_of_choice([found], bands))
    assert min(band.mode_left_out for band in bands_of(measured, cubic, system=system)[1]) > 0.9


# ---- modes without curves --------------------------------------------------------------------------


def predict_third(seed, linear_error=0.004, **settings):
    """The band of the third mode from curves of the second, and its true backbone in a structure with errors."""
    rng = np.random.default_rng(100 + seed)
    data, found = update(one_mode(seed))
    wanted = PredictionSettings(**({"modes": (3,), "sensor": "left", "amplitude_m": (2e-4, 1.5e-3)} | settings))
    theta = found.samples[rng.integers(len(found.samples), size=400)]
    bands, told = predict_unmeasured(data, made.CUBIC, theta, wanted, one_mode(seed), rng=rng)
    eigenvalue = made.system().eigenvalue * (1 + linear_error * rng.standard_normal(5)) ** 2
    law = made.CUBIC.law("left", [made.TRUTH])
    true = replace(made.system(), eigenvalue=eigenvalue)
    return bands[0], told, backbone(true, law, mode=3, sensor=bands[0].sensor, amplitude=bands[0].amplitude)


def test_bands_of_a_mode_without_curves_hold_its_true_backbone_at_the_stated_rate():
    inside, wide = [], []
    for seed in range(N_SETS):
        band, _, true = predict_third(seed)
        assert not band.is_measured
        assert np.isnan(band.coverage)
        inside.append(np.mean((band.low_hz < true.frequency_hz) & (true.frequency_hz < band.high_hz)))
        wide.append(np.mean((band.high_hz - band.low_hz) / band.frequency_hz))
        for own in band.sensors:
            motion = true.shapes[:, made.SENSORS.index(own.sensor)]
            assert ((own.low < motion) & (motion < own.high)).all()
    assert np.mean(inside) >= (N_SETS - 2) / N_SETS
    # 1.96 of 0.4 % to either side are the error of the linear structure alone
    assert 0.0145 < np.mean(wide) < 0.02


def test_a_larger_error_than_stated_leaves_the_band():
    inside = []
    for seed in range(6):
        band, _, true = predict_third(seed, linear_error=0.03)
        inside.append(np.mean((band.low_hz < true.frequency_hz) & (true.frequency_hz < band.high_hz)))
    assert np.mean(inside) < 0.7


def test_amplitudes_that_are_left_out_reach_as_far_as_the_tests_and_farther_ones_are_told():
    band, told, _ = predict_third(0, amplitude_m=None)
    assert told == []
    assert band.amplitude[0] == pytest.approx(0.05 * band.amplitude[-1])
    extended = [
        made.system().extension_over(mode, "left") * amplitude
        for mode, amplitude in ((3, band.amplitude[-1]), (2, max(one.controlled_amplitude[-1] for one in one_mode(0))))
    ]
    assert extended[0] <= extended[1] * (1 + 1e-12)
    _, (sentence,), _ = predict_third(0, amplitude_m=(1e-3, 8e-3))
    assert "mode 3: a joint extends by up to" in sentence
    assert "the law is extrapolated beyond that" in sentence


def test_where_the_model_does_not_converge_there_is_no_band_and_a_sentence(monkeypatch):
    made_solver = unmeasured_modes.make_solver

    def failing(*args):
        def solve(theta):
            found = made_solver(*args)(theta)
            lost = np.broadcast_to(found.amplitude > 1e-3, found.converged.shape)
            return replace(
                found,
                eigenvalue=np.where(lost, np.nan, found.eigenvalue),
                shapes=np.where(lost[..., None], np.nan, found.shapes),
            )

        return solve

    monkeypatch.setattr(unmeasured_modes, "make_solver", failing)
    band, _, _ = predict_third(0)
    gone = band.amplitude > 1e-3
    for end in (band.frequency_hz, band.sensors[0].low):
        assert np.array_equal(np.isnan(end), gone)
    (sentence,) = warn_of_choice([update(one_mode(0))[1]], [band])
    assert "mode 3: there is no band at" in sentence
    assert "predict smaller amplitudes" in sentence


def study(**settings):
    given = {
        "title": "two arms", "structure": made.structure(), "backbones": one_mode(1), "classes": (made.CUBIC,),
        "parameters": {"plate": Prior("uniform", 0.3, 3.0)}, "harmonics": (1,), "n_samples": 1000, "n_internal": 0,
        "prediction": PredictionSettings(modes=(3,)),
    }  # fmt: skip
    return UpdatingStudy(**(given | settings))


def test_the_factors_of_the_structure_widen_the_band_of_a_mode_without_curves():
    """The plate is updated by the second mode; the third one depends on it, too."""
    found = update_study(study())
    measured, third = found.prediction
    assert [measured.is_measured, third.is_measured] == [True, False]
    alone = update_study(study(structure=made.system(), parameters={})).prediction[1]
    width = [float(np.mean((band.high_hz - band.low_hz) / band.frequency_hz)) for band in (third, alone)]
    assert width[0] > 1.02 * width[1]
    true = made.system().frequency_hz[2]
    assert third.low_hz[0] < true < third.high_hz[0]


@pytest.mark.parametrize(
    ("wrong", "match"),
    [
        ({"modes": (2,)}, "mode 2 is to be predicted and has backbones, leave it out"),
        ({"modes": (3,), "sensor": "lefd"}, "at 'lefd', which is no sensor: .*'left'"),
        ({"modes": (17,)}, "mode 17 is to be predicted, and the structure has 5 modes"),
        ({"modes": (1,), "sensor": "twist"}, "mode 1 "),
    ],
)
def test_modes_that_cannot_be_predicted_are_refused(wrong, match):
    with pytest.raises(InputError, match=match):
        study(structure=made.system(), parameters={}, prediction=PredictionSettings(**wrong))


def test_wrong_settings_are_refused():
    with pytest.raises(InputError, match="give each once, counted from 1"):
        PredictionSettings(modes=(3, 3))
    with pytest.raises(InputError, match="give each once, counted from 1"):
        PredictionSettings(modes=(0,))
    for ends in ((1e-3, 1e-4), (0.0, 1e-3)):
        with pytest.raises(InputError, match="give a smallest and a largest amplitude"):
            PredictionSettings(amplitude_m=ends)
    with pytest.raises(InputError, match="take the recommended form"):
        study(form="independent")
    with pytest.raises(InputError, match="mode 17 is to be predicted, and the structure has 7 modes"):
        update_study(study(prediction=PredictionSettings(modes=(17,))))
