// Where ligaments attach: a common shape of the liver with, for each ligament, how densely the annotated
// livers carry it, and the way from there to the vertices of a new liver.
//
//     f(v) = 1/n sum_i  k(d_i(v)/h) / integral k,   k a Gaussian, d_i the distance to the attachment of liver
//     i
//                                                   carried over to the common shape [1/m^2]
//     q(v) = integral of f over {f < f(v)}          {q >= 1 - c} is the smallest region that holds c of f
//     p(v) = q for q >= 0.1, below 0.1 (q/0.1)^g    with g such that {p < 0.1} holds a tenth of the integral
//     of p
//
// p(v) is the chance that the ligament runs at least as far out as v. So {p >= 0.5} is the expected strip,
// and {p >= 0.1} is the 90 % region, which is also the smallest region with 90 % of the sum of p. The
// bandwidth h is the one with which, leaving one liver out at a time, the 90 % region covers 90 % of the true
// attachment.
#pragma once

#include <Eigen/SparseCore>
#include <functional>

#include <Eigen/SparseCore>
#include "tools/atlas/annotated_livers.h"

#include "tools/atlas/registration.h"

namespace teres {

inline constexpr double kRegionLevel = 0.1, kStripLevel = 0.5;
inline constexpr int kTrustedLivers = 5;  ///< below, the spread is the default bandwidth, not a measured one

struct AtlasLigament {
    std::string name;
    int num_livers = 0;
    double bandwidth_m = 0.0;
    Eigen::VectorXd density;        ///< f at the vertices of `fine` [1/m^2]
    Eigen::VectorXd density_stdev;  ///< of f, jackknife over the livers
};

struct LigamentAtlas {
    TriangleSurface shape;  ///< common shape, RAS [m]
    TriangleSurface fine;   ///< each triangle of `shape` in four: vertices of shape, then edge middles
    std::vector<AtlasLigament> ligaments;
    std::string source;  ///< where the livers come from, licence

    const AtlasLigament* find(const std::string& name) const;
};

/// Each triangle in four.
TriangleSurface subdivided(const TriangleSurface& surface);

struct CarriedLiver {
    Registration registration;
    std::map<std::string, std::vector<Eigen::Vector3d>> marks;  ///< on the common shape
    Eigen::SparseMatrix<double> to_nodes;                       ///< values at `fine` -> values at the liver's vertices
    Eigen::VectorXd area;                                       ///< of the liver's vertices [m^2]
};
struct AtlasBuild {
    LigamentAtlas atlas;
    std::vector<CarriedLiver> carried;                         ///< as the livers given
    std::map<std::string, std::vector<std::size_t>> carriers;  ///< of each ligament, indices of livers
};
/// `origin`: index of the folder of each liver; a ligament is taken from the first folder that has it.
/// `done` is called after each registration.
Result<AtlasBuild> build_atlas(const std::vector<AnnotatedLiver>& livers, const std::vector<int>& origin,
                               const std::function<void()>& done);
/// Registrations that build_atlas makes.
std::size_t num_registrations(std::size_t num_livers);

Status save_atlas(const LigamentAtlas& atlas, const std::filesystem::path& folder);
Result<LigamentAtlas> load_atlas(const std::filesystem::path& folder);

/// p at the vertices from f at the vertices and their areas.
Eigen::VectorXd attachment_probability(const Eigen::VectorXd& density, const Eigen::VectorXd& area);

struct Transfer {
    Eigen::VectorXd probability;  ///< p per vertex of the surface
    Eigen::VectorXd stdev;        ///< of p, from that of f
    double registration_rms_m = 0.0, rotation_rad = 0.0;
};
/// `surface` in RAS within 30 degrees, checked by check_liver. Errors (kInvalidInput): mirrored or upside
/// down (the atlas fits the turned surface clearly better); kNotUsable: the shape does not come to lie on the
/// surface.
Result<Transfer> transfer_atlas(const LigamentAtlas& atlas, const AtlasLigament& ligament,
                                const TriangleSurface& surface, const std::string& name);

/// Leave-one-out: labels and bandwidth without the liver; the common shape is that of all.
struct HeldOutLiver {
    std::string name;
    double mean_mm = 0.0, p95_mm = 0.0;         ///< true attachment nodes to the expected strip
    double line_mm = 0.0;                       ///< to as many nodes of highest probability as the truth has
    double coverage = 0.0, region_share = 0.0;  ///< true nodes in the 90 % region; its share of the surface
    double bandwidth_m = 0.0;
    std::vector<double> distances_mm;
    std::vector<double> levels;  ///< p of the true nodes
    Eigen::VectorXd probability;
};
std::vector<HeldOutLiver> leave_one_out(const AtlasBuild& build, const std::vector<AnnotatedLiver>& livers,
                                        const std::string& ligament);

}  // namespace teres
