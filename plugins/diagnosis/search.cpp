#include "plugins/diagnosis/search.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string_view>

#include "plugins/diagnosis/form_columns.h"
#include "plugins/diagnosis/shape_search.h"
#include "plugins/diagnosis/strong_start.h"
#include "plugins/diagnosis/white_noise.h"

namespace teres {
namespace {

constexpr int kPolished = 2;
constexpr int kAttempts = 3;
constexpr double kOutOfReach = 15.0;    // nats between a fitted cause and the screening of one that need not be fitted
constexpr double kFarTheta = 1.5;       // prior standard deviations from the prior at which a refit starts at most
constexpr double kMost = 0.9;           // explained: the search need not go on
constexpr std::size_t kSecondLook = 3;  // effects fitted besides if it has to
constexpr double kLeastExplained = 0.02;  // of the nominal cost, by first order: less is not worth a fit
constexpr double kLeastEarly = 0.1;       // ... of the cost of the beginning of a dynamic recording
constexpr int kExchanges = 2;             // of the first effect of a pair
constexpr double kFormShare = 0.2;        // standard deviation of a form, share of the effect's motion
constexpr std::size_t kPlaces = 3;        // from which the best answer is fitted
constexpr double kApart = 0.12;           // their least distance, share of the extent of all

// The effect `noise` moves nothing; it is worth the white part of what is left.
void take_noise(Problem& problem, Fit& fit) {
    for (ActiveEffect& effect : fit.at.effects) {
        const EffectEntry& entry = problem.simulator.effects()[effect.entry];
        Assumption alone{fit.at.theta, {problem.simulator.effects().candidate(effect.entry, 0)}};
        if (!entry.sensor || problem.simulator.noise_factor(alone) == 1.0) continue;
        const double factor =
            std::max(1.0, white_noise_factor(fit.residual, problem.whitener.rows(), problem.recording.num_markers));
        for (std::size_t p = 0; p < effect.values.size(); ++p)
            effect.values[p] = std::clamp(factor, entry.parameters[p].lower, entry.parameters[p].upper);
        fit.cost /= factor * factor;
        fit.misfit /= factor * factor;
    }
}

// The amplitudes of an effect half way back to where it is off.
void halve(const EffectEntry& entry, ActiveEffect& effect) {
    for (std::size_t p = 0; p < entry.parameters.size(); ++p) {
        if (entry.parameters[p].role == EffectRole::kAmplitude)
            effect.values[p] = at_share(entry.parameters[p], effect.values[p], 0.5);
    }
}

// One more effect on top of what is known, refitted with everything free.
Cause refit(Problem& problem, const Fit& nominal, const Cause* known, const EffectScreening& added, int iterations) {
    Cause cause;
    Assumption start = known != nullptr ? known->fit.at : nominal.at;
    // A wrong model drives the ligaments to values from which no derivative leads back.
    for (std::size_t i = 0; i < start.theta.size(); ++i) {
        const NominalParameter p = problem.simulator.mechanics().parameter(i);
        start.theta[i] = std::clamp(start.theta[i], std::exp(p.prior_log_mean - kFarTheta * p.prior_log_stdev),
                                    std::exp(p.prior_log_mean + kFarTheta * p.prior_log_stdev));
    }
    if (known != nullptr) {
        cause.entries = known->entries;
        cause.search_cost = known->search_cost;
    }
    cause.entries.push_back(added.entry);
    cause.search_cost += added.search_cost;
    start.effects.push_back(added.start);
    // A whole trajectory with the effect on; a body that does not hold under it is met half way.
    const EffectEntry& entry = problem.simulator.effects()[added.entry];
    Eigen::VectorXd trajectory;
    for (int attempt = 0; !entry.sensor && !problem.simulator.simulate(start, trajectory); ++attempt) {
        if (attempt == kAttempts) return cause;
        halve(entry, start.effects.back());
    }
    cause.fit = problem.fit(start, iterations);
    if (!cause.fit.usable) return cause;
    improve_shapes(problem.simulator, problem.whitener, problem.recording.observed, cause.fit);
    take_noise(problem, cause.fit);
    return cause;
}

// Cost that `known` leaves in a recording with inertia because a mechanical effect never has quite the form of the
// catalogue's; otherwise LooserForms say which residuals that can be.
double form_error(const Problem& problem, const Fit& nominal, const Cause& known) {
    const EffectTable& effects = problem.simulator.effects();
    const bool mechanical =
        std::any_of(known.entries.begin(), known.entries.end(), [&](std::size_t e) { return !effects[e].sensor; });
    return mechanical && problem.simulator.mechanics().dynamic()
               ? problem.options.calibration.form_error_dynamic * std::max(0.0, nominal.cost - known.fit.cost)
               : 0.0;
}

double misfit(const Fit& fit, Eigen::Index nominal_parameters) {
    return fit.cost - fit.u.tail(fit.u.size() - nominal_parameters).squaredNorm();
}

// What one more effect is searched on top of, under the metric in which the known ones may be off in their form.
struct Base {
    const Cause& known;
    Fit fit;
};

// `base`: what the cause was searched on top of, or null.
void score(Problem& problem, const Fit& nominal, const Base* base, Cause& cause) {
    if (!cause.fit.usable) {
        cause.score = -1e9;
        return;
    }
    const ErrorFloor& floor = problem.floor;
    cause.score = refit_score(nominal, cause, problem.simulator.effects(), floor, problem.options.calibration);
    cause.explained = explained_share(nominal.cost, cause.fit.cost, floor);
    if (base == nullptr) return;
    // The known effects gain what they gained alone; the further one what it gains beside their looser forms.
    const Eigen::Index n = nominal.u.size();
    const double alone = floor.above(misfit(base->fit, n)), both = floor.above(cause.misfit),
                 form = form_error(problem, nominal, base->known);
    cause.score -= 0.5 * problem.options.calibration.nu *
                   (std::log(floor.above(base->known.misfit) / alone) + std::log(alone / both) -
                    std::log((alone + form) / (both + form)));
}

// The forms of what is known may be off while more is searched: the whitener carries their columns.
class LooserForms {
  public:
    LooserForms(Problem& problem, const Fit& nominal, const Fit& known)
        : problem_(problem), whitener_(problem.whitener) {
        if (problem.simulator.mechanics().dynamic()) return;
        const Eigen::MatrixXd columns = form_columns(problem.simulator, known.at, known.trajectory, kFormShare);
        Discrepancy looser = problem.discrepancy;
        looser.columns.conservativeResize(Eigen::NoChange, looser.columns.cols() + columns.cols());
        looser.columns.rightCols(columns.cols()) = columns;
        problem.whitener = whitener_for(problem.recording, looser, nominal.trajectory, problem.options.calibration);
    }
    ~LooserForms() { problem_.whitener = std::move(whitener_); }
    LooserForms(const LooserForms&) = delete;
    LooserForms& operator=(const LooserForms&) = delete;

  private:
    Problem& problem_;
    Whitener whitener_;
};

// Supports hold or do not; loads, materials and cameras change by degrees.
bool may_have_threshold(const EffectEntry& entry) {
    return std::string_view(entry.info.kind) == "boundary";
}

// The same from where the effect acts at full size, if that is nearer than where first order leads.
void refit_strongly(Problem& problem, const Fit& nominal, const EffectScreening& added, Cause& cause) {
    const auto best = best_strong_start(
        problem.simulator, problem.whitener, problem.recording.observed,
        strong_starts(problem.simulator.effects(), added, prior_median(problem.simulator.mechanics()).theta));
    if (!best) return;
    Cause other = cause;
    other.fit = problem.fit(best->at, 8);
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

// One cause for each set of effects.
void keep_better(std::vector<Cause>& causes, Cause cause) {
    const auto set = [](std::vector<std::size_t> entries) {
        std::sort(entries.begin(), entries.end());
        return entries;
    };
    const auto same = std::find_if(causes.begin(), causes.end(),
                                   [&](const Cause& c) { return set(c.entries) == set(cause.entries); });
    if (same == causes.end())
        causes.push_back(std::move(cause));
    else if (cause.fit.usable && (!same->fit.usable || cause.score > same->score))
        *same = std::move(cause);
}

// Effects on top of `base`, or, where that is null, of the nominal fit, which then is the simulator's base.
std::vector<Cause> search_on(Problem& problem, const Fit& nominal, const Base* base, Screening& screening) {
    const DiagnosisOptions& options = problem.options;
    const Cause* known = base != nullptr ? &base->known : nullptr;
    const Fit& from = base != nullptr ? base->fit : nominal;
    const Signatures all =
        signatures(problem.simulator, from, known != nullptr ? known->entries : std::vector<std::size_t>{},
                   stage(options, known == nullptr ? "screening effects" : "screening further effects"));
    const std::size_t frames = problem.recording.num_frames;
    const auto screen_first = [&](std::size_t num_frames) {
        return screen(problem.simulator, all, problem.whitener, problem.floor, from, options.calibration, num_frames);
    };
    screening = screen_first(frames);
    std::vector<Cause> causes;
    std::vector<EffectScreening> chosen;
    const auto choose = [&](const Screening& from, std::size_t by_score, std::size_t by_share) {
        for (const std::size_t k : worth_refitting(from, by_score, by_share))
            if (std::none_of(chosen.begin(), chosen.end(),
                             [&](const auto& c) { return c.entry == from.effects[k].entry; }))
                chosen.push_back(from.effects[k]);
    };
    if (problem.simulator.mechanics().dynamic())
        choose(try_beginnings(problem, from, known, screen_first(frames / 4)), 3, 1);
    if (known == nullptr)
        choose(screening, static_cast<std::size_t>(options.num_refits) - 2, 2);
    else
        choose(screening, 2, 1);
    const auto settled = [&](std::size_t next) {  // rivals from `next` on are out of the best one's reach
        const auto best = std::max_element(causes.begin(), causes.end(),
                                           [](const Cause& a, const Cause& b) { return a.score < b.score; });
        const double lead = best->score - (known != nullptr ? known->score : 0.0) - chosen[next].score;
        return lead > 2.0 * kOutOfReach || (lead > kOutOfReach && best->fit.cost < problem.floor.total());
    };
    const auto fit_chosen = [&](std::size_t first) {
        for (std::size_t k = first; k < chosen.size(); ++k) {
            if (causes.size() >= (known == nullptr ? 2u : 1u) && settled(k)) continue;
            causes.push_back(refit(problem, nominal, known, chosen[k], known == nullptr ? 8 : 6));
            score(problem, nominal, base, causes.back());
            stage(options, known == nullptr ? "fitting the best effects" : "fitting further effects")(
                static_cast<double>(k + 1 - first) / static_cast<double>(chosen.size() - first));
        }
    };
    fit_chosen(0);
    // Before `unknown` is said: effects that look worse at first order than they are (contact, tear) get their fit.
    const bool explained =
        std::any_of(causes.begin(), causes.end(), [](const Cause& c) { return c.fit.usable && c.explained >= kMost; });
    if (known == nullptr && !explained && nominal.cost > problem.floor.total()) {
        const std::size_t first = chosen.size();
        choose(screening, 0, first + kSecondLook);
        fit_chosen(first);
        for (std::size_t k = 0; k < causes.size() && !problem.simulator.mechanics().dynamic(); ++k) {
            if (!may_have_threshold(problem.simulator.effects()[causes[k].entries.back()])) continue;
            const auto screened = std::find_if(chosen.begin(), chosen.end(),
                                               [&](const auto& c) { return c.entry == causes[k].entries.back(); });
            refit_strongly(problem, nominal, *screened, causes[k]);
            stage(options, "fitting strong effects")(static_cast<double>(k + 1) / static_cast<double>(causes.size()));
        }
    }
    for (std::size_t k = 0; known == nullptr && k < screening.effects.size(); ++k)
        if (std::none_of(causes.begin(), causes.end(), [&](const Cause& c) {
                return c.entries[0] == screening.effects[k].entry;
            })) {  // screened only: its linear score stands
            Cause cause;
            cause.entries = {screening.effects[k].entry};
            cause.score = screening.effects[k].score;
            cause.explained = screening.effects[k].explained;
            causes.push_back(std::move(cause));
        }
    std::stable_sort(causes.begin(), causes.end(), [](const Cause& a, const Cause& b) { return a.score > b.score; });
    if (!causes.empty()) try_other_places(problem, nominal, base, screening, causes.front());
    for (std::size_t k = 0; k < causes.size() && k < kPolished; ++k) {
        if (!causes[k].fit.usable) continue;
        Fit better = problem.fit(causes[k].fit.at, 6);
        if (better.usable && better.misfit < causes[k].fit.residual.squaredNorm()) {
            causes[k].fit = std::move(better);
            take_noise(problem, causes[k].fit);
        }
        score(problem, nominal, base, causes[k]);
    }
    std::stable_sort(causes.begin(), causes.end(), [](const Cause& a, const Cause& b) { return a.score > b.score; });
    return causes;
}

// One effect more than `known`, whose form may be off meanwhile. Nothing if that explains what is left.
std::vector<Cause> search_on_top(Problem& problem, const Fit& nominal, const Cause& known) {
    std::vector<Cause> larger;
    {
        const LooserForms looser(problem, nominal, known.fit);
        Base base{known, problem.fit(known.fit.at, 4)};
        if (!base.fit.usable) return larger;
        problem.complete(base.fit);
        take_noise(problem, base.fit);
        if (base.fit.cost < problem.floor.total() + form_error(problem, nominal, known)) return larger;
        Screening screening;
        larger = search_on(problem, nominal, &base, screening);
    }
    if (problem.simulator.mechanics().dynamic()) return larger;
    for (Cause& cause : larger) {  // what is told and compared with `unknown` is the misfit itself
        if (!cause.fit.usable) continue;
        if (&cause == &larger.front())
            if (Fit exact = problem.fit(cause.fit.at, 4); exact.usable) cause.fit = std::move(exact);
        cause.fit.residual = problem.whitener(problem.residual_of(cause.fit));
        cause.fit.misfit = cause.fit.residual.squaredNorm();
        cause.fit.cost = cause.fit.misfit + cause.fit.u.squaredNorm();
        take_noise(problem, cause.fit);
        cause.misfit = misfit(cause.fit, nominal.u.size());
        cause.explained = explained_share(nominal.cost, cause.fit.cost, problem.floor);
    }
    return larger;
}

}  // namespace

std::vector<Cause> search(Problem& problem, const Fit& nominal, Screening& screening) {
    return search_on(problem, nominal, nullptr, screening);
}

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
