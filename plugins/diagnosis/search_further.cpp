#include "plugins/diagnosis/search_further.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string_view>

#include "plugins/diagnosis/form_columns.h"
#include "plugins/diagnosis/search.h"

namespace teres {
namespace {

constexpr int kIterations = 6;
constexpr double kFarBehind = 15.0;      // nats: no rival any more
constexpr std::size_t kRivals = 3;       // of a set that get what it gained
constexpr double kCloseBehind = 5.0;     // nats: hardly told apart, without inertia ...
constexpr std::size_t kCloseRivals = 2;  // ... of these
constexpr double kMostAlone = 0.5;       // explained by a sensor effect that may be half of a pair
constexpr double kHardlyLess = 0.9;      // of what is left without the second effect
constexpr double kVeryMuch = 5.0;        // times what noise and model error explain
constexpr double kFarFromPrior = 6.0;    // nats of every effect: a sensor beside one of usual size may cost less
constexpr double kTrace = 0.1;           // prior standard deviations of every amplitude of an effect
constexpr double kMuchMore = 2.0;        // times what the set that gave leaves
constexpr double kFormShare = 0.2;       // standard deviation of a form, share of the effect's motion

// The whitener in use, with columns for what the known effects may get wrong of their form.
Whitener looser_whitener(Problem& problem, const Fit& known) {
    if (problem.simulator.mechanics().dynamic()) return problem.whitener;
    const Eigen::MatrixXd forms = form_columns(problem.simulator, known.at, known.trajectory, kFormShare);
    Eigen::MatrixXd columns = problem.discrepancy.columns;
    columns.conservativeResize(Eigen::NoChange, columns.cols() + forms.cols());
    columns.rightCols(forms.cols()) = forms;
    return tempered_whitener(problem.whitener.rows(), problem.whitener.inverse_sigma().cwiseInverse(), columns,
                             problem.options.calibration);
}

// One effect more than `known`. Nothing if looser forms of that explain what is left, unless it takes effects that are
// hardly ever so large; only what is global if they might. Fills its misfit beside forms.
std::vector<Cause> search_on_top(Problem& problem, const Fit& nominal, Cause& known) {
    Base base{known, looser_whitener(problem, known.fit), known.fit, {0.0}};
    complete(problem.simulator, base.looser, problem.recording.observed, base.fit);
    if (!base.fit.usable) return {};
    base.left = left_under(problem, base.looser, base.fit, nominal.u.size());
    known.misfit_beside_forms = base.left.cost;
    const Left raw{base.fit.cost + base.fit.later, problem.beside_span(base.fit.residual)},
        left = problem.floor.beside_noise(raw, problem.simulator.noise_factor(known.fit.at));
    if (problem.floor.explains(left)) {
        base.far_nats = known.price.tail + known.price.scales;
        if (base.far_nats < kFarFromPrior * static_cast<double>(known.entries.size())) return {};
    }
    const Left beyond = problem.floor.beyond(left), form = form_error(problem, nominal, known);
    base.global_only = beyond.inside() <= form.inside() && beyond.beside <= form.beside;
    Screening screening;
    return search(problem, nominal, &base, screening);
}

void add(std::vector<Cause>& causes, std::vector<Cause> more) {
    for (Cause& cause : more) keep_better(causes, std::move(cause));
}

// The second of a pair alone: the first was named when nothing was known of it.
Cause without_first(Problem& problem, const Fit& nominal, const Cause& larger, const std::vector<Cause>& causes) {
    if (const Cause* fitted = fitted_alone(causes, larger.entries.back())) return *fitted;
    const Cause* first = fitted_alone(causes, larger.entries.front());
    EffectScreening added;
    added.entry = larger.entries.back();
    added.start = larger.fit.at.effects.back();
    added.search_cost = larger.search_cost - (first != nullptr ? first->search_cost : 0.0);
    Cause alone = refit(problem, nominal, nullptr, added, kIterations);
    score(problem, nominal, nullptr, alone);
    return alone;
}

bool suffices(const Problem& problem, const Cause& cause) {
    return cause.fit.usable && problem.floor.explains(left_of(cause.fit));
}

// Whether something else may stand for the first effect: the second must explain something beside it. What pays is not
// right yet because noise and the model's error might explain what it leaves.
bool may_exchange(const Problem& problem, const Cause& base, const Cause& best) {
    const bool enough =
        best.score > base.score ? problem.right_floor().explains(left_of(best.fit)) : suffices(problem, best);
    return best.entries.size() == 2 && !enough && best.misfit < kHardlyLess * base.misfit;
}

// An effect as a set of them has it, for others to be tried with.
EffectScreening taken_from(const Cause& cause, std::size_t entry, double search_cost) {
    EffectScreening effect;
    effect.entry = entry;
    for (const ActiveEffect& active : cause.fit.at.effects)
        if (active.entry == entry) effect.start = active;
    effect.search_cost = search_cost;
    return effect;
}

std::vector<std::size_t> set_of(std::vector<std::size_t> entries) {
    std::sort(entries.begin(), entries.end());
    return entries;
}

// What a set gained.
struct Gift {
    EffectScreening effect;
    double form_nats = 0.0;              ///< of that, what other forms of the rest of the set explain as well
    double misfit = 0.0;                 ///< of the set that gave
    std::vector<ActiveEffect> beside{};  ///< its effects
};

Gift gift_of(const Cause& found, double search_cost) {
    return {taken_from(found, found.entries.back(), search_cost), found.form_nats, found.misfit, found.fit.at.effects};
}

// A rival with the gift. Where it leaves much more than the set that gave, what they share may have taken up what the
// gift explains now (a damping for a mass): it is also fitted from how that is in the other set.
Cause with_gift(Problem& problem, const Fit& nominal, const Cause& rival, const Gift& gift) {
    Cause larger = refit(problem, nominal, &rival, gift.effect, kIterations);
    const bool shares = std::any_of(gift.beside.begin(), gift.beside.end(),
                                    [&](const ActiveEffect& effect) { return contains(rival, effect.entry); });
    if (!shares || problem.out_of_time() || (larger.fit.usable && larger.fit.misfit < kMuchMore * gift.misfit))
        return larger;
    EffectScreening anew = gift.effect;
    anew.beside = gift.beside;
    Cause other = refit(problem, nominal, &rival, anew, kIterations);
    return other.fit.usable && (!larger.fit.usable || other.fit.cost < larger.fit.cost) ? other : larger;
}

// Which sets get what one of them gained: so many at most that have not got it, no more nats behind the best than that.
struct Rivals {
    std::size_t effects;  ///< of each set
    std::size_t most;
    double behind_nats;
};

// Which of several sets looks best depends on what none of them has yet, the more so with inertia, where a body that is
// loaded or held otherwise than the model moves quite differently: `gifts` are tried with the best sets.
void give_to_rivals(Problem& problem, const Fit& nominal, const std::vector<Gift>& gifts, const Rivals& which,
                    std::vector<Cause>& causes) {
    std::vector<const Cause*> rivals;
    for (const Cause& cause : causes)
        if (cause.fit.usable && cause.entries.size() == which.effects) rivals.push_back(&cause);
    std::sort(rivals.begin(), rivals.end(), [](const Cause* a, const Cause* b) { return a->score > b->score; });
    std::erase_if(rivals, [&](const Cause* r) { return r->score < rivals.front()->score - which.behind_nats; });
    struct Trial {
        const Cause* known;
        const Gift* gift;
    };
    std::vector<Trial> trials;
    std::set<std::vector<std::size_t>> known;  // fitted, or to be
    for (const Cause& cause : causes) known.insert(set_of(cause.entries));
    for (const Gift& gift : gifts) {
        const std::size_t entry = gift.effect.entry;
        std::size_t given = 0;
        for (const Cause* rival : rivals) {
            if (given == which.most || contains(*rival, entry)) continue;
            std::vector<std::size_t> larger = rival->entries;
            larger.push_back(entry);
            if (!known.insert(set_of(std::move(larger))).second) continue;
            trials.push_back({rival, &gift});
            ++given;
        }
    }
    if (trials.empty()) return;
    const auto report = stage(problem.options, "trying the last effect with rivals");
    report(0.0);
    const double best = best_score(causes);
    std::vector<Cause> larger(trials.size());
    side_by_side(problem, trials.size(), [&](Problem& p, std::size_t k) {
        if (p.out_of_time()) return;
        const Gift& gift = *trials[k].gift;
        larger[k] = with_gift(p, nominal, *trials[k].known, gift);
        if (!larger[k].fit.usable) return;
        const Fit& alone = trials[k].known->fit;
        const Whitener looser = looser_whitener(p, alone);
        const Base base{*trials[k].known, looser, alone, left_under(p, looser, alone, nominal.u.size())};
        const auto weigh = [&] {
            score(p, nominal, &base, larger[k]);
            pay_alike(gift.form_nats, larger[k]);
        };
        weigh();
        if (larger[k].score >= best - kFarBehind) {
            settle(p, larger[k], kIterations);
            weigh();
        }
        if (&p == &problem) report(static_cast<double>(k + 1) / static_cast<double>(trials.size()));
    });
    std::erase_if(larger, [](const Cause& cause) { return !cause.fit.usable; });
    add(causes, std::move(larger));
}

// The single effect next to the best one, of another family as what is of one stands for the same; or null.
const Cause* runner_up(const EffectTable& effects, const std::vector<Cause>& causes, const Cause& best) {
    const auto family = [&](const Cause& cause) { return std::string_view(effects[cause.entries[0]].info.family); };
    const Cause* next = nullptr;
    for (const Cause& cause : causes)
        if (cause.fit.usable && cause.entries.size() == 1 && family(cause) != family(best) &&
            cause.score > best.score - kFarBehind && (next == nullptr || cause.score > next->score))
            next = &cause;
    return next;
}

// Whether a fit to the whole recording leaves several times as much of the beginning as noise and model error explain.
bool leaves_beginning(const Problem& problem, const Fit& fit) {
    const auto rows = static_cast<Eigen::Index>(3 * problem.recording.num_markers * beginning_of(problem.recording));
    Eigen::VectorXd difference = problem.residual_of(fit.trajectory);
    difference.tail(difference.size() - rows).setZero();
    return problem.whitener(difference).squaredNorm() > kLateRatio * kBeginning * problem.floor.total();
}

// Whether what explains the beginning is no part of any set that was found, nor is one needed.
bool may_begin_otherwise(const Problem& problem, const Cause& base, const std::vector<Cause>& causes,
                         const EffectScreening& early) {
    return base.entries.size() == 1 && base.entries[0] != early.entry && !suffices(problem, base) &&
           leaves_beginning(problem, base.fit) && std::none_of(causes.begin(), causes.end(), [&](const Cause& c) {
               return c.entries.size() > 1 && contains(c, early.entry);
           });
}

// Searched on top of one of `causes`.
std::vector<Cause> search_on_top_of(Problem& problem, const Fit& nominal, Cause known, std::vector<Cause>& causes) {
    std::vector<Cause> larger = search_on_top(problem, nominal, known);
    for (Cause& cause : causes)
        if (cause.entries == known.entries) cause.misfit_beside_forms = known.misfit_beside_forms;
    if (!larger.empty() && !problem.simulator.mechanics().dynamic() && !problem.out_of_time())
        if (auto better = without_trace(problem, nominal, known, larger.front()))
            keep_better(causes, std::move(*better));
    return larger;
}

// One effect more than the best set; more than the runner-up, too, if that is a single effect and the best one does
// not end the search. What each gained is given to the rivals of the set it was added to, and so is the first of the
// best pair unless it has a place: how a body yields and dies out goes with every cause, a place makes up for one.
void search_with_inertia(Problem& problem, const Fit& nominal, const Cause& base, std::vector<Cause>& causes) {
    std::vector<Gift> gifts;
    const auto given = [&](std::size_t entry) {
        return std::any_of(gifts.begin(), gifts.end(), [&](const Gift& gift) { return gift.effect.entry == entry; });
    };
    Cause best;
    const auto search_from = [&](const Cause& from) {
        std::vector<Cause> larger = search_on_top_of(problem, nominal, from, causes);
        if (larger.empty() || !larger.front().fit.usable) return false;
        const Cause& found = larger.front();
        const std::size_t gained = found.entries.back();
        if (found.score > from.score - kHopeless && !given(gained))
            gifts.push_back(gift_of(found, found.search_cost - from.search_cost));
        if (!best.fit.usable || found.score > best.score) best = found;
        const bool done = suffices(problem, found);
        add(causes, std::move(larger));
        return done;
    };
    const bool single = base.entries.size() == 1, done = search_from(base);
    const Cause* next = single && !done ? runner_up(problem.simulator.effects(), causes, base) : nullptr;
    if (next != nullptr && !problem.out_of_time()) search_from(Cause(*next));
    if (!best.fit.usable || problem.out_of_time()) return;
    const std::size_t first = best.entries.front();
    const Cause* alone = fitted_alone(causes, first);
    const bool placed = centre_of(problem.simulator.effects()[first], best.fit.at.effects.front()).has_value();
    if (single && alone != nullptr && !placed && !given(first))
        gifts.push_back({taken_from(best, first, alone->search_cost)});
    give_to_rivals(problem, nominal, gifts, {base.entries.size(), kRivals, kFarBehind}, causes);
}

// A body that moves in every direction may stand for two sensor effects at once, and then nothing is left to search on
// top of it: the best two that explain most alone are fitted together.
void pair_sensors(Problem& problem, const Fit& nominal, std::vector<Cause>& causes) {
    const EffectTable& effects = problem.simulator.effects();
    std::vector<const Cause*> sensors;
    for (const Cause& cause : causes)
        if (cause.fit.usable && cause.entries.size() == 1 && effects[cause.entries[0]].sensor &&
            cause.explained > kMostAlone)
            sensors.push_back(&cause);
    if (sensors.size() < 2) return;
    std::sort(sensors.begin(), sensors.end(), [](const Cause* a, const Cause* b) { return a->score > b->score; });
    Cause pair = refit(problem, nominal, sensors[0],
                       taken_from(*sensors[1], sensors[1]->entries[0], sensors[1]->search_cost), kIterations);
    if (!pair.fit.usable) return;
    score(problem, nominal, nullptr, pair);
    keep_better(causes, std::move(pair));
}

// What a search on top of the beginning found.
struct AfterBeginning {
    bool made = false;
    bool suffices = false;    // the best set leaves no more than noise and model error explain
    bool ends_apart = false;  // it ends with something that begins in the recording and leaves all others far behind
};

// What explains the beginning of a static recording, fitted to that alone, and one effect on top of it. Not made if the
// fit is of no use or, `if_explained`, leaves much of the beginning.
AfterBeginning search_after_beginning(Problem& problem, const Fit& nominal, const EffectScreening& early,
                                      bool if_explained, std::vector<Cause>& causes) {
    Cause first;
    first.entries = {early.entry};
    first.search_cost = early.search_cost;
    Assumption start = prior_median(problem.simulator.mechanics());
    start.effects = {early.start};
    first.fit = fit_jointly(problem.simulator, problem.whitener, problem.recording.observed, start,
                            {.max_iterations = kIterations, .num_frames = beginning_of(problem.recording)});
    if (!first.fit.usable || (if_explained && leaves_beginning(problem, first.fit))) return {};
    problem.complete(first.fit);
    score(problem, nominal, nullptr, first);
    if (!first.fit.usable) return {};
    std::vector<Cause> later = search_on_top(problem, nominal, first);
    AfterBeginning out{.made = true, .suffices = !later.empty() && suffices(problem, later.front())};
    out.ends_apart = !later.empty() && later.front().score > causes.front().score + kFarBehind &&
                     problem.simulator.effects()[later.front().entries.back()].info.event;
    add(causes, std::move(later));
    return out;
}

}  // namespace

std::optional<Cause> without_trace(Problem& problem, const Fit& nominal, const Cause& known, const Cause& larger) {
    if (known.entries.size() != 1 || larger.entries.size() != 2 || !larger.fit.usable) return std::nullopt;
    const std::vector<EffectParameter>& added = problem.simulator.effects()[larger.entries.back()].parameters;
    const Eigen::VectorXd u = larger.fit.u.tail(static_cast<Eigen::Index>(added.size()));
    for (std::size_t p = 0; p < added.size(); ++p)
        if (added[p].role == EffectRole::kAmplitude && std::abs(u(static_cast<Eigen::Index>(p))) > kTrace)
            return std::nullopt;
    Assumption at = larger.fit.at;
    at.effects.pop_back();
    return fitted_from(problem, nominal, known, at, kIterations);
}

void weigh_forms(Problem& problem, const Fit& nominal, std::vector<Cause>& causes) {
    Cause* best = best_to_weigh(problem, causes);
    if (best == nullptr || best->misfit_beside_forms || suffices(problem, *best)) return;
    best->misfit_beside_forms =
        left_under(problem, looser_whitener(problem, best->fit), best->fit, nominal.u.size()).cost;
}

bool search_further(Problem& problem, const Fit& nominal, const Screening& screening, std::vector<Cause>& causes) {
    const double best_before = causes.front().score;
    // Where no single effect pays, the pair begins with the one that explains most.
    Cause base = causes.front();
    if (best_before < problem.options.calibration.none_bonus)
        for (const Cause& cause : causes)
            if (cause.fit.usable && (!base.fit.usable || cause.misfit < base.misfit)) base = cause;
    if (!base.fit.usable) return false;
    const auto ended = [&] {
        sort_by_score(causes);
        return causes.front().score > best_before;
    };
    if (problem.simulator.mechanics().dynamic()) {
        search_with_inertia(problem, nominal, base, causes);
        return ended();
    }
    if (base.entries.size() == 1 && !problem.simulator.effects()[base.entries[0]].sensor && !problem.out_of_time())
        pair_sensors(problem, nominal, causes);
    const auto begins_otherwise = [&] {
        return screening.of_beginning && may_begin_otherwise(problem, base, causes, *screening.of_beginning);
    };
    // Where the best single effect leaves very much, what explains the beginning and an event need no other base.
    AfterBeginning after;
    if (base.fit.compared_cost() > kVeryMuch * problem.floor.total() && begins_otherwise())
        after = search_after_beginning(problem, nominal, *screening.of_beginning, true, causes);
    if (after.ends_apart || problem.out_of_time()) return ended();
    std::vector<Cause> larger = search_on_top_of(problem, nominal, base, causes);
    const bool done = !larger.empty() && suffices(problem, larger.front());
    const std::optional<Cause> best =
        !larger.empty() && larger.front().fit.usable ? std::optional(larger.front()) : std::nullopt;
    if (best) add(causes, std::move(larger));
    if (problem.out_of_time()) return ended();
    if (best && base.entries.size() == 1 && best->score > base.score)
        give_to_rivals(problem, nominal, {gift_of(*best, best->search_cost - base.search_cost)},
                       {1, kCloseRivals, kCloseBehind}, causes);
    if (problem.out_of_time()) return ended();
    if (!after.made && !done && begins_otherwise())
        after = search_after_beginning(problem, nominal, *screening.of_beginning, false, causes);
    if (best && !problem.out_of_time() && !after.suffices && may_exchange(problem, base, *best)) {
        const Cause rest = without_first(problem, nominal, *best, causes);
        if (rest.fit.usable) {
            keep_better(causes, rest);
            add(causes, search_on_top_of(problem, nominal, rest, causes));
        }
    }
    return ended();
}

}  // namespace teres
