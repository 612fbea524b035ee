// A channel name or an expression over channel names, as LCM understands it: it must match the whole name.
#pragma once

#include <regex.h>

#include <memory>
#include <string>

#include "core/result.h"

namespace teres {

class ChannelPattern {
  public:
    /// [setup] POSIX extended regular expression, e.g. "MARKERS|CAMERA_.*".
    static Result<ChannelPattern> make(const std::string& expression) {
        auto compiled = std::make_unique<regex_t>();
        const int code = regcomp(compiled.get(), ("^(" + expression + ")$").c_str(), REG_NOSUB | REG_EXTENDED);
        if (expression.empty() || code != 0)
            return invalid_input("channel '" + expression + "' is not a valid regular expression");
        return ChannelPattern(compiled.release());
    }
    /// [loop]
    bool matches(const char* channel) const noexcept { return regexec(regex_.get(), channel, 0, nullptr, 0) == 0; }

  private:
    struct Release {
        void operator()(regex_t* regex) const {
            regfree(regex);
            delete regex;
        }
    };
    explicit ChannelPattern(regex_t* regex) : regex_(regex) {}
    std::unique_ptr<regex_t, Release> regex_;
};

}  // namespace teres
