"""What is known of the unknowns before the data: sensors, places, how a run begins, exponents, and a column of gas."""

from __future__ import annotations

import numpy as np

from opid.mechanics.weight import ATMOSPHERE_PA
from opid.signals.recording import FloatArray
from opid.suspensions.unknowns import Unknowns


def known_before(unknowns: Unknowns, theta: FloatArray, *, is_held: bool) -> tuple[FloatArray, FloatArray]:
    """Return the departures from what was known before the data, each over its standard deviation, and their Jacobian.

    First those of faults of sensors, of places, and of roughly how a run begins, then those of the laws.
    """
    known = [(fault.nominal, fault.std) for fault in unknowns.faults]
    known += [(0.0, coordinate.std) for coordinate in unknowns.body.coordinates]
    start_rms = unknowns.settings.runs.start_rms
    of_run = [(0.0, start_rms * float(rms)) for rms in unknowns.motion_rms.ravel()]
    of_run += [(0.0, unknowns.repeatability)] * unknowns.n_departures
    known += of_run * len(unknowns.runs)
    nominal, std = np.array(known).reshape(-1, 2).T
    first = theta.size - std.size
    jacobian = np.zeros((std.size, theta.size))
    jacobian[np.arange(std.size), first + np.arange(std.size)] = 1 / std
    of_laws, by_laws = _known_of_laws(unknowns, theta, is_held=is_held)
    return np.concatenate([(theta[first:] - nominal) / std, of_laws]), np.concatenate([jacobian, by_laws])


def _known_of_laws(unknowns: Unknowns, theta: FloatArray, *, is_held: bool) -> tuple[FloatArray, FloatArray]:
    """How far exponents are from what is known of them, and what carries the weight from a column of gas alone."""
    left, rows = [], []

    def add(value: float, slopes: dict[int, float], std: float, *, is_loose: bool = False) -> None:
        size, slope_factor = value / std, 1.0 / std
        if is_loose:
            # Student's t of one degree of freedom: what the runs contradict is given up
            size, slope_factor = _loosely(size, slope_factor)
        left.append(size)
        rows.append(np.zeros(theta.size))
        for place, slope in slopes.items():
            rows[-1][place] = slope_factor * slope

    for number, group in enumerate(unknowns.groups):
        for place, parameter in enumerate(group.law.parameter_list, start=unknowns.law_places(number).start):
            if parameter.known:
                mean, std = parameter.known
                add(float(theta[place]) - float(np.log(mean)), {place: 1.0}, std / mean)
    for number, place in unknowns.carriers:
        first, is_loose, gas = unknowns.first_of_group[number], not is_held, unknowns.settings.gas
        std = gas.carried if unknowns.body.piston_area_m2 else gas.carried_unstated
        std *= unknowns.settings.fit.held_fraction if is_held else 1.0
        weight, by_mass = _carried(unknowns, theta)
        length, exponent = np.exp(theta[place + 1 : place + 3]).tolist()
        slopes = {place: 1.0 / weight}
        if unknowns.mass_free:
            slopes[unknowns.first_fault - 1] = -float(theta[place]) * by_mass / weight**2
        add(float(theta[place]) / weight - 1.0, slopes, std, is_loose=is_loose)
        of_gas = length / (exponent * weight)
        beside = float(theta[first]) * of_gas
        slopes = {first: of_gas, place + 1: beside, place + 2: -beside}
        if unknowns.mass_free:
            slopes[unknowns.first_fault - 1] = -beside * by_mass / weight
        add(beside, slopes, std, is_loose=is_loose)
    return np.array(left), np.array(rows).reshape(-1, theta.size)


def _carried(unknowns: Unknowns, theta: FloatArray) -> tuple[float, float]:
    """What gas that carries all of the weight pushes with, and the derivative by one over the mass.

    The air outside pushes back on the piston: per unit of the reference mass, m/s^2 and N.
    """
    air_n = ATMOSPHERE_PA * unknowns.body.piston_area_m2
    mu = unknowns.inverse_mass(theta)
    return unknowns.weight + air_n * mu, air_n


def _loosely(size: float, slope_factor: float) -> tuple[float, float]:
    """Return the root of minus twice a log density with long tails, sqrt(2 log(1 + x^2/2)), and its derivative."""
    cost = float(np.sqrt(2.0 * np.log1p(0.5 * size**2)))
    return float(np.copysign(cost, size)), slope_factor * (abs(size) / (cost * (1.0 + 0.5 * size**2)) if size else 1.0)


def state_at_start(unknowns: Unknowns, theta: FloatArray, place: int) -> tuple[FloatArray, FloatArray]:
    """Return the state of all slots at a run's first sample, and its covariance: what is fitted is known exactly."""
    body, known, run = unknowns.body, unknowns.settings.runs, unknowns.runs[place]
    n, n_rows, n_sensors = body.n_interfaces, 6 if unknowns.ground else 4, len(unknowns.sensors.sprung)
    start, std = np.zeros((n_rows, body.n_slots)), np.zeros((n_rows, body.n_slots))
    start[:2, :n] = theta[unknowns.places_of_run(place)[0]].reshape(-1, 2).T
    std[:2, :n] = 1e-9
    springs = np.abs(body.rows[n:]).max(axis=1, initial=0.0) > 0.0
    std[:2, n:] = springs * known.start_rms * unknowns.motion_rms.max(axis=0, initial=0.0)[:, np.newaxis]
    for row, facts in ((-2, unknowns.sensors.unsprung), (-1, unknowns.sensors.sprung)):
        offsets = [known.offset_ac_m_per_s2 if each.corner_hz else known.offset_m_per_s2 for each in facts]
        std[row, : n if row == -2 else n_sensors] = offsets
    covariance = np.diag(std.ravel() ** 2)
    if unknowns.ground:
        below, near = run.ground_at_start
        for k, sensor in enumerate(unknowns.sensors.unsprung):
            rows = np.arange(2, 5) * body.n_slots + k
            if sensor.corner_hz:
                # what an AC coupling took from the path is not known
                far = (known.start_displacement_m, known.start_velocity_m_per_s, known.offset_ac_m_per_s2)
                covariance[rows, rows] = np.square(far)
            else:
                start[2:5, k], covariance[np.ix_(rows, rows)] = below[:, k], near[k]
    return start, covariance
