#!/usr/bin/env python3
"""What a start from the surrogate's field saves simpleFoam.

    m4gn hybrid --model MODEL --count 3 --seed 5 --set u0=0.8:0.9 --set radius=0.033:0.036 --keep-cases --out run/steady
    bench/steady.py run/steady/*/full --model MODEL

CASE is a case of icoFoam with fields at time 0 whose flow becomes steady. simpleFoam (SIMPLEC, laminar, the case's schemes) solves it from
the case's own field, from that of potentialFoam, from that of icoFoam after the spin-up, from that of the surrogate, which goes on from
there to --end, and from that of icoFoam at --end, which is what a surrogate without error would give. Prints iterations, wall times of
the preparation and of simpleFoam (medians of --repeats, by turns), and the largest difference of the converged velocity from that of the
first start over the largest velocity. Needs env.sh sourced, icoFoam, potentialFoam and simpleFoam.
"""

import argparse
import json
import pathlib
import re
import shutil
import statistics
import sys
import tempfile

import foam_case

STARTS = ["own", "potentialFoam", "spin-up", "surrogate", "icoFoam"]


def make_steady(folder: pathlib.Path, tolerance: float) -> None:
    """Turns a copy of an icoFoam case into one of simpleFoam."""
    head = "FoamFile {{ version 2.0; format ascii; class dictionary; object {}; }}\n"
    turbulence = "turbulenceProperties"
    (folder / "constant" / turbulence).write_text(head.format(turbulence) + "simulationType laminar;\n")
    transport = folder / "constant/transportProperties"
    transport.write_text(transport.read_text() + "transportModel Newtonian;\n")
    schemes = folder / "system/fvSchemes"
    text = re.sub(r"(ddtSchemes\s*\{\s*default\s+)\w+;", r"\1steadyState;", schemes.read_text())
    text = re.sub(r"(divSchemes\s*\{)", r"\1\n    div((nuEff*dev2(T(grad(U))))) Gauss linear;\n    div(div(phi,U)) Gauss linear;", text)
    schemes.write_text(text)
    (folder / "system/fvSolution").write_text(
        head.format("fvSolution") + "solvers\n{\n"
        "    p { solver GAMG; smoother GaussSeidel; tolerance 1e-9; relTol 0.05; }\n"
        "    Phi { $p; relTol 0.01; }\n"
        "    U { solver smoothSolver; smoother symGaussSeidel; tolerance 1e-10; relTol 0.1; }\n}\n"
        "potentialFlow { nNonOrthogonalCorrectors 3; }\n"
        f"SIMPLE {{ consistent yes; nNonOrthogonalCorrectors 0; residualControl {{ p {tolerance}; U {tolerance}; }} }}\n"
        "relaxationFactors { equations { U 0.9; } }\n"
    )


def prepare(arguments: argparse.Namespace, case: pathlib.Path, folder: pathlib.Path, start: str) -> tuple[pathlib.Path, str, float]:
    """A case with the fields that simpleFoam is to start from, their time, and what they cost, s."""
    if start in ("own", "potentialFoam"):
        return case, "0", 0.0
    end = arguments.spin_up if start == "spin-up" else arguments.end
    entries = f"endTime {end};\nwriteControl runTime;\nwriteInterval {end};\nwriteFormat ascii;\nwritePrecision 12;\n"
    foam_case.copy(case, folder, "0", entries)
    objects = ""
    if start == "surrogate":
        objects = (
            f'surrogate {{ type m4gnSurrogate; libs (m4gnFoam); mode replace; model "{arguments.model}"; precision auto; '
            f"timeStart {arguments.spin_up}; solverSteps 1; surrogateSteps 1000; }}\n"
        )
    foam_case.set_functions(folder, objects)
    return folder, end, foam_case.run(["icoFoam"], folder)


def solve(arguments: argparse.Namespace, case: pathlib.Path, folder: pathlib.Path, start: str) -> dict:
    """One run: seconds, iterations, and the velocity at the end."""
    source, at, seconds = prepare(arguments, case, folder / "unsteady", start)
    steady = folder / "steady"
    end = float(at) + arguments.iterations
    entries = (
        f"application simpleFoam;\nendTime {end:g};\ndeltaT 1;\nwriteControl timeStep;\nwriteInterval {arguments.iterations};\n"
        "writeFormat ascii;\nwritePrecision 12;\n"
    )
    foam_case.copy(source, steady, at, entries)
    foam_case.set_functions(steady, "")
    # Of the steady case only fields count: no rates, no states of function objects, no flux of another scheme
    for entry in (steady / at).iterdir():
        if entry.name not in ("U", "p"):
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
    make_steady(steady, arguments.tolerance)
    if start == "potentialFoam":
        seconds += foam_case.run(["potentialFoam", "-writep"], steady)
    took = foam_case.run(["simpleFoam"], steady)
    log = (steady / "log").read_text()
    times = re.findall(r"^Time = (\S+)$", log, flags=re.M)
    row = {"prepared_s": seconds, "simple_s": took, "iterations": len(times)}
    row["converged"] = "SIMPLE solution converged" in log
    row["U"] = foam_case.field(steady, "U", times[-1])
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="+", type=pathlib.Path, metavar="CASE")
    parser.add_argument("--model", type=pathlib.Path, required=True)
    parser.add_argument("--spin-up", default="1", help="time at which the surrogate takes over (default 1)")
    parser.add_argument("--end", default="4", help="time of its field (default 4)")
    parser.add_argument("--tolerance", type=float, default=1e-6, help="of the residuals of p and U (default 1e-6)")
    parser.add_argument("--iterations", type=int, default=5000, help="at most (default 5000)")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each kind (default 3)")
    parser.add_argument("--json", type=pathlib.Path, help="write the figures to this file")
    arguments = parser.parse_args()
    arguments.model = arguments.model.resolve()
    figures = {}
    for case in arguments.cases:
        if not (case / "0/U").is_file():
            sys.exit(f"{case}: no field U at time 0; expected a case of icoFoam, such as those of 'm4gn hybrid --keep-cases'")
        rows: dict[str, list[dict]] = {start: [] for start in STARTS}
        for _ in range(arguments.repeats):
            for start in STARTS:
                with tempfile.TemporaryDirectory() as scratch:
                    rows[start].append(solve(arguments, case, pathlib.Path(scratch), start))
        reference = rows["own"][0]["U"]
        largest = max(map(abs, reference))
        print(f"{case}\n{'start':14} {'iterations':>10} {'prepared s':>11} {'simpleFoam s':>13} {'both s':>8} {'difference':>11}")
        figures[str(case)] = {}
        for start, runs in rows.items():
            row = {key: statistics.median(r[key] for r in runs) for key in ("iterations", "prepared_s", "simple_s")}
            row["converged"] = all(r["converged"] for r in runs)
            row["difference"] = max(abs(a - b) for a, b in zip(runs[0]["U"], reference)) / largest
            figures[str(case)][start] = row
            print(
                f"{start:14} {row['iterations']:10} {row['prepared_s']:11.2f} {row['simple_s']:13.2f} "
                f"{row['prepared_s'] + row['simple_s']:8.2f} {row['difference']:11.1e}{'' if row['converged'] else '  not converged'}"
            )
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
