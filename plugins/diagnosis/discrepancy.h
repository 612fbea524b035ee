// What our own model gets wrong: simulations of the same body by other models (finer meshes, other laws), minus the
// nominal one, at a few draws of the nominal parameters; condensed to few space-time columns whose coefficients are
// N(0,1). Carried in every fit, so that mesh and material error of our own is not blamed on the patient.
//
//     d_k = variant(theta_k) - nominal(theta_k),     D D^T = 1/K sum d_k d_k^T  (leading columns)
//
// Variants are simulated at some frames; between them each d_k follows the temporal modes of the nominal motion.
#pragma once

#include <Eigen/Dense>
#include <cstdint>
#include <filesystem>

#include "core/result.h"
#include "plugins/diagnosis/simulator.h"

namespace teres {

struct Discrepancy {
    Eigen::MatrixXd columns;      ///< 3 M F rows [m]; no columns if the model has no variants
    Eigen::MatrixXd at_points;    ///< the same columns at the validation points, 3 P F rows [m]
    Eigen::VectorXd remainder_m;  ///< rms of what the columns leave of the ensemble at each frame (F), per row
    int runs = 0;                 ///< simulations behind it
    bool from_cache = false;
};

/// Of the model under an assumption without sensor effects, which becomes the simulator's base. Errors (kNotUsable): it
/// does not converge there.
Result<Discrepancy> discrepancy_about(Simulator& simulator, const Assumption& at, const Simulator::Progress& progress);

/// At the prior median, where it leaves the simulator's base. `cache`: folder, created if needed; empty: nothing is
/// kept. `key` names body, loads, markers and settings. Errors (kNotUsable): the nominal model does not converge there.
Result<Discrepancy> discrepancy_of(Simulator& simulator, const std::filesystem::path& cache, std::uint64_t key,
                                   const Simulator::Progress& progress);

}  // namespace teres
