#include "plugins/diagnosis/cracks.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "plugins/diagnosis/search_steps.h"
#include "plugins/diagnosis/strong_start.h"

namespace teres {
namespace {

using Eigen::Vector3d;

constexpr std::size_t kPlaces = 10, kByGain = 4;  // of the search grid next to the fitted cut; those that explain most
constexpr int kTurns = 6;                         // about the way to the surface
constexpr double kRadii = 2.0;                    // of a ball of usual size: a crack lets less go than softened tissue
constexpr int kFewTurns = 3;                      // at places far from it, by one frame
constexpr std::size_t kElsewhere = 6;             // of these go on
constexpr std::size_t kFittedElsewhere = 3;       // planes there, where they leave less than any near the cut
constexpr std::size_t kFitted = 6;                // planes whose ligaments are fitted before they are compared
constexpr int kShortFit = 2;                      // iterations of that
constexpr std::size_t kKept = 2;                  // are moved once; the better one goes on
constexpr double kFirstMove = 0.5;                // share of the radius; then a half of that
constexpr int kMoves = 4;
constexpr std::size_t kTrialFrames = 3;  // after the instant
constexpr double kNone = std::numeric_limits<double>::infinity();

bool can_part(const EffectEntry& entry) {
    return entry.parts() && parameter_of(entry, "normal_x") && parameter_of(entry, "radius") &&
           parameter_of(entry, "onset") && parameter_of(entry, "duration");
}

// The way from a place to the point of the surface next to it, by nodes; any where it lies on one.
Vector3d way_out(const TrajectoryModel& model, const Vector3d& place) {
    std::vector<double> rest(3 * model.num_nodes());
    model.rest_positions(rest);
    std::vector<std::int32_t> triangles(3 * model.num_surface_triangles());
    model.surface_triangles(triangles);
    Vector3d way = Vector3d::UnitZ();
    double least = kNone;
    for (const std::int32_t node : triangles) {
        const Vector3d to = Eigen::Map<const Vector3d>(&rest[3 * static_cast<std::size_t>(node)]) - place;
        if (to.norm() < least && to.norm() > 0.0) least = to.norm(), way = to / least;
    }
    return way;
}

struct Tried {
    CrackPlane plane;
    std::vector<double> theta;  // of the ligaments beside it
    double left = kNone;
};

// What planes leave at frames after the cut, beside what else is assumed.
class Trial {
  public:
    Trial(Problem& problem, const Fit& fitted) : problem_(problem), at_(fitted.at) {
        const EffectEntry& entry = entry_();
        const ActiveEffect& cut = at_.effects.back();
        const double done_s = *value_of(entry, cut, "onset") + *value_of(entry, cut, "duration");
        const std::vector<double>& times = problem.simulator.times_s();
        const auto end = static_cast<std::int32_t>(problem.recording.first_held_frame);
        auto first = static_cast<std::int32_t>(std::upper_bound(times.begin(), times.end(), done_s) - times.begin());
        first = std::clamp(first, 0, std::max(0, end - 1));
        for (std::size_t k = 1; k <= kTrialFrames; ++k) {
            const auto f =
                first + static_cast<std::int32_t>(k * static_cast<std::size_t>(end - first) / kTrialFrames) - 1;
            if (frames_.empty() || f > frames_.back()) frames_.push_back(std::max(f, first));
        }
    }
    const std::vector<double>& theta() const { return at_.theta; }
    const std::vector<std::int32_t>& frames() const { return frames_; }
    Assumption with(const Tried& tried) const {
        Assumption at = at_;
        at.theta = tried.theta;
        at.effects.back() = with_crack(entry_(), at.effects.back(), tried.plane);
        return at;
    }
    /// Best first; those under which the body does not hold are left out.
    std::vector<Tried> best_of(const std::vector<CrackPlane>& planes, const std::vector<double>& theta,
                               std::size_t count) {
        return best_of(planes, theta, count, frames_);
    }
    /// By these frames.
    std::vector<Tried> best_of(const std::vector<CrackPlane>& planes, const std::vector<double>& theta,
                               std::size_t count, std::span<const std::int32_t> frames) {
        std::vector<Tried> tried(planes.size());
        side_by_side(problem_, planes.size(), [&](Problem& p, std::size_t k) {
            tried[k] = {planes[k], theta, kNone};
            Eigen::VectorXd trajectory;
            if (!p.out_of_time() && p.simulator.simulate_at(with(tried[k]), frames, trajectory))
                tried[k].left = left_at(p, frames, trajectory);
        });
        std::stable_sort(tried.begin(), tried.end(), [](const Tried& x, const Tried& y) { return x.left < y.left; });
        std::erase_if(tried, [](const Tried& t) { return !std::isfinite(t.left); });
        tried.resize(std::min(tried.size(), count));
        return tried;
    }

  private:
    const EffectEntry& entry_() const { return problem_.simulator.effects()[at_.effects.back().entry]; }

    Problem& problem_;
    Assumption at_;
    std::vector<std::int32_t> frames_;
};

// In so many rounds, the first of which goes by `share`: by half as much after each that led nowhere.
Tried moved(Trial& trial, Tried best, int rounds, double& share) {
    for (int round = 0; round < rounds; ++round) {
        const std::vector<Tried> beside = trial.best_of(planes_beside(best.plane, share), best.theta, 1);
        if (!beside.empty() && beside.front().left < best.left)
            best = beside.front();
        else
            share *= 0.5;
    }
    return best;
}

// Where softened tissue explains little, first order may lead elsewhere: planes at the places where the few that are
// tried by one frame leave least, but those where `near` are; best first.
std::vector<Tried> best_elsewhere(const Problem& problem, Trial& trial, const EffectEntry& entry,
                                  const Eigen::VectorXd& fitted, const std::vector<PlaceGain>& grid,
                                  const std::vector<CrackPlane>& near) {
    std::vector<Vector3d> places;
    for (const PlaceGain& place : grid)
        if (std::none_of(near.begin(), near.end(), [&](const auto& plane) { return plane.centre_m == place.centre_m; }))
            places.push_back(place.centre_m);
    const TrajectoryModel& model = problem.simulator.mechanics();
    const std::vector<CrackPlane> few = planes_at(model, entry, places, kFewTurns);
    const std::int32_t frame = furthest_off(problem, trial.frames(), fitted);
    places.clear();
    for (const Tried& tried : trial.best_of(few, trial.theta(), few.size(), {&frame, 1}))
        if (places.size() < kElsewhere && std::find(places.begin(), places.end(), tried.plane.centre_m) == places.end())
            places.push_back(tried.plane.centre_m);
    return trial.best_of(planes_at(model, entry, places, kTurns), trial.theta(), kFittedElsewhere);
}

// The planes with their ligaments fitted for a few iterations, which leaves the planes as they are; best first.
std::vector<std::pair<Tried, Fit>> beside_fitted(Problem& problem, Trial& trial, const std::vector<Tried>& planes) {
    std::vector<std::pair<Tried, Fit>> fits(planes.size());
    side_by_side(problem, planes.size(), [&](Problem& p, std::size_t k) {
        fits[k].first = planes[k];
        if (!p.out_of_time()) fits[k].second = fit_from_whole(p, trial.with(planes[k]), kShortFit);
    });
    std::erase_if(fits, [](const auto& fit) { return !fit.second.usable; });
    std::stable_sort(fits.begin(), fits.end(),
                     [](const auto& x, const auto& y) { return x.second.cost < y.second.cost; });
    for (auto& [tried, fit] : fits) tried.theta = fit.at.theta;
    return fits;
}

// The first few moved once, the better one of these on.
std::optional<Tried> moved_from(Trial& trial, const std::vector<std::pair<Tried, Fit>>& fits) {
    std::optional<Tried> best;
    double share = kFirstMove;
    for (std::size_t k = 0; k < std::min(kKept, fits.size()); ++k) {
        const Tried& from = fits[k].first;
        const std::vector<Tried> start = trial.best_of({from.plane}, from.theta, 1);
        if (start.empty()) continue;
        double own = kFirstMove;
        const Tried once = moved(trial, start.front(), 1, own);
        if (!best || once.left < best->left) best = once, share = own;
    }
    if (best) best = moved(trial, *best, kMoves - 1, share);
    return best;
}

// A cut that a crack may explain better.
const Cause* may_be_crack(const Problem& problem, std::vector<Cause>& causes) {
    if (causes.empty() || problem.simulator.mechanics().dynamic() || problem.out_of_time()) return nullptr;
    sort_by_score(causes);
    const Cause* best = nullptr;  // of what was fitted
    for (const Cause& cause : causes) {
        if (!cause.fit.usable) continue;
        if (best == nullptr) best = &cause;
        if (problem.floor.explains(best->left()) || cause.score <= best->score - kOutOfReach) return nullptr;
        if (cause.entries.size() == 1 && can_part(problem.simulator.effects()[cause.entries.front()])) return &cause;
    }
    return nullptr;
}

}  // namespace

ActiveEffect with_crack(const EffectEntry& entry, ActiveEffect cut, const CrackPlane& plane) {
    const auto set = [&](std::string_view name, double value) {
        const std::size_t p = *parameter_of(entry, name);
        const EffectParameter& parameter = entry.parameters[p];
        cut.values[p] = std::clamp(value, parameter.lower, parameter.upper);
    };
    for (Eigen::Index a = 0; a < 3; ++a) {
        set(std::string("center_") + "xyz"[a], plane.centre_m(a));
        set(std::string("normal_") + "xyz"[a], plane.normal(a));
    }
    set("radius", plane.radius_m);
    for (std::size_t p = 0; p < cut.values.size(); ++p)  // nothing is left between open faces
        if (entry.parameters[p].role == EffectRole::kAmplitude) cut.values[p] = entry.parameters[p].upper;
    return cut;
}

std::vector<CrackPlane> planes_near(const TrajectoryModel& model, const EffectTable& effects, const ActiveEffect& cut,
                                    std::vector<PlaceGain> by_gain) {
    const EffectEntry& entry = effects[cut.entry];
    std::vector<Vector3d> places{*centre_of(entry, cut)};
    const auto add = [&](const std::vector<PlaceGain>& sorted, std::size_t count) {
        std::size_t added = 0;
        for (const PlaceGain& place : sorted) {
            if (added == count) return;
            if (std::find(places.begin(), places.end(), place.centre_m) != places.end()) continue;
            places.push_back(place.centre_m);
            ++added;
        }
    };
    std::stable_sort(by_gain.begin(), by_gain.end(), [](const auto& x, const auto& y) { return x.score > y.score; });
    std::vector<PlaceGain> by_distance = by_gain;
    std::stable_sort(by_distance.begin(), by_distance.end(), [&](const auto& x, const auto& y) {
        return (x.centre_m - places.front()).norm() < (y.centre_m - places.front()).norm();
    });
    add(by_distance, kPlaces);
    add(by_gain, kByGain);
    return planes_at(model, entry, places, kTurns);
}

std::vector<CrackPlane> planes_at(const TrajectoryModel& model, const EffectEntry& entry,
                                  const std::vector<Eigen::Vector3d>& places, int turns) {
    const double usual = std::exp(entry.parameters[*parameter_of(entry, "radius")].prior_mean);
    std::vector<CrackPlane> planes;
    for (const Vector3d& place : places) {
        const Vector3d way = way_out(model, place), side = way.unitOrthogonal(), up = way.cross(side);
        for (int k = 0; k < turns; ++k) {
            const double angle = std::numbers::pi * k / turns;
            planes.push_back({place, -way, std::cos(angle) * side + std::sin(angle) * up, kRadii * usual});
        }
    }
    return planes;
}

std::vector<CrackPlane> planes_beside(const CrackPlane& plane, double share) {
    const Vector3d across = plane.inwards.cross(plane.normal);
    const double angle = 0.5 * share * std::numbers::pi / 2.0, step = share * plane.radius_m;
    std::vector<CrackPlane> beside;
    for (const double sign : {-1.0, 1.0}) {
        for (const Vector3d& way : {plane.inwards, plane.normal, across}) {
            beside.push_back(plane);
            beside.back().centre_m += sign * step * way;
        }
        const double c = std::cos(angle), s = sign * std::sin(angle);
        beside.push_back(plane);
        beside.back().normal = c * plane.normal + s * across;
        beside.push_back(plane);
        beside.back().normal = c * plane.normal + s * plane.inwards;
        beside.back().inwards = c * plane.inwards - s * plane.normal;
        beside.push_back(plane);
        beside.back().radius_m *= std::pow(1.0 + share, sign);
    }
    return beside;
}

bool look_for_cracks(Problem& problem, const Fit& nominal, const Screening& screening, std::vector<Cause>& causes) {
    const Cause* found = may_be_crack(problem, causes);
    if (found == nullptr) return false;
    const Cause cut = *found;
    const auto report = stage(problem.options, "looking for a crack");
    report(0.0);
    const auto screened = std::find_if(screening.effects.begin(), screening.effects.end(),
                                       [&](const EffectScreening& e) { return e.entry == cut.entries.front(); });
    if (screened == screening.effects.end()) return false;
    Trial trial(problem, cut.fit);
    const EffectTable& effects = problem.simulator.effects();
    const std::vector<CrackPlane> near =
        planes_near(problem.simulator.mechanics(), effects, cut.fit.at.effects.back(), screened->places);
    std::vector<Tried> tried = trial.best_of(near, trial.theta(), kFitted);
    report(0.2);
    const double least = tried.empty() ? kNone : tried.front().left;
    for (Tried& far :
         best_elsewhere(problem, trial, effects[cut.entries.front()], cut.fit.trajectory, screened->places, near))
        if (far.left < least) tried.push_back(std::move(far));
    report(0.4);
    const std::vector<std::pair<Tried, Fit>> fits = beside_fitted(problem, trial, tried);
    report(0.5);
    const std::optional<Tried> best = moved_from(trial, fits);
    if (!best) return true;
    report(0.7);
    Cause crack;
    crack.entries = cut.entries;
    crack.search_cost = cut.search_cost + std::log(static_cast<double>(kTurns));
    crack.fit = fit_from_whole(problem, trial.with(*best), kRefitIterations);
    if (const Fit& unmoved = fits.front().second; !crack.fit.usable || unmoved.cost < crack.fit.cost)
        crack.fit = fit_from_whole(problem, unmoved.at, kRefitIterations);
    settle_instant(problem, crack.fit, kRefitIterations);
    problem.look_ahead(crack.fit);
    score(problem, nominal, nullptr, crack);
    keep_better(causes, std::move(crack));
    sort_by_score(causes);
    report(1.0);
    return true;
}

bool crack_is_far_ahead(const EffectTable& effects, const std::vector<Cause>& by_score) {
    const Cause& best = by_score.front();
    if (!best.fit.usable || best.entries.size() > 1) return false;
    const EffectEntry& entry = effects[best.entries.front()];
    if (!can_part(entry)) return false;
    const bool parted = vector_of(entry, best.fit.at.effects.front(), "normal")->norm() > 0.0;
    return parted && (by_score.size() == 1 || by_score[1].score < best.score - kOutOfReach);
}

}  // namespace teres
