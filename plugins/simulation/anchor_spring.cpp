#include "plugins/simulation/anchor_spring.h"

#include <cmath>

namespace teres {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// F = k1 s + k2 s^2 + k3 s^3, its derivative and its integral from 0.
struct Polynomial {
    double value, derivative, integral;
};
Polynomial polynomial(const std::array<double, 3>& k, double s) {
    return {s * (k[0] + s * (k[1] + s * k[2])), k[0] + s * (2.0 * k[1] + s * 3.0 * k[2]),
            s * s * (k[0] / 2.0 + s * (k[1] / 3.0 + s * k[2] / 4.0))};
}

// Tension along the spring and its derivative in the length.
struct Tension {
    double value, derivative;
};

Polynomial cubic(const AnchorSpring& spring, double delta) {
    return polynomial({spring.k[2], spring.k[1], spring.k[0]}, delta);
}

// S = F'(L) n n^T + F/L (I - n n^T)
Matrix3d along(const Vector3d& n, const Tension& tension, double length) {
    const double across = tension.value / length;
    return (tension.derivative - across) * n * n.transpose() + across * Matrix3d::Identity();
}

}  // namespace

double AnchorSpring::energy(const Vector3d& x) const noexcept {
    const double length = (anchor - x).norm();
    switch (law) {
        case AnchorLaw::kRestShape:
            return 0.5 * k[0] * length * length;
        case AnchorLaw::kPolynomialTension:
            return length < rest_length ? 0.0 : rest_length * polynomial(k, length / rest_length - 1.0).integral;
        case AnchorLaw::kCubicTension:
            return length < rest_length ? 0.0 : cubic(*this, length - rest_length).integral;
        case AnchorLaw::kPolynomialRestShape:
            return rest_length * polynomial(k, length / rest_length).integral;
    }
    return 0.0;
}

Vector3d AnchorSpring::force(const Vector3d& x) const noexcept {
    const Vector3d d = anchor - x;
    if (law == AnchorLaw::kRestShape) return k[0] * d;
    const double length = d.norm();
    if (law == AnchorLaw::kPolynomialRestShape) {
        const double squared = length * length;
        return polynomial(k, length / rest_length).value /
               std::sqrt(squared + std::exp(smooth_shift - smooth_scale * squared)) * d;
    }
    if (length < rest_length || length == 0.0) return Vector3d::Zero();
    const double tension = law == AnchorLaw::kPolynomialTension
                               ? polynomial(k, (length - rest_length) / rest_length).value
                               : cubic(*this, length - rest_length).value;
    return tension / length * d;
}

Matrix3d AnchorSpring::stiffness(const Vector3d& x) const noexcept {
    if (law == AnchorLaw::kRestShape) return k[0] * Matrix3d::Identity();
    const Vector3d d = anchor - x;
    const double length = d.norm();
    if (law == AnchorLaw::kPolynomialRestShape) {
        const double squared = length * length, bump = std::exp(smooth_shift - smooth_scale * squared);
        const double smooth = std::sqrt(squared + bump);
        const Polynomial F = polynomial(k, length / rest_length);
        const Vector3d w = d / smooth;
        // d/dx of F d/smooth; smooth' = d (1 - c bump) / smooth. Near the anchor F' n = F' d / L with d / L
        // bounded.
        const Vector3d n = length > 0.0 ? Vector3d(d / length) : Vector3d::Zero();
        if (diagonal_stiffness) {
            const double across = F.value / smooth,
                         slope = (F.derivative / rest_length - across) * (1.0 - smooth_scale * bump);
            return (slope * w.array().square() + across).matrix().asDiagonal();
        }
        return F.derivative / rest_length * n * w.transpose() +
               F.value / smooth * (Matrix3d::Identity() - (1.0 - smooth_scale * bump) * w * w.transpose());
    }
    if (length == 0.0) return Matrix3d::Zero();  // no direction
    const bool slack = length < rest_length;
    if (slack && !(stiff_when_slack && law == AnchorLaw::kPolynomialTension)) return Matrix3d::Zero();
    Tension tension{};
    if (law == AnchorLaw::kPolynomialTension) {
        const Polynomial F = polynomial(k, std::abs(length - rest_length) / rest_length);
        tension = {F.value, F.derivative / rest_length};
    } else {
        const Polynomial F = cubic(*this, length - rest_length);
        tension = {F.value, F.derivative};
    }
    return along(d / length, tension, length);
}

}  // namespace teres
