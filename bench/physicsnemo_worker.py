"""PhysicsNeMo's MeshGraphNet as a contestant of compare.py, run by the Python of its environment.

A step is one application of the network, or, where the request has a batch, one update in training: forward, mean square
error, backward, the gradient's norm clipped, Adam.
"""

import json
import os
import pathlib
import sys
import time

# PhysicsNeMo's ways to run: as it comes; with the first layer of its edge networks split into three products (its
# do_concat_trick); that, compiled. Each as (split, compiled).
VARIANTS = {
    "as it comes": (False, False),
    "split": (True, False),
    "split, compiled": (True, True),
}
DEFAULT = "as it comes"


def serve(request):
    """Describes itself in a line of JSON, then answers each `run KIND VARIANT` with the wall and processor ms of a step."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    # What libraries print goes elsewhere.
    os.dup2(2, 1)

    import torch
    from physicsnemo.models.meshgraphnet import MeshGraphNet
    from safetensors.torch import load_file
    from torch_geometric.data import Data

    torch.set_num_threads(request["threads"])
    torch.set_num_interop_threads(1)
    folder = pathlib.Path(request["folder"])
    weights, graph, theirs = (load_file(folder / f"{name}.safetensors") for name in ["model", "graph", "physicsnemo"])
    topology = Data(edge_index=torch.stack([graph["senders"], graph["receivers"]]).long(), num_nodes=len(graph["inputs"]))
    normed = {k: (graph[v] - weights[f"norm.{k}.mean"]) / weights[f"norm.{k}.std"] for k, v in {"node": "inputs", "edge": "edge_features"}.items()}
    kinds = weights["encoder.node.0.weight"].shape[1] - normed["node"].shape[1]
    nodes = torch.cat([normed["node"], torch.nn.functional.one_hot(graph["node_types"].long(), kinds).float()], 1)
    edges = normed["edge"]
    layers = sum(name.startswith("processor.") and name.endswith(".edge.0.weight") for name in weights)
    hidden = sum(name.startswith("decoder.") and name.endswith(".weight") for name in weights) - 1
    width = len(weights["encoder.node.0.bias"])

    def network(split):
        sizes = {f"num_layers_{part}": hidden for part in ["node_processor", "edge_processor", "node_encoder", "edge_encoder", "node_decoder"]}
        sizes |= {f"hidden_dim_{part}": width for part in ["processor", "node_encoder", "edge_encoder", "node_decoder"]}
        outputs = len(weights[f"decoder.{hidden}.bias"])
        made = MeshGraphNet(nodes.shape[1], edges.shape[1], outputs, processor_size=layers, do_concat_trick=split, **sizes)
        made.load_state_dict(split_first(theirs) if split else theirs)
        return made.eval()

    batch = request.get("batch", 0)
    if batch:
        # One graph of as many parts; it is put together once, and not at each step.
        several = Data(
            edge_index=torch.cat([topology.edge_index + i * len(nodes) for i in range(batch)], 1), num_nodes=batch * len(nodes)
        )
        inputs = nodes.repeat(batch, 1), edges.repeat(batch, 1), several
        targets = torch.randn(batch * len(nodes), graph["outputs"].shape[1])

    def training(model, half, fused):
        model.train()
        optimiser = torch.optim.Adam(model.parameters(), lr=1e-5, fused=fused)

        def step():
            optimiser.zero_grad(set_to_none=True)
            with torch.autocast("cpu", torch.bfloat16, enabled=half):
                found = model(*inputs)
            torch.nn.functional.mse_loss(found.float(), targets).backward()
            torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
            optimiser.step()

        return step

    steps, errors, failed = {"fp32": {}, "bf16": {}}, {}, {}
    parameters = sum(p.numel() for p in network(False).parameters())
    expected = graph["outputs"]
    for name in request["variants"]:
        split, compiled = VARIANTS[name]
        for kind in steps:
            try:
                model = torch.compile(network(split)) if compiled else network(split)

                def apply(model=model, half=kind == "bf16"):
                    with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=half):
                        return model(nodes, edges, topology)

                found = apply().float() * weights["norm.output.std"] + weights["norm.output.mean"]
                error = ((found - expected).abs().max() / expected.abs().max()).item()
                if not error < {"fp32": 1e-4, "bf16": 0.2}[kind]:
                    raise ValueError(f"its outputs differ from m4gn's by {error:.1e}")
                errors[f"{kind}, {name}"] = float(f"{error:.1e}")
                step = training(model, kind == "bf16", name != DEFAULT) if batch else apply
                step()
                steps[kind][name] = step
            except Exception as error:
                if name == DEFAULT and kind == "fp32":
                    raise
                failed[f"{kind}, {name}"] = (str(error).strip().splitlines() or [repr(error)])[0][:200]
    description = {"parameters": parameters, "torch": torch.__version__, "errors": errors, "failed": failed}
    answers.write(json.dumps(description | {kind: list(found) for kind, found in steps.items()}) + "\n")
    for line in sys.stdin:
        _, kind, name = line.strip().split(" ", 2)
        began, processor = time.perf_counter(), time.process_time()
        steps[kind][name]()
        wall, processor = time.perf_counter() - began, time.process_time() - processor
        answers.write(f"{wall * 1e3:.6f} {processor * 1e3:.6f}\n")


def split_first(state):
    """The weights of a network whose edge networks have their first layer as three products."""
    made = {}
    for name, value in state.items():
        head, _, rest = name.partition(".edge_mlp.model.")
        number, _, part = rest.partition(".")
        if not rest:
            made[name] = value
        elif number != "0":
            made[f"{head}.edge_mlp.model.{int(number) - 1}.{part}"] = value
        elif part == "bias":
            made[f"{head}.edge_mlp.bias"] = value
        else:
            for name, columns in zip(["lin_efeat", "lin_src", "lin_dst"], value.chunk(3, 1)):
                made[f"{head}.edge_mlp.{name}"] = columns.contiguous()
    return made


if __name__ == "__main__":
    serve(json.loads(sys.argv[1]))
