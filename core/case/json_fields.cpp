#include "core/case/json_fields.h"

#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>
#include <vector>

#include "core/case/text_file.h"

namespace teres {
namespace {

constexpr std::size_t kMaxDepth = 16;
constexpr std::size_t kMaxValues = 10000;

// Input iterator that counts the line ends it has passed, so that every event of the parser knows its line.
class CountingIterator {
  public:
    using iterator_category = std::input_iterator_tag;
    using value_type = char;
    using difference_type = std::ptrdiff_t;
    using pointer = const char*;
    using reference = const char&;

    CountingIterator(const char* at, const char** passed) : at_(at), passed_(passed) {}
    reference operator*() const { return *at_; }
    CountingIterator& operator++() {
        ++at_;
        *passed_ = at_;
        return *this;
    }
    CountingIterator operator++(int) {
        CountingIterator before = *this;
        ++*this;
        return before;
    }
    bool operator==(const CountingIterator& other) const { return at_ == other.at_; }
    bool operator!=(const CountingIterator& other) const { return at_ != other.at_; }

  private:
    const char* at_;
    const char** passed_;
};

}  // namespace

// SAX events into the flat map; returns false (stop) on the first error.
class JsonFields::Handler {
  public:
    Handler(JsonFields& out, const char* begin, const char** passed)
        : error(out.name_ + ": not a JSON object"), out_(out), counted_(begin), passed_(passed) {}

    bool null() { return add({Kind::kNull}); }
    bool boolean(bool value) { return add({Kind::kBoolean, value ? 1.0 : 0.0}); }
    bool number_integer(std::int64_t value) { return add({Kind::kNumber, static_cast<double>(value), true}); }
    bool number_unsigned(std::uint64_t value) { return add({Kind::kNumber, static_cast<double>(value), true}); }
    bool number_float(double value, const std::string&) { return add({Kind::kNumber, value}); }
    bool string(std::string& value) { return add({Kind::kText, 0.0, false, value}); }
    bool binary(nlohmann::json::binary_t&) { return false; }
    bool start_object(std::size_t) { return open({Kind::kObject}); }
    bool start_array(std::size_t) { return open({Kind::kArray}); }
    bool end_object() { return close(); }
    bool end_array() { return close(); }
    bool key(std::string& value) {
        key_ = value;
        // '.' and '[' separate the parts of a path: no key of the format holds one
        if (!value.empty() && value.find_first_of(".[]") == std::string::npos) return true;
        error = out_.name_ + ":" + std::to_string(line()) + ": unknown key " + in_quotes(value);
        return false;
    }
    bool parse_error(std::size_t, const std::string& token, const nlohmann::detail::exception& exception) {
        std::string why = exception.what();
        if (const auto at = why.rfind(": "); at != std::string::npos && why.find("syntax error") != std::string::npos)
            why = why.substr(why.find("syntax error"));
        error = out_.name_ + ":" + std::to_string(line()) + ": not valid JSON at " + in_quotes(token) + ": " + why;
        return false;
    }

    std::string error;

  private:
    struct Level {
        std::string path;
        bool is_array;
        std::size_t count = 0;
    };

    // A number is known to be over only after the character behind it, which is therefore not counted.
    std::size_t line() {
        for (; counted_ + 1 < *passed_; ++counted_)
            if (*counted_ == '\n') ++line_;
        return line_;
    }
    std::string next_path() {
        if (levels_.empty()) return "";
        Level& top = levels_.back();
        if (top.is_array) return top.path + "[" + std::to_string(top.count++) + "]";
        return top.path.empty() ? key_ : top.path + "." + key_;
    }
    bool add(Value value) {
        const std::string path = next_path();
        value.line = line();
        if (levels_.empty() && value.kind != Kind::kObject) {
            error = out_.name_ + ":" + std::to_string(value.line) + ": not a JSON object";
            return false;
        }
        if (out_.values_.size() >= kMaxValues || levels_.size() > kMaxDepth) {
            error = out_.name_ + ":" + std::to_string(value.line) + ": more than " + std::to_string(kMaxValues) +
                    " values or " + std::to_string(kMaxDepth) + " levels";
            return false;
        }
        if (!out_.values_.emplace(path, std::move(value)).second) {
            error = out_.name_ + ":" + std::to_string(line()) + ": " + path + ": key appears twice";
            return false;
        }
        last_path_ = path;
        return true;
    }
    bool open(Value value) {
        const bool is_array = value.kind == Kind::kArray;
        if (!add(std::move(value))) return false;
        levels_.push_back({last_path_, is_array});
        return true;
    }
    bool close() {
        out_.values_[levels_.back().path].number = static_cast<double>(levels_.back().count);
        levels_.pop_back();
        return true;
    }

    JsonFields& out_;
    const char* counted_;
    const char** passed_;
    std::size_t line_ = 1;
    std::string key_;
    std::string last_path_;
    std::vector<Level> levels_;
};

Result<JsonFields> JsonFields::parse(std::string_view text, std::string name) {
    JsonFields out;
    out.name_ = std::move(name);
    text = without_byte_order_mark(text);
    if (text.find_first_not_of(" \t\r\n") == std::string_view::npos)
        return invalid_input(out.name_ + ":1: empty file, expected a JSON object");
    const char* passed = text.data();
    Handler handler(out, text.data(), &passed);
    const bool complete = nlohmann::json::sax_parse(CountingIterator(text.data(), &passed),
                                                    CountingIterator(text.data() + text.size(), &passed), &handler);
    if (!complete) return invalid_input(handler.error);
    out.values_[""].used = true;
    return out;
}

const char* JsonFields::kind_name(Kind kind) {
    switch (kind) {
        case Kind::kNull:
            return "null";
        case Kind::kBoolean:
            return "true or false";
        case Kind::kNumber:
            return "a number";
        case Kind::kText:
            return "a text";
        case Kind::kObject:
            return "an object";
        case Kind::kArray:
            return "an array";
    }
    return "";
}

tl::unexpected<Error> JsonFields::error_at(const std::string& path, const std::string& text) const {
    const auto found = values_.find(path);
    const std::string place = found == values_.end() ? name_ : name_ + ":" + std::to_string(found->second.line);
    return invalid_input(place + ": " + path + ": " + text);
}

bool JsonFields::has(const std::string& path) const {
    return values_.count(path) != 0;
}

Result<const JsonFields::Value*> JsonFields::find(const std::string& path, Kind kind) {
    // Objects on the way are known keys once something inside is asked for.
    for (std::size_t dot = path.find('.'); dot != std::string::npos; dot = path.find('.', dot + 1)) {
        const auto parent = values_.find(path.substr(0, dot));
        if (parent == values_.end()) continue;
        if (parent->second.kind != Kind::kObject)
            return error_at(parent->first,
                            std::string("is ") + kind_name(parent->second.kind) + ", expected an object");
        parent->second.used = true;
    }
    const auto found = values_.find(path);
    if (found == values_.end()) return error_at(path, "missing key");
    if (found->second.kind != kind)
        return error_at(path, std::string("is ") + kind_name(found->second.kind) + ", expected " + kind_name(kind));
    found->second.used = true;
    return &found->second;
}

Result<double> JsonFields::number(const std::string& path, Bound bound) {
    TERES_TRY_ASSIGN(const Value* value, find(path, Kind::kNumber));
    const double x = value->number;
    const bool above = bound.open_min ? x > bound.min : x >= bound.min;
    const bool below = bound.open_max ? x < bound.max : x <= bound.max;
    if (!std::isfinite(x) || !above || !below)
        return error_at(path, to_text(x) + " is outside " + std::string(1, bound.open_min ? '(' : '[') +
                                  to_text(bound.min) + ", " + to_text(bound.max) + (bound.open_max ? ")" : "]"));
    return x;
}

Result<double> JsonFields::number_or(const std::string& path, Bound bound, double otherwise) {
    if (!has(path)) return otherwise;
    return number(path, bound);
}

Result<int> JsonFields::integer(const std::string& path, int min, int max) {
    TERES_TRY_ASSIGN(const double value, number(path, {static_cast<double>(min), static_cast<double>(max)}));
    if (value != std::floor(value)) return error_at(path, to_text(value) + " is not an integer");
    return static_cast<int>(value);
}

Result<bool> JsonFields::boolean(const std::string& path) {
    TERES_TRY_ASSIGN(const Value* value, find(path, Kind::kBoolean));
    return value->number != 0.0;
}

Result<std::string> JsonFields::text(const std::string& path) {
    TERES_TRY_ASSIGN(const Value* value, find(path, Kind::kText));
    return value->text;
}

Result<std::string> JsonFields::text_or(const std::string& path, std::string otherwise) {
    if (!has(path)) return otherwise;
    return text(path);
}

Result<Point> JsonFields::point(const std::string& path, Bound bound) {
    TERES_TRY_ASSIGN(const Value* value, find(path, Kind::kArray));
    if (value->number != 3.0) return error_at(path, to_text(value->number) + " elements, expected 3");
    Point point{};
    for (std::size_t i = 0; i < 3; ++i) {
        TERES_TRY_ASSIGN(point[i], number(path + "[" + std::to_string(i) + "]", bound));
    }
    return point;
}

Status JsonFields::no_unknown_keys() const {
    for (const auto& [path, value] : values_)
        if (!value.used) return error_at(path, "unknown key");
    return {};
}

}  // namespace teres
