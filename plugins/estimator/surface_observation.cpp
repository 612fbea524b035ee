#include "plugins/estimator/surface_observation.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/case/geometry.h"
#include "plugins/estimator/probability.h"

namespace teres {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

Point point(const Vector3d& x) {
    return {x.x(), x.y(), x.z()};
}

}  // namespace

SurfaceObservation::SurfaceObservation(const TetMeshData& rest, const SurfaceOptions& options)
    : options_(options), surface_(rest), rest_(static_cast<Index>(3 * rest.nodes.size())) {
    for (std::size_t n = 0; n < rest.nodes.size(); ++n)
        for (std::size_t a = 0; a < 3; ++a) rest_(static_cast<Index>(3 * n + a)) = rest.nodes[n][a];
}

Vector3d SurfaceObservation::at(const Spot& spot, const Eigen::Ref<const VectorXd>& x) const {
    Vector3d p = Vector3d::Zero();
    for (std::size_t k = 0; k < 3; ++k)
        p += spot.weights[k] * x.segment<3>(3 * surface_.triangles()[static_cast<std::size_t>(spot.triangle)][k]);
    return p;
}

void SurfaceObservation::find_triangles(const VectorXd& mean) {
    mean_ = mean;
    const auto& triangles = surface_.triangles();
    centers_.resize(3, std::ssize(triangles));
    radii_.resize(std::ssize(triangles));
    for (Index t = 0; t < radii_.size(); ++t) {
        Eigen::Matrix3d corners;
        for (int k = 0; k < 3; ++k)
            corners.col(k) = mean.segment<3>(3 * triangles[static_cast<std::size_t>(t)][static_cast<std::size_t>(k)]);
        centers_.col(t) = corners.rowwise().mean();
        radii_(t) = (corners.colwise() - centers_.col(t)).colwise().norm().maxCoeff();
    }
}

// Of the mean prediction; triangle -1: farther than the gate.
SurfaceObservation::Spot SurfaceObservation::nearest(const Vector3d& p) const {
    Spot best{-1, {}};
    double distance = options_.gate_m;
    for (Index t = 0; t < radii_.size(); ++t) {
        const double reach = distance + radii_(t);
        if ((centers_.col(t) - p).squaredNorm() > reach * reach) continue;
        const auto& [a, b, c] = surface_.triangles()[static_cast<std::size_t>(t)];
        const Spot spot{static_cast<std::int32_t>(t),
                        closest_barycentric(point(p), point(mean_.segment<3>(3 * a)), point(mean_.segment<3>(3 * b)),
                                            point(mean_.segment<3>(3 * c)))};
        if (const double d = (at(spot, mean_) - p).norm(); d < distance) {
            distance = d;
            best = spot;
        }
    }
    return best;
}

void SurfaceObservation::look(const SurfaceFrame& frame, const MatrixXd& lanes) {
    struct Row {
        Spot spot;
        Vector3d direction;
        double z, sigma, counted;
    };
    std::vector<Row> rows;
    find_triangles(lanes.topRows(rest_.size()).rowwise().mean());
    for (std::size_t i = 0; i < frame.x_m.size(); ++i) {
        const Vector3d p(frame.x_m[i], frame.y_m[i], frame.z_m[i]),
            X(frame.rest_x_m[i], frame.rest_y_m[i], frame.rest_z_m[i]);
        if (!p.allFinite() || !(frame.sigma_m[i] > 0.0) || !std::isfinite(frame.sigma_m[i])) continue;
        if (frame.feature_id[i] >= 0) {
            if (!X.allFinite()) continue;
            const SurfacePoint rest = surface_.closest(point(X));
            const Spot spot{rest.triangle, rest.barycentric};
            if ((at(spot, mean_) - p).norm() > options_.gate_m) continue;
            for (int a = 0; a < 3; ++a) rows.push_back({spot, Vector3d::Unit(a), p(a), frame.sigma_m[i], 1.0});
            continue;
        }
        const Spot spot = nearest(p);
        if (spot.triangle < 0) continue;
        const auto& [a, b, c] = surface_.triangles()[static_cast<std::size_t>(spot.triangle)];
        const Vector3d A = mean_.segment<3>(3 * a), B = mean_.segment<3>(3 * b), C = mean_.segment<3>(3 * c);
        const Vector3d n = (B - A).cross(C - A).normalized();
        rows.push_back({spot, n, n.dot(p), frame.sigma_m[i], options_.correlated_points});
    }
    const Index count = std::ssize(rows);
    for (VectorXd* column : {&z_, &sigma_, &displacement_, &counted_}) column->resize(count);
    Z_.resize(count, lanes.cols());
    for (Index r = 0; r < count; ++r) {
        const Row& row = rows[static_cast<std::size_t>(r)];
        z_(r) = row.z;
        sigma_(r) = row.sigma;
        counted_(r) = row.counted;
        displacement_(r) = (at(row.spot, mean_) - at(row.spot, rest_)).norm();
        for (Index lane = 0; lane < lanes.cols(); ++lane)
            Z_(r, lane) = row.direction.dot(at(row.spot, lanes.col(lane)));
    }
}

VectorXd SurfaceObservation::variance(double model_share) const {
    const double floor = options_.model_error_sigma_m * options_.model_error_sigma_m;
    const Eigen::ArrayXd model = (options_.relative_model_error * displacement_.array()).square() + floor;
    return (counted_.array() * (sigma_.array().square() + model_share * model)).max(1e-18);
}

std::vector<std::uint8_t> SurfaceObservation::gate(const Innovation& innovation) const {
    std::vector<std::uint8_t> use(num_rows(), 1);
    if (use.empty() || options_.probability >= 1.0) return use;
    const Eigen::ArrayXd spread = innovation.deviations.rowwise().squaredNorm().array() + variance(1.0).array();
    const Eigen::ArrayXd distance = innovation.residual.array().square() / spread;
    std::vector<double> sorted(distance.begin(), distance.end());
    const auto middle = sorted.begin() + std::ssize(sorted) / 2;
    std::nth_element(sorted.begin(), middle, sorted.end());
    const double bound =
        std::max(1.0, *middle / chi_square_quantile(0.5, 1.0)) * chi_square_quantile(options_.probability, 1.0);
    for (std::size_t r = 0; r < use.size(); ++r) use[r] = distance(static_cast<Index>(r)) <= bound;
    return use;
}

}  // namespace teres
