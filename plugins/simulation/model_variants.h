// Other models of the same body: where they differ from the default one is its own error, not the patient's.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "core/case/case.h"
#include "plugins/simulation/scene_player.h"

namespace teres {

struct ModelVariant {
    std::string name;
    std::function<void(Case& c, PlayerSettings& settings)> change;
};

/// Meshes, shares of nodal strain, laws, and where within its groups a ligament holds.
std::vector<ModelVariant> model_variants(const Case& c, const PlayerSettings& settings, const Scene& scene);

}  // namespace teres
