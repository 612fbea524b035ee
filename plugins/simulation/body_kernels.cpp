#include "plugins/simulation/body_kernels.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "plugins/simulation/body.h"
#include "plugins/simulation/lane_packs.h"

namespace teres {
namespace {

using Pack = LanePack<double, kPackLanes>;  // one double per lane

Pack load(const double* p) {
    return load_pack<Pack>(p);
}
void store(double* p, const Pack& v) {
    store_pack(p, v);
}

template <class F>
Pack lanewise(const Pack& v, F&& f) {
    Pack out;
    for (std::size_t l = 0; l < kPackLanes; ++l) out[l] = f(v[l]);
    return out;
}

// ln v = 2 artanh s, s = (v - 1)/(v + 1): to the last digit by eight terms where |s| <= 0.1, that is 0.82 < v < 1.22.
// Not a number where v <= 0.
Pack log_of(const Pack& v) {
    constexpr double kSeries = 0.1;
    const Pack s = (v - 1.0) / (v + 1.0), s2 = s * s;
    bool near = true;
    for (std::size_t l = 0; l < kPackLanes; ++l) near = near && s2[l] <= kSeries * kSeries;
    if (!near)
        return lanewise(v, [](double x) { return x > 0.0 ? std::log(x) : std::numeric_limits<double>::quiet_NaN(); });
    Pack sum = Pack{} + 1.0 / 15.0;
    for (int odd = 13; odd >= 1; odd -= 2) sum = sum * s2 + 1.0 / odd;
    return 2.0 * s * sum;
}

// exp v to the last digit by its series where |v| <= 0.1.
Pack exp_of(const Pack& v) {
    constexpr double kSeries = 0.1;
    bool near = true;
    for (std::size_t l = 0; l < kPackLanes; ++l) near = near && std::abs(v[l]) <= kSeries;
    if (!near) return lanewise(v, [](double x) { return std::exp(x); });
    Pack sum = Pack{} + 1.0;
    for (int n = 9; n >= 1; --n) sum = 1.0 + sum * v / n;
    return sum;
}

// Stored column by column: F[a + 3 b].
struct Gradient {
    Pack m[9];
};

// P and psi of StVK: E = (F^T F - I)/2, S = 2 mu E + lambda tr(E) I, P = F S.
Pack stvk(const Gradient& F, double mu, double lambda, Gradient& P) {
    Pack E[6];  // xx yy zz xy xz yz
    const auto dot = [&](int b, int d) {
        return F.m[3 * b] * F.m[3 * d] + F.m[3 * b + 1] * F.m[3 * d + 1] + F.m[3 * b + 2] * F.m[3 * d + 2];
    };
    E[0] = 0.5 * (dot(0, 0) - 1.0);
    E[1] = 0.5 * (dot(1, 1) - 1.0);
    E[2] = 0.5 * (dot(2, 2) - 1.0);
    E[3] = 0.5 * dot(0, 1);
    E[4] = 0.5 * dot(0, 2);
    E[5] = 0.5 * dot(1, 2);
    const Pack trace = E[0] + E[1] + E[2];
    const Pack pressure = lambda * trace;
    Pack S[6];
    for (int i = 0; i < 6; ++i) S[i] = 2.0 * mu * E[i];
    for (int i = 0; i < 3; ++i) S[i] += pressure;
    constexpr int kIndex[3][3] = {{0, 3, 4}, {3, 1, 5}, {4, 5, 2}};
    for (int b = 0; b < 3; ++b)
        for (int a = 0; a < 3; ++a)
            P.m[a + 3 * b] = F.m[a] * S[kIndex[0][b]] + F.m[a + 3] * S[kIndex[1][b]] + F.m[a + 6] * S[kIndex[2][b]];
    const Pack square = E[0] * E[0] + E[1] * E[1] + E[2] * E[2] + 2.0 * (E[3] * E[3] + E[4] * E[4] + E[5] * E[5]);
    return mu * square + 0.5 * lambda * trace * trace;
}

Pack cofactors(const Gradient& F, Gradient& cof) {
    const Pack* m = F.m;
    cof.m[0] = m[4] * m[8] - m[7] * m[5];
    cof.m[1] = m[6] * m[5] - m[3] * m[8];
    cof.m[2] = m[3] * m[7] - m[6] * m[4];
    cof.m[3] = m[7] * m[2] - m[1] * m[8];
    cof.m[4] = m[0] * m[8] - m[6] * m[2];
    cof.m[5] = m[6] * m[1] - m[0] * m[7];
    cof.m[6] = m[1] * m[5] - m[4] * m[2];
    cof.m[7] = m[3] * m[2] - m[0] * m[5];
    cof.m[8] = m[0] * m[4] - m[3] * m[1];
    return m[0] * cof.m[0] + m[1] * cof.m[1] + m[2] * cof.m[2];
}

// P = mu (F - F^-T) + lambda ln J F^-T
Pack neo_hookean(const Gradient& F, double mu, double lambda, Gradient& P) {
    Gradient cof;
    const Pack J = cofactors(F, cof);
    const Pack log_j = log_of(J);
    const Pack factor = (lambda * log_j - mu) / J;
    Pack square = F.m[0] * F.m[0];
    for (int i = 1; i < 9; ++i) square += F.m[i] * F.m[i];
    for (int i = 0; i < 9; ++i) P.m[i] = mu * F.m[i] + factor * cof.m[i];
    return 0.5 * mu * (square - 3.0) - mu * log_j + 0.5 * lambda * log_j * log_j;
}

// K/2 (ln J)^2 alone: P = K ln J F^-T
Pack log_volume(const Gradient& F, double bulk, Gradient& P) {
    Gradient cof;
    const Pack J = cofactors(F, cof);
    const Pack log_j = log_of(J);
    const Pack factor = bulk * log_j / J;
    for (int i = 0; i < 9; ++i) P.m[i] = factor * cof.m[i];
    return 0.5 * bulk * log_j * log_j;
}

// Eigenvalues (diagonal of A) and eigenvectors (columns of V) of a symmetric 3x3 by cyclic Jacobi rotations,
// all lanes together; Golub & Van Loan 8.5. A: xx yy zz xy xz yz, overwritten.
struct Symmetric {
    Pack m[6];
};

void rotate(Pack& app, Pack& aqq, Pack& apq, Pack& arp, Pack& arq, Pack* vp, Pack* vq) {
    // t = sign(tau)/(|tau| + sqrt(1 + tau^2)), tau = (aqq - app)/(2 apq), written without a division by apq
    const Pack d = aqq - app, e = 2.0 * apq;
    const Pack root = lanewise(d * d + e * e, [](double v) { return std::sqrt(v); });
    const Pack sign = lanewise(d, [](double v) { return v < 0.0 ? -1.0 : 1.0; });
    const Pack denominator = d * sign + root;
    const Pack safe = lanewise(denominator, [](double v) { return v > 0.0 ? v : 1.0; });
    const Pack t = sign * e / safe;
    const Pack c = 1.0 / lanewise(1.0 + t * t, [](double v) { return std::sqrt(v); });
    const Pack s = t * c;
    app -= t * apq;
    aqq += t * apq;
    apq = 0.0 * apq;
    const Pack rp = arp, rq = arq;
    arp = c * rp - s * rq;
    arq = s * rp + c * rq;
    for (int k = 0; k < 3; ++k) {
        const Pack p = vp[k], q = vq[k];
        vp[k] = c * p - s * q;
        vq[k] = s * p + c * q;
    }
}

void jacobi(Symmetric& A, Pack V[3][3]) {
    const Pack zero{}, one = zero + 1.0;
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) V[i][k] = i == k ? one : zero;
    for (int sweep = 0; sweep < 8; ++sweep) {
        const Pack off = A.m[3] * A.m[3] + A.m[4] * A.m[4] + A.m[5] * A.m[5];
        const Pack diagonal = A.m[0] * A.m[0] + A.m[1] * A.m[1] + A.m[2] * A.m[2];
        bool done = true;
        for (std::size_t l = 0; l < kPackLanes; ++l) done = done && off[l] <= 1e-34 * diagonal[l] + 1e-300;
        if (done) break;
        rotate(A.m[0], A.m[1], A.m[3], A.m[4], A.m[5], V[0], V[1]);
        rotate(A.m[0], A.m[2], A.m[4], A.m[3], A.m[5], V[0], V[2]);
        rotate(A.m[1], A.m[2], A.m[5], A.m[3], A.m[4], V[1], V[2]);
    }
}

// Laws in principal stretches l_i: S = sum_i s_i N_i N_i^T, s_i = (1/l_i) d psi/d l_i, P = F S (material.h).
Pack principal(const Material& material, PartWeights part, const Gradient& F, Gradient& P) {
    const auto dot = [&](int b, int d) {
        return F.m[3 * b] * F.m[3 * d] + F.m[3 * b + 1] * F.m[3 * d + 1] + F.m[3 * b + 2] * F.m[3 * d + 2];
    };
    Symmetric C{{dot(0, 0) - 1.0, dot(1, 1) - 1.0, dot(2, 2) - 1.0, dot(0, 1), dot(0, 2), dot(1, 2)}};
    Pack N[3][3];
    jacobi(C, N);
    Gradient cof;
    const Pack J = cofactors(F, cof);
    const Pack invalid = lanewise(J, [](double j) { return j > 0.0 ? 0.0 : std::numeric_limits<double>::quiet_NaN(); });
    Pack c[3], s[3], psi{};
    for (int i = 0; i < 3; ++i)
        c[i] =
            lanewise(C.m[i] + 1.0, [](double v) { return v > 1e-12 ? v : std::numeric_limits<double>::quiet_NaN(); });
    if (material.law() == BodyLaw::kOgden) {
        const double alpha = material.alpha(), G = part.shear * material.mu(), K = part.volume * material.lambda();
        Pack log_l[3], e[3];
        for (int i = 0; i < 3; ++i) log_l[i] = 0.5 * log_of(c[i]);
        const Pack log_j = log_l[0] + log_l[1] + log_l[2];
        for (int i = 0; i < 3; ++i) e[i] = exp_of(alpha * (log_l[i] - log_j / 3.0));
        const Pack sum = e[0] + e[1] + e[2];
        psi = 2.0 * G / (alpha * alpha) * (sum - 3.0) + 0.5 * K * log_j * log_j;
        for (int i = 0; i < 3; ++i) s[i] = (2.0 * G / alpha * (e[i] - sum / 3.0) + K * log_j) / c[i];
    } else {
        const double mu = part.shear * material.mu(), lambda = part.volume * material.lambda();
        Pack l[3];
        for (int i = 0; i < 3; ++i) l[i] = lanewise(c[i], [](double v) { return std::sqrt(v); });
        const Pack trace = l[0] + l[1] + l[2] - 3.0;
        psi = 0.5 * lambda * trace * trace;
        for (int i = 0; i < 3; ++i) {
            psi += mu * (l[i] - 1.0) * (l[i] - 1.0);
            s[i] = (2.0 * mu * (l[i] - 1.0) + lambda * trace) / l[i];
        }
    }
    for (auto& p : P.m) p = invalid;
    for (int i = 0; i < 3; ++i) {
        Pack f[3];  // s_i F N_i
        for (int a = 0; a < 3; ++a) f[a] = s[i] * (F.m[a] * N[i][0] + F.m[a + 3] * N[i][1] + F.m[a + 6] * N[i][2]);
        for (int b = 0; b < 3; ++b)
            for (int a = 0; a < 3; ++a) P.m[a + 3 * b] += f[a] * N[i][b];
    }
    return psi + invalid;
}

Pack evaluate(const Material& material, PartWeights part, const Gradient& F, Gradient& P) {
    switch (material.law()) {
        case BodyLaw::kStVK:
            return stvk(F, part.shear * material.mu(), part.volume * material.lambda(), P);
        case BodyLaw::kNeoHookean:
            return neo_hookean(F, part.shear * material.mu(), part.volume * material.lambda(), P);
        case BodyLaw::kOgden:
            if (part.shear == 0.0) return log_volume(F, part.volume * material.lambda(), P);
            break;
        case BodyLaw::kCorotational:
            break;
    }
    return principal(material, part, F, P);
}

bool adds_effects(const StrainPoints& points) {
    return points.stiffening != 0.0 || !points.prestress.empty();
}

// What effects add (strain_points.h): stiffening of the shear law, stress of the past S (over the stiffness scale).
void add_effects(const StrainPoints& points, const Material& material, const Pack (&S)[6], const Gradient& F,
                 Gradient& P, Pack& psi) {
    if (points.stiffening != 0.0) {
        const double b = points.stiffening / (points.part.shear * material.mu());
        const Pack factor = 1.0 + b * psi;
        for (auto& p : P.m) p *= factor;
        psi *= 1.0 + 0.5 * b * psi;
    }
    if (points.prestress.empty()) return;
    constexpr int kIndex[3][3] = {{0, 3, 4}, {3, 1, 5}, {4, 5, 2}};
    for (int b = 0; b < 3; ++b) {
        Pack C_diagonal{};
        for (int a = 0; a < 3; ++a) {
            const Pack FS = F.m[a] * S[kIndex[0][b]] + F.m[a + 3] * S[kIndex[1][b]] + F.m[a + 6] * S[kIndex[2][b]];
            P.m[a + 3 * b] += FS;
            C_diagonal += F.m[a + 3 * b] * FS;  // sum over b: F : F S = C : S
        }
        psi += 0.5 * (C_diagonal - S[b]);
    }
}

double stress_of_the_past(const StrainPoints& points, std::size_t q, std::size_t i) {
    if (points.prestress.empty() || points.stiffness_scale[q] == 0.0) return 0.0;
    return points.prestress[6 * q + i] / points.stiffness_scale[q];
}

// One simulation alone (lane 0; the padding gets the same): the law is evaluated for kPackLanes points at once, and the
// axes of a point's gradient take the place of lanes.
void add_gradient_of_one_lane(std::span<const StrainPoints* const> sets, const PointRows& rows,
                              const Material& material, const double* x, double* gradient, double* spare,
                              double* energy, std::size_t stride) {
    constexpr std::size_t kN = kPackLanes;
    static_assert(kN >= 3);
    const StrainPoints& points = *sets.front();
    const auto entry = [&](std::int32_t i) {  // dN/dX of a node entry; the last lanes belong to the next or are 0
        return static_cast<std::size_t>(i) + 1 < points.node.size()
                   ? load(&points.gradient[3 * static_cast<std::size_t>(i)])
                   : Pack{points.gradient[3 * static_cast<std::size_t>(i)],
                          points.gradient[3 * static_cast<std::size_t>(i) + 1],
                          points.gradient[3 * static_cast<std::size_t>(i) + 2]};
    };
    Pack total{};
    for (std::size_t k = 0; k < rows.count; k += kN) {
        const std::size_t count = std::min(kN, rows.count - k);
        double packed[9][kN] = {};  // F of the points, then sum over sets of V s P
        for (std::size_t j = 0; j < kN; ++j) {
            const auto q = static_cast<std::size_t>(rows.point[k + std::min(j, count - 1)]);
            Pack row[3]{};  // F_ab over b
            for (auto i = points.offset[q]; i < points.offset[q + 1]; ++i) {
                const double* xi = x + static_cast<std::size_t>(points.node[static_cast<std::size_t>(i)]) * 3 * stride;
                const Pack g = entry(i);
                for (std::size_t a = 0; a < 3; ++a) row[a] += xi[a * stride] * g;
            }
            for (std::size_t a = 0; a < 3; ++a)
                for (std::size_t b = 0; b < 3; ++b) packed[a + 3 * b][j] = row[a][b];
        }
        Gradient F, sum{};
        for (int m = 0; m < 9; ++m) F.m[m] = load(packed[m]);
        for (const StrainPoints* set : sets) {
            Pack scale{};
            for (std::size_t j = 0; j < count; ++j) {
                const auto q = static_cast<std::size_t>(rows.point[k + j]);
                scale[j] = set->volume[q] * set->stiffness_scale[q];
            }
            Gradient P;
            Pack psi = evaluate(material, set->part, F, P);
            if (adds_effects(*set)) {
                Pack S[6]{};
                for (std::size_t j = 0; j < count; ++j)
                    for (std::size_t i = 0; i < 6; ++i)
                        S[i][j] = stress_of_the_past(*set, static_cast<std::size_t>(rows.point[k + j]), i);
                add_effects(*set, material, S, F, P, psi);
            }
            const Pack none{};
            const auto there = scale != 0.0;  // elsewhere cut away: F may be anything
            total += there ? scale * psi : none;
            for (int m = 0; m < 9; ++m) sum.m[m] += there ? scale * P.m[m] : none;
        }
        for (int m = 0; m < 9; ++m) store(packed[m], sum.m[m]);
        for (std::size_t j = 0; j < count; ++j) {
            const auto q = static_cast<std::size_t>(rows.point[k + j]);
            Pack column[3]{};  // sum of V s P_ab over a
            for (std::size_t b = 0; b < 3; ++b)
                for (std::size_t a = 0; a < 3; ++a) column[b][a] = packed[a + 3 * b][j];
            for (auto i = points.offset[q]; i < points.offset[q + 1]; ++i) {
                const std::int32_t r = rows.row[static_cast<std::size_t>(i)];
                double* gi = r >= 0 ? gradient + static_cast<std::size_t>(r) * 3 * stride
                                    : spare + static_cast<std::size_t>(~r) * 3 * stride;
                const double* g = &points.gradient[3 * static_cast<std::size_t>(i)];
                const Pack f = column[0] * g[0] + column[1] * g[1] + column[2] * g[2];
                for (std::size_t a = 0; a < 3; ++a) store(gi + a * stride, load(gi + a * stride) + f[a]);
            }
        }
    }
    for (std::size_t j = 0; j < kN; ++j) store(energy, load(energy) + total[j]);
}

void add_gradient_of_lanes(const StrainPoints& points, const PointRows& rows, const Material& material, const double* x,
                           double* gradient, double* spare, double* energy, std::size_t stride, std::size_t lanes) {
    for (std::size_t k = 0; k < rows.count; ++k) {
        const auto q = static_cast<std::size_t>(rows.point[k]);
        const auto first = static_cast<std::size_t>(points.offset[q]),
                   last = static_cast<std::size_t>(points.offset[q + 1]);
        const double scale = points.volume[q] * points.stiffness_scale[q];
        if (scale == 0.0) continue;  // cut away: F may be anything
        for (std::size_t lane = 0; lane < lanes; lane += kPackLanes) {
            Gradient F{};
            for (auto i = first; i < last; ++i) {
                const double* xi = x + static_cast<std::size_t>(points.node[i]) * 3 * stride + lane;
                const double* g = &points.gradient[3 * i];
                for (std::size_t a = 0; a < 3; ++a) {
                    const Pack v = load(xi + a * stride);
                    for (std::size_t b = 0; b < 3; ++b) F.m[a + 3 * b] += v * g[b];
                }
            }
            Gradient P;
            Pack psi = evaluate(material, points.part, F, P);
            if (adds_effects(points)) {
                Pack S[6];
                for (std::size_t i = 0; i < 6; ++i) S[i] = Pack{} + stress_of_the_past(points, q, i);
                add_effects(points, material, S, F, P, psi);
            }
            store(energy + lane, load(energy + lane) + scale * psi);
            for (auto& p : P.m) p *= scale;
            for (auto i = first; i < last; ++i) {
                const std::int32_t row = rows.row[i];
                double* gi = row >= 0 ? gradient + static_cast<std::size_t>(row) * 3 * stride + lane
                                      : spare + static_cast<std::size_t>(~row) * 3 * stride + lane;
                const double* g = &points.gradient[3 * i];
                for (std::size_t a = 0; a < 3; ++a)
                    store(gi + a * stride,
                          load(gi + a * stride) + P.m[a] * g[0] + P.m[a + 3] * g[1] + P.m[a + 6] * g[2]);
            }
        }
    }
}

}  // namespace

TERES_MULTIVERSION
void add_gradient_of_points(std::span<const StrainPoints* const> sets, const PointRows& rows, const Material& material,
                            const double* x, double* gradient, double* spare, double* energy, std::size_t stride,
                            std::size_t lanes) noexcept {
    if (lanes == 1 && stride == kPackLanes) {
        add_gradient_of_one_lane(sets, rows, material, x, gradient, spare, energy, stride);
        return;
    }
    for (const StrainPoints* set : sets)
        add_gradient_of_lanes(*set, rows, material, x, gradient, spare, energy, stride, lanes);
}

}  // namespace teres
