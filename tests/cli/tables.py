"""Tables of a run as HDF5."""

import json
import math
import resource
import shutil
import signal
import subprocess

from harness import SCENE, Skip, case, expect, with_python

TABLES = ("haptic", "visual")


def read(*files):
    return json.loads(with_python({"h5py": "python3-h5py"}, "hdf5_tables.py", *files))


def alike(text, other):
    """A cell of CSV beside one of HDF5."""
    try:
        a, b = float(text), float(other)
    except ValueError:
        return text == other
    return a == b or (math.isnan(a) and math.isnan(b))


@case
def tables_hdf5_is_csv(context):
    """The same columns and numbers to the bit, over several chunks; the other form of an earlier run is gone."""
    scene = context.file("scene.yaml", SCENE)
    options = ["run", scene, "--duration", "4.5", "--pictures", "0", "--out", context.out]
    context.succeeds(options)
    written = {}
    for name in TABLES:
        written[name] = [line.split(",") for line in (context.out / f"{name}.csv").read_text().splitlines()]
    expect(len(written["haptic"]) == 4501, "not the ticks that were asked for")
    context.succeeds([*options, "--table-format", "hdf5"])
    found = read(*(context.out / f"{name}.h5" for name in TABLES))
    for name in TABLES:
        header, *rows = written[name]
        columns = found[str(context.out / f"{name}.h5")]
        expect(sorted(columns) == sorted(header), f"{name}: columns differ: {sorted(set(columns) ^ set(header))}")
        for index, column in enumerate(header):
            cells = columns[column]
            expect(len(cells) == len(rows), f"{name}.{column}: {len(cells)} rows and not {len(rows)}")
            bad = [i for i, row in enumerate(rows) if not alike(row[index], cells[i])]
            expect(not bad, f"{name}.{column} differs in row {bad[:1]}")
        expect(not (context.out / f"{name}.csv").exists(), f"{name}.csv of the run before is still there")
    first = {name: (context.out / f"{name}.h5").read_bytes() for name in TABLES}
    context.succeeds([*options, "--table-format", "hdf5"])
    expect(all((context.out / f"{name}.h5").read_bytes() == first[name] for name in TABLES), "the bytes differ")
    context.succeeds(options)
    expect(not list(context.out.glob("*.h5")), "the HDF5 tables of the run before are still there")


@case
def tables_hdf5_is_read_by_its_own_tool(context):
    if not shutil.which("h5dump"):
        raise Skip("hdf5-tools is not installed (./dev setup test)")
    context.succeeds(["run", context.file("scene.yaml", SCENE), "--pictures", "0", "--table-format", "hdf5", "--out", context.out])
    done = subprocess.run(["h5dump", "-d", "/sent_fz_N", context.out / "haptic.h5"], capture_output=True, text=True)
    expect(done.returncode == 0 and "H5T_IEEE_F64LE" in done.stdout and "( 300 )" in done.stdout, done.stderr or done.stdout[:400])


@case
def tables_hdf5_disk_full(context):
    """What fits can be read, in whole rows."""
    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1_500_000, 1_500_000))

    arguments = ["run", context.file("scene.yaml", SCENE.replace("position: [0.005, 0, -0.002]", "position: [0.005, 0, -0.02]")), "--duration",
                 "600", "--table-format", "hdf5", "--out", context.out]  # fmt: skip
    process = context.start(arguments, preexec_fn=limit)
    _, errors = process.communicate(timeout=100)
    expect(process.returncode == 1 and "cannot be written" in errors, f"exit code {process.returncode}: {errors!r}")
    expect(context.summary()["ended_by"] == "failure", "the summary does not say it")
    columns = read(context.out / "haptic.h5").popitem()[1]
    rows = {len(cells) for cells in columns.values()}
    expect(len(rows) == 1 and rows.pop() >= 4096, f"columns of {rows} rows")
