// A recorded CUT through the same plugins as the service: the loop goes on, the estimate follows, runs are identical.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

#include "core/case/case_writer.h"
#include "core/case/text_writer.h"
#include "core/log_reader.h"
#include "core/recorder.h"
#include "teres/boundary_estimate_t.hpp"
#include "teres/cut_t.hpp"
#include "tests/support/program.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

using test::run_teres;
using ::testing::HasSubstr;

constexpr int kFrames = 8, kCutAfter = 4;

std::string line_with(const std::string& text, const std::string& part) {
    std::stringstream lines(text);
    for (std::string line; std::getline(lines, line);)
        if (line.find(part) != std::string::npos) return line;
    return {};
}

class CutInARecording : public ::testing::Test {
  protected:
    void SetUp() override {
        Case c = test::clamped_block({.cells = {10, 2, 2}, .frames = kFrames});
        c.ligament = LigamentData{LigamentLaw::kNeoHookean, 80e3, 0.48, 0.025, 0.02, 0.0};
        for (std::size_t i = 0; i < c.mesh.nodes.size(); ++i)
            if (c.mesh.nodes[i][2] > 0.03 - 1e-9 && c.mesh.nodes[i][0] > 0.0)
                c.ligament_prior.push_back({static_cast<std::int32_t>(i), 0.7});
        ASSERT_TRUE(write_case(c, file("case")));
        ASSERT_TRUE(write_text_file(file("test.toml"),
                                    "[service]\ndrivers = [\"replay\"]\nplugins = [\"simulation\", \"estimator\"]\n"
                                    "[simulation]\nnum_groups = 2\n"));
        const auto live = replay("case", "run.lcm");
        ASSERT_EQ(live.exit_code, 0) << live.error;
    }
    std::filesystem::path file(const std::string& name) const { return scratch_.path() / name; }
    test::Run replay(const std::string& source, const std::string& record_to) const {
        std::vector<std::string> arguments{
            "replay",  file(source), "--config", file("test.toml"),
            "--speed", "0",          "--set",    "service.record_to=" + file(record_to).string()};
        if (source != "case") arguments.insert(arguments.end(), {"--case", file("case")});
        return run_teres(arguments);
    }
    // The recording's inputs with the cut after a few frames.
    void insert(const cut_t& cut, const std::string& to) const {
        std::vector<std::uint8_t> bytes(static_cast<std::size_t>(cut.getEncodedSize()));
        cut.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
        auto reader = LogReader::open(file("run.lcm"));
        auto recorder = Recorder::open({.file = file(to)});
        ASSERT_TRUE(reader && recorder);
        LogEvent event;
        for (int frames = 0; reader->next(event);) {
            if (event.channel != "MARKERS" && event.channel != "TOOL_LOADS") continue;
            ASSERT_TRUE(recorder->record(event.channel, event.data, event.stamp_us));
            if (event.channel == "MARKERS" && ++frames == kCutAfter) {
                ASSERT_TRUE(recorder->record("CUT", bytes, event.stamp_us));
            }
        }
        recorder->flush();
    }
    std::vector<boundary_estimate_t> estimates(const std::string& log) const {
        std::vector<boundary_estimate_t> out;
        auto reader = LogReader::open(file(log));
        EXPECT_TRUE(reader);
        LogEvent event;
        while (reader->next(event)) {
            if (event.channel != "BOUNDARY_ESTIMATE") continue;
            out.emplace_back();
            EXPECT_GE(out.back().decode(event.data.data(), 0, static_cast<int>(event.data.size())), 0);
        }
        return out;
    }

  private:
    test::ScratchFolder scratch_;
};

cut_t cut_of(std::vector<std::int32_t> tets, std::vector<std::string> released) {
    cut_t cut;
    cut.header = {0, 0, "case"};
    cut.num_tets = static_cast<std::int32_t>(tets.size());
    cut.tet = std::move(tets);
    cut.num_released = static_cast<std::int32_t>(released.size());
    cut.released = std::move(released);
    return cut;
}

TEST_F(CutInARecording, IsFollowedFromTheNextFrameOn) {
    insert(cut_of({140, 141}, {"ligament.r1.stiffness"}), "cut.lcm");
    const auto run = replay("cut.lcm", "after.lcm"), again = replay("cut.lcm", "again.lcm");
    ASSERT_EQ(run.exit_code, 0) << run.error;
    EXPECT_THAT(run.output + run.error, HasSubstr("2 tetrahedra gone, 1 parameters released"));
    EXPECT_EQ(line_with(run.output, "run hash"), line_with(again.output, "run hash"));
    const auto before = estimates("run.lcm"), after = estimates("after.lcm");
    ASSERT_EQ(before.size(), static_cast<std::size_t>(kFrames));
    ASSERT_EQ(after.size(), static_cast<std::size_t>(kFrames));
    for (std::size_t f = 0; f < kFrames; ++f) {
        const auto& p = after[f].attachment_probability;
        if (f < kCutAfter)
            EXPECT_EQ(after[f].mean, before[f].mean) << "frame " << f;
        else
            EXPECT_LT(*std::ranges::min_element(p), 0.01) << "frame " << f;
        EXPECT_GT(*std::ranges::max_element(p), 0.3) << "frame " << f;
    }
}

TEST_F(CutInARecording, ARefusedCutIsNamedAndChangesNothing) {
    insert(cut_of({1'000'000}, {}), "cut.lcm");
    const auto run = replay("cut.lcm", "after.lcm");
    ASSERT_EQ(run.exit_code, 0) << run.error;
    EXPECT_THAT(run.output + run.error, HasSubstr("names a tetrahedron that the case does not have"));
    EXPECT_EQ(estimates("after.lcm").back().mean, estimates("run.lcm").back().mean);
}

}  // namespace
}  // namespace teres
