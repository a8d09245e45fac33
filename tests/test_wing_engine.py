from functools import cache

import numpy as np
import pytest
from scipy import linalg, sparse
from scipy.sparse.linalg import eigsh, spsolve

from opid.errors import InputError
from opid.virtual.backbone_tests.wing_engine import (
    JOINTS,
    SENSORS,
    WingEngine,
    beam_mass,
    beam_stiffness,
    wing_engine_structure,
)

NOMINAL, UPDATED = (1.0, 1.0), (0.88, 0.31)


@cache
def matrices(**changes):
    return wing_engine_structure(WingEngine(**changes))


def lowest_hz(of, factors, n_modes=12):
    stiffness = of.stiffness + factors[0] * of.parts["E_aluminium"] + factors[1] * of.parts["E_steel"]
    found = eigsh(stiffness.tocsc(), k=n_modes, M=of.mass.tocsc(), sigma=-100.0, return_eigenvectors=False)
    return np.sqrt(np.sort(found)) / (2 * np.pi)


def field(of, w, w_x, w_y, w_xy, given=None):
    """Degrees of freedom of a plate that bends as told, its plane at rest; leaf springs stay at 0."""
    given = given or WingEngine()
    outer = given.length_m / 2 - given.pylon_from_middle_m
    n_outer = round(given.n_along * outer / given.length_m)
    ends = [0, outer, given.length_m - outer, given.length_m]
    counts = [n_outer, given.n_along - 2 * n_outer, n_outer]
    along = np.unique(np.concatenate([np.linspace(*ends[k : k + 2], counts[k] + 1).round(12) for k in range(3)]))
    across = np.linspace(0, given.width_m, given.n_across + 1)
    x, y = (part.ravel() for part in np.meshgrid(along, across, indexing="ij"))
    values = np.stack([np.broadcast_to(f(x, y), x.shape) for f in (w, w_x, w_y, w_xy)], axis=1).ravel()
    # the motion of a block stands in for w_x at its node
    blocks = [np.argmin(np.hypot(x - at, y - given.width_m / 2)) for at in ends[1:3]]
    full = np.zeros(of.mass.shape[0])
    full[: values.size - 2] = np.delete(values, [4 * node + 1 for node in blocks])
    for name, node in zip(("9", "12"), blocks, strict=True):
        full[of.dofs.index(name)] = given.lever_m * values[4 * node + 1]
    return full


def zero(x, y):
    return 0.0


def test_a_cantilever_of_beam_elements_has_its_closed_form():
    length, bending, mass, n = 0.5, 3.0, 0.2, 6
    size = 2 * (n + 1)
    stiffness, inertia = np.zeros((size, size)), np.zeros((size, size))
    for element in range(n):
        at = np.ix_(range(2 * element, 2 * element + 4), range(2 * element, 2 * element + 4))
        stiffness[at] += beam_stiffness(bending, length / n)
        inertia[at] += beam_mass(mass / n, length / n)
    found = linalg.eigh(stiffness[2:, 2:], inertia[2:, 2:], eigvals_only=True)[:2]
    exact = np.array([1.875104068711961, 4.694091132974175]) ** 4 * bending / (mass * length**3)
    np.testing.assert_allclose(found, exact, rtol=1e-3)
    np.testing.assert_allclose(found[0], exact[0], rtol=2e-5)
    tip = np.zeros(size - 2)
    tip[-2] = 1.0
    np.testing.assert_allclose(linalg.solve(stiffness[2:, 2:], tip)[-2], length**3 / (3 * bending), rtol=1e-9)


def test_the_plate_has_the_energy_of_constant_curvature_and_twist():
    of, given = matrices(), WingEngine()
    nu = given.aluminium_poisson
    rigidity = given.aluminium_pa * given.thickness_m**3 / (12 * (1 - nu**2))
    area = given.length_m * given.width_m
    curved = field(of, lambda x, y: x**2 / 2, lambda x, y: x, zero, zero)
    twisted = field(of, lambda x, y: x * y, lambda x, y: y, lambda x, y: x, lambda x, y: 1.0)
    dished = field(of, lambda x, y: (x**2 + y**2) / 2, lambda x, y: x, lambda x, y: y, zero)
    assert curved @ of.parts["E_aluminium"] @ curved == pytest.approx(rigidity * area, rel=1e-8)
    assert twisted @ of.parts["E_aluminium"] @ twisted == pytest.approx(2 * (1 - nu) * rigidity * area, rel=1e-8)
    assert dished @ of.parts["E_aluminium"] @ dished == pytest.approx(2 * (1 + nu) * rigidity * area, rel=1e-8)


def test_rigid_motion_strains_nothing_and_moves_the_whole_mass():
    of, given = matrices(), WingEngine()
    leaf = given.steel_kg_per_m3 * given.leaf_length_m * given.leaf_width_m * given.leaf_thickness_m
    plate = given.aluminium_kg_per_m3 * given.length_m * given.width_m * given.thickness_m
    total = plate + 2 * given.block_kg + 4 * (leaf + given.tip_kg)
    up = field(of, lambda x, y: 1.0, zero, zero, zero)
    aside = np.zeros_like(up)
    aside[
        [of.dofs.index(name) for name in ("span", *SENSORS[8:], *(f"leaf {tip} 1 x" for tip in (10, 11, 13, 14)))]
    ] = 1
    chord = np.zeros_like(up)
    chord[of.dofs.index("chord")] = 1
    for rigid in (up, aside, chord):
        assert rigid @ of.mass @ rigid == pytest.approx(total, rel=1e-9)
        for part in (of.parts["E_aluminium"], of.parts["E_steel"]):
            assert np.abs(part @ rigid).max() < 1e-8 * np.abs(part).max()
        assert rigid @ of.stiffness @ rigid == pytest.approx(4 * given.suspension_n_per_m, rel=1e-9)


def test_a_leaf_spring_bends_as_a_cantilever():
    of, given = matrices(), WingEngine()
    places = [of.dofs.index(name) for name in ("leaf 10 1 x", "leaf 10 1 slope", "10", "leaf 10 2 slope")]
    flexibility = linalg.inv(of.parts["E_steel"][np.ix_(places, places)].toarray())
    second_moment = given.leaf_width_m * given.leaf_thickness_m**3 / 12
    assert 1 / flexibility[2, 2] == pytest.approx(3 * given.steel_pa * second_moment / given.leaf_length_m**3, rel=1e-9)


def test_it_reaches_the_frequencies_of_the_paper():
    of = matrices()
    nominal, updated = lowest_hz(of, NOMINAL), lowest_hz(of, UPDATED)
    np.testing.assert_allclose(nominal[6:8], [22.5, 31.1], atol=0.05)
    np.testing.assert_allclose(updated[6:8], [14.65, 17.71], atol=0.05)
    assert max(nominal[5], updated[5]) < 3.0  # six modes of the suspension, far below
    assert updated[5] > 0.5
    np.testing.assert_allclose(updated[9:11], 3 * 15.2, atol=0.1)
    assert 1100 <= of.mass.shape[0] <= 1200
    assert set(SENSORS) <= set(of.dofs)
    assert all(set(ends) <= set(SENSORS) for ends in JOINTS.values())


def test_matrices_are_symmetric_and_the_mass_is_positive():
    of = matrices()
    for part in (of.mass, of.stiffness, of.parts["E_aluminium"], of.parts["E_steel"]):
        assert sparse.issparse(part)
        assert abs(part - part.T).max() == 0.0
    assert linalg.eigvalsh(of.mass.toarray(), subset_by_index=(0, 0))[0] > 0
    assert lowest_hz(of, (1e-3, 1e-3), 2)[0] > 0


def test_a_finer_mesh_moves_the_frequencies_little():
    coarse, usual = (lowest_hz(matrices(n_along=n, n_across=m), UPDATED, 9) for n, m in ((20, 6), (30, 8)))
    np.testing.assert_allclose(coarse, usual, rtol=1.5e-3)  # a plate gives way to a moment on one point without end
    np.testing.assert_allclose(coarse[8], usual[8], rtol=1e-4)
    assert (coarse[6:] >= usual[6:] * (1 - 1e-6)).all()  # fewer functions are stiffer


def test_unequal_leaf_springs_keep_the_mean_stiffness_and_mix_the_modes():
    equal, unequal, mirrored = (matrices(leaf_asymmetry=fraction) for fraction in (0.0, 0.05, -0.05))
    assert (
        abs(unequal.parts["E_steel"] + mirrored.parts["E_steel"] - 2 * equal.parts["E_steel"]).max()
        < 1e-9 * abs(equal.parts["E_steel"]).max()
    )
    load = np.zeros(equal.mass.shape[0])
    load[[equal.dofs.index("10"), equal.dofs.index("11")]] = 1.0
    difference = []
    for of in (equal, unequal):
        moved = spsolve((of.stiffness + of.parts["E_aluminium"] + of.parts["E_steel"]).tocsc(), load)
        difference.append(moved[of.dofs.index("10")] - moved[of.dofs.index("11")])
    assert abs(difference[0]) < 1e-10 < abs(difference[1])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"thickness_m": 0.0}, "thickness_m is 0.0: give a positive number"),
        ({"tip_kg": np.nan}, "tip_kg is nan"),
        ({"pylon_from_middle_m": 0.5}, "give less than half of its length"),
        ({"n_across": 7}, "n_along is 30 and n_across 7: give at least 6 and an even number"),
        ({"leaf_asymmetry": 1.0}, "give a fraction between -1 and 1"),
        ({"aluminium_poisson": 0.5}, "give a value between -1 and 0.5"),
    ],
)
def test_what_cannot_be_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        WingEngine(**changes)
