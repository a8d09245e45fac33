"""What a user gives with a structure of his own, checked and as the fit takes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import get_args

import numpy as np

from opid.errors import InputError, nearest
from opid.mechanics.structure import Structure
from opid.signals.health import without_spikes
from opid.signals.motion import integrate
from opid.signals.recording import FloatArray, Recording
from opid.suspensions.body import Body
from opid.suspensions.candidates import Arrays, is_mass_free
from opid.suspensions.channel_checks import check_channels, findings_in_words
from opid.suspensions.fit import first_vector
from opid.suspensions.model import Model
from opid.suspensions.run import DrivenRun
from opid.suspensions.sensor_facts import ideal_sensors
from opid.suspensions.settings import Settings
from opid.suspensions.start import Start
from opid.suspensions.study import SAME_RATE, Axis
from opid.suspensions.unknowns import Group


def channel_arrays(runs: Sequence[Recording], interfaces: Mapping[str, str], sensors: Mapping[str, str]) -> Arrays:
    """Return the accelerations below and on the structure of each run, single spikes mended.

    Returns:
        (n, n_interfaces), (n, n_sensors) and (n, 0) of each run, m/s^2.

    Raises:
        InputError: no runs or channels, a channel twice, one that is missing or no acceleration, different rates.
    """
    if not runs:
        raise InputError("there are no runs: give at least one recording")
    if not interfaces or not sensors:
        raise InputError(
            "give at least one interface and one sensor on the structure, each as degree of freedom: channel"
        )
    used = [*interfaces.values(), *sensors.values()]
    for name in used:
        if used.count(name) > 1:
            raise InputError(f"the channel {name!r} is named {used.count(name)} times: each sensor is one channel")
    for place, run in enumerate(runs, start=1):
        if abs(run.fs / runs[0].fs - 1) > SAME_RATE:
            raise InputError(f"run 1 has {runs[0].fs:.9g} Hz and run {place} has {run.fs:.9g} Hz: resample one of them")
        for name in used:
            if name not in run.names:
                raise InputError(f"run {place} has no channel {name!r}: {nearest(name, run.names)}")
            if run.unit(name) != "m/s^2":
                raise InputError(f"channel {name!r} of run {place} is in {run.unit(name)}: an acceleration is needed")

    def samples(run: Recording, names: Sequence[str]) -> FloatArray:
        return np.stack([without_spikes(run.channel(name), fs=run.fs)[0] for name in names], axis=1)

    return [
        (samples(run, tuple(interfaces.values())), samples(run, tuple(sensors.values())), np.empty((run.n_samples, 0)))
        for run in runs
    ]


def names_of(runs: Sequence[Recording]) -> list[str]:
    """Return what the runs are called: they are counted."""
    return [str(number) for number in range(1, len(runs) + 1)]


def doubts_of_channels(
    runs: Sequence[Recording], interfaces: Mapping[str, str], sensors: Mapping[str, str]
) -> list[str]:
    """Return what is to be doubted of the channels of all runs, one sentence each.

    Raises:
        InputError: two channels that make no pair.
    """
    pairs = [(below, sensors[name]) for name, below in interfaces.items() if name in sensors]
    used, found = [*interfaces.values(), *sensors.values()], list[str]()
    for run, name in zip(runs, names_of(runs), strict=True):
        found += findings_in_words(name, check_channels(run, pairs, used, run=name))
    return found


def loading_matrices(
    structure: Structure, loadings: Sequence[Mapping[str, float]] | None, n_runs: int
) -> list[FloatArray]:
    """Return the mass matrix of what each run carries more than the structure, (n_dof, n_dof) kg.

    Raises:
        InputError: not one loading a run, an unknown degree of freedom, a mass that is no number.
    """
    given = [{}] * n_runs if loadings is None else list(loadings)
    if len(given) != n_runs:
        raise InputError(f"there are {len(given)} loadings for {n_runs} run(s): give one a run, {{}} for none")
    matrices = []
    for loading in given:
        diagonal = np.zeros(structure.n_dof)
        for name, mass_kg in loading.items():
            if not np.isfinite(mass_kg):
                raise InputError(f"the loading at {name!r} is {mass_kg}: give a mass in kg")
            diagonal[structure.index(name)] += mass_kg
        matrices.append(np.diag(diagonal))
    return matrices


def axes_of(structure: Structure, axis: Axis | Mapping[str, Axis] | None) -> list[Axis]:
    """Return where each degree of freedom counts positive, "horizontal" for those of which nothing is said.

    Raises:
        InputError: an axis that is none, or an unknown degree of freedom.
    """
    allowed, found = get_args(Axis), list[Axis](["horizontal"] * structure.n_dof)
    if axis is None:
        return found
    named = axis if isinstance(axis, Mapping) else dict.fromkeys(structure.names, axis)
    for name, each in named.items():
        if each not in allowed:
            raise InputError(f"the axis of {name!r} is {each!r}: give one of {', '.join(map(repr, allowed))}")
        found[structure.index(name)] = each
    return found


def stated_start(
    structure: Structure,
    runs: Sequence[DrivenRun],
    body: Body,
    groups: tuple[Group, ...],
    start: Mapping[str, tuple[float, float]],
    unknown: Sequence[str],
    unknown_mass: Sequence[str],
    settings: Settings,
) -> Start:
    """Return start values from what the user says, where the sensors do not see all degrees of freedom.

    Raises:
        InputError: an unknown suspension in `start` or one that is missing, a joint without a stiffness.
    """
    hidden = f"the sensors see {np.linalg.matrix_rank(body.readings)} of {structure.n_dof} degrees of freedom"
    for name in start:
        if name not in [group.name for group in groups]:
            raise InputError(f"start has {name!r}, which is no interface: {nearest(name, [g.name for g in groups])}")
    missing = [group.name for group in groups if group.name not in start]
    if missing:
        raise InputError(
            f"{hidden}: give `start`, stiffness and damping roughly, of the suspension of {', '.join(missing)}"
        )
    joints = {joint.name: (joint.stiffness_n_per_m, joint.damping_n_s_per_m) for joint in structure.joints}
    for name in unknown:
        if joints[name][0] <= 0.0:
            raise InputError(f"{hidden}: give the joint {name!r} a stiffness from which to begin, N/m")
    places = [structure.index(name) for name in unknown_mass]
    mass = np.diag(structure.mass)
    reference = float(mass[places[0]]) if places else 1.0
    # in the order of the slots, as `body.inside` has them
    springs = [start[group.name] for group in groups]
    springs += [joints[spring.name] for spring in body.inside if spring.stiffness_n_per_m is None]
    stiffness, damping = np.array(springs, dtype=np.float64).T / reference
    scaled = tuple(
        replace(group, law=group.law.scaled(1 / reference)) if group.law.terms else group for group in groups
    )
    mass_free = is_mass_free(runs, body)
    corner_hz = settings.start.high_pass_hz
    of_ground = [[integrate(u, fs=run.fs, high_pass_hz=corner_hz) for u in run.unsprung.T] for run in runs]
    rms = np.array([[[m.displacement.std(), m.velocity.std()] for m in motions] for motions in of_ground]).mean(axis=0)
    begun = Start(
        scaled,
        stiffness,
        damping,
        mass[places[1:]] / reference,
        1 / reference if mass_free else None,
        rms,
        ground_stiffness=np.zeros(len(groups)),
        ground_std=np.ones(len(groups)),
        stiffness_beside_ground=stiffness[: len(groups)],
    )
    # how far the suspensions move, from a first prediction
    sensors = ideal_sensors(body.n_interfaces, len(body.readings))
    noise = np.ones(body.n_interfaces), np.ones(len(body.readings))
    model = Model(tuple(runs), body, begun.groups, sensors, mass_free, rms, settings, noise=noise)
    predictions = model.evaluate(first_vector(model, begun), sensitivity=False).predictions
    moved = [[[p.travel[:, k].std(), p.velocity[:, k].std()] for k in range(len(groups))] for p in predictions]
    return replace(begun, motion_rms=np.mean(moved, axis=0))
