// What `teres doctor` looks at: is this machine fit to run the service with these settings? Each check says
// what it found and, unless all is well, what to do about it. The figures behind the limits: 640x480 colour
// and depth at 30 Hz lose half of their frames with the kernel's default buffers (rmem 212992 bytes), none
// with 1 MiB and more.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/config.h"

namespace teres::tools {

enum class CheckState { kOk, kWarn, kFail };

struct Check {
    std::string name;
    CheckState state = CheckState::kOk;
    std::string found;
    std::string remedy;  ///< empty if ok
};

/// Where to look; tests put folders of their own here.
struct HostView {
    std::filesystem::path proc = "/proc";
    std::filesystem::path dev = "/dev";
    std::filesystem::path sys = "/sys";
    std::filesystem::path root = "/";
};

std::vector<Check> check_settings(const Config& config);  ///< plugins, sections, case folder, recording
std::vector<Check> check_network(const Config& config, const HostView& host);
std::vector<Check> check_devices(const Config& config, const HostView& host);
std::vector<Check> check_appliance(const HostView& host);  ///< units, kernel settings and rules of the package
std::vector<Check> check_process(const Config& config);    ///< locked memory, service manager

const char* state_word(CheckState state);

}  // namespace teres::tools
