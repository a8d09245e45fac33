"""What contradicts the other measurements is told, and a sound set tells nothing."""

from dataclasses import replace

import made_backbones as made
import numpy as np
import pytest

from opid.updating.identification import update_study
from opid.updating.likelihood.backbones import backbone_data
from opid.updating.likelihood.contradictions import find_contradictions
from opid.updating.likelihood.interactions import adapt_to_class
from opid.updating.posterior import density_of
from opid.updating.sampling.evidence import maximum_a_posteriori
from opid.updating.study import UpdatingStudy
from opid.updating.warnings import find_unfit_modes
from opid.virtual import synthetic_backbones


def tell(curves, model_class=made.CUBIC, **settings):
    """The sentences on some curves, with the best parameters of a class."""
    data = backbone_data(made.system(), curves, harmonics=(1,), **settings)
    support = [prior.support for prior in model_class.priors]
    best = maximum_a_posteriori(density_of(data, model_class).posterior, [1.5], support=support).theta
    data = adapt_to_class(data, model_class, best)
    unfit = find_unfit_modes(data, model_class, best)
    return [each.sentence for each in find_contradictions(data, model_class, best, curves, unfit=unfit)]


def scaled(curves, factor, chosen=lambda number, one: True):
    """Curves, of which the chosen ones have amplitudes that are `factor` times as large."""
    return tuple(
        replace(one, amplitude=one.amplitude * factor) if chosen(number, one) else one
        for number, one in enumerate(curves)
    )


def with_gain(curves, sensor, gain):
    """Curves of which one sensor reads `gain` times its motion."""
    row = np.where(np.array(made.SENSORS) == sensor, gain, 1.0)
    return tuple(replace(one, amplitude=one.amplitude * row) for one in curves)


def on_days(curves, **second):
    """Every other curve on a second day, with other frequencies or amplitudes."""
    hz, size = second.get("hz", 1.0), second.get("size", 1.0)
    return tuple(
        replace(one, day="2", frequency_hz=one.frequency_hz * hz, amplitude=one.amplitude * size)
        if number % 2
        else replace(one, day="1")
        for number, one in enumerate(curves)
    )


@pytest.mark.parametrize("model_class", [made.CUBIC, made.QUADRATIC], ids=["right law", "wrong law"])
def test_sound_sets_tell_nothing(model_class):
    told = [
        tell(on_days(made.backbones(seed)) if seed % 2 else made.backbones(seed), model_class) for seed in range(20)
    ]
    assert sum(map(bool, told)) <= 1


def test_a_curve_in_another_unit_or_with_another_gain_is_named():
    for seed in range(3):
        (told,) = tell(scaled(made.backbones(seed), 1.4, lambda number, one: number == 2))
        assert "the amplitudes of curve 'mode 2, curve 3' contradict" in told
        # the factor that mends them
        assert float(told.split("multiplied by ")[1].split(":")[0]) == pytest.approx(1 / 1.4, rel=0.15)


@pytest.mark.parametrize("factor", [2.5, 1 / 3, 25.4, 1e-3])
def test_a_curve_in_another_unit_is_named_even_where_it_spoils_the_law(factor):
    for seed in range(3):
        (told,) = tell(scaled(made.backbones(seed), factor, lambda number, one: number == 7))
        assert "curve 'mode 3, curve 2' has grown as far as the other curves" in told
        assert float(told.split(" at ")[1].split(" times")[0]) == pytest.approx(factor, rel=0.3)


def test_curves_of_a_mode_or_a_day_with_other_amplitudes_are_named():
    (told,) = tell(scaled(made.backbones(0), 1.5, lambda number, one: one.mode == 3))
    assert "the curves of mode" in told
    (told,) = tell(on_days(made.backbones(0), size=1.3))
    assert "the curves of day" in told


def test_a_structure_that_is_off_and_a_day_that_is_off_are_named_with_the_size():
    curves = tuple(replace(one, frequency_hz=one.frequency_hz * 1.04) for one in made.backbones(0))
    told = tell(curves)
    assert len(told) == 2
    assert all("above the linear frequency of the structure" in each for each in told)
    assert float(told[0].split("lie ")[1].split(" %")[0]) == pytest.approx(4.0, abs=1.0)
    told = tell(on_days(made.backbones(0, offset_fraction=1e-3), hz=1.02))
    assert all("of the other days, where day_offset allows 0.1 %" in each for each in told)
    assert told


def test_a_sensor_with_another_gain_or_sign_is_named():
    (told,) = tell(with_gain(made.backbones(0), "left", 1.5))
    assert "sensor 'left' reads 1.5 times" in told
    (told,) = tell(with_gain(made.backbones(0), "right", -1.0))
    assert "sensor 'right' reads -1 times" in told


def test_curves_with_one_sensor_and_levels_apart_tell_nothing():
    cut = tuple(
        replace(one, sensors=("left",), amplitude=one.amplitude[:, [3]]) if number in (0, 1, 2, 6, 7) else one
        for number, one in enumerate(made.backbones(0))
    )
    assert tell(cut) == []
    levels = tuple(
        replace(one, frequency_hz=one.frequency_hz[part], amplitude=one.amplitude[part])
        for number, one in enumerate(made.backbones(0))
        for part in [slice(0, 6) if number % 2 else slice(6, 12)]
    )
    assert tell(levels) == []


def test_a_dead_sensor_makes_no_warning_of_numpy():
    curves = tuple(replace(one, amplitude=one.amplitude * [1, 1, 0, 1, 1]) for one in made.backbones(0))
    assert all("seem to be exchanged" not in each for each in tell(curves))


@pytest.mark.parametrize("growth", [0.05, 0.3])
def test_weakly_nonlinear_sets_tell_nothing(growth):
    small = tuple(np.array(ends) * growth for ends in made.AMPLITUDE_M)
    told = []
    for seed in range(10):
        curves = synthetic_backbones(
            made.system(), made.CUBIC, (made.TRUTH,), rng=np.random.default_rng(seed), modes=made.MODES, n_points=12,
            n_curves=(3, 3), amplitude_m=small, controlled_sensor="left", harmonics=(1,), point_noise=5e-4,
        )  # fmt: skip
        told.append(tell(curves))
    assert sum(map(bool, told)) <= 1


def test_exchanged_sensors_are_named():
    names = ("plate", "bend", "twist", "right", "left")
    curves = tuple(replace(one, sensors=names) for one in made.backbones(0, shape_noise=0.0))
    (told,) = tell(curves)
    assert "sensors 'left' and 'right' seem to be exchanged" in told
    swapped = ("bend", "plate", "twist", "left", "right")
    curves = tuple(replace(one, sensors=swapped) for one in made.backbones(0, shape_noise=0.0))
    (told,) = tell(curves)
    assert "sensors 'plate' and 'bend' seem to be exchanged" in told


def test_forms_without_stated_errors_tell_nothing():
    assert tell(with_gain(made.backbones(0), "left", 1.5), form="paper") == []


def test_an_updating_tells_it():
    curves = with_gain(made.backbones(5), "left", 1.5)
    study = UpdatingStudy("two arms", made.system(), curves, (made.CUBIC,), harmonics=(1,), n_samples=1000)
    assert any("sensor 'left' reads 1.5 times" in warning for warning in update_study(study).warnings)
