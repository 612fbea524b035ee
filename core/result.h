// How set-up reports failure: a value or an Error that says what, which bound and where. The loop never uses
// exceptions.
#pragma once

#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace teres {

/// Also the exit codes of the commands (0 is success).
enum class ErrorKind : int {
    kNotUsable = 1,     ///< it ran, the result is not usable (e.g. a solve did not converge)
    kInvalidInput = 2,  ///< wrong usage or input; the text names file, line, value and bound
    kHostFault = 3,     ///< the host or a device failed (a library missing, a socket refused)
};

struct Error {
    ErrorKind kind = ErrorKind::kInvalidInput;
    std::string text;
};

template <class T>
using Result = tl::expected<T, Error>;
using Status = Result<void>;

inline tl::unexpected<Error> invalid_input(std::string text) {
    return tl::unexpected(Error{ErrorKind::kInvalidInput, std::move(text)});
}
inline tl::unexpected<Error> not_usable(std::string text) {
    return tl::unexpected(Error{ErrorKind::kNotUsable, std::move(text)});
}
inline tl::unexpected<Error> host_fault(std::string text) {
    return tl::unexpected(Error{ErrorKind::kHostFault, std::move(text)});
}

}  // namespace teres

#define TERES_CONCAT_INNER(a, b) a##b
#define TERES_CONCAT(a, b) TERES_CONCAT_INNER(a, b)

/// Returns the error of a Status or Result to the caller.
#define TERES_TRY(expression)                                                      \
    do {                                                                           \
        auto teres_status = (expression);                                          \
        if (!teres_status) return tl::unexpected(std::move(teres_status).error()); \
    } while (false)

/// TERES_TRY_ASSIGN(auto value, make_value()): binds the value or returns the error to the caller.
#define TERES_TRY_ASSIGN(declaration, expression)                                        \
    auto TERES_CONCAT(teres_result_, __LINE__) = (expression);                           \
    if (!TERES_CONCAT(teres_result_, __LINE__))                                          \
        return tl::unexpected(std::move(TERES_CONCAT(teres_result_, __LINE__)).error()); \
    declaration = std::move(*TERES_CONCAT(teres_result_, __LINE__))
