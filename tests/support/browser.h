// Headless Chromium, driven over its DevTools pipe: JSON texts, each ended by a zero byte, in on descriptor 3, out
// on 4.
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/test_data.h"

extern char** environ;

namespace teres::test {

class Browser {
  public:
    static constexpr const char* kProgram = "/usr/bin/chromium";
    static bool installed() { return std::filesystem::exists(kProgram); }

    Browser(const std::string& url, int width_px, int height_px) {
        int in[2], out[2];
        if (pipe(in) != 0 || pipe(out) != 0) return;
        // The child's ends go out of the way of 3 and 4 first.
        const int child_in = fcntl(in[0], F_DUPFD, 10), child_out = fcntl(out[1], F_DUPFD, 10);
        to_ = fcntl(in[1], F_DUPFD_CLOEXEC, 10);
        from_ = fcntl(out[0], F_DUPFD_CLOEXEC, 10);
        for (const int fd : {in[0], in[1], out[0], out[1]}) close(fd);
        posix_spawn_file_actions_t files;
        posix_spawn_file_actions_init(&files);
        posix_spawn_file_actions_adddup2(&files, child_in, 3);
        posix_spawn_file_actions_adddup2(&files, child_out, 4);
        posix_spawn_file_actions_addopen(&files, 2, "/dev/null", O_WRONLY, 0);
        const std::vector<std::string> words{
            kProgram,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            "--no-first-run",
            "--remote-debugging-pipe",
            "--user-data-dir=" + (scratch_.path() / "profile").string(),
            "--window-size=" + std::to_string(width_px) + "," + std::to_string(height_px)};
        std::vector<char*> argv;
        for (const std::string& word : words) argv.push_back(const_cast<char*>(word.c_str()));
        argv.push_back(nullptr);
        if (posix_spawn(&child_, kProgram, &files, nullptr, argv.data(), environ) != 0) child_ = 0;
        posix_spawn_file_actions_destroy(&files);
        close(child_in);
        close(child_out);
        const auto target = call("Target.createTarget", {{"url", url}});
        const auto attached =
            call("Target.attachToTarget", {{"targetId", target.value("targetId", "")}, {"flatten", true}});
        session_ = attached.value("sessionId", "");
    }
    ~Browser() {
        if (to_ >= 0) close(to_);
        if (from_ >= 0) close(from_);
        if (child_ <= 0) return;
        kill(child_, SIGTERM);
        waitpid(child_, nullptr, 0);
    }
    Browser(const Browser&) = delete;
    Browser& operator=(const Browser&) = delete;

    /// Value of a JavaScript expression; null if it throws.
    nlohmann::json evaluate(const std::string& expression) {
        return call("Runtime.evaluate", {{"expression", expression}, {"returnByValue", true}})
            .value("/result/value"_json_pointer, nlohmann::json());
    }
    bool wait_until(const std::string& condition, double seconds = 10.0) {
        for (int i = 0; i < static_cast<int>(20.0 * seconds); ++i) {
            if (evaluate("Boolean(" + condition + ")") == true) return true;
            std::this_thread::sleep_for(std::chrono::milliseconds(50));
        }
        return false;
    }
    /// Left button down at one place, up at another, in pixels of the window.
    void drag(double u0, double v0, double u1, double v1) {
        mouse("mousePressed", u0, v0, 1);
        mouse("mouseMoved", u1, v1, 1);
        mouse("mouseReleased", u1, v1, 0);
    }
    /// PNG in base64.
    std::string screenshot() { return call("Page.captureScreenshot", {{"format", "png"}}).value("data", ""); }

  private:
    void mouse(const char* type, double u, double v, int buttons) {
        call("Input.dispatchMouseEvent",
             {{"type", type}, {"x", u}, {"y", v}, {"button", "left"}, {"buttons", buttons}, {"clickCount", 1}});
    }
    nlohmann::json call(const std::string& method, const nlohmann::json& parameters) {
        nlohmann::json request{{"id", ++id_}, {"method", method}, {"params", parameters}};
        if (!session_.empty()) request["sessionId"] = session_;
        const std::string text = request.dump();
        if (write(to_, text.c_str(), text.size() + 1) < 0) return nlohmann::json::object();
        for (;;) {  // events come between answers
            const auto answer = nlohmann::json::parse(read_text(), nullptr, false);
            if (answer.is_discarded()) return nlohmann::json::object();
            if (answer.value("id", 0) == id_) return answer.value("result", nlohmann::json::object());
        }
    }
    std::string read_text() {
        for (;;) {
            if (const auto end = waiting_.find('\0'); end != std::string::npos) {
                const std::string text = waiting_.substr(0, end);
                waiting_.erase(0, end + 1);
                return text;
            }
            pollfd ready{from_, POLLIN, 0};
            char bytes[65536];
            const ssize_t n = poll(&ready, 1, 30'000) > 0 ? read(from_, bytes, sizeof bytes) : 0;
            if (n <= 0) return {};
            waiting_.append(bytes, static_cast<std::size_t>(n));
        }
    }

    ScratchFolder scratch_;
    pid_t child_ = 0;
    int to_ = -1, from_ = -1, id_ = 0;
    std::string session_, waiting_;
};

}  // namespace teres::test
