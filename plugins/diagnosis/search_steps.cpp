#include "plugins/diagnosis/search_steps.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "plugins/diagnosis/other_places.h"

namespace teres {
namespace {

constexpr std::size_t kPolished = 2;

// The next best fitted cause whose last effect has a place: one that stayed in a far hollow may be the better answer.
// Null where the best one leaves no more than noise and model error explain, or has a place itself.
Cause* placed_rival(const Problem& problem, const Screening& screening, const std::vector<Cause*>& fitted) {
    const auto has_places = [&](const Cause* cause) {
        return std::any_of(screening.effects.begin(), screening.effects.end(), [&](const EffectScreening& e) {
            return e.entry == cause->entries.back() && !e.places.empty();
        });
    };
    const Cause& best = *fitted.front();
    if (problem.floor.explains(left_of(best.fit)) || has_places(&best)) return nullptr;
    const auto rival = std::find_if(fitted.begin() + 1, fitted.end(), has_places);
    return rival != fitted.end() && (*rival)->score > best.score - kOutOfReach ? *rival : nullptr;
}

// What was fitted with `size` effects, best first: linear scores of what was not say nothing of what a fit gains.
std::vector<Cause*> fitted_with(std::size_t size, std::vector<Cause>& causes) {
    sort_by_score(causes);
    std::vector<Cause*> fitted;
    for (Cause& cause : causes)
        if (cause.fit.usable && cause.entries.size() == size) fitted.push_back(&cause);
    return fitted;
}

// The best few, and where none of them pays what explains most: a fit that was ended early does not pay either.
std::vector<Cause*> worth_finishing(const Problem& problem, const std::vector<Cause*>& fitted) {
    std::vector<Cause*> best;
    for (Cause* cause : fitted)
        if (best.size() < (problem.out_of_time() ? 1 : kPolished) && cause->score > fitted.front()->score - kOutOfReach)
            best.push_back(cause);
    if (fitted.front()->score < problem.options.calibration.none_bonus && !problem.out_of_time()) {
        Cause* most = *std::min_element(fitted.begin(), fitted.end(),
                                        [](const Cause* a, const Cause* b) { return a->misfit < b->misfit; });
        if (std::find(best.begin(), best.end(), most) == best.end()) best.push_back(most);
    }
    return best;
}

}  // namespace

Reach reach_of_best(const Problem& problem, const Fit& nominal, const std::vector<Cause>& causes,
                    const EffectEntry& added, double search_cost) {
    if (problem.outlook != nullptr) return {};  // what is left later is not known
    const double gain = best_score(causes) - kOutOfReach + search_cost;
    return {.log_above = problem.floor.log_above(left_of(nominal)) - 2.0 * gain / problem.options.calibration.nu,
            .any_course = added.info.event};
}

std::vector<Cause> fit_beside(Problem& problem, const Fit& nominal, const Base* base,
                              const std::vector<Cause>& known_so_far, const std::vector<const EffectScreening*>& added,
                              int iterations) {
    const Cause* known = base != nullptr ? &base->known : nullptr;
    std::vector<Cause> fitted(added.size());
    side_by_side(problem, added.size(), [&](Problem& p, std::size_t k) {
        const double search_cost = (known != nullptr ? known->search_cost : 0.0) + added[k]->search_cost;
        const EffectEntry& entry = p.simulator.effects()[added[k]->entry];
        const GivenUpBeyond bound(p, reach_of_best(p, nominal, known_so_far, entry, search_cost));
        const bool torn = known == nullptr && at_full_size(p, entry);
        fitted[k] =
            torn ? refit_torn(p, nominal, *added[k], iterations) : refit(p, nominal, known, *added[k], iterations);
        score(p, nominal, base, fitted[k]);
    });
    return fitted;
}

std::vector<std::size_t> worth_refitting(const Screening& screening, std::size_t by_score, std::size_t by_share) {
    std::vector<std::size_t> order(screening.effects.size()), chosen;
    std::iota(order.begin(), order.end(), std::size_t{0});
    const auto take = [&](std::size_t count) {
        for (const std::size_t k : order)
            if (count > 0 && screening.effects[k].explained >= kLeastExplained &&
                std::find(chosen.begin(), chosen.end(), k) == chosen.end()) {
                chosen.push_back(k);
                --count;
            }
    };
    take(by_score);
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        return screening.effects[a].explained > screening.effects[b].explained;
    });
    take(by_share);
    return chosen;
}

void finish(Problem& problem, const Fit& nominal, const Base* base, const Screening& screening,
            std::vector<Cause>& causes) {
    const std::size_t size = base != nullptr ? base->known.entries.size() + 1 : 1;
    std::vector<Cause*> fitted = fitted_with(size, causes);
    if (fitted.empty() || (base != nullptr && fitted.front()->score < base->known.score - kHopeless)) return;
    const auto report = stage(problem.options, "finishing the best");
    report(0.0);
    if (!problem.out_of_time()) {
        Cause* rival = placed_rival(problem, screening, fitted);
        try_other_places(problem, nominal, base, screening, rival != nullptr ? *rival : *fitted.front());
        fitted = fitted_with(size, causes);
    }
    report(0.5);
    const std::vector<Cause*> best = worth_finishing(problem, fitted);
    const auto settle_one = [&](Problem& p, Cause& cause) {
        settle(p, cause, kFurtherIterations);
        score(p, nominal, base, cause);
    };
    side_by_side(problem, best.size(), [&](Problem& p, std::size_t k) { settle_one(p, *best[k]); });
    // One that only looked good may have been among them: what is ahead now is finished as well.
    const auto most = std::max_element(fitted.begin(), fitted.end(),
                                       [](const Cause* a, const Cause* b) { return a->score < b->score; });
    if (std::find(best.begin(), best.end(), *most) == best.end() && !problem.out_of_time()) settle_one(problem, **most);
    report(1.0);
    sort_by_score(causes);
}

}  // namespace teres
