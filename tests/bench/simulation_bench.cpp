// Step times of the forward model: one simulation, a batch of sigma points, and their parts. Every iteration
// starts from the same state. Figures and commands: BENCHMARKS.md.
#include <benchmark/benchmark.h>
#include <sys/resource.h>

#include <Eigen/Dense>
#include <cmath>
#include <cstdlib>
#include <memory>

#include "plugins/simulation/case_model.h"
#include "plugins/simulation/cholesky.h"
#include "plugins/simulation/metric_solver.h"
#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// A liver-sized block on its ligament (one face), about the number of tetrahedra asked for.
Case block_on_ligament(int tetrahedra, BodyLaw law) {
    const int cells = std::max(2, static_cast<int>(std::lround(std::cbrt(tetrahedra / 6.0))));
    Case c = test::clamped_block(
        {.size_m = {0.13, 0.11, 0.10}, .cells = {cells, cells, cells}, .law = law, .poissons_ratio = 0.49});
    c.body.alpha = 0.88;
    c.ligament = LigamentData{LigamentLaw::kNeoHookean, 80e3, 0.48, 0.025, 0.02, 0.0};
    for (const auto node : c.clamped) c.ligament_prior.push_back({node, 0.7});
    c.clamped.clear();
    return c;
}

struct Setup {
    std::unique_ptr<CaseModel> model;
    MatrixXd theta, X;

    Setup(int tetrahedra, BodyLaw law, int lanes, int threads = 1) {
        CaseModelSettings settings;
        settings.max_lanes = lanes;
        settings.threads = threads;
        model = *CaseModel::make(block_on_ligament(tetrahedra, law), settings);
        const auto p = static_cast<Eigen::Index>(model->num_parameters());
        theta.resize(p, lanes);
        for (Eigen::Index i = 0; i < p; ++i)
            for (Eigen::Index l = 0; l < lanes; ++l)
                theta(i, l) = model->parameter(static_cast<std::size_t>(i)).prior_median *
                              std::exp(0.5 * std::sin(1.0 + 3.0 * static_cast<double>(i + l)));
        VectorXd x(static_cast<Eigen::Index>(model->num_state()));
        model->rest_state({x.data(), model->num_state()});
        X = x.replicate(1, lanes);
        step(0.10);  // the factorisation is made and the state is near where the timed step goes
    }
    ForwardReport step(double force_n) {
        const double force[3] = {0.5 * force_n, 0.2 * force_n, -force_n};
        return model->advance({0.0, 0.0, force, {}}, {theta.data(), static_cast<std::size_t>(theta.size())},
                              {X.data(), static_cast<std::size_t>(X.size())}, static_cast<std::size_t>(X.cols()));
    }
};

// One quasi-static step: the load grows by a tenth, as between frames of a slow pull.
void BM_Step(benchmark::State& state, BodyLaw law) {
    Setup setup(static_cast<int>(state.range(0)), law, static_cast<int>(state.range(1)),
                static_cast<int>(state.range(2)));
    const MatrixXd start = setup.X;
    ForwardReport report;
    for (auto _ : state) {
        state.PauseTiming();
        setup.X = start;
        state.ResumeTiming();
        report = setup.step(0.11);
    }
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    state.counters["tets"] = static_cast<double>(setup.model->mesh().tets.size());
    state.counters["iterations"] = report.iterations;
    state.counters["converged"] = report.lanes_converged;
    state.counters["peak_MB"] = static_cast<double>(usage.ru_maxrss) / 1024.0;
}
BENCHMARK_CAPTURE(BM_Step, stvk, BodyLaw::kStVK)
    ->ArgNames({"tets", "lanes", "threads"})
    ->ArgsProduct({{7500}, {1, 9}, {1, 2}})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(BM_Step, ogden, BodyLaw::kOgden)
    ->ArgNames({"tets", "lanes", "threads"})
    ->ArgsProduct({{7500}, {1, 9}, {1, 2}})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);

// A body at rest and its factorised tangent.
struct Factorised {
    Setup setup;
    const MechanicalSystem& system = setup.model->system();
    std::vector<double> values;
    Cholesky cholesky{system.pattern()};

    explicit Factorised(int tetrahedra) : setup(tetrahedra, BodyLaw::kStVK, 1) {
        assemble();
        cholesky.factorise(values);
    }
    bool assemble() {
        ExternalActions actions;
        system.resolve({}, {}, actions);
        return system.tangent(actions, {}, 0, setup.theta.data(), system.parts().X, values);
    }
};

// A time step of a recording at a fixed rate: lengths that differ by rounding share a factorisation, lengths that
// differ by a twentieth have one each.
void BM_TimeStep(benchmark::State& state, double jitter) {
    Case c = block_on_ligament(7500, BodyLaw::kNeoHookean);
    c.quasi_static = false;
    CaseModelSettings settings;
    settings.max_step_s = 1.0;  // each in one part
    auto model = *CaseModel::make(c, settings);
    VectorXd x(static_cast<Eigen::Index>(model->num_state())),
        theta(static_cast<Eigen::Index>(model->num_parameters()));
    model->rest_state({x.data(), model->num_state()});
    for (Eigen::Index p = 0; p < theta.size(); ++p)
        theta(p) = model->parameter(static_cast<std::size_t>(p)).prior_median;
    int steps = 0, factorisations = 0;
    for (auto _ : state) {
        const double dt = 0.01 * (1.0 + jitter * (steps % 2)), t = 0.01 * steps++;
        const double force[3] = {0.0, 0.02 * std::sin(6.0 * t), 0.0};
        factorisations += model
                              ->advance({t, dt, force, {}}, {theta.data(), model->num_parameters()},
                                        {x.data(), model->num_state()}, 1)
                              .factorisations;
    }
    state.counters["factorisations_per_step"] = static_cast<double>(factorisations) / std::max(1, steps);
}
BENCHMARK_CAPTURE(BM_TimeStep, rounded, 1e-13)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(BM_TimeStep, uneven, 0.05)->Unit(benchmark::kMillisecond);

void BM_Tangent(benchmark::State& state) {
    Factorised body(static_cast<int>(state.range(0)));
    for (auto _ : state) benchmark::DoNotOptimize(body.assemble());
}
BENCHMARK(BM_Tangent)->Arg(7500)->Unit(benchmark::kMillisecond);

void BM_Factorise(benchmark::State& state) {
    Factorised body(static_cast<int>(state.range(0)));
    for (auto _ : state) benchmark::DoNotOptimize(body.cholesky.factorise(body.values));
    state.counters["factor_nonzeros"] = body.cholesky.factor_nonzeros();
}
BENCHMARK(BM_Factorise)->Arg(7500)->Unit(benchmark::kMillisecond);

void BM_Solve(benchmark::State& state) {
    Factorised body(7500);
    MatrixXd B = MatrixXd::Ones(body.system.pattern().num_rows(), state.range(0));
    for (auto _ : state) {
        B.setOnes();
        body.cholesky.solve(B);
        benchmark::DoNotOptimize(B.data());
    }
}
BENCHMARK(BM_Solve)->ArgName("rhs")->Arg(1)->Arg(9)->Unit(benchmark::kMillisecond);

void BM_Metric(benchmark::State& state) {
    Factorised body(7500);
    TaskTeam team(static_cast<int>(state.range(1)));
    MetricSolver metric(body.cholesky, team.threads());
    metric.renew(body.cholesky);
    const auto lanes = static_cast<std::size_t>(state.range(0));
    std::vector<float> y(metric.num_storage_rows() * MetricSolver::lane_stride(lanes), 1.0f);
    for (auto _ : state) {
        std::fill(y.begin(), y.end(), 1.0f);
        metric.solve(y.data(), lanes, team);
        benchmark::DoNotOptimize(y.data());
    }
}
BENCHMARK(BM_Metric)
    ->ArgNames({"lanes", "threads"})
    ->ArgsProduct({{1, 4, 8, 9, 16}, {1, 2}})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace teres

BENCHMARK_MAIN();
