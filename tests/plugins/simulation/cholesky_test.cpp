// K x = K y must give x = y, whoever else factorises meanwhile.
#include "plugins/simulation/cholesky.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <future>

#include "tests/support/box_mesh.h"

namespace teres {
namespace {

// A network of springs on the edges of a box, every node tied to its place: positive definite.
struct Springs {
    TetMeshData mesh = test::box_mesh({0.1, 0.1, 0.1}, 9, 9, 9);
    BlockPattern pattern;
    std::vector<double> values;

    explicit Springs(double stiffness) {
        const std::size_t N = mesh.nodes.size();
        std::vector<std::set<NodeIndex>> neighbours(N);
        for (const auto& tet : mesh.tets)
            for (const auto a : tet)
                for (const auto b : tet)
                    if (a != b) neighbours[static_cast<std::size_t>(a)].insert(b);
        pattern = BlockPattern::make(neighbours, std::vector<char>(N, 0));
        values.assign(pattern.num_values(), 0.0);
        const auto add = [&](NodeIndex a, NodeIndex b, const Eigen::Matrix3d& K) {
            pattern.add(a, b, pattern.block(a, b), K, values);
        };
        for (std::size_t i = 0; i < N; ++i) {
            const auto a = static_cast<NodeIndex>(i);
            add(a, a, Eigen::Matrix3d::Identity());
            for (const NodeIndex b : neighbours[i]) {
                if (b < a) continue;
                const Point &p = mesh.nodes[i], &q = mesh.nodes[static_cast<std::size_t>(b)];
                const Eigen::Vector3d d = Eigen::Vector3d(q[0] - p[0], q[1] - p[1], q[2] - p[2]).normalized();
                const Eigen::Matrix3d K = stiffness * d * d.transpose();
                add(a, a, K);
                add(b, b, K);
                add(a, b, -K);
            }
        }
    }
};

// Largest relative error of many solutions, each after a factorisation of its own.
double worst_error(double stiffness) {
    const Springs springs(stiffness);
    Cholesky factor(springs.pattern);
    const Eigen::Index n = springs.pattern.num_rows();
    const Eigen::MatrixXd truth = Eigen::MatrixXd::NullaryExpr(
        n, 40, [](Eigen::Index i, Eigen::Index j) { return std::sin(0.7 * double(i) + 1.3 * double(j)); });
    Eigen::MatrixXd rhs = Eigen::MatrixXd::Zero(n, truth.cols());
    for (Eigen::Index j = 0; j < truth.cols(); ++j)
        springs.pattern.multiply(springs.values, truth.col(j).data(), rhs.col(j).data());
    double worst = 0.0;
    for (int round = 0; round < 12; ++round) {
        if (!factor.factorise(springs.values)) return 1.0;
        Eigen::MatrixXd x = rhs;
        factor.solve(x);
        worst = std::max(worst, (x - truth).norm() / truth.norm());
    }
    return worst;
}

TEST(Cholesky, AFactorSolvesItsMatrix) {
    EXPECT_LT(worst_error(1.0), 1e-12);
}

TEST(Cholesky, ACopyKeepsItsFactorWhenTheFirstIsUsedAgain) {
    const Springs springs(1.0), stiffer(3.0);
    Cholesky first(springs.pattern);
    ASSERT_TRUE(first.factorise(springs.values));
    Cholesky copy(first);
    ASSERT_TRUE(first.factorise(stiffer.values));
    const Eigen::VectorXd truth = Eigen::VectorXd::LinSpaced(springs.pattern.num_rows(), -1.0, 2.0);
    Eigen::VectorXd once = Eigen::VectorXd::Zero(truth.size()), thrice = once;
    springs.pattern.multiply(springs.values, truth.data(), once.data());
    stiffer.pattern.multiply(stiffer.values, truth.data(), thrice.data());
    Eigen::MatrixXd by_copy = once, by_first = thrice;
    copy.solve(by_copy);
    first.solve(by_first);
    EXPECT_LT((by_copy - truth).norm(), 1e-12 * truth.norm());
    EXPECT_LT((by_first - truth).norm(), 1e-12 * truth.norm());
}

TEST(BlockPattern, SeveralVectorsAtOnceAreEachOfThem) {
    const Springs springs(2.0);
    const Eigen::Index n = springs.pattern.num_rows();
    const BlockPattern::Rows X = BlockPattern::Rows::NullaryExpr(
        n, 5, [](Eigen::Index i, Eigen::Index j) { return std::cos(0.3 * double(i) + double(j)); });
    const BlockPattern::Rows together = springs.pattern.multiply(springs.values, X);
    for (Eigen::Index j = 0; j < X.cols(); ++j) {
        const Eigen::VectorXd x = X.col(j);
        Eigen::VectorXd alone = Eigen::VectorXd::Zero(n);
        springs.pattern.multiply(springs.values, x.data(), alone.data());
        EXPECT_LT((together.col(j) - alone).norm(), 1e-12 * alone.norm());
    }
}

// A BLAS that is built without locks (Debian's libopenblas0-serial) gave errors of 0.3.
TEST(Cholesky, TwoThreadsDoNotDisturbEachOther) {
    auto other = std::async(std::launch::async, [] { return worst_error(3.0); });
    EXPECT_LT(worst_error(1.0), 1e-12);
    EXPECT_LT(other.get(), 1e-12);
}

}  // namespace
}  // namespace teres
