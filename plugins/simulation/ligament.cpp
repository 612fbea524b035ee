#include "plugins/simulation/ligament.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <set>

namespace teres {

using Eigen::Vector3d;

double normal_quantile(double probability) {
    // Bisection-free: start from the logistic approximation, then Newton on Phi(z) = p with Phi from erfc.
    const double p = std::clamp(probability, 1e-12, 1.0 - 1e-12);
    double z = std::log(p / (1.0 - p)) / 1.702;
    for (int i = 0; i < 50; ++i) {
        const double cdf = 0.5 * std::erfc(-z / std::numbers::sqrt2);
        const double pdf = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
        const double step = std::clamp((cdf - p) / std::max(pdf, 1e-300), -0.5, 0.5);
        z -= step;
        if (std::abs(step) < 1e-14) break;
    }
    return z;
}

namespace {

// Weighted k-means with farthest-point start: same input, same groups.
std::vector<std::int32_t> cluster(const std::vector<Vector3d>& points, const std::vector<double>& weight, int k) {
    std::vector<Vector3d> centre;
    Vector3d mean = Vector3d::Zero();
    double total = 0.0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        mean += weight[i] * points[i];
        total += weight[i];
    }
    mean /= total;
    std::vector<double> distance(points.size());
    for (std::size_t i = 0; i < points.size(); ++i) distance[i] = (points[i] - mean).norm() * std::sqrt(weight[i]);
    while (static_cast<int>(centre.size()) < k) {
        const auto next =
            static_cast<std::size_t>(std::max_element(distance.begin(), distance.end()) - distance.begin());
        if (!centre.empty() && distance[next] <= 0.0) break;  // fewer distinct places than groups
        centre.push_back(points[next]);
        for (std::size_t i = 0; i < points.size(); ++i) {
            const double d = (points[i] - points[next]).norm() * std::sqrt(weight[i]);
            distance[i] = centre.size() == 1 ? d : std::min(distance[i], d);
        }
    }
    std::vector<std::int32_t> label(points.size(), 0);
    for (int round = 0; round < 100; ++round) {
        bool changed = false;
        for (std::size_t i = 0; i < points.size(); ++i) {
            std::int32_t best = 0;
            for (std::size_t c = 1; c < centre.size(); ++c)
                if ((points[i] - centre[c]).squaredNorm() <
                    (points[i] - centre[static_cast<std::size_t>(best)]).squaredNorm())
                    best = static_cast<std::int32_t>(c);
            changed = changed || best != label[i];
            label[i] = best;
        }
        if (!changed && round > 0) break;
        std::vector<Vector3d> sum(centre.size(), Vector3d::Zero());
        std::vector<double> mass(centre.size(), 0.0);
        for (std::size_t i = 0; i < points.size(); ++i) {
            sum[static_cast<std::size_t>(label[i])] += weight[i] * points[i];
            mass[static_cast<std::size_t>(label[i])] += weight[i];
        }
        for (std::size_t c = 0; c < centre.size(); ++c)
            if (mass[c] > 0.0) centre[c] = sum[c] / mass[c];
    }
    return label;
}

// Tangential over normal stiffness of a band of width b and height h: shear and bending in series
// (Timoshenko) across the width, shear alone along the strip; the mean of the two directions.
double band_shear_ratio(const LigamentData& data) {
    const double shear_over_normal = 1.0 / (2.0 * (1.0 + data.poissons_ratio));  // G/E
    const double h = data.height_m;
    const double b = data.width_m > 0.0 ? data.width_m : (data.thickness_m > 0.0 ? data.thickness_m : h);
    const double along = shear_over_normal * 5.0 / 6.0;
    const double bending = b * b / (h * h);  // 12 E I/h^3 over E A/h, I = A b^2/12
    const double across = 1.0 / (1.0 / along + 1.0 / bending);
    return 0.5 * (along + across);
}

void add_band(const TetMesh& mesh, double height_m, double shear_ratio, const std::vector<double>& weight,
              const std::vector<double>& group_weight, Ligament& ligament) {
    for (std::size_t i = 0; i < ligament.node.size(); ++i) {
        Tether t;
        t.node = ligament.node[i];
        t.parameter = ligament.group[i];
        t.share = weight[i] / group_weight[static_cast<std::size_t>(ligament.group[i])];
        t.band = {mesh.X.col(t.node), mesh.node_normal.col(t.node), shear_ratio, height_m};
        ligament.tethers.push_back(t);
    }
}

// Place of each point along the narrower direction of the region on the surface, in standard deviations.
std::vector<double> places_across(const std::vector<Vector3d>& points, const std::vector<double>& weight,
                                  const Vector3d& normal) {
    Vector3d mean = Vector3d::Zero();
    double total = 0.0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        mean += weight[i] * points[i];
        total += weight[i];
    }
    mean /= total;
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    for (std::size_t i = 0; i < points.size(); ++i)
        spread += weight[i] / total * (points[i] - mean) * (points[i] - mean).transpose();
    const Eigen::Matrix3d tangential = Eigen::Matrix3d::Identity() - normal * normal.transpose();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(tangential * spread * tangential);
    const Vector3d across = axes.eigenvectors().col(1);  // the least is that of the normal, 0
    const double stdev = std::sqrt(std::max(axes.eigenvalues()(1), 0.0));
    std::vector<double> places;
    for (const Vector3d& p : points) places.push_back(stdev > 0.0 ? across.dot(p - mean) / stdev : 0.0);
    return places;
}

constexpr double kDiagonalShare = 0.5;  // of a layer's stiffness along the normal

void add_springs(const TetMesh& mesh, const LigamentData& data, const std::vector<double>& weight,
                 const std::vector<double>& group_weight, const std::array<double, 3>& g, Ligament& ligament) {
    std::map<NodeIndex, std::size_t> entry;
    std::vector<Vector3d> X, n;
    for (std::size_t i = 0; i < ligament.node.size(); ++i) {
        entry[ligament.node[i]] = i;
        X.emplace_back(mesh.X.col(ligament.node[i]));
        n.emplace_back(mesh.node_normal.col(ligament.node[i]));
    }
    std::vector<std::set<std::size_t>> around(X.size());
    for (const auto& f : mesh.surface)
        for (const auto a : f)
            for (const auto b : f)
                if (a != b && entry.contains(a) && entry.contains(b)) around[entry[a]].insert(entry[b]);
    std::vector<std::vector<std::size_t>> neighbours;
    for (const auto& set : around) neighbours.emplace_back(set.begin(), set.end());
    // a layer of height h/2 stretched by delta = d/2, weight 2: 2 (k2 delta + k1 delta^2 + k0 delta^3) = h phi(d/h)
    const double h = data.height_m;
    const auto fans =
        make_fans(X, n, ligament.node, neighbours, h, kDiagonalShare, {4.0 * g[2] / (h * h), 2.0 * g[1] / h, g[0]});
    for (std::size_t i = 0; i < fans.size(); ++i) {
        Tether t;
        t.kind = Tether::Kind::kFan;
        t.node = ligament.node[i];
        t.parameter = ligament.group[i];
        t.share = weight[i] / group_weight[static_cast<std::size_t>(ligament.group[i])];
        t.fan = fans[i];
        ligament.tethers.push_back(t);
    }
}

}  // namespace

Status check_spring_law(const std::array<double, 3>& g) {
    for (int percent = 0; percent <= 100; ++percent) {
        const double e = 0.01 * percent;
        const double slope = g[0] + 2.0 * g[1] * e + 3.0 * g[2] * e * e;
        if (!(slope > 0.0))
            return invalid_input("simulation.spring_g1, g2, g3 = " + std::to_string(g[0]) + ", " +
                                 std::to_string(g[1]) + ", " + std::to_string(g[2]) +
                                 ": the tension does not grow at a strain of " + std::to_string(e) + " (slope " +
                                 std::to_string(slope) + ", must be above 0)");
    }
    return {};
}

Ligament make_ligament(const TetMesh& mesh, const std::vector<NodeProbability>& prior, const LigamentData& data,
                       const LigamentSettings& settings) {
    Ligament ligament;
    std::vector<Vector3d> points;
    std::vector<double> weight;
    for (const auto& entry : prior) {
        const auto a = static_cast<std::size_t>(entry.node_id);
        if (entry.probability < settings.min_probability || mesh.node_area[a] <= 0.0) continue;
        ligament.node.push_back(entry.node_id);
        ligament.probability.push_back(entry.probability);
        points.push_back(mesh.X.col(entry.node_id));
        weight.push_back(mesh.node_area[a] * entry.probability);
    }
    if (points.empty()) return ligament;
    ligament.group = cluster(points, weight, std::min<int>(settings.num_groups, static_cast<int>(points.size())));
    if (settings.lean != 0.0 || settings.sharpness != 1.0) {
        Vector3d normal = Vector3d::Zero();
        for (std::size_t i = 0; i < weight.size(); ++i) normal += weight[i] * mesh.node_normal.col(ligament.node[i]);
        const std::vector<double> across = places_across(points, weight, normal.normalized());
        for (std::size_t i = 0; i < weight.size(); ++i)
            weight[i] *= std::pow(ligament.probability[i], settings.sharpness - 1.0) *
                         std::exp(settings.lean * std::clamp(across[i], -3.0, 3.0));
    }
    const auto num_groups =
        static_cast<std::size_t>(*std::max_element(ligament.group.begin(), ligament.group.end()) + 1);
    ligament.groups.resize(num_groups);
    std::vector<double> group_weight(num_groups, 0.0);
    for (std::size_t i = 0; i < points.size(); ++i) {
        auto& g = ligament.groups[static_cast<std::size_t>(ligament.group[i])];
        g.area_m2 += mesh.node_area[static_cast<std::size_t>(ligament.node[i])];
        g.centre += weight[i] * points[i];
        group_weight[static_cast<std::size_t>(ligament.group[i])] += weight[i];
    }
    for (std::size_t g = 0; g < num_groups; ++g) {
        auto& group = ligament.groups[g];
        group.centre /= group_weight[g];
        group.prior_probability = std::clamp(group_weight[g] / group.area_m2, 0.02, 0.98);
        group.full_stiffness_n_per_m = data.youngs_modulus_pa * group.area_m2 / data.height_m;
        group.threshold_n_per_m = settings.attached_share * group.full_stiffness_n_per_m;
        group.prior_median_n_per_m =
            group.threshold_n_per_m * std::exp(settings.log_stdev * normal_quantile(group.prior_probability));
    }
    const bool strings =
        settings.model == "cubic_springs" || (settings.model == "auto" && data.law == LigamentLaw::kCubicSpring);
    if (strings)
        add_springs(mesh, data, weight, group_weight, settings.spring_law, ligament);
    else
        add_band(mesh, data.height_m, settings.shear_ratio > 0.0 ? settings.shear_ratio : band_shear_ratio(data),
                 weight, group_weight, ligament);
    return ligament;
}

}  // namespace teres
