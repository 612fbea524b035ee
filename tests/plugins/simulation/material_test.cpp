#include "plugins/simulation/material.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "plugins/simulation/body_kernels.h"
#include "tests/support/differences.h"

namespace teres {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

BodyData body(BodyLaw law) {
    BodyData b;
    b.law = law;
    b.youngs_modulus_pa = 21000.0;
    b.poissons_ratio = 0.45;
    b.shear_modulus_pa = 7210.0;
    b.alpha = 0.88;
    b.bulk_modulus_pa = 70000.0;
    return b;
}

Matrix3d stretched() {
    Matrix3d F;
    F << 1.12, 0.08, -0.05, 0.03, 0.91, 0.11, -0.07, 0.02, 1.04;
    return F;
}

struct Sample {
    BodyLaw law;
    PartWeights part;
    const char* name;
};

class MaterialLaw : public testing::TestWithParam<Sample> {};

// Step 1e-6 relative to F of order 1: truncation 1e-12, rounding 1e-10 of the modulus.
TEST_P(MaterialLaw, StressIsEnergyGradient) {
    const Material m = *Material::make(body(GetParam().law));
    const auto energy = [&](const Eigen::VectorXd& f) {
        double psi = 0.0;
        EXPECT_TRUE(m.energy(Eigen::Map<const Matrix3d>(f.data()), GetParam().part, psi));
        return psi;
    };
    const Matrix3d F = stretched();
    double psi = 0.0;
    Matrix3d P;
    ASSERT_TRUE(m.stress(F, GetParam().part, psi, P));
    const Eigen::VectorXd f = Eigen::Map<const Eigen::VectorXd>(F.data(), 9);
    const Eigen::VectorXd expected = test::gradient(energy, f);
    EXPECT_LT((Eigen::Map<const Eigen::VectorXd>(P.data(), 9) - expected).norm(), 1e-6 * (expected.norm() + m.mu()));
}

TEST_P(MaterialLaw, TangentIsStressDerivative) {
    const Material m = *Material::make(body(GetParam().law));
    const auto stress = [&](const Eigen::VectorXd& f) -> Eigen::VectorXd {
        double psi = 0.0;
        Matrix3d P;
        EXPECT_TRUE(m.stress(Eigen::Map<const Matrix3d>(f.data()), GetParam().part, psi, P));
        return Eigen::Map<const Eigen::VectorXd>(P.data(), 9);
    };
    for (const Matrix3d& F :
         {stretched(), Matrix3d(Matrix3d::Identity()), Matrix3d(Vector3d(1.1, 1.1, 0.9).asDiagonal())}) {
        double psi = 0.0;
        Matrix3d P;
        Matrix9d A;
        ASSERT_TRUE(m.tangent(F, GetParam().part, psi, P, A));
        const Eigen::VectorXd f = Eigen::Map<const Eigen::VectorXd>(F.data(), 9);
        const Eigen::MatrixXd expected = test::jacobian(stress, f);
        EXPECT_LT((A - expected).norm(), 1e-5 * (expected.norm() + m.mu()));
    }
}

// A rotation stores no energy and gives no stress.
TEST_P(MaterialLaw, RotationIsFree) {
    const Material m = *Material::make(body(GetParam().law));
    const Matrix3d R = Eigen::AngleAxisd(1.1, Vector3d(1, 2, -1).normalized()).toRotationMatrix();
    double psi = 1.0;
    Matrix3d P;
    ASSERT_TRUE(m.stress(R, {1.0, 1.0}, psi, P));
    EXPECT_NEAR(psi, 0.0, 1e-10 * m.mu());
    EXPECT_LT(P.norm(), 1e-10 * m.mu());
}

// The batched kernel (four lanes a pack) and the scalar law are two codes for one equation.
TEST_P(MaterialLaw, BatchKernelEqualsScalarLaw) {
    const Material m = *Material::make(body(GetParam().law));
    StrainPoints points;
    points.part = GetParam().part;
    points.offset = {0, 4};
    points.node = {0, 1, 2, 3};
    points.gradient = {-1, -1, -1, 1, 0, 0, 0, 1, 0, 0, 0, 1};
    points.volume = {1.0 / 6.0};
    points.stiffness_scale = {1.3};
    const std::size_t stride = 8;
    std::vector<double> x(12 * stride), gradient(12 * stride, 0.0), energy(stride, 0.0);
    std::vector<Matrix3d> F(stride);
    for (std::size_t l = 0; l < stride; ++l) {
        F[l] = Matrix3d::Identity() + 0.2 * (static_cast<double>(l) / stride) * (stretched() - 0.3 * Matrix3d::Ones());
        if (l == 1) F[l] = Vector3d(1.2, 1.2, 0.8).asDiagonal();  // equal stretches
        if (l == 2) F[l] = stretched();
        for (std::size_t i = 0; i < 4; ++i) {
            const Vector3d X =
                i == 0 ? Vector3d(0, 0, 0) : Vector3d(Matrix3d::Identity().col(static_cast<Eigen::Index>(i) - 1));
            const Vector3d position = F[l] * X;
            for (std::size_t a = 0; a < 3; ++a) x[(3 * i + a) * stride + l] = position(static_cast<Eigen::Index>(a));
        }
    }
    const std::int32_t point = 0, row[4] = {0, 1, 2, 3};
    const StrainPoints* set = &points;
    add_gradient_of_points({&set, 1}, {&point, 1, row}, m, x.data(), gradient.data(), nullptr, energy.data(), stride,
                           stride);
    for (std::size_t l = 0; l < stride; ++l) {
        double psi = 0.0;
        Matrix3d P;
        ASSERT_TRUE(m.stress(F[l], GetParam().part, psi, P));
        EXPECT_NEAR(energy[l], 1.3 / 6.0 * psi, 1e-10 * (std::abs(psi) + m.mu())) << "lane " << l;
        for (int i = 1; i < 4; ++i)
            for (int a = 0; a < 3; ++a)
                EXPECT_NEAR(gradient[static_cast<std::size_t>(3 * i + a) * stride + l], 1.3 / 6.0 * P(a, i - 1),
                            1e-9 * m.mu())
                    << "lane " << l;
    }
}

INSTANTIATE_TEST_SUITE_P(
    AllLaws, MaterialLaw,
    testing::Values(Sample{BodyLaw::kStVK, {1, 1}, "stvk"}, Sample{BodyLaw::kNeoHookean, {1, 1}, "neo_hookean"},
                    Sample{BodyLaw::kOgden, {1, 1}, "ogden"}, Sample{BodyLaw::kCorotational, {1, 1}, "corotational"},
                    Sample{BodyLaw::kStVK, {0.5, 0}, "stvk_shear"}, Sample{BodyLaw::kOgden, {0.5, 0}, "ogden_shear"},
                    Sample{BodyLaw::kOgden, {0, 1}, "ogden_volume"},
                    Sample{BodyLaw::kNeoHookean, {0.3, 1}, "neo_blend"}),
    [](const auto& test_case) { return test_case.param.name; });

// Ogden, uniaxial, incompressible limit (K = 1e5 G): nominal stress = (2 G/alpha)(l^(alpha-1) -
// l^(-alpha/2-1)).
TEST(Material, OgdenUniaxialMatchesClosedForm) {
    BodyData b = body(BodyLaw::kOgden);
    b.bulk_modulus_pa = 1e5 * b.shear_modulus_pa;
    const Material m = *Material::make(b);
    for (const double l : {0.7, 0.9, 1.2, 1.6}) {
        // Lateral stretch from P_22 = 0 by Newton on the law itself.
        double lateral = 1.0 / std::sqrt(l);
        Matrix3d P;
        double psi = 0.0;
        for (int i = 0; i < 50; ++i) {
            Matrix9d A;
            ASSERT_TRUE(m.tangent(Vector3d(l, lateral, lateral).asDiagonal(), {1, 1}, psi, P, A));
            lateral -= P(1, 1) / (A(4, 4) + A(4, 8));
        }
        const double expected = 2.0 * 7210.0 / 0.88 * (std::pow(l, 0.88 - 1.0) - std::pow(l, -0.44 - 1.0));
        EXPECT_NEAR(P(0, 0), expected, 1e-4 * std::abs(expected));  // 1e-5 compressibility
    }
}

// neo-Hookean, uniaxial, incompressible limit: nominal stress = mu (l - 1/l^2).
TEST(Material, NeoHookeanUniaxialMatchesClosedForm) {
    BodyData b = body(BodyLaw::kNeoHookean);
    b.poissons_ratio = 0.499999;
    const Material m = *Material::make(b);
    for (const double l : {0.7, 1.3, 1.8}) {
        double lateral = 1.0 / std::sqrt(l), psi = 0.0;
        Matrix3d P;
        for (int i = 0; i < 50; ++i) {
            Matrix9d A;
            ASSERT_TRUE(m.tangent(Vector3d(l, lateral, lateral).asDiagonal(), {1, 1}, psi, P, A));
            lateral -= P(1, 1) / (A(4, 4) + A(4, 8));
        }
        EXPECT_NEAR(P(0, 0), m.mu() * (l - 1.0 / (l * l)), 1e-4 * m.mu());
    }
}

TEST(Material, RejectsValuesOutOfRange) {
    BodyData b = body(BodyLaw::kStVK);
    b.poissons_ratio = 0.5;
    const auto failed = Material::make(b);
    ASSERT_FALSE(failed);
    EXPECT_NE(failed.error().text.find("poissons_ratio"), std::string::npos);
    EXPECT_NE(failed.error().text.find("0.5"), std::string::npos);
}

}  // namespace
}  // namespace teres
