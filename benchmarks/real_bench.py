"""`opid law` on measured dampers, joints and structures: the law, what it explains, and the energy that a cycle takes.

Run `python benchmarks/real_bench.py ../shared/data [friction mr cyclic rack]`. The studies of the dampers are the files
in `examples/real_records`; the records are not part of the project. docs/real_records.md says what comes out.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
from harness import table_head, table_row

import opid
from opid.signals.log import LogSettings
from opid.signals.logs import read_log
from opid.signals.resampling import on_common_clock
from opid.suspensions.bench.law import BenchLaw, law_of_bench
from opid.suspensions.bench.record import Bench, bench_from_recording, quasi_static_bench

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
from real_records import read_set, records_in

TITLES = ("record", "law", "explained, %", "without memory, %", "energy a cycle, J", "as dry friction, N", "s")


def studies_of(name: str, data: Path) -> dict[str, opid.suspensions.BenchStudy]:
    """Return the study of each record of a set."""
    return {each: read_set(name, data, (each,)) for each in records_in(name, data)}


def tested(name: str) -> tuple[float, float, float] | None:
    """Return frequency (Hz), tension (lb) and amplitude (in) that a record of the friction damper is named after.

    >>> tested("0.25Hz30lbtension1.5"), tested("KocaeliMCE")
    ((0.25, 30.0, 1.5), None)
    """
    found = re.fullmatch(r"([\d.]+)Hz([\d.]+)lbtension([\d.]+)", name)
    return None if found is None else (float(found[1]), float(found[2]), float(found[3]))


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
    columns = [np.cumsum(speed) / fs, speed]
    parts = [
        opid.signals.recording_from_arrays(columns, ["travel", "velocity"], fs=fs, unit=["m", "m/s"]),
        opid.signals.recording_from_arrays([200.0 * pull[:, 1]], ["force"], fs=2000.0, unit="N"),
    ]
    names = {"force": "force", "travel": "travel", "velocity": "velocity"}
    return {"a3": bench_from_recording(on_common_clock(parts), **names)}


SETS = {
    "friction": partial(studies_of, "friction_damper_brfd"),
    "mr": partial(studies_of, "mr_damper"),
    "cyclic": cyclic_records,
    "rack": rack_records,
}


def row_of(name: str, found: BenchLaw, seconds: float) -> str:
    """Return a line of the table."""
    energy, friction = found.cycle.area_j, found.cycle.friction_n
    ends = "" if energy.interval95 is None else f" ({energy.interval95[0]:.4g} to {energy.interval95[1]:.4g})"
    taken = ("-", "-") if energy.value is None else (f"{energy.value:.4g}{ends}", f"{friction.value:.4g}")
    without = 100 * found.memory.r2_at_most
    explained = f"{100 * found.r2_left_out:.1f}", f"{without:.1f}"
    return table_row(name, f"`{found.law.name}`", *explained, *taken, f"{seconds:.1f}")


def rows(folder: Path, wanted: list[str]) -> Iterator[str]:
    """Yield the tables, line by line."""
    for each in wanted or SETS:
        yield from ("", f"{each}:", "", table_head(*TITLES))
        for name, bench in SETS[each](folder).items():
            begun = time.process_time()
            found = law_of_bench(bench, title=name)
            yield row_of(name, found, time.process_time() - begun)


if __name__ == "__main__":
    for line in rows(Path(sys.argv[1]), sys.argv[2:]):
        print(line, flush=True)
