"""Removes slivers that Gmsh leaves: moves the nodes of bad tetrahedra to raise the worst quality around each node."""

import numpy as np

from . import mesh


def improve(nodes, tets, goal=0.3, rounds=60, seed=7):
    """Hill climbing on the worst radius ratio of each star; surface nodes move in their tangent plane only."""
    rng = np.random.default_rng(seed)
    nodes = nodes.copy()
    surface = mesh.boundary_triangles(tets)
    normals = mesh.vertex_normals(nodes, surface)
    star = [[] for _ in nodes]
    for i, tet in enumerate(tets):
        for node in tet:
            star[node].append(i)
    star = [np.array(s) for s in star]
    quality = mesh.radius_ratios(nodes, tets)
    for round_ in range(rounds):
        bad = np.flatnonzero(quality < goal)
        if len(bad) == 0:
            break
        step = 0.25 * 0.95 ** round_
        for node in np.unique(tets[bad]):
            around = tets[star[node]]
            reach = np.linalg.norm(nodes[around] - nodes[node], axis=2).max() * step
            for _ in range(8):
                move = rng.normal(size=3) * reach
                move -= normals[node] * (move @ normals[node])
                old, before = nodes[node].copy(), quality[star[node]].min()
                nodes[node] = old + move
                if mesh.signed_volumes(nodes, around).min() > 0.0 and mesh.radius_ratios(nodes, around).min() > before:
                    quality[star[node]] = mesh.radius_ratios(nodes, around)
                else:
                    nodes[node] = old
    return nodes
