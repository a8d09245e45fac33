"""A folder of small sound files for every command that reads some: the least that it gives an answer for.

`benchmarks/spoiled_inputs.py` spoils them, `tests/test_determinism.py` runs each command on them twice.
"""

import json
import os
import shutil
from pathlib import Path

import numpy as np
from click.testing import CliRunner
from made_chain import curve_of, small_chain
from made_fleet import write_fleet
from made_flights import body_result, write_result
from scipy import sparse
from scipy.io import mmwrite
from small_logs import WRITERS
from test_planning import FILE
from test_updating_study_file import STUDY

from opid import cli
from opid.mechanics.laws.law import Law, Term
from opid.mechanics.truth import UpdatingTruth
from opid.modal.linear.modes_file import read_modes, write_modes
from opid.updating.measured import write_backbone
from opid.updating.structure.matrices_file import write_structure
from opid.virtual.truth_file import tabulate_truth

SHORT = ("--duration", "10", "--fs", "128")


def run(words, folder):
    """Run a command in this process, in a folder; it ends with an answer, or this with an exception."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        done = CliRunner().invoke(cli.main, list(words), catch_exceptions=False)
    finally:
        os.chdir(before)
    if done.exit_code not in (0, 1, 3):
        raise RuntimeError(f"opid {' '.join(map(str, words))}: {done.output}")


def write_table(path, head, *columns):
    np.savetxt(path, np.stack(columns, axis=1), delimiter=",", header=head, comments="", fmt="%.9g")


def write_bench(path):
    """Write the log of a test bench: a linear spring and damper."""
    t = np.arange(1500) / 200.0
    z = sum(2e-3 * np.sin(2 * np.pi * f * t + f) for f in (0.7, 1.9, 3.1))
    force = 1e5 * z + 2e3 * np.gradient(z, t) + np.random.default_rng(0).normal(0, 5, t.size)
    write_table(path, "time [s],stroke [mm],load [kN]", t, 1e3 * z, 1e-3 * force)


def write_hit(path, n=8192, fs=2048.0):
    """Write the log of a decay of one mode."""
    t = np.arange(n) / fs
    a = np.exp(-1.5 * t) * np.cos(377.0 * t) + np.random.default_rng(0).normal(0, 1e-3, t.size)
    write_table(path, "time [s],az [g]", t, np.where(t < 0.2, 0.0, a))


def give_speeds(study):
    """Say in a study how fast the aircraft rolled in each run, which `opid wheel` needs."""
    study.write_text(study.read_text().replace("[[runs]]", "[[runs]]\nspeed_m_per_s = 12.0"))


def make_logs(folder):
    for name, (write, _) in WRITERS.items():
        (folder / f"run{name}").write_bytes(write())


def make_taxi(folder):
    run(("simulate", "taxi", "taxi", *SHORT), folder)
    (folder / "guess.toml").write_text(FILE + "[sensors]\nfs_hz = 128.0\n")


def make_plane(folder):
    run(("simulate", "aircraft", "plane", *SHORT), folder)


def make_bench(folder):
    write_bench(folder / "bench.csv")
    (folder / "bench.toml").write_text(
        'title = "A damper"\n[bench]\nlog = "bench.csv"\nforce = "load"\ntravel = "stroke"\npiston_area_m2 = 0.004\n'
        '[channels]\nstroke = { channel = "stroke", unit = "mm" }\n'
    )
    write_hit(folder / "hit.csv", 4096, 1024.0)


def make_modal(folder):
    run(("simulate", "sine-beats", "made"), folder)
    made = folder / "made"
    for name, other in (("impact_1", "impact"), ("beat_3_level_1", "beat_1"), ("beat_3_level_3", "beat_2")):
        (made / f"{name}.csv").rename(folder / f"{other}.csv")
    for name in ("modes.npz", "truth.json"):
        (made / name).rename(folder / name)
    shutil.rmtree(made)
    write_modes(read_modes(folder / "modes.npz"), folder / "modes.csv")
    tests = "".join(
        f'[[tests]]\nlog = "beat_{k}.csv"\nuse = "{use}"\nforce = "force"\nmode = 3\n'
        for k, use in ((1, "fit"), (2, "fit"))
    )
    text = f'title = "A bolt"\n[modes]\nnonlinear = [3]\ndrive_point = "case_x"\nfile = "modes.npz"\n{tests}'
    (folder / "study.toml").write_text(text)
    (folder / "csv.toml").write_text(text.replace("modes.npz", "modes.csv"))


def make_levels(folder):
    run(("simulate", "resonance", "made", "--levels", "4", "--curves", "2"), folder)
    for path in (folder / "made").iterdir():
        path.rename(folder / path.name)
    (folder / "made").rmdir()


def make_chain(folder):
    write_structure(folder / "structure.npz", small_chain())
    write_backbone(curve_of(), folder / "first.csv")
    text = STUDY.replace("[structure]", "[structure]\ninternal_modes = 0") + "[noise]\ncov = { 1 = 0.01 }\n"
    (folder / "study.toml").write_text(text)
    sparse.save_npz(folder / "mass.npz", small_chain().mass)
    mmwrite(folder / "part_E.mtx", sparse.coo_matrix(2 * small_chain().parts["E"]), symmetry="general")
    (folder / "dofs.csv").write_text("dof,x\na,0\nb,1\nc,2\ntip,3\n")
    (folder / "matrices.toml").write_text(
        text.replace('"structure.npz"', '{ mass = "mass.npz", part_E = "part_E.mtx" }\ndofs = "dofs.csv"')
    )
    law = Law((Term("cubic_stiffness", (6.8e7,)),))
    truth = UpdatingTruth({"E": 1.0}, {"end": law}, "a chain", {"seed": 1})
    (folder / "truth.json").write_text(json.dumps(tabulate_truth(truth)))


def make_flights(folder):
    shutil.copytree(folder.parent / "taxi" / "taxi", folder / "taxi")
    shutil.copytree(folder / "taxi", folder / "driven")
    give_speeds(folder / "driven" / "study.toml")
    run(("simulate", "taxi", "taxi_2", *SHORT, "--seed", "2"), folder)
    for name, of in (("one", "taxi"), ("two", "taxi_2")):
        run(("identify", f"{of}/study.toml", "--law", "arctan_velocity", "--no-figures", "--out", name), folder)
        (folder / name / "report.html").unlink()
    shutil.rmtree(folder / "taxi_2")
    for k in (1, 2, 3):
        write_result(folder / f"b{k}", body_result(np.random.default_rng(k), day=f"2026-03-0{k}"))


def make_fleet(folder):
    write_fleet(folder / "fleet", n_pages=0)


def make_campaign(folder):
    shutil.copytree(folder.parent / "taxi" / "taxi", folder / "f1")
    (folder / "fleet.toml").write_text('flights = "flights.csv"\n[identify]\nlaw = "arctan_velocity"\n')
    (folder / "flights.csv").write_text("tail,flight,date,study,temperature_c\nA,f1,2026-01-12,f1/study.toml,-3\n")


MAKERS = {
    "logs": make_logs,
    "taxi": make_taxi,
    "plane": make_plane,
    "bench": make_bench,
    "modal": make_modal,
    "levels": make_levels,
    "chain": make_chain,
    "flights": make_flights,  # it and the campaign have copies of the taxi run
    "fleet": make_fleet,
    "campaign": make_campaign,
}


def make_folders(top, names=tuple(MAKERS)):
    """Make these folders in an empty one, in the order of `MAKERS`."""
    for name, make in MAKERS.items():
        if name in names:
            (top / name).mkdir()
            make(top / name)
