// What a recording of these markers under these loads could reveal, before any marker is looked at: how visible each
// effect is and which others could stand in for it.
//
//     visibility  chi^2 = tr(S_cc)                           at one prior standard deviation, nuisance projected out
//     overlap     tr(S_cd (I + S_dd)^-1 S_dc) / tr(S_cc)     share of c's signature that d reproduces
//     S_cd = G_c^T (I + J J^T)^-1 G_d                        of two together: G_d = [G_d1 G_d2]
#pragma once

#include <array>
#include <string>
#include <vector>

#include "plugins/diagnosis/screening.h"

namespace teres {

/// Columns of an effect, one per amplitude at one prior standard deviation: G, and W = (I + J J^T)^-1 G.
struct Signature {
    std::size_t entry = 0;
    Eigen::MatrixXd G, W;
    double visibility() const { return G.cwiseProduct(W).sum(); }
};
/// Share of c's signature that d reproduces.
double share_reproduced(const Signature& c, const Signature& d);

struct Confusability {
    std::vector<std::size_t> entries;  ///< of the table, in its order
    std::vector<double> visibility;
    Eigen::MatrixXd overlap;           ///< (c, d): share of c that d reproduces; 1 on the diagonal
    std::vector<Signature> sensors{};  ///< for pairs_instead(); of the best-visible candidate each

    /// Entries that reproduce at least `bound` of `entry`.
    std::vector<std::size_t> rivals(std::size_t entry, double bound) const;
    /// Pairs of sensors that together leave what the sensor `entry` leaves, while neither does alone
    /// (Calibration::same_evidence): what of it they do not reproduce stays of what it explains. `amplitudes`: its own
    /// in prior standard deviations. Nothing for another effect.
    std::vector<std::array<std::size_t, 2>> pairs_instead(std::size_t entry, const Eigen::VectorXd& amplitudes,
                                                          const Left& nominal, const Left& left,
                                                          const ErrorFloor& floor,
                                                          const Calibration& calibration) const;
};

Confusability confusability(const Screening& screening, const EffectTable& effects, const Eigen::MatrixXd& nuisance);

/// What to do to tell `a` from `b`, or (b empty) to make `a` visible: a sentence for users.
std::string separating_experiment(const std::string& a, const std::string& b);

}  // namespace teres
