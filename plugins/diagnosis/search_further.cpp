#include "plugins/diagnosis/search_further.h"

#include <algorithm>

#include "plugins/diagnosis/form_columns.h"
#include "plugins/diagnosis/search.h"

namespace teres {
namespace {

constexpr int kExchanges = 1;       // of the first effect of a pair
constexpr double kFormShare = 0.2;  // standard deviation of a form, share of the effect's motion

// The whitener in use, with columns for what the known effects may get wrong of their form.
Whitener looser_whitener(Problem& problem, const Fit& nominal, const Fit& known) {
    if (problem.simulator.mechanics().dynamic()) return problem.whitener;
    const Eigen::MatrixXd columns = form_columns(problem.simulator, known.at, known.trajectory, kFormShare);
    Discrepancy looser = problem.discrepancy;
    looser.columns.conservativeResize(Eigen::NoChange, looser.columns.cols() + columns.cols());
    looser.columns.rightCols(columns.cols()) = columns;
    return whitener_for(problem.recording, looser, nominal.trajectory, problem.options.calibration);
}

// One effect more than `known`. Nothing if looser forms of that explain what is left.
std::vector<Cause> search_on_top(Problem& problem, const Fit& nominal, const Cause& known) {
    Base base{known, looser_whitener(problem, nominal, known.fit), known.fit};
    complete(problem.simulator, base.looser, problem.recording.observed, base.fit);
    if (!base.fit.usable) return {};
    Fit rest = base.fit;
    take_noise(problem, rest);
    if (rest.cost < problem.floor.total() + form_error(problem, nominal, known)) return {};
    Screening screening;
    return search(problem, nominal, &base, screening);
}

}  // namespace

bool search_further(Problem& problem, const Fit& nominal, std::vector<Cause>& causes) {
    const auto better = [](const Cause& a, const Cause& b) { return a.score > b.score; };
    const double best_before = causes.front().score;
    // Where no single effect pays, the pair begins with the one that explains most.
    Cause base = causes.front();
    if (best_before < problem.options.calibration.none_bonus)
        for (const Cause& cause : causes)
            if (cause.fit.usable && (!base.fit.usable || cause.misfit < base.misfit)) base = cause;
    if (!base.fit.usable) return false;
    std::vector<std::size_t> tried;  // effects that were a pair's first
    for (int exchange = 0; exchange <= kExchanges; ++exchange) {
        std::vector<Cause> larger = search_on_top(problem, nominal, base);
        if (larger.empty() || !larger.front().fit.usable) break;
        const Cause best = larger.front();
        for (Cause& cause : larger) keep_better(causes, std::move(cause));
        if (base.entries.size() != 1 || problem.simulator.mechanics().dynamic()) break;
        if (best.fit.cost < problem.floor.total()) break;
        tried.push_back(base.entries[0]);
        const std::size_t added = best.entries.back();
        if (std::find(tried.begin(), tried.end(), added) != tried.end()) break;
        const auto fitted = std::find_if(causes.begin(), causes.end(), [&](const Cause& c) {
            return c.entries == std::vector{added} && c.fit.usable;
        });
        if (fitted != causes.end()) {
            base = *fitted;
            continue;
        }
        EffectScreening alone;
        alone.entry = added;
        alone.start = best.fit.at.effects.back();
        alone.search_cost = best.search_cost - base.search_cost;
        base = refit(problem, nominal, nullptr, alone, 6);
        score(problem, nominal, nullptr, base);
        if (!base.fit.usable) break;
        keep_better(causes, base);
    }
    std::stable_sort(causes.begin(), causes.end(), better);
    return causes.front().score > best_before;
}

}  // namespace teres
