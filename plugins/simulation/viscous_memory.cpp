#include "plugins/simulation/viscous_memory.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace teres {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

struct StepFactors {
    double keep, gain;  // z, g c
};

StepFactors factors(const ViscousBranch& branch, double h) {
    if (!(h > 0.0)) return {1.0, branch.strength};  // instantaneous
    if (branch.time_constant_s == 0.0) return {0.0, branch.strength / h};
    const double z = std::exp(-h / branch.time_constant_s);
    return {z, branch.strength * (1.0 - z) * branch.time_constant_s / h};
}

}  // namespace

void elastic_stress(const StrainPoints& set, const Material& material, const double* x, std::vector<double>& S,
                    std::vector<double>* psi_out, std::vector<double>* F_out) {
    S.assign(6 * set.size(), 0.0);
    if (psi_out != nullptr) psi_out->assign(set.size(), 0.0);
    if (F_out != nullptr) F_out->assign(9 * set.size(), 0.0);
    for (std::size_t q = 0; q < set.size(); ++q) {
        Matrix3d F = Matrix3d::Zero(), P;
        for (auto i = static_cast<std::size_t>(set.offset[q]); i < static_cast<std::size_t>(set.offset[q + 1]); ++i)
            F.noalias() += Eigen::Map<const Vector3d>(x + 3 * set.node[i]) *
                           Eigen::Map<const Vector3d>(&set.gradient[3 * i]).transpose();
        double psi = 0.0;
        if (F_out != nullptr) std::copy_n(F.data(), 9, &(*F_out)[9 * q]);
        if (!material.stress(F, set.part, psi, P)) continue;  // outside of the law: reported by the solver
        if (psi_out != nullptr) (*psi_out)[q] = psi;
        const Matrix3d s = F.inverse() * P;  // P = F S
        double* out = &S[6 * q];
        for (int a = 0; a < 3; ++a) out[a] = s(a, a);
        out[3] = s(0, 1);
        out[4] = s(0, 2);
        out[5] = s(1, 2);
    }
}

void ViscousMemory::enter_step(const std::vector<ViscousBranch>& branches, double h,
                               std::vector<StrainPoints>& points) const {
    if (branches.empty()) return;
    double gain = 0.0;
    std::vector<double> keep;
    for (const auto& branch : branches) {
        const StepFactors of_branch = factors(branch, h);
        gain += of_branch.gain;
        keep.push_back(of_branch.keep);
    }
    std::size_t k = 0;
    for (auto& set : points) {
        if (set.part.shear == 0.0) continue;
        if (k < past_.size()) {
            const Past& past = past_[k];
            set.prestress.resize(6 * set.size());
            for (std::size_t i = 0; i < set.prestress.size(); ++i) set.prestress[i] = -gain * past.S[i];
            for (std::size_t b = 0; b < branches.size() && b < past.H.size(); ++b)
                for (std::size_t i = 0; i < set.prestress.size(); ++i) set.prestress[i] += keep[b] * past.H[b][i];
            for (std::size_t q = 0; q < set.size(); ++q)
                for (std::size_t i = 6 * q; i < 6 * q + 6; ++i) set.prestress[i] *= set.stiffness_scale[q];
        }
        for (auto& s : set.stiffness_scale) s *= 1.0 + gain;
        ++k;
    }
}

void ViscousMemory::finish_step(const std::vector<ViscousBranch>& branches, double h,
                                const std::vector<std::vector<double>>& S) {
    if (branches.empty()) return;
    past_.resize(S.size());
    for (std::size_t k = 0; k < S.size(); ++k) {
        Past& past = past_[k];
        if (past.S.empty()) past.S.assign(S[k].size(), 0.0);
        past.H.resize(branches.size());
        for (std::size_t b = 0; b < branches.size(); ++b) {
            past.H[b].resize(S[k].size(), 0.0);
            const auto [keep, gain] = factors(branches[b], h);
            for (std::size_t i = 0; i < S[k].size(); ++i)
                past.H[b][i] = keep * past.H[b][i] + gain * (S[k][i] - past.S[i]);
        }
        past.S = S[k];
    }
}

void ViscousMemory::finish_step(const std::vector<ViscousBranch>& branches, double h, const Body& body,
                                const double* x) {
    if (branches.empty()) return;
    std::vector<std::vector<double>> S;
    for (const auto& set : body.points())
        if (set.part.shear != 0.0) elastic_stress(set, body.material(), x, S.emplace_back(), nullptr, nullptr);
    finish_step(branches, h, S);
}

}  // namespace teres
