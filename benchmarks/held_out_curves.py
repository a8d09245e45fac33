"""The highest of several response curves by the law of the lower ones: its error over the shift of the resonance.

Run `python benchmarks/held_out_curves.py`; in parts `--seeds 2`, `--folder FOLDER`. Measured sets are those of a
folder, none dropped: every file ForcedFrequencyResponses.mat below it (Chen et al. 2022, Mechanical Systems and Signal
Processing 166, 108401; the repository mattiacenedese/BRBtesting has it), each with its curves at constant force and at
constant response. Their shape has no known scale, so it is found from the lower curves. The
shift is the range of the resonance over all curves; the way from the lowest curve is shorter where a resonance falls
and rises again. Virtual sets have five curves
of the cubic mode with 1 % noise, and seeds count from 0. Each set is written as a study file and read by
`opid resonance STUDY.toml --hold-out highest`.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from harness import table_head, table_row
from made_resonance import curves_study, with_shapes_scaled
from scipy.io import loadmat

from opid.errors import InputError, NotDeterminedError
from opid.modal.linear.modes import LinearModes
from opid.modal.resonance.curves import ResponseCurve
from opid.modal.resonance.identification import identify_resonance
from opid.modal.study import ModalStudy
from opid.studies.study_file import read_study, write_study

DATA = Path(__file__).parents[2] / "shared" / "data"
FILE = "ForcedFrequencyResponses.mat"
HEAD = (
    "set",
    "curves",
    "reach",
    "resonance, predicted [Hz]",
    "95 % interval",
    "measured",
    "shift [Hz]",
    "error over shift [%]",
    "over the way from the lowest curve [%]",
    "inside",
)


def read_sets(folder: Path) -> Iterator[tuple[str, ModalStudy]]:
    """Yield name and study of each measured set in a folder."""
    for path in sorted(folder.rglob(FILE)):
        content = loadmat(path, struct_as_record=False, squeeze_me=True)["FRdata"]
        for kind in content._fieldnames:
            curves = tuple(
                ResponseCurve(
                    name=f"level_{number}",
                    sensor="drive_point",
                    frequency_hz=np.ravel(each.frequency),
                    amplitude=np.ravel(each.amplitude),
                    # The file has the phase of the displacement, and the amplitude of the acceleration.
                    phase_deg=np.degrees(np.ravel(each.phase)) + 180.0,
                    force_n=np.ravel(each.force),
                )
                for number, each in enumerate(np.atleast_1d(getattr(content, kind)), start=1)
            )
            # Only the curves tell more than where the mode is.
            modes = LinearModes([80.4], [0.0015], [[1.0]], ("drive_point",))
            yield (
                f"{path.parent.name}, {kind}",
                ModalStudy(kind, modes, (1,), (), "drive_point", gain_tolerance=0.01, curves=curves),
            )


def run(name: str, study: ModalStudy, *, free_mass: bool) -> None:
    """Print the row of one set."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "study.toml")
        write_study(study, path)
        try:
            result = identify_resonance(read_study(path), hold_out="highest", free_mass=free_mass)
        except (InputError, NotDeterminedError) as error:
            print(table_row(name, len(study.curves), *["-"] * 7, str(error)), flush=True)
            return
    found = result.held_out
    if found is None or found.resonance_hz.value is None:
        reason = found.reason if found else result.not_determined
        print(table_row(name, len(study.curves), *["withheld"] * 7, reason), flush=True)
        return
    ends, measured = found.resonance_hz.interval95, float(found.measured_hz.value or np.nan)
    cells = [
        name,
        f"{len(study.curves)}",
        f"{found.reach:.2f}",
        f"{found.resonance_hz.value:.3f}",
        "-" if ends is None else f"{ends[0]:.3f} .. {ends[1]:.3f}",
        f"{measured:.3f}",
        f"{found.shift_hz:.3f}",
        f"{100 * found.error_fraction:+.1f}",
        f"{100 * (found.resonance_hz.value - measured) / abs(measured - found.lowest_hz):+.1f}",
        "no interval" if ends is None else "yes" if ends[0] <= measured <= ends[1] else "no",
    ]
    print(table_row(*cells), flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=DATA, help="where the measured sets are")
    parser.add_argument("--seeds", type=int, default=10)
    given = parser.parse_args()
    measured = list(read_sets(given.folder))
    print(f"{len(measured)} measured sets below {given.folder}, {given.seeds} virtual ones")
    print(table_head(*HEAD))
    for name, study in measured:
        run(name, study, free_mass=True)
    for seed in range(given.seeds):
        run(f"cubic, seed {seed}", curves_study(seed, 5), free_mass=False)
        run(
            f"cubic, shapes 1.3 times too large, seed {seed}", with_shapes_scaled(curves_study(seed, 5)), free_mass=True
        )


if __name__ == "__main__":
    main()
