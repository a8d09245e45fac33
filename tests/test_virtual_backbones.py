"""Virtual measurements of backbones and synthetic sets with stated errors."""

import numpy as np
import pytest

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.backbones.family import backbone
from opid.mechanics.backbones.specimen import Specimen
from opid.mechanics.laws.law import law
from opid.updating.model_class import ModelClass, Prior, UncertainTerm
from opid.updating.structure.reduction import reduce
from opid.virtual.backbone_tests.control_based_continuation import ContinuationSettings, ReadingNoise
from opid.virtual.backbone_tests.measured import AMPLITUDE_M, synthetic_backbones, virtual_backbones
from opid.virtual.backbone_tests.wing_engine import UPDATED, wing_engine_structure

CLASS_2 = ModelClass("class 2", (UncertainTerm("cubic_stiffness", (6.8e7,), (Prior("uniform", 0, 10),)),))
CUBIC = law("cubic_stiffness", stiffness_n_per_m3=1.58 * 6.8e7)
NONE = {"offset_fraction": 0.0, "point_noise": 0.0, "shape_noise": 0.0, "linear_error": 0.0}


@pytest.fixture(scope="module")
def system():
    return reduce(wing_engine_structure(), UPDATED)


def synthetic(system, seed=0, **change):
    return synthetic_backbones(system, CLASS_2, [1.58], rng=np.random.default_rng(seed), **change)


def true_of(system, curve):
    return backbone(
        system,
        CUBIC,
        mode=curve.mode,
        sensor=curve.controlled_sensor,
        amplitude=curve.controlled_amplitude,
        harmonics=(1, 3, 5, 7),
    )


def test_without_errors_a_set_is_harmonic_balance(system):
    curves = synthetic(system, **NONE)
    assert [curve.mode for curve in curves] == [7] * 14 + [8] * 5
    for curve in (curves[0], curves[-1]):
        true = true_of(system, curve)
        np.testing.assert_allclose(curve.frequency_hz, true.frequency_hz, rtol=2e-7)
        np.testing.assert_allclose(curve.amplitude, true.shapes, atol=1e-9)
    for curve, (least, most) in zip((curves[0], curves[-1]), AMPLITUDE_M, strict=True):
        held = curve.controlled_amplitude
        assert least * (1 - 1e-9) <= held[0] < held[-1] <= most * (1 + 1e-9)
        assert held.size == 20


def test_a_set_is_its_seed(system):
    one, again, other = synthetic(system, 3), synthetic(system, 3), synthetic(system, 4)
    assert all(np.array_equal(a.frequency_hz, b.frequency_hz) for a, b in zip(one, again, strict=True))
    assert not np.array_equal(one[0].frequency_hz, other[0].frequency_hz)


def test_every_level_is_what_it_says(system):
    asked = {"modes": (7,), "n_curves": (150,), "amplitude_m": AMPLITUDE_M[:1]}

    def off(curves):
        clean = synthetic(system, **asked, **NONE, amplitude_jitter=0.0)[0].frequency_hz
        return np.array([curve.frequency_hz for curve in curves]) / clean - 1.0

    points = off(synthetic(system, **asked, **(NONE | {"point_noise": 1e-3}), amplitude_jitter=0.0))
    assert points.std() == pytest.approx(1e-3, rel=0.06)
    offsets = off(synthetic(system, **asked, **(NONE | {"offset_fraction": 1e-3}), amplitude_jitter=0.0))
    assert offsets[:, 0].std() == pytest.approx(1e-3, rel=0.25)
    assert np.ptp(offsets, axis=1).max() < 1e-12, "common to all points of a curve"
    noisy = synthetic(system, **asked, **(NONE | {"shape_noise": 0.02}), amplitude_jitter=0.0)
    clean = synthetic(system, **asked, **NONE, amplitude_jitter=0.0)[0].amplitude
    errors = np.array([curve.amplitude for curve in noisy]) - clean
    assert not errors[:, :, 9].any(), "the amplitude of the controlled sensor is prescribed"
    fraction = np.delete(errors, 9, axis=2) / np.linalg.norm(clean, axis=1)[:, None]
    assert fraction.std() == pytest.approx(0.02, rel=0.02)


def test_the_linear_error_is_common_to_a_mode_and_fades_with_the_nonlinearity(system):
    fraction = []
    for seed in range(20):
        curves = synthetic(
            system, seed, **(NONE | {"linear_error": 0.004}), n_curves=(2, 1), n_points=5, amplitude_jitter=0.0
        )
        first, second, other = (curve.frequency_hz / true_of(system, curve).frequency_hz - 1.0 for curve in curves)
        np.testing.assert_allclose(first, second, atol=1e-12)
        assert abs(first[-1]) < abs(first[0])
        fraction.append((first[0], other[0]))
    fraction = np.array(fraction)
    np.testing.assert_allclose(fraction.std(axis=0), 0.004, rtol=0.5)
    assert abs(np.corrcoef(fraction.T)[0, 1]) < 0.7


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"n_curves": (14,)}, "n_curves"),
        ({"n_points": 2}, "n_points"),
        ({"amplitude_m": ((4e-3, 2e-4), (2e-4, 2e-3))}, "smallest and a largest"),
        ({"amplitude_m": ((2e-4, 4e-3),)}, "for each mode"),
        ({"offset_fraction": -1.0}, "offset_fraction"),
        ({"point_noise": (1e-4, 1e-4, 1e-4)}, "one for each mode"),
        ({"amplitude_jitter": 0.6}, "cross"),
        ({"controlled_sensor": "15"}, "no sensor '15'"),
        ({"modes": (7, 40)}, "no mode 40"),
    ],
)
def test_sets_that_cannot_be(system, change, text):
    with pytest.raises(InputError, match=text):
        synthetic(system, **change)


def test_continuation_gives_data_for_updating(system):
    seen = []
    curves = virtual_backbones(
        Specimen(system, CUBIC, 0.003, "7"),
        rng=np.random.default_rng(1),
        modes=(7,),
        amplitude_m=((5e-4, 1.2e-3),),
        n_points=3,
        sensors=("10", "13"),
        noise=ReadingNoise(5e-3, 5e-3, 1e-2),
        progress=lambda done, of: seen.append((done, of)),
    )
    assert [curve.name for curve in curves] == ["mode 7, quadrature at 10", "mode 7, quadrature at 13"]
    assert seen == [(1, 2), (2, 2)]
    for curve in curves:
        true = true_of(system, curve)
        np.testing.assert_allclose(curve.frequency_hz, true.frequency_hz, rtol=1e-4)
        np.testing.assert_allclose(curve.amplitude[:, 8:], true.shapes[:, 8:], atol=0.02 * 1.2e-3)


def test_no_curve_at_all_is_told(system):
    with pytest.raises(NotDeterminedError, match=r"none of 1 curves reaches quadrature.*'5'") as caught:
        virtual_backbones(
            Specimen(system, CUBIC, 0.003, "7"),
            rng=np.random.default_rng(1),
            modes=(8,),
            amplitude_m=((5e-4, 1e-3),),
            n_points=3,
            sensors=("5",),
            settings=ContinuationSettings(longest_periods=60, most_records=3, record_periods=10),
        )
    assert caught.value.partial[0].sensor == "5"


def test_the_controlled_sensor_and_how_much_of_a_curve_is_enough_are_chosen(system):
    asked = {"modes": (7,), "amplitude_m": ((5e-4, 1.2e-3),), "n_points": 3, "sensors": ("10",)}
    specimen = Specimen(system, CUBIC, 0.003, "7")
    (curve,) = virtual_backbones(specimen, rng=np.random.default_rng(1), controlled_sensor="13", **asked)
    assert curve.controlled_sensor == "13"
    np.testing.assert_allclose(curve.controlled_amplitude[[0, -1]], [5e-4, 1.2e-3], rtol=0.01)
    with pytest.raises(NotDeterminedError, match="none of 1 curves"):
        virtual_backbones(specimen, rng=np.random.default_rng(1), least_fraction=1.1, **asked)
