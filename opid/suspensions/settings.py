"""Every number of the estimator that somebody tuned, with its reason: pass another `Settings` to change one.

The values are printed in each result, so that an answer can be traced to them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

METHODS = ("model", "classical", "paper")
"""Of identification: the driven model, the mended chain of the paper, its printed formula."""

METHODS_OF_LAW = ("pursuit", "sparse regression", "both")
"""Of searching the law of the driven model."""


@dataclass(frozen=True)
class Verdicts:
    """House-wide thresholds, on a residual over the noise that is known beforehand unless something else is said.

    Args:
        explained: up to here the model explains the runs; estimated noise floors scatter by a tenth.
        noted: above this a single gear's residual is worth a warning.
        doubtful: above this what the model lacks rules the answer.
        refused: above this laws and faults are searched only where they promise much, and no number is told of a body
            on several suspensions, of a user's own structure, or by the classical chain.
        refused_fraction: a doubtful model is refused where its free motion leaves more than this fraction of the
            body's rms acceleration: less than a third of the power is then explained.
        loosely_known: a value whose standard deviation is a larger fraction of it is not determined.
    """

    explained: float = 1.2
    noted: float = 1.5
    doubtful: float = 3.0
    refused: float = 20.0
    refused_fraction: float = 0.8
    loosely_known: float = 0.25


@dataclass(frozen=True)
class RunSettings:
    """How runs are prepared and what is known of them beforehand.

    Args:
        band_hz: lines of the prediction errors that are compared: below, sensors drift; above, struts answer little.
        highest_fraction: lines above this fraction of the rate are not compared: filters of loggers end there.
        lowest_rate_hz: below, a step of the model a sample is too coarse; such runs are sampled finer ...
        rate_over_band: ... and this times the highest line that is asked for is enough: a building that is compared up
            to 8 Hz need not be followed as a gear is.
        least_lines: a band of fewer lines tells nothing.
        stop_db: what the steps of a coarse run would fold into the band is weakened by this.
        stop_width: the filter that does so falls over this fraction of the coarse rate.
        least_noise_fraction: no model of a strut is better than this fraction of the motion, however quiet the sensor.
        most_noise_fraction: what a model leaves of a low-pass filtered log may be the noise of its sensor up to this
            fraction of the motion; sensors that read no more than ten times their noise are not taken to such tests.
        offset_m_per_s2: offset that is left in an acceleration once its mean is removed.
        offset_ac_m_per_s2: the same of an AC-coupled sensor, which forgets more.
        start_rms: a record may begin this many rms motions from rest, one standard deviation.
        start_displacement_m: the ground below an AC-coupled sensor at the start, one standard deviation.
        start_velocity_m_per_s: its velocity, likewise.
        ground_drift_m: how far the ground below a suspension lies from its mean height while a run lasts. A spring to
            the ground needs the place of the body, which no accelerometer tells; left free, a wrong law carries it off
            by metres and is never found out. Ten times what a taxiway does.
        ground_drift_paths: the same in multiples of what a parabola leaves of the measured path: on a hill more may be
            hidden in its offset than on the flat.
        least_s: three periods of the slowest motion that is compared.
        reduced_above_hz: runs from files that are sampled faster are reduced, unless the study gives `fs_hz`: time is
            spent on every sample, and the band ends far below ...
        reduced_to_hz: ... by a whole number, to no less than this rate.
        coherence_s: blocks by which it is told what goes along with the motion below, s.
    """

    band_hz: tuple[float, float] = (0.3, 40.0)
    highest_fraction: float = 0.4
    lowest_rate_hz: float = 250.0
    rate_over_band: float = 6.25
    least_lines: int = 20
    stop_db: float = 60.0
    stop_width: float = 0.1
    least_noise_fraction: float = 0.003
    most_noise_fraction: float = 0.1
    offset_m_per_s2: float = 0.03
    offset_ac_m_per_s2: float = 0.1
    start_rms: float = 2.0
    start_displacement_m: float = 0.05
    start_velocity_m_per_s: float = 0.3
    ground_drift_m: float = 0.02
    ground_drift_paths: float = 4.0
    least_s: float = 10.0
    reduced_above_hz: float = 1100.0
    reduced_to_hz: float = 500.0
    coherence_s: float = 2.0


@dataclass(frozen=True)
class StartSettings:
    """The equation of motion on integrated accelerations that start values come from.

    Args:
        band_hz: of the equation: integration is sound there, and a suspension answers.
        high_pass_hz: corner of the integration.
        least_fraction: a term must explain this fraction of what is left.
        most_terms: of a law that the fit begins with.
        n_scales: inner scales at which a term is tried ...
        scale_fractions: ... between these fractions of the range, in logarithmic steps, in which a scale can be seen:
            the least is friction that is full at once, the largest what hardly bends.
        ground_fraction: a fit begins with a ground spring where the equation finds one above this fraction of K ...
        ground_std: ... and above this many standard deviations.
        lag_std: a delay with a stated tolerance is looked for within so many of it ...
        n_lags: ... on a grid of so many values ...
        lag_rounds: ... and so many times, each from one value of the last grid to the next, ...
        lag_fraction: ... in the band from this fraction of the highest line up to it.
    """

    band_hz: tuple[float, float] = (0.5, 12.0)
    high_pass_hz: float = 0.3
    least_fraction: float = 0.08
    most_terms: int = 2
    n_scales: int = 5
    scale_fractions: tuple[float, float] = (0.28, 0.98)
    ground_fraction: float = 0.03
    ground_std: float = 5.0
    lag_std: float = 2.5
    n_lags: int = 11
    lag_rounds: int = 2
    lag_fraction: float = 0.1


@dataclass(frozen=True)
class FitSettings:
    """How the vector is moved until the prediction errors are least.

    Args:
        noisier: falling factors on the noise below the suspensions by which a fit comes nearer from afar: the readings
            then hold the motion to the truth while the parameters are still wrong. The second way is taken where the
            first leaves too much, for minima beside the right one differ from way to way.
        start_reach_rms: the start of a run of one gear is looked for within this many rms motions ...
        n_start_grid: ... on a grid of so many points along travel and velocity ...
        start_rounds: ... all of which are predicted for the first of these times, s, then the best so many for longer.
        most_evaluations: predictions of all runs in a fit from start values.
        most_refit_evaluations: in a fit that begins near its end.
        mass_fractions: the largest loading lies between these fractions of the mass, where a fit begins with the runs
            without loading alone ...
        n_mass_fractions: ... and so many are tried.
        usual_mass_fraction: of the mass is a usual loading; it says about how far apart runs rest, and so how long the
            scales of their laws may be. A gear with a scale of 3.8 rms travels whose runs rest four apart was held at 3
            and told 17 % too heavy.
        hopeless_piece_s: while a fit leaves more than is likely to be mended, ways are tried on a piece of this length
            of each run, s; it is longer where the lowest line has not four periods in it.
        most_hopeless_evaluations: with all readings, in a fit that leaves much more than noise: it ended at a coarse
            rate.
        least_promise: a fit ends when the next step promises less of the squared error over its variance.
        promise_in_search: the same while laws are searched, and in fits of all runs but one.
        promise_from_afar: the same while the noise is exaggerated.
        negligible_promise: where the last step promises less, the errors before it are those after it: it moves no
            parameter by more than three hundredths of its standard deviation.
        largest_log_step: how far the logarithm of a positive entry moves in a step.
        farthest_std: coordinates and faults of sensors are not looked for farther from what is known of them.
        slide_beyond: the travel after which a friction that remembers slides is fitted up to this many times the
            longest that a search offers: one of 13 rms travels, held at 3, left 4 times the noise and a stiffness 33 %
            off.
        held_fraction: while a fit comes from afar, tolerances of coordinates, and of what carries the weight, are
            multiplied by this: they are not to make up for what is still wrong.
        fastest: a motion of this rate times its length is put off by two parts in a thousand by a step.
        turnover_in_step: where a friction turns over at a larger rate times the length of a step, the found model is
            fitted with more steps to a sample: at 0.6 damping was off by seven standard deviations, at 0.2 by none.
        most_steps: to a sample, at the most.
        most_folded: power over that of the noise that a coarse rate may fold into the band.
        same_std: fits of one model whose parameters differ by at most so many standard deviations ended at one minimum.
        first_damping: damping of the step after one that failed, over the squared size of each column ...
        least_damping: ... and a smaller one is none: the step of Gauss and Newton is taken.
    """

    noisier: tuple[tuple[float, ...], ...] = ((100.0, 20.0, 4.0), (30.0, 5.0))
    start_reach_rms: float = 2.5
    n_start_grid: int = 9
    start_rounds: tuple[tuple[float, int], ...] = ((0.5, 16), (2.0, 1))
    most_evaluations: int = 50
    most_refit_evaluations: int = 15
    hopeless_piece_s: float = 12.0
    most_hopeless_evaluations: int = 4
    mass_fractions: tuple[float, float] = (0.01, 0.6)
    n_mass_fractions: int = 16
    usual_mass_fraction: float = 0.15
    least_promise: float = 1e-2
    promise_in_search: float = 1.0
    promise_from_afar: float = 10.0
    negligible_promise: float = 1e-3
    largest_log_step: float = 1.0
    farthest_std: float = 8.0
    slide_beyond: float = 7.0
    held_fraction: float = 1e-3
    fastest: float = 0.7
    turnover_in_step: float = 0.2
    most_steps: int = 8
    most_folded: float = 2.0
    same_std: float = 0.1
    first_damping: float = 1e-3
    least_damping: float = 1e-6


@dataclass(frozen=True)
class SearchSettings:
    """Which law.

    Args:
        n_scales: scales at which a kind is simulated, evenly in their logarithm over the range where it can be seen.
        n_between: columns between two simulated scales, by interpolation.
        faint: force of a candidate in the simulation, over the noise: too weak to move anything.
        largest_log_step: a scale is moved along its derivative by so much at most, about the way to the next one.
        nearly_parallel: a direction that others make up to this fraction of its square adds nothing.
        bic_margin: a larger law must lower the information criterion by this.
        error_margin: and the error by this fraction, shared out over the interfaces: below, a term mends what sensors
            did.
        inner_margin: a law of as many terms must lower the criterion by this for each inner parameter more: of laws
            that fit alike the plainer one is taken.
        first_order_error: the error that columns promise may be wrong by this fraction: laws are fitted that promise
            less than is asked for by so much.
        n_refitted: laws fitted in a round.
        n_rounds: at the most; in each the law may change by a step.
        most_terms: of the law of one suspension.
        most_exchanged: terms exchanged at once: each of two near relatives can hold the other in place.
        n_neighbours: rejected laws that are fitted for the reader.
        alike_bic: criteria that are closer do not tell two laws apart.
        surely_behind_bic: a law whose criterion is larger by more than this at a coarse rate is not tried again,
            neither at the full rate, which doubles the difference, nor for the reader: the departures of the runs,
            which are let go after the search, change differences by tens.
        far_fraction: a law that leaves this fraction more than the chosen one at a coarse rate is not tried again at
            the full rate. Of gears with memory, near relatives leave up to 0.0005 more and others 0.7 to 11.
        overfit_fraction: a law is too large only where a smaller one leaves at most this fraction more: a term too many
            mends a few per cent; laws that were wrongly given up left 5 and 11 times as much.
        good_fraction: where a fit would be refused, laws are tried only if the best of them promise to explain this
            fraction of the squared error, to first order: none mends what a wrong structure leaves. Of aircraft that
            bend, the best laws promise 1 to 6 %.
        scale_fractions: between which fractions of the range in which a scale can be seen, in its logarithm, scales are
            tried: at its lower end friction is a step, at its upper end a straight line.
        lags: at which a law of travel and velocity mixed is tried, over the ratio of their rms.
        most_measured_rms: scales are laid out over the predicted motion, and over this many times the measured one at
            the most: while a model is wrong, its slow travel may be far off.
        least_damping_std: beside a law that remembers damping must not be negative by more standard deviations.
        rest_fraction: a tangent stiffness at rest below zero by more than this fraction of its mean over the motion is
            that of no suspension: what rests there would fall away.
        farthest_mean_rms: a law beside a spring to the ground is about a rest that some run comes near, within so many
            rms travels of its mean: a law about 3.5 rms from there had 2.6 times the true stiffness, and an interval
            that did not hold.
        every_sample: the rms force of a candidate is taken of every sample but so many: it need be known roughly.
        least_shared: no law is searched for a gear of which less than this fraction of the body's power goes along
            with what is measured below it. Two channels of noise share 0.00 +- 0.02, gears that stick and slip most of
            it.
    """

    n_scales: int = 4
    n_between: int = 4
    faint: float = 1e-5
    largest_log_step: float = 0.5
    nearly_parallel: float = 1e-7
    bic_margin: float = 10.0
    error_margin: float = 0.005
    inner_margin: float = 0.0
    first_order_error: float = 0.0
    n_refitted: int = 3
    n_rounds: int = 8
    most_terms: int = 4
    most_exchanged: int = 2
    n_neighbours: int = 2
    alike_bic: float = 10.0
    surely_behind_bic: float = 100.0
    far_fraction: float = 0.1
    overfit_fraction: float = 0.2
    good_fraction: float = 0.1
    scale_fractions: tuple[float, float] = (0.4, 0.98)
    lags: tuple[float, ...] = (0.3, 1.0, 3.0)
    most_measured_rms: float = 3.0
    least_damping_std: float = 2.0
    rest_fraction: float = 0.1
    farthest_mean_rms: float = 2.0
    every_sample: int = 7
    least_shared: float = 0.05


@dataclass(frozen=True)
class OriginSettings:
    """Where else than at rest the origin of a law is looked for.

    Args:
        distances: of the origin from where a suspension rests, over how far straight springs of its tangent stiffness
            would give way under the body: a spring that stiffens gives way less far, one that softens farther.
        finer_reach: around the best of them the origin is looked for more finely, up to this factor away ...
        n_finer: ... at so many distances: what is begun with far off takes many steps along a valley.
        n_scales: of a kind, evenly in their logarithm.
        n_travels: at which forces are compared.
        n_fitted: laws that are fitted, those whose force is nearest.
        n_rounds: of looking for an origin, each from the better law of the one before.
        least_bend: a force that is straight over the travel but for this fraction is no law's.
        balance_std: of forces alike, the one is begun with that balances the weight to about this fraction.
    """

    distances: tuple[float, ...] = (0.25, 0.35, 0.5, 0.7, 0.85, 1.0, 1.2, 1.4, 2.0, 2.8)
    finer_reach: float = 1.4
    n_finer: int = 29
    n_scales: int = 12
    n_travels: int = 200
    n_fitted: int = 4
    n_rounds: int = 3
    least_bend: float = 1e-4
    balance_std: float = 0.2


@dataclass(frozen=True)
class GasSettings:
    """What is known of a column of gas that carries a gear.

    Args:
        carried: by how much its static force may differ from the weight and the push of the air on the piston,
            relative, and a spring beside it from none, over the stiffness of the gas: lift and seals carry about so
            much of a gear that taxies. Where the runs speak against it by much, they are believed.
        carried_unstated: the same where the area of the piston is not stated: the air pushes with 1 to 5 % of the
            weight, the more the lower the pressure of the gas.
        pressures_pa: gauge pressures with which struts are serviced, from light aircraft to large ones; others make the
            stated area of the piston doubtful.
        far_std: an exponent that lies this many standard deviations from what is known of it is no gas alone.
    """

    carried: float = 0.005
    carried_unstated: float = 0.02
    pressures_pa: tuple[float, float] = (3e5, 4e7)
    far_std: float = 2.0


@dataclass(frozen=True)
class RegressionSettings:
    """How sparse regression, the second method beside the search above, proposes laws.

    Args:
        n_samples: that the regression looks at.
        n_blocks: of time that are left out by turns.
        thresholds: coefficients, in fractions of the force that stiffness and damping leave, below which a term goes.
        relaxation: of SR3: how closely the sparse coefficients follow the others.
        block_margin: a larger law must lower the error of the blocks left out by this fraction.
        n_rounds: of alternating inner scales with the choice of terms.
        n_refitted: laws that are fitted by the model in a pass.
        n_passes: each regresses on the motion as the better model predicts it.
        most_terms: of a law.
    """

    n_samples: int = 6000
    n_blocks: int = 10
    thresholds: tuple[float, ...] = (0.02, 0.05, 0.1, 0.2, 0.4)
    relaxation: float = 1.0
    block_margin: float = 0.01
    n_rounds: int = 3
    n_refitted: int = 3
    n_passes: int = 4
    most_terms: int = 3


@dataclass(frozen=True)
class ProcessSettings:
    """How it is told whether a fit is limited by forces that nobody measured or by the model itself.

    Args:
        fractions: rms accelerations by unmeasured forces that are tried, over that of the readings: the least is where
            the readings begin to hold the motion, and beyond the largest nothing changes.
        corners: of its spectral density that are tried, over the highest line.
        bands_per_octave: in which the errors may have levels of their own ...
        least_lines: ... and lines that a band holds at least, so that its level is known to a fifth.
        n_rounds: of fitting and finding levels by turns, at the most.
        least_gain: the rounds end when the logarithm of the likelihood gains less.
        same_std: both fits agree where no parameter differs by more standard deviations: of true models with a force on
            the body that nobody measured, 0.2 to 0.7 were seen; of wrong ones 5 and more.
        same_std_of_body: the same of several suspensions, whose structure is judged by `least_coherent`: the largest of
            seven departures of 27 true models was 0.4 to 2.1.
        most_promised: a given law is not the strut's where another promises to explain more than this fraction of the
            squared error: a stop that one run hit, and the law had not, promised 0.23 to 0.43 and moved the mass by 5
            %; beside forces that nobody measured at most 0.001 was promised.
        most_left_by_simpler: a law of fewer terms is tried in place of one that takes up what the model lacks, and may
            leave so many times the rms error: an Iwan joint of six sliders in place of forty leaves 1.2 times what it
            does beside a damper, which only bends its numbers.
        surely_other_std: beyond so many no likelier process noise is looked for.
        piece_s: under a wrong model parameters are fitted to pieces of so many seconds, s, ...
        most_pieces: ... at most so many of a run.
        n_free_fits: so often the free motion is fitted, each run weighed by what the last fit left of it.
        least_coherent: a force that nobody measured leaves of several suspensions what goes along with nothing below
            them: of 27 true models with such a force and two runs of 20 s fractions of its power of -0.01 to 0.01 did;
            of fits in a wrong minimum 0.12 to 0.23, of a body that bends 0.9.
        most_coherent: laws are searched under process noise where less than this goes along: of a missing friction 0.1.
    """

    fractions: tuple[float, ...] = (0.03, 0.3)
    corners: tuple[float, ...] = (0.075, 0.75)
    bands_per_octave: float = 3.0
    least_lines: int = 12
    n_rounds: int = 4
    least_gain: float = 1.0
    same_std: float = 2.0
    same_std_of_body: float = 3.0
    most_promised: float = 0.05
    most_left_by_simpler: float = 1.5
    surely_other_std: float = 6.0
    piece_s: float = 20.0
    most_pieces: int = 3
    n_free_fits: int = 2
    least_coherent: float = 0.05
    most_coherent: float = 0.5


@dataclass(frozen=True)
class FaultSettings:
    """What the runs may demand beside the suspension: a spring to the ground, or faults of sensors nobody stated.

    Args:
        least_score: a score, chi-square of one degree of freedom under a sound model, below this is not looked at.
        bic_margin: the criterion must fall by this.
        error_margin: and the error by this fraction.
        alike_bic: explanations whose criterion is this close to the best one cannot be told from it.
        gain_tolerance: of a sensor nobody calibrated, relative.
        lag_samples: delay between channels of a multiplexing logger.
        corner_hz: of a usual AC coupling.
        corner_tolerance: of it, relative.
        slight_corner_hz: an AC coupling that is next to none. Scores are taken here, and no corner is looked for
            below: a sensor that is said to be AC-coupled may be none, however narrow the tolerance.
        least_corner_hz: AC coupling with all corners below is none: it only frees the offsets of the sensors, and mends
            what something else left.
        least_gain: no gain is looked for below this: a reading is divided by its gain.
        alone_fraction: runs said to be alike contradict each other where each alone leaves less than this fraction of
            what all together leave: a mass change that nobody stated, which faults of sensors would be let in for.
        ground_fraction: the equation speaks for a ground spring above this fraction of the stiffness: below, the noise
            biases it as much.
        sure_ground_std: springs to the ground that a fit began with, none of which is this many standard deviations
            from zero, may be none, and the fit without them is asked for. A spring that matters is known to a per cent.
        plausible_std: a fault that lies farther from what such sensors do may stand in for something else. AC coupling
            is let in all the same where less than `Verdicts.noted` is left.
        n_farther: so often such corners are looked for about those found: each time up to five times as high.
        helps_fraction: faults that do not yet explain the runs are kept only if the error falls by this fraction.
        coupling_helps: AC coupling is taken for granted in a first search for laws where it makes the error smaller by
            this fraction before any law is searched, and springs to the ground are left out: on five aircraft with
            couplings by 3.2 to 31 %, on others by 0 to 1.4 %, on four that bend by 1.6 to 2.4 %. In vain it costs time.
        nearly_explained: residual over noise below which faults that were let in are kept, and the noise of the two
            sides is told apart: the little that is left may be the law's.
        good_fraction: where a fit would be refused, faults are tried only if they promise to explain this fraction of
            the squared error, but for AC coupling. In an aircraft that bends gains promised 10 to 20 %, explained 4.
        most: faults let in.
        looked_at: hypotheses fitted in a round, those with the largest scores.
        contradicted_std: a stated fact that the fit moves by more standard deviations is contradicted by the runs.
    """

    least_score: float = 30.0
    bic_margin: float = 20.0
    error_margin: float = 0.002
    alike_bic: float = 10.0
    gain_tolerance: float = 0.03
    lag_samples: float = 2.0
    corner_hz: float = 0.25
    corner_tolerance: float = 0.5
    slight_corner_hz: float = 2e-4
    least_corner_hz: float = 2e-3
    least_gain: float = 0.2
    alone_fraction: float = 0.5
    ground_fraction: float = 0.005
    sure_ground_std: float = 20.0
    plausible_std: float = 5.0
    n_farther: int = 2
    helps_fraction: float = 0.3
    coupling_helps: float = 0.025
    nearly_explained: float = 2.0
    good_fraction: float = 0.2
    most: int = 3
    looked_at: int = 4
    contradicted_std: float = 3.0


@dataclass(frozen=True)
class RepeatabilitySettings:
    """How much alike runs are taken to be.

    Args:
        usual: relative standard deviation of springs, damping and friction from run to run where the study states
            none: seals settle, gas and oil warm up by some kelvins.
        doubt: the stated one is believed within this factor, one standard deviation of its logarithm: intervals then
            hold in 92 to 95 % of flights that differ as stated (`benchmarks/unlike_flights.py`), and in more below.
        reach: of the levels that are weighed, in powers of that factor: from far below what any data tell to where runs
            would contradict each other.
        n_levels: so many, about ten to a power of ten.
        bic_margin: runs that are let go are searched anew, law and faults of sensors, where that lowers the information
            criterion by this: what was found for runs that are alike may make up for what is not.
        farthest_std: no departure is looked for farther from none: runs that differ by more contradict each other.
        contradicted: the stated level is contradicted where the runs speak for more than this many times as much ...
        contradicted_weight: ... with this probability.
        rules_below: where the mass would be known to less than this fraction of its interval were all runs alike, it is
            the repeatability that rules it.
    """

    usual: float = 0.01
    doubt: float = 10.0
    reach: tuple[float, float] = (-3.5, 1.0)
    n_levels: int = 46
    bic_margin: float = 20.0
    farthest_std: float = 5.0
    contradicted: float = 2.0
    contradicted_weight: float = 0.9
    rules_below: float = 0.5


@dataclass(frozen=True)
class IntervalSettings:
    """How well the parameters are known, and what is said of it.

    Args:
        lines_per_cell: neighbouring lines that may be correlated: a mode of some per cent damping is so many lines of
            a 40 s run wide.
        white_below: Kolmogorov's statistic of the cumulative periodogram (Bartlett 1955) that white noise exceeds in
            1 of 1000 runs.
        n_bands: of the band in which a residual is looked at for where it stands out.
        bootstrap_s: blocks of time that are resampled.
        n_bootstrap: resamples: deviations by so many scatter by 7 %.
        equal_gains: no two sensors have gains more equal than this, and a gain error passes for a ground spring.
        largest_noise_ratio: the noise below and on the body differs at most so much.
        least_noise_gain: equal noise is kept unless another ratio raises the log likelihood by this.
        noise_probe: the logarithm of the ratio is moved by this to see whether another one would.
        widening_named: a fault of a sensor that widens an interval by this factor is named.
        alike_cosine: cosine between what two causes do to the errors above which one passes for the other.
        least_motion: a motion of less than this times the noise does not tell its inertia.
        far_std: a coordinate that moves by more standard deviations of its tolerance is named.
        negligible_ground: a ground spring below this fraction of K is not worth a warning.
        impossible_ground_std: a ground spring that is this many standard deviations below zero is none: something else
            pulls at the body. Noise alone makes two of them, and gains that differ as much as usual three.
        same_frequency: runs of one mass whose natural frequencies differ by more than this fraction are unlike.
        least_remainder: a run that keeps less than this fraction of the mass is a slip of the pen.
        softened: a joint inside of a structure is told if with this fraction of its spring and damper ...
        least_hold: ... the squared error over its variance grows by this: a resonance of its own always finds some
            noise to explain.
        imitating_gain: gain error whose likeness to a ground spring is told. This and the next ones are sizes that a
            reader can picture; what a fit may move is in `FaultSettings`.
        imitating_corner_hz: corner of the AC coupling of one sensor alone whose likeness is told.
        imitating_lag_s: lag between the channels whose likeness is told.
        imitating_slight_hz: where a sensor is not AC-coupled, the derivative by its corner is taken here.
    """

    lines_per_cell: int = 16
    white_below: float = 1.95
    n_bands: int = 10
    bootstrap_s: float = 0.5
    n_bootstrap: int = 100
    equal_gains: float = 0.001
    largest_noise_ratio: float = 10.0
    least_noise_gain: float = 4.0
    noise_probe: float = 0.3
    widening_named: float = 1.2
    alike_cosine: float = 0.7
    least_motion: float = 2.0
    far_std: float = 3.5
    negligible_ground: float = 0.002
    impossible_ground_std: float = 5.0
    same_frequency: float = 0.01
    least_remainder: float = 0.2
    softened: float = 0.01
    least_hold: float = 40.0
    imitating_gain: float = 0.01
    imitating_corner_hz: float = 0.1
    imitating_lag_s: float = 1e-3
    imitating_slight_hz: float = 1e-3


@dataclass(frozen=True)
class SurfaceSettings:
    """The force without a law, cell by cell.

    Args:
        n_cells: along each coordinate.
        reach_rms: cells reach this many rms motions.
        least_count: fewer samples than this tell nothing.
        section_rms: a section holds the motion within this many rms of the other coordinate.
        seen_std: a departure of more standard errors is seen.
    """

    n_cells: int = 16
    reach_rms: float = 3.0
    least_count: int = 20
    section_rms: float = 0.3
    seen_std: float = 3.0


@dataclass(frozen=True)
class WarningSettings:
    """When something is worth a warning. What is explained, doubtful or refused stands in `Verdicts`.

    Args:
        least_loading_kg: a scale that rests on a smaller loading may be in tonnes: nothing in the runs tells, for
            weight and the forces of any law go with the mass ...
        least_mass_kg: ... and so may one that gives a smaller mass: no gear carries more than 50 t. A small shaker rig
            is told one sentence too many.
        most_mass_of_gear_kg: a scale that gives one gear a larger mass may be in grams, likewise ...
        most_mass_kg: ... and so may one that gives a whole body more: the heaviest aircraft has 640 t.
        straight_rms: a term whose scale lies beyond this many rms motions is a straight line over what was visited ...
        usual_reach_rms: ... unless its kind is looked for beyond this many: a scale that may be long by nature bends
            within it all the same.
        least_way_to_slide: friction that remembers and slides after some travel is told from stiffness where the
            motion goes over more than this many times that travel: at 1.3 times its force was found a twelfth of what
            it was, with an interval of 5 %, at 2.2 times within its interval.
        turnover_between_samples: a friction that stops a motion at more than this many times the rate of the record is
            not told from damping: at 1.3 damping was off by five standard deviations, at 0.8 by two. The same holds
            for the presliding travels that a motion passes, on average, between two samples.
        memory_left: a law that remembers and leaves more than this many times the noise is not told from damping:
            where it stood for two memories it left 2.6 to 3, and damping was off by three to five standard deviations;
            a true one left up to 1.4.
        left_out_more: runs of one gear that the others predict are worth a warning where they leave this many times
            what the fit leaves.
        left_out_more_of_body: the same of a body, where it is told only once the structure does not explain the runs:
            a smaller excess then points to a run.
        least_of_stated_noise: white noise below this fraction of what is stated is worth a warning: a data sheet may
            state the worst specimen, but twice the noise hides what is twice as large.
        unlike_std: springs, damping or friction of two runs that differ by more standard deviations are named; of many
            comparisons some exceed three.
        as_one: where all of them changed by more than this many times what they differ by, it was the mass.
        slow_fraction: a residual below this fraction of the resonance is slow motion ...
        fast_fraction: ... and one above this multiple of it is another resonance.
        loose_mass: a mass change is worth doubling where the mass is known to no better than this, relative.
    """

    least_loading_kg: float = 5.0
    least_mass_kg: float = 50.0
    most_mass_of_gear_kg: float = 1e5
    most_mass_kg: float = 1e6
    straight_rms: float = 2.0
    usual_reach_rms: float = 3.0
    least_way_to_slide: float = 2.0
    turnover_between_samples: float = 1.0
    memory_left: float = 2.0
    left_out_more: float = 1.2
    left_out_more_of_body: float = 1.1
    least_of_stated_noise: float = 0.5
    unlike_std: float = 4.0
    as_one: float = 5.0
    slow_fraction: float = 0.6
    fast_fraction: float = 2.5
    loose_mass: float = 0.02


@dataclass(frozen=True)
class Settings:
    """All of them.

    Args:
        verdicts: what is called explained, doubtful and refused.
        runs: how runs are prepared.
        start: of the equation of motion that start values come from.
        fit: of the least squares.
        search: of laws.
        origin: of laws, where it is not where a suspension rests.
        gas: that carries a gear.
        regression: of laws, by the second method.
        process: noise that tells forces that nobody measured from what the model lacks.
        faults: that may be let in.
        repeatability: of the suspensions from run to run.
        intervals: and what is said of them.
        surface: of the force without a law.
        warnings: when something is worth one.

    >>> from dataclasses import replace
    >>> stricter = replace(Settings(), verdicts=Verdicts(refused=10.0))
    >>> stricter.verdicts.refused, stricter.fit == Settings().fit
    (10.0, True)
    """

    verdicts: Verdicts = field(default_factory=Verdicts)
    runs: RunSettings = field(default_factory=RunSettings)
    start: StartSettings = field(default_factory=StartSettings)
    fit: FitSettings = field(default_factory=FitSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    origin: OriginSettings = field(default_factory=OriginSettings)
    gas: GasSettings = field(default_factory=GasSettings)
    regression: RegressionSettings = field(default_factory=RegressionSettings)
    process: ProcessSettings = field(default_factory=ProcessSettings)
    faults: FaultSettings = field(default_factory=FaultSettings)
    repeatability: RepeatabilitySettings = field(default_factory=RepeatabilitySettings)
    intervals: IntervalSettings = field(default_factory=IntervalSettings)
    surface: SurfaceSettings = field(default_factory=SurfaceSettings)
    warnings: WarningSettings = field(default_factory=WarningSettings)
