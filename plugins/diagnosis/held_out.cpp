#include "plugins/diagnosis/held_out.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <random>

namespace teres {
namespace {

constexpr int kResamples = 400;
constexpr double kElsewhere = 0.12;  // what other points of the body add on either side: sealed cases, then opened
constexpr std::size_t kBlocks = 4;   // of frames: neighbours in time share their error

double fraction_of(double before, double after) {
    return before > 0.0 ? 1.0 - after / before : 0.0;
}

}  // namespace

double gap_rms_m(const Eigen::VectorXd& observed, const Eigen::VectorXd& simulated,
                 const std::vector<Eigen::Index>& rows, double noise_m) {
    if (rows.empty()) return 0.0;
    double sum = 0.0;
    for (const Eigen::Index row : rows) sum += (observed(row) - simulated(row)) * (observed(row) - simulated(row));
    const double mean = 3.0 * sum / static_cast<double>(rows.size());
    return std::sqrt(std::max(0.0, mean - 3.0 * noise_m * noise_m));
}

Shrinkage shrinkage(const Recording& recording, const std::vector<Eigen::Index>& rows, const Eigen::VectorXd& before,
                    const Eigen::VectorXd& after) {
    Shrinkage out;
    out.before_m = gap_rms_m(recording.observed, before, rows, recording.noise_m);
    out.after_m = gap_rms_m(recording.observed, after, rows, recording.noise_m);
    out.fraction = fraction_of(out.before_m, out.after_m);
    if (rows.empty()) return out;

    struct Cluster {
        double before = 0.0, after = 0.0, count = 0.0;
    };
    const std::size_t first = recording.frame_of(rows.front()), last = recording.frame_of(rows.back());
    std::map<std::pair<std::size_t, std::size_t>, Cluster> clusters;  // marker, block of frames
    for (const Eigen::Index row : rows) {
        const std::size_t block = (recording.frame_of(row) - first) * kBlocks / (last - first + 1);
        Cluster& c = clusters[{recording.marker_of(row), block}];
        const double b = recording.observed(row) - before(row), a = recording.observed(row) - after(row);
        c.before += b * b;
        c.after += a * a;
        c.count += 1.0;
    }
    std::vector<Cluster> list;
    for (const auto& [key, cluster] : clusters) list.push_back(cluster);
    std::mt19937 generator(95);
    std::uniform_int_distribution<std::size_t> pick(0, list.size() - 1);
    std::vector<double> fractions;
    const double noise = 3.0 * recording.noise_m * recording.noise_m;
    for (int k = 0; k < kResamples; ++k) {
        Cluster sum;
        for (std::size_t i = 0; i < list.size(); ++i) {
            const Cluster& c = list[pick(generator)];
            sum.before += c.before;
            sum.after += c.after;
            sum.count += c.count;
        }
        const auto rms = [&](double total) { return std::sqrt(std::max(0.0, 3.0 * total / sum.count - noise)); };
        fractions.push_back(fraction_of(rms(sum.before), rms(sum.after)));
    }
    std::sort(fractions.begin(), fractions.end());
    out.ci95 = {fractions[static_cast<std::size_t>(0.025 * kResamples)] - kElsewhere,
                std::min(1.0, fractions[static_cast<std::size_t>(0.975 * kResamples)] + kElsewhere)};
    return out;
}

}  // namespace teres
