#include "plugins/estimator/parameter_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "plugins/estimator/ro_ukf.h"

using namespace teres;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

ParameterMap one(ParameterSpec spec) {
    spec.name = "k";
    return ParameterMap::make({spec}).value();
}

}  // namespace

TEST(ParameterMap, TransformsAreInverses) {
    const ParameterMap maps[] = {
        one({.transform = Transform::kNone, .median = 5.0, .stdev = 1.0}),
        one({.transform = Transform::kAbsolute, .median = 5.0, .stdev = 1.0}),
        one({.transform = Transform::kProject, .median = 5.0, .stdev = 1.0, .lower = 1.0, .upper = 90.0}),
        one({.transform = Transform::kSigmoid, .median = 5.0, .stdev = 1.0, .lower = 1.0, .upper = 90.0}),
        one({.transform = Transform::kLog, .median = 5.0, .stdev = 1.0})};
    for (const ParameterMap& map : maps)
        for (double v : {1.5, 5.0, 42.0, 80.0}) EXPECT_NEAR(map.to_physical(0, map.to_filter(0, v)), v, 1e-12 * v);
}

TEST(ParameterMap, PriorKeepsTheMedianAndTheSpread) {
    // Log-normal prior: the standard deviation of ln v is the filter's.
    const ParameterMap log = one({.transform = Transform::kLog, .median = 200.0, .log_stdev = 1.3});
    EXPECT_NEAR(log.to_physical(0, log.prior_mean()(0)), 200.0, 1e-10);
    EXPECT_EQ(log.prior_stdev()(0), 1.3);
    // Standard deviation in physical units: so is the standard deviation of the log-normal that comes out,
    // here by sampling.
    const ParameterMap stated = one({.transform = Transform::kLog, .median = 200.0, .stdev = 60.0});
    std::mt19937 engine(1);
    std::normal_distribution<double> normal(stated.prior_mean()(0), stated.prior_stdev()(0));
    double sum = 0.0, squares = 0.0;
    const int n = 400000;
    for (int i = 0; i < n; ++i) {
        const double v = std::exp(normal(engine));
        sum += v;
        squares += v * v;
    }
    EXPECT_NEAR(std::sqrt(squares / n - sum * sum / n / n), 60.0, 0.5);  // sampling error 0.1
    EXPECT_NEAR(stated.physical_stdev(0, stated.prior_mean()(0), stated.prior_stdev()(0)), 60.0, 1e-9);
    // The same prior through `none` and `project` keeps its standard deviation, also when it was stated as
    // log-normal.
    EXPECT_EQ(one({.transform = Transform::kNone, .median = 200.0, .stdev = 60.0}).prior_stdev()(0), 60.0);
    const ParameterMap projected =
        one({.transform = Transform::kProject, .median = 200.0, .log_stdev = stated.prior_stdev()(0), .lower = 0.0});
    EXPECT_NEAR(projected.prior_stdev()(0), 60.0, 1e-9);
}

TEST(ParameterMap, SigmoidPriorKeepsItsCentralInterval) {
    const ParameterMap map =
        one({.transform = Transform::kSigmoid, .median = 50.0, .stdev = 10.0, .lower = 0.0, .upper = 100.0});
    EXPECT_NEAR(map.to_physical(0, map.prior_mean()(0)), 50.0, 1e-10);
    EXPECT_NEAR(map.to_physical(0, map.prior_mean()(0) + map.prior_stdev()(0)), 60.0, 1e-10);
    EXPECT_NEAR(map.to_physical(0, map.prior_mean()(0) - map.prior_stdev()(0)), 40.0, 1e-10);
    EXPECT_NEAR(map.physical_stdev(0, map.prior_mean()(0), map.prior_stdev()(0)), 9.8, 0.3);
}

TEST(ParameterMap, BoundsActOnTheWayToTheModel) {
    const ParameterMap map =
        one({.transform = Transform::kLog, .median = 10.0, .log_stdev = 1.0, .lower = 1.0, .upper = 100.0});
    EXPECT_EQ(map.to_physical(0, 50.0), 100.0);
    EXPECT_EQ(map.to_physical(0, -50.0), 1.0);
    EXPECT_TRUE(
        std::isfinite(one({.transform = Transform::kLog, .median = 1.0, .log_stdev = 1.0}).to_physical(0, 1e9)));
    VectorXd mean(1);
    mean << std::log(1000.0);
    EXPECT_NEAR(map.bring_mean_inside(mean)(0), std::log(0.1), 1e-12);
    mean << std::log(20.0);
    EXPECT_EQ(map.bring_mean_inside(mean)(0), 0.0);
}

TEST(ParameterMap, ReadBackFollowsThePeersConvention) {
    MatrixXd Y(1, 3);
    Y << -5.0, 3.0, 200.0;
    MatrixXd clamped(1, 3), absolute(1, 3);
    clamped << 1.0, 3.0, 100.0;
    absolute << 5.0, 3.0, 200.0;
    EXPECT_EQ(
        one({.transform = Transform::kProject, .median = 2.0, .stdev = 1.0, .lower = 1.0, .upper = 100.0}).read_back(Y),
        clamped);
    EXPECT_EQ(one({.transform = Transform::kAbsolute, .median = 2.0, .stdev = 1.0}).read_back(Y), absolute);
    EXPECT_EQ(one({.transform = Transform::kLog, .median = 2.0, .stdev = 1.0}).read_back(Y), Y);
}

// A spring observed through its force k * 0.1 m. The truth sits below the lower bound until the estimate lies
// on it, then moves away: the estimate must follow, and the variance must never vanish.
TEST(ParameterMap, ParameterAtItsBoundIsNeverFrozen) {
    for (const ParameterSpec& spec :
         {ParameterSpec{.name = "k",
         .transform = Transform::kProject,
         .median = 200.0,
         .stdev = 40.0,
         .lower = 8.0,
         .upper = 1e5},
          ParameterSpec{
              .name = "k", .transform = Transform::kLog, .median = 200.0, .stdev = 40.0, .lower = 8.0, .upper = 1e5},
          ParameterSpec{.name = "k",
          .transform = Transform::kSigmoid,
          .median = 200.0,
          .stdev = 40.0,
          .lower = 8.0,
          .upper = 1e3}}) {
        const ParameterMap map = ParameterMap::make({spec}).value();
        RoUkf filter(VectorXd(0), map.prior_mean(), map.prior_covariance());
        const VectorXd Q = VectorXd::Constant(1, std::pow(0.1 * map.prior_stdev()(0), 2));
        double at_bound = 0.0, least_variance = 1e300;
        for (int step = 0; step < 400; ++step) {
            const double truth = step < 200 ? 0.0 : 150.0;
            filter.add_process_noise(Q.asDiagonal());
            const MatrixXd X = filter.sigma_points();
            filter.predict(X);
            const MatrixXd Z = 0.1 * map.to_physical(X);
            filter.correct(VectorXd::Constant(1, 0.1 * truth), Z, VectorXd::Constant(1, 0.25));
            filter.shift_parameters(map.bring_mean_inside(filter.theta()));
            least_variance = std::min(least_variance, filter.covariance()(0, 0));
            if (step == 199) at_bound = map.to_physical(0, filter.theta()(0));
        }
        EXPECT_LT(at_bound, 20.0) << static_cast<int>(spec.transform);
        EXPECT_NEAR(map.to_physical(0, filter.theta()(0)), 150.0, 10.0) << static_cast<int>(spec.transform);
        EXPECT_GT(least_variance, 0.5 * Q(0)) << static_cast<int>(spec.transform);
    }
}

TEST(ParameterMap, RejectsBadPriors) {
    const auto error = [](ParameterSpec spec) {
        spec.name = "ligament.r3";
        const auto map = ParameterMap::make({spec});
        return map ? std::string("accepted") : map.error().text;
    };
    EXPECT_THAT(error({.median = std::nan("")}), testing::HasSubstr("ligament.r3: prior median nan is not finite"));
    EXPECT_THAT(error({.median = 1.0}), testing::HasSubstr("no spread"));
    EXPECT_THAT(error({.median = -1.0, .stdev = 1.0}), testing::HasSubstr("-1 must be > 0"));
    EXPECT_THAT(error({.median = 1.0, .stdev = 1.0, .lower = 2.0, .upper = 3.0}),
                testing::HasSubstr("outside its bounds [2, 3]"));
    EXPECT_THAT(error({.median = 1.0, .stdev = 1.0, .lower = 3.0, .upper = 2.0}),
                testing::HasSubstr("[3, 2] are empty"));
    EXPECT_THAT(
        error({.transform = Transform::kSigmoid, .median = 1.0, .stdev = 1.0, .lower = 0.0, .upper = kInfinity}),
        testing::HasSubstr("finite bounds"));
    EXPECT_THAT(error({.median = 1.0, .log_stdev = -0.5}), testing::HasSubstr("-0.5 must be finite and >= 0"));
    EXPECT_FALSE(ParameterMap::make({}).has_value());
    EXPECT_THAT(parse_transform("square").error().text, testing::HasSubstr("'square' is not one of"));
}

// By hand, bounds [2, 12]: w = 10, y = 0 gives 10/2 - 2 = 3, y = 10 ln 3 gives 7.5 - 2 = 5.5; sigma is that
// of y.
TEST(ParameterMap, ScaledSigmoidIsThePeersOne) {
    ParameterSpec spec;
    spec.name = "E";
    spec.transform = Transform::kScaledSigmoid;
    spec.median = 5.5;
    spec.stdev = 4.0;
    spec.lower = 2.0;
    spec.upper = 12.0;
    const auto map = ParameterMap::make({spec});
    ASSERT_TRUE(map.has_value());
    EXPECT_NEAR(map->to_physical(0, 0.0), 3.0, 1e-12);
    EXPECT_NEAR(map->prior_mean()(0), 10.0 * std::log(3.0), 1e-12);
    EXPECT_EQ(map->prior_stdev()(0), 4.0);
    EXPECT_NEAR(map->to_physical(0, map->to_filter(0, 4.2)), 4.2, 1e-12);
}
