#include "tools/atlas/ligament_atlas.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>

#include "core/case/text_file.h"

namespace teres {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using Sparse = Eigen::SparseMatrix<double>;

namespace {

constexpr Index kShapeVertices = 700;  // 12 mm edges: the registration's resolution
constexpr double kDefaultBandwidth_m = 0.009;
constexpr double kTurnedMargin = 0.97;  // a turned or mirrored fit below this share of the upright one is believed
constexpr double kLargestTurn_rad = 75.0 * std::numbers::pi / 180.0;  // 30 of pose, the rest is anatomy
constexpr double kWorstFit_m = 0.006;

double unit_volume_scale(const TriangleSurface& s) {
    return std::cbrt(signed_volume(s));
}

// Kernels k(d_i/h)/integral of the livers `who` at the vertices of `fine`, one column each.
MatrixXd kernels(const MatrixXd& distance, const VectorXd& area, double h) {
    MatrixXd K = (-0.5 * (distance.array() / h).square()).exp();
    for (Index i = 0; i < K.cols(); ++i) K.col(i) /= area.dot(K.col(i));
    return K;
}

VectorXd mean_without(const MatrixXd& K, const std::vector<Index>& left_out) {
    VectorXd f = K.rowwise().sum();
    for (const Index i : left_out) f -= K.col(i);
    return f / static_cast<double>(K.cols() - static_cast<Index>(left_out.size()));
}

// Distance of every vertex of `fine` to the carried attachment of each liver.
MatrixXd attachment_distances(const AtlasBuild& build, const std::string& ligament) {
    const auto& who = build.carriers.at(ligament);
    const Matrix3Xd& X = build.atlas.fine.V;
    MatrixXd D(X.cols(), static_cast<Index>(who.size()));
    for (std::size_t i = 0; i < who.size(); ++i) {
        const auto& points = build.carried[who[i]].marks.at(ligament);
        Matrix3Xd P(3, static_cast<Index>(points.size()));
        for (std::size_t k = 0; k < points.size(); ++k) P.col(static_cast<Index>(k)) = points[k];
        const NearestPoint near(P);
        for (Index v = 0; v < X.cols(); ++v) D(v, static_cast<Index>(i)) = (X.col(v) - P.col(near(X.col(v)))).norm();
    }
    return D;
}

double covered(const VectorXd& p, const std::vector<std::int32_t>& nodes) {
    return static_cast<double>(
               std::count_if(nodes.begin(), nodes.end(), [&](auto v) { return p[v] >= kRegionLevel; })) /
           static_cast<double>(nodes.size());
}

// The smallest bandwidth with which the 90 % region of the others covers 90 % of the true nodes of each
// liver, on average. `left_out` (or -1) takes no part.
double calibrated_bandwidth(const AtlasBuild& build, const std::vector<AnnotatedLiver>& livers,
                            const std::string& ligament, const MatrixXd& D, Index left_out) {
    const auto& who = build.carriers.at(ligament);
    if (static_cast<int>(who.size()) < kTrustedLivers) return kDefaultBandwidth_m;
    const VectorXd fine_area = vertex_areas(build.atlas.fine);
    constexpr double kFirst = 0.004, kStep = 0.001, kLast = 0.020;
    constexpr double kWanted = 1.0 - kRegionLevel;
    double before = 0.0;
    for (double h = kFirst; h <= kLast; h += kStep) {
        const MatrixXd K = kernels(D, fine_area, h);
        double sum = 0.0, count = 0.0;
        for (Index i = 0; i < K.cols(); ++i) {
            if (i == left_out) continue;
            std::vector<Index> out{i};
            if (left_out >= 0) out.push_back(left_out);
            const CarriedLiver& liver = build.carried[who[static_cast<std::size_t>(i)]];
            const VectorXd p = attachment_probability(liver.to_nodes * mean_without(K, out), liver.area);
            const auto& nodes = livers[who[static_cast<std::size_t>(i)]].nodes.at(ligament);
            sum += covered(p, nodes) * static_cast<double>(nodes.size());
            count += static_cast<double>(nodes.size());
        }
        const double coverage = sum / count;
        if (coverage >= kWanted)
            return h == kFirst ? h : h - kStep * (coverage - kWanted) / std::max(coverage - before, 1e-9);
        before = coverage;
    }
    return kLast;
}

// Values at the vertices of `fine` (deformed to Y) -> values at the points of a liver.
Sparse interpolation(const TriangleSurface& fine_on_liver, const Matrix3Xd& points) {
    const ClosestPointSearch search(fine_on_liver);
    std::vector<Eigen::Triplet<double>> entries;
    for (Index v = 0; v < points.cols(); ++v) {
        const ClosestPoint c = search.closest(points.col(v));
        for (int k = 0; k < 3; ++k)
            entries.emplace_back(v, fine_on_liver.F[c.face][static_cast<std::size_t>(k)], c.barycentric[k]);
    }
    Sparse W(points.cols(), fine_on_liver.num_vertices());
    W.setFromTriplets(entries.begin(), entries.end());
    return W;
}

CarriedLiver carry(const TriangleSurface& shape, const TriangleSurface& fine, const AnnotatedLiver& liver,
                   Registration registration) {
    CarriedLiver out;
    const TriangleSurface on_liver = subdivided({registration.X, shape.F});
    const ClosestPointSearch search(on_liver);
    for (const auto& [name, points] : liver.marks)
        for (const Vector3d& p : points) {
            const ClosestPoint c = search.closest(p);
            Vector3d carried = Vector3d::Zero();
            for (int k = 0; k < 3; ++k) carried += c.barycentric[k] * fine.corner(c.face, k);
            out.marks[name].push_back(carried);
        }
    out.to_nodes = interpolation(on_liver, liver.surface.V);
    out.area = vertex_areas(liver.surface);
    out.registration = std::move(registration);
    return out;
}

// The liver whose volume is the median.
std::size_t median_liver(const std::vector<AnnotatedLiver>& livers) {
    std::vector<std::size_t> order(livers.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::sort(order.begin(), order.end(),
              [&](auto a, auto b) { return signed_volume(livers[a].surface) < signed_volume(livers[b].surface); });
    return order[order.size() / 2];
}

}  // namespace

const AtlasLigament* LigamentAtlas::find(const std::string& name) const {
    const auto found = std::find_if(ligaments.begin(), ligaments.end(), [&](const auto& l) { return l.name == name; });
    return found == ligaments.end() ? nullptr : &*found;
}

TriangleSurface subdivided(const TriangleSurface& s) {
    std::map<std::pair<std::int32_t, std::int32_t>, std::int32_t> middle;
    TriangleSurface out;
    std::vector<Vector3d> added;
    const auto middle_of = [&](std::int32_t a, std::int32_t b) {
        const auto next = static_cast<std::int32_t>(s.num_vertices()) + static_cast<std::int32_t>(added.size());
        const auto [entry, is_new] = middle.try_emplace(std::minmax(a, b), next);
        if (is_new) added.push_back(0.5 * (s.V.col(a) + s.V.col(b)));
        return entry->second;
    };
    for (const auto& [a, b, c] : s.F) {
        const auto ab = middle_of(a, b), bc = middle_of(b, c), ca = middle_of(c, a);
        for (const auto& f :
             {std::array{a, ab, ca}, std::array{ab, b, bc}, std::array{ca, bc, c}, std::array{ab, bc, ca}})
            out.F.push_back(f);
    }
    out.V.resize(3, s.num_vertices() + static_cast<Index>(added.size()));
    out.V.leftCols(s.num_vertices()) = s.V;
    for (std::size_t k = 0; k < added.size(); ++k) out.V.col(s.num_vertices() + static_cast<Index>(k)) = added[k];
    return out;
}

std::size_t num_registrations(std::size_t num_livers) {
    return 2 * num_livers;
}

Result<AtlasBuild> build_atlas(const std::vector<AnnotatedLiver>& livers, const std::vector<int>& origin,
                               const std::function<void()>& done) {
    AtlasBuild build;
    TriangleSurface& shape = build.atlas.shape;
    shape = simplified(livers[median_liver(livers)].surface, kShapeVertices);
    shape.V.colwise() -= area_centroid(shape);
    for (int round = 0; round < 2; ++round) {  // towards the mean shape, then with it
        Matrix3Xd sum = Matrix3Xd::Zero(3, shape.num_vertices());
        std::vector<Registration> registrations;
        for (const AnnotatedLiver& liver : livers) {
            registrations.push_back(
                register_shape(shape, liver.surface, align(shape, liver.surface, upright_starts()).similarity));
            sum += registrations.back().similarity.inverse(registrations.back().X);
            if (registrations.back().rms_m > kWorstFit_m)
                return not_usable(liver.name + ": the common shape stays " + to_text(1e3 * registrations.back().rms_m) +
                                  " mm away from the surface, at most " + to_text(1e3 * kWorstFit_m) + " are accepted");
            done();
        }
        if (round == 0) {
            const double size = unit_volume_scale(shape);
            shape.V = sum / static_cast<double>(livers.size());
            shape.V *= size / unit_volume_scale(shape);
            continue;
        }
        build.atlas.fine = subdivided(shape);
        for (std::size_t i = 0; i < livers.size(); ++i)
            build.carried.push_back(carry(shape, build.atlas.fine, livers[i], std::move(registrations[i])));
    }
    for (std::size_t i = 0; i < livers.size(); ++i)
        for (const auto& [name, points] : livers[i].marks) {
            auto& who = build.carriers[name];
            if (who.empty() || origin[who.front()] == origin[i]) who.push_back(i);
        }
    const VectorXd area = vertex_areas(build.atlas.fine);
    for (const auto& [name, who] : build.carriers) {
        AtlasLigament ligament;
        ligament.name = name;
        ligament.num_livers = static_cast<int>(who.size());
        const MatrixXd D = attachment_distances(build, name);
        ligament.bandwidth_m = calibrated_bandwidth(build, livers, name, D, -1);
        const MatrixXd K = kernels(D, area, ligament.bandwidth_m);
        ligament.density = mean_without(K, {});
        ligament.density_stdev = VectorXd::Zero(area.size());
        const auto n = static_cast<double>(who.size());
        for (Index i = 0; who.size() > 1 && i < K.cols(); ++i)
            ligament.density_stdev.array() +=
                (n - 1.0) / n * (mean_without(K, {i}) - ligament.density).array().square();
        ligament.density_stdev = ligament.density_stdev.cwiseSqrt();
        build.atlas.ligaments.push_back(std::move(ligament));
    }
    return build;
}

VectorXd attachment_probability(const VectorXd& density, const VectorXd& area) {
    const Index n = density.size();
    std::vector<Index> order(static_cast<std::size_t>(n));
    std::iota(order.begin(), order.end(), Index{0});
    std::sort(order.begin(), order.end(), [&](Index a, Index b) { return density[a] < density[b]; });
    const VectorXd mass = density.cwiseProduct(area);
    const double total = mass.sum();
    VectorXd q(n);
    double below = 0.0;
    for (const Index v : order) {
        below += mass[v];
        q[v] = below / total;
    }
    double inside = 0.0;
    for (Index v = 0; v < n; ++v)
        if (q[v] >= kRegionLevel) inside += area[v] * q[v];
    const auto tail = [&](double g) {
        double sum = 0.0;
        for (Index v = 0; v < n; ++v)
            if (q[v] < kRegionLevel) sum += area[v] * kRegionLevel * std::pow(q[v] / kRegionLevel, g);
        return sum;
    };
    double low = 0.02, high = 5.0;  // tail falls with g
    for (int i = 0; i < 40; ++i) {
        const double g = 0.5 * (low + high);
        (tail(g) > inside * kRegionLevel / (1.0 - kRegionLevel) ? low : high) = g;
    }
    for (Index v = 0; v < n; ++v)
        if (q[v] < kRegionLevel) q[v] = kRegionLevel * std::pow(q[v] / kRegionLevel, high);
    return q;
}

Result<Transfer> transfer_atlas(const LigamentAtlas& atlas, const AtlasLigament& ligament,
                                const TriangleSurface& surface, const std::string& name) {
    const AlignedStart upright = align(atlas.shape, surface, upright_starts());
    std::vector<Matrix3d> turned;
    for (int k = 0; k < 3; ++k)
        turned.push_back(Eigen::AngleAxisd(std::numbers::pi, Vector3d::Unit(k)).toRotationMatrix());
    const double turned_rms = align(atlas.shape, surface, turned).rms_m;
    TriangleSurface mirror = surface;
    mirror.V.row(0) *= -1.0;
    for (auto& f : mirror.F) std::swap(f[1], f[2]);
    const double mirrored_rms = align(atlas.shape, mirror, upright_starts()).rms_m;
    const auto explain = [&](const char* what, double rms) {
        return invalid_input(
            name + ": the surface looks " + what + ": so the atlas lies within " +
            to_text(std::round(1e4 * rms) / 10.0) + " mm, upright within " +
            to_text(std::round(1e4 * upright.rms_m) / 10.0) +
            " mm; expected within 30 degrees of the frame (--frame; RAS is x right, y anterior, z superior)");
    };
    if (turned_rms < kTurnedMargin * upright.rms_m && turned_rms <= mirrored_rms)
        return explain("turned or upside down", turned_rms);
    if (mirrored_rms < kTurnedMargin * upright.rms_m) return explain("mirrored", mirrored_rms);

    if (upright.similarity.rotation_rad() > kLargestTurn_rad)
        return explain(
            ("turned by " + to_text(std::round(upright.similarity.rotation_rad() * 180.0 / std::numbers::pi)) +
             " degrees or mirrored")
                .c_str(),
            upright.rms_m);

    const Registration registration = register_shape(atlas.shape, surface, upright.similarity);
    if (registration.rms_m > kWorstFit_m)
        return not_usable(name + ": the atlas stays " + to_text(std::round(1e4 * registration.rms_m) / 10.0) +
                          " mm away from the surface, at most " + to_text(1e3 * kWorstFit_m) +
                          " are accepted: is it a liver?");
    const Sparse to_nodes = interpolation(subdivided({registration.X, atlas.shape.F}), surface.V);
    const VectorXd area = vertex_areas(surface);
    const VectorXd f = to_nodes * ligament.density, spread = to_nodes * ligament.density_stdev;
    Transfer out;
    out.probability = attachment_probability(f, area);
    // one standard deviation of f up and down, seen through q
    const VectorXd up = attachment_probability(f + spread, area),
                   down = attachment_probability((f - spread).cwiseMax(0.0), area);
    out.stdev = 0.5 * (up - down).cwiseAbs();
    out.registration_rms_m = registration.rms_m;
    out.rotation_rad = registration.similarity.rotation_rad();
    return out;
}

std::vector<HeldOutLiver> leave_one_out(const AtlasBuild& build, const std::vector<AnnotatedLiver>& livers,
                                        const std::string& ligament) {
    const auto& who = build.carriers.at(ligament);
    const MatrixXd D = attachment_distances(build, ligament);
    const VectorXd fine_area = vertex_areas(build.atlas.fine);
    std::vector<HeldOutLiver> results;
    for (std::size_t i = 0; i < who.size(); ++i) {
        const AnnotatedLiver& truth = livers[who[i]];
        const CarriedLiver& carried = build.carried[who[i]];
        HeldOutLiver out;
        out.name = truth.name;
        out.bandwidth_m = calibrated_bandwidth(build, livers, ligament, D, static_cast<Index>(i));
        const MatrixXd K = kernels(D, fine_area, out.bandwidth_m);
        out.probability =
            attachment_probability(carried.to_nodes * mean_without(K, {static_cast<Index>(i)}), carried.area);
        const VectorXd& p = out.probability;
        const auto& nodes = truth.nodes.at(ligament);

        std::vector<Index> order(static_cast<std::size_t>(p.size()));
        std::iota(order.begin(), order.end(), Index{0});
        std::sort(order.begin(), order.end(), [&](Index a, Index b) { return p[a] > p[b]; });
        const auto distance_to = [&](std::int32_t node, std::size_t count) {
            double best = std::numeric_limits<double>::infinity();
            for (std::size_t k = 0; k < count; ++k)
                best = std::min(best, (truth.surface.V.col(order[k]) - truth.surface.V.col(node)).norm());
            return 1e3 * best;
        };
        const auto strip = static_cast<std::size_t>((p.array() >= kStripLevel).count());
        for (const auto node : nodes) {
            out.distances_mm.push_back(distance_to(node, strip));
            out.levels.push_back(p[node]);
            out.line_mm += distance_to(node, nodes.size()) / static_cast<double>(nodes.size());
        }
        std::vector<double> sorted = out.distances_mm;
        std::sort(sorted.begin(), sorted.end());
        out.mean_mm = std::accumulate(sorted.begin(), sorted.end(), 0.0) / static_cast<double>(sorted.size());
        out.p95_mm = sorted[static_cast<std::size_t>(0.95 * static_cast<double>(sorted.size() - 1) + 0.5)];
        out.coverage = covered(p, nodes);
        out.region_share =
            ((p.array() >= kRegionLevel).cast<double>() * carried.area.array()).sum() / carried.area.sum();
        results.push_back(std::move(out));
    }
    return results;
}

}  // namespace teres
