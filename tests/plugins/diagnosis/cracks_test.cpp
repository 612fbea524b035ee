// Cracks found from where a ball of softened tissue was fitted: a block that is notched half way through a recording.
#include "plugins/diagnosis/cracks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string_view>
#include <vector>

#include "plugins/simulation/trajectory.h"
#include "tests/support/posed_problem.h"
#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

using Eigen::Vector3d;

constexpr double kNoise = 3e-5;

Case block() {
    return test::clamped_block({.size_m = {0.10, 0.04, 0.04},
                                .cells = {10, 4, 4},
                                .law = BodyLaw::kNeoHookean,
                                .youngs_modulus_pa = 15e3,
                                .poissons_ratio = 0.45,
                                .frames = 12,
                                .dt_s = 0.2,
                                .quasi_static = true,
                                .full_force_n = {0.01, 0.02, -0.06}});
}

class Cracks : public ::testing::Test, protected test::PosedProblem {
  protected:
    const EffectEntry& entry() const { return effects_[effects_.find("cut")]; }
    ActiveEffect cut_at(const Vector3d& centre_m, double radius_m) const {
        ActiveEffect cut = with_crack(entry(), effects_.candidate(effects_.find("cut"), 0),
                                      {centre_m, Vector3d::UnitX(), Vector3d::Zero(), radius_m});
        for (std::size_t p = 0; p < cut.values.size(); ++p) {
            const std::string_view name = entry().parameters[p].name;
            if (name == "loss") cut.values[p] = 0.9;
            if (name == "onset") cut.values[p] = 0.85;
            if (name == "duration") cut.values[p] = 0.1;
        }
        return cut;
    }

    // Seen: a notch from the top, `x_m` from the clamp.
    void notch(double x_m) {
        const Vector3d top(x_m, 0.02, 0.04);
        const ActiveEffect notch =
            with_crack(entry(), cut_at(top, 0.025), {top, -Vector3d::UnitZ(), Vector3d::UnitX(), 0.025});
        Simulator truth(*body_, nullptr, effects_);
        Eigen::VectorXd seen;
        ASSERT_TRUE(truth.simulate({{}, {notch}}, seen));
        pose(*body_, nullptr, effects_, {seen.begin(), seen.end()}, kNoise);
        ASSERT_TRUE(nominal_.usable);
        problem_->floor = {count(), 0.01 * count(), 0.0, 0.0};
    }
    // A ball of softened tissue, fitted from there.
    Cause softened_at(const Vector3d& centre_m, int iterations) {
        Cause cut;
        cut.entries = {effects_.find("cut")};
        return fitted_from(*problem_, nominal_, std::move(cut), {{}, {cut_at(centre_m, 0.01)}}, iterations);
    }

    // Places of the search grid; first order is for those near the far end.
    Screening screening_of_cuts() const {
        EffectScreening cuts;
        cuts.entry = effects_.find("cut");
        for (std::size_t c = 0; c < static_cast<std::size_t>(entry().info.num_candidates); ++c) {
            const Vector3d place = *centre_of(entry(), effects_.candidate(cuts.entry, c));
            const bool known = std::any_of(cuts.places.begin(), cuts.places.end(),
                                           [&](const PlaceGain& p) { return p.centre_m == place; });
            if (!known) cuts.places.push_back({place, place.x(), 0.0, {}, c});
        }
        std::stable_sort(cuts.places.begin(), cuts.places.end(),
                         [](const PlaceGain& a, const PlaceGain& b) { return a.score < b.score; });
        Screening screening;
        screening.effects.push_back(std::move(cuts));
        return screening;
    }

    const PlayerSettings settings_{};
    std::unique_ptr<Trajectory> body_ = *Trajectory::make(block(), settings_);
    EffectTable effects_{*body_, nullptr, {}};
};

// Every plane holds the way to the surface; beside one are three moves, two turns and another size, both ways.
TEST_F(Cracks, PlanesAreEnteredFromTheSurface) {
    const auto places = screening_of_cuts().effects.front().places;
    const auto planes = planes_near(*body_, effects_, cut_at({0.05, 0.02, 0.03}, 0.01), places);
    ASSERT_EQ(planes.size(), 6u * (1 + 10 + 4));
    EXPECT_TRUE(std::any_of(planes.begin(), planes.end(), [&](const CrackPlane& plane) {
        return plane.centre_m == places.back().centre_m;
    })) << "the best by first order, though it is far";
    EXPECT_EQ(planes.front().centre_m, Vector3d(0.05, 0.02, 0.03));
    EXPECT_LT((planes.front().inwards + Vector3d::UnitZ()).norm(), 1e-9) << "10 mm below a node of the top";
    for (const CrackPlane& plane : planes) {
        EXPECT_NEAR(plane.inwards.dot(plane.normal), 0.0, 1e-12);
        EXPECT_NEAR(plane.normal.norm(), 1.0, 1e-12);
    }
    EXPECT_NEAR(std::abs(planes[0].normal.dot(planes[1].normal)), std::cos(M_PI / 6.0), 1e-12);

    const auto beside = planes_beside(planes.front(), 0.5);
    ASSERT_EQ(beside.size(), 12u);
    for (const CrackPlane& plane : beside) {
        EXPECT_NEAR(plane.inwards.dot(plane.normal), 0.0, 1e-12);
        EXPECT_LE((plane.centre_m - planes.front().centre_m).norm(), 0.5 * planes.front().radius_m + 1e-12);
        EXPECT_GE(plane.normal.dot(planes.front().normal), std::cos(M_PI / 8.0) - 1e-12);
    }
}

TEST_F(Cracks, ANotchIsFoundFarFromWhereTissueSeemsToSoften) {
    ASSERT_NO_FATAL_FAILURE(notch(0.025));
    const Cause softer = softened_at({0.09, 0.02, 0.02}, 0);
    ASSERT_TRUE(softer.fit.usable);
    const Screening screening = screening_of_cuts();
    const std::vector<CrackPlane> near =
        planes_near(*body_, effects_, softer.fit.at.effects.front(), screening.effects.front().places);
    ASSERT_TRUE(std::none_of(near.begin(), near.end(), [](const CrackPlane& p) { return p.centre_m.x() < 0.05; }));
    std::vector<Cause> causes{softer};
    EXPECT_TRUE(look_for_cracks(*problem_, nominal_, screening, causes));
    const Cause& crack = causes.front();
    EXPECT_LT(crack.misfit, 0.3 * softer.misfit);
    EXPECT_LT(std::abs(centre_of(entry(), crack.fit.at.effects.front())->x() - 0.025), 0.012);
}

TEST_F(Cracks, ANotchIsFoundWhereTissueSeemsToSoften) {
    ASSERT_NO_FATAL_FAILURE(notch(0.05));
    const Cause softer = softened_at({0.06, 0.02, 0.02}, 8);
    ASSERT_TRUE(softer.fit.usable);
    ASSERT_GT(softer.misfit, 2.0 * count()) << "a softer ball is not it";
    Cause screened;
    screened.entries = {effects_.find("gravity")};
    screened.score = softer.score + 100.0;
    std::vector<Cause> causes{screened, softer};
    EXPECT_TRUE(look_for_cracks(*problem_, nominal_, screening_of_cuts(), causes));

    ASSERT_EQ(causes.size(), 2u) << "what was only screened says nothing";
    std::erase_if(causes, [](const Cause& c) { return !c.fit.usable; });
    const Cause& crack = causes.front();
    EXPECT_LT(crack.misfit, 0.2 * softer.misfit);
    EXPECT_GT(crack.search_cost, softer.search_cost) << "what was tried is paid for";
    const ActiveEffect& found = crack.fit.at.effects.front();
    const Vector3d normal(*value_of(entry(), found, "normal_x"), *value_of(entry(), found, "normal_y"),
                          *value_of(entry(), found, "normal_z"));
    EXPECT_GT(std::abs(normal.x()), std::cos(M_PI / 6.0)) << normal.transpose();
    EXPECT_LT(std::abs(centre_of(entry(), found)->x() - 0.05), 0.01);

    EXPECT_TRUE(crack_is_far_ahead(effects_, causes));
    Cause rival;
    rival.entries = {effects_.find("stiffness")};
    rival.score = crack.score - 1.0;
    EXPECT_FALSE(crack_is_far_ahead(effects_, {crack, rival}));
    EXPECT_FALSE(crack_is_far_ahead(effects_, {softer}));

    const std::vector<Cause> before = causes;
    EXPECT_FALSE(look_for_cracks(*problem_, nominal_, screening_of_cuts(), causes));
    EXPECT_EQ(causes.front().fit.at.effects, before.front().fit.at.effects) << "nothing is left to explain";
}

}  // namespace
}  // namespace teres
