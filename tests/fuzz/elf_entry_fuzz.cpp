// Any bytes as a plugin file: read without running or mapping them, never a crash, never unbounded memory.
#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <string>

#include "core/check.h"
#include "core/elf_entry.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static const int file = memfd_create("fuzz", 0);
    static const std::string name = "/proc/self/fd/" + std::to_string(file);
    TERES_CHECK(ftruncate(file, 0) == 0 && pwrite(file, data, size, 0) == static_cast<ssize_t>(size));
    const auto entry = teres::read_elf_entry(name);
    TERES_CHECK(entry || entry.error().text.rfind(name, 0) == 0);
    return 0;
}
