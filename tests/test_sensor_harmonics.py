"""Higher harmonics of the sensors along backbones: read and written, modelled, compared with the best class."""

from dataclasses import replace
from functools import cache

import made_backbones as made
import numpy as np
import pytest
from jointed_systems import CUBIC, EVEN, two_pylons
from made_chain import DOFS, curve_of
from scipy.integrate import solve_ivp
from shooting import shoot

from opid.errors import InputError
from opid.mechanics.backbones.dissipation import PlacedTerm, find_higher_harmonics
from opid.mechanics.backbones.family import backbone, family_evaluator
from opid.mechanics.backbones.quadrature_curves import Specimen, quadrature_curve
from opid.mechanics.laws.law import Law
from opid.studies.study_file import read_study, write_study
from opid.updating.harmonics import predict_harmonics, warn_of_harmonics
from opid.updating.identification import update_study
from opid.updating.likelihood.backbones import backbone_data, find_met_modes
from opid.updating.likelihood.noise import NoiseSettings
from opid.updating.measured import SensorHarmonic, read_backbone, write_backbone
from opid.updating.model_class import ModelClass, Prior, UncertainTerm
from opid.updating.posterior import update_class
from opid.updating.structure.reduction import reduce
from opid.updating.study import UpdatingStudy
from opid.virtual.backbone_tests.measured import convert_curve, synthetic_backbones
from opid.virtual.backbone_tests.wing_engine import UPDATED, wing_engine_structure

SYSTEM = two_pylons(0.05)  # three times the frequency of mode 3 meets mode 9
MET = 8


# ---- files -----------------------------------------------------------------------------------------


def with_harmonics(curve, *columns):
    """The curve with harmonics of a given size over the first one of their sensor."""
    return replace(
        curve,
        harmonics=tuple(
            SensorHarmonic(sensor, order, size * curve.amplitude[:, curve.sensors.index(sensor)])
            for sensor, order, size in columns
        ),
    )


def read_text(tmp_path, text, **settings):
    path = tmp_path / "curve.csv"
    path.write_text(text, encoding="utf-8")
    return read_backbone(path, mode=1, controlled_sensor="tip", **settings)


def test_harmonics_are_read_back_to_the_last_bit(tmp_path):
    curve = with_harmonics(curve_of(2), ("tip", 3, 0.01), ("a", 3, -0.02), ("tip", 5, 1e-3), ("b", 2, 1e-4))
    write_backbone(curve, tmp_path / "second.csv")
    for sensors in (DOFS, None):
        back = read_backbone(tmp_path / "second.csv", mode=2, controlled_sensor="tip", sensors=sensors)
        assert [(each.sensor, each.order) for each in back.harmonics] == [("tip", 3), ("a", 3), ("tip", 5), ("b", 2)]
        for one, other in zip(back.harmonics, curve.harmonics, strict=True):
            np.testing.assert_array_equal(one.amplitude, other.amplitude)


ROWS = "10,1,{0}\n11,2,{1}\n12,3,{2}\n"


@pytest.mark.parametrize(
    ("header", "value", "expected_m"),
    [
        ("tip [mm],tip_h3 [mm]", 0.1, 1e-4),
        ("tip [mm],tip_h3", 0.1, 1e-4),  # the unit of the first harmonic
        ("tip [mm],tip_h3 [µm]", 100, 1e-4),
        ("tip [mm],tip_h3 [m/s^2]", 9.0, 9.0 / (2 * np.pi * 30) ** 2),
        # A motion x = cos wt + a cos 2wt has an acceleration whose fundamental is largest half a period later.
        ("tip [mm],tip_h2 [m/s^2]", 4.0, -4.0 / (2 * np.pi * 20) ** 2),
        ("tip [mm],tip_h3 [m/s]", 0.03, -0.03 / (2 * np.pi * 30)),
        ("tip [mm],tip_h5 [m/s]", 0.03, 0.03 / (2 * np.pi * 50)),
    ],
)
def test_any_unit_becomes_the_displacement_of_that_harmonic(tmp_path, header, value, expected_m):
    found = read_text(tmp_path, f"f,{header}\n{ROWS.format(*[value] * 3)}")
    assert found.harmonics[0].amplitude[0] == pytest.approx(expected_m, rel=1e-12)


@pytest.mark.parametrize("derivative", [1, 2])
@pytest.mark.parametrize("order", [2, 3, 4, 5])
def test_the_sign_is_that_of_the_displacement(tmp_path, derivative, order):
    """A motion is differentiated in time, and its harmonics are read as an analyser would give them."""
    if derivative == 1 and order % 2 == 0:
        with pytest.raises(InputError, match=f"harmonic {order} of 'tip' is that of a velocity"):
            read_text(tmp_path, f"f,tip [m/s],tip_h{order} [m/s]\n{ROWS.format(0.1, 0.2, 0.3)}")
        return
    omega, share = 2 * np.pi * 10.0, 0.1
    # x = A (cos wt + share cos hwt), its derivative as complex amplitudes
    first, higher = (1j * omega) ** derivative, share * (1j * order * omega) ** derivative
    own = (higher * np.exp(-1j * order * np.angle(first))).real
    unit = {1: "m/s", 2: "m/s^2"}[derivative]
    rows = "".join(f"10,{float(1e-3 * k * abs(first))!r},{float(1e-3 * k * own)!r}\n" for k in (1, 2, 3))
    found = read_text(tmp_path, f"f,tip [{unit}],tip_h{order} [{unit}]\n{rows}")
    np.testing.assert_allclose(found.amplitude[:, 0], [1e-3, 2e-3, 3e-3])
    np.testing.assert_allclose(found.harmonics[0].amplitude, [1e-4, 2e-4, 3e-4])


def test_where_the_controlled_sensor_has_a_minus_odd_harmonics_turn(tmp_path):
    text = "f,tip [mm],tip_h3 [mm],tip_h2 [mm]\n10,-1,0.1,0.2\n11,-2,0.1,0.2\n12,-3,0.1,0.2\n"
    third, second = read_text(tmp_path, text).harmonics
    np.testing.assert_allclose(third.amplitude, -1e-4)
    np.testing.assert_allclose(second.amplitude, 2e-4)


def test_a_sensor_may_be_called_like_a_harmonic_if_the_structure_has_it(tmp_path):
    text = f"f,tip [mm],tip_h3 [mm]\n{ROWS.format(0.1, 0.2, 0.3)}"
    found = read_text(tmp_path, text, sensors=("tip", "tip_h3"))
    assert found.sensors == ("tip", "tip_h3")
    assert found.harmonics == ()
    with pytest.raises(InputError, match="'tip_h3' cannot be the name of a column"):
        write_backbone(found, tmp_path / "again.csv")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("f,tip [mm],b_h3 [mm]\n{}", "harmonic 3 of 'b' in backbone 'curve' belongs to no sensor with a first"),
        ("f,tip [mm],tip_h3 [m]\n{}", "is 0.1 m at point 1, where no first harmonic is more than 0.001 m: correct its"),
        ("f,tip [mm],tip_h3 [mm],tip_h3 [mm]\n10,1,1,1\n11,2,1,1\n12,3,1,1\n", "is given twice"),
        ("f,tip [mm],tip_h3 [mm]\n10,1,0.1\n11,2,\n12,3,0.3\n", "not finite: leave its column or these points out"),
        ("f,tip [mm],tip_h3 [kg]\n{}", "give a unit of motion"),
    ],
)
def test_a_column_that_is_no_harmonic_is_refused(tmp_path, text, words):
    with pytest.raises(InputError) as caught:
        read_text(tmp_path, text.format(ROWS.format(0.1, 0.2, 0.3)))
    assert words in str(caught.value)
    assert "curve.csv" in str(caught.value)


@pytest.mark.parametrize(
    ("harmonic", "words"),
    [((3, [0.1] * 2), "has the shape .* for 6 points"), ((1, [0.1] * 6), "is no higher one: give a whole number")],
)
def test_a_harmonic_of_another_length_or_number_is_refused(harmonic, words):
    with pytest.raises(InputError, match=words):
        replace(curve_of(), harmonics=(SensorHarmonic("tip", *harmonic),))


# ---- the model -------------------------------------------------------------------------------------


def higher_at_sensors(system, found, law, orders, *, at=None, damping=0.0):
    everywhere = np.ones(len(system.joints), dtype=bool)
    coordinates = find_higher_harmonics(
        found, [PlacedTerm(term.name, np.array([term.values]), everywhere) for term in law.terms], orders,
        at=found.eigenvalue[0] if at is None else at, eigenvalue=system.eigenvalue[None],
        at_joints=system.at_joints[None], damping_ratio=np.array([damping]),
    )  # fmt: skip
    return coordinates[0] @ system.at_sensors.T


def integrate(law, orbit):
    """Return the harmonics of all sensors, (n_sensors, 65), of a periodic motion, integrated once more in time."""
    n, period = SYSTEM.n_modes, 1 / orbit.frequency_hz

    def rate(_, state):
        pushed = SYSTEM.at_joints.T @ law.force(SYSTEM.at_joints @ state[:n], 0.0)
        return np.concatenate([state[n:], -SYSTEM.eigenvalue * state[:n] - pushed])

    start, times = np.concatenate([orbit.displacement, np.zeros(n)]), period * np.arange(128) / 128
    states = solve_ivp(rate, (0, period), start, "DOP853", times, rtol=1e-11, atol=1e-14).y[:n]
    return np.fft.rfft(SYSTEM.at_sensors @ states, axis=1).real / 64


@pytest.mark.parametrize(
    ("law", "used", "errors"),
    [
        (CUBIC, (1, 3), {3: 3e-3, 5: 0.03}),
        (Law((*CUBIC.terms, *EVEN.terms)), (0, 1, 2, 3), {2: 1e-6, 3: 1e-4, 4: 2e-3}),
    ],
)
@pytest.mark.parametrize("point", [0, 1])
def test_harmonics_are_those_of_the_motion_in_time(law, used, errors, point):
    """The motion in time is found by shooting; a harmonic that the backbone does not have has a larger error."""
    given = {"mode": 4, "sensor": "tip 3", "amplitude": [2e-4, 1.2e-3] if 0 not in used else [2e-4, 5e-4]}
    orbit = shoot(SYSTEM, law, backbone(SYSTEM, law, **given, harmonics=range(10)), point=point)
    true = integrate(law, orbit)
    values = [[value for term in law.terms for value in term.values]]
    found = family_evaluator(SYSTEM, tuple(term.name for term in law.terms), **given, harmonics=used)(values)
    for each, (order, error) in zip(
        higher_at_sensors(SYSTEM, found, law, tuple(errors))[point], errors.items(), strict=True
    ):
        np.testing.assert_allclose(each, true[:, order], atol=error * np.abs(true[:, order]).max())


def test_with_one_harmonic_of_the_backbone_the_third_is_a_perturbation():
    given = {"mode": 4, "sensor": "tip 3", "amplitude": [5e-4]}
    one, both = (
        family_evaluator(SYSTEM, ("cubic_stiffness",), **given, harmonics=used)([[6e7]]) for used in ((1,), (1, 3))
    )
    exact = higher_at_sensors(SYSTEM, both, CUBIC, (3,))[0, 0]
    np.testing.assert_allclose(
        higher_at_sensors(SYSTEM, one, CUBIC, (3,))[0, 0], exact, atol=0.02 * np.abs(exact).max()
    )


@pytest.mark.parametrize(("damping", "largest_error"), [(3e-4, 0.005), (3e-3, 0.35)])
def test_where_a_mode_is_met_the_harmonics_are_those_of_a_test_with_one_force(damping, largest_error):
    """The smooth backbone without the mode that is met, and the linear answer of this mode at the test's frequency.

    What one force makes of the structure beside the backbone grows with the square of the damping.
    """
    amplitude = np.linspace(2e-4, 1.1e-3, 6)
    curve = quadrature_curve(
        Specimen(SYSTEM, CUBIC, damping, "plate 2"), mode=3, sensor="tip 1", controlled_sensor="tip 1",
        amplitude=amplitude, harmonics=(1, 3),
    )  # fmt: skip
    assert curve.converged.all()
    measured = convert_curve(curve, "plate 2", (3,))
    data = backbone_data(SYSTEM, [measured])
    met = find_met_modes(data, data.modes[0])
    assert list(met.columns) == [MET]
    smooth = met.remove_from(SYSTEM)
    found = family_evaluator(
        smooth, ("cubic_stiffness",), mode=3, sensor="tip 1", amplitude=amplitude, harmonics=(1, 3)
    )([[6e7]])
    third = higher_at_sensors(SYSTEM, found, CUBIC, (3,), at=measured.eigenvalue, damping=damping)[:, 0]
    seen = np.array([each.amplitude for each in measured.harmonics]).T
    error = np.abs(third - seen).max(axis=1) / np.abs(seen).max(axis=1)
    assert error.max() < largest_error
    assert abs(3 * measured.frequency_hz[-1] / SYSTEM.frequency_hz[MET] - 1) < 0.002
    without = higher_at_sensors(smooth, found, CUBIC, (3,), damping=damping)[:, 0]
    assert np.abs(without - seen)[-1].max() > 0.9 * np.abs(seen[-1]).max(), "it is the mode that is met that answers"


# ---- bands and contradictions ----------------------------------------------------------------------


QUINTIC = ModelClass("quintic", (UncertainTerm("quintic_stiffness", (8e12,), (Prior("uniform", 0.0, 100.0),)),))


@cache
def wing():
    return reduce(wing_engine_structure(), UPDATED)


def wing_curves(seed, *, law=made.CUBIC, recorded=(3,), **errors):
    return synthetic_backbones(
        wing(), law, (1.58,), rng=np.random.default_rng(seed), n_curves=(3, 3), recorded=recorded, **errors
    )


def compare(system, curves, law=made.CUBIC, **settings):
    """Return bands and warnings of a class that was fitted to the curves."""
    data = backbone_data(system, curves, **settings)
    found = update_class(data, law, rng=np.random.default_rng(0), n_samples=1000, evidences=("laplace",))
    bands = predict_harmonics(data, law, found.samples[-400:], curves, rng=np.random.default_rng(1))
    return bands, list(warn_of_harmonics(bands, data))


def change(curves, how):
    """Return the curves with other harmonics, how(harmonic) each."""
    return tuple(
        replace(one, harmonics=tuple(replace(each, amplitude=how(each)) for each in one.harmonics)) for one in curves
    )


def detune(system, mode, fraction):
    eigenvalue = system.eigenvalue.copy()
    eigenvalue[mode - 1] *= (1 + fraction) ** 2
    return replace(system, eigenvalue=eigenvalue)


@pytest.mark.slow
def test_bands_hold_in_repeated_sets():
    """The errors are as large as they are stated, but the shapes have none, so that bands are rather too wide."""
    stated = {"linear_error": 0.004, "harmonic_error": 0.02, "harmonic_noise": 1e-4}
    shares = []
    for seed in range(6):
        bands, warnings = compare(wing(), wing_curves(seed, **stated))
        assert warnings == []
        shares.append(np.mean([band.coverage for band in bands]))
    assert min(shares) > 0.85
    assert np.mean(shares) > 0.93


@pytest.mark.slow
def test_bands_without_an_error_of_the_shapes_are_as_wide_as_they_should_be():
    stated = {"linear_error": 0.004, "harmonic_error": 0.02, "harmonic_noise": 1e-4}
    exact = NoiseSettings(linear_shape_error=1e-6)
    shares = [
        np.mean([band.coverage for band in compare(wing(), wing_curves(seed, **stated), noise=exact)[0]])
        for seed in range(6)
    ]
    assert 0.85 < np.mean(shares) < 0.99, shares


def test_the_band_opens_where_a_mode_is_met():
    bands, _ = compare(wing(), wing_curves(0))
    for sensor, mode, met in (("1", 8, 13), ("10", 7, None)):
        (own,) = (band for band in bands if (band.sensor, band.mode) == (sensor, mode))
        assert own.met_mode == met
        width = (own.high - own.low) / np.abs(own.predicted)
        if met:
            assert width[-3:].min() > 0.4  # 0.5 % from mode 13
        else:
            assert width[-3:].max() < 0.25


@pytest.mark.parametrize("fraction", [-0.05, 0.05])
def test_a_mode_that_is_met_elsewhere_is_told(fraction):
    _, (warning,) = compare(detune(wing(), 13, fraction), wing_curves(0))
    hz = wing().frequency_hz[12] * (1 + fraction)
    assert warning.startswith("mode 8: harmonic 3 of sensor ")
    assert f"mode 13, which it nears, is not at {hz:.4g} Hz as in the structure" in warning


def test_the_sign_of_a_sensor_is_told():
    curves = change(wing_curves(0), lambda each: each.amplitude * (-1 if each.sensor == "13" else 1))
    _, warnings = compare(wing(), curves)
    assert len(warnings) == 2
    for warning, mode in zip(warnings, (7, 8), strict=True):
        assert warning.startswith(f"mode {mode}: harmonic 3 of sensor '13' lies far from what the class predicts at ")
        assert warning.endswith(
            "points: it has the opposite sign: turn that of its column, or that of its first harmonic"
        )


@pytest.mark.parametrize(
    ("factor", "words"),
    [(1e-3, "are a thousandth of that: correct the unit"), (9.0, "are 9 times as large: divide accelerations by")],
)
def test_a_wrong_unit_is_told(factor, words):
    _, warnings = compare(wing(), change(wing_curves(0), lambda each: factor * each.amplitude))
    assert len(warnings) == 2
    assert all(words in warning for warning in warnings)


def test_millimetres_called_metres_are_refused():
    with pytest.raises(InputError, match=r"where no first harmonic is more than .*: correct its unit"):
        change(wing_curves(0), lambda each: 1e3 * each.amplitude)


@pytest.mark.parametrize(("true", "tried"), [(QUINTIC, made.CUBIC), (made.CUBIC, QUINTIC)])
def test_another_law_is_told(true, tried):
    _, warnings = compare(wing(), wing_curves(0, law=true), tried)
    assert warnings
    assert all("the joints have another law than the class" in warning for warning in warnings)


def test_an_even_harmonic_of_an_odd_law_is_told_where_it_is_no_noise():
    curves = tuple(
        replace(one, harmonics=(SensorHarmonic("10", 2, size * one.amplitude[:, 9]),))
        for size, one in zip([2e-5] * 6, wing_curves(0, recorded=()), strict=True)
    )
    bands, warnings = compare(wing(), curves)
    assert warnings == []
    assert [band.coverage for band in bands] == [1.0, 1.0]
    _, warnings = compare(wing(), change(curves, lambda each: 100 * each.amplitude))
    assert len(warnings) == 2
    assert all("the class makes none that could be told from noise" in warning for warning in warnings)


def test_a_test_with_one_force_on_a_damped_structure_is_not_told():
    """Its third harmonic goes through the resonance of mode 9, in phase and out of it."""
    specimen = Specimen(SYSTEM, CUBIC, 0.003, "plate 2")
    curves = [
        convert_curve(
            quadrature_curve(specimen, mode=3, sensor=sensor, controlled_sensor="tip 1",
                             amplitude=np.linspace(2e-4, 2.5e-3, 30), harmonics=(1, 3)),
            "plate 2", (3,),
        )
        for sensor in ("tip 1", "tip 3", "plate 2")
    ]  # fmt: skip
    law = ModelClass("cubic", (UncertainTerm("cubic_stiffness", (6e7,), (Prior("uniform", 0.0, 3.0),)),))
    bands, warnings = compare(SYSTEM, curves, law)
    assert warnings == []
    assert min(band.coverage for band in bands) > 0.9
    _, warnings = compare(detune(SYSTEM, MET + 1, 0.05), curves, law)
    assert len(warnings) == 1
    assert "mode 9, which it nears, is not at" in warnings[0]


def test_points_that_are_kept_in_an_interaction_have_bands_with_its_damping():
    curves = wing_curves(0)
    data = replace(backbone_data(wing(), curves), met_damping=0.003)
    theta = np.random.default_rng(0).normal(1.58, 0.003, (400, 1))
    kept, damped = (
        predict_harmonics(each, made.CUBIC, theta, curves, rng=np.random.default_rng(1))
        for each in (data, replace(data, met_damping=0.05))
    )
    assert np.mean([band.coverage for band in kept]) > 0.95
    last = [
        abs(band.predicted[-1]) for bands in (kept, damped) for band in bands if (band.mode, band.sensor) == (8, "1")
    ]
    assert last[1] < 0.3 * last[0], "mode 13, which is met there, hardly answers"


def test_where_the_model_has_no_curve_there_is_no_band():
    curves = wing_curves(0)
    theta = np.tile([[1.58], [np.nan], [np.nan]], (100, 1))
    bands = predict_harmonics(backbone_data(wing(), curves), made.CUBIC, theta, curves, rng=np.random.default_rng(1))
    assert np.isnan([band.low for band in bands if band.mode == 7]).all()
    assert np.isnan([band.coverage for band in bands]).all()
    assert list(warn_of_harmonics(bands, backbone_data(wing(), curves))) == []


def test_joints_that_slip_have_bands():
    slip = ModelClass("slip", (UncertainTerm("dahl_friction", (1.0, 1e-3), (Prior("uniform", 0.0, 10.0),) * 2),))
    curves = synthetic_backbones(
        made.system(), slip, (1.0, 1.0), rng=np.random.default_rng(0), modes=made.MODES, n_curves=(2, 2),
        amplitude_m=made.AMPLITUDE_M, controlled_sensor="left", recorded=(3,),
    )  # fmt: skip
    bands, warnings = compare(made.system(), curves, slip)
    assert warnings == []
    assert np.mean([band.coverage for band in bands]) > 0.93


# ---- virtual tests ---------------------------------------------------------------------------------


def test_recorded_harmonics_change_nothing_else():
    plain, recorded = wing_curves(3, recorded=()), wing_curves(3, recorded=(3, 5))
    for one, other in zip(plain, recorded, strict=True):
        assert one.harmonics == ()
        assert len(other.harmonics) == 2 * 14
        np.testing.assert_array_equal(one.frequency_hz, other.frequency_hz)
        np.testing.assert_array_equal(one.amplitude, other.amplitude)


def test_a_harmonic_that_a_curve_does_not_have_is_refused():
    curve = quadrature_curve(
        Specimen(SYSTEM, CUBIC, 0.003, "plate 2"), mode=3, sensor="tip 1", controlled_sensor="tip 1",
        amplitude=[2e-4, 3e-4, 4e-4], harmonics=(1, 3),
    )  # fmt: skip
    with pytest.raises(InputError, match="harmonic 5 is to be recorded: give numbers from 2 to 3"):
        convert_curve(curve, "plate 2", (5,))


# ---- a whole study ---------------------------------------------------------------------------------


def test_a_study_file_has_harmonics_and_their_errors(tmp_path):
    curves = wing_curves(1)
    noise = NoiseSettings(harmonic_error=0.01, harmonic_noise=2e-4)
    study = UpdatingStudy(
        "harmonics", wing_engine_structure(), curves, (made.CUBIC,), noise=noise,
        parameters=dict.fromkeys(UPDATED, Prior("uniform", 0.05, 5.0)),
    )  # fmt: skip
    write_study(study, tmp_path / "study.toml")
    again = read_study(tmp_path / "study.toml")
    assert (again.noise.harmonic_error, again.noise.harmonic_noise) == (0.01, 2e-4)
    for one, other in zip(again.backbones, curves, strict=True):
        assert [(each.sensor, each.order) for each in one.harmonics] == [(name, 3) for name in wing().sensors]
        np.testing.assert_array_equal(one.harmonics[4].amplitude, other.harmonics[4].amplitude)


@pytest.mark.slow
def test_a_study_compares_harmonics_and_changes_nothing_else():
    """Both phases: the factors of phase I move the modes that answer."""
    curves = synthetic_backbones(
        made.system(), made.CUBIC, (made.TRUTH,), rng=np.random.default_rng(2), modes=made.MODES, n_curves=(3, 2),
        n_points=12, amplitude_m=made.AMPLITUDE_M, controlled_sensor="left", recorded=(3,),
    )  # fmt: skip
    study = UpdatingStudy(
        "two arms", made.structure(), curves, (made.CUBIC,), n_samples=1000, n_internal=0,
        parameters={"leaves": Prior("uniform", 0.3, 3.0)},
    )  # fmt: skip
    found = update_study(study)
    plain = update_study(replace(study, backbones=tuple(replace(one, harmonics=()) for one in curves)))
    np.testing.assert_array_equal(found.classes[0].samples, plain.classes[0].samples)
    np.testing.assert_array_equal(found.prediction[0].high_hz, plain.prediction[0].high_hz)
    assert found.warnings == plain.warnings
    assert plain.harmonics == ()
    assert len(found.harmonics) == 2 * len(made.SENSORS)
    assert min(found.harmonics_within.values()) > 0.9
    turned = update_study(
        replace(study, backbones=change(curves, lambda each: each.amplitude * (-1 if each.sensor == "right" else 1)))
    )
    told = [warning for warning in turned.warnings if "harmonic 3 of sensor 'right'" in warning]
    assert len(told) == 2
    assert all("it has the opposite sign" in warning for warning in told)
