#include "plugins/diagnosis/search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string_view>

#include "plugins/diagnosis/shape_search.h"
#include "plugins/diagnosis/strong_start.h"

namespace teres {
namespace {

constexpr int kPolished = 2;
constexpr int kIterations = 8, kFurtherIterations = 6;  // of a refit
constexpr double kOutOfReach = 15.0;    // nats between a fitted cause and the screening of one that need not be fitted
constexpr double kMost = 0.9;           // explained: the search need not go on
constexpr std::size_t kSecondLook = 3;  // effects fitted besides if it has to
constexpr double kLeastExplained = 0.02;  // of the nominal cost, by first order: less is not worth a fit
constexpr double kLeastEarly = 0.1;       // ... of the cost of the beginning of a dynamic recording
constexpr std::size_t kPlaces = 3;        // from which the best answer is fitted

// Supports hold or do not; loads, materials and cameras change by degrees.
bool may_have_threshold(const EffectEntry& entry) {
    return std::string_view(entry.info.kind) == "boundary";
}

// A lasting force or another support: what a support that holds on one side only may look like.
bool may_be_support(const EffectEntry& entry) {
    return !entry.info.event && (may_have_threshold(entry) || std::string_view(entry.info.kind) == "load");
}

// The same from where the effect acts at full size, if that is nearer than where first order leads. `at_once`: only if
// it explains something already before it is fitted.
void refit_strongly(Problem& problem, const Fit& nominal, const EffectScreening& added, bool at_once, Cause& cause) {
    const auto best = best_strong_start(
        problem.simulator, problem.whitener, problem.recording.observed,
        strong_starts(problem.simulator.effects(), added, prior_median(problem.simulator.mechanics()).theta));
    if (!best || (at_once && best->misfit >= nominal.misfit)) return;
    Eigen::VectorXd trajectory;
    if (!problem.simulator.simulate(best->at, trajectory)) return;  // the base of what follows
    Cause other = cause;
    other.fit = problem.fit(best->at, kIterations);
    if (!other.fit.usable || (cause.fit.usable && other.fit.cost >= cause.fit.cost)) return;
    improve_shapes(problem.simulator, problem.whitener, problem.recording.observed, other.fit);
    cause = std::move(other);
    score(problem, nominal, nullptr, cause);
}

// While it lives, fits are given up that would leave an effect out of the best one's reach even if its amplitudes cost
// nothing.
class WithinReach {
  public:
    WithinReach(Problem& problem, const Fit& nominal, const std::vector<Cause>& causes, double search_cost)
        : problem_(problem) {
        if (problem.outlook != nullptr) return;  // what a fit will leave later is not known before
        double best = 0.0;
        for (const Cause& cause : causes) best = std::max(best, cause.score);
        const double gain = best - kOutOfReach + search_cost;
        problem.out_of_reach = problem.floor.cost_of(problem.floor.above(nominal.cost) *
                                                     std::exp(-2.0 * gain / problem.options.calibration.nu));
    }
    ~WithinReach() { problem_.out_of_reach = std::numeric_limits<double>::infinity(); }
    WithinReach(const WithinReach&) = delete;
    WithinReach& operator=(const WithinReach&) = delete;

  private:
    Problem& problem_;
};

// Which screened effects deserve a refit: the best scores, and besides them those that explain most, because a local
// cause between the points of the search grid looks worse than it is.
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

// Adds what is worth refitting and not yet among `chosen`.
void choose(const Screening& screening, std::size_t by_score, std::size_t by_share,
            std::vector<EffectScreening>& chosen) {
    for (const std::size_t k : worth_refitting(screening, by_score, by_share))
        if (std::none_of(chosen.begin(), chosen.end(),
                         [&](const auto& c) { return c.entry == screening.effects[k].entry; }))
            chosen.push_back(screening.effects[k]);
}

// Where first order does not reach (a phase that runs away), each mechanical effect is fitted to the beginning (a
// quarter, then half) and ranked by what it explains there; its values there are where its refit starts.
Screening try_beginnings(Problem& problem, const Fit& base, const Cause* known, Screening screening) {
    const auto fit_first = [&](std::size_t share, const Assumption& start, int iterations) {
        return fit_jointly(problem.simulator, problem.whitener, problem.recording.observed, start,
                           {.max_iterations = iterations, .num_frames = problem.recording.num_frames / share});
    };
    const double before = fit_first(2, base.at, 3).cost;
    for (std::size_t k = 0; k < screening.effects.size(); ++k) {
        EffectScreening& effect = screening.effects[k];
        if (problem.simulator.effects()[effect.entry].sensor || effect.explained < kLeastEarly) continue;
        Assumption start = base.at;
        start.effects.push_back(effect.start);
        halve(problem.simulator.effects()[effect.entry], start.effects.back());  // first order asks for too much
        Fit fit = fit_first(4, start, 4);
        if (fit.usable) fit = fit_first(2, fit.at, 4);
        if (!fit.usable) continue;
        effect.explained = 1.0 - fit.cost / before;
        effect.start = fit.at.effects.back();
        stage(problem.options, known == nullptr ? "trying effects" : "trying further effects")(
            static_cast<double>(k + 1) / static_cast<double>(screening.effects.size()));
    }
    std::stable_sort(screening.effects.begin(), screening.effects.end(),
                     [](const auto& a, const auto& b) { return a.explained > b.explained; });
    return screening;
}

// Refits and scores what was chosen; rivals whose linear score is out of the best one's reach are left out.
std::vector<Cause> fit_chosen(Problem& problem, const Fit& nominal, const Base* base,
                              const std::vector<EffectScreening>& chosen) {
    const Cause* known = base != nullptr ? &base->known : nullptr;
    const std::size_t always = known == nullptr ? 2 : 1;
    const int iterations = known == nullptr ? kIterations : kFurtherIterations;
    const auto report =
        stage(problem.options, known == nullptr ? "fitting the best effects" : "fitting further effects");
    std::vector<Cause> causes;
    const auto settled = [&](const EffectScreening& next) {
        const auto best = std::max_element(causes.begin(), causes.end(),
                                           [](const Cause& a, const Cause& b) { return a.score < b.score; });
        const double lead = best->score - (known != nullptr ? known->score : 0.0) - next.score;
        return lead > 2.0 * kOutOfReach || (lead > kOutOfReach && best->fit.compared_cost() < problem.floor.total());
    };
    for (std::size_t k = 0; k < chosen.size(); ++k) {
        if (causes.size() >= always && settled(chosen[k])) continue;
        const WithinReach reach(problem, nominal, causes,
                                (known != nullptr ? known->search_cost : 0.0) + chosen[k].search_cost);
        causes.push_back(refit(problem, nominal, known, chosen[k], iterations));
        score(problem, nominal, base, causes.back());
        report(static_cast<double>(k + 1) / static_cast<double>(chosen.size()));
    }
    return causes;
}

// Effects that were not fitted, with their linear score.
void add_screened(const Screening& screening, std::vector<Cause>& causes) {
    for (const EffectScreening& effect : screening.effects) {
        if (std::any_of(causes.begin(), causes.end(), [&](const Cause& c) { return c.entries[0] == effect.entry; }))
            continue;
        Cause cause;
        cause.entries = {effect.entry};
        cause.score = effect.score;
        cause.explained = effect.explained;
        causes.push_back(std::move(cause));
    }
}

// A place is found by descent, which ends in the nearest hollow: the best answer starts from other places as well.
void try_other_places(Problem& problem, const Fit& nominal, const Base* base, const Screening& screening,
                      Cause& cause) {
    const auto screened = std::find_if(screening.effects.begin(), screening.effects.end(),
                                       [&](const auto& e) { return e.entry == cause.entries.back(); });
    if (!cause.fit.usable || screened == screening.effects.end() || screened->places.empty()) return;
    const EffectEntry& entry = problem.simulator.effects()[screened->entry];
    const double apart = apart_m(screened->places);
    for (const PlaceGain& place : best_places(screened->places, kPlaces)) {
        const auto found = centre_of(entry, cause.fit.at.effects.back()), begun = centre_of(entry, screened->start);
        if ((place.centre_m - *found).norm() < apart || place.centre_m == *begun) continue;
        EffectScreening there = *screened;
        there.start = place.start;
        Cause other = refit(problem, nominal, base != nullptr ? &base->known : nullptr, there, 6);
        if (other.fit.usable && other.fit.cost < cause.fit.cost) cause = std::move(other);
    }
    score(problem, nominal, base, cause);
}

// The best cause from other places as well; the best few fitted to the end.
void finish(Problem& problem, const Fit& nominal, const Base* base, const Screening& screening,
            std::vector<Cause>& causes) {
    const std::size_t size = base != nullptr ? base->known.entries.size() + 1 : 1;
    sort_by_score(causes);
    if (!causes.empty()) try_other_places(problem, nominal, base, screening, causes.front());
    for (std::size_t k = 0; k < causes.size() && k < kPolished; ++k) {
        if (!causes[k].fit.usable || causes[k].entries.size() != size) continue;  // others were finished before
        Fit better = problem.fit(causes[k].fit.at, 6);
        if (better.usable && better.misfit < causes[k].fit.residual.squaredNorm()) {
            causes[k].fit = std::move(better);
            problem.look_ahead(causes[k].fit);
            take_noise(problem, causes[k].fit);
        }
        score(problem, nominal, base, causes[k]);
    }
    sort_by_score(causes);
}

bool explains_most(const Cause& cause) {
    return cause.fit.usable && cause.explained >= kMost;
}

// The effects that would be named, if they explain nearly everything; else none.
std::vector<std::size_t> convincing(const Problem& problem, const Fit& nominal, const std::vector<Cause>& causes) {
    const Verdict verdict = judge(causes, nominal.compared_cost(), problem.floor, problem.options.calibration);
    const Cause& top = verdict.causes.front();
    const bool named = top.probability > std::max(verdict.none_probability, verdict.unknown_probability);
    return named && explains_most(top) ? top.entries : std::vector<std::size_t>{};
}

}  // namespace

std::vector<Cause> search(Problem& problem, const Fit& nominal, const Base* base, Screening& screening) {
    const DiagnosisOptions& options = problem.options;
    const Cause* known = base != nullptr ? &base->known : nullptr;
    const Fit& from = base != nullptr ? base->fit : nominal;
    const Whitener& whitener = base != nullptr ? base->looser : problem.whitener;
    const Signatures all =
        signatures(problem.simulator, from, known != nullptr ? known->entries : std::vector<std::size_t>{},
                   stage(options, known == nullptr ? "screening effects" : "screening further effects"));
    const std::size_t frames = problem.recording.num_frames;
    const auto screen_first = [&](std::size_t num_frames) {
        return screen(problem.simulator, all, whitener, problem.floor, from, options.calibration, num_frames);
    };
    screening = screen_first(frames);
    std::vector<EffectScreening> chosen;
    if (problem.simulator.mechanics().dynamic())
        choose(try_beginnings(problem, from, known, screen_first(frames / 4)), 3, 1, chosen);
    if (known == nullptr)
        choose(screening, static_cast<std::size_t>(options.num_refits) - 2, 2, chosen);
    else
        choose(screening, 2, 1, chosen);
    std::vector<Cause> causes = fit_chosen(problem, nominal, base, chosen);
    if (known == nullptr) add_screened(screening, causes);
    finish(problem, nominal, base, screening, causes);
    return causes;
}

bool look_again(Problem& problem, const Fit& nominal, const Screening& screening, std::vector<Cause>& causes) {
    const std::vector<std::size_t> told = convincing(problem, nominal, causes);
    const bool enough = std::any_of(causes.begin(), causes.end(),
                                    [](const Cause& c) { return c.entries.size() == 1 && explains_most(c); });
    if (told.empty() && enough) return false;
    const bool offset = told.size() == 1 && may_be_support(problem.simulator.effects()[told.front()]);
    if (told.size() == 1 && !offset) return false;
    const double best_before = causes.front().score;
    const auto report = stage(problem.options, "looking again");
    if (told.empty()) {
        const auto count = static_cast<std::size_t>(std::count_if(
            causes.begin(), causes.end(), [](const Cause& c) { return c.entries.size() == 1 && c.fit.usable; }));
        const std::vector<std::size_t> chosen = worth_refitting(screening, 0, count + kSecondLook);
        for (std::size_t k = 0; k < chosen.size(); ++k) {
            const EffectScreening& effect = screening.effects[chosen[k]];
            if (fitted_alone(causes, effect.entry) == nullptr) {
                const WithinReach reach(problem, nominal, causes, effect.search_cost);
                Cause cause = refit(problem, nominal, nullptr, effect, kIterations);
                score(problem, nominal, nullptr, cause);
                keep_better(causes, std::move(cause));
            }
            report(0.5 * static_cast<double>(k + 1) / static_cast<double>(chosen.size()));
        }
    }
    const auto in_question = [&](std::size_t entry) {
        const EffectEntry& effect = problem.simulator.effects()[entry];
        const bool fitted = fitted_alone(causes, entry) != nullptr;
        if (!may_have_threshold(effect)) return false;
        if (offset) return !fitted && !effect.info.event;
        return fitted && (told.empty() || std::find(told.begin(), told.end(), entry) != told.end());
    };
    for (std::size_t k = 0; k < screening.effects.size() && !problem.simulator.mechanics().dynamic(); ++k) {
        const EffectScreening& effect = screening.effects[k];
        if (in_question(effect.entry)) {
            const Cause* alone = fitted_alone(causes, effect.entry);
            Cause strong;
            if (alone != nullptr) {
                strong = *alone;
            } else {
                strong.entries = {effect.entry};
                strong.search_cost = effect.search_cost;
            }
            const WithinReach reach(problem, nominal, causes, effect.search_cost);
            refit_strongly(problem, nominal, effect, offset, strong);
            keep_better(causes, std::move(strong));
        }
        report(0.5 + 0.5 * static_cast<double>(k + 1) / static_cast<double>(screening.effects.size()));
    }
    sort_by_score(causes);
    if (causes.front().score <= best_before) return false;
    finish(problem, nominal, nullptr, screening, causes);
    return true;
}

}  // namespace teres
