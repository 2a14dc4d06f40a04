"""Replay recorded robot logs offline through published particle-filter systems."""

import os

# The matrices of a filter are small: threads of a linear-algebra library wait for each other longer than they work (a smoothing
# run took 4 s with one and 86 s on a busy machine), and their number must not decide a byte. It counts before numpy is loaded.
for _library in ("OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

__version__ = "0.1.0"
