// Non-rigid registration of a shape to a surface of the same organ.
//
//     1. similarity (rotation R, scale s, translation t): symmetric closest-point iteration from several
//     starts
//     2. optimal-step non-rigid closest points (after Amberg et al., CVPR 2007): positions x of the shape's
//        vertices minimise
//            sum_v w_v |x_v - c_v|^2 + sum_j |B_j x - y_j|^2 + alpha |L (x - T)|^2,
//        c_v the closest target point (w_v = 0 where the normals disagree), y_j target vertices with B_j x
//        their closest shape point, L the uniform Laplacian of the shape, T the shape after step 1 carried
//        along; alpha falls in steps.
#pragma once

#include <vector>

#include "tools/atlas/triangle_surface.h"

namespace teres {

struct Similarity {
    Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
    double scale = 1.0;
    Eigen::Vector3d t = Eigen::Vector3d::Zero();

    Eigen::Matrix3Xd operator()(const Eigen::Matrix3Xd& X) const { return (scale * R * X).colwise() + t; }
    Eigen::Matrix3Xd inverse(const Eigen::Matrix3Xd& Y) const;
    double rotation_rad() const;
};

struct RegistrationSettings {
    double stiffest = 200.0, softest = 1.0;  ///< alpha, first and last
    int steps = 10, iterations_per_step = 3;
};

struct Registration {
    Similarity similarity;          ///< shape -> target
    double similarity_rms_m = 0.0;  ///< both ways, after the similarity alone
    Eigen::Matrix3Xd X;             ///< vertices of the shape on the target
    double rms_m = 0.0;             ///< both ways, at the end
};

/// Best similarity from the given start rotations.
struct AlignedStart {
    Similarity similarity;
    double rms_m = 0.0;
};
AlignedStart align(const TriangleSurface& shape, const TriangleSurface& target,
                   const std::vector<Eigen::Matrix3d>& starts);
/// Upright within 30 degrees and a little more: identity and +-25 degrees about each axis and pairs of axes.
std::vector<Eigen::Matrix3d> upright_starts();

Registration register_shape(const TriangleSurface& shape, const TriangleSurface& target, const Similarity& start,
                            const RegistrationSettings& settings = {});

}  // namespace teres
