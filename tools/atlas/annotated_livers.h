// Livers with marked attachments, from the folders that `teres atlas build` reads.
//
//     DIR/mesh/NAME.obj + DIR/landmarks/NAME.csv       class,v0,v1: marked edges of the surface; class
//     `ligament`
//                                                      is the falciform's anterior attachment
//     DIR/NAME/whole_liver.obj + vertex_distance_mm.csv  v,<part>,...: distance of every vertex to each part;
//     a
//                                                      vertex closer than kTouching_m carries the ligament
#pragma once

#include <map>

#include "tools/atlas/triangle_surface.h"

namespace teres {

inline constexpr double kTouching_m = 1.5e-3;

struct AnnotatedLiver {
    std::string name;
    TriangleSurface surface;                                    ///< frame RAS [m]
    std::map<std::string, std::vector<Eigen::Vector3d>> marks;  ///< points of each ligament on the surface
    std::map<std::string, std::vector<std::int32_t>> nodes;     ///< vertices that carry it
};

/// Rotation to RAS (x right, y anterior, z superior) from a frame named by where its axes point, e.g. "LSA".
/// Errors: kInvalidInput if the letters are not one each of R/L, A/P, S/I, or make a mirrored frame.
Result<Eigen::Matrix3d> rotation_to_ras(const std::string& frame);

/// The surface is closed, in one piece and of a liver's size. Errors (kInvalidInput): see check_closed; the
/// extent is out of range (the unit is named).
Status check_liver(TriangleSurface& surface, const std::string& name, double unit_m);

/// Sorted by name. Errors (kInvalidInput): no liver found, bad surface, annotation off the surface (an id
/// that does not exist, an edge that the surface does not have).
Result<std::vector<AnnotatedLiver>> read_annotated_livers(const std::filesystem::path& folder, double unit_m,
                                                          const std::string& frame);

}  // namespace teres
