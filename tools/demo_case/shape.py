"""The demo organ: a liver-like body drawn for this project as a smooth union of ellipsoids.

Frame: x to the patient's left, y up (cranial), z to the front; metres. The origin is the centre of the bounding box.
"""

import numpy as np

# centre [m], semi-axes [m] of the parts: right lobe, dome, bridge, left lobe, left tip
_PARTS = np.array([
    [-0.046, -0.026, 0.004, 0.032, 0.054, 0.034],
    [-0.038, 0.022, -0.008, 0.044, 0.040, 0.050],
    [0.004, 0.030, 0.004, 0.044, 0.030, 0.036],
    [0.048, 0.034, 0.014, 0.040, 0.022, 0.022],
    [0.090, 0.034, 0.016, 0.020, 0.013, 0.014],
])
# the visceral hollow below and behind, taken away
_HOLLOW = np.array([0.022, -0.040, -0.056, 0.056, 0.048, 0.046])
_BLEND = 0.010  # [m] rounding of the union and of the cut
_TARGET_SIZE = np.array([0.210, 0.160, 0.140])


def _ellipsoid(p, part):
    """First-order distance to an ellipsoid: k0 (k0 - 1) / k1, k0 = |p/r|, k1 = |p/r^2|."""
    q = p - part[:3]
    k0 = np.linalg.norm(q / part[3:], axis=-1)
    k1 = np.linalg.norm(q / part[3:] ** 2, axis=-1)
    return k0 * (k0 - 1.0) / np.maximum(k1, 1e-12)


def _raw(p):
    """Negative inside: -B log sum exp(-d/B) joins the parts, +B log(exp(./B) + exp(./B)) cuts the hollow."""
    d = np.stack([_ellipsoid(p, part) for part in _PARTS])
    low = d.min(axis=0)
    union = low - _BLEND * np.log(np.exp(-(d - low) / _BLEND).sum(axis=0))
    return _BLEND * np.logaddexp(union / _BLEND, -_ellipsoid(p, _HOLLOW) / _BLEND)


def _icosphere(levels):
    t = (1.0 + 5.0 ** 0.5) / 2.0
    points = [(-1, t, 0), (1, t, 0), (-1, -t, 0), (1, -t, 0), (0, -1, t), (0, 1, t), (0, -1, -t), (0, 1, -t),
              (t, 0, -1), (t, 0, 1), (-t, 0, -1), (-t, 0, 1)]
    faces = np.array([(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2),
                      (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5),
                      (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)])
    points = [np.array(p) / np.linalg.norm(p) for p in points]
    for _ in range(levels):
        middle = {}

        def mid(a, b):
            key = (min(a, b), max(a, b))
            if key not in middle:
                p = points[a] + points[b]
                points.append(p / np.linalg.norm(p))
                middle[key] = len(points) - 1
            return middle[key]

        finer = []
        for a, b, c in faces:
            ab, bc, ca = mid(a, b), mid(b, c), mid(c, a)
            finer += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        faces = np.array(finer)
    return np.array(points), faces


def surface(levels=5):
    """Dense triangles of the zero level set, centred and scaled to the target size. The body is star-shaped."""
    directions, faces = _icosphere(levels)
    centre = np.array([0.0, 0.028, 0.008])
    # Sampled outwards, so that a second crossing (a body that is not star-shaped) is seen, then bisected.
    radii = np.linspace(0.005, 0.16, 400)
    inside = np.stack([_raw(centre + r * directions) < 0.0 for r in radii])
    crossings = (inside[:-1] != inside[1:]).sum(axis=0)
    if not (inside[0].all() and (crossings == 1).all()):
        raise SystemExit("make-demo-case: the shape is not star-shaped about its centre")
    last = inside.sum(axis=0) - 1
    low, high = radii[last], radii[last + 1]
    for _ in range(40):
        mid = 0.5 * (low + high)
        is_in = _raw(centre + mid[:, None] * directions) < 0.0
        low, high = np.where(is_in, mid, low), np.where(is_in, high, mid)
    points = centre + low[:, None] * directions
    bottom, top = points.min(axis=0), points.max(axis=0)
    return (points - 0.5 * (bottom + top)) * (_TARGET_SIZE / (top - bottom)), faces


def volume(points, faces):
    a, b, c = (points[faces[:, i]] for i in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
