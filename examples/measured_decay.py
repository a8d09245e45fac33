"""From the blow of a hammer on a measured beam with a bolted joint to the law of its first mode.

    python examples/measured_decay.py HammerImpact.mat --channel acc1 --out measured_decay_result

The log is public (BRBtesting by M. Cenedese: Brake-Reuss beam, free at both ends, three accelerometers at 12.8 kHz) and
no part of the project; any log of a decay will do. No force and no modes are needed.
"""

import argparse
from pathlib import Path

import numpy as np

import opid


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("log", type=Path, nargs="?", help="a log of the blow and of what rings after it")
    parser.add_argument("--channel", default="acc1", help="the channel that shows the mode best")
    parser.add_argument("--out", type=Path, default=Path("measured_decay_result"))
    options = parser.parse_args()
    if options.log is None:
        print("give a log of a free decay, HammerImpact.mat of BRBtesting for example: there is none in the project")
        return

    # 1. the signal of one sensor; read_log has the units of the file
    recording = opid.read_log(options.log)
    signal = recording.channel(options.channel)

    # 2. frequency and damping over the amplitude of the strongest line, and a law of powers, friction and slip
    decay = opid.modal.free_decay(signal, fs=recording.fs, name=options.log.stem)
    print(opid.text(decay))

    # 3. what the law says between the amplitudes that were measured
    if decay.law is not None:
        law, at = opid.modal.law_of_decays([decay]), np.geomspace(decay.amplitude.min(), decay.amplitude.max(), 5)
        for amplitude, frequency, damping in zip(at, *law.curves_at(at), strict=True):
            print(f"{1e6 * amplitude:8.2f} um: {frequency:.2f} Hz, {100 * damping:.3f} % of critical damping")
    opid.write_report(decay, options.out)
    print(f"page and numbers are in {options.out}")


if __name__ == "__main__":
    main()
