import numpy as np
import pytest
from driven_response import driven_response

from opid.mechanics.driven import Interface, Noise, UnboundedResponseError, half_steps
from opid.mechanics.laws.law import LINEAR, default_law, law
from opid.mechanics.smoothing import DrivenRecord, smooth

FS = 256.0
NOISE = 0.02


def simulated(interfaces, accelerance, *, seed=0, n=2048, push=0.0):
    """Return a noisy record of a body on suspensions, and the motion behind it."""
    rng = np.random.default_rng(seed)
    n_interfaces = len(interfaces)
    below = np.zeros((n, n_interfaces))
    for _ in range(3):
        phase = rng.uniform(0, 2 * np.pi, (12, n_interfaces))
        below += np.sum(np.sin(np.linspace(4, 90, 12)[:, None] * np.arange(n)[:, None, None] / FS + phase), axis=1)
    true = driven_response(interfaces, accelerance, half_steps(below), fs=FS)
    record = DrivenRecord(
        interfaces=interfaces,
        accelerance=np.asarray(accelerance),
        reading=np.asarray(accelerance),
        drive=below + NOISE * rng.standard_normal(below.shape),
        measured=true.acceleration + NOISE * rng.standard_normal(below.shape),
        fs=FS,
        noise=Noise(NOISE, NOISE, unmeasured=push),
        offset_std=(np.full(n_interfaces, 1e-3), np.full(n_interfaces, 1e-3)),
        drift_m=np.full(n_interfaces, 0.02),
    )
    return record, true


GEARS = {
    "linear": Interface(400.0, 4.0),
    "cubic": Interface(300.0, 4.0, law=law("cubic_stiffness", stiffness_n_per_m3=5e5)),
    "friction": Interface(400.0, 3.0, law=law("arctan_velocity", amplitude_n=0.5, scale_m_per_s=0.02)),
    "stop": Interface(400.0, 4.0, law=law("bump_stop", stiffness_n_per_m=2000.0, gap_m=0.02)),
    "dahl": Interface(400.0, 4.0, law=law("dahl_friction", amplitude_n=0.5, scale_m=1e-3)),
    "iwan": Interface(400.0, 4.0, law=default_law("iwan_friction").scaled(1e-3)),
    "maxwell": Interface(400.0, 3.0, law=law("maxwell_arm", stiffness_n_per_m=160.0, relaxation_s=0.05)),
}


def test_a_spring_to_the_ground_is_told_from_the_suspension():
    held = Interface(400.0, 4.0, 150.0, GEARS["cubic"].law)
    n = 4096
    seconds = np.arange(2 * n - 1) / (2 * FS)
    # The path stays near its mean height, as that of a wheel does.
    rates, phases = np.linspace(3, 60, 12), np.random.default_rng(3).uniform(0, 2 * np.pi, 12)
    waves = rates * seconds[:, np.newaxis] + phases
    below = 2.0 * np.sum(np.sin(waves), axis=1)
    height, speed = -2.0 * np.sum(np.sin(phases) / rates**2), -2.0 * np.sum(np.cos(phases) / rates)
    true = driven_response([held], [[1.0]], below[:, np.newaxis], fs=FS, start=[[0.0], [0.0], [height], [speed]])
    rng = np.random.default_rng(0)
    noise = NOISE * rng.standard_normal((2, n, 1))
    record, _ = simulated([held], [[1.0]], n=n)
    changed = {"drive": below[::2, np.newaxis] + noise[0], "measured": true.acceleration + noise[1]}
    record = DrivenRecord(**(vars(record) | changed | {"drift_m": np.array([0.05])}))
    smoothed = smooth(record, true.travel)
    strut = 400.0 * true.travel + 4.0 * true.velocity + held.law.force(true.travel, true.velocity)
    error = smoothed.motion.force - strut
    drawn = np.array([smoothed.draw(record, rng).force for _ in range(40)])
    std = np.sqrt(np.mean((drawn - smoothed.motion.force) ** 2, axis=0))
    assert np.mean(np.abs(error) < 3 * std) > 0.8  # a slow error holds for many samples
    assert (smoothed.motion.whole_force + true.acceleration).std() < 0.7 * NOISE


@pytest.mark.parametrize("name", GEARS)
def test_the_smoothed_motion_is_nearer_to_the_truth_than_the_noise_and_its_spread_is_its_error(name):
    record, true = simulated([GEARS[name]], [[1.0]])
    smoothed = smooth(record, true.travel + 1e-4)
    force = -true.acceleration
    error = smoothed.motion.force - force
    assert error.std() < 0.7 * NOISE
    rng = np.random.default_rng(1)
    drawn = np.array([smoothed.draw(record, rng).force for _ in range(40)])
    std = np.sqrt(np.mean((drawn - smoothed.motion.force) ** 2, axis=0))
    assert 0.85 < np.mean(np.abs(error) < 1.96 * std) < 0.999


def test_a_body_on_two_suspensions_is_smoothed_by_all_of_its_sensors():
    accelerance = np.array([[1.0, 0.3], [0.3, 0.8]])
    record, true = simulated([GEARS["linear"], GEARS["cubic"]], accelerance)
    smoothed = smooth(record, true.travel)
    force = np.linalg.solve(accelerance, -true.acceleration.T).T
    raw = np.linalg.solve(accelerance, -record.measured.T).T
    assert (smoothed.motion.force - force).std() < 0.7 * (raw - force).std()


def test_the_draws_have_the_covariance_of_the_normal_equations():
    record, true = simulated([GEARS["linear"]], [[1.0]], n=64)
    smoothed = smooth(record, true.travel)
    n = smoothed.unknowns.size
    n_rows = record.n_interfaces + record.n_sensors
    jacobian = np.zeros((64 * n_rows + 2, n))
    for k in range(64):
        jacobian[k * n_rows : (k + 1) * n_rows, k : k + 5] = smoothed.normal.local[k, :, :, 0]
        jacobian[k * n_rows : (k + 1) * n_rows, -2:] = smoothed.normal.border[k]
    jacobian[-2:, -2:] = smoothed.normal.prior
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    rows = np.random.default_rng(0).standard_normal((64, n_rows))
    expected = covariance @ (jacobian.T @ np.append(rows.ravel(), [0.3, -0.2]))
    np.testing.assert_allclose(smoothed.normal.solve(rows, np.array([0.3, -0.2])), expected, rtol=1e-5, atol=1e-9)


def test_an_unmeasured_force_is_told_from_the_force_of_the_suspension():
    record, true = simulated([GEARS["linear"]], [[1.0]], push=0.3)
    rng = np.random.default_rng(2)
    n = len(record.drive)
    push = np.convolve(rng.standard_normal(n + 29), np.hanning(30) / 6, "valid")
    # The drive takes off what the force adds to the acceleration, so that the travel is the same.
    pushed = DrivenRecord(**{**vars(record), "drive": record.drive + push[:, None]})
    pushed = DrivenRecord(**{**vars(pushed), "measured": record.measured + push[:, None]})
    smoothed = smooth(pushed, true.travel)
    assert np.std(smoothed.motion.pushed[:, 0] - push) < 0.5 * np.std(push)
    assert (smoothed.motion.force + true.acceleration).std() < 0.5 * np.std(push)


def test_a_suspension_that_holds_nothing_is_refused():
    record, true = simulated([GEARS["linear"]], [[1.0]])
    nothing = DrivenRecord(**{**vars(record), "interfaces": [Interface(0.0, 0.0, law=LINEAR)]})
    nothing = DrivenRecord(**{**vars(nothing), "noise": Noise(np.inf, NOISE)})
    with pytest.raises(UnboundedResponseError, match="hold the body nowhere"):
        smooth(nothing, true.travel)
