"""The numpy baseline of bench/compare_reduce: the same mathematics from frames in memory to coefficients.

Reads the problem (raw little-endian arrays and sizes.txt, written by bench/compare_reduce) untimed; then times merging,
extraction and the MAP fit; writes the coefficients and prints one JSON line. Written as an expert would in numpy: whole
arrays, in-place operations, bincount for the cell sums, one Cholesky per channel through LAPACK.
"""
import json
import os
import sys
import time

import numpy as np

from plan_common import blas_name, read_problem


def merge(frames, exposures, sensor):
    """Maximum likelihood of the rate, re-weighted `rounds` times; float32 like the product."""
    gain, black, read, full, dark, rounds = sensor
    n = frames.shape[1]
    total = np.zeros(n, np.float32)
    time_used = np.zeros(n, np.float32)
    x, use = [], []
    for counts, t in zip(frames, exposures):
        c = counts.astype(np.float32)
        u = c < np.float32(full)
        c -= np.float32(black + dark * t / gain)
        c *= np.float32(gain)
        total += np.where(u, c, np.float32(0))
        time_used += u * np.float32(t)
        x.append(c)
        use.append(u)
    rate = total / np.maximum(time_used, np.float32(1e-30))
    for _ in range(int(rounds)):
        numerator = np.zeros(n, np.float32)
        information = np.zeros(n, np.float32)
        for c, u, t in zip(x, use, exposures):
            fixed = np.float32(read * read + gain * gain / 12 + dark * t)
            w = u * np.float32(t) / (np.maximum(rate, np.float32(0)) * np.float32(t) + fixed)
            numerator += w * c
            information += w * np.float32(t)
        rate = numerator / np.maximum(information, np.float32(1e-30))
    return rate, 1 / np.maximum(information, np.float32(1e-30)), time_used > 0


def extract(L, variance, measured, p):
    """Sums per cell over lit points, of which L, variance and measured are; directions and cells from them."""
    normal, view, position = p['normal'], p['view'], p['position']
    light = p['light'] - position
    r2 = np.einsum('ij,ij->i', light, light)
    light /= np.sqrt(r2)[:, None]
    cos_i = np.einsum('ij,ij->i', normal, light)
    cos_o = np.einsum('ij,ij->i', normal, view)
    max_theta_d, min_i, min_o = p['limits']
    half = light + view
    half /= np.linalg.norm(half, axis=1)[:, None]
    theta_h = 2 * np.arcsin(np.minimum(1, np.linalg.norm(normal - half, axis=1) / 2))
    theta_d = 2 * np.arcsin(np.minimum(1, np.linalg.norm(view - half, axis=1) / 2))
    keep = (cos_i >= min_i) & (cos_o >= min_o) & (theta_d <= max_theta_d)
    i_h = np.minimum((90 * np.sqrt(2 * theta_h[keep] / np.pi)).astype(np.int64), 89)
    i_d = np.minimum((90 * 2 * theta_d[keep] / np.pi).astype(np.int64), 89)
    cell = i_h * 90 + i_d
    a = p['strength'][0] * cos_i[keep] / r2[keep]
    ok = measured[keep] & (p['valid'][cell] > 0)
    cell, a, value, v = cell[ok], a[ok], L[keep][ok].astype(float), variance[keep][ok].astype(float)
    def total(weights):
        return np.bincount(cell, weights, minlength=8100)
    n, sa, sl, sv = total(None), total(a), total(value), total(v)
    sa2, sal, sl2 = total(a * a), total(a * value), total(value * value)
    rows = np.flatnonzero(n)
    n, sa, sl, sv, sa2, sal, sl2 = (s[rows] for s in (n, sa, sl, sv, sa2, sal, sl2))
    f = sl / sa
    scatter = np.maximum(0, sl2 - 2 * f * sal + f * f * sa2) / sa**2 * n / np.maximum(n - 1, 1)
    return rows, f, np.maximum(sv / sa**2, np.where(n > 1, scatter, 0))


def fit(rows, f, variance, p):
    sigma, floor = p['sigma'][0], p['sigma'][1]
    V, s, mean = p['V'], p['stddev'], p['mean']
    g = np.maximum(f, floor)
    row_variance = sigma**2 + variance / g**2
    G = V[rows] * s
    w = 1 / row_variance
    A = (G * w[:, None]).T @ G
    A[np.diag_indices_from(A)] += 1
    b = (G * w[:, None]).T @ (np.log(g) - mean[rows])
    L = np.linalg.cholesky(A)
    z = np.linalg.solve(L.T, np.linalg.solve(L, b))
    inverse = np.linalg.solve(L, np.eye(len(s))) * s  # the covariance is part of a fit
    return s * z, inverse.T @ inverse


def main():
    folder = sys.argv[1]
    p = read_problem(folder)
    p['normal'], p['view'], p['position'] = (np.ascontiguousarray(p[k]) for k in ('normal', 'view', 'position'))
    frames, exposures, sensor = p['frames'], p['exposures'], p['sensor']
    best = None
    for _ in range(3):
        t0 = time.process_time()
        seen = np.take(frames, p['site'], axis=1)  # as lightrig leaves out what shows nothing of the object
        rate, variance, measured = merge(seen, exposures, sensor)
        response = p['strength'][1]
        L, v = rate / np.float32(response), variance / np.float32(response)**2
        t1 = time.process_time()
        rows, f, fv = extract(L, v, measured, p)
        t2 = time.process_time()
        c, _ = fit(rows, f, fv, p)
        t3 = time.process_time()
        if best is None or t3 - t0 < best['total']:
            best = {'merge': t1 - t0, 'extract': t2 - t1, 'fit': t3 - t2, 'total': t3 - t0}
    c.tofile(os.path.join(folder, 'c_numpy.bin'))
    json.dump({**best, 'rows': len(rows), 'numpy': np.__version__, 'blas': blas_name()}, sys.stdout)
    print()


main()
