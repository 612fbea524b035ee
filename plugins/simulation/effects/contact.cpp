// contact: a smooth body (rib, stomach, diaphragm) that the surface touches but does not enter: a sphere of
// radius R at a gap from a place of the surface, penalty k per area, no friction (obstacles.h). A large R is
// a plane.
#include "plugins/simulation/effects/effect.h"
#include "plugins/simulation/effects/places.h"

namespace teres {
namespace {

class Contact final : public Effect {
  public:
    explicit Contact(const Scene& scene) {
        d_.id = "contact";
        d_.kind = "boundary";
        d_.family = "one-sided or extra support";
        d_.summary = "something that the surface runs into";
        d_.source = "gap 0-1.5 mm assumed";
        d_.parameters = {amplitude("stiffness", "N/m3", EffectTransform::kIdentity, 0.0, 2e6, 0.0, 2e8)};
        add_centre(d_.parameters, scene);
        d_.parameters.push_back(shape("gap", "m", 0.0, 0.002, -0.01, 0.03));
        d_.parameters.push_back(
            log_shape("radius", "m", 0.3 * scene.size_m, 1.0, 0.02 * scene.size_m, 20.0 * scene.size_m));
        for (const auto& p : surface_places(scene, 100, true))
            for (const double gap : {0.0, 0.002})
                d_.candidates.push_back({one_sigma(d_.parameters[0]), p.x(), p.y(), p.z(), gap, 0.3 * scene.size_m});
        if (d_.candidates.empty()) d_.not_applicable = "the whole surface is attached";
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        const Eigen::Vector3d place(v[1], v[2], v[3]);
        Eigen::Index nearest = -1;
        const auto& mesh = scene.mesh;
        for (std::size_t i = 0; i < mesh.num_nodes(); ++i)
            if (const auto k = static_cast<Eigen::Index>(i);
                mesh.node_area[i] > 0.0 &&
                (nearest < 0 || (mesh.X.col(k) - place).squaredNorm() < (mesh.X.col(nearest) - place).squaredNorm()))
                nearest = k;
        const Eigen::Vector3d normal = mesh.node_normal.col(nearest);
        // the foot of the place on the tangent plane: the obstacle moves smoothly with the parameters
        const Eigen::Vector3d foot = place - normal.dot(place - mesh.X.col(nearest)) * normal;
        Obstacle o;
        o.radius_m = v[5];
        o.centre = foot + (v[4] + v[5]) * normal;
        o.stiffness_n_per_m3 = v[0];
        for (std::size_t i = 0; i < mesh.num_nodes(); ++i)
            if (mesh.node_area[i] > 0.0) {
                o.node.push_back(static_cast<NodeIndex>(i));
                o.area_m2.push_back(mesh.node_area[i]);
            }
        scene.obstacles.add(std::move(o));
    }
};

}  // namespace

std::unique_ptr<Effect> make_contact(const Scene& nominal) {
    return std::make_unique<Contact>(nominal);
}

}  // namespace teres
