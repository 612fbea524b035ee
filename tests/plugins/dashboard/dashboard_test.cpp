#include <gtest/gtest.h>
#include <httplib.h>

#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "plugins/dashboard/server.h"
#include "tests/support/browser.h"
#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

using nlohmann::json;

cv::Mat decoded(const std::string& base64) {
    std::vector<std::uint8_t> bytes;
    std::uint32_t bits = 0;
    int held = 0;
    for (const char c : base64) {
        static const std::string kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
        const auto digit = kDigits.find(c);
        if (digit == std::string::npos) break;
        bits = bits << 6 | static_cast<std::uint32_t>(digit);
        if ((held += 6) < 8) continue;
        bytes.push_back(static_cast<std::uint8_t>(bits >> (held -= 8)));
    }
    return bytes.empty() ? cv::Mat() : cv::imdecode(bytes, cv::IMREAD_COLOR);
}

class Dashboard : public ::testing::Test {
  protected:
    Dashboard() {
        markers_t m{};
        m.num_markers = 2;
        m.marker_id = {4, 7};
        m.x_m = {0.0123, std::nan("")};
        m.y_m = m.z_m = m.sigma_m = {0.001, std::nan("")};
        snapshot.take(m);
        boundary_estimate_t e{};
        e.name = {"ligament.r0.stiffness", "ligament.r1.stiffness"};
        e.unit = {"N/m", "N/m"};
        e.num_parameters = 2;
        e.observability = {0.9, 0.1};
        for (int k = 0; k < 20; ++k) {
            e.header.capture_stamp_us = 100'000 * k;
            e.mean = {20.0 + k, 60.0 - k};
            e.stdev = {10.0 / (k + 1), 5.0};
            for (std::int32_t n = 0; n < 30; ++n) {
                if (k > 0) continue;
                e.node_id.push_back(n);
                e.attachment_probability.push_back(1.0);
            }
            snapshot.take(e);
        }
        image_t frame{};
        frame.fourcc = "MJPG";
        cv::imencode(".jpg", cv::Mat(48, 64, CV_8UC3, cv::Scalar(20, 200, 20)), frame.data);
        snapshot.take(frame, true);
    }
    std::unique_ptr<DashboardServer> serve(const std::string& token = "") {
        auto server = DashboardServer::start({"127.0.0.1", 0, token}, snapshot);
        EXPECT_TRUE(server) << server.error().text;
        return std::move(*server);
    }
    Case c = test::clamped_block();
    Snapshot snapshot{c, 600};
};

TEST_F(Dashboard, StateHoldsWhatWasPublished) {
    const auto server = serve();
    httplib::Client client("127.0.0.1", server->port());
    const auto answer = client.Get("/state");
    ASSERT_TRUE(answer);
    const json state = json::parse(answer->body);
    EXPECT_NEAR(state["markers"][0]["x_mm"], 12.3, 1e-9);
    EXPECT_TRUE(state["markers"][1]["x_mm"].is_null()) << "lost: null, not a number";
    EXPECT_EQ(state["curves"]["mean"].size(), 20u);
    EXPECT_FALSE(state["gap"]["alarm"]);
    EXPECT_FALSE(state["stale"]);
    EXPECT_EQ(client.Get("/frame.jpg")->get_header_value("Content-Type"), "image/jpeg");
    EXPECT_EQ(json::parse(client.Get("/mesh")->body)["triangles"].size() % 3, 0u);
    EXPECT_EQ(client.Get("/../etc/passwd")->status, 404);
}

TEST_F(Dashboard, GapAndDevicesAreTold) {
    gap_t g{};
    g.alarm = 1;
    g.kind = "sensor";
    g.onset_stamp_us = 1'500'000;
    g.center_x_m = 0.02;
    g.center_y_m = g.center_z_m = std::nan("");
    snapshot.take(g);
    innovation_t i{};
    i.degrees_of_freedom = 30;
    i.nis = 45.0;
    snapshot.take(i);
    device_health_t d{};
    d.device = "camera.color";
    d.state = "stale";
    d.detail = "unplugged \xff";  // no UTF-8
    snapshot.take(d);
    const json state = json::parse(snapshot.state());
    EXPECT_TRUE(state["gap"]["alarm"]);
    EXPECT_EQ(state["gap"]["kind"], "sensor");
    EXPECT_NEAR(state["gap"]["onset_s"], 1.5, 1e-9);
    EXPECT_NEAR(state["gap"]["center_mm"][0], 20.0, 1e-9);
    EXPECT_TRUE(state["gap"]["center_mm"][1].is_null());
    EXPECT_NEAR(state["gap"]["nis_ratio"], 1.5, 1e-9);
    EXPECT_EQ(state["devices"][0]["state"], "stale");
}

TEST_F(Dashboard, LiverOfAnotherMeshIsNotShown) {
    liver_state_t m{};
    m.x_m = m.y_m = m.z_m = std::vector<float>(3, 0.0F);
    snapshot.take(m);
    EXPECT_TRUE(json::parse(snapshot.state())["nodes_m"].empty());
}

TEST_F(Dashboard, StrangersStayOutside) {
    EXPECT_FALSE(DashboardServer::start({"0.0.0.0", 0, ""}, snapshot)) << "beyond loopback without token";
    const auto server = serve("secret");
    httplib::Client client("127.0.0.1", server->port());
    for (const char* path : {"/", "/state", "/frame.jpg", "/state?token=secreT", "/state?token="})
        EXPECT_EQ(client.Get(path)->status, 403) << path;
    EXPECT_EQ(client.Get("/state?token=secret")->status, 200);
    EXPECT_EQ(client.Get("/state", {{"Cookie", "a=b; teres=secret; c=d"}})->status, 200);
    EXPECT_EQ(client.Get("/state", {{"Cookie", "teres=secrets"}})->status, 403);
    const auto open = serve();
    EXPECT_EQ(httplib::Client("127.0.0.1", open->port()).Get("/state", {{"Host", "evil.example:80"}})->status, 403)
        << "rebound name";
}

int count(const cv::Mat& picture, bool (*is)(const cv::Vec3b&)) {
    int pixels = 0;
    for (int v = 0; v < picture.rows; ++v)
        for (int u = 0; u < picture.cols; ++u) pixels += is(picture.at<cv::Vec3b>(v, u)) ? 1 : 0;
    return pixels;
}

// The page in a real browser: its script fills the tables, draws map and curves, shows the image, and the map turns.
TEST_F(Dashboard, PageIsDrawnAndAnswersTheMouse) {
    if (!test::Browser::installed())
        GTEST_SKIP() << "SKIPPED LOUDLY: no " << test::Browser::kProgram << " (apt install chromium)";
    const auto server = serve();
    test::Browser browser("http://127.0.0.1:" + std::to_string(server->port()) + "/", 1400, 1150);
    ASSERT_TRUE(browser.wait_until("mesh && state && document.getElementById('view').naturalWidth > 0"));
    EXPECT_EQ(browser.evaluate("document.getElementById('time').textContent"), "t = 1.90 s");
    EXPECT_EQ(browser.evaluate("document.getElementById('markers').rows[1].cells[1].textContent"), "12.3");
    EXPECT_EQ(browser.evaluate("document.getElementById('markers').rows[2].cells[1].textContent"), "missing");
    const auto picture = [&](const char* name) {
        const cv::Mat image = decoded(browser.screenshot());
        if (const char* keep = std::getenv("TERES_KEEP_PICTURES")) cv::imwrite(std::string(keep) + "/" + name, image);
        return image;
    };
    const cv::Mat before = picture("dashboard.png");
    ASSERT_FALSE(before.empty());
    EXPECT_GT(count(before, [](const cv::Vec3b& p) { return p[1] > 170 && p[0] < 60 && p[2] < 60; }), 10000)
        << "the image";
    EXPECT_GT(count(before, [](const cv::Vec3b& p) { return p[2] > 110 && p[1] < 80 && p[0] < 80; }), 300)
        << "attached part of the map";
    EXPECT_GT(count(before, [](const cv::Vec3b& p) { return p[0] > 220 && p[2] < 100; }), 100) << "first curve";

    // The same curves on a linear axis, and back.
    EXPECT_EQ(browser.evaluate("(() => { const c = document.getElementById('curves'), log = c.toDataURL(); "
                               "document.getElementById('log_axis').click();"
                               "drawCurves(state); const linear = c.toDataURL(); "
                               "document.getElementById('log_axis').click(); drawCurves(state);"
                               "return [log === linear, c.toDataURL() === log]; })()"),
              json::array({false, true}));

    // Half a turn about the vertical (120 px a radian): the clamped end goes to the other side.
    const auto red_side = [&](const char* name) {
        picture(name);
        return browser.evaluate(
            "(() => { const c = document.getElementById('map'), d = c.getContext('2d').getImageData(0, 0, c.width, "
            "440).data; let sum = 0, n = 0;"
            "for (let i = 0; i < d.length; i += 4) if (d[i] > 110 && d[i + 1] < 80 && d[i + 2] < 80) { sum += (i / 4) "
            "% c.width; n++; }"
            "return n ? sum / n / c.width : null; })()");
    };
    const json box = browser.evaluate(
        "(() => { const r = document.getElementById('map').getBoundingClientRect(); return [r.left, r.top, r.width, "
        "r.height]; })()");
    const double u = box[0].get<double>() + 0.2 * box[2].get<double>(),
                 v = box[1].get<double>() + 0.5 * box[3].get<double>();
    const json left = red_side("dashboard.png");
    browser.drag(u, v, u + 120.0 * 3.14, v);
    const json right = red_side("dashboard-turned.png");
    ASSERT_TRUE(left.is_number() && right.is_number());
    EXPECT_LT(left, 0.4);
    EXPECT_GT(right, 0.6);
}

TEST_F(Dashboard, PageSaysWhenNothingComesAnyMore) {
    if (!test::Browser::installed())
        GTEST_SKIP() << "SKIPPED LOUDLY: no " << test::Browser::kProgram << " (apt install chromium)";
    auto server = serve();
    test::Browser browser("http://127.0.0.1:" + std::to_string(server->port()) + "/", 1000, 800);
    ASSERT_TRUE(browser.wait_until("state"));
    server.reset();
    EXPECT_TRUE(browser.wait_until("document.getElementById('time').textContent === 'no connection'"));
}

}  // namespace
}  // namespace teres
