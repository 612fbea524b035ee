// The event log reader on arbitrary files: it ends, its views stay inside the file, its books balance.
#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <string>

#include "core/log_reader.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const int fd = memfd_create("log", 0);
    if (fd < 0 || write(fd, data, size) != static_cast<ssize_t>(size)) std::abort();
    auto reader = teres::LogReader::open("/proc/self/fd/" + std::to_string(fd));
    close(fd);
    if (!reader) return 0;
    for (int pass = 0; pass < 2; ++pass) {
        teres::LogEvent event;
        std::int64_t used = 0, end = 0;
        unsigned sum = 0;
        while (reader->next(event)) {
            if (event.offset < end) std::abort();
            const auto bytes = static_cast<std::int64_t>(28 + event.channel.size() + event.data.size());
            end = event.offset + bytes;
            used += bytes;
            if (end > static_cast<std::int64_t>(size)) std::abort();
            for (const char c : event.channel) sum += static_cast<unsigned char>(c);
            for (const std::uint8_t b : event.data) sum += b;
        }
        const teres::LogDamage& damage = reader->damage();
        const std::int64_t cut = damage.truncated_at < 0 ? 0 : static_cast<std::int64_t>(size) - damage.truncated_at;
        if (used + damage.skipped_bytes + cut != static_cast<std::int64_t>(size)) std::abort();
        if (damage.none() != reader->damage_text().empty()) std::abort();
        volatile unsigned keep = sum;
        (void)keep;
        reader->rewind();
    }
    return 0;
}
