#include "plugins/diagnosis/search.h"

#include <algorithm>
#include <string_view>

#include "plugins/diagnosis/search_steps.h"
#include "plugins/diagnosis/strong_start.h"

namespace teres {
namespace {

constexpr double kMost = 0.9;           // explained: the search need not go on
constexpr std::size_t kSecondLook = 3;  // effects fitted besides if it has to

// A lasting force or another support: what a support that holds on one side only may look like.
bool may_be_support(const EffectEntry& entry) {
    return !entry.info.event && (entry.support() || std::string_view(entry.info.kind) == "load");
}

// The same cause from where its effect acts at full size, if that is nearer than where first order leads.
void refit_strongly(Problem& problem, const Fit& nominal, const StrongStart& start, Cause& cause) {
    Cause other = cause;
    other.fit = fit_from_full_size(problem, start.at, kRefitIterations);
    if (!other.fit.usable || (cause.fit.usable && other.fit.cost >= cause.fit.cost)) return;
    cause = std::move(other);
    score(problem, nominal, nullptr, cause);
}

bool explains_most(const Cause& cause) {
    return cause.fit.usable && cause.explained >= kMost;
}

// What would be answered now.
struct Told {
    std::vector<std::size_t> named;  ///< if these explain nearly everything
    bool unknown = false;
};
Told told_now(const Problem& problem, const Fit& nominal, const std::vector<Cause>& causes) {
    const Verdict verdict = judge(causes, left_of(nominal), problem.floor, problem.options.calibration);
    const Cause& top = verdict.causes.front();
    const bool named = top.probability > std::max(verdict.none_probability, verdict.unknown_probability);
    return {named && explains_most(top) ? top.entries : std::vector<std::size_t>{},
            !named && verdict.unknown_probability > verdict.none_probability};
}

// Effects that explain much at first order and have not been fitted.
void fit_overlooked(Problem& problem, const Fit& nominal, const Screening& screening, const Simulator::Progress& report,
                    std::vector<Cause>& causes) {
    const auto fitted = static_cast<std::size_t>(std::count_if(
        causes.begin(), causes.end(), [](const Cause& c) { return c.entries.size() == 1 && c.fit.usable; }));
    std::vector<const EffectScreening*> overlooked;
    for (const std::size_t k : worth_refitting(screening, 0, fitted + kSecondLook))
        if (fitted_alone(causes, screening.effects[k].entry) == nullptr) overlooked.push_back(&screening.effects[k]);
    for (std::size_t k = 0; k < overlooked.size() && !problem.out_of_time(); k += 2) {
        const std::vector<const EffectScreening*> pair(
            overlooked.begin() + static_cast<std::ptrdiff_t>(k),
            overlooked.begin() + static_cast<std::ptrdiff_t>(std::min(k + 2, overlooked.size())));
        for (Cause& cause : fit_beside(problem, nominal, nullptr, causes, pair, kRefitIterations))
            keep_better(causes, std::move(cause));
        report(static_cast<double>(k + pair.size()) / static_cast<double>(overlooked.size()));
    }
}

// Supports from where they act at full size. `at_once`: only those that explain something already before they are
// fitted.
void fit_at_full_size(Problem& problem, const Fit& nominal, const std::vector<const EffectScreening*>& supports,
                      bool at_once, const Simulator::Progress& report, std::vector<Cause>& causes) {
    const std::vector<std::int32_t> frames = trial_frames(problem.recording.first_held_frame);
    const double before = left_at(problem, frames, nominal.trajectory);
    std::vector<StrongStart> starts;
    std::vector<Cause> strong;  // one per start
    report(0.0);
    for (std::size_t k = 0; k < supports.size() && !problem.out_of_time(); ++k) {
        const EffectScreening& support = *supports[k];
        const Cause* alone = fitted_alone(causes, support.entry);
        for (StrongStart& start : best_strong_starts(problem, support)) {  // one
            if (at_once && start.left >= before) continue;
            starts.push_back(std::move(start));
            strong.push_back(alone != nullptr ? *alone : Cause{});
            strong.back().entries = {support.entry};
            strong.back().search_cost = support.search_cost;
        }
        report(0.5 * static_cast<double>(k + 1) / static_cast<double>(supports.size()));
    }
    for (std::size_t first = 0; first < strong.size() && !problem.out_of_time(); first += 2) {
        const std::size_t count = std::min<std::size_t>(2, strong.size() - first);
        side_by_side(problem, count, [&](Problem& p, std::size_t k) {
            Cause& cause = strong[first + k];
            const EffectEntry& entry = p.simulator.effects()[cause.entries[0]];
            const GivenUpBeyond bound(p, reach_of_best(p, nominal, causes, entry, cause.search_cost));
            refit_strongly(p, nominal, starts[first + k], cause);
        });
        for (std::size_t k = 0; k < count; ++k) keep_better(causes, std::move(strong[first + k]));
        report(0.5 + 0.5 * static_cast<double>(first + count) / static_cast<double>(strong.size()));
    }
}

}  // namespace

bool look_for_tears(Problem& problem, const Fit& nominal, const Screening& screening, std::vector<Cause>& causes) {
    const EffectTable& effects = problem.simulator.effects();
    if (causes.empty()) return false;
    sort_by_score(causes);
    const Cause& best = causes.front();
    if (!best.fit.usable || best.entries.size() > 1 || !effects[best.entries[0]].parts() ||
        problem.simulator.mechanics().dynamic() || problem.out_of_time())
        return false;
    std::vector<const EffectScreening*> tears;
    for (const EffectScreening& effect : screening.effects)
        if (effects[effect.entry].tears() && fitted_alone(causes, effect.entry) == nullptr) tears.push_back(&effect);
    if (tears.empty()) return false;
    const auto report = stage(problem.options, "looking for a tear");
    report(0.0);
    for (Cause& tear : fit_beside(problem, nominal, nullptr, causes, tears, kRefitIterations))
        keep_better(causes, std::move(tear));
    report(1.0);
    return true;
}

bool look_again(Problem& problem, const Fit& nominal, const Screening& screening, std::vector<Cause>& causes) {
    const Told told = told_now(problem, nominal, causes);
    const bool enough = std::any_of(causes.begin(), causes.end(),
                                    [](const Cause& c) { return c.entries.size() == 1 && explains_most(c); });
    if (told.named.empty() && enough && !told.unknown) return false;
    const bool offset = told.named.size() == 1 && may_be_support(problem.simulator.effects()[told.named.front()]);
    if (told.named.size() == 1 && !offset) return false;
    const double best_before = causes.front().score;
    const auto report = stage(problem.options, "looking again");
    if (told.named.empty() && !enough)
        fit_overlooked(
            problem, nominal, screening, [&](double part) { return report(0.5 * part); }, causes);
    const auto in_question = [&](std::size_t entry) {
        const EffectEntry& effect = problem.simulator.effects()[entry];
        const bool fitted = fitted_alone(causes, entry) != nullptr;
        if (!effect.support() || at_full_size(problem, effect)) return false;  // fitted from there already
        if (offset) return !fitted && !effect.info.event;
        return fitted &&
               (told.named.empty() || std::find(told.named.begin(), told.named.end(), entry) != told.named.end());
    };
    std::vector<const EffectScreening*> supports;
    for (const EffectScreening& effect : screening.effects)
        if (in_question(effect.entry) && !problem.simulator.mechanics().dynamic()) supports.push_back(&effect);
    if (!supports.empty())
        fit_at_full_size(
            problem, nominal, supports, offset, [&](double part) { return report(0.5 + 0.5 * part); }, causes);
    sort_by_score(causes);
    if (causes.front().score <= best_before) return false;
    finish(problem, nominal, nullptr, screening, causes);
    return true;
}

}  // namespace teres
