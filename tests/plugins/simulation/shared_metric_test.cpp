#include "plugins/simulation/shared_metric.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "plugins/simulation/case_model.h"
#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// A block that nothing holds but its inertia.
struct FreeBlock {
    FreeBlock() {
        Case c = test::clamped_block({.size_m = {0.10, 0.04, 0.04}, .cells = {8, 3, 3}, .poissons_ratio = 0.45});
        c.ligament = LigamentData{LigamentLaw::kNeoHookean, 50e3, 0.45, 0.02, 0.04, 0.0};
        for (const auto node : c.clamped) c.ligament_prior.push_back({node, 0.7});
        c.clamped.clear();
        model = *CaseModel::make(c, CaseModelSettings());
        model->system().parts().tethers.clear();
        model->system().resolve({}, {}, actions);
        inertia.coefficient = 1e3;
    }
    // K^-1 B with the tangent at x, in double precision.
    MatrixXd solve(const Positions& x, MatrixXd B) const {
        std::vector<double> values;
        Cholesky cholesky(model->system().pattern());
        int factorisations = 0;
        EXPECT_TRUE(model->system().tangent(actions, inertia, 0, theta.data(), x, values));
        EXPECT_TRUE(cholesky.factorise_shifted(values, factorisations));
        EXPECT_EQ(factorisations, 1);
        cholesky.solve(B);
        return B;
    }
    std::unique_ptr<CaseModel> model;
    ExternalActions actions;
    Inertia inertia;
    std::vector<double> theta = std::vector<double>(64, 1.0);
};

// The law is frame-indifferent: K(Q x) = Q K(x) Q^T, which a metric that turns with the body has without another
// factorisation.
TEST(SharedMetric, OfALaneOfItsOwnTurnsWithTheBody) {
    FreeBlock block;
    const MechanicalSystem& system = block.model->system();
    Positions x0 = system.parts().X;
    for (Eigen::Index i = 0; i < x0.cols(); ++i)
        x0.col(i) += 2e-3 * Eigen::Vector3d(std::sin(40.0 * x0(1, i)), std::cos(30.0 * x0(0, i)), x0(0, i));
    const Eigen::Matrix3d Q = Eigen::AngleAxisd(1.2, Eigen::Vector3d(0.3, -0.8, 0.5).normalized()).toRotationMatrix();
    const Positions x1 = (Q * x0).colwise() + Eigen::Vector3d(0.01, -0.02, 0.03);

    SharedMetric metric(system, 1);
    int factorisations = 0;
    ASSERT_TRUE(metric.read(block.actions, block.inertia, 0, block.theta.data(), x0));
    ASSERT_TRUE(metric.factorise(system.team(), factorisations));
    std::vector<double> batch(3 * system.num_nodes() * padded_lanes(1));
    for (std::size_t d = 0; d < 3 * system.num_nodes(); ++d)
        for (std::size_t l = 0; l < padded_lanes(1); ++l) batch[d * padded_lanes(1) + l] = x1.data()[d];
    metric.set_lanes(block.theta.data(), batch.data(), padded_lanes(1), 1);

    const VectorXd r = VectorXd::Random(system.pattern().num_rows());
    const std::size_t stride = MetricSolver::lane_stride(1);
    std::vector<float> y(metric.solver().num_storage_rows() * stride, 0.0f);
    for (std::size_t row = 0; row < metric.solver().num_rows(); ++row)
        y[row * stride] = static_cast<float>(r(metric.solver().free_row(row)));
    metric.solve(y.data(), 1, 1);
    metric.correct(y.data(), 1, 1);
    VectorXd turned(r.size());
    for (std::size_t row = 0; row < metric.solver().num_rows(); ++row)
        turned(metric.solver().free_row(row)) = static_cast<double>(y[row * stride]);
    EXPECT_LT((turned - block.solve(x1, r)).norm(), 1e-3 * turned.norm());
    EXPECT_GT((block.solve(x0, r) - block.solve(x1, r)).norm(), 0.3 * turned.norm());  // it did turn
}

}  // namespace
}  // namespace teres
