"""Where a free decay begins: after a drive that stops, after a measured force, and with a frequency that glides."""

from pathlib import Path

import numpy as np
import pytest
from cli_runs import opid
from measured_data import measured
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete, dlsim

from opid.errors import InputError
from opid.modal.decay.free_decay import decay_of, free_decay
from opid.modal.linear.modes import LinearModes, modal_test
from opid.modal.linear.modes_file import write_modes
from opid.signals.recording import recording_from_arrays

FS, OMEGA, ZETA = 1024.0, 2.0 * np.pi * 40.0, 0.005


def hardening(seed):
    """Displacement of a Duffing oscillator at resonance until the force stops, natural frequency, damping, and the end.

    At the amplitude 1 of the dwell its frequency is 3 to 12 % above that of small motion.
    """
    rng = np.random.default_rng(seed)
    frequency, zeta = rng.uniform(25.0, 60.0), rng.uniform(0.002, 0.008)
    omega, top = 2.0 * np.pi * frequency, 1.0 + rng.uniform(0.03, 0.12)
    cubic, end, duration = omega**2 * (top**2 - 1.0) / 0.75, rng.uniform(3.0, 5.0), 14.0

    def rate(time, state):
        q, v = state
        drive = -2.0 * zeta * omega * top * omega * np.sin(top * omega * time) if time < end else 0.0
        return v, drive - (omega**2 * q + 2.0 * zeta * omega * v + cubic * q**3)

    time, parts, state = np.arange(round(duration * 1000.0)) / 1000.0, [], (1.0, 0.0)
    for first, last in ((0.0, end), (end, duration)):
        inside = time[(time >= first) & (time < last)]
        found = solve_ivp(rate, (first, last), state, "DOP853", [*inside, last], rtol=1e-8, atol=1e-10)
        parts.append(found.y[0, :-1])
        state = found.y[:, -1]
    q = np.concatenate(parts)
    return q + 1e-3 * rng.standard_normal(q.size), frequency, zeta, end


@pytest.mark.parametrize("seed", range(5))
def test_a_decay_after_a_dwell_is_followed_though_its_frequency_glides(seed):
    samples, frequency, zeta, end = hardening(seed)
    decay = free_decay(samples, fs=1000.0, quantity="displacement")
    assert decay.beginning == "drive"
    assert end < decay.start_s < end + 6.0 / frequency
    assert decay.warnings == ()
    assert decay.frequency_low_hz.value == pytest.approx(frequency, abs=4.0 * decay.frequency_low_hz.std)
    assert decay.damping_low.value == pytest.approx(zeta, abs=4.0 * decay.damping_low.std)
    assert decay.frequency_low_hz.std < 1e-4 * frequency
    assert decay.damping_low.std < 0.01 * zeta


def driven(kind, seed):
    """Acceleration of a linear mode, the force that drives it until `end`, and `end`, s."""
    rng = np.random.default_rng(seed)
    time, force = np.arange(round(9 * FS)) / FS, np.zeros(round(9 * FS))
    last = round(rng.uniform(2.5, 3.5) * FS)
    acts = slice(500, last)
    since, span = time[acts] - time[500], time[last] - time[500]
    force[acts] = {
        "dwell": np.sin(OMEGA * since),
        "sweep": np.sin(2.0 * np.pi * (30.0 * since + 7.0 * since**2 / span)),
        "burst": rng.standard_normal(last - 500),
        "ramp": np.sin(OMEGA * since) * np.minimum(1.0, (span - since) / 0.5),
        "two hits": np.zeros(last - 500),
    }[kind]
    if kind == "two hits":
        force[1000:1006], force[last - 6 : last] = 100.0, 200.0
    matrices = (
        np.array([[0.0, 1.0], [-(OMEGA**2), -2.0 * ZETA * OMEGA]]),
        np.array([[0.0], [1.0]]),
        np.array([[-(OMEGA**2), -2.0 * ZETA * OMEGA]]),
        np.array([[1.0]]),
    )
    acceleration = dlsim(cont2discrete(matrices, 1.0 / FS), force[:, None])[1][:, 0]
    noisy = acceleration + 0.002 * acceleration.std() * rng.standard_normal(time.size)
    # the load cell is preloaded, and has noise
    return noisy, 10.0 * force + 3.0 + 0.02 * rng.standard_normal(time.size), last / FS


@pytest.mark.parametrize("kind", ["dwell", "sweep", "burst", "ramp", "two hits"])
def test_a_decay_begins_after_the_end_of_its_force(kind):
    for seed in range(3):
        acceleration, force, end = driven(kind, seed)
        decay = free_decay(acceleration, fs=FS, force=force, friction=False, memory=False)
        assert (decay.beginning, decay.warnings) == ("force", ())
        assert end - 0.02 < decay.start_s < end + 4.0 / 40.0
        assert decay.frequency_low_hz.value == pytest.approx(40.0, abs=4.0 * decay.frequency_low_hz.std)
        assert decay.damping_low.value == pytest.approx(ZETA, abs=4.0 * decay.damping_low.std)


def test_a_force_that_acts_in_a_stretch_that_was_given_is_told():
    acceleration, force, end = driven("ramp", 0)
    decay = free_decay(acceleration, fs=FS, force=force, start_s=end - 0.3)
    assert any("if it drives the structure, this is no free decay; give start_s" in each for each in decay.warnings)
    with pytest.raises(InputError, match="a number for each sample"):
        free_decay(acceleration, fs=FS, force=force[:-1])


def test_a_load_cell_that_falls_with_the_motion_takes_nothing_of_the_decay():
    """It reads a part of the inertia of what rings, so that it never ends before the motion does."""
    time = np.arange(round(8 * FS)) / FS
    ring = np.where(time > 1.0, np.exp(-ZETA * OMEGA * (time - 1.0)) * np.sin(OMEGA * (time - 1.0)), 0.0)
    noisy = ring + 0.002 * np.random.default_rng(0).standard_normal(time.size)
    alone, beside = (free_decay(noisy, fs=FS, force=force) for force in (None, 5.0 * noisy + 1.0))
    assert beside.start_s == alone.start_s
    np.testing.assert_array_equal(beside.frequency_hz, alone.frequency_hz)


def test_a_log_and_a_study_find_the_force_beside_the_motion(tmp_path):
    acceleration, force, end = driven("sweep", 1)
    time = np.arange(force.size) / FS
    table = np.stack([time, acceleration, force], axis=1)
    log = tmp_path / "sweep.csv"
    np.savetxt(log, table, delimiter=",", header="time [s],a [m/s^2],cell [N]", comments="")
    done = opid("decay", log, "--channel", "a")
    assert done.exit_code == 0, done.output
    assert "The decay begins after the end of the measured force." in done.stdout.replace("\n", " ")
    modes = LinearModes([40.0], [ZETA], [[1.0]], ("a",))
    write_modes(modes, tmp_path / "modes.csv")
    (tmp_path / "study.toml").write_text(
        '[modes]\nfile = "modes.csv"\n[[tests]]\nlog = "none.csv"\nforce = "cell"\ndrive_point = "a"\n'
    )
    done = opid("decay", log, "--study", tmp_path / "study.toml")
    assert done.exit_code == 0, done.output
    assert "The decay begins after the end of the measured force." in done.stdout.replace("\n", " ")
    recording = recording_from_arrays([acceleration, force], ["a", "cell"], fs=FS, unit=["m/s^2", "N"])
    assert decay_of(modal_test(recording, modes, name="sweep"), 1).start_s > end - 0.02


def test_a_measured_beam_is_followed_from_the_end_of_its_dwell(tmp_path):
    """Its force has no unit and another clock; the beam swings at 42 Hz until 12.1 s, then falls to 36.9 Hz."""
    log = measured("magnet_beam/decay_f_42p05_ampl_2p0_0.lvm.gz")
    done = opid("decay", log, "--channel", "Strain_0", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    words = " ".join(done.stdout.split())
    assert "The decay begins after a steady motion, which something drove and which is left out. From 12.2" in words
    assert "beat" not in words
    assert "no law" not in words
    assert Path(tmp_path / "result.json").exists()
