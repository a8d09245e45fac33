"""What is wrong with a log: as words, as a picture, and as figures to go on with.

    python examples/inspect_a_log.py LOG

Without a log a taxi run is simulated, and one of its channels spoilt.
"""

import argparse
from pathlib import Path

import numpy as np

import opid
from opid.plots import figure_of, health_picture, png


def spoilt_log(directory: Path) -> Path:
    """Write a taxi run whose upper sensor clips and catches the mains."""
    run = opid.virtual.taxi_run(opid.virtual.LandingGear(), rng=np.random.default_rng(0)).recording
    hum = 0.2 * np.sin(2 * np.pi * 50.0 * run.time_s)
    upper = np.clip(run.channel("upper_z") + hum, -3.0, 3.0)
    directory.mkdir(parents=True, exist_ok=True)
    names = ["lower_z", "upper_z"]
    opid.write_log(
        opid.signals.recording_from_arrays([run.channel("lower_z"), upper], names, fs=run.fs), directory / "run.csv"
    )
    return directory / "run.csv"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("log", nargs="?", type=Path)
    parser.add_argument("--out", type=Path, default=Path("inspected"))
    options = parser.parse_args()
    log = options.log or spoilt_log(options.out)

    health = opid.inspect(opid.signals.open_log(log))

    print(opid.text(health))
    options.out.mkdir(parents=True, exist_ok=True)
    picture = options.out / f"{log.stem}.png"
    picture.write_bytes(png(figure_of(health_picture(health))))
    print(f"Picture: {picture}")
    for channel in health.channels:
        lost_s = sum(stretch.stop_s - stretch.start_s for stretch in channel.stretches)
        print(f"{channel.name}: something is wrong in {lost_s:.2f} s of {health.duration_s:.0f} s")


if __name__ == "__main__":
    main()
