"""What both numpy baselines of bench/compare_planner share: reading the problem, timing, printing.

The problem is a folder of raw little-endian arrays written by bench/compare_planner: `sizes.txt` (name and shape, one
per line) and one file of float64 or int32 per array. Reading it is not timed.
"""
import json
import os
import sys
import time

import numpy as np

STEPS_EPSILON = np.finfo(float).eps


def blas_name():
    """The BLAS library that this process really loaded."""
    with open('/proc/self/maps') as maps:
        paths = {line.split()[-1] for line in maps if 'blas' in line or 'lapack' in line}
    return ', '.join(sorted(os.path.basename(os.path.realpath(p)) for p in paths if '/' in p and 'numpy' not in p))


def read_problem(folder):
    problem = {}
    with open(os.path.join(folder, 'sizes.txt')) as sizes:
        for line in sizes:
            name, kind, *shape = line.split()
            values = np.fromfile(os.path.join(folder, name + '.bin'), dtype=kind)
            problem[name] = values.reshape([int(s) for s in shape])
    return problem


def report(lights, kappa2, seconds):
    json.dump({'lights': [int(i) for i in lights], 'condition': [float(k) for k in kappa2], 'seconds': seconds,
               'numpy': np.__version__, 'blas': blas_name()}, sys.stdout)
    print()


def main(plan):
    problem = read_problem(sys.argv[1])
    repeats = int(sys.argv[2])
    best = None
    for _ in range(repeats):
        seconds = {}
        lights, kappa2 = plan(problem, seconds, time.process_time)
        seconds['total'] = sum(seconds.values())
        if best is None or seconds['total'] < best[2]['total']:
            best = (lights, kappa2, seconds)
    report(*best)
