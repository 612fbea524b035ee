#include "plugins/diagnosis/diagnosis.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "plugins/diagnosis/cracks.h"
#include "plugins/diagnosis/gap_map.h"
#include "plugins/diagnosis/learned_error.h"
#include "plugins/diagnosis/search.h"
#include "plugins/diagnosis/search_further.h"
#include "plugins/diagnosis/search_steps.h"
#include "plugins/diagnosis/share_work.h"
#include "plugins/diagnosis/swing.h"

namespace teres {
namespace {

constexpr double kNearlyAll = 0.97;  // explained: nothing is left for one more effect
constexpr double kHides = 0.25;      // of what the nominal model leaves: the model's error hides what causes it
constexpr double kNearer = 0.7;      // of the nominal gap: a state that is nearer to the one seen
constexpr double kLessError = 0.5;   // of the nominal error: worth beginning again

// A recording as far as it goes under assumptions that were fitted elsewhere or on its beginning.
struct Forecast {
    struct Known {
        Assumption at;
        Eigen::VectorXd trajectory;
        std::vector<double> points_m;
    };
    Recording recording;
    Simulator simulator;
    bool beginning_fitted = false;  // else fits of this recording know their trajectories
    std::optional<Simulator> beside{};
    std::vector<Known> known{};

    static Result<Forecast> make(const GapRecording& from, const EffectTable& effects, std::size_t first_held) {
        const GapRecording all = whole_of(from);
        TERES_TRY_ASSIGN(Recording recording, make_recording(all));
        const bool beginning = from.whole_mechanics != nullptr;
        if (beginning) recording.hold_out_frames(first_held);
        Forecast out{std::move(recording), Simulator(*all.mechanics, all.sensors, effects), beginning};
        if (beginning && all.mechanics->twin() != nullptr)
            out.beside.emplace(*all.mechanics->twin(), all.sensors, effects);
        return out;
    }
    const Known* find(const Assumption& at) const {
        for (const Known& k : known)
            if (k.at.theta == at.theta && k.at.effects == at.effects) return &k;
        return nullptr;
    }
    /// Simulates what is not known of these, two at once where the model has a twin.
    void follow(std::span<const Assumption> list) {
        const std::size_t before = known.size();
        for (const Assumption& at : list)
            if (find(at) == nullptr) known.push_back({at, {}, {}});
        share_work(beside.has_value(), known.size() - before, [&](std::size_t who, std::size_t k) {
            Known& next = known[before + k];
            (who == 0 ? simulator : *beside).simulate(next.at, next.trajectory, &next.points_m, nullptr);
        });
    }
    const Known& under(const Assumption& at) {
        follow({&at, 1});
        return *find(at);
    }
    Eigen::VectorXd of(const Fit& fit) {
        return beginning_fitted || find(fit.at) != nullptr ? under(fit.at).trajectory : fit.trajectory;
    }
    double rms_m(const Assumption& at) {
        return gap_rms_m(recording.observed, under(at).trajectory, recording.seen_rows(), recording.noise_m);
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
        TERES_TRY_ASSIGN(Forecast forecast_there,
                         Forecast::make(recordings[k], effects, recordings[k].mechanics->num_frames()));
        TERES_TRY_ASSIGN(Recording other, make_recording(recordings[k]));
        out.push_back(
            {name, other.name, forecast_there.rms_m(nominal.at), forecast_there.rms_m(lasting(effects, named.at))});
        other.fit_rows = other.seen_rows();
        Simulator simulator(*recordings[k].mechanics, recordings[k].sensors, effects);
        Problem there{simulator, other, here.options, {}, {}};
        there.discrepancy.columns.resize(static_cast<Eigen::Index>(simulator.num_rows()), 0);
        there.discrepancy.remainder_m = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(simulator.num_frames()));
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

// The gap on held-out data before and after, step by step, beside what the best cause of another family would do. A
// prediction has the model's own error in it, as far as the fitted data show it.
void close_on_held_out(Diagnosis& out, Forecast& forecast, const Fit& best, const Problem& problem) {
    const EffectTable& effects = problem.simulator.effects();
    const Cause* named = out.named();
    const Recording& all = out.predicted = forecast.recording;
    const auto family_is_named = [&](const Cause& cause) {
        return std::any_of(named->entries.begin(), named->entries.end(), [&](std::size_t e) {
            return std::string_view(effects[e].info.family) == effects[cause.entries[0]].info.family;
        });
    };
    const Cause* wrong = nullptr;
    std::vector<const Cause*> steps;  // fits of the first of the named effects, of the first two, ...
    for (const Cause& cause : out.verdict.causes) {
        if (named == nullptr || !cause.fit.usable) continue;
        if (wrong == nullptr && cause.entries.size() == 1 && !family_is_named(cause)) wrong = &cause;
        if (cause.entries.size() <= named->entries.size() &&
            std::equal(cause.entries.begin(), cause.entries.end(), named->entries.begin()))
            steps.push_back(&cause);
    }
    std::stable_sort(steps.begin(), steps.end(),
                     [](const Cause* a, const Cause* b) { return a->entries.size() < b->entries.size(); });
    Eigen::VectorXd after = out.after;
    if (forecast.beginning_fitted) {
        std::vector<Assumption> list{out.nominal.at, best.at};
        for (const Cause* step : steps) list.push_back(step->fit.at);
        if (wrong != nullptr) list.push_back(wrong->fit.at);
        forecast.follow(list);
        out.nominal_points_m = forecast.under(out.nominal.at).points_m;
        out.points_m = forecast.under(best.at).points_m;
        after = forecast.under(best.at).trajectory;
    } else {
        forecast.known.push_back({best.at, after, {}});
    }
    const Discrepancy& error = problem.discrepancy;
    // Where something is there that nobody named, what the columns take up is not the model's error.
    const bool error_known =
        !forecast.beginning_fitted && error.columns.cols() > 0 && (named != nullptr || !out.significant);
    const auto learned = [&](const Eigen::VectorXd& from) -> Eigen::VectorXd {
        return learned_error(problem.whitener, error, problem.residual_of(from));
    };
    const auto predicted = [&](const Eigen::VectorXd& from) -> Eigen::VectorXd {
        return error_known ? from + error.columns * learned(from) : from;
    };
    if (error_known) {
        Eigen::Map<Eigen::VectorXd>(out.points_m.data(), error.at_points.rows()) += error.at_points * learned(after);
        out.after = predicted(after);
    }
    const Eigen::VectorXd before = forecast.of(out.nominal);
    out.shrinkage = shrinkage(all, all.held_rows, before, error_known ? out.after : after);

    const auto ladder_step = [&](const std::vector<std::size_t>& entries, const Eigen::VectorXd& fitted,
                                 const Eigen::VectorXd& whole, bool model_error) {
        out.ladder.push_back({ids(effects, entries),
                              gap_rms_m(out.recording.observed, fitted, out.recording.fit_rows, out.recording.noise_m),
                              gap_rms_m(all.observed, whole, all.held_rows, all.noise_m), model_error});
    };
    ladder_step({}, out.nominal.trajectory, before, false);
    for (const Cause* step : steps) ladder_step(step->entries, step->fit.trajectory, forecast.of(step->fit), false);
    if (error_known)
        ladder_step(named != nullptr ? named->entries : std::vector<std::size_t>{}, out.after, out.after, true);
    if (wrong == nullptr) return;
    out.best_wrong = shrinkage(all, all.held_rows, before, predicted(forecast.of(wrong->fit)));
    out.best_wrong_effects = ids(effects, wrong->entries);
}

// Whether a cause leaves several times as much of the frames held out as of those fitted, or as the model may be off:
// it stands for something else, or something begins late that a large gap hid from nominal_fit().
bool fails_later(const Problem& problem, const Cause* cause) {
    const Recording& r = problem.recording;
    if (cause == nullptr || !r.held_markers.empty() || problem.simulator.mechanics().dynamic()) return false;
    const double floor = problem.floor.total() / problem.whitener.inverse_sigma().squaredNorm();
    return mean_square(r, cause->fit.trajectory, r.held_rows) >
           kLateRatio * std::max(floor, mean_square(r, cause->fit.trajectory, r.fit_rows));
}

// The best cause if something is there, be it `unknown` that is more probable; or null.
const Cause* leading(const Verdict& verdict) {
    const bool something = !verdict.causes.empty() && verdict.causes.front().fit.usable &&
                           verdict.causes.front().probability > verdict.none_probability;
    return something ? &verdict.causes.front() : nullptr;
}

// The error of the model in the state under the best cause, where that leaves more than right causes do.
void weigh_state(Problem& problem, const Fit& nominal, std::vector<Cause>& causes) {
    Cause* best = best_to_weigh(problem, causes);
    if (best == nullptr || best->model_error || best->misfit < problem.right_floor().total()) return;
    Assumption state = best->fit.at;
    std::erase_if(state.effects, [&](const ActiveEffect& a) { return problem.simulator.effects()[a.entry].sensor; });
    if (state.effects.empty()) return;
    const auto error =
        discrepancy_about(problem.simulator, state, stage(problem.options, "model error under the best"));
    if (!error) return;
    best->model_error = error_floor(problem.whitener, *error, best->fit.J.leftCols(nominal.u.size()),
                                    problem.recording.noise_m, false, problem.options.calibration)
                            .model;
}

// While it lives, several hypotheses of a problem are fitted two at a time where its model has a twin.
class SecondThread {
  public:
    explicit SecondThread(Problem& problem) : problem_(problem) {}
    ~SecondThread() { problem_.beside = nullptr; }
    SecondThread(const SecondThread&) = delete;
    SecondThread& operator=(const SecondThread&) = delete;

    Result<void> begin(const GapRecording& recording, const EffectTable& effects, const Assumption& nominal) {
        if (problem_.outlook != nullptr) problem_.outlook->stand_on(nominal);  // as the other's, whoever fits what
        TrajectoryModel* twin = recording.mechanics->twin();
        if (twin == nullptr) return {};
        simulator_.emplace(*twin, recording.sensors, effects);
        TERES_TRY_ASSIGN(outlook_, Outlook::make(recording, effects, problem_.options.calibration, true));
        if (outlook_ != nullptr) outlook_->stand_on(nominal);
        beside_.emplace(Problem{*simulator_, problem_.recording, problem_.options, problem_.discrepancy,
                                problem_.whitener, problem_.floor, outlook_.get(), problem_.limit});
        beside_->span = problem_.span;
        problem_.beside = &*beside_;
        return {};
    }

  private:
    Problem& problem_;
    std::optional<Simulator> simulator_;
    std::optional<Problem> beside_;
    std::unique_ptr<Outlook> outlook_;
};

// Where stiffness, damping and mass together take a body with inertia, or the one effect that comes nearest to where it
// was seen; nothing if neither comes much nearer than the nominal model.
std::optional<Assumption> nearer_state(Problem& problem, const Fit& nominal) {
    const auto gap_m2 = [&](const Fit& fit) {
        return mean_square(problem.recording, fit.trajectory, problem.recording.fit_rows);
    };
    const auto nearer = [&](const Fit& fit) {
        return fit.usable && gap_m2(fit) <= kNearer * kNearer * gap_m2(nominal);
    };
    problem.swing = fit_swing(problem, nominal);
    if (problem.swing && nearer(problem.swing->fit)) return problem.swing->fit.at;
    Screening screening;
    std::vector<Cause> causes = search(problem, nominal, nullptr, screening, nullptr);
    std::erase_if(causes, [&](const Cause& cause) {
        return !nearer(cause.fit) || problem.simulator.effects()[cause.entries[0]].sensor;
    });
    const auto nearest = std::min_element(
        causes.begin(), causes.end(), [&](const Cause& a, const Cause& b) { return gap_m2(a.fit) < gap_m2(b.fit); });
    return nearest != causes.end() ? std::optional(nearest->fit.at) : std::nullopt;
}

// Where the nominal body with inertia swings far beyond where the real one was seen, what its model may be off by there
// hides every cause. Then it is asked for in a state that is nearer. True: that is much less, and taken from now on.
Result<bool> take_error_where_seen(Problem& problem, const GapRecording& recording, const EffectTable& effects,
                                   Fit& nominal) {
    if (!problem.simulator.mechanics().dynamic() || problem.floor.model < kHides * nominal.misfit) return false;
    std::optional<Assumption> state;
    {
        SecondThread second(problem);
        TERES_TRY(second.begin(recording, effects, nominal.at));
        state = nearer_state(problem, nominal);
    }
    problem.complete(nominal);  // the simulator's base again, as a search begins with it
    if (!state) return false;
    auto error =
        discrepancy_about(problem.simulator, *state, stage(problem.options, "model error where the body was seen"));
    if (!error || error->columns.norm() > kLessError * problem.discrepancy.columns.norm()) return false;
    problem.discrepancy = std::move(*error);
    return true;
}

Verdict judge_now(const Problem& problem, const Fit& nominal, const std::vector<Cause>& causes) {
    return judge(causes, left_of(nominal), problem.floor, problem.options.calibration);
}

// One more effect on top of the best set, as long as that pays.
void add_effects(Problem& problem, const Fit& nominal, const Screening& screening, std::vector<Cause>& causes) {
    const Calibration& calibration = problem.options.calibration;
    if (unknown_gain(left_of(nominal), problem.floor, calibration) <=
        calibration.unknown_least() + calibration.none_bonus)
        return;
    const bool dynamic = problem.simulator.mechanics().dynamic();
    const int first = dynamic ? static_cast<int>(causes.front().entries.size()) + 1 : 2;
    for (int count = first; count <= problem.options.max_effects; ++count) {
        // With inertia, what is left after many periods shows what stands for what.
        const Cause& best = causes.front();
        const bool enough =
            count > 2 && best.explained > kNearlyAll && (!dynamic || problem.floor.explains(left_of(best.fit)));
        if (enough || problem.out_of_time() || !search_further(problem, nominal, screening, causes)) return;
    }
}

// Nominal fit; one effect; then, as long as it pays, one more on top of the best; then what first order may have
// overlooked. `before`: what failed later when other data were held out, one more rival; or null. Returns what fails
// later now: all is to be searched again, with other data held out.
Result<std::optional<Cause>> find_causes(Problem& problem, const GapRecording& recording, const EffectTable& effects,
                                         const Cause* before, Diagnosis& out) {
    stage(problem.options, "nominal fit")(0.0);
    Fit& nominal = out.nominal =
        nominal_fit(problem, before != nullptr ? out.nominal.at : prior_median(*recording.mechanics));
    if (!nominal.usable) return not_usable(out.name + ": the nominal model does not converge");
    stage(problem.options, "nominal fit")(1.0);
    if (before == nullptr) {
        TERES_TRY_ASSIGN(const bool taken, take_error_where_seen(problem, recording, effects, nominal));
        if (taken) nominal = nominal_fit(problem, nominal.at);
        if (!nominal.usable) return not_usable(out.name + ": the nominal model does not converge");
    }
    SecondThread second(problem);
    TERES_TRY(second.begin(recording, effects, nominal.at));

    std::vector<Cause> causes = search(problem, nominal, nullptr, out.screening, before);
    const auto fails = [&](const Cause* cause) { return fails_later(problem, cause); };
    // What fails later is searched again, with other data held out, if there is time for that: then nothing is finished
    // or added here.
    const auto searched_again = [&] {
        out.verdict = judge_now(problem, nominal, causes);
        return fails(leading(out.verdict)) && problem.time_for_as_much();
    };
    bool again = searched_again(), parted = false;
    const auto part = [&] {  // once
        return !parted && (parted = look_for_cracks(problem, nominal, out.screening, causes));
    };
    if (!again) {
        const bool looked = look_for_tears(problem, nominal, out.screening, causes);
        if (!part() || !crack_is_far_ahead(effects, causes)) {
            sort_by_score(causes);
            if (causes.empty() || causes.front().entries.size() == 1)
                finish(problem, nominal, nullptr, out.screening, causes);
            if (!looked && look_for_tears(problem, nominal, out.screening, causes))
                finish(problem, nominal, nullptr, out.screening, causes);
            part();
        }
        again = searched_again();
    }
    out.confusability = confusability(out.screening, effects, nominal.J);
    if (!again && !causes.empty()) {
        add_effects(problem, nominal, out.screening, causes);
        out.verdict = judge_now(problem, nominal, causes);
        const bool finds = !fails(out.named()) && !problem.floor.explains(left_of(nominal)) && !problem.out_of_time() &&
                           look_again(problem, nominal, out.screening, causes);
        const bool parts = out.named() == nullptr && part() && causes.front().entries.size() == 1;
        if (finds || parts) add_effects(problem, nominal, out.screening, causes);
        weigh_forms(problem, nominal, causes);
        weigh_state(problem, nominal, causes);
        out.verdict = judge_now(problem, nominal, causes);
    }
    out.significant = out.verdict.none_probability < 0.5;
    const Cause* best = again ? leading(out.verdict) : out.named();
    return fails(best) ? std::optional<Cause>(*best) : std::nullopt;
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
    const Sharing together(*recordings[0].mechanics, true);
    TERES_TRY_ASSIGN(Discrepancy discrepancy,
                     discrepancy_of(simulator, options.cache, recordings[0].body_hash, stage(options, "model error")));
    Problem problem{simulator, out.recording, options, std::move(discrepancy), {}};
    TERES_TRY_ASSIGN(const std::unique_ptr<Outlook> outlook,
                     Outlook::make(recordings[0], effects, options.calibration));
    problem.outlook = outlook.get();
    const WorkLimit limit(options.work_limit_s);
    problem.limit = &limit;

    TERES_TRY_ASSIGN(const std::optional<Cause> before, find_causes(problem, recordings[0], effects, nullptr, out));
    if (before && !problem.out_of_time()) {  // what is held out is needed to tell why: markers are held out instead
        out.recording.hold_out_markers(before->fit.trajectory);
        TERES_TRY(find_causes(problem, recordings[0], effects, &*before, out));
    }
    out.cut_short = limit.cut_short();

    // Where it lies, how far it closes on what was held out, whether it carries over.
    const Cause* named = out.named();
    const Fit& best = named != nullptr ? named->fit : out.nominal;
    simulator.simulate(out.nominal.at, out.nominal.trajectory, &out.nominal_points_m, &out.nodes_before_m);
    out.gap_m = gap_rms_m(out.recording.observed, out.nominal.trajectory, out.recording.seen_rows(), 0.0);
    out.error_floor = problem.floor;
    out.floor_m = std::sqrt(3.0 * problem.floor.total() / problem.whitener.inverse_sigma().squaredNorm());
    out.where = locate(simulator, problem.whitener, out.recording, out.nominal, out.verdict,
                       out.significant ? named : nullptr, out.significant);
    stage(options, "held-out data")(0.0);
    TERES_TRY_ASSIGN(
        Forecast forecast,
        Forecast::make(recordings[0], effects, outlook != nullptr ? outlook->end_frame() : out.recording.num_frames));
    if (!forecast.beginning_fitted) forecast.recording = out.recording;
    simulator.simulate(best.at, out.after, forecast.beginning_fitted ? nullptr : &out.points_m, &out.nodes_after_m);
    if (named != nullptr && out.significant) place_by_forces(simulator, *named, out.where);
    close_on_held_out(out, forecast, best, problem);
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
    const Fit nominal = problem.fit_on(median, 0);
    const ErrorFloor floor = error_floor(problem.whitener, problem.discrepancy, nominal.J, recording.noise_m,
                                         from.mechanics->dynamic(), options.calibration);
    Plan out{recording.name,
             screen(simulator, signatures(simulator, nominal, {}, stage(options, "signatures")), problem.whitener,
                    floor, nominal, options.calibration, recording.num_frames),
             {},
             floor};
    out.confusability = confusability(out.screening, effects, nominal.J);
    return out;
}

}  // namespace teres