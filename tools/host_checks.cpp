#include "tools/host_checks.h"

#include <arpa/inet.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <net/route.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <optional>
#include <sstream>

#include "core/bus.h"
#include "core/case/case_reader.h"
#include "core/plugin_host.h"
#include "core/session.h"
#include "drivers/device/usb_tree.h"

namespace teres::tools {
namespace {

namespace fs = std::filesystem;

// LCM's default group; the route to it decides whether udpm:// works and whether packets leave the machine.
constexpr const char* kGroup = "239.255.76.67";
constexpr const char* kLoopbackRemedy = "ip link set lo multicast on; ip route add 239.255.76.67/32 dev lo";
constexpr long kMinRmemMax = 16L << 20, kRmemMax = 33554432, kMinRmemDefault = 4L << 20;
constexpr long kMaxIpfragTime = 5, kMinIpfragThreshold = 134217728;
constexpr int kWantedReceiveBuffer = 16 << 20;

Check ok(const std::string& name, const std::string& found) {
    return {name, CheckState::kOk, found, ""};
}
Check warn(const std::string& name, const std::string& found, const std::string& remedy) {
    return {name, CheckState::kWarn, found, remedy};
}
Check fail(const std::string& name, const std::string& found, const std::string& remedy) {
    return {name, CheckState::kFail, found, remedy};
}

// Which BLAS the simulation would get.
Check linear_algebra() {
    const char* name = "linear algebra";
    if (dlopen("libblas.so.3", RTLD_LAZY) == nullptr)
        return fail(name, dlerror(), "apt-get install libopenblas0-pthread");
    void* library = dlopen("libopenblas.so.0", RTLD_NOLOAD | RTLD_LAZY);
    void* parallel = library != nullptr ? dlsym(library, "openblas_get_parallel") : nullptr;
    if (parallel == nullptr) return warn(name, "not OpenBLAS: slow", "apt-get install libopenblas0-pthread");
    if (reinterpret_cast<int (*)()>(parallel)() == 0)
        return warn(name, "OpenBLAS without locks: threads of the simulation wait for each other",
                    "apt-get install libopenblas0-pthread");
    return ok(name, "OpenBLAS");
}

// Closes with the scope.
class Descriptor {
  public:
    explicit Descriptor(int fd) : fd_(fd) {}
    ~Descriptor() {
        if (fd_ >= 0) close(fd_);
    }
    Descriptor(const Descriptor&) = delete;
    Descriptor& operator=(const Descriptor&) = delete;
    int get() const { return fd_; }

  private:
    int fd_;
};

std::optional<long> read_sysctl(const HostView& host, const std::string& key) {
    std::string path = key;
    std::replace(path.begin(), path.end(), '.', '/');
    std::ifstream stream(host.proc / "sys" / path);
    long value = 0;
    if (!(stream >> value)) return std::nullopt;
    return value;
}

Check check_sysctl(const HostView& host, const std::string& key, long bound, bool at_least, long set_to,
                   const std::string& why) {
    const auto value = read_sysctl(host, key);
    const std::string remedy = "sysctl -w " + key + "=" + std::to_string(set_to) + " (and in /etc/sysctl.d): " + why;
    if (!value) return warn(key, "cannot be read", remedy);
    const bool good = at_least ? *value >= bound : *value <= bound;
    if (good) return ok(key, std::to_string(*value));
    return warn(key, std::to_string(*value) + (at_least ? ", below " : ", above ") + std::to_string(bound), remedy);
}

// Interface by which the kernel sends to `address` (network byte order): longest prefix in /proc/net/route,
// whose numbers are hexadecimal in network byte order too. Empty: no route.
std::string interface_to(const HostView& host, std::uint32_t address) {
    std::ifstream table(host.proc / "net/route");
    std::string line, best;
    std::uint32_t best_mask = 0;
    std::getline(table, line);  // names of the columns
    while (std::getline(table, line)) {
        std::istringstream row(line);
        std::string interface;
        std::uint32_t destination = 0, gateway = 0, flags = 0, references = 0, uses = 0, metric = 0, mask = 0;
        row >> interface >> std::hex >> destination >> gateway >> flags >> std::dec >> references >> uses >> metric >>
            std::hex >> mask;
        const bool usable = row && (flags & RTF_UP) != 0 && (flags & RTF_REJECT) == 0;
        if (!usable || (address & mask) != destination) continue;
        if (best.empty() || ntohl(mask) > ntohl(best_mask)) {
            best = interface;
            best_mask = mask;
        }
    }
    return best;
}

Check check_route(const HostView& host, bool needed) {
    const std::string name = "multicast route";
    in_addr group{};
    inet_pton(AF_INET, kGroup, &group);
    const std::string interface = interface_to(host, group.s_addr);
    const std::string found = kGroup + std::string(interface.empty() ? ": none" : " by " + interface);
    if (interface == "lo") return ok(name, found);
    if (!interface.empty()) return warn(name, found + ": only ttl=0 keeps packets on this machine", kLoopbackRemedy);
    return needed ? fail(name, found, kLoopbackRemedy)
                  : warn(name, found + "; memq:// does not need it", kLoopbackRemedy);
}

Check check_receive_buffer() {
    const std::string name = "receive buffer";
    const Descriptor socket_fd(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    int wanted = kWantedReceiveBuffer, got = 0;
    socklen_t size = sizeof(got);
    if (setsockopt(socket_fd.get(), SOL_SOCKET, SO_RCVBUF, &wanted, sizeof(wanted)) != 0 ||
        getsockopt(socket_fd.get(), SOL_SOCKET, SO_RCVBUF, &got, &size) != 0)
        return warn(name, std::strerror(errno), "see socket(7), SO_RCVBUF");
    got /= 2;  // the kernel reports twice the size, socket(7)
    const std::string found = "asked for " + std::to_string(wanted) + " bytes, got " + std::to_string(got);
    if (got >= wanted) return ok(name, found);
    return warn(name, found + " (capped)", "sysctl -w net.core.rmem_max=" + std::to_string(kRmemMax));
}

// There and back over the configured bus; -1 if it did not come back.
int round_trip_ms(Bus& bus, const std::string& channel, std::size_t size, const bool& back) {
    const std::vector<std::uint8_t> sent(size, 0x5a);
    const auto begin = std::chrono::steady_clock::now();
    // A few attempts: the group may take a moment to be joined.
    for (int attempt = 0; attempt < 3 && !back; ++attempt) {
        bus.publish(channel, sent);
        for (int wait = 0; wait < 20 && !back; ++wait) bus.dispatch(50);
    }
    const auto took = std::chrono::steady_clock::now() - begin;
    return back ? static_cast<int>(std::chrono::duration_cast<std::chrono::milliseconds>(took).count()) : -1;
}

// A small message (markers, loads) and one megabyte (an image).
Check check_bus(const std::string& url) {
    const std::string name = "bus " + url;
    auto bus = Bus::open(url);
    if (!bus) return fail(name, bus.error().text, kLoopbackRemedy);
    bool small_back = false, large_back = false;
    const std::string channel = "TERES_DOCTOR_" + std::to_string(getpid());
    for (auto [suffix, back] : {std::pair{"_SMALL", &small_back}, {"_LARGE", &large_back}}) {
        const Status heard =
            bus->subscribe(channel + suffix, 1 << 20, [back = back](auto, auto, auto) { *back = true; });
        if (!heard) return fail(name, heard.error().text, kLoopbackRemedy);
    }
    if (round_trip_ms(*bus, channel + "_SMALL", 1 << 10, small_back) < 0)
        return fail(name, "1 KiB was published but did not come back",
                    "look for a firewall rule on udp port 7667, and at the route");
    const int took_ms = round_trip_ms(*bus, channel + "_LARGE", 1 << 20, large_back);
    if (took_ms < 0)
        return warn(name, "1 KiB came back, 1 MiB (an image) did not",
                    "larger receive buffers, see above, and &recv_buf_size=16777216 in service.bus_url");
    return ok(name, "1 MiB there and back in " + std::to_string(took_ms) + " ms");
}

Check check_folder_for(const fs::path& file) {
    const std::string name = "recording";
    const fs::path folder = file.parent_path();
    if (access(folder.c_str(), W_OK | X_OK) != 0)
        return fail(name, folder.string() + ": " + std::strerror(errno),
                    "create the folder and let the service's user write to it");
    std::error_code failure;
    const auto space = fs::space(folder, failure);
    const double free_gb = failure ? 0.0 : static_cast<double>(space.available) / 1e9;
    char found[64];
    std::snprintf(found, sizeof(found), "%.1f GB free in ", free_gb);
    // Raw colour and depth write 46 MB/s: 5 GB is two minutes.
    if (free_gb < 5.0) return warn(name, found + folder.string(), "free space, or set service.record_max_mb");
    return ok(name, found + folder.string());
}

}  // namespace

const char* state_word(CheckState state) {
    return state == CheckState::kOk ? "ok" : state == CheckState::kWarn ? "warn" : "fail";
}

std::vector<Check> check_settings(const Config& config) {
    std::vector<Check> checks;
    const ServiceSettings& settings = config.service();
    const auto folders = plugin_folders(settings.plugin_folder);
    std::vector<std::string> used = settings.drivers;
    used.insert(used.end(), settings.plugins.begin(), settings.plugins.end());
    std::vector<std::string> all = used;
    for (const std::string& id : available_plugins(folders))
        if (std::find(all.begin(), all.end(), id) == all.end()) all.push_back(id);
    for (const std::string& id : all) {
        const bool in_use = std::find(used.begin(), used.end(), id) != used.end();
        const std::string name = "plugin " + id;
        const auto file = find_plugin(id, folders);
        const auto plugin = file ? load_plugin(*file) : tl::unexpected(file.error());
        std::error_code failure;
        if (!plugin) {
            checks.push_back({name, in_use ? CheckState::kFail : CheckState::kWarn, plugin.error().text,
                              "install a version that fits, or take it out of [service]"});
        } else if ((fs::status(*file, failure).permissions() & fs::perms::others_write) != fs::perms::none) {
            checks.push_back(
                warn(name, file->string() + " can be written by everybody", "chmod o-w " + file->string()));
        } else {
            checks.push_back(ok(name, plugin->version + ", API " + std::to_string(plugin->api_major) + "." +
                                          std::to_string(plugin->api_minor) + (in_use ? "" : ", not in use")));
        }
    }
    if (const Status sound = Session::check(config); sound)
        checks.push_back(ok("settings", "every section and key is known and within its range"));
    else
        checks.push_back(fail("settings", sound.error().text, "correct it; `teres settings` lists what there is"));

    if (!settings.case_folder.empty()) {
        const auto read = read_case(settings.case_folder);
        if (read)
            checks.push_back(ok("case", settings.case_folder.string() + ": " + std::to_string(read->mesh.tets.size()) +
                                            " tetrahedra, " + std::to_string(read->markers.size()) + " markers, " +
                                            std::to_string(read->num_frames) + " frames"));
        else
            checks.push_back(fail("case", read.error().text, "correct the case folder or service.case"));
    }
    if (!settings.record_to.empty()) checks.push_back(check_folder_for(settings.record_to));
    return checks;
}

std::vector<Check> check_network(const Config& config, const HostView& host) {
    const bool udpm = config.service().bus_url.starts_with("udpm://");
    std::vector<Check> checks;
    checks.push_back(check_route(host, udpm));
    checks.push_back(
        check_sysctl(host, "net.core.rmem_max", kMinRmemMax, true, kRmemMax, "image messages are lost otherwise"));
    checks.push_back(check_sysctl(host, "net.core.rmem_default", kMinRmemDefault, true, kMinRmemDefault,
                                  "for LCM tools that set no buffer of their own"));
    checks.push_back(check_receive_buffer());
    checks.push_back(check_sysctl(host, "net.ipv4.ipfrag_time", kMaxIpfragTime, false, 2,
                                  "one lost frame in a thousand otherwise blocks reassembly for 30 s"));
    checks.push_back(check_sysctl(host, "net.ipv4.ipfrag_high_thresh", kMinIpfragThreshold, true, kMinIpfragThreshold,
                                  "room for image messages in reassembly"));
    if (udpm || config.service().bus_url.starts_with("memq://")) checks.push_back(check_bus(config.service().bus_url));
    return checks;
}

namespace {

bool in_use(const Config& config, const std::string& driver) {
    const auto& drivers = config.service().drivers;
    return std::find(drivers.begin(), drivers.end(), driver) != drivers.end();
}

// One setting of a unit in use, as it would get it; empty if the unit is not installed.
std::string setting_text(const Config& config, const std::string& unit, const std::string& key) {
    const auto file = find_plugin(unit, plugin_folders(config.service().plugin_folder));
    const auto plugin = file ? load_plugin(*file) : tl::unexpected(file.error());
    const teres_factory* factory = plugin ? plugin->factory(unit) : nullptr;
    if (factory == nullptr) return "";
    const auto settings = config.resolve(unit, std::span(factory->settings, factory->num_settings));
    if (!settings) return "";
    for (const teres_setting_value& value : settings->values)
        if (value.key == key && value.text != nullptr) return value.text;
    return "";
}

Check check_node(const VideoNode& node, bool needed) {
    const std::string name = "video " + node.node.filename().string();
    const Descriptor device(open(node.node.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC));
    v4l2_capability capability{};
    if (device.get() < 0) {
        const std::string remedy = errno == EACCES ? "usermod -aG video USER, or SupplementaryGroups=video in the unit"
                                                   : "is the camera still connected?";
        return {name, needed ? CheckState::kFail : CheckState::kWarn, std::strerror(errno), remedy};
    }
    if (ioctl(device.get(), VIDIOC_QUERYCAP, &capability) != 0)
        return warn(name, "is not a video device", "look at dmesg");
    const auto* card = reinterpret_cast<const char*>(capability.card);
    std::string found(card, strnlen(card, sizeof(capability.card)));
    if (!node.id.empty()) found += ", " + node.id + (node.serial.empty() ? "" : " serial " + node.serial);
    if (node.usb_mbps > 480) found += ", USB " + std::to_string(node.usb_mbps) + " Mbit/s";
    if (node.usb_mbps > 0 && node.usb_mbps <= 480)
        return warn(name, found + ", on a USB 2 link (" + std::to_string(node.usb_mbps) + " Mbit/s)",
                    "a USB 3 port and cable: colour and depth at 30 Hz need 295 Mbit/s");
    return ok(name, found);
}

// The cameras that the settings name, by serial number or vendor:product.
Check check_camera(const std::string& stream, const std::string& device, const std::vector<VideoNode>& nodes) {
    const std::string name = "camera " + stream;
    for (const VideoNode& node : nodes)
        if (node.serial == device || node.id == device) return ok(name, device + " is connected");
    for (const VideoNode& node : nodes)
        if (node.id.starts_with("8086:"))
            return warn(name, device + " is not the serial number of any USB device",
                        "if it is the one printed on a RealSense the service finds it; see serial above else");
    return fail(name, device + " is not connected",
                "plug it in; camera." + stream + "_device takes a serial number from above");
}

Check check_footswitch(const std::string& id, const HostView& host) {
    const std::string name = "footswitch";
    std::error_code failure;
    for (fs::directory_iterator at(host.sys / "bus/usb/devices", failure), end; !failure && at != end;
         at.increment(failure)) {
        const auto attribute = [&](const char* key) {
            std::ifstream stream(at->path() / key);
            std::string text;
            std::getline(stream, text);
            return text;
        };
        if (attribute("idVendor") + ":" + attribute("idProduct") != id) continue;
        char node[32];
        std::snprintf(node, sizeof node, "bus/usb/%03d/%03d", std::atoi(attribute("busnum").c_str()),
                      std::atoi(attribute("devnum").c_str()));
        const fs::path file = host.dev / node;
        if (access(file.c_str(), R_OK | W_OK) == 0) return ok(name, id + " at " + file.string());
        return fail(name, file.string() + ": " + std::strerror(errno),
                    "install config/appliance/60-teres.rules in /usr/lib/udev/rules.d; SupplementaryGroups=plugdev in "
                    "the unit");
    }
    return fail(name, id + " is not connected", "plug it in; pedal.device names vendor:product");
}

}  // namespace

std::vector<Check> check_devices(const Config& config, const HostView& host) {
    const bool needed = in_use(config, "camera");
    std::vector<VideoNode> nodes = video_nodes({host.sys, host.dev});
    std::error_code failure;
    for (fs::directory_iterator at(host.dev, failure), end; !failure && at != end; at.increment(failure)) {
        const auto same = [&](const VideoNode& node) { return node.node == at->path(); };
        if (at->path().filename().string().starts_with("video") && std::none_of(nodes.begin(), nodes.end(), same)) {
            nodes.emplace_back();
            nodes.back().node = at->path();
        }
    }
    std::vector<Check> checks;
    if (nodes.empty())
        checks.push_back(needed ? fail("video devices", "none", "connect the camera; look at dmesg and lsusb")
                                : ok("video devices", "none (no camera driver in use)"));
    for (const VideoNode& node : nodes) checks.push_back(check_node(node, needed));
    if (needed) {
        for (const char* stream : {"color", "depth", "left", "right"}) {
            const std::string device = setting_text(config, "camera", std::string(stream) + "_device");
            if (!device.empty()) checks.push_back(check_camera(stream, device, nodes));
        }
    }
    if (in_use(config, "pedal")) checks.push_back(check_footswitch(setting_text(config, "pedal", "device"), host));
    return checks;
}

std::vector<Check> check_appliance(const HostView& host) {
    const auto there = [&](const char* file) {
        std::error_code failure;
        return fs::exists(fs::symlink_status(host.root / file, failure));
    };
    if (!there("usr/lib/systemd/system/teres.service") && !there("etc/systemd/system/teres.service"))
        return {ok("service", "not installed on this machine")};
    std::vector<Check> checks;
    for (const std::string unit : {"teres.service", "teres-multicast.service", "teres-firewall.service"}) {
        const bool enabled = there(("etc/systemd/system/multi-user.target.wants/" + unit).c_str());
        const bool running = there(("run/systemd/units/invocation:" + unit).c_str());
        if (!enabled)
            checks.push_back(fail(unit, "does not start on boot", "systemctl enable --now " + unit));
        else if (!running)
            checks.push_back(fail(unit, "is not running", "systemctl start " + unit + "; journalctl -u " + unit));
        else
            checks.push_back(ok(unit, "starts on boot, is running"));
    }
    for (const auto& [file, what] : {std::pair{"usr/lib/sysctl.d/60-teres.conf", "kernel settings after a boot"},
                                     {"usr/lib/udev/rules.d/60-teres.rules", "access to USB devices"},
                                     {"usr/lib/systemd/journald.conf.d/60-teres.conf", "size of the log"}})
        checks.push_back(there(file)
                             ? ok(what, file)
                             : warn(what, std::string(file) + " is missing", "install the package teres again"));
    return checks;
}

std::vector<Check> check_process(const Config& config) {
    std::vector<Check> checks;
    rlimit limit{};
    getrlimit(RLIMIT_MEMLOCK, &limit);
    const bool unlimited = limit.rlim_cur == RLIM_INFINITY || geteuid() == 0;
    const std::string found = unlimited ? "no limit" : std::to_string(limit.rlim_cur / 1024) + " KiB";
    if (unlimited || !config.service().lock_memory)
        checks.push_back(
            ok("locked memory", found + (config.service().lock_memory ? "" : " (service.lock_memory is false)")));
    else
        checks.push_back(
            fail("locked memory", found, "LimitMEMLOCK=infinity in the unit, or service.lock_memory = false"));

    checks.push_back(linear_algebra());

    const char* notify = std::getenv("NOTIFY_SOCKET");
    const char* watchdog = std::getenv("WATCHDOG_USEC");
    if (notify == nullptr) {
        checks.push_back(ok("service manager", "not started by one"));
    } else if (watchdog == nullptr) {
        checks.push_back(warn("service manager", "notified, but without a watchdog", "WatchdogSec=2 in the unit"));
    } else {
        char* end = nullptr;
        const long long usec = std::strtoll(watchdog, &end, 10);
        if (*watchdog == '\0' || *end != '\0' || usec <= 0)
            checks.push_back(fail("service manager", std::string("WATCHDOG_USEC = '") + watchdog + "' is no time",
                                  "WatchdogSec=2 in the unit"));
        else if (!config.service().watchdog)
            checks.push_back(fail("service manager",
                                  "it watches, but service.watchdog is false: the service would be killed",
                                  "service.watchdog = true"));
        else
            checks.push_back(ok("service manager", "watchdog every " + std::to_string(usec / 1000) + " ms"));
    }
    return checks;
}

}  // namespace teres::tools
