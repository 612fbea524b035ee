#include "plugins/diagnosis/diagnosis.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "plugins/diagnosis/gap_map.h"
#include "plugins/diagnosis/shape_search.h"
#include "plugins/diagnosis/strong_start.h"
#include "plugins/diagnosis/white_noise.h"

namespace teres {
namespace {

constexpr int kPolished = 2;
constexpr int kAttempts = 3;
constexpr double kNearlyAll = 0.97;     // explained: nothing is left for one more effect
constexpr double kOutOfReach = 15.0;    // nats between a fitted cause and the screening of one that need not be fitted
constexpr double kFarTheta = 1.5;       // prior standard deviations from the prior at which a refit starts at most
constexpr double kMost = 0.9;           // explained: the search need not go on
constexpr std::size_t kSecondLook = 3;  // effects fitted besides if it has to
constexpr double kLeastExplained = 0.02;  // of the nominal cost, by first order: less is not worth a fit
constexpr double kLeastEarly = 0.1;       // ... of the cost of the beginning of a dynamic recording
constexpr std::size_t kPlaces = 3;        // from which the best answer is fitted
constexpr double kApart = 0.12;           // their least distance, share of the extent of all
constexpr double kLateRatio =
    3.0;  // mean square of the unfitted end over that of the fitted part: something happens late

Simulator::Progress stage(const DiagnosisOptions& options, const char* name) {
    return [&options, name](double part) { return !options.progress || options.progress(name, part); };
}

Assumption prior_median(const TrajectoryModel& model) {
    Assumption a;
    for (std::size_t i = 0; i < model.num_parameters(); ++i)
        a.theta.push_back(std::clamp(std::exp(model.parameter(i).prior_log_mean), model.parameter(i).lower,
                                     model.parameter(i).upper));
    return a;
}

// Stated noise and what the discrepancy columns leave: an absolute part, and a share of each marker's displacement.
Whitener whitener_for(const Recording& recording, const Discrepancy& discrepancy, const Eigen::VectorXd& motion,
                      const Calibration& calibration) {
    const auto channels = static_cast<Eigen::Index>(3 * recording.num_markers);
    Eigen::VectorXd sigma(static_cast<Eigen::Index>(recording.fit_rows.size()));
    for (Eigen::Index k = 0; k < sigma.size(); ++k) {
        const Eigen::Index row = recording.fit_rows[static_cast<std::size_t>(k)], first = row - row % 3;
        const double displacement = (motion.segment<3>(first) - motion.segment<3>(first % channels)).norm();
        sigma(k) =
            std::sqrt(std::pow(recording.noise_m, 2) + std::pow(calibration.white_floor_m, 2) +
                      std::pow(discrepancy.remainder_m, 2) + std::pow(calibration.white_share * displacement, 2));
    }
    // The columns' coefficients are N(0,1) against data that count as nu numbers, not as all of them.
    const double counted = std::min(1.0, calibration.nu / static_cast<double>(sigma.size()));
    return Whitener(recording.fit_rows, sigma, std::sqrt(counted) * discrepancy.columns);
}

// One problem: everything that the stages share.
struct Problem {
    Simulator& simulator;
    Recording& recording;
    const DiagnosisOptions& options;
    Discrepancy discrepancy;
    Whitener whitener;
    ErrorFloor floor{};

    Fit fit(const Assumption& start, int iterations, bool robust = false) {
        return fit_jointly(
            simulator, whitener, recording.observed, start,
            {.max_iterations = iterations, .growing = simulator.mechanics().dynamic(), .robust = robust});
    }
    /// Every frame simulated, exact derivatives: the base of a search.
    void complete(Fit& fit) { teres::complete(simulator, whitener, recording.observed, fit); }
};

double mean_square(const Recording& r, const Eigen::VectorXd& simulated, const std::vector<Eigen::Index>& rows) {
    double sum = 0.0;
    for (const Eigen::Index row : rows) sum += std::pow(r.observed(row) - simulated(row), 2);
    return rows.empty() ? 0.0 : sum / static_cast<double>(rows.size());
}

// Nominal parameters alone; whether the last frames are held out or, if something happens in them, markers.
Fit nominal_fit(Problem& problem) {
    Simulator& simulator = problem.simulator;
    Eigen::VectorXd motion;
    simulator.simulate(prior_median(simulator.mechanics()), motion);
    const auto reweigh = [&](const Eigen::VectorXd& about) {
        problem.whitener = whitener_for(problem.recording, problem.discrepancy, about, problem.options.calibration);
    };
    reweigh(motion);
    Fit fit = problem.fit(prior_median(simulator.mechanics()), 8, true);
    if (!fit.usable) return fit;
    const double inside = mean_square(problem.recording, fit.trajectory, problem.recording.fit_rows);
    const double outside = mean_square(problem.recording, fit.trajectory, problem.recording.held_rows);
    if (outside > kLateRatio * std::max(inside, std::pow(problem.recording.noise_m, 2) +
                                                    std::pow(problem.options.calibration.white_floor_m, 2)))
        problem.recording.hold_out_markers();
    reweigh(fit.trajectory);
    problem.complete(fit);          // the frames between follow from a whole trajectory nearby
    fit = problem.fit(fit.at, 10);  // without weights: causes are compared with the best that the nominal model can do
    problem.complete(fit);
    problem.floor = error_floor(problem.whitener, problem.discrepancy, fit.J, problem.recording.noise_m,
                                problem.options.calibration);
    return fit;
}

// The effect `noise` moves nothing; it is worth the white part of what is left.
void take_noise(Problem& problem, Cause& cause) {
    for (ActiveEffect& effect : cause.fit.at.effects) {
        const EffectEntry& entry = problem.simulator.effects()[effect.entry];
        Assumption alone{cause.fit.at.theta, {problem.simulator.effects().candidate(effect.entry, 0)}};
        if (!entry.sensor || problem.simulator.noise_factor(alone) == 1.0) continue;
        const double factor = std::max(
            1.0, white_noise_factor(cause.fit.residual, problem.whitener.rows(), problem.recording.num_markers));
        for (std::size_t p = 0; p < effect.values.size(); ++p)
            effect.values[p] = std::clamp(factor, entry.parameters[p].lower, entry.parameters[p].upper);
        cause.fit.cost /= factor * factor;
        cause.fit.misfit /= factor * factor;
    }
}

// The amplitudes of an effect half way back to where it is off.
void halve(const EffectEntry& entry, ActiveEffect& effect) {
    for (std::size_t p = 0; p < entry.parameters.size(); ++p) {
        double& value = effect.values[p];
        const double null = entry.parameters[p].null_value;
        if (entry.parameters[p].role != EffectRole::kAmplitude) continue;
        value = entry.parameters[p].transform == EffectTransform::kLog && null > 0.0 ? std::sqrt(value * null)
                                                                                     : 0.5 * (value + null);
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
    take_noise(problem, cause);
    return cause;
}

// Cost that `known` leaves because a mechanical cause never has quite the form of the catalogue's.
double form_error(Problem& problem, const Fit& nominal, const Cause& known) {
    const EffectTable& effects = problem.simulator.effects();
    const bool mechanical =
        std::any_of(known.entries.begin(), known.entries.end(), [&](std::size_t e) { return !effects[e].sensor; });
    const Calibration& c = problem.options.calibration;
    return mechanical ? (problem.simulator.mechanics().dynamic() ? c.form_error_dynamic : c.form_error) *
                            std::max(0.0, nominal.cost - known.fit.cost)
                      : 0.0;
}

// `known`: what the cause was searched on top of, or null.
void score(Problem& problem, const Fit& nominal, const Cause* known, Cause& cause) {
    if (!cause.fit.usable) {
        cause.score = -1e9;
        return;
    }
    cause.score = refit_score(nominal, cause, problem.simulator.effects(), problem.floor, problem.options.calibration);
    cause.explained = explained_share(nominal.cost, cause.fit.cost, problem.floor);
    if (known == nullptr) return;
    const double before = problem.floor.above(known->fit.cost), after = problem.floor.above(cause.fit.cost),
                 form = form_error(problem, nominal, *known);
    cause.score -=
        0.5 * problem.options.calibration.nu * (std::log(before / after) - std::log((before + form) / (after + form)));
}

// The same from where the effect acts at full size, if that is nearer than where first order leads.
void refit_strongly(Problem& problem, const Fit& nominal, const Cause* known, const EffectScreening& added,
                    Cause& cause) {
    std::vector<Assumption> starts =
        strong_starts(problem.simulator.effects(), added, prior_median(problem.simulator.mechanics()).theta);
    if (known != nullptr)
        for (Assumption& start : starts)
            start.effects.insert(start.effects.begin(), known->fit.at.effects.begin(), known->fit.at.effects.end());
    const auto best = best_strong_start(problem.simulator, problem.whitener, problem.recording.observed, starts);
    if (!best) return;
    Cause other = cause;
    other.fit = problem.fit(best->at, 8);
    if (!other.fit.usable || (cause.fit.usable && other.fit.cost >= cause.fit.cost)) return;
    improve_shapes(problem.simulator, problem.whitener, problem.recording.observed, other.fit);
    cause = std::move(other);
    score(problem, nominal, known, cause);
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
void try_other_places(Problem& problem, const Fit& nominal, const Cause* known, const Screening& screening,
                      Cause& cause) {
    const auto screened = std::find_if(screening.effects.begin(), screening.effects.end(),
                                       [&](const auto& e) { return e.entry == cause.entries.back(); });
    if (!cause.fit.usable || screened == screening.effects.end() || screened->places.empty()) return;
    const EffectEntry& entry = problem.simulator.effects()[screened->entry];
    const double apart_m = kApart * extent_m(screened->places);
    for (const PlaceGain& place : best_places(screened->places, kPlaces, apart_m)) {
        const auto found = centre_of(entry, cause.fit.at.effects.back()), begun = centre_of(entry, screened->start);
        if ((place.centre_m - *found).norm() < apart_m || place.centre_m == *begun) continue;
        EffectScreening there = *screened;
        there.start = place.start;
        Cause other = refit(problem, nominal, known, there, 6);
        if (other.fit.usable && other.fit.cost < cause.fit.cost) cause = std::move(other);
    }
    score(problem, nominal, known, cause);
}

// Screens all effects on top of `known` (null: nothing) and refits the best.
std::vector<Cause> search(Problem& problem, const Fit& nominal, const Cause* known, Screening& screening) {
    const DiagnosisOptions& options = problem.options;
    Fit base = known != nullptr ? known->fit : nominal;
    if (known != nullptr) problem.complete(base);  // the nominal fit is complete, and the simulator's base
    const Signatures all =
        signatures(problem.simulator, base, known != nullptr ? known->entries : std::vector<std::size_t>{},
                   stage(options, known == nullptr ? "screening effects" : "screening further effects"));
    const std::size_t frames = problem.recording.num_frames;
    const auto screen_first = [&](std::size_t num_frames) {
        return screen(problem.simulator, all, problem.whitener, problem.floor, base, options.calibration, num_frames);
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
        choose(try_beginnings(problem, base, known, screen_first(frames / 4)), 3, 1);
    if (known == nullptr)
        choose(screening, static_cast<std::size_t>(options.num_refits) - 2, 2);
    else
        choose(screening, 2, 1);
    const auto settled = [&](std::size_t next) {  // rivals from `next` on are out of the best one's reach
        const auto best = std::max_element(causes.begin(), causes.end(),
                                           [](const Cause& a, const Cause& b) { return a.score < b.score; });
        const double lead = best->score - chosen[next].score;
        return lead > 2.0 * kOutOfReach || (lead > kOutOfReach && best->fit.cost < problem.floor.total());
    };
    const auto fit_chosen = [&](std::size_t first) {
        for (std::size_t k = first; k < chosen.size(); ++k) {
            if (causes.size() >= 2 && settled(k)) continue;
            causes.push_back(refit(problem, nominal, known, chosen[k], known == nullptr ? 8 : 6));
            score(problem, nominal, known, causes.back());
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
            const auto screened = std::find_if(chosen.begin(), chosen.end(),
                                               [&](const auto& c) { return c.entry == causes[k].entries.back(); });
            refit_strongly(problem, nominal, known, *screened, causes[k]);
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
    if (!causes.empty()) try_other_places(problem, nominal, known, screening, causes.front());
    for (std::size_t k = 0; k < causes.size() && k < kPolished; ++k) {
        if (!causes[k].fit.usable) continue;
        Fit better = problem.fit(causes[k].fit.at, 6);
        if (better.usable && better.misfit < causes[k].fit.residual.squaredNorm()) {
            causes[k].fit = std::move(better);
            take_noise(problem, causes[k]);
        }
        score(problem, nominal, known, causes[k]);
    }
    std::stable_sort(causes.begin(), causes.end(), [](const Cause& a, const Cause& b) { return a.score > b.score; });
    return causes;
}

// All of a recording of which only the beginning is fitted, for predictions.
GapRecording whole_of(GapRecording recording) {
    if (recording.whole_mechanics == nullptr) return recording;
    recording.mechanics = recording.whole_mechanics;
    recording.sensors = recording.whole_sensors;
    recording.observed_m = recording.whole_observed_m;
    return recording;
}

// A recording as far as it goes under assumptions that were fitted elsewhere or on its beginning.
struct Forecast {
    Recording recording;
    Simulator simulator;
    bool beginning_fitted = false;  // else fits of this recording know their trajectories
    std::vector<std::pair<Assumption, Eigen::VectorXd>> known{};

    static Result<Forecast> make(const GapRecording& from, const EffectTable& effects) {
        const GapRecording all = whole_of(from);
        TERES_TRY_ASSIGN(Recording recording, make_recording(all));
        const bool beginning = from.whole_mechanics != nullptr;
        if (beginning) recording.hold_out_frames(from.mechanics->num_frames());
        return Forecast{std::move(recording), Simulator(*all.mechanics, all.sensors, effects), beginning};
    }
    const Eigen::VectorXd* find(const Assumption& at) const {
        for (const auto& [assumption, trajectory] : known)
            if (assumption.theta == at.theta && assumption.effects == at.effects) return &trajectory;
        return nullptr;
    }
    Eigen::VectorXd of(const Fit& fit) {
        return beginning_fitted || find(fit.at) != nullptr ? under(fit.at) : fit.trajectory;
    }
    Eigen::VectorXd under(const Assumption& at) {
        if (const Eigen::VectorXd* trajectory = find(at)) return *trajectory;
        known.emplace_back(at, Eigen::VectorXd{});
        simulator.simulate(at, known.back().second);
        return known.back().second;
    }
    double rms_m(const Assumption& at) {
        return gap_rms_m(recording.observed, under(at), recording.seen_rows(), recording.noise_m);
    }
};

// What carries over to another recording of the body: not what happened once, and not the camera.
Assumption lasting(const EffectTable& effects, const Assumption& from) {
    Assumption out{from.theta, {}};
    for (const ActiveEffect& effect : from.effects)
        if (!effects[effect.entry].sensor && !effects[effect.entry].info.event) out.effects.push_back(effect);
    return out;
}

// Other recordings of the body predicted with what `here` taught, and `here` predicted with the named effects fitted
// there.
Result<std::vector<Transfer>> transfer(Problem& here, Forecast& forecast_here, const Fit& nominal, const Fit& named,
                                       std::span<const GapRecording> recordings, const EffectTable& effects) {
    std::vector<Transfer> out;
    const std::string& name = here.recording.name;
    for (std::size_t k = 1; k < recordings.size(); ++k) {
        stage(here.options,
              "other recordings")(static_cast<double>(k - 1) / static_cast<double>(recordings.size() - 1));
        TERES_TRY_ASSIGN(Forecast forecast_there, Forecast::make(recordings[k], effects));
        TERES_TRY_ASSIGN(Recording other, make_recording(recordings[k]));
        out.push_back(
            {name, other.name, forecast_there.rms_m(nominal.at), forecast_there.rms_m(lasting(effects, named.at))});
        other.fit_rows = other.seen_rows();
        Simulator simulator(*recordings[k].mechanics, recordings[k].sensors, effects);
        Problem there{simulator, other, here.options, {}, {}};
        there.discrepancy.columns.resize(static_cast<Eigen::Index>(simulator.num_rows()), 0);
        Eigen::VectorXd motion;
        simulator.simulate(nominal.at, motion);
        there.whitener = whitener_for(other, there.discrepancy, motion, here.options.calibration);
        const Fit plain = there.fit(nominal.at, 4, true), full = there.fit(lasting(effects, named.at), 4);
        if (plain.usable && full.usable)
            out.push_back({other.name, name, forecast_here.rms_m(plain.at), forecast_here.rms_m(full.at)});
    }
    return out;
}

std::vector<std::string> ids(const EffectTable& effects, const std::vector<std::size_t>& entries) {
    std::vector<std::string> list;
    for (const std::size_t e : entries) list.emplace_back(effects[e].info.id);
    return list;
}

// The gap on held-out data before and after, step by step, beside what the best cause of another family would do.
void close_on_held_out(Diagnosis& out, Forecast& forecast, const Fit& best, const EffectTable& effects) {
    const Cause* named = out.named();
    const Recording& all = out.predicted = forecast.recording;
    Eigen::VectorXd after = out.after;
    if (forecast.beginning_fitted) {
        Eigen::VectorXd nominal;
        forecast.simulator.simulate(out.nominal.at, nominal, &out.nominal_points_m, nullptr);
        forecast.known.emplace_back(out.nominal.at, std::move(nominal));
        forecast.simulator.simulate(best.at, after, &out.points_m, nullptr);
    }
    forecast.known.emplace_back(best.at, after);
    const Eigen::VectorXd before = forecast.of(out.nominal);
    out.shrinkage = shrinkage(all, all.held_rows, before, after);

    const auto ladder_step = [&](const std::vector<std::size_t>& entries, const Fit& fit) {
        out.ladder.push_back(
            {ids(effects, entries),
             gap_rms_m(out.recording.observed, fit.trajectory, out.recording.fit_rows, out.recording.noise_m),
             gap_rms_m(all.observed, forecast.of(fit), all.held_rows, all.noise_m)});
    };
    ladder_step({}, out.nominal);
    if (named == nullptr) return;
    for (std::size_t k = 1; k <= named->entries.size(); ++k) {
        const std::vector<std::size_t> first(named->entries.begin(),
                                             named->entries.begin() + static_cast<std::ptrdiff_t>(k));
        for (const Cause& cause : out.verdict.causes)
            if (cause.fit.usable && cause.entries == first) ladder_step(first, cause.fit);
    }
    const auto family_is_named = [&](const Cause& cause) {
        return std::any_of(named->entries.begin(), named->entries.end(), [&](std::size_t e) {
            return std::string_view(effects[e].info.family) == effects[cause.entries[0]].info.family;
        });
    };
    const auto wrong = std::find_if(out.verdict.causes.begin(), out.verdict.causes.end(), [&](const Cause& cause) {
        return cause.fit.usable && cause.entries.size() == 1 && !family_is_named(cause);
    });
    if (wrong == out.verdict.causes.end()) return;
    out.best_wrong = shrinkage(all, all.held_rows, before, forecast.of(wrong->fit));
    out.best_wrong_effects = ids(effects, wrong->entries);
}

}  // namespace

const Cause* Diagnosis::named() const {
    if (verdict.causes.empty()) return nullptr;
    const Cause& top = verdict.causes.front();
    return top.fit.usable && top.probability >= std::max(verdict.none_probability, verdict.unknown_probability)
               ? &top
               : nullptr;
}

Result<Diagnosis> diagnose(std::span<const GapRecording> recordings, const EffectTable& effects,
                           const DiagnosisOptions& options) {
    Diagnosis out;
    out.name = recordings[0].name;
    TERES_TRY_ASSIGN(out.recording, make_recording(recordings[0]));
    Simulator simulator(*recordings[0].mechanics, recordings[0].sensors, effects);
    TERES_TRY_ASSIGN(Discrepancy discrepancy,
                     discrepancy_of(simulator, options.cache, recordings[0].body_hash, stage(options, "model error")));
    Problem problem{simulator, out.recording, options, std::move(discrepancy), {}};

    // What the nominal model can explain, and whether anything is left.
    stage(options, "nominal fit")(0.0);
    out.nominal = nominal_fit(problem);
    if (!out.nominal.usable) return not_usable(out.name + ": the nominal model does not converge");
    stage(options, "nominal fit")(1.0);

    // One effect; then, as long as it pays, one more on top of the best.
    std::vector<Cause> causes = search(problem, out.nominal, nullptr, out.screening);
    out.confusability = confusability(out.screening, out.nominal.J);
    for (int count = 2; count <= options.max_effects && !causes.empty() && causes.front().fit.usable; ++count) {
        const Cause best = causes.front();
        if (best.score < options.calibration.none_bonus) break;
        if (best.fit.cost < problem.floor.total() + form_error(problem, out.nominal, best)) break;
        Screening further;
        const std::vector<Cause> larger = search(problem, out.nominal, &best, further);
        causes.insert(causes.end(), larger.begin(), larger.end());
        if (larger.empty() || larger.front().score <= best.score || larger.front().explained > kNearlyAll) break;
        std::stable_sort(causes.begin(), causes.end(),
                         [](const Cause& a, const Cause& b) { return a.score > b.score; });
    }
    out.verdict = judge(std::move(causes), out.nominal.cost, problem.floor, options.calibration);
    out.significant = out.verdict.none_probability < 0.5;

    // Where it lies, how far it closes on what was held out, whether it carries over.
    const Cause* named = out.named();
    const Fit& best = named != nullptr ? named->fit : out.nominal;
    simulator.simulate(out.nominal.at, out.nominal.trajectory, &out.nominal_points_m, &out.nodes_before_m);
    out.gap_m = gap_rms_m(out.recording.observed, out.nominal.trajectory, out.recording.seen_rows(), 0.0);
    out.error_floor = problem.floor;
    out.floor_m = std::sqrt(3.0 * problem.floor.total() / problem.whitener.inverse_sigma().squaredNorm());
    out.where = locate(simulator, problem.whitener, out.recording, out.nominal, out.significant ? named : nullptr,
                       out.significant);
    stage(options, "held-out data")(0.0);
    TERES_TRY_ASSIGN(Forecast forecast, Forecast::make(recordings[0], effects));
    if (!forecast.beginning_fitted) forecast.recording = out.recording;
    simulator.simulate(best.at, out.after, forecast.beginning_fitted ? nullptr : &out.points_m, &out.nodes_after_m);
    if (named != nullptr && out.significant) place_by_forces(simulator, *named, out.where);
    close_on_held_out(out, forecast, best, effects);
    TERES_TRY_ASSIGN(out.transfers, transfer(problem, forecast, out.nominal, best, recordings, effects));
    out.next_experiment =
        next_experiment(effects, out.verdict, out.confusability, options.calibration, out.significant);
    out.discrepancy = std::move(problem.discrepancy);
    return out;
}

Result<Plan> plan(const GapRecording& from, const EffectTable& effects, const DiagnosisOptions& options) {
    TERES_TRY_ASSIGN(Recording recording, make_recording(from));
    Simulator simulator(*from.mechanics, from.sensors, effects);
    TERES_TRY_ASSIGN(Discrepancy discrepancy,
                     discrepancy_of(simulator, options.cache, from.body_hash, stage(options, "model error")));
    Problem problem{simulator, recording, options, std::move(discrepancy), {}};
    const Assumption median = prior_median(*from.mechanics);
    Eigen::VectorXd motion;
    if (!simulator.simulate(median, motion))
        return not_usable(recording.name + ": the nominal model does not converge at its prior median");
    recording.observed = recording.observed.array().isFinite().select(motion, recording.observed);
    problem.whitener = whitener_for(recording, problem.discrepancy, motion, options.calibration);
    const Fit nominal = problem.fit(median, 0);
    const ErrorFloor floor =
        error_floor(problem.whitener, problem.discrepancy, nominal.J, recording.noise_m, options.calibration);
    Plan out{recording.name,
             screen(simulator, signatures(simulator, nominal, {}, stage(options, "signatures")), problem.whitener,
                    floor, nominal, options.calibration, recording.num_frames),
             {},
             floor};
    out.confusability = confusability(out.screening, nominal.J);
    return out;
}

}  // namespace teres
