// teres atlas build|transfer|evaluate: where ligaments attach, learnt from annotated livers.
#include <algorithm>
#include <cstdio>
#include <memory>
#include <numbers>
#include <numeric>

#include "core/case/text_file.h"
#include "core/case/text_writer.h"
#include "tools/atlas/ligament_atlas.h"
#include "tools/commands.h"
#include "tools/plot.h"
#include "tools/progress.h"

namespace teres::tools {
namespace {

struct AtlasOptions {
    std::vector<std::string> folders, frames{"RAS"};
    std::string unit, output, atlas_folder, surface_file, ligament = "falciform", plot_file, stdev_file, source;
};

struct Livers {
    std::vector<AnnotatedLiver> livers;
    std::vector<int> origin;
};

Result<Livers> read_all(const AtlasOptions& o) {
    if (o.frames.size() != 1 && o.frames.size() != o.folders.size())
        return invalid_input(std::to_string(o.frames.size()) + " frames for " + std::to_string(o.folders.size()) +
                             " folders, expected one for all or one each");
    TERES_TRY_ASSIGN(const double unit_m, unit_in_m(o.unit));
    Livers all;
    for (std::size_t i = 0; i < o.folders.size(); ++i) {
        TERES_TRY_ASSIGN(auto livers,
                         read_annotated_livers(o.folders[i], unit_m, o.frames[o.frames.size() == 1 ? 0 : i]));
        for (auto& liver : livers) all.livers.push_back(std::move(liver));
        all.origin.resize(all.livers.size(), static_cast<int>(i));
    }
    return all;
}

Result<AtlasBuild> build_from(const Livers& all) {
    Progress progress("registering " + std::to_string(all.livers.size()) + " livers",
                      num_registrations(all.livers.size()));
    return build_atlas(all.livers, all.origin, [&] { progress.step(); });
}

void warn_of_spread(const AtlasLigament& l) {
    if (l.num_livers < kTrustedLivers)
        std::fprintf(stderr,
                     "teres: %s: an atlas of %d liver(s): its spread is not to be trusted (at least %d are "
                     "needed to measure it; "
                     "a bandwidth of %.0f mm is assumed)\n",
                     l.name.c_str(), l.num_livers, kTrustedLivers, 1e3 * l.bandwidth_m);
}

Result<int> build(const AtlasOptions& o) {
    TERES_TRY_ASSIGN(const Livers all, read_all(o));
    TERES_TRY_ASSIGN(AtlasBuild made, build_from(all));
    made.atlas.source = o.source;
    TERES_TRY(save_atlas(made.atlas, o.output));
    for (const AtlasLigament& l : made.atlas.ligaments) {
        std::printf("%-16s %2d livers, bandwidth %.1f mm\n", l.name.c_str(), l.num_livers, 1e3 * l.bandwidth_m);
        warn_of_spread(l);
    }
    return kDone;
}

Result<int> transfer(const AtlasOptions& o) {
    TERES_TRY_ASSIGN(const double unit_m, unit_in_m(o.unit));
    TERES_TRY_ASSIGN(const Eigen::Matrix3d to_ras, rotation_to_ras(o.frames[0]));
    TERES_TRY_ASSIGN(const LigamentAtlas atlas, load_atlas(o.atlas_folder));
    const AtlasLigament* ligament = atlas.find(o.ligament);
    if (ligament == nullptr) {
        std::string names;
        for (const auto& l : atlas.ligaments) names += (names.empty() ? "" : ", ") + l.name;
        return invalid_input(o.atlas_folder + ": no ligament '" + o.ligament + "', there are " + names);
    }
    TERES_TRY_ASSIGN(TriangleSurface surface, read_surface(o.surface_file, unit_m));
    TERES_TRY(check_liver(surface, o.surface_file, unit_m));
    surface.V = to_ras * surface.V;
    warn_of_spread(*ligament);
    TERES_TRY_ASSIGN(const Transfer result, transfer_atlas(atlas, *ligament, surface, o.surface_file));
    TextWriter csv, stdev;
    csv.line("node_id", "probability");
    stdev.line("node_id", "stdev");
    for (Eigen::Index v = 0; v < result.probability.size(); ++v) {
        csv.line(v, std::round(1e6 * result.probability[v]) * 1e-6);
        stdev.line(v, std::round(1e6 * result.stdev[v]) * 1e-6);
    }
    TERES_TRY(write_text_file(o.output, csv.text()));
    if (!o.stdev_file.empty()) TERES_TRY(write_text_file(o.stdev_file, stdev.text()));
    const Eigen::VectorXd area = vertex_areas(surface);
    const auto share = [&](double level) {
        return 1e4 * ((result.probability.array() >= level).cast<double>() * area.array()).sum();
    };
    std::printf("%s on %s: registered within %.2f mm (rms), turned by %.0f degrees\n", o.ligament.c_str(),
                o.surface_file.c_str(), 1e3 * result.registration_rms_m,
                result.rotation_rad * 180.0 / std::numbers::pi);
    std::printf("  expected strip (p >= %.1f) %.1f cm2, 90 %% region (p >= %.1f) %.1f cm2 of %.0f cm2\n", kStripLevel,
                share(kStripLevel), kRegionLevel, share(kRegionLevel), 1e4 * area.sum());
    return kDone;
}

// Left: distances and coverage per liver. Right: stated against observed share.
Status save_evaluation(const std::vector<HeldOutLiver>& results, const std::string& ligament, const std::string& file) {
    Plot plot;
    plot.title = "Atlas, leave-one-out over " + std::to_string(results.size()) + " livers: " + ligament;
    plot.x_label = "share of the true attachment nodes / stated level";
    std::vector<double> all, levels;
    for (const auto& r : results) {
        all.insert(all.end(), r.distances_mm.begin(), r.distances_mm.end());
        levels.insert(levels.end(), r.levels.begin(), r.levels.end());
    }
    std::sort(all.begin(), all.end());
    std::sort(levels.begin(), levels.end());
    Curve distance{"all livers", {}, {}}, coverage{"observed", {}, {}}, ideal{"ideal", {0.0, 1.0}, {0.0, 1.0}};
    ideal.dashed = true;
    const auto n = static_cast<double>(all.size());
    for (std::size_t i = 0; i < all.size(); ++i) {
        distance.x.push_back((static_cast<double>(i) + 1.0) / n);
        distance.y.push_back(all[i]);
        // the region {p >= level} is stated to hold 1 - level
        coverage.x.push_back(1.0 - levels[all.size() - 1 - i]);
        coverage.y.push_back((static_cast<double>(i) + 1.0) / n);
    }
    plot.panels.push_back({.title = "true attachment to expected strip",
                           .y_label = "distance [mm]",
                           .from_zero = true,
                           .curves = {distance}});
    plot.panels.push_back({.title = "region of stated level",
                           .y_label = "share of true nodes inside",
                           .from_zero = true,
                           .curves = {coverage, ideal}});
    plot.columns = 2;
    return save_plot(plot, file);
}

Result<int> evaluate(const AtlasOptions& o) {
    TERES_TRY_ASSIGN(const Livers all, read_all(o));
    TERES_TRY_ASSIGN(const AtlasBuild made, build_from(all));
    const auto who = made.carriers.find(o.ligament);
    if (who == made.carriers.end() || who->second.size() < 3)
        return invalid_input("leave-one-out needs at least 3 livers with '" + o.ligament + "', there are " +
                             std::to_string(who == made.carriers.end() ? 0 : who->second.size()));
    const auto results = leave_one_out(made, all.livers, o.ligament);
    std::vector<double> distances;
    double line = 0.0, coverage = 0.0, region = 0.0;
    std::printf(
        "| liver | to the expected strip, mean / 95 %% [mm] | to the most probable line [mm] | in the 90 %% "
        "region | region, share of the surface | bandwidth [mm] |\n|---|---|---|---|---|---|\n");
    for (const auto& r : results) {
        std::printf("| %s | %.1f / %.1f | %.1f | %.0f %% | %.1f %% | %.1f |\n", r.name.c_str(), r.mean_mm, r.p95_mm,
                    r.line_mm, 100.0 * r.coverage, 100.0 * r.region_share, 1e3 * r.bandwidth_m);
        const auto nodes = static_cast<double>(r.distances_mm.size());
        distances.insert(distances.end(), r.distances_mm.begin(), r.distances_mm.end());
        line += r.line_mm * nodes;
        coverage += r.coverage * nodes;
        region += r.region_share / static_cast<double>(results.size());
    }
    std::sort(distances.begin(), distances.end());
    const auto n = static_cast<double>(distances.size());
    std::printf("| **all** | **%.1f / %.1f** | %.1f | **%.0f %%** | %.1f %% | |\n",
                std::accumulate(distances.begin(), distances.end(), 0.0) / n,
                distances[static_cast<std::size_t>(0.95 * (n - 1.0) + 0.5)], line / n, 100.0 * coverage / n,
                100.0 * region);
    if (!o.plot_file.empty()) TERES_TRY(save_evaluation(results, o.ligament, o.plot_file));
    return kDone;
}

CLI::App* add_sub(CLI::App& verb, int& exit_code, const std::shared_ptr<AtlasOptions>& o, const char* name,
                  const char* summary, const char* examples, Result<int> (*run)(const AtlasOptions&)) {
    return add_verb(verb, exit_code, name, summary, examples, [o, run] {
        const Result<int> code = run(*o);
        return code ? *code : report(code.error());
    });
}

void add_folders(CLI::App& verb, AtlasOptions& o) {
    verb.add_option("livers", o.folders,
                    "Folders of annotated livers: mesh/NAME.obj with landmarks/NAME.csv (class,v0,v1), or "
                    "NAME/whole_liver.obj "
                    "with NAME/vertex_distance_mm.csv; a ligament comes from the first folder that has it")
        ->required()
        ->type_name("DIR");
    verb.add_option("--unit", o.unit, "Unit of the surfaces: m, cm or mm")->default_val("mm");
    verb.add_option("--frame", o.frames, "Where +x, +y, +z point, one for all folders or one each: R/L, A/P, S/I")
        ->delimiter(',')
        ->type_name("FRAME[,FRAME]");
}

}  // namespace

void add_atlas_command(CLI::App& app, int& exit_code) {
    CLI::App* verb =
        app.add_subcommand("atlas", "where ligaments attach: build an atlas, carry it to a liver, measure it");
    verb->require_subcommand(1);
    verb->footer(
        "Examples:\n  teres atlas build livers15 -o atlas\n  teres atlas transfer atlas liver.stl --unit mm -o "
        "ligament_prior.csv\n  teres atlas evaluate livers15 --plot evaluation.png");
    auto o = std::make_shared<AtlasOptions>();

    CLI::App* sub = add_sub(*verb, exit_code, o, "build", "atlas from annotated livers",
                            "  teres atlas build livers15 -o atlas\n"
                            "  teres atlas build livers15 reference --frame RAS,LSA -o atlas",
                            build);
    add_folders(*sub, *o);
    sub->add_option("-o,--output", o->output, "Folder of the atlas")->required()->type_name("DIR");
    sub->add_option("--source", o->source, "Origin and licence of the livers, kept in atlas.json")->type_name("TEXT");

    sub =
        add_sub(*verb, exit_code, o, "transfer", "probability that a ligament attaches, per vertex of a liver surface",
                "  teres atlas transfer atlas liver.stl --unit mm -o ligament_prior.csv\n"
                "  teres atlas transfer atlas liver.obj --unit m --ligament coronary -o coronary.csv\n"
                "The surface is closed and lies within 30 degrees of the frame. p >= 0.5: expected strip, "
                "p >= 0.1: the\n"
                "region that holds 90 % of the attachment.",
                transfer);
    sub->add_option("atlas", o->atlas_folder, "Folder made by `teres atlas build`")->required()->type_name("ATLAS");
    sub->add_option("surface", o->surface_file, "Closed triangle surface: .obj .stl .ply .vtk")
        ->required()
        ->type_name("SURFACE");
    sub->add_option("--unit", o->unit, "Unit of the surface: m, cm or mm")->required();
    sub->add_option("--frame", o->frames[0], "Where +x, +y, +z of the surface point: R/L, A/P, S/I")
        ->capture_default_str();
    sub->add_option("--ligament", o->ligament, "Which one")->capture_default_str();
    sub->add_option("-o,--output", o->output, "node_id,probability for the vertices in the file's order")
        ->required()
        ->type_name("CSV");
    sub->add_option("--stdev", o->stdev_file,
                    "node_id,stdev: uncertainty of the probability (jackknife over the livers)")
        ->type_name("CSV");

    sub = add_sub(*verb, exit_code, o, "evaluate",
                  "leave-one-out: distance to the expected strip, coverage of the 90 % region",
                  "  teres atlas evaluate livers15 --plot atlas.png\n"
                  "Each liver is predicted from the labels of the others; the common shape is that of all.",
                  evaluate);
    add_folders(*sub, *o);
    sub->add_option("--ligament", o->ligament, "Which one")->capture_default_str();
    sub->add_option("--plot", o->plot_file, "PNG")->type_name("FILE");
}

}  // namespace teres::tools
