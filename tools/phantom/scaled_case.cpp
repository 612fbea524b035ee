#include "tools/phantom/scaled_case.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/case/case_reader.h"
#include "core/case/case_writer.h"
#include "core/case/geometry.h"

namespace teres::phantom {
namespace {

// f(s d) = s² f_1(d): coefficients of a law in d [m] go with s^(2 - power of d); those of a law in strain with s².
std::array<double, 3> scaled(const SpringData& spring, double s) {
    auto k = spring.k;
    for (std::size_t i = 0; i < 3; ++i) {
        double power = 2.0;
        if (spring.law == SpringLaw::kLinear || spring.law == SpringLaw::kRestShape) power = 1.0;
        if (spring.law == SpringLaw::kCubic) power = static_cast<double>(i) - 1.0;  // d³, d², d
        k[i] *= std::pow(s, power);
    }
    return k;
}

}  // namespace

Status write_scaled_case(const Case& c, double scale, const std::filesystem::path& folder) {
    if (!c.quasi_static)
        return invalid_input((c.folder / "case.json").string() +
                             ": time.quasi_static is false: a body that swings is not alike in another size");
    Point low = c.mesh.nodes.front(), high = low;
    for (const Point& x : c.mesh.nodes)
        for (std::size_t a = 0; a < 3; ++a) {
            low[a] = std::min(low[a], x[a]);
            high[a] = std::max(high[a], x[a]);
        }
    const Point middle = times(0.5, plus(low, high));
    const auto shrink = [&](Point& x) { x = plus(middle, times(scale, minus(x, middle))); };

    Case out = c;
    for (Point& x : out.mesh.nodes) shrink(x);
    for (auto* points : {&out.markers, &out.validation_rest})
        for (MarkerRest& p : *points) shrink(p.position_m);
    for (PositionSample& row : out.observations) shrink(row.position_m);
    for (ToolSample& sample : out.tool_samples) shrink(sample.position_m);
    for (LoadSample& load : out.loads) load.force_n = times(scale * scale, load.force_n);
    for (ToolTie& tie : out.tools) tie.stiffness_n_per_m *= scale;
    for (SpringData& spring : out.springs) {
        shrink(spring.anchor_m);
        spring.k = scaled(spring, scale);
        spring.rest_length_m *= scale;
    }
    if (out.ligament)
        for (double* length : {&out.ligament->height_m, &out.ligament->width_m, &out.ligament->thickness_m})
            *length *= scale;
    out.body.density_kg_m3 /= scale;
    out.sensor.noise_sigma_m *= scale;
    out.stream.clear();
    TERES_TRY(write_case(out, folder));

    TERES_TRY_ASSIGN(auto truth, read_positions(c.folder / "validation.csv", "point_id"));
    for (PositionSample& row : truth) shrink(row.position_m);
    return write_positions(folder / "validation.csv", "point_id", truth);
}

}  // namespace teres::phantom
