"""F4: probabilistic clustering as one writes it with NumPy: for every pair of a model edge and a parallel segment the
likelihood of all shifts in the pair's bounding box, the largest of each edge in each cell, their sum over the edges."""
import math, sys
from peer import array, serve
import numpy as np

folder = sys.argv[1]
edges, segments = array(folder, "edges", 4).reshape(-1, 2, 2), array(folder, "segments", 4).reshape(-1, 2, 2)
half, tolerance_rad = array(folder, "parameters", 2)[0]
half = int(half)
SIGMA = 1.5


def parts(lines):
    along = lines[:, 1] - lines[:, 0]
    length = np.linalg.norm(along, axis=1)
    return along / length[:, None], length, lines.mean(1)


def run(_):
    (model_unit, model_length, model_middle), (unit, length, middle) = parts(edges), parts(segments)
    total = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    for i in range(len(edges)):
        best = np.zeros_like(total)
        for j in np.nonzero(np.abs(unit @ model_unit[i]) >= math.cos(tolerance_rad))[0]:
            shift = middle[j] - model_middle[i]
            flat, reach = abs(length[j] - model_length[i]) / 2, (length[j] + model_length[i]) / 2
            extent = np.abs(unit[j]) * reach + 3 * SIGMA
            x0, y0 = np.maximum(np.floor(shift - extent) + half, 0).astype(int)
            x1, y1 = np.minimum(np.ceil(shift + extent) + half + 1, 2 * half + 1).astype(int)
            if x1 <= x0 or y1 <= y0:
                continue
            dx = np.arange(x0, x1, dtype=np.float32)[None, :] - np.float32(half + shift[0])
            dy = np.arange(y0, y1, dtype=np.float32)[:, None] - np.float32(half + shift[1])
            u = np.abs(dx * np.float32(unit[j, 0]) + dy * np.float32(unit[j, 1]))
            v = dy * np.float32(unit[j, 0]) - dx * np.float32(unit[j, 1])
            fall = np.clip((reach - u) / max(reach - flat, 1e-6), 0, 1)
            weight = np.float32(min(length[j], model_length[i]))
            patch = best[y0:y1, x0:x1]
            np.maximum(patch, weight * fall * np.exp(v * v * np.float32(-0.5 / SIGMA**2)), out=patch)
        total += best
    y, x = np.unravel_index(np.argmax(total), total.shape)
    return {"shift": [int(x) - half, int(y) - half]}


serve(run)
