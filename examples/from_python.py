"""From arrays in memory to the sprung mass: the classical chain step by step, then the driven model in one call."""

import numpy as np

import opid

FS, MASS_CHANGE_KG = 512.0, -220.0


def main() -> None:
    # your own arrays go here: acceleration below and above the strut, m/s^2, one pair for each of two masses
    test = opid.virtual.taxi_test(
        opid.virtual.LandingGear(), rng=np.random.default_rng(0), fs=FS, mass_removed_kg=-MASS_CHANGE_KG
    )
    heavy, light = (
        (run.recording.channel("lower_z"), run.recording.channel("upper_z")) for run in (test.heavy, test.light)
    )

    # 1. the motion of the strut, through a zero-phase 0.3 Hz high-pass
    motion = opid.signals.relative_motion(*heavy, fs=FS)
    print(f"travel {1e3 * motion.displacement.std():.1f} mm rms, velocity {motion.velocity.std():.3f} m/s rms")

    # 2. the restoring force per unit of mass, -x2'' over (z, z'), and a law fitted to it
    surface = opid.suspensions.restoring_force(*heavy, fs=FS)
    rough = opid.suspensions.fit_surface(surface, "arctan_velocity")
    print(rough.verdicts[0].statement)

    # 3. the transmissibility of the linear strut beneath that law, and K2/M2, C2/M2, K3/M2 from it
    force = rough.law.force(motion.displacement, motion.velocity)
    T = opid.suspensions.transmissibility_without_force(*heavy, force, fs=FS, nperseg=round(8 * FS))
    direct = opid.suspensions.complex_least_squares(T, band_hz=(0.5, 12.0))
    print(f"complex least squares: K2/M2 = {direct.value[0]:.1f} +- {direct.std[0]:.1f} 1/s^2")

    # 4. all lines of both runs in one fit, noise on both channels, the law and 1/M2 among the unknowns
    lines = [
        opid.suspensions.equation_lines(*run, fs=FS, mass_change_kg=change)
        for run, change in ((heavy, 0.0), (light, MASS_CHANGE_KG))
    ]
    fit = opid.suspensions.fit_equation(
        lines,
        rough.law,
        stiffness_per_mass=direct.value[0],
        damping_per_mass=direct.value[1],
        inverse_mass=1 / 1000,  # a start value, far off
    )
    print(f"joint fit: K2/M2 = {fit.ratios[0]:.2f} +- {fit.std[0]:.2f} 1/s^2")

    # 5. the absolute scale
    added = opid.suspensions.absolute_parameters(fit, [0.0, MASS_CHANGE_KG])
    true = test.heavy.gear
    print(f"mass {added.sprung_mass_kg:.1f} +- {added.std[0]:.1f} kg (true {true.sprung_mass_kg:.0f} kg)")
    print(f"law {added.law.parameters} (true {true.law.parameters})")

    # 6. the default of `opid.identify` goes on from there: the measured spindle drives a model of the strut
    runs = tuple(
        opid.suspensions.Run(name, opid.signals.recording_from_arrays(run, ["below", "above"], fs=FS), change)
        for name, run, change in (("heavy", heavy, 0.0), ("light", light, MASS_CHANGE_KG))
    )
    result = opid.identify(opid.suspensions.study_of_gear("two runs", sprung="above", unsprung="below", runs=runs))
    mass = result.parameters.sprung_mass_kg
    print(f"driven model: mass {mass.value:.1f} +- {mass.std:.1f} kg, law {result.law.name}")


if __name__ == "__main__":
    main()
