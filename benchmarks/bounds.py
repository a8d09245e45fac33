"""The Cramer-Rao bound of mass, stiffness and damping of a linear gear from two noisy accelerations."""

from __future__ import annotations

import numpy as np
from scipy import fft
from trials import Case, simulated

from opid.signals.recording import FloatArray
from opid.suspensions.settings import RunSettings

# the state at the begin of a run (equally, the difference of the states at both ends) is two real unknowns
N_END_TERMS = 2


def linear_bound(
    case: Case,
    seed: int,
    *,
    band_hz: tuple[float, float] = RunSettings.band_hz,
    ground: bool = False,
) -> dict[str, float]:
    """Return the least standard deviation of M2 (kg), K2 (N/m) and C2 (N s/m) that an unbiased estimate can have.

    Each Fourier line of the true spindle acceleration is unknown, and so is the state at the begin of each run. With
    the line's unknown eliminated, what either channel says of the parameters is in the equation of the mass, for
    spectra A1, A2 without noise (Pintelon & Schoukens, System Identification, 2012, ch. 9),

        R = (K2 + j w C2)(A1 - A2) + w^2 (M2 + dM) A2 - K3 A2,

    whose noise has the variance s1^2 |K2 + j w C2|^2 + s2^2 |K2 + K3 + j w C2 - w^2 (M2 + dM)|^2. The information is
    J^H J over that variance, J the derivatives of R and of the end terms of a record cut out of a longer motion.

    Args:
        case: a linear gear, with both noise levels in the settings of its runs.
        seed: of its roads.
        band_hz: lowest and highest line that is used, Hz.
        ground: whether K3 is unknown too (else it is 0 and known to be).
    """
    gear, test = case.gear, simulated(case, seed)
    noise = [case.run[f"{side}_sensor"].noise_m_per_s2 for side in ("lower", "upper")]
    rows = []
    for place, run in enumerate((test.heavy, test.light)):
        n, fs = run.truth.n_samples, run.truth.fs
        frequency_hz = fft.rfftfreq(n, 1 / fs)
        keep = (frequency_hz >= band_hz[0]) & (frequency_hz <= min(band_hz[1], 0.4 * fs))
        omega = 2 * np.pi * frequency_hz[keep]
        # scaled so that white noise of rms s has parts of rms s
        unsprung, sprung = (fft.rfft(run.truth.channel(name))[keep] / np.sqrt(n / 2) for name in ("lower_z", "upper_z"))
        spring = gear.suspension_stiffness_n_per_m + 1j * omega * gear.suspension_damping_n_s_per_m
        inertia = omega**2 * run.gear.sprung_mass_kg - gear.ground_stiffness_n_per_m
        std = np.hypot(noise[0] * np.abs(spring), noise[1] * np.abs(spring - inertia))
        moved = unsprung - sprung
        columns = [omega**2 * sprung, moved, 1j * omega * moved, *([-sprung] if ground else [])]
        ends = np.zeros((omega.size, 2 * N_END_TERMS), dtype=complex)
        first = place * N_END_TERMS
        ends[:, first : first + N_END_TERMS] = (1j * omega[:, None] / omega[-1]) ** np.arange(N_END_TERMS)
        jacobian = np.column_stack([*columns, ends]) / std[:, None]
        rows += [jacobian.real, jacobian.imag]
    std = _std(np.concatenate(rows))
    return dict(zip(("M2", "K2", "C2"), std[:3].tolist(), strict=True))


def _std(jacobian: FloatArray) -> FloatArray:
    scale = np.linalg.norm(jacobian, axis=0)
    return np.sqrt(np.diag(np.linalg.inv((jacobian / scale).T @ (jacobian / scale)))) / scale
