// Any bytes as a settings file and as an override: an error that names its place, or values within their
// bounds.
#include <cmath>
#include <cstdint>
#include <string_view>

#include "core/check.h"
#include "core/config.h"

namespace {

const teres_setting kTable[] = {
    {"gain", "", nullptr, nullptr, 1.0, 0.0, 10.0, TERES_SETTING_NUMBER},
    {"count", "", nullptr, nullptr, 1.0, -3.0, 64.0, TERES_SETTING_INTEGER},
    {"on", "", nullptr, nullptr, 1.0, 0.0, 1.0, TERES_SETTING_BOOLEAN},
    {"law", "", "a", "a|b", 0.0, 0.0, 0.0, TERES_SETTING_TEXT},
    {"case", "", "", nullptr, 0.0, 0.0, 0.0, TERES_SETTING_PATH},
};

void look(const teres::Config& config) {
    const auto resolved = config.resolve("unit", kTable);
    if (!resolved) {
        TERES_CHECK(resolved.error().text.find("unit.") != std::string::npos);
        return;
    }
    TERES_CHECK(resolved->values.size() == 5);
    TERES_CHECK(resolved->values[0].number >= 0.0 && resolved->values[0].number <= 10.0);
    TERES_CHECK(resolved->values[1].number >= -3.0 && resolved->values[1].number <= 64.0);
    TERES_CHECK(resolved->values[1].number == std::trunc(resolved->values[1].number));
    TERES_CHECK(resolved->values[2].number == 0.0 || resolved->values[2].number == 1.0);
    const std::string_view law = resolved->values[3].text, folder = resolved->values[4].text;
    TERES_CHECK(law == "a" || law == "b");
    TERES_CHECK(folder.empty() || folder.front() == '/');
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const std::string_view text(reinterpret_cast<const char*>(data), size);
    const auto config = teres::Config::parse(text, "fuzz.toml", "/etc/teres");
    if (config)
        look(*config);
    else
        TERES_CHECK(config.error().text.rfind("fuzz.toml:", 0) == 0);
    teres::Config overridden;
    if (overridden.set(text)) look(overridden);
    return 0;
}
