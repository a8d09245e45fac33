import gc
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from compiled_force import compiled_force
from hypothesis import given, strategies as st
from numba import njit
from scipy.integrate import solve_ivp

import opid.mechanics
from opid.errors import InputError
from opid.mechanics.driven import Interface
from opid.mechanics.kernels import law_arrays
from opid.mechanics.kernels.compilation import part
from opid.mechanics.laws.law import LAWS, LINEAR, Law, Term, default_law, law, law_from_parameters
from opid.mechanics.response import time_response
from opid.mechanics.weight import GRAVITY_M_PER_S2, laws_at_rest
from opid.suspensions.law_search.pursuit import library
from opid.virtual.taxi_tests.airframe import LandingGear, airframe_structure

NAMES = list(LAWS)
SUMS = ["arctan_velocity+cubic_stiffness", "arctan_mixed+quadratic_damping+signed_power_stiffness"]
Z, V = np.meshgrid(np.linspace(-9e-3, 8e-3, 14), np.linspace(-0.21, 0.19, 14))
amplitudes = st.floats(-1e4, 1e4, allow_nan=False)


def central_difference(function, x, step):
    return (function(x + step) - function(x - step)) / (2.0 * step)


@pytest.mark.parametrize("name", NAMES + SUMS)
def test_gradient_is_the_derivative_of_the_force(name):
    subject = default_law(name)
    by_z, by_v = subject.gradient(Z, V)
    numeric_z = central_difference(lambda z: subject.force(z, V), Z, 1e-8)
    numeric_v = central_difference(lambda v: subject.force(Z, v), V, 1e-7)
    np.testing.assert_allclose(by_z, numeric_z, rtol=2e-6, atol=1e-6 * np.abs(numeric_z).max() + 1e-6)
    np.testing.assert_allclose(by_v, numeric_v, rtol=2e-6, atol=1e-6 * np.abs(numeric_v).max() + 1e-6)


@pytest.mark.parametrize("name", NAMES + SUMS)
def test_parameter_gradient_is_the_derivative_by_each_parameter(name):
    subject = default_law(name)
    gradient = subject.parameter_gradient(Z, V)
    assert gradient.shape == (*Z.shape, len(subject.parameter_list))
    for column, value in enumerate(subject.vector):
        step = 1e-5 * value
        up, down = subject.vector.copy(), subject.vector.copy()
        up[column] += step
        down[column] -= step
        numeric = (subject.with_vector(up).force(Z, V) - subject.with_vector(down).force(Z, V)) / (2.0 * step)
        np.testing.assert_allclose(gradient[..., column], numeric, rtol=1e-6, atol=1e-7 * np.abs(numeric).max())


@pytest.mark.parametrize("name", ["linear", *NAMES, *SUMS])
def test_the_compiled_force_is_the_numpy_force(name):
    subject = default_law(name)
    _, codes, values, *_ = law_arrays(subject)
    compiled = compiled_force(codes, values, Z.ravel(), V.ravel())
    np.testing.assert_allclose(compiled, subject.force(Z, V).ravel(), rtol=1e-12, atol=1e-12)


ONE_SIDED = [
    "asymmetric_damping",
    "asymmetric_stiffness",
    "bump_stop",
    "even_quadratic_stiffness",
    "gas_column",
    "held_even_stiffness",
    "loaded_friction",
    "orifice_damping",
    "rebound_stop",
]


@pytest.mark.parametrize("name", NAMES)
def test_every_law_rests_at_rest_and_is_odd_unless_it_is_one_sided(name):
    subject = default_law(name)
    odd = np.allclose(subject.force(-Z, -V), -subject.force(Z, V), rtol=1e-12)
    assert odd == (name not in ONE_SIDED)
    assert subject.force(0.0, 0.0) == 0.0
    assert np.isfinite(subject.gradient(0.0, 0.0)).all()
    assert np.isfinite(subject.parameter_gradient(0.0, 0.0)).all()


@pytest.mark.parametrize(
    "name",
    [
        "arctan_velocity",
        "coulomb_friction",
        "loaded_friction",
        "quadratic_damping",
        "cubic_damping",
        "signed_power_damping",
    ],
)
def test_a_damper_takes_energy(name):
    assert (V * default_law(name).force(Z, V) > 0.0).all()


def test_asymmetric_terms_add_on_one_side_and_take_on_the_other():
    damper = law("asymmetric_damping", damping_n_s_per_m=2e3)
    total = 6e3 * V + damper.force(Z, V)
    np.testing.assert_allclose(total, np.where(V > 0.0, 8e3, 4e3) * V)
    spring = law("asymmetric_stiffness", stiffness_n_per_m=5e4)
    np.testing.assert_allclose(3e5 * Z + spring.force(Z, V), np.where(Z > 0.0, 3.5e5, 2.5e5) * Z)


def test_a_gap_and_a_relief_valve_act_beyond_their_scale():
    stop = law("dead_zone_stiffness", stiffness_n_per_m=2e5, gap_m=0.005)
    np.testing.assert_allclose(stop.force([-0.008, -0.004, 0.005, 0.006], 0.0), [-600.0, 0.0, 0.0, 200.0], atol=1e-9)
    valve = law("blow_off_damping", damping_n_s_per_m=-4e3, scale_m_per_s=0.1)
    slope = 6e3 + valve.gradient(0.0, [-0.2, -0.05, 0.05, 0.2])[1]
    np.testing.assert_allclose(slope, [2e3, 6e3, 6e3, 2e3])


def test_a_stop_pushes_back_on_its_side_and_comes_in_smoothly():
    """Nothing on the way to it, a force that grows as if it began at the gap, and no corner."""
    rebound, bump = (law(name, stiffness_n_per_m=2e6, gap_m=0.01) for name in ("rebound_stop", "bump_stop"))
    np.testing.assert_allclose(rebound.force([-0.03, 0.0, 0.0094, 0.011, 0.02], 0.0), [0.0, 0.0, 0.0, 2e3, 2e4])
    np.testing.assert_allclose(bump.force(Z, V), -rebound.force(-Z, V))
    z = np.linspace(0.009, 0.011, 20001)
    slope = rebound.gradient(z, 0.0)[0]
    assert np.abs(np.diff(slope)).max() < 2e6 * 1e-3
    np.testing.assert_allclose(slope[[0, -1]], [0.0, 2e6])


def test_the_gas_column_is_the_polytropic_law_about_rest():
    static_n, length_m, exponent = 2e4, 0.12, 1.27
    subject = law("gas_column", static_force_n=static_n, gas_length_m=length_m, exponent=exponent)
    z = np.linspace(-0.9, 2.0, 30) * length_m
    push = static_n * (length_m / (length_m + z)) ** exponent
    np.testing.assert_allclose(subject.force(z, 0.0), static_n - push, rtol=1e-9, atol=1e-9)
    assert subject.gradient(0.0, 0.0)[0] == pytest.approx(exponent * static_n / length_m)
    # bottomed out: finite, and no corner where the tangent takes over
    assert np.isfinite(subject.force([-length_m, -3.0 * length_m], 0.0)).all()
    either_side = -0.95 * length_m + np.array([-1e-9, 1e-9])
    np.testing.assert_allclose(*subject.force(either_side, 0.0), rtol=1e-5)
    np.testing.assert_allclose(*subject.gradient(either_side, 0.0)[0], rtol=1e-5)


def test_a_gas_column_is_loaded_along_an_isotherm_and_moves_on_a_polytrope_from_there():
    static_n, length_m, exponent, rest_m = 2e4, 0.12, 1.27, 0.013
    column = law("gas_column", static_force_n=static_n, gas_length_m=length_m, exponent=exponent)
    carried = static_n * length_m / (length_m + rest_m)
    assert column.static_force(rest_m)[0] == pytest.approx(static_n - carried)
    there = law("gas_column", static_force_n=carried, gas_length_m=length_m + rest_m, exponent=exponent)
    z, moved = np.linspace(-0.02, 0.03, 7), column.resting_at(rest_m)
    np.testing.assert_allclose(moved.force(z, 0.0), there.force(z, 0.0), rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(moved.gradient(z, 0.0)[0], there.gradient(z, 0.0)[0], rtol=1e-12)
    np.testing.assert_allclose(moved.static_force(z)[0], there.static_force(z)[0], rtol=1e-9, atol=1e-9)


def test_signed_powers_contain_the_whole_powers():
    cubic = law("cubic_stiffness", stiffness_n_per_m3=2e9)
    power = law("signed_power_stiffness", stiffness_n_per_mn=2e9, exponent=3.0)
    np.testing.assert_allclose(power.force(Z, V), cubic.force(Z, V), rtol=1e-12)
    quadratic = law("quadratic_damping", damping_n_s2_per_m2=3e4)
    power = law("signed_power_damping", damping_n_sn_per_mn=3e4, exponent=2.0)
    np.testing.assert_allclose(power.force(Z, V), quadratic.force(Z, V), rtol=1e-12)


def test_arctan_mixed_is_equation_3_of_the_paper():
    a, b, c, d, sprung_mass_kg = -200.0, 30.0, 0.07, 1.2, 1850.0
    paper = sprung_mass_kg * (a * Z + np.arctan(d * b * (Z + c * V)))
    subject = law("arctan_mixed", amplitude_n=0.5 * np.pi * sprung_mass_kg, scale_m=1.0 / (d * b), lag_s=c)
    np.testing.assert_allclose(subject.force(Z, V) + sprung_mass_kg * a * Z, paper, rtol=1e-12, atol=1e-9)


def test_a_sum_has_a_canonical_order_and_adds_forces():
    friction, cubic = default_law("arctan_velocity"), default_law("cubic_stiffness")
    assert friction + cubic == cubic + friction
    assert hash(friction + cubic) == hash(cubic + friction)
    assert (cubic + friction).name == "arctan_velocity+cubic_stiffness"
    assert default_law("cubic_stiffness + arctan_velocity") == friction + cubic
    assert friction + LINEAR == friction
    np.testing.assert_allclose((friction + cubic).force(Z, V), friction.force(Z, V) + cubic.force(Z, V))


@given(first=amplitudes, second=amplitudes, factor=st.floats(-1e3, 1e3))
def test_amplitudes_add_and_scale(first, second, factor):
    one = law("arctan_velocity", amplitude_n=first, scale_m_per_s=0.02)
    other = law("arctan_velocity", amplitude_n=second, scale_m_per_s=0.02)
    assert one + other == law("arctan_velocity", amplitude_n=first + second, scale_m_per_s=0.02)
    expected = factor * one.force(Z, V)
    np.testing.assert_allclose(one.scaled(factor).force(Z, V), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["linear", *NAMES, *SUMS])
def test_a_law_goes_to_json_and_back(name):
    subject = default_law(name).scaled(1.0 / 3.0)
    text = json.dumps({"name": subject.name, "parameters": subject.parameters})
    assert law_from_parameters(**json.loads(text)) == subject
    assert subject.with_vector(subject.vector) == subject
    assert subject.latex


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: law("arctan_velocty"), "did you mean 'arctan_velocity'"),
        (lambda: default_law("cubic_stiffness+cubik_damping"), "did you mean 'cubic_damping'"),
        (lambda: default_law("cubic_stiffness+linear"), "leave it out"),
        (lambda: default_law("cubic_stiffness+cubic_stiffness"), "twice"),
        (lambda: default_law(""), "the law '' lacks a name: give one on each side of +"),
        (lambda: default_law("dahl_friction+"), "lacks a name"),
        (lambda: default_law(3), "the law is 3: give its name in quotes"),
        (
            lambda: default_law("cubic_stiffness").resting_at(float("nan")),
            "rest_m of a law is nan: give the extension in m",
        ),
        (lambda: default_law("cubic_stiffness").resting_at("a"), "rest_m of a law is 'a'"),
        (lambda: law("cubic_stiffness", stiffness=1.0), "did you mean 'stiffness_n_per_m3'"),
        (lambda: law("arctan_velocity", amplitude_n=1.0), "needs scale_m_per_s"),
        (lambda: law("arctan_velocity", amplitude_n=1.0, scale_m_per_s=-0.1), "give a positive number"),
        (lambda: law("cubic_stiffness", stiffness_n_per_m3=np.nan), "give a finite number"),
        (lambda: law("cubic_stiffness", stiffness_n_per_m3="stiff"), "give numbers"),
        (lambda: law("linear", stiffness={}), "has no term 'stiffness'"),
        (lambda: law("cubic_stiffness+cubic_damping", cubic_stiffness=3.0), "give a dict"),
        (lambda: Term("cubic_stiffness", (1.0, 2.0)), "give one for each of stiffness_n_per_m3"),
        (lambda: Term("cubic", (1.0,)), "no law 'cubic'"),
        (lambda: default_law("cubic_stifness"), "no law 'cubic_stifness': did you mean 'cubic_stiffness'.$"),
        (lambda: default_law("arctan_velocity").with_vector([1.0]), "has 2 parameter"),
        (
            lambda: default_law("coulomb_friction") + law("coulomb_friction", amplitude_n=1, scale_m_per_s=1),
            "different inner parameters",
        ),
    ],
)
def test_what_is_wrong_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_every_kind_is_described():
    for name, kind in LAWS.items():
        assert name == kind.name
        assert kind.parameters[0].role == "amplitude"
        assert all(parameter.role != "amplitude" for parameter in kind.parameters[1:])
        assert len(kind.parameters) <= (3 if kind.memory is None else 5)
        # what a kind does not have has no derivative
        absent = kind.function(Z, V, 0.3, 0.7)[3 + len(kind.parameters) - 1 :]
        assert all(np.all(derivative == 0.0) for derivative in absent)


def test_laws_load_without_numba():
    code = "import sys, opid.mechanics.laws.law; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_linear_law_is_no_force():
    assert Law() == LINEAR == law("linear") == default_law("linear")
    assert LINEAR.name == "linear"
    assert not LINEAR.force(Z, V).any()
    assert LINEAR.parameter_gradient(Z, V).shape == (*Z.shape, 0)


@pytest.mark.slow
def test_a_changed_law_renews_the_compiled_kernels(tmp_path):
    # numba stamps its cache with the file of a kernel alone: without the digest the old code would run on
    package = tmp_path / "opid"
    source = Path(opid.mechanics.__file__).parent
    (package / "mechanics" / "laws").mkdir(parents=True)
    (package / "__init__.py").touch()
    for name in ("errors.py", "estimate.py", "json_values.py", "provenance.py", "result.py"):
        shutil.copy(source.parent / name, package / name)
    laws = (f"laws/{each}.py" for each in ("__init__", "kind", "kinds", "law", "memory_kinds"))
    for name in ("__init__.py", "__init__.pyi", *laws):
        shutil.copy(source / name, package / "mechanics" / name)
    shutil.copytree(source / "kernels", package / "mechanics" / "kernels", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(Path(__file__).parent / "compiled_force.py", package / "mechanics" / "kernels" / "compiled_force.py")
    code = (
        "import numpy as np\n"
        "from opid.mechanics.kernels import law_arrays\n"
        "from opid.mechanics.kernels.compiled_force import compiled_force as kernel\n"
        "from opid.mechanics.laws.law import law\n"
        "_, codes, values, *_ = law_arrays(law('cubic_stiffness', stiffness_n_per_m3=1.0))\n"
        "force = kernel(codes, values, np.array([2.0]), np.zeros(1))[0]\n"
        "print(force, kernel.stats.cache_hits.total())"
    )

    def force_and_hits():
        environment = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        done = subprocess.run(
            [sys.executable, "-c", code],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.split()

    assert force_and_hits() == ["8.0", "0"]
    assert force_and_hits() == ["8.0", "1"]
    kinds = package / "mechanics" / "laws" / "kinds.py"
    kinds.write_text(kinds.read_text().replace("return z * square,", "return 2.0 * z * square,"))
    assert force_and_hits() == ["16.0", "0"]
    assert force_and_hits() == ["16.0", "1"]
    # a part of another file than that of the kernel
    steps = package / "mechanics" / "kernels" / "steps.py"
    steps.write_text(steps.read_text() + "\n")
    assert force_and_hits() == ["16.0", "0"]


def test_a_part_is_compiled_once_for_all_constants_and_garbage_is_collected_afterwards():
    @part(inline=False)
    def scale(value, factor, is_scaled):
        return value * factor if is_scaled else value

    @njit
    def use_constants():
        return scale(2.0, 3, True) + scale(2.0, 4, False)

    assert use_constants() == 8.0
    assert len(scale.signatures) == 1
    assert gc.isenabled()


def test_an_unknown_law_names_those_that_are_searched_apart_from_those_that_are_only_known():
    with pytest.raises(InputError) as caught:
        default_law("foo")
    searched, others = str(caught.value).split("; only a study that names them fits ")
    assert {name for name in LAWS if f"'{name}'" in searched} == set(library())
    assert {name for name in LAWS if f"'{name}'" in others} == set(LAWS) - set(library())


# ---- friction in proportion to the spring force ----------------------------------------------------


def test_loaded_friction_is_proportional_to_the_force_of_a_straight_spring():
    mu, stiffness, static_n = 0.05, 3e5, 1.8e4
    seal = law("loaded_friction", amplitude_n=mu * static_n, scale_m_per_s=0.01, deflection_m=static_n / stiffness)
    pressed = np.maximum(static_n - stiffness * Z, 0.0)
    np.testing.assert_allclose(seal.force(Z, V), mu * pressed * 2.0 / np.pi * np.arctan(V / 0.01))
    assert float(seal.force(static_n / stiffness + 0.01, 0.2)) == 0.0


def test_a_lighter_run_rubs_less_where_its_friction_is_loaded():
    """12 % less weight presses with 12 % less, though no spring of the law carries it."""
    mass, stiffness = 1850.0, 3e5
    weight = mass * GRAVITY_M_PER_S2
    seal = law("loaded_friction", amplitude_n=900.0, scale_m_per_s=0.01, deflection_m=weight / stiffness)
    suspension = Interface(stiffness, 0.0, law=seal)
    (light,) = laws_at_rest([suspension], np.eye(1), np.array([0.12 * weight]))
    np.testing.assert_allclose(light.force(0.0, V), 0.88 * seal.force(0.0, V))


def test_loaded_friction_moves_a_gear_as_an_integrator_of_its_own_says():
    seal = law("loaded_friction", amplitude_n=900.0, scale_m_per_s=0.05, deflection_m=0.06)
    gear = LandingGear(law=seal)
    fs, n = 4096.0, 2049
    time_s = np.arange(2 * n - 1) / (2.0 * fs)
    push = 4e3 * np.sin(2 * np.pi * 3.0 * time_s) + 2e3 * np.sin(2 * np.pi * 7.0 * time_s)
    forces = np.stack([0.1 * push, push], axis=1)
    found = time_response(airframe_structure(gear.airframe), forces, fs=fs, duration_s=n / fs)

    def rates(t, x):
        z, v = x[1] - x[0], x[3] - x[2]
        under = 4e3 * np.sin(6 * np.pi * t) + 2e3 * np.sin(14 * np.pi * t)
        rubbed = 900.0 * max(1.0 - z / 0.06, 0.0) * 2.0 / np.pi * np.arctan(v / 0.05)
        force = gear.suspension_stiffness_n_per_m * z + gear.suspension_damping_n_s_per_m * v + rubbed
        tyre = gear.tyre_stiffness_n_per_m * x[0] + gear.tyre_damping_n_s_per_m * x[2]
        return [
            x[2],
            x[3],
            (under - tyre + force) / gear.unsprung_mass_kg,
            (0.1 * under - force) / gear.sprung_mass_kg,
        ]

    at = time_s[::2]
    own = solve_ivp(rates, (0.0, float(at[-1])), np.zeros(4), t_eval=at, rtol=1e-9, atol=1e-12)
    acceleration = np.array([rates(t, x)[:1:-1] for t, x in zip(at, own.y.T, strict=True)])
    np.testing.assert_allclose(found.acceleration, acceleration, atol=1e-5 * np.abs(acceleration).max())
    constant = law("arctan_velocity", amplitude_n=900.0, scale_m_per_s=0.05)
    other = time_response(airframe_structure(replace(gear, law=constant).airframe), forces, fs=fs, duration_s=n / fs)
    assert np.abs(other.acceleration - acceleration).max() > 1e-3 * np.abs(acceleration).max()
