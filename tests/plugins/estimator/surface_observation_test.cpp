// Surface points against closed forms, and on a twin: what they add to few markers, and what they tell alone.
#include "plugins/estimator/surface_observation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "plugins/estimator/boundary_estimator.h"
#include "plugins/simulation/case_model.h"
#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// The columns of a frame.
struct Points {
    std::vector<std::int32_t> id;
    std::vector<double> x, y, z, sigma, rest_x, rest_y, rest_z;
    void add(const Vector3d& p, double s, std::int32_t feature = -1, const Vector3d& rest = Vector3d::Constant(kNaN)) {
        id.push_back(feature);
        for (auto [to, value] : {std::pair{&x, p.x()},
                                 {&y, p.y()},
                                 {&z, p.z()},
                                 {&sigma, s},
                                 {&rest_x, rest.x()},
                                 {&rest_y, rest.y()},
                                 {&rest_z, rest.z()}})
            to->push_back(value);
    }
    SurfaceFrame frame() const { return {id, x, y, z, sigma, rest_x, rest_y, rest_z}; }
};

VectorXd positions(const Case& c) {
    VectorXd x(3 * std::ssize(c.mesh.nodes));
    for (std::size_t n = 0; n < c.mesh.nodes.size(); ++n)
        for (std::size_t a = 0; a < 3; ++a) x(static_cast<Eigen::Index>(3 * n + a)) = c.mesh.nodes[n][a];
    return x;
}

// A block of 0.1 x 0.03 x 0.03 m, shifted by d (mean of the lanes), lane k by d + k e about it.
TEST(SurfaceObservation, IsDistanceAlongTheNormalAndWholePositionForFeatures) {
    const Case c = test::clamped_block();
    SurfaceObservation surface(
        c.mesh, {.gate_m = 0.005, .correlated_points = 4.0, .relative_model_error = 0.1, .model_error_sigma_m = 3e-4});
    const Vector3d d(0.001, -0.002, 0.0015), e(2e-4, 1e-4, -3e-4);
    const VectorXd rest = positions(c);
    MatrixXd lanes(rest.size(), 3);
    for (int k = 0; k < 3; ++k) lanes.col(k) = rest + (d + (k - 1) * e).replicate(rest.size() / 3, 1);
    Points points;
    points.add(Vector3d(0.047, 0.013, 0.0303) + d, 4e-4);  // 0.3 mm above the upper face
    points.add(Vector3d(0.052, 0.0297, 0.011) + d, 4e-4);  // 0.3 mm below the side face
    points.add(Vector3d(0.05, 0.015, 0.036) + d, 4e-4);    // beyond the gate
    points.add({kNaN, 0.0, 0.0}, 4e-4);
    points.add(Vector3d(0.033, 0.008, 0.0305) + d, 2e-4, 7, {0.033, 0.008, 0.03});  // known point of the upper face
    points.add(Vector3d(0.033, 0.008, 0.0305) + d, 2e-4, 8);                        // a feature without rest position
    surface.look(points.frame(), lanes);
    ASSERT_EQ(surface.num_rows(), 5u);
    const VectorXd off = surface.z() - surface.Z().col(1);
    const double want[] = {3e-4, -3e-4, 0.0, 0.0, 5e-4};
    for (int r = 0; r < 5; ++r) EXPECT_NEAR(off(r), want[r], 1e-12) << r;
    const MatrixXd step = surface.Z().col(2) - surface.Z().col(1);
    const double moved[] = {e.z(), e.y(), e.x(), e.y(), e.z()};
    for (int r = 0; r < 5; ++r) EXPECT_NEAR(step(r), moved[r], 1e-12) << r;
    const double model = 0.01 * d.squaredNorm() + 9e-8;
    EXPECT_NEAR(surface.variance(2.0)(0), 4.0 * (16e-8 + 2.0 * model), 1e-15);
    EXPECT_NEAR(surface.variance(1.0)(3), 4e-8 + model, 1e-15);
}

// ---- twin

constexpr double kMarkerSigma = 3e-4, kDepthSigma = 4e-4;
constexpr int kFrames = 60, kSurfacePoints = 80;

Case hanging_block(std::size_t markers) {
    Case c = test::clamped_block({.size_m = {0.12, 0.06, 0.04}, .cells = {8, 4, 4}, .poissons_ratio = 0.48});
    c.ligament = LigamentData{LigamentLaw::kNeoHookean, 80e3, 0.48, 0.025, 0.02, 0.0};
    for (std::size_t i = 0; i < c.mesh.nodes.size(); ++i)
        if (c.mesh.nodes[i][2] > 0.04 - 1e-9 && std::abs(c.mesh.nodes[i][1] - 0.03) < 0.016 && c.mesh.nodes[i][0] > 0.0)
            c.ligament_prior.push_back({static_cast<std::int32_t>(i), 0.7});
    c.markers.resize(std::min(markers, c.markers.size()));
    return c;
}

std::unique_ptr<CaseModel> make_model(const Case& c) {
    CaseModelSettings s;
    s.max_lanes = 8;
    s.ligament.num_groups = 3;
    s.equilibrium.relative_residual = 1e-5;
    return *CaseModel::make(c, s);
}

struct Outcome {
    VectorXd error, stdev;  // of ln stiffness
    double rms_error() const { return error.norm() / std::sqrt(static_cast<double>(error.size())); }
};

Outcome run(bool with_markers, bool with_surface) {
    const Case c = hanging_block(1);
    const auto truth = make_model(c), model = make_model(c);
    BoundaryEstimatorOptions options;
    options.relative_model_error = options.model_error_sigma_m = 0.0;
    auto estimator = BoundaryEstimator::make(*model, options).value();
    if (with_surface)
        estimator.observe_surface(SurfaceObservation(
            c.mesh, {.correlated_points = 1.0, .relative_model_error = 0.0, .model_error_sigma_m = 0.0}));
    std::vector<double> theta;
    for (std::size_t p = 0; p < truth->num_parameters(); ++p)
        theta.push_back(truth->parameter(p).prior_median * (p % 2 == 0 ? 2.5 : 0.5));
    const Surface surface(c.mesh);
    VectorXd x = positions(c), z(3);
    std::mt19937_64 random(5);
    std::normal_distribution<double> noise;
    std::uniform_real_distribution<double> uniform;
    const std::vector<std::int32_t> id{truth->marker_id(0)};
    const std::vector<double> sigma{kMarkerSigma};
    for (int f = 0; f < kFrames; ++f) {
        const double t = f / 30.0, pull = 0.7 + 0.4 * std::sin(3.0 * t);
        const double force[3] = {0.4 * pull, 0.3 * pull * std::sin(2.0 * t), -pull};
        EXPECT_EQ(truth->advance({t, 1.0 / 30.0, force, {}}, theta, {x.data(), static_cast<std::size_t>(x.size())}, 1)
                      .lanes_converged,
                  1);
        truth->observe({x.data(), static_cast<std::size_t>(x.size())}, {z.data(), 3}, 1);
        Points points;  // of the lower and the front side, as a camera there sees them
        while (std::ssize(points.x) < kSurfacePoints) {
            const auto& [a, b, d] = surface.triangles()[random() % surface.triangles().size()];
            const Vector3d A = x.segment<3>(3 * a), B = x.segment<3>(3 * b), D = x.segment<3>(3 * d),
                           n = (B - A).cross(D - A).normalized();
            if (n.z() > -0.5 && n.y() > -0.5) continue;
            double u = uniform(random), v = uniform(random);
            if (u + v > 1.0) u = 1.0 - u, v = 1.0 - v;
            points.add(A + u * (B - A) + v * (D - A) + kDepthSigma * noise(random) * n, kDepthSigma);
        }
        std::vector<double> mx{z(0)}, my{z(1)}, mz{z(2)};
        for (auto* axis : {&mx, &my, &mz}) axis->front() += with_markers ? kMarkerSigma * noise(random) : kNaN;
        const FrameOutcome outcome =
            estimator.step({static_cast<std::int64_t>(1e6 * t) + 1, id, mx, my, mz, sigma, points.frame()},
                           {t, 1.0 / 30.0, force, {}});
        EXPECT_EQ(outcome, with_markers || with_surface ? FrameOutcome::kCorrected : FrameOutcome::kPredicted);
    }
    Outcome out{estimator.theta(), estimator.covariance().diagonal().cwiseSqrt()};
    for (std::size_t p = 0; p < theta.size(); ++p) out.error(static_cast<Eigen::Index>(p)) -= std::log(theta[p]);
    return out;
}

TEST(SurfaceObservation, SurfacePointsFindWhatOneMarkerLeavesOpen) {
    const Outcome marker = run(true, false), both = run(true, true), surface = run(false, true);
    for (const auto& [name, o] : {std::pair{"marker", &marker}, {"both", &both}, {"surface", &surface}})
        std::printf("%-8s error of ln stiffness %.3f rms, stated %.3f %.3f %.3f\n", name, o->rms_error(), o->stdev(0),
                    o->stdev(1), o->stdev(2));
    EXPECT_LT(both.rms_error(), 0.7 * marker.rms_error());
    EXPECT_LT(surface.rms_error(), 0.8 * marker.rms_error());
    EXPECT_LT(both.stdev(1), 0.1 * marker.stdev(1)) << "the middle group; the first, beside the clamp, hardly moves";
    EXPECT_LT(surface.stdev(1), 0.1 * marker.stdev(1));
    for (const Outcome* o : {&both, &surface}) {
        EXPECT_TRUE((o->stdev.array() < marker.stdev.array()).all());
        EXPECT_TRUE((o->error.cwiseAbs().array() < 3.5 * o->stdev.array()).all())
            << o->error.transpose() << " of " << o->stdev.transpose();
    }
}

}  // namespace
}  // namespace teres
