"""What limits an answer of the paper's chain, in sentences."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from opid.mechanics.weight import depends_on_travel
from opid.signals.health.inspection import findings_in_words
from opid.suspensions.paper.estimates import gain_like_fraction, straight_terms
from opid.suspensions.paper.result import PaperIdentification


def warnings_of(result: PaperIdentification) -> Iterator[str]:
    """Yield what limits an answer of the mended chain, one sentence each.

    Args:
        result: with everything but its warnings.
    """
    yield from warnings_of_the_logs(result)
    settings, fs = result.settings, result.study.fs
    high_hz = settings.band_at(fs)[1]
    if high_hz < settings.band_hz[1]:
        yield (
            f"the runs are sampled at {fs:g} Hz, and used up to {high_hz:.4g} Hz instead of {settings.band_hz[1]:g} "
            f"Hz, for the filters of loggers begin at {settings.highest_fraction_of_rate:g} of the rate: record "
            "faster, or give a band that ends below"
        )
    yield from _residual(result)
    yield from _averages(result)
    yield from _ground(result)
    yield from _mass_change(result)
    yield from _weight(result)
    yield from _straight(result)


def warnings_of_the_logs(result: PaperIdentification) -> Iterator[str]:
    """Yield what is to be doubted of the logs.

    Args:
        result: with everything but its warnings.
    """
    for run in result.chain.runs:
        yield from findings_in_words(run.name, run.findings)


def _residual(result: PaperIdentification) -> Iterator[str]:
    unexplained, verdicts = result.residual_over_noise, result.settings.verdicts
    if unexplained > verdicts.doubtful:
        yield (
            f"the model explains the runs only to {unexplained:.1f} times the sensor noise: the law lacks a term, the "
            "slow motion below the high-pass matters, or a sensor is at fault; the intervals are widened by "
            f"{unexplained / verdicts.doubtful:.1f}"
        )
    elif unexplained > verdicts.noted:
        yield (
            f"the residual is {unexplained:.1f} times the sensor noise: most of it is the slow motion that the "
            "integration cannot give to the law"
        )


def _averages(result: PaperIdentification) -> Iterator[str]:
    averages = min(run.T.spectra.n_averages for run in result.chain.runs)
    if averages < result.settings.few_averages:
        yield (
            f"each transmissibility rests on {averages:.1f} independent averages: its coherence is near 1 by "
            "construction and its peaks are chance (the parameters do not come from it)"
        )


def _ground(result: PaperIdentification) -> Iterator[str]:
    ground = result.parameters.ground_stiffness_n_per_m
    stiffness = result.parameters.suspension_stiffness_n_per_m
    fraction = gain_like_fraction(result.joint, result.settings)
    if fraction:
        sign = np.sign(result.joint["ground_stiffness_per_mass"])
        yield (
            f"the ground spring is {100 * sign * fraction:.1f} % of the suspension: a gain error of about "
            f"{100 * fraction:.1f} % between the two sensors does that (AC coupling with different corners too), so "
            "the intervals of stiffness and damping hold it"
        )
    elif (
        ground.value is not None
        and stiffness.value is not None
        and abs(ground.value) > result.settings.negligible_ground * abs(stiffness.value)
        and not ground.holds(0.0)
    ):
        yield (
            f"the ground spring K3 = {ground.value:.3g} N/m differs from zero, yet a free aircraft has none: sensors "
            "whose AC-coupling corners differ, a gain error, or friction outside the law imitate it; the intervals "
            "hold for equal gains, and 1 % of gain difference moves stiffness and damping by about 1 %"
        )


def _mass_change(result: PaperIdentification) -> Iterator[str]:
    mass = result.parameters.sprung_mass_kg
    if mass.value is None or mass.std is None:
        return
    changes = [run.mass_change_kg for run in result.chain.runs]
    fraction = (max(changes) - min(changes)) / mass.value
    if mass.std / mass.value > result.settings.loose_mass:
        yield (
            f"the mass change is {100 * fraction:.0f} % of the mass, which multiplies every relative error by about "
            f"{1 / fraction:.0f}: doubling it would halve the interval of the mass"
        )


def _weight(result: PaperIdentification) -> Iterator[str]:
    changes = {run.mass_change_kg for run in result.chain.runs}
    if len(changes) > 1 and result.study.interfaces[0].axis != "horizontal" and depends_on_travel(result.joint.law):
        yield (
            "the paper's equation has one law about one position at rest, yet runs of another mass rest elsewhere on a "
            "law that depends on the travel: stiffness, law and mass are off by more than their intervals say; give "
            "method='model', which rests each run where its weight puts it, or axis = \"horizontal\" where no weight "
            "acts"
        )


def _straight(result: PaperIdentification) -> Iterator[str]:
    for term in straight_terms(result.joint.law, result.chain.runs, straight_above=result.settings.straight_above):
        yield term.warning
