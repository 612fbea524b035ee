#include "plugins/diagnosis/effect_table.h"

#include <algorithm>
#include <cmath>

namespace teres {
namespace {

constexpr double kLeastShare = 0.05;     // of a parameter that cannot be zero
constexpr double kFirstPart = 0.1;       // of a recording: begun in it is begun before, ended in the last not ended
constexpr double kSteadyPeriods = 0.25;  // in a recording: slower is steady
constexpr double kFoot = 0.25;           // of the ligaments: a cut around as much of them lets them go

bool has_place(const EffectEntry& entry) {
    return std::any_of(entry.parameters.begin(), entry.parameters.end(),
                       [](const EffectParameter& p) { return std::string_view(p.name) == "center_x"; });
}

}  // namespace

bool EffectEntry::local_support() const {
    return support() && !info.event && has_place(*this);
}

bool EffectEntry::exact_form() const {
    return sensor || (std::string_view(info.kind) == "load" &&
                      std::none_of(parameters.begin(), parameters.end(),
                                   [](const auto& p) { return p.role == EffectRole::kShape; }));
}

std::optional<std::size_t> parameter_of(const EffectEntry& entry, std::string_view name) {
    for (std::size_t p = 0; p < entry.parameters.size(); ++p)
        if (name == entry.parameters[p].name) return p;
    return std::nullopt;
}

const double* value_of(const EffectEntry& entry, const ActiveEffect& effect, std::string_view name) {
    const auto p = parameter_of(entry, name);
    return p ? &effect.values[*p] : nullptr;
}

std::optional<Eigen::Vector3d> vector_of(const EffectEntry& entry, const ActiveEffect& effect,
                                         const std::string& name) {
    const double *x = value_of(entry, effect, name + "_x"), *y = value_of(entry, effect, name + "_y"),
                 *z = value_of(entry, effect, name + "_z");
    if (x == nullptr || y == nullptr || z == nullptr) return std::nullopt;
    return Eigen::Vector3d(*x, *y, *z);
}

std::optional<Eigen::Vector3d> centre_of(const EffectEntry& entry, const ActiveEffect& effect) {
    return vector_of(entry, effect, "center");
}

double at_share(const EffectParameter& parameter, double candidate, double share) {
    const double null = parameter.null_value;
    if (parameter.transform != EffectTransform::kLog) return null + share * (candidate - null);
    if (null > 0.0) return null * std::pow(candidate / null, share);
    return std::max(share, kLeastShare) * candidate;
}

EffectTable::EffectTable(const TrajectoryModel& mechanics, const ObservationModel* sensors,
                         std::span<const char* const> excluded)
    : mechanics_(mechanics), sensors_(sensors) {
    const auto add = [&](const EffectCatalogue& from, bool sensor) {
        for (std::size_t e = 0; e < from.num_effects(); ++e) {
            EffectEntry entry{sensor, e, from.effect(e), {}, false};
            for (std::int32_t p = 0; p < entry.info.num_parameters; ++p)
                entry.parameters.push_back(from.effect_parameter(e, static_cast<std::size_t>(p)));
            for (const char* id : excluded) entry.excluded = entry.excluded || std::string_view(id) == entry.info.id;
            entries_.push_back(std::move(entry));
        }
    };
    add(mechanics, false);
    if (sensors != nullptr) add(*sensors, true);

    std::vector<double> share(mechanics.num_nodes()), x(3 * share.size());
    if (share.empty() || !mechanics.ligament_shares(share)) return;
    mechanics.rest_positions(x);
    for (std::size_t i = 0; i < share.size(); ++i)
        if (share[i] > 0.0) ligaments_.push_back({Eigen::Vector3d::Map(&x[3 * i]), share[i]});
}

std::size_t EffectTable::find(std::string_view id) const {
    for (std::size_t e = 0; e < entries_.size(); ++e)
        if (id == entries_[e].info.id) return e;
    return size();
}

const EffectCatalogue& EffectTable::catalogue(const EffectEntry& entry) const {
    if (entry.sensor) return *sensors_;
    return mechanics_;
}

ActiveEffect EffectTable::candidate(std::size_t entry, std::size_t index) const {
    ActiveEffect effect{entry, std::vector<double>(entries_[entry].parameters.size())};
    catalogue(entries_[entry]).effect_candidate(entries_[entry].index, index, effect.values);
    return effect;
}

ActiveEffect EffectTable::single(const ActiveEffect& from, std::size_t amplitude) const {
    ActiveEffect effect = from;
    std::size_t count = 0;
    const auto& parameters = entries_[from.entry].parameters;
    for (std::size_t p = 0; p < parameters.size(); ++p)
        if (parameters[p].role == EffectRole::kAmplitude && count++ != amplitude)
            effect.values[p] = parameters[p].null_value;
    return effect;
}

std::size_t EffectTable::num_amplitudes(std::size_t entry) const {
    const auto& parameters = entries_[entry].parameters;
    return static_cast<std::size_t>(std::count_if(parameters.begin(), parameters.end(),
                                                  [](const auto& p) { return p.role == EffectRole::kAmplitude; }));
}

bool EffectTable::happens(const ActiveEffect& effect) const {
    const EffectEntry& entry = entries_[effect.entry];
    if (!entry.info.event || mechanics_.num_frames() == 0) return false;
    const double *onset = value_of(entry, effect, "onset"), start = mechanics_.time_s(0),
                 end = mechanics_.time_s(mechanics_.num_frames() - 1);
    return onset == nullptr || *onset > start + kFirstPart * (end - start);
}

std::optional<ActiveEffect> EffectTable::complement(const ActiveEffect& effect) const {
    const EffectEntry& entry = entries_[effect.entry];
    const double *onset = value_of(entry, effect, "onset"), *end = value_of(entry, effect, "end"),
                 *rise = value_of(entry, effect, "rise"), *frequency = value_of(entry, effect, "frequency");
    if (std::string_view(entry.info.kind) != "load" || onset == nullptr || end == nullptr ||
        mechanics_.num_frames() == 0)
        return std::nullopt;
    const double first = mechanics_.time_s(0), last = mechanics_.time_s(mechanics_.num_frames() - 1),
                 part = kFirstPart * (last - first);
    if (frequency != nullptr && *frequency * (last - first) > kSteadyPeriods) return std::nullopt;
    const auto inside = [&](double t) { return t > first + part && t < last - part; };
    const bool begins = inside(*onset), ends = inside(*end);
    if (begins == ends) return std::nullopt;
    // About the middle of its edge, as fast as is usual: a slow edge may be the compromise of a fit without the rest.
    ActiveEffect out = effect;
    double later = 0.0;
    for (std::size_t p = 0; rise != nullptr && p < entry.parameters.size(); ++p)
        if (std::string_view(entry.parameters[p].name) == "rise") {
            out.values[p] = std::exp(entry.parameters[p].prior_mean);
            later = 0.5 * (*rise - out.values[p]);
        }
    for (std::size_t p = 0; p < entry.parameters.size(); ++p) {
        const EffectParameter& parameter = entry.parameters[p];
        const std::string_view name = parameter.name;
        double& value = out.values[p];
        if (parameter.role == EffectRole::kAmplitude) value = 2.0 * parameter.null_value - value;
        if (name == "onset") value = begins ? first - (last - first) : *end + later;
        if (name == "end") value = begins ? *onset + later : last + (last - first);
        value = std::clamp(value, parameter.lower, parameter.upper);
    }
    return out;
}

double EffectTable::ligament_share(const ActiveEffect& effect) const {
    const EffectEntry& entry = entries_[effect.entry];
    const auto centre = centre_of(entry, effect);
    const double* radius = value_of(entry, effect, "radius");
    double share = 0.0;
    if (centre && radius != nullptr)
        for (const Held& held : ligaments_)
            if ((held.at_m - *centre).norm() < *radius) share += held.share;
    return share;
}

bool EffectTable::lets_go(const ActiveEffect& effect) const {
    return entries_[effect.entry].parts() && ligament_share(effect) >= kFoot;
}

bool EffectTable::rough_form(const ActiveEffect& effect) const {
    const EffectEntry& entry = entries_[effect.entry];
    return entry.local_support() || (entry.parts() && has_place(entry) && !lets_go(effect));
}

}  // namespace teres
