#include "core/case/csv_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace teres {
namespace {

using ::testing::HasSubstr;

const std::vector<CsvColumn> kColumns{
    {"t_s", CsvKind::kNumber}, {"region", CsvKind::kText}, {"node_id", CsvKind::kId}, {"x_m", CsvKind::kNumberOrNan}};
const std::string kHeader = "t_s,region,node_id,x_m\n";

std::string error_of(const std::string& text) {
    const auto table = CsvTable::parse(text, "table.csv", kColumns);
    if (table) return "no error";
    EXPECT_EQ(table.error().kind, ErrorKind::kInvalidInput);
    return table.error().text;
}

TEST(CsvTable, ReadsNumbersNamesAndIds) {
    const auto table =
        CsvTable::parse(kHeader + "0.5,F1,17,-1e-3\n\n +1 , F 2 ,2147483647,NaN\n", "table.csv", kColumns);
    ASSERT_TRUE(table) << table.error().text;
    ASSERT_EQ(table->num_rows(), 2u);
    EXPECT_EQ(table->number(0, 0), 0.5);
    EXPECT_EQ(table->text(0, 1), "F1");
    EXPECT_EQ(table->id(0, 2), 17);
    EXPECT_EQ(table->number(0, 3), -1e-3);
    EXPECT_EQ(table->text(1, 1), "F 2");
    EXPECT_EQ(table->id(1, 2), 2147483647);
    EXPECT_TRUE(std::isnan(table->number(1, 3)));
    EXPECT_EQ(table->place(1), "table.csv:4");  // the empty line counts
}

TEST(CsvTable, ReadsWindowsLineEndsAndByteOrderMark) {
    EXPECT_EQ(error_of("\xEF\xBB\xBFt_s,region,node_id,x_m\r\n0,F1,1,2\r\n"), "no error");
}

TEST(CsvTable, HeaderMustMatch) {
    EXPECT_EQ(error_of("t_ms,region,node_id,x_m\n"),
              "table.csv:1: header 't_ms,region,node_id,x_m', expected 't_s,region,node_id,x_m'");
    EXPECT_THAT(error_of("t_s,region,node_id\n"), HasSubstr("expected 't_s,region,node_id,x_m'"));
    EXPECT_THAT(error_of("t_s,region,node_id,x_m,y_m\n"), HasSubstr("table.csv:1: header"));
    EXPECT_THAT(error_of("0,F1,1,2\n"), HasSubstr("table.csv:1: header"));
    EXPECT_EQ(error_of(""), "table.csv:1: empty file, expected the header 't_s,region,node_id,x_m'");
    EXPECT_THAT(error_of("\xEF\xBB\xBF"), HasSubstr("table.csv:1: empty file"));
}

TEST(CsvTable, TruncatedRowIsNamed) {
    EXPECT_EQ(error_of(kHeader + "0,F1,1,2\n0,F1,"),
              "table.csv:3: 3 columns, expected 4 (t_s,region,node_id,x_m); is the file truncated?");
    EXPECT_EQ(error_of(kHeader + "0,F1\n0,F1,1,2\n"), "table.csv:2: 2 columns, expected 4 (t_s,region,node_id,x_m)");
    // cut inside the last number, which still reads as a number
    EXPECT_THAT(error_of(kHeader + "0,F1,1,2.34"), HasSubstr("table.csv:2: the last line has no line end: truncated?"));
}

TEST(CsvTable, WrongValuesNameColumnAndBound) {
    EXPECT_EQ(error_of(kHeader + "0,F1,1,2\nabc,F1,1,2\n"), "table.csv:3: t_s = 'abc', expected a finite number");
    EXPECT_EQ(error_of(kHeader + "nan,F1,1,2\n"), "table.csv:2: t_s = 'nan', expected a finite number");
    EXPECT_EQ(error_of(kHeader + "0,F1,1,inf\n"), "table.csv:2: x_m = 'inf', expected a finite number or NaN");
    EXPECT_EQ(error_of(kHeader + "0,F1,1,1e400\n"), "table.csv:2: x_m = '1e400', expected a finite number or NaN");
    EXPECT_EQ(error_of(kHeader + "0,F1,1,\n"), "table.csv:2: x_m = '', expected a finite number or NaN");
    EXPECT_EQ(error_of(kHeader + "0,,1,2\n"), "table.csv:2: region = '', expected a name");
    EXPECT_THAT(error_of(kHeader + "0,F1,1,0x10\n"), HasSubstr("x_m = '0x10'"));
    for (const char* id : {"-1", "1.5", "2147483648", "1e3", "", "99999999999999999999"})
        EXPECT_THAT(error_of(kHeader + "0,F1," + id + ",2\n"), HasSubstr("expected an integer in [0, 2147483647]"))
            << id;
}

TEST(CsvTable, HostileTextStaysPrintable) {
    const std::string error = error_of(kHeader + "\x1b[31m" + std::string(5000, 'x') + ",F1,1,2\n");
    EXPECT_LT(error.size(), 200u);
    EXPECT_EQ(error.find('\x1b'), std::string::npos);
}

}  // namespace
}  // namespace teres
