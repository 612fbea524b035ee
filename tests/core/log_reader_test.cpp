#include "core/log_reader.h"

#include <gtest/gtest.h>
#include <lcm/lcm.h>

#include <chrono>
#include <fstream>
#include <vector>

#include "tests/support/test_data.h"

namespace teres {
namespace {

using Bytes = std::vector<std::uint8_t>;

void put(Bytes& bytes, std::uint64_t value, int count) {
    for (int i = count - 1; i >= 0; --i) bytes.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

// An event as lcm-logger writes it; lengths may be given wrongly.
Bytes event(std::int64_t number, std::int64_t stamp_us, const std::string& channel, const Bytes& data,
            std::int64_t channel_length = -100, std::int64_t data_length = -100) {
    Bytes bytes;
    put(bytes, 0xEDA1DA01, 4);
    put(bytes, static_cast<std::uint64_t>(number), 8);
    put(bytes, static_cast<std::uint64_t>(stamp_us), 8);
    put(bytes,
        static_cast<std::uint64_t>(channel_length == -100 ? static_cast<std::int64_t>(channel.size()) : channel_length),
        4);
    put(bytes, static_cast<std::uint64_t>(data_length == -100 ? static_cast<std::int64_t>(data.size()) : data_length),
        4);
    bytes.insert(bytes.end(), channel.begin(), channel.end());
    bytes.insert(bytes.end(), data.begin(), data.end());
    return bytes;
}

class LogReaderTest : public testing::Test {
  protected:
    std::filesystem::path file() const { return scratch_.path() / "x.lcmlog"; }
    void write(const std::vector<Bytes>& parts) {
        std::ofstream out(file(), std::ios::binary);
        for (const Bytes& part : parts)
            out.write(reinterpret_cast<const char*>(part.data()), static_cast<std::streamsize>(part.size()));
    }
    // Numbers of the events that are read, in order.
    std::vector<std::int64_t> read() {
        auto reader = LogReader::open(file());
        EXPECT_TRUE(reader) << reader.error().text;
        std::vector<std::int64_t> numbers;
        LogEvent event;
        while (reader->next(event)) numbers.push_back(event.number);
        damage = reader->damage();
        text = reader->damage_text();
        return numbers;
    }
    LogDamage damage;
    std::string text;

  private:
    test::ScratchFolder scratch_;
};

using Numbers = std::vector<std::int64_t>;
const Bytes kData{1, 2, 3, 4, 5, 6, 7, 8, 9, 10};

TEST_F(LogReaderTest, ReadsWhatLiblcmWrites) {
    lcm_eventlog_t* log = lcm_eventlog_create(file().c_str(), "w");
    ASSERT_NE(log, nullptr);
    std::string channel = "MARKERS";
    Bytes data = kData;
    for (int i = 0; i < 3; ++i) {
        lcm_eventlog_event_t e{0, 1000 + i, static_cast<std::int32_t>(channel.size()), 10, channel.data(), data.data()};
        ASSERT_EQ(lcm_eventlog_write_event(log, &e), 0);
    }
    lcm_eventlog_destroy(log);
    auto reader = LogReader::open(file());
    ASSERT_TRUE(reader);
    LogEvent e;
    for (int i = 0; i < 3; ++i) {
        ASSERT_TRUE(reader->next(e));
        EXPECT_EQ(e.number, i);
        EXPECT_EQ(e.stamp_us, 1000 + i);
        EXPECT_EQ(e.channel, "MARKERS");
        EXPECT_EQ(Bytes(e.data.begin(), e.data.end()), kData);
    }
    EXPECT_FALSE(reader->next(e));
    EXPECT_TRUE(reader->damage().none());
    EXPECT_EQ(reader->damage_text(), "");
    reader->rewind();
    ASSERT_TRUE(reader->next(e));
    EXPECT_EQ(e.number, 0);
}

TEST_F(LogReaderTest, CutAtAnyByteIsReadUpToTheCutAndNamed) {
    const Bytes one = event(0, 1, "A", kData), two = event(1, 2, "B", kData);
    for (std::size_t cut = 1; cut < two.size(); ++cut) {
        write({one, Bytes(two.begin(), two.begin() + static_cast<long>(cut))});
        EXPECT_EQ(read(), Numbers{0}) << cut;
        EXPECT_EQ(damage.truncated_at, static_cast<std::int64_t>(one.size())) << cut;
        EXPECT_NE(text.find("byte " + std::to_string(one.size())), std::string::npos) << text;
    }
}

TEST_F(LogReaderTest, HostileLengthsAreSkippedToTheNextEvent) {
    for (const std::int64_t length : {std::int64_t{-1}, std::int64_t{-2147483648}, std::int64_t{2147483647},
                                      std::int64_t{67108865}, std::int64_t{50'000'000}, std::int64_t{40}}) {
        write({event(0, 1, "A", kData), event(1, 2, "B", kData, -100, length), event(2, 3, "C", kData)});
        EXPECT_EQ(read(), (Numbers{0, 2})) << length;
        EXPECT_EQ(damage.regions, 1) << length;
        EXPECT_EQ(damage.first_offset, 39) << length;
    }
    for (const std::int64_t length : {-1, 0, 64, 1000, 2147483647}) {
        write({event(0, 1, "A", kData), event(1, 2, "B", kData, length), event(2, 3, "C", kData)});
        EXPECT_EQ(read(), (Numbers{0, 2})) << length;
    }
}

TEST_F(LogReaderTest, GarbageBetweenEventsIsSkippedAndCounted) {
    Bytes garbage(70000, 0xED);  // longer than one search stride, full of half sync words
    write({event(0, 1, "A", kData), garbage, event(1, 2, "B", kData)});
    EXPECT_EQ(read(), (Numbers{0, 1}));
    EXPECT_EQ(damage.skipped_bytes, 70000);
    EXPECT_EQ(damage.regions, 1);
}

TEST_F(LogReaderTest, ZeroFilledTailKeepsTheLastEvent) {
    write({event(0, 1, "A", kData), Bytes(4096, 0)});
    EXPECT_EQ(read(), Numbers{0});
    EXPECT_EQ(damage.skipped_bytes, 4096);
}

TEST_F(LogReaderTest, EventCutByACrashAndAppendedToLosesOnlyItself) {
    const Bytes cut = event(1, 2, "B", kData);
    write({event(0, 1, "A", kData), Bytes(cut.begin(), cut.end() - 4), event(2, 3, "C", Bytes(50, 7)),
           event(3, 4, "D", kData)});
    EXPECT_EQ(read(), (Numbers{0, 2, 3}));
}

TEST_F(LogReaderTest, SyncWordInsideDataIsData) {
    const Bytes inner = event(99, 1, "INNER", kData);
    write({event(0, 1, "A", inner), event(1, 2, "B", kData)});
    EXPECT_EQ(read(), (Numbers{0, 1}));
    EXPECT_TRUE(damage.none());
}

TEST_F(LogReaderTest, TimeGoingBackwardsIsCounted) {
    write({event(0, 5, "A", kData), event(1, 3, "A", kData), event(2, 4, "A", kData), event(3, 2, "A", kData)});
    EXPECT_EQ(read().size(), 4u);
    EXPECT_EQ(damage.backward_stamps, 2);
    EXPECT_NE(text.find("backwards 2 times"), std::string::npos);
}

TEST_F(LogReaderTest, FileOfSyncWordsTakesLinearTime) {
    // Each stretch claims most of what follows and heads nothing: a careless search is quadratic.
    std::vector<Bytes> parts;
    for (int i = 0; i < 100'000; ++i) parts.push_back(event(i, i, "A", {}, -100, 3'000'000));
    write(parts);
    const auto start = std::chrono::steady_clock::now();
    read();
    EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(10));
    EXPECT_FALSE(damage.none());
}

TEST_F(LogReaderTest, RefusesWhatIsNoLog) {
    EXPECT_NE(LogReader::open(file()).error().text.find("No such file"), std::string::npos);
    write({});
    EXPECT_NE(LogReader::open(file()).error().text.find("empty"), std::string::npos);
    EXPECT_NE(LogReader::open(file().parent_path()).error().text.find("not a regular file"), std::string::npos);
    write({Bytes(1000, 'x')});
    EXPECT_TRUE(read().empty());
    EXPECT_EQ(damage.skipped_bytes, 1000);
}

}  // namespace
}  // namespace teres
