// The steps that the search (search.h) and its second look share.
#pragma once

#include "plugins/diagnosis/search.h"

namespace teres {

inline constexpr int kRefitIterations = 8, kFurtherIterations = 6;
/// Nats between a fitted cause and the screening of one that need not be fitted.
inline constexpr double kOutOfReach = 15.0;

/// Which screened effects deserve a refit: the best scores, and besides them those that explain most, because a local
/// cause between the points of the search grid looks worse than it is.
std::vector<std::size_t> worth_refitting(const Screening& screening, std::size_t by_score, std::size_t by_share);

/// What an effect must leave less than to come near the best one even if its amplitudes cost nothing.
Reach reach_of_best(const Problem& problem, const Fit& nominal, const std::vector<Cause>& causes,
                    const EffectEntry& added, double search_cost);

/// Effects fitted on top of what is known, two at a time; both are given up by what was known before.
std::vector<Cause> fit_beside(Problem& problem, const Fit& nominal, const Base* base,
                              const std::vector<Cause>& known_so_far, const std::vector<const EffectScreening*>& added,
                              int iterations);

/// The best cause from other places as well; the best few fitted to the end.
void finish(Problem& problem, const Fit& nominal, const Base* base, const Screening& screening,
            std::vector<Cause>& causes);

}  // namespace teres
