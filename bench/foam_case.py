"""Times, fields and copies of an OpenFOAM case, for the scripts beside this file."""
import os, re, shutil
import numpy as np

LIST = re.compile(rb"nonuniform\s+List<(\w+)>\s*\n?\s*(\d+)\s*\n?\(")


def field(path):
    """Values of a field's cells, cells x components, from an ascii or a binary file."""
    text = open(path, "rb").read()
    found = LIST.search(text)
    width = {b"vector": 3, b"scalar": 1}[found.group(1)]
    n = int(found.group(2)) * width
    values = text[found.end() :]
    if re.search(rb"format\s+ascii", text):
        return np.array(re.sub(rb"[()]", b" ", values[: values.index(b"\n)\n") + 1]).split()[:n], float).reshape(-1, width)
    return np.frombuffer(values, "<f8", n).reshape(-1, width)


def times(case):
    """Names of the time folders after 0, in order."""
    number = re.compile(r"[0-9]+(\.[0-9]+)?(e[+-]?[0-9]+)?")
    return sorted((t for t in os.listdir(case) if number.fullmatch(t) and float(t) > 0), key=float)


def copied(case, to, surrogate):
    """A case anew, before its run, with a surrogate of these settings alone."""
    shutil.rmtree(to, ignore_errors=True)
    for part in ("0", "constant", "system"):
        shutil.copytree(f"{case}/{part}", f"{to}/{part}")
    with open(f"{to}/system/functions", "w") as out:
        out.write(f"surrogate {{ type m4gnSurrogate; libs (m4gnFoam); mode replace; surrogates (dmd); dmd {{ {surrogate} }} }}")
