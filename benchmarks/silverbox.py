"""The measured Duffing circuit: a law from its first part, the growing noise, predicts the rest, the multisines.

Run `python benchmarks/silverbox.py SNLS80mV.csv`. The file is that of the public benchmark of Wigren and Schoukens
(2013), columns V1 (input) and V2 (output), 610.35 Hz; it is not part of the project.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from harness import table_head
from scipy import fft
from scipy.signal.windows import tukey

from opid.modal.forced.mode_fit import fit_mode
from opid.modal.identification import make_model
from opid.modal.linear.modes import LinearModes, ModalTest, modal_test
from opid.modal.model import NonlinearModalModel, modal_response
from opid.signals.recording import Channel, Recording

FS = 1e7 / 2**14
LINEAR, FIRST, REST = slice(0, 8000), slice(0, 40000), slice(45000, 127000)
"""Samples: the quiet beginning, for the linear mode; the growing noise, for the law; the multisines, to predict."""

BAND_HZ, TOP_HZ = (30.0, 130.0), 280.0


def read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return input and output, V, without the offsets that they have at rest."""
    table = np.genfromtxt(path, delimiter=",", skip_header=1)[:, :2]
    return tuple(column - np.median(column[-2000:]) for column in table.T)  # type: ignore[return-value]


def derivatives(output: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return first and second derivative below 280 Hz."""
    frequency = fft.rfftfreq(output.size, 1 / FS)
    spectrum = np.where(frequency < TOP_HZ, fft.rfft(output), 0.0)
    j_omega = 2j * np.pi * frequency
    return fft.irfft(spectrum * j_omega, output.size), fft.irfft(spectrum * j_omega**2, output.size)


def linear_mode(force: np.ndarray, output: np.ndarray) -> LinearModes:
    """Return the mode of the quiet beginning, where m y'' + c y' + k y = u holds."""
    velocity, acceleration = derivatives(output)
    fade = tukey(LINEAR.stop, 0.2)
    frequency = fft.rfftfreq(LINEAR.stop, 1 / FS)
    band = (frequency > BAND_HZ[0]) & (frequency < BAND_HZ[1])
    columns = np.stack([fft.rfft(fade * each[LINEAR])[band] for each in (acceleration, velocity, output)], axis=1)
    scale = np.linalg.norm(columns, axis=0)
    right = fft.rfft(fade * force[LINEAR])[band]
    stacked = np.concatenate([columns.real, columns.imag]) / scale
    m, c, k = np.linalg.lstsq(stacked, np.concatenate([right.real, right.imag]), rcond=None)[0] / scale
    return LinearModes([np.sqrt(k / m) / (2 * np.pi)], [c / (2 * np.sqrt(k * m))], [[1 / np.sqrt(m)]], ("output",))


def first_part(force: np.ndarray, output: np.ndarray, modes: LinearModes) -> ModalTest:
    """Return the growing noise as a test, the volts of the input as N."""
    _, acceleration = derivatives(output)
    channels = (Channel("input", "N"), Channel("output", "m/s^2"))
    recording = Recording(np.stack([force[FIRST], acceleration[FIRST]], axis=1), fs=FS, channels=channels)
    return modal_test(recording, modes, name="growing noise", force="input", drive_point="output")


def simulated(model: NonlinearModalModel, force: np.ndarray) -> np.ndarray:
    """Return the output that a model makes of the whole input, V."""
    return modal_response(model, force, fs=FS, drive_point="output").displacement[:, 0] * model.modes.shapes[0, 0]


def errors_mv(path: Path, stiffness_order: int, damping_order: int) -> tuple[float, float, float]:
    """Return rms errors of the nonlinear and of the linear model on the multisines, and the rms of the output, mV."""
    force, output = read(path)
    modes = linear_mode(force, output)
    fit = fit_mode(
        [first_part(force, output, modes)],
        1,
        stiffness_order=stiffness_order,
        damping_order=damping_order,
        free_linear=True,
        band_hz=BAND_HZ,
        taper_s=1.0,
    )
    models = (make_model(modes, [fit]), NonlinearModalModel(modes))
    errors = [1e3 * float(np.sqrt(np.mean((simulated(model, force) - output)[REST] ** 2))) for model in models]
    return errors[0], errors[1], 1e3 * float(np.sqrt(np.mean(output[REST] ** 2)))


def silverbox_rows(path: Path) -> Iterator[str]:
    """Yield the rows of the table."""
    for orders in ((1, 1), (3, 1), (3, 3), (5, 3)):
        nonlinear, linear, rms = errors_mv(path, *orders)
        yield (
            f"| Silverbox, N_s = {orders[0]}, N_d = {orders[1]} | simulation error on the multisines, mV rms | "
            f"{nonlinear:.3f} (linear {linear:.2f}, output {rms:.2f}) |"
        )


if __name__ == "__main__":
    print(table_head("case", "figure", "value"))
    print("\n".join(silverbox_rows(Path(sys.argv[1]))))
