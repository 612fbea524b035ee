#include "drivers/camera/calibration_file.h"

#include <cmath>
#include <sstream>

#define TOML_EXCEPTIONS 0
#include <toml++/toml.h>

namespace teres {
namespace {

// Reads numbers of one table; the first error wins.
class Numbers {
  public:
    Numbers(const toml::table& table, std::string file) : table_(table), file_(std::move(file)) {}

    double one(const char* key, std::optional<double> otherwise = {}) {
        const auto value = table_[key].value<double>();
        if (value && std::isfinite(*value)) return *value;
        if (!table_[key] && otherwise) return *otherwise;
        return fail(std::string(key) + " is missing or no number");
    }
    template <std::size_t N>
    void many(const char* key, double (&to)[N]) {
        if (!table_[key]) return;
        const toml::array* array = table_[key].as_array();
        if (array == nullptr || array->size() != N) {
            fail(std::string(key) + " must be " + std::to_string(N) + " numbers");
            return;
        }
        for (std::size_t i = 0; i < N; ++i) {
            const auto value = array->at(i).value<double>();
            to[i] = value && std::isfinite(*value) ? *value : fail(std::string(key) + " holds no number");
        }
    }
    void within(const char* key, double value, double low, double high) {
        if (value < low || value > high) fail(std::string(key) + " is out of [" + text(low) + ", " + text(high) + "]");
    }
    Status status() const { return error_.empty() ? Status() : Status(invalid_input(error_)); }

  private:
    static std::string text(double value) {
        std::ostringstream stream;
        stream << value;
        return stream.str();
    }
    double fail(const std::string& what) {
        if (error_.empty()) error_ = file_ + ": " + what;
        return 0.0;
    }
    const toml::table& table_;
    std::string file_, error_;
};

}  // namespace

Result<std::optional<camera_info_t>> read_calibration(const std::filesystem::path& folder, const std::string& serial,
                                                      int width_px, int height_px) {
    const std::filesystem::path file = folder / (serial + ".toml");
    std::error_code failure;
    if (folder.empty() || serial.empty() || serial.find('/') != std::string::npos ||
        !std::filesystem::is_regular_file(file, failure))
        return std::nullopt;
    const toml::parse_result parsed = toml::parse_file(file.string());
    if (!parsed) {
        std::ostringstream text;
        text << file.string() << ":" << parsed.error().source().begin.line << ": " << parsed.error().description();
        return invalid_input(text.str());
    }
    Numbers numbers(parsed.table(), file.string());
    camera_info_t info{};
    info.serial = serial;
    info.width_px = width_px;
    info.height_px = height_px;
    const double width = numbers.one("width_px"), height = numbers.one("height_px");
    numbers.within("width_px", width, 1, 16384);
    numbers.within("height_px", height, 1, 16384);
    info.fx_px = numbers.one("fx_px");
    info.fy_px = numbers.one("fy_px");
    info.cx_px = numbers.one("cx_px");
    info.cy_px = numbers.one("cy_px");
    numbers.many("distortion", info.distortion);
    info.depth_unit_m = numbers.one("depth_unit_m", 0.0);
    info.baseline_m = numbers.one("baseline_m", 0.0);
    info.rotation[0] = info.rotation[4] = info.rotation[8] = 1.0;
    numbers.many("rotation", info.rotation);
    numbers.many("translation_m", info.translation_m);
    numbers.within("fx_px", info.fx_px, 1e-3, 1e6);
    numbers.within("fy_px", info.fy_px, 1e-3, 1e6);
    numbers.within("cx_px", info.cx_px, -width, 2 * width);
    numbers.within("cy_px", info.cy_px, -height, 2 * height);
    numbers.within("depth_unit_m", info.depth_unit_m, 0.0, 0.1);
    numbers.within("baseline_m", info.baseline_m, 0.0, 1.0);
    TERES_TRY(numbers.status());
    info.reference_frame = parsed.table()["reference_frame"].value_or(std::string());
    const double scale = width_px / width;
    if (std::abs(scale - height_px / height) > 1e-3 * scale)
        return invalid_input(file.string() + ": calibrated at " + std::to_string(static_cast<int>(width)) + "x" +
                             std::to_string(static_cast<int>(height)) + ", the stream of " + std::to_string(width_px) +
                             "x" + std::to_string(height_px) + " has another aspect ratio");
    info.fx_px *= scale;
    info.fy_px *= scale;
    // Pixel centres at integers: the image's corner lies at -0.5.
    info.cx_px = (info.cx_px + 0.5) * scale - 0.5;
    info.cy_px = (info.cy_px + 0.5) * scale - 0.5;
    return info;
}

}  // namespace teres
