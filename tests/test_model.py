"""Prediction errors of a body: at rounding where nothing is unknown, their derivatives, and how likely they are."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import LinearOperator, gmres

from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.laws.law import LAWS, LINEAR, Law, Term, default_law, law
from opid.mechanics.response import time_response
from opid.mechanics.structure import Joint, Structure
from opid.suspensions.candidates import fall_of, gear_body
from opid.suspensions.model.body import ImpossibleBodyError, own_body, rigid_body, vertical
from opid.suspensions.model.driven_model import Model
from opid.suspensions.model.law_parameters import to_free
from opid.suspensions.model.run import driven_run
from opid.suspensions.model.unknowns import Group
from opid.suspensions.sensor_facts import IDEAL, SensorFacts, Sensors, ideal_sensors
from opid.suspensions.settings import FaultSettings, FitSettings, Settings

FS, SECONDS, FINER = 512.0, 3.0, 8
PLACES = [(5.0, 0.0), (0.0, 1.6), (0.0, -1.5)]
SENSORS = [(5.3, 0.2), (0.25, 1.4), (0.25, -1.4), (-4.0, 0.1)]
NAMES = ("nose", "left", "right")
MASS_KG, ROLL, PITCH, X_CG, Y_CG = 5400.0, 1.6e4, 2.7e4, 0.6, 0.05
FACTORS = np.array([X_CG, Y_CG, ROLL / MASS_KG + Y_CG**2, PITCH / MASS_KG + X_CG**2])
FRICTION = law("arctan_velocity", amplitude_n=480.0, scale_m_per_s=0.05)
HARDENING = law("cubic_stiffness", stiffness_n_per_m3=3e8)
MIXED = law("arctan_mixed", amplitude_n=300.0, scale_m=0.003, lag_s=0.02)
SPRINGS = ((1.5e5, 2.4e3, LINEAR), (4.7e5, 7.2e3, FRICTION), (4.5e5, 7.0e3, FRICTION + HARDENING))
COUPLED = SensorFacts(gain_tolerance=0.03, corner_hz=0.3, corner_tolerance=0.3)
LATE = replace(COUPLED, lag_tolerance_s=2e-3)


def loading_of(mass_kg, x_m, y_m):
    return mass_kg * np.outer(vertical(x_m, y_m), vertical(x_m, y_m))


LOADINGS = (np.zeros((3, 3)), loading_of(500.0, -1.0, 0.2))


def shaking(n_interfaces, fs, seconds, seed=5):
    """Displacement and acceleration of what is below the suspensions, sums of sines."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(fs * seconds)) / fs
    frequency, phase = rng.uniform(0.8, 9.0, (12, n_interfaces)), rng.uniform(0, 2 * np.pi, (12, n_interfaces))
    angle = 2 * np.pi * frequency * t[:, np.newaxis, np.newaxis] + phase
    size = 6e-3 / frequency
    return np.sum(size * np.sin(angle), axis=1), np.sum(-size * (2 * np.pi * frequency) ** 2 * np.sin(angle), axis=1)


def made(runs, body, groups, *, sensors=None, mass_free=True, noise=5e-3, **settings):
    """A model with equal noise of all sensors."""
    n, n_sensors = body.n_interfaces, len(body.readings)
    sensors = sensors or ideal_sensors(n, n_sensors)
    rms = np.tile([0.01, 0.1], (n, 1))
    levels = (np.full(n, noise), np.full(n_sensors, noise))
    return Model(tuple(runs), body, tuple(groups), sensors, mass_free, rms, Settings(), noise=levels, **settings)


def vector(model, values, starts=()):
    """The vector of named values; faults and coordinates as stated where they are not named, laws as in the model."""
    known = {fault.name: fault.nominal for fault in model.faults}
    for group in model.groups:
        known |= {f"{group.name_of('law')}[{k}]": value for k, value in enumerate(to_free(group.law))}
    known |= dict(zip(model.body.names, FACTORS, strict=False))
    shared = [(known | values).get(name, 0.0) for name in model.names]
    at_rest = np.zeros(2 * model.body.n_interfaces * len(model.runs))
    return np.concatenate([shared, np.ravel(starts) if len(starts) else at_rest])


# ---- against another integrator --------------------------------------------------------------------


def driven(structure, joints, interface_rows):
    """Absolute accelerations of a structure on moving supports: each support is a heavy mass moved by its force."""
    n, k = structure.n_dof, len(joints)
    heavy = 1e12
    whole = Structure(
        np.block([[structure.mass, np.zeros((n, k))], [np.zeros((k, n)), heavy * np.eye(k)]]),
        np.zeros((n + k, n + k)),
        np.block([[structure.stiffness, np.zeros((n, k))], [np.zeros((k, n)), np.zeros((k, k))]]),
        tuple(
            Joint(str(i), [*row, *(-np.eye(k)[i])], *spring)
            for i, (row, spring) in enumerate(zip(interface_rows, joints, strict=True))
        )
        + tuple(replace(j, direction=np.concatenate([j.direction, np.zeros(k)])) for j in structure.joints),
    )
    place, pushed = shaking(k, 2 * FINER * FS, SECONDS)
    speed = (place[1] - place[0]) * 2 * FINER * FS - 0.5 * pushed[0] / (2 * FINER * FS)
    answer = time_response(
        whole,
        np.hstack([np.zeros((len(pushed), n)), heavy * pushed])[:-1],
        fs=FINER * FS,
        duration_s=SECONDS,
        initial_displacement=[*np.zeros(n), *place[0]],
        initial_velocity=[*np.zeros(n), *speed],
    )
    every = slice(None, None, FINER)
    below = np.array([np.array(row) for row in interface_rows])
    travel, velocity = (
        (state[every, :n] @ below.T - state[every, n:]) for state in (answer.displacement, answer.velocity)
    )
    return pushed[:: 2 * FINER], answer.acceleration[every, :n], travel, velocity


def exact_run(below, above, loading):
    """The run as it is, means and all: what is exact is not to be centred."""
    run = driven_run(below, above, fs=FS, loading=loading)
    n = run.n_samples
    return replace(run, unsprung=below[:n], sprung=above[:n])


@pytest.fixture(scope="module")
def aircraft():
    """A rigid body on three suspensions, its runs by another integrator, and the vector of the truth."""
    body = rigid_body(PLACES, SENSORS, names=NAMES, tolerance_m=0.01)
    seen = np.array([vertical(*place) for place in SENSORS])
    runs, starts = [], []
    for loading in LOADINGS:
        mass = MASS_KG * body.mass(FACTORS, 1 / MASS_KG, loading)
        carried = Structure(0.5 * (mass + mass.T), np.zeros((3, 3)), np.zeros((3, 3)))
        below, above, travel, velocity = driven(carried, SPRINGS, [vertical(*place) for place in PLACES])
        runs.append(exact_run(below, above @ seen.T, loading))
        starts.append(np.stack([travel[0], velocity[0]], axis=1).ravel())
    groups = [
        Group(name, (k,), SPRINGS[k][2].scaled(1 / MASS_KG) if SPRINGS[k][2].terms else LINEAR)
        for k, name in enumerate(NAMES)
    ]
    values = {"inverse_mass": 1 / MASS_KG}
    for name, (stiffness, damping, _) in zip(NAMES, SPRINGS, strict=True):
        values |= {f"stiffness_per_mass[{name}]": stiffness / MASS_KG, f"damping_per_mass[{name}]": damping / MASS_KG}
    model = made(runs, body, groups)
    return model, vector(model, values, np.concatenate(starts))


@pytest.fixture(scope="module")
def machine():
    """Two masses on one interface with a spring between them that is to be found; a known spring to the ground."""
    joint, known = Joint("inner", (-1, 1), 6e5, 900.0), Joint("stop", (0, 1), 4e4, 100.0)
    frame = Structure(np.diag([300.0, 200.0]), np.zeros((2, 2)), np.zeros((2, 2)), (joint, known), ("low", "high"))
    body = own_body(frame, ["low"], ["low", "high"], unknown=["inner"], unknown_mass=["high"])
    spring = (3e5, 2e3, law("quadratic_damping", damping_n_s2_per_m2=4e3))
    below, above, travel, velocity = driven(frame, [spring], [(1, 0)])
    model = made([exact_run(below, above, np.zeros((2, 2)))], body, [Group("low", (0,), spring[2].scaled(1 / 200))])
    shared = [3e5 / 200, 2e3 / 200, 4e3 / 200, 6e5 / 200, 900.0 / 200, 1 / 200]
    return model, np.array([*shared, travel[0, 0], velocity[0, 0]])


@pytest.mark.parametrize("which", ["aircraft", "machine"])
def test_a_run_without_noise_is_predicted_to_the_error_of_the_steps(which, request):
    model, theta = request.getfixturevalue(which)
    assert model.n_shared == len(model.names) == theta.size - 2 * model.body.n_interfaces * len(model.runs)
    errors = model.evaluate(theta, sensitivity=False)
    for run, prediction in zip(model.runs, errors.predictions, strict=True):
        inner = slice(100, -100)
        n_sensors = run.sprung.shape[1]
        error = (run.sprung - prediction.acceleration[:, :n_sensors])[inner]
        # the drive between two samples is interpolated; the kernel ends at the ends of the record
        assert np.abs(error).max() < (2e-3 if which == "aircraft" else 5e-3) * run.sprung.std()
        assert np.abs(prediction.innovation[:n_sensors, inner]).max() < 1.0


@pytest.mark.parametrize(
    ("which", "name", "factor"),
    [
        ("aircraft", "inverse_mass", 1.02),
        ("aircraft", "rxx_m2", 1.05),
        ("aircraft", "stiffness_per_mass[left]", 1.01),
        ("machine", "stiffness_per_mass[inner]", 1.03),
    ],
)
def test_a_wrong_entry_is_seen(which, name, factor, request):
    model, theta = request.getfixturevalue(which)
    wrong = np.where(np.arange(theta.size) == model.names.index(name), factor, 1.0) * theta
    exact, worse = (np.sum(model.evaluate(each, sensitivity=False).stacked ** 2) for each in (theta, wrong))
    assert worse > 10 * exact


# ---- derivatives -----------------------------------------------------------------------------------


def drawn_run(n_interfaces, n_sensors, loading, seed, n_leaks=0):
    rng = np.random.default_rng(seed)
    fs, seconds = 256.0, 4.0
    below = 0.4 * shaking(n_interfaces, fs, seconds, seed)[1]
    leaks = rng.standard_normal((len(below), n_leaks)) if n_leaks else None
    return driven_run(below, np.zeros((len(below), n_sensors)), fs=fs, loading=loading, leaks=leaks)


def deaf(model):
    """The model with exact sensors below and readings so noisy that they hardly correct anything."""
    n, n_sensors = model.body.n_interfaces, len(model.sensors.sprung)
    return replace(model, noise=(np.full(n, 1e-9), np.full(n_sensors, 1e3)))


def with_its_own_readings(model, theta):
    """The model with runs that read what it predicts at a vector.

    Derivatives hold the gain of the correction fixed; beside errors of zero that is no approximation.
    """
    model, values = deaf(model), model.fault_values(theta)
    for _ in range(12):
        predictions = model.evaluate(theta, sensitivity=False).predictions
        runs = [
            replace(run, sprung=_recorded(run, model.sensors, values, prediction.acceleration))
            for run, prediction in zip(model.runs, predictions, strict=True)
        ]
        model = replace(model, runs=tuple(runs))
        errors = model.evaluate(theta, sensitivity=False)
        if np.abs(errors.stacked[: 2 * sum(line.size for line in errors.lines)]).max() < 1e-8:
            return model
    raise AssertionError("the readings of the model do not settle")


def _recorded(run, sensors, values, wanted):
    """What sensors with these faults record so that they should have read what is wanted: a linear equation."""
    shape = run.sprung.shape

    def undone(flat):
        return replace(run, sprung=flat.reshape(shape)).correct("sprung", sensors, values).value.ravel()

    nothing = undone(np.zeros(run.sprung.size))
    operator = LinearOperator((run.sprung.size,) * 2, lambda flat: undone(flat) - nothing)
    found, failed = gmres(operator, wanted[:, : shape[1]].ravel() - nothing, rtol=1e-13, restart=80)
    assert not failed
    return found.reshape(shape)


def one_gear(group, sensors=None, n_leaks=0, **values):
    runs = [drawn_run(1, 1, loading, seed, n_leaks) for seed, loading in ((1, 0.0), (2, -220.0))]
    model = made(runs, gear_body(), [group], sensors=sensors)
    given = {"stiffness_per_mass": 210.0, "damping_per_mass": 3.2, "inverse_mass": 1 / 1850, **values}
    return model, vector(model, given, [0.003, 0.02, -0.002, 0.01])


def gear_with_law(kind):
    return one_gear(Group("", (0,), default_law(kind).scaled(1 / 1850)))


def gear_with_faults():
    group = Group("", (0,), (FRICTION + HARDENING).scaled(1 / 1850), ground=True)
    sensors = Sensors((COUPLED,), (LATE,), ("",), (("unsprung", 0, 0.05), ("sprung", 0, 0.05)))
    values = {"ground_stiffness_per_mass": 20.0, "gain_unsprung": 1.02, "gain_sprung": 0.98}
    values |= {"corner_unsprung_hz": 0.33, "corner_sprung_hz": 0.27, "leak[0]": 0.03, "leak[1]": -0.02}
    return one_gear(group, sensors, 2, **values)


def body_with_everything():
    """Three interfaces of which two share what they have, ground springs, coordinates, and faults here and there."""
    gas = default_law("gas_column")
    groups = [
        Group("nose", (0,), (MIXED + gas).scaled(1 / MASS_KG)),
        Group("left, right", (1, 2), (FRICTION + HARDENING).scaled(1 / MASS_KG), ground=True),
    ]
    body = rigid_body(PLACES, SENSORS, names=NAMES, tolerance_m=0.01)
    sensors = Sensors(
        (IDEAL, COUPLED, IDEAL),
        (LATE, COUPLED, IDEAL, LATE),
        (*NAMES, "tail"),
        (("unsprung", 2, 0.05), ("sprung", 3, 0.05)),
    )
    runs = [drawn_run(3, 4, loading, seed, 2) for seed, loading in enumerate(LOADINGS)]
    model = made(runs, body, groups, sensors=sensors)
    values = {"inverse_mass": 1 / MASS_KG, "ground_stiffness_per_mass[left, right]": 6.0}
    for group, stiffness in zip(groups, (28.0, 87.0), strict=True):
        values |= {group.name_of("stiffness_per_mass"): stiffness, group.name_of("damping_per_mass"): stiffness / 65}
    values |= {"gain_sprung[tail]": 1.01, "gain_unsprung[left]": 0.99, "corner_sprung_hz[nose]": 0.28, "leak[1]": 0.01}
    rng = np.random.default_rng(4)
    values |= {coordinate.name: 0.01 * rng.standard_normal() for coordinate in body.coordinates}
    return model, vector(model, values, 1e-3 * rng.standard_normal(12))


def gear_with_origin():
    """A gear whose law has its origin elsewhere than where the gear rests, with a ground spring."""
    law = default_law("gas_column") + MIXED + HARDENING
    group = Group("", (0,), law.scaled(1 / 1850), ground=True, origin_m=0.01)
    return one_gear(group, ground_stiffness_per_mass=20.0, rest_m=-0.006)


def body_under_its_weight():
    """The same three interfaces where their weight puts them, on one law with an origin elsewhere."""
    model, theta = body_with_everything()
    fall = np.array([-9.80665, 0.0, 0.0])
    nose, mains = model.groups
    changed = replace(model, body=replace(model.body, fall=fall), groups=(nose, replace(mains, origin_m=0.01)))
    return changed, np.insert(theta, model.law_indices(1).start, 0.004)


def two_laws_inside():
    """A structure of which a joint and a mass are to be found."""
    joints = (Joint("inner", (-1, 1), 6e5, 900.0), Joint("stop", (0, 1), 4e4, 100.0))
    frame = Structure(np.diag([300.0, 200.0]), np.zeros((2, 2)), np.zeros((2, 2)), joints, ("low", "high"))
    body = own_body(frame, ["low"], ["low", "high"], unknown=["inner"], unknown_mass=["high"])
    model = made([drawn_run(1, 2, np.zeros((2, 2)), 3)], body, [Group("low", (0,), FRICTION.scaled(1 / 200))])
    values = {"stiffness_per_mass[low]": 1500.0, "damping_per_mass[low]": 10.0, "inverse_mass": 1 / 200}
    return model, vector(model, values | {"stiffness_per_mass[inner]": 3000.0, "damping_per_mass[inner]": 4.5}, [0, 0])


def two_laws_under_their_weight():
    """The same structure on a spring that hardens, its second run loaded, whose suspension departs from the first's."""
    model, theta = two_laws_inside()
    runs = [drawn_run(1, 2, np.diag(loading), seed) for loading, seed in (((0.0, 0.0), 3), ((0.0, 90.0), 4))]
    group = Group("low", (0,), (FRICTION + HARDENING).scaled(1 / 200), origin_m=0.01)
    heavy = made(runs, replace(model.body, fall=fall_of(["up", "up"])), [group], repeatability=0.01)
    values = dict(zip(model.names, theta, strict=False)) | {"rest_m[low]": -0.004}
    return heavy, vector(heavy, values, [2e-3, 0.01, 0.01, -0.02, 0.03, 0.0, 0.0, -0.01, 0.02, 0.01])


def known_mass_that_departs():
    """One mass that is known in kg: what a stiffer spring carries is a force in N."""
    none = np.zeros((1, 1))
    body = own_body(Structure([[300.0]], none, none, names=("body",)), ["body"], ["body"])
    runs = [drawn_run(1, 1, loading, seed) for seed, loading in ((1, 0.0), (2, 60.0))]
    body, group = replace(body, fall=fall_of(["down"])), Group("body", (0,), FRICTION + HARDENING, origin_m=0.01)
    model = made(runs, body, [group], mass_free=False, repeatability=0.01)
    values = {"stiffness_per_mass[body]": 6e4, "damping_per_mass[body]": 900.0, "rest_m[body]": 0.006}
    return model, vector(model, values, [2e-3, 0.01, 0.01, -0.02, 0.03, 0.0, 0.0, -0.01, 0.02, 0.01])


CASES = {kind: lambda kind=kind: gear_with_law(kind) for kind in LAWS}
CASES |= {"faults": gear_with_faults, "three interfaces": body_with_everything, "own structure": two_laws_inside}
CASES |= {"origin": gear_with_origin, "weight": body_under_its_weight}
CASES |= {"own structure under weight": two_laws_under_their_weight, "known mass": known_mass_that_departs}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_derivatives_of_every_entry_are_those_of_differences(case):
    model, theta = CASES[case]()
    model = with_its_own_readings(model, theta)
    exact = model.evaluate(theta).jacobian
    n = 2 * sum(run.omega.size for run in model.runs) * len(model.sensors.sprung)
    for k in range(theta.size):
        name = model.names[k] if k < model.n_shared else f"start {k - model.n_shared}"
        step = np.zeros(theta.size)
        # an element of a joint that begins to slip within a step bends the difference: the shorter the step, the less
        relative = 1e-7 if case == "iwan_friction" else 1e-5
        step[k] = relative * max(abs(theta[k]), 1e-2 if k < model.n_shared else 1e-4)
        up, down = (model.evaluate(theta + sign * step, sensitivity=False).stacked for sign in (1, -1))
        differences = (up - down) / (2 * step[k])
        # a lag moves half of the last sample at nothing, and steps are divided where a memory turns over
        tolerance = 4e-3 if name.startswith("lag") or case == "lugre_friction" else 3e-4
        for part in (slice(0, n), slice(n, None)):
            close = tolerance * np.abs(differences[part]).max() + 1e-12
            np.testing.assert_allclose(exact[part, k], differences[part], atol=close, err_msg=name)
        assert np.abs(differences[:n]).max() > 0, name


@pytest.mark.parametrize("case", ["faults", "three interfaces"])
def test_derivatives_by_gains_hold_for_errors_of_any_size(case):
    """A gain is also in the spread of the errors: the likelihood is that of the reading, not of what it should be."""
    model, theta = CASES[case]()
    before = dict(zip(model.names, theta, strict=False))
    starts = theta[model.n_shared :]
    free = {
        side: tuple(replace(facts, corner_hz=0.0, corner_tolerance=0.0) for facts in model.sensors.facts(side))
        for side in ("unsprung", "sprung")
    }
    model = replace(model, sensors=replace(model.sensors, **free))
    theta = np.array([*(before[name] for name in model.names), *starts])
    noisy = [
        replace(run, sprung=np.random.default_rng(k).standard_normal(run.sprung.shape))
        for k, run in enumerate(model.runs)
    ]
    model = deaf(replace(model, runs=tuple(noisy)))
    exact = model.evaluate(theta).jacobian
    for name in model.names:
        if not name.startswith("gain"):
            continue
        k = model.names.index(name)
        step = np.where(np.arange(theta.size) == k, 1e-5, 0.0)
        up, down = (model.evaluate(theta + sign * step, sensitivity=False).stacked for sign in (1, -1))
        differences = (up - down) / 2e-5
        np.testing.assert_allclose(exact[:, k], differences, atol=3e-4 * np.abs(differences).max(), err_msg=name)


@pytest.mark.parametrize("law", [FRICTION, MIXED], ids=lambda law: law.name)
def test_candidates_are_the_limits_of_terms_of_the_law(law):
    """Derivatives by the amplitude of a term that is not there are those by the amplitude of a faint one that is.

    Also where the law itself does not tell where a run rests.
    """
    model, theta = one_gear(Group("", (0,), law.scaled(1 / 1850)))
    model = with_its_own_readings(model, theta)
    faint = Term("cubic_stiffness", (1e-6,))
    candidates = model.evaluate(theta, candidates={0: [faint, Term("coulomb_friction", (1e-9, 0.02))]}).candidates
    group = replace(model.groups[0], law=model.groups[0].law + Law((faint,)))
    more = replace(model, groups=(group,))
    place = more.law_indices(0).stop - 1
    whole = more.evaluate(np.insert(theta, place, 1e-6)).jacobian
    assert candidates.shape == (2 * sum(run.omega.size for run in model.runs), 3)
    expected = whole[: len(candidates), place]
    np.testing.assert_allclose(candidates[:, 0], expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


# ---- likelihood ------------------------------------------------------------------------------------


def test_the_likelihood_of_one_gear_is_that_of_its_closed_form():
    """Of a linear gear: T = (K + i w C) / (K + K3 - w^2 m_r / m + i w C), each reading before its gain."""
    facts = SensorFacts(gain_tolerance=0.03)
    sensors = Sensors((facts,), (facts,), ("",))
    gains = {"gain_unsprung": 1.04, "gain_sprung": 0.97}
    model, theta = one_gear(Group("", (0,), ground=True), sensors, ground_stiffness_per_mass=30.0, **gains)
    model = replace(model, noise=(np.array([0.02]), np.array([0.005])))
    errors = model.evaluate(theta, sensitivity=False)
    cost = n = expected = 0.0
    for run, lines, change in zip(model.runs, errors.lines, (0.0, -220.0), strict=True):
        spring = 210.0 + 1j * run.omega * 3.2
        ratio = spring / (spring + 30.0 - run.omega**2 * (1 + change / 1850))
        density = 0.005**2 + np.abs(ratio * 0.97 / 1.04) ** 2 * 0.02**2
        expected -= np.sum(np.log(density))
        cost, n = cost + np.sum(np.abs(lines) ** 2), n + 2 * lines.size
    expected -= 0.5 * n * np.log(cost / n)
    assert model.log_likelihood(errors, theta) == pytest.approx(expected, rel=1e-9)


def test_the_likelihood_of_a_body_is_that_of_its_matrices():
    """T = S (-w^2 M + J' D J + J' G J)^-1 J' D of a linear body, in the coordinates of the body."""
    body = rigid_body(PLACES, SENSORS, names=NAMES)
    runs = [drawn_run(3, 4, loading, seed) for seed, loading in enumerate(LOADINGS)]
    groups = [Group(name, (k,), ground=name == "left") for k, name in enumerate(NAMES)]
    model = made(runs, body, groups)
    model = replace(model, noise=(np.array([0.01, 0.02, 0.03]), np.array([5e-3, 4e-3, 6e-3, 7e-3])))
    stiffness, damping, ground = np.array([28.0, 87.0, 83.0]), np.array([0.4, 1.3, 1.2]), np.array([0.0, 5.0, 0.0])
    values = {"inverse_mass": 1 / MASS_KG, "ground_stiffness_per_mass[left]": 5.0}
    for name, k, c in zip(NAMES, stiffness, damping, strict=True):
        values |= {f"stiffness_per_mass[{name}]": k, f"damping_per_mass[{name}]": c}
    theta = vector(model, values)
    errors = model.evaluate(theta, sensitivity=False)
    rows, seen = (np.array([vertical(*place) for place in places]) for places in (PLACES, SENSORS))
    lines = np.concatenate(errors.lines)
    expected = -lines.size * np.log(np.mean(np.abs(lines) ** 2) / 2)
    for run, loading in zip(runs, LOADINGS, strict=True):
        mass = body.mass(FACTORS, 1 / MASS_KG, loading)
        for omega in run.omega:
            spring = np.diag(stiffness + 1j * omega * damping)
            system = -(omega**2) * mass + rows.T @ (spring + np.diag(ground)) @ rows
            ratio = seen @ np.linalg.solve(system, rows.T @ spring)
            density = ratio @ np.diag(model.noise[0] ** 2) @ ratio.conj().T + np.diag(model.noise[1] ** 2)
            expected -= np.log(np.linalg.det(density).real)
    assert model.log_likelihood(errors, theta) == pytest.approx(expected, rel=1e-9)


# ---- the vector ------------------------------------------------------------------------------------


def test_groups_share_their_entries():
    model, theta = body_with_everything()
    suspensions, _ = model.interfaces(theta)
    assert [name for name in model.names if "left" in name][:4] == [
        "stiffness_per_mass[left, right]",
        "damping_per_mass[left, right]",
        "ground_stiffness_per_mass[left, right]",
        "law[left, right][0]",
    ]
    assert (suspensions[1].stiffness, suspensions[1].damping, suspensions[1].ground_stiffness) == (87.0, 87 / 65, 6.0)
    assert suspensions[1] == suspensions[2]
    np.testing.assert_allclose(suspensions[1].law.vector, (FRICTION + HARDENING).scaled(1 / MASS_KG).vector)
    assert suspensions[0].ground_stiffness == 0.0
    assert model.ground
    assert np.unique(model.names).size == model.n_shared


def test_bounds_are_in_standard_deviations_of_what_is_known():
    model, _ = body_with_everything()
    model = replace(model, settings=Settings(fit=FitSettings(farthest_std=4.0)))
    bounds = dict(zip(model.names, zip(*model.bounds(), strict=True), strict=False))
    assert bounds["x_m[nose]"] == (-0.04, 0.04)
    assert bounds["gain_sprung[tail]"] == pytest.approx((0.88, 1.12))
    # a corner stays positive, and may come to next to none however well it is known
    assert bounds["corner_sprung_hz[left]"] == pytest.approx((FaultSettings.slight_corner_hz, 0.3 + 4 * 0.09))
    assert bounds["stiffness_per_mass[nose]"] == (-np.inf, np.inf)
    assert np.isfinite(bounds["law[nose][1]"]).all()


def test_what_cannot_be_predicted_is_raised():
    model, theta = one_gear(Group("", (0,)))
    with pytest.raises(UnboundedResponseError):
        model.evaluate(np.where(np.arange(theta.size) == 0, -4e9, theta))
    model, theta = body_with_everything()
    with pytest.raises(ImpossibleBodyError):
        model.evaluate(np.where(np.arange(theta.size) == model.names.index("rxx_m2"), -3.0, theta))
