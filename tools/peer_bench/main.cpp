// teres-peer-bench: recorded filter runs of a peer, made again by our own modules (tools/peer-bench finds or
// builds it).
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "tools/peer_bench/report.h"

int main(int argc, char** argv) {
    using namespace teres;
    CLI::App app{
        "Runs recorded filter benchmarks of a peer from their scene.json and compares the estimated "
        "state.\n\n"
        "Examples:\n"
        "  tools/peer-bench peer/*/\n"
        "  tools/peer-bench peer/liver_cut_ligament --json out.json --own"};
    app.name("peer-bench");
    std::vector<std::string> folders;
    std::string json_file;
    peer::BenchOptions options;
    app.add_option("FOLDER", folders, "folders with scene.json")->required();
    app.add_option("--json", json_file, "write the result as JSON");
    app.add_flag("--own", options.own, "also run our own filter on the same observations");
    app.add_flag("--own-only", options.own_only, "run our own filter only");
    app.add_flag("--verbose", options.verbose, "more numbers: largest difference of each tenth of the run");
    app.add_option("--rows", options.max_rows, "compare only the first rows (0: all)")->check(CLI::NonNegativeNumber);
    app.add_option("--threads", options.threads, "threads for the sigma points (0: as many as cores, at most 8)")
        ->check(CLI::Range(0, 64));
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& e) {
        return app.exit(e) == 0 ? 0 : 2;
    }
    if (options.threads == 0) options.threads = std::clamp<std::size_t>(std::thread::hardware_concurrency(), 1, 8);
    nlohmann::ordered_json out{{"folders", nlohmann::ordered_json::array()}};
    int worst = 0;
    for (const auto& folder : folders) {
        auto report = peer::run_folder(folder, options);
        if (!report) {
            std::fprintf(stderr, "peer-bench: %s\n", report.error().text.c_str());
            worst = std::max(worst, static_cast<int>(report.error().kind));
            continue;
        }
        std::fputs(peer::table_of(*report, options.verbose).c_str(), stdout);
        std::fflush(stdout);
        out["folders"].push_back(peer::json_of(*report));
        if (!report->reached) worst = std::max(worst, 1);
    }
    if (!json_file.empty()) {
        std::ofstream file(json_file);
        file << out.dump(1) << "\n";
        file.close();
        if (!file) {
            std::fprintf(stderr, "peer-bench: cannot write %s\n", json_file.c_str());
            return 3;
        }
    }
    return worst;
}
