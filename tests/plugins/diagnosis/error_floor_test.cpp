// What a hypothesis leaves when nothing is wrong, by hand.
#include "plugins/diagnosis/error_floor.h"

#include <gtest/gtest.h>

#include "plugins/diagnosis/problem.h"

namespace teres {
namespace {

constexpr Eigen::Index kRows = 90;
constexpr double kSigma = 5e-4, kNoise = 3e-4;
constexpr Calibration kCalibration{};  // nu 45: half of the 90 numbers count

// One column of `size` standard deviations on the first number.
class ErrorFloorOfOneColumn : public ::testing::Test {
  protected:
    ErrorFloor floor_of(double size, double slope, bool dynamic) {
        Discrepancy error;
        error.columns = Eigen::MatrixXd::Zero(kRows, 1);
        error.columns(0, 0) = size * kSigma;
        std::vector<Eigen::Index> rows(kRows);
        for (Eigen::Index k = 0; k < kRows; ++k) rows[static_cast<std::size_t>(k)] = k;
        const Whitener whitener =
            tempered_whitener(rows, Eigen::VectorXd::Constant(kRows, kSigma), error.columns, kCalibration);
        Eigen::MatrixXd J = Eigen::MatrixXd::Zero(kRows, 1);
        J(0, 0) = slope;
        return error_floor(whitener, error, J, kNoise, dynamic, kCalibration);
    }
    double of_body_ = kCalibration.model_error * static_cast<double>(kRows);
};

TEST_F(ErrorFloorOfOneColumn, IsTheStatedNoiseAndWhatRemainsOnAnyBody) {
    const ErrorFloor floor = floor_of(0.0, 0.0, false);
    EXPECT_NEAR(floor.noise, 90.0 * 0.36, 1e-9) << "(0.3 mm / 0.5 mm)^2 per number";
    EXPECT_NEAR(floor.model, of_body_, 1e-9);
}

TEST_F(ErrorFloorOfOneColumn, ExplainsLessWithAShareOfTheModelsError) {
    const ErrorFloor floor = floor_of(0.0, 0.0, false), half = floor.with_model(0.5);
    EXPECT_NEAR(half.total(), floor.noise + 0.5 * of_body_, 1e-9);
    EXPECT_TRUE(floor.explains(floor.noise + 0.9 * of_body_));
    EXPECT_FALSE(half.explains(floor.noise + 0.9 * of_body_));
    EXPECT_TRUE(half.explains(floor.noise + 0.4 * of_body_));
}

// However far other models are off in a direction that is known.
TEST_F(ErrorFloorOfOneColumn, GrowsByAShareOfTheColumn) {
    EXPECT_NEAR(floor_of(20.0, 0.0, false).model, of_body_ + 0.15 * 400.0, 1e-9);
    EXPECT_NEAR(floor_of(20.0, 0.0, true).model, of_body_ + 0.5 * 400.0, 1e-9) << "with inertia, a larger one";
}

TEST_F(ErrorFloorOfOneColumn, LigamentsTakeUpWhatTheyCan) {
    EXPECT_NEAR(floor_of(20.0, 3.0, false).model, of_body_ + 0.15 * 400.0 / (1.0 + 9.0), 1e-9);
}

}  // namespace
}  // namespace teres
