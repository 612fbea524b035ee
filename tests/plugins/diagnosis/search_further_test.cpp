// Sets of several effects on a body whose motion is known in closed form.
#include "plugins/diagnosis/search_further.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "tests/support/toy_body.h"

namespace teres {
namespace {

constexpr double kNoise = 3e-4;

// A softer, tilted plate whose motion goes on by inertia, as far as the search knows.
class SearchFurtherWithInertia : public ::testing::Test {
  protected:
    using Toy = test::ToyBody;

    /// Modulus 0.6 and a tilt, and `more`.
    void observe(std::vector<EffectInstance> more) {
        const std::vector<double> factor{0.6}, tilt{0.3, -0.2, 0.4};
        more.push_back({Toy::kStiffness, factor});
        more.push_back({Toy::kGravity, tilt});
        body_.known_supports = body_.inertia = true;
        const std::vector<double> observed = body_.motion({{}, more});
        recording_.emplace(*make_recording({"toy", &body_, nullptr, observed, kNoise, 1}));
        simulator_.emplace(body_, nullptr, effects_);
        const auto count = static_cast<Eigen::Index>(recording_->fit_rows.size());
        problem_.emplace(Problem{*simulator_,
                                 *recording_,
                                 options_,
                                 {},
                                 Whitener(recording_->fit_rows, Eigen::VectorXd::Constant(count, kNoise),
                                          Eigen::MatrixXd(recording_->observed.size(), 0))});
        problem_->floor = {static_cast<double>(count), 0.3 * static_cast<double>(count)};
        nominal_ = problem_->fit({}, 0);
    }

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

    /// Entries of the best set, and that its modulus is the true one.
    std::vector<std::size_t> best(std::vector<Cause> causes) {
        Screening screening;
        EXPECT_TRUE(search_further(*problem_, nominal_, screening, causes));
        std::vector<std::size_t> entries = causes.front().entries;
        for (std::size_t k = 0; k < entries.size(); ++k) {
            if (entries[k] == modulus_) {
                EXPECT_NEAR(causes.front().fit.at.effects[k].values[0], 0.6, 0.03);
            }
        }
        std::sort(entries.begin(), entries.end());
        return entries;
    }

    Toy body_;
    const EffectTable effects_{body_, nullptr, {}};
    const std::size_t modulus_ = effects_.find("stiffness"), law_ = effects_.find("material_law"),
                      gravity_ = effects_.find("gravity"), tool_ = effects_.find("unknown_load");
    const DiagnosisOptions options_;
    std::optional<Recording> recording_;
    std::optional<Simulator> simulator_;
    std::optional<Problem> problem_;
    Fit nominal_;
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

// What a tilt leaves is less than the model's error, so that nothing is searched on top of it: a shifted camera and a
// marker that slipped are tried together all the same.
TEST(SearchFurther, TwoSensorEffectsAreTriedTogether) {
    test::ToyBody body;
    test::ToyCamera camera;
    body.known_supports = true;
    const EffectTable effects(body, &camera, {});
    const std::vector<double> shift{0.004, -0.003, 0.005}, slip{0.03, -0.02, 0.02, 5.0, 3.0};
    const std::vector<double> truth = body.motion({{}, {}});
    std::vector<double> times, observed(truth.size());
    for (std::size_t f = 0; f < body.num_frames(); ++f) times.push_back(body.time_s(f));
    camera.observe(
        std::vector<EffectInstance>{{test::ToyCamera::kRegistration, shift}, {test::ToyCamera::kMarkerSlip, slip}},
        times, truth, observed);
    Recording recording = *make_recording({"toy", &body, &camera, observed, kNoise, 1});
    Simulator simulator(body, &camera, effects);
    const DiagnosisOptions options;
    const auto count = static_cast<Eigen::Index>(recording.fit_rows.size());
    Problem problem{simulator,
                    recording,
                    options,
                    {},
                    Whitener(recording.fit_rows, Eigen::VectorXd::Constant(count, kNoise),
                             Eigen::MatrixXd(recording.observed.size(), 0))};
    problem.discrepancy.columns.resize(recording.observed.size(), 0);
    const Fit nominal = problem.fit({}, 0);
    problem.floor = {static_cast<double>(count), nominal.cost};
    const std::size_t tilt = effects.find("gravity"), registration = effects.find("registration"),
                      marker_slip = effects.find("marker_slip");
    const auto fitted = [&](std::size_t entry, const ActiveEffect& start, double explained) {
        Cause cause;
        cause.entries = {entry};
        cause = fitted_from(problem, nominal, std::move(cause), {{}, {start}}, 8);
        cause.explained = explained;
        return cause;
    };
    std::vector<Cause> causes{fitted(tilt, effects.candidate(tilt, 0), 0.9),
                              fitted(registration, effects.candidate(registration, 0), 0.6),
                              fitted(marker_slip, {marker_slip, slip}, 0.6)};
    causes[0].score = 50.0;
    Screening screening;
    search_further(problem, nominal, screening, causes);
    const auto pair = std::find_if(causes.begin(), causes.end(), [](const Cause& c) { return c.entries.size() == 2; });
    ASSERT_NE(pair, causes.end());
    EXPECT_EQ(pair->entries[0] + pair->entries[1], registration + marker_slip);
    EXPECT_LT(pair->misfit, 1e-3 * nominal.misfit);
}

}  // namespace
}  // namespace teres
