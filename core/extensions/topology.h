// Cuts in the body of a running forward model: tissue is parted, ligaments let go, the loop goes on. Offered by a unit
// beside its teres.forward_model/1 (same state, same markers, same parameters: their numbers do not change).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace teres {

enum class CutOutcome {
    kDone,
    kUnknownIndex,  ///< a tetrahedron or parameter that does not exist: nothing changed
    kNothingHolds,  ///< nothing of the body would still be held: nothing changed
    kNotSupported,  ///< the model's elements cannot be cut: nothing changed
};

struct CutReport {
    CutOutcome outcome = CutOutcome::kDone;
    std::int32_t tets_removed = 0;  ///< by this cut, with the pieces that nothing holds any more
};

class Topology {
  public:
    static constexpr const char* kId = "teres.topology/1";

    /// [loop] From the next advance() on: tetrahedra (of mesh.vtk; those gone already are passed over) are taken away,
    /// and with them every piece that nothing holds any more; the ligaments or springs of the parameters act on
    /// nothing. Nodes without tissue rest where they were at first; a load whose nodes are partly gone acts on those
    /// that are left.
    virtual CutReport cut(std::span<const std::int32_t> tets, std::span<const std::int32_t> parameters) noexcept = 0;
    /// [loop] The marker (index of the forward model) went with the tissue it sat on.
    virtual bool marker_lost(std::size_t index) const noexcept = 0;

  protected:
    ~Topology() = default;
};

}  // namespace teres
