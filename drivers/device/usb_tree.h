// Video nodes as sysfs shows them: a camera is chosen by serial number or by vendor:product, a card inside the machine
// by its name, never by /dev/videoN, which changes with the order of plugging.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace teres {

/// Where to look; tests put folders of their own here.
struct DeviceRoots {
    std::filesystem::path sys = "/sys";
    std::filesystem::path dev = "/dev";
};

struct VideoNode {
    std::filesystem::path node;  ///< /dev/videoN
    std::string serial;          ///< of the USB device; empty if it has none
    std::string id;              ///< "8086:0b07"; not on USB: the name its driver gives the node
    std::string product;
    int usb_mbps = 0;                  ///< 480: USB 2; 0: unknown
    std::filesystem::path usb_node;    ///< /dev/bus/usb/BBB/DDD for a reset; empty: unknown
    std::filesystem::path usb_device;  ///< folder in sysfs: the same for all nodes of one camera
};

/// All video nodes, sorted by number. Not for the loop: reads files.
std::vector<VideoNode> video_nodes(const DeviceRoots& roots);

}  // namespace teres
