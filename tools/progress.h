// Progress of long work on standard error: a bar with the time left on a terminal, else a line every ten per
// cent.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdio>
#include <string>

namespace teres::tools {

class Progress {
  public:
    /// `total` steps of `what`. `out` and `terminal` are for tests; by default stderr and whether it is a
    /// terminal.
    Progress(std::string what, std::size_t total);
    Progress(std::string what, std::size_t total, std::FILE* out, bool terminal);
    /// Ends the line if the bar is still open.
    ~Progress();
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;

    /// `done` steps are done (not fewer than before).
    void update(std::size_t done);
    void step() { update(done_ + 1); }
    void finish() { update(total_); }

  private:
    void draw_bar(double seconds);

    std::string what_;
    std::size_t total_;
    std::FILE* out_;
    bool terminal_;
    std::size_t done_ = 0;
    int last_tenth_ = 0;
    bool open_ = false;  // a bar stands on the terminal without a line end
    std::chrono::steady_clock::time_point begin_, last_drawn_;
};

/// "8 s", "3 min 20 s", "2 h 5 min"
std::string duration_text(double seconds);

}  // namespace teres::tools
