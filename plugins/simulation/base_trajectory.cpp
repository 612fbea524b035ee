#include "plugins/simulation/base_trajectory.h"

#include <algorithm>
#include <cmath>

namespace teres {

using Eigen::VectorXd;

BaseTrajectory::BaseTrajectory(const Hypothesis& h) {
    at.theta.assign(h.theta.begin(), h.theta.end());
    for (const auto& e : h.effects) at.values.emplace_back(e.values.begin(), e.values.end());
    for (std::size_t e = 0; e < h.effects.size(); ++e) at.effects.push_back({h.effects[e].index, at.values[e]});
}

void BaseTrajectory::differentiate(const std::function<double(std::size_t frame)>& step_s) {
    const std::size_t F = num_played;
    if (F < 3) {
        v.assign(F, VectorXd::Zero(F > 0 ? x.front().size() : 0));
        a = v;
        return;
    }
    for (std::size_t f = 0; f < F; ++f) {
        const std::size_t m = std::clamp<std::size_t>(f, 1, F - 2);
        const double step = step_s(m);
        v.push_back((x[m + 1] - x[m - 1]) / (2.0 * step));
        a.push_back((x[m + 1] - 2.0 * x[m] + x[m - 1]) / (step * step));
    }
}

const BaseTrajectory::FrameState& BaseTrajectory::stresses_at(std::size_t frame, const Body& body) {
    std::call_once(stresses_made_, [&] {
        stresses_.resize(x.size());
        std::vector<double> S, psi, F;
        for (std::size_t f = 0; f < num_played; ++f)
            for (const auto& set : body.points()) {
                elastic_stress(set, body.material(), x[f].data(), S, &psi, &F);
                stresses_[f].push_back({{S.begin(), S.end()}, {psi.begin(), psi.end()}, {F.begin(), F.end()}});
            }
    });
    return stresses_[frame];
}

HypothesisPoint point_between(const HypothesisPoint& base, const Hypothesis& other, double share,
                              const std::vector<std::unique_ptr<Effect>>& effects) {
    const auto between = [&](EffectTransform transform, double from, double to) {
        if (from == to) return from;
        return transform == EffectTransform::kLog && from > 0.0 && to > 0.0 ? from * std::pow(to / from, share)
                                                                            : from + share * (to - from);
    };
    const auto values_in = [](std::span<const EffectInstance> list, std::size_t e) -> std::span<const double> {
        for (const auto& on : list)
            if (static_cast<std::size_t>(on.index) == e) return on.values;
        return {};
    };
    HypothesisPoint point;
    for (std::size_t p = 0; p < other.theta.size(); ++p)
        point.theta.push_back(between(EffectTransform::kLog, base.theta[p], other.theta[p]));
    std::vector<std::int32_t> index;
    for (std::size_t e = 0; e < effects.size(); ++e) {
        const auto from = values_in(base.effects, e), to = values_in(other.effects, e);
        if (from.empty() && to.empty()) continue;
        auto& values = point.values.emplace_back();
        index.push_back(static_cast<std::int32_t>(e));
        const auto& parameters = effects[e]->description().parameters;
        for (std::size_t p = 0; p < parameters.size(); ++p) {
            const bool amplitude = parameters[p].role == EffectRole::kAmplitude;
            const double a = !from.empty() ? from[p] : amplitude ? parameters[p].null_value : to[p];
            const double b = !to.empty() ? to[p] : amplitude ? parameters[p].null_value : from[p];
            values.push_back(between(parameters[p].transform, a, b));
        }
    }
    for (std::size_t k = 0; k < index.size(); ++k) point.effects.push_back({index[k], point.values[k]});
    return point;
}

}  // namespace teres
