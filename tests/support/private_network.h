// Puts the test process into a network namespace of its own, with loopback up and the route that LCM's
// multicast needs: nothing leaves the machine and parallel tests do not hear each other.
#pragma once

#include <net/if.h>
#include <net/route.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>

namespace teres::test {

inline constexpr const char* kLcmGroup = "239.255.76.67";
inline constexpr std::uint32_t kLcmGroupAddress = 0xefff4c43;
inline constexpr const char* kLoopbackUrl = "udpm://239.255.76.67:7667?ttl=0";

inline bool set_loopback(bool up) {
    const int fd = socket(AF_INET, SOCK_DGRAM, 0);
    ifreq request{};
    std::strcpy(request.ifr_name, "lo");
    bool good = ioctl(fd, SIOCGIFFLAGS, &request) == 0;
    request.ifr_flags =
        static_cast<short>(up ? request.ifr_flags | IFF_UP | IFF_MULTICAST : request.ifr_flags & ~IFF_UP);
    good = good && ioctl(fd, SIOCSIFFLAGS, &request) == 0;
    if (good && up) {
        rtentry route{};
        auto& group = reinterpret_cast<sockaddr_in&>(route.rt_dst);
        group.sin_family = AF_INET;
        group.sin_addr.s_addr = htonl(kLcmGroupAddress);
        auto& mask = reinterpret_cast<sockaddr_in&>(route.rt_genmask);
        mask.sin_family = AF_INET;
        mask.sin_addr.s_addr = 0xffffffff;
        char device[] = "lo";
        route.rt_dev = device;
        route.rt_flags = RTF_UP | RTF_HOST;
        good = ioctl(fd, SIOCADDRT, &route) == 0;
    }
    close(fd);
    return good;
}

/// Once per process. Empty on success, else the reason why this machine does not permit it.
inline const std::string& enter_private_network() {
    static const std::string reason = [] {
        if (unshare(CLONE_NEWNET) != 0 && unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0)
            return std::string("cannot make a network namespace: ") + std::strerror(errno);
        if (!set_loopback(true)) return std::string("cannot set up loopback: ") + std::strerror(errno);
        return std::string();
    }();
    return reason;
}

}  // namespace teres::test

/// Skips loudly where a network namespace is not permitted.
#define TERES_REQUIRE_PRIVATE_NETWORK()                \
    if (!teres::test::enter_private_network().empty()) \
    GTEST_SKIP() << "SKIPPED LOUDLY: " << teres::test::enter_private_network()
