import numpy as np
import pytest

from opid.errors import InputError
from opid.mechanics.laws.law import law
from opid.mechanics.structure import Joint, Sliders, Structure, linear_matrices, natural_frequencies
from opid.modal.linear.modes import condition_number
from opid.virtual.modal_tests.bolted_structures import component_assembly, fixture_and_plate, level_dependence

# 10 g at the component that moves most, 300 g at the drive point
TOP_OF_CASE, TOP_OF_PLATE = 98.1, 2943.0


def shapes_of(bolted):
    return bolted.rig.sensors @ natural_frequencies(bolted.rig.structure).shapes


def amplitude(bolted, mode, top, sensor=None):
    shape = shapes_of(bolted)[:, mode - 1]
    seen = np.abs(shape).max() if sensor is None else abs(shape[bolted.rig.sensor_names.index(sensor)])
    return top / seen / (2 * np.pi * natural_frequencies(bolted.rig.structure).frequency_hz[mode - 1]) ** 2


def assurance(shapes):
    norms = np.sum(shapes**2, axis=0)
    return (shapes.T @ shapes) ** 2 / np.outer(norms, norms)


def test_the_case_has_six_rigid_and_twelve_elastic_modes_well_apart():
    bolted = component_assembly()
    modes = natural_frequencies(bolted.rig.structure)
    assert bolted.rig.structure.n_dof == 18
    np.testing.assert_allclose(modes.frequency_hz[:6], 0.0, atol=0.01)
    elastic = modes.frequency_hz[6:]
    assert elastic[0] > 80.0
    assert elastic[-1] < 800.0
    assert (elastic[1:] / elastic[:-1]).min() > 1.1
    assert ((modes.zeta[6:] > 0.002) & (modes.zeta[6:] < 0.008)).all()


def test_the_case_moves_and_turns_freely():
    bolted = component_assembly()
    _, damping, stiffness = linear_matrices(bolted.rig.structure)
    # case and components together, along an axis and about it
    for axis in range(3):
        rigid = np.zeros(18)
        rigid[axis] = 1.0
        rigid[6 + axis :: 3] = 1.0
        np.testing.assert_allclose(stiffness @ rigid, 0.0, atol=1e-6)
        np.testing.assert_allclose(damping @ rigid, 0.0, atol=1e-9)
    assert np.linalg.matrix_rank(stiffness, tol=1.0) == 12


def test_the_sensors_of_the_case_tell_its_modes_apart():
    bolted = component_assembly()
    assert bolted.rig.sensors.shape == (25, 18)
    assert len(bolted.rig.sensor_names) == 25
    assert condition_number(bolted.modes) < 15.0
    assert np.linalg.cond(shapes_of(bolted)[:24]) < 15.0
    drive = shapes_of(bolted)[bolted.rig.sensor_names.index(bolted.drive_point)]
    assert np.abs(drive[np.array(bolted.nonlinear_modes) - 1]).min() > 0.01


def test_of_the_case_the_nonlinear_modes_shift_and_no_other():
    bolted = component_assembly()
    modes = natural_frequencies(bolted.rig.structure)
    for mode in range(7, 19):
        top = level_dependence(bolted.rig.structure, mode=mode, amplitude=amplitude(bolted, mode, TOP_OF_CASE))
        shift = top.frequency_hz[0] / modes.frequency_hz[mode - 1] - 1.0
        growth = top.zeta[0] / modes.zeta[mode - 1]
        if mode in bolted.nonlinear_modes:
            assert -0.03 < shift < -0.005
            assert 1.3 < growth < 3.0
        else:
            assert abs(shift) < 5e-4
            assert growth < 1.05


def test_the_plate_has_six_rigid_and_twenty_elastic_modes():
    bolted = fixture_and_plate(ratio=2.02)
    modes = natural_frequencies(bolted.rig.structure)
    assert bolted.rig.structure.n_dof == 26
    assert len(bolted.rig.sensor_names) == len(bolted.rig.sensors) >= 30
    np.testing.assert_allclose(modes.frequency_hz[:6], 0.0, atol=0.01)
    assert modes.frequency_hz[6] > 50.0
    np.testing.assert_allclose(modes.frequency_hz[[9, 17]], [400.0, 808.0], rtol=1e-9)
    np.testing.assert_allclose(np.abs(modes.shapes[6:, 6:]), np.eye(20), atol=1e-9)
    assert 7.0 < condition_number(bolted.modes) < 11.0


def test_of_the_plate_two_modes_look_alike_and_the_opening_is_hardly_driven():
    bolted = fixture_and_plate()
    shapes = shapes_of(bolted)
    mac = assurance(shapes)
    assert mac[20, 21] == pytest.approx(0.6, abs=0.02)
    assert np.delete(mac[17], 17).max() < 0.3
    drive = np.abs(shapes[bolted.rig.sensor_names.index("drive")])
    assert drive[17] < 0.06 * drive[9]


def test_the_shear_of_the_plate_softens_and_the_others_stay():
    bolted = fixture_and_plate()
    top = amplitude(bolted, 10, TOP_OF_PLATE, "drive")
    modes = natural_frequencies(bolted.rig.structure)
    shear = level_dependence(bolted.rig.structure, mode=10, amplitude=[0.1 * top, top])
    assert (np.diff(shear.frequency_hz) < 0).all()
    assert (np.diff(shear.zeta) > 0).all()
    assert 0.01 < 1.0 - shear.frequency_hz[1] / 400.0 < 0.06
    assert shear.zeta[1] > 2.0 * modes.zeta[9]
    for mode in set(range(7, 27)) - {10, 18}:
        assert level_dependence(bolted.rig.structure, mode=mode, amplitude=top).frequency_hz[0] == pytest.approx(
            modes.frequency_hz[mode - 1], rel=1e-9
        )


def test_without_coupling_the_joint_has_no_asymmetry():
    assert [joint.name for joint in fixture_and_plate(coupling_n_per_m2=0.0).rig.structure.joints] == ["joint in shear"]
    assert len(fixture_and_plate().rig.structure.joints) == 2


@pytest.mark.parametrize("build", [component_assembly, fixture_and_plate])
def test_the_structures_are_the_same_each_time(build):
    one, other = build(), build()
    np.testing.assert_array_equal(one.rig.sensors, other.rig.sensors)
    np.testing.assert_array_equal(one.rig.structure.stiffness, other.rig.structure.stiffness)
    np.testing.assert_array_equal(one.rig.structure.mass, one.rig.structure.mass.T)
    assert len(set(one.rig.sensor_names)) == len(one.rig.sensor_names)
    assert one.drive_point in one.rig.sensor_names


def test_level_dependence_has_its_closed_form_for_a_cube_and_for_square_damping():
    f = law("cubic_stiffness", stiffness_n_per_m3=5e8) + law("quadratic_damping", damping_n_s2_per_m2=40.0)
    omega, mass, a = 2 * np.pi * 50.0, 2.0, np.array([1e-4, 1e-3])
    oscillator = Structure([[mass]], [[0.0]], [[mass * omega**2]], (Joint("j", (1,), 0.0, 3.0, f),))
    found = level_dependence(oscillator, mode=1, amplitude=a * np.sqrt(mass))
    np.testing.assert_allclose((2 * np.pi * found.frequency_hz) ** 2, omega**2 + 0.75 * 5e8 * a**2 / mass, rtol=1e-9)
    damping = 3.0 + 8.0 / (3.0 * np.pi) * 40.0 * 2 * np.pi * found.frequency_hz * a
    np.testing.assert_allclose(2 * found.zeta * 2 * np.pi * found.frequency_hz * mass, damping, rtol=1e-6)


def test_level_dependence_has_its_closed_form_for_one_slider():
    stiffness, slip, omega, a = 1e5, 20.0, 2 * np.pi * 50.0, 1e-3
    oscillator = Structure([[1.0]], [[0.0]], [[omega**2]], (Joint("j", (1,), sliders=Sliders([stiffness], [slip])),))
    found = level_dependence(oscillator, mode=1, amplitude=a, n_phases=4096)
    at = 2 * np.pi * found.frequency_hz[0]
    # energy of a cycle of an elastic-perfectly-plastic spring
    energy = 4.0 * slip * (a - slip / stiffness)
    damping = energy / (np.pi * at * a**2)
    assert 2 * found.zeta[0] * 2 * np.pi * found.frequency_hz[0] == pytest.approx(damping, rel=1e-4)


def test_bad_input_is_refused():
    with pytest.raises(InputError, match=r"ratio is 2\.5"):
        fixture_and_plate(ratio=2.5)
    with pytest.raises(InputError, match="finite coupling"):
        fixture_and_plate(coupling_n_per_m2=np.inf)
    structure = component_assembly().rig.structure
    with pytest.raises(InputError, match="no elastic mode 3"):
        level_dependence(structure, mode=3, amplitude=1e-3)
    with pytest.raises(InputError, match="no elastic mode 19"):
        level_dependence(structure, mode=19, amplitude=1e-3)
    with pytest.raises(InputError, match="positive"):
        level_dependence(structure, mode=7, amplitude=[0.0])
    softening = Joint("joint", (1.0,), law=law("cubic_stiffness", stiffness_n_per_m3=-1.0))
    with pytest.raises(InputError, match="no stiffness left at an amplitude of 2"):
        level_dependence(Structure([[1.0]], [[0.0]], [[1.0]], (softening,)), mode=1, amplitude=[0.1, 2.0])
