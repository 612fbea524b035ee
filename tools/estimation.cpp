#include "tools/estimation.h"

#include <chrono>
#include <cmath>
#include <limits>
#include <map>
#include <memory>

#include "core/case/case_reader.h"
#include "core/extensions/offline_estimate.h"
#include "core/session.h"
#include "teres/boundary_estimate_t.hpp"
#include "teres/innovation_t.hpp"
#include "teres/liver_state_t.hpp"
#include "teres/markers_t.hpp"
#include "teres/tool_loads_t.hpp"

namespace teres::tools {
namespace {

constexpr std::size_t kMaxMessageBytes = std::size_t{1} << 26;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Collects what the driver and the estimator publish.
struct Collector {
    std::vector<markers_t> markers;
    std::map<std::int64_t, tool_loads_t> loads;
    std::vector<boundary_estimate_t> estimates;
    std::vector<innovation_t> innovations;
    std::vector<char> converged;

    Status listen(Session& session) {
        TERES_TRY(session.subscribe<tool_loads_t>(
            "TOOL_LOADS", kMaxMessageBytes, [this](const tool_loads_t& m) { loads[m.header.capture_stamp_us] = m; }));
        TERES_TRY(session.subscribe<markers_t>("MARKERS", kMaxMessageBytes,
                                               [this](const markers_t& m) { markers.push_back(m); }));
        TERES_TRY(session.subscribe<boundary_estimate_t>(
            "BOUNDARY_ESTIMATE", kMaxMessageBytes, [this](const boundary_estimate_t& m) { estimates.push_back(m); }));
        TERES_TRY(session.subscribe<innovation_t>("INNOVATION", kMaxMessageBytes,
                                                  [this](const innovation_t& m) { innovations.push_back(m); }));
        return session.subscribe<liver_state_t>(
            "LIVER_STATE", kMaxMessageBytes, [this](const liver_state_t& m) { converged.push_back(m.converged != 0); });
    }
};

// Names of a message to the model's order; what the message does not name stays at `otherwise`.
std::vector<RecordedFrame> recorded_frames(const Collector& heard, const ForwardModel& model) {
    std::vector<RecordedFrame> frames;
    for (const markers_t& m : heard.markers) {
        RecordedFrame frame;
        frame.t_s = 1e-6 * static_cast<double>(m.header.capture_stamp_us);
        frame.force_n.assign(3 * model.num_regions(), 0.0);
        frame.tool_m.assign(3 * model.num_tools(), kNaN);
        frame.marker_m.assign(3 * model.num_markers(), kNaN);
        auto loads = heard.loads.upper_bound(m.header.capture_stamp_us);
        if (loads != heard.loads.begin()) {
            const tool_loads_t& l = std::prev(loads)->second;
            for (std::size_t r = 0; r < model.num_regions(); ++r)
                for (std::size_t k = 0; k < l.region.size(); ++k)
                    if (l.region[k] == model.region_name(r)) {
                        frame.force_n[3 * r] = l.fx_n[k];
                        frame.force_n[3 * r + 1] = l.fy_n[k];
                        frame.force_n[3 * r + 2] = l.fz_n[k];
                    }
            for (std::size_t j = 0; j < model.num_tools(); ++j)
                for (std::size_t k = 0; k < l.tool.size(); ++k)
                    if (l.tool[k] == model.tool_name(j)) {
                        frame.tool_m[3 * j] = l.x_m[k];
                        frame.tool_m[3 * j + 1] = l.y_m[k];
                        frame.tool_m[3 * j + 2] = l.z_m[k];
                    }
        }
        for (std::size_t j = 0; j < model.num_markers(); ++j)
            for (std::size_t k = 0; k < m.marker_id.size(); ++k)
                if (m.marker_id[k] == model.marker_id(j)) {
                    frame.marker_m[3 * j] = m.x_m[k];
                    frame.marker_m[3 * j + 1] = m.y_m[k];
                    frame.marker_m[3 * j + 2] = m.z_m[k];
                }
        frames.push_back(std::move(frame));
    }
    return frames;
}

using ParametersOfFrame = std::function<const std::vector<double>&(std::size_t frame)>;

// The recording once more through the model alone, one lane per set of parameters; bodies are kept of the
// first lane.
std::vector<Motion> simulate_motions(ForwardModel& model, const std::vector<RecordedFrame>& recording,
                                     std::size_t mesh_nodes, const std::vector<ParametersOfFrame>& theta,
                                     bool keep_body, const EstimationOptions& options, const char* stage) {
    const std::size_t lanes = theta.size(), rows = model.num_state(), outputs = 3 * model.num_markers();
    std::vector<Motion> motions(lanes);
    std::vector<double> x(rows * lanes), z(outputs * lanes), points(3 * model.num_points()), parameters;
    for (std::size_t l = 0; l < lanes; ++l) model.rest_state({x.data() + l * rows, rows});
    const bool dynamic = rows > 3 * model.num_nodes();
    std::vector<double> sum(lanes, 0.0);
    std::size_t seen = 0;
    for (std::size_t k = 0; k < recording.size(); ++k) {
        const RecordedFrame& frame = recording[k];
        const double dt = k > 0 ? frame.t_s - recording[k - 1].t_s : 0.0;
        if (!dynamic || k > 0) {
            parameters.clear();
            for (const auto& of_frame : theta)
                parameters.insert(parameters.end(), of_frame(k).begin(), of_frame(k).end());
            const ForwardReport report =
                model.advance({frame.t_s, dt, frame.force_n, frame.tool_m}, parameters, x, lanes);
            for (Motion& motion : motions) motion.frames_not_converged += report.lanes_converged < report.lanes;
        }
        model.observe(x, z, lanes);
        for (std::size_t j = 0; j + 2 < outputs; j += 3) {
            if (!std::isfinite(frame.marker_m[j] + frame.marker_m[j + 1] + frame.marker_m[j + 2])) continue;
            ++seen;
            for (std::size_t l = 0; l < lanes; ++l)
                for (std::size_t a = 0; a < 3; ++a) {
                    const double d = frame.marker_m[j + a] - z[l * outputs + j + a];
                    sum[l] += d * d;
                }
        }
        for (std::size_t l = 0; l < lanes; ++l) {
            const std::span<const double> lane(x.data() + l * rows, rows);
            model.predict_points(lane, points);
            motions[l].points.push_back(points);
            if (keep_body && l == 0)
                motions[l].body.emplace_back(lane.begin(), lane.begin() + static_cast<std::ptrdiff_t>(3 * mesh_nodes));
        }
        if (options.progress) options.progress(stage, k + 1, recording.size());
    }
    for (std::size_t l = 0; l < lanes; ++l)
        motions[l].marker_rms_m = seen > 0 ? std::sqrt(sum[l] / static_cast<double>(seen)) : kNaN;
    return motions;
}

// Parameters of every frame given the whole recording; the last frame's are the result.
Status smooth_frames(OfflineEstimate& offline, const ForwardModel& model, const EstimationOptions& options,
                     Estimation& out) {
    if (offline.num_frames() != out.frames.size())
        return not_usable("the estimator kept " + std::to_string(offline.num_frames()) + " of " +
                          std::to_string(out.frames.size()) + " frames: time went backwards");
    const auto report = [](void* user, double part) {
        const auto& progress = *static_cast<const EstimationOptions*>(user);
        if (progress.progress) progress.progress("smoothing", static_cast<std::size_t>(100.0 * part), 100);
    };
    if (!offline.smooth(options.passes, report, const_cast<EstimationOptions*>(&options)))
        return not_usable("no frame of the recording could be estimated");
    const std::size_t p = offline.num_parameters();
    std::vector<double> stdev(p), observability(p);
    for (std::size_t k = 0; k < out.frames.size(); ++k) {
        out.frames[k].smoothed.resize(p);
        offline.parameters(k, out.frames[k].smoothed, stdev, observability);
    }
    for (std::size_t i = 0; i < p; ++i) {
        const ForwardParameter parameter = model.parameter(i);
        out.parameters.push_back({parameter.name, parameter.unit, out.frames.back().smoothed[i], stdev[i],
                                  observability[i], parameter.prior_median});
    }
    out.attachment_probability.resize(offline.num_attachment_nodes());
    for (std::size_t k = 0; k < offline.num_attachment_nodes(); ++k)
        out.attachment_node.push_back(model.attachment_node(k).node_id);
    offline.attachment(out.frames.size() - 1, out.attachment_probability);
    return {};
}

Status configure(Config& config, const std::string& case_folder, bool estimate) {
    for (const std::string& assignment :
         {std::string("service.bus_url=memq://"), "service.case=" + case_folder, std::string("service.drivers=replay"),
          std::string(estimate ? "service.plugins=simulation,estimator" : "service.plugins=simulation"),
          std::string("service.health_period_s=0"), std::string("replay.speed=0"), std::string("replay.loop=false"),
          std::string("simulation.newton_budget=0")})
        TERES_TRY(config.set(assignment, "teres estimate"));
    if (estimate) TERES_TRY(config.set("estimator.keep_recording=true", "teres estimate"));
    return {};
}

// Plays the recording through the units of `config`; the session stays open for its forward model.
Result<std::unique_ptr<Session>> play(const Config& config, Collector& heard, std::size_t frames,
                                      const EstimationOptions& options, bool estimate) {
    TERES_TRY_ASSIGN(auto session, Session::open(config));
    TERES_TRY(heard.listen(*session));
    TERES_TRY(session->start());
    TERES_TRY(session->run_until_finished([&] {
        if (options.progress && estimate) options.progress("estimating", heard.estimates.size(), frames);
        return true;
    }));
    return session;
}

}  // namespace

Result<Estimation> estimate_case(const std::string& case_folder, Config config, const EstimationOptions& options) {
    TERES_TRY_ASSIGN(const Case c, read_case(case_folder));
    Estimation out;
    std::size_t times = 0;
    for (std::size_t i = 0; i < c.observations.size(); ++i)
        times += i == 0 || c.observations[i].t_s > c.observations[i - 1].t_s;
    for (const auto& entry : c.ligament_prior) out.has_fixed = out.has_fixed || entry.probability >= 0.5;
    bool grouped = false;
    for (const auto& spring : c.springs) grouped = grouped || !spring.group.empty();
    if (options.estimate && !grouped && (c.ligament_prior.empty() || !c.ligament))
        return invalid_input(case_folder +
                             ": nothing to estimate: the case has neither ligament_prior.csv with `ligament` in "
                             "case.json nor grouped springs in springs.csv");
    if (!options.estimate && !out.has_fixed)
        return invalid_input(
            case_folder + ": no node of ligament_prior.csv has a probability of 0.5 or more that could be held fixed");

    if (options.estimate) {
        Config settings = config;
        TERES_TRY(configure(settings, case_folder, true));
        Collector heard;
        const auto begin = std::chrono::steady_clock::now();
        TERES_TRY_ASSIGN(const auto session, play(settings, heard, times, options, true));
        const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
        auto* model = session->extension<ForwardModel>();
        auto* offline = session->extension<OfflineEstimate>();
        if (model == nullptr || offline == nullptr)
            return host_fault("the plugins offer no teres.forward_model/1 or teres.offline_estimate/1");
        if (heard.estimates.empty() || heard.estimates.size() != heard.markers.size())
            return not_usable(case_folder + ": " + std::to_string(heard.markers.size()) + " frames of markers gave " +
                              std::to_string(heard.estimates.size()) + " estimates");
        out.seconds_per_frame = seconds / static_cast<double>(heard.estimates.size());
        out.recording = recorded_frames(heard, *model);
        for (std::size_t k = 0; k < heard.estimates.size(); ++k) {
            const auto& e = heard.estimates[k];
            out.frames.push_back({e.mean,
                                  e.stdev,
                                  {},
                                  heard.innovations[k].nis,
                                  heard.innovations[k].degrees_of_freedom,
                                  e.stale != 0,
                                  heard.converged[k] != 0});
        }
        TERES_TRY(smooth_frames(*offline, *model, options, out));
        for (std::size_t k = 0; k < model->num_points(); ++k) out.point_id.push_back(model->point_id(k));
        std::vector<double> prior;
        for (const auto& p : out.parameters) prior.push_back(p.prior_median);
        auto motions =
            simulate_motions(*model, out.recording, c.mesh.nodes.size(),
                             {[&](std::size_t k) -> const std::vector<double>& { return out.frames[k].smoothed; },
                              [&](std::size_t) -> const std::vector<double>& { return prior; }},
                             options.keep_body, options, "predicting");
        out.estimated = std::move(motions[0]);
        out.prior = std::move(motions[1]);
    }
    if (out.has_fixed) {
        Config settings = config;
        TERES_TRY(configure(settings, case_folder, false));
        TERES_TRY(settings.set("simulation.boundary=atlas_fixed", "teres estimate"));
        Collector heard;
        TERES_TRY_ASSIGN(const auto session, play(settings, heard, times, options, false));
        auto* model = session->extension<ForwardModel>();
        if (model == nullptr) return host_fault("the plugins offer no teres.forward_model/1");
        if (!options.estimate) {
            out.recording = recorded_frames(heard, *model);
            for (std::size_t k = 0; k < model->num_points(); ++k) out.point_id.push_back(model->point_id(k));
            for (const auto& entry : c.ligament_prior) {
                out.attachment_node.push_back(entry.node_id);
                out.attachment_probability.push_back(entry.probability >= 0.5 ? 1.0 : 0.0);
            }
        }
        std::vector<double> of_springs;
        for (std::size_t p = 0; p < model->num_parameters(); ++p)
            of_springs.push_back(model->parameter(p).prior_median);
        out.fixed =
            std::move(simulate_motions(*model, out.recording, c.mesh.nodes.size(),
                                       {[&](std::size_t) -> const std::vector<double>& { return of_springs; }},
                                       options.keep_body && !options.estimate, options, "atlas region held fixed")[0]);
    }
    return out;
}

}  // namespace teres::tools
