// The search for one effect: screened by first order, the best refitted with everything free.
#pragma once

#include "plugins/diagnosis/cause_fit.h"

namespace teres {

/// The part of a static recording that counts as its beginning: what happens later is not in it.
inline constexpr double kBeginning = 1.0 / 3.0;
inline std::size_t beginning_of(const Recording& recording) {
    return static_cast<std::size_t>(kBeginning * static_cast<double>(recording.num_frames));
}

/// Screens all effects on top of `base` and refits and finishes the best; best score first. Where `base` is null (the
/// nominal fit, which then is the simulator's base) they are in no order, nothing is finished yet (search_steps.h), and
/// effects that were only screened are among them with their linear score. With inertia sets of several may be among
/// them, and the best ones settled (search_from_swing()). `before`: fitted to other data, where it goes on first; or
/// null.
std::vector<Cause> search(Problem& problem, const Fit& nominal, const Base* base, Screening& screening,
                          const Cause* before = nullptr);

/// A body that is parted at some time (`cut`) may hang on a ligament that let go then: where a cut is ahead, a tear
/// that first order left out is fitted; whether one was. What was fitted need not be finished yet: a cut that will not
/// stand is not worth it.
bool look_for_tears(Problem& problem, const Fit& nominal, const Screening& screening, std::vector<Cause>& causes);

/// Before several effects are named, supports among them (contact, slackness) get a fit that starts at full size;
/// before `unknown` is said, all of them, and, unless a single effect explains nearly everything, effects
/// that look worse at first order than they are their fit. True: the best of `causes` is a new one.
bool look_again(Problem& problem, const Fit& nominal, const Screening& screening, std::vector<Cause>& causes);

}  // namespace teres
