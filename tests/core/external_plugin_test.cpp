// Somebody else's plugin: Teres is really installed, the plugin is really built outside of the tree against
// nothing but the installed headers, and the host loads and steps it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "core/session.h"
#include "teres/markers_t.hpp"
#include "tests/core/plugins/test_plugins.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

namespace fs = std::filesystem;

std::string text_of(const fs::path& file) {
    std::ifstream stream(file);
    return {std::istreambuf_iterator<char>(stream), {}};
}

// Runs a shell command with its output in `log`.
testing::AssertionResult runs(const std::string& command, const fs::path& log) {
    if (std::system((command + " >>" + log.string() + " 2>&1").c_str()) == 0) return testing::AssertionSuccess();
    return testing::AssertionFailure() << command << "\n" << text_of(log);
}

TEST(ExternalPlugin, BuildsAgainstInstalledHeadersAndSteps) {
    test::ScratchFolder scratch;
    const fs::path log = scratch.path() / "log", prefix = scratch.path() / "prefix", build = scratch.path() / "build";
    const fs::path source = scratch.path() / "centroid";
    // Copied away, so that no relative path can reach into the tree.
    fs::copy(fs::path(std::getenv("TERES_SOURCE_DIR")) / "tests/core/external_plugin", source);
    ASSERT_TRUE(runs("cmake --install " + std::string(std::getenv("TERES_BUILD_DIR")) + " --component sdk --prefix " +
                         prefix.string(),
                     log));
    ASSERT_TRUE(
        runs("cmake -S " + source.string() + " -B " + build.string() + " -DCMAKE_PREFIX_PATH=" + prefix.string(), log));
    ASSERT_TRUE(runs("cmake --build " + build.string(), log));
    ASSERT_TRUE(runs("cmake --install " + build.string(), log));
    const std::string read_by_compiler = text_of(build / "CMakeFiles/teres_centroid.dir/centroid.cpp.o.d");
    EXPECT_THAT(read_by_compiler, testing::HasSubstr((prefix / "include/teres/core/plugin_sdk.h").string()));
    EXPECT_THAT(read_by_compiler, testing::Not(testing::HasSubstr(std::getenv("TERES_SOURCE_DIR"))));
    EXPECT_THAT(read_by_compiler, testing::Not(testing::HasSubstr(std::getenv("TERES_BUILD_DIR"))));
    EXPECT_TRUE(fs::exists(prefix / "lib/teres/plugins/teres_centroid.so")) << text_of(log);

    auto config = Config::parse("[service]\nplugin_folder = \"" + test::plugin_folder().string() +
                                    "\"\ndrivers = [\"ramp\"]\nplugins = [\"" +
                                    (prefix / "lib/teres/plugins/teres_centroid.so").string() +
                                    "\"]\n[ramp]\nframes = 5\n[centroid]\nmin_markers = 1\n",
                                "test.toml", "/nowhere");
    ASSERT_TRUE(config) << config.error().text;
    auto session = Session::open(*config);
    ASSERT_TRUE(session) << session.error().text;
    std::vector<double> x;
    ASSERT_TRUE((*session)->subscribe<markers_t>("CENTROID", 1 << 16,
                                                 [&](const markers_t& message) { x.push_back(message.x_m.at(0)); }));
    ASSERT_TRUE((*session)->start());
    ASSERT_TRUE((*session)->run_until_finished());
    EXPECT_THAT(x, testing::ElementsAre(0.001, 0.002, 0.003, 0.004, 0.005));  // the ramp: 1 mm a frame

    // Its settings are checked like those of our own units.
    ASSERT_TRUE(config->set("centroid.min_markers=0"));
    EXPECT_EQ(Session::open(*config).error().text, "--set: centroid.min_markers = 0 is below the bound 1");
}

}  // namespace
}  // namespace teres
