// The thread of one device: calls its pass() again and again. It shares the device with the unit: one that hangs in the
// kernel is left behind, not waited for.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <thread>

namespace teres {

class DeviceThread {
  public:
    template <class Device>
    explicit DeviceThread(std::shared_ptr<Device> device) {
        std::thread([state = state_, device = std::move(device)]() mutable {
            while (!state->stop) device->pass();
            device.reset();
            const std::lock_guard lock(state->mutex);
            state->ended = true;
            state->end.notify_all();
        }).detach();
    }
    /// [setup] False if it does not end within the time.
    bool stop(std::chrono::milliseconds wait) {
        state_->stop = true;
        std::unique_lock lock(state_->mutex);
        return state_->end.wait_for(lock, wait, [&] { return state_->ended; });
    }

  private:
    struct State {
        std::atomic<bool> stop{false};
        std::mutex mutex;
        std::condition_variable end;
        bool ended = false;
    };
    std::shared_ptr<State> state_ = std::make_shared<State>();
};

}  // namespace teres
