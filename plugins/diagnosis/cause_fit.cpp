#include "plugins/diagnosis/cause_fit.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "plugins/diagnosis/shape_search.h"
#include "plugins/diagnosis/strong_start.h"
#include "plugins/diagnosis/white_noise.h"

namespace teres {
namespace {

constexpr int kAttempts = 3;
constexpr int kShapeRounds = 3;    // of moved onsets and windows, and everything fitted again
constexpr double kImproved = 0.8;  // of the cost: worth another round
constexpr int kInstantRounds = 3;
constexpr double kMoved = 0.95;  // of the misfit: a better instant
constexpr int kSettleRounds = 5;
constexpr double kSettled = 0.95;       // of what was left: no further round
constexpr double kAnotherCourse = 1.2;  // times what was left: not by rounding
constexpr double kFarOff = 2.0;         // times the misfit without the effect: no start
constexpr double kFarTheta = 1.5;       // prior standard deviations from the prior at which a refit starts at most
constexpr double kTornNearby = 1.5;     // times what the best of a tear's starts leaves: given up beyond
constexpr double kTrace = 0.1;          // of what first order asks for: hardly more than without the effect

// Whether one of its effects may differ from the catalogue's in its form.
bool has_form(const Problem& problem, const Cause& cause) {
    return std::any_of(cause.entries.begin(), cause.entries.end(),
                       [&](std::size_t e) { return !problem.simulator.effects()[e].exact_form(); });
}

// The effect `noise`: markers scatter more, and are where they were.
bool only_scatters(const Problem& problem, std::size_t entry) {
    return problem.simulator.noise_factor({{}, {problem.simulator.effects().candidate(entry, 0)}}) != 1.0;
}

}  // namespace

Left left_under(const Problem& problem, const Whitener& whitener, const Fit& fit, Eigen::Index nominal_parameters) {
    const Eigen::VectorXd residual = whitener(problem.residual_of(fit.trajectory));
    const double misfit = residual.squaredNorm() + fit.u.head(nominal_parameters).squaredNorm();
    return problem.floor.beside_noise({misfit + fit.later, problem.beside_span(residual)},
                                      problem.simulator.noise_factor(fit.at));
}

namespace {

// By how much markers scatter more than stated: of second differences, whose median few bad markers change. Beside the
// span of the motion noise is all that is left, and more numbers tell of it: they are believed as far as noise may be
// misstated.
double seen_noise_factor(const Problem& problem, const Fit& fit) {
    const double factor =
        stated_noise_factor(fit.residual, problem.whitener, problem.floor.noise, problem.recording.num_markers);
    if (factor == 1.0 || !problem.floor.split()) return factor;
    const double off = problem.options.calibration.beside_noise, variance = factor * factor;
    const double beside = problem.beside_span(fit.residual) / problem.floor.noise_beside;
    const double seen = std::sqrt(std::clamp(beside, (1.0 - off) * variance, (1.0 + off) * variance));
    return seen > kMisstatedNoise ? seen : 1.0;
}

}  // namespace

void take_noise(Problem& problem, Fit& fit) {
    for (ActiveEffect& effect : fit.at.effects) {
        if (!only_scatters(problem, effect.entry)) continue;
        const EffectEntry& entry = problem.simulator.effects()[effect.entry];
        const double factor = seen_noise_factor(problem, fit);
        for (std::size_t p = 0; p < effect.values.size(); ++p)
            effect.values[p] = std::clamp(factor, entry.parameters[p].lower, entry.parameters[p].upper);
        const double left = problem.floor.beside_noise(fit.misfit, problem.simulator.noise_factor(fit.at)).cost;
        fit.cost += left - fit.misfit;  // fit.later is a difference of two parts that such noise raises alike
        fit.misfit = left;
    }
}

void halve(const EffectEntry& entry, ActiveEffect& effect) {
    for (std::size_t p = 0; p < entry.parameters.size(); ++p) {
        if (entry.parameters[p].role == EffectRole::kAmplitude)
            effect.values[p] = at_share(entry.parameters[p], effect.values[p], 0.5);
    }
}

void settle_instant(Problem& problem, Fit& fit, int iterations) {
    for (int round = 0; round < kInstantRounds; ++round) {
        if (!fit.usable || problem.hopeless(fit) || problem.out_of_time()) return;
        const auto moved = at_best_instant(problem, fit.at, fit.trajectory);
        if (!moved || moved->left > kMoved * fit.misfit) return;
        Fit again = fit_from_whole(problem, moved->at, iterations);
        if (!again.usable || again.cost >= fit.cost) return;
        fit = std::move(again);
    }
}

namespace {

// A wrong model drives the ligaments to values from which no derivative leads back.
Assumption near_prior(const TrajectoryModel& mechanics, Assumption at) {
    for (std::size_t i = 0; i < at.theta.size(); ++i) {
        const NominalParameter p = mechanics.parameter(i);
        at.theta[i] = std::clamp(at.theta[i], std::exp(p.prior_log_mean - kFarTheta * p.prior_log_stdev),
                                 std::exp(p.prior_log_mean + kFarTheta * p.prior_log_stdev));
    }
    return at;
}

Assumption plus(Assumption at, const ActiveEffect& added) {
    at.effects.push_back(added);
    return at;
}

// `at` with the values of `beside` for those of its effects that are among them.
Assumption with_values(Assumption at, const std::vector<ActiveEffect>& beside) {
    for (ActiveEffect& effect : at.effects)
        for (const ActiveEffect& other : beside)
            if (other.entry == effect.entry) effect = other;
    return at;
}

// A whole trajectory with the effect on. Where the body does not hold under what first order asks for, or is far
// further off than without the effect, it is met half way: no descent leads back from another equilibrium. With inertia
// half of it, as the effect was tried on that (try_beginnings()), and how far it is off is a matter of phase. Nothing
// if it does not hold, or is hopelessly far off.
std::optional<Assumption> whole_start(Problem& problem, const Fit& without, const EffectScreening& added) {
    Simulator& simulator = problem.simulator;
    const Assumption known = with_values(near_prior(simulator.mechanics(), without.at), added.beside);
    Assumption start = plus(known, added.start);
    const EffectEntry& entry = simulator.effects()[added.entry];
    const bool dynamic = simulator.mechanics().dynamic(), line_search = !std::isfinite(problem.worst_start);
    const Horizon half(simulator, dynamic ? simulator.num_frames() / 2 : 0);
    for (int attempt = 0; !entry.sensor; ++attempt) {
        Eigen::VectorXd trajectory;
        const bool holds = simulator.simulate(start, trajectory);
        if (!holds && attempt == kAttempts) return {};
        if (holds && dynamic) break;
        const double left = holds ? problem.whitener(problem.residual_of(trajectory)).squaredNorm() : 0.0;
        if (left > problem.worst_start) return {};
        if (holds && (left <= kFarOff * without.misfit || attempt == kAttempts || !line_search)) break;
        halve(entry, start.effects.back());
    }
    return start;
}

// A trace of the added effect is nearly what is known without it.
Fit fit_from_trace(Problem& problem, const Assumption& without, ActiveEffect added, int iterations) {
    const EffectEntry& entry = problem.simulator.effects()[added.entry];
    for (std::size_t p = 0; p < entry.parameters.size(); ++p)
        if (entry.parameters[p].role == EffectRole::kAmplitude)
            added.values[p] = at_share(entry.parameters[p], added.values[p], kTrace);
    return fit_from_whole(problem, plus(without, added), iterations);
}

// Beside a steady load, what acts until some instant explains about what acts the other way round from then on does:
// which of both was found without that load is an accident, and no descent leads from one to the other.
void try_complement(Problem& problem, const Fit& without, const ActiveEffect& added, int iterations, Fit& fit) {
    const EffectTable& effects = problem.simulator.effects();
    if (problem.simulator.mechanics().dynamic() || !effects[added.entry].steady_load()) return;
    for (std::size_t k = 0; k < without.at.effects.size(); ++k) {
        if (problem.out_of_time() || (fit.usable && problem.floor.explains(left_of(fit)))) return;
        const auto other = effects.complement(without.at.effects[k]);
        if (!other) continue;
        Assumption start = without.at;
        start.effects[k] = *other;
        Fit again = fit_from_trace(problem, start, added, iterations);
        if (again.usable && (!fit.usable || again.cost < fit.cost)) fit = std::move(again);
    }
}

Fit fit_with(Problem& problem, const Fit& without, bool further, const EffectScreening& screened, int iterations) {
    const ActiveEffect& added = screened.start;
    const auto start = whole_start(problem, without, screened);
    if (!start) return {};
    Fit fit = problem.fit(*start, iterations);
    // With one effect more it cannot leave more: it went astray.
    if (further && (!fit.usable || fit.misfit > without.residual.squaredNorm()) && !problem.out_of_time()) {
        Fit again = fit_from_trace(problem, without.at, added, iterations);
        if (again.usable && (!fit.usable || again.cost < fit.cost)) fit = std::move(again);
    }
    settle_instant(problem, fit, iterations);
    if (further) try_complement(problem, without, added, iterations, fit);
    for (int round = 0; fit.usable && round < kShapeRounds && !problem.hopeless(fit); ++round) {
        const double before = fit.cost;
        improve_shapes(problem.simulator, problem.whitener, problem.recording.observed, fit);
        if (fit.cost > kImproved * before || fit.cost < problem.floor.total() || problem.out_of_time()) break;
        Fit again = problem.fit_on(fit.at, iterations);
        if (again.usable && again.cost < fit.cost) fit = std::move(again);
    }
    return fit;
}

}  // namespace

Cause refit(Problem& problem, const Fit& nominal, const Cause* known, const EffectScreening& added, int iterations) {
    const Fit& without = known != nullptr ? known->fit : nominal;
    Cause cause;
    if (known != nullptr) {
        cause.entries = known->entries;
        cause.search_cost = known->search_cost;
    }
    cause.entries.push_back(added.entry);
    cause.search_cost += added.search_cost;
    cause.fit = only_scatters(problem, added.entry) ? fit_from_whole(problem, plus(without.at, added.start), 0)
                                                    : fit_with(problem, without, known != nullptr, added, iterations);
    if (!cause.fit.usable) return cause;
    problem.look_ahead(cause.fit, true);
    take_noise(problem, cause.fit);
    return cause;
}

namespace {

// Share of what `known` explains that it may leave because a mechanical effect never has quite the form of the
// catalogue's.
double form_share(const Problem& problem, const Cause& known) {
    const Calibration& c = problem.options.calibration;
    double share = 0.0;
    for (const std::size_t e : known.entries) {
        const EffectEntry& entry = problem.simulator.effects()[e];
        if (entry.exact_form()) continue;
        const double own = problem.simulator.mechanics().dynamic() ? c.form_error_dynamic
                           : entry.local_support()                 ? c.form_error_local_support
                                                                   : c.form_error;
        share = std::max(share, own);
    }
    return share;
}

// Whether looser forms of what is known tell how far off its form is: not with inertia, nor where a support begins to
// hold differs from point to point.
bool forms_tell(const Problem& problem, const Cause& known) {
    return !problem.simulator.mechanics().dynamic() &&
           std::none_of(known.entries.begin(), known.entries.end(),
                        [&](std::size_t e) { return problem.simulator.effects()[e].local_support(); });
}

// Whether the last effect happens and those before it are there from the beginning, or the reverse: what is left of
// frames without the one is no error of its form.
bool apart_in_time(const EffectTable& effects, const Fit& fit) {
    const bool last = effects.happens(fit.at.effects.back());
    return std::none_of(fit.at.effects.begin(), fit.at.effects.end() - 1,
                        [&](const ActiveEffect& before) { return effects.happens(before) == last; });
}

// By what a further effect lowers ln above beside looser forms of the known ones. What even both leave is an error of
// form that the known ones alone have too. Of what is global (EffectEntry::global()) that is not expected beforehand.
double gain_beside_forms(const Problem& problem, const Fit& nominal, const Base& base, const Cause& cause) {
    const Calibration& c = problem.options.calibration;
    const ErrorFloor& floor = problem.floor;
    const Left both = left_under(problem, base.looser, cause.fit, nominal.u.size());
    const bool fixed = problem.simulator.mechanics().dynamic() || !has_form(problem, base.known);
    const EffectTable& effects = problem.simulator.effects();
    const bool asked = !effects[cause.entries.back()].global() && !apart_in_time(effects, cause.fit);
    const Left expected = asked ? untold_form_error(problem, nominal, base) : Left(0.0);
    const auto part = [&](double alone, double with, double of_form, double noise, double model) {
        const double form = of_form + (fixed ? 0.0 : c.rest_is_form * std::max(0.0, with - noise - model));
        const auto above = [&](double cost) { return std::max(0.0, cost - noise) + model + form; };
        return std::log(above(alone) / above(with));
    };
    if (!floor.split()) return part(base.left.cost, both.cost, expected.cost, floor.noise, floor.model);
    return part(base.left.inside(), both.inside(), expected.inside(), floor.noise - floor.noise_beside, floor.model) +
           part(base.left.beside, both.beside, expected.beside, floor.noise_beside, floor.model_beside);
}

}  // namespace

Left untold_form_error(const Problem& problem, const Fit& nominal, const Base& base) {
    const Left most = form_error(problem, nominal, base.known), alone = base.known.left();
    if (!forms_tell(problem, base.known)) return most;
    const double told = problem.options.calibration.untold_form;
    const double beside = std::min(most.beside, told * std::max(0.0, alone.beside - base.left.beside));
    return {std::min(most.inside(), told * std::max(0.0, alone.inside() - base.left.inside())) + beside, beside};
}

Left form_error(const Problem& problem, const Fit& nominal, const Cause& known) {
    const double share = form_share(problem, known);
    const Left before = left_of(nominal), after = left_of(known.fit);
    const double beside = share * std::max(0.0, before.beside - after.beside);
    return {share * std::max(0.0, before.inside() - after.inside()) + beside, beside};
}

void score(Problem& problem, const Fit& nominal, const Base* base, Cause& cause) {
    if (!cause.fit.usable) {
        cause.score = -1e9;
        return;
    }
    const ErrorFloor& floor = problem.floor;
    problem.look_beside(cause.fit);
    cause.score = refit_score(nominal, cause, problem.simulator.effects(), floor, problem.options.calibration);
    cause.explained = explained_share(nominal.compared_cost(), cause.fit.compared_cost(), floor);
    cause.form_nats = 0.0;
    if (base == nullptr) return;
    // A further effect is worth what it gains beside looser forms of the known ones.
    const double gain = floor.log_above(base->known.left()) - floor.log_above(cause.left());
    cause.form_nats =
        0.5 * problem.options.calibration.nu * std::max(0.0, gain - gain_beside_forms(problem, nominal, *base, cause));
    // What was no evidence for those before is none for all of them together.
    if (!problem.simulator.mechanics().dynamic()) cause.form_nats += base->known.form_nats;
    cause.score -= cause.form_nats;
}

void pay_alike(double form_nats, Cause& cause) {
    const double more = std::max(0.0, form_nats - cause.form_nats);
    cause.form_nats += more;
    cause.score -= more;
}

Fit fit_from_whole(Problem& problem, const Assumption& start, int iterations) {
    Eigen::VectorXd trajectory;
    if (!problem.simulator.simulate(start, trajectory)) return {};
    return problem.fit_on(start, iterations);
}

Fit fit_from_full_size(Problem& problem, const Assumption& start, int iterations) {
    Fit fit = fit_from_whole(problem, start, iterations);
    settle_instant(problem, fit, iterations);
    if (fit.usable && !problem.hopeless(fit))
        improve_shapes(problem.simulator, problem.whitener, problem.recording.observed, fit);
    return fit;
}

bool at_full_size(const Problem& problem, const EffectEntry& entry) {
    return entry.tears() && !problem.simulator.mechanics().dynamic();
}

Cause refit_torn(Problem& problem, const Fit& nominal, const EffectScreening& added, int iterations) {
    const std::vector<StrongStart> starts = best_strong_starts(problem, added);
    if (starts.empty()) return refit(problem, nominal, nullptr, added, iterations);
    Cause cause;
    cause.entries = {added.entry};
    cause.search_cost = added.search_cost;
    for (const StrongStart& start : starts) {
        if (cause.fit.usable && (problem.out_of_time() || problem.floor.explains(left_of(cause.fit)))) break;
        Reach reach = problem.reach;
        if (cause.fit.usable) reach.misfit = std::min(reach.misfit, kTornNearby * cause.fit.misfit);
        const GivenUpBeyond bound(problem, reach, problem.worst_start);
        Fit fit = fit_from_full_size(problem, start.at, iterations);
        problem.look_beside(fit);
        if (fit.usable && (!cause.fit.usable || fit.cost < cause.fit.cost)) cause.fit = std::move(fit);
    }
    problem.look_ahead(cause.fit);
    return cause;
}

Cause fitted_from(Problem& problem, const Fit& nominal, Cause cause, const Assumption& start, int iterations) {
    cause.fit = fit_from_whole(problem, start, iterations);
    problem.look_ahead(cause.fit);
    if (cause.fit.usable) take_noise(problem, cause.fit);
    score(problem, nominal, nullptr, cause);
    return cause;
}

void settle(Problem& problem, Cause& cause, int iterations) {
    const bool dynamic = problem.simulator.mechanics().dynamic(),
               scatters = only_scatters(problem, cause.entries.back());
    const int rounds = scatters ? 0 : dynamic ? 1 : kSettleRounds;  // what noise was added to is settled
    for (int round = 0; round < rounds; ++round) {
        const double before = cause.fit.residual.squaredNorm();
        Fit better = fit_from_whole(problem, cause.fit.at, iterations);
        // More than it left before: its course, frame after frame, ends in another equilibrium than the steps of the
        // fit met. What it really leaves counts.
        const bool another = !dynamic && better.misfit > kAnotherCourse * before;
        if (!better.usable || (better.misfit >= before && !another)) break;
        const bool settled = !another && better.misfit > kSettled * before;
        cause.fit = std::move(better);
        take_noise(problem, cause.fit);
        if (settled || problem.out_of_time()) break;
    }
    problem.look_ahead(cause.fit);
}

bool contains(const Cause& cause, std::size_t entry) {
    return std::find(cause.entries.begin(), cause.entries.end(), entry) != cause.entries.end();
}

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

const Cause* fitted_alone(const std::vector<Cause>& causes, std::size_t entry) {
    const auto found = std::find_if(causes.begin(), causes.end(), [&](const Cause& c) {
        return c.entries.size() == 1 && c.entries[0] == entry && c.fit.usable;
    });
    return found != causes.end() ? &*found : nullptr;
}

Cause* best_to_weigh(const Problem& problem, std::vector<Cause>& causes) {
    const auto best = std::max_element(causes.begin(), causes.end(),
                                       [](const Cause& a, const Cause& b) { return a.score < b.score; });
    const bool pays = best != causes.end() && best->fit.usable && best->score > 0.0;
    return pays && !problem.simulator.mechanics().dynamic() && !problem.out_of_time() ? &*best : nullptr;
}

double best_score(const std::vector<Cause>& causes) {
    double best = 0.0;
    for (const Cause& cause : causes) best = std::max(best, cause.score);
    return best;
}

void sort_by_score(std::vector<Cause>& causes) {
    std::stable_sort(causes.begin(), causes.end(), [](const Cause& a, const Cause& b) { return a.score > b.score; });
}

}  // namespace teres
