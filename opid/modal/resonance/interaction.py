"""Whether the mode under test works on another one: its harmonics, seen in the other modes (Pacini, section 4.2.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from opid.errors import InputError
from opid.modal.linear.modes import LinearModes, modal_assurance
from opid.modal.resonance.appropriation import Appropriation
from opid.modal.resonance.phase_lock import N_HARMONICS
from opid.signals.recording import FloatArray


@dataclass(frozen=True, eq=False)
class Interaction:
    """The harmonic of another mode that stands out most in a force appropriation, and whether it is an interaction.

    Args:
        target: mode that was held at resonance, from 1.
        mode: the other mode, from 1.
        harmonic: of the drive frequency, 2 to 5.
        voltage_v: (n,) of the levels, V.
        shares: (n, n_modes, 5) amplitude of each harmonic of each modal acceleration over the fundamental of the
            target's.
        share: (n,) that of this harmonic of this mode.
        assurance: (n, n_modes) MAC of each mode's shape with the deflection shape of this harmonic at the sensors.
        driven_share: (n,) what the measured force would make of the mode at this harmonic if it stood alone, over what
            is observed.
        holds: (n,) levels that locked and at which all conditions hold.
        flagged: whether they hold at enough levels.
        first_level: the first of these levels, counted from 1; None where there is none.
        least_share: `share` that was asked for.
        least_assurance: MAC that was asked for.
        most_driven: largest `driven_share` allowed.
        statement: what was found, or what was looked at, in plain words.
    """

    target: int
    mode: int
    harmonic: int
    voltage_v: FloatArray
    shares: FloatArray
    share: FloatArray
    assurance: FloatArray
    driven_share: FloatArray
    holds: NDArray[np.bool_]
    flagged: bool
    first_level: int | None
    least_share: float
    least_assurance: float
    most_driven: float
    statement: str

    @property
    def mac(self) -> FloatArray:
        """(n,) MAC of the deflection shape with the mode's own shape."""
        return self.assurance[:, self.mode - 1]

    @property
    def mac_of_others(self) -> FloatArray:
        """(n,) the largest MAC of the deflection shape with the shape of any other mode."""
        return np.delete(self.assurance, self.mode - 1, axis=1).max(axis=1)


def modal_interaction(
    appropriation: Appropriation,
    modes: LinearModes | None = None,
    *,
    least_share: float = 0.5,
    least_assurance: float = 0.9,
    most_driven: float = 0.2,
    least_levels: int = 3,
) -> Interaction:
    """Return whether a harmonic of the mode under test drives another mode, judged by three conditions (section 4.2.2).

    At a level that locked: the harmonic of the other mode exceeds a share of the target's fundamental; the sensors
    deflect at this harmonic in that mode's shape; and the force cannot have driven it, for at this harmonic the
    measured force F_h makes of a mode that stands alone only phi_d F_h times its accelerance,
    -(h omega)^2 / (omega_0^2 - (h omega)^2 + 2 j zeta omega_0 h omega). Of all modes and harmonics the one at which the
    conditions hold most often is returned, and among equals the one with the largest share.

    Args:
        appropriation: see `opid.modal.appropriate_force`.
        modes: for shapes, frequencies and damping; those of the appropriation where left out.
        least_share: of the target's fundamental; in the paper 0.5.
        least_assurance: least MAC of the deflection shape with the mode's shape; in the paper 0.9.
        most_driven: most that the force may have driven, as a share of what is observed.
        least_levels: number of levels at which all this must hold.

    Raises:
        InputError: a threshold out of range, or modes that do not match those of the appropriation.
    """
    if not (0.0 < least_share < np.inf and 0.0 < least_assurance < 1.0 and 0.0 < most_driven < np.inf):
        raise InputError(
            f"least_share is {least_share}, least_assurance {least_assurance}, most_driven {most_driven}: give "
            "positive numbers, and a MAC below 1"
        )
    if least_levels != int(least_levels) or least_levels < 1:
        raise InputError(f"least_levels is {least_levels}: give a whole number, 1 or more")
    known = modes or appropriation.modes
    if known.sensors != appropriation.modes.sensors or known.n_modes != appropriation.modes.n_modes:
        raise InputError("the modes have other sensors or another number of modes than those of the appropriation")

    target = known.index(appropriation.mode)
    amplitude = np.abs(appropriation.modal)
    shares = amplitude / amplitude[:, target, :1, np.newaxis]
    driven = _driven(appropriation, known) / np.maximum(amplitude, np.finfo(float).tiny)
    assurance = np.stack([modal_assurance(known.shapes, of_level) for of_level in appropriation.sensors])
    holds = (shares > least_share) & (assurance >= least_assurance) & (driven <= most_driven)
    holds &= appropriation.locked[:, np.newaxis, np.newaxis]
    others = np.ones(shares.shape[1:], dtype=bool)
    others[target], others[:, 0] = False, False
    # rigid-body modes have no resonance to meet
    others &= known.elastic[:, np.newaxis].astype(bool)
    if not others.any():
        raise InputError("there is no other elastic mode: an interaction takes two")
    place, line = _most_remarkable(holds, shares, others, appropriation.locked)
    held = holds[:, place, line]
    flagged = bool(held.sum() >= least_levels)
    first_level = int(np.argmax(held)) + 1 if held.any() else None
    return Interaction(
        target=appropriation.mode,
        mode=place + 1,
        harmonic=line + 1,
        voltage_v=appropriation.voltage_v,
        shares=shares,
        share=shares[:, place, line],
        assurance=assurance[:, :, line],
        driven_share=driven[:, place, line],
        holds=held,
        flagged=flagged,
        first_level=first_level,
        least_share=least_share,
        least_assurance=least_assurance,
        most_driven=most_driven,
        statement=_statement(
            appropriation, place, line, shares[:, place, line], assurance[:, :, line], driven[:, place, line], held,
            (least_share, least_assurance, most_driven, least_levels),
        ),
    )  # fmt: skip


def _driven(appropriation: Appropriation, modes: LinearModes) -> FloatArray:
    """(n, n_modes, 5) modal accelerations that the measured force would make of each mode alone, m/s^2 kg^1/2."""
    harmonic = np.arange(1, N_HARMONICS + 1)
    omega = 2.0 * np.pi * appropriation.frequency_hz[:, np.newaxis, np.newaxis] * harmonic
    stiffness, damping = modes.stiffness()[:, np.newaxis], modes.damping()[:, np.newaxis]
    accelerance = omega**2 / np.abs(stiffness - omega**2 + 1j * omega * damping)
    point = np.abs(modes.row(appropriation.drive_point))[:, np.newaxis]
    return point * np.abs(appropriation.force)[:, np.newaxis, :] * accelerance


def _most_remarkable(
    holds: NDArray[np.bool_], shares: FloatArray, others: NDArray[np.bool_], locked: NDArray[np.bool_]
) -> tuple[int, int]:
    """Mode and harmonic, places from 0: where the conditions hold at most levels, or else the largest share."""
    of_locked = shares[locked] if locked.any() else shares
    largest = np.where(others, of_locked.max(axis=0), -1.0)
    times = np.where(others, holds.sum(axis=0), -1)
    largest = np.where(times == times.max(), largest, -1.0)
    place, line = np.unravel_index(np.argmax(largest), largest.shape)
    return int(place), int(line)


def _statement(
    appropriation: Appropriation,
    place: int,
    line: int,
    share: FloatArray,
    assurance: FloatArray,
    driven: FloatArray,
    held: NDArray[np.bool_],
    wanted: tuple[float, float, float, int],
) -> str:
    least_share, least_assurance, most_driven, least_levels = wanted
    n, locked, name = len(appropriation.levels), appropriation.locked, f"harmonic {line + 1} of mode {place + 1}"
    if not locked.any():
        return f"No level of mode {appropriation.mode} locked: nothing can be said of interactions."
    others = np.delete(assurance, place, axis=1).max(axis=1)
    if held.sum() >= least_levels:
        # cut, not rounded: 0.998 is not 1
        least_mac = np.floor(100.0 * assurance[held, place].min()) / 100.0
        return (
            f"Mode {appropriation.mode} works on mode {place + 1}: from level {int(np.argmax(held)) + 1} on, at "
            f"{int(held.sum())} of {n} levels, {name} exceeds {least_share:.0%} of the fundamental of mode "
            f"{appropriation.mode} (up to {share[held].max():.0%}), the deflection has its shape (MAC of "
            f"{least_mac:.2f} or more, with other modes {others[held].max():.2f} at most), and the force can have "
            f"driven {driven[held].max():.1%} of it at most."
        )
    at = int(np.argmax(np.where(locked, share, -1.0)))
    looked = (
        f"{name} comes to {share[at]:.0%} of the fundamental of mode {appropriation.mode} at level {at + 1}, its "
        f"shape has a MAC of {assurance[at, place]:.2f} with the deflection, and the force can have driven "
        f"{driven[at]:.0%} of it"
    )
    return (
        f"No interaction is seen: of all harmonics 2 to {N_HARMONICS} of the other modes at {int(locked.sum())} locked "
        f"levels, {looked}; needed are more than {least_share:.0%}, a MAC of {least_assurance:g} and at most "
        f"{most_driven:.0%}, at {least_levels} levels."
    )
