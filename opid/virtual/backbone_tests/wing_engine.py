"""The wing-engine structure of Song et al. (2021) section 3: an aluminium plate with two pylons, as finite elements."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy import sparse

from opid.errors import InputError, require, require_positive
from opid.mechanics.laws.law import FloatArray
from opid.signals.files import write_whole
from opid.updating.model_class import ModelClass
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.matrices_file import PART

PLATE_SENSORS = ("1", "2", "3", "4", "5", "6", "7", "8")
PYLONS = (("9", "10", "11"), ("12", "13", "14"))  # sensors of each pylon: block, front leaf spring, back leaf spring
SENSORS = (*PLATE_SENSORS, *PYLONS[0], *PYLONS[1])
JOINTS = {f"{block}-{tip}": (block, tip) for block, *tips in PYLONS for tip in tips}
PLATE_DOFS = ("w", "w_x", "w_y", "w_xy")
PLATE_SENSOR_FRACTIONS = (0.07, 0.4, 0.6, 0.93)
"""Positions of sensors 1 to 4 on the front edge of the plate, and of 5 to 8 on the back edge, over its length."""
LEAF_ELEMENTS = 2
E_ALUMINIUM, E_STEEL = "E_aluminium", "E_steel"
UPDATED = {E_ALUMINIUM: 0.88, E_STEEL: 0.31}  # the paper's result (Table 1), fractions of 68.9 and 200 GPa


@dataclass(frozen=True)
class WingEngine:
    """Dimensions of the wing-engine structure.

    The paper gives the plate and the two moduli. The leaf springs, the tip masses and their link are chosen to reach
    its frequencies. The paper does not give the positions of the pylons, the masses of their blocks, the shape of tip
    masses, and the springs of the suspension. Their values are plausible and calibrated: modes 7 and 8, the first two
    that bend, lie at 22.5 and 31.1 Hz for the nominal moduli and at 14.65 and 17.71 Hz for (0.88, 0.31) times them, and
    three times 15.2 Hz is the frequency of the modes in which the two leaf springs of a pylon move against each other.
    The calibration holds for this mesh: each block turns one node, and a plate is softer there if the mesh is finer
    (0.1 % in frequency from 20 x 6 to 30 x 8 elements).

    Args:
        length_m: length of the plate, along x.
        width_m: width of the plate, along y.
        thickness_m: thickness of the plate.
        n_along: number of elements along x.
        n_across: number of elements along y; even, for the pylons hang on the middle line.
        aluminium_pa: Young's modulus of the plate.
        aluminium_poisson: Poisson's ratio of the plate.
        aluminium_kg_per_m3: density of the plate.
        suspension_n_per_m: stiffness of each of the 12 springs, three at every corner.
        pylon_from_middle_m: distance of each pylon from the middle of the plate, along x.
        block_kg: mass of the block of a pylon, rigid.
        block_depth_m: distance from the lower face of the plate down to the clamp of the leaf springs.
        leaf_length_m: free length of a leaf spring, downwards.
        leaf_width_m: width of a leaf spring, along y.
        leaf_thickness_m: thickness of a leaf spring, along x, the direction in which it bends.
        leaf_spacing_m: distance of the middle lines of the two leaf springs of a pylon, along y.
        steel_pa: Young's modulus of the leaf springs.
        steel_kg_per_m3: density of the leaf springs.
        tip_kg: mass at the end of each leaf spring.
        tip_inertia_kg_m2: moment of inertia of that mass about y through its centre; it turns as the leaf spring bends.
        tip_below_m: distance of the centre of that mass below the end of the leaf spring.
        link_n_per_m: stiffness of the link between the two ends.
        leaf_asymmetry: fraction by which the front leaf spring of each pylon is stiffer than nominal and the back one
            softer; 0.05 makes a 3:1 interaction near 15.3 Hz.

    Raises:
        InputError: a dimension that is not positive, pylons beyond the plate, counts of elements that cannot be, or
            an asymmetry that leaves no stiffness.
    """

    length_m: float = 1.0
    width_m: float = 0.220
    thickness_m: float = 0.006
    n_along: int = 30
    n_across: int = 8
    aluminium_pa: float = 68.9e9
    aluminium_poisson: float = 0.33
    aluminium_kg_per_m3: float = 2700.0
    suspension_n_per_m: float = 50.0
    pylon_from_middle_m: float = 0.2018
    block_kg: float = 0.582
    block_depth_m: float = 0.050
    leaf_length_m: float = 0.060
    leaf_width_m: float = 0.030
    leaf_thickness_m: float = 0.0013056
    leaf_spacing_m: float = 0.060
    steel_pa: float = 200e9
    steel_kg_per_m3: float = 7850.0
    tip_kg: float = 0.39317
    tip_inertia_kg_m2: float = 7.43e-5
    tip_below_m: float = 0.00282
    link_n_per_m: float = 2e4
    leaf_asymmetry: float = 0.0

    def __post_init__(self) -> None:
        signed = ("leaf_asymmetry", "aluminium_poisson", "n_along", "n_across")
        for name, value in vars(self).items():
            if name not in signed:
                require_positive(name, value)
        if self.n_along < 6 or self.n_across < 2 or self.n_across % 2:
            raise InputError(
                f"n_along is {self.n_along} and n_across {self.n_across}: give at least 6 and an even number from 2"
            )
        if not -1 < self.leaf_asymmetry < 1:
            raise InputError(f"leaf_asymmetry is {self.leaf_asymmetry}: give a fraction between -1 and 1")
        if not -1 < self.aluminium_poisson < 0.5:
            raise InputError(f"aluminium_poisson is {self.aluminium_poisson}: give a value between -1 and 0.5")
        if 2 * self.pylon_from_middle_m >= self.length_m:
            raise InputError(
                f"pylon_from_middle_m is {self.pylon_from_middle_m} on a plate of {self.length_m} m: "
                "give less than half of its length"
            )

    @property
    def lever_m(self) -> float:
        """Distance from the middle plane of the plate down to the clamp of the leaf springs."""
        return self.thickness_m / 2 + self.block_depth_m


def laws_of_pylons(one: ModelClass, other: ModelClass) -> ModelClass:
    """Return the class in which the pylons have laws of their own, with the parameters of `one` first.

    >>> from opid.updating.model_class import PAPER_CLASSES
    >>> laws_of_pylons(*PAPER_CLASSES[:2]).law_in_words
    'quadratic at 9-10, 9-11 + cubic at 12-13, 12-14'
    """
    terms = [
        replace(term, joints=tuple(f"{block}-{tip}" for tip in tips))
        for each, (block, *tips) in zip((one, other), PYLONS, strict=True)
        for term in each.terms
    ]
    return ModelClass(f"{one.name} and {other.name}", tuple(terms))


def wing_engine_structure(dimensions: WingEngine | None = None) -> AffineStructure:
    """Return the wing-engine structure: 14 sensors "1" to "14", four joints, factors E_aluminium and E_steel.

    The plate bends (Bogner-Fox-Schmit elements of scikit-fem: w, w_x, w_y, w_xy at every node) and is rigid in its
    plane (x, y and yaw). The rigid block of a pylon follows the plate; its horizontal motion x_b = x + d w_x takes the
    place of w_x at its node, so that it is a degree of freedom of its own. The leaf springs are Euler-Bernoulli beams
    that bend along x and carry the tip masses; along y and z they are rigid. The factors multiply the stiffness of the
    plate and of the leaf springs at their nominal moduli; that of the suspension and of the links is not updated.

    Args:
        dimensions: dimensions of the structure, `WingEngine(leaf_asymmetry=0.05)` for one with a 3:1 interaction; those
            of the calibrated symmetric one where left out.

    Raises:
        InputError: scikit-fem is not installed.

    >>> structure = wing_engine_structure()
    >>> structure.n_dof, sorted(structure.joints)
    (1135, ['12-13', '12-14', '9-10', '9-11'])
    """
    given = WingEngine() if dimensions is None else dimensions
    along, across = _place_mesh_lines(given)
    plate_mass, plate_stiffness = _assemble_plate(given, along, across)
    indices = _Indices(given, along, across)
    mass, suspension, steel = (_Sum(indices.n_full) for _ in range(3))
    mass.add_matrix(plate_mass, np.arange(indices.n_plate))
    aluminium = _Sum(indices.n_full)
    aluminium.add_matrix(plate_stiffness, np.arange(indices.n_plate))
    plate_kg = given.aluminium_kg_per_m3 * given.length_m * given.width_m * given.thickness_m
    for index in (indices.span, indices.chord):
        mass.add_row(plate_kg, {index: 1.0})
    mass.add_row(plate_kg * (given.length_m**2 + given.width_m**2) / 12, {indices.yaw: 1.0})
    for x in (0.0, given.length_m):
        for y in (0.0, given.width_m):
            for row in indices.express_motion(x, y):
                suspension.add_row(given.suspension_n_per_m, row)
    for pylon in range(len(PYLONS)):
        _add_pylon(given, indices, pylon, mass, suspension, steel)
    follow = indices.tie_blocks()
    matrices = (_symmetrise(follow.T @ part.assemble() @ follow) for part in (mass, suspension, aluminium, steel))
    whole, fixed, plate, leaves = matrices
    return AffineStructure(whole, fixed, {E_ALUMINIUM: plate, E_STEEL: leaves}, indices.name_dofs(), SENSORS, JOINTS)


def _place_mesh_lines(given: WingEngine) -> tuple[FloatArray, FloatArray]:
    """Return lines of the mesh along x, one through each pylon and as even as that allows, and along y."""
    outer = given.length_m / 2 - given.pylon_from_middle_m
    n_outer = min(max(1, round(given.n_along * outer / given.length_m)), (given.n_along - 1) // 2)
    ends = (0.0, outer, given.length_m - outer, given.length_m)
    counts = (n_outer, given.n_along - 2 * n_outer, n_outer)
    parts = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(ends[:-1], ends[1:], counts, strict=True)]
    along = np.concatenate([*parts, [given.length_m]])
    return along, np.linspace(0.0, given.width_m, given.n_across + 1)


def _assemble_plate(given: WingEngine, along: FloatArray, across: FloatArray) -> tuple[Any, Any]:
    """Return mass and stiffness of the bending plate, four degrees of freedom for each node, node after node."""
    require("skfem", "the wing-engine structure", "scikit-fem", "wing")
    import skfem
    from skfem.helpers import dd, ddot, dot, grad, trace

    mesh = skfem.MeshQuad.init_tensor(along, across)
    basis = skfem.Basis(mesh, skfem.ElementQuadBFS(), intorder=6)
    nu = given.aluminium_poisson
    rigidity = given.aluminium_pa * given.thickness_m**3 / (12 * (1 - nu**2))
    per_area = given.aluminium_kg_per_m3 * given.thickness_m

    @skfem.BilinearForm
    def bending(u: Any, v: Any, _: Any) -> Any:
        return rigidity * ((1 - nu) * ddot(dd(u), dd(v)) + nu * trace(dd(u)) * trace(dd(v)))

    @skfem.BilinearForm
    def inertia(u: Any, v: Any, _: Any) -> Any:
        return per_area * (u * v + given.thickness_m**2 / 12 * dot(grad(u), grad(v)))

    # The nodes are ordered by x, then by y; the mesh has another order.
    node = np.lexsort((mesh.p[1].round(9), mesh.p[0].round(9)))
    order = basis.nodal_dofs[:, node].T.ravel()
    return inertia.assemble(basis)[order][:, order], bending.assemble(basis)[order][:, order]


Row = dict[int, float]  # a motion as a sum of degrees of freedom: factor by index


class _Indices:
    """The index of each degree of freedom, before the blocks take the place of w_x at their nodes."""

    def __init__(self, given: WingEngine, along: FloatArray, across: FloatArray) -> None:
        self.given, self.along, self.across = given, along, across
        self.n_plate = len(PLATE_DOFS) * along.size * across.size
        self.span, self.chord, self.yaw = range(self.n_plate, self.n_plate + 3)
        self.n_full = self.n_plate + 3 + len(PYLONS) * (1 + 2 * 2 * LEAF_ELEMENTS)

    def find_node(self, x: float, y: float) -> int:
        """Return the index of w of the node nearest to (x, y); its slopes follow."""
        column, line = np.argmin(np.abs(self.along - x)), np.argmin(np.abs(self.across - y))
        return int(len(PLATE_DOFS) * (column * self.across.size + line))

    def find_pylon(self, pylon: int) -> tuple[float, int, int]:
        """x of a pylon, index of w at its node, index of the motion of its block."""
        x = self.given.length_m / 2 + (2 * pylon - 1) * self.given.pylon_from_middle_m
        return x, self.find_node(x, self.given.width_m / 2), self.n_plate + 3 + pylon * (1 + 4 * LEAF_ELEMENTS)

    def express_motion(self, x: float, y: float) -> tuple[Row, Row, Row]:
        """Motion along x, y and z of a node of the plate, in its middle plane."""
        from_x, from_y = x - self.given.length_m / 2, y - self.given.width_m / 2
        return {self.span: 1.0, self.yaw: -from_y}, {self.chord: 1.0, self.yaw: from_x}, {self.find_node(x, y): 1.0}

    def express_below(self, pylon: int, off: float, depth: float) -> tuple[Row, Row]:
        """Motion along y and z of a point that is rigid with the node of a pylon, `depth` below and `off` along y."""
        x, w, _ = self.find_pylon(pylon)
        return {self.chord: 1.0, self.yaw: x - self.given.length_m / 2, w + 2: depth}, {w: 1.0, w + 2: off}

    def express_leaf(self, pylon: int, back: int) -> list[Row]:
        """Deflection and slope of the nodes of a leaf spring, from the clamp to the tip."""
        _, w, block = self.find_pylon(pylon)
        off = (2 * back - 1) * self.given.leaf_spacing_m / 2
        first = block + 1 + 2 * LEAF_ELEMENTS * back
        free = [{first + index: 1.0} for index in range(2 * LEAF_ELEMENTS)]
        return [{block: 1.0, self.yaw: -off}, {w + 1: 1.0}, *free]

    def tie_blocks(self) -> sparse.csr_matrix:
        """(n_full, n_dof) with w_x = (x_block - x_plate) / depth at the node of each pylon."""
        columns = np.delete(np.arange(self.n_full), [self.find_pylon(k)[1] + 1 for k in range(len(PYLONS))])
        follow = sparse.identity(self.n_full, format="lil")[:, columns]
        column_of = {int(full): k for k, full in enumerate(columns)}
        for pylon in range(len(PYLONS)):
            _, w, block = self.find_pylon(pylon)
            follow[w + 1, column_of[block]] = 1 / self.given.lever_m
            follow[w + 1, column_of[self.span]] = -1 / self.given.lever_m
        return follow.tocsr()

    def name_dofs(self) -> tuple[str, ...]:
        """Return the names of the remaining degrees of freedom; the sensors carry their numbers."""
        nodes = [f"plate {i} {j}" for i in range(self.along.size) for j in range(self.across.size)]
        names = [f"{node} {kind}" for node in nodes for kind in PLATE_DOFS] + ["span", "chord", "yaw"]
        for block, *tips in PYLONS:
            names.append(block)
            for tip in tips:
                inner = [f"leaf {tip} {k} {kind}" for k in range(1, LEAF_ELEMENTS) for kind in ("x", "slope")]
                names += [*inner, tip, f"leaf {tip} {LEAF_ELEMENTS} slope"]
        ends = [(edge, along) for edge in (0.0, 1.0) for along in PLATE_SENSOR_FRACTIONS]
        for sensor, (y, x) in zip(PLATE_SENSORS, ends, strict=True):
            names[self.find_node(x * self.given.length_m, y * self.given.width_m)] = sensor
        gone = {self.find_pylon(k)[1] + 1 for k in range(len(PYLONS))}
        return tuple(name for index, name in enumerate(names) if index not in gone)


class _Sum:
    """A sparse matrix that is assembled from small ones."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.rows: list[Any] = []
        self.columns: list[Any] = []
        self.entries: list[Any] = []

    def add_matrix(self, matrix: Any, indices: Any) -> None:
        found = sparse.coo_matrix(matrix)
        self.rows.append(np.asarray(indices)[found.row])
        self.columns.append(np.asarray(indices)[found.col])
        self.entries.append(found.data)

    def add_row(self, factor: float, row: Row) -> None:
        """Add a factor times the square of a motion."""
        values = np.array(list(row.values()))
        self.add_matrix(factor * np.outer(values, values), list(row))

    def add_element(self, element: FloatArray, rows: list[Row]) -> None:
        """Add a small matrix whose rows and columns are motions."""
        indices = sorted({index for row in rows for index in row})
        motions = np.array([[row.get(index, 0.0) for index in indices] for row in rows])
        self.add_matrix(motions.T @ element @ motions, indices)

    def assemble(self) -> sparse.csr_matrix:
        entries, rows, columns = (np.concatenate(part) for part in (self.entries, self.rows, self.columns))
        return sparse.coo_matrix((entries, (rows, columns)), shape=(self.size, self.size)).tocsr()


def _add_pylon(given: WingEngine, indices: _Indices, pylon: int, mass: _Sum, link: _Sum, steel: _Sum) -> None:
    """Add the block, the two leaf springs, their tip masses and the link between them."""
    _, w, block = indices.find_pylon(pylon)
    depth = given.lever_m
    for row in ({indices.span: 0.5, block: 0.5}, *indices.express_below(pylon, 0.0, depth / 2)):
        mass.add_row(given.block_kg, row)
    for slope in (w + 1, w + 2):
        mass.add_row(given.block_kg * depth**2 / 12, {slope: 1.0})
    tips = []
    for back in (0, 1):
        rows = indices.express_leaf(pylon, back)
        off = (2 * back - 1) * given.leaf_spacing_m / 2
        stiffer = 1 + given.leaf_asymmetry * (1 - 2 * back)
        span = given.leaf_length_m / LEAF_ELEMENTS
        section = given.leaf_width_m * given.leaf_thickness_m
        bending = stiffer * given.steel_pa * section * given.leaf_thickness_m**2 / 12
        piece = given.steel_kg_per_m3 * section * span
        for element in range(LEAF_ELEMENTS):
            ends = rows[2 * element : 2 * element + 4]
            steel.add_element(beam_stiffness(bending, span), ends)
            mass.add_element(beam_mass(piece, span), ends)
            for row in indices.express_below(pylon, off, depth + (element + 0.5) * span):
                mass.add_row(piece, row)
        tip = rows[-2] | dict.fromkeys(rows[-1], given.tip_below_m)
        for row in (tip, *indices.express_below(pylon, off, depth + given.leaf_length_m + given.tip_below_m)):
            mass.add_row(given.tip_kg, row)
        mass.add_row(given.tip_inertia_kg_m2, rows[-1])
        tips.append(next(iter(rows[-2])))
    link.add_row(given.link_n_per_m, {tips[0]: -1.0, tips[1]: 1.0})


def beam_stiffness(bending_n_m2: float, length_m: float) -> FloatArray:
    """Return the (4, 4) stiffness of a beam in deflection and slope at its two ends; E I is `bending_n_m2`."""
    k = length_m
    pattern = [[12, 6 * k, -12, 6 * k], [6 * k, 4 * k * k, -6 * k, 2 * k * k]]
    pattern += [[-12, -6 * k, 12, -6 * k], [6 * k, 2 * k * k, -6 * k, 4 * k * k]]
    return bending_n_m2 / length_m**3 * np.array(pattern)


def beam_mass(mass_kg: float, length_m: float) -> FloatArray:
    """Return the (4, 4) consistent mass of the same element of mass `mass_kg` and length `length_m`."""
    k = length_m
    pattern = [[156, 22 * k, 54, -13 * k], [22 * k, 4 * k * k, 13 * k, -3 * k * k]]
    pattern += [[54, 13 * k, 156, -22 * k], [-13 * k, -3 * k * k, -22 * k, 4 * k * k]]
    return mass_kg / 420 * np.array(pattern)


def _symmetrise(matrix: sparse.csr_matrix) -> sparse.csr_matrix:
    """Return the matrix without the asymmetry of rounding."""
    return sparse.csr_matrix((matrix + matrix.T) / 2)


def replace_matrices(structure: AffineStructure, directory: Path, kind: Literal["mat", "mtx"]) -> None:
    """Replace structure.npz by matrices of another kind, as another finite-element code would give them."""
    from scipy.io import mmwrite, savemat

    found = {"mass": structure.mass, "stiffness": structure.stiffness}
    found |= {f"{PART}{name}": part for name, part in structure.parts.items()}
    if kind == "mat":
        named = {name: matrix.tocsc() for name, matrix in found.items()}
        with write_whole(directory / "structure.mat", "wb") as file:
            # MATLAB holds texts of several lengths in a cell array.
            savemat(file, {**named, "dofs": np.array(structure.dofs, dtype=object)}, do_compression=True)
        given = 'matrices = "structure.mat"'
    else:
        for name, matrix in found.items():
            with write_whole(directory / f"{name}.mtx", "wb") as file:
                mmwrite(file, matrix)
        with write_whole(directory / "dofs.txt") as file:
            file.write("".join(f"{name}\n" for name in structure.dofs))
        files = ", ".join(f'{name} = "{name}.mtx"' for name in found)
        given = f'matrices = {{ {files} }}\ndofs = "dofs.txt"'
    path = directory / "study.toml"
    text = path.read_text(encoding="utf-8").replace('matrices = "structure.npz"', given, 1)
    with write_whole(path) as file:
        file.write(text)
    (directory / "structure.npz").unlink()
