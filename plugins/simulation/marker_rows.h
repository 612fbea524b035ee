// Derivatives of what is observed and predicted by the positions of the free nodes, transposed: H^T.
#pragma once

#include <Eigen/Dense>

#include "plugins/simulation/case_model.h"

namespace teres {

/// Markers of the case at nodal positions x (3 per node): free rows of the pattern x 3 M.
Eigen::MatrixXd marker_rows(const CaseModel& model, const double* x);
/// Validation points, which are linear in the nodes: free rows x 3 P.
Eigen::MatrixXd point_rows(const CaseModel& model);

}  // namespace teres
