"""A checkpoint of NVIDIA PhysicsNeMo's MeshGraphNet in m4gn and back.

    $python -m pip install h5py safetensors           # into the environment of bench/README.md
    m4gn convert FRAMES.npz --split train --out data/a.h5
    m4gn train --data data --config configs/kind-mesh-graph-net.toml --out like.safetensors     # a few steps are enough
    $python bench/physicsnemo_weights.py like.safetensors data/a.h5

A MeshGraphNet of random weights, of the size of the model `like` (kind mesh-graph-net, which reads and predicts U and p as changes), is saved by PyTorch, converted, and
makes one step of the trajectory in both: PhysicsNeMo on the same graph in fp64, m4gn by `m4gn predict`. Told is the largest difference over
the largest change, of the points that no boundary holds; of p less a constant, since its level is kept. Then the weights go back. Exit
status 1 where a difference is above 1e-4 or a bit of the weights differs.
"""

import pathlib
import subprocess
import sys
import tempfile

import h5py
import numpy
import torch
from physicsnemo.models.meshgraphnet import MeshGraphNet
from safetensors.torch import load_file
from torch_geometric.data import Data

OUTLET = 3


def network(like):
    """Of random weights, of the sizes of m4gn's tensors."""
    layers = len({name.split(".")[1] for name in like if name.startswith("processor.")})
    hidden = len([name for name in like if name.startswith("encoder.node.") and name.endswith("weight")]) - 2
    width, inputs = like["encoder.node.0.weight"].shape
    parts = ("node_processor", "edge_processor", "node_encoder", "edge_encoder", "node_decoder")
    sizes = {f"num_layers_{part}": hidden for part in parts}
    sizes |= {f"hidden_dim_{part}": width for part in ("processor", "node_encoder", "edge_encoder", "node_decoder")}
    outputs = like["norm.output.mean"].numel()
    made = MeshGraphNet(inputs, like["encoder.edge.0.weight"].shape[1], outputs, processor_size=layers, aggregation="sum", **sizes)
    with torch.no_grad():
        for p in made.parameters():
            p.add_(0.05 * torch.randn_like(p))
    return made


def step(made, like, trajectory):
    """The change of U and p at the points in the first step, by PhysicsNeMo, and the points that nothing holds."""
    mesh, n = trajectory["mesh"], len(trajectory["mesh/cell_volumes"])
    owner, kind = mesh["boundary_owner"][:], mesh["boundary_type"][:]
    at = numpy.vstack([mesh["cell_centres"][:, :2], mesh["boundary_centres"][:, :2]])
    faces, boundary = (mesh["face_owner"][:], mesh["face_neighbour"][:]), n + numpy.arange(len(owner))
    send = numpy.concatenate([*faces, owner, boundary])
    receive = numpy.concatenate([*faces[::-1], boundary, owner])
    apart = at[send] - at[receive]
    edges = numpy.hstack([apart, numpy.linalg.norm(apart, axis=1, keepdims=True)])
    both = lambda name: numpy.vstack([trajectory[f"fields/{name}/{where}"][0] for where in ("cells", "boundary")])
    velocity, pressure = both("U"), both("p")
    level = pressure[n:][kind == OUTLET]
    pressure -= 0.5 * (level.min() + level.max())
    types = numpy.zeros((len(at), like["encoder.node.0.weight"].shape[1] - 3))
    types[numpy.arange(len(at)), numpy.concatenate([numpy.zeros(n, int), kind])] = 1
    scaled = lambda x, of: (torch.tensor(x).double() - like[f"norm.{of}.mean"]) / like[f"norm.{of}.std"]
    nodes = torch.cat([scaled(numpy.hstack([velocity, pressure]), "node"), torch.tensor(types)], 1)
    graph = Data(edge_index=torch.tensor(numpy.stack([send, receive])), num_nodes=len(at))
    with torch.no_grad():
        out = made.double().eval()(nodes, scaled(edges, "edge"), graph)
    free = numpy.ones(n, bool)
    free[owner] = False
    return (out * like["norm.output.std"] + like["norm.output.mean"]).numpy()[:n], free


def main():
    like_path, data = (pathlib.Path(argument).resolve() for argument in sys.argv[1:3])
    like = load_file(like_path)
    torch.manual_seed(3)
    made = network(like)
    weights = {name: value.clone() for name, value in made.state_dict().items()}
    with tempfile.TemporaryDirectory() as folder:
        run = lambda *words: subprocess.run(["m4gn", *map(str, words)], cwd=folder, check=True, capture_output=True)
        torch.save(weights, f"{folder}/there.pt")
        run("convert", "there.pt", "--like", like_path, "--out", "model.safetensors")
        run("predict", "--model", "model.safetensors", "--data", data, "--out", "out.h5")
        run("convert", "model.safetensors", "--as", "physicsnemo", "--out", "back.safetensors")
        back = load_file(f"{folder}/back.safetensors")
        with h5py.File(data) as before, h5py.File(f"{folder}/out.h5") as after:
            new, old = (
                numpy.hstack([file[f"fields/{name}/cells"][frame] for name in ("U", "p")])
                for file, frame in ((after, 1), (before, 0))
            )
            expected, free = step(made, like, before)
    found = (new - old)[free]
    off = expected[free] - found
    off[:, 2] -= off[:, 2].mean()
    largest = numpy.abs(off).max(axis=0) / numpy.abs(found).max(axis=0)
    same = weights.keys() == back.keys() and all(torch.equal(weights[name], back[name]) for name in weights)
    print("largest difference over largest change, U and p:", " ".join(f"{x:.1e}" for x in largest))
    print("weights there and back:", "the same to the bit" if same else "differ")
    sys.exit(0 if same and largest.max() < 1e-4 else 1)


if __name__ == "__main__":
    main()
