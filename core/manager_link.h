// What the service tells the service manager (sd_notify(3)), without ever being held up by it: sd_notify
// itself blocks when the manager does not read its socket.
#pragma once

#include <cstdint>
#include <string_view>

namespace teres {

class ManagerLink {
  public:
    /// [setup] Takes $NOTIFY_SOCKET; without it, every call does nothing. `watchdog`: answer $WATCHDOG_USEC.
    explicit ManagerLink(bool watchdog);
    ~ManagerLink();
    ManagerLink(const ManagerLink&) = delete;
    ManagerLink& operator=(const ManagerLink&) = delete;

    /// [loop] with wait_ms = 0. False if it could not be sent within that time.
    bool tell(std::string_view text, int wait_ms = 0) noexcept;
    /// [loop] Once per turn: WATCHDOG=1 every quarter of the manager's limit (sd_watchdog_enabled(3) asks for
    /// half).
    void ping(std::int64_t now_us) noexcept;

  private:
    int socket_ = -1;
    std::int64_t period_us_ = -1;
    std::int64_t next_us_ = 0;
};

}  // namespace teres
