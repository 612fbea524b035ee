// One patient, drawn at random or about a given case: shape, true ligament and law, what the modeller believes, loads,
// markers, and the recording that CalculiX makes of it under a scenario. All cases of one draw share it; the scenario
// is what an effect changes.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/case/case.h"
#include "core/result.h"
#include "tools/blindtest/band.h"
#include "tools/blindtest/body_shape.h"
#include "tools/blindtest/random.h"
#include "tools/blindtest/truth_mesh.h"
#include "tools/calculix/recording.h"

namespace teres::blindtest {

using Frames = std::vector<std::vector<Point>>;  ///< [frame][marker, region or point]
using Facets = std::vector<Point>;               ///< surface triangles of the truth by their centroids

/// True motion of what is observed and of what is to be predicted [m].
struct Motion {
    Frames markers, points;
    double solver_s = 0.0;
};

struct PatchLoad {
    Point centre_m{};
    double radius_m = 0.0;
    std::vector<Point> force_n;                  ///< per frame
    std::vector<std::pair<Point, double>> at{};  ///< places and shares of the force; empty: a smooth patch
};

/// Springs over facets: to the ground along the axes, or along a line with a law of its own.
struct SpringBed {
    Facets facets;
    double ground_n_per_m3 = 0.0;                              ///< stiffness per area; 0: lines
    double line_m = 0.0;                                       ///< length of the lines along the outward normal
    std::vector<std::pair<double, double>> elongation_stress;  ///< of the lines [m], [Pa]
};

/// What the world does beyond or unlike the nominal model. The control's is TruthBody::control().
struct Scenario {
    Frames forces_n;  ///< per frame and region: true loads
    calculix::CalculixMaterial body, ligament;
    std::vector<char> in_inclusion;  ///< per tetrahedron; empty: none
    calculix::CalculixMaterial inclusion;
    double prony_ratio = 0.0, prony_time_s = 0.0;  ///< Maxwell branch beside the body: its modulus over the body's
    std::vector<PatchLoad> patch_loads;
    Facets pressed;
    std::vector<double> pressure_pa;  ///< per frame; empty: none
    Point gravity_direction{};
    std::vector<double> gravity_m_s2;  ///< per frame; empty: none
    std::vector<Point> far_motion_m;   ///< of the ligament's far edge per frame; empty: none
    std::vector<SpringBed> beds;
    Facets band, extra_band;                        ///< true ligament, second ligament
    bool clamp_held = true;                         ///< the posterior patch, if the patient has one
    std::vector<std::pair<Point, double>> hung_kg;  ///< masses at surface points (dynamic only)
    // Another state from this frame on; static bodies have no memory, so it is solved on its own.
    int event_frame = -1;
    Facets band_after;
    double cut_radius_m = 0.0;  ///< 0: no cut
    double cut_bend_1_m = 0.0;
    Point cut_centre_m{}, cut_normal{};
};

struct BodyOptions {
    std::uint64_t seed = 0, draw = 0;
    bool clamped = false;  ///< posterior patch held beside the ligament
    bool dynamic = false;  ///< fast loads, inertia, short frames
    /// About. Edges of 20 mm (quadratic) and 12 mm: the bands are 24 to 32 mm wide.
    double truth_tets = 800.0, case_tets = 2200.0;
    int frames = 36, markers = 14, points = 30;
    /// A case whose mesh, loads, sensor, markers and prior are kept; law, modulus and place of the true ligament within
    /// the prior and the law of the true body are drawn. Null: everything is drawn. See check_given().
    std::shared_ptr<const Case> given;
};

/// Whether blind cases can be made of a given body. Errors (kInvalidInput): tools or springs, weight, a camera that is
/// late or not placed, neither ligament nor clamp, no loads.
Status check_given(const Case& given);

class TruthBody {
  public:
    /// Draws the patient and scales its loads (one linear solution). Errors: of CalculiX; of check_given().
    static Result<TruthBody> make(const BodyOptions& options, const std::filesystem::path& scratch);

    const Case& nominal() const { return nominal_; }  ///< the case folder's content without observations
    const BodyOptions& options() const { return options_; }
    const TruthMesh& mesh() const { return mesh_; }
    const BodyShape& shape() const { return *shape_; }
    const Scenario& control() const { return control_; }
    const Band& true_band() const { return true_band_; }
    const Facets& clamp() const { return clamp_; }
    const std::vector<PatchLoad>& regions() const { return regions_; }
    std::size_t num_frames() const { return static_cast<std::size_t>(options_.frames); }
    double time_s(std::size_t frame) const { return static_cast<double>(frame) * nominal_.dt_s; }
    /// Surface triangles whose centroid and outward normal satisfy `wanted`.
    template <class Wanted>
    Facets facets(Wanted wanted) const {
        Facets chosen;
        for (std::size_t t = 0; t < mesh_.surface().triangles().size(); ++t)
            if (const Point c = mesh_.centroid(t); wanted(c, shape_->normal(c))) chosen.push_back(c);
        return chosen;
    }
    /// Facets of a band in the order of its arc.
    Facets facets_of(const Band& band) const;

    /// The recording under a scenario. `control`: its motion, for frames before an event (else they are solved too).
    Result<Motion> simulate(const Scenario& scenario, const std::filesystem::path& scratch,
                            const Motion* control) const;
    /// The same at some frames, ascending: of a static body whose tissue does not creep each is what its loads make of
    /// it, whatever came before.
    Result<Motion> simulate_at(const Scenario& scenario, std::span<const std::size_t> frames,
                               const std::filesystem::path& scratch, const Motion* control) const;
    /// Rms displacement of the markers [m] under the scenario at one frame, small displacements, without the regions'
    /// loads.
    Result<double> linear_rms(Scenario scenario, std::size_t frame, const std::filesystem::path& scratch) const;

  private:
    TruthBody(const BodyOptions& options, std::shared_ptr<const BodyShape> shape, Random& random);
    void draw(Random& random);
    Status take(const Case& given, const MeshShape& shape, Random& random);
    Facets draw_attachment(const Case& given, const MeshShape& shape, Random& random) const;
    void place_loads(Random& random);
    void place_samples(Random& random);
    void believe(Random& random);
    Status scale_loads(const std::filesystem::path& scratch);
    Result<Motion> solve(const Scenario& scenario, std::span<const std::size_t> frames, bool after_event, bool linear,
                         const std::filesystem::path& scratch) const;

    BodyOptions options_;
    std::shared_ptr<const BodyShape> shape_;
    Band true_band_, prior_band_;
    TruthMesh mesh_;
    Facets clamp_;
    Point clamp_centre_m_{};
    std::vector<PatchLoad> regions_;
    Scenario control_;
    Case nominal_;
};

/// A hyperelastic law with this small-strain behaviour; none is the modeller's own form.
calculix::CalculixMaterial draw_law(double youngs_modulus_pa, double poissons_ratio, Random& random);

}  // namespace teres::blindtest
