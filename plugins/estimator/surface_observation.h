// Points measured on the organ's surface as rows of a filter's observation. x^i: lane i, w: weights in a surface
// triangle.
//
//     depth surface     which point of the model it is, no one knows: the nearest triangle of the mean prediction, its
//                       normal n, stay fixed for the frame; point to plane      z = n.p     Z_i = n.(sum_k w_k x_k^i)
//     texture feature   known where it was at rest: the nearest triangle there  z = p       Z_i = sum_k w_k x_k^i
//
// Variance of a row: sigma^2 + model error as of a marker (boundary_estimator.h). The model's error is alike over
// neighbouring points of the surface, so `correlated_points` of them count as one.
#pragma once

#include <Eigen/Dense>
#include <cstdint>
#include <span>
#include <vector>

#include "core/case/surface.h"
#include "plugins/estimator/ensemble_correction.h"

namespace teres {

struct SurfaceOptions {
    double gate_m = 0.01;  ///< points farther from the prediction are of something else
    double correlated_points = 10.0;
    double probability = 0.9999;  ///< share of good rows that pass
    double relative_model_error = 0.05, model_error_sigma_m = 0.0003;
};

/// Of one frame; the spans are equally long, or all empty.
struct SurfaceFrame {
    std::span<const std::int32_t> feature_id;  ///< -1: depth surface
    std::span<const double> x_m, y_m, z_m, sigma_m;
    std::span<const double> rest_x_m, rest_y_m, rest_z_m;
};

class SurfaceObservation {
  public:
    /// rest: of the nodes that the state holds first, three rows each.
    SurfaceObservation(const TetMeshData& rest, const SurfaceOptions& options);

    /// [loop] Rows of a frame; lanes: num_state x r.
    void look(const SurfaceFrame& frame, const Eigen::MatrixXd& lanes);
    const Eigen::VectorXd& z() const { return z_; }
    const Eigen::MatrixXd& Z() const { return Z_; }
    /// model_share: how many times the variance of the model's error counts.
    Eigen::VectorXd variance(double model_share) const;
    /// [loop] One flag per row; a row is judged by its own chi-square, scaled by the median of all.
    std::vector<std::uint8_t> gate(const Innovation& innovation) const;
    std::size_t num_rows() const { return static_cast<std::size_t>(z_.size()); }

  private:
    struct Spot {
        std::int32_t triangle;
        std::array<double, 3> weights;
    };
    void find_triangles(const Eigen::VectorXd& mean);
    Spot nearest(const Eigen::Vector3d& p) const;
    Eigen::Vector3d at(const Spot& spot, const Eigen::Ref<const Eigen::VectorXd>& x) const;

    SurfaceOptions options_;
    Surface surface_;
    Eigen::VectorXd rest_, mean_;
    Eigen::Matrix3Xd centers_;  // of the triangles of the mean prediction
    Eigen::VectorXd radii_;
    Eigen::VectorXd z_, sigma_, displacement_, counted_;
    Eigen::MatrixXd Z_;
};

}  // namespace teres
