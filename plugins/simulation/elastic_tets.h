// Elastic forces of a tetrahedral body as the single-state steppers (implicit_step.h, static_stvk.h) see
// them.
//
//   f_a  = -(internal force)          added to `force`               [N]
//   S_ab = -d f_a / d x_b             added to `values` (BlockPattern)  [N/m]
//
// The modulus is given per tetrahedron because forces and stiffness are proportional to it (nu is fixed): a
// filter that estimates moduli hands in other values, nothing is rebuilt.
#pragma once

#include <Eigen/Core>
#include <array>
#include <set>
#include <span>
#include <vector>

#include "core/case/case.h"
#include "plugins/simulation/block_pattern.h"

namespace teres {

class ElasticTets {
  public:
    virtual ~ElasticTets() = default;

    /// [loop] x, force: 3 per node; modulus: Young's modulus per tetrahedron [Pa].
    virtual void add_force(const Eigen::VectorXd& x, std::span<const double> modulus,
                           Eigen::VectorXd& force) const noexcept = 0;
    /// [loop] Forces and stiffness at once.
    virtual void add_force_and_stiffness(const Eigen::VectorXd& x, std::span<const double> modulus,
                                         const BlockPattern& pattern, Eigen::VectorXd& force,
                                         std::vector<double>& values) const noexcept = 0;

    std::size_t num_tets() const { return tets_.size(); }
    const std::vector<double>& volume() const { return volume_; }  ///< at rest, per tetrahedron [m^3]
    /// Adds the couplings of the mesh edges.
    void couple(std::vector<std::set<NodeIndex>>& neighbours) const;
    /// [setup] Fixes where each element's blocks go.
    void bind(const BlockPattern& pattern);

  protected:
    /// Block of the vertex pair (i, j), i <= j, of tetrahedron e in the pattern given to bind().
    std::int32_t block(std::size_t e, int i, int j) const {
        static constexpr std::array<std::array<int, 4>, 4> kPair{
            {{0, 1, 2, 3}, {1, 4, 5, 6}, {2, 5, 7, 8}, {3, 6, 8, 9}}};
        return blocks_[10 * e +
                       static_cast<std::size_t>(kPair[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)])];
    }

    std::vector<std::array<NodeIndex, 4>> tets_;
    std::vector<double> volume_;

  private:
    std::vector<std::int32_t> blocks_;  // ten per tetrahedron
};

/// Lumped mass of every node [kg]: each tetrahedron gives rho V / 4 to its vertices.
Eigen::VectorXd mass_from_density(const TetMeshData& mesh, double density_kg_m3);

}  // namespace teres
