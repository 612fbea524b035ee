// teres simulate CASE: the forward model alone, with the case's loads and the prior's ligament, no
// observations used.
#include <algorithm>
#include <cstdio>
#include <memory>

#include "core/case/case_reader.h"
#include "core/case/frame_times.h"
#include "core/case/load_tracks.h"
#include "core/case/vtk_writer.h"
#include "core/extensions/forward_model.h"
#include "core/session.h"
#include "tools/commands.h"
#include "tools/position_table.h"
#include "tools/progress.h"

namespace teres::tools {
namespace {

struct SimulateOptions {
    std::string case_folder, predict_file, vtk_folder;
    SettingsOptions settings;
};

Result<int> simulate(const SimulateOptions& options) {
    TERES_TRY_ASSIGN(Config config, read_offline_settings(options.settings));
    TERES_TRY(config.set("service.case=" + options.case_folder));
    TERES_TRY(config.set("service.drivers="));
    TERES_TRY(config.set("service.plugins=simulation"));
    TERES_TRY_ASSIGN(const Case c, read_case(options.case_folder));
    TERES_TRY_ASSIGN(const std::unique_ptr<Session> session, Session::open(config));
    TERES_TRY(session->start());
    auto* model = session->extension<ForwardModel>();
    if (model == nullptr) return host_fault("the plugins offer no teres.forward_model/1");

    std::vector<double> theta(model->num_parameters());
    for (std::size_t p = 0; p < theta.size(); ++p) theta[p] = model->parameter(p).prior_median;
    std::vector<double> x(model->num_state()), points(3 * model->num_points());
    std::vector<std::int32_t> ids(model->num_points());
    for (std::size_t k = 0; k < ids.size(); ++k) ids[k] = model->point_id(k);
    model->rest_state(x);

    const LoadTracks tracks(c);
    tool_loads_t loads;
    std::vector<double> force(3 * c.load_regions.size()), tool(3 * c.tools.size());
    PositionTable table;
    std::unique_ptr<VtkSeries> series;
    if (!options.vtk_folder.empty()) {
        TERES_TRY_ASSIGN(VtkSeries made, VtkSeries::make(options.vtk_folder, "body", c.mesh));
        series = std::make_unique<VtkSeries>(std::move(made));
    }
    const std::vector<double> times = frame_times(c);
    Progress progress("simulating", times.size());
    std::size_t unconverged = 0;
    double worst_residual = 0.0, largest_m = 0.0, previous_t = times.empty() ? 0.0 : times.front();
    const std::vector<double> rest(x.begin(),
                                   x.begin() + static_cast<std::ptrdiff_t>(3 * c.mesh.nodes.size()));
    for (std::size_t k = 0; k < times.size(); ++k) {
        tracks.at(times[k], loads);
        for (std::size_t r = 0; r < c.load_regions.size(); ++r) {
            force[3 * r] = loads.fx_n[r];
            force[3 * r + 1] = loads.fy_n[r];
            force[3 * r + 2] = loads.fz_n[r];
        }
        for (std::size_t j = 0; j < c.tools.size(); ++j) {
            tool[3 * j] = loads.x_m[j];
            tool[3 * j + 1] = loads.y_m[j];
            tool[3 * j + 2] = loads.z_m[j];
        }
        if (k > 0 || c.quasi_static) {  // a dynamic case starts at rest at its first time
            const double dt = k > 0 ? times[k] - previous_t : c.dt_s;
            const ForwardReport report = model->advance({times[k], dt, force, tool}, theta, x, 1);
            unconverged += report.lanes_converged < 1;
            worst_residual = std::max(worst_residual, report.relative_residual);
        }
        previous_t = times[k];
        for (std::size_t i = 0; i + 2 < rest.size(); i += 3)
            largest_m = std::max(largest_m,
                                 std::hypot(x[i] - rest[i], x[i + 1] - rest[i + 1], x[i + 2] - rest[i + 2]));
        model->predict_points(x, points);
        table.add(times[k], ids, points);
        if (series != nullptr)
            TERES_TRY(
                series->add({times[k], std::span<const double>(x).first(3 * c.mesh.nodes.size()), {}, {}}));
        progress.step();
    }
    progress.finish();
    std::printf("%s: %zu frames, %zu nodes, %zu ligament unknowns at their prior medians\n", c.name.c_str(),
                times.size(), c.mesh.nodes.size(), theta.size());
    std::printf("  largest displacement %9.3f mm\n  largest residual     %9.2e of the applied force\n",
                1e3 * largest_m, worst_residual);
    if (!options.predict_file.empty()) {
        TERES_TRY(table.write(options.predict_file));
        std::printf("  points      %s\n", options.predict_file.c_str());
    }
    if (series != nullptr) {
        TERES_TRY_ASSIGN(const auto file, series->finish());
        std::printf("  ParaView    %s\n", file.c_str());
    }
    if (unconverged > 0)
        return not_usable(std::to_string(unconverged) + " of " + std::to_string(times.size()) +
                          " frames did not converge (largest residual " + std::to_string(worst_residual) +
                          " of the applied force)");
    return kDone;
}

}  // namespace

void add_simulate_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<SimulateOptions>();
    CLI::App* verb =
        add_verb(app, exit_code, "simulate", "Forward simulation of a case with its prior ligament",
                 "  teres simulate config/cases/demo --predict points.csv --vtk vtk\n"
                 "  teres simulate CASE --set simulation.element=linear --set simulation.law=stvk\n"
                 "Exit code 1: a frame did not converge; 2: the case is malformed.",
                 [options] {
                     const Result<int> code = simulate(*options);
                     return code ? *code : report(code.error());
                 });
    verb->add_option("case", options->case_folder, "Case folder")->required()->type_name("CASE");
    verb->add_option("--predict", options->predict_file,
                     "Write t_s,point_id,x_m,y_m,z_m of the validation points")
        ->type_name("CSV");
    verb->add_option("--vtk", options->vtk_folder, "Write the deformed body for ParaView")->type_name("DIR");
    add_settings_options(*verb, options->settings);
}

}  // namespace teres::tools
