from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, signal

from opid.errors import InputError
from opid.mechanics.laws.law import LINEAR
from opid.mechanics.response import time_response
from opid.mechanics.structure import Joint, Structure, linear_matrices, natural_frequencies
from opid.suspensions.study import PointMass
from opid.virtual.taxi_tests.aircraft import default_aircraft, random_aircraft, with_bending
from opid.virtual.taxi_tests.airframe import (
    Airframe,
    BendingMode,
    Gear,
    LandingGear,
    airframe_mass,
    airframe_structure,
    loaded,
    place_directions,
)
from opid.virtual.taxi_tests.road import SpeedProfile, iso8608_road, iso8608_tracks
from opid.virtual.taxi_tests.sensors import Sensor
from opid.virtual.taxi_tests.taxiing import taxi_run, taxi_test, tyre_forces

BESIDE = {"nose": (4.4, 0.3), "left": (0.2, 1.1), "right": (-0.5, -1.9)}
FURTHER = {"tail": (-4.5, 0.0), "cabin": (2.0, 0.4)}
LOPSIDED = (PointMass(300.0, 2.5, 0.8), PointMass(-150.0, -2.0, -0.5), PointMass(80.0, -4.0, 0.0))


def run(airframe=None, *, seed=1, duration_s=3.0, lowest_step_rate_hz=2048.0, **settings):
    airframe = airframe or default_aircraft()
    settings = {"duration_s": duration_s, "lowest_step_rate_hz": lowest_step_rate_hz, **settings}
    return taxi_run(airframe, rng=np.random.default_rng(seed), **settings)


@pytest.fixture(scope="module")
def driven():
    """A lopsided aircraft that bends, with sensors away from its struts."""
    airframe = loaded(with_bending(default_aircraft()), LOPSIDED)
    return run(airframe, sprung_sensors=BESIDE, further_sensors=FURTHER)


def strut_forces(taxi):
    """Force of each strut from its travel and its law, (n, n_gears), N."""
    forces = []
    for gear in taxi.airframe.gears:
        z, rate = (taxi.truth.channel(f"{gear.name}_{what}") for what in ("travel", "travel_velocity"))
        linear = gear.suspension_stiffness_n_per_m * z + gear.suspension_damping_n_s_per_m * rate
        forces.append(linear + gear.law.force(z, rate))
    return np.stack(forces, axis=1)


def body_acceleration(taxi):
    return np.stack([taxi.truth.channel(name) for name in taxi.airframe.body_motions], axis=1)


def shifted(airframe, x_m, y_m):
    """The same aircraft in other coordinates."""
    gears = tuple(replace(gear, x_m=gear.x_m + x_m, y_m=gear.y_m + y_m) for gear in airframe.gears)
    return replace(airframe, gears=gears, x_cg_m=airframe.x_cg_m + x_m, y_cg_m=airframe.y_cg_m + y_m)


def on_ground_springs(airframe, stiffness):
    """The same aircraft with a spring to the ground at each strut."""
    gears = tuple(replace(gear, ground_stiffness_n_per_m=stiffness) for gear in airframe.gears)
    return replace(airframe, gears=gears)


# The structure


@pytest.mark.parametrize("ground", [0.0, 1e5])
def test_heave_and_pitch_are_those_of_a_beam_on_two_springs(ground):
    # wheels on tyres without give: the two roots for heave and pitch about the centre of gravity, and roll alone; a
    # spring to the ground is then beside each strut
    aircraft = on_ground_springs(default_aircraft(), ground)
    hard = tuple(replace(gear, tyre_stiffness_n_per_m=1e10, unsprung_mass_kg=1.0) for gear in aircraft.gears)
    m, ixx, iyy, front, back = 5400.0, 1.6e4, 2.7e4, 5.0 - 0.6, 0.6
    kn, km = 1.5e5 + ground, 2.0 * (4.7e5 + ground)
    heave, pitch, both = (kn + km) / m, (kn * front**2 + km * back**2) / iyy, (km * back - kn * front) ** 2 / (m * iyy)
    middle, apart = 0.5 * (heave + pitch), np.sqrt(0.25 * (heave - pitch) ** 2 + both)
    squares = sorted([middle - apart, middle + apart, km * 1.6**2 / ixx])
    found = natural_frequencies(airframe_structure(replace(aircraft, gears=hard))).frequency_hz[:3]
    np.testing.assert_allclose(found, np.sqrt(squares) / (2.0 * np.pi), rtol=1e-4)


def test_roll_on_soft_tyres_is_a_system_of_two_masses():
    # left and right against each other: b theta and one wheel
    structure = airframe_structure(default_aircraft())
    m, k, tyre, wheel = 1.6e4 / (2.0 * 1.6**2), 4.7e5, 7.4e5, 120.0
    squares = np.roots([m * wheel, -(m * (k + tyre) + wheel * k), k * tyre])
    modes = natural_frequencies(structure)
    roll = [k for k in range(6) if abs(modes.shapes[structure.index("roll"), k]) > 1e-6]
    np.testing.assert_allclose(modes.frequency_hz[roll], np.sort(np.sqrt(squares)) / (2.0 * np.pi), rtol=1e-9)


def test_the_frequencies_are_those_of_a_light_aircraft():
    modes = natural_frequencies(airframe_structure(default_aircraft()))
    np.testing.assert_allclose(modes.frequency_hz, [1.36, 1.52, 1.77, 14.9, 16.0, 16.0], atol=0.05)
    assert ((modes.zeta[:3] > 0.03) & (modes.zeta[:3] < 0.1)).all()


def test_where_the_origin_is_does_not_matter():
    there = loaded(default_aircraft(), LOPSIDED)
    there, here = (with_bending(airframe) for airframe in (there, shifted(there, -7.3, 2.1)))
    first, second = (natural_frequencies(airframe_structure(airframe)) for airframe in (there, here))
    np.testing.assert_allclose(first.frequency_hz, second.frequency_hz, rtol=1e-9)
    one, other = (run(airframe, duration_s=1.0) for airframe in (there, here))
    np.testing.assert_allclose(one.recording.samples, other.recording.samples, atol=1e-8)


def test_static_equilibrium_is_the_origin():
    structure = airframe_structure(with_bending(default_aircraft(), damping_ratio=0.1))
    still = time_response(structure, lambda t: np.zeros((t.size, 7)), fs=1024.0, duration_s=0.1)
    assert not still.displacement.any()
    lifted = [0.02, 0.005, -0.005, 0.0, 0.0, 0.0, 0.0]
    back = time_response(
        structure, lambda t: np.zeros((t.size, 7)), fs=1024.0, duration_s=15.0, initial_displacement=lifted
    )
    assert np.abs(back.displacement[-1]).max() < 1e-5


@pytest.mark.parametrize("ground", [0.0, 1e5])
def test_the_response_is_that_of_the_equations_written_out(ground):
    aircraft = on_ground_springs(loaded(with_bending(default_aircraft()), LOPSIDED), ground)
    bending = aircraft.bending
    rng = np.random.default_rng(3)
    tracks = iso8608_tracks("C", lateral_m=[0.0, 1.6, -1.6], length_m=100.0, rng=rng)
    speed = SpeedProfile(15.0, 5.0, 1.0)
    rooms = [(5.0, 0.0), (0.0, 1.6), (0.0, -1.6)]
    nose, main = (45.0, 1.5e5, 2.4e3, 2.4e5, 0.6e3, 160.0), (120.0, 4.7e5, 7.2e3, 7.4e5, 1.8e3, 480.0)
    bent = [float(bending.deflection(x)) for x, _ in rooms]

    # sums over the aircraft of 5.4 t at its centre of gravity and three masses
    body = np.diag([5400.0, 1.6e4, 2.7e4 + 5400.0 * 0.6**2, 0.25 * 0.6 * 5400.0])
    body[0, 2] = body[2, 0] = -5400.0 * 0.6
    for one in LOPSIDED:
        at = np.array([1.0, one.y_m, -one.x_m, float(bending.deflection(one.x_m))])
        body += one.mass_kg * np.outer(at, at)
    omega = 2.0 * np.pi * 8.0
    modal = 0.25 * 0.6 * 5400.0

    def rates(t, state):
        w, rx, ry, b, *wheels = state[:7]
        vw, vrx, vry, vb, *rolling = state[7:]
        push, up = np.zeros(4), []
        for k, ((x, y), (mass, stiff, damp, tyre, tyre_damp, friction)) in enumerate(
            zip(rooms, (nose, main, main), strict=True)
        ):
            z = w + y * rx - x * ry + bent[k] * b - wheels[k]
            rate = vw + y * vrx - x * vry + bent[k] * vb - rolling[k]
            force = stiff * z + damp * rate + friction * 2.0 / np.pi * np.arctan(rate / 0.02)
            held = ground * (w + y * rx - x * ry + bent[k] * b)
            push -= (force + held) * np.array([1.0, y, -x, bent[k]])
            place, way = float(speed.position_m(t)) + x, float(speed.speed_m_per_s(t))
            under = tyre * (wheels[k] - tracks[k].elevation(place))
            under += tyre_damp * (rolling[k] - tracks[k].slope(place) * way)
            up.append((force - under) / mass)
        push[3] -= modal * (omega**2 * b + 2.0 * 0.02 * omega * vb)
        return np.concatenate([state[7:], np.linalg.solve(body, push), up])

    time_s = np.arange(400) / 1000.0
    exact = integrate.solve_ivp(rates, (0.0, 0.4), np.zeros(14), t_eval=time_s, rtol=1e-6, atol=1e-8)
    ours = time_response(
        airframe_structure(aircraft),
        lambda t: tyre_forces(aircraft, tracks, speed.position_m(t), speed.speed_m_per_s(t)),
        fs=1000.0,
        duration_s=0.4,
        loads=np.eye(7)[:, 4:],
        steps_per_sample=4,
    )
    for found, expected in ((ours.displacement, exact.y[:7].T), (ours.velocity, exact.y[7:].T)):
        np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_a_landing_gear_is_an_aircraft_on_one_gear():
    alone = LandingGear(ground_stiffness_n_per_m=1.67e5)
    gear = Gear("main", 0.0, 0.0, 105.0, 3.9e5, 6e3, 6.2e5, 1.5e3, alone.law, 1.67e5)
    rigid = Airframe(1850.0, 5e3, 6e3, 0.0, 0.0, (gear,))
    road = iso8608_road("C", length_m=100.0, rng=np.random.default_rng(5))
    settings = {"fs": 1024.0, "duration_s": 2.0, "steps_per_sample": 4}

    def under(airframe):
        return lambda t: tyre_forces(airframe, [road], 15.0 * t, np.full(t.size, 15.0))

    # the two masses of Iwaniec and Uhl, Fig. 5, wheel first
    strut = Joint("strut", np.array([-1.0, 1.0]), 3.9e5, 6e3, alone.law)
    paper = Structure(
        np.diag([105.0, 1850.0]), np.diag([1.5e3, 0.0]), np.diag([6.2e5, 1.67e5]), (strut,), ("wheel", "body")
    )
    written, heaving, free = (
        time_response(structure, under(airframe), loads=np.eye(structure.n_dof)[:, [wheel]], **settings)
        for structure, airframe, wheel in (
            (paper, alone.airframe, 0),
            (airframe_structure(alone.airframe), alone.airframe, -1),
            (airframe_structure(rigid), rigid, -1),
        )
    )
    for motion in (heaving, free):
        found = motion.acceleration[:, [-1, 0]]
        np.testing.assert_allclose(found, written.acceleration, rtol=1e-9, atol=1e-9)
    assert np.abs(free.displacement[:, 1:3]).max() == 0.0


def test_a_ground_spring_carries_its_part_of_a_static_load():
    # pushed down over its centre of gravity between springs at three places: each strut and its tyre in series, the
    # spring to the ground beside them
    structure = airframe_structure(on_ground_springs(default_aircraft(), 1e5))
    _, _, stiffness = linear_matrices(structure)
    down = 1000.0 * np.array([-1.0, 0.0, 0.6, 0.0, 0.0, 0.0])
    heave, roll, pitch, *_ = np.linalg.solve(stiffness, down)
    front, back = (1.0 / (1.0 / k + 1.0 / tyre) + 1e5 for k, tyre in ((1.5e5, 2.4e5), (4.7e5, 7.4e5)))
    on_nose = 1000.0 * 0.6 / 5.0
    assert roll == pytest.approx(0.0, abs=1e-15)
    assert heave - 5.0 * pitch == pytest.approx(-on_nose / front, rel=1e-9)
    assert heave == pytest.approx(-(1000.0 - on_nose) / (2.0 * back), rel=1e-9)


def test_a_ground_spring_stays_when_the_aircraft_is_loaded():
    gears = on_ground_springs(default_aircraft(), 1e5)
    assert [gear.ground_stiffness_n_per_m for gear in loaded(gears, LOPSIDED).gears] == [1e5] * 3
    free, held = (natural_frequencies(airframe_structure(each)).frequency_hz for each in (default_aircraft(), gears))
    assert (held > free).all()


# Loadings


def test_a_loaded_airframe_has_mass_and_inertias_by_parallel_axes():
    given = replace(default_aircraft(), y_cg_m=0.05, ixy_kg_m2=300.0)
    bodies = [(5400.0, 0.6, 0.05, 1.6e4, 2.7e4, 300.0)]
    bodies += [(one.mass_kg, one.x_m, one.y_m, 0.0, 0.0, 0.0) for one in LOPSIDED]
    mass, x, y, ixx, iyy, ixy = np.array(bodies).T
    total = mass.sum()
    x_cg, y_cg = mass @ x / total, mass @ y / total
    heavy = loaded(given, LOPSIDED)
    assert heavy.mass_kg == pytest.approx(total)
    assert (heavy.x_cg_m, heavy.y_cg_m) == pytest.approx((x_cg, y_cg))
    assert heavy.ixx_kg_m2 == pytest.approx((ixx + mass * (y - y_cg) ** 2).sum())
    assert heavy.iyy_kg_m2 == pytest.approx((iyy + mass * (x - x_cg) ** 2).sum())
    assert heavy.ixy_kg_m2 == pytest.approx((ixy + mass * (x - x_cg) * (y - y_cg)).sum())
    assert heavy.gears == given.gears


@pytest.mark.parametrize("bends", [False, True])
def test_loadings_add_up_in_the_mass_matrix(bends):
    airframe = with_bending(default_aircraft()) if bends else default_aircraft()
    together, in_turn = loaded(airframe, LOPSIDED), airframe
    for one in LOPSIDED:
        in_turn = loaded(in_turn, [one])
    expected = airframe_mass(airframe)
    for one in LOPSIDED:
        (at,) = place_directions(airframe, [(one.x_m, one.y_m)])
        expected = expected + one.mass_kg * np.outer(at, at)
    for heavy in (together, in_turn):
        np.testing.assert_allclose(airframe_mass(heavy), expected, rtol=1e-12, atol=1e-6)
    back = loaded(together, [replace(one, mass_kg=-one.mass_kg) for one in LOPSIDED])
    np.testing.assert_allclose(airframe_mass(back), airframe_mass(airframe), atol=1e-6)
    assert loaded(airframe, []) == airframe


def test_a_loading_changes_neither_stiffness_nor_damping_of_the_fuselage():
    bending = with_bending(default_aircraft()).bending
    heavy = loaded(with_bending(default_aircraft()), LOPSIDED).bending
    assert heavy.modal_mass_kg > bending.modal_mass_kg
    assert heavy.stiffness_n_per_m == pytest.approx(bending.stiffness_n_per_m)
    assert heavy.damping_n_s_per_m == pytest.approx(bending.damping_n_s_per_m)


# Bending


def test_the_bending_mode_is_that_of_a_free_beam():
    airframe = with_bending(default_aircraft(), length_m=12.0)
    place_m = np.linspace(-5.4, 6.6, 4001)
    shape = airframe.bending.deflection(place_m)
    assert shape[[0, -1]] == pytest.approx([1.0, 1.0])
    assert [np.trapezoid(shape * other, place_m) for other in (1.0, place_m)] == pytest.approx([0.0, 0.0], abs=2e-3)
    assert np.trapezoid(shape**2, place_m) == pytest.approx(0.25 * 12.0, rel=1e-3)
    free = airframe_structure(airframe)
    only_body = replace(free, joints=(), stiffness=np.diag([*np.diag(free.stiffness)[:4], 0.0, 0.0, 0.0]))
    assert natural_frequencies(only_body).frequency_hz[-1] == pytest.approx(8.0)
    heavy = with_bending(default_aircraft(), beam_mass_fraction=0.8)
    assert heavy.bending.modal_mass_kg == pytest.approx(0.2 * heavy.mass_kg)
    with pytest.raises(InputError, match="has 0 times the mass of the airframe: give positive numbers"):
        with_bending(default_aircraft(), beam_mass_fraction=0)


def test_a_stiff_fuselage_is_rigid():
    rates = {"lowest_step_rate_hz": 4096.0, "duration_s": 1.0}
    rigid = run(**rates).truth
    names = ["nose_upper_z", "left_upper_z", "nose_travel", "right_travel"]

    def departure(frequency_hz):
        bent = run(with_bending(default_aircraft(), frequency_hz=frequency_hz, damping_ratio=0.05), **rates).truth
        return np.array([np.std(bent.channel(one) - rigid.channel(one)) / np.std(rigid.channel(one)) for one in names])

    # it gives by force over stiffness, with the square of the frequency
    soft, hard, harder = (departure(f) for f in (8.0, 200.0, 400.0))
    assert (soft > 0.05).all()
    np.testing.assert_allclose(hard / harder, 4.0, rtol=0.3)
    assert (harder < 2e-3).all()


# Runs


def test_the_forces_of_the_struts_move_the_centre_of_gravity():
    airframe = replace(loaded(default_aircraft(), LOPSIDED), ixy_kg_m2=900.0)
    taxi = run(airframe)
    forces, (heave, roll, pitch) = strut_forces(taxi), body_acceleration(taxi).T
    x_cg, y_cg = airframe.x_cg_m, airframe.y_cg_m
    of_cg = heave + y_cg * roll - x_cg * pitch
    assert np.std(forces.sum(axis=1) + airframe.mass_kg * of_cg) < 1e-3 * np.std(forces)
    x, y = np.array([(gear.x_m - x_cg, gear.y_m - y_cg) for gear in airframe.gears]).T
    about_x = -(airframe.ixx_kg_m2 * roll - 900.0 * pitch)
    about_y = -(airframe.iyy_kg_m2 * pitch - 900.0 * roll)
    assert np.std(forces @ y - about_x) < 1e-3 * np.std(about_x)
    assert np.std(forces @ -x - about_y) < 1e-3 * np.std(about_y)


def test_an_aircraft_that_bends_under_its_load_keeps_its_momentum():
    # the free mode carries none: that of the airframe as it was and of each mass, where it sits
    places = {f"mass {k}": (one.x_m, one.y_m) for k, one in enumerate(LOPSIDED)}
    taxi = run(loaded(with_bending(default_aircraft()), LOPSIDED), further_sensors=places)
    heave, _, pitch, _ = body_acceleration(taxi).T
    momentum = 5400.0 * (heave - 0.6 * pitch)
    for one, name in zip(LOPSIDED, places, strict=True):
        momentum = momentum + one.mass_kg * taxi.truth.channel(name)
    forces = strut_forces(taxi)
    assert np.std(forces.sum(axis=1) + momentum) < 1e-3 * np.std(forces)


def test_travel_is_the_airframe_at_the_strut_against_the_wheel():
    taxi = run(fs=2048.0, duration_s=2.0)
    for gear in ("nose", "left", "right"):
        relative = taxi.truth.channel(f"{gear}_upper_z") - taxi.truth.channel(f"{gear}_lower_z")
        rate, travel = (taxi.truth.channel(f"{gear}_{what}") for what in ("travel_velocity", "travel"))
        for once, twice in ((rate, relative), (travel, rate)):
            numeric = (once[2:] - once[:-2]) * taxi.truth.fs / 2.0
            np.testing.assert_allclose(numeric, twice[1:-1], atol=0.02 * np.std(twice))


def test_sensors_beside_the_struts_read_what_a_rigid_body_does_there():
    at_struts = run()
    beside = run(sprung_sensors=BESIDE, further_sensors=FURTHER)
    names = ["nose_upper_z", "left_upper_z", "right_upper_z"]
    upper = np.stack([at_struts.truth.channel(name) for name in names], axis=1)
    # three places tell all: a plane through what they read
    plane = np.linalg.solve([[1.0, 5.0, 0.0], [1.0, 0.0, 1.6], [1.0, 0.0, -1.6]], upper.T)
    for name, (x, y) in {**dict(zip(names, BESIDE.values(), strict=True)), **FURTHER}.items():
        np.testing.assert_allclose(beside.truth.channel(name), np.array([1.0, x, y]) @ plane, atol=1e-9)
        assert beside.places_m[name] == (x, y)
    assert beside.recording.names[6:] == ("tail", "cabin")
    assert beside.places_m["right_lower_z"] == (0.0, -1.6)


def test_sensors_on_a_bending_fuselage_read_its_shape_too(driven):
    body = body_acceleration(driven)
    assert body.shape[1] == 4
    for name, (x, y) in FURTHER.items():
        shape = float(driven.airframe.bending.deflection(x))
        np.testing.assert_allclose(driven.truth.channel(name), body @ [1.0, y, -x, shape], atol=1e-9)


@pytest.mark.parametrize("coherent_tracks", [True, False])
def test_gears_in_line_see_the_same_track_one_after_the_other(coherent_tracks):
    # under a body too heavy to move: 4 m at 8 m/s are 256 samples
    front = Gear("front", 1.0, 0.3, 100.0, 4e5, 6e3, 6e5, 1e3)
    heavy = Airframe(1e12, 1e12, 1e12, 0.0, 0.0, (front, replace(front, name="rear", x_m=-3.0)))
    truth = run(heavy, speed_m_per_s=(8.0, 8.0), coherent_tracks=coherent_tracks).truth
    ahead, behind = truth.channel("front_lower_z"), truth.channel("rear_lower_z")
    np.testing.assert_allclose(behind[256:], ahead[:-256], atol=1e-4 * np.std(ahead))
    assert abs(np.corrcoef(ahead, behind)[0, 1]) < 0.5


def test_tracks_on_one_surface_roll_the_aircraft_less_than_independent_ones():
    narrow = default_aircraft()
    gears = tuple(replace(gear, y_m=0.1 * gear.y_m) for gear in narrow.gears)
    narrow = replace(narrow, gears=gears, ixx_kg_m2=160.0)
    one, two = (run(narrow, coherent_tracks=coherent).truth.rms for coherent in (True, False))
    assert one["roll"] < 0.6 * two["roll"]


@pytest.mark.parametrize("seed", range(3))
def test_a_random_aircraft_works_its_struts(seed):
    airframe = random_aircraft(np.random.default_rng(seed))
    assert 4e3 < airframe.mass_kg < 8e3
    frequencies = natural_frequencies(airframe_structure(airframe)).frequency_hz
    assert 0.7 < frequencies[0] < frequencies[2] < 2.4
    levels = run(airframe, seed=seed, duration_s=8.0).truth.rms
    for gear in airframe.gears:
        friction = gear.law.parameters["arctan_velocity"]
        assert levels[f"{gear.name}_travel_velocity"] > 1.3 * friction["scale_m_per_s"]
        assert 1e-3 < levels[f"{gear.name}_travel"] < 2e-2


def test_gears_in_one_line_leave_an_aircraft_that_does_not_roll():
    gears = tuple(replace(gear, y_m=0.0) for gear in default_aircraft().gears)
    truth = run(replace(default_aircraft(), gears=gears), duration_s=1.0).truth
    assert not truth.channel("roll").any()
    assert truth.channel("pitch").any()


def test_a_linear_aircraft_scales_with_the_road():
    linear = tuple(replace(gear, law=LINEAR) for gear in default_aircraft().gears)
    aircraft = replace(default_aircraft(), gears=linear)
    smooth, rough = (run(aircraft, duration_s=1.0, road_class=one).truth.samples for one in "AC")
    np.testing.assert_allclose(rough, 4.0 * smooth, rtol=1e-6, atol=1e-9)


def test_another_sensor_changes_neither_the_runway_nor_the_other_channels(driven):
    bad = Sensor(noise_m_per_s2=0.1, gain=1.02)
    plain = run(driven.airframe)
    other = run(driven.airframe, further_sensors=FURTHER, sensors={"left_upper_z": bad})
    for name in plain.recording.names:
        np.testing.assert_array_equal(other.truth.channel(name), plain.truth.channel(name))
        same = np.array_equal(other.recording.channel(name), plain.recording.channel(name))
        assert same == (name != "left_upper_z")


def test_each_sensor_has_faults_of_its_own():
    faults = {
        "nose_upper_z": Sensor(noise_m_per_s2=0.0, gain=1.03),
        "left_upper_z": Sensor(noise_m_per_s2=0.0, lag_s=1.0 / 512.0),
        "left_lower_z": Sensor(noise_m_per_s2=0.0, corner_hz=0.33),
        "right_lower_z": Sensor(noise_m_per_s2=0.02),
    }
    silent = Sensor(noise_m_per_s2=0.0)
    taxi = run(duration_s=6.0, lower_sensor=silent, upper_sensor=silent, sensors=faults)
    truth, read = ({name: one.channel(name) for name in taxi.recording.names} for one in (taxi.truth, taxi.recording))
    np.testing.assert_allclose(read["nose_upper_z"], 1.03 * truth["nose_upper_z"], rtol=1e-12)
    np.testing.assert_allclose(read["left_upper_z"][1:], truth["left_upper_z"][:-1], atol=1e-9)
    # what the filter remembers from before the record has died away after three seconds
    passed = signal.lfilter(*signal.butter(1, 0.33, "highpass", fs=512.0), truth["left_lower_z"])
    late = slice(3 * 512, None)
    np.testing.assert_allclose(read["left_lower_z"][late], passed[late], atol=0.01 * np.std(truth["left_lower_z"]))
    assert np.std(read["right_lower_z"] - truth["right_lower_z"]) == pytest.approx(0.02, rel=0.05)
    for name in ("nose_lower_z", "right_upper_z"):
        np.testing.assert_array_equal(read[name], truth[name])


def test_the_recording_is_the_truth_with_noise(driven):
    names = driven.recording.names
    noise = driven.recording.samples - driven.truth.samples[:, : len(names)]
    np.testing.assert_allclose(np.std(noise, axis=0), 0.005, rtol=0.08)
    assert np.abs(np.corrcoef(noise.T) - np.eye(len(names))).max() < 0.12
    assert driven.truth.names[: len(names)] == names
    assert [driven.truth.unit(name) for name in ("nose_travel", "left_travel_velocity", "roll", "bending")] == [
        "m", "m/s", "rad/s^2", "m/s^2",
    ]  # fmt: skip


def test_the_seed_makes_the_run():
    one, same, other = (run(seed=seed, duration_s=1.0).recording.samples for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert not np.allclose(one, other)


def test_what_pushes_the_airframe_moves_it_by_its_fraction_and_changes_no_runway():
    plain, pushed = (run(pushed_fraction=fraction, duration_s=10.0) for fraction in (0.0, 0.1))
    assert np.abs(pushed.recording.samples - plain.recording.samples).max() > 0.0
    for name in ("heave", "roll", "pitch"):
        before, after = (each.truth.channel(name) for each in (plain, pushed))
        assert 0.05 < np.std(after - before) / np.std(before) < 0.2
    # a wheel feels the road first of all
    wheels = [each.truth.channel("left_lower_z") for each in (plain, pushed)]
    assert np.corrcoef(wheels)[0, 1] > 0.99


def test_an_aircraft_test_has_one_run_a_loading_each_over_its_own_runway():
    loadings = [[PointMass(500.0, 1.0)], LOPSIDED]
    rng = np.random.default_rng(1)
    test = taxi_test(default_aircraft(), rng=rng, loadings=loadings, duration_s=1.0, fs=256.0)
    assert test.loadings == ((), (PointMass(500.0, 1.0),), LOPSIDED)
    assert [taxi.airframe for taxi in test.runs] == [loaded(default_aircraft(), one) for one in test.loadings]
    wheels = np.corrcoef([taxi.truth.channel("nose_lower_z") for taxi in test.runs])
    assert np.abs(wheels - np.eye(3)).max() < 0.8
    assert {taxi.recording.fs for taxi in test.runs} == {256.0}


def bending(**changes):
    given = {"frequency_hz": 8.0, "damping_ratio": 0.02, "modal_mass_kg": 800.0}
    return BendingMode(**{**given, "stations_m": (-6.0, 0.0, 6.0), "shape": (1.0, -0.6, 1.0), **changes})


NOSE = default_aircraft().gears[0]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: replace(NOSE, unsprung_mass_kg=-45.0), "unsprung_mass_kg of the gear 'nose' is -45.0"),
        (lambda: replace(NOSE, suspension_stiffness_n_per_m=0.0), "give a positive number"),
        (lambda: replace(NOSE, tyre_damping_n_s_per_m=-1.0), "tyre_damping.* give zero or more"),
        (lambda: replace(NOSE, ground_stiffness_n_per_m=-1e5), "ground_stiffness.* give zero or more"),
        (lambda: replace(NOSE, x_m=np.nan), "x_m of the gear 'nose' is nan: give a finite"),
        (lambda: replace(NOSE, name="heave"), "called 'heave'"),
        (lambda: replace(default_aircraft(), mass_kg=-5400.0), "mass_kg of the airframe is -5400.0"),
        (lambda: replace(default_aircraft(), ixx_kg_m2=0.0), "ixx_kg_m2 of the airframe is 0.0"),
        (lambda: replace(default_aircraft(), x_cg_m=np.inf), "x_cg_m of the airframe is inf"),
        (lambda: replace(default_aircraft(), ixy_kg_m2=3e4), "not positive definite: ixy_kg_m2 is 30000.0"),
        (lambda: replace(default_aircraft(), gears=(NOSE, NOSE)), "each with a name of its own"),
        (lambda: replace(default_aircraft(), gears=(NOSE, replace(NOSE, name=""))), "each with a name of its own"),
        (lambda: replace(default_aircraft(), gears=()), "one gear or more"),
        (lambda: replace(default_aircraft(), ixx_kg_m2=None), "without ixx_kg_m2 only heaves"),
        (lambda: replace(default_aircraft(), iyy_kg_m2=None), "iyy_kg_m2 of the airframe is None"),
        (lambda: replace(default_aircraft(), bending=bending(stations_m=(-6.0, 0.0, 4.0))), "goes from -6 to 4 m"),
        (lambda: replace(default_aircraft(), bending=bending(coupling=(3e3, 0.0, 0.0))), "not positive definite"),
        (lambda: bending(frequency_hz=0.0), "has 0.0 Hz"),
        (lambda: bending(modal_mass_kg=-1.0), "-1.0 kg"),
        (lambda: bending(damping_ratio=-0.1), "the damping zero or more"),
        (lambda: bending(stations_m=(0.0, 0.0, 1.0)), "two stations or more that ascend"),
        (lambda: bending(shape=(1.0, 1.0)), "2 value"),
        (lambda: bending(shape=(1.0, np.nan, 1.0)), "give finite numbers"),
        (lambda: bending(coupling=(0.0, 0.0)), "three couplings"),
        (lambda: with_bending(default_aircraft(), length_m=-3.0), "-3.0 m long"),
        (lambda: with_bending(default_aircraft(), length_m=5.0), "give it further stations"),
        (lambda: loaded(default_aircraft(), [PointMass(np.nan, 0.0)]), "a loading of nan kg"),
        (lambda: loaded(default_aircraft(), [PointMass(-5400.0, 0.6)]), r"loadings of \[-5400.0\] kg leave"),
        (lambda: loaded(default_aircraft(), [PointMass(-900.0, 9.0)]), "not positive definite"),
        (lambda: place_directions(default_aircraft(), [1.0, 2.0]), "a pair of finite numbers"),
        (lambda: run(sprung_sensors={"tail": (0.0, 0.0)}), "sprung_sensors has a gear 'tail'"),
        (lambda: run(sprung_sensors={"nose": (0.0,)}), "a pair of finite numbers"),
        (lambda: run(further_sensors={"nose_upper_z": (0.0, 0.0)}), "a channel of a gear"),
        (lambda: run(further_sensors={"tail": (0.0, np.inf)}), "a pair of finite numbers"),
        (lambda: run(sensors={"nose_uper_z": Sensor()}), "did you mean 'nose_upper_z'"),
        (lambda: run(duration_s=0.0), "duration_s is 0.0 s"),
        (lambda: run(pushed_fraction=-0.1), "pushed_fraction is -0.1: give zero"),
        (lambda: run(fs=-1.0), "fs -1.0 Hz"),
        (lambda: run(road_class="Z"), "no road class 'Z'"),
        (lambda: run(speed_m_per_s=(-18.0, 0.0)), "speeds that are not negative"),
        (lambda: tyre_forces(default_aircraft(), [], np.zeros(3), np.zeros(3)), "one road for each gear"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()
