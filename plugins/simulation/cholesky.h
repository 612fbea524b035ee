// Sparse Cholesky factorisation K = L L^T behind a small interface (CHOLMOD inside; a permissive one can
// replace it).
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "plugins/simulation/block_pattern.h"

namespace teres {

class Cholesky {
  public:
    /// [setup] Orders the pattern (nested dissection or minimum degree, whichever fills less). Keeps a
    /// reference to it.
    explicit Cholesky(const BlockPattern& pattern);
    ~Cholesky();
    Cholesky(const Cholesky&) = delete;
    Cholesky& operator=(const Cholesky&) = delete;

    /// [loop] False if the matrix is not positive definite; then solve() must not be called.
    bool factorise(const std::vector<double>& values) noexcept;
    bool factorised() const;
    /// [loop] Solves K Y = B for all columns in place; B is num_rows() x k, column-major.
    void solve(Eigen::Ref<Eigen::MatrixXd> B) noexcept;

    double factor_nonzeros() const;

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace teres
