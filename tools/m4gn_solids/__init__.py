"""Deforming plates and beams: hyperelastic bodies pressed by rigid obstacles, computed with FElupe.

`m4gn generate deforming-plate` and `deforming-beam` run this package in an environment of its own (setup/solids.sh).
It knows nothing of m4gn but the data set's schema (recording.py).
"""

import os

# Before NumPy is loaded: one trajectory is one thread, and threads that wait for each other cost more than they bring.
for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_threads] = "1"
