#include "core/recorder.h"

#include <fmt/format.h>
#include <lcm/lcm.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <deque>
#include <mutex>
#include <thread>
#include <vector>

#include "core/bus.h"
#include "core/log.h"

namespace teres {
namespace {

using namespace std::chrono_literals;
constexpr auto kSyncPeriod = 1s;
constexpr std::int64_t kEventOverhead = 28;  // bytes of an event besides channel and data

struct Item {
    std::int64_t stamp_us = 0;
    std::array<char, LCM_MAX_CHANNEL_NAME_LENGTH + 1> channel{};
    std::int32_t channel_bytes = 0;
    std::vector<std::uint8_t> data;
    std::size_t cost() const { return sizeof(Item) + data.size(); }
};

}  // namespace

struct Recorder::Impl {
    explicit Impl(const RecorderSettings& given) : settings(given) {}

    ~Impl() {
        {
            const std::lock_guard lock(mutex);
            closing = true;
        }
        wake.notify_one();
        if (writer.joinable()) writer.join();
        close_file();
    }

    std::filesystem::path file_name(int index) const {
        if (settings.split_mb == 0) return settings.file;
        std::string suffix = std::to_string(index);
        return settings.file.string() + "." + std::string(suffix.size() < 2 ? 2 - suffix.size() : 0, '0') + suffix;
    }

    Status open_file() {
        const auto name = file_name(file_index);
        if (!settings.overwrite && std::filesystem::exists(std::filesystem::symlink_status(name)))
            return invalid_input("recording " + name.string() + ": the file exists; choose another name");
        log_file = lcm_eventlog_create(name.c_str(), "w");
        if (log_file == nullptr) return host_fault("recording " + name.string() + ": " + std::strerror(errno));
        file_bytes = 0;
        return {};
    }

    void close_file() {
        if (log_file == nullptr) return;
        lcm_eventlog_destroy(log_file);
        log_file = nullptr;
    }

    // ---- writer thread ----

    void run() {
        auto last_sync = std::chrono::steady_clock::now();
        std::deque<Item> batch;
        for (;;) {
            bool last = false;
            {
                std::unique_lock lock(mutex);
                wake.wait_for(lock, kSyncPeriod, [&] { return closing || !queue.empty(); });
                batch.swap(queue);
                writing = !batch.empty();
                last = closing && batch.empty();
            }
            for (Item& item : batch) {
                if (!stopped) write(item);
                queued_bytes -= item.cost();
                if (stopped) ++dropped;
            }
            if (!batch.empty() && !stopped && fflush(log_file->f) != 0) stop(std::strerror(errno));
            const auto now = std::chrono::steady_clock::now();
            if (!stopped && (last || now - last_sync >= kSyncPeriod)) {
                if (written_bytes != synced_bytes && fdatasync(fileno(log_file->f)) != 0 && errno != EINVAL)
                    stop(std::strerror(errno));
                synced_bytes = written_bytes;
                last_sync = now;
            }
            batch.clear();
            {
                const std::lock_guard lock(mutex);
                writing = false;
            }
            idle.notify_all();
            if (last) return;
        }
    }

    void write(Item& item) {
        const std::int64_t size = kEventOverhead + item.channel_bytes + static_cast<std::int64_t>(item.data.size());
        if (settings.max_mb > 0 && written_bytes + size > settings.max_mb << 20)
            return stop("the limit of " + std::to_string(settings.max_mb) + " MB is reached");
        if (settings.split_mb > 0 && file_bytes > 0 && file_bytes + size > settings.split_mb << 20 && !next_file())
            return;
        lcm_eventlog_event_t event{};
        event.timestamp = item.stamp_us;
        event.channellen = item.channel_bytes;
        event.datalen = static_cast<std::int32_t>(item.data.size());
        event.channel = item.channel.data();
        event.data = item.data.data();
        log_file->eventcount = written;  // numbers go on over a split
        // Flushed one by one: a killed process loses nothing that was written, and on a full disk the length
        // of the sound part is known.
        if (lcm_eventlog_write_event(log_file, &event) != 0 || fflush(log_file->f) != 0)
            return stop(std::strerror(errno));
        file_bytes += size;
        written_bytes += size;
        ++written;
    }

    bool next_file() {
        if (fflush(log_file->f) != 0) return stop(std::strerror(errno)), false;
        close_file();
        ++file_index;
        if (const Status opened = open_file(); !opened) return stop(opened.error().text), false;
        if (settings.keep > 0 && file_index >= settings.keep) {
            std::error_code ignored;
            std::filesystem::remove(file_name(file_index - settings.keep), ignored);
        }
        return true;
    }

    // Closes the log at the end of its last whole event; the service goes on.
    void stop(const std::string& reason) {
        close_file();
        std::error_code ignored;
        const auto name = file_name(file_index);
        if (std::filesystem::is_regular_file(name, ignored))
            std::filesystem::resize_file(name, static_cast<std::uintmax_t>(file_bytes), ignored);
        {
            const std::lock_guard lock(mutex);
            stop_reason = name.string() + ": " + reason;
        }
        stopped = true;
        log(Level::kError, "recorder",
            "ALARM: recording stopped, " + name.string() + ": " + reason + "; " + std::to_string(written) +
                " messages are safe, the service goes on");
    }

    const RecorderSettings settings;
    lcm_eventlog_t* log_file = nullptr;
    int file_index = 0;
    std::int64_t file_bytes = 0;
    std::int64_t synced_bytes = 0;

    std::mutex mutex;  // guards queue, closing, writing, stop_reason
    std::condition_variable wake, idle;
    std::deque<Item> queue;
    bool closing = false;
    bool writing = false;
    std::string stop_reason;
    std::atomic<std::size_t> queued_bytes = 0;
    std::atomic<std::int64_t> written = 0, written_bytes = 0, dropped = 0;
    std::atomic<bool> stopped = false;
    std::thread writer;
};

Recorder::Recorder(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Recorder::Recorder(Recorder&&) noexcept = default;
Recorder& Recorder::operator=(Recorder&&) noexcept = default;
Recorder::~Recorder() = default;

Result<Recorder> Recorder::open(const RecorderSettings& settings) {
    if (settings.file.empty()) return invalid_input("recording: the file name is empty");
    if (settings.split_mb < 0 || settings.max_mb < 0 || settings.keep < 0)
        return invalid_input("recording " + settings.file.string() +
                             ": split_mb, max_mb and keep must not be negative");
    if (settings.keep > 0 && settings.split_mb == 0)
        return invalid_input("recording " + settings.file.string() + ": keep needs split_mb > 0");
    auto impl = std::make_unique<Impl>(settings);
    TERES_TRY(impl->open_file());
    impl->writer = std::thread([raw = impl.get()] { raw->run(); });
    return Recorder(std::move(impl));
}

bool Recorder::record(std::string_view channel, std::span<const std::uint8_t> data, std::int64_t stamp_us) noexcept {
    Impl& impl = *impl_;
    const bool sound =
        !channel.empty() && channel.size() <= LCM_MAX_CHANNEL_NAME_LENGTH && data.size() <= kMaxMessageBytes;
    if (!sound || impl.stopped || impl.queued_bytes + sizeof(Item) + data.size() > impl.settings.queue_bytes) {
        ++impl.dropped;
        return false;
    }
    try {
        Item item;
        item.stamp_us = stamp_us;
        item.channel_bytes = static_cast<std::int32_t>(channel.size());
        std::memcpy(item.channel.data(), channel.data(), channel.size());
        item.data.assign(data.begin(), data.end());
        const std::size_t cost = item.cost();
        const std::lock_guard lock(impl.mutex);  // the writer holds it for a swap only
        impl.queue.push_back(std::move(item));
        impl.queued_bytes += cost;
    } catch (const std::bad_alloc&) {
        ++impl.dropped;
        return false;
    }
    impl.wake.notify_one();
    return true;
}

RecorderCounters Recorder::counters() const {
    return {impl_->written, impl_->written_bytes, impl_->dropped, impl_->stopped};
}

std::string Recorder::stop_reason() const {
    const std::lock_guard lock(impl_->mutex);
    return impl_->stop_reason;
}

void Recorder::flush() {
    std::unique_lock lock(impl_->mutex);
    impl_->idle.wait(lock, [&] { return impl_->queue.empty() && !impl_->writing; });
}

std::int64_t Recorder::wall_clock_us() {
    using namespace std::chrono;
    static const auto offset = system_clock::now().time_since_epoch() - steady_clock::now().time_since_epoch();
    return duration_cast<microseconds>(steady_clock::now().time_since_epoch() + offset).count();
}

}  // namespace teres
