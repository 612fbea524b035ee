// The values of a JSON object by path ("body.law", "gravity_m_s2[2]"), each with its line; duplicate and
// unknown keys are found. One getter per type; an error names file, line, path, value and bound.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "core/case/case.h"
#include "core/result.h"

namespace teres {

class JsonFields {
  public:
    /// Bound of a number; `open_min` / `open_max` leave out the end.
    struct Bound {
        double min, max;
        bool open_min = false, open_max = false;
    };

    static Result<JsonFields> parse(std::string_view text, std::string name);

    bool has(const std::string& path) const;
    Result<double> number(const std::string& path, Bound bound);
    Result<double> number_or(const std::string& path, Bound bound, double otherwise);
    Result<int> integer(const std::string& path, int min, int max);
    Result<bool> boolean(const std::string& path);
    Result<std::string> text(const std::string& path);
    Result<std::string> text_or(const std::string& path, std::string otherwise);
    /// Exactly three numbers, each within `bound`.
    Result<Point> point(const std::string& path, Bound bound);
    /// Error unless every value of the file has been asked for.
    Status no_unknown_keys() const;
    /// Error text at a path: "case.json:12: body.alpha: " + text.
    tl::unexpected<Error> error_at(const std::string& path, const std::string& text) const;

  private:
    enum class Kind { kNull, kBoolean, kNumber, kText, kObject, kArray };
    struct Value {
        Kind kind = Kind::kNull;
        double number = 0.0;  // also 0 or 1 of a boolean, number of elements of an array
        bool is_integer = false;
        std::string text{};
        std::size_t line = 0;
        bool used = false;
    };
    class Handler;

    Result<const Value*> find(const std::string& path, Kind kind);
    static const char* kind_name(Kind kind);

    std::string name_;
    std::map<std::string, Value> values_;
};

}  // namespace teres
