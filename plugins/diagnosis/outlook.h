// The frames that follow those that are fitted, in a long recording with inertia. A wrong cause can bend the beginning
// into place (tissue that relaxes for one that is stiff); it does not stay there. So hypotheses are compared by the
// mean of what they leave on the fitted frames and of what they leave, predicted, on as many later ones. What is
// reported as held out begins after these.
#pragma once

#include <memory>
#include <optional>

#include "plugins/diagnosis/calibration.h"
#include "plugins/diagnosis/recording.h"
#include "plugins/diagnosis/simulator.h"

namespace teres {

class Outlook {
  public:
    /// Of a recording of which only the beginning is fitted; else null. With the model of the whole recording, or with
    /// its twin if it has one. Errors: of make_recording().
    static Result<std::unique_ptr<Outlook>> make(const GapRecording& from, const EffectTable& effects,
                                                 const Calibration& calibration, bool with_twin = false);

    std::size_t end_frame() const { return end_; }
    /// Where rough looks start from; whoever asks, and in whatever order, gets the same.
    void stand_on(const Assumption& nominal);
    /// Half the difference between the cost of a fit on these frames, scaled to `num_fitted` numbers, and `misfit`, its
    /// cost on the fitted ones: added to that it makes the mean of both. `roughly`: at a fraction of its cost
    /// (Simulator::approximate), once it stands somewhere.
    double later(const Assumption& at, double misfit, std::size_t num_fitted, bool roughly = false);

  private:
    Outlook(Recording recording, Simulator simulator, std::size_t first, std::size_t end,
            const Calibration& calibration)
        : recording_(std::move(recording)),
          simulator_(std::move(simulator)),
          first_(first),
          end_(end),
          calibration_(calibration) {}

    bool stands();

    Recording recording_;
    Simulator simulator_;
    std::optional<Assumption> nominal_;
    std::optional<bool> stands_;
    std::size_t first_, end_;
    Calibration calibration_;
};

}  // namespace teres
