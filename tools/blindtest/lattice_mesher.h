// Tetrahedra of a body given by a level function: a body-centred cubic lattice, snapped to the surface and clipped.
// Source: Labelle & Shewchuk, "Isosurface stuffing", ACM Trans. Graph. 26(3) 57, 2007; diagonals of cut prisms follow
// the node order, so that neighbours match, and the worst tetrahedra are then improved by moving nodes.
#pragma once

#include <functional>

#include "core/case/case.h"
#include "tools/blindtest/random.h"

namespace teres::blindtest {

struct LatticeOptions {
    Point low_m{}, high_m{};    ///< box that holds the body
    double cell_m = 0.02;       ///< edge of the lattice's cube; a full tetrahedron has cell^3 / 12
    Point axis{0.0, 0.0, 1.0};  ///< the lattice is turned about this unit axis ...
    double angle_rad = 0.0;     ///< ... by this angle
};

/// Tetrahedra of {level < 0}, positive orientation, every node used, the largest piece only.
TetMeshData mesh_level_set(const std::function<double(const Point&)>& level, const LatticeOptions& options);

/// 3 r_in / r_circum of every tetrahedron: 1 regular, 0 flat.
double radius_ratio(const Point& a, const Point& b, const Point& c, const Point& d);

}  // namespace teres::blindtest
