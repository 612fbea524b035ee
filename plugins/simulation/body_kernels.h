// Inner loop of the batch: forces of one set of strain points, four lanes per SIMD pack.
#pragma once

#include <cstddef>

#include "plugins/simulation/material.h"
#include "plugins/simulation/strain_points.h"

namespace teres {

/// Adds energy (one per lane) and gradient of all points; layout as in body.h.
void add_gradient_of_points(const StrainPoints& points, const Material& material, const double* x,
                            double* gradient, double* energy, std::size_t stride) noexcept;

}  // namespace teres
