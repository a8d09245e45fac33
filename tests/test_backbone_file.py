"""Backbones in CSV files: read back as written, units to SI, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from made_chain import DOFS, curve_of

from opid.errors import InputError
from opid.updating.measured import read_backbone, write_backbone


def written(tmp_path, text):
    path = tmp_path / "curve.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_backbone_is_read_back_to_the_last_bit(tmp_path):
    curve = curve_of(2)
    write_backbone(curve, tmp_path / "second.csv")
    back = read_backbone(tmp_path / "second.csv", mode=2, controlled_sensor="tip", sensors=DOFS)
    assert (back.name, back.mode, back.sensors) == ("second", 2, DOFS)
    np.testing.assert_array_equal(back.frequency_hz, curve.frequency_hz)
    np.testing.assert_array_equal(back.amplitude, curve.amplitude)


@pytest.mark.parametrize(
    ("unit", "order", "factor"),
    [("mm", 0, 1e3), ("µm", 0, 1e6), ("m/s", 1, 1.0), ("m/s^2", 2, 1.0), ("g", 2, 1 / 9.80665)],
)
def test_any_unit_of_motion_becomes_metres(tmp_path, unit, order, factor):
    curve = curve_of()
    values = factor * curve.amplitude * (2 * np.pi * curve.frequency_hz[:, None]) ** order
    rows = "\n".join(",".join(map(repr, map(float, row))) for row in np.column_stack([curve.frequency_hz, values]))
    path = written(tmp_path, f"Frequency [Hz],a ({unit}),b [{unit}],c [{unit}],tip [{unit}]\n{rows}\n")
    back = read_backbone(path, mode=1, controlled_sensor="tip")
    np.testing.assert_allclose(back.amplitude, curve.amplitude, rtol=1e-14)
    bare = written(tmp_path, f"freq,a,b,c,tip\n{rows}\n")
    told = read_backbone(bare, mode=1, controlled_sensor="tip", unit=unit)
    np.testing.assert_allclose(told.amplitude, curve.amplitude, rtol=1e-14)


def test_columns_come_in_the_order_of_the_sensors_and_forces_are_left_out(tmp_path):
    path = written(tmp_path, "# test 3\ntip [mm];omega;force [N];a [mm]\n0,1;90,5;3,1;0,2\n1;91;4;0,3\n2;92;5;0,4\n")
    back = read_backbone(path, mode=1, controlled_sensor="tip", sensors=DOFS)
    assert back.sensors == ("a", "tip")
    np.testing.assert_allclose(back.frequency_hz, np.array([90.5, 91, 92]) / (2 * np.pi))
    np.testing.assert_allclose(back.amplitude, [[2e-4, 1e-4], [3e-4, 1e-3], [4e-4, 2e-3]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "one column"),
        ("tip,a\n1,2\n", "no column of frequencies"),
        ("f,frequency_hz,tip\n1,1,2\n", "2 columns of frequencies"),
        ("f [s],tip\n1,2\n", "give them in Hz"),
        ("f,tip\n1,2\n2,x\n", "line 3 has 'x'"),
        ("f,tip\n1,2\n2\n", "line 3 has 1 cells"),
        ("f,tip [kg]\n1,2\n2,3\n3,4\n", "give a unit of motion"),
        ("f,tip [mm]\n1,2\n0,3\n3,4\n", "frequency of row 2 is not positive"),
        ("f,tip [mm],tpi [mm]\n1,2,3\n", "'tpi [mm]' is not a sensor of the structure: did you mean 'tip'"),
        ("f,tip [mm],tip [m]\n1,2,3\n", "two columns"),
        ("f,force [N]\n1,2\n", "no column of a sensor"),
        ("f,tip\n14,0.2\n15,1\n16,4\n", "reaches 4 m, because no unit is stated"),
        ("f,tip [m]\n14,0.2\n15,1\n16,4\n", "reaches 4 m, in the stated unit"),
        ("f,tip [mm]\n14,1\n15,2\n", "has 2 point(s): give at least 3"),
        ("f,tip [mm]\n14,1\n15,3\n16,2\n", "does not grow at point 3"),
        ("f,tip [mm]\n14,1\n15,\n16,2\n", "not finite"),
    ],
)
def test_a_file_that_is_no_backbone_is_refused(tmp_path, text, words):
    with pytest.raises(InputError) as caught:
        read_backbone(written(tmp_path, text), mode=1, controlled_sensor="tip", sensors=DOFS)
    assert words in str(caught.value)
    assert "curve.csv" in str(caught.value)


def test_a_sensor_that_cannot_head_a_column_is_not_written(tmp_path):
    curve = replace(curve_of(), sensors=("a", "b", "f", "tip"))
    with pytest.raises(InputError, match="'f' cannot be the name of a column"):
        write_backbone(curve, tmp_path / "x.csv")


@pytest.mark.parametrize("unit", ["mm", "cm", "in"])
def test_metres_called_millimetres_are_refused_with_a_hint(tmp_path, unit):
    path = written(tmp_path, f"f,tip [{unit}]\n14,0.00001\n15,0.00005\n16,0.0001\n")
    with pytest.raises(InputError, match=f"reaches 0.0001 {unit}, .* micrometres: if the numbers are metres"):
        read_backbone(path, mode=1, controlled_sensor="tip")


def test_motions_that_are_small_are_taken_in_their_unit(tmp_path):
    for unit, factor in (("µm", 1e-6), ("m", 1.0)):
        rows = "\n".join(f"{14 + k},{value / factor}" for k, value in enumerate((1e-7, 2e-7, 4e-7)))
        found = read_backbone(written(tmp_path, f"f,tip [{unit}]\n{rows}\n"), mode=1, controlled_sensor="tip")
        np.testing.assert_allclose(found.controlled_amplitude, [1e-7, 2e-7, 4e-7])
