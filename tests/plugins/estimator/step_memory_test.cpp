// A filter step takes nothing from the heap that grows with the mesh, once it has warmed up.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstdlib>

#include "plugins/estimator/boundary_estimator.h"
#include "plugins/simulation/case_model.h"
#include "tests/support/synthetic_case.h"

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

namespace {
std::atomic<std::size_t> g_calls{0}, g_largest{0};
}  // namespace

// Every allocation of the program goes through here (Eigen's and the C library's too).
extern "C" void* __libc_malloc(std::size_t size);
extern "C" void* malloc(std::size_t size) {
    ++g_calls;
    std::size_t largest = g_largest;
    while (size > largest && !g_largest.compare_exchange_weak(largest, size)) {
    }
    return __libc_malloc(size);
}

namespace teres {
namespace {

TEST(StepMemory, NothingThatGrowsWithTheMeshAfterWarmUp) {
    Case c = test::clamped_block({.size_m = {0.12, 0.06, 0.04}, .cells = {8, 4, 4}, .poissons_ratio = 0.48});
    c.ligament = LigamentData{LigamentLaw::kCubicSpring, 80e3, 0.48, 0.025, 0.02, 0.0};
    for (std::size_t i = 0; i < c.mesh.nodes.size(); ++i)
        if (c.mesh.nodes[i][2] > 0.04 - 1e-9 && c.mesh.nodes[i][0] > 0.0)
            c.ligament_prior.push_back({static_cast<std::int32_t>(i), 0.7});
    CaseModelSettings s;
    s.max_lanes = 4;
    s.ligament.num_groups = 3;
    s.equilibrium.renewal_steps = 0;
    const auto model = *CaseModel::make(c, s);
    BoundaryEstimator estimator = BoundaryEstimator::make(*model, {}).value();
    std::vector<double> x(model->num_state()), z(3 * model->num_markers());
    model->rest_state(x);
    model->observe(x, z, 1);
    std::vector<std::int32_t> id;
    std::vector<double> mx, my, mz, sigma(model->num_markers(), 3e-4);
    for (std::size_t m = 0; m < model->num_markers(); ++m) {
        id.push_back(model->marker_id(m));
        mx.push_back(z[3 * m]);
        my.push_back(z[3 * m + 1]);
        mz.push_back(z[3 * m + 2]);
    }
    int quiet_frames = 0;
    for (int f = 0; f < 60; ++f) {
        const double t = f / 30.0, force[3] = {0.02, 0.0, -0.1 - 0.05 * std::sin(t)};
        const std::size_t calls = g_calls;
        g_largest = 0;
        ASSERT_EQ(
            estimator.step({static_cast<std::int64_t>(1e6 * t) + 1, id, mx, my, mz, sigma}, {t, 1.0 / 30.0, force, {}}),
            FrameOutcome::kCorrected);
        const std::size_t largest = g_largest, count = g_calls - calls;
        if (f < 20 || estimator.report().factorisations > 0) continue;
        ++quiet_frames;
        EXPECT_LT(largest, sizeof(double) * model->num_state()) << "frame " << f;  // less than one state
        EXPECT_LT(count, 300u) << "frame " << f;  // temporaries of parameters and markers
    }
    EXPECT_GE(quiet_frames, 10);
}

}  // namespace
}  // namespace teres

#endif
