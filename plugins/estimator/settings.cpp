#include "plugins/estimator/settings.h"

namespace teres {

Result<BoundaryEstimatorOptions> EstimatorSettings::options() const {
    BoundaryEstimatorOptions o;
    o.reduced_order = filter == "roukf";
    o.sigma_points = sigma_points == "star" ? SigmaPointKind::kStar : SigmaPointKind::kSimplex;
    o.sigma_spread = sigma_spread;
    TERES_TRY_ASSIGN(o.transform, parse_transform(transform));
    o.walk.noise_per_sqrt_s = process_noise_per_sqrt_s;
    o.walk.forgetting_time_s = forgetting_time_s;
    o.walk.reinflation = reinflation;
    o.monitor.ratio = reinflation_ratio;
    o.gate = {gate_probability, max_gated_share};
    o.default_marker_sigma_m = default_marker_sigma_m;
    o.relative_model_error = relative_model_error;
    o.model_error_sigma_m = model_error_sigma_m;
    o.model_error_correlation_s = model_error_correlation_s;
    o.unresolved_share = unresolved_share;
    o.accepted_residual = accepted_residual;
    return o;
}

}  // namespace teres
