// Keys of a JSON object by their synonyms, with errors that name file and key; keys never asked for are
// reported.
#pragma once

#include <Eigen/Core>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "core/result.h"

namespace teres::peer {

using Json = nlohmann::ordered_json;

/// "Implicit Euler" -> "impliciteuler": letters and digits in lower case.
std::string plain(std::string_view text);

class JsonObject {
  public:
    /// `where`: "scene.json: generator"; `file` alone for the top.
    JsonObject(const Json* value, std::string where) : value_(value), where_(std::move(where)) {}
    static Result<Json> parse_file(const std::filesystem::path& file);

    using Keys = std::initializer_list<const char*>;
    /// The value under the first synonym present; nullptr if absent or null.
    const Json* find(Keys keys) const;
    bool has(Keys keys) const { return find(keys) != nullptr; }

    Result<double> number(Keys keys, double min, double max) const;
    Result<double> number_or(Keys keys, double min, double max, double otherwise) const;
    Result<int> integer(Keys keys, int min, int max) const;
    Result<int> integer_or(Keys keys, int min, int max, int otherwise) const;
    Result<bool> boolean_or(Keys keys, bool otherwise) const;
    Result<std::string> text(Keys keys) const;
    Result<Eigen::Vector3d> vector3(Keys keys) const;
    /// `count` numbers; one number stands for all of them.
    Result<Eigen::VectorXd> numbers(Keys keys, Eigen::Index count) const;
    /// A group name or a list of them.
    Result<std::vector<std::string>> texts(Keys keys) const;
    Result<JsonObject> object(Keys keys) const;
    /// One object or a list of them.
    Result<std::vector<JsonObject>> objects(Keys keys) const;
    /// "k", "k-1", "k+2" -> 0, -1, 2.
    Result<int> row_offset(Keys keys) const;
    /// null -> empty; [a, b] -> one range; [[a, b], ...]; null at an end: open.
    Result<std::vector<struct StepRange>> step_ranges(Keys keys) const;

    tl::unexpected<Error> error(Keys keys, const std::string& text) const;
    std::string place(Keys keys) const;
    const Json& json() const { return *value_; }
    const std::string& where() const { return where_; }
    /// Keys never looked up, except remarks.
    void report_unknown(std::vector<std::string>& warnings) const;

  private:
    Result<double> check(const Json& value, Keys keys, double min, double max) const;
    const Json* value_;
    std::string where_;
    mutable std::set<std::string> asked_;
};

}  // namespace teres::peer
