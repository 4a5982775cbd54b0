"""Error against the reference of Schaefer and Turek's 2D-2 or 2D-3 over processor time: python bench/work_precision.py FOLDER [--flow 2D-3] [--only REGEX] [--picture FILE.svg]

Schaefer, Turek 1996: a cylinder of 0.1 m in a channel of 2.2 x 0.41 m, Re 100. The answer of 2D-2 is the largest drag and lift coefficient and the
Strouhal number of the settled wake; that of 2D-3, whose inlet follows sin(pi t/8), the largest drag and lift coefficient. The error is the mean of the
relative errors to REFERENCE. Each run starts from rest and goes to END, or (2D-2) ends where m4gnAverages knows mean drag and rms of lift to one
percent (stop); with dmd the surrogate takes part. The loose settings are those of the family's baseline. A run that is there is not made again.
Needs env.sh, gmsh, icoFoam in PATH, and numpy (matplotlib for the picture)."""
import argparse, json, math, os, re, resource, shutil, subprocess
import numpy as np

TEMPLATE = os.path.join(os.environ["M4GN_HOME"], "openfoam/templates/cylinder-flow")
END = {"2D-2": 12.0, "2D-3": 8.0}
# Midpoints of the benchmark's ranges: 3.22 to 3.24, 0.99 to 1.01, 0.295 to 0.305; 2.93 to 2.97, 0.47 to 0.49
REFERENCE = {"2D-2": {"drag": 3.23, "lift": 1.0, "strouhal": 0.3}, "2D-3": {"drag": 2.95, "lift": 0.48}}
SPEED, DIAMETER = 1.0, 0.1
SIZES = (0.0408, 0.0286, 0.02, 0.014)
# Courant number that the time step aims at, by the rule of family.toml
COURANT = 0.8
SCHEMES = {"Euler": "Euler", "backward": "backward", "CrankNicolson": "CrankNicolson 0.9"}
# Tolerance of the linear solvers, and correctors of non-orthogonality
SETTINGS = {False: dict(tolerance=1e-6, correctors=1), True: dict(tolerance=1e-4, correctors=0)}
SURROGATE = "surrogate { type m4gnSurrogate; libs (m4gnFoam); mode replace; surrogates (dmd); }"
AVERAGES = """averages { type m4gnAverages; libs (m4gnAverages); stop yes; minTime 2; quantities {
    Cd { functionObject forces; result Cd; relative 0.01; } Cl { functionObject forces; result Cl; statistic rms; relative 0.01; } } }"""


def plans():
    """name: mesh's shape and size, scheme, loose settings, whether the surrogate takes part, whether the run ends when it knows."""
    for shape in ("triangles", "quads"):
        for size in SIZES:
            for scheme, loose in [(scheme, False) for scheme in SCHEMES] + [("Euler", True)]:
                for dmd in (False, True):
                    for stop in (False, True):
                        name = f"{shape}-{size}-{scheme}{'-loose' if loose else ''}{'-dmd' if dmd else ''}{'-stop' if stop else ''}"
                        yield name, dict(shape=shape, size=size, scheme=scheme, loose=loose, dmd=dmd, stop=stop)


def fill(case, name, values):
    path = os.path.join(case, name)
    text = open(path).read()
    for key, value in values.items():
        text = text.replace(f"@{key}@", str(value))
    open(path, "w").write(text)


def run(case, *command):
    with open(f"{case}/log.{command[0]}", "w") as log:
        subprocess.run(command, cwd=case, stdout=log, stderr=subprocess.STDOUT, check=True)


def make(case, plan):
    shutil.copytree(TEMPLATE, case)
    fill(case, "mesh.geo", dict(x=0.2, y=0.2, radius=0.05, size=plan["size"], shape=0, elements=int(plan["shape"] == "quads")))
    path = os.path.join(case, "mesh.geo")
    text = open(path).read()
    open(path, "w").write(text.replace("L = 1.6;", "L = 2.2;"))
    # A polynomial of degree two with 1.5 m/s at mid-height
    fill(case, "0/U", dict(linear=4 * 1.5 / 0.41, quadratic=-4 * 1.5 / 0.41**2))
    if plan["flow"] == "2D-3":
        path = os.path.join(case, "0/U")
        inlet = 'inlet { type exprFixedValue; valueExpr "vector(6*pos().y()*(0.41 - pos().y())/0.1681*sin(pi()*time()/8), 0, 0)"; value uniform (0 0 0); }'
        text = open(path).read()
        open(path, "w").write(re.sub(r"inlet\s*\{.*?\n    \}", lambda _: inlet, text, flags=re.S))
    fill(case, "constant/transportProperties", dict(nu=1e-3))
    fill(case, "system/fvSolution", SETTINGS[plan["loose"]])
    fill(case, "system/fvSchemes", dict(convection=0))
    steps = math.ceil(0.05 * 9.5 * 1.5 / plan["size"] / (1 - 0.1 / 0.41) / COURANT)
    fill(case, "system/controlDict", dict(endTime=END[plan["flow"]], deltaT=repr(0.05 / steps), writeInterval=END[plan["flow"]]))
    path = os.path.join(case, "system/fvSchemes")
    text = open(path).read()
    open(path, "w").write(re.sub(r"default\s+Euler", f"default {SCHEMES[plan['scheme']]}", text))
    forces = (f"forces {{ type forceCoeffs; libs (forces); patches (cylinder); rho rhoInf; rhoInf 1; CofR (0.2 0.2 0); liftDir (0 1 0); dragDir (1 0 0); "
              f"pitchAxis (0 0 1); magUInf {SPEED}; lRef {DIAMETER}; Aref {DIAMETER * 0.01}; log no; }}")
    with open(f"{case}/system/functions", "w") as out:
        out.write("\n".join([forces] + [SURROGATE] * plan["dmd"] + [AVERAGES] * plan["stop"]) + "\n")
    run(case, "gmsh", "-nt", "1", "-3", "-format", "msh2", "-o", "mesh.msh", "mesh.geo")
    run(case, "gmshToFoam", "mesh.msh")
    run(case, "changeDictionary", "-constant")


def answer(case, flow):
    """2D-2: largest drag and lift, and the Strouhal number, of the last whole periods within two seconds; 2D-3: the largest of all."""
    rows = np.loadtxt(f"{case}/postProcessing/forces/0/coefficient.dat")
    names = [l for l in open(f"{case}/postProcessing/forces/0/coefficient.dat") if l.startswith("# Time")][0].split()[1:]
    t, drag, lift = rows[:, 0], rows[:, names.index("Cd")], rows[:, names.index("Cl")]
    if flow == "2D-3":
        return dict(drag=drag[t > 1].max(), lift=lift[t > 1].max(), end=t[-1])
    late = t > t[-1] - 2
    t, drag, lift = t[late], drag[late], lift[late]
    level = lift.mean()
    up = np.flatnonzero((lift[:-1] < level) & (lift[1:] >= level))
    crossing = t[up] + (level - lift[up]) / (lift[up + 1] - lift[up]) * (t[up + 1] - t[up])
    if len(crossing) < 3:
        return dict(drag=drag.max(), lift=lift.max(), strouhal=0.0, end=t[-1])
    frequency = (len(crossing) - 1) / (crossing[-1] - crossing[0])
    return dict(drag=drag.max(), lift=lift.max(), strouhal=frequency * DIAMETER / SPEED, end=t[-1])


def measured(folder, name, plan):
    case = os.path.join(folder, name)
    kept = os.path.join(folder, f"{name}.json")
    if not os.path.exists(kept):
        shutil.rmtree(case, ignore_errors=True)
        make(case, plan)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run(case, "icoFoam")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        found = dict(plan, seconds=after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, **answer(case, plan["flow"]))
        found["cells"] = int(re.search(rb"nCells:\s*(\d+)", open(f"{case}/constant/polyMesh/owner", "rb").read()).group(1))
        found["error"] = float(np.mean([abs(found[k] / value - 1) for k, value in REFERENCE[plan["flow"]].items()]))
        with open(kept, "w") as out:
            json.dump(found, out)
        shutil.rmtree(case)
    # A run that is kept may lack an entry of its plan
    return dict(plan, **json.load(open(kept)))


def picture(rows, path):
    """A dot a run: its colour says how it ran, its shape the mesh, its filling the scheme; loose settings have small ones."""
    import matplotlib
    matplotlib.use("svg")
    import matplotlib.pyplot as plt
    import matplotlib.ticker
    figure, axes = plt.subplots(figsize=(7, 4))
    colours = {(False, False): ("plain, to the end", "#777777"), (False, True): ("plain, until its means are known", "#0072B2"),
               (True, False): ("dmd, to the end", "#D55E00"), (True, True): ("dmd, until its means are known", "#E69F00")}
    shapes = {"quads": "s", "triangles": "^"}
    fillings = {"Euler": None, "backward": "white", "CrankNicolson": "lightgrey"}
    for r in rows:
        colour = colours[r["dmd"], r["stop"]][1]
        axes.loglog(r["seconds"], 100 * r["error"], shapes[r["shape"]], color=colour, markersize=4 if r["loose"] else 7,
                    markerfacecolor=fillings[r["scheme"]] or colour)
    for label, colour in colours.values():
        axes.plot([], [], "o", color=colour, label=label)
    for label, shape, face in (("quadrilaterals", "s", "k"), ("triangles", "^", "k"), ("Euler", "o", "k"), ("backward", "o", "w"),
                               ("CrankNicolson 0.9", "o", "lightgrey"), ("Euler, loose", ".", "k")):
        axes.plot([], [], shape, color="k", markerfacecolor=face, label=label)
    for axis, ticks in ((axes.xaxis, (10, 20, 50, 100, 200)), (axes.yaxis, (1, 2, 3, 5, 10))):
        axis.set_major_locator(matplotlib.ticker.FixedLocator(ticks))
        axis.set_major_formatter(matplotlib.ticker.ScalarFormatter())
        axis.set_minor_formatter(matplotlib.ticker.NullFormatter())
    axes.set_xlabel("processor time, s")
    axes.set_ylabel("error against the benchmark, %")
    axes.grid(True, which="both", linewidth=0.3)
    axes.legend(fontsize=7, ncols=2)
    figure.tight_layout()
    figure.savefig(path)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--flow", default="2D-2", choices=sorted(END))
    parser.add_argument("--only", default="")
    parser.add_argument("--picture")
    args = parser.parse_args()
    os.makedirs(args.folder, exist_ok=True)
    rows = []
    print("| run | cells | ended, s | processor time, s | drag | lift | Strouhal | error, % |\n| --- | --- | --- | --- | --- | --- | --- | --- |")
    for name, plan in plans():
        if args.flow == "2D-3" and plan["stop"]:
            continue
        if re.search(args.only, name):
            r = measured(args.folder, name if args.flow == "2D-2" else f"{args.flow}-{name}", dict(plan, flow=args.flow))
            rows.append(r)
            print(f"| {name} | {r['cells']} | {r['end']:.2f} | {r['seconds']:.1f} | {r['drag']:.4f} | {r['lift']:.4f} | {r.get('strouhal', 0):.4f} | "
                  f"{100 * r['error']:.2f} |", flush=True)
    if args.picture:
        picture(rows, args.picture)


if __name__ == "__main__":
    main()
