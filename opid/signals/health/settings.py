"""The tuned numbers of `inspect`, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class HealthSettings:
    """What counts as a fault of a clock or a channel, and what is only noteworthy.

    Args:
        crowded: where a larger fraction of the stamps repeats the one before, the host's clock stamps bursts of rows
            and not samples.
        least_fs_hz: nobody records the vibration of a vehicle at a lower rate: the unit of the stamps is wrong, Hz.
        most_fs_hz: nobody records it at a higher rate either, Hz.
        mute_values: a channel with so few different values is mute: a constant, or the last bit of a converter.
        clip_run: samples in a row at the extreme value that make a clipped peak. A smooth peak has one, by chance two.
        clip_crowding: the extreme value of a quantised, clipped signal occurs this many times as often as the next
            value. The rounded top of a coarsely quantised sine occurs about twice as often.
        least_peaks: a value with so many clipped peaks is the end of the range even if single samples, which are
            spikes, lie beyond it.
        flat_s: a value that is held for so long is no vibration of a machine in operation, s.
        most_spikes: number of spikes in a second that a fit can replace. More of them make the second unsound.
        blow_energy: single samples that hold more than this fraction of the energy of a force are blows of a hammer: a
            spike among the forces of a shaker holds less.
        held_rows: so many samples beside a held value are no spikes.
        drift_parts: number of parts of a record whose means show the drift.
        drift_part_s: least length of such a part, s: slow beside any motion of a vehicle on its springs.
        high_frequency_hz: this is above the bounce of a vehicle (1 to 3 Hz), where the suspension isolates the sprung
            side, Hz.
        coarse_steps: an rms should have so many quantisation steps: at 5 the rounding, step/sqrt(12), is 6 % of it.
        offset_rms: an offset beyond this fraction of the rms is worth a note: integrated twice, it hides the motion.
        drift_rms: a drift beyond this fraction of the rms is worth a note.
        gravity_tolerance: how far from 1 g (relative) a mean still looks like gravity: a tilt of 18 degrees, an offset.
        most_gravities: a mean beyond so many g is not gravity, even with a small error of the sensor's zero.
        hum_rms: lines of a supply beyond this fraction of the rms may spoil the result; a fifth of it is worth a note.
        line_group: width of the groups of lines that are compared, over their frequency: the speed of a machine
            wanders by as much.
        usual_groups: the median of so many groups is the usual power.
        near_groups: a line also exceeds the median of so many groups, which is the larger one beside a resonance.
        line_ratio: least ratio of a line's power to the median of its neighbours.
        line_chance: probability that noise makes one such line anywhere in a spectrum, divided among its groups. It
            needs 20 times the median in a single periodogram, and less in a mean of many.
        line_width: factor by which the spectrum has fallen at a distance of three to five groups. The window allows it;
            a damped resonance with a half-width of 3/4 of a group is wider.
        least_damping: damping ratio of the sharpest resonance that is to be distinguished from a line.
        most_lines: lines that the result keeps, and as many lines that have a name.
        mains_tolerance: how far the mains may be off 50 or 60 Hz, relative: a small generator.
        aircraft_tolerance: how far an aircraft's supply may be off 400 Hz, relative.
        mains_wander_hz: the mains wander by as much in the minutes of a log, Hz.
        most_harmonic: highest harmonic of a supply that is searched for.
        mute_ratio: a sensor of a pair whose rms is below this fraction of the other's is mute: no suspension isolates
            by 60 dB.
        quiet_ratio: a sensor of a pair whose rms is below this fraction of the other's may show only its noise.
        swap_ratio: the two look swapped where the rms of the spindle at high frequencies is below this fraction of the
            airframe's: a strut that is locked by friction makes them nearly equal.
        lag_hz: the band in which a suspension has its resonance and delays of channels turn the phase by little, Hz.
        least_lag: the upper side lags where this fraction of the common motion comes a quarter of a period late.
        carried_hz: bands in which a body on a suspension of 1.4 Hz or more moves with the wheel, 0.7 to 1.3 times as
            much even with AC coupling and a spring to the ground, Hz.
        unit_tolerance: largest factor between a ratio and that of two units: more than a suspension and an AC coupling
            change a ratio, and four times less than the distance from a sound ratio to the nearest reported one.
        unit_phase_rad: largest phase between two sensors that move together; it is larger near a resonance or the
            corner of an AC coupling, rad.
        unit_coherence: least squared coherence of two sensors that move together.
        unit_lines: least number of lines in all of `carried_hz`, as 20 s give: with fewer, unrelated signals may look
            coherent.
        largest_rms: a body that shakes with more than 10 g rms is neither a vehicle nor a building, m/s^2.
        rest_tolerance: how far from 1 the mean of an upright sensor in g may lie and still look like gravity.
        most_crossed: accelerations of one clock whose cross-spectra are computed, at the most: 28 pairs.
        least_averages: with fewer averages unrelated signals look coherent (by chance 1/n).
        coherence: least squared coherence in the common band of two channels.
        broad_band: highest over lowest frequency of the band over which the phase must be that of a delay; a resonance
            bends it.
        least_lines: least number of lines in that band.
        phase_tolerance_rad: largest distance of the phase from that of a delay, averaged over eighths of the band, rad.
        gain_tolerance: largest over smallest gain, averaged over eighths of the band, of sensors that move alike.
        lag_sigma: a lag is reported where it exceeds so many standard deviations.
        lag_samples: a lag is reported where it also exceeds this fraction of a sample.
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
    blow_energy: float = 0.5
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
