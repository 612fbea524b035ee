// teres calibrate-springs: the law of cubic springs from a ligament's material.
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/case/text_writer.h"
#include "tools/commands.h"
#include "tools/plot.h"
#include "tools/progress.h"
#include "tools/springs/spring_sheet.h"

namespace teres::tools {
namespace {

namespace fs = std::filesystem;

constexpr double kUsableError_mm = 2.4;  // Nikolaev & Cotin 2020, section 2.3: the paper's springs
constexpr double kLimit_s = 1200.0;      // of processor time per sheet

struct CalibrateOptions {
    std::vector<double> youngs_modulus_pa;
    std::vector<std::string> curves;
    std::string json_file, plot_file;
    std::vector<double> size_mm{40.0, 100.0, 1.0};
    double poissons_ratio = 0.48;
    Sheet sheet;
};

class ScratchFolder {
  public:
    ScratchFolder() {
        std::string name = (fs::temp_directory_path() / "teres-sheet-XXXXXX").string();
        if (mkdtemp(name.data()) != nullptr) path = name;
    }
    ~ScratchFolder() {
        std::error_code ignored;
        if (!path.empty()) fs::remove_all(path, ignored);
    }
    ScratchFolder(const ScratchFolder&) = delete;
    ScratchFolder& operator=(const ScratchFolder&) = delete;
    fs::path path;
};

nlohmann::json as_json(const SheetMaterial& m, const Sheet& sheet, const SheetPath& truth, const CalibrationResult& r) {
    const double E = m.youngs_modulus_pa();
    return {{"material", m.name},
            {"youngs_modulus_pa", E},
            {"yeoh_pa", {m.c1_pa, m.c2_pa, m.c3_pa}},
            {"load_n", sheet.load_n(m)},
            {"spring_law", {{"g1", r.law.g1}, {"g2", r.law.g2}, {"g3", r.law.g3}, {"diagonal_share", r.law.diagonal}}},
            {"stdev",
             {{"ln_g1", r.stdev(0)}, {"q", r.stdev(1)}, {"ln_g3", r.stdev(2)}, {"logit_diagonal_share", r.stdev(3)}}},
            {"error_mm",
             {{"mean", r.mean_error_mm},
              {"p95", r.p95_error_mm},
              {"max", r.max_error_mm},
              {"mean_at_full_load", r.last_error_mm}}},
            {"rounds", r.rounds},
            {"finite_elements", truth.elements},
            {"finite_element_seconds", truth.seconds},
            {"spring_seconds", r.seconds},
            {"times_faster", truth.seconds / r.seconds}};
}

void add_panels(Plot& plot, const SheetMaterial& m, const Sheet& sheet, const SheetPath& truth,
                const CalibrationResult& r) {
    char load_text[32];
    std::snprintf(load_text, sizeof load_text, ", to %.4g N", sheet.load_n(m));
    Panel force{.title = m.name + load_text, .y_label = "edge displacement [mm]"};
    Panel error{.title = m.name + ": mean distance of the edge nodes", .y_label = "[mm]", .from_zero = true};
    Curve sheet_middle{"sheet, middle of the edge", {}, {}}, sheet_corner{"sheet, corner inwards", {}, {}};
    Curve spring_middle{"springs, middle of the edge", {}, {}}, spring_corner{"springs, corner inwards", {}, {}};
    Curve distance{"", {}, {}};
    const Eigen::Matrix3Xd X = edge_at_rest(sheet);
    const Eigen::Index middle = X.cols() / 2;
    const auto add = [](Curve& c, double x, double y) {
        c.x.push_back(x);
        c.y.push_back(1e3 * y);
    };
    for (std::size_t s = 0; s < truth.edge_m.size(); ++s) {
        const double load = 100.0 * truth.load_share[s];
        const auto &t = truth.edge_m[s], &x = r.edge_m[s];
        add(sheet_middle, load, t(0, middle) - X(0, middle));
        add(spring_middle, load, x(0, middle) - X(0, middle));
        add(sheet_corner, load, t(1, 0) - X(1, 0));
        add(spring_corner, load, x(1, 0) - X(1, 0));
        add(distance, load, (x - t).colwise().norm().mean());
    }
    spring_middle.dashed = spring_corner.dashed = true;
    force.curves = {sheet_middle, spring_middle, sheet_corner, spring_corner};
    error.curves = {distance};
    plot.panels.push_back(force);
    plot.panels.push_back(error);
}

Result<int> calibrate_springs(CalibrateOptions& o) {
    Sheet& sheet = o.sheet;
    sheet.width_m = 1e-3 * o.size_mm[0];
    sheet.length_m = 1e-3 * o.size_mm[1];
    sheet.thickness_m = 1e-3 * o.size_mm[2];
    std::vector<SheetMaterial> materials;
    for (const double E : o.youngs_modulus_pa) materials.push_back(neo_hookean_sheet(E, o.poissons_ratio));
    for (const auto& file : o.curves) {
        TERES_TRY_ASSIGN(SheetMaterial m, sheet_of_curve(file, o.poissons_ratio, sheet.strain));
        materials.push_back(m);
    }
    if (materials.empty()) return invalid_input("calibrate-springs: neither --youngs-modulus nor --curve is given");
    const ScratchFolder scratch;
    if (scratch.path.empty()) return host_fault("cannot make a folder in " + fs::temp_directory_path().string());
    Plot plot{.title = "Two layers of cubic springs against a sheet of finite elements",
              .x_label = "load [% of the largest]",
              .columns = 2};
    nlohmann::json results = nlohmann::json::array();
    double worst = 0.0;
    Progress progress("sheets", materials.size());
    for (const SheetMaterial& m : materials) {
        TERES_TRY_ASSIGN(const SheetPath truth,
                         stretch_sheet(sheet, m, scratch.path / std::to_string(results.size()), kLimit_s));
        TERES_TRY_ASSIGN(const CalibrationResult r, calibrate(sheet, m, truth));
        results.push_back(as_json(m, sheet, truth, r));
        add_panels(plot, m, sheet, truth, r);
        worst = std::max(worst, r.mean_error_mm);
        progress.step();
        std::printf("%s: T = E A/L (%.3f e %+.3f e^2 %+.3f e^3), %.0f %% in diagonals\n", m.name.c_str(), r.law.g1,
                    r.law.g2, r.law.g3, 100.0 * r.law.diagonal);
        std::printf(
            "  edge nodes to %.0f %% strain: mean %.2f mm, 95 %% %.2f mm, largest %.2f mm; at full load %.2f mm\n",
            100.0 * sheet.strain, r.mean_error_mm, r.p95_error_mm, r.max_error_mm, r.last_error_mm);
        if (r.law.g1 > 0.0)
            std::printf(
                "  in the simulation: --set simulation.spring_g1=%.4g --set simulation.spring_g2=%.4g --set "
                "simulation.spring_g3=%.4g\n",
                r.law.g1, r.law.g2, r.law.g3);
        std::printf("  sheet of %zu wedges %.2f s, springs %.2f ms: %.0f times faster\n", truth.elements, truth.seconds,
                    1e3 * r.seconds, truth.seconds / r.seconds);
    }
    if (!o.json_file.empty())
        TERES_TRY(
            write_text_file(o.json_file, nlohmann::json{{"format", "teres-springs-1"},
                                                        {"sheet_m", {sheet.width_m, sheet.length_m, sheet.thickness_m}},
                                                        {"strain", sheet.strain},
                                                        {"edge_nodes", sheet.columns},
                                                        {"results", results}}
                                                 .dump(2) +
                                             "\n"));
    if (!o.plot_file.empty()) TERES_TRY(save_plot(plot, o.plot_file));
    if (worst > kUsableError_mm)
        return not_usable("the springs miss a sheet by " + std::to_string(worst) +
                          " mm on average, at most 2.4 mm is usable");
    return kDone;
}

}  // namespace

void add_calibrate_springs_command(CLI::App& app, int& exit_code) {
    auto o = std::make_shared<CalibrateOptions>();
    CLI::App* verb =
        add_verb(app, exit_code, "calibrate-springs", "law of two-layer cubic springs from a ligament's material",
                 "  teres calibrate-springs --youngs-modulus 5e6\n"
                 "  teres calibrate-springs --youngs-modulus 5e6 300e6 --json springs.json --plot springs.png\n"
                 "  teres calibrate-springs --curve falciform.csv --strain 0.3     # columns strain,stress_pa\n"
                 "A sheet of this material is stretched by CalculiX (program ccx) as the truth; the springs' law is\n"
                 "assimilated from the motion of its edge. e: strain of a layer, A, L: cross-section, length.",
                 [o] {
                     const Result<int> code = calibrate_springs(*o);
                     return code ? *code : report(code.error());
                 });
    verb->add_option("--youngs-modulus", o->youngs_modulus_pa, "Neo-Hookean sheets of these moduli at rest [Pa]")
        ->check(CLI::Range(1e3, 1e10));
    verb->add_option("--curve", o->curves, "Sheets of these nominal stress-strain curves: CSV strain,stress_pa")
        ->type_name("FILE");
    verb->add_option("--size", o->size_mm, "Width, length (pulled) and thickness [mm]")
        ->expected(3)
        ->check(CLI::Range(0.05, 1000.0))
        ->capture_default_str();
    verb->add_option("--strain", o->sheet.strain, "Largest strain of the load")
        ->check(CLI::Range(0.01, 1.0))
        ->capture_default_str();
    verb->add_option("--poissons-ratio", o->poissons_ratio, "Of the sheet")
        ->check(CLI::Range(0.0, 0.499))
        ->capture_default_str();
    verb->add_option("--nodes", o->sheet.columns, "Edge nodes that carry springs")
        ->check(CLI::Range(2, 24))
        ->capture_default_str();
    verb->add_option("--cells", o->sheet.cells_per_column, "Elements of the sheet between two of them")
        ->check(CLI::Range(1, 20))
        ->capture_default_str();
    verb->add_option("--steps", o->sheet.steps, "Load steps")->check(CLI::Range(2, 1000))->capture_default_str();
    verb->add_option("--json", o->json_file, "Write laws and errors")->type_name("FILE");
    verb->add_option("--plot", o->plot_file, "Draw sheet and springs over the load")->type_name("PNG");
}

}  // namespace teres::tools
