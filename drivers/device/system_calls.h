// The calls into the kernel that the drivers make, as a table that tests replace: every errno branch can be taken
// without a device. Semantics as in the manual pages: -1 (MAP_FAILED) and errno on failure.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>

namespace teres {

class SystemCalls {
  public:
    virtual ~SystemCalls() = default;
    virtual int open(const char* path, int flags) = 0;
    virtual int close(int fd) = 0;
    virtual int ioctl(int fd, unsigned long request, void* argument) = 0;
    virtual void* mmap(std::size_t length, int fd, std::int64_t offset) = 0;  ///< shared, read and write
    virtual int munmap(void* address, std::size_t length) = 0;
    virtual int poll(int fd, short events, int timeout_ms) = 0;  ///< fd < 0: only waits
    virtual ssize_t read(int fd, void* to, std::size_t size) = 0;
    virtual std::int64_t now_us() = 0;  ///< CLOCK_MONOTONIC
};

/// The real ones.
SystemCalls& linux_calls();

}  // namespace teres
