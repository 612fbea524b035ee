// Which effects the diagnosis treats alike, from what they tell of themselves.
#include "plugins/diagnosis/effect_table.h"

#include <gtest/gtest.h>

#include "core/effect_description.h"

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

TEST(EffectTable, WhatHoldsOrPartsAtAPlaceHasARoughForm) {
    EXPECT_TRUE(entry("boundary", false, true).rough_form()) << "an adhesion";
    EXPECT_FALSE(entry("boundary", true, true).rough_form()) << "a tear";
    EXPECT_TRUE(entry("mechanics", true, true).rough_form()) << "a cut";
    EXPECT_FALSE(entry("mechanics", false, true).rough_form()) << "an inclusion";
    EXPECT_FALSE(entry("load", true, true).rough_form()) << "another tool";
    EXPECT_FALSE(entry("boundary", false, false).rough_form()) << "a clamp";
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
