// Sets of several effects on a body whose motion is known in closed form.
#include "plugins/diagnosis/search_further.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "tests/support/posed_problem.h"
#include "tests/support/toy_body.h"

namespace teres {
namespace {

constexpr double kNoise = 3e-4;

// A plate, seen or not, as a problem whose noise is white.
class SearchFurther : public ::testing::Test, protected test::PosedProblem {
  protected:
    using Toy = test::ToyBody;

    void pose(const std::vector<double>& observed, const EffectTable& effects, const ObservationModel* camera) {
        PosedProblem::pose(body_, camera, effects, observed, kNoise);
    }

    Toy body_;
};

// A plate that nothing but its own effects is looked for on.
class SearchFurtherWithoutSensors : public SearchFurther {
  protected:
    /// Fitted, with the score that a body which is loaded otherwise may make of it.
    Cause fitted(std::vector<std::size_t> entries, double score) {
        Cause cause;
        Assumption start;
        for (const std::size_t entry : entries) start.effects.push_back(effects_.candidate(entry, 0));
        cause.entries = std::move(entries);
        cause = fitted_from(*problem_, nominal_, std::move(cause), start, 8);
        cause.score = score;
        return cause;
    }

    /// Where the modulus is among the effects, it is the true one.
    void expect_modulus(const Cause& cause) const {
        for (const ActiveEffect& effect : cause.fit.at.effects)
            if (effect.entry == modulus_) {
                EXPECT_NEAR(effect.values[0], 0.6, 0.03);
            }
    }

    const EffectTable effects_{body_, nullptr, {}};
    const std::size_t modulus_ = effects_.find("stiffness"), law_ = effects_.find("material_law"),
                      gravity_ = effects_.find("gravity"), tool_ = effects_.find("unknown_load");
};

// A softer, tilted plate whose motion goes on by inertia, as far as the search knows.
class SearchFurtherWithInertia : public SearchFurtherWithoutSensors {
  protected:
    /// Modulus 0.6 and a tilt, and `more`.
    void observe(std::vector<EffectInstance> more) {
        const std::vector<double> factor{0.6}, tilt{0.3, -0.2, 0.4};
        more.push_back({Toy::kStiffness, factor});
        more.push_back({Toy::kGravity, tilt});
        body_.known_supports = body_.inertia = true;
        pose(body_.motion({{}, more}), effects_, nullptr);
        problem_->floor = {count(), 0.3 * count()};
    }

    /// Entries of the best set, and that its modulus is the true one.
    std::vector<std::size_t> best(std::vector<Cause> causes) {
        Screening screening;
        EXPECT_TRUE(search_further(*problem_, nominal_, screening, causes));
        std::vector<std::size_t> entries = causes.front().entries;
        expect_modulus(causes.front());
        std::sort(entries.begin(), entries.end());
        return entries;
    }
};

// Drawn by another tool as well. A stiffening law beside the tilt stands in front of the modulus beside the tilt: the
// search goes on from that pair, finds the tool, and the true pair gets it as well.
TEST_F(SearchFurtherWithInertia, RivalsOfAPairGetWhatItGained) {
    const std::vector<double> pull{0.6, -0.5, 0.7, 0.06, 0.05, 0.0};
    observe({{Toy::kUnknownLoad, pull}});
    EXPECT_EQ(best({fitted({law_, gravity_}, 21.0), fitted({modulus_, gravity_}, 20.0)}),
              (std::vector<std::size_t>{modulus_, gravity_, tool_}));
}

// The law and a tool stand in front of the modulus: only the tilt that was found beside one of them makes the true
// pair.
TEST_F(SearchFurtherWithInertia, RivalsOfASingleEffectGetWhatItGained) {
    observe({});
    EXPECT_EQ(best({fitted({law_}, 21.0), fitted({tool_}, 20.0), fitted({modulus_}, 19.0)}),
              (std::vector<std::size_t>{modulus_, gravity_}));
}

// The law and the modulus are of one family: after the law the search goes on from the tool, though it is behind.
TEST_F(SearchFurtherWithInertia, TheSearchGoesOnFromAnotherFamily) {
    const std::vector<double> pull{0.6, -0.5, 0.7, 0.06, 0.05, 0.0};
    observe({{Toy::kUnknownLoad, pull}});
    std::vector<Cause> causes{fitted({law_}, 21.0), fitted({modulus_}, 20.0), fitted({tool_}, 15.0)};
    Screening screening;
    EXPECT_TRUE(search_further(*problem_, nominal_, screening, causes));
    const auto begins_with = [&](std::size_t entry) {
        return std::count_if(causes.begin(), causes.end(),
                             [&](const Cause& c) { return c.entries.size() == 2 && c.entries.front() == entry; });
    };
    EXPECT_GT(begins_with(tool_), 0);
    EXPECT_EQ(begins_with(modulus_), 0);
}

// A softer, tilted plate without inertia, on which the law and the tilt leave no more than the model may be off.
class SearchFurtherOnSoftPlate : public SearchFurtherWithoutSensors {
  protected:
    SearchFurtherOnSoftPlate() {
        body_.known_supports = true;
        const std::vector<EffectInstance> truth{{Toy::kStiffness, soft_}, {Toy::kGravity, tilt_}};
        pose(body_.motion({{}, truth}), effects_, nullptr);
    }
    /// The model may be off by so many times what the law and the tilt leave.
    void expect_of_law_and_tilt(double times) {
        problem_->floor = {count(), 1e-3 * nominal_.misfit};
        problem_->floor.model = times * fitted({law_, gravity_}, 0.0).fit.compared_cost();
    }
    /// The pair as the search found it, its effects in any order; or null.
    static const Cause* found(const std::vector<Cause>& causes, std::size_t a, std::size_t b) {
        const auto at = std::find_if(causes.begin(), causes.end(), [&](const Cause& c) {
            return c.entries == std::vector{a, b} || c.entries == std::vector{b, a};
        });
        return at != causes.end() ? &*at : nullptr;
    }

    const std::vector<double> soft_{0.6}, tilt_{0.3, -0.2, 0.4};
};

// The search ends with them. The modulus alone is hardly behind the law alone and gets the tilt as well; what is far
// behind does not.
TEST_F(SearchFurtherOnSoftPlate, WhatIsCloseBehindTheBestGetsWhatThatGained) {
    expect_of_law_and_tilt(1.4);
    for (const double behind : {1.0, 9.0}) {
        std::vector<Cause> causes{fitted({law_}, 4.0), fitted({modulus_}, 4.0 - behind)};
        Screening screening;
        ASSERT_TRUE(search_further(*problem_, nominal_, screening, causes));
        const Cause* pair = found(causes, modulus_, gravity_);
        ASSERT_EQ(pair != nullptr, behind < 5.0);
        if (pair != nullptr) {
            expect_modulus(*pair);
            EXPECT_GT(pair->score, 4.0);
        }
    }
}

// Beside noise of 1 per number both leave 2 of what the model may be off by: of 3.3 that is more than right causes
// leave, and the law is exchanged beside the tilt; of 4.2 it is not.
TEST_F(SearchFurtherOnSoftPlate, WhatLeavesMoreThanRightCausesIsExchanged) {
    for (const double times : {1.1, 1.4}) {
        expect_of_law_and_tilt(times);
        std::vector<Cause> causes{fitted({law_}, 4.0)};
        Screening screening;
        ASSERT_TRUE(search_further(*problem_, nominal_, screening, causes));
        ASSERT_NE(found(causes, law_, gravity_), nullptr);
        const Cause* pair = found(causes, modulus_, gravity_);
        ASSERT_EQ(pair != nullptr, times < 1.2);
        if (pair != nullptr) {
            expect_modulus(*pair);
            EXPECT_GT(pair->score, found(causes, law_, gravity_)->score);
        }
    }
}

// A tilted plate that another tool pulls at. The law, named first, is never quite the catalogue's, the tilt is: what
// the tool explains beside the law is not worth more beside the tilt for that.
TEST_F(SearchFurther, WhatOtherFormsExplainIsNoEvidenceBesideARivalEither) {
    const EffectTable effects(body_, nullptr, {});
    const std::size_t law = effects.find("material_law"), gravity = effects.find("gravity"),
                      tool = effects.find("unknown_load");
    const std::vector<double> tilt{0.1, -0.08, 0.1}, pull{0.9, -0.8, 1.0, 0.06, 0.05, 0.0};
    body_.known_supports = true;
    pose(body_.motion({{}, std::vector<EffectInstance>{{Toy::kGravity, tilt}, {Toy::kUnknownLoad, pull}}}), effects,
         nullptr);
    problem_->floor = {count(), 1e-3 * nominal_.misfit};
    std::vector<Cause> causes;
    for (const std::size_t entry : {law, gravity}) {
        Cause cause;
        cause.entries = {entry};
        causes.push_back(fitted_from(*problem_, nominal_, std::move(cause), {{}, {effects.candidate(entry, 0)}}, 8));
        causes.back().score = entry == law ? 4.0 : 3.0;
    }
    Screening screening;
    ASSERT_TRUE(search_further(*problem_, nominal_, screening, causes));
    const auto form_nats = [&](std::size_t first) {
        const auto found = std::find_if(causes.begin(), causes.end(), [&](const Cause& c) {
            return c.entries == std::vector<std::size_t>{first, tool};
        });
        return found != causes.end() ? found->form_nats : -1.0;
    };
    EXPECT_GT(form_nats(law), 1.0);
    EXPECT_DOUBLE_EQ(form_nats(gravity), form_nats(law));
}

// A softer plate that another tool pulls at from 6 s on. Beside the modulus, which may be off by 5 % of what it
// explains as other forms of it explain half of what it leaves, what the tool explains is worth more if it comes later
// than if it had always been there: nothing of it can be an error of the modulus' form before.
TEST_F(SearchFurther, WhatComesLaterIsNoErrorOfFormOfWhatWasThere) {
    const EffectTable effects(body_, nullptr, {});
    const std::size_t modulus = effects.find("stiffness"), tool = effects.find("unknown_load");
    const std::vector<double> soft{0.6}, pull{0.2, -0.15, 0.2, 0.06, 0.05, 6.0};
    body_.known_supports = true;
    const std::vector<EffectInstance> truth{{Toy::kStiffness, soft}, {Toy::kUnknownLoad, pull}};
    pose(body_.motion({{}, truth}), effects, nullptr);
    problem_->floor = {0.0, 1e-3 * nominal_.misfit};
    Cause alone, both;
    alone.entries = {modulus};
    alone = fitted_from(*problem_, nominal_, std::move(alone), {{}, {effects.candidate(modulus, 0)}}, 8);
    both.entries = {modulus, tool};
    both = fitted_from(*problem_, nominal_, std::move(both), {{}, {effects.candidate(modulus, 0), {tool, pull}}}, 8);
    ASSERT_LT(both.misfit, 0.2 * alone.misfit);
    const Base base{alone, problem_->whitener, alone.fit, {0.5 * alone.fit.compared_cost()}};
    const auto score_from = [&](double onset_s) {
        Cause cause = both;
        cause.fit.at.effects.back().values[5] = onset_s;
        score(*problem_, nominal_, &base, cause);
        return cause.score;
    };
    const double of_price = problem_->options.calibration.further_mechanical;
    EXPECT_GT(score_from(6.0), score_from(0.0) + of_price + 1.0);
    // Nor does what was no evidence for those before become some with one more.
    const double before = score_from(0.0);
    alone.form_nats = 4.0;
    EXPECT_NEAR(score_from(0.0), before - 4.0, 1e-9);
}

// A modulus that explains six tenths may leave a twentieth of that, but no more than other forms of it explain of what
// it leaves.
TEST_F(SearchFurther, WhatOtherFormsDoNotExplainIsNoErrorOfForm) {
    const EffectTable effects(body_, nullptr, {});
    const std::vector<double> soft{0.6};
    body_.known_supports = true;
    pose(body_.motion({{}, std::vector<EffectInstance>{{Toy::kStiffness, soft}}}), effects, nullptr);
    Cause modulus;
    modulus.entries = {effects.find("stiffness")};
    modulus.fit.cost = modulus.misfit = 40.0;
    nominal_.cost = 100.0;
    const auto error = [&](double by_other_forms) {
        const Base base{modulus, problem_->whitener, modulus.fit, {40.0 - by_other_forms}};
        return untold_form_error(*problem_, nominal_, base).cost;
    };
    EXPECT_DOUBLE_EQ(error(0.0), 0.0);
    EXPECT_DOUBLE_EQ(error(1.0), 1.0);
    EXPECT_DOUBLE_EQ(error(20.0), 0.05 * 60.0);
}

// A plate in front of a shifted camera, and markers that slip; what a tilt leaves is less than the model's error.
class SearchFurtherWithinFloor : public SearchFurther {
  protected:
    void observe(const std::vector<EffectInstance>& mechanics, const std::vector<EffectInstance>& sensors) {
        body_.known_supports = true;
        const std::vector<double> truth = body_.motion({{}, mechanics});
        std::vector<double> times, observed(truth.size());
        for (std::size_t f = 0; f < body_.num_frames(); ++f) times.push_back(body_.time_s(f));
        camera_.observe(sensors, times, truth, observed);
        pose(observed, effects_, &camera_);
    }
    Cause fitted(std::size_t entry, const ActiveEffect& start, double explained) {
        Cause cause;
        cause.entries = {entry};
        cause = fitted_from(*problem_, nominal_, std::move(cause), {{}, {start}}, 8);
        cause.explained = explained;
        return cause;
    }
    /// The first set of two.
    const Cause* pair(std::vector<Cause>& causes) {
        Screening screening;
        search_further(*problem_, nominal_, screening, causes);
        const auto found =
            std::find_if(causes.begin(), causes.end(), [](const Cause& c) { return c.entries.size() == 2; });
        return found != causes.end() ? &*found : nullptr;
    }

    test::ToyCamera camera_;
    const EffectTable effects_{body_, &camera_, {}};
    const std::size_t tilt_ = effects_.find("gravity"), registration_ = effects_.find("registration"),
                      marker_slip_ = effects_.find("marker_slip");
};

// Nothing is searched on top of the tilt: shift and slip are tried together all the same.
TEST_F(SearchFurtherWithinFloor, TwoSensorEffectsAreTriedTogether) {
    const std::vector<double> shift{0.004, -0.003, 0.005}, slip{0.03, -0.02, 0.02, 5.0, 3.0};
    observe({}, {{test::ToyCamera::kRegistration, shift}, {test::ToyCamera::kMarkerSlip, slip}});
    problem_->floor = {count(), nominal_.cost};
    std::vector<Cause> causes{fitted(tilt_, effects_.candidate(tilt_, 0), 0.9),
                              fitted(registration_, effects_.candidate(registration_, 0), 0.6),
                              fitted(marker_slip_, {marker_slip_, slip}, 0.6)};
    causes[0].score = 50.0;
    const Cause* found = pair(causes);
    ASSERT_NE(found, nullptr);
    EXPECT_EQ(found->entries[0] + found->entries[1], registration_ + marker_slip_);
    EXPECT_LT(found->misfit, 1e-3 * nominal_.misfit);
}

// A tilt of 13 prior deviations stands for a smaller one and a shift: the camera is tried beside it. Beside one of a
// usual size it is not.
TEST_F(SearchFurtherWithinFloor, ASensorIsTriedBesideWhatIsHardlyEverSoLarge) {
    for (const double newton : {5.0, 0.6}) {
        const std::vector<double> tilt{newton, -0.5 * newton, 0.6 * newton}, shift{0.001, 0.001, -0.001};
        observe({{test::ToyBody::kGravity, tilt}}, {{test::ToyCamera::kRegistration, shift}});
        problem_->floor = {count(), 1.0};
        Cause alone = fitted(tilt_, {tilt_, tilt}, 0.9);
        problem_->floor.model = 1.1 * alone.fit.cost;
        ASSERT_TRUE(problem_->floor.explains(left_of(alone.fit)));
        score(*problem_, nominal_, nullptr, alone);
        std::vector<Cause> causes{alone};
        const Cause* found = pair(causes);
        ASSERT_EQ(found != nullptr, newton > 1.0) << newton;
        if (found != nullptr) {
            EXPECT_EQ(found->entries, (std::vector<std::size_t>{tilt_, registration_}));
        }
    }
}

// A modulus that was not fitted to the end and a tilt of which nothing is there: what the pair leaves the modulus alone
// leaves, too. Of a tilt that is there nothing is taken back.
TEST_F(SearchFurther, WhatIsHardlyThereIsTakenBack) {
    const EffectTable effects(body_, nullptr, {});
    const std::vector<double> soft{0.6};
    body_.known_supports = true;
    const std::vector<EffectInstance> truth{{Toy::kStiffness, soft}};
    pose(body_.motion({{}, truth}), effects, nullptr);
    problem_->floor = {count(), 0.3 * count()};
    const std::size_t stiffness = effects.find("stiffness"), gravity = effects.find("gravity");
    ActiveEffect modulus = effects.candidate(stiffness, 0), tilt = effects.candidate(gravity, 0);
    const auto fitted = [&](std::vector<ActiveEffect> at) {
        Cause cause;
        for (const ActiveEffect& effect : at) cause.entries.push_back(effect.entry);
        cause.fit = problem_->fit({{}, std::move(at)}, 0);
        return cause;
    };
    modulus.values = {0.8};
    const Cause known = fitted({modulus});
    modulus.values = {0.6};
    tilt.values = {0.0, 0.0, 1e-6};
    const auto better = without_trace(*problem_, nominal_, known, fitted({modulus, tilt}));
    ASSERT_TRUE(better);
    EXPECT_EQ(better->entries, known.entries);
    EXPECT_NEAR(better->fit.at.effects[0].values[0], 0.6, 1e-3);
    EXPECT_LT(better->misfit, 0.1 * known.fit.misfit);
    tilt.values = {0.0, 0.0, 0.4};
    EXPECT_FALSE(without_trace(*problem_, nominal_, known, fitted({modulus, tilt})));
}

// A softer plate at which another tool pulls that wavers by 15 %: the pair leaves that, and another form of the pull
// would not. What leaves no more than noise and model error explain needs no other form.
TEST_F(SearchFurther, WhatOtherFormsOfAPairExplainIsTold) {
    const EffectTable effects(body_, nullptr, {});
    const std::vector<double> soft{0.6}, pull{0.9, -0.8, 1.0, 0.06, 0.05, 0.0};
    body_.known_supports = true;
    const std::vector<EffectInstance> modulus{{Toy::kStiffness, soft}},
        both{{Toy::kStiffness, soft}, {Toy::kUnknownLoad, pull}};
    std::vector<double> observed = body_.motion({{}, both});
    const std::vector<double> without = body_.motion({{}, modulus});
    const std::size_t channels = 3 * test::kToyMarkers;
    for (std::size_t row = 0; row < observed.size(); ++row)
        observed[row] += 0.15 * std::cos(std::numbers::pi * static_cast<double>(row / channels) / test::kToyFrames) *
                         (observed[row] - without[row]);
    pose(observed, effects, nullptr);
    problem_->floor = {count(), 1e-4 * nominal_.misfit};
    Cause pair;
    pair.entries = {effects.find("stiffness"), effects.find("unknown_load")};
    pair =
        fitted_from(*problem_, nominal_, std::move(pair), {{}, {{pair.entries[0], soft}, {pair.entries[1], pull}}}, 8);
    ASSERT_TRUE(pair.fit.usable);
    for (const bool enough : {true, false}) {
        problem_->floor.model = (enough ? 1.1 : 0.01) * pair.fit.compared_cost();
        problem_->floor.noise = 0.0;
        std::vector<Cause> causes{pair};
        causes.front().score = 1.0;
        weigh_forms(*problem_, nominal_, causes);
        ASSERT_EQ(causes.front().misfit_beside_forms.has_value(), !enough);
        if (!enough) {
            EXPECT_LT(*causes.front().misfit_beside_forms, 0.3 * pair.misfit);
        }
    }
}

}  // namespace
}  // namespace teres
