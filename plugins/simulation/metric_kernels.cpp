#include "plugins/simulation/metric_kernels.h"

#include "plugins/simulation/lane_packs.h"

namespace teres {
namespace {

using Panel = MetricSolver::Panel;

// Triangle: row j of the panel holds L(j, 0..j-1) and 1 / L(j, j).
template <int kWidth, class P>
inline void lower(const Panel& p, const std::int32_t* rows, const float* values, float* y, std::size_t stride) {
    P x[kWidth];
    float* own = y + static_cast<std::size_t>(p.first_row) * stride;
    const float* L = values + p.triangle;
    for (int j = 0; j < kWidth; ++j) {
        P v = load_pack<P>(own + static_cast<std::size_t>(j) * stride);
        for (int i = 0; i < j; ++i) v -= L[j * kWidth + i] * x[i];
        x[j] = v * L[j * kWidth + j];
        store_pack(own + static_cast<std::size_t>(j) * stride, x[j]);
    }
    const float* B = values + p.rectangle;
    const std::int32_t* below = rows + p.below;
    for (int r = 0; r < p.num_below; ++r, B += kWidth) {
        float* at = y + static_cast<std::size_t>(below[r]) * stride;
        P even = load_pack<P>(at), odd{};
        for (int j = 0; j < kWidth; ++j) (j % 2 == 0 ? even : odd) -= B[j] * x[j];
        store_pack(at, even + odd);
    }
}

template <int kWidth, class P>
inline void upper(const Panel& p, const std::int32_t* rows, const float* values, float* y, std::size_t stride) {
    P x[kWidth]{};
    const float* B = values + p.rectangle;
    const std::int32_t* below = rows + p.below;
    for (int r = 0; r < p.num_below; ++r, B += kWidth) {
        const P v = load_pack<P>(y + static_cast<std::size_t>(below[r]) * stride);
        for (int j = 0; j < kWidth; ++j) x[j] -= B[j] * v;
    }
    float* own = y + static_cast<std::size_t>(p.first_row) * stride;
    const float* L = values + p.triangle;
    for (int j = kWidth - 1; j >= 0; --j) {
        P v = load_pack<P>(own + static_cast<std::size_t>(j) * stride) + x[j];
        for (int i = j + 1; i < kWidth; ++i) v -= L[i * kWidth + j] * x[i];
        x[j] = v * L[j * kWidth + j];
        store_pack(own + static_cast<std::size_t>(j) * stride, x[j]);
    }
}

template <class P>
inline void lower_all(const std::vector<Panel>& panels, const std::int32_t* rows, const float* values, float* y,
                      std::size_t stride) {
    for (const auto& p : panels) {
        switch (p.width) {
            case 12:
                lower<12, P>(p, rows, values, y, stride);
                break;
            case 6:
                lower<6, P>(p, rows, values, y, stride);
                break;
            case 3:
                lower<3, P>(p, rows, values, y, stride);
                break;
            default:
                lower<1, P>(p, rows, values, y, stride);
                break;
        }
    }
}

template <class P>
inline void upper_all(const std::vector<Panel>& panels, const std::int32_t* rows, const float* values, float* y,
                      std::size_t stride) {
    for (std::size_t k = panels.size(); k-- > 0;) {
        const auto& p = panels[k];
        switch (p.width) {
            case 12:
                upper<12, P>(p, rows, values, y, stride);
                break;
            case 6:
                upper<6, P>(p, rows, values, y, stride);
                break;
            case 3:
                upper<3, P>(p, rows, values, y, stride);
                break;
            default:
                upper<1, P>(p, rows, values, y, stride);
                break;
        }
    }
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
    std::size_t l = first_lane;
    const std::size_t last = first_lane + lanes;
    for (; l + 16 <= last; l += 16) lower_all<LanePack<float, 16>>(panels, rows, values, y + l, stride);
    for (; l + 8 <= last; l += 8) lower_all<LanePack<float, 8>>(panels, rows, values, y + l, stride);
    for (; l + 4 <= last; l += 4) lower_all<LanePack<float, 4>>(panels, rows, values, y + l, stride);
}

TERES_MULTIVERSION
void solve_upper(const std::vector<Panel>& panels, const std::int32_t* rows, const float* values, float* y,
                 std::size_t stride, std::size_t first_lane, std::size_t lanes) noexcept {
    std::size_t l = first_lane;
    const std::size_t last = first_lane + lanes;
    for (; l + 16 <= last; l += 16) upper_all<LanePack<float, 16>>(panels, rows, values, y + l, stride);
    for (; l + 8 <= last; l += 8) upper_all<LanePack<float, 8>>(panels, rows, values, y + l, stride);
    for (; l + 4 <= last; l += 4) upper_all<LanePack<float, 4>>(panels, rows, values, y + l, stride);
}

TERES_MULTIVERSION
void subtract_product(const float* W, const float* c, float* y, std::size_t first, std::size_t last, std::size_t modes,
                      std::size_t W_stride, std::size_t stride) noexcept {
    std::size_t l = 0;
    for (; l + 16 <= stride; l += 16)
        subtract<LanePack<float, 16>>(W, c + l, y + l, first, last, modes, W_stride, stride);
    for (; l + 8 <= stride; l += 8) subtract<LanePack<float, 8>>(W, c + l, y + l, first, last, modes, W_stride, stride);
    for (; l + 4 <= stride; l += 4) subtract<LanePack<float, 4>>(W, c + l, y + l, first, last, modes, W_stride, stride);
}

}  // namespace teres
