#include "plugins/dashboard/server.h"

#include <httplib.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <thread>

namespace teres {
namespace {

// Takes the same time for every wrong token.
bool same(const std::string& a, const std::string& b) {
    unsigned difference = a.size() == b.size() ? 0U : 1U;
    for (std::size_t i = 0; i < a.size() && i < b.size(); ++i)
        difference |= static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b[i]);
    return difference == 0;
}

bool is_loopback(const std::string& address) {
    return address == "localhost" || address == "::1" || address == "[::1]" || address.starts_with("127.");
}

std::string cookie(const httplib::Request& request, const std::string& key) {
    const std::string all = request.get_header_value("Cookie");
    const auto at = all.find(key + "=");
    if (at == std::string::npos) return {};
    const auto begin = at + key.size() + 1;
    return all.substr(begin, all.find(';', begin) - begin);
}

// Without a token only who asks for this machine by its loopback name: a foreign page that has its own name resolved
// to 127.0.0.1 sends that name as Host.
bool may_enter(const httplib::Request& request, const std::string& token) {
    if (!token.empty()) return same(request.get_param_value("token"), token) || same(cookie(request, "teres"), token);
    const std::string host = request.get_header_value("Host");
    return is_loopback(host.substr(0, host.find_last_of(':')));
}

}  // namespace

struct DashboardServer::Impl {
    httplib::Server http;
    std::thread thread;
};

Result<std::unique_ptr<DashboardServer>> DashboardServer::start(const Options& options, const Snapshot& snapshot) {
    if (!is_loopback(options.address) && options.token.empty())
        return invalid_input("dashboard.address = " + options.address + " is not loopback: set dashboard.token");
    if (!std::all_of(options.token.begin(), options.token.end(),
                     [](unsigned char c) { return std::isalnum(c) || c == '-' || c == '_'; }))
        return invalid_input("dashboard.token: letters, digits, - and _ only");
    std::unique_ptr<DashboardServer> server(new DashboardServer);
    server->impl_ = std::make_unique<Impl>();
    httplib::Server& http = server->impl_->http;
    http.new_task_queue = [] { return new httplib::ThreadPool(4); };
    http.set_payload_max_length(4096);
    http.set_pre_routing_handler([token = options.token](const httplib::Request& request, httplib::Response& response) {
        response.set_header("Cache-Control", "no-store");
        response.set_header("X-Content-Type-Options", "nosniff");
        if (may_enter(request, token)) {
            if (request.has_param("token") && !token.empty())
                response.set_header("Set-Cookie", "teres=" + token + "; HttpOnly; SameSite=Strict");
            return httplib::Server::HandlerResponse::Unhandled;
        }
        response.status = 403;
        response.set_content("token missing or wrong, or asked for by another name than 127.0.0.1\n", "text/plain");
        return httplib::Server::HandlerResponse::Handled;
    });
    http.Get("/", [](const httplib::Request&, httplib::Response& r) {
        r.set_content(kDashboardPage, "text/html; charset=utf-8");
    });
    http.Get("/state", [&snapshot](const httplib::Request&, httplib::Response& r) {
        r.set_content(snapshot.state(), "application/json");
    });
    http.Get("/mesh", [&snapshot](const httplib::Request&, httplib::Response& r) {
        r.set_content(snapshot.mesh(), "application/json");
    });
    http.Get("/frame.jpg", [&snapshot](const httplib::Request&, httplib::Response& r) {
        const std::string image = snapshot.image();
        if (image.empty())
            r.status = 404;
        else
            r.set_content(image, "image/jpeg");
    });
    server->port_ = options.port;
    const bool bound = options.port == 0 ? (server->port_ = http.bind_to_any_port(options.address.c_str())) > 0
                                         : http.bind_to_port(options.address.c_str(), options.port);
    if (!bound)
        return host_fault("dashboard: cannot listen on " + options.address + ":" + std::to_string(options.port) +
                          " (in use?)");
    server->impl_->thread = std::thread([&http] { http.listen_after_bind(); });
    while (!http.is_running())
        std::this_thread::sleep_for(std::chrono::milliseconds(1));  // before, stop() would be lost
    return server;
}

DashboardServer::~DashboardServer() {
    if (!impl_) return;
    impl_->http.stop();
    if (impl_->thread.joinable()) impl_->thread.join();
}

}  // namespace teres
