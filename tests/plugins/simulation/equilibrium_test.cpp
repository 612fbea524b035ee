#include "plugins/simulation/equilibrium.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "plugins/simulation/case_model.h"
#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// A block on its unknown ligament alone: all nodes of the face x = 0 carry it.
Case block_on_ligament(BodyLaw law, double nu) {
    Case c = test::clamped_block({.size_m = {0.10, 0.04, 0.04}, .cells = {8, 3, 3}, .law = law, .poissons_ratio = nu});
    c.ligament = LigamentData{LigamentLaw::kNeoHookean, 50e3, 0.45, 0.02, 0.04, 0.0};
    for (const auto node : c.clamped) c.ligament_prior.push_back({node, 0.7});
    c.clamped.clear();
    return c;
}

MatrixXd parameters(const CaseModel& m, std::size_t lanes) {
    MatrixXd theta(static_cast<Eigen::Index>(m.num_parameters()), static_cast<Eigen::Index>(lanes));
    for (Eigen::Index p = 0; p < theta.rows(); ++p)
        for (Eigen::Index l = 0; l < theta.cols(); ++l)
            theta(p, l) = m.parameter(static_cast<std::size_t>(p)).prior_median *
                          std::exp(0.8 * std::sin(1.0 + 3.0 * static_cast<double>(p) + static_cast<double>(l)));
    return theta;
}

MatrixXd rest(const CaseModel& m, std::size_t lanes) {
    VectorXd x(static_cast<Eigen::Index>(m.num_state()));
    m.rest_state({x.data(), m.num_state()});
    return x.replicate(1, static_cast<Eigen::Index>(lanes));
}

ForwardReport advance(CaseModel& m, const std::vector<double>& force, const MatrixXd& theta, MatrixXd& X,
                      double dt = 0.01) {
    const auto lanes = static_cast<std::size_t>(X.cols());
    return m.advance({0.0, dt, force, {}}, {theta.data(), static_cast<std::size_t>(theta.size())},
                     {X.data(), static_cast<std::size_t>(X.size())}, lanes);
}

class EveryLaw : public testing::TestWithParam<BodyLaw> {};

// The batched quasi-Newton and plain Newton (each lane alone, direct solve) find the same equilibria.
TEST_P(EveryLaw, BatchEqualsPlainNewton) {
    Case c = block_on_ligament(GetParam(), 0.45);
    if (GetParam() == BodyLaw::kOgden) {
        c.body.shear_modulus_pa = 7e3;
        c.body.alpha = 0.88;
        c.body.bulk_modulus_pa = 7e4;
    }
    CaseModelSettings fast;
    fast.ligament.num_groups = 3;
    fast.equilibrium.relative_residual = 1e-9;
    CaseModelSettings plain = fast;
    plain.equilibrium.plain_newton = true;
    auto a = *CaseModel::make(c, fast), b = *CaseModel::make(c, plain);
    const std::size_t lanes = 5;
    const MatrixXd theta = parameters(*a, lanes);
    MatrixXd Xa = rest(*a, lanes), Xb = Xa;
    const MatrixXd X0 = Xa;
    const std::vector<double> force{0.02, 0.05, -0.12};
    const ForwardReport ra = advance(*a, force, theta, Xa), rb = advance(*b, force, theta, Xb);
    EXPECT_EQ(ra.lanes_converged, 5);
    EXPECT_EQ(rb.lanes_converged, 5);
    EXPECT_GT((Xa - X0).cwiseAbs().maxCoeff(), 2e-3);  // the load moves it by millimetres
    EXPECT_LT((Xa - Xb).norm(), 1e-6 * (Xb - X0).norm());
    EXPECT_GT((Xa.col(0) - Xa.col(1)).norm(),
              1e-3 * (Xa.col(0) - X0.col(0)).norm());  // lanes have their own parameters
}
INSTANTIATE_TEST_SUITE_P(AllLaws, EveryLaw,
                         testing::Values(BodyLaw::kStVK, BodyLaw::kNeoHookean, BodyLaw::kOgden,
                                         BodyLaw::kCorotational));

// A lane's result does not depend on which lanes share its batch beyond the residual criterion.
TEST(Equilibrium, LaneAloneEqualsLaneInBatch) {
    const Case c = block_on_ligament(BodyLaw::kStVK, 0.45);
    CaseModelSettings s;
    s.ligament.num_groups = 3;
    s.equilibrium.relative_residual = 1e-10;
    auto m = *CaseModel::make(c, s);
    const MatrixXd theta = parameters(*m, 6);
    MatrixXd X = rest(*m, 6);
    advance(*m, {0.0, 0.0, -0.1}, theta, X);
    MatrixXd one = rest(*m, 1);
    advance(*m, {0.0, 0.0, -0.1}, theta.col(4), one);
    EXPECT_LT((one - X.col(4)).norm(), 1e-7 * (one - rest(*m, 1)).norm());
}

// Same input, same bits.
TEST(Equilibrium, IsBitReproducible) {
    const Case c = block_on_ligament(BodyLaw::kOgden, 0.45);
    Case ogden = c;
    ogden.body.shear_modulus_pa = 7e3;
    ogden.body.alpha = 0.88;
    ogden.body.bulk_modulus_pa = 7e4;
    CaseModelSettings s;
    s.ligament.num_groups = 2;
    MatrixXd first;
    for (int run = 0; run < 2; ++run) {
        auto m = *CaseModel::make(ogden, s);
        const MatrixXd theta = parameters(*m, 3);
        MatrixXd X = rest(*m, 3);
        for (int k = 1; k <= 3; ++k) advance(*m, {0.0, 0.02 * k, -0.03 * k}, theta, X);
        if (run == 0)
            first = X;
        else
            EXPECT_TRUE((first.array() == X.array()).all());
    }
}

// Uniform bar on a clamp pulled along its axis: end displacement F L/(E A) for small strain (nu = 0: exact in
// 1-D).
TEST(Equilibrium, BarStretchesByHookesLaw) {
    Case c = test::clamped_block(
        {.size_m = {0.1, 0.02, 0.02}, .cells = {10, 2, 2}, .youngs_modulus_pa = 20e3, .poissons_ratio = 0.0});
    auto m = *CaseModel::make(c, CaseModelSettings());
    // Uniform traction on the far face: nodal weights by area.
    MatrixXd X = rest(*m, 1), theta(0, 1);
    const MatrixXd X0 = X;
    const double F = 1e-4;  // strain 1.25e-5: the nonlinearity of StVK is below 1e-4 of it
    advance(*m, {F, 0.0, 0.0}, theta, X);
    double mean = 0.0;
    int count = 0;
    for (Eigen::Index i = 0; i < m->mesh().X.cols(); ++i)
        if (m->mesh().X(0, i) > 0.0999) {
            mean += X(3 * i, 0) - X0(3 * i, 0);
            ++count;
        }
    mean /= count;
    EXPECT_NEAR(mean, F * 0.1 / (20e3 * 4e-4),
                0.02 * mean);  // equal nodal forces are not a uniform traction: 2 %
}

TEST(Equilibrium, UnsupportedBodyIsRefused) {
    Case c = test::clamped_block({});
    c.clamped.clear();
    const auto failed = CaseModel::make(c, CaseModelSettings());
    ASSERT_FALSE(failed);
    EXPECT_NE(failed.error().text.find("nothing holds the body"), std::string::npos);
}

// Free vibration of a clamped bar along its axis: first frequency (1/4L) sqrt(E/rho) for nu = 0 (lumped mass:
// -0.1 %).
double axial_period(const std::string& integrator, double dt, double& amplitude_ratio) {
    Case c = test::clamped_block({.size_m = {0.1, 0.02, 0.02},
                                  .cells = {20, 1, 1},
                                  .youngs_modulus_pa = 20e3,
                                  .poissons_ratio = 0.0,
                                  .quasi_static = false});
    c.body.density_kg_m3 = 1000.0;
    CaseModelSettings s;
    s.element = ElementType::kLinear;
    s.integrator = integrator;
    s.max_step_s = 1.0;  // as long as asked for
    s.equilibrium.relative_residual = 1e-7;
    auto m = *CaseModel::make(c, s);
    MatrixXd X = rest(*m, 1), theta(0, 1);
    const auto n = static_cast<Eigen::Index>(3 * m->num_nodes());
    const VectorXd X0 = X.col(0).head(n);
    for (Eigen::Index i = 0; i < n / 3; ++i)  // first mode, small amplitude
        X(3 * i, 0) += 1e-5 * std::sin(0.5 * M_PI * X0(3 * i) / 0.1);
    const double w = 0.5 * M_PI * std::sqrt(20.0) / 0.1;
    if (integrator == "generalised_alpha")  // consistent start: a = -w^2 u
        for (Eigen::Index i = 0; i < n; ++i) X(2 * n + i, 0) = -w * w * (X(i, 0) - X0(i));
    // Amplitude of the first mode: projection on its shape with the lumped masses.
    const VectorXd& mass = m->system().parts().node_mass_kg;
    const auto modal = [&] {
        double up = 0.0, down = 0.0;
        for (Eigen::Index i = 0; i < n / 3; ++i) {
            const double shape = std::sin(0.5 * M_PI * X0(3 * i) / 0.1);
            up += mass(i) * shape * (X(3 * i, 0) - X0(3 * i));
            down += mass(i) * shape * shape;
        }
        return up / down;
    };
    double previous = 1e-5, first_crossing = 0.0, last_crossing = 0.0, peak = 0.0, last_peak = 0.0;
    int crossings = 0;
    for (int k = 1; k <= static_cast<int>(0.5 / dt) && crossings < 9; ++k) {
        advance(*m, {0.0, 0.0, 0.0}, theta, X, dt);
        const double u = modal();
        peak = std::max(peak, std::abs(u));
        if (u * previous < 0.0) {
            const double t = dt * (k - u / (u - previous));
            if (crossings++ == 0) first_crossing = t;
            last_crossing = t;
            last_peak = peak;
            peak = 0.0;
        }
        previous = u;
    }
    amplitude_ratio = last_peak / 1e-5;
    return 2.0 * (last_crossing - first_crossing) / (crossings - 1);
}

TEST(TimeStep, GeneralisedAlphaKeepsPeriodAndAmplitude) {
    const double exact = 4.0 * 0.1 / std::sqrt(20e3 / 1000.0);  // 89.4 ms
    double amplitude = 0.0;
    const double period = axial_period("generalised_alpha", exact / 40.0, amplitude);
    EXPECT_NEAR(period, exact, 0.01 * exact);
    EXPECT_GT(amplitude, 0.97);  // four periods
    // Second order: half the step, about a quarter of the period error against the finest.
    double unused = 0.0;
    const double fine = axial_period("generalised_alpha", exact / 160.0, unused);
    const double coarse = axial_period("generalised_alpha", exact / 20.0, unused);
    const double ratio = (coarse - fine) / (period - fine);
    EXPECT_GT(ratio, 3.3);
    EXPECT_LT(ratio, 5.5);
}

// Implicit Euler on an oscillator: |amplification| = 1/sqrt(1 + (w h)^2) per step; four and a half periods of
// 40 steps.
TEST(TimeStep, ImplicitEulerDampsAsTheoryPredicts) {
    const double exact = 4.0 * 0.1 / std::sqrt(20.0);
    double amplitude = 0.0;
    axial_period("implicit_euler", exact / 40.0, amplitude);
    const double wh = 2.0 * M_PI / 40.0;
    EXPECT_NEAR(amplitude, std::pow(1.0 + wh * wh, -0.5 * 40.0 * 4.0), 0.04);
}

// Stiffness-proportional damping: zeta = rK w/2 per mode.
TEST(TimeStep, RayleighDampingDecaysAsTheoryPredicts) {
    Case c = test::clamped_block({.size_m = {0.1, 0.02, 0.02},
                                  .cells = {20, 1, 1},
                                  .youngs_modulus_pa = 20e3,
                                  .poissons_ratio = 0.0,
                                  .quasi_static = false});
    c.body.density_kg_m3 = 1000.0;
    const double w = 0.5 * M_PI * std::sqrt(20.0) / 0.1;
    for (const bool by_mass : {true, false}) {
        c.body.rayleigh_mass_1_s = by_mass ? 0.1 * w : 0.0;     // zeta = rM/(2 w) = 0.05
        c.body.rayleigh_stiffness_s = by_mass ? 0.0 : 0.1 / w;  // zeta = rK w/2 = 0.05
        CaseModelSettings s;
        s.element = ElementType::kLinear;
        s.spectral_radius = 1.0;
        s.equilibrium.relative_residual = 1e-7;
        auto m = *CaseModel::make(c, s);
        MatrixXd X = rest(*m, 1), theta(0, 1);
        const auto n = static_cast<Eigen::Index>(3 * m->num_nodes());
        const VectorXd X0 = X.col(0).head(n);
        for (Eigen::Index i = 0; i < n / 3; ++i) X(3 * i, 0) += 1e-5 * std::sin(0.5 * M_PI * X0(3 * i) / 0.1);
        Eigen::Index tip = 0;
        m->mesh().X.row(0).maxCoeff(&tip);
        const double period = 2.0 * M_PI / w;
        const int steps = 160;  // two periods
        for (int k = 0; k < steps; ++k) advance(*m, {0.0, 0.0, 0.0}, theta, X, 2.0 * period / steps);
        const double zeta = 0.05, wd = std::sqrt(1.0 - zeta * zeta);
        const double t = 2.0 * 2.0 * M_PI;  // w t
        // u(t) = exp(-zeta w t) (cos(wd t) + zeta/wd sin(wd t)), released from rest
        const double expected = std::exp(-zeta * t) * (std::cos(wd * t) + zeta / wd * std::sin(wd * t));
        EXPECT_NEAR((X(3 * tip, 0) - X0(3 * tip)) / 1e-5, expected, 0.02) << (by_mass ? "mass" : "stiffness");
    }
}

// Stamps of a recording at a fixed rate differ in their last digits: that is no other step.
TEST(TimeStep, StepsThatDifferByRoundingShareAFactorisation) {
    const Case c = test::clamped_block({.quasi_static = false});
    CaseModelSettings s;
    s.max_step_s = 1.0;  // as long as asked for
    auto even = *CaseModel::make(c, s), rounded = *CaseModel::make(c, s);
    MatrixXd X = rest(*even, 1), Y = X, theta(0, 1);
    const std::vector<double> force{0.0, 0.0, 0.05};
    int factorisations = 0;
    for (int k = 0; k < 10; ++k) {
        advance(*even, force, theta, X, 0.01);
        factorisations += advance(*rounded, force, theta, Y, 0.01 * (1.0 + (k % 3 - 1) * 1e-13)).factorisations;
    }
    EXPECT_EQ(factorisations, 1);
    EXPECT_GT(X.norm(), 0.0);
    EXPECT_LT((X - Y).norm(), 1e-6 * X.norm());
    EXPECT_EQ(advance(*rounded, force, theta, Y, 0.02).factorisations, 1);
}

// Frames of 10 ms are four steps of 2.5 ms while the load grows evenly.
TEST(TimeStep, LongStepsAreWalkedInParts) {
    const Case c = test::clamped_block({.youngs_modulus_pa = 2e3, .quasi_static = false});
    CaseModelSettings s;
    s.max_step_s = 0.0025;
    auto frames = *CaseModel::make(c, s), parts = *CaseModel::make(c, s);
    s.max_step_s = 1.0;
    auto at_once = *CaseModel::make(c, s);
    MatrixXd X = rest(*frames, 1), Y = X, Z = X, theta(0, 1);
    const MatrixXd start = X;
    const auto force = [](double k) { return std::vector<double>{0.0, 0.01 * k, -0.02 * k}; };
    for (int k = 1; k <= 12; ++k) {
        const ForwardReport report = advance(*frames, force(k), theta, X, 0.01);
        EXPECT_EQ(report.lanes_converged, 1);
        EXPECT_GT(report.relative_residual, 0.0);
        for (int p = 1; p <= 4; ++p) advance(*parts, force(k == 1 ? k : k - 1 + 0.25 * p), theta, Y, 0.0025);
        advance(*at_once, force(k), theta, Z, 0.01);
    }
    const auto n = static_cast<Eigen::Index>(3 * frames->num_nodes());
    const double moved = (X - start).topRows(n).norm();
    EXPECT_GT(moved, 1e-3);
    EXPECT_LT((X - Y).topRows(n).norm(), 1e-9 * moved);
    EXPECT_GT((X - Z).topRows(n).norm(), 1e-4 * moved);
}

// As many iterations as two steps of 10 ms need are too few for one of 20 ms.
TEST(TimeStep, StepThatDoesNotConvergeIsHalved) {
    const Case c = test::clamped_block({.youngs_modulus_pa = 2e3, .quasi_static = false});
    CaseModelSettings s;
    s.max_step_s = 1.0;
    s.equilibrium.max_newton_iterations = 0;
    auto twice = *CaseModel::make(c, s), at_once = *CaseModel::make(c, s);
    MatrixXd X = rest(*twice, 1), Y = X, Z = X, theta(0, 1);
    const MatrixXd start = X;
    const std::vector<double> force{0.0, 0.1, -0.2};
    const ForwardReport first = advance(*twice, force, theta, X, 0.01), second = advance(*twice, force, theta, X, 0.01),
                        whole = advance(*at_once, force, theta, Z, 0.02);
    ASSERT_EQ(first.lanes_converged + second.lanes_converged + whole.lanes_converged, 3);
    s.equilibrium.max_iterations = std::max(first.iterations, second.iterations);
    ASSERT_LT(s.equilibrium.max_iterations, whole.iterations);
    auto halved = *CaseModel::make(c, s);
    EXPECT_EQ(advance(*halved, force, theta, Y, 0.02).lanes_converged, 1);
    const auto n = static_cast<Eigen::Index>(3 * halved->num_nodes());
    const double moved = (X - start).topRows(n).norm();
    EXPECT_GT(moved, 1e-3);
    EXPECT_LT((X - Y).topRows(n).norm(), 1e-6 * moved);
    EXPECT_GT((X - Z).topRows(n).norm(), 1e-3 * moved);
    // Nothing converges in one iteration: the step ends all the same, and says so.
    s.equilibrium.max_iterations = 1;
    auto never = *CaseModel::make(c, s);
    Y = start;
    EXPECT_EQ(advance(*never, force, theta, Y, 0.02).lanes_converged, 0);
    EXPECT_TRUE(Y.allFinite());
}

}  // namespace
}  // namespace teres
