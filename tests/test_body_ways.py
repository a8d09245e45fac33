"""The way to a fit: a coarse rate until laws are found, terms that take the place of others."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from body_runs import LOADS, NOISE, PLACES, aircraft, study

from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.laws import Law, default_law, law
from opid.mechanics.sensors import Sensor
from opid.mechanics.taxiing_aircraft import aircraft_test
from opid.signals.recording import Recording
from opid.suspensions import laws, ways
from opid.suspensions.candidates import fitted_rigid, loading_matrix
from opid.suspensions.fit import BodyFit
from opid.suspensions.laws import is_hopeless, search_laws
from opid.suspensions.model import Group
from opid.suspensions.run import body_run
from opid.suspensions.structure import ImpossibleBodyError
from opid.suspensions.study import LoadedRun, PointMass

FRICTION = law("arctan_velocity", amplitude_n=1.0, scale_m_per_s=0.02)


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
        lowest_step_rate_hz=1024.0,
    )
    loads = tuple(PointMass(each.mass_kg, each.x_m, each.y_m) for each in LOADS)
    return study(
        runs=tuple(
            LoadedRun(name, run.recording, given)
            for name, run, given in zip(("light", "heavy"), test.runs, ((), loads), strict=True)
        )
    )


def arrays_of(given):
    below, above = ([f"{name}_{side}_z" for name in given.names] for side in ("lower", "upper"))
    return [
        tuple(np.stack([run.recording.channel(name) for name in names], axis=1) for names in (below, above))
        for run in given.runs
    ]


def fitted(given, kind_of_law):
    return fitted_rigid(given, arrays_of(given), np.full(2, NOISE), law=kind_of_law, band_hz=(0.3, 40.0))


def with_added(given, channels, added):
    """The study with something added to some channels of each run."""

    def changed(recording):
        samples = np.array(recording.samples)
        for name in channels:
            samples[:, recording.names.index(name)] += added(len(samples))
        return Recording(samples, fs=recording.fs, channels=recording.channels)

    return replace(given, runs=tuple(replace(each, recording=changed(each.recording)) for each in given.runs))


@pytest.fixture(scope="module")
def true(fast):
    found = fitted(fast, FRICTION)
    assert found.residual_over_noise < 1.05
    return found.found


def test_at_a_coarse_rate_the_true_model_leaves_the_noise_as_well(true):
    coarse = true.model.coarse
    for run, thinned in zip(true.model.runs, coarse.runs, strict=True):
        assert (thinned.fs, thinned.coarser) == (256.0, 2)
        np.testing.assert_array_equal(thinned.sprung, run.sprung[: 2 * thinned.n_samples : 2])
    # 470 lines of three sensors: 0.027 is one standard deviation
    for lines in coarse.evaluate(true.theta, sensitivity=False).lines:
        assert np.mean(np.abs(lines) ** 2) / 2 == pytest.approx(1.0, abs=0.12)


def test_noise_below_the_suspensions_is_averaged_at_a_coarse_rate(fast, true):
    """So much of it that the readings follow it: what is left is white of unit variance at either rate."""
    rng, loud = np.random.default_rng(5), 1.0
    below = [f"{name}_lower_z" for name in fast.names]
    given = with_added(fast, below, lambda n: loud * rng.standard_normal(n))
    runs = tuple(
        body_run(*arrays, fs=fast.fs, loading=loading_matrix(given, place))
        for place, arrays in enumerate(arrays_of(given))
    )
    model = replace(true.model, runs=runs, noise=(loud, NOISE))
    for each in (model, model.coarse):
        lines = each.evaluate(true.theta, sensitivity=False).lines
        assert [np.mean(np.abs(line) ** 2) / 2 for line in lines] == pytest.approx([1.0, 1.0], abs=0.15)


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
    # what would fold is gone
    fast_wave = np.sin(2 * np.pi * 240 * np.arange(5120) / 512.0)[:, np.newaxis]
    thinned = body_run(fast_wave, fast_wave, fs=512.0, loading=loading).coarse
    assert np.abs(thinned.drive[200:-200]).max() < 2e-3
    np.testing.assert_allclose(coarse.sprung[20:-20], coarse.unsprung[20:-20], atol=2e-3)


def test_a_term_takes_the_place_of_one_that_bends_alike():
    """The truth is an arctangent of the velocity; a hyperbolic tangent of it is found to be like it, and worse."""
    sharp = fitted(study(), law("coulomb_friction", amplitude_n=1.0, scale_m_per_s=0.02)).found
    assert not is_hopeless(sharp)
    best, steps = search_laws(sharp, kinds=("arctan_velocity", "cubic_stiffness"))
    assert {group.law.name for group in best.groups()} == {"arctan_velocity"}
    assert set(steps[1].law.values()) == {"arctan_velocity"}
    assert steps[1].kept
    assert best.bic < sharp.bic - 50


class EnoughError(Exception):
    """Ends a fit where a test has seen what it wants."""


@pytest.mark.parametrize(("stiffer", "coarser"), [(1.0, 2), (200.0, 1)])
def test_a_body_that_moves_fast_is_followed_at_the_full_rate(fast, monkeypatch, stiffer, coarser):
    """Steps of 1/256 s follow 0.7 x 256 rad/s; 200 times stiffer, a gear answers at some 28 Hz."""
    seen = []

    def stops(model, theta, *settings, **more):
        seen.append(model.runs[0].coarser)
        raise EnoughError

    real = ways.fastest_rate

    def rate(model, theta):
        theta = theta.copy()
        theta[list(model.first_of_group)] *= stiffer
        return real(model, theta)

    monkeypatch.setattr(ways, "_way", stops)
    monkeypatch.setattr(ways, "fastest_rate", rate)
    with pytest.raises(EnoughError):
        fitted(fast, FRICTION)
    assert seen == [coarser]


def test_where_long_steps_fail_all_readings_lead(fast, monkeypatch):
    seen, real = [], ways._way

    def fails_when_coarse(model, theta, *settings, **more):
        seen.append(model.runs[0].coarser)
        if model.runs[0].coarser > 1:
            raise UnboundedResponseError("it grows")
        return real(model, theta, *settings, **more)

    monkeypatch.setattr(ways, "_way", fails_when_coarse)
    assert fitted(fast, FRICTION).explains
    assert seen == [2, 1]


def test_what_the_model_does_not_predict_is_not_folded_into_the_band(fast, monkeypatch):
    """A tone of 240 Hz on the body, 20 times the noise, would pass for one of 16 Hz at every second sample."""

    def tone(n):
        return 0.1 * np.sqrt(2) * np.sin(2 * np.pi * 240 * np.arange(n) / fast.fs)

    seen = []

    def stops(model, theta, *settings, **more):
        seen.append(model.runs[0].coarser)
        raise EnoughError

    monkeypatch.setattr(ways, "_way", stops)
    for given in (fast, with_added(fast, ["left_upper_z"], tone)):
        with pytest.raises(EnoughError):
            fitted(given, FRICTION)
    assert seen == [2, 1]


def test_folded_power_is_that_of_the_lines_that_fold(fast):
    """Of white noise it is one; a tone counts where thinning by two takes it for one of the band."""
    run = body_run(np.zeros((5120, 1)), np.zeros((5120, 1)), fs=512.0, loading=np.zeros((1, 1)))
    white = np.random.default_rng(0).standard_normal((1, 5120))
    assert ways.folded_power(white, run, run.coarse) == pytest.approx(1.0, abs=0.2)
    time_s = np.arange(5120) / 512.0
    for tone_hz, counts in ((240.0, True), (220.0, True), (200.0, False), (16.0, False)):
        tone = np.sin(2 * np.pi * tone_hz * time_s)[np.newaxis]
        assert (ways.folded_power(tone, run, run.coarse) > 1.0) == counts, tone_hz


def test_the_search_goes_on_with_all_readings(fast, monkeypatch):
    """What half of the readings do not show is asked of all of them."""
    seen = []

    def asked(fit, *, progress=None):
        seen.append(fit.model.runs[0].coarser)
        return fit, ()

    monkeypatch.setattr(ways, "search_laws", asked)
    assert fitted(fast, None).found.model.runs[0].coarser == 1
    assert seen[0] == 2
    assert seen[-1] == 1
    assert len(seen) < 4


def test_terms_that_bend_alike_are_told_from_those_that_do_not(fast):
    """Whatever their sign, scale and size; laws of the travel are not like laws of the velocity."""
    groups = (Group("nose", (0,), law("arctan_velocity", amplitude_n=3.0, scale_m_per_s=0.02)),)
    model = SimpleNamespace(motion_rms=np.array([[0.004, 0.05]]))
    fit = SimpleNamespace(model=model, groups=lambda: groups)

    def alike(kind):
        term = default_law(kind).terms[0]
        return [each.name for each in laws._alike(fit, laws.Promise(1.0, "nose", term, 1.0))]

    assert alike("coulomb_friction") == ["arctan_velocity"]
    # bends the other way: of a negative amplitude
    assert alike("quadratic_damping") == ["arctan_velocity"]
    for kind in ("cubic_stiffness", "asymmetric_damping", "gas_spring", "arctan_displacement", "arctan_velocity"):
        assert alike(kind) == [], kind
    # a spring bends nowhere
    groups = (Group("nose", (0,), Law((law("cubic_stiffness", stiffness_n_per_m3=0.0).terms[0],))),)
    assert alike("coulomb_friction") == []


@pytest.mark.parametrize(("share", "tried"), [(0.02, 0), (0.2, 1)])
def test_laws_are_not_searched_where_they_promise_nothing(true, monkeypatch, share, tried):
    """Far beyond the noise, terms that explain hardly any of it are not tried."""
    theta = true.theta * np.where(np.arange(true.theta.size) == 0, 3.0, 1.0)
    wrong = BodyFit(true.model, theta, true.model.evaluate(theta), 1)
    assert is_hopeless(wrong)
    promise = laws.Promise(share * wrong.n_data, "nose", default_law("cubic_stiffness").terms[0], 1.0)
    monkeypatch.setattr(laws, "_promises", lambda fit, kinds: [promise])

    def fails(*model, **settings):
        raise ImpossibleBodyError("no")

    monkeypatch.setattr(laws, "fit_body", fails)
    said = []
    best, _ = search_laws(wrong, progress=said.append)
    assert best is wrong
    assert said == ["cubic_stiffness at nose"] * tried
