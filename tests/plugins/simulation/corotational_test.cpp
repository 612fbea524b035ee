#include "plugins/simulation/corotational.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>

#include "tests/plugins/simulation/peer_shapes.h"
#include "tests/support/differences.h"

namespace teres {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using test::rest_positions;

constexpr double kNu = 0.45;
const Matrix3d kTurn = Eigen::AngleAxisd(1.1, Vector3d(0.3, -0.5, 0.8).normalized()).toRotationMatrix();

CorotationalTets make(const TetMeshData& mesh, ElementFrame frame) {
    auto body = CorotationalTets::make(mesh, kNu, frame);
    EXPECT_TRUE(body.has_value());
    return std::move(*body);
}

VectorXd force(const CorotationalTets& body, const VectorXd& x, const std::vector<double>& E) {
    VectorXd f = VectorXd::Zero(x.size());
    body.add_force(x, E, f);
    return f;
}

MatrixXd dense(const BlockPattern& pattern, const std::vector<double>& values) {
    MatrixXd K = MatrixXd::Zero(pattern.num_rows(), pattern.num_rows());
    for (Index j = 0; j < K.cols(); ++j)
        for (auto k = pattern.column_start()[std::size_t(j)]; k < pattern.column_start()[std::size_t(j) + 1]; ++k)
            K(pattern.row()[std::size_t(k)], j) = K(j, pattern.row()[std::size_t(k)]) = values[std::size_t(k)];
    return K;
}

MatrixXd stiffness(CorotationalTets& body, const VectorXd& x, const std::vector<double>& E) {
    std::vector<std::set<NodeIndex>> neighbours(std::size_t(x.size() / 3));
    body.couple(neighbours);
    const auto pattern = BlockPattern::make(neighbours, std::vector<char>(neighbours.size(), 0));
    body.bind(pattern);
    std::vector<double> values(pattern.num_values(), 0.0);
    VectorXd f = VectorXd::Zero(x.size());
    body.add_force_and_stiffness(x, E, pattern, f, values);
    EXPECT_TRUE(f.isApprox(force(body, x, E), 1e-12) || f.norm() < 1e-12);
    return dense(pattern, values);
}

// The textbook element: K0 = V B^T C B with the 6x12 strain matrix in Voigt notation.
MatrixXd voigt_stiffness(const TetMeshData& mesh, double E) {
    Eigen::Matrix4d corners;
    for (int i = 0; i < 4; ++i) {
        const auto& p = mesh.nodes[std::size_t(mesh.tets[0][std::size_t(i)])];
        corners.row(i) << 1.0, p[0], p[1], p[2];
    }
    const Eigen::Matrix4d shape = corners.inverse();  // N_i = shape(0,i) + shape(1..3,i) . x
    const double V = std::abs(corners.determinant()) / 6.0;
    MatrixXd B = MatrixXd::Zero(6, 12);
    for (int i = 0; i < 4; ++i) {
        const double gx = shape(1, i), gy = shape(2, i), gz = shape(3, i);
        B(0, 3 * i) = B(3, 3 * i + 1) = B(5, 3 * i + 2) = gx;
        B(1, 3 * i + 1) = B(3, 3 * i) = B(4, 3 * i + 2) = gy;
        B(2, 3 * i + 2) = B(4, 3 * i + 1) = B(5, 3 * i) = gz;
    }
    const double c = E / ((1.0 + kNu) * (1.0 - 2.0 * kNu));
    MatrixXd C = MatrixXd::Zero(6, 6);
    C.topLeftCorner(3, 3).setConstant(c * kNu);
    C.diagonal().head(3).setConstant(c * (1.0 - kNu));
    C.diagonal().tail(3).setConstant(c * (1.0 - 2.0 * kNu) / 2.0);
    return V * B.transpose() * C * B;
}

class Corotational : public testing::TestWithParam<ElementFrame> {};

// Only d moves: the first-edge frame stays the identity however far it goes, so the element is the linear
// one.
TEST(CorotationalFirstEdge, EqualsTextbookElementInItsFrame) {
    const auto mesh = test::single_tet();
    auto body = make(mesh, ElementFrame::kFirstEdge);
    VectorXd u = VectorXd::Zero(12);
    u.tail(3) = Vector3d(0.006, -0.004, 0.009);
    const VectorXd expected = -voigt_stiffness(mesh, 5000.0) * u;
    const VectorXd f = force(body, rest_positions(mesh) + u, {5000.0});
    EXPECT_LT((f - expected).norm(), 1e-12 * expected.norm());
    EXPECT_LT((stiffness(body, rest_positions(mesh) + u, {5000.0}) - voigt_stiffness(mesh, 5000.0)).norm(),
              1e-12 * voigt_stiffness(mesh, 5000.0).norm());
}

TEST_P(Corotational, RigidMotionGivesNoForce) {
    const auto mesh = test::distorted_cube();
    const auto body = make(mesh, GetParam());
    const std::vector<double> E(6, 5000.0);
    const VectorXd x = test::moved(rest_positions(mesh), kTurn, Vector3d(0.2, -0.1, 0.4));
    EXPECT_LT(force(body, x, E).norm(), 1e-12);  // a strain of 1e-3 gives 1e-2 N
}

TEST_P(Corotational, ForceAndStiffnessTurnWithTheBody) {
    const auto mesh = test::distorted_cube();
    auto body = make(mesh, GetParam());
    const std::vector<double> E{4e3, 5e3, 6e3, 7e3, 8e3, 9e3};
    const VectorXd x = rest_positions(mesh) + test::scatter(24, 0.004);
    const VectorXd turned = test::moved(x, kTurn, Vector3d(0.1, 0.2, 0.3));
    const VectorXd f = test::moved(force(body, x, E), kTurn, Vector3d::Zero());
    EXPECT_LT((force(body, turned, E) - f).norm(), 1e-10 * f.norm());
    MatrixXd T = MatrixXd::Zero(24, 24);
    for (int a = 0; a < 8; ++a) T.block<3, 3>(3 * a, 3 * a) = kTurn;
    const MatrixXd K = T * stiffness(body, x, E) * T.transpose();
    EXPECT_LT((stiffness(body, turned, E) - K).norm(), 1e-10 * K.norm());
}

TEST_P(Corotational, StiffnessIsMinusForceDerivativeAtRest) {
    const auto mesh = test::distorted_cube();
    auto body = make(mesh, GetParam());
    const std::vector<double> E{4e3, 5e3, 6e3, 7e3, 8e3, 9e3};
    const VectorXd x = test::moved(rest_positions(mesh), kTurn, Vector3d::Zero());
    const MatrixXd K = stiffness(body, x, E);
    const auto minus_force = [&](const VectorXd& y) -> VectorXd { return -force(body, y, E); };
    EXPECT_LT((K - test::jacobian(minus_force, x)).norm(), 1e-6 * K.norm());
}

TEST_P(Corotational, ForceIsProportionalToModulus) {
    const auto mesh = test::distorted_cube();
    const auto body = make(mesh, GetParam());
    const VectorXd x = rest_positions(mesh) + test::scatter(24, 0.004);
    const std::vector<double> soft(6, 1e3), stiff(6, 3e3);
    EXPECT_LT((force(body, x, stiff) - 3.0 * force(body, x, soft)).norm(), 1e-12 * force(body, x, stiff).norm());
}

INSTANTIATE_TEST_SUITE_P(Frames, Corotational, testing::Values(ElementFrame::kFirstEdge, ElementFrame::kPolar));

TEST(CorotationalPolar, ForceIsMinusEnergyGradient) {
    const auto mesh = test::distorted_cube();
    const auto body = make(mesh, ElementFrame::kPolar);
    const std::vector<double> E{4e3, 5e3, 6e3, 7e3, 8e3, 9e3};
    const VectorXd x = test::moved(rest_positions(mesh), kTurn, Vector3d::Zero()) + test::scatter(24, 0.006);
    const VectorXd f = force(body, x, E);
    const auto energy = [&](const VectorXd& y) { return body.energy(y, E); };
    EXPECT_LT((f + test::gradient(energy, x)).norm(), 1e-6 * f.norm());
}

// The polar frame does not care which vertex comes first; the first-edge frame does, which is why the file's
// order matters.
TEST(CorotationalPolar, DoesNotDependOnVertexOrder) {
    auto mesh = test::single_tet();
    const VectorXd x = rest_positions(mesh) + test::scatter(12, 0.006);
    const VectorXd polar = force(make(mesh, ElementFrame::kPolar), x, {5e3});
    const VectorXd first = force(make(mesh, ElementFrame::kFirstEdge), x, {5e3});
    std::rotate(mesh.tets[0].begin(), mesh.tets[0].begin() + 1, mesh.tets[0].begin() + 3);
    EXPECT_LT((force(make(mesh, ElementFrame::kPolar), x, {5e3}) - polar).norm(), 1e-10 * polar.norm());
    EXPECT_GT((force(make(mesh, ElementFrame::kFirstEdge), x, {5e3}) - first).norm(), 1e-3 * first.norm());
}

TEST(CorotationalTets, RejectsFlatTetrahedronAndBadPoissonsRatio) {
    auto mesh = test::single_tet();
    EXPECT_FALSE(CorotationalTets::make(mesh, 0.5, ElementFrame::kPolar).has_value());
    mesh.nodes[3] = {0.02, 0.01, 0.0};
    const auto flat = CorotationalTets::make(mesh, kNu, ElementFrame::kPolar);
    ASSERT_FALSE(flat.has_value());
    EXPECT_NE(flat.error().text.find("tetrahedron 0"), std::string::npos);
    mesh.tets[0][2] = 9;
    EXPECT_FALSE(CorotationalTets::make(mesh, kNu, ElementFrame::kFirstEdge).has_value());
}

}  // namespace
}  // namespace teres
