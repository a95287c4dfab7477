"""A day of a recording through `live`: memory, frames, database.

Makes a points file of recordings of a radar that stand in one folder, repeats it until it is a day long, and describes it as
fast as the machine can. Prints the frames that were used, lost and dropped beside those of the file, the resident memory over
time, and the rows and the size of the database.

    python3 studies/day.py radarllm FOLDER [OPTIONS OF live ...]

Needs pyarrow, and Linux for the memory.
"""

import argparse
import json
import math
import pathlib
import sqlite3
import subprocess
import tempfile

import pyarrow
import pyarrow.compute
import pyarrow.parquet

DAY_S = 86_400
PAGE_KIB = 4


def repeated(source: pathlib.Path, out: pathlib.Path) -> tuple[int, float]:
    """Writes the points file again and again into one of a day; its number of frames and its length in hours."""
    file = pyarrow.parquet.ParquetFile(source)
    metadata = {k: v for k, v in file.metadata.metadata.items() if k != b"ARROW:schema"}
    table = file.read()
    n_frames = int(metadata[b"n_frames"])
    length_s = n_frames / float(metadata[b"frame_rate"])
    copies = math.ceil(DAY_S / length_s)
    missing = [part for part in metadata.get(b"missing_frames", b"").decode().split(",") if part]

    def shifted(part: str, by: int) -> str:
        return "-".join(str(int(number) + by) for number in part.split("-"))

    tables, all_missing = [], []
    for copy in range(copies):
        columns = {
            "frame": pyarrow.compute.add(table["frame"], copy * n_frames),
            "t_s": pyarrow.compute.add(table["t_s"], copy * length_s),
        }
        part = table
        for name, column in columns.items():
            at = part.schema.get_field_index(name)
            part = part.set_column(at, name, column.cast(table.schema.field(name).type))
        tables.append(part)
        all_missing += [shifted(numbers, copy * n_frames) for numbers in missing]
    metadata[b"n_frames"] = str(copies * n_frames).encode()
    if missing:
        metadata[b"missing_frames"] = ",".join(all_missing).encode()
    whole = pyarrow.concat_tables(tables).replace_schema_metadata(metadata)
    pyarrow.parquet.write_table(whole, out)
    return copies * n_frames, copies * length_s / 3600


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("radarllm")
    parser.add_argument("folder", type=pathlib.Path)
    args, options = parser.parse_known_args()
    with tempfile.TemporaryDirectory() as folder:
        base = pathlib.Path(folder)
        recording, day, database = base / "recording.parquet", base / "day.parquet", base / "day.db"
        process = [args.radarllm, "process", args.folder, "--out", recording]
        subprocess.run(process, check=True, capture_output=True)
        n_frames, hours = repeated(recording, day)
        live = [args.radarllm, "live", day, "--speed", "max", "--json", "--no-http", "--db", database]
        memory, health, falls, rows = [], {}, 0, set()
        with subprocess.Popen([*live, *options], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as running:
            statm = pathlib.Path(f"/proc/{running.pid}/statm")
            for line in running.stdout:
                message = json.loads(line)
                if message["type"] == "health":
                    health = message
                    pages = statm.read_text().split()
                    memory += [int(pages[1]) * PAGE_KIB / 1024] if len(pages) > 1 else []
                falls += message["type"] == "fall"
                if message["type"] == "activity":
                    rows.add(message["id"])
        memory = [value for value in memory if value > 0]
        quarter = memory[len(memory) // 4 :]
        print(f"{hours:.1f} h, {n_frames} frames, exit status {running.returncode}")
        print(f"frames used {health['frames_used']}, lost {health['frames_lost']}, dropped {health['frames_dropped']}")
        print(f"resident memory after a quarter of the time: {min(quarter):.0f} to {max(quarter):.0f} MiB")
        connection = sqlite3.connect(database)
        integrity = connection.execute("pragma integrity_check").fetchone()[0]
        connection.close()
        print(f"activities {len(rows)}, messages of falls {falls}")
        print(f"database {database.stat().st_size / 1024:.0f} KiB, integrity {integrity}")


if __name__ == "__main__":
    main()
