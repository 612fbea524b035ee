#include "plugins/simulation/frame_choice.h"

#include <algorithm>
#include <limits>
#include <numeric>

namespace teres {

using Eigen::MatrixXd;
using Eigen::VectorXd;

std::vector<std::size_t> distinct_frames(const std::vector<VectorXd>& x, const std::vector<std::int32_t>& among,
                                         std::size_t most, std::vector<std::size_t>& nearest) {
    std::vector<std::size_t> candidates(among.begin(), among.end()), chosen;
    if (among.empty()) {
        candidates.resize(x.size());
        std::iota(candidates.begin(), candidates.end(), std::size_t{0});
    }
    std::vector<double> distance(x.size(), std::numeric_limits<double>::infinity());
    nearest.assign(x.size(), 0);
    for (std::size_t next = candidates.front(); chosen.size() < std::min(most, candidates.size());) {
        for (std::size_t f = 0; f < x.size(); ++f)
            if (const double d = (x[f] - x[next]).squaredNorm(); d < distance[f]) {
                distance[f] = d;
                nearest[f] = chosen.size();
            }
        chosen.push_back(next);
        next = *std::max_element(candidates.begin(), candidates.end(),
                                 [&](std::size_t a, std::size_t b) { return distance[a] < distance[b]; });
    }
    return chosen;
}

std::vector<std::int32_t> frames_to_solve(const MatrixXd& z, std::size_t most) {
    std::vector<char> solved(static_cast<std::size_t>(z.cols()), 0);
    solved.front() = solved.back() = 1;
    for (std::size_t count = 2; count < most; ++count) {
        double worst = -1.0;
        Eigen::Index worst_frame = 0;
        for (Eigen::Index from = 0, to = 1; to < z.cols(); ++to) {
            if (!solved[static_cast<std::size_t>(to)]) continue;
            for (Eigen::Index f = from + 1; f < to; ++f) {
                const double share = static_cast<double>(f - from) / static_cast<double>(to - from);
                const double error = (z.col(f) - (1.0 - share) * z.col(from) - share * z.col(to)).norm() +
                                     1e-9 * static_cast<double>(std::min(f - from, to - f));  // ties: in the middle
                if (error > worst) {
                    worst = error;
                    worst_frame = f;
                }
            }
            from = to;
        }
        if (worst < 0.0) break;
        solved[static_cast<std::size_t>(worst_frame)] = 1;
    }
    std::vector<std::int32_t> frames;
    for (std::size_t f = 0; f < solved.size(); ++f)
        if (solved[f]) frames.push_back(static_cast<std::int32_t>(f));
    return frames;
}

MatrixXd interpolate(const MatrixXd& at_frames, const std::vector<std::int32_t>& frames, Eigen::Index count) {
    MatrixXd out(at_frames.rows(), count);
    for (std::size_t k = 0; k + 1 < frames.size(); ++k)
        for (auto f = frames[k]; f <= frames[k + 1]; ++f) {
            const double share = static_cast<double>(f - frames[k]) / (frames[k + 1] - frames[k]);
            out.col(f) = (1.0 - share) * at_frames.col(static_cast<Eigen::Index>(k)) +
                         share * at_frames.col(static_cast<Eigen::Index>(k + 1));
        }
    return out;
}

MatrixXd with_rest(const MatrixXd& dz, MatrixXd rest, const std::vector<std::int32_t>& frames) {
    MatrixXd products(2, rest.cols());
    for (Eigen::Index k = 0; k < rest.cols(); ++k) {
        const auto at = dz.col(frames[static_cast<std::size_t>(k)]);
        products.col(k) << rest.col(k).dot(at), at.squaredNorm();
    }
    const MatrixXd along = interpolate(products, frames, dz.cols());
    const Eigen::RowVectorXd share =
        along.row(0).array() / (along.row(1).array() + 1e-6 * along.row(1).maxCoeff() + 1e-300);
    for (Eigen::Index k = 0; k < rest.cols(); ++k) {
        const auto f = frames[static_cast<std::size_t>(k)];
        rest.col(k) -= share(f) * dz.col(f);
    }
    return dz * (1.0 + share.array()).matrix().asDiagonal() + interpolate(rest, frames, dz.cols());
}

}  // namespace teres
