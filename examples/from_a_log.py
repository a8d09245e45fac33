"""From the logs of taxi runs to mass, springs, damping, law and report.

    python examples/from_a_log.py heavy.csv light.csv --mass-change -220

The first log is the reference; the mass change is the sprung mass of a further log less that of the first, kg.
Without logs two runs are simulated and written as logs first. The channel names below are those of your logs.
"""

import argparse
from pathlib import Path

import numpy as np

import opid

SPRUNG, UNSPRUNG = "upper_z", "lower_z"


def simulated_logs(directory: Path) -> tuple[list[Path], list[float]]:
    """Write two taxi runs of known truth as logs (`time [s],lower_z [m/s^2],upper_z [m/s^2]`)."""
    test = opid.virtual.taxi_test(opid.virtual.LandingGear(), rng=np.random.default_rng(0))
    directory.mkdir(parents=True, exist_ok=True)
    logs = [directory / "heavy.csv", directory / "light.csv"]
    for log, run in zip(logs, (test.heavy, test.light), strict=True):
        opid.write_log(run.recording, log)
    return logs, [test.mass_change_kg]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("logs", nargs="*", type=Path, help="the reference first")
    parser.add_argument("--mass-change", dest="changes_kg", nargs="*", type=float, default=[], metavar="KG")
    parser.add_argument("--out", type=Path, default=Path("taxi_result"))
    options = parser.parse_args()
    logs, changes_kg = (options.logs, options.changes_kg) if options.logs else simulated_logs(options.out)

    study = opid.study_from_logs(logs, sprung=SPRUNG, unsprung=UNSPRUNG, mass_changes_kg=changes_kg)
    result = opid.identify(study)

    print(opid.text(result))
    low_high = result.parameters.sprung_mass_kg.interval95
    if low_high is not None:
        print(f"The sprung mass lies between {low_high[0]:.0f} and {low_high[1]:.0f} kg (95 %).")
    print(f"Report: {opid.write_report(result, options.out)}")


if __name__ == "__main__":
    main()
