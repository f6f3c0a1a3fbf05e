"""pc2cad against what users would take instead: `python -m benchmarks`."""

import os

# one thread for everybody, set before NumPy is loaded
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"
