#include "plugins/diagnosis/amplitude_price.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace teres {
namespace {

constexpr double kTailDegrees = 4.0;
constexpr Eigen::Index kCountedAmplitudes = 7;

}  // namespace

double tail_price(const Eigen::VectorXd& a) {
    return 0.5 * (kTailDegrees + static_cast<double>(a.size())) * std::log1p(a.squaredNorm() / kTailDegrees);
}

Eigen::Index counted_amplitudes(Eigen::Index amplitudes) {
    return std::min(kCountedAmplitudes, amplitudes);
}

double occam_price(const Eigen::MatrixXd& S, Eigen::Index counted) {
    const Eigen::VectorXd values =
        Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(S, Eigen::EigenvaluesOnly).eigenvalues();
    return 0.5 * values.tail(std::min(counted, values.size())).cwiseMax(0.0).array().log1p().sum();
}

AmplitudePrice amplitude_price(const std::vector<Eigen::VectorXd>& a, const Eigen::MatrixXd& S, Eigen::Index counted) {
    constexpr std::array kScale{1.0, 0.5, 0.25, 0.125}, kProbability{0.7, 0.1, 0.1, 0.1};
    std::size_t combinations = 1;
    for (std::size_t e = 0; e < a.size(); ++e) combinations *= kScale.size();
    AmplitudePrice price;
    double top = -std::numeric_limits<double>::infinity();
    std::vector<double> logarithms;  // of the terms of the sum
    for (std::size_t k = 0; k < combinations; ++k) {
        Eigen::VectorXd scale(S.rows());
        Eigen::Index first = 0;
        double tail = 0.0, prior = 0.0;
        std::size_t rest = k;  // a digit per effect
        for (const Eigen::VectorXd& own : a) {
            const std::size_t choice = rest % kScale.size();
            rest /= kScale.size();
            scale.segment(first, own.size()).setConstant(kScale[choice]);
            first += own.size();
            tail += tail_price(own / kScale[choice]);
            prior += std::log(kProbability[choice]);
        }
        logarithms.push_back(prior - tail - occam_price(scale.asDiagonal() * S * scale.asDiagonal(), counted));
        if (logarithms.back() <= top) continue;
        top = logarithms.back();
        price.tail = tail;
    }
    double sum = 0.0;
    for (const double l : logarithms) sum += std::exp(l - top);
    price.occam = -top - std::log(sum) - price.tail;
    return price;
}

double narrowing_price(const Eigen::MatrixXd& S, Eigen::Index amplitudes) {
    return occam_price(S, S.rows()) - occam_price(S.topLeftCorner(amplitudes, amplitudes), amplitudes);
}

}  // namespace teres
