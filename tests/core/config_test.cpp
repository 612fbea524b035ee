// Settings files: what is refused, and with which words (place, value, bound).
#include "core/config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/test_data.h"

namespace teres {
namespace {

using testing::ElementsAre;

const teres_setting kEstimator[] = {
    {"num_groups", "", nullptr, nullptr, 8.0, 1.0, 64.0, TERES_SETTING_INTEGER},
    {"spring_k1_n_per_m", "", nullptr, nullptr, 100.0, 0.0, 1e9, TERES_SETTING_NUMBER},
    {"law", "", "cubic", "linear|cubic", 0.0, 0.0, 0.0, TERES_SETTING_TEXT},
    {"gate", "", nullptr, nullptr, 1.0, 0.0, 1.0, TERES_SETTING_BOOLEAN},
    {"case", "", "", "", 0.0, 0.0, 0.0, TERES_SETTING_TEXT},
    {"atlas", "", "", nullptr, 0.0, 0.0, 0.0, TERES_SETTING_PATH},
};

Config parsed(const std::string& text) {
    auto config = Config::parse(text, "phantom.toml", "/etc/teres");
    EXPECT_TRUE(config) << config.error().text;
    return config ? *config : Config{};
}

std::string parse_error(const std::string& text) {
    const auto config = Config::parse(text, "phantom.toml", "/etc/teres");
    if (config) return "";
    EXPECT_EQ(config.error().kind, ErrorKind::kInvalidInput);
    return config.error().text;
}

std::string resolve_error(const std::string& text) {
    const auto resolved = parsed(text).resolve("estimator", kEstimator);
    return resolved ? "" : resolved.error().text;
}

TEST(Config, DefaultsHoldWithoutAFile) {
    const Config config;
    EXPECT_EQ(config.service().bus_url, "memq://");
    EXPECT_THAT(config.service().drivers, ElementsAre("replay"));
    EXPECT_THAT(config.service().plugins, ElementsAre("simulation", "estimator"));
    const auto resolved = config.resolve("estimator", kEstimator);
    ASSERT_TRUE(resolved);
    ASSERT_EQ(resolved->values.size(), 6u);
    EXPECT_EQ(resolved->values[0].number, 8.0);
    EXPECT_STREQ(resolved->values[2].text, "cubic");
    EXPECT_EQ(resolved->values[3].number, 1.0);
}

TEST(Config, GivenValuesAreTyped) {
    const auto resolved =
        parsed("[estimator]\nnum_groups = 12\nspring_k1_n_per_m = 85\nlaw = \"linear\"\ngate = false\n")
            .resolve("estimator", kEstimator);
    ASSERT_TRUE(resolved) << resolved.error().text;
    EXPECT_EQ(resolved->values[0].number, 12.0);
    EXPECT_EQ(resolved->values[1].number, 85.0);
    EXPECT_STREQ(resolved->values[2].text, "linear");
    EXPECT_EQ(resolved->values[3].number, 0.0);
}

TEST(Config, UnknownKeyNamesPlaceAndNearestKey) {
    EXPECT_EQ(resolve_error("\n\n\n[estimator]\nspring_k1 = 2.0\n"),
              "phantom.toml:5: estimator.spring_k1 is not a known setting (did you mean spring_k1_n_per_m?)");
    EXPECT_EQ(resolve_error("[estimator]\nnum_gruops = 2\n"),
              "phantom.toml:2: estimator.num_gruops is not a known setting (did you mean num_groups?)");
    EXPECT_EQ(resolve_error("[estimator]\nzzzzzzzz = 2\n"),
              "phantom.toml:2: estimator.zzzzzzzz is not a known setting");
    EXPECT_EQ(parse_error("[service]\nbus = \"memq://\"\n"),
              "phantom.toml:2: service.bus is not a known setting (did you mean bus_url?)");
}

TEST(Config, ValueOutsideItsRangeNamesTheBound) {
    EXPECT_EQ(resolve_error("[estimator]\nnum_groups = 500\n"),
              "phantom.toml:2: estimator.num_groups = 500 is above the bound 64");
    EXPECT_EQ(resolve_error("[estimator]\nnum_groups = 0\n"),
              "phantom.toml:2: estimator.num_groups = 0 is below the bound 1");
    EXPECT_EQ(resolve_error("[estimator]\nspring_k1_n_per_m = -inf\n"),
              "phantom.toml:2: estimator.spring_k1_n_per_m = -inf is below the bound 0");
    EXPECT_EQ(resolve_error("[estimator]\nspring_k1_n_per_m = nan\n"),
              "phantom.toml:2: estimator.spring_k1_n_per_m = nan is not a number");
    EXPECT_EQ(resolve_error("[estimator]\nlaw = \"square\"\n"),
              "phantom.toml:2: estimator.law = \"square\" is not one of linear|cubic");
}

TEST(Config, WrongTypeNamesTheTypeNeeded) {
    EXPECT_EQ(resolve_error("[estimator]\nnum_groups = 2.5\n"),
              "phantom.toml:2: estimator.num_groups = 2.5 is not a whole number");
    EXPECT_EQ(resolve_error("[estimator]\nnum_groups = \"8\"\n"),
              "phantom.toml:2: estimator.num_groups = \"8\" is not a whole number");
    EXPECT_EQ(resolve_error("[estimator]\nlaw = 3\n"), "phantom.toml:2: estimator.law = 3 is not a text in quotes");
    EXPECT_EQ(resolve_error("[estimator]\ngate = 1\n"), "phantom.toml:2: estimator.gate = 1 is not true or false");
    EXPECT_EQ(resolve_error("[estimator]\ngate = [1]\n"),
              "phantom.toml:2: estimator.gate = (array) is not true or false");
    EXPECT_EQ(resolve_error("[estimator]\n[estimator.gate]\nx = 1\n"),
              "phantom.toml:2: estimator.gate = (table) is not true or false");
    EXPECT_EQ(parse_error("[service]\ndrivers = \"replay\"\n"),
              "phantom.toml:2: service.drivers must be a list of texts, e.g. [\"replay\"]");
}

TEST(Config, MalformedFileNamesTheLine) {
    EXPECT_THAT(parse_error("[service]\nbus_url = \n"), testing::StartsWith("phantom.toml:2: "));
    EXPECT_THAT(parse_error("[service]\n[service]\n"), testing::StartsWith("phantom.toml:2: "));
    EXPECT_THAT(parse_error("gain = 1\n"), testing::StartsWith("phantom.toml:1: gain stands outside of a section"));
    EXPECT_THAT(parse_error("[service]\nbus_url = \"\xff\xfe\"\n"), testing::StartsWith("phantom.toml:2: "));
    EXPECT_THAT(parse_error(std::string(5000, '[')), testing::StartsWith("phantom.toml:1: "));
}

TEST(Config, MissingFileIsAnError) {
    const auto config = Config::read("/no/such/teres.toml");
    ASSERT_FALSE(config);
    EXPECT_EQ(config.error().text, "/no/such/teres.toml: no such settings file");
}

TEST(Config, RelativePathsFollowTheFile) {
    test::ScratchFolder scratch;
    std::ofstream(scratch.path() / "a.toml") << "[service]\ncase = \"cases/demo\"\nrecord_to = \"../out.lcm\"\n"
                                                "[estimator]\natlas = \"atlas.csv\"\n";
    const auto config = Config::read(scratch.path() / "a.toml");
    ASSERT_TRUE(config) << config.error().text;
    EXPECT_EQ(config->service().case_folder, scratch.path() / "cases/demo");
    EXPECT_EQ(config->service().record_to, scratch.path().parent_path() / "out.lcm");
    const auto resolved = config->resolve("estimator", kEstimator);
    ASSERT_TRUE(resolved);
    EXPECT_EQ(resolved->values[5].text, (scratch.path() / "atlas.csv").string());
}

TEST(Config, CaseOfServiceReachesUnitsThatDoNotSetTheirOwn) {
    const auto handed = parsed("[service]\ncase = \"demo\"\n").resolve("estimator", kEstimator);
    ASSERT_TRUE(handed);
    EXPECT_STREQ(handed->values[4].text, "/etc/teres/demo");
    const auto own =
        parsed("[service]\ncase = \"demo\"\n[estimator]\ncase = \"/other\"\n").resolve("estimator", kEstimator);
    ASSERT_TRUE(own);
    EXPECT_STREQ(own->values[4].text, "/other");
}

TEST(Config, OverrideBeatsTheFileAndIsChecked) {
    Config config = parsed("[service]\nhealth_period_s = 2.0\n[estimator]\nnum_groups = 12\n");
    ASSERT_TRUE(config.set("estimator.num_groups=7"));
    ASSERT_TRUE(config.set("estimator.law=linear"));
    ASSERT_TRUE(config.set("estimator.gate=false"));
    ASSERT_TRUE(config.set("service.plugins=simulation, observation"));
    ASSERT_TRUE(config.set("service.drivers="));
    EXPECT_THAT(config.service().plugins, ElementsAre("simulation", "observation"));
    EXPECT_TRUE(config.service().drivers.empty());
    EXPECT_EQ(config.service().health_period_s, 2.0);
    const auto resolved = config.resolve("estimator", kEstimator);
    ASSERT_TRUE(resolved) << resolved.error().text;
    EXPECT_EQ(resolved->values[0].number, 7.0);
    EXPECT_STREQ(resolved->values[2].text, "linear");
    EXPECT_EQ(resolved->values[3].number, 0.0);

    ASSERT_TRUE(config.set("estimator.num_groups=500"));
    EXPECT_EQ(config.resolve("estimator", kEstimator).error().text,
              "--set: estimator.num_groups = 500 is above the bound 64");
    ASSERT_TRUE(config.set("estimator.num_groups=ten"));
    EXPECT_EQ(config.resolve("estimator", kEstimator).error().text,
              "--set: estimator.num_groups = ten is not a whole number");
    EXPECT_EQ(config.set("num_groups=3").error().text, "--set num_groups=3: not of the form section.key=value");
    EXPECT_EQ(config.set("service.idle_wait_ms=1000").error().text,
              "--set: service.idle_wait_ms = 1000 is above the bound 100");
    EXPECT_EQ(config.service().idle_wait_ms, ServiceSettings{}.idle_wait_ms);
}

TEST(Config, UnitNamedTwiceIsAnError) {
    EXPECT_EQ(parse_error("[service]\nplugins = [\"simulation\", \"simulation\"]\n"),
              "phantom.toml:1: unit simulation is named twice in [service]");
}

}  // namespace
}  // namespace teres
