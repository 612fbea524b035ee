// Finds, checks and loads plugin files. Nothing of a plugin runs before its version is known:
//
//     bytes of the file: ELF, symbol, magic, API version      (core/elf_entry.h, no code runs)
//  -> a child process loads it within a time limit            (a crash or hang in a constructor stays there)
//  -> this process loads it: RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE, never unloaded
//
// Errors (kInvalidInput) name the file, what was found and what is needed; a missing library is kHostFault.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "core/elf_entry.h"
#include "core/plugin.h"
#include "core/result.h"

namespace teres {

struct PluginFile {
    std::filesystem::path file;
    std::string name, version;  ///< as the plugin tells
    std::uint16_t api_major = 0, api_minor = 0;
    std::vector<const teres_factory*> factories;  ///< valid as long as the process lives

    /// The factory of this id, or null.
    const teres_factory* factory(std::string_view id) const;
};

/// What a child process may take to load a plugin (static constructors included).
inline constexpr std::chrono::milliseconds kProbeLimit{10'000};

/// Folders searched for plugins, in order: the given one (if not empty), then beside the program (build tree
/// and installed).
std::vector<std::filesystem::path> plugin_folders(const std::filesystem::path& given);
/// [setup] File of a unit: teres_<id>.so in the first folder that has it; an id with a '/' is the path
/// itself.
Result<std::filesystem::path> find_plugin(const std::string& id, std::span<const std::filesystem::path> folders);
/// [setup] Ids of all teres_<id>.so in the folders, sorted.
std::vector<std::string> available_plugins(std::span<const std::filesystem::path> folders);

/// [setup] Is the entry one that this host can read?
Status check_version(const std::string& name, const ElfEntry& entry);
/// [setup] Loads the file in a child process that is killed after `limit`.
Status probe_plugin(const std::filesystem::path& file, std::chrono::milliseconds limit = kProbeLimit);
/// [setup] Version, probe (unless already loaded), load.
Result<PluginFile> load_plugin(const std::filesystem::path& file, std::chrono::milliseconds limit = kProbeLimit);

}  // namespace teres
