import numpy as np
import pytest
from made_beats import C2, FOUR, FS, K3, OMEGA, ONE, ZETA, beat, softening
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from opid.errors import InputError
from opid.mechanics.structure import frequency_response
from opid.modal.linear.modes import force_projection, modal_test
from opid.modal.model import NonlinearModalModel, modal_response, simulate, truth_test
from opid.modal.power_laws import power_law
from opid.signals.recording import Channel, Recording


def test_against_another_integrator():
    force = beat(40.0, whole_s=1.0, beat_s=0.5)
    time = np.arange(force.size) / FS
    between = CubicSpline(time, force)

    def slope(t, state):
        q, v = state
        f_q = 0.5 * between(t)
        return [v, f_q - 2 * ZETA * OMEGA * v - OMEGA**2 * q - K3 * q**3 - C2 * v * abs(v)]

    other = solve_ivp(slope, (0, time[-1]), [0, 0], t_eval=time, rtol=1e-9, atol=1e-14, max_step=1 / FS)
    motion = modal_response(softening(), force, fs=FS, drive_point="a")
    np.testing.assert_allclose(motion.displacement[:, 0], other.y[0], atol=2e-4 * np.abs(other.y[0]).max())


def test_linear_modes_respond_as_their_receptance():
    force = beat(1.0, frequency_hz=90.0, beat_s=0.4, whole_s=8.0)
    model = NonlinearModalModel(FOUR)
    response = simulate(model, force, fs=FS, drive_point="b")
    line = round(90.0 * force.size / FS)
    spectrum = np.fft.rfft(response.samples, axis=0)[line] / np.fft.rfft(force)[line]
    modal = frequency_response(model.structure(), 90.0)[0] @ force_projection(FOUR, "b")
    np.testing.assert_allclose(spectrum, -((2 * np.pi * 90.0) ** 2) * FOUR.shapes @ modal, rtol=2e-3)


def test_the_linear_model_stands_beside():
    assert softening().linear.laws == {}
    small = beat(1e-3)
    both = [simulate(model, small, fs=FS, drive_point="a").samples for model in (softening(), softening().linear)]
    np.testing.assert_allclose(both[0], both[1], atol=1e-4 * np.abs(both[1]).max())


def test_what_is_wrong_is_said():
    with pytest.raises(InputError, match="there is no mode 2"):
        NonlinearModalModel(ONE, {2: power_law({3: 1.0}, {})})
    with pytest.raises(InputError, match="one series of finite numbers"):
        simulate(softening(), np.zeros((3, 2)), fs=FS, drive_point="a")
    with pytest.raises(InputError, match="no sensor 'z'"):
        simulate(softening(), np.zeros(30), fs=FS, drive_point="z")
    with pytest.raises(InputError, match="grows without bound"):
        simulate(softening(), beat(4000.0), fs=FS, drive_point="a")
    with pytest.raises(InputError, match="has no term k6"):
        power_law({6: 1.0}, {})


def test_several_forces_act_as_their_sum_on_a_linear_model():
    model = NonlinearModalModel(FOUR)
    one, other = beat(3.0, frequency_hz=90.0, whole_s=1.0, beat_s=0.4), beat(2.0, whole_s=1.0, beat_s=0.6)
    both = simulate(model, np.column_stack([one, other]), fs=FS, drive_point=("a", "d")).samples
    apart = [simulate(model, force, fs=FS, drive_point=at).samples for force, at in ((one, "a"), (other, "d"))]
    np.testing.assert_allclose(both, sum(apart), atol=1e-9 * np.abs(both).max())
    with pytest.raises(InputError, match=r"shape \(2048,\): give one column for each of 2 drive points"):
        simulate(model, one, fs=FS, drive_point=("a", "d"))


def test_an_initial_condition_decays_as_the_closed_form():
    """A free decay of one mode, q = a exp(-zeta w t) cos(wd t - phi), from a displacement and a velocity."""
    displacement, velocity = 2e-4, 0.05
    motion = modal_response(
        softening().linear, np.zeros(1024), fs=FS, drive_point="a", displacement=[displacement], velocity=[velocity]
    )
    time, damped = np.arange(1024) / FS, OMEGA * np.sqrt(1 - ZETA**2)
    along = (velocity + ZETA * OMEGA * displacement) / damped
    exact = np.exp(-ZETA * OMEGA * time) * (displacement * np.cos(damped * time) + along * np.sin(damped * time))
    # Runge-Kutta keeps the frequency to 6e-7, which is 2e-4 rad after 60 cycles.
    np.testing.assert_allclose(motion.displacement[:, 0], exact, atol=2e-4 * np.abs(exact).max())
    with pytest.raises(InputError, match="initial_velocity"):
        modal_response(softening(), np.zeros(64), fs=FS, drive_point="a", velocity=[0.0, 1.0])


def test_a_truth_test_has_several_forces_and_an_initial_condition():
    model = softening(FOUR, 3)
    forces = np.column_stack([beat(20.0, whole_s=2.0), beat(15.0, whole_s=2.0, beat_s=0.5)])
    start = {"displacement": [0.0, 0.0, 3e-4, 0.0], "velocity": [0.0, 0.0, 0.1, 0.0]}
    response = simulate(model, forces, fs=FS, drive_point=("a", "e"), **start)
    channels = (Channel("one", "N"), Channel("two", "N"), *response.channels)
    record = Recording(np.column_stack([forces, response.samples]), fs=FS, channels=channels)
    test = modal_test(record, FOUR, name="truth", force={"one": "a", "two": "e"})
    exact = truth_test(model, test, **start)
    assert max(each.nrmse_nonlinear for each in exact.sensors.values()) < 1e-6
    at_rest = truth_test(model, test)
    assert min(each.nrmse_nonlinear for each in at_rest.sensors.values()) > 0.1
