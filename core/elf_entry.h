// What a shared object says of itself before any of its code runs: the first fields of `teres_plugin_entry`,
// read from the bytes of the file. The entry must therefore be constant data (TERES_PLUGIN makes it so).
#pragma once

#include <cstdint>
#include <filesystem>

#include "core/result.h"

namespace teres {

struct ElfEntry {
    std::uint32_t magic = 0;
    std::uint32_t struct_size = 0;
    std::uint16_t api_major = 0;
    std::uint16_t api_minor = 0;
};

/// [setup] Errors (kInvalidInput): not an ELF shared object of this machine, truncated, no such symbol, not
/// constant.
Result<ElfEntry> read_elf_entry(const std::filesystem::path& file);

}  // namespace teres
