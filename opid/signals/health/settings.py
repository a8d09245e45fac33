"""The tuned numbers of `inspect`, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class HealthSettings:
    """What counts as a fault of a clock or a channel, and what is only noteworthy.

    Args:
        crowded: fraction of the stamps that repeat the one before, above which the host's clock stamps bursts of rows
            and not samples.
        least_fs_hz: below this rate nobody records the vibration of a vehicle: the unit of the stamps is wrong, Hz.
        most_fs_hz: likewise above this rate, Hz.
        mute_values: a channel of so few distinct values is mute: a constant, or the last bit of a converter.
        clip_run: samples in a row at the extreme value that make a clipped peak. A smooth peak has one, by chance two.
        clip_crowding: how much fuller than the next level the extreme level of a quantised, clipped signal is. The
            rounded top of a coarsely quantised sine is about twice as full.
        least_peaks: from so many clipped peaks on a level is the end of the range although single samples, spikes, lie
            beyond it.
        flat_s: a value held for so long is no vibration of a machine in operation, s.
        most_spikes: spikes in a second that are still single ones, which a fit mends. More of them spoil the second.
        held_rows: samples beside a held value that are no spikes.
        drift_parts: number of parts of a record whose means show the drift.
        drift_part_s: least length of such a part, s: slow beside any motion of a vehicle on its springs.
        high_frequency_hz: this is above the bounce of a vehicle (1 to 3 Hz), where the suspension isolates the sprung
            side, Hz.
        coarse_steps: quantisation steps that an rms should have: at 5 the rounding, step/sqrt(12), is 6 % of it.
        offset_rms: an offset beyond this fraction of the rms is worth a note, for integrated twice it hides the motion.
        drift_rms: a drift beyond this fraction of the rms is worth a note.
        gravity_tolerance: how far from 1 g (relative) a mean still looks like gravity: a tilt of 18 degrees, an offset.
        most_gravities: a mean beyond so many g is not gravity on a sensor that is off its zero by a little.
        hum_rms: lines of a supply beyond this fraction of the rms may spoil the result; a fifth of it is worth a note.
        line_group: width of the groups of lines that are compared, over their frequency: a machine's speed wanders so
            much.
        usual_groups: groups whose median is what is usual there.
        near_groups: groups whose median a line exceeds as well: on the flank of a resonance it is the higher one.
        line_ratio: a line stands at least so far above the median of its neighbours.
        line_chance: probability that noise makes one such line anywhere in a spectrum, shared by all groups that are
            looked at. It takes 20 times the median in a single periodogram, less in a mean of many.
        line_width: how far the spectrum has fallen three to five groups off. That is the window's own width, which a
            damped resonance exceeds if its half-width is 3/4 of a group.
        least_damping: damping ratio of the sharpest resonance that is to be distinguished from a line.
        most_lines: lines that the result keeps, and as many with a name.
        mains_tolerance: how far the mains may be off 50 or 60 Hz, relative: a small generator.
        aircraft_tolerance: how far an aircraft's supply may be off 400 Hz, relative.
        mains_wander_hz: the mains wander by so much over the minutes of a log, Hz.
        most_harmonic: highest harmonic of a supply that is looked for.
        mute_ratio: a sensor of a pair this much quieter than the other is mute: no suspension takes 60 dB off the rms.
        quiet_ratio: a sensor of a pair this much quieter than the other may show only its noise.
        swap_ratio: how much quieter than the airframe the spindle may be at high frequencies before the two look
            swapped: a strut locked by friction makes them nearly equal.
        lag_hz: the band in which a suspension has its resonance and delays of channels turn the phase by little, Hz.
        least_lag: fraction of the common motion, a quarter of a period late, from which the upper side is said to lag.
        carried_hz: the bands in which a suspension of 1.4 Hz or more carries its body along, and moves it 0.7 to 1.3
            times as much as the wheel, AC coupling and a spring to the ground included, Hz.
        unit_tolerance: how far a ratio may lie from that of two units, as a factor: more than a suspension and an AC
            coupling make of it, and four times less than what lies between a sound ratio and the nearest one reported.
        unit_phase_rad: phase up to which two sensors move together; near a resonance or the corner of an AC coupling it
            is more, rad.
        unit_coherence: squared coherence from which two sensors move together.
        unit_lines: lines in all of `carried_hz`, those of 20 s: of fewer, unrelated signals may look coherent.
        largest_rms: a body that is shaken with more than 10 g rms is neither a vehicle nor a building, m/s^2.
        rest_tolerance: how far from 1 the mean of an upright sensor in g may lie, as `inspect` takes it for gravity.
        most_crossed: accelerations of one clock whose cross-spectra are formed: 28 pairs.
        least_averages: with fewer averages unrelated signals look coherent (by chance 1/n).
        coherence: squared coherence from which two channels have a common band.
        broad_band: highest over lowest frequency of the band over which the phase must be that of a delay; a resonance
            bends it.
        least_lines: lines of that band.
        phase_tolerance_rad: how far the phase may lie off a delay's, averaged over an eighth of the band, rad.
        gain_tolerance: largest over smallest gain, averaged over eighths of the band, of sensors that move alike.
        lag_sigma: a lag is reported when it exceeds so many standard deviations.
        lag_samples: a lag is reported when it exceeds so much of a sample.
    """

    crowded: float = 0.05
    least_fs_hz: float = 1.0
    most_fs_hz: float = 1e6
    mute_values: int = 3
    clip_run: int = 3
    clip_crowding: float = 4.0
    least_peaks: int = 3
    flat_s: float = 0.1
    most_spikes: int = 5
    held_rows: int = 2
    drift_parts: int = 16
    drift_part_s: float = 10.0
    high_frequency_hz: float = 5.0
    coarse_steps: float = 5.0
    offset_rms: float = 0.5
    drift_rms: float = 1.0
    gravity_tolerance: float = 0.05
    most_gravities: float = 1.2
    hum_rms: float = 0.05
    line_group: float = 0.002
    usual_groups: int = 65
    near_groups: int = 21
    line_ratio: float = 8.0
    line_chance: float = 1e-3
    line_width: float = 30.0
    least_damping: float = 0.01
    most_lines: int = 10
    mains_tolerance: float = 0.004
    aircraft_tolerance: float = 0.02
    mains_wander_hz: float = 0.5
    most_harmonic: int = 13
    mute_ratio: float = 1e-3
    quiet_ratio: float = 0.02
    swap_ratio: float = 0.9
    lag_hz: tuple[float, float] = (0.5, 25.0)
    least_lag: float = 0.05
    carried_hz: tuple[tuple[float, float], ...] = ((0.3, 0.5), (0.5, 0.8))
    unit_tolerance: float = 1.5
    unit_phase_rad: float = 0.5
    unit_coherence: float = 0.9
    unit_lines: int = 9
    largest_rms: float = 100.0
    rest_tolerance: float = 0.05
    most_crossed: int = 8
    least_averages: float = 8.0
    coherence: float = 0.5
    broad_band: float = 3.0
    least_lines: int = 16
    phase_tolerance_rad: float = 0.15
    gain_tolerance: float = 1.25
    lag_sigma: float = 4.0
    lag_samples: float = 0.1


HEALTH = HealthSettings()
