#include "plugins/diagnosis/simulator.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace teres {
namespace {

constexpr double kMaxUnconvergedShare = 0.1;  // of the frames; more and the trajectory is no base for anything
constexpr std::size_t kBatch = 64;            // hypotheses per first_order() call: progress and memory

bool follows(const TrajectoryReport& report) {
    return report.frames - report.frames_converged <= kMaxUnconvergedShare * static_cast<double>(report.frames);
}

}  // namespace

Assumption prior_median(const TrajectoryModel& model) {
    Assumption a;
    for (std::size_t i = 0; i < model.num_parameters(); ++i)
        a.theta.push_back(std::clamp(std::exp(model.parameter(i).prior_log_mean), model.parameter(i).lower,
                                     model.parameter(i).upper));
    return a;
}

Simulator::Simulator(TrajectoryModel& mechanics, const ObservationModel* sensors, const EffectTable& effects)
    : mechanics_(mechanics),
      sensors_(sensors),
      effects_(effects),
      rows_(3 * mechanics.num_markers() * mechanics.num_frames()) {
    for (std::size_t f = 0; f < mechanics.num_frames(); ++f) times_.push_back(mechanics.time_s(f));
}

std::vector<EffectInstance> Simulator::instances(const Assumption& assumption, bool sensor) const {
    std::vector<EffectInstance> list;
    for (const ActiveEffect& effect : assumption.effects)
        if (effects_[effect.entry].sensor == sensor)
            list.push_back({static_cast<std::int32_t>(effects_[effect.entry].index), effect.values});
    return list;
}

Eigen::VectorXd Simulator::observe(const Assumption& assumption, const Eigen::VectorXd& true_m) const {
    if (sensors_ == nullptr) return true_m;
    Eigen::VectorXd observed(true_m.size());
    sensors_->observe(instances(assumption, true), times_, {true_m.data(), rows_}, {observed.data(), rows_});
    return observed;
}

double Simulator::noise_factor(const Assumption& assumption) const {
    return sensors_ == nullptr ? 1.0 : sensors_->noise_factor(instances(assumption, true));
}

bool Simulator::simulate(const Assumption& assumption, Eigen::VectorXd& observed) {
    if (every_frame_ && base_true_.size() > 0 && same_mechanics(base_, assumption))
        return keep(assumption, base_report_, observed);
    return simulate(assumption, observed, nullptr, nullptr);
}

bool Simulator::simulate(const Assumption& assumption, Eigen::VectorXd& observed, std::vector<double>* points_m,
                         std::vector<double>* nodes_m) {
    base_true_.resize(static_cast<Eigen::Index>(rows_));
    if (points_m != nullptr) points_m->resize(3 * mechanics_.num_points() * num_frames());
    if (nodes_m != nullptr) nodes_m->resize(3 * mechanics_.num_nodes() * num_frames());
    const auto list = instances(assumption, false);
    const TrajectoryReport report =
        mechanics_.simulate({assumption.theta, list}, {base_true_.data(), rows_},
                            points_m != nullptr ? std::span<double>(*points_m) : std::span<double>(),
                            nodes_m != nullptr ? std::span<double>(*nodes_m) : std::span<double>());
    every_frame_ = true;
    whole_ = assumption;
    return keep(assumption, report, observed);
}

bool Simulator::simulate_at(const Assumption& assumption, std::span<const std::int32_t> frames,
                            Eigen::VectorXd& trajectory) {
    const auto channels = static_cast<Eigen::Index>(3 * num_markers());
    Eigen::MatrixXd markers_m(channels, static_cast<Eigen::Index>(frames.size()));
    const auto list = instances(assumption, false);
    const TrajectoryReport report = mechanics_.simulate_at(
        {assumption.theta, list}, frames, {markers_m.data(), static_cast<std::size_t>(markers_m.size())});
    trajectory.setConstant(static_cast<Eigen::Index>(rows_), std::numeric_limits<double>::quiet_NaN());
    for (std::size_t k = 0; k < frames.size(); ++k)
        trajectory.segment(channels * frames[k], channels) = markers_m.col(static_cast<Eigen::Index>(k));
    return report.frames_converged == report.frames && markers_m.allFinite();
}

bool Simulator::simulate_apart(const Assumption& assumption, std::size_t num_frames, Eigen::VectorXd& observed) const {
    const auto channels = static_cast<Eigen::Index>(3 * num_markers());
    std::vector<std::int32_t> frames(std::min(num_frames, this->num_frames()));
    std::iota(frames.begin(), frames.end(), 0);
    Eigen::MatrixXd markers_m(channels, static_cast<Eigen::Index>(this->num_frames()));
    const auto played = static_cast<Eigen::Index>(frames.size());
    const auto list = instances(assumption, false);
    const TrajectoryReport report = mechanics_.simulate_at(
        {assumption.theta, list}, frames, {markers_m.data(), static_cast<std::size_t>(channels * played)});
    markers_m.rightCols(markers_m.cols() - played).colwise() = Eigen::VectorXd(markers_m.col(played - 1));
    observed = observe(assumption, markers_m.reshaped());
    return observed.allFinite() && follows(report);
}

TrajectoryReport Simulator::simulate_variant(std::size_t variant, const Assumption& assumption,
                                             std::span<const std::int32_t> frames, std::span<double> markers_m,
                                             std::span<double> points_m) const {
    return mechanics_.simulate_variant(variant, {assumption.theta, instances(assumption, false)}, frames, markers_m,
                                       points_m);
}

void Simulator::set_horizon(std::size_t num_frames) {
    if (num_frames >= this->num_frames()) num_frames = 0;
    if (num_frames != horizon_ && mechanics_.dynamic()) base_true_.resize(0);  // the base is that of another horizon
    horizon_ = num_frames;
    mechanics_.set_horizon(num_frames);
}

bool Simulator::approximate(const Assumption& assumption, Eigen::VectorXd& observed) {
    if (base_true_.size() > 0 && same_mechanics(base_, assumption)) return keep(assumption, base_report_, observed);
    base_true_.resize(static_cast<Eigen::Index>(rows_));
    every_frame_ = false;
    const auto list = instances(assumption, false);
    return keep(assumption, mechanics_.approximate({assumption.theta, list}, {base_true_.data(), rows_}), observed);
}

bool Simulator::keep(const Assumption& assumption, TrajectoryReport report, Eigen::VectorXd& observed) {
    base_ = assumption;
    base_report_ = report;
    base_observed_ = observe(assumption, base_true_);
    observed = base_observed_;
    return observed.allFinite() && follows(report);
}

bool Simulator::same_mechanics(const Assumption& a, const Assumption& b) const {
    if (a.theta != b.theta) return false;
    const auto mechanical = [&](const Assumption& from) {
        std::vector<const ActiveEffect*> list;
        for (const auto& e : from.effects)
            if (!effects_[e.entry].sensor) list.push_back(&e);
        return list;
    };
    const auto of_a = mechanical(a), of_b = mechanical(b);
    return std::equal(of_a.begin(), of_a.end(), of_b.begin(), of_b.end(),
                      [](const auto* x, const auto* y) { return x->entry == y->entry && x->values == y->values; });
}

// A dynamic recording has no first order per frame: each hypothesis is simulated.
void Simulator::simulate_changes(std::span<const Hypothesis> hypotheses, Eigen::MatrixXd& change) {
    for (std::size_t k = 0; k < hypotheses.size(); ++k) {
        auto column = change.col(static_cast<Eigen::Index>(k));
        mechanics_.simulate(hypotheses[k], {column.data(), rows_}, {}, {});
        column -= base_true_;
    }
}

Eigen::MatrixXd Simulator::responses(const std::vector<Assumption>& others, const Progress& progress) {
    if (base_true_.size() == 0) {  // the base is that of another horizon
        Eigen::VectorXd motion;
        simulate(Assumption(base_), motion);
    }
    const auto rows = static_cast<Eigen::Index>(rows_);
    Eigen::MatrixXd change = Eigen::MatrixXd::Zero(rows, static_cast<Eigen::Index>(others.size()));
    std::vector<std::size_t> moved;  // columns whose mechanics differ
    for (std::size_t k = 0; k < others.size(); ++k)
        if (!same_mechanics(base_, others[k])) moved.push_back(k);
    Eigen::MatrixXd batch;
    for (std::size_t first = 0; first < moved.size(); first += kBatch) {
        const std::size_t count = std::min(kBatch, moved.size() - first);
        std::vector<std::vector<EffectInstance>> lists;
        std::vector<Hypothesis> hypotheses;
        lists.reserve(count);
        for (std::size_t k = 0; k < count; ++k) {
            const Assumption& other = others[moved[first + k]];
            lists.push_back(instances(other, false));
            hypotheses.push_back({other.theta, lists.back()});
        }
        batch.resize(rows, static_cast<Eigen::Index>(count));
        if (!mechanics_.first_order(hypotheses, {batch.data(), rows_ * count}, {})) simulate_changes(hypotheses, batch);
        for (std::size_t k = 0; k < count; ++k)
            change.col(static_cast<Eigen::Index>(moved[first + k])) = batch.col(static_cast<Eigen::Index>(k));
        if (progress && !progress(static_cast<double>(first + count) / static_cast<double>(moved.size()))) break;
    }
    if (sensors_ != nullptr)
        for (std::size_t k = 0; k < others.size(); ++k) {
            const auto column = static_cast<Eigen::Index>(k);
            change.col(column) = observe(others[k], base_true_ + change.col(column)) - base_observed_;
        }
    return change.array().isFinite().select(change, 0.0);
}

}  // namespace teres
