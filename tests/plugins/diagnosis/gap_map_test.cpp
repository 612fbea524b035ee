// Where what has no name lies, on a clamped block that is pulled at a known place.
#include "plugins/diagnosis/gap_map.h"

#include <gtest/gtest.h>

#include <memory>
#include <string_view>
#include <utility>
#include <vector>

#include "plugins/simulation/trajectory.h"
#include "tests/support/posed_problem.h"
#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

constexpr double kNoise = 1e-5;
const Eigen::Vector3d kPulled(0.06, 0.02, 0.04), kStiff(0.03, 0.02, 0.02);

Case block() {
    return test::clamped_block({.size_m = {0.10, 0.04, 0.04},
                                .cells = {8, 3, 3},
                                .law = BodyLaw::kNeoHookean,
                                .youngs_modulus_pa = 15e3,
                                .poissons_ratio = 0.45,
                                .frames = 8,
                                .dt_s = 0.2,
                                .quasi_static = true,
                                .full_force_n = {0.0, 0.0, 0.0}});
}

class GapMap : public ::testing::Test, protected test::PosedProblem {
  protected:
    ActiveEffect effect_at(const char* id, const Eigen::Vector3d& centre_m, double force_z_n) const {
        ActiveEffect effect = effects_.candidate(effects_.find(id), 0);
        const EffectEntry& entry = effects_[effect.entry];
        for (std::size_t p = 0; p < entry.parameters.size(); ++p) {
            const std::string_view name = entry.parameters[p].name;
            if (name == "force_x" || name == "force_y") effect.values[p] = 0.0;
            if (name == "force_z") effect.values[p] = force_z_n;
            if (name == "center_x") effect.values[p] = centre_m.x();
            if (name == "center_y") effect.values[p] = centre_m.y();
            if (name == "center_z") effect.values[p] = centre_m.z();
        }
        return effect;
    }
    void SetUp() override {
        Simulator truth(*body_, nullptr, effects_);
        Eigen::VectorXd pulled;
        ASSERT_TRUE(truth.simulate({{}, {effect_at("unknown_load", kPulled, 0.1)}}, pulled));
        pose(*body_, nullptr, effects_, {pulled.begin(), pulled.end()}, kNoise);
        ASSERT_TRUE(nominal_.usable);
    }
    Cause fitted(const std::vector<const char*>& ids, double score) {
        Cause cause;
        Assumption at;
        for (const char* id : ids) at.effects.push_back(effect_at(id, kStiff, 0.1));
        for (const ActiveEffect& effect : at.effects) cause.entries.push_back(effect.entry);
        cause.fit = problem_->fit(at, 0);
        cause.score = score;
        return cause;
    }
    Eigen::Vector3d place(std::vector<Cause> causes) {
        Eigen::VectorXd motion;
        simulator_->simulate(nominal_.at, motion);
        const Where where = locate(*simulator_, problem_->whitener, *recording_, nominal_,
                                   {std::move(causes), 0.0, 1.0}, nullptr, true);
        return where.center_m ? Eigen::Vector3d(where.center_m->data()) : Eigen::Vector3d::Zero();
    }

    std::unique_ptr<Trajectory> body_ = *Trajectory::make(block(), {});
    EffectTable effects_{*body_, nullptr, {}};
};

TEST_F(GapMap, WhatPullsIsWhereAForceWouldExplainMost) {
    EXPECT_LT((place({}) - kPulled).norm(), 0.015) << "patches are some 20 mm apart";
}

TEST_F(GapMap, WhatHasNoNameIsWhereThePartOfTheBodyIsThatComesNearest) {
    EXPECT_LT((place({fitted({"unknown_load"}, 1.0), fitted({"inclusion", "stiffness"}, 2.0)}) - kStiff).norm(), 0.006)
        << "it is strained more on the side of the pull";
    const Eigen::Vector3d by_forces = place({});
    EXPECT_EQ(place({fitted({"inclusion"}, -1.0)}), by_forces) << "it does not pay";
    EXPECT_EQ(place({fitted({"unknown_load"}, 2.0), fitted({"inclusion"}, 1.0)}), by_forces) << "a load comes nearer";
    EXPECT_EQ(place({fitted({"stiffness", "inclusion"}, 1.0)}), by_forces) << "what explains most has no place";
}

}  // namespace
}  // namespace teres
