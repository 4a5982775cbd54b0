"""Copies of OpenFOAM cases for measurements, their runs and their results."""

import pathlib
import re
import shutil
import subprocess
import sys
import time


def copy(case: pathlib.Path, folder: pathlib.Path, start: str, entries: str) -> str:
    """Copies a case with the fields of its time `start` into an empty folder, to run from there with these entries of controlDict in
    place of its own; the name of its solver."""
    for part in ("constant", "system", start):
        if not (case / part).is_dir():
            sys.exit(f"{case}: no folder {part}; expected a case with fields at time {start}")
        shutil.copytree(case / part, folder / part)
    control = folder / "system/controlDict"
    text = control.read_text()
    solver = re.search(r"^\s*application\s+(\w+)", text, flags=re.M)
    if not solver:
        sys.exit(f"{control}: no entry application")
    entries = f"startFrom startTime;\nstartTime {start};\nstopAt endTime;\n{entries}"
    keys = "|".join({*re.findall(r"^(\w+) [^{}]*;$", entries, flags=re.M), "purgeWrite"})
    control.write_text(re.sub(rf"^\s*({keys})\s.*$", "", text, flags=re.M) + "\n" + entries)
    return solver.group(1)


def set_functions(folder: pathlib.Path, objects: str) -> None:
    """Puts these function objects in the place of the case's own."""
    control = folder / "system/controlDict"
    text = re.sub(r"^functions\s*\{.*?^\}", "", control.read_text(), flags=re.M | re.S)
    control.write_text(text + f"functions\n{{\n{objects}}}\n")


def run(command: list[str], folder: pathlib.Path, env: dict[str, str] | None = None) -> float:
    """Runs a program in a case, whose output goes into the case's file log; its wall time, s."""
    began = time.monotonic()
    with open(folder / "log", "w") as log:
        done = subprocess.run(command, cwd=folder, env=env, stdout=log, stderr=log)
    seconds = time.monotonic() - began
    if done.returncode:
        sys.exit(f"{' '.join(command)} in {folder} ended with status {done.returncode}:\n{(folder / 'log').read_text()[-2000:]}")
    return seconds


def field(folder: pathlib.Path, name: str, at: str) -> list[float]:
    """All numbers of a field's cells at a time, written in ascii."""
    times = (t for t in folder.iterdir() if re.fullmatch(r"[0-9.e+-]+", t.name) and abs(float(t.name) - float(at)) < 1e-6)
    file = next((t / name for t in times), None)
    if file is None or not file.is_file():
        sys.exit(f"{folder}: no {name} at time {at}")
    values = re.search(r"internalField.*?\n\(\n(.*?)\n\)", file.read_text(), flags=re.S)
    if not values:
        sys.exit(f"{file}: no list of values in ascii")
    return [float(v) for v in re.findall(r"[-+.\deE]+", values.group(1))]
