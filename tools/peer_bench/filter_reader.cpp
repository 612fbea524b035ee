// filter_settings.json: filter, sigma points, prior, transform, and which part of the model each parameter
// changes.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/case/text_file.h"
#include "tools/peer_bench/scene_reader.h"

namespace teres::peer {

namespace {

constexpr double kHuge = 1e300;

// All runs of digits: "s0_a1" -> 0, 1.
std::vector<long> numbers_in(const std::string& name) {
    std::vector<long> out;
    for (std::size_t i = 0; i < name.size();) {
        if (!std::isdigit(static_cast<unsigned char>(name[i]))) {
            ++i;
            continue;
        }
        std::size_t end = i;
        while (end < name.size() && std::isdigit(static_cast<unsigned char>(name[end]))) ++end;
        out.push_back(end - i <= 6 ? std::stol(name.substr(i, end - i)) : -1);
        i = end;
    }
    return out;
}

// Springs that share a parameter: one group per spring unless springs.csv has groups; groups in order of
// appearance.
struct SpringGroup {
    std::string name;
    std::vector<std::size_t> springs;
};
std::vector<SpringGroup> spring_groups(const SpringTable& table) {
    std::vector<SpringGroup> groups;
    for (std::size_t s = 0; s < table.springs.size(); ++s) {
        const std::string name = table.group.empty() ? std::to_string(s) : table.group[s];
        auto at = std::find_if(groups.begin(), groups.end(), [&](const SpringGroup& g) { return g.name == name; });
        if (at == groups.end()) at = groups.insert(groups.end(), SpringGroup{name, {}});
        at->springs.push_back(s);
    }
    return groups;
}

// Targets of the parameters in `wanted` (indices into names) among the spring coefficients.
Status assign_springs(const std::vector<std::size_t>& wanted, const JsonObject& settings, Scene& scene) {
    const JsonObject::Keys keys = {"param_order", "parameters", "parameter_order"};
    FilterSettings& filter = scene.filter;
    if (!scene.springs)
        return settings.error(
            keys, in_quotes(filter.names[wanted.front()]) + " names no modulus, and the scene has no springs");
    const auto groups = spring_groups(*scene.springs);
    const std::size_t per_spring = scene.springs->num_coefficients;
    const auto set = [&](std::size_t parameter, std::size_t group, std::size_t coefficient) {
        filter.targets[parameter] = {ParameterTarget::Kind::kSpring, {}, groups[group].springs, coefficient};
    };
    // 1. The name of a group itself (one coefficient each).
    std::size_t named = 0;
    if (per_spring == 1 && !scene.springs->group.empty())
        for (const auto p : wanted)
            for (std::size_t g = 0; g < groups.size(); ++g)
                if (groups[g].name == filter.names[p]) {
                    set(p, g, 0);
                    ++named;
                }
    if (named == wanted.size()) return {};
    if (named > 0) return settings.error(keys, "some names are groups of springs.csv, others are not");
    // 2. Numbers in the names: spring, or spring and coefficient; counted from 0 or, without a 0, from 1.
    const std::size_t levels = per_spring == 1 ? 1 : 2;
    std::vector<std::vector<long>> numbers;
    for (const auto p : wanted) numbers.push_back(numbers_in(filter.names[p]));
    const bool numbered =
        std::all_of(numbers.begin(), numbers.end(), [&](const auto& n) { return n.size() == levels; });
    std::vector<bool> taken(groups.size() * per_spring, false);
    if (numbered) {
        long first_spring = 1, first_coefficient = 1;
        for (const auto& n : numbers) {
            first_spring = std::min(first_spring, n[0]);
            if (levels == 2) first_coefficient = std::min(first_coefficient, n[1]);
        }
        for (std::size_t i = 0; i < wanted.size(); ++i) {
            const long group = numbers[i][0] - first_spring,
                       coefficient = levels == 2 ? numbers[i][1] - first_coefficient : 0;
            const bool known = group >= 0 && static_cast<std::size_t>(group) < groups.size() && coefficient >= 0 &&
                               static_cast<std::size_t>(coefficient) < per_spring;
            const auto slot = static_cast<std::size_t>(group) * per_spring + static_cast<std::size_t>(coefficient);
            if (!known || taken[slot])
                return settings.error(keys, in_quotes(filter.names[wanted[i]]) + " fits none of the " +
                                                std::to_string(groups.size()) + " springs or groups with " +
                                                std::to_string(per_spring) + " coefficient(s) each");
            taken[slot] = true;
            set(wanted[i], static_cast<std::size_t>(group), static_cast<std::size_t>(coefficient));
        }
        return {};
    }
    // 3. By order, when there are as many names as coefficients.
    if (wanted.size() == groups.size() * per_spring) {
        scene.warnings.push_back(settings.place(keys) +
                                 ": the names carry no numbers; taken in the order of springs.csv");
        for (std::size_t i = 0; i < wanted.size(); ++i) set(wanted[i], i / per_spring, i % per_spring);
        return {};
    }
    return settings.error(keys, std::to_string(wanted.size()) +
                                    " parameters fit neither names, numbers nor count of the " +
                                    std::to_string(groups.size()) + " springs or groups");
}

Status assign_targets(const JsonObject& settings, Scene& scene) {
    FilterSettings& filter = scene.filter;
    filter.targets.resize(filter.names.size());
    std::vector<std::size_t> left;
    for (std::size_t p = 0; p < filter.names.size(); ++p) {
        ParameterTarget target;
        const std::string name = plain(filter.names[p]);
        if (scene.modulus_names.empty()) {
            if (name == "e" || name.rfind("young", 0) == 0 || name.rfind("modulus", 0) == 0) target.regions = {0};
        } else {
            for (std::size_t r = 0; r < scene.modulus_names.size(); ++r)
                if (scene.modulus_names[r] == filter.names[p]) target.regions = {r};
        }
        if (target.regions.empty())
            left.push_back(p);
        else
            filter.targets[p] = target;
    }
    // Moduli under other names, when nothing else could be meant.
    if (left.size() == filter.names.size() && !scene.springs && scene.modulus_pa.size() == left.size()) {
        scene.warnings.push_back(settings.place({"param_order"}) +
                                 ": not the names of scene.json; taken in region order");
        for (const auto p : left) filter.targets[p].regions = {p};
        left.clear();
    }
    return left.empty() ? Status{} : assign_springs(left, settings, scene);
}

Status read_transforms(const JsonObject& settings, FilterSettings& filter) {
    const JsonObject::Keys keys = {"transform", "transforms", "transform_params"};
    const auto count = filter.names.size();
    std::vector<std::string> texts(count, "none");
    if (settings.has(keys)) {
        TERES_TRY_ASSIGN(texts, settings.texts(keys));
        if (texts.size() == 1) texts.assign(count, texts.front());
        if (texts.size() != count) return settings.error(keys, "is not one transform or one per parameter");
    } else if (!settings.json().contains("transform")) {
        return settings.error(keys, "is missing");
    }
    for (const auto& text : texts) {
        const std::string name = plain(text);
        Transform transform = Transform::kNone;
        if (name == "none" || name == "identity")
            transform = Transform::kNone;
        else if (name.rfind("abs", 0) == 0)
            transform = Transform::kAbsolute;
        else if (name.rfind("project", 0) == 0 || name.rfind("clamp", 0) == 0)
            transform = Transform::kProject;
        else if (name.rfind("sigmoid", 0) == 0 || name.rfind("logit", 0) == 0)
            transform = Transform::kScaledSigmoid;
        else if (name.rfind("exp", 0) == 0 || name == "log")
            transform = Transform::kLog;
        else
            return settings.error(keys, in_quotes(text) + " is not none, absolute, project, sigmoid or exponential");
        filter.transform.push_back(transform);
    }
    return {};
}

Status read_prior(const JsonObject& settings, FilterSettings& filter) {
    const auto p = static_cast<Eigen::Index>(filter.names.size());
    const JsonObject::Keys mean = {"initial_mean", "mean"}, stdev = {"initial_stdev", "stdev"};
    TERES_TRY_ASSIGN(filter.mean, settings.numbers(mean, p));
    TERES_TRY_ASSIGN(filter.stdev, settings.numbers(stdev, p));
    filter.lower = Eigen::VectorXd::Constant(p, -std::numeric_limits<double>::infinity());
    filter.upper = -filter.lower;
    const JsonObject::Keys min = {"min", "lower", "minimum"}, max = {"max", "upper", "maximum"};
    if (settings.has(min)) {
        TERES_TRY_ASSIGN(filter.lower, settings.numbers(min, p));
    }
    if (settings.has(max)) {
        TERES_TRY_ASSIGN(filter.upper, settings.numbers(max, p));
    }
    filter.filter_stdev.assign(filter.names.size(), 0.0);
    for (Eigen::Index i = 0; i < p; ++i) {
        const auto at = static_cast<std::size_t>(i);
        if (!(filter.stdev(i) > 0.0)) return settings.error(stdev, to_text(filter.stdev(i)) + " is not above 0");
        const Transform transform = filter.transform[at];
        const bool bounded = transform == Transform::kProject || transform == Transform::kScaledSigmoid;
        if (bounded &&
            !(std::isfinite(filter.lower(i)) && std::isfinite(filter.upper(i)) && filter.lower(i) < filter.upper(i)))
            return settings.error(min, "the transform of " + filter.names[at] + " needs min < max");
        if (!bounded) {  // the peer's bounds act in project and sigmoid only
            filter.lower(i) = -std::numeric_limits<double>::infinity();
            filter.upper(i) = -filter.lower(i);
        }
        if (transform == Transform::kLog) {  // the peer's convention: the filter's sigma is ln(stdev)
            if (!(filter.stdev(i) > 1.0))
                return settings.error(
                    stdev, to_text(filter.stdev(i)) + ": exponential takes ln(stdev), so it must be above 1");
            filter.filter_stdev[at] = std::log(filter.stdev(i));
        }
    }
    return {};
}

Status read_sigma_points(const JsonObject& settings, FilterSettings& filter) {
    const JsonObject::Keys keys = {"sigma_points", "sigma_point_topology", "topology"};
    TERES_TRY_ASSIGN(const std::string text, settings.text(keys));
    const std::string name = plain(text);
    if (name.rfind("simplex", 0) == 0)
        filter.points = SigmaPointKind::kSimplex;
    else if (name.rfind("star", 0) == 0)
        filter.points = SigmaPointKind::kStarConstantWeight;
    else
        return settings.error(keys, in_quotes(text) + " is neither simplex nor star");
    TERES_TRY_ASSIGN(filter.star_lambda, settings.number_or({"lambda", "lambda_scale", "star_lambda"}, 0.0, 1e6, 1.0));
    if (settings.has({"weights"})) {
        TERES_TRY_ASSIGN(std::string weights, settings.text({"weights"}));
        weights.erase(std::remove(weights.begin(), weights.end(), ' '), weights.end());
        const bool simplex = filter.points == SigmaPointKind::kSimplex;
        const bool known =
            simplex
                ? weights == "1/(p+1)" || weights == "1/r" || plain(weights) == "equal" || plain(weights) == "constant"
                : weights == "1/(2(p+lambda))" || weights == "1/(2*(p+lambda))" || plain(weights) == "constant";
        if (!known)
            return settings.error({"weights"},
                                  in_quotes(weights) + " is not " + (simplex ? "1/(p+1)" : "1/(2(p+lambda))"));
    }
    TERES_TRY_ASSIGN(filter.unbiased_variance,
                     settings.boolean_or({"unbiased_variance", "use_unbiased_variance", "useUnbiasedVariance"}, false));
    if (filter.unbiased_variance) {
        if (filter.kind != FilterKind::kRoUkf || filter.points != SigmaPointKind::kSimplex)
            return settings.error({"unbiased_variance", "use_unbiased_variance", "useUnbiasedVariance"},
                                  "true is supported for ROUKF with simplex points only");
        filter.points = SigmaPointKind::kSimplexMixedWeights;
    }
    return {};
}

}  // namespace

Status read_filter_settings(const std::string& file, Scene& scene) {
    const auto path = scene.folder / file;
    TERES_TRY_ASSIGN(const Json json, JsonObject::parse_file(path));
    const JsonObject settings(&json, path.string());
    FilterSettings& filter = scene.filter;

    const JsonObject::Keys kind_keys = {"filter", "kind", "type"};
    TERES_TRY_ASSIGN(const std::string kind, settings.text(kind_keys));
    const std::string name = plain(kind);
    if (name.find("rouk") != std::string::npos || name.find("reducedorder") != std::string::npos)
        filter.kind = FilterKind::kRoUkf;
    else if (name.find("simcorr") != std::string::npos ||
             (name.find("ukf") != std::string::npos && name.find("parameter") != std::string::npos))
        filter.kind = FilterKind::kUkfParameters;
    else
        return settings.error(kind_keys, in_quotes(kind) + " is neither ROUKF nor UKF parameters only (SimCorr)");

    TERES_TRY_ASSIGN(filter.names, settings.texts({"param_order", "parameters", "parameter_order"}));
    if (filter.names.empty()) return settings.error({"param_order"}, "names no parameter");
    for (std::size_t i = 0; i < filter.names.size(); ++i)
        if (std::count(filter.names.begin(), filter.names.end(), filter.names[i]) > 1)
            return settings.error({"param_order"}, in_quotes(filter.names[i]) + " stands twice");
    TERES_TRY(assign_targets(settings, scene));
    TERES_TRY(read_transforms(settings, filter));
    TERES_TRY(read_prior(settings, filter));
    TERES_TRY(read_sigma_points(settings, filter));
    TERES_TRY_ASSIGN(filter.observation_stdev_m,
                     settings.number({"observation_stdev_m", "observation_stdev"}, 1e-15, 1e6));

    const bool reduced = filter.kind == FilterKind::kRoUkf;
    TERES_TRY_ASSIGN(const bool positions, settings.boolean_or({"positions_in_state"}, reduced));
    if (positions != reduced)
        return settings.error({"positions_in_state"},
                              std::string(positions ? "true" : "false") + " does not go with " + in_quotes(kind));
    TERES_TRY_ASSIGN(filter.velocities_in_state, settings.boolean_or({"velocities_in_state"}, false));
    if (filter.velocities_in_state && !reduced)
        return settings.error({"velocities_in_state"}, "true does not go with " + in_quotes(kind));
    if (settings.has({"process_noise", "process_noise_stdev"})) {
        TERES_TRY_ASSIGN(filter.process_noise_stdev, settings.numbers({"process_noise", "process_noise_stdev"},
                                                                      static_cast<Eigen::Index>(filter.names.size())));
        if (filter.process_noise_stdev.minCoeff() < 0.0) return settings.error({"process_noise"}, "is negative");
        if (filter.process_noise_stdev.isZero()) filter.process_noise_stdev.resize(0);
    }
    TERES_TRY_ASSIGN(const double added,
                     settings.number_or({"observation_noise_added", "noise_stdev"}, 0.0, kHuge, 0.0));
    if (added != 0.0 && !scene.recording.stored)
        return settings.error(
            {"observation_noise_added"},
            to_text(added) + ": the noise of the recorded run cannot be made again; only 0 or stored observations");
    TERES_TRY_ASSIGN(const double dt, settings.number_or({"dt", "dt_s"}, 0.0, 1e6, scene.filter_run.dt_s));
    if (std::abs(dt - scene.filter_run.dt_s) > 1e-12 * scene.filter_run.dt_s)
        return settings.error({"dt", "dt_s"},
                              to_text(dt) + " is not the dt_s of scene.json, " + to_text(scene.filter_run.dt_s));
    settings.has({"steps_compared"});  // scene.json's compared_rows rules
    settings.report_unknown(scene.warnings);
    return {};
}

}  // namespace teres::peer
