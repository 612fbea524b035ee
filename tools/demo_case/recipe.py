"""The demo recording from the shape to the case folder: mesh, true band, loads, CalculiX, markers, files."""

import dataclasses
import pathlib

import numpy as np

from . import band, calculix, improve, loads, mesh, sampling, shape, writer

SHEAR_MODULUS, ALPHA, POISSON = 7210.0, 0.88, 0.49  # liver, one-term Ogden
BULK_MODULUS = 2.0 * SHEAR_MODULUS * (1.0 + POISSON) / (3.0 * (1.0 - 2.0 * POISSON))
YOUNGS_MODULUS = 2.0 * SHEAR_MODULUS * (1.0 + POISSON)
NOISE = 0.0003  # [m] per axis
CAMERA = np.array([0.0, 0.0, 0.35])

# What the modeller expects, and what is: shifted, leaning, wider, softer, attached over part of the expected arc.
PRIOR = band.Band(x0=0.020, tilt=0.0, width=0.020, theta0_deg=-25.0, theta1_deg=105.0, height=0.025,
                  youngs_modulus_pa=100e3, poissons_ratio=0.48)
TRUTH = band.Band(x0=0.026, tilt=0.010, width=0.023, theta0_deg=0.0, theta1_deg=90.0, height=0.025,
                  youngs_modulus_pa=78e3, poissons_ratio=0.48)



@dataclasses.dataclass
class Recipe:
    name: str = "demo"
    truth: band.Band = dataclasses.field(default_factory=lambda: TRUTH)
    fine: float = 1.8  # factor on the truth's edge lengths
    layers: int = 2  # elements over the band's height
    case_scale: float = 1.0  # factor on the edge lengths of the case's mesh
    frames: int = 41
    duration: float = 8.0  # [s]

    def times(self):
        return np.round(np.arange(self.frames) * (self.duration / (self.frames - 1)), 6)


def edge_length(near, far):
    """[m] as a Gmsh expression: finer about the band."""
    graded = "{near}+({far}-{near})*(1-Exp(-((x-0.024)^2)/(2*0.035^2)-(0.5*(Abs(z+0.005)-z-0.005))^2/(2*0.02^2)))"
    return graded.format(near=near, far=far)


class Truth:
    """The true organ with its band as quadratic tetrahedra."""

    def __init__(self, points, faces, recipe, work):
        self.recipe = recipe
        size = edge_length(near=0.0055 * recipe.fine, far=0.0095 * recipe.fine)
        nodes, tets = mesh.tetrahedralise(points, faces, size, work / "truth_mesh")
        self.nodes = improve.improve(nodes, tets)
        self.tets = tets
        self.surface = mesh.boundary_triangles(tets)
        centroid = self.nodes[self.surface].mean(axis=1)
        self.strip = self.surface[recipe.truth.contains(centroid)]
        normals = mesh.vertex_normals(self.nodes, self.surface)
        new, self.band_tets, self.far = band.extrude(self.nodes, self.strip, normals, recipe.truth.height,
                                                   recipe.layers)
        corners = np.concatenate([self.nodes, new])
        self.all_nodes, ten, self.mid = mesh.quadratic(corners, np.concatenate([tets, self.band_tets]))
        self.liver10, self.band10 = ten[:len(tets)], ten[len(tets):]
        self.corners = corners
        far = set(int(i) for i in self.far)
        self.fixed = np.array(sorted(far) + sorted(i for pair, i in self.mid.items() if far.issuperset(pair)))

    def solve(self, forces, folder, threads):
        """Displacements of all nodes at the recipe's times, and facts about the solution."""
        times, ligament = self.recipe.times(), self.recipe.truth
        folder.mkdir(parents=True, exist_ok=True)
        regions = []
        for name, centre, radius in loads.PATCHES:
            regions.append((name, *loads.patch_weights(self.nodes, self.surface, to_surface(self.nodes, self.surface, centre),
                                                       radius, self.mid)))
        calculix.write_input(folder / "truth.inp", self.all_nodes, [
            ("LIVER", self.liver10, calculix.ogden_card(SHEAR_MODULUS, ALPHA, BULK_MODULUS)),
            ("BAND", self.band10, calculix.neo_hookean_card(ligament.youngs_modulus_pa, ligament.poissons_ratio)),
        ], self.fixed, regions, times, forces)
        seconds = calculix.run(folder, "truth", threads)
        found = calculix.read_displacements(folder / "truth.frd", len(self.all_nodes))
        missing = [t for t in times[1:] if round(t, 6) not in found]
        if missing:
            raise SystemExit("make-demo-case: ccx gave no result at t = %s s" % missing)
        u = np.stack([np.zeros((len(self.all_nodes), 3))] + [found[round(t, 6)] for t in times[1:]])
        reactions = calculix.read_reactions(folder / "truth.dat")
        imbalance = max(np.linalg.norm(reactions[round(t, 6)] + forces[k].sum(axis=0)) for k, t in enumerate(times) if k)
        increments = [line.split() for line in (folder / "truth.sta").read_text().splitlines() if line[:1] == " "]
        increments = [row for row in increments if row and row[0].isdigit()]
        liver = np.linalg.norm(u[:, :len(self.nodes)], axis=2)
        return u, {
            "program": "CalculiX ccx 2.20", "element": "C3D10", "nodes": len(self.all_nodes),
            "elements": len(self.liver10) + len(self.band10), "liver_tets": len(self.liver10),
            "band_tets": len(self.band10), "increments": len(increments),
            "iterations": sum(int(row[3]) for row in increments), "wall_s": round(seconds, 1),
            "max_displacement_mm": round(1e3 * liver.max(), 2),
            "rms_displacement_mm": round(1e3 * float(np.sqrt((liver ** 2).mean())), 2),
            "reaction_plus_loads_max_n": float("%.2g" % imbalance),
        }


def to_surface(nodes, triangles, point):
    """The surface node nearest to the point."""
    ids = np.unique(triangles)
    return nodes[ids[np.linalg.norm(nodes[ids] - np.array(point), axis=1).argmin()]]


def make(out, work, recipe, threads):
    ligament, times = recipe.truth, recipe.times()
    out, work = pathlib.Path(out), pathlib.Path(work)
    out.mkdir(parents=True, exist_ok=True)
    points, faces = shape.surface()

    size = edge_length(near=0.0095 * recipe.case_scale, far=0.0145 * recipe.case_scale)
    case_nodes, case_tets = mesh.tetrahedralise(points, faces, size, work / "case_mesh")
    case_nodes = np.round(improve.improve(case_nodes, case_tets), 6)
    case_surface = mesh.boundary_triangles(case_tets)
    surface_ids = np.unique(case_surface)

    truth = Truth(points, faces, recipe, work)
    forces = loads.forces(times)
    u, solver = truth.solve(forces, work / "solve", threads)

    # Markers ride on quadratic faces of the truth, validation points in its quadratic tetrahedra.
    band_surface = mesh.boundary_triangles(truth.band_tets)
    chosen, l = sampling.markers(truth.nodes, truth.surface, truth.corners[len(truth.nodes):], band_surface,
                                 lambda p: ligament.contains(p) | (PRIOR.prior_probability(p) > 0.3), CAMERA, 14, seed=11)
    marker_rest = np.einsum("ij,ijk->ik", l, truth.nodes[truth.surface[chosen]])
    marker_tet, marker_l = mesh.locate(truth.nodes, truth.tets, marker_rest)
    point_rest = sampling.interior(case_nodes, case_tets, truth.nodes[np.unique(truth.surface)], 0.008, 50, seed=12)
    point_tet, point_l = mesh.locate(truth.nodes, truth.tets, point_rest)
    if (marker_tet < 0).any() or (point_tet < 0).any():
        raise SystemExit("make-demo-case: a marker or a point lies outside the truth's mesh")
    marker_true = marker_rest + np.einsum("ij,tijk->tik", mesh.shape10(marker_l), u[:, truth.liver10[marker_tet]])
    point_true = point_rest + np.einsum("ij,tijk->tik", mesh.shape10(point_l), u[:, truth.liver10[point_tet]])
    observed = sampling.observe(marker_true, NOISE, seed=13)

    regions = [(name, *loads.patch_weights(case_nodes, case_surface, to_surface(truth.nodes, truth.surface, centre), radius))
               for name, centre, radius in loads.PATCHES]
    prior = PRIOR.prior_probability(case_nodes[surface_ids])
    keep = np.round(prior, 4) >= 0.005
    attached = surface_ids[ligament.contains(case_nodes[surface_ids])]

    writer.mesh_vtk(out / "mesh.vtk", case_nodes, case_tets)
    writer.probabilities(out / "ligament_prior.csv", surface_ids[keep], prior[keep])
    writer.load_nodes(out / "load_nodes.csv", regions)
    writer.loads(out / "loads.csv", times, [r[0] for r in regions], forces)
    writer.points(out / "markers_rest.csv", "marker_id", marker_rest)
    writer.points(out / "validation_rest.csv", "point_id", point_rest)
    writer.positions(out / "observations.csv", "marker_id", times, observed)
    writer.positions(out / "validation.csv", "point_id", times, point_true)
    writer.document(out / "case.json", _case(recipe))
    quality = mesh.radius_ratios(case_nodes, case_tets)
    strip = truth.nodes[truth.strip]
    area = 0.5 * np.linalg.norm(np.cross(strip[:, 1] - strip[:, 0], strip[:, 2] - strip[:, 0]), axis=1).sum()
    rms = lambda d: round(1e3 * float(np.sqrt((d ** 2).sum(axis=-1).mean())), 3)
    writer.document(out / "truth.json", {
        "label": "none", "effects": [],
        "ligament": dict(ligament.__dict__, law="neo_hookean", attachment_node_ids=[int(i) for i in attached],
                         strip_area_m2=round(area, 6)),
        "prior_ligament": dict(PRIOR.__dict__),
        "case_mesh": {"nodes": len(case_nodes), "tets": len(case_tets), "min_radius_ratio": round(quality.min(), 3),
                      "volume_l": round(1e3 * mesh.signed_volumes(case_nodes, case_tets).sum(), 3)},
        "truth_volume_l": round(1e3 * mesh.signed_volumes(truth.nodes, truth.tets).sum(), 3),
        "motion": {"rms_points_mm": rms(point_true - point_rest), "rms_markers_mm": rms(marker_true - marker_rest),
                   "noise_rms_3d_mm": round(1e3 * NOISE * 3 ** 0.5, 2)},
        "solver": solver,
    })
    return solver


def _case(recipe):
    return {
        "format": "teres-case-1", "name": recipe.name,
        "frame": "x to the patient's left, y up (cranial), z to the front; origin at the centre of the bounding box",
        "time": {"frames": recipe.frames, "dt_s": float(recipe.times()[1]), "quasi_static": True},
        "body": {"law": "ogden", "shear_modulus_pa": SHEAR_MODULUS, "alpha": ALPHA,
                 "bulk_modulus_pa": round(BULK_MODULUS, 1), "youngs_modulus_pa": round(YOUNGS_MODULUS, 1),
                 "poissons_ratio": POISSON, "density_kg_m3": 1060.0,
                 "note": "one-term Ogden on isochoric stretches; E and nu are its small-strain equivalents"},
        "ligament": {"law": "neo_hookean", "youngs_modulus_pa": PRIOR.youngs_modulus_pa,
                     "poissons_ratio": PRIOR.poissons_ratio, "height_m": PRIOR.height, "width_m": PRIOR.width},
        "gravity_m_s2": [0, 0, 0],
        "sensor": {"noise_sigma_m": NOISE, "camera_position_m": CAMERA.tolist(), "view_direction": [0, 0, -1],
                   "up": [0, 1, 0], "latency_s": 0.0},
    }
