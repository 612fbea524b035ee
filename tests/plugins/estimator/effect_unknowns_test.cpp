// Effects as unknowns of the filter: the truth is another case, not the effect's own code.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "plugins/estimator/boundary_estimator.h"
#include "plugins/estimator/settings.h"
#include "plugins/simulation/effect_model.h"
#include "plugins/simulation/settings.h"
#include "tests/support/soft_liver.h"

namespace teres {
namespace {

constexpr int kFrames = 24;
constexpr double kTrueRatio = 1.6;

Case scene(double youngs_modulus_pa) {
    tools::BenchScene s = test::soft_liver(700, kFrames);
    s.youngs_modulus_pa = youngs_modulus_pa;
    return tools::bench_case(s);
}

PlayerSettings settings() {
    PlayerSettings s;
    s.model.ligament.num_groups = 2;
    s.model.equilibrium.relative_residual = 1e-6;
    s.model.threads = 1;
    return s;
}

TEST(EffectUnknowns, AtNullTheModelIsTheNominalOne) {
    const Case c = scene(10e3);
    auto plain = *CaseModel::make(c, settings().model);
    auto with = *EffectModel::make(c, settings(), {"stiffness", "gravity"});
    ASSERT_GT(with->num_parameters(), plain->num_parameters());
    EXPECT_STREQ(with->parameter(plain->num_parameters()).name, "stiffness.factor");
    std::vector<double> theta, wide, x(plain->num_state()), y, force;
    for (std::size_t p = 0; p < with->num_parameters(); ++p) {
        const ForwardParameter parameter = with->parameter(p);
        if (p < plain->num_parameters()) theta.push_back(parameter.prior_median);
        wide.push_back(parameter.prior_median);  // an effect's prior is about null
    }
    plain->rest_state(x);
    y = x;
    const ForwardInputs in = test::inputs_at(c, 8, force);
    plain->advance(in, theta, x, 1);
    const ForwardReport report = with->advance(in, wide, y, 1);
    EXPECT_EQ(report.lanes_converged, 1);
    double apart = 0.0, moved = 0.0;
    std::vector<double> rest(x.size());
    plain->rest_state(rest);
    for (std::size_t d = 0; d < x.size(); ++d) {
        apart = std::max(apart, std::abs(x[d] - y[d]));
        moved = std::max(moved, std::abs(x[d] - rest[d]));
    }
    EXPECT_LT(apart, 3e-3 * moved);  // what is clamped stands on a thin stiff layer, for effects to move
    EXPECT_GT(moved, 1e-3);
}

// A body 1.6 times as stiff as the case says, 0.2 mm noise: the filter finds the factor, and predicts better with it.
TEST(EffectUnknowns, FilterFindsTheStiffnessBesideTheLigament) {
    const Case nominal = scene(10e3), truth = scene(kTrueRatio * 10e3);
    auto body = *CaseModel::make(truth, settings().model);
    std::vector<double> theta, x(body->num_state()), z(3 * body->num_markers()), force;
    for (std::size_t p = 0; p < body->num_parameters(); ++p) theta.push_back(body->parameter(p).prior_median);
    auto plain = *CaseModel::make(nominal, settings().model);
    auto with = *EffectModel::make(nominal, settings(), {"stiffness"});
    BoundaryEstimatorOptions options = *EstimatorSettings{}.options();
    options.relative_model_error = options.model_error_sigma_m = 0.0;
    auto without_effect = *BoundaryEstimator::make(*plain, options);
    auto with_effect = *BoundaryEstimator::make(*with, options);

    std::mt19937 random(5);
    std::normal_distribution<double> noise(0.0, 2e-4);
    std::vector<std::int32_t> id;
    for (std::size_t m = 0; m < body->num_markers(); ++m) id.push_back(body->marker_id(m));
    const std::vector<double> sigma(id.size(), 2e-4);
    body->rest_state(x);
    double left_without = 0.0, left_with = 0.0;
    for (int f = 0; f < kFrames; ++f) {
        const ForwardInputs in = test::inputs_at(nominal, f, force);
        body->advance(in, theta, x, 1);
        body->observe(x, z, 1);
        std::vector<double> px, py, pz;
        for (std::size_t m = 0; m < id.size(); ++m)
            for (std::size_t a = 0; a < 3; ++a)
                (a == 0 ? px : a == 1 ? py : pz).push_back(z[3 * m + a] + noise(random));
        const MarkerFrame frame{1 + static_cast<std::int64_t>(1e6 * in.time_s), id, px, py, pz, sigma};
        without_effect.step(frame, in);
        with_effect.step(frame, in);
        if (f >= kFrames / 2) {
            left_without += without_effect.residual().squaredNorm();
            left_with += with_effect.residual().squaredNorm();
        }
    }
    const auto i = static_cast<Eigen::Index>(body->num_parameters());
    const double mean = with_effect.theta()(i), stdev = std::sqrt(with_effect.covariance()(i, i));
    const double ratio = with_effect.parameters().to_physical(i, mean);
    const double noise_alone = 3.0 * static_cast<double>(id.size()) * (kFrames - kFrames / 2) * 2e-4 * 2e-4;
    std::printf(
        "stiffness factor %.3f, ln-deviation %.3f; innovations over the noise %.2f with the effect, %.2f without\n",
        ratio, stdev, left_with / noise_alone, left_without / noise_alone);
    EXPECT_NEAR(ratio, kTrueRatio, 0.1 * kTrueRatio);
    EXPECT_LT(left_with, 1.15 * noise_alone);  // nothing is left but noise: 504 numbers, 1 +- 0.06
    EXPECT_GT(left_without, 1.3 * noise_alone);
}

TEST(EffectUnknowns, WhatCannotBeEstimatedIsRefusedByName) {
    const Case c = scene(10e3);
    for (const auto& [id, word] : {std::pair{"stifness", "is none of stiffness"},
                                   {"latency", "is none of"},
                                   {"viscoelasticity", "memory"},
                                   {"damping", "quasi-static recording"}}) {
        const auto model = EffectModel::make(c, settings(), {id});
        ASSERT_FALSE(model) << id;
        EXPECT_NE(model.error().text.find(word), std::string::npos) << model.error().text;
    }
    SimulationSettings s;
    s.effects = "stiffness, gravity";
    EXPECT_EQ(s.effect_ids(), (std::vector<std::string>{"stiffness", "gravity"}));
}

}  // namespace
}  // namespace teres
