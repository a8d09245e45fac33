"""A small sound log of every format, by writers that are not opid's: two channels of `VALUES` at `FS`.

`WRITERS` grows with the formats: a test says which registered ending has none.
"""

import importlib.util
import io
import signal
import struct
import tempfile
import wave
import zipfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from opid.signals.logs import open_log

N, FS = 64, 256.0
T = np.arange(N) / FS
VALUES = np.round(np.random.default_rng(5).standard_normal((N, 2)), 3)
NAMES = ("lower", "upper")
UNIT = "m/s^2"


# ---- text ------------------------------------------------------------------------------------------


def table(separator=","):
    lines = [separator.join(("time [s]", *(f"{name} [{UNIT}]" for name in NAMES)))]
    lines += [separator.join(map(repr, (t, *row))) for t, row in zip(T.tolist(), VALUES.tolist(), strict=True)]
    return "\n".join(lines) + "\n"


def lvm():
    head = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
        "Multi_Headings\tNo\nX_Columns\tOne\nTime_Pref\tRelative\n***End_of_Header***\t\n\t\nChannels\t2\n"
        f"Samples\t{N}\t{N}\nDate\t2024/05/01\t2024/05/01\nTime\t10:00:00\t10:00:00\n"
        f"Y_Unit_Label\t{UNIT}\t{UNIT}\nX_Dimension\tTime\tTime\nX0\t0.0E+0\t0.0E+0\n"
        f"Delta_X\t{1 / FS!r}\t{1 / FS!r}\n***End_of_Header***\t\t\nX_Value\tlower\tupper\tComment\n"
    )
    rows = zip(T.tolist(), VALUES.tolist(), strict=True)
    return head + "".join(f"{t!r}\t{a!r}\t{b!r}\n" for t, (a, b) in rows)


# ---- binary ----------------------------------------------------------------------------------------


def wav():
    """Whole numbers of 16 bits, so that the values are those of the table only within 2^-15."""
    out = io.BytesIO()
    with wave.open(out, "wb") as file:
        file.setparams((2, 2, int(FS), N, "NONE", ""))
        file.writeframes(np.round(VALUES / 4 * 32768).astype("<i2").tobytes())
    return out.getvalue()


def hdf5():
    import h5py

    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        for name, values in zip(NAMES, VALUES.T, strict=True):
            file[name] = values
            file[name].attrs["unit"] = UNIT
        file.attrs["fs"] = FS
    return out.getvalue()


def matlab():
    from scipy.io import savemat

    out = io.BytesIO()
    savemat(out, {"fs": FS, "lower": VALUES[:, 0], "upper": VALUES[:, 1], "units": UNIT}, do_compression=True)
    return out.getvalue()


def npz():
    out = io.BytesIO()
    np.savez_compressed(out, time=T, lower=VALUES[:, 0], upper=VALUES[:, 1], units=np.array([UNIT, UNIT]))
    return out.getvalue()


def parquet():
    import pyarrow
    from pyarrow import parquet as pq

    out = io.BytesIO()
    columns = {"time [s]": T} | {f"{name} [{UNIT}]": own for name, own in zip(NAMES, VALUES.T, strict=True)}
    pq.write_table(pyarrow.table(columns), out)
    return out.getvalue()


def xlsx(rows=None, *, other=None):
    """A workbook by hand: the least that is one, texts inline."""
    rows = (
        [[f"{name} [{UNIT}]" if name != "time" else "time [s]" for name in ("time", *NAMES)]] if rows is None else rows
    )
    rows = [*rows, *([t, *own] for t, own in zip(T.tolist(), VALUES.tolist(), strict=True))] if len(rows) == 1 else rows
    sheets = [rows] if other is None else [other, rows]
    names = [f"sheet{number}" for number in range(1, len(sheets) + 1)]
    kind = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    types = "application/vnd.openxmlformats-officedocument.spreadsheetml"
    relation = '<Relationship Id="r{0}" Type="' + office + '/{1}" Target="{2}"/>'
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as file:
        parts = "".join(
            f'<Override PartName="/xl/worksheets/{n}.xml" ContentType="{types}.worksheet+xml"/>' for n in names
        )
        file.writestr(
            "[Content_Types].xml",
            f'<Types xmlns="{package}/content-types">'
            '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
            f'<Override PartName="/xl/workbook.xml" ContentType="{types}.sheet.main+xml"/>{parts}</Types>',
        )
        head = f'<Relationships xmlns="{package}/relationships">'
        file.writestr(
            "_rels/.rels", head + relation.format(1, "officeDocument", "xl/workbook.xml") + "</Relationships>"
        )
        listed = "".join(f'<sheet name="{n}" sheetId="{i}" r:id="r{i}"/>' for i, n in enumerate(names, start=1))
        workbook = f'<workbook xmlns="{kind}" xmlns:r="{office}"><sheets>{listed}</sheets></workbook>'
        file.writestr("xl/workbook.xml", workbook)
        own = "".join(relation.format(i, "worksheet", f"worksheets/{n}.xml") for i, n in enumerate(names, start=1))
        file.writestr("xl/_rels/workbook.xml.rels", head + own + "</Relationships>")
        for name, content in zip(names, sheets, strict=True):
            lines = []
            for number, row in enumerate(content, start=1):
                cells = []
                for column, cell in enumerate(row):
                    place = f"{chr(65 + column)}{number}"
                    if isinstance(cell, str):
                        cells.append(f'<c r="{place}" t="inlineStr"><is><t>{cell}</t></is></c>' if cell else "")
                    else:
                        cells.append(f'<c r="{place}"><v>{cell!r}</v></c>')
                lines.append(f'<row r="{number}">{"".join(cells)}</row>')
            sheet = f'<worksheet xmlns="{kind}"><sheetData>{"".join(lines)}</sheetData></worksheet>'
            file.writestr(f"xl/worksheets/{name}.xml", sheet)
    return out.getvalue()


def uff():
    """ASCII data sets 58 by hand: two time histories in double precision."""
    lines = []
    for number, (name, values) in enumerate(zip(NAMES, VALUES.T, strict=True), start=1):
        lines += ["    -1", "    58", name, "NONE", "01-May-24 10:00:00", "NONE", "NONE"]
        lines += [f"{1:5d}{number:10d}{0:5d}{0:10d} {name:<10s}{number:10d}{3:4d} {'NONE':<10s}{0:10d}{0:4d}"]
        lines += [f"{4:10d}{N:10d}{1:10d}{0.0:13.5e}{1 / FS:13.5e}{0.0:13.5e}"]
        for kind, label, unit in (
            (17, "Time", "s"),
            (12, "Acceleration", UNIT),
            (0, "NONE", "NONE"),
            (0, "NONE", "NONE"),
        ):
            lines += [f"{kind:10d}{0:5d}{0:5d}{0:5d} {label:<20s} {unit:<20s}"]
        lines += ["".join(f"{each:20.11e}" for each in values[first : first + 4]) for first in range(0, N, 4)]
        lines += ["    -1"]
    return ("\n".join(lines) + "\n").encode()


def tdms():
    from nptdms import ChannelObject, TdmsWriter

    out = io.BytesIO()
    facts = {"wf_increment": 1 / FS, "wf_start_offset": 0.0, "unit_string": UNIT}
    with TdmsWriter(out) as file:
        for part in (slice(0, N // 2), slice(N // 2, N)):
            file.write_segment(
                [ChannelObject("run", name, VALUES[part, i], properties=facts) for i, name in enumerate(NAMES)]
            )
    return out.getvalue()


def mdf(version="4.10"):
    from asammdf import MDF, Signal

    with tempfile.TemporaryDirectory() as directory, MDF(version=version) as file:
        file.append(
            [
                Signal(samples=own, timestamps=T, name=name, unit=UNIT)
                for name, own in zip(NAMES, VALUES.T, strict=True)
            ],
            common_timebase=True,
        )
        return Path(file.save(Path(directory, "run.mf4"))).read_bytes()


def ulog():
    def message(kind, content):
        return struct.pack("<HB", len(content), ord(kind)) + content

    log = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000)
    log += message("F", b"vehicle:uint64_t timestamp;double lower_m_s2;double upper_m_s2;")
    log += message("A", struct.pack("<BH", 0, 1) + b"vehicle")
    for t, row in zip(T.tolist(), VALUES.tolist(), strict=True):
        log += message("D", struct.pack("<HQ2d", 1, 1_000_000 + round(1e6 * t), *row))
    return log


def ide_blocks(channel, values, starts, ends, *, modulo=False):
    """Blocks of an enDAQ recording, as the maker's schema encodes them: rows of counts, ticks of their ends."""
    suffix = "Mod" if modulo else ""
    return [
        (
            "ChannelDataBlock",
            {
                "ChannelIDRef": channel,
                f"StartTimeCodeAbs{suffix}": start,
                f"EndTimeCodeAbs{suffix}": end,
                "ChannelDataPayload": np.asarray(rows, dtype="<f8").tobytes(),
            },
        )
        for rows, start, end in zip(values, starts, ends, strict=True)
    ]


def ide_file(blocks, *, scale="1.0/32768", names=NAMES, calibrations=()):
    """A recording of one sensor of two axes, written in eight bytes each."""
    from ebmlite import loadSchema
    from idelib import importer  # noqa: F401 - tells ebmlite where its schema is

    schema = loadSchema("mide_ide.xml")
    axes = [
        {"SubChannelID": i, "SubChannelName": name, "SubChannelLabel": "Acceleration", "SubChannelUnits": UNIT}
        | ({"SubChannelCalibrationIDRef": i + 1} if calibrations else {})
        for i, name in enumerate(names)
    ]
    sensor = {"ChannelID": 8, "ChannelName": "gear", "ChannelFormat": "<dd", "SubChannel": axes}
    sensor |= {"TimeCodeScale": scale, "TimeCodeModulus": 1 << 24}
    elements = [
        (
            "RecordingProperties",
            {"ChannelList": {"Channel": [sensor | {"TimeCodeModulus": 1 << 24, "SubChannel": axes}]}},
        ),
        *blocks,
    ]
    if calibrations:
        polynomials = [
            {"CalID": i, "CalReferenceValue": 0.0, "PolynomialCoef": list(own)}
            for i, own in enumerate(calibrations, start=1)
        ]
        elements.insert(0, ("CalibrationList", {"UnivariatePolynomial": polynomials}))
    head = {
        "EBMLVersion": 1,
        "EBMLReadVersion": 1,
        "EBMLMaxIDLength": 4,
        "EBMLMaxSizeLength": 8,
        "DocType": "mide",
        "DocTypeVersion": 2,
        "DocTypeReadVersion": 2,
    }
    return b"".join(bytes(schema.encodes({name: content})) for name, content in [("EBML", head), *elements])


def ide():
    starts = [0, 4096]
    return ide_file(ide_blocks(8, np.split(VALUES, 2), starts, [start + 31 * 128 for start in starts]))


# ending -> its bytes, and the distribution that writes them
WRITERS = {
    ".csv": (lambda: table().encode(), None),
    ".tsv": (lambda: table("\t").encode(), None),
    ".txt": (lambda: table(";").encode(), None),
    ".dat": (lambda: table("\t").encode(), None),
    ".asc": (lambda: table("\t").encode(), None),
    ".lvm": (lambda: lvm().encode(), None),
    ".wav": (wav, None),
    ".h5": (hdf5, "h5py"),
    ".mat": (matlab, None),
    ".npz": (npz, None),
    ".xlsx": (xlsx, "python_calamine"),
    ".parquet": (parquet, "pyarrow"),
    ".uff": (uff, "pyuff"),
    ".tdms": (tdms, "nptdms"),
    ".ide": (ide, "idelib"),
    ".mf4": (mdf, "asammdf"),
    ".mdf": (lambda: mdf("3.30"), "asammdf"),
    ".ulg": (ulog, "pyulog"),
}
SAME = {".wave": ".wav", ".hdf5": ".h5", ".hdf": ".h5", ".pq": ".parquet", ".unv": ".uff", ".58": ".uff", ".uf": ".uff"}


def small_log(ending):
    """Return the bytes of a small sound log, or skip where its writer is not installed."""
    write, needs = WRITERS[SAME.get(ending, ending)]
    if needs is not None and importlib.util.find_spec(needs) is None:
        pytest.skip(f"{needs} is not installed")
    return write()


def all_of(path):
    """Return the values of each track, after a look at the shape of each block."""
    found = []
    for track in open_log(path).tracks:
        blocks = list(track.blocks())
        for block in blocks:
            assert block.samples.dtype == np.float64
            assert block.samples.shape[1:] == (len(track.channels),)
            assert block.stamps is None or block.stamps.shape == block.samples.shape[:1]
        samples = np.concatenate([np.empty((0, len(track.channels))), *(block.samples for block in blocks)])
        assert track.n_samples in (None, len(samples))
        found.append(samples)
    return found


@contextmanager
def ended_after(seconds):
    """End what hangs: after seconds of processor time, or ten times as many of waiting on a machine that is shared.

    Windows has no alarm, there nothing is guarded.
    """
    if not hasattr(signal, "SIGALRM"):
        yield
        return

    def stop(_number, _frame):
        pytest.fail(f"no answer within {seconds} s")

    alarms = ((signal.SIGPROF, signal.ITIMER_PROF, seconds), (signal.SIGALRM, signal.ITIMER_REAL, 10 * seconds))
    before = [signal.signal(number, stop) for number, _, _ in alarms]
    for _, timer, after in alarms:
        signal.setitimer(timer, after)
    try:
        yield
    finally:
        for (number, timer, _), handler in zip(alarms, before, strict=True):
            signal.setitimer(timer, 0)
            signal.signal(number, handler)
