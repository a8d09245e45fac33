"""Arctangents fitted to points, their errors, and when they are straight lines."""

import numpy as np
import pytest

from opid.mechanics.laws.law import LAWS, Law, default_law, law
from opid.suspensions.paper.restoring_force import RestoringForce, SliceCurve, fit_slice, fit_surface

N = 8000


def _surface(nonlinear: Law, noise=0.01, seed=0, n=N):
    rng = np.random.default_rng(seed)
    z, v = 3e-3 * rng.standard_normal(n), 0.05 * rng.standard_normal(n)
    force = 200 * z + 3 * v + nonlinear.force(z, v) + noise * rng.standard_normal(n)
    return RestoringForce(z, v, force, 500.0)


# per unit of mass: amplitudes in m/s^2
TRUTHS = [
    law("arctan_velocity", amplitude_n=0.22, scale_m_per_s=0.02),
    law("arctan_displacement", amplitude_n=0.4, scale_m=0.002),
    law("arctan_mixed", amplitude_n=0.4, scale_m=0.002, lag_s=0.05),
    law("cubic_stiffness", stiffness_n_per_m3=2e6),
    law("quadratic_damping", damping_n_s2_per_m2=20.0),
    law("arctan_velocity", amplitude_n=0.22, scale_m_per_s=0.02) + law("cubic_stiffness", stiffness_n_per_m3=2e6),
]


@pytest.mark.parametrize("truth", TRUTHS, ids=lambda t: t.name)
def test_every_law_is_found_on_its_own_surface_within_its_stated_error(truth):
    fit = fit_surface(_surface(truth), truth.name)
    np.testing.assert_array_less(np.abs(fit.law.vector - truth.vector), 4 * fit.law_std)
    assert abs(fit.straight["stiffness_per_mass"] - 200) < 4 * fit.straight_std["stiffness_per_mass"]
    assert abs(fit.straight["damping_per_mass"] - 3) < 4 * fit.straight_std["damping_per_mass"]
    np.testing.assert_allclose(fit.residual_rms, 0.01, rtol=0.05)
    assert all(verdict.distinguishable for verdict in fit.verdicts)


def test_stated_errors_are_the_spread_over_repetitions():
    fits = [fit_surface(_surface(TRUTHS[0], seed=seed), "arctan_velocity") for seed in range(40)]
    spread = np.std([fit.law.vector for fit in fits], axis=0)
    stated = np.mean([fit.law_std for fit in fits], axis=0)
    np.testing.assert_allclose(stated, spread, rtol=0.35)


def test_the_papers_stiffness_arctangent_is_a_straight_line_and_said_to_be():
    # d b = 36 1/m, travel of a few millimetres: straight within a per cent (notes to eq. 3)
    paper = law("arctan_displacement", amplitude_n=np.pi / 2, scale_m=1 / 36)
    fit = fit_surface(_surface(paper, noise=0.03), "arctan_displacement")
    verdict = fit.verdicts[0]
    assert not verdict.distinguishable
    assert "cannot be distinguished from stiffness" in verdict.statement
    # slope and arctangent together are determined all the same
    slope = fit.straight["stiffness_per_mass"] + fit.law.gradient(0.0, 0.0)[0]
    np.testing.assert_allclose(slope, 200 + 36, rtol=0.02)


def test_the_papers_damping_arctangent_is_seen():
    paper = law("arctan_velocity", amplitude_n=np.pi / 2, scale_m_per_s=1 / (3.5 * 30))
    fit = fit_surface(_surface(paper, noise=0.03), "arctan_velocity")
    assert fit.verdicts[0].distinguishable
    np.testing.assert_allclose(fit.law.vector, paper.vector, rtol=0.05)


def test_a_linear_surface_gives_no_arctangent():
    fit = fit_surface(_surface(Law()))
    assert not any(verdict.distinguishable for verdict in fit.verdicts)


@pytest.mark.parametrize("along", ["travel", "velocity"])
def test_slices(along):
    rng = np.random.default_rng(1)
    scale, spread = (0.002, 3e-3) if along == "travel" else (0.02, 0.05)
    u = spread * rng.standard_normal(N)
    y = 100 * u + 0.3 * 2 / np.pi * np.arctan(u / scale) + 0.5 + 0.01 * rng.standard_normal(N)
    fit = fit_slice(SliceCurve(along, u, y, np.arange(N), 1e-3, 500.0))
    np.testing.assert_array_less(np.abs(fit.law.vector - [0.3, scale]), 4 * fit.law_std)
    np.testing.assert_allclose(fit.straight["offset"], 0.5, atol=2e-3)


def test_every_kind_of_law_can_be_fitted():
    for name in LAWS:
        fit = fit_surface(_surface(default_law(name).scaled(1 / 1850), n=1500), name)
        assert np.isfinite(fit.law.vector).all()
        assert np.isfinite(fit.residual_rms)
