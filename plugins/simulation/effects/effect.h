// A mechanical effect: something the nominal model leaves out, as named parameters with a prior and the
// change it makes to the scene of a frame (scene.h); energy, gradient and tangent then follow from the scene.
// One file per effect in this folder; CMakeLists.txt of the room lists them, the catalogue is made from that
// list.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "core/effect_description.h"
#include "plugins/simulation/scene.h"

namespace teres {

/// Where and when a body is parted (parted_body.h).
struct Crack {
    Eigen::Vector3d centre_m = Eigen::Vector3d::Zero(), normal = Eigen::Vector3d::UnitX();
    double radius_m = 0.0, instant_s = 0.0;
    bool operator==(const Crack&) const = default;
};

class Effect {
  public:
    virtual ~Effect() = default;
    const EffectDescription& description() const { return d_; }

    /// Changes the scene of one frame as the effect with these physical values would. The scene may be of
    /// another mesh or law than that the effect was made with.
    virtual void apply(std::span<const double> values, Scene& scene) const = 0;

    /// With these values the effect changes no scene but parts the body.
    virtual std::optional<Crack> crack(std::span<const double> /*values*/) const { return {}; }

  protected:
    EffectDescription d_;
};

/// All mechanical effects of the catalogue, in the order in which they act.
std::vector<std::unique_ptr<Effect>> make_effects(const Scene& nominal);

}  // namespace teres
