// Cuts during a run against the model of the mesh that is left, solved by the plain path.
#include "plugins/simulation/tissue_cut.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <map>

#include "plugins/simulation/case_model.h"
#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

using Eigen::Map;
using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kLanes = 5;

Case hanging_block() {
    Case c = test::clamped_block({.size_m = {0.12, 0.06, 0.04}, .cells = {8, 4, 4}, .poissons_ratio = 0.48});
    c.ligament = LigamentData{LigamentLaw::kNeoHookean, 80e3, 0.48, 0.025, 0.02, 0.0};
    for (std::size_t i = 0; i < c.mesh.nodes.size(); ++i)  // ligament over the top
        if (c.mesh.nodes[i][2] > 0.04 - 1e-9 && c.mesh.nodes[i][0] > 0.0)
            c.ligament_prior.push_back({static_cast<std::int32_t>(i), 0.7});
    return c;
}

Point centre_of(const Case& c, std::size_t e) {
    Point p{};
    for (const auto node : c.mesh.tets[e])
        for (std::size_t a = 0; a < 3; ++a) p[a] += 0.25 * c.mesh.nodes[static_cast<std::size_t>(node)][a];
    return p;
}

template <class Inside>
std::vector<std::int32_t> tets_where(const Case& c, const Inside& inside) {
    std::vector<std::int32_t> out;
    for (std::size_t e = 0; e < c.mesh.tets.size(); ++e)
        if (inside(centre_of(c, e))) out.push_back(static_cast<std::int32_t>(e));
    return out;
}

// A slit from below that reaches two thirds of the height.
std::vector<std::int32_t> slit(const Case& c) {
    return tets_where(c, [](const Point& p) { return std::abs(p[0] - 0.06) < 0.015 && p[2] < 0.03; });
}

// The case without these tetrahedra and without nodes that none of the others has; new number of each node, or -1.
Case without(const Case& c, const std::vector<std::int32_t>& tets, std::vector<std::int32_t>& number) {
    Case left = c;
    std::vector<char> gone(c.mesh.tets.size(), 0);
    for (const auto e : tets) gone[static_cast<std::size_t>(e)] = 1;
    number.assign(c.mesh.nodes.size(), -1);
    left.mesh.tets.clear();
    left.mesh.nodes.clear();
    for (std::size_t e = 0; e < gone.size(); ++e)
        for (const auto node : c.mesh.tets[e])
            if (!gone[e]) number[static_cast<std::size_t>(node)] = 0;
    for (std::size_t i = 0; i < number.size(); ++i)
        if (number[i] == 0) {
            number[i] = static_cast<std::int32_t>(left.mesh.nodes.size());
            left.mesh.nodes.push_back(c.mesh.nodes[i]);
        }
    for (std::size_t e = 0; e < gone.size(); ++e) {
        auto tet = c.mesh.tets[e];
        for (auto& node : tet) node = number[static_cast<std::size_t>(node)];
        if (!gone[e]) left.mesh.tets.push_back(tet);
    }
    for (auto& node : left.clamped) node = number[static_cast<std::size_t>(node)];
    for (auto& entry : left.ligament_prior) entry.node_id = number[static_cast<std::size_t>(entry.node_id)];
    for (auto& node : left.load_regions[0].node_ids) node = number[static_cast<std::size_t>(node)];
    return left;
}

struct Motion {
    std::unique_ptr<CaseModel> model;
    MatrixXd theta, X;
    ForwardReport report;

    Motion(const Case& c, bool plain, ElementType element = ElementType::kNodalBlend, std::size_t lanes = kLanes) {
        CaseModelSettings s;
        s.element = element;
        s.max_lanes = kLanes;
        s.ligament.num_groups = 3;
        s.equilibrium.relative_residual = 1e-9;
        s.equilibrium.plain_newton = plain;
        model = *CaseModel::make(c, s);
        theta.resize(static_cast<Eigen::Index>(model->num_parameters()), static_cast<Eigen::Index>(lanes));
        for (Eigen::Index p = 0; p < theta.rows(); ++p)
            for (Eigen::Index l = 0; l < theta.cols(); ++l)
                theta(p, l) = model->parameter(static_cast<std::size_t>(p)).prior_median *
                              std::exp(0.5 * std::sin(1.0 + static_cast<double>(3 * p + 2 * l)));
        VectorXd x(static_cast<Eigen::Index>(model->num_state()));
        model->rest_state({x.data(), model->num_state()});
        X = x.replicate(1, theta.cols());
    }
    void step(int k) {
        const double force[3] = {0.01 * k, 0.005 * k, -0.02 * k};
        report =
            model->advance({k / 30.0, 1.0 / 30.0, force, {}}, {theta.data(), static_cast<std::size_t>(theta.size())},
                           {X.data(), static_cast<std::size_t>(X.size())}, static_cast<std::size_t>(X.cols()));
    }
};

class TissueCut : public ::testing::TestWithParam<ElementType> {};

// The ligament of both is split into the same groups: the slit leaves the top as it was.
TEST_P(TissueCut, EqualsThePlainModelOfTheCutMesh) {
    const Case c = hanging_block();
    const std::vector<std::int32_t> cut = slit(c);
    std::vector<std::int32_t> number;
    const Case left = without(c, cut, number);
    ASSERT_LT(left.mesh.nodes.size(), c.mesh.nodes.size());  // some nodes have no tissue any more
    Motion fast(c, false, GetParam()), uncut(c, false, GetParam()), plain(left, true, GetParam());
    Motion alone(c, false, GetParam(), 1);  // one lane has kernels of its own
    ASSERT_EQ(fast.theta, plain.theta);
    const MatrixXd rest = plain.X;
    for (int k = 1; k <= 10; ++k) {
        if (k == 4) {
            const CutReport report = fast.model->cut(cut, {});
            EXPECT_EQ(report.outcome, CutOutcome::kDone);
            EXPECT_EQ(report.tets_removed, static_cast<std::int32_t>(cut.size()));
            EXPECT_EQ(alone.model->cut(cut, {}).outcome, CutOutcome::kDone);
        }
        fast.step(k);
        alone.step(k);
        uncut.step(k);
        plain.step(k);
        EXPECT_EQ(fast.report.lanes_converged, static_cast<std::int32_t>(kLanes)) << "step " << k;
        EXPECT_EQ(plain.report.lanes_converged, static_cast<std::int32_t>(kLanes)) << "step " << k;
    }
    const double motion = (plain.X - rest).cwiseAbs().maxCoeff();
    EXPECT_LT((alone.X - fast.X.col(0)).cwiseAbs().maxCoeff(), 1e-6 * motion);
    double difference = 0.0, change = 0.0;
    for (std::size_t i = 0; i < number.size(); ++i) {
        const auto row = static_cast<Eigen::Index>(3 * i);
        if (number[i] < 0) {  // rests where it was at first
            EXPECT_EQ(fast.X.middleRows<3>(row),
                      MatrixXd(Map<const VectorXd>(c.mesh.nodes[i].data(), 3).replicate(1, kLanes)));
            continue;
        }
        const auto expected = plain.X.middleRows<3>(3 * number[i]);
        difference = std::max(difference, (fast.X.middleRows<3>(row) - expected).cwiseAbs().maxCoeff());
        change = std::max(change, (uncut.X.middleRows<3>(row) - expected).cwiseAbs().maxCoeff());
    }
    EXPECT_GT(change, 1e-2 * motion);
    EXPECT_LT(difference, 1e-6 * motion);
}

INSTANTIATE_TEST_SUITE_P(Elements, TissueCut,
                         ::testing::Values(ElementType::kLinear, ElementType::kNodalVolume, ElementType::kNodalBlend),
                         [](const auto& element) {
                             return element.param == ElementType::kLinear        ? "linear"
                                    : element.param == ElementType::kNodalVolume ? "nodal_volume"
                                                                                 : "nodal_blend";
                         });

TEST(TissueCut, AReleasedLigamentIsOneOfNoStiffness) {
    const Case c = hanging_block();
    Motion fast(c, false), plain(c, true);
    plain.theta.row(1).setConstant(0.0);
    const MatrixXd rest = fast.X;
    for (int k = 1; k <= 8; ++k) {
        if (k == 3) {
            EXPECT_EQ(fast.model->cut({}, std::vector<std::int32_t>{1}).outcome, CutOutcome::kDone);
        }
        fast.step(k);
        EXPECT_EQ(fast.report.lanes_converged, static_cast<std::int32_t>(kLanes)) << "step " << k;
    }
    plain.step(8);
    EXPECT_LT((fast.X - plain.X).cwiseAbs().maxCoeff(), 1e-6 * (plain.X - rest).cwiseAbs().maxCoeff());
}

// Cut right through beyond the ligament: the far piece floats and goes, its marker and its load with it.
TEST(TissueCut, PiecesThatNothingHoldsGo) {
    Case c = test::clamped_block({.cells = {10, 3, 3}});
    const auto through = tets_where(c, [](const Point& p) { return std::abs(p[0] - 0.055) < 0.004; });
    const auto beyond = tets_where(c, [](const Point& p) { return p[0] > 0.055 + 0.004; });
    Motion run(c, false);
    const MatrixXd rest = run.X;
    run.step(5);
    EXPECT_GT((run.X - rest).cwiseAbs().maxCoeff(), 1e-4);
    const CutReport report = run.model->cut(through, {});
    EXPECT_EQ(report.outcome, CutOutcome::kDone);
    EXPECT_EQ(report.tets_removed, static_cast<std::int32_t>(through.size() + beyond.size()));
    for (std::size_t m = 0; m < c.markers.size(); ++m)
        EXPECT_EQ(run.model->marker_lost(m), c.markers[m].position_m[0] > 0.05) << "marker " << m;
    run.step(5);
    EXPECT_EQ(run.report.lanes_converged, static_cast<std::int32_t>(kLanes));
    EXPECT_LT((run.X - rest).cwiseAbs().maxCoeff(), 1e-9);  // the force had nothing else to act on
}

TEST(TissueCut, RefusesWhatCannotBeCutAndChangesNothing) {
    const Case c = hanging_block();
    Motion run(c, false), same(c, false), quadratic(test::clamped_block(), false, ElementType::kQuadratic);
    const auto at_the_clamp = tets_where(c, [](const Point& p) { return p[0] < 0.015; });
    const std::vector<std::int32_t> all_groups{0, 1, 2};
    EXPECT_EQ(run.model->cut(std::vector<std::int32_t>{-1}, {}).outcome, CutOutcome::kUnknownIndex);
    EXPECT_EQ(run.model->cut({}, std::vector<std::int32_t>{3}).outcome, CutOutcome::kUnknownIndex);
    EXPECT_EQ(run.model->cut(at_the_clamp, all_groups).outcome, CutOutcome::kNothingHolds);
    EXPECT_EQ(quadratic.model->cut(std::vector<std::int32_t>{0}, {}).outcome, CutOutcome::kNotSupported);
    run.step(3);
    same.step(3);
    EXPECT_EQ(run.X, same.X);
}

}  // namespace
}  // namespace teres
