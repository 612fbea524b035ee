"""Input and results of CalculiX (program ccx, Debian package calculix-ccx 2.20)."""

import os
import pathlib
import re
import subprocess
import time

import numpy as np


def ogden_card(shear_modulus, alpha, bulk_modulus):
    """One term: W = 2 mu/alpha^2 (l1^alpha + l2^alpha + l3^alpha - 3) + 1/D (J - 1)^2 on isochoric stretches, D = 2/K."""
    return "*HYPERELASTIC, OGDEN, N=1\n%.9g, %.9g, %.9g\n" % (shear_modulus, alpha, 2.0 / bulk_modulus)


def neo_hookean_card(youngs_modulus, poissons_ratio):
    """W = C10 (I1 - 3) + 1/D (J - 1)^2 on isochoric stretches (uncoupled form), C10 = mu/2, D = 2/K."""
    mu = youngs_modulus / (2.0 * (1.0 + poissons_ratio))
    bulk = youngs_modulus / (3.0 * (1.0 - 2.0 * poissons_ratio))
    return "*HYPERELASTIC, NEO HOOKE\n%.9g, %.9g\n" % (0.5 * mu, 2.0 / bulk)


def _ids(out, ids):
    for start in range(0, len(ids), 12):
        out.write(", ".join(str(i + 1) for i in ids[start:start + 12]) + "\n")


def write_input(path, nodes, parts, fixed, regions, times, forces, residual=1e-4, correction=1e-3):
    """parts: [(name, N x 10 nodes, material card)]; regions: [(name, node ids, weights)]; forces: times x regions x 3 [N].

    Static, large displacements, loads linear between `times`; displacements are written at each of `times`.
    residual, correction: convergence of an increment as fractions of the mean force and of the increment.
    """
    with open(path, "w") as out:
        out.write("*NODE, NSET=ALL\n")
        for i, p in enumerate(nodes):
            out.write("%d, %.10g, %.10g, %.10g\n" % (i + 1, *p))
        first = 1
        for name, elements, card in parts:
            out.write("*ELEMENT, TYPE=C3D10, ELSET=%s\n" % name)
            for i, element in enumerate(elements):
                out.write("%d, " % (first + i) + ", ".join(str(n + 1) for n in element) + "\n")
            first += len(elements)
            out.write("*MATERIAL, NAME=M%s\n%s*SOLID SECTION, ELSET=%s, MATERIAL=M%s\n" % (name, card, name, name))
        out.write("*NSET, NSET=FIXED\n")
        _ids(out, fixed)
        out.write("*BOUNDARY\nFIXED, 1, 3\n*TIME POINTS, NAME=FRAMES\n")
        for t in times[1:]:
            out.write("%.9g\n" % t)
        for r, (name, _, _) in enumerate(regions):
            for axis in range(3):
                out.write("*AMPLITUDE, NAME=%s%d\n" % (name, axis + 1))
                for k, t in enumerate(times):
                    out.write("%.9g, %.9g\n" % (t, forces[k, r, axis]))
        dt = times[1] - times[0]
        out.write("*STEP, NLGEOM, INC=10000\n*STATIC\n%.9g, %.9g, %.9g, %.9g\n" % (dt, times[-1], 1e-3 * dt, dt))
        out.write("*CONTROLS, PARAMETERS=FIELD\n%g, %g\n" % (residual, correction))
        for name, ids, weights in regions:
            for axis in range(3):
                out.write("*CLOAD, AMPLITUDE=%s%d\n" % (name, axis + 1))
                for i, w in zip(ids, weights):
                    out.write("%d, %d, %.9g\n" % (i + 1, axis + 1, w))
        out.write("*NODE FILE, TIME POINTS=FRAMES\nU\n*NODE PRINT, NSET=FIXED, TOTALS=ONLY, TIME POINTS=FRAMES\nRF\n")
        out.write("*END STEP\n")


def run(folder, job, threads=2):
    """Runs ccx at low priority; seconds of wall time. The .sta file and the program's text stay in the folder."""
    environment = dict(os.environ, OMP_NUM_THREADS=str(threads), CCX_NPROC_STIFFNESS=str(threads))
    start = time.time()
    with open(pathlib.Path(folder) / (job + ".log"), "w") as log:
        code = subprocess.run(["nice", "-n", "15", "ccx", "-i", job], cwd=folder, env=environment, stdout=log,
                              stderr=subprocess.STDOUT).returncode
    text = (pathlib.Path(folder) / (job + ".log")).read_text(errors="replace")
    if code != 0 or "*ERROR" in text or "Job finished" not in text:
        raise SystemExit("make-demo-case: ccx failed, see %s/%s.log:\n%s" % (folder, job, text[-1500:]))
    return time.time() - start


def _number(text):
    """Fortran drops the E of a three-digit exponent: 1.00000-101."""
    return float(re.sub(r"(?<=\d)([+-]\d{3})$", r"E\1", text.strip()))


def read_displacements(path, num_nodes):
    """{time: N x 3} of every DISP block of an .frd file (fixed columns: I10 node, 3 E12.5)."""
    frames = {}
    current, stamp = None, 0.0
    with open(path) as lines:
        for line in lines:
            if line.startswith("  100CL"):
                stamp = _number(line[12:24])
            elif line.startswith(" -4"):
                current = None
                if line.split()[1] == "DISP":
                    current = frames.setdefault(round(stamp, 6), np.zeros((num_nodes, 3)))
            elif line.startswith(" -1") and current is not None:
                current[int(line[3:13]) - 1] = [_number(line[13 + 12 * i:25 + 12 * i]) for i in range(3)]
            elif line.startswith(" -3"):
                current = None
    return frames


def read_reactions(path):
    """{time: total reaction of the fixed nodes [N]} of a .dat file."""
    totals, stamp = {}, None
    for line in open(path):
        found = re.search(r"total force \(fx,fy,fz\) for set FIXED and time\s+(\S+)", line)
        if found:
            stamp = round(_number(found.group(1)), 6)
        elif stamp is not None and line.strip():
            totals[stamp] = np.array([_number(v) for v in line.split()])
            stamp = None
    return totals
