"""Writing a trajectory: schema version 2, location points (src/dataset/points.rs says what is what)."""

import json

import h5py
import numpy as np

FORMAT, VERSION = "m4gn-trajectory", 2
NAME, LONG = 128, 60_000
"""Bytes of short and of long text; text has a fixed length, so that HDF5 checksums it."""
BODY, HANDLE = 6, 7
"""Codes of node types; obstacle points have none, they are all obstacle."""


class Recording:
    """The file is whole only after `finish`; whoever started us gives it its final name."""

    def __init__(self, path, split):
        self.file = h5py.File(path, "w", libver=("v110", "v110"))
        self.split = split
        self.frames = 0

    def body(self, body, edges, stiffness, mass, material):
        """`material`: young Pa, poisson, density kg/m^3, the same in every cell."""
        group = self.file.create_group("points")
        group["positions"] = body.points
        group["type"] = np.where(body.fixed, HANDLE, BODY).astype(np.int32)
        group = self.file.create_group("elements")
        count = len(body.cells)
        group["kind"] = np.full(count, body.kind, dtype=np.int32)
        group["start"] = (np.arange(count + 1) * body.cells.shape[1]).astype(np.int64)
        group["points"] = body.cells.ravel().astype(np.int32)
        for name, value in material.items():
            group[name] = np.full(count, value)
        self.file["edges"] = edges.astype(np.int32)
        for name, matrix in (("stiffness", stiffness), ("mass", mass)):
            group = self.file.create_group(name)
            group["start"] = matrix.indptr.astype(np.int64)
            _packed(group, "column", matrix.indices.astype(np.int32))
            _packed(group, "value", matrix.data.astype(np.float64))
        self.displacement = self._per_frame("displacement", (len(body.points), 3))
        self.stress = self._per_frame("von_mises", (len(body.points),))
        self.times = self.file.create_dataset("times", (0,), "f8", maxshape=(None,), chunks=(1024,))

    def obstacle(self, points, triangles):
        """Surface at frame 0."""
        group = self.file.create_group("obstacle")
        group["positions"] = points
        group["triangles"] = triangles.astype(np.int32)
        self.motion = self._per_frame("obstacle/displacement", (len(points), 3))

    def _per_frame(self, name, shape):
        options = {"chunks": (1, *shape), "shuffle": True, "compression": 4, "fletcher32": True}
        return self.file.create_dataset(name, (0, *shape), "f4", maxshape=(None, *shape), **options)

    def append(self, time, displacement, von_mises, motion):
        """One frame."""
        arrays = (self.displacement, displacement), (self.stress, von_mises), (self.motion, motion)
        for dataset, values in (*arrays, (self.times, time)):
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
        self._text("location", "points", NAME)
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


def _packed(group, name, values):
    group.create_dataset(name, data=values, chunks=True, shuffle=True, compression=4, fletcher32=True)
