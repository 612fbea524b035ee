"""Loads of the demo recording: smooth patches on both lobes, forces with incommensurate periods."""

import numpy as np

# name, centre of the patch [m] (moved to the surface), radius [m]
PATCHES = [
    ("right_lobe_edge", (-0.060, -0.070, 0.030), 0.024),
    ("left_lobe_tip", (0.085, 0.020, 0.045), 0.024),
    ("right_lobe_side", (-0.100, 0.030, 0.015), 0.024),
]
# per patch: swing A [N], period T [s], direction; pull B [N], period S [s], direction
_MOTION = [
    (0.16, 3.10, (0.3, 0.5, 0.8), 0.10, 4.70, (-0.2, -0.9, 0.3)),
    (0.07, 2.30, (0.1, 0.6, -0.7), 0.08, 5.30, (0.2, 0.5, 0.8)),
    (0.15, 3.70, (-0.8, 0.2, 0.5), 0.08, 2.90, (-0.3, 0.9, -0.2)),
]

# 7-point rule of degree 5 on the triangle
_A, _B = (6.0 - 15.0 ** 0.5) / 21.0, (6.0 + 15.0 ** 0.5) / 21.0
_POINTS = np.array([[1 / 3] * 3] + [[1 - 2 * c if i == j else c for j in range(3)] for c in (_A, _B) for i in range(3)])
_WEIGHTS = np.array([9 / 40] + [(155 - 15.0 ** 0.5) / 1200] * 3 + [(155 + 15.0 ** 0.5) / 1200] * 3)


def forces(times):
    """times x patches x 3 [N]; f(t) = A sin(2 pi t/T) a + B/2 (1 - cos(2 pi t/S)) b, zero at t = 0."""
    out = np.zeros((len(times), len(PATCHES), 3))
    for r, (swing, period, along, pull, period2, along2) in enumerate(_MOTION):
        a, b = (np.array(d) / np.linalg.norm(d) for d in (along, along2))
        out[:, r] = (swing * np.sin(2 * np.pi * times / period))[:, None] * a
        out[:, r] += (0.5 * pull * (1.0 - np.cos(2 * np.pi * times / period2)))[:, None] * b
    return np.round(out, 6)


def patch_weights(nodes, triangles, centre, radius, mid=None):
    """Consistent nodal weights of the traction (1 - d^2/R^2)^2 about `centre`; sum 1. mid: quadratic faces."""
    weights = {}
    for triangle in triangles:
        corners = nodes[triangle]
        if np.linalg.norm(corners - centre, axis=1).min() > 2.0 * radius:
            continue
        p = _POINTS @ corners
        density = np.maximum(1.0 - (np.linalg.norm(p - centre, axis=1) / radius) ** 2, 0.0) ** 2
        if not density.any():
            continue
        area = 0.5 * np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
        ids, shape = list(triangle), _POINTS
        if mid is not None:
            ids = ids + [mid[tuple(sorted((triangle[i], triangle[(i + 1) % 3])))] for i in range(3)]
            l = _POINTS
            shape = np.concatenate([l * (2 * l - 1), np.stack([4 * l[:, i] * l[:, (i + 1) % 3] for i in range(3)], 1)], 1)
        for i, w in zip(ids, area * (_WEIGHTS * density) @ shape):
            weights[int(i)] = weights.get(int(i), 0.0) + w
    total = sum(weights.values())
    ids = sorted(weights)
    return np.array(ids), np.array([weights[i] / total for i in ids])
