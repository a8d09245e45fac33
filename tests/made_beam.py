"""A free beam with accelerometers, lasers and strain gauges, whose first elastic mode softens, for tests of sensors."""

import numpy as np
from made_beats import beat

from opid.modal.linear.modes import LinearModes, modal_test
from opid.modal.model import NonlinearModalModel, modal_response
from opid.modal.power_laws import power_law
from opid.signals.recording import Channel, Recording

FS = 2048.0
LENGTH_M, HEIGHT_M, MASS_KG = 1.2, 0.03, 9.0
ROOTS = (4.730040745, 7.853204624, 10.995607838)
SOFT = 2
FREQUENCY_HZ = 90.0 * np.array([0.0, *np.square(ROOTS) / ROOTS[0] ** 2])
LAW = power_law({3: -9e9}, {2: 20.0})

ACCELEROMETERS = {"a": 0.0, "b": 0.23, "c": 0.5, "d": 0.71, "e": 1.0}
OTHERS = {"laser": 0.12, "ruler": 0.88}
GAUGES = {"gauge_1": 0.3, "gauge_2": 0.5, "gauge_3": 0.62, "gauge_4": 0.8}
UNITS = dict.fromkeys(ACCELEROMETERS, "m/s^2") | {"laser": "m/s", "ruler": "m"} | dict.fromkeys(GAUGES, "strain")


def bend(root, place, *, curvature=False):
    """Return shape or curvature times the square of the length of a mode of a free beam, 1 at the ends (Blevins)."""
    sign = -1 if curvature else 1
    x, sigma = root * place, (np.cosh(root) - np.cos(root)) / (np.sinh(root) - np.sin(root))
    value = np.cosh(x) + sign * np.cos(x) - sigma * (np.sinh(x) + sign * np.sin(x))
    return value * (root**2 if curvature else 1)


def row(sensor):
    """Return the row of a sensor: the motion or the strain at the surface for each modal coordinate."""
    if sensor in GAUGES:
        to_strain = HEIGHT_M / 2 / LENGTH_M**2
        return [0.0, *(to_strain * bend(root, GAUGES[sensor], curvature=True) / MASS_KG**0.5 for root in ROOTS)]
    place = (ACCELEROMETERS | OTHERS)[sensor]
    return [1 / MASS_KG**0.5, *(bend(root, place) / MASS_KG**0.5 for root in ROOTS)]


def beam(*sensors):
    """Return the modes of the beam, heave among them, at some sensors."""
    return LinearModes(FREQUENCY_HZ, [0.0, 0.004, 0.005, 0.006], [row(each) for each in sensors], sensors)


def record(force, sensors, *, modes=None, noise=0.005, seed=0, linear=False):
    """Return what the sensors read, each in its own unit, and the force at "a"; gauges have an offset."""
    model = NonlinearModalModel(modes or beam("a"), {} if linear else {SOFT: LAW})
    motion = modal_response(model, force, fs=FS, drive_point="a")
    of_unit = {"m/s^2": motion.acceleration, "m/s": motion.velocity, "m": motion.displacement}
    of_unit["strain"] = motion.displacement
    columns = [of_unit[UNITS[each]] @ row(each) + 1e-4 * (each in GAUGES) for each in sensors]
    samples = np.column_stack([*columns, force])
    rng = np.random.default_rng(seed)
    samples = samples + noise * samples.std(axis=0) * rng.standard_normal(samples.shape)
    channels = (*(Channel(each, UNITS[each]) for each in sensors), Channel("force", "N"))
    return Recording(samples, FS, channels)


def driven(force, sensors, modes=None, *, name="beat", **changes):
    """Return the modal test of the beam under a force at "a"."""
    modes = beam(*dict.fromkeys(["a", *sensors])) if modes is None else modes
    return modal_test(record(force, sensors, **changes), modes, name=name, force="force", drive_point="a")


def strike(newton):
    """Return a beat at the softening mode, N, of a peak."""
    return beat(newton, frequency_hz=FREQUENCY_HZ[SOFT - 1], fs=FS)
