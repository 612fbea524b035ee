#include "plugins/diagnosis/other_places.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "plugins/diagnosis/search_steps.h"
#include "plugins/diagnosis/strong_start.h"

namespace teres {
namespace {

constexpr std::size_t kPlaces = 3;  // of the screening
constexpr double kNearby = 1.5;  // of the best answer's misfit: a fit from another place that stays beyond is given up
constexpr double kLeastOdds = 0.2;     // of another place worth telling
constexpr double kOtherCourse = 0.3;   // prior standard deviations of an instant or a frequency
constexpr double kLineStep = 0.25;     // of `apart_m`, along a line of action
constexpr double kMostSteps = 1000.0;  // to either side

// Direction of a force; of one that swings as cos and sin of its phase, the axis of its larger swing. Nothing for what
// is no force.
std::optional<Eigen::Vector3d> line_of_action(const EffectEntry& entry, const ActiveEffect& effect) {
    const auto force = vector_of(entry, effect, "force");
    if (force) return force->norm() > 0.0 ? std::optional(force->normalized()) : std::nullopt;
    const auto c = vector_of(entry, effect, "cos"), s = vector_of(entry, effect, "sin");
    if (!c || !s || !(c->norm() + s->norm() > 0.0)) return std::nullopt;
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> swing(*c * c->transpose() + *s * s->transpose());
    return swing.eigenvectors().col(2);
}

ActiveEffect acting_at(const Simulator& simulator, ActiveEffect effect, const Eigen::Vector3d& centre_m) {
    const EffectEntry& entry = simulator.effects()[effect.entry];
    constexpr const char* kName[3] = {"center_x", "center_y", "center_z"};
    for (std::size_t p = 0; p < entry.parameters.size(); ++p)
        for (Eigen::Index a = 0; a < 3; ++a)
            if (std::string_view(entry.parameters[p].name) == kName[a]) effect.values[p] = centre_m(a);
    simulator.mechanics().settle_effect(entry.index, effect.values);
    return effect;
}

// The best place at which the effect has another course in time than at the best of all; null: there is none.
const PlaceGain* of_another_course(const EffectEntry& entry, const EffectScreening& screened) {
    const auto same = [&](const ActiveEffect& a) {
        for (std::size_t p = 0; p < entry.parameters.size(); ++p) {
            const EffectParameter& parameter = entry.parameters[p];
            const std::string_view unit = parameter.unit;
            if (parameter.role == EffectRole::kShape && parameter.transform == EffectTransform::kIdentity &&
                (unit == "s" || unit == "Hz") &&
                std::abs(a.values[p] - screened.start.values[p]) > kOtherCourse * parameter.prior_stdev)
                return false;
        }
        return true;
    };
    const PlaceGain* best = nullptr;
    for (const PlaceGain& place : screened.places)
        if (!same(place.start) && (best == nullptr || place.score > best->score)) best = &place;
    return best;
}

void sort_by_cost(std::vector<Cause>& causes) {
    std::stable_sort(causes.begin(), causes.end(),
                     [](const Cause& a, const Cause& b) { return a.fit.cost < b.fit.cost; });
}

// The best whose last effect is not where that of the first is; null: there is none, or it is further behind.
Cause* best_elsewhere(const EffectEntry& entry, std::vector<Cause>& by_cost, double apart_m, double most_misfit) {
    const Eigen::Vector3d first = *centre_of(entry, by_cost.front().fit.at.effects.back());
    const auto found = std::find_if(by_cost.begin() + 1, by_cost.end(), [&](const Cause& cause) {
        return (*centre_of(entry, cause.fit.at.effects.back()) - first).norm() >= apart_m;
    });
    return found != by_cost.end() && found->fit.misfit <= most_misfit ? &*found : nullptr;
}

// Where what fits nearly as well has its last effect, each apart from the best and from one another.
std::vector<OtherPlace> as_likely(const EffectEntry& entry, const Cause& best, const std::vector<Cause>& others,
                                  double apart_m, double temperature) {
    std::vector<Eigen::Vector3d> taken{*centre_of(entry, best.fit.at.effects.back())};
    std::vector<OtherPlace> places;
    for (const Cause& other : others) {
        const Eigen::Vector3d centre = *centre_of(entry, other.fit.at.effects.back());
        const double odds = std::exp(std::min(0.0, (other.score - best.score) / temperature));
        if (odds < kLeastOdds || std::any_of(taken.begin(), taken.end(), [&](const Eigen::Vector3d& other_centre) {
                return (other_centre - centre).norm() < apart_m;
            }))
            continue;
        taken.push_back(centre);
        places.push_back({{centre.x(), centre.y(), centre.z()}, odds});
    }
    return places;
}

}  // namespace

std::vector<ActiveEffect> along_line_of_action(const Simulator& simulator, const ActiveEffect& effect, double apart_m) {
    const EffectEntry& entry = simulator.effects()[effect.entry];
    const auto line = line_of_action(entry, effect), from = centre_of(entry, effect);
    if (entry.sensor || !line || !from || !(apart_m > 0.0)) return {};
    double reach = 0.0;
    for (const EffectParameter& p : entry.parameters)
        if (std::string_view(p.unit) == "m") reach = std::max(reach, p.upper - p.lower);
    const double step = kLineStep * apart_m;
    const int steps = static_cast<int>(std::min(std::ceil(reach / step), kMostSteps));
    std::vector<ActiveEffect> met;
    std::vector<double> distance;  // from the line's points to the surface
    for (int k = -steps; k <= steps; ++k) {
        const Eigen::Vector3d point = *from + k * step * *line;
        met.push_back(acting_at(simulator, effect, point));
        distance.push_back((*centre_of(entry, met.back()) - point).norm());
    }
    std::vector<ActiveEffect> crossings;
    for (std::size_t k = 1; k + 1 < met.size(); ++k) {
        const bool crosses = distance[k] < step && distance[k] < distance[k - 1] && distance[k] <= distance[k + 1];
        if (crosses && (*centre_of(entry, met[k]) - *from).norm() >= apart_m) crossings.push_back(met[k]);
    }
    return crossings;
}

void try_other_places(Problem& problem, const Fit& nominal, const Base* base, const Screening& screening,
                      Cause& cause) {
    const auto screened = std::find_if(screening.effects.begin(), screening.effects.end(),
                                       [&](const auto& e) { return e.entry == cause.entries.back(); });
    if (!cause.fit.usable || screened == screening.effects.end() || screened->places.empty()) return;
    const EffectEntry& entry = problem.simulator.effects()[screened->entry];
    if (base == nullptr && at_full_size(problem, entry)) return;  // so were all places tried before it was fitted
    const ActiveEffect fitted = cause.fit.at.effects.back();
    const double apart = apart_m(screened->places);
    const auto found = centre_of(entry, fitted), begun = centre_of(entry, screened->start);
    std::vector<EffectScreening> places;
    const auto add = [&](ActiveEffect start) {
        places.push_back(*screened);
        places.back().start = std::move(start);
    };
    for (const PlaceGain& place : best_places(screened->places, kPlaces))
        if ((place.centre_m - *found).norm() >= apart && place.centre_m != *begun)
            add(with_instant_of(entry, place.start, fitted));
    if (const PlaceGain* other = of_another_course(entry, *screened)) add(other->start);
    for (ActiveEffect& elsewhere : along_line_of_action(problem.simulator, fitted, apart)) add(std::move(elsewhere));
    std::vector<Cause> others(places.size());
    const double nearby =
        problem.outlook != nullptr ? std::numeric_limits<double>::infinity() : kNearby * cause.fit.misfit;
    side_by_side(problem, places.size(), [&](Problem& p, std::size_t k) {
        const GivenUpBeyond bound(p, {.misfit = nearby}, nominal.misfit);
        others[k] = refit(p, nominal, base != nullptr ? &base->known : nullptr, places[k], kFurtherIterations);
    });
    others.push_back(std::move(cause));
    std::erase_if(others, [](const Cause& c) { return !c.fit.usable; });
    for (Cause& other : others) score(problem, nominal, base, other);
    sort_by_cost(others);
    // Descents come differently far in so many steps: what may be the better place is fitted on before it is chosen.
    const bool worth_settling = problem.outlook == nullptr && !problem.out_of_time();
    if (Cause* elsewhere = best_elsewhere(entry, others, apart, nearby); elsewhere != nullptr && worth_settling) {
        side_by_side(problem, 2, [&](Problem& p, std::size_t k) {
            Cause& one = k == 0 ? others.front() : *elsewhere;
            settle(p, one, kFurtherIterations);
            score(p, nominal, base, one);
        });
        sort_by_cost(others);
    }
    cause = std::move(others.front());
    others.erase(others.begin());
    cause.other_places = as_likely(entry, cause, others, apart, problem.options.calibration.temperature);
}

}  // namespace teres
