// Where the plugins of this folder are after the build.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

namespace teres::test {

inline std::filesystem::path plugin_folder() {
    const char* build = std::getenv("TERES_BUILD_DIR");
    return std::filesystem::path(build != nullptr ? build : ".") / "lib/teres/test_plugins";
}
inline std::filesystem::path plugin_file(const std::string& id) {
    return plugin_folder() / ("teres_" + id + ".so");
}

}  // namespace teres::test
