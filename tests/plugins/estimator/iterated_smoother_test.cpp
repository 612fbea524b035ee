#include "plugins/estimator/iterated_smoother.h"

#include <gtest/gtest.h>

#include <random>

#include "plugins/estimator/boundary_estimator.h"
#include "tests/support/spring_model.h"

using namespace teres;
using Eigen::Index;
using Eigen::VectorXd;
using test::SpringModel;

namespace {

// A recording of two springs whose true stiffnesses are far from the prior, pulled harder and harder.
struct Scene {
    explicit Scene(double walk, const std::vector<double>& stiffness) {
        BoundaryEstimatorOptions options;
        options.relative_model_error = options.model_error_sigma_m = 0.0;
        options.walk.noise_per_sqrt_s = walk;
        estimator.emplace(BoundaryEstimator::make(model, options).value());
        estimator->keep_recording(true);
        std::mt19937 engine(4);
        std::normal_distribution<double> noise(0.0, 0.0003);
        SpringModel truth;
        for (int k = 1; k <= 30; ++k) {
            const std::vector<double> force{0.0, 0.1 * k, 0.0, 0.0, 0.2 * k, 0.0};
            ForwardInputs inputs;
            inputs.region_force_n = force;
            std::vector<double> X(6), Z(12), x, y, z;
            truth.advance(inputs, stiffness, X, 1);
            truth.observe(X, Z, 1);
            for (std::size_t j = 0; j < 4; ++j) {
                x.push_back(Z[3 * j] + noise(engine));
                y.push_back(Z[3 * j + 1] + noise(engine));
                z.push_back(Z[3 * j + 2] + noise(engine));
            }
            const std::vector<std::int32_t> id{100, 101, 102, 103};
            const std::vector<double> sigma(4, 0.0003);
            estimator->step({100000 * k, id, x, y, z, sigma}, inputs);
        }
    }

    // J for parameters that do not move, straight from the definition and the closed form of the springs.
    double constant_cost(const VectorXd& theta) const {
        double sum = (theta.array() - std::log(SpringModel::kMedian)).square().sum() /
                     (SpringModel::kLogStdev * SpringModel::kLogStdev);
        for (const RecordedFrame& frame : estimator->recording())
            for (Index j = 0; j < 4; ++j) {
                const Index node = j / 2;
                const double u = frame.region_force_n[static_cast<std::size_t>(3 * node + 1)] /
                                 (std::exp(theta(node)) + SpringModel::kBed);
                const double predicted[] = {0.1 * static_cast<double>(node), u, j % 2 == 1 ? 0.01 : 0.0};
                for (Index a = 0; a < 3; ++a)
                    if (frame.used[static_cast<std::size_t>(3 * j + a)] != 0)
                        sum += std::pow((frame.z(3 * j + a) - predicted[a]) / 0.0003, 2);
            }
        return sum;
    }

    SpringModel model;
    std::optional<BoundaryEstimator> estimator;
};

}  // namespace

// With parameters that do not walk the result must be the minimum of J, found here by a search on a grid that
// closes in.
TEST(IteratedSmoother, FindsTheMaximumAPosteriori) {
    Scene scene(0.0, {35.0, 1500.0});
    const auto& map = scene.estimator->parameters();
    const SmootherResult result = smooth_recording(scene.model, map, scene.estimator->recording(), 6);
    VectorXd best = scene.estimator->theta();
    double step = 0.5, least = scene.constant_cost(best);
    while (step > 1e-7) {
        bool moved = false;
        for (Index i = 0; i < 2; ++i)
            for (double sign : {-1.0, 1.0}) {
                VectorXd trial = best;
                trial(i) += sign * step;
                if (const double cost = scene.constant_cost(trial); cost < least) {
                    least = cost;
                    best = trial;
                    moved = true;
                }
            }
        if (!moved) step *= 0.5;
    }
    // Sigma points linearise over a spread, so the result differs from the exact minimum by a small part of
    // its sigma.
    const SmoothedFrame& last = result.frames.back();
    for (Index i = 0; i < 2; ++i) EXPECT_NEAR(last.mean(i), best(i), 0.1 * std::sqrt(last.covariance(i, i)));
    EXPECT_NEAR(result.cost.back(), least, 0.05);
    EXPECT_NEAR(scene.constant_cost(last.mean), result.cost.back(), 1e-6 * least);
}

TEST(IteratedSmoother, PassesNeverRaiseTheCost) {
    Scene scene(0.2, {20.0, 4000.0});
    const SmootherResult result =
        smooth_recording(scene.model, scene.estimator->parameters(), scene.estimator->recording(), 4);
    ASSERT_GE(result.cost.size(), 2u);
    for (std::size_t i = 1; i < result.cost.size(); ++i) EXPECT_LE(result.cost[i], result.cost[i - 1]);
    EXPECT_EQ(result.frames.size(), 30u);
    for (const SmoothedFrame& frame : result.frames) {
        EXPECT_TRUE(frame.mean.allFinite());
        EXPECT_GT(frame.covariance.diagonal().minCoeff(), 0.0);
    }
}

TEST(IteratedSmoother, WithoutPassesIsThePlainSmoother) {
    Scene scene(0.1, {100.0, 300.0});
    std::vector<FilteredFrame> filtered;
    for (const RecordedFrame& frame : scene.estimator->recording()) filtered.push_back(frame.filtered);
    const std::vector<SmoothedFrame> plain = smooth(filtered);
    const SmootherResult result =
        smooth_recording(scene.model, scene.estimator->parameters(), scene.estimator->recording(), 0);
    for (std::size_t k = 0; k < plain.size(); ++k) EXPECT_EQ(result.frames[k].mean, plain[k].mean);
    EXPECT_TRUE(smooth_recording(scene.model, scene.estimator->parameters(), {}, 3).frames.empty());
}
