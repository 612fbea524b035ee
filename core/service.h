// The service: a session that runs until it is told to stop, with the service manager informed from the loop
// itself (READY=1, WATCHDOG=1, STATUS=, STOPPING=1): a loop that hangs is a service that hangs.
#pragma once

#include <atomic>

#include "core/config.h"
#include "core/result.h"

namespace teres {

/// [setup] SIGTERM and SIGINT set a flag instead of ending the process, as long as this lives. One at a time.
class StopSignals {
  public:
    StopSignals();
    ~StopSignals();
    StopSignals(const StopSignals&) = delete;
    StopSignals& operator=(const StopSignals&) = delete;
    const std::atomic<bool>& stop() const;
};

/// Runs until `stop`, or until every driver's stream has ended (service.stop_when_finished).
/// Errors: as Session::open and start; a unit that failed while running or a bus that failed (kHostFault).
Status run_service(const Config& config, const std::atomic<bool>& stop);

}  // namespace teres
