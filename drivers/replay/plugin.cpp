// Unit `replay` (driver): plays a case folder or an LCM log, in real time, at another speed, or as fast as
// possible.
#include <algorithm>
#include <atomic>
#include <memory>
#include <optional>

#include "core/case/case_reader.h"
#include "core/clock.h"
#include "core/extensions/stream_clock.h"
#include "core/plugin_sdk.h"
#include "core/stream_pacer.h"
#include "drivers/replay/case_stream.h"
#include "drivers/replay/log_stream.h"

namespace teres {

struct ReplaySettings {
    std::filesystem::path case_folder;
    std::filesystem::path log_file;
    double speed = 1.0;
    bool loop = false;
    std::string channels = ".*";
    std::string skip_channels =
        "BOUNDARY_ESTIMATE|LIVER_STATE|INNOVATION|GAP|HEALTH|TRACKING|REGISTRATION|SURFACE_POINTS";
    template <class V>
    void visit(V& field) {
        field("case", case_folder, "case folder (teres-case-1) to play; empty: that of [service]");
        field("log", log_file, "LCM event log to play instead of the case's observations; empty: none");
        field("speed", speed, {0.0, 1000.0},
              "factor on real time; 0: as fast as possible, nothing lost (with memq://)");
        field("loop", loop, "start over at the end; time and sequence numbers go on");
        field("channels", channels, "", "channels of a log that are played (expression over the whole name)");
        field("skip_channels", skip_channels, "",
              "of these, not played: by default what the plugins publish themselves; MARKERS too if observation is one "
              "of them");
    }
};

class ReplayDriver final : public Unit, public StreamClock {
  public:
    using Settings = ReplaySettings;
    Settings settings;

    explicit ReplayDriver(Host host) : host_(std::move(host)), pacer_(0.0) {}

    Status configure() override {
        if (settings.case_folder.empty() && settings.log_file.empty())
            return invalid_input("replay.case, replay.log and service.case are empty: nothing to play");
        std::optional<Case> from;
        std::filesystem::path log_file = settings.log_file;
        if (!settings.case_folder.empty()) {
            CaseReadOptions options;
            options.observations = log_file.empty();
            TERES_TRY_ASSIGN(from, read_case(settings.case_folder, options));
            if (log_file.empty() && !from->stream.empty()) log_file = from->folder / from->stream;
        }
        if (log_file.empty()) {
            TERES_TRY_ASSIGN(stream_, CaseStream::make(*from));
        } else {
            LogStream::Options options{log_file, settings.channels, settings.skip_channels, from ? &*from : nullptr};
            TERES_TRY_ASSIGN(stream_, LogStream::open(options));
        }
        return {};
    }

    Status start() override {
        pacer_ = StreamPacer(settings.speed);
        clock_us_ = stream_->start_us();
        loaded_ = ended_ = false;
        return {};
    }

    // As fast as possible: one packet a step, so that each is worked through before the next. Else: what is
    // due.
    teres_step_outcome step(std::int64_t) noexcept override try {
        const bool at_once = settings.speed == 0.0;
        int played = 0;
        for (; played < (at_once ? 1 : kMaxPerStep); ++played) {
            const std::int64_t now_us = monotonic_us();
            if (!loaded_ && !load(now_us)) return played > 0 ? TERES_STEP_DONE : TERES_STEP_FINISHED;
            if (!at_once && due_us_ > static_cast<double>(now_us)) break;
            if (!host_.publish_bytes(packet_.channel.c_str(), packet_.data)) {
                // A full queue empties when the loop goes on; as fast as possible means without loss: try
                // again.
                if (at_once && ++refused_in_a_row_ < kMaxRefused) return TERES_STEP_DEGRADED;
                ++lost_;
            }
            refused_in_a_row_ = 0;
            loaded_ = false;
            if (packet_.capture_us) clock_us_ = std::max(clock_us_, *packet_.capture_us);
        }
        return played > 0 ? TERES_STEP_DONE : TERES_STEP_IDLE;
    } catch (...) {  // out of memory
        ++lost_;
        loaded_ = false;
        return TERES_STEP_DEGRADED;
    }

    void stop() override {
        if (lost_ > 0)
            host_.log(TERES_LOG_WARN, "replay", std::to_string(lost_) + " messages were refused by the bus and lost");
        lost_ = 0;
        stream_.reset();
    }

    void* extension(std::string_view id) override {
        return id == StreamClock::kId ? static_cast<StreamClock*>(this) : nullptr;
    }
    std::int64_t now_us() const noexcept override { return clock_us_; }

  private:
    static constexpr int kMaxPerStep = 64;
    static constexpr int kMaxRefused = 1000;

    bool load(std::int64_t now_us) {
        if (ended_) return false;
        if (!stream_->next(packet_)) {
            if (const std::string damage = stream_->damage_text(); !damage.empty())
                host_.log(TERES_LOG_WARN, "replay", damage);
            if (settings.loop) stream_->loop();
            if (!settings.loop || !stream_->next(packet_)) {
                ended_ = true;
                return false;
            }
        }
        due_us_ = pacer_.due_us(packet_.stamp_us, now_us);
        loaded_ = true;
        return true;
    }

    Host host_;
    std::unique_ptr<Stream> stream_;
    StreamPacer pacer_;
    Packet packet_;
    bool loaded_ = false;  // packet_ waits to be published
    bool ended_ = false;
    double due_us_ = 0.0;
    int refused_in_a_row_ = 0;
    std::int64_t lost_ = 0;
    std::int64_t clock_us_ = 0;
};

}  // namespace teres

TERES_PLUGIN(teres::ReplayDriver, "replay", "plays a case folder or an LCM log", TERES_UNIT_DRIVER)
