// The screening of candidates by first order, against dense algebra written out.
#include "plugins/diagnosis/screening.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "plugins/diagnosis/problem.h"
#include "tests/support/toy_body.h"

namespace teres {
namespace {

using Toy = test::ToyBody;
constexpr double kNoise = 3e-4;

// A tool comes half way: a course that the loads do not have.
class ScreeningOfATool : public ::testing::Test {
  protected:
    void SetUp() override {
        const std::vector<double> pull{0.3, -0.2, -0.7, 0.08, 0.03, 6.0};
        const std::vector<EffectInstance> tool{{Toy::kUnknownLoad, pull}};
        const std::vector<double> observed = body_.motion({{}, tool});
        recording_.emplace(*make_recording({"toy", &body_, nullptr, observed, kNoise, 1}));
        simulator_.emplace(body_, nullptr, effects_);
        problem_.emplace(Problem{
            *simulator_, *recording_, options_, {Eigen::MatrixXd(recording_->observed.size(), 0), {}, {}}, Whitener{}});
        problem_->discrepancy.remainder_m = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(body_.num_frames()));
        nominal_ = nominal_fit(*problem_, prior_median(body_));
        ASSERT_TRUE(nominal_.usable);
        signatures_ = signatures(*simulator_, nominal_, {}, {});
    }

    Screening screened(const MotionSpan* span, std::size_t frames) const {
        ErrorFloor floor = problem_->floor;
        if (span == nullptr) floor.model_beside = 0.0;
        return screen(*simulator_, signatures_, problem_->whitener, floor, span, nominal_, options_.calibration,
                      frames);
    }
    static const EffectScreening& of(const Screening& screening, std::size_t entry) {
        return *std::find_if(screening.effects.begin(), screening.effects.end(),
                             [&](const EffectScreening& e) { return e.entry == entry; });
    }

    Toy body_;
    const EffectTable effects_{body_, nullptr, {}};
    const DiagnosisOptions options_;
    std::optional<Recording> recording_;
    std::optional<Simulator> simulator_;
    std::optional<Problem> problem_;
    Fit nominal_;
    Signatures signatures_;
};

// Gravity has one candidate of three amplitudes a = (S + I)^-1 G^T V r, V = (I + J J^T)^-1; of V (r - G a) a part lies
// beside the span. Prices do not depend on how what is left is compared.
TEST_F(ScreeningOfATool, ComparesInsideAndBesideTheMotion) {
    const std::size_t gravity = effects_.find("gravity");
    const auto candidate = std::find_if(signatures_.candidates.begin(), signatures_.candidates.end(),
                                        [&](const auto& c) { return c.entry == gravity; });
    const Eigen::MatrixXd G = problem_->whitener(signatures_.changes.middleCols(candidate->first, candidate->count)),
                          &J = nominal_.J;
    const Eigen::Index n = J.rows();
    const Eigen::MatrixXd V = (Eigen::MatrixXd::Identity(n, n) + J * J.transpose()).inverse();
    const Eigen::VectorXd r = nominal_.residual + J * nominal_.u;
    const Eigen::Vector3d a = (G.transpose() * V * G + Eigen::Matrix3d::Identity()).ldlt().solve(G.transpose() * V * r);
    const auto left = [&](const Eigen::VectorXd& x) { return Left{x.dot(V * x), problem_->span->beside(V * x)}; };
    ErrorFloor together = problem_->floor;
    together.model_beside = 0.0;
    const auto gain = [&](const ErrorFloor& floor) {
        return 0.5 * options_.calibration.nu * (floor.log_above(left(r)) - floor.log_above(left(r - G * a)));
    };

    const EffectScreening split = of(screened(problem_->span.get(), body_.num_frames()), gravity),
                          joint = of(screened(nullptr, body_.num_frames()), gravity);
    ASSERT_EQ(split.num_candidates, 1U);
    EXPECT_NEAR(split.score - joint.score, gain(problem_->floor) - gain(together), 1e-6);
    EXPECT_GT(std::abs(split.score - joint.score), 0.1);
}

// What comes half way stands out by more where its course counts than where it is a part of all that is left.
TEST_F(ScreeningOfATool, ACourseOfItsOwnStandsOut) {
    const std::size_t tool = effects_.find("unknown_load"), modulus = effects_.find("stiffness");
    const auto lead = [&](const Screening& s) { return of(s, tool).score - of(s, modulus).score; };
    EXPECT_GT(lead(screened(problem_->span.get(), body_.num_frames())),
              lead(screened(nullptr, body_.num_frames())) + 5.0);
}

// Of the beginning alone inside and beside are not told apart: the span is that of the whole motion.
TEST_F(ScreeningOfATool, OfTheBeginningNothingIsToldApart) {
    const std::size_t gravity = effects_.find("gravity"), frames = body_.num_frames() / 3;
    EXPECT_EQ(of(screened(problem_->span.get(), frames), gravity).score, of(screened(nullptr, frames), gravity).score);
}

}  // namespace
}  // namespace teres
