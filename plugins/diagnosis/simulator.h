// What a recording would show under an assumption: mechanics, then sensors. All trajectories are vectors of
// 3 M F rows (TrajectoryModel's layout) [m].
#pragma once

#include <Eigen/Dense>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "plugins/diagnosis/effect_table.h"

namespace teres {

/// Nominal parameters at their prior median, no effect.
Assumption prior_median(const TrajectoryModel& model);

class Simulator {
  public:
    /// `cancelled` is asked between batches; it gets the part done of the running batch list.
    using Progress = std::function<bool(double part)>;

    Simulator(TrajectoryModel& mechanics, const ObservationModel* sensors, const EffectTable& effects);

    std::size_t num_rows() const { return rows_; }
    std::size_t num_frames() const { return times_.size(); }
    std::size_t num_markers() const { return mechanics_.num_markers(); }
    const std::vector<double>& times_s() const { return times_; }
    const EffectTable& effects() const { return effects_; }
    TrajectoryModel& mechanics() const { return mechanics_; }

    /// Simulates every frame and keeps the result as base of responses(). False: too many frames did not converge.
    bool simulate(const Assumption& assumption, Eigen::VectorXd& observed);
    /// Also the validation points (3 P F) and all nodes (3 N F) where not null.
    bool simulate(const Assumption& assumption, Eigen::VectorXd& observed, std::vector<double>* points_m,
                  std::vector<double>* nodes_m);
    /// Only the given frames (ascending), under an assumption without sensor effects; the others are NaN. The base
    /// stays what it is. False: a frame did not converge.
    bool simulate_at(const Assumption& assumption, std::span<const std::int32_t> frames, Eigen::VectorXd& trajectory);
    /// What simulate() makes of so many frames from the first, of which there is one at least; later ones repeat the
    /// last of them. The base stays what it is.
    bool simulate_apart(const Assumption& assumption, std::size_t num_frames, Eigen::VectorXd& observed) const;
    /// The markers and points of a variant of the model (TrajectoryModel::simulate_variant), without sensor effects.
    TrajectoryReport simulate_variant(std::size_t variant, const Assumption& assumption,
                                      std::span<const std::int32_t> frames, std::span<double> markers_m,
                                      std::span<double> points_m) const;
    /// Only so many frames from the first are simulated from now on (TrajectoryModel::set_horizon); 0: all.
    void set_horizon(std::size_t num_frames);
    /// simulate() at a fraction of its cost (TrajectoryModel::approximate).
    bool approximate(const Assumption& assumption, Eigen::VectorXd& observed);
    /// The last approximate() takes the place of the last simulate() (TrajectoryModel::rebase).
    void rebase() { mechanics_.rebase(); }
    /// First-order change of the observed trajectory when the base gives way to each of `others`.
    Eigen::MatrixXd responses(const std::vector<Assumption>& others, const Progress& progress = {});
    /// Factor on the stated noise.
    double noise_factor(const Assumption& assumption) const;
    /// Whether approximate() starts from what simulate() made of these mechanics, be it of a shorter horizon.
    bool starts_from(const Assumption& assumption) const { return whole_ && same_mechanics(*whole_, assumption); }
    /// Assumption of the last trajectory.
    const Assumption& base() const { return base_; }

  private:
    bool keep(const Assumption& assumption, TrajectoryReport report, Eigen::VectorXd& observed);
    std::vector<EffectInstance> instances(const Assumption& assumption, bool sensor) const;
    Eigen::VectorXd observe(const Assumption& assumption, const Eigen::VectorXd& true_m) const;
    void simulate_changes(std::span<const Hypothesis> hypotheses, Eigen::MatrixXd& change);
    bool same_mechanics(const Assumption& a, const Assumption& b) const;

    TrajectoryModel& mechanics_;
    const ObservationModel* sensors_;
    const EffectTable& effects_;
    std::size_t rows_;
    std::vector<double> times_;
    std::size_t horizon_ = 0;
    Assumption base_;
    std::optional<Assumption> whole_;  // of the last simulate()
    bool every_frame_ = false;         // of the base was simulated
    TrajectoryReport base_report_;
    Eigen::VectorXd base_true_, base_observed_;
};

/// While it lives, only so many frames from the first are simulated; 0: all.
class Horizon {
  public:
    Horizon(Simulator& simulator, std::size_t num_frames) : simulator_(simulator) {
        simulator_.set_horizon(num_frames);
    }
    ~Horizon() { simulator_.set_horizon(0); }
    Horizon(const Horizon&) = delete;
    Horizon& operator=(const Horizon&) = delete;

  private:
    Simulator& simulator_;
};

}  // namespace teres
