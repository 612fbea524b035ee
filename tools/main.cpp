// The `teres` program: one verb per file; exit codes 0 done, 1 result not usable, 2 wrong usage or input, 3
// host fault.
#include <cstdio>
#include <exception>

#include "tools/commands.h"
#include "tools/film_commands.h"

int main(int argc, char** argv) {
    using namespace teres::tools;
    try {
        int exit_code = kDone;
        CLI::App app{"Teres: what holds the liver, from camera frames to boundary conditions", "teres"};
        app.set_version_flag("--version", "teres " TERES_VERSION);
        app.require_subcommand(1);
        app.footer(
            "`teres VERB --help` explains a verb and gives examples.\n"
            "Exit codes: 0 done, 1 ran but the result is not usable, 2 wrong usage or input, 3 host or "
            "device fault.");
        add_atlas_command(app, exit_code);
        add_calibrate_springs_command(app, exit_code);
        add_mesh_command(app, exit_code);
        add_record_command(app, exit_code);
        add_replay_command(app, exit_code);
        add_run_command(app, exit_code);
        add_cut_command(app, exit_code);
        add_estimate_command(app, exit_code);
        add_diagnose_command(app, exit_code);
        add_effects_command(app, exit_code);
        add_settings_command(app, exit_code);
        add_bench_command(app, exit_code);
        add_bridge_command(app, exit_code);
        add_calibrate_camera_command(app, exit_code);
        add_register_command(app, exit_code);
        add_phantom_command(app, exit_code);
        add_film_score_command(app, exit_code);
        add_overlay_command(app, exit_code);
        add_doctor_command(app, exit_code);
        add_score_command(app, exit_code);
        add_blindtest_command(app, exit_code);
        add_spy_command(app, exit_code);
        add_simulate_command(app, exit_code);
        try {
            app.parse(argc, argv);
        } catch (const CLI::ParseError& error) {
            return app.exit(error) == 0 ? kDone : kUsageExit;
        }
        return exit_code;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "teres: %s\n", error.what());
        return kHostFaultExit;
    }
}
