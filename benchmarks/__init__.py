"""Every figure of speed against its peer: `python -m benchmarks`, or `make bench`."""

import os

# One thread each, for whoever multiplies matrices; read when NumPy is imported.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
