#include "plugins/diagnosis/discrepancy.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <fstream>

#include "plugins/diagnosis/share_work.h"
#include "plugins/diagnosis/temporal_modes.h"

namespace teres {
namespace {

constexpr std::size_t kFrames = 10;  // simulated with each variant
constexpr Eigen::Index kColumns = 8;
constexpr double kLeastColumn = 1e-3;  // columns below this share of the first are dropped
constexpr double kOtherBranch = 5.0;   // times the median difference
constexpr std::uint64_t kVersion = 4;  // of the method: part of the key

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

// Native doubles: rows, columns, frames, runs, rows at the points, then the columns, those at the points, the
// remainders. A cache never leaves its host.
bool read_cache(const std::filesystem::path& file, const Simulator& simulator, Discrepancy& out) {
    std::ifstream in(file, std::ios::binary);
    double head[5] = {};
    if (!in.read(reinterpret_cast<char*>(head), sizeof head)) return false;
    const std::size_t rows = simulator.num_rows(), frames = simulator.num_frames(),
                      points = 3 * simulator.mechanics().num_points() * frames;
    if (head[0] != static_cast<double>(rows) || !(head[1] >= 0.0 && head[1] <= static_cast<double>(kColumns)) ||
        head[2] != static_cast<double>(frames) || head[4] != static_cast<double>(points))
        return false;
    out.columns.resize(static_cast<Eigen::Index>(rows), static_cast<Eigen::Index>(head[1]));
    out.at_points.resize(static_cast<Eigen::Index>(points), out.columns.cols());
    out.remainder_m.resize(static_cast<Eigen::Index>(frames));
    out.runs = static_cast<int>(head[3]);
    const auto read = [&](double* to, Eigen::Index count) {
        const auto bytes = static_cast<std::streamsize>(sizeof(double) * static_cast<std::size_t>(count));
        return static_cast<bool>(in.read(reinterpret_cast<char*>(to), bytes));
    };
    return read(out.columns.data(), out.columns.size()) && read(out.at_points.data(), out.at_points.size()) &&
           read(out.remainder_m.data(), out.remainder_m.size()) && out.columns.allFinite() &&
           out.at_points.allFinite() && out.remainder_m.allFinite();
}

void write_cache(const std::filesystem::path& file, const Discrepancy& d) {
    std::error_code ignored;
    std::filesystem::create_directories(file.parent_path(), ignored);
    const std::filesystem::path part = file.string() + ".part";
    {
        std::ofstream out(part, std::ios::binary);
        const double head[5] = {static_cast<double>(d.columns.rows()), static_cast<double>(d.columns.cols()),
                                static_cast<double>(d.remainder_m.size()), static_cast<double>(d.runs),
                                static_cast<double>(d.at_points.rows())};
        const auto write = [&](const double* from, Eigen::Index count) {
            out.write(reinterpret_cast<const char*>(from),
                      static_cast<std::streamsize>(sizeof(double) * static_cast<std::size_t>(count)));
        };
        write(head, 5);
        write(d.columns.data(), d.columns.size());
        write(d.at_points.data(), d.at_points.size());
        write(d.remainder_m.data(), d.remainder_m.size());
        if (!out) return;  // a cache that cannot be kept costs time, nothing else
    }
    std::filesystem::rename(part, file, ignored);
}

// Where a variant is in the state that the nominal model is in. A frame at which it does not converge or is many times
// as far away as it mostly is has another equilibrium next to it: that says how far it may be off, not in which shape.
struct Nearby {
    std::vector<Eigen::Index> frames;
    Eigen::VectorXd elsewhere;  // mean square per row at the others, else 0 [m^2]
};
Nearby nearby(const Eigen::MatrixXd& difference) {
    const Eigen::VectorXd size = difference.colwise().norm();
    std::vector<double> moved{0.0};
    for (const double s : size)
        if (s > 0.0) moved.push_back(s);
    const auto middle = moved.begin() + static_cast<std::ptrdiff_t>(moved.size() / 2);
    std::nth_element(moved.begin(), middle, moved.end());
    const double most = kOtherBranch * *middle;
    Nearby out{{}, Eigen::VectorXd::Zero(size.size())};
    for (Eigen::Index k = 0; k < size.size(); ++k)
        if (size(k) <= most)
            out.frames.push_back(k);
        else
            out.elsewhere(k) =
                std::pow(std::isfinite(size(k)) ? size(k) : most, 2) / static_cast<double>(difference.rows());
    return out;
}

// Difference at the listed frames to all frames (channels x frames), through temporal modes: at most one for two
// frames.
Eigen::MatrixXd spread_in_time(const Eigen::MatrixXd& at_frames, const std::vector<Eigen::Index>& frames,
                               const Eigen::MatrixXd& temporal) {
    const Eigen::Index count = std::min(temporal.cols(), static_cast<Eigen::Index>(frames.size()) / 2 + 1);
    const auto basis = temporal.leftCols(count);
    const Eigen::MatrixXd some = basis(frames, Eigen::all);
    const Eigen::MatrixXd H = some.transpose() * some + 1e-4 * Eigen::MatrixXd::Identity(count, count);
    const Eigen::MatrixXd coefficients = H.ldlt().solve(some.transpose() * at_frames.transpose());
    return (basis * coefficients).transpose();
}

// Markers and, below them, validation points [m]: a column per frame.
struct Motion {
    Eigen::MatrixXd channels;
    Eigen::Index markers = 0;  // rows of markers
};

// Variants minus the model itself at the listed frames; empty if one hardly converges.
Result<std::vector<Eigen::MatrixXd>> variant_differences(Simulator& simulator, const Assumption& at,
                                                         const std::vector<std::int32_t>& frames, const Motion& nominal,
                                                         const Simulator::Progress& progress) {
    const Eigen::Index points = nominal.channels.rows() - nominal.markers;
    TrajectoryModel& model = simulator.mechanics();
    std::vector<Eigen::MatrixXd> differences(model.num_variants());
    std::atomic<bool> cancelled = false;
    share_work(true, differences.size(), [&](std::size_t who, std::size_t v) {
        if (cancelled) return;
        Eigen::MatrixXd of_markers(nominal.markers, static_cast<Eigen::Index>(frames.size())),
            of_points(points, of_markers.cols());
        const TrajectoryReport report =
            simulator.simulate_variant(v, at, frames, {of_markers.data(), static_cast<std::size_t>(of_markers.size())},
                                       {of_points.data(), static_cast<std::size_t>(of_points.size())});
        Eigen::MatrixXd difference(nominal.channels.rows(), of_markers.cols());
        difference.topRows(nominal.markers) = of_markers;
        difference.bottomRows(points) = of_points;
        difference = model.variant_share(v) * (difference - nominal.channels(Eigen::all, frames));
        const bool usable = model.dynamic() ? report.frames_converged == report.frames && difference.allFinite()
                                            : 2 * report.frames_converged >= report.frames;
        if (usable) differences[v] = std::move(difference);
        if (who == 0 && progress)
            cancelled = !progress(static_cast<double>(v + 1) / static_cast<double>(differences.size()));
    });
    if (cancelled) return not_usable("cancelled");
    return differences;
}

// Leading columns of the ensemble at the markers; how far it goes where it leaves the nominal state.
Discrepancy condense(std::vector<Eigen::MatrixXd> differences, const std::vector<std::int32_t>& frames,
                     const Motion& nominal, bool dynamic) {
    const Eigen::MatrixXd motion =
        nominal.channels.topRows(nominal.markers).colwise() - nominal.channels.col(0).head(nominal.markers);
    const Eigen::MatrixXd temporal = temporal_modes(motion, 0.0);
    const Eigen::Index F = motion.cols(), listed = static_cast<Eigen::Index>(frames.size());
    const Eigen::Index points = nominal.channels.rows() - nominal.markers;
    Eigen::MatrixXd all(motion.size(), 0), at_points(points * F, 0);
    const auto append = [&](const Eigen::MatrixXd& of_all_frames) {
        const Eigen::Index column = all.cols();
        all.conservativeResize(Eigen::NoChange, column + 1);
        at_points.conservativeResize(Eigen::NoChange, column + 1);
        all.col(column) = of_all_frames.topRows(nominal.markers).reshaped();
        at_points.col(column) = of_all_frames.bottomRows(points).reshaped();
    };
    Eigen::VectorXd elsewhere = Eigen::VectorXd::Zero(listed);
    for (Eigen::MatrixXd& difference : differences) {
        if (difference.size() == 0) continue;
        if (dynamic || (listed == F && difference.allFinite())) {
            append(difference);
            continue;
        }
        const Nearby near = nearby(difference.topRows(nominal.markers));
        elsewhere += near.elsewhere;
        std::vector<Eigen::Index> at_frames;
        for (const Eigen::Index k : near.frames) at_frames.push_back(frames[static_cast<std::size_t>(k)]);
        append(spread_in_time(difference(Eigen::all, near.frames), at_frames, temporal));
    }
    Discrepancy out;
    out.runs = static_cast<int>(all.cols());
    out.columns.resize(all.rows(), 0);
    out.at_points.resize(at_points.rows(), 0);
    out.remainder_m = Eigen::VectorXd::Zero(F);
    if (out.runs == 0) return out;
    const double scale = 1.0 / std::sqrt(static_cast<double>(out.runs));
    const Eigen::BDCSVD<Eigen::MatrixXd> svd(scale * all, Eigen::ComputeThinU | Eigen::ComputeThinV);
    const Eigen::VectorXd& s = svd.singularValues();
    Eigen::Index kept = 0;
    while (kept < std::min<Eigen::Index>(kColumns, s.size()) && s(kept) > kLeastColumn * s(0)) ++kept;
    out.columns = svd.matrixU().leftCols(kept) * s.head(kept).asDiagonal();
    out.at_points = scale * at_points * svd.matrixV().leftCols(kept);
    const double left = s.tail(s.size() - kept).squaredNorm() / static_cast<double>(all.rows());
    for (Eigen::Index f = 0; f < F; ++f) {  // elsewhere: as the listed frame of the nearest shape
        Eigen::Index nearest = 0;
        (motion(Eigen::all, frames).colwise() - motion.col(f)).colwise().squaredNorm().minCoeff(&nearest);
        out.remainder_m(f) = std::sqrt(left + elsewhere(nearest) / static_cast<double>(out.runs));
    }
    return out;
}

}  // namespace

Result<Discrepancy> discrepancy_about(Simulator& simulator, const Assumption& at, const Simulator::Progress& progress) {
    TrajectoryModel& model = simulator.mechanics();
    std::vector<std::int32_t> frames;
    const std::size_t count = model.dynamic() ? simulator.num_frames() : std::min(kFrames, simulator.num_frames());
    for (std::size_t k = 0; k < count; ++k)
        frames.push_back(
            static_cast<std::int32_t>(k * (simulator.num_frames() - 1) / std::max<std::size_t>(1, count - 1)));
    Eigen::VectorXd markers;
    std::vector<double> points;
    if (!simulator.simulate(at, markers, &points, nullptr))
        return not_usable("the model does not converge where its error is asked for");
    const auto F = static_cast<Eigen::Index>(simulator.num_frames());
    Motion nominal{Eigen::MatrixXd(3 * static_cast<Eigen::Index>(model.num_markers() + model.num_points()), F),
                   3 * static_cast<Eigen::Index>(model.num_markers())};
    const Eigen::Index below = nominal.channels.rows() - nominal.markers;
    nominal.channels.topRows(nominal.markers) = markers.reshaped(nominal.markers, F);
    nominal.channels.bottomRows(below) = Eigen::Map<const Eigen::MatrixXd>(points.data(), below, F);
    TERES_TRY_ASSIGN(std::vector<Eigen::MatrixXd> differences,
                     variant_differences(simulator, at, frames, nominal, progress));
    return condense(std::move(differences), frames, nominal, model.dynamic());
}

Result<Discrepancy> discrepancy_of(Simulator& simulator, const std::filesystem::path& cache, std::uint64_t key,
                                   const Simulator::Progress& progress) {
    Discrepancy out;
    const std::filesystem::path file = cache.empty() ? cache : cache_file(simulator, cache, key);
    if (!file.empty() && read_cache(file, simulator, out)) {
        out.from_cache = true;
        return out;
    }
    TERES_TRY_ASSIGN(out, discrepancy_about(simulator, prior_median(simulator.mechanics()), progress));
    if (!file.empty()) write_cache(file, out);
    return out;
}

}  // namespace teres
