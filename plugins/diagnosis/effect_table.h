// The effects of the mechanical and the sensor catalogue in one numbered list, and what a hypothesis is made of.
#pragma once

#include <Eigen/Dense>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/extensions/trajectory_model.h"

namespace teres {

struct EffectEntry {
    bool sensor = false;
    std::size_t index = 0;  ///< in its own catalogue
    EffectInfo info{};
    std::vector<EffectParameter> parameters;

    bool excluded = false;

    bool applicable() const { return info.not_applicable == nullptr && !excluded; }
    /// Holds or does not, from somewhere on; loads, materials and cameras change by degrees.
    bool support() const { return std::string_view(info.kind) == "boundary"; }
    /// ... at a place of its own, from the beginning: an adhesion, a contact, a slack ligament. Where each of its
    /// points begins to hold is not known; what lets go at an instant or moves as a whole changes by degrees.
    bool local_support() const;
    /// A support that lets go at some time.
    bool tears() const { return support() && info.event; }
    /// The weight, a pressure: all of the body, from the beginning to the end.
    bool steady_load() const { return std::string_view(info.family) == "steady load"; }
    /// Few and global degrees of freedom: what it explains beside another effect is hardly an error of that one's form.
    bool global() const { return sensor || steady_load(); }
    /// A body that is parted at some time.
    bool parts() const { return info.event && std::string_view(info.kind) == "mechanics"; }
    /// Nothing of its form could differ from the catalogue's: a load that has neither place nor course of its own
    /// (weight, a gain of known forces), whose where and when are known, or a sensor's few and global numbers.
    bool exact_form() const;
};

/// An effect switched on. `values`: physical, one per parameter.
struct ActiveEffect {
    std::size_t entry = 0;  ///< in the EffectTable
    std::vector<double> values;
    bool operator==(const ActiveEffect&) const = default;
};

/// Index of a parameter by its name.
std::optional<std::size_t> parameter_of(const EffectEntry& entry, std::string_view name);
/// Value of a parameter by its name, or null.
const double* value_of(const EffectEntry& entry, const ActiveEffect& effect, std::string_view name);
/// Parameters <name>_x, _y, _z; nothing if it has none of these.
std::optional<Eigen::Vector3d> vector_of(const EffectEntry& entry, const ActiveEffect& effect, const std::string& name);
/// (center_x, center_y, center_z) [m, body frame]; nothing if the effect has no place.
std::optional<Eigen::Vector3d> centre_of(const EffectEntry& entry, const ActiveEffect& effect);

/// Value of an amplitude at a share of a candidate's: 0 is null, 1 the candidate. A parameter that cannot be zero keeps
/// the sign of the candidate.
double at_share(const EffectParameter& parameter, double candidate, double share);

/// What is held to be true of the body and the sensors.
struct Assumption {
    std::vector<double> theta;  ///< physical parameters of the nominal model
    std::vector<ActiveEffect> effects;
};

class EffectTable {
  public:
    EffectTable(const TrajectoryModel& mechanics, const ObservationModel* sensors,
                std::span<const char* const> excluded);

    std::size_t size() const { return entries_.size(); }
    const EffectEntry& operator[](std::size_t entry) const { return entries_[entry]; }
    /// Index of an id, or size().
    std::size_t find(std::string_view id) const;
    /// Candidate of the effect's search grid.
    ActiveEffect candidate(std::size_t entry, std::size_t index) const;
    /// The same with every amplitude but `amplitude` (counted among amplitudes) at null; npos: all at null.
    ActiveEffect single(const ActiveEffect& from, std::size_t amplitude) const;
    std::size_t num_amplitudes(std::size_t entry) const;
    /// Whether an effect happens in the recording and leaves its beginning alone: an event whose onset, if it has one,
    /// lies beyond the first tenth.
    bool happens(const ActiveEffect& effect) const;
    /// An event that was there from the beginning.
    bool always_there(const ActiveEffect& effect) const {
        return entries_[effect.entry].info.event && !happens(effect);
    }
    /// A load that acts from the beginning until some instant, as one that acts the other way round from then on, or
    /// the reverse: beside what is steady both explain about the same. Nothing if it is none.
    std::optional<ActiveEffect> complement(const ActiveEffect& effect) const;
    /// Share of what ligaments hold by that lies within the effect's radius of its place; 0 if it has none.
    double ligament_share(const ActiveEffect& effect) const;
    /// A cut around so much of the ligaments' feet that they let the body go.
    bool lets_go(const ActiveEffect& effect) const;
    /// Holds or is parted at a place of its own: what really does differs from the catalogue's smooth form. What lets a
    /// ligament go does not, be it a tear (fitted from where all of it is torn, refit_torn()) or a cut at its foot.
    bool rough_form(const ActiveEffect& effect) const;

  private:
    struct Held {
        Eigen::Vector3d at_m;
        double share;
    };
    const EffectCatalogue& catalogue(const EffectEntry& entry) const;
    const TrajectoryModel& mechanics_;
    const ObservationModel* sensors_;
    std::vector<EffectEntry> entries_;
    std::vector<Held> ligaments_;
};

}  // namespace teres
