// One hypothesis fitted and scored: effects added to what is known, everything refitted.
#pragma once

#include "plugins/diagnosis/problem.h"

namespace teres {

/// Nats by which a set is worse than with one effect less: neither finished nor given on.
inline constexpr double kHopeless = 8.0;

/// What one more effect is searched on top of: known effects, which may be off in their form (form_columns.h).
struct Base {
    const Cause& known;
    Whitener looser;           ///< with the columns of their forms
    Fit fit;                   ///< theirs, completed under `looser`
    Left left;                 ///< of `fit`
    bool global_only = false;  ///< what is left is so little that anything local could be an error of their form
    double far_nats = 0.0;     ///< what the known effects pay for being far from their prior, if that is the reason
};

/// One more effect on top of what is known (null: of the nominal fit), refitted with everything free.
Cause refit(Problem& problem, const Fit& nominal, const Cause* known, const EffectScreening& added, int iterations);

/// Whether an effect alone is fitted from where it acts at full size: a tear of a static recording.
bool at_full_size(const Problem& problem, const EffectEntry& entry);

/// The same of a tear alone, the best of fits from the few places and extents where it leaves the least at full size:
/// how far it reaches and when it happens are not seen by first order. From first order where no body holds so.
Cause refit_torn(Problem& problem, const Fit& nominal, const EffectScreening& added, int iterations);

/// A fit of the whole recording that begins with every frame solved, one after the other: a body may have several
/// equilibria, and the one that another hypothesis leads to need not be that of its course; with inertia the motions
/// that its steps move in are those about this course. Not usable if that does not converge.
Fit fit_from_whole(Problem& problem, const Assumption& start, int iterations);

/// The same from where an effect acts at full size, about the instant and the shape that leave the least.
Fit fit_from_full_size(Problem& problem, const Assumption& start, int iterations);

/// A cause (its effects and their search cost) fitted and scored from given values.
Cause fitted_from(Problem& problem, const Fit& nominal, Cause cause, const Assumption& start, int iterations);

/// A fit of an event whose last effect happens at another instant than descent led to, fitted on from there: every
/// instant is tried (at_best_instant).
void settle_instant(Problem& problem, Fit& fit, int iterations);

/// Fits on from where the cause is until little is gained: not settled, what is left of its own would be explained by
/// whatever is added to it. Scored by the caller.
void settle(Problem& problem, Cause& cause, int iterations);

/// Fills score and explained. `base`: what the cause was searched on top of, or null.
void score(Problem& problem, const Fit& nominal, const Base* base, Cause& cause);

/// What beside another set looser forms of that explain as well (its Cause::form_nats) is no evidence beside this one
/// either, though what it has in its place has another form, or one that is exact.
void pay_alike(double form_nats, Cause& cause);

/// What a fit leaves under another whitener, without the price of its effects.
Left left_under(const Problem& problem, const Whitener& whitener, const Fit& fit, Eigen::Index nominal_parameters);

/// The effect `noise` moves nothing; it is worth the white part of what is left.
void take_noise(Problem& problem, Fit& fit);

/// The amplitudes of an effect half way back to where it is off.
void halve(const EffectEntry& entry, ActiveEffect& effect);

bool contains(const Cause& cause, std::size_t entry);

/// Adds a cause, or puts it in the place of a worse one of the same effects.
void keep_better(std::vector<Cause>& causes, Cause cause);

/// The fitted cause that consists of this effect alone, or null.
const Cause* fitted_alone(const std::vector<Cause>& causes, std::size_t entry);

/// The best cause if it pays and what it leaves may be weighed: without inertia, and while time is left; or null.
Cause* best_to_weigh(const Problem& problem, std::vector<Cause>& causes);

/// Of the best; 0 if none has more.
double best_score(const std::vector<Cause>& causes);

/// Best score first.
void sort_by_score(std::vector<Cause>& causes);

/// What `known` may leave because a mechanical effect never has quite the form of the catalogue's.
Left form_error(const Problem& problem, const Fit& nominal, const Cause& known);

/// What of that looser forms of the known effects may miss: hardly more than what they take up, where they tell.
Left untold_form_error(const Problem& problem, const Fit& nominal, const Base& base);

}  // namespace teres
