#include "tools/blindtest/plan.h"

#include <algorithm>
#include <cstdio>

#include "tools/blindtest/effect_draws.h"
#include "tools/blindtest/random.h"

namespace teres::blindtest {
namespace {

bool can_show(const std::optional<PlanOptions::Given>& given, const EffectKind& kind) {
    if (!given) return true;
    const bool of_ligament =
        std::string(kind.family) == "ligament state" || kind.id == std::string("moving_attachment");
    return (!kind.needs_clamp || given->clamped) && (!kind.needs_dynamics || given->dynamic) &&
           (!of_ligament || given->ligament);
}

// All cases of a given body are of the one patient.
void set_patient(const PlanOptions::Given& given, CaseSpec& spec) {
    spec.draw = 0;
    spec.clamped = given.clamped;
    spec.dynamic = given.dynamic;
}

// A draw holds every effect once and three controls: both kinds of support and a dynamic one.
std::vector<CaseSpec> cases_of_draw(const PlanOptions& options, std::uint64_t draw) {
    Random random(options.seed, {draw, 991});
    const bool clamped = random.chance(0.5);
    std::vector<std::string> effects = options.effects;
    if (effects.empty()) {
        for (const EffectKind& kind : effect_kinds()) effects.emplace_back(kind.id);
        effects.insert(effects.end(), {"none", "none", "none"});
    }
    std::erase_if(effects,
                  [&](const std::string& id) { return id != "none" && !can_show(options.given, *find_effect(id)); });
    std::vector<CaseSpec> cases;
    int controls = 0;
    for (const std::string& id : effects) {
        CaseSpec spec{"", draw, {}, clamped, false};
        if (id == "none") {
            spec.dynamic = controls == 2;
            spec.clamped = spec.dynamic || clamped != (controls == 1);
            ++controls;
        } else {
            const EffectKind& kind = *find_effect(id);
            spec.effects = {id};
            spec.dynamic = kind.needs_dynamics;
            spec.clamped = clamped || kind.needs_clamp || kind.needs_dynamics;
        }
        if (options.given) set_patient(*options.given, spec);
        cases.push_back(std::move(spec));
    }
    random.shuffle(cases);
    return cases;
}

// Two static effects of different families, at most one event.
CaseSpec two_cause_case(const PlanOptions& options, int number) {
    Random random(options.seed, {static_cast<std::uint64_t>(number), 992});
    const auto& kinds = effect_kinds();
    for (;;) {
        const EffectKind &a = kinds[random.index(kinds.size())], &b = kinds[random.index(kinds.size())];
        const auto in_list = [&](const EffectKind& kind) {
            return options.effects.empty() || std::count(options.effects.begin(), options.effects.end(), kind.id) != 0;
        };
        const bool restricted = options.effects.size() > 2;
        if ((restricted && (!in_list(a) || !in_list(b))) || std::string(a.family) == b.family) continue;
        if (!can_show(options.given, a) || !can_show(options.given, b) || (a.event && b.event)) continue;
        if (!options.given && (a.needs_dynamics || b.needs_dynamics)) continue;
        CaseSpec spec{"", static_cast<std::uint64_t>(number), {a.id, b.id}, random.chance(0.5), false};
        spec.clamped = spec.clamped || a.needs_clamp || b.needs_clamp;
        if (options.given) set_patient(*options.given, spec);
        return spec;
    }
}

}  // namespace

Result<std::vector<CaseSpec>> plan_cases(const PlanOptions& options) {
    if (options.cases < 0 || options.two_causes < 0 || options.cases + options.two_causes < 1)
        return invalid_input("--cases " + std::to_string(options.cases) + " --two-causes " +
                             std::to_string(options.two_causes) + ": at least one case is needed");
    if (options.shards < 1 || options.shard < 0 || options.shard >= options.shards)
        return invalid_input("--shard " + std::to_string(options.shard) + "/" + std::to_string(options.shards) +
                             ": must be i/n with 0 <= i < n");
    for (const std::string& id : options.effects)
        if (id != "none" && find_effect(id) == nullptr) return invalid_input("--effects: '" + id + "' is no effect");
    std::vector<CaseSpec> all;
    for (std::uint64_t draw = 0; static_cast<int>(all.size()) < options.cases; ++draw) {
        std::vector<CaseSpec> drawn = cases_of_draw(options, draw);
        if (drawn.empty()) return invalid_input("--effects: the given body can show none of them");
        for (CaseSpec& spec : drawn)
            if (static_cast<int>(all.size()) < options.cases) all.push_back(std::move(spec));
    }
    for (int i = 0; i < options.two_causes; ++i) all.push_back(two_cause_case(options, i));
    for (std::size_t i = 0; i < all.size(); ++i) {
        char name[24];
        std::snprintf(name, sizeof name, "c%04zu", i);
        all[i].name = name;
    }
    if (options.quasi_static) std::erase_if(all, [](const CaseSpec& spec) { return spec.dynamic; });
    const std::size_t n = all.size(), shards = static_cast<std::size_t>(options.shards),
                      shard = static_cast<std::size_t>(options.shard);
    return std::vector<CaseSpec>(all.begin() + static_cast<std::ptrdiff_t>(n * shard / shards),
                                 all.begin() + static_cast<std::ptrdiff_t>(n * (shard + 1) / shards));
}

}  // namespace teres::blindtest
