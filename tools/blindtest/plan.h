// Which cases a blind test has: draws (patients) x effects, in an order that tells nothing, dealt to shards.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"

namespace teres::blindtest {

struct PlanOptions {
    std::uint64_t seed = 1;
    int cases = 29;                    ///< single causes and controls
    int two_causes = 0;                ///< cases with two effects, after the others
    std::vector<std::string> effects;  ///< empty: all, with controls ("none") among them
    bool quasi_static = false;         ///< cases with inertia are left out, the others keep their names
    int shard = 0, shards = 1;         ///< contiguous part `shard` of `shards`
    /// Of a given body: only what it can show, all on the same patient. Without: every draw is a patient of its own.
    struct Given {
        bool clamped = false, dynamic = false, ligament = true;
    };
    std::optional<Given> given;
};

struct CaseSpec {
    std::string name;                  ///< "c0007"
    std::uint64_t draw = 0;            ///< patient
    std::vector<std::string> effects;  ///< empty: control
    bool clamped = false, dynamic = false;
};

/// The cases of the shard. Errors (kInvalidInput): unknown effect, counts or shard out of range, none that the given
/// body can show.
Result<std::vector<CaseSpec>> plan_cases(const PlanOptions& options);

}  // namespace teres::blindtest
