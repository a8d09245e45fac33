"""Fleets of struts whose values are drawn: false alarms, a harmed strut, and the seasons, as a Markdown table.

Run `python benchmarks/fleets.py --fleets 1000 --jobs 2`. Values of flights are drawn as `opid campaign` would write
them (no flight is identified); `opid.suspensions.flights.fleet_comparison` then compares them. No fleet is dropped.

- unharmed: fleets of 1 to 200 struts with 3 to 60 flights each in 0.3 to 3 years, of 1 to 3 quantities, with any
  scatter between flights up to 1.5 %, intervals of 0.3 to 1.5 %, struts that differ by 1 to 10 %, with seasons and
  without; at the usual number of false alarms a year, and at one a year.
- harmed: 200 struts, a flight a week for a year, one strut loses 3 % of its stiffness at a random flight; one false
  alarm a year.
- seasons: gas struts whose stiffness swings by 15 % with the temperature over a year, 50 of them; with the temperature
  of each flight (read with an error of 1 K) as a covariate, and without.
- failing: 60 struts, 40 flights each in a year and a half, at the usual number of false alarms, in worlds in which an
  assumption of the model does not hold.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from opid.errors import NotDeterminedError
from opid.suspensions.flights.dataset import FleetDataset, FleetTable
from opid.suspensions.flights.fleet import Fleet
from opid.suspensions.flights.fleet_comparison import compare_fleet
from opid.suspensions.flights.result_file import Quantity

UNIT = {"stiffness": "N/m", "damping": "N s/m", "mass": "kg"}


def draw_fleet(
    rng: np.random.Generator,
    *,
    n_struts: int,
    n_flights: int,
    years: float,
    scatter: float,
    std: float,
    level: float,
    swing: float = 0.0,
    quantities: int = 1,
    has_temperature: bool = True,
    harm: float = 0.0,
) -> tuple[FleetDataset, tuple[str, int]]:
    """Draw the dataset of a fleet, and which strut is harmed from which of its flights.

    Args:
        rng: of all that is drawn.
        n_struts: one for each aircraft.
        n_flights: of each.
        years: in which they fly.
        scatter: standard deviation between flights beyond the intervals, as a fraction.
        std: that of the intervals; each flight has one of its own about it.
        level: standard deviation of the struts.
        swing: of the stiffness over a year, by the temperature, from the lowest to the highest.
        quantities: that are followed; the others have no harm.
        has_temperature: whether the temperature is known.
        harm: relative change of the stiffness of one strut.
    """
    n = n_struts * n_flights
    tails = np.array([f"D-{i:03}" for i in range(n_struts)])
    day = np.sort(rng.uniform(0, 365.25 * years, (n_struts, n_flights)), axis=1).round().ravel()
    celsius = 10.0 - 12.0 * np.cos(2 * np.pi * day / 365.25) + rng.normal(0.0, 3.0, n)
    # the pressure of a gas column, and so the stiffness at one load, follows the absolute temperature; struts differ
    of_gas = np.log1p(swing / 24.0 * (celsius - 10.0))
    harmed, since = (
        int(rng.integers(n_struts)),
        int(rng.integers(n_flights // 3, max(n_flights // 3 + 1, n_flights - 5))),
    )
    tables = []
    for name in list(UNIT)[:quantities]:
        own = std * np.exp(rng.normal(0.0, 0.3, n))
        logarithm = np.repeat(rng.normal(0.0, level, n_struts), n_flights) + rng.normal(0.0, 1.0, n) * np.hypot(
            scatter, own
        )
        if name == "stiffness":
            logarithm = logarithm + of_gas
            start = harmed * n_flights + since
            logarithm[start : (harmed + 1) * n_flights] += np.log1p(harm)
        value = 4e5 * np.exp(logarithm)
        read = {"temperature_c": celsius + rng.normal(0.0, 1.0, n)} if has_temperature else {}
        names = np.array([f"{j:05}" for j in range(n)])
        tables.append(
            FleetTable(
                Quantity("gear", name, UNIT[name]),
                np.repeat(tails, n_flights),
                names,
                day,
                value,
                own * value,
                read,
                names,
            )
        )
    return FleetDataset(Path("fleet"), tuple(tables), n, {}, ()), (str(tails[harmed]), since)


def try_unharmed(seed: int, alarms_per_year: float) -> tuple[int, float]:
    """Return the number of alarms of an unharmed fleet of any kind, and its years."""
    rng = np.random.default_rng([seed, 1])
    years = float(rng.uniform(0.3, 3.0))
    dataset, _ = draw_fleet(
        rng,
        n_struts=int(np.exp(rng.uniform(0.0, np.log(200.0)))),
        n_flights=int(rng.integers(3, 61)),
        years=years,
        scatter=float(rng.choice([0.0, rng.uniform(0.0, 0.015)])),
        std=float(rng.uniform(0.003, 0.015)),
        level=float(rng.uniform(0.01, 0.1)),
        swing=float(rng.choice([0.0, 0.15])),
        quantities=int(rng.integers(1, 4)),
    )
    try:
        found = compare_fleet(dataset, alarms_per_year=alarms_per_year)
    except NotDeterminedError:  # few flights that have nothing in common with others raise no alarm
        return 0, years
    return len(found.changes), found.years


def try_harmed(seed: int) -> tuple[int, int, int]:
    """Return whether the harm is found within three flights, whether at all, and the number of other alarms."""
    rng = np.random.default_rng([seed, 2])
    dataset, (tail, since) = draw_fleet(
        rng, n_struts=200, n_flights=52, years=1.0, scatter=0.005, std=0.005, level=0.05, harm=-0.03
    )
    return count_found(compare_fleet(dataset, alarms_per_year=1.0), tail, since)


def count_found(found: Fleet, tail: str, since: int) -> tuple[int, int, int]:
    """Return whether a harm is found within three flights, whether at all, and the number of other alarms."""
    right = [each for each in found.changes if each.tail == tail and each.first + each.n_needed > since]
    soon = any(each.first + each.n_needed <= since + 3 for each in right)
    return int(soon), int(bool(right)), len(found.changes) - len(right[:1])


def try_season(seed: int, has_temperature: bool) -> tuple[int, float]:
    """Return the number of alarms of a fleet of gas struts whose stiffness follows the seasons, and its years."""
    rng = np.random.default_rng([seed, 3])
    dataset, _ = draw_fleet(
        rng,
        n_struts=50,
        n_flights=52,
        years=2.0,
        scatter=0.005,
        std=0.005,
        level=0.05,
        swing=0.15,
        has_temperature=has_temperature,
    )
    found = compare_fleet(dataset)
    return len(found.changes), found.years


FAILING = (
    "all assumptions hold",
    "scatter of Student's distribution, 3 degrees of freedom",
    "1 % of the flights 10 standard deviations off",
    "intervals a third of what they should be",
    "struts that scatter differently, by a factor of 3",
    "scatter that remembers the flight before, by 0.8",
    "struts that answer to the temperature differently, by 30 %",
    "10 % of the struts drift by 5 % a year (drifts are counted apart)",
    "all struts fall by 3 % at once",
)


def try_failing(seed: int, world: str) -> tuple[int, int, int, float]:
    """Return the alarms, drifts and common steps of a fleet that breaks an assumption, and its years."""
    rng = np.random.default_rng([seed, 4])
    kind = FAILING.index(world)
    dataset, _ = draw_fleet(
        rng, n_struts=60, n_flights=40, years=1.5, scatter=0.0, std=0.005, level=0.05, swing=0.15 * (kind != 6)
    )
    (table,) = dataset.tables
    shape = 60, 40
    day, celsius = table.day.reshape(shape), table.covariates["temperature_c"].reshape(shape)
    noise = rng.normal(size=shape)
    if kind == 1:
        noise = rng.standard_t(3.0, shape) / np.sqrt(3.0)
    elif kind == 2:
        noise[rng.random(shape) < 0.01] *= 10.0
    elif kind == 4:
        noise *= np.exp(rng.normal(0.0, np.log(3.0), (60, 1)))
    elif kind == 5:
        for k in range(1, shape[1]):
            noise[:, k] = 0.8 * noise[:, k - 1] + 0.6 * noise[:, k]
    change = 0.006 * noise
    if kind == 6:
        change += np.log1p(0.15 / 24.0 * (1 + 0.3 * rng.normal(size=(60, 1))) * (celsius - 10.0))
    elif kind == 7:
        change -= 0.05 * (rng.random((60, 1)) < 0.1) * day / 365.25
    elif kind == 8:
        change -= 0.03 * (day > 300.0)
    # the value has the scatter that the right intervals tell
    told = table.std / 3.0 if kind == 3 else table.std
    changed = replace(table, value=table.value * np.exp(change.ravel()), std=told)
    found = compare_fleet(replace(dataset, tables=(changed,)))
    return len(found.changes), len(found.drifts), len(found.series[0].common_steps), found.years


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fleets", type=int, default=1000, help="of each world, counted from 0")
    parser.add_argument("--worlds", default="unharmed,harmed,seasons,failing", help="names joined by commas")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    options = parser.parse_args()
    seeds, worlds = range(options.fleets), options.worlds.split(",")
    print("| world | fleets | alarms a year: stated | counted | found within 3 flights | found |")
    print("|---|---|---|---|---|---|")
    with ProcessPoolExecutor(options.jobs) as pool:
        for stated in (0.1, 1.0) if "unharmed" in worlds else ():
            alarms, years = np.sum(list(pool.map(try_unharmed, seeds, [stated] * len(seeds), chunksize=4)), axis=0)
            print(f"| unharmed | {len(seeds)} | {stated:g} | {alarms / years:.3f} | - | - |", flush=True)
        if "harmed" in worlds:
            soon, found, others = np.mean(list(pool.map(try_harmed, seeds, chunksize=4)), axis=0)
            print(
                f"| harmed | {len(seeds)} | 1 | {others:.3f} | {100 * soon:.1f} % | {100 * found:.1f} % |", flush=True
            )
        known_or_not = ((True, "temperature known"), (False, "temperature not known"))
        for known, words in known_or_not if "seasons" in worlds else ():
            alarms, years = np.sum(list(pool.map(try_season, seeds, [known] * len(seeds), chunksize=4)), axis=0)
            print(f"| seasons, {words} | {len(seeds)} | 0.1 | {alarms / years:.3f} | - | - |", flush=True)
        if "failing" not in worlds:
            return
        print("\n| what does not hold | fleets | alarms a year: stated | counted | drifts, steps of all in a fleet |")
        print("|---|---|---|---|---|")
        for world in FAILING:
            found = np.sum(list(pool.map(try_failing, seeds, [world] * len(seeds), chunksize=4)), axis=0)
            alarms, drifts, steps, years = found
            others = f"{drifts / len(seeds):.2f}, {steps / len(seeds):.2f}"
            print(f"| {world} | {len(seeds)} | 0.1 | {alarms / years:.3f} | {others} |", flush=True)


if __name__ == "__main__":
    main()
