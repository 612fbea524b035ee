#include "plugins/diagnosis/search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string_view>

#include "plugins/diagnosis/beginnings.h"
#include "plugins/diagnosis/shape_search.h"
#include "plugins/diagnosis/strong_start.h"

namespace teres {
namespace {

constexpr std::size_t kPolished = 2;
constexpr int kIterations = 8, kFurtherIterations = 6;  // of a refit
constexpr double kOutOfReach = 15.0;    // nats between a fitted cause and the screening of one that need not be fitted
constexpr double kMost = 0.9;           // explained: the search need not go on
constexpr std::size_t kSecondLook = 3;  // effects fitted besides if it has to
constexpr std::size_t kFurtherBegun = 4;  // mechanical effects fitted beside others for what they explain of it
constexpr double kLeastOfFamily = 0.1;    // share explained by first order, of an effect of the best one's family
constexpr std::size_t kPlaces = 3;        // from which the best answer is fitted
constexpr double kNearby = 1.5;  // of the best answer's misfit: a fit from another place that stays beyond is given up

// A lasting force or another support: what a support that holds on one side only may look like.
bool may_be_support(const EffectEntry& entry) {
    return !entry.info.event && (entry.support() || std::string_view(entry.info.kind) == "load");
}

// While it lives, fits of this problem are given up that would leave a misfit beyond this one, or begin beyond `start`.
class GivenUpBeyond {
  public:
    GivenUpBeyond(Problem& problem, double misfit, double start = std::numeric_limits<double>::infinity())
        : problem_(problem) {
        problem.out_of_reach = misfit;
        problem.worst_start = start;
    }
    ~GivenUpBeyond() { problem_.out_of_reach = problem_.worst_start = std::numeric_limits<double>::infinity(); }
    GivenUpBeyond(const GivenUpBeyond&) = delete;
    GivenUpBeyond& operator=(const GivenUpBeyond&) = delete;

  private:
    Problem& problem_;
};

// Beyond this misfit an effect is out of the best one's reach even if its amplitudes cost nothing.
double out_of_reach(const Problem& problem, const Fit& nominal, const std::vector<Cause>& causes, double search_cost) {
    if (problem.outlook != nullptr) return std::numeric_limits<double>::infinity();  // what is left later is not known
    double best = 0.0;
    for (const Cause& cause : causes) best = std::max(best, cause.score);
    const double gain = best - kOutOfReach + search_cost;
    return problem.floor.cost_of(problem.floor.above(nominal.cost) *
                                 std::exp(-2.0 * gain / problem.options.calibration.nu));
}

// Effects fitted on top of what is known, two at a time; both are given up by what was known before.
std::vector<Cause> fit_beside(Problem& problem, const Fit& nominal, const Base* base,
                              const std::vector<Cause>& known_so_far, const std::vector<const EffectScreening*>& added,
                              int iterations) {
    const Cause* known = base != nullptr ? &base->known : nullptr;
    std::vector<Cause> fitted(added.size());
    side_by_side(problem, added.size(), [&](Problem& p, std::size_t k) {
        const GivenUpBeyond bound(p,
                                  out_of_reach(p, nominal, known_so_far,
                                               (known != nullptr ? known->search_cost : 0.0) + added[k]->search_cost));
        fitted[k] = refit(p, nominal, known, *added[k], iterations);
        score(p, nominal, base, fitted[k]);
    });
    return fitted;
}

// The same cause from where its effect acts at full size, if that is nearer than where first order leads.
void refit_strongly(Problem& problem, const Fit& nominal, const StrongStart& start, Cause& cause) {
    Eigen::VectorXd trajectory;
    if (!problem.simulator.simulate(start.at, trajectory)) return;  // the base of what follows
    Cause other = cause;
    other.fit = problem.fit(start.at, kIterations);
    settle_instant(problem, other.fit, kIterations);
    if (!other.fit.usable || (cause.fit.usable && other.fit.cost >= cause.fit.cost)) return;
    improve_shapes(problem.simulator, problem.whitener, problem.recording.observed, other.fit);
    cause = std::move(other);
    score(problem, nominal, nullptr, cause);
}

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

// Effects that are not screened on top of `base`.
std::vector<std::size_t> left_out(const EffectTable& effects, const Base* base) {
    if (base == nullptr) return {};
    std::vector<std::size_t> out = base->known.entries;
    for (std::size_t e = 0; e < effects.size(); ++e)
        if (base->sensors_only && !effects[e].sensor) out.push_back(e);
    return out;
}

std::vector<EffectScreening> chosen_of(const Screening& screening, std::size_t by_score, std::size_t by_share) {
    std::vector<EffectScreening> chosen;
    for (const std::size_t k : worth_refitting(screening, by_score, by_share)) chosen.push_back(screening.effects[k]);
    return chosen;
}

// Refits and scores what was chosen; rivals whose linear score is out of the best one's reach are left out.
std::vector<Cause> fit_chosen(Problem& problem, const Fit& nominal, const Base* base,
                              const std::vector<EffectScreening>& chosen) {
    const Cause* known = base != nullptr ? &base->known : nullptr;
    const std::size_t always = known == nullptr ? 2 : 1;
    const int iterations = known == nullptr ? kIterations : kFurtherIterations;
    const auto report =
        stage(problem.options, known == nullptr ? "fitting the best effects" : "fitting further effects");
    report(0.0);
    std::vector<Cause> causes;
    const auto settled = [&](const EffectScreening& next) {
        const EffectEntry& entry = problem.simulator.effects()[next.entry];
        if (problem.simulator.mechanics().dynamic() && !entry.sensor) return false;
        // A clamp that gives way: first order says much less than it explains, and nothing is to be searched.
        if (entry.support() && next.num_candidates == 1) return false;
        const auto best = std::max_element(causes.begin(), causes.end(),
                                           [](const Cause& a, const Cause& b) { return a.score < b.score; });
        const double lead = best->score - (known != nullptr ? known->score : 0.0) - next.score;
        return lead > 2.0 * kOutOfReach || (lead > kOutOfReach && best->fit.compared_cost() < problem.floor.total());
    };
    for (std::size_t next = 0; next < chosen.size();) {
        std::vector<const EffectScreening*> pair;
        for (; next < chosen.size() && pair.size() < 2; ++next)
            if (causes.size() < always || (!problem.out_of_time() && !settled(chosen[next])))
                pair.push_back(&chosen[next]);
        for (Cause& cause : fit_beside(problem, nominal, base, causes, pair, iterations))
            causes.push_back(std::move(cause));
        report(static_cast<double>(next) / static_cast<double>(chosen.size()));
    }
    return causes;
}

// What is of one family with the best cause looks like it, and little tells them apart by first order: it is fitted,
// too.
void fit_family(Problem& problem, const Fit& nominal, const Base* base, const Screening& screening,
                std::vector<Cause>& causes) {
    sort_by_score(causes);
    if (causes.empty() || !causes.front().fit.usable || problem.out_of_time()) return;
    const EffectTable& effects = problem.simulator.effects();
    const std::string_view family = effects[causes.front().entries.back()].info.family;
    const auto fitted = [&](std::size_t entry) {
        return std::any_of(causes.begin(), causes.end(), [&](const Cause& c) { return c.entries.back() == entry; });
    };
    std::vector<const EffectScreening*> others;
    for (const EffectScreening& effect : screening.effects)
        if (others.size() < 2 && family == effects[effect.entry].info.family && !fitted(effect.entry) &&
            effect.explained >= kLeastOfFamily)
            others.push_back(&effect);
    const int iterations = base == nullptr ? kIterations : kFurtherIterations;
    for (Cause& cause : fit_beside(problem, nominal, base, causes, others, iterations))
        causes.push_back(std::move(cause));
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
    const auto found = centre_of(entry, cause.fit.at.effects.back()), begun = centre_of(entry, screened->start);
    std::vector<EffectScreening> places;
    for (const PlaceGain& place : best_places(screened->places, kPlaces)) {
        if ((place.centre_m - *found).norm() < apart || place.centre_m == *begun) continue;
        places.push_back(*screened);
        places.back().start = with_instant_of(entry, place.start, cause.fit.at.effects.back());
    }
    std::vector<Cause> others(places.size());
    const double nearby =
        problem.outlook != nullptr ? std::numeric_limits<double>::infinity() : kNearby * cause.fit.misfit;
    side_by_side(problem, places.size(), [&](Problem& p, std::size_t k) {
        const GivenUpBeyond bound(p, nearby, nominal.misfit);
        others[k] = refit(p, nominal, base != nullptr ? &base->known : nullptr, places[k], kFurtherIterations);
    });
    for (Cause& other : others)
        if (other.fit.usable && other.fit.cost < cause.fit.cost) cause = std::move(other);
    score(problem, nominal, base, cause);
}

// The next best fitted cause whose last effect has a place: one that stayed in a far hollow may be the better answer.
// Null where the best one leaves no more than noise and model error explain, or has a place itself.
Cause* placed_rival(const Problem& problem, const Screening& screening, const std::vector<Cause*>& fitted) {
    const auto has_places = [&](const Cause* cause) {
        return std::any_of(screening.effects.begin(), screening.effects.end(), [&](const EffectScreening& e) {
            return e.entry == cause->entries.back() && !e.places.empty();
        });
    };
    const Cause& best = *fitted.front();
    if (best.fit.compared_cost() < problem.floor.total() || has_places(&best)) return nullptr;
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

// The best cause from other places as well; the best few fitted to the end.
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
    side_by_side(problem, best.size(), [&](Problem& p, std::size_t k) {
        settle(p, *best[k], kFurtherIterations);
        score(p, nominal, base, *best[k]);
    });
    report(1.0);
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
        for (Cause& cause : fit_beside(problem, nominal, nullptr, causes, pair, kIterations))
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
    const std::vector<double> theta = prior_median(problem.simulator.mechanics()).theta;
    std::vector<StrongStart> starts;
    std::vector<Cause> strong;  // one per start
    for (std::size_t k = 0; k < supports.size() && !problem.out_of_time(); ++k) {
        const EffectScreening& support = *supports[k];
        const Cause* alone = fitted_alone(causes, support.entry);
        for (StrongStart& start :
             best_strong_starts(problem, frames, strong_starts(problem.simulator.effects(), support, theta))) {
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
            const GivenUpBeyond bound(p, out_of_reach(p, nominal, causes, cause.search_cost));
            refit_strongly(p, nominal, starts[first + k], cause);
        });
        for (std::size_t k = 0; k < count; ++k) keep_better(causes, std::move(strong[first + k]));
        report(0.5 + 0.5 * static_cast<double>(first + count) / static_cast<double>(strong.size()));
    }
}

}  // namespace

std::vector<Cause> search(Problem& problem, const Fit& nominal, const Base* base, Screening& screening) {
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
    if (base != nullptr && base->sensors_only)  // first order is nearly exact there
        std::erase_if(screening.effects, [](const EffectScreening& effect) { return effect.score <= 0.0; });
    std::vector<EffectScreening> chosen;
    if (problem.simulator.mechanics().dynamic()) {
        const auto begun =
            try_beginnings(problem, from, screen_first(frames / 4),
                           stage(options, known == nullptr ? "trying effects" : "trying further effects"));
        take_from_beginning(problem.simulator.effects(), begun, screening);
        chosen = choose_with_inertia(problem.simulator.effects(), begun,
                                     known == nullptr ? static_cast<std::size_t>(options.num_refits) : kFurtherBegun,
                                     screening);
    } else if (known == nullptr) {
        chosen = chosen_of(screening, static_cast<std::size_t>(options.num_refits) - 2, 2);
    } else {
        chosen = chosen_of(screening, 2, 1);
    }
    std::vector<Cause> causes = fit_chosen(problem, nominal, base, chosen);
    fit_family(problem, nominal, base, screening, causes);
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
    if (told.empty())
        fit_overlooked(
            problem, nominal, screening, [&](double part) { return report(0.5 * part); }, causes);
    const auto in_question = [&](std::size_t entry) {
        const EffectEntry& effect = problem.simulator.effects()[entry];
        const bool fitted = fitted_alone(causes, entry) != nullptr;
        if (!effect.support()) return false;
        if (offset) return !fitted && !effect.info.event;
        return fitted && (told.empty() || std::find(told.begin(), told.end(), entry) != told.end());
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
