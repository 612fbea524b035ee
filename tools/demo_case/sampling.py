"""What the recording shows of the truth: surface markers that a camera in front sees, and interior points."""

import numpy as np

from . import mesh


def _blocked(origin, targets, nodes, triangles):
    """True where a triangle lies between the camera and the target (Moeller-Trumbore)."""
    a, b, c = (nodes[triangles[:, i]] for i in range(3))
    u, v, w = b - a, c - a, origin - a
    result = np.zeros(len(targets), bool)
    for i, target in enumerate(targets):
        d = target - origin
        h = np.cross(d, v)
        det = np.einsum("ij,ij->i", u, h)
        det = np.where(np.abs(det) < 1e-16, 1e-16, det)
        s = np.einsum("ij,ij->i", w, h) / det
        q = np.cross(w, u)
        t, depth = (q @ d) / det, np.einsum("ij,ij->i", v, q) / det
        result[i] = ((s > 0) & (t > 0) & (s + t < 1) & (depth > 0) & (depth < 1.0 - 1e-6)).any()
    return result


def _spread(points, count, rng):
    """Farthest-point sampling from a random start."""
    chosen = [int(rng.integers(len(points)))]
    distance = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)


def markers(nodes, triangles, band_nodes, band_triangles, keep_out, camera, count, seed):
    """(triangle indices, barycentric coordinates) of `count` points seen by the camera, clear of `keep_out`."""
    rng = np.random.default_rng(seed)
    a, b, c = (nodes[triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    centroid = (a + b + c) / 3.0
    to_camera = camera - centroid
    facing = np.einsum("ij,ij->i", normal, to_camera) / np.linalg.norm(to_camera, axis=1)
    seen = np.flatnonzero((facing > 0.35) & ~keep_out(centroid))
    everything = np.concatenate([nodes, band_nodes])
    occluders = np.concatenate([triangles, band_triangles])
    seen = seen[~_blocked(camera, centroid[seen], everything, occluders)]
    chosen = seen[_spread(centroid[seen], count, rng)]
    l = rng.uniform(0.2, 0.5, size=(count, 3))
    return chosen, l / l.sum(axis=1, keepdims=True)


def interior(nodes, tets, surface_points, clearance, count, seed):
    """Points of the body at least `clearance` [m] from the surface, spread over the volume."""
    rng = np.random.default_rng(seed)
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    candidates = rng.uniform(low, high, size=(6000, 3))
    gap = np.min([np.linalg.norm(candidates - p, axis=1) for p in surface_points], axis=0)
    candidates = candidates[gap > clearance][:1500]
    candidates = candidates[mesh.locate(nodes, tets, candidates)[0] >= 0]
    return candidates[_spread(candidates, count, rng)]


def observe(true, sigma, seed, loss=0.01, outages=((3, 12, 19), (9, 27, 31))):
    """Noise of `sigma` per axis; lost frames are NaN: `loss` at random, and (marker, first, last frame) outages."""
    rng = np.random.default_rng(seed)
    seen = true + rng.normal(scale=sigma, size=true.shape)
    seen[rng.uniform(size=true.shape[:2]) < loss] = np.nan
    for marker, first, last in outages:
        seen[first:last + 1, marker] = np.nan
    return seen
