"""A user's finite-element structure whose stiffness is affine in the parameters to update: K = K0 + sum theta_i K_i.

It is made of sparse matrices with names, or of what scikit-fem assembled.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from opid.errors import InputError, count_repeats, nearest, refuse
from opid.signals.recording import FloatArray, has_usual_size

Point = tuple[float | Sequence[float], str]
"""Coordinates of a point of a mesh, and the component of its motion."""


@dataclass(frozen=True, eq=False)
class AffineStructure:
    """M x'' + (K0 + sum theta_i K_i) x + joints = 0, with the names of sensors and joints.

    Args:
        mass: (n_dof, n_dof) sparse M, kg; symmetric, positive on the diagonal.
        stiffness: (n_dof, n_dof) sparse K0 of the parts that are not updated (such as soft supports), N/m; symmetric.
        parts: K_i by the name of the parameter theta_i that multiplies it (1 for the nominal structure), N/m.
        dofs: name of each degree of freedom.
        sensors: names of the degrees of freedom that are measured, in the order of the data.
        joints: the two degrees of freedom between which each nonlinear joint acts, by the name of the joint; or the one
            that a joint to the ground holds.

    Raises:
        InputError: everything that is wrong with it: shapes, symmetry, a mass that is not positive, unknown names.
    """

    mass: sparse.csr_matrix
    stiffness: sparse.csr_matrix
    parts: Mapping[str, sparse.csr_matrix]
    dofs: tuple[str, ...]
    sensors: tuple[str, ...]
    joints: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("dofs", "sensors"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for name in ("mass", "stiffness"):
            object.__setattr__(self, name, sparse.csr_matrix(getattr(self, name), dtype=np.float64))
        parts = {name: sparse.csr_matrix(part, dtype=np.float64) for name, part in self.parts.items()}
        object.__setattr__(self, "parts", MappingProxyType(parts))
        joints = {name: (ends,) if isinstance(ends, str) else tuple(ends) for name, ends in self.joints.items()}
        object.__setattr__(self, "joints", MappingProxyType(joints))
        matrices = {"mass": self.mass, "stiffness": self.stiffness}
        matrices |= {f"stiffness part {name!r}": part for name, part in parts.items()}
        faults = [fault for name, matrix in matrices.items() for fault in matrix_faults(name, matrix, self.dofs)]
        refuse([*name_faults(self.dofs, self.sensors, self.joints), *faults], None)

    @property
    def n_dof(self) -> int:
        """Number of degrees of freedom."""
        return len(self.dofs)

    def stiffness_at(self, factors: Mapping[str, float]) -> sparse.csr_matrix:
        """K0 + sum theta_i K_i for these factors by name; 1 where one is left out. InputError for an unknown name."""
        for name in factors:
            if name not in self.parts:
                raise InputError(f"there is no parameter {name!r}: {nearest(name, self.parts)}")
        total = self.stiffness.copy()
        for name, part in self.parts.items():
            total = total + float(factors.get(name, 1.0)) * part
        return sparse.csr_matrix(total)

    @property
    def sensor_indices(self) -> NDArray[np.int64]:
        """(n_sensors,) index of each sensor among the degrees of freedom."""
        return np.array([self.dofs.index(sensor) for sensor in self.sensors])

    @property
    def joint_rows(self) -> FloatArray:
        """(n_joints, n_dof) extension of each joint for unit motion, see `find_joint_rows`."""
        return find_joint_rows(self.joints, self.dofs)


def structure_from_skfem(
    basis: Any,
    *,
    mass: Any,
    parts: Mapping[str, Any],
    points: Mapping[str, Point],
    stiffness: Any = None,
    fixed: Any = (),
    sensors: Sequence[str] | None = None,
    joints: Mapping[str, str | Sequence[str]] | None = None,
    farthest: float | None = None,
) -> AffineStructure:
    """Return a structure that scikit-fem assembled, without its constrained degrees of freedom.

    A degree of freedom is called by the number of its node and the name that scikit-fem gives its component: "12 u_x"
    is the slope at `basis.mesh.p[:, 12]` of a beam, "12 u^2" the motion along y of a solid. Those that do not lie at
    nodes are called "edge 3 u^1", "facet 3 u_n" and "interior 3 u^1". One that is a point has the name of the point.

    Args:
        basis: the `skfem.Basis` with which all matrices were assembled; its mesh is in m.
        mass: (basis.N, basis.N) sparse mass matrix, kg.
        parts: parts of the stiffness by the name of the factor that multiplies each, N/m.
        points: coordinates and component of sensors and ends of joints by their names, like {"tip": ((1.0, 0.2), "u")};
            each is the degree of freedom of the nearest node.
        stiffness: part of the stiffness that no factor multiplies; none where left out.
        fixed: degrees of freedom that do not move, from `basis.get_dofs`, or their indices.
        sensors: names of the points that are measured, in the order of the data; all where left out.
        joints: the two ends of each nonlinear joint, or the one of a joint to the ground, by its name: points, or other
            degrees of freedom.
        farthest: distance, m, of a point from its node from which on it is refused; half the distance of that node from
            the next one where left out.

    Raises:
        InputError: matrices of another basis; a point that lies far from all nodes, does not move, is another one, or
            has a component or coordinates that the mesh does not have; or what `AffineStructure` refuses.
    """
    held = np.zeros(basis.N, dtype=bool)
    held[np.asarray(fixed.flatten() if hasattr(fixed, "flatten") else fixed, dtype=np.int64)] = True
    given = {"mass": mass, **parts, **({} if stiffness is None else {"stiffness": stiffness})}
    faults = [
        f"the matrix {name!r} has shape {matrix.shape}, and the basis {basis.N} degrees of freedom: assemble it with "
        "this basis"
        for name, matrix in given.items()
        if matrix.shape != (basis.N, basis.N)
    ]
    names = _name_skfem_dofs(basis)
    place, misplaced = _place_points(basis, points, names, held, farthest)
    refuse([*faults, *misplaced], None)
    free = np.flatnonzero(~held)

    def condense(matrix: Any) -> sparse.csr_matrix:
        return sparse.csr_matrix(matrix)[free][:, free]

    return AffineStructure(
        condense(mass),
        sparse.csr_matrix((free.size, free.size)) if stiffness is None else condense(stiffness),
        {name: condense(part) for name, part in parts.items()},
        tuple(place.get(index, names[index]) for index in free.tolist()),
        tuple(points if sensors is None else sensors),
        {name: (ends,) if isinstance(ends, str) else tuple(ends) for name, ends in (joints or {}).items()},
    )


def _place_points(
    basis: Any, points: Mapping[str, Point], names: Sequence[str], held: NDArray[np.bool_], farthest: float | None
) -> tuple[dict[int, str], list[str]]:
    """Return the name of each point by the index of its degree of freedom, and what is wrong with the points."""
    place: dict[int, str] = {}
    faults: list[str] = []
    for name, (coordinates, component) in points.items():
        try:
            index = _find_skfem_dof(basis, coordinates, component, farthest)
        except InputError as error:
            faults.append(f"the point {name!r} {error}")
            continue
        if held[index]:
            faults.append(
                f"the point {name!r} is at {names[index]!r}, which is fixed: place it where the structure moves"
            )
        if index in place:
            faults.append(
                f"the points {place[index]!r} and {name!r} are both at {names[index]!r}: refine the mesh there"
            )
        place[index] = name
    return place, faults


def _name_skfem_dofs(basis: Any) -> list[str]:
    """Return the names of all degrees of freedom of a basis, in its order."""
    names = [""] * basis.N
    components = iter(basis.elem.dofnames)
    kinds = {
        "": basis.nodal_dofs,
        "edge ": basis.edge_dofs,
        "facet ": basis.facet_dofs,
        "interior ": basis.interior_dofs,
    }
    for kind, table in kinds.items():
        for row in table:
            component = next(components)
            for number, index in enumerate(row):
                names[index] = f"{kind}{number} {component}"
    return names


def _find_skfem_dof(basis: Any, coordinates: float | Sequence[float], component: str, farthest: float | None) -> int:
    """Return the index of a component of the node nearest to some coordinates."""
    components = list(basis.elem.dofnames)[: len(basis.nodal_dofs)]
    if component not in components:
        raise InputError(
            f"has the component {component!r}, which the nodes do not have: {nearest(component, components)}"
        )
    nodes = basis.mesh.p.T
    at = np.atleast_1d(np.asarray(coordinates, dtype=np.float64))
    if at.shape != nodes.shape[1:] or not np.isfinite(at).all():
        raise InputError(f"has the coordinates {at.tolist()}: give {nodes.shape[1]} numbers, as the mesh has")
    row = basis.nodal_dofs[components.index(component)]
    # Meshes of a higher order have points without degrees of freedom behind their nodes.
    nodes = nodes[: len(row)]
    distance = np.linalg.norm(nodes - at, axis=1)
    node = int(np.argmin(distance))
    others = np.linalg.norm(nodes - nodes[node], axis=1)
    limit = 0.5 * float(others[others > 0].min()) if farthest is None else farthest
    # A point in the middle between two nodes is not beyond the limit because of rounding.
    if distance[node] > limit * (1 + 1e-9):
        raise InputError(
            f"lies {distance[node]:.3g} m from the nearest node, {node} at {nodes[node].tolist()}, more than "
            f"{limit:.3g} m: correct the coordinates, refine the mesh there, or give a larger `farthest`"
        )
    return int(row[node])


def find_joint_rows(joints: Mapping[str, tuple[str, ...]], dofs: Sequence[str]) -> FloatArray:
    """Return the extension of each joint for unit motion of each degree of freedom, (n_joints, n_dof).

    It is the motion of the second end less that of the first; of a joint to the ground, that of its only end.

    Args:
        joints: the ends of each joint by its name.
        dofs: names of the degrees of freedom, or of the sensors of modes.

    >>> find_joint_rows({"link": ("a", "b"), "foot": ("a",)}, ("a", "b")).tolist()
    [[-1.0, 1.0], [1.0, 0.0]]
    """
    rows = np.zeros((len(joints), len(dofs)))
    for row, ends in zip(rows, joints.values(), strict=True):
        for end, sign in zip(reversed(ends), (1.0, -1.0), strict=False):
            row[dofs.index(end)] = sign
    return rows


_MOST_UNKNOWN = 12  # names that are told: a list of another structure has thousands


def matrix_faults(name: str, matrix: sparse.csr_matrix, dofs: Sequence[str]) -> Iterator[str]:
    """Yield what is wrong with one matrix of a structure, "mass", "stiffness" or a part of it."""
    if matrix.shape != (len(dofs), len(dofs)):
        yield f"the {name} matrix has shape {matrix.shape} for {len(dofs)} degrees of freedom: give a square one"
    elif not np.isfinite(matrix.data).all():
        yield f"the {name} matrix has entries that are not finite: export it again"
    elif not has_usual_size(matrix.data):
        yield (
            f"the {name} matrix has entries up to {np.abs(matrix.data).max():.3g}, which no structure has: export it "
            "in SI units"
        )
    else:
        # Rounding in a finite-element code may leave a small difference.
        if matrix.nnz and np.abs((matrix - matrix.T).data).max(initial=0.0) > 1e-8 * np.abs(matrix.data).max():
            yield f"the {name} matrix is not symmetric: export the whole matrix, or mirror the stored triangle"
        if name == "mass" and matrix.diagonal().min() <= 0:
            bad = dofs[int(np.argmin(matrix.diagonal()))]
            yield f"the mass of {bad!r} is not positive: remove the degree of freedom or give it a mass"


def name_faults(
    dofs: Sequence[str],
    sensors: Sequence[str],
    joints: Mapping[str, tuple[str, ...]],
    *,
    what: str = "degree of freedom",
) -> Iterator[str]:
    """Yield what is wrong with the names of degrees of freedom, sensors and ends of joints.

    Args:
        dofs: names of the degrees of freedom, or of the sensors of modes.
        sensors: names of those that are measured.
        joints: the ends of each joint by its name.
        what: what each of `dofs` is, in words.
    """
    known = dict.fromkeys(dofs)
    if len(known) < len(dofs):
        twice = next(iter(count_repeats(dofs)))
        yield f"two degrees of freedom are called {twice!r}: give each a name of its own"
    if not sensors:
        yield "no sensor is named: name the degrees of freedom that are measured"
    named = [("sensor", sensor) for sensor in sensors]
    named += [(f"joint {joint!r}", end) for joint, ends in joints.items() for end in ends]
    unknown = dict.fromkeys((part, name) for part, name in named if name not in known)
    for part, name in [*unknown][:_MOST_UNKNOWN]:
        yield f"{part} names the {what} {name!r}, which does not exist: {nearest(name, known)}"
    if len(unknown) > _MOST_UNKNOWN:
        yield f"{len(unknown) - _MOST_UNKNOWN} more names do not exist"
    for joint, ends in joints.items():
        if len(ends) not in (1, 2):
            yield f"joint {joint!r} has {len(ends)} ends: name the two between which it lies, or one for the ground"
        elif len(set(ends)) < len(ends):
            yield f"joint {joint!r} lies between {ends[0]!r} and itself: name two, or one for a joint to the ground"


def structure_faults(structure: AffineStructure) -> Iterator[str]:
    """Yield whether the mass or the nominal stiffness is not positive."""
    if (worst := _compute_least_eigenvalue(structure.mass)) <= 0:
        yield f"the mass matrix is not positive (eigenvalue {worst:.3g} kg): export it again"
    # A free structure has eigenvalues of 0, which rounding may make negative.
    stiffness = structure.stiffness_at({})
    largest = float(np.abs(stiffness.diagonal()).max(initial=0.0))
    if (worst := _compute_least_eigenvalue(stiffness, 1e-9 * largest)) < -1e-8 * largest:
        yield f"the stiffness matrix is not positive (eigenvalue {worst:.3g} N/m): look for a wrong sign"


def _compute_least_eigenvalue(matrix: object, shift: float = 0.0) -> float:
    """Return the least eigenvalue if it is negative, else 0 or a positive number: pivots show its sign (Sylvester)."""
    from scipy.sparse.linalg import eigsh

    found = sparse.csc_matrix(matrix)
    if found.shape[0] <= 2:
        return float(np.linalg.eigvalsh(found.toarray())[0])
    if _is_positive(found, shift):
        return 1.0
    # No eigenvalue lies below -largest; the first shift that is enough is at most ten times too large.
    largest = float(np.abs(found).sum(axis=0).max())
    shift = max(shift, 1e-12 * largest)
    while shift < largest and not _is_positive(found, shift):
        shift *= 10
    try:
        # All eigenvalues lie above -shift, so the nearest to it is the least.
        return float(eigsh(found, k=1, sigma=-shift, return_eigenvectors=False, tol=1e-4)[0])
    except (RuntimeError, ValueError):  # the shift is an eigenvalue, or the iteration does not converge
        return -shift


def _is_positive(matrix: Any, shift: float) -> bool:
    """Return whether a sparse matrix plus `shift` times the identity has positive pivots only."""
    from scipy.sparse.linalg import splu

    try:
        factors = splu(
            matrix + shift * sparse.identity(matrix.shape[0], format="csc"),
            permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True},
        )  # fmt: skip
    except RuntimeError:  # singular
        return False
    return bool((factors.U.diagonal() > 0).all() and (factors.perm_r == factors.perm_c).all())
