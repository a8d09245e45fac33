"""What `opid identify` takes as a user starts it: the whole process, its page alone, and the first run of a machine.

    python benchmarks/whole_command.py [--repeats 5] [--roads 3]

Two runs of 40 s at 512 Hz of the usual gear are simulated on several roads. Each command is a process of its own that
searches the law. Times are those of the processor, with all that a process starts; medians over repeats and roads,
except the first run, which is done once with an empty folder for the compiled kernels. The page is written by a process
that has identified before; the libraries that only the page needs are loaded within its time. Beside them stands a
process that loads numpy, SciPy's optimization, numba and matplotlib and does nothing.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np
from harness import table_head, table_row

from opid.studies.study_file import write_study
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_study, taxi_test

LIBRARIES = "import numba, numpy, matplotlib.figure, scipy.optimize"
PAGE = """
import sys, time
import opid
result = opid.identify(opid.read_study(sys.argv[1]))
begin = time.process_time()
opid.write_report(result, sys.argv[2])
print(time.process_time() - begin)
"""


@dataclass
class Taken:
    """What processes of one kind took.

    Args:
        cpu_s: processor time of each, s.
        peak_mib: largest memory of a process, MiB.
    """

    cpu_s: list[float] = field(default_factory=list)
    peak_mib: float = 0.0

    def add(self, command: list[str], **variables: str) -> str:
        """Run a command, add what it took, and return what it printed."""
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(command, capture_output=True, text=True, env=os.environ | variables)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            raise SystemExit(f"{' '.join(command)} ended with {done.returncode}: {done.stderr}")
        self.cpu_s.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        self.peak_mib = after.ru_maxrss / 1024
        return done.stdout


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--roads", type=int, default=3)
    options = parser.parse_args()
    libraries, whole, page, first = Taken(), Taken(), Taken(), Taken()
    sizes: list[float] = []
    with TemporaryDirectory() as folder:
        studies = [_write_study(Path(folder), number) for number in range(options.roads)]
        for repeat in range(options.repeats + 1):
            for study in studies:
                out = study.parent / f"out_{repeat}"
                identify = [sys.executable, "-m", "opid", "identify", str(study), "--quiet", "--out"]
                kinds = (libraries, whole, page) if repeat else (Taken(), Taken(), Taken())
                kinds[0].add([sys.executable, "-c", LIBRARIES])
                kinds[1].add([*identify, str(out)])
                page_s = float(kinds[2].add([sys.executable, "-c", PAGE, str(study), f"{out}_page"]))
                kinds[2].cpu_s[-1] = page_s
                sizes.append((out / "report.html").stat().st_size / 1e6)
        with TemporaryDirectory() as empty:
            first.add([*identify, f"{out}_first"], NUMBA_CACHE_DIR=empty)
    reference = median(libraries.cpu_s)
    print(table_head("what", "processor time, s", "beside loading the libraries", "smallest to largest, s"))
    for what, taken in (
        ("loading the libraries", libraries),
        ("`opid identify`, law searched, with its page", whole),
        ("the page alone", page),
        ("the same command, first run of a machine", first),
    ):
        seconds = median(taken.cpu_s)
        ends = f"{min(taken.cpu_s):.2f} to {max(taken.cpu_s):.2f}"
        print(table_row(what, f"{seconds:.2f}", f"{seconds / reference:.2f}", ends))
    print(f"\ncompilation on a new machine: {median(first.cpu_s) - median(whole.cpu_s):.1f} s more")
    print(f"page: {median(sizes):.2f} MB; largest memory of a process: {whole.peak_mib:.0f} MiB")


def _write_study(folder: Path, number: int) -> Path:
    """Simulate two runs of the usual gear on the road of this number, and return the path of their study."""
    test = taxi_test(LandingGear(), rng=np.random.default_rng(number), duration_s=40.0, fs=512.0)
    path = folder / f"road_{number}" / "study.toml"
    path.parent.mkdir()
    write_study(taxi_study(test, title=f"Road {number}"), path)
    return path


if __name__ == "__main__":
    main()
