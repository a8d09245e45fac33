"""The tuned numbers of nonlinear modal models, each with its reason; what users choose stands in `study`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ModalThresholds:
    """Where bands, fits and decays of modes end, and what is refused or warned of.

    Args:
        most_condition: of the shapes, above which noise of other coordinates dominates (the paper accepts 9).
        most_damping: of a bolted structure: if every elastic mode has more, the numbers are percent.
        shift_sigma: standard errors by which a shift with the level must exceed its threshold: chance alone does that
            once in 370 times.
        least_level_ratio: highest amplitude over the lowest, below which the levels do not show whether a mode is
            nonlinear.
        searched: fraction of the natural frequency to either side that is searched (the paper's modes shifted by 7 %).
        level_half_widths: the band of a level ends so many zeta f from the peak: noise and other modes dominate beyond.
        fewest_lines: of such a band, which has to give three coefficients and two noise levels.
        least_peak: third strongest line of a band over the median line of the record, below which no mode is seen.
        quiet_fraction: of the mean power, in the quietest quarter: noise falls below it once in 80 times at most.
        not_decayed: of the peak, at the end of a record: above it the unknown end state gets terms of its own.
        widest_band: ends of the widest band of a mode, in natural frequencies.
        to_neighbour: fraction of the way to a neighbour, where the band ends at the latest: the modal filter leaves
            little of the neighbour, and the frequency of a nonlinear mode moves there.
        half_widths: half-power bandwidths on either side of the natural frequency that the band always holds.
        least_line: of the largest line of the modal acceleration: what is below it holds nothing of the mode.
        least_signal: force or motion in the band over its noise, rms, that a test needs.
        most_left: of the largest motion, at an end of a record that is to begin and end at rest: refused above ...
        warned_left: ... and warned of above this.
        third_harmonic: natural frequencies that a record holds at least, for the third harmonic with some of its width.
        part_of_largest: a mode without tests of its own is fitted to those that reach this fraction of its largest
            amplitude.
        most_outside: rms fraction of the motion that no shapes make: refused above ...
        warned_outside: ... and warned of above this.
        least_answer: of the motion of the mode under test, rms of modal accelerations: what another mode must reach to
            be named as coupled.
        most_driven: of that motion: what the force may have driven by itself, for a shaker has harmonics, too.
        most_column_condition: of the scaled columns, beyond which the tests cannot tell the powers apart.
        parsimony: fraction of the error that a further power must save on tests that were left out.
        n_blocks: parts of a band that are left out in turn where there are fewer than three tests.
        mass_range: modal mass that tests may show; outside it, shapes or force have another unit.
        warned_mass: departure of the modal mass from 1 that is warned of.
        widest_force: half width of a force curve's band where it ends, over the force: wider, the orders are too high.
        most_unexplained: of the modal force: what a fit may leave without a warning.
        extrapolated: times the largest amplitude fitted: a truth test that goes further asks the polynomials to
            extrapolate.
        most_missed: of the motion of a sensor, rms, that the model may miss in a truth test before it is warned of.
        above_modes: times the highest natural frequency: in a truth test, what is faster belongs to modes that the
            models do not have.
        below_modes: times the lowest elastic one: what is slower is offset and drift of the sensors.
        fewest_cycles: of a decay: with fewer, neither frequency nor damping can be found as functions of the amplitude.
        kernel_cycles: length of the Hann kernel that gives the first envelope.
        after_peak_cycles: an impact is over by then: a hammer that drives a mode at all touches for less than half of
            its period.
        impact_rise: peak over what was before, from which on a record holds an impact and not the end of a dwell.
        next_impact_rise: rms of a cycle over that of each of the three before it, at which the next impact has come.
        clipped_samples: successive samples at the largest value that make a record clipped.
        fewest_window_cycles: of the mode in a window, for frequency and damping beside an offset and a trend.
        fewest_windows: of a decay that gives a curve over the amplitude.
        most_windows: of a decay: its fit takes the covariance of all of them.
        window_decay: decay of the log-amplitude in a window, where nothing else sets its length.
        resolved: window length times distance of two frequencies from which a Hann window separates them.
        smallest_signal: amplitude over its standard deviation at which the decay has reached the noise.
        longest_decay: largest decay of the log-amplitude in a window that has to separate neighbours.
        most_neighbours: frequencies beside the mode that are looked for.
        highest_neighbour: in frequencies of the mode: the taper of the windows keeps out what lies beyond.
        smallest_neighbour: of the mode's peak, from which on a neighbour is fitted.
        unresolved: of the mode's peak, from which on a neighbour is reported that is too close to be fitted.
        least_range: largest amplitude over the smallest, below which nonlinear terms are warned of.
        drift_error: fraction to which the drift of the frequency is known: it is that of a smooth curve.
        most_misfit: misfit of the law of a decay, in standard deviations, that is not warned of.
        most_residual: rms of the residual over the record, above which the first quarter of a decay is left out.
        beating: largest part of the wiggle of frequency and damping at one period, in standard deviations, that is
            still noise.
        unsteady: of the fundamental: where it wanders more than this from period to period, the response is not
            periodic.
        settling: time constants 1 / (zeta omega) that the first level waits before the loop is closed: what the sudden
            start excites in all modes must be gone, or the loop follows it.
        widest_range: of the natural frequency: the farthest that the loop moves to either side unless a range is given.
    """

    most_condition: float = 30.0
    most_damping: float = 0.2
    shift_sigma: float = 3.0
    least_level_ratio: float = 1.5
    searched: float = 0.1
    level_half_widths: float = 8.0
    fewest_lines: int = 16
    least_peak: float = 4.0
    quiet_fraction: float = 0.15
    not_decayed: float = 0.02
    widest_band: tuple[float, float] = (0.6, 1.5)
    to_neighbour: float = 0.8
    half_widths: float = 4.0
    least_line: float = 0.01
    least_signal: float = 3.0
    most_left: float = 0.05
    warned_left: float = 0.01
    third_harmonic: float = 3.1
    part_of_largest: float = 0.1
    most_outside: float = 0.5
    warned_outside: float = 0.1
    least_answer: float = 0.3
    most_driven: float = 0.3
    most_column_condition: float = 1e6
    parsimony: float = 0.01
    n_blocks: int = 5
    mass_range: tuple[float, float] = (0.5, 2.0)
    warned_mass: float = 0.05
    widest_force: float = 0.3
    most_unexplained: float = 0.5
    extrapolated: float = 1.1
    most_missed: float = 0.3
    above_modes: float = 1.25
    below_modes: float = 0.3
    fewest_cycles: int = 10
    kernel_cycles: int = 6
    after_peak_cycles: float = 0.75
    impact_rise: float = 2.5
    next_impact_rise: float = 3.0
    clipped_samples: int = 3
    fewest_window_cycles: float = 6.0
    fewest_windows: int = 4
    most_windows: int = 160
    window_decay: float = 0.6
    resolved: float = 2.5
    smallest_signal: float = 5.0
    longest_decay: float = 3.0
    most_neighbours: int = 6
    highest_neighbour: float = 10.0
    smallest_neighbour: float = 0.005
    unresolved: float = 0.1
    least_range: float = 1.5
    drift_error: float = 0.1
    most_misfit: float = 3.0
    most_residual: float = 0.5
    beating: float = 4.0
    unsteady: float = 0.02
    settling: float = 3.0
    widest_range: float = 0.15


MODAL = ModalThresholds()
