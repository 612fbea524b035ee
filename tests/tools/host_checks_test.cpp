// Each check against a made-up host: what is good, what is bad, what to do.
#include "tools/host_checks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "tests/core/plugins/test_plugins.h"
#include "tests/support/private_network.h"
#include "tests/support/test_data.h"

namespace teres::tools {
namespace {

using testing::HasSubstr;

Check named(const std::vector<Check>& checks, const std::string& name) {
    for (const Check& check : checks)
        if (check.name == name) return check;
    ADD_FAILURE() << "no check named " << name;
    return {};
}

class HostChecks : public testing::Test {
  protected:
    void SetUp() override {
        set("net/core/rmem_max", 33554432);
        set("net/core/rmem_default", 4194304);
        set("net/ipv4/ipfrag_time", 2);
        set("net/ipv4/ipfrag_high_thresh", 134217728);
        std::filesystem::create_directories(host_.dev);
    }
    void set(const std::string& key, long value) {
        const auto file = host_.proc / "sys" / key;
        std::filesystem::create_directories(file.parent_path());
        std::ofstream(file) << value << '\n';
    }
    Check sysctl(const std::string& name) { return named(check_network(Config{}, host_), name); }

    test::ScratchFolder scratch_;
    HostView host_{scratch_.path() / "proc", scratch_.path() / "dev", scratch_.path() / "sys", scratch_.path()};
};

TEST_F(HostChecks, RecommendedKernelSettingsAreOk) {
    for (const char* key :
         {"net.core.rmem_max", "net.core.rmem_default", "net.ipv4.ipfrag_time", "net.ipv4.ipfrag_high_thresh"})
        EXPECT_EQ(sysctl(key).state, CheckState::kOk) << key;
}

TEST_F(HostChecks, KernelDefaultsAreWarningsWithRemedy) {
    set("net/core/rmem_max", 212992);
    set("net/core/rmem_default", 212992);
    set("net/ipv4/ipfrag_time", 30);
    set("net/ipv4/ipfrag_high_thresh", 4194304);
    const Check receive = sysctl("net.core.rmem_max");
    EXPECT_EQ(receive.state, CheckState::kWarn);
    EXPECT_EQ(receive.found, "212992, below 16777216");
    EXPECT_THAT(receive.remedy, HasSubstr("sysctl -w net.core.rmem_max=33554432"));
    EXPECT_EQ(sysctl("net.core.rmem_default").state, CheckState::kWarn);
    EXPECT_EQ(sysctl("net.ipv4.ipfrag_time").found, "30, above 5");
    EXPECT_EQ(sysctl("net.ipv4.ipfrag_high_thresh").state, CheckState::kWarn);
}

TEST_F(HostChecks, UnreadableKernelSettingIsAWarning) {
    std::filesystem::remove(host_.proc / "sys/net/core/rmem_max");
    EXPECT_EQ(sysctl("net.core.rmem_max").found, "cannot be read");
}

TEST_F(HostChecks, CameraThatIsNeededMustBeThere) {
    Config config;
    EXPECT_EQ(named(check_devices(config, host_), "video devices").state, CheckState::kOk);
    ASSERT_TRUE(config.set("service.drivers=camera"));
    EXPECT_EQ(named(check_devices(config, host_), "video devices").state, CheckState::kFail);
}

TEST_F(HostChecks, NodeThatIsNoCameraIsToldApart) {
    std::ofstream(host_.dev / "video0") << "not a device";
    const Check check = named(check_devices(Config{}, host_), "video video0");
    EXPECT_EQ(check.state, CheckState::kWarn);
    EXPECT_EQ(check.found, "is not a video device");
}

TEST_F(HostChecks, ServiceMustStartOnBootAndRun) {
    EXPECT_EQ(named(check_appliance(host_), "service").found, "not installed on this machine");
    const auto touch = [&](const std::string& file) {
        std::filesystem::create_directories((scratch_.path() / file).parent_path());
        std::ofstream(scratch_.path() / file) << "x";
    };
    for (const char* unit : {"teres", "teres-multicast", "teres-firewall"})
        touch(std::string("usr/lib/systemd/system/") + unit + ".service");
    EXPECT_EQ(named(check_appliance(host_), "teres.service").remedy, "systemctl enable --now teres.service");
    touch("etc/systemd/system/multi-user.target.wants/teres.service");
    EXPECT_EQ(named(check_appliance(host_), "teres.service").found, "is not running");
    touch("run/systemd/units/invocation:teres.service");
    EXPECT_EQ(named(check_appliance(host_), "teres.service").state, CheckState::kOk);
    EXPECT_EQ(named(check_appliance(host_), "teres-firewall.service").state, CheckState::kFail);
    EXPECT_EQ(named(check_appliance(host_), "access to USB devices").state, CheckState::kWarn);
    touch("usr/lib/udev/rules.d/60-teres.rules");
    EXPECT_EQ(named(check_appliance(host_), "access to USB devices").state, CheckState::kOk);
}

TEST_F(HostChecks, WatchdogThatWouldKillTheServiceFails) {
    Config config;
    setenv("NOTIFY_SOCKET", "/run/none", 1);
    EXPECT_EQ(named(check_process(config), "service manager").state, CheckState::kWarn);
    setenv("WATCHDOG_USEC", "2000000", 1);
    EXPECT_EQ(named(check_process(config), "service manager").found, "watchdog every 2000 ms");
    ASSERT_TRUE(config.set("service.watchdog=false"));
    EXPECT_EQ(named(check_process(config), "service manager").state, CheckState::kFail);
    setenv("WATCHDOG_USEC", "soon", 1);
    EXPECT_EQ(named(check_process(config), "service manager").state, CheckState::kFail);
    unsetenv("WATCHDOG_USEC");
    unsetenv("NOTIFY_SOCKET");
    EXPECT_EQ(named(check_process(config), "service manager").state, CheckState::kOk);
}

TEST_F(HostChecks, FolderOfTheRecordingMustBeThere) {
    Config config;
    for (const auto& assignment :
         {"service.plugin_folder=" + test::plugin_folder().string(), std::string("service.drivers=ramp"),
          std::string("service.plugins=echo"), std::string("service.record_to=/no/such/folder/run.lcm")})
        ASSERT_TRUE(config.set(assignment));
    EXPECT_EQ(named(check_settings(config), "recording").state, CheckState::kFail);
    ASSERT_TRUE(config.set("service.record_to=" + (scratch_.path() / "run.lcm").string()));
    EXPECT_NE(named(check_settings(config), "recording").state, CheckState::kFail);
    EXPECT_EQ(named(check_settings(config), "settings").state, CheckState::kOk);
    EXPECT_EQ(named(check_settings(config), "plugin ramp").state, CheckState::kOk);
}

constexpr const char* kRouteColumns =
    "Iface\tDestination\tGateway\tFlags\tRefCnt\tUse\tMetric\tMask\tMTU\tWindow\tIRTT\n";
constexpr const char* kDefaultByEth = "eth0\t00000000\t0102A8C0\t0003\t0\t0\t0\t00000000\t0\t0\t0\n";
constexpr const char* kGroupByLo = "lo\t434CFFEF\t00000000\t0005\t0\t0\t0\tFFFFFFFF\t0\t0\t0\n";

TEST_F(HostChecks, LongestRouteToTheGroupCounts) {
    std::filesystem::create_directories(host_.proc / "net");
    const auto route = [&](const std::string& rows) {
        std::ofstream(host_.proc / "net/route") << kRouteColumns << rows;
        return sysctl("multicast route");
    };
    EXPECT_EQ(route("").state, CheckState::kWarn);
    EXPECT_EQ(route(kDefaultByEth).state, CheckState::kWarn);
    EXPECT_THAT(route(kDefaultByEth).found, HasSubstr("by eth0: only ttl=0"));
    EXPECT_EQ(route(std::string(kDefaultByEth) + kGroupByLo).found, "239.255.76.67 by lo");
    EXPECT_EQ(route(std::string(kGroupByLo) + kDefaultByEth).state, CheckState::kOk);
}

// Last: the network of this process changes for good. The route of the real kernel, and a real packet over
// it.
TEST_F(HostChecks, ZUdpmNeedsItsRoute) {
    TERES_REQUIRE_PRIVATE_NETWORK();
    host_.proc = "/proc";
    const std::string url = std::string(test::kLoopbackUrl) + "&recv_buf_size=4194304";
    Config config;
    ASSERT_TRUE(config.set("service.bus_url=" + url));
    const auto good = check_network(config, host_);
    EXPECT_EQ(named(good, "multicast route").state, CheckState::kOk) << named(good, "multicast route").found;
    EXPECT_NE(named(good, "bus " + url).state, CheckState::kFail) << named(good, "bus " + url).found;

    ASSERT_TRUE(test::set_loopback(false));
    const auto bad = check_network(config, host_);
    EXPECT_EQ(named(bad, "multicast route").state, CheckState::kFail);
    EXPECT_THAT(named(bad, "multicast route").remedy, HasSubstr("ip route add 239.255.76.67/32 dev lo"));
    EXPECT_EQ(named(bad, "bus " + url).state, CheckState::kFail);
    EXPECT_EQ(named(check_network(Config{}, host_), "multicast route").state, CheckState::kWarn)
        << "memq:// does without";
}

}  // namespace
}  // namespace teres::tools
