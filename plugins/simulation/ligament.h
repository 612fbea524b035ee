// The prior ligament region as groups of surface nodes that share one unknown stiffness.
//
// Nodes with atlas probability above `min_probability` are clustered by place (weighted k-means,
// deterministic). A group g has one parameter theta_g [N/m], the stiffness of its patch of the band along the
// normal; fully attached it would be
//     theta_full = E A_g / h,      A_g = sum of its nodes' areas, h the band's height.
// theta_g is log-normal with ln-deviation s; the group counts as attached when theta_g > threshold = tau
// theta_full. Its median is chosen such that the prior attachment probability is the group's atlas
// probability p_g:
//     P(theta_g > threshold) = p_g   =>   ln median = ln threshold + s Phi^-1(p_g).
//
// Two models of what a group is made of:
//   band            a solid band glued to the surface, far edge fixed (tether.h); the default for a
//                   neo-Hookean ligament
//   cubic_springs   two layers of springs that pull and never push, extruded along the normal over the region
//                   (spring_fan.h): between the surface, a free layer at X + h/2 n and the far edge X + h n, each
//                   node joined to its own column and to those of its mesh neighbours, which take up shear. A
//                   column stretched by d along n pulls with theta w h phi(d/h)
#pragma once

#include <array>
#include <string>
#include <vector>

#include "core/case/case.h"
#include "core/result.h"
#include "plugins/simulation/tet_mesh.h"
#include "plugins/simulation/tether.h"

namespace teres {

struct LigamentSettings {
    int num_groups = 8;
    double min_probability = 0.02;  ///< atlas nodes below this are left out
    double log_stdev = 1.2;         ///< s
    double attached_share = 0.2;    ///< tau
    double shear_ratio = 0.0;       ///< r of tether.h; 0: from the band's proportions
    std::string model = "auto";     ///< auto (law of the case), band, cubic_springs
    /// cubic_springs: g1, g2, g3 of a spring's tension over E A / L, phi(e) = g1 e + g2 e^2 + g3 e^3, e its strain.
    std::array<double, 3> spring_law{1.0, 0.0, 1.0};
    // What else the same atlas allows: a node's share of its group is area p^sharpness exp(lean s), s its place across
    // the region (its narrowest direction) in standard deviations.
    double lean = 0.0, sharpness = 1.0;
};

struct LigamentGroup {
    double area_m2 = 0.0;
    double full_stiffness_n_per_m = 0.0;
    double threshold_n_per_m = 0.0;
    double prior_median_n_per_m = 0.0;
    double prior_probability = 0.0;
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
};

struct Ligament {
    std::vector<LigamentGroup> groups;
    std::vector<Tether> tethers;
    std::vector<NodeIndex> node;      ///< of the prior region
    std::vector<std::int32_t> group;  ///< per node
    std::vector<double> probability;  ///< atlas, per node
};

/// phi grows up to e = 1, and from the start. Errors: kInvalidInput, with the strain at which it does not.
Status check_spring_law(const std::array<double, 3>& g);

Ligament make_ligament(const TetMesh& mesh, const std::vector<NodeProbability>& prior, const LigamentData& data,
                       const LigamentSettings& settings);

/// Quantile of the standard normal distribution (Acklam's rational approximation, one Newton step).
double normal_quantile(double probability);

}  // namespace teres
