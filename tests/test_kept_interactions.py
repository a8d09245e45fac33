"""Points in an interaction are paired with the curve that damping leaves of its loop: pull, posterior, warnings."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from jointed_systems import CUBIC, two_pylons

from opid import plots
from opid.errors import InputError
from opid.mechanics.backbones.continuation import continued_backbone
from opid.mechanics.backbones.quadrature_curves import Specimen, quadrature_curve
from opid.updating.identification import update_study
from opid.updating.likelihood.backbones import backbone_data, find_met_modes
from opid.updating.likelihood.interactions import (
    adapt_to_class,
    describe_interactions,
    describe_lossy,
    describe_unpaired,
    find_omitted_pull,
    find_pull,
    with_interactions,
)
from opid.updating.likelihood.noise import NoiseSettings
from opid.updating.model_class import ModelClass, Prior, UncertainTerm
from opid.updating.posterior import update_class
from opid.updating.prediction import predict
from opid.updating.study import UpdatingStudy
from opid.updating.warnings import find_bumps, warn_of_bump
from opid.virtual.backbone_tests.measured import convert_curve

SYSTEM = two_pylons(0.05)  # three times the frequency of mode 3 meets mode 9
MET = 8
LAW = ModelClass("cubic", (UncertainTerm("cubic_stiffness", (6e7,), (Prior("uniform", 0.0, 3.0),)),))
TRUE = np.array([1.0])
DAMPING = 0.003


@cache
def curves(damping=DAMPING):
    """Backbones by one force on the damped structure, with different sensors in quadrature, exact."""
    specimen = Specimen(SYSTEM, CUBIC, damping, "plate 2")
    found = [
        quadrature_curve(
            specimen, mode=3, sensor=sensor, controlled_sensor="tip 1", amplitude=np.linspace(2e-4, 2.5e-3, 60),
            harmonics=(1, 3),
        )
        for sensor in ("tip 1", "tip 3", "plate 2")
    ]  # fmt: skip
    assert all(curve.converged.all() for curve in found)
    return tuple(replace(convert_curve(curve, "plate 2"), drive="", force_n=None) for curve in found)


def measured(seed=0, damping=DAMPING):
    rng = np.random.default_rng(seed)
    return tuple(
        replace(
            curve,
            frequency_hz=curve.frequency_hz[::2] * (1 + 1e-4 * rng.standard_normal(30)),
            amplitude=curve.amplitude[::2],
        )
        for curve in curves(damping)
    )


def data_of(backbones, damping, detuning=0.0):
    """The backbones with a structure in which the mode that is met has another frequency."""
    eigenvalue = SYSTEM.eigenvalue.copy()
    eigenvalue[MET] *= (1 + detuning) ** 2
    exact = NoiseSettings(motion_error=0.0)
    return replace(backbone_data(replace(SYSTEM, eigenvalue=eigenvalue), backbones, noise=exact), met_damping=damping)


def posterior(data):
    return update_class(data, LAW, rng=np.random.default_rng(0), n_samples=1000, evidences=("laplace",))


def score(found):
    estimate = found.estimates["theta_1"]
    return (estimate.value - 1) / estimate.std


def is_wrong_without_interval(found):
    """Return whether theta is more than 8 deviations of its samples off, and its interval is withheld."""
    estimate = found.estimates["theta_1"]
    apart = estimate.value - 1, found.chain.pooled[:, 0].std()
    return abs(apart[0]) > 8 * apart[1] and estimate.std is None and estimate.interval95 is None


# ---- the pull ---------------------------------------------------------------------------------------


def pull_and_smooth(amplitude, like):
    data = data_of(like, DAMPING)
    pull = find_pull(data, data.modes[0], LAW, TRUE, "tip 1", amplitude)
    smooth = find_met_modes(data, data.modes[0]).remove_from(SYSTEM)
    return pull, smooth


def test_both_sides_of_the_loop_without_damping_are_the_smooth_curve_with_its_pull():
    given = {"mode": 3, "sensor": "tip 1", "first_amplitude_m": 2e-4, "last_amplitude_m": 2.5e-3, "harmonics": (1, 3)}
    loop = continued_backbone(SYSTEM, CUBIC, largest_step=0.02, **given)
    apart = np.abs(3 * loop.frequency_hz / SYSTEM.frequency_hz[MET] - 1)
    # On the tongue itself the third harmonic is as large as the first: it is no small change of the smooth curve.
    beside = (apart > 0.008) & (np.abs(loop.modal_motion[:, 1, MET]) < 0.05 * np.abs(loop.modal_motion[:, 0, 2]))
    side = np.sign(3 * loop.frequency_hz / SYSTEM.frequency_hz[MET] - 1)[beside]
    assert (side > 0).any()
    assert (side < 0).any()
    order = np.argsort(np.abs(loop.amplitude)[beside])
    amplitude = np.abs(loop.amplitude)[beside][order]
    eigenvalue = (2 * np.pi * loop.frequency_hz[beside][order]) ** 2
    pull, smooth = pull_and_smooth(amplitude, measured())
    there = continued_backbone(smooth, CUBIC, **given)
    expected = (2 * np.pi * np.interp(amplitude, there.amplitude, there.frequency_hz)) ** 2
    shift = pull.find_shift(eigenvalue, 0.0)
    left = (eigenvalue - expected - shift) / eigenvalue
    assert np.abs(shift / eigenvalue).max() > 8e-4
    assert np.abs(left).max() < 0.25 * np.abs(shift / eigenvalue).max()
    # both sides are pulled, in opposite directions
    assert (shift * side[order] > 0).all() or (shift * side[order] < 0).all()


def test_damping_leaves_the_curve_of_a_test_with_one_force():
    curve = curves()[1]
    amplitude, eigenvalue = curve.controlled_amplitude, curve.eigenvalue
    pull, smooth = pull_and_smooth(amplitude, measured())
    without = quadrature_curve(
        Specimen(smooth, CUBIC, DAMPING, "plate 2"), mode=3, sensor="tip 3", controlled_sensor="tip 1",
        amplitude=amplitude, harmonics=(1, 3),
    )  # fmt: skip
    true = eigenvalue / (2 * np.pi * without.frequency_hz) ** 2 - 1
    shift = pull.find_shift(eigenvalue, DAMPING) / eigenvalue
    assert np.abs(true).max() > 3e-3
    assert np.abs(shift - true).max() < 0.2 * np.abs(true).max()
    apart = np.abs(3 * curve.frequency_hz / SYSTEM.frequency_hz[MET] - 1) > 4 * DAMPING
    assert (np.abs(shift - true)[apart] < 0.12 * np.abs(true)[apart] + 1e-6).all()


def test_a_pull_is_interpolated_between_nodes():
    data = data_of(measured(), DAMPING)
    (mode,) = data.modes
    ((sensor, nodes),) = mode.parts
    at_nodes = find_pull(data, mode, LAW, TRUE, sensor, nodes).at(mode.between)
    order = np.argsort(mode.amplitude)
    exact = find_pull(data, mode, LAW, TRUE, sensor, mode.amplitude[order])
    one = at_nodes.find_shift(mode.eigenvalue, DAMPING)[order]
    np.testing.assert_allclose(one, exact.find_shift(mode.eigenvalue[order], DAMPING), atol=1e-6 * mode.linear)


# ---- the posterior ----------------------------------------------------------------------------------


def test_kept_points_leave_theta_right_where_a_smooth_model_is_wrong():
    data = data_of(measured(), DAMPING)
    kept = posterior(data)
    assert abs(score(kept)) < 2.5
    assert not any("interaction" in each or "bump" in each for each in kept.warnings)
    omitted = posterior(replace(data, met_damping=None))
    assert is_wrong_without_interval(omitted)
    assert any("leave those points out, or state interaction = 'keep'" in each for each in omitted.warnings)


def leave_out(curves, apart):
    """Return curves without the points whose third harmonic is as near to the mode that it meets."""
    near = [np.abs(3 * curve.frequency_hz / SYSTEM.frequency_hz[MET] - 1) <= apart for curve in curves]
    return tuple(
        replace(curve, frequency_hz=curve.frequency_hz[~own], amplitude=curve.amplitude[~own])
        for curve, own in zip(curves, near, strict=True)
    )


def test_bands_are_withheld_where_interactions_that_are_left_out_move_theta():
    noise = NoiseSettings(motion_error=0.0)
    study = UpdatingStudy("omitted", SYSTEM, leave_out(measured(), 0.01), (LAW,), noise=noise, n_samples=1000)
    found = update_study(study)
    assert found.classes[0].is_pulled
    assert all(np.isnan(band.low_hz).all() and np.isnan(band.high_hz).all() for band in found.prediction)
    assert any("neither this nor bands are given" in each for each in found.all_warnings)


@pytest.mark.parametrize("apart", [0.004, 0.01])
@pytest.mark.parametrize("seed", range(3))
def test_points_beside_an_interaction_are_pulled_where_those_within_it_are_left_out(apart, seed):
    data = data_of(leave_out(measured(seed), apart), None)
    found = posterior(data)
    assert is_wrong_without_interval(found)
    pulled = find_omitted_pull(data, LAW, found.best, found.covariance)
    assert abs((found.best + pulled - TRUE)[0]) < 0.5 * abs((found.best - TRUE)[0])
    kept = posterior(replace(data, met_damping=DAMPING))
    assert abs(score(kept)) < 2.5


@pytest.mark.parametrize("detuning", [-0.006, 0.004])
def test_a_mode_that_is_met_elsewhere_than_in_the_structure_does_not_move_theta(detuning):
    found = posterior(data_of(measured(1), DAMPING, detuning))
    assert abs(score(found)) < 2.5


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_damping_that_is_wrong_by_half_does_not_move_theta(factor):
    assert abs(score(posterior(data_of(measured(2), factor * DAMPING)))) < 2.5


@pytest.mark.parametrize(
    ("detuning", "sentence"),
    [
        (-0.05, "alike in all curves: another mode may pull them where the structure has no interaction"),
        (-0.02, "alike in all curves: another mode may pull them where the structure has no interaction"),
        (0.012, "have mode 9 at 1.2 % or more from 49.97 Hz, farther than linear_error allows"),
        (0.02, "have mode 9 at 1.2 % or more from 50.36 Hz, farther than linear_error allows"),
        (0.05, "have mode 9 at 1.2 % or more from 51.84 Hz, farther than linear_error allows"),
    ],
)
def test_an_interaction_that_the_structure_has_elsewhere_is_told(detuning, sentence):
    found = posterior(data_of(measured(), DAMPING, detuning))
    assert any(sentence in each and "no interval of it holds" in each for each in found.warnings)
    assert not found.has_intervals


def test_an_interaction_of_which_the_structure_knows_nothing_is_told():
    # 10 % off, no harmonic meets the mode in the model: neither way of treating its points knows better
    for damping in (None, DAMPING):
        found = posterior(data_of(measured(), damping, 0.1))
        assert is_wrong_without_interval(found)
        (told,) = (each for each in found.warnings if "no interval of it holds" in each)
        assert told.startswith("with the best parameters a bump of ")


def test_a_bump_is_measured_against_the_growth_of_the_frequencies():
    adapted = adapt_to_class(data_of(measured(), DAMPING), LAW, TRUE)
    (right,) = find_bumps(adapted, LAW, TRUE)
    assert right.fraction < 0.006
    (mode,) = adapted.modes
    middle = np.exp(-(((mode.relative_amplitude - 0.5) / 0.1) ** 2))
    size = float((mode.eigenvalue / mode.linear).std())
    bumped = replace(adapted, modes=(replace(mode, eigenvalue=mode.eigenvalue + 0.1 * size * mode.linear * middle),))
    (wrong,) = find_bumps(bumped, LAW, TRUE)
    assert 0.02 < wrong.fraction < 0.06
    assert wrong.probability < 1e-6
    # in one of the curves alone it is no bump that all have
    alone = middle * (mode.curve == 0)
    single = replace(adapted, modes=(replace(mode, eigenvalue=mode.eigenvalue + 0.1 * size * mode.linear * alone),))
    assert list(warn_of_bump(find_bumps(single, LAW, TRUE))) == []


def test_points_on_a_tongue_that_damping_cuts_off_are_told():
    backbones = measured()
    moved = [replace(curve, frequency_hz=curve.frequency_hz.copy()) for curve in backbones]
    hz = backbones[0].frequency_hz.copy()
    hz[3:6] = SYSTEM.frequency_hz[MET] / 3 * 1.002
    moved[0] = replace(moved[0], frequency_hz=hz)
    data = adapt_to_class(data_of(tuple(moved), DAMPING), LAW, TRUE)
    (clause,) = describe_unpaired(data, LAW, TRUE)
    assert "3 of 90 measured points" in clause
    assert "harmonic 3 meets mode 9" in clause
    assert describe_unpaired(adapt_to_class(data_of(backbones, DAMPING), LAW, TRUE), LAW, TRUE) == []


def test_a_test_whose_points_all_lie_in_the_resonance_is_told():
    assert describe_lossy(data_of(measured(), DAMPING)) == []
    (clause,) = describe_lossy(data_of(measured(), 0.012))
    assert clause.startswith("mode 3 ")


def test_without_the_switch_everything_stays_as_it_is():
    data = data_of(measured(), None)
    assert with_interactions(data, LAW, TRUE) is data
    assert describe_unpaired(data, LAW, TRUE) == describe_lossy(data) == []
    assert describe_interactions(data_of(measured(), DAMPING), LAW, TRUE) == []
    # where nothing is met, keeping changes nothing, either
    beside = replace(data, harmonics=(1,), met_damping=DAMPING)
    assert with_interactions(beside, LAW, TRUE).modes == beside.modes


# ---- study, prediction and figure --------------------------------------------------------------------


def test_the_band_runs_through_the_interaction_and_the_loop_is_drawn():
    backbones = measured()
    data = data_of(backbones, DAMPING)
    (band,) = predict(data, posterior(data), backbones, rng=np.random.default_rng(0))
    assert band.coverage > 0.9
    assert band.loop is not None
    amplitude, hz = band.loop
    assert (np.diff(amplitude) < 0).any()
    assert hz.max() == pytest.approx(backbones[0].frequency_hz[-1], rel=2e-3)
    (without,) = predict(replace(data, met_damping=None), posterior(data), backbones, rng=np.random.default_rng(0))
    assert without.loop is None
    ax = plots.predicted_backbones([band], backbones, 3)[0, 0]
    assert "loop without damping" in ax.get_legend_handles_labels()[1]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"interaction": "keep"}, "met_damping is missing and interaction 'keep', give the damping ratio"),
        ({"interaction": "keep", "met_damping": 1.5}, r"met_damping is 1.5 and interaction 'keep', give the damping"),
        ({"met_damping": 0.01}, "met_damping is 0.01 and interaction 'omit', take interaction = 'keep', or leave it"),
        ({"interaction": "all"}, "interaction is 'all', give one of omit, keep"),
        ({"interaction": "keep", "met_damping": 0.01, "harmonics": (1,)}, r"harmonics are \[1\], give higher ones"),
        ({"interaction": "keep", "met_damping": 0.01, "form": "independent"}, "take the recommended form"),
    ],
)
def test_settings_that_do_not_go_together_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        UpdatingStudy("x", SYSTEM, measured(), (LAW,), **given)
