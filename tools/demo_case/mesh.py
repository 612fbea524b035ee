"""Tetrahedra of the demo organ by Gmsh (an offline program), and what is asked of such a mesh."""

import pathlib
import subprocess

import numpy as np

_GEO = """
Merge "surface.stl";
ClassifySurfaces{{Pi, 1, 1, Pi}};
CreateGeometry;
Surface Loop(1) = Surface{{:}};
Volume(1) = {{1}};
Mesh.Algorithm = 6;
Mesh.Algorithm3D = 1;
Mesh.Optimize = 1;
Mesh.RandomSeed = 1;
Mesh.CharacteristicLengthExtendFromBoundary = 1;
Mesh.CharacteristicLengthFromPoints = 0;
Mesh.CharacteristicLengthFromCurvature = 0;
Field[1] = MathEval;
Field[1].F = "{size}";
Background Field = 1;
Mesh 3;
OptimizeMesh "Gmsh";
OptimizeMesh "Relocate3D";
OptimizeMesh "Gmsh";
"""


def _write_stl(path, points, faces):
    with open(path, "w") as out:
        out.write("solid organ\n")
        for face in faces:
            out.write("facet normal 0 0 0\nouter loop\n")
            for p in points[face]:
                out.write("vertex %.9g %.9g %.9g\n" % tuple(p))
            out.write("endloop\nendfacet\n")
        out.write("endsolid organ\n")


def _read_vtk_tets(path):
    """Gmsh's legacy ASCII VTK: points and the cells of four nodes."""
    tokens = iter(path.read_text().split())
    points = tets = None
    for token in tokens:
        if token == "POINTS":
            count = int(next(tokens))
            next(tokens)
            points = np.array([float(next(tokens)) for _ in range(3 * count)]).reshape(-1, 3)
        elif token == "CELLS":
            count = int(next(tokens))
            next(tokens)
            tets = []
            for _ in range(count):
                nodes = [int(next(tokens)) for _ in range(int(next(tokens)))]
                if len(nodes) == 4:
                    tets.append(nodes)
    return points, np.array(tets)


def tetrahedralise(points, faces, size, folder):
    """Tetrahedra of the closed surface with edge lengths `size`, a Gmsh expression of x, y, z [m]."""
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    _write_stl(folder / "surface.stl", points, faces)
    (folder / "organ.geo").write_text(_GEO.format(size=size))
    run = subprocess.run(["gmsh", "-3", "-format", "vtk", "-o", "organ.vtk", "-v", "2", "organ.geo"], cwd=folder,
                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if run.returncode != 0 or not (folder / "organ.vtk").exists():
        raise SystemExit("make-demo-case: gmsh failed in %s:\n%s" % (folder, run.stdout))
    nodes, tets = _read_vtk_tets(folder / "organ.vtk")
    used = np.unique(tets)
    renumber = np.full(len(nodes), -1)
    renumber[used] = np.arange(len(used))
    nodes, tets = nodes[used], renumber[tets]
    flipped = signed_volumes(nodes, tets) < 0.0
    tets[flipped] = tets[flipped][:, [0, 2, 1, 3]]
    return nodes, tets


def signed_volumes(nodes, tets):
    a, b, c, d = (nodes[tets[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", b - a, np.cross(c - a, d - a)) / 6.0


def radius_ratios(nodes, tets):
    """3 r_in / r_circum: 1 for the regular tetrahedron, 0 for a flat one."""
    a, b, c, d = (nodes[tets[:, i]] for i in range(4))
    u, v, w = b - a, c - a, d - a
    volume = np.abs(signed_volumes(nodes, tets))
    area = sum(0.5 * np.linalg.norm(np.cross(p, q), axis=1) for p, q in ((u, v), (v, w), (w, u), (v - u, w - u)))
    centre = (np.einsum("ij,ij->i", u, u)[:, None] * np.cross(v, w) + np.einsum("ij,ij->i", v, v)[:, None] *
              np.cross(w, u) + np.einsum("ij,ij->i", w, w)[:, None] * np.cross(u, v)) / (12.0 * volume)[:, None]
    return 3.0 * (3.0 * volume / area) / np.linalg.norm(centre, axis=1)


def boundary_triangles(tets):
    """Faces of one tetrahedron only, oriented outwards."""
    faces = np.concatenate([tets[:, [0, 2, 1]], tets[:, [0, 1, 3]], tets[:, [1, 2, 3]], tets[:, [0, 3, 2]]])
    _, first, counts = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[np.sort(first[counts == 1])]


def vertex_normals(nodes, triangles):
    """Area-weighted outward normals; zero away from the triangles."""
    a, b, c = (nodes[triangles[:, i]] for i in range(3))
    area_normal = np.cross(b - a, c - a)
    normals = np.zeros_like(nodes)
    for i in range(3):
        np.add.at(normals, triangles[:, i], area_normal)
    length = np.linalg.norm(normals, axis=1)
    return np.divide(normals, length[:, None], out=np.zeros_like(normals), where=length[:, None] > 0.0)


_EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))  # order of the mid-edge nodes of C3D10


def quadratic(nodes, tets):
    """Straight-sided ten-node tetrahedra: (all nodes, N x 10, {sorted corner pair: mid node}); corners keep their ids."""
    pairs = np.sort(np.stack([tets[:, list(e)] for e in _EDGES], axis=1), axis=2)
    unique, inverse = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    mids = 0.5 * (nodes[unique[:, 0]] + nodes[unique[:, 1]])
    ten = np.concatenate([tets, len(nodes) + inverse.reshape(-1, 6)], axis=1)
    return np.concatenate([nodes, mids]), ten, {tuple(p): len(nodes) + i for i, p in enumerate(unique)}


def shape10(l):
    """Quadratic shape functions at barycentric coordinates l (n x 4)."""
    corners = l * (2.0 * l - 1.0)
    return np.concatenate([corners, np.stack([4.0 * l[:, a] * l[:, b] for a, b in _EDGES], axis=1)], axis=1)


def locate(nodes, tets, points):
    """Tetrahedron and barycentric coordinates of each point (straight-sided); -1 outside."""
    a = nodes[tets[:, 0]]
    inverse = np.linalg.inv(np.stack([nodes[tets[:, i]] - a for i in (1, 2, 3)], axis=2))
    found = np.full(len(points), -1)
    weights = np.zeros((len(points), 4))
    for i, p in enumerate(points):
        l = np.einsum("nij,nj->ni", inverse, p - a)
        l = np.concatenate([1.0 - l.sum(axis=1, keepdims=True), l], axis=1)
        best = l.min(axis=1).argmax()
        if l[best].min() > -1e-9:
            found[i], weights[i] = best, l[best]
    return found, weights
