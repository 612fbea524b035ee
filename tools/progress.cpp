#include "tools/progress.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace teres::tools {

Progress::Progress(std::string what, std::size_t total) : Progress(std::move(what), total, stderr, isatty(2) == 1) {}

Progress::Progress(std::string what, std::size_t total, std::FILE* out, bool terminal)
    : what_(std::move(what)),
      total_(total),
      out_(out),
      terminal_(terminal),
      begin_(std::chrono::steady_clock::now()),
      last_drawn_(begin_) {}

Progress::~Progress() {
    if (open_) std::fputc('\n', out_);
}

void Progress::update(std::size_t done) {
    done_ = std::clamp(done, done_, total_);
    const auto now = std::chrono::steady_clock::now();
    const double seconds = std::chrono::duration<double>(now - begin_).count();
    if (terminal_) {
        // ten times a second is enough to look alive
        const bool complete = done_ == total_;
        if (!complete && open_ && now - last_drawn_ < std::chrono::milliseconds(100)) return;
        last_drawn_ = now;
        if (open_ || !complete || last_tenth_ == 0) draw_bar(seconds);
        if (complete && open_) {
            std::fputc('\n', out_);
            open_ = false;
            last_tenth_ = 10;
        }
    } else if (total_ > 0) {
        const int tenth = static_cast<int>(10 * done_ / total_);
        if (tenth > last_tenth_) {
            last_tenth_ = tenth;
            std::fprintf(out_, "%s: %zu %% (%zu of %zu), %s\n", what_.c_str(), 100 * done_ / total_, done_, total_,
                         duration_text(seconds).c_str());
        }
    }
    std::fflush(out_);
}

void Progress::draw_bar(double seconds) {
    constexpr int kWidth = 32;
    const double share = total_ > 0 ? static_cast<double>(done_) / static_cast<double>(total_) : 1.0;
    const int full = static_cast<int>(std::lround(share * kWidth));
    std::string bar(static_cast<std::size_t>(full), '#');
    bar.resize(kWidth, '.');
    std::string time = duration_text(seconds);
    if (done_ > 0 && done_ < total_) time = duration_text(seconds * (1.0 - share) / share) + " left";
    // \x1b[K clears what a longer line left behind
    std::fprintf(out_, "\r%s [%s] %3d %%  %zu/%zu  %s\x1b[K", what_.c_str(), bar.c_str(),
                 static_cast<int>(100.0 * share), done_, total_, time.c_str());
    open_ = true;
}

std::string duration_text(double seconds) {
    const auto whole = static_cast<long long>(std::max(0.0, std::ceil(seconds)));
    if (whole < 60) return std::to_string(whole) + " s";
    if (whole < 3600) return std::to_string(whole / 60) + " min " + std::to_string(whole % 60) + " s";
    return std::to_string(whole / 3600) + " h " + std::to_string(whole % 3600 / 60) + " min";
}

}  // namespace teres::tools
