// Sparse Cholesky factorisation K = L L^T behind a small interface (CHOLMOD inside; a permissive one can
// replace it).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "plugins/simulation/block_pattern.h"

namespace teres {

/// The factor as CHOLMOD keeps it: supernode s has columns column[s] .. column[s+1]; its rows are
/// row[row_start[s]..] (its own columns first); values are column-major from value_start[s]. permutation[k]:
/// row of K at position k.
struct SupernodalFactor {
    std::int32_t num_supernodes = 0;
    const std::int32_t *column = nullptr, *row_start = nullptr, *value_start = nullptr, *row = nullptr,
                       *permutation = nullptr;
    const double* values = nullptr;  ///< null before the first factorisation
};

class Cholesky {
  public:
    /// [setup] Orders the pattern (nested dissection or minimum degree, whichever fills less). Keeps a
    /// reference to it.
    explicit Cholesky(const BlockPattern& pattern);
    ~Cholesky();
    /// [setup] Order and factor of another of the same pattern.
    Cholesky(const Cholesky& other);
    Cholesky& operator=(const Cholesky&) = delete;

    /// [loop] False if the matrix is not positive definite; then solve() must not be called.
    bool factorise(const std::vector<double>& values) noexcept;
    /// [loop] An indefinite matrix (compressed StVK, slack supports) is shifted along its diagonal, in place, until it
    /// is positive definite: by first_share of the mean diagonal, then ten times as much, ... False beyond the mean.
    bool factorise_shifted(std::vector<double>& values, int& factorisations, double first_share = 1e-6) noexcept;
    bool factorised() const;
    /// [loop] Solves K Y = B for all columns in place; B is num_rows() x k, column-major.
    void solve(Eigen::Ref<Eigen::MatrixXd> B) noexcept;

    double factor_nonzeros() const;
    SupernodalFactor supernodes() const;

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace teres
