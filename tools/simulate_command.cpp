// teres simulate CASE: the forward model alone, with the case's loads and the prior's ligament, no
// observations used.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>

#include "core/case/case_reader.h"
#include "core/case/frame_times.h"
#include "core/case/load_tracks.h"
#include "core/case/mesh_checks.h"
#include "core/case/vtk_writer.h"
#include "core/extensions/forward_model.h"
#include "core/extensions/trajectory_model.h"
#include "core/session.h"
#include "tools/commands.h"
#include "tools/effect_options.h"
#include "tools/position_table.h"
#include "tools/progress.h"

namespace teres::tools {
namespace {

constexpr double kFarAway = 5.0;  // body sizes: no motion of a body that something holds

struct SimulateOptions {
    std::string case_folder, predict_file, markers_file, vtk_folder;
    std::vector<std::string> effects;
    SettingsOptions settings;
};

/// Positions of every frame: 3 per validation point, marker and mesh node.
struct Motion {
    std::vector<std::int32_t> point_id, marker_id;
    std::vector<double> points_m, markers_m, nodes_m;
    std::size_t unknowns = 0, unconverged = 0;
    double worst_residual = 0.0;
};

// The ordinary forward model, frame by frame.
Result<Motion> play(ForwardModel& model, const Case& c, const std::vector<double>& times) {
    Motion motion;
    motion.unknowns = model.num_parameters();
    std::vector<double> theta(model.num_parameters());
    for (std::size_t p = 0; p < theta.size(); ++p) theta[p] = model.parameter(p).prior_median;
    for (std::size_t k = 0; k < model.num_points(); ++k) motion.point_id.push_back(model.point_id(k));
    for (std::size_t k = 0; k < model.num_markers(); ++k) motion.marker_id.push_back(model.marker_id(k));
    std::vector<double> x(model.num_state()), points(3 * model.num_points()), markers(3 * model.num_markers());
    model.rest_state(x);

    const LoadTracks tracks(c);
    tool_loads_t loads;
    std::vector<double> force(3 * c.load_regions.size()), tool(3 * c.tools.size());
    Progress progress("simulating", times.size());
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
            const double dt = k > 0 ? times[k] - times[k - 1] : c.dt_s;
            const ForwardReport report = model.advance({times[k], dt, force, tool}, theta, x, 1);
            motion.unconverged += report.lanes_converged < 1;
            motion.worst_residual = std::max(motion.worst_residual, report.relative_residual);
        }
        model.predict_points(x, points);
        model.observe(x, markers, 1);
        motion.points_m.insert(motion.points_m.end(), points.begin(), points.end());
        motion.markers_m.insert(motion.markers_m.end(), markers.begin(), markers.end());
        motion.nodes_m.insert(motion.nodes_m.end(), x.begin(),
                              x.begin() + static_cast<std::ptrdiff_t>(3 * c.mesh.nodes.size()));
        progress.step();
    }
    progress.finish();
    return motion;
}

// The whole recording under effects: those of the mechanics move the body, those of the sensor its markers.
Result<Motion> play_with_effects(TrajectoryModel& model, const ObservationModel& sensor,
                                 const std::vector<std::string>& texts) {
    std::vector<ChosenEffect> chosen;
    for (const auto& text : texts) {
        TERES_TRY_ASSIGN(ChosenEffect effect, parse_effect(text, model, sensor));
        chosen.push_back(std::move(effect));
    }
    const std::size_t frames = model.num_frames();
    Motion motion;
    motion.unknowns = model.num_parameters();
    std::vector<double> theta, times;
    for (std::size_t p = 0; p < model.num_parameters(); ++p)
        theta.push_back(std::exp(model.parameter(p).prior_log_mean));
    for (std::size_t f = 0; f < frames; ++f) times.push_back(model.time_s(f));
    for (std::size_t k = 0; k < model.num_points(); ++k) motion.point_id.push_back(model.point_id(k));
    for (std::size_t k = 0; k < model.num_markers(); ++k) motion.marker_id.push_back(model.marker_id(k));
    motion.points_m.resize(frames * 3 * model.num_points());
    motion.markers_m.resize(frames * 3 * model.num_markers());
    motion.nodes_m.resize(frames * 3 * model.num_nodes());
    const auto mechanics = instances(chosen, false), seen = instances(chosen, true);
    const TrajectoryReport report =
        model.simulate({theta, mechanics}, motion.markers_m, motion.points_m, motion.nodes_m);
    const std::vector<double> truth = motion.markers_m;
    sensor.observe(seen, times, truth, motion.markers_m);
    motion.unconverged = static_cast<std::size_t>(report.frames - report.frames_converged);
    motion.worst_residual = report.relative_residual;
    return motion;
}

PositionTable table_of(const std::vector<double>& times, const std::vector<std::int32_t>& ids,
                       const std::vector<double>& xyz, const char* id_column) {
    PositionTable table(id_column);
    for (std::size_t k = 0; k < times.size(); ++k)
        table.add(times[k], ids, std::span<const double>(xyz).subspan(k * 3 * ids.size(), 3 * ids.size()));
    return table;
}

Result<int> simulate(const SimulateOptions& options) {
    const bool effects = !options.effects.empty();
    TERES_TRY_ASSIGN(Config config, read_offline_settings(options.settings));
    TERES_TRY(config.set("service.case=" + options.case_folder));
    TERES_TRY(config.set("service.drivers="));
    TERES_TRY(config.set(effects ? "service.plugins=simulation,sensor_model" : "service.plugins=simulation"));
    if (effects) TERES_TRY(config.set("simulation.trajectories=true"));
    TERES_TRY_ASSIGN(const Case c, read_case(options.case_folder));
    TERES_TRY_ASSIGN(const std::unique_ptr<Session> session, Session::open(config));
    TERES_TRY(session->start());
    auto* model = session->extension<ForwardModel>();
    auto* trajectory = session->extension<TrajectoryModel>();
    auto* sensor = session->extension<ObservationModel>();
    if (model == nullptr || (effects && (trajectory == nullptr || sensor == nullptr)))
        return host_fault("the plugins do not offer the models that simulate needs");

    const std::vector<double> times = frame_times(c);
    TERES_TRY_ASSIGN(const Motion motion,
                     effects ? play_with_effects(*trajectory, *sensor, options.effects) : play(*model, c, times));
    double largest_m = 0.0;
    const std::size_t nodes = c.mesh.nodes.size();
    for (std::size_t k = 0; k < times.size() * nodes; ++k) {
        const Point& rest = c.mesh.nodes[k % nodes];
        const double* x = &motion.nodes_m[3 * k];
        largest_m = std::max(largest_m, std::hypot(x[0] - rest[0], x[1] - rest[1], x[2] - rest[2]));
    }
    std::printf("%s: %zu frames, %zu nodes, %zu ligament unknowns at their prior medians\n", c.name.c_str(),
                times.size(), nodes, motion.unknowns);
    for (const auto& effect : options.effects) std::printf("  effect      %s\n", effect.c_str());
    std::printf("  largest displacement %9.3f mm\n  largest residual     %9.2e of the applied force\n", 1e3 * largest_m,
                motion.worst_residual);
    if (const double size = size_m(c.mesh); !(largest_m <= kFarAway * size))
        std::fprintf(
            stderr,
            "%s: largest displacement %.3g m is %.3g times the body's size of %.3g m: nothing holds it, or its "
            "steps are too long (simulation.max_step_s)\n",
            c.name.c_str(), largest_m, largest_m / size, size);
    if (!options.predict_file.empty()) {
        TERES_TRY(table_of(times, motion.point_id, motion.points_m, "point_id").write(options.predict_file));
        std::printf("  points      %s\n", options.predict_file.c_str());
    }
    if (!options.markers_file.empty()) {
        TERES_TRY(table_of(times, motion.marker_id, motion.markers_m, "marker_id").write(options.markers_file));
        std::printf("  markers     %s\n", options.markers_file.c_str());
    }
    if (!options.vtk_folder.empty()) {
        TERES_TRY_ASSIGN(VtkSeries series, VtkSeries::make(options.vtk_folder, "body", c.mesh));
        for (std::size_t k = 0; k < times.size(); ++k)
            TERES_TRY(series.add(
                {times[k], std::span<const double>(motion.nodes_m).subspan(k * 3 * nodes, 3 * nodes), {}, {}}));
        TERES_TRY_ASSIGN(const auto file, series.finish());
        std::printf("  ParaView    %s\n", file.c_str());
    }
    if (motion.unconverged > 0)
        return not_usable(std::to_string(motion.unconverged) + " of " + std::to_string(times.size()) +
                          " frames did not converge (largest residual " + std::to_string(motion.worst_residual) +
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
                 "  teres simulate CASE --effect stiffness:factor=0.5 --effect latency:delay=0.1 --markers seen.csv\n"
                 "Exit code 1: a frame did not converge; 2: the case is malformed.",
                 [options] {
                     const Result<int> code = simulate(*options);
                     return code ? *code : report(code.error());
                 });
    verb->add_option("case", options->case_folder, "Case folder")->required()->type_name("CASE");
    verb->add_option("--predict", options->predict_file, "Write t_s,point_id,x_m,y_m,z_m of the validation points")
        ->type_name("CSV");
    verb->add_option("--markers", options->markers_file, "Write t_s,marker_id,x_m,y_m,z_m as the camera sees them")
        ->type_name("CSV");
    verb->add_option("--effect", options->effects, "Switch an effect on (teres effects lists them); may be repeated")
        ->type_name("ID[:NAME=VALUE,...]")
        ->allow_extra_args(false);
    verb->add_option("--vtk", options->vtk_folder, "Write the deformed body for ParaView")->type_name("DIR");
    add_settings_options(*verb, options->settings);
}

}  // namespace teres::tools
