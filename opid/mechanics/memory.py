"""The force of a law along a recorded motion, what it remembers followed from the first sample on."""

from __future__ import annotations

import numpy as np

from opid.mechanics.driven import N_HEAD, Interface, joint_arrays
from opid.mechanics.laws import FloatArray, TermSet, WithCandidates


def force_along(law: TermSet, z: FloatArray, v: FloatArray, fs: float) -> FloatArray:
    """Return f(z, v) along a motion, N, (n,).

    Args:
        law: any law; what it remembers is zero at first.
        z: (n,) extension, m.
        v: (n,) its rate, m/s: a straight line between samples.
        fs: samples a second, Hz.

    >>> from opid.mechanics.laws import default_law
    >>> t = np.arange(1000) / 1000.0
    >>> friction = force_along(default_law("dahl_friction"), 0.01 * t, np.full(1000, 0.01), 1000.0)
    >>> friction[[0, 50, 999]].round(1)
    array([  0. , 252.8, 400. ])
    """
    amplitudes = np.zeros(law.vector.size)
    first = np.cumsum([0, *(len(term.values) for term in law.terms)])[:-1]
    amplitudes[first] = law.vector[first]
    return gradient_along(law, z, v, fs) @ amplitudes


def gradient_along(law: TermSet, z: FloatArray, v: FloatArray, fs: float) -> FloatArray:
    """Return the derivatives of the force along a motion by each entry of `law.vector`, (n, n_parameters).

    The column of an amplitude is the term for unit amplitude.

    Args:
        law: any law; what it remembers is zero at first.
        z: (n,) extension, m.
        v: (n,) its rate, m/s: a straight line between samples.
        fs: samples a second, Hz.
    """
    gradient = law.parameter_gradient(z, v)
    remembers = np.array([term.kind.memory is not None for term in law.terms for _ in term.values], dtype=bool)
    if remembers.any():
        # numba takes long to load, and laws without memory do without
        from opid.mechanics.kernels import remembered_along

        faint = WithCandidates(law.terms, law.rest_m, len(law.terms))
        joints = joint_arrays([Interface(0.0, 0.0, law=faint)], ground=False)
        followed = remembered_along(joints, np.ascontiguousarray(v, dtype=np.float64), 1.0 / fs)
        gradient[:, remembers] = followed[:, N_HEAD:][:, remembers]
    return gradient
