#include "plugins/diagnosis/beginnings.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "plugins/diagnosis/amplitude_price.h"
#include "plugins/diagnosis/cause_fit.h"

namespace teres {
namespace {

constexpr double kLeastEarly = 0.1;  // of the beginning's cost, by first order: less of a place is not tried
constexpr double kFar = 2.0;         // prior standard deviations of an amplitude
constexpr double kUsual = 1.0;       // ... where it starts anew
constexpr double kClearly = 5.0;     // nats

// Amplitudes as far as they count, places and times.
double fitted_numbers(const EffectTable& effects, std::size_t entry) {
    const auto all = static_cast<Eigen::Index>(effects[entry].parameters.size());
    const auto amplitudes = static_cast<Eigen::Index>(effects.num_amplitudes(entry));
    return static_cast<double>(all - amplitudes + counted_amplitudes(amplitudes));
}

}  // namespace

Fit fit_beginning(Problem& problem, std::size_t share, const Assumption& start, int iterations) {
    return fit_jointly(problem.simulator, problem.whitener, problem.recording.observed, start,
                       {.max_iterations = iterations, .num_frames = problem.recording.num_frames / share});
}

double left_of_beginning(Problem& problem, const Assumption& known) {
    return fit_beginning(problem, 2, known, 3).cost;
}

std::vector<EffectScreening> try_beginnings(Problem& problem, const Assumption& known, double before,
                                            Screening screening, double most_of_quarter,
                                            const Simulator::Progress& report) {
    // Steps of a fit are taken in motions about the last whole one: that of what is known, whichever thread it is.
    const auto follow_half = [&](Problem& p) {
        if (p.simulator.starts_from(known)) return true;
        const Horizon half(p.simulator, p.recording.num_frames / 2);
        Eigen::VectorXd motion;
        return p.simulator.simulate(known, motion);
    };
    const double nu = problem.options.calibration.nu;
    std::vector<EffectScreening*> tried;
    for (EffectScreening& effect : screening.effects)
        if (!problem.simulator.effects()[effect.entry].sensor &&
            (effect.places.empty() || effect.explained >= kLeastEarly))
            tried.push_back(&effect);
    side_by_side(problem, tried.size(), [&](Problem& p, std::size_t k) {
        EffectScreening& effect = *tried[k];
        effect.score = 0.0;
        if (p.out_of_time()) return;
        if (!follow_half(p)) return;
        Assumption start = known;
        start.effects.push_back(effect.start);
        halve(p.simulator.effects()[effect.entry], start.effects.back());  // first order asks for too much
        Fit fit = fit_beginning(p, 4, start, 4);
        const bool tried_on = fit.usable && fit.cost <= most_of_quarter;
        if (tried_on) fit = fit_beginning(p, 2, fit.at, 4);
        if (tried_on && fit.usable) {
            effect.explained = 1.0 - fit.cost / before;
            effect.score = -0.5 * nu * std::log(fit.cost / before) -
                           0.5 * fitted_numbers(p.simulator.effects(), effect.entry) * std::log(nu);
            effect.start = fit.at.effects.back();
            fit.at.effects.pop_back();
            effect.beside = std::move(fit.at.effects);
        }
        if (&p == &problem) report(static_cast<double>(k + 1) / static_cast<double>(tried.size()));
    });
    std::vector<EffectScreening> begun;
    for (const EffectScreening* effect : tried)
        if (effect->score > 0.0) begun.push_back(*effect);
    std::stable_sort(begun.begin(), begun.end(), [](const auto& a, const auto& b) { return a.score > b.score; });
    return begun;
}

std::optional<Assumption> at_usual_size(const Simulator& simulator, const Assumption& known) {
    const FitSpace space(simulator.mechanics(), simulator.effects(), known);
    Eigen::VectorXd x = space.coordinates(known);
    bool far = false;
    for (std::size_t k = 0; k < known.effects.size(); ++k) {
        const EffectEntry& entry = simulator.effects()[known.effects[k].entry];
        for (std::size_t p = 0; p < entry.parameters.size(); ++p) {
            const Eigen::Index c = space.coordinate(k, p);
            const double u = (x(c) - space.prior_mean()(c)) / space.prior_stdev()(c);
            if (entry.parameters[p].role != EffectRole::kAmplitude || std::abs(u) <= kFar) continue;
            x(c) = space.prior_mean()(c) + std::copysign(kUsual, u) * space.prior_stdev()(c);
            far = true;
        }
    }
    return far ? std::optional(space.assumption(x)) : std::nullopt;
}

std::vector<EffectScreening> better_of(std::vector<EffectScreening> begun, const std::vector<EffectScreening>& anew) {
    for (const EffectScreening& effect : anew) {
        const auto found =
            std::find_if(begun.begin(), begun.end(), [&](const auto& b) { return b.entry == effect.entry; });
        if (found == begun.end())
            begun.push_back(effect);
        else if (effect.score > found->score + kClearly)
            *found = effect;
    }
    std::stable_sort(begun.begin(), begun.end(), [](const auto& a, const auto& b) { return a.score > b.score; });
    return begun;
}

void take_from_beginning(const EffectTable& effects, const std::vector<EffectScreening>& begun, Screening& whole) {
    for (EffectScreening& effect : whole.effects) {
        if (effects[effect.entry].sensor) continue;
        const auto found =
            std::find_if(begun.begin(), begun.end(), [&](const auto& b) { return b.entry == effect.entry; });
        effect.score = std::min(effect.score, 0.0);
        effect.explained = found != begun.end() ? found->explained : 0.0;
        if (found == begun.end()) continue;
        effect.start = found->start;
        effect.beside = found->beside;
        effect.candidate = found->candidate;
        effect.search_cost = found->search_cost;
        effect.places = found->places;
    }
    std::stable_sort(whole.effects.begin(), whole.effects.end(),
                     [](const auto& a, const auto& b) { return a.score > b.score; });
}

std::vector<EffectScreening> choose_with_inertia(const EffectTable& effects, const std::vector<EffectScreening>& begun,
                                                 std::size_t most, const Screening& whole) {
    std::vector<EffectScreening> chosen(begun.begin(),
                                        begun.begin() + static_cast<std::ptrdiff_t>(std::min(most, begun.size())));
    const auto sensor = std::find_if(whole.effects.begin(), whole.effects.end(), [&](const EffectScreening& effect) {
        return effects[effect.entry].sensor && effect.score > 0.0 && effect.explained >= kLeastExplained;
    });
    if (sensor != whole.effects.end()) chosen.push_back(*sensor);
    return chosen;
}

}  // namespace teres
