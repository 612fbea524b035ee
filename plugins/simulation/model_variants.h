// Other models of the same body: where they differ from the default one is its own error, not the patient's.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "core/case/case.h"
#include "plugins/simulation/scene_player.h"

namespace teres {

struct ModelVariant {
    std::string name;
    std::function<void(Case& c, PlayerSettings& settings)> change;
    double share = 1.0;  ///< standard deviation of what it changes, in such changes
};

/// Meshes, shares of nodal strain, laws, how far clamps reach, and where within its groups a ligament holds.
std::vector<ModelVariant> model_variants(const Case& c, const PlayerSettings& settings, const Scene& scene);

/// The listed frames of the recording under `h` by a variant of the model of `c` and `settings`. nominal: where the
/// default model's nodes are at all frames (3N each); of a quasi-static recording a frame begins there; empty: at the
/// frame before. markers_m: 3 per marker [m] at each listed frame, points_m: 3 per validation point or nothing; NaN at
/// those of a quasi-static recording that do not converge.
TrajectoryReport play_variant(const ModelVariant& variant, const Case& c, const PlayerSettings& settings,
                              const Hypothesis& h, std::span<const std::int32_t> frames,
                              std::span<const Eigen::VectorXd> nominal, std::span<double> markers_m,
                              std::span<double> points_m);

}  // namespace teres
