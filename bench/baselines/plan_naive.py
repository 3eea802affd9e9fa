"""Baseline (a): the loop of [Ali 2013] written plainly in numpy.

For every candidate light the bins of its lit points, by the angles; then, for every light to choose, every candidate:
its rows under those chosen so far, G, and the eigenvalues of G'G. Bins are computed once, not once per step.
"""
import numpy as np

from plan_common import STEPS_EPSILON, main


def bins_of_light(light, normals, view, n_h, n_d, valid):
    cos_i = normals @ light
    lit = normals[cos_i > 0]
    half = light + view
    half = half / np.linalg.norm(half)
    theta_h = np.arccos(np.clip(lit @ half, -1, 1))
    theta_d = np.arccos(np.clip(half @ light, -1, 1))
    i_h = np.minimum((n_h * np.sqrt(theta_h * 2 / np.pi)).astype(int), n_h - 1)
    i_d = min(int(n_d * theta_d * 2 / np.pi), n_d - 1)
    cells = np.unique(i_h * n_d + i_d)
    return cells[valid[cells] != 0]


def condition(G):
    eigenvalues = np.linalg.eigvalsh(G.T @ G)
    if eigenvalues[0] <= G.shape[1] * STEPS_EPSILON * eigenvalues[-1]:
        return np.inf
    return eigenvalues[-1] / eigenvalues[0]


def plan(problem, seconds, clock):
    V, valid = problem['V'], problem['valid']
    n_h, n_d = problem['grid']
    channels = V.shape[0] // (n_h * n_d)
    view, lights = problem['view'], problem['lights']
    start = clock()
    normals = problem['normals']
    normals = normals[normals @ view > 0]
    bins = [bins_of_light(light, normals, view, n_h, n_d, valid) for light in lights]
    seconds['bins'] = clock() - start
    start = clock()
    chosen, kappa2 = [], []
    cells = np.array([], dtype=int)
    for _ in range(int(problem['count'][0])):
        best, best_cells, best_light = np.inf, cells, -1
        for i in range(len(lights)):
            candidate = np.union1d(cells, bins[i])
            rows = np.concatenate([candidate + c * n_h * n_d for c in range(channels)])
            value = condition(V[rows])
            if value < best:
                best, best_cells, best_light = value, candidate, i
        chosen.append(best_light)
        kappa2.append(best)
        cells = best_cells
    seconds['selection'] = clock() - start
    return chosen, kappa2


if __name__ == '__main__':
    main(plan)
