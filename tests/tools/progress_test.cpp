#include "tools/progress.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>

namespace teres::tools {
namespace {

using ::testing::HasSubstr;

// What a run of `steps` steps prints.
std::string printed(std::size_t total, std::size_t steps, bool terminal) {
    char* text = nullptr;
    std::size_t size = 0;
    std::FILE* out = open_memstream(&text, &size);
    {
        Progress progress("estimating", total, out, terminal);
        for (std::size_t i = 0; i < steps; ++i) progress.step();
    }
    std::fclose(out);
    std::string result(text, size);
    std::free(text);
    return result;
}

TEST(Progress, WritesALineEveryTenPerCentOffTheTerminal) {
    const std::string text = printed(200, 200, false);
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 10);
    EXPECT_THAT(text, HasSubstr("estimating: 10 % (20 of 200)"));
    EXPECT_THAT(text, HasSubstr("estimating: 100 % (200 of 200)"));
    EXPECT_EQ(text.find('\r'), std::string::npos);
}

TEST(Progress, JumpsAndShortRunsPrintOnceEach) {
    const std::string text = printed(3, 3, false);
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 3);
    EXPECT_THAT(text, HasSubstr("33 % (1 of 3)"));
}

TEST(Progress, BarEndsWithALineEndEvenWhenTheWorkStopsEarly) {
    const std::string complete = printed(5, 5, true);
    EXPECT_EQ(std::count(complete.begin(), complete.end(), '\n'), 1);
    EXPECT_EQ(complete.back(), '\n');
    EXPECT_THAT(complete, HasSubstr("100 %  5/5"));
    const std::string stopped = printed(5, 2, true);
    EXPECT_EQ(std::count(stopped.begin(), stopped.end(), '\n'), 1);
    EXPECT_EQ(stopped.back(), '\n');
}

TEST(Progress, MoreStepsThanAnnouncedStayAtTheEnd) {
    const std::string text = printed(2, 10, true);
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1);
    EXPECT_EQ(text.find("3/2"), std::string::npos);
    EXPECT_EQ(printed(0, 1, false), "");
}

TEST(DurationText, UsesTheUnitsAHumanWould) {
    EXPECT_EQ(duration_text(0.2), "1 s");
    EXPECT_EQ(duration_text(200.0), "3 min 20 s");
    EXPECT_EQ(duration_text(7500.0), "2 h 5 min");
}

}  // namespace
}  // namespace teres::tools
