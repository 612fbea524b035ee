"""Writes a case folder of format teres-case-1, and truth.json beside it."""

import json
import pathlib

import numpy as np


def _csv(path, header, rows):
    pathlib.Path(path).write_text("\n".join([header] + rows) + "\n")


def mesh_vtk(path, nodes, tets):
    with open(path, "w") as out:
        out.write("# vtk DataFile Version 3.0\nTeres demo organ, metres\nASCII\nDATASET UNSTRUCTURED_GRID\n")
        out.write("POINTS %d double\n" % len(nodes))
        for p in nodes:
            out.write("%.6f %.6f %.6f\n" % tuple(p))
        out.write("CELLS %d %d\n" % (len(tets), 5 * len(tets)))
        for tet in tets:
            out.write("4 %d %d %d %d\n" % tuple(tet))
        out.write("CELL_TYPES %d\n%s" % (len(tets), "10\n" * len(tets)))


def probabilities(path, ids, values):
    _csv(path, "node_id,probability", ["%d,%.4f" % row for row in zip(ids, values)])


def load_nodes(path, regions):
    """Weights rounded to 6 decimals so that each region still sums to 1."""
    rows = []
    for name, ids, weights in regions:
        rounded = np.round(weights, 6)
        rounded[rounded.argmax()] += 1.0 - rounded.sum()
        rows += ["%s,%d,%.6f" % (name, i, w) for i, w in zip(ids, rounded) if round(w, 6) != 0.0]
    _csv(path, "region,node_id,weight", rows)


def loads(path, times, names, forces):
    _csv(path, "t_s,region,fx_n,fy_n,fz_n", ["%.3f,%s,%.6f,%.6f,%.6f" % (t, name, *forces[k, r])
                                             for k, t in enumerate(times) for r, name in enumerate(names)])


def points(path, id_name, positions):
    _csv(path, id_name + ",x_m,y_m,z_m", ["%d,%.6f,%.6f,%.6f" % (i, *p) for i, p in enumerate(positions)])


def positions(path, id_name, times, frames):
    _csv(path, "t_s,%s,x_m,y_m,z_m" % id_name,
         ["%.3f,%d," % (t, i) + ("NaN,NaN,NaN" if np.isnan(p).any() else "%.6f,%.6f,%.6f" % tuple(p))
          for t, frame in zip(times, frames) for i, p in enumerate(frame)])


def document(path, content):
    pathlib.Path(path).write_text(json.dumps(content, indent=1) + "\n")
