"""Linear modes at several stages: what moved is told with its errors, and what did not is not."""

import json

import numpy as np
import pytest
from cli_runs import opid, refused

from opid.errors import InputError
from opid.estimate import Estimate
from opid.modal.linear.frequency_response import forced_record, measured_response, resynthesised
from opid.modal.linear.modes import LinearModes
from opid.modal.linear.modes_file import read_modes
from opid.modal.linear.response_fit import fit_modes
from opid.modal.linear.stages import compare_stages
from opid.signals.logs import write_log
from opid.signals.recording import Channel, Recording

pytest.importorskip("sdypy")

SENSORS = ("tip", "middle", "root", "side")
BAND_HZ = (25.0, 115.0)
BEFORE = LinearModes(
    [0.0, 40.0, 63.0, 91.0],
    [0.0, 0.006, 0.004, 0.009],
    [[0.3, 0.5, -0.4, 0.3], [0.3, -0.2, 0.5, 0.4], [0.3, 0.1, 0.2, -0.6], [0.3, -0.4, -0.3, 0.1]],
    SENSORS,
)


def change(frequency=1.0, damping=1.0, order=(0, 1, 2, 3), sensors=SENSORS):
    """The structure after a change, its modes in another order, seen by some of the sensors."""
    hz, shapes = BEFORE.frequency_hz * frequency, BEFORE.shapes[:, list(order)]
    rows = [SENSORS.index(name) for name in sensors]
    return LinearModes(hz, BEFORE.damping_ratio * damping, shapes[rows], sensors)


def ring(modes, seed):
    """The record of a hit at the tip, with noise of a thousandth."""
    rng, n, fs = np.random.default_rng(seed), 15360, 512.0
    time_s = np.arange(n) / fs
    struck = (time_s > 0.05) & (time_s < 0.06)
    force = 100 * (1 + seed) * np.where(struck, np.sin(np.pi * (time_s - 0.05) / 0.01), 0)
    lines_hz = np.fft.rfftfreq(n, 1 / fs)
    response = np.zeros((lines_hz.size, len(modes.sensors)), dtype=complex)
    response[1:] = resynthesised(modes, lines_hz[1:], "tip").value
    motion = np.fft.irfft(np.fft.rfft(force)[:, np.newaxis] * response, n, axis=0)
    samples = np.column_stack([motion, force])
    samples += 1e-3 * samples.std(axis=0) * rng.standard_normal(samples.shape)
    return Recording(samples, fs, (*(Channel(name, "m/s^2") for name in modes.sensors), Channel("hammer", "N")))


def find(modes, first_seed=0):
    records = [
        forced_record(ring(modes, first_seed + k), name=f"hit {k}", force="hammer", drive_point="tip") for k in (0, 1)
    ]
    return fit_modes([measured_response(records)], band_hz=BAND_HZ)


def test_what_moved_is_told_with_its_errors_and_what_did_not_is_not():
    moved = change(np.array([1.0, 0.97, 1.0, 0.985]), 1.1)
    found = compare_stages({"hammer": find(BEFORE), "shaker": find(moved, 2)})
    (shifts,) = found.shifts
    for each, ratio in zip(shifts, (0.97, 1.0, 0.985), strict=True):
        assert each.number == each.mode
        assert abs(each.frequency.value - (ratio - 1)) < 4 * each.frequency.std
        assert abs(each.damping.value - 0.1) < 4 * each.damping.std
        assert each.mac > 0.999
        assert each.has_moved == (ratio != 1.0)
    assert "2 of 3 modes, mode 1 by -3 %; give each test the modes of its own stage" in found.warnings[0]
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["stages"] == ["hammer", "shaker"]


@pytest.mark.parametrize("seed", range(3))
def test_a_structure_that_stays_has_not_moved(seed):
    found = compare_stages({"one": find(BEFORE, 2 * seed), "two": find(BEFORE, 2 * seed + 2)})
    assert not any(each.has_moved for each in found.shifts[0])
    assert not any("the linear structure moved" in text for text in found.warnings)


def test_modes_that_change_their_order_are_paired_by_shape():
    # The second mode falls below the first one.
    crossed = change(np.array([1.0, 1.0, 41.5 / 63.0, 1.0]), order=(0, 2, 1, 3))
    crossed = LinearModes([0.0, 40.0, 42.5, 91.0], crossed.damping_ratio, crossed.shapes, SENSORS)
    before = LinearModes([0.0, 40.0, 42.0, 91.0], BEFORE.damping_ratio, BEFORE.shapes, SENSORS)
    (shifts,) = compare_stages({"one": find(before), "two": find(crossed, 2)}).shifts
    assert [each.number for each in shifts] == [2, 1, 3]


def test_a_mode_without_a_like_one_has_no_numbers():
    far = change(np.array([1.0, 1.0, 1.3, 1.0]))
    found = compare_stages({"one": find(BEFORE), "two": find(far, 2)})
    lost = found.shifts[0][1]
    assert (lost.number, lost.mac, lost.frequency) == (None, None, Estimate())
    assert any("mode(s) 2 of 'one' have no like mode at 'two'" in text for text in found.warnings)


def test_stages_share_sensors():
    few = change(sensors=("tip", "side"))
    (shifts,) = compare_stages({"one": find(BEFORE), "two": find(few, 2)}).shifts
    assert [each.number for each in shifts] == [1, 2, 3]
    with pytest.raises(InputError, match="name the stage of each log, at least two"):
        compare_stages({"one": find(BEFORE)})
    other = LinearModes(few.frequency_hz, few.damping_ratio, few.shapes, ("tip", "side"))
    renamed = LinearModes(other.frequency_hz, other.damping_ratio, other.shapes, ("tip", "end"))
    assert compare_stages({"one": find(BEFORE), "two": find(renamed, 2)}).shifts[0][0].mac == pytest.approx(1.0)


def test_the_command_writes_the_modes_of_each_stage(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    moved = change(np.array([1.0, 0.97, 1.0, 1.0]))
    for name, modes, seed in (("a", BEFORE, 0), ("b", BEFORE, 1), ("c", moved, 2)):
        write_log(ring(modes, seed), tmp_path / f"{name}.csv")
    words = ("a.csv", "b.csv", "c.csv", "--drive-point", "tip", "--force-channel", "hammer", "--band", "25", "115")
    stages = ("--stage", "$x$", "--stage", "$x$", "--stage", "shaken")
    done = opid("modes", *words, *stages, "--out", "found", "--png")
    assert done.exit_code == 0, done.output
    assert "Changes since $x$" in done.stdout
    for number, modes in ((1, BEFORE), (2, moved)):
        written = read_modes(tmp_path / "found" / f"modes_{number}.csv")
        np.testing.assert_allclose(written.frequency_hz, modes.frequency_hz[1:], rtol=1e-3)
    assert (tmp_path / "found" / "stages.png").exists()
    assert "--stage" in (tmp_path / "found" / "report.html").read_text(encoding="utf-8")
    refused(
        opid("modes", *words, "--stage", "one"), "--stage is given 1 times for 3 logs: give it once for each of them"
    )
    one = ("--stage", "one") * 3
    refused(opid("modes", *words, *one), "there is one stage, 'one': name the stage of each log, at least two")
