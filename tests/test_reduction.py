from functools import cache

import numpy as np
import pytest
from scipy import linalg, sparse

from opid.errors import InputError
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.reduction import (
    craig_bampton,
    lowest_modes,
    modes_of,
    reduce,
    reduction_errors,
)
from opid.virtual.backbone_tests.wing_engine import UPDATED, wing_engine_structure


@cache
def wing():
    return wing_engine_structure()


def chain(n_dof=30, *, wall=1000.0, sensors=("1", "15", "30"), joints=None):
    """A chain of unlike masses; the first hangs on a wall unless that spring is 0."""
    springs = 1000.0 + 100.0 * np.arange(n_dof)
    full = np.diag(springs) + np.diag(np.append(springs[1:], 0.0))
    full -= np.diag(springs[1:], 1) + np.diag(springs[1:], -1)
    full[0, 0] += wall - springs[0]
    mass = sparse.diags(1.0 + 0.1 * np.arange(n_dof))
    joints = {"link": ("5", "20")} if joints is None else joints
    names = tuple(str(k + 1) for k in range(n_dof))
    return AffineStructure(mass, sparse.csr_matrix((n_dof, n_dof)), {"k": full}, names, sensors, joints)


def test_fixed_interface_modes_keep_the_first_nine_frequencies_of_the_wing():
    for factors in (UPDATED, {}):
        reduced = craig_bampton(wing(), factors)
        assert reduced.mass.shape == reduced.stiffness.shape == (29, 29)
        errors = reduction_errors(wing(), reduced, 9, factors=factors)
        assert np.abs(errors.relative).max() < 1.4e-4
        assert (errors.mac > 0.999).all()
        # Rayleigh's principle: a structure that is held to fewer shapes is stiffer
        assert (errors.relative > -1e-9).all()


def test_free_modes_are_exact_once_directions_that_are_there_twice_are_cut_off():
    reduced = craig_bampton(wing(), UPDATED, method="free")
    assert 15 < reduced.n_dof < 29
    errors = reduction_errors(wing(), reduced, 15, factors=UPDATED)
    assert np.abs(errors.relative).max() < 1e-8
    assert (errors.mac > 1 - 1e-8).all()
    np.testing.assert_allclose(reduced.mass, np.eye(reduced.n_dof), atol=1e-5)


def test_beyond_the_kept_modes_the_reduction_grows_worse():
    errors = reduction_errors(wing(), craig_bampton(wing(), UPDATED), 29, factors=UPDATED)
    assert np.abs(errors.relative[20:]).max() > 1e-3
    assert errors.mac.min() < 0.9


@pytest.mark.parametrize("method", ["fixed", "free"])
def test_modes_that_change_places_are_recognised(method):
    """Modes 18 to 20 of the wing lie within 2 % of each other, and the reduction lifts them differently."""
    reduced = craig_bampton(wing(), UPDATED, method=method)
    errors = reduction_errors(wing(), reduced, 20, factors=UPDATED)
    assert sorted(errors.nearest) == list(range(1, 21))
    moved = errors.nearest != np.arange(1, 21)
    assert set(errors.nearest[moved]) <= {18, 19, 20}
    assert moved.any()
    assert (errors.mac[moved] < 0.1).all()
    assert (errors.nearest_mac > 0.9).all()
    np.testing.assert_array_equal(errors.nearest_mac[~moved], errors.mac[~moved])
    assert (errors.method, errors.n_dof, errors.n_cut) == (method, reduced.n_dof, 29 - reduced.n_dof)


def test_a_mode_that_is_like_none_has_no_nearest_one():
    structure = chain()
    reduced = craig_bampton(structure, n_modes=0)
    errors = reduction_errors(structure, reduced, reduced.n_dof)
    lost = errors.nearest == 0
    assert lost.any()
    assert (errors.nearest_mac[lost] < 0.5).all()
    assert (errors.nearest_mac[~lost] >= 0.5).all()


@pytest.mark.parametrize("method", ["fixed", "free"])
def test_with_all_modes_nothing_is_lost(method):
    structure = chain()
    n_modes = 25 if method == "fixed" else 30
    errors = reduction_errors(structure, craig_bampton(structure, n_modes=n_modes, method=method), 30)
    np.testing.assert_allclose(errors.reduced_hz, errors.frequency_hz, rtol=1e-9)
    np.testing.assert_allclose(errors.mac, 1.0, atol=1e-9)


def test_ends_of_joints_that_are_no_sensors_are_kept():
    reduced = craig_bampton(chain(), n_modes=4)
    assert reduced.boundary == ("1", "15", "30", "5", "20")
    np.testing.assert_array_equal(reduced.sensor_rows[:, :5], np.eye(5)[:3])
    np.testing.assert_array_equal(reduced.joint_rows, [[0, 0, 0, -1, 1, 0, 0, 0, 0]])
    np.testing.assert_array_equal(reduced.sensor_rows, reduced.basis[[0, 14, 29]])


def test_a_reduction_to_the_boundary_alone_has_the_static_stiffness():
    structure = chain()
    reduced = craig_bampton(structure, n_modes=0)
    full = structure.stiffness_at({}).toarray()
    kept = [0, 14, 29, 4, 19]
    np.testing.assert_allclose(linalg.inv(reduced.stiffness), linalg.inv(full)[np.ix_(kept, kept)], rtol=1e-9)


def test_modes_are_those_of_the_reduced_matrices():
    reduced = craig_bampton(wing(), UPDATED)
    modes, again = modes_of(reduced), reduce(wing(), UPDATED)
    np.testing.assert_array_equal(modes.eigenvalue, again.eigenvalue)
    assert modes.sensors == wing().sensors
    assert modes.joints == tuple(wing().joints)
    np.testing.assert_allclose(modes.eigenvalue, linalg.eigvalsh(reduced.stiffness, reduced.mass), rtol=1e-9)
    # the joint 9-10 stretches by what sensor 10 moves beyond sensor 9
    nine, ten = modes.sensor("9"), modes.sensor("10")
    stretch = modes.at_sensors[ten] - modes.at_sensors[nine]
    np.testing.assert_allclose(modes.at_joints[modes.joints.index("9-10")], stretch, atol=1e-12)


def test_factors_scale_the_stiffness():
    once, four = (reduce(chain(), {"k": factor}).frequency_hz for factor in (1.0, 4.0))
    np.testing.assert_allclose(four, 2 * once, rtol=1e-9)


def test_sparse_and_dense_modes_agree():
    mass, stiffness = wing().mass, wing().stiffness_at({})
    value, shapes = lowest_modes(mass, stiffness, 12)
    exact = linalg.eigvalsh(stiffness.toarray(), mass.toarray(), subset_by_index=(0, 11))
    np.testing.assert_allclose(value, exact, rtol=1e-5)  # the dense solver loses the low ones to rounding
    np.testing.assert_allclose(shapes.T @ mass @ shapes, np.eye(12), atol=1e-8)
    again = lowest_modes(mass, stiffness, 12)
    np.testing.assert_array_equal(value, again[0])
    np.testing.assert_array_equal(shapes, again[1])


def test_a_free_structure_has_a_rigid_mode_at_zero():
    floating = chain(250, wall=0.0)
    for method in ("fixed", "free"):
        errors = reduction_errors(floating, craig_bampton(floating, n_modes=30, method=method), 10)
        assert errors.reduced_hz[0] < 1e-3 * errors.frequency_hz[1]
        assert np.abs(errors.relative[1:]).max() < 1e-3


def test_records_cannot_be_changed():
    reduced = craig_bampton(chain())
    for array in (reduced.mass, reduced.stiffness, reduced.basis, reduced.sensor_rows, reduced.joint_rows):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1.0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"factors": {"K": 1.0}}, "there is no parameter 'K'"),
        ({"factors": {"k": 0.0}}, "factor 'k' is 0.0: give a positive number"),
        ({"factors": {"k": np.nan}}, "factor 'k' is nan"),
        ({"n_modes": 26}, "n_modes is 26: give a number from 0 to 25"),
        ({"n_modes": -1}, "n_modes is -1"),
        ({"method": "fix"}, "there is no reduction 'fix': give 'fixed' or 'free'"),
    ],
)
def test_bad_settings_are_told(settings, message):
    with pytest.raises(InputError, match=message):
        craig_bampton(chain(), **settings)


def test_bad_structures_and_counts_are_told():
    loose = sparse.diags(np.array([1.0, 1.0, 0.0])).tocsr()
    parted = AffineStructure(sparse.identity(3), loose, {}, ("a", "b", "c"), ("a",), {})
    with pytest.raises(InputError, match="can still move freely with its sensors and joints held"):
        craig_bampton(parted, n_modes=1)
    with pytest.raises(InputError, match="the stiffness is not positive: its lowest eigenvalue is -4 1/s"):
        lowest_modes(np.eye(2), np.diag([1.0, -4.0]), 2)
    with pytest.raises(InputError, match="3 modes of 2 degrees of freedom"):
        lowest_modes(np.eye(2), np.eye(2), 3)
    reduced = craig_bampton(chain(), n_modes=2)
    with pytest.raises(InputError, match="n is 8: give a number from 1 to 7"):
        reduction_errors(chain(), reduced, 8)
