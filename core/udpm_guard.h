// Two checks of the UDP socket that liblcm opens for udpm:// and keeps to itself.
//
// 1. A packet filter in the kernel that drops what crashes liblcm 1.3.1 (and 1.5.2): fragments whose offset lies
// outside the
//    message they announce (offset and length are added in 32 bits, the sum wraps and the copy runs outside the buffer,
//    lcm-proj/lcm #628), fragments shorter than their header, and channel names that do not end within their packet
//    (the length of the data becomes negative and 4 GB are copied).
// 2. The size of the receive buffer that the kernel really granted: a request above net.core.rmem_max is cut silently
// and
//    images are lost.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

namespace teres {

/// What an udpm:// URL asks for.
struct UdpmUrl {
    int port = 7667;
    std::optional<long> recv_buf_size;  ///< [bytes]
};
UdpmUrl parse_udpm_url(const std::string& url);

struct UdpmGuard {
    int sockets = 0;                  ///< UDP sockets of this process that are bound to the port
    int filtered = 0;                 ///< of these, with the filter attached
    std::optional<long> recv_buffer;  ///< smallest granted receive buffer [bytes]
};

/// [setup] Attaches the filter and reads the buffer; warns with the remedy where either falls short.
UdpmGuard guard_udpm_socket(const std::string& url);

}  // namespace teres
