#include "plugins/simulation/cholesky.h"

#include <cholmod.h>
#include <dlfcn.h>
#include <omp.h>

#include <algorithm>
#include <cmath>
#include <mutex>

#include "core/check.h"

namespace teres {

struct Cholesky::Impl {
    const BlockPattern& pattern;
    cholmod_common common{};
    cholmod_factor* factor = nullptr;
    cholmod_dense* X = nullptr;  // workspaces that CHOLMOD reuses between solves
    cholmod_dense* Y = nullptr;
    cholmod_dense* E = nullptr;
    bool ready = false;

    explicit Impl(const BlockPattern& p) : pattern(p) {
        cholmod_start(&common);
        common.print = 0;
        common.supernodal = CHOLMOD_SUPERNODAL;
        common.nmethods = 0;  // try the user's, AMD and METIS orderings, keep the best
        common.error_handler = nullptr;
    }
    ~Impl() {
        cholmod_free_dense(&X, &common);
        cholmod_free_dense(&Y, &common);
        cholmod_free_dense(&E, &common);
        cholmod_free_factor(&factor, &common);
        cholmod_finish(&common);
    }

    cholmod_sparse view(const double* values) const {
        cholmod_sparse A{};
        const auto n = static_cast<std::size_t>(pattern.num_rows());
        A.nrow = n;
        A.ncol = n;
        A.nzmax = pattern.num_values();
        A.p = const_cast<std::int32_t*>(pattern.column_start().data());
        A.i = const_cast<std::int32_t*>(pattern.row().data());
        A.x = const_cast<double*>(values);
        A.stype = -1;  // lower triangle stored
        A.itype = CHOLMOD_INT;
        A.xtype = values != nullptr ? CHOLMOD_REAL : CHOLMOD_PATTERN;
        A.dtype = CHOLMOD_DOUBLE;
        A.sorted = 1;
        A.packed = 1;
        return A;
    }
};

Cholesky::Cholesky(const BlockPattern& pattern) : impl_(std::make_unique<Impl>(pattern)) {
    cholmod_sparse A = impl_->view(nullptr);
    impl_->factor = cholmod_analyze(&A, &impl_->common);
    TERES_CHECK(impl_->factor != nullptr);
}

Cholesky::Cholesky(const Cholesky& other) : impl_(std::make_unique<Impl>(other.impl_->pattern)) {
    impl_->factor = cholmod_copy_factor(other.impl_->factor, &impl_->common);
    TERES_CHECK(impl_->factor != nullptr);
    impl_->common.lnz = other.impl_->common.lnz;
    impl_->ready = other.impl_->ready;
}

Cholesky::~Cholesky() = default;

namespace {

// What CHOLMOD calls. OpenBLAS has threads of its own (a setting of the program); Debian's libopenblas0-serial has no
// locks either: two threads that factorise at once would write to the same buffers.
struct Blas {
    bool locks = true;
    std::mutex one_at_a_time;

    Blas() {
        void* library = dlopen("libopenblas.so.0", RTLD_NOLOAD | RTLD_LAZY);
        if (library == nullptr) return;
        if (void* set = dlsym(library, "openblas_set_num_threads")) reinterpret_cast<void (*)(int)>(set)(1);
        if (void* parallel = dlsym(library, "openblas_get_parallel"))
            locks = reinterpret_cast<int (*)()>(parallel)() != 0;
    }
};

// CHOLMOD opens OpenMP teams of four threads that spin when they are done: they cost other threads of the service more
// than they save. With no active level allowed it works on the calling thread (the setting belongs to each thread).
[[nodiscard]] std::unique_lock<std::mutex> enter_blas() {
    static Blas blas;
    omp_set_max_active_levels(0);
    return blas.locks ? std::unique_lock<std::mutex>() : std::unique_lock(blas.one_at_a_time);
}

}  // namespace

bool Cholesky::factorise(const std::vector<double>& values) noexcept {
    const auto lock = enter_blas();
    TERES_CHECK(values.size() == impl_->pattern.num_values());
    cholmod_sparse A = impl_->view(values.data());
    const int ok = cholmod_factorize(&A, impl_->factor, &impl_->common);
    impl_->ready = ok != 0 && impl_->common.status == CHOLMOD_OK && impl_->factor->minor == impl_->factor->n;
    return impl_->ready;
}

bool Cholesky::factorise_shifted(std::vector<double>& values, int& factorisations, double first_share) noexcept {
    const auto& start = impl_->pattern.column_start();
    const auto rows = static_cast<std::size_t>(impl_->pattern.num_rows());
    double mean = 0.0;
    for (std::size_t j = 0; j < rows; ++j) mean += std::abs(values[static_cast<std::size_t>(start[j])]);
    mean /= static_cast<double>(std::max<std::size_t>(1, rows));
    for (double shift = 0.0; shift < mean; shift = shift == 0.0 ? first_share * mean : 10.0 * shift) {
        for (std::size_t j = 0; j < rows && shift > 0.0; ++j) values[static_cast<std::size_t>(start[j])] += shift;
        ++factorisations;
        if (factorise(values)) return true;
    }
    return false;
}

bool Cholesky::factorised() const {
    return impl_->ready;
}

void Cholesky::solve(Eigen::Ref<Eigen::MatrixXd> B) noexcept {
    const auto lock = enter_blas();
    TERES_CHECK(impl_->ready && B.rows() == impl_->pattern.num_rows());
    cholmod_dense b{};
    b.nrow = static_cast<std::size_t>(B.rows());
    b.ncol = static_cast<std::size_t>(B.cols());
    b.d = static_cast<std::size_t>(B.outerStride());
    b.nzmax = b.d * b.ncol;
    b.x = B.data();
    b.xtype = CHOLMOD_REAL;
    b.dtype = CHOLMOD_DOUBLE;
    const int ok =
        cholmod_solve2(CHOLMOD_A, impl_->factor, &b, nullptr, &impl_->X, nullptr, &impl_->Y, &impl_->E, &impl_->common);
    TERES_CHECK(ok != 0);
    B = Eigen::Map<const Eigen::MatrixXd>(static_cast<const double*>(impl_->X->x), B.rows(), B.cols());
}

SupernodalFactor Cholesky::supernodes() const {
    const auto& L = *impl_->factor;
    const auto ints = [](const void* p) { return static_cast<const std::int32_t*>(p); };
    return {static_cast<std::int32_t>(L.nsuper),
            ints(L.super),
            ints(L.pi),
            ints(L.px),
            ints(L.s),
            ints(L.Perm),
            impl_->ready ? static_cast<const double*>(L.x) : nullptr};
}

double Cholesky::factor_nonzeros() const {
    return impl_->common.lnz;
}

}  // namespace teres
