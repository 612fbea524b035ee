// A run for ParaView: one legacy VTK unstructured grid per frame and a `.vtk.series` file that gives the
// times.
//
// Points are current positions: the body's nodes, then the springs' anchors. Cells: tetrahedra (part 0) and
// lines from node to anchor (part 1). Point data: displacement_m, attachment_probability. Cell data: part,
// stiffness_n_per_m, tension_n (0 on tetrahedra).
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/case/case.h"
#include "core/result.h"

namespace teres {

struct VtkSpring {
    std::int32_t node_id = 0;
    Point anchor_m{};
    double stiffness_n_per_m = 0.0;
    double tension_n = 0.0;
};

struct VtkFrame {
    double t_s = 0.0;
    std::span<const double> positions_m;             ///< 3 per node of the mesh
    std::span<const double> attachment_probability;  ///< one per node, or empty: not written
    std::span<const VtkSpring> springs;
};

class VtkSeries {
  public:
    /// Files <folder>/<name>_0000.vtk ...; the folder is made. `mesh` must outlive this.
    static Result<VtkSeries> make(const std::filesystem::path& folder, std::string name, const TetMeshData& mesh);
    /// Errors: kInvalidInput if a size does not match the mesh, kHostFault if the file cannot be written.
    Status add(const VtkFrame& frame);
    /// Writes <folder>/<name>.vtk.series, the file to open in ParaView, and returns its path.
    Result<std::filesystem::path> finish() const;

  private:
    VtkSeries(std::filesystem::path folder, std::string name, const TetMeshData& mesh)
        : folder_(std::move(folder)), name_(std::move(name)), mesh_(&mesh) {}

    std::filesystem::path folder_;
    std::string name_;
    const TetMeshData* mesh_;
    std::vector<std::pair<std::string, double>> files_;  // name, time [s]
};

}  // namespace teres
