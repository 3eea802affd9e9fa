"""Baseline (b): the best numpy one can write for the same plan.

All cosines of one block of lights by one matrix product; rows of the table by look-up; candidates with the same cells
merged; the Gram matrix carried from step to step, only unseen rows added to it; eigenvalues of all candidates in one
batched call. (Bounds that avoid eigenvalues need a branch per candidate, which numpy pays for with more than they
save.)
"""
import numpy as np

from plan_common import STEPS_EPSILON, main


def all_bins(problem):
    valid = problem['valid']
    n_h, n_d = (int(n) for n in problem['grid'])
    view, lights = problem['view'], problem['lights']
    normals = problem['normals']
    normals = np.ascontiguousarray(normals[normals @ view > 0].T)
    half = lights + view
    half /= np.linalg.norm(half, axis=1)[:, None]
    theta_d = np.arccos(np.clip(np.einsum('ij,ij->i', half, lights), -1, 1))
    i_d = np.minimum((n_d * theta_d * 2 / np.pi).astype(int), n_d - 1)
    bins = []
    block = 64
    for first in range(0, len(lights), block):
        cos_i = lights[first:first + block] @ normals
        cos_h = half[first:first + block] @ normals
        for k in range(len(cos_i)):
            lit = cos_h[k][cos_i[k] > 0]
            filled = np.zeros(n_h, dtype=bool)
            # theta_h by arccos: numpy's vectorised one is faster than a bisection.
            np.minimum(lit, 1.0, out=lit)
            np.arccos(lit, out=lit)
            np.sqrt(lit, out=lit)
            lit *= n_h * np.sqrt(2 / np.pi)
            filled[np.minimum(lit.astype(np.int32), n_h - 1)] = True
            cells = np.flatnonzero(filled) * n_d + i_d[first + k]
            bins.append(cells[valid[cells] != 0])
    return bins


def plan(problem, seconds, clock):
    start = clock()
    bins = all_bins(problem)
    seconds['bins'] = clock() - start
    start = clock()
    n_h, n_d = (int(n) for n in problem['grid'])
    V = problem['V']
    k = V.shape[1]
    channels = V.shape[0] // (n_h * n_d)
    # Rows of one cell side by side: one gather instead of one per channel.
    rows = np.ascontiguousarray(V.reshape(channels, n_h * n_d, k).transpose(1, 0, 2))
    seen = np.zeros(n_h * n_d, dtype=bool)
    gram = np.zeros((k, k))
    chosen, kappa2 = [], []
    stack = np.empty((len(bins), k, k))
    for _ in range(int(problem['count'][0])):
        first_with = {}
        for i, cells in enumerate(bins):
            fresh = cells[~seen[cells]]
            if len(fresh):
                first_with.setdefault(fresh.tobytes(), (i, fresh))
        unique = list(first_with.values())
        for j, (_, fresh) in enumerate(unique):
            G = rows[fresh].reshape(-1, k)
            np.matmul(G.T, G, out=stack[j])
        stack[:len(unique)] += gram
        eigenvalues = np.linalg.eigvalsh(stack[:len(unique)])
        low, high = eigenvalues[:, 0], eigenvalues[:, -1]
        with np.errstate(divide='ignore', invalid='ignore'):
            value = np.where(low > k * STEPS_EPSILON * high, high / low, np.inf)
        j = int(np.argmin(value))
        chosen.append(unique[j][0])
        kappa2.append(value[j])
        gram = stack[j].copy()
        seen[unique[j][1]] = True
    seconds['selection'] = clock() - start
    return chosen, kappa2


if __name__ == '__main__':
    main(plan)
