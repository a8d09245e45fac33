"""What can be wrong with a file: functions that take a sound one and return it spoiled, and what stands in its place.

Each takes the bytes and a `random.Random`. `spoiled` makes hypothesis strategies of them, whose draws it then controls;
`benchmarks/spoiled_inputs.py` seeds them. Those of a format know what such a file holds, so that the spoiled one is
read far into a command before it is refused.
"""

import csv
import io
import json
import math
import os
import pickle
import struct
import tomllib
import zipfile
from datetime import date

import numpy as np
import tomli_w
from hypothesis import strategies as st

LONG_LINE = 10_000_000
"""Bytes of a line that no editor writes."""

DEEP = 1000
ABSURD_SHAPES = ((1 << 40, 3), (-1, 4), (1_500_000_000,), (1 << 63, 1 << 63), (0, 5), (3, 0))
"""In the headers of arrays: the third takes 12 GB."""

NUMBERS = (
    *("nan", "inf", "-inf", "1e300", "-1e300", "1e400", "-1e400", "1e-300", "0", "-0.0", "-1", "-2.5", "1e18"),
    *("9" * 5000, "0x10", "1_000", "1,5", "1e", "", " ", "true", "null", "text", "--", "1e5e5", "\u0663", "1+2j"),
)
"""Texts in the place of a number."""

TEXTS = (
    *("", " ", "\x00", "a\x00b", "../../x", "/proc", "/dev/zero", ".", "x" * 10_000, "no such name", "\u202e", "\n"),
    *("$x$", "<script>", "{run}", "%s", "\x1b[31m", "nan", "\ud800".encode("utf-8", "replace").decode()),
)
LEAVES = (
    *(None, True, False, "", "text", [], {}, [[]], [None], {"a": 1}, 0, 0.0, -0.0, -1, -1.5, 2.5, 10**18, 10**400),
    *(
        date(1, 1, 1),
        date(9999, 12, 31),
        1e300,
        -1e300,
        1e-300,
        1e15,
        math.nan,
        math.inf,
        -math.inf,
        "1",
        "nan",
        "\x00",
        "x" * 10_000,
        [1, 2, 3],
        [1e300],
    ),
)
"""Values in the place of any other; TOML has no null, and JSON no dates."""


# ---- any file --------------------------------------------------------------------------------------


def cut(content, rng):
    return content[: rng.randrange(len(content) + 1)]


def cut_beginning(content, rng):
    return content[rng.randrange(len(content) + 1) :]


def flip_bits(content, rng):
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 3, 30))):
        if changed:
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def overwrite(content, rng):
    at = rng.randrange(len(content) + 1)
    put = bytes(rng.randrange(256) for _ in range(rng.choice((1, 4, 40))))
    return content[:at] + put + content[at + len(put) :]


def insert(content, rng):
    at = rng.randrange(len(content) + 1)
    put = rng.choice((b"\x00", b"\x00" * 20, b"\xff", "é".encode("latin-1"), "µ".encode("latin-1"), b"\r", b"\xfe\xff"))
    return content[:at] + put + content[at:]


def repeat(content, rng):
    return content * rng.choice((2, 3))


def replace_by_other(content, rng):
    return rng.choice(
        (
            *(b"", b"\n", b"\x00", b"\x00" * 5000, b"text", b"PK\x03\x04" + bytes(40), b"\x1f\x8b" + bytes(40)),
            *(
                b"%PDF-1.4\n",
                b"\x7fELF" + bytes(60),
                b"\x89PNG\r\n\x1a\n",
                b"{}",
                b"[]",
                b"<html></html>",
                b"a,b\n1,2\n",
            ),
            *(pickle.dumps({"a": [1.0]}), bytes(rng.randrange(256) for _ in range(200))),
        )
    )


def mark_order(content, rng):
    return rng.choice((b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff", b"\xef\xbb\xbf" * 2)) + content


ANY = (cut, cut_beginning, flip_bits, overwrite, insert, repeat, replace_by_other, mark_order)


# ---- text ------------------------------------------------------------------------------------------


def end_lines_by_carriage_returns(content, rng):
    return content.replace(b"\r\n", b"\n").replace(b"\n", b"\r")


def recode(content, rng):
    return content.decode("utf-8", "replace").encode(rng.choice(("utf-16", "utf-32", "utf-7", "cp500")))


def add_long_line(content, rng):
    line = rng.choice((b"1", b"x", b",", b"[", b" ", b'"')) * LONG_LINE
    return content + line if rng.random() < 0.5 else line + b"\n" + content


def replace_number(content, rng):
    """Put a nonsense in the place of one of the first numbers, or of any."""
    import re

    found = [*re.finditer(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?", content)]
    if not found:
        return content
    match = rng.choice(found[:20] if rng.random() < 0.5 else found)
    return content[: match.start()] + rng.choice(NUMBERS).encode() + content[match.end() :]


TEXT = (end_lines_by_carriage_returns, recode, add_long_line, replace_number, replace_number)


# ---- tables ----------------------------------------------------------------------------------------


def _changed_table(change):
    """Return a spoiler of CSV from a function that changes its rows."""

    def spoil(content, rng):
        text = content.decode("utf-8", "replace")
        rows = list(csv.reader(io.StringIO(text)))
        if len(rows) < 2 or len(rows[0]) < 2:
            return content
        out = io.StringIO()
        csv.writer(out, lineterminator="\n").writerows(change(rows, rng))
        return out.getvalue().encode()

    spoil.__name__ = change.__name__
    return spoil


@_changed_table
def change_cell(rows, rng):
    row = rng.choice(rows[1:])
    row[rng.randrange(len(row))] = rng.choice(NUMBERS)
    return rows


@_changed_table
def change_column(rows, rng):
    column, value = rng.randrange(len(rows[0])), rng.choice(NUMBERS)
    for row in rows[1:]:
        row[column : column + 1] = [value]
    return rows


@_changed_table
def scale_column(rows, rng):
    column = rng.randrange(len(rows[0]))
    factor = rng.choice((-1.0, 1e-300, 1e300, 1e150, 1e12, 1e-12, 0.0))
    for row in rows[1:]:
        try:
            row[column] = repr(factor * float(row[column]))
        except (ValueError, IndexError):
            row[column : column + 1] = ["x"]
    return rows


@_changed_table
def change_header(rows, rng):
    rows[0][rng.randrange(len(rows[0]))] = rng.choice((*TEXTS, *NUMBERS, "time [s]", "x [bananas]", "x [N] [m]", "[]"))
    return rows


@_changed_table
def repeat_column(rows, rng):
    column = rng.randrange(len(rows[0]))
    return [[*row, *row[column : column + 1]] for row in rows]


@_changed_table
def lose_column(rows, rng):
    column = rng.randrange(len(rows[0]))
    return [row[:column] + row[column + 1 :] for row in rows]


@_changed_table
def exchange_columns(rows, rng):
    one, other = rng.randrange(len(rows[0])), rng.randrange(len(rows[0]))
    for row in rows:
        if max(one, other) < len(row):
            row[one], row[other] = row[other], row[one]
    return rows


@_changed_table
def change_length_of_row(rows, rng):
    row = rng.choice(rows)
    row[:] = rng.choice(([], row[:1], row[:-1], [*row, "1"], row * 2, [""] * len(row)))
    return rows


@_changed_table
def leave_few_rows(rows, rng):
    return rows[: rng.choice((1, 2, 3, 4, 6))]


@_changed_table
def disorder_rows(rows, rng):
    kind = rng.choice(("reversed", "shuffled", "same", "no header", "two headers", "transposed"))
    below = rows[1:]
    if kind == "reversed":
        return [rows[0], *reversed(below)]
    if kind == "shuffled":
        rng.shuffle(below)
        return [rows[0], *below]
    if kind == "same":
        return [rows[0], *[below[0]] * len(below)]
    if kind == "transposed":
        return [list(column) for column in zip(*rows, strict=False)]
    return below if kind == "no header" else [rows[0], *rows]


@_changed_table
def head_with_commas(rows, rng):
    return [[""] * len(rows[0]), *(rows[1:] if rng.random() < 0.5 else [])]


def separate_otherwise(content, rng):
    return content.replace(b",", rng.choice((b";", b"\t", b" ", b"|", b"", b",,")))


def quote(content, rng):
    at = rng.randrange(len(content) + 1)
    return content[:at] + rng.choice((b'"', b"'", b'""', b"#")) + content[at:]


TABLES = (
    *(change_cell, change_cell, change_cell, change_column, change_column, scale_column, scale_column, change_header),
    *(repeat_column, lose_column, exchange_columns, change_length_of_row, leave_few_rows, disorder_rows),
    *(head_with_commas, separate_otherwise, quote),
)


# ---- documents -------------------------------------------------------------------------------------


def _places(document, above=()):
    """Yield the path of every value in a document, tables and lists among them."""
    entries = (
        document.items() if isinstance(document, dict) else enumerate(document) if isinstance(document, list) else ()
    )
    for key, value in entries:
        yield (*above, key)
        yield from _places(value, (*above, key))


def _choose_place(document, rng):
    """Return a path in a document; those that are near its top are as likely as the many below them."""
    places = [*_places(document)]
    depth = rng.choice(sorted({len(each) for each in places}))
    return rng.choice([each for each in places if len(each) == depth])


def _holder(document, place):
    for key in place[:-1]:
        document = document[key]
    return document


def change_leaf(document, rng):
    place = _choose_place(document, rng)
    holder = _holder(document, place)
    old = holder[place[-1]]
    new = rng.choice(LEAVES)
    if isinstance(old, str) and rng.random() < 0.5:
        new = rng.choice(TEXTS)
    elif isinstance(old, float | int) and rng.random() < 0.5:
        new = rng.choice((-old, 1e12 * old, 1e-12 * old, 0.0, math.nan, 1e300, str(old)))
    holder[place[-1]] = new


def lose_key(document, rng):
    place = _choose_place(document, rng)
    del _holder(document, place)[place[-1]]


def rename_key(document, rng):
    place = _choose_place(document, rng)
    holder = _holder(document, place)
    if isinstance(holder, dict):
        holder[rng.choice((*TEXTS, f"{place[-1]}_", str(place[-1]).upper()))] = holder.pop(place[-1])


def repeat_item(document, rng):
    place = _choose_place(document, rng)
    holder = _holder(document, place)
    if isinstance(holder, list):
        holder.insert(place[-1], json.loads(json.dumps(holder[place[-1]], default=str)))


def exchange_values(document, rng):
    one, other = _choose_place(document, rng), _choose_place(document, rng)
    first, second = _holder(document, one)[one[-1]], _holder(document, other)[other[-1]]
    if not isinstance(first, dict | list) and not isinstance(second, dict | list):
        _holder(document, one)[one[-1]], _holder(document, other)[other[-1]] = second, first


def add_key(document, rng):
    place = _choose_place(document, rng)
    holder = _holder(document, place)
    if isinstance(holder, dict):
        holder[rng.choice((*TEXTS, "further"))] = rng.choice(LEAVES)


def change_schema(document, rng):
    if isinstance(document.get("schema"), str):
        name, _, number = document["schema"].rpartition("/")
        document["schema"] = rng.choice((f"{name}/{number}0", f"{name}/-1", "opid.comparison/1", "", 1, None, [1], {}))
    else:
        change_leaf(document, rng)


DOCUMENT = (*(change_leaf,) * 8, lose_key, lose_key, rename_key, repeat_item, exchange_values, add_key, change_schema)


def _without_null(value):
    """Return what TOML can hold of a value."""
    if isinstance(value, dict):
        return {str(key): _without_null(each) for key, each in value.items() if each is not None}
    if isinstance(value, list):
        return [_without_null(each) for each in value if each is not None]
    return value


def _changed_document(change, read, write):
    def spoil(content, rng):
        document = read(content.decode("utf-8-sig"))
        if not document:
            return content
        change(document, rng)
        return write(document).encode("utf-8", "surrogatepass")

    spoil.__name__ = change.__name__
    return spoil


def _write_json(document):
    return json.dumps(document, default=str)


def _write_toml(document):
    return tomli_w.dumps(_without_null(document))


def nest_json(content, rng):
    return rng.choice((b"[" * DEEP + b"]" * DEEP, b'{"a":' * DEEP + b"1" + b"}" * DEEP, b"[" * 200_000))


def nest_in_json(content, rng):
    """Put a deep list at the place of a value, so that everything else is as it was."""
    document = json.loads(content)
    place = _choose_place(document, rng)
    _holder(document, place)[place[-1]] = "@deep@"
    return json.dumps(document).replace('"@deep@"', "[" * 900 + "]" * 900).encode()


def write_numbers_as_json_does_not(content, rng):
    return content.replace(b"0.", rng.choice((b"00.", b".", b"-Infinity", b"9" * 5000, b"1e999")), 1)


def nest_toml(content, rng):
    return content + rng.choice(
        (
            *(b"\nx = " + b"[" * DEEP + b"]" * DEEP, b"\nx = " + b"{a = " * DEEP + b"1" + b"}" * DEEP),
            *(b"\n[" + b".".join([b"a"] * DEEP) + b"]\n", b"\nx = " + b"9" * 5000, b"\nx = 1e400\n", b"\n[runs]\n"),
            *(b"\nx = nan\n", b'\nx = """', b"\nx = 2026-99-99\n", b"\ntitle = 1\n"),
        )
    )


JSON = (*(_changed_document(each, json.loads, _write_json) for each in DOCUMENT), nest_json, nest_in_json)
JSON += (write_numbers_as_json_does_not,)
TOML = (*(_changed_document(each, tomllib.loads, _write_toml) for each in DOCUMENT), nest_toml)


# ---- archives of numpy -----------------------------------------------------------------------------


def _members(content):
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {info.filename: archive.read(info) for info in archive.infolist()}


def _archive(members, compression=zipfile.ZIP_DEFLATED):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", compression) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return out.getvalue()


def as_npy(array):
    out = io.BytesIO()
    np.save(out, array, allow_pickle=True)
    return out.getvalue()


def _changed_array(change):
    """Return a spoiler of npz from a function that changes one of its arrays."""

    def spoil(content, rng):
        members = _members(content)
        name = rng.choice(sorted(members))
        array = np.load(io.BytesIO(members[name]))
        members[name] = as_npy(change(array, rng))
        return _archive(members.items())

    spoil.__name__ = change.__name__
    return spoil


@_changed_array
def change_entry(array, rng):
    array = np.array(array)
    if array.dtype.kind == "f":
        put = rng.choice((math.nan, math.inf, -math.inf, 1e300, -1e300, 1e160, -1.0, 0.0, 1e-300))
    else:
        put = rng.choice((-1, 0, 1 << 30, -(1 << 30))) if array.dtype.kind in "iu" else rng.choice(TEXTS)
        array = array.astype(int if array.dtype.kind in "iu" else str)
    if array.size:
        array.flat[rng.randrange(array.size)] = put
    return array


@_changed_array
def change_all_entries(array, rng):
    if array.dtype.kind not in "fiu":
        return np.array([rng.choice(TEXTS)] * array.size)
    return array * rng.choice((0, -1, 1e300, 1e-300, 1e9, math.nan))


@_changed_array
def change_type(array, rng):
    kind = rng.choice(("f4", "f2", ">f8", "i8", "u1", "?", "c16", "S8", "U8", "M8[s]", "V8", "O", "f16"))
    try:
        return np.asarray(array).astype(kind)
    except (ValueError, TypeError, OverflowError):
        return np.zeros(np.shape(array), dtype=kind)


@_changed_array
def change_shape(array, rng):
    shapes = (
        *(lambda a: a.ravel(), lambda a: a[..., None], lambda a: a.T, lambda a: a[:-1] if a.ndim else a),
        *(lambda a: a.ravel()[:0], lambda a: np.array(a.ravel()[0] if a.size else 0), lambda a: a[None]),
        *(lambda a: np.concatenate([a, a]) if a.ndim else a, lambda a: np.asfortranarray(a), lambda a: a[::-1]),
        lambda a: np.zeros((0, 0)),
    )
    return rng.choice(shapes)(np.asarray(array))


@_changed_array
def make_records(array, rng):
    return np.zeros(3, dtype=[("a", "f8"), ("b", "i4")])


def put_other_member(content, rng):
    members = _members(content)
    name = rng.choice(sorted(members))
    other = (
        *(b"text", b"", b"\x93NUMPY", b"\x93NUMPY\x01\x00" + b"\xff" * 50, b"\x93NUMPY\x09\x00" + bytes(40)),
        *(pickle.dumps(print), members[name][:-3], members[name] + b"more", members[name][:20], b"\x00" * 300),
    )
    members[name] = rng.choice(other)
    return _archive(members.items())


def put_absurd_header(content, rng):
    """Give a member a header that says more than there is: 12 GB in an archive of some hundred bytes."""
    members = _members(content)
    name = rng.choice(sorted(members))
    shape, kind = rng.choice(ABSURD_SHAPES), rng.choice(("<f8", "<i4", "|S100", "|O"))
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape!r}, }}".encode()
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    members[name] = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + bytes(rng.choice((0, 8, 800)))
    return _archive(members.items())


def put_absurd_size(content, rng):
    """Give a Matrix Market file a size that says more, or less, than there is."""
    lines = content.split(b"\n")
    at = next(number for number, line in enumerate(lines) if not line.startswith(b"%"))
    sizes = lines[at].split()
    sizes[rng.randrange(len(sizes))] = rng.choice((b"0", b"-1", b"3", b"5", b"100000000000", b"1" + b"0" * 30, b"1.5"))
    lines[at] = b" ".join(sizes)
    return b"\n".join(lines)


def pack_zeros(content, rng):
    """A member of many zeros, which packs to a thousandth."""
    members = _members(content)
    members[rng.choice(sorted(members))] = as_npy(np.zeros(rng.choice((3_000_000, 5_000_000))))
    return _archive(members.items())


def lose_member(content, rng):
    members = _members(content)
    del members[rng.choice(sorted(members))]
    return _archive(members.items())


def repeat_member(content, rng):
    members = _members(content)
    name = rng.choice(sorted(members))
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return _archive([*members.items(), (name, members[name])])


def rename_member(content, rng):
    members = _members(content)
    name = rng.choice(sorted(members))
    other = rng.choice(("x.npy", "../x.npy", "/etc/x.npy", "a/b.npy", name.upper(), name.removesuffix(".npy"), ".npy"))
    members[other] = members.pop(name)
    return _archive(members.items())


def add_member(content, rng):
    members = _members(content)
    array = rng.choice((np.array([{1: 2}], dtype=object), np.zeros(3), np.array("x"), np.eye(2), np.zeros((2, 2, 2))))
    members[rng.choice(("further.npy", "part_x.npy", "mass.npy", "x_indptr.npy", "joints.npy"))] = as_npy(array)
    return _archive(members.items())


def exchange_members(content, rng):
    members = _members(content)
    one, other = rng.choice(sorted(members)), rng.choice(sorted(members))
    members[one], members[other] = members[other], members[one]
    return _archive(members.items())


def _mark_directory(content, offset, put):
    """Overwrite two bytes of each entry of an archive's directory."""
    changed, at = bytearray(content), content.find(b"PK\x01\x02")
    while at >= 0:
        changed[at + offset : at + offset + 2] = struct.pack("<H", put)
        at = content.find(b"PK\x01\x02", at + 1)
    return bytes(changed)


def encrypt(content, rng):
    return _mark_directory(content, 8, 1)


def pack_otherwise(content, rng):
    if rng.random() < 0.5:
        return _mark_directory(content, 10, rng.choice((6, 9, 12, 14, 93, 99)))
    return _archive(_members(content).items(), rng.choice((zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA, zipfile.ZIP_STORED)))


ARCHIVES = (
    *(change_entry, change_entry, change_entry, change_all_entries, change_all_entries, change_type, change_type),
    *(change_shape, change_shape, make_records, put_other_member, put_other_member, put_absurd_header, pack_zeros),
    *(lose_member, repeat_member, rename_member, add_member, exchange_members, encrypt, pack_otherwise),
)

OF_FORMAT = {
    ".csv": (*TABLES, *TEXT),
    ".json": (*JSON, *TEXT),
    ".toml": (*TOML, *TEXT),
    ".npz": ARCHIVES,
    ".mtx": (put_absurd_size, *TEXT),
}
"""Spoilers of each format; one that is in no row has those of any file alone."""


def spoil(content, ending, rng):
    """Return a file spoiled once, or sometimes twice, and the names of what was done to it."""
    names = []
    for _ in range(rng.choice((1, 1, 1, 1, 2))):
        own = OF_FORMAT.get(ending, ())
        spoiler = rng.choice(own) if own and rng.random() < 0.8 else rng.choice(ANY)
        try:
            content = spoiler(content, rng)
        except Exception:
            # what is spoiled already is no file of its format
            if not names:
                raise
            continue
        names.append(spoiler.__name__)
    return content, names


def spoiled(content, ending):
    """Return the strategy of a sound file spoiled: (content, names of what was done)."""
    return st.randoms(use_true_random=False).map(lambda rng: spoil(content, ending, rng))


# ---- what stands in the place of a file ------------------------------------------------------------


def put_nothing(path):
    path.unlink()


def put_directory(path):
    path.unlink()
    path.mkdir()


def put_pipe(path):
    path.unlink()
    os.mkfifo(path)


def put_loop(path):
    path.unlink()
    path.symlink_to(path.name)


def put_broken_link(path):
    path.unlink()
    path.symlink_to("nowhere")


def put_device(path):
    path.unlink()
    path.symlink_to("/dev/zero")


def put_empty_device(path):
    path.unlink()
    path.symlink_to("/dev/null")


def put_unreadable(path):
    path.chmod(0)


PLACES = (put_nothing, put_directory, put_pipe, put_loop, put_broken_link, put_device, put_empty_device, put_unreadable)
