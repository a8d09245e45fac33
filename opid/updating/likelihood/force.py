"""The force of tests at phase resonance, which is as large as the damping of the structure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from opid.errors import InputError
from opid.signals.recording import FloatArray
from opid.updating.likelihood.noise import CurveNoise, NoiseSettings, curve_noise, draw_set
from opid.updating.measured import MeasuredBackbone, by_mode

if TYPE_CHECKING:
    from opid.updating.likelihood.backbones import ModeData


@dataclass(frozen=True, eq=False)
class ForceData:
    """The measured work of the force, ready to be compared with a model that is solved at the nodes of all modes.

    The work of a cycle over pi A^2, force times motion of the drive point over the square of the controlled amplitude,
    is the dynamic stiffness at resonance; its logarithm has errors of about the same size at all amplitudes.

    Args:
        values: (n_points,) that logarithm, of N/m.
        of_mode: (n_points,) number of the mode of each point.
        relative_amplitude: (n_points,) amplitude over the largest of the mode.
        noise: noise model of that logarithm. Calibration is an error that all modes have in common; the energy that the
            model loses has another one in each mode.
        place: the arguments of `curve_noise` that do not depend on the values.
        known_ratios: damping ratio of the modes where it is known, by their numbers.
    """

    values: FloatArray
    of_mode: NDArray[np.int64]
    relative_amplitude: FloatArray
    noise: CurveNoise
    place: Mapping[str, Any]
    known_ratios: Mapping[int, float]


def force_data(
    modes: Sequence[ModeData], measured: Sequence[MeasuredBackbone], noise: NoiseSettings, ratios: Mapping[int, float]
) -> ForceData:
    """Return the work of the force along all backbones that have one.

    Args:
        modes: the `ModeData` of the same backbones, in their order.
        measured: the backbones, those of a mode one after the other.
        noise: settings for the errors.
        ratios: damping ratio of the modes where it is known, by their numbers.

    Raises:
        InputError: no backbone has a force.
    """
    curves_of = by_mode(measured)
    n_nodes = [mode.between.shape[1] for mode in modes]
    values, between, curve, growth, of_mode, relative = [], [], [], [], [], []
    floors: list[FloatArray] = []
    n_curves, column = 0, 0
    for mode, width in zip(modes, n_nodes, strict=True):
        driven = [index for index, one in enumerate(curves_of[mode.mode]) if one.force_n is not None]
        kept = np.isin(mode.curve, driven)
        own = [curves_of[mode.mode][index] for index in driven]
        values += [find_stiffness(one, one.controlled_sensor) for one in own]
        block = np.zeros((int(kept.sum()), sum(n_nodes)))
        block[:, column : column + width] = mode.between[kept]
        between.append(block)
        curve.append(n_curves + np.searchsorted(driven, mode.curve[kept]))
        growth.append(mode.growth[kept])
        of_mode.append(np.full(int(kept.sum()), mode.mode))
        relative.append(mode.relative_amplitude[kept])
        floors.append(_find_floor(own, len(floors), len(modes)))
        n_curves, column = n_curves + len(driven), column + width
    if not n_curves:
        raise InputError("no backbone has a force: name the drive point of those that have a column of it")
    numbers = np.unique(np.concatenate(of_mode), return_inverse=True)[1]
    # Errors of the modes of one size are their mean, which adds to the calibration, and contrasts to the mean.
    n_modes = int(numbers[-1]) + 1
    common_std = float(np.hypot(noise.force_error, noise.energy_error / np.sqrt(n_modes)))
    contrasts = np.linalg.qr(np.column_stack([np.ones(n_modes), np.eye(n_modes)[:, 1:]]))[0][:, 1:]
    floor = np.concatenate(floors)
    floor = floor[:, floor.any(axis=0)]
    place = {
        "between": np.concatenate(between),
        "curve": np.concatenate(curve),
        "growth": np.concatenate(growth),
        "patterns": np.column_stack([noise.energy_error * contrasts[numbers], noise.force_floor * floor]) / common_std,
        "common_std": common_std,
    }
    found = np.log(np.concatenate(values))
    return ForceData(
        found, np.concatenate(of_mode), np.concatenate(relative), _make_noise(found, place, noise), place, dict(ratios)
    )


def draw_force(data: ForceData, losses: FloatArray, noise: NoiseSettings, rng: np.random.Generator) -> ForceData:
    """Return a force as it might have been measured, with errors like those that the measured one has.

    Args:
        data: the measured force.
        losses: (n_nodes,) logarithm of the work of the true law over pi A^2 at the nodes of all modes.
        noise: settings for the errors.
        rng: source of chance.
    """
    place = data.place
    values = draw_set(data.noise, losses[:, None], place["between"], place["curve"], place["growth"], rng)[:, 0]
    return replace(data, values=values, noise=_make_noise(values, place, noise))


def find_stiffness(one: MeasuredBackbone, sensor: str) -> FloatArray:
    """Return the work of the force over pi A^2 at each point of a curve, N/m, with A the amplitude of a sensor."""
    assert one.force_n is not None
    drive, own = (one.amplitude[:, one.sensors.index(name)] for name in (one.drive, sensor))
    return np.asarray(one.force_n * np.abs(drive) / own**2)


def _find_floor(driven: Sequence[MeasuredBackbone], number: int, n_modes: int) -> FloatArray:
    """Return the largest force of a mode over that at each point, (n_points, n_modes), in the column of the mode."""
    force = np.concatenate([np.empty(0), *(one.force_n for one in driven if one.force_n is not None)])
    floor = np.zeros((force.size, n_modes))
    floor[:, number] = force.max(initial=0.0) / force
    return floor


def _make_noise(values: FloatArray, place: Mapping[str, Any], noise: NoiseSettings) -> CurveNoise:
    return curve_noise(
        values[:, None], **place, common_growth=noise.growth_of_linear_error, own_growth=noise.curve_growth,
        offset=noise.force_offset, expected=noise.force_noise,
    )  # fmt: skip
