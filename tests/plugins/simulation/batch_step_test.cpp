// The fast path of the batch step against the plain one: every lane alone, full Newton, direct solves.
#include <gtest/gtest.h>
#include <malloc.h>

#include <Eigen/Dense>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <new>

#include "plugins/simulation/case_model.h"
#include "plugins/simulation/cholesky.h"
#include "plugins/simulation/metric_solver.h"
#include "tests/support/synthetic_case.h"

namespace {
std::atomic<long> g_allocations{0};
}  // namespace

// Counts every allocation of the program (the compiler cannot know that new and delete are both ours).
#pragma GCC diagnostic ignored "-Wmismatched-new-delete"
void* operator new(std::size_t size) {
    ++g_allocations;
    if (void* p = std::malloc(size)) return p;
    throw std::bad_alloc();
}
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
    return std::malloc(size);
}
void operator delete(void* p) noexcept {
    std::free(p);
}
void operator delete(void* p, std::size_t) noexcept {
    std::free(p);
}

namespace teres {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kLanes = 9;

Case hanging_block(LigamentLaw law) {
    Case c = test::clamped_block({.size_m = {0.125, 0.08, 0.06}, .cells = {8, 5, 4}, .poissons_ratio = 0.49});
    c.ligament = LigamentData{law, 80e3, 0.48, 0.025, 0.02, 0.0};
    const std::vector<std::int32_t> face = c.clamped;
    c.clamped.assign(face.begin(),
                     face.begin() + 9);  // a corner stays clamped, the rest hangs on the ligament
    for (std::size_t i = 9; i < face.size(); ++i) c.ligament_prior.push_back({face[i], 0.7});
    return c;
}

struct Sequence {
    std::unique_ptr<CaseModel> model;
    MatrixXd theta, X;
    int lanes_not_converged = 0, factorisations = 0;

    Sequence(LigamentLaw law, const CaseModelSettings& settings, std::size_t lanes = kLanes) {
        model = *CaseModel::make(hanging_block(law), settings);
        const auto p = static_cast<Eigen::Index>(model->num_parameters());
        theta.resize(p, static_cast<Eigen::Index>(lanes));
        for (Eigen::Index i = 0; i < p; ++i)
            for (Eigen::Index l = 0; l < theta.cols(); ++l)
                theta(i, l) = model->parameter(static_cast<std::size_t>(i)).prior_median *
                              std::exp(0.8 * std::sin(1.0 + 3.0 * static_cast<double>(i + 2 * l)));
        VectorXd x(static_cast<Eigen::Index>(model->num_state()));
        model->rest_state({x.data(), model->num_state()});
        X = x.replicate(1, theta.cols());
    }
    void step(int k) {
        const double t = k / 30.0, pull = 0.2 + 0.1 * std::sin(2.0 * t);
        const double force[3] = {0.5 * pull, 0.3 * pull, -pull};
        const ForwardReport r =
            model->advance({t, 1.0 / 30.0, force, {}}, {theta.data(), static_cast<std::size_t>(theta.size())},
                           {X.data(), static_cast<std::size_t>(X.size())}, static_cast<std::size_t>(X.cols()));
        lanes_not_converged += r.lanes - r.lanes_converged;
        factorisations += r.factorisations;
    }
};

CaseModelSettings settings_with(double residual, int threads) {
    CaseModelSettings s;
    s.max_lanes = kLanes;
    s.threads = threads;
    s.ligament.num_groups = 4;
    s.equilibrium.relative_residual = residual;
    return s;
}

class BatchStep : public ::testing::TestWithParam<LigamentLaw> {};

TEST_P(BatchStep, EqualsThePlainPath) {
    CaseModelSettings plain = settings_with(1e-9, 1);
    plain.equilibrium.plain_newton = true;
    Sequence fast(GetParam(), settings_with(1e-9, 2)), reference(GetParam(), plain);
    const MatrixXd rest = fast.X;
    for (int k = 1; k <= 8; ++k) {
        fast.step(k);
        reference.step(k);
    }
    EXPECT_EQ(fast.lanes_not_converged, 0);
    EXPECT_EQ(reference.lanes_not_converged, 0);
    const double motion = (reference.X - rest).cwiseAbs().maxCoeff();
    EXPECT_GT(motion, 1e-3);
    EXPECT_LT((fast.X - reference.X).cwiseAbs().maxCoeff(), 1e-6 * motion);
}

TEST_P(BatchStep, SameInputSameBits) {
    CaseModelSettings s = settings_with(1e-6, 2);
    s.equilibrium.renew_after = 0;  // renewals in the background all the time
    s.equilibrium.renewal_steps = 3;
    Sequence a(GetParam(), s), b(GetParam(), s);
    for (int k = 1; k <= 20; ++k) {
        a.step(k);
        b.step(k);
        ASSERT_EQ(std::memcmp(a.X.data(), b.X.data(), sizeof(double) * static_cast<std::size_t>(a.X.size())), 0)
            << "step " << k;
    }
    EXPECT_GT(a.factorisations, 3);
}

TEST_P(BatchStep, NumberOfThreadsChangesOnlyRounding) {
    Sequence one(GetParam(), settings_with(1e-10, 1)), three(GetParam(), settings_with(1e-10, 3));
    const MatrixXd rest = one.X;
    for (int k = 1; k <= 8; ++k) {
        one.step(k);
        three.step(k);
    }
    EXPECT_LT((one.X - three.X).cwiseAbs().maxCoeff(), 1e-7 * (one.X - rest).cwiseAbs().maxCoeff());
}

// A step that factorises nothing allocates nothing; a factorisation takes CHOLMOD's bounded workspace.
TEST_P(BatchStep, AllocatesNothingAfterWarmUp) {
    CaseModelSettings s = settings_with(1e-5, 2);
    s.equilibrium.renewal_steps = 0;
    Sequence run(GetParam(), s);
    for (int k = 1; k <= 20; ++k) run.step(k);
    MatrixXd Z(static_cast<Eigen::Index>(3 * run.model->num_markers()), run.X.cols());
    int quiet_steps = 0;
    for (int k = 21; k <= 60; ++k) {
        run.factorisations = 0;
        const long before = g_allocations;
        const auto bytes_before = mallinfo2().uordblks;
        run.step(k);
        run.model->observe({run.X.data(), static_cast<std::size_t>(run.X.size())},
                           {Z.data(), static_cast<std::size_t>(Z.size())}, static_cast<std::size_t>(run.X.cols()));
        if (run.factorisations > 0) continue;
        ++quiet_steps;
        EXPECT_EQ(g_allocations - before, 0) << "step " << k;
        EXPECT_EQ(mallinfo2().uordblks, bytes_before) << "step " << k;
    }
    EXPECT_GE(quiet_steps, 10);
}

INSTANTIATE_TEST_SUITE_P(Ligaments, BatchStep, ::testing::Values(LigamentLaw::kNeoHookean, LigamentLaw::kCubicSpring),
                         [](const auto& ligament) {
                             return ligament.param == LigamentLaw::kNeoHookean ? "band" : "cubic_springs";
                         });

TEST(MetricSolver, EqualsTheDoublePrecisionSolve) {
    Sequence run(LigamentLaw::kNeoHookean, settings_with(1e-6, 1));
    const MechanicalSystem& system = run.model->system();
    ExternalActions actions;
    system.resolve({}, {}, actions);
    std::vector<double> values;
    ASSERT_TRUE(system.tangent(actions, {}, 0, run.theta.data(), system.parts().X, values));
    Cholesky cholesky(system.pattern());
    ASSERT_TRUE(cholesky.factorise(values));
    for (const int threads : {1, 2, 3})
        for (const std::size_t lanes : {1u, 4u, 5u, 9u, 16u, 17u}) {
            TaskTeam team(threads);
            MetricSolver metric(cholesky, threads);
            metric.renew(cholesky);
            ASSERT_EQ(metric.num_rows(), static_cast<std::size_t>(system.pattern().num_rows()));
            const std::size_t stride = MetricSolver::lane_stride(lanes);
            MatrixXd B = MatrixXd::Random(system.pattern().num_rows(), static_cast<Eigen::Index>(lanes));
            std::vector<float> y(metric.num_storage_rows() * stride, 0.0f);
            for (std::size_t r = 0; r < metric.num_rows(); ++r)
                for (std::size_t l = 0; l < lanes; ++l)
                    y[r * stride + l] = static_cast<float>(B(metric.free_row(r), static_cast<Eigen::Index>(l)));
            metric.solve(y.data(), lanes, team);
            cholesky.solve(B);
            double error = 0.0;
            for (std::size_t r = 0; r < metric.num_rows(); ++r)
                for (std::size_t l = 0; l < lanes; ++l)
                    error = std::max(error, std::abs(static_cast<double>(y[r * stride + l]) -
                                                     B(metric.free_row(r), static_cast<Eigen::Index>(l))));
            EXPECT_LT(error, 1e-4 * B.cwiseAbs().maxCoeff()) << threads << " threads, " << lanes << " lanes";
        }
}

}  // namespace
}  // namespace teres
