// A further term of the total potential that acts on nodes or on pairs of nodes of one element (contact,
// ...).
#pragma once

#include <cstddef>
#include <vector>

#include "plugins/simulation/block_pattern.h"

namespace teres {

class PotentialTerm {
  public:
    virtual ~PotentialTerm() = default;
    /// [loop] Adds energy and gradient of every lane (batch layout of body.h).
    virtual void add_gradient(const double* x, double* gradient, double* energy, std::size_t stride,
                              std::size_t lanes) const noexcept = 0;
    /// [loop] Adds the tangent of one state.
    virtual void add_tangent(const Positions& x, const BlockPattern& pattern,
                             std::vector<double>& values) const noexcept = 0;
};

}  // namespace teres
