// Scores of a blind test: one CaseResult a case (a JSON line, so that shards merge by concatenation), and their
// Summary.
#pragma once

#include <array>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/case/case.h"
#include "core/result.h"

namespace teres::blindtest {

/// A cause set as one word, its ids sorted: "inclusion", "gravity+latency"; "none" and "unknown" besides.
std::string cause_name(std::vector<std::string> effects);

/// What a diagnosis (teres-gap-1) answers.
struct Answer {
    std::vector<std::pair<std::string, double>> causes;  ///< cause_name and probability, most probable first
    std::vector<std::string> inseparable;                ///< declared so from the most probable cause: cause_names
    double unknown = 0.0, none = 0.0;
    double gap_rms_mm = 0.0;
    std::optional<Point> center_m;
    std::optional<double> onset_s;
    std::optional<std::array<double, 3>> shrinkage;  ///< fraction, ci95 low, high

    /// The most probable of causes, "unknown" and "none".
    std::pair<std::string, double> best() const;
};
/// Errors (kInvalidInput): not teres-gap-1, probabilities that do not sum to 1 within 1e-3.
Result<Answer> parse_answer(std::string_view json, const std::string& name);

struct CaseResult {
    std::string name;
    std::string truth;  ///< cause_name; "none" for controls
    std::string body;   ///< seed, patient, supports and kind of recording: cases of one body share its control's floor
    bool located = false;
    double gap_nominal_mm = 0.0;                ///< what the ligament's unknowns cannot explain, from the truth
    std::map<std::string, double> gap_of_mm{};  ///< the same of each effect of several: what it adds to those before it
    double noise_mm = 0.0;                      ///< stated noise, 3-D rms
    std::optional<Answer> answer;               ///< nullopt: the diagnosis failed
    std::optional<double> place_error_mm, onset_error_s;
    std::optional<double> true_shrinkage;  ///< of the error of the inner points against the noise-free truth
    std::optional<Answer> withheld;        ///< answer with the true effect excluded
    double seconds = 0.0, peak_mb = 0.0;
};
std::string to_json_line(const CaseResult& result);
Result<CaseResult> parse_case_result(std::string_view line, const std::string& place);

/// Counts of cases: `of` in question, `right` among them.
struct Share {
    int right = 0, of = 0;
    void add(bool is_right) { right += is_right, ++of; }
    double percent() const { return of > 0 ? 100.0 * right / of : 0.0; }
};

struct EffectRow {
    Share top1, top3, family;
    int visible = 0;
    std::vector<double> place_mm;
};

struct ReliabilityBin {
    double mean_probability = 0.0;
    Share right;
};

struct Summary {
    double floor_mm = 0.0;  ///< median gap of the controls without noise, where a body has none of its own
    std::map<std::string, double> body_floor_mm;
    int failed = 0;
    Share top1, top3, family, kind;  ///< visible single causes; kind: sensor or not, of those where a cause is named
    Share declared;                  ///< the same: right, or the answer says that the right one cannot be told from it
    Share top1_all, top3_all;
    Share invisible_none;                 ///< causes below the floor answered "none"
    Share false_alarm;                    ///< controls; `right` counts the alarms
    Share withheld_unknown;               ///< visible, withheld: "unknown" or another effect of its family
    Share withheld_declared;              ///< ... or what the full answer declares inseparable from it
    Share false_unknown;                  ///< visible, not withheld; `right` counts the answers "unknown"
    Share two_both, two_one;              ///< two causes, each of them visible: both named, at least one
    Share two_seen;                       ///< two causes, one of them visible: named is that one, or both
    Share coverage;                       ///< true shrinkage within ci95, mechanical causes
    std::vector<double> true_shrinkage;   ///< visible, right cause named
    std::vector<double> wrong_shrinkage;  ///< visible, wrong cause named
    std::vector<double> place_mm, seconds, peak_mb;
    std::array<ReliabilityBin, 10> reliability{};
    double ece = 0.0;
    /// What the calibration error of answers as sure as these would be on average if they were calibrated: with few
    /// cases much of it is chance. Within a bin the number right is then a sum of Bernoulli(p_i).
    double ece_of_chance = 0.0;
    std::map<std::string, EffectRow> effects;
    std::map<std::string, std::map<std::string, int>>
        confusion;  ///< truth -> answer -> count, visible causes and controls
};

/// visible: nominal gap above 1.5 x the floor of that body's control; of a body without one, the controls' median (0.35
/// without any). `floor_mm`: in place of all of them.
Summary summarise(std::span<const CaseResult> results, std::optional<double> floor_mm = {});

double median(std::vector<double> values);  ///< NaN if empty

/// E |X - sum p_i| of X, the number of events that happen with probabilities p_i, each on its own.
double mean_deviation(std::span<const double> probabilities);

}  // namespace teres::blindtest
