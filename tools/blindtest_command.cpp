// teres blindtest: sealed cases from CalculiX, diagnosed, opened, scored.
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "core/case/case_reader.h"
#include "core/case/text_file.h"
#include "core/case/text_writer.h"
#include "tools/blindtest/case_maker.h"
#include "tools/blindtest/plan.h"
#include "tools/blindtest/score_report.h"
#include "tools/blindtest/scoring.h"
#include "tools/blindtest/trials.h"
#include "tools/commands.h"
#include "tools/diagnosis_run.h"
#include "tools/progress.h"

namespace teres::tools {
namespace {

namespace fs = std::filesystem;
using namespace teres::blindtest;

struct BlindtestOptions {
    std::string stage = "all", out = "blindtest", shard = "0/1", plots, body;
    std::vector<std::string> files;
    PlanOptions plan;
    TrialOptions trial;
    double floor_mm = 0.0;  // 0: from the controls
    double least_gap_mm = 0.0;
    bool keep = false, again = false;
    std::shared_ptr<const Case> given;
};

std::string shard_name(const PlanOptions& plan) {
    return std::to_string(plan.shard) + "-of-" + std::to_string(plan.shards);
}

Status read_shard(const std::string& text, PlanOptions& plan) {
    char rest = 0;
    if (std::sscanf(text.c_str(), "%d/%d%c", &plan.shard, &plan.shards, &rest) != 2)
        return invalid_input("--shard " + text + ": must be i/n, e.g. 0/4");
    return {};
}

// The truth of a given body: edges of about 20 mm in an adult's liver, as in the drawn ones.
constexpr double kGivenTruthTets = 1600.0;

Status read_body(BlindtestOptions& o) {
    if (o.body.empty()) return {};
    TERES_TRY_ASSIGN(Case given, read_case(o.body, {.observations = false}));
    TERES_TRY(check_given(given));
    const bool ligament = given.ligament && !given.ligament_prior.empty();
    o.plan.given = {.clamped = !given.clamped.empty(), .dynamic = !given.quasi_static, .ligament = ligament};
    o.given = std::make_shared<const Case>(std::move(given));
    return {};
}

fs::path seal_file(const BlindtestOptions& o) {
    return fs::path(o.out) / ("seal-" + shard_name(o.plan) + ".sha256");
}

Status generate(const BlindtestOptions& o, const std::vector<CaseSpec>& cases) {
    const fs::path out = o.out, scratch = out / ("scratch-" + shard_name(o.plan));
    CaseMaker maker(o.plan.seed, out, scratch);
    if (o.given) {
        maker.body_options.given = o.given;
        maker.body_options.truth_tets = kGivenTruthTets;
    }
    maker.least_gap_m = 1e-3 * o.least_gap_mm;
    Progress progress("sealed cases", cases.size());
    int discarded = 0;
    std::string list;
    for (const CaseSpec& spec : cases) {
        TERES_TRY_ASSIGN(const CaseMaker::Outcome outcome, maker.make(spec));
        discarded += outcome == CaseMaker::Outcome::kDiscarded;
        TERES_TRY_ASSIGN(const std::string sums, seal_list(out, {&spec, 1}));
        list += sums;
        TERES_TRY(write_text_file(seal_file(o), list));  // what was made is sealed, should the rest never be
        progress.step();
    }
    if (!o.keep) fs::remove_all(scratch);
    std::printf(
        "%zu cases, %d discarded (no solution or, with --least-gap-mm, too little to see)\nseal %s  (SHA-256 of "
        "%s/seal-%s.sha256)\n",
        cases.size(), discarded, sha256(list).c_str(), o.out.c_str(), shard_name(o.plan).c_str());
    std::fflush(stdout);
    return {};
}

Status diagnose(const BlindtestOptions& o, const std::vector<CaseSpec>& cases) {
    Progress progress("diagnoses", cases.size());
    for (const CaseSpec& spec : cases) {
        TERES_TRY(diagnose_case(spec, o.trial));
        progress.step();
    }
    return {};
}

Status show(const std::vector<CaseResult>& results, const BlindtestOptions& o) {
    const Summary summary = summarise(results, o.floor_mm > 0.0 ? std::optional(o.floor_mm) : std::nullopt);
    std::printf("%zu cases\n\n%s", results.size(), report_text(summary).c_str());
    return o.plots.empty() ? Status{} : save_plots(summary, o.plots);
}

// The cases that were sealed, checked, and of these those that were diagnosed: a set that was stopped is scored as far
// as it went.
Result<std::vector<CaseSpec>> sealed_and_diagnosed(const BlindtestOptions& o, std::vector<CaseSpec> cases) {
    const std::size_t planned = cases.size();
    TERES_TRY_ASSIGN(const std::string sealed, read_text_file(seal_file(o)));
    std::erase_if(cases, [&](const CaseSpec& spec) {
        return sealed.find("  sealed/" + spec.name + "/label.json\n") == std::string::npos;
    });
    TERES_TRY_ASSIGN(const std::string now, seal_list(o.out, cases));
    if (sealed != now) return not_usable(seal_file(o).string() + ": the sealed files are not those that were sealed");
    std::printf("seal %s holds\n", sha256(sealed).c_str());
    if (cases.size() < planned) std::printf("%zu of %zu cases were not made\n", planned - cases.size(), planned);
    const std::size_t undiagnosed =
        std::erase_if(cases, [&](const CaseSpec& spec) { return !ready_to_score(spec, o.out); });
    if (undiagnosed > 0) std::printf("%zu cases are not diagnosed yet and left out\n", undiagnosed);
    return cases;
}

Status score(const BlindtestOptions& o, const std::vector<CaseSpec>& cases) {
    TERES_TRY_ASSIGN(const std::vector<CaseSpec> done, sealed_and_diagnosed(o, cases));
    std::optional<tools::Judge> judge;
    AnswerChange change;
    if (o.again) {
        TERES_TRY_ASSIGN(const Config config, read_offline_settings({}));
        TERES_TRY_ASSIGN(judge, tools::Judge::open(config));
        change = [&](const std::string& gap_json) { return judge->judged_again(gap_json); };
    }
    std::vector<CaseResult> results;
    std::string lines;
    for (const CaseSpec& spec : done) {
        TERES_TRY_ASSIGN(const std::optional<CaseResult> result, score_case(spec, o.out, change));
        if (!result) continue;
        lines += to_json_line(*result) + "\n";
        results.push_back(*result);
    }
    const fs::path file = fs::path(o.out) / ((o.again ? "judged-again-" : "results-") + shard_name(o.plan) + ".jsonl");
    TERES_TRY(write_text_file(file, lines));
    TERES_TRY(show(results, o));
    std::printf("\nresults: %s\n", file.c_str());
    return {};
}

Status merge(const BlindtestOptions& o) {
    if (o.files.empty()) return invalid_input("blindtest merge: no results file given");
    std::vector<CaseResult> results;
    for (const std::string& file : o.files) {
        TERES_TRY_ASSIGN(const std::string text, read_text_file(file));
        TextCursor lines(text);
        while (const auto line = lines.next_line()) {
            if (line->empty()) continue;
            TERES_TRY_ASSIGN(CaseResult result, parse_case_result(*line, file + ":" + std::to_string(lines.line())));
            results.push_back(std::move(result));
        }
    }
    return show(results, o);
}

Status run(BlindtestOptions& o) {
    if (o.stage == "merge") return merge(o);
    if (!o.files.empty()) return invalid_input("blindtest " + o.stage + ": unexpected '" + o.files.front() + "'");
    TERES_TRY(read_shard(o.shard, o.plan));
    TERES_TRY(read_body(o));
    TERES_TRY_ASSIGN(const std::vector<CaseSpec> cases, plan_cases(o.plan));
    o.trial.out = o.out;
    o.trial.program = fs::read_symlink("/proc/self/exe");
    const bool all = o.stage == "all";
    if (all || o.stage == "generate") TERES_TRY(generate(o, cases));
    if (all || o.stage == "diagnose") TERES_TRY(diagnose(o, cases));
    if (all || o.stage == "score") TERES_TRY(score(o, cases));
    return {};
}

}  // namespace

void add_blindtest_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<BlindtestOptions>();
    BlindtestOptions& o = *options;
    CLI::App* verb = add_verb(
        app, exit_code, "blindtest", "sealed cases from another solver (CalculiX), diagnosed, opened, scored",
        "  teres blindtest --cases 29 --seed 7 --out bench                 # generate, diagnose, score: every effect "
        "once\n"
        "  teres blindtest generate --cases 290 --two-causes 16 --shard 3/8 --out bench     # one of eight shards\n"
        "  teres blindtest diagnose --cases 290 --two-causes 16 --shard 3/8 --out bench --withheld\n"
        "  teres blindtest score    --cases 290 --two-causes 16 --shard 3/8 --out bench\n"
        "  teres blindtest --body phantom --cases 25 --seed 7 --out bench                   # on your own body and "
        "loads\n"
        "  teres blindtest score --again --cases 25 --seed 7 --body phantom --out bench     # after a new calibration: "
        "what would the answers be?\n"
        "  teres blindtest merge bench/results-*.jsonl --plots bench/plots\n"
        "Stages that were interrupted go on where they stopped; what was sealed and diagnosed by then can be scored.\n"
        "OUT/cases is all that the diagnosis is given; OUT/sealed holds the labels, OUT/seal-*.sha256 their sums "
        "(checked\n"
        "before they are opened; `sha256sum -c` reads it).\n"
        "Needs the program ccx (apt-get install calculix-ccx). Exit code 1: the seal is broken.",
        [options] {
            const Status done = run(*options);
            return done ? static_cast<int>(kDone) : report(done.error());
        });
    verb->add_option("stage", o.stage, "all, generate, diagnose, score or merge")
        ->check(CLI::IsMember({"all", "generate", "diagnose", "score", "merge"}))
        ->capture_default_str();
    verb->add_option("files", o.files, "merge: results-*.jsonl of the shards, also of several seeds")
        ->type_name("FILE");
    verb->add_option("--cases", o.plan.cases, "Cases with one cause or none")->capture_default_str();
    verb->add_option("--two-causes", o.plan.two_causes, "Cases with two causes, besides")->capture_default_str();
    verb->add_option("--effects", o.plan.effects, "Only these, separated by commas (`none`: a control)")
        ->delimiter(',')
        ->type_name("ID,ID");
    verb->add_option("--body", o.body,
                     "Cases of this body: its mesh, loads, markers and prior; ligament, law and effects are drawn")
        ->type_name("CASE");
    verb->add_option("--least-gap-mm", o.least_gap_mm,
                     "generate: draw an effect again until it moves the markers by so much (rms, beside the ligament)")
        ->type_name("MM")
        ->check(CLI::NonNegativeNumber);
    verb->add_flag("--static", o.plan.quasi_static,
                   "Without the cases that have inertia (their diagnosis takes longer)");
    verb->add_option("--seed", o.plan.seed, "Same seed, same cases")->capture_default_str();
    verb->add_option("--shard", o.shard, "Part i of n, i from 0")->type_name("I/N")->capture_default_str();
    verb->add_option("--out", o.out, "Folder of the test")->type_name("DIR")->capture_default_str();
    verb->add_option("--plots", o.plots, "score, merge: pictures into this folder (PNG)")->type_name("DIR");
    verb->add_option("--floor-mm", o.floor_mm, "Floor instead of the controls' median gap")->type_name("MM");
    verb->add_option("--limit-s", o.trial.limit_s, "Time limit of one diagnosis")
        ->type_name("S")
        ->capture_default_str();
    verb->add_flag("--withheld", o.trial.withheld, "Diagnose once more with the true effect withheld");
    verb->add_flag("--again", o.again,
                   "score: judge the evidence of every answer with the calibration of this program; nothing is fitted");
    verb->add_flag("--keep", o.keep, "Keep the solver's last files");
}

}  // namespace teres::tools
