#include "tools/atlas/registration.h"

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <Eigen/Sparse>
#include <algorithm>
#include <cmath>
#include <limits>

namespace teres {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Sparse = Eigen::SparseMatrix<double>;

namespace {

constexpr double kLeastCosine = 0.3;  // between normals of matched points
constexpr Index kPulls = 800;         // target points that pull the shape

// Least-squares similarity of matched columns (Umeyama 1991).
Similarity best_similarity(const Matrix3Xd& from, const Matrix3Xd& to) {
    const Eigen::Matrix4d T = Eigen::umeyama(from, to, true);
    Similarity s;
    s.scale = std::cbrt(T.topLeftCorner<3, 3>().determinant());
    s.R = T.topLeftCorner<3, 3>() / s.scale;
    s.t = T.topRightCorner<3, 1>();
    return s;
}

// Every k-th column, about `wanted` of them.
Matrix3Xd thinned(const Matrix3Xd& X, Index wanted) {
    const Index stride = std::max<Index>(1, X.cols() / wanted);
    Matrix3Xd out(3, (X.cols() + stride - 1) / stride);
    for (Index i = 0; i < out.cols(); ++i) out.col(i) = X.col(i * stride);
    return out;
}

// One similarity step from nearest neighbours both ways; returns the rms distance before it.
double closest_point_step(const Matrix3Xd& shape, const Matrix3Xd& target, const NearestPoint& near_shape,
                          const NearestPoint& near_target, Index points, Similarity& s) {
    const Matrix3Xd a = thinned(shape, points), b = thinned(target, points);
    Matrix3Xd from(3, a.cols() + b.cols()), to(3, a.cols() + b.cols());
    from.leftCols(a.cols()) = a;
    to.rightCols(b.cols()) = b;
    const Matrix3Xd moved = s(a), back = s.inverse(b);
    for (Index i = 0; i < a.cols(); ++i) to.col(i) = target.col(near_target(moved.col(i)));
    for (Index j = 0; j < b.cols(); ++j) from.col(a.cols() + j) = shape.col(near_shape(back.col(j)));
    const double rms = std::sqrt((s(from) - to).colwise().squaredNorm().mean());
    s = best_similarity(from, to);
    return rms;
}

// L = I - D^-1 A of the shape's graph.
Sparse laplacian(const TriangleSurface& shape) {
    const Index n = shape.num_vertices();
    std::vector<Eigen::Triplet<double>> entries;
    for (const auto& f : shape.F)
        for (std::size_t k = 0; k < 3; ++k) entries.emplace_back(f[k], f[(k + 1) % 3], 1.0);
    Sparse A(n, n);
    A.setFromTriplets(entries.begin(), entries.end());
    Sparse L(n, n);
    L.setIdentity();
    for (Index c = 0; c < n; ++c)
        for (Sparse::InnerIterator it(A, c); it; ++it) it.valueRef() = 1.0;
    const Eigen::VectorXd degree = A * Eigen::VectorXd::Ones(n);
    return L - Sparse(degree.cwiseInverse().asDiagonal() * A);
}

}  // namespace

Matrix3Xd Similarity::inverse(const Matrix3Xd& Y) const {
    return R.transpose() * (Y.colwise() - t) / scale;
}

double Similarity::rotation_rad() const {
    return Eigen::AngleAxisd(R).angle();
}

std::vector<Matrix3d> upright_starts() {
    constexpr double kTilt_rad = 25.0 * 3.14159265358979 / 180.0;
    std::vector<Matrix3d> starts;
    for (int x = -1; x <= 1; ++x)
        for (int y = -1; y <= 1; ++y)
            for (int z = -1; z <= 1; ++z) {
                const Vector3d axis(x, y, z);
                if (axis.squaredNorm() > 2.0) continue;
                starts.push_back(axis.isZero() ? Matrix3d(Matrix3d::Identity())
                                               : Eigen::AngleAxisd(kTilt_rad, axis.normalized()).toRotationMatrix());
            }
    return starts;
}

AlignedStart align(const TriangleSurface& shape, const TriangleSurface& target, const std::vector<Matrix3d>& starts) {
    const NearestPoint near_shape(shape.V), near_target(target.V);
    const double scale = std::cbrt(std::abs(signed_volume(target) / signed_volume(shape)));
    const Vector3d from = area_centroid(shape), to = area_centroid(target);
    AlignedStart best;
    best.rms_m = std::numeric_limits<double>::infinity();
    for (const Matrix3d& R : starts) {
        AlignedStart tried{{R, scale, to - scale * R * from}, 0.0};
        for (int i = 0; i < 12; ++i)
            tried.rms_m = closest_point_step(shape.V, target.V, near_shape, near_target, 120, tried.similarity);
        if (tried.rms_m < best.rms_m) best = tried;
    }
    for (int i = 0; i < 30; ++i)
        best.rms_m = closest_point_step(shape.V, target.V, near_shape, near_target, 600, best.similarity);
    return best;
}

Registration register_shape(const TriangleSurface& shape, const TriangleSurface& target, const Similarity& start,
                            const RegistrationSettings& settings) {
    const Index n = shape.num_vertices();
    const ClosestPointSearch on_target(target);
    const Matrix3Xd target_normal = vertex_normals(target);
    const Matrix3Xd pull = thinned(target.V, kPulls);
    const Index pull_stride = std::max<Index>(1, target.num_vertices() / kPulls);
    const Sparse L = laplacian(shape);
    const Sparse LtL = L.transpose() * L;

    Registration out;
    out.similarity = start;
    TriangleSurface moved{start(shape.V), shape.F};
    Matrix3Xd rest = moved.V;  // T
    Eigen::SimplicialLDLT<Sparse> solver;
    for (int step = 0; step < settings.steps; ++step) {
        const double share = settings.steps > 1 ? step / (settings.steps - 1.0) : 1.0;
        const double alpha = settings.stiffest * std::pow(settings.softest / settings.stiffest, share);
        for (int i = 0; i < settings.iterations_per_step; ++i) {
            const Matrix3Xd normal = vertex_normals(moved);
            const ClosestPointSearch on_moved(moved);
            std::vector<Eigen::Triplet<double>> entries;
            Matrix3Xd rhs = Matrix3Xd::Zero(3, n);
            double squares = 0.0;
            for (Index v = 0; v < n; ++v) {
                const ClosestPoint c = on_target.closest(moved.V.col(v));
                squares += c.distance * c.distance / static_cast<double>(n);
                Vector3d m = Vector3d::Zero();
                for (int k = 0; k < 3; ++k)
                    m += c.barycentric[k] * target_normal.col(target.F[c.face][static_cast<std::size_t>(k)]);
                if (m.dot(normal.col(v)) < kLeastCosine) continue;
                entries.emplace_back(v, v, 1.0);
                rhs.col(v) += c.position;
            }
            double pull_squares = 0.0;
            for (Index j = 0; j < pull.cols(); ++j) {
                const ClosestPoint c = on_moved.closest(pull.col(j));
                pull_squares += c.distance * c.distance / static_cast<double>(pull.cols());
                const auto& f = moved.F[c.face];
                Vector3d m = Vector3d::Zero();
                for (int k = 0; k < 3; ++k) m += c.barycentric[k] * normal.col(f[static_cast<std::size_t>(k)]);
                if (m.dot(target_normal.col(j * pull_stride)) < kLeastCosine) continue;
                const double weight = static_cast<double>(n) / static_cast<double>(pull.cols());
                for (int a = 0; a < 3; ++a) {
                    const auto va = f[static_cast<std::size_t>(a)];
                    rhs.col(va) += weight * c.barycentric[a] * pull.col(j);
                    for (int b = 0; b < 3; ++b)
                        entries.emplace_back(va, f[static_cast<std::size_t>(b)],
                                             weight * c.barycentric[a] * c.barycentric[b]);
                }
            }
            if (step == 0 && i == 0) out.similarity_rms_m = std::sqrt(0.5 * (squares + pull_squares));
            Sparse A(n, n);
            A.setFromTriplets(entries.begin(), entries.end());
            A += alpha * LtL;
            if (step == 0 && i == 0) solver.analyzePattern(Sparse(A + LtL));
            solver.compute(A);
            const Matrix3Xd b = rhs + alpha * Matrix3Xd((LtL * rest.transpose()).transpose());
            moved.V = Matrix3Xd(solver.solve(b.transpose()).transpose());
            out.rms_m = std::sqrt(0.5 * (squares + pull_squares));
        }
        // The rest shape follows the similarity part of the motion, so that only bending is resisted.
        const Similarity s = best_similarity(shape.V, moved.V);
        rest = s(shape.V);
    }
    out.X = moved.V;
    return out;
}

}  // namespace teres
