// Which effects the diagnosis treats alike, from what they tell of themselves.
#include "plugins/diagnosis/effect_table.h"

#include <gtest/gtest.h>

#include <string_view>

#include "core/effect_description.h"
#include "plugins/simulation/trajectory.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/toy_body.h"

namespace teres {
namespace {

EffectEntry entry(const char* kind, bool event, bool has_place) {
    EffectEntry e;
    e.info.kind = kind;
    e.info.event = event;
    e.parameters = {amplitude("stiffness", "N/m3", EffectTransform::kIdentity, 0.0, 1.0, 0.0, 10.0)};
    if (has_place)
        for (const char* name : {"center_x", "center_y", "center_z"})
            e.parameters.push_back(shape(name, "m", 0.0, 0.05, -0.1, 0.1));
    return e;
}

// An adhesion, a contact, a slack ligament hold from somewhere on that differs from point to point.
TEST(EffectTable, ALocalSupportHasAPlaceAndIsThereFromTheBeginning) {
    EXPECT_TRUE(entry("boundary", false, true).local_support());
    EXPECT_FALSE(entry("boundary", true, true).local_support()) << "a tear: lets go at an instant";
    EXPECT_FALSE(entry("boundary", false, false).local_support()) << "breathing, a clamp: as a whole";
    EXPECT_FALSE(entry("load", false, true).local_support()) << "a heartbeat";
    EXPECT_FALSE(entry("mechanics", false, true).local_support()) << "an inclusion";
    EXPECT_TRUE(entry("boundary", true, true).support());
}

// A recording from 0 to 11.8 s.
TEST(EffectTable, ALoadUntilAnInstantHasAComplementFromThenOn) {
    test::ToyBody body;
    body.ends = true;
    const EffectTable effects(body, nullptr, {});
    const auto tool = [&](double onset_s, double end_s) {
        return ActiveEffect{effects.find("unknown_load"), {0.5, 0.3, -0.4, 0.12, 0.05, onset_s, end_s}};
    };
    const auto later = effects.complement(tool(0.0, 5.0));
    ASSERT_TRUE(later);
    EXPECT_EQ(later->values, (std::vector<double>{-0.5, -0.3, 0.4, 0.12, 0.05, 5.0, 23.6}));
    const auto earlier = effects.complement(tool(5.0, 24.0));
    ASSERT_TRUE(earlier);
    EXPECT_EQ(earlier->values, (std::vector<double>{-0.5, -0.3, 0.4, 0.12, 0.05, 0.0, 5.0}));
    EXPECT_FALSE(effects.complement(tool(2.0, 5.0))) << "acts for a while";
    EXPECT_FALSE(effects.complement(tool(0.0, 24.0))) << "acts throughout";
    EXPECT_FALSE(effects.complement(effects.candidate(effects.find("gravity"), 0)));
}

// Its edge keeps its middle, and is as fast as is usual: 0.05 of the recording.
TEST(EffectTable, AComplementIsAsFastAsIsUsual) {
    const auto mechanics = *Trajectory::make(test::clamped_block({.cells = {2, 1, 1}, .frames = 21}), {});
    const double t0 = mechanics->time_s(0), duration = mechanics->time_s(mechanics->num_frames() - 1) - t0;
    const EffectTable effects(*mechanics, nullptr, {});
    ActiveEffect tool = effects.candidate(effects.find("unknown_load"), 0);
    const auto set = [&](std::string_view name, double value) {
        for (std::size_t p = 0; p < tool.values.size(); ++p)
            if (name == effects[tool.entry].parameters[p].name) tool.values[p] = value;
    };
    set("onset", t0 - duration);
    set("end", t0 + 0.3 * duration);
    set("rise", 0.4 * duration);
    set("frequency", 0.0);
    const auto later = effects.complement(tool);
    ASSERT_TRUE(later);
    EXPECT_NEAR(*value_of(effects[tool.entry], *later, "rise"), 0.05 * duration, 1e-12);
    EXPECT_NEAR(*value_of(effects[tool.entry], *later, "onset"), t0 + 0.475 * duration, 1e-12);
    set("frequency", 1.0 / duration);
    EXPECT_FALSE(effects.complement(tool)) << "comes and goes";
}

// A block of 100 x 40 x 40 mm that a ligament holds at x = 0, but for a clamped edge.
TEST(EffectTable, WhatHoldsOrPartsAtAPlaceHasARoughFormButNotWhatLetsTheLigamentGo) {
    const auto mechanics = *Trajectory::make(
        test::hung_on_ligament(test::clamped_block({.size_m = {0.10, 0.04, 0.04}, .cells = {8, 3, 3}})), {});
    const EffectTable effects(*mechanics, nullptr, {});
    const auto at = [&](std::string_view id, double x_m, double radius_m = 0.02) {
        ActiveEffect effect = effects.candidate(effects.find(id), 0);
        const auto& parameters = effects[effect.entry].parameters;
        const std::pair<std::string_view, double> place[]{
            {"center_x", x_m}, {"center_y", 0.03}, {"center_z", 0.02}, {"radius", radius_m}};
        for (const auto& [name, value] : place)
            for (std::size_t p = 0; p < parameters.size(); ++p)
                if (name == parameters[p].name) effect.values[p] = value;
        return effect;
    };
    EXPECT_NEAR(effects.ligament_share(at("cut", 0.0, 0.05)), 1.0, 1e-12) << "around all of it";
    EXPECT_EQ(effects.ligament_share(at("cut", 0.06)), 0.0);
    EXPECT_EQ(effects.ligament_share(at("gravity", 0.0)), 0.0) << "has no place";

    EXPECT_TRUE(effects.rough_form(at("cut", 0.06)));
    EXPECT_FALSE(effects.rough_form(at("cut", 0.0))) << "the ligament lets go";
    EXPECT_TRUE(effects.lets_go(at("cut", 0.0)));
    EXPECT_FALSE(effects.lets_go(at("cut", 0.06)));
    EXPECT_FALSE(effects.lets_go(at("inclusion", 0.0))) << "softer, but whole";
    EXPECT_TRUE(effects.rough_form(at("extra_attachment", 0.06)));
    EXPECT_TRUE(effects.rough_form(at("extra_attachment", 0.0))) << "holds, wherever it is";
    for (const char* smooth : {"ligament_tear", "inclusion", "unknown_load", "gravity"})
        EXPECT_FALSE(effects.rough_form(at(smooth, 0.06))) << smooth;
}

TEST(EffectTable, ALoadWithNeitherPlaceNorCourseHasAnExactForm) {
    EXPECT_TRUE(entry("load", false, false).exact_form()) << "weight";
    EXPECT_FALSE(entry("load", true, true).exact_form()) << "another tool";
    EXPECT_FALSE(entry("mechanics", false, false).exact_form()) << "a modulus: of a law that may be another";
    EXPECT_FALSE(entry("boundary", false, false).exact_form()) << "breathing: of a course that may be another";
    EffectEntry camera = entry("sensor", true, false);
    camera.sensor = true;
    EXPECT_TRUE(camera.exact_form());
}

}  // namespace
}  // namespace teres
