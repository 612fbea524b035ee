#include "plugins/diagnosis/cracks.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <string>

#include "plugins/diagnosis/search_steps.h"
#include "plugins/diagnosis/strong_start.h"

namespace teres {
namespace {

using Eigen::Vector3d;

constexpr std::size_t kPlaces = 10;  // of the search grid, next to the fitted cut
constexpr int kTurns = 6;            // about the way to the surface
constexpr double kRadii = 2.0;       // of a ball of usual size: a crack lets less go than softened tissue
constexpr std::size_t kLooked = 8;   // planes that look best at one frame go on to all of them
constexpr std::size_t kKept = 2;     // are moved once; the better one goes on
constexpr double kFirstMove = 0.5;   // share of the radius; then a half of that
constexpr int kMoves = 4;
constexpr std::size_t kTrialFrames = 3;  // after the instant
constexpr double kNone = std::numeric_limits<double>::infinity();

constexpr std::size_t kNoParameter = static_cast<std::size_t>(-1);
std::size_t parameter_of(const EffectEntry& entry, std::string_view name) {
    for (std::size_t p = 0; p < entry.parameters.size(); ++p)
        if (name == entry.parameters[p].name) return p;
    return kNoParameter;
}

bool can_part(const EffectEntry& entry) {
    return entry.parts() && parameter_of(entry, "normal_x") != kNoParameter &&
           parameter_of(entry, "radius") != kNoParameter && parameter_of(entry, "onset") != kNoParameter;
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
    double left = kNone;
};

// What planes leave at frames after the cut, beside what else is assumed.
class Trial {
  public:
    Trial(Problem& problem, const Fit& fitted) : problem_(problem), at_(fitted.at) {
        const EffectEntry& entry = entry_();
        ActiveEffect& cut = at_.effects.back();
        const std::size_t onset = parameter_of(entry, "onset"), duration = parameter_of(entry, "duration");
        const double done_s = cut.values[onset] + (duration != kNoParameter ? cut.values[duration] : 0.0);
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
    Assumption with(const CrackPlane& plane) const {
        Assumption at = at_;
        at.effects.back() = with_crack(entry_(), at.effects.back(), plane);
        return at;
    }
    /// Best first; those under which the body does not hold are left out. `last`: by the last of the frames alone.
    std::vector<Tried> best_of(const std::vector<CrackPlane>& planes, std::size_t count, bool last = false) {
        std::vector<Tried> tried(planes.size());
        const std::span<const std::int32_t> frames = last ? std::span(frames_).last(1) : std::span(frames_);
        side_by_side(problem_, planes.size(), [&](Problem& p, std::size_t k) {
            tried[k].plane = planes[k];
            Eigen::VectorXd trajectory;
            if (!p.out_of_time() && p.simulator.simulate_at(with(planes[k]), frames, trajectory))
                tried[k].left = left_at(p, frames, trajectory);
        });
        std::stable_sort(tried.begin(), tried.end(), [](const Tried& a, const Tried& b) { return a.left < b.left; });
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
        const std::vector<Tried> beside = trial.best_of(planes_beside(best.plane, share), 1);
        if (!beside.empty() && beside.front().left < best.left)
            best = beside.front();
        else
            share *= 0.5;
    }
    return best;
}

// A cut that a crack may explain better.
const Cause* may_be_crack(const Problem& problem, std::vector<Cause>& causes) {
    if (causes.empty() || problem.simulator.mechanics().dynamic() || problem.out_of_time()) return nullptr;
    sort_by_score(causes);
    const Cause& best = causes.front();
    if (!best.fit.usable || problem.floor.explains(best.left())) return nullptr;
    for (const Cause& cause : causes)
        if (cause.fit.usable && cause.entries.size() == 1 &&
            can_part(problem.simulator.effects()[cause.entries.front()]) && cause.score > best.score - kOutOfReach)
            return &cause;
    return nullptr;
}

}  // namespace

ActiveEffect with_crack(const EffectEntry& entry, ActiveEffect cut, const CrackPlane& plane) {
    const auto set = [&](std::string_view name, double value) {
        const std::size_t p = parameter_of(entry, name);
        const EffectParameter& parameter = entry.parameters[p];
        cut.values[p] = std::clamp(value, parameter.lower, parameter.upper);
    };
    for (Eigen::Index a = 0; a < 3; ++a) {
        set(std::string("center_") + "xyz"[a], plane.centre_m(a));
        set(std::string("normal_") + "xyz"[a], plane.normal(a));
    }
    set("radius", plane.radius_m);
    return cut;
}

std::vector<CrackPlane> planes_near(const TrajectoryModel& model, const EffectTable& effects, const ActiveEffect& cut) {
    const EffectEntry& entry = effects[cut.entry];
    const Vector3d at = *centre_of(entry, cut);
    const auto farther = [&](const Vector3d& a, const Vector3d& b) { return (a - at).norm() < (b - at).norm(); };
    std::vector<Vector3d> places;
    for (std::size_t c = 0; c < static_cast<std::size_t>(entry.info.num_candidates); ++c) {
        const Vector3d place = *centre_of(entry, effects.candidate(cut.entry, c));
        if (std::find(places.begin(), places.end(), place) == places.end()) places.push_back(place);
    }
    std::stable_sort(places.begin(), places.end(), farther);
    places.resize(std::min(places.size(), kPlaces));
    places.insert(places.begin(), at);

    const double usual = std::exp(entry.parameters[parameter_of(entry, "radius")].prior_mean);
    std::vector<CrackPlane> planes;
    for (const Vector3d& place : places) {
        const Vector3d way = way_out(model, place), side = way.unitOrthogonal(), up = way.cross(side);
        for (int k = 0; k < kTurns; ++k) {
            const double angle = std::numbers::pi * k / kTurns;
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

bool look_for_cracks(Problem& problem, const Fit& nominal, std::vector<Cause>& causes) {
    const Cause* found = may_be_crack(problem, causes);
    if (found == nullptr) return false;
    const Cause cut = *found;
    const auto report = stage(problem.options, "looking for a crack");
    report(0.0);
    Trial trial(problem, cut.fit);
    std::vector<CrackPlane> planes;
    const ActiveEffect& softened = cut.fit.at.effects.back();
    for (const Tried& tried : trial.best_of(
             planes_near(problem.simulator.mechanics(), problem.simulator.effects(), softened), kLooked, true))
        planes.push_back(tried.plane);
    std::vector<Tried> best = trial.best_of(planes, kKept);
    if (best.empty()) return true;
    report(0.4);
    std::vector<double> shares(best.size(), kFirstMove);
    for (std::size_t k = 0; k < best.size(); ++k) best[k] = moved(trial, best[k], 1, shares[k]);
    const std::size_t better = best.size() > 1 && best[1].left < best[0].left ? 1 : 0;
    const Tried found_plane = moved(trial, best[better], kMoves - 1, shares[better]);
    report(0.7);
    Cause crack;
    crack.entries = cut.entries;
    crack.search_cost = cut.search_cost + std::log(static_cast<double>(kTurns));
    crack.fit = fit_from_whole(problem, trial.with(found_plane.plane), kRefitIterations);
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
    const ActiveEffect& cut = best.fit.at.effects.front();
    const auto along = [&](const char* axis) { return *value_of(entry, cut, axis); };
    const bool parted = Vector3d(along("normal_x"), along("normal_y"), along("normal_z")).norm() > 0.0;
    return parted && (by_score.size() == 1 || by_score[1].score < best.score - kOutOfReach);
}

}  // namespace teres
