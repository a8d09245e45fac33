"""The tables of Iwaniec & Uhl (2007) for the runs of one gear, and weighed masses of any study."""

from __future__ import annotations

from opid.estimate import format_number, rounded, with_std
from opid.report.document import Row, Table, build_columns
from opid.suspensions.paper.chain import PaperChain, PeakPair
from opid.suspensions.paper.result import AnyIdentification
from opid.suspensions.study import Study
from opid.suspensions.weighing import WeighedMass, find_weighed_reference, relative_error_percent


def tabulate_weighed(result: AnyIdentification) -> Table | None:
    """Return the weighed masses beside the identified ones; None if no run was weighed."""
    if not result.weighed:
        return None

    def build_row(each: WeighedMass) -> Row:
        return (
            each.run,
            with_std(each.weighed_kg, each.tolerance_kg),
            with_std(each.identified_kg.value, each.identified_kg.std),
            _format_percent(each.error_percent),
            with_std(each.by_runs_kg.value, each.by_runs_kg.std),
            "-" if each.deviations is None else f"{each.deviations:+.1f}",
        )

    has_prior = any(each.is_prior for each in result.weighed)
    has_tolerance = any(run.weighed_tolerance_kg is not None for run in result.study.runs)
    note = "They are compared with the answer, which does not depend on them."
    if has_prior:
        note = "Those with a tolerance are prior knowledge of the answer, others are only compared with it."
    elif has_tolerance and result.method == "model" and any(each.deviations for each in result.weighed):
        note = "They agree too little with the runs to take part in the answer, which is that of the runs alone."
    return Table(
        build_columns(
            "run", "weighed [kg]", "identified [kg]", "Err [%]", "by runs alone [kg]", "deviations", left=(0,)
        ),
        tuple(map(build_row, result.weighed)),
        "Weighed and identified mass",
        note=note,
        legend="Err = (weighed - identified)/weighed, eq. (11) of the paper. Deviations: weighed mass less that of the "
        "runs alone, in standard deviations of the difference; a scale without a tolerance is taken to have 0.2 %.",
    )


def tabulate_spectra(chain: PaperChain) -> Table:
    """Return how the transmissibilities were estimated (Table 2): of the mended chain and as printed."""

    def build_row(name: str, index: int, is_printed: bool) -> Row:
        run = chain.runs[index]
        T = run.printed.T if is_printed else run.T
        spectra = T.spectra
        return (
            f"{name}, {'as printed' if is_printed else 'mended'}",
            str(spectra.window),
            format_number(100 * spectra.noverlap / spectra.nperseg, 3),
            T.estimator,
            f"1/{format_number(spectra.nperseg / spectra.fs, 3)}",
            f"{spectra.n_averages:.1f}",
        )

    rows = [
        build_row(run.name, index, is_printed) for is_printed in (False, True) for index, run in enumerate(chain.runs)
    ]
    heads = ("run", "window", "overlap [%]", "estimator", "lines [Hz]", "averages")
    return Table(
        build_columns(*heads, left=(0, 1)),
        tuple(rows),
        "Transmissibilities (Table 2 of the paper)",
        legend="[transmissibility] in the study file states window, overlap, estimator and block_s. Averages: number "
        "of independent ones; with one alone the coherence is 1 by construction.",
    )


def tabulate_peaks(study: Study, chain: PaperChain) -> Table | None:
    """Return the matched peaks of the chain as printed, and what each pair gives (Table 3); None without a pair."""
    if not chain.pairs:
        return None
    weighed = find_weighed_reference(study)

    def build_row(number: int, pair: PeakPair) -> Row:
        one, other, found = pair.match.reference, pair.match.changed, pair.as_printed
        error = None if weighed is None else relative_error_percent(weighed, found.sprung_mass_kg)
        return (
            str(number),
            f"{one.frequency_hz:.3f}",
            f"{other.frequency_hz:.3f}",
            f"{one.magnitude:.3f}",
            f"{other.magnitude:.3f}",
            f"{found.sprung_mass_kg:.0f}",
            format_number(found.stiffness_n_per_m, 3),
            format_number(found.ground_stiffness_n_per_m, 3),
            _format_percent(error),
            "yes" if pair.match.credible else "no",
        )

    return Table(
        build_columns(
            "peak", "w [Hz]", "w' [Hz]", "|T|", "|T'|", "M2 [kg]", "K2 [N/m]", "K3 [N/m]", "Err [%]", "credible"
        ),
        tuple(build_row(number, pair) for number, pair in enumerate(chain.table_3, start=1)),
        "The chain as printed (Table 3 of the paper)",
        note=f"T(0) = {rounded(chain.static_transmissibility)}, {len(chain.pairs)} pairs of peaks match; shown are the "
        "strongest, credible ones first, by frequency.",
        legend="Each pair gives M2, K2 and K3 by eqs. (9) and (10), without damping and without the sign of T; Err by "
        "eq. (11) where a run was weighed. Credible: the mass change can have moved the peak so.",
    )


def _format_percent(value: float | None) -> str:
    return "-" if value is None else f"{value:+.2f}" if abs(value) < 10 else f"{value:+.0f}"
