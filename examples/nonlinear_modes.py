"""From recordings in memory to a nonlinear modal model, its response to another force, and a truth test.

    python examples/nonlinear_modes.py --out modal_result

Four modes at six sensors, the third of them nonlinear; the recordings are simulated, put your own in their place.
"""

import argparse
from pathlib import Path

import numpy as np

import opid
from opid.virtual import virtual_series, virtual_study


def measured() -> tuple[opid.modal.LinearModes, dict[str, opid.Recording]]:
    """Return linear modes, and recordings by name: m/s^2 at the sensors and a channel "force" in N, decayed to rest."""
    study = virtual_study(virtual_series("cubic"), rng=np.random.default_rng(0))
    return study.modes, {each.test.name: each.test.recording for each in study.tests}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("modal_result"))
    options = parser.parse_args()

    # frequency_hz, damping_ratio, mass-normalised shapes (sensors x modes), and the names of the sensors
    modes, recordings = measured()
    print(f"{modes.n_modes} modes at {', '.join(modes.sensors)}; {len(recordings)} recordings")

    # 1. modal coordinates: the filter pinv(shapes) for the sensors, shapes^T for the force
    tests = {
        name: opid.modal.modal_test(recording, modes, name=name, force="force", drive_point="case_x")
        for name, recording in recordings.items()
    }

    # 2. what each is for: beats to fit mode 3, a sweep as the truth test; orders are searched
    beats = [opid.modal.StudyTest(test, "fit", mode=3) for name, test in tests.items() if name.startswith("beat")]
    study = opid.modal.ModalStudy(
        "Six sensors", modes, (3,), (*beats, opid.modal.StudyTest(tests["sweep"], "truth")), drive_point="case_x"
    )
    result = opid.identify(study)
    print(opid.text(result))

    # 3. the model answers any force: here a blow ten times as short as a period of mode 3, weak and strong
    fs = 4096.0
    blow = np.sin(np.pi * np.clip(np.arange(8192) / fs * 1200, 0, 1))
    for newton in (100.0, 2000.0):
        nonlinear, linear = (
            opid.modal.simulate(model, newton * blow, fs=fs, drive_point="case_x").channel("lid_x")
            for model in (result.model, result.model.linear)
        )
        left = [1e3 * np.abs(each[6000:]).max() / newton for each in (nonlinear, linear)]
        print(f"{newton:5.0f} N: after 1.5 s lid_x rings with {left[0]:.3f} mm/s^2 a newton, linear {left[1]:.3f}")

    # 4. result.json, the page and its figures
    print(f"Report: {opid.write_report(result, options.out)}")


if __name__ == "__main__":
    main()
