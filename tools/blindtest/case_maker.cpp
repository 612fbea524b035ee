#include "tools/blindtest/case_maker.h"

#include <glib.h>

#include <cmath>
#include <limits>

#include "core/case/case_writer.h"
#include "core/case/geometry.h"
#include "core/case/text_file.h"
#include "core/case/text_writer.h"

namespace teres::blindtest {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;
constexpr int kAttempts = 3, kVisibleAttempts = 12;
constexpr std::size_t kTrialFrames = 6;
constexpr double kFarLess = 0.7;                                         // of what must show
constexpr std::uint64_t kPatients = 6, kApart = std::uint64_t{1} << 32;  // of a given body; between their draws

Frames difference(const Frames& a, const Frames& b) {
    Frames d = a;
    for (std::size_t k = 0; k < d.size(); ++k)
        for (std::size_t m = 0; m < d[k].size(); ++m) d[k][m] = minus(a[k][m], b[k][m]);
    return d;
}

double inner(const Frames& a, const Frames& b) {
    double sum = 0.0;
    for (std::size_t k = 0; k < a.size(); ++k)
        for (std::size_t m = 0; m < a[k].size(); ++m) sum += dot(a[k][m], b[k][m]);
    return sum;
}

double rms(const Frames& a) {
    return std::sqrt(inner(a, a) / static_cast<double>(a.size() * a.front().size()));
}

std::vector<PositionSample> samples(const Frames& frames, std::span<const MarkerRest> ids, double dt_s) {
    std::vector<PositionSample> out;
    for (std::size_t k = 0; k < frames.size(); ++k)
        for (std::size_t m = 0; m < ids.size(); ++m)
            out.push_back({static_cast<double>(k) * dt_s, ids[m].id, frames[k][m]});
    return out;
}

// Noise, quantisation, single lost frames (1 %) and two outages.
Frames observe(const SensorState& state, const Case& nominal, Random& random) {
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
    Frames seen = state.seen;
    const Point view = *nominal.sensor.view_direction;
    for (auto& frame : seen)
        for (Point& p : frame) {
            for (double& x : p) x += state.noise_factor * nominal.sensor.noise_sigma_m * random.normal();
            if (state.depth_step_m > 0.0) {
                const double depth = dot(p, view);
                p = plus(p, times(state.depth_step_m * std::round(depth / state.depth_step_m) - depth, view));
            }
            for (double& x : p) x = std::round(1e6 * x) / 1e6;
            if (random.chance(0.01)) p = {kNan, kNan, kNan};
        }
    for (int outage = 0; outage < 2; ++outage) {
        const std::size_t marker = random.index(nominal.markers.size()), from = random.index(seen.size());
        for (std::size_t k = from; k < std::min(seen.size(), from + 6); ++k) seen[k][marker] = {kNan, kNan, kNan};
    }
    return seen;
}

// A solver's output ends with what went wrong.
std::string last_words(const std::string& text) {
    constexpr std::size_t kLength = 300;
    return text.substr(text.size() > kLength ? text.size() - kLength : 0);
}

Json to_json(const EffectTruth& truth) {
    const EffectKind& kind = *find_effect(truth.id);
    return {{"id", truth.id},
            {"kind", kind.kind},
            {"event", kind.event},
            {"center_m", truth.center_m ? Json(*truth.center_m) : Json(nullptr)},
            {"radius_m", truth.radius_m},
            {"onset_s", truth.onset_s ? Json(*truth.onset_s) : Json(nullptr)},
            {"markers", truth.markers},
            {"parameters", truth.parameters}};
}

}  // namespace

double unexplained_rms(const Frames& difference, const std::vector<Frames>& explained) {
    Frames rest = difference;
    std::vector<Frames> basis;  // Gram-Schmidt
    const auto subtract = [](Frames& from, double share, const Frames& what) {
        for (std::size_t k = 0; k < from.size(); ++k)
            for (std::size_t m = 0; m < from[k].size(); ++m) from[k][m] = minus(from[k][m], times(share, what[k][m]));
    };
    for (Frames column : explained) {
        const double before = rms(column);
        for (const Frames& b : basis) subtract(column, inner(b, column) / inner(b, b), b);
        if (rms(column) > 1e-6 * std::max(before, 1e-12) && before > 1e-9) basis.push_back(std::move(column));
    }
    for (const Frames& b : basis) subtract(rest, inner(b, rest) / inner(b, b), b);
    return rms(rest);
}

double shown_rms(std::size_t effect, const std::vector<Frames>& steps, const std::vector<Frames>& alone,
                 std::vector<Frames> explained) {
    for (std::size_t other = 0; other < steps.size(); ++other)
        if (other != effect) explained.push_back(steps[other]);
    return std::min(unexplained_rms(steps[effect], explained), unexplained_rms(alone[effect], explained));
}

Result<const CaseMaker::Patient*> CaseMaker::patient(const CaseSpec& spec) {
    const Key key{spec.draw, spec.clamped, spec.dynamic};
    auto found = patients_.find(key);
    if (found == patients_.end()) {
        if (!patients_.empty() && std::get<0>(patients_.begin()->first) != spec.draw) patients_.clear();
        auto made = make_patient(spec, 0);
        for (std::uint64_t k = 1; body_options.given && k < kPatients && !made; ++k) {
            if (made.error().kind != ErrorKind::kNotUsable) break;
            made = make_patient(spec, k);
        }
        found = patients_.emplace(key, std::move(made)).first;
    }
    if (!found->second) return tl::unexpected(found->second.error());
    return found->second->get();
}

Result<std::unique_ptr<CaseMaker::Patient>> CaseMaker::make_patient(const CaseSpec& spec, std::uint64_t number) const {
    BodyOptions options = body_options;
    options.seed = seed_;
    options.draw = spec.draw + number * kApart;
    options.clamped = spec.clamped;
    options.dynamic = spec.dynamic;
    TERES_TRY_ASSIGN(TruthBody body, TruthBody::make(options, scratch_));
    TERES_TRY_ASSIGN(Motion control, body.simulate(body.control(), scratch_, nullptr));
    std::vector<Motion> changes;
    Scenario stiffer = body.control(), shorter = body.control();
    stiffer.ligament.youngs_modulus_pa *= 1.3;
    if (shorter.band.size() > 2) shorter.band.pop_back();
    for (const Scenario& change : {stiffer, shorter}) {
        TERES_TRY_ASSIGN(Motion moved, body.simulate(change, scratch_, nullptr));
        changes.push_back(std::move(moved));
    }
    return std::make_unique<Patient>(Patient{std::move(body), std::move(control), std::move(changes)});
}

Result<CaseMaker::Outcome> CaseMaker::make(const CaseSpec& spec) {
    const fs::path label = out_ / "sealed" / spec.name / "label.json";
    if (fs::exists(label)) return Outcome::kWasThere;
    std::string reason;
    const auto who = patient(spec);
    if (!who && who.error().kind != ErrorKind::kNotUsable) return tl::unexpected(who.error());
    if (!who && body_options.given)  // all cases are of this patient
        return not_usable("seed " + std::to_string(seed_) + ": the undisturbed body has no solution for any of " +
                          std::to_string(kPatients) + " patients; see its loads. " + last_words(who.error().text));
    if (!who) reason = who.error().text;
    for (int attempt = 0; who && attempt < (least_gap_m > 0.0 ? kVisibleAttempts : kAttempts); ++attempt) {
        const Status made = make_once(spec, **who, attempt);
        if (made) return Outcome::kMade;
        if (made.error().kind != ErrorKind::kNotUsable) return tl::unexpected(made.error());
        reason = made.error().text;
    }
    fs::create_directories(label.parent_path());
    TERES_TRY(write_text_file(
        label,
        Json{{"case", spec.name}, {"discarded", true}, {"intended", spec.effects}, {"reason", last_words(reason)}}.dump(
            1) +
            "\n"));
    return Outcome::kDiscarded;
}

Status CaseMaker::try_few_frames(const std::string& id, const Scenario& scenario, const Patient& patient) const {
    const TruthBody& body = patient.body;
    if (least_gap_m <= 0.0 || body.options().dynamic || scenario.prony_ratio > 0.0) return {};
    std::vector<std::size_t> few;
    const std::size_t count = std::min(kTrialFrames, body.num_frames());
    for (std::size_t k = 1; k <= count; ++k) few.push_back(k * body.num_frames() / count - 1);
    const auto moved = body.simulate_at(scenario, few, scratch_, &patient.control);
    if (!moved) return {};  // all frames, in small steps, may have a solution
    const auto of_few = [&](const Frames& all) {
        Frames out;
        for (const std::size_t k : few) out.push_back(all[k]);
        return out;
    };
    const Frames control = of_few(patient.control.markers);
    std::vector<Frames> explained;
    for (const Motion& change : patient.ligament_changes)
        explained.push_back(difference(of_few(change.markers), control));
    const double shown_m = unexplained_rms(difference(moved->markers, control), explained);
    if (shown_m < kFarLess * least_gap_m)
        return not_usable(id + " shows " + std::to_string(1e3 * shown_m) + " mm at a few frames");
    return {};
}

Status CaseMaker::make_once(const CaseSpec& spec, const Patient& patient, int attempt) {
    Random random(seed_, {spec.draw, std::stoul(spec.name.substr(1)), static_cast<std::uint64_t>(attempt)});
    const TruthBody& body = patient.body;
    Scenario scenario = body.control();
    std::vector<EffectTruth> truths;
    std::vector<Frames> steps;  // what each effect adds to what the camera sees, ...
    std::vector<Frames> alone;  // ... and a sensor's would without the others
    Motion motion = patient.control;
    const bool single = spec.effects.size() == 1;  // before its onset a lone event is the control
    for (const std::string& id : spec.effects) {
        if (std::string(find_effect(id)->kind) == "sensor") continue;
        TERES_TRY_ASSIGN(EffectTruth truth, draw_mechanics(id, random, body, scenario, scratch_));
        truths.push_back(std::move(truth));
        const Frames before = motion.markers;
        if (single) TERES_TRY(try_few_frames(id, scenario, patient));
        TERES_TRY_ASSIGN(motion, body.simulate(scenario, scratch_, single ? &patient.control : nullptr));
        alone.push_back(steps.emplace_back(difference(motion.markers, before)));
    }
    SensorState sensor{motion.markers, 1.0, 0.0};
    for (const std::string& id : spec.effects)
        if (std::string(find_effect(id)->kind) == "sensor") {
            Random again = random;
            SensorState undisturbed{patient.control.markers, 1.0, 0.0};
            draw_sensor(id, again, body.nominal(), undisturbed);
            alone.push_back(difference(undisturbed.seen, patient.control.markers));
            const Frames before = sensor.seen;
            truths.push_back(draw_sensor(id, random, body.nominal(), sensor));
            steps.push_back(difference(sensor.seen, before));
        }

    Case nominal = body.nominal();
    nominal.name = spec.name;
    for (const PositionSample& sample : samples(observe(sensor, nominal, random), nominal.markers, nominal.dt_s))
        nominal.observations.push_back(sample);

    std::vector<Frames> explained;
    for (const Motion& change : patient.ligament_changes)
        explained.push_back(difference(change.markers, patient.control.markers));
    const Frames seen_gap = difference(sensor.seen, patient.control.markers);
    Json label{{"case", spec.name},       {"draw", spec.draw},       {"seed", seed_},
               {"clamped", spec.clamped}, {"dynamic", spec.dynamic}, {"effects", Json::array()}};
    for (std::size_t k = 0; k < truths.size(); ++k) {
        const double shown_m = shown_rms(k, steps, alone, explained);
        if (shown_m < least_gap_m && truths[k].id != "noise")
            return not_usable(truths[k].id + " shows " + std::to_string(1e3 * shown_m) + " mm");
        label["effects"].push_back(to_json(truths[k]));
        label["effects"].back()["gap_mm"] = 1e3 * shown_m;
    }
    Frames rest = patient.control.markers;
    for (auto& frame : rest)
        for (std::size_t m = 0; m < frame.size(); ++m) frame[m] = nominal.markers[m].position_m;
    label["gap_mm"] = {{"markers", 1e3 * rms(seen_gap)},
                       {"nominal", 1e3 * unexplained_rms(seen_gap, explained)},
                       {"points", 1e3 * rms(difference(motion.points, patient.control.points))}};
    label["motion_rms_mm"] = 1e3 * rms(difference(patient.control.markers, rest));
    label["noise_factor"] = sensor.noise_factor;
    label["body_law"] = static_cast<int>(body.control().body.law);
    label["ligament"] = {{"youngs_modulus_pa", body.true_band().youngs_modulus_pa}};
    if (body.options().given) {
        label["ligament"]["facet_centroids_m"] = body.control().band;
    } else {
        label["ligament"]["x0_m"] = body.true_band().x0_m;
        label["ligament"]["width_m"] = body.true_band().width_m;
        label["ligament"]["theta_deg"] = {body.true_band().theta0_deg, body.true_band().theta1_deg};
    }
    label["attempts"] = attempt + 1;

    const fs::path sealed = out_ / "sealed" / spec.name;
    std::error_code failed;
    fs::create_directories(sealed, failed);
    if (failed) return host_fault(sealed.string() + ": " + failed.message());
    TERES_TRY(write_case(nominal, out_ / "cases" / spec.name));
    TERES_TRY(write_positions(sealed / "validation.csv", "point_id",
                              samples(motion.points, nominal.validation_rest, nominal.dt_s)));
    TERES_TRY(
        write_positions(sealed / "markers.csv", "marker_id", samples(motion.markers, nominal.markers, nominal.dt_s)));
    return write_text_file(sealed / "label.json", label.dump(1) + "\n");
}

std::string sha256(const std::string& bytes) {
    char* text =
        g_compute_checksum_for_data(G_CHECKSUM_SHA256, reinterpret_cast<const guchar*>(bytes.data()), bytes.size());
    std::string hash = text;
    g_free(text);
    return hash;
}

Result<std::string> seal_list(const fs::path& out, std::span<const CaseSpec> cases) {
    std::string list;
    for (const CaseSpec& spec : cases)
        for (const char* name : {"label.json", "markers.csv", "validation.csv"}) {
            const fs::path file = fs::path("sealed") / spec.name / name;
            if (!fs::exists(out / file) && std::string(name) != "label.json") continue;  // discarded
            TERES_TRY_ASSIGN(const std::string text, read_text_file(out / file));
            list += sha256(text) + "  " + file.string() + "\n";
        }
    return list;
}

}  // namespace teres::blindtest
