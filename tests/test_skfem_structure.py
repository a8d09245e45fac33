"""Structures that scikit-fem assembled are updated; their beams and plates have frequencies in closed form."""

import numpy as np
import pytest

from opid.errors import InputError
from opid.mechanics.structure import modal_assurance
from opid.updating import (
    ModelClass,
    Prior,
    UncertainTerm,
    UpdatingStudy,
    lowest_modes,
    read_structure,
    reduce,
    structure_from_skfem,
    update_study,
    write_structure,
)
from opid.updating.likelihood.noise import NoiseSettings
from opid.virtual import synthetic_backbones

skfem = pytest.importorskip("skfem")

LENGTH, BENDING, PER_LENGTH = 0.8, 26.25, 0.81  # of a steel beam, 30 mm x 5 mm: m, N m^2, kg/m
SENSORS = {"quarter": (0.2, "u"), "middle": (0.4, "u"), "off": (0.55, "u")}
CUBIC = ModelClass("cubic", (UncertainTerm("cubic_stiffness", (1e7,), (Prior("uniform", 0.0, 10.0),)),))
TRUE_FACTOR, TRUE_THETA = 0.85, 2.0


def assemble_beam(n_elements=16):
    """Return basis, mass and stiffness of a beam that bends."""
    from skfem.helpers import dd, ddot

    basis = skfem.Basis(skfem.MeshLine(np.linspace(0, LENGTH, n_elements + 1)), skfem.ElementLineHermite())
    mass = skfem.BilinearForm(lambda u, v, w: PER_LENGTH * u * v).assemble(basis)
    stiffness = skfem.BilinearForm(lambda u, v, w: BENDING * ddot(dd(u), dd(v))).assemble(basis)
    return basis, mass, stiffness


def supported_beam(**changes):
    """Return the structure of a beam that is simply supported at both ends, with a joint to the ground."""
    basis, mass, stiffness = assemble_beam()
    ends = basis.nodal_dofs[0, [0, -1]]
    given = {"mass": mass, "parts": {"E": stiffness}, "points": SENSORS, "fixed": ends, "joints": {"stop": "middle"}}
    return structure_from_skfem(basis, **(given | changes))


def test_the_frequencies_of_a_beam_are_those_in_closed_form():
    beam = supported_beam()
    eigenvalue, shapes = lowest_modes(beam.mass, beam.stiffness_at({"E": 0.9}), 3)
    order = np.arange(1, 4)
    assert eigenvalue == pytest.approx((order * np.pi / LENGTH) ** 4 * 0.9 * BENDING / PER_LENGTH, rel=1e-3)
    places = np.array([at for at, _ in SENSORS.values()])
    for mode in range(3):
        expected = np.sin((mode + 1) * np.pi * places / LENGTH)
        assert modal_assurance(shapes[beam.sensor_indices, mode], expected).item() == pytest.approx(1, abs=1e-6)


def test_degrees_of_freedom_have_the_numbers_of_nodes_and_the_names_of_components():
    beam = supported_beam()
    assert beam.n_dof == 2 * 17 - 2
    assert beam.dofs[:3] == ("0 u_x", "1 u", "1 u_x")
    assert beam.sensors == ("quarter", "middle", "off")
    assert beam.dofs.index("quarter") == beam.dofs.index("4 u_x") - 1
    assert beam.joints["stop"] == ("middle",)
    assert supported_beam(sensors=["off"], joints={"tie": ("off", "2 u")}).joints["tie"] == ("off", "2 u")


def test_views_of_constraints_and_unfactored_parts_are_taken():
    basis, _, stiffness = assemble_beam()
    clamped = supported_beam(fixed=basis.get_dofs(lambda x: x[0] == 0), stiffness=0.5 * stiffness)
    assert clamped.n_dof == 2 * 16
    eigenvalue, _ = lowest_modes(clamped.mass, clamped.stiffness_at({"E": 0.5}), 1)
    assert eigenvalue == pytest.approx(1.8751041**4 / LENGTH**4 * BENDING / PER_LENGTH, rel=1e-4)


def test_the_frequencies_of_a_plate_are_those_in_closed_form():
    from skfem.helpers import dd, ddot, trace

    a, b, rigidity, per_area, nu = 1.0, 0.7, 1300.0, 16.2, 0.33
    mesh = skfem.MeshQuad.init_tensor(np.linspace(0, a, 9), np.linspace(0, b, 7))
    basis = skfem.Basis(mesh, skfem.ElementQuadBFS(), intorder=6)
    bend = skfem.BilinearForm(
        lambda u, v, w: rigidity * ((1 - nu) * ddot(dd(u), dd(v)) + nu * trace(dd(u)) * trace(dd(v)))
    )
    across = basis.get_dofs(mesh.boundary_facets()).all("u")
    # The slope along a supported edge is zero, too.
    along_x = basis.nodal_dofs[1][np.isin(mesh.p[1], [0, b])]
    along_y = basis.nodal_dofs[2][np.isin(mesh.p[0], [0, a])]
    plate = structure_from_skfem(
        basis,
        mass=skfem.BilinearForm(lambda u, v, w: per_area * u * v).assemble(basis),
        parts={"D": bend.assemble(basis)},
        points={"centre": ((0.5, 0.35), "u"), "off": ((0.25, 0.35), "u")},
        fixed=np.concatenate([across, along_x, along_y]),
    )
    eigenvalue, _ = lowest_modes(plate.mass, plate.stiffness_at({}), 2)
    expected = [((m * np.pi / a) ** 2 + (n * np.pi / b) ** 2) ** 2 * rigidity / per_area for m, n in ((1, 1), (2, 1))]
    assert eigenvalue == pytest.approx(expected, rel=1e-3)


def test_elements_with_edges_and_interiors_and_solids_have_names():
    basis = skfem.Basis(skfem.MeshHex(), skfem.ElementVector(skfem.ElementHex2()))
    unit = skfem.BilinearForm(lambda u, v, w: u[0] * v[0] + u[1] * v[1] + u[2] * v[2]).assemble(basis)
    points = {"corner": ((1.0, 1.0, 1.0), "u^3")}
    solid = structure_from_skfem(basis, mass=unit, parts={"E": unit}, points=points)
    assert len(set(solid.dofs)) == basis.N == 81
    assert {"0 u^1", "edge 0 u^2", "facet 5 u^3", "interior 0 u^1"} <= set(solid.dofs)
    corner = np.flatnonzero((basis.doflocs == 1).all(axis=0))
    assert solid.dofs.index("corner") == corner[2]


def test_a_structure_is_written_and_read_back(tmp_path):
    beam = supported_beam()
    write_structure(tmp_path / "beam.npz", beam)
    read = read_structure(tmp_path / "beam.npz")
    assert (read.dofs, read.sensors, dict(read.joints)) == (beam.dofs, beam.sensors, dict(beam.joints))
    assert abs(read.parts["E"] - beam.parts["E"]).max() == 0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"points": {"middle": (0.4, "w")}}, "has the component 'w', which the nodes do not have"),
        ({"points": {"middle": (40.0, "u")}}, "the point 'middle' lies 39.2 m from the nearest node, 16 at [0.8]"),
        ({"points": {"middle": ((0.4, 0.0), "u")}}, "has the coordinates [0.4, 0.0]: give 1 numbers"),
        ({"points": {"middle": (np.nan, "u")}}, "has the coordinates [nan]"),
        ({"points": {"middle": (0.8, "u")}}, "is at '16 u', which is fixed"),
        ({"points": {"a": (0.4, "u"), "middle": (0.41, "u")}}, "the points 'a' and 'middle' are both at '8 u'"),
        ({"points": {"middle": (0.41, "u")}, "farthest": 0.005}, "lies 0.01 m from the nearest node"),
        ({"mass": np.eye(3)}, "the matrix 'mass' has shape (3, 3), and the basis 34 degrees of freedom"),
        ({"joints": {"stop": "midle"}}, "joint 'stop' names the degree of freedom 'midle', which does not exist"),
    ],
)
def test_what_does_not_fit_is_refused(changes, words):
    with pytest.raises(InputError) as caught:
        supported_beam(**changes)
    assert words in str(caught.value)


def test_modulus_and_joint_of_a_beam_are_updated_from_its_backbones():
    """The intervals hold the modulus and the cubic spring with which the backbones were made, as often as they say."""
    beam = supported_beam()
    true = reduce(beam, {"E": TRUE_FACTOR})
    missed, errors = 0, []
    for seed in range(6):
        curves = synthetic_backbones(
            true, CUBIC, (TRUE_THETA,), rng=np.random.default_rng(seed), modes=(1, 3), n_curves=(4, 3), n_points=8,
            controlled_sensor="middle", amplitude_m=((2e-4, 3e-3), (2e-4, 3e-3)), harmonics=(1,),
        )  # fmt: skip
        study = UpdatingStudy(
            title="beam", structure=beam, backbones=curves, classes=(CUBIC,), harmonics=(1,),
            parameters={"E": Prior("uniform", 0.3, 3.0)}, noise=NoiseSettings(motion_error=0.0), n_samples=1000,
            seed=seed,
        )  # fmt: skip
        found = update_study(study)
        factor, theta = found.linear.estimates["E"], found.classes[0].estimates["theta_1"]
        for estimate, truth in ((factor, TRUE_FACTOR), (theta, TRUE_THETA)):
            low, high = estimate.interval95
            missed += not low < truth < high
            errors.append((estimate.value - truth) / estimate.std)
        assert factor.std < 0.01
        assert theta.std < 0.02
    # Of 12 intervals of 95 % more than two miss in one of 50 such tests.
    assert missed <= 2
    assert np.abs(errors).max() < 4
