"""What all peers share: one thread, and a run for every line on standard input.

A peer reads its inputs from the folder that is its argument, says "ready", and then answers each line with one JSON
object in a line: `cpu_s`, the CPU seconds of one run, and whatever else is to be compared.
"""
import os

# before NumPy is loaded
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")

import json, sys, time
import numpy as np


def array(folder, name, columns):
    """Rows of so many little-endian doubles."""
    return np.fromfile(os.path.join(folder, name), "<f8").reshape(-1, columns)


def serve(run, told=lambda result: result or {}):
    """`run(line)` does the work, whose time counts; `told(result)` makes what is to be compared out of its result."""
    print("ready", flush=True)
    for line in sys.stdin:
        began = time.process_time()
        result = run(line.strip())
        used = time.process_time() - began
        print(json.dumps({"cpu_s": used, **told(result)}), flush=True)
