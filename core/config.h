// The settings file (TOML) in memory. [service] is the runtime's own section, every other table is the
// section of the unit of that name and is checked against the unit's setting table (core/plugin.h): key,
// type, closed range, choices. Errors read `phantom.toml:5: simulation.spring_k1 is not a known setting (did
// you mean spring_k1_n_per_m?)`.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "core/plugin.h"
#include "core/result.h"

namespace teres {

/// Section [service]. Paths are absolute or empty after reading.
struct ServiceSettings {
    std::vector<std::string> drivers = {"replay"};                   ///< ids, or paths of .so files
    std::vector<std::string> plugins = {"simulation", "estimator"};  ///< loaded and stepped in this order
    std::string bus_url = "memq://";
    std::filesystem::path case_folder;    // key `case`
    std::filesystem::path plugin_folder;  ///< searched before the places beside the program
    std::filesystem::path record_to;
    double record_max_mb = 0.0;
    bool record_overwrite = false;
    double health_period_s = 1.0;
    double stale_after_s = 1.0;
    double idle_wait_ms = 1.0;
    bool watchdog = true;
    bool stop_when_finished = true;
    bool lock_memory = false;

    template <class V>
    void visit(V& field) {
        field("bus_url", bus_url, "", "memq:// in process, udpm://239.255.76.67:7667?ttl=0 between processes");
        field("case", case_folder, "case folder handed to every unit that has a setting `case`");
        field("plugin_folder", plugin_folder, "folder of teres_<id>.so files, before the places beside the program");
        field("record_to", record_to, "LCM log that receives every message, may hold %Y%m%d-%H%M%S; empty: none");
        field("record_max_mb", record_max_mb, {0.0, 1e7}, "size at which recording ends; 0: no limit");
        field("record_overwrite", record_overwrite, "replace an existing log (otherwise an error)");
        field("health_period_s", health_period_s, {0.0, 3600.0}, "time between HEALTH messages; 0: none");
        field("stale_after_s", stale_after_s, {0.01, 3600.0}, "a live driver silent for longer is stale");
        field("idle_wait_ms", idle_wait_ms, {0.0, 100.0}, "longest wait for a message when nothing is to do");
        field("watchdog", watchdog, "answer the service manager's watchdog from the loop");
        field("stop_when_finished", stop_when_finished, "end when every driver's stream has ended");
        field("lock_memory", lock_memory, "keep all pages in memory (mlockall)");
    }
};

/// The settings of one unit, complete and checked; owns the texts that `values` points to.
struct ResolvedSettings {
    std::vector<teres_setting_value> values;
    std::vector<std::unique_ptr<const std::string>> texts;  // by address: moving this keeps `values` true
    /// The same text, kept as long as this.
    const char* keep(std::string text) {
        return texts.emplace_back(std::make_unique<const std::string>(std::move(text)))->c_str();
    }
};

class Config {
  public:
    /// [setup] Defaults only, no file.
    Config() = default;
    /// [setup] Errors (kInvalidInput): unreadable, malformed, wrong [service].
    static Result<Config> read(const std::filesystem::path& file);
    /// [setup] `name` stands in the error texts; relative paths are taken from `folder`.
    static Result<Config> parse(std::string_view text, const std::string& name, const std::filesystem::path& folder);

    /// [setup] "section.key=value", above the file. Relative paths are taken from the working folder; lists
    /// (service.drivers, service.plugins) are comma-separated. `place` stands in the error texts.
    Status set(std::string_view assignment, const std::string& place = "--set");

    /// [setup] Whether the file or an override says so, right or wrong.
    bool given(const std::string& section, const std::string& key) const;
    const ServiceSettings& service() const { return service_; }
    /// [setup] Sections besides [service], each with the place where it first appears.
    std::map<std::string, std::string> sections() const;
    /// [setup] Values of `section` by its table; defaults where nothing is given; `case` of [service] where
    /// the table has a text or path `case` that is not given.
    Result<ResolvedSettings> resolve(const std::string& section, std::span<const teres_setting> table) const;

  private:
    struct Untyped {
        std::string text;  // of an override; the table says how to read it
    };
    struct WrongType {
        std::string name;  // of a TOML type that no setting has
    };
    struct Given {
        std::variant<bool, std::int64_t, double, std::string, std::vector<std::string>, Untyped, WrongType> value;
        std::string place;             // "phantom.toml:5"
        std::filesystem::path folder;  // of relative paths
    };
    using Section = std::map<std::string, Given>;

    Status read_service();
    Result<std::vector<std::string>> read_list(const std::string& key, std::vector<std::string> otherwise) const;
    static Result<teres_setting_value> checked(const std::string& name, const Given& given,
                                               const teres_setting& setting, ResolvedSettings& keeper);

    ServiceSettings service_;
    std::map<std::string, Section> sections_;
    std::map<std::string, std::string> section_places_;
};

/// Table of [service], without the lists `drivers` and `plugins`.
std::span<const teres_setting> service_table();

/// The candidate that a typing error most likely meant, or empty.
std::string closest_name(const std::string& given, std::span<const std::string> candidates);

}  // namespace teres
