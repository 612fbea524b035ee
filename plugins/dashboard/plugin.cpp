// Unit `dashboard`: everything that is published in; a page on http://127.0.0.1:8642 out.
#include <memory>

#include "core/case/case_reader.h"
#include "core/plugin_sdk.h"
#include "plugins/dashboard/server.h"

namespace teres {
namespace {

constexpr std::size_t kMaxMessageBytes = 32 << 20;

}  // namespace

struct DashboardSettings {
    std::string case_folder;
    std::string address = "127.0.0.1";
    int port = 8642;
    std::string token;
    int history = 600;
    template <class V>
    void visit(V& field) {
        field("case", case_folder, "", "case folder (teres-case-1) whose surface is shown; empty: that of [service]");
        field("address", address, "", "where to listen; other than loopback needs a token");
        field("port", port, {0.0, 65535.0}, "0: any free one, told in the log");
        field("token", token, "", "who opens http://ADDRESS:PORT/?token=... may look; empty: anybody on this machine");
        field("history", history, {10.0, 100000.0}, "frames of the parameter curves");
    }
};

class DashboardPlugin final : public Unit {
  public:
    using Settings = DashboardSettings;
    Settings settings;

    explicit DashboardPlugin(Host host) : host_(std::move(host)) {}

    Status configure() override {
        if (settings.case_folder.empty()) return invalid_input("dashboard.case (or service.case) names no case folder");
        CaseReadOptions reading;
        reading.observations = false;
        TERES_TRY_ASSIGN(const Case c, read_case(settings.case_folder, reading));
        server_.reset();
        snapshot_ = std::make_unique<Snapshot>(c, static_cast<std::size_t>(settings.history));
        return {};
    }

    Status start() override {
        TERES_TRY(show<boundary_estimate_t>("BOUNDARY_ESTIMATE"));
        TERES_TRY(show<markers_t>("MARKERS"));
        TERES_TRY(show<innovation_t>("INNOVATION"));
        TERES_TRY(show<liver_state_t>("LIVER_STATE"));
        TERES_TRY(show<gap_t>("GAP"));
        TERES_TRY(show<health_t>("HEALTH"));
        TERES_TRY(show<device_health_t>("DEVICE_HEALTH"));
        for (const bool augmented : {false, true})
            TERES_TRY(host_.subscribe<image_t>(
                augmented ? "OVERLAY" : "CAMERA_COLOR", kMaxMessageBytes,
                [this, augmented](const image_t& m, std::int64_t) { snapshot_->take(m, augmented); }));
        TERES_TRY_ASSIGN(server_,
                         DashboardServer::start({settings.address, settings.port, settings.token}, *snapshot_));
        host_.log(TERES_LOG_INFO, "dashboard",
                  "http://" + settings.address + ":" + std::to_string(server_->port()) + "/");
        return {};
    }

    teres_step_outcome step(std::int64_t) noexcept override { return TERES_STEP_IDLE; }
    void stop() override { server_.reset(); }

  private:
    template <class Message>
    Status show(const char* channel) {
        return host_.subscribe<Message>(channel, kMaxMessageBytes,
                                        [this](const Message& m, std::int64_t) { snapshot_->take(m); });
    }

    Host host_;
    std::unique_ptr<Snapshot> snapshot_;
    std::unique_ptr<DashboardServer> server_;  // after what it reads
};

}  // namespace teres

TERES_PLUGIN(teres::DashboardPlugin, "dashboard", "a web page of what is going on", TERES_UNIT_PLUGIN)
