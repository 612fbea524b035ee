#include "plugins/diagnosis/search.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <string_view>
#include <utility>

#include "plugins/diagnosis/beginnings.h"
#include "plugins/diagnosis/search_steps.h"
#include "plugins/diagnosis/swing.h"

namespace teres {
namespace {

constexpr std::size_t kFurtherBegun = 4;  // mechanical effects fitted beside others for what they explain of it
constexpr double kAny = std::numeric_limits<double>::infinity();
constexpr double kLeastOfFamily = 0.1;  // share explained by first order, of an effect of the best one's family

// Effects that are not screened on top of `base`.
std::vector<std::size_t> left_out(const EffectTable& effects, const Base* base) {
    if (base == nullptr) return {};
    std::vector<std::size_t> out = base->known.entries;
    for (std::size_t e = 0; e < effects.size(); ++e)
        if (base->global_only && !effects[e].global()) out.push_back(e);
    return out;
}

std::vector<EffectScreening> chosen_of(const Screening& screening, std::size_t by_score, std::size_t by_share) {
    std::vector<EffectScreening> chosen;
    for (const std::size_t k : worth_refitting(screening, by_score, by_share)) chosen.push_back(screening.effects[k]);
    return chosen;
}

// Refits and scores what was chosen besides `causes`; rivals whose linear score is out of the best one's reach are left
// out.
std::vector<Cause> fit_chosen(Problem& problem, const Fit& nominal, const Base* base,
                              const std::vector<EffectScreening>& chosen, std::vector<Cause> causes) {
    const Cause* known = base != nullptr ? &base->known : nullptr;
    const std::size_t always = known == nullptr ? 2 : 1;
    const int iterations = known == nullptr ? kRefitIterations : kFurtherIterations;
    const auto report =
        stage(problem.options, known == nullptr ? "fitting the best effects" : "fitting further effects");
    report(0.0);
    const auto as_screened = [&](const Cause& cause) {
        return cause.score - told_apart(nominal, cause, problem.floor, problem.options.calibration);
    };
    const auto settled = [&](const EffectScreening& next) {
        const EffectEntry& entry = problem.simulator.effects()[next.entry];
        if (problem.simulator.mechanics().dynamic() && !entry.sensor) return false;
        // A clamp that gives way: first order says much less than it explains, and nothing is to be searched.
        if (entry.support() && next.num_candidates == 1) return false;
        const auto best = std::max_element(causes.begin(), causes.end(),
                                           [](const Cause& a, const Cause& b) { return a.score < b.score; });
        const double lead = as_screened(*best) - (known != nullptr ? as_screened(*known) : 0.0) - next.score;
        const ErrorFloor enough = known == nullptr ? problem.floor : problem.right_floor();
        return lead > 2.0 * kOutOfReach || (lead > kOutOfReach && enough.explains(left_of(best->fit)));
    };
    // A tear's start does not depend on what is held out.
    const auto fitted_at_best = [&](const EffectScreening& next) {
        return known == nullptr && at_full_size(problem, problem.simulator.effects()[next.entry]) &&
               fitted_alone(causes, next.entry) != nullptr;
    };
    for (std::size_t next = 0; next < chosen.size();) {
        std::vector<const EffectScreening*> pair;
        for (; next < chosen.size() && pair.size() < 2; ++next) {
            const bool worth_it = next < always || causes.empty() || (!problem.out_of_time() && !settled(chosen[next]));
            if (worth_it && !fitted_at_best(chosen[next])) pair.push_back(&chosen[next]);
        }
        for (Cause& cause : fit_beside(problem, nominal, base, causes, pair, iterations))
            keep_better(causes, std::move(cause));
        report(static_cast<double>(next) / static_cast<double>(chosen.size()));
    }
    return causes;
}

// What is of one family with the best cause looks like it, and little tells them apart by first order: it is fitted,
// too. So are steady loads where the best is another load that was there from the beginning.
void fit_family(Problem& problem, const Fit& nominal, const Base* base, const Screening& screening,
                std::vector<Cause>& causes) {
    sort_by_score(causes);
    if (causes.empty() || !causes.front().fit.usable || problem.out_of_time()) return;
    const EffectTable& effects = problem.simulator.effects();
    const ActiveEffect& best = causes.front().fit.at.effects.back();
    const std::string_view family = effects[best.entry].info.family;
    const bool steady = effects.always_there(best);
    const auto fitted = [&](std::size_t entry) {
        return std::any_of(causes.begin(), causes.end(), [&](const Cause& c) { return c.entries.back() == entry; });
    };
    std::vector<const EffectScreening*> others;
    for (const EffectScreening& effect : screening.effects)
        if (others.size() < 2 &&
            (family == effects[effect.entry].info.family || (steady && effects[effect.entry].steady_load())) &&
            !fitted(effect.entry) && effect.explained >= kLeastOfFamily)
            others.push_back(&effect);
    const int iterations = base == nullptr ? kRefitIterations : kFurtherIterations;
    for (Cause& cause : fit_beside(problem, nominal, base, causes, others, iterations))
        causes.push_back(std::move(cause));
}

// Every effect on the beginning, beside what is known as it is; where that is far from usual, beside usual amplitudes,
// too, and screened anew there.
std::vector<EffectScreening> tried_on_beginning(Problem& problem, const Fit& from, Screening screening,
                                                const Whitener& whitener, const Base* base) {
    const auto report = stage(problem.options, base == nullptr ? "trying effects" : "trying further effects");
    const std::optional<Assumption> usual = at_usual_size(problem.simulator, from.at);
    const double half = usual ? 0.5 : 1.0, before = left_of_beginning(problem, from.at);
    std::vector<EffectScreening> begun = try_beginnings(problem, from.at, before, std::move(screening), kAny,
                                                        [&](double part) { return report(half * part); });
    for (EffectScreening& effect : begun) effect.beside.clear();  // what is known was fitted to more than the beginning
    if (!usual || problem.out_of_time()) return begun;
    const Fit anew = problem.fit(*usual, 0);
    if (!anew.usable) return begun;
    const Signatures all =
        signatures(problem.simulator, anew, left_out(problem.simulator.effects(), base), [](double) { return true; });
    return better_of(std::move(begun),
                     try_beginnings(problem, *usual, before,
                                    screen(problem.simulator, all, whitener, problem.floor, anew,
                                           problem.options.calibration, problem.recording.num_frames / 4),
                                    kAny, [&](double part) { return report(half * (1.0 + part)); }));
}

// Effects that were not fitted, with their linear score.
void add_screened(const Screening& screening, std::vector<Cause>& causes) {
    for (const EffectScreening& effect : screening.effects) {
        if (std::any_of(causes.begin(), causes.end(),
                        [&](const Cause& c) { return c.entries == std::vector<std::size_t>{effect.entry}; }))
            continue;
        Cause cause;
        cause.entries = {effect.entry};
        cause.score = effect.score;
        cause.explained = effect.explained;
        causes.push_back(std::move(cause));
    }
}

// What search_from_swing() finds, and a sensor effect if first order is for it.
std::vector<Cause> from_swing(Problem& problem, const Fit& nominal, Screening& screening) {
    std::vector<Cause> causes = search_from_swing(problem, nominal);
    if (causes.empty()) return causes;
    const EffectTable& effects = problem.simulator.effects();
    take_from_beginning(effects, {}, screening);
    causes = fit_chosen(problem, nominal, nullptr, choose_with_inertia(effects, {}, 0, screening), std::move(causes));
    add_screened(screening, causes);
    return causes;
}

}  // namespace

std::vector<Cause> search(Problem& problem, const Fit& nominal, const Base* base, Screening& screening,
                          const Cause* before) {
    const DiagnosisOptions& options = problem.options;
    const Cause* known = base != nullptr ? &base->known : nullptr;
    const Fit& from = base != nullptr ? base->fit : nominal;
    const Whitener& whitener = base != nullptr ? base->looser : problem.whitener;
    const Signatures all =
        signatures(problem.simulator, from, left_out(problem.simulator.effects(), base),
                   stage(options, known == nullptr ? "screening effects" : "screening further effects"));
    const std::size_t frames = problem.recording.num_frames;
    const auto screen_first = [&](std::size_t num_frames) {
        return screen(problem.simulator, all, whitener, problem.floor, from, options.calibration, num_frames);
    };
    screening = screen_first(frames);
    if (known == nullptr && !problem.simulator.mechanics().dynamic()) {
        const Screening early = screen_first(beginning_of(problem.recording));
        if (!early.effects.empty() && early.effects.front().score > options.calibration.unknown_price)
            screening.of_beginning = early.effects.front();
    }
    if (base != nullptr && base->global_only)  // first order is nearly exact there
        std::erase_if(screening.effects,
                      [&](const EffectScreening& effect) { return effect.score <= -base->far_nats; });
    if (known == nullptr && problem.simulator.mechanics().dynamic())
        if (std::vector<Cause> causes = from_swing(problem, nominal, screening); !causes.empty()) return causes;
    std::vector<EffectScreening> chosen;
    if (problem.simulator.mechanics().dynamic()) {
        const auto begun = tried_on_beginning(problem, from, screen_first(frames / 4), whitener, base);
        take_from_beginning(problem.simulator.effects(), begun, screening);
        chosen = choose_with_inertia(problem.simulator.effects(), begun,
                                     known == nullptr ? static_cast<std::size_t>(options.num_refits) : kFurtherBegun,
                                     screening);
    } else if (known == nullptr) {
        chosen = chosen_of(screening, static_cast<std::size_t>(options.num_refits) - 2, 2);
    } else {
        chosen = chosen_of(screening, 2, 1);
    }
    std::vector<Cause> causes;
    if (before != nullptr) causes.push_back(fitted_from(problem, nominal, *before, before->fit.at, kRefitIterations));
    causes = fit_chosen(problem, nominal, base, chosen, std::move(causes));
    fit_family(problem, nominal, base, screening, causes);
    if (known == nullptr)
        add_screened(screening, causes);
    else
        finish(problem, nominal, base, screening, causes);
    return causes;
}

}  // namespace teres
