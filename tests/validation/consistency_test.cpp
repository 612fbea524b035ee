// Is the filter as sure as it may be? True ligaments are drawn at random (place, width, stiffness, within the atlas),
// the recording is made with them, and the stated 95 % intervals are counted. Figures: VALIDATION.md, "Consistency".
//
//     TERES_CONSISTENCY_DRAWS=50 TERES_CONSISTENCY_PLOT=intervals.png build/release/bin/validation_consistency_test
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>

#include "plugins/estimator/boundary_estimator.h"
#include "plugins/estimator/probability.h"
#include "plugins/estimator/settings.h"
#include "plugins/simulation/case_model.h"
#include "tests/support/soft_liver.h"
#include "tools/plot.h"

namespace teres {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kLogStiffness = 0.4;  // of the drawn ligaments' modulus
constexpr double kFieldLength_m = 0.04;
constexpr int kFrames = 60;
constexpr unsigned kFirstSeed = 2000;  // unresolved_share was chosen on 1000 to 1049

int num_draws() {
    const char* text = std::getenv("TERES_CONSISTENCY_DRAWS");
    return text != nullptr ? std::max(1, std::atoi(text)) : 4;
}

Case scene(BodyLaw law) {
    tools::BenchScene s = test::soft_liver(1000, kFrames);
    s.law = law;
    return tools::bench_case(s);
}

// A node holds where z(p) + g > 0, p the atlas' probability, g a smooth field of unit variance: so every node is
// attached with exactly its probability, and neighbours mostly together. Places and widths of strips differ from draw
// to draw.
std::vector<NodeProbability> draw_attachment(const Case& c, std::mt19937& random) {
    const auto n = static_cast<Eigen::Index>(c.ligament_prior.size());
    MatrixXd K(n, n);
    const auto at = [&](Eigen::Index i) {
        const Point& p = c.mesh.nodes[static_cast<std::size_t>(c.ligament_prior[static_cast<std::size_t>(i)].node_id)];
        return Eigen::Vector3d(p[0], p[1], p[2]);
    };
    for (Eigen::Index i = 0; i < n; ++i)
        for (Eigen::Index j = 0; j < n; ++j)
            K(i, j) = std::exp(-0.5 * (at(i) - at(j)).squaredNorm() / (kFieldLength_m * kFieldLength_m)) +
                      (i == j ? 1e-6 : 0.0);
    std::normal_distribution<double> normal;
    VectorXd white(n);
    for (auto& v : white) v = normal(random);
    const VectorXd g = K.llt().matrixL() * white;
    std::vector<NodeProbability> attached;
    for (Eigen::Index i = 0; i < n; ++i) {
        const auto& prior = c.ligament_prior[static_cast<std::size_t>(i)];
        if (normal_quantile(prior.probability) + g(i) > 0.0) attached.push_back({prior.node_id, 1.0});
    }
    return attached;
}

struct Tally {
    int inside = 0, count = 0;
    std::vector<double> nis_share;      // mean NIS over degrees of freedom, per draw
    int nis_within = 0, draws = 0;      // of the draw's sum of NIS, 95 %
    std::vector<double> observability;  // sum per group
    double independent = 0.0;           // intervals, counted by independent ones
    std::vector<double> deviations;     // |truth - estimate| in stated standard deviations
    double coverage() const { return static_cast<double>(inside) / std::max(1, count); }
    double mean_nis() const {
        double sum = 0.0;
        for (const double v : nis_share) sum += v;
        return sum / static_cast<double>(nis_share.size());
    }
};

// Errors with correlations rho_ij. "Inside a symmetric interval" is an even function of a normal error: its Hermite
// series starts at degree 2, so two such events correlate by at most rho_ij^2, and the mean of n of them varies at most
// like that of
//     n^2 / sum_ij rho_ij^2     independent ones.
double independent_intervals(const MatrixXd& covariance) {
    const VectorXd s = covariance.diagonal().cwiseSqrt();
    const MatrixXd rho = s.cwiseInverse().asDiagonal() * covariance * s.cwiseInverse().asDiagonal();
    return static_cast<double>(rho.rows() * rho.rows()) / rho.squaredNorm();
}

// The smallest share k/n with P(X <= k) >= probability, X binomial of n trials that succeed with p (counted by the
// misses).
double binomial_quantile_share(double probability, int n, double p) {
    int misses = 0;
    double term = std::pow(p, n), tail = 1.0;  // P(misses = m), P(misses >= m)
    while (tail - term >= probability) {
        tail -= term;
        term *= (n - misses) * (1.0 - p) / ((misses + 1) * p);
        ++misses;
    }
    return static_cast<double>(n - misses) / n;
}

CaseModelSettings model_settings() {
    CaseModelSettings s;
    s.ligament.num_groups = 8;
    s.equilibrium.relative_residual = 1e-5;
    s.threads = 1;
    return s;
}

enum class Truth { kGroups, kStrips };  // stiffness per group from the prior; attached strips

// Draws `draws` patients. A group whose true stiffness is below the threshold of "attached" counts as inside when the
// interval reaches below the threshold: a log-normal has no zero.
Tally run(Truth kind, BodyLaw true_law, const BoundaryEstimatorOptions& options, int draws) {
    const Case c = scene(BodyLaw::kStVK);
    Tally tally;
    for (int draw = 0; draw < draws; ++draw) {
        std::mt19937 random(kFirstSeed + static_cast<unsigned>(draw));
        std::normal_distribution<double> normal;
        auto model = *CaseModel::make(c, model_settings());
        const std::size_t num_groups = model->num_parameters();
        std::vector<double> group_truth(num_groups, 0.0), theta_true;
        Case truth = scene(true_law);
        CaseModelSettings known = model_settings();
        if (kind == Truth::kStrips) {
            truth.ligament_prior = draw_attachment(c, random);
            if (truth.ligament_prior.empty()) continue;
            known.ligament.num_groups = 1;
        }
        auto body = *CaseModel::make(truth, known);
        if (kind == Truth::kStrips) {
            const LigamentGroup whole = body->ligament().groups[0];
            theta_true = {whole.full_stiffness_n_per_m * std::exp(kLogStiffness * normal(random))};
            for (const auto& held : truth.ligament_prior)
                for (std::size_t i = 0; i < model->ligament().node.size(); ++i)
                    if (model->ligament().node[i] == held.node_id)
                        group_truth[static_cast<std::size_t>(model->ligament().group[i])] +=
                            theta_true[0] * model->mesh().node_area[static_cast<std::size_t>(held.node_id)] /
                            whole.area_m2;
        } else {
            for (std::size_t g = 0; g < num_groups; ++g)
                group_truth[g] =
                    model->parameter(g).prior_median * std::exp(model->parameter(g).prior_log_stdev * normal(random));
            theta_true = group_truth;
        }

        auto estimator = *BoundaryEstimator::make(*model, options);
        std::vector<double> x(body->num_state()), z(3 * body->num_markers());
        body->rest_state(x);
        double nis = 0.0, dof = 0.0;
        std::vector<std::int32_t> id;
        for (std::size_t m = 0; m < body->num_markers(); ++m) id.push_back(body->marker_id(m));
        for (int f = 0; f < kFrames; ++f) {
            std::vector<double> force;
            const ForwardInputs inputs = test::inputs_at(c, f, force);
            body->advance(inputs, theta_true, x, 1);
            body->observe(x, z, 1);
            std::vector<double> px, py, pz;
            const std::vector<double> sigma(id.size(), c.sensor.noise_sigma_m);
            for (std::size_t m = 0; m < id.size(); ++m)
                for (std::size_t a = 0; a < 3; ++a)
                    (a == 0 ? px : a == 1 ? py : pz).push_back(z[3 * m + a] + c.sensor.noise_sigma_m * normal(random));
            estimator.step({1 + static_cast<std::int64_t>(1e6 * inputs.time_s), id, px, py, pz, sigma}, inputs);
            nis += estimator.nis();
            dof += estimator.degrees_of_freedom();
        }
        tally.observability.resize(model->num_parameters(), 0.0);
        for (std::size_t g = 0; g < model->num_parameters(); ++g) {
            const auto i = static_cast<Eigen::Index>(g);
            const double s = estimator.stated_stdev(i, estimator.covariance()(i, i)), mean = estimator.theta()(i);
            const double threshold = model->parameter(g).attachment_threshold, true_value = group_truth[g];
            const bool held = kind == Truth::kGroups || true_value >= threshold;
            const auto apart = [&](double value) { return (mean - estimator.parameters().to_filter(i, value)) / s; };
            tally.deviations.push_back(held ? std::abs(apart(true_value)) : std::max(0.0, apart(threshold)));
            tally.inside += tally.deviations.back() <= 1.96;
            ++tally.count;
            tally.observability[g] += estimator.observability()(i) / draws;
        }
        tally.independent += independent_intervals(estimator.covariance());
        tally.nis_share.push_back(nis / dof);
        tally.nis_within += nis > chi_square_quantile(0.025, dof) && nis < chi_square_quantile(0.975, dof);
        ++tally.draws;
    }
    return tally;
}

void print(const char* what, const Tally& t) {
    std::printf("| %s | %d | %.0f %% | %.2f | %d of %d |", what, t.draws, 100.0 * t.coverage(), t.mean_nis(),
                t.nis_within, t.draws);
    for (const double o : t.observability) std::printf(" %.2f", o);
    std::printf(" |\n");
}

// Share of the truths inside intervals of every stated probability; a right filter follows the diagonal.
tools::Curve calibration_curve(const std::string& label, std::vector<double> deviations) {
    std::sort(deviations.begin(), deviations.end());
    tools::Curve curve{label, {}, {}};
    for (std::size_t k = 0; k < deviations.size(); ++k) {
        curve.x.push_back(100.0 * (2.0 * normal_cdf(deviations[k]) - 1.0));
        curve.y.push_back(100.0 * static_cast<double>(k + 1) / static_cast<double>(deviations.size()));
    }
    return curve;
}

constexpr const char* kHeader =
    "| truth | draws | in the 95 %% interval | NIS/dof | NIS within its 95 %% | observability per group |\n";

// Nothing but the groups' stiffness is unknown: intervals and NIS must be right.
TEST(Consistency, IntervalsAndNisAreRightWhereTheModelIs) {
    BoundaryEstimatorOptions options;
    options.relative_model_error = options.model_error_sigma_m = 0.0;
    std::printf(kHeader);
    const Tally t = run(Truth::kGroups, BodyLaw::kStVK, options, num_draws());
    print("stiffness per group, same body", t);
    const int independent = static_cast<int>(t.independent);
    const double limit = binomial_quantile_share(0.01, independent, 0.95);  // a right filter fails once in 100 seeds
    std::printf("%d intervals, worth %d independent ones: 1 %% quantile of the share inside %.3f\n", t.count,
                independent, limit);
    EXPECT_GE(t.coverage(), limit);
    EXPECT_NEAR(t.mean_nis(), 1.0, 0.1);
}

// Strips of the atlas cut through groups, and the body follows another law: errors of the model, correlated in time.
// The service's own settings must state intervals that hold; without their two terms they do not (both printed).
TEST(Consistency, IntervalsUnderModelError) {
    const BoundaryEstimatorOptions service = *EstimatorSettings{}.options();
    BoundaryEstimatorOptions white = service;
    white.model_error_correlation_s = white.unresolved_share = 0.0;
    tools::Plot plot;
    plot.title = "Random strips: do the stated intervals hold?";
    plot.x_label = "stated probability of the interval [%]";
    plot.panels.push_back(
        {.y_label = "truth inside [%]", .curves = {{"right", {0.0, 100.0}, {0.0, 100.0}, {}, {}, true}}});
    std::printf(kHeader);
    for (const BodyLaw law : {BodyLaw::kStVK, BodyLaw::kOgden}) {
        const std::string body = law == BodyLaw::kStVK ? "strips, same body" : "strips, Ogden body";
        if (num_draws() >= 10) {
            const Tally without = run(Truth::kStrips, law, white, num_draws());
            print((body + ", white model error, groups resolved").c_str(), without);
            plot.panels[0].curves.push_back(calibration_curve(body + ", without both terms", without.deviations));
        }
        const Tally t = run(Truth::kStrips, law, service, num_draws());
        print((body + ", the service's settings").c_str(), t);
        plot.panels[0].curves.push_back(calibration_curve(body + ", the service's settings", t.deviations));
        // 90-98 % is asked for; of a share of 90 % these few draws show less than this once in 100 seeds.
        EXPECT_GE(t.coverage(), binomial_quantile_share(0.01, static_cast<int>(t.independent), 0.90));
        EXPECT_LE(t.mean_nis(), 1.5);
    }
    if (const char* file = std::getenv("TERES_CONSISTENCY_PLOT")) ASSERT_TRUE(tools::save_plot(plot, file));
}

}  // namespace
}  // namespace teres
