#include "plugins/observation/rigid_registration.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <string>

#include "core/case/surface.h"

namespace teres {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr std::size_t kMinPoints = 100, kMinDots = 4;
constexpr double kCorrelatedPixels = 12.0;  // neighbours share one matching window
constexpr double kMinFacing = 0.25;         // cosine: flatter views are edges
constexpr double kHuber = 2.0;              // standard deviations
constexpr double kSettled = 1e-5;           // |ω| [rad], |v| [m]

Vector3d vec(const Point& p) {
    return {p[0], p[1], p[2]};
}
Matrix3d rotation(const Pose& pose) {
    return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(pose.R.data());
}
Pose pose_of(const Matrix3d& R, const Vector3d& t) {
    Pose pose;
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(pose.R.data()) = R;
    pose.t = {t.x(), t.y(), t.z()};
    return pose;
}

struct Box {
    Vector3d low = Vector3d::Constant(1e9), high = -low;
    Box inflated(double by) const { return {(low.array() - by).matrix(), (high.array() + by).matrix()}; }
    bool contains(const Vector3d& x) const {
        return (x.array() >= low.array()).all() && (x.array() <= high.array()).all();
    }
};

struct Pair {
    Vector3d x, n;      // point in case axes, normal of the model
    double off, sigma;  // n · (x - q), its standard deviation
};

std::vector<Pair> pair_up(const Surface& model, const Box& box, std::span<const Point> points, const Pose& pose,
                          double gate_m, const RegistrationOptions& o) {
    std::vector<Pair> pairs;
    const Vector3d eye = vec(pose.t);
    for (const Point& p : points) {
        const Point x = pose.apply(p);
        if (!box.inflated(gate_m).contains(vec(x))) continue;
        const SurfacePoint near = model.closest(x);
        if (near.distance_m > gate_m) continue;
        const Vector3d n = vec(near.normal), view = (eye - vec(x)).normalized();
        if (n.dot(view) < kMinFacing) continue;
        pairs.push_back({vec(x), n, n.dot(vec(x) - vec(near.position_m)),
                         std::hypot(o.depth_noise_per_m * p[2] * p[2], o.model_sigma_m)});
    }
    return pairs;
}

double rms(const std::vector<Pair>& pairs) {
    double sum = 0.0;
    for (const Pair& pair : pairs) sum += pair.off * pair.off;
    return std::sqrt(sum / static_cast<double>(pairs.size()));
}

struct Match {
    Vector3d x, off;  // dot in case axes, from its marker
    double sigma;
};

// A dot and a marker that are each other's nearest.
std::vector<Match> match_up(const DotsAndMarkers& marks, const Pose& pose, double gate_m, double model_sigma_m) {
    std::vector<Vector3d> seen, known;
    for (const SeenDot& dot : marks.dots) seen.push_back(vec(pose.apply(dot.x)));
    for (const Point& marker : marks.markers) known.push_back(vec(marker));
    const auto nearest = [](const std::vector<Vector3d>& to, const Vector3d& x) {
        return std::min_element(to.begin(), to.end(),
                                [&](const auto& a, const auto& b) { return (a - x).norm() < (b - x).norm(); }) -
               to.begin();
    };
    std::vector<Match> matches;
    if (known.empty()) return matches;
    for (std::size_t d = 0; d < seen.size(); ++d) {
        const Vector3d& marker = known[static_cast<std::size_t>(nearest(known, seen[d]))];
        if ((marker - seen[d]).norm() < gate_m && nearest(seen, marker) == static_cast<std::ptrdiff_t>(d))
            matches.push_back({seen[d], seen[d] - marker, std::hypot(marks.dots[d].sigma_m, model_sigma_m)});
    }
    return matches;
}

Matrix3d cross_matrix(const Vector3d& a) {
    Matrix3d A;
    A << 0.0, -a.z(), a.y(), a.z(), 0.0, -a.x(), -a.y(), a.x(), 0.0;
    return A;
}

// Gauss-Newton's normal equations of turn and shift about a centre.
struct Normal {
    Matrix6 H = Matrix6::Zero();
    Vector6 g = Vector6::Zero();
    double chi2 = 0.0;
    void add(const Vector6& J, double off, double sigma, double worst) {
        const double e = worst / sigma, w = (e > kHuber ? kHuber / e : 1.0) / (sigma * sigma);
        H += w * J * J.transpose();
        g += w * off * J;
        chi2 += w * off * off;
    }
    void add(const Pair& pair, const Vector3d& center) {
        Vector6 J;
        J << (pair.x - center).cross(pair.n), pair.n;
        add(J, pair.off, pair.sigma, std::abs(pair.off));
    }
    void add(const Match& match, const Vector3d& center) {
        Eigen::Matrix<double, 3, 6> J;
        J << -cross_matrix(match.x - center), Matrix3d::Identity();
        for (int a = 0; a < 3; ++a) add(J.row(a).transpose(), match.off[a], match.sigma, match.off.norm());
    }
};

double worst_stdev(const Matrix3d& covariance) {
    return std::sqrt(covariance.selfadjointView<Eigen::Lower>().eigenvalues().maxCoeff());
}

}  // namespace

Result<Pose> align_landmarks(std::span<const Point> camera, std::span<const Point> model) {
    if (camera.size() != model.size() || camera.size() < 3)
        return invalid_input(std::to_string(std::min(camera.size(), model.size())) +
                             " landmarks, at least 3 are needed");
    Vector3d from = Vector3d::Zero(), to = Vector3d::Zero();
    for (std::size_t i = 0; i < camera.size(); ++i) {
        from += vec(camera[i]) / static_cast<double>(camera.size());
        to += vec(model[i]) / static_cast<double>(model.size());
    }
    Matrix3d H = Matrix3d::Zero();
    for (std::size_t i = 0; i < camera.size(); ++i) H += (vec(camera[i]) - from) * (vec(model[i]) - to).transpose();
    const Eigen::JacobiSVD<Matrix3d> svd(H, Eigen::ComputeFullU | Eigen::ComputeFullV);
    if (!(svd.singularValues()[1] > 1e-3 * svd.singularValues()[0]) || !H.allFinite())
        return invalid_input("the landmarks lie on one line: they leave a rotation open");
    Vector3d signs(1.0, 1.0, (svd.matrixV() * svd.matrixU().transpose()).determinant());
    const Matrix3d R = svd.matrixV() * signs.asDiagonal() * svd.matrixU().transpose();
    return pose_of(R, to - R * from);
}

std::vector<Point> depth_points(std::span<const std::uint16_t> counts, const CameraModel& camera, double depth_unit_m,
                                int stride_px) {
    std::vector<Point> points;
    for (int v = stride_px / 2; v < camera.height_px; v += stride_px)
        for (int u = stride_px / 2; u < camera.width_px; u += stride_px) {
            const double z = depth_unit_m * counts[static_cast<std::size_t>(v * camera.width_px + u)];
            if (!(z > 0.0)) continue;
            const Point ray = camera.ray({double(u), double(v)});
            points.push_back({z * ray[0], z * ray[1], z});
        }
    return points;
}

Eigen::Matrix3d covariance_at(const Registration& r, const Vector3d& x_case) {
    Eigen::Matrix<double, 3, 6> J;
    J << -cross_matrix(x_case - r.centroid), Matrix3d::Identity();
    return J * r.covariance * J.transpose();
}

Result<Registration> refine_on_surface(const TetMeshData& model, std::span<const Point> points, const Pose& start,
                                       const RegistrationOptions& o, const DotsAndMarkers& marks) {
    Registration result;
    result.camera_to_case = start;
    const Surface surface(model);
    Box box;
    for (const Point& x : model.nodes) {
        box.low = box.low.cwiseMin(vec(x));
        box.high = box.high.cwiseMax(vec(x));
    }
    double gate_m = o.start_gate_m, dot_gate_m = o.start_gate_m;
    const double counted = std::min(1.0, o.stride_px * o.stride_px / kCorrelatedPixels);
    // First the surface alone, which knows roughly where; then the dots, which know which way it may slide.
    const bool has_dots = !marks.dots.empty() && !marks.markers.empty();
    bool with_dots = has_dots && points.empty();
    for (result.iterations = 1; result.iterations <= o.max_iterations; ++result.iterations) {
        const std::vector<Pair> pairs = pair_up(surface, box, points, result.camera_to_case, gate_m, o);
        const std::vector<Match> matches =
            with_dots ? match_up(marks, result.camera_to_case, dot_gate_m, o.model_sigma_m) : std::vector<Match>();
        result.points = pairs.size();
        result.markers = matches.size();
        if (pairs.size() < kMinPoints && matches.size() < kMinDots) {
            if (has_dots && !with_dots) {
                with_dots = true;
                continue;
            }
            return not_usable(std::to_string(pairs.size()) + " depth points within " + std::to_string(1e3 * gate_m) +
                              " mm of the model's surface, at least " + std::to_string(kMinPoints) +
                              " are needed: start nearer (landmarks)");
        }
        result.rms_m = pairs.empty() ? 0.0 : rms(pairs);
        result.centroid.setZero();
        for (const Pair& pair : pairs) result.centroid += pair.x;
        for (const Match& match : matches) result.centroid += match.x;
        result.centroid /= static_cast<double>(pairs.size() + matches.size());
        Normal by_surface, by_dots;
        for (const Pair& pair : pairs) by_surface.add(pair, result.centroid);
        for (const Match& match : matches) by_dots.add(match, result.centroid);
        // As long as the dots have not had their say, the start keeps what the surface leaves open.
        Matrix6 H = by_surface.H + by_dots.H;
        if (has_dots && !with_dots) H.diagonal() += (1e-3 * H.diagonal().array()).matrix();
        const Vector6 step = -H.llt().solve(by_surface.g + by_dots.g);
        const double excess =
            std::max(1.0, (by_surface.chi2 + by_dots.chi2) / static_cast<double>(pairs.size() + 3 * matches.size()));
        const Eigen::LLT<Matrix6> information(counted * by_surface.H + by_dots.H);
        result.covariance = information.solve(Matrix6::Identity()) * excess;
        const double worst_rad = worst_stdev(result.covariance.topLeftCorner<3, 3>()),
                     worst_m = worst_stdev(result.covariance.bottomRightCorner<3, 3>());
        const bool told =
            information.info() == Eigen::Success && worst_rad < o.max_stdev_rad && worst_m < o.max_stdev_m;
        if (!step.allFinite() || (!told && (with_dots || !has_dots)))
            return not_usable("the visible surface leaves the pose open: standard deviation " +
                              std::to_string(1e3 * worst_m) + " mm, " + std::to_string(worst_rad) +
                              " rad in the worst direction; show more of the liver's edges");
        const Vector3d omega = step.head<3>(), shift = step.tail<3>();
        const double angle = omega.norm();
        const Matrix3d dR =
            angle > 0.0 ? Eigen::AngleAxisd(angle, omega / angle).toRotationMatrix() : Matrix3d::Identity();
        const Matrix3d R = dR * rotation(result.camera_to_case);
        const Vector3d t = dR * (vec(result.camera_to_case.t) - result.centroid) + result.centroid + shift;
        result.camera_to_case = pose_of(Eigen::Quaterniond(R).normalized().toRotationMatrix(), t);
        const double narrower = std::clamp(4.0 * result.rms_m, o.least_gate_m, gate_m);
        const bool settled = step.norm() < kSettled && narrower == gate_m;
        gate_m = narrower;
        if (with_dots) dot_gate_m = std::max(o.least_gate_m, 0.7 * dot_gate_m);
        if (!settled) continue;
        if (with_dots || !has_dots) break;
        with_dots = true;
    }
    if (result.rms_m > o.max_rms_m)
        return not_usable("depth points stay " + std::to_string(1e3 * result.rms_m) +
                          " mm rms from the model's surface, at most " + std::to_string(1e3 * o.max_rms_m) +
                          " are allowed: the liver is not at rest, or not this one");
    return result;
}

}  // namespace teres
