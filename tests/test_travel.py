"""A sensor of the travel: in the place of one below the suspension, beside it, and with faults."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate

import opid
from opid.signals.logs import write_log
from opid.signals.recording import Channel, Recording
from opid.studies.suspension_study import read_further_run
from opid.suspensions.sensing.settings import SensingSettings
from opid.suspensions.sensing.virtual_sensors import sense
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_test

TRUE_KG, NOISE_M = 1850.0, 1e-4
EXACT = "gain_tolerance = 0.0\nlag_tolerance_s = 0.0\n"
ALONE = '[channels]\nsprung = "upper_z"\n[channels.unsprung]\nchannel = "pot"\nquantity = "travel"\n'
BOTH = '[channels]\nsprung = "upper_z"\nunsprung = "lower_z"\n[channels.travel]\nchannel = "pot"\n'


@pytest.fixture(scope="module")
def test_runs():
    """Two virtual taxi runs, and the noise of a potentiometer in each."""
    rng = np.random.default_rng(5)
    test = taxi_test(LandingGear(), rng=rng, duration_s=24.0, fs=256.0, mass_removed_kg=220.0)
    return test, [rng.standard_normal(run.recording.n_samples) for run in test.runs]


def write(directory, test_runs, channels, *, factor=1.0, later_s=0.0, noise_m=NOISE_M, head="repeatability = 0\n"):
    """Write logs with a potentiometer, and the study file with some [channels]; return its path."""
    test, noises = test_runs
    tables = ""
    for run, noise, name, change in zip(test.runs, noises, ("heavy", "light"), (0.0, -220.0), strict=True):
        recording, fs = run.recording, run.recording.fs
        time_s = np.arange(noise.size) / fs
        travel = np.interp(time_s - later_s, time_s, run.truth.channel("travel")) + noise_m * noise
        columns = [recording.channel("lower_z"), recording.channel("upper_z"), factor * travel]
        units = {"lower_z": "m/s^2", "upper_z": "m/s^2", "pot": "m"}
        whole = Recording(np.stack(columns, axis=1), fs, tuple(Channel(*each) for each in units.items()))
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


def test_travel_and_airframe_give_the_mass(tmp_path, test_runs):
    result = identify(write(tmp_path, test_runs, ALONE + EXACT))
    assert assert_holds(result).std < 0.01 * TRUE_KG
    assert abs(result.parameters.suspension_stiffness_n_per_m.value / 3.9e5 - 1) < 0.02
    assert result.residual_over_noise == pytest.approx(1.0, abs=0.1)
    text = " ".join(opid.text(result).split())
    assert "from the travel and the acceleration above" in text
    assert re.search(r"the model predicts the travel to 0\.(1|099) mm rms", text)


def test_the_law_is_found_from_travel(tmp_path, test_runs):
    result = opid.identify(opid.read_study(write(tmp_path, test_runs, ALONE)))
    assert result.law.name == "arctan_velocity"
    assert_holds(result)


def test_a_travel_beside_both_sensors_is_read_too(tmp_path, test_runs):
    result = identify(write(tmp_path, test_runs, BOTH))
    (tmp_path / "without").mkdir()
    without = identify(write(tmp_path / "without", test_runs, BOTH.split("[channels.travel]")[0]))
    assert assert_holds(result).std < 1.25 * without.parameters.sprung_mass_kg.std
    stiffness, alone = (each.parameters.suspension_stiffness_n_per_m for each in (result, without))
    assert stiffness.std < 1.25 * alone.std


@pytest.mark.parametrize("head", ["repeatability = 0\n", ""])
def test_a_travel_of_which_nothing_is_stated_has_the_usual_tolerances(tmp_path, test_runs, head):
    """One per cent of gain is one of stiffness, and a lag of half a millisecond passes for damping."""
    late = {"later_s": 0.0005, "factor": 1.01, "head": head}
    result = identify(write(tmp_path, test_runs, ALONE, **late))
    assert_holds(result)
    stiffness, damping = result.parameters.suspension_stiffness_n_per_m, result.parameters.suspension_damping_n_s_per_m
    assert stiffness.std > 0.0095 * 3.9e5
    assert abs(stiffness.value - 3.9e5) < 3 * stiffness.std
    assert damping.std > 50.0
    assert abs(damping.value - 6e3) < 3 * damping.std


def test_a_stated_lag_and_gain_widen_the_intervals(tmp_path, test_runs):
    """A lag of the travel passes for damping, and a gain for stiffness: where they are stated, the intervals hold."""
    late = {"later_s": 0.001, "factor": 1.02}
    path = write(tmp_path, test_runs, ALONE + "lag_tolerance_s = 0.001\ngain_tolerance = 0.02\n", **late)
    result = identify(path)
    assert_holds(result)
    for estimate, true in (
        (result.parameters.suspension_damping_n_s_per_m, 6e3),
        (result.parameters.suspension_stiffness_n_per_m, 3.9e5),
    ):
        assert abs(estimate.value - true) < 3 * estimate.std
    assert result.parameters.suspension_stiffness_n_per_m.std > 0.01 * 3.9e5


def test_a_stated_noise_is_taken(tmp_path, test_runs):
    result = identify(write(tmp_path, test_runs, ALONE + "noise_m = 2e-4\n"))
    assert result.residual_over_noise < 0.7


@pytest.mark.slow
def test_a_coarse_encoder_widens_the_interval(tmp_path, test_runs):
    """Steps of 1 mm are a noise of 0.29 mm."""
    test, noises = test_runs
    fine = identify(write(tmp_path, test_runs, ALONE)).parameters.sprung_mass_kg
    path = write(tmp_path, (test, noises), ALONE, noise_m=0.0)
    for name in ("heavy", "light"):
        log = opid.read_log(tmp_path / f"{name}.csv")
        samples = log.samples.copy()
        samples[:, 2] = 1e-3 * np.round(1e3 * samples[:, 2])
        write_log(Recording(samples, log.fs, log.channels), tmp_path / f"{name}.csv")
    coarse = assert_holds(identify(path))
    assert coarse.std > 1.5 * fine.std


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (-1.0, "run 'heavy', channel 'unsprung': it grows where the acceleration above does, .* give sign = -1"),
        (1e3, "which no suspension has: check its unit and scale"),
    ],
)
def test_a_wrong_direction_or_unit_is_refused(tmp_path, test_runs, factor, words):
    with pytest.raises(opid.InputError, match=words):
        opid.read_study(write(tmp_path, test_runs, ALONE, factor=factor))


@pytest.mark.parametrize(
    ("channels", "words"),
    [
        ('[channels]\nsprung = "upper_z"\nunsprung = "pot"\n', "give quantity = 'displacement' .* or 'travel'"),
        (
            '[channels]\nunsprung = "lower_z"\n[channels.sprung]\nchannel = "pot"\nquantity = "travel"\n',
            "stands for the sensor on the body: name it as the channel unsprung",
        ),
        (
            BOTH.replace('travel]\nchannel = "pot"', 'travel]\nunit = "g"\nchannel = "pot"'),
            "its quantity is 'travel' and its unit",
        ),
        (ALONE.replace('quantity = "travel"', 'quantity = "way"'), "quantity"),
        (ALONE + "corner_hz = 0.1\n", "states corner_hz, which is that of another sensor"),
        (ALONE + '[channels.travel]\nchannel = "pot"\n', "both channel 'pot'|both read the travel"),
        (BOTH + 'quantity = "displacement"\n', "has the quantity 'displacement'"),
        (
            ALONE.replace('quantity = "travel"', 'quantity = "displacement"\nnoise_m = 1e-4'),
            "noise_m is given, which belongs",
        ),
    ],
)  # fmt: skip
def test_bad_tables_are_refused(tmp_path, test_runs, channels, words):
    with pytest.raises(opid.InputError, match=words):
        opid.read_study(write(tmp_path, test_runs, channels))


def test_a_study_with_travel_is_written_and_read_back(tmp_path, test_runs):
    for number, channels in enumerate((ALONE, BOTH)):
        (tmp_path / f"{number}").mkdir()
        study = opid.read_study(write(tmp_path, test_runs, channels))
        opid.write_study(study, tmp_path / f"{number}" / "again.toml")
        again = opid.read_study(tmp_path / f"{number}" / "again.toml")
        assert again.is_driven == study.is_driven
        for side in ("sprung", "unsprung"):
            for one, other in zip(study.channels(side), again.channels(side), strict=True):
                assert np.allclose(
                    study.runs[0].recording.channel(one), again.runs[0].recording.channel(other), atol=1e-5
                )


@pytest.mark.parametrize("channels", [ALONE, BOTH])
def test_derivatives_of_the_model_are_those_of_differences(tmp_path, test_runs, channels):
    """Up to those of the gain of the filter, which prediction errors multiply."""
    fit = identify(write(tmp_path, test_runs, channels)).evidence[0].fit
    exact = fit.model.evaluate(fit.theta).jacobian
    for index, step in enumerate(1e-6 * np.maximum(np.abs(fit.theta), 1e-3)):
        ahead, behind = fit.theta.copy(), fit.theta.copy()
        ahead[index] += step
        behind[index] -= step
        stacked = [fit.model.evaluate(each, sensitivity=False).stacked for each in (ahead, behind)]
        slope = (stacked[0] - stacked[1]) / (2 * step)
        assert np.linalg.norm(exact[:, index] - slope) < 0.1 * np.linalg.norm(slope)


@pytest.mark.parametrize("method", ["classical", "paper"])
def test_the_chain_of_the_paper_needs_a_sensor_below(tmp_path, test_runs, method):
    study = opid.read_study(write(tmp_path, test_runs, ALONE))
    with pytest.raises(opid.InputError, match="here it follows from the travel: leave the method out"):
        opid.identify(study, method=method)


def test_a_further_log_is_refused(tmp_path, test_runs):
    study = opid.read_study(write(tmp_path, test_runs, ALONE))
    with pytest.raises(opid.InputError, match="add the log to it as a run"):
        read_further_run(study, tmp_path / "light.csv")


def test_the_axis_down_turns_the_travel_too(tmp_path, test_runs):
    """All channels count downward: a travel then counts compression."""
    below = ALONE.partition('"upper_z"\n')[2]
    turned = '[channels.sprung]\nchannel = "upper_z"\nsign = -1\n' + below + "sign = -1\n"
    assert_holds(identify(write(tmp_path, test_runs, 'axis = "down"\n' + turned)))


def test_a_pushed_run_is_sensed(tmp_path, test_runs):
    """An unmeasured force moves the body and no sensor of the travel."""
    test, noises = test_runs
    study = opid.read_study(write(tmp_path, (test, noises), BOTH))
    result, run = opid.identify(study, law="arctan_velocity"), study.runs[0]
    samples = run.recording.samples.copy()
    pushed = 0.05 * np.random.default_rng(3).standard_normal(len(samples))
    samples[:, run.recording.index("upper_z")] += pushed
    further = replace(run, name="pushed", recording=replace(run.recording, samples=samples))
    found = sense(study, result, further, settings=SensingSettings(n_draws=20))
    assert np.isfinite(found.sensor("travel").value).all()
    assert np.isfinite(found.sensor("strut_force").std).all()


def test_wheel_and_tyre_need_a_sensor_below(tmp_path, test_runs):
    study = opid.read_study(write(tmp_path, test_runs, ALONE))
    with pytest.raises(opid.InputError, match="here it was derived from the travel: give runs with a sensor there"):
        opid.suspensions.identify_wheel(study, opid.identify(study, law="arctan_velocity"))


@pytest.mark.parametrize("channels", [ALONE, BOTH])
def test_virtual_sensors_smooth_the_travel(tmp_path, test_runs, channels):
    study = opid.read_study(write(tmp_path, test_runs, channels))
    found = sense(study, opid.identify(study, law="arctan_velocity"), "heavy", settings=SensingSettings(n_draws=40))
    travel = found.sensor("travel")
    error = travel.value - test_runs[0].runs[0].truth.channel("travel")[: travel.value.size]
    assert np.std(error) < 0.2 * NOISE_M
    assert np.mean(np.abs(error) < 1.96 * travel.std) > 0.88
    assert np.mean(travel.std) < 0.3 * NOISE_M


def test_velocities_are_differentiated(tmp_path, test_runs):
    """Two geophones: their noise of 0.02 mm/s bounds the band, and the interval holds."""
    tables, rng = "", np.random.default_rng(8)
    for run, name, change in zip(test_runs[0].runs, ("heavy", "light"), (0.0, -220.0), strict=True):
        fs, columns = run.recording.fs, []
        for channel in ("lower_z", "upper_z"):
            velocity = integrate.cumulative_trapezoid(run.truth.channel(channel), dx=1 / fs, initial=0.0)
            columns.append(velocity + 2e-5 * rng.standard_normal(velocity.size))
        channels = tuple(Channel(each, "m/s") for each in ("lower", "upper"))
        write_log(Recording(np.stack(columns, axis=1), fs, channels), tmp_path / f"{name}.csv")
        tables += f'[[runs]]\nname = "{name}"\nlog = "{name}.csv"\nmass_change_kg = {change}\nstart_s = 0\n'
    head = 'repeatability = 0\n[channels]\nsprung = "upper"\nunsprung = "lower"\n'
    (tmp_path / "study.toml").write_text(head + tables)
    study = opid.read_study(tmp_path / "study.toml")
    assert 10.0 < study.runs[0].highest_hz < 80.0
    assert 0.001 < study.interfaces[0].facts.sprung.noise_m_per_s2 < 0.02
    result = opid.identify(study, law="arctan_velocity")
    assert result.runs[0].frequency_hz[-1] <= study.runs[0].highest_hz
    assert_holds(result)


# ---- the pressure of the gas ------------------------------------------------------------------------

GAS = 'channel = "pot"\nquantity = "pressure"\ngas_length_m = 0.3\n'
GAS_ALONE = '[channels]\nsprung = "upper_z"\n[channels.unsprung]\n' + GAS
GAS_BESIDE = '[channels]\nsprung = "upper_z"\nunsprung = "lower_z"\n[channels.travel]\n' + GAS


def write_pressures(directory, test_runs, channels, *, exponent=1.2, length_m=0.3, warmer=1.0, outside_pa=0.0):
    """Write logs with the pressure of gas in the strut, and their study; return its path."""
    path = write(directory, test_runs, channels, noise_m=0.0)
    for run, noise, name, factor in zip(
        test_runs[0].runs, test_runs[1], ("heavy", "light"), (1.0, warmer), strict=True
    ):
        log = opid.read_log(directory / f"{name}.csv")
        pressure = 2e6 * factor * (1 + run.truth.channel("travel") / length_m) ** -exponent + 1e3 * noise
        samples = np.column_stack([log.samples[:, :2], pressure - outside_pa])
        channels = (*log.channels[:2], Channel("pot", "Pa"))
        write_log(Recording(samples, log.fs, channels), directory / f"{name}.csv")
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    "world",
    [{}, {"exponent": 1.1}, {"length_m": 0.33}, {"warmer": 1.033}],
    ids=["as stated", "another exponent", "more gas", "10 K warmer"],
)
@pytest.mark.parametrize("channels", [GAS_ALONE, GAS_BESIDE], ids=["alone", "beside"])
def test_intervals_hold_where_the_gas_is_another(tmp_path, test_runs, channels, world):
    """Ten kelvin between the runs look like a quarter of the mass if the pressure stands for the sensor below."""
    result = identify(write_pressures(tmp_path, test_runs, channels, **world))
    mass, stiffness = assert_holds(result), result.parameters.suspension_stiffness_n_per_m
    assert abs(stiffness.value - 3.9e5) < 3 * stiffness.std
    assert (mass.std > 0.05 * TRUE_KG) == (channels == GAS_ALONE)


@pytest.mark.parametrize(
    ("channels", "options", "words"),
    [
        (GAS_BESIDE, {"outside_pa": 2e6}, "absolute pressures are positive: give offset = 101325"),
        (GAS_BESIDE.replace("gas_length_m = 0.3\n", ""), {}, "gas_length_m is missing: give the length of the gas"),
        (GAS_BESIDE.replace("0.3", "-0.3"), {}, "gas_length_m is -0.3: give a positive number"),
        (BOTH + "gas_length_m = 0.3\n", {}, "gas_length_m is given, which belongs to quantity = 'pressure'"),
        (GAS_BESIDE + 'unit = "m"\n', {}, "its quantity is 'pressure' and its unit is m|another unit|states"),
    ],
)
def test_bad_pressures_are_refused(tmp_path, test_runs, channels, options, words):
    with pytest.raises(opid.InputError, match=words):
        opid.read_study(write_pressures(tmp_path, test_runs, channels, **options))


def test_a_pressure_counts_as_the_accelerations_do(tmp_path, test_runs):
    """Gas that expands extends the strut, which is the negative direction where the axis is 'down'."""
    turned = 'axis = "down"\n[channels]\n' + "".join(
        f'{side} = {{ channel = "{channel}", sign = -1 }}\n'
        for side, channel in (("sprung", "upper_z"), ("unsprung", "lower_z"))
    )
    masses = []
    for name, channels in (("up", GAS_BESIDE), ("down", turned + "[channels.travel]\n" + GAS)):
        (tmp_path / name).mkdir()
        masses.append(identify(write_pressures(tmp_path / name, test_runs, channels)).parameters.sprung_mass_kg)
    assert masses[1].value == pytest.approx(masses[0].value, rel=1e-3)
    assert masses[1].std == pytest.approx(masses[0].std, rel=1e-2)
