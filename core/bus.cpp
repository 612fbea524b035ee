#include "core/bus.h"

#include <lcm/lcm.h>
#include <poll.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <map>
#include <optional>
#include <vector>

#include "core/channel_pattern.h"
#include "core/check.h"
#include "core/clock.h"
#include "core/log.h"
#include "core/log_reader.h"
#include "core/stream_pacer.h"
#include "core/udpm_guard.h"

namespace teres {
namespace {

// A dispatch ends after this many messages even if handlers keep publishing: the loop stays bounded.
constexpr int kMaxMessagesPerDispatch = 1024;
// What memq:// may hold back; liblcm itself sets no bound.
constexpr std::size_t kMemqMessages = 4096;
constexpr std::size_t kMemqBytes = std::size_t{256} << 20;

std::int64_t epoch_us() {
    timespec t{};
    clock_gettime(CLOCK_REALTIME, &t);
    return static_cast<std::int64_t>(t.tv_sec) * 1'000'000 + t.tv_nsec / 1000;
}

}  // namespace

struct Bus::Impl {
    struct Subscription {
        explicit Subscription(ChannelPattern matching) : pattern(std::move(matching)) {}
        Impl* bus = nullptr;
        ChannelPattern pattern;
        std::size_t max_bytes = 0;
        Handler handler;
        bool threw = false;
    };

    // Sizes of the messages that wait in memq://, in order: a ring that never allocates in the loop.
    struct MemqQueue {
        std::vector<std::size_t> sizes = std::vector<std::size_t>(kMemqMessages);
        std::size_t head = 0, count = 0, bytes = 0;
        bool has_room(std::size_t size) const { return count < kMemqMessages && size <= kMemqBytes - bytes; }
        void push(std::size_t size) {
            sizes[(head + count) % kMemqMessages] = size;
            ++count;
            bytes += size;
        }
        void pop() {
            TERES_CHECK(count > 0);
            bytes -= sizes[head];
            head = (head + 1) % kMemqMessages;
            --count;
        }
    };

    ~Impl() {
        if (lcm != nullptr) lcm_destroy(lcm);
    }

    // One message to one subscription. Called below liblcm's C frames: whatever the handler throws ends here.
    void deliver(Subscription& subscription, const char* channel, std::span<const std::uint8_t> data,
                 std::int64_t receive_us) noexcept {
        if (data.size() > subscription.max_bytes) {
            ++counters.refused;
            return;
        }
        ++counters.received;
        ++delivered;
        try {
            subscription.handler(channel, data, receive_us);
        } catch (...) {
            ++counters.refused;
            if (!subscription.threw)
                log(Level::kError, "bus", std::string("handler of ") + channel + " threw; message dropped");
            subscription.threw = true;
        }
    }
    void deliver(Subscription& subscription, const char* channel, const lcm_recv_buf_t& buffer) noexcept {
        deliver(subscription, channel, {static_cast<const std::uint8_t*>(buffer.data), buffer.data_size},
                buffer.recv_utime + epoch_to_monotonic_us);
    }

    static void on_message(const lcm_recv_buf_t* buffer, const char* channel, void* user) noexcept {
        auto& subscription = *static_cast<Subscription*>(user);
        subscription.bus->deliver(subscription, channel, *buffer);
    }
    static void on_memq_message(const lcm_recv_buf_t* buffer, const char* channel, void* user) noexcept {
        auto& bus = *static_cast<Impl*>(user);
        for (Subscription* subscription : bus.listeners(channel)) bus.deliver(*subscription, channel, *buffer);
    }

    // memq:// hides from us whether it has queued a message (it drops what nobody wants), so that we match
    // ourselves: liblcm holds one subscription to everything and is handed only what somebody listens to.
    const std::vector<Subscription*>& listeners(const char* channel) {
        const auto known = listening.find(channel);
        if (known != listening.end()) return known->second;
        std::vector<Subscription*> found;
        for (const auto& s : subscriptions)
            if (s->pattern.matches(channel)) found.push_back(s.get());
        return listening.emplace(channel, std::move(found)).first->second;
    }

    tl::unexpected<Error> cannot_receive() const {
        return host_fault("bus url '" + url +
                          "': liblcm does not receive its own multicast; check that loopback is up, the route of the "
                          "group (`ip route get 239.255.76.67`) and firewall rules for its udp port");
    }

    // file://PATH[?speed=X[&mode=r]]
    Status open_log() {
        const std::string rest = url.substr(std::string_view("file://").size());
        const auto question = rest.find('?');
        double speed = 1.0;
        std::string options = question == std::string::npos ? "" : rest.substr(question + 1);
        while (!options.empty()) {
            const auto end = std::min(options.find_first_of(",&"), options.size());
            const std::string option = options.substr(0, end);
            options.erase(0, end + 1);
            char* rest_of_number = nullptr;
            if (option.starts_with("speed=")) {
                speed = std::strtod(option.c_str() + 6, &rest_of_number);
                if (rest_of_number == option.c_str() + 6 || *rest_of_number != '\0' || !(speed >= 0.0 && speed <= 1e6))
                    return invalid_input("bus url '" + url + "': " + option + " must be in [0, 1e6]");
            } else if (option != "mode=r") {
                return invalid_input("bus url '" + url + "': option '" + option + "' is not known (speed, mode)");
            }
        }
        pacer = StreamPacer(speed);
        TERES_TRY_ASSIGN(auto opened, LogReader::open(rest.substr(0, question)));
        log_reader.emplace(std::move(opened));
        return {};
    }

    // file:// for reading goes through our bounded reader; liblcm's crashes on a hostile length.
    int dispatch_log(int timeout_ms) noexcept {
        delivered = 0;
        for (int taken = 0; taken < kMaxMessagesPerDispatch; ++taken) {
            const std::int64_t now_us = monotonic_us();
            if (!event_loaded) {
                if (!log_reader->next(event)) {
                    if (!failed && !log_reader->damage().none()) log(Level::kWarn, "bus", log_reader->damage_text());
                    failed = true;
                    return delivered > 0 ? delivered : -1;
                }
                event_loaded = true;
                event_due_us = pacer.due_us(event.stamp_us, now_us);
            }
            const double wait_ms = (event_due_us - static_cast<double>(now_us)) / 1000.0;
            if (wait_ms > 0.0) {
                if (delivered > 0 || wait_ms > timeout_ms) {
                    if (delivered == 0 && timeout_ms > 0) poll(nullptr, 0, timeout_ms);
                    break;
                }
                poll(nullptr, 0, static_cast<int>(wait_ms) + 1);
            }
            event_loaded = false;
            const std::string channel(event.channel);
            for (Subscription* subscription : listeners(channel.c_str()))
                deliver(*subscription, channel.c_str(), event.data, event.stamp_us);
        }
        return delivered;
    }

    std::optional<LogReader> log_reader;
    StreamPacer pacer{1.0};
    LogEvent event;
    bool event_loaded = false;
    double event_due_us = 0.0;

    lcm_t* lcm = nullptr;
    std::string url;
    bool memq = false;
    bool udpm = false;
    bool failed = false;
    int fileno = -1;
    int delivered = 0;
    std::int64_t epoch_to_monotonic_us = 0;
    BusCounters counters;
    MemqQueue queue;
    std::vector<std::unique_ptr<Subscription>> subscriptions;
    std::map<std::string, std::vector<Subscription*>, std::less<>> listening;  // by channel; cleared by subscribe
};

Bus::Bus(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Bus::Bus(Bus&&) noexcept = default;
Bus& Bus::operator=(Bus&&) noexcept = default;
Bus::~Bus() = default;

Result<Bus> Bus::open(const std::string& url) {
    auto impl = std::make_unique<Impl>();
    impl->url = url;
    impl->memq = url.starts_with("memq://");
    impl->udpm = url.starts_with("udpm://");
    if (!impl->memq && !impl->udpm && !url.starts_with("file://"))
        return invalid_input("bus url '" + url + "': provider must be memq://, udpm:// or file://");
    if (url.starts_with("file://") && url.find("mode=w") == std::string::npos) {
        TERES_TRY(impl->open_log());
        return Bus(std::move(impl));
    }
    impl->lcm = lcm_create(url.c_str());
    if (impl->lcm == nullptr) {
        std::string remedy = "can the log file be written?";
        if (impl->udpm)
            remedy =
                "a multicast route is needed, e.g. `ip link set lo multicast on; ip route add "
                "239.255.76.67/32 dev lo`";
        return host_fault("bus url '" + url + "': liblcm refused it; " + remedy);
    }
    return Bus(std::move(impl));
}

Status Bus::subscribe(const std::string& channel, std::size_t max_bytes, Handler handler, int queue) {
    Impl& impl = *impl_;
    TERES_TRY_ASSIGN(ChannelPattern pattern, ChannelPattern::make(channel));
    auto subscription = std::make_unique<Impl::Subscription>(std::move(pattern));
    subscription->bus = impl_.get();
    subscription->max_bytes = max_bytes;
    subscription->handler = std::move(handler);
    if (impl.log_reader) {
        impl.subscriptions.push_back(std::move(subscription));
        impl.listening.clear();
        return {};
    }
    // liblcm puts ^ and $ around the expression: brackets keep a|b together.
    const std::string expression = impl.memq ? ".*" : "(" + channel + ")";
    if (!impl.memq || impl.subscriptions.empty()) {
        lcm_subscription_t* handle =
            impl.memq ? lcm_subscribe(impl.lcm, expression.c_str(), &Impl::on_memq_message, &impl)
                      : lcm_subscribe(impl.lcm, expression.c_str(), &Impl::on_message, subscription.get());
        if (handle == nullptr) return impl.cannot_receive();
        lcm_subscription_set_queue_capacity(handle, queue);
    }
    impl.subscriptions.push_back(std::move(subscription));
    impl.listening.clear();

    const bool first = impl.fileno < 0;
    // Starts the receiving side. A negative number means that liblcm could not hear itself: using it would
    // abort.
    impl.fileno = lcm_get_fileno(impl.lcm);
    if (impl.fileno < 0) return impl.cannot_receive();
    if (first && impl.udpm) guard_udpm_socket(impl.url);
    return {};
}

bool Bus::publish(std::string_view channel, std::span<const std::uint8_t> data) noexcept {
    Impl& impl = *impl_;
    std::array<char, LCM_MAX_CHANNEL_NAME_LENGTH + 1> name{};
    bool good =
        !channel.empty() && channel.size() < name.size() && data.size() <= kMaxMessageBytes && impl.lcm != nullptr;
    if (good) {
        std::memcpy(name.data(), channel.data(), channel.size());
        if (impl.memq) {
            if (impl.listeners(name.data()).empty()) return ++impl.counters.published, true;
            good = impl.queue.has_room(data.size());
        }
        good = good && lcm_publish(impl.lcm, name.data(), data.data(), static_cast<unsigned>(data.size())) == 0;
        if (impl.memq && good) impl.queue.push(data.size());
    }
    ++(good ? impl.counters.published : impl.counters.refused);
    return good;
}

int Bus::dispatch(int timeout_ms) noexcept {
    Impl& impl = *impl_;
    if (impl.failed) return -1;
    if (impl.log_reader) return impl.dispatch_log(timeout_ms);
    if (impl.fileno < 0) {  // nothing subscribed
        if (timeout_ms > 0) poll(nullptr, 0, timeout_ms);
        return 0;
    }
    // liblcm stamps with the wall clock; the rest of the house uses the monotonic one.
    impl.epoch_to_monotonic_us = monotonic_us() - epoch_us();
    impl.delivered = 0;
    int wait_ms = timeout_ms;
    for (int taken = 0; taken < kMaxMessagesPerDispatch; ++taken) {
        pollfd readable{impl.fileno, POLLIN, 0};  // not lcm_handle_timeout: its select() aborts above FD_SETSIZE
        if (poll(&readable, 1, wait_ms) <= 0) break;
        wait_ms = 0;
        if (impl.memq) impl.queue.pop();
        if (lcm_handle(impl.lcm) != 0) {
            impl.failed = true;
            return impl.delivered > 0 ? impl.delivered : -1;
        }
    }
    return impl.delivered;
}

const BusCounters& Bus::counters() const {
    return impl_->counters;
}
const std::string& Bus::url() const {
    return impl_->url;
}

}  // namespace teres
