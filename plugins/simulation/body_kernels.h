// Inner loop of the batch: forces of strain points, four lanes per SIMD pack.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "plugins/simulation/material.h"
#include "plugins/simulation/strain_points.h"

namespace teres {

/// Points [0, count) of a set, by number, and the row each of their node entries is added to
/// (point_shares.h).
struct PointRows {
    const std::int32_t* point;
    std::size_t count;
    const std::int32_t* row;
};

/// Adds energy (one per lane) and gradient of the points named, of all `sets`: their points have the same nodes and
/// dN/dX. Layout as in body.h. Lanes from `lanes` on need not count.
void add_gradient_of_points(std::span<const StrainPoints* const> sets, const PointRows& rows, const Material& material,
                            const double* x, double* gradient, double* spare, double* energy, std::size_t stride,
                            std::size_t lanes) noexcept;

}  // namespace teres
