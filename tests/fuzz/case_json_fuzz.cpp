// Any bytes as case.json: an error or a header within its bounds, never a crash.
#include <cmath>
#include <cstdint>
#include <string_view>

#include "core/case/case_reader.h"
#include "core/check.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    teres::Case c;
    const auto status = teres::parse_case_json({reinterpret_cast<const char*>(data), size}, "case.json", c);
    if (!status) {
        TERES_CHECK(status.error().text.rfind("case.json", 0) == 0);
        return 0;
    }
    TERES_CHECK(c.num_frames >= 1 && c.dt_s > 0.0);
    TERES_CHECK(c.body.youngs_modulus_pa > 0.0 && c.body.poissons_ratio > -1.0 && c.body.poissons_ratio < 0.5);
    TERES_CHECK(!c.ligament || c.ligament->height_m > 0.0);
    for (const double g : c.gravity_m_s2) TERES_CHECK(std::isfinite(g));
    return 0;
}
