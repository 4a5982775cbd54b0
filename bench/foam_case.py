"""Copies of OpenFOAM cases for measurements."""

import pathlib
import re
import shutil
import sys


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
