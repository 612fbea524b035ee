#include "plugins/simulation/metric_kernels.h"

#include <type_traits>

#include "plugins/simulation/lane_packs.h"

namespace teres {
namespace {

using Panel = MetricSolver::Panel;

// kCount packs side by side. A wider pack than the machine's registers would be split by the compiler, in memory.
template <class P, int kCount>
struct Lanes {
    P part[kCount];
};

template <class P, int kCount>
inline Lanes<P, kCount> load_lanes(const float* from) {
    constexpr std::size_t kEach = sizeof(P) / sizeof(float);
    Lanes<P, kCount> v;
    for (int c = 0; c < kCount; ++c) v.part[c] = load_pack<P>(from + static_cast<std::size_t>(c) * kEach);
    return v;
}
template <class P, int kCount>
inline void store_lanes(float* to, const Lanes<P, kCount>& v) {
    constexpr std::size_t kEach = sizeof(P) / sizeof(float);
    for (int c = 0; c < kCount; ++c) store_pack(to + static_cast<std::size_t>(c) * kEach, v.part[c]);
}
template <class P, int kCount>
inline void subtract_scaled(Lanes<P, kCount>& from, float factor, const Lanes<P, kCount>& v) {
    for (int c = 0; c < kCount; ++c) from.part[c] -= factor * v.part[c];
}
template <class P, int kCount>
inline Lanes<P, kCount> scaled(float factor, Lanes<P, kCount> v) {
    for (int c = 0; c < kCount; ++c) v.part[c] *= factor;
    return v;
}

// Triangle: row j of the panel holds L(j, 0..j-1) and 1 / L(j, j).
template <int kWidth, class P, int kCount>
inline void lower(const Panel& p, const std::int32_t* rows, const float* values, float* y, std::size_t stride) {
    Lanes<P, kCount> x[kWidth];
    float* own = y + static_cast<std::size_t>(p.first_row) * stride;
    const float* L = values + p.triangle;
    for (int j = 0; j < kWidth; ++j) {
        auto v = load_lanes<P, kCount>(own + static_cast<std::size_t>(j) * stride);
        for (int i = 0; i < j; ++i) subtract_scaled(v, L[j * kWidth + i], x[i]);
        x[j] = scaled(L[j * kWidth + j], v);
        store_lanes(own + static_cast<std::size_t>(j) * stride, x[j]);
    }
    const float* B = values + p.rectangle;
    const std::int32_t* below = rows + p.below;
    for (int r = 0; r < p.num_below; ++r, B += kWidth) {
        float* at = y + static_cast<std::size_t>(below[r]) * stride;
        auto even = load_lanes<P, kCount>(at);
        Lanes<P, kCount> odd{};
        for (int j = 0; j < kWidth; ++j) subtract_scaled(j % 2 == 0 ? even : odd, B[j], x[j]);
        for (int c = 0; c < kCount; ++c) even.part[c] += odd.part[c];
        store_lanes(at, even);
    }
}

// So many columns at a time that their sums fit the registers.
template <int kWidth, class P, int kCount>
inline void upper(const Panel& p, const std::int32_t* rows, const float* values, float* y, std::size_t stride) {
    constexpr int kPart = kWidth * kCount > 12 ? kWidth / 2 : kWidth;
    Lanes<P, kCount> x[kWidth];
    const std::int32_t* below = rows + p.below;
    for (int first = 0; first < kWidth; first += kPart) {
        Lanes<P, kCount> sum[kPart]{};
        const float* B = values + p.rectangle + first;
        for (int r = 0; r < p.num_below; ++r, B += kWidth) {
            const auto v = load_lanes<P, kCount>(y + static_cast<std::size_t>(below[r]) * stride);
            for (int j = 0; j < kPart; ++j) subtract_scaled(sum[j], B[j], v);
        }
        for (int j = 0; j < kPart; ++j) x[first + j] = sum[j];
    }
    float* own = y + static_cast<std::size_t>(p.first_row) * stride;
    const float* L = values + p.triangle;
    for (int j = kWidth - 1; j >= 0; --j) {
        auto v = load_lanes<P, kCount>(own + static_cast<std::size_t>(j) * stride);
        for (int c = 0; c < kCount; ++c) v.part[c] += x[j].part[c];
        for (int i = j + 1; i < kWidth; ++i) subtract_scaled(v, L[i * kWidth + j], x[i]);
        x[j] = scaled(L[j * kWidth + j], v);
        store_lanes(own + static_cast<std::size_t>(j) * stride, x[j]);
    }
}

// One lane alone: the columns of a panel take the place of lanes.
using Quad = LanePack<float, 4>;

// The sums of the entries of each of four packs.
inline Quad sums(const Quad& a, const Quad& b, const Quad& c, const Quad& d) {
    const Quad ab = __builtin_shufflevector(a, b, 0, 4, 1, 5) + __builtin_shufflevector(a, b, 2, 6, 3, 7);
    const Quad cd = __builtin_shufflevector(c, d, 0, 4, 1, 5) + __builtin_shufflevector(c, d, 2, 6, 3, 7);
    return __builtin_shufflevector(ab, cd, 0, 1, 4, 5) + __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
}

template <int kWidth>
inline void lower_one(const Panel& p, const std::int32_t* rows, const float* values, float* y, std::size_t stride) {
    constexpr int kQuads = kWidth / 4;
    float x[kWidth];
    float* own = y + static_cast<std::size_t>(p.first_row) * stride;
    const float* L = values + p.triangle;
    for (int j = 0; j < kWidth; ++j) {
        float v = own[static_cast<std::size_t>(j) * stride];
        for (int i = 0; i < j; ++i) v -= L[j * kWidth + i] * x[i];
        own[static_cast<std::size_t>(j) * stride] = x[j] = v * L[j * kWidth + j];
    }
    Quad of_x[kQuads > 0 ? kQuads : 1];
    for (int q = 0; q < kQuads; ++q) of_x[q] = load_pack<Quad>(x + 4 * q);
    const float* B = values + p.rectangle;
    const std::int32_t* below = rows + p.below;
    const auto at = [&](int r) -> float& { return y[static_cast<std::size_t>(below[r]) * stride]; };
    const auto rest = [&](const float* row) {
        float sum = 0.0f;
        for (int j = 4 * kQuads; j < kWidth; ++j) sum += row[j] * x[j];
        return sum;
    };
    int r = 0;
    if constexpr (kQuads > 0)
        for (; r + 4 <= p.num_below; r += 4, B += 4 * kWidth) {
            Quad product[4];
            for (int k = 0; k < 4; ++k) {
                product[k] = load_pack<Quad>(B + k * kWidth) * of_x[0];
                for (int q = 1; q < kQuads; ++q) product[k] += load_pack<Quad>(B + k * kWidth + 4 * q) * of_x[q];
            }
            const Quad sum = sums(product[0], product[1], product[2], product[3]);
            for (int k = 0; k < 4; ++k) at(r + k) -= sum[k] + rest(B + k * kWidth);
        }
    for (; r < p.num_below; ++r, B += kWidth) {
        float sum = rest(B);
        for (int j = 0; j < 4 * kQuads; ++j) sum += B[j] * x[j];
        at(r) -= sum;
    }
}

template <int kWidth>
inline void upper_one(const Panel& p, const std::int32_t* rows, const float* values, float* y, std::size_t stride) {
    constexpr int kQuads = kWidth / 4;
    Quad even[kQuads > 0 ? kQuads : 1]{}, odd[kQuads > 0 ? kQuads : 1]{};
    float x[kWidth]{};
    const float* B = values + p.rectangle;
    const std::int32_t* below = rows + p.below;
    const auto take = [&](Quad* sum, float v) {
        for (int q = 0; q < kQuads; ++q) sum[q] -= load_pack<Quad>(B + 4 * q) * v;
        for (int j = 4 * kQuads; j < kWidth; ++j) x[j] -= B[j] * v;
        B += kWidth;
    };
    int r = 0;
    for (; r + 2 <= p.num_below; r += 2) {
        take(even, y[static_cast<std::size_t>(below[r]) * stride]);
        take(odd, y[static_cast<std::size_t>(below[r + 1]) * stride]);
    }
    if (r < p.num_below) take(even, y[static_cast<std::size_t>(below[r]) * stride]);
    for (int q = 0; q < kQuads; ++q) {
        even[q] += odd[q];
        store_pack(x + 4 * q, even[q]);
    }
    float* own = y + static_cast<std::size_t>(p.first_row) * stride;
    const float* L = values + p.triangle;
    for (int j = kWidth - 1; j >= 0; --j) {
        float v = own[static_cast<std::size_t>(j) * stride] + x[j];
        for (int i = j + 1; i < kWidth; ++i) v -= L[i * kWidth + j] * x[i];
        own[static_cast<std::size_t>(j) * stride] = x[j] = v * L[j * kWidth + j];
    }
}

template <class Work>
inline void with_width(std::int32_t width, const Work& work) {
    switch (width) {
        case 12:
            return work(std::integral_constant<int, 12>{});
        case 6:
            return work(std::integral_constant<int, 6>{});
        case 3:
            return work(std::integral_constant<int, 3>{});
        default:
            return work(std::integral_constant<int, 1>{});
    }
}

// P: a pack of lanes, kCount of them side by side; or float for one lane alone.
template <class P, int kCount = 1>
inline void lower_all(const std::vector<Panel>& panels, const std::int32_t* rows, const float* values, float* y,
                      std::size_t stride) {
    for (const auto& p : panels)
        with_width(p.width, [&](auto width) {
            if constexpr (std::is_same_v<P, float>)
                lower_one<width()>(p, rows, values, y, stride);
            else
                lower<width(), P, kCount>(p, rows, values, y, stride);
        });
}

template <class P, int kCount = 1>
inline void upper_all(const std::vector<Panel>& panels, const std::int32_t* rows, const float* values, float* y,
                      std::size_t stride) {
    for (std::size_t k = panels.size(); k-- > 0;)
        with_width(panels[k].width, [&](auto width) {
            if constexpr (std::is_same_v<P, float>)
                upper_one<width()>(panels[k], rows, values, y, stride);
            else
                upper<width(), P, kCount>(panels[k], rows, values, y, stride);
        });
}

template <class P>
inline void subtract(const float* W, const float* c, float* y, std::size_t first, std::size_t last, std::size_t modes,
                     std::size_t W_stride, std::size_t stride) {
    for (std::size_t r = first; r < last; ++r) {
        const float* w = W + r * W_stride;
        P even = load_pack<P>(y + r * stride), odd{};
        std::size_t m = 0;
        for (; m + 1 < modes; m += 2) {
            even -= w[m] * load_pack<P>(c + m * stride);
            odd -= w[m + 1] * load_pack<P>(c + (m + 1) * stride);
        }
        if (m < modes) even -= w[m] * load_pack<P>(c + m * stride);
        store_pack(y + r * stride, even + odd);
    }
}

}  // namespace

TERES_MULTIVERSION
void solve_lower(const std::vector<Panel>& panels, const std::int32_t* rows, const float* values, float* y,
                 std::size_t stride, std::size_t first_lane, std::size_t lanes) noexcept {
    if (lanes == 1) return lower_all<float>(panels, rows, values, y + first_lane, stride);
    std::size_t l = first_lane;
    const std::size_t last = first_lane + lanes;
    for (; l + 16 <= last; l += 16) lower_all<LanePack<float, 8>, 2>(panels, rows, values, y + l, stride);
    for (; l + 8 <= last; l += 8) lower_all<LanePack<float, 8>>(panels, rows, values, y + l, stride);
    for (; l + 4 <= last; l += 4) lower_all<LanePack<float, 4>>(panels, rows, values, y + l, stride);
}

TERES_MULTIVERSION
void solve_upper(const std::vector<Panel>& panels, const std::int32_t* rows, const float* values, float* y,
                 std::size_t stride, std::size_t first_lane, std::size_t lanes) noexcept {
    if (lanes == 1) return upper_all<float>(panels, rows, values, y + first_lane, stride);
    std::size_t l = first_lane;
    const std::size_t last = first_lane + lanes;
    for (; l + 16 <= last; l += 16) upper_all<LanePack<float, 8>, 2>(panels, rows, values, y + l, stride);
    for (; l + 8 <= last; l += 8) upper_all<LanePack<float, 8>>(panels, rows, values, y + l, stride);
    for (; l + 4 <= last; l += 4) upper_all<LanePack<float, 4>>(panels, rows, values, y + l, stride);
}

TERES_MULTIVERSION
void subtract_product(const float* W, const float* c, float* y, std::size_t first, std::size_t last, std::size_t modes,
                      std::size_t W_stride, std::size_t stride) noexcept {
    std::size_t l = 0;
    for (; l + 8 <= stride; l += 8) subtract<LanePack<float, 8>>(W, c + l, y + l, first, last, modes, W_stride, stride);
    for (; l + 4 <= stride; l += 4) subtract<LanePack<float, 4>>(W, c + l, y + l, first, last, modes, W_stride, stride);
}

}  // namespace teres
