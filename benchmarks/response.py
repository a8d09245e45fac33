"""Speed, accuracy and memory of `time_response` on the nominal taxi run.

Run `python benchmarks/response.py`. The same four seconds go through scipy's DOP853 and through the same
Runge-Kutta method in plain Python, in the same process; the compiled kernel also runs the whole 40 s.
"""

import math
import resource
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from opid.mechanics.response import time_response
from opid.virtual.taxi_tests.airframe import LandingGear, airframe_structure
from opid.virtual.taxi_tests.road import SpeedProfile, iso8608_road
from opid.virtual.taxi_tests.taxiing import tyre_forces

FS, LONG_S, SHORT_S = 4096.0, 40.0, 4.0
GEAR = LandingGear()
ROAD = iso8608_road("B", length_m=400.0, rng=np.random.default_rng(1))
SPEED = SpeedProfile(18.0, 0.5, LONG_S)


def force(time_s):
    return tyre_forces(GEAR.airframe, [ROAD], SPEED.position_m(time_s), SPEED.speed_m_per_s(time_s))


def equations(state, tyre_n):
    x1, x2, v1, v2 = state
    friction = GEAR.law.terms[0].amplitude * 2.0 / math.pi * math.atan((v2 - v1) / GEAR.law.terms[0].inner[0])
    strut = GEAR.suspension_stiffness_n_per_m * (x2 - x1) + GEAR.suspension_damping_n_s_per_m * (v2 - v1) + friction
    tyre = tyre_n - GEAR.tyre_stiffness_n_per_m * x1 - GEAR.tyre_damping_n_s_per_m * v1
    return v1, v2, (strut + tyre) / GEAR.unsprung_mass_kg, -strut / GEAR.sprung_mass_kg


def plain_runge_kutta(half_step_force_n):
    step_s = 1.0 / FS
    states = [(0.0, 0.0, 0.0, 0.0)]
    for k in range(0, len(half_step_force_n) - 2, 2):
        y = states[-1]
        k1 = equations(y, half_step_force_n[k])
        k2 = equations([a + 0.5 * step_s * b for a, b in zip(y, k1, strict=True)], half_step_force_n[k + 1])
        k3 = equations([a + 0.5 * step_s * b for a, b in zip(y, k2, strict=True)], half_step_force_n[k + 1])
        k4 = equations([a + step_s * b for a, b in zip(y, k3, strict=True)], half_step_force_n[k + 2])
        slopes = zip(y, k1, k2, k3, k4, strict=True)
        states.append(tuple(a + step_s / 6.0 * (b + 2.0 * (c + d) + e) for a, b, c, d, e in slopes))
    return np.array(states)


def reference(time_s):
    def rate(t, state):
        place, speed = 18.0 * t - 17.5 / 80.0 * t**2, 18.0 - 17.5 / 40.0 * t
        height, slope = float(ROAD.elevation(place)), float(ROAD.slope(place))
        return equations(state, GEAR.tyre_stiffness_n_per_m * height + GEAR.tyre_damping_n_s_per_m * slope * speed)

    return solve_ivp(rate, (0.0, time_s[-1]), np.zeros(4), "DOP853", time_s, rtol=1e-11, atol=1e-15, max_step=5e-3).y.T


def timed(function: Callable[[], Any]) -> tuple[float, Any]:
    begin = time.perf_counter()
    result = function()
    return time.perf_counter() - begin, result


def best_of(n, function):
    return min((timed(function) for _ in range(n)), key=lambda pair: pair[0])


def peak_mib():
    # kibibytes on Linux, bytes on macOS
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)


def main():
    response = partial(time_response, airframe_structure(GEAR.airframe), fs=FS, loads=np.array([[0.0], [1.0]]))
    first_s, _ = timed(lambda: response(force, duration_s=0.01))
    before_mib = peak_mib()
    forces = force(np.arange(2 * round(LONG_S * FS) - 1) / (2.0 * FS))
    long_s, _ = best_of(5, lambda: response(forces, duration_s=LONG_S))
    with_road_s, _ = best_of(5, lambda: response(force, duration_s=LONG_S))
    after_mib = peak_mib()

    n_short = round(SHORT_S * FS)
    short_s, motion = best_of(5, lambda: response(forces[: 2 * n_short - 1], duration_s=SHORT_S))
    python_s, python_state = timed(lambda: plain_runge_kutta(forces[: 2 * n_short - 1, 0].tolist()))
    scipy_s, scipy_state = timed(lambda: reference(motion.time_s))
    state = np.hstack([motion.displacement[:, ::-1], motion.velocity[:, ::-1]])

    print(f"first call, compiling or loading the kernel   {first_s:8.2f} s")
    print(f"{LONG_S:.0f} s at {FS:.0f} steps/s, force given             {1e3 * long_s:8.1f} ms")
    print(f"{LONG_S:.0f} s at {FS:.0f} steps/s, force from the road     {1e3 * with_road_s:8.1f} ms")
    print(f"memory added by the {LONG_S:.0f} s run                 {after_mib - before_mib:8.0f} MiB")
    print(f"peak memory of the process                    {after_mib:8.0f} MiB")
    print(f"{SHORT_S:.0f} s: plain Python / compiled                 {python_s / short_s:8.0f} times")
    print(f"{SHORT_S:.0f} s: solve_ivp DOP853 / compiled             {scipy_s / short_s:8.0f} times")
    print(f"difference from solve_ivp, rms over rms       {relative(state, scipy_state):8.1e}")
    print(f"difference from plain Python, rms over rms    {relative(state, python_state):8.1e}")


def relative(state, reference_state):
    """Largest over the state variables of the rms difference over the rms."""
    difference = np.mean((state - reference_state) ** 2, axis=0)
    return math.sqrt(np.max(difference / np.mean(reference_state**2, axis=0)))


if __name__ == "__main__":
    main()
