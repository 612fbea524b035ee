"""The falciform band: a strip of surface triangles extruded along the outward normal, far edge fixed."""

import dataclasses

import numpy as np

from . import mesh

_AXIS_Y, _AXIS_Z = 0.035, 0.020  # [m] axis along x about which the strip runs, from the front (0 deg) to the top (90 deg)


@dataclasses.dataclass
class Band:
    x0: float  # [m] centre line at the middle of its arc
    tilt: float  # [m] drift of the centre line in x over the whole arc
    width: float  # [m]
    theta0_deg: float
    theta1_deg: float
    height: float  # [m]
    youngs_modulus_pa: float
    poissons_ratio: float

    def coordinates(self, p):
        """Distance from the centre line in x [m] and arc angle [deg]."""
        theta = np.degrees(np.arctan2(p[:, 1] - _AXIS_Y, p[:, 2] - _AXIS_Z))
        along = (theta - 0.5 * (self.theta0_deg + self.theta1_deg)) / (self.theta1_deg - self.theta0_deg)
        return p[:, 0] - self.x0 - self.tilt * along, theta

    def contains(self, p):
        across, theta = self.coordinates(p)
        return (np.abs(across) <= 0.5 * self.width) & (theta >= self.theta0_deg) & (theta <= self.theta1_deg)

    def prior_probability(self, p, core=0.004, sigma=0.009, end_deg=7.0, peak=0.97):
        """Smooth bell over the distance from the centre line, fading out at both ends of the arc."""
        across, theta = self.coordinates(p)
        bell = np.exp(-0.5 * (np.maximum(np.abs(across) - core, 0.0) / sigma) ** 2)
        ends = 1.0 / (1.0 + np.exp(-(theta - self.theta0_deg) / end_deg)) / (
            1.0 + np.exp((theta - self.theta1_deg) / end_deg))
        return peak * bell * ends


def extrude(nodes, triangles, normals, height, layers):
    """Tetrahedra of the prisms over the triangles: (new nodes, tets, far nodes). Neighbours share their diagonals."""
    base = np.unique(triangles)
    level = {int(n): [int(n)] + [len(nodes) + layer * len(base) + i for layer in range(layers)]
             for i, n in enumerate(base)}
    new = np.concatenate([nodes[base] + normals[base] * (height * (layer + 1) / layers) for layer in range(layers)])
    tets = []
    for triangle in triangles:
        a, b, c = sorted(int(n) for n in triangle)  # diagonals follow the node order, alike from both sides
        for layer in range(layers):
            (a0, a1), (b0, b1), (c0, c1) = ((level[n][layer], level[n][layer + 1]) for n in (a, b, c))
            tets += [(a0, b0, c0, c1), (a0, b0, b1, c1), (a0, a1, b1, c1)]
    tets = np.array(tets)
    everything = np.concatenate([nodes, new])
    flipped = mesh.signed_volumes(everything, tets) < 0.0
    tets[flipped] = tets[flipped][:, [0, 2, 1, 3]]
    return new, tets, np.array([level[int(n)][layers] for n in base])
