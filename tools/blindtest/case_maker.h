// Makes sealed cases: cases/<name>/ is all that a diagnosis may see, sealed/<name>/ holds label.json, the true motion
// of the points (validation.csv) and of the markers (markers.csv). The seal is the SHA-256 of a list of SHA-256 sums of
// sealed/.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <tuple>

#include "core/result.h"
#include "tools/blindtest/effect_draws.h"
#include "tools/blindtest/plan.h"

namespace teres::blindtest {

class CaseMaker {
  public:
    /// `scratch`: CalculiX works here; its last job stays.
    CaseMaker(std::uint64_t seed, std::filesystem::path out, std::filesystem::path scratch)
        : seed_(seed), out_(std::move(out)), scratch_(std::move(scratch)) {}

    enum class Outcome { kMade, kWasThere, kDiscarded };
    /// A case whose solution does not converge is drawn again twice, one that shows too little eleven times; then it is
    /// discarded (label.json says so).
    /// Of a given body all cases are of one patient: others are drawn until one has a solution.
    /// Errors: kHostFault (ccx missing, disk); kNotUsable: none of the patients of a given body has a solution.
    Result<Outcome> make(const CaseSpec& spec);
    /// Sizes of the bodies (tests make small ones).
    BodyOptions body_options;
    /// What each effect must move the markers by, beside what the ligament explains, rms [m]; `noise` moves nothing.
    double least_gap_m = 0.0;

  private:
    // A patient with its control motion and what ligament unknowns alone could explain.
    struct Patient {
        TruthBody body;
        Motion control;
        std::vector<Motion> ligament_changes;
    };
    using Key = std::tuple<std::uint64_t, bool, bool>;
    Result<const Patient*> patient(const CaseSpec& spec);
    Result<std::unique_ptr<Patient>> make_patient(const CaseSpec& spec, std::uint64_t number) const;
    Status make_once(const CaseSpec& spec, const Patient& patient, int attempt);
    /// kNotUsable: what the scenario shows at a few frames is far less than it must.
    Status try_few_frames(const std::string& id, const Scenario& scenario, const Patient& patient) const;

    std::uint64_t seed_;
    std::filesystem::path out_, scratch_;
    std::map<Key, Result<std::unique_ptr<Patient>>> patients_;  // also those that have no solution
};

/// "hash  sealed/c0001/label.json" lines (sha256sum -c reads them) of every sealed file of the cases.
Result<std::string> seal_list(const std::filesystem::path& out, std::span<const CaseSpec> cases);
std::string sha256(const std::string& bytes);

/// Rms over frames and markers of what is left of `difference` after the best fit of `explained` (least squares) [m].
double unexplained_rms(const Frames& difference, const std::vector<Frames>& explained);

/// What one of several effects shows [m]: no more than neither `explained` nor another size of the other effects makes
/// up for, and no more than it would without them (a delay beside a heartbeat is as well another phase of that).
/// `steps`: what each adds to what the camera sees on top of those before it; `alone`: what it adds without them.
double shown_rms(std::size_t effect, const std::vector<Frames>& steps, const std::vector<Frames>& alone,
                 std::vector<Frames> explained);

}  // namespace teres::blindtest
