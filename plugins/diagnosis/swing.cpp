#include "plugins/diagnosis/swing.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "plugins/diagnosis/beginnings.h"
#include "plugins/diagnosis/search_steps.h"

namespace teres {
namespace {

constexpr double kMost = 0.9;        // explained by them together: the search begins there
constexpr double kHopeful = 10.0;    // times what the best set leaves of a quarter: tried on half
constexpr std::size_t kInPlace = 2;  // effects fitted in the place of one
constexpr int kTryIterations = 3;
constexpr int kSettleRounds = 3;
constexpr double kSettled = 0.95;      // of the cost: no further round
constexpr double kCloseBehind = 10.0;  // nats: may be ahead once both are settled
constexpr std::size_t kClose = 2;      // of these

using SearchCosts = decltype(Swing::search_costs);

std::vector<std::size_t> all_but(const EffectTable& effects, std::size_t entry) {
    std::vector<std::size_t> others;
    for (std::size_t e = 0; e < effects.size(); ++e)
        if (e != entry) others.push_back(e);
    return others;
}

Assumption with(Assumption at, ActiveEffect effect) {
    at.effects.push_back(std::move(effect));
    return at;
}

Assumption without(Assumption at, std::size_t entry) {
    std::erase_if(at.effects, [&](const ActiveEffect& effect) { return effect.entry == entry; });
    return at;
}

Cause as_cause(const Assumption& at, const SearchCosts& costs) {
    Cause cause;
    for (const ActiveEffect& effect : at.effects) {
        cause.entries.push_back(effect.entry);
        if (const auto cost = costs.find(effect.entry); cost != costs.end()) cause.search_cost += cost->second;
    }
    return cause;
}

bool all_of_first(const Cause& first, const Cause& second) {
    return std::all_of(first.entries.begin(), first.entries.end(),
                       [&](std::size_t entry) { return contains(second, entry); });
}

// The same effects, which are among `causes`.
const Cause& same_set(const std::vector<Cause>& causes, const Cause& set) {
    return *std::find_if(causes.begin(), causes.end(), [&](const Cause& cause) {
        return cause.entries.size() == set.entries.size() && all_of_first(cause, set);
    });
}

// The best fitted set of one effect less, or null.
const Cause* best_part(const std::vector<Cause>& causes, const Cause& of) {
    const Cause* best = nullptr;
    for (const Cause& cause : causes)
        if (cause.fit.usable && cause.entries.size() + 1 == of.entries.size() && all_of_first(cause, of) &&
            (best == nullptr || cause.score > best->score))
            best = &cause;
    return best;
}

// As one more than the best part, without what looser forms take of that one's evidence either. `form_nats`: at least,
// as what another set gained is worth no more here (pay_alike()).
void score_beside_part(Problem& problem, const Fit& nominal, const std::vector<Cause>& causes, double form_nats,
                       Cause& cause) {
    const Cause* part = best_part(causes, cause);
    if (part == nullptr) return score(problem, nominal, nullptr, cause);
    const Base base{*part, problem.whitener, part->fit,
                    left_under(problem, problem.whitener, part->fit, nominal.u.size())};
    score(problem, nominal, &base, cause);
    pay_alike(std::max(form_nats, cause.form_nats + part->form_nats), cause);
}

std::vector<Cause> fit_all(Problem& problem, const Fit& nominal, const std::vector<Assumption>& starts,
                           const SearchCosts& costs, int iterations, const Simulator::Progress& report) {
    std::vector<Cause> fitted(starts.size());
    side_by_side(problem, starts.size(), [&](Problem& p, std::size_t k) {
        if (!p.out_of_time()) fitted[k] = fitted_from(p, nominal, as_cause(starts[k], costs), starts[k], iterations);
        if (&p == &problem) report(static_cast<double>(k + 1) / static_cast<double>(starts.size()));
    });
    std::erase_if(fitted, [](const Cause& cause) { return !cause.fit.usable; });
    return fitted;
}

// The sets that one effect less makes, from where these are in `all`.
std::vector<Cause> fit_parts(Problem& problem, const Fit& nominal, const Assumption& all, const SearchCosts& costs,
                             const Simulator::Progress& report) {
    std::vector<Assumption> parts;
    if (all.effects.size() > 1)
        for (const ActiveEffect& effect : all.effects) parts.push_back(without(all, effect.entry));
    std::vector<Cause> fitted = fit_all(problem, nominal, parts, costs, kFurtherIterations, report);
    sort_by_score(fitted);
    return fitted;
}

// Errors of the model take up part of what a modulus a little off would leave of the beginning, and what is predicted
// after it has no such help: a fit that leaves them nothing to do may leave less in all.
void fit_without_model_error(Problem& problem, Cause& cause) {
    const Whitener white(problem.whitener.rows(), problem.whitener.inverse_sigma().cwiseInverse(),
                         Eigen::MatrixXd(problem.recording.observed.size(), 0));
    Fit fit = fit_jointly(problem.simulator, white, problem.recording.observed, cause.fit.at,
                          {.max_iterations = kRefitIterations, .limit = problem.limit});
    if (!fit.usable) return;
    problem.complete(fit);
    problem.look_ahead(fit);
    if (fit.usable && fit.compared_cost() < cause.fit.compared_cost()) cause.fit = std::move(fit);
}

// Fits the best few on until little is gained: where valleys are flat a fit ends before it is at their bottom.
void settle_best(Problem& problem, const Fit& nominal, std::size_t most, std::vector<Cause>& causes) {
    sort_by_score(causes);
    std::vector<Cause*> best;
    for (Cause& cause : causes)
        if (best.size() < most && cause.fit.usable && cause.score > causes.front().score - kCloseBehind)
            best.push_back(&cause);
    const auto report = stage(problem.options, "settling the best");
    side_by_side(problem, best.size(), [&](Problem& p, std::size_t k) {
        for (int round = 0; round < kSettleRounds && !p.out_of_time(); ++round) {
            const double before = best[k]->fit.cost;
            settle(p, *best[k], kRefitIterations);
            if (best[k]->fit.cost > kSettled * before) break;
        }
        if (!p.out_of_time()) fit_without_model_error(p, *best[k]);
        if (&p == &problem) report(static_cast<double>(k + 1) / static_cast<double>(best.size()));
    });
    for (Cause* cause : best) {
        const double form_nats = cause->form_nats;
        score_beside_part(problem, nominal, causes, form_nats, *cause);
    }
    sort_by_score(causes);
}

// Fitted parts of a fitted set, what the best of them is made of, and the set as one more than that.
void take_apart(Problem& problem, const Fit& nominal, const Cause& whole, const SearchCosts& costs,
                std::vector<Cause>& causes) {
    const auto report = stage(problem.options, "fitting sets of these effects");
    report(0.0);
    std::vector<Cause> parts =
        fit_parts(problem, nominal, whole.fit.at, costs, [&](double part) { return report(0.5 * part); });
    if (parts.empty()) return keep_better(causes, whole);
    for (Cause& smaller : fit_parts(problem, nominal, parts.front().fit.at, costs,
                                    [&](double part) { return report(0.5 + 0.3 * part); }))
        keep_better(causes, std::move(smaller));
    for (Cause& part : parts) {
        score_beside_part(problem, nominal, causes, 0.0, part);
        keep_better(causes, std::move(part));
    }
    const Cause& best = *best_part(causes, whole);
    Assumption in_order{whole.fit.at.theta, {}};
    std::vector<ActiveEffect> effects = whole.fit.at.effects;
    std::stable_partition(effects.begin(), effects.end(),
                          [&](const ActiveEffect& effect) { return contains(best, effect.entry); });
    in_order.effects = std::move(effects);
    for (Cause& cause : fit_all(problem, nominal, {in_order}, costs, kRefitIterations,
                                [&](double part) { return report(0.8 + 0.2 * part); })) {
        score_beside_part(problem, nominal, causes, whole.form_nats, cause);
        keep_better(causes, std::move(cause));
    }
}

// About `best`, what is left where its effect `which` is taken away and the others are free, to first order.
Fit taken_away(const Simulator& simulator, const Fit& best, std::size_t which) {
    const FitSpace space(simulator.mechanics(), simulator.effects(), best.at);
    const Eigen::Index first = space.coordinate(which, 0),
                       count = static_cast<Eigen::Index>(best.at.effects[which].values.size()),
                       after = best.u.size() - first - count;
    Fit out = best;
    out.residual += best.J.middleCols(first, count) * best.u.segment(first, count);
    out.J.resize(Eigen::NoChange, best.u.size() - count);
    out.J << best.J.leftCols(first), best.J.rightCols(after);
    out.u.resize(best.u.size() - count);
    out.u << best.u.head(first), best.u.tail(after);
    return out;
}

// What may stand for effects of `best`, beside the others as they are: where fits of the beginning end that come near
// what the best set leaves of it. Fills search costs.
std::vector<Assumption> stand_ins(Problem& problem, const Fit& best, SearchCosts& costs) {
    Simulator& simulator = problem.simulator;
    const std::size_t quarter = problem.recording.num_frames / 4;
    std::vector<std::size_t> entries;
    for (const ActiveEffect& effect : best.at.effects) entries.push_back(effect.entry);
    const Signatures others = [&] {
        const Horizon horizon(simulator, quarter);
        Eigen::VectorXd motion;
        simulator.simulate(best.at, motion);
        return signatures(simulator, best, entries, stage(problem.options, "screening what else it may be"));
    }();
    const auto left = [&](std::size_t share) {
        return std::max(fit_beginning(problem, share, best.at, kTryIterations).cost,
                        problem.floor.total() / static_cast<double>(share));
    };
    const double most_of_quarter = kHopeful * left(4),
                 most_of_half = std::exp(2.0 * kOutOfReach / problem.options.calibration.nu) * left(2);
    const auto report = stage(problem.options, "trying what else it may be");
    std::vector<Assumption> starts;
    for (std::size_t k = 0; k < entries.size() && !problem.out_of_time(); ++k) {
        const Assumption rest = without(best.at, entries[k]);
        const double before = left_of_beginning(problem, rest);
        Screening screening = screen(simulator, others, problem.whitener, problem.floor, taken_away(simulator, best, k),
                                     problem.options.calibration, quarter);
        std::vector<EffectScreening> tried = try_beginnings(
            problem, rest, before, std::move(screening), most_of_quarter,
            [&](double part) { return report((static_cast<double>(k) + part) / static_cast<double>(entries.size())); });
        std::erase_if(tried,
                      [&](const EffectScreening& effect) { return (1.0 - effect.explained) * before > most_of_half; });
        tried.resize(std::min(tried.size(), kInPlace));
        for (EffectScreening& effect : tried) {
            costs[effect.entry] = effect.search_cost;
            starts.push_back(with({rest.theta, std::move(effect.beside)}, std::move(effect.start)));
        }
    }
    return starts;
}

// Everything else in the place of each effect of `best`.
void exchange(Problem& problem, const Fit& nominal, const Cause& best, SearchCosts& costs, std::vector<Cause>& causes) {
    Fit about = best.fit;
    problem.complete(about);
    if (!about.usable) return;
    const std::vector<Assumption> starts = stand_ins(problem, about, costs);
    std::vector<Cause> others = fit_all(problem, nominal, starts, costs, kFurtherIterations,
                                        stage(problem.options, "fitting what else it may be"));
    for (Cause& other : others) score_beside_part(problem, nominal, causes, best.form_nats, other);
    for (Cause& other : others) keep_better(causes, std::move(other));
}

// Where a set leaves no more than noise and the model's error explain, another one may leave less because it has the
// form of that error: this is no evidence for it, and it must be cheaper to be named.
void pay_within_floor(const Problem& problem, const Cause& standing, std::vector<Cause>& causes) {
    const ErrorFloor& floor = problem.floor;
    if (!floor.explains(standing.left())) return;
    for (Cause& cause : causes) {
        if (!cause.fit.usable || all_of_first(cause, standing) || !floor.explains(cause.left())) continue;
        const double less = floor.log_above(standing.left()) - floor.log_above(cause.left());
        pay_alike(cause.form_nats + 0.5 * problem.options.calibration.nu * std::max(0.0, less), cause);
    }
}

// A usual mass where first order sees most of it, and what its search costs.
std::optional<std::pair<ActiveEffect, double>> usual_mass(Problem& problem, const Assumption& beside,
                                                          std::size_t mass) {
    const Fit about = fit_from_whole(problem, beside, 0);
    if (!about.usable) return std::nullopt;
    const EffectTable& effects = problem.simulator.effects();
    const Screening screening = screen(
        problem.simulator, signatures(problem.simulator, about, all_but(effects, mass), [](double) { return true; }),
        problem.whitener, problem.floor, about, problem.options.calibration, problem.recording.num_frames / 4);
    const EffectScreening& best = screening.effects.front();
    return std::pair(effects.candidate(mass, best.candidate), best.search_cost);
}

// Steps of a fit are taken in motions about the last whole one, here that of the start.
Fit fit_growing_from(Problem& problem, const Assumption& start) {
    {
        const Horizon half(problem.simulator, problem.recording.num_frames / 2);
        Eigen::VectorXd motion;
        if (!problem.simulator.simulate(start, motion)) return {};
    }
    Fit fit = fit_beginning(problem, 4, start, kRefitIterations);
    if (fit.usable) fit = fit_beginning(problem, 2, fit.at, kRefitIterations);
    return fit.usable ? fit_from_whole(problem, fit.at, kRefitIterations) : fit;
}

}  // namespace

std::shared_ptr<const Swing> fit_swing(Problem& problem, const Fit& nominal) {
    const EffectTable& effects = problem.simulator.effects();
    const auto can_be = [&](const char* id) {
        const std::size_t entry = effects.find(id);
        return entry < effects.size() && effects[entry].applicable() ? std::optional(entry) : std::nullopt;
    };
    const std::optional<std::size_t> stiffness = can_be("stiffness"), damping = can_be("damping"),
                                     mass = can_be("inertia");
    if (stiffness.has_value() + damping.has_value() + mass.has_value() < 2) return nullptr;
    const auto report = stage(problem.options, "fitting stiffness, damping and mass together");
    report(0.0);
    std::vector<Swing> swings(stiffness ? 2 : 1);
    side_by_side(problem, swings.size(), [&](Problem& p, std::size_t k) {
        Assumption start = nominal.at;
        if (stiffness) {
            ActiveEffect modulus = effects.candidate(*stiffness, 0);
            if (k == 1) modulus.values[0] = at_share(effects[*stiffness].parameters[0], modulus.values[0], -1.0);
            start.effects.push_back(std::move(modulus));
        }
        if (damping) start.effects.push_back(effects.candidate(*damping, 0));
        if (mass) {
            const auto usual = usual_mass(p, start, *mass);
            if (!usual) return;
            start.effects.push_back(usual->first);
            swings[k].search_costs[*mass] = usual->second;
        }
        swings[k].fit = fit_growing_from(p, start);
    });
    report(1.0);
    const auto better = [](const Swing& a, const Swing& b) {
        return a.fit.usable && (!b.fit.usable || a.fit.cost < b.fit.cost);
    };
    const Swing& best = *std::min_element(swings.begin(), swings.end(), better);
    return best.fit.usable ? std::make_shared<const Swing>(best) : nullptr;
}

std::vector<Cause> search_from_swing(Problem& problem, const Fit& nominal) {
    if (problem.floor.explains(left_of(nominal)) || problem.out_of_time()) return {};
    if (!problem.swing) problem.swing = fit_swing(problem, nominal);
    if (!problem.swing) return {};
    SearchCosts costs = problem.swing->search_costs;
    const Assumption& at = problem.swing->fit.at;
    const Cause together = fitted_from(problem, nominal, as_cause(at, costs), at, kRefitIterations);
    if (!together.fit.usable || together.explained < kMost) return {};
    std::vector<Cause> causes;
    take_apart(problem, nominal, together, costs, causes);
    settle_best(problem, nominal, 1, causes);
    const Cause best = causes.front();
    exchange(problem, nominal, best, costs, causes);
    settle_best(problem, nominal, kClose, causes);
    pay_within_floor(problem, same_set(causes, best), causes);
    sort_by_score(causes);
    if (const Cause found = causes.front(); !all_of_first(found, best))
        take_apart(problem, nominal, found, costs, causes);
    return causes;
}

}  // namespace teres
