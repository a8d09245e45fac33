"""Joints that slip: springs in series with Coulomb sliders (Jenkins elements) side by side, and the Iwan model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.mechanics.laws.law import FloatArray


@dataclass(frozen=True, eq=False)
class Sliders:
    """Jenkins elements in parallel: f = sum_i clip(k_i (z - s_i), -slip_i, slip_i).

    The slider at s_i stands still while its spring carries less than slip_i, and is dragged along when it would carry
    more. A joint with sliders remembers: its force depends on where it has been.

    Args:
        stiffness_n_per_m: (n,) k of each spring, N/m, positive.
        slip_force_n: (n,) force at which its slider gives way, N, positive.

    Raises:
        InputError: counts that differ, none at all, or a value that is not positive and finite.

    >>> pair = Sliders([1e6, 2e6], [5.0, 30.0])
    >>> pair.tangent_n_per_m, pair.slip_total_n
    (3000000.0, 35.0)
    """

    stiffness_n_per_m: FloatArray
    slip_force_n: FloatArray

    def __post_init__(self) -> None:
        for name in ("stiffness_n_per_m", "slip_force_n"):
            array = np.array(getattr(self, name), dtype=np.float64)
            if array.ndim != 1 or array.size == 0 or not (np.isfinite(array) & (array > 0.0)).all():
                raise InputError(f"{name} of the sliders is {array}: give one positive number for each of them")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if self.stiffness_n_per_m.size != self.slip_force_n.size:
            raise InputError(
                f"there are {self.stiffness_n_per_m.size} stiffnesses and {self.slip_force_n.size} slip forces of "
                "sliders: give one of each a slider"
            )

    @property
    def n(self) -> int:
        """Number of elements."""
        return self.stiffness_n_per_m.size

    @property
    def tangent_n_per_m(self) -> float:
        """Stiffness with every slider stuck, N/m: that of small amplitudes."""
        return float(self.stiffness_n_per_m.sum())

    @property
    def slip_total_n(self) -> float:
        """Force with every slider slipping, N: the most that the joint can carry."""
        return float(self.slip_force_n.sum())


def force_of(sliders: Sliders, extension: ArrayLike, start: ArrayLike | None = None) -> tuple[FloatArray, FloatArray]:
    """Return the force (m,) N of sliders through a history of extension, and where they stand after it, (n,) m.

    Between two values the extension is taken to move in one direction: give every turning point.

    Args:
        sliders: the elements.
        extension: (m,) history of the extension z, m.
        start: (n,) positions of the sliders before it, m; 0 where left out.

    Raises:
        InputError: a history or positions of the wrong shape.

    >>> force, _ = force_of(Sliders([1e6], [5.0]), [0.0, 4e-6, 1e-5, 8e-6, 0.0])
    >>> force.round(9) + 0.0
    array([ 0.,  4.,  5.,  3., -5.])
    """
    history = np.asarray(extension, dtype=np.float64)
    position = np.zeros(sliders.n) if start is None else np.array(start, dtype=np.float64)
    if history.ndim != 1 or position.shape != (sliders.n,):
        raise InputError(
            f"the extension has shape {history.shape}, the start {position.shape}: give (m,) and ({sliders.n},)"
        )
    force = np.empty(history.size)
    reach = sliders.slip_force_n / sliders.stiffness_n_per_m
    for k, z in enumerate(history):
        position = np.clip(position, z - reach, z + reach)
        force[k] = sliders.stiffness_n_per_m @ (z - position)
    return force, position


def iwan(
    *,
    stiffness_n_per_m: float,
    slip_force_n: float,
    chi: float = -0.5,
    beta: float = 1.0,
    n: int = 40,
    smallest_fraction: float = 1e-3,
) -> Sliders:
    """Return the four-parameter Iwan model of a bolted joint (Segalman, J. Appl. Mech. 72, 2005, pp. 752-760).

    The stiffness of the elements that give way at the slip displacement phi has the density

        rho(phi) = R phi^chi for 0 < phi < phi_max, plus S delta(phi - phi_max),

    with K_T = (1 + beta) R phi_max^(chi + 1) / (chi + 1), beta = S (chi + 1) / (R phi_max^(chi + 1)) and
    F_S = phi_max K_T (beta + (chi + 1) / (chi + 2)) / (1 + beta). Hence, up to phi_max, the first loading and the
    energy of a cycle of amplitude u

        F(u) = K_T u - R u^(chi + 2) / ((chi + 1) (chi + 2)),   D(u) = 4 R u^(chi + 3) / ((chi + 2) (chi + 3)).

    The density is cut into ranges of equal ratio; each becomes one element with the stiffness and the slip force of
    its range, so K_T and F_S are exact, and F(u) is at the limits of the ranges; D(u) is 1 % off at 0.006 of the
    displacement at which all slip, and less above.

    Args:
        stiffness_n_per_m: K_T, with everything stuck, N/m.
        slip_force_n: F_S, at which the whole joint slips, N.
        chi: exponent of the density, above -1 and at most 0; the energy of a cycle grows with the power 3 + chi.
        beta: jump of the slope of F(u) at phi_max, as a fraction of what the power law carries; 0 or more.
        n: number of elements, the last one the delta.
        smallest_fraction: of phi_max: slip displacements below it share one element.

    Raises:
        InputError: a value out of range.

    >>> joint = iwan(stiffness_n_per_m=1e7, slip_force_n=800.0)
    >>> round(joint.tangent_n_per_m), round(joint.slip_total_n)
    (10000000, 800)
    """
    if not (0.0 < stiffness_n_per_m < np.inf and 0.0 < slip_force_n < np.inf):
        raise InputError(
            f"the joint has stiffness {stiffness_n_per_m} N/m and slip force {slip_force_n} N: give positive numbers"
        )
    if not (-1.0 < chi <= 0.0 and 0.0 <= beta < np.inf):
        raise InputError(f"chi is {chi}, beta {beta}: give chi above -1 and at most 0, and beta of 0 or more")
    n_ranges = n - (beta > 0.0)
    if n_ranges < 2 or not 0.0 < smallest_fraction < 1.0:
        raise InputError(
            f"n is {n}, smallest_fraction {smallest_fraction}: give 3 elements or more, and a fraction below 1"
        )
    carried = stiffness_n_per_m / (1.0 + beta)
    phi_max = slip_force_n * (1.0 + beta) / (stiffness_n_per_m * (beta + (chi + 1.0) / (chi + 2.0)))
    edges = np.concatenate([[0.0], np.geomspace(smallest_fraction, 1.0, n_ranges)])
    stiffness = carried * np.diff(edges ** (chi + 1.0))
    slip = carried * phi_max * (chi + 1.0) / (chi + 2.0) * np.diff(edges ** (chi + 2.0))
    if beta > 0.0:
        stiffness = np.append(stiffness, beta * carried)
        slip = np.append(slip, beta * carried * phi_max)
    return Sliders(stiffness, slip)
