// teres register LOG: where the depth camera of a recording stands to the preoperative model.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "core/case/case_reader.h"
#include "core/log_reader.h"
#include "plugins/observation/frame_check.h"
#include "plugins/observation/landmarks.h"
#include "plugins/observation/rigid_registration.h"
#include "tools/film_commands.h"

namespace teres::tools {
namespace {

struct RegisterOptions {
    std::filesystem::path log, case_folder, landmarks, out;
    RegistrationOptions refine;
};

// The first sound depth frame and what both cameras say of themselves.
struct View {
    StreamInfo color, depth;
    cv::Mat counts;
};

Result<View> first_view(const std::filesystem::path& file) {
    TERES_TRY_ASSIGN(LogReader log, LogReader::open(file));
    std::optional<StreamInfo> color;
    FrameCheck check(FrameCheck::Kind::kDepth);
    for (LogEvent event; log.next(event);) {
        const int size = static_cast<int>(event.data.size());
        camera_info_t info;
        image_t image;
        if (event.channel.ends_with("_INFO") && info.decode(event.data.data(), 0, size) >= 0) {
            const auto read = stream_info(info);
            if (read && event.channel == "CAMERA_COLOR_INFO") color = *read;
            if (read && event.channel == "CAMERA_DEPTH_INFO") check.set_info(*read);
        }
        if (event.channel != "CAMERA_DEPTH" || !color || image.decode(event.data.data(), 0, size) < 0) continue;
        if (auto counts = check.take(image)) return View{*color, *check.info(), std::move(*counts)};
    }
    return invalid_input(file.string() +
                         ": no sound CAMERA_DEPTH frame with CAMERA_DEPTH_INFO and CAMERA_COLOR_INFO before it");
}

// Pose of the colour camera from landmarks seen in its image.
Result<Pose> from_landmarks(const std::filesystem::path& file, const View& view, const Pose& depth_to_color,
                            double guess_z_m) {
    TERES_TRY_ASSIGN(const auto landmarks, read_landmarks(file));
    const DepthLift lift(view.counts, view.depth.depth_unit_m, view.depth.camera, view.color.camera,
                         depth_to_color.inverse(), {});
    TERES_TRY_ASSIGN(const LandmarkPose found, pose_from_landmarks(landmarks, lift, guess_z_m));
    for (const std::string& name : found.left_out) std::printf("%s: no depth, left out\n", name.c_str());
    return found.camera_to_case;
}

nlohmann::json json_of(const Registration& r, const Pose& color_to_case) {
    const Point view = color_to_case.rotate({0.0, 0.0, 1.0}), up = color_to_case.rotate({0.0, -1.0, 0.0});
    nlohmann::json covariance = nlohmann::json::array();
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j < 6; ++j) covariance.push_back(r.covariance(i, j));
    return {{"format", "teres-registration-1"},
            {"sensor", {{"camera_position_m", color_to_case.t}, {"view_direction", view}, {"up", up}}},
            {"about_m", {r.centroid.x(), r.centroid.y(), r.centroid.z()}},
            {"covariance", covariance},  // of turn [rad] and shift [m] about about_m, case axes, row by row
            {"rms_m", r.rms_m},
            {"points", r.points},
            {"iterations", r.iterations}};
}

Result<int> register_camera(const RegisterOptions& o) {
    CaseReadOptions reading;
    reading.observations = false;
    TERES_TRY_ASSIGN(const Case c, read_case(o.case_folder, reading));
    TERES_TRY_ASSIGN(const View view, first_view(o.log));
    const Pose depth_to_color = view.depth.reference_frame == view.color.frame_id
                                    ? view.depth.to_reference
                                    : view.color.to_reference.inverse() * view.depth.to_reference;
    const auto stated =
        view.color.reference_frame == c.name ? std::optional(view.color.to_reference) : camera_pose(c.sensor);
    Pose start;  // of the depth camera
    if (!o.landmarks.empty()) {
        const double guess_z_m = stated ? std::max(0.05, stated->inverse().t[2]) : 0.3;
        TERES_TRY_ASSIGN(const Pose color_start, from_landmarks(o.landmarks, view, depth_to_color, guess_z_m));
        start = color_start * depth_to_color;
    } else if (stated) {
        start = *stated * depth_to_color;
    } else {
        return invalid_input("neither " + o.log.string() +
                             " nor the case's sensor says where the camera stands: give --landmarks");
    }
    const auto points = depth_points({view.counts.ptr<std::uint16_t>(), view.counts.total()}, view.depth.camera,
                                     view.depth.depth_unit_m, o.refine.stride_px);
    TERES_TRY_ASSIGN(const Registration found, refine_on_surface(c.mesh, points, start, o.refine));
    const Pose color_to_case = found.camera_to_case * depth_to_color.inverse();
    const auto stdev = [&](int i) { return std::sqrt(found.covariance(i, i)); };
    const Point& t = color_to_case.t;
    std::printf("%zu depth points, %.2f mm rms from the surface, %d iterations\n", found.points, 1e3 * found.rms_m,
                found.iterations);
    std::printf("  colour camera at %.4f %.4f %.4f m (case axes)\n", t[0], t[1], t[2]);
    std::printf(
        "  standard deviations about the surface's middle: shift %.2f %.2f %.2f mm, turn %.2f %.2f %.2f degrees\n",
        1e3 * stdev(3), 1e3 * stdev(4), 1e3 * stdev(5), 57.2958 * stdev(0), 57.2958 * stdev(1), 57.2958 * stdev(2));
    if (o.out.empty()) return kDone;
    std::FILE* file = std::fopen(o.out.c_str(), "w");
    if (file == nullptr) return host_fault("cannot write " + o.out.string());
    std::fprintf(file, "%s\n", json_of(found, color_to_case).dump(1).c_str());
    if (std::fclose(file) != 0) return host_fault("cannot write " + o.out.string());
    return kDone;
}

}  // namespace

void add_register_command(CLI::App& app, int& exit_code) {
    auto o = std::make_shared<RegisterOptions>();
    CLI::App* verb = add_verb(
        app, exit_code, "register", "Where the camera stands to the preoperative model, from a depth frame",
        "  teres register session.lcm --case CASE --landmarks landmarks.csv -o pose.json\n"
        "  teres register session.lcm --case CASE                # refines what the stream or the case states\n"
        "landmarks.csv: landmark,x_m,y_m,z_m (on the model at rest),u_px,v_px (in the colour image).\n"
        "pose.json: `sensor` goes into case.json; covariance of turn and shift. The liver should be at rest.",
        [o] {
            const Result<int> code = register_camera(*o);
            return code ? *code : report(code.error());
        });
    verb->add_option("log", o->log, "LCM log with CAMERA_DEPTH and its and the colour camera's _INFO")
        ->required()
        ->type_name("LOG");
    verb->add_option("--case", o->case_folder, "Case folder: model at rest")->required()->type_name("FOLDER");
    verb->add_option("--landmarks", o->landmarks, "Where landmarks of the model are seen")->type_name("FILE");
    verb->add_option("--gate", o->refine.start_gate_m,
                     "Depth points farther from the model at the start are not of the liver [m]")
        ->capture_default_str()
        ->check(CLI::Range(1e-3, 0.5));
    verb->add_option("-o,--out", o->out, "Write pose and covariance (JSON)")->type_name("FILE");
}

}  // namespace teres::tools
