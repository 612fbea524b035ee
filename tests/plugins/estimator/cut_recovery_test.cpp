// A ligament is released and tissue parted while the filter runs: the estimate goes on from the model that is left.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "plugins/estimator/boundary_estimator.h"
#include "plugins/simulation/case_model.h"
#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kSigma = 2e-4, kStep = 1.0 / 30.0;
constexpr int kCutFrame = 60, kFrames = 160;
constexpr std::int32_t kReleased = 1;

Case hanging_block() {
    Case c = test::clamped_block({.size_m = {0.12, 0.06, 0.04}, .cells = {8, 4, 4}, .poissons_ratio = 0.48});
    c.ligament = LigamentData{LigamentLaw::kNeoHookean, 80e3, 0.48, 0.025, 0.02, 0.0};
    for (std::size_t i = 0; i < c.mesh.nodes.size(); ++i)  // over the top, from end to end
        if (c.mesh.nodes[i][2] > 0.04 - 1e-9 && std::abs(c.mesh.nodes[i][1] - 0.03) < 0.016 && c.mesh.nodes[i][0] > 0.0)
            c.ligament_prior.push_back({static_cast<std::int32_t>(i), 0.7});
    return c;
}

std::vector<std::int32_t> slit(const Case& c) {  // from below, half of the height
    std::vector<std::int32_t> out;
    for (std::size_t e = 0; e < c.mesh.tets.size(); ++e) {
        Eigen::Vector3d p = Eigen::Vector3d::Zero();
        for (const auto node : c.mesh.tets[e])
            p += 0.25 * Eigen::Map<const Eigen::Vector3d>(c.mesh.nodes[static_cast<std::size_t>(node)].data());
        if (std::abs(p.x() - 0.06) < 0.015 && p.z() < 0.02) out.push_back(static_cast<std::int32_t>(e));
    }
    return out;
}

std::unique_ptr<CaseModel> make_model(const Case& c) {
    CaseModelSettings s;
    s.max_lanes = 8;
    s.ligament.num_groups = 3;
    s.equilibrium.relative_residual = 1e-5;
    return *CaseModel::make(c, s);
}

/// The filter over a recording in which both happen at kCutFrame. told: the model follows.
struct Recording {
    std::unique_ptr<CaseModel> truth, model;
    std::vector<double> theta;
    BoundaryEstimator estimator;
    std::vector<double> rms;  // of the innovation, per frame
    int not_solved = 0;

    Recording(bool told, bool reduced_order)
        : truth(make_model(hanging_block())),
          model(make_model(hanging_block())),
          estimator(BoundaryEstimator::make(*model, options(reduced_order)).value()) {
        const std::vector<std::int32_t> tets = slit(hanging_block()), released{kReleased};
        for (std::size_t p = 0; p < truth->num_parameters(); ++p)
            theta.push_back(truth->parameter(p).prior_median * (p % 2 == 0 ? 2.0 : 1.5));
        std::vector<double> x(truth->num_state()), z(3 * truth->num_markers());
        truth->rest_state(x);
        std::mt19937_64 random(3);
        std::normal_distribution<double> noise(0.0, kSigma);
        std::vector<std::int32_t> id;
        for (std::size_t m = 0; m < truth->num_markers(); ++m) id.push_back(truth->marker_id(m));
        std::vector<double> mx(id.size()), my(id.size()), mz(id.size());
        const std::vector<double> sigma(id.size(), kSigma);
        for (int f = 0; f < kFrames; ++f) {
            const double t = f * kStep, pull = 0.25 + 0.15 * std::sin(3.0 * t);
            const double force[3] = {0.4 * pull, 0.3 * pull * std::sin(2.0 * t), -pull};
            if (f == kCutFrame) {
                EXPECT_EQ(truth->cut(tets, released).outcome, CutOutcome::kDone);
                if (told) {
                    EXPECT_EQ(model->cut(tets, released).outcome, CutOutcome::kDone);
                    estimator.follow_cut(released, {});
                }
            }
            EXPECT_EQ(truth->advance({t, kStep, force, {}}, theta, x, 1).lanes_converged, 1);
            truth->observe(x, z, 1);
            for (std::size_t m = 0; m < id.size(); ++m) {
                mx[m] = z[3 * m] + noise(random);
                my[m] = z[3 * m + 1] + noise(random);
                mz[m] = z[3 * m + 2] + noise(random);
            }
            const FrameOutcome outcome =
                estimator.step({static_cast<std::int64_t>(1e6 * t) + 1, id, mx, my, mz, sigma}, {t, kStep, force, {}});
            not_solved += outcome == FrameOutcome::kNotSolved;
            rms.push_back(std::sqrt(estimator.residual().squaredNorm() / static_cast<double>(3 * id.size())));
        }
    }
    static BoundaryEstimatorOptions options(bool reduced_order) {
        BoundaryEstimatorOptions o;
        o.reduced_order = reduced_order;
        o.relative_model_error = 0.0;
        o.model_error_sigma_m = 0.0;
        return o;
    }
    double rms_after_cut() const {
        double sum = 0.0;
        for (std::size_t f = kFrames - 40; f < kFrames; ++f) sum += rms[f] / 40.0;
        return sum;
    }
};

class CutRecovery : public ::testing::TestWithParam<bool> {};

TEST_P(CutRecovery, EstimateGoesOnAfterReleaseAndCut) {
    const Recording told(true, GetParam()), untold(false, GetParam());
    EXPECT_EQ(told.not_solved, 0);
    EXPECT_LT(told.rms_after_cut(), 1.2 * kSigma);
    EXPECT_GT(untold.rms_after_cut(), 1.5 * told.rms_after_cut());
    const BoundaryEstimator& e = told.estimator;
    for (Eigen::Index p = 0; p < e.theta().size(); ++p) {
        const double stdev = std::sqrt(e.covariance()(p, p));
        EXPECT_GT(stdev, 1e-3);
        if (p == kReleased) continue;
        EXPECT_LT(std::abs(e.theta()(p) - std::log(told.theta[static_cast<std::size_t>(p)])), 3.0 * stdev)
            << "parameter " << p;
        EXPECT_GT(e.observability()(p), 0.5) << "parameter " << p;
    }
    std::vector<double> probability;
    e.attachment_probabilities(probability);
    for (std::size_t n = 0; n < told.model->num_attachment_nodes(); ++n) {
        if (told.model->attachment_node(n).parameter == kReleased)
            EXPECT_LT(probability[n], 0.01);
        else
            EXPECT_GT(probability[n], 0.5);
    }
}

INSTANTIATE_TEST_SUITE_P(Filters, CutRecovery, ::testing::Bool(),
                         [](const auto& reduced) { return reduced.param ? "reduced_order" : "parameters_only"; });

}  // namespace
}  // namespace teres
