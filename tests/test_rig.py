import numpy as np
import pytest
from scipy.integrate import solve_ivp

from opid.errors import InputError
from opid.mechanics.laws.law import law
from opid.mechanics.response import time_response
from opid.mechanics.rig import Rig, Shaker, drive, free_decay, impact, open_rig, rig_run
from opid.mechanics.structure import Joint, Structure, frequency_response, iwan

FS = 2000.0
FREQUENCY_HZ = np.array([0.0, 120.0, 310.0])
SHAPES = np.array([[0.3, 0.4, 0.2], [0.3, 0.0, -0.4], [0.3, -0.4, 0.3], [0.3, 0.2, 0.1]])


def rig(*joints, shaker=None, names=("a", "b", "c", "d")):
    """Three modes, the first a rigid-body one, seen by four sensors and driven at the first."""
    omega = 2.0 * np.pi * FREQUENCY_HZ
    structure = Structure(np.eye(3), np.diag(2 * 0.01 * omega), np.diag(omega**2), joints)
    return Rig(structure, SHAPES[0], SHAPES, names, shaker)


def bolted(**settings):
    hardening = law("cubic_stiffness", stiffness_n_per_m3=1e10)
    joint = Joint("lap", [0.0, 0.4, -0.2], sliders=iwan(stiffness_n_per_m=2e6, slip_force_n=40.0), law=hardening)
    return rig(joint, **settings)


def beat(level, *, frequency_hz=118.0, n=1200):
    place = np.linspace(-1.0, 1.0, 600)
    window = np.cos(0.5 * np.pi * place) ** 4
    return level * np.concatenate([window * np.sin(2 * np.pi * frequency_hz / FS * np.arange(600)), np.zeros(n - 600)])


def quiet(rig, voltage, **settings):
    return rig_run(rig, voltage, fs=FS, rng=np.random.default_rng(0), noise_fraction=0.0, **settings)


@pytest.mark.parametrize("shaker", [None, Shaker()])
def test_the_readings_of_a_linear_rig_are_force_times_its_frequency_response(shaker):
    test = rig(shaker=shaker)
    clean = quiet(test, beat(10.0, n=8192)).clean
    lines = np.fft.rfftfreq(clean.n_samples, 1.0 / FS)
    band = (lines > 100.0) & (lines < 136.0)
    spectra = np.fft.rfft(clean.samples, axis=0)[band]
    receptance = frequency_response(test.structure, lines[band]) * -((2 * np.pi * lines[band, None, None]) ** 2)
    expected = spectra[:, :1] * np.einsum("si,fij,j->fs", SHAPES, receptance, SHAPES[0])
    # what is left at the end of the record is not quite zero
    assert np.abs(spectra[:, 1:] - expected).max() < 2e-3 * np.abs(expected).max()


def test_without_a_shaker_the_voltage_is_the_force():
    voltage = beat(25.0)
    clean = quiet(bolted(), voltage).clean
    np.testing.assert_array_equal(clean.channel("force"), voltage)
    assert clean.unit("force") == "N"
    assert clean.unit("a") == "m/s^2"


@pytest.mark.parametrize("shaker", [None, Shaker(second_harmonic=0.02)])
def test_the_recorded_force_at_the_drive_point_gives_the_recorded_motion(shaker):
    test = bolted(shaker=shaker)
    clean = quiet(test, beat(20.0)).clean
    again = quiet(bolted(), clean.channel("force")).clean
    for name in test.sensor_names:
        scale = np.abs(clean.channel(name)).max()
        # the measured force between its samples is only known as far as it is band-limited
        np.testing.assert_allclose(again.channel(name), clean.channel(name), atol=5e-3 * scale)


def test_the_steps_follow_the_highest_natural_frequency_and_are_enough():
    assert open_rig(rig(), FS).steps_per_sample == int(np.ceil(2 * np.pi * 310.0 / (0.06 * FS)))
    # A mode that the record cannot show needs no more than to be stable.
    assert open_rig(rig(), 200.0).steps_per_sample == int(np.ceil(2 * np.pi * 310.0 / (0.2 * 200.0)))
    assert open_rig(rig(), FS, largest_angle_rad=0.4).steps_per_sample == int(np.ceil(2 * np.pi * 310.0 / (0.4 * FS)))
    assert open_rig(rig(shaker=Shaker()), FS).steps_per_sample > 10
    test = bolted(shaker=Shaker())
    found, finer = quiet(test, beat(20.0)), quiet(test, beat(20.0), steps_per_sample=80)
    assert finer.steps_per_sample == 80
    for name in ("force", *test.sensor_names):
        scale = np.abs(finer.clean.channel(name)).max()
        np.testing.assert_allclose(found.clean.channel(name), finer.clean.channel(name), atol=1e-3 * scale)


def test_a_record_has_the_phase_of_an_integration_of_high_order():
    """A hundred periods of the mode at 120 Hz leave no phase to see: a frequency off by 1e-6 would make 4e-4 of it."""
    test = rig(Joint("lap", [0.0, 1.0, 0.0], law=law("cubic_stiffness", stiffness_n_per_m3=1e11)))
    omega, start = 2.0 * np.pi * FREQUENCY_HZ, np.array([0.0, 5e-4, 2e-5])

    def move(time, state):
        force = np.array([0.0, 1e11 * state[1] ** 3, 0.0])
        return np.concatenate([state[3:], -(omega**2) * state[:3] - 2 * 0.01 * omega * state[3:] - force])

    time_s = np.arange(1000) / FS
    exact = solve_ivp(
        move, (0.0, time_s[-1]), np.concatenate([start, np.zeros(3)]), method="DOP853", t_eval=time_s,
        rtol=1e-11, atol=1e-14,
    ).y  # fmt: skip
    acceleration = np.array([move(0.0, state)[3:] for state in exact.T]) @ SHAPES.T
    found = free_decay(
        test, fs=FS, duration_s=0.5, rng=np.random.default_rng(0), noise_fraction=0.0, initial_displacement=start
    )
    # Error over the amplitude that is left, for the phase grows while the motion decays.
    left = np.abs(acceleration[-100:]).max(axis=0)
    assert (np.abs(found.clean.samples - acceleration)[-100:].max(axis=0) < 2e-4 * left).all()


def test_the_second_harmonic_of_the_shaker_reaches_the_structure():
    def fraction(shaker):
        voltage = 20.0 * np.sin(2 * np.pi * 100.0 / FS * np.arange(4000)) * np.minimum(1.0, np.arange(4000) / 1000)
        force = quiet(rig(shaker=shaker), voltage).clean.channel("force")[2000:]
        lines = np.abs(np.fft.rfft(force))
        return lines[200] / lines[100]

    assert fraction(Shaker()) < 2e-3
    assert fraction(Shaker(second_harmonic=0.1)) > 10 * fraction(Shaker())


@pytest.mark.parametrize("shaker", [None, Shaker(second_harmonic=0.02)])
def test_a_rig_driven_block_by_block_reads_as_at_once(shaker):
    test = bolted(shaker=shaker)
    ready = open_rig(test, FS)
    finer = 2 * ready.steps_per_sample
    time_s = np.arange(finer * 200 + 1) / (finer * FS)
    voltage = 20.0 * np.sin(2 * np.pi * 118.0 * time_s)
    whole, last = drive(ready, ready.start, voltage)
    state, begin = ready.start, 0
    for n in (17, 100, 83):
        readings, state = drive(ready, state, voltage[finer * begin : finer * (begin + n) + 1])
        np.testing.assert_array_equal(readings.acceleration, whole.acceleration[begin : begin + n + 1])
        np.testing.assert_allclose(readings.force, whole.force[begin : begin + n + 1], atol=1e-9)
        begin += n
    np.testing.assert_array_equal(state.slider_positions, last.slider_positions)


def test_a_block_may_have_a_rate_of_its_own():
    ready = open_rig(rig(), FS)
    n = 2 * ready.steps_per_sample * 40 + 1

    def driven(fs):
        time_s = np.arange(n) / (2 * ready.steps_per_sample * (fs or FS))
        return drive(ready, ready.start, np.sin(2 * np.pi * 50.0 * time_s), fs=fs)[0].acceleration

    expected = time_response(
        rig().structure,
        lambda t: np.sin(2 * np.pi * 50.0 * t)[:, None],
        fs=2300.0,
        duration_s=41 / 2300.0,
        loads=SHAPES[:1].T,
        steps_per_sample=ready.steps_per_sample,
    )
    np.testing.assert_allclose(driven(2300.0), expected.acceleration @ SHAPES.T, atol=1e-9)
    assert np.abs(driven(None) - driven(2300.0)).max() > 1e-3
    with pytest.raises(InputError, match="open it for the lowest rate"):
        driven(1500.0)


def test_a_blow_hands_its_momentum_over():
    run = impact(rig(), peak_n=300.0, pulse_s=8e-3, fs=FS, duration_s=0.5, rng=np.random.default_rng(1))
    force = run.clean.channel("force")
    assert force.max() == pytest.approx(300.0, rel=0.01)
    assert not force[run.clean.time_s < 0.02].any()
    assert not force[run.clean.time_s > 0.0281].any()
    # sum over sensors of the weights that single out the rigid-body mode
    weights = np.linalg.pinv(SHAPES)[0]
    velocity = np.trapezoid(run.clean.samples[:, 1:] @ weights, dx=1 / FS)
    assert velocity == pytest.approx(SHAPES[0, 0] * 300.0 * 8e-3 * 2 / np.pi, rel=0.01)


def test_a_free_decay_is_that_of_its_mode():
    decay = free_decay(
        rig(shaker=Shaker()), fs=FS, duration_s=0.3, rng=np.random.default_rng(1), initial_displacement=[0, 1e-4, 0]
    )
    assert decay.recording.names == ("a", "b", "c", "d")
    omega, zeta = 2 * np.pi * 120.0, 0.01
    pole = omega * (-zeta + 1j * np.sqrt(1 - zeta**2))
    # from rest at q0: q = q0 Im(conj(p) exp(p t)) / Im(conj(p)), and twice by time
    q = 1e-4 * (pole**2 * np.conj(pole) * np.exp(pole * decay.clean.time_s)).imag / np.conj(pole).imag
    expected = q[:, None] * SHAPES[:, 1]
    np.testing.assert_allclose(decay.clean.samples, expected, atol=1e-4 * np.abs(expected).max())


def test_a_decay_on_a_shaker_starts_without_force_in_the_stinger():
    ready = open_rig(rig(shaker=Shaker()), FS, initial_displacement=[1e-3, 1e-4, 0.0], initial_velocity=[0.1, 0.0, 0.0])
    readings, _ = drive(ready, ready.start, np.zeros(2 * ready.steps_per_sample + 1))
    assert readings.force[0] == pytest.approx(0.0, abs=1e-6)


def test_the_noise_has_its_share_and_another_sensor_leaves_it_alone():
    voltage = beat(20.0)
    fewer = Rig(rig().structure, SHAPES[0], SHAPES[:2], ("a", "b"))
    one, other = (
        rig_run(each, voltage, fs=FS, rng=np.random.default_rng(7), noise_fraction=0.05) for each in (rig(), fewer)
    )
    noise = one.recording.samples - one.clean.samples
    rms = np.sqrt(np.mean(one.clean.samples**2, axis=0))
    # 1200 samples: 2 % of scatter
    np.testing.assert_allclose(noise.std(axis=0), 0.05 * rms, rtol=0.12)
    np.testing.assert_allclose(other.recording.samples, one.recording.samples[:, :3], rtol=1e-12, atol=1e-12)
    assert np.corrcoef(noise.T)[0, 1] == pytest.approx(0.0, abs=0.15)


def test_a_rig_keeps_its_own_copy():
    shapes = SHAPES.copy()
    test = Rig(rig().structure, shapes[0], shapes, ("a", "b", "c", "d"))
    shapes[:] = 0.0
    assert test.sensors.any()
    assert test.drive_point.any()


RNG = np.random.default_rng(0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: rig(names=("a", "b")), "give 4 different names"),
        (lambda: rig(names=("a", "b", "c", "force")), "none of them 'force'"),
        (lambda: Rig(rig().structure, SHAPES[0], SHAPES[0], ("a",)), r"sensors of the rig has shape \(3,\)"),
        (lambda: Rig(rig().structure, [1.0], SHAPES, ("a",)), r"drive_point of the rig has shape \(1,\)"),
        (lambda: open_rig(rig(), 0.0), "fs is 0.0 Hz"),
        (lambda: open_rig(rig(), FS, steps_per_sample=0), "steps_per_sample is 0"),
        (lambda: open_rig(rig(), FS, initial_velocity=[1.0]), r"initial_velocity is \[1.0\]: give 3 finite"),
        (lambda: rig_run(rig(), np.zeros((9, 2)), fs=FS, rng=RNG), r"the voltage has shape \(9, 2\)"),
        (lambda: rig_run(rig(), np.full(99, np.nan), fs=FS, rng=RNG), "not finite"),
        (lambda: rig_run(rig(), np.zeros(99), fs=FS, rng=RNG, noise_fraction=-1.0), "noise_fraction is -1.0"),
        (
            lambda: drive(open_rig(rig(), FS), open_rig(rig(), FS).start, np.zeros((3, 1))),
            "one voltage for each half step",
        ),
        (lambda: drive(open_rig(rig(), FS), open_rig(rig(), FS).start, np.zeros(4)), "the forces have shape"),
        (lambda: impact(rig(), peak_n=1.0, pulse_s=1e-3, fs=FS, duration_s=1.0, rng=RNG), "four samples or more"),
        (lambda: impact(rig(), peak_n=1.0, pulse_s=0.01, fs=FS, duration_s=0.02, rng=RNG), "inside the record"),
        (lambda: free_decay(rig(), fs=FS, duration_s=0.0, rng=RNG), "at least two"),
    ],
)
def test_what_is_wrong_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()
