#include "plugins/simulation/lane_history_kernels.h"

#include <algorithm>

#include "plugins/simulation/lane_packs.h"

namespace teres {
namespace {

constexpr std::size_t kMaxPairs = 8;
constexpr std::size_t kChunk = 64;  // rows summed in single precision before they join the double sum

// sums of count vectors with q over a few rows, lanes [0, width of P)
template <class P>
inline void add_products(const float* const* v, std::size_t count, const float* q, std::size_t first, std::size_t last,
                         std::size_t stride, double* sums) {
    constexpr std::size_t kWidth = sizeof(P) / sizeof(float);
    P sum[kMaxPairs]{};
    for (std::size_t r = first; r < last; ++r) {
        const P at = load_pack<P>(q + r * stride);
        for (std::size_t k = 0; k < count; ++k) sum[k] += load_pack<P>(v[k] + r * stride) * at;
    }
    for (std::size_t k = 0; k < count; ++k)
        for (std::size_t l = 0; l < kWidth; ++l) sums[k * stride + l] += static_cast<double>(sum[k][l]);
}

template <class P>
inline void add_combination(const float* const* v, const float* c, std::size_t count, float* q, std::size_t first,
                            std::size_t last, std::size_t stride) {
    P coefficient[kMaxPairs];
    for (std::size_t k = 0; k < count; ++k) coefficient[k] = load_pack<P>(c + k * stride);
    for (std::size_t r = first; r < last; ++r) {
        P at = load_pack<P>(q + r * stride);
        for (std::size_t k = 0; k < count; ++k) at += coefficient[k] * load_pack<P>(v[k] + r * stride);
        store_pack(q + r * stride, at);
    }
}

// body(lane offset, pack) over all lanes in the widest packs
template <class Body>
inline void for_packs(std::size_t stride, const Body& body) {
    std::size_t l = 0;
    for (; l + 8 <= stride; l += 8) body(l, LanePack<float, 8>{});
    for (; l + 4 <= stride; l += 4) body(l, LanePack<float, 4>{});
}

inline void offset(const float* const* v, std::size_t count, std::size_t lane, const float** out) {
    for (std::size_t k = 0; k < count; ++k) out[k] = v[k] + lane;
}

}  // namespace

TERES_MULTIVERSION
void project(const LaneRows& rows, const float* const* v, std::size_t count, const float* q, double* sums) noexcept {
    const std::size_t stride = rows.float_stride;
    std::fill_n(sums, count * stride, 0.0);
    for (std::size_t first = rows.first; first < rows.last; first += kChunk)
        for_packs(stride, [&](std::size_t l, auto pack) {
            const float* at[kMaxPairs];
            offset(v, count, l, at);
            add_products<decltype(pack)>(at, count, q + l, first, std::min(first + kChunk, rows.last), stride,
                                         sums + l);
        });
}

TERES_MULTIVERSION
void combine(const LaneRows& rows, const float* const* v, const float* c, std::size_t count, float* q) noexcept {
    for_packs(rows.float_stride, [&](std::size_t l, auto pack) {
        const float* at[kMaxPairs];
        offset(v, count, l, at);
        add_combination<decltype(pack)>(at, c + l, count, q + l, rows.first, rows.last, rows.float_stride);
    });
}

TERES_MULTIVERSION
void gather_and_project(const LaneRows& rows, const double* g, const float* const* s, std::size_t count, float* q,
                        double* sums) noexcept {
    const std::size_t stride = rows.stride, floats = rows.float_stride;
    std::fill_n(sums, count * floats, 0.0);
    for (std::size_t first = rows.first; first < rows.last; first += kChunk) {
        const std::size_t last = std::min(first + kChunk, rows.last);
        for (std::size_t r = first; r < last; ++r) {
            const double* from = g + static_cast<std::size_t>(rows.dof[r]) * stride;
            for (std::size_t l = 0; l < stride; l += 4)
                store_pack(q + r * floats + l,
                           __builtin_convertvector((load_pack<LanePack<double, 4>>(from + l)), LanePack<float, 4>));
        }
        for_packs(floats, [&](std::size_t l, auto pack) {
            const float* at[kMaxPairs];
            offset(s, count, l, at);
            add_products<decltype(pack)>(at, count, q + l, first, last, floats, sums + l);
        });
    }
}

TERES_MULTIVERSION
void square(const LaneRows& rows, const double* g, double* sums) noexcept {
    using D = LanePack<double, 4>;
    for (std::size_t l = 0; l < rows.stride; l += 4) {
        D sum{};
        for (std::size_t r = rows.first; r < rows.last; ++r) {
            const D v = load_pack<D>(g + static_cast<std::size_t>(rows.dof[r]) * rows.stride + l);
            sum += v * v;
        }
        store_pack(sums + l, sum);
    }
}

TERES_MULTIVERSION
void take_step(const LaneRows& rows, const double* g, const double* x, const float* d, const double* step,
               double* trial, double* sums) noexcept {
    using D = LanePack<double, 4>;
    const std::size_t stride = rows.stride;
    for (std::size_t l = 0; l < stride; l += 4) {
        const D length = load_pack<D>(step + l);
        D sum{};
        for (std::size_t r = rows.first; r < rows.last; ++r) {
            const std::size_t at = static_cast<std::size_t>(rows.dof[r]) * stride + l;
            const D p = __builtin_convertvector((load_pack<LanePack<float, 4>>(d + r * rows.float_stride + l)), D);
            sum += load_pack<D>(g + at) * p;
            store_pack(trial + at, load_pack<D>(x + at) - length * p);
        }
        store_pack(sums + l, sum);
    }
}

TERES_MULTIVERSION
void record_pair(const LaneRows& rows, const double* trial, const double* trial_g, const float* d, const double* step,
                 const char* keep, double* x, double* g, float* s, float* y) noexcept {
    using D = LanePack<double, 4>;
    using F = LanePack<float, 4>;
    const std::size_t stride = rows.stride;
    for (std::size_t l = 0; l < stride; l += 4) {
        D kept{};
        for (std::size_t k = 0; k < 4; ++k) kept[k] = keep[l + k] ? 1.0 : 0.0;
        const auto chosen = kept > 0.5;
        const F length = __builtin_convertvector(load_pack<D>(step + l) * kept, F);
        for (std::size_t r = rows.first; r < rows.last; ++r) {
            const std::size_t at = static_cast<std::size_t>(rows.dof[r]) * stride + l, f = r * rows.float_stride + l;
            const D old_x = load_pack<D>(x + at), old_g = load_pack<D>(g + at);
            const D new_x = chosen ? load_pack<D>(trial + at) : old_x;
            const D new_g = chosen ? load_pack<D>(trial_g + at) : old_g;
            store_pack(s + f, -length * load_pack<F>(d + f));
            const D difference = new_g - old_g;
            store_pack(y + f, __builtin_convertvector(difference, F));
            store_pack(x + at, new_x);
            store_pack(g + at, new_g);
        }
    }
}

}  // namespace teres
