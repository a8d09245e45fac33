from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from opid.errors import InputError
from opid.modal.linear.level_shifts import fit_linear_mode, level_shifts, nonlinear_modes
from opid.modal.linear.modes import LinearModes, modal_test
from opid.modal.model import NonlinearModalModel, simulate
from opid.modal.power_laws import power_law
from opid.signals.recording import Channel, Recording

FS, N = 1024.0, 4096
SENSORS = tuple("abcde")
MODES = LinearModes(
    [0.0, 42.0, 97.0, 180.0],
    [0.0, 0.006, 0.004, 0.008],
    [
        [0.4, 0.5, 0.3, 0.4],
        [0.4, -0.2, 0.5, -0.3],
        [0.4, 0.1, -0.4, 0.5],
        [0.4, -0.5, -0.35, -0.4],
        [0.4, 0.3, 0.1, 0.2],
    ],
    SENSORS,
)
LINEAR = NonlinearModalModel(MODES)
CHANNELS = (*(Channel(sensor, "m/s^2") for sensor in SENSORS), Channel("force", "N"))
STIFFNESS = MODES.stiffness()


def impact(newton, width=2.0, n=N):
    return newton * np.exp(-0.5 * ((np.arange(n) - 30) / width) ** 2)


def motion_of(model, width=2.0, n=N):
    """Force and accelerations under an impact of 1 N, without noise."""
    force = impact(1.0, width, n)
    return force, simulate(model, force, fs=FS, drive_point="a").samples


def with_noise(force, samples, rng, *, name, noise=0.01, modes=MODES):
    columns = np.column_stack([samples, force])
    columns = columns + noise * np.sqrt(np.mean(columns**2, axis=0)) * rng.standard_normal(columns.shape)
    return modal_test(Recording(columns, fs=FS, channels=CHANNELS), modes, name=name, force="force", drive_point="a")


def linear_tests(rng, levels=(1, 10, 100), *, noise=0.01, width=2.0, n=N, modes=MODES):
    force, samples = motion_of(LINEAR, width, n)
    return [
        with_noise(level * force, level * samples, rng, name=f"{level} N", noise=noise, modes=modes) for level in levels
    ]


def driven(model, rng, levels, *, noise=0.01):
    found = []
    for level in levels:
        force = impact(level)
        samples = simulate(model, force, fs=FS, drive_point="a").samples
        found.append(with_noise(force, samples, rng, name=f"{level} N", noise=noise))
    return found


def largest(mode):
    """Largest displacement and velocity of a mode of the linear model under 100 N."""
    place = mode - 1
    acceleration = 100 * (motion_of(LINEAR)[1] @ np.linalg.pinv(MODES.shapes).T)[:, place]
    omega = np.sqrt(STIFFNESS[place])
    return np.abs(acceleration[100:]).max() / omega**2, np.abs(acceleration[100:]).max() / omega


@pytest.mark.parametrize("noise", [0.01, 0.05])
def test_the_fit_is_unbiased_and_knows_its_scatter(noise):
    rng = np.random.default_rng(11)
    n_runs = 40
    fits = [
        [fit_linear_mode(test, mode) for mode in (2, 3, 4)] for test in linear_tests(rng, [1] * n_runs, noise=noise)
    ]
    for place, mode in enumerate((2, 3, 4)):
        for name in ("frequency_hz", "damping_ratio"):
            found = [getattr(each[place], name) for each in fits]
            values, stds = np.array([(each.value, each.std) for each in found]).T
            truth = getattr(MODES, name)[mode - 1]
            # the time steps of the simulation shift the frequency by some 1e-6
            assert abs(values.mean() - truth) < 4 * values.std() / np.sqrt(n_runs) + 2e-5 * truth, (mode, name)
            assert 0.6 < np.mean(stds) / values.std() < 1.6, (mode, name)
            assert np.mean([each.holds(truth) for each in found]) > 0.75, (mode, name)


def test_a_linear_structure_has_no_nonlinear_mode():
    rng = np.random.default_rng(0)
    force, samples = motion_of(LINEAR)
    for _ in range(30):
        tests = [with_noise(level * force, level * samples, rng, name=f"{level} N") for level in (1, 10, 100)]
        shifts = level_shifts(tests)
        assert [shift.mode for shift in shifts] == [2, 3, 4]  # the rigid-body mode has nothing to shift
        assert nonlinear_modes(shifts) == ()
        assert all(shift.determined for shift in shifts)


@pytest.mark.parametrize(("noise", "width"), [(0.3, 2.0), (0.1, 5.0), (0.01, 8.0)])
def test_noise_alone_makes_no_mode_nonlinear(noise, width):
    rng = np.random.default_rng(1)
    force, samples = motion_of(LINEAR, width)
    shifts = [
        shift
        for _ in range(15)
        for shift in level_shifts(
            [with_noise(k * force, k * samples, rng, name=f"{k} N", noise=noise) for k in (1, 30)]
        )
    ]
    assert sum(shift.nonlinear for shift in shifts) <= 1
    assert any(not shift.determined for shift in shifts)
    assert all("the data cannot decide" in shift.reason for shift in shifts if not shift.determined)


@pytest.mark.parametrize("fraction", [0.02, 0.05, 0.2, -0.05, -0.2])
def test_a_cubic_spring_shifts_the_frequency_of_its_mode_alone(fraction):
    q, _ = largest(3)
    model = NonlinearModalModel(MODES, {3: power_law({3: -fraction * STIFFNESS[2] / q**2}, {})})
    shifts = level_shifts(driven(model, np.random.default_rng(2), (5, 100)))
    assert nonlinear_modes(shifts) == (3,)
    shift = shifts[1]
    assert shift.levels == ("5 N", "100 N")
    assert shift.determined
    assert "mode 3 shifts in frequency by" in shift.reason
    assert "threshold 0.2 %" in shift.reason
    # softening lowers it, by less than at the peak: 3/8 of the fraction of the force
    assert 0 > np.sign(fraction) * shift.frequency_shift.value > -3 / 8 * abs(fraction) * 1.1


def test_a_cubic_spring_is_not_taken_for_damping():
    # even where no level is linear: over a narrow band mass and stiffness of a nonlinear mode change places
    q, _ = largest(3)
    model = NonlinearModalModel(MODES, {3: power_law({3: -0.05 * STIFFNESS[2] / q**2}, {})})
    shift = level_shifts(driven(model, np.random.default_rng(10), (30, 100), noise=0.001))[1]
    assert shift.nonlinear
    assert abs(shift.damping_shift.value) < 0.1


def test_quadratic_damping_shifts_the_damping_of_its_mode_alone():
    _, v = largest(2)
    c0 = MODES.damping()[1]
    model = NonlinearModalModel(MODES, {2: power_law({}, {2: 1.0 * c0 / v})})
    shifts = level_shifts(driven(model, np.random.default_rng(3), (100, 5, 30)))
    assert nonlinear_modes(shifts) == (2,)
    assert shifts[0].levels == ("5 N", "30 N", "100 N")
    assert list(shifts[0].amplitude) == sorted(shifts[0].amplitude)
    # c q'|q'| is worth 8/(3 pi) c V at the amplitude V, and less while it decays
    assert 0.15 < shifts[0].damping_shift.value < 8 / (3 * np.pi)
    assert abs(shifts[0].frequency_shift.value) < 0.002
    damping = [each.value for each in shifts[0].damping_ratio]
    assert damping == sorted(damping)
    assert "damping" in shifts[0].reason


def test_the_thresholds_are_the_users():
    q, _ = largest(3)
    model = NonlinearModalModel(MODES, {3: power_law({3: -0.02 * STIFFNESS[2] / q**2}, {})})
    tests = driven(model, np.random.default_rng(4), (5, 100))
    assert nonlinear_modes(level_shifts(tests, frequency_threshold=0.02)) == ()
    assert nonlinear_modes(level_shifts(tests, frequency_threshold=0.001)) == (3,)


def test_the_fit_agrees_with_an_independent_integration():
    modes = LinearModes([60.0], [0.005], [[0.5]], ("a",))
    k0, c0 = modes.stiffness()[0], modes.damping()[0]
    time = np.arange(N) / FS

    def pulse(t, newton):
        return newton * np.exp(-0.5 * ((t - 0.02) / 0.002) ** 2)

    tests = []
    for newton in (1.0, 50.0):
        solved = solve_ivp(
            lambda t, y, newton=newton: [y[1], 0.5 * pulse(t, newton) - c0 * y[1] - k0 * y[0]],
            (0, time[-1]), [0.0, 0.0], t_eval=time, rtol=1e-8, atol=1e-11, max_step=2e-3,
        )  # fmt: skip
        acceleration = 0.5 * pulse(time, newton) - c0 * solved.y[1] - k0 * solved.y[0]
        samples = np.column_stack([0.5 * acceleration, pulse(time, newton)])
        recording = Recording(samples, fs=FS, channels=(Channel("a", "m/s^2"), Channel("force", "N")))
        tests.append(modal_test(recording, modes, name=f"{newton}", force="force", drive_point="a"))
    for test in tests:
        fit = fit_linear_mode(test, 1)
        assert fit.frequency_hz.value == pytest.approx(60.0, rel=1e-5)
        assert fit.damping_ratio.value == pytest.approx(0.005, rel=1e-3)
        assert fit.modal_mass == pytest.approx(1.0, rel=1e-3)
    assert nonlinear_modes(level_shifts(tests)) == ()


def test_wrong_linear_modes_do_not_make_a_mode_nonlinear():
    rng = np.random.default_rng(5)
    wrong = replace(
        MODES,
        frequency_hz=1.01 * MODES.frequency_hz,
        damping_ratio=1.5 * MODES.damping_ratio,
        shapes=3.0 * MODES.shapes * (1 + 0.05 * rng.standard_normal(MODES.shapes.shape)),
    )
    shifts = level_shifts(linear_tests(rng, modes=wrong))
    assert nonlinear_modes(shifts) == ()
    for shift, mode in zip(shifts, (2, 3, 4), strict=True):
        assert shift.determined
        assert shift.frequency_hz[-1].value == pytest.approx(MODES.frequency_hz[mode - 1], rel=1e-3)
        assert shift.damping_ratio[-1].value == pytest.approx(MODES.damping_ratio[mode - 1], rel=0.05)


def test_records_that_end_before_the_decay_are_read_right():
    tests = linear_tests(np.random.default_rng(6), n=512)
    shifts = level_shifts(tests)
    assert nonlinear_modes(shifts) == ()
    assert shifts[0].frequency_hz[0].value == pytest.approx(42.0, rel=1e-3)
    assert shifts[0].damping_ratio[0].value == pytest.approx(0.006, rel=0.1)


def test_levels_alike_cannot_tell():
    shifts = level_shifts(linear_tests(np.random.default_rng(7), levels=(90, 100)))
    assert not any(shift.determined for shift in shifts)
    assert "differ only by a factor of 1.1" in shifts[0].reason


def test_a_mode_without_motion_cannot_be_told():
    shapes = MODES.shapes.copy()
    shapes[0, 2] = 0.0  # mode 3 does not move at the drive point
    modes = replace(MODES, shapes=shapes)
    force = impact(1.0)
    samples = simulate(NonlinearModalModel(modes), force, fs=FS, drive_point="a").samples
    rng = np.random.default_rng(8)
    tests = [with_noise(k * force, k * samples, rng, name=f"{k} N", modes=modes) for k in (1, 100)]
    shift = level_shifts(tests)[1]
    assert (shift.mode, shift.nonlinear, shift.determined) == (3, False, False)
    assert shift.frequency_shift.value is None
    assert "mode 3 hardly moves" in shift.reason


def test_bad_input_is_refused():
    tests = linear_tests(np.random.default_rng(9))
    with pytest.raises(InputError, match="two levels or more"):
        level_shifts(tests[:1])
    with pytest.raises(InputError, match="frequency_threshold is 0"):
        level_shifts(tests, frequency_threshold=0)
    with pytest.raises(InputError, match="damping_threshold is -1"):
        level_shifts(tests, damping_threshold=-1)
    decay = modal_test(tests[0].recording, MODES, name="decay")
    with pytest.raises(InputError, match="'decay' has no force"):
        level_shifts([*tests, decay])
    fewer = LinearModes(MODES.frequency_hz[:2], MODES.damping_ratio[:2], MODES.shapes[:, :2], SENSORS)
    other = modal_test(tests[0].recording, fewer, name="other", force="force", drive_point="a")
    with pytest.raises(InputError, match="give all tests the same modes"):
        level_shifts([*tests, other])
    with pytest.raises(InputError, match="rigid-body mode"):
        fit_linear_mode(tests[0], 1)
