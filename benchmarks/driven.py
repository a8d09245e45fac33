"""Speed and memory of a driven body: its response, its derivatives, and what they replace.

Run `python benchmarks/driven.py`. A landing gear with friction, 40 s at 512 Hz. The same motion goes through scipy's
DOP853; the same derivatives through differences of the response alone, two runs a parameter.
"""

import resource
import sys
import time
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from driven_response import driven_response

from opid.mechanics.driven import Interface, half_steps
from opid.mechanics.laws.law import default_law

FS, DURATION_S, MASS_KG = 512.0, 40.0, 1850.0
STIFFNESS, DAMPING = 3.9e5, 6e3
LAWS = ("linear", "arctan_velocity", "arctan_mixed", "signed_power_damping", "gas_column")


def best_of(n, function):
    taken = []
    for _ in range(n):
        begin = time.perf_counter()
        result = function()
        taken.append(time.perf_counter() - begin)
    return min(taken), result


def peak_mib():
    # kibibytes on Linux, bytes on macOS
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)


def main():
    n = round(DURATION_S * FS)
    drive = half_steps(np.random.default_rng(0).standard_normal(n))[:, np.newaxis]

    def run(law, *, n_interfaces=1, **settings):
        accelerance = np.eye(n_interfaces) / MASS_KG
        directions = {
            "accelerance_directions": [accelerance],
            "drive_directions": np.ones((drive.shape[0], 1, n_interfaces)),
        }
        interfaces = [Interface(STIFFNESS, DAMPING, law=law)] * n_interfaces
        drives = np.repeat(drive, n_interfaces, axis=1)
        return driven_response(interfaces, accelerance, drives, fs=FS, **directions, **settings)

    friction = default_law("arctan_velocity")
    first_s, _ = best_of(1, lambda: run(friction))
    general_s, _ = best_of(1, lambda: run(friction, n_interfaces=3))
    before_mib = peak_mib()
    print(f"first call, compiling or loading: one interface {first_s:.2f} s, several {general_s:.2f} s")
    print(f"{'law, one interface':36} {'parameters':>10} {'with derivatives':>17} {'alone':>9} {'differences':>12}")
    for name in LAWS:
        law = default_law(name)
        whole_s, response = best_of(9, lambda law=law: run(law))
        alone_s, _ = best_of(9, lambda law=law: run(law, ground=False, sensitivity=False))
        n_parameters = response.sensitivity.shape[2]
        ratio = 2 * n_parameters * alone_s / whole_s
        print(f"{name:36} {n_parameters:10d} {1e3 * whole_s:14.2f} ms {1e3 * alone_s:6.2f} ms {ratio:9.1f} times")
    three_s, response = best_of(5, lambda: run(friction, n_interfaces=3))
    print(f"{'three with friction':36} {response.sensitivity.shape[2]:10d} {1e3 * three_s:14.2f} ms")
    print(f"memory added by these runs {peak_mib() - before_mib:.0f} MiB, peak of the process {peak_mib():.0f} MiB")

    t, half = np.arange(4 * round(FS)) / FS, np.arange(8 * round(FS) - 1) / (2 * FS)
    amplitude_n, scale = friction.vector

    def acceleration(time_s):
        return 2.0 * np.sin(2 * np.pi * 1.7 * time_s) + 1.5 * np.sin(2 * np.pi * 6.1 * time_s)

    def rate(time_s, state):
        z, v = state
        force = STIFFNESS * z + DAMPING * v + amplitude_n * 2 / np.pi * np.arctan(v / scale)
        return v, -force / MASS_KG - acceleration(time_s)

    gear, u = [Interface(STIFFNESS, DAMPING, law=friction)], acceleration(half)[:, np.newaxis]
    short_s, response = best_of(5, lambda: driven_response(gear, [[1 / MASS_KG]], u, fs=FS, sensitivity=False))
    settings = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-13, "max_step": 4e-3}
    scipy_s, exact = best_of(1, lambda: solve_ivp(rate, (0.0, t[-1]), [0.0, 0.0], t_eval=t, **settings))
    off = np.sqrt(np.mean((response.travel[:, 0] - exact.y[0]) ** 2) / np.mean(exact.y[0] ** 2))
    print(f"4 s: solve_ivp DOP853 / compiled {scipy_s / short_s:.0f} times; travel off by {off:.1e} of its rms")


if __name__ == "__main__":
    main()
