"""A sensor of the force in the strut: a load cell whose gain gives the mass, or a strain gauge of unknown gain."""

import json
from dataclasses import replace

import numpy as np
import pytest

import opid
from opid.mechanics.repeatability import Departure
from opid.signals.logs import write_log
from opid.signals.recording import Channel, Recording
from opid.studies.stored_fits import read_fits
from opid.suspensions.planning.result import PlannedRun
from opid.suspensions.planning.search import SearchSpace, plan_runs
from opid.suspensions.sensing.settings import SensingSettings
from opid.suspensions.sensing.virtual_sensors import sense
from opid.suspensions.study import PointMass
from opid.virtual.taxi_tests.aircraft import default_aircraft
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_study, taxi_test

GEAR, REMOVED_KG, NOISE_N = LandingGear(), 220.0, 10.0
TRUE_KG = GEAR.sprung_mass_kg
HEAD = '[channels]\nsprung = "upper_z"\nunsprung = "lower_z"\n'
FORCE = HEAD + '[channels.force]\nchannel = "load"\n'
STRAIN = FORCE + 'quantity = "strain"\n'


def simulate(*departures):
    """Return two virtual taxi runs, and the noise of a load cell in each, N."""
    rng, airframe = np.random.default_rng(11), GEAR.airframe
    removed = [PointMass(-REMOVED_KG, airframe.x_cg_m, airframe.y_cg_m)]
    test = taxi_test(GEAR, rng=rng, duration_s=24.0, fs=256.0, loadings=[removed], departures=departures)
    return test, [NOISE_N * rng.standard_normal(run.recording.n_samples) for run in test.runs]


@pytest.fixture(scope="module")
def taxi_runs():
    """Two virtual taxi runs whose springs are the same."""
    return simulate(Departure(), Departure())


@pytest.fixture(scope="module")
def unlike_runs():
    """Two virtual taxi runs between which spring, damper and friction change by different ratios."""
    return simulate(Departure(), Departure(0.02, -0.01, 0.015))


def write(directory, taxi_runs, channels, *, gains=(1.0, 1.0), damping=1.0, unit="N", n_runs=2, head=""):
    """Write logs with the force in the strut, and the study file with some [channels]; return its path.

    `damping` is the part of the damper's force that the sensor carries.
    """
    test, noises = taxi_runs
    tables = ""
    several = zip(test.runs, noises, ("heavy", "light"), (0.0, -REMOVED_KG), gains, strict=True)
    for run, noise, name, change, gain in [*several][:n_runs]:
        beside = (1.0 - damping) * GEAR.suspension_damping_n_s_per_m * run.truth.channel("travel_velocity")
        load = (TRUE_KG + change) * run.truth.channel("upper_z") + beside + noise
        columns = [run.recording.channel("lower_z"), run.recording.channel("upper_z"), gain * load]
        units = {"lower_z": "m/s^2", "upper_z": "m/s^2", "load": unit}
        whole = Recording(np.stack(columns, axis=1), run.recording.fs, tuple(Channel(*each) for each in units.items()))
        write_log(whole, directory / f"{name}.csv")
        tables += f'[[runs]]\nname = "{name}"\nlog = "{name}.csv"\nmass_change_kg = {change}\nstart_s = 0\n'
    (directory / "study.toml").write_text(head + channels + tables)
    return directory / "study.toml"


def identify(path, **options):
    return opid.identify(opid.read_study(path), law="arctan_velocity", **options)


def assert_holds(result):
    estimate = result.parameters.sprung_mass_kg
    assert abs(estimate.value - TRUE_KG) < 3 * estimate.std
    return estimate


def test_a_load_cell_gives_the_mass_from_one_run(tmp_path, taxi_runs):
    result = identify(write(tmp_path, taxi_runs, FORCE, n_runs=1))
    assert 0.013 * TRUE_KG < assert_holds(result).std < 0.016 * TRUE_KG
    text = " ".join(opid.text(result).split())
    assert "from accelerations and the force in the strut" in text
    assert "by the force in the strut; a gain that is known better would narrow the interval" in text
    assert abs(result.parameters.suspension_stiffness_n_per_m.value / 3.9e5 - 1) < 0.02
    (tmp_path / "calibrated").mkdir()
    better = FORCE + "gain_tolerance = 0.003\n" + "[sensors.sprung]\ngain_tolerance = 0.003\n"
    calibrated = identify(write(tmp_path / "calibrated", taxi_runs, better, n_runs=1))
    assert assert_holds(calibrated).std < 0.006 * TRUE_KG


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "unit"), [(3e-7, "1"), (2.0, "V"), (1.0, "N")])
def test_a_strain_gauge_compares_the_masses_of_the_runs(tmp_path, unlike_runs, factor, unit):
    """Its gain is unknown but the same in both runs, so that it tells the ratio of the masses, whatever the springs."""
    result = identify(write(tmp_path, unlike_runs, STRAIN, gains=(factor, factor), unit=unit))
    (tmp_path / "without").mkdir()
    without = identify(write(tmp_path / "without", unlike_runs, HEAD))
    assert assert_holds(result).std < 0.6 * without.parameters.sprung_mass_kg.std
    gain = result.evidence[0].gains_of_forces["force"]
    assert abs(gain.value - factor) < 3 * gain.std
    assert gain.std < 0.08 * factor


def test_a_strain_gauge_gives_no_mass_from_one_run(tmp_path, taxi_runs):
    result = identify(write(tmp_path, taxi_runs, STRAIN, n_runs=1))
    assert "one run gives ratios to the mass alone" in result.not_determined
    assert result.ratios.natural_frequency_hz.value == pytest.approx(2.31, abs=0.02)
    assert not result.evidence[0].gains_of_forces


@pytest.mark.slow
@pytest.mark.parametrize("gains", [(1.0, 1.005), (1.0, 0.996), (1.0, 1.02), (1.0, 0.98), (1.0, 1.03)])
@pytest.mark.parametrize("channels", [STRAIN, FORCE])
def test_a_gain_that_differs_between_the_runs_is_within_the_interval(tmp_path, taxi_runs, unlike_runs, channels, gains):
    """Half a per cent of gain passes for four of mass, and 3 % are six times what is usual.

    A gain that grew looks like springs, damping and friction that all grew by one ratio.
    """
    for name, runs in (("alike", taxi_runs), ("unlike", unlike_runs)):
        (tmp_path / name).mkdir()
        assert_holds(identify(write(tmp_path / name, runs, channels, gains=gains)))


@pytest.mark.parametrize("gain", [1.1, 1 / 4.448])
def test_a_gain_that_the_change_of_mass_contradicts_is_not_used(tmp_path, taxi_runs, gain):
    result = identify(write(tmp_path, taxi_runs, FORCE, gains=(gain, gain)))
    assert_holds(result)
    assert any(
        "the force (channel 'force') contradicts the changes of mass, and is not used" in each
        for each in result.warnings
    )
    found = result.evidence[0].gains_of_forces["force"]
    assert abs(found.value - gain) < 3 * found.std


@pytest.mark.slow
@pytest.mark.parametrize("channels", [FORCE, STRAIN])
@pytest.mark.parametrize("n_runs", [1, 2])
def test_a_sensor_beside_the_damper_gives_no_mass(tmp_path, taxi_runs, channels, n_runs):
    """A load cell at the spring does not carry the force of the damper."""
    result = identify(write(tmp_path, taxi_runs, channels, damping=0.0, n_runs=n_runs))
    assert result.parameters.sprung_mass_kg.value is None
    assert result.not_determined


@pytest.mark.parametrize(
    ("channels", "options", "words"),
    [
        (
            '[channels]\nsprung = "upper_z"\n[channels.force]\nchannel = "load"\n'
            '[channels.unsprung]\nchannel = "load"\nquantity = "travel"\n',
            {},
            "a force is read, too: the gain of the force is then told by nothing|both channel 'load'",
        ),
        (FORCE, {"gains": (-1.0, -1.0)}, "falls as the body above is pushed .* give it sign = -1"),
        (FORCE, {"unit": "V"}, "its quantity is 'force' and its unit is V|channel 'force' is in V: give a force in N"),
        (STRAIN + "gain_tolerance = 0.1\n", {}, "is a strain, whose gain nobody knows, and has a gain_tolerance"),
        (FORCE + 'quantity = "travel"\n', {}, "has the quantity 'travel'"),
        (FORCE + "corner_hz = 0.1\n", {}, "reads a force and states corner_hz, which is that of another sensor"),
        (FORCE + "noise_m = 0.1\n", {}, "states noise_m, which is that of another sensor"),
        (
            '[channels]\nunsprung = "lower_z"\n[channels.sprung]\nchannel = "load"\nquantity = "force"\n',
            {},
            "reads a force and stands for an acceleration: name it as the channel force",
        ),
    ],
)
def test_bad_tables_are_refused(tmp_path, taxi_runs, channels, options, words):
    with pytest.raises(opid.InputError, match=words):
        opid.read_study(write(tmp_path, taxi_runs, channels, **options))


def test_a_channel_that_is_no_force_of_the_strut_is_refused(tmp_path, taxi_runs):
    study = opid.read_study(write(tmp_path, taxi_runs, FORCE))
    run = study.runs[0]
    samples = run.recording.samples.copy()
    samples[:, run.recording.index("force")] = np.random.default_rng(0).standard_normal(len(samples))
    with pytest.raises(opid.InputError, match="is hardly the force in this strut"):
        replace(study, runs=(replace(run, recording=replace(run.recording, samples=samples)), study.runs[1]))


@pytest.mark.parametrize("spoil", ["spike", "hum"])
def test_a_force_with_a_spike_or_a_hum_is_read(tmp_path, taxi_runs, spoil):
    """One sample far off, and a hum of three times the force at 100 Hz, say nothing against a sensor of a force."""
    study = opid.read_study(write(tmp_path, taxi_runs, FORCE))
    runs = []
    for run in study.runs:
        samples, channel = run.recording.samples.copy(), run.recording.index("force")
        rms = samples[:, channel].std()
        if spoil == "spike":
            samples[1000, channel] = 1e4 * rms
        else:
            samples[:, channel] += 3 * rms * np.sin(200 * np.pi * np.arange(len(samples)) / run.recording.fs)
        runs.append(replace(run, recording=replace(run.recording, samples=samples)))
    spoilt = replace(study, runs=tuple(runs), strut_scales=())
    assert spoilt.strut_scales[0] == pytest.approx(study.strut_scales[0], rel=0.05)


@pytest.mark.parametrize(
    "channels",
    [
        FORCE + "gain_tolerance = 0.02\n",
        FORCE + "gain_tolerance = 0.0\ngain_repeatability = 0.0\nlag_tolerance_s = 0.0\n",
        STRAIN + "gain_repeatability = 0.01\n",
    ],
)
def test_a_study_with_a_force_is_written_and_read_back(tmp_path, taxi_runs, channels):
    study = opid.read_study(write(tmp_path, taxi_runs, channels))
    (tmp_path / "again").mkdir()
    opid.write_study(study, tmp_path / "again" / "study.toml")
    again = opid.read_study(tmp_path / "again" / "study.toml")
    assert again.interfaces[0].force == replace(study.interfaces[0].force, channel=again.forces[0].channel)
    one, other = (each.runs[0].recording.channel(each.forces[0].channel) for each in (study, again))
    np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("channels", [FORCE, STRAIN])
def test_derivatives_of_the_model_are_those_of_differences(tmp_path, taxi_runs, channels):
    """Up to those of the gain of the filter, which prediction errors multiply."""
    fit = identify(write(tmp_path, taxi_runs, channels)).evidence[0].fit
    assert len(fit.model.scales) == (channels == FORCE)
    exact = fit.model.evaluate(fit.theta).jacobian
    for index, step in enumerate(1e-6 * np.maximum(np.abs(fit.theta), 1e-3)):
        ahead, behind = fit.theta.copy(), fit.theta.copy()
        ahead[index] += step
        behind[index] -= step
        stacked = [fit.model.evaluate(each, sensitivity=False).stacked for each in (ahead, behind)]
        slope = (stacked[0] - stacked[1]) / (2 * step)
        assert np.linalg.norm(exact[:, index] - slope) < 0.1 * np.linalg.norm(slope), fit.model.names[index]


def test_a_force_is_sensed(tmp_path, taxi_runs):
    study = opid.read_study(write(tmp_path, taxi_runs, FORCE))
    found = sense(study, identify(study.source), "heavy", settings=SensingSettings(n_draws=40))
    assert np.isfinite(found.sensor("strut_force").std).all()
    travel = found.sensor("travel").value
    error = travel - taxi_runs[0].runs[0].truth.channel("travel")[: travel.size]
    assert np.std(error) < 5e-4


def test_a_run_is_sensed_with_its_own_gain(tmp_path, taxi_runs):
    """The gain of the second run is 5 % above that of the first."""
    channels = STRAIN + "gain_repeatability = 0.05\n"
    study = opid.read_study(write(tmp_path, taxi_runs, channels, gains=(1.0, 1.05)))
    result = identify(study.source)
    for name in ("heavy", "light"):
        found = sense(study, result, name, settings=SensingSettings(n_draws=20))
        assert found.over_noise[0] < 1.1
        assert not found.warnings


def test_a_written_result_is_sensed(tmp_path, taxi_runs):
    """An unknown gain is kept in result.json, and so is what the sensor reads for 1 N."""
    study = opid.read_study(write(tmp_path, taxi_runs, STRAIN))
    result = identify(study.source)
    opid.write_report(result, tmp_path / "out", figures=False)
    written = json.loads((tmp_path / "out" / "result.json").read_text())
    assert written["diagnostics"]["model"]["gains_of_forces"]["force"]["value"] == pytest.approx(1.0, abs=0.05)
    found = sense(study, read_fits(tmp_path / "out"), "light", settings=SensingSettings(n_draws=20))
    assert found.over_noise[0] < 1.1
    text = opid.text(result)
    assert "force, reading for 1 N" in text
    assert result.parameters.ground_stiffness_n_per_m.std is None


def test_forces_need_the_springs_that_they_measure(tmp_path, taxi_runs):
    """No spring to the ground is tried beside a force, because its sensor would not carry it."""
    result = identify(write(tmp_path, taxi_runs, FORCE))
    assert not result.evidence[0].fit.model.ground
    assert result.parameters.ground_stiffness_n_per_m.value in (None, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(("channels", "n_runs"), [(FORCE, 1), (FORCE, 2), (STRAIN, 2)])
def test_a_plan_knows_that_gains_differ_between_runs(tmp_path, unlike_runs, channels, n_runs):
    result = identify(write(tmp_path, unlike_runs, channels, n_runs=n_runs))
    flown = (PlannedRun(24.0), PlannedRun(24.0, -REMOVED_KG))[:n_runs]
    searched = SearchSpace((24.0,), (-REMOVED_KG,), (1,))
    for runs in (None, flown):
        planned = plan_runs(result, ["sprung_mass=50%"], search=searched, runs=runs).planned
        std = planned.std_of("sprung_mass_kg")
        assert std == pytest.approx(result.parameters.sprung_mass_kg.std, rel=0.05 if n_runs == 1 else 0.25)


# ---- a body on several gears ------------------------------------------------------------------------

NAMES = ("nose", "left", "right")
TRAVELS_ALONE = '[channels.{0}_lower_z]\nchannel = "{0}_pot"\nquantity = "travel"\n'
FORCES = "[channels.{0}_load]\ngain_tolerance = 0.003\n[channels.{0}_upper_z]\ngain_tolerance = 0.003\n"


def write_aircraft(directory, interfaces, tables, *, n_runs=2):
    """Simulate an aircraft on three gears with potentiometers and load cells, and write its study; return its path."""
    rng = np.random.default_rng(4)
    aircraft = default_aircraft()
    test = taxi_test(aircraft, rng=rng, duration_s=14.0, fs=256.0, loadings=[[PointMass(500.0, -1.0, 0.2)]])
    study = taxi_study(test, title="Three struts")
    text = '[structure]\nkind = "rigid_body"\n'
    for each in study.interfaces:
        text += f'[[interfaces]]\nname = "{each.name}"\nx_m = {each.x_m}\ny_m = {each.y_m}\n'
        text += f'sprung = "{each.sprung}"\nunsprung = "{each.unsprung}"\n' + interfaces.format(each.name)
    text += "".join(tables.format(name) for name in NAMES)
    for run, made in [*zip(study.runs, test.runs, strict=True)][:n_runs]:
        recording = run.recording
        columns, channels = [*recording.samples.T], [*recording.channels]
        for name, gear in zip(NAMES, aircraft.gears, strict=True):
            z, v = made.truth.channel(f"{name}_travel"), made.truth.channel(f"{name}_travel_velocity")
            load = -gear.suspension_stiffness_n_per_m * z - gear.suspension_damping_n_s_per_m * v - gear.law.force(z, v)
            columns += [z + 1e-4 * rng.standard_normal(z.size), load + 20 * rng.standard_normal(z.size)]
            channels += [Channel(f"{name}_pot", "m"), Channel(f"{name}_load", "N")]
        write_log(Recording(np.stack(columns, axis=1), recording.fs, tuple(channels)), directory / f"{run.name}.csv")
        loading = [[each.mass_kg, each.x_m, each.y_m] for each in run.masses]
        text += f'[[runs]]\nname = "{run.name}"\nlog = "{run.name}.csv"\nstart_s = 0\nloading = {loading}\n'
    (directory / "study.toml").write_text(text)
    return directory / "study.toml"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("interfaces", "tables", "n_runs"),
    [
        ("", TRAVELS_ALONE, 2),
        ('travel = "{0}_pot"\n', "", 2),
        ('force = "{0}_load"\n', FORCES, 1),
    ],
    ids=["travels alone", "travels beside", "load cells, one run"],
)
def test_struts_of_an_aircraft_are_read(tmp_path, interfaces, tables, n_runs):
    study = opid.read_study(write_aircraft(tmp_path, interfaces, tables, n_runs=n_runs))
    assert len(study.strut_sensors) == 3
    result = opid.identify(study, law="arctan_velocity")
    mass = result.parameters.sprung_mass_kg
    assert abs(mass.value - 5400.0) < 3 * mass.std
    assert mass.std < 0.012 * 5400
    for interface, gear in zip(result.interfaces, default_aircraft().gears, strict=True):
        estimate = interface.stiffness
        assert abs(estimate.value - gear.suspension_stiffness_n_per_m) < 3.5 * estimate.std


@pytest.mark.slow
@pytest.mark.parametrize("n_runs", [1, 2])
def test_one_wrong_cell_of_three_gives_no_wrong_mass(tmp_path, n_runs):
    """With one run nothing says which of them is wrong; with two the changes of mass do."""
    path = write_aircraft(tmp_path, 'force = "{0}_load"\n', FORCES, n_runs=n_runs)
    path.write_text(path.read_text().replace("[channels.nose_load]\n", "[channels.nose_load]\nscale = 0.85\n"))
    result = opid.identify(opid.read_study(path), law="arctan_velocity")
    if n_runs == 1:
        assert result.parameters.sprung_mass_kg.value is None
        assert "the forces in the struts contradict each other" in result.not_determined
        assert "'nose_load' reads 0.9" in result.not_determined
        return
    mass = result.parameters.sprung_mass_kg
    assert abs(mass.value - 5400.0) < 3 * mass.std
    assert mass.std < 0.006 * 5400
    (said,) = [each for each in result.warnings if "is not used for the mass" in each]
    assert "the force (channel 'nose_load') contradicts the changes of mass" in said


@pytest.mark.parametrize(("interfaces", "tables"), [("", TRAVELS_ALONE), ('force = "{0}_load"\n', FORCES)])
def test_an_aircraft_with_sensors_of_struts_is_written_and_read_back(tmp_path, interfaces, tables):
    study = opid.read_study(write_aircraft(tmp_path, interfaces, tables))
    (tmp_path / "again").mkdir()
    opid.write_study(study, tmp_path / "again" / "study.toml")
    again = opid.read_study(tmp_path / "again" / "study.toml")
    assert again.is_driven == study.is_driven
    for side in ("unsprung", "sprung"):
        for one, other in zip(study.channels(side), again.channels(side), strict=True):
            first, second = (each.runs[0].recording.channel(name) for each, name in ((study, one), (again, other)))
            np.testing.assert_allclose(first, second, rtol=1e-5, atol=1e-4)


def test_travels_stand_for_all_sensors_below_or_for_none(tmp_path):
    path = write_aircraft(tmp_path, "", "")
    path.write_text(path.read_text() + TRAVELS_ALONE.format("nose"))
    with pytest.raises(opid.InputError, match="give travels in the place of all of them, or of none"):
        opid.read_study(path)


def test_a_pair_with_sensors_of_struts_is_not_averaged(tmp_path):
    path = write_aircraft(tmp_path, 'travel = "{0}_pot"\n', "")
    path.write_text(path.read_text().replace("rigid_body", "pair"))
    result = opid.identify(opid.read_study(path), law="arctan_velocity")
    assert any("that of no gear" in each.why for each in result.candidates)
