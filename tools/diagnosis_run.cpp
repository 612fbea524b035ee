#include "tools/diagnosis_run.h"

#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <unordered_map>

#include "core/case/case_reader.h"
#include "core/case/frame_times.h"
#include "core/case/geometry.h"
#include "core/case/mesh_checks.h"

namespace teres::tools {
namespace {

// FNV-1a over the values that make two models equal.
class Hash {
  public:
    void add(double value) {
        std::uint64_t bits = 0;
        std::memcpy(&bits, &value, sizeof bits);
        for (int byte = 0; byte < 8; ++byte) value_ = (value_ ^ ((bits >> (8 * byte)) & 0xff)) * 1099511628211ULL;
    }
    void add(const Point& p) {
        for (const double v : p) add(v);
    }
    void add(const std::string& text) {
        for (const char c : text) add(static_cast<double>(c));
    }
    std::uint64_t value() const { return value_; }

  private:
    std::uint64_t value_ = 14695981039346656037ULL;
};

// What makes it the same body: mesh, law, supports.
std::uint64_t body_hash(const Case& c) {
    Hash hash;
    for (const Point& p : c.mesh.nodes) hash.add(p);
    for (const auto& tet : c.mesh.tets)
        for (const std::int32_t n : tet) hash.add(n);
    const BodyData& b = c.body;
    for (const double v : {static_cast<double>(b.law), b.youngs_modulus_pa, b.poissons_ratio, b.shear_modulus_pa,
                           b.alpha, b.bulk_modulus_pa, b.density_kg_m3, b.rayleigh_mass_1_s, b.rayleigh_stiffness_s})
        hash.add(v);
    for (const std::int32_t n : c.clamped) hash.add(n);
    for (const auto& p : c.ligament_prior) {
        hash.add(p.node_id);
        hash.add(p.probability);
    }
    if (c.ligament)
        for (const double v : {c.ligament->youngs_modulus_pa, c.ligament->poissons_ratio, c.ligament->height_m,
                               c.ligament->width_m, c.ligament->thickness_m})
            hash.add(v);
    for (const auto& s : c.springs) {
        hash.add(s.node_id);
        hash.add(s.anchor_m);
        for (const double k : s.k) hash.add(k);
    }
    return hash.value();
}

// The same and what is simulated with it: loads, tools, gravity, time, markers, settings.
std::uint64_t simulation_hash(const Case& c, const std::vector<double>& times, const std::string& settings) {
    Hash hash;
    hash.add(static_cast<double>(body_hash(c)));
    for (const auto& l : c.loads) {
        hash.add(l.t_s);
        hash.add(l.region);
        hash.add(l.force_n);
    }
    for (const auto& region : c.load_regions)
        for (const std::int32_t n : region.node_ids) hash.add(n);
    for (const auto& t : c.tool_samples) {
        hash.add(t.t_s);
        hash.add(t.position_m);
    }
    for (const auto& m : c.markers) hash.add(m.position_m);
    hash.add(c.gravity_m_s2);
    for (const double t : times) hash.add(t);
    hash.add(settings);
    hash.add(TERES_VERSION);
    return hash.value();
}

// What a diagnosis needs of a case beyond being well formed.
Status check(const Case& c, const std::string& folder) {
    const bool gravity = norm(c.gravity_m_s2) > 0.0;
    const bool loaded =
        std::any_of(c.loads.begin(), c.loads.end(), [](const auto& l) { return norm(l.force_n) > 0.0; });
    if (!loaded && !gravity && c.tool_samples.empty())
        return invalid_input(folder +
                             ": nothing moves the body: every force of loads.csv is zero, there is no gravity and no "
                             "tool; without a known load there is nothing to compare with");
    if (!(c.sensor.noise_sigma_m > 0.0))
        return invalid_input(folder +
                             ": case.json: sensor.noise_sigma_m is not given; a diagnosis weighs the gap against it");
    const double size = size_m(c.mesh);
    if (c.sensor.noise_sigma_m > 0.1 * size)
        return invalid_input(folder + ": case.json: sensor.noise_sigma_m is " + std::to_string(c.sensor.noise_sigma_m) +
                             " m, more than a tenth of the body (" + std::to_string(size) + " m); millimetres?");
    for (const PositionSample& o : c.observations) {
        const double far = norm(o.position_m);
        if (std::isfinite(far) && far > 100.0 * (size + norm(c.mesh.nodes.front())))
            return invalid_input(folder + ": observations.csv: marker " + std::to_string(o.id) + " at " +
                                 std::to_string(o.t_s) + " s is " + std::to_string(far) +
                                 " m from the origin, the body is " + std::to_string(size) + " m large; millimetres?");
    }
    return {};
}

// A dynamic recording is fitted on its beginning: what happens shows there, and every frame costs a simulated step.
constexpr std::size_t kBeginning = 48;  // frames

// One recording inside its own session.
struct Hosted {
    Case data;
    std::unique_ptr<Session> session;
    TrajectoryModel* mechanics = nullptr;
    ObservationModel* sensors = nullptr;
    std::vector<double> observed_m;  // layout of the model, NaN: lost
    std::uint64_t hash = 0;
};

Result<Hosted> host(const std::string& folder, Config config, bool first, const std::string& settings,
                    std::size_t frames_wanted = 0) {
    Hosted h;
    TERES_TRY_ASSIGN(h.data, read_case(folder));
    TERES_TRY(check(h.data, folder));
    for (const std::string& assignment :
         {std::string("service.bus_url=memq://"), "service.case=" + folder, std::string("service.drivers="),
          std::string(first ? "service.plugins=simulation,sensor_model,diagnosis"
                            : "service.plugins=simulation,sensor_model"),
          std::string("service.health_period_s=0"), std::string("simulation.trajectories=true"),
          "simulation.trajectory_frames=" + std::to_string(frames_wanted)})
        TERES_TRY(config.set(assignment, "teres diagnose"));
    TERES_TRY_ASSIGN(h.session, Session::open(config));
    TERES_TRY(h.session->start());
    h.mechanics = h.session->extension<TrajectoryModel>();
    h.sensors = h.session->extension<ObservationModel>();
    if (h.mechanics == nullptr) return host_fault(std::string("the plugins offer no ") + TrajectoryModel::kId);

    const std::size_t markers = h.mechanics->num_markers(), frames = h.mechanics->num_frames();
    h.observed_m.assign(3 * markers * frames, std::numeric_limits<double>::quiet_NaN());
    std::unordered_map<std::int32_t, std::size_t> index;
    for (std::size_t m = 0; m < markers; ++m) index[h.mechanics->marker_id(m)] = m;
    std::vector<double> times(frames);
    for (std::size_t f = 0; f < frames; ++f) times[f] = h.mechanics->time_s(f);
    for (const PositionSample& o : h.data.observations) {
        const auto at = std::lower_bound(times.begin(), times.end(), o.t_s - 1e-9);
        const auto marker = index.find(o.id);
        if (at == times.end() || std::abs(*at - o.t_s) > 1e-6 || marker == index.end()) continue;
        const std::size_t row = 3 * (static_cast<std::size_t>(at - times.begin()) * markers + marker->second);
        const bool seen = std::isfinite(o.position_m[0] + o.position_m[1] + o.position_m[2]);
        for (std::size_t a = 0; seen && a < 3; ++a) h.observed_m[row + a] = o.position_m[a];
    }
    h.hash = simulation_hash(h.data, times, settings);
    return h;
}

}  // namespace

std::string default_cache_folder() {
    const char* cache = std::getenv("XDG_CACHE_HOME");
    if (cache != nullptr && *cache != '\0') return std::string(cache) + "/teres";
    const char* home = std::getenv("HOME");
    return home != nullptr && *home != '\0' ? std::string(home) + "/.cache/teres" : "";
}

Result<DiagnosisRun> diagnose_cases(const std::vector<std::string>& case_folders, const Config& config,
                                    const DiagnosisRunOptions& options) {
    // Megabytes come and go with every trajectory: kept by the heap, not asked from the kernel page by page each time.
    mallopt(M_MMAP_THRESHOLD, 32 << 20);
    mallopt(M_TRIM_THRESHOLD, 1 << 30);
    std::vector<Hosted> hosted, whole;  // whole: of long dynamic recordings
    for (const std::string& folder : case_folders) {
        TERES_TRY_ASSIGN(const Case c, read_case(folder));
        const bool long_motion = !c.quasi_static && frame_times(c).size() > kBeginning;
        TERES_TRY_ASSIGN(Hosted one,
                         host(folder, config, hosted.empty(), options.settings_text, long_motion ? kBeginning : 0));
        if (!hosted.empty() && body_hash(one.data) != body_hash(hosted.front().data))
            return invalid_input(
                folder + ": not the body of " + case_folders.front() +
                " (mesh, material or supports differ); recordings of one diagnosis must show one body");
        hosted.push_back(std::move(one));
        whole.emplace_back();
        if (long_motion && !options.plan_only) {
            TERES_TRY_ASSIGN(whole.back(), host(folder, config, false, options.settings_text));
        }
    }
    auto* diagnosis = hosted.front().session->extension<GapDiagnosis>();
    if (diagnosis == nullptr) return host_fault(std::string("the plugins offer no ") + GapDiagnosis::kId);

    std::vector<GapRecording> recordings;
    for (std::size_t k = 0; k < hosted.size(); ++k) {
        const Hosted& h = hosted[k];
        recordings.push_back({h.data.name.c_str(), h.mechanics, h.sensors, h.observed_m, h.data.sensor.noise_sigma_m,
                              h.hash, whole[k].mechanics, whole[k].sensors, whole[k].observed_m});
    }
    std::vector<const char*> excluded;
    for (const std::string& id : options.excluded) excluded.push_back(id.c_str());
    GapRequest request{recordings,
                       excluded,
                       options.cache_folder.c_str(),
                       options.plan_only,
                       options.max_effects,
                       [](void* user, const char* stage, double part) {
                           const auto& o = *static_cast<const DiagnosisRunOptions*>(user);
                           if (o.progress) o.progress(stage, part);
                           return true;
                       },
                       const_cast<DiagnosisRunOptions*>(&options)};
    const std::int32_t code = diagnosis->diagnose(request);
    if (code != 0) return tl::unexpected(Error{static_cast<ErrorKind>(code), diagnosis->error()});

    DiagnosisRun run{diagnosis->gap_json(), diagnosis->report_json(), {}, {}, {}, {}};
    const Hosted& all = whole.front().mechanics != nullptr ? whole.front() : hosted.front();
    const TrajectoryModel& model = *all.mechanics;
    for (std::size_t f = 0; f < model.num_frames(); ++f) run.time_s.push_back(model.time_s(f));
    for (std::size_t p = 0; p < model.num_points(); ++p) run.point_id.push_back(model.point_id(p));
    run.points_m.assign(diagnosis->points_m().begin(), diagnosis->points_m().end());
    run.nominal_points_m.assign(diagnosis->nominal_points_m().begin(), diagnosis->nominal_points_m().end());
    return run;
}

Result<Judge> Judge::open(Config config) {
    for (const char* assignment : {"service.bus_url=memq://", "service.case=", "service.drivers=",
                                   "service.plugins=diagnosis", "service.health_period_s=0"})
        TERES_TRY(config.set(assignment, "the diagnosis alone"));
    Judge judge;
    TERES_TRY_ASSIGN(judge.session_, Session::open(config));
    TERES_TRY(judge.session_->start());
    judge.diagnosis_ = judge.session_->extension<GapDiagnosis>();
    if (judge.diagnosis_ == nullptr) return host_fault(std::string("the plugins offer no ") + GapDiagnosis::kId);
    return judge;
}

Result<std::string> Judge::judged_again(const std::string& gap_json) {
    const std::int32_t code = diagnosis_->judge_again(gap_json.c_str());
    if (code != 0) return tl::unexpected(Error{static_cast<ErrorKind>(code), diagnosis_->error()});
    return std::string(diagnosis_->gap_json());
}

}  // namespace teres::tools
