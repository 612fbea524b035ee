// The same sheet as two layers of springs (spring_fan.h), its law found by the estimator's reduced-order filter.
//
//     T(d) = theta w (g1 e + g2 e^2 + g3 e^3),  e = d / (L/2) in a layer of height L/2;  theta = E A / L   [N/m] x [m]
//
// Unknowns: ln g1, q, ln g3 and ln b/(1-b), b the share of the diagonals; g2 = (e^q - 1) sqrt(3 g1 g3), so that T rises
// everywhere. Every edge node is joined to all columns. The filter sees the edge's positions step by step while the
// load grows; it is run again from the mean found, with the prior covariance (relinearised, as an iterated filter),
// until it stays.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "plugins/simulation/spring_fan.h"
#include "tools/springs/sheet.h"

namespace teres::tools {

struct SpringLaw {
    double g1 = 1.0, g2 = 0.0, g3 = 1.0;  ///< share of E A / L, strain as argument
    double diagonal = 0.5;                ///< share of a layer's stiffness at rest in diagonals
};

class SpringSheet {
  public:
    SpringSheet(const Sheet& sheet, double youngs_modulus_pa, const SpringLaw& law);
    /// Moves the edge nodes from a state nearby to equilibrium under `load_n`. False: not reached.
    bool equilibrium(double load_n, Eigen::Matrix3Xd& x_m) const;

  private:
    double evaluate(const Eigen::Matrix3Xd& x, double load_n, Eigen::VectorXd& gradient) const;
    void tangent(const Eigen::Matrix3Xd& x, Eigen::MatrixXd& K) const;

    std::vector<SpringFan> fans_;
    Eigen::VectorXd share_;  // of load and of theta, by width
    Eigen::Matrix3Xd X_;
    double theta_ = 0.0;
};

struct CalibrationResult {
    SpringLaw law;
    Eigen::Vector4d mean, stdev;           ///< ln g1, q, ln g3, ln b/(1-b)
    std::vector<Eigen::Matrix3Xd> edge_m;  ///< of the springs, per step
    double mean_error_mm = 0.0, p95_error_mm = 0.0, max_error_mm = 0.0,
           last_error_mm = 0.0;  ///< last: mean at full load
    double seconds = 0.0;        ///< one run over all steps
    int rounds = 0;
};

/// Errors (kNotUsable): springs that find no equilibrium.
Result<CalibrationResult> calibrate(const Sheet& sheet, const SheetMaterial& material, const SheetPath& truth);

}  // namespace teres::tools
