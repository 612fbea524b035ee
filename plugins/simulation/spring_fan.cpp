#include "plugins/simulation/spring_fan.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "plugins/simulation/lane_packs.h"

namespace teres {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Pack = LanePack<double, kPackLanes>;

constexpr double kLayerHold = 1e-3;       // c over sum w k2
constexpr double kLayerAccuracy = 1e-12;  // of y, over the straight spring's length
constexpr int kMaxNewton = 60, kMaxHalvings = 40;

struct Pack3 {
    Pack v[3];
};

Pack dot(const Pack3& a, const Pack3& b) {
    return a.v[0] * b.v[0] + a.v[1] * b.v[1] + a.v[2] * b.v[2];
}

template <class F>
Pack lanewise(F&& f) {
    Pack out;
    for (std::size_t l = 0; l < kPackLanes; ++l) out[l] = f(l);
    return out;
}

struct Pull {  // of one spring on y
    Pack energy, tension, slope, length;
    Pack3 direction;  // from y to the spring's other end
};

Pull pull_of(const SpringFan& fan, const SpringFan::Spring& spring, const Pack3& end, const Pack3& y) {
    Pull p;
    for (int a = 0; a < 3; ++a) p.direction.v[a] = end.v[a] - y.v[a];
    const Pack square = dot(p.direction, p.direction);
    p.length = lanewise([&](std::size_t l) { return std::sqrt(std::max(square[l], 1e-30)); });
    const Pack over = p.length - spring.rest_length_m;
    const Pack d = lanewise([&](std::size_t l) { return over[l] > 0.0 ? over[l] : 0.0; });
    const Pack taut = lanewise([&](std::size_t l) { return over[l] > 0.0 ? spring.weight : 0.0; });
    for (auto& v : p.direction.v) v /= p.length;
    p.tension = taut * d * (fan.k[2] + d * (fan.k[1] + d * fan.k[0]));
    p.slope = taut * (fan.k[2] + d * (2.0 * fan.k[1] + 3.0 * fan.k[0] * d));
    p.energy = taut * d * d * (fan.k[2] / 2.0 + d * (fan.k[1] / 3.0 + d * fan.k[0] / 4.0));
    return p;
}

// Energy, gradient and Hessian (xx yy zz xy xz yz) in y.
struct Layer {
    Pack energy;
    Pack3 gradient;
    Pack hessian[6];
};

double hold_of(const SpringFan& fan) {
    double sum = 0.0;
    for (const auto* springs : {&fan.near, &fan.far})
        for (const auto& spring : *springs) sum += spring.weight * fan.k[2];
    return kLayerHold * sum;
}

void add(const SpringFan& fan, const SpringFan::Spring& spring, const Pack3& end, const Pack3& y, Layer& out) {
    const Pull p = pull_of(fan, spring, end, y);
    out.energy += p.energy;
    const Pack across = p.tension / p.length, along = p.slope - across;
    constexpr int kIndex[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
    for (int a = 0; a < 3; ++a) out.gradient.v[a] -= p.tension * p.direction.v[a];
    for (int i = 0; i < 6; ++i) {
        out.hessian[i] += along * p.direction.v[kIndex[i][0]] * p.direction.v[kIndex[i][1]];
        if (i < 3) out.hessian[i] += across;
    }
}

Pack3 everywhere(const Vector3d& p) {
    return {{Pack{} + p.x(), Pack{} + p.y(), Pack{} + p.z()}};
}

Layer layer_at(const SpringFan& fan, const Pack3* ends, const Pack3& y, double hold) {
    Layer out{};
    for (std::size_t k = 0; k < fan.near.size(); ++k) add(fan, fan.near[k], ends[k], y, out);
    for (const auto& spring : fan.far) add(fan, spring, everywhere(spring.anchor), y, out);
    for (int a = 0; a < 3; ++a) {
        const Pack u = y.v[a] - fan.middle(a);
        out.energy += 0.5 * hold * u * u;
        out.gradient.v[a] += hold * u;
        out.hessian[a] += hold;
    }
    return out;
}

// H s = -g by the adjugate: H is at least `hold` in every direction.
Pack3 newton_step(const Layer& e) {
    const Pack &xx = e.hessian[0], &yy = e.hessian[1], &zz = e.hessian[2], &xy = e.hessian[3], &xz = e.hessian[4],
               &yz = e.hessian[5];
    const Pack a = yy * zz - yz * yz, b = xz * yz - xy * zz, c = xy * yz - xz * yy;
    const Pack determinant = xx * a + xy * b + xz * c;
    const Pack *g = e.gradient.v, d = xx * zz - xz * xz, f = xy * xz - xx * yz, h = xx * yy - xy * xy;
    return {{-(a * g[0] + b * g[1] + c * g[2]) / determinant, -(b * g[0] + d * g[1] + f * g[2]) / determinant,
             -(c * g[0] + f * g[1] + h * g[2]) / determinant}};
}

// The layer's node for four lanes: Newton with halving, psi is convex in y (for k0, k1 >= 0).
struct Solution {
    Pack3 y;
    Layer at;
};

Solution solve_layer(const SpringFan& fan, const Pack3* ends) {
    const double hold = hold_of(fan);
    const double bound = kLayerAccuracy * hold / kLayerHold * fan.near.front().rest_length_m;
    Solution s;
    const Pack3 anchor = everywhere(fan.far.front().anchor);
    for (int a = 0; a < 3; ++a) s.y.v[a] = 0.5 * (ends[0].v[a] + anchor.v[a]);
    s.at = layer_at(fan, ends, s.y, hold);
    for (int iteration = 0; iteration < kMaxNewton; ++iteration) {
        const Pack norm2 = dot(s.at.gradient, s.at.gradient);
        bool open = false;
        for (std::size_t l = 0; l < kPackLanes; ++l) open = open || norm2[l] > bound * bound;
        if (!open) break;
        const Pack3 step = newton_step(s.at);
        const Pack slope = dot(s.at.gradient, step);
        Pack share = Pack{} + 1.0;
        for (int halving = 0; halving < kMaxHalvings; ++halving) {
            Solution trial;
            for (int a = 0; a < 3; ++a) trial.y.v[a] = s.y.v[a] + share * step.v[a];
            trial.at = layer_at(fan, ends, trial.y, hold);
            const Pack trial2 = dot(trial.at.gradient, trial.at.gradient);
            bool accepted = true;
            for (std::size_t l = 0; l < kPackLanes; ++l) {
                const bool better = trial.at.energy[l] <= s.at.energy[l] + 1e-4 * share[l] * slope[l] ||
                                    trial2[l] <= 0.25 * norm2[l] || !(norm2[l] > bound * bound);
                if (better) continue;
                share[l] *= 0.5;
                accepted = false;
            }
            if (accepted || halving + 1 == kMaxHalvings) {
                s = trial;
                break;
            }
        }
    }
    return s;
}

void load_ends(const SpringFan& fan, const double* x, std::size_t stride, std::size_t first, std::size_t lanes,
               Pack3* ends) {
    for (std::size_t k = 0; k < fan.near.size(); ++k)
        for (std::size_t a = 0; a < 3; ++a) {
            const double* row = x + (3 * static_cast<std::size_t>(fan.near[k].node) + a) * stride;
            ends[k].v[a] = lanewise([&](std::size_t l) { return row[std::min(first + l, lanes - 1)]; });
        }
}

}  // namespace

std::vector<SpringFan> make_fans(const std::vector<Vector3d>& X, const std::vector<Vector3d>& n,
                                 const std::vector<NodeIndex>& node,
                                 const std::vector<std::vector<std::size_t>>& neighbours, double h, double diagonal,
                                 const std::array<double, 3>& k) {
    std::vector<SpringFan> fans(X.size());
    for (std::size_t i = 0; i < X.size(); ++i) {
        SpringFan& fan = fans[i];
        fan.middle = X[i] + 0.5 * h * n[i];
        fan.k = k;
        const std::size_t count = std::min(neighbours[i].size(), kMaxFanSprings - 1);
        std::vector<std::size_t> ends{i};
        ends.insert(ends.end(), neighbours[i].begin(), neighbours[i].begin() + static_cast<std::ptrdiff_t>(count));
        for (const bool is_near : {true, false}) {
            auto& springs = is_near ? fan.near : fan.far;
            double along = 0.0;  // stiffness of the diagonals along n for weight 1
            for (const auto j : ends) {
                SpringFan::Spring spring;
                spring.node = is_near ? node[j] : -1;
                spring.anchor = is_near ? X[j] : Vector3d(X[j] + h * n[j]);
                const Vector3d d = spring.anchor - fan.middle;
                spring.rest_length_m = d.norm();
                if (j != i) along += std::pow(d.dot(n[i]) / spring.rest_length_m, 2);
                springs.push_back(spring);
            }
            const double share = along > 0.0 ? diagonal : 0.0;
            springs[0].weight = 2.0 * (1.0 - share);  // two layers in series
            for (std::size_t s = 1; s < springs.size(); ++s) springs[s].weight = 2.0 * share / along;
        }
    }
    return fans;
}

TERES_MULTIVERSION
void add_fan_gradient(const SpringFan& fan, const double* factor, const double* x, double* gradient, double* energy,
                      std::size_t stride, std::size_t first, std::size_t lanes) noexcept {
    std::array<Pack3, kMaxFanSprings> ends;
    load_ends(fan, x, stride, first, lanes, ends.data());
    const Solution s = solve_layer(fan, ends.data());
    const std::size_t count = std::min(kPackLanes, lanes - first);
    for (std::size_t l = 0; l < count; ++l) energy[first + l] += factor[l] * s.at.energy[l];
    for (std::size_t k = 0; k < fan.near.size(); ++k) {
        const Pull p = pull_of(fan, fan.near[k], ends[k], s.y);
        double* row = gradient + 3 * static_cast<std::size_t>(fan.near[k].node) * stride + first;
        for (std::size_t a = 0; a < 3; ++a)
            for (std::size_t l = 0; l < count; ++l)
                row[a * stride + l] += factor[l] * p.tension[l] * p.direction.v[a][l];
    }
}

void fan_stiffness(const SpringFan& fan, const Positions& x, FanStiffness& out) noexcept {
    std::array<Pack3, kMaxFanSprings> ends;
    load_ends(fan, x.data(), 1, 0, 1, ends.data());
    const Solution s = solve_layer(fan, ends.data());
    const Pack* H = s.at.hessian;
    Matrix3d A;
    A << H[0][0], H[3][0], H[4][0], H[3][0], H[1][0], H[5][0], H[4][0], H[5][0], H[2][0];
    const Matrix3d inverse = A.inverse();
    for (std::size_t k = 0; k < fan.near.size(); ++k) {
        const Pull p = pull_of(fan, fan.near[k], ends[k], s.y);
        const Vector3d n(p.direction.v[0][0], p.direction.v[1][0], p.direction.v[2][0]);
        const double across = p.tension[0] / p.length[0];
        out.S[k] = (p.slope[0] - across) * n * n.transpose() + across * Matrix3d::Identity();
        out.SA[k] = out.S[k] * inverse;
    }
}

}  // namespace teres
