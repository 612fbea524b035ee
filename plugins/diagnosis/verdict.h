// From fitted hypotheses to probabilities. One scale-free score per answer [nats]:
//
//     cause c:   -(nu/2) (ln above_c - ln above_0) - price_c,
//                price_c = tail(a) + sum tail(scale) + max(search_c, narrow_c) + 1/2 ln|I + (nu/above_f) S_c|
//                          + that of further effects,
//                above_f: at the floor, or at c if that is below: what leaves much does not pay less for it,
//                narrow_c: what 1/2 ln|I + ...| grows by when places and times count beside the amplitudes
//     unknown:   g - price_u,   g = -(nu/2) (ln above_rest - ln above_0), rest = what right causes leave: a share of
//                the model error + a share of what is beyond it (none of what the sensors of the best explain),
//                price_u = that of the best cause that leaves no more than it (of a single one where a single one is
//                the best), or else of the best, but for what that pays for its scales and for extreme amplitudes: an
//                effect that nobody thought of is not simpler than those one did, nor dearer than any single one, nor
//                is it bent into place; besides that it is rarer
//     none:      bonus against the larger of ln sum exp(scores) and g - least price: that something is amiss may be
//                certain before anything is named
//
// A softmax over causes and unknown, times the probability that it is not none; tempered, and never quite sure
// (calibration.h).
//
// above: cost beyond the stated noise (error_floor.h).
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "plugins/diagnosis/calibration.h"
#include "plugins/diagnosis/joint_fit.h"
#include "plugins/diagnosis/screening.h"

namespace teres {

/// What a fitted cause pays [nats].
struct Price {
    double tail = 0.0;     ///< far amplitudes
    double extreme = 0.0;  ///< of `tail`, what is more than for Calibration::unknown_amplitude
    double scales = 0.0;   ///< far scales: radii, times, frequencies (shapes whose prior is of their logarithm)
    double occam = 0.0;    ///< amplitudes that had to be fitted
    double search = 0.0;   ///< places and times that were tried
    double narrow = 0.0;   ///< places and times fitted, beyond `search`
    double further = 0.0;  ///< effects beyond the first
    double total() const { return tail + scales + occam + search + narrow + further; }
};

/// Where the last effect of a cause may be as well.
struct OtherPlace {
    std::array<double, 3> center_m;
    double odds = 0.0;  ///< its probability over that of the cause's own place
};

/// A set of effects that was fitted (or only screened).
struct Cause {
    std::vector<std::size_t> entries;
    Fit fit;                   ///< of the refit; not usable if only screened
    double search_cost = 0.0;  ///< sum over its effects
    double misfit = 0.0;       ///< of a fitted cause: whitened cost without the price of its amplitudes
    /// The same where what its effects may get wrong of their form is not held against it (form_columns.h): known if
    /// more was searched on top of it, and of the best.
    std::optional<double> misfit_beside_forms{};
    /// Model part of the error floor in the state that the body is in under it, if it was asked for.
    std::optional<double> model_error{};
    bool rough_form = false;  ///< of its first effect, which explains most (effect_table.h)
    bool lets_go = false;     ///< its first effect is a cut that lets a ligament go
    bool sensors = false;     ///< nothing but sensor effects
    Price price{};            ///< of a fitted cause
    double score = 0.0;
    /// Nats that the score leaves out: of what each further effect explains, what other forms of those before it
    /// explain too (with inertia: of the last one).
    double form_nats = 0.0;
    double probability = 0.0;
    double explained = 0.0;                  ///< share of the cost above the floor that it takes away
    std::vector<OtherPlace> other_places{};  ///< most likely first

    Left left() const { return {misfit, fit.beside}; }
};

struct Verdict {
    std::vector<Cause> causes;  ///< most probable first
    double none_probability = 0.0;
    double unknown_probability = 0.0;
};

/// Of the score of a fitted cause, what it has because parts inside and beside the span of the motion are told apart:
/// the screening does not.
double told_apart(const Fit& nominal, const Cause& cause, const ErrorFloor& floor, const Calibration& calibration);
/// What a fit leaves, with the price of its parameters.
inline Left left_of(const Fit& fit) {
    return {fit.compared_cost(), fit.beside};
}
/// Whitened cost of a fit without the price of its effects' parameters.
double misfit_of(const Fit& fit, Eigen::Index nominal_parameters);
/// Score of a refitted cause against the nominal fit; fills misfit and price.
double refit_score(const Fit& nominal, Cause& cause, const EffectTable& effects, const ErrorFloor& floor,
                   const Calibration& calibration);
/// Share of the nominal cost above the floor explained by `cost`.
double explained_share(double cost_null, double cost, const ErrorFloor& floor);
/// What an effect that nobody thought of would gain [nats], before its price.
double unknown_gain(const Left& nominal, const ErrorFloor& floor, const Calibration& calibration);
/// Fills probabilities and sorts.
Verdict judge(std::vector<Cause> causes, const Left& nominal, const ErrorFloor& floor, const Calibration& calibration);

}  // namespace teres
