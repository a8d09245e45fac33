"""Campaigns and fleets without an identification: outcomes of flights, and the dataset of drawn values."""

from collections.abc import Iterator
from copy import deepcopy
from datetime import date, timedelta
from itertools import groupby
from pathlib import Path

import numpy as np
from made_flights import body_result, day, write_result
from scripts import script

from opid.estimate import Estimate
from opid.suspensions.flights.campaign import DATASET, Campaign, Outcome, Verdict
from opid.suspensions.flights.dataset import FleetDataset, write_part
from opid.suspensions.flights.result_file import Flight, read_flight

USUAL = {"n_struts": 6, "n_flights": 12, "years": 0.5, "scatter": 0.004, "std": 0.004, "level": 0.03}
"""A small fleet."""

REFUSED = "the runs are at one mass: give runs at two masses"


def draw_fleet(seed=1, **changed):
    """Return the dataset of a small fleet, and its harmed strut with the index of its first harmed flight."""
    return script("benchmarks/fleets.py").draw_fleet(np.random.default_rng(seed), **USUAL | changed)


def list_outcomes(dataset: FleetDataset) -> Iterator[Outcome]:
    """Yield the outcome of each flight of a drawn fleet, with its values."""
    first = dataset.tables[0]
    for k, (tail, name) in enumerate(zip(first.tail, first.flight, strict=True)):
        values = {each.quantity: Estimate.normal(float(each.value[k]), float(each.std[k])) for each in dataset.tables}
        at = date(1970, 1, 1) + timedelta(days=float(first.day[k]))
        folder = f"flights/{tail}/{name}"
        flight = Flight(str(name), Path("result.json"), at, "model", "single gear", {}, values)
        covariates = {key: float(each[k]) for key, each in first.covariates.items()}
        yield Outcome(str(name), str(tail), at, covariates, Verdict.IDENTIFIED, "", flight, folder, "0" * 64)


def write_fleet(folder: Path, seed=1, *, n_pages=1, **changed):
    """Write the dataset of a small fleet as a campaign has it, with pages of some flights of each aircraft.

    Returns the harmed strut with the index of its first harmed flight.
    """
    dataset, harmed = draw_fleet(seed, **changed)
    names = list(dataset.tables[0].covariates)
    for _, several in groupby(list_outcomes(dataset), key=lambda each: each.tail):
        flights = list(several)
        write_part(folder / DATASET, flights, 0, names)
        for each in flights[-n_pages:] if n_pages else ():
            (folder / each.folder).mkdir(parents=True)
            (folder / each.folder / "report.html").write_text("<!DOCTYPE html><title>flight</title>")
    return harmed


def make_campaign(folder: Path, document=None) -> Campaign:
    """Return the outcomes of two flights that are determined, of one that is not, and of one that failed.

    They are flights of a body, or those of a gear with the result.json `document`, whose stiffness then falls.
    """
    rng = np.random.default_rng(3)
    outcomes = []
    for number, (tail, name, reason) in enumerate((("A", "f1", ""), ("A", "f2", ""), ("B", "f1", REFUSED))):
        place = f"flights/{tail}/{name}"
        if document is None:
            content = body_result(rng, day=day(number))
        else:
            content = deepcopy(document) | {"date": day(number)}
            stiffness = content["parameters"]["suspension_stiffness_n_per_m"], content["interfaces"][0]["stiffness"]
            for each in stiffness:
                fall = 0.05 * number * each["value"]
                each["value"] -= fall
                each["interval95"] = [end - fall for end in each["interval95"]]
        write_result(folder / place, content | ({"not_determined": reason} if reason else {}))
        flight = read_flight(folder / place / "result.json", name)
        verdict = Verdict.NOT_DETERMINED if reason else Verdict.IDENTIFIED
        covariates = {"temperature_c": 3.5 + number}
        outcomes.append(Outcome(name, tail, flight.date, covariates, verdict, reason, flight, place, "0" * 64))
    reason = "there is no file B/f2/heavy.csv"
    outcomes.append(Outcome("f2", "B", None, {}, Verdict.FAILED, reason, None, "flights/B/f2", "0" * 64))
    return Campaign("Four flights", Path("fleet of 2026.toml"), tuple(outcomes))
