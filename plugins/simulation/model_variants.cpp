#include "plugins/simulation/model_variants.h"

#include <utility>

namespace teres {

std::vector<ModelVariant> model_variants(const Case& c, const PlayerSettings& settings, const Scene& scene) {
    std::vector<ModelVariant> variants;
    const auto add = [&](std::string name, std::function<void(Case&, PlayerSettings&)> change) {
        variants.push_back({std::move(name), std::move(change)});
    };
    const bool dynamic = scene.dynamic;  // 10-node tetrahedra would take minutes for a second of motion
    if (settings.model.element != ElementType::kQuadratic && !dynamic)
        add("10-node tetrahedra", [](Case&, PlayerSettings& s) { s.model.element = ElementType::kQuadratic; });
    add("nodal shear", [](Case&, PlayerSettings& s) { s.model.shear_blend = 0.1; });
    add("element shear", [](Case&, PlayerSettings& s) { s.model.shear_blend = 1.0; });
    // The atlas says where a ligament may hold, not with which nodes of a group.
    if (scene.tethers.ligament_end > 0) {
        add("ligament to one side", [](Case&, PlayerSettings& s) { s.model.ligament.lean = 0.5; });
        add("ligament to the other side", [](Case&, PlayerSettings& s) { s.model.ligament.lean = -0.5; });
        add("narrow ligament", [](Case&, PlayerSettings& s) { s.model.ligament.sharpness = 2.0; });
    }
    const BodyLaw law = c.body.law;
    if (law != BodyLaw::kNeoHookean)
        add("neo-Hookean", [](Case& other, PlayerSettings&) { other.body.law = BodyLaw::kNeoHookean; });
    if (law != BodyLaw::kStVK)
        add("Saint Venant-Kirchhoff", [](Case& other, PlayerSettings&) { other.body.law = BodyLaw::kStVK; });
    if (law == BodyLaw::kOgden)
        for (const double alpha : {-2.0, 4.0})
            add("Ogden alpha " + std::to_string(static_cast<int>(alpha)),
                [alpha](Case& other, PlayerSettings&) { other.body.alpha = alpha; });
    return variants;
}

}  // namespace teres
