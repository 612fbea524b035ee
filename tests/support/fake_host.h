// A host for one unit, without bus or service: keeps what the unit publishes and logs, and refuses when told
// to.
#pragma once

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <cstdlib>
#include <string>
#include <vector>

#include "core/plugin.h"
#include "core/run_hash.h"

namespace teres::test {

struct Published {
    std::string channel;
    std::vector<std::uint8_t> data;
};

class FakeHost {
  public:
    FakeHost() {
        host_.struct_size = sizeof host_;
        host_.context = this;
        host_.log = [](void* self, std::int32_t, const char*, const char* text) {
            static_cast<FakeHost*>(self)->log_text += std::string(text) + "\n";
        };
        host_.publish = [](void* self, const char* channel, const void* data, std::size_t size) -> std::int32_t {
            auto& host = *static_cast<FakeHost*>(self);
            if (host.refuse > 0 && host.refuse-- > 0) return -1;
            const auto* bytes = static_cast<const std::uint8_t*>(data);
            host.published.push_back({channel, {bytes, bytes + size}});
            return 0;
        };
        host_.subscribe = [](void*, const char*, std::size_t, teres_message_handler, void*) -> std::int32_t {
            return 0;
        };
        host_.extension = [](void*, const char*) -> void* { return nullptr; };
        host_.now_us = [](void*) -> std::int64_t { return 0; };
    }
    FakeHost(const FakeHost&) = delete;
    FakeHost& operator=(const FakeHost&) = delete;

    const teres_host* get() const { return &host_; }
    std::string hash() const {
        RunHash hash;
        for (const Published& p : published) hash.add(p.channel, p.data);
        return hash.text();
    }

    std::vector<Published> published;
    std::string log_text;
    int refuse = 0;  ///< publishes that are refused from now on

  private:
    teres_host host_{};
};

/// The unit `id` of the build tree's teres_<id>.so, in a fake host.
class HostedForTest {
  public:
    HostedForTest(const std::string& id, FakeHost& host) {
        const char* build = std::getenv("TERES_BUILD_DIR");
        const std::string file =
            std::string(build != nullptr ? build : "build/release") + "/lib/teres/plugins/teres_" + id + ".so";
        void* library = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
        EXPECT_NE(library, nullptr) << dlerror();
        const auto* entry = static_cast<const teres_plugin_entry_t*>(dlsym(library, "teres_plugin_entry"));
        factory_ = entry->factories[0];
        self_ = factory_->create(host.get());
    }
    ~HostedForTest() { factory_->destroy(self_); }
    HostedForTest(const HostedForTest&) = delete;
    HostedForTest& operator=(const HostedForTest&) = delete;

    /// Empty on success, else the error text.
    std::string configure(const std::vector<teres_setting_value>& values) {
        char error[1024] = "";
        return factory_->configure(self_, values.data(), values.size(), error, sizeof error) == 0 ? "" : error;
    }
    std::string start() {
        char error[1024] = "";
        return factory_->start(self_, error, sizeof error) == 0 ? "" : error;
    }
    teres_step_outcome step() { return static_cast<teres_step_outcome>(factory_->step(self_, 0)); }
    void stop() { factory_->stop(self_); }
    void* extension(const char* id) { return factory_->extension(self_, id); }
    const teres_factory& factory() const { return *factory_; }

  private:
    const teres_factory* factory_ = nullptr;
    void* self_ = nullptr;
};

}  // namespace teres::test
