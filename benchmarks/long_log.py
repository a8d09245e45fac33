"""Logs larger than memory: time and memory of `inspect`, and from the files to an identification.

Run `python benchmarks/long_log.py`, or with `--hours 0.1` for a quick look. Two logs of 6 channels at 5 kHz (heavy and
light aircraft: idling, a taxi run of known truth, standstill; a dropout, clipped bumps, a held value, spikes and
mains) are written to a temporary directory at a quarter, a half and the whole of the length as HDF5, and at an eighth
as CSV. Every figure comes from a fresh process; plainly reading means slices by h5py, or pandas' C parser. Before each,
the files are dropped from the system's cache where it lets one (Linux), so that they are read from the disk; `--cached`
leaves them there, and the ratios are then to copying memory. `runs` is from both files to the two runs that are found
in them, `identify` the whole way, most of which does not depend on the length.
"""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from harness import table_head, table_row
from tqdm import tqdm

if TYPE_CHECKING:
    from opid.suspensions.study import Study

FS, TAXI_S, BEGIN, BLOCK_ROWS = 5000.0, 60.0, 0.3, 1 << 17
CHANNELS = ("lower_z", "upper_z", "lower_x", "upper_x", "lower_y", "upper_y")
MASS_REMOVED_KG, NOISE, RANGE, GRAVITY = 220.0, 0.02, 50.0, 9.80665
LENGTHS = ((".h5", 0.25), (".h5", 0.5), (".h5", 1.0), (".csv", 0.125))
BYTES_PER_ROW = {".h5": 48, ".csv": 64}


# ---- the logs ----------------------------------------------------------------------------------------


def taxi_runs(n_taxi: int, seed: int) -> list[np.ndarray]:
    """Simulate the heavy and the light run: (n_taxi, 6) m/s^2 each."""
    from opid.virtual.taxi_tests.airframe import LandingGear
    from opid.virtual.taxi_tests.sensors import Sensor
    from opid.virtual.taxi_tests.taxiing import taxi_run

    heavy = LandingGear()
    light = replace(heavy, sprung_mass_kg=heavy.sprung_mass_kg - MASS_REMOVED_KG)
    runs = []
    for gear, rng in zip((heavy, light), np.random.default_rng(seed).spawn(2), strict=True):
        silent = Sensor(noise_m_per_s2=0.0)  # the noise of the whole record is added to it
        how = {"duration_s": n_taxi / FS, "fs": FS, "fore_aft": True, "lower_sensor": silent, "upper_sensor": silent}
        how |= {"speed_m_per_s": (18.0, 6.0)}
        run = taxi_run(gear, rng=rng, **how).recording
        columns = [run.channel(name) for name in CHANNELS[:4]]
        # sideways much as fore and aft, at other times
        runs.append(np.stack([*columns, columns[2][::-1], columns[3][::-1]], axis=1))
    return runs


def blocks(taxi: np.ndarray, n: int, rng: np.random.Generator) -> Iterator[tuple[int, np.ndarray]]:
    """Yield first row and samples (rows, 6), m/s^2, of a record in which the taxi run begins at 30 %."""
    begin, second = round(BEGIN * n), round(FS)
    bumps, held, lost = round(0.7 * n), round(0.8 * n), round(0.1 * n)
    for first in range(0, n, BLOCK_ROWS):
        rows = np.arange(first, min(first + BLOCK_ROWS, n))
        samples = NOISE * rng.standard_normal((rows.size, 6), dtype=np.float32).astype(np.float64)
        idling = rows < begin
        samples[idling] += 0.01 * taxi[rows[idling] % len(taxi)]
        rolling = (rows >= begin) & (rows < begin + len(taxi))
        samples[rolling] += taxi[rows[rolling] - begin]
        samples[:, :2] += GRAVITY
        phase = 2 * np.pi * 50.0 * rows / FS
        samples[:, 3] += 0.03 * np.sin(phase) + 0.01 * np.sin(3 * phase)

        bump = (rows >= bumps) & (rows < bumps + 2 * second)
        samples[bump, 2] += 80.0 * np.sin(2 * np.pi * 3.0 * (rows[bump] - bumps) / FS)
        np.clip(samples[:, 2], -RANGE, RANGE, out=samples[:, 2])
        samples[(rows >= held) & (rows < held + second), 3] = 0.1
        samples[(rows >= lost) & (rows < lost + second), 5] = np.nan
        samples[rows % (n // 20) == n // 40, 4] += 30.0
        yield first, samples


def write_hdf5(path: Path, n: int, content: Iterator[tuple[int, np.ndarray]]) -> None:
    """Write a log as a logger would, block by block."""
    import h5py

    with h5py.File(path, "w") as file:
        file.attrs["fs"] = FS
        dataset = file.create_dataset("samples", (n, 6), dtype="f8")
        dataset.attrs["names"], dataset.attrs["units"] = list(CHANNELS), ["m/s^2"] * 6
        for first, samples in content:
            dataset[first : first + len(samples)] = samples


def write_csv(path: Path, n: int, content: Iterator[tuple[int, np.ndarray]]) -> None:
    """Write a log as text with time stamps, four decimals."""
    import pyarrow as pa
    from pyarrow import csv

    names = ["time [s]", *(f"{name} [m/s^2]" for name in CHANNELS)]
    schema = pa.schema([(name, pa.float64()) for name in names])
    with csv.CSVWriter(path, schema, write_options=csv.WriteOptions(quoting_style="none")) as file:
        for first, samples in content:
            stamps = np.round((first + np.arange(len(samples))) / FS, 4)
            columns = [stamps, *np.round(samples, 4).T]
            file.write_table(pa.table([pa.array(column) for column in columns], schema=schema))


def write(paths: list[Path], n: int) -> str:
    """Write the heavy and the light log."""
    n_taxi = min(round(TAXI_S * FS), n * 3 // 8)
    for seed, (path, taxi) in enumerate(zip(paths, taxi_runs(n_taxi, seed=1), strict=True)):
        content = blocks(taxi, n, np.random.default_rng(seed))
        shown = tqdm(content, path.name, -(-n // BLOCK_ROWS), unit="block", disable=None, leave=False)
        (write_hdf5 if path.suffix == ".h5" else write_csv)(path, n, shown)
    return ""


# ---- what is measured, each in a process of its own ----------------------------------------------------


def read(paths: list[Path], n: int) -> str:
    """Plainly read the first log."""
    if paths[0].suffix == ".h5":
        import h5py

        with h5py.File(paths[0]) as file:
            rows = sum(len(file["samples"][first : first + BLOCK_ROWS]) for first in range(0, n, BLOCK_ROWS))
    else:
        import pandas as pd

        rows = sum(len(part) for part in pd.read_csv(paths[0], chunksize=BLOCK_ROWS))
    assert rows == n
    return ""


def inspect(paths: list[Path], n: int) -> str:
    """Inspect the first log."""
    from opid.signals.health.inspection import inspect as inspect_log
    from opid.signals.logs import open_log

    health = inspect_log(open_log(paths[0]))
    assert health.n_samples == n
    kinds = sorted({stretch.kind for channel in health.channels for stretch in channel.stretches})
    lines = sorted({line.name for channel in health.channels for line in channel.lines if line.name})
    return f"found: {', '.join((*kinds, *lines)) or 'nothing'}"


def runs(paths: list[Path], n: int) -> str:
    """Both logs to the runs that are found in them."""
    spans = []
    for run in study_of(paths).runs:
        record = run.recording
        spans.append(f"{record.start_s:.1f} to {record.start_s + record.duration_s:.1f} s at {record.fs:g} Hz")
    return f"found {'; '.join(spans)}; rolling from {BEGIN * n / FS:.1f} s on"


def identify(paths: list[Path], n: int) -> str:
    """Both logs to an identification."""
    from opid.suspensions.identification import identify

    result = identify(study_of(paths))
    mass = result.parameters.sprung_mass_kg
    return f"mass {result.not_determined if mass.value is None else f'{mass.value:.0f} kg'} (true 1850 kg)"


def study_of(paths: list[Path]) -> "Study":
    """Read both logs."""
    from opid.studies.suspension_study import study_from_logs

    return study_from_logs(paths, sprung="upper_z", unsprung="lower_z", mass_changes_kg=[-MASS_REMOVED_KG])


TASKS: dict[str, Callable[[list[Path], int], str]] = {
    "write": write,
    "read": read,
    "inspect": inspect,
    "runs": runs,
    "identify": identify,
}


def drop_from_cache(path: Path) -> None:
    """Let the system forget a file's content, so that the next to read it waits for the disk."""
    if hasattr(os, "posix_fadvise"):
        with path.open("rb") as file:
            os.fsync(file.fileno())
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def measured(task: str, paths: list[Path], n: int) -> dict[str, float | str]:
    """Run a task in a fresh process: seconds without the start of Python (and those of
    the processor, which other work on the machine does not lengthen), peak memory in MiB, words."""
    command = [sys.executable, __file__, "--task", task, "--rows", str(n), *map(str, paths)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout)


def perform(task: str, paths: list[Path], n: int) -> None:
    """Do a task in this process and print what it cost as JSON, the process that reads the files included."""
    begin, cpu = time.perf_counter(), sum(os.times()[:4])
    words = TASKS[task](paths, n)
    seconds = time.perf_counter() - begin
    # kibibytes on Linux, bytes on macOS
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
    peak_mib += sum(map(peak_of, readers()))
    if (apart := sys.modules.get("opid.signals.logs.apart")) is not None:
        apart.end_processes()  # what they took of the processor is known then
    cpu_s = sum(os.times()[:4]) - cpu
    print(json.dumps({"seconds": seconds, "cpu_s": cpu_s, "peak_mib": peak_mib, "words": words}))


def readers() -> list[str]:
    """Return the numbers of the processes that this one has started, where the system tells (Linux)."""
    listed = Path(f"/proc/self/task/{os.getpid()}/children")
    return listed.read_text().split() if listed.exists() else []


def peak_of(process: str) -> float:
    """Return the peak memory of a process, MiB."""
    status = Path(f"/proc/{process}/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 2**10


# ---- the table ---------------------------------------------------------------------------------------


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=2.0, help="length of each log")
    parser.add_argument("--where", type=Path, help="directory for the logs, which are taken away again")
    parser.add_argument("--cached", action="store_true", help="leave the logs in the system's cache")
    parser.add_argument("--task", choices=TASKS, help=argparse.SUPPRESS)
    parser.add_argument("--rows", type=int, help=argparse.SUPPRESS)
    parser.add_argument("paths", nargs="*", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.task:
        perform(options.task, options.paths, options.rows)
        return

    whole = round(options.hours * 3600 * FS)
    with tempfile.TemporaryDirectory(dir=options.where) as directory:
        needed = 2.5 * whole * BYTES_PER_ROW[".h5"]
        if shutil.disk_usage(directory).free < needed:
            parser.error(f"{directory} has no room for {needed / 2**30:.1f} GiB: give --where or fewer --hours")
        titles = ("log", "hours", "MiB", "task", "time, s", "of the processor, s", "over plainly reading")
        print(table_head(*titles, "peak memory, MiB"))
        told = []
        for ending, part in tqdm(LENGTHS, unit="length", disable=None):
            n = round(part * whole)
            paths = [Path(directory, f"{name}{ending}") for name in ("heavy", "light")]
            measured("write", paths, n)
            size = paths[0].stat().st_size / 2**20
            plain_s = 0.0
            for task, n_logs in (("read", 1), ("inspect", 1), ("runs", 2), ("identify", 2)):
                for path in () if options.cached else paths:
                    drop_from_cache(path)
                cost = measured(task, paths, n)
                plain_s = plain_s or float(cost["seconds"])
                over = float(cost["seconds"]) / (n_logs * plain_s)
                cells = [ending, f"{n / FS / 3600:.3g}", f"{n_logs * size:.0f}", task, f"{cost['seconds']:.2f}"]
                cells += [f"{cost['cpu_s']:.2f}", f"{over:.1f}", f"{cost['peak_mib']:.0f}"]
                print(table_row(*cells), flush=True)
                told += [f"{ending}, {n / FS / 3600:.3g} h, {task}: {cost['words']}"] if cost["words"] else []
            for path in paths:
                path.unlink()
        print("\n" + "\n".join(told))


if __name__ == "__main__":
    main()
