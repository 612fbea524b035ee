#include "plugins/simulation/effect_model.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"

namespace teres {
namespace {

std::string known_ids(const std::vector<std::unique_ptr<Effect>>& effects) {
    std::string text;
    for (const auto& effect : effects) text += (text.empty() ? "" : ", ") + std::string(effect->description().id);
    return text;
}

double physical(const EffectParameter& p, double transformed) {
    return p.transform == EffectTransform::kLog ? std::exp(transformed) : transformed;
}

}  // namespace

Result<std::unique_ptr<EffectModel>> EffectModel::make(const Case& c, const PlayerSettings& settings,
                                                       const std::vector<std::string>& ids) {
    std::unique_ptr<EffectModel> m(new EffectModel());
    TERES_TRY_ASSIGN(m->player_, ScenePlayer::make(c, settings));
    Scene& scene = m->player_->scene();
    if (scene.dynamic)
        return invalid_input("simulation.effects: " + c.name +
                             " has inertia; effects are estimated frame by frame for quasi-static cases only");
    m->effects_ = make_effects(scene);
    for (const std::string& id : ids) {
        const auto found = std::find_if(m->effects_.begin(), m->effects_.end(),
                                        [&](const auto& effect) { return id == effect->description().id; });
        if (found == m->effects_.end())
            return invalid_input("simulation.effects: '" + id + "' is none of " + known_ids(m->effects_));
        const EffectDescription& d = (*found)->description();
        if (!d.not_applicable.empty())
            return invalid_input("simulation.effects: " + id + " is not in question here: " + d.not_applicable);
        const auto index = static_cast<std::size_t>(found - m->effects_.begin());
        std::vector<double> values = central_candidate(d.parameters);
        scene.reset(scene.start_s, std::vector<double>(3 * m->num_regions(), 0.0));
        (*found)->apply(values, scene);
        if (!scene.viscosity.empty())
            return invalid_input("simulation.effects: " + id + " has a memory of its own; use teres diagnose");
        for (std::size_t p = 0; p < d.parameters.size(); ++p)
            if (d.parameters[p].prior_stdev > 0.0 && d.parameters[p].role != EffectRole::kChoice)
                m->unknown_.push_back({id + "." + d.parameters[p].name, m->on_.size(), p});
        m->values_.push_back(std::move(values));
        m->on_.push_back({static_cast<std::int32_t>(index), {}});
    }
    for (std::size_t e = 0; e < m->on_.size(); ++e) m->on_[e].values = m->values_[e];
    return m;
}

ForwardParameter EffectModel::parameter(std::size_t index) const {
    const std::size_t groups = nominal().num_parameters();
    if (index < groups) return nominal().parameter(index);
    const Unknown& unknown = unknown_[index - groups];
    const auto effect = static_cast<std::size_t>(on_[unknown.effect].index);
    const EffectParameter& p = effects_[effect]->description().parameters[unknown.parameter];
    const bool log = p.transform == EffectTransform::kLog;
    return {unknown.name.c_str(),
            p.unit,
            physical(p, p.prior_mean),
            log ? p.prior_stdev : 0.0,
            log ? 0.0 : p.prior_stdev,
            p.lower,
            p.upper,
            0.0};
}

ForwardReport EffectModel::advance(const ForwardInputs& inputs, std::span<const double> theta, std::span<double> X,
                                   std::size_t lanes) noexcept {
    const std::size_t rows = num_state(), groups = nominal().num_parameters(), parameters = num_parameters();
    TERES_CHECK(lanes > 0 && X.size() == rows * lanes && theta.size() == parameters * lanes);
    loads_.region_force_n.assign(inputs.region_force_n.begin(), inputs.region_force_n.end());
    loads_.tool_m.assign(inputs.tool_position_m.begin(), inputs.tool_position_m.end());
    ForwardReport report;
    report.lanes = static_cast<std::int32_t>(lanes);
    for (std::size_t l = 0; l < lanes; ++l) {
        const auto lane = theta.subspan(l * parameters, parameters);
        for (std::size_t u = 0; u < unknown_.size(); ++u)
            values_[unknown_[u].effect][unknown_[u].parameter] = lane[groups + u];
        const auto r =
            player_->rest_at(inputs.time_s, loads_, {lane.first(groups), on_}, effects_, X.subspan(l * rows, rows));
        report.lanes_converged += r.converged;
        report.relative_residual = std::max(report.relative_residual, r.relative_residual);
    }
    return report;
}

}  // namespace teres
