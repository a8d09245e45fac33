"""Every tuned number of the test bench, with its reason. To change one, pass another `BenchSettings`."""

from __future__ import annotations

from dataclasses import dataclass, field

from opid.suspensions.fitting.least_squares import SeparableSettings
from opid.suspensions.settings import GasSettings, SearchSettings


@dataclass(frozen=True)
class RecordSettings:
    """How a record is prepared, and when it is worth a warning.

    Args:
        least_samples: a shorter record is refused.
        turn: a travel has turned round if it went back by this fraction of its range.
        path_steps: number of steps of the path of a quasi-static test for each of its samples: a memory is followed
            through turns that lie between two samples.
        above_floor: a travel is differentiated up to the last frequency at which its spectrum exceeds its floor by this
            factor ...
        left_above: ... or up to the minimum of the spectrum of the rate, if less than this fraction of its power lies
            above.
        line: ... and to the last line of travel and force whose power exceeds the middle one around it by this factor,
            which noise of eight stretches does not: a weak second tone is a motion.
        line_width: number of frequencies of the spectrum that are around it.
        rate_factor: a recorded velocity is the rate of the travel if it is between these multiples of it ...
        rate_correlation: ... and if its correlation with it is at least this.
        driving_correlation: a force that feeds power into the motion with this correlation has the wrong sign.
        coarsest: steps of a channel make an error that no interval holds if its variance is this fraction of that of
            the channel: a slope is then too low by as much, and laws that step with the channel fit best.
        jump_of_range: a travel jumps if it moves by this fraction of its range between two samples, and ...
        jump_of_usual: ... by this many times the middle step of those around it: no mass moves so.
        jump_reach: number of steps on either side that are around it.
        span_m: no bench moves farther or less far, so a record with another travel has another unit ...
        span_n: ... and no bench has a larger or smaller force.
    """

    least_samples: int = 200
    turn: float = 0.1
    path_steps: int = 4
    above_floor: float = 10.0
    left_above: float = 0.1
    line: float = 20.0
    line_width: int = 31
    rate_factor: tuple[float, float] = (0.8, 1.25)
    rate_correlation: float = 0.9
    driving_correlation: float = 0.1
    coarsest: float = 3e-3
    jump_of_range: float = 0.05
    jump_of_usual: float = 8.0
    jump_reach: int = 8
    span_m: tuple[float, float] = (1e-12, 1e3)
    span_n: tuple[float, float] = (1e-15, 1e12)


@dataclass(frozen=True)
class MemorySettings:
    """When a dependence of the force on the past is significant.

    Args:
        plays: half-widths of the plays over the amplitude of the travel.
        lags: time constants of first-order lags, over the time in which the motion turns.
        neighbours: numbers of neighbours that are tried for the static prediction; the first one also predicts the
            signals of the past.
        neighbours_with_past: number of neighbours if a signal of the past is a third axis.
        fraction_of_rest: the past is significant only if it explains this fraction of the residual of the law ...
        fraction_of_force: ... and this fraction of the variance of the force ...
        evidence: ... with this gain of twice the log likelihood, in independent samples.
        n_changes: number of half periods over the record in the quickest change of stiffness and damping with time.
        changed_of_rest: such a change is significant only if it explains this fraction of the residual of the law: a
            law with a wrong shape leaves less of it that follows time alone.
        foretold: memory cannot be tested if travel and velocity predict this fraction of the signals of the past.
        n_paces: the acceleration is split into this many parts from slow to quick ...
        mass_agreement: ... and a force that follows it is that of moving parts if their coefficients differ by less
            than this fraction.
        ridge: penalty of the regression on the past, over the squared norm of its columns, which are nearly parallel.
    """

    plays: tuple[float, ...] = (0.01, 0.03, 0.1, 0.2, 0.4, 0.7)
    lags: tuple[float, ...] = (0.1, 0.3, 1.0, 3.0)
    neighbours: tuple[int, ...] = (8, 32, 128)
    neighbours_with_past: int = 16
    fraction_of_rest: float = 0.1
    fraction_of_force: float = 0.001
    evidence: float = 10.0
    n_changes: int = 16
    changed_of_rest: float = 0.5
    foretold: float = 0.98
    n_paces: int = 3
    mass_agreement: float = 0.15
    ridge: float = 1e-3


@dataclass(frozen=True)
class SimulationSettings:
    """How a law is refined by simulation of the motion from the force.

    Args:
        n_laws: number of laws of the force search that are refined, the most likely ones: the noise of an acceleration
            favours laws that are not those of the motion.
        white: no other law is refined after one whose residual has this fraction of independent samples: it is noise.
        steps_per_sample: first and largest number of time steps for each sample: more are taken if a memory turns over
            within a step.
        tolerance: the search ends when the squared error changes by a smaller fraction.
        most_evaluations: most simulations with other parameters, without those for derivatives.
        difference: change of a parameter for a derivative, over its size.
        farthest: factor by which a mass or a scale may differ from its value in the fit to the force.
        runaway: largest simulated travel over the largest recorded one; a motion beyond is taken as unbounded: its
            numbers are still finite (1e107 m), but not their squares.
    """

    n_laws: int = 4
    white: float = 0.5
    steps_per_sample: tuple[int, int] = (4, 32)
    tolerance: float = 1e-7
    most_evaluations: int = 40
    difference: float = 1e-4
    farthest: float = 10.0
    runaway: float = 1e6


@dataclass(frozen=True)
class CalibrationSettings:
    """What is believed of a bench whose study states no tolerance, and when a record contradicts it.

    Args:
        samples_of_lag: lag of the force, in samples, whose square is added to that of `USUAL_LAG_TOLERANCE_S`: a
            recorder that reads its channels one after the other sets them up to a sample apart.
        corner_per_s: corner, rad/s, of the high-pass filter that a channel may have: a piezoelectric force cell forgets
            a constant force within minutes.
        mass_per_force: mass between force cell and specimen over the largest force, kg/N: rod ends and adapters
            weigh a hundredth of the force that they are made for.
        least_seen: part of a lag or a mass that the law cannot imitate, as a fraction of its force, below which the
            record says nothing of it.
        above_noise: ... or below this multiple of what the noise of the force makes of it: a lag that noise tells with
            its own rate is found too small by a hundredth where it is ten times as large.
        ringing: periods of the highest frequency of a rate for which it is not exact at an end of the record, where
            what follows is not known: beside a linear law, a lag of a sine was told by the ends alone ...
        longest_end: ... but at most this fraction of the record.
        told_sigma: standard deviations from zero at which a lag or a mass that the record shows is told, and at which
            the record is believed in the place of the tolerance: chance does that once in 16,000 records.
        told_of_tolerance: ... if it is also this multiple of its tolerance.
        lag_moves: part of its standard deviation by which a lag moves at most between two passes when it is found: to
            first order, one of 2 ms in a motion of 12 Hz was 10 % too long.
        most_lag_passes: passes after which the lag is that of the last; lags of 10 ms needed eight.
        left_above: `RecordSettings.left_above` where the force is differentiated for its lag: none of its rate is left
            out, because weak harmonics tell the lag of a sine.
        as_well: a law that does not lag, with a late force, is as likely as one that lags if it leaves at most this
            multiple of the variance: where only a friction lagged, laws without it left twenty times as much, and ...
        nearly: ... if the lag exceeds its tolerance, what it leaves may be more by this fraction of the force: a filter
            delays each frequency by another time.
    """

    samples_of_lag: float = 0.5
    corner_per_s: float = 0.01
    mass_per_force: float = 1e-3
    least_seen: float = 1e-6
    above_noise: float = 10.0
    ringing: float = 6.0
    longest_end: float = 0.1
    told_sigma: float = 4.0
    told_of_tolerance: float = 2.0
    lag_moves: float = 0.1
    most_lag_passes: int = 20
    left_above: float = 0.0
    as_well: float = 5.0
    nearly: float = 2e-3


def _search() -> SearchSettings:
    """Return the settings of the search on a bench, where fits take little time and only one channel has noise.

    They differ from those for driven models: an error margin of 1 %, because a term that lowers the error by less only
    corrects the shape of another one; scales over the whole visible range, and more lags, because a record may have
    been made at any of them; a margin for inner parameters, because of laws that fit alike the simpler one is taken;
    and an error of 20 % of the ranking, because the noise is so low that the coarse grid of scales matters.
    """
    return SearchSettings(
        n_scales=8,
        bic_margin=10.0,
        error_margin=0.01,
        inner_margin=10.0,
        first_order_error=0.2,
        n_refitted=6,
        most_terms=4,
        n_neighbours=6,
        scale_fractions=(0.0, 1.0),
        lags=(0.1, 0.3, 1.0, 3.0, 10.0),
    )


@dataclass(frozen=True)
class BenchSettings:
    """All settings of the test bench.

    Args:
        record: how the record is prepared.
        search: how the law is searched.
        separable: ranges in which inner parameters are searched.
        memory: when a dependence on the past is significant.
        simulation: how a law of moving parts is refined.
        calibration: what is believed of gains, lag and mass between force cell and specimen.
        gas: pressures at which struts are serviced; the settings of a carried weight are not used on a bench.
        n_search: number of samples in the search; the chosen law is fitted to all.
        steps_per_rms: the search follows memories in steps in which the rms velocity covers the rms travel divided by
            this number: some two hundred steps in a cycle, however fast a slow motion was sampled.
        n_stretches: number of stretches of time that are left out in turn ...
        n_folds: ... in this many turns: with several stretches in a turn no strong event is in a single turn alone.
        n_left_out: number of the most likely laws with memory, and of those without, whose left-out error is computed
            for the report.
        left_out_tolerance: relative tolerance at which a fit without a turn ends: it begins at the fit to all samples,
            and only its prediction is used.
        restart_scales: the chosen memory is fitted once more from these multiples of its scales, because each set of
            sliders that slip has a minimum of its own.
        largest_column: a law whose force at an amplitude of 1 exceeds this somewhere is not defined on the motion: the
            numbers are still finite, but not their squares.
        exponents: exponents at which a power is tried before its exponent is searched.
        least_r2: a law that explains a smaller fraction of the force on stretches left out explains nothing.
        least_static_r2: if the past is significant and no law explains this fraction of the force, there is no law.
        missing_r2: fraction of the force, and ...
        missing_of_rest: ... of the residual of the law, from which a shape that the library lacks is worth a warning.
        most_cancelled: a stiffness or damping whose force is more than this many times that of the whole law is
            cancelled by a term that has a slope as well: springs side by side carry a part of the force each, and only
            a fit makes one pull against the other.
        widest_sine: a motion is a sine if its rms travel times its rms acceleration over the square of its rms velocity
            is less: that is 1.00 for a sine, also for one that grows, and 1.4 for 4 mm at 1 Hz with 3 mm at 3 Hz.
        forgotten: the last fit begins where the initial value of a memory has faded to this fraction of its force.
        slips: a joint of sliders has no intervals if its last slider slips beyond this fraction of the range of the
            motion: it slips seldom, and is otherwise a spring.
        cells_per_correlation: scores are added up over cells of this many independent samples ...
        cells: ... but the record has at least and at most these numbers of cells.
    """

    record: RecordSettings = field(default_factory=RecordSettings)
    search: SearchSettings = field(default_factory=_search)
    separable: SeparableSettings = field(default_factory=SeparableSettings)
    memory: MemorySettings = field(default_factory=MemorySettings)
    simulation: SimulationSettings = field(default_factory=SimulationSettings)
    calibration: CalibrationSettings = field(default_factory=CalibrationSettings)
    gas: GasSettings = field(default_factory=GasSettings)
    n_search: int = 5000
    steps_per_rms: float = 30.0
    n_stretches: int = 30
    n_folds: int = 10
    n_left_out: int = 6
    left_out_tolerance: float = 1e-4
    restart_scales: tuple[float, ...] = (0.7, 1.0, 1.4)
    largest_column: float = 1e100
    exponents: tuple[float, ...] = (0.15, 0.4, 0.7, 1.5, 2.5, 3.5, 5.0)
    least_r2: float = 0.02
    least_static_r2: float = 0.5
    missing_r2: float = 0.002
    missing_of_rest: float = 0.1
    most_cancelled: float = 3.0
    widest_sine: float = 1.1
    forgotten: float = 0.01
    slips: float = 0.25
    cells_per_correlation: float = 8.0
    cells: tuple[int, int] = (20, 200)


DEFAULTS = BenchSettings()
