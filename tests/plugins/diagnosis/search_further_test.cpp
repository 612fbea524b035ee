// Sets of several effects on a body whose motion is known in closed form.
#include "plugins/diagnosis/search_further.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/toy_body.h"

namespace teres {
namespace {

constexpr double kNoise = 3e-4;

// Softer, tilted and drawn by another tool, with inertia. A stiffening law beside the tilt stands in front of the
// modulus beside the tilt: the search goes on from that pair, finds the tool, and the true pair gets it as well.
TEST(SearchFurther, WithInertiaRivalsGetWhatTheBestSetGained) {
    test::ToyBody body;
    body.known_supports = body.inertia = true;
    using Toy = test::ToyBody;
    const std::vector<double> factor{0.6}, tilt{0.3, -0.2, 0.4}, pull{0.6, -0.5, 0.7, 0.06, 0.05, 0.0};
    const std::vector<double> observed = body.motion(
        {{}, std::vector<EffectInstance>{{Toy::kStiffness, factor}, {Toy::kGravity, tilt}, {Toy::kUnknownLoad, pull}}});
    const EffectTable effects(body, nullptr, {});
    Recording recording = *make_recording({"toy", &body, nullptr, observed, kNoise, 1});
    Simulator simulator(body, nullptr, effects);
    const DiagnosisOptions options;
    const auto count = static_cast<Eigen::Index>(recording.fit_rows.size());
    Problem problem{simulator,
                    recording,
                    options,
                    {},
                    Whitener(recording.fit_rows, Eigen::VectorXd::Constant(count, kNoise),
                             Eigen::MatrixXd(recording.observed.size(), 0))};
    problem.floor = {static_cast<double>(count), 0.3 * static_cast<double>(count)};
    const Fit nominal = problem.fit({}, 0);

    const std::size_t modulus = effects.find("stiffness"), law = effects.find("material_law"),
                      gravity = effects.find("gravity"), tool = effects.find("unknown_load");
    const auto fitted = [&](std::size_t first) {
        Cause pair;
        pair.entries = {first, gravity};
        const Assumption start{{}, {effects.candidate(first, 0), effects.candidate(gravity, 0)}};
        return fitted_from(problem, nominal, std::move(pair), start, 8);
    };
    std::vector<Cause> causes{fitted(law), fitted(modulus)};
    causes[0].score = 21.0;  // what a body that is loaded otherwise may make of them
    causes[1].score = 20.0;
    Screening screening;
    ASSERT_TRUE(search_further(problem, nominal, screening, causes));
    std::vector<std::size_t> best = causes.front().entries, truth{modulus, gravity, tool};
    std::sort(best.begin(), best.end());
    std::sort(truth.begin(), truth.end());
    EXPECT_EQ(best, truth);
    EXPECT_NEAR(causes.front().fit.at.effects.front().values[0], 0.6, 0.03);
}

}  // namespace
}  // namespace teres
