// teres bench: how long a filter step takes, and against what. Everything is measured in one run, so that the
// ratios hold on a busy machine too.
#include <fmt/format.h>
#include <sys/resource.h>

#include <Eigen/Dense>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "core/case/case_writer.h"
#include "plugins/estimator/boundary_estimator.h"
#include "plugins/simulation/case_model.h"
#include "plugins/simulation/cholesky.h"
#include "tools/bench_scene.h"
#include "tools/commands.h"
#include "tools/plot.h"

namespace teres::tools {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using nlohmann::json;
using Clock = std::chrono::steady_clock;

struct BenchOptions {
    int tetrahedra = 7500, unknowns = 8, threads = 2, frames = 150;
    std::string law = "stvk", element = "nodal_blend", json_file, plot_folder, case_folder;
    double relative_residual = 1e-4;
    bool scaling = false;
};

struct Percentiles {
    double p50 = 0.0, p99 = 0.0;
};

Percentiles percentiles(std::vector<double> values) {
    if (values.empty()) return {};
    std::sort(values.begin(), values.end());
    const auto at = [&](double q) {
        return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1) + 0.5)];
    };
    return {at(0.5), at(0.99)};
}

template <class Work>
double milliseconds(const Work& work) {
    const auto start = Clock::now();
    work();
    return 1e3 * std::chrono::duration<double>(Clock::now() - start).count();
}

double peak_memory_mb() {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

std::span<double> span_of(MatrixXd& m) {
    return {m.data(), static_cast<std::size_t>(m.size())};
}

/// A recording: loads and noisy markers of a body whose ligament differs from the prior.
struct Recording {
    Case scene;
    MatrixXd force;    // 3 regions x frames
    MatrixXd markers;  // 3 M x frames
    MatrixXd truth;    // states
    VectorXd theta;
    Eigen::Index cut_frame = -1;  // before it the tissue is cut and a ligament group lets go; -1: never
    std::vector<std::int32_t> cut_tets, released;
};

// A slit into the lower edge between the lobes, as deep as a third of the liver; the group at the end of the ligament.
void plan_cut(Recording& r, const CaseModel& model) {
    r.cut_frame = r.scene.num_frames / 2;
    for (std::size_t e = 0; e < r.scene.mesh.tets.size(); ++e) {
        Eigen::Vector3d p = Eigen::Vector3d::Zero();
        for (const auto node : r.scene.mesh.tets[e])
            p += 0.25 * Eigen::Map<const Eigen::Vector3d>(r.scene.mesh.nodes[static_cast<std::size_t>(node)].data());
        if (std::abs(p.x()) < 0.012 && p.y() < -0.025) r.cut_tets.push_back(static_cast<std::int32_t>(e));
    }
    r.released = {static_cast<std::int32_t>(model.num_parameters()) - 1};
}

CaseModelSettings model_settings(const BenchOptions& options, int lanes) {
    CaseModelSettings settings;
    settings.max_lanes = lanes;
    settings.element = options.element == "linear" ? ElementType::kLinear : ElementType::kNodalBlend;
    settings.threads = options.threads;
    settings.ligament.num_groups = options.unknowns;
    settings.equilibrium.relative_residual = options.relative_residual;
    return settings;
}

ForwardInputs inputs_of(const Recording& recording, Eigen::Index frame) {
    return {static_cast<double>(frame) * recording.scene.dt_s,
            recording.scene.dt_s,
            {recording.force.col(frame).data(), static_cast<std::size_t>(recording.force.rows())},
            {}};
}

Result<Recording> make_recording(const BenchOptions& options, bool cut = false) {
    Recording r;
    BenchScene scene;
    scene.tetrahedra = options.tetrahedra;
    scene.frames = options.frames;
    scene.law = options.law == "ogden" ? BodyLaw::kOgden : BodyLaw::kStVK;
    r.scene = bench_case(scene);
    TERES_TRY_ASSIGN(const std::unique_ptr<CaseModel> model, CaseModel::make(r.scene, model_settings(options, 1)));
    const auto frames = static_cast<Eigen::Index>(options.frames),
               rows = static_cast<Eigen::Index>(3 * model->num_markers());
    r.force.setZero(static_cast<Eigen::Index>(3 * model->num_regions()), frames);
    for (std::size_t k = 0; k < r.scene.loads.size(); ++k)
        for (int a = 0; a < 3; ++a)
            r.force(3 * r.scene.loads[k].region + a, static_cast<Eigen::Index>(k / model->num_regions())) =
                r.scene.loads[k].force_n[static_cast<std::size_t>(a)];
    r.theta.resize(static_cast<Eigen::Index>(model->num_parameters()));
    for (Eigen::Index p = 0; p < r.theta.size(); ++p)
        r.theta(p) = model->parameter(static_cast<std::size_t>(p)).prior_median *
                     std::exp(0.7 * std::sin(1.0 + 2.0 * static_cast<double>(p)));
    if (cut) plan_cut(r, *model);
    MatrixXd x(static_cast<Eigen::Index>(model->num_state()), 1), z(rows, 1);
    model->rest_state(span_of(x));
    r.markers.resize(rows, frames);
    r.truth.resize(x.rows(), frames);
    std::mt19937_64 random(7);
    std::normal_distribution<double> noise(0.0, r.scene.sensor.noise_sigma_m);
    for (Eigen::Index f = 0; f < frames; ++f) {
        if (f == r.cut_frame && model->cut(r.cut_tets, r.released).outcome != CutOutcome::kDone)
            return not_usable("the cut of the bench recording was refused");
        const ForwardReport report =
            model->advance(inputs_of(r, f), {r.theta.data(), static_cast<std::size_t>(r.theta.size())}, span_of(x), 1);
        if (report.lanes_converged != 1)
            return not_usable(fmt::format("frame {} of the bench recording did not converge", f));
        model->observe(span_of(x), span_of(z), 1);
        r.truth.col(f) = x;
        r.markers.col(f) = z.unaryExpr([&](double v) { return v + noise(random); });
    }
    return r;
}

/// Not timed: the first frames, in which the sigma points lie as far apart as the prior.
Eigen::Index warm_up_frames(Eigen::Index frames) {
    return std::min<Eigen::Index>(30, frames / 2);
}

/// The whole filter over the recording.
struct FilterRun {
    std::vector<double> step_ms, iterations, marker_rms;
    double cut_ms = 0.0;  ///< of the change itself, before the step
    SolverTimes times;    // of the timed frames
    int timed = 0, factorisations = 0, not_converged = 0, unknowns = 0;
    double rest_ms = 0.0;  ///< a frame: filter algebra, copies, waiting for a renewal
};

Result<FilterRun> run_filter(const Recording& recording, const BenchOptions& options) {
    TERES_TRY_ASSIGN(const std::unique_ptr<CaseModel> model,
                     CaseModel::make(recording.scene, model_settings(options, options.unknowns + 1)));
    TERES_TRY_ASSIGN(BoundaryEstimator estimator, BoundaryEstimator::make(*model, {}));
    FilterRun run;
    run.unknowns = static_cast<int>(model->num_parameters());
    std::vector<std::int32_t> id;
    for (std::size_t m = 0; m < model->num_markers(); ++m) id.push_back(model->marker_id(m));
    const std::vector<double> sigma(id.size(), recording.scene.sensor.noise_sigma_m);
    std::vector<double> x(id.size()), y(id.size()), z(id.size());
    SolverTimes before{};
    double total = 0.0;
    const Eigen::Index warm_up = warm_up_frames(recording.markers.cols());
    for (Eigen::Index f = 0; f < recording.markers.cols(); ++f) {
        for (std::size_t m = 0; m < id.size(); ++m) {
            const auto row = static_cast<Eigen::Index>(3 * m);
            x[m] = recording.markers(row, f);
            y[m] = recording.markers(row + 1, f);
            z[m] = recording.markers(row + 2, f);
        }
        const MarkerFrame frame{
            static_cast<std::int64_t>(1e6 * static_cast<double>(f) * recording.scene.dt_s) + 1, id, x, y, z, sigma};
        if (f == warm_up) before = model->solver().times();
        if (f == recording.cut_frame)
            run.cut_ms = milliseconds([&] {
                model->cut(recording.cut_tets, recording.released);
                estimator.follow_cut(recording.released, {});
            });
        const double ms = milliseconds([&] { estimator.step(frame, inputs_of(recording, f)); });
        const ForwardReport& report = estimator.report();
        run.not_converged += report.lanes - report.lanes_converged;
        if (f < warm_up) continue;
        ++run.timed;
        total += ms;
        run.step_ms.push_back(ms);
        run.marker_rms.push_back(std::sqrt(estimator.residual().squaredNorm() / static_cast<double>(z.size())));
        run.iterations.push_back(report.iterations);
        run.factorisations += report.factorisations;
    }
    const SolverTimes& now = model->solver().times();
    run.times = {now.gradient - before.gradient, now.metric - before.metric,       now.correction - before.correction,
                 now.history - before.history,   now.factorise - before.factorise, now.newton - before.newton};
    const SolverTimes& t = run.times;
    run.rest_ms =
        (total - 1e3 * (t.gradient + t.metric + t.correction + t.history + t.factorise + t.newton)) / run.timed;
    return run;
}

/// One simulation per frame, true parameters; plain: every step by full Newton with a direct solve on one
/// thread.
struct SingleRun {
    std::vector<double> step_ms;
    double iterations = 0.0;
    MatrixXd states;
};

Result<SingleRun> run_single(const Recording& recording, BenchOptions options, bool plain, Eigen::Index frames) {
    CaseModelSettings settings = model_settings(options, 1);
    settings.equilibrium.plain_newton = plain;
    if (plain) settings.threads = 1;
    TERES_TRY_ASSIGN(const std::unique_ptr<CaseModel> model, CaseModel::make(recording.scene, settings));
    SingleRun run;
    run.states.resize(recording.truth.rows(), frames);
    MatrixXd x = recording.truth.col(0);
    for (Eigen::Index f = 0; f < frames; ++f) {
        ForwardReport report;
        const double ms = milliseconds([&] {
            report = model->advance(inputs_of(recording, f),
                                    {recording.theta.data(), static_cast<std::size_t>(recording.theta.size())},
                                    span_of(x), 1);
        });
        run.states.col(f) = x;
        if (f < frames / 5) continue;
        run.step_ms.push_back(ms);
        run.iterations += report.iterations / (0.8 * static_cast<double>(frames));
    }
    return run;
}

Result<double> factorisation_ms(const Recording& recording, const BenchOptions& options) {
    TERES_TRY_ASSIGN(const std::unique_ptr<CaseModel> model,
                     CaseModel::make(recording.scene, model_settings(options, 1)));
    const MechanicalSystem& system = model->system();
    ExternalActions actions;
    system.resolve({}, {}, actions);
    const Positions x = Eigen::Map<const Positions>(recording.truth.col(recording.truth.cols() / 2).data(), 3,
                                                    static_cast<Eigen::Index>(system.num_nodes()));
    std::vector<double> values;
    if (!system.tangent(actions, {}, 0, recording.theta.data(), x, values))
        return not_usable("the tangent of the bench recording is not defined");
    Cholesky cholesky(system.pattern());
    std::vector<double> ms;
    for (int k = 0; k < 7; ++k) ms.push_back(milliseconds([&] { cholesky.factorise(values); }));
    return percentiles(ms).p50;
}

json split_of(const FilterRun& run) {
    const double frames = run.timed;
    return {{"force_ms", 1e3 * run.times.gradient / frames},
            {"metric_solve_ms", 1e3 * run.times.metric / frames},
            {"parameter_correction_ms", 1e3 * run.times.correction / frames},
            {"history_ms", 1e3 * run.times.history / frames},
            {"factorise_ms", 1e3 * run.times.factorise / frames},
            {"newton_ms", 1e3 * run.times.newton / frames},
            {"filter_algebra_and_rest_ms", run.rest_ms}};
}

double mean(const std::vector<double>& v) {
    double sum = 0.0;
    for (const double x : v) sum += x;
    return v.empty() ? 0.0 : sum / static_cast<double>(v.size());
}

/// What a cut costs while the filter runs: the change itself, the step in which it happens, the ten after it.
Result<json> cut_cost(BenchOptions options) {
    options.frames = std::min(options.frames, 100);
    TERES_TRY_ASSIGN(const Recording recording, make_recording(options, true));
    TERES_TRY_ASSIGN(const FilterRun run, run_filter(recording, options));
    const auto at = static_cast<std::ptrdiff_t>(recording.cut_frame - recording.markers.cols() / 5);
    const auto of = [&](const std::vector<double>& v, std::ptrdiff_t first, std::ptrdiff_t last) {
        return percentiles({v.begin() + first, v.begin() + std::min<std::ptrdiff_t>(last, std::ssize(v))}).p50;
    };
    const double usual = of(run.step_ms, 0, at), step = run.step_ms[static_cast<std::size_t>(at)],
                 after = of(run.step_ms, at + 1, at + 11);
    const double rms_before = of(run.marker_rms, 0, at),
                 rms_after = of(run.marker_rms, at + 10, std::ssize(run.marker_rms));
    fmt::print(
        "cut of {} tetrahedra, one ligament group released: change {:.1f} ms, its step {:.2f} of a usual step, the ten "
        "after it {:.2f} (median); markers predicted to {:.2f} mm before, {:.2f} mm after; {} lanes not converged\n",
        recording.cut_tets.size(), run.cut_ms, step / usual, after / usual, 1e3 * rms_before, 1e3 * rms_after,
        run.not_converged);
    return json{{"tetrahedra", recording.cut_tets.size()},
                {"change_ms", run.cut_ms},
                {"step_ms", step},
                {"step_to_usual", (run.cut_ms + step) / usual},
                {"ten_after_to_usual", after / usual},
                {"iterations_of_step", run.iterations[static_cast<std::size_t>(at)]},
                {"marker_rms_mm_before", 1e3 * rms_before},
                {"marker_rms_mm_after", 1e3 * rms_after},
                {"lanes_not_converged", run.not_converged}};
}

/// One row of a scaling table: the filter alone.
Result<json> scaling_row(BenchOptions options, const char* what, int value) {
    const auto text = std::string(what);
    (text == "tetrahedra" ? options.tetrahedra : text == "unknowns" ? options.unknowns : options.threads) = value;
    TERES_TRY_ASSIGN(const Recording recording, make_recording(options));
    TERES_TRY_ASSIGN(const FilterRun run, run_filter(recording, options));
    const auto p = percentiles(run.step_ms);
    fmt::print("  {:>10} {:>6}: filter step {:8.2f} ms (p99 {:8.2f}), {:.1f} iterations, {} tetrahedra\n", what, value,
               p.p50, p.p99, mean(run.iterations), recording.scene.mesh.tets.size());
    return json{{what, value},
                {"tets", recording.scene.mesh.tets.size()},
                {"filter_step_ms_median", p.p50},
                {"filter_step_ms_p99", p.p99},
                {"iterations_mean", mean(run.iterations)}};
}

Result<json> scaling_tables(const BenchOptions& options) {
    json tables;
    const auto add = [&](const char* what, std::vector<int> values) -> Status {
        BenchOptions row = options;
        row.frames = 80;
        fmt::print("scaling with {}\n", what);
        for (const int value : values) {
            TERES_TRY_ASSIGN(json line, scaling_row(row, what, value));
            tables[what].push_back(std::move(line));
        }
        return {};
    };
    TERES_TRY(add("unknowns", {2, 4, 8, 16, 32}));
    TERES_TRY(add("threads", {1, 2}));
    TERES_TRY(add("tetrahedra", {1000, 3000, 7500, 20000, 70000}));
    return tables;
}

Status plot_scaling(const json& tables, const std::string& folder) {
    for (const char* what : {"unknowns", "tetrahedra"}) {
        Plot plot;
        plot.title = fmt::format("Filter step against {}", what);
        plot.x_label = what;
        Curve median{"median", {}, {}, {}, {}, false}, p99{"99th percentile", {}, {}, {}, {}, true};
        for (const auto& row : tables[what]) {
            const double x = row[std::string(what) == "tetrahedra" ? "tets" : what].get<double>();
            median.x.push_back(x);
            median.y.push_back(row["filter_step_ms_median"]);
            p99.x.push_back(x);
            p99.y.push_back(row["filter_step_ms_p99"]);
        }
        plot.panels.push_back({.title = "", .y_label = "one filter step [ms]", .log_y = true, .curves = {median, p99}});
        TERES_TRY(save_plot(plot, std::filesystem::path(folder) / fmt::format("bench_{}.png", what)));
    }
    return {};
}

/// The recording as a case folder, to be replayed through the whole service.
Result<int> write_recording(const Recording& recording, const std::string& folder) {
    Case c = recording.scene;
    for (Eigen::Index f = 0; f < recording.markers.cols(); ++f)
        for (std::size_t m = 0; m < c.markers.size(); ++m) {
            const auto row = static_cast<Eigen::Index>(3 * m);
            c.observations.push_back(
                {static_cast<double>(f) * c.dt_s,
                 c.markers[m].id,
                 {recording.markers(row, f), recording.markers(row + 1, f), recording.markers(row + 2, f)}});
        }
    TERES_TRY(write_case(c, folder));
    fmt::print("recording written to {}: teres replay {} --speed 1\n", folder, folder);
    return kDone;
}

Result<int> bench(const BenchOptions& options) {
    fmt::print("recording: {} frames at 30 Hz, about {} tetrahedra ({}, {}), {} unknowns, residual {:g}\n",
               options.frames, options.tetrahedra, options.law, options.element, options.unknowns,
               options.relative_residual);
    TERES_TRY_ASSIGN(const Recording recording, make_recording(options));
    if (!options.case_folder.empty()) return write_recording(recording, options.case_folder);
    TERES_TRY_ASSIGN(const FilterRun filter, run_filter(recording, options));
    const double memory = peak_memory_mb();
    TERES_TRY_ASSIGN(const SingleRun single, run_single(recording, options, false, recording.truth.cols()));
    const Eigen::Index plain_frames = std::min<Eigen::Index>(15, recording.truth.cols());
    TERES_TRY_ASSIGN(const SingleRun plain, run_single(recording, options, true, plain_frames));
    TERES_TRY_ASSIGN(const double factorisation, factorisation_ms(recording, options));

    const Percentiles step = percentiles(filter.step_ms), one = percentiles(single.step_ms),
                      direct = percentiles(plain.step_ms);
    const double simulations = filter.unknowns + 1.0;
    double motion = 0.0, per_frame = 0.0;
    for (Eigen::Index f = 1; f < recording.truth.cols(); ++f) {
        motion = std::max(motion, (recording.truth.col(f) - recording.truth.col(0)).cwiseAbs().maxCoeff());
        per_frame = std::max(per_frame, (recording.truth.col(f) - recording.truth.col(f - 1)).cwiseAbs().maxCoeff());
    }
    fmt::print("largest motion {:.1f} mm, {:.2f} mm from frame to frame\n", 1e3 * motion, 1e3 * per_frame);
    const double difference = (single.states.leftCols(plain_frames) - plain.states).cwiseAbs().maxCoeff() /
                              plain.states.cwiseAbs().maxCoeff();
    json out{{"tetrahedra", recording.scene.mesh.tets.size()},
             {"nodes", recording.scene.mesh.nodes.size()},
             {"unknowns", filter.unknowns},
             {"sigma_points", filter.unknowns + 1},
             {"threads", options.threads},
             {"law", options.law},
             {"element", options.element},
             {"frames_timed", filter.timed},
             {"relative_residual", options.relative_residual},
             {"filter_step_ms_median", step.p50},
             {"filter_step_ms_p99", step.p99},
             {"filter_iterations_mean", mean(filter.iterations)},
             {"filter_factorisations", filter.factorisations},
             {"lanes_not_converged", filter.not_converged},
             {"filter_split", split_of(filter)},
             {"single_step_ms_median", one.p50},
             {"single_step_ms_p99", one.p99},
             {"single_iterations_mean", single.iterations},
             {"plain_single_step_ms_median", direct.p50},
             {"ratio_to_plain", step.p50 / (simulations * direct.p50)},
             {"factorisation_ms", factorisation},
             {"ratio_to_factorisation", step.p50 / factorisation},
             {"fast_against_plain_relative", difference},
             {"peak_memory_mb", memory}};
    fmt::print(
        "one filter step, {} sigma points   {:8.2f} ms median, {:.2f} ms p99 ({:.1f} iterations, {} "
        "factorisations in {} frames, {} lanes not converged)\n",
        filter.unknowns + 1, step.p50, step.p99, mean(filter.iterations), filter.factorisations, filter.timed,
        filter.not_converged);
    for (const auto& [name, ms] : out["filter_split"].items())
        fmt::print("    {:<26} {:8.2f} ms a frame\n", name.substr(0, name.size() - 3), ms.get<double>());
    fmt::print("one simulation                    {:8.2f} ms median, {:.2f} ms p99 ({:.1f} iterations)\n", one.p50,
               one.p99, single.iterations);
    fmt::print(
        "one plain simulation              {:8.2f} ms (full Newton, direct solve, one thread); fast and "
        "plain differ by {:.1e} of the body's extent\n",
        direct.p50, difference);
    fmt::print("filter step / {} plain simulations {:7.3f}\n", filter.unknowns + 1,
               step.p50 / (simulations * direct.p50));
    fmt::print("filter step / one factorisation   {:8.2f}   ({:.1f} ms)\n", step.p50 / factorisation, factorisation);
    fmt::print("peak memory                       {:8.1f} MB\n", memory);
    TERES_TRY_ASSIGN(out["cut"], cut_cost(options));
    if (options.scaling) {
        TERES_TRY_ASSIGN(out["scaling"], scaling_tables(options));
        if (!options.plot_folder.empty()) {
            std::filesystem::create_directories(options.plot_folder);
            TERES_TRY(plot_scaling(out["scaling"], options.plot_folder));
        }
    }
    if (!options.json_file.empty()) {
        std::ofstream file(options.json_file);
        file << out.dump(1) << '\n';
        if (!file) return host_fault("cannot write " + options.json_file);
    }
    return filter.not_converged == 0 ? kDone : kNotUsableExit;
}

}  // namespace

void add_bench_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<BenchOptions>();
    CLI::App* verb =
        add_verb(app, exit_code, "bench", "Time of a filter step and of its parts, as ratios within one run",
                 "  teres bench\n  teres bench --json bench.json\n  teres bench --scaling --plot plots/\n"
                 "  teres bench --tets 20000 --unknowns 16 --threads 1\n  teres bench --frames 300 "
                 "--write-case pull && teres replay pull --speed 1",
                 [options] {
                     const auto result = bench(*options);
                     return result ? *result : report(result.error());
                 });
    verb->add_option("--tets", options->tetrahedra, "tetrahedra, about")
        ->check(CLI::Range(100, 200000))
        ->capture_default_str();
    verb->add_option("--unknowns", options->unknowns, "ligament groups = unknowns of the filter")
        ->check(CLI::Range(1, 64))
        ->capture_default_str();
    verb->add_option("--threads", options->threads, "threads that share a step")
        ->check(CLI::Range(1, 64))
        ->capture_default_str();
    verb->add_option("--frames", options->frames, "frames of the recording")
        ->check(CLI::Range(20, 10000))
        ->capture_default_str();
    verb->add_option("--law", options->law, "material of the body")
        ->check(CLI::IsMember({"stvk", "ogden"}))
        ->capture_default_str();
    verb->add_option("--element", options->element,
                     "linear: plain linear tetrahedra, as in the paper; nodal_blend: the default, does not lock")
        ->check(CLI::IsMember({"nodal_blend", "linear"}))
        ->capture_default_str();
    verb->add_option("--residual", options->relative_residual, "a step ends when |residual| <= this * |applied force|")
        ->check(CLI::Range(1e-12, 1e-2))
        ->capture_default_str();
    verb->add_flag("--scaling", options->scaling, "also scaling with unknowns, threads and tetrahedra (some minutes)");
    verb->add_option("--plot", options->plot_folder, "folder for plots of --scaling");
    verb->add_option("--write-case", options->case_folder,
                     "only write the recording as a case folder, for teres replay");
    verb->add_option("--json", options->json_file, "write all figures to this file");
}

}  // namespace teres::tools
