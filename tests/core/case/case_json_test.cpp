#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/case/case_reader.h"

namespace teres {
namespace {

using ::testing::HasSubstr;

const std::string kGood = R"({
 "format": "teres-case-1",
 "name": "good",
 "time": {"frames": 61, "dt_s": 0.2, "quasi_static": true},
 "body": {
  "law": "ogden",
  "shear_modulus_pa": 7210.0,
  "alpha": 0.88,
  "bulk_modulus_pa": 358096.7,
  "density_kg_m3": 1060.0
 },
 "ligament": {"law": "neo_hookean", "youngs_modulus_pa": 1e5, "poissons_ratio": 0.48, "height_m": 0.025},
 "gravity_m_s2": [0, 0, -9.807],
 "sensor": {"noise_sigma_m": 0.0003, "view_direction": [0, 0, -1], "up": [0, 1, 0]}
}
)";

std::string with(const std::string& from, const std::string& to) {
    std::string text = kGood;
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return text.replace(at, from.size(), to);
}

std::string error_of(const std::string& text) {
    Case c;
    const auto status = parse_case_json(text, "case.json", c);
    if (status) return "no error";
    EXPECT_EQ(status.error().kind, ErrorKind::kInvalidInput);
    return status.error().text;
}

TEST(CaseJson, DerivesTheSmallStrainModuliOfOgden) {
    Case c;
    const auto status = parse_case_json(kGood, "case.json", c);
    ASSERT_TRUE(status) << status.error().text;
    EXPECT_EQ(c.body.law, BodyLaw::kOgden);
    // CASE data: E = 21485.8 Pa and nu = 0.49 stand beside these G and K
    EXPECT_NEAR(c.body.youngs_modulus_pa, 21485.8, 0.1);
    EXPECT_NEAR(c.body.poissons_ratio, 0.49, 1e-6);
    EXPECT_EQ(c.gravity_m_s2, (Point{0.0, 0.0, -9.807}));
    EXPECT_EQ(c.num_frames, 61);
    EXPECT_EQ(c.ligament->width_m, 0.0);
    EXPECT_FALSE(c.sensor.camera_position_m);
}

TEST(CaseJson, ReadsWindowsLineEndsAndByteOrderMark) {
    std::string windows = "\xEF\xBB\xBF";
    for (const char ch : kGood) windows += ch == '\n' ? std::string("\r\n") : std::string(1, ch);
    EXPECT_EQ(error_of(windows), "no error");
    const std::string typo = windows.replace(windows.find("alpha"), 5, "alhpa");
    EXPECT_THAT(error_of(typo), HasSubstr("case.json: body.alpha: missing key"));
}

TEST(CaseJson, UnknownKeyIsNamedWithItsLine) {
    EXPECT_EQ(error_of(with("\"density_kg_m3\": 1060.0", "\"density_kg_m3\": 1060.0,\n  \"densitty\": 1")),
              "case.json:11: body.densitty: unknown key");
    EXPECT_EQ(error_of(with("\"name\": \"good\"", "\"name\": \"good\", \"body.law\": \"ogden\"")),
              "case.json:3: unknown key 'body.law'");
    EXPECT_THAT(error_of(with("\"time\": {", "\"time\": {\"extra\": {\"deep\": [1]}, ")),
                HasSubstr("case.json:4: time.extra: unknown key"));
}

TEST(CaseJson, KeysThatBelongToAnotherLawAreUnknown) {
    const std::string text =
        with("\"law\": \"ogden\"", "\"law\": \"stvk\", \"youngs_modulus_pa\": 2e4, \"poissons_ratio\": 0.4");
    EXPECT_THAT(error_of(text), HasSubstr("unknown key"));
}

TEST(CaseJson, KeyThatAppearsTwiceIsAnError) {
    EXPECT_EQ(error_of(with("\"alpha\": 0.88", "\"alpha\": 0.88,\n\"alpha\": 0.9")),
              "case.json:9: body.alpha: key appears twice");
}

TEST(CaseJson, MissingKeyIsNamed) {
    EXPECT_EQ(error_of(with("\"format\": \"teres-case-1\",", "")), "case.json: format: missing key");
    EXPECT_EQ(error_of(with("\"frames\": 61, ", "")), "case.json: time.frames: missing key");
    EXPECT_EQ(error_of(with("\"noise_sigma_m\": 0.0003, ", "")), "case.json: sensor.noise_sigma_m: missing key");
    EXPECT_EQ(error_of(with("\"bulk_modulus_pa\": 358096.7,", "")), "case.json: body.bulk_modulus_pa: missing key");
}

TEST(CaseJson, WrongTypeIsNamed) {
    EXPECT_EQ(error_of(with("0.88", "\"0.88\"")), "case.json:8: body.alpha: is a text, expected a number");
    EXPECT_EQ(error_of(with("\"good\"", "7")), "case.json:3: name: is a number, expected a text");
    EXPECT_EQ(error_of(with("true", "1")), "case.json:4: time.quasi_static: is a number, expected true or false");
    EXPECT_EQ(error_of(with("{\"law\": \"neo_hookean\", \"youngs_modulus_pa\": 1e5, \"poissons_ratio\": "
                            "0.48, \"height_m\": 0.025}",
                            "null")),
              "case.json:12: ligament: is null, expected an object");
    EXPECT_EQ(error_of(with("[0, 0, -9.807]", "[0, 0]")), "case.json:13: gravity_m_s2: 2 elements, expected 3");
    EXPECT_THAT(error_of(with("[0, 0, -9.807]", "[0, 0, \"down\"]")), HasSubstr("gravity_m_s2[2]: is a text"));
    EXPECT_EQ(error_of("[1, 2]"), "case.json:1: not a JSON object");
}

TEST(CaseJson, OutOfRangeNamesValueAndBound) {
    EXPECT_EQ(error_of(with("\"poissons_ratio\": 0.48", "\"poissons_ratio\": 0.5")),
              "case.json:12: ligament.poissons_ratio: 0.5 is outside (-1, 0.5)");
    EXPECT_EQ(error_of(with("\"poissons_ratio\": 0.48", "\"poissons_ratio\": -1")),
              "case.json:12: ligament.poissons_ratio: -1 is outside (-1, 0.5)");
    EXPECT_EQ(error_of(with("7210.0", "-7210.0")), "case.json:7: body.shear_modulus_pa: -7210 is outside (0, 1e+12]");
    EXPECT_EQ(error_of(with("0.88", "0")),
              "case.json:8: body.alpha: 0 is not allowed: W has alpha^2 in its denominator");
    EXPECT_THAT(error_of(with("\"frames\": 61", "\"frames\": 0")), HasSubstr("time.frames: 0 is outside [1, "));
    EXPECT_THAT(error_of(with("\"frames\": 61", "\"frames\": 1.5")), HasSubstr("time.frames: 1.5 is not an integer"));
    EXPECT_THAT(error_of(with("\"dt_s\": 0.2", "\"dt_s\": 0")), HasSubstr("time.dt_s: 0 is outside (0, "));
    EXPECT_THAT(error_of(with("1060.0", "-1")), HasSubstr("body.density_kg_m3: -1 is outside [0, "));
    EXPECT_THAT(error_of(with("-9.807", "-98070")), HasSubstr("gravity_m_s2[2]: -98070 is outside [-1000, 1000]"));
    EXPECT_THAT(error_of(with("\"up\": [0, 1, 0]", "\"up\": [0, 0, 0]")), HasSubstr("sensor.up: has no length"));
}

TEST(CaseJson, NonFiniteNumbersAreRefused) {
    EXPECT_THAT(error_of(with("0.88", "NaN")), HasSubstr("case.json:8: not valid JSON"));
    EXPECT_THAT(error_of(with("0.88", "1e999")), HasSubstr("case.json:8:"));
}

TEST(CaseJson, UnknownNameListsTheKnownOnes) {
    EXPECT_EQ(error_of(with("\"ogden\"", "\"odgen\"")),
              "case.json:6: body.law: 'odgen' is unknown, expected stvk|corotational|ogden|neo_hookean");
    EXPECT_EQ(error_of(with("teres-case-1", "teres-case-2")),
              "case.json:2: format: 'teres-case-2' is unknown, expected teres-case-1");
}

TEST(CaseJson, ContradictingModuliAreRefused) {
    EXPECT_THAT(error_of(with("\"alpha\"", "\"youngs_modulus_pa\": 30000, \"alpha\"")),
                HasSubstr("body.youngs_modulus_pa: 30000 contradicts shear_modulus_pa and bulk_modulus_pa, "
                          "which give 21485.8"));
    EXPECT_THAT(error_of(with("\"alpha\"", "\"poissons_ratio\": 0.4, \"alpha\"")),
                HasSubstr("body.poissons_ratio: 0.4 contradicts"));
}

TEST(CaseJson, GravityNeedsDensity) {
    EXPECT_THAT(error_of(with("\"density_kg_m3\": 1060.0", "\"density_kg_m3\": 0")),
                HasSubstr("case.json:10: body.density_kg_m3: must be above 0"));
}

TEST(CaseJson, BrokenSyntaxNamesTheLine) {
    EXPECT_THAT(error_of(with("\"alpha\": 0.88,", "\"alpha\": 0.88")), HasSubstr("case.json:9: not valid JSON"));
    EXPECT_THAT(error_of(kGood.substr(0, 200)), HasSubstr("not valid JSON"));
    EXPECT_THAT(error_of(kGood + "x"), HasSubstr("case.json:16: not valid JSON"));
    EXPECT_EQ(error_of(""), "case.json:1: empty file, expected a JSON object");
    EXPECT_EQ(error_of(" \n\r\n"), "case.json:1: empty file, expected a JSON object");
}

TEST(CaseJson, DepthAndSizeAreBounded) {
    EXPECT_THAT(error_of(std::string(100000, '[')), HasSubstr("not a JSON object"));
    std::string deep = "{\"a\":";
    for (int i = 0; i < 1000; ++i) deep += "[";
    EXPECT_THAT(error_of(deep), HasSubstr("or 16 levels"));
    std::string wide = "{\"a\":[";
    for (int i = 0; i < 100000; ++i) wide += "0,";
    EXPECT_THAT(error_of(wide + "0]}"), HasSubstr("more than 10000 values"));
}

}  // namespace
}  // namespace teres
