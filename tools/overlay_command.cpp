// teres overlay LOG: the augmented view of a recorded session as pictures or video.
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

#include "core/session.h"
#include "teres/image_t.hpp"
#include "tools/film_commands.h"

namespace teres::tools {
namespace {

namespace fs = std::filesystem;

struct OverlayOptions {
    SettingsOptions settings;
    fs::path log, case_folder, out;
    bool recorded = false, video = false;
    int every = 30;
};

// Pictures frame-000030.png, ..., or overlay.avi with every frame at the rate of the first two.
class AlbumWriter {
  public:
    AlbumWriter(fs::path folder, int every, bool video) : folder_(std::move(folder)), every_(every), video_(video) {}
    void add(const image_t& m) {
        if (!failure_.empty() || m.fourcc != "BGR3" || std::int64_t{m.row_stride_bytes} * m.height_px != m.num_bytes)
            return;
        const cv::Mat image(m.height_px, m.width_px, CV_8UC3, const_cast<std::uint8_t*>(m.data.data()),
                            static_cast<std::size_t>(m.row_stride_bytes));
        const std::int64_t frame = frames_++;
        if (video_) {
            if (frame == 0) {
                first_us_ = m.header.capture_stamp_us;
                first_ = image.clone();
                return;
            }
            if (frame == 1) open_video(m.header.capture_stamp_us - first_us_, image.size());
            if (frame == 1 && failure_.empty()) film_.write(first_);
            if (failure_.empty()) film_.write(image);
        } else if (frame % every_ == 0) {
            const fs::path file = folder_ / fmt::format("frame-{:06}.png", frame);
            if (cv::imwrite(file.string(), image))
                last_ = file;
            else
                failure_ = "cannot write " + file.string();
        }
    }
    std::int64_t frames() const { return frames_; }
    const std::string& failure() const { return failure_; }
    const fs::path& last() const { return last_; }

  private:
    void open_video(std::int64_t step_us, cv::Size size) {
        last_ = folder_ / "overlay.avi";
        const double rate = step_us > 0 ? std::clamp(1e6 / static_cast<double>(step_us), 1.0, 240.0) : 30.0;
        if (!film_.open(last_.string(), cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), rate, size))
            failure_ = "cannot write " + last_.string();
    }
    fs::path folder_, last_;
    int every_;
    bool video_;
    std::int64_t frames_ = 0, first_us_ = 0;
    cv::Mat first_;
    std::string failure_;
    cv::VideoWriter film_;
};

Result<int> overlay(const OverlayOptions& options) {
    SettingsOptions settings = options.settings;
    std::vector<std::string> forced = {"service.drivers=replay", "service.bus_url=memq://",
                                       "service.record_to=",     "replay.loop=false",
                                       "replay.speed=0",         "replay.log=" + fs::absolute(options.log).string(),
                                       "overlay.jpeg_quality=0"};
    forced.push_back(options.recorded ? "service.plugins=overlay"
                                      : "service.plugins=observation,simulation,estimator,overlay");
    if (options.recorded) forced.push_back("replay.skip_channels=OVERLAY|HEALTH");
    if (!options.case_folder.empty()) forced.push_back("service.case=" + fs::absolute(options.case_folder).string());
    settings.overrides.insert(settings.overrides.begin(), forced.begin(), forced.end());
    TERES_TRY_ASSIGN(const Config config, read_settings(settings));
    std::error_code failed;
    fs::create_directories(options.out, failed);
    if (failed) return host_fault("cannot make the folder " + options.out.string() + ": " + failed.message());

    TERES_TRY_ASSIGN(const std::unique_ptr<Session> session, Session::open(config));
    AlbumWriter album(options.out, options.every, options.video);
    TERES_TRY(session->subscribe<image_t>("OVERLAY", kMaxMessageBytes, [&](const image_t& m) { album.add(m); }));
    TERES_TRY(session->start());
    TERES_TRY(session->run_until_finished([&] { return album.failure().empty(); }));
    session->stop();
    if (!album.failure().empty()) return host_fault("overlay: " + album.failure());
    if (album.frames() == 0)
        return not_usable("overlay: no frame drawn; does " + options.log.string() +
                          " hold CAMERA_COLOR and CAMERA_COLOR_INFO?");
    std::printf("%lld frames drawn, last file %s\n", static_cast<long long>(album.frames()), album.last().c_str());
    return kDone;
}

}  // namespace

void add_overlay_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<OverlayOptions>();
    CLI::App* verb =
        add_verb(app, exit_code, "overlay", "Augmented view of a recorded session, as PNG or video",
                 "  teres overlay film/recording.lcm --case config/cases/demo -o pictures\n"
                 "  teres overlay session.lcm --recorded -o pictures --every 1      # results as recorded, nothing "
                 "computed anew\n"
                 "  teres overlay film/recording.lcm -o pictures --video --set observation.publish_period_s=0.2",
                 [options] {
                     const Result<int> code = overlay(*options);
                     return code ? *code : report(code.error());
                 });
    verb->add_option("log", options->log, "LCM log with CAMERA_COLOR")
        ->required()
        ->type_name("LOG")
        ->check(CLI::ExistingFile);
    verb->add_option("-o,--out", options->out, "Folder to write")->required()->type_name("DIR");
    verb->add_option("--case", options->case_folder, "Case folder (sets service.case)")->type_name("FOLDER");
    verb->add_flag("--recorded", options->recorded,
                   "Draw the log's own results instead of running observation and estimator");
    verb->add_flag("--video", options->video, "overlay.avi (MJPG) instead of pictures");
    verb->add_option("--every", options->every, "A picture every so many frames")
        ->capture_default_str()
        ->check(CLI::Range(1, 100000));
    add_settings_options(*verb, options->settings);
}

}  // namespace teres::tools
