#include "plugins/diagnosis/error_floor.h"

#include <cmath>

namespace teres {

double ErrorFloor::log_above(const Left& left) const {
    if (!split()) return std::log(above(left.cost));
    return std::log(std::max(left.inside() - (noise - noise_beside), 0.0) + model) +
           std::log(std::max(left.beside - noise_beside, 0.0) + model_beside);
}

Left ErrorFloor::beyond(const Left& left) const {
    if (!split()) return {std::max(0.0, left.cost - total())};
    const double beside = std::max(0.0, left.beside - noise_beside - model_beside);
    return {std::max(0.0, left.inside() - (noise - noise_beside) - model) + beside, beside};
}

Left ErrorFloor::reached(const Left& from, double model_share, double rest_share) const {
    const auto part = [&](double cost, double of_noise, double of_model) {
        const double least = std::min(of_noise + model_share * of_model, cost);
        return least + rest_share * (cost - least);
    };
    if (!split()) return {part(from.cost, noise, model)};
    const double beside = part(from.beside, noise_beside, model_beside);
    return {part(from.inside(), noise - noise_beside, model) + beside, beside};
}

Left ErrorFloor::beside_noise(const Left& left, double factor) const {
    const double more = factor * factor - 1.0;
    return {left.cost - more * noise, left.beside - more * noise_beside};
}

ErrorFloor ErrorFloor::with_noise(double factor) const {
    ErrorFloor floor = *this;
    floor.noise *= factor * factor;
    floor.noise_beside *= factor * factor;
    return floor;
}

ErrorFloor ErrorFloor::with_model(double share) const {
    ErrorFloor floor = *this;
    floor.model *= share;
    floor.model_beside *= share;
    return floor;
}

Left ErrorFloor::scaled(const Left& left, double cost) const {
    const double excess = left.cost - noise;
    if (!split() || excess <= 0.0) return {cost, left.beside};
    const double share = std::max(0.0, cost - noise) / excess;
    return {cost, left.beside + (share - 1.0) * std::max(0.0, left.beside - noise_beside)};
}

ErrorFloor split_floor(ErrorFloor floor, double free_share, const Calibration& calibration) {
    floor.noise_beside = free_share * floor.noise;
    floor.model_beside = calibration.beside_model * floor.model + calibration.beside_noise * floor.noise_beside;
    return floor;
}

ErrorFloor error_floor(const Whitener& whitener, const Discrepancy& discrepancy, const Eigen::MatrixXd& J,
                       double noise_m, bool dynamic, const Calibration& calibration) {
    ErrorFloor floor;
    floor.noise = noise_m * noise_m * whitener.inverse_sigma().squaredNorm();
    floor.model = calibration.model_error * static_cast<double>(whitener.size());
    if (discrepancy.columns.cols() == 0) return floor;
    const Eigen::MatrixXd D = whitener.inverse_sigma().asDiagonal() * discrepancy.columns(whitener.rows(), Eigen::all);
    const Eigen::MatrixXd H = Eigen::MatrixXd::Identity(J.cols(), J.cols()) + J.transpose() * J, JD = J.transpose() * D;
    floor.model += (dynamic ? calibration.discrepancy_share_dynamic : calibration.discrepancy_share) *
                   (D.squaredNorm() - JD.cwiseProduct(H.llt().solve(JD)).sum());
    return floor;
}

}  // namespace teres
