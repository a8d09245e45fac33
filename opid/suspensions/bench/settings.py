"""Every number of the test bench that somebody tuned, with its reason: pass another `BenchSettings` to change one."""

from __future__ import annotations

from dataclasses import dataclass, field

from opid.suspensions.fitting.least_squares import SeparableSettings
from opid.suspensions.settings import GasSettings, SearchSettings


@dataclass(frozen=True)
class RecordSettings:
    """How a record is taken, and when it is doubted.

    Args:
        least_samples: a shorter record shows no law.
        turn: a travel has turned round where it went back by this fraction of its range.
        path_steps: steps that the path of a quasi-static test is cut into, for each of its samples: a memory is
            followed through turns that fall between two samples.
        above_floor: a travel is differentiated up to where its spectrum last stands this many times above its floor.
        left_above: or up to where the spectrum of the rate is lowest, if less than this fraction of its power lies
            above.
        rate_factor: a recorded velocity is the rate of the travel if it is between these multiples of it ...
        rate_correlation: ... and correlates with it at least so well.
        driving_correlation: a force that feeds power into the motion with this correlation has the wrong sign.
        most_m: no bench moves so far, so a record that does is in another unit ...
        most_n: ... and none pushes so hard.
    """

    least_samples: int = 200
    turn: float = 0.1
    path_steps: int = 4
    above_floor: float = 10.0
    left_above: float = 0.1
    rate_factor: tuple[float, float] = (0.8, 1.25)
    rate_correlation: float = 0.9
    driving_correlation: float = 0.1
    most_m: float = 1e3
    most_n: float = 1e12


@dataclass(frozen=True)
class MemorySettings:
    """When the past counts as seen in a force.

    Args:
        plays: half-widths of the plays over the amplitude of the travel.
        lags: of first-order lags, over the time in which the motion turns.
        neighbours: numbers of neighbours that the static prediction is tried with; the first one also predicts the
            signals of the past.
        neighbours_with_past: neighbours where a signal of the past is a third axis.
        fraction_of_rest: the past is seen only if it explains this fraction of the residual of the law ...
        fraction_of_force: ... and this fraction of the variance of the force ...
        evidence: ... with this gain in the log likelihood, counted twice, in independent samples.
        foretold: memory cannot be tested where travel and velocity predict this fraction of the signals of the past.
        n_paces: the acceleration is cut into so many parts from slow to quick ...
        mass_agreement: ... and a force that follows it is that of moving parts if their coefficients differ by less
            than this fraction.
        ridge: penalty of the regression on the past over the size of its columns, which are nearly parallel.
    """

    plays: tuple[float, ...] = (0.01, 0.03, 0.1, 0.2, 0.4, 0.7)
    lags: tuple[float, ...] = (0.1, 0.3, 1.0, 3.0)
    neighbours: tuple[int, ...] = (8, 32, 128)
    neighbours_with_past: int = 16
    fraction_of_rest: float = 0.1
    fraction_of_force: float = 0.001
    evidence: float = 10.0
    foretold: float = 0.98
    n_paces: int = 3
    mass_agreement: float = 0.15
    ridge: float = 1e-3


@dataclass(frozen=True)
class SimulationSettings:
    """How a law is refined by the motion that it makes of the force alone.

    Args:
        n_laws: laws of the force search that are refined, the most likely ones: the noise of an acceleration favours
            laws that are not those of the motion.
        white: no other law is refined after one that leaves independent samples to this fraction: noise alone.
        steps_per_sample: of the time integration, to begin with and at the most: more are taken where a memory turns
            over within a step.
        tolerance: the search ends when the squared error changes by a smaller fraction.
        most_evaluations: simulations with other parameters, those for derivatives not counted.
        difference: by which parameters are changed for a derivative, over their size.
        farthest: factor by which a mass or a scale may move away from where the force has it.
        runaway: largest simulated travel over the largest recorded one; a motion beyond has no bound: its numbers are
            finite still (1e107 m), but not their squares.
    """

    n_laws: int = 4
    white: float = 0.5
    steps_per_sample: tuple[int, int] = (4, 32)
    tolerance: float = 1e-7
    most_evaluations: int = 40
    difference: float = 1e-4
    farthest: float = 10.0
    runaway: float = 1e6


def _search() -> SearchSettings:
    """The search on a bench: fits cost little, so more of them are made, and what is left is the noise of one channel.

    Against the search on driven models: an error margin of 1 %, for a term that lowers the error by less corrects the
    shape of another one; scales over all of the range in which they can be seen, and more lags, for a record may have
    been made at any; a margin for inner parameters, for of laws that fit alike the plainer one is taken; and the
    columns are trusted to 20 % of the error only, for noise is so low that it shows how coarsely scales are tried.
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
    """All of them.

    Args:
        record: how the record is taken.
        search: for the law.
        separable: where inner parameters are searched.
        memory: what counts as memory.
        simulation: how a law of moving parts is refined.
        gas: with what pressure struts are serviced; what carries a weight is not asked on a bench.
        n_search: samples that the search looks at; the chosen law is fitted to all.
        steps_per_rms: the search follows what is remembered in steps in which the rms velocity covers one part in so
            many of the rms travel: some two hundred steps in a cycle, however fast a slow motion was sampled.
        n_stretches: stretches of time that are left out by turns ...
        n_folds: ... in so many turns: with several stretches a turn no strong event falls into one turn alone.
        n_left_out: number of the most likely laws with memory, and of those without, whose stretches are left out for
            the report.
        left_out_tolerance: relative tolerance at which a fit without a turn ends: it begins at the fit to all samples,
            and only its prediction counts.
        restart_scales: the chosen memory is fitted once more from these multiples of its scales, because each set of
            sliders that slip makes a minimum of its own.
        exponents: at which a power is tried, before it is searched.
        least_r2: a law that explains a smaller fraction of the force where it was left out explains nothing.
        least_static_r2: where the past is seen and no law explains this fraction of the force, there is no law.
        missing_r2: fraction of the force, and ...
        missing_of_rest: ... of what the law leaves, from which a shape that the library lacks is worth a warning.
        forgotten: the last fit begins where the start of a memory has faded to this fraction of its force.
        slips: a joint of sliders has no intervals where the last one slips beyond this fraction of the range of the
            motion: it slips seldom, and is a spring between.
        cells_per_correlation: scores are added up over cells of so many independent samples ...
        cells: ... but the record has at least and at most so many cells.
    """

    record: RecordSettings = field(default_factory=RecordSettings)
    search: SearchSettings = field(default_factory=_search)
    separable: SeparableSettings = field(default_factory=SeparableSettings)
    memory: MemorySettings = field(default_factory=MemorySettings)
    simulation: SimulationSettings = field(default_factory=SimulationSettings)
    gas: GasSettings = field(default_factory=GasSettings)
    n_search: int = 5000
    steps_per_rms: float = 30.0
    n_stretches: int = 30
    n_folds: int = 10
    n_left_out: int = 6
    left_out_tolerance: float = 1e-4
    restart_scales: tuple[float, ...] = (0.7, 1.0, 1.4)
    exponents: tuple[float, ...] = (0.15, 0.4, 0.7, 1.5, 2.5, 3.5, 5.0)
    least_r2: float = 0.02
    least_static_r2: float = 0.5
    missing_r2: float = 0.002
    missing_of_rest: float = 0.1
    forgotten: float = 0.01
    slips: float = 0.25
    cells_per_correlation: float = 8.0
    cells: tuple[int, int] = (20, 200)


DEFAULTS = BenchSettings()
