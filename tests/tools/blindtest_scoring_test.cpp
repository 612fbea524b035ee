// Blind test: answers read, scored and merged, by pen and paper.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>

#include "core/case/text_file.h"
#include "core/case/text_writer.h"
#include "tests/support/program.h"
#include "tests/support/test_data.h"
#include "tools/blindtest/case_maker.h"
#include "tools/blindtest/score_report.h"
#include "tools/blindtest/scoring.h"

namespace teres::blindtest {
namespace {

namespace fs = std::filesystem;
using test::ScratchFolder;

std::string gap_json(const std::string& causes, double unknown, double none, double gap = 1.0) {
    return R"({"format":"teres-gap-1","gap":{"rms_mm":)" + std::to_string(gap) +
           R"(},"where":{"center_m":[0.01,0,0],"onset_s":null},"causes":[)" + causes + R"(],"unknown_probability":)" +
           std::to_string(unknown) + R"(,"none_probability":)" + std::to_string(none) +
           R"(,"shrinkage":{"fraction":0.8,"ci95":[0.7,0.9]}})";
}
std::string cause(const std::string& ids, double probability) {
    return R"({"effects":[)" + ids + R"(],"probability":)" + std::to_string(probability) + "}";
}

TEST(Scoring, ReadsTheContract) {
    const auto answer =
        parse_answer(gap_json(cause(R"("pressure")", 0.2) + "," + cause(R"("latency","gravity")", 0.5), 0.2, 0.1), "f");
    ASSERT_TRUE(answer) << answer.error().text;
    EXPECT_EQ(answer->best().first, "gravity+latency");  // sorted ids, most probable first
    EXPECT_EQ(answer->causes[1].first, "pressure");
    EXPECT_DOUBLE_EQ((*answer->center_m)[0], 0.01);
    EXPECT_FALSE(answer->onset_s);
    EXPECT_FALSE(parse_answer(gap_json(cause(R"("pressure")", 0.2), 0.2, 0.1), "f"));  // sums to 0.5
    EXPECT_FALSE(parse_answer("{}", "f"));
    EXPECT_FALSE(parse_answer("{", "f"));
}

CaseResult result(const std::string& truth, double gap, const std::string& json) {
    CaseResult r;
    r.name = "c";
    r.truth = truth;
    r.gap_nominal_mm = gap;
    r.noise_mm = 0.6;
    if (!json.empty()) r.answer = *parse_answer(json, "test");
    return r;
}

// Controls' gap without noise: sqrt(1 - 0.36) = 0.8 mm is the floor, so causes are visible above 1.2 mm.
std::vector<CaseResult> hand_made() {
    std::vector<CaseResult> r;
    r.push_back(result("none", 0.0, gap_json("", 0.1, 0.9)));                               // right at 0.9
    r.push_back(result("none", 0.0, gap_json(cause(R"("stiffness")", 0.6), 0.0, 0.4)));     // false alarm at 0.6
    r.push_back(result("gravity", 2.0, gap_json(cause(R"("gravity")", 0.95), 0.0, 0.05)));  // right at 0.95
    r.push_back(result("pressure", 2.0,
                       gap_json(cause(R"("gravity")", 0.7) + "," + cause(R"("pressure")", 0.3), 0.0, 0.0)));  // family
    r.push_back(result("latency", 2.0,
                       gap_json(cause(R"("cut")", 0.3) + "," + cause(R"("noise")", 0.2), 0.5, 0.0)));  // unknown at 0.5
    r.push_back(result("cut", 0.5, gap_json("", 0.2, 0.8)));  // below the floor: none
    r.push_back(
        result("gravity+latency", 3.0, gap_json(cause(R"("latency","gravity")", 0.9), 0.1, 0.0)));  // both, at 0.9
    r.push_back(result("inclusion", 2.0, ""));                                                      // failed
    r[2].withheld = *parse_answer(gap_json(cause(R"("pressure")", 0.8), 0.2, 0.0), "t");            // its family
    r[3].withheld = *parse_answer(gap_json(cause(R"("stiffness")", 0.8), 0.2, 0.0), "t");           // confidently wrong
    r[2].place_error_mm = 6.0;
    r[2].true_shrinkage = 0.75;
    r[3].true_shrinkage = 0.3;
    r[2].seconds = 10.0;
    return r;
}

TEST(Scoring, ABodyIsMeasuredByItsOwnControl) {
    std::vector<CaseResult> r;
    const auto add = [&](const char* truth, const char* body, double gap_mm, double rms_mm) {
        r.push_back(result(truth, gap_mm, gap_json("", 0.0, 1.0)));
        r.back().body = body;
        r.back().answer->gap_rms_mm = rms_mm;
        r.back().noise_mm = 0.0;
    };
    add("none", "soft", 0.0, 2.0);
    add("none", "firm", 0.0, 0.4);
    add("cut", "soft", 1.0, 0.0);     // below 3.0
    add("cut", "firm", 1.0, 0.0);     // above 0.6
    add("cut", "strange", 1.0, 0.0);  // below 1.8, the median's
    const Summary s = summarise(r);
    EXPECT_NEAR(s.floor_mm, 1.2, 1e-12);
    EXPECT_EQ(s.top1.of, 1);
    EXPECT_EQ(s.invisible_none.of, 2);
    EXPECT_EQ(summarise(r, 0.5).top1.of, 3);  // one floor given for all
}

TEST(Scoring, EqualsPenAndPaper) {
    const Summary s = summarise(hand_made());
    EXPECT_NEAR(s.floor_mm, 0.8, 1e-12);
    EXPECT_EQ(s.failed, 1);
    const auto expect = [](const Share& share, int right, int of, const char* what) {
        EXPECT_EQ(share.right, right) << what;
        EXPECT_EQ(share.of, of) << what;
    };
    expect(s.false_alarm, 1, 2, "false alarm");
    expect(s.top1, 1, 3, "top-1");
    expect(s.top3, 2, 3, "top-3");
    expect(s.family, 2, 3, "family");
    expect(s.top1_all, 1, 4, "top-1, all");
    expect(s.kind, 2, 2, "kind");
    expect(s.invisible_none, 1, 1, "invisible");
    expect(s.false_unknown, 1, 3, "false unknown");
    expect(s.withheld_unknown, 1, 2, "withheld");
    expect(s.two_both, 1, 1, "two, both");
    expect(s.coverage, 1, 1, "coverage");
    EXPECT_THAT(s.place_mm, ::testing::ElementsAre(6.0));
    EXPECT_THAT(s.true_shrinkage, ::testing::ElementsAre(0.75));
    EXPECT_THAT(s.wrong_shrinkage, ::testing::ElementsAre(0.3));
    // Bins: 0.5 (wrong), 0.6 (wrong), 0.7 (wrong), 0.8 (right), 0.9: three of three at 0.9, 0.95, 0.9.
    EXPECT_NEAR(s.ece, (0.5 + 0.6 + 0.7 + 0.2 + (3.0 - 2.75)) / 7.0, 1e-9);
    // One alone deviates by 2 p (1 - p); of three at 0.9, 0.95, 0.9 all are right in 0.7695, two in 0.2115, ...
    EXPECT_NEAR(s.ece_of_chance, (0.5 + 0.48 + 0.42 + 0.32 + 0.38475) / 7.0, 1e-9);
    EXPECT_EQ(s.confusion.at("pressure").at("gravity"), 1);
    EXPECT_EQ(s.confusion.count("cut"), 0u);
    EXPECT_EQ(s.effects.at("latency").top3.right, 0);
}

TEST(Scoring, AnAnswerMayDeclareTheRightCauseInseparable) {
    const auto answer = [](const char* others) {
        return gap_json(R"({"effects":["gravity"],"probability":0.9,"confusable_with":[)" + std::string(others) + "]}",
                        0.1, 0.0);
    };
    const Summary s =
        summarise(std::vector{result("contact", 2.0, answer(R"("pressure","contact")")),
                              result("contact", 2.0, answer(R"("pressure")")), result("gravity", 2.0, answer(""))});
    EXPECT_EQ(s.declared.right, 2);
    EXPECT_EQ(s.declared.of, 3);
    EXPECT_EQ(s.top1.right, 1);
}

TEST(Scoring, WithheldItMayBeAnsweredByWhatTheFullAnswerDeclaredInseparable) {
    const std::string full =
        gap_json(R"({"effects":["gravity"],"probability":0.9,"confusable_with":["contact"]})", 0.1, 0.0);
    const auto withheld = [&](const char* truth, const char* instead) {
        CaseResult r = result(truth, 2.0, full);
        r.withheld = *parse_answer(gap_json(cause(instead, 0.8), 0.2, 0.0), "t");
        return r;
    };
    const Summary s =
        summarise(std::vector{withheld("gravity", R"("contact")"),    // declared
                              withheld("gravity", R"("stiffness")"),  // not
                              withheld("contact", R"("gravity")"),    // the full answer itself, which declares it
                              withheld("cut", R"("gravity")")});      // ... and does not
    EXPECT_EQ(s.withheld_unknown.right, 0);
    EXPECT_EQ(s.withheld_declared.right, 2);
    EXPECT_EQ(s.withheld_declared.of, 4);
}

TEST(Scoring, APairMayBeWhatTheFullAnswerDeclaredInseparable) {
    const std::string full = gap_json(R"({"effects":["depth_scale"],"probability":0.9,"confusable_with":[],)"
                                      R"("confusable_with_pairs":[["registration","lens_distortion"],"no pair",[3]]})",
                                      0.1, 0.0);
    const auto withheld = [&](const char* instead) {
        CaseResult r = result("depth_scale", 2.0, full);
        r.withheld = *parse_answer(gap_json(cause(instead, 0.8), 0.2, 0.0), "t");
        return *parse_case_result(to_json_line(r), "t");  // kept in the line, too
    };
    const Summary s = summarise(std::vector{withheld(R"("lens_distortion","registration")"), withheld(R"("stiffness")"),
                                            withheld(R"("camera_drift","registration")"), withheld(R"("none")")});
    EXPECT_EQ(s.withheld_declared.right, 1);
    EXPECT_EQ(s.withheld_declared.of, 4);
}

// Of two causes one adds 0.1 mm to a floor of 0.35 mm: naming the other is right, naming what was not there is not.
TEST(Scoring, OfTwoCausesOnlyTheVisibleOnesMustBeNamed) {
    std::vector<CaseResult> r;
    const auto add = [&](const std::string& answer, double second_mm) {
        r.push_back(result("gravity+latency", 2.0, gap_json(cause(answer, 0.9), 0.1, 0.0)));
        r.back().gap_of_mm = {{"gravity", 2.0}, {"latency", second_mm}};
    };
    add(R"("gravity")", 0.1);
    add(R"("gravity","latency")", 0.1);
    add(R"("gravity","cut")", 0.1);
    add(R"("gravity")", 1.0);
    add(R"("gravity","latency")", 1.0);
    const Summary s = summarise(r);
    EXPECT_EQ(s.two_seen.right, 2);
    EXPECT_EQ(s.two_seen.of, 3);
    EXPECT_EQ(s.two_both.right, 1);
    EXPECT_EQ(s.two_both.of, 2);
    EXPECT_EQ(s.two_one.right, 2);
    EXPECT_EQ(s.reliability[9].right.right, 3);
}

TEST(Scoring, LinesKeepEverything) {
    for (const CaseResult& r : hand_made()) {
        const std::string line = to_json_line(r);
        const auto back = parse_case_result(line, "line");
        ASSERT_TRUE(back) << back.error().text;
        EXPECT_EQ(to_json_line(*back), line);
    }
    EXPECT_FALSE(parse_case_result("[]", "line"));
}

void write(const fs::path& file, const std::vector<CaseResult>& results) {
    std::string text;
    for (const CaseResult& r : results) text += to_json_line(r) + "\n";
    ASSERT_TRUE(write_text_file(file, text));
}

TEST(BlindtestCommand, MergesShards) {
    const ScratchFolder scratch;
    const auto all = hand_made();
    const std::string whole = (scratch.path() / "whole.jsonl").string(), a = (scratch.path() / "a.jsonl").string(),
                      b = (scratch.path() / "b.jsonl").string();
    write(whole, all);
    write(a, {all.begin(), all.begin() + 3});
    write(b, {all.begin() + 3, all.end()});
    const test::Run once = test::run_teres({"blindtest", "merge", whole}),
                    merged =
                        test::run_teres({"blindtest", "merge", a, b, "--plots", (scratch.path() / "plots").string()});
    ASSERT_EQ(once.exit_code, 0) << once.error;
    EXPECT_EQ(merged.output, once.output);
    EXPECT_THAT(merged.output, ::testing::HasSubstr("33 % (1 of 3) / 67 % (2 of 3)"));
    for (const char* row : {"| `pressure` | 1 | 0 | 1 | 1 | - | 1 gravity |", "| `none` | 2 | 1 | 1 stiffness |",
                            "| `gravity+latency` | 1 | 1 |  |", "| 90 to 100 % | 3 | 92 % | 100 % (3 of 3) |"})
        EXPECT_THAT(merged.output, ::testing::HasSubstr(row));
    for (const char* picture : {"confusion.png", "reliability.png", "effects.png"})
        EXPECT_GT(fs::file_size(scratch.path() / "plots" / picture), 1000u) << picture;
    EXPECT_EQ(test::run_teres({"blindtest", "merge"}).exit_code, 2);
    EXPECT_EQ(test::run_teres({"blindtest", "generate", "--shard", "9"}).exit_code, 2);
}

// What VALIDATION.md says of the sealed cases whose answers are kept is what these answers give.
TEST(BlindtestCommand, ValidationHoldsTheTablesOfTheKeptAnswers) {
    const char* source = std::getenv("TERES_SOURCE_DIR");
    const fs::path root = source != nullptr ? source : ".";
    std::vector<std::string> merge{"blindtest", "merge"};
    for (const auto& entry : fs::directory_iterator(root / "tests" / "validation" / "sealed"))
        if (entry.path().extension() == ".jsonl") merge.push_back(entry.path().string());
    ASSERT_GT(merge.size(), 2u);
    std::sort(merge.begin() + 2, merge.end());
    const test::Run tables = test::run_teres(merge);
    ASSERT_EQ(tables.exit_code, 0) << tables.error;
    const auto validation = read_text_file(root / "VALIDATION.md");
    ASSERT_TRUE(validation) << validation.error().text;
    std::istringstream lines(tables.output);
    for (std::string line; std::getline(lines, line);) EXPECT_THAT(*validation, ::testing::HasSubstr(line));
}

}  // namespace
}  // namespace teres::blindtest
