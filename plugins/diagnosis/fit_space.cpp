#include "plugins/diagnosis/fit_space.h"

#include <algorithm>
#include <cmath>

namespace teres {
namespace {

constexpr double kStep = 0.02;       // finite-difference step, in prior standard deviations
constexpr double kSmallest = 1e-12;  // physical value of a logarithmic parameter at its null of zero

}  // namespace

FitSpace::FitSpace(const TrajectoryModel& mechanics, const EffectTable& effects, const Assumption& pattern)
    : mechanics_(mechanics), effects_(effects), num_theta_(static_cast<Eigen::Index>(mechanics.num_parameters())) {
    std::vector<double> mean, stdev;
    for (std::size_t i = 0; i < mechanics.num_parameters(); ++i) {
        const NominalParameter p = mechanics.parameter(i);
        axes_.push_back({true, p.lower, p.upper});
        mean.push_back(p.prior_log_mean);
        stdev.push_back(p.prior_log_stdev / std::sqrt(kLigamentPriorWeight));
    }
    for (const ActiveEffect& effect : pattern.effects) {
        first_.push_back(static_cast<Eigen::Index>(axes_.size()));
        entries_.push_back(effect.entry);
        const auto& parameters = effects[effect.entry].parameters;
        for (std::size_t k = 0; k < parameters.size(); ++k) {
            const EffectParameter& p = parameters[k];
            const bool chosen = p.role == EffectRole::kChoice;
            axes_.push_back({p.transform == EffectTransform::kLog, p.lower, p.upper, chosen});
            mean.push_back(chosen ? effect.values[k] : p.prior_mean);
            stdev.push_back(p.prior_stdev);
        }
    }
    mean_ = Eigen::Map<Eigen::VectorXd>(mean.data(), static_cast<Eigen::Index>(mean.size()));
    stdev_ = Eigen::Map<Eigen::VectorXd>(stdev.data(), static_cast<Eigen::Index>(stdev.size()));
}

Eigen::VectorXd FitSpace::coordinates(const Assumption& assumption) const {
    Eigen::VectorXd at(size());
    Eigen::Index row = 0;
    const auto put = [&](double value) {
        at(row) = axes_[static_cast<std::size_t>(row)].log ? std::log(std::max(value, kSmallest)) : value;
        ++row;
    };
    for (const double value : assumption.theta) put(value);
    for (const ActiveEffect& effect : assumption.effects)
        for (const double value : effect.values) put(value);
    return at;
}

Assumption FitSpace::assumption(const Eigen::VectorXd& coordinates) const {
    const auto physical = [&](Eigen::Index row) {
        const Axis& axis = axes_[static_cast<std::size_t>(row)];
        const double value = axis.log ? std::exp(std::min(coordinates(row), 700.0)) : coordinates(row);
        return std::clamp(value, axis.lower, axis.upper);
    };
    Assumption out;
    for (Eigen::Index i = 0; i < num_theta_; ++i) out.theta.push_back(physical(i));
    for (std::size_t k = 0; k < entries_.size(); ++k) {
        const Eigen::Index end = k + 1 < first_.size() ? first_[k + 1] : size();
        ActiveEffect effect{entries_[k], {}};
        for (Eigen::Index row = first_[k]; row < end; ++row) effect.values.push_back(physical(row));
        const EffectEntry& entry = effects_[effect.entry];
        if (!entry.sensor) mechanics_.settle_effect(entry.index, effect.values);
        out.effects.push_back(std::move(effect));
    }
    return out;
}

std::vector<Assumption> FitSpace::neighbours(const Eigen::VectorXd& at, Eigen::VectorXd& step) const {
    std::vector<Assumption> list;
    step.resize(size());
    for (Eigen::Index i = 0; i < size(); ++i) {
        const Axis& axis = axes_[static_cast<std::size_t>(i)];
        Eigen::VectorXd moved = at;
        step(i) = kStep * stdev_(i);
        if (!axis.fixed) moved(i) = at(i) + step(i);
        const double value = axis.log ? std::exp(moved(i)) : moved(i);
        if (value > axis.upper && !axis.fixed) {  // at the upper bound: look inwards
            step(i) = -step(i);
            moved(i) = at(i) + step(i);
        }
        list.push_back(assumption(moved));
    }
    return list;
}

}  // namespace teres
