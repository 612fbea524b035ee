// case.json: keys, types and ranges.
#include <array>
#include <cmath>
#include <utility>

#include "core/case/case_reader.h"
#include "core/case/json_fields.h"
#include "core/case/text_file.h"

namespace teres {
namespace {

using Bound = JsonFields::Bound;
constexpr Bound kModulus{0.0, 1e12, true};        // [Pa]
constexpr Bound kPoisson{-1.0, 0.5, true, true};  // incompressible (0.5) has no finite bulk modulus
constexpr Bound kCoordinate{-1e3, 1e3};           // [m]
constexpr double kGravityMax = 1e3;               // [m/s^2]

template <class Law, std::size_t N>
Result<Law> choose(JsonFields& json, const std::string& path, const std::array<std::pair<const char*, Law>, N>& laws) {
    TERES_TRY_ASSIGN(const std::string given, json.text(path));
    std::string known;
    for (const auto& [name, law] : laws) {
        if (given == name) return law;
        known += known.empty() ? "" : "|";
        known += name;
    }
    return json.error_at(path, in_quotes(given) + " is unknown, expected " + known);
}

// Small-strain behaviour of one-term Ogden: shear modulus G, bulk modulus K, so
//     E = 9 K G / (3 K + G),   nu = (3 K - 2 G) / (2 (3 K + G))
Status read_ogden(JsonFields& json, BodyData& body) {
    TERES_TRY_ASSIGN(body.shear_modulus_pa, json.number("body.shear_modulus_pa", kModulus));
    TERES_TRY_ASSIGN(body.bulk_modulus_pa, json.number("body.bulk_modulus_pa", kModulus));
    TERES_TRY_ASSIGN(body.alpha, json.number("body.alpha", {-100.0, 100.0}));
    if (body.alpha == 0.0) return json.error_at("body.alpha", "0 is not allowed: W has alpha^2 in its denominator");
    const double G = body.shear_modulus_pa, K = body.bulk_modulus_pa;
    const double E = 9.0 * K * G / (3.0 * K + G), nu = (3.0 * K - 2.0 * G) / (2.0 * (3.0 * K + G));
    TERES_TRY_ASSIGN(body.youngs_modulus_pa, json.number_or("body.youngs_modulus_pa", kModulus, E));
    TERES_TRY_ASSIGN(body.poissons_ratio, json.number_or("body.poissons_ratio", kPoisson, nu));
    // Given values may be rounded; beyond that they contradict G and K.
    if (std::abs(body.youngs_modulus_pa - E) > 0.02 * E)
        return json.error_at("body.youngs_modulus_pa",
                             to_text(body.youngs_modulus_pa) +
                                 " contradicts shear_modulus_pa and bulk_modulus_pa, which give " + to_text(E) +
                                 " (tolerance 2 %)");
    if (std::abs(body.poissons_ratio - nu) > 0.01)
        return json.error_at("body.poissons_ratio",
                             to_text(body.poissons_ratio) +
                                 " contradicts shear_modulus_pa and bulk_modulus_pa, which give " + to_text(nu) +
                                 " (tolerance 0.01)");
    return {};
}

Status read_body(JsonFields& json, BodyData& body) {
    constexpr std::array<std::pair<const char*, BodyLaw>, 4> kLaws{{{"stvk", BodyLaw::kStVK},
                                                                    {"corotational", BodyLaw::kCorotational},
                                                                    {"ogden", BodyLaw::kOgden},
                                                                    {"neo_hookean", BodyLaw::kNeoHookean}}};
    TERES_TRY_ASSIGN(body.law, choose(json, "body.law", kLaws));
    if (body.law == BodyLaw::kOgden) {
        TERES_TRY(read_ogden(json, body));
    } else {
        TERES_TRY_ASSIGN(body.youngs_modulus_pa, json.number("body.youngs_modulus_pa", kModulus));
        TERES_TRY_ASSIGN(body.poissons_ratio, json.number("body.poissons_ratio", kPoisson));
    }
    TERES_TRY_ASSIGN(body.density_kg_m3, json.number_or("body.density_kg_m3", {0.0, 1e5}, 0.0));
    TERES_TRY_ASSIGN(body.rayleigh_mass_1_s, json.number_or("body.rayleigh_mass_1_s", {0.0, 1e6}, 0.0));
    TERES_TRY_ASSIGN(body.rayleigh_stiffness_s, json.number_or("body.rayleigh_stiffness_s", {0.0, 1e3}, 0.0));
    TERES_TRY(json.text_or("body.note", ""));
    return {};
}

Status read_ligament(JsonFields& json, LigamentData& ligament) {
    constexpr std::array<std::pair<const char*, LigamentLaw>, 2> kLaws{
        {{"neo_hookean", LigamentLaw::kNeoHookean}, {"cubic_spring", LigamentLaw::kCubicSpring}}};
    TERES_TRY_ASSIGN(ligament.law, choose(json, "ligament.law", kLaws));
    TERES_TRY_ASSIGN(ligament.youngs_modulus_pa, json.number("ligament.youngs_modulus_pa", kModulus));
    TERES_TRY_ASSIGN(ligament.poissons_ratio, json.number("ligament.poissons_ratio", kPoisson));
    TERES_TRY_ASSIGN(ligament.height_m, json.number("ligament.height_m", {0.0, 1.0, true}));
    TERES_TRY_ASSIGN(ligament.width_m, json.number_or("ligament.width_m", {0.0, 1.0, true}, 0.0));
    TERES_TRY_ASSIGN(ligament.thickness_m, json.number_or("ligament.thickness_m", {0.0, 1.0, true}, 0.0));
    TERES_TRY(json.text_or("ligament.note", ""));
    return {};
}

double length(const Point& v) {
    return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

Status read_sensor(JsonFields& json, SensorData& sensor) {
    TERES_TRY_ASSIGN(sensor.noise_sigma_m, json.number("sensor.noise_sigma_m", {0.0, 1.0}));
    TERES_TRY_ASSIGN(sensor.latency_s, json.number_or("sensor.latency_s", {0.0, 60.0}, 0.0));
    const auto optional_point = [&](const std::string& path, std::optional<Point>& out) -> Status {
        if (!json.has(path)) return {};
        TERES_TRY_ASSIGN(out, json.point(path, kCoordinate));
        return {};
    };
    TERES_TRY(optional_point("sensor.camera_position_m", sensor.camera_position_m));
    TERES_TRY(optional_point("sensor.view_direction", sensor.view_direction));
    TERES_TRY(optional_point("sensor.up", sensor.up));
    if (sensor.view_direction && length(*sensor.view_direction) < 1e-9)
        return json.error_at("sensor.view_direction", "has no length");
    if (sensor.up && length(*sensor.up) < 1e-9) return json.error_at("sensor.up", "has no length");
    TERES_TRY(json.text_or("sensor.note", ""));
    return {};
}

}  // namespace

Status parse_case_json(std::string_view text, const std::string& name, Case& out) {
    TERES_TRY_ASSIGN(JsonFields json, JsonFields::parse(text, name));
    TERES_TRY_ASSIGN(const std::string format, json.text("format"));
    if (format != "teres-case-1")
        return json.error_at("format", in_quotes(format) + " is unknown, expected teres-case-1");
    TERES_TRY_ASSIGN(out.name, json.text("name"));
    TERES_TRY_ASSIGN(out.frame, json.text_or("frame", ""));
    TERES_TRY(json.text_or("note", ""));
    TERES_TRY_ASSIGN(out.stream, json.text_or("stream", ""));
    TERES_TRY_ASSIGN(out.num_frames, json.integer("time.frames", 1, 100'000'000));
    TERES_TRY_ASSIGN(out.dt_s, json.number("time.dt_s", {0.0, 1e6, true}));
    TERES_TRY_ASSIGN(out.quasi_static, json.boolean("time.quasi_static"));
    TERES_TRY(read_body(json, out.body));
    if (json.has("ligament")) {
        out.ligament.emplace();
        TERES_TRY(read_ligament(json, *out.ligament));
    }
    if (json.has("gravity_m_s2")) {
        TERES_TRY_ASSIGN(out.gravity_m_s2, json.point("gravity_m_s2", {-kGravityMax, kGravityMax}));
    }
    TERES_TRY(read_sensor(json, out.sensor));
    TERES_TRY(json.no_unknown_keys());
    const bool needs_density = !out.quasi_static || length(out.gravity_m_s2) > 0.0;
    if (needs_density && out.body.density_kg_m3 <= 0.0)
        return json.error_at("body.density_kg_m3", "must be above 0: the case has gravity or is not quasi-static");
    return {};
}

}  // namespace teres
