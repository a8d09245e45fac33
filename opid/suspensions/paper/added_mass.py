"""Boundary perturbation: runs whose sprung masses differ by a known amount give the absolute scale.

Iwaniec & Uhl (2007, eqs. 9-10) take one peak of |T| from each of two runs and solve two equations,
M2 = dM r/(r - 1). One least-squares problem over all lines of all runs uses all of the data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.laws.law import Law
from opid.suspensions.paper.settings import DEFAULTS, PaperSettings
from opid.suspensions.paper.spectral_equation import RATIOS, FittedValues, JointFit
from opid.suspensions.paper.transmissibility import Peak, mass_over_stiffness


@dataclass(frozen=True)
class TwoPeakMass:
    """Mass and springs from one pair of peaks.

    Args:
        mass_ratio: M2 over the mass removed.
        sprung_mass_kg: M2 of the reference run, kg.
        stiffness_n_per_m: K2, N/m.
        ground_stiffness_n_per_m: K3 = K2 (1/T(0) - 1), N/m.
    """

    mass_ratio: float
    sprung_mass_kg: float
    stiffness_n_per_m: float
    ground_stiffness_n_per_m: float


@dataclass(frozen=True)
class PeakMatch:
    """A pair of peaks of two runs, and whether the mass change can have moved one to the other.

    Args:
        reference: peak of the reference run.
        changed: peak of the run with the changed mass.
        credible: whether the mass change can cause the shift.
        reason: the reason, one sentence.
    """

    reference: Peak
    changed: Peak
    credible: bool
    reason: str


@dataclass(frozen=True, eq=False)
class AddedMass(FittedValues):
    """Absolute parameters of the reference run from one joint fit, with covariance by the delta method.

    Its values are "sprung_mass_kg", "suspension_stiffness_n_per_m", "suspension_damping_n_s_per_m",
    "ground_stiffness_n_per_m", then "law[i]" for entry i of `law.vector`.

    Args:
        law: the nonlinear law, N.
        fit: the fit per unit of mass that this was scaled from.
    """

    law: Law
    fit: JointFit

    @property
    def sprung_mass_kg(self) -> float:
        """M2, kg."""
        return float(self.value[0])

    @property
    def slopes(self) -> tuple[float, float]:
        """K2, N/m, and C2, N s/m."""
        return float(self.value[1]), float(self.value[2])


def two_peak_mass(
    reference: Peak,
    changed: Peak,
    *,
    mass_change_kg: float,
    static_transmissibility: float = 0.7,
    restore_sign: bool = False,
) -> TwoPeakMass:
    """Solve eqs. (9) and (10) of the paper: M2 = dM r/(r - 1), r = [M2/K2]/[(M2 - dM)/K2].

    Args:
        reference: peak of the reference run.
        changed: peak of the run with the changed mass.
        mass_change_kg: sprung mass of the changed run minus the reference's (negative: removed), kg.
        static_transmissibility: T(0); the paper's 0.7 gives its factor 1.428.
        restore_sign: take T = -|T| instead of the printed magnitude.

    Raises:
        InputError: a mass change of zero, or values that are not positive.

    >>> peaks = Peak(15.625, 0.247), Peak(19.531, 0.200)
    >>> round(two_peak_mass(*peaks, mass_change_kg=-220.0).mass_ratio, 1)
    7.8
    """
    if mass_change_kg == 0:
        raise InputError("mass_change_kg is 0: two runs of one mass give ratios only, never the mass")
    settings = {"static_transmissibility": static_transmissibility, "restore_sign": restore_sign}
    first = mass_over_stiffness(reference, **settings)  # type: ignore[arg-type]
    second = mass_over_stiffness(changed, **settings)  # type: ignore[arg-type]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = float(np.divide(first, second))
        mass_ratio = float(np.divide(ratio, ratio - 1.0))
        mass = -mass_change_kg * mass_ratio
        stiffness = float(np.divide(mass, first))
    return TwoPeakMass(mass_ratio, mass, stiffness, stiffness * (1 / static_transmissibility - 1))


def match_peaks(
    reference: Sequence[Peak],
    changed: Sequence[Peak],
    *,
    mass_change_kg: float,
    largest_mass_fraction: float = PaperSettings.largest_mass_fraction,
) -> tuple[PeakMatch, ...]:
    """Pair the peaks of two runs by nearest frequency ratio and judge each pair.

    A frequency that the sprung mass alone governs moves by sqrt(M2/(M2 + dM)), any other one by less; so removing mass
    never lowers a peak, and a ratio above sqrt(2) would mean that half of the mass was removed.

    Args:
        reference: peaks of the reference run.
        changed: peaks of the run with the changed mass.
        mass_change_kg: negative where mass was removed, kg.
        largest_mass_fraction: a shift that needs a larger change of the mass is not credible.

    >>> match_peaks([Peak(1.812, 0.49)], [Peak(6.406, 0.122)], mass_change_kg=-220.0)[0].credible
    False
    """
    from scipy.optimize import linear_sum_assignment

    if not reference or not changed:
        return ()
    distance = np.abs(
        np.log([[b.frequency_hz / a.frequency_hz for b in changed] for a in reference])  # octaves apart, up to a factor
    )
    rows, columns = linear_sum_assignment(distance)
    pairs = [(reference[i], changed[j]) for i, j in zip(rows, columns, strict=True)]
    return tuple(PeakMatch(a, b, *_judge(a, b, mass_change_kg, largest_mass_fraction)) for a, b in pairs)


def absolute_parameters(
    fit: JointFit, mass_changes_kg: Sequence[float], *, settings: PaperSettings = DEFAULTS
) -> AddedMass:
    """Scale a joint fit of several runs by the mass that it found.

    The unknown of the fit is mu = 1/M2. It may pass through zero, so runs without information on the mass show that.

    Args:
        fit: a fit of all runs with a free `inverse_mass`.
        mass_changes_kg: mass changes of the runs, kg.
        settings: the significance above which the mass is determined.

    Raises:
        InputError: a fit without a free mass.
        NotDeterminedError: the runs do not show the mass change, or contradict it; `partial` is the fit.
    """
    if "inverse_mass" not in fit.names:
        raise InputError("the fit has no free mass: fit runs of at least two masses with inverse_mass given")
    mu, mu_std = fit.inverse_mass, fit.std_of("inverse_mass")
    if not mu > settings.mass_seen_above * mu_std:
        opposite = mu < -settings.mass_seen_above * mu_std
        raise NotDeterminedError(
            _explain_unseen(mu, mu_std, max(mass_changes_kg) - min(mass_changes_kg), opposite), fit
        )
    if 1 + mu * min(mass_changes_kg) < settings.least_remainder:
        raise NotDeterminedError(
            f"the fit gives a sprung mass of {1 / mu:.0f} kg, but a run is stated to be {-min(mass_changes_kg):g} kg "
            "lighter, which would leave almost no mass: check mass_change_kg (kg, of the mass on this gear)",
            fit,
        )
    return _scale_by_mass(fit)


def _scale_by_mass(fit: JointFit) -> AddedMass:
    """Scale the ratios by the mass, with the covariance by the delta method."""
    mu, last = fit.inverse_mass, fit.names.index("inverse_mass")
    of_law = tuple(f"law[{i}]" for i in range(fit.law.vector.size))
    per_mass = np.array([*fit.ratios, *fit.law.vector])
    is_scaled = np.array([True] * 3 + [parameter.role == "amplitude" for parameter in fit.law.parameter_list])
    factor = np.where(is_scaled, 1 / mu, 1.0)
    jacobian = np.zeros((1 + per_mass.size, len(fit.names)))
    for row, name in enumerate((*RATIOS, *of_law)):
        if name in fit.names:
            jacobian[1 + row, fit.names.index(name)] = factor[row]
    jacobian[:, last] = np.append(-1.0, np.where(is_scaled, -per_mass, 0.0)) / mu**2
    heads = ("sprung_mass_kg", "suspension_stiffness_n_per_m", "suspension_damping_n_s_per_m")
    return AddedMass(
        names=(*heads, "ground_stiffness_n_per_m", *of_law),
        value=np.append(1 / mu, factor * per_mass),
        covariance=jacobian @ fit.covariance @ jacobian.T,
        law=fit.law.scaled(1 / mu),
        fit=fit,
    )


def _judge(reference: Peak, changed: Peak, mass_change_kg: float, largest_fraction: float) -> tuple[bool, str]:
    shift = changed.frequency_hz / reference.frequency_hz
    # Each peak may have an error of half a line.
    slack = 0.5 * (reference.resolution_hz + changed.resolution_hz) / reference.frequency_hz
    removed = -mass_change_kg if mass_change_kg else 0.0
    direction = "up" if shift > 1 else "down"
    moves = f"the peak moves {direction} from {reference.frequency_hz:.3g} to {changed.frequency_hz:.3g} Hz"
    if removed == 0:
        return False, f"{moves}, but the two runs have the same mass"
    if (shift - 1) * np.sign(removed) < -slack:
        return False, f"{moves}, and {'removing' if removed > 0 else 'adding'} mass cannot do that"
    fraction = 1 - shift**-2 if removed > 0 else shift**-2 - 1
    if fraction > largest_fraction:
        done = "removed" if removed > 0 else "added"
        return False, f"{moves}: at least {100 * fraction:.0f} % of the sprung mass would have to be {done}"
    if abs(shift - 1) <= slack:
        return False, f"{moves}: less than the spacing of the lines, so the shift gives no information"
    return True, f"{moves}, as {100 * fraction:.0f} % of the sprung mass would move it"


def _explain_unseen(mu: float, mu_std: float, largest: float, opposite: bool) -> str:
    upper = mu + 1.96 * mu_std
    bound = f"it is above {1 / upper:.0f} kg" if upper > 0 else "the effect even has the opposite sign"
    if opposite:
        return (
            f"the runs respond as if the sign of the mass change ({largest:g} kg) were opposite: check mass_change_kg "
            "(negative where mass was removed) and the order of the logs; the ratios to the mass are given"
        )
    return (
        f"the mass change of {largest:g} kg does not show in the runs, so the sprung mass is not determined ({bound}, "
        "95 %): use a larger mass change or longer runs; the ratios to the mass are given"
    )
