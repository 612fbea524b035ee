// teres estimate CASE: where the ligament holds and how stiff it is, with uncertainty; predicted motion of
// inner points.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/case/case_reader.h"
#include "core/case/surface.h"
#include "core/case/text_writer.h"
#include "core/case/vtk_writer.h"
#include "tools/commands.h"
#include "tools/estimation.h"
#include "tools/liver_picture.h"
#include "tools/plot.h"
#include "tools/position_table.h"
#include "tools/progress.h"

namespace teres::tools {
namespace {

struct EstimateOptions {
    std::string case_folder, json_file, predict_file, boundary = "estimated", plot_file, picture_file, vtk_folder;
    int passes = 0;
    SettingsOptions settings;
};

// Residuals five times what filter and noise together believe: the model does not describe this recording.
constexpr double kMaxNisPerDegree = 25.0;

// A value that does not exist is written as null.
nlohmann::ordered_json number(double value) {
    return std::isfinite(value) ? nlohmann::ordered_json(value) : nlohmann::ordered_json(nullptr);
}

nlohmann::ordered_json to_json(const Estimation& e, const std::string& name, bool estimated) {
    nlohmann::ordered_json json;
    json["format"] = "teres-estimate-1";
    json["case"] = name;
    json["frames"] = e.recording.size();
    json["parameters"] = nlohmann::ordered_json::array();
    for (const auto& p : e.parameters)
        json["parameters"].push_back({{"name", p.name},
                                      {"unit", p.unit},
                                      {"mean", number(p.mean)},
                                      {"stdev", number(p.stdev)},
                                      {"observability", number(p.observability)}});
    json["attachment"] = nlohmann::ordered_json::array();
    for (std::size_t k = 0; k < e.attachment_node.size(); ++k)
        json["attachment"].push_back({{"node_id", e.attachment_node[k]}, {"probability", e.attachment_probability[k]}});
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    json["marker_rms_mm"] = {{"prior", number(estimated ? 1e3 * e.prior.marker_rms_m : kNone)},
                             {"fixed", number(e.has_fixed ? 1e3 * e.fixed.marker_rms_m : kNone)},
                             {"estimated", number(estimated ? 1e3 * e.estimated.marker_rms_m : kNone)}};
    double nis = 0.0, dof = 0.0;
    std::size_t used = 0, stale = 0;
    for (const auto& f : e.frames) {
        stale += f.stale;
        if (f.degrees_of_freedom == 0) continue;
        nis += f.nis;
        dof += f.degrees_of_freedom;
        ++used;
    }
    json["nis_mean"] = number(used > 0 ? nis / static_cast<double>(used) : kNone);
    json["nis_degrees_of_freedom_mean"] = number(used > 0 ? dof / static_cast<double>(used) : kNone);
    json["frames_without_correction"] = stale;
    json["seconds_per_frame"] = e.seconds_per_frame;
    return json;
}

void print(const Estimation& e, const Case& c, bool estimated) {
    std::printf("%s: %zu frames, %zu markers, %zu tetrahedra\n", c.name.c_str(), e.recording.size(), c.markers.size(),
                c.mesh.tets.size());
    if (estimated) {
        std::printf("  %-28s %12s %12s %12s  %s\n", "unknown", "estimate", "stdev", "prior", "observed");
        for (const auto& p : e.parameters)
            std::printf("  %-28s %12.4g %12.3g %12.4g  %3.0f %%   [%s]\n", p.name.c_str(), p.mean, p.stdev,
                        p.prior_median, 100.0 * p.observability, p.unit.c_str());
        const auto holds = std::count_if(e.attachment_probability.begin(), e.attachment_probability.end(),
                                         [](double p) { return p >= 0.5; });
        std::printf("  attached (p >= 0.5): %td of %zu nodes of the prior region\n", holds, e.attachment_node.size());
    }
    std::printf("  markers, observed minus model (rms):");
    if (estimated) std::printf("  prior %.3f mm,", 1e3 * e.prior.marker_rms_m);
    if (e.has_fixed) std::printf("  atlas region fixed %.3f mm%s", 1e3 * e.fixed.marker_rms_m, estimated ? "," : "");
    if (estimated) std::printf("  estimated %.3f mm", 1e3 * e.estimated.marker_rms_m);
    std::printf("\n");
    if (estimated) std::printf("  filter: %.3f s per frame\n", e.seconds_per_frame);
}

Status save_parameter_plot(const Estimation& e, const std::string& name, const std::string& file) {
    Plot plot;
    plot.title = "Ligament stiffness with 3-sigma bands, case " + name;
    plot.x_label = "time [s]";
    plot.columns = e.parameters.size() > 4 ? 2 : 1;
    for (std::size_t p = 0; p < e.parameters.size(); ++p) {
        Curve filtered{"filter", {}, {}}, smoothed{"whole recording", {}, {}};
        smoothed.dashed = true;
        for (std::size_t k = 0; k < e.frames.size(); ++k) {
            filtered.x.push_back(e.recording[k].t_s);
            filtered.y.push_back(e.frames[k].mean[p]);
            filtered.sigma.push_back(e.frames[k].stdev[p]);
            smoothed.x.push_back(e.recording[k].t_s);
            smoothed.y.push_back(e.frames[k].smoothed[p]);
        }
        plot.panels.push_back({.title = e.parameters[p].name,
                               .y_label = "[" + e.parameters[p].unit + "]",
                               .log_y = true,
                               .curves = {filtered, smoothed},
                               .references = {{"prior", e.parameters[p].prior_median}}});
    }
    return save_plot(plot, file);
}

std::vector<double> probability_per_node(const Estimation& e, std::size_t nodes, double otherwise) {
    std::vector<double> value(nodes, otherwise);
    for (std::size_t k = 0; k < e.attachment_node.size(); ++k)
        value[static_cast<std::size_t>(e.attachment_node[k])] = e.attachment_probability[k];
    return value;
}

Status save_attachment_picture(const Estimation& e, const Case& c, const std::string& file) {
    LiverPicture picture;
    picture.title = "Where the ligament holds, case " + c.name;
    picture.value = probability_per_node(e, c.mesh.nodes.size(), std::numeric_limits<double>::quiet_NaN());
    for (const auto& marker : c.markers) picture.dots.push_back(marker.position_m);
    picture.views = default_views(c.mesh, c.sensor, picture.value);
    return save_liver_picture(picture, c.mesh, file);
}

Status save_vtk(const Estimation& e, const Motion& motion, const Case& c, const std::string& folder) {
    TERES_TRY_ASSIGN(VtkSeries series, VtkSeries::make(folder, "liver", c.mesh));
    const std::vector<double> probability = probability_per_node(e, c.mesh.nodes.size(), 0.0);
    // A ligament node's line runs along the outward normal to the far edge; without a ligament it has no
    // length.
    const Surface surface(c.mesh);
    const std::vector<Point> normals = surface.node_normals();
    const double height_m = c.ligament ? c.ligament->height_m : 0.0;
    const auto far_edge = [&](std::int32_t node) {
        Point anchor = c.mesh.nodes[static_cast<std::size_t>(node)];
        const auto at = std::lower_bound(surface.nodes().begin(), surface.nodes().end(), node);
        if (at == surface.nodes().end() || *at != node) return anchor;
        const Point& normal = normals[static_cast<std::size_t>(at - surface.nodes().begin())];
        for (std::size_t a = 0; a < 3; ++a) anchor[a] += height_m * normal[a];
        return anchor;
    };
    for (std::size_t k = 0; k < motion.body.size(); ++k) {
        std::vector<VtkSpring> ligament;
        for (std::size_t i = 0; i < e.attachment_node.size(); ++i)
            if (e.attachment_probability[i] >= 0.5)
                ligament.push_back({e.attachment_node[i], far_edge(e.attachment_node[i]), 0.0, 0.0});
        TERES_TRY(series.add({e.recording[k].t_s, motion.body[k], probability, ligament}));
    }
    const auto file = series.finish();
    return file ? Status{} : Status(tl::unexpected(file.error()));
}

Result<int> estimate(const EstimateOptions& options) {
    TERES_TRY_ASSIGN(const Config config, read_offline_settings(options.settings));
    const bool estimated = options.boundary == "estimated";
    EstimationOptions work;
    work.estimate = estimated;
    work.passes = options.passes;
    work.keep_body = !options.vtk_folder.empty();
    std::unique_ptr<Progress> bar;
    std::string stage;
    work.progress = [&](const char* name, std::size_t done, std::size_t total) {
        if (stage != name) {
            if (bar != nullptr) bar->finish();
            bar = std::make_unique<Progress>(name, total);
            stage = name;
        }
        bar->update(std::min(done, total));
    };
    auto result = estimate_case(options.case_folder, config, work);
    bar.reset();
    if (!result) return tl::unexpected(result.error());
    const Estimation& e = *result;
    TERES_TRY_ASSIGN(const Case c, read_case(options.case_folder));
    const Motion& motion = estimated ? e.estimated : e.fixed;

    print(e, c, estimated);
    if (!options.json_file.empty())
        TERES_TRY(write_text_file(options.json_file, to_json(e, c.name, estimated).dump(1) + "\n"));
    if (!options.predict_file.empty()) {
        PositionTable table;
        for (std::size_t k = 0; k < e.recording.size(); ++k)
            table.add(e.recording[k].t_s, e.point_id, motion.points[k]);
        TERES_TRY(table.write(options.predict_file));
    }
    if (!options.plot_file.empty() && estimated) TERES_TRY(save_parameter_plot(e, c.name, options.plot_file));
    if (!options.picture_file.empty()) TERES_TRY(save_attachment_picture(e, c, options.picture_file));
    if (!options.vtk_folder.empty()) TERES_TRY(save_vtk(e, motion, c, options.vtk_folder));

    std::size_t uncorrected = 0;
    double nis = 0.0, degrees = 0.0;
    for (const auto& f : e.frames) {
        uncorrected += f.stale;
        nis += f.nis;
        degrees += f.degrees_of_freedom;
    }
    if (estimated && 2 * uncorrected > e.frames.size())
        return not_usable(options.case_folder + ": " + std::to_string(uncorrected) + " of " +
                          std::to_string(e.frames.size()) +
                          " frames corrected nothing (no usable marker, or the simulation did not converge)");
    if (degrees > 0.0 && !(nis <= kMaxNisPerDegree * degrees))
        return not_usable(options.case_folder + ": the markers contradict the model: NIS / degrees of freedom is " +
                          std::to_string(nis / degrees) + " over the recording (1 is consistent, bound " +
                          std::to_string(kMaxNisPerDegree) + ")");
    if (2 * motion.frames_not_converged > e.recording.size())
        return not_usable(options.case_folder + ": " + std::to_string(motion.frames_not_converged) + " of " +
                          std::to_string(e.recording.size()) + " predicted frames did not converge");
    return kDone;
}

}  // namespace

void add_estimate_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<EstimateOptions>();
    CLI::App* verb = add_verb(
        app, exit_code, "estimate", "Boundary conditions of a recorded case: where the ligament holds, how stiff",
        "  teres estimate config/cases/demo --json estimate.json --predict points.csv\n"
        "  teres estimate CASE --plot parameters.png --picture attachment.png --vtk vtk\n"
        "  teres estimate CASE --bc atlas-fixed --predict fixed.csv      # for comparison\n"
        "  teres estimate CASE --set simulation.num_groups=12 --set estimator.sigma_points=star\n"
        "The recording runs through the same units as `teres run`; predictions use what the whole "
        "recording says of each\n"
        "frame. Exit code 1: the result is not usable (the reason is printed); 2: the case or a "
        "setting is malformed.",
        [options] {
            const Result<int> code = estimate(*options);
            return code ? *code : report(code.error());
        });
    verb->add_option("case", options->case_folder, "Case folder (teres-case-1)")->required()->type_name("CASE");
    verb->add_option("--json", options->json_file, "Write parameters, attachment probabilities and fit as JSON")
        ->type_name("FILE");
    verb->add_option("--predict", options->predict_file,
                     "Write t_s,point_id,x_m,y_m,z_m of the points of validation_rest.csv")
        ->type_name("CSV");
    verb->add_option("--bc", options->boundary,
                     "estimated: as found from the recording; atlas-fixed: atlas region held")
        ->check(CLI::IsMember({"estimated", "atlas-fixed"}))
        ->capture_default_str();
    verb->add_option("--passes", options->passes,
                     "Further passes over the recording, each linearised about the last (slower)")
        ->check(CLI::Range(0, 20))
        ->capture_default_str();
    verb->add_option("--plot", options->plot_file, "Draw the parameters over time with 3-sigma bands (PNG)")
        ->type_name("FILE");
    verb->add_option("--picture", options->picture_file, "Draw the liver coloured by attachment probability (PNG)")
        ->type_name("FILE");
    verb->add_option("--vtk", options->vtk_folder, "Write body, displacement and attachment per frame for ParaView")
        ->type_name("DIR");
    add_settings_options(*verb, options->settings);
}

}  // namespace teres::tools
