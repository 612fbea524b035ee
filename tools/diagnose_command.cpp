// teres diagnose CASE...: where simulation and recording part, which missing effect is to blame, how far the gap
// closes. --live: the same of what the service's alarm points at.
#include <memory>

#include "tools/commands.h"
#include "tools/diagnose.h"

namespace teres::tools {

void add_diagnose_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<DiagnoseOptions>();
    CLI::App* verb = add_verb(
        app, exit_code, "diagnose",
        "The gap between simulation and recording: where, which missing effect, how far it shrinks",
        "  teres diagnose CASE --json gap.json --report report\n"
        "  teres diagnose --plan CASE                         # before recording: what could this reveal, what not?\n"
        "  teres diagnose CASE1 CASE2                         # one body: named on CASE1, predicted on CASE2\n"
        "  teres diagnose CASE --exclude viscoelasticity      # with an effect withheld from the catalogue\n"
        "  teres diagnose --live CASE -o /var/lib/teres/gaps   # waits for alarms of the service, diagnoses each "
        "window\n"
        "`none` (nothing beyond the floor) and `unknown` (no effect of the catalogue) are answers too.\n"
        "Exit code 1: a diagnosis cannot be made (the reason is printed); 2: a case, an effect or a setting is wrong.",
        [options] {
            if (options->live) return diagnose_live(*options);
            if (options->cases.empty())
                return report({ErrorKind::kInvalidInput, "diagnose: no CASE is given; see teres diagnose --help"});
            const Result<int> code = diagnose(*options);
            return code ? *code : report(code.error());
        });
    verb->add_option("case", options->cases, "Case folders (teres-case-1) of one body")->type_name("CASE");
    verb->add_option("--json", options->json_file, "Write the diagnosis as JSON (teres-gap-1)")->type_name("FILE");
    verb->add_option("--report", options->report_folder, "Write a report: index.html, its data as CSV, pictures")
        ->type_name("DIR");
    verb->add_option(
            "--predict", options->predict_file,
            "Write t_s,point_id,x_m,y_m,z_m of the points of validation_rest.csv with the named effects added and "
            "the model's own error as far as the recording shows it")
        ->type_name("CSV");
    verb->add_option("--predict-nominal", options->predict_nominal_file, "The same without any effect")
        ->type_name("CSV");
    verb->add_option("--exclude", options->excluded, "Leave an effect out of the catalogue; may be repeated")
        ->type_name("EFFECT")
        ->allow_extra_args(false);
    verb->add_flag("--plan", options->plan, "Only what geometry, markers and loads could reveal; observations unused");
    verb->add_option("--max-effects", options->max_effects, "Most effects at once")
        ->check(CLI::Range(1, 5))
        ->capture_default_str();
    verb->add_option("--cache", options->cache_folder, "Folder for what is computed once per body; \"\": none")
        ->type_name("DIR")
        ->capture_default_str();
    verb->add_flag(
        "--live", options->live,
        "Wait for alarms of GAP on the bus; keep each window as a case folder, its answer and report beside it");
    verb->add_option("-o,--output", options->folder, "--live: folder of the windows and their reports")
        ->type_name("DIR")
        ->capture_default_str();
    verb->add_option("--url", options->url, "--live: LCM URL of the bus, where no --config names it")
        ->envname("LCM_DEFAULT_URL")
        ->capture_default_str();
    verb->add_option("--before", options->before_s, "--live: [s] of the window before the onset")
        ->check(CLI::Range(1.0, 600.0))
        ->capture_default_str();
    verb->add_option("--after", options->after_s, "--live: [s] after it")
        ->check(CLI::Range(0.5, 600.0))
        ->capture_default_str();
    add_settings_options(*verb, options->settings);
}

}  // namespace teres::tools
