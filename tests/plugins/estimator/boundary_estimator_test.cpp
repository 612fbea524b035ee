#include "plugins/estimator/boundary_estimator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "plugins/estimator/probability.h"
#include "tests/support/spring_model.h"

using namespace teres;
using Eigen::VectorXd;
using test::SpringModel;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kSigma = 0.0003;

// A recording of the spring model with true stiffnesses that may change.
struct Recording {
    explicit Recording(unsigned seed = 1) : engine(seed) {}

    void observe(const std::vector<double>& theta, double force_n) {
        force.assign(3 * theta.size(), 0.0);
        for (std::size_t i = 0; i < theta.size(); ++i) force[3 * i + 1] = force_n;
        std::vector<double> X(3 * theta.size());
        ForwardInputs inputs;
        inputs.region_force_n = force;
        truth.advance(inputs, theta, X, 1);
        std::vector<double> Z(3 * truth.num_markers());
        truth.observe(X, Z, 1);
        id.clear(), x.clear(), y.clear(), z.clear();
        std::normal_distribution<double> noise(0.0, kSigma);
        for (std::size_t j = 0; j < truth.num_markers(); ++j) {
            id.push_back(truth.marker_id(j));
            x.push_back(Z[3 * j] + noise(engine));
            y.push_back(Z[3 * j + 1] + noise(engine));
            z.push_back(Z[3 * j + 2] + noise(engine));
        }
        sigma.assign(id.size(), kSigma);
        stamp_us += 100000;
    }
    MarkerFrame frame() const { return {stamp_us, id, x, y, z, sigma}; }
    ForwardInputs loads() const {
        ForwardInputs inputs;
        inputs.time_s = 1e-6 * static_cast<double>(stamp_us);
        inputs.region_force_n = force;
        return inputs;
    }

    SpringModel truth;
    std::mt19937 engine;
    std::int64_t stamp_us = 0;
    std::vector<double> force;
    std::vector<std::int32_t> id;
    std::vector<double> x, y, z, sigma;
};

BoundaryEstimatorOptions options_without_model_error() {
    BoundaryEstimatorOptions options;
    options.relative_model_error = 0.0;
    options.model_error_sigma_m = 0.0;
    options.walk.noise_per_sqrt_s = 0.02;
    return options;
}

double physical(const BoundaryEstimator& e, Eigen::Index i) {
    return e.parameters().to_physical(i, e.theta()(i));
}
double stdev(const BoundaryEstimator& e, Eigen::Index i) {
    return std::sqrt(e.covariance()(i, i));
}

}  // namespace

TEST(BoundaryEstimator, FindsStiffnessesWithinThreeSigma) {
    for (bool reduced_order : {true, false})
        for (SigmaPointKind points : {SigmaPointKind::kSimplex, SigmaPointKind::kStar}) {
            SpringModel model;
            BoundaryEstimatorOptions options = options_without_model_error();
            options.reduced_order = reduced_order;
            options.sigma_points = points;
            BoundaryEstimator e = BoundaryEstimator::make(model, options).value();
            Recording recording;
            const std::vector<double> truth{60.0, 900.0};
            for (int k = 1; k <= 50; ++k) {
                recording.observe(truth, 0.1 * k);
                EXPECT_EQ(e.step(recording.frame(), recording.loads()), FrameOutcome::kCorrected);
            }
            for (Eigen::Index i = 0; i < 2; ++i) {
                EXPECT_LT(std::abs(e.theta()(i) - std::log(truth[static_cast<std::size_t>(i)])), 3.0 * stdev(e, i));
                EXPECT_LT(stdev(e, i), 0.2);
                EXPECT_GT(e.observability()(i), 0.9);
            }
            // The state is the simulation's: u = F / (theta + kBed).
            EXPECT_NEAR(e.state()(1), 5.0 / 70.0, 1e-3);
            EXPECT_NEAR(e.state()(4), 5.0 / 910.0, 1e-3);
            EXPECT_EQ(e.counters().markers_gated, 0);
        }
}

TEST(BoundaryEstimator, FollowsALigamentThatLetsGoWithinAFewFrames) {
    SpringModel model;
    BoundaryEstimator e = BoundaryEstimator::make(model, options_without_model_error()).value();
    Recording recording;
    for (int k = 0; k < 100; ++k) {
        recording.observe({200.0, 200.0}, 4.0);
        e.step(recording.frame(), recording.loads());
    }
    ASSERT_NEAR(physical(e, 1), 200.0, 30.0);
    ASSERT_LT(stdev(e, 1), 0.1);
    int frames = 0;
    for (; frames < 20 && physical(e, 1) > 10.0; ++frames) {
        recording.observe({200.0, 1e-3}, 4.0);
        e.step(recording.frame(), recording.loads());
    }
    EXPECT_LE(frames, 8);
    EXPECT_GE(e.counters().reinflations, 1);
    EXPECT_GT(stdev(e, 1), 0.0);
    EXPECT_NEAR(physical(e, 0), 200.0, 40.0);
    std::vector<double> probability;
    e.attachment_probabilities(probability);
    EXPECT_GT(probability[0], 0.95);
    EXPECT_LT(probability[2], 0.05);
}

TEST(BoundaryEstimator, GrowsUnsureWithoutMarkersAndNeverLessSureThanThePrior) {
    SpringModel model;
    BoundaryEstimator e = BoundaryEstimator::make(model, options_without_model_error()).value();
    Recording recording;
    for (int k = 0; k < 30; ++k) {
        recording.observe({200.0, 200.0}, 4.0);
        e.step(recording.frame(), recording.loads());
    }
    const double before = stdev(e, 0), mean = e.theta()(0);
    for (int k = 0; k < 20; ++k) {
        recording.observe({200.0, 200.0}, 4.0);
        std::fill(recording.x.begin(), recording.x.end(), kNaN);
        EXPECT_EQ(e.step(recording.frame(), recording.loads()), FrameOutcome::kPredicted);
        EXPECT_EQ(e.degrees_of_freedom(), 0);
    }
    EXPECT_GT(stdev(e, 0), before);
    EXPECT_NEAR(e.theta()(0), mean, 1e-12);
    MarkerFrame late{recording.stamp_us + 1000000000000, {}, {}, {}, {}, {}};
    e.step(late, recording.loads());
    EXPECT_NEAR(stdev(e, 0), SpringModel::kLogStdev, 1e-9);
    EXPECT_EQ(e.observability()(0), 0.0);
}

TEST(BoundaryEstimator, IgnoresBadMarkersAndCountsThem) {
    SpringModel model;
    BoundaryEstimator e = BoundaryEstimator::make(model, options_without_model_error()).value();
    Recording recording;
    for (int k = 0; k < 30; ++k) {
        recording.observe({200.0, 200.0}, 4.0);
        recording.id.insert(recording.id.end(), {7777, 100});  // unknown, and one twice
        for (auto* axis : {&recording.x, &recording.y, &recording.z, &recording.sigma})
            axis->insert(axis->end(), {0.5, 0.5});
        if (k > 10) recording.y[3] += 0.05;  // a marker that slipped
        recording.y[1] = std::numeric_limits<double>::infinity();
        recording.sigma[2] = 0.0;  // not stated
        EXPECT_EQ(e.step(recording.frame(), recording.loads()), FrameOutcome::kCorrected);
    }
    EXPECT_EQ(e.counters().markers_unknown, 60);
    EXPECT_EQ(e.gate().use[1], MarkerUse::kMissing);
    EXPECT_EQ(e.gate().use[3], MarkerUse::kGated);
    EXPECT_NEAR(physical(e, 0), 200.0, 30.0);
    EXPECT_NEAR(physical(e, 1), 200.0, 30.0);
}

TEST(BoundaryEstimator, RefusesTimeThatGoesBackwards) {
    SpringModel model;
    BoundaryEstimator e = BoundaryEstimator::make(model, options_without_model_error()).value();
    Recording recording;
    recording.observe({200.0, 200.0}, 4.0);
    e.step(recording.frame(), recording.loads());
    const VectorXd theta = e.theta();
    const auto P = e.covariance();
    for (std::int64_t back : {0, 50000}) {
        MarkerFrame old = recording.frame();
        old.stamp_us -= back;
        EXPECT_EQ(e.step(old, recording.loads()), FrameOutcome::kRefused);
    }
    EXPECT_EQ(e.theta(), theta);
    EXPECT_EQ(e.covariance(), P);
    EXPECT_EQ(e.counters().frames_refused, 2);
}

TEST(BoundaryEstimator, KeepsTheLastGoodStateWhenTheModelFails) {
    SpringModel model;
    BoundaryEstimator e = BoundaryEstimator::make(model, options_without_model_error()).value();
    Recording recording;
    for (int k = 0; k < 10; ++k) {
        recording.observe({200.0, 200.0}, 4.0);
        e.step(recording.frame(), recording.loads());
    }
    const VectorXd theta = e.theta(), state = e.state();
    model.fail = true;
    recording.observe({200.0, 200.0}, 4.0);
    EXPECT_EQ(e.step(recording.frame(), recording.loads()), FrameOutcome::kNotSolved);
    model.fail = false;
    model.poison = true;
    recording.observe({200.0, 200.0}, 4.0);
    EXPECT_EQ(e.step(recording.frame(), recording.loads()), FrameOutcome::kNotSolved);
    EXPECT_EQ(e.theta(), theta);
    EXPECT_EQ(e.state(), state);
    EXPECT_EQ(e.counters().frames_not_solved, 2);
    model.poison = false;
    recording.observe({200.0, 200.0}, 4.0);
    EXPECT_EQ(e.step(recording.frame(), recording.loads()), FrameOutcome::kCorrected);
    EXPECT_NEAR(model.last_inputs_dt_s, 0.3, 1e-12);  // the mechanical state was two frames behind
    EXPECT_NEAR(physical(e, 0), 200.0, 40.0);
}

// Truth drawn from the prior, noise as stated: the errors must be as large as the filter says, no larger and
// no smaller.
TEST(BoundaryEstimator, SigmasAreHonest) {
    std::mt19937 engine(9);
    std::normal_distribution<double> normal;
    double sum = 0.0;
    const int runs = 150;
    for (int run = 0; run < runs; ++run) {
        SpringModel model;
        BoundaryEstimatorOptions options = options_without_model_error();
        options.walk.noise_per_sqrt_s = 0.0;
        BoundaryEstimator e = BoundaryEstimator::make(model, options).value();
        Recording recording(1000 + static_cast<unsigned>(run));
        VectorXd truth(2);
        for (double& t : truth) t = std::log(SpringModel::kMedian) + SpringModel::kLogStdev * normal(engine);
        for (int k = 1; k <= 20; ++k) {
            recording.observe({std::exp(truth(0)), std::exp(truth(1))},
                              0.01 * k);  // weak loads: the prior still counts
            e.step(recording.frame(), recording.loads());
        }
        const VectorXd error = truth - e.theta();
        sum += error.dot(e.covariance().inverse() * error);
    }
    // The model is nonlinear in the logarithm: 30 % beside the chi-square bounds.
    EXPECT_GT(sum, 0.7 * chi_square_quantile(0.001, 2.0 * runs));
    EXPECT_LT(sum, 1.3 * chi_square_quantile(0.999, 2.0 * runs));
}

// At the prior the attachment probability of a group whose prior says P(theta > threshold) = mean of its
// nodes is the atlas'.
TEST(BoundaryEstimator, AttachmentOfThePriorFollowsTheAtlas) {
    SpringModel model;
    BoundaryEstimator e = BoundaryEstimator::make(model, options_without_model_error()).value();
    std::vector<double> probability;
    e.attachment_probabilities(probability);
    EXPECT_EQ(e.attachment_nodes(), (std::vector<std::int32_t>{10, 11, 12, 13}));
    const double group =
        probit(normal_cdf(std::log(SpringModel::kMedian / SpringModel::kThreshold) / SpringModel::kLogStdev));
    EXPECT_NEAR(probability[0], normal_cdf(group + probit(0.6) - probit(0.75)), 1e-12);
    EXPECT_NEAR(probability[1], normal_cdf(group + probit(0.9) - probit(0.75)), 1e-12);
}

TEST(BoundaryEstimator, SameFramesGiveTheSameBits) {
    VectorXd first;
    for (int run = 0; run < 2; ++run) {
        SpringModel model;
        BoundaryEstimator e = BoundaryEstimator::make(model, {}).value();
        Recording recording(3);
        for (int k = 1; k <= 25; ++k) {
            recording.observe({60.0, 500.0}, 0.1 * k);
            e.step(recording.frame(), recording.loads());
        }
        if (run == 0) first = e.theta();
        EXPECT_EQ(e.theta(), first);
    }
}
