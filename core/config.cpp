#include "core/config.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <set>
#include <sstream>

#include "core/plugin_sdk.h"

#define TOML_HEADER_ONLY 1
#define TOML_EXCEPTIONS 0
#include <toml++/toml.h>

namespace teres {
namespace {

constexpr std::size_t kMaxFileBytes = 1 << 20;

struct ServiceUnit {
    using Settings = ServiceSettings;
};

std::string number_text(double value) {
    std::ostringstream text;
    text.precision(15);
    text << value;
    return text.str();
}

std::size_t edit_distance(const std::string& a, const std::string& b) {
    std::vector<std::size_t> row(b.size() + 1);
    for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
    for (std::size_t i = 1; i <= a.size(); ++i) {
        std::size_t diagonal = row[0];
        row[0] = i;
        for (std::size_t j = 1; j <= b.size(); ++j) {
            const std::size_t replaced = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
            diagonal = row[j];
            row[j] = std::min({row[j] + 1, row[j - 1] + 1, replaced});
        }
    }
    return row[b.size()];
}

std::string did_you_mean(const std::string& given, std::span<const std::string> candidates) {
    const std::string name = closest_name(given, candidates);
    return name.empty() ? std::string{} : " (did you mean " + name + "?)";
}

Result<double> read_number(const std::string& text) {
    double value = 0.0;
    const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (failure != std::errc{} || end != text.data() + text.size()) return invalid_input("");
    return value;
}

std::vector<std::string> split_list(const std::string& text) {
    std::vector<std::string> items;
    std::istringstream stream(text);
    for (std::string item; std::getline(stream, item, ',');) {
        const auto first = item.find_first_not_of(" \t");
        if (first == std::string::npos) continue;
        items.push_back(item.substr(first, item.find_last_not_of(" \t") - first + 1));
    }
    return items;
}

std::string type_name(toml::node_type type) {
    std::ostringstream text;
    text << type;
    return text.str();
}

std::string absolute_path(const std::string& text, const std::filesystem::path& folder) {
    if (text.empty()) return {};
    const std::filesystem::path path(text);
    return (path.is_absolute() ? path : folder / path).lexically_normal().string();
}

}  // namespace

std::span<const teres_setting> service_table() {
    return sdk::UnitAdapter<ServiceUnit>::lister().list;
}

std::string closest_name(const std::string& given, std::span<const std::string> candidates) {
    std::string best;
    std::size_t best_distance = std::max<std::size_t>(2, given.size() / 3) + 1;
    for (const std::string& candidate : candidates) {
        // A name cut short (the unit left out) is meant even where many letters are missing.
        const bool cut_short = given.size() >= 3 && candidate.starts_with(given);
        const std::size_t distance = cut_short ? 1 : edit_distance(given, candidate);
        if (distance < best_distance) {
            best = candidate;
            best_distance = distance;
        }
    }
    return best;
}

Result<Config> Config::read(const std::filesystem::path& file) {
    std::error_code failure;
    if (!std::filesystem::is_regular_file(file, failure))
        return invalid_input(file.string() + ": no such settings file");
    std::ifstream stream(file, std::ios::binary);
    if (!stream) return invalid_input(file.string() + ": cannot be read");
    std::string text(kMaxFileBytes + 1, '\0');
    stream.read(text.data(), static_cast<std::streamsize>(text.size()));
    text.resize(static_cast<std::size_t>(stream.gcount()));
    if (text.size() > kMaxFileBytes)
        return invalid_input(file.string() + ": above the bound of 1 MiB for a settings file");
    return parse(text, file.string(), std::filesystem::absolute(file, failure).parent_path());
}

Result<Config> Config::parse(std::string_view text, const std::string& name, const std::filesystem::path& folder) {
    const toml::parse_result parsed = toml::parse(text, name);
    if (!parsed) {
        const toml::parse_error& error = parsed.error();
        return invalid_input(name + ":" + std::to_string(error.source().begin.line) + ": " +
                             std::string(error.description()));
    }
    Config config;
    for (const auto& [section_key, section_node] : parsed.table()) {
        const std::string section(section_key.str());
        const auto place_of = [&](const toml::node& node, const toml::key& key) {
            const auto line = node.source().begin.line > 0 ? node.source().begin.line : key.source().begin.line;
            return name + ":" + std::to_string(line);
        };
        const std::string section_place = place_of(section_node, section_key);
        const toml::table* table = section_node.as_table();
        if (table == nullptr)
            return invalid_input(section_place + ": " + section +
                                 " stands outside of a section; write it below a [section]");
        config.section_places_.emplace(section, section_place);
        for (const auto& [key, node] : *table) {
            Given given{WrongType{type_name(node.type())}, place_of(node, key), folder};
            if (const auto* text_value = node.as_string()) given.value = text_value->get();
            if (const auto* boolean = node.as_boolean()) given.value = boolean->get();
            if (const auto* integer = node.as_integer()) given.value = integer->get();
            if (const auto* number = node.as_floating_point()) given.value = number->get();
            if (const auto* array = node.as_array()) {
                std::vector<std::string> items;
                bool all_text = true;
                for (const toml::node& item : *array) {
                    if (const auto* item_text = item.as_string())
                        items.push_back(item_text->get());
                    else
                        all_text = false;
                }
                if (all_text) given.value = std::move(items);
            }
            config.sections_[section].insert_or_assign(std::string(key.str()), std::move(given));
        }
    }
    TERES_TRY(config.read_service());
    return config;
}

Status Config::set(std::string_view assignment, const std::string& place) {
    const std::string text(assignment);
    const auto equals = text.find('=');
    const auto dot = text.find('.');
    if (equals == std::string::npos || dot == std::string::npos || dot == 0 || dot > equals || dot + 1 == equals)
        return invalid_input(place + " " + text + ": not of the form section.key=value");
    const std::string section = text.substr(0, dot);
    std::error_code ignored;
    Config changed = *this;
    changed.section_places_.emplace(section, place);
    changed.sections_[section].insert_or_assign(
        text.substr(dot + 1, equals - dot - 1),
        Given{Untyped{text.substr(equals + 1)}, place, std::filesystem::current_path(ignored)});
    if (section == "service") TERES_TRY(changed.read_service());
    *this = std::move(changed);
    return {};
}

bool Config::given(const std::string& section, const std::string& key) const {
    const auto found = sections_.find(section);
    return found != sections_.end() && found->second.contains(key);
}

std::map<std::string, std::string> Config::sections() const {
    std::map<std::string, std::string> units = section_places_;
    units.erase("service");
    return units;
}

Result<std::vector<std::string>> Config::read_list(const std::string& key, std::vector<std::string> otherwise) const {
    const auto section = sections_.find("service");
    if (section == sections_.end()) return otherwise;
    const auto found = section->second.find(key);
    if (found == section->second.end()) return otherwise;
    std::vector<std::string> items;
    if (const auto* list = std::get_if<std::vector<std::string>>(&found->second.value))
        items = *list;
    else if (const auto* untyped = std::get_if<Untyped>(&found->second.value))
        items = split_list(untyped->text);
    else
        return invalid_input(found->second.place + ": service." + key + " must be a list of texts, e.g. [\"replay\"]");
    for (std::string& item : items) {
        if (item.empty()) return invalid_input(found->second.place + ": service." + key + " holds an empty name");
        if (item.find('/') != std::string::npos) item = absolute_path(item, found->second.folder);
    }
    return items;
}

Status Config::read_service() {
    TERES_TRY_ASSIGN(service_.drivers, read_list("drivers", ServiceSettings{}.drivers));
    TERES_TRY_ASSIGN(service_.plugins, read_list("plugins", ServiceSettings{}.plugins));
    std::set<std::string> seen;
    for (const auto* list : {&service_.drivers, &service_.plugins})
        for (const std::string& unit : *list)
            if (!seen.insert(unit).second)
                return invalid_input(section_places_["service"] + ": unit " + unit + " is named twice in [service]");

    Config scalars = *this;
    Section& section = scalars.sections_["service"];
    section.erase("drivers");
    section.erase("plugins");
    // `case` of [service] itself must not be taken for its own default.
    scalars.service_.case_folder.clear();
    TERES_TRY_ASSIGN(const ResolvedSettings resolved, scalars.resolve("service", service_table()));
    sdk::SettingFiller filler(resolved.values);
    service_.visit(filler);
    return {};
}

Result<ResolvedSettings> Config::resolve(const std::string& section, std::span<const teres_setting> table) const {
    static const Section kNothing;
    const auto found = sections_.find(section);
    const Section& given = found == sections_.end() ? kNothing : found->second;

    std::vector<std::string> keys;
    for (const teres_setting& setting : table) keys.emplace_back(setting.key);
    if (section == "service") keys.insert(keys.end(), {"drivers", "plugins"});
    for (const auto& [key, value] : given)
        if (std::find(keys.begin(), keys.end(), key) == keys.end())
            return invalid_input(value.place + ": " + section + "." + key + " is not a known setting" +
                                 did_you_mean(key, keys));

    ResolvedSettings resolved;
    for (const teres_setting& setting : table) {
        const bool is_text = setting.type == TERES_SETTING_TEXT || setting.type == TERES_SETTING_PATH;
        const auto entry = given.find(setting.key);
        if (entry != given.end()) {
            TERES_TRY_ASSIGN(const teres_setting_value value,
                             checked(section + "." + setting.key, entry->second, setting, resolved));
            resolved.values.push_back(value);
        } else if (is_text && std::string_view(setting.key) == "case" && !service_.case_folder.empty()) {
            resolved.values.push_back({setting.key, resolved.keep(service_.case_folder.string()), 0.0, setting.type});
        } else {
            const char* text = is_text && setting.default_text != nullptr ? setting.default_text : "";
            resolved.values.push_back({setting.key, resolved.keep(text), setting.default_number, setting.type});
        }
    }
    return resolved;
}

Result<teres_setting_value> Config::checked(const std::string& name, const Given& given, const teres_setting& setting,
                                            ResolvedSettings& keeper) {
    const auto wrong_type = [&](const std::string& needed) -> Result<teres_setting_value> {
        struct Shown {
            std::string operator()(bool value) const { return value ? "true" : "false"; }
            std::string operator()(std::int64_t value) const { return std::to_string(value); }
            std::string operator()(double value) const { return number_text(value); }
            std::string operator()(const std::string& value) const { return "\"" + value + "\""; }
            std::string operator()(const std::vector<std::string>&) const { return "(a list)"; }
            std::string operator()(const Untyped& value) const { return value.text; }
            std::string operator()(const WrongType& value) const { return "(" + value.name + ")"; }
        };
        return invalid_input(given.place + ": " + name + " = " + std::visit(Shown{}, given.value) + " is not " +
                             needed);
    };
    const auto* untyped = std::get_if<Untyped>(&given.value);
    teres_setting_value value{setting.key, "", 0.0, setting.type};

    if (setting.type == TERES_SETTING_TEXT || setting.type == TERES_SETTING_PATH) {
        const auto* text = std::get_if<std::string>(&given.value);
        if (text == nullptr && untyped == nullptr) return wrong_type("a text in quotes");
        std::string chosen = text != nullptr ? *text : untyped->text;
        if (chosen.find('\0') != std::string::npos) return wrong_type("a text without zero bytes");
        const std::string choices =
            setting.type == TERES_SETTING_TEXT && setting.choices != nullptr ? setting.choices : "";
        if (!choices.empty() && ("|" + choices + "|").find("|" + chosen + "|") == std::string::npos)
            return wrong_type("one of " + choices);
        // `case` is a folder by convention even where the unit takes it as a text.
        if (setting.type == TERES_SETTING_PATH || std::string_view(setting.key) == "case")
            chosen = absolute_path(chosen, given.folder);
        value.text = keeper.keep(std::move(chosen));
        return value;
    }
    if (setting.type == TERES_SETTING_BOOLEAN) {
        if (const auto* boolean = std::get_if<bool>(&given.value)) {
            value.number = *boolean ? 1.0 : 0.0;
        } else if (untyped != nullptr && (untyped->text == "true" || untyped->text == "false")) {
            value.number = untyped->text == "true" ? 1.0 : 0.0;
        } else {
            return wrong_type("true or false");
        }
        return value;
    }
    const bool whole = setting.type == TERES_SETTING_INTEGER;
    const std::string needed = whole ? "a whole number" : "a number";
    if (const auto* integer = std::get_if<std::int64_t>(&given.value)) {
        value.number = static_cast<double>(*integer);
    } else if (const auto* number = std::get_if<double>(&given.value); number != nullptr && !whole) {
        value.number = *number;
    } else if (untyped != nullptr) {
        const Result<double> read = read_number(untyped->text);
        if (!read || (whole && *read != std::trunc(*read))) return wrong_type(needed);
        value.number = *read;
    } else {
        return wrong_type(needed);
    }
    if (std::isnan(value.number)) return wrong_type(needed);
    if (value.number > setting.max)
        return invalid_input(given.place + ": " + name + " = " + number_text(value.number) + " is above the bound " +
                             number_text(setting.max));
    if (value.number < setting.min)
        return invalid_input(given.place + ": " + name + " = " + number_text(value.number) + " is below the bound " +
                             number_text(setting.min));
    return value;
}

}  // namespace teres
