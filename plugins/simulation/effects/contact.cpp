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
        add_surface_centre(d_, scene);
        d_.parameters.push_back(shape("gap", "m", 0.0, 0.002, -0.01, 0.03));
        d_.parameters.push_back(
            log_shape("radius", "m", 0.3 * scene.size_m, 1.0, 0.02 * scene.size_m, 20.0 * scene.size_m));
        for (const auto& p : surface_places(scene, 100, true))
            for (const double gap : {0.0, 0.002})
                d_.candidates.push_back({one_sigma(d_.parameters[0]), p.x(), p.y(), p.z(), gap, 0.3 * scene.size_m});
        if (d_.candidates.empty()) d_.not_applicable = "the whole surface is attached";
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        const auto& mesh = scene.mesh;
        // Position and normal change continuously with the place: so does the obstacle.
        const SurfacePoint place = scene.surface.closest({v[1], v[2], v[3]});
        const auto& triangle = scene.surface.triangles()[static_cast<std::size_t>(place.triangle)];
        Eigen::Vector3d normal = Eigen::Vector3d::Zero();
        for (std::size_t k = 0; k < 3; ++k) normal += place.barycentric[k] * mesh.node_normal.col(triangle[k]);
        normal.normalize();
        Obstacle o;
        o.radius_m = v[5];
        o.centre = Eigen::Map<const Eigen::Vector3d>(place.position_m.data()) + (v[4] + v[5]) * normal;
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
