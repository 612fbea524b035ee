// Any bytes as mesh.vtk, then what follows on a mesh that was accepted: checks, surface, closest point.
#include <cmath>
#include <cstdint>

#include "core/case/case_reader.h"
#include "core/case/geometry.h"
#include "core/case/mesh_checks.h"
#include "core/case/surface.h"
#include "core/check.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const std::string_view text(reinterpret_cast<const char*>(data), size);
    const auto any_order = teres::parse_vtk_tets(text, "mesh.vtk", true);
    const auto mesh = teres::parse_vtk_tets(text, "mesh.vtk");
    if (!mesh) TERES_CHECK(mesh.error().text.rfind("mesh.vtk:", 0) == 0);
    if (!any_order) return 0;
    for (const auto& tet : any_order->tets)
        for (const std::int32_t id : tet)
            TERES_CHECK(id >= 0 && static_cast<std::size_t>(id) < any_order->nodes.size());
    TERES_CHECK(any_order->region.empty() || any_order->region.size() == any_order->tets.size());
    if (!mesh || !teres::check_body_mesh(*mesh, "mesh.vtk")) return 0;
    const teres::Surface surface(*mesh);
    const auto found = surface.closest(mesh->nodes[0]);
    TERES_CHECK(std::isfinite(found.distance_m));
    return 0;
}
