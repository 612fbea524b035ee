#include "drivers/device/system_calls.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include "core/clock.h"

namespace teres {
namespace {

class LinuxCalls final : public SystemCalls {
  public:
    int open(const char* path, int flags) override { return ::open(path, flags | O_CLOEXEC); }
    int close(int fd) override { return ::close(fd); }
    int ioctl(int fd, unsigned long request, void* argument) override { return ::ioctl(fd, request, argument); }
    void* mmap(std::size_t length, int fd, std::int64_t offset) override {
        return ::mmap(nullptr, length, PROT_READ | PROT_WRITE, MAP_SHARED, fd, offset);
    }
    int munmap(void* address, std::size_t length) override { return ::munmap(address, length); }
    int poll(int fd, short events, int timeout_ms) override {
        pollfd one{fd, events, 0};
        return ::poll(&one, fd < 0 ? 0 : 1, timeout_ms);
    }
    ssize_t read(int fd, void* to, std::size_t size) override { return ::read(fd, to, size); }
    std::int64_t now_us() override { return monotonic_us(); }
};

}  // namespace

SystemCalls& linux_calls() {
    static LinuxCalls calls;
    return calls;
}

}  // namespace teres
