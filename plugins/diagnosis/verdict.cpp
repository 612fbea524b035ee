#include "plugins/diagnosis/verdict.h"

#include <algorithm>
#include <cmath>
#include <string_view>

#include "plugins/diagnosis/amplitude_price.h"

namespace teres {
namespace {

// Evidence of what leaves `left`, before its price [nats].
double gain(const Left& nominal, const Left& left, const ErrorFloor& floor, const Calibration& calibration) {
    return 0.5 * calibration.nu * (floor.log_above(nominal) - floor.log_above(left));
}

// What an effect that nobody thought of would leave.
Left unexplained(const Left& nominal, const ErrorFloor& floor, const Calibration& calibration) {
    return floor.reached(nominal, calibration.unknown_left, calibration.unknown_share);
}

// A radius, a time, a frequency: how large it is to be expected is known, unlike where something is or when it begins.
bool is_scale(const EffectParameter& p) {
    return p.role == EffectRole::kShape && p.transform == EffectTransform::kLog;
}

// When it happens is not, but that it was seen to begin: a tool that was always there stands for what is constant.
bool is_onset(const EffectParameter& p) {
    return p.role == EffectRole::kShape && std::string_view(p.name) == "onset";
}

// The best fitted cause whose evidence outweighs its price and that is `wanted`, or null.
template <class Wanted>
const Cause* best_fitted(const std::vector<Cause>& causes, const Wanted& wanted) {
    const Cause* best = nullptr;
    for (const Cause& cause : causes)
        if (cause.fit.usable && cause.score > 0.0 && wanted(cause) && (best == nullptr || cause.score > best->score))
            best = &cause;
    return best;
}
const Cause* best_fitted(const std::vector<Cause>& causes) {
    return best_fitted(causes, [](const Cause&) { return true; });
}

// What the sensors of a set leave without the rest of it, as far as it was fitted; of none, the nominal model.
Left left_by_sensors(const std::vector<Cause>& causes, const Cause& set, const Left& nominal, const ErrorFloor& floor) {
    const auto of_set = [&](std::size_t e) {
        return std::find(set.entries.begin(), set.entries.end(), e) != set.entries.end();
    };
    Left least = nominal;
    for (const Cause& cause : causes)
        if (cause.fit.usable && cause.sensors && std::all_of(cause.entries.begin(), cause.entries.end(), of_set) &&
            floor.log_above(cause.left()) < floor.log_above(least))
            least = cause.left();
    return least;
}

// ... in place of the best cause. What a sensor gets wrong is told in closed form, however large it is: nothing of what
// sensors explain stays.
Left unexplained_beside(const std::vector<Cause>& causes, const Left& nominal, const ErrorFloor& floor,
                        const Calibration& calibration) {
    const Cause* best = best_fitted(causes);
    if (best == nullptr) return unexplained(nominal, floor, calibration);
    if (best->sensors) return floor.reached(nominal, calibration.unknown_left_sensor, 0.0);
    return unexplained(left_by_sensors(causes, *best, nominal, floor), floor, calibration);
}

// Price of the best cause that leaves no more than `rest`, of a single one where a single one is the best at all; if
// there is none, of that. Without what it pays for scales that are not its own, or for being larger than such an effect
// ever is: that speaks for something else.
double price_of_rival(const std::vector<Cause>& causes, const Left& rest, const ErrorFloor& floor) {
    const Cause* best = best_fitted(causes);
    if (best == nullptr) return 0.0;
    const double most = floor.log_above(rest);
    const Cause* rival = best_fitted(causes, [&](const Cause& c) {
        return floor.log_above(c.left()) <= most && (best->entries.size() > 1 || c.entries.size() == 1);
    });
    if (rival == nullptr) rival = best;
    return rival->price.total() - rival->price.scales - rival->price.extreme;
}

// What looser forms of the best cause would explain besides, what a rough form is expected to leave, or what other
// forms of the rest of the set explain as well as its last effect does [nats]: no evidence for something else. The
// score of a set leaves the last out, too: a body whose ligament tears elsewhere tells as little of a second cause as
// of an unknown one.
double forms_of_best(const std::vector<Cause>& causes, const Left& nominal, const ErrorFloor& floor,
                     const Calibration& calibration) {
    const Cause* best = best_fitted(causes);
    // Another form of a cut that lets a ligament go is that of a torn ligament.
    if (best == nullptr || best->lets_go) return 0.0;
    double without = best->misfit_beside_forms.value_or(best->misfit);
    if (best->rough_form)
        without = std::min(
            without, best->misfit - calibration.form_error_local_support * std::max(0.0, nominal.cost - best->misfit));
    return std::max(best->form_nats, gain(best->left(), floor.scaled(best->left(), without), floor, calibration));
}

// Whatever acts on the body takes it to about the state that it is in under the best cause: what the model may be off
// by there is no evidence for something else.
ErrorFloor floor_under_best(const std::vector<Cause>& causes, ErrorFloor floor) {
    const Cause* best = best_fitted(causes);
    if (best != nullptr && best->model_error) floor.model = std::max(floor.model, *best->model_error);
    return floor;
}

// By how many the mechanical effects of a fit that happen, or that are there from the beginning, exceed one.
double more_than_one(const Fit& fit, const EffectTable& effects, bool happen) {
    const auto count = std::count_if(fit.at.effects.begin(), fit.at.effects.end(), [&](const ActiveEffect& a) {
        return !effects[a.entry].sensor && effects.happens(a) == happen;
    });
    return static_cast<double>(std::max<std::ptrdiff_t>(0, count - 1));
}

// Evidence for an effect that shows, logarithm: a score of 0 says that the effect may be there unseen, which is `none`.
double visible_evidence(double score) {
    constexpr double kUnseen = 0.02, kLarge = 30.0;  // a trace of it, so that the order stays
    return score > kLarge ? score
                          : std::log(std::expm1(std::max(score, 0.0)) + kUnseen * std::exp(std::min(score, 0.0)));
}

// p^(1/temperature), normalised.
void temper(Verdict& verdict, std::vector<Cause>& causes, const Calibration& calibration) {
    double total = 0.0;
    const auto temper = [&](double& p) { total += p = std::pow(p, 1.0 / calibration.temperature); };
    const auto normalise = [&](double& p) { p /= total; };
    const auto all = [&](const auto& change) {
        change(verdict.none_probability);
        change(verdict.unknown_probability);
        for (Cause& cause : causes) change(cause.probability);
    };
    all(temper);
    all(normalise);
}

// Sure answers are wrong as well: `unknown` and every fitted cause get the same share of that.
void keep_doubt(Verdict& verdict, std::vector<Cause>& causes, const Calibration& calibration) {
    const auto is_fitted = [](const Cause& cause) { return cause.fit.usable; };
    const auto fitted = std::count_if(causes.begin(), causes.end(), is_fitted);
    const double even = calibration.lapse * (1.0 - verdict.none_probability) / static_cast<double>(fitted + 1);
    const auto doubt = [&](double& p, bool shares) { p = (1.0 - calibration.lapse) * p + (shares ? even : 0.0); };
    doubt(verdict.unknown_probability, true);
    for (Cause& cause : causes) doubt(cause.probability, is_fitted(cause));
}

}  // namespace

double told_apart(const Fit& nominal, const Cause& cause, const ErrorFloor& floor, const Calibration& calibration) {
    if (!cause.fit.usable) return 0.0;
    ErrorFloor together = floor;
    together.model_beside = 0.0;
    return gain(left_of(nominal), cause.left(), floor, calibration) -
           gain(left_of(nominal), cause.left(), together, calibration);
}

double misfit_of(const Fit& fit, Eigen::Index nominal_parameters) {
    return fit.compared_cost() - fit.u.tail(fit.u.size() - nominal_parameters).squaredNorm();
}

double refit_score(const Fit& nominal, Cause& cause, const EffectTable& effects, const ErrorFloor& floor,
                   const Calibration& calibration) {
    // Scaled coordinates; columns of the amplitudes, then of places and times.
    const Fit& fit = cause.fit;
    const Eigen::Index theta = nominal.u.size();
    std::vector<Eigen::Index> amplitude, shape;
    Eigen::Index column = theta, counted = 0;
    std::vector<Eigen::VectorXd> of_effect;
    double scales = 0.0, usual = 0.0;
    for (std::size_t k = 0; k < cause.entries.size(); ++k) {
        const std::size_t e = cause.entries[k];
        const bool unseen = effects.always_there(fit.at.effects[k]);
        std::vector<Eigen::Index> own;
        for (const EffectParameter& p : effects[e].parameters) {
            (p.role == EffectRole::kAmplitude ? own : shape).push_back(column);
            if (is_scale(p) || (unseen && is_onset(p))) scales += tail_price(fit.u.segment(column, 1));
            ++column;
        }
        of_effect.emplace_back(fit.u(own));
        usual +=
            tail_price(Eigen::VectorXd::Constant(static_cast<Eigen::Index>(own.size()), calibration.unknown_amplitude));
        counted += counted_amplitudes(static_cast<Eigen::Index>(own.size()));
        amplitude.insert(amplitude.end(), own.begin(), own.end());
    }
    const auto amplitudes = static_cast<Eigen::Index>(amplitude.size());
    std::vector<Eigen::Index> all = amplitude;
    all.insert(all.end(), shape.begin(), shape.end());
    const Eigen::MatrixXd J = fit.J.leftCols(theta), G = fit.J(Eigen::all, all);
    const Eigen::MatrixXd H = Eigen::MatrixXd::Identity(theta, theta) + J.transpose() * J;
    const Eigen::MatrixXd S = calibration.nu / floor.above(std::min(fit.cost, floor.total())) *
                              (G.transpose() * G - G.transpose() * J * H.ldlt().solve(J.transpose() * G));
    const AmplitudePrice price = amplitude_price(of_effect, S.topLeftCorner(amplitudes, amplitudes), counted);
    cause.price = {
        price.tail, std::max(0.0, price.tail - usual), scales, price.occam, cause.search_cost,
        // A place that the fit narrows down further than the search grid does is the more fine-tuned.
        calibration.narrowing * std::max(0.0, narrowing_price(S, amplitudes) - cause.search_cost),
        calibration.further_effect * static_cast<double>(cause.entries.size() - 1) +
            calibration.further_mechanical * (more_than_one(fit, effects, true) + more_than_one(fit, effects, false))};
    cause.rough_form = effects.rough_form(fit.at.effects.front());
    cause.lets_go = effects.lets_go(fit.at.effects.front());
    cause.sensors =
        std::all_of(cause.entries.begin(), cause.entries.end(), [&](std::size_t e) { return effects[e].sensor; });
    cause.misfit = misfit_of(fit, theta);
    return gain(left_of(nominal), cause.left(), floor, calibration) - cause.price.total();
}

double explained_share(double cost_null, double cost, const ErrorFloor& floor) {
    const double excess = cost_null - floor.total();
    return excess <= 0.0 ? 0.0 : std::clamp((cost_null - cost) / excess, 0.0, 1.0);
}

double unknown_gain(const Left& nominal, const ErrorFloor& floor, const Calibration& calibration) {
    return gain(nominal, unexplained(nominal, floor, calibration), floor, calibration);
}

Verdict judge(std::vector<Cause> causes, const Left& nominal, const ErrorFloor& floor, const Calibration& calibration) {
    Verdict verdict;
    const ErrorFloor there = floor_under_best(causes, floor);
    const Left rest = unexplained_beside(causes, nominal, there, calibration);
    const double beyond = gain(nominal, rest, floor, calibration);
    const double least = calibration.unknown_least();
    const double price = std::max(least, price_of_rival(causes, rest, floor) + calibration.unknown_rarity);
    const double unknown = visible_evidence(beyond - price - forms_of_best(causes, nominal, floor, calibration));

    // Which cause, if there is one.
    double top = unknown;
    for (const Cause& cause : causes) top = std::max(top, visible_evidence(cause.score));
    double sum = std::exp(unknown - top);
    for (const Cause& cause : causes) sum += std::exp(visible_evidence(cause.score) - top);
    // Whether there is one.
    const double not_ours = gain(nominal, floor.reached(nominal, 1.0, 0.0), floor, calibration);
    const double something =
        std::min(std::max(top + std::log(sum), beyond - least), not_ours + calibration.within_floor);
    verdict.none_probability = 1.0 / (1.0 + std::exp(something - calibration.none_bonus));
    verdict.unknown_probability = (1.0 - verdict.none_probability) * std::exp(unknown - top) / sum;
    for (Cause& cause : causes)
        cause.probability = (1.0 - verdict.none_probability) * std::exp(visible_evidence(cause.score) - top) / sum;
    temper(verdict, causes, calibration);
    keep_doubt(verdict, causes, calibration);
    std::sort(causes.begin(), causes.end(),
              [](const Cause& a, const Cause& b) { return a.probability > b.probability; });
    verdict.causes = std::move(causes);
    return verdict;
}

}  // namespace teres
