#include "plugins/simulation/strain_points.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "plugins/simulation/body.h"
#include "plugins/simulation/system.h"
#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

TetMesh distorted_block() {
    TetMeshData data = test::block_mesh({0.1, 0.08, 0.06}, {4, 3, 3});
    for (std::size_t i = 0; i < data.nodes.size(); ++i)  // smooth distortion: a patch of unequal tetrahedra
        data.nodes[i][0] += 0.004 * std::sin(97.0 * data.nodes[i][1]) * std::cos(61.0 * data.nodes[i][2]);
    return *TetMesh::make(data);
}

class EveryElement : public testing::TestWithParam<ElementType> {};

// The volumes of each set of points fill the body.
TEST_P(EveryElement, VolumesFillTheBody) {
    const TetMesh mesh = distorted_block();
    double body = 0.0;
    for (const double v : mesh.volume) body += v;
    for (const auto& set : make_strain_points(mesh, GetParam(), 0.5)) {
        double sum = 0.0;
        for (const double v : set.volume) sum += v;
        EXPECT_NEAR(sum, body, 1e-12 * body);
    }
}

// Patch test: under a homogeneous F all inner nodes are in equilibrium and the energy is V psi(F), for every
// law.
TEST_P(EveryElement, PassesThePatchTest) {
    const TetMesh mesh = distorted_block();
    Matrix3d F;
    F << 1.06, 0.03, -0.02, 0.01, 0.95, 0.04, -0.03, 0.02, 1.03;
    double volume = 0.0;
    for (const double v : mesh.volume) volume += v;
    for (const BodyLaw law : {BodyLaw::kStVK, BodyLaw::kNeoHookean, BodyLaw::kOgden, BodyLaw::kCorotational}) {
        BodyData b;
        b.law = law;
        b.youngs_modulus_pa = 21e3;
        b.poissons_ratio = 0.49;
        b.shear_modulus_pa = 7210;
        b.alpha = 0.88;
        b.bulk_modulus_pa = 3.58e5;
        const Material material = *Material::make(b);
        const Body body(make_strain_points(mesh, GetParam(), 0.5), material);
        const Positions X = GetParam() == ElementType::kQuadratic ? make_quadratic(mesh).X : mesh.X;
        const auto nodes = static_cast<std::size_t>(X.cols());
        std::vector<double> x(3 * nodes * kPackLanes), gradient(x.size(), 0.0), energy(kPackLanes, 0.0);
        for (std::size_t i = 0; i < nodes; ++i)
            for (std::size_t a = 0; a < 3; ++a)
                for (std::size_t l = 0; l < kPackLanes; ++l)
                    x[(3 * i + a) * kPackLanes + l] =
                        (F * X.col(static_cast<Eigen::Index>(i)))(static_cast<Eigen::Index>(a));
        body.add_gradient(PointShares(body.points(), X, 1), 0, x.data(), gradient.data(), nullptr, energy.data(),
                          kPackLanes, kPackLanes);
        std::vector<double> alone(gradient.size(), 0.0), energy_alone(energy.size(), 0.0);
        body.add_gradient(PointShares(body.points(), X, 1), 0, x.data(), alone.data(), nullptr, energy_alone.data(),
                          kPackLanes, 1);
        const double size = *std::max_element(gradient.begin(), gradient.end());
        for (std::size_t i = 0; i < alone.size(); ++i) ASSERT_NEAR(alone[i], gradient[i], 1e-13 * size + 1e-18);
        EXPECT_NEAR(energy_alone[0], energy[0], 1e-12 * std::abs(energy[0]));
        double psi = 0.0;
        Matrix3d P;
        ASSERT_TRUE(material.stress(F, {1, 1}, psi, P));
        EXPECT_NEAR(energy[0], volume * psi, 1e-9 * volume * psi);
        std::vector<char> on_surface(nodes, 0);
        for (const auto& f : mesh.surface)
            for (const auto n : f) on_surface[static_cast<std::size_t>(n)] = 1;
        if (GetParam() == ElementType::kQuadratic) {
            const QuadraticMesh q = make_quadratic(mesh);
            for (std::size_t i = 0; i < q.edge.size(); ++i)  // conservatively: edges between surface nodes
                on_surface[mesh.num_nodes() + i] = on_surface[static_cast<std::size_t>(q.edge[i][0])] &&
                                                   on_surface[static_cast<std::size_t>(q.edge[i][1])];
        }
        // Averaging reaches one ring further: look at nodes whose whole patch is inside for nodal types.
        double largest_inside = 0.0, largest = 0.0;
        std::vector<char> near_surface = on_surface;
        for (const auto& t : mesh.tets) {
            bool touches = false;
            for (const auto n : t) touches = touches || on_surface[static_cast<std::size_t>(n)];
            if (touches)
                for (const auto n : t) near_surface[static_cast<std::size_t>(n)] = 1;
        }
        const bool nodal = GetParam() == ElementType::kNodalBlend || GetParam() == ElementType::kNodalVolume;
        int looked_at = 0;
        for (std::size_t i = 0; i < nodes; ++i) {
            const Vector3d g(gradient[3 * i * kPackLanes], gradient[(3 * i + 1) * kPackLanes],
                             gradient[(3 * i + 2) * kPackLanes]);
            largest = std::max(largest, g.norm());
            if (nodal ? near_surface[i] && on_surface[i] : on_surface[i] != 0) continue;
            largest_inside = std::max(largest_inside, g.norm());
            ++looked_at;
        }
        EXPECT_GT(looked_at, 0);
        EXPECT_LT(largest_inside, 1e-10 * largest);
    }
}

// What effects add to points is added to a simulation alone as to one of a batch.
TEST_P(EveryElement, EffectsOnPointsAreThoseOfABatch) {
    const TetMesh mesh = distorted_block();
    BodyData b;
    b.law = BodyLaw::kNeoHookean;
    b.youngs_modulus_pa = 21e3;
    b.poissons_ratio = 0.45;
    Body body(make_strain_points(mesh, GetParam(), 0.5), *Material::make(b));
    for (auto& set : body.points()) {
        if (set.part.shear != 0.0) set.stiffening = 5e4;
        for (std::size_t q = 0; q < set.size(); ++q) {
            set.stiffness_scale[q] = q % 7 == 3 ? 0.0 : 1.0 + 0.5 * std::sin(double(q));
            for (std::size_t i = 0; i < 6; ++i) set.prestress.push_back(300.0 * std::cos(double(6 * q + i)));
        }
    }
    const Positions X = GetParam() == ElementType::kQuadratic ? make_quadratic(mesh).X : mesh.X;
    const PointShares shares(body.points(), X, 1);
    const auto dofs = static_cast<std::size_t>(X.size());
    std::vector<double> x(dofs * kPackLanes), batch(x.size(), 0.0), alone = batch, energy(kPackLanes, 0.0),
                                                                    energy_alone = energy;
    for (std::size_t d = 0; d < dofs; ++d)
        std::fill_n(&x[d * kPackLanes], kPackLanes, X.data()[d] + 0.0008 * std::sin(1.7 * double(d)));
    body.add_gradient(shares, 0, x.data(), batch.data(), nullptr, energy.data(), kPackLanes, kPackLanes);
    body.add_gradient(shares, 0, x.data(), alone.data(), nullptr, energy_alone.data(), kPackLanes, 1);
    const double size = *std::max_element(batch.begin(), batch.end());
    EXPECT_GT(size, 0.0);
    for (std::size_t i = 0; i < alone.size(); ++i) ASSERT_NEAR(alone[i], batch[i], 1e-13 * size + 1e-18);
    EXPECT_NEAR(energy_alone[0], energy[0], 1e-12 * std::abs(energy[0]));
}

// The tangent of the assembled body is the derivative of its gradient.
TEST_P(EveryElement, TangentIsGradientDerivative) {
    const TetMesh mesh = *TetMesh::make(test::block_mesh({0.02, 0.02, 0.02}, {2, 1, 1}));
    BodyData b;
    b.law = BodyLaw::kOgden;
    b.shear_modulus_pa = 7210;
    b.alpha = 0.88;
    b.bulk_modulus_pa = 3.58e5;
    const Positions X = GetParam() == ElementType::kQuadratic ? make_quadratic(mesh).X : mesh.X;
    const auto nodes = static_cast<std::size_t>(X.cols());
    MechanicalSystem system({X,
                             Body(make_strain_points(mesh, GetParam(), 0.4), *Material::make(b)),
                             {},
                             {},
                             {},
                             std::vector<char>(nodes, 0),
                             Eigen::VectorXd::Zero(static_cast<Eigen::Index>(nodes)),
                             Vector3d::Zero(),
                             0});
    ExternalActions actions;
    system.resolve({}, {}, actions);
    Positions x = X;
    for (Eigen::Index i = 0; i < x.size(); ++i) x.data()[i] += 0.0008 * std::sin(1.7 * static_cast<double>(i));
    const auto gradient = [&](const Positions& at) {
        std::vector<double> batch(3 * nodes * kPackLanes), g(batch.size()), energy(kPackLanes);
        for (std::size_t d = 0; d < 3 * nodes; ++d)
            for (std::size_t l = 0; l < kPackLanes; ++l) batch[d * kPackLanes + l] = at.data()[d];
        system.gradient(actions, {}, nullptr, batch.data(), g.data(), energy.data(), kPackLanes, 1);
        Eigen::VectorXd out(static_cast<Eigen::Index>(3 * nodes));
        for (std::size_t d = 0; d < 3 * nodes; ++d) out(static_cast<Eigen::Index>(d)) = g[d * kPackLanes];
        return out;
    };
    std::vector<double> values;
    ASSERT_TRUE(system.tangent(actions, {}, 0, nullptr, x, values));
    Eigen::VectorXd direction(static_cast<Eigen::Index>(3 * nodes)), product = Eigen::VectorXd::Zero(direction.size());
    for (Eigen::Index i = 0; i < direction.size(); ++i) direction(i) = std::cos(2.3 * static_cast<double>(i));
    system.pattern().multiply(values, direction.data(), product.data());
    const double h = 1e-7;
    Positions plus = x, minus = x;
    for (Eigen::Index i = 0; i < x.size(); ++i) {
        plus.data()[i] += h * direction(i);
        minus.data()[i] -= h * direction(i);
    }
    const Eigen::VectorXd expected = (gradient(plus) - gradient(minus)) / (2.0 * h);
    EXPECT_LT((product - expected).norm(), 1e-6 * expected.norm());
}

INSTANTIATE_TEST_SUITE_P(AllElements, EveryElement,
                         testing::Values(ElementType::kLinear, ElementType::kNodalVolume, ElementType::kNodalBlend,
                                         ElementType::kQuadratic));

}  // namespace
}  // namespace teres
