// Extension unit of Intel RealSense D4xx cameras on the stock uvcvideo driver: identity, calibration, depth unit,
// temperature, hardware reset. Unit 3 of the depth interface; selector 1 carries a command and its answer.
//
//     command  u16 length of what follows the first four bytes, u16 0xCDAB, u32 opcode, u32 p1..p4, data
//     answer   u32 opcode (or a negative error), data; u32 at 1020: length of the data (0 with old firmware)
//
// All numbers little-endian unless said. Answers come from a device and are checked like any input. Layout of the
// tables: public facts of the vendor's open SDK (ds-private.h, d400-private.h).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/result.h"
#include "drivers/device/system_calls.h"

namespace teres {

struct RealSenseIdentity {
    std::string firmware;     ///< "5.16.0.1"
    std::string serial;       ///< of the camera, as printed on it (12 hexadecimal digits)
    std::string asic_serial;  ///< as USB tells it
};

struct PinholeModel {
    int width_px = 0, height_px = 0;
    double fx_px = 0, fy_px = 0, cx_px = 0, cy_px = 0;
    std::array<double, 5> distortion{};  ///< k1 k2 p1 p2 k3, OpenCV's order: undistorted -> distorted
};

/// Pose of the colour camera: x_depth = R x_color + t.
struct RigidPose {
    std::array<double, 9> rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};  ///< row-major
    std::array<double, 3> translation_m{};
};

struct ColorCalibration {
    PinholeModel model;
    RigidPose pose;
};

namespace realsense {

using Bytes = std::vector<std::uint8_t>;
inline constexpr std::size_t kPacketBytes = 1024;
inline constexpr std::uint32_t kIdentity = 0x10, kCalibration = 0x15, kHardwareReset = 0x20, kAdvancedValue = 0x2c;
inline constexpr std::uint32_t kDepthTable = 25, kColorTable = 32, kDepthControl = 9;

/// The packet of a command, kPacketBytes long.
Bytes command_packet(std::uint32_t opcode, std::array<std::uint32_t, 4> parameters = {});
/// Data of an answer. Errors: too short, another opcode, an error code of the firmware, an impossible length.
Result<Bytes> answer_data(std::uint32_t opcode, std::span<const std::uint8_t> packet);

Result<RealSenseIdentity> parse_identity(std::span<const std::uint8_t> data);
/// Depth stream at this size: rectified, no distortion. Errors: short, wrong table, wrong CRC, a size the table does
/// not have, values that are no camera.
Result<PinholeModel> parse_depth_table(std::span<const std::uint8_t> data, int width_px, int height_px);
Result<double> parse_baseline_m(std::span<const std::uint8_t> data);
Result<ColorCalibration> parse_color_table(std::span<const std::uint8_t> data, int width_px, int height_px);
/// Metres per count of the Z16 stream. Error: out of [1e-6, 0.1].
Result<double> parse_depth_unit(std::span<const std::uint8_t> data);
/// CRC-32 as in IEEE 802.3, zlib.
std::uint32_t crc32(std::span<const std::uint8_t> data);

/// The device undistorts by a polynomial, OpenCV distorts by one: coefficients of the latter that undo the former
/// over the image, least squares. Error: residual above 1 px.
Result<std::array<double, 5>> forward_distortion(const PinholeModel& model, const std::array<double, 5>& inverse);

}  // namespace realsense

/// Commands over an open node of the depth interface.
class RealSense {
  public:
    /// Error (kInvalidInput): the node has no such unit.
    static Result<RealSense> attach(SystemCalls& calls, int fd);

    Result<RealSenseIdentity> identity();
    Result<PinholeModel> depth_model(int width_px, int height_px);
    Result<double> baseline_m();
    Result<ColorCalibration> color(int width_px, int height_px);
    Result<double> depth_unit_m();
    Result<double> temperature_c();  ///< of the projector, else of the chip
    Status hardware_reset();         ///< the device leaves the bus and comes back

  private:
    RealSense(SystemCalls& calls, int fd) : calls_(&calls), fd_(fd) {}
    Status query(std::uint8_t selector, std::uint8_t what, std::span<std::uint8_t> data);
    Result<realsense::Bytes> command(std::uint32_t opcode, std::array<std::uint32_t, 4> parameters = {});

    SystemCalls* calls_;
    int fd_;
};

}  // namespace teres
