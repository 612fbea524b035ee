// C++ side of core/plugin.h, header only: derive from Unit, describe Settings once, end plugin.cpp with TERES_PLUGIN.
//
//     struct Settings {
//         double spring_k1_n_per_m = 100.0;
//         std::string law = "cubic";
//         template <class V> void visit(V& field) {
//             field("spring_k1_n_per_m", spring_k1_n_per_m, {0.0, 1e9}, "linear stiffness");
//             field("law", law, "linear|cubic", "spring law");
//         }
//     };
//     class SpringPlugin : public teres::Unit { public: using Settings = ::Settings; explicit
//     SpringPlugin(teres::Host); ... }; TERES_PLUGIN(SpringPlugin, "spring", "one spring", TERES_UNIT_PLUGIN)
#pragma once

#include <cstring>
#include <exception>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "core/plugin.h"
#include "core/result.h"

/// Version of the plugin itself, told in the log; plugins of this tree carry the version of Teres.
#ifndef TERES_PLUGIN_VERSION
#ifdef TERES_VERSION
#define TERES_PLUGIN_VERSION TERES_VERSION
#else
#define TERES_PLUGIN_VERSION "unversioned"
#endif
#endif

namespace teres {

struct Range {
    double min, max;
};

/// What a unit may ask of its host. Copyable; valid while the unit lives.
class Host {
  public:
    explicit Host(const teres_host* host) : host_(host) {}

    void log(teres_log_level level, std::string_view source, std::string_view text) const {
        host_->log(host_->context, level, std::string(source).c_str(), std::string(text).c_str());
    }
    std::int64_t now_us() const { return host_->now_us(host_->context); }

    /// [loop] Encodes an LCM message and publishes it.
    template <class Message>
    bool publish(const char* channel, const Message& message) {
        buffer_.resize(static_cast<std::size_t>(message.getEncodedSize()));
        if (message.encode(buffer_.data(), 0, static_cast<int>(buffer_.size())) < 0) return false;
        return publish_bytes(channel, buffer_);
    }
    /// [loop] Publishes a message that is encoded already. False if it was refused.
    bool publish_bytes(const char* channel, std::span<const std::uint8_t> data) const {
        return host_->publish(host_->context, channel, data.data(), data.size()) == 0;
    }

    /// [setup] Calls `handler(message, receive_us)` for every well-formed message; malformed ones are dropped.
    /// The generated decoders are bounded by the packet (core/messages/CMakeLists.txt).
    template <class Message>
    Status subscribe(const char* channel, std::size_t max_bytes,
                     std::function<void(const Message&, std::int64_t)> handler) {
        struct Subscription : SubscriptionBase {
            std::function<void(const Message&, std::int64_t)> handler;
            Message message;
        };
        auto subscription = std::make_shared<Subscription>();
        subscription->handler = std::move(handler);
        const auto trampoline = [](void* user, const char*, const void* data, std::size_t size,
                                   std::int64_t receive_us) {
            auto* self = static_cast<Subscription*>(user);
            try {
                if (self->message.decode(data, 0, static_cast<int>(size)) >= 0)
                    self->handler(self->message, receive_us);
            } catch (const std::exception&) {  // a handler must not throw; a bad message must not stop the loop
            }
        };
        if (host_->subscribe(host_->context, channel, max_bytes, trampoline, subscription.get()) != 0)
            return host_fault(std::string("cannot subscribe to channel ") + channel);
        subscriptions_->push_back(std::move(subscription));
        return {};
    }

    /// [setup] Interface T (with T::kId) of a unit started before this one, or null.
    template <class T>
    T* extension() const {
        return static_cast<T*>(host_->extension(host_->context, T::kId));
    }

  private:
    struct SubscriptionBase {
        virtual ~SubscriptionBase() = default;
    };
    const teres_host* host_;
    std::vector<std::uint8_t> buffer_;
    std::shared_ptr<std::vector<std::shared_ptr<SubscriptionBase>>> subscriptions_ =
        std::make_shared<std::vector<std::shared_ptr<SubscriptionBase>>>();
};

/// Base of plugins and drivers. The derived class has a `Settings` type and a member `settings` of it.
class Unit {
  public:
    virtual ~Unit() = default;
    virtual Status configure() = 0;                                     ///< [setup] `settings` is filled
    virtual Status start() { return {}; }                               ///< [setup]
    virtual teres_step_outcome step(std::int64_t now_us) noexcept = 0;  ///< [loop]
    virtual void stop() {}                                              ///< [setup]
    virtual void* extension(std::string_view) { return nullptr; }       ///< [setup]
};

namespace sdk {

// Lists the settings of a Settings type with their defaults.
class SettingLister {
  public:
    void operator()(const char* key, double& value, Range range, const char* help) {
        add({key, help, nullptr, nullptr, value, range.min, range.max, TERES_SETTING_NUMBER});
    }
    void operator()(const char* key, int& value, Range range, const char* help) {
        add({key, help, nullptr, nullptr, static_cast<double>(value), range.min, range.max, TERES_SETTING_INTEGER});
    }
    void operator()(const char* key, bool& value, const char* help) {
        add({key, help, nullptr, nullptr, value ? 1.0 : 0.0, 0.0, 1.0, TERES_SETTING_BOOLEAN});
    }
    void operator()(const char* key, std::string& value, const char* choices, const char* help) {
        texts.push_back(std::make_unique<std::string>(value));
        add({key, help, texts.back()->c_str(), choices, 0.0, 0.0, 0.0, TERES_SETTING_TEXT});
    }
    void operator()(const char* key, std::filesystem::path& value, const char* help) {
        texts.push_back(std::make_unique<std::string>(value.string()));
        add({key, help, texts.back()->c_str(), nullptr, 0.0, 0.0, 0.0, TERES_SETTING_PATH});
    }
    std::vector<teres_setting> list;

  private:
    void add(teres_setting setting) { list.push_back(setting); }
    std::vector<std::unique_ptr<std::string>> texts;
};

// Copies resolved values into a Settings object.
class SettingFiller {
  public:
    explicit SettingFiller(std::span<const teres_setting_value> values) : values_(values) {}
    void operator()(const char* key, double& value, Range, const char*) {
        if (const auto* v = find(key)) value = v->number;
    }
    void operator()(const char* key, int& value, Range, const char*) {
        if (const auto* v = find(key)) value = static_cast<int>(v->number);
    }
    void operator()(const char* key, bool& value, const char*) {
        if (const auto* v = find(key)) value = v->number != 0.0;
    }
    void operator()(const char* key, std::string& value, const char*, const char*) {
        if (const auto* v = find(key)) value = v->text;
    }
    void operator()(const char* key, std::filesystem::path& value, const char*) {
        if (const auto* v = find(key)) value = v->text;
    }

  private:
    const teres_setting_value* find(const char* key) const {
        for (const auto& v : values_)
            if (std::strcmp(v.key, key) == 0) return &v;
        return nullptr;
    }
    std::span<const teres_setting_value> values_;
};

template <class U>
struct UnitAdapter {
    static SettingLister& lister() {
        static SettingLister instance = [] {
            SettingLister l;
            typename U::Settings defaults;
            defaults.visit(l);
            return l;
        }();
        return instance;
    }
    static void* create(const teres_host* host) {
        try {
            return static_cast<Unit*>(new U(Host(host)));
        } catch (...) {
            return nullptr;
        }
    }
    template <class F>
    static std::int32_t guarded(char* error, std::size_t error_size, F&& call) {
        Error failure{ErrorKind::kHostFault, ""};
        try {
            const Status status = call();
            if (status) return 0;
            failure = status.error();
        } catch (const std::exception& e) {
            failure.text = e.what();
        } catch (...) {
            failure.text = "unknown exception";
        }
        if (error_size > 0) {
            std::strncpy(error, failure.text.c_str(), error_size - 1);
            error[error_size - 1] = '\0';
        }
        return static_cast<std::int32_t>(failure.kind);
    }
    static std::int32_t configure(void* self, const teres_setting_value* values, std::size_t count, char* error,
                                  std::size_t error_size) {
        return guarded(error, error_size, [&]() -> Status {
            auto* unit = static_cast<U*>(static_cast<Unit*>(self));
            unit->settings = typename U::Settings{};
            SettingFiller filler({values, count});
            unit->settings.visit(filler);
            return unit->configure();
        });
    }
    static std::int32_t start(void* self, char* error, std::size_t error_size) {
        return guarded(error, error_size, [&] { return static_cast<Unit*>(self)->start(); });
    }
    static std::int32_t step(void* self, std::int64_t now_us) { return static_cast<Unit*>(self)->step(now_us); }
    static void stop(void* self) {
        try {
            static_cast<Unit*>(self)->stop();
        } catch (...) {
        }
    }
    static void destroy(void* self) { delete static_cast<Unit*>(self); }
    static void* extension(void* self, const char* id) { return static_cast<Unit*>(self)->extension(id); }

    static teres_factory factory(const char* id, const char* summary, teres_unit_kind kind) {
        auto& l = lister();
        return {sizeof(teres_factory),
                kind,
                id,
                summary,
                l.list.data(),
                l.list.size(),
                &create,
                &configure,
                &start,
                &step,
                &stop,
                &destroy,
                &extension};
    }
};

}  // namespace sdk
}  // namespace teres

/// Last line of plugin.cpp: exports the entry with one factory.
#define TERES_PLUGIN(UnitType, unit_id, unit_summary, unit_kind)                                           \
    namespace {                                                                                            \
    const teres_factory teres_the_factory =                                                                \
        teres::sdk::UnitAdapter<UnitType>::factory(unit_id, unit_summary, unit_kind);                      \
    const teres_factory* const teres_the_factories[] = {&teres_the_factory};                               \
    }                                                                                                      \
    extern "C" __attribute__((visibility("default"))) const teres_plugin_entry_t teres_plugin_entry;       \
    const teres_plugin_entry_t teres_plugin_entry = {                                                      \
        TERES_PLUGIN_MAGIC,   sizeof(teres_plugin_entry_t), TERES_API_MAJOR, TERES_API_MINOR, 1u, unit_id, \
        TERES_PLUGIN_VERSION, teres_the_factories};
