"""Damping of joints from the force at phase resonance, against the damped, forced structure by harmonic balance."""

import re
from dataclasses import replace

import numpy as np
import pytest
from made_dampers import (
    AMPLITUDE,
    BOTH,
    CONTROLLED,
    CUBIC,
    DRIVE,
    EVERYWHERE,
    FRICTION,
    LINEAR,
    LINEAR_TERM,
    QUADRATIC,
    QUADRATIC_TERM,
    RATIO,
    SPRING,
    curve_of,
    measured,
    study,
    system,
)

from opid.errors import InputError
from opid.mechanics.backbones.dissipation import PlacedTerm, find_loss
from opid.mechanics.backbones.family import family_evaluator
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.studies.study_file import read_study
from opid.studies.updating_study import tabulate_class
from opid.updating.identification import update_study
from opid.updating.likelihood.backbones import backbone_data
from opid.updating.likelihood.curves import likelihood_function, slopes_function
from opid.updating.likelihood.force import force_data
from opid.updating.measured import MeasuredBackbone, read_backbone, write_backbone
from opid.updating.model_class import DampingRatio, ModelClass, Prior


@pytest.mark.parametrize("dampers", [(), BOTH[:1], BOTH[1:], BOTH, FRICTION])
@pytest.mark.parametrize("mode", [1, 2])
def test_the_loss_is_the_work_of_the_force_of_the_damped_structure(mode, dampers):
    true = curve_of(mode, *dampers)
    spring = np.array([[CUBIC]])
    found = family_evaluator(
        system(), ("cubic_stiffness",), mode=mode, sensor=CONTROLLED, amplitude=AMPLITUDE, harmonics=(1, 3)
    )(spring)
    placed = [PlacedTerm(name, np.array([values]), EVERYWHERE) for name, values in dampers]
    lost, energy = find_loss(
        found, system(), [PlacedTerm("cubic_stiffness", spring, EVERYWHERE)], placed, np.array([RATIO])
    )
    np.testing.assert_allclose(lost[0], np.pi * true.force_n * np.abs(true.amplitude[:, 0]), rtol=5e-3)
    if not dampers:
        # A mode that moves alone has its own ratio; those that it drives, at their own frequencies, have others.
        np.testing.assert_allclose(lost[0] / (4 * np.pi * energy[0]), RATIO, rtol=0.2)
        alone = RATIO * np.sqrt(system().eigenvalue[mode - 1] / found.eigenvalue[0, 0])
        assert lost[0, 0] / (4 * np.pi * energy[0, 0]) == pytest.approx(alone, rel=2e-3)


@pytest.mark.parametrize(
    ("kind", "values", "as_linear"),
    [
        ("signed_power_damping", (0.4, 1.0), 1.0),
        ("orifice_damping", (2.0, 3.0), 2.0),  # the mean of 1 and r times a quadratic damper
        ("asymmetric_damping", (0.4,), 0.0),  # what it takes in one direction it gives back in the other
        ("blow_off_damping", (0.4, 2.0), 0.0),  # its valve stays shut
    ],
)
def test_a_damper_that_differs_between_directions_loses_the_energy_of_the_whole_period(kind, values, as_linear):
    found = family_evaluator(
        system(), ("cubic_stiffness",), mode=1, sensor=CONTROLLED, amplitude=AMPLITUDE, harmonics=(1,)
    )(np.array([[CUBIC]]))
    springs = [PlacedTerm("cubic_stiffness", np.array([[CUBIC]]), EVERYWHERE)]
    alone, _ = find_loss(found, system(), springs, [], np.array([RATIO]))
    lost, _ = find_loss(found, system(), springs, [PlacedTerm(kind, np.array([values]), EVERYWHERE)], np.array([RATIO]))
    extension, omega = found.extension[0], np.sqrt(found.eigenvalue[0])
    power = 2 if kind == "orifice_damping" else 1
    factor = np.pi if power == 1 else 8.0 / 3.0
    closed = as_linear * values[0] * factor * omega**power * np.sum(np.abs(extension) ** (power + 1), axis=1)
    np.testing.assert_allclose((lost - alone)[0], closed, rtol=1e-6, atol=1e-9 * alone.max())


def test_a_free_mode_has_no_loss_in_the_mean():
    free = JointedModes(
        np.append(0.0, system().eigenvalue),
        np.column_stack([np.ones(3), system().at_sensors]),
        np.column_stack([np.zeros(2), system().at_joints]),
        system().sensors,
        system().joints,
    )
    losses = []
    for structure, mode in ((system(), 1), (free, 2)):
        given = np.array([[CUBIC, 1e4]])
        found = family_evaluator(
            structure, ("cubic_stiffness", "even_quadratic_stiffness"), mode=mode, sensor=CONTROLLED,
            amplitude=AMPLITUDE, harmonics=(0, 1, 2, 3),
        )(given)  # fmt: skip
        springs = [
            PlacedTerm(name, given[:, [k]], EVERYWHERE)
            for k, name in enumerate(("cubic_stiffness", "even_quadratic_stiffness"))
        ]
        losses.append(find_loss(found, structure, springs, [], np.array([RATIO]))[0])
    assert np.isfinite(losses[1]).all()
    np.testing.assert_allclose(losses[1], losses[0], rtol=1e-9)


@pytest.mark.slow
def test_dampers_are_found_and_chosen():
    held = []
    for seed in range(3):
        found = update_study(study(measured(BOTH, seed)))
        assert found.best_class == "both"
        assert not any("force" in each for each in found.classes[0].warnings)
        for (own, estimate), true in zip(
            found.classes[0].coefficients.items(), (CUBIC, LINEAR, QUADRATIC, RATIO, RATIO), strict=True
        ):
            assert abs(estimate.value / true - 1) < 0.1, own.words
            held.append(estimate.holds(true))
    assert np.mean(held) >= 0.8
    band = found.damping[0]
    within = np.interp(band.measured_amplitude, band.amplitude, band.damping_ratio)
    np.testing.assert_allclose(band.measured, within, rtol=0.06)
    assert band.damping_ratio[-1] > 1.5 * band.damping_ratio[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "damping"),
    [
        ({"factor": 1e3}, None),  # mN taken for N
        ({"factor": 1e-3}, None),
        ({"factor": 2.0}, None),  # peak to peak
        ({"drive": "middle"}, {1: RATIO, 2: RATIO}),
        ({}, {1: RATIO, 2: 2 * RATIO}),
    ],
)
def test_a_force_of_another_size_is_told(change, damping):
    factor, drive = change.get("factor", 1.0), change.get("drive", DRIVE)
    wrong = tuple(replace(each, force_n=factor * each.force_n, drive=drive) for each in measured(BOTH[:1], 0))
    known = {} if damping is None else {"damping": damping}
    linear = ModelClass("linear", (SPRING, LINEAR_TERM))
    found = update_study(study(wrong, classes=(linear,), n_samples=1000, **known))
    words = ("times what the dampers and damping ratios need", "standard deviations out", "presses against")
    assert any(word in each for each in found.all_warnings for word in words)


def test_a_mode_or_a_curve_may_have_no_force():
    def silence(one):
        return replace(one, drive="", force_n=None) if one.mode == 2 or one.name.endswith("0") else one

    linear = ModelClass("linear", (SPRING, LINEAR_TERM))
    some = tuple(silence(each) for each in measured(BOTH[:1], 0))
    found = update_study(study(some, classes=(linear,), damping={1: RATIO}))
    assert found.classes[0].estimates["theta_2"].holds(1.0)
    (band,) = found.damping
    assert (band.mode, band.measured.size) == (1, 2 * AMPLITUDE.size)


@pytest.mark.slow
@pytest.mark.parametrize("n_curves", [1, 3])
def test_dampers_of_another_kind_are_told(n_curves):
    curves = tuple(each for each in measured(FRICTION, 0) if each.name[-1] in "012"[:n_curves])
    found = update_study(study(curves))
    assert any("these dampers do not lose the measured energy" in each for each in found.all_warnings)


@pytest.mark.slow
def test_an_error_that_does_not_grow_with_the_force_is_within_the_interval_if_it_is_stated():
    linear = ModelClass("both", (SPRING, LINEAR_TERM, QUADRATIC_TERM))
    right = measured(BOTH, 0, gain_std=0.0)
    floor = {mode: 0.01 * max(each.force_n.max() for each in right if each.mode == mode) for mode in (1, 2)}
    wrong = tuple(replace(each, force_n=each.force_n + floor[each.mode]) for each in right)
    known = {1: RATIO, 2: RATIO}
    stated = replace(study(wrong).noise, force_floor=0.01)
    found = update_study(study(wrong, classes=(linear,), damping=known, noise=stated, n_samples=4000))
    for name in ("theta_2", "theta_3"):
        estimate = found.classes[0].estimates[name]
        assert abs(estimate.value - 1.0) < 3.0 * estimate.std


def test_a_damping_ratio_that_is_not_known_leaves_a_linear_damper_open():
    wide = dict.fromkeys((1, 2), Prior("uniform", 0.0, 0.05))
    linear = ModelClass("linear", (SPRING, LINEAR_TERM))
    widths = []
    for damping in ({1: RATIO, 2: RATIO}, wide):
        found = update_study(study(measured(BOTH[:1], 0), classes=(linear,), damping=damping))
        estimate = found.classes[0].estimates["theta_2"]
        assert estimate.holds(1.0)
        widths.append(estimate.std)
    assert widths[1] > 5 * widths[0]


def test_a_wrong_gain_of_the_force_is_within_the_interval_only_if_it_is_stated():
    linear = ModelClass("linear", (SPRING, LINEAR_TERM))
    wrong = tuple(replace(each, force_n=1.1 * each.force_n) for each in measured(BOTH[:1], 0, gain_std=0.0))
    stated = replace(study(wrong).noise, force_error=0.1)
    for noise, holds in ((study(wrong).noise, False), (stated, True)):
        found = update_study(study(wrong, classes=(linear,), damping={1: RATIO, 2: RATIO}, noise=noise))
        assert found.classes[0].estimates["theta_2"].holds(1.0) == holds


@pytest.mark.slow
def test_confusion_of_classes_draws_forces_too():
    found = update_study(study(measured(BOTH, 0), n_confused=3))
    assert found.confusion is not None
    chosen = found.confusion.chosen
    np.testing.assert_allclose(chosen.sum(axis=1), 1.0)
    # The sets of the quadratic class have its misfit as their noise, in which a further damper is not told.
    assert chosen[0, 0] == 1.0
    assert chosen[1, 1] == 1.0


def test_a_force_is_written_and_read_back(tmp_path):
    one = curve_of(1)
    write_backbone(one, tmp_path / "one.csv")
    names = {"mode": 1, "controlled_sensor": "tip"}
    back = read_backbone(tmp_path / "one.csv", drive="tip", **names)
    np.testing.assert_array_equal(back.force_n, one.force_n)
    assert back.drive == "tip"
    assert read_backbone(tmp_path / "one.csv", **names).force_n is None
    (tmp_path / "none.csv").write_text("frequency_hz,tip [mm]\n14,1\n14.1,2\n14.2,3\n")
    with pytest.raises(InputError, match=r"0 columns of a force.*give one, like 'force"):
        read_backbone(tmp_path / "none.csv", drive="tip", **names)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"drive": ""}, "a force and no drive point: give both or neither"),
        ({"force_n": None}, "no force and the drive point 'tip': give both or neither"),
        ({"drive": "tap"}, "acts at 'tap', which is not one of its sensors"),
        ({"force_n": np.ones(3)}, "a force of shape (3,) for 12 points: give one number for each"),
        ({"force_n": np.append(-1.0, np.ones(11))}, "is -1 N at one point: give positive amplitudes"),
        ({"force_n": np.zeros(AMPLITUDE.size)}, "is 0 N at one point: give positive amplitudes"),
    ],
)
def test_a_force_that_cannot_be_is_refused(changes, words):
    with pytest.raises(InputError, match=re.escape(words)):
        replace(curve_of(1), **changes)


def test_slopes_of_the_likelihood_with_a_force_are_its_derivatives():
    given = study(measured(BOTH, 0))
    (model_class,) = (each for each in given.classes if each.name == "both")
    model_class = replace(model_class, ratios=(DampingRatio(1, Prior()), DampingRatio(2, Prior())))
    data = backbone_data(given.structure, given.backbones, harmonics=given.harmonics)
    data = replace(data, force=force_data(data.modes, given.backbones, given.noise, {}))
    theta = np.array([[1.02, 0.9, 1.1, 0.0019, 0.0023], [0.97, 1.2, 0.8, 0.0022, 0.0018]])
    value, slopes = slopes_function(data, model_class)(theta)
    density = likelihood_function(data, model_class)
    np.testing.assert_allclose(value, density(theta)[0], rtol=1e-12)
    for column, size in enumerate((1.0, 1.0, 1.0, 2e-3, 2e-3)):
        step = 1e-5 * size * np.eye(5)[column]
        by_difference = (density(theta + step)[0] - density(theta - step)[0]) / (2e-5 * size)
        np.testing.assert_allclose(slopes[:, column], by_difference, rtol=1e-3, atol=1e-3 * np.abs(slopes).max())


@pytest.mark.slow
def test_the_no_u_turn_sampler_finds_a_damper_by_the_force():
    pytest.importorskip("nutpie")
    given = study(measured(BOTH[1:], 0), damping=dict.fromkeys((1, 2), RATIO), sampler="nuts", n_samples=1000)
    (own,) = (each for each in given.classes if each.name == "quadratic")
    found = update_study(replace(given, classes=(own,))).classes[0]
    assert found.diagnostics.effective_samples > 300
    assert [each.holds(1.0) for each in found.estimates.values()] == [True, True]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"damping": {}}, "has a damper, name the damping ratio of each mode with a force"),
        ({"damping": {1: 0.01}}, "backbones of mode 2 have a force and it has no damping ratio"),
        ({"damping": {1: 0.01, 2: 0.01, 3: 0.01}}, "damping ratio of mode 3 is named, and a force is known of"),
        ({"damping": {1: 0.01, 2: -0.01}}, "give a number between 0 and 1"),
        ({"damping": {1: 0.01, 2: Prior("normal", -0.01, 0.002)}}, "give a number between 0 and 1"),
        ({"form": "paper"}, "take the recommended form"),
    ],
)
def test_a_study_of_damping_that_cannot_be_is_refused(changes, words):
    with pytest.raises(InputError, match=words):
        study(measured(BOTH, 0), **changes)


def test_damping_without_any_force_is_refused():
    silent = tuple(replace(each, drive="", force_n=None) for each in measured((), 0))
    with pytest.raises(InputError, match="no backbone has a force, name the drive point"):
        study(silent)
    assert isinstance(silent[0], MeasuredBackbone)


def test_a_study_file_names_dampers_ratios_and_the_drive_point(tmp_path):
    (tmp_path / "study.toml").write_text("""
[structure]
frequency_hz = 14.0
modal_mass_kg = 1.2
sensors = ["tip"]
joints = { spring = "tip" }
damping = { 1 = ["lognormal", 0.002, 0.03] }

[[backbones]]
file = "one.csv"
mode = 1
controlled_sensor = "tip"
drive = "tip"

[[classes]]
law = "cubic + linear damping + quadratic damping"
scale = ["0.1 N/mm^3", 0.4, 2]
prior = [["uniform", 0, 5], ["uniform", 0, 6], "known"]
""")
    (tmp_path / "one.csv").write_text("frequency_hz,tip [mm],force [mN]\n14,1,20\n14.1,2,50\n14.2,3,90\n")
    found = read_study(tmp_path / "study.toml")
    np.testing.assert_allclose(found.backbones[0].force_n, [0.02, 0.05, 0.09])
    assert found.damping == {1: Prior("lognormal", 0.002, 0.03)}
    (own,) = found.classes
    assert own.law_in_words == "cubic + linear damping + quadratic damping"
    assert [each.unit for each in own.law_parameters] == ["N/m^3", "N s/m"]
    table = tabulate_class(own)
    assert table.law == "cubic + linear_damping + quadratic_damping"
    assert [each.key for each in own.law_parameters] == ["cubic_stiffness", "linear_damping"]
    assert table.model.terms == own.terms
