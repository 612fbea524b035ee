// One line per change of state, never per frame (per-frame facts are messages and get recorded).
#pragma once

#include <string_view>

namespace teres {

enum class Level { kDebug = 0, kInfo = 1, kWarn = 2, kError = 3 };

/// [setup][loop] Writes to standard error (the journal under systemd). Thread-safe.
void log(Level level, std::string_view source, std::string_view text);
/// [setup] Messages below `level` are dropped; default kInfo.
void set_log_level(Level level);

}  // namespace teres
