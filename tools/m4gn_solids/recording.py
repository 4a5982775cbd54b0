"""Writing a trajectory of a body: schema version 3 (src/data/lib.rs says what is what)."""

import json

import h5py
import numpy as np

from .equilibrium import March, Solid

FORMAT, VERSION = "m4gn-trajectory", 3
NAME, LONG = 128, 60_000
"""Bytes of short and of long text; text has a fixed length, so that HDF5 checksums it."""
BODY, HANDLE = 6, 7
"""Codes of node types; obstacle points have none, they are all obstacle."""
DEEPEST = 0.05
"""Penetration that is not accepted, in cell sizes."""


class SunkIn(Exception):
    """The obstacle lies inside the body."""


def record(path, split, body, obstacle, material, interval):
    """Computes all frames into a file, which is left open: the recording, the march and the number of the obstacle's points."""
    march = March(body, obstacle, Solid(body, material["young"], material["poisson"]), material["young"])
    local, triangles = obstacle.shape.surface(march.size)
    start = obstacle.place(local, 0)
    recording = Recording(path, split)
    recording.body(body, material)
    recording.obstacle(start, triangles)
    for k, displacement in enumerate(march.frames()):
        if march.gap < -DEEPEST * march.size:
            raise SunkIn(f"the obstacle is {-march.gap / march.size:.3f} cell sizes inside at frame {k}")
        recording.append(k * interval, displacement, obstacle.place(local, k) - start)
    return recording, march, len(local)


class Recording:
    """The file is whole only after `finish`; whoever started us gives it its final name."""

    def __init__(self, path, split):
        self.file = h5py.File(path, "w", libver=("v110", "v110"))
        self.split = split
        self.frames = 0

    def body(self, body, material):
        """`material`: young Pa, poisson, density kg/m^3, the same in every cell."""
        self._array("mesh/cell_centres", body.points)
        self._array("mesh/point_type", np.where(body.fixed, HANDLE, BODY).astype(np.int32))
        count = len(body.cells)
        self._array("elements/kind", np.full(count, body.kind, dtype=np.int32))
        self._array("elements/points", body.cells.ravel().astype(np.int32))
        for name, value in material.items():
            self._array(f"elements/{name}", np.full(count, value, dtype=float))
        self.displacement = self._per_frame("fields/D/cells", len(body.points))
        field = self.file["fields/D"].attrs
        field.create("vector", 1, dtype=np.uint32)
        field.create("dimensions", (0, 1, 0, 0, 0, 0, 0), dtype=np.int32)
        self.times = self.file.create_dataset("times", (0,), "f8", maxshape=(None,), chunks=(1024,), fletcher32=True)

    def obstacle(self, points, triangles):
        """Surface at frame 0."""
        self._array("obstacle/positions", points)
        self._array("obstacle/triangles", triangles.astype(np.int32))
        self.motion = self._per_frame("obstacle/displacement", len(points))

    def _array(self, name, values):
        # In one chunk: HDF5 has checksums for chunks alone.
        self.file.create_dataset(name, data=values, chunks=values.shape, fletcher32=True)

    def _per_frame(self, name, points):
        options = {"chunks": (1, points, 3), "shuffle": True, "compression": 4, "fletcher32": True}
        return self.file.create_dataset(name, (0, points, 3), "f4", maxshape=(None, points, 3), **options)

    def append(self, time, displacement, motion):
        """One frame."""
        for dataset, values in ((self.displacement, displacement), (self.motion, motion), (self.times, time)):
            if not np.isfinite(values).all():
                raise FloatingPointError(f"{dataset.name} is not finite at frame {self.frames}")
            dataset.resize(self.frames + 1, axis=0)
            dataset[self.frames] = values
        self.frames += 1

    def finish(self, provenance):
        """The attributes, the one that says that the file is whole last."""
        root = self.file.attrs
        self._text("format", FORMAT, NAME)
        root.create("version", VERSION, dtype=np.uint32)
        self._text("split", self.split, NAME)
        self._text("provenance", json.dumps(provenance), LONG)
        self.file.flush()
        root.create("complete", 1, dtype=np.uint32)
        self.file.close()

    def _text(self, name, value, length):
        value = value.encode()
        if len(value) > length:
            raise ValueError(f"attribute {name} of {len(value)} bytes, expected at most {length}")
        self.file.attrs.create(name, np.array(value, dtype=f"S{length}"), dtype=h5py.string_dtype("utf-8", length))
