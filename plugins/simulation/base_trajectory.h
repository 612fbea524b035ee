// The trajectory about which responses are first order (trajectory.h): its hypothesis, its motion, and what is made of
// it on first use.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "core/extensions/trajectory_model.h"
#include "plugins/simulation/body.h"
#include "plugins/simulation/cholesky.h"
#include "plugins/simulation/effects/effect.h"
#include "plugins/simulation/modal_response.h"

namespace teres {

/// A hypothesis with its own storage; not copied, because `effects` looks at `values`.
struct HypothesisPoint {
    std::vector<double> theta;
    std::vector<std::vector<double>> values;
    std::vector<EffectInstance> effects;
    Hypothesis hypothesis() const { return {theta, effects}; }
};

struct BaseTrajectory {
    struct BodyState {  ///< of a set of strain points, elastic_stress()
        std::vector<float> S, psi, F;
    };
    using FrameState = std::vector<BodyState>;  ///< per set
    struct Compliance {                         ///< rows x free dofs
        Eigen::MatrixXf markers, points;
    };

    BaseTrajectory() = default;
    explicit BaseTrajectory(const Hypothesis& h);

    HypothesisPoint at;
    std::vector<Eigen::VectorXd> x;               ///< per frame, 3N
    std::vector<Eigen::VectorXd> v, a;            ///< dynamic, of the frames played
    std::size_t num_played = 0;                   ///< frames from the first; later ones repeat the last of them
    std::vector<std::int32_t> solved;             ///< frames in equilibrium; empty: all
    Eigen::MatrixXd marker_rest_m;                ///< per frame, what markers are off those of x; empty: nothing
    std::vector<Compliance> compliance;           ///< of a dynamic case: one, next to the mean state
    std::vector<std::size_t> nearest;             ///< compliance of each frame
    std::unique_ptr<ModalResponse> modal;         ///< dynamic
    Eigen::MatrixXd modal_markers, modal_points;  ///< H phi
    std::unique_ptr<Cholesky> tangent;            ///< dynamic: where the modes are taken
    bool with_markers = false, with_points = false;

    /// v and a by differences between frames: what frames cannot resolve is not looked at.
    void differentiate(const std::function<double(std::size_t frame)>& step_s);
    /// Made for all frames played when first asked for, by whoever asks: many hypotheses leave the body's material
    /// alone.
    const FrameState& stresses_at(std::size_t frame, const Body& body);

  private:
    std::once_flag stresses_made_;
    std::vector<FrameState> stresses_;
};

/// The point a share of the way from `base` to `other`, in transformed parameters. An effect that is off in one of them
/// has null amplitudes there and the other's shape.
HypothesisPoint point_between(const HypothesisPoint& base, const Hypothesis& other, double share,
                              const std::vector<std::unique_ptr<Effect>>& effects);

}  // namespace teres
