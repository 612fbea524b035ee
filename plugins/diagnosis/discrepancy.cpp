#include "plugins/diagnosis/discrepancy.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <random>

#include "plugins/diagnosis/share_work.h"

namespace teres {
namespace {

constexpr int kDraws = 1;            // of the nominal parameters, the first at the prior median
constexpr double kDrawSpread = 0.5;  // in prior standard deviations
constexpr std::size_t kFrames = 10;  // simulated with each variant
constexpr Eigen::Index kModes = 8;   // temporal modes of the nominal motion
constexpr Eigen::Index kColumns = 8;
constexpr double kLeastColumn = 1e-3;  // columns below this share of the first are dropped
constexpr std::uint64_t kVersion = 1;  // of the method: part of the key

std::uint64_t mix(std::uint64_t hash, std::uint64_t value) {
    for (int byte = 0; byte < 8; ++byte) hash = (hash ^ ((value >> (8 * byte)) & 0xff)) * 1099511628211ULL;
    return hash;
}

std::filesystem::path cache_file(const Simulator& simulator, const std::filesystem::path& folder, std::uint64_t key) {
    std::uint64_t hash = mix(mix(mix(14695981039346656037ULL, key), kVersion), simulator.num_rows());
    const TrajectoryModel& model = simulator.mechanics();
    for (std::size_t v = 0; v < model.num_variants(); ++v)
        for (const char* c = model.variant_name(v); *c != '\0'; ++c) hash = mix(hash, static_cast<std::uint64_t>(*c));
    char name[48];
    std::snprintf(name, sizeof name, "discrepancy-%016llx.bin", static_cast<unsigned long long>(hash));
    return folder / name;
}

// Native doubles: rows, columns, remainder, runs, then the columns. A cache never leaves its host.
bool read_cache(const std::filesystem::path& file, std::size_t rows, Discrepancy& out) {
    std::ifstream in(file, std::ios::binary);
    double head[4] = {};
    if (!in.read(reinterpret_cast<char*>(head), sizeof head)) return false;
    if (head[0] != static_cast<double>(rows) || !(head[1] >= 0.0 && head[1] <= static_cast<double>(kColumns)))
        return false;
    out.columns.resize(static_cast<Eigen::Index>(rows), static_cast<Eigen::Index>(head[1]));
    out.remainder_m = head[2];
    out.runs = static_cast<int>(head[3]);
    const auto bytes = static_cast<std::streamsize>(sizeof(double) * static_cast<std::size_t>(out.columns.size()));
    return static_cast<bool>(in.read(reinterpret_cast<char*>(out.columns.data()), bytes)) && out.columns.allFinite();
}

void write_cache(const std::filesystem::path& file, const Discrepancy& d) {
    std::error_code ignored;
    std::filesystem::create_directories(file.parent_path(), ignored);
    const std::filesystem::path part = file.string() + ".part";
    {
        std::ofstream out(part, std::ios::binary);
        const double head[4] = {static_cast<double>(d.columns.rows()), static_cast<double>(d.columns.cols()),
                                d.remainder_m, static_cast<double>(d.runs)};
        out.write(reinterpret_cast<const char*>(head), sizeof head);
        out.write(reinterpret_cast<const char*>(d.columns.data()),
                  static_cast<std::streamsize>(sizeof(double) * static_cast<std::size_t>(d.columns.size())));
        if (!out) return;  // a cache that cannot be kept costs time, nothing else
    }
    std::filesystem::rename(part, file, ignored);
}

// Difference at the listed frames to all frames, through the temporal modes of the nominal motion.
Eigen::VectorXd spread_in_time(const Eigen::MatrixXd& at_frames, const std::vector<std::int32_t>& frames,
                               const Eigen::VectorXd& nominal, Eigen::Index channels) {
    const Eigen::Index all = nominal.size() / channels;
    Eigen::MatrixXd motion = Eigen::Map<const Eigen::MatrixXd>(nominal.data(), channels, all);
    motion.colwise() -= Eigen::VectorXd(motion.col(0));
    const Eigen::BDCSVD<Eigen::MatrixXd> svd(motion, Eigen::ComputeThinV);
    const Eigen::Index modes = std::min({kModes, svd.matrixV().cols(), static_cast<Eigen::Index>(frames.size()) / 2});
    Eigen::MatrixXd basis(all, modes + 1);  // columns: constant, modes
    basis.col(0).setConstant(1.0 / std::sqrt(static_cast<double>(all)));
    basis.rightCols(modes) = svd.matrixV().leftCols(modes);
    std::vector<Eigen::Index> picked(frames.begin(), frames.end());
    const Eigen::MatrixXd some = basis(picked, Eigen::all);
    const Eigen::MatrixXd H = some.transpose() * some + 1e-4 * Eigen::MatrixXd::Identity(modes + 1, modes + 1);
    const Eigen::MatrixXd coefficients = H.ldlt().solve(some.transpose() * at_frames.transpose());
    const Eigen::MatrixXd full = (basis * coefficients).transpose();  // channels x frames
    return Eigen::Map<const Eigen::VectorXd>(full.data(), full.size());
}

}  // namespace

Result<Discrepancy> discrepancy_of(Simulator& simulator, const std::filesystem::path& cache, std::uint64_t key,
                                   const Simulator::Progress& progress) {
    TrajectoryModel& model = simulator.mechanics();
    Discrepancy out;
    const std::size_t variants = model.num_variants();
    if (variants == 0) {
        out.columns.resize(static_cast<Eigen::Index>(simulator.num_rows()), 0);
        return out;
    }
    const std::filesystem::path file = cache.empty() ? cache : cache_file(simulator, cache, key);
    if (!file.empty() && read_cache(file, simulator.num_rows(), out)) {
        out.from_cache = true;
        return out;
    }
    std::vector<std::int32_t> frames;
    const std::size_t count = model.dynamic() ? simulator.num_frames() : std::min(kFrames, simulator.num_frames());
    for (std::size_t k = 0; k < count; ++k)
        frames.push_back(
            static_cast<std::int32_t>(k * (simulator.num_frames() - 1) / std::max<std::size_t>(1, count - 1)));
    const auto channels = static_cast<Eigen::Index>(3 * simulator.num_markers());

    std::mt19937 generator(20);
    std::normal_distribution<double> normal;
    Eigen::MatrixXd all(static_cast<Eigen::Index>(simulator.num_rows()), 0);
    for (int draw = 0; draw < kDraws; ++draw) {
        Assumption assumption;
        for (std::size_t i = 0; i < model.num_parameters(); ++i) {
            const NominalParameter p = model.parameter(i);
            const double z = draw == 0 ? 0.0 : kDrawSpread * normal(generator);
            assumption.theta.push_back(
                std::clamp(std::exp(p.prior_log_mean + p.prior_log_stdev * z), p.lower, p.upper));
        }
        Eigen::VectorXd nominal;
        if (!simulator.simulate(assumption, nominal)) {
            if (draw == 0) return not_usable("the nominal model does not converge at its prior median");
            continue;
        }
        TrajectoryModel* twin = model.twin();
        std::vector<Eigen::MatrixXd> differences(variants);
        std::atomic<bool> cancelled = false;
        share_work(twin != nullptr, variants, [&](std::size_t who, std::size_t v) {
            if (cancelled) return;
            Eigen::MatrixXd difference(channels, static_cast<Eigen::Index>(frames.size()));
            const TrajectoryReport report =
                (who == 0 ? model : *twin)
                    .simulate_variant(v, {assumption.theta, {}}, frames,
                                      {difference.data(), static_cast<std::size_t>(difference.size())});
            if (report.frames_converged == report.frames && difference.allFinite())
                differences[v] = std::move(difference);
            if (who == 0 && progress)
                cancelled = !progress(static_cast<double>(static_cast<std::size_t>(draw) * variants + v + 1) /
                                      static_cast<double>(kDraws * variants));
        });
        if (cancelled) return not_usable("cancelled");
        for (Eigen::MatrixXd& difference : differences) {
            if (difference.size() == 0) continue;
            for (std::size_t k = 0; k < frames.size(); ++k)
                difference.col(static_cast<Eigen::Index>(k)) -= nominal.segment(channels * frames[k], channels);
            all.conservativeResize(Eigen::NoChange, all.cols() + 1);
            all.col(all.cols() - 1) = count == simulator.num_frames()
                                          ? Eigen::VectorXd(difference.reshaped())
                                          : spread_in_time(difference, frames, nominal, channels);
        }
    }
    out.runs = static_cast<int>(all.cols());
    if (out.runs > 0) {
        const Eigen::BDCSVD<Eigen::MatrixXd> svd(all / std::sqrt(static_cast<double>(out.runs)), Eigen::ComputeThinU);
        const Eigen::VectorXd& s = svd.singularValues();
        Eigen::Index kept = 0;
        while (kept < std::min<Eigen::Index>(kColumns, s.size()) && s(kept) > kLeastColumn * s(0)) ++kept;
        out.columns = svd.matrixU().leftCols(kept) * s.head(kept).asDiagonal();
        out.remainder_m = std::sqrt(s.tail(s.size() - kept).squaredNorm() / static_cast<double>(simulator.num_rows()));
    } else {
        out.columns.resize(static_cast<Eigen::Index>(simulator.num_rows()), 0);
    }
    if (!file.empty()) write_cache(file, out);
    return out;
}

}  // namespace teres
