#include "plugins/simulation/metric_solver.h"

#include <algorithm>
#include <numeric>

#include "core/check.h"
#include "plugins/simulation/metric_kernels.h"

namespace teres {
namespace {

constexpr std::int32_t kTop = -1;

// Which thread owns each supernode: disjoint subtrees of about equal work, kTop for what stands above them.
std::vector<std::int32_t> split_tree(const SupernodalFactor& f, int threads) {
    const auto n = static_cast<std::size_t>(f.num_supernodes);
    std::vector<std::int32_t> owner(n, 0);
    if (threads == 1) return owner;
    std::vector<std::int32_t> parent(n, -1), of_column(n > 0 ? static_cast<std::size_t>(f.column[n]) : 0);
    std::vector<double> work(n), subtree(n);
    std::vector<std::vector<std::size_t>> children(n);
    for (std::size_t s = 0; s < n; ++s)
        std::fill(of_column.begin() + f.column[s], of_column.begin() + f.column[s + 1], static_cast<std::int32_t>(s));
    for (std::size_t s = 0; s < n; ++s) {
        const auto columns = f.column[s + 1] - f.column[s], rows = f.row_start[s + 1] - f.row_start[s];
        work[s] = columns * (rows - 0.5 * columns) + 64.0;
        if (rows > columns) {
            parent[s] = of_column[static_cast<std::size_t>(f.row[f.row_start[s] + columns])];
            children[static_cast<std::size_t>(parent[s])].push_back(s);
        }
    }
    std::vector<std::size_t> roots;
    for (std::size_t s = 0; s < n; ++s) {  // children come before parents
        subtree[s] = work[s];
        for (const auto c : children[s]) subtree[s] += subtree[c];
        if (parent[s] < 0) roots.push_back(s);
    }
    // Move the heaviest subtree's root to the top until splitting further does not pay.
    const auto heavier = [&](std::size_t a, std::size_t b) {
        return subtree[a] != subtree[b] ? subtree[a] > subtree[b] : a < b;
    };
    double top = 0.0, best_cost = 1e300;
    std::vector<std::size_t> best_roots;
    for (int expansions = 0; expansions < 200 && !roots.empty(); ++expansions) {
        std::sort(roots.begin(), roots.end(), heavier);
        std::vector<double> load(static_cast<std::size_t>(threads), 0.0);
        for (const auto r : roots) *std::min_element(load.begin(), load.end()) += subtree[r];
        const double cost = top + *std::max_element(load.begin(), load.end());
        if (cost < best_cost) best_cost = cost, best_roots = roots;
        const auto heaviest = roots.front();
        if (children[heaviest].empty()) break;
        top += work[heaviest];
        roots.erase(roots.begin());
        roots.insert(roots.end(), children[heaviest].begin(), children[heaviest].end());
    }
    std::fill(owner.begin(), owner.end(), kTop);
    std::vector<double> load(static_cast<std::size_t>(threads), 0.0);
    for (const auto r : best_roots) {
        const auto lightest = std::min_element(load.begin(), load.end());
        *lightest += subtree[r];
        owner[r] = static_cast<std::int32_t>(lightest - load.begin());
    }
    for (std::size_t s = n; s-- > 0;)
        if (owner[s] == kTop && parent[s] >= 0) owner[s] = owner[static_cast<std::size_t>(parent[s])];
    return owner;
}

}  // namespace

MetricSolver::MetricSolver(const Cholesky& cholesky, int threads) : shares_(static_cast<std::size_t>(threads)) {
    const SupernodalFactor f = cholesky.supernodes();
    const auto owner = split_tree(f, threads);
    const auto columns = static_cast<std::size_t>(f.column[f.num_supernodes]);
    // Rows in the order: shares of the threads, then the top.
    std::vector<std::int32_t> storage(columns);
    free_row_.reserve(columns);
    for (int group = 0; group <= threads; ++group) {
        if (group == threads) top_first_ = free_row_.size();
        for (std::int32_t s = 0; s < f.num_supernodes; ++s)
            if (owner[static_cast<std::size_t>(s)] == (group == threads ? kTop : group))
                for (auto c = f.column[s]; c < f.column[s + 1]; ++c) {
                    storage[static_cast<std::size_t>(c)] = static_cast<std::int32_t>(free_row_.size());
                    free_row_.push_back(f.permutation[c]);
                }
    }
    top_rows_ = columns - top_first_;
    storage_rows_ = columns + (static_cast<std::size_t>(threads) - 1) * top_rows_;
    std::size_t num_values = 0;
    for (std::int32_t s = 0; s < f.num_supernodes; ++s) {
        const auto group = owner[static_cast<std::size_t>(s)];
        auto& panels = (group == kTop ? top_ : shares_[static_cast<std::size_t>(group)]).panels;
        const auto offset = group == kTop ? 0 : group * static_cast<std::int32_t>(top_rows_);
        const auto width = f.column[s + 1] - f.column[s], rows = f.row_start[s + 1] - f.row_start[s];
        for (std::int32_t j = 0; j < width;) {
            const auto left = width - j;
            Panel p;
            p.width = left >= 12 ? 12 : left >= 6 ? 6 : left >= 3 ? 3 : 1;
            p.first_row = storage[static_cast<std::size_t>(f.column[s] + j)];
            p.num_below = rows - j - p.width;
            p.below = rows_.size();
            for (auto r = j + p.width; r < rows; ++r) {
                const auto row = storage[static_cast<std::size_t>(f.row[f.row_start[s] + r])];
                rows_.push_back(static_cast<std::size_t>(row) >= top_first_ ? row + offset : row);
            }
            p.triangle = num_values;
            p.rectangle = num_values + static_cast<std::size_t>(p.width * p.width);
            num_values = p.rectangle + static_cast<std::size_t>(p.width) * static_cast<std::size_t>(p.num_below);
            p.source = static_cast<std::size_t>(f.value_start[s]) +
                       static_cast<std::size_t>(j) * static_cast<std::size_t>(rows + 1);
            p.leading = rows;
            panels.push_back(p);
            j += p.width;
        }
    }
    values_.assign(num_values, 0.0f);
}

void MetricSolver::renew(const Cholesky& cholesky) noexcept {
    const double* from = cholesky.supernodes().values;
    const auto take = [&](const Panel& p) {
        const double* source = from + p.source;
        const auto at = [&](int row, int column) {
            return source[static_cast<std::size_t>(column) * static_cast<std::size_t>(p.leading) +
                          static_cast<std::size_t>(row)];
        };
        float* triangle = &values_[p.triangle];
        for (int j = 0; j < p.width; ++j)
            for (int i = 0; i <= j; ++i)
                triangle[j * p.width + i] = static_cast<float>(i == j ? 1.0 / at(j, j) : at(j, i));
        float* rectangle = values_.data() + p.rectangle;
        for (int r = 0; r < p.num_below; ++r)
            for (int j = 0; j < p.width; ++j) *rectangle++ = static_cast<float>(at(p.width + r, j));
    };
    for (const auto& share : shares_)
        for (const auto& p : share.panels) take(p);
    for (const auto& p : top_.panels) take(p);
}

void MetricSolver::solve(float* y, std::size_t lanes, std::size_t open, TaskTeam& team) noexcept {
    const std::size_t stride = lane_stride(lanes), top = top_first_ * stride, top_size = top_rows_ * stride;
    const std::size_t width = open == 1 ? 1 : std::min(lane_stride(open), stride);
    const std::size_t threads = shares_.size();
    TERES_CHECK(static_cast<std::size_t>(team.threads()) == threads);
    std::fill(y + top + top_size, y + storage_rows_ * stride, 0.0f);
    team.run([&](int rank) {
        solve_lower(shares_[static_cast<std::size_t>(rank)].panels, rows_.data(), values_.data(), y, stride, 0, width);
    });
    for (std::size_t t = 1; t < threads; ++t)
        for (std::size_t k = 0; k < top_size; ++k) y[top + k] += y[top + t * top_size + k];
    // The top is one dense chain: its lanes are split.
    const auto solve_top = [&](std::size_t first, std::size_t count) {
        solve_lower(top_.panels, rows_.data(), values_.data(), y, stride, first, count);
        solve_upper(top_.panels, rows_.data(), values_.data(), y, stride, first, count);
    };
    const std::size_t packs = width / 4;
    if (threads > 1 && packs > 1)
        team.split(packs, [&](int, std::size_t first, std::size_t last) { solve_top(4 * first, 4 * (last - first)); });
    else
        solve_top(0, width);
    for (std::size_t t = 1; t < threads; ++t) std::copy_n(y + top, top_size, y + top + t * top_size);
    team.run([&](int rank) {
        solve_upper(shares_[static_cast<std::size_t>(rank)].panels, rows_.data(), values_.data(), y, stride, 0, width);
    });
}

}  // namespace teres
