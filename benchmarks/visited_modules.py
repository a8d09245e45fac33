"""Which modules of the suspensions wing a recording visits from `identify` to the answer, and which are imported.

Run `python benchmarks/visited_modules.py`; `--aircraft` for a rigid body on three gears (slow: it is traced), `--law
arctan_velocity` for a law that is given. A module is visited if a function of it runs in an identification; the first
one, which imports and compiles, does not count, nor does what numba has compiled. What is imported is told by a fresh
process that reads a study from files and identifies it with the default method.
"""

import argparse
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType

from estimator import AnyStudy, identify
from worlds import WORLDS

import opid

PACKAGE = Path(opid.__file__).parent
WING = "suspensions"


def visited_by(call: Callable[[], object]) -> set[str]:
    """Return the modules of opid whose functions run during a call, as names below opid."""
    files: set[str] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            files.add(frame.f_code.co_filename)

    sys.setprofile(note)
    try:
        call()
    finally:
        sys.setprofile(None)
    return {module_name(Path(file)) for file in files if Path(file).is_relative_to(PACKAGE)}


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported_by_identify(*, aircraft: bool, law: str | None) -> set[str]:
    """Return the modules of opid that a process has loaded once it has identified a study, as names below opid."""
    code = (
        "import sys; from opid import identify, read_study; "
        "identify(read_study(sys.argv[1]), law=sys.argv[2] or None); "
        "print(*[name for name in sys.modules if name.startswith('opid.')])"
    )
    with TemporaryDirectory() as folder:
        simulate = ["-m", "opid", "simulate", "aircraft" if aircraft else "taxi", folder]
        subprocess.run([sys.executable, *simulate], check=True, capture_output=True)
        told = subprocess.run(
            [sys.executable, "-c", code, f"{folder}/study.toml", law or ""], check=True, capture_output=True, text=True
        )
    return {name.removeprefix("opid.") for name in told.stdout.split()}


def a_study(*, aircraft: bool) -> AnyStudy:
    if not aircraft:
        return WORLDS["nominal"].study(0)[0]
    # it imports what only its own figures need
    from aircraft_figures import ROWS, study_of

    return study_of(0, ROWS["independent"])[1]


def report(what: str, names: set[str]) -> None:
    own = sorted(name for name in names if name.split(".")[0] == WING)
    others = sorted(names - set(own))
    print(f"{what}: {len(own)} modules of {WING}, {len(others)} others of opid")
    print(f"  {WING}: {', '.join(name.removeprefix(WING + '.') for name in own)}")
    print(f"  others: {', '.join(others)}\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--aircraft", action="store_true", help="three gears of an aircraft")
    parser.add_argument("--law", help="given; searched where left out")
    options = parser.parse_args()
    study = a_study(aircraft=options.aircraft)
    identify(study, law=options.law)
    report("visited by an identification", visited_by(lambda: identify(study, law=options.law)))
    report("imported by one", imported_by_identify(aircraft=options.aircraft, law=options.law))


if __name__ == "__main__":
    main()
