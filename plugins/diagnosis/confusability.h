// What a recording of these markers under these loads could reveal, before any marker is looked at: how visible each
// effect is and which others could stand in for it.
//
//     visibility  chi^2 = tr(S_cc)                           at one prior standard deviation, nuisance projected out
//     overlap     tr(S_cd (I + S_dd)^-1 S_dc) / tr(S_cc)     share of c's signature that d reproduces
//     S_cd = G_c^T (I + J J^T)^-1 G_d
#pragma once

#include <string>
#include <vector>

#include "plugins/diagnosis/screening.h"

namespace teres {

struct Confusability {
    std::vector<std::size_t> entries;  ///< of the table, in its order
    std::vector<double> visibility;
    Eigen::MatrixXd overlap;  ///< (c, d): share of c that d reproduces; 1 on the diagonal

    /// Entries that reproduce at least `bound` of `entry`.
    std::vector<std::size_t> rivals(std::size_t entry, double bound) const;
};

Confusability confusability(const Screening& screening, const Eigen::MatrixXd& nuisance);

/// What to do to tell `a` from `b`, or (b empty) to make `a` visible: a sentence for users.
std::string separating_experiment(const std::string& a, const std::string& b);

}  // namespace teres
