#include "tools/blindtest/trials.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>

#include "core/case/case_reader.h"
#include "core/case/geometry.h"
#include "core/case/text_file.h"
#include "core/case/text_writer.h"
#include "tools/score.h"

extern char** environ;

namespace teres::blindtest {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct Cost {
    int exit_code = -1;  ///< 128 + signal
    double seconds = 0.0, cpu_s = 0.0, peak_mb = 0.0;
};

// Runs a program to its end, its text in `log`. coreutils' timeout ends it at the limit.
Result<Cost> run(std::vector<std::string> words, const fs::path& log, double limit_s) {
    words.insert(words.begin(), {"timeout", std::to_string(limit_s)});
    posix_spawn_file_actions_t files;
    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_addopen(&files, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&files, 1, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    posix_spawn_file_actions_adddup2(&files, 1, 2);
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    const auto start = std::chrono::steady_clock::now();
    pid_t child = 0;
    const int failed = posix_spawnp(&child, argv[0], &files, nullptr, argv.data(), environ);
    posix_spawn_file_actions_destroy(&files);
    if (failed != 0) return host_fault(words[2] + " cannot be started");
    int status = 0;
    rusage before{}, after{};
    getrusage(RUSAGE_CHILDREN, &before);
    waitpid(child, &status, 0);
    getrusage(RUSAGE_CHILDREN, &after);
    Cost cost;
    cost.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    cost.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    const auto seconds = [](const timeval& t) {
        return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
    };
    cost.cpu_s =
        seconds(after.ru_utime) + seconds(after.ru_stime) - seconds(before.ru_utime) - seconds(before.ru_stime);
    cost.peak_mb = static_cast<double>(after.ru_maxrss) / 1024.0;  // largest of the children so far
    return cost;
}

fs::path answer_file(const fs::path& out, const CaseSpec& spec, const std::string& ending) {
    return out / "answers" / (spec.name + ending);
}

bool has_case(const CaseSpec& spec, const fs::path& out) {
    return fs::exists(out / "cases" / spec.name / "case.json");
}

Status diagnose(const CaseSpec& spec, const TrialOptions& o, const std::string& ending, std::vector<std::string> more) {
    const fs::path cost_file = answer_file(o.out, spec, ending + ".cost.json");
    if (fs::exists(cost_file)) return {};
    std::vector<std::string> words{o.program.string(), "diagnose", (o.out / "cases" / spec.name).string(), "--json",
                                   answer_file(o.out, spec, ending + ".json").string()};
    words.insert(words.end(), more.begin(), more.end());
    TERES_TRY_ASSIGN(const Cost cost, run(words, answer_file(o.out, spec, ending + ".log"), o.limit_s));
    return write_text_file(
        cost_file,
        Json{{"exit_code", cost.exit_code}, {"seconds", cost.seconds}, {"cpu_s", cost.cpu_s}, {"peak_mb", cost.peak_mb}}
                .dump() +
            "\n");
}

Result<Json> read_json(const fs::path& file) {
    TERES_TRY_ASSIGN(const std::string text, read_text_file(file));
    Json json = Json::parse(text, nullptr, false);
    if (json.is_discarded()) return invalid_input(file.string() + ": not JSON");
    return json;
}

// Nullopt: there is none, or none that can be read.
Result<std::optional<Answer>> read_answer(const fs::path& file, const AnswerChange& change) {
    auto text = read_text_file(file);
    if (!text) return std::nullopt;
    if (change) {
        auto changed = change(*text);
        if (!changed) return tl::unexpected(Error{changed.error().kind, file.string() + ": " + changed.error().text});
        text = std::move(changed);
    }
    auto answer = parse_answer(*text, file.string());
    return answer ? std::optional(std::move(*answer)) : std::nullopt;
}

std::optional<double> error_mm(const fs::path& prediction, const fs::path& truth) {
    const auto predicted = read_positions(prediction, "point_id", true), wanted = read_positions(truth, "point_id");
    if (!predicted || !wanted) return std::nullopt;
    const auto score = tools::score_prediction(*wanted, *predicted);
    if (!score || score->num_missing > 0 || score->num_positions == 0) return std::nullopt;
    return score->rms_mm;
}

}  // namespace

bool ready_to_score(const CaseSpec& spec, const fs::path& out) {
    return !has_case(spec, out) || fs::exists(answer_file(out, spec, ".cost.json"));
}

Status diagnose_case(const CaseSpec& spec, const TrialOptions& o) {
    if (!has_case(spec, o.out)) return {};  // discarded, or not made yet
    std::error_code failed;
    fs::create_directories(o.out / "answers", failed);
    if (failed) return host_fault((o.out / "answers").string() + ": " + failed.message());
    TERES_TRY(diagnose(spec, o, "",
                       {"--predict", answer_file(o.out, spec, ".csv").string(), "--predict-nominal",
                        answer_file(o.out, spec, ".nominal.csv").string()}));
    if (o.withheld && spec.effects.size() == 1)
        TERES_TRY(diagnose(spec, o, ".withheld", {"--exclude", spec.effects.front()}));
    return {};
}

Result<std::optional<CaseResult>> score_case(const CaseSpec& spec, const fs::path& out, const AnswerChange& change) {
    const fs::path sealed = out / "sealed" / spec.name;
    TERES_TRY_ASSIGN(const Json label, read_json(sealed / "label.json"));
    if (label.value("discarded", false)) return std::optional<CaseResult>{};
    if (!label.contains("effects") || !label.contains("gap_mm"))
        return invalid_input((sealed / "label.json").string() + ": no label");
    TERES_TRY_ASSIGN(const Case c, read_case(out / "cases" / spec.name, {.observations = false}));

    CaseResult r;
    r.name = spec.name;
    std::vector<std::string> ids;
    for (const Json& effect : label["effects"]) {
        ids.push_back(effect.value("id", ""));
        if (effect.contains("gap_mm")) r.gap_of_mm[ids.back()] = effect.value("gap_mm", 0.0);
    }
    r.truth = cause_name(ids);
    r.body = fmt::format("{}/{} {}{}", label.value("seed", std::uint64_t{0}), label.value("draw", 0),
                         label.value("clamped", false) ? "clamped" : "free",
                         label.value("dynamic", false) ? ", dynamic" : "");
    r.gap_nominal_mm = label["gap_mm"].value("nominal", 0.0);
    r.noise_mm = 1e3 * std::sqrt(3.0) * c.sensor.noise_sigma_m;
    TERES_TRY_ASSIGN(r.answer, read_answer(answer_file(out, spec, ".json"), change));
    TERES_TRY_ASSIGN(r.withheld, read_answer(answer_file(out, spec, ".withheld.json"), change));
    if (const auto cost = read_json(answer_file(out, spec, ".cost.json"))) {
        r.seconds = cost->value("seconds", 0.0);
        r.peak_mb = cost->value("peak_mb", 0.0);
    }
    if (!r.answer) return std::optional(r);
    if (ids.size() == 1) {
        const Json& effect = label["effects"][0];
        if (effect["center_m"].is_array()) {
            r.located = true;
            if (r.answer->center_m)
                r.place_error_mm = 1e3 * distance(*r.answer->center_m, effect["center_m"].get<Point>());
        }
        if (effect["onset_s"].is_number() && r.answer->onset_s)
            r.onset_error_s = *r.answer->onset_s - effect["onset_s"].get<double>();
    }
    const auto before = error_mm(answer_file(out, spec, ".nominal.csv"), sealed / "validation.csv");
    const auto after = error_mm(answer_file(out, spec, ".csv"), sealed / "validation.csv");
    if (before && after && *before > 0.0 && !ids.empty()) r.true_shrinkage = 1.0 - *after / *before;
    return std::optional(r);
}

}  // namespace teres::blindtest
