// Every candidate of every effect by its first-order signature: closed-form linear-Gaussian evidence in which nominal
// parameters and what is already named are marginalised,
//
//     r ~ N(0, I + J J^T + G G^T)     r: residual at the prior mean, J: nuisance, G: signature of the candidate
//     cost_c = min over a of  (r - G a)^T (I + J J^T)^-1 (r - G a),   a within the physical bounds
//     score  = -(nu/2) ln(above(cost_c) / above(cost_0)) - price(a, (nu/above(cost_c)) S),
//     S = G^T (I + J J^T)^-1 G,   above: error_floor.h,   price: amplitude_price.h
//
// scale-free and counting nu samples (calibration.h), averaged over the candidates of an effect.
#pragma once

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "plugins/diagnosis/error_floor.h"
#include "plugins/diagnosis/joint_fit.h"

namespace teres {

/// Share of the nominal cost that an effect must explain by first order to be worth a fit.
inline constexpr double kLeastExplained = 0.02;

/// The best candidate of an effect at one place of its search grid, among those that move the same amplitudes.
struct PlaceGain {
    Eigen::Vector3d centre_m;
    double score = 0.0, explained = 0.0;  ///< as in EffectScreening
    ActiveEffect start;
    std::size_t candidate = 0;
};

struct EffectScreening {
    std::size_t entry = 0;
    double score = 0.0;                  ///< ln of the mean over candidates of exp(score) [nats]
    double search_cost = 0.0;            ///< best candidate's score minus `score`
    double explained = 0.0;              ///< share of cost_0 that the best candidate takes away
    ActiveEffect start;                  ///< best candidate with fitted amplitudes
    std::vector<ActiveEffect> beside{};  ///< with it, known effects start here and not where they were (beginnings.h)
    std::size_t candidate = 0;           ///< which one that is
    std::vector<PlaceGain> places;       ///< map over the body; empty for effects without a place
    std::size_t num_candidates = 0;
    double visibility = 0.0;    ///< S of the best-visible candidate: chi^2 at one prior standard deviation
    Eigen::MatrixXd signature;  ///< (I + J J^T)^-1/2-weighted columns of the best-visible candidate, for overlaps
};

struct Screening {
    double cost_null = 0.0;
    std::vector<EffectScreening> effects;  ///< best first; applicable effects only
    /// Static recordings: the best by the beginning alone, if it is more than the model's error there (search.h).
    std::optional<EffectScreening> of_beginning;
};

/// First-order responses of all candidates about a base.
struct Signatures {
    struct Candidate {  ///< one column per amplitude
        std::size_t entry, index;
        Eigen::Index first, count;
    };
    std::vector<Candidate> candidates;
    Eigen::MatrixXd changes;  ///< of full trajectories
};

/// `base` is the simulator's base (last simulate()); `skip`: entries already named.
Signatures signatures(Simulator& simulator, const Fit& base, const std::vector<std::size_t>& skip,
                      const Simulator::Progress& progress);

/// Distance from which two places count as different ones [m]: 0.12 of the diagonal of the box around all.
double apart_m(const std::vector<PlaceGain>& places);
/// The best places of an effect, each apart from the better ones.
std::vector<PlaceGain> best_places(std::vector<PlaceGain> places, std::size_t count);

/// num_frames: only so many frames from the first count (all: that of the simulator). A phase that runs away is first
/// order at the beginning only.
Screening screen(const Simulator& simulator, const Signatures& signatures, const Whitener& whitener,
                 const ErrorFloor& floor, const Fit& base, const Calibration& calibration, std::size_t num_frames);

}  // namespace teres
