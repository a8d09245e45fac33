"""Prediction errors of a body: at rounding where nothing is unknown, and their derivatives against differences."""

from dataclasses import replace

import numpy as np
import pytest

from opid.mechanics.driven import half_steps
from opid.mechanics.laws import LINEAR, law
from opid.mechanics.response import time_response
from opid.mechanics.structure import Joint, Structure
from opid.suspensions.law_parameters import to_free
from opid.suspensions.model import BodyModel, Group
from opid.suspensions.run import body_run
from opid.suspensions.structure import own_body, rigid_body, vertical

FS, SECONDS, FINER = 512.0, 3.0, 8
PLACES = [(5.0, 0.0), (0.0, 1.6), (0.0, -1.5)]
SENSORS = [(5.3, 0.2), (0.25, 1.4), (0.25, -1.4), (-4.0, 0.1)]
MASS_KG, ROLL, PITCH, X_CG, Y_CG = 5400.0, 1.6e4, 2.7e4, 0.6, 0.05
LOADING = (500.0, -1.0, 0.2)
FRICTION = law("arctan_velocity", amplitude_n=480.0, scale_m_per_s=0.05)
HARDENING = law("cubic_stiffness", stiffness_n_per_m3=3e8)
SPRINGS = ((1.5e5, 2.4e3, LINEAR), (4.7e5, 7.2e3, FRICTION), (4.5e5, 7.0e3, FRICTION + HARDENING))
NOISE = (5e-3, 5e-3)


def shaking(n_interfaces, fs, seconds):
    """Displacement and acceleration of what is below the suspensions, sums of sines that begin at rest."""
    rng = np.random.default_rng(5)
    t = np.arange(round(fs * seconds)) / fs
    frequency, phase = rng.uniform(0.8, 9.0, (12, n_interfaces)), rng.uniform(0, 2 * np.pi, (12, n_interfaces))
    angle = 2 * np.pi * frequency * t[:, np.newaxis, np.newaxis] + phase
    size = 6e-3 / frequency
    return np.sum(size * np.sin(angle), axis=1), np.sum(-size * (2 * np.pi * frequency) ** 2 * np.sin(angle), axis=1)


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


def run_of(below, above, loading):
    """The run as it is, means and all: what is exact is not to be centred."""
    run = body_run(below, above, fs=FS, loading=loading)
    n = run.n_samples
    return replace(run, drive=half_steps(below[:n]), sprung=above[:n])


def loading_of(mass_kg, x_m, y_m):
    return mass_kg * np.outer(vertical(x_m, y_m), vertical(x_m, y_m))


@pytest.fixture(scope="module")
def aircraft():
    """A model with every kind of entry, and the vector of the truth."""
    body = rigid_body(PLACES, SENSORS, names=("nose", "left", "right"), tolerance_m=0.01)
    rxx, ryy = ROLL / MASS_KG + Y_CG**2, PITCH / MASS_KG + X_CG**2
    factors = np.array([X_CG, Y_CG, rxx, ryy])
    rows = [vertical(*place) for place in PLACES]
    seen = np.array([vertical(*place) for place in SENSORS])
    runs, firsts = [], []
    for loading in (np.zeros((3, 3)), loading_of(*LOADING)):
        mass = MASS_KG * body.mass(factors, 1 / MASS_KG, loading)
        carried = Structure(0.5 * (mass + mass.T), np.zeros((3, 3)), np.zeros((3, 3)))
        below, above, travel, velocity = driven(carried, SPRINGS, rows)
        runs.append(run_of(below, above @ seen.T, loading))
        firsts.append(np.stack([travel[0], velocity[0]], axis=1).ravel())
    groups = tuple(
        Group(name, (k,), SPRINGS[k][2].scaled(1 / MASS_KG)) for k, name in enumerate(("nose", "left", "right"))
    )
    springs = [
        part
        for group, (stiffness, damping, _) in zip(groups, SPRINGS, strict=True)
        for part in (stiffness / MASS_KG, damping / MASS_KG, *(to_free(group.law) if group.law.terms else ()))
    ]
    model = BodyModel(tuple(runs), body, groups, True, NOISE, np.tile([0.01, 0.1], (3, 1)))
    theta = np.concatenate([springs, factors, [1 / MASS_KG], np.zeros(12), *firsts])
    return model, theta


def test_a_run_without_noise_is_predicted_to_the_error_of_the_steps(aircraft):
    model, theta = aircraft
    assert model.n_shared == len(model.names) == theta.size - 12
    assert "inverse_mass" in model.names
    for place, run in enumerate(model.runs):
        prediction, _ = model.predict(theta, place, sensitivity=False)
        inner = slice(100, -100)
        error = (run.sprung - prediction.acceleration)[inner]
        # the drive between two samples is interpolated; the kernel ends at the ends of the record
        assert np.abs(error).max() < 2e-3 * run.sprung.std()
        assert np.abs(prediction.innovation[:, inner]).max() < 1.0


def test_a_wrong_entry_is_seen(aircraft):
    model, theta = aircraft
    exact = np.sum(model.evaluate(theta, sensitivity=False).stacked ** 2)
    for name, factor in (("inverse_mass", 1.02), ("rxx_m2", 1.05), ("stiffness_per_mass[left]", 1.01)):
        wrong = theta.copy()
        wrong[model.names.index(name)] *= factor
        assert np.sum(model.evaluate(wrong, sensitivity=False).stacked ** 2) > 10 * exact


def _differences(model, theta, entries, step_of):
    exact = model.evaluate(theta).jacobian
    for k in entries:
        step = np.zeros(theta.size)
        step[k] = step_of(k)
        up, down = (model.evaluate(theta + s, sensitivity=False).stacked for s in (step, -step))
        yield k, exact[:, k], (up - down) / (2 * step[k])


def test_derivatives_of_every_kind_of_entry_are_those_of_differences(aircraft):
    """At the truth: the derivatives hold the gain of the correction fixed, and there is next to nothing to correct."""
    model, at = aircraft
    exact = replace(model, noise=(1e-9, 1.0))
    # one of each kind: K, C, law (amplitude, scale) of a gear, factors, 1/m, places, starts of both runs
    names = exact.names
    wanted = ["stiffness_per_mass[nose]", "damping_per_mass[left]", "law[left][0]", "law[left][1]", "law[right][2]"]
    wanted += ["x_cg_m", "y_cg_m", "rxx_m2", "ryy_m2", "inverse_mass", "x_m[nose]", "y_m[left]", "sensor_x_m[left]"]
    wanted += ["sensor_y_m[right]"]
    entries = [names.index(name) for name in wanted] + [exact.n_shared, exact.n_shared + 1, exact.n_shared + 8]

    def step_of(k):
        return 1e-5 * max(abs(at[k]), 1e-3 if k < exact.n_shared else 1e-4)

    for k, found, differences in _differences(exact, at, entries, step_of):
        label = names[k] if k < len(names) else f"start {k - len(names)}"
        scale = np.abs(differences).max()
        assert scale > 0, label
        np.testing.assert_allclose(found, differences, atol=2e-4 * scale, err_msg=label)


def test_groups_share_their_entries(aircraft):
    model, _ = aircraft
    shared = replace(model, groups=(Group("nose", (0,)), Group("left, right", (1, 2), FRICTION)))
    assert [name for name in shared.names if "left" in name][:3] == [
        "stiffness_per_mass[left, right]",
        "damping_per_mass[left, right]",
        "law[left, right][0]",
    ]
    theta = np.zeros(shared.n_shared + 12)
    theta[:6] = [28.0, 0.4, 87.0, 1.3, *to_free(FRICTION)]
    slots, _ = shared.interfaces(theta)
    assert (slots[1].stiffness, slots[1].damping) == (slots[2].stiffness, slots[2].damping) == (87.0, 1.3)
    np.testing.assert_allclose(slots[2].law.vector, FRICTION.vector)
    assert slots[0].law == LINEAR


@pytest.fixture(scope="module")
def machine():
    """Two masses on one interface with a spring between them that is to be found; a known spring to the ground."""
    joint = Joint("inner", (-1, 1), 6e5, 900.0)
    known = Joint("stop", (0, 1), 4e4, 100.0)
    frame = Structure(np.diag([300.0, 200.0]), np.zeros((2, 2)), np.zeros((2, 2)), (joint, known), ("low", "high"))
    body = own_body(frame, ["low"], ["low", "high"], unknown=["inner"], unknown_mass=["high"])
    spring = (3e5, 2e3, law("quadratic_damping", damping_n_s2_per_m2=4e3))
    below, above, travel, velocity = driven(frame, [spring], [(1, 0)])
    run = run_of(below, above, np.zeros((2, 2)))
    group = Group("low", (0,), spring[2].scaled(1 / 200))
    model = BodyModel((run,), body, (group,), True, NOISE, np.array([[0.01, 0.1]]))
    shared = [3e5 / 200, 2e3 / 200, 4e3 / 200, 6e5 / 200, 900.0 / 200, 1 / 200]
    return model, np.array([*shared, travel[0, 0], velocity[0, 0]])


def test_a_spring_inside_is_followed_and_its_derivatives_are_those_of_differences(machine):
    model, theta = machine
    assert model.names == (
        "stiffness_per_mass[low]",
        "damping_per_mass[low]",
        "law[low][0]",
        "stiffness_per_mass[inner]",
        "damping_per_mass[inner]",
        "inverse_mass",
    )
    prediction, _ = model.predict(theta, 0, sensitivity=False)
    run = model.runs[0]
    error = (run.sprung - prediction.acceleration[:, :2])[100:-100]
    assert np.abs(error).max() < 5e-3 * run.sprung.std()
    wrong = theta * np.array([1, 1, 1, 1.03, 1, 1, 1, 1])
    assert np.sum(model.evaluate(wrong).stacked ** 2) > 10 * np.sum(model.evaluate(theta).stacked ** 2)
    exact = replace(model, noise=(1e-9, 1.0))
    for k, found, differences in _differences(
        exact, theta, range(theta.size), lambda k: 1e-6 * max(abs(theta[k]), 1e-6)
    ):
        np.testing.assert_allclose(found, differences, atol=2e-3 * np.abs(differences).max(), err_msg=str(k))
