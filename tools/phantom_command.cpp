// teres phantom CASE: films a deforming liver phantom of known motion: an LCM log of camera frames and loads, and the
// truth beside it.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/camera/depth_codec.h"
#include "core/case/case_reader.h"
#include "core/case/case_writer.h"
#include "core/case/load_tracks.h"
#include "core/case/text_file.h"
#include "core/case/text_writer.h"
#include "core/recorder.h"
#include "teres/image_t.hpp"
#include "teres/tool_loads_t.hpp"
#include "tools/film_commands.h"
#include "tools/phantom/depth_sensor.h"
#include "tools/phantom/renderer.h"
#include "tools/phantom/scaled_case.h"
#include "tools/phantom/scene.h"
#include "tools/progress.h"

namespace teres::tools {
namespace {

namespace fs = std::filesystem;
using phantom::DepthSensor;
using phantom::Renderer;
using phantom::Scene;

constexpr const char* kSerial = "phantom-1";
constexpr double kInfoPeriod_s = 1.0;

struct PhantomOptions {
    fs::path case_folder, out;
    double seconds = 8.0, rate_hz = 30.0, occlusion = 0.0, texture = 1.0, scale = 1.0;
    phantom::RespirationOptions respiration;
    std::string markers = "dark";
    bool stereo = false, raw = false;
    std::uint64_t seed = 1;
};

// The log: encodes, numbers and stamps.
class Film {
  public:
    static Result<Film> open(const fs::path& file) {
        RecorderSettings settings;
        settings.file = file;
        settings.overwrite = true;
        TERES_TRY_ASSIGN(Recorder recorder, Recorder::open(settings));
        return Film(std::move(recorder));
    }
    template <class Message>
    void add(const std::string& channel, Message& message, std::int64_t stamp_us) {
        message.header.capture_stamp_us = stamp_us;
        message.header.sequence = sequences_[channel]++;
        bytes_.resize(static_cast<std::size_t>(message.getEncodedSize()));
        message.encode(bytes_.data(), 0, static_cast<int>(bytes_.size()));
        recorder_.record(channel, bytes_, stamp_us);
    }
    Status end_frame() {
        recorder_.flush();
        if (recorder_.counters().stopped) return host_fault("phantom: recording stopped: " + recorder_.stop_reason());
        return {};
    }
    double megabytes() const { return 1e-6 * static_cast<double>(recorder_.counters().written_bytes); }

  private:
    explicit Film(Recorder recorder) : recorder_(std::move(recorder)) {}
    Recorder recorder_;
    std::map<std::string, std::int64_t> sequences_;
    std::vector<std::uint8_t> bytes_;
};

image_t image_message(const StreamInfo& info, const std::string& fourcc, int row_stride,
                      std::vector<std::uint8_t> data) {
    image_t m{};
    m.header.frame_id = info.frame_id;
    m.serial = info.serial;
    m.fourcc = fourcc;
    m.width_px = info.camera.width_px;
    m.height_px = info.camera.height_px;
    m.row_stride_bytes = row_stride;
    m.num_bytes = static_cast<std::int32_t>(data.size());
    m.data = std::move(data);
    return m;
}

image_t color_message(const StreamInfo& info, const cv::Mat& image, bool raw) {
    if (raw) {
        cv::Mat rgb = image;
        if (image.channels() == 3) cv::cvtColor(image, rgb, cv::COLOR_BGR2RGB);
        return image_message(info, image.channels() == 3 ? "RGB3" : "GREY", static_cast<int>(rgb.step),
                             {rgb.data, rgb.data + rgb.total() * rgb.elemSize()});
    }
    std::vector<std::uint8_t> code;
    cv::imencode(".jpg", image, code, {cv::IMWRITE_JPEG_QUALITY, 92});
    return image_message(info, "MJPG", 0, std::move(code));
}

image_t depth_message(const StreamInfo& info, const cv::Mat& counts, bool raw) {
    if (raw)
        return image_message(info, "Z16 ", static_cast<int>(counts.step),
                             {counts.data, counts.data + 2 * counts.total()});
    std::vector<std::uint8_t> code;
    encode_depth({counts.ptr<std::uint16_t>(), counts.total()}, code);
    return image_message(info, "RVL ", 0, std::move(code));
}

// A rig like a D435: depth and infrared about 15 and 65 mm left of the colour camera, wider lens.
struct Rig {
    StreamInfo color, depth, left, right;
    explicit Rig(const Case& c, const Pose& color_pose, const phantom::DepthSensorOptions& sensor) {
        color = {kSerial,    "camera_color",
                 c.name,     {640, 480, 612.0, 611.0, 322.5, 241.0, {0.02, -0.05, 5e-4, -3e-4, 0.0}},
                 color_pose, 0.0,
                 0.0};
        depth = {kSerial,
                 "camera_depth",
                 "camera_color",
                 {640, 480, 385.0, 385.0, 319.0, 238.5, {}},
                 {},
                 sensor.depth_unit_m,
                 0.0};
        depth.to_reference.t = {-0.015, 0.0, 0.0};
        left = depth;
        left.frame_id = "camera_left";
        left.depth_unit_m = 0.0;
        right = left;
        right.frame_id = "camera_right";
        right.reference_frame = "camera_left";
        right.baseline_m = sensor.baseline_m;
        right.to_reference.t = {sensor.baseline_m, 0.0, 0.0};
    }
};

class Truth {
  public:
    explicit Truth(const Case& c) : points_of_(c.validation_rest) {
        visible_.line("t_s", "marker_id", "visible");
        shifts_.line("t_s", "x_m", "y_m", "z_m");
    }
    void add(double t_s, const Scene& scene, const Renderer& renderer) {
        for (const Scene::Marker& marker : scene.markers()) {
            const Point x = scene.marker_now(marker);
            const bool sees = renderer.sees(x);
            markers_.push_back({t_s, marker.id, x});
            visible_.line(fmt::format("{:.6f}", t_s), marker.id, sees ? 1 : 0);
            hidden_ += sees ? 0 : 1;
        }
        for (std::size_t i = 0; i < points_of_.size(); ++i)
            points_.push_back({t_s, points_of_[i].id, scene.points_now()[i]});
        shifts_.line(t_s, scene.shift_now());
    }
    Status write(const fs::path& folder, bool breathes) const {
        TERES_TRY(write_positions(folder / "markers.csv", "marker_id", markers_));
        TERES_TRY(write_positions(folder / "validation.csv", "point_id", points_));
        std::error_code none;
        fs::remove(folder / "respiration.csv", none);  // of an older film
        if (breathes) TERES_TRY(write_text_file(folder / "respiration.csv", shifts_.text()));
        return write_text_file(folder / "visible.csv", visible_.text());
    }
    double hidden_share() const {
        return static_cast<double>(hidden_) / static_cast<double>(std::max<std::size_t>(1, markers_.size()));
    }

  private:
    std::vector<MarkerRest> points_of_;
    std::vector<PositionSample> markers_, points_;
    TextWriter visible_, shifts_;
    std::size_t hidden_ = 0;
};

// The case to film; in another size it becomes a case folder beside the film.
Result<Case> filmed_case(const PhantomOptions& options) {
    CaseReadOptions reading;
    reading.observations = options.scale != 1.0;
    TERES_TRY_ASSIGN(Case c, read_case(options.case_folder, reading));
    if (options.scale == 1.0) return c;
    TERES_TRY(phantom::write_scaled_case(c, options.scale, options.out / "case"));
    return read_case(options.out / "case", reading);
}

Result<std::optional<phantom::Respiration>> respiration_of(const PhantomOptions& options) {
    if (options.respiration.file.empty()) return std::optional<phantom::Respiration>();
    TERES_TRY_ASSIGN(auto breath, phantom::Respiration::read(options.respiration, options.seconds));
    std::printf(
        "breathing: %s of %s, range %.1f mm over the record; the case does not know: the whole phantom moves, as "
        "respiration.csv says\n",
        breath.column().c_str(), options.respiration.file.c_str(), 1e3 * breath.range_m());
    if (const auto truth = read_text_file(options.case_folder / "truth.json");
        truth && truth->find("moving_attachment") != std::string::npos)
        std::printf("the case itself has attachments that move (truth.json: moving_attachment): both motions add up\n");
    return std::optional(std::move(breath));
}

Result<int> film(const PhantomOptions& options) {
    std::error_code failure;
    fs::create_directories(options.out, failure);
    if (failure) return host_fault("cannot make the folder " + options.out.string() + ": " + failure.message());
    TERES_TRY_ASSIGN(const Case c, filmed_case(options));
    phantom::SceneOptions scene_options;
    scene_options.occlusion = options.occlusion;
    TERES_TRY_ASSIGN(scene_options.respiration, respiration_of(options));
    TERES_TRY_ASSIGN(Scene scene, Scene::make(c, scene_options));
    const phantom::DepthSensorOptions sensor_options;
    const Rig rig(c, scene.camera(), sensor_options);
    const Pose depth_pose = rig.color.to_reference * rig.depth.to_reference;
    DepthSensor sensor(sensor_options, rig.depth.camera.fx_px, options.seed + 1);
    Renderer renderer(scene,
                      {.bright_markers = options.markers == "bright",
                       .no_markers = options.markers == "none",
                       .texture = options.texture},
                      options.seed);

    TERES_TRY_ASSIGN(Film film, Film::open(options.out / "recording.lcm"));
    const LoadTracks loads(c);
    Truth truth(c);
    const auto frames = static_cast<std::size_t>(std::llround(options.seconds * options.rate_hz)) + 1;
    Progress progress("filming", frames);
    double next_info_s = 0.0;
    for (std::size_t k = 0; k < frames; ++k) {
        const double t = static_cast<double>(k) / options.rate_hz;
        const std::int64_t stamp_us = std::llround(1e6 * t);
        scene.move_to(t);
        renderer.begin_frame();
        if (t >= next_info_s) {
            next_info_s += kInfoPeriod_s;
            std::vector<std::pair<const char*, const StreamInfo*>> streams{{"CAMERA_COLOR_INFO", &rig.color},
                                                                           {"CAMERA_DEPTH_INFO", &rig.depth}};
            if (options.stereo)
                streams = {{"CAMERA_COLOR_INFO", &rig.color},
                           {"CAMERA_LEFT_INFO", &rig.left},
                           {"CAMERA_RIGHT_INFO", &rig.right}};
            for (const auto& [channel, info] : streams) {
                camera_info_t message = to_message(*info);
                film.add(channel, message, stamp_us);
            }
        }
        tool_loads_t forces;
        loads.at(scene.case_time(t), forces);
        forces.header.frame_id = c.name;
        film.add("TOOL_LOADS", forces, stamp_us);
        if (options.stereo) {
            for (const auto* info : {&rig.left, &rig.right}) {
                const Pose pose = info == &rig.left ? depth_pose : depth_pose * rig.right.to_reference;
                cv::Mat grey;
                cv::cvtColor(renderer.color(info->camera, pose), grey, cv::COLOR_BGR2GRAY);
                image_t message = color_message(*info, grey, options.raw);
                film.add(info == &rig.left ? "CAMERA_LEFT" : "CAMERA_RIGHT", message, stamp_us);
            }
        } else {
            image_t message =
                depth_message(rig.depth, sensor.measure(renderer.range(rig.depth.camera, depth_pose)), options.raw);
            film.add("CAMERA_DEPTH", message, stamp_us);
        }
        image_t color = color_message(rig.color, renderer.color(rig.color.camera, scene.camera()), options.raw);
        film.add("CAMERA_COLOR", color, stamp_us);
        truth.add(t, scene, renderer);
        TERES_TRY(film.end_frame());
        progress.step();
    }
    progress.finish();
    TERES_TRY(truth.write(options.out, scene_options.respiration.has_value()));
    std::printf("%s: %zu frames, %.1f s at %.0f Hz, %zu markers, %.1f %% of them hidden, %.1f MB\n",
                (options.out / "recording.lcm").c_str(), frames, options.seconds, options.rate_hz,
                scene.markers().size(), 100.0 * truth.hidden_share(), film.megabytes());
    return kDone;
}

}  // namespace

void add_phantom_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<PhantomOptions>();
    CLI::App* verb =
        add_verb(app, exit_code, "phantom", "Film a liver phantom that moves as an independent solver says",
                 "  teres phantom config/cases/demo -o film                      # colour and depth, 8 s\n"
                 "  teres phantom config/cases/demo -o film --seconds 60 --occlusion 0.3\n"
                 "  teres replay film/recording.lcm --case config/cases/demo --set "
                 "service.plugins=observation,simulation,estimator\n"
                 "  teres phantom config/cases/demo -o film --seconds 60 --respiration breath.csv "
                 "--respiration-amplitude-mm 15\n"
                 "  teres phantom config/cases/demo -o film --scale 0.5          # half size; then --case film/case\n"
                 "Writes recording.lcm (CAMERA_COLOR, CAMERA_DEPTH or CAMERA_LEFT and _RIGHT, their _INFO, "
                 "TOOL_LOADS), and the\n"
                 "truth: markers.csv, visible.csv, validation.csv (inner points). The liver moves with the true points "
                 "of the case (validation.csv), to the end of\n"
                 "its recording and back; the case needs the camera's pose.\n"
                 "breath.csv: t_s,NAME,.. in s and mm (positions of skin markers), steps up to 1 s, as long as the "
                 "film at least: it is not\n"
                 "repeated. Liver, cloth and frame are carried together by what it says since its first line; the "
                 "truth holds it.",
                 [options] {
                     const Result<int> code = film(*options);
                     return code ? *code : report(code.error());
                 });
    verb->add_option("case", options->case_folder, "Case folder with validation.csv")->required()->type_name("CASE");
    verb->add_option("-o,--out", options->out, "Folder to write")->required()->type_name("DIR");
    verb->add_option("--seconds", options->seconds, "Length")->capture_default_str()->check(CLI::Range(0.0, 3600.0));
    verb->add_option("--rate", options->rate_hz, "Frames per second")
        ->capture_default_str()
        ->check(CLI::Range(0.1, 1000.0));
    verb->add_option("--occlusion", options->occlusion, "Share of the liver behind a sweeping retractor")
        ->capture_default_str()
        ->check(CLI::Range(0.0, 0.9));
    verb->add_option("--scale", options->scale,
                     "Size against the case's; other than 1: writes the scaled case to DIR/case")
        ->capture_default_str()
        ->check(CLI::Range(0.1, 2.0));
    verb->add_option("--respiration", options->respiration.file, "Breathing curve that carries the phantom [s, mm]")
        ->type_name("CSV");
    verb->add_option("--respiration-column", options->respiration.column,
                     "Column of it; default: the one of the largest range")
        ->type_name("NAME");
    verb->add_option("--respiration-amplitude-mm", options->respiration.amplitude_mm,
                     "Range of the motion over the whole record; 0: as recorded")
        ->capture_default_str()
        ->check(CLI::Range(0.0, 200.0));
    verb->add_option("--respiration-direction", options->respiration.direction,
                     "Where growing values move it, case axes (default 0 -1 0: caudal)")
        ->type_name("X Y Z");
    verb->add_option("--markers", options->markers, "Paint of the markers")
        ->capture_default_str()
        ->check(CLI::IsMember({"dark", "bright", "none"}));
    verb->add_option("--texture", options->texture, "Contrast of the liver's own texture")
        ->capture_default_str()
        ->check(CLI::Range(0.0, 3.0));
    verb->add_flag("--stereo", options->stereo, "A stereo pair instead of depth");
    verb->add_flag("--raw", options->raw, "Uncompressed frames (RGB3, GREY, Z16)");
    verb->add_option("--seed", options->seed, "Of the noise")->capture_default_str();
}

}  // namespace teres::tools
