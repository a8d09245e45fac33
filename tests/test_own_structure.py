"""A user's own structure: masses, joints, suspensions and their laws, found from virtual runs with known truth."""

from dataclasses import replace

import numpy as np
import pytest

from opid.errors import InputError, NotDeterminedError
from opid.estimate import Estimate
from opid.mechanics.driven import Interface
from opid.mechanics.laws.law import law
from opid.mechanics.response import time_response
from opid.mechanics.structure import Joint, Structure
from opid.mechanics.weight import GRAVITY_M_PER_S2, laws_at_rest
from opid.signals.recording import Channel, Recording, recording_from_arrays
from opid.suspensions.law_search import driven as driven_laws
from opid.suspensions.own_structure import identify_structure
from opid.virtual.taxi_tests.sensors import decimate

FS, SECONDS, STEPS, NOISE = 256.0, 12.0, 4, 5e-3
LOW_KG, HIGH_KG = 300.0, 180.0
SPRING, DAMPER = 1.2e5, 1.1e3
FRICTION = law("arctan_velocity", amplitude_n=120.0, scale_m_per_s=0.02)
INNER = Joint("inner", (-1, 1), 3.5e5, 500.0)
NAMES = ("low", "high")


def machine(more_high=0.0, *, joints=(INNER,), low_kg=LOW_KG, high_kg=HIGH_KG):
    """Two masses, one above the other."""
    none = np.zeros((2, 2))
    return Structure(np.diag([low_kg, high_kg + more_high]), none, none, joints, NAMES)


ISOLATOR = Joint("isolator", (1, 0), SPRING, DAMPER, FRICTION)


def shaken(structure, seed, isolator=ISOLATOR):
    """What sensors on the floor and on the machine read while the floor shakes it, m/s^2."""
    rng = np.random.default_rng(seed)
    t = np.arange(2 * STEPS * round(FS * SECONDS)) / (2 * STEPS * FS)
    frequency, phase = rng.uniform(0.8, 18.0, 60), rng.uniform(0, 2 * np.pi, 60)
    # acceleration of the floor: the machine is followed as it moves against it
    floor = 0.35 * np.sum(np.sin(2 * np.pi * np.outer(t, frequency) + phase), axis=1)
    moving = replace(structure, joints=(isolator, *structure.joints))
    force = -np.outer(floor, np.diag(structure.mass))[:-1]
    motion = time_response(moving, force, fs=STEPS * FS, duration_s=SECONDS)
    ground = floor[::2][: len(motion.time_s), np.newaxis]
    true = decimate(np.hstack([ground, motion.acceleration + ground]), STEPS)
    readings = true + NOISE * rng.standard_normal(true.shape)
    return recording_from_arrays([*readings.T], ["floor", *NAMES], fs=FS)


@pytest.fixture(scope="module")
def runs():
    """As it stands, and with 60 kg on top."""
    return shaken(machine(), 1), shaken(machine(60.0), 2)


WHERE = {"interfaces": {"low": "floor"}, "sensors": {"low": "low", "high": "high"}, "noise_m_per_s2": NOISE}


def near(estimate, truth, fraction=0.05):
    return abs(estimate.value - truth) < 4 * estimate.std and estimate.std < fraction * abs(truth)


def check_springs(found, per=1.0):
    isolator, inner = found.interfaces["low"], found.joints["inner"]
    assert near(isolator.stiffness, SPRING / per)
    assert near(isolator.damping, DAMPER / per)
    assert near(isolator.law_estimates["arctan_velocity"]["amplitude_n"], 120.0 / per, 0.1)
    assert near(inner.stiffness, 3.5e5 / per)
    assert near(inner.damping, 500.0 / per, 0.1)


def test_with_known_masses_one_run_gives_everything_in_newtons(runs):
    unknown = replace(INNER, stiffness_n_per_m=0.0, damping_n_s_per_m=0.0)
    found = identify_structure(machine(joints=(unknown,)), runs[:1], unknown=["inner"], law="arctan_velocity", **WHERE)
    check_springs(found)
    assert found.masses == {}
    assert not found.per_mass
    assert found.not_determined is None
    assert found.warnings == ()
    assert found.residual_over_noise == pytest.approx(1.0, abs=0.05)
    assert set(found.residual_of) == set(NAMES)
    assert found.left_out_over_noise is None
    isolator = found.interfaces["low"]
    assert isolator.law.parameters["arctan_velocity"]["amplitude_n"] == pytest.approx(120.0, rel=0.1)
    assert isolator.travel.shape == isolator.velocity.shape
    assert found.joints["inner"].law.name == "linear"
    assert 0 < found.joints["inner"].travel.std() < isolator.travel.std()


def test_the_law_is_searched(runs):
    steps = []
    found = identify_structure(machine(), runs[:1], progress=steps.append, **WHERE)
    assert "arctan_velocity" in found.interfaces["low"].law.name
    assert near(found.interfaces["low"].stiffness, SPRING)
    assert found.joints == {}
    assert isinstance(steps, list)


def test_loadings_give_unknown_masses(runs):
    """What the matrices say of what is unknown is not used."""
    guess = machine(low_kg=1.0, high_kg=9e3, joints=(replace(INNER, stiffness_n_per_m=1.0),))
    found = identify_structure(
        guess, runs, unknown=["inner"], unknown_mass=["low", "high"], loadings=[{}, {"high": 60.0}],
        law="arctan_velocity", **WHERE,
    )  # fmt: skip
    assert near(found.masses["low"], LOW_KG)
    assert near(found.masses["high"], HIGH_KG)
    check_springs(found)
    assert found.left_out_over_noise == pytest.approx(1.0, abs=0.1)


def test_loadings_of_the_wrong_sign_give_no_negative_springs(runs):
    """Ratios hold all the same."""
    found = identify_structure(
        machine(), runs, unknown=["inner"], unknown_mass=["high", "low"], loadings=[{}, {"high": -60.0}],
        law="arctan_velocity", **WHERE,
    )  # fmt: skip
    assert found.not_determined.startswith("the mass of high would be negative: check the signs of the loadings")
    assert found.per_mass
    assert found.masses["high"] == Estimate(1.0)
    assert near(found.masses["low"], LOW_KG / HIGH_KG)
    check_springs(found, per=HIGH_KG)
    amplitude = found.interfaces["low"].law.parameters["arctan_velocity"]["amplitude_n"]
    assert amplitude == pytest.approx(120.0 / HIGH_KG, rel=0.1)


def test_a_loaded_structure_rests_where_its_weight_puts_it():
    """The isolator is 40 % stiffer under 120 kg; without an axis that is taken for another mass."""
    hardening = law("cubic_stiffness", stiffness_n_per_m3=2e8)
    isolator = replace(ISOLATOR, law=hardening)
    suspensions = [
        Interface(SPRING, DAMPER, law=hardening),
        Interface(INNER.stiffness_n_per_m, INNER.damping_n_s_per_m),
    ]
    load = np.array([0.0, -120.0 * GRAVITY_M_PER_S2])
    loaded = replace(isolator, law=laws_at_rest(suspensions, np.array([[1.0, 0.0], [-1.0, 1.0]]), load)[0])
    runs = shaken(machine(), 1, isolator), shaken(machine(120.0), 2, loaded)
    given = WHERE | {"unknown_mass": ["low", "high"], "loadings": [{}, {"high": 120.0}], "law": "cubic_stiffness"}
    found = identify_structure(machine(), runs, axis="up", **given)
    assert near(found.masses["low"], LOW_KG)
    assert near(found.masses["high"], HIGH_KG)
    assert found.residual_over_noise == pytest.approx(1.0, abs=0.05)
    assert not any("no `axis` is given" in each for each in found.warnings)
    first, second = found.interfaces["low"].at_rest
    assert first.travel_m.value == 0.0
    assert near(second.travel_m, loaded.law.rest_m)
    assert near(second.stiffness, SPRING + 6e8 * loaded.law.rest_m**2)
    assert found.joints["inner"].at_rest == () if found.joints else True
    named = identify_structure(machine(), runs, axis={"low": "up", "high": "up"}, **given)
    assert named.masses["high"] == found.masses["high"]
    flat = identify_structure(machine(), runs, **given)
    assert flat.residual_over_noise > 1.2 * found.residual_over_noise
    assert any(each.startswith("no `axis` is given, so no weight acts") for each in flat.warnings)
    level = identify_structure(machine(), runs, axis="horizontal", **given)
    assert not any("no `axis` is given" in each for each in level.warnings)


def test_channels_that_look_exchanged_are_said(runs):
    exchanged = {"interfaces": {"low": "low"}, "sensors": {"low": "floor", "high": "high"}}
    found = identify_structure(machine(), runs[:1], law="linear", **WHERE | exchanged)
    assert any(each.startswith("run '1', 'low'") and "exchange sprung and unsprung" in each for each in found.warnings)
    mute = recording_from_arrays([runs[0].channel("floor"), np.zeros(runs[0].n_samples)], ["floor", "low"], fs=FS)
    with pytest.raises(InputError, match=r"run '1': the channel 'low' is mute"):
        identify_structure(machine(), [mute], **WHERE | {"sensors": {"low": "low"}})


def test_an_exponent_that_gas_does_not_have_is_doubted_at_its_suspension():
    gas = law("gas_column", static_force_n=(LOW_KG + HIGH_KG) * GRAVITY_M_PER_S2, gas_length_m=0.07, exponent=2.0)
    run = shaken(machine(), 1, replace(ISOLATOR, stiffness_n_per_m=0.0, law=gas))
    found = identify_structure(machine(), [run], law="gas_column", axis="up", **WHERE)
    assert found.interfaces["low"].law_estimates["gas_column"]["exponent"].value > 1.4
    assert any(each.startswith("at 'low': the exponent") and "is unusual for gas" in each for each in found.warnings)


def test_an_isolator_that_differs_from_run_to_run_is_in_the_interval_of_the_masses():
    """Two per cent of stiffness look like another mass where the runs are said to be alike."""
    stiffer = replace(ISOLATOR, stiffness_n_per_m=1.02 * SPRING)
    runs = shaken(machine(), 1), shaken(machine(60.0), 2, stiffer)
    given = WHERE | {"unknown_mass": ["low", "high"], "loadings": [{}, {"high": 60.0}], "law": "arctan_velocity"}
    alike = identify_structure(machine(), runs, unknown=["inner"], repeatability=0.0, **given)
    assert alike.repeatability.stated == 0.0
    # which the runs contradict, and which is then not believed
    assert alike.repeatability.exceeds
    assert alike.masses["low"].holds(LOW_KG)
    found = identify_structure(machine(), runs, unknown=["inner"], **given)
    assert found.residual_over_noise < 1.05
    assert found.repeatability.is_usual
    assert found.repeatability.estimated > 2e-3
    for name, truth in (("low", LOW_KG), ("high", HIGH_KG)):
        assert found.masses[name].holds(truth)
    assert found.limits


def test_runs_that_do_not_go_together_are_told(runs, monkeypatch):
    monkeypatch.setattr(driven_laws, "left_out_ratio", lambda fit: 2.4)
    found = identify_structure(machine(), runs, loadings=[{}, {"high": 60.0}], law="arctan_velocity", **WHERE)
    assert found.left_out_over_noise == pytest.approx(2.4)
    assert "runs that are predicted from the other runs leave 2.4 times" in found.warnings[0]
    assert "the intervals are withheld" in found.warnings[0]
    assert found.interfaces["low"].stiffness.value is not None
    assert found.interfaces["low"].stiffness.interval95 is None


def test_one_known_mass_or_spring_keeps_the_scale(runs):
    found = identify_structure(
        machine(high_kg=1.0), runs[:1], unknown=["inner"], unknown_mass=["high"], law="arctan_velocity", **WHERE
    )
    assert near(found.masses["high"], HIGH_KG)
    check_springs(found)
    spring = identify_structure(
        machine(high_kg=1.0, low_kg=7.0), runs[:1], unknown_mass=["high", "low"], law="arctan_velocity", **WHERE
    )
    assert near(spring.masses["high"], HIGH_KG)
    assert near(spring.masses["low"], LOW_KG)
    assert near(spring.interfaces["low"].stiffness, SPRING)


def test_where_nothing_is_known_in_kg_ratios_are_told(runs):
    found = identify_structure(
        machine(), runs[:1], unknown=["inner"], unknown_mass=["high", "low"], law="arctan_velocity", **WHERE
    )
    assert found.per_mass
    assert found.not_determined.startswith("no mass is known and all runs have the same loading: only ratios")
    assert found.masses["high"] == Estimate(1.0)
    assert near(found.masses["low"], LOW_KG / HIGH_KG)
    check_springs(found, per=HIGH_KG)


def test_a_motion_that_no_sensor_sees_is_followed_from_a_start(runs):
    """The upper mass is not measured: what is stated of the joint is where to begin."""
    settings = WHERE | {"sensors": {"low": "low"}}
    rough = machine(joints=(replace(INNER, stiffness_n_per_m=2.8e5, damping_n_s_per_m=300.0),))
    found = identify_structure(
        rough, runs[:1], unknown=["inner"], law="arctan_velocity", start={"low": (1e5, 2e3)}, **settings
    )
    check_springs(found)
    assert found.residual_over_noise == pytest.approx(1.0, abs=0.05)
    masses = identify_structure(
        rough, runs, unknown=["inner"], unknown_mass=["high"], law="arctan_velocity", start={"low": (1e5, 2e3)},
        **settings,
    )  # fmt: skip
    assert masses.residual_over_noise > 1.2  # the second run is loaded, and nobody said so
    with pytest.raises(InputError, match=r"the sensors see 1 of 2 .* give `start`, .* of the suspension of low"):
        identify_structure(rough, runs[:1], unknown=["inner"], **settings)
    with pytest.raises(InputError, match="start has 'lo', which is no interface: did you mean 'low'"):
        identify_structure(rough, runs[:1], unknown=["inner"], start={"lo": (1e5, 1e3)}, **settings)
    none = machine(joints=(replace(INNER, stiffness_n_per_m=0.0),))
    with pytest.raises(InputError, match="give the joint 'inner' a stiffness from which to begin"):
        identify_structure(none, runs[:1], unknown=["inner"], start={"low": (1e5, 1e3)}, **settings)


def test_a_wrong_structure_is_told_and_its_intervals_are_withheld(runs):
    stiff = machine(joints=(replace(INNER, stiffness_n_per_m=9e5),))
    found = identify_structure(stiff, runs[:1], law="arctan_velocity", **WHERE)
    assert found.residual_over_noise > 3
    assert "is not as described" in found.warnings[0]
    isolator = found.interfaces["low"]
    assert isolator.stiffness.interval95 is None
    assert isolator.law_estimates["arctan_velocity"]["amplitude_n"].interval95 is None
    if found.residual_over_noise > 20:
        assert "no number is reported" in found.not_determined
        assert isolator.stiffness == Estimate()


def with_flag(mass_kg, stiffness, damping):
    clip = Joint("clip", (0, -1, 1), stiffness, damping)
    none = np.zeros((3, 3))
    joints = (replace(INNER, direction=(-1, 1, 0)), clip)
    return Structure(np.diag([LOW_KG, HIGH_KG, mass_kg]), none, none, joints, (*NAMES, "flag"))


def test_what_the_runs_do_not_tell_is_named(runs):
    """A joint to a mass that hardly moves anything."""
    small = with_flag(1e-3, 4.0, 6e-3)
    found = identify_structure(
        small, runs[:1], unknown=["clip"], start={"low": (1e5, 1e3)}, law="arctan_velocity", **WHERE
    )
    assert "the stiffness of clip" in found.not_determined
    assert near(found.interfaces["low"].stiffness, SPRING)


def test_a_motion_too_fast_for_the_log_is_told(runs):
    found = identify_structure(
        with_flag(1e-4, 10.0, 1e-3), runs[:1], start={"low": (1e5, 1e3)}, law="arctan_velocity", **WHERE
    )
    assert any("a motion of 50.3 Hz, too fast for steps of 256 Hz: record faster" in each for each in found.warnings)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"runs": []}, "there are no runs: give at least one recording"),
        ({"interfaces": {}}, "give at least one interface and one sensor"),
        ({"sensors": {}}, "give at least one interface and one sensor"),
        ({"sensors": {"low": "low", "high": "low"}}, "the channel 'low' is named 2 times: each sensor is one channel"),
        ({"sensors": {"low": "lo"}}, "run 1 has no channel 'lo': did you mean 'low'"),
        ({"interfaces": {"lowest": "floor"}}, "no degree of freedom 'lowest': did you mean 'low'"),
        ({"loadings": [{}, {}]}, r"there are 2 loadings for 1 run\(s\): give one a run, {} for none"),
        ({"loadings": [{"hi": 3.0}]}, "no degree of freedom 'hi': did you mean 'high'"),
        ({"loadings": [{"high": np.nan}]}, "the loading at 'high' is nan: give a mass in kg"),
        ({"law": "arctan_velocty"}, "arctan_velocity"),
        ({"unknown": ["outer"]}, "there is no joint 'outer'"),
        ({"axis": "upward"}, "the axis of 'low' is 'upward': give one of 'up', 'down', 'horizontal'"),
        ({"axis": {"lo": "up"}}, "no degree of freedom 'lo': did you mean 'low'"),
        ({"repeatability": "1 %"}, "the repeatability is '1 %', give the relative .* a number from 0 to 0.2"),
    ],
)
def test_bad_input_is_named(changes, match):
    samples = np.random.default_rng(0).standard_normal((600, 3))
    run = recording_from_arrays([*samples.T], ["floor", *NAMES], fs=FS)
    settings = {**WHERE, **changes}
    with pytest.raises(InputError, match=match):
        identify_structure(machine(), settings.pop("runs", [run]), **settings)


def test_runs_that_do_not_fit_together_are_named():
    samples = np.random.default_rng(0).standard_normal((600, 3))
    run, fast = (recording_from_arrays([*samples.T], ["floor", *NAMES], fs=fs) for fs in (FS, 2 * FS))
    with pytest.raises(InputError, match="run 1 has 256 Hz and run 2 has 512 Hz: resample one of them"):
        identify_structure(machine(), [run, fast], **WHERE)
    travel = Recording(samples, fs=FS, channels=tuple(Channel(name, "m") for name in ("floor", *NAMES)))
    with pytest.raises(InputError, match="channel 'floor' of run 1 is in m: an acceleration is needed"):
        identify_structure(machine(), [travel], **WHERE)


def test_a_structure_that_cannot_follow_is_not_fitted(runs):
    negative = machine(joints=(replace(INNER, stiffness_n_per_m=-4e9),))
    with pytest.raises(NotDeterminedError, match="grows without bound"):
        identify_structure(negative, runs[:1], law="linear", **WHERE)


def test_a_slow_log_gives_the_same(runs):
    """Half the rate is sampled finer for the steps; the low-pass takes half of the noise."""
    half = [recording_from_arrays([*decimate(run.samples, 2).T], run.names, fs=FS / 2) for run in runs[:1]]
    settings = WHERE | {"noise_m_per_s2": NOISE / np.sqrt(2)}
    found = identify_structure(machine(), half, unknown=["inner"], law="arctan_velocity", **settings)
    assert found.fit.model.runs[0].finer == 2
    assert 0.9 < found.residual_over_noise < 1.2
    check_springs(found)
