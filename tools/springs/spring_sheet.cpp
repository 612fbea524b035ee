#include "tools/springs/spring_sheet.h"

#include <Eigen/Dense>
#include <algorithm>
#include <chrono>
#include <cmath>

#include "plugins/estimator/ro_ukf.h"

namespace teres::tools {
namespace {

using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector4d;
using Eigen::VectorXd;

constexpr double kNoise_m = 5e-4;       // what springs may miss at a node and step
constexpr double kFirstNoise_m = 8e-3;  // of the first round, halved from round to round: the law is far off at first
constexpr int kMaxRounds = 15;
constexpr double kStays = 0.01;  // of the prior deviation, from round to round
const Vector4d kPriorMean(0.0, 0.0, 0.0, 0.0), kPriorStdev(0.3, 0.4, 0.5, 0.8);

SpringLaw law_of(const Vector4d& q) {
    const double g1 = std::exp(q(0)), g3 = std::exp(q(2));
    return {g1, (std::exp(q(1)) - 1.0) * std::sqrt(3.0 * g1 * g3), g3, 1.0 / (1.0 + std::exp(-q(3)))};
}

// The edge at each step under one law; empty if a step fails.
std::vector<Matrix3Xd> follow(const SpringSheet& springs, const Sheet& sheet, const SheetMaterial& m,
                              const std::vector<double>& load_share) {
    std::vector<Matrix3Xd> path;
    Matrix3Xd x = edge_at_rest(sheet);
    for (const double share : load_share) {
        if (!springs.equilibrium(share * sheet.load_n(m), x)) return {};
        path.push_back(x);
    }
    return path;
}

}  // namespace

SpringSheet::SpringSheet(const Sheet& sheet, double E, const SpringLaw& law)
    : X_(edge_at_rest(sheet)), theta_(E * sheet.width_m * sheet.thickness_m / sheet.length_m) {
    const auto count = static_cast<std::size_t>(sheet.columns);
    std::vector<Eigen::Vector3d> X, n(count, -Eigen::Vector3d::UnitX());
    std::vector<NodeIndex> node;
    std::vector<std::vector<std::size_t>> others(count);
    for (std::size_t i = 0; i < count; ++i) {
        X.emplace_back(X_.col(static_cast<Eigen::Index>(i)));
        node.push_back(static_cast<NodeIndex>(i));
        for (std::size_t j = 0; j < count; ++j)
            if (j != i) others[i].push_back(j);
    }
    const double layer = 0.5 * sheet.length_m;
    fans_ =
        make_fans(X, n, node, others, sheet.length_m, law.diagonal, {law.g3 / (layer * layer), law.g2 / layer, law.g1});
    share_ = VectorXd::Constant(sheet.columns, 1.0 / (sheet.columns - 1));
    share_(0) = share_(sheet.columns - 1) = 0.5 / (sheet.columns - 1);
}

double SpringSheet::evaluate(const Matrix3Xd& x, double load_n, VectorXd& gradient) const {
    double energy = 0.0;
    gradient.setZero(x.size());
    for (std::size_t i = 0; i < fans_.size(); ++i) {
        const auto c = static_cast<Eigen::Index>(i);
        const std::array<double, kPackLanes> factor{theta_ * share_(c)};
        add_fan_gradient(fans_[i], factor.data(), x.data(), gradient.data(), &energy, 1, 0, 1);
        energy -= load_n * share_(c) * (x(0, c) - X_(0, c));
        gradient(3 * c) -= load_n * share_(c);
    }
    return energy;
}

void SpringSheet::tangent(const Matrix3Xd& x, MatrixXd& K) const {
    K.setZero(x.size(), x.size());
    FanStiffness fan;
    for (std::size_t i = 0; i < fans_.size(); ++i) {
        fan_stiffness(fans_[i], x, fan);
        for (std::size_t a = 0; a < fans_[i].near.size(); ++a)
            for (std::size_t b = 0; b < fans_[i].near.size(); ++b)
                K.block<3, 3>(3 * fans_[i].near[a].node, 3 * fans_[i].near[b].node) +=
                    theta_ * share_(static_cast<Eigen::Index>(i)) * fan.block(a, b);
    }
}

bool SpringSheet::equilibrium(double load_n, Matrix3Xd& x) const {
    if (x == X_) x.row(0).array() += 1e-3 * (fans_[0].near[0].rest_length_m);  // taut: at rest no spring has a slope
    VectorXd gradient, trial_gradient;
    MatrixXd K;
    double energy = evaluate(x, load_n, gradient);
    for (int iteration = 0; iteration < 200; ++iteration) {
        if (!(gradient.norm() > 1e-8 * load_n)) return true;
        tangent(x, K);
        K.diagonal().array() += 1e-6 * theta_;
        const VectorXd step = -K.ldlt().solve(gradient);
        const double slope = gradient.dot(step);
        double share = 1.0;
        for (int halving = 0;; ++halving, share *= 0.5) {
            if (halving == 40) return false;
            const Matrix3Xd trial = x + share * Eigen::Map<const Matrix3Xd>(step.data(), 3, x.cols());
            const double trial_energy = evaluate(trial, load_n, trial_gradient);
            if (trial_energy <= energy + 1e-4 * share * slope || trial_gradient.norm() < 0.5 * gradient.norm()) {
                x = trial;
                energy = trial_energy;
                gradient = trial_gradient;
                break;
            }
        }
    }
    return false;
}

Result<CalibrationResult> calibrate(const Sheet& sheet, const SheetMaterial& material, const SheetPath& truth) {
    const double E = material.youngs_modulus_pa();
    const Eigen::Index rows = 3 * sheet.columns;
    const Matrix3Xd X = edge_at_rest(sheet);
    CalibrationResult out;
    out.mean = kPriorMean;
    bool stays = false;
    while (!stays && out.rounds < kMaxRounds) {
        const double noise = std::max(kNoise_m, kFirstNoise_m * std::pow(0.5, out.rounds));
        const VectorXd variance = VectorXd::Constant(rows, noise * noise);
        // The state is the edge at rest, known; sigma points as in every step: draw, advance, correct.
        RoUkf filter(Eigen::Map<const VectorXd>(X.data(), rows), out.mean,
                     Vector4d(kPriorStdev.cwiseAbs2()).asDiagonal());
        for (std::size_t s = 0; s < truth.load_share.size(); ++s) {
            MatrixXd points = filter.sigma_points();
            for (Eigen::Index p = 0; p < points.cols(); ++p) {
                Matrix3Xd x =
                    s == 0 ? X : Matrix3Xd(Eigen::Map<const Matrix3Xd>(points.col(p).data(), 3, sheet.columns));
                const SpringSheet springs(sheet, E, law_of(points.col(p).tail<4>()));
                if (!springs.equilibrium(truth.load_share[s] * sheet.load_n(material), x))
                    return not_usable(material.name + ": springs find no equilibrium at load step " +
                                      std::to_string(s + 1));
                points.col(p).head(rows) = Eigen::Map<const VectorXd>(x.data(), rows);
            }
            filter.predict(points);
            filter.correct(Eigen::Map<const VectorXd>(truth.edge_m[s].data(), rows), points.topRows(rows), variance);
        }
        const Vector4d mean = filter.theta();
        stays = noise == kNoise_m && ((mean - out.mean).cwiseQuotient(kPriorStdev)).cwiseAbs().maxCoeff() < kStays;
        out.mean = mean;
        out.stdev = filter.covariance().diagonal().cwiseSqrt();
        ++out.rounds;
    }
    out.law = law_of(out.mean);
    const SpringSheet springs(sheet, E, out.law);
    const auto start = std::chrono::steady_clock::now();
    out.edge_m = follow(springs, sheet, material, truth.load_share);
    out.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    if (out.edge_m.empty()) return not_usable(material.name + ": the springs found have no equilibrium on the path");
    std::vector<double> errors;
    for (std::size_t s = 0; s < truth.edge_m.size(); ++s) {
        const VectorXd e = 1e3 * (out.edge_m[s] - truth.edge_m[s]).colwise().norm().transpose();
        errors.insert(errors.end(), e.begin(), e.end());
        out.last_error_mm = e.mean();
    }
    std::sort(errors.begin(), errors.end());
    for (const double e : errors) out.mean_error_mm += e / static_cast<double>(errors.size());
    out.p95_error_mm = errors[(errors.size() * 95) / 100];
    out.max_error_mm = errors.back();
    return out;
}

}  // namespace teres::tools
