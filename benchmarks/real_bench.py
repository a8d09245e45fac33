"""`opid law` on measured dampers, joints and structures: the law, what it explains, and the energy that a cycle takes.

Run `python benchmarks/real_bench.py ../shared/data [friction mr cyclic rack]`. The records are those of the README in
that folder; they are not part of the project. docs/real_records.md says what comes out.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from opid.signals.log_settings import LogSettings
from opid.signals.logs import read_log
from opid.signals.recording import Channel, Recording
from opid.signals.resampling import on_common_clock
from opid.suspensions.bench.law import BenchLaw, law_of_bench
from opid.suspensions.bench.record import Bench, bench_from_recording, quasi_static_bench

INCH_M, KIP_N = 0.0254, 4448.2216
FRICTION_HZ, MR_HZ = 1024.0, 3004.8
# the damper answers a step of the voltage within about this time
SETTLED_S = 0.02
HEAD = "| record | law | explained, % | without memory, % | energy a cycle, J | as dry friction, N | s |"


def recording_of(columns: dict[str, tuple[np.ndarray, str]], fs: float) -> Recording:
    """Return a recording of columns with their units."""
    channels = tuple(Channel(name, unit) for name, (_, unit) in columns.items())
    return Recording(np.stack([values for values, _ in columns.values()], axis=1), fs=fs, channels=channels)


def friction_records(folder: Path) -> dict[str, Bench]:
    """Return the records of the friction damper by their name: frequency, tension of the band, amplitude; SI units."""
    benches = {}
    with np.load(folder / "friction_damper_brfd/brfd.npz") as file:
        for name in file:
            table = file[name].astype(np.float64)
            columns = {
                "force": (table[:, 2] * KIP_N, "N"),
                "travel": (table[:, 1] * INCH_M, "m"),
                "velocity": (table[:, 3] * INCH_M, "m/s"),
            }
            record = recording_of(columns, FRICTION_HZ)
            short = name.split("__")[-1].removesuffix("amplitude")
            benches[short] = bench_from_recording(record, force="force", travel="travel", velocity="velocity")
    return benches


def tested(name: str) -> tuple[float, float, float] | None:
    """Return frequency (Hz), tension (lb) and amplitude (in) that a record of the friction damper is named after.

    >>> tested("0.25Hz30lbtension1.5"), tested("KocaeliMCE")
    ((0.25, 30.0, 1.5), None)
    """
    found = re.fullmatch(r"([\d.]+)Hz([\d.]+)lbtension([\d.]+)", name)
    return None if found is None else (float(found[1]), float(found[2]), float(found[3]))


def mr_records(folder: Path) -> dict[str, Bench]:
    """Return the magneto-rheological damper: all samples, and those where a voltage has been held for 20 ms."""
    with np.load(folder / "mr_damper/random_first_half.npz") as file:
        data = {name: file[name].astype(np.float64).ravel() for name in file}
    columns = {
        "force": (data["F"], "N"),
        "travel": (data["D"] / 100, "m"),
        "velocity": (data["V"] / 100, "m/s"),
    }
    record = recording_of(columns, MR_HZ)
    middle = 0.5 * (data["Y"].min() + data["Y"].max())
    is_on = data["Y"] > middle
    changed = np.flatnonzero(np.diff(is_on)) + 1
    since = np.zeros(is_on.size, dtype=np.int64)
    since[changed] = changed
    settled = (np.arange(is_on.size) - np.maximum.accumulate(since)) / MR_HZ > SETTLED_S
    names = {"force": "force", "travel": "travel", "velocity": "velocity"}
    told = {"voltage on": is_on & settled, "voltage off": ~is_on & settled, "voltage not told": None}
    return {name: bench_from_recording(record, counted=counted, **names) for name, counted in told.items()}


def cyclic_records(folder: Path) -> dict[str, Bench]:
    """Return the slow cyclic tests of columns, walls and joints, without time."""
    benches = {}
    for path in sorted((folder / "cyclic_tests").glob("*.csv")):
        record = read_log(path, LogSettings(fs_hz=1.0))
        benches[path.stem] = quasi_static_bench(record, force="force_kN", travel="displacement_mm")
    return benches


def rack_records(folder: Path) -> dict[str, Bench]:
    """Return the stroke of a rack, force and speed of two recorders taken to have begun together."""
    motion = np.genfromtxt(folder / "rack_and_pinion/a3MR.csv", delimiter=",", skip_header=5)
    pull = np.genfromtxt(folder / "rack_and_pinion/a3NI.csv", delimiter=",", skip_header=4, encoding="utf-8-sig")
    speed, fs = motion[:, 1] / 60 * 0.020, 1000 * (len(motion) - 1) / (motion[-1, 0] - motion[0, 0])
    columns = {"travel": (np.cumsum(speed) / fs, "m"), "velocity": (speed, "m/s")}
    parts = [recording_of(columns, fs), recording_of({"force": (200.0 * pull[:, 1], "N")}, 2000.0)]
    names = {"force": "force", "travel": "travel", "velocity": "velocity"}
    return {"a3": bench_from_recording(on_common_clock(parts), **names)}


SETS = {"friction": friction_records, "mr": mr_records, "cyclic": cyclic_records, "rack": rack_records}


def row_of(name: str, found: BenchLaw, seconds: float) -> str:
    """Return a line of the table."""
    energy, friction = found.cycle.area_j, found.cycle.friction_n
    ends = "" if energy.interval95 is None else f" ({energy.interval95[0]:.4g} to {energy.interval95[1]:.4g})"
    taken = ("-", "-") if energy.value is None else (f"{energy.value:.4g}{ends}", f"{friction.value:.4g}")
    without = 100 * found.memory.r2_at_most
    return (
        f"| {name} | `{found.law.name}` | {100 * found.r2_left_out:.1f} | {without:.1f} | "
        f"{taken[0]} | {taken[1]} | {seconds:.1f} |"
    )


def rows(folder: Path, wanted: list[str]) -> Iterator[str]:
    """Yield the tables, line by line."""
    for each in wanted or SETS:
        yield from ("", f"{each}:", "", HEAD, "|---|---|---|---|---|---|---|")
        for name, bench in SETS[each](folder).items():
            begun = time.process_time()
            found = law_of_bench(bench, title=name)
            yield row_of(name, found, time.process_time() - begun)


if __name__ == "__main__":
    for line in rows(Path(sys.argv[1]), sys.argv[2:]):
        print(line, flush=True)
