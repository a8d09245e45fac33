from dataclasses import replace

import made_backbones as made
import numpy as np
import pytest
from scipy import sparse

from opid.mechanics.backbones.family import backbone
from opid.mechanics.laws.law import Law, Term
from opid.updating.likelihood.error_growth import growth_of_linear_error
from opid.updating.measured import MeasuredBackbone
from opid.updating.structure.affine import AffineStructure

FACTORS = {"plate": 1.0, "leaves": 1.0}
STD = np.array([0.01, 0.02])


def growth(covariance, *, curves=None, linear_error=0.004):
    curves = curves or made.backbones(3, linear_error=0.0, offset_fraction=0.0, point_noise=0.0)
    return growth_of_linear_error(
        made.structure(), FACTORS, curves, covariance=covariance, linear_error=linear_error, n_modes=0
    )


def test_the_growth_is_that_of_backbones_of_structures_with_that_error():
    found = growth(np.diag(STD**2))
    law = Law((Term("cubic_stiffness", (made.TRUTH * 6.8e7,)),))
    for mode, ends in zip(made.MODES, made.AMPLITUDE_M, strict=True):
        amplitude = np.linspace(*ends, 30)

        def at(*factors, mode=mode, amplitude=amplitude):
            system = made.system(*factors)
            curve = backbone(system, law, mode=mode, sensor="left", amplitude=amplitude, harmonics=(1,))
            linear = system.eigenvalue[mode - 1]
            return (2 * np.pi * curve.frequency_hz) ** 2 - linear

        first = made.system().eigenvalue[mode - 1]
        strayed = [
            (at(*(1 + 0.5 * std * one)) - at(*(1 - 0.5 * std * one))) / first
            for std, one in zip(STD, np.eye(2), strict=True)
        ]
        expected = np.sqrt(np.sum(np.square(strayed)) / np.sum((at(1.0, 1.0) / first) ** 2)) / 0.008
        assert found[mode] == pytest.approx(expected, rel=0.05)


def test_it_goes_with_the_standard_deviation_of_the_factors():
    once = growth(np.diag(STD**2))
    for again in (growth(np.diag(4 * STD**2)), growth(np.diag(STD**2), linear_error=0.002)):
        assert again == pytest.approx({mode: 2 * value for mode, value in once.items()})
    assert set(once) == set(made.MODES)


def test_without_phase_i_each_part_has_an_error_of_its_own_that_moves_a_frequency_as_stated():
    assert growth(None) == pytest.approx(growth(np.diag([0.008**2] * 2)))
    assert growth(None, linear_error=0.002) == pytest.approx(growth(None))


def two_masses():
    wall, between = np.diag([4e3, 4e3]), 3e3 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    parts = {"wall": sparse.csr_matrix(wall), "between": sparse.csr_matrix(between)}
    return AffineStructure(np.eye(2), sparse.csr_matrix((2, 2)), parts, ("a", "b"), ("a", "b"), {"j": ("a", "b")})


def test_an_error_that_no_amplitude_changes_does_not_grow_and_modes_without_joints_are_left_out():
    level = np.linspace(1e-4, 1e-3, 8)
    lambdas = {1: np.full(8, 4e3), 2: 1e4 * (1 + 0.2 * (level / level[-1]) ** 2)}
    curves = [
        MeasuredBackbone(
            f"mode {m}", m, "a", np.sqrt(v) / (2 * np.pi), np.outer(level, [1, (-1) ** (m + 1)]), ("a", "b")
        )
        for m, v in lambdas.items()
    ]
    factors = dict.fromkeys(("wall", "between"), 1.0)
    settings = {"linear_error": 0.004, "n_modes": 0}
    # by symmetry the shape of the mode is the same whatever the stiffness, and at any amplitude
    found = growth_of_linear_error(two_masses(), factors, curves, covariance=np.diag(STD**2), **settings)
    assert found == {2: pytest.approx(0.0, abs=1e-6)}
    flat = replace(curves[1], frequency_hz=np.full(8, curves[1].frequency_hz[0]))
    assert growth_of_linear_error(two_masses(), factors, [flat], covariance=np.diag(STD**2), **settings) == {}
    softer = replace(curves[1], frequency_hz=curves[1].frequency_hz[::-1])
    assert set(growth_of_linear_error(two_masses(), factors, [softer], covariance=np.diag(STD**2), **settings)) == {2}
