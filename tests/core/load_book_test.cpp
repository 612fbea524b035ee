#include "core/load_book.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/support/spring_model.h"

using namespace teres;

namespace {

tool_loads_t message(std::int64_t stamp_us, const std::string& region, double fy) {
    tool_loads_t m;
    m.header.capture_stamp_us = stamp_us;
    m.num_regions = 1;
    m.region = {region};
    m.fx_n = {0.0};
    m.fy_n = {fy};
    m.fz_n = {0.0};
    m.num_tools = 0;
    return m;
}

}  // namespace

TEST(LoadBook, HoldsTheNewestLoadThatIsNotNewerThanTheFrame) {
    const test::SpringModel model;
    LoadBook book(model);
    EXPECT_EQ(book.at(5).region_force_n[1], 0.0);
    book.add(message(100, "F0", 1.0));
    book.add(message(200, "F1", 2.0));
    EXPECT_EQ(book.at(99).region_force_n[1], 0.0);
    EXPECT_EQ(book.at(100).region_force_n[1], 1.0);
    EXPECT_EQ(book.at(199).region_force_n[1], 1.0);
    EXPECT_EQ(book.at(250).region_force_n[1], 0.0);  // left out of the second message
    EXPECT_EQ(book.at(250).region_force_n[4], 2.0);
}

TEST(LoadBook, RefusesBadMessages) {
    const test::SpringModel model;
    LoadBook book(model);
    EXPECT_EQ(book.add(message(100, "F0", 1.0)), LoadBook::Entry::kTaken);
    EXPECT_EQ(book.add(message(200, "F0", std::numeric_limits<double>::infinity())), LoadBook::Entry::kNotFinite);
    EXPECT_EQ(book.add(message(50, "F0", 3.0)), LoadBook::Entry::kOlderThanNewest);
    EXPECT_EQ(book.add(message(300, "F9", 3.0)), LoadBook::Entry::kTaken);
    EXPECT_EQ(book.num_unknown(), 1);
    EXPECT_EQ(book.first_unknown(), "F9");
}

TEST(LoadBook, StaysBounded) {
    const test::SpringModel model;
    LoadBook book(model, 4);
    for (std::int64_t t = 0; t < 100; ++t) book.add(message(t, "F0", static_cast<double>(t)));
    EXPECT_EQ(book.at(99).region_force_n[1], 99.0);
    EXPECT_EQ(book.at(96).region_force_n[1], 96.0);
    EXPECT_EQ(book.at(95).region_force_n[1], 0.0);  // gone
}
