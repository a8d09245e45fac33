"""A user's own kind of law: what is checked when it is registered, and that it runs like the built-in ones."""

from dataclasses import replace

import numpy as np
import pytest
from compiled_force import compiled_force
from driven_response import driven_response

from opid.errors import InputError
from opid.mechanics.driven import Interface
from opid.mechanics.kernels import law_arrays
from opid.mechanics.laws.kinds import LAWS, Kind, Parameter
from opid.mechanics.laws.law import default_law, law
from opid.mechanics.laws.own_kinds import register_kind, unregister_kind

FS = 256.0


def softening(z, v, s, _):
    """A spring that lets go beyond s / sqrt(2)."""
    ratio = (z / s) ** 2
    decay = np.exp(-ratio)
    return z * decay, (1.0 - 2.0 * ratio) * decay, 0.0, 2.0 * ratio * z / s * decay, 0.0


STIFFNESS = Parameter("stiffness_n_per_m", "N/m", "amplitude", 1.5e5)
SCALE = Parameter("scale_m", "m", "scale", 0.005)
KIND = Kind("softening", r"k z \exp(-z^2 / s^2)", (STIFFNESS, SCALE), softening)


@pytest.fixture
def registered():
    register_kind(KIND)
    yield
    unregister_kind("softening")


@pytest.mark.usefixtures("registered")
def test_an_own_kind_is_a_law_like_any_other():
    assert "softening" in LAWS
    subject = default_law("softening+cubic_stiffness")
    assert subject.name == "cubic_stiffness+softening"
    z, v = np.random.default_rng(0).standard_normal((2, 50)) * [[3e-3], [0.05]]
    expected = 3e9 * z**3 + 1.5e5 * z * np.exp(-((z / 0.005) ** 2))
    np.testing.assert_allclose(subject.force(z, v), expected, rtol=1e-12)
    _, codes, values, *_ = law_arrays(subject)
    np.testing.assert_allclose(compiled_force(codes, values, z, v), expected, rtol=1e-12)
    with pytest.raises(InputError, match="did you mean 'softening'"):
        law("softning")


@pytest.mark.usefixtures("registered")
def test_an_own_kind_is_simulated_and_fitted():
    n, truth = 512, np.array([3e5, 4e3, 1.5e5, 0.005])
    t = np.arange(2 * n - 1) / (2 * FS)
    drive = (2.0 * np.sin(2 * np.pi * 1.7 * t) + 1.5 * np.sin(2 * np.pi * 6.1 * t))[:, None]

    def response(p):
        own = law("softening", stiffness_n_per_m=p[2], scale_m=p[3])
        return driven_response([Interface(p[0], p[1], law=own)], [[1 / 1850.0]], drive, fs=FS)

    measured = response(truth).acceleration[:, 0]
    p = truth * [1.02, 0.95, 0.9, 1.1]
    for _ in range(12):
        found = response(p)
        error = measured - found.acceleration[:, 0]
        jacobian = found.sensitivity[:, 0, [0, 1, 4, 5]] * truth
        p = p + truth * np.linalg.lstsq(jacobian, error, rcond=None)[0]
    np.testing.assert_allclose(p, truth, rtol=1e-8)


def test_a_taken_away_kind_is_gone():
    register_kind(KIND)
    unregister_kind("softening")
    assert "softening" not in LAWS
    with pytest.raises(InputError, match="no registered law 'softening'"):
        unregister_kind("softening")
    with pytest.raises(InputError, match="no registered law 'cubic_stiffness'"):
        unregister_kind("cubic_stiffness")


def wrong_by_z(z, v, s, _):
    return np.tanh(z * v / s), v / s, z / s * (1.0 - np.tanh(z * v / s) ** 2), -z * v / s**2, 0.0


def wrong_by_v(z, v, s, _):
    return z / s, 1.0 / s, 0.01 / s, -z / s**2, 0.0


def wrong_by_scale(z, v, s, _):
    return z / s, 1.0 / s, 0.0, z / s**2, 0.0


def of_an_unnamed_parameter(z, v, s, b):
    return b * z, b, 0.0, 0.0, z


def preloaded(z, v, s, _):
    return z + 1.0, 1.0, 0.0, 0.0, 0.0


def with_a_pole(z, v, s, _):
    return v / z, -v / z**2, 1.0 / z, 0.0, 0.0


def not_for_numba(z, v, s, _):
    return {}["z"], 1.0, 0.0, 0.0, 0.0


def short(z, v, s, _):
    return z, 1.0, 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"function": wrong_by_z}, "derivative of softening by z"),
        ({"function": wrong_by_v}, "derivative of softening by v"),
        ({"function": wrong_by_scale}, "derivative of softening by scale_m"),
        ({"function": of_an_unnamed_parameter}, "does not name"),
        ({"function": preloaded}, "is 1 at rest"),
        ({"function": with_a_pole}, "not finite"),
        ({"function": not_for_numba}, "numba cannot compile"),
        ({"function": short}, "returns 3 values"),
        ({"name": "soft-ening"}, "cannot be called"),
        ({"name": "linear"}, "cannot be called"),
        ({"name": "cubic_stiffness"}, "already"),
        ({"parameters": (SCALE, STIFFNESS)}, "one amplitude"),
        ({"parameters": (STIFFNESS, SCALE, SCALE)}, "its own name"),
        ({"parameters": (STIFFNESS, replace(SCALE, default=-1.0))}, "positive"),
        ({"parameters": (STIFFNESS, replace(SCALE, role="size"))}, "the role 'size'"),
    ],
)
def test_what_is_wrong_is_said(change, message):
    with pytest.raises(InputError, match=message):
        register_kind(replace(KIND, **change))
    assert "softening" not in LAWS


def stiffening(z, v, s, _):
    """Another force under the same name."""
    ratio = (z / s) ** 2
    return z * ratio, 3.0 * ratio, 0.0, -2.0 * ratio * z / s, 0.0


def test_a_name_that_now_means_another_force_moves_a_body_otherwise():
    drive = np.random.default_rng(1).standard_normal((2 * 500 - 1, 1))
    moved = []
    for function in (softening, stiffening):
        register_kind(replace(KIND, function=function))
        try:
            gear = Interface(4e5, 6e3, law=default_law("softening"))
            moved.append(driven_response([gear], [[1 / 1800]], drive, fs=FS).travel)
        finally:
            unregister_kind("softening")
    assert np.abs(moved[1] - moved[0]).max() > 0.01 * moved[0].std()
