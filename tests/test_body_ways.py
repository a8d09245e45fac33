"""The way to a fit: a coarse rate until laws are found, terms that take the place of others."""

import numpy as np
import pytest
from body_runs import LOADS, NOISE, PLACES, aircraft, short_runs, study

from opid.identify.body import ways
from opid.identify.body.candidates import fitted_rigid
from opid.identify.body.laws import is_hopeless, search_laws
from opid.identify.body.run import body_run
from opid.identify.body.study import LoadedRun, PointMass
from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.laws import law
from opid.mechanics.sensors import Sensor
from opid.mechanics.taxiing_aircraft import aircraft_test


@pytest.fixture(scope="module")
def fast():
    """Two runs of 12 s at 512 Hz."""
    test = aircraft_test(
        aircraft(),
        rng=np.random.default_rng(3),
        loadings=[LOADS],
        duration_s=12.0,
        fs=512.0,
        coherent_tracks=False,
        sprung_sensors=PLACES,
        sensor=Sensor(noise_m_per_s2=NOISE),
    )
    loads = tuple(PointMass(each.mass_kg, each.x_m, each.y_m) for each in LOADS)
    return study(
        runs=tuple(
            LoadedRun(name, run.recording, given)
            for name, run, given in zip(("light", "heavy"), test.runs, ((), loads), strict=True)
        )
    )


def fitted(given, kind_of_law):
    below, above = ([f"{name}_{side}_z" for name in given.names] for side in ("lower", "upper"))
    arrays = [
        tuple(np.stack([run.recording.channel(name) for name in names], axis=1) for names in (below, above))
        for run in given.runs
    ]
    return fitted_rigid(given, arrays, np.full(2, NOISE), law=kind_of_law, band_hz=(0.3, 40.0))


def test_at_a_coarse_rate_the_true_model_leaves_the_noise_as_well(fast):
    found = fitted(fast, law("arctan_velocity", amplitude_n=1.0, scale_m_per_s=0.02))
    assert found.residual_over_noise < 1.05
    model, coarse = found.found.model, found.found.model.coarse
    for run, thinned in zip(model.runs, coarse.runs, strict=True):
        n = thinned.n_samples
        assert (thinned.fs, thinned.coarser) == (256.0, 2)
        np.testing.assert_array_equal(thinned.sprung, run.sprung[: 2 * n : 2])
        # between its samples the drive is as measured
        np.testing.assert_array_equal(thinned.drive, run.unsprung[: 2 * n - 1])
    errors = coarse.evaluate(found.found.theta, sensitivity=False)
    # 470 lines of three sensors: 0.027 is one standard deviation
    for lines in errors.lines:
        assert np.mean(np.abs(lines) ** 2) / 2 == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize(
    ("fs", "band_hz", "coarser"),
    [(256.0, (0.3, 40.0), 1), (512.0, (0.3, 150.0), 1), (512.0, (0.3, 100.0), 2), (2000.0, (0.3, 40.0), 8)],
)
def test_a_run_is_thinned_as_far_as_its_steps_and_its_band_allow(fs, band_hz, coarser):
    noise = np.random.default_rng(0).standard_normal((round(10 * fs), 2))
    run = body_run(noise[:, :1], noise[:, 1:], fs=fs, loading=np.zeros((1, 1)), band_hz=band_hz)
    coarse = run.coarse
    assert (coarse is run) == (coarser == 1)
    assert coarse.coarser == coarser
    assert coarse.fs == fs / coarser
    assert coarse.drive.shape == (2 * coarse.n_samples - 1, 1)
    assert coarse.n_samples * coarser <= len(noise)
    # the same band, but for the few samples that make no even share
    assert coarse.omega[-1] == pytest.approx(run.omega[-1], rel=0.01)


def test_a_slow_drive_is_the_same_at_a_coarse_rate():
    fs, loading = 2000.0, np.zeros((1, 1))
    t = np.arange(20_000) / fs
    wave = np.sin(2 * np.pi * 10 * t)[:, np.newaxis]
    coarse = body_run(wave, wave, fs=fs, loading=loading).coarse
    inner = slice(100, -100)
    half_steps = np.arange(len(coarse.drive)) / (2 * coarse.fs)
    expected = np.sin(2 * np.pi * 10 * half_steps)
    assert np.abs(coarse.drive[inner, 0] - expected[inner]).max() < 2e-3
    # a filter needs some samples at either end
    np.testing.assert_allclose(coarse.sprung[20:-20], coarse.unsprung[20:-20], atol=2e-3)


def test_a_term_takes_the_place_of_one_that_bends_alike():
    """The truth is an arctangent of the velocity; a hyperbolic tangent of it is found to be like it, and worse."""
    sharp = fitted(study(runs=short_runs()), law("coulomb_friction", amplitude_n=1.0, scale_m_per_s=0.02)).found
    assert not is_hopeless(sharp)
    best, steps = search_laws(sharp, kinds=("arctan_velocity", "cubic_stiffness"))
    assert {group.law.name for group in best.groups()} == {"arctan_velocity"}
    assert set(steps[1].law.values()) == {"arctan_velocity"}
    assert steps[1].kept
    assert best.bic < sharp.bic - 50


@pytest.mark.parametrize(("stiffer", "coarser"), [(1.0, 2), (200.0, 1)])
def test_a_body_that_moves_fast_is_followed_at_the_full_rate(fast, monkeypatch, stiffer, coarser):
    """Steps of 1/256 s follow 0.7 x 256 rad/s; 200 times stiffer, a gear answers at some 28 Hz."""
    seen = []

    def stops(model, theta, *settings, **more):
        seen.append(model.runs[0].coarser)
        raise UnboundedResponseError("enough")

    real = ways.fastest_rate

    def rate(model, theta):
        theta = theta.copy()
        theta[list(model.first_of_group)] *= stiffer
        return real(model, theta)

    monkeypatch.setattr(ways, "_way", stops)
    monkeypatch.setattr(ways, "fastest_rate", rate)
    assert fitted(fast, law("arctan_velocity", amplitude_n=1.0, scale_m_per_s=0.02)).reason == "enough"
    assert seen == [coarser]
