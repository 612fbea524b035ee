#include "drivers/device/usb_tree.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>

namespace teres {
namespace {

namespace fs = std::filesystem;

std::string attribute(const fs::path& folder, const char* name) {
    std::ifstream stream(folder / name);
    std::string text;
    std::getline(stream, text);
    while (!text.empty() && (text.back() == ' ' || text.back() == '\r')) text.pop_back();
    return text;
}

int number(const fs::path& folder, const char* name) {
    return std::atoi(attribute(folder, name).c_str());
}

// The folder of the USB device above a class device: the first that has idVendor. Empty: none.
fs::path usb_device_above(fs::path folder, const fs::path& root) {
    std::error_code failure;
    for (; folder != root && folder.has_relative_path(); folder = folder.parent_path())
        if (fs::exists(folder / "idVendor", failure)) return folder;
    return {};
}

}  // namespace

std::vector<VideoNode> video_nodes(const DeviceRoots& roots) {
    std::vector<VideoNode> nodes;
    std::error_code failure;
    const fs::path root = fs::canonical(roots.sys, failure);
    for (fs::directory_iterator at(roots.sys / "class/video4linux", failure), end; !failure && at != end;
         at.increment(failure)) {
        const std::string name = at->path().filename();
        if (!name.starts_with("video")) continue;
        std::error_code vanished;
        const fs::path folder = fs::canonical(at->path(), vanished);
        if (vanished) continue;
        VideoNode node;
        node.node = roots.dev / name;
        if (const fs::path usb = usb_device_above(folder, root); !usb.empty()) {
            node.serial = attribute(usb, "serial");
            node.id = attribute(usb, "idVendor") + ":" + attribute(usb, "idProduct");
            node.product = attribute(usb, "product");
            node.usb_mbps = number(usb, "speed");
            node.usb_device = usb;
            char path[32];
            std::snprintf(path, sizeof path, "bus/usb/%03d/%03d", number(usb, "busnum"), number(usb, "devnum"));
            node.usb_node = roots.dev / path;
        } else {
            node.id = attribute(folder, "name");
        }
        nodes.push_back(std::move(node));
    }
    const auto order = [](const VideoNode& node) {
        return std::atoi(node.node.filename().string().c_str() + 5);  // behind "video"
    };
    std::sort(nodes.begin(), nodes.end(), [&](const VideoNode& a, const VideoNode& b) { return order(a) < order(b); });
    return nodes;
}

}  // namespace teres
