#include "tools/peer_bench/json_lookup.h"

#include <cctype>
#include <cmath>

#include "core/case/text_file.h"
#include "tools/peer_bench/scene.h"

namespace teres::peer {

std::string plain(std::string_view text) {
    std::string out;
    for (const char c : text)
        if (std::isalnum(static_cast<unsigned char>(c)))
            out += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return out;
}

Result<Json> JsonObject::parse_file(const std::filesystem::path& file) {
    TERES_TRY_ASSIGN(const std::string text, read_text_file(file));
    try {
        Json json = Json::parse(text);
        if (!json.is_object()) return invalid_input(file.string() + ": not a JSON object");
        return json;
    } catch (const Json::exception& e) {
        return invalid_input(file.string() + ": " + e.what());
    }
}

const Json* JsonObject::find(Keys keys) const {
    const Json* found = nullptr;
    for (const char* key : keys) {
        asked_.insert(key);
        const auto at = value_->find(key);
        if (found == nullptr && at != value_->end() && !at->is_null()) found = &*at;
    }
    return found;
}

std::string JsonObject::place(Keys keys) const {
    for (const char* key : keys)
        if (value_->contains(key)) return where_ + ": " + key;
    return where_ + ": " + *keys.begin();
}

tl::unexpected<Error> JsonObject::error(Keys keys, const std::string& text) const {
    return invalid_input(place(keys) + ": " + text);
}

Result<double> JsonObject::check(const Json& value, Keys keys, double min, double max) const {
    if (!value.is_number()) return error(keys, "is not a number: " + value.dump().substr(0, 60));
    const double number = value.get<double>();
    if (!(number >= min && number <= max))
        return error(keys, to_text(number) + " is not in [" + to_text(min) + ", " + to_text(max) + "]");
    return number;
}

Result<double> JsonObject::number(Keys keys, double min, double max) const {
    const Json* value = find(keys);
    if (value == nullptr) return error(keys, "is missing");
    return check(*value, keys, min, max);
}

Result<double> JsonObject::number_or(Keys keys, double min, double max, double otherwise) const {
    const Json* value = find(keys);
    if (value == nullptr) return otherwise;
    return check(*value, keys, min, max);
}

Result<int> JsonObject::integer(Keys keys, int min, int max) const {
    TERES_TRY_ASSIGN(const double value, number(keys, min, max));
    if (value != std::floor(value)) return error(keys, to_text(value) + " is not an integer");
    return static_cast<int>(value);
}

Result<int> JsonObject::integer_or(Keys keys, int min, int max, int otherwise) const {
    if (!has(keys)) return otherwise;
    return integer(keys, min, max);
}

Result<bool> JsonObject::boolean_or(Keys keys, bool otherwise) const {
    const Json* value = find(keys);
    if (value == nullptr) return otherwise;
    if (!value->is_boolean()) return error(keys, "is neither true nor false: " + value->dump().substr(0, 60));
    return value->get<bool>();
}

Result<std::string> JsonObject::text(Keys keys) const {
    const Json* value = find(keys);
    if (value == nullptr) return error(keys, "is missing");
    if (!value->is_string()) return error(keys, "is not a text: " + value->dump().substr(0, 60));
    return value->get<std::string>();
}

Result<Eigen::Vector3d> JsonObject::vector3(Keys keys) const {
    if (!has(keys)) return error(keys, "is missing");
    TERES_TRY_ASSIGN(const Eigen::VectorXd values, numbers(keys, 3));
    if (!find(keys)->is_array()) return error(keys, "is not a list of three numbers");
    return Eigen::Vector3d(values);
}

Result<Eigen::VectorXd> JsonObject::numbers(Keys keys, Eigen::Index count) const {
    const Json* value = find(keys);
    if (value == nullptr) return error(keys, "is missing");
    constexpr double kHuge = 1e300;
    if (value->is_number()) {
        TERES_TRY_ASSIGN(const double one, check(*value, keys, -kHuge, kHuge));
        return Eigen::VectorXd(Eigen::VectorXd::Constant(count, one));
    }
    if (!value->is_array() || static_cast<Eigen::Index>(value->size()) != count)
        return error(keys, "is not a list of " + std::to_string(count) + " numbers: " + value->dump().substr(0, 60));
    Eigen::VectorXd out(count);
    for (Eigen::Index i = 0; i < count; ++i) {
        TERES_TRY_ASSIGN(out(i), check((*value)[static_cast<std::size_t>(i)], keys, -kHuge, kHuge));
    }
    return out;
}

Result<std::vector<std::string>> JsonObject::texts(Keys keys) const {
    const Json* value = find(keys);
    if (value == nullptr) return error(keys, "is missing");
    std::vector<std::string> out;
    const auto add = [&](const Json& one) -> Status {
        if (!one.is_string()) return error(keys, "is not a text or a list of texts: " + value->dump().substr(0, 60));
        out.push_back(one.get<std::string>());
        return {};
    };
    if (value->is_array()) {
        for (const Json& one : *value) TERES_TRY(add(one));
    } else {
        TERES_TRY(add(*value));
    }
    return out;
}

Result<JsonObject> JsonObject::object(Keys keys) const {
    const Json* value = find(keys);
    if (value == nullptr) return error(keys, "is missing");
    if (!value->is_object()) return error(keys, "is not an object: " + value->dump().substr(0, 60));
    return JsonObject(value, place(keys));
}

Result<std::vector<JsonObject>> JsonObject::objects(Keys keys) const {
    std::vector<JsonObject> out;
    const Json* value = find(keys);
    if (value == nullptr) return out;
    if (value->is_object()) {
        out.emplace_back(value, place(keys));
        return out;
    }
    if (!value->is_array())
        return error(keys, "is neither an object nor a list of objects: " + value->dump().substr(0, 60));
    for (std::size_t i = 0; i < value->size(); ++i) {
        if (!(*value)[i].is_object()) return error(keys, "entry " + std::to_string(i) + " is not an object");
        out.emplace_back(&(*value)[i], place(keys) + "[" + std::to_string(i) + "]");
    }
    return out;
}

Result<int> JsonObject::row_offset(Keys keys) const {
    const Json* value = find(keys);
    if (value == nullptr) return error(keys, "is missing");
    if (value->is_string()) {
        std::string text;
        for (const char c : value->get<std::string>())
            if (c != ' ' && c != '+') text += c;
        if (text == "k") return 0;
        if (text.rfind("k", 0) == 0) {
            const auto offset = parse_integer(std::string_view(text).substr(1));
            if (offset && std::abs(*offset) <= 1000) return static_cast<int>(*offset);
        }
    }
    return error(keys, "is not a row like \"k\", \"k-1\" or \"k+1\": " + value->dump().substr(0, 60));
}

Result<std::vector<StepRange>> JsonObject::step_ranges(Keys keys) const {
    std::vector<StepRange> out;
    const Json* value = find(keys);
    if (value == nullptr) return out;
    const auto bad = [&] { return error(keys, "is not a range of steps [from, to]: " + value->dump().substr(0, 60)); };
    if (!value->is_array()) return bad();
    const auto add = [&](const Json& pair) -> Status {
        if (!pair.is_array() || pair.size() != 2) return bad();
        StepRange range;
        for (std::size_t i = 0; i < 2; ++i) {
            if (pair[i].is_null()) continue;
            if (!pair[i].is_number_integer() || pair[i].get<long>() < 0 || pair[i].get<long>() > 1000000000)
                return bad();
            (i == 0 ? range.first : range.last) = pair[i].get<int>();
        }
        out.push_back(range);
        return {};
    };
    const bool nested = !value->empty() && (*value)[0].is_array();
    if (!nested) {
        TERES_TRY(add(*value));
    } else {
        for (const Json& pair : *value) TERES_TRY(add(pair));
    }
    return out;
}

void JsonObject::report_unknown(std::vector<std::string>& warnings) const {
    static const std::set<std::string> kRemarks{"note",        "notes",   "comment", "comments", "remark",
                                                "description", "source",  "title",   "licence",  "license",
                                                "name",        "remarks", "_comment"};
    for (auto at = value_->begin(); at != value_->end(); ++at)
        if (!asked_.count(at.key()) && !kRemarks.count(plain(at.key())) && !at->is_null())
            warnings.push_back(where_ + ": " + at.key() + " is not known and has no effect");
}

}  // namespace teres::peer
