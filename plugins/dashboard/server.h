// A small web server with one page; loopback only, unless a token is set.
//
//     GET /            the page            GET /frame.jpg   newest augmented image
//     GET /state       JSON                GET /mesh        JSON, surface at rest
#pragma once

#include <memory>
#include <string>

#include "core/result.h"
#include "plugins/dashboard/snapshot.h"

namespace teres {

extern const char* const kDashboardPage;

class DashboardServer {
  public:
    struct Options {
        std::string address = "127.0.0.1";
        int port = 8642;    ///< 0: any free one
        std::string token;  ///< asked for as ?token= or cookie, if set
    };
    /// [setup] Serves from threads of its own until destroyed. Errors: kInvalidInput if the address is not loopback
    /// and there is no token, kHostFault if the port cannot be bound.
    static Result<std::unique_ptr<DashboardServer>> start(const Options& options, const Snapshot& snapshot);
    ~DashboardServer();
    DashboardServer(const DashboardServer&) = delete;
    DashboardServer& operator=(const DashboardServer&) = delete;
    int port() const { return port_; }

  private:
    struct Impl;
    DashboardServer() = default;
    std::unique_ptr<Impl> impl_;
    int port_ = 0;
};

}  // namespace teres
